"""What the diagnosis says of a foreign world's logs, beside what is hidden in them.

    python -m worlds.score DATA OUT.json [--without-dq] [--only GROUP,KIND,CASE,…] [--engine baseline]

from the folder of the tests. The baseline of a hundred lines names effects and knows no verdicts: what it leaves and
what it holds for excited is not asked.

DATA is what a world's `generate.py --seed S --out DATA` wrote. Figures are printed as JSON; OUT.json holds every case.
"""

from __future__ import annotations

import argparse
import dataclasses
import json
import time
import traceback
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import numpy as np
from measured.scoring import ask as measured

import kinid

Row = dict[str, Any]

#: groups and parameters as some authors call them, and as they are called here; what is not among them is not compared
GROUPS = {"one": "single", "quiet": "none", "two": "pair", "outside": "outside", "not-excited": "not-excited"}
VECTORS, OFFSETS = (
    (("tool-com", "com"), ("tip-offset", "offset")),
    (("sensor-bias", "offset"), ("sensor-drift", "drift")),
)
CHANNELS = ("fx", "fy", "fz", "tx", "ty", "tz")
WORDS = {
    "tool-mass.dm": "tool-mass.mass",
    "structural-compliance.C": "structural-compliance.compliance",
    "viscous-damping.c": "viscous-damping.damping",
    "viscous-friction.c": "viscous-friction.damping",
    "hunt-crossley-damping.lambda": "hunt-crossley-damping.damping",
    "friction-anisotropy.a": "friction-anisotropy.ratio",
    "load-dependent-friction.p": "load-dependent-friction.exponent",
    "time-offset.offset": "time-offset.delay",
    "relaxation.tau": "relaxation.time-constant",
    "sensor-lag.tau": "sensor-lag.time-constant",
    "hertz-exponent.n": "hertz-exponent.exponent",
    "stribeck-friction.dmu": "stribeck-friction.coefficient",
    "stribeck-friction.v_s": "stribeck-friction.speed",
    "friction-rounding.v_r": "friction-rounding.speed",
    "stiffening-layer.K": "stiffening-layer.stiffness",
    **{f"{name}.d{axis}": f"{name}.{vector}[{axis}]" for name, vector in VECTORS for axis in "xyz"},
    **{f"{name}.{channel}": f"{name}.{vector}[{channel}]" for name, vector in OFFSETS for channel in CHANNELS},
}


def ask(job: tuple[Path, Row, bool, str]) -> Row:
    """One case: what is said of it, and the true model's error; a crash is an answer, too."""
    root, case, without_dq, engine = job
    folder, out = root / case["case"], {**case, "crash": ""}
    stem = "log_nodq" if without_dq and any(p.stem == "log_nodq" for p in folder.iterdir()) else "log"
    try:
        rig = kinid.Rig.load(folder / "rig.toml")
        log = kinid.read(next(p for p in folder.iterdir() if p.stem == stem), rig)
        if without_dq:
            log = dataclasses.replace(log, dq=None)
        if engine == "baseline":
            return out | _of_baseline(log, rig, case)
        began = time.perf_counter()
        found = kinid.diagnose(log, rig, model=kinid.Model(*case["model"].split(",")))
        out |= {
            "seconds": time.perf_counter() - began,
            "verdict": found.verdict,
            "added": list(found.added),
            "before": found.steps[0].held_out,
            "after": found.steps[-1].held_out,
            "noise": found.noise_floor,
            "tolerance": found.left.tolerance,
            "verdicts": {e.id: e.verdict for e in found.effects},
            "alternatives": {e.id: list(e.equivalent_to) for e in found.effects if e.equivalent_to},
        }
        if case["group"] in ("single", "pair", "none"):
            true = kinid.diagnose(log, rig, model=kinid.Model(*case["true_model"].split(",")), max_effects=0)
            out |= {"true": true.steps[0].held_out, "intervals": _intervals(true.fit.to_dict()["parameters"], case)}
    except Exception:
        out["crash"] = traceback.format_exc()[-600:]
    return out


def _of_baseline(log: kinid.Log, rig: kinid.Rig, case: Row) -> Row:
    """What the baseline names: adequate is where it adds nothing."""
    said = measured("baseline", log, rig, tuple(name for name in case["model"].split(",") if name != "none"))
    return {
        "verdict": "unexplained" if said.added else "adequate",
        "added": list(said.added),
        "verdicts": dict.fromkeys(said.added, "present"),
        "alternatives": {name: list(rivals) for name, rivals in said.equivalent.items() if rivals},
    }


def as_written(case: Row) -> Row:
    """A case whose models are words with commas, whatever form its author gave them."""
    if "base" in case:
        case = _of_base_and_truth(case)
    elif case["group"] in GROUPS and "unexcited" not in case:
        case = _of_model_and_truth({"truth": case.get("hidden", []), **case})
    out = dict(case)
    for key in ("model", "true_model"):
        out[key] = case[key] if isinstance(case[key], str) else ",".join(case[key])
    if case["group"] == "not-excited":
        out |= {"group": "unexcited", "hidden": case["unexcited"]}
    out["near"] = [*(case.get("near") or []), *((case.get("class") or []) if case["group"] == "outside" else [])]
    out["values"] = {k: v for k, v in (case.get("values") or {}).items() if isinstance(v, int | float)}
    return out


def _of_model_and_truth(case: Row) -> Row:
    """The same where the group has another name."""
    base = [name for name in case["model"].split(",") if name != "none"]
    lacks = [name for name in case["truth"] if name not in base]
    hidden = [] if case["group"] in ("quiet", "outside", "not-excited") else case["truth"]
    unexcited = case["group"] == "not-excited"
    return {
        **case,
        "group": GROUPS[case["group"]],
        "model": case["model"],
        "true_model": case["model"] if unexcited or not lacks else ",".join([*base, *lacks]),
        "hidden": hidden,
        "unexcited": case["truth"],
        "values": {WORDS.get(key, key): value for key, value in (case.get("values") or {}).items()},
    }


def _of_base_and_truth(case: Row) -> Row:
    """A case of which the first model and what it lacks are told, in the words of the others."""
    unexcited = case["kind"] == "not-excited"
    lacks = [name for name in case["truth"] if name not in case["base"]]
    return {
        **case,
        "case": case["log"].split("/")[0],
        "group": {"one": "single"}.get(case["kind"], case["kind"]),
        "kind": "joints" if "rigid-body" in case["base"] else "contact",
        "model": case["base"],
        "true_model": case["base"] if unexcited else [*case["base"], *lacks],
        "hidden": case["truth"],
        "unexcited": case["truth"],
    }


def _intervals(parameters: dict[str, Row], case: Row) -> dict[str, list[float]]:
    """True value, and ends of the interval, of those parameters whose value is known and whose interval has ends."""
    known = case.get("values") or {}
    return {
        name: [float(known[name]), p["low"], p["high"]]
        for name, p in parameters.items()
        if name in known and p["low"] is not None and p["high"] is not None
    }


def right(row: Row, name: str) -> bool:
    """Whether a name is hidden there, honestly alike, or told as not to be told from what is hidden."""
    hidden = set(row["hidden"])
    return name in hidden or name in (row.get("near") or []) or bool(hidden & set(row["alternatives"].get(name, [])))


def figures(rows: list[Row]) -> dict[str, list[float]]:
    """Counts as [hits, cases]."""
    out: dict[str, list[float]] = {"crashes": [sum(bool(r["crash"]) for r in rows), len(rows)]}

    def count(name: str, hit: bool) -> None:
        pair = out.setdefault(name, [0, 0])
        pair[0] += hit
        pair[1] += 1

    ratios, extra = [], []
    for row in rows:
        if row["crash"]:
            continue
        hidden, added, verdicts = set(row["hidden"]), row["added"], row["verdicts"]
        extra.append(sum(not right(row, name) for name in added))
        if row["group"] == "single":
            count("one hidden: named first", bool(added) and right(row, added[0]))
            count("one hidden: exactly", len(added) == 1 and right(row, added[0]))
            count("one hidden: called not excited", any(verdicts.get(name) == "not-excited" for name in hidden))
        if row["group"] == "none":
            count("nothing hidden: nothing added", not added)
            count("nothing hidden: adequate and nothing added", not added and row["verdict"] == "adequate")
        if row["group"] == "pair":
            told = set(added) | {rival for name in added for rival in row["alternatives"].get(name, [])}
            count("two hidden: both", hidden <= told)
        if row["group"] == "outside":
            false = [name for name in added if verdicts.get(name) == "present" and name not in (row.get("near") or [])]
            count("outside: unexplained, nothing false present", row["verdict"] == "unexplained" and not false)
        if row["group"] == "unexcited":
            count("not excited: called absent", any(verdicts.get(name) == "absent" for name in hidden))
        for value, low, high in row.get("intervals", {}).values():
            count("intervals that hold the true value", low <= value <= high)
        if row.get("true") and row["group"] != "none":
            ratios.append(row["after"] / row["true"])
    out["names that aren't there, per log"] = [float(np.sum(extra)), len(extra)]
    if ratios:
        out["error after over the true model's: median, 95 %"] = [
            float(np.median(ratios)),
            float(np.quantile(ratios, 0.95)),
        ]
    return out


def main() -> None:
    """Ask about every case, on two cores."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("data", type=Path)
    parser.add_argument("out", type=Path)
    parser.add_argument("--without-dq", action="store_true")
    parser.add_argument("--only", default="")
    parser.add_argument("--engine", choices=("diagnosis", "baseline"), default="diagnosis")
    given = parser.parse_args()
    only = set(filter(None, given.only.split(",")))
    cases = [
        c
        for c in map(as_written, json.loads((given.data / "truth.json").read_text()))
        if not only or only & {c["case"], c["kind"], c["group"]}
    ]
    with ProcessPoolExecutor(2, get_context("spawn")) as pool:
        rows = list(pool.map(ask, [(given.data, case, given.without_dq, given.engine) for case in cases]))
    given.out.write_text(json.dumps(rows, indent=1, default=str) + "\n", encoding="utf-8")
    print(json.dumps(figures(rows), indent=1))


if __name__ == "__main__":
    main()
