"""All cases and all transfers, asked of one engine: a JSON line each, and tables by log, size and effect.

    python -m measured.study OUT.json [--seed 1] [--engine diagnosis|baseline] [--sizes 2,5] [--only TEXT] [--every 3]

From the folder of the tests. `--only` takes the cases whose name (log/effect/size) holds a text (or one of
several between commas; with a "/" in it there are no transfers); `--every` each so manieth of
them in an order of the seed's; after `--minutes` no new case is begun. What is raised is written down, and the study
goes on.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
import time
import warnings
from collections.abc import Callable, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from kinid.errors import InputError
from measured.cases import SIZES, case, name_of, planned, unchanged
from measured.scoring import ENGINES, Answer, ask, score
from measured.transfer import line, moved, ways

REAL = Path(os.environ.get("KINID_REAL_DATA") or Path(__file__).parents[3] / "shared" / "real")
Row = dict[str, Any]


def chosen(seed: int, sizes: Sequence[float], only: str, every: int) -> list[tuple[Any, str, float]]:
    """The cases of a study, sorted by log: a log's fits are made once."""
    rows = planned(only, sizes)
    if every > 1:
        lot = np.random.default_rng([seed, 7]).permutation(len(rows))[: -(-len(rows) // every)]
        rows = [rows[i] for i in sorted(lot)]
    return sorted(rows, key=lambda row: (row[0].name, row[1] if row[1] in row[0].model else ""))


def study(
    engine: str,
    seed: int,
    sizes: Sequence[float],
    only: str = "",
    every: int = 1,
    minutes: float = np.inf,
    real: Path = REAL,
    tell: Callable[[Row], None] = lambda row: None,
) -> list[Row]:
    """A row for each case, each log without injection and each transfer."""
    began, rows = time.perf_counter(), []
    without: dict[tuple[str, tuple[str, ...]], Answer | None] = {}

    def keep(row: Row) -> None:
        rows.append(row)
        tell(row)

    def plain(source: Any, model: tuple[str, ...]) -> Answer | None:
        if (source.name, model) not in without:
            row: Row = {"kind": "without", "name": source.name, "model": list(model)}
            said = None
            start = time.perf_counter()
            try:
                said = ask(engine, *unchanged(source, model, real), model)
                row |= _said(said)
            except Exception as error:
                row |= _raised(error)
            without[source.name, model] = said
            keep(row | {"seconds": round(time.perf_counter() - start, 2)})
        return without[source.name, model]

    for source, effect, size in chosen(seed, sizes, only, every):
        if time.perf_counter() - began > 60 * minutes:
            break
        row: Row = {
            "kind": "case",
            "name": name_of(source, effect, size),
            "log": source.name,
            "effect": effect,
            "size": size,
        }
        try:
            made = case(source, effect, size, seed, real)
            if made is None:
                keep(row | {"kind": "unfit"})
                continue
            row |= {
                "near": sorted(made.near),
                "natural": made.natural,
                "reached": round(made.reached, 3),
                "note": made.note,
            }
            before = plain(source, made.model)
            start = time.perf_counter()
            said = ask(engine, made.log, made.rig, made.model)
            row |= {"seconds": round(time.perf_counter() - start, 2), **_said(said)}
            row |= asdict(score(made, said, before))
        except Exception as error:
            row |= _raised(error)
        keep(row)
    for way in ways(real, only) if "/" not in only else ():
        row = {"kind": "transfer", "name": way.name}
        try:
            said = ask(engine, *way.learnt, way.model)
            row |= {"added": list(said.added)}
            before_error, after_error = moved(way, said.added)
            row |= {"before": before_error, "after": after_error, "line": line(way, said, before_error, after_error)}
        except Exception as error:
            row |= _raised(error)
        keep(row)
    return rows


def _raised(error: Exception) -> Row:
    """A log that is refused with a reason is no crash; neither is counted among what was told."""
    return {"refused" if isinstance(error, InputError) else "crash": f"{type(error).__name__}: {error}"}


def _said(answer: Answer) -> Row:
    return {
        "added": list(answer.added),
        "verdict": answer.verdict,
        "equivalent": {k: list(v) for k, v in answer.equivalent.items()},
    }


def table(rows: Sequence[Row], key: str) -> list[str]:
    """Shares by the values of a key, of cases whose effect the catalogue holds and the log did not show already."""
    cases = [row for row in rows if row["kind"] == "case"]
    groups = sorted({row[key] for row in cases})
    titles = ("cases", 5), ("named", 11), ("exact", 6), ("first", 6), ("of all", 10), ("false names", 17), ("crash", 6)
    head = " ".join(f"{title:>{wide}}" for title, wide in (*titles, ("refused", 7), ("s", 6)))
    lines = [f"{'by ' + key:<28} {head}"]
    for group in [*groups, "all"]:
        of = [row for row in cases if group in ("all", row[key])]
        lines.append(f"{group!s:<28} {_counts(of)}")
    return lines


def _counts(rows: Sequence[Row]) -> str:
    answered = [row for row in rows if "named" in row]
    new = [row for row in answered if row["known"] and not row["already"]] + [row for row in rows if "crash" in row]
    named, exact, first = (sum(bool(row.get(key)) for row in new) for key in ("named", "exact", "first"))
    share = f"{100 * named / len(new):4.0f} %" if new else "     –"
    every = [row for row in answered if row["known"]]
    false, swapped = (sum(len(row[key]) for row in every) for key in ("false", "swapped"))
    of_all = f"{sum(row['named'] for row in every)}/{len(every)}"
    quick = float(np.median([row["seconds"] for row in answered])) if answered else float("nan")
    return (
        f"{len(new):>5} {named:>4} {share} {exact:>6} {first:>6} {of_all:>10} {false:>4} ({swapped:>2}) in "
        f"{len(every):<4} "
        f"{sum('crash' in row for row in rows):>5} {sum('refused' in row for row in rows):>7} {quick:>6.1f}"
    )


def report(rows: Sequence[Row], head: str) -> str:
    """All tables."""
    lines = [head, ""]
    for key in ("log", "size", "effect"):
        lines += [*table(rows, key), ""]
    cases = [row for row in rows if row["kind"] == "case" and "named" in row]
    lines += [
        f"{sum(row['already'] for row in cases)} cases whose effect was named without the injection, too, and "
        f"{sum(not row['known'] for row in cases)} whose effect the catalogue lacks, are in no share",
        "('of all' and the false names hold the former; in brackets: false names that were rivals without the "
        "injection);",
        f"{sum(row['kind'] == 'unfit' for row in rows)} planned ones do not fit their log.",
        "",
    ]
    lines += ["without an injection"]
    lines += [
        f"{row['name']:<24} {_problem(row) or ', '.join(row['added']) or '–'}   (from {' + '.join(row['model'])})"
        for row in rows
        if row["kind"] == "without"
    ]
    lines += ["", "transfer: error on the other log, by what the starting model leaves on the first"]
    lines += [row.get("line") or f"{row['name']} {_problem(row)}" for row in rows if row["kind"] == "transfer"]
    lines += ["", "crashes and refusals", *(f"{row['name']}: {_problem(row)}" for row in rows if _problem(row))]
    missed = [
        f"{row['name']} said {', '.join(row['added']) or 'nothing'}"
        for row in cases
        if row["known"] and not row["already"] and not row["named"]
    ]
    return "\n".join([*lines, "", "not named", *missed]) + "\n"


def _problem(row: Row) -> str:
    return str(row.get("crash") or row.get("refused") or "")


def main(arguments: Sequence[str] | None = None) -> int:
    """The command."""
    parser = argparse.ArgumentParser(
        prog="python -m measured.study", description=__doc__.split("\n", 1)[0] if __doc__ else ""
    )
    parser.add_argument("out", type=Path, help="one JSON line a case")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--engine", choices=ENGINES, default="diagnosis")
    parser.add_argument("--sizes", default=",".join(f"{size:g}" for size in SIZES))
    parser.add_argument("--only", default="")
    parser.add_argument("--every", type=int, default=1)
    parser.add_argument("--minutes", type=float, default=np.inf)
    given = parser.parse_args(arguments)
    warnings.simplefilter("ignore")
    with given.out.open("w", encoding="utf-8") as file:

        def tell(row: Row) -> None:
            file.write(json.dumps(row) + "\n")
            file.flush()
            said = _problem(row) or ", ".join(row.get("added", [])) or row["kind"]
            print(f"{row['name']}: {said}", file=sys.stderr, flush=True)

        sizes = [float(size) for size in given.sizes.split(",")]
        rows = study(given.engine, given.seed, sizes, given.only, given.every, given.minutes, tell=tell)
    print(
        report(
            rows, f"{given.engine}, seed {given.seed}, sizes {given.sizes}, every {given.every}, only '{given.only}'"
        )
    )
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
