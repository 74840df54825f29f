"""Results are whole or not there, on whatever system of files."""

from __future__ import annotations

from pathlib import Path

import pytest

from kinid.batch.store import Store, address_of, fetched, is_remote
from kinid.errors import InputError


@pytest.fixture(params=["local", "memory", "s3"])
def store(request: pytest.FixtureRequest, tmp_path: Path) -> Store:
    if request.param == "s3":
        return Store(request.getfixturevalue("bucket") + "/out")
    return Store(str(tmp_path / "out") if request.param == "local" else f"memory://{tmp_path.name}")


def test_what_is_written_is_read(store: Store) -> None:
    assert store.files() == {}
    assert store.found("manifest.json") is None
    store.write("a/shard=0/x.parquet", b"one")
    store.write("a/shard=0/x.parquet", b"other")
    store.write("manifest.json", b'{"job": 1}')
    store.write("a/.hidden", b"")
    assert list(store.files()) == ["a/shard=0/x.parquet", "manifest.json"]
    assert list(store.files("a")) == ["shard=0/x.parquet"]
    assert store.files("a")["shard=0/x.parquet"]["size"] == 5
    assert store.read("a/shard=0/x.parquet") == b"other"
    assert store.found("manifest.json") == b'{"job": 1}'
    with fetched(f"{store.address}/manifest.json") as path:
        assert path.read_bytes() == b'{"job": 1}'
    assert path.exists() != is_remote(store.address)
    store.remove("manifest.json")
    assert list(store.files()) == ["a/shard=0/x.parquet"]


def test_a_write_that_fails_leaves_what_was_there(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from fsspec.implementations.local import LocalFileSystem

    store = Store(str(tmp_path))
    store.write("x", b"before")

    def full(*_: object, **__: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(LocalFileSystem, "mv", full)
    with pytest.raises(InputError, match="No space left"):
        store.write("x", b"after")
    assert [p.name for p in tmp_path.iterdir()] == ["x"]
    assert store.read("x") == b"before"


def test_addresses_survive_being_paths() -> None:
    assert address_of(Path("s3://lab/tuesday")) == "s3://lab/tuesday"
    assert not any(map(is_remote, ("logs/a:b.csv", "C:/logs", "/logs", "a.csv")))


@pytest.mark.parametrize("address", ["nosuch://x", "s3://no-such-bucket/x"])
def test_what_keeps_it_from_its_files_is_one_line(bucket: str, address: str) -> None:
    with pytest.raises(InputError, match="expected") as refused:
        Store(address).write("x", b"")
    assert "\n" not in str(refused.value)
