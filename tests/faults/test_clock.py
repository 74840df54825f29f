"""A clock that is set back while something runs."""

from __future__ import annotations

import os
import time
from pathlib import Path

import numpy as np
import pytest

from kinid.live.messages import Wrench
from kinid.live.recording import Recorder
from kinid.mapping.property_map import Probe, Property, PropertyMap
from kinid.robotics.surface import Plane
from kinid.viewer.viewer import View


def grown(count: int) -> PropertyMap:
    """A map of so many probes."""
    probes = (
        Probe(np.array([0.5 + 0.01 * (i % 4), 0.01 * (i // 4), 0.1]), np.array([500.0]), np.eye(1), 0.03, 0.03, f"{i}")
        for i in range(count)
    )
    return PropertyMap(
        Plane(np.array([0.5, 0, 0.1]), np.eye(3)), (Property("stiffness", "N/m"),), tuple(probes), "hooke"
    )


def test_a_map_that_is_newer_by_an_older_clock_is_seen(tmp_path: Path) -> None:
    path = tmp_path / "map.parquet"
    grown(8).write(path)
    view = View(path)
    view.scene()
    grown(9).write(path)
    os.utime(path, (1.0, 1.0))
    assert view.changed() is not None


def test_a_recording_needs_no_clock(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The system's time jumps to 1970 and runs backwards; samples keep their stamps and their order."""
    reader = pytest.importorskip("mcap.reader")
    path = tmp_path / "a.mcap"
    recorder = Recorder(path, ("a",), "s", {})
    times = iter(range(10**9, 0, -(10**6)))
    monkeypatch.setattr(time, "time", lambda: 1e-9 * next(times))
    monkeypatch.setattr(time, "time_ns", lambda: next(times))
    stamps = [10**18 + 10**6 * k for k in range(50)]
    for k, stamp in enumerate(stamps):
        recorder.sample(Wrench(k, stamp, [float(k)] * 6), stamp)
    recorder.close()
    with path.open("rb") as file:
        found = [message.publish_time for _, _, message in reader.make_reader(file).iter_messages()]
    assert found == stamps
