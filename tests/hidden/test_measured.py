"""What is planted in measured logs is in them, and nothing else is changed."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from hidden.case import Case
from hidden.measured import SOURCES, known, measured
from hidden.world.arm import GRAVITY, forward

pytestmark = pytest.mark.real


def readings(log: object) -> np.ndarray:
    for name in ("tau", "wrench"):
        if (values := getattr(log, name)) is not None:
            return np.asarray(values)
    return np.asarray(log.contact["normal_force"])[:, None]  # type: ignore[attr-defined]


@pytest.fixture(scope="module")
def planted(real_data: Path) -> list[tuple[Case, np.ndarray, np.ndarray]]:
    """Every source with every plant: the case, readings before and after."""
    raw = known(real_data)
    count = sum(len(source.plants) for source in SOURCES)
    return [
        (case, readings(raw[case.note.split(":")[0]][0]), readings(case.log)) for case in measured(count, 3, real_data)
    ]


def test_every_plant_comes_once_and_leaves_the_motion_alone(planted: list, real_data: Path) -> None:
    raw = known(real_data)
    names = {(case.note.split(":")[0], *case.truth) for case, _, _ in planted}
    assert names == {(source.name, effect) for source in SOURCES for effect in source.plants}
    for case, before, after in planted:
        log = raw[case.note.split(":")[0]][0]
        assert not np.array_equal(before, after)
        np.testing.assert_array_equal(case.log.t, log.t)
        for name in ("q", "dq", "ddq"):
            if getattr(log, name) is not None:
                np.testing.assert_array_equal(getattr(case.log, name), getattr(log, name))
        for name, values in log.contact.items():
            if name != "normal_force":
                np.testing.assert_array_equal(case.log.contact[name], values)
        assert not case.truth & set(case.model)
        assert set(case.true_model) == set(case.model) | case.truth


def test_a_shift_is_where_both_streams_agree_best(planted: list) -> None:
    shown = 0
    for case, before, after in planted:
        if "time-offset" not in case.truth:
            continue
        late = float(case.note.split(" by ")[1].split(" s")[0])
        t = case.log.t
        away = np.linspace(late - 5e-3, late + 5e-3, 201)
        inside = (t > t[0] + 0.1) & (t < t[-1] - 0.1)
        apart = [np.mean((np.interp(t[inside] - d, t, before[:, 0]) - after[inside, 0]) ** 2) for d in away]
        assert away[int(np.argmin(apart))] == pytest.approx(late, abs=2e-3)  # half a period of the slowest log is 5 ms
        shown += 1
    assert shown >= 4


def test_marks_of_converters(planted: list) -> None:
    for case, before, after in planted:
        if "saturation" in case.truth:
            top = np.abs(after).max(axis=0)
            assert (top < np.abs(before).max(axis=0)).all()
            assert ((np.abs(after) == top).sum(axis=0) >= 3).all()
        if "quantization" in case.truth:
            assert max(len(np.unique(column)) for column in after.T) < 0.3 * len(after)
            gap = np.diff(np.unique(after[:, 0]))
            np.testing.assert_allclose(gap / gap.min(), np.round(gap / gap.min()), atol=1e-6)


def test_poses_turn_the_tool_as_it_was_turned(real_data: Path) -> None:
    """With the log's joints, the weight of the rig's tool explains the measured forces as well as in the table of the
    data.
    """
    log, rig, _ = known(real_data)["med14-poses"]
    weight = rig.tool.mass * forward(np.asarray(log.q)).rotation.transpose(0, 2, 1) @ [0.0, 0.0, -GRAVITY]
    assert rig.tool.mass == pytest.approx(0.932, abs=0.003)
    assert rig.tool.com[2] == pytest.approx(43.9e-3, abs=0.5e-3)
    force = np.asarray(log.wrench)[:, :3] - weight
    torque = np.asarray(log.wrench)[:, 3:] - np.cross(rig.tool.com, weight)
    print(f"\nresidual {np.sqrt((force**2).mean()):.3f} N, {1e3 * np.sqrt((torque**2).mean()):.2f} mN·m", end="")
    assert np.sqrt((force**2).mean()) < 0.1
    assert np.sqrt((torque**2).mean()) < 4e-3


def test_a_planted_body_weighs_what_it_should(planted: list) -> None:
    """The second joint holds it against gravity: its torque changes by no more than the body's reach allows."""
    for case, before, after in planted:
        if "payload" in case.truth:
            mass = float(case.note.split("body of ")[1].split(" kg")[0])
            change = np.abs(after - before)[:, 1].max()
            assert 0.2 * mass * GRAVITY < change < 1.1 * mass * (GRAVITY + 3.0)


def test_the_same_seed_plants_the_same(real_data: Path) -> None:
    one, two = list(measured(4, 7, real_data)), list(measured(4, 7, real_data))
    for a, b in zip(one, two):
        assert (a.name, a.note) == (b.name, b.note)
        np.testing.assert_array_equal(readings(a.log), readings(b.log))
