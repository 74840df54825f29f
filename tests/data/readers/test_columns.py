"""Which column is which quantity, and how it becomes SI."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from kinid.data.log import Log
from kinid.data.plausible import KINDS
from kinid.data.readers import read
from kinid.data.readers._columns import Table, to_log
from kinid.data.rig import CONTACT, WRENCH, Rig
from kinid.errors import InputError
from kinid.units import FACTORS


def table(arrays: dict[str, Any] | list[Any]) -> Table:
    """A table in memory; a list has no names."""
    parts = [np.asarray(a) for a in (arrays.values() if isinstance(arrays, dict) else arrays)]
    names = tuple(arrays) if isinstance(arrays, dict) else None
    blocks = frozenset(i for i, a in enumerate(parts) if a.ndim == 2)
    return Table("memory", "memory", names, len(parts), blocks, lambda groups: ([parts[i] for i in g] for g in groups))


def log_of(
    arrays: dict[str, Any] | list[Any], columns: dict[str, Any] | None = None, joints: tuple[str, ...] | None = None
) -> Log:
    return to_log(table(arrays), Rig.parse({"columns": columns or {}}), joints)


def test_true_and_false_are_no_readings() -> None:
    with pytest.raises(InputError, match="of type bool"):
        log_of({"t": np.arange(4) * 0.5, "q1": np.array([True, False, True, True])})


T = np.arange(4) * 0.5
A, B, C, D = np.random.default_rng(7).normal(size=(4, 4)).T

units = st.sampled_from(sorted({*KINDS["depth"], "1"}))
values = st.lists(st.floats(-1e6, 1e6), min_size=1, max_size=5)


@given(raw=values, unit=units, scale=st.floats(-1e3, 1e3).filter(bool), offset=st.floats(-1e3, 1e3))
def test_si_is_raw_times_scale_times_unit_plus_offset(raw: list[float], unit: str, scale: float, offset: float) -> None:
    n = len(raw)
    spec = {"column": "x", "unit": unit, "scale": scale, "offset": offset}
    log = log_of({"t": np.arange(n) * 1.0, "x": raw}, {"depth": spec})
    expected = np.array(raw) * scale * FACTORS[unit] + offset
    np.testing.assert_allclose(log.contact["depth"], expected, rtol=1e-14, atol=1e-9)  # the order of two products


@given(
    order=st.permutations(range(8)),
    count=st.integers(1, 7),
    named=st.booleans(),
    by_number=st.booleans(),
    unit=st.sampled_from(["rad", "deg", "mrad"]),
)
def test_columns_in_any_order_by_name_or_number(
    order: list[int], count: int, named: bool, by_number: bool, unit: str
) -> None:
    data: NDArray[np.float64] = np.random.default_rng(8).normal(size=(3, 8))
    data[:, order[0]] = [0.0, 1.0, 2.0]
    arrays = {f"c{i}": data[:, i] for i in range(8)} if named else list(data.T)
    keys: list[Any] = [f"c{i}" if named and not by_number else i for i in order]
    log = log_of(arrays, {"t": {"column": keys[0]}, "q": {"columns": keys[1 : 1 + count], "unit": unit}})
    np.testing.assert_array_equal(log.t, [0, 1, 2])
    np.testing.assert_allclose(log.q, data[:, order[1 : 1 + count]] * FACTORS[unit], rtol=1e-15)
    facts = log.provenance.steps[0].facts
    assert facts["columns"]["q"] == [f"c{i}" if named else str(i) for i in order[1 : 1 + count]]
    assert len(facts.get("ignored", [])) == 8 - 1 - count
    assert facts.get("to_si", {}) == ({} if unit == "rad" else {"q": FACTORS[unit]})


def test_names_of_the_format_need_no_rig() -> None:
    arrays = {"t": T, **{f"{g}{i}": T + i for g in ("q", "dq", "ddq", "tau", "q_cmd") for i in (2, 1)}}
    arrays |= {name: T + i for i, name in enumerate(WRENCH)} | {name: T - i for i, name in enumerate(CONTACT)}
    log = log_of({**arrays, "phase": ["a", "b", "b", "c"], "spam": T})
    for field in (log.q, log.dq, log.ddq, log.tau, log.q_cmd):
        np.testing.assert_array_equal(field, np.stack([T + 1, T + 2], axis=1))  # by number, not by place
    np.testing.assert_array_equal(log.wrench, T[:, None] + np.arange(6))
    for i, name in enumerate(CONTACT):
        np.testing.assert_array_equal(log.contact[name], T - i)
    assert log.phase is not None
    assert log.phase.tolist() == ["a", "b", "b", "c"]
    assert log.provenance.steps[0].facts["ignored"] == ["spam"]


def test_ten_joints_are_in_the_order_of_their_numbers() -> None:
    log = log_of({"t": T} | {f"q{i}": np.full(4, i) for i in (10, 1, 2, 3, 4, 5, 6, 7, 8, 9)})
    assert log.q is not None
    assert log.q[0].tolist() == list(range(1, 11))


def test_degrees_for_a_group_and_another_unit_for_one_joint() -> None:
    spec = {"q": {"unit": "deg"}, "q2": {"unit": "mm"}, "q3": {"column": "lift", "scale": 2.0}}
    log = log_of({"t": T, "q1": A, "q2": B, "lift": C}, spec)
    deg = math.pi / 180
    np.testing.assert_allclose(log.q, np.stack([A * deg, B * 1e-3, C * 2 * deg], axis=1), rtol=1e-15)
    assert log.provenance.steps[0].facts["to_si"]["q"] == [deg, 1e-3, 2 * deg]


def test_a_block_is_a_group() -> None:
    block = np.stack([A, B], axis=1)
    np.testing.assert_array_equal(log_of({"t": T, "q": block}).q, block)
    named = log_of(
        {"t": T, "positions": block, "w": np.ones((4, 6))},
        {"q": {"column": "positions", "unit": "deg"}, "wrench": {"column": "w"}},
    )
    np.testing.assert_allclose(named.q, block * math.pi / 180, rtol=1e-15)
    with pytest.raises(InputError, match=r"wrench of shape \(4, 5\)"):
        log_of({"t": T, "wrench": np.ones((4, 5))})
    with pytest.raises(InputError, match="2-D array 'q' as one column"):
        log_of({"t": T, "q": block, "x": A}, {"dq": {"columns": ["q", "x"]}})
    with pytest.raises(InputError, match=r"q of shape \(2, 4\) beside 4 times"):
        log_of({"t": T, "q": block.T})
    with pytest.raises(InputError, match="contact quantity 'depth'"):
        log_of({"t": T, "depth": block})
    with pytest.raises(InputError, match=r"time 't' of shape \(4, 2\)"):
        log_of({"t": block, "q": block})
    with pytest.raises(InputError, match=r"depth of shape \(\)"):
        log_of({"t": T, "depth": 3.0})


def test_a_single_axis_needs_no_number() -> None:
    log = log_of({"t": T, "q": A, "tau": B})
    np.testing.assert_array_equal(log.q, A[:, None])
    np.testing.assert_array_equal(log.tau, B[:, None])


def test_the_first_of_consecutive_columns() -> None:
    arrays = [T, *np.arange(52).reshape(13, 4)]
    spec = {"t": {"column": 0}, "q": {"column": 1}, "dq": {"column": 4}, "wrench": {"column": 7}}
    log = log_of(arrays, spec, joints=("a", "b", "c"))
    np.testing.assert_array_equal(log.q, np.array(arrays[1:4]).T)
    np.testing.assert_array_equal(log.dq, np.array(arrays[4:7]).T)
    np.testing.assert_array_equal(log.wrench, np.array(arrays[7:13]).T)
    # a group whose columns are all named says how many the others have
    listed = log_of(arrays, spec | {"tau": {"columns": [9, 10, 11]}})
    np.testing.assert_array_equal(listed.q, log.q)
    with pytest.raises(InputError, match="only the first column of q"):
        log_of(arrays, spec)
    with pytest.raises(InputError, match="3 columns of q from column 12"):
        log_of(arrays, spec | {"q": {"column": 12}}, joints=("a", "b", "c"))


# -------------------------------------------------------------------------------------------------------- time


def test_whole_microseconds_and_nanoseconds_keep_their_digits() -> None:
    for unit, first, step in (("us", 1708857503929545, 1), ("ns", 1708857503929545123, 1)):
        raw = first + step * np.array([0, 1, 2, 1000])
        log = log_of({"t": raw, "depth": A}, {"t": {"unit": unit}})
        np.testing.assert_allclose(np.diff(log.t), np.diff(raw) * FACTORS[unit], rtol=1e-9)
        assert log.t[0] == 0.0
        assert log.provenance.steps[0].facts["time_origin"] == pytest.approx(1708857503.929545, abs=1e-6)
    unsigned = log_of({"t": raw.astype(np.uint64), "depth": A}, {"t": {"unit": "ns"}})
    np.testing.assert_array_equal(unsigned.t, log.t)


def test_other_clocks_are_kept() -> None:
    counter = log_of({"t": [107949, 107950, 107951, 107953], "depth": A}, {"t": {"unit": "ms"}})
    np.testing.assert_allclose(counter.t, [107.949, 107.950, 107.951, 107.953], rtol=1e-15)
    assert "time_origin" not in counter.provenance.steps[0].facts
    unix = 1.7e9 + T
    np.testing.assert_array_equal(log_of({"t": unix, "depth": A}).t, unix)
    moved = log_of({"t": T, "depth": A}, {"t": {"offset": -3.0, "scale": 2.0}})
    np.testing.assert_array_equal(moved.t, 2 * T - 3)


def test_a_time_that_is_not_in_seconds_is_noticed() -> None:
    with pytest.raises(InputError, match=r"time 't' up to 1.71e.15.*unit = \"us\""):
        log_of({"t": 1708857503929545 + np.arange(4), "depth": A})
    with pytest.raises(InputError, match="1e\\+20"):
        log_of({"t": [0.0, 1e20], "depth": [1.0, 2.0]})


# ------------------------------------------------------------------------------------------------------- refusals


@pytest.mark.parametrize(
    ("columns", "found", "mend"),
    [
        ({"q1": {"column": "Q_1"}}, "no column 'Q_1' for q1", "did you mean 'q_1'"),
        ({"depth": {"column": 9}}, "column 9 for depth, and 4 columns", "correct"),
        ({"depth": {"column": -1}}, "column -1", "correct"),
        ({"q": {"columns": ["q_1", "x"]}}, "no column 'x' for q", "valid names"),
        ({"q3": {"unit": "deg"}}, "q3 in memory", "columns"),
        ({"q1": {"unit": "deg"}}, "no column 'q1'", "did you mean 'q_1'"),
        ({"wrench": {"columns": ["q_1", "q_2"]}}, "2 columns for wrench", "all six"),
        ({"fx": {"column": "q_1"}}, "fx without fy fz tx ty tz", "normal_force"),
        ({"depth": {"columns": ["q_1", "q_2"]}}, "several columns for depth", "name it"),
        ({"t": {"column": "clock"}}, "no column 'clock' for t", "valid names"),
    ],
)
def test_what_the_rig_names_must_be_there(columns: dict[str, Any], found: str, mend: str) -> None:
    with pytest.raises(InputError) as error:
        log_of({"t": T, "q_1": A, "q_2": B, "spam": C}, columns)
    assert found in error.value.found
    assert mend in error.value.mend


def test_a_hole_in_the_joints_is_refused_even_when_the_rig_fills_others() -> None:
    with pytest.raises(InputError, match="q1, q2, q4"):
        log_of({"t": T, "q1": A, "q2": B, "x": C}, {"q4": {"column": "x"}})
    filled = log_of({"t": T, "q1": A, "q2": B, "q4": D, "x": C}, {"q3": {"column": "x"}})
    np.testing.assert_array_equal(filled.q, np.stack([A, B, C, D], axis=1))
    with pytest.raises(InputError, match="q0, q1 in"):
        log_of({"t": T, "q0": A, "q1": B})


def test_the_number_of_joints_must_be_the_rig_s() -> None:
    rig = Rig.parse({"robot": {"model": "lwr4plus", "joints": ["a", "b", "c"]}})
    with pytest.raises(InputError, match="2 joints in memory, and 3 names"):
        to_log(table({"t": T, "q1": A, "q2": B}), rig)


def test_without_a_header_columns_have_numbers() -> None:
    with pytest.raises(InputError, match="no time in memory with 2 columns and no header"):
        log_of([T, A])
    with pytest.raises(InputError, match="no header in memory"):
        log_of([T, A], {"t": {"column": "t"}})


def test_a_translation_is_no_torque() -> None:
    log = log_of({"t": T, "q1": A, "tx": B, "ty": C, "tz": D})
    assert log.wrench is None
    assert log.provenance.steps[0].facts["ignored"] == ["tx", "ty", "tz"]


@pytest.mark.parametrize(
    "columns",
    [
        {"q": {"columns": ["a", "b", "a"]}},
        {"q": {"columns": [1, 2, 1]}},
        {"q1": {"column": "a"}, "q2": {"column": "a"}},
        {"wrench": {"columns": ["a", "a", "b", "b", "c", "c"]}},
    ],
)
def test_one_column_is_not_two_of_a_quantity(columns: dict[str, Any], tmp_path: Path) -> None:
    path = tmp_path / "log.csv"
    path.write_text("t,a,b,c\n0,1,2,3\n1,2,3,4\n", encoding="utf-8")
    (quantity, *_) = {name.rstrip("12") for name in columns}
    with pytest.raises(InputError, match=f"column 'a' of .* named 2 times for {quantity}; .* correct {quantity} in"):
        read(path, Rig.parse({"columns": columns}))


def test_one_column_may_be_of_two_quantities(tmp_path: Path) -> None:
    path = tmp_path / "log.csv"
    path.write_text("t,a\n0,1\n1,2\n", encoding="utf-8")
    log = read(path, Rig.parse({"columns": {"q": {"columns": ["a"]}, "q_cmd": {"columns": ["a"]}}}))
    assert log.q is not None
    assert log.q[:, 0].tolist() == [1.0, 2.0]


def test_two_columns_of_one_name(tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text("t,q1,q1\n0,1,2\n1,3,4\n")
    with pytest.raises(InputError, match="2 columns 'q1'"):
        read(tmp_path / "a.csv")
    log = read(tmp_path / "a.csv", Rig.parse({"columns": {"q1": {"column": 2}}}))
    np.testing.assert_array_equal(log.q, [[2], [4]])


def test_rows_that_come_evenly_need_no_time_column(tmp_path: Path) -> None:
    path = tmp_path / "even.csv"
    np.savetxt(path, np.column_stack([np.arange(10.0), np.ones(10)]), delimiter=",")
    columns = {"t": {"rate": 500}, "depth": {"column": 0, "unit": "mm"}, "normal_force": {"column": 1}}
    log = read(path, Rig.parse({"columns": columns}))
    np.testing.assert_allclose(log.t, np.arange(10) / 500)
    assert log.provenance.steps[0].facts["time_from_rate_hz"] == 500
    with pytest.raises(InputError, match="rate"):
        Rig.parse({"columns": {"depth": {"rate": 500}}})
    with pytest.raises(InputError, match="rate = 500"):
        read(path, Rig.parse({"columns": {"depth": {"column": 0}}}))


def test_one_column_of_a_block_has_a_unit_or_a_sign_of_its_own() -> None:
    """What is said of it alone goes before what is said of all."""
    arrays = dict(zip("abcdef", np.arange(24.0).reshape(6, 4))) | {"t": T, "left": A, "right": B}
    torques = {name: {"unit": "N*mm"} for name in WRENCH[3:]}
    columns = {"wrench": {"columns": list("abcdef"), "unit": "kN"}, **torques}
    log = log_of(arrays, {**columns, "q": {"columns": ["left", "right"], "unit": "deg"}, "q2": {"scale": -1.0}})
    readings = np.arange(24.0).reshape(6, 4) * np.repeat([1e3, 1e-3], 3)[:, None]
    np.testing.assert_allclose(log.wrench, readings.T)
    np.testing.assert_allclose(log.q, np.deg2rad(np.stack([A, -B], axis=1)))


@pytest.mark.parametrize(("rate", "right"), [(2.0, True), (2.1, True), (1.0, False), (500.0, False), (1e12, False)])
def test_a_rate_beside_a_column_of_times_agrees_with_it(rate: float, right: bool) -> None:
    arrays = {"t": T, "depth": A}
    if right:
        np.testing.assert_array_equal(log_of(arrays, {"t": {"rate": rate}}).t, T)
        return
    with pytest.raises(InputError, match=r"2 rows/s by the times in 't'"):
        log_of(arrays, {"t": {"rate": rate}})


@pytest.mark.parametrize(
    ("joints", "wrench", "says"),
    [
        ((0.0, 10.0), (0.0, 10.0), ""),
        ((0.2, 10.0), (0.0, 9.7), ""),
        ((4.0, 10.0), (0.0, 10.0), "q begins 4 s after wrench: 6 s of 10 s hold all"),
        ((0.0, 10.0), (1.0, 7.0), "wrench begins 1 s after q, wrench ends 3 s before q: 6 s of 10 s hold all"),
    ],
)
def test_joints_and_wrench_that_begin_or_end_apart_are_doubted(
    joints: tuple[float, float], wrench: tuple[float, float], says: str
) -> None:
    t = np.arange(1001) * 0.01
    q, f = (np.where((t >= a - 1e-9) & (t <= b + 1e-9), np.sin(t), np.nan) for a, b in (joints, wrench))
    said = log_of({"t": t, "q1": q, **dict.fromkeys(WRENCH, f)}).provenance.warnings
    assert len(said) == bool(says)
    assert not says or said[0].startswith(says)


def test_joints_and_wrench_without_a_row_in_common_are_refused() -> None:
    t = np.arange(1001) * 0.01
    q, f = np.where(t < 5.0, np.sin(t), np.nan), np.where(t < 5.0, np.nan, np.cos(t))
    with pytest.raises(InputError, match="no row of memory with all of q from 0 to 4.99 s and wrench from 5 to 10 s"):
        log_of({"t": t, "q1": q, **dict.fromkeys(WRENCH, f)})
