"""The live loop: processing of a sample, and the way from another process' sample to its estimate, over UDP.

Run with `pytest tests/benchmarks/test_live_speed.py --benchmark-enable -s`. The jitter of an idle loop on the same
machine is printed beside the latencies: they can't be better than that.
"""

from __future__ import annotations

import resource
import subprocess
import sys
import threading
import time

import numpy as np
from scripted import RIG, scripted_poke

from kinid.data.rig import Rig
from kinid.live import Aligner, Pipeline, Session
from kinid.live.messages import Joints, Wrench
from kinid.live.sources.udp import Socket

NAMES = tuple(f"joint_{i}" for i in range(1, 8))
MODEL = ("kelvin-voigt", "coulomb-friction")
SECONDS = 20

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


def percentiles(values: list[int]) -> str:
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


def test_from_another_process(benchmark, tmp_path) -> None:
    scripted = scripted_poke(seed=8)
    rig = Rig.parse_text(RIG + f"bias = {scripted.bias.tolist()}\n")
    np.savez(tmp_path / "log.npz", q=scripted.log.q, w=scripted.log.wrench)
    cycles = 1000 * SECONDS if benchmark.enabled else 300
    source, late = Socket("127.0.0.1:0"), []
    session = Session(source, Pipeline(rig, MODEL), NAMES)
    step = session.pipeline.step

    def timed(*sample):
        event_bits = step(*sample)
        late.append(time.monotonic_ns() - session.aligner.stamp)
        if len(late) >= cycles:
            session.stop()
        return event_bits

    session.pipeline.step = timed
    command = [sys.executable, "-c", SENDS, str(source.port), str(cycles), str(tmp_path / "log.npz")]
    memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    guard = threading.Timer(3 * SECONDS + 20, session.stop)  # a datagram that is lost mustn't make it wait for ever
    guard.start()

    def run() -> None:
        with subprocess.Popen(command):
            session.run()

    benchmark.pedantic(run, rounds=1)
    guard.cancel()
    assert len(late) == cycles  # none lost
    if not benchmark.enabled:
        return
    idle = []
    for _ in range(2000):
        begin = time.monotonic_ns()
        time.sleep(1e-3)
        idle.append(time.monotonic_ns() - begin - 1_000_000)
    grown = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - memory
    print(f"\nfrom another process' sample to its estimate [µs]: {percentiles(late)}")
    print(f"an idle loop that sleeps 1 ms is late by [µs]: {percentiles(idle)}; memory grew by {grown} kB")
    print(f"events: {dict(session.counts)}")
