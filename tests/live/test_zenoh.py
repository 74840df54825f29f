"""ROS 2 over Zenoh: a peer and a router in processes of their own, whole streams and faulty ones."""

from __future__ import annotations

import contextlib
import json
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest
from live.prepared import NAMES, listening

pytest.importorskip("zenoh")

from live.zenoh_peer import Q, joints, wrench

from kinid.data.rig import Rig
from kinid.errors import InputError, MissingDependencyError
from kinid.live import Event, Pipeline, Session, open_source
from kinid.live.messages import Item, Joints, Notice, Wrench
from kinid.live.sources import Asked
from kinid.live.sources.zenoh import Client

Run = Callable[..., tuple[int, str, str]]
PEER = Path(__file__).with_name("zenoh_peer.py")


def free() -> int:
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        return int(taken.getsockname()[1])


@contextlib.contextmanager
def process(
    port: int, mode: str, cycles: int = 0, faults: object = (), gripper: bool = False
) -> Iterator[subprocess.Popen[str]]:
    """A robot, or a router, that is ready."""
    plan = json.dumps({"cycles": cycles, "faults": faults, "gripper": gripper})
    command = [sys.executable, str(PEER), str(port), mode, plan]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as running:
        try:
            assert running.stdout is not None
            assert running.stdout.readline() == "ready\n"
            yield running
        finally:
            running.kill()


def collect(source: Client, enough: int, begun: Iterator[Item] | None = None) -> list[Item]:
    end, out = time.monotonic() + 10.0, list[Item]()
    for item in begun or source.items():
        if item is not None:
            out.append(item)
        if len(out) >= enough or time.monotonic() > end:
            break
    source.close()
    return out


def test_both_streams_of_a_peer_are_whole() -> None:
    port = free()
    with process(port, "peer", 200):
        source = open_source(f"zenoh://127.0.0.1:{port}", Asked(joints=NAMES))
        assert isinstance(source, Client)
        items = collect(source, 400)
    both = [[i for i in items if isinstance(i, kind)] for kind in (Joints, Wrench)]
    assert [len(stream) for stream in both] == [200, 200]
    first, force = both[0][0], both[1][0]
    assert isinstance(first, Joints)
    assert isinstance(force, Wrench)
    assert first.names == NAMES
    np.testing.assert_array_equal(first.q, Q)
    assert len(first.dq) == 7
    assert len(first.tau) == 0
    assert list(force.wrench) == [0.0, 0.0, -2.4, 0.0, 0.0, 0.0]
    for stream in both:
        stamps = [item.stamp or 0 for item in stream if isinstance(item, Joints | Wrench)]
        assert np.diff(stamps).min() > 0
        assert abs(stamps[0] - time.time_ns()) < 60e9


def test_a_gripper_that_publishes_on_the_same_topic_is_left_out() -> None:
    port = free()
    with process(port, "peer", 200, gripper=True):
        source = open_source(f"zenoh://127.0.0.1:{port}", Asked(joints=NAMES))
        assert isinstance(source, Client)
        items = collect(source, 400)
    told = [item.kind for item in items if isinstance(item, Notice)]
    assert 1 <= told.count("topic") <= 2
    assert set(told) <= {"topic"}
    joints = [item for item in items if isinstance(item, Joints)]
    assert sum(item.names == NAMES for item in joints) >= 195
    assert sum(item.names != NAMES for item in joints) <= 3  # until both are known


def test_a_router_stands_between_and_nothing_listens() -> None:
    port = free()
    before = listening()  # of servers that other tests began
    with process(port, "router"):
        source = Client(f"127.0.0.1:{port}", Rig.parse_text('[streams]\nwrench = "/ft/wrench"\n'))
        assert not listening() - before
        # the robot is a client of the router, as this is: begun second, so that nothing of it is missed
        with process(port, "client", 50):
            items = collect(source, 100)
    assert [type(i) for i in items].count(Joints) == [type(i) for i in items].count(Wrench) == 50


KINDS = (
    *("gap", "repeated", "late", "clock-jump", "delayed", "source-restarted"),
    *("not-finite", "joint-names", "malformed"),
)
EACH = 250  # cycles of 1 ms from one fault to the next: an outage of 0.25 s ends within


@pytest.mark.parametrize("many", [len(KINDS), pytest.param(500, marks=pytest.mark.slow)])
def test_each_fault_on_the_way_is_told(many: int, rig: Rig) -> None:
    rng = np.random.default_rng(28)
    kinds = [*KINDS, *rng.choice(KINDS, many - len(KINDS)).tolist()]
    rng.shuffle(kinds)
    port, reports = free(), list[tuple[int, str]]()
    pipeline = Pipeline(rig, ("kelvin-voigt", "coulomb-friction"))
    plan = [(EACH * (1 + i), kind) for i, kind in enumerate(kinds)]
    with process(port, "peer", EACH * (many + 1), plan) as robot:
        assert robot.stdout is not None
        source = open_source(f"zenoh://127.0.0.1:{port}", Asked(rig, NAMES))

        def tell(event: Event) -> None:
            reports.append((time.monotonic_ns(), event.kind))

        session, lines = Session(source, pipeline, NAMES, tell=tell), list[str]()

        def read() -> None:
            assert robot.stdout is not None
            lines.extend(robot.stdout)
            session.stop()

        reader = threading.Thread(target=read)
        reader.start()
        session.run()
        reader.join(10)
    planted = [(int(at), str(kind)) for at, kind in map(json.loads, lines)]
    assert [kind for _, kind in planted] == kinds
    # told before the next but one is sent: a busy machine is late
    ends = [at for at, _ in planted[2:]] + 2 * [planted[-1][0] + 10**10]
    missed = [
        (kind, at)
        for (at, kind), end in zip(planted, ends)
        if not any(at <= t < end and kind == name for t, name in reports)
    ]
    print(f"{len(planted)} faults, {len(missed)} not told; events {dict(session.counts)}")
    assert missed == []
    # each time it died, silence and return were told too
    assert session.counts["stream-lost"] >= kinds.count("source-restarted")
    assert session.counts["stream-returned"] >= kinds.count("source-restarted")
    assert session.samples > 0.8 * EACH * (many + 1) - 400 * kinds.count("source-restarted")


def test_topics_that_are_not_asked_for(rig: Rig) -> None:
    import zenoh

    port = free()
    settings = {"listen": {"endpoints": [f"tcp/127.0.0.1:{port}"]}, "scouting": {"multicast": {"enabled": False}}}
    with zenoh.open(zenoh.Config.from_json5(json.dumps(settings))) as robot:
        source, kind = Client(f"127.0.0.1:{port}/7"), "sensor_msgs::msg::dds_::JointState_/x"
        forces = "7/w/geometry_msgs::msg::dds_::WrenchStamped_/x"
        items = source.items()
        # messages sent before both subscriptions got there would be lost
        publishers = [robot.declare_publisher(key) for key in (f"7/arm/joint_states/{kind}", forces)]
        end = time.monotonic() + 10.0
        while not all(publisher.matching_status.matching for publisher in publishers):
            assert next(items) is None
            assert time.monotonic() < end
        # kept and sent at once, as rmw_zenoh does for what is reliable: a busy machine drops others
        how = {"congestion_control": zenoh.CongestionControl.BLOCK, "express": True}
        for topic in ("7/arm/joint_states", "7/hand", "7/hand", "8/arm/joint_states", "7/arm/joint_states"):
            robot.put(f"{topic}/{kind}", joints(5), **how)
        robot.put(forces, wrench(6)[:40], **how)
        came = collect(source, 4, items)
    # each subscription has a thread of its own: what comes keeps its order within one, not between them
    (broken,) = [item for item in came if isinstance(item, Notice) and item.kind == "malformed"]
    first, other, second = [item for item in came if item is not broken]
    assert isinstance(first, Joints)
    assert isinstance(second, Joints)
    assert isinstance(other, Notice)
    assert (other.kind, other.says) == ("topic", "/hand beside /arm/joint_states: [streams] joints chooses")
    assert "40 bytes" in broken.says


def test_a_topic_that_nobody_publishes_is_told_with_those_that_are_there(run: Run, log: Path) -> None:
    port = free()
    rig = log.parent / "rig.toml"
    rig.write_text(rig.read_text() + '\n[streams]\nwrench = "/ft/other"\n')
    with process(port, "peer", 8000):
        args = ("live", f"zenoh://127.0.0.1:{port}", "--rig", rig, "--model", "kelvin-voigt")
        code, out, err = run(*args, "--duration", 1)
    assert code == 2
    missed = "/ft/other, as [streams] wrench names it, doesn't come; of its type there is /ft/wrench"
    assert out.count(missed) == 1
    assert err.count("\n") == 1
    assert "joints from zenoh" in err
    assert missed in err


def test_what_cannot_be_reached_is_one_line(monkeypatch: pytest.MonkeyPatch) -> None:
    import kinid.live.sources.zenoh as source

    monkeypatch.setattr(source, "ANSWERS", 0.2)
    with pytest.raises(InputError, match=r"nobody who answers at zenoh://127.0.0.1:\d+/0") as refused:
        Client(f"127.0.0.1:{free()}")
    assert "\n" not in str(refused.value)
    with pytest.raises(InputError, match="correct .streams. wrench"):
        Client(f"127.0.0.1:{free()}", Rig.parse_text('[streams]\nwrench = "/ft//wrench"\n'))
    with pytest.raises(InputError, match="found domain 233; expected 0 to 232"):
        Client("127.0.0.1:7447/233")
    monkeypatch.setitem(sys.modules, "zenoh", None)
    with pytest.raises(MissingDependencyError, match=r"kinid\[live\]"):
        Client(f"127.0.0.1:{free()}")
