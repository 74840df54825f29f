"""An experiment on disk: the log on one clock, its streams as they came, the rig, and the truth in a folder of its
own.
"""

from __future__ import annotations

import functools
import importlib.util
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from kinid.data.log import Log
from kinid.data.rig import WRENCH
from kinid.errors import MissingDependencyError
from kinid.inputs import digest
from kinid.lab.folder import digests
from kinid.lab.setup import LOG_EVERY, Result, Setup
from kinid.writers import Column, make_folder, replacing, write_json, write_table, write_text

if TYPE_CHECKING:
    from rosbags.typesys.store import Typestore

Array = NDArray[np.float64]

JOINTS, WRENCHES, TARGET, PHASE = _TOPICS = "/joint_states", "/ft_sensor/wrench", "/target_pose", "/phase"
_KINDS = (
    "sensor_msgs/msg/JointState",
    "geometry_msgs/msg/WrenchStamped",
    "geometry_msgs/msg/PoseStamped",
    "std_msgs/msg/String",
)
#: frame of the target's pose
BASE = "base_link"
#: the phase is told at each change, and again after so long [s]
AGAIN = 0.1
#: when the virtual experiments took place [ns since 1970]
EPOCH = 1_700_000_000_000_000_000


def write_experiment(
    folder: Path, result: Result, truth: dict[str, object], *, name: str = "log", mcap: bool = True
) -> Path:
    """Write rig, streams, truth and, last of all, the log; each file whole or not at all. The log's path.

    What is told as truth ends with the digests of the files, by which `kinid.lab.folder.is_whole` knows them again.

    Raises:
        InputError: a folder that can't be made or written to.
        MissingDependencyError: no library for MCAP.
    """
    make_folder(folder / "truth")
    write_rig(folder, result.setup)
    motion = result.motion
    columns = {"t": motion.t, "work": motion.work}
    columns |= {f"tip_{a}": motion.tip[:, i] for i, a in enumerate("xyz")}
    for i, force in enumerate(("tangential_force1", "tangential_force2", "normal_force")):
        columns[force] = motion.force[:, i]
    columns |= {quantity: motion.place[:, i] for i, quantity in enumerate(("slip1", "slip2", "depth"))}
    files = [folder / "truth" / f"{name}.parquet"]
    write_table(files[0], columns)
    if mcap:
        streams = stamped(result)
        files += [*write_streams(folder / "streams", name, result, streams), folder / f"{name}.mcap"]
        write_mcap(files[-1], result, streams)
    path = folder / f"{name}.parquet"
    with replacing(path) as temporary:
        write_log(temporary, result.log, targets(result, np.arange(0, len(result.q), LOG_EVERY)))
        known = {**digests(folder, files), path.name: digest(temporary)}
        facts = as_truth(result, truth) | {"files": known}
        write_json(folder / "truth" / f"{name}.json", facts)
    return path


def write_rig(folder: Path, setup: Setup) -> None:
    """`rig.toml`: what the experimenter believes."""
    tool, sensor = setup.tool, setup.rig.sensor
    inertia = [f"inertia = {list(tool.inertia)}"] if any(tool.inertia) else []
    crosstalk = []
    if sensor.crosstalk is not None:
        crosstalk = ["crosstalk = [", *(f"  {[float(v) for v in row]}," for row in sensor.crosstalk), "]"]
    lines = [
        f'[robot]\nmodel = "{setup.model}"\n',
        f"[tool]\nmass = {tool.mass}\ncom = {list(tool.com)}",
        *inertia,
        f"\n[surface]\npoint = {list(setup.point)}\nnormal = {list(setup.normal)}\ntangent = {list(setup.tangent)}\n",
        f"[sensor]\nrange = {list(sensor.range or ())}\nnoise = {list(sensor.noise or ())}",
        f"bias = {[float(v) for v in sensor.bias or ()]}",
        *crosstalk,
        f"\n[streams]\nwrench_clock_offset = {setup.rig.streams.wrench_clock_offset}",
    ]
    write_text(folder / "rig.toml", "\n".join(lines) + "\n")


def targets(result: Result, rows: NDArray[np.int64]) -> dict[str, Array]:
    """Where the controller was told to put the tip at some control periods, base frame: place [m] and quaternion."""
    positions, rotations = result.targets
    turned = Rotation.from_matrix(rotations[rows]).as_quat()
    columns = {f"target_{axis}": positions[rows, i] for i, axis in enumerate("xyz")}
    return columns | {f"target_q{axis}": turned[:, i] for i, axis in enumerate("xyzw")}


def write_log(path: Path, log: Log, more: dict[str, Array] | None = None) -> None:
    """A log as Parquet, with the columns of the log format, and more that readers pass over."""
    columns: dict[str, Column] = {"t": log.t}
    for name, values in (("q", log.q), ("tau", log.tau)):
        if values is not None:
            columns |= numbered(name, values)
    if log.wrench is not None:
        columns |= {name: log.wrench[:, i] for i, name in enumerate(WRENCH)}
    if log.phase is not None:
        columns["phase"] = np.asarray(log.phase)
    write_table(path, columns | (more or {}), log.provenance.to_dict())


def numbered(name: str, values: Array) -> dict[str, Column]:
    """Columns of a table, (n, N), as name1 … nameN."""
    return {f"{name}{j + 1}": values[:, j] for j in range(values.shape[1])}


def as_truth(result: Result, more: dict[str, object]) -> dict[str, object]:
    """What no estimator may see."""
    setup, force = result.setup, result.motion.force
    wrench, joints = setup.wrench_stream, setup.joint_stream
    return {
        **more,
        "seed": setup.seed,
        "material": setup.material.truth(),
        "sensor": setup.sensor.truth(),
        "surface_offset": setup.surface_offset,
        "surface_slope": setup.surface_slope,
        "tip_offset": setup.true_tip,
        "gravity_error": setup.gravity_error,
        "tool": None if setup.true_tool is None else setup.true_tool.model_dump(),
        "streams": {
            "wrench": vars(wrench),
            "joints": vars(joints),
            "wrench_after_joints": wrench.offset + wrench.delay - joints.offset - joints.delay,
        },
        "deepest": float(result.motion.place[:, 2].max()),
        "greatest_force": np.abs(force).max(axis=0).tolist(),
        "work_of_the_material": float(result.motion.work[-1]),
    }


def check_mcap() -> None:
    """Refuse to write MCAP without its libraries, before anything runs.

    Raises:
        MissingDependencyError: no library for MCAP or for ROS messages.
    """
    if importlib.util.find_spec("mcap") is None or importlib.util.find_spec("rosbags") is None:
        raise MissingDependencyError("mcap and rosbags", "bags")


Streams = tuple[tuple[NDArray[np.int64], Array], tuple[NDArray[np.int64], Array]]


def stamped(result: Result) -> Streams:
    """Of joints and of wrench: the control periods that were logged, and their time stamps by the stream's own clock
    [s].
    """
    setup = result.setup
    rng = np.random.default_rng(np.random.SeedSequence([setup.seed, 2]))
    joints, wrench = (stream.stamps(result.motion.t, rng) for stream in (setup.joint_stream, setup.wrench_stream))
    return joints, wrench


def write_streams(folder: Path, name: str, result: Result, streams: Streams) -> tuple[Path, Path]:
    """Each stream as a table of its own, as it was logged: NAME_joints.parquet and NAME_wrench.parquet."""
    make_folder(folder)
    (joints, joint_stamps), (wrench, wrench_stamps) = streams
    columns: dict[str, Column] = {"t": joint_stamps}
    columns |= numbered("q", result.q[joints]) | numbered("tau", result.tau[joints])
    provenance = result.log.provenance.to_dict()
    paths = folder / f"{name}_joints.parquet", folder / f"{name}_wrench.parquet"
    write_table(paths[0], columns, provenance)
    columns = {"t": wrench_stamps} | {channel: result.wrench[wrench, i] for i, channel in enumerate(WRENCH)}
    write_table(paths[1], columns, provenance)
    return paths


def write_mcap(path: Path, result: Result, streams: Streams) -> None:
    """Joints and wrench as messages of ROS 2 (CDR), each with its own rate, clock, delay and losses; Foxglove opens it.

    Beside them, on the controller's clock, the pose that the tip was told to take and the protocol's phase.

    Raises:
        MissingDependencyError: no library for MCAP or for ROS messages.
    """
    check_mcap()
    from mcap.writer import CompressionType, Writer

    messages = sorted(_messages(result, streams), key=lambda item: (item.at, _TOPICS.index(item.topic)))
    with replacing(path) as temporary, temporary.open("wb") as file:
        writer = Writer(file, compression=CompressionType.NONE)
        writer.start(profile="ros2", library="kinid")
        channels = {}
        for topic, kind in zip(_TOPICS, _KINDS):
            text, _ = _store().generate_msgdef(kind, ros_version=2)
            schema = writer.register_schema(name=kind, encoding="ros2msg", data=text.encode())
            channels[topic] = writer.register_channel(topic=topic, message_encoding="cdr", schema_id=schema)
        for at, topic, data in messages:
            writer.add_message(channels[topic], log_time=at, publish_time=at, data=data)
        writer.finish()


class _Message(NamedTuple):
    """Time of reception [ns], topic, and bytes."""

    at: int
    topic: str
    data: bytes


@functools.cache
def _store() -> Typestore:
    """Definitions of ROS messages."""
    from rosbags.typesys import Stores, get_typestore

    return get_typestore(Stores.ROS2_HUMBLE)


def _messages(result: Result, streams: Streams) -> Iterator[_Message]:
    """All messages of a run, topic by topic."""
    store, setup = _store(), result.setup
    types = store.types
    header, time = types["std_msgs/msg/Header"], types["builtin_interfaces/msg/Time"]
    vector, quaternion = types["geometry_msgs/msg/Vector3"], types["geometry_msgs/msg/Quaternion"]
    names, nothing = list(setup.robot.joint_names), np.zeros(0)

    def head(at: int, frame: str) -> object:
        return header(stamp=time(sec=at // 10**9, nanosec=at % 10**9), frame_id=frame)

    def pack(kind: str, **fields: object) -> bytes:
        return bytes(store.serialize_cdr(types[kind](**fields), kind))

    (joints, joint_stamps), (wrench, wrench_stamps) = streams
    poses = np.column_stack(list(targets(result, joints).values())).tolist()
    for row, at, target in zip(joints, _nanoseconds(joint_stamps), poses):
        yield _Message(
            at,
            JOINTS,
            pack(
                _KINDS[0],
                header=head(at, ""),
                name=names,
                position=result.q[row],
                velocity=nothing,
                effort=result.tau[row],
            ),
        )
        x, y, z, *turned = target
        place = types["geometry_msgs/msg/Point"](x=x, y=y, z=z)
        pose = types["geometry_msgs/msg/Pose"](position=place, orientation=quaternion(*turned))
        yield _Message(at, TARGET, pack(_KINDS[2], header=head(at, BASE), pose=pose))
    for row, at in zip(wrench, _nanoseconds(wrench_stamps)):
        f = result.wrench[row].tolist()
        load = types["geometry_msgs/msg/Wrench"](force=vector(*f[:3]), torque=vector(*f[3:]))
        yield _Message(at, WRENCHES, pack(_KINDS[1], header=head(at, setup.robot.sensor_frame or ""), wrench=load))
    phase = setup.script.phase
    again = np.arange(0, len(phase), max(1, round(AGAIN / setup.gains.period)))  # for who listens in late
    begins = np.flatnonzero(phase[1:] != phase[:-1]) + 1
    rows = np.union1d(again, begins)
    for row, at in zip(rows, _nanoseconds(result.motion.t[rows])):
        yield _Message(at, PHASE, pack(_KINDS[3], data=str(phase[row])))


def _nanoseconds(stamps: Array) -> list[int]:
    """Of stamps [s] since the experiment began: since 1970."""
    out: list[int] = (EPOCH + np.round((stamps + 1.0) * 1e9).astype(np.int64)).tolist()
    return out
