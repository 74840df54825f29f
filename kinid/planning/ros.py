"""A trajectory for ROS users: `trajectory_msgs/JointTrajectory` in an MCAP file."""

from __future__ import annotations

import json
from pathlib import Path

from kinid.errors import MissingDependencyError
from kinid.planning.trajectory import Trajectory
from kinid.writers import replacing

#: ROS type of the message, and its topic
TYPE = "trajectory_msgs/msg/JointTrajectory"
TOPIC = "/joint_trajectory"


def write_joint_trajectory(motion: Trajectory, path: Path, topic: str = TOPIC) -> None:
    """One ROS 2 (CDR) message with positions, velocities and accelerations of every sample, in an MCAP file.

    Raises:
        MissingDependencyError: without the extra `bags`.
    """
    try:
        from mcap.writer import Writer
        from rosbags.typesys import Stores, get_typestore
        from rosbags.typesys.msg import get_types_from_msg
    except ImportError:
        raise MissingDependencyError("mcap and rosbags", "bags") from None
    import numpy as np

    store = get_typestore(Stores.ROS2_HUMBLE)
    types, none = store.types, np.zeros(0)
    if TYPE not in types:
        store.register(get_types_from_msg(_TRAJECTORY, TYPE) | get_types_from_msg(_POINT, TYPE + "Point"))
    duration, stamp = types["builtin_interfaces/msg/Duration"], types["builtin_interfaces/msg/Time"]
    points = []
    for t, q, dq, ddq in zip(motion.t - motion.t[0], motion.q, motion.dq, motion.ddq):
        nanoseconds = round(float(t) * 1e9)
        after = duration(sec=nanoseconds // 10**9, nanosec=nanoseconds % 10**9)
        points.append(
            types[TYPE + "Point"](positions=q, velocities=dq, accelerations=ddq, effort=none, time_from_start=after)
        )
    header = types["std_msgs/msg/Header"](stamp=stamp(sec=0, nanosec=0), frame_id="")
    message = types[TYPE](header=header, joint_names=list(motion.joint_names), points=points)
    definition, _ = store.generate_msgdef(TYPE, ros_version=2)
    with replacing(path) as temporary, temporary.open("wb") as stream:
        writer = Writer(stream)
        writer.start(profile="ros2", library="kinid")
        schema = writer.register_schema(name=TYPE, encoding="ros2msg", data=definition.encode())
        channel = writer.register_channel(topic=topic, message_encoding="cdr", schema_id=schema)
        writer.add_message(channel, log_time=0, publish_time=0, data=bytes(store.serialize_cdr(message, TYPE)))
        writer.add_metadata("kinid", {"provenance": json.dumps(dict(motion.provenance), default=str)})
        writer.finish()


_TRAJECTORY = "std_msgs/Header header\nstring[] joint_names\ntrajectory_msgs/JointTrajectoryPoint[] points\n"
_POINT = (
    "float64[] positions\nfloat64[] velocities\nfloat64[] accelerations\nfloat64[] effort\n"
    "builtin_interfaces/Duration time_from_start\n"
)
