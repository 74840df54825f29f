"""One table of what kinid reads: how a sound input looks, how it is changed, and what is done with it."""

from __future__ import annotations

import gzip
import json
import tomllib
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from random import Random
from typing import Any, NamedTuple

from fuzz import sound, uses
from fuzz.changes import change_bytes, change_columns, change_text, change_tree, change_words
from kinid.planning.trajectory import read_trajectory


class Input(NamedTuple):
    """A sound input, and ways to change it, one of which is taken by lot."""

    sound: Callable[[], bytes]
    ways: tuple[Callable[[Random], bytes], ...]


@dataclass(frozen=True)
class Case:
    """A kind of input.

    Attributes:
        file: its name. input: what is in it. use: what is done with it; a `KinidError` is a refusal.
        share: of all inputs, beside the others'. words: a command that reads FILE, where one does.
    """

    file: str
    input: Input
    use: Callable[[Path], object]
    share: int = 2
    words: str = ""

    def changed(self, rng: Random) -> bytes:
        """The input, changed by lot."""
        return rng.choice(self.input.ways)(rng)


def raw(make: Callable[[], bytes]) -> Input:
    """Bytes that only bytes are changed of."""
    return Input(make, (lambda rng: change_bytes(rng, make()),))


def text(make: Callable[[], bytes]) -> Input:
    """A text whose bytes, words or lines are changed."""
    words = (lambda rng: change_text(rng, make().decode()).encode("utf-8", "replace"),)
    return Input(make, raw(make).ways + 2 * words)


def table(make: Callable[[], dict[str, Any]], write: Callable[[dict[str, Any]], bytes]) -> Input:
    """A table whose bytes or columns are changed."""
    columns = (lambda rng: write(change_columns(rng, make())),)
    return Input(lambda: write(make()), raw(lambda: write(make())).ways + 2 * columns)


def tree(make: Callable[[], Any], write: Callable[[Any], bytes] = lambda it: json.dumps(it).encode()) -> Input:
    """Lists and tables within each other, whose values or whose text are changed."""
    values = (lambda rng: write(change_tree(rng, make())),)
    return Input(lambda: write(make()), text(lambda: write(make())).ways + 4 * values)


def command(line: str) -> Input:
    """A command line, as JSON, whose words are changed. A page is not served: that takes until somebody stops it."""

    def words(rng: Random) -> bytes:
        while True:
            out = change_words(rng, line.split())
            if out[0] != "view" or "--record" in out:
                return json.dumps(out).encode()

    return Input(lambda: json.dumps(line.split()).encode(), (words,))


CONTACT, VIEW = "contact FILE --rig rig.toml -o out.parquet", "view FILE --record out.html --no-open"
RIG = tree(lambda: tomllib.loads(sound.RIG), sound.toml)
PACKED = raw(lambda: gzip.compress(sound.csv(sound.joints())))
UNPACKED = tuple(lambda rng, way=way: gzip.compress(way(rng)) for way in table(sound.joints, sound.csv).ways)
FACTS = tree(lambda: sound.mapped()[1])
MAP_FACTS = tuple(lambda rng, way=way: sound.parquet(sound.mapped()[0], way(rng)) for way in FACTS.ways)
CASES = {
    "rig": Case("rig.toml", RIG, uses.rig, 6, "contact log.csv --rig FILE -o out.parquet"),
    "csv": Case("a.csv", table(sound.joints, sound.csv), uses.log, 4, CONTACT),
    "csv.gz": Case("a.csv.gz", Input(PACKED.sound, PACKED.ways + UNPACKED), uses.log, 2, CONTACT),
    "npz": Case("a.npz", table(sound.joints, sound.npz), uses.log, 4, CONTACT),
    "parquet": Case("a.parquet", table(sound.joints, sound.parquet), uses.log, 4, CONTACT),
    "mat": Case("a.mat", table(sound.joints, sound.mat), uses.log, 4, CONTACT),
    "mcap": Case("a.mcap", raw(sound.mcap), uses.log, 3, CONTACT),
    "bag": Case("a.bag", raw(lambda: sound.bag(1)), uses.messages, 3, CONTACT),
    "db3": Case("a.db3", raw(lambda: sound.bag(2)), uses.messages, 3, CONTACT),
    "urdf": Case("a.urdf", text(sound.urdf), uses.urdf, 6),
    "mesh": Case("a.stl", text(sound.stl), uses.mesh, 3),
    "tester": Case("a.csv", table(sound.tester, sound.csv), uses.tester, 5, "fit FILE --model kelvin-voigt"),
    "diagnosis": Case("a.csv", table(sound.tester, sound.csv), uses.diagnosis, 1, "diagnose FILE --model hooke"),
    "fit": Case("fit.json", tree(sound.fitted), uses.fit, 6),
    "campaign": Case("campaign.toml", tree(lambda: sound.CAMPAIGN, sound.toml), uses.campaign, 3),
    "manifest": Case("truth/campaign.json", tree(sound.manifest), uses.manifest, 3),
    "map": Case("map.parquet", table(lambda: sound.mapped()[0], sound.map_file), uses.map_, 2, VIEW),
    "map's facts": Case("map.parquet", Input(lambda: sound.map_file(sound.mapped()[0]), MAP_FACTS), uses.map_, 2, VIEW),
    "plan": Case("plan.parquet", table(sound.planned, sound.parquet), read_trajectory, 3),
    "plan.npz": Case("plan.npz", table(sound.planned, sound.npz), read_trajectory, 2),
    "plan.csv": Case("plan.csv", table(sound.planned, sound.csv), read_trajectory, 2),
    "png": Case("a.png", raw(lambda: sound.picture("PNG")), uses.picture),
    "jpeg": Case("a.jpg", raw(lambda: sound.picture("JPEG")), uses.picture),
    "lines": Case("lines", text(lambda: sound.LINE), uses.lines, 3),
    "lines' values": Case("lines", tree(lambda: json.loads(sound.LINE)), uses.lines, 3),
    "request": Case("request", text(lambda: sound.request(uses.server().port)), uses.request, 4),
} | {line: Case("words.json", command(line), uses.command, 1) for line in sound.COMMANDS}
