"""Parquet, through Arrow: one group of columns at a time, so that memory holds little more than the log."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from kinid.data.log import Log
from kinid.data.readers._columns import Arrays, Table, to_log
from kinid.data.readers._guard import check_unpacked, readable
from kinid.data.rig import Rig

if TYPE_CHECKING:
    import pyarrow as pa

SUFFIXES: tuple[str, ...] = (".parquet", ".pq")


def read(path: Path, rig: Rig, joints: Sequence[str] | None = None) -> Log:
    """Read a Parquet file; a column of equally long lists is a group of columns (q, wrench, …)."""
    import pyarrow as pa

    log = _read(path, rig, joints)
    pa.default_memory_pool().release_unused()  # Arrow would keep what it took for the columns
    return log


def _read(path: Path, rig: Rig, joints: Sequence[str] | None) -> Log:
    import pyarrow.parquet

    from kinid.data.readers._arrow import is_block, is_text, to_numpy

    with readable(path, "Parquet"):
        # a mapped file would stay in memory, page by page, as it is read
        file = pyarrow.parquet.ParquetFile(path, memory_map=False)
        schema, facts = file.schema_arrow, file.metadata
        stored = sum(facts.row_group(i).total_byte_size for i in range(facts.num_row_groups))
    check_unpacked(path, max(8.0 * facts.num_rows * len(schema.names), stored))
    with readable(path, "Parquet"):
        # words stay a list of what there is and a number a row: many rows may share a long one
        if words := [field.name for field in schema if is_text(field.type)]:
            file.close()
            file = pyarrow.parquet.ParquetFile(path, metadata=facts, memory_map=False, read_dictionary=words)
    names = tuple(schema.names)

    def column(name: str) -> pa.ChunkedArray:
        return file.read(columns=[name], use_threads=False).column(name)

    def load(groups: Sequence[Sequence[int]]) -> Iterator[Arrays]:
        for group in groups:
            with readable(path, "Parquet"):
                # one by one, so that the memory for decoding is that of one column
                arrays = [to_numpy(column(names[i]), names[i], path) for i in group]
            yield arrays
            arrays.clear()  # whoever has read them still holds the list while the next is read

    blocks = frozenset(i for i, field in enumerate(schema) if is_block(field.type))
    with file:
        return to_log(Table(str(path), "Parquet", names, len(names), blocks, load), rig, joints)
