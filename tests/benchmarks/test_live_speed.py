"""The live loop: processing of a sample, and the way from another process' sample to its estimate, over UDP and Zenoh.

Run with `pytest tests/benchmarks/test_live_speed.py --benchmark-enable -s`, for ten minutes each with
KINID_LIVE_SECONDS=600. The jitter of an idle loop on the same machine is printed beside the latencies: they can't be
better than that.
"""

from __future__ import annotations

import contextlib
import json
import os
import resource
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
import pytest
from scripted import RIG, scripted_poke

from kinid.data.rig import Rig
from kinid.live import Aligner, Pipeline, Session, open_source
from kinid.live.messages import Joints, Source, Wrench
from kinid.live.sources import Asked
from kinid.live.sources.udp import Socket

NAMES = tuple(f"joint_{i}" for i in range(1, 8))
MODEL = ("kelvin-voigt", "coulomb-friction")
SECONDS = int(os.environ.get("KINID_LIVE_SECONDS", "20"))
PEER = Path(__file__).parents[1] / "live/zenoh_peer.py"

#: sends joints and wrench at 1 kHz, stamped by the clock that all processes of a machine share
SENDS = """
import json, socket, sys, time
import numpy as np
out, port, n = socket.socket(socket.AF_INET, socket.SOCK_DGRAM), int(sys.argv[1]), int(sys.argv[2])
q = np.load(sys.argv[3])
rows = [(json.dumps(a)[:-1], json.dumps(b)[:-1]) for a, b in zip(
    [{"q": r.tolist()} for r in q["q"]], [{"wrench": r.tolist()} for r in q["w"]])]
begin = time.monotonic_ns() + 100_000_000
for k in range(n):
    while (left := begin + k * 1_000_000 - time.monotonic_ns()) > 0:
        time.sleep(1e-9 * left)
    joints, wrench = rows[k % len(rows)]
    stamp = f', "t_ns": {time.monotonic_ns()}}}'
    out.sendto((joints + stamp).encode(), ("127.0.0.1", port))
    out.sendto((wrench + stamp).encode(), ("127.0.0.1", port))
"""


def percentiles(values: Sequence[int] | np.ndarray) -> str:
    found = np.percentile(values, [50, 99, 99.9, 100]) / 1e3
    return ", ".join(f"{name} {value:.1f}" for name, value in zip(("median", "99 %", "99.9 %", "longest"), found))


def test_processing(benchmark) -> None:
    scripted = scripted_poke(seed=8)
    log = scripted.log
    rig = Rig.parse_text(RIG + f"bias = {scripted.bias.tolist()}\n")
    pipeline = Pipeline(rig, MODEL)
    stamps = [1_000_000_000 + 2_000_000 * k for k in range(len(log))]
    items = [(Joints(s, s, q), Wrench(s, s, w)) for s, q, w in zip(stamps, log.q.tolist(), log.wrench.tolist())]
    times: list[int] = []

    def run() -> None:
        pipeline.restart()
        aligner = Aligner(NAMES, lambda kind, says: None)
        for joints, wrench in items:
            begin = time.perf_counter_ns()
            aligner.put(joints)
            aligner.put(wrench)
            aligner.pair()
            pipeline.step(aligner.t, aligner.q, aligner.wrench, aligner.dq)
            times.append(time.perf_counter_ns() - begin)

    benchmark.pedantic(run, rounds=5 if benchmark.enabled else 1)
    if benchmark.enabled:
        print(f"\nprocessing of a sample, alignment included [µs]: {percentiles(times)}")
        assert np.median(times) <= 10e3


@contextlib.contextmanager
def over_udp(rig: Rig, cycles: int, log: Path) -> Iterator[Source]:
    """A sender in another process."""
    source = Socket("127.0.0.1:0")
    with subprocess.Popen([sys.executable, "-c", SENDS, str(source.port), str(cycles), str(log)]):
        yield source


@contextlib.contextmanager
def over_zenoh(rig: Rig, cycles: int, log: Path) -> Iterator[Source]:
    """A robot of ROS 2 in another process."""
    pytest.importorskip("zenoh")
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        port = taken.getsockname()[1]
    plan = json.dumps({"cycles": cycles, "faults": [], "log": str(log)})
    command = [sys.executable, str(PEER), str(port), "peer", plan]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as robot:
        assert robot.stdout is not None
        assert robot.stdout.readline() == "ready\n"
        yield open_source(f"zenoh://127.0.0.1:{port}", Asked(rig, NAMES))
        robot.kill()


@pytest.mark.parametrize("way", [over_udp, over_zenoh])
def test_from_another_process(benchmark, tmp_path, way) -> None:
    scripted = scripted_poke(seed=8)
    rig = Rig.parse_text(RIG + f"bias = {scripted.bias.tolist()}\n")
    np.savez(tmp_path / "log.npz", q=scripted.log.q, w=scripted.log.wrench)
    cycles, late = 1000 * SECONDS if benchmark.enabled else 300, np.zeros(1000 * SECONDS, np.int64)
    with way(rig, cycles, tmp_path / "log.npz") as source:
        session = Session(source, Pipeline(rig, MODEL), NAMES)
        step, peaks = session.pipeline.step, list[int]()

        def timed(*sample):
            event_bits = step(*sample)
            late[session.samples] = clock() - session.aligner.stamp
            if session.samples % 5000 == 0:
                peaks.append(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss)
            if session.samples + 1 >= cycles:
                session.stop()
            return event_bits

        # ROS 2 stamps by the wall's clock, the other sender by the one that all processes share
        clock = time.time_ns if way is over_zenoh else time.monotonic_ns
        session.pipeline.step = timed
        # a message that is lost mustn't make it wait for ever
        guard = threading.Timer(1.5 * SECONDS + 20, session.stop)
        guard.start()
        benchmark.pedantic(session.run, rounds=1)
        guard.cancel()
    assert session.samples == cycles  # none lost
    if not benchmark.enabled:
        return
    idle = []
    for _ in range(10_000):
        begin = time.monotonic_ns()
        time.sleep(1e-3)
        idle.append(time.monotonic_ns() - begin - 1_000_000)
    print(f"\n{way.__name__}, {SECONDS} s, from another process' sample to its estimate [µs]: {percentiles(late)}")
    print(f"processing of a sample [µs]: {session.processing.summary()}")
    print(f"an idle loop that sleeps 1 ms is late by [µs]: {percentiles(idle)}")
    print(f"memory after 5 s and at the end [kB]: {peaks[1]}, {peaks[-1]}; events: {dict(session.counts)}")
