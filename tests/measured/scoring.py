"""What was named of a case: the injected effect or not, and names of what is not there."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import kinid
from kinid import effects
from measured.cases import Case
from measured.paired_blocks import select
from measured.scene import experiment_of

ENGINES = ("diagnosis", "baseline")


@dataclass(frozen=True)
class Answer:
    """What an engine said: names that it adds, and those that it can't tell from each."""

    added: tuple[str, ...]
    equivalent: dict[str, tuple[str, ...]] = field(default_factory=dict)
    verdict: str = ""

    @property
    def all(self) -> set[str]:
        """Every name that it says may be there."""
        return {*self.added, *(rival for name in self.added for rival in self.equivalent.get(name, ()))}


def answer_of(found: Any) -> Answer:
    """Of a diagnosis of the project: what is added, and `equivalent_to` of each."""
    return Answer(tuple(found.added), {name: tuple(found[name].equivalent_to) for name in found.added}, found.verdict)


def ask(engine: str, log: kinid.Log, rig: kinid.Rig, names: tuple[str, ...]) -> Answer:
    """What one of the engines says of a log and a starting model."""
    model = kinid.Model(*names)
    if engine == "diagnosis":
        return answer_of(kinid.diagnose(log, rig, model=model))
    if engine != "baseline":
        raise ValueError(f"engine '{engine}', not one of {', '.join(ENGINES)}")
    rows = select(model, experiment_of(model, log, rig))
    return Answer(tuple(row[0] for row in rows), {row[0]: tuple(row[3]) for row in rows})


@dataclass(frozen=True)
class Score:
    """Of a case.

    Attributes:
        exact: the injected effect itself was added. named: it, or one that does the same to this log, was added or is
            in `equivalent_to` of an added one (which counts where it was not so without the injection). first: of the
            first that was added. already: it was added without the injection, too.
        false: added names that are neither that nor were added without the injection. swapped: those of them that were
            rivals of an added name without it: the log's own effect by another name.
        lost: names that were added without the injection and are not any more.
        known: whether the catalogue holds the effect at all.
    """

    exact: bool
    named: bool
    first: bool
    already: bool
    false: tuple[str, ...]
    swapped: tuple[str, ...]
    lost: tuple[str, ...]
    known: bool


def score(case: Case, found: Any, without: Any = None) -> Score:
    """Compare what was said of a case with what was injected.

    Args:
        case: with its truth. found: a diagnosis, or an `Answer`. without: the same of the log without the injection, or
            None.
    """
    said = found if isinstance(found, Answer) else answer_of(found)
    before = Answer(()) if without is None else without if isinstance(without, Answer) else answer_of(without)
    right = {case.effect, *case.near}
    head = {*said.added[:1], *(rival for name in said.added[:1] for rival in said.equivalent.get(name, ()))}
    # that a name is a rival says something where it was none without the injection
    new = set(said.added) if right & before.all else said.all
    # an added name is right, too, where the injected one is listed as its equal
    fine = right | {name for name in said.added if case.effect in said.equivalent.get(name, ())}
    false = tuple(name for name in said.added if name not in fine and name not in before.added)
    return Score(
        exact=case.effect in said.added,
        named=bool(right & new),
        first=bool(right & head & new),
        already=bool(right & set(before.added)),
        false=false,
        swapped=tuple(name for name in false if name in before.all),
        lost=tuple(name for name in before.added if name not in said.all),
        known=case.effect in effects.catalogue(),
    )
