#!/usr/bin/env python3
"""python generate.py --seed S --out DIR [--only I]: 48 logs of a palpation clinic with rigs, and truth.json."""
import argparse
import json
import os
import sys
import time

for v in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS"):
    os.environ.setdefault(v, "1")
HERE = os.path.dirname(os.path.abspath(__file__))
if os.path.exists(os.path.join(HERE, "venv/bin/python")) and not sys.prefix.startswith(os.path.join(HERE, "venv")):
    os.execv(os.path.join(HERE, "venv/bin/python"), [os.path.join(HERE, "venv/bin/python"), os.path.abspath(__file__)] + sys.argv[1:])
sys.path.insert(0, HERE)

import numpy as np          # noqa: E402
import pyarrow as pa        # noqa: E402
import pyarrow.parquet as pq  # noqa: E402

import plan as planning     # noqa: E402
import tune                 # noqa: E402
from contact_case import ContactCase  # noqa: E402
from joint_case import JointCase      # noqa: E402
from refit import Rejected  # noqa: E402


def plain(x):
    if isinstance(x, dict):
        return {str(k): plain(v) for k, v in x.items()}
    if isinstance(x, (list, tuple, np.ndarray)):
        return [plain(v) for v in (x.tolist() if isinstance(x, np.ndarray) else x)]
    if isinstance(x, (np.floating, float)):
        return float(f"{float(x):.6g}") if np.isfinite(x) else None
    if isinstance(x, (np.integer, np.bool_)):
        return x.item()
    return x


def toml(rig):
    out = []
    for table, fields in rig.items():
        out.append(f"[{table}]")
        for k, v in fields.items():
            out.append(f"{k} = {json.dumps(plain(v) if not isinstance(v, list) else [x if isinstance(x, str) else float(x) for x in v])}")
        out.append("")
    return "\n".join(out)


def dress(rng, case, log):
    """phase names and commands that some users log too."""
    if case.kind == "wrench":
        idx = np.minimum((log["t"] / (case.t[1] - case.t[0])).astype(int), len(case.phase) - 1)
        if rng.random() < 0.55:
            log["phase"] = case.phase[idx].astype(str)
        if rng.random() < 0.12:
            log.update({f"q_cmd{i + 1}": np.round(case.cmd[idx, i], 7) for i in range(case.cmd.shape[1])})
    elif case.kind == "tester" and rng.random() < 0.3:
        log["phase"] = case.phase[np.minimum((log["t"] / (case.t[1] - case.t[0])).astype(int), len(case.phase) - 1)].astype(str)
    return log


def write(folder, log, rig, rng):
    os.makedirs(folder, exist_ok=True)
    n, form = len(log["t"]), rng.random()
    if form < 0.07 and n < 30000:
        import pandas as pd
        pd.DataFrame(log).to_csv(os.path.join(folder, "log.csv"), index=False, float_format="%.9g")
    elif form < 0.12:
        np.savez_compressed(os.path.join(folder, "log.npz"), **log)
    else:
        pq.write_table(pa.table(log), os.path.join(folder, "log.parquet"), compression="zstd")
    with open(os.path.join(folder, "rig.toml"), "w") as f:
        f.write(toml(rig))


def one(seed, i, spec, say):
    kind, group, hidden, long, what, used = spec
    for attempt in range(14):
        rng = np.random.default_rng([seed, i, attempt])
        if attempt == 7 and hidden:                                # this effect will not do here: a neighbour of its stage
            say(f"  {i}: {hidden} given up")
            pools = [p for p in (planning.NORMAL, planning.TANGENT, planning.TOOL, planning.SENSOR, planning.JOINT) if hidden[-1] in p]
            allowed = set(planning.DRIVE) if kind == "drive" else set(planning.NORMAL[:-2] + planning.TANGENT + planning.TESTER_SENSOR) if kind == "tester" else None
            pool = [x for x in (pools[0] if pools else planning.DRIVE) if x not in used and (allowed is None or x in allowed)]
            hidden = hidden[:-1] + [str(rng.choice(pool))]
        if what and attempt in (4, 8, 11):                         # nor this disturbance
            from hidden import OUTSIDE
            from joint_case import OUTSIDE as JO
            what = str(rng.choice([w for w in {**OUTSIDE, **JO}[kind] if w != what]))
        p = planning.details(rng, kind, group, hidden, long and attempt < 7, what)
        try:
            case = (ContactCase if kind in ("wrench", "tester") else JointCase)(rng, p)
            log, rig, truth, _ = tune.run(case, p, rng)
            return case, log, rig, truth, rng
        except (Rejected, np.linalg.LinAlgError) as e:
            say(f"  {i} {kind} {group} {p['hidden'] or what} {p['model']} attempt {attempt}: {e}")
    raise SystemExit(f"case {i} failed")


def main():
    ap = argparse.ArgumentParser(description=__doc__)
    ap.add_argument("--seed", type=int, required=True)
    ap.add_argument("--out", required=True)
    ap.add_argument("--only", type=int)
    ap.add_argument("--verbose", action="store_true")
    a = ap.parse_args()
    specs = planning.draw(a.seed)
    used = {h for s in specs if s[1] == "single" for h in s[2]}
    say = (lambda s: print(s, file=sys.stderr, flush=True)) if a.verbose else (lambda s: None)
    os.makedirs(a.out, exist_ok=True)
    truths = []
    for i, s in enumerate(specs):
        if a.only is not None and i != a.only:
            continue
        t0 = time.time()
        case, log, rig, truth, rng = one(a.seed, i, s + [used], say)
        write(os.path.join(a.out, f"case_{i:03d}"), dress(rng, case, log), rig, rng)
        truths.append(plain({"case": f"case_{i:03d}", **truth}))
        say(f"{i} {truth['kind']} {truth['group']} {truth['hidden']} {truth['model']} n={len(log['t'])} T={truth['seconds']} "
            f"{ {h: round(m['effect_rms'] / m['left_rms'], 2) for h, m in truth['effect_each'].items()} } near={truth['near']} {time.time() - t0:.1f} s")
    with open(os.path.join(a.out, "truth.json"), "w") as f:
        json.dump(truths, f, indent=1)


if __name__ == "__main__":
    main()
