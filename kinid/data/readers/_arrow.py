"""Arrow columns as NumPy arrays."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from kinid.data.readers._cells import Column
from kinid.data.readers._guard import check_unpacked
from kinid.errors import InputError

if TYPE_CHECKING:
    import pyarrow as pa


def is_block(kind: pa.DataType) -> bool:
    """Whether a column of this Arrow type holds a list in each row."""
    from pyarrow import types

    return bool(types.is_list(kind) or types.is_large_list(kind) or types.is_fixed_size_list(kind))


def is_text(kind: pa.DataType) -> bool:
    """Whether a column of this Arrow type holds words, each of its own or out of a list."""
    from pyarrow import types

    return bool(types.is_string(kind) or types.is_large_string(kind) or types.is_dictionary(kind))


def to_numpy(column: pa.ChunkedArray, name: str, path: Path) -> Column:
    """Values of a chunked Arrow column: (n,), or (n, k) for lists of one length.

    Absent numbers are NaN, absent text is empty. Numbers in one chunk, none of them absent, are not copied.

    Args:
        column: its values. name: what it is called. path: of the file that it stands in.

    Raises:
        InputError: lists of differing lengths, text that is too long, or a type that is no number, text, time stamp or
            list of numbers.
    """
    import pyarrow as pa
    from pyarrow import types

    kind = column.type
    if is_block(kind):
        flat, n = column.combine_chunks(), len(column)
        lengths = np.asarray(flat.value_lengths().fill_null(-1))
        width = int(lengths[0]) if n else 0
        if (lengths != width).any() or width < 0:
            raise _unread(f"column '{name}' of lists of differing lengths", path)
        return to_numpy(pa.chunked_array([flat.flatten()]), name, path).reshape(n, width)
    if is_text(kind):
        return _words(column, path)
    if types.is_null(kind):
        return np.full(len(column), np.nan)
    if types.is_decimal(kind) or types.is_boolean(kind) or types.is_float16(kind):
        column = column.cast(pa.float64())
    elif not (types.is_integer(kind) or types.is_floating(kind) or types.is_timestamp(kind)):
        raise _unread(f"column '{name}' of type {str(kind)[:60]}", path)
    return np.asarray(column.to_numpy())


def _words(column: pa.ChunkedArray, path: Path) -> NDArray[np.str_]:
    """Text, (n,). A long word that many rows share is small in a file, and as large in each row of an array."""
    import pyarrow as pa
    from pyarrow import types

    coded = column if types.is_dictionary(column.type) else column.dictionary_encode()
    coded = coded.unify_dictionaries().combine_chunks()
    coded = coded.combine_chunks() if isinstance(coded, pa.ChunkedArray) else coded
    words = [(word or "").strip() for word in coded.dictionary.cast(pa.string()).to_pylist()]
    check_unpacked(path, float(np.dtype("U1").itemsize) * max(map(len, words), default=0) * max(len(coded), len(words)))
    rows = coded.indices.fill_null(len(words)).to_numpy(zero_copy_only=False)
    texts: NDArray[np.str_] = np.asarray([*words, ""], dtype=np.str_)[rows]
    return texts


def _unread(found: str, path: Path) -> InputError:
    expected = "numbers, text, time stamps, or lists of numbers of one length"
    return InputError(f"{found} in {path}", expected, "leave that column out, or convert it")
