"""The logs of a batch: where each is, what it was measured with, and what of a store is its own."""

from __future__ import annotations

import dataclasses
import hashlib
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from kinid.batch.store import Store, address_of, fetched, is_remote
from kinid.campaign.files import (
    NO_LOGS,
    SUFFIXES,
    NoLogs,
    Source,
    is_campaign,
    names_of,
    refuse_copies,
    sources,
)
from kinid.data.log import Log, Provenance
from kinid.data.rig import Rig
from kinid.errors import InputError
from kinid.robotics.reading import read

if TYPE_CHECKING:
    from kinid.campaign.campaign import Campaign
    from kinid.identification.pooling.logs import Elsewhere


@dataclass(frozen=True)
class Item:
    """One log.

    Attributes:
        name: that results call it by. address: of its file. rig: what it was measured with. columns: that logs are
            grouped by. key: names its files in a store; another one where the log has changed.
    """

    name: str
    address: str
    rig: Rig
    columns: dict[str, str]
    key: str

    def part(self, kind: str, suffix: str = "parquet") -> str:
        """Name of a file of its own in a store: 256 folders, so that none holds too many."""
        return f"{kind}/shard={self.key[-2:]}/{self.key}.{suffix}"

    def __call__(self) -> tuple[Log, Rig]:
        """The log, read from wherever it is; nothing but it is in memory."""
        with fetched(self.address) as path:
            log = read(path, self.rig)
        if is_remote(self.address):  # and not the copy, which has another name each time
            log = dataclasses.replace(log, provenance=Provenance(self.address, log.provenance.steps))
        return log, self.rig


def is_many(paths: Sequence[str | Path]) -> bool:
    """Whether paths and addresses name many logs, or a place that may hold them."""
    return any(map(is_remote, paths)) or is_campaign([Path(path) for path in paths])


def items_of(paths: Sequence[str | Path], rig: str | Path | None = None) -> tuple[list[Item], dict[str, str]]:
    """The logs that files, folders, campaigns and addresses name, in order; and how parameters are shared.

    Args:
        paths: as of `campaign.files.sources`, and addresses of logs and of folders. rig: of all that have no other.

    Raises:
        InputError: nothing there, or a rig that is none.
    """
    far = [address_of(path) for path in paths if is_remote(path)]
    near = [Path(path) for path in paths if not is_remote(path)]
    given = None if rig is None else address_of(rig)
    found, sharing = sources(near) if near else ([], {})
    listed = [*map(_near, found), *(one for address in far for one in _far(address))]
    names = names_of([Path(source.path) for _, source, _ in listed])
    rigs: dict[str, Rig] = {}
    out = []
    for name, (address, source, facts) in zip(names, listed):
        file = str(source.rig) if source.rig is not None else given or f"{address.rpartition('/')[0] or '.'}/rig.toml"
        if file not in rigs:
            rigs[file] = rig_of(file, needed=source.rig is not None or given is not None)
        out.append(
            Item(name, address, rigs[file], dict(source.columns), _key(name, (*facts, rigs[file].model_dump_json())))
        )
    return out, sharing


def campaign_of(items: Sequence[Item], sharing: dict[str, str], elsewhere: Elsewhere | None = None) -> Campaign:
    """The same logs as a campaign, whose visits are worked out elsewhere where that is given.

    Raises:
        InputError: a log that is there twice; of those far away, one address.
    """
    from kinid.campaign.campaign import Campaign, Member

    refuse_copies([Path(item.address) for item in items if not is_remote(item.address)])
    return Campaign.of([Member.of(item.name, item.columns, item.rig, item) for item in items], sharing, elsewhere)


def _near(source: Source) -> tuple[str, Source, tuple[Any, ...]]:
    found = source.path.stat()
    return str(source.path), source, (found.st_size, found.st_mtime_ns)


def addresses(address: str) -> list[str]:
    """Logs at an address: itself, or those of a folder and below.

    Raises:
        InputError: none.
    """
    return [one for one, _, _ in _far(address_of(address))]


def _far(address: str) -> list[tuple[str, Source, tuple[Any, ...]]]:
    """Logs at an address: itself, or those of a folder and below."""
    suffixes = tuple(SUFFIXES)
    if address.lower().endswith(suffixes):
        folder, _, wanted = address.rpartition("/")
    else:
        folder, wanted = address.rstrip("/"), ""
    out = []
    for name, facts in Store(folder).files().items():
        hidden = any(part in NO_LOGS for part in name.split("/"))
        if name == wanted or (not wanted and name.lower().endswith(suffixes) and not hidden):
            stamp = facts.get("ETag") or facts.get("md5Hash") or facts.get("mtime") or facts.get("created")
            out.append((f"{folder}/{name}", Source(Path(f"{folder}/{name}")), (facts.get("size"), str(stamp))))
    if not out:
        raise NoLogs(f"no logs at {address}", f"files ending in {', '.join(SUFFIXES)}", "correct the address")
    return out


def rig_of(file: str, needed: bool) -> Rig:
    """A rig from its file; an empty one where there is none: a log may say everything itself."""
    if not is_remote(file):
        return Rig.load(file) if needed or Path(file).is_file() else Rig()
    folder, _, name = file.rpartition("/")
    if not needed and name not in Store(folder).files():
        return Rig()
    rig = Rig.parse_text(Store(folder).read(name).decode("utf-8", "replace"), where=file)
    named = rig.robot is not None and rig.robot.model.lower().endswith(".urdf")
    if named or (rig.surface is not None and rig.surface.mesh is not None):
        raise InputError(
            f"{file}, which names a URDF or a mesh",
            "a rig by itself",
            "put both where all workers see them, and name that rig with --rig",
        )
    return rig


def _key(name: str, facts: tuple[Any, ...]) -> str:
    """A file's name for a log: readable, and another one for another log or another state of it."""
    plain = "".join(c if c.isalnum() or c in "-_" else "-" for c in name.rsplit("/", 1)[-1])[:60]
    own, state = (hashlib.sha256(text.encode()).hexdigest() for text in (name, repr(facts)))
    return f"{plain}-{state[:8]}-{own[:12]}"
