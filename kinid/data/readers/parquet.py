"""Parquet, through Arrow: one group of columns at a time, so that memory holds little more than the log."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path

from kinid.data.log import Log
from kinid.data.readers._columns import Arrays, Table, to_log
from kinid.data.readers._guard import check_unpacked, readable
from kinid.data.rig import Rig

SUFFIXES: tuple[str, ...] = (".parquet", ".pq")


def read(path: Path, rig: Rig, joints: Sequence[str] | None = None) -> Log:
    """Read a Parquet file; a column of equally long lists is a group of columns (q, wrench, …)."""
    import pyarrow as pa

    log = _read(path, rig, joints)
    pa.default_memory_pool().release_unused()  # Arrow would keep what it took for the columns
    return log


def _read(path: Path, rig: Rig, joints: Sequence[str] | None) -> Log:
    import pyarrow.parquet

    from kinid.data.readers._arrow import is_block, to_numpy

    with readable(path, "Parquet"):
        # a mapped file would stay in memory, page by page, as it is read
        file = pyarrow.parquet.ParquetFile(path, memory_map=False)
        schema = file.schema_arrow
    check_unpacked(path, 8.0 * file.metadata.num_rows * len(schema.names))
    names = tuple(schema.names)

    def load(groups: Sequence[Sequence[int]]) -> Iterator[Arrays]:
        for group in groups:
            with readable(path, "Parquet"):
                # one by one, so that the memory for decoding is that of one column
                arrays = [to_numpy(file.read(columns=[names[i]], use_threads=False).column(names[i])) for i in group]
            yield arrays
            arrays.clear()  # whoever has read them still holds the list while the next is read

    blocks = frozenset(i for i, field in enumerate(schema) if is_block(field.type))
    with file:
        return to_log(Table(str(path), "Parquet", names, len(names), blocks, load), rig, joints)
