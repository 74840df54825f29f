"""From what detectors and search found to a diagnosis: the ladder of errors, what is left, and a verdict for every effect."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from kinid import effects
from kinid.diagnosis.belief import told_of_calibration, trusted_to
from kinid.diagnosis.candidates import base_of
from kinid.diagnosis.descent import State
from kinid.diagnosis.detectors import Cleaned, Mark
from kinid.diagnosis.intervals import covariance, fitted, open_parameters, unsized
from kinid.diagnosis.look import ENOUGH, NEARER
from kinid.diagnosis.noise import period_of
from kinid.diagnosis.problem import filled
from kinid.diagnosis.result import ADEQUATE, MISSING, UNEXPLAINED, Diagnosis, Step
from kinid.diagnosis.search import Search
from kinid.diagnosis.unexplained import OTHER_FORM, judge
from kinid.diagnosis.verdicts import ended, meaning, verdicts
from kinid.diagnosis.where import where
from kinid.diagnosis.words import with_rivals
from kinid.doubts import impossible, listed
from kinid.estimators.batch import Solution
from kinid.experiment import Experiment
from kinid.fit import Z95, Fit, FitError, FittedParameter, error_rows, error_unit, rms
from kinid.memory import give_back
from kinid.model import Model
from kinid.task import folds

Array = NDArray[np.float64]

#: a model that leaves more than so many times the noise of readings leaves open why
OPENLY = 2.0
#: of what was left out so many are named, the most promising
MOST_NAMED = 4


@dataclass(frozen=True, eq=False)
class Found:
    """What detectors and search found.

    Attributes:
        model: as it was asked about. whole: the experiment at the log's own rate.
        cleaned: what detectors made of it. search: what was added.
        forced: names that were added whatever the evidence. doubts: of the data.
    """

    model: Model
    whole: Experiment
    cleaned: Cleaned
    search: Search
    forced: tuple[str, ...]
    doubts: tuple[str, ...] = ()

    @property
    def marks(self) -> tuple[Mark, ...]:
        """What stands in the samples themselves."""
        return self.cleaned.marks

    @cached_property
    def rows(self) -> NDArray[np.bool_]:
        """Channels that errors are told of, (channels,)."""
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
        """Error on the samples that a state was fitted to."""
        measured = filled(self.whole)
        return self.error(measured - self.readings(state, state.plain.values, marks))

    def result(self, progress: Callable[[str], None]) -> Diagnosis:
        """The diagnosis: errors step by step, what is left and where, a verdict for every effect, and the model as a fit."""
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
        if opinion.unexplained and self.search.left_out:
            verdict, says = UNEXPLAINED, f"not searched further: {ended(self.search)}; {opinion.left_says}"
        elif opinion.unexplained:
            verdict, says = UNEXPLAINED, opinion.says + self._nearest(last)
        elif real:
            how = f"explain{'s' if len(real) == 1 else ''} {'most of ' if opinion.left.rms > OTHER_FORM else ''}it"
            verdict, says = MISSING, f"{' and '.join(with_rivals(real, told))} {how}: {opinion.says}"
            says += "".join(f"; {words}" for words in (meaning(e) for e in told if e.id in real) if words)
            if steps[-1].held_out > OPENLY * opinion.left.rms * floor:
                says += f"; of the {steps[-1].held_out:.2g} {error_unit(self.whole)} the most is from {self._hides}"
        else:
            verdict, says = ADEQUATE, opinion.says
        if idle:
            trusted = all(trusted_to(effects.get(name), self.whole.layout) for name in idle)
            brings = "lies inside what calibration is trusted to" if trusted else "brings nothing that chance wouldn't"
            says += f"; {' and '.join(idle)}, added because it was asked for, {brings}"
        warnings = self._warnings
        if verdict == ADEQUATE and steps[-1].held_out > OPENLY * floor:
            times = steps[-1].held_out / floor
            warnings += (f"the held-out error is {times:.1f} times the noise of single readings: adequate only because "
                         f"{self._hides}, calibration or a tool that has left make that much open",)  # fmt: skip
        progress("where the error sits")
        give_back()
        sits = where(self.whole, before, self._noise)
        return Diagnosis(
            self.model, best, verdict, says, added, tuple(steps), floor, error_unit(self.whole),
            sits, where(self.whole, after, self._noise) if rungs else sits, told, self.whole, before, after, result, warnings,
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

    @property
    def _hides(self) -> str:
        """What a held-out error may hold beside the noise of readings, in words."""
        steps, unit = self.cleaned.experiment.steps, error_unit(self.whole)
        if steps is None:
            return "noise of positions"
        return f"rounding ({rms(steps[self.rows] / np.sqrt(12.0)):.2g} {unit} of a perfect model) or noise of positions"

    @cached_property
    def _variance(self) -> Array:
        """Covariance of the last model's parameters, (p, p)."""
        return covariance(self.search.states[-1])

    @cached_property
    def _estimates(self) -> dict[str, FittedParameter]:
        """The last model's parameters with intervals."""
        return fitted(self.search.states[-1], self._variance)

    @cached_property
    def _warnings(self) -> tuple[str, ...]:
        out = list(self.doubts)
        phase = self.whole.phase
        if phase is not None and len(np.unique(phase)) == 1:
            out.append(f"the whole log is one phase, {phase[0]}: effects of the others can't be seen; record approach, hold, "
                       "motion and retraction")  # fmt: skip
        last = self.search.states[-1]
        out += impossible(last.model.parameters(self.whole.layout), last.plain.values, self._variance)
        if base_of(self.model) is None and self.whole.layout.kind != "joints" and self.whole.in_contact.any():
            every = map(effects.get, effects.catalogue())
            laws = ", ".join(effect.id for effect in every if effect.base and "normal" in effect.needs)
            out.append(f"the log holds contact, and the model has no contact law: ask about one of {laws}")
        out += filter(None, [told_of_calibration(last)])
        for name in self.search.added:
            sure = self.search.evidence[name].sure
            beside = unsized(last, name, self._estimates, self._variance) if sure else None
            if beside is not None:
                why = f": it hangs on {listed(beside)}" if beside else ""
                out.append(f"{name} is there, but its size isn't known{why}")
        if self.search.spent and self.search.left_out:
            names, more = ", ".join(self.search.left_out[:MOST_NAMED]), len(self.search.left_out) - MOST_NAMED
            names += f" and {more} more" if more > 0 else ""
            out.append(f"{ended(self.search)} before it tried {names}: try the first with --add {self.search.left_out[0]}, "
                       "or allow four times the work: --effort 4")  # fmt: skip
        if not self.search.states[-1].converged:
            out.append("the last search stopped before it converged: its parameters may be off")
        usable = self.whole.valid if self.whole.touch is None else self.whole.touch.valid
        share = float(np.mean(~usable))
        if share > 0.05:
            out.append(f"{100 * share:.0f} % of the samples are invalid and were left out")
        return tuple(out)

    def _fit(self, best: Model, last: State, step: Step) -> Fit:
        """The best model as a fit: values, intervals, errors."""
        estimates, variance = dict(self._estimates), self._variance
        named = best.parameters(self.whole.layout)
        marked = {f"{m.effect.id}.{p.name}": (float(v), Z95 * float(e)) for m in self.marks
                  for p, v, e in zip(m.effect.parameters(self.whole.layout), m.values, np.zeros_like(m.values)
                                     if m.error is None else m.error)}  # fmt: skip
        parameters, values = {}, []
        for name, p in named.items():
            if name not in estimates:
                value, wide = marked[name]
                estimates[name] = FittedParameter(name, value, value - wide, value + wide, p.unit)
            parameters[name] = estimates[name]
            values.append(estimates[name].value)
        place = [i for i, name in enumerate(named) if name not in marked]
        cov = np.zeros((len(values), len(values)))
        cov[np.ix_(place, place)] = variance
        for i, name in enumerate(named):
            if name in marked:
                cov[i, i] = (marked[name][1] / Z95) ** 2
        open_ = np.zeros(len(values), np.bool_)
        open_[place] = open_parameters(last)
        bound = np.zeros(len(values), np.bool_)
        bound[place] = ~last.free[: len(last.values)]
        measured = filled(self.whole)
        residual = measured - self.readings(last, last.plain.values, self.marks)
        unit = error_unit(self.whole)
        solution = Solution(np.array(values), cov, open_, bound, residual, float("nan"), (), 0, last.converged)
        return Fit(best, parameters, FitError(step.train, step.held_out, rms(self._noise[self.rows]), unit), self._warnings,
                   solution, self.whole, np.zeros(len(self.whole.measured)))  # fmt: skip
