"""A log holds frozen samples in strictly increasing time, and knows which of them can be used."""

from __future__ import annotations

import json
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from numpy.typing import NDArray

from kinid.data.log import Log, Provenance, frozen
from kinid.errors import InputError

Array = NDArray[np.float64]


def times(least: int = 1, most: int = 50) -> st.SearchStrategy[Array]:
    """Strictly increasing times with steps from a microsecond to a minute."""
    steps = st.lists(st.floats(1e-6, 60), min_size=least, max_size=most)
    return steps.map(np.cumsum)


@given(t=times(), joints=st.integers(1, 9))
def test_a_log_keeps_what_it_was_given(t: Array, joints: int) -> None:
    rng = np.random.default_rng(0)
    n = len(t)
    given_: dict[str, Array] = {name: rng.normal(size=(n, joints)) for name in ("q", "dq", "ddq", "tau", "q_cmd")}
    given_["wrench"] = rng.normal(size=(n, 6))
    log = Log(t, **given_, contact={"depth": t}, phase=np.full(n, "free"))
    for name, values in given_.items():
        np.testing.assert_array_equal(getattr(log, name), values)
        with pytest.raises(ValueError, match="read-only"):
            getattr(log, name)[0, 0] = 1.0
    for values in (log.t, log.contact["depth"], log.phase, log.valid):
        assert values is not None
        with pytest.raises(ValueError, match="read-only"):
            values[0] = values[0]
    assert len(log) == n
    assert log.joint_count == joints
    assert log.valid.all()


def test_freezing_leaves_the_callers_array_writeable() -> None:
    t, q = np.arange(3.0), np.zeros((3, 2))
    Log(t, q=q)
    t[0], q[0, 0] = -1.0, 5.0
    assert not frozen([1, 2]).flags.writeable


@given(t=times(least=2), data=st.data())
def test_time_that_does_not_increase_is_refused(t: Array, data: Any) -> None:
    row = data.draw(st.integers(1, len(t) - 1))
    doubled = t.copy()
    doubled[row] = doubled[row - 1]
    with pytest.raises(InputError, match=f"repeats in row {row + 1} of memory") as caught:
        Log(doubled)
    assert "more digits" in caught.value.mend
    backwards = t.copy()
    backwards[row] = backwards[row - 1] - 1e-3
    with pytest.raises(InputError, match=f"runs backwards in row {row + 1} of memory") as caught:
        Log(backwards)
    assert "the clock was set back" in caught.value.mend


@given(t=times(), data=st.data(), bad=st.sampled_from([np.nan, np.inf, -np.inf]))
def test_time_that_is_no_number_is_refused(t: Array, data: Any, bad: float) -> None:
    row = data.draw(st.integers(0, len(t) - 1))
    t = t.copy()
    t[row] = bad
    with pytest.raises(InputError, match=f"not a number in row {row + 1} "):
        Log(t)


def test_all_rows_that_repeat_are_counted() -> None:
    with pytest.raises(InputError, match="3 such rows"):
        Log(np.array([0.0, 0.0, 1.0, 1.0, 2.0, 1.5]))


@pytest.mark.parametrize("t", [[], [[0.0, 1.0]], 3.0])
def test_a_log_without_samples_is_refused(t: Any) -> None:
    with pytest.raises(InputError, match="no samples in memory"):
        Log(np.array(t))


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"q": np.zeros((4, 7))}, r"q of shape \(4, 7\).*expected shape \(5, N\)"),
        ({"q": np.zeros(5)}, r"q of shape \(5,\)"),
        ({"wrench": np.zeros((5, 3))}, r"wrench of shape \(5, 3\).*expected shape \(5, 6\)"),
        ({"q": np.zeros((5, 7)), "dq": np.zeros((5, 6))}, "6 columns of dq beside 7 of q"),
        ({"q": np.zeros((5, 7)), "tau": np.zeros((5, 8))}, "8 columns of tau beside 7 of q"),
        ({"contact": {"deep": np.zeros(5)}}, "contact quantity 'deep'"),
        ({"contact": {"depth": np.zeros(4)}}, r"contact quantity 'depth' of shape \(4,\)"),
        ({"phase": np.array(["free"] * 4)}, r"phase of shape \(4,\)"),
    ],
)
def test_shapes_that_do_not_fit_are_refused(values: dict[str, Any], message: str) -> None:
    with pytest.raises(InputError, match=message):
        Log(np.arange(5.0), **values, provenance=Provenance("somewhere.csv"))


FINITE = st.floats(-1e12, 1e12)  # more is refused
ANY = FINITE | st.sampled_from([np.inf, -np.inf, np.nan])


@given(
    q=arrays(np.float64, (12, 3), elements=ANY),
    wrench=arrays(np.float64, (12, 6), elements=FINITE),
    depth=arrays(np.float64, 12, elements=ANY),
)
def test_valid_is_where_everything_is_a_number(q: Array, wrench: Array, depth: Array) -> None:
    """Also where +∞ and −∞ meet in a row, and without a warning."""
    log = Log(np.arange(12.0), q=q, wrench=wrench, contact={"depth": depth})
    expected = np.isfinite(q).all(axis=1) & np.isfinite(wrench).all(axis=1) & np.isfinite(depth)
    np.testing.assert_array_equal(log.valid, expected)


@pytest.mark.parametrize("name", ["q", "dq", "ddq", "tau", "q_cmd", "wrench"])
def test_every_quantity_counts_for_validity(name: str) -> None:
    values = np.zeros((4, 6))
    values[2, 5] = np.nan
    np.testing.assert_array_equal(Log(np.arange(4.0), **{name: values}).valid, [True, True, False, True])


def test_joint_count_of_a_log_without_positions() -> None:
    assert Log(np.arange(2.0)).joint_count == 0
    assert Log(np.arange(2.0), tau=np.zeros((2, 4))).joint_count == 4


def test_period_is_the_usual_step() -> None:
    assert Log(np.array([0.0, 1.0, 2.0, 50.0])).period == 1.0
    assert Log(np.array([3.0])).period == float("inf")


def test_pieces_are_apart_where_time_has_a_gap() -> None:
    t = np.concatenate([np.arange(10), 14.9 + np.arange(5), 100 + np.arange(3)]).astype(float)
    # a step of 5.9 periods and one of 81 are gaps
    assert Log(t).pieces == (slice(0, 10), slice(10, 15), slice(15, 18))
    assert Log(np.array([0.0, 1.0, 2.0, 6.9, 7.9])).pieces == (slice(0, 5),)  # 4.9 periods are none
    assert Log(np.array([7.0])).pieces == (slice(0, 1),)


def test_pieces_hold_single_invalid_positions_but_no_run_of_them() -> None:
    q = np.zeros((40, 2))
    q[0], q[5], q[10:14], q[20:26], q[39, 1] = np.nan, np.inf, np.nan, np.nan, np.nan
    log = Log(np.arange(40.0), q=q)
    # four in a row leave a step of five periods, six one of seven
    assert log.pieces == (slice(1, 20), slice(26, 39))
    assert Log(np.arange(3.0), q=np.full((3, 1), np.nan)).pieces == ()


@given(t=times(least=2, most=80), bad=st.sets(st.integers(0, 79)))
def test_pieces_cover_every_usable_sample_once(t: Array, bad: set[int]) -> None:
    q = np.zeros((len(t), 1))
    q[[row for row in bad if row < len(t)]] = np.nan
    log = Log(t, q=q)
    covered = np.zeros(len(t), dtype=int)
    for piece in log.pieces:
        covered[piece] += 1
        assert np.isfinite(q[[piece.start, piece.stop - 1]]).all()
        usable = t[piece][np.isfinite(q[piece, 0])]
        assert (np.diff(usable) <= 5 * log.period).all()
    assert covered.max(initial=0) <= 1
    assert covered[np.isfinite(q[:, 0])].all()


def test_replace_makes_another_log_and_says_so() -> None:
    log = Log(np.arange(3.0), q=np.zeros((3, 2)), provenance=Provenance("a.csv"))
    assert log.valid.all()
    other = log.replace("shift", {"by": 1.0}, q=np.full((3, 2), np.nan))
    assert log.valid.all()
    assert not other.valid.any()
    assert log.provenance.steps == ()
    assert str(other.provenance.steps[0]) == "shift: by 1"
    assert other.provenance.source == "a.csv"
    assert log.replace(phase=np.array(["free"] * 3)).provenance.steps == ()


def test_provenance_is_plain_for_json() -> None:
    made = Provenance("log.bag").then("merge", rate=999.98765, list=[1.0, 2.0]).then("bias", of="free motion")
    assert json.loads(json.dumps(made.to_dict())) == {
        "source": "log.bag",
        "steps": [{"name": "merge", "rate": 999.98765, "list": [1.0, 2.0]}, {"name": "bias", "of": "free motion"}],
    }
    assert str(made.steps[0]) == "merge: rate 1000, list [1, 2]"


@pytest.mark.parametrize(
    ("name", "values"),
    [("q", [[1e300], [0.0]]), ("wrench", [[0.0] * 6, [0.0] * 5 + [-1e13]]), ("tau", [[np.nan], [1e20]])],
)
def test_values_that_no_sensor_gives_are_refused(name: str, values: list[list[float]]) -> None:
    with pytest.raises(InputError, match=rf"{name} of 1e\+\d+ in memory; expected 1e\+12 at most"):
        Log(np.arange(2.0), **{name: np.array(values)})


def test_what_was_not_measured_may_be_infinite() -> None:
    log = Log(np.arange(3.0), q=np.array([[np.inf], [np.nan], [1e11]]))
    assert log.valid.tolist() == [False, False, True]


@pytest.mark.parametrize(
    "t", [np.arange(5) * 1e-300, np.arange(5) * 1e-15, np.array([0.0, 1e300]), np.arange(5) * 1.0 + 1e18]
)
def test_a_time_that_no_clock_shows_is_refused_without_a_warning(t: Array) -> None:
    with pytest.raises(InputError, match="time from .* rows of memory; expected seconds"):
        Log(t, contact={"depth": np.zeros(len(t))})
