"""Rules about what an effect predicts: finite, pure, as linear and as smooth as it says, nothing at its null."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from kinid.effects import Signals, catalogue, get
from kinid.effects._signals import REMEMBERED
from kinid.modeling.contract._case import Case, Rule, demand, true_values
from kinid.modeling.forward import Route
from kinid.modeling.model import Model
from kinid.modeling.reference_motions import arrays
from kinid.writers import Json

if TYPE_CHECKING:
    from _typeshed import DataclassInstance

Array = NDArray[np.float64]

#: two ways to the same prediction differ by rounding alone: share of the reading
ROUNDING = 1e-12
#: an effect is at work where it changes a channel by this share of the reading
AT_WORK = 5e-3
#: departure from affinity that rounding of a prediction leaves; and the least that bends what others predict
AFFINE, BENT = 1e-9, 1e-6
#: steps of central differences, as a share of a value (what `kinid.estimators.batch` takes), and how far they may be
#: from the extrapolation of wider ones: rounding leaves 1e-16/6e-6 of the reading, a corner one sample of a thousand
STEP, SLOPES_APART = 6e-6, 1e-4


def finite(case: Case) -> str:
    """Predictions are finite, of the layout's shape, the same each time, and leave the motion as it was."""
    inputs = arrays(case.signals)
    before = [array.copy() for array in inputs]
    shape = (len(case.signals.layout.channels), len(case.signals))
    for said, values in (("true", case.values), ("nominal", case.model.nominal(case.signals.layout))):
        reading = case.model.predict(case.signals, values)
        demand(reading.shape == shape, f"readings of shape {reading.shape} instead of {shape}")
        demand(np.isfinite(reading).all(), f"readings that aren't finite at {said} values")
    again = case.model.predict(case.signals, case.values)
    demand(np.array_equal(again, case.reading), "another prediction at the second time")
    demand(all(np.array_equal(a, b) for a, b in zip(inputs, before)), "a motion that was written into")
    return f"{shape[0]} × {shape[1]} readings"


def pure(case: Case) -> str:
    """Arrays are replaced and never written into: those of the chain are closed before each effect acts."""

    def closed(act: Callable[[Signals, Array], None]) -> Callable[[Signals, Array], None]:
        def run(s: Signals, p: Array) -> None:
            for array in (*arrays(s), p):
                array.setflags(write=False)
            act(s, p)

        return run

    route = Route.of(case.model.effects, case.signals.layout.kind)
    steps = tuple(dataclasses.replace(step, act=closed(step.act)) for step in route.steps)
    parts = [case.values[case.model.place(e.id, case.signals.layout)] for e in case.model.effects]
    reading = dataclasses.replace(route, steps=steps).run(case.signals, parts).reading
    demand(np.array_equal(reading, case.reading), "another prediction where arrays are closed")
    return "no array written into"


def null(case: Case) -> str:
    """At its null it isn't there, at its true values it is."""
    if case.kind.base:
        demand(not case.kind.null, f"a null of {', '.join(case.kind.null)}, of a base")
        return "a base has none"
    demand(case.null, "no null: an effect that can't be switched off can't be tested for")
    here = case.beside
    without = here.rest.predict(here.signals, here.rest_values)
    off = np.abs(here.model.predict(here.signals, here.at_null) - without).max(axis=1)
    size = np.abs(without).max(axis=1)
    demand((off <= ROUNDING * np.maximum(size, 1.0)).all(), f"readings that it changes by {off.max():.2g} at its null")
    on = np.abs(here.reading - without).max(axis=1)
    demand((on > AT_WORK * size).any(), f"readings that it changes by {on.max():.2g} at its true values")
    return f"changes readings by {on.max():.3g} at true values, by {off.max():.1g} at its null"


def linear(case: Case) -> str:
    """Readings are affine in what is marked linear, unless the law says that it bends what others predict."""
    marked = [p.linear for p in case.named.values()]
    apart = departure_from_affine(case.model, case.measured, case.values)
    if case.affine:
        demand(apart < AFFINE, f"a departure of {apart:.2g}")
    elif not case.kind.affine and any(marked):
        demand(apart > BENT, f"affine = False, and a departure of {apart:.2g}")
    return f"{sum(marked)} linear parameters, departure {apart:.1g}"


def departure_from_affine(model: Model, signals: Signals, values: Array, seed: int = 0) -> float:
    """How far readings are from affine in all parameters of a model marked linear, relative to the largest change."""
    named = list(model.parameters(signals.layout).values())
    chosen = [i for i, p in enumerate(named) if p.linear]
    if not chosen:
        return 0.0

    def at(x: Array) -> Array:
        full = values.copy()
        full[chosen] = x
        return model.predict(signals, full)

    # of either sign, where the law allows it: the linear part is solved for before it is held within bounds
    rng = np.random.default_rng(seed)
    size = np.array([max(abs(values[i]), named[i].scale) for i in chosen])
    x, y = (size * rng.uniform(0.3, 2.0, len(chosen)) for _ in range(2))
    zero = at(np.zeros(len(chosen)))
    a, b, both = at(x) - zero, at(y) - zero, at(x + y) - zero
    return float(np.abs(both - a - b).max() / max(np.abs(both).max(), np.abs(zero).max(), 1e-30))


def derivatives(case: Case) -> str:
    """The central differences that a fit takes agree with Richardson's extrapolation of wider ones."""
    if case.kind.detector:
        return "told by its mark, not by derivatives"
    worst = 0.0
    for i, (name, p) in zip(case.places, case.own.items()):

        def slope(h: float, i: int = i) -> Array:
            ahead, behind = case.values.copy(), case.values.copy()
            ahead[i], behind[i] = case.values[i] + h, case.values[i] - h
            return (case.model.predict(case.measured, ahead) - case.model.predict(case.measured, behind)) / (2 * h)

        h = STEP * max(abs(case.values[i]), p.scale)
        value = case.values[i]
        demand(p.low <= value - 8 * h and value + 8 * h <= p.high, f"{name} = {value:g}, too near to a bound")
        one, wide, wider = slope(h), slope(4 * h), slope(8 * h)
        best = (4 * wide - wider) / 3
        size = float(np.linalg.norm(best))
        demand(size > 0, f"{name} isn't excited by the example")
        apart = float(np.linalg.norm(one - best)) / size
        demand(apart < SLOPES_APART, f"{apart:.2g} between differences over {name}")
        worst = max(worst, apart)
    return f"differences agree to {worst:.1g}"


def gap(case: Case) -> str:
    """Over a long gap nothing is remembered: what comes after it is as in a log that begins there."""
    restarts = np.flatnonzero(case.signals.dt == 0.0)
    if len(restarts) < 2:
        return "the motion has no gap"
    k = int(restarts[1])
    # what materials remember outlasts a short gap
    late = np.where(np.arange(len(case.signals)) >= k, 1.01 * REMEMBERED, 0.0)
    signals = dataclasses.replace(case.signals, t=case.signals.t + late)
    whole = case.model.predict(signals, case.values)
    apart = np.abs(whole[:, k:] - case.model.predict(tail(signals, k), case.values)).max()
    demand(apart <= ROUNDING * max(1.0, np.abs(whole).max()), f"{apart:.2g} remembered over a gap")
    return "begins anew"


def tail(signals: Signals, k: int) -> Signals:
    """Signals from sample k on."""

    def cut(thing: DataclassInstance, first: tuple[str, ...] = (), whole: tuple[str, ...] = ()) -> Json:
        out = {}
        for field in dataclasses.fields(thing):
            value = getattr(thing, field.name)
            if isinstance(value, np.ndarray) and value.size and field.name not in whole:
                out[field.name] = value[k:] if field.name in first else np.ascontiguousarray(value[..., k:])
        return out

    parts: Json = cut(signals)
    if signals.sensor is not None:
        parts["sensor"] = dataclasses.replace(signals.sensor, **cut(signals.sensor, ("to_contact",), ("tip", "com")))
    if signals.joints is not None:
        parts["joints"] = dataclasses.replace(signals.joints, **cut(signals.joints))
    return dataclasses.replace(signals, **parts)


def order(case: Case) -> str:
    """Beside each other effect that acts at one of its stages, it does the same whichever a model names first."""
    if case.kind.base:
        return "a base comes first"
    rest, layout = [effect for effect in case.model.effects if effect.id != case.name], case.signals.layout
    beside = []
    for other in map(get, catalogue()):
        needed = not other.requires or set(other.requires) & set(case.model.names)
        acts = set(other.stages()) & set(case.effect.stages()) and other.parameters(layout)
        if not needed or not acts or other.base or other.id in case.model:
            continue
        models = Model(*rest, case.kind(), other), Model(*rest, other, case.kind())
        one, two = (model.predict(case.signals, true_values(model, layout)) for model in models)
        apart = float(np.abs(one - two).max() / max(np.abs(one).max(), 1e-30))
        demand(apart < ROUNDING, f"another reading before '{other.id}' than behind it, by {apart:.2g}")
        beside.append(other.id)
    return f"the same beside {len(beside)} others"


PREDICTION = (
    Rule("prediction", finite, "finite readings, the same each time", "look for divisions by zero, and for state kept"),
    Rule("purity", pure, "arrays that are replaced, never written into", "write s.normal = s.normal + …, not +="),
    Rule("null", null, "nothing at its null, more than 0.5 % of readings at true values", "correct `null` or values"),
    Rule("linear", linear, "readings affine in what is marked linear", "mark it linear=False, or set affine = False"),
    Rule("derivatives", derivatives, "smooth in each parameter", "round off kinks, or excite it in the example"),
    Rule("order", order, "the same before and behind others of its stage", "give it an `order`: lower ones act first"),
    Rule("gap", gap, "memory that begins anew where dt = 0 over 10 s", "start its state again where s.dt is zero"),
)
