"""Streams onto one clock, and the offset between two clocks."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from kinid.data.clock_offset import ClockOffset, clock_offset
from kinid.data.log import Provenance
from kinid.data.readers import read
from kinid.data.rig import Rig
from kinid.data.streams import Stream, merge, resample, tidy
from kinid.errors import InputError

Array = NDArray[np.float64]
EPS = 1e-12  # a few roundings of numbers near 1


def stream(t: object, values: object, name: str = "s") -> Stream:
    table = np.asarray(values, dtype=float)
    table = table[:, None] if table.ndim == 1 else table
    return Stream(name, np.asarray(t, dtype=float), table, tuple(f"c{i}" for i in range(table.shape[1])))


# -------------------------------------------------------------------------------------------------- the stream


def test_a_stream_is_frozen_and_checked() -> None:
    s = stream([0.0, 0.1, 0.3, 0.4], [1, 2, 3, 4])
    assert s.period == pytest.approx(0.1)
    with pytest.raises(ValueError, match="read-only"):
        s.values[0] = 5
    with pytest.raises(dataclasses.FrozenInstanceError):
        s.name = "other"  # type: ignore[misc]
    for t, values, found in (
        ([], np.empty((0, 1)), "no samples"),
        ([0, np.nan], [1, 2], "not a number in sample 2"),
        ([0, 1], [1, 2, 3], "shape"),
    ):
        with pytest.raises(InputError, match=found):
            stream(t, values)


def test_tidy_sorts_drops_what_is_identical_and_averages_what_differs() -> None:
    t = [0.0, 2.0, 1.0, 3.0, 3.0, 4.0, 4.0, 5.0, 5.0]
    x = [0.0, 2.0, 1.0, 3.0, 3.0, 4.0, 6.0, np.nan, 7.0]
    got, counts = tidy(stream(t, x))
    assert counts == {"unsorted": 1, "repeated": 1, "averaged": 2}
    np.testing.assert_array_equal(got.t, [0, 1, 2, 3, 4, 5])
    np.testing.assert_array_equal(got.values[:, 0], [0, 1, 2, 3, 5, 7])  # an absent value takes no part in a mean


def test_tidy_leaves_a_clean_stream_alone() -> None:
    s = stream([0.0, 1.0, 2.0], [[1, np.nan], [2, 3], [4, 5]])
    got, counts = tidy(s)
    assert not any(counts.values())
    np.testing.assert_array_equal(got.values, s.values)


# --------------------------------------------------------------------------------------------------- one clock


def test_the_reference_keeps_its_clock_and_its_values() -> None:
    rng = np.random.default_rng(1)
    t = np.cumsum(rng.uniform(0.5e-3, 1.5e-3, 500))
    reference = stream(t, rng.normal(size=(500, 2)), "wrench")
    merged = merge(reference, [stream(np.arange(0, 1, 0.01), np.arange(100), "joints")])
    np.testing.assert_array_equal(merged.t, t)
    np.testing.assert_array_equal(merged.values["wrench"], reference.values)


def test_a_slower_stream_is_interpolated_and_never_extrapolated() -> None:
    slow = stream([0.1, 0.2, 0.3, 0.4], [1.0, 2.0, 4.0, 4.0], "slow")
    clock = stream(np.arange(0, 0.5, 0.025), np.zeros(20), "clock")
    got = merge(clock, [slow]).values["slow"][:, 0]
    expected = np.interp(clock.t, slow.t, slow.values[:, 0], left=np.nan, right=np.nan)
    np.testing.assert_allclose(got, expected, atol=EPS)
    assert np.isnan(got[0])
    assert np.isnan(got[-1])


@pytest.mark.parametrize(
    ("behind", "offset", "doubted"), [(0.0, 5.0, True), (0.0, -5.0, True), (0.0, 0.02, False), (1e9, 1e9, False)]
)
def test_an_offset_that_parts_streams_recorded_together_is_doubted(behind: float, offset: float, doubted: bool) -> None:
    t = np.arange(3000) / 100.0
    made = merge(stream(t + behind, t), [stream(t, t, "wrench")], offsets={"wrench": offset})
    said = [warning for step in made.steps for warning in step.warnings]
    assert [("wrench_clock_offset" in words) for words in said] == [True] * doubted


@pytest.mark.parametrize(
    ("begin", "end", "says"),
    [
        (0.0, 10.0, ""),
        (0.3, 9.7, ""),  # recorders subscribe to one topic after the other
        (3.0, 10.0, "joints begins 3 s after wrench: 7 s of 10 s hold all"),
        (0.0, 4.0, "joints ends 6 s before wrench: 4 s of 10 s hold all"),
        (-2.0, 8.0, "wrench begins 2 s after joints, joints ends 2 s before wrench: 8 s of 12 s hold all"),
    ],
)
def test_streams_that_were_not_recorded_together_are_doubted(begin: float, end: float, says: str) -> None:
    wrench, joints = (
        stream(t, np.sin(t), name) for t, name in ((SPAN, "wrench"), (np.arange(begin, end + 5e-3, 0.01), "joints"))
    )
    said = [warning for step in merge(wrench, [joints]).steps for warning in step.warnings]
    assert len(said) == bool(says)
    assert not says or (said[0].startswith(says) and "record them together" in said[0])


SPAN = np.arange(0.0, 10.0 + 1e-3, 2e-3)


@pytest.mark.parametrize(("block", "doubted"), [(1, False), (10, True)])
def test_many_samples_of_one_stamp_are_doubted(block: int, doubted: bool) -> None:
    t = SPAN[np.arange(len(SPAN)) // block * block]
    merged = merge(stream(t, np.sin(SPAN), "wrench"), [stream(SPAN, np.cos(SPAN), "joints")])
    said = [warning for step in merged.steps for warning in step.warnings]
    assert any("of 5001 samples of wrench have the stamp of another one" in warning for warning in said) == doubted
    assert len(said) == doubted
    with pytest.raises(InputError, match="5001 samples of joints with one stamp, 3 s"):
        merge(stream(SPAN, np.sin(SPAN), "wrench"), [stream(0.0 * SPAN + 3.0, np.cos(SPAN), "joints")])


def test_a_pause_is_not_bridged_unless_allowed() -> None:
    t = np.concatenate([np.arange(0, 1, 0.1), np.arange(1.6, 2.5, 0.1)])
    slow, clock = stream(t, t, "slow"), stream(np.arange(0.05, 2.4, 0.05), np.zeros(47), "clock")
    inside = (clock.t > 0.91) & (clock.t < 1.59)
    got = merge(clock, [slow]).values["slow"][:, 0]
    assert np.isnan(got[inside]).all()
    np.testing.assert_allclose(got[~inside], clock.t[~inside], atol=EPS)
    bridged = merge(clock, [slow], max_gap=1.0).values["slow"][:, 0]
    np.testing.assert_allclose(bridged, clock.t, atol=EPS)


@given(rate=st.floats(1.2, 40.0), phase=st.floats(0.0, 1.0))
def test_a_faster_stream_is_averaged_without_shifting_it(rate: float, phase: float) -> None:
    # the mean of a straight line over a centred interval is its value at the centre: any shift would show
    clock = stream(np.arange(0, 2, 0.02), np.zeros(100), "clock")
    t = np.arange(-0.1 + phase * 0.02 / rate, 2.1, 0.02 / rate)
    got = merge(clock, [stream(t, np.stack([3 * t - 1, np.ones_like(t)], axis=1), "fast")])
    assert got.steps[1].facts["method"].startswith("average")
    np.testing.assert_allclose(got.values["fast"][:, 0], 3 * clock.t - 1, atol=1e-10)
    np.testing.assert_allclose(got.values["fast"][:, 1], 1.0, atol=1e-10)


def test_averaging_takes_out_noise() -> None:
    rng = np.random.default_rng(2)
    t = np.arange(0, 20, 1e-3)
    clock = stream(np.arange(0.1, 19.9, 0.02), np.zeros(990), "clock")
    got = merge(clock, [stream(t, rng.normal(size=t.size), "fast")]).values["fast"][:, 0]
    # 20 samples an interval: 1/√20 = 0.224; 990 means give this to 2.3 % (one sigma), so ± 4 sigma
    assert got.std() == pytest.approx(20**-0.5, rel=0.1)


def test_averaging_beside_a_gap_stays_centred() -> None:
    t = np.concatenate([np.arange(0, 1, 1e-3), np.arange(1.2, 2, 1e-3)])
    clock = stream(np.arange(0, 2, 0.05), np.zeros(40), "clock")
    got = merge(clock, [stream(t, 5 * t, "fast")]).values["fast"][:, 0]
    inside = (clock.t > 0.9995) & (clock.t < 1.1995)
    assert np.isnan(got[inside]).all()
    assert np.isfinite(got[~inside & (clock.t < 1.99)]).all()
    known = np.isfinite(got)
    np.testing.assert_allclose(got[known], 5 * clock.t[known], atol=1e-9)


def test_absent_values_of_one_column_leave_the_others() -> None:
    t = np.arange(0, 1, 0.1)
    values = np.stack([t, t], axis=1)
    values[3:8, 1] = np.nan  # a pause of 0.6 s, longer than 3.5 periods
    got = resample(stream(t, values), np.array([0.05, 0.45, 0.85]), max_gap=0.35)
    np.testing.assert_allclose(got[:, 0], [0.05, 0.45, 0.85], atol=EPS)
    np.testing.assert_array_equal(np.isnan(got[:, 1]), [False, True, False])


def test_equal_clocks_give_equal_values() -> None:
    rng = np.random.default_rng(3)
    t = np.cumsum(rng.uniform(1e-3, 3e-3, 300))
    a, b = stream(t, rng.normal(size=300), "a"), stream(t, rng.normal(size=300), "b")
    np.testing.assert_allclose(merge(a, [b]).values["b"], b.values, atol=EPS)


def test_offset_moves_the_stamps_and_is_recorded() -> None:
    t = np.arange(0, 1, 0.01)
    a, b = stream(t, t, "joints"), stream(t - 0.25, t, "wrench")
    merged = merge(a, [b], offsets={"wrench": 0.25})
    np.testing.assert_allclose(merged.values["wrench"][:, 0], t, atol=EPS)
    assert merged.steps[1].facts["clock_offset"] == 0.25


def test_provenance_says_what_was_done_and_is_json() -> None:
    fast = stream(np.r_[np.arange(500, 1000), 700] * 1e-3, np.ones(501), "fast")
    merged = merge(stream(np.arange(0, 1, 0.01), np.zeros(100), "clock"), [fast])
    first, second = merged.steps
    assert first.facts["method"] == "reference clock"
    assert first.facts["rate"] == pytest.approx(100.0)
    facts = second.facts
    assert (facts["unsorted"], facts["repeated"], facts["samples"], facts["empty"]) == (1, 1, 500, 50)
    assert facts["rate"] == pytest.approx(1000.0)
    json.dumps(Provenance("x", merged.steps).to_dict())


def test_streams_without_common_time_or_with_one_name_are_refused() -> None:
    a, b = stream([0, 1], [0, 0], "joints"), stream([1.6e9, 1.6e9 + 1], [0, 0], "wrench")
    with pytest.raises(InputError, match="streams that share time"):
        merge(a, [b])
    with pytest.raises(InputError, match="one name a stream"):
        merge(a, [a])


# ------------------------------------------------------------------------------------------------ clock offset


def motion(rng: np.random.Generator, fastest: float = 4.0) -> Callable[[Array], Array]:
    """A smooth motion that does not repeat itself: a dozen sines of random frequency [Hz], phase and size."""
    f, p, a = rng.uniform(0.2, fastest, 12), rng.uniform(0, 2 * np.pi, 12), rng.normal(size=12)
    return lambda t: np.sin(2 * np.pi * np.outer(t, f) + p) @ a


def planted(seed: int, offset: float, noise: float, length: float = 20.0) -> tuple[ClockOffset, float]:
    """A signal at 100 Hz and one at 500 Hz, biased and drifting, whose stamps are `offset` early; both ways."""
    rng = np.random.default_rng(seed)
    x = motion(rng)
    t, u = np.arange(0, length, 0.01), np.arange(0.0007, length, 0.002)
    y = 3 * x(u + offset) + 7 + 0.02 * u
    y += 3 * noise * rng.normal(size=u.size)
    first = (t, x(t) + noise * rng.normal(size=t.size))
    return clock_offset(first, (u, y)), clock_offset((u, y), first).value


@pytest.mark.parametrize("offset", [0.0037, -0.0113, 0.2502, 0.0])
def test_planted_offsets_come_back_to_a_fraction_of_a_sample(offset: float) -> None:
    found, reverse = planted(11, offset, noise=0.05)
    assert abs(found.value - offset) < 3 * found.standard_error
    assert abs(found.value - offset) < 0.3e-3  # a thirtieth of the slower signal's sample time
    assert found.standard_error < 0.2e-3
    assert found.correlation > 0.9
    # the other way round is the opposite offset, to the error that either claims
    assert reverse == pytest.approx(-found.value, abs=3 * found.standard_error)


def test_the_standard_error_is_honest() -> None:
    # 40 offsets: the root mean square of error / standard error is 1, known to 11 % from 40 draws; the jackknife of
    # 16 blocks and the choice of the best scale add their own spread, so a factor 1.5 either way
    ratios = []
    for seed in range(40):
        found, _ = planted(seed, 0.0037, noise=0.2, length=12.0)
        ratios.append((found.value - 0.0037) / found.standard_error)
    assert 1 / 1.5 < np.sqrt(np.mean(np.square(ratios))) < 1.5


def test_components_of_a_vector_are_used_together() -> None:
    rng = np.random.default_rng(5)
    parts = [motion(rng) for _ in range(3)]
    t, u = np.arange(0, 15, 0.01), np.arange(0, 15, 0.004)
    x = np.stack([p(t) for p in parts], axis=1)
    x += 0.2 * rng.normal(size=x.shape)
    y = np.stack([p(u + 0.004) for p in parts], axis=1)
    y += 0.2 * rng.normal(size=y.shape)
    together, alone = clock_offset((t, x), (u, y)), clock_offset((t, x[:, 0]), (u, y[:, 0]))
    assert abs(together.value - 0.004) < 3 * together.standard_error
    assert together.standard_error < alone.standard_error
    with pytest.raises(InputError, match="as many in both"):
        clock_offset((t, x), (u, y[:, 0]))


def test_gaps_and_absent_values_do_no_harm() -> None:
    rng = np.random.default_rng(6)
    x = motion(rng)
    t, u = np.arange(0, 30, 0.01), np.arange(0, 30, 0.002)
    keep = (u < 11) | (u > 12.5)
    y = x(u + 0.0062) + 0.05 * rng.normal(size=u.size)
    y[::97] = np.nan
    found = clock_offset((t, x(t)), (u[keep], y[keep]))
    assert abs(found.value - 0.0062) < 3 * found.standard_error < 0.3e-3


def test_what_cannot_tell_an_offset_is_refused() -> None:
    rng = np.random.default_rng(7)
    t = np.arange(0, 20, 0.01)
    x = motion(rng)(t)
    with pytest.raises(InputError, match="no motion in the other signal"):
        clock_offset((t, x), (t, np.full_like(t, 2.0)))
    with pytest.raises(InputError, match="chance alone"):
        clock_offset((t, x), (t, rng.normal(size=t.size)))
    with pytest.raises(InputError, match="chance alone"):
        clock_offset((t, x), (t, motion(np.random.default_rng(99))(t)))
    with pytest.raises(InputError, match="in common"):
        clock_offset((t, x), (t + 19.0, x))
    with pytest.raises(InputError, match="in common"):
        clock_offset((t[:150], x[:150]), (t[:150], x[:150]))
    one, two = (np.sin(2 * np.pi * 5.0 * t) + 0.01 * rng.normal(size=t.size) for _ in range(2))
    with pytest.raises(InputError, match="repeats itself"):  # every 0.2 s, within ± 0.5 s
        clock_offset((t, one), (t, two))
    assert abs(clock_offset((t, one), (t, two), max_offset=0.09).value) < 1e-4


def test_an_offset_beyond_the_search_is_not_made_up() -> None:
    rng = np.random.default_rng(8)
    t, x = np.arange(0, 40, 0.01), motion(rng, fastest=1.0)
    with pytest.raises(InputError):
        clock_offset((t, x(t)), (t, x(t + 0.45)), max_offset=0.3)


# --------------------------------------------------------------------------------------------- a measured case


@pytest.fixture(scope="module")
def med14(real_data: Path) -> dict[str, tuple[Array, Array]]:
    """Gravity's direction by the robot, force and acceleration in their sensors' axes: (t [s], (n, 2)) each."""
    tables = {}
    for name in ("wrench", "accel", "orientations"):
        table = np.loadtxt(real_data / "med14-ft-imu" / f"1-baseline_{name}.csv", delimiter=",", skiprows=1)
        tables[name] = (table[:, 0] - 1708857503929545.0) * 1e-6, table[:, 1:]
    t, rotation = tables["orientations"]
    # in the sensor's x and z; the IMU's y and x are parallel to them
    return {
        "gravity": (t, -rotation.reshape(-1, 3, 3)[:, 2, [0, 2]]),
        "force": (tables["wrench"][0], tables["wrench"][1][:, [0, 2]]),
        "acceleration": (tables["accel"][0], tables["accel"][1][:, [1, 0]]),
    }


@pytest.mark.real
@pytest.mark.parametrize("other", ["acceleration", "gravity"])
def test_measured_clocks(med14: dict[str, tuple[Array, Array]], other: str) -> None:
    t, values = med14[other]
    found = clock_offset(med14["force"], (t, values), max_offset=0.2)
    print(f"{other} -> force: {1e3 * found.value:.2f} ± {1e3 * found.standard_error:.2f} ms, {found.correlation:.2f}")
    # three clocks of one computer: a few ms of transport, far less than 50 ms
    assert abs(found.value) < 0.02
    shifted = clock_offset(med14["force"], (t + 0.012, values), max_offset=0.2)
    assert shifted.value - found.value == pytest.approx(-0.012, abs=1e-3)
    if other == "acceleration":  # both feel the tool shake: the IMU's stamps are late by 6.8 ms, known to 0.1 ms
        assert found.standard_error < 0.2e-3
        assert found.value == pytest.approx(-6.8e-3, abs=0.3e-3)


@pytest.mark.real
def test_measured_streams_on_the_wrench_clock(real_data: Path, med14: dict[str, tuple[Array, Array]]) -> None:
    rig = Rig.parse({"columns": {"t": {"unit": "us"}}})
    log = read(real_data / "med14-ft-imu" / "1-baseline_wrench.csv", rig)
    assert log.wrench is not None
    assert 1 / log.period == pytest.approx(698, abs=1)
    assert log.provenance.steps[0].facts["time_origin"] == pytest.approx(1708857503.929545, abs=1e-6)
    t, gravity = med14["gravity"]
    merged = merge(stream(log.t, log.wrench, "wrench"), [stream(t, gravity, "gravity")])
    direction = merged.values["gravity"]
    # the first and last samples of the wrench lie outside of the robot's record; elsewhere there is a direction
    empty = np.isnan(direction[:, 0])
    assert merged.steps[1].facts["empty"] == empty.sum() == ((log.t < t[0]) | (log.t > t[-1])).sum()
    # 0.93 kg: the force along the sensor's z follows gravity's direction with 9.1 N, to what motion adds
    slope = np.polyfit(direction[~empty, 1], log.wrench[~empty, 2], 1)[0]
    assert slope == pytest.approx(9.1, rel=0.1)
