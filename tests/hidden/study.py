"""A study of diagnosis on hidden cases: what was said of each, what should have been, figures, and a confusion matrix.

    python -m hidden.study OUT [SEED]        from the folder of the tests; about half an hour on two cores

A case with one effect counts where the true model, fitted to the same log, lowers the held-out error by 1 % at least:
what is smaller nobody could find. Whoever calibrates thresholds keeps to seeds below `REPORT`.
"""

from __future__ import annotations

import json
import sys
import time
from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import asdict, dataclass, field
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import numpy as np
from scipy.stats import binom

import kinid
from hidden.case import Case
from hidden.cases import WORLDS, case
from kinid import effects

#: seeds from here on are for reports alone; the first hundreds are where thresholds were chosen
REPORT = 1001
#: least share of the held-out error that a single effect must be worth to count
COUNTS = 0.01
#: cases of each kind from each world, force-depth, wrench, joints
FULL = {
    "single": (44, 40, 26),
    "none": (20, 14, 8),
    "outside": (16, 14, 10),
    "pair": (16, 14, 10),
    "not-excited": (16, 8, 4),
}


@dataclass(frozen=True)
class Job:
    """One case, and whether the true model is fitted along even where the diagnosis found it."""

    kind: str
    number: int
    seed: int
    world: str
    refit: bool = True


@dataclass(frozen=True)
class Answer:
    """What diagnosis said of a case.

    Attributes:
        declared: of each addition, its name and those that it is not told from.
        before, after: held-out error. best: of the true model refitted (NaN where none is known). quiet: of the true
            model without an effect that was not found, by name. floor: noise alone.
        absent: effects that this log can't show and that were called absent. unseen: how many it can't show.
        crash: what was raised, or "".
    """

    name: str
    kind: str
    world: str
    truth: tuple[str, ...]
    note: str
    verdict: str = ""
    added: tuple[str, ...] = ()
    declared: tuple[tuple[str, ...], ...] = ()
    before: float = np.nan
    after: float = np.nan
    best: float = np.nan
    quiet: dict[str, float] = field(default_factory=dict)
    floor: float = np.nan
    absent: tuple[str, ...] = ()
    unseen: int = 0
    seconds: float = 0.0
    crash: str = ""

    @property
    def counts(self) -> bool:
        """Whether what is hidden matters: of a single effect its worth, of a pair that of each that was not found."""
        if self.kind == "single":
            return bool(self.best < (1.0 - COUNTS) * self.before)
        if self.kind == "pair":
            return all(self.best < (1.0 - COUNTS) * error for error in self.quiet.values())
        return True

    @property
    def first(self) -> bool:
        """Whether the first that was named is hidden."""
        return bool(self.added) and self.added[0] in self.truth

    @property
    def declared_first(self) -> tuple[str, ...]:
        """The first addition and its rivals."""
        return self.declared[0] if self.declared else ()

    @property
    def hits(self) -> int:
        """How many of the hidden effects were added."""
        return len(set(self.added) & set(self.truth))

    @property
    def right(self) -> bool:
        """Whether all that was said is true."""
        if self.crash:
            return False
        expected = {
            "none": not self.added and self.verdict == "adequate",
            "outside": self.verdict == "unexplained",
            "not-excited": not self.absent,
        }
        return expected.get(self.kind, set(self.added) == set(self.truth) and self.verdict == "missing")

    def line(self) -> str:
        """For a listing."""
        mark = "ok " if self.right else ("BAD" if self.counts else "·  ")
        if self.crash:
            return f"BAD {self.name} CRASH {self.crash} ({self.note})"
        if self.kind == "not-excited":
            return (
                f"{mark} {self.name} absent: {', '.join(self.absent) or 'none'} of {self.unseen} [{self.seconds:.1f} s]"
            )
        rivals = "; ".join("=".join(d) for d in self.declared if len(d) > 1)
        said = f"{self.verdict} {', '.join(self.added) or '–'}{f' ({rivals})' if rivals else ''}"
        errors = f"{self.before:.4g} → {self.after:.4g}, true {self.best:.4g}, noise {self.floor:.4g}"
        return f"{mark} {self.name} {said} {errors} [{self.seconds:.1f} s] {self.note}"


def jobs(seed: int = REPORT, plan: dict[str, Sequence[int]] = FULL) -> list[Job]:
    """So many of each kind from each world; those that take long first."""
    made = [
        Job(kind, number, seed, world)
        for kind, counts in plan.items()
        for world, count in zip(WORLDS, counts)
        for number in range(count)
    ]
    return sorted(made, key=lambda job: job.world != "wrench")


def run(job: Job) -> Answer:
    """Make the case and ask."""
    return ask(case(job.kind, job.number, job.seed, job.world), job.world, job.refit)


def ask(hidden: Case, world: str, refit: bool = True) -> Answer:
    """What diagnosis says of a case; a crash is an answer, too."""
    facts = {
        "name": hidden.name,
        "kind": hidden.kind,
        "world": world,
        "truth": tuple(sorted(hidden.truth)),
        "note": hidden.note,
    }
    began = time.perf_counter()
    try:
        found = kinid.diagnose(hidden.log, hidden.rig, model=kinid.Model(*hidden.model))
        seconds = time.perf_counter() - began
        facts |= {
            "verdict": found.verdict,
            "added": found.added,
            "before": found.steps[0].held_out,
            "after": found.steps[-1].held_out,
            "declared": tuple((name, *found[name].equivalent_to) for name in found.added),
            "floor": found.noise_floor,
            "seconds": seconds,
        }
        if hidden.kind == "not-excited":
            verdicts = {effect.id: effect.verdict for effect in found.effects}
            named = [name for name in hidden.truth if name in verdicts]
            facts |= {
                "absent": tuple(sorted(name for name in named if verdicts[name] == "absent")),
                "unseen": len(named),
            }
        elif hidden.kind in ("single", "pair"):
            facts |= _references(hidden, found, refit)
        else:
            facts["best"] = found.steps[0].held_out if hidden.kind == "none" else np.nan
    except Exception as error:
        facts["crash"] = f"{type(error).__name__}: {error}"
    return Answer(**facts)


def _references(hidden: Case, found: kinid.Diagnosis, refit: bool) -> dict[str, Any]:
    """Held-out error of the true model: the least of all fits of it; and of the model that lacks what was not found."""
    errors = [found.steps[-1].held_out] if set(found.added) == hidden.truth else [_with(hidden, hidden.truth)]
    if refit and not any(effects.get(name).detector for name in hidden.truth):
        whole = kinid.diagnose(hidden.log, hidden.rig, model=kinid.Model(*hidden.true_model), max_effects=0)
        errors.append(whole.steps[0].held_out)
    lost = hidden.truth - set(found.added) if hidden.kind == "pair" else set()
    return {"best": min(errors), "quiet": {name: _with(hidden, hidden.truth - {name}) for name in sorted(lost)}}


def _with(hidden: Case, names: Iterable[str]) -> float:
    """Held-out error with these added, whatever the evidence."""
    names = sorted(names, key=lambda name: bool(effects.get(name).requires))
    found = kinid.diagnose(hidden.log, hidden.rig, model=kinid.Model(*hidden.model), add=names, max_effects=len(names))
    return found.steps[-1].held_out


def side_by_side(work: Sequence[Job], processes: int = 2, tell: Callable[[str], None] = lambda _: None) -> list[Answer]:
    """All of them, on so many cores."""
    out = []
    with ProcessPoolExecutor(processes, get_context("spawn")) as pool:
        for answer in pool.map(run, work):
            tell(answer.line())
            out.append(answer)
    return out


# ------------------------------------------------------------------------------------------------------------- figures


@dataclass(frozen=True)
class Figure:
    """One figure beside what is asked: `hits` of `cases`, a share that is to be at least or at most `asked`."""

    name: str
    hits: int
    cases: int
    asked: float
    least: bool = True

    @property
    def share(self) -> float:
        """Hits of cases."""
        return self.hits / self.cases if self.cases else float("nan")

    @property
    def reached(self) -> bool:
        """Whether the share is what is asked for."""
        return self.share >= self.asked if self.least else self.share <= self.asked

    @property
    def believable(self) -> bool:
        """Whether so few (or so many) hits are to be expected once in a hundred studies, if the asked share is the true
        one.
        """
        if not self.cases:
            return False
        tail = (
            binom.cdf(self.hits, self.cases, self.asked)
            if self.least
            else binom.sf(self.hits - 1, self.cases, self.asked)
        )
        return self.reached or bool(tail > 0.01)

    def line(self) -> str:
        """For a table."""
        sign = "≥" if self.least else "≤"
        mark = "PASS" if self.reached else "FAIL" if self.cases else "none"
        return (
            f"{mark} {self.name:<52} {self.hits:>4} of {self.cases:<4} {100 * self.share:5.1f} % "
            f"(asked {sign} {100 * self.asked:g} %)"
        )


@dataclass(frozen=True)
class Figures:
    """All that was asked for: shares, mean size of the declared set, and ratios of errors to those of the true
    models.
    """

    shares: tuple[Figure, ...]
    set_size: float
    ratios: tuple[float, ...]

    @property
    def median_ratio(self) -> float:
        """Of held-out errors after adding to those of the true model."""
        return float(np.median(self.ratios)) if self.ratios else float("nan")

    def lines(self) -> list[str]:
        """The table."""
        return [
            *(figure.line() for figure in self.shares),
            f"{'PASS' if self.set_size <= 1.5 else 'FAIL'} mean size of the declared set: {self.set_size:.2f} (asked ≤ "
            f"1.5)",
            f"{'PASS' if self.median_ratio <= 1.02 else 'FAIL'} error after adding by that of the true model: median "
            f"{self.median_ratio:.3f} (asked ≤ 1.02)",
        ]


def figures(answers: Sequence[Answer]) -> Figures:
    """Count."""

    def of(kind: str) -> list[Answer]:
        return [t for t in answers if t.kind == kind]

    single = [t for t in of("single") if t.counts or t.crash]
    pair = [t for t in of("pair") if t.counts or t.crash]
    known = single + pair
    ratios = tuple(t.after / t.best for t in known if np.isfinite(t.best) and t.best > 0)
    unseen = sum(t.unseen for t in of("not-excited"))
    declared = [bool(set(t.declared_first) & set(t.truth)) for t in single]
    outside = [t.verdict == "unexplained" for t in of("outside")]
    shares = (
        Figure("one hidden: named first", sum(t.first for t in single), len(single), 0.95),
        Figure("one hidden: in the declared set", sum(declared), len(declared), 0.97),
        Figure(
            "nothing hidden: false alarms", sum(not t.right for t in of("none")), len(of("none")), 0.03, least=False
        ),
        Figure("outside the catalogue: unexplained", sum(outside), len(outside), 0.90),
        Figure(
            "known effects: unexplained", sum(t.verdict == "unexplained" for t in known), len(known), 0.05, least=False
        ),
        Figure("two hidden: both", sum(t.hits == 2 for t in pair), len(pair), 0.85),
        Figure(
            "two hidden: both in the declared sets",
            sum(set(t.truth) <= {n for d in t.declared for n in d} for t in pair),
            len(pair),
            0.85,
        ),
        Figure("two hidden: one at least", sum(t.hits >= 1 for t in pair), len(pair), 0.98),
        Figure("error after adding ≤ 1.1 × that of the true model", sum(r <= 1.1 for r in ratios), len(ratios), 1.0),
        Figure(
            "not excited, but called absent", sum(len(t.absent) for t in of("not-excited")), unseen, 0.0, least=False
        ),
        Figure("crashes", sum(bool(t.crash) for t in answers), len(answers), 0.0, least=False),
    )
    sizes = [len(t.declared_first) for t in single if t.added]
    return Figures(shares, float(np.mean(sizes)) if sizes else float("nan"), ratios)


def confusion(answers: Sequence[Answer]) -> list[str]:
    """What is hidden, and what was named first how often; all that is not what it should be stands in brackets."""
    rows: dict[str, Counter[str]] = {}
    for t in answers:
        if t.kind == "not-excited":
            continue
        hidden = (
            " + ".join(t.truth)
            if t.kind == "single"
            else {"none": "(nothing)", "outside": "(outside)"}.get(t.kind, "(two)")
        )
        if t.kind == "single" and not t.counts:
            hidden += " (too small)"
        if t.crash:
            said = "[crash]"
        elif t.kind == "pair":
            said = {2: "both", 1: "[one]", 0: "[neither]"}[t.hits]
        elif t.verdict == "unexplained":
            said = "unexplained" if t.kind == "outside" else f"[unexplained{', ' + t.added[0] if t.added else ''}]"
        else:
            said = t.added[0] if t.added else "nothing"
            fine = said in t.truth or (said == "nothing" and (t.kind == "none" or not t.counts))
            said = said if fine else f"[{said}]"
        rows.setdefault(hidden, Counter())[said] += 1
    wide = max((len(name) for name in rows), default=0)
    return [
        f"{name:<{wide}}  " + ", ".join(f"{said} {count}" for said, count in row.most_common())
        for name, row in sorted(rows.items())
    ]


def report(answers: Sequence[Answer]) -> str:
    """Figures, confusion matrix, and every case in a line."""
    worlds = ", ".join(
        f"{sum(t.world == world for t in answers)} {world}" for world in dict.fromkeys(t.world for t in answers)
    )
    counted = sum(t.counts for t in answers if t.kind == "single")
    head = (
        f"{len(answers)} cases ({worlds}); {counted} of {sum(t.kind == 'single' for t in answers)} single "
        "effects matter by 1 %"
    )
    lines = [
        head,
        *figures(answers).lines(),
        "",
        "hidden → named first",
        *confusion(answers),
        "",
        *(t.line() for t in answers),
    ]
    return "\n".join(lines) + "\n"


def write(answers: Sequence[Answer], folder: Path, name: str) -> None:
    """The report as text, and all that it was made of as JSON."""
    folder.mkdir(parents=True, exist_ok=True)
    (folder / f"{name}.txt").write_text(report(answers), encoding="utf-8")
    found = figures(answers)
    facts = {
        "figures": [asdict(f) | {"share": f.share, "reached": f.reached} for f in found.shares],
        "mean_set_size": found.set_size,
        "median_error_ratio": found.median_ratio,
        "confusion": confusion(answers),
        "cases": [asdict(t) | {"counts": t.counts, "right": t.right} for t in answers],
    }
    (folder / f"{name}.json").write_text(json.dumps(_finite(facts), indent=1, allow_nan=False) + "\n", encoding="utf-8")


def _finite(facts: Any) -> Any:
    if isinstance(facts, dict):
        return {key: _finite(value) for key, value in facts.items()}
    if isinstance(facts, list | tuple):
        return [_finite(value) for value in facts]
    return None if isinstance(facts, float) and not np.isfinite(facts) else facts


if __name__ == "__main__":
    every = side_by_side(
        jobs(int(sys.argv[2]) if len(sys.argv) > 2 else REPORT), tell=lambda line: print(line, flush=True)
    )
    write(every, Path(sys.argv[1]), "hidden-effects")
    print("\n".join([*figures(every).lines(), "", *confusion(every)]))
