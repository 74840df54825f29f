"""An experiment on disk: the log on one clock, its streams as they came, the rig, and the truth in a folder of its own."""

from __future__ import annotations

import importlib.util
import json
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from kinid.errors import MissingDependencyError
from kinid.lab.folder import digest, digests
from kinid.lab.setup import Result, Setup
from kinid.log import Log
from kinid.rig import WRENCH
from kinid.writers import make_folder, replacing, write_table, write_text

Array = NDArray[np.float64]

#: when the virtual experiments took place [ns since 1970]
EPOCH = 1_700_000_000_000_000_000


def write_experiment(folder: Path, result: Result, truth: dict[str, Any], *, name: str = "log", mcap: bool = True) -> Path:
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
        write_log(temporary, result.log)
        known = {**digests(folder, files), path.name: digest(temporary)}
        told = as_truth(result, truth) | {"files": known}
        write_text(folder / "truth" / f"{name}.json", json.dumps(told, indent=1, default=_plain) + "\n")
    return path


def write_rig(folder: Path, setup: Setup) -> None:
    """`rig.toml`: what the experimenter believes."""
    lines = ["[robot]", f'model = "{setup.model}"', "", "[tool]", f"mass = {setup.tool.mass}", f"com = {list(setup.tool.com)}"]
    if any(setup.tool.inertia):
        lines.append(f"inertia = {list(setup.tool.inertia)}")
    lines += ["", "[surface]", f"point = {list(setup.point)}", f"normal = {list(setup.normal)}",
              f"tangent = {list(setup.tangent)}", "", "[sensor]"]  # fmt: skip
    sensor = setup.rig.sensor
    lines += [f"range = {list(sensor.range or ())}", f"noise = {list(sensor.noise or ())}"]
    lines += [f"bias = {[float(v) for v in sensor.bias or ()]}"]
    if sensor.crosstalk is not None:
        lines += ["crosstalk = [", *(f"  {[float(v) for v in row]}," for row in sensor.crosstalk), "]"]
    lines += ["", "[streams]", f"wrench_clock_offset = {setup.rig.streams.wrench_clock_offset}"]
    write_text(folder / "rig.toml", "\n".join(lines) + "\n")


def write_log(path: Path, log: Log) -> None:
    """A log as Parquet, with the columns of the log format."""
    columns: dict[str, NDArray[Any]] = {"t": log.t}
    for name, values in (("q", log.q), ("tau", log.tau)):
        if values is not None:
            columns |= {f"{name}{j + 1}": values[:, j] for j in range(values.shape[1])}
    if log.wrench is not None:
        columns |= {name: log.wrench[:, i] for i, name in enumerate(WRENCH)}
    if log.phase is not None:
        columns["phase"] = np.asarray(log.phase)
    write_table(path, columns, log.provenance.to_dict())


def as_truth(result: Result, more: dict[str, Any]) -> dict[str, Any]:
    """What no estimator may see."""
    setup, force = result.setup, result.motion.force
    wrench, joints = setup.wrench_stream, setup.joint_stream
    return {
        **more, "seed": setup.seed, "material": setup.material.truth(), "sensor": setup.sensor.truth(),
        "surface_offset": setup.surface_offset, "surface_slope": setup.surface_slope, "tip_offset": setup.true_tip,
        "gravity_error": setup.gravity_error,
        "tool": None if setup.true_tool is None else setup.true_tool.model_dump(),
        "streams": {"wrench": vars(wrench), "joints": vars(joints),
                    "wrench_after_joints": wrench.offset + wrench.delay - joints.offset - joints.delay},
        "deepest": float(result.motion.place[:, 2].max()), "greatest_force": np.abs(force).max(axis=0).tolist(),
        "work_of_the_material": float(result.motion.work[-1]),
    }  # fmt: skip


def check_mcap() -> None:
    """Refuse to write MCAP without its libraries, before anything runs.

    Raises:
        MissingDependencyError: no library for MCAP or for ROS messages.
    """
    if importlib.util.find_spec("mcap") is None or importlib.util.find_spec("rosbags") is None:
        raise MissingDependencyError("mcap and rosbags", "bags")


Streams = tuple[tuple[NDArray[np.int64], Array], tuple[NDArray[np.int64], Array]]


def stamped(result: Result) -> Streams:
    """Of joints and of wrench: the control periods that were logged, and their time stamps by the stream's own clock [s]."""
    setup = result.setup
    rng = np.random.default_rng(np.random.SeedSequence([setup.seed, 2]))
    joints, wrench = (stream.stamps(result.motion.t, rng) for stream in (setup.joint_stream, setup.wrench_stream))
    return joints, wrench


def write_streams(folder: Path, name: str, result: Result, streams: Streams) -> tuple[Path, Path]:
    """Each stream as a table of its own, as it was logged: NAME_joints.parquet and NAME_wrench.parquet."""
    make_folder(folder)
    (joints, joint_stamps), (wrench, wrench_stamps) = streams
    columns: dict[str, NDArray[Any]] = {"t": joint_stamps}
    for quantity, values in (("q", result.q), ("tau", result.tau)):
        columns |= {f"{quantity}{j + 1}": values[joints, j] for j in range(values.shape[1])}
    provenance = result.log.provenance.to_dict()
    paths = folder / f"{name}_joints.parquet", folder / f"{name}_wrench.parquet"
    write_table(paths[0], columns, provenance)
    columns = {"t": wrench_stamps} | {channel: result.wrench[wrench, i] for i, channel in enumerate(WRENCH)}
    write_table(paths[1], columns, provenance)
    return paths


def write_mcap(path: Path, result: Result, streams: Streams) -> None:
    """Joints and wrench as messages of ROS 2 (CDR), each with its own rate, clock, delay and losses; Foxglove opens it.

    Raises:
        MissingDependencyError: no library for MCAP or for ROS messages.
    """
    check_mcap()
    from mcap.writer import CompressionType, Writer
    from rosbags.typesys import Stores, get_typestore

    store, setup = get_typestore(Stores.ROS2_HUMBLE), result.setup
    types = store.types
    joint, wrench = "sensor_msgs/msg/JointState", "geometry_msgs/msg/WrenchStamped"
    header, time = types["std_msgs/msg/Header"], types["builtin_interfaces/msg/Time"]
    vector, torsor = types["geometry_msgs/msg/Vector3"], types["geometry_msgs/msg/Wrench"]
    names, nothing = list(setup.robot.joint_names), np.zeros(0)
    messages: list[tuple[int, int, bytes]] = []
    for channel, (rows, stamps) in enumerate(streams):
        nanoseconds = EPOCH + np.round((stamps + 1.0) * 1e9).astype(np.int64)
        for row, at in zip(rows, nanoseconds.tolist()):
            stamp = time(sec=at // 10**9, nanosec=at % 10**9)
            if channel == 0:
                head = header(stamp=stamp, frame_id="")
                message = types[joint](header=head, name=names, position=result.q[row], velocity=nothing, effort=result.tau[row])
            else:
                f = result.wrench[row].tolist()
                head = header(stamp=stamp, frame_id=setup.robot.sensor_frame or "")
                load = torsor(force=vector(x=f[0], y=f[1], z=f[2]), torque=vector(x=f[3], y=f[4], z=f[5]))
                message = types[wrench](header=head, wrench=load)
            messages.append((at, channel, bytes(store.serialize_cdr(message, joint if channel == 0 else wrench))))
    messages.sort(key=lambda item: item[:2])
    with replacing(path) as temporary, temporary.open("wb") as file:
        writer = Writer(file, compression=CompressionType.NONE)
        writer.start(profile="ros2", library="kinid")
        ids = []
        for topic, kind in (("/joint_states", joint), ("/ft_sensor/wrench", wrench)):
            text, _ = store.generate_msgdef(kind, ros_version=2)
            schema = writer.register_schema(name=kind, encoding="ros2msg", data=text.encode())
            ids.append(writer.register_channel(topic=topic, message_encoding="cdr", schema_id=schema))
        for at, channel, data in messages:
            writer.add_message(ids[channel], log_time=at, publish_time=at, data=data)
        writer.finish()


def _plain(value: Any) -> Any:
    """NumPy and other values as JSON knows them."""
    if isinstance(value, np.ndarray):
        return value.tolist()
    if isinstance(value, np.generic):
        return value.item()
    return str(value)
