"""Many pokes, one file each: stopped at any moment, even by a power cut, a campaign goes on where it was.

A poke is done when its log is there: the log is written last, under another name first, and renamed whole. What each poke
does follows from the seed and its number alone, so that a campaign that was stopped ends with the same bytes as one that
wasn't.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from kinid.errors import InputError
from kinid.lab.arm import Gains
from kinid.lab.experiments import prepare
from kinid.lab.hidden import hide
from kinid.lab.protocol import Poke, five_phases
from kinid.lab.setup import Setup
from kinid.lab.writing import write_experiment
from kinid.writers import make_folder, write_text

Array = NDArray[np.float64]

MANIFEST = "campaign.json"
#: a poke of a campaign is shorter than the study's: three turns of the slow sine
POKE = Poke(0.003, ((0.0015, 0.9), (0.0005, 5.0)), duration=3.0)


@dataclass(frozen=True)
class Campaign:
    """A grid of pokes.

    Attributes:
        rows, columns: of places, along both tangents. spacing: between them [m].
        material, seed, hidden, gains: as for one experiment.
    """

    rows: int = 10
    columns: int = 10
    spacing: float = 0.01
    material: str = "mould"
    seed: int = 0
    hidden: str | None = None
    stiffness: float = 5200.0

    def __post_init__(self) -> None:
        if self.rows < 1 or self.columns < 1 or self.rows * self.columns > 100_000:
            raise InputError(f"a campaign of {self.rows} × {self.columns} pokes", "1 to 100 000 places", "correct it")
        if not (np.isfinite(self.spacing) and self.spacing > 0):
            raise InputError(f"a spacing of {self.spacing} m", "a positive length", "correct it")

    @property
    def count(self) -> int:
        """Number of pokes."""
        return self.rows * self.columns

    def place(self, index: int) -> tuple[float, float]:
        """Of a poke, along both tangents [m]; the grid is centred on the surface's point."""
        i, j = divmod(index, self.columns)
        return ((i - (self.rows - 1) / 2) * self.spacing, (j - (self.columns - 1) / 2) * self.spacing)

    def name(self, index: int) -> str:
        """Of a poke's files."""
        return f"poke_{index:04d}"

    def manifest(self) -> dict[str, Any]:
        """What the campaign is: it must be the same when it goes on."""
        return {"kind": "campaign", "version": 1, **vars(self)}

    def setup(self, index: int) -> tuple[Setup, dict[str, Any]]:
        """Of one poke, and what is hidden in it."""
        base = prepare("poke", material=self.material, seed=self.seed, gains=Gains(translation=self.stiffness))
        truth: dict[str, Any] = {}
        if self.hidden is not None:
            base, truth["hidden"] = hide(base, self.hidden, self.seed)
        script = five_phases(POKE, place=self.place(index), height=0.008, free=0.4, hold=0.4, approach=0.8, tilt=0.1)
        # the seed and the number: the same poke always, and another noise for each
        seed = int(np.random.SeedSequence([self.seed, 3, index]).generate_state(1)[0])
        return base.replace(script=script, seed=seed), truth

    def check(self) -> None:
        """Refuse places that can't be poked, before any is.

        Raises:
            InputError: as `Setup.check`.
        """
        last = self.count - 1
        for index in sorted({0, self.columns - 1, last - (self.columns - 1), last}):
            self.setup(index)[0].check()


def run(campaign: Campaign, folder: Path, done: Callable[[int], None] | None = None) -> int:
    """Make the pokes that aren't there yet; how many were made now.

    Args:
        campaign: what is done. folder: of the logs. done: told the number of each poke that is there, old ones first.

    Raises:
        InputError: another campaign in the folder, or one that can't work.
    """
    make_folder(folder)
    _claim(campaign, folder)
    campaign.check()
    clean(folder)
    made = 0
    for index in range(campaign.count):
        if not (folder / f"{campaign.name(index)}.parquet").is_file():
            setup, truth = campaign.setup(index)
            x, y = campaign.place(index)
            properties = {k: float(v[0]) for k, v in setup.material.at(np.array([x]), np.array([y])).items()}
            color = setup.material.color
            if setup.material.colors is not None:
                color = tuple(setup.material.colors(np.array([x]), np.array([y]))[0].tolist())
            truth |= {"place": [x, y], "properties": properties, "color": color}
            write_experiment(folder, setup.run(), truth, name=campaign.name(index), mcap=False)
            made += 1
        if done is not None:
            done(index)
    return made


def logs(folder: Path) -> Iterator[Path]:
    """The pokes of a campaign that are done."""
    yield from sorted(folder.glob("poke_*.parquet"))


def _claim(campaign: Campaign, folder: Path) -> None:
    """Write the manifest, or find it to be the same."""
    path = folder / MANIFEST
    wanted = campaign.manifest()
    if path.is_file():
        try:
            there = json.loads(path.read_text(encoding="utf-8"))
        except (OSError, ValueError):
            raise InputError(f"a damaged {path}", "the manifest of a campaign", "choose another folder with -o") from None
        if there != wanted:
            differ = sorted(k for k in {*there, *wanted} if there.get(k) != wanted.get(k))
            raise InputError(f"another campaign in {folder} ({', '.join(differ)} differ{'s' if len(differ) == 1 else ''})",
                             "the same campaign to go on with, or an empty folder", "choose another folder with -o")  # fmt: skip
        return
    if any(folder.glob("poke_*.parquet")):
        raise InputError(f"pokes without {MANIFEST} in {folder}", "an empty folder", "choose another folder with -o")
    write_text(path, json.dumps(wanted, indent=1) + "\n")


def clean(folder: Path) -> None:
    """Remove what a writer that was killed has left: files that never got their name."""
    for place in (folder, folder / "truth"):
        if place.is_dir():
            for left in place.glob(".poke_*.*.*"):
                left.unlink(missing_ok=True)
