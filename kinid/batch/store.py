"""Where results lie, by fsspec: a folder here, or one at s3://, gs://, sftp:// … Each is whole or isn't there."""

from __future__ import annotations

import secrets
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from kinid.errors import InputError
from kinid.writers import Json

#: a file is there at once, or not at all: nothing is renamed there
WHOLE = ("s3", "s3a", "gs", "gcs", "az", "abfs", "memory")


@dataclass(frozen=True)
class Store:
    """A folder at an address.

    Attributes:
        address: a path, or as s3://bucket/folder.

    Raises:
        InputError: of all methods, whatever keeps them from their files.
    """

    address: str

    def write(self, name: str, data: bytes) -> None:
        """A file, in place of one that may be there."""
        with _as_input_error(f"no way to write {self.address}/{name}", "a place that can be written"):
            system, root = _system(self.address)
            path = f"{root}/{name}"
            if _protocol(system) in WHOLE:
                system.pipe_file(path, data)
                return
            folder, _, last = path.rpartition("/")
            temporary = f"{folder}/.{last}.{secrets.token_hex(4)}"
            system.makedirs(folder, exist_ok=True)
            try:
                system.pipe_file(temporary, data)
                system.mv(temporary, path)
            finally:
                if system.exists(temporary):
                    system.rm_file(temporary)

    def read(self, name: str) -> bytes:
        """What a file holds."""
        with _as_input_error(f"no way to read {self.address}/{name}", "a file that is there"):
            system, root = _system(self.address)
            out: bytes = system.cat_file(f"{root}/{name}")
            return out

    def found(self, name: str) -> bytes | None:
        """The same; None where there is no such file."""
        with _as_input_error(f"no way to read {self.address}/{name}", "a place that can be read"):
            system, root = _system(self.address)
            system.invalidate_cache()
            return self.read(name) if system.exists(f"{root}/{name}") else None

    def files(self, folder: str = "") -> dict[str, Json]:
        """Files in a folder and below, by their names in it: size [bytes] and what else is known; hidden ones aren't
        told.
        """
        with _as_input_error(f"no way to list {self.address}", "a folder"):
            system, root = _system(self.address)
            top = f"{root}/{folder}".rstrip("/")
            system.invalidate_cache()
            found = system.find(top, detail=True) if system.exists(top) else {}
        names = {path.removeprefix(top).lstrip("/"): facts for path, facts in found.items()}
        return {n: f for n, f in sorted(names.items()) if n and not any(part.startswith(".") for part in n.split("/"))}

    def remove(self, name: str) -> None:
        """A file that is there."""
        with _as_input_error(f"no way to remove {self.address}/{name}", "a place that can be written"):
            system, root = _system(self.address)
            system.rm_file(f"{root}/{name}")


def is_remote(address: str | Path) -> bool:
    """Whether an address is of another system of files, as s3://bucket/folder."""
    return "://" in address_of(address)


def address_of(path: str | Path) -> str:
    """An address as it was typed: a path has lost one of its slashes."""
    text = str(path)
    head, colon, tail = text.partition(":/")
    # a letter by itself is a drive
    return f"{head}://{tail.lstrip('/')}" if colon and len(head) > 1 and head.isalnum() else text


@contextmanager
def fetched(address: str) -> Iterator[Path]:
    """A file on a disk of this machine: the file itself, or a copy that is gone in the end.

    Raises:
        InputError: it can't be read.
    """
    if not is_remote(address):
        yield Path(address)
        return
    import tempfile

    with tempfile.TemporaryDirectory(prefix="kinid-") as folder:
        copy = Path(folder) / address.rsplit("/", 1)[-1]
        with _as_input_error(f"no way to read {address}", "a log there"):
            system, path = _system(address)
            system.get_file(path, str(copy))
        yield copy


def _system(address: str) -> tuple[Any, str]:
    """The system of files of an address, and the path in it."""
    if find_spec("fsspec") is None:
        raise InputError(
            f"{address} without fsspec", "the library that writes such folders", "pip install 'kinid[batch]'"
        )
    from fsspec.core import url_to_fs

    try:
        system, root = url_to_fs(address)
    except (ImportError, ValueError) as error:
        raise InputError(
            f"no way to {address} ({' '.join(str(error).split())[:120]})",
            "a path, or an address whose library is installed (s3fs, gcsfs, paramiko …)",
            "install it, or correct the address",
        ) from None
    return system, str(root).rstrip("/")


def _protocol(system: Any) -> str:
    name = system.protocol
    return str(name if isinstance(name, str) else name[0])


@contextmanager
def _as_input_error(found: str, expected: str) -> Iterator[None]:
    """What a system of files raises, as one line."""
    try:
        yield
    except InputError:
        raise
    except Exception as error:  # each library of remote files has errors of its own, most of them plain ones
        why = " ".join(str(error).split())[:160]
        raise InputError(
            f"{found} ({type(error).__name__}: {why})", expected, "correct the address or its rights, and start again"
        ) from error
