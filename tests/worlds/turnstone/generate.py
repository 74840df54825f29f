"""turnstone: python generate.py --seed S --out DATA [--only CASE,...]"""
import argparse
import json
import os
import sys
import time
os.environ.setdefault("OMP_NUM_THREADS", "1")
sys.path.insert(0, os.path.dirname(os.path.abspath(__file__)))
import numpy as np
import outside
import refit
import refitj
import worlds_c
import worlds_x

MAKE = {"C": worlds_c.make_c, "F": worlds_c.make_f, "T": worlds_x.make_t, "J": worlds_x.make_j, "D": worlds_x.make_d}
ONE = {"C": [x for x in worlds_c.NORMAL_NEEDS],
       "T": ["viscous-damping", "hunt-crossley-damping", "relaxation", "hysteresis", "stress-softening", "adhesion", "stiffening-layer", "surface-offset", "stiffness-drift",
             "hertz-exponent", "structural-compliance", "sensor-bias", "sensor-drift", "sensor-lag", "time-offset", "saturation", "mains-hum"],
       "F": ["tool-mass", "tool-com", "tool-inertia", "sensor-bias", "sensor-drift", "sensor-misalignment", "sensor-crosstalk", "sensor-lag", "time-offset"],
       "J": ["joint-coulomb-friction", "joint-viscous-friction", "joint-friction-asymmetry", "joint-torque-offset", "rotor-inertia", "joint-torque-gain", "payload",
             "gravity-error", "joint-stribeck-friction", "joint-load-friction", "joint-torque-ripple", "joint-spring"],
       "D": ["joint-coulomb-friction", "joint-viscous-friction", "joint-friction-asymmetry", "joint-stribeck-friction", "joint-torque-ripple", "joint-spring"]}
PAIRS = {"C": [("relaxation", "friction-anisotropy"), ("hertz-exponent", "stribeck-friction"), ("stiffness-inhomogeneity", "viscous-friction"), ("surface-offset", "presliding"),
               ("stress-softening", "friction-rounding"), ("hysteresis", "tip-offset"), ("stiffening-layer", "load-dependent-friction"), ("adhesion", "viscous-friction"),
               ("tool-mass", "hertz-exponent"), ("sensor-lag", "hertz-exponent"), ("time-offset", "stiffening-layer"), ("sensor-bias", "relaxation"), ("viscous-damping", "sensor-misalignment"),
               ("stiffness-drift", "friction-anisotropy"), ("sensor-drift", "stress-softening"), ("hunt-crossley-damping", "sensor-bias")],
         "T": [("relaxation", "hertz-exponent"), ("hysteresis", "hertz-exponent"), ("stress-softening", "viscous-damping"), ("adhesion", "hertz-exponent"), ("sensor-drift", "viscous-damping"), ("stiffening-layer", "relaxation")],
         "J": [("joint-viscous-friction", "payload"), ("joint-torque-offset", "joint-torque-ripple"), ("joint-coulomb-friction", "gravity-error"), ("rotor-inertia", "joint-spring"), ("joint-stribeck-friction", "joint-torque-offset"),
               ("joint-friction-asymmetry", "payload"), ("joint-load-friction", "joint-torque-offset")],
         "D": [("joint-coulomb-friction", "joint-torque-ripple"), ("joint-stribeck-friction", "joint-spring"), ("joint-viscous-friction", "joint-torque-ripple"), ("joint-friction-asymmetry", "joint-torque-ripple"), ("joint-coulomb-friction", "joint-spring")]}
SILENT = {"C": ["friction-anisotropy", "stribeck-friction", "load-dependent-friction", "stiffness-inhomogeneity", "stiffness-drift", "stiffening-layer"],
          "T": ["stress-softening", "hysteresis", "stiffening-layer"], "F": ["tool-inertia", "sensor-lag", "time-offset"], "D": ["joint-friction-asymmetry", "joint-spring"]}


def plan(seed):
    rng = np.random.default_rng([seed, 77])
    rows = []
    add = lambda group, kind, hid=(), **k: rows.append(dict(group=group, kind=kind, hidden=list(hid), **k))
    for kind, n in (("C", 12), ("T", 2), ("F", 3), ("J", 3), ("D", 2)):
        for i in rng.permutation(len(ONE[kind]))[:n]:
            add("one", kind, [ONE[kind][i]])
    for kind, n in (("C", 4), ("F", 1), ("J", 1), ("D", 1), ("T", 2)):
        for _ in range(n):
            add("quiet", kind)
    for kind, n in (("C", 4), ("T", 1), ("J", 1), ("D", 1)):
        for i in rng.permutation(len(PAIRS[kind]))[:n]:
            add("two", kind, PAIRS[kind][i])
    for kind, n in (("C", 3), ("F", 1), ("J", 1), ("D", 1)):
        ks = list(getattr(outside, kind))
        for i in rng.permutation(len(ks))[:n]:
            add("outside", kind, outside=ks[i])
    for kind, n in (("C", 2), ("T", 1), (str(rng.choice(["D", "F"])), 1)):
        for i in rng.permutation(len(SILENT[kind]))[:n]:
            add("not-excited", kind, silent=SILENT[kind][i])
    order = rng.permutation(len(rows))
    rows = [rows[i] for i in order]
    for i, r in enumerate(rows):
        r["case"] = f"turnstone_{i+1:02d}"
    return rows


class Fits:
    """refits of one written case, cached by the set of names"""
    def __init__(self, folder, c):
        arm = worlds_c.get_arm(c["arm"]) if c["arm"] else None
        self.kind = c["kind"]
        self.D = (refitj if self.kind in "JD" else refit).read_dir(folder, arm)
        self.memo = {}
        if self.kind in "JD":
            refitj.tune_bristle(self.D, c["true"])
            self.rms = float(np.sqrt(np.mean(self.D.Y ** 2)))
        else:
            self.rms = self.D.rms

    def __call__(self, names, warm=None, quick=False):
        key = tuple(sorted(names)) + (('quick',) if quick else ())
        if key not in self.memo:
            self.memo[key] = (refitj.fit(self.D, list(names)) if self.kind in "JD" else refit.fit(self.D, [x for x in names if x != "none"], warm, 7 if quick else 20))
        return self.memo[key]

    def cand(self, model):
        """catalogue effects that may join this model"""
        c = (refitj if self.kind in "JD" else refit).CAND[self.kind]
        b = set(model)
        no = set(b)
        if "kelvin-voigt" in b or "hunt-crossley" in b: no |= {"viscous-damping"} if "kelvin-voigt" in b else {"hertz-exponent", "hunt-crossley-damping"}
        if "zener" in b: no |= {"relaxation"}
        if self.kind in "CT":
            if "coulomb-friction" not in b: no |= {"stribeck-friction", "presliding", "friction-rounding", "load-dependent-friction", "friction-anisotropy"}
        if "joint-coulomb-friction" not in b: no |= {"joint-stribeck-friction"}
        if self.kind == "D": no |= {"rotor-inertia"}
        return [x for x in c if x not in no]


def judge(row, c, folder):
    """size rules by refit; returns facts and violations"""
    f = Fits(folder, c)
    e1, th = f(c["true"])
    bad = []
    e0 = e1
    floor = c["noise"]
    if row["group"] in ("one", "two"):
        e0 = f(c["model"])[0]
    if row["group"] == "one":
        if e0 / e1 < 2: bad.append(f"size {e0/e1:.2f} < 2")
    if row["group"] == "two":
        for i in range(2):
            x = f([m for m in c["true"] if m != c["hidden"][i]])[0]
            if x / e1 < 1.5: bad.append(f"without {c['hidden'][i]}: {x/e1:.2f} < 1.5")
    if row["group"] != "outside" and e1 > max(1.05 * np.hypot(.022 * f.rms, floor), 1.4 * floor):
        bad.append(f"true model leaves {100*e1/f.rms:.1f} % of the readings")
    best, cls = e1, []
    if row["group"] == "outside":
        e0 = e1
        m = list(c["model"]); w = th
        for _ in range(3):
            tr = sorted((f(m + [x], w, True)[0], x) for x in f.cand(m))
            if not tr or tr[0][0] > .93 * best: break
            best, x = tr[0]; m.append(x); best, w = f(m, w); cls.append(x)
        c["class_trials"] = cls
        if best < 2.5 * floor or best < .02 * f.rms: bad.append(f"greedy leaves {best:.3g}: {best/floor:.1f} x noise, {100*best/f.rms:.1f} %")
    return f, e0, e1, best, cls, bad


def build(row, seed, out):
    i = int(row["case"][-2:])
    folder = os.path.join(out, row["case"])
    best = None
    for a in range(6):
        s = [seed, i, a]
        kw = dict(gain=1.0 + .2 * a if row["group"] in ("one", "two", "outside") else 1.0)
        if row.get("outside"): kw["outside"] = getattr(outside, row["kind"])[row["outside"]]
        if row.get("silent"): kw["silent"] = row["silent"]
        try:
            c = MAKE[row["kind"]](s, folder, row["hidden"], row["group"], **kw)
            r = judge(row, c, folder)
        except RuntimeError as x:
            continue
        hard = [b for b in r[5] if "true model" not in b]
        score = (len(hard), len(r[5]), r[2] / r[0].rms)
        if best is None or score < best[0]:
            best = (score, s, kw, a)
        if not r[5] or (a >= 3 and best[0][0] == 0):
            break
    if best[1] != s:
        c = MAKE[row["kind"]](best[1], folder, row["hidden"], row["group"], **best[2]); r = judge(row, c, folder)
    f, e0, e1, eb, cls, bad = r
    near = []
    if row["group"] == "one":
        w = f(c["model"])[1] if c["kind"] not in "JD" else None
        for x in f.cand(c["model"]):
            if x not in c["hidden"] and f(c["model"] + [x], w, True)[0] <= 1.02 * e1:
                near.append(x)
    if row["group"] == "two":
        w = None
        for i_ in range(2):
            m = [x for x in c["true"] if x != c["hidden"][i_]]
            w = f(m)[1] if c["kind"] not in "JD" else None
            for x in f.cand(m):
                if x not in c["hidden"] and f(m + [x], w, True)[0] <= 1.02 * e1 and x not in near:
                    near.append(x)
    if row["group"] == "outside":
        w = f(c["model"])[1] if c["kind"] not in "JD" else None
        for x in f.cand(c["model"]):
            if x not in cls and f(c["model"] + [x], w, True)[0] < .9 * e1: cls.append(x)
    return dict(case=row["case"], group=row["group"], kind=row["kind"], model=",".join(c["model"]), hidden=[] if row["group"] == "outside" else c["hidden"], true_model=",".join(c["true"]),
                near=near, **{"class": cls}, values=c["values"] if row["group"] != "not-excited" else {}, error_true=round(eb if row["group"] == "outside" else e1, 6), error_before=round(e0, 6), noise=round(c["noise"], 6), readings_rms=round(f.rms, 5),
                violations=bad, notes="; ".join(([row["outside"]] if row.get("outside") else []) + c["notes"] + [f"draw {best[3] + 1}"]))


def main():
    ap = argparse.ArgumentParser()
    ap.add_argument("--seed", type=int, required=True); ap.add_argument("--out", required=True); ap.add_argument("--only", default="")
    a = ap.parse_args()
    only = set(filter(None, a.only.split(",")))
    os.makedirs(a.out, exist_ok=True)
    rows, t0 = [], time.time()
    tf = os.path.join(a.out, "truth.json")
    old = {r["case"]: r for r in json.load(open(tf))} if only and os.path.exists(tf) else {}
    for row in plan(a.seed):
        if only and row["case"] not in only:
            if row["case"] in old: rows.append(old[row["case"]])
            continue
        t = time.time()
        r = build(row, a.seed, a.out)
        rows.append(r)
        print(f"{r['case']} {r['group']:11s} {r['kind']} {','.join(r['hidden']) or row.get('outside', '-'):44s} true {r['error_true']:.4g} before {r['error_before']:.4g} ({r['error_before']/r['error_true']:.1f}) "
              f"noise {r['noise']:.3g} left {100*r['error_true']/r['readings_rms']:.1f}% {time.time()-t:.1f}s near {r['near']} class {r['class']} {r['violations']} {r['notes'].split('; ')[-1]}", flush=True)
        with open(tf + ".tmp", "w") as fo: json.dump(rows, fo, indent=1)
        os.replace(tf + ".tmp", tf)
    with open(tf + ".tmp", "w") as fo: json.dump(rows, fo, indent=1)
    os.replace(tf + ".tmp", tf)
    print(f"{len(rows)} cases, {time.time()-t0:.0f} s, violations {sum(bool(r['violations']) for r in rows)}")


if __name__ == "__main__":
    main()
