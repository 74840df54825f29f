"""From a fit to a diagnosis: detectors first, then the search, then what is left, then a verdict for every effect."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from threadpoolctl import threadpool_limits

from kinid import effects
from kinid.contact import ContactSeries, contact_series, force_noise
from kinid.diagnosis.candidates import able, base_of
from kinid.diagnosis.descent import State, fit
from kinid.diagnosis.detectors import Cleaned, Mark, detect
from kinid.diagnosis.intervals import covariance, fitted, open_parameters
from kinid.diagnosis.look import ENOUGH, NEARER
from kinid.diagnosis.noise import as_their_like, period_of
from kinid.diagnosis.problem import Problem, filled, thin
from kinid.diagnosis.result import ADEQUATE, MISSING, UNEXPLAINED, Diagnosis, Step
from kinid.diagnosis.search import Search, search
from kinid.diagnosis.unexplained import OTHER_FORM, judge
from kinid.diagnosis.verdicts import verdicts
from kinid.diagnosis.where import where
from kinid.diagnosis.words import with_rivals
from kinid.doubts import DEEPEST, DEPTH_UNIT, TURN, TURN_DEPTH, TURN_TANGENTIAL, drives, impossible, turned, turned_depth
from kinid.errors import InputError
from kinid.estimators.batch import Solution
from kinid.experiment import Experiment, from_contact, from_joint_torques, from_wrench
from kinid.fit import (
    Fit,
    FitError,
    FittedParameter,
    check_excitation,
    contact_channels,
    error_rows,
    error_unit,
    rig_of,
    rms,
    starting_values,
)
from kinid.log import Log
from kinid.memory import give_back
from kinid.model import Model
from kinid.motion import STATIC_PERIOD
from kinid.rig import Rig
from kinid.task import folds

Array = NDArray[np.float64]

#: a log must last so long [s], and hold so many blocks of half a second that count
SHORTEST, FEWEST_BLOCKS = 4.0, 8
#: share of a channel's own size that noise of static poses is taken to be at most
STATIC_NOISE = 0.01
#: share of a channel's own size below which noise is not believed to lie
DIGITS = 1e-3
#: how often a search begins anew with noise carried through what it found, where that leaves less than this share of the squares
RECONSIDERED, TOLD = 2, 0.97
#: … of logs with no more readings than this, in means
LONG = 60_000
#: models that leave less than so many times the least error are about as near
NEAREST = 1.2
#: an adequate model that leaves more than so many times the noise is doubted
OPENLY = 2.0
#: effects that are added at most, unless the caller says otherwise
MOST_EFFECTS = 4


def diagnose(
    data: Fit | ContactSeries | Log,
    rig: Rig | None = None,
    *,
    model: Model | None = None,
    add: Sequence[str] = (),
    max_effects: int = MOST_EFFECTS,
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
    if max_effects < 0:
        raise InputError(f"max_effects of {max_effects}", "0 or more", "0 compares and adds nothing")
    _check_asked_for(add, model, experiment)
    _refuse(experiment, model)
    give_back()
    data_doubts = check_excitation(model, experiment)
    lowest = turned(experiment) if "normal" in model.needs else None
    if lowest is not None:
        raise InputError(f"a normal force that falls to {lowest:.3g} N as the tool goes deeper",
                         "one that is positive where the material pushes the tool out", TURN)  # fmt: skip
    along = drives(experiment) if "slip" in model.needs else None
    if along is not None:
        raise InputError(f"a tangential force that points along the slip, by {along:.3g} N",
                         "what the surface does to the tool, against the slip", TURN_TANGENTIAL)  # fmt: skip
    outside = turned_depth(experiment) if "normal" in model.needs else None
    if outside is not None:
        raise InputError(f"a force of {outside:.3g} N where the depth is negative, and next to none inside",
                         "a depth that is positive inside the material", TURN_DEPTH)  # fmt: skip
    # many small products: threads of a linear-algebra library would only wait for each other
    with threadpool_limits(1, user_api="blas"):
        looked = _look(model, experiment, _start(model, experiment, known), max_effects, tuple(add), progress)
        looked = dataclasses.replace(looked, doubts=tuple(data_doubts))
        return looked.result(progress)


def _check_asked_for(add: Sequence[str], model: Model, experiment: Experiment) -> None:
    """Each joins the model with those before it, and can act in this log."""
    for name in add:
        why = {effect.id: why for effect, why in able(model, experiment.layout)}
        model = model + effects.get(name)
        if why.get(name):
            raise InputError(f"effect '{name}', and {why[name]}", "an effect that can act in this log", "leave it out")


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


def _refuse(experiment: Experiment, model: Model) -> None:
    s = experiment.signals
    if not experiment.valid.any():
        raise InputError("no sample with all of its channels", "readings that are numbers", "check the log's columns")
    span = float(np.ptp(s.t[experiment.valid]))
    if span < SHORTEST:
        raise InputError(f"{span:.3g} s of log", f"{SHORTEST:g} s at least, to hold half of it out in blocks of half a second",
                         "record several pokes, with holds and slides between them")  # fmt: skip
    blocks = len(np.unique((s.t[experiment.valid] / 0.5).astype(int)))
    if blocks < FEWEST_BLOCKS:
        raise InputError(f"{blocks} blocks of half a second with readings", f"{FEWEST_BLOCKS} at least",
                         "record for longer, or find out why so many samples are invalid")  # fmt: skip
    if "normal" in model.needs and s.layout.kind != "joints" and not (s.depth[experiment.valid] > 0).any():
        raise InputError(f"a depth that is never positive, for {model}", "samples inside the material",
                         "check [surface] of the rig, or ask about --model none")  # fmt: skip
    deep = float(s.depth[experiment.valid].max()) if "normal" in model.needs and s.layout.kind == "contact" else 0.0
    if deep > DEEPEST:
        raise InputError(f"depths of up to {deep:.3g} m", "metres inside the material", f"say so {DEPTH_UNIT}")


def _start(model: Model, experiment: Experiment, known: dict[str, float]) -> Array:
    named = model.parameters(experiment.layout)
    values, _ = starting_values(model, experiment, named, {k: v for k, v in known.items() if k in named})
    return values


@dataclass(frozen=True, eq=False)
class _Looked:
    """What detectors and search found, before it is put into words."""

    model: Model
    whole: Experiment
    cleaned: Cleaned
    search: Search
    forced: tuple[str, ...]
    doubts: tuple[str, ...] = ()

    @property
    def marks(self) -> tuple[Mark, ...]:
        return self.cleaned.marks

    @cached_property
    def rows(self) -> NDArray[np.bool_]:
        return error_rows(self.whole)

    def readings(self, state: State, values: Array, marks: Sequence[Mark]) -> Array:
        """What a state expects at the log's own rate, with marks that were found in the samples, (channels, n)."""
        predicted = state.model.predict(self.whole.signals, values)
        for mark in marks:
            if mark.effect.id == "saturation":
                limits = mark.values[:, None]
                predicted = self.whole.as_true(np.clip(self.whole.as_read(predicted), -limits, limits))
            elif mark.effect.id == "mains-hum":
                predicted = predicted + self.cleaned.hum
        return self.whole.in_band(predicted)

    def held_out(self, state: State, marks: Sequence[Mark]) -> Array:
        """Residual of each half from parameters that fit the other, at the log's own rate, (channels, n)."""
        even = folds(self.whole)
        from_even, from_odd = state.halves
        out = filled(self.whole)
        for half, values in ((even, from_odd), (~even, from_even)):
            out[:, half] -= self.readings(state, values, marks)[:, half]
        out[:, ~self.whole.valid] = np.nan
        return out

    def error(self, residual: Array) -> float:
        """Root mean square over the forces of valid samples."""
        return rms(residual[self.rows][:, self.whole.valid])

    def train(self, state: State, marks: Sequence[Mark]) -> float:
        measured = filled(self.whole)
        return self.error(measured - self.readings(state, state.plain.values, marks))

    def result(self, progress: Callable[[str], None]) -> Diagnosis:
        progress("measuring errors")
        states = self.search.states
        first, last = states[0], states[-1]
        before = self.held_out(first, ())
        errors = [self.error(before)]
        rungs: list[tuple[str, Sequence[Mark], State, float]] = []
        ladder = list(self._order())
        for name, marks, state in ladder:
            rungs.append((name, marks, state, self.error(self.held_out(state, marks))))
        after = before if not rungs else self.held_out(last, self.marks)
        added = tuple(name for name, _, _, _ in rungs)
        best = self._best(last)
        steps = [Step(None, self.model.names, self.train(first, ()), errors[0])]
        names = list(self.model.names)
        for name, marks, state, error in rungs:
            names.append(name)
            steps.append(Step(name, tuple(names), self.train(state, marks), error))
        gains = {step.added: steps[i].held_out - step.held_out for i, step in enumerate(steps[1:]) if step.added}
        gains |= {name: gain for name, gain in self._gains(errors[0]).items() if name not in gains}
        progress("looking at what is left")
        opinion = judge(first, last)
        result = self._fit(best, last, steps[-1])
        progress("a verdict for every effect")
        told = verdicts(self.search, self.marks, result.parameters, gains, self._rate, tuple(self.forced))
        floor = rms(self._noise[self.rows])
        idle = [name for name in self.forced if name in self.search.evidence and not self.search.evidence[name].sure]
        real = [name for name in added if name not in idle]
        if opinion.unexplained and self.search.cut_short:
            verdict, says = UNEXPLAINED, f"not searched further: no more effects were asked for; {opinion.left_says}"
        elif opinion.unexplained:
            verdict, says = UNEXPLAINED, opinion.says + self._nearest(last)
        elif real:
            how = f"explain{'s' if len(real) == 1 else ''} {'most of ' if opinion.left.rms > OTHER_FORM else ''}it"
            verdict, says = MISSING, f"{' and '.join(with_rivals(real, told))} {how}: {opinion.says}"
        else:
            verdict, says = ADEQUATE, opinion.says
        if idle:
            says += f"; {' and '.join(idle)}, added because it was asked for, brings nothing that chance wouldn't"
        warnings = self._warnings()
        if verdict == ADEQUATE and steps[-1].held_out > OPENLY * floor:
            times = steps[-1].held_out / floor
            warnings += (f"the held-out error is {times:.1f} times the noise of single readings: adequate only because noise "
                         "of positions, calibration or a tool that has left make that much open",)  # fmt: skip
        progress("where the error sits")
        give_back()
        return Diagnosis(
            self.model, best, verdict, says, added, tuple(steps), floor, error_unit(self.whole),
            where(self.whole, before, self._noise), where(self.whole, after, self._noise), told, self.whole, before, after,
            result, warnings,
        )  # fmt: skip

    def _nearest(self, last: State) -> str:
        """The effect that would help most of those that are not believed, in words; "" where none would."""
        latest = next((look for look in self.search.rounds if look.before is last), None)
        would = [t for t in (latest.tried if latest else ()) if t.evidence.value > ENOUGH and t.state.rms < NEARER * last.rms]
        if not would:
            return ""
        best = min(would, key=lambda t: t.state.rms)
        return (f"; {best.effect.id} comes nearest (what is left would be {best.state.rms:.2f} times the noise), "
                "but this log is no proof of it")  # fmt: skip

    def _order(self) -> list[tuple[str, Sequence[Mark], State]]:
        """Rungs: marks that lower the error and effects, those that take off most first."""
        states, added = self.search.states, self.search.added
        first, last = states[0], states[-1]
        marks = list(self.marks)
        if not marks:
            return [(name, (), state) for name, state in zip(added, states[1:])]
        base = self.error(self.held_out(first, ()))
        whole = self.error(self.held_out(last, ())) if added else base
        # how much each mark alone takes off, beside the effects that were found
        gain = {m.effect.id: base - self.error(self.held_out(first, (m,))) for m in marks}
        loud = [m for m in marks if gain[m.effect.id] > base - whole or not added]
        quiet = [m for m in marks if m not in loud]
        out: list[tuple[str, Sequence[Mark], State]] = []
        seen: list[Mark] = []
        for mark in sorted(loud, key=lambda m: -gain[m.effect.id]):
            seen.append(mark)
            out.append((mark.effect.id, tuple(seen), first))
        out += [(name, tuple(seen), state) for name, state in zip(added, states[1:])]
        for mark in quiet:
            seen.append(mark)
            out.append((mark.effect.id, tuple(seen), last))
        return out

    def _best(self, last: State) -> Model:
        best = last.model
        for mark in self.marks:
            best = best + mark.effect
        return best

    def _gains(self, before: float) -> dict[str, float]:
        """By how much effects that were tried lower the error; noise above the band of motion stays as it is."""
        first = self.search.states[0]
        out = {}
        for tried in (t for look in self.search.rounds[:1] for t in look.tried):
            rows = np.repeat(self.rows, int(first.problem.valid.sum()))
            weight = first.problem.sigma[:, first.problem.valid].ravel()[rows]
            fell = float(np.mean((first.held[rows] * weight) ** 2) - np.mean((tried.state.held[rows] * weight) ** 2))
            out[tried.effect.id] = before - float(np.sqrt(max(0.0, before**2 - fell)))
        return out

    @property
    def _rate(self) -> float:
        return 1.0 / period_of(self.whole.signals)

    @property
    def _noise(self) -> Array:
        """White noise of each channel in the band that counts, (channels,)."""
        band = self.whole.band
        share = 1.0 if band is None else np.sqrt(min(1.0, 2.0 * band / self._rate))
        hums = any(mark.effect.id == "mains-hum" for mark in self.marks)
        noise = np.minimum(self.whole.noise, self.cleaned.experiment.noise) if hums else self.whole.noise
        out: Array = noise * share
        return out

    def _warnings(self) -> tuple[str, ...]:
        out = list(self.doubts)
        phase = self.whole.phase
        if phase is not None and len(np.unique(phase)) == 1:
            out.append(f"the whole log is one phase, {phase[0]}: effects of the others can't be seen; record approach, hold, "
                       "motion and retraction")  # fmt: skip
        last = self.search.states[-1]
        out += impossible(last.model.parameters(self.whole.layout), last.plain.values, covariance(last))
        if base_of(self.model) is None and self.whole.layout.kind != "joints" and self.whole.in_contact.any():
            laws = ", ".join(name for name in effects.catalogue() if effects.get(name).base)
            out.append(f"the log holds contact, and the model has no contact law: ask about one of {laws}")
        if not self.search.states[-1].converged:
            out.append("the last search stopped before it converged: its parameters may be off")
        usable = self.whole.valid if self.whole.touch is None else self.whole.touch.valid
        share = float(np.mean(~usable))
        if share > 0.05:
            out.append(f"{100 * share:.0f} % of the samples are invalid and were left out")
        return tuple(out)

    def _fit(self, best: Model, last: State, step: Step) -> Fit:
        """The best model as a fit: values, intervals, errors."""
        estimates, variance = fitted(last), covariance(last)
        named = best.parameters(self.whole.layout)
        marked = {f"{m.effect.id}.{p.name}": float(v) for m in self.marks
                  for p, v in zip(m.effect.parameters(self.whole.layout), m.values)}  # fmt: skip
        parameters, values = {}, []
        for name, p in named.items():
            value = estimates[name].value if name in estimates else marked[name]
            parameters[name] = estimates[name] if name in estimates else FittedParameter(name, value, value, value, p.unit)
            values.append(value)
        place = [i for i, name in enumerate(named) if name in estimates]
        cov = np.zeros((len(values), len(values)))
        cov[np.ix_(place, place)] = variance
        open_ = np.zeros(len(values), np.bool_)
        open_[place] = open_parameters(last)
        bound = np.zeros(len(values), np.bool_)
        bound[place] = ~last.free[: len(last.values)]
        measured = filled(self.whole)
        residual = measured - self.readings(last, last.plain.values, self.marks)
        unit = error_unit(self.whole)
        solution = Solution(np.array(values), cov, open_, bound, residual, float("nan"), (), 0, last.converged)
        return Fit(best, parameters, FitError(step.train, step.held_out, rms(self._noise[self.rows]), unit), self._warnings(),
                   solution, self.whole, np.zeros(len(self.whole.measured)))  # fmt: skip


def _look(model: Model, experiment: Experiment, values: Array, most: int, forced: tuple[str, ...],
          progress: Callable[[str], None]) -> _Looked:  # fmt: skip
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
    state = _fitted(model, thin(cleaned.experiment), state.values)
    for again in range(RECONSIDERED + 1):
        found = search(state, most=max(0, most - len(marked)), forced=[n for n in forced if n not in marked], progress=progress)
        weighted = _reweighted(state, found) if again < RECONSIDERED else None
        if weighted is None:
            break
        progress("what was found carries more noise: looking again")
        state = weighted
    return _Looked(model, whole, cleaned, found, forced)


def _reweighted(state: State, found: Search) -> State | None:
    """The model as it was asked about, where noise of positions goes through the last model of a search, or the nearest that
    it met (the simplest of those about as near); None where neither tells more of what is left.

    Friction that turns at once makes of a micrometre what a softer reversal would never show; a law may pull elsewhere.
    """
    if state.problem.experiment.layout.kind == "joints" or len(state.residual) > LONG:
        return None  # no noise of positions is carried; or it would take too long
    last = found.states[-1]
    met = (last, *(t.state for look in found.rounds for t in look.tried))
    near = NEAREST * min(s.rms for s in met)
    nearest = min((s for s in met if s.rms <= near), key=lambda s: (len(s.values), s.rms))
    # through what was asked about, noise was carried already
    for through in (s for s in dict.fromkeys((last, nearest)) if s.model is not state.model):
        carried = Problem.build(state.problem.experiment, through.model, through.plain.light().values)
        less = through.residual * (state.problem.sigma / carried.sigma)[:, carried.valid].ravel()
        if float(less @ less) < TOLD * float(through.residual @ through.residual):
            return fit(carried, state.model, state.values)
    return None


def _fitted(model: Model, experiment: Experiment, values: Array) -> State:
    """The model fitted, from the values and from what its base law calls worth starting from."""
    rough = fit(Problem.build(experiment, model, values), model, values)
    for start in _other_starts(model, experiment, rough.values):
        other = fit(rough.problem, model, start)
        if other.cost < 0.98 * rough.cost:
            rough = other
    return fit(Problem.build(experiment, model, rough.values), model, rough.values)


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
