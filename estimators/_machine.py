"""What all recursive estimators share: memory, a batch over a log, and an object that takes one sample at a time."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from kinid.errors import InputError
from kinid.estimators.estimate import Array, Estimate, Mask, Prior, Status, Track
from kinid.estimators.excitation import Excitation
from kinid.estimators.forgetting import Forgetting

Columns = tuple[NDArray[Any], ...]


class Out(NamedTuple):
    """What a kernel writes for n samples of p parameters."""

    thetas: Array  # (n, p)
    variances: Array  # (n, p)
    innovations: Array  # (n,)
    noises: Array  # (n,)
    excitations: Array  # (n,)
    statuses: NDArray[np.int8]  # (n,)
    conditions: Mask  # (n, c)

    @classmethod
    def empty(cls, n: int, p: int, conditions: int) -> Out:
        """Room for them, in one block: the system hands out few large pages sooner than many small ones."""
        theta, variance, a, b, c = np.split(np.empty((2 * p + 3) * n), n * np.cumsum([p, p, 1, 1]))
        shape = (n, p)
        return cls(
            theta.reshape(shape), variance.reshape(shape), a, b, c, np.empty(n, np.int8),
            np.empty((n, conditions), np.bool_),
        )  # fmt: skip


class Memory:
    """Least-squares state of p parameters as the kernels take it.

    Args:
        prior: values and covariance at the start.
        limit: largest variance, in parts of the prior's; None for no limit.
    """

    def __init__(self, prior: Prior, limit: float | None) -> None:
        p = len(prior.values)
        if limit is not None and not limit > 0.0:
            raise InputError(f"a covariance limit of {limit}", "a positive number or None", "use 1 for the prior's")
        unit = prior.covariance / prior.noise**2
        u, d = factor(unit)
        self.state = np.concatenate([prior.values, d, u.ravel(), np.diagonal(unit), np.zeros(4)])
        self.limit = np.full(p, np.inf) if limit is None else np.maximum(limit * np.diagonal(unit), 1e-300)

    @property
    def updates(self) -> int:
        """Samples used."""
        return int(self.state[-1])


def unit_covariance(state: Array, p: int) -> Array:
    """P = U·diag(d)·Uᵀ of a state, (p, p)."""
    u = state[2 * p : 2 * p + p * p].reshape(p, p)
    return np.asarray((u * state[p : 2 * p]) @ u.T)


def covariance(state: Array, p: int) -> Array:
    """Covariance of the values' error, (p, p): P times the residual's variance, times Σw²/Σw of the weights."""
    squares, weights, weights2, _ = state[-4:]
    unit = unit_covariance(state, p)
    if weights <= 0.0:
        return np.where(unit == 0.0, 0.0, np.inf)
    return np.asarray(unit * (squares * weights2 / weights**2))


class Machine(ABC):
    """A running estimator: its memory, and how samples change it.

    Args:
        names: of the parameters.
        regressors: number of columns that the excitation is measured on.
        forgetting, excitation: settings.
        conditions: names of the approximations judged at each sample.
    """

    def __init__(
        self,
        names: tuple[str, ...],
        regressors: int,
        forgetting: Forgetting,
        excitation: Excitation | None,
        conditions: tuple[str, ...] = (),
    ) -> None:
        self.names, self.conditions, self.forgetting = names, conditions, forgetting
        self.shape = (0.0,) * regressors
        self.window = (excitation or Excitation()).memory(regressors)
        self.length = excitation.length if excitation else 0
        self.threshold = excitation.threshold if excitation else -1.0
        self.scratch = np.zeros((regressors + 3, regressors))

    @abstractmethod
    def advance(self, columns: Columns, t: Array | None, out: Out) -> None:
        """Learn n samples; columns are checked, contiguous arrays."""

    @abstractmethod
    def whole(self) -> Callable[[], Array]:
        """What gives the covariance of the values' error as it is now, (p, p)."""

    @property
    @abstractmethod
    def updates(self) -> int:
        """Samples used so far."""

    def estimate(self, out: Out, skipped: int) -> Estimate:
        """The estimate after the last sample in `out`."""
        return Estimate(
            self.names, out.thetas[-1].copy(), out.variances[-1].copy(), float(out.innovations[-1]),
            math.sqrt(out.noises[-1]), float(out.excitations[-1]), Status(int(out.statuses[-1])), self.updates, skipped,
            self.whole(),
        )  # fmt: skip

    def run(self, columns: Columns, t: Array | None) -> Track:
        """All samples of a log."""
        out = Out.empty(len(columns[0]), len(self.names), len(self.conditions))
        self.advance(columns, t, out)
        final = self.estimate(out, int(np.count_nonzero(out.statuses == Status.NOT_FINITE)))
        conditions = {name: out.conditions[:, i] for i, name in enumerate(self.conditions)}
        return Track(
            self.names, out.thetas, out.variances, out.innovations, out.noises, out.excitations, out.statuses, final,
            conditions, t,
        )  # fmt: skip


class Online:
    """An estimator fed one sample at a time, for a control loop.

    `step` learns and allocates nothing in compiled code; `update` also builds the `Estimate`. Both take what `run` of
    the estimator takes, for one sample. The batch and this run the same kernel.

    Args:
        machine: memory.
        columns: one row of each column that it takes, which each sample overwrites; a column of bool may be left out
            of a sample and is then True.
    """

    def __init__(self, machine: Machine, *columns: NDArray[Any]) -> None:
        self._machine = machine
        self._columns = columns
        self._required = sum(column.dtype != np.bool_ for column in columns)
        self._rest = (True,) * (len(columns) - self._required)
        self._time = np.zeros(1)
        self._out = Out.empty(1, len(machine.names), len(machine.conditions))
        self._skipped = 0

    def step(self, *sample: Any, t: float | None = None) -> Status:
        """Learn one sample.

        Args:
            sample: regressor and output, or the contact quantities, in the order of `run`.
            t: time [s], where the forgetting or the filter needs it.

        Raises:
            InputError: another number of values, or of another shape.
        """
        try:
            if len(sample) == self._required:
                sample = (*sample, *self._rest)
            for column, value in zip(self._columns, sample, strict=True):
                column[0] = value
        except (ValueError, TypeError):
            raise InputError(
                f"a sample of shapes {[np.shape(value) for value in sample]}",
                f"{[column.shape[1:] for column in self._columns]}",
                "pass the values of one sample, in the order of run()",
            ) from None  # fmt: skip
        time = None
        if t is not None:
            time = self._time
            time[0] = t
        self._machine.advance(self._columns, time, self._out)
        status = Status(int(self._out.statuses[0]))
        self._skipped += status is Status.NOT_FINITE
        return status

    def update(self, *sample: Any, t: float | None = None) -> Estimate:
        """Learn one sample and say what is known now; arguments as `step`."""
        self.step(*sample, t=t)
        return self.estimate

    def chunk(self, *columns: Any, t: Any = None) -> Track:
        """Learn several samples at once, as they come from a buffer; arguments as `step`, with one row a sample.

        Raises:
            InputError: other shapes, no samples, time that doesn't grow.
        """
        if len(columns) == self._required:
            columns = (*columns, *(np.ones(np.shape(columns[0])[:1], np.bool_) for _ in self._rest))
        time, arrays = vectors(t, **{f"column {i}": column for i, column in enumerate(columns)})
        shapes = [array.shape[1:] for array in arrays]
        if shapes != [column.shape[1:] for column in self._columns]:
            raise InputError(
                f"columns whose rows have shapes {shapes}", f"{[column.shape[1:] for column in self._columns]}",
                "pass them in the order of run()",
            )  # fmt: skip
        cast = tuple(array.astype(own.dtype, copy=False) for array, own in zip(arrays, self._columns))
        track = self._machine.run(cast, time)
        learnt: tuple[NDArray[Any], ...] = (
            track.theta, track.variance, track.innovation, track.noise_variance, track.excitation, track.status,
        )  # fmt: skip
        own: tuple[NDArray[Any], ...] = self._out
        for last, whole in zip(own, learnt):
            last[0] = whole[-1]
        self._skipped += track.skipped
        return track

    @property
    def estimate(self) -> Estimate:
        """What was known after the last sample."""
        return self._machine.estimate(self._out, self._skipped)

    @property
    def values(self) -> Array:
        """Parameters after the last sample, (p,): a view that the next sample changes."""
        values: Array = self._out.thetas[0]
        return values


def contact_columns(
    t: Any, depth: Any, depth_rate: Any, normal_force: Any, in_contact: Any
) -> tuple[Array | None, Columns]:
    """Checked contact quantities, each (n,), with the mask of contact as the last column; errors as `vectors`."""
    columns = {"depth": depth, "depth_rate": depth_rate, "normal_force": normal_force}
    time, arrays = vectors(t, **columns)
    contact = np.ones(len(arrays[0]), np.bool_) if in_contact is None else np.ascontiguousarray(in_contact, np.bool_)
    if any(array.ndim != 1 for array in arrays) or contact.shape != arrays[0].shape:
        shapes = ", ".join(f"{name} {np.shape(value)}" for name, value in columns.items())
        raise InputError(f"{shapes}, in_contact {contact.shape}", "(n,) each", "give one number a sample")
    return time, (*arrays, contact)


def one_contact() -> Columns:
    """One row of what `contact_columns` gives."""
    return np.zeros(1), np.zeros(1), np.zeros(1), np.ones(1, np.bool_)


def factor(covariance: Array) -> tuple[Array, Array]:
    """U (p, p) and d (p,) of a positive semi-definite matrix (Bierman 1977, sec. III.4)."""
    p = len(covariance)
    rest, u, d = covariance.copy(), np.eye(p), np.zeros(p)
    for j in range(p - 1, -1, -1):
        d[j] = max(rest[j, j], 0.0)
        if d[j] > 0.0:
            u[:j, j] = rest[:j, j] / d[j]
            rest[:j, :j] -= d[j] * np.outer(u[:j, j], u[:j, j])
    return u, d


def vectors(t: Any, **columns: Any) -> tuple[Array | None, list[Array]]:
    """Checked columns of one length, and the time that goes with them.

    Raises:
        InputError: no samples, lengths or shapes that differ, text, or time that doesn't grow.
    """
    try:
        arrays = {name: np.ascontiguousarray(value, dtype=np.float64) for name, value in columns.items()}
        time = None if t is None else np.ascontiguousarray(t, dtype=np.float64)
    except (ValueError, TypeError):
        raise InputError("a column that is not numeric", "numbers", "convert or remove it") from None
    lengths = {name: array.shape[0] if array.ndim else -1 for name, array in arrays.items()}
    n = next(iter(lengths.values()))
    if n < 1 or any(length != n for length in lengths.values()):
        shapes = ", ".join(f"{name} {array.shape}" for name, array in arrays.items())
        raise InputError(f"columns of shapes {shapes}", "one length, at least one sample", "cut them to one log")
    if time is not None and (time.shape != (n,) or not np.isfinite(time).all() or (np.diff(time) <= 0.0).any()):
        raise InputError(
            f"time of shape {time.shape} for {n} samples, or time that doesn't grow",
            "one finite, growing time a sample",
            "sort the log and remove repeated samples",
        )
    return time, list(arrays.values())
