"""Recordings: one of a program that was killed, and what the official reader finds in a file."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import pytest

WRITES = """
import sys, time
from pathlib import Path
from kinid.live import Recorder
from kinid.live.messages import Wrench
recorder = Recorder(Path(sys.argv[1]), ("a",), "s", {})
print("ready", flush=True)
begin = time.monotonic_ns()
for k in range(60_000):
    while time.monotonic_ns() < begin + k * 1_000_000:
        time.sleep(2e-4)
    now = time.monotonic_ns()
    recorder.sample(Wrench(now, now, [float(k)] * 6), now)
"""


def killed(path: Path, after: float) -> int:
    """Write a wrench each millisecond, the number of the sample in all of its six numbers, and be killed.

    Args:
        path: of the recording. after: seconds from its first sample.

    Returns:
        Monotonic time of the end [ns], the clock of the samples' stamps.
    """
    with subprocess.Popen([sys.executable, "-c", WRITES, str(path)], stdout=subprocess.PIPE) as process:
        assert process.stdout is not None
        process.stdout.readline()
        time.sleep(after)
        os.kill(process.pid, signal.SIGKILL)
        end = time.monotonic_ns()
        process.wait()
    return end


def messages(path: Path) -> list[tuple[str, int, int, Any]]:
    """Topic, stamp, time of reception and decoded message, by the official reader and the types of rosbags."""
    reader = pytest.importorskip("mcap.reader")
    typesys = pytest.importorskip("rosbags.typesys")
    store = typesys.get_typestore(typesys.Stores.ROS2_HUMBLE)
    out = []
    with path.open("rb") as file:
        for schema, channel, message in reader.make_reader(file, validate_crcs=True).iter_messages():
            if channel.message_encoding == "cdr":
                decoded = store.deserialize_cdr(message.data, schema.name)
            else:
                decoded = json.loads(message.data)
                assert set(decoded) <= set(json.loads(schema.data)["properties"])
            out.append((channel.topic, message.publish_time, message.log_time, decoded))
    return out
