"""Arrow columns as NumPy arrays."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from kinid.data.readers._cells import Column

if TYPE_CHECKING:
    import pyarrow as pa


def is_block(kind: pa.DataType) -> bool:
    """Whether a column of this Arrow type holds a list in each row."""
    from pyarrow import types

    return bool(types.is_list(kind) or types.is_large_list(kind) or types.is_fixed_size_list(kind))


def to_numpy(column: pa.ChunkedArray) -> Column:
    """Values of a chunked Arrow column: (n,), or (n, k) for lists of one length.

    Absent numbers are NaN, absent text is empty. Numbers in one chunk, none of them absent, are not copied.

    Raises:
        ValueError: lists of differing lengths, or a type that is no number, text, time stamp or list of
            numbers.
    """
    import pyarrow as pa
    from pyarrow import types

    kind = column.type
    if is_block(kind):
        flat, n = column.combine_chunks(), len(column)
        lengths = np.asarray(flat.value_lengths().fill_null(-1))
        width = int(lengths[0]) if n else 0
        if (lengths != width).any() or width < 0:
            raise ValueError("lists of differing lengths")
        return to_numpy(pa.chunked_array([flat.flatten()])).reshape(n, width)
    if types.is_string(kind) or types.is_large_string(kind) or types.is_dictionary(kind):
        plain = column.cast(pa.string()) if types.is_dictionary(kind) else column
        coded = plain.fill_null("").combine_chunks().dictionary_encode()
        coded = coded.combine_chunks() if isinstance(coded, pa.ChunkedArray) else coded
        words = np.asarray([*(word.strip() for word in coded.dictionary.to_pylist()), ""], dtype=np.str_)
        texts: NDArray[np.str_] = words[coded.indices.to_numpy(zero_copy_only=False)]
        return texts
    if types.is_null(kind):
        return np.full(len(column), np.nan)
    if types.is_decimal(kind) or types.is_boolean(kind) or types.is_float16(kind):
        column = column.cast(pa.float64())
    elif not (types.is_integer(kind) or types.is_floating(kind) or types.is_timestamp(kind)):
        raise ValueError(f"a column of type {kind}")
    return np.asarray(column.to_numpy())
