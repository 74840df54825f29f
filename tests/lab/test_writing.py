"""Experiments on disk: log, streams, rig, and the truth apart from them."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

import kinid
from kinid.lab.experiments import prepare
from kinid.lab.protocol import Poke, five_phases
from kinid.lab.sensors import StreamSpec
from kinid.lab.writing import EPOCH, write_experiment
from kinid.rig import Rig

SHORT = five_phases(Poke(0.003, ((0.001, 2.0),), 0.6), free=0.4, hold=0.1, approach=0.6, height=0.008, tilt=0.1)


@pytest.fixture(scope="module")
def written(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("lab")
    setup = prepare("poke", seed=3)
    # one clock but for known offsets, so that both files can be held against each other
    setup = setup.replace(script=SHORT, wrench_stream=StreamSpec(losses=0.01), joint_stream=StreamSpec(every=2, losses=0.01))
    write_experiment(folder, setup.run(), {"experiment": "poke"})
    return folder


def test_parquet_and_mcap_hold_the_same(written: Path) -> None:
    rig = Rig.load(written / "rig.toml")
    table, bag = kinid.read(written / "log.parquet", rig), kinid.read(written / "log.mcap", rig)
    assert bag.q is not None
    assert table.q is not None
    assert len(bag) > 1.8 * len(table)  # the wrench's rate is twice the joints'
    shared = np.isfinite(bag.q.sum(axis=1))
    lost = 1.0 - len(bag) / (2 * len(table))
    assert 0.0 < lost < 0.05
    # between joint samples the reader interpolates: acceleration over half a step of 1 ms
    for j in range(7):
        assert np.abs(np.interp(bag.t[shared], table.t, table.q[:, j]) - bag.q[shared, j]).max() < 2e-5
    touch = kinid.contact_series(bag, rig)
    assert np.nanmax(touch.normal_force) > 1.0


def test_truth_stands_apart(written: Path) -> None:
    truth = json.loads((written / "truth" / "log.json").read_text())
    assert truth["material"]["stiffness"] == 732.0
    text = (written / "rig.toml").read_text()
    assert "732" not in text
    assert sorted(p.name for p in written.iterdir()) == ["log.mcap", "log.parquet", "rig.toml", "streams", "truth"]


def test_streams_as_tables_have_the_stamps_of_the_bag(written: Path) -> None:
    from mcap.reader import make_reader

    with (written / "log.mcap").open("rb") as file:
        messages = [(channel.topic, message.log_time) for _, channel, message in make_reader(file).iter_messages()]
    for topic, name in (("/joint_states", "joints"), ("/ft_sensor/wrench", "wrench")):
        stamps = 1e-9 * np.array([time - EPOCH for other, time in messages if other == topic])
        table = kinid.read(written / "streams" / f"log_{name}.parquet", Rig.load(written / "rig.toml"))
        np.testing.assert_allclose(table.t, stamps - 1.0, atol=1e-6)
    joints, wrench = (kinid.read(written / "streams" / f"log_{name}.parquet", Rig.load(written / "rig.toml"))
                      for name in ("joints", "wrench"))  # fmt: skip
    assert len(wrench) > 1.9 * len(joints)  # each at its own rate
    assert np.diff(wrench.t).max() > 1.5e-3  # and with messages lost


def test_mcap_is_what_foxglove_opens(written: Path) -> None:
    from mcap.reader import make_reader

    with (written / "log.mcap").open("rb") as file:
        summary = make_reader(file).get_summary()
    assert summary is not None
    kinds = {s.name: s for s in summary.schemas.values()}
    assert set(kinds) == {"sensor_msgs/msg/JointState", "geometry_msgs/msg/WrenchStamped"}
    assert all(s.encoding == "ros2msg" and b"std_msgs/Header" in s.data for s in kinds.values())
    assert {c.message_encoding for c in summary.channels.values()} == {"cdr"}


def _late(t: np.ndarray, reading: np.ndarray, clock: np.ndarray, known: np.ndarray) -> float:
    """By how much a reading g x(t − d) + b comes late against a known x [s], to first order in d."""
    columns = np.column_stack([np.interp(t, clock, known), np.interp(t, clock, np.gradient(known, clock)), np.ones(len(t))])
    gain, shift, _ = np.linalg.lstsq(columns, reading, rcond=None)[0]
    return float(-shift / gain)


@pytest.mark.parametrize("seed", [2, 3, 4])
def test_clocks_that_differ_are_read_and_only_the_truth_tells_by_how_much(tmp_path: Path, seed: int) -> None:
    """Wrench and joints of the bag stay as far apart as their clocks and the line make them: up to 2 ms, and 1 ms later."""
    setup = prepare("poke", seed=seed).replace(script=SHORT)
    result = setup.run()
    write_experiment(tmp_path, result, {})
    told = json.loads((tmp_path / "truth" / "log.json").read_text())["streams"]
    assert abs(told["wrench"]["offset"]) <= 2e-3
    assert told["wrench_after_joints"] == pytest.approx(told["wrench"]["offset"] + told["wrench"]["delay"])
    rig = Rig.load(tmp_path / "rig.toml")
    table, bag = kinid.read(tmp_path / "log.parquet", rig), kinid.read(tmp_path / "log.mcap", rig)
    assert table.q is not None
    assert bag.q is not None
    assert bag.wrench is not None
    poke = np.isfinite(bag.q.sum(axis=1) + bag.wrench.sum(axis=1)) & (bag.t > 1.0)  # the tool doesn't turn any more
    joints = np.mean([_late(bag.t[poke], bag.q[poke, j], table.t, table.q[:, j]) for j in (1, 3, 5)])
    wrench = _late(bag.t[poke], bag.wrench[poke, 2], result.motion.t, result.clean[:, 2])
    found = wrench - joints
    print(f"seed {seed}: wrench after joints by {1e3 * found:.2f} ms, told {1e3 * told['wrench_after_joints']:.2f} ms")
    # 0.03 N of noise on slopes of 20 N/s over 1500 samples: 0.04 ms
    assert found == pytest.approx(told["wrench_after_joints"], abs=2e-4)
    for name in ("rig.toml", "log.parquet"):
        assert b"offset" not in (tmp_path / name).read_bytes().replace(b"bias", b"")
