"""plover: 48 logs with hidden physical effects. generate.py --seed S --out DATA"""
import argparse, json, os, sys, time
from multiprocessing import Pool
import numpy as np

R, T, B, J, Dr = "robot", "tester", "tribo", "joint", "drive"
NORMAL = {"hertz-exponent": ["hertz"], "viscous-damping": ["hooke"], "hunt-crossley-damping": ["hertz"], "relaxation": ["hooke", "kelvin-voigt", "hertz"], "hysteresis": ["hooke", "kelvin-voigt"],
          "stress-softening": ["hooke", "kelvin-voigt", "hertz"], "adhesion": ["hertz", "hooke"], "stiffening-layer": ["hooke", "kelvin-voigt"], "surface-offset": ["hertz", "kelvin-voigt", "hunt-crossley"],
          "stiffness-drift": ["hooke", "kelvin-voigt"], "stiffness-inhomogeneity": ["hooke", "kelvin-voigt"]}
TANG = ["coulomb-friction", "viscous-friction", "stribeck-friction", "presliding", "friction-rounding", "load-dependent-friction", "friction-anisotropy"]
ROB = ["tool-mass", "tool-com", "tool-inertia", "structural-compliance", "tip-offset"]
JOI = ["joint-coulomb-friction", "joint-viscous-friction", "joint-friction-asymmetry", "joint-torque-offset", "rotor-inertia", "joint-torque-gain", "payload", "joint-elasticity", "gravity-error",
       "joint-stribeck-friction", "joint-load-friction", "joint-torque-ripple", "joint-spring"]
DRV = ["joint-coulomb-friction", "joint-viscous-friction", "joint-friction-asymmetry", "joint-torque-offset", "joint-stribeck-friction", "joint-torque-ripple", "joint-spring"]
SEN = ["sensor-bias", "sensor-drift", "sensor-crosstalk", "sensor-misalignment", "sensor-gain", "sensor-lag", "time-offset", "saturation", "quantization", "mains-hum"]
TSEN = ["saturation", "quantization", "mains-hum", "time-offset", "sensor-lag"]
LAWS = ["hooke", "kelvin-voigt", "hertz", "hunt-crossley", "zener"]
TWO_R = [("stiffening-layer", "friction-anisotropy"), ("relaxation", "tool-mass"), ("surface-offset", "viscous-friction"), ("sensor-bias", "stribeck-friction"), ("sensor-drift", "hysteresis"), ("tool-com", "presliding"),
         ("time-offset", "friction-anisotropy"), ("sensor-gain", "relaxation"), ("tip-offset", "relaxation"), ("sensor-crosstalk", "stress-softening"), ("saturation", "coulomb-friction"), ("tool-mass", "viscous-friction")]
TWO_J = [("payload", "joint-coulomb-friction"), ("joint-torque-offset", "joint-viscous-friction"), ("joint-spring", "joint-stribeck-friction"), ("rotor-inertia", "joint-torque-ripple"), ("gravity-error", "joint-coulomb-friction")]
TWO_T = [("relaxation", "stiffening-layer"), ("surface-offset", "relaxation"), ("stress-softening", "saturation"), ("stiffness-drift", "adhesion"), ("hysteresis", "stiffening-layer")]
TWO_B = [("stribeck-friction", "relaxation"), ("viscous-friction", "stiffening-layer"), ("friction-anisotropy", "surface-offset"), ("stress-softening", "presliding")]
CLASS = {"x-runin": [], "x-ageing": ["stribeck-friction", "viscous-friction", "friction-rounding", "presliding"], "x-vibration": [], "x-texture": ["stiffness-inhomogeneity", "surface-offset"],
         "x-plastic": ["stress-softening", "hysteresis", "surface-offset"], "x-foam": ["hertz-exponent", "stiffening-layer"], "x-hose": ["sensor-bias", "tool-mass", "tool-com", "sensor-drift"],
         "x-jump": ["sensor-bias", "sensor-drift"], "x-gainfade": ["stiffness-drift"], "x-push": [], "x-drag": ["joint-viscous-friction"], "x-backlash": ["joint-elasticity", "rotor-inertia"]}
OUT_R, OUT_T, OUT_B, OUT_J = ["x-hose", "x-jump", "x-texture", "x-plastic", "x-vibration"], ["x-foam", "x-gainfade", "x-plastic", "x-vibration"], ["x-runin", "x-ageing", "x-texture"], [(J, "x-push"), (J, "x-drag"), (Dr, "x-backlash"), (Dr, "x-push")]
NOT_R = [("stiffness-inhomogeneity", "hooke", ["one_place"], 0), ("friction-anisotropy", "kelvin-voigt", ["one_dir", "no_free"], 1), ("load-dependent-friction", "hertz", ["one_depth"], 1), ("relaxation", "kelvin-voigt", ["slowtau"], 0),
         ("saturation", "hertz", ["beyond"], 1), ("stiffening-layer", "kelvin-voigt", ["deep"], 1), ("tool-inertia", "hooke", ["slow"], 0), ("sensor-lag", "hooke", ["slow"], 0)]
NOT_T = [("stiffening-layer", "hooke", ["deep"], 0), ("saturation", "kelvin-voigt", ["beyond"], 0), ("relaxation", "hertz", ["slowtau"], 0)]
NOT_J = [("rotor-inertia", ["slow"]), ("joint-stribeck-friction", ["fastonly"])]


def plan(S):
    g = np.random.default_rng([S, 48]); L = []; arm = lambda: str(g.choice(["lwr4plus", "lwr4plus", "heron6", "stilt6"])); pick = lambda l: l[int(g.integers(len(l)))]

    def add(group, pf, eff, law=None, fric=None, opts=()):
        eff = list(eff); opts = set(opts)
        if pf in (J, Dr):
            m = ["rigid-body"] + [x for x in ("joint-coulomb-friction", "joint-viscous-friction") if x not in eff and not (group == "one" and eff[0] in ("joint-torque-offset", "payload") and g.random() < .3)]
        else:
            if law is None: law = pick(next((NORMAL[e] for e in eff if e in NORMAL), ["hertz"] if {"load-dependent-friction", "structural-compliance"} & set(eff) else LAWS))
            if "x-foam" in eff: law = pick(["hooke", "kelvin-voigt"])
            if fric is None: fric = pf == B or pf == R and (any(e in TANG for e in eff) or g.random() < .55)
            if {"x-runin", "x-ageing"} & set(eff): fric = True
            if {"structural-compliance", "tip-offset"} & set(eff): fric = False
            if "sensor-misalignment" in eff or "sensor-crosstalk" in eff: fric = True
            m = [law] + (["coulomb-friction"] if fric and "coulomb-friction" not in eff else [])
            if pf == T and g.random() < .3 and group in ("quiet", "one") and "mains-hum" not in eff and "time-offset" not in eff and "sensor-lag" not in eff: opts.add("long")
        L.append(dict(group=group, platform=pf, eff=eff, law=law, model=m, opts=opts, arm=arm()))
    ch = lambda l, n: [l[i] for i in g.permutation(len(l))[:n]]
    for e, pf in zip(ch(list(NORMAL), 5), [R, R, T, T, pick([R, T])]): add("one", pf if e != "stiffness-inhomogeneity" else R, [e])
    for e, pf in zip(ch(TANG, 4), [R, R, R, B]): add("one", pf, [e])
    for e in ch(ROB, 3): add("one", R, [e])
    d = pick(DRV); add("one", Dr, [d])
    for e in ch([x for x in JOI if x != d], 4): add("one", J, [e])
    s = ch(SEN, 5); k = 0
    for e in s:
        tt = e in TSEN and k < 2 and g.random() < .6; k += tt; add("one", T if tt else R, [e])
    laws = ch(["hooke", "kelvin-voigt", "hertz", "hunt-crossley", "zener", "maxwell"], 6)
    for i in range(4): add("quiet", R, [], law=laws[i], fric=bool(i % 2 == 0) and laws[i] != "maxwell")
    add("quiet", T, [], law=laws[4], fric=False); add("quiet", B, [], law=pick(["hooke", "kelvin-voigt", "hertz"])); add("quiet", J, []); add("quiet", J, [], opts=["coarse"]); add("quiet", Dr, [])
    for e in ch(TWO_R, 4): add("two", R, e, law="hertz" if "surface-offset" in e else None)
    add("two", J, pick(TWO_J)); add("two", T, pick(TWO_T)); add("two", B, pick(TWO_B))
    o = ch(OUT_R, 3); [add("outside", R, [e], law=pick(["hooke", "kelvin-voigt"])) for e in o]
    add("outside", T, [pick([e for e in OUT_T if e not in o])], law="hooke"); add("outside", B, [pick([e for e in OUT_B if e not in o])], law="hooke"); pf, e = pick(OUT_J); add("outside", pf, [e])
    for e, law, op, fr in ch(NOT_R, 2): add("not-excited", R, [e], law, bool(fr), op)
    e, law, op, fr = pick(NOT_T); add("not-excited", T, [e], law, False, op); e, op = pick(NOT_J); add("not-excited", J, [e], opts=op)
    L = [L[i] for i in g.permutation(len(L))]
    for i, x in enumerate(L): x.update(case=f"plover_{i:02d}", seed0=int(g.integers(1 << 30)), fmt=pick(["parquet"] * 5 + ["csv"] * 2))
    return L


def build(sp, on):
    if sp["platform"] in (J, Dr):
        import joints; c = joints.joint_case(sp, on); return c, joints.base_fit_joint(sp["model"], c["fit"])
    import contact, fit
    c = contact.contact_case(sp, on); return c, fit.base_fit(sp["law"], "coulomb-friction" in sp["model"], c["fit"])


def judge(sp):
    from fit import compare, rms
    eff = set(sp["eff"]); c, r1 = build(sp, eff); f = c["fit"]; n = f["forces"]; seg = {"all": np.ones(len(r1), bool), "contact": f["contact"], "free": ~f["contact"]}
    rep = {}
    if not eff:
        m = f["contact"]; left, read, noise = rms(r1[:, :n]), rms(f["Y"][m][:, :n]), rms(f["sd"][:n]); rep = dict(left=left, share=left / read, noise=noise); return c, rep, left <= max(1.3 * noise, .02 * read)
    tw = dict(sp, twin=True); c0, r0 = build(tw, set()); ok = True
    left, read = rms(r0[:, :n]), rms(c0["fit"]["Y"][f["contact"]][:, :n]); rep.update(left=left, share=left / read, noise=rms(f["sd"][:n]), ratios={})
    if sp["group"] != "not-excited" and left > max(1.5 * rep["noise"], .045 * read): ok = False
    for e in eff:
        ra = r1 if len(eff) == 1 else build(tw, {e})[1]
        if len(ra) != len(r0): return c, dict(error="length"), False
        b, w, pooled = compare(ra, r0, seg); rep["ratios"][e] = dict(best=b, where=w, pooled=pooled)
        if sp["group"] == "not-excited": ok &= b < .5
        else: ok &= b >= 2.2 and pooled >= 1.
    return c, rep, bool(ok)


def work(a):
    sp, out = a; t0 = time.time(); sp = dict(sp); log = []
    for k in range(8):
        sp.update(seed=sp["seed0"] + 1000 * k, ns=[1, .7, .4, .2, .1, .05, .05, .05][k], boost=[1, 1.15, 1.3, 1.5, 1.7, 1.9, 2.1, 2.3][k] if sp["group"] != "not-excited" else 1.)
        try: c, rep, ok = judge(sp)
        except Exception as e: rep, ok = dict(error=repr(e)), False
        log.append({**rep, "ns": sp["ns"]})
        if ok: break
    if "error" in rep: raise RuntimeError((sp["case"], sp["eff"], rep))
    d = os.path.join(out, sp["case"]); os.makedirs(d, exist_ok=True)
    rows = c["rows"]
    if sp["fmt"] == "parquet":
        import pyarrow as pa, pyarrow.parquet as pq
        pq.write_table(pa.table({k: (v.astype(str) if v.dtype.kind == "U" else v) for k, v in rows.items()}), os.path.join(d, "log.parquet"))
    else:
        with open(os.path.join(d, "log.csv"), "w") as f:
            f.write(",".join(rows) + "\n"); cols = [[str(x) for x in v] if v.dtype.kind == "U" else ["%.9g" % x for x in v] for v in rows.values()]
            f.write("\n".join(map(",".join, zip(*cols))) + "\n")
    open(os.path.join(d, "rig.toml"), "w").write(c["rig"])
    for k, v in c["files"].items(): open(os.path.join(d, k), "w").write(v)
    eff, g = sp["eff"], sp["group"]; truth = [] if g in ("quiet", "outside") else eff
    near = []
    vals = {k: v for k, v in c["values"].items() if not (g == "not-excited" and k.split(".")[0] in eff)}
    tr = dict(case=sp["case"], group=g, kind=(eff[0][2:] if g == "outside" else sp["platform"]), model=",".join(sp["model"]), truth=truth, near=near, **{"class": CLASS.get(eff[0], []) if g == "outside" else []}, values=vals, true_error=c["true_error"],
              notes=f"{sp['platform']}, {len(rows['t'])} rows, nuisances x{sp['ns']}, effect x{sp['boost']}, fair={ok}")
    return tr, dict(case=sp["case"], **{k: (sorted(v) if isinstance(v, set) else v) for k, v in sp.items() if k != "case"}, fair=ok, attempts=log, seconds=time.time() - t0, **{"drawn": c["private"]})


if __name__ == "__main__":
    ap = argparse.ArgumentParser(); ap.add_argument("--seed", type=int, required=True); ap.add_argument("--out", required=True); a = ap.parse_args()
    os.environ.setdefault("OMP_NUM_THREADS", "1"); os.makedirs(a.out, exist_ok=True); t0 = time.time(); L = plan(a.seed)
    with Pool(2) as p: res = p.map(work, [(s, a.out) for s in L], chunksize=1)
    dj = lambda x: x.tolist() if hasattr(x, "tolist") else (sorted(x) if isinstance(x, set) else str(x))
    json.dump([x[0] for x in res], open(os.path.join(a.out, "truth.json"), "w"), indent=1, default=dj); json.dump([x[1] for x in res], open(os.path.join(a.out, "private.json"), "w"), indent=1, default=dj)
    print(f"{len(res)} cases, {time.time()-t0:.0f} s, nuisances lowered in {sum(x[1]['ns'] < 1 for x in res)}, not fair: {[ (x[0]['case'], x[1]['eff']) for x in res if not x[1]['fair']]}")
