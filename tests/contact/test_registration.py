"""A plane found by touching it: recovered within its own intervals, and refused when touches leave it open."""

from __future__ import annotations

import numpy as np
import pytest
from scripted import follow

import kinid
from kinid.contact.registration import find_surface
from kinid.data.log import Log
from kinid.data.rig import Rig, surface_axes
from kinid.errors import InputError
from kinid.robotics.robot import Robot
from kinid.robotics.wrench import tool_load

RIG = """
[robot]
model = "lwr4plus"
[tool]
mass = 0.24
com = [0.0, 0.0, 0.049]
"""
POINT, NORMAL = (
    np.array([0.56, 0.01, 0.12]),
    np.array([0.06, -0.09, 1.0]) / np.linalg.norm([0.06, -0.09, 1.0]),
)
RATE = 250.0
STIFFNESS = 2000.0  # of the material at an exponent of 1 [N/m]
CORNERS = ((-0.03, -0.03), (0.03, -0.03), (0.03, 0.03), (-0.03, 0.03), (0.0, 0.0))


def touching(corners: tuple[tuple[float, float], ...], seed: int, exponent: float = 1.3) -> Log:
    """The tip goes straight down at each corner, 4 mm into a material with a power law, and up again."""
    rig = Rig.parse_text(RIG)
    robot = Robot.load(rig)
    rng = np.random.default_rng(seed)
    path = [np.full((int(0.5 * RATE), 3), [*corners[0], 0.02])]
    for x, y in corners:
        u = np.linspace(0, 1, int(1.2 * RATE))
        height = 0.02 - 0.024 * np.sin(np.pi * u) ** 2
        path.append(np.column_stack([np.full_like(u, x), np.full_like(u, y), height]))
    s = np.concatenate(path)
    # moves between corners are smooth enough at 20 mm height for a log: the tip glides there
    for axis in (0, 1, 0, 1, 0, 1):
        s[:, axis] = np.convolve(np.pad(s[:, axis], 12, mode="edge"), np.ones(25) / 25, mode="valid")
    axes = surface_axes(tuple(NORMAL))
    q = follow(robot, POINT + s @ axes, np.zeros((len(s), 2)))
    t = np.arange(len(s)) / RATE
    dq = np.gradient(q, t, axis=0)
    tip = robot.kinematics("tool_tip", q, dq)
    depth = np.maximum(-(tip.position - POINT) @ NORMAL, 0.0)
    force = (STIFFNESS * (depth / 0.004) ** exponent * 0.004)[:, None] * NORMAL
    sensor = robot.kinematics("ft_sensor", q, dq, np.gradient(dq, t, axis=0))
    wrench = tool_load(rig.tool, sensor, robot.gravity)  # type: ignore[arg-type]
    local = np.einsum("nji,nj->ni", sensor.rotation, force)
    wrench += np.concatenate([local, np.cross(robot.tip_in_sensor(), local)], axis=1)
    bias = [0.4, -0.3, 1.0, 0.01, 0.0, 0.0]
    wrench += bias + rng.normal(scale=[0.015, 0.015, 0.029, 5e-4, 6e-4, 3e-4], size=wrench.shape)
    return Log(t, q=q, wrench=wrench)


@pytest.mark.parametrize("exponent", [1.0, 1.3, 1.5])
def test_a_tilted_plane_is_found_by_five_touches(exponent: float) -> None:
    found = find_surface([touching(CORNERS, seed=3, exponent=exponent)], Rig.parse_text(RIG))
    assert len(found.onsets) == len(CORNERS)
    pasted = Rig.parse_text("\n".join(found.toml())).surface
    assert pasted is not None
    np.testing.assert_allclose([*pasted.point, *pasted.normal], [*found.plane.point, *found.plane.normal], atol=1e-5)
    height = (found.plane.point - POINT) @ NORMAL
    tilt = np.degrees(np.arccos(np.clip(found.plane.normal @ NORMAL, -1, 1)))
    print(f"exponent {exponent}: height off by {1e3 * height:+.3f} mm, tilt by {tilt:.3f}°")
    # onsets are sampled every 0.1 to 0.3 mm of travel at this speed; the force law is not the extrapolation's
    assert abs(height) < 0.15e-3
    assert tilt < 0.2


def test_the_plane_lies_within_its_interval() -> None:
    inside = 0
    for seed in range(10):
        found = find_surface([touching(CORNERS, seed=seed, exponent=1.0)], Rig.parse_text(RIG))
        low, high = found.offset_interval
        inside += low <= (POINT - found.plane.point) @ found.plane.normal <= high
    # a 95 % interval misses more than 3 of 10 with a probability of 0.001
    assert inside >= 7


def test_two_touches_and_touches_in_a_line_are_refused() -> None:
    with pytest.raises(InputError, match="2 touches"):
        find_surface([touching(CORNERS[:2], seed=0)], Rig.parse_text(RIG))
    line = ((-0.03, 0.0), (0.0, 0.0), (0.03, 0.0))
    with pytest.raises(InputError):
        find_surface([touching(line, seed=0)], Rig.parse_text(RIG))


def test_what_a_rig_says_of_its_surface_reaches_the_fit() -> None:
    """A surface that is 0.15 mm and 6 mrad off, as a rig says that it may be, is fitted along: little is left then."""
    log = touching(CORNERS, 5, exponent=1.0)
    tilted = NORMAL + 0.006 * surface_axes(tuple(NORMAL))[0]
    surface = {"point": tuple(POINT + 1.5e-4 * NORMAL), "normal": tuple(tilted)}
    fits = {}
    for name, known in (("silent", {}), ("said", {"offset_sd": 1.5e-4, "tilt_sd": 5e-3})):
        rig = Rig.model_validate({**Rig.parse_text(RIG).model_dump(), "surface": {**surface, **known}})
        fits[name] = kinid.Model("hooke").fit(kinid.contact_series(log, rig))
    silent, said = (fits[name]["stiffness"] for name in ("silent", "said"))
    assert said.low <= STIFFNESS <= said.high
    assert said.high - said.low < 0.2 * (silent.high - silent.low)


def test_a_found_surface_says_how_well_it_is_known() -> None:
    """In the rig that it goes into, as standard deviations, which three touches have as well."""
    for corners in (CORNERS, CORNERS[:3]):
        found = find_surface(touching(corners, 6), Rig.parse_text(RIG))
        surface = found.rig.surface
        assert surface is not None
        assert surface.offset_sd is not None
        assert surface.tilt_sd is not None
        assert abs((np.array(surface.point) - POINT) @ NORMAL) < 3 * surface.offset_sd < 1e-3
        assert np.linalg.norm(np.cross(surface.normal, NORMAL)) < 3 * surface.tilt_sd < 0.03
