"""What comes out of a choice among experiments: how well each tells candidates apart, the best one, and why."""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from kinid.effects import Effect
from kinid.planning.experiments import Proposal
from kinid.planning.forms import Form
from kinid.planning.trajectory import Trajectory
from kinid.writers import Json

Array = NDArray[np.float64]
Pair = tuple[str, str]

#: squared distance from which a diagnosis can be expected to decide: five standard deviations
SURE = 25.0


@dataclass(frozen=True, eq=False)
class Verdict:
    """How well one experiment tells.

    Attributes:
        proposal: the experiment. duration: of all of it [s].
        distances: squared, in noise, of each ordered pair (a, b): a's change that the model with b can't imitate, for
            each plausible form of a, (forms,).
        lies: for each pair and form, phase and channel that hold most of it, and their share, 0…1.
    """

    proposal: Proposal
    duration: float
    distances: dict[Pair, Array]
    lies: dict[Pair, list[tuple[str, str, float]]]


@dataclass(frozen=True, eq=False)
class Discrimination:
    """The experiment that tells candidates apart best.

    Attributes:
        effects: the candidates. proposal: the experiment. trajectory: of the robot, within all limits.
        distance: the worst pair's squared distance, in noise. sure: whether that is enough to decide.
        words: why it tells them apart. table: name, title, duration [s] and worst squared distance, the best first.
        refused: experiments that the robot can't do, and why. open: forms of a candidate that no experiment tells.
    """

    effects: tuple[str, ...]
    proposal: Proposal
    trajectory: Trajectory
    distance: float
    words: str
    table: tuple[tuple[str, str, float, float], ...]
    refused: dict[str, str]
    open: tuple[str, ...]

    @property
    def sure(self) -> bool:
        """Whether a diagnosis can be expected to decide."""
        return self.distance >= SURE

    def to_dict(self) -> Json:
        """For provenance and JSON."""
        return {
            "effects": list(self.effects),
            "experiment": self.proposal.name,
            "title": self.proposal.title,
            "words": self.words,
            "distance": self.distance,
            "sure": self.sure,
            "open": list(self.open),
            "refused": self.refused,
            "experiments": [dict(zip(("name", "title", "duration", "distance"), row)) for row in self.table],
        }


def why_separable(
    effects: Sequence[Effect],
    forms: Mapping[str, Sequence[Form]],
    verdict: Verdict,
    kept: Mapping[Pair, NDArray[np.bool_]],
) -> str:
    """Why an experiment tells its candidates apart."""
    parts = [verdict.proposal.why] if verdict.proposal.why else []
    for one, two in itertools.combinations(effects, 2):
        parts.append(f"{one.id} shows as {one.signature} – {two.id} as {two.signature}")
    # the form that is hardest to tell decides, and is told
    worst = {
        pair: int(np.argmin(np.where(kept[pair], each, np.inf)))
        for pair, each in verdict.distances.items()
        if kept[pair].any()
    }
    parts += [
        f"{b} can imitate {forms[a][0].described()}; of two that explain the readings, the simpler one is believed"
        for (a, b), seen in kept.items()
        if not seen.any()
    ]
    pair = min(worst, key=lambda key: float(verdict.distances[key][worst[key]]))
    form, (phase, channel, share) = forms[pair[0]][worst[pair]], verdict.lies[pair][worst[pair]]
    distance = float(verdict.distances[pair][worst[pair]])
    parts.append(
        f"hardest is {form.described()}: of what {pair[1]} can't imitate of it, {np.sqrt(distance):.3g} standard "
        f"deviations, "
        f"{100 * share:.0f} % lies in {channel} in phase {phase}"
    )
    doubt = "" if distance >= SURE else "; so little of it may stay open"
    return f"{verdict.proposal.title}: " + "; ".join(parts) + doubt
