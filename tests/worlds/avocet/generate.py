"""avocet: robots that touch soft things.  generate.py --seed S --out DATA [--only contact|joint|rest] [--n K]"""
import argparse, json, os, time, sys
import numpy as np
HERE = os.path.dirname(os.path.abspath(__file__)); sys.path.insert(0, HERE)
import cases_contact as cc
from cases_contact import build, allowed, NEAR, OUT_CLASS, ARM_FX, NORM_FX, TAN_FX, TEST_FX
from write import write_contact
try:
    import cases_joint as cj
except ImportError:
    cj = None
try:
    import near as nr
except ImportError:
    nr = None

LAWP = dict(zip(["hooke", "kelvin-voigt", "hertz", "hunt-crossley", "zener", "maxwell"], [.3, .2, .22, .2, .05, .03]))
POKE = {"adhesion", "hysteresis", "stress-softening", "OUT-dent", "OUT-collapse", "OUT-added-mass"}      # where slides would blur the matter
OUTS = ["OUT-dent", "OUT-ageing", "OUT-ploughing", "OUT-collapse", "OUT-mount-resonance", "OUT-warm-up", "OUT-added-mass", "OUT-clock-skew", "OUT-cubic-sensor"]
PAIRS = [("relaxation", "sensor-bias"), ("stiffening-layer", "tool-mass"), ("surface-offset", "friction-anisotropy"), ("hertz-exponent", "tool-com"), ("relaxation", "stribeck-friction"),
         ("hunt-crossley-damping", "sensor-drift"), ("load-dependent-friction", "sensor-crosstalk"), ("viscous-damping", "viscous-friction"), ("relaxation", "stiffening-layer"),
         ("surface-offset", "tip-offset"), ("stiffness-drift", "tool-com"), ("relaxation", "friction-anisotropy"), ("stress-softening", "sensor-bias"), ("saturation", "tool-com"),
         ("stiffness-inhomogeneity", "sensor-bias"), ("quantization", "relaxation"), ("time-offset", "tool-mass"), ("coupled-stiffness", "relaxation"), ("presliding", "stiffening-layer"),
         ("mains-hum", "hertz-exponent"), ("hysteresis", "sensor-drift")]
TPAIRS = [("relaxation", "stiffening-layer"), ("hysteresis", "sensor-drift"), ("hertz-exponent", "sensor-bias"), ("relaxation", "mains-hum"), ("stress-softening", "sensor-bias"), ("saturation", "relaxation")]


def opts(rng, fx, arm_log):
    o = {}
    if "stiffness-drift" in fx or "sensor-drift" in fx or "OUT-warm-up" in fx: o["T"] = rng.uniform(100, 180)
    if "OUT-clock-skew" in fx: o["T"] = 120.
    return o


def choose(rng, fx, arm_log, kind=None):
    for _ in range(400):
        k = kind or str(rng.choice(["poke", "slide", "poke-slide"], p=[.4, .25, .35] if arm_log else [.75, .1, .15]))
        L = str(rng.choice(list(LAWP), p=list(LAWP.values())))
        al = allowed(L, "slide" in k, arm_log)
        if set(fx) & POKE and "slide" in k: continue
        if any(e in ("OUT-ageing", "OUT-ploughing") for e in fx) and "slide" not in k: continue
        if any(e in NORM_FX for e in fx) and k == "slide" and not set(fx) <= {"surface-offset", "stiffness-inhomogeneity"}: continue
        if any(e.startswith("OUT") for e in fx) and L in ("maxwell", "zener"): continue
        if "OUT-collapse" in fx and L != "hooke" and L != "kelvin-voigt": continue
        if all(e in al or e.startswith("OUT") for e in fx): return L, k
    raise RuntimeError("no log for %s" % (fx,))


def contact_case(rng, group, arm_log, fx, extra=None, law=None, kind=None):
    for attempt in range(5):
        L, k = (law, kind) if law else choose(rng, fx, arm_log, kind)
        o = opts(rng, fx, arm_log); o.update(extra or {})
        try:
            b = build(rng, group, arm_log, fx, L, k, extra_opt=o)
        except RuntimeError as e:
            print("   again:", fx, e, flush=True); continue
        if b is not None: return b
        print("   again: too small", fx, L, k, flush=True)
    return None


def hidden_ne(rng, arm_log):
    """(effect, options, law, kind, how it is put in)"""
    if arm_log:
        return [("stiffening-layer", {}, "hooke", "poke"), ("friction-anisotropy", dict(onedir=True, tilt=0., oneplace=True), "hooke", "slide"), ("relaxation", dict(short=True, hold=.12, shold=.1, rest=.2), "hertz", "poke"),
                ("stribeck-friction", dict(slidev=[.03, .05], onedir=False), "hooke", "slide"), ("tool-inertia", dict(turnamp=.1, turnquick=.6, turn=False), "kelvin-voigt", "poke")][rng.integers(5)]
    return [("stiffening-layer", {}, "hooke", "poke"), ("relaxation", dict(short=True, hold=.1, shold=.1, rest=.15), "hertz", "poke")][rng.integers(2)]


def one_contact(rng, group, arm_log, fx, extra=None, law=None, kind=None):
    b = contact_case(rng, group, arm_log, fx, extra, law, kind)
    if b is None: return None
    e = b["ev"]
    near = []; cls = []
    if group in ("one", "two"):
        near = sorted({n for f in fx for n in NEAR.get(f, [])} - set(fx))
        if "time-offset" in fx and group == "two" and e["V"].get("time-offset.delay", 0) > 0: near = sorted(set(near) | {"sensor-lag"})
        if nr is not None: near = nr.near_contact(b, near)
    if group == "outside": cls = OUT_CLASS[fx[0]]
    what = f"{'arm ' + b['robot'] if b['robot'] else 'materials tester'}, {b['kind']}"
    def save(d):
        w = write_contact(b, d, rng)
        r = dict(group=group, kind=what, model=w["model"], truth=[f for f in fx if not f.startswith("OUT")], near=near, values=w["values"], true_error=w["true_error"],
                 notes=f"{b['law']}; {b['opt']}; nuisances x{b['k']:.2f}; own fit without it / with the truth / reading, force and torque rms: "
                       f"{np.round(e['fit'], 4).tolist()} / {np.round(e['true'], 4).tolist()} / {np.round(e['reading'], 4).tolist()}")
        if group == "outside": r["notes"] = fx[0][4:] + "; " + r["notes"]; r["class"] = cls
        r["_size"] = dict(fit=e["fit"], true=e["true"], reading=e["reading"], noise=e["noise"])
        return r
    return save


def plan(rng, only=None):
    jobs = []
    C = lambda group, arm_log, fx, *a: jobs.append(("contact" if arm_log else "rest", lambda: one_contact(rng, group, arm_log, fx, *a), (group, fx)))
    for i in range(6): C("quiet", True, [], None)
    pool = [x for x in rng.permutation(ARM_FX + NORM_FX + TAN_FX)]
    for e in pool[:15]: C("one", True, [str(e)])
    for i in rng.permutation(len(PAIRS))[:5]: C("two", True, list(PAIRS[i]))
    for e in rng.permutation(OUTS)[:4]: C("outside", True, [str(e)])
    for i in range(2):
        e, o, L, k = hidden_ne(rng, True); C("not-excited", True, [e], o, L, k)
    # testers and drives: six, joints: ten
    C("quiet", False, []) if rng.random() < .5 or cj is None else jobs.append(("rest", lambda: cj.drive(rng, "quiet", []), ("quiet", "drive")))
    tp = rng.permutation([e for e in NORM_FX + TEST_FX if e != "stiffness-inhomogeneity"])
    C("one", False, [str(tp[0])])
    if cj is None: C("one", False, [str(tp[1])])
    else: jobs.append(("rest", lambda: cj.drive(rng, "one", None), ("one", "drive")))
    if rng.random() < .5 or cj is None: C("two", False, list(TPAIRS[rng.integers(len(TPAIRS))]))
    else: jobs.append(("rest", lambda: cj.drive(rng, "two", None), ("two", "drive")))
    if rng.random() < .5 or cj is None: C("outside", False, [str(rng.choice(["OUT-dent", "OUT-collapse", "OUT-warm-up", "OUT-cubic-sensor"]))])
    else: jobs.append(("rest", lambda: cj.drive(rng, "outside", None), ("outside", "drive")))
    if rng.random() < .5 or cj is None:
        e, o, L, k = hidden_ne(rng, False); C("not-excited", False, [e], o, L, k)
    else: jobs.append(("rest", lambda: cj.drive(rng, "not-excited", None), ("not-excited", "drive")))
    if cj is not None:
        fx = [str(x) for x in rng.permutation(cj.ARM_ONE)]
        jobs.append(("joint", lambda: cj.arm_case(rng, "quiet", [], dict(T=300.)), ("quiet", [])))
        for g, f in [("quiet", [])] + [("one", [x]) for x in fx[:5]] + [("two", None), ("outside", None), ("not-excited", None)]:
            jobs.append(("joint", lambda g=g, f=f: cj.arm_case(rng, g, f), (g, f)))
    return [j for j in jobs if not only or j[0] == only]


def main():
    ap = argparse.ArgumentParser(); ap.add_argument("--seed", type=int, default=1); ap.add_argument("--out", required=True); ap.add_argument("--only"); ap.add_argument("--n", type=int)
    a = ap.parse_args(); t0 = time.time()
    rng = np.random.default_rng(a.seed); jobs = plan(rng, a.only)[:a.n]
    num = rng.permutation(len(jobs)) + 1
    os.makedirs(a.out, exist_ok=True); T = []
    for (cl, f, tag), k in zip(jobs, num):
        t1 = time.time(); save = None
        try:
            save = f()
        except Exception as e:
            if os.environ.get("AVOCET_DEBUG"): raise
            print("   failed", tag, repr(e), flush=True)
        if save is None:
            # a stand-in of the same group: a case whose kind of log is sure to carry it
            print("   stand-in for", tag, flush=True)
            g = tag[0]; fx = {"quiet": [], "one": ["stiffening-layer"], "two": ["relaxation", "stiffening-layer"], "outside": ["OUT-warm-up"], "not-excited": ["stiffening-layer"]}[g]
            save = one_contact(rng, g, cl == "contact", fx, {}, "hooke", "poke")
        c = f"avocet_{k:02d}"; d = os.path.join(a.out, c)
        r = save(d); r = dict(case=c, **r); T.append(r)
        z = r["_size"]
        print(f"{c} {r['group']:11s} {','.join(r['truth']) or r['notes'][:24]:42s} {r['kind']:28s} {r['model']:34s} fit {np.round(z['fit'],4)} true {np.round(z['true'],4)} read {np.round(z['reading'],3)} {time.time()-t1:.1f}s", flush=True)
        with open(os.path.join(a.out, "truth.json.part"), "w") as h: json.dump(sorted(T, key=lambda r: r["case"]), h, indent=1)
    os.replace(os.path.join(a.out, "truth.json.part"), os.path.join(a.out, "truth.json"))
    print("cases", len(T), "seconds", round(time.time() - t0))


if __name__ == "__main__": main()
