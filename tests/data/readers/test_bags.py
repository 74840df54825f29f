"""ROS 1 and ROS 2 bags and MCAP: topics, clocks, joints by name, written here and read back."""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from kinid.data.log import Log
from kinid.data.readers import read
from kinid.data.rig import Rig
from kinid.errors import InputError
from kinid.live import open_source
from kinid.live.messages import Joints, Wrench
from kinid.live.sources import Asked

rosbag1 = pytest.importorskip("rosbags.rosbag1")
rosbag2 = pytest.importorskip("rosbags.rosbag2")
typesys = pytest.importorskip("rosbags.typesys")
mcap_writer = pytest.importorskip("mcap.writer")

JOINT, WRENCH = "sensor_msgs/msg/JointState", "geometry_msgs/msg/WrenchStamped"
START = 1_708_857_503_929_545_123  # [ns] Unix
MS = 1_000_000
ROS1 = typesys.get_typestore(typesys.Stores.ROS1_NOETIC)
ROS2 = typesys.get_typestore(typesys.Stores.ROS2_HUMBLE)
FORMATS = ("ros1", "ros2", "ros2 file", "mcap cdr", "mcap ros1", "mcap json", "mcap plain")


@dataclass(frozen=True)
class Message:
    """One message: topic, header stamp and reception [ns], and the joints' names and lists, or a wrench."""

    topic: str
    stamp: int
    names: tuple[str, ...] = ()
    position: Sequence[float] = ()
    velocity: Sequence[float] = ()
    effort: Sequence[float] = ()
    wrench: Sequence[float] = ()
    late: int = 200_000
    publisher: int = 0
    received: int = field(init=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "received", (self.stamp or START) + self.late)

    @property
    def type(self) -> str:
        return WRENCH if len(self.wrench) else JOINT

    def ros(self, store: Any) -> Any:
        types = store.types
        stamp = types["builtin_interfaces/msg/Time"](sec=self.stamp // 10**9, nanosec=self.stamp % 10**9)
        sequence = {"seq": 0} if store is ROS1 else {}
        header = types["std_msgs/msg/Header"](**sequence, stamp=stamp, frame_id="tool0")
        if self.type == JOINT:
            lists = (np.array(v, dtype=float) for v in (self.position, self.velocity, self.effort))
            return types[JOINT](header, list(self.names), *lists)
        vector = types["geometry_msgs/msg/Vector3"]
        force, torque = vector(*map(float, self.wrench[:3])), vector(*map(float, self.wrench[3:]))
        return types[WRENCH](header, types["geometry_msgs/msg/Wrench"](force, torque))

    def json(self) -> bytes:
        header = {"stamp": {"sec": self.stamp // 10**9, "nanosec": self.stamp % 10**9}, "frame_id": "tool0"}
        if self.type == JOINT:
            lists = {k: list(getattr(self, k)) for k in ("position", "velocity", "effort")}
            return json.dumps({"header": header, "name": self.names, **lists}).encode()
        vectors = (dict(zip("xyz", map(float, part))) for part in (self.wrench[:3], self.wrench[3:]))
        return json.dumps({"header": header, "wrench": dict(zip(("force", "torque"), vectors))}).encode()


def write(folder: Path, kind: str, messages: Sequence[Message]) -> Path:
    """Write messages in the order of their reception; one connection for each publisher of a topic."""
    messages = sorted(messages, key=lambda m: m.received)
    links = {(m.topic, m.publisher): m.type for m in messages}
    if kind.startswith("mcap"):
        return write_mcap(folder / "a.mcap", kind, messages)
    if kind == "ros1":
        with rosbag1.Writer(folder / "a.bag") as bag:
            connections = {
                (topic, who): bag.add_connection(topic, type_, typestore=ROS1, callerid=f"/node{who}")
                for (topic, who), type_ in links.items()
            }
            for m in messages:
                bag.write(connections[m.topic, m.publisher], m.received, ROS1.serialize_ros1(m.ros(ROS1), m.type))
        return folder / "a.bag"
    with rosbag2.Writer(folder / "bag", version=9) as bag:
        topics = {topic: bag.add_connection(topic, type_, typestore=ROS2) for (topic, _), type_ in links.items()}
        for m in messages:
            bag.write(topics[m.topic], m.received, ROS2.serialize_cdr(m.ros(ROS2), m.type))
    return folder / "bag" / "bag.db3" if kind == "ros2 file" else folder / "bag"


def write_mcap(path: Path, kind: str, messages: Sequence[Message]) -> Path:
    encoding = kind.split()[1].replace("plain", "cdr")
    schema = {"cdr": "ros2msg", "ros1": "ros1msg", "json": "jsonschema"}[encoding]
    plain = kind == "mcap plain"  # neither chunks nor a summary: what a small recorder writes
    settings = {"use_chunking": False, "use_statistics": False, "use_summary_offsets": False} if plain else {}
    if plain:
        settings |= {"repeat_channels": False, "repeat_schemas": False}
    with path.open("wb") as file:
        out = mcap_writer.Writer(file, chunk_size=2000, **settings)
        out.start()
        channels: dict[str, int] = {}
        for m in messages:
            if m.topic not in channels:
                name = m.type.replace("/msg/", "/") if encoding == "ros1" else m.type
                key = out.register_schema(name, schema, b"{}" if encoding == "json" else b"")
                channels[m.topic] = out.register_channel(m.topic, encoding, key)
            data = {
                "cdr": lambda m=m: bytes(ROS2.serialize_cdr(m.ros(ROS2), m.type)),
                "ros1": lambda m=m: bytes(ROS1.serialize_ros1(m.ros(ROS1), m.type)),
                "json": m.json,
            }[encoding]()
            out.add_message(channels[m.topic], m.received, data, m.stamp)
        out.finish()
    return path


NAMES = ("elbow", "shoulder", "wrist")


def arm(times: NDArray[Any], **changes: Any) -> Iterator[Message]:
    """Joints at these times [ns since the start]: elbow 1 + t, shoulder 2 + t, wrist 3 + t, their rates, torques."""
    for t in times.tolist():
        q = np.array([1.0, 2.0, 3.0]) + t * 1e-9
        full: dict[str, Any] = {"names": NAMES, "position": q, "velocity": q * 0 + 1, "effort": 10 * q}
        yield Message("/joint_states", START + t, **(full | changes))


def forces(times: NDArray[Any], **changes: Any) -> Iterator[Message]:
    """A wrench at these times: fx = t, fy … tz = 1 … 5."""
    for t in times.tolist():
        yield Message(**({"topic": "/wrench", "stamp": START + t, "wrench": [t * 1e-9, 1, 2, 3, 4, 5]} | changes))


FAST, SLOW = np.arange(0, 100 * MS, 2 * MS), np.arange(0, 100 * MS, 8 * MS)


def facts(log: Log) -> dict[str, Any]:
    return dict(log.provenance.steps[0].facts)


# ------------------------------------------------------------------------------------------------------- round trip


@pytest.mark.parametrize("kind", FORMATS)
def test_two_streams_come_onto_the_clock_of_the_wrench(kind: str, tmp_path: Path) -> None:
    path = write(tmp_path, kind, [*arm(SLOW), *forces(FAST)])
    log = read(path, Rig(), joint_names=("shoulder", "elbow", "wrist"))
    np.testing.assert_allclose(log.t, FAST * 1e-9, atol=1e-12)  # counted from the first stamp, to the nanosecond
    assert facts(log)["time_origin"] == pytest.approx(START * 1e-9, abs=1e-6)
    inside = log.t <= SLOW[-1] * 1e-9
    assert log.q is not None
    assert log.dq is not None
    assert log.tau is not None
    assert log.wrench is not None
    # linear in time, so linear interpolation is exact; in the order asked for, not that of the messages
    np.testing.assert_allclose(log.q[inside], log.t[inside, None] + [2, 1, 3], atol=1e-9)
    np.testing.assert_allclose(log.tau[inside], 10 * log.q[inside], atol=1e-9)
    np.testing.assert_allclose(log.dq[inside], 1.0)
    np.testing.assert_allclose(log.wrench, np.c_[log.t, np.tile([1, 2, 3, 4, 5], (len(log.t), 1))], atol=1e-9)
    # nothing is known of the joints behind their last message
    np.testing.assert_array_equal(log.valid, inside)
    assert facts(log)["invalid_rows"] == (~inside).sum() == 1
    assert facts(log)["clocks"] == {"wrench": "header", "joints": "header"}
    assert facts(log)["joints"] == ["shoulder", "elbow", "wrist"]
    assert [s.facts["stream"] for s in log.provenance.steps[1:]] == ["wrench", "joints"]
    assert log.provenance.steps[2].facts["rate"] == pytest.approx(125.0)
    json.dumps(log.provenance.to_dict())


@pytest.mark.parametrize("kind", FORMATS)
def test_the_rig_chooses_the_reference(kind: str, tmp_path: Path) -> None:
    path = write(tmp_path, kind, [*arm(SLOW), *forces(FAST)])
    log = read(path, Rig.parse({"streams": {"reference": "joints", "wrench_clock_offset": 0.004}}))
    np.testing.assert_allclose(log.t, SLOW * 1e-9, atol=1e-12)
    assert log.wrench is not None
    known = log.valid
    # averaged over 8 ms, centred, and the wrench's stamps moved by 4 ms
    np.testing.assert_allclose(log.wrench[known, 0], log.t[known] - 0.004, atol=1e-9)
    assert known.sum() >= len(SLOW) - 2
    assert log.provenance.steps[2].facts["clock_offset"] == 0.004
    assert log.provenance.steps[2].facts["method"].startswith("average")


def test_one_stream_alone(tmp_path: Path) -> None:
    log = read(write(tmp_path, "ros1", list(forces(FAST))))
    assert (log.q, log.joint_count, len(log)) == (None, 0, len(FAST))
    with pytest.raises(InputError, match=r"no joints in .* for the reference clock"):
        read(tmp_path / "a.bag", Rig.parse({"streams": {"reference": "joints"}}))


def test_the_rig_beside_a_bag_folder_is_used(tmp_path: Path) -> None:
    path = write(tmp_path, "ros2", [*arm(SLOW), *forces(FAST)])
    (tmp_path / "rig.toml").write_text('[streams]\nreference = "joints"\n')
    assert len(read(path)) == len(SLOW)


def test_units_of_a_driver(tmp_path: Path) -> None:
    path = write(tmp_path, "mcap cdr", list(arm(SLOW)))
    spec = {"tau": {"scale": 0.5, "unit": "Nmm"}, "q": {"columns": ["a", "b", "c"]}}  # columns: for tables, not here
    log = read(path, Rig.parse({"columns": spec}))
    assert log.q is not None
    np.testing.assert_allclose(log.tau, 0.5e-3 * 10 * log.q, rtol=1e-9)
    assert facts(log)["to_si"] == {"tau": 0.5e-3}


# ----------------------------------------------------------------------------------------------------------- clocks


@pytest.mark.parametrize("kind", ["ros1", "ros2", "mcap json"])
@pytest.mark.parametrize("stamp", [0, START])
def test_headers_that_were_left_alone_give_way_to_the_reception(kind: str, stamp: int, tmp_path: Path) -> None:
    late = [{"stamp": stamp, "late": int(t) + MS} for t in FAST]
    silent = [next(forces(np.array([t]), **change)) for t, change in zip(FAST, late)]
    log = read(write(tmp_path, kind, [*arm(FAST), *silent]))
    assert facts(log)["clocks"] == {"wrench": "reception", "joints": "header"}
    # the joints were received 0.2 ms after their stamps: so long, it is taken, the wrench had been on its way too
    assert facts(log)["reception_delay_removed_s"] == pytest.approx(2e-4, abs=1e-6)
    np.testing.assert_allclose(log.t, FAST * 1e-9 + 1e-3 - 2e-4, atol=1e-6)


def test_one_header_without_a_stamp_is_enough_to_distrust_them(tmp_path: Path) -> None:
    some = list(forces(FAST))
    some[20] = next(forces(FAST[20:21], stamp=0, late=int(FAST[20]) + 200_000))
    log = read(write(tmp_path, "ros1", some))
    assert facts(log)["clocks"] == {"wrench": "reception"}
    np.testing.assert_allclose(log.t, FAST * 1e-9, atol=1e-9)


def test_a_clock_of_its_own_needs_an_offset(tmp_path: Path) -> None:
    boot = [next(forces(np.array([t]), stamp=5 * 10**9 + int(t), late=START - 5 * 10**9)) for t in FAST]
    path = write(tmp_path, "ros1", [*arm(SLOW), *boot])
    with pytest.raises(InputError, match="streams that share time"):
        read(path)
    offset = (START - 5 * 10**9) * 1e-9
    log = read(path, Rig.parse({"streams": {"wrench_clock_offset": offset}}))
    assert log.valid.sum() >= len(FAST) - 2


def test_messages_out_of_order_and_recorded_twice(tmp_path: Path) -> None:
    rng = np.random.default_rng(5)
    shuffled = [next(forces(np.array([t]), late=int(rng.integers(0, 20 * MS)))) for t in FAST]
    twice = list(forces(FAST[:10]))
    log = read(write(tmp_path, "ros2", [*shuffled, *twice]))
    np.testing.assert_allclose(log.t, FAST * 1e-9, atol=1e-12)
    assert log.wrench is not None
    np.testing.assert_allclose(log.wrench[:, 0], log.t, atol=1e-9)
    step = log.provenance.steps[1].facts
    assert step["repeated"] == 10
    assert step["unsorted"] > 0


def test_an_interruption_stays_empty(tmp_path: Path) -> None:
    parts = SLOW[(SLOW < 30 * MS) | (SLOW > 70 * MS)]
    log = read(write(tmp_path, "mcap ros1", [*arm(parts), *forces(FAST)]))
    pause = (log.t > 0.024 + 1e-9) & (log.t < 0.072 - 1e-9)
    assert not log.valid[pause].any()
    bridged = read(tmp_path / "a.mcap", Rig.parse({"streams": {"max_gap": 0.1}}))
    assert bridged.valid[pause].all()


# ----------------------------------------------------------------------------------------------------------- joints


def gripper(times: NDArray[Any]) -> Iterator[Message]:
    for t in times.tolist():
        yield Message("/joint_states", START + t, ("left_finger", "right_finger"), [0.1, 0.2], publisher=1)


def test_a_gripper_on_the_same_topic_is_left_out(tmp_path: Path) -> None:
    log = read(write(tmp_path, "ros1", [*arm(FAST), *gripper(SLOW)]))
    assert log.joint_count == 3
    assert log.valid.all()
    found = facts(log)
    assert found["joints"] == ["elbow", "shoulder", "wrist"]
    assert found["joints_order"] == "as recorded"
    assert found["joints_ignored"] == ["left_finger", "right_finger"]


def test_a_robot_in_two_messages_is_put_together(tmp_path: Path) -> None:
    path = write(tmp_path, "ros1", [*arm(FAST), *gripper(SLOW)])
    log = read(path, joint_names=("right_finger", "shoulder", "elbow", "wrist"))
    assert log.q is not None
    inside = log.t <= SLOW[-1] * 1e-9
    np.testing.assert_allclose(log.q[inside, 0], 0.2)
    np.testing.assert_allclose(log.q[:, 1:], log.t[:, None] + [2, 1, 3], atol=1e-9)
    assert facts(log)["joints_ignored"] == ["left_finger"]
    assert [s.facts["stream"] for s in log.provenance.steps[1:]] == ["joints", "joints 2"]


def test_one_publisher_a_joint(tmp_path: Path) -> None:
    single = [
        Message("/joint_states", START + int(t) + i * MS, (name,), [i + t * 1e-9], publisher=i)
        for t in FAST
        for i, name in enumerate("abc")
    ]
    path = write(tmp_path, "ros1", single)
    with pytest.raises(InputError, match=r"several sources of as many joints in .*: a; b; c"):
        read(path)
    log = read(path, joint_names=("c", "b", "a"))
    assert log.q is not None
    assert log.dq is None
    known = log.valid
    assert known.sum() >= len(FAST) - 2
    # each joint has its own clock, i ms later
    expected = log.t[known, None] + [2 - 0.002, 1 - 0.001, 0.0]
    np.testing.assert_allclose(log.q[known], expected, atol=1e-9)


def test_names_may_have_a_prefix(tmp_path: Path) -> None:
    long = tuple(f"robot1_{name}" for name in NAMES)
    path = write(tmp_path, "ros2", list(arm(FAST, names=long)))
    log = read(path, joint_names=("wrist", "elbow", "shoulder"))
    assert log.q is not None
    np.testing.assert_allclose(log.q[0], [3, 1, 2])
    assert facts(log)["joints"] == ["robot1_wrist", "robot1_elbow", "robot1_shoulder"]
    rig = Rig.parse({"robot": {"model": "x", "joints": ["ns/robot1_shoulder", "robot1_elbow", "wrist"]}})
    ordered = read(path, rig, joint_names=("wrist", "elbow", "shoulder"))  # the rig's order has the last word
    assert ordered.q is not None
    np.testing.assert_allclose(ordered.q[0], [2, 1, 3])


@pytest.mark.parametrize(
    ("names", "found"),
    [
        (("elbow", "shoulder", "hand"), "no joint 'hand' in"),
        (("elbow", "shoulder", "wrist", "wrist_2"), "no joint 'wrist_2'"),
        (("left_elbow", "right_elbow", "wrist"), "joint 'elbow' in .* for several joints"),
    ],
)
def test_joints_that_are_missing(names: tuple[str, ...], found: str, tmp_path: Path) -> None:
    path = write(tmp_path, "ros1", list(arm(FAST)))
    with pytest.raises(InputError, match=found):
        read(path, joint_names=names)


def test_two_arms_need_full_names(tmp_path: Path) -> None:
    both = [*arm(FAST, names=tuple(f"left_{n}" for n in NAMES))]
    both += arm(FAST + MS, names=tuple(f"right_{n}" for n in NAMES), publisher=1)
    path = write(tmp_path, "ros1", both)
    with pytest.raises(InputError, match="several sources"):
        read(path)
    with pytest.raises(InputError, match=r"joints left_elbow, right_elbow in .* for 'elbow'"):
        read(path, joint_names=NAMES)
    assert read(path, joint_names=tuple(f"left_{n}" for n in NAMES)).valid.all()


def test_the_order_may_change_from_message_to_message(tmp_path: Path) -> None:
    messages = list(arm(FAST))
    for i in range(1, len(messages), 2):
        m = messages[i]
        messages[i] = Message(m.topic, m.stamp, m.names[::-1], m.position[::-1], m.velocity[::-1], m.effort[::-1])
    log = read(write(tmp_path, "mcap json", messages))
    np.testing.assert_allclose(log.q, log.t[:, None] + [1, 2, 3], atol=1e-9)


def test_lists_that_do_not_fit_the_names_are_absent_values(tmp_path: Path) -> None:
    messages = list(arm(FAST, velocity=()))
    messages[7] = next(arm(FAST[7:8], position=[1.0], velocity=()))
    log = read(write(tmp_path, "ros2", messages))
    assert log.dq is None  # this driver sends no rates
    assert not log.valid[7]
    assert log.valid.sum() == len(FAST) - 1


def test_commands_are_read_where_the_rig_names_them(tmp_path: Path) -> None:
    wanted = [Message("/command", START + int(t), NAMES[::-1], [3.5, 2.5, 1.5]) for t in SLOW]
    path = write(tmp_path, "ros2", [*arm(FAST), *wanted])
    with pytest.raises(InputError, match=r"several topics for the joints in .*/command \(13 messages\)"):
        read(path)
    log = read(path, Rig.parse({"streams": {"joint_commands": "/command"}}))
    assert log.q_cmd is not None
    known = np.isfinite(log.q_cmd).all(axis=1)
    np.testing.assert_allclose(log.q_cmd[known], np.tile([1.5, 2.5, 3.5], (known.sum(), 1)))
    assert known.sum() == (log.t <= SLOW[-1] * 1e-9).sum()


# ----------------------------------------------------------------------------------------------------------- topics


def test_several_topics_need_a_choice(tmp_path: Path) -> None:
    path = write(tmp_path, "mcap cdr", [*forces(FAST), *forces(FAST, topic="/bias")])
    with pytest.raises(InputError, match=r"several topics for the wrench.*/bias.*/wrench|/wrench.*/bias") as error:
        read(path)
    assert "[streams] wrench" in error.value.mend
    log = read(path, Rig.parse({"streams": {"wrench": "/bias"}}))
    assert facts(log)["topics"] == {"wrench": "/bias"}
    with pytest.raises(InputError, match=r"no topic '/biass'.*did you mean '/bias'"):
        read(path, Rig.parse({"streams": {"wrench": "/biass"}}))
    with pytest.raises(InputError, match=r"topic '/bias', 50 messages of .*the bag holds none"):
        read(path, Rig.parse({"streams": {"joints": "/bias"}}))


def test_a_bag_without_such_topics(tmp_path: Path) -> None:
    with rosbag1.Writer(tmp_path / "a.bag") as bag:
        connection = bag.add_connection("/chatter", "std_msgs/msg/String", typestore=ROS1)
        text = ROS1.types["std_msgs/msg/String"]("hello")
        bag.write(connection, START, ROS1.serialize_ros1(text, connection.msgtype))
    with pytest.raises(InputError, match=r"/chatter \(std_msgs/msg/String\) in .*expected sensor_msgs/JointState"):
        read(tmp_path / "a.bag")


def test_messages_without_values(tmp_path: Path) -> None:
    path = write(tmp_path, "ros1", list(arm(FAST, position=(), velocity=(), effort=())))
    with pytest.raises(InputError, match="messages without any value for joints"):
        read(path)


# ------------------------------------------------------------------------------------------------------------- JSON


def write_json(path: Path, topics: dict[str, list[dict[str, Any]]], schema: str = "custom") -> Path:
    with path.open("wb") as file:
        out = mcap_writer.Writer(file)
        out.start()
        key = out.register_schema(schema, "jsonschema", b"{}")
        for topic, messages in topics.items():
            channel = out.register_channel(topic, "json", key)
            for i, message in enumerate(messages):
                out.add_message(channel, START + i * MS, json.dumps(message).encode(), START + i * MS)
        out.finish()
    return path


def test_json_by_its_fields(tmp_path: Path) -> None:
    vector = {"x": 1.0, "y": 2.0, "z": 3.0}
    joints = [
        {
            "timestamp": {"sec": 7, "nsec": i * MS},
            "joints": [{"name": "a", "position": i}, {"name": "b", "position": 1}],
        }
        for i in range(5)
    ]
    topics = {"/w": [{"force": vector, "torque": vector}] * 5, "/state": [{"mode": "idle"}]}
    log = read(write_json(tmp_path / "a.mcap", topics))
    np.testing.assert_array_equal(log.wrench, np.tile([1, 2, 3, 1, 2, 3], (5, 1)))
    assert facts(log)["clocks"] == {"wrench": "reception"}
    log = read(write_json(tmp_path / "b.mcap", {"/j": joints}, "foxglove.JointStates"))
    np.testing.assert_array_equal(log.q, [[i, 1] for i in range(5)])
    np.testing.assert_allclose(log.t, np.arange(5) * 1e-3, atol=1e-12)
    assert log.tau is None


def test_json_that_is_none_of_it(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"/state \(custom\)"):
        read(write_json(tmp_path / "a.mcap", {"/state": [{"mode": "idle"}]}))
    bad = [{"header": {}, "name": ["a"], "position": ["x"]}]
    with pytest.raises(InputError, match=r"a message on /j .* that is no joints"):
        read(write_json(tmp_path / "b.mcap", {"/j": bad}))
    with pytest.raises(InputError, match="no attribute 'torque'"):
        read(write_json(tmp_path / "c.mcap", {"/w": [{"wrench": {"force": 1}}]}, "ros.WrenchStamped"))


# ----------------------------------------------------------------------------------------------------- damaged files


@pytest.mark.parametrize("kind", ["ros1", "ros2 file", "mcap cdr", "mcap plain"])
@pytest.mark.parametrize("share", [0.01, 0.3, 0.6, 0.9, 0.999])
def test_a_bag_that_was_cut_off_is_refused(kind: str, share: float, tmp_path: Path) -> None:
    path = write(tmp_path, kind, [*arm(SLOW), *forces(FAST)])
    whole = path.read_bytes()
    path.write_bytes(whole[: int(share * len(whole))])
    with pytest.raises(InputError, match="which is cut off" if "mcap" in kind else "can't be read as") as error:
        read(path)
    assert str(path) in str(error.value)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize("kind", ["ros1", "ros2 file", "mcap cdr", "mcap json"])
def test_damaged_bytes_never_end_in_a_traceback(kind: str, tmp_path: Path) -> None:
    path = write(tmp_path, kind, [*arm(SLOW), *forces(SLOW)])
    whole, rng, refused = path.read_bytes(), np.random.default_rng(6), 0
    for _ in range(25):
        damaged = bytearray(whole)
        for place in rng.integers(0, len(whole), 6):
            damaged[place] = rng.integers(0, 256)
        path.write_bytes(damaged)
        try:
            read(path)
        except InputError:
            refused += 1
    assert refused > 0


def test_a_ros2_folder_without_its_file(tmp_path: Path) -> None:
    path = write(tmp_path, "ros2", list(forces(SLOW)))
    (path / "bag.db3").unlink()
    with pytest.raises(InputError, match="files are missing"):
        read(path)
    (path / "metadata.yaml").write_text("not: [what it should be\n")
    with pytest.raises(InputError, match="can't be read as a ROS bag"):
        read(path)


# ------------------------------------------------------------------------------------------------------- as a stream


@pytest.mark.parametrize("kind", FORMATS)
def test_a_bag_is_replayed_message_by_message(kind: str, tmp_path: Path) -> None:
    """Each stream at its own rate, by its own stamps, in the units that the rig gives."""
    path = write(tmp_path, kind, [*arm(SLOW), *forces(FAST)])
    sources = [open_source(str(path), Asked(rig, NAMES, 0.0)) for rig in (None, Rig.parse_text(TWICE))]
    items, twice = (list(source.items()) for source in sources)
    for source in sources:
        source.close()
    joints, wrench = [i for i in items if isinstance(i, Joints)], [i for i in items if isinstance(i, Wrench)]
    assert [i.stamp for i in joints] == (START + SLOW).tolist()
    assert [i.stamp for i in wrench] == (START + FAST).tolist()
    assert all(i.received == (i.stamp or 0) + 200_000 for i in (*joints, *wrench))
    assert {i.names for i in joints} == {NAMES}
    np.testing.assert_array_equal(joints[-1].q, np.array([1.0, 2.0, 3.0]) + 1e-9 * SLOW[-1])
    np.testing.assert_array_equal([i.wrench[0] for i in wrench], 1e-9 * FAST)
    np.testing.assert_array_equal([i.wrench[0] for i in twice if isinstance(i, Wrench)], 2e-9 * FAST)


TWICE = "[columns]\nwrench = {scale = 2.0}\n"
