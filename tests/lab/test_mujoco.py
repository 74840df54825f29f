"""MuJoCo has the same arm, controller and Kelvin-Voigt contact: an independent engine gives the same motion and
force.
"""

from __future__ import annotations

from pathlib import Path

import mujoco
import numpy as np
import pytest

import kinid.urdf
from kinid.controllers.impedance import impedance_torque
from kinid.data.rig import Rig, ToolSpec
from kinid.lab.arm import Arm, Gains, Joints, design_damping, joints_along
from kinid.lab.loop_experiment import Loop, twists
from kinid.lab.materials import Material
from kinid.lab.protocol import Poke, five_phases
from kinid.lab.setup import ELBOW_UP
from kinid.robotics.robot import Robot

TOOL = ToolSpec(mass=0.24, com=(0.0, 0.0, 0.049), inertia=(2e-4, 2e-4, 1e-4, 0.0, 0.0, 0.0))
MATERIAL = Material(stiffness=900.0, damping=12.0)
POINT, ROTOR = np.array([0.55, 0.0, 0.10]), 0.375
SUBSTEPS = 8


def _model() -> mujoco.MjModel:
    spec = mujoco.MjSpec.from_file(str(kinid.urdf.path("lwr4plus", Path())))
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_RK4
    spec.option.timestep = 1e-3 / SUBSTEPS
    spec.option.gravity = [0.0, 0.0, -9.81]
    spec.option.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_CONTACT) | int(mujoco.mjtDisableBit.mjDSBL_LIMIT)
    spec.compiler.fusestatic = False
    sensor = spec.body("ft_sensor")
    tool = sensor.add_body(name="tool")
    tool.mass, tool.ipos, tool.inertia, tool.explicitinertial = TOOL.mass, list(TOOL.com), list(TOOL.inertia[:3]), True
    sensor.add_site(name="tip", pos=[0.0, 0.0, 0.1])
    for joint in spec.joints:
        joint.armature = ROTOR
    return spec.compile()


def test_same_motion_and_force() -> None:
    robot = Robot.load(Rig.parse_text('[robot]\nmodel = "lwr4plus"\n'))
    arm = Arm.pack(robot, TOOL)
    zero = np.zeros(7)
    joints = Joints(np.full(7, ROTOR), zero, zero, zero, zero, zero, zero, np.full(7, 200.0), shaping=1.0)
    script = five_phases(Poke(0.004, ((0.0015, 0.9), (0.0005, 5.0)), 1.2), free=0.0, hold=0.2, approach=0.8)
    axes, gains = np.eye(3), Gains()
    positions, rotations = script.poses(axes, POINT)
    q0 = joints_along(robot, positions[:1], rotations[:1], ELBOW_UP)[0]
    damping = design_damping(gains, arm, joints, q0)
    ours = Loop(arm, joints, gains, axes, POINT, damping).run(q0, positions, rotations, MATERIAL)

    model = _model()
    data, tip = mujoco.MjData(model), model.site("tip").id
    data.qpos[:] = q0
    speeds = twists(positions, rotations, 1e-3)
    linear, angular, torque = np.empty((3, 7)), np.empty((3, 7)), np.empty(7)
    still = mujoco.MjData(model)
    q, force = np.empty((len(positions), 7)), np.empty(len(positions))

    def push() -> float:
        depth = POINT[2] - data.site_xpos[tip][2]
        return max(0.0, MATERIAL.stiffness * depth - MATERIAL.damping * (linear @ data.qvel)[2]) if depth > 0 else 0.0

    for i in range(len(positions)):
        for s in range(SUBSTEPS):
            mujoco.mj_forward(model, data)
            mujoco.mj_jacSite(model, data, linear, angular, tip)
            if s == 0:
                still.qpos[:] = data.qpos
                mujoco.mj_forward(model, still)  # at rest its bias is gravity alone
                impedance_torque(
                    data.site_xmat[tip].reshape(3, 3).copy(),
                    data.site_xpos[tip].copy(),
                    np.vstack([linear, angular]),
                    data.qvel.copy(),
                    still.qfrc_bias.copy(),
                    rotations[i],
                    positions[i],
                    speeds[i],
                    gains.stiffness,
                    damping,
                    gains.null,
                    joints.torque_limit,
                    torque,
                )
                q[i], force[i] = data.qpos, push()
            data.qfrc_applied[:] = torque + linear[2] * push()
            mujoco.mj_step(model, data)

    apart = np.abs(q - ours.q).max()
    worst = np.abs(force - ours.force[:, 2]).max() / force.max()
    print(f"MuJoCo: joints within {apart:.1e} rad, force within {1e2 * worst:.2f} % of {force.max():.2f} N")
    assert force.max() > 2.0
    assert apart < 1e-3  # [rad]
    assert worst < 0.02
    assert np.abs(ours.q - ours.q[0]).max() > 0.02, "an arm that doesn't move agrees with anything"


@pytest.mark.parametrize("pose", [ELBOW_UP, np.linspace(-1, 1, 7)])
def test_same_mass_matrix(pose: np.ndarray) -> None:
    robot = Robot.load(Rig.parse_text('[robot]\nmodel = "lwr4plus"\n'))
    model = _model()
    data, full = mujoco.MjData(model), np.empty((7, 7))
    data.qpos[:] = pose
    mujoco.mj_forward(model, data)
    mujoco.mj_fullM(model, data, full) if mujoco.__version__ >= "3.4" else mujoco.mj_fullM(model, full, data.qM)
    # MuJoCo turns each inertia into its principal axes and back, in digits of its own
    np.testing.assert_allclose(full - ROTOR * np.eye(7), Arm.pack(robot, TOOL).state(pose).mass, atol=1e-6)
