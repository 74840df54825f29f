#!/usr/bin/env python3
"""generate.py --seed S --out DIR [--only I]: 48 logs with rigs and truth."""
import argparse
import json
import os
import sys
import time
for v in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ[v] = "1"
HERE = os.path.dirname(os.path.abspath(__file__))
_venv = os.path.join(HERE, "venv", "bin", "python")
if os.path.exists(_venv) and os.path.abspath(sys.prefix) != os.path.join(HERE, "venv"):
    os.execv(_venv, [_venv] + sys.argv)
os.environ.setdefault("NUMBA_CACHE_DIR", os.path.join(HERE, ".numba"))
sys.path.insert(0, HERE)
import numpy as np
from plan import plan, contact_model, joint_model, pair
from wrench import WrenchCase
from tester import TesterCase
from joints import JointCase, DriveCase, tune_outside
from effects import ACTS
import outside
import tune as T
from values import values

CLASS = dict(wrench=WrenchCase, tester=TesterCase, joints=JointCase, drive=DriveCase)
ERR = (RuntimeError, np.linalg.LinAlgError, FloatingPointError, ValueError, IndexError, ZeroDivisionError)


def plain(x):
    if isinstance(x, dict):
        return {str(k): plain(v) for k, v in x.items()}
    if isinstance(x, (list, tuple)):
        return [plain(v) for v in x]
    if isinstance(x, np.ndarray):
        return plain(x.tolist())
    if isinstance(x, np.generic):
        return plain(x.item())
    if isinstance(x, float):
        return float(f"{x:.6g}")
    return x


def attempt(spec, seed, rng, n):
    """One try at a case; None when it can't be brought to what the brief asks."""
    kind, group = spec["kind"], spec["group"]
    hidden = list(spec["hidden"])
    left = spec.get("spare") if group == "single" else [e for e in spec.get("pool", []) if e not in hidden]
    if n >= 3 and n % 2 and left and group in ("single", "weak"):        # another effect of the same stage
        hidden = [left[(n // 2 - 1) % len(left)]]
    if n >= 2 and group == "pair":
        hidden = pair(rng, spec["pools"])
    extra = spec.get("extra")
    if extra and n >= 3:
        left = [x for x in spec["pool"] if x not in spec["used"]] or [extra]
        extra = left[(n - 3) % len(left)]
    flags = list(spec.get("flags", []))
    if n >= 3 and spec.get("ways"):
        e, f = spec["ways"][n % 3]
        hidden, flags = [e], ["unexcited-motion", f]
    make = contact_model if kind in ("wrench", "tester") else joint_model
    model = make(rng, kind, hidden, spec.get("rich", .12) if n < 4 else 0.0)
    case = CLASS[kind](seed + [n], model, hidden, extra=extra, flags=flags)
    if extra:
        got = (outside.tune if kind in ("wrench", "tester") else tune_outside)(case, rng)
    elif group == "unexcited":
        got = unexcited(case, rng)
    else:
        lo, hi = (.35, .65) if group == "weak" else (2.8, 7.2)
        got = T.tune(case, {h: float(np.exp(rng.uniform(np.log(lo), np.log(hi)))) for h in hidden})
    return None if got is None else (case, extra, got)


def unexcited(case, rng):
    amps = {h: float(rng.uniform(.6, 1.6)) for h in case.hidden}
    for _ in range(8):
        w = case.world(amps)
        log = case.log(w)
        D, r = case.analyse(w, log)
        if r[case.main]["ok"] and max(r["each"][h]["ratio"] for h in case.hidden) < .4:
            return amps, (w, log, D, r)
        if r[case.main]["ok"]:
            return None
        case.relax()
    return None


def describe(name, spec, case, extra, got):
    amps, (w, log, D, r) = got
    t = log["t"]
    out = dict(case=name, kind=case.kind, group=spec["group"], model=",".join(case.model), hidden=case.hidden, true_model=",".join(case.model + case.hidden),
               near=[], unit=case.unit)
    if extra:
        out.update(effect_rms=r["effect"], left_rms=r["left"], fit_rms=r["fit"], reading_rms=r["reading"], noise_rms=r["noise"],
                   notes=f"outside the catalogue: {outside.NOTES.get(extra, extra)}; best single addition ({r['helps']}) leaves {r['after']:.3g}",
                   outside=extra)
    else:
        m = r[case.main]
        out.update(fit_rms=m["fit"], reading_rms=m["reading"], noise_rms=m["noise"], effect_rms=0.0, left_rms=m["fit"], notes="")
        if case.hidden:
            unit = lambda h: "N·m" if case.kind in ("joints", "drive") or case.kind == "wrench" and ACTS[h][0] == "torque" else "N"
            first = min((h for h in case.hidden if unit(h) == unit(case.hidden[0])), key=lambda h: r["each"][h]["ratio"])
            out.update(effect_rms=r["each"][first]["effect"], left_rms=r["each"][first]["left"], unit=unit(case.hidden[0]),
                       effects={h: dict(effect_rms=r["each"][h]["effect"], left_rms=r["each"][h]["left"], unit=unit(h)) for h in case.hidden})
            out["left_rms"] = out["left_rms"] or m["fit"]                   # a saturation never reached acts nowhere
            if spec["group"] in ("single", "pair"):
                by = case.near(w, log, D, r)
                out["near"] = sorted({e for v in by.values() for e in v} - set(case.hidden))
                if len(case.hidden) > 1:
                    out["near_by"] = by
    nu = dict(case.nu)
    for k in ("ctrl",):
        if hasattr(case, k):
            nu["controller"] = {q: v for q, v in getattr(case, k).items() if q in ("kind", "scale")}
    par = dict(w["par"])
    par["base"] = {k: v for k, v in w["law"].items()} if "law" in w else {}
    if case.kind == "drive":
        par["inertia"] = case.J
    if case.kind in ("joints", "drive") and case.hidden:
        par["acts_on"] = {h: [j + 1 for j in case.acts[h]] for h in case.hidden}
    out.update(nuisances=nu, parameters=par, values=values(case, w, D, r, spec["group"], extra), seconds=float(t[-1] - t[0]), rate_hz=case.rate)
    return plain(out)


def main():
    ap = argparse.ArgumentParser(description=__doc__)
    ap.add_argument("--seed", type=int, required=True)
    ap.add_argument("--out", required=True)
    ap.add_argument("--only", type=int)
    a = ap.parse_args()
    specs = plan(a.seed)
    extras = {s["extra"] for s in specs if "extra" in s}
    os.makedirs(a.out, exist_ok=True)
    truth_file = os.path.join(a.out, "truth.json")
    truth = []
    if a.only is not None and os.path.exists(truth_file):
        truth = [t for t in json.load(open(truth_file)) if t["case"] != f"case_{a.only:03d}"]
    t_all = time.time()
    for i, spec in enumerate(specs):
        if a.only is not None and i != a.only:
            continue
        name = f"case_{i:03d}"
        spec["used"] = extras
        t0 = time.time()
        done = None
        for n in range(14):
            rng = np.random.default_rng([a.seed, i, n, 7])
            try:
                done = attempt(spec, [a.seed, i], rng, n)
            except ERR as e:
                print(f"  {name} try {n}: {type(e).__name__} {e}", file=sys.stderr)
            if done:
                break
        if not done:
            print(f"{name}: given up ({spec['kind']} {spec['group']} {spec['hidden']})", file=sys.stderr)
            continue
        case, extra, got = done
        frng = np.random.default_rng([a.seed, i, 99])
        fmt = "parquet" if len(got[1][1]["t"]) > 30000 else str(frng.choice(["parquet", "parquet", "parquet", "parquet", "csv", "npz"]))
        case.write(got[1][0], got[1][1], os.path.join(a.out, name), fmt)
        truth.append(describe(name, spec, case, extra, got))
        truth.sort(key=lambda d: d["case"])
        with open(truth_file + ".part", "w") as f:
            json.dump(truth, f, indent=1, ensure_ascii=False)
        os.replace(truth_file + ".part", truth_file)
        d = truth[[x["case"] for x in truth].index(name)]
        print(f"{name} {case.kind:6s} {spec['group']:9s} {d['model']} + {','.join(d['hidden']) or extra or '-'}  effect {d['effect_rms']:.3g} left {d['left_rms']:.3g} "
              f"fit {d['fit_rms']:.3g} of {d['reading_rms']:.3g} {d['unit']}  near {d['near']}  try {n}  {d['seconds']:.0f} s log, {time.time() - t0:.1f} s", flush=True)
    print(f"{len(truth)} cases, {time.time() - t_all:.0f} s")


if __name__ == "__main__":
    main()
