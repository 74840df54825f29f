"""Every format gives the same log, and every kind of bad file one clear line."""

from __future__ import annotations

import os
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.csv
import pyarrow.parquet
import pytest
import scipy.io
from numpy.typing import NDArray

from kinid.data.readers import formats, read
from kinid.data.rig import WRENCH, Rig
from kinid.errors import InputError, MissingDependencyError
from kinid.writers import write_table

N, JOINTS = 250, 7
EMPTY = Rig()


def truth() -> dict[str, NDArray[Any]]:
    """What is written: doubles with all their digits, an absent value, three phases."""
    rng = np.random.default_rng(20)
    data: dict[str, NDArray[Any]] = {"t": 100.0 + np.cumsum(rng.uniform(0.5e-3, 1.5e-3, N))}
    data |= {name: rng.normal(size=(N, JOINTS)) for name in ("q", "dq", "ddq", "tau", "q_cmd")}
    data |= {"wrench": 100 * rng.normal(size=(N, 6)), "depth": 1e-3 * rng.normal(size=N)}
    data["phase"] = np.repeat(["free", "hold", "Rückzug"], [100, 100, 50])
    data["q"][17, 3] = np.nan
    data["wrench"][30, 0] = np.inf
    return data


def columns(data: dict[str, NDArray[Any]]) -> dict[str, NDArray[Any]]:
    """One array a column."""
    out = {}
    for name, values in data.items():
        if values.ndim == 1:
            out[name] = values
        else:
            names = WRENCH if name == "wrench" else [f"{name}{i + 1}" for i in range(values.shape[1])]
            out |= dict(zip(names, values.T))
    return out


def write_text(path: Path, delimiter: str, header: str) -> None:
    table = columns(truth())
    rows = zip(*(c.tolist() for c in table.values()))
    lines = [delimiter.join(str(cell) for cell in row) for row in rows]
    names = delimiter.join(table)
    path.write_text("\n".join([header + names, *lines]) + "\n", encoding="utf-8")


def write_parquet_lists(path: Path) -> None:
    data = truth()
    table = {name: list(v) if v.ndim == 2 else v for name, v in data.items()}
    pa.parquet.write_table(pa.table(table), path, row_group_size=64)


WRITERS: dict[str, tuple[str, Callable[[Path], Any]]] = {
    "parquet": ("a.parquet", lambda p: pa.parquet.write_table(pa.table(columns(truth())), p)),
    "parquet in row groups": (
        "a.pq",
        lambda p: pa.parquet.write_table(pa.table(columns(truth())), p, row_group_size=32),
    ),
    "parquet with lists": ("b.parquet", write_parquet_lists),
    "npz with columns": ("a.npz", lambda p: np.savez(p, **columns(truth()))),  # type: ignore[arg-type]
    "npz with blocks": ("b.npz", lambda p: np.savez_compressed(p, **truth())),  # type: ignore[arg-type]
    "mat": ("a.mat", lambda p: scipy.io.savemat(p, truth())),
    "mat, vectors standing": ("b.mat", lambda p: scipy.io.savemat(p, truth(), oned_as="column", do_compression=True)),
    "csv by arrow": ("a.csv", lambda p: pa.csv.write_csv(pa.table(columns(truth())), p)),
    "csv": ("b.csv", lambda p: write_text(p, ",", "")),
    "csv, semicolons": ("c.csv", lambda p: write_text(p, ";", "")),
    "csv, comma and space": ("d.csv", lambda p: write_text(p, ", ", "")),
    "tsv": ("a.tsv", lambda p: write_text(p, "\t", "")),
    "text, white space": ("a.txt", lambda p: write_text(p, "   ", "")),
    "text, header in a comment": ("a.dat", lambda p: write_text(p, " ", "# ")),
}
#: formats that bring a writer of their own for these tests
OWN = {suffix: module for suffix, module in formats().items() if hasattr(module, "write_example")}
WRITERS |= {
    f"{suffix}, as it writes itself": (
        f"own{suffix}",
        lambda p, write=module.write_example: write(p, columns(truth())),
    )
    for suffix, module in OWN.items()
}


@pytest.mark.parametrize("how", WRITERS)
def test_a_log_comes_back_to_the_last_digit(how: str, tmp_path: Path) -> None:
    name, write = WRITERS[how]
    write(tmp_path / name)
    log, data = read(tmp_path / name), truth()
    np.testing.assert_array_equal(log.t, data["t"])
    for field in ("q", "dq", "ddq", "tau", "q_cmd", "wrench"):
        got = getattr(log, field)
        np.testing.assert_array_equal(got, data[field])
        assert got.flags.c_contiguous
        assert not got.flags.writeable
    np.testing.assert_array_equal(log.contact["depth"], data["depth"])
    assert log.phase is not None
    np.testing.assert_array_equal(log.phase, data["phase"])


@pytest.mark.parametrize("how", WRITERS)
def test_absent_and_infinite_values_are_marked_and_counted(how: str, tmp_path: Path) -> None:
    name, write = WRITERS[how]
    write(tmp_path / name)
    log = read(tmp_path / name)
    np.testing.assert_array_equal(np.flatnonzero(~log.valid), [17, 30])
    (step,) = log.provenance.steps
    assert (step.name, step.facts["rows"], step.facts["invalid_rows"]) == ("read", N, 2)
    assert step.facts["columns"]["t"] == ["t"]
    assert log.provenance.source == str(tmp_path / name)


def test_the_folder_of_modules_is_the_list_of_formats() -> None:
    known = formats()
    assert {".parquet", ".csv", ".txt", ".npz", ".mat", ".bag", ".db3", ".mcap"} <= set(known)
    for module in known.values():
        assert callable(module.read)


def test_the_rig_beside_the_log_is_used(tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text("zeit,q1\n0,90\n1,180\n")
    with pytest.raises(InputError, match=r"no time in .* with columns 'zeit', 'q1'"):
        read(tmp_path / "a.csv")
    (tmp_path / "rig.toml").write_text('[columns]\nt = { column = "zeit" }\nq = { unit = "deg" }\n')
    assert read(tmp_path / "a.csv").q == pytest.approx(np.array([[np.pi / 2], [np.pi]]))
    with pytest.raises(InputError, match="no time"):
        read(tmp_path / "a.csv", EMPTY)


# --------------------------------------------------------------------------------------------------- bad files


def one_line(error: pytest.ExceptionInfo[InputError], path: Path) -> str:
    """The message: what was found, expected, to mend, and the file, in one line."""
    said = str(error.value)
    assert "\n" not in said
    assert str(path) in said
    assert error.value.expected
    assert error.value.mend
    return said


def test_what_is_no_log_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no file") as error:
        read(tmp_path / "absent.csv")
    one_line(error, tmp_path / "absent.csv")
    (tmp_path / "a.xlsx").write_text("x")
    with pytest.raises(InputError, match=r"suffix '.xlsx'.*\.bag \.csv .*\.parquet") as error:
        read(tmp_path / "a.xlsx")
    one_line(error, tmp_path / "a.xlsx")
    (tmp_path / "log").write_text("x")
    with pytest.raises(InputError, match="no suffix"):
        read(tmp_path / "log")
    with pytest.raises(InputError, match=r"without metadata.yaml"):
        read(tmp_path)


@pytest.mark.parametrize("suffix", sorted(formats()))
def test_an_empty_file_is_refused(suffix: str, tmp_path: Path) -> None:
    path = tmp_path / f"a{suffix}"
    path.touch()
    with pytest.raises(InputError, match="empty file") as error:
        read(path)
    one_line(error, path)


@pytest.mark.parametrize("suffix", [".parquet", ".npz", ".mat", ".bag", ".db3", ".mcap", *OWN])
def test_garbage_is_refused(suffix: str, tmp_path: Path) -> None:
    pytest.importorskip("rosbags")
    pytest.importorskip("mcap")
    path = tmp_path / f"a{suffix}"
    path.write_bytes(np.random.default_rng(3).bytes(2000))
    with pytest.raises(InputError, match="can't be read as") as error:
        read(path)
    one_line(error, path)


@pytest.mark.parametrize("how", ["parquet", "npz with columns", "npz with blocks", "mat", "mat, vectors standing"])
@pytest.mark.parametrize("share", [0.02, 0.3, 0.7, 0.99, 0.9999])
def test_a_file_that_was_cut_off_is_refused(how: str, share: float, tmp_path: Path) -> None:
    name, write = WRITERS[how]
    path = tmp_path / name
    write(path)
    whole = path.read_bytes()
    path.write_bytes(whole[: int(share * len(whole))])
    with pytest.raises(InputError) as error:
        read(path)
    one_line(error, path)


@pytest.mark.parametrize("how", ["parquet", "npz with blocks", "mat", "csv"])
def test_damaged_bytes_never_end_in_a_traceback(how: str, tmp_path: Path) -> None:
    name, write = WRITERS[how]
    path = tmp_path / name
    write(path)
    whole, rng = path.read_bytes(), np.random.default_rng(4)
    refused = 0
    for _ in range(60):
        damaged = bytearray(whole)
        for place in rng.integers(0, len(whole), 8):
            damaged[place] = rng.integers(0, 256)
        path.write_bytes(damaged)
        try:
            read(path)
        except InputError:
            refused += 1
    assert refused > 0


@pytest.mark.parametrize("how", ["csv", "parquet", "npz with columns", "mat"])
@pytest.mark.parametrize(
    ("change", "found"),
    [
        (lambda d: d.pop("t"), "no time in"),
        (lambda d: d.pop("q3"), "q1, q2, q4, q5, q6, q7 in"),
        (lambda d: d.pop("tau7"), "6 columns of tau beside 7 of q"),
        (lambda d: d.pop("tx"), "fx fy fz ty tz without tx"),
        (lambda d: d["t"].__setitem__(5, d["t"][4]), "time that repeats in row 6"),
        (lambda d: d["t"].__setitem__(5, d["t"][3]), "time that runs backwards in row 6|time that repeats"),
        (lambda d: d["t"].__setitem__(5, np.nan), "time that is not a number in row 6"),
        (lambda d: [d.pop(k) for k in list(d) if k not in ("t", "phase")], "no quantity beside the time"),
    ],
)
def test_bad_tables_are_refused(how: str, change: Callable[[Any], Any], found: str, tmp_path: Path) -> None:
    data = columns(truth())
    change(data)
    path = tmp_path / WRITERS[how][0]
    if how == "mat":
        scipy.io.savemat(path, data)
    elif how == "npz with columns":
        np.savez(path, **data)  # type: ignore[arg-type]
    else:
        table = pa.table(data)
        pa.csv.write_csv(table, path) if how == "csv" else pa.parquet.write_table(table, path)
    with pytest.raises(InputError, match=found) as error:
        read(path)
    one_line(error, path)


def test_tables_without_rows_are_refused(tmp_path: Path) -> None:
    nothing = {name: values[:0] for name, values in columns(truth()).items()}
    pa.parquet.write_table(pa.table(nothing), tmp_path / "a.parquet")
    np.savez(tmp_path / "a.npz", **nothing)  # type: ignore[arg-type]
    (tmp_path / "a.csv").write_text(",".join(nothing) + "\n")
    (tmp_path / "b.csv").write_text("\n# nothing\n\n")
    for name in ("a.parquet", "a.npz", "a.csv", "b.csv"):
        with pytest.raises(InputError, match=r"no samples|no row") as error:
            read(tmp_path / name)
        one_line(error, tmp_path / name)


def test_nothing_is_unpickled(tmp_path: Path) -> None:
    class Bomb:
        def __reduce__(self) -> tuple[Any, ...]:
            return pytest.fail, ("unpickled",)

    np.savez(tmp_path / "a.npz", t=np.arange(3.0), q1=np.array([Bomb(), 1, 2], dtype=object), allow_pickle=True)
    with pytest.raises(InputError, match="Object arrays"):
        read(tmp_path / "a.npz")
    np.save(tmp_path / "b.npy", np.arange(3.0))
    (tmp_path / "b.npy").rename(tmp_path / "b.npz")
    with pytest.raises(InputError, match="no archive"):
        read(tmp_path / "b.npz")


def test_matlab_7_3_is_refused_with_the_remedy(tmp_path: Path) -> None:
    path = tmp_path / "a.mat"
    path.write_bytes(b"MATLAB 7.3 MAT-file, Platform: GLNXA64".ljust(512) + b"\x89HDF\r\n\x1a\n" + bytes(100))
    with pytest.raises(InputError, match=r"version 7.3.*-v7"):
        read(path)


def test_matlab_structs_and_cells(tmp_path: Path) -> None:
    inner = {"t": np.arange(3.0), "q1": np.ones(3)}
    phase = np.array(["free", "hold", "hold"], dtype=object)
    scipy.io.savemat(tmp_path / "a.mat", {"log": inner, "phase": phase, "note": "text"})
    names = {"t": {"column": "log.t"}, "q1": {"column": "log.q1"}}
    log = read(tmp_path / "a.mat", Rig.parse({"columns": names}))
    np.testing.assert_array_equal(log.t, [0, 1, 2])
    assert log.phase is not None
    assert log.phase.tolist() == ["free", "hold", "hold"]


def test_parquet_types(tmp_path: Path) -> None:
    stamps = 1708857503929545123 + np.array([0, 1_000_000, 2_000_001])
    table = pa.table(
        {
            "t": pa.array(stamps, pa.timestamp("ns")),
            "q1": pa.array([1, None, 3], pa.int32()),
            "q2": pa.array([1, 2, 3], pa.float32()),
            "tau1": pa.array([True, False, None]),
            "tau2": pa.nulls(3),
            "phase": pa.array(["a", None, "b"]).dictionary_encode(),
            "other": pa.array([{"x": 1}, {"x": 2}, None]),
        }
    )
    pa.parquet.write_table(table, tmp_path / "a.parquet")
    log = read(tmp_path / "a.parquet")
    assert log.t.tolist() == [0.0, 0.001, 0.002000001]
    assert log.provenance.steps[0].facts["time_origin"] == pytest.approx(1708857503.929545)
    np.testing.assert_array_equal(log.q, [[1, 1], [np.nan, 2], [3, 3]])
    np.testing.assert_array_equal(log.tau, [[1, np.nan], [0, np.nan], [np.nan, np.nan]])
    assert log.phase is not None
    assert log.phase.tolist() == ["a", "", "b"]
    with pytest.raises(InputError, match=r"column 'other' of type struct.*leave that column out"):
        read(tmp_path / "a.parquet", Rig.parse({"columns": {"depth": {"column": "other"}}}))
    ragged = pa.table({"t": [0.0, 1.0], "q": [[1.0, 2.0], [1.0]]})
    pa.parquet.write_table(ragged, tmp_path / "b.parquet")
    with pytest.raises(InputError, match="column 'q' of lists of differing lengths"):
        read(tmp_path / "b.parquet")


def test_a_name_that_is_no_utf8_is_said(tmp_path: Path) -> None:
    path = tmp_path / os.fsdecode(b"o\xff.parquet")
    with pytest.raises(InputError, match=r"the name .*o\\udcff\.parquet, which is no UTF-8.*rename"):
        write_table(path, {"t": np.arange(3.0)})
    path.write_bytes(b"something")
    with pytest.raises(InputError, match=r"the name .*rename"):
        read(path)


def test_a_long_word_that_many_rows_share_takes_no_memory(tmp_path: Path) -> None:
    """In an array it would be as long in each of them: 80 GB here."""
    n, word = 20_000, "a" * 1_000_000
    for name, words in (("long", [word]), ("short", ["approach", "hold"])):
        phase = pa.DictionaryArray.from_arrays(np.arange(n, dtype=np.int32) % len(words), pa.array(words, pa.string()))
        table = pa.table({"t": np.arange(n) * 1e-3, "q1": np.zeros(n), "phase": phase})
        pa.parquet.write_table(table, tmp_path / f"{name}.parquet")
    with pytest.raises(InputError, match=r"80 GB of columns in .*long\.parquet"):
        read(tmp_path / "long.parquet")
    log = read(tmp_path / "short.parquet")
    assert log.phase is not None
    assert log.phase.tolist() == ["approach", "hold"] * (n // 2)


@pytest.mark.parametrize(("suffix", "library"), [(".bag", "rosbags"), (".db3", "rosbags"), (".mcap", "mcap")])
def test_a_missing_library_is_named(suffix: str, library: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for name in [name for name in sys.modules if name.split(".")[0] == library]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, library, None)
    path = tmp_path / f"a{suffix}"
    path.write_bytes(b"x")
    with pytest.raises(MissingDependencyError, match=rf"no {library}.*kinid\[bags\]"):
        read(path)
