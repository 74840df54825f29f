"""sanderling: python generate.py --seed S --out DATA [--only CASE,CASE]"""
import os
os.environ.setdefault("OMP_NUM_THREADS", "1")
import argparse, json, sys, time
sys.path.insert(0, os.path.dirname(os.path.abspath(__file__)))
import numpy as np


def plan(seed):
    r = np.random.default_rng([seed, 777])
    pick = lambda xs, n: [str(x) for x in r.permutation(xs)[:n]]
    norm = pick("relaxation hysteresis stress-softening adhesion stiffening-layer hertz-exponent hunt-crossley-damping viscous-damping surface-offset stiffness-drift stiffness-inhomogeneity".split(), 11)
    tang = pick("coulomb-friction viscous-friction stribeck-friction presliding friction-rounding load-dependent-friction friction-anisotropy".split(), 7)
    sens = pick("sensor-bias sensor-drift sensor-crosstalk sensor-misalignment sensor-lag time-offset saturation mains-hum".split(), 8)
    rob = pick("structural-compliance tip-offset".split(), 2)
    free = pick("tool-mass tool-com sensor-gain sensor-misalignment sensor-drift sensor-crosstalk sensor-lag".split(), 7)
    jt = pick("joint-torque-offset joint-coulomb-friction joint-viscous-friction payload joint-torque-gain gravity-error joint-spring joint-load-friction rotor-inertia".split(), 9)
    dr = pick("joint-torque-ripple joint-stribeck-friction joint-spring joint-torque-offset joint-viscous-friction".split(), 5)
    C = []
    for e in norm[:4] + tang[:4] + sens[:3] + rob[:1]: C.append(("one", "C", [e], None))
    for e in norm[4:6]: C.append(("one", "T", [e], None))
    for e in free[:3]: C.append(("one", "F", [e], None))
    for e in jt[:3]: C.append(("one", "J", [e], None))
    for e in dr[:2]: C.append(("one", "D", [e], None))
    C += [("quiet", "C", [], None)] * 4 + [("quiet", "F", [], None), ("quiet", "J", [], None), ("quiet", "D", [], "long"), ("quiet", "T", [], None), ("quiet", "T", [], "long")]
    lone = [e for e in norm[6:] if e not in ("viscous-damping",)]
    pairs = [[lone[0], sens[3]], [lone[1], tang[4]], [rob[1], tang[5]], [sens[4], tang[6]]]
    for p in pairs: C.append(("two", "C", p, None))
    C.append(("two", "T", [lone[2], str(r.choice(["sensor-drift", "time-offset", "sensor-lag"]))], None))
    C.append(("two", "J", jt[3:5], None)); C.append(("two", "D", dr[2:4], None))
    C += [("outside", "C", [], "pulse"), ("outside", "C", [], "switch"), ("outside", "C", [], "bumps"), ("outside", "F", [], "slosh"), ("outside", "J", [], "tugs"), ("outside", "D", [], "gusts")]
    ne = [("C", ["stiffening-layer"], None), ("C", ["viscous-friction"], "no-slides"), ("C", ["stiffness-inhomogeneity"], None), ("C", ["saturation"], None), ("C", ["stribeck-friction"], "no-slides"),
          ("T", ["stiffening-layer"], None), ("T", ["saturation"], None)]
    i = r.permutation(5)[:2]; j = 5 + int(r.integers(2))
    for k in list(i) + [j]: C.append(("not-excited", *ne[k]))
    C.append(("not-excited", "D", ["joint-stribeck-friction"], "fast-only") if r.random() < .5 else ("not-excited", "F", ["tool-inertia"], "static"))
    o = r.permutation(len(C))
    return [C[k] for k in o]


if __name__ == "__main__":
    a = argparse.ArgumentParser(); a.add_argument("--seed", type=int, required=True); a.add_argument("--out", required=True); a.add_argument("--only", default="")
    a = a.parse_args()
    os.makedirs(a.out, exist_ok=True)
    import cases
    P = plan(a.seed); assert len(P) == 48, len(P)
    only = set(x if x.startswith("sand") else f"sanderling_{int(x):02d}" for x in a.only.split(",") if x)
    f = f"{a.out}/truth.json"
    rows = {r["case"]: r for r in json.load(open(f))} if only and os.path.exists(f) else {}
    t0 = time.time()
    for n, (g, k, h, s) in enumerate(P, 1):
        c = f"sanderling_{n:02d}"
        if only and c not in only: continue
        try:
            rows[c] = cases.Case(n, g, k, h, a.seed, a.out, s).make(lambda x: print(x, flush=True), 310)
        except Exception:
            import traceback; print(c, g, k, h, traceback.format_exc(), flush=True)
    json.dump([rows[c] for c in sorted(rows)], open(f + ".part", "w"), indent=1); os.replace(f + ".part", f)
    print(f"{len(rows)} cases, {time.time()-t0:.0f} s ({time.process_time():.0f} s of a core), violations: {sum(bool(r['violations']) for r in rows.values())}")
