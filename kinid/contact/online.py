"""Inside the control loop: one raw sample in, contact-frame quantities and an estimate out.

A sample costs one call of compiled code, which differentiates, works out the contact frame and learns, and allocates
nothing: some 2 µs. What makes a rare sample late is no longer here but around it, so a loop that must not be late
should call `gc.freeze()` after setting up (what exists then is never searched for garbage again) and `gc.disable()`
while it runs, or collect in its pauses; and run with real-time priority on a core of its own (`chrt -f 50 taskset -c 1
…`).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from kinid.data.rig import CONTACT, Rig
from kinid.errors import InputError, near
from kinid.estimators._machine import Machine, Online
from kinid.estimators.estimate import Estimate
from kinid.kernels import causal, on_mesh, window
from kinid.kernels import chain as kernel
from kinid.robotics.robot import Robot
from kinid.robotics.surface import Mesh, Plane, Surface
from kinid.robotics.surface import load as load_surface
from kinid.robotics.wrench import packed_tool

Array = NDArray[np.float64]

_NOTHING: Array = np.empty(0)
Numbers = Sequence[float] | Array
#: t [s], q, wrench, dq, ddq of one sample
Raw = tuple[float, Numbers, Numbers, Numbers | None, Numbers | None]


class Stepper(Protocol):
    """A recursive estimator that takes one sample at a time: `online()` of those in `kinid.estimators`."""

    @property
    def estimate(self) -> Estimate:
        """What was known after the last sample."""

    def update(self, *sample: ArrayLike, t: float | None = None) -> Estimate:
        """Learn one sample and say what is known now."""


class OnlineContact:
    """Contact-frame quantities of a plane or a mesh, sample by sample, with the kernel that logs are worked on with.

    Velocities and accelerations that the loop doesn't give come from causal first-order low-passes of the stated
    bandwidth, whose lag is taken away (see `kinid.kernels.causal.advance`): motion of up to a quarter of the bandwidth
    is followed to a tenth. Nothing is allocated once it is built.

    Estimates rest on better velocities: `next_delayed` gives each sample once more, some `DELAY` later, with the motion
    that the samples on both sides of it show, in which there is neither lag nor bias (see `kinid.kernels.window`). Not
    those within that time of a gap, of the first sample, or of the last. A loop that gives velocities and accelerations
    needn't wait: such a sample comes at once, as it is.

    Args:
        rig: with a robot, a surface, and what is known of tool and sensor.
        bandwidth: of that filter [Hz].
        contact_force: normal force from which the tool counts as touching [N].

    Attributes:
        quantities: of the last sample, in the order of `CONTACT`; the next one overwrites them.
        delayed: the same of the sample of `next_delayed`.

    Raises:
        InputError: a rig without robot or surface.
    """

    #: what estimates wait for at 1 kHz and above [s]; at slower rates for eight samples, up to twice as long
    DELAY = window.DELAY

    def __init__(
        self, rig: Rig, *, robot: Robot | None = None, bandwidth: float = 40.0, contact_force: float = 0.1
    ) -> None:
        surface = load_surface(rig)
        if surface is None:
            raise InputError("a rig without a surface", "[surface] point and normal, or mesh", "add what is touched")
        plane, sheet = _on(surface)
        robot = robot or Robot.load(rig)
        if robot.sensor_frame is None or robot.tip_frame is None:
            raise InputError(f"{robot.name} without sensor or tip frame", "both", "name them in [robot] of the rig")
        chain = robot.chain(robot.sensor_frame)
        self.robot, self.joint_count = robot, robot.joint_count
        self.store = causal.build(
            chain.columns,
            chain.prismatic,
            chain.turns,
            chain.shifts,
            robot.tip_in_sensor(),
            np.concatenate([np.linalg.inv(rig.sensor.crosstalk_matrix).ravel(), rig.sensor.stated_bias]),
            packed_tool(rig, robot),
            plane,
            robot.compliance.ravel(),
            2 * np.pi * bandwidth,
            contact_force,
            sheet,
        )
        self._surface = surface
        self._room = causal.carve(self.store)
        self._step = causal.compile_step()
        self._next = causal.compile_next()
        self.quantities: Array = self._room.quantities
        self.delayed: Array = self._room.late

    def reset(self) -> None:
        """Forget the last sample: a new log begins, whose time may start anew."""
        self._room.head[causal.TIME] = -np.inf

    @property
    def threshold(self) -> float:
        """Normal force from which the tool counts as touching [N]."""
        return float(self._room.head[causal.TOUCHING])

    @property
    def touching(self) -> bool:
        """Whether the last sample was in contact; False where its force isn't known."""
        return bool(self.quantities[kernel.NORMAL] > self.threshold)

    @property
    def place(self) -> Array:
        """The surface's point nearest to the tip at the last sample, base frame, (3,) [m]."""
        if isinstance(self._surface, Plane):
            slips = self.quantities[[kernel.SLIP1, kernel.SLIP2]]
            return np.asarray(self._surface.point + slips @ self._surface.axes[:2])
        return np.array(on_mesh.sheet_of(self._room.sheet).found[:3])

    @property
    def axes(self) -> Array:
        """Rows tangent1, tangent2, normal at the last sample, base frame, (3, 3)."""
        if isinstance(self._surface, Plane):
            return self._surface.axes
        return np.array(on_mesh.sheet_of(self._room.sheet).axes).reshape(3, 3)

    @property
    def positions(self) -> Array:
        """Joint positions of the last sample, (N,); 0 of joints behind the sensor."""
        out = np.zeros(self.joint_count)
        out[self._room.columns.astype(int)] = self._room.motion[0]
        return out

    def step(
        self,
        t: float,
        q: Numbers,
        wrench: Numbers,
        dq: Numbers | None = None,
        ddq: Numbers | None = None,
    ) -> Array:
        """Work out one sample; the array it returns, in the order of `CONTACT`, is overwritten by the next.

        A sample whose motion isn't finite gives NaN throughout and is forgotten: the next velocity is taken from the
        one before it. A wrench that isn't finite gives NaN where it is needed.

        Args:
            t: time [s]; it has to grow until `reset`.
            q: joint positions (N,); `dq`, `ddq` where the loop has them.
            wrench: fx fy fz tx ty tz in sensor axes [N, N·m].

        Raises:
            InputError: arrays of another shape, or a time that isn't finite or doesn't grow; all stays as it was.
        """
        self.call(self._step, (t, q, wrench, dq, ddq), (self.store,))
        return self.quantities

    def next_delayed(self) -> bool:
        """Work out the next sample that an estimator may learn into `delayed`; False where none is ready.

        To be called after `step` until there is none.
        """
        return self._next(self.store)

    @property
    def delayed_time(self) -> float | None:
        """Time of that sample [s]; None for one that isn't finite, which comes as soon as it is taken."""
        at = float(self._room.window[window.AT])
        return None if math.isnan(at) else at

    def call(self, step: Callable[..., int], raw: Raw, rest: tuple[object, ...]) -> None:
        """A compiled step with one raw sample, whatever its numbers came in.

        Args:
            step: of `kinid.kernels.causal`. raw: arguments of `step`. rest: what the compiled step takes besides.

        Raises:
            InputError: as `step`.
        """
        t, q, wrench, dq, ddq = raw
        try:
            # converted first, which costs next to nothing for doubles: the compiled step takes nothing else, and to
            # hear so from it takes a quarter of a millisecond
            code = step(
                t,
                np.asarray(q, np.float64),
                np.asarray(wrench, np.float64),
                _NOTHING if dq is None else np.asarray(dq, np.float64),
                _NOTHING if ddq is None else np.asarray(ddq, np.float64),
                *rest,
            )
        except (TypeError, ValueError):
            raise self.refusal(causal.MISSHAPEN, raw) from None
        if code > causal.NOT_FINITE:
            raise self.refusal(code, raw)

    def refusal(self, code: int, raw: Raw) -> InputError:
        """What to say of a sample that can't be taken."""
        t, q, wrench, dq, ddq = raw
        if code == causal.LATE:
            last = float(self._room.head[causal.TIME])
            after = f" after one at t = {last} s" if np.isfinite(last) else ""
            return InputError(
                f"a sample at t = {t} s{after}",
                "finite, growing time",
                "drop repeated and late samples, or reset() where a new log begins",
            )
        rates = "".join(
            f", {name} of {_shape(value)}" for name, value in (("dq", dq), ("ddq", ddq)) if value is not None
        )
        return InputError(
            f"a sample at t = {t} of {_shape(q)} joints and {_shape(wrench)} wrench{rates}",
            f"a number, ({self.joint_count},) and (6,)",
            "pass one sample, joints in the order of [robot] joints",
        )


@dataclass(frozen=True, eq=False)
class OnlineEstimator:
    """A recursive estimator fed from raw joints and wrench.

    It is given each sample when the motion around it is known (`OnlineContact.next_delayed`): an estimate comes with
    every sample at once, and rests on all that is older than `OnlineContact.DELAY`. With an estimator of this project
    that forgets evenly a sample is one compiled call; any other is fed from Python.

    Attributes:
        contact: the way into the contact frame.
        estimator: `online()` of a recursive estimator. takes: contact quantities that its samples are made of, in
            order; "in_contact" stands for the contact flag, and several names in brackets for a vector.

    Raises:
        InputError: an unknown quantity, or others than the estimator's samples are made of.
    """

    contact: OnlineContact
    estimator: Stepper
    takes: tuple[str | tuple[str, ...], ...] = ("depth", "depth_rate", "normal_force", "in_contact")
    _rows: list[int | list[int]] = field(init=False, repr=False)
    _machine: Machine | None = field(init=False, repr=False, default=None)
    _fused: Callable[..., int] = field(init=False, repr=False)
    _rest: tuple[object, ...] = field(init=False, repr=False, default=())

    def __post_init__(self) -> None:
        rows = [_row(name) if isinstance(name, str) else [_row(part) for part in name] for name in self.takes]
        object.__setattr__(self, "_rows", rows)
        if isinstance(self.estimator, Online):
            self._check(self.estimator)
            if self.estimator.machine.constant is not None:
                self._fuse(self.estimator)

    def _check(self, online: Online) -> None:
        """Whether the samples are what the estimator takes."""
        machine = online.machine
        widths, expected = [1 if isinstance(row, int) else len(row) for row in self._rows], machine.widths
        missing = len(expected) - len(widths)
        if not 0 <= missing <= machine.flags or widths != expected[: len(widths)]:
            raise InputError(
                f"samples of {self.takes}",
                f"{len(expected)} values of {expected} numbers",
                "name a quantity for each, in the order of update(), several in brackets for a vector",
            )

    def _fuse(self, online: Online) -> None:
        """Both halves as one compiled call."""
        machine = online.machine
        flat = [row for rows in self._rows for row in (rows if isinstance(rows, list) else [rows])]
        missing = len(machine.widths) - len(self._rows)
        rows = np.array(flat + [causal.YES] * missing, dtype=np.int64)
        start = (machine.room.inputs.ctypes.data - machine.store.ctypes.data) // machine.store.itemsize
        fused = causal.compile_step_and_learn(machine.once, len(machine.shape))
        object.__setattr__(self, "_machine", machine)
        object.__setattr__(self, "_fused", fused)
        object.__setattr__(self, "_rest", (self.contact.store, rows, start, machine.shape, machine.store))

    def reset(self) -> None:
        """A new log begins, whose time may start anew; what was learnt stays."""
        self.contact.reset()
        if isinstance(self.estimator, Online):
            self.estimator.reset()

    def update(
        self, t: float, q: Numbers, wrench: Numbers, dq: Numbers | None = None, ddq: Numbers | None = None
    ) -> Estimate:
        """Learn one raw sample: values, interval, validity and innovation as they are now.

        A sample that isn't finite is passed over: the estimate's status says so, and nothing that was learnt changes.

        Raises:
            InputError: as `OnlineContact.step`; all stays as it was.
        """
        if self._machine is None:
            self.contact.step(t, q, wrench, dq, ddq)
            while self.contact.next_delayed():
                self._give()
            return self.estimator.estimate
        self.contact.call(self._fused, (t, q, wrench, dq, ddq), self._rest)
        return self._machine.estimate()

    def _give(self) -> None:
        """The sample that is ready to the estimator, from Python."""
        t = self.contact.delayed_time
        if t is None and isinstance(self.estimator, Online):
            self.estimator.pass_over()
            return
        sample = [
            self._value(row) if isinstance(row, int) else [self._value(part) for part in row] for row in self._rows
        ]
        self.estimator.update(*sample, t=t)

    def _value(self, row: int) -> float | bool:
        """A quantity of that sample, as a Python number."""
        delayed = self.contact.delayed
        return bool(delayed[kernel.NORMAL] > self.contact.threshold) if row == causal.FLAG else delayed.item(row)


def _on(surface: Surface) -> tuple[Array, Array]:
    """The plane and the sheet of `causal.build`."""
    if isinstance(surface, Plane):
        return surface.packed(), np.empty(0)
    assert isinstance(surface, Mesh)  # there is no third
    return on_mesh.BASE_FRAME, surface.packed()


def _row(name: str) -> int:
    """Row of a quantity; `causal.FLAG` for the contact flag."""
    if name == "in_contact":
        return causal.FLAG
    if name not in CONTACT:
        raise InputError(f"contact quantity '{name}'", "one of the contact frame, or in_contact", near(name, CONTACT))
    return CONTACT.index(name)


def _shape(value: Numbers) -> tuple[int, ...] | str:
    """Shape of a value, or what it is."""
    try:
        return tuple(np.shape(value))
    except ValueError:
        return "ragged"
