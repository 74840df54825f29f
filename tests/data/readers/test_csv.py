"""Layouts of text tables."""

from __future__ import annotations

import gzip
import os
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from kinid.data.log import Log
from kinid.data.readers import csv, read
from kinid.data.rig import Rig
from kinid.errors import InputError
from kinid.inputs import FACTOR

BY_NUMBER = {"t": {"column": 0}, "depth": {"column": 1}}


def read_text(folder: Path, text: str | bytes, columns: dict[str, Any] | None = None, name: str = "a.csv") -> Log:
    path = folder / name
    path.write_bytes(text.encode() if isinstance(text, str) else text)
    return read(path, Rig.parse({"columns": columns or {}}))


@pytest.mark.parametrize(
    "text",
    [
        "t,depth\n0,1\n1,-2.5\n",
        "t,depth\r\n0,1\r\n1,-2.5\r\n",
        "t,depth\n0,1\n1,-2.5",
        "\ufefft,depth\n0,1\n1,-2.5\n",
        '"t","depth"\n"0","1"\n"1","-2.5"\n',
        "t, depth\n0, 1\n1, -2.5\n",
        "t;depth\n0;1\n1;-2.5\n",
        "t;depth\n0,0;1,0\n1,0;-2,5\n",
        "t\tdepth\n0\t1\n1\t-2.5\n",
        "t\tdepth\n0,0\t1,0\n1,0\t-2,5\n",
        "t depth\n0 1\n1 -2.5\n",
        "  t    depth  \n  0.0   1.0  \n  1.0  -2.5  \n",
        "\n\nt,depth\n\n0,1\n\n1,-2.5\n\n",
        "# a remark, with a comma\n# another\nt,depth\n0,1\n# in between\n1,-2.5\n",
        "% t depth\n0 1\n1 -2.5\n",
        "# t,depth\n0,1\n1,-2.5\n",
        "# t depth\n0,1\n1,-2.5\n",
        "t,spam,depth\n0,x,1\n1,y,-2.5\n",
        "t,depth\n0,1e0\n1,-25E-1\n",
    ],
)
def test_layouts_with_a_header(text: str, tmp_path: Path) -> None:
    log = read_text(tmp_path, text)
    np.testing.assert_array_equal(log.t, [0, 1])
    np.testing.assert_array_equal(log.contact["depth"], [1, -2.5])


@pytest.mark.parametrize(
    "text",
    [
        "0,1\n1,-2.5\n",
        "\ufeff0,1\n1,-2.5\n",
        "# made by a tester\n0,1\n1,-2.5\n",
        "0\t\t1\n1\t\t-2.5\n",
        " 0   1\n 1  -2.5\n",
        "0;1\n1;-2.5\n",
        "0;1,0\n1;-2,5\n",
        "+0.0,.1e1\n1.,-2.5\n",
    ],
)
def test_layouts_without_a_header(text: str, tmp_path: Path) -> None:
    log = read_text(tmp_path, text, BY_NUMBER)
    np.testing.assert_array_equal(log.t, [0, 1])
    np.testing.assert_array_equal(log.contact["depth"], [1, -2.5])


def test_a_tab_separated_table_may_have_empty_cells(tmp_path: Path) -> None:
    log = read_text(tmp_path, "t\tdepth\tslip1\n0\t\t1\n1\t5\t2\n")
    np.testing.assert_array_equal(log.contact["depth"], [np.nan, 5])
    np.testing.assert_array_equal(log.contact["slip1"], [1, 2])


def test_absent_cells(tmp_path: Path) -> None:
    log = read_text(tmp_path, "t,depth\n0,\n1,nan\n2,NaN\n3,inf\n4,-inf\n5,7\n")
    np.testing.assert_array_equal(log.contact["depth"], [np.nan, np.nan, np.nan, np.inf, -np.inf, 7])
    assert log.provenance.steps[0].facts["invalid_rows"] == 5


def test_time_as_text(tmp_path: Path) -> None:
    text = "t,depth\n2024-02-25 10:38:23.929545,1\n2024-02-25 10:38:23.930545,2\n"
    log = read_text(tmp_path, text)
    np.testing.assert_allclose(log.t, [0, 1e-3], atol=1e-9)
    assert log.provenance.steps[0].facts["time_origin"] == pytest.approx(1708857503.929545, abs=1e-6)


def test_numbers_that_begin_as_whole_ones(tmp_path: Path) -> None:
    # the type of a column is known only at its end: 200 000 whole numbers, then a fraction
    rows = "".join(f"{i},0\n" for i in range(200_000))
    log = read_text(tmp_path, "t,depth\n" + rows + "200000,0.5\n")
    assert len(log) == 200_001
    assert log.contact["depth"][-1] == 0.5


@pytest.mark.parametrize(
    ("text", "found"),
    [
        ("t,depth\n0,1\n1,oops\n", "'oops' in row 2, column 'depth'"),
        ("t,depth\n0,1\n1,1.2.3\n", "'1.2.3' in row 2, column 'depth'"),
        ("t,depth\n0,1\nx,2\n", "'x' in row 2, column 't'"),
        ("t,depth\n0,1\n1\n", "1 cells in row 2"),
        ("t,depth\n0,1\n1,2,3\n", "3 cells in row 2"),
        ("t depth\n0 1\n1 2 3\n", "3 cells in row 2"),
        ("t,depth\n", "a header and no row"),
        ("# t,depth\n", "no rows"),
        ("\n \n", "no rows"),
        ("t,depth\n0,1\n,2\n", "time that is not a number in row 2"),
        ("t,depth\n0,1\n0,2\n", "time that repeats in row 2"),
        ("t,depth\n0,1\n-1,2\n", "time that runs backwards in row 2"),
        ("t,depth\n0,1\n1,2\n".encode("utf-16"), "no text in UTF-8"),
        (b"t,depth\n0,1\n1,\xff\xfe\n", "can't be read as text in UTF-8"),
    ],
)
def test_bad_text_is_refused_with_its_place(text: str | bytes, found: str, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=found) as error:
        read_text(tmp_path, text)
    assert "a.csv" in str(error.value)
    assert "\n" not in str(error.value)


def test_a_ragged_row_far_down_is_found(tmp_path: Path) -> None:
    rows = [f"{i},{i}" for i in range(100_000)]
    rows[70_000] += ",9"
    with pytest.raises(InputError, match="3 cells in row 70001 of"):
        read_text(tmp_path, "\n".join(["t,depth", *rows]))


@pytest.mark.parametrize("close", [None, 900, 1999])
@pytest.mark.parametrize("sign", [",", " "])
def test_a_quote_that_is_not_closed_swallows_no_rows(close: int | None, sign: str, tmp_path: Path) -> None:
    rows = [sign.join((str(i), "0.5", "free")) for i in range(2000)]
    for row in (72, close):
        if row is not None:
            rows[row] = rows[row].replace("free", '"free')
    with pytest.raises(InputError, match=r'a quote \("\) in row 73 of .*a\.csv'):
        read_text(tmp_path, "\n".join([sign.join(("t", "depth", "phase")), *rows]))


def test_quotes_in_pairs_and_empty_lines_are_no_harm(tmp_path: Path) -> None:
    rows = "".join(f'{i},{i},"in, {i}"\r\n\r\n' for i in range(100))
    log = read_text(tmp_path, f'"t","depth","phase"\r\n{rows}')
    assert len(log) == 100
    assert log.phase is not None
    assert log.phase[-1] == "in, 99"


def test_a_header_longer_than_what_the_layout_is_told_from(tmp_path: Path) -> None:
    names = ["t", "depth", *(f"a_long_name_of_column_{i}" for i in range(10_000))]
    rows = [",".join(["1" if i else "0"] * len(names)) for i in range(2)]
    assert len(read_text(tmp_path, "\n".join([",".join(names), *rows]) + "\n")) == 2


def test_a_row_larger_than_a_block_is_named_as_one(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="a row of more than 1 MB"):
        read_text(tmp_path, f"t,depth,note\n0,1,a\n1,1,{9_000_000 * 'x'}\n2,1,a\n")


def test_text_in_a_column_that_nobody_wants_is_no_harm(tmp_path: Path) -> None:
    assert len(read_text(tmp_path, "t,depth,note\n0,1,abc\n1,2,\n")) == 2


blanks = st.text(" \t", max_size=3)


@settings(suppress_health_check=[HealthCheck.function_scoped_fixture], max_examples=60)
@given(
    numbers=st.lists(st.tuples(st.integers(-99, 99), st.integers(-99, 99)), min_size=1, max_size=5),
    pads=st.lists(blanks, min_size=15, max_size=15),
    end=st.sampled_from(["\n", "\r\n"]),
    piece=st.sampled_from([1, 2, 5, 1 << 22]),
)
def test_white_space_of_any_kind(
    numbers: list[tuple[int, int]], pads: list[str], end: str, piece: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    with monkeypatch.context() as patch:
        patch.setattr(csv, "_PIECE", piece)
        pad = iter(pads)
        lines = [f"{next(pad)}{a} {next(pad)}{b}{next(pad)}" for a, b in numbers]
        squeezed = csv._squeezed(end.join([*lines, ""]).encode())
    assert squeezed.decode().splitlines() == [f"{a} {b}" for a, b in numbers]


@pytest.mark.parametrize("name", ["a.csv.gz", "A.CSV.GZ", "b.txt.gz"])
def test_a_packed_table_is_what_was_packed(name: str, tmp_path: Path) -> None:
    text = "t,depth\n0,1\n1,-2.5\n"
    packed, plain = read_text(tmp_path, gzip.compress(text.encode()), name=name), read_text(tmp_path, text)
    np.testing.assert_array_equal(packed.t, plain.t)
    np.testing.assert_array_equal(packed.contact["depth"], plain.contact["depth"])


def test_a_packed_table_is_whole_and_small_enough(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    packed = gzip.compress(b"t,depth\n" + b"0,1\n" * 100_000)
    for damaged in (packed[:-20], b"no gzip at all"):
        with pytest.raises(InputError, match="can't be read as gzip"):
            read_text(tmp_path, damaged, name="a.csv.gz")
    monkeypatch.setattr(csv, "MOST_TEXT", 1000)
    most = csv.MOST_PACKED * len(packed) / 1e9
    with pytest.raises(InputError, match=rf"more than {most:.3g} GB of text in .*unpack it first"):
        read_text(tmp_path, packed, name="a.csv.gz")


def test_a_packed_table_of_measured_numbers_may_be_as_large_as_a_plain_one(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """They hardly shrink; what does, and is large, is refused before memory holds several times as much."""
    noise = np.random.default_rng(1).normal(size=2000)
    text = "t,depth\n" + "".join(f"{1e-3 * i},{x}\n" for i, x in enumerate(noise))
    monkeypatch.setattr(csv, "MOST_TEXT", 1000)
    assert len(read_text(tmp_path, gzip.compress(text.encode()), name="a.csv.gz").t) == 2000
    assert csv.MOST_TEXT * csv.MOST_PACKED < csv.MOST_UNPACKED


def test_a_plain_table_has_a_limit_that_can_be_raised(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A file with holes in it says that it is larger than any memory."""
    path = tmp_path / "a.csv"
    path.write_text("t,depth\n0,1\n1,2\n", encoding="utf-8")
    os.truncate(path, 20 * csv.MOST_UNPACKED)
    with pytest.raises(InputError, match=rf"40 GB of text in .*2 GB at most.*{FACTOR}=20"):
        read(path, Rig())
    monkeypatch.setenv(FACTOR, "1e-9")
    path.write_text("t,depth\n0,1\n1,2\n", encoding="utf-8")
    with pytest.raises(InputError, match="2e-09 GB at most"):
        read(path, Rig())
