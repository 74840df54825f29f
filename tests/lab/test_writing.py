"""Experiments on disk: log, streams, rig, and the truth apart from them."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from pyarrow import parquet

import kinid
from kinid.contact.analysis import analyse
from kinid.data.rig import Rig, StreamsSpec
from kinid.identification.fit import fit_model
from kinid.lab.experiments import prepare
from kinid.lab.hidden import hide
from kinid.lab.injectors import injectors
from kinid.lab.protocol import Poke, five_phases
from kinid.lab.sensors import StreamSpec
from kinid.lab.setup import Result
from kinid.lab.writing import EPOCH, write_experiment, write_rig
from kinid.modeling.model import Model
from kinid.robotics.robot import Robot

SHORT = five_phases(Poke(0.003, ((0.001, 2.0),), 0.6), free=0.4, hold=0.1, approach=0.6, height=0.008, tilt=0.1)


@pytest.fixture(scope="module")
def written(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("lab")
    setup = prepare("poke", seed=3)
    # one clock but for known offsets, so that both files can be held against each other
    setup = setup.replace(
        script=SHORT, wrench_stream=StreamSpec(losses=0.01), joint_stream=StreamSpec(every=2, losses=0.01)
    )
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
    joints, wrench = (
        kinid.read(written / "streams" / f"log_{name}.parquet", Rig.load(written / "rig.toml"))
        for name in ("joints", "wrench")
    )
    assert len(wrench) > 1.9 * len(joints)  # each at its own rate
    assert np.diff(wrench.t).max() > 1.5e-3  # and with messages lost


def test_mcap_is_what_foxglove_opens(written: Path) -> None:
    from mcap.reader import make_reader

    with (written / "log.mcap").open("rb") as file:
        summary = make_reader(file).get_summary()
    assert summary is not None
    kinds = {s.name: s for s in summary.schemas.values()}
    stamped = {"sensor_msgs/msg/JointState", "geometry_msgs/msg/WrenchStamped", "geometry_msgs/msg/PoseStamped"}
    assert set(kinds) == {*stamped, "std_msgs/msg/String"}
    assert all(s.encoding == "ros2msg" for s in kinds.values())
    assert all(b"std_msgs/Header" in kinds[name].data for name in stamped)
    assert {c.message_encoding for c in summary.channels.values()} == {"cdr"}


def _late(t: np.ndarray, reading: np.ndarray, clock: np.ndarray, known: np.ndarray) -> float:
    """By how much a reading g x(t − d) + b comes late against a known x [s], to first order in d."""
    columns = np.column_stack(
        [np.interp(t, clock, known), np.interp(t, clock, np.gradient(known, clock)), np.ones(len(t))]
    )
    gain, shift, _ = np.linalg.lstsq(columns, reading, rcond=None)[0]
    return float(-shift / gain)


@pytest.mark.parametrize("hidden", [None, "time-offset"])
@pytest.mark.parametrize("seed", [2, 3, 4])
def test_clocks_that_differ_are_stated_and_a_hidden_delay_is_not(tmp_path: Path, seed: int, hidden: str | None) -> None:
    """The bag's streams are up to 2 ms, and 1 ms of line, apart: the rig says by how much, and nothing of what is
    hidden.
    """
    nominal = prepare("poke", seed=seed).replace(script=SHORT)
    setup, delay = nominal, 0.0
    if hidden is not None:
        setup, truth = hide(nominal, hidden, seed)
        delay = float(truth["parameters"]["delay"])  # type: ignore[index]
    result = setup.run()
    write_experiment(tmp_path, result, {})
    streams = json.loads((tmp_path / "truth" / "log.json").read_text())["streams"]
    assert 1e-6 < abs(streams["wrench"]["offset"]) <= 2e-3
    rig = Rig.load(tmp_path / "rig.toml")
    assert rig.streams.wrench_clock_offset == pytest.approx(-streams["wrench_after_joints"], abs=1e-6)
    assert rig.streams == nominal.rig.streams
    deaf = rig.model_copy(update={"streams": StreamsSpec()})
    late = {name: _wrench_after_joints(tmp_path, each, result) for name, each in (("stated", rig), ("not", deaf))}
    print(
        f"seed {seed}: wrench after joints by {1e3 * late['not']:.2f} ms, with the rig's word by "
        f"{1e3 * late['stated']:.2f} ms"
    )
    # 0.03 N of noise on slopes of 20 N/s over 1500 samples: 0.04 ms
    assert late["not"] == pytest.approx(streams["wrench_after_joints"] + delay, abs=2e-4 + 0.05 * delay)
    assert late["stated"] == pytest.approx(delay, abs=2e-4 + 0.05 * delay)


def _wrench_after_joints(folder: Path, rig: Rig, result: Result) -> float:
    """By how much the bag's wrench lags its joints [s]."""
    table, bag = kinid.read(folder / "log.parquet", rig), kinid.read(folder / "log.mcap", rig)
    assert table.q is not None
    assert bag.q is not None
    assert bag.wrench is not None
    poke = np.isfinite(bag.q.sum(axis=1) + bag.wrench.sum(axis=1)) & (bag.t > 1.0)  # the tool doesn't turn any more
    joints = np.mean([_late(bag.t[poke], bag.q[poke, j], table.t, table.q[:, j]) for j in (1, 3, 5)])
    return float(_late(bag.t[poke], bag.wrench[poke, 2], result.motion.t, result.clean[:, 2]) - joints)


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_bag_and_table_give_the_same_estimates(tmp_path: Path, seed: int) -> None:
    """A clock's offset Δt would shift damping by K Δt: up to 2.2 N·s/m here."""
    write_experiment(tmp_path, prepare("poke", seed=seed).run(), {})
    rig = Rig.load(tmp_path / "rig.toml")
    fits = []
    for name in ("log.parquet", "log.mcap"):
        log = kinid.read(tmp_path / name, rig)
        # accelerations between the joints' own samples are noisy: once, they made the tool lighter than it is
        assert analyse(log, rig).provenance.warnings == ()
        touch = kinid.contact_series(log, rig)
        fits.append(fit_model(Model("kelvin-voigt"), touch, channels=("normal_force",), held_out=False))
    table, bag = fits
    for name in ("stiffness", "damping"):
        print(f"seed {seed}: {table[name]} of the table, {bag[name]} of the bag")
        assert bag[name].value == pytest.approx(table[name].value, rel=0.002 if name == "stiffness" else 0.02)


@pytest.mark.parametrize("seed", [0, 5])
def test_bag_and_table_get_the_same_verdict(tmp_path: Path, seed: int) -> None:
    """Messages are lost in bursts of up to 10 ms: what friction remembers of the slip before isn't lost with them."""
    write_experiment(tmp_path, prepare("slide", seed=seed).run(), {})
    rig = Rig.load(tmp_path / "rig.toml")
    fits = []
    for name in ("log.parquet", "log.mcap"):
        touch = kinid.contact_series(kinid.read(tmp_path / name, rig), rig)
        fits.append(fit_model(Model("kelvin-voigt", "coulomb-friction"), touch))
    table, bag = fits
    print(f"seed {seed}: {table.error.held_out:.4f} N of the table, {bag.error.held_out:.4f} N of the bag")
    assert bag.warnings == table.warnings == ()
    assert bag.error.held_out == pytest.approx(table.error.held_out, rel=0.1)
    assert bag["coefficient"].value == pytest.approx(table["coefficient"].value, rel=0.003)


def test_phase_and_target_are_in_both(written: Path) -> None:
    """The controller's clock is the joints': a phase begins with the set-point that it names, to a sample."""
    from mcap.reader import make_reader
    from rosbags.typesys import Stores, get_typestore

    rig = Rig.load(written / "rig.toml")
    table, bag = kinid.read(written / "log.parquet", rig), kinid.read(written / "log.mcap", rig)
    assert table.phase is not None
    assert bag.phase is not None
    last = np.clip(np.searchsorted(table.t, bag.t + 1e-6, side="right") - 1, 0, len(table) - 1)
    assert (table.phase[last] != bag.phase).sum() <= len(np.unique(table.phase))  # an odd period between two rows
    columns = parquet.read_table(written / "log.parquet")
    target = np.column_stack([columns[f"target_{axis}"].to_numpy() for axis in ("x", "y", "z", "qx", "qy", "qz", "qw")])
    np.testing.assert_allclose(np.linalg.norm(target[:, 3:], axis=1), 1.0)
    tip = Robot.load(rig).kinematics("tool_tip", np.ascontiguousarray(table.q)).position
    hold = table.phase == "hold"
    assert 0.0 < np.linalg.norm(tip - target[:, :3], axis=1)[hold].max() < 2e-3  # behind by force over stiffness
    decode = get_typestore(Stores.ROS2_HUMBLE).deserialize_cdr
    with (written / "log.mcap").open("rb") as file:
        poses = [
            decode(message.data, schema.name).pose
            for schema, _, message in make_reader(file).iter_messages(topics=["/target_pose"])
        ]
    seen = np.array([[p.position.x, p.position.y, p.position.z, p.orientation.x, p.orientation.w] for p in poses])
    np.testing.assert_allclose(seen[-1], target[-1][[0, 1, 2, 3, 6]], atol=1e-12)


@pytest.mark.parametrize("hidden", [None, "sensor-bias", "saturation", "tool-mass"])
def test_the_rig_states_the_bias_that_is_known_and_none_that_is_hidden(hidden: str | None) -> None:
    nominal = prepare("poke", seed=5)
    setup = nominal if hidden is None else hide(nominal, hidden, 5)[0]
    assert setup.rig.sensor.bias == tuple(nominal.sensor.bias)
    assert setup.rig.sensor == nominal.rig.sensor
    moved = np.abs(setup.sensor.bias - nominal.sensor.bias).max()
    assert (moved > 0.1) == (hidden in ("sensor-bias", "saturation"))


def test_nothing_hidden_is_told_by_the_rig(tmp_path: Path) -> None:
    """Whatever is hidden, the rig is the same to the byte."""
    nominal = prepare("ecoflex-50", seed=3)
    write_rig(tmp_path, nominal)
    wanted = (tmp_path / "rig.toml").read_bytes()
    for effect in injectors():
        write_rig(tmp_path, hide(nominal, effect, 3)[0])
        assert (tmp_path / "rig.toml").read_bytes() == wanted, effect
