"""Results on disk: whole or not at all."""

from __future__ import annotations

import csv
import json
import os
import signal
import stat
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from kinid.errors import InputError
from kinid.writers import alone_with, check_outputs, check_table_name, replacing, write_json, write_table, write_text

COLUMNS: dict[str, Any] = {
    "t": np.array([0.0, 0.1, 0.2]),
    "depth": np.array([1e-300, np.nan, 1 / 3]),
    "in_contact": np.array([True, False, True]),
    "phase": np.array(["free", "approach", 'ä,"b\n']),
}


def left(folder: Path) -> list[str]:
    return sorted(os.listdir(folder))


def test_parquet_keeps_every_bit_and_the_provenance(tmp_path: Path) -> None:
    path = tmp_path / "out.parquet"
    write_table(path, COLUMNS, {"source": "log.csv", "steps": [{"name": "wrench", "bias": [1.0, np.float64(2.0)]}]})
    table = pq.read_table(path)
    assert table.column_names == list(COLUMNS)
    for name, values in COLUMNS.items():
        np.testing.assert_array_equal(table.column(name).to_numpy(), values)
    assert table.schema.field("in_contact").type == "bool"
    kept = json.loads(table.schema.metadata[b"kinid"])
    assert kept["source"] == "log.csv"
    assert kept["steps"][0]["bias"] == [1.0, 2.0]
    assert left(tmp_path) == ["out.parquet"]


def test_csv_keeps_every_bit(tmp_path: Path) -> None:
    path = tmp_path / "out.csv"
    write_table(path, COLUMNS)
    with path.open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    np.testing.assert_array_equal([float(row["depth"]) for row in rows], COLUMNS["depth"])
    assert [row["phase"] for row in rows] == list(COLUMNS["phase"])
    assert [row["in_contact"] for row in rows] == ["true", "false", "true"]


def test_json_is_what_every_reader_takes(tmp_path: Path) -> None:
    """Strict readers know no NaN: what is no number is null, wherever it stands."""
    facts = {"a": np.array([[1.0, np.nan]]), "b": (np.float32(0.5), -np.inf), "c": {"n": np.int64(3), "p": tmp_path}}
    write_json(tmp_path / "out.json", facts | {"yes": np.True_, "none": None, "name": "ä"})
    read = json.loads((tmp_path / "out.json").read_text(encoding="utf-8"), parse_constant=pytest.fail)
    assert read == {
        "a": [[1.0, None]],
        "b": [0.5, None],
        "c": {"n": 3, "p": str(tmp_path)},
        "yes": True,
        "none": None,
        "name": "ä",
    }


@pytest.mark.parametrize("name", ["out.npz", "OUT.NPZ"])
def test_npz_needs_no_pickle(tmp_path: Path, name: str) -> None:
    path = tmp_path / name
    write_table(path, COLUMNS)
    with np.load(path, allow_pickle=False) as data:
        for column, values in COLUMNS.items():
            np.testing.assert_array_equal(data[column], values)
    assert left(tmp_path) == [name]


@pytest.mark.parametrize("name", ["out.parquet", "out.csv", "out.npz", "OUT.CSV", "OUT.Parquet"])
def test_a_column_may_be_a_read_only_view(tmp_path: Path, name: str) -> None:
    values = np.arange(20.0).reshape(10, 2)[:, 1]
    values.setflags(write=False)
    write_table(tmp_path / name, {"t": np.arange(10.0), "x": values})
    assert left(tmp_path) == [name]


def half_written(path: Path, error: BaseException) -> None:
    """A writer that fails in the middle."""
    with replacing(path) as temporary:
        temporary.write_bytes(b"half")
        raise error


@pytest.mark.parametrize("name", ["out.parquet", "out.csv"])
def test_a_failing_table_leaves_the_old_file_and_nothing_else(tmp_path: Path, name: str) -> None:
    path = tmp_path / name
    path.write_bytes(b"old")
    with pytest.raises(pa.ArrowInvalid):
        write_table(path, {"t": np.arange(3.0), "x": np.arange(4.0)})
    assert path.read_bytes() == b"old"
    assert left(tmp_path) == [name]


@pytest.mark.parametrize("error", [RuntimeError, KeyboardInterrupt, MemoryError, SystemExit])
def test_an_interruption_leaves_the_old_file_and_nothing_else(tmp_path: Path, error: type[BaseException]) -> None:
    path = tmp_path / "out.txt"
    with pytest.raises(error):
        half_written(path, error())
    assert left(tmp_path) == []
    path.write_bytes(b"old")
    with pytest.raises(error):
        half_written(path, error())
    assert path.read_bytes() == b"old"
    assert left(tmp_path) == ["out.txt"]


def test_a_full_disk_is_said(tmp_path: Path) -> None:
    path = tmp_path / "out.txt"
    path.write_bytes(b"old")
    with pytest.raises(InputError, match=r"no way to write .*No space left") as caught:
        half_written(path, OSError(28, "No space left on device"))
    assert "-o/--out" in str(caught.value)
    assert path.read_bytes() == b"old"
    assert left(tmp_path) == ["out.txt"]


def test_nobody_sees_a_half_written_file(tmp_path: Path) -> None:
    """Until the block ends the old content stands under the name, and whoever has it open reads it to its end."""
    path = tmp_path / "out.txt"
    path.write_text("old", encoding="utf-8")
    with path.open(encoding="utf-8") as reader:
        with replacing(path) as temporary:
            temporary.write_text("new", encoding="utf-8")
            assert path.read_text(encoding="utf-8") == "old"
            assert temporary.parent == path.parent
            assert temporary.suffix == path.suffix
        assert path.read_text(encoding="utf-8") == "new"
        assert reader.read() == "old"


@pytest.mark.parametrize("name", ["out.xlsx", "out", "out.parquet.gz", "parquet"])
def test_an_unknown_ending_is_refused(tmp_path: Path, name: str) -> None:
    with pytest.raises(InputError, match=r"a name ending in \.parquet, \.csv, \.npz"):
        write_table(tmp_path / name, COLUMNS)
    assert left(tmp_path) == []


def test_a_folder_that_is_not_there_is_refused(tmp_path: Path) -> None:
    for write in (lambda p: write_table(p, COLUMNS), lambda p: write_text(p, "x"), check_table_name):
        with pytest.raises(InputError, match=r"no folder .*make it first"):
            write(tmp_path / "missing" / "out.csv")
    assert left(tmp_path) == []


def test_a_folder_in_place_of_the_file_is_refused(tmp_path: Path) -> None:
    (tmp_path / "out.csv").mkdir()
    with pytest.raises(InputError, match="a folder at"):
        write_table(tmp_path / "out.csv", COLUMNS)
    assert left(tmp_path) == ["out.csv"]


def test_a_file_in_place_of_the_folder_is_refused(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("", encoding="utf-8")
    with pytest.raises(InputError, match="no folder"):
        write_text(tmp_path / "file" / "out.txt", "x")


@pytest.mark.skipif(os.name != "posix" or os.geteuid() == 0, reason="needs a user whom permissions stop")
def test_a_folder_without_permission_is_said(tmp_path: Path) -> None:
    tmp_path.chmod(stat.S_IRUSR | stat.S_IXUSR)
    with pytest.raises(InputError, match="can be written"):
        write_text(tmp_path / "out.txt", "x")
    tmp_path.chmod(stat.S_IRWXU)


def test_text_is_utf_8_and_replaces(tmp_path: Path) -> None:
    path = tmp_path / "out.html"
    write_text(path, "µ → ä")
    write_text(path, "N·m")
    assert path.read_bytes() == "N·m".encode()
    assert left(tmp_path) == ["out.html"]


def test_no_output_goes_down_a_pipe() -> None:
    with pytest.raises(InputError, match="named -"):
        check_outputs((Path("-"),), ())


#: takes a file and keeps it
HOLDER = """
import sys, time
from pathlib import Path
from kinid.writers import alone_with
with alone_with(Path(sys.argv[1])):
    print("held", flush=True)
    time.sleep(60)
"""


def test_a_file_that_is_added_to_is_of_one_process(tmp_path: Path) -> None:
    """The second one is refused under any name of the file, other files of the folder are free; a kill frees it."""
    path, link = tmp_path / "map.parquet", tmp_path / "link.parquet"
    link.symlink_to(path)
    process = subprocess.Popen([sys.executable, "-c", HOLDER, str(path)], stdout=subprocess.PIPE)
    assert process.stdout is not None
    assert process.stdout.readline() == b"held\n"
    for name in (path, link):
        with pytest.raises(InputError, match="another process at work on"), alone_with(name):
            pass
    with alone_with(tmp_path / "other.parquet"):
        pass
    process.send_signal(signal.SIGKILL)
    process.wait()
    process.stdout.close()
    with alone_with(path):
        assert left(tmp_path) == [".map.parquet.lock", "link.parquet"]
    assert left(tmp_path) == ["link.parquet"]


def test_a_library_that_names_the_temporary_file_is_said_to_mean_the_output(tmp_path: Path) -> None:
    out = tmp_path / "out.parquet"
    with pytest.raises(InputError) as refused, replacing(out) as temporary:
        raise OSError(f"Failed to open local file '{temporary}'")
    assert f"Failed to open local file '{out}'" in refused.value.found
    assert temporary.name not in str(refused.value)
