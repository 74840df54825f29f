"""Hidden world `drakeloop`: python generate.py --seed S --out DIR [--only I] [--urdf FILE]. See README.md."""
from __future__ import annotations
import argparse
import json
import os
import time
from pathlib import Path
from typing import Any
os.environ.setdefault("OMP_NUM_THREADS", "1")
import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import joints
import tester
import wrench
from arm import Arm

RUN = {"wrench": wrench.run, "joints": joints.run, "tester": tester.run}
UNEXCITED = ("friction-anisotropy", "stiffness-inhomogeneity", "stiffening-layer")


def plan(seed: int) -> list[dict[str, Any]]:
    """The 48 cases of a seed: kind, group, base, hidden names."""
    rng = np.random.default_rng([seed, 999])
    sec = {s: [n for n, e in wrench.EFFECTS.items() if e.section == s] for s in ("normal", "tangential", "robot", "sensor")}
    perm = lambda x: [str(i) for i in rng.permutation(x)]
    N, T, R, S = (perm(sec[s]) for s in ("normal", "tangential", "robot", "sensor"))
    out: list[dict[str, Any]] = []

    def base(kind: str, hidden: list[str]) -> str:
        if kind == "joints":
            return "rigid-body"
        pools = [set((wrench.EFFECTS.get(h) or wrench.OUTSIDE.get(h) or tester.OUT.get(h)).bases) for h in hidden]
        ok = sorted(set.intersection(*pools)) if pools else ["hertz", "hunt-crossley", "kelvin-voigt", "maxwell", "zener"]
        return str(rng.choice(ok))

    def add(kind: str, group: str, hidden: list[str], long: bool = False) -> None:
        out.append(dict(kind=kind, group=group, hidden=hidden, base=base(kind, hidden), long=long))
    for h in N[:4] + T[:4] + R[:2] + S[:3]:
        add("wrench", "single", [h], h in ("stiffness-drift", "sensor-drift") and not any(c["long"] for c in out))
    J = perm(joints.SINGLES)
    for h in J[:6]:
        add("joints", "single", [h])
    used = set(N[:4])
    for h in [x for x in perm(tester.SINGLES) if x not in used][:3]:
        add("tester", "single", [h])
    for i in range(5):
        add("wrench", "none", [], i == 0 and not any(c["long"] for c in out))
    for _ in range(2):
        add("joints", "none", [])
        add("tester", "none", [])
    good_n = [n for n in ("relaxation", "hysteresis", "adhesion", "hertz-exponent", "stress-softening", "stiffening-layer", "surface-offset", "hunt-crossley-damping")]
    gn = perm(good_n)
    second = perm(["stribeck-friction", "viscous-friction", "presliding", "load-dependent-friction"])[:2] + perm(["tool-mass", "sensor-bias", "tip-offset", "sensor-misalignment", "mains-hum"])[:2]
    for a, b in zip([n for n in gn if n in ("relaxation", "hysteresis", "adhesion", "surface-offset", "stiffening-layer")], second):
        add("wrench", "pair", [a, b])
    jp = [["payload", "joint-coulomb-friction"], ["joint-viscous-friction", "rotor-inertia"], ["joint-torque-offset", "joint-stribeck-friction"], ["gravity-error", "joint-viscous-friction"],
          ["joint-spring", "joint-coulomb-friction"], ["payload", "rotor-inertia"]]
    for i in rng.permutation(len(jp))[:2]:
        add("joints", "pair", jp[i])
    tp = [["relaxation", "stiffening-layer"], ["adhesion", "relaxation"], ["stress-softening", "adhesion"], ["hertz-exponent", "viscous-damping"]]
    add("tester", "pair", tp[int(rng.integers(len(tp)))])
    for h in perm(list(wrench.OUTSIDE))[:4]:
        add("wrench", "outside", [h])
    add("joints", "outside", [perm(joints.OUT)[0]])
    add("tester", "outside", [perm(list(tester.OUT))[0]])
    add("wrench", "weak", [perm(["viscous-friction", "tool-mass", "hysteresis", "relaxation", "sensor-bias"])[0]])
    add("joints", "weak", [perm(["joint-torque-offset", "joint-spring", "payload"])[0]])
    for h in perm(UNEXCITED)[:2]:
        add("wrench", "unexcited", [h])
    return [out[i] for i in rng.permutation(len(out))]


def native(x: Any) -> Any:
    """Plain JSON types; numbers to nine digits."""
    if isinstance(x, dict):
        return {str(k): native(v) for k, v in x.items()}
    if isinstance(x, (list, tuple, np.ndarray)):
        return [native(v) for v in x]
    if isinstance(x, (bool, np.bool_)):
        return bool(x)
    if isinstance(x, (int, np.integer)):
        return int(x)
    return float(f"{float(x):.9g}") if isinstance(x, (float, np.floating)) else x


def make(arm: Arm, seed: int, i: int, c: dict[str, Any]) -> dict[str, Any]:
    """Simulate case i, again with another size of the effect where it misses its group's band."""
    g = c["group"]
    mag = {h: 1.0 for h in c["hidden"]}
    quiet, best, score, salt = 1.0, None, np.inf, 0
    need = {"single": 2.8, "pair": 2.8, "outside": 4.4}.get(g)
    for attempt in range(6):
        try:
            r = RUN[c["kind"]](np.random.default_rng([seed, i, attempt // 3 + 10 * salt]), arm, g, c["base"], list(c["hidden"]), dict(mag), c["long"], quiet)
        except (FloatingPointError, np.linalg.LinAlgError, ValueError) as e:
            print(f"  case {i} attempt {attempt}: {type(e).__name__} {e}", flush=True)
            quiet = 0.5
            continue
        ratio = {h: r["eff"][h] / max(r["left"][h], 1e-9) for h in c["hidden"]}
        if g == "none":
            return dict(r, mag=dict(mag), quiet=quiet)
        if g == "unexcited":
            h = c["hidden"][0]
            if ratio[h] < score:
                best, score = dict(r, mag=dict(mag), quiet=quiet), ratio[h]
            if ratio[h] < 0.4:
                break
            mag[h] *= 0.6
            continue
        if g == "weak":
            h = c["hidden"][0]
            bad = abs(np.log(ratio[h] / 0.6))
            if bad < score:
                best, score = dict(r, mag=dict(mag), quiet=quiet), bad
            if 0.33 < ratio[h] < 0.95:
                break
            mag[h] *= float(np.clip(0.6 / ratio[h], 0.02, 6))
            continue
        lack = {h: max(need / max(ratio[h], 1e-6), (0.064 if g == "outside" else 0.026) / max(r["share"][h], 1e-9) if h != "quantization" else 0.0) for h in c["hidden"]}
        over = r["left_forces"] > 8 * r["noise"]
        bad = max(lack.values()) + (0.2 if over else 0.0)
        if bad < score:
            best, score = dict(r, mag=dict(mag), quiet=quiet), bad
        if max(lack.values()) <= 1.0:
            break
        if over and c["kind"] == "wrench":       # stick-slip chatter: another place and controller, not a larger effect
            salt, mag, quiet = salt + 1, {h: 1.0 for h in c["hidden"]}, 0.7
            continue
        for h, l in lack.items():
            if l > 1:
                mag[h] = float(min(mag[h] * min(1.3 * l, 2.5), 4.0))
        quiet = 0.4
    if best is None:
        raise RuntimeError(f"case {i} {c} failed")
    return best


def write(folder: Path, r: dict[str, Any], fmt: str) -> None:
    """log.*, log_nodq.parquet, rig.toml."""
    folder.mkdir(parents=True, exist_ok=True)
    cols = r["cols"]
    table = pa.table({k: pa.array(v.astype(str) if v.dtype.kind == "U" else v) for k, v in cols.items()})
    if fmt == "parquet":
        pq.write_table(table, folder / "log.parquet")
    elif fmt == "csv":
        table.to_pandas().to_csv(folder / "log.csv", index=False, float_format="%.9g")
    else:
        np.savez_compressed(folder / "log.npz", **cols)
    if "dq1" in cols:
        pq.write_table(table.drop_columns([k for k in cols if k.startswith("dq")]), folder / "log_nodq.parquet")
    (folder / "rig.toml").write_text(r["rig"], encoding="utf8")


def main() -> None:
    ap = argparse.ArgumentParser(description=__doc__)
    ap.add_argument("--seed", type=int, required=True)
    ap.add_argument("--out", type=Path, required=True)
    ap.add_argument("--only", type=int)
    ap.add_argument("--urdf", default=str(Path(__file__).resolve().parents[3] / "urdf" / "lwr4plus.urdf"))
    a = ap.parse_args()
    arm, truth = Arm(a.urdf), []
    fmts = np.random.default_rng([a.seed, 77]).choice(["parquet"] * 7 + ["csv", "npz"], 64)
    for i, c in enumerate(plan(a.seed)):
        if a.only is not None and i != a.only:
            continue
        t0 = time.time()
        r = make(arm, a.seed, i, c)
        fmt = "parquet" if c["long"] or len(r["cols"]["t"]) > 20000 else str(fmts[i])
        write(a.out / f"case_{i:03d}", r, fmt)
        hid = c["hidden"]
        lead = min(hid, key=lambda h: r["eff"][h] / max(r["left"][h], 1e-9)) if hid else None
        named = [h for h in hid if c["group"] != "outside"]
        notes = [f"style {r['style']}", f"log.{fmt}", f"controller {r['nuisances']['controller']['kind']}"]
        if "about" in r:
            notes.append(f"about {r['about']}")
        if r["nuisances"].get("torque_lowpass_hz"):
            notes.append(f"torques low-passed at {r['nuisances']['torque_lowpass_hz']:.1f} Hz")
        if c["group"] == "unexcited":
            notes.append({"friction-anisotropy": "strokes along one tangent only", "stiffness-inhomogeneity": "pokes at one place only", "stiffening-layer": "never as deep as the layer"}[hid[0]])
        truth.append(native({"case": f"case_{i:03d}", "kind": c["kind"], "group": c["group"], "model": ",".join(r["model"]), "hidden": hid, "true_model": ",".join(r["model"] + named),
                             "near": r["near"], "effect_rms": r["eff"][lead] if lead else 0.0, "left_rms": r["left"][lead] if lead else r["left_forces"], "unit": r["unit"],
                             "effect_rms_each": r["eff"], "left_rms_each": r["left"], "share_of_reading": r["share"], "left_rms_all": r["left_forces"], "noise_rms": r["noise"],
                             "hidden_parameters": r["params"], "parameters": r["true"], "recovered": r["fitted"], "nuisances": r["nuisances"], "magnitude": r.get("mag", {}), "notes": "; ".join(notes)}))
        e = {h: f"{r['eff'][h]:.3g}/{r['left'][h]:.2g}={r['eff'][h]/max(r['left'][h],1e-9):.1f} sh{r['share'][h]:.2f}" for h in hid}
        print(f"{i:02d} {c['kind']:6s} {c['group']:9s} {c['base']:13s} {r['style']:8s} {r['seconds']:5.0f}s left {r['left_forces']:.3f} noise {r['noise']:.3f} {e} near {r['near']} q{r.get('quiet',1)} [{time.time()-t0:.1f}s]", flush=True)
    (a.out / "truth.json").write_text(json.dumps(truth, indent=1), encoding="utf8")


if __name__ == "__main__":
    main()
