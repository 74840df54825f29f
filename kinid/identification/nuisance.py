"""What calibration leaves open: small amounts of effects that every rig has, each inside its stated tolerance.

An effect says of its parameters to which standard deviation a rig's calibration leaves them open
(`Effect.calibration_sd`). Where the model hasn't got it, the fit takes along its first-order change of the readings,
with a normal prior of that size.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from kinid.effects import Effect, Layout, Signals
from kinid.identification.problem import Problem
from kinid.modeling.applicability import amplitudes, base_of, candidate_effects
from kinid.modeling.forward import Course
from kinid.modeling.model import Model
from kinid.modeling.remembered import remembered

Array = NDArray[np.float64]

#: calibration is trusted to so many tolerances
MAX_SHIFT = 2.0
#: tolerances that a quantity is moved by, at least, to see what it does: touch begins with a jump, and by less few
#: samples tell
LEAST_STEP = 1.0


@dataclass(frozen=True, eq=False)
class Nuisance:
    """One open quantity: a parameter of an effect that the model lacks, with its tolerance as a standard deviation.

    A fit may take it from `low` to `high` tolerances: no further than calibration is off, nor out of its parameter's
    range.
    """

    effect: Effect
    index: int
    name: str
    sd: float
    unit: str
    low: float
    high: float


def nuisances(model: Model, signals: Signals) -> tuple[Nuisance, ...]:
    """All open quantities of a log beside a model."""
    out = []
    for effect, why in candidate_effects(model, signals.layout):
        tolerances = {} if why else effect.calibration_sd(signals)
        if not tolerances:
            continue
        null, bound = amplitudes(effect, signals.layout, base_of(model)), effect.calibration_bound(signals.layout)
        for i, p in enumerate(effect.parameters(signals.layout)):
            if (sd := tolerances.get(p.name, 0.0)) > 0.0:
                low, high = ((end - null.get(i, p.nominal)) / sd for end in (p.low, p.high))
                out.append(Nuisance(effect, i, p.name, sd, p.unit, max(-bound, low), min(bound, high)))
    return tuple(out)


def shift_bounds(open_: Sequence[Nuisance]) -> tuple[Array, Array]:
    """Lowest and highest amounts of nuisances, in tolerances, each (k,)."""
    return np.array([n.low for n in open_]), np.array([n.high for n in open_])


def predict_with(
    nuisance: Nuisance, model: Model, values: Array, signals: Signals, near: Course | None = None
) -> Array:
    """Readings with one tolerance of an open quantity, (channels, n)."""
    return with_calibration(model, values, (nuisance,), np.ones(1), signals, near)


def with_calibration(
    model: Model,
    values: Array,
    open_: Sequence[Nuisance],
    shift: Array,
    signals: Signals,
    near: Course | None = None,
) -> Array:
    """Predict readings with each nuisance at so many of its tolerances, no more than are trusted, (channels, n).

    The effects themselves act, not their first order, in which a fit found the amounts: a delay across a step is none.
    """
    layout = signals.layout
    whole, own = model, {effect.id: values[model.place(effect.id, layout)] for effect in model.effects}
    for nuisance, amount in zip(open_, trusted(shift)):
        effect = nuisance.effect
        if effect.id not in own:
            whole = _beside(whole, effect)
            own[effect.id] = np.array(_nothing(effect, layout, base_of(model)))
        own[effect.id][nuisance.index] += amount * nuisance.sd
    together = [own[effect.id] for effect in whole.effects]
    return whole.predict(signals, np.concatenate(together) if together else values, near)


@remembered  # a model that logs share remembers its way along the chain
def _beside(model: Model, effect: Effect) -> Model:
    return model + effect


@remembered
def _nothing(effect: Effect, layout: Layout, base: str | None) -> tuple[float, ...]:
    """Values of an effect's parameters at which it does nothing."""
    null = amplitudes(effect, layout, base)
    return tuple(null.get(i, p.nominal) for i, p in enumerate(effect.parameters(layout)))


def nuisance_columns(
    problem: Problem, model: Model, values: Array, here: Course, open_: tuple[Nuisance, ...], shift: Array
) -> Array:
    """Change of the means per tolerance of each open quantity, (channels · g, k).

    It is the change to where the quantity is, `shift` (k,) in tolerances, or to one on that side: a surface bends a law
    to the same side whichever way it is off, and would pull what many logs share to that side.
    """
    out = np.zeros((problem.target.size, len(open_)), order="F")
    for j, (nuisance, amount) in enumerate(zip(open_, shift)):
        step = max(amount, LEAST_STEP) if amount >= 0.0 else min(amount, -LEAST_STEP)
        so_far = replace(nuisance, sd=step * nuisance.sd)
        moved = predict_with(so_far, model, values, problem.experiment.signals, here)
        problem.add_change(moved, here.reading, 1.0 / step, out[:, j])
    return out


def trusted(shift: Array) -> Array:
    """Clip amounts in tolerances, (k,), to what calibration is trusted to; more is an error of the model."""
    out: Array = np.clip(shift, -MAX_SHIFT, MAX_SHIFT)
    return out
