"""Writes the hidden world `mujocoloop`: python generate.py --seed S --out DIR [--only I] [--urdf FILE]."""
from __future__ import annotations

from pathlib import Path
import argparse
import json
import os
import time

os.environ.setdefault("OMP_NUM_THREADS", "1")
import numpy as np
import joints
import logio
import wrench


def plan(seed: int) -> list[tuple]:
    """The cases of a seed: (kind, group, hidden, outside)."""
    r = np.random.default_rng([seed, 999])
    pick = lambda pool, n: [pool[i] for i in r.permutation(len(pool))[:n]]
    c: list[tuple] = []
    for pool, n in ((wrench.NORMAL, 5), (wrench.TANGENT, 3), (wrench.TOOLING, 2), (wrench.SENSOR, 3)):
        c += [("wrench", "single", [h], None) for h in pick(pool, n)]
    d = pick(joints.DRIVE, 2)
    c += [("drive", "single", [h], None) for h in d]
    c += [("joints", "single", [h], None) for h in pick([h for h in joints.JOINT if h not in d], 7)]
    c += [("wrench", "none", [], "long" if i == 0 else None) for i in range(5)] + [("joints", "none", [], None)] * 3 + [("drive", "none", [], None)]
    c += [("wrench", "pair", list(p), None) for p in pick(wrench.PAIRS, 4)] + [("joints", "pair", list(p), None) for p in pick(joints.PAIRS, 2)]
    c += [("drive", "pair", list(pick(joints.DRIVE_PAIRS, 1)[0]), None)]
    c += [("wrench", "outside", [], o) for o in pick(wrench.OUTSIDE, 4)] + [("joints", "outside", [], pick(joints.OUTSIDE, 1)[0]), ("drive", "outside", [], pick(joints.DRIVE_OUTSIDE, 1)[0])]
    c += [("wrench", "weak", pick(["relaxation", "viscous-friction", "sensor-bias", "sensor-crosstalk", "tool-com", "viscous-damping", "hysteresis"], 1), None)]
    c += [("joints", "weak", pick(["joint-torque-offset", "joint-spring", "joint-stribeck-friction", "payload"], 1), None)]
    c += [("wrench", "unexcited", pick(wrench.UNEXCITED, 1), None), ("joints", "unexcited", pick(joints.UNEXCITED, 1), None)]
    return [c[i] for i in r.permutation(len(c))]


def build(seed: int, i: int, case: tuple, urdf: str) -> dict:
    """One case; its hidden effects are made stronger or weaker until they stand where the group wants them."""
    kind, group, hidden, outside = case
    long, outside = outside == "long", None if outside == "long" else outside
    n = len(hidden) + (outside is not None)
    low, aim, high = {"single": (2.7, 4.5, 25), "pair": (2.7, 4.5, 25), "outside": (4.3, 7, 30), "weak": (0.4, 0.65, 0.9), "unexcited": (0, 0, 0.2)}.get(group, (0, 1, 1e9))
    high = 1e9 if "coulomb-friction" in hidden else high
    best, best_miss = None, np.inf
    for attempt in range(3):
        g = np.ones(n)
        for step in range(4):
            rng = np.random.default_rng([seed, i, attempt])
            if kind == "wrench":
                r = wrench.make(rng, urdf, group, hidden, outside, g, True, long)
            else:
                r = joints.make(rng, urdf, group, hidden, outside, g, kind == "drive")
            rat = np.array([r["ratios"][h] for h in r["hidden"]]) if n else np.array([])
            lo = np.full(len(rat), low)
            if group == "outside":
                share = r["effect"][outside] / r["reading"]
                lo = lo * max(1.0, 0.065 / share * rat[0] / low)
            miss = float(np.sum(np.maximum(0, np.log((lo + 1e-12) / (rat + 1e-12))) + np.maximum(0, np.log((rat + 1e-12) / np.maximum(high, 1.5 * lo) + 1e-12)))) if len(rat) else 0.0
            if miss < best_miss:
                best, best_miss = r, miss
            if miss == 0:
                return best
            goal = np.where(rat < lo, np.maximum(aim, 1.3 * lo), np.where(rat > np.maximum(high, 1.5 * lo), 0.6 * high if group != "weak" else aim, rat))
            g = g * np.clip((goal / np.maximum(rat, 1e-9)) ** (1.0 if group == "weak" else 1.1), 0.15, 4)
            if np.any(g > 8):
                break
    print(f"  case {i} {case}: wanted strength not reached: {best['ratios']}", flush=True)
    return best


def main() -> None:
    """Command line."""
    p = argparse.ArgumentParser(description=__doc__)
    p.add_argument("--seed", type=int, required=True)
    p.add_argument("--out", required=True)
    p.add_argument("--only", type=int)
    p.add_argument("--urdf", default=str(Path(__file__).resolve().parents[3] / "urdf" / "lwr4plus.urdf"))
    a = p.parse_args()
    truth = []
    os.makedirs(a.out, exist_ok=True)
    for i, case in enumerate(plan(a.seed)):
        if a.only is not None and i != a.only:
            continue
        t0 = time.time()
        r = build(a.seed, i, case, a.urdf)
        name = f"case_{i:03d}"
        fmt = str(np.random.default_rng([a.seed, i, 77]).choice(["parquet", "csv", "npz"], p=[0.86, 0.06, 0.08]))
        fmt = "parquet" if fmt == "csv" and len(r["cols"]["t"]) > 15000 else fmt
        logio.write(os.path.join(a.out, name), r["cols"], r["rig"], fmt)
        h = r["worst"]
        t = r["cols"]["t"]
        d = {"case": name, "kind": r["kind"], "group": r["group"], "model": ",".join(r["model"]), "hidden": r["hidden"], "true_model": ",".join(r["true"]), "near": r["near"],
             "effect_rms": r["effect"].get(h, 0.0), "left_rms": r["left"].get(h, next(iter(r["left"].values()))), "unit": r["unit"], "reading_rms": r["reading"],
             "effects": {k: {"effect_rms": v, "left_rms": r["left"][k]} for k, v in r["effect"].items()}, "nuisances": r["nuisances"], "notes": "; ".join(r["notes"]),
             "parameters": r["truth"], "seconds": float(t[-1] - t[0]), "rows": len(t)}
        truth.append(d)
        print(f"{name} {r['kind']:7s}{r['group']:10s}{'+'.join(r['hidden']) or '-':40s} effect {d['effect_rms']:.4g} left {d['left_rms']:.4g} {d['unit']} reading {r['reading']:.3g} "
              f"{t[-1]:.0f}s n={len(t)} near {r['near']} took {time.time() - t0:.1f}s", flush=True)
        json.dump(truth, open(os.path.join(a.out, "truth.json"), "w"), indent=1, default=float)


if __name__ == "__main__":
    main()
