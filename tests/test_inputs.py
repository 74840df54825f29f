"""Limits of size: stated, raised by the environment, and asked before anything is unpacked."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet
import pytest

import kinid
from kinid.errors import InputError
from kinid.inputs import FACTOR, read_text, size_limit
from kinid.planning.touches import grid


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
