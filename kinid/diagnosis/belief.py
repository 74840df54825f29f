"""Whether an addition is believed: evidence that chance doesn't explain, a size that matters, and nothing simpler behind it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from kinid.diagnosis.candidates import amplitudes, base_of
from kinid.diagnosis.descent import State
from kinid.diagnosis.look import Tried, worth
from kinid.diagnosis.problem import BIAS_FORCE, BIAS_TORQUE, CLOCK, SURFACE
from kinid.fit import error_rows

#: an addition that leaves the weighted error counts where the log's own falls by this share, calibration as it was stated, and
#: evidence is beyond what calibration leaves
LIGHTER, STRONG = 0.015, 100.0
#: what calibration a little beyond its tolerance explains within so much evidence is not called physics
DOUBTED = 12.0

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
    return (tried.evidence.sure and material(tried) and not at_end(tried) and _matters(before, tried)
            and _beyond_rounding(before, tried))  # fmt: skip


def _beyond_rounding(before: State, tried: Tried) -> bool:
    """Whether it changes readings by more than a coarse converter rounds them: neighbours share that, in any shape."""
    steps = before.problem.experiment.steps
    if steps is None or not (steps > 0).all():
        return True
    sigma = before.problem.sigma[:, before.problem.valid]
    change = (before.residual - tried.state.residual).reshape(len(sigma), -1) * sigma
    return bool((np.percentile(np.abs(change), 95, axis=1) > 0.5 * steps).any())


def _matters(before: State, tried: Tried) -> bool:
    """Whether it takes enough off the weighted error; or, if calibration is no explanation, off the error as users see it."""
    if tried.state.rms < (1.0 - worth(before)) * before.rms:
        return True
    if tried.effect.id in TOLERATED or tried.evidence.value < STRONG:
        return False
    return _error(tried.state) < (1.0 - LIGHTER) * _error(before)


def _error(state: State) -> float:
    """Held-out error in the unit of the readings, calibration as it was stated, noise of single samples included."""
    problem = state.problem
    rows = error_rows(problem.experiment)
    sigma = problem.sigma[rows][:, problem.valid]
    held = state.plain.light().held.reshape(len(rows), -1)[rows]
    averaged = np.mean(problem.experiment.noise[rows] ** 2) * (1.0 - np.mean(1.0 / problem.count[problem.valid]))
    return float(np.sqrt(np.mean((held * sigma) ** 2) + averaged))


def believed(before: State, tried: Sequence[Tried]) -> list[Tried]:
    """Those that are accepted, and that calibration a little beyond its tolerance doesn't explain as well."""
    good = [t for t in tried if accepted(before, t)]
    calibration = [t.evidence.value for t in tried if t.effect.id in TOLERATED and t.evidence.sure and t not in good]
    doubt = max(calibration, default=-np.inf)
    return [t for t in good if t.evidence.value > doubt + DOUBTED]


def at_end(tried: Tried) -> bool:
    """Whether one of its parameters was driven to the end of what is possible: then it stands in for something else."""
    layout = tried.state.problem.experiment.layout
    parameters = tried.effect.parameters(layout)
    null = amplitudes(tried.effect, layout, base_of(tried.state.model))
    own = [name.split(".")[0] == tried.effect.id for name in tried.state.model.parameters(layout)]
    for i, (p, value) in enumerate(zip(parameters, tried.state.values[np.array(own)])):
        room = 1e-3 * p.scale
        if any(abs(value - end) < room and end not in (null.get(i), tried.effect.ends.get(p.name)) for end in (p.low, p.high)):
            return True
    return False


def material(tried: Tried) -> bool:
    """Whether what was added is outside of what calibration is trusted to anyway.

    Calibration, free inside its tolerance, takes a part of what the effect would: as it was stated, all is the effect's.
    """
    layout = tried.state.problem.experiment.layout
    least = TOLERATED.get(tried.effect.id)
    if least is None:
        return True
    own = np.array([name.split(".")[0] == tried.effect.id for name in tried.state.model.parameters(layout)])
    units = [p.unit for p in tried.effect.parameters(layout)]
    return any(abs(v) > least[unit] for state in (tried.state, tried.state.plain.light())
               for v, unit in zip(state.values[own], units) if unit in least)  # fmt: skip
