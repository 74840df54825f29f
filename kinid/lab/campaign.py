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
from kinid.lab.campaign_page import Overview
from kinid.lab.experiments import Vector, prepare
from kinid.lab.hidden import Rectangle, hide
from kinid.lab.places import Grid
from kinid.lab.protocol import Poke, five_phases
from kinid.lab.setup import Setup
from kinid.lab.writing import write_experiment
from kinid.writers import make_folder, write_text

Array = NDArray[np.float64]

#: in the folder, and with what is hidden in the truth's
MANIFEST = "campaign.json"
#: a poke of a campaign is shorter than the study's: three turns of the slow sine
POKE = Poke(0.003, ((0.0015, 0.9), (0.0005, 5.0)), duration=3.0)


@dataclass(frozen=True)
class Campaign(Grid):
    """A grid of pokes.

    Attributes:
        rows, columns, spacing: see `Grid`.
        material, seed, hidden, where, stiffness: as for one experiment. point, normal: of the surface; default: the lab's.
        mcap: whether each poke's streams are written, too.
    """

    material: str = "mould"
    seed: int = 0
    hidden: str | None = None
    where: Rectangle | None = None
    stiffness: float = 5200.0
    point: Vector | None = None
    normal: Vector | None = None
    mcap: bool = False

    def manifest(self, everything: bool = False) -> dict[str, Any]:
        """What the campaign is, in the words of JSON; what is hidden only with everything."""
        whole = {"kind": "campaign", "version": 2, **vars(self)}
        if not everything:
            whole = {name: value for name, value in whole.items() if name not in ("hidden", "where")}
        out: dict[str, Any] = json.loads(json.dumps(whole))
        return out

    def setup(self, index: int) -> tuple[Setup, dict[str, Any]]:
        """Of one poke, and what is hidden in it."""
        base = prepare("poke", material=self.material, seed=self.seed, gains=Gains(translation=self.stiffness), point=self.point,
                       normal=self.normal)  # fmt: skip
        truth: dict[str, Any] = {}
        if self.hidden is not None:
            base, truth["hidden"] = hide(base, self.hidden, self.seed, self.where)
        script = five_phases(POKE, place=self.place(index), height=0.008, free=0.4, hold=0.4, approach=0.8, tilt=0.1)
        # the seed and the number: the same poke always, and another noise for each
        seed = int(np.random.SeedSequence([self.seed, 3, index]).generate_state(1)[0])
        return base.replace(script=script, seed=seed), truth

    def check(self) -> None:
        """Refuse places that can't be poked, before any is: the outermost ones.

        Raises:
            InputError: as `Setup.check`.
        """
        for index in self.rim():
            self.setup(index)[0].check()


def run(campaign: Campaign, folder: Path, done: Callable[[int], None] | None = None) -> int:
    """Make the pokes that aren't there yet, and the page `overview.html`; how many were made now.

    Args:
        campaign: what is done. folder: of the logs. done: told the number of each poke that is there, old ones first.

    Raises:
        InputError: another campaign in the folder, or one that can't work.
    """
    campaign.check()
    make_folder(folder)
    _claim(campaign, folder)
    clean(folder)
    overview = Overview(folder, campaign, f"Pokes on {campaign.material}")
    made = 0
    try:
        for index in range(campaign.count):
            if not (folder / f"{campaign.name(index)}.parquet").is_file():
                _poke(campaign, folder, index)
                made += 1
            overview.add(index)
            if done is not None:
                done(index)
    finally:
        overview.write()
    return made


def _poke(campaign: Campaign, folder: Path, index: int) -> None:
    setup, truth = campaign.setup(index)
    x, y = campaign.place(index)
    properties = {k: float(v[0]) for k, v in setup.material.at(np.array([x]), np.array([y])).items()}
    color = setup.material.color
    if setup.material.colors is not None:
        color = tuple(setup.material.colors(np.array([x]), np.array([y]))[0].tolist())
    truth |= {"place": [x, y], "properties": properties, "color": color}
    write_experiment(folder, setup.run(), truth, name=campaign.name(index), mcap=campaign.mcap)


def logs(folder: Path) -> Iterator[Path]:
    """The pokes of a campaign that are done."""
    yield from sorted(folder.glob("poke_*.parquet"))


def _claim(campaign: Campaign, folder: Path) -> None:
    """Write the manifest, or find it to be the same; what is hidden stands in the truth's alone."""
    path, wanted = folder / "truth" / MANIFEST, campaign.manifest(everything=True)
    if path.is_file():
        try:
            there = json.loads(path.read_text(encoding="utf-8"))
            differ = sorted(k for k in {*there, *wanted} if there.get(k) != wanted.get(k))
        except (OSError, ValueError, TypeError, AttributeError):
            raise InputError(f"a damaged {path}", "the manifest of a campaign", "choose another folder with -o") from None
        if differ:
            raise InputError(f"another campaign in {folder} ({', '.join(differ)} differ{'s' if len(differ) == 1 else ''})",
                             "the same campaign to go on with, or an empty folder", "choose another folder with -o")  # fmt: skip
    else:
        if any(folder.glob("poke_*.parquet")):
            raise InputError(f"pokes without {path} in {folder}", "an empty folder", "choose another folder with -o")
        make_folder(folder / "truth")
        write_text(path, json.dumps(wanted, indent=1) + "\n")
    write_text(folder / MANIFEST, json.dumps(campaign.manifest(), indent=1) + "\n")


def clean(folder: Path) -> None:
    """Remove what a writer that was killed has left: files that never got their name."""
    for place in (folder, folder / "truth"):
        if place.is_dir():
            for kind in (".poke_*.*.*", ".overview.*.html", ".rig.*.toml", ".campaign.*.json"):
                for left in place.glob(kind):
                    left.unlink(missing_ok=True)
