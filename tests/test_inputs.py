"""Limits of size: stated, raised by the environment, and asked before anything is unpacked."""

from __future__ import annotations

import os
import re
import socket
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet
import pytest

import kinid
from kinid.data.guess import columns_of
from kinid.errors import InputError
from kinid.inputs import FACTOR, MOST_BYTES, MOST_LEVELS, parse_toml, read_text, size_limit
from kinid.live.sources import Asked, open_source
from kinid.mapping.map_file import is_map
from kinid.mapping.probes import logs_in
from kinid.mapping.property_map import PropertyMap
from kinid.planning.touches import grid
from kinid.planning.trajectory import read_trajectory


def test_a_message_names_the_factor_that_would_do(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "rig.toml"
    path.write_text("# " + "x" * 5_000_000, encoding="utf-8")
    with pytest.raises(InputError, match=r"5 MB, 2 MB at most") as caught:
        read_text(path, "rig", "a rig.toml", "name another")
    factor = re.search(rf"{FACTOR}=(\d+)", str(caught.value))
    assert factor
    monkeypatch.setenv(FACTOR, factor[1])
    assert len(read_text(path, "rig", "a rig.toml", "name another")) == 5_000_002


@pytest.mark.parametrize("text", ["", "much", "0", "-1", "nan", "inf"])
def test_a_factor_that_is_none_is_refused(text: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(FACTOR, text)
    with pytest.raises(InputError, match=FACTOR):
        size_limit(1.0)


def test_a_plan_may_be_larger_where_that_is_asked_for(monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(InputError, match=f"{FACTOR}=2"):
        grid(200, 200, 0.01)
    monkeypatch.setenv(FACTOR, "2")
    assert len(grid(200, 200, 0.01)) == 40_000


@pytest.mark.parametrize("suffix", [".npz", ".parquet"])
def test_a_small_file_that_holds_too_much_is_not_unpacked(
    suffix: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Zeros are packed well; under a limit that they pass the file is refused, and under a larger one it is read."""
    path, n = tmp_path / f"a{suffix}", 2_000_000
    names = ("t", "q1")
    if suffix == ".npz":
        np.savez_compressed(path, **{name: np.zeros(n) for name in names})  # type: ignore[arg-type]
    else:
        pyarrow.parquet.write_table(pa.table({name: np.zeros(n) for name in names}), path)
    monkeypatch.setenv(FACTOR, "0.001")
    with pytest.raises(InputError, match=rf"0\.032 GB of columns.*{FACTOR}"):
        kinid.read(path, kinid.Rig())
    monkeypatch.delenv(FACTOR)
    with pytest.raises(InputError, match="time that repeats"):
        kinid.read(path, kinid.Rig())


DEEP = 20_000
#: levels of TOML, in all the ways in which they can be written
DEEP_TOML = {
    "dotted key": ".".join(["a"] * DEEP) + " = 1",
    "spaced key": " . ".join(["a"] * DEEP) + " = 1",
    "quoted key": ".".join(['"\\"."'] * DEEP) + " = 1",
    "literal key": ".".join(["'='"] * DEEP) + " = 1",
    "table": "[" + ".".join(["a"] * DEEP) + "]",
    "array of tables": "[[" + ".".join(["a"] * DEEP) + "]]",
    "inline tables": "a = " + "{a.b = " * 40 + "1" + "}" * 40,
    "lists": "a = " + "[" * DEEP,
}


@pytest.mark.parametrize("text", DEEP_TOML.values(), ids=DEEP_TOML)
def test_what_is_nested_too_deeply_is_refused_before_it_takes_memory(text: str) -> None:
    began = time.process_time()
    with pytest.raises(InputError, match=f"nested more than {MOST_LEVELS} levels deep"):
        parse_toml(text, "rig.toml", "the tables of a rig")
    assert time.process_time() - began < 2.0


@pytest.mark.parametrize("unit", ["a", '"', "'", "a ", "a.", '"a".', "1.5, ", "-"])
def test_keys_are_looked_at_in_time_with_their_length(unit: str) -> None:
    """A text as long as one may be, of which no part is a key that is too deep, or the first one is."""
    began = time.process_time()
    with pytest.raises(InputError):
        parse_toml("x = # " + unit * (MOST_BYTES // len(unit)), "rig.toml", "the tables of a rig")
    assert time.process_time() - began < 2.0


def test_as_many_levels_as_there_may_be_are_read() -> None:
    assert parse_toml(".".join(["a"] * (MOST_LEVELS - 1)) + " = 1", "rig.toml", "a rig")


def test_a_mark_at_the_start_of_a_text_is_no_part_of_it(tmp_path: Path) -> None:
    """Editors of Windows write one."""
    path = tmp_path / "rig.toml"
    path.write_text('[robot]\nmodel = "lwr4plus"\n', encoding="utf-8-sig")
    assert kinid.Rig.load(path).robot is not None


def _pipe(path: Path) -> None:
    os.mkfifo(path)


def _socket(path: Path) -> None:
    with socket.socket(socket.AF_UNIX) as one:
        one.bind(str(path))


def _device(path: Path) -> None:
    path.symlink_to("/dev/zero")


READ: dict[str, Callable[[Path], object]] = {
    **{f"log{suffix}": kinid.read for suffix in (".csv", ".csv.gz", ".npz", ".mat", ".mcap", ".bag", ".parquet")},
    "rig.toml": kinid.Rig.load,
    "fit.json": kinid.Fit.load,
    "map.parquet": PropertyMap.read,
    "plan.npz": read_trajectory,
    "columns.csv": columns_of,
    "of-a-map.csv": lambda path: logs_in([path]),
    "ring": lambda path: open_source(f"shm:{path}", Asked(None, ("joint_1",), 1.0)),
}


@pytest.mark.parametrize("name", READ)
@pytest.mark.parametrize(("make", "said"), [(_pipe, "a pipe"), (_socket, "a socket"), (_device, "a device")])
def test_what_is_no_file_is_refused_and_not_waited_for(
    make: Callable[[Path], None], said: str, name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)  # the name of a socket has to be short
    make(Path(name))
    with pytest.raises(InputError, match=rf"{name} \({said}, no regular file\)"):
        READ[name](Path(name))
    assert not is_map(Path(name))
