"""What an estimator answers: values with their uncertainty, and whether they may be trusted, with the way out if
not.
"""

from __future__ import annotations

import enum
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from kinid.errors import InputError, near
from kinid.estimators import _store

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

#: half width of a 95 % interval, in standard deviations of a normal distribution
NORMAL_95 = 1.959963984540054

#: a delay that nobody notices at 1 kHz [s]: damping of K times it can't be told from one
SAMPLE = 1e-3


class Status(enum.IntEnum):
    """Why an estimate is, or is not, to be trusted at a sample. Its numbers are those of the kernels."""

    VALID = 0
    STARTING = 1
    NOT_EXCITED = 2
    NO_CONTACT = 3
    BELOW_NOISE = 4
    TOO_FAST = 5
    NOT_FINITE = 6
    NOT_SLIDING = 7
    MISFIT = 8
    DIVERGED = 9

    @property
    def remedy(self) -> str:
        """What is the matter and what to do."""
        return _REMEDIES[self]


_REMEDIES = {
    Status.VALID: "the estimate stands",
    Status.STARTING: "fewer samples than the parameters need: go on measuring",
    Status.NOT_EXCITED: "the motion doesn't tell the parameters apart: vary depth, speed and load within the window",
    Status.NO_CONTACT: "no contact, the last values are kept: press the tool in",
    Status.BELOW_NOISE: "the force is too close to the noise (K xⁿ ≤ 10 ε): press deeper, or state the noise",
    Status.TOO_FAST: "too fast for the approximation (|ẋ| ≥ 0.1 K/B): move slower",
    Status.NOT_FINITE: "the sample is not a finite number and was passed over: look for gaps in the log",
    Status.NOT_SLIDING: "the tip is at rest, the last values are kept: slide faster",
    Status.MISFIT: "the residual is over three times the stated noise, or isn't noise: state the noise, try another "
    "law, or start anew",
    Status.DIVERGED: "the filter lost the material (innovations far outside their covariance): start anew, or let it "
    "walk",
}


class Estimate:
    """Parameters after one sample. It can't be changed; what it says is worked out when it is asked for.

    Inside is one array, a copy of the estimator's record and state as `_store` lays them out: a control loop makes one
    of these a sample and seldom reads all of it.

    Args:
        names: of the p parameters.
        values: (p,), SI.
        variance: of the values' error, (p,); inf before the noise is known.
        innovation: measurement minus prediction at the last sample; 0 where it was not used.
        noise: standard deviation of the residual, in the unit of the output.
        excitation: smallest singular value over the window, 0 … 1 (see `Excitation`).
        status: whether to trust it.
        updates: samples used so far.
        skipped: samples that were not finite.
        whole: gives the covariance of the values' error.
    """

    __slots__ = ("_covariance", "_names", "_numbers")

    def __init__(
        self,
        names: tuple[str, ...],
        values: Array,
        variance: Array,
        innovation: float,
        noise: float,
        excitation: float,
        status: Status,
        updates: int,
        skipped: int,
        whole: Callable[[], Array],
    ) -> None:
        self._names = names
        self._numbers = np.concatenate(
            [values, variance, [innovation, noise * noise, excitation, float(status), updates, skipped]]
        )
        self._covariance: Callable[[Array], Array] = lambda _: whole()

    @classmethod
    def of(cls, names: tuple[str, ...], numbers: Array, covariance: Callable[[Array], Array]) -> Estimate:
        """From a record with the state behind it, which is not copied, and what gives the covariance of that state."""
        self = cls.__new__(cls)
        self._names, self._numbers, self._covariance = names, numbers, covariance
        return self

    @property
    def names(self) -> tuple[str, ...]:
        """Of the p parameters."""
        return self._names

    @property
    def values(self) -> Array:
        """(p,), SI."""
        return self._numbers[: len(self._names)]

    @property
    def variance(self) -> Array:
        """Of the values' error, (p,); inf before the noise is known."""
        p = len(self._names)
        return self._numbers[p : 2 * p]

    @property
    def innovation(self) -> float:
        """Measurement minus prediction at the last sample; 0 where it was not used."""
        return self._says(_store.INNOVATION)

    @property
    def noise(self) -> float:
        """Standard deviation of the residual, in the unit of the output."""
        return math.sqrt(self._says(_store.NOISE))

    @property
    def excitation(self) -> float:
        """Smallest singular value over the window, 0 … 1."""
        return self._says(_store.EXCITATION)

    @property
    def status(self) -> Status:
        """Whether to trust it."""
        return Status(int(self._says(_store.STATUS)))

    @property
    def updates(self) -> int:
        """Samples used so far."""
        return int(self._says(_store.UPDATES))

    @property
    def skipped(self) -> int:
        """Samples that were not finite."""
        return int(self._says(_store.SKIPPED))

    @property
    def covariance(self) -> Array:
        """Of the values' error, (p, p); inf before the noise is known."""
        return self._covariance(self._numbers[self._end :])

    @property
    def valid(self) -> bool:
        """Whether the estimate stands."""
        return self._says(_store.STATUS) == Status.VALID

    @property
    def std(self) -> Array:
        """Standard deviation, (p,)."""
        return np.sqrt(self.variance)

    @property
    def interval(self) -> Array:
        """95 % interval, low and high, (p, 2)."""
        half = NORMAL_95 * self.std
        return np.stack([self.values - half, self.values + half], axis=1)

    def __getitem__(self, name: str) -> float:
        return float(self.values[_place(name, self.names)])

    def __str__(self) -> str:
        listed = zip(self.names, self.values, NORMAL_95 * self.std)
        numbers = ", ".join(f"{name} {value:.6g} ± {half:.2g}" for name, value, half in listed)
        return f"{numbers} ({self.status.name.lower().replace('_', ' ')}: {self.status.remedy})"

    def __repr__(self) -> str:
        return f"<Estimate {self}>"

    @property
    def _end(self) -> int:
        """Length of the record."""
        return 2 * len(self._names) + _store.PLACES

    def _says(self, place: int) -> float:
        """A number of the record behind values and variances; `place` counts from the record's end."""
        return float(self._numbers[self._end + place])


@dataclass(frozen=True, eq=False)
class Track:
    """Parameters after each of n samples; where a sample is not used, the last values are repeated.

    Attributes:
        names: of the p parameters.
        theta: values, (n, p), SI.
        variance: of the values' error, (n, p); inf before the noise is known.
        innovation: measurement minus prediction, before the sample was learnt, (n,); 0 where it was not used.
        noise_variance: of the residual, (n,).
        excitation: smallest singular value over the window, (n,).
        status: numbers of `Status`, (n,).
        final: the estimate after the last sample, with its whole covariance.
        conditions: by name, whether an approximation that the estimator rests on held, (n,) each, judged with the
            estimates of that sample; False where there is no contact.
        t: time [s], (n,), if it was given.
    """

    names: tuple[str, ...]
    theta: Array
    variance: Array
    innovation: Array
    noise_variance: Array
    excitation: Array
    status: NDArray[np.int8]
    final: Estimate
    conditions: Mapping[str, Mask] = field(default_factory=dict)
    t: Array | None = None

    @property
    def valid(self) -> Mask:
        """Where the estimate stands, (n,)."""
        return np.asarray(self.status == Status.VALID)

    @property
    def std(self) -> Array:
        """Standard deviation of the values' error, (n, p)."""
        return np.sqrt(self.variance)

    @property
    def noise(self) -> Array:
        """Standard deviation of the residual, (n,)."""
        return np.sqrt(self.noise_variance)

    @property
    def interval(self) -> Array:
        """95 % interval, low and high, (n, p, 2)."""
        half = NORMAL_95 * self.std
        return np.stack([self.theta - half, self.theta + half], axis=-1)

    @property
    def skipped(self) -> int:
        """Samples that were not finite."""
        return int(np.count_nonzero(self.status == Status.NOT_FINITE))

    def counts(self) -> dict[Status, int]:
        """How many samples have each status, the frequent first."""
        number = np.bincount(self.status, minlength=len(Status))
        return {Status(k): int(number[k]) for k in np.argsort(-number, kind="stable") if number[k]}

    def __getitem__(self, name: str) -> Array:
        return self.theta[:, _place(name, self.names)]

    def __len__(self) -> int:
        return len(self.theta)


@dataclass(frozen=True, eq=False)
class Prior:
    """What is believed before the first sample.

    Attributes:
        values: (p,).
        covariance: of the values' error, (p, p), or variances, (p,).
        noise: standard deviation of the measurement that the covariance is weighed against.

    Raises:
        InputError: shapes that differ, a covariance that is not positive semi-definite, a noise that is not positive.
    """

    values: Array
    covariance: Array
    noise: float = 1.0

    def __post_init__(self) -> None:
        values = np.atleast_1d(np.asarray(self.values, dtype=np.float64))
        covariance = np.asarray(self.covariance, dtype=np.float64)
        p = len(values)
        if covariance.shape == (p,):
            covariance = np.diag(covariance)
        if values.shape != (p,) or covariance.shape != (p, p):
            raise InputError(
                f"a prior with values {values.shape} and covariance {covariance.shape}",
                "values (p,) and covariance (p, p) or variances (p,)",
                "give both for the same parameters",
            )
        sound = bool(np.isfinite(values).all() and np.isfinite(covariance).all())
        size = np.sqrt(np.maximum(np.diagonal(covariance), 1e-300)) if sound else np.ones(p)
        scaled = covariance / np.outer(size, size) if sound else covariance
        symmetric = sound and np.allclose(scaled, scaled.T, atol=1e-9)
        if not symmetric or np.linalg.eigvalsh(scaled)[0] < -1e-9 or (np.diagonal(covariance) < 0).any():
            raise InputError(
                "a prior covariance that no random numbers can have, or that is not finite",
                "a symmetric, positive semi-definite matrix",
                "use the covariance of an earlier estimate, or variances",
            )
        if not (math.isfinite(self.noise) and self.noise > 0.0):
            raise InputError(f"a prior noise of {self.noise}", "a positive number", "give the noise of the output")
        object.__setattr__(self, "values", values)
        object.__setattr__(self, "covariance", 0.5 * (covariance + covariance.T))

    @classmethod
    def near(cls, neighbour: Estimate, spread: float | Sequence[float] = 0.2) -> Prior:
        """Warm start from a neighbouring place.

        Args:
            neighbour: its estimate.
            spread: by how much, in parts of its values (all or each), parameters differ from place to place.

        Raises:
            InputError: the neighbour's covariance isn't finite yet.
        """
        change = np.asarray(spread, dtype=np.float64) * np.abs(neighbour.values)
        covariance = neighbour.covariance
        if not (np.isfinite(covariance).all() and np.isfinite(change).all()):
            raise InputError(
                f"a neighbour whose estimate says: {neighbour.status.remedy}",
                "a neighbour with a finite covariance and a finite spread",
                "start cold, or from a place that was measured longer",
            )
        return cls(neighbour.values, covariance + np.diag(change**2), max(neighbour.noise, 1e-12))


def _place(name: str, names: tuple[str, ...]) -> int:
    if name not in names:
        raise InputError(f"parameter '{name}'", "a parameter of this estimator", near(name, names))
    return names.index(name)
