"""Trajectories on disk and on screen."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pytest
from pyarrow import parquet

import kinid
from kinid.errors import InputError
from kinid.planning import Guard, Law, Multisine, Planner, Poke, Protocol, Trajectory, read_trajectory


@pytest.fixture(scope="module")
def motion(rig: Any, law: Law) -> Trajectory:
    return Planner(rig, Protocol(rate=100.0, guard=Guard(20.0)), law).plan(
        [Poke(signal=Multisine(0.004, ((0.001, 1.0),), 1.0))]
    )


@pytest.mark.parametrize("suffix", ["parquet", "csv", "npz"])
def test_what_is_written_is_read(motion: Trajectory, tmp_path: Path, suffix: str) -> None:
    path = tmp_path / f"plan.{suffix}"
    motion.write(path)
    back = read_trajectory(path, motion.joint_names)
    for name in ("t", "q", "dq", "ddq", "tip", "place", "normal_force", "force", "force_limit", "touch"):
        np.testing.assert_array_equal(getattr(back, name), getattr(motion, name), err_msg=name)
    assert back.phase.tolist() == motion.phase.tolist()
    assert back.joint_names == motion.joint_names
    if suffix == "parquet":
        assert back.provenance["law"]["values"]["hunt-crossley.stiffness"] == 1200.0
        assert back.provenance["guard"]["then"] == "retract"
    assert list(tmp_path.iterdir()) == [path]


def test_positions_alone_are_a_trajectory_too(tmp_path: Path) -> None:
    t = np.linspace(0, 2, 101)
    rows = "\n".join(f"{a},{np.sin(a)},{np.cos(a)}" for a in t)
    (tmp_path / "own.csv").write_text(f"t,q1,q2\n{rows}\n", encoding="utf-8")
    own = read_trajectory(tmp_path / "own.csv")
    np.testing.assert_allclose(own.dq[:, 0], np.cos(t), atol=1e-6)
    np.testing.assert_allclose(own.ddq[:, 1], -np.cos(t), atol=1e-3)


@pytest.mark.parametrize("text", ["a,b\n1,2\n", "t,q1\n0,1\n", "t,q1\n" + "0,1\n" * 8, ""])
def test_tables_that_are_none_are_refused(tmp_path: Path, text: str) -> None:
    path = tmp_path / "bad.csv"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(InputError):
        read_trajectory(path)
    with pytest.raises(InputError, match="no file"):
        read_trajectory(tmp_path / "absent.parquet")
    (tmp_path / "x.parquet").write_bytes(b"PAR1 no")
    with pytest.raises(InputError, match="can't be read"):
        read_trajectory(tmp_path / "x.parquet")


def test_a_plan_can_be_read_as_a_log(motion: Trajectory, tmp_path: Path, rig: Any) -> None:
    motion.write(tmp_path / "plan.parquet")
    log = kinid.read(tmp_path / "plan.parquet", rig)
    assert log.q is not None
    np.testing.assert_array_equal(log.q, motion.q)


def test_ros_users_get_the_same_numbers(motion: Trajectory, tmp_path: Path) -> None:
    pytest.importorskip("mcap")
    pytest.importorskip("rosbags")
    from mcap.reader import make_reader
    from rosbags.typesys import Stores, get_typestore

    from kinid.planning.ros import TYPE, write_joint_trajectory

    write_joint_trajectory(motion, tmp_path / "plan.mcap")
    with (tmp_path / "plan.mcap").open("rb") as stream:
        ((schema, channel, message),) = make_reader(stream, validate_crcs=True).iter_messages()
        assert schema.name == TYPE
        assert channel.message_encoding == "cdr"
        said: Any = get_typestore(Stores.ROS2_HUMBLE).deserialize_cdr(message.data, TYPE)
    assert said.joint_names == list(motion.joint_names)
    assert len(said.points) == len(motion)
    np.testing.assert_array_equal([point.positions for point in said.points], motion.q)
    np.testing.assert_array_equal([point.accelerations for point in said.points], motion.ddq)
    times = [point.time_from_start.sec + 1e-9 * point.time_from_start.nanosec for point in said.points]
    np.testing.assert_allclose(times, motion.t, atol=1e-9)


def test_pages_need_no_network(motion: Trajectory, rig: Any) -> None:
    from kinid.planning.figures import plan_page
    from kinid.planning.preview import preview_page

    page, view = plan_page(motion, "a <plan>"), preview_page(motion, rig, title="a <plan>")
    assert "a &lt;plan&gt;" in page
    assert "expected normal force" in page
    for text in (page, view):
        outside = re.sub(
            r"<script.*?</script>", "", text, flags=re.DOTALL
        )  # libraries name addresses that they don't call
        assert not re.search(r'(src|href)="?https?://', outside)
        assert not re.search(r"<script[^>]+src=", text)
    assert '"predicted"' in view
    other = Trajectory(
        motion.t, motion.phase, motion.q[:, :6], motion.dq[:, :6], motion.ddq[:, :6], motion.tip, tuple("abcdef")
    )
    with pytest.raises(InputError, match="joints of lwr4plus"):
        preview_page(other, rig)


def test_a_trajectory_is_frozen_and_whole(motion: Trajectory) -> None:
    with pytest.raises(ValueError, match="read-only"):
        motion.q[0, 0] = 1.0
    with pytest.raises(ValueError, match="shape"):
        Trajectory(motion.t, motion.phase, motion.q[:-1], motion.dq, motion.ddq, motion.tip, motion.joint_names)
    json.dumps(dict(motion.provenance))


@pytest.mark.parametrize(
    ("column", "values", "says"),
    [
        ("q1", ["a"] * 20, "q1 of no numbers"),
        ("t", ["a"] * 20, "t of no numbers"),
        ("q1", [[0.1]] * 20, "q1 of no numbers"),
        ("q1", [1e300] * 20, "more than 1e\\+10"),
        ("t", list(np.arange(20) * 1e8), "1e\\+06 s at most"),
    ],
)
def test_what_no_motion_has_is_refused(column: str, values: list[Any], says: str, tmp_path: Path) -> None:
    columns = {"t": list(np.arange(20) / 100)} | {f"q{j + 1}": [0.1] * 20 for j in range(7)} | {column: values}
    parquet.write_table(pa.table(columns), tmp_path / "t.parquet")
    with pytest.raises(InputError, match=says):
        read_trajectory(tmp_path / "t.parquet")


def test_what_a_trajectory_says_of_itself_has_limits(motion: Trajectory, tmp_path: Path) -> None:
    motion.write(tmp_path / "t.parquet")
    table = parquet.read_table(tmp_path / "t.parquet")
    for about, says in ((b'{"kind": ' + b"[" * 100_000 + b"]" * 100_000 + b"}", "levels deep"), (b"[1]", "a list")):
        parquet.write_table(table.replace_schema_metadata({b"kinid": about}), tmp_path / "t.parquet")
        with pytest.raises(InputError, match=says):
            read_trajectory(tmp_path / "t.parquet")
