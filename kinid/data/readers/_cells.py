"""Cells of a table as numbers, times and words."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from kinid.data.log import Array
from kinid.data.rig import ColumnSpec
from kinid.errors import InputError

#: a column of a table, numbers, text or times
Column = NDArray[np.generic]

_ABSENT = ("", "nan", "-nan")
#: no clock in seconds shows this before the year 5000: it counts in another unit
_NOT_SECONDS = 1e11


def numbers(array: Column, source: str, label: str) -> Array:
    """A column as float64; empty cells and `nan` are NaN.

    Raises:
        InputError: a cell that is no number, with its row.
    """
    if array.dtype.kind in "fiu":  # true and false are no readings
        return np.asarray(array, dtype=np.float64)
    if array.dtype.kind not in "US":
        raise InputError(f"column '{label}' of type {array.dtype} in {source}", "numbers", "export it as numbers")
    text = np.char.strip(np.char.lower(array.astype(np.str_)))
    text = np.where(np.isin(text, _ABSENT), "nan", text)
    try:
        return text.astype(np.float64)
    except ValueError:
        row = next(i for i, cell in enumerate(text.ravel()) if not _is_number(cell)) // max(1, text[0].size)
        shown = str(array[row]) if array.ndim == 1 else ", ".join(map(str, array[row]))
        raise InputError(
            f"'{shown[:40]}' in row {row + 1}, column '{label}' of {source}",
            "a number",
            "correct that cell, or empty it if the value is absent",
        ) from None


def _is_number(cell: str) -> bool:
    try:
        float(cell)
    except ValueError:
        return False
    return True


def words(array: Column) -> NDArray[np.str_]:
    """A column as text."""
    if array.dtype.kind == "S":
        return np.char.decode(array.astype(np.bytes_), "utf-8", "replace")
    if array.dtype.kind == "f" and np.isnan(array).all():
        return np.full(len(array), "", dtype=np.str_)
    return array.astype(np.str_)


def seconds(array: Column, spec: ColumnSpec, source: str, label: str) -> tuple[Array, float | None]:
    """Time [s], (n,), and the origin [s] that was subtracted, if one was.

    Whole µs or ns of an absolute clock have more digits than a float64 of seconds: they are counted from the
    first sample before they become one.

    Raises:
        InputError: an array that is not 1-D, cells that are no numbers, or numbers too large for seconds.
    """
    if array.ndim != 1:
        raise InputError(f"time '{label}' of shape {array.shape} in {source}", "shape (n,)", "give one time a row")
    since: Array
    scale = spec.to_si
    if array.dtype.kind == "M":
        absent = np.isnat(array)
        array, scale = array.astype("datetime64[ns]").astype(np.int64), 1e-9
        origin = int(array[0]) if len(array) else 0
        since = np.where(absent, np.nan, (array - origin).astype(np.float64) * scale)
        return since + spec.offset, origin * scale
    if spec.unit is None and spec.scale == 1.0 and array.dtype.kind in "iuf" and len(array):
        largest = float(np.nanmax(np.abs(array.astype(np.float64)), initial=0.0))
        if _NOT_SECONDS < largest < float("inf"):
            raise InputError(
                f"time '{label}' up to {largest:.3g} in {source}",
                "seconds",
                'name its unit, such as [columns] t = { unit = "us" }',
            )
    if array.dtype.kind in "iu" and scale < 0.9e-3 and len(array):
        first = int(array[0])
        since = (array.astype(np.int64) - first).astype(np.float64) * scale
        return since + spec.offset, first * scale
    t = numbers(array, source, label)
    return t * scale + spec.offset if scale != 1.0 or spec.offset != 0.0 else t, None
