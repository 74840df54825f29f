"""Whether an addition is believed: evidence that chance doesn't explain, a size that matters, and nothing simpler behind it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from kinid.diagnosis.calibration import BIAS_FORCE, BIAS_TORQUE, CLOCK, SURFACE
from kinid.diagnosis.candidates import amplitudes, base_of
from kinid.diagnosis.cores import side_by_side
from kinid.diagnosis.descent import State
from kinid.diagnosis.look import FAR_LESS, Evidence, Tried, weigh, worth
from kinid.diagnosis.problem import Problem
from kinid.doubts import MATERIAL, negative
from kinid.effects import Effect, Layout
from kinid.fit import error_rows, error_unit

#: an addition that leaves the weighted error counts where the log's own falls by this share, calibration as it was stated, and
#: evidence is beyond what calibration leaves
LIGHTER, STRONG = 0.015, 100.0
#: and every addition must lower it by this share: means tell of less, but only of errors that nobody sees
LIGHTEST = 0.003
#: a bias beyond calibration's tolerance is told where the log's own error falls by this share without it
BIAS, OPEN = "sensor-bias", 0.05
#: of readings that are stairs, what leaves less than this share of the noise lacks nothing that they could show
CALM = 0.5
#: … and what matters lowers by this share what is left of them as they were read, or most of what is left
SEEN = 0.005
#: what calibration a little beyond its tolerance explains within so much evidence is not called physics
DOUBTED = 12.0

#: a stiffness or damping counts as negative, which no material is, beyond so many standard errors and so much of its scale
CHANCE, SMALL = 5.0, 0.25
#: an amplitude is usually no larger than so many of its scales
USUAL = 3.0

#: parameters below these are calibration, not physics, by unit
TOLERATED: dict[str, dict[str, float]] = {
    "surface-offset": {"m": 3 * SURFACE},
    "tip-offset": {"m": 2.5 * SURFACE},
    "time-offset": {"s": 4 * CLOCK},
    "sensor-lag": {"s": 4 * CLOCK},
    "sensor-bias": {"N": 2 * BIAS_FORCE, "N·m": 2 * BIAS_TORQUE},
}


def accepted(before: State, tried: Tried) -> bool:
    """Whether an addition is believed: evidence that chance doesn't explain, and a size that matters."""
    return (tried.evidence.sure and material(tried) and not at_end(tried) and possible(before, tried.state)
            and _matters(before, tried))  # fmt: skip


def possible(before: State, after: State) -> bool:
    """Whether no stiffness or damping turns negative beyond chance, by a size that matters: an effect that asks for that stands
    in for another one (a delay, most often), or for what the catalogue lacks.
    """
    return not _impossible(after) - _impossible(before)


def _impossible(state: State) -> set[str]:
    names = state.model.parameters(state.problem.experiment.layout)
    error = np.sqrt(np.maximum(np.diag(state.inverse)[: len(names)], 0.0))
    return set(negative(names, state.values, np.maximum(CHANCE * error, SMALL) * state.scale, kinds=MATERIAL))


def _matters(before: State, tried: Tried) -> bool:
    """Whether it takes enough off the weighted error; or, if calibration is no explanation, off the error as users see it."""
    coarse = before.problem.experiment.steps is not None
    if coarse and (before.rms < CALM or not _stands_as_read(before, tried)):
        return False
    if tried.state.rms < (1.0 - worth(before)) * before.rms:
        return coarse or _shows(before, tried.state)
    if tried.effect.id in TOLERATED or tried.evidence.value < STRONG:
        return False
    return shown_error(tried.state) < (1.0 - LIGHTER) * shown_error(before)


def _stands_as_read(before: State, tried: Tried) -> bool:
    """Whether it lowers what is left of stairs at their word, too; or so much of all else that they have no say: a channel that
    rests on one step is best foretold by a model that is wrong by less than a step.
    """
    return tried.evidence.left < FAR_LESS or tried.state.at_word < (1.0 - SEEN) * before.at_word


def _shows(before: State, after: State) -> bool:
    """Whether the log's own held-out error falls, of its forces or of its torques."""
    units = np.array(before.problem.experiment.layout.units)
    return any(shown_error(after, units == unit) < (1.0 - LIGHTEST) * shown_error(before, units == unit) for unit in set(units))


def shown_error(state: State, rows: NDArray[np.bool_] | None = None, *, exact: bool = False) -> float:
    """Held-out error in the unit of the readings, calibration as it was stated, noise of single samples and rounding included.

    Args:
        rows: channels that count, (channels,); those that users' errors are of, if None.
        exact: fit each half, as the errors that users see do.
    """
    rows = error_rows(state.problem.experiment) if rows is None else rows
    plain = state.plain.light()
    return _in_units(state.problem, rows, plain.apart if exact else plain.held)


def _in_units(problem: Problem, rows: NDArray[np.bool_], residual: NDArray[np.float64]) -> float:
    """Root mean square of these channels of a residual (m,), noise of single samples and rounding included."""
    sigma = problem.sigma[rows][:, problem.valid]
    held = residual.reshape(len(rows), -1)[rows]
    thinned = max(1.0, float(np.median(np.diff(problem.experiment.rows)))) if len(problem.experiment.rows) > 1 else 1.0
    averaged = np.mean(problem.experiment.noise[rows] ** 2) * (thinned - np.mean(1.0 / problem.count[problem.valid]))
    rounded = np.mean(problem.stairs[rows] ** 2) / 12.0
    return float(np.sqrt(np.mean((held * sigma) ** 2) + averaged + rounded))


def believed(before: State, tried: Sequence[Tried]) -> list[Tried]:
    """Those that are accepted, and that calibration a little beyond its tolerance doesn't explain as well."""
    side_by_side(lambda t: t.state.plain.light(), [t for t in tried if t.evidence.sure])  # most of the work, and remembered
    good = [t for t in tried if accepted(before, t)]
    calibration = [t.evidence.value for t in tried if t.effect.id in TOLERATED and t.evidence.sure and t not in good]
    doubt = max(calibration, default=-np.inf)
    return [t for t in good if t.evidence.value > doubt + DOUBTED]


def as_stated(before: State, after: State, effect: Effect) -> Evidence | None:
    """Evidence for a bias with calibration as it was stated, which free inside its tolerance takes most of what lies a little
    beyond; None unless it is sure, lies beyond, and lowers the log's own error by `OPEN`, and for all that is no bias: surface
    and clock act through the law, and would stand in for what it lacks.
    """
    if effect.id != BIAS or not _beyond(after, effect) or shown_error(after) >= (1.0 - OPEN) * shown_error(before):
        return None
    found = weigh(before.plain.light(), after.plain.light())
    return found if found.sure else None


def calibration_shows(state: State) -> bool:
    """Whether calibration, free inside its tolerance, takes off as much of the log's own error as a bias must."""
    return bool(len(state.shift)) and _freed(state) < (1.0 - OPEN) * shown_error(state)


def told_of_calibration(state: State) -> str:
    """What calibration seems to be off by, inside its tolerance, in words; "" unless the log's own error tells of it."""
    if not calibration_shows(state):
        return ""
    most = state.problem.calibration.most(state.shift)
    return (f"calibration that is off inside its tolerance (most: {most}) would lower the held-out error from "
            f"{shown_error(state):.2g} to {_freed(state):.2g} {error_unit(state.problem.experiment)}: kinid compare counts that, "
            "the diagnosis doesn't")  # fmt: skip


def _freed(state: State) -> float:
    """Held-out error as users see it, with calibration free."""
    return _in_units(state.problem, error_rows(state.problem.experiment), state.held)


def trusted_to(effect: Effect, layout: Layout) -> str:
    """How far calibration is trusted in what an effect says, in words; "" where it is no effect of calibration."""
    units = {p.unit for p in effect.parameters(layout)}
    return " and ".join(f"{size:.2g} {unit}" for unit, size in TOLERATED.get(effect.id, {}).items() if unit in units)


def plausibility(state: State, effect: Effect) -> float:
    """How likely an effect is to have the size that was found, on the scale of evidence; for effects that fit alike.

    Of each amplitude, twice the logarithm of its prior density times the width of its posterior (Laplace's method: MacKay,
    Neural Computation 4(3), 1992), where a prior is normal with `USUAL` scales.
    """
    layout = state.problem.experiment.layout
    own = np.flatnonzero(state.own(effect.id))
    width = np.sqrt(np.maximum(np.diag(state.inverse)[own], 1e-300))
    total = 0.0
    for i, null in amplitudes(effect, layout, base_of(state.model)).items():
        size = (state.values[own[i]] - null) / (USUAL * state.scale[own[i]])
        total += 2.0 * np.log(min(1.0, width[i] / USUAL)) - size**2
    return float(total)


def at_end(tried: Tried) -> bool:
    """Whether one of its parameters was driven to the end of what is possible: then it stands in for something else."""
    layout = tried.state.problem.experiment.layout
    parameters = tried.effect.parameters(layout)
    null = amplitudes(tried.effect, layout, base_of(tried.state.model))
    for i, (p, value) in enumerate(zip(parameters, tried.state.values[tried.state.own(tried.effect.id)])):
        room = 1e-3 * p.scale
        if any(abs(value - end) < room and end not in (null.get(i), *tried.effect.ends.get(p.name, ()))
               for end in (p.low, p.high)):  # fmt: skip
            return True
    return False


def material(tried: Tried) -> bool:
    """Whether what was added is outside of what calibration is trusted to anyway."""
    return tried.effect.id not in TOLERATED or _beyond(tried.state, tried.effect)


def _beyond(state: State, effect: Effect) -> bool:
    """Whether a quantity of calibration lies beyond its tolerance.

    Calibration, free inside it, takes a part of what the effect would: as it was stated, all is the effect's.
    """
    own = state.own(effect.id)
    units = np.array([p.unit for p in effect.parameters(state.problem.experiment.layout)])
    # of vectors the length counts: nothing is special about a sensor's axes
    return any(float(np.linalg.norm(found.values[own][units == unit])) > size
               for found in (state, state.plain.light()) for unit, size in TOLERATED[effect.id].items())  # fmt: skip
