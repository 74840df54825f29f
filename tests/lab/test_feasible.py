"""What can't work is said before anything runs, and what is let through works."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import kinid
from kinid.data.rig import ToolSpec
from kinid.errors import InputError
from kinid.lab.arm import Gains, Joints, design_damping, lwr4plus_joints, spectral_radius
from kinid.lab.experiments import EXPERIMENTS, SILICONE_POKE, prepare
from kinid.lab.feasible import _growth, asked_forces
from kinid.lab.loop_experiment import Loop
from kinid.lab.materials import MOULD, Material
from kinid.lab.protocol import Poke, Slide, five_phases


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"point": (1.6, 0.0, 0.1)}, "reach"),
        ({"point": (-0.55, 0.0, 0.1)}, "behind the robot"),
        ({"normal": (0.0, 0.0, -1.0)}, "turned away"),
        ({"gains": Gains(translation=5e5)}, r"unstable at 1000 Hz \(errors grow 1[.]8. times a period"),
        ({"gains": Gains(null=2000.0)}, "a null-space damping of 2000 .* unstable.*lower it"),
        ({"joints": Joints.ideal(7)}, "a null-space damping of 6 .* unstable"),
        ({"gains": Gains(ratio=0.01)}, "damping ratio of 0.01, too low, unstable.*raise it"),
        ({"gains": Gains(ratio=20.0)}, "damping ratio of 20, too high, unstable.*lower it"),
        ({"gains": Gains(translation=-1.0)}, "positive"),
        ({"gains": Gains(translation="x")}, "stiffness of x"),
        ({"gains": Gains(translation=True)}, "stiffness of True"),
        ({"gains": Gains(null=None)}, "null-space damping of None"),
        ({"gains": Gains(translation=250.0)}, "friction holds the tip up to 6.4 mm .* 5.0 mm that they press"),
        ({"gains": Gains(ratio=float("nan"))}, "positive"),
        ({"gains": Gains(null=-1.0)}, "null-space damping"),
        ({"gains": Gains(period=0.0)}, "period"),
        ({"gains": Gains(translation=6000.0)}, "5200"),
        ({"point": (0.1, 0.0, 0.1)}, "needs joint_4 at .* limits"),
        ({"script": five_phases(Slide(length=0.5, speed=0.1))}, "reach|limits"),
        ({"script": five_phases(Slide(length=0.06, speed=0.01)), "material": MOULD}, "beside the mould"),
        ({"script": five_phases(SILICONE_POKE, place=(0.03, -0.06)), "material": MOULD}, "beside the mould"),
        ({"material": Material(stiffness=5e4), "script": five_phases(Poke(0.12, ((0.001, 1.0),)))}, "sensor's range"),
        # what gravity asks, and what acceleration asks beyond it
        ({"payload": ToolSpec(mass=40.0)}, "asks .* N·m of joint"),
        ({"script": five_phases(Poke(0.01, ((0.005, 40.0),)))}, "asks .* N·m of joint"),
        ({"script": five_phases(Slide(length=0.15, speed=3.0), height=0.2, tilt=0.0)}, "rad/s|N·m"),
        ({"script": five_phases(Poke(float("nan"), ((0.001, 1.0),)))}, "numbers"),
    ],
)
def test_what_cannot_work_is_said_before_anything_runs(
    change: dict[str, object], words: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(Loop, "run", lambda *_, **__: pytest.fail("it ran"))
    with pytest.raises(InputError, match=words):
        prepare("poke").replace(**change).run()


def test_unstable_gains_really_are() -> None:
    """What the check refuses diverges, or at least rings without end; what it lets through doesn't."""

    setup = prepare("poke")
    q0 = setup.check()
    gains = Gains(translation=5e5)
    damping = design_damping(gains, setup.arm, setup.joints, q0)
    assert spectral_radius(gains, damping, setup.arm, setup.joints, q0) > 1.0
    positions, rotations = (part[:1500].copy() for part in setup.script.poses(setup.axes, np.asarray(setup.point)))
    positions[:] = positions[0]
    positions[10:] += 1e-4
    loop = Loop(setup.arm, lwr4plus_joints(friction=False), gains, setup.axes, np.asarray(setup.point) - [0, 0, 1.0])
    try:
        late = np.abs(loop.run(q0, positions, rotations, setup.material).dq[-200:]).max()
    except kinid.errors.KinidError:
        late = np.inf
    assert late > 1.0


@pytest.mark.parametrize("name", sorted(EXPERIMENTS))
def test_named_experiments_stay_within_what_was_checked(name: str) -> None:
    """Every joint within its limits, torques as asked beforehand: that check leaves out friction and tilting alone."""
    setup = prepare(name)
    q0 = setup.check()
    asked, pressed = asked_forces(setup, q0)
    motion = setup.run().motion
    order = setup.arm.columns
    assert (motion.q > setup.robot.lower[order]).all()
    assert (motion.q < setup.robot.upper[order]).all()
    assert (np.abs(motion.tau) < setup.joints.torque_limit).all()
    force = motion.force[:, 2].max()
    # a secant instead of the law, one axis without the others
    assert 0.6 * force < pressed.max() < 1.7 * force or force == pressed.max() == 0.0
    state = setup.arm.state(q0)
    expected = np.abs(state.gravity + (asked @ setup.axes) @ state.jacobian[:3]).max(axis=0)
    assert (np.abs(motion.tau).max(axis=0) < expected + 15.0).all()  # [N·m], link friction and turning


def test_slow_growth_is_told_in_per_cent() -> None:
    assert _growth(1.0004) == "errors grow by 0.04 % a period"
    assert _growth(1.5) == "errors grow 1.5 times a period"


@pytest.mark.parametrize(
    ("bad", "words"),
    [
        ({"seed": "x"}, "seed 'x'"),
        ({"seed": -1}, "seed -1"),
        ({"seed": 1.5}, "seed 1.5"),
        ({"seed": True}, "seed True"),
        ({"torque_limit": "x"}, "torque limits 'x'"),
        ({"torque_limit": [1.0, 2.0]}, "torque limits 1, 2"),
        ({"name": None}, "experiment 'None'"),
        ({"material": 5}, "material '5'"),
        ({"gains": 5200.0}, "gains '5200.0'"),
        ({"point": "here"}, "point 'here'"),
        ({"normal": (0.0, 1.0)}, "normal of shape"),
    ],
)
def test_what_an_experiment_is_not_prepared_of(bad: dict[str, Any], words: str) -> None:
    with pytest.raises(InputError, match=words):
        prepare(**({"name": "poke"} | bad))
