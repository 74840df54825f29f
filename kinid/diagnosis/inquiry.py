"""From a log and a model to a diagnosis: detectors first, then the search, then conclusions."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray
from threadpoolctl import threadpool_limits

from kinid.contact import ContactSeries, contact_series, force_noise
from kinid.diagnosis.conclusions import Found
from kinid.diagnosis.cores import side_by_side
from kinid.diagnosis.descent import State, fit, settled
from kinid.diagnosis.detectors import detect
from kinid.diagnosis.effort import Effort
from kinid.diagnosis.noise import as_their_like
from kinid.diagnosis.problem import Problem, thin
from kinid.diagnosis.reconsider import reweighted
from kinid.diagnosis.refusals import (
    one_by_one,
    refuse_effort,
    refuse_idle,
    refuse_log,
    refuse_names,
    refuse_outliers,
    refuse_signs,
)
from kinid.diagnosis.result import Diagnosis
from kinid.diagnosis.search import LOWER, NEAR_NOISE, search
from kinid.errors import InputError
from kinid.experiment import Experiment, from_contact, from_joint_torques, from_wrench
from kinid.fit import Fit, check_excitation, contact_channels, rig_of, starting_values
from kinid.log import Log
from kinid.memory import give_back
from kinid.model import Model
from kinid.motion import STATIC_PERIOD
from kinid.rig import Rig

Array = NDArray[np.float64]

#: share of a channel's own size that noise of static poses is taken to be at most
STATIC_NOISE = 0.01
#: share of a channel's own size below which noise is not believed to lie
DIGITS = 1e-3
#: how often a search begins anew with noise carried through what it found
RECONSIDERED = 2
#: how often a fit that hasn't converged is taken up again
TAKEN_UP = 4
#: effects that are added at most, unless the caller says otherwise
MOST_EFFECTS = 4


def diagnose(
    data: Fit | ContactSeries | Log,
    rig: Rig | None = None,
    *,
    model: Model | None = None,
    add: Sequence[str] = (),
    max_effects: int = MOST_EFFECTS,
    effort: float = 1.0,
    progress: Callable[[str], None] = lambda _: None,
) -> Diagnosis:
    """Compare a model with the measurement, and say which effects it lacks.

    Where the log behind a fit has joints and the whole wrench, all six channels are looked at, not only the contact forces that
    the fit was made to.

    Args:
        data: a fit; or contact-frame quantities, or a log with its `rig`, together with a `model`.
        model: the model to ask about; a fit has its own.
        add: effects to add whatever the evidence says.
        max_effects: so many are added at most.
        effort: the search may do so many times the usual work, which takes some seconds at most.
        progress: told what is being done.

    Raises:
        InputError: a log too short to hold any of it out, an unknown name, an effect that the model has already, or data that
            can't carry the model.
    """
    if not isinstance(data, Fit | ContactSeries | Log):
        raise InputError(f"{type(data).__name__} to diagnose", "a fit, contact-frame quantities, or a log with its rig",
                         "read it with kinid.read(path, rig)")  # fmt: skip
    if model is not None and not isinstance(model, Model):
        raise InputError(f"a model that is a {type(model).__name__}", "a kinid.Model",
                         "pass model=kinid.Model('kelvin-voigt', …)")  # fmt: skip
    if isinstance(data, Fit):
        model, experiment = data.model, widest(data.experiment, data.model)
        known = {name: p.value for name, p in data.parameters.items()}
    elif model is None:
        raise InputError("a log without a model", "both", "pass model=kinid.Model(…), or a fit")
    else:
        experiment, known = experiment_of(data, rig, model), {}
    add = one_by_one(add, model)
    refuse_names(add, model, max_effects)
    refuse_effort(effort)
    refuse_idle(add, model, experiment)
    refuse_log(experiment, model)
    refuse_outliers(experiment)
    give_back()
    data_doubts = check_excitation(model, experiment)
    refuse_signs(experiment, model)
    # many small products: threads of a linear-algebra library would only wait for each other
    with threadpool_limits(1, user_api="blas"):
        looked = _look(model, experiment, _start(model, experiment, known), max_effects, tuple(add), effort, progress)
        looked = dataclasses.replace(looked, doubts=tuple(data_doubts))
        return looked.result(progress)


def widest(experiment: Experiment, model: Model) -> Experiment:
    """All channels of the log that an experiment came from."""
    touch = experiment.touch
    if experiment.layout.kind != "contact" or touch is None:
        return experiment
    return experiment_of(touch, None, model)


def experiment_of(data: ContactSeries | Log, rig: Rig | None, model: Model) -> Experiment:
    """Every channel of a log that this model speaks about: joint torques, the whole wrench, or contact forces."""
    if isinstance(data, Log):
        rig = rig_of(data, rig, "diagnose(log, rig, model=…)")
        if "joints" in model.needs:
            return from_joint_torques(data, rig)
        if data.wrench is not None and data.q is not None and rig.robot is not None:
            return from_wrench(data, rig)
        data = contact_series(data, rig)
    elif data.source is not None and "joints" not in model.needs:
        log, rig = data.source
        if log.wrench is not None and log.q is not None and rig.robot is not None:
            return from_wrench(log, rig)
    slides = [f"tangential_force{i}" for i in (1, 2) if np.isfinite(getattr(data, f"tangential_force{i}")).any()
              and np.isfinite(getattr(data, f"slip_rate{i}")).any()]  # fmt: skip
    return from_contact(data, tuple(dict.fromkeys([*contact_channels(model, data), *slides])))


def _start(model: Model, experiment: Experiment, known: dict[str, float]) -> Array:
    named = model.parameters(experiment.layout)
    values, _ = starting_values(model, experiment, named, {k: v for k, v in known.items() if k in named})
    return values


def _look(model: Model, experiment: Experiment, values: Array, most: int, forced: tuple[str, ...], times: float,
          progress: Callable[[str], None]) -> Found:  # fmt: skip
    # white noise alone: what is slower is for effects to explain
    readings = experiment.measured[:, experiment.valid]
    white = np.array([force_noise(channel) for channel in readings])
    # readings that were smoothed or repeated show none: no reading is believed to its last digits
    least = DIGITS * np.sqrt(np.mean(readings**2, axis=1)) + 1e-12
    s = experiment.signals
    if len(s) > 1 and float(np.median(np.diff(s.t))) >= STATIC_PERIOD:
        # from pose to pose everything changes: neighbours tell nothing of noise
        white = np.minimum(white, STATIC_NOISE * np.sqrt(np.mean(readings**2, axis=1)))
    # a channel that never changes shows no noise, but was not measured without any
    white = as_their_like(white, np.ptp(readings, axis=1) == 0.0, s.layout.units)
    whole = dataclasses.replace(experiment, noise=np.maximum(white, least))
    progress("fitting the model")
    state = _fitted(model, thin(whole), values)
    progress("looking for marks in the samples")
    cleaned = detect(whole, model.names, model.predict(whole.signals, state.values))
    marked = tuple(mark.effect.id for mark in cleaned.marks)
    if cleaned.marks:
        state = _fitted(model, thin(cleaned.experiment), state.values)
    effort = Effort(times=times)
    for again in range(RECONSIDERED + 1):
        found = search(state, effort, most=max(0, most - len(marked)), forced=[n for n in forced if n not in marked],
                       progress=progress)  # fmt: skip
        weighted = reweighted(state, found) if again < RECONSIDERED and not found.spent else None
        if weighted is None:
            break
        progress("what was found carries more noise: looking again")
        state, effort = weighted, effort.once_more()
    return Found(model, whole, cleaned, found.end, forced)


def _fitted(model: Model, experiment: Experiment, values: Array) -> State:
    """The model fitted, from the values and from what its base law calls worth starting from."""
    values = settled(Problem.build(experiment, model, values), model, values)
    problem = Problem.build(experiment, model, values)
    rough = fit(problem, model, values)
    if rough.cost > NEAR_NOISE * len(rough.residual):
        starts = _other_starts(model, experiment, rough.values)
        for other in side_by_side(lambda start: fit(problem, model, settled(problem, model, start)), starts):
            if other.cost < LOWER * rough.cost:
                rough = other
    for _ in range(TAKEN_UP):  # noise of positions on its way through the model is that of the fit
        rough = fit(Problem.build(experiment, model, rough.values), model, rough.values, shift=rough.shift)
        if rough.converged:
            break
    return rough


def _other_starts(model: Model, experiment: Experiment, values: Array) -> list[Array]:
    """The same values with other shapes of the base law, its linear parameters as they are at half the greatest depth."""
    base = next((effect for effect in model.effects if effect.base), None)
    if base is None or not base.grid:
        return []
    named = list(model.parameters(experiment.layout))
    places = [named.index(f"{base.id}.{p.name}") for p in base.parameters(experiment.layout)]
    out = []
    for point in base.starts(experiment.signals):
        start = values.copy()
        start[places] = point
        out.append(start)
    return out
