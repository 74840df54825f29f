"""`kinid shape` as a user meets it: raw logs of an unknown surface to a mesh that `kinid contact` takes."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import curved
import numpy as np
import pytest
from curved import DOWN, RADIUS, RATE
from scripted import RIG, follow

from kinid.data.rig import Rig
from kinid.robotics.robot import Robot
from kinid.robotics.wrench import tool_load
from kinid.writers import write_table

Run = Callable[..., tuple[int, str, str]]
#: the rig of the other experiments without its surface
TEXT = "[surface]".join(RIG.split("[surface]")[:1]) + "[sensor]" + RIG.split("[sensor]")[1]
#: speeds of the way between touches, and of the touches [m/s]
TRAVEL, SPEED = 0.05, 0.02


def path(phantom: curved.Phantom) -> np.ndarray:
    """Of the ball's middle: from above, over sixteen touches, (n, 3)."""
    parts = [phantom.path(place, DOWN, 0.025, SPEED) for place in phantom.points(phantom.region(0.015))]
    ways = [np.repeat(parts[0][:1], 100, axis=0), parts[0]]
    for before, part in zip(parts, parts[1:]):
        steps = max(2, round(float(np.linalg.norm(part[0] - before[-1])) / TRAVEL * RATE))
        ways += [before[-1] + np.linspace(0.0, 1.0, steps)[:, None] * (part[0] - before[-1]), part]
    return np.concatenate(ways)


@pytest.fixture(scope="module")
def touched(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, np.ndarray, np.ndarray]:
    """A log of sixteen touches of a saddle, its rig beside it, the true depth and the true normal force."""
    folder, rng = tmp_path_factory.mktemp("saddle"), np.random.default_rng(310)
    phantom = curved.saddle(rng, friction=0.3)
    middle = path(phantom)
    force, depth = phantom.pushed(middle)
    rig = Rig.parse_text(TEXT)
    robot = Robot.load(rig)
    t = np.arange(len(middle)) / RATE
    q = follow(robot, middle + RADIUS * DOWN, np.zeros((len(t), 2)))
    dq = np.gradient(q, t, axis=0)
    sensor = robot.kinematics("ft_sensor", q, dq, np.gradient(dq, t, axis=0))
    pushed = np.einsum("nji,nj->ni", sensor.rotation, force)
    wrench = tool_load(rig.carried, sensor, robot.gravity)
    wrench[:, :3] += pushed
    wrench[:, 3:] += np.cross(robot.tip_in_sensor(), pushed)
    wrench += rng.normal(scale=[0.02, 0.02, 0.02, 5e-4, 5e-4, 3e-4], size=wrench.shape)
    columns = {"t": t} | {f"q{j + 1}": np.round(q[:, j] / 2e-6) * 2e-6 for j in range(7)}
    columns |= dict(zip(("fx", "fy", "fz", "tx", "ty", "tz"), wrench.T))
    write_table(folder / "log.parquet", columns)
    (folder / "rig.toml").write_text(TEXT, encoding="utf-8")
    normal = np.einsum("ni,ni->n", force, phantom.closest(middle)[1])
    return folder / "log.parquet", depth, normal


def test_a_mesh_from_touches_gives_contact_frame_depth(
    run: Run, touched: tuple[Path, np.ndarray, np.ndarray], tmp_path: Path
) -> None:
    """A saddle that no rig states: its mesh, and with that the depth of the same touches, 37° steep at the rim."""
    log, depth, normal = touched
    mesh, facts = log.parent / "surface.stl", tmp_path / "shape.json"
    code, said, err = run("shape", log, "-o", mesh, "--json", facts, "--plot", tmp_path / "page.html", "--next", "2")
    assert code == 0, err
    assert 'mesh = "surface.stl"' in said
    found = json.loads(facts.read_text())
    assert found["probes"] == len(found["touches"]) == 16
    assert len(found["next"]) == 2
    assert found["left_out"] < 5e-4
    assert found["properties"]["stiffness"]["lowest"] == pytest.approx(curved.SOFT, rel=0.05)
    assert found["properties"]["stiffness"]["highest"] == pytest.approx(2 * curved.SOFT, rel=0.05)
    page = (tmp_path / "page.html").read_text(encoding="utf-8")
    assert "mesh3d" in page
    assert "stiffness [N/m]" in page
    rig = log.parent / "with-mesh.toml"
    rig.write_text(TEXT + '\n[surface]\nmesh = "surface.stl"\n', encoding="utf-8")
    code, _, err = run("contact", log, "--rig", rig, "-o", tmp_path / "contact.npz")
    assert code == 0, err
    table = np.load(tmp_path / "contact.npz")
    deep = depth > 2e-4
    off = table["depth"][deep] - depth[deep]
    assert np.sqrt(np.mean(off**2)) < 1e-4
    assert np.sqrt(np.mean((table["normal_force"][deep] - normal[deep]) ** 2)) < 0.05
    assert table["in_contact"][deep].mean() > 0.98


def test_the_ball_is_taken_off_where_it_is_stated(
    run: Run, touched: tuple[Path, np.ndarray, np.ndarray], tmp_path: Path
) -> None:
    log, out = touched[0], tmp_path / "surface.obj"
    code, said, err = run("shape", log, "-o", out, "--tip-radius", RADIUS, "--json", tmp_path / "shape.json")
    assert code == 0, err
    assert "a ball of 4 mm" in said
    phantom = curved.saddle(np.random.default_rng(310), friction=0.3)
    vertices = np.array([line.split()[1:4] for line in out.read_text().splitlines() if line.startswith("v ")], float)
    assert np.sqrt(np.mean(phantom.closest(vertices)[0] ** 2)) < 1e-4
    for touch in json.loads((tmp_path / "shape.json").read_text())["touches"]:
        assert abs(phantom.closest(np.array([touch["place"]]))[0][0]) < 1.5e-4


def test_wrong_questions_are_refused(
    run: Run, refused: Callable[..., None], touched: tuple[Path, np.ndarray, np.ndarray], tmp_path: Path, log: Path
) -> None:
    asked, out = touched[0], tmp_path / "surface.stl"
    refused(run("shape", asked, "-o", tmp_path / "surface.parquet"), ".stl")
    refused(run("shape", asked, "-o", out, "--tip-radius", "4"), "--tip-radius")
    refused(run("shape", asked, "-o", out, "--next", "-1"), "--next")
    refused(run("shape", asked, "-o", out, "--model", "relaxation"), "law of contact")
    refused(run("shape", asked, "-o", out, "--next", "1", "--property", "colour"), "colour", "stiffness")
    refused(run("shape", log, "-o", out), "1 touches")
    assert not out.exists()
