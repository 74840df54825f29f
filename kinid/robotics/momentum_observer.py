"""The generalised-momentum observer: what joint torques hold beside the motion's, sample by sample.

With p = M(q) q̇ and ṗ = τ + τ_ext + Cᵀ q̇ − g, the residual obeys ṙ = K (τ_ext − r): external torques behind a low-pass
of first order (A. De Luca, R. Mattone, IEEE ICRA 2003 and 2005). It needs no acceleration and no inverse of M.
"""

from __future__ import annotations

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike, NDArray

from kinid.errors import InputError
from kinid.robotics.robot import Robot

Array = NDArray[np.float64]


class MomentumObserver:
    """Online counterpart of `JointTorques.residual`, with a lag.

    Args:
        robot: the arm, with all that it carries (`Robot.with_tool`).
        gain: K [1/s]; the lag is 1/K, and noise passes below K/2π [Hz].

    Raises:
        InputError: a gain that isn't positive.
    """

    def __init__(self, robot: Robot, gain: float = 50.0) -> None:
        if not (np.isfinite(gain) and gain > 0.0):
            raise InputError(f"a gain of {gain}", "a positive number [1/s]", "take some 50: a lag of 0.02 s")
        self.robot, self.gain = robot, float(gain)
        self._data = robot.model.createData()
        self.reset()

    def reset(self) -> None:
        """Begin a new log."""
        self._before: tuple[float, Array, Array] | None = None
        self._external = np.zeros(self.robot.joint_count)

    def update(self, t: float, q: ArrayLike, dq: ArrayLike, tau: ArrayLike) -> Array:
        """Measured less modelled torques (N,) [N·m or N], in the log's order; −τ_ext behind the lag.

        A sample that isn't finite gives NaN and is passed over; time that doesn't grow is refused. Between samples
        everything but the momentum runs straight, for which the low-pass is exact at any step.

        Args:
            t: [s]. q, dq, tau: joint positions, speeds and measured torques, (N,) in the log's order.

        Raises:
            InputError: shapes that aren't the robot's, or time that doesn't grow.
        """
        rows = [np.asarray(values, dtype=np.float64) for values in (q, dq, tau)]
        if any(row.shape != (self.robot.joint_count,) for row in rows):
            found = f"joints of shapes {', '.join(str(row.shape) for row in rows)}"
            raise InputError(found, f"({self.robot.joint_count},) each", "give one sample, joint by joint")
        if not np.isfinite([t, *np.concatenate(rows)]).all():
            return np.full(self.robot.joint_count, np.nan)
        momentum, drive = self._terms(*rows)
        if self._before is not None:
            before, last, driven = self._before
            if t <= before:
                raise InputError(
                    f"a time of {t:g} s after {before:g} s", "time that grows", "call reset() for a new log"
                )
            kept = np.exp(-self.gain * (t - before))
            seen = (momentum - last) / (t - before) - 0.5 * (drive + driven)
            self._external = kept * self._external + (1.0 - kept) * seen
        self._before = (t, momentum, drive)
        return np.asarray(-self.robot.from_tangent(self._external[None])[0])

    def _terms(self, q: Array, dq: Array, tau: Array) -> tuple[Array, Array]:
        """Momentum M q̇, and τ + Cᵀ q̇ − g that drives it without contact, (N,) each, in Pinocchio's order."""
        model, data, robot = self.robot.model, self._data, self.robot
        at, v, torque = robot.configuration(q[None])[0], robot.tangent(dq)[0], robot.tangent(tau)[0]
        mass = np.triu(pin.crba(model, data, at))
        mass = mass + np.triu(mass, 1).T
        coriolis = np.array(pin.computeCoriolisMatrix(model, data, at, v))
        gravity = np.array(pin.computeGeneralizedGravity(model, data, at))
        return mass @ v, torque + coriolis.T @ v - gravity
