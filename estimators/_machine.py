"""What all recursive estimators share: memory, a batch over a log, and an object that takes one sample at a time."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from kinid.errors import InputError
from kinid.estimators import _store
from kinid.estimators.estimate import Array, Estimate, Mask, Prior, Status, Track
from kinid.estimators.excitation import Excitation
from kinid.estimators.forgetting import Constant, Forgetting
from kinid.estimators.offset import Offset

Columns = tuple[NDArray[Any], ...]

#: the times that a kernel for logs gets where none are known
UNKNOWN_TIME = np.array([math.nan])


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
            theta.reshape(shape),
            variance.reshape(shape),
            a,
            b,
            c,
            np.empty(n, np.int8),
            np.empty((n, conditions), np.bool_),
        )


class Memory(NamedTuple):
    """Least-squares state of p parameters as the kernels take it, and the largest variance that each may have."""

    state: Array
    limit: Array  # (p,)

    @classmethod
    def of(cls, prior: Prior, limit: float | None, offset: Offset | None = None) -> Memory:
        """What a prior says.

        Args:
            prior: values and covariance at the start.
            limit: largest variance, in parts of the prior's; None for no limit.
            offset: of the outputs, where one is considered.
        """
        p = len(prior.values)
        if limit is not None and not limit > 0.0:
            raise InputError(f"a covariance limit of {limit}", "a positive number or None", "use 1 for the prior's")
        unit = prior.covariance / prior.noise**2
        u, d = factor(unit)
        considered = offset.memory(p) if offset else np.empty(0)
        state = np.concatenate([prior.values, d, u.ravel(), np.diagonal(unit), considered, np.zeros(_store.TALLY)])
        return cls(state, np.full(p, np.inf) if limit is None else np.maximum(limit * np.diagonal(unit), 1e-300))


def unit_covariance(state: Array, p: int) -> Array:
    """P = U·diag(d)·Uᵀ of a state, (p, p)."""
    u = state[2 * p : 2 * p + p * p].reshape(p, p)
    return np.asarray((u * state[p : 2 * p]) @ u.T)


def covariance(state: Array, p: int) -> Array:
    """Covariance of the values' error, (p, p): P times the residual's variance, times Σw²/Σw of the weights, and what
    an offset adds.
    """
    squares, weights, weights2, _ = state[-_store.TALLY :]
    unit = unit_covariance(state, p)
    if weights <= 0.0:
        return np.where(unit == 0.0, 0.0, np.inf)
    offset = state[_store.offset_place(p) : -_store.TALLY]
    shared = offset[_store.SHARED + p :].reshape(p, p) if len(offset) else 0.0
    return np.asarray(unit * (squares * weights2 / weights**2) + shared)


def stop_clock(state: Array, p: int) -> None:
    """An offset's walk goes on from the time of the next sample."""
    offset = state[_store.offset_place(p) : -_store.TALLY]
    if len(offset):
        offset[_store.CLOCK] = math.nan


class Machine(ABC):
    """A running estimator: its memory, and how samples change it.

    Args:
        names: of the p parameters, which are as many as the regressors that excitation is measured on.
        memory: at the start; the last number of its state counts the samples used.
        forgetting, excitation: settings.
        columns: shape of each thing that a sample is made of, () for a number.
        flags: how many of them, at the end, say yes or no, and may be left out for yes.
        spare: numbers that the kernel of one sample needs besides.
        settings: numbers that the kernels are told.
        conditions: names of the approximations judged at each sample.
    """

    def __init__(
        self,
        names: tuple[str, ...],
        memory: Memory,
        forgetting: Forgetting,
        excitation: Excitation | None,
        columns: tuple[tuple[int, ...], ...],
        *,
        flags: int = 0,
        spare: int = 0,
        settings: tuple[float, ...] = (),
        conditions: tuple[str, ...] = (),
    ) -> None:
        p = len(names)
        self.names, self.columns, self.flags = names, columns, flags
        self.conditions, self.forgetting = conditions, forgetting
        self.shape = (0.0,) * p
        #: β if it is the same for all samples
        self.constant = forgetting.beta if isinstance(forgetting, Constant) else None
        self.store = _store.build(
            p,
            memory.state,
            memory.limit,
            (excitation or Excitation()).memory(p),
            excitation.length if excitation else 0,
            excitation.threshold if excitation else -1.0,
            self.constant or math.nan,
            sum(self.widths) + spare,
            settings,
            len(conditions),
        )
        #: views of the store, which the kernels for logs work on too
        self.room = _store.carve(self.shape, self.store)
        # no sample has come: nothing is known, and nothing stands
        self.room.record[p : 2 * p], self.room.record[_store.STATUS] = math.inf, Status.STARTING
        #: what an estimate is a copy of
        self.kept = self.store[: len(self.room.record) + len(self.room.state)]

    @property
    def widths(self) -> list[int]:
        """How many numbers each column of a sample has."""
        return [math.prod(column) for column in self.columns]

    @abstractmethod
    def advance(self, columns: Columns, t: Array | None, out: Out) -> None:
        """Learn n samples; columns are checked, contiguous arrays."""

    @property
    @abstractmethod
    def once(self) -> Callable[[float, tuple[float, ...], Array], None]:
        """Compiled: learn the sample that lies in the store's inputs; takes time [s] or NaN, shape and store."""

    @abstractmethod
    def covariance(self, state: Array) -> Array:
        """Of the values' error, (p, p), as a state says."""

    def restart(self) -> None:
        """Time begins anew."""

    @property
    def watch(self) -> Array:
        """View of what it remembers of how its values scatter, and of its clock at the end; empty where it doesn't."""
        none: Array = self.room.state[:0]
        return none

    @property
    def updates(self) -> int:
        """Samples used so far."""
        return int(self.room.state[-1])

    def estimate(self) -> Estimate:
        """What is known now: one copy; all else is worked out when it is asked for."""
        return Estimate.of(self.names, self.kept.copy(), self.covariance)

    def run(self, columns: Columns, t: Array | None) -> Track:
        """All samples of a log."""
        out = Out.empty(len(columns[0]), len(self.names), len(self.conditions))
        self.advance(columns, t, out)
        record = self.room.record
        learnt: tuple[NDArray[Any], ...] = out
        for place, last in zip(self.room.out, learnt):
            place[0] = last[-1]
        record[_store.UPDATES] = self.updates
        record[_store.SKIPPED] += np.count_nonzero(out.statuses == Status.NOT_FINITE)
        conditions = {name: out.conditions[:, i] for i, name in enumerate(self.conditions)}
        return Track(
            self.names,
            out.thetas,
            out.variances,
            out.innovations,
            out.noises,
            out.excitations,
            out.statuses,
            self.estimate(),
            conditions,
            t,
        )


class Online:
    """An estimator fed one sample at a time, for a control loop.

    `step` learns, in compiled code that allocates nothing; `update` also hands out an `Estimate`, a copy of the numbers
    that works out the rest when it is asked. Both take what `run` of the estimator takes, for one sample. The batch and
    this run the same kernel, which is compiled when this is made, so that no sample of a loop waits for it.

    Args:
        machine: memory.
    """

    def __init__(self, machine: Machine) -> None:
        self.machine = machine
        parts = np.split(machine.room.inputs, np.cumsum(machine.widths))
        self._columns = [part.reshape(1, *shape) for part, shape in zip(parts, machine.columns)]
        self._required = len(machine.columns) - machine.flags
        self._yes = (True,) * machine.flags
        self._last = -math.inf
        self._once = ready(machine)

    def reset(self) -> None:
        """A new log begins, whose time may start anew; what was learnt stays."""
        self._last = -math.inf
        self.machine.restart()

    def step(self, *sample: ArrayLike, t: float | None = None) -> Status:
        """Learn one sample.

        Args:
            sample: regressor and output, or the contact quantities, in the order of `run`. What is not finite is passed
                over: the status says so, and nothing that was learnt changes.
            t: time [s], where the forgetting or the filter needs it.

        Raises:
            InputError: another number of values, or of another shape; a time that isn't finite or doesn't grow. Nothing
                is learnt then.
        """
        self._learn(sample, t)
        return Status(int(self.machine.room.record[_store.STATUS]))

    def update(self, *sample: ArrayLike, t: float | None = None) -> Estimate:
        """Learn one sample and say what is known now; arguments as `step`."""
        self._learn(sample, t)
        return self.machine.estimate()

    def pass_over(self) -> None:
        """Count a sample that isn't finite, of whatever time."""
        machine = self.machine
        machine.room.inputs[:] = math.nan
        self._once(math.nan, machine.shape, machine.store)

    def _learn(self, sample: tuple[ArrayLike, ...], t: float | None) -> None:
        """See `step`."""
        now = math.nan if t is None else self._checked(t)
        try:
            if len(sample) == self._required:
                sample = (*sample, *self._yes)
            for column, value in zip(self._columns, sample, strict=True):
                column[0] = value
        except (ValueError, TypeError):
            raise InputError(
                f"a sample of shapes {[np.shape(value) for value in sample]}",
                f"{[column.shape[1:] for column in self._columns]}",
                "pass the values of one sample, in the order of run()",
            ) from None
        machine = self.machine
        if machine.constant is None:
            machine.room.factor[0] = machine.forgetting.at(None if t is None else now)
        if t is not None:
            self._last = now
        self._once(now, machine.shape, machine.store)

    def _checked(self, t: float) -> float:
        """A time that may follow the last one."""
        try:
            now = float(t)
        except (ValueError, TypeError):
            now = math.nan
        if not self._last < now < math.inf:
            raise late(t, self._last)
        return now

    def chunk(self, *columns: ArrayLike, t: ArrayLike | None = None) -> Track:
        """Learn several samples at once, as they come from a buffer; arguments as `step`, with one row a sample.

        Raises:
            InputError: other shapes, no samples, time that doesn't grow.
        """
        if len(columns) == self._required:
            columns = (*columns, *(np.ones(np.shape(columns[0])[:1], np.bool_) for _ in self._yes))
        time, arrays = vectors(t, **{f"column {i}": column for i, column in enumerate(columns)})
        shapes = [array.shape[1:] for array in arrays]
        if shapes != list(self.machine.columns):
            raise InputError(
                f"columns whose rows have shapes {shapes}",
                f"{list(self.machine.columns)}",
                "pass them in the order of run()",
            )
        if time is not None:
            self._checked(time[0])
            self._last = float(time[-1])
        flags = (array.astype(np.bool_) for array in arrays[self._required :])
        return self.machine.run((*arrays[: self._required], *flags), time)

    @property
    def estimate(self) -> Estimate:
        """What was known after the last sample."""
        return self.machine.estimate()

    @property
    def values(self) -> Array:
        """Parameters after the last sample, (p,): a view that the next sample changes."""
        values: Array = self.machine.room.record[: len(self.machine.names)]
        return values


def ready(machine: Machine) -> Callable[[float, tuple[float, ...], Array], None]:
    """The machine's kernel of one sample, compiled."""
    from numba import float64, types

    kernel: Any = machine.once
    kernel.compile((float64, types.UniTuple(float64, len(machine.shape)), float64[::1]))
    return kernel  # type: ignore[no-any-return]


def late(t: float, last: float) -> InputError:
    """What to say of a time that can't follow the last one."""
    found = f"a sample at t = {t} s" + (f" after one at t = {last} s" if math.isfinite(last) else "")
    return InputError(
        found, "finite, growing time", "sort the samples and drop repeated ones, or reset() where a new log begins"
    )


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


def vectors(t: ArrayLike | None, **columns: ArrayLike) -> tuple[Array | None, list[Array]]:
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
