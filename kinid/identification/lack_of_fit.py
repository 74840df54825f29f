"""What a model leaves: beside noise, beside the tolerance that a user states, and for how long it remembers itself."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from kinid.identification.error_model import reading_noise
from kinid.identification.state import State
from kinid.modeling.experiment import Experiment

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

#: share of the readings' root mean square, in contact or in motion, that may be left unless a user says otherwise
TOLERANCE = 0.02
#: a joint moves where it is faster than this share of its fastest
MIN_SPEED_SHARE = 0.02


@dataclass(frozen=True)
class LackOfFit:
    """What is left.

    Attributes:
        rms: of the residual. noise: what noise of readings and motion explains of it. excess: what they don't, but
            where a material has let go of the tool, and no faster than what fits are made to.
        tolerance: what may be left. reading: root mean square of the readings in contact or motion; all in `unit`.
        memory: for how long the residual remembers itself [s].
    """

    rms: float
    noise: float
    excess: float
    tolerance: float
    reading: float
    memory: float
    unit: str

    @property
    def matters(self) -> bool:
        """Whether more is left than noise and tolerance."""
        return self.excess > self.tolerance

    @property
    def share_of_reading(self) -> float:
        """What is left beside noise, as a share of the reading."""
        return self.excess / self.reading if self.reading > 0 else 0.0

    def to_dict(self) -> dict[str, float]:
        """For JSON."""
        return {"rms": self.rms, "share_of_reading": self.share_of_reading, "memory_s": self.memory}


def lack_of_fit(state: State, residual: Array, tolerance: float | None = None) -> LackOfFit:
    """What a residual (channels, n) of a state leaves.

    Args:
        state: whose error model tells noise. residual: of the whole log; NaN where a sample doesn't count.
        tolerance: in the error's unit; `TOLERANCE` of the readings, or the noise where that is more, if None.
    """
    experiment = state.problem.whole
    rows = error_rows(experiment)
    counted = np.isfinite(residual).all(axis=0)
    error = rms(residual[rows][:, counted])
    # where a material has let go of a tool that retracts, what a law says isn't held against it
    firm = rms(residual[rows][:, counted & ~experiment.separated])
    motion = float(np.mean(state.error.motion[rows])) if state.error.motion.size else 0.0
    single = np.mean(reading_noise(state.problem)[rows] ** 2)
    # a residual that is smaller than its noise proves the noise wrong
    noise = min(float(np.sqrt(single + motion)), error) if np.isfinite(error) else float(np.sqrt(single + motion))
    reading = reading_rms(experiment)
    allowed = max(TOLERANCE * reading, noise) if tolerance is None else tolerance
    excess = float(np.sqrt(max(0.0, min(firm**2 - noise**2, _slow(state, rows)))))
    return LackOfFit(error, noise, excess, allowed, reading, state.error.memory, error_unit(experiment))


def inside_tolerance(state: State) -> bool:
    """Whether what a state leaves in means of neighbours is inside the usual tolerance."""
    rows = error_rows(state.problem.whole)
    return _slow(state, rows) <= (TOLERANCE * reading_rms(state.problem.whole)) ** 2


def brings_inside(before: State, after: State) -> bool:
    """Whether what one state leaves matters, and what another leaves is inside the usual tolerance."""
    return not inside_tolerance(before) and inside_tolerance(after)


def much_left(state: State) -> bool:
    """Whether more than noise is left in means of neighbours than noise itself."""
    rows = error_rows(state.problem.whole)
    return _slow(state, rows) > float(np.mean(reading_noise(state.problem)[rows] ** 2))


def _slow(state: State, rows: Mask) -> float:
    """Mean square of what is left beside noise in means of neighbours, which fits are made to: the rest is faster."""
    problem = state.problem
    gone = (
        problem.means(np.broadcast_to(problem.experiment.separated, problem.experiment.measured.shape).astype(float))[0]
        > 0.0
    )
    return 0.0 if gone.all() else float(np.mean((state.held_out**2 - state.error.noise**2)[rows][:, ~gone]))


def reading_rms(experiment: Experiment) -> float:
    """Root mean square of the readings that errors are told of, in contact or in motion, over all their channels."""
    s, valid = experiment.signals, experiment.valid
    acting = valid & experiment.in_contact
    if s.joints is not None:
        speed = np.abs(s.joints.dq)
        acting = valid & (speed > MIN_SPEED_SHARE * speed.max(axis=1, keepdims=True)).any(axis=0)
    rows = error_rows(experiment)
    readings = experiment.measured[rows][:, acting if acting.any() else valid]
    return rms(readings[:, np.isfinite(readings).all(axis=0)])


def error_rows(experiment: Experiment) -> Mask:
    """Channels that the error figure is over: forces where there are any."""
    units = np.array(experiment.layout.units)
    return np.asarray(units == "N") if (units == "N").any() else np.ones(len(units), np.bool_)


def error_unit(experiment: Experiment) -> str:
    """Unit of the error figure."""
    return "N" if "N" in experiment.layout.units else "N·m"


def rms(values: Array) -> float:
    """Root mean square over everything."""
    return float(np.sqrt(np.mean(values**2))) if values.size else float("nan")
