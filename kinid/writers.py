"""Results on disk: written to a temporary file beside the target, then renamed, so that nothing is ever half there."""

from __future__ import annotations

import json
import math
import os
import secrets
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from kinid.errors import InputError, check_name

#: an object of JSON that is read again, by key
Json = dict[str, Any]
#: values of a table, one a row
Column = NDArray[np.generic]
#: how a table may be written, by the ending of its name
TABLE_SUFFIXES = (".parquet", ".csv", ".npz")


def finite(value: float) -> float | None:
    """A number for JSON, which has no infinity: None where there is none."""
    return value if math.isfinite(value) else None


@contextmanager
def replacing(path: Path) -> Iterator[Path]:
    """A temporary name to write to, which takes the place of `path` when the block ends well and vanishes otherwise.

    Raises:
        InputError: the folder is not there or can't be written to.
    """
    if path.is_dir():
        raise InputError(f"a folder at {path}", "a file name to write to", "add a file name to -o")
    temporary = path.with_name(f".{path.stem}.{secrets.token_hex(4)}{path.suffix}")
    try:
        yield temporary
        os.replace(temporary, path)
    except OSError as error:
        said = (error.strerror or str(error)).replace(str(temporary), str(path))
        raise InputError(
            f"no way to write {path} ({said})",
            "a folder that exists and can be written",
            "choose another -o/--out",
        ) from None
    finally:
        with suppress(OSError):  # a file system that can only be read says so of what isn't there, too
            temporary.unlink(missing_ok=True)


def lock(handle: int, found: str, expected: str, mend: str) -> None:
    """Lock an open file or folder against other processes that ask, for as long as it is open.

    The lock is the kernel's (flock): it ends with the process that holds it. File systems without such locks keep
    nobody apart.

    Raises:
        InputError: another process holds it; the parts of its message are given.
    """
    try:
        import fcntl

        fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        raise InputError(found, expected, mend) from None
    except (ImportError, OSError):
        pass


@contextmanager
def alone_with(path: Path) -> Iterator[None]:
    """Keep other processes that ask from a file that is read, added to and replaced, until the block ends.

    The file is a new one each time it is written, so that what is locked stands beside it, as `.NAME.lock`. A process
    that is killed leaves that behind, unlocked: it keeps nobody out.

    Raises:
        InputError: another process is at work on the file, or its folder can't be written to.
    """
    real = Path(_real(path))
    beside = real.with_name(f".{real.name}.lock")
    try:
        handle = os.open(beside, os.O_RDWR | os.O_CREAT, 0o666)
    except OSError as error:
        raise InputError(
            f"no way to write {path} ({error.strerror})", "a folder that can be written", "choose another -o/--out"
        ) from None
    busy = f"another process at work on {path}", "a file to itself", "wait until it is done, or write to another file"
    try:
        lock(handle, *busy)
        # whoever held it before may have removed it since it was opened: a lock on what is gone keeps nobody out
        if not (beside.exists() and os.path.samestat(os.fstat(handle), beside.stat())):
            raise InputError(*busy)
        try:
            yield
        finally:
            beside.unlink(missing_ok=True)
    finally:
        os.close(handle)


def _real(path: Path) -> str:
    """Where a name leads; `Path.resolve` fails on a ring of links."""
    return os.path.realpath(path)


def check_table_name(path: Path) -> None:
    """Refuse a table's name early, before any work is done.

    Raises:
        InputError: an ending that no table has, a name that is no UTF-8, or a folder that isn't there.
    """
    if path.suffix.lower() not in TABLE_SUFFIXES:
        raise InputError(f"output '{path.name}'", f"a name ending in {', '.join(TABLE_SUFFIXES)}", "rename it")
    check_name(path)
    check_folder(path)


def check_folder(path: Path) -> None:
    """Refuse a file whose folder isn't there, or that is a folder itself."""
    if path.is_dir():
        raise InputError(f"a folder at {path}", "a file name to write to", "add a file name")
    if not path.absolute().parent.is_dir():
        raise InputError(f"no folder {path.absolute().parent}", "an existing folder for the output", "make it first")


#: files that people write, and that results never replace
SOURCES = (".toml", ".py", ".urdf", ".xacro")


def check_outputs(outputs: Sequence[Path | None], inputs: Sequence[Path | None]) -> None:
    """Refuse outputs that can't be written, that are one file, or that would replace what is read.

    Raises:
        InputError: which, and why.
    """
    read = {_real(path) for path in inputs if path is not None}
    seen: set[str] = set()
    for path in (path for path in outputs if path is not None):
        if path == Path("-"):
            raise InputError("an output named -", "a file: the tables go to the screen", "name one, as found.json")
        check_folder(path)
        if path.exists() and not path.is_file():
            raise InputError(
                f"output {path}, which is no regular file", "a file that can be replaced", "name another one"
            )
        if _real(path) in read:
            raise InputError(
                f"output {path}, which is read too", "another file than the log and the rig", "rename the output"
            )
        if path.suffix.lower() in SOURCES and path.exists():
            raise InputError(
                f"output {path}, which is no result of kinid and would be lost",
                "a name that is free, or a result's",
                "rename the output",
            )
        if _real(path) in seen:
            raise InputError(f"{path} named for two outputs", "a file for each", "rename one")
        seen.add(_real(path))


def write_table(path: Path, columns: Mapping[str, Column], provenance: Mapping[str, object] | None = None) -> None:
    """Write columns of equal length as Parquet, CSV or NPZ, by the ending of the name.

    Parquet keeps the provenance as JSON under the key `kinid` of its schema's metadata.
    """
    check_table_name(path)
    suffix = path.suffix.lower()
    with replacing(path) as temporary:
        if suffix == ".npz":
            with temporary.open("wb") as file:  # given a name, it would add ".npz" to one that ends in ".NPZ"
                np.savez(file, **{name: np.asarray(values) for name, values in columns.items()})  # type: ignore[arg-type]
            return
        import pyarrow as pa

        table = pa.table({name: pa.array(np.asarray(values)) for name, values in columns.items()})
        if suffix == ".csv":
            from pyarrow import csv

            csv.write_csv(table, temporary)
            return
        from pyarrow import parquet

        if provenance is not None:
            table = table.replace_schema_metadata({"kinid": json.dumps(provenance, default=str)})
        # measured doubles hardly repeat: dictionaries and statistics cost time and save nothing
        dictionaries = [name for name, values in columns.items() if np.asarray(values).dtype.kind in "US"]
        parquet.write_table(table, temporary, compression="snappy", use_dictionary=dictionaries, write_statistics=False)


def write_text(path: Path, text: str) -> None:
    """Write a text file whole or not at all; names in it that are no UTF-8 stand there as escapes, as JSON has them."""
    write_bytes(path, text.encode("utf-8", "backslashreplace"))


def write_bytes(path: Path, data: bytes) -> None:
    """Write a file whole or not at all."""
    check_folder(path)
    with replacing(path) as temporary:
        temporary.write_bytes(data)


def write_json(path: Path, facts: object) -> None:
    """Write facts as JSON; the file is whole or isn't there."""
    write_text(path, json_text(facts, indent=2) + "\n")


def json_text(facts: object, *, indent: int | None = None) -> str:
    """Facts as any reader of JSON takes them: NumPy's values as numbers, null where a number is not finite."""
    return json.dumps(_plain(facts), indent=indent, ensure_ascii=False, allow_nan=False)


def _plain(value: object) -> object:
    """NumPy's and other values as JSON knows them."""
    if isinstance(value, np.ndarray | np.generic):
        value = value.tolist()
    if isinstance(value, float):
        return finite(value)
    if isinstance(value, Mapping):
        return {key: _plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(item) for item in value]
    return value if value is None or isinstance(value, str | int) else str(value)


@contextmanager
def made_folder(path: Path) -> Iterator[None]:
    """Make a folder for results, with its parents; those of them that are new and still empty go where the block fails.

    Raises:
        InputError: it can't be made.
    """
    new = [each for each in (path, *path.parents) if not each.exists()]
    try:
        make_folder(path)
        yield
    except BaseException:
        for each in new:
            with suppress(OSError):
                each.rmdir()
        raise


def make_folder(path: Path) -> None:
    """Make a folder for results, with its parents.

    Raises:
        InputError: it can't be made.
    """
    try:
        path.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(
            f"no way to make the folder {path} ({error.strerror})",
            "a folder for the results",
            "choose another -o/--out",
        ) from None
