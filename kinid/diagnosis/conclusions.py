"""From what the stages found to a diagnosis: the path of errors, what is left and where, verdicts."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from kinid import effects
from kinid.diagnosis.detectors import Mark, marked
from kinid.diagnosis.pipeline import Found
from kinid.diagnosis.result import Diagnosis, EffectVerdict, Step, Verdict, with_alternatives
from kinid.diagnosis.settings import DiagnosisSettings
from kinid.diagnosis.verdicts import verdicts
from kinid.identification.fit import Fit, fit_model, fit_of
from kinid.identification.lack_of_fit import LackOfFit, error_rows, error_unit, lack_of_fit, rms
from kinid.identification.solver import search
from kinid.identification.state import State
from kinid.identification.warnings import listed
from kinid.identification.whole import held_out_residual, train_residual
from kinid.modeling.applicability import base_of
from kinid.modeling.model import Model
from kinid.residuals.localization import where

Array = NDArray[np.float64]

#: errors that differ by a smaller share are the same [1]
SAME_ERROR = 5e-3
#: name, state and marks after each addition
ModelPath = list[tuple[str, State, tuple[Mark, ...]]]


class Conclusions:
    """What follows from what was found."""

    def __init__(self, found: Found, settings: DiagnosisSettings, tolerance: float | None) -> None:
        self.found, self.settings, self.tolerance = found, settings, tolerance
        self.whole, self.rows = found.whole, error_rows(found.whole)
        self.unit = error_unit(found.whole)

    def diagnosis(self, progress: Callable[[str], None], warnings: Sequence[str]) -> Diagnosis:
        """The whole of it."""
        found = self.found
        progress("measuring errors")
        before = self.held_out(found.plain, ())
        path = self._path()
        last, marks = (path[-1][1], path[-1][2]) if path else (found.plain, ())
        after = self.held_out(last, marks) if path else before
        left = lack_of_fit(last, after, self.tolerance)
        steps = self._steps(before, path, left.noise)
        fit = self._fit(last, steps[-1])
        gains = self._gains(steps)
        findings = verdicts(found, fit.parameters, gains, left, self.settings)
        verdict, says = self._verdict(steps, left, findings)
        progress("where the error sits")
        noise = self.whole.noise
        doubts = [*warnings, *self._warnings(last), *(w for w in fit.warnings if "kinid diagnose" not in w)]
        corrected = _corrected(path)
        beyond = self.held_out(*path[len(corrected) - 1][1:]) if corrected else before
        sits = where(self.whole, beyond, noise)
        return Diagnosis(
            found.model,
            fit.model,
            verdict,
            says,
            tuple(step.added for step in steps if step.added),
            tuple(steps),
            left.noise,
            self.unit,
            findings,
            tuple(dict.fromkeys(doubts)),
            corrected,
            sits,
            where(self.whole, after, noise) if path else sits,
            left,
            self.whole,
            before,
            after,
            fit,
        )

    def held_out(self, state: State, marks: Sequence[Mark]) -> Array:
        """Residual of each fold from parameters of the other one, at the log's own rate, (channels, n)."""
        return held_out_residual(state, self.whole, lambda predicted: marked(predicted, marks, self.whole))

    def _train(self, state: State, marks: Sequence[Mark]) -> Array:
        return train_residual(state, self.whole, lambda predicted: marked(predicted, marks, self.whole))

    def _error(self, residual: Array) -> float:
        return rms(residual[self.rows][:, self.whole.valid])

    def _path(self) -> ModelPath:
        """The additions in their order: marks that lower the error, effects by their gain, other marks."""
        selection, marks = self.found.selection, self.found.cleaned.marks
        start, last = selection.states[0], selection.states[-1]
        out: ModelPath = []
        base = self._error(self.held_out(start, ()))
        visible = [
            m
            for m in marks
            if self._error(self.held_out(start, (m,))) < (1.0 - SAME_ERROR) * base or not selection.added
        ]
        for i, mark in enumerate(visible):
            out.append((mark.effect.id, start, tuple(visible[: i + 1])))
        done: list[str] = []
        while len(done) < len(selection.added):
            rest = [name for name in selection.added if name not in done]
            ready = [name for name in rest if not _waits(name, rest)] or rest
            states = {name: last if len(rest) == 1 else self._partial(start, last, [*done, name]) for name in ready}
            best = min(states, key=lambda name: self._error(self.held_out(states[name], visible)))
            done.append(best)
            out.append((best, states[best], tuple(visible)))
        hidden = [m for m in marks if m not in visible]
        return out + [(mark.effect.id, last, (*visible, *hidden[: i + 1])) for i, mark in enumerate(hidden)]

    def _partial(self, start: State, last: State, names: list[str]) -> State:
        """The model with some of the additions, from the values of all."""
        kept = {*start.model.names, *names}
        model = Model(*(effect for effect in last.model.effects if effect.id in kept))
        full = last.model.parameters(last.problem.layout)
        values = np.array([v for key, v in zip(full, last.values) if key.split(".", 1)[0] in model])
        return search(last.problem, model, values, start.error)

    def _steps(self, before: Array, path: ModelPath, noise: float) -> list[Step]:
        first, names = self._error(before), list(self.found.model.names)
        steps = [Step(None, tuple(names), self._error(self._train(self.found.plain, ())), first)]
        beyond = max(first**2 - noise**2, 1e-300)
        for name, state, marks in path:
            names.append(name)
            error = self._error(self.held_out(state, marks))
            explained = float(np.clip((first**2 - error**2) / beyond, 0.0, 1.0))
            steps.append(Step(name, tuple(names), self._error(self._train(state, marks)), error, explained))
        return steps

    def _fit(self, last: State, step: Step) -> Fit:
        """The best model as the fit that it is."""
        marks = self.found.cleaned.marks
        if not marks:
            return fit_of(last, self.whole)
        best = last.model
        for mark in marks:
            best = best + mark.effect
        known = dict(zip(last.model.parameters(self.whole.layout), last.values.tolist()))
        return fit_model(best, self.whole, start=known)

    def _gains(self, steps: Sequence[Step]) -> dict[str, float]:
        """By how much additions, and effects that were refitted in the first round, lower the held-out error."""
        out = {step.added: steps[i].held_out - step.held_out for i, step in enumerate(steps[1:]) if step.added}
        first = steps[0].held_out
        for refit in (t for look in self.found.selection.rounds[:1] for t in look.refits):
            fell = float(
                np.mean(self.found.selection.rounds[0].before.held_out[self.rows] ** 2)
                - np.mean(refit.state.held_out[self.rows] ** 2)
            )
            out.setdefault(refit.effect.id, first - float(np.sqrt(max(0.0, first**2 - fell))))
        return out

    def _verdict(self, steps: list[Step], left: LackOfFit, findings: Sequence[EffectVerdict]) -> tuple[Verdict, str]:
        """Adequate, missing or unexplained, and why, in words."""
        idle = self.found.selection.unsupported
        added = [step.added for step in steps if step.added and step.added not in idle]
        allowed, take = f"{left.tolerance:.2g} {left.unit} may be", "takes" if len(added) == 1 else "take"
        remains = (
            f"{left.excess:.2g} {left.unit} are left beside noise, {100 * left.share_of_reading:.2g} % of the reading"
        )
        names = listed(with_alternatives(added, findings))
        helped = f"{names} {take} off {100 * steps[-1].explained:.0f} % of the error"
        inside = "what is left is noise" if left.excess < 0.5 * left.noise else f"{remains}; {allowed}"
        if left.matters:
            verdict = Verdict.UNEXPLAINED
            more = listed([e.id for e in findings if e.left_out])
            left_out = f"no more effects were asked for, and {more} would take off more"
            says = f"{remains}, where {allowed}; "
            says += left_out if more else "no further effect of the catalogue takes off what chance wouldn't"
            if added:
                says = f"{helped}; {says}"
        elif added:
            verdict = Verdict.MISSING
            says = f"{helped}; {inside}"
            values = {e.id: {name: p.value for name, p in e.parameters.items()} for e in findings if e.id in added}
            says += "".join(f"; {words}" for name, own in values.items() if (words := effects.get(name).meaning(own)))
        else:
            verdict, says = Verdict.ADEQUATE, inside
        for name in idle:
            why = self.found.selection.unsupported[name]
            says += f"; {name}, added because it was asked for, {why}"
        return verdict, says

    def _warnings(self, last: State) -> list[str]:
        out, phase = [], self.whole.phase
        if phase is not None and len(np.unique(phase)) == 1:
            out.append(
                f"the whole log is one phase, {phase[0]}: effects of the others can't be seen; record approach, hold, "
                "motion and retraction"
            )
        if base_of(self.found.model) is None and self.whole.layout.kind != "joints" and self.whole.in_contact.any():
            every = map(effects.get, effects.catalogue())
            laws = ", ".join(effect.id for effect in every if effect.base and "normal" in effect.needs)
            out.append(f"the log holds contact, and the model has no contact law: ask about one of {laws}")
        valid = self.whole.valid if self.whole.touch is None else self.whole.touch.valid
        share = float(np.mean(~valid))
        if share > 0.05:
            out.append(f"{100 * share:.0f} % of the samples are invalid and were left out")
        if len(self.found.selection.added) >= self.settings.max_effects > 0:
            out.append("no more effects were asked for: --max-effects allows more")
        return out


def _waits(name: str, rest: Sequence[str]) -> bool:
    """Whether an effect acts on another one, or holds another one, that isn't in the model yet."""
    effect = effects.get(name)
    return bool({*effect.requires, *effect.includes} & (set(rest) - {name}))


def _corrected(path: ModelPath) -> tuple[str, ...]:
    """What comes first on the path and is every log's own; nothing where nothing else follows."""
    own = tuple(name for name, _, _ in itertools.takewhile(lambda step: effects.get(step[0]).per_log, path))
    return own if len(own) < len(path) else ()
