"""Inside the control loop: one raw sample in, contact-frame quantities and an estimate out."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from kinid.errors import InputError
from kinid.estimators.estimate import Estimate
from kinid.kernels import chain as kernel
from kinid.kernels.causal import advance
from kinid.rig import CONTACT, Rig, ToolSpec
from kinid.robot import Robot
from kinid.surface import Plane
from kinid.surface import load as load_surface

Array = NDArray[np.float64]


class Stepper(Protocol):
    """A recursive estimator that takes one sample at a time: `online()` of those in `kinid.estimators`."""

    def update(self, *sample: Any, t: float | None = None) -> Estimate:
        """Learn one sample and say what is known now."""


class OnlineContact:
    """Contact-frame quantities of a plane, sample by sample, with the kernel that logs are worked on with.

    Velocities and accelerations that the loop doesn't give come from causal first-order low-passes of the stated bandwidth,
    each of which delays by 1/(2π·bandwidth) seconds. Nothing is allocated once it is built.

    Args:
        rig: with a robot, a plane, and what is known of tool and sensor.
        bandwidth: of that filter [Hz].
        contact_force: normal force from which the tool counts as touching [N].

    Raises:
        InputError: a rig without robot or plane.
    """

    def __init__(self, rig: Rig, *, robot: Robot | None = None, bandwidth: float = 40.0, contact_force: float = 0.1) -> None:
        surface = load_surface(rig)
        if not isinstance(surface, Plane):
            raise InputError("a rig without a plane", "[surface] point and normal", "work on meshes offline, with contact_series")
        robot = robot or Robot.load(rig)
        if robot.sensor_frame is None or robot.tip_frame is None:
            raise InputError(f"{robot.name} without sensor or tip frame", "both", "name them in [robot] of the rig")
        chain = robot.chain(robot.sensor_frame)
        tool = rig.tool or ToolSpec(mass=0.0)
        crosstalk = np.eye(6) if rig.sensor.crosstalk is None else np.asarray(rig.sensor.crosstalk)
        bias = np.zeros(6) if rig.sensor.bias is None else np.asarray(rig.sensor.bias)
        n = robot.joint_count
        self._motion = np.zeros((3, 1, n))  # q, dq, ddq
        self._columns = chain.columns
        self._wrench, self._out = np.zeros((1, 6)), np.zeros((len(CONTACT), 1))
        self._constants = (
            chain.turns, chain.shifts, chain.prismatic, robot.tip_in_sensor(),
            np.concatenate([np.linalg.inv(crosstalk).ravel(), bias]),
            np.concatenate([[tool.mass], tool.com, tool.inertia_matrix.ravel(), robot.gravity]),
            np.concatenate([surface.point, surface.axes.ravel()]), robot.compliance.ravel(), len(CONTACT), self._out,
        )  # fmt: skip
        self._q = np.zeros(n)
        self._parts = (self._motion[0], self._motion[1], self._motion[2])
        self._cutoff, self.threshold = 2 * np.pi * bandwidth, contact_force
        self._last_t: float | None = None
        self.quantities: Array = self._out[:, 0]
        self.step(0.0, np.zeros(n), np.zeros(6))  # compiles, so that the first sample of a loop is not late
        self.reset()

    def reset(self) -> None:
        """Forget the last sample: a new log begins."""
        self._last_t = None

    @property
    def touching(self) -> bool:
        """Whether the last sample was in contact."""
        return bool(self.quantities[kernel.NORMAL] > self.threshold)

    def step(
        self, t: float, q: Sequence[float] | Array, wrench: Sequence[float] | Array,
        dq: Sequence[float] | Array | None = None, ddq: Sequence[float] | Array | None = None,
    ) -> Array:  # fmt: skip
        """Work out one sample; the array it returns, in the order of `CONTACT`, is overwritten by the next.

        Args:
            t: time [s].
            q: joint positions (N,); `dq`, `ddq` where the loop has them.
            wrench: fx fy fz tx ty tz in sensor axes [N, N·m].
        """
        if np.shape(q) != self._q.shape or np.shape(wrench) != (6,):
            raise InputError(f"a sample of {np.shape(q)} joints and {np.shape(wrench)} wrench", f"{self._q.shape} and (6,)",
                             "pass one sample, joints in the order of [robot] joints")  # fmt: skip
        self._q[:] = q
        advance(self._q, self._columns, 0.0 if self._last_t is None else t - self._last_t, self._cutoff, self._motion)
        if dq is not None:
            self._motion[1, 0] = np.asarray(dq, dtype=float)[self._columns]
        if ddq is not None:
            self._motion[2, 0] = np.asarray(ddq, dtype=float)[self._columns]
        self._wrench[0] = wrench
        self._last_t = t
        kernel.contacts(*self._parts, self._wrench, *self._constants)
        return self.quantities


@dataclass(frozen=True, eq=False)
class OnlineEstimator:
    """A recursive estimator fed from raw joints and wrench.

    Attributes:
        contact: the way into the contact frame.
        estimator: `online()` of a recursive estimator. takes: contact quantities that its samples are made of, in order;
            "in_contact" stands for the contact flag.
    """

    contact: OnlineContact
    estimator: Stepper
    takes: tuple[str, ...] = ("depth", "depth_rate", "normal_force", "in_contact")

    def update(self, t: float, q: Any, wrench: Any, dq: Any = None, ddq: Any = None) -> Estimate:
        """Learn one raw sample: values, interval, validity and innovation as they are now."""
        self.contact.step(t, q, wrench, dq, ddq)
        item = self.contact.quantities.item  # Python floats: reading them as NumPy scalars costs a microsecond a sample
        sample = [item(row) if row >= 0 else item(kernel.NORMAL) > self.contact.threshold for row in self._rows]
        return self.estimator.update(*sample, t=t)

    @cached_property
    def _rows(self) -> list[int]:
        """Row of each quantity it takes; −1 for the contact flag."""
        return [-1 if name == "in_contact" else CONTACT.index(name) for name in self.takes]
