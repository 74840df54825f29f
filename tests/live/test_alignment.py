"""Streams with rates and clocks of their own: aligned as logs are, and everything odd is told."""

from __future__ import annotations

import numpy as np
import pytest

from kinid.data.streams import Stream, merge
from kinid.live import Aligner
from kinid.live.messages import Joints, Wrench

NAMES = ("a", "b")
MS = 1_000_000
START = 1_700_000_000_000_000_000


class Reports(list[tuple[str, str]]):
    """What an aligner reports."""

    def __call__(self, kind: str, says: str) -> None:
        self.append((kind, says))

    @property
    def kinds(self) -> list[str]:
        return [kind for kind, _ in self]


def joints(k: int, received: int | None = None, stamp: int | None = None) -> Joints:
    at = START + k * MS
    return Joints(at if received is None else received, at if stamp is None else stamp, [0.1 * k, -0.2 * k])


def wrench(k: int, received: int | None = None, stamp: int | None = None) -> Wrench:
    at = START + k * MS
    return Wrench(at if received is None else received, at if stamp is None else stamp, [float(k)] * 6)


@pytest.mark.parametrize(("period", "offset"), [(1.0, 0.0), (2.0, 0.0), (2.7, 0.0), (4.0, 0.0013)])
def test_pairs_are_those_of_a_log(period: float, offset: float) -> None:
    rng = np.random.default_rng(3)
    # joints no faster than the wrench: logs average faster ones, which takes samples that are still to come
    t_joints = START + np.round(1e6 * (np.arange(400) * period + rng.uniform(-0.2, 0.2, 400))).astype(np.int64)
    t_wrench = START + np.round(1e6 * (np.arange(int(400 * period)) + rng.uniform(-0.2, 0.2))).astype(np.int64)
    keep = rng.random(len(t_joints)) > 0.03
    keep[100:110] = False  # a gap that isn't bridged
    t_joints = t_joints[keep]
    q, w = rng.normal(size=(len(t_joints), 2)), rng.normal(size=(len(t_wrench), 6))
    reports, out = Reports(), []
    aligner = Aligner(NAMES, reports, wrench_offset=offset)
    items = [(int(t), 0, i) for i, t in enumerate(t_joints)] + [(int(t), 1, i) for i, t in enumerate(t_wrench)]
    for stamp, kind, i in sorted(items):
        aligner.put(Wrench(stamp, stamp, w[i]) if kind else Joints(stamp, stamp, q[i]))
        while aligner.pair():
            out.append((aligner.stamp, *aligner.q, *aligner.wrench))
    reference = Stream("wrench", (t_wrench - START) * 1e-9, w, tuple("123456"))
    other = Stream("joints", (t_joints - START) * 1e-9, q, NAMES)
    merged = merge(reference, [other], offsets={"wrench": offset} if offset else None)
    usable = np.isfinite(merged.values["joints"]).all(axis=1)
    found = {row[0]: row[1:] for row in out}
    stamps = t_wrench + round(1e9 * offset)
    expected = {int(s): (*q, *x) for s, q, x in zip(stamps[usable], merged.values["joints"][usable], w[usable])}
    # medians of fifteen steps and of all steps differ a little: at the edges of gaps one may bridge, the other not
    assert len(found.keys() ^ expected.keys()) <= 0.01 * len(expected)
    common = sorted(found.keys() & expected.keys())
    assert len(common) > 0.9 * len(expected)
    # the same line through the same samples; times of a log are rounded to a part in 10¹⁶
    np.testing.assert_allclose([found[s] for s in common], [expected[s] for s in common], atol=1e-9)
    assert "gap" in reports.kinds


def test_late_and_repeated_samples_are_left_out_and_told() -> None:
    reports = Reports()
    aligner = Aligner(NAMES, reports)
    for k in (0, 1, 2, 4, 3, 4, 5):
        aligner.put(joints(k, received=START + 10 * MS))
    assert reports.kinds == ["late", "repeated"]


@pytest.mark.parametrize("jump", [3.0, -3.0, 0.4, -0.4])
def test_time_goes_on_over_a_jump_of_the_clock(jump: float) -> None:
    reports, times = Reports(), []
    aligner = Aligner(NAMES, reports)
    for k in range(400):
        moved = round(jump * 1e9) if k >= 200 else 0
        at = START + k * MS
        aligner.put(joints(k, at, at + moved))
        aligner.put(wrench(k, at, at + moved))
        while aligner.pair():
            times.append(aligner.t)
    assert reports.kinds.count("clock-jump") == 2
    # a jump back costs the samples until it is sure: two of each stream
    assert set(reports.kinds) == {"clock-jump"} | ({"late"} if jump < 0 else set())
    steps = np.diff(times)
    assert steps.min() > 0.0
    assert steps.max() < 4e-3
    assert times[-1] == pytest.approx(0.399, abs=2e-3)


def test_a_pause_is_no_jump_and_a_burst_is_told_as_one() -> None:
    reports = Reports()
    aligner = Aligner(NAMES, reports)
    for k in [*range(100), *range(600, 700)]:
        aligner.put(joints(k))
    assert reports.kinds == ["gap"]
    for k in range(700, 800):  # all come at once, when the last is due
        aligner.put(joints(k, START + 800 * MS))
    assert reports.kinds == ["gap", "delayed"]


def test_clocks_of_different_epochs_are_put_together() -> None:
    reports = Reports()
    aligner = Aligner(NAMES, reports)
    pairs = 0
    for k in range(50):
        at = START + k * MS
        aligner.put(Joints(at, 5 * MS * 1000 + k * MS, [0.0, 0.0]))  # a clock that counts from the robot's start
        aligner.put(wrench(k))
        pairs += aligner.pair()
    assert reports.kinds == ["clock-offset"]
    assert pairs >= 48


def test_clocks_that_begin_at_zero_or_below() -> None:
    reports = Reports()
    aligner = Aligner(NAMES, reports)
    for k in range(-5, 5):
        aligner.put(Joints(START + k * MS, k * MS, [1.0, 2.0]))
        aligner.put(Wrench(START + k * MS, k * MS, [0.0] * 6))
        assert aligner.pair()
    assert aligner.t == pytest.approx(9e-3, abs=1e-12)
    assert reports == []


def test_joints_are_found_by_their_names() -> None:
    reports = Reports()
    aligner = Aligner(NAMES, reports)
    aligner.put(Joints(START, START, [2.0, 1.0], names=("b", "a")))
    aligner.put(wrench(0))
    assert aligner.pair()
    assert aligner.q.tolist() == [1.0, 2.0]
    for names in (("a", "c"), ("a",), ()):
        assert aligner.put(Joints(START + MS, START + MS, [0.0] * len(names), names=names)) is None
    assert aligner.put(Joints(START + MS, START + MS, [0.0] * 3)) is None
    assert reports.kinds == ["joint-names"] * 4


@pytest.mark.parametrize(
    ("sample", "kind"),
    [
        (Wrench(START, START, [0.0, float("nan"), 0.0, 0.0, 0.0, 0.0]), "not-finite"),
        (Joints(START, START, [float("inf"), 0.0]), "not-finite"),
        (Joints(START, START, [0.0, 0.0], [0.0, float("nan")]), "not-finite"),
        (Wrench(START, START, [0.0] * 5), "malformed"),
        (Wrench(START, START, ["x"] * 6), "malformed"),  # type: ignore[list-item]
        (Wrench(START, 1 << 80, [0.0] * 6), "malformed"),
        (Joints(START, START, None), "malformed"),  # type: ignore[arg-type]
    ],
)
def test_what_is_no_sample_is_told(sample: Joints | Wrench, kind: str) -> None:
    reports = Reports()
    aligner = Aligner(NAMES, reports)
    aligner.put(joints(0))
    assert aligner.put(sample) is None
    assert reports.kinds == [kind]


def test_velocities_that_stay_zero_are_left_out_and_told_once() -> None:
    """As in a log: many drivers fill in zeros for what they don't know."""
    reports = Reports()
    aligner = Aligner(NAMES, reports)
    for k in range(1000):
        still = k < 200
        position = [0.1, -0.2] if still else [0.1 + 1e-3 * (k - 200), -0.2]
        aligner.put(Joints(START + k * MS, START + k * MS, position, [0.0, -0.0] if k % 2 else np.zeros(2)))
        aligner.put(wrench(k))
        assert aligner.pair()
        assert np.isnan(aligner.dq).all()
        assert not (still and reports)
    assert reports.kinds == ["dead-velocities"]
    # velocities that come to be known count from there on, zeros among them
    for k in range(1000, 1004):
        aligner.put(Joints(START + k * MS, START + k * MS, [0.9, -0.2], [0.5 if k == 1001 else 0.0, 0.0]))
        aligner.put(wrench(k))
        assert aligner.pair()
        np.testing.assert_array_equal(aligner.dq, np.full(2, np.nan) if k < 1001 else [0.5 * (k == 1001), 0.0])
    assert len(reports) == 1


@pytest.mark.parametrize(("missing", "kinds"), [(985, ["gap", "gap"]), (0, ["clock-jump", "clock-jump"]), (100, None)])
def test_what_a_hole_in_the_numbers_explains_is_no_jump_of_the_clock(missing: int, kinds: list[str] | None) -> None:
    """A reader stalls, what waits for it overflows, and what is read next was measured long after what was read last.

    Lines of both streams have one count; the stall is as long before as behind the hole, so that nothing of it shows in
    the times of reception.
    """
    reports = Reports()
    aligner = Aligner(NAMES, reports)
    late = 600 * MS  # all of it comes so late
    for k in range(1000):
        at = START + k * MS
        aligner.put(joints(k, at + late))
        aligner.put(wrench(k, at + late))
    aligner.lost(missing)
    for k in range(1492, 1600):
        at = START + 1000 * MS + (k - 1492) * MS
        aligner.put(joints(k, at + late))
        aligner.put(wrench(k, at + late))
    assert reports.kinds == (kinds or ["clock-jump", "clock-jump"])
    stamps = aligner.clocks["joints"]
    assert (stamps.shift == 0) == (missing == 985)
    # what isn't missing any more explains nothing
    aligner.put(joints(2600, START + 1700 * MS + late))
    assert reports.kinds[-1] == "clock-jump"
