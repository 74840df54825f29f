"""Hidden world `gears`: python generate.py --seed S --out DIR [--only I] [--urdf PATH]. See README.md."""
from __future__ import annotations

import os

for _v in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS"):
    os.environ[_v] = "1"
import argparse
import json
import time
from pathlib import Path

import numpy as np

import axis
import instruments as ins
import joints
import touch

BUILD = {"joints": joints.case, "drive": axis.case, "wrench": touch.case}
JF = ["joint-coulomb-friction", "joint-viscous-friction"]
PACE = {"joint-stribeck-friction": "slow-fast", "joint-friction-asymmetry": "rests", "rotor-inertia": "brisk", "joint-elasticity": "brisk", "time-offset": "brisk", "sensor-lag": "brisk"}
FRICTION = {"stribeck-friction", "presliding", "viscous-friction", "load-dependent-friction", "friction-anisotropy", "coulomb-friction", "wear-in"}
GOAL = {"single": (3.2, 0.03), "pair": (3.2, 0.03), "outside": (5.0, 0.075)}   # least effect / left, least effect / reading
OUT = {"cable", "warming", "load-cogging", "backlash", "hose", "squeeze", "wear-in"}


def plan(seed: int) -> list[dict]:
    """The 48 cases of a seed: kind, group, model, hidden."""
    rng = np.random.default_rng([seed, 999])
    cases: list[dict] = []

    def add(kind, group, hidden, extra=(), **opt):
        hidden = list(hidden)
        if kind == "wrench":
            base = opt.pop("base", None) or str(rng.choice(["kelvin-voigt", "hunt-crossley", "kelvin-voigt", "hooke"]))
            if {"viscous-damping", "hunt-crossley-damping", "squeeze"} & set(hidden) and base != "hooke":
                base = "hooke"
            if "wear-in" in hidden:
                base = "kelvin-voigt"
            slide = opt.pop("slide", None)
            slide = False if {"viscous-damping", "hunt-crossley-damping", "squeeze"} & set(hidden) and not FRICTION & set(hidden) else slide
            slide = bool(FRICTION & set(hidden)) or bool(rng.random() < 0.5) if slide is None else slide
            law = ["coulomb-friction"] if slide and "coulomb-friction" not in hidden else []
            if law and rng.random() < 0.3 and not {"presliding", "stribeck-friction", "viscous-friction"} & set(hidden):
                law += [str(rng.choice(["presliding", "friction-rounding", "stribeck-friction"]))]
            model, opt["slide"] = [base] + law + list(extra), slide
        else:
            need = {"joint-friction-asymmetry", "joint-stribeck-friction", "joint-load-friction"} & set(hidden)
            model = ["rigid-body"]
            link = kind == "joints" and not need and rng.random() < 0.2 and not {"warming", "cable"} & set(hidden)
            model += [f for f in JF if f not in hidden and (not link or need)]
            more = [e for e in ("joint-torque-offset", "joint-load-friction", "rotor-inertia", "joint-spring") if e not in hidden and not (kind == "drive" and e == "rotor-inertia")]
            if rng.random() < 0.35 and not extra:
                e = str(rng.choice(more))
                clash = {"joint-torque-offset": {"joint-friction-asymmetry", "joint-spring"}, "joint-load-friction": {"joint-coulomb-friction", "joint-stribeck-friction", "load-cogging"}}.get(e, set())
                if not clash & set(hidden) and (e != "joint-load-friction" or "joint-coulomb-friction" in model):
                    model.append(e)
            model += list(extra)
            for h in hidden:
                opt.setdefault("pace", PACE[h]) if h in PACE else None
        cases.append({"kind": kind, "group": group, "model": model, "hidden": hidden, **opt})

    pool = ["joint-coulomb-friction", "joint-friction-asymmetry", "joint-stribeck-friction", "joint-load-friction", "joint-torque-ripple", "joint-spring", "joint-elasticity",
            "sensor-lag", "time-offset", "quantization", "joint-viscous-friction", "joint-torque-offset"]
    pick = lambda xs, n: [str(x) for x in rng.choice(xs, n, replace=False)]
    drives = pick(pool, 5)
    for e in drives:
        add("drive", "single", [e], *([["joint-spring"]] if e == "joint-load-friction" else []))
    for e in ["payload", "gravity-error", "rotor-inertia", "joint-torque-gain"] + [p for p in pool if p not in drives]:
        add("joints", "single", [e])
    for e in pick(["stribeck-friction", "presliding", "viscous-friction", "load-dependent-friction", "friction-anisotropy", "coulomb-friction"], 3) + pick(
            ["viscous-damping", "hunt-crossley-damping", "relaxation", "tool-mass", "stiffness-inhomogeneity", "sensor-bias", "sensor-crosstalk"], 3):
        add("wrench", "single", [e], slide=True if e in ("sensor-crosstalk", "stiffness-inhomogeneity") else None)
    for i, kind in enumerate(["joints"] * 4 + ["drive"] * 2 + ["wrench"] * 3):
        extra = [["joint-torque-ripple"], [], ["joint-stribeck-friction"], ["payload"], ["joint-stribeck-friction"], ["joint-torque-ripple"], [], ["sensor-bias"], []][i] if rng.random() < 0.6 else []
        add(kind, "none", [], extra, **({"pace": "slow-fast"} if "joint-stribeck-friction" in extra else {}), **({"slide": i != 7} if kind == "wrench" else {}))
    jp = [["payload", "joint-stribeck-friction"], ["rotor-inertia", "joint-torque-offset"], ["gravity-error", "joint-load-friction"], ["joint-torque-ripple", "joint-spring"],
          ["payload", "joint-torque-ripple"], ["joint-viscous-friction", "joint-torque-offset"], ["joint-coulomb-friction", "rotor-inertia"], ["joint-torque-gain", "joint-coulomb-friction"]]
    dp = [["joint-stribeck-friction", "joint-spring"], ["joint-torque-ripple", "joint-viscous-friction"], ["joint-torque-offset", "joint-torque-ripple"], ["joint-load-friction", "joint-spring"],
          ["joint-coulomb-friction", "joint-spring"], ["joint-elasticity", "joint-torque-offset"]]
    wp = [["viscous-damping", "coulomb-friction"], ["relaxation", "viscous-friction"], ["tool-mass", "friction-anisotropy"], ["sensor-bias", "viscous-friction"], ["sensor-bias", "presliding"],
          ["stiffness-inhomogeneity", "load-dependent-friction"]]
    for kind, pairs, n in (("joints", jp, 3), ("drive", dp, 2), ("wrench", wp, 2)):
        for i in rng.choice(len(pairs), n, replace=False):
            add(kind, "pair", pairs[i], slide=True) if kind == "wrench" else add(kind, "pair", pairs[i])
    long_arm = rng.random() < 0.5
    add("joints", "outside", ["cable"])
    add("joints", "outside", ["warming"], T=150.0) if long_arm else add("joints", "outside", ["load-cogging"])
    add("drive", "outside", ["backlash"])
    add("drive", "outside", ["load-cogging"]) if long_arm else add("drive", "outside", ["warming"], T=200.0)
    for e in pick(["hose", "squeeze", "wear-in"], 2):
        add("wrench", "outside", [e])
    add("joints", "weak", pick(["joint-spring", "joint-torque-ripple", "joint-load-friction"], 1))
    add("wrench", "weak", pick(["viscous-damping", "viscous-friction", "friction-anisotropy"], 1))
    add("joints", "unexcited", ["rotor-inertia"], pace="static")
    add("drive", "unexcited", ["joint-stribeck-friction"], pace="fast")
    order = rng.permutation(len(cases))
    return [cases[i] for i in order]


def build(seed: int, i: int, spec: dict, urdf: str) -> dict:
    """One case; the hidden effect's size is raised (weak: set) until the group's signal-to-noise holds."""
    amps = {h: (0.5 if spec["group"] == "weak" else 1.0) for h in spec["hidden"]}
    top = None
    for _ in range(4):
        c = BUILD[spec["kind"]](np.random.default_rng([seed, i]), spec, amps, urdf)
        c["amps"] = dict(amps)
        done, worst = True, 9.0
        for h, e in c["each"].items():
            if spec["group"] == "weak":
                x = 0.6 * c["left"] / max(e, 1e-9)
                if not 0.4 <= 0.6 / x <= 0.9:
                    amps[h], done = amps[h] * x, False
            elif spec["group"] in GOAL:
                a, b = GOAL[spec["group"]]
                need = max(a * c["left"], b * c["reading"])
                worst = min(worst, e / need)
                if e < need:
                    amps[h], done = amps[h] * min(2.5, max(1.15, 1.15 * need / max(e, 1e-9))), False
        top = (worst, c) if top is None or worst >= top[0] else top
        if done:
            break
    return c if spec["group"] == "weak" else top[1]


def plain(x):
    """JSON-able numbers of 6 digits."""
    if isinstance(x, dict):
        return {k: plain(v) for k, v in x.items()}
    if isinstance(x, (list, tuple, np.ndarray)):
        return [plain(v) for v in x]
    if isinstance(x, (bool, np.bool_)):
        return bool(x)
    if isinstance(x, (float, np.floating)):
        return float(f"{x:.6g}")
    return int(x) if isinstance(x, np.integer) else x


def main() -> None:
    ap = argparse.ArgumentParser(description=__doc__)
    ap.add_argument("--seed", type=int, required=True)
    ap.add_argument("--out", type=Path, required=True)
    ap.add_argument("--only", type=int)
    ap.add_argument("--urdf", default=str(Path(__file__).resolve().parents[3] / "urdf" / "lwr4plus.urdf"))
    a = ap.parse_args()
    a.out.mkdir(parents=True, exist_ok=True)
    path, truth = a.out / "truth.json", []
    for i, spec in enumerate(plan(a.seed)):
        if a.only is not None and i != a.only:
            continue
        t0, name = time.time(), f"case_{i:03d}"
        c = build(a.seed, i, spec, a.urdf)
        folder = a.out / name
        folder.mkdir(exist_ok=True)
        fmt = {3: "csv", 7: "npz"}.get(i % 16, "parquet")
        for old in folder.glob("log*"):
            old.unlink()
        ins.write(folder, c["cols"], fmt)
        (folder / "rig.toml").write_text(c["rig"])
        real = [h for h in spec["hidden"] if h not in OUT]
        e = min(c["each"].values()) if c["each"] else 0.0
        truth.append(plain({"case": name, "kind": spec["kind"], "group": spec["group"], "model": ",".join(spec["model"]), "hidden": spec["hidden"],
                            "true_model": ",".join(spec["model"] + real), "near": c["near"], "effect_rms": e, "left_rms": c["left"], "unit": c["unit"], "nuisances": c["nuisances"],
                            "effect_rms_each": c["each"], "reading_rms": c["reading"], "parameters": c["par"], "log": f"log.{fmt}",
                            "by_joint": c.get("by_joint", []), "notes": spec.get("pace", "") + (f" torque low-passed at {c['nuisances']['torque_lowpass_hz']:.1f} Hz (first order)" if c["nuisances"].get("torque_lowpass_hz") else "")}))
        r = truth[-1]
        print(f"{name} {spec['kind']:7s} {spec['group']:9s} {r['model']:70s} {'+'.join(spec['hidden']):45s} e {e:.3g} left {c['left']:.3g} e/l {e / c['left']:.2f} e/read {e / c['reading']:.3f} "
              f"left/read {c['left'] / c['reading']:.4f} near {c['near']} amp {[round(x, 2) for x in c['amps'].values()]} {len(c['cols']['t'])} rows {time.time() - t0:.1f} s", flush=True)
    if a.only is not None and path.exists():
        old = {r["case"]: r for r in json.loads(path.read_text())}
        truth = list((old | {r["case"]: r for r in truth}).values())
    path.write_text(json.dumps(sorted(truth, key=lambda r: r["case"]), indent=1))


if __name__ == "__main__":
    main()
