"""What is on disk: readable by the official reader at any moment, and the same numbers again."""

from __future__ import annotations

import json
import os
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from live.prepared import NAMES, Prepared
from live.recordings import killed, messages

import kinid
from kinid.data.readers.mcap import recorded_rig
from kinid.data.rig import Rig
from kinid.errors import InputError
from kinid.live import Event, Pipeline, Recorder, Session, open_source
from kinid.live.messages import Item, Joints, Wrench
from kinid.live.sources import Asked

mcap_reader = pytest.importorskip("mcap.reader")
pytest.importorskip("rosbags.typesys")
MODEL = ("kelvin-voigt", "coulomb-friction")


@pytest.fixture(scope="module")
def recorded(rig: Rig, rows: list[Item], tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Session]:
    path = tmp_path_factory.mktemp("live") / "out.mcap"
    recorder = Recorder(path, NAMES, "ft_sensor", {"model": MODEL, "rig": rig.model_dump_json(exclude={"folder"})})
    session = Session(Prepared(rows), Pipeline(rig, MODEL), NAMES, sinks=[recorder])
    session.run()
    return path, session


def test_every_sample_is_there_to_the_last_bit(recorded: tuple[Path, Session], rows: list[Item]) -> None:
    found = messages(recorded[0])
    joints = [m for m in found if m[0] == "/joint_states"]
    wrench = [m for m in found if m[0] == "/ft_sensor/wrench"]
    sent = [item for item in rows if isinstance(item, Joints)]
    loads = [item for item in rows if isinstance(item, Wrench)]
    np.testing.assert_array_equal([m[3].position for m in joints], [item.q for item in sent])
    assert [m[1] for m in joints] == [item.stamp for item in sent]
    assert [m[3].header.stamp.sec * 10**9 + m[3].header.stamp.nanosec for m in joints] == [m[1] for m in joints]
    assert joints[0][3].name == list(NAMES)
    assert all(len(m[3].velocity) == len(m[3].effort) == 0 for m in joints)
    assert wrench[0][3].header.frame_id == "ft_sensor"
    forces = [(m[3].wrench.force, m[3].wrench.torque) for m in wrench]
    np.testing.assert_array_equal([(f.x, f.y, f.z, t.x, t.y, t.z) for f, t in forces], [i.wrench for i in loads])


def test_provenance_events_and_estimates_are_inside(recorded: tuple[Path, Session]) -> None:
    path, session = recorded
    with path.open("rb") as file:
        reader = mcap_reader.make_reader(file)
        (metadata,) = list(reader.iter_metadata())
        assert reader.get_summary().statistics.message_count == len(messages(path))
    assert metadata.name == "kinid"
    assert json.loads(metadata.metadata["model"]) == list(MODEL)
    assert Rig.parse(json.loads(metadata.metadata["rig"])).tool is not None
    found = messages(path)
    events = [m[3]["kind"] for m in found if m[0] == "/kinid/events"]
    assert events == [event.kind for event in session.events]
    contact = [m[3] for m in found if m[0] == "/kinid/contact"]
    # fifty times a second, of 15 s
    assert len(contact) == pytest.approx(750, abs=2)
    assert max(m["depth"] for m in contact) > 4e-3
    last = [m[3] for m in found if m[0] == "/kinid/estimates"][-1]
    assert last["values"]["stiffness"]["value"] == pytest.approx(732, rel=0.02)


def test_a_closed_file_is_read_by_its_index(recorded: tuple[Path, Session]) -> None:
    """A part of a topic's time without a look at the rest, as viewers do it."""
    path, _ = recorded
    chosen = [m[1] for m in messages(path) if m[0] == "/kinid/contact" and 8 * 10**9 <= m[2] < 9 * 10**9]
    with path.open("rb") as file:
        reader = mcap_reader.make_reader(file, validate_crcs=True)
        chunks = reader.get_summary().chunk_indexes
        found = list(reader.iter_messages(["/kinid/contact"], starting_at=8 * 10**9, ending_before=9 * 10**9))
    assert len(chunks) > 2
    assert max(chunk.chunk_length for chunk in chunks) < 2 * 10**6
    assert sum(len(chunk.message_index_offsets) for chunk in chunks) >= 4 * len(chunks)
    assert [message.publish_time for _, _, message in found] == chosen


def test_the_file_is_whole_after_each_write(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Three chunks' worth of events, the file looked at after each write to it: nothing that was there is ever gone."""
    path, write, states = tmp_path / "out.mcap", os.pwrite, list[bytes]()

    def watched(file: int, data: bytes, at: int) -> int:
        done = write(file, data, at)
        states.append(path.read_bytes())
        return done

    monkeypatch.setattr(os, "pwrite", watched)
    recorder = Recorder(path, NAMES, "s", {})
    for k in range(40):
        before = len(states)
        recorder.event(Event("gap", float(k), "x" * 80_000), k, k + 1)
        end = time.monotonic() + 5.0
        while len(states) == before and time.monotonic() < end:
            time.sleep(1e-3)
    recorder.close()
    known = 0
    for state in states:
        (copy := tmp_path / "copy.mcap").write_bytes(state)
        times = [m[3]["t"] for m in messages(copy)]
        assert times == [float(k) for k in range(len(times))]
        assert len(times) >= known
        known = len(times)
    assert known == 40
    assert len(states) > 40 + 2  # headers of full chunks among them


def test_a_recording_gives_the_same_estimates_again(recorded: tuple[Path, Session], rig: Rig, rows: list[Item]) -> None:
    path, session = recorded
    log = kinid.read(path, rig)
    assert len(log) == session.samples
    pipeline = Pipeline(rig, MODEL)
    none = np.full(7, np.nan)
    assert log.q is not None
    assert log.wrench is not None
    for t, q, wrench in zip(log.t.tolist(), np.array(log.q), np.array(log.wrench)):
        event_bits = pipeline.step(t, q, wrench, none)
        assert event_bits >= 0
        if event_bits:
            pipeline.explain(event_bits, t)
    for part, estimate in session.pipeline.estimates.items():
        # asked for; what differs is how times are rounded
        np.testing.assert_allclose(pipeline.estimates[part].values, estimate.values, rtol=1e-9)
    again = Session(open_source(str(path), Asked(rig, NAMES, 0.0)), Pipeline(rig, MODEL), NAMES)
    again.run()
    assert again.counts == session.counts
    for part, estimate in session.pipeline.estimates.items():
        np.testing.assert_allclose(again.pipeline.estimates[part].values, estimate.values, rtol=1e-9)


def test_a_session_that_started_from_a_map_is_replayed_to_the_same_values(
    rig: Rig, rows: list[Item], tmp_path: Path
) -> None:
    """One message of slow joints completes several pairs, and estimators start in the midst of them."""
    slow = [item for k, item in enumerate(rows) if isinstance(item, Wrench) or k % 10 == 0]
    known = {"stiffness": 900.0, "damping": 4.0, "friction": 0.3}

    class Known:
        def nearest(self) -> dict[str, float]:
            return known

    def run(source: Any, known: Any = None, record: bool = False) -> Session:
        provenance = {"rig": rig.model_dump_json(exclude={"folder"})}
        sinks = [Recorder(tmp_path / "out.mcap", NAMES, "ft_sensor", provenance)] if record else []
        session = Session(source, Pipeline(rig, MODEL), NAMES, sinks=sinks, known=known, max_gap=1.0)
        session.run()
        return session

    (touch, *_) = (event for event in run(Prepared(slow)).events if event.kind == "touch")
    # soon behind it: later, what was learnt hides where it began
    cut = [item for item in slow if item is not None and item.received < 1e9 * (touch.t + 1.1)]
    first, cold = run(Prepared(cut), Known(), record=True), run(Prepared(cut))
    again = run(open_source(str(tmp_path / "out.mcap"), Asked(rig, NAMES, 0.0)))
    assert again.counts == first.counts
    assert first.counts["warm-start"] > 0
    assert [e.values for e in again.events if e.kind == "warm-start"] == [known] * first.counts["warm-start"]
    for part, estimate in first.pipeline.estimates.items():
        np.testing.assert_allclose(again.pipeline.estimates[part].values, estimate.values, rtol=1e-9)
    difference = cold.pipeline.estimates["normal"].values - first.pipeline.estimates["normal"].values
    assert abs(difference[0]) > 1e-6 * first.pipeline.estimates["normal"].values[0]


def test_another_clock_of_reception_changes_nothing_of_a_replay(
    recorded: tuple[Path, Session], rig: Rig, rows: list[Item], tmp_path: Path
) -> None:
    path, epoch = tmp_path / "out.mcap", 1_700_000_000 * 10**9
    recorder = Recorder(path, NAMES, "ft_sensor", {"rig": rig.model_dump_json(exclude={"folder"})}, epoch)
    Session(Prepared(rows), Pipeline(rig, MODEL), NAMES, sinks=[recorder]).run()
    assert [m[2] for m in messages(path)] == [m[2] + epoch for m in messages(recorded[0])]
    again = Session(open_source(str(path), Asked(rig, NAMES, 0.0)), Pipeline(rig, MODEL), NAMES)
    again.run()
    assert again.counts == recorded[1].counts
    for part, estimate in recorded[1].pipeline.estimates.items():
        np.testing.assert_allclose(again.pipeline.estimates[part].values, estimate.values, rtol=1e-9)


def test_a_recording_has_its_own_topics_and_units(rig: Rig, rows: list[Item], tmp_path: Path) -> None:
    """Those of the session's source, which the rig names, are no longer what is read."""
    path = tmp_path / "out.mcap"
    tables = json.loads(rig.model_dump_json(exclude_none=True, exclude={"folder"}))
    tables["streams"] = {"joints": "/arm/joints", "wrench": "/arm/wrench"}
    tables["columns"] = {"q": {"unit": "deg"}, "wrench": {"scale": 2.0}}
    recorder = Recorder(path, NAMES, "ft_sensor", {"rig": json.dumps(tables)})
    session = Session(Prepared(rows[:4000]), Pipeline(rig, MODEL), NAMES, sinks=[recorder])
    session.run()
    named = recorded_rig(path)
    assert named is not None
    assert named.streams.joints == "/arm/joints"
    log = kinid.read(path, named)
    np.testing.assert_array_equal(log.q, [item.q for item in rows[:4000] if isinstance(item, Joints)])
    again = Session(open_source(str(path), Asked(named, NAMES, 0.0)), Pipeline(named, MODEL), NAMES)
    again.run()
    assert again.samples == session.samples
    np.testing.assert_allclose(again.aligner.wrench, session.aligner.wrench, rtol=1e-12)


@pytest.mark.parametrize(
    "after", [0.35, 0.5, 0.75, *(pytest.param(t, marks=pytest.mark.slow) for t in np.linspace(0.05, 2.0, 25))]
)
def test_a_program_that_is_killed_has_lost_a_tenth_of_a_second_at_most(after: float, tmp_path: Path) -> None:
    path = tmp_path / "out.mcap"
    end = killed(path, after)
    found = messages(path)
    loads = [m[3].wrench.force.x for m in found]
    assert loads == [float(k) for k in range(len(loads))]  # all that is there is whole and in order
    lost = 1e-9 * (end - found[-1][1])
    print(f"killed after {after} s: {len(found)} samples, {1e3 * lost:.1f} ms lost")
    assert lost < 0.1  # asked for
    assert np.isfinite(loads).all()


def test_it_can_be_read_while_it_is_written(tmp_path: Path) -> None:
    path = tmp_path / "out.mcap"
    recorder = Recorder(path, ("a", "b"), "s", {})
    assert messages(path) == []
    for k in range(5):
        stamp = 10**18 + k
        recorder.sample(Joints(k, stamp, [1.0, 2.0], [3.0, 4.0], [5.0, 6.0], ("b", "a")), stamp)
        recorder.event(Event("gap", 0.5, "of nothing"), k, stamp)
        end = time.monotonic() + 5.0
        while len(messages(path)) < 2 * (k + 1) and time.monotonic() < end:
            time.sleep(0.01)
        found = messages(path)
        assert len(found) == 2 * (k + 1)
    assert found[0][3].name == ["b", "a"]
    assert found[0][3].velocity.tolist() == [3.0, 4.0]
    assert found[0][3].effort.tolist() == [5.0, 6.0]
    assert found[1][3]["slip1"] is None
    recorder.close()
    assert len(messages(path)) == 10


def test_a_place_that_cannot_be_written(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no way to write"):
        Recorder(tmp_path / "none" / "out.mcap", NAMES, "s", {})
