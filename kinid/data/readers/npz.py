"""NumPy archives of 1-D and 2-D arrays; nothing is unpickled."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.lib.npyio import NpzFile

from kinid.data.log import Log
from kinid.data.readers._columns import Arrays, Table, to_log
from kinid.data.readers._guard import check_unpacked, readable
from kinid.data.rig import Rig

SUFFIXES: tuple[str, ...] = (".npz",)


def read(path: Path, rig: Rig, joints: Sequence[str] | None = None) -> Log:
    """Read an .npz file; a 2-D array is a group of columns (q, wrench, …)."""
    with path.open("rb") as file:
        with readable(path, "NPZ"):
            if file.read(2) != b"PK":  # NumPy would take it for a pickle, and say so
                raise ValueError("no archive of arrays")
            file.seek(0)
            archive = np.load(file, allow_pickle=False)
        names = tuple(archive.files)
        with readable(path, "NPZ"):
            headers = [_header(archive, name) for name in names]
        check_unpacked(path, sum(math.prod(shape) * kind.itemsize for shape, kind in headers))
        blocks = frozenset(i for i, (shape, _) in enumerate(headers) if len(shape) == 2)

        def load(groups: Sequence[Sequence[int]]) -> Iterator[Arrays]:
            for group in groups:
                with readable(path, "NPZ", "save plain arrays of numbers or text, or copy it again"):
                    arrays = [archive[names[i]] for i in group]
                yield arrays

        return to_log(Table(str(path), "NPZ", names, len(names), blocks, load), rig, joints)


def _header(archive: NpzFile, name: str) -> tuple[tuple[int, ...], np.dtype[Any]]:
    """Shape and type of an array from its header alone."""
    assert archive.zip is not None
    member = name if name in archive.zip.namelist() else f"{name}.npy"
    with archive.zip.open(member) as file:
        version = np.lib.format.read_magic(file)
        formats = np.lib.format
        header = formats.read_array_header_1_0 if version == (1, 0) else formats.read_array_header_2_0
        shape, _, kind = header(file)
        return shape, kind
