"""Many pokes or slides, one file each: stopped at any moment, even by a power cut, a campaign goes on where it was.

A poke is done when its log is there: the log is written last, under another name first, and renamed whole. What each
poke does follows from the seed and its number alone, and from the pokes before it where they end early, so that a
campaign that was stopped ends with the same bytes as one that wasn't; a file that is damaged or gone is made again,
with the bytes that it had.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Literal, get_args

import numpy as np
from numpy.typing import NDArray

from kinid.contact.early_stop import check_precision
from kinid.controllers._given import closest
from kinid.data.rig import Rig
from kinid.errors import InputError
from kinid.inputs import digest, read_json
from kinid.lab.arm import Gains
from kinid.lab.campaign_page import Overview
from kinid.lab.early_stop import Learning, carry_out
from kinid.lab.experiments import Vector, prepare
from kinid.lab.folder import at_work, check_free, is_whole
from kinid.lab.hidden import Rectangle, check_met, hide
from kinid.lab.places import Grid
from kinid.lab.protocol import Poke, Slide, five_phases
from kinid.lab.setup import Setup
from kinid.lab.writing import write_experiment, write_rig
from kinid.mapping.warm_start import Expectation
from kinid.writers import Json, make_folder, write_json

Array = NDArray[np.float64]

#: in the folder, and with what is hidden in the truth's
MANIFEST = "campaign.json"
#: map of the recursive estimates of a campaign whose pokes end early
LEARNT = "learnt.parquet"
#: of a manifest: some hundred bytes a place
MOST_BYTES = 100_000_000
#: what is done at each place, shorter than the study's: three turns of the slow sine, or 3 mm out and back each way
Touch = Literal["poke", "slide"]
MOTIONS: dict[str, Poke | Slide] = {
    "poke": Poke(0.003, ((0.0015, 0.9), (0.0005, 5.0)), duration=3.0),
    "slide": Slide(2.5e-3, 3e-3, 3e-3),
}


@dataclass(frozen=True)
class Campaign(Grid):
    """A grid of pokes or slides.

    Attributes:
        rows, columns, spacing: see `Grid`. touch: what is done at each place.
        material, seed, hidden, where, stiffness, torque_limit: as for one experiment.
        point, normal: of the surface; default: the lab's.
        mcap: whether each poke's streams are written, too.
        precision: pokes end when half of the 95 % intervals of stiffness and damping is this share of them, and the
            tool turns in the air before the first alone; None: all are done to their end.
        prior: what such pokes expect of their place, as `kinid.mapping.warm_start.Expectation.read` takes it;
            None: nothing.

    Raises:
        InputError: no such touch, a precision that is none, or one of slides.
    """

    touch: Touch = "poke"
    material: str = "mould"
    seed: int = 0
    hidden: str | None = None
    where: Rectangle | None = None
    stiffness: float = 5200.0
    torque_limit: tuple[float, ...] | None = None
    point: Vector | None = None
    normal: Vector | None = None
    mcap: bool = False
    precision: float | None = None
    prior: str | None = None

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.touch not in MOTIONS:
            raise InputError(
                f"a campaign of '{self.touch}'", f"one of {', '.join(get_args(Touch))}", closest(self.touch, MOTIONS)
            )
        if self.precision is not None:
            check_precision(self.precision)
            if self.touch != "poke":
                raise InputError(f"a precision of {self.touch}s", "pokes, which can end early", "leave it out")

    @property
    def done_there(self) -> str:
        """What is done at each place."""
        return self.touch

    def manifest(self, rig: Rig, everything: bool = False) -> Json:
        """What the campaign is and what measures it, in the words of JSON; what is hidden only with everything."""
        whole = {
            "kind": "campaign",
            "version": 3,
            **vars(self),
            "motion": vars(MOTIONS[self.touch]),
            "rig": rig_facts(rig),
        }
        if self.prior is not None and Path(self.prior).is_file():
            whole["prior_digest"] = digest(Path(self.prior))
        if not everything:
            whole = {name: value for name, value in whole.items() if name not in ("hidden", "where")}
        out: Json = json.loads(json.dumps(whole))
        return out

    def base(self) -> tuple[Setup, dict[str, object]]:
        """What all pokes have in common, and what is hidden in it."""
        base = prepare(
            "poke",
            material=self.material,
            seed=self.seed,
            gains=Gains(translation=self.stiffness),
            point=self.point,
            normal=self.normal,
            torque_limit=self.torque_limit,
        )
        if self.hidden is None:
            return base, {}
        base, hidden = hide(base, self.hidden, self.seed, self.where)
        return base, {"hidden": hidden}

    def setup(self, index: int) -> tuple[Setup, dict[str, object]]:
        """Of one poke, and what is hidden in it."""
        base, truth = self.base()
        # weight and bias, which a turn in the air shows apart, are those of the whole campaign
        free = 0.4 if self.precision is None or index == 0 else 0.0
        script = five_phases(
            MOTIONS[self.touch], place=self.place(index), height=0.008, free=free, hold=0.4, approach=0.8, tilt=0.1
        )
        # the seed and the number: the same poke always, and another noise for each
        seed = int(np.random.SeedSequence([self.seed, 3, index]).generate_state(1)[0])
        return base.replace(script=script, seed=seed), truth

    def learning(self) -> Learning | None:
        """What it learns while it goes on; None where pokes don't end early.

        Raises:
            InputError: as `Expectation.read`.
        """
        if self.precision is None:
            return None
        start = None if self.prior is None else Expectation.read(self.prior)
        return Learning(self, self.base()[0].rig, self.precision, start)

    def check(self) -> None:
        """Refuse places that can't be poked, before any is: the outermost ones.

        Raises:
            InputError: as `Setup.check`; or a hidden effect where nothing is poked.
        """
        if self.where is not None:
            script = self.setup(0)[0].script
            way = np.unique(np.round(script.place[script.touching, :2] - self.place(0), 4), axis=0)
            check_met(self.where, np.concatenate([way + self.place(index) for index in range(self.count)]))
        for index in self.rim():
            self.setup(index)[0].check()


def run(campaign: Campaign, folder: Path, done: Callable[[int], None] | None = None) -> int:
    """Make the pokes that aren't there yet, the page `overview.html` and, where they end early, the map of their
    recursive estimates; how many were made now.

    Args:
        campaign: what is done. folder: of the logs. done: told the number of each poke that is there, old ones first.

    Raises:
        InputError: another campaign or process in the folder, or a campaign that can't work.
    """
    campaign.check()
    learning = campaign.learning()
    with at_work(folder):
        _claim(campaign, folder)
        clean(folder)
        overview = Overview(folder, campaign, f"{campaign.touch.capitalize()}s on {campaign.material}")
        made = 0
        try:
            for index in range(campaign.count):
                if not is_whole(folder, campaign.name(index)):
                    _poke(campaign, folder, index, learning)
                    made += 1
                elif learning is not None:
                    learning.recall(index, folder / f"{campaign.name(index)}.parquet")
                overview.add(index)
                if done is not None:
                    done(index)
        finally:
            overview.write()
            if learning is not None and len(learning.map):
                learning.map.write(folder / LEARNT)
    return made


def _poke(campaign: Campaign, folder: Path, index: int, learning: Learning | None) -> None:
    setup, truth = campaign.setup(index)
    x, y = campaign.place(index)
    properties = {k: float(v[0]) for k, v in setup.material.at(np.array([x]), np.array([y])).items()}
    color = setup.material.color
    if setup.material.colors is not None:
        color = tuple(setup.material.colors(np.array([x]), np.array([y]))[0].tolist())
    truth |= {"place": [x, y], "properties": properties, "color": color}
    if learning is None:
        result = setup.run()
    else:
        poke = learning.begin(index)
        result = carry_out(setup, poke)
        learning.add(index, poke)
    write_experiment(folder, result, truth, name=campaign.name(index), mcap=campaign.mcap)


def logs(folder: Path) -> Iterator[Path]:
    """The pokes and slides of a campaign that are done."""
    yield from sorted(path for touch in MOTIONS for path in folder.glob(f"{touch}_*.parquet"))


def rig_facts(rig: Rig) -> Json:
    """What a rig states, in the words of JSON."""
    return rig.model_dump(mode="json", exclude={"folder"}, exclude_none=True)


def _claim(campaign: Campaign, folder: Path) -> None:
    """Write the manifest, or find it and the rig to be the same; what is hidden stands in the truth's alone."""
    path, base = folder / "truth" / MANIFEST, campaign.base()[0]
    wanted = campaign.manifest(base.rig, everything=True)
    if path.is_file():
        mend = "choose another folder with -o"
        there = read_json(path, "manifest", "that of a campaign", mend, MOST_BYTES, open_ends=True)
        try:
            differ = _differ(there, wanted)
        except (TypeError, AttributeError):
            raise InputError(
                f"a damaged {path}", "the manifest of a campaign", "choose another folder with -o"
            ) from None
        if differ:
            raise InputError(
                f"another campaign in {folder} ({', '.join(differ)} differ{'s' if len(differ) == 1 else ''})",
                "the same campaign to go on with, or an empty folder",
                "choose another folder with -o",
            )
        _check_rig(folder / "rig.toml", wanted["rig"])
    else:
        if any(logs(folder)):
            raise InputError(
                f"{campaign.touch}s without {path} in {folder}", "an empty folder", "choose another folder with -o"
            )
        check_free(folder)
        make_folder(folder / "truth")
        write_json(path, wanted)
    write_json(folder / MANIFEST, campaign.manifest(base.rig))
    write_rig(folder, base)


def _differ(one: Json, other: Json) -> list[str]:
    """Keys whose values differ."""
    return sorted(key for key in {*one, *other} if one.get(key) != other.get(key))


def _check_rig(path: Path, begun_with: Json) -> None:
    """A rig that was edited meanwhile isn't overwritten; one that is gone is made again."""
    if not path.is_file():
        return
    if differ := _differ(json.loads(json.dumps(rig_facts(Rig.load(path)))), begun_with):
        raise InputError(
            f"{path} with another [{'], ['.join(differ)}] than the campaign was begun with",
            "the same rig",
            "put it back, or remove it and it is made again",
        )


def clean(folder: Path) -> None:
    """Remove what a writer that was killed has left: files that never got their name."""
    for place in (folder, folder / "truth", folder / "streams"):
        for kind in (".poke_", ".slide_", ".overview.", ".rig.", ".campaign.", ".learnt."):
            for left in (*place.glob(f"{kind}*.*"), *place.glob(f".{kind}*.*")):
                left.unlink(missing_ok=True)
