"""MATLAB files up to version 7 (`save -v7`); a struct's fields are named `struct.field`."""

from __future__ import annotations

import warnings
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

import numpy as np

from kinid.data.log import Log
from kinid.data.readers._cells import Column
from kinid.data.readers._columns import Arrays, Table, to_log
from kinid.data.readers._guard import readable
from kinid.data.rig import Rig
from kinid.errors import InputError

SUFFIXES: tuple[str, ...] = (".mat",)
_HDF5 = b"\x89HDF\r\n\x1a\n"


def read(path: Path, rig: Rig, joints: Sequence[str] | None = None) -> Log:
    """Read a .mat file; vectors may lie or stand, a matrix with one row a sample is a group of columns."""
    with readable(path, "a MATLAB file"), path.open("rb") as file:
        head = file.read(520)
    if _HDF5 in head:  # behind MATLAB's own text of 512 bytes, or at the start
        raise InputError(
            f"a MATLAB file of version 7.3 in {path}",
            "version 7 or older",
            "in MATLAB: save('log.mat', '-v7'), or writetable to a CSV",
        )
    from scipy.io import loadmat

    with readable(path, "a MATLAB file"), warnings.catch_warnings():
        warnings.simplefilter("ignore")
        content = loadmat(path, struct_as_record=True)
    arrays = dict(_vectors({k: v for k, v in _flat(content) if not k.startswith("__")}))
    names = tuple(arrays)

    def load(groups: Sequence[Sequence[int]]) -> Iterator[Arrays]:
        for group in groups:
            yield [arrays[names[i]] for i in group]

    blocks = frozenset(i for i, name in enumerate(names) if arrays[name].ndim == 2)
    return to_log(Table(str(path), "MATLAB", names, len(names), blocks, load), rig, joints)


def _flat(content: Mapping[str, object], prefix: str = "") -> Iterator[tuple[str, Column]]:
    """Arrays by name, those inside of 1×1 structs by `struct.field`."""
    for name, value in content.items():
        if isinstance(value, np.ndarray) and value.dtype.names and value.size == 1:
            yield from _flat({field: value.flat[0][field] for field in value.dtype.names}, f"{prefix}{name}.")
        elif isinstance(value, np.ndarray) and value.dtype.names is None:
            yield prefix + name, value


def _vectors(arrays: dict[str, Column]) -> Iterator[tuple[str, Column]]:
    """MATLAB has no 1-D arrays: (1, n) and (n, 1) become (n,), n the longest dimension; cells become text."""
    longest = max((max(a.shape, default=0) for a in arrays.values()), default=0)
    for name, value in arrays.items():
        array = value
        if array.dtype == object:
            if not all(isinstance(cell, np.ndarray) and cell.dtype.kind == "U" for cell in array.flat):
                continue
            texts = [str(cell.flat[0]) if cell.size else "" for cell in array.flat]
            array = np.array(texts, dtype=np.str_).reshape(array.shape)
        if array.dtype.kind == "U":  # a matrix of characters pads its rows
            array = np.char.strip(array.astype(np.str_))
        yield name, array.ravel() if sorted(array.shape) == sorted((1, longest)) else array
