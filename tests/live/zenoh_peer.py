"""A robot of ROS 2 over Zenoh, as rmw_zenoh sends it, in a process of its own: PORT MODE and a plan of faults in JSON.

The plan is {"cycles": n, "faults": [[cycle, kind], …], "log": "file.npz"}; each cycle of 1 ms sends joints and wrench,
of that log's arrays `q` and `w` over and over where it is named. It says "ready"
once it can be reached, and the time of each fault, [monotonic ns, kind], before it sends it.
"""

from __future__ import annotations

import json
import struct
import sys
import time
from typing import Any

import numpy as np
import zenoh
from rosbags.typesys import Stores, get_typestore

STORE = get_typestore(Stores.ROS2_HUMBLE)
NAMES = [f"joint_{i}" for i in range(1, 8)]
Q = np.deg2rad([0.0, -40.0, 0.0, 85.0, 0.0, -55.0, 0.0])
HASH = "RIHS01_a13ee3a330e346c9d87b5aa18d24e11690752bd33a0350f11c5882bc9179260e"
KEYS = {
    "joints": f"0/joint_states/sensor_msgs::msg::dds_::JointState_/{HASH}",
    "wrench": "0/ft/wrench/geometry_msgs::msg::dds_::WrenchStamped_/TypeHashNotSupported",
}


def header(stamp: int) -> Any:
    kinds = STORE.types
    time_of = kinds["builtin_interfaces/msg/Time"](*divmod(stamp, 1_000_000_000))
    return kinds["std_msgs/msg/Header"](time_of, "")


def joints(stamp: int, q: Any = Q, names: Any = NAMES) -> bytes:
    message = STORE.types["sensor_msgs/msg/JointState"](header(stamp), list(names), q, 0 * np.asarray(q), np.empty(0))
    return bytes(STORE.serialize_cdr(message, "sensor_msgs/msg/JointState"))


def wrench(stamp: int, force: Any = (0.0, 0.0, -2.4), torque: Any = (0.0, 0.0, 0.0)) -> bytes:
    kinds = STORE.types
    vector = kinds["geometry_msgs/msg/Vector3"]
    both = kinds["geometry_msgs/msg/Wrench"](vector(*force), vector(*torque))
    message = kinds["geometry_msgs/msg/WrenchStamped"](header(stamp), both)
    return bytes(STORE.serialize_cdr(message, "geometry_msgs/msg/WrenchStamped"))


class Played:
    """A log's messages, made before they are needed: what is sent in time mustn't wait for its serialisation."""

    def __init__(self, file: str) -> None:
        log = np.load(file)
        self.made = [(bytearray(joints(0, q)), bytearray(wrench(0, w[:3], w[3:]))) for q, w in zip(log["q"], log["w"])]

    def at(self, cycle: int, stamp: int) -> tuple[bytes, bytes]:
        made = self.made[cycle % len(self.made)]
        for payload in made:  # the header's stamp comes first, behind the four bytes of CDR's encapsulation
            struct.pack_into("<iI", payload, 4, *divmod(stamp, 1_000_000_000))
        return bytes(made[0]), bytes(made[1])


class Robot:
    """Publishers of both topics; each has a running number and a name."""

    def __init__(self, port: int, mode: str, life: int = 0) -> None:
        where = "listen" if mode != "client" else "connect"
        settings = {
            "mode": mode,
            where: {"endpoints": [f"tcp/127.0.0.1:{port}"]},
            "scouting": {"multicast": {"enabled": False}, "gossip": {"enabled": False}},
        }
        self.session = zenoh.open(zenoh.Config.from_json5(json.dumps(settings)))
        # kept and sent at once, as rmw_zenoh does for what is reliable
        how = {"congestion_control": zenoh.CongestionControl.BLOCK, "express": True}
        self.publishers = {role: self.session.declare_publisher(key, **how) for role, key in KEYS.items()}
        self.numbers = dict.fromkeys(KEYS, 0)
        self.gid = struct.pack("<B16s", 16, f"publisher {life}".encode())

    def wait(self) -> None:
        """Until somebody listens."""
        while not all(publisher.matching_status.matching for publisher in self.publishers.values()):
            time.sleep(0.005)

    def put(self, role: str, payload: bytes, lost: bool = False) -> None:
        self.numbers[role] += 1
        if not lost:
            attachment = struct.pack("<qq", self.numbers[role], time.time_ns()) + self.gid
            self.publishers[role].put(payload, attachment=attachment)

    def put_beside(self, payload: bytes, number: int) -> None:
        """Joints of another device, whose publisher is another one."""
        gid = struct.pack("<B16s", 16, b"gripper")
        self.publishers["joints"].put(payload, attachment=struct.pack("<qq", number, time.time_ns()) + gid)


def run(port: int, mode: str, plan: Any) -> None:
    robot, faults = Robot(port, mode), dict(map(tuple, plan["faults"]))
    played = Played(plan["log"]) if "log" in plan else None
    print("ready", flush=True)
    robot.wait()
    shift = held = 0
    begin, waiting = time.monotonic_ns(), list[tuple[str, bytes, bool]]()
    for cycle in range(plan["cycles"]):
        while (left := begin + 1_000_000 * cycle - time.monotonic_ns()) > 0:
            time.sleep(1e-9 * left)
        stamp, fault = time.time_ns() + shift, faults.get(cycle)
        if fault:
            print(json.dumps([time.monotonic_ns(), fault]), flush=True)
        if fault == "source-restarted":
            robot.session.close()
            time.sleep(0.25)
            robot = Robot(port, mode, cycle)
            robot.wait()
            begin = time.monotonic_ns() - 1_000_000 * cycle  # what it would have sent is gone
            continue
        if fault == "clock-jump":
            shift += 3_000_000_000 if cycle % 2 else -3_000_000_000
            stamp = time.time_ns() + shift
        held = 80 if fault == "delayed" else held
        position, names = Q, NAMES
        if fault == "not-finite":
            position = np.where(np.arange(7) == cycle % 7, np.nan, Q)
        if fault == "joint-names":
            names = [f"panda_{i}" for i in range(7)]
        if played:
            for role, payload in zip(KEYS, played.at(cycle, stamp)):
                robot.put(role, payload)
            continue
        if plan.get("gripper"):
            robot.put_beside(joints(stamp, Q[:2], ["finger_1", "finger_2"]), cycle + 1)
        payload = joints(stamp, position, names)
        if fault == "malformed":
            payload = payload[: cycle % len(payload)]
        waiting += [("joints", payload, fault == "gap"), ("wrench", wrench(stamp), False)]
        if fault == "repeated":
            waiting.append(waiting[-1])
        if fault == "late":  # behind a newer one
            waiting.append(("wrench", wrench(stamp - 2_500_000), False))
        held -= 1
        if held <= 0:
            for message in waiting:
                robot.put(*message)
            waiting.clear()
    time.sleep(0.2)
    robot.session.close()


if __name__ == "__main__":
    if sys.argv[2] == "router":  # and nothing else
        settings = {"mode": "router", "listen": {"endpoints": [f"tcp/127.0.0.1:{sys.argv[1]}"]}}
        with zenoh.open(zenoh.Config.from_json5(json.dumps(settings))):
            print("ready", flush=True)
            sys.stdin.read()
    else:
        run(int(sys.argv[1]), sys.argv[2], json.loads(sys.argv[3]))
