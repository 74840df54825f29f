"""Raw samples on one clock: frozen arrays, a validity mask, and a provenance that says what was done to them."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from kinid.data.rig import CONTACT, WRENCH
from kinid.errors import InputError
from kinid.shown import Shown
from kinid.signal.pieces import GAP_FACTOR, finite_rows

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
S = TypeVar("S", bound=np.generic)

#: no angle, speed, acceleration, torque or force of a log is larger, in SI units
LARGEST = 1e12
#: no clock ticks faster than this [s], nor counts further
FINEST, FARTHEST = 1e-12, 1e15
#: arrays with a column a joint
JOINTS = ("q", "dq", "ddq", "tau", "q_cmd")


@dataclass(frozen=True)
class Step:
    """One thing that was done to the samples on their way: its name, the figures that a reader would ask for, and what
    it found to doubt, a sentence each.
    """

    name: str
    facts: Mapping[str, object]
    warnings: tuple[str, ...] = ()

    def __str__(self) -> str:
        """In words: no name of a field, no table as Python writes it."""
        return f"{self.name}: " + ", ".join(_fact(k, v) for k, v in self.to_dict().items() if k != "name")

    def to_dict(self) -> dict[str, object]:
        """Plain types, for JSON."""
        return {"name": self.name, **self.facts} | ({"warnings": list(self.warnings)} if self.warnings else {})


@dataclass(frozen=True)
class Provenance:
    """Where samples came from and, in order, what was done to them."""

    source: str
    steps: tuple[Step, ...] = ()

    def then(self, name: str, **facts: object) -> Provenance:
        """The same provenance with one more step."""
        return self.after(Step(name, facts))

    def after(self, *steps: Step) -> Provenance:
        """The same provenance with more steps."""
        return Provenance(self.source, (*self.steps, *steps))

    @property
    def warnings(self) -> tuple[str, ...]:
        """What the steps found to doubt, a sentence each."""
        return tuple(dict.fromkeys(warning for step in self.steps for warning in step.warnings))

    def to_dict(self) -> dict[str, object]:
        """Plain types, for JSON."""
        return {"source": self.source, "steps": [step.to_dict() for step in self.steps]}


def frozen(values: ArrayLike) -> Array:
    """A read-only array; the caller's own array stays writeable where it had to be copied or viewed."""
    return frozen_as(np.float64, values)


def frozen_as(dtype: type[S], values: ArrayLike) -> NDArray[S]:
    """The same of another type than float64."""
    array = np.asarray(values, dtype=dtype).view()
    array.setflags(write=False)
    return array


@dataclass(frozen=True, eq=False, repr=False)
class Log(Shown):
    """Raw samples on one clock, in SI units.

    Attributes:
        t: time [s], strictly increasing, (n,).
        q: joint positions [rad or m], (n, N); `dq`, `ddq` their derivatives, `q_cmd` commanded ones.
        tau: joint torques, link side [N·m or N], (n, N).
        wrench: fx fy fz tx ty tz [N, N·m], sensor frame at its origin, as loads on the tool, (n, 6).
        contact: contact quantities that the log itself holds (a material tester), each (n,).
        phase: name of the protocol phase of each sample, (n,) of text.
        valid: False where any quantity of the sample is not a finite number, (n,).
        provenance: source and processing steps.
        joint_period: of the joints' own stream where the rows between were interpolated [s]; 0 where each was measured.

    Raises:
        InputError: no samples, lengths that differ, or time that is not finite and strictly increasing.
    """

    t: Array
    q: Array | None = None
    dq: Array | None = None
    ddq: Array | None = None
    tau: Array | None = None
    q_cmd: Array | None = None
    wrench: Array | None = None
    contact: Mapping[str, Array] = field(default_factory=dict)
    phase: NDArray[np.str_] | None = None
    provenance: Provenance = Provenance("memory")
    joint_period: float = 0.0

    def __post_init__(self) -> None:
        where = self.provenance.source
        object.__setattr__(self, "t", frozen(self.t))
        n = self.t.shape[0] if self.t.ndim == 1 else 0
        if n == 0:
            raise InputError(f"no samples in {where}", "at least one row of data", "check the file, record again")
        _check_time(self.t, where)
        for name in ("q", "dq", "ddq", "tau", "q_cmd", "wrench"):
            values = getattr(self, name)
            if values is None:
                continue
            array = frozen(values)
            if array.ndim != 2 or array.shape[0] != n or (name == "wrench" and array.shape[1] != 6):
                shape = f"({n}, 6)" if name == "wrench" else f"({n}, N)"
                raise InputError(f"{name} of shape {array.shape} in {where}", f"shape {shape}", "check its columns")
            if self.q is not None and name not in ("q", "wrench") and array.shape[1] != np.shape(self.q)[1]:
                raise InputError(
                    f"{array.shape[1]} columns of {name} beside {np.shape(self.q)[1]} of q in {where}",
                    "one column a joint",
                    "check [columns] and the log's names",
                )
            _check_size(array, name, where)
            object.__setattr__(self, name, array)
        contact = {}
        for name, values in self.contact.items():
            if name not in CONTACT or np.shape(values) != (n,):
                raise InputError(
                    f"contact quantity '{name}' of shape {np.shape(values)} in {where}",
                    f"one of {', '.join(CONTACT)}, of shape ({n},)",
                    "check [columns]",
                )
            contact[name] = frozen(values)
            _check_size(contact[name], name, where)
        object.__setattr__(self, "contact", contact)
        if self.phase is not None:
            phase = frozen_as(np.str_, self.phase)
            if phase.shape != (n,):
                raise InputError(f"phase of shape {phase.shape} in {where}", f"shape ({n},)", "check its column")
            object.__setattr__(self, "phase", phase)

    def __len__(self) -> int:
        return int(self.t.shape[0])

    def __repr__(self) -> str:
        held = [name for name in (*JOINTS, "wrench", "phase") if getattr(self, name) is not None]
        return (
            f"<Log of {len(self)} samples over {self.t[-1] - self.t[0]:.4g} s: {', '.join([*held, *self.contact])}; "
            f"{self.provenance.source}>"
        )

    def columns(self) -> dict[str, NDArray[np.generic]]:
        """The columns of the log's table, by the names of the log format."""
        out: dict[str, NDArray[np.generic]] = {"t": self.t}
        for name in JOINTS:
            values = getattr(self, name)
            out |= {} if values is None else {f"{name}{j + 1}": column for j, column in enumerate(values.T)}
        out |= {} if self.wrench is None else dict(zip(WRENCH, self.wrench.T))
        return out | dict(self.contact) | ({} if self.phase is None else {"phase": self.phase})

    @property
    def joint_count(self) -> int:
        """Number of joints in the log; 0 for a log without joints."""
        for values in (self.q, self.dq, self.tau):
            if values is not None:
                return int(values.shape[1])
        return 0

    @cached_property
    def valid(self) -> Mask:
        """False where a sample holds a value that is not a finite number, (n,)."""
        mask = np.ones(len(self), dtype=np.bool_)
        for values in (self.q, self.dq, self.ddq, self.tau, self.q_cmd, self.wrench):
            if values is not None:
                mask &= finite_rows(values)
        for values in self.contact.values():
            mask &= np.isfinite(values)
        mask.setflags(write=False)
        return mask

    @cached_property
    def labelled_free(self) -> NDArray[np.int64]:
        """Rows of the phase "free"; none where the log has no phases."""
        return np.empty(0, dtype=np.int64) if self.phase is None else np.flatnonzero(self.phase == "free")

    @cached_property
    def period(self) -> float:
        """Median time between samples [s]; infinite for a single sample."""
        return float(np.median(np.diff(self.t))) if len(self) > 1 else float("inf")

    @cached_property
    def pieces(self) -> tuple[slice, ...]:
        """Runs of samples without a gap in time. Invalid joint positions are in no run, or single ones within it."""
        usable = np.arange(len(self)) if self.q is None else np.flatnonzero(finite_rows(self.q))
        breaks = np.flatnonzero(np.diff(self.t[usable]) > GAP_FACTOR * self.period) + 1
        return tuple(slice(int(run[0]), int(run[-1]) + 1) for run in np.split(usable, breaks) if len(run))

    def replace(self, step: str | None = None, facts: Mapping[str, object] | None = None, **changes: object) -> Log:
        """A copy with other arrays and, if `step` is named, one more provenance step."""
        provenance = self.provenance.after(Step(step, facts or {})) if step else self.provenance
        return dataclasses.replace(self, provenance=provenance, **changes)  # type: ignore[arg-type]  # checked there


def _check_size(values: Array, name: str, where: str) -> None:
    """Refuse values that no sensor gives; what isn't finite is absent."""
    flat = values.ravel(order="K")
    with np.errstate(over="ignore", invalid="ignore"):
        if float(np.dot(flat, flat)) < LARGEST**2:  # in one pass, what holds nearly always
            return
    most = float(np.abs(flat[np.isfinite(flat)]).max(initial=0.0))
    if most > LARGEST:
        raise InputError(
            f"{name} of {most:.3g} in {where}", f"{LARGEST:g} at most, in SI units", "leave empty what was not measured"
        )


def _check_time(t: Array, where: str) -> None:
    if not np.isfinite(t).all():
        row = int(np.flatnonzero(~np.isfinite(t))[0])
        raise InputError(
            f"time that is not a number in row {row + 1} of {where}",
            "a finite time in every row",
            "remove the rows without a time",
        )
    if float(np.abs(t[[0, -1]]).max()) > FARTHEST or (len(t) > 1 and 0.0 < abs(t[-1] - t[0]) < FINEST * len(t)):
        raise InputError(
            f"time from {t[0]:.3g} to {t[-1]:.3g} in {len(t)} rows of {where}",
            "seconds",
            'name its unit, such as [columns] t = { unit = "us" }',
        )
    steps = np.diff(t)
    if (steps <= 0).any():
        row = int(np.flatnonzero(steps <= 0)[0]) + 1
        verb = "repeats" if steps[row - 1] == 0 else "runs backwards"
        count = int((steps <= 0).sum())
        raise InputError(
            f"time that {verb} in row {row + 1} of {where} ({float(t[row - 1])} then {float(t[row])}; {count} such "
            f"rows)",
            "time that increases from row to row",
            _mended_order(steps),
        )


#: of so many steps that go back or stand still, at most, each may be a clock that was set back
SET_BACK = 3


def _mended_order(steps: Array) -> str:
    """How to mend times whose steps (n - 1,) aren't all positive, by how they aren't."""
    back, still = int((steps < 0).sum()), int((steps == 0).sum())
    if still > back:
        return "write the times with more digits, if they were rounded, or drop the doubled rows"
    if back <= SET_BACK:
        return (
            "make a log of each part, if the clock was set back or began anew there; sort the rows by time, if they "
            "only stand in another order"
        )
    return "sort the rows by time and drop the doubled ones"


#: what a fact's name ends in, where that is its unit
_UNITS = {"hz": "Hz", "s": "s", "m": "m", "n": "N"}
#: names of columns that are all said; of more in a row, the first and the last
_SAID = 3


def _fact(name: str, value: object) -> str:
    """One fact of a step in words, as "bandwidth 20 Hz"."""
    stem, _, unit = name.rpartition("_")
    if stem and unit in _UNITS and isinstance(value, int | float):
        return f"{stem.replace('_', ' ')} {_short(value)} {_UNITS[unit]}"
    return f"{name.replace('_', ' ')} {_short(value)}"


def _short(value: object) -> str:
    if isinstance(value, float):
        return f"{value:.4g}"
    if isinstance(value, Mapping):
        return "(" + "; ".join(f"{str(k).replace('_', ' ')}: {_short(v)}" for k, v in value.items()) + ")"
    if isinstance(value, list | tuple):
        said = [_short(v) for v in value]
        if said and len(set(said)) == 1:
            return f"{said[0]} each" if len(said) > 1 else said[0]
        stems = {text.rstrip("0123456789") for text in said}
        if len(said) > _SAID and len(stems) == 1 and all(isinstance(v, str) for v in value):
            return f"{said[0]} … {said[-1]}"
        return f"[{', '.join(said)}]" if said else "none"
    return str(value)
