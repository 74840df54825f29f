"""Tables of text, with or without a header: separated by commas, semicolons, tabs or white space."""

from __future__ import annotations

import csv
import gzip
import io
import mmap
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from kinid.data.log import Log
from kinid.data.readers._columns import Arrays, Table, to_log
from kinid.data.readers._guard import MOST_UNPACKED, readable
from kinid.data.rig import Rig
from kinid.errors import InputError
from kinid.inputs import raised, size_limit

if TYPE_CHECKING:
    import pyarrow as pa

PLAIN = (".csv", ".txt", ".tsv", ".dat")
PACKED = tuple(f"{suffix}.gz" for suffix in PLAIN)
SUFFIXES: tuple[str, ...] = (*PLAIN, *PACKED)

#: bytes at the start that the layout is told from, at first and at most: a header of many columns may be longer
_SNIFFED, _MOST_SNIFFED = 1 << 16, 1 << 24
_PIECE = 1 << 22  # bytes that are searched at once
#: text that a small packed file may hold [bytes]: parsing takes several times as much; and times that text of measured
#: numbers, which shrinks to a third or so, may be larger than its packed file beyond that
MOST_TEXT, MOST_PACKED = 100_000_000, 10
_SPACE = " "
_COMMENT = ("#", "%")
_ABSENT = ["", "nan", "NaN", "NAN", "Nan", "-nan", "-NaN"]
_NUMBER = re.compile(r"[-+]?(\d+[.,]?\d*|[.,]\d+)([eE][-+]?\d+)?$")


#: bytes of a file: mapped, or unpacked
Text = mmap.mmap | bytes


@dataclass(frozen=True)
class _Layout:
    """How a text is laid out: `start` of its first row of data [bytes], and how its cells are told apart."""

    start: int
    delimiter: str
    names: tuple[str, ...] | None
    width: int
    decimal: str


def read(path: Path, rig: Rig, joints: Sequence[str] | None = None) -> Log:
    """Read a table of text; a comment may be its header (`# t q1 …`), empty cells and `nan` are absent."""
    text = _opened(path)
    layout = _sniff(text, path)

    def label(i: int) -> str:
        return layout.names[i] if layout.names else str(i)

    def load(groups: Sequence[Sequence[int]]) -> Iterator[Arrays]:
        from kinid.data.readers._arrow import to_numpy

        columns = _parse(text, layout, sorted({i for group in groups for i in group}), path)
        last = {i: g for g, group in enumerate(groups) for i in group}
        for g, group in enumerate(groups):
            with readable(path, "text"):
                arrays = [to_numpy(columns.pop(i) if last[i] == g else columns[i], label(i), path) for i in group]
            yield arrays

    return to_log(Table(str(path), "text", layout.names, layout.width, frozenset(), load), rig, joints)


def columns(path: Path) -> dict[str, pa.ChunkedArray]:
    """Columns of a table with a header, by name; {} without one."""
    text = _opened(path)
    layout = _sniff(text, path)
    if layout.names is None:
        return {}
    return dict(zip(layout.names, _parse(text, layout, range(layout.width), path).values()))


def _opened(path: Path) -> Text:
    """The text of a file.

    Raises:
        InputError: it can't be read, or is too large.
    """
    if path.name.lower().endswith(PACKED):
        return _unpacked(path)
    if (size := path.stat().st_size) > size_limit(MOST_UNPACKED):
        raise InputError(
            f"{size / 1e9:.3g} GB of text in {path}",
            f"{size_limit(MOST_UNPACKED) / 1e9:.3g} GB at most",
            f"cut it, convert it to Parquet, {raised(size, MOST_UNPACKED)}",
        )
    with readable(path, "text"), path.open("rb") as file:
        return mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ)


def _unpacked(path: Path) -> bytes:
    """The text in a gzip file, which may claim to hold more than there is memory.

    Raises:
        InputError: too much, or a damaged file.
    """
    text, most = io.BytesIO(), size_limit(MOST_TEXT)
    most = min(max(most, MOST_PACKED * path.stat().st_size), size_limit(MOST_UNPACKED))
    with readable(path, "gzip"), gzip.open(path, "rb") as file:
        while piece := file.read(_PIECE):
            text.write(piece)
            if (size := text.tell()) > most:
                found, mend = f"more than {most / 1e9:.3g} GB of text in {path}", "cut it, unpack it first"
                raise InputError(found, "less", f"{mend}, {raised(2 * size, MOST_TEXT)}")
    return text.getvalue()


def _sniff(text: Text, path: Path) -> _Layout:
    """The layout, from the first lines.

    Raises:
        InputError: no text, or no row of data.
    """
    head, size = text[:_SNIFFED], _SNIFFED
    lines, comment = _first_lines(head, len(head) < len(text))
    while len(lines) < 2 and size < min(len(text), _MOST_SNIFFED):
        size *= 8
        head = text[:size]
        lines, comment = _first_lines(head, len(head) < len(text))
    if b"\x00" in head:
        raise InputError(f"{path}, which is no text in UTF-8", "a table of text", "export it as CSV in UTF-8")
    if not lines:
        raise InputError(f"no rows in {path}", "a table with samples", "record or export it again")
    delimiter = _delimiter([shown for _, shown in lines])
    rows = [_cells(shown, delimiter) for _, shown in lines]
    decimal = "," if delimiter != "," and _decimal_comma(rows) else "."
    if any(_NUMBER.match(cell) for cell in rows[0]):
        names = None
        if comment is not None:
            named = _cells(comment, delimiter) if delimiter in comment else comment.split()
            fits = len(named) == len(rows[0]) and not any(_NUMBER.match(name) for name in named)
            names = tuple(named) if fits else None
        bom = 3 if head.startswith(b"\xef\xbb\xbf") and lines[0][0] == 0 else 0
        return _Layout(lines[0][0] + bom, delimiter, names, len(rows[0]), decimal)
    if len(lines) == 1:
        raise InputError(f"a header and no row of data in {path}", "a table with samples", "record or export it again")
    return _Layout(lines[1][0], delimiter, tuple(rows[0]), len(rows[0]), decimal)


def _first_lines(head: bytes, goes_on: bool) -> tuple[list[tuple[int, str]], str | None]:
    """Lines that hold cells, each with where it starts [bytes], and the last comment before them, if any.

    Args:
        head: of a text. goes_on: whether more of it follows, so that its last line may be cut off.
    """
    lines: list[tuple[int, str]] = []
    position, comment = 0, None
    raw = head.splitlines(keepends=True)
    for line in raw[:-1] if goes_on and len(raw) > 1 else raw:
        start, position = position, position + len(line)
        shown = line.decode("utf-8-sig" if start == 0 else "utf-8", errors="replace").strip("\r\n")
        if shown.lstrip().startswith(_COMMENT):
            comment = comment if lines else shown.lstrip().lstrip("".join(_COMMENT)).strip()
        elif shown.strip():
            lines.append((start, shown))
        if len(lines) == 40:
            break
    return lines, comment


def _delimiter(lines: Sequence[str]) -> str:
    """The sign that splits all lines into equally many cells; white space when there is none."""
    for sign in (";", "\t", ","):
        rows = [_cells(line, sign) for line in lines]
        widths = {len(row) for row in rows}
        if len(widths) == 1 and widths != {1}:
            # tabs as padding leave a column that is empty everywhere
            if sign == "\t" and any(not any(row[i] for row in rows) for i in range(len(rows[0]))):
                continue
            return sign
    most = max((";", "\t", ","), key=lambda sign: sum(sign in line for line in lines))
    # a row that is cut off or too long must not turn a comma-separated table into one of white space
    ragged = sum(most in line for line in lines) > len(lines) / 2 and most != "\t"
    return most if ragged else _SPACE


def _cells(line: str, delimiter: str) -> list[str]:
    if delimiter == _SPACE:
        return [cell.strip('"') for cell in line.split()]
    try:
        row = next(csv.reader(io.StringIO(line), delimiter=delimiter, skipinitialspace=True))
    except csv.Error:  # a cell beyond its limit of 128 kB: not what splits this line
        row = [line]
    return [cell.strip() for cell in row]


def _decimal_comma(rows: Sequence[Sequence[str]]) -> bool:
    numbers = [cell for row in rows for cell in row if _NUMBER.match(cell)]
    return any("," in cell for cell in numbers) and not any("." in cell for cell in numbers)


def _parse(text: Text, layout: _Layout, wanted: Sequence[int], path: Path) -> dict[int, pa.ChunkedArray]:
    """Arrow columns by position.

    Raises:
        InputError: rows of differing length, quotes that aren't closed, or cells that are no UTF-8.
    """
    import pyarrow as pa
    import pyarrow.csv

    noted, quoted = _has_comments_and_quotes(text, layout.start)
    # nothing to clean: Arrow parses the mapped file itself, without a copy
    data = pa.py_buffer(text)[layout.start :] if not noted and layout.delimiter != _SPACE else None
    if data is None:
        data = pa.py_buffer(_cleaned(text[layout.start :], noted, layout.delimiter == _SPACE))
    keys = [str(i) for i in range(layout.width)]
    convert = pyarrow.csv.ConvertOptions(
        include_columns=[keys[i] for i in wanted], null_values=_ABSENT, decimal_point=layout.decimal
    )
    for threads in (True, False):
        try:
            table = pyarrow.csv.read_csv(
                pa.BufferReader(data),
                read_options=pyarrow.csv.ReadOptions(column_names=keys, use_threads=threads),
                parse_options=pyarrow.csv.ParseOptions(delimiter=layout.delimiter),
                convert_options=convert,
            )
            break
        except pa.ArrowInvalid as error:
            if threads:
                continue  # only a parse in one thread knows the number of the row
            stray = _stray_quote(data) if quoted else None
            raise _ragged(str(error), path) if stray is None else _unclosed(stray, path) from None
    # a quote that isn't closed swallows all rows up to the next one, without a word
    if quoted and table.num_rows != _count_rows(data) and (stray := _stray_quote(data)) is not None:
        raise _unclosed(stray, path)
    if any(pa.types.is_binary(kind) for kind in table.schema.types):
        raise InputError(f"{path}, which can't be read as text in UTF-8", "a table", "export it as CSV in UTF-8")
    return {i: table.column(keys[i]) for i in wanted}


def _has_comments_and_quotes(text: Text, start: int) -> tuple[bool, bool]:
    """Whether a line behind `start` is a comment, and whether a quote stands behind it.

    Piece by piece, since a search in bytes is faster than in a map.
    """
    noted = quoted = False
    for at in range(start, len(text), _PIECE):
        piece = text[at : at + _PIECE + 1]
        noted = noted or any(sign in piece and b"\n" + sign in piece for sign in (b"#", b"%"))
        quoted = quoted or b'"' in piece
    return noted, quoted


def _count_rows(data: pa.Buffer) -> int:
    """Lines that aren't empty."""
    rows, ended = 0, True
    for at in range(0, len(data), _PIECE):
        signs = np.frombuffer(data, dtype=np.uint8, count=min(_PIECE, len(data) - at), offset=at)
        ends = (signs == ord("\n")) | (signs == ord("\r"))
        rows += int(np.count_nonzero(~ends[1:] & ends[:-1])) + int(ended and not ends[0])
        ended = bool(ends[-1])
    return rows


def _stray_quote(data: pa.Buffer) -> int | None:
    """The first row, counted from 1, whose quotes don't come in pairs; None where all do."""
    rows = (line for line in data.to_pybytes().splitlines() if line)
    return next((i for i, line in enumerate(rows, 1) if line.count(b'"') % 2), None)


def _unclosed(row: int, path: Path) -> InputError:
    return InputError(
        f"a quote (\") in row {row} of {path} that isn't closed in it",
        "quotes in pairs",
        "take it out of that row, or close it",
    )


def _ragged(said: str, path: Path) -> InputError:
    found = re.search(r"(?:Row #(\d+): )?Expected (\d+) columns, got (\d+)", said)
    if "straddling" in said:
        return InputError(
            f"a row of more than 1 MB in {path}",
            "a row of numbers a sample",
            "look for a line end or a cell gone wrong",
        )
    if not found:
        return InputError(f"{path}, which can't be read as text ({said[:120]})", "a table", "export it as CSV in UTF-8")
    row = f"row {found[1]} of " if found[1] else "a row of "
    return InputError(
        f"{found[3]} cells in {row}{path}",
        f"{found[2]} cells in each row",
        "mend that row, or remove it if the file was cut off there",
    )


def _cleaned(data: bytes, noted: bool, spaced: bool) -> bytes:
    """The text without comments, and with single spaces between cells and none around a row."""
    if noted:
        data = re.sub(rb"(?m)^[#%].*\n?", b"", data)
    return _squeezed(data) if spaced else data


def _squeezed(data: bytes) -> bytes:
    """Cells with one space between them; piece by piece, so that the work stays in the processor's cache."""
    pieces, last = [], True
    for at in range(0, len(data), _PIECE):
        signs = np.frombuffer(data, dtype=np.uint8, count=min(_PIECE, len(data) - at), offset=at)
        blank = (signs == ord(" ")) | (signs == ord("\t"))
        ends = blank | (signs == ord("\n"))
        keep = ~blank
        keep[0] |= not last
        keep[1:] |= ~ends[:-1]  # the first of several blanks, but none at the start of a row
        pieces.append(np.where(blank, np.uint8(ord(" ")), signs)[keep].tobytes())
        last = bool(ends[-1])
    return b"".join(pieces).replace(b" \r\n", b"\n").replace(b" \n", b"\n").rstrip(b" ")
