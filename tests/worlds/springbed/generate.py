"""python generate.py --seed S --out DIR [--only I] [--urdf FILE]: writes 48 cases of the world `springbed` and DIR/truth.json."""
from __future__ import annotations

import argparse
import json
import time
from pathlib import Path

import numpy as np

import arm as am
import contact
import joints

CF = "coulomb-friction"
RB = ["rigid-body", "joint-coulomb-friction", "joint-viscous-friction"]
NORMAL = {"hertz-exponent": ["kelvin-voigt"], "viscous-damping": ["hooke", CF], "hunt-crossley-damping": ["hooke"], "relaxation": ["kelvin-voigt"],
          "hysteresis": ["kelvin-voigt"], "stress-softening": ["kelvin-voigt"], "adhesion": ["kelvin-voigt"], "stiffening-layer": ["kelvin-voigt", CF],
          "surface-offset": ["hertz"], "stiffness-drift": ["kelvin-voigt"], "stiffness-inhomogeneity": ["kelvin-voigt", CF]}
TANG = {"coulomb-friction": ["kelvin-voigt"], "viscous-friction": ["hertz", CF], "stribeck-friction": ["kelvin-voigt", CF], "presliding": ["hunt-crossley", CF],
        "friction-rounding": ["kelvin-voigt", CF], "load-dependent-friction": ["hunt-crossley", CF], "friction-anisotropy": ["kelvin-voigt", CF]}
TOOL = {"tool-mass": ["none"], "tool-com": ["kelvin-voigt"], "tool-inertia": ["none"], "structural-compliance": ["hertz"], "tip-offset": ["kelvin-voigt", CF]}
SENS = {"sensor-bias": ["kelvin-voigt", CF], "sensor-drift": ["kelvin-voigt"], "sensor-crosstalk": ["hertz", CF], "sensor-misalignment": ["kelvin-voigt", CF],
        "sensor-gain": ["none"], "sensor-lag": ["hertz"], "time-offset": ["hertz"], "saturation": ["hooke"], "quantization": ["kelvin-voigt", CF], "mains-hum": ["kelvin-voigt"]}
JOINT = {"joint-coulomb-friction": ["rigid-body", "joint-viscous-friction"], "joint-viscous-friction": RB[:2], "joint-friction-asymmetry": RB, "joint-torque-offset": RB,
         "rotor-inertia": RB, "joint-torque-gain": RB, "payload": RB, "joint-elasticity": RB + ["rotor-inertia"], "gravity-error": RB, "joint-stribeck-friction": RB, "joint-load-friction": RB,
         "joint-torque-ripple": RB + ["joint-torque-offset"], "joint-spring": RB + ["joint-torque-offset"]}
TEST = ["relaxation", "hysteresis", "stress-softening", "adhesion", "stribeck-friction", "presliding", "hertz-exponent", "hunt-crossley-damping", "stiffening-layer", "viscous-friction", "mains-hum", "quantization"]
DRIVE = ["joint-stribeck-friction", "joint-torque-ripple", "joint-friction-asymmetry", "joint-spring", "joint-torque-offset", "joint-viscous-friction"]
PAIRS = [(["kelvin-voigt", CF], ["stiffening-layer", "friction-anisotropy"]), (["hooke", CF], ["hertz-exponent", "viscous-friction"]),
         (["kelvin-voigt", CF], ["stiffness-inhomogeneity", "presliding"]), (["kelvin-voigt"], ["adhesion", "sensor-bias"]), (["kelvin-voigt", CF], ["hysteresis", "stribeck-friction"]),
         (["hertz", CF], ["viscous-damping", "sensor-crosstalk"]), (["hooke", CF], ["hunt-crossley-damping", "load-dependent-friction"]), (["kelvin-voigt"], ["relaxation", "sensor-drift"])]
JPAIRS = [["joint-stribeck-friction", "payload"], ["joint-torque-ripple", "rotor-inertia"], ["joint-load-friction", "gravity-error"], ["joint-torque-offset", "rotor-inertia"], ["joint-spring", "joint-stribeck-friction"]]
OUT_NEAR = {"lift": [], "wave": ["stiffness-inhomogeneity", "surface-offset"], "puncture": ["stress-softening"], "hose": [], "plough": [], "moving-base": [], "warm-up": ["joint-viscous-friction"],
            "position-friction": ["joint-torque-ripple"], "brake": ["joint-stribeck-friction", "joint-viscous-friction"]}
OUT_NOTE = {"lift": "normal force grows with slip speed (lubrication lift)", "wave": "surface is wavy, 3-20 % of the depth", "puncture": "springs break for good beyond a depth (crust)",
            "hose": "umbilical: a spring from the tool to a hook, in the air too", "plough": "elastic side force of a ribbed texture: depth x sin(place)", "moving-base": "the arm stands on a swaying cart",
            "warm-up": "viscous friction falls as the drives warm up (tau 45 s; cf. Bittencourt & Gunnarsson 2012)", "position-friction": "friction changes with the angle (eccentric gear, cf. Armstrong 1991)",
            "brake": "eddy-current brake torque peaking at 0.5 rad/s (Smythe 1942)"}


def make_plan(seed: int) -> list[dict]:
    """The 48 case specifications of a seed."""
    r = np.random.default_rng([seed, 777])
    pick = lambda xs, n: [xs[i] for i in r.permutation(len(xs))[:n]]
    P: list[dict] = []
    add = lambda kind, group, model, hidden=(), **kw: P.append(dict(kind=kind, group=group, model=list(model), hidden=list(hidden), **kw))
    for pool, n in ((NORMAL, 4), (TANG, 3), (TOOL, 2), (SENS, 3)):
        for h in pick(sorted(pool), n):
            base = list(pool[h])
            if base == ["kelvin-voigt"] and h in ("sensor-lag", "mains-hum", "hum") and r.random() < .5:
                base = ["hunt-crossley", CF]
            if h in ("tool-mass", "sensor-gain") and r.random() < .5:
                base = ["kelvin-voigt"]
            add("wrench", "single", base, [h])
    used = {p["hidden"][0] for p in P}
    for h in pick(sorted(JOINT), 5):
        add("joints", "single", JOINT[h], [h])
    used |= {p["hidden"][0] for p in P}
    for h in pick([h for h in TEST if h not in used], 3):
        m = (NORMAL | TANG | SENS)[h]
        add("tester", "single", ["kelvin-voigt", CF] if h in ("hysteresis", "mains-hum", "quantization") and r.random() < .5 else m, [h])
    for h in pick([h for h in DRIVE if h not in used] or DRIVE, 2):
        add("drive", "single", JOINT[h] if h != "joint-viscous-friction" else RB[:2], [h])
    for m in (["kelvin-voigt", CF], ["hertz"], ["hunt-crossley", CF, "presliding"], ["zener"], ["none"] if seed % 2 else ["hertz", CF, "viscous-friction"]):
        add("wrench", "none", m)
    add("joints", "none", RB, T=float(r.uniform(140, 200)), rate=100.0)
    add("joints", "none", RB + ["joint-torque-offset", "rotor-inertia"])
    add("tester", "none", ["kelvin-voigt", CF])
    add("drive", "none", RB + ["joint-torque-offset", "joint-stribeck-friction"])
    for m, h in pick(PAIRS, 4):
        add("wrench", "pair", m, h)
    for h in pick(JPAIRS, 2):
        add("joints", "pair", RB, h)
    add("tester", "pair", *[(["kelvin-voigt", CF], ["relaxation", "stribeck-friction"]), (["hooke", CF], ["viscous-damping", "viscous-friction"])][seed % 2])
    for o in pick(["lift", "wave", "puncture", "hose", "plough"], 3):
        add("wrench", "outside", ["kelvin-voigt"] if o == "puncture" else ["kelvin-voigt", CF], outside=o)
    o = ["moving-base", "warm-up"][seed % 2]
    add("joints", "outside", RB, outside=o, **(dict(T=160.0, rate=100.0) if o == "warm-up" else {}))
    o = ["puncture", "lift"][seed % 2]
    add("tester", "outside", ["kelvin-voigt"] if o == "puncture" else ["kelvin-voigt", CF], outside=o)
    add("drive", "outside", RB, outside=["brake", "position-friction"][seed % 2])
    for h in pick(["viscous-damping", "hysteresis", "friction-anisotropy", "hertz-exponent", "structural-compliance", "stribeck-friction"], 2):
        add("wrench", "weak", (NORMAL | TANG | TOOL)[h], [h])
    for u, m, h in pick([("layer", ["kelvin-voigt", CF], "stiffening-layer"), ("stribeck", ["hertz", CF], "stribeck-friction"), ("aniso", ["kelvin-voigt", CF], "friction-anisotropy"),
                         ("load", ["kelvin-voigt", CF], "load-dependent-friction")], 2):
        add("wrench", "unexcited", m, [h], unexcited=u, notes=f"unexcited because: {u}.")
    for p in P:
        if p["kind"] in ("tester", "drive") and r.random() < .5 or r.random() < .08:
            p["fmt"] = str(r.choice(["csv", "npz"]))
    return [P[i] for i in r.permutation(len(P))]


def build(seed: int, i: int, spec: dict, A: am.Arm, folder: Path) -> dict:
    """Tune the hidden effect's strength to its group's band, then write the case. Returns its truth record."""
    run = joints.run_case if spec["kind"] in ("joints", "drive") else contact.run_case
    g, out = spec["group"], spec.get("outside")
    if out:
        spec["notes"] = f"outside: {OUT_NOTE[out]}."
    want = {"single": (2.9, 30, 6), "pair": (2.9, 40, 5), "outside": (4.6, 60, 8), "weak": (.35, .9, .6)}.get(g, (-1, 1e9, 1))
    if g == "unexcited":
        want = (-1, .45, 0)
    for attempt in range(5):
        sd, amp, r = [seed, i, attempt], (.35 if g == "weak" else 1.0), None
        try:
            left0 = run(sd, spec, A, None, 0.0)["left_rms"] if out and spec["kind"] in ("wrench", "tester") else None
            for tries in range(5 if g in ("single", "pair", "outside", "weak") else 1):
                r = run(sd, spec, A, None, amp) if g not in ("none",) else run(sd, spec, A, folder, amp)
                if left0 is not None:
                    r["effect_rms"], r["left_rms"] = float(np.sqrt(max(r["left_rms"] ** 2 - left0 ** 2, 0))), left0
                ratio = r["effect_rms"] / max(r["left_rms"], 1e-12)
                small = out and r["effect_rms"] < .065 * r["reading_rms"]
                ok = want[0] <= ratio <= want[1] and not small
                if ok or amp > 4.0 or not spec["hidden"] and not out:
                    break
                amp *= float(np.clip(max(want[2] / max(ratio, 1e-3), .085 * r["reading_rms"] / max(r["effect_rms"], 1e-9) if small else 0), .05 if g == "weak" else .25, 2.2))
            else:
                ok = False
        except (AssertionError, np.linalg.LinAlgError, FloatingPointError) as e:
            print("   retry", i, spec["hidden"], str(e)[:150], flush=True)
            ok = False
        if ok:
            break
    if r is None:
        raise RuntimeError(f"case {i}: no attempt succeeded: {spec}")
    if g != "none":
        keep = {k: r[k] for k in ("effect_rms", "left_rms")}
        r = run(sd, spec | {"judge": True}, A, folder, amp) | keep
    near = OUT_NEAR.get(out, []) if out else r["near"]
    mod, hid = spec["model"], spec["hidden"]
    return {"case": f"case_{i:03d}", "kind": spec["kind"], "group": g, "model": ",".join(mod), "hidden": hid, "true_model": ",".join(mod + hid), "near": near,
            "effect_rms": r["effect_rms"], "left_rms": r["left_rms"], "unit": r["unit"], "reading_rms": r["reading_rms"], "each": r.get("each", {}), "noise_rms": r["noise_rms"],
            "in_band": bool(ok), "amplitude": amp, "nuisances": r["nuisances"], "notes": (f"hidden effect: {out}. " if out else "") + r["notes"]}


def main() -> None:
    """Command line."""
    ap = argparse.ArgumentParser(description=__doc__)
    ap.add_argument("--seed", type=int, required=True)
    ap.add_argument("--out", type=Path, required=True)
    ap.add_argument("--only", type=int)
    ap.add_argument("--urdf", default=str(Path(__file__).resolve().parents[3] / "urdf" / "lwr4plus.urdf"))
    a = ap.parse_args()
    A, plan = am.load(a.urdf), make_plan(a.seed)
    a.out.mkdir(parents=True, exist_ok=True)
    tf, truth = a.out / "truth.json", {}
    if a.only is not None and tf.exists():
        truth = {t["case"]: t for t in json.loads(tf.read_text())}
    for i, spec in enumerate(plan):
        if a.only is not None and i != a.only:
            continue
        t0 = time.time()
        rec = build(a.seed, i, spec, A, a.out / f"case_{i:03d}")
        truth[rec["case"]] = rec
        print(f"{rec['case']} {rec['kind']:6} {rec['group']:9} {rec['model']} + {rec['hidden'] or spec.get('outside', '')}: effect {rec['effect_rms']:.4f} left {rec['left_rms']:.4f} noise {rec['noise_rms']:.4f} "
              f"reading {rec['reading_rms']:.3f} {rec['unit']} near {rec['near']} band {rec['in_band']} amp {rec['amplitude']:.2f} {time.time() - t0:.1f} s", flush=True)
        tf.write_text(json.dumps([truth[k] for k in sorted(truth)], indent=1, default=lambda o: o.item()))


if __name__ == "__main__":
    main()
