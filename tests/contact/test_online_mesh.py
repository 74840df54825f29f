"""Inside the loop on a mesh: the same numbers as offline, sample by sample."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import trimesh
from scripted import RIG, Scripted, scripted_poke

from kinid.contact.online import OnlineContact, OnlineEstimator
from kinid.contact.series import contact_series
from kinid.data.log import Log
from kinid.data.rig import CONTACT, Rig
from kinid.estimators import KelvinVoigt
from kinid.signal.derivative import Differentiator


@pytest.fixture(scope="module")
def scripted() -> Scripted:
    return scripted_poke(seed=8)


def dome(folder: Path, bias: list[float], curvature: float, extra: str = "") -> Rig:
    """A rig whose surface is a sheet that bends away from the plane's point [1/m], its faces some 4 mm wide."""
    side = np.linspace(-0.1, 0.1, 51)
    x, y = np.meshgrid(side, side, indexing="ij")
    points = np.stack([0.55 + x, y, 0.10 - 0.5 * curvature * (x**2 + y**2)], axis=-1).reshape(-1, 3)
    number = np.arange(51 * 51).reshape(51, 51)
    a, b, c, d = (part.ravel() for part in (number[:-1, :-1], number[1:, :-1], number[1:, 1:], number[:-1, 1:]))
    faces = np.concatenate([np.stack([a, b, c], axis=1), np.stack([a, c, d], axis=1)])
    trimesh.Trimesh(points, faces, process=False).export(folder / "dome.ply")
    plane = "point = [0.55, 0.0, 0.10]\nnormal = [0, 0, 1]\ntangent = [1, 0, 0]\n"
    assert plane in RIG
    text = RIG.replace(plane, 'mesh = "dome.ply"\ntangent = [1, 0, 0]\n') + f"bias = {bias}\n" + extra
    return Rig.parse_text(text, folder=folder)


@pytest.mark.parametrize("curvature", [0.0, 4.0], ids=["flat", "curved"])
def test_sample_by_sample_gives_what_the_log_gives(scripted: Scripted, tmp_path: Path, curvature: float) -> None:
    bias = scripted.bias.tolist()
    rig, log = dome(tmp_path, bias, curvature), scripted.log
    assert log.q is not None
    assert log.wrench is not None
    dq = np.gradient(log.q, log.t, axis=0)
    ddq = np.gradient(dq, log.t, axis=0)
    rows = slice(2000, 6500, 3)
    some = Log(log.t[rows], q=log.q[rows], dq=dq[rows], ddq=ddq[rows], wrench=log.wrench[rows])
    offline = contact_series(some, rig, bias=bias, differentiator=Differentiator())
    online = OnlineContact(rig)
    found, places = [], []
    for sample in zip(some.t.tolist(), some.q, some.wrench, some.dq, some.ddq):  # type: ignore[arg-type]
        found.append(online.step(*sample).copy())
        places.append(online.place)
    table = np.array(found)
    assert (table[:, CONTACT.index("depth")] > 1e-3).any()
    for column, name in enumerate(CONTACT):
        # slips add up 1,500 steps
        np.testing.assert_allclose(table[:, column], getattr(offline, name), atol=1e-11, err_msg=name)
    height = np.array(places)[:, 2] - 0.10
    np.testing.assert_allclose(
        height, -0.5 * curvature * np.sum((np.array(places)[:, :2] - (0.55, 0.0)) ** 2, axis=1), atol=2e-5
    )
    online.reset()
    first = online.step(0.0, some.q[0], some.wrench[0])  # type: ignore[index]
    assert first[CONTACT.index("slip1")] == first[CONTACT.index("slip2")] == 0.0  # a new log begins


def test_an_estimate_on_a_mesh_is_that_on_its_plane(scripted: Scripted, tmp_path: Path) -> None:
    bias, log = scripted.bias.tolist(), scripted.log
    rigs = Rig.parse_text(RIG + f"bias = {bias}\n"), dome(tmp_path, bias, 0.0)
    loops = [OnlineEstimator(OnlineContact(rig), KelvinVoigt().online()) for rig in rigs]
    for t, q, wrench in zip(log.t.tolist(), log.q, log.wrench):  # type: ignore[arg-type]
        plane, mesh = (loop.update(t, q, wrench) for loop in loops)
    assert plane.updates > 1000
    # the PLY file holds single precision: 30 nm of the depth
    np.testing.assert_allclose(mesh.values, plane.values, rtol=1e-5)


def test_a_sample_that_is_not_finite_changes_nothing(scripted: Scripted, tmp_path: Path) -> None:
    bias, log = scripted.bias.tolist(), scripted.log
    online = OnlineContact(dome(tmp_path, bias, 4.0))
    q, wrench = log.q[3000], log.wrench[3000]  # type: ignore[index]
    before = online.step(0.0, q, wrench).copy()
    assert np.isnan(online.step(0.1, q * np.nan, wrench)).all()
    broken = online.step(0.2, q, wrench * np.nan).copy()
    assert broken[CONTACT.index("depth")] == before[CONTACT.index("depth")]
    assert np.isnan(broken[CONTACT.index("normal_force")])
    np.testing.assert_allclose(online.step(0.3, q, wrench)[2:4], before[2:4], atol=1e-15)


def test_a_delayed_sample_has_its_own_place_on_the_mesh(scripted: Scripted, tmp_path: Path) -> None:
    """Both ways add up slips of their own: at one instant they agree."""
    bias, log = scripted.bias.tolist(), scripted.log
    online = OnlineContact(dome(tmp_path, bias, 4.0))
    now: dict[float, np.ndarray] = {}
    later: dict[float | None, np.ndarray] = {}
    for t, q, wrench in zip(log.t[2000:5000].tolist(), log.q[2000:5000], log.wrench[2000:5000]):  # type: ignore[index]
        now[t] = online.step(t, q, wrench).copy()
        while online.next_delayed():
            later[online.delayed_time] = online.delayed.copy()
    assert len(later) > 2900
    # an encoder's steps are 2 µrad, at an arm of a metre; where the motion begins with a kink a cubic over 16 ms to
    # both sides cuts the corner, by some 12 µm
    for name in ("depth", "slip1", "slip2"):
        j = CONTACT.index(name)
        apart = [x[j] - now[t][j] for t, x in later.items() if t is not None]
        np.testing.assert_allclose(apart, 0.0, atol=2e-5, err_msg=name)
