"""An arm to control: Pinocchio's forward dynamics, stepped finer than the controller."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import pinocchio as pin
import pytest
from numpy.typing import NDArray

from kinid.controllers import ArmState
from kinid.data.rig import Rig
from kinid.robotics.robot import Robot

Array = NDArray[np.float64]
LIMIT = np.array([176.0, 176.0, 100.0, 100.0, 100.0, 38.0, 38.0])
POSE = np.deg2rad([10.0, -40.0, 15.0, 85.0, -20.0, -55.0, 30.0])


@dataclass(frozen=True, eq=False)
class Bench:
    """A frictionless arm; `run` returns joints, velocities, tips and torques at each period."""

    robot: Robot
    pose: Array
    limit: Array

    def state(self, q: Array | None = None, dq: Array | None = None, wrench: Array | None = None) -> ArmState:
        return ArmState.of(self.robot, self.pose if q is None else q, dq, wrench)

    def run(
        self,
        command: Callable[[int, ArmState], Array],
        steps: int,
        contact: Callable[[ArmState], Array] | None = None,
        period: float = 1e-3,
        fine: int = 2,
        dq: Array | None = None,
    ) -> dict[str, Array]:
        model = self.robot.model
        data = model.createData()
        q, dq = self.pose.copy(), np.zeros(model.nv) if dq is None else dq.copy()
        rows: dict[str, list[Any]] = {"q": [], "dq": [], "tip": [], "tau": []}
        for i in range(steps):
            state = self.state(q, dq)
            wrench = np.zeros(6) if contact is None else contact(state)
            tau = command(i, self.state(q, dq, wrench) if contact else state)
            for name, value in (("q", q), ("dq", dq), ("tip", state.position), ("tau", tau)):
                rows[name].append(np.array(value))
            for _ in range(fine):
                acceleration = pin.aba(model, data, q, dq, tau + state.jacobian.T @ wrench)
                dq = dq + period / fine * acceleration
                q = q + period / fine * dq
        return {name: np.array(values) for name, values in rows.items()}


@pytest.fixture(scope="session")
def bench() -> Bench:
    robot = Robot.load(Rig.parse({"robot": {"model": "lwr4plus"}}))
    model = robot.model.copy()
    # rotors as the drives' torque loops leave them; without them joint 7 weighs 1 g m², and 1 kHz is slow for it
    model.armature = np.full(7, 0.4)
    return Bench(dataclasses.replace(robot, model=model), POSE, LIMIT)
