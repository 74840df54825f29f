"""The shipped LWR4+ against published check values: kinematics, inertias, gravity, mass matrix, limits."""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from kinid import urdf

Array = NDArray[np.float64]
URDF = urdf.path("lwr4plus", Path.cwd())
LIMITS = np.radians([170, 120, 170, 120, 170, 120, 170])

# q [deg], flange position [m], flange quaternion wxyz (0.3105 m to the shoulder);
# seven published models agree on these to 2.5e-16
POSES = {
    "A": ((0, 0, 0, 0, 0, 0, 0), (0, 0, 1.178500000), (1, 0, 0, 0)),
    "B": ((0, 30, 0, -60, 0, 60, 0), (-0.629000000, 0, 0.589360180), (0.258819045, 0, -0.965925826, 0)),
    "C": (
        (20, 45, -15, -90, 10, 60, 30),
        (-0.533042018, -0.087909577, 0.251144145),
        (0.102135402, 0.240644035, 0.963399840, 0.059325849),
    ),
    "D": (
        (-70, -40, 100, 75, -120, -80, 150),
        (0.481316908, -0.194887733, 0.725634452),
        (0.646359589, 0.705731990, 0.265041058, 0.117961340),
    ),
    "E": (
        (169, 119, -169, -119, 169, 119, -169),
        (0.390162691, -0.155042333, 0.461117171),
        (0.493692648, 0.324328155, 0.806894552, 0.000000000),
    ),
}

# mass [kg], com [m], inertia about the com: xx yy zz xy xz yz [kg m^2]
INERTIALS = {
    "base_link": (1.6, (-0.0006, 0, 0.0482), (0.00347, 0.00371, 0.00406, 0, -0.00005, 0)),
    "link_1": (2.7, (0, 0.0233, 0.1122), (0.017497, 0.017231, 0.004887, 0, 0, -0.003538)),
    "link_2": (2.7, (0.0003, -0.0227, 0.0785), (0.013225, 0.013133, 0.004656, 0.000002, 0.000012, -0.002187)),
    "link_3": (2.7, (0.0002, -0.0173, 0.0681), (0.014394, 0.014231, 0.004745, -0.000021, 0.000074, 0.002968)),
    "link_4": (2.7, (-0.0005, 0.0170, 0.0656), (0.010764, 0.010733, 0.004546, 0.000005, -0.000060, 0.001797)),
    "link_5": (1.7, (0.0002, 0.0211, 0.0398), (0.005306, 0.005311, 0.002772, -0.000007, -0.000035, -0.001149)),
    "link_6": (1.6, (0, 0.0010, 0.0039), (0.002728, 0.002544, 0.002977, -0.000001, 0.000010, 0.000072)),
    "link_7": (0.3, (-0.0008, 0.0028, -0.0159), (0.000107, 0.000106, 0.000183, 0, 0, 0)),
}

# Gaz, Flacco, De Luca, ICRA 2014, as coded in govons99/MS_KUKA_LWR (get_gnum.m, get_Bnum.m), 9.80665 m/s²:
# q [deg], gravity torques [N m], diagonal of the mass matrix without rotors [kg m^2]
CONTROLLER = (
    (
        (0, 0, 0, 0, 0, 0, 0),
        (0, -0.0129, 0, 0.0355, 0, 0.0053, 0),
        (0.0288, 2.7367, 0.0172, 0.4340, 0.0065, 0.0038, 0.00012),
    ),
    (
        (0, 90, 0, 0, 0, 0, 0),
        (0, -47.263, -0.404, 13.363, -0.408, -0.281, -0.009),
        (2.747, 2.737, 0.0172, 0.434, 0.0065, 0.0038, 0.00012),
    ),
    (
        (0, 30, 0, -60, 0, 60, 0),
        (0, -30.158, -0.202, 13.227, -0.408, -0.145, -0.005),
        (1.279, 2.192, 0.3356, 0.4277, 0.0072, 0.0038, 0.00012),
    ),
    (
        (20, 45, -15, -90, 10, 60, 30),
        (0, -32.675, -2.659, 9.111, -0.310, 0.063, 0.001),
        (1.363, 1.634, 0.4346, 0.4277, 0.0072, 0.0038, 0.00012),
    ),
)


@cache
def model() -> Any:
    built = pin.buildModelFromUrdf(str(URDF))
    built.gravity.linear = np.array([0.0, 0.0, -9.80665])
    return built


def frame(q: Array, name: str) -> Any:
    """Placement of a frame in base_link."""
    data = model().createData()
    pin.framesForwardKinematics(model(), data, q)
    return data.oMf[model().getFrameId(name)]


def denavit_hartenberg(q: Array) -> Array:
    """base → flange by the standard DH table, (4, 4): an implementation that shares nothing with the URDF."""
    offsets, twists = (0.3105, 0, 0.4, 0, 0.39, 0, 0.078), np.radians((90, -90, -90, 90, 90, -90, 0))
    pose = np.eye(4)
    for theta, d, alpha in zip(q, offsets, twists):
        (s, c), (sa, ca) = (np.sin(theta), np.cos(theta)), (np.sin(alpha), np.cos(alpha))
        pose @= np.array([[c, -s * ca, s * sa, 0], [s, c * ca, -c * sa, 0], [0, sa, ca, d], [0, 0, 0, 1]])
    return pose


def rotation(w: float, x: float, y: float, z: float) -> Array:
    """Rotation matrix of a unit quaternion, (3, 3)."""
    v = np.array([x, y, z])
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return (w * w - v @ v) * np.eye(3) + 2 * np.outer(v, v) + 2 * w * cross


def inertia_matrix(xx: float, yy: float, zz: float, xy: float, xz: float, yz: float) -> Array:
    return np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])


@pytest.mark.parametrize("pose", POSES)
def test_forward_kinematics_gives_the_published_values(pose: str) -> None:
    degrees, position, quaternion = POSES[pose]
    q = np.radians(degrees)
    flange = frame(q, "flange")
    # the table has nine decimals, so its own rounding is up to 0.5e-9
    np.testing.assert_allclose(flange.translation, position, rtol=0, atol=1e-9)
    # an entry of the matrix is a sum of products of rounded quaternion entries: up to about 4 × 0.5e-9
    np.testing.assert_allclose(flange.rotation, rotation(*quaternion), rtol=0, atol=3e-9)
    np.testing.assert_allclose(flange.homogeneous, denavit_hartenberg(q), rtol=0, atol=1e-12)


@settings(max_examples=100, deadline=None, derandomize=True)
@given(st.lists(st.floats(-1, 1), min_size=7, max_size=7))
def test_forward_kinematics_is_the_dh_table_everywhere(share: list[float]) -> None:
    q = np.array(share) * LIMITS
    # a chain of 7 rotations and 1.2 m in double precision: some 1e-15
    np.testing.assert_allclose(frame(q, "flange").homogeneous, denavit_hartenberg(q), rtol=0, atol=1e-13)


def test_frames_and_joints_have_the_names_of_the_contract() -> None:
    tree = ElementTree.parse(URDF)
    links = [link.get("name") for link in tree.iter("link")]
    assert links == ["base_link", *(f"link_{i}" for i in range(1, 8)), "flange", "ft_sensor", "tool_tip"]
    assert list(model().names)[1:] == [f"joint_{i}" for i in range(1, 8)]
    assert all(model().existFrame(name) for name in links)


def test_sensor_and_tool_stand_on_the_flange_with_parallel_axes() -> None:
    q = np.radians(POSES["D"][0])
    flange, sensor, tip = (frame(q, name) for name in ("flange", "ft_sensor", "tool_tip"))
    for placement, height in ((sensor, 0.0122), (tip, 0.1122)):  # Mini40: 12.2 mm; tool: 100 mm beyond it
        relative = flange.actInv(placement)
        np.testing.assert_allclose(relative.homogeneous[:3, :3], np.eye(3), rtol=0, atol=1e-14)
        np.testing.assert_allclose(relative.translation, (0, 0, height), rtol=0, atol=1e-14)


def test_limits_are_those_of_the_lwr4plus() -> None:
    np.testing.assert_allclose(model().upperPositionLimit, LIMITS, rtol=0, atol=1e-12)
    np.testing.assert_allclose(model().lowerPositionLimit, -LIMITS, rtol=0, atol=1e-12)
    velocity = np.radians([110, 110, 128, 128, 204, 184, 184])
    np.testing.assert_allclose(model().velocityLimit, velocity, rtol=0, atol=1e-12)
    np.testing.assert_array_equal(model().effortLimit, [176, 176, 100, 100, 100, 38, 38])


def test_inertials_are_the_table_and_only_the_bare_arm_has_them() -> None:
    found = {}
    for link in ElementTree.parse(URDF).iter("link"):
        inertial = link.find("inertial")
        if inertial is None:
            continue
        origin, mass, inertia = (inertial.find(tag) for tag in ("origin", "mass", "inertia"))
        assert origin is not None
        assert mass is not None
        assert inertia is not None
        assert origin.get("rpy") is None  # inertia in link axes
        com = tuple(float(v) for v in origin.attrib["xyz"].split())
        six = tuple(float(inertia.attrib[key]) for key in ("ixx", "iyy", "izz", "ixy", "ixz", "iyz"))
        found[link.get("name")] = (float(mass.attrib["value"]), com, six)
    assert found == INERTIALS
    assert sum(mass for mass, _, _ in found.values()) == pytest.approx(16.0, abs=1e-12)


def test_the_model_has_these_inertias_and_no_weight_of_sensor_or_tool() -> None:
    for i in range(1, 8):
        mass, com, six = INERTIALS[f"link_{i}"]
        inertia = model().inertias[i]
        assert inertia.mass == pytest.approx(mass, abs=1e-12)
        np.testing.assert_allclose(inertia.lever, com, rtol=0, atol=1e-12)
        np.testing.assert_allclose(inertia.inertia, inertia_matrix(*six), rtol=0, atol=1e-12)


@pytest.mark.parametrize("name", INERTIALS)
def test_inertias_are_those_of_a_real_body(name: str) -> None:
    mass, com, six = INERTIALS[name]
    about_com = inertia_matrix(*six)
    smallest, middle, largest = np.linalg.eigvalsh(about_com)
    assert 0 < smallest <= middle <= largest < smallest + middle  # triangle inequality, strict: no flat body
    c = np.asarray(com)
    second_moment = 0.5 * np.trace(about_com) * np.eye(3) - about_com + mass * np.outer(c, c)
    pseudo = np.block([[second_moment, mass * c[:, None]], [mass * c[None, :], np.array([[mass]])]])
    assert np.linalg.eigvalsh(pseudo)[0] > 1e-5  # [kg m^2]; the least published one, link 7's, is 1.5e-5


@pytest.mark.parametrize(("degrees", "gravity", "diagonal"), CONTROLLER)
def test_gravity_and_mass_matrix_are_the_controllers(degrees: Any, gravity: Any, diagonal: Any) -> None:
    q, data = np.radians(degrees), model().createData()
    error = pin.computeGeneralizedGravity(model(), data, q) - gravity
    # twice the fit's rms error on 500 fresh poses, joints 2 to 7 [N m], and its largest; joint 1 feels no
    # gravity. Joint 7's 0.8 mN m is near the rounding of the table (0.5 mN m), which is added.
    rms = np.array([0, 0.07, 0.05, 0.06, 0.025, 0.023, 0.0008])
    assert np.all(np.abs(error) <= 2 * rms + 5e-4)
    assert np.abs(error).max() <= 0.14
    found = np.diag(pin.crba(model(), data, q))
    # 3 % is the fit's largest relative error of the whole matrix; 5e-4 kg m^2 lets the small entries, which
    # hardly count in that norm, keep their own error (the table prints four decimals)
    np.testing.assert_allclose(found, diagonal, rtol=0.03, atol=5e-4)


def test_mujoco_reads_the_same_robot() -> None:
    import mujoco

    other = mujoco.MjModel.from_xml_path(str(URDF))
    state = mujoco.MjData(other)
    assert other.body_mass.sum() == pytest.approx(16.0, abs=1e-9)  # it invents no mass for sensor and tool
    other.opt.gravity[:] = model().gravity.linear
    for degrees, _, _ in POSES.values():
        q = np.radians(degrees)
        state.qpos[:] = q
        mujoco.mj_forward(other, state)
        gravity = pin.computeGeneralizedGravity(model(), model().createData(), q)
        np.testing.assert_allclose(state.qfrc_bias, gravity, rtol=0, atol=1e-9)  # 50 N m in double precision
        tip = frame(q, "tool_tip").translation
        np.testing.assert_allclose(state.body("tool_tip").xpos, tip, rtol=0, atol=1e-12)
