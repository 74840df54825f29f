"""python check.py DATA: files, columns, rates, finite numbers, rigs, groups, and the size rule from the rows of truth.json (refit with --refit)"""
import json, os, sys, tomllib
os.environ.setdefault("OMP_NUM_THREADS", "1")
sys.path.insert(0, os.path.dirname(os.path.abspath(__file__)))
import numpy as np, table

D = sys.argv[1]; refit_too = "--refit" in sys.argv
T = json.load(open(f"{D}/truth.json")); bad = []
say = lambda c, m: bad.append(f"{c}: {m}")
want = {"one": 22, "quiet": 9, "two": 7, "outside": 6, "not-excited": 4}
got = {g: sum(r["group"] == g for r in T) for g in want}
if got != want: say("all", f"groups {got}")
KNOWN = set(open(os.path.join(os.path.dirname(os.path.abspath(__file__)), "effects.txt")).read().split())
for r in T:
    c = r["case"]; d = f"{D}/{c}"
    for k in ("case", "group", "kind", "model", "truth", "near", "values", "true_error", "notes"):
        if k not in r: say(c, f"no {k}")
    try:
        rig = tomllib.load(open(f"{d}/rig.toml", "rb"))
    except Exception as e:
        say(c, f"rig: {e}"); continue
    fs = [f for f in os.listdir(d) if f.startswith("log.")]
    if len(fs) != 1: say(c, f"logs {fs}"); continue
    L = table.read(f"{d}/{fs[0]}"); t = L.t.to_numpy()
    num = {k: np.asarray(v) for k, v in L.items() if k != "phase"}
    if not all(np.isfinite(v).all() and len(v) == len(t) for v in num.values()): say(c, "numbers not finite or of other length")
    if (np.diff(t) <= 0).any(): say(c, "time does not grow")
    if not 5 <= t[-1] - t[0] <= 1300: say(c, f"{t[-1]-t[0]:.1f} s")
    rate = 1 / np.median(np.diff(t))
    if not .05 <= rate <= 2100: say(c, f"{rate:.1f} Hz")
    const = [k for k, v in num.items() if np.ptp(v) == 0]
    if const: say(c, f"constant columns {const}")
    n = len([k for k in num if k[0] == "q" and k[1:].isdigit()])
    if "robot" in rig:
        if n != len(rig["robot"]["joints"]): say(c, "joints and columns differ")
        if rig["robot"]["model"].endswith(".urdf") and not os.path.exists(f"{d}/{rig['robot']['model']}"): say(c, "no URDF")
        if np.abs(np.stack([num[f"q{i+1}"] for i in range(n)])).max() > 6.3: say(c, "joint angle beyond 2 pi")
    kind = r["kind"].split(",")[0]
    need = {"contact": "fx fy fz tx ty tz", "free wrench": "fx fy fz tx ty tz", "joint torques": "q1 tau1 tau6", "drive": "q1 tau1", "tester": "depth normal_force"}[kind].split()
    miss = [k for k in need if k not in num]
    if miss: say(c, f"columns missing: {miss}")
    if kind == "contact":
        f = np.linalg.norm(np.c_[num["fx"], num["fy"], num["fz"]], axis=1).max()
        if f > 200: say(c, f"force of {f:.0f} N")
    for e in (r["truth"] if r["group"] != "outside" else []) + r["near"]:
        if e not in KNOWN: say(c, f"unknown effect {e}")
    if set(r["truth"]) & set(r["model"].split(",")): say(c, "hidden effect in the model")
    for v in r["violations"]: say(c, v)
    if refit_too and r["group"] in ("one", "two", "quiet"):
        import refit
        k = kind in ("drive", "joint torques"); p = refit.Joints(d) if k else refit.Wrench(d, "torque" if "size over tx" in r["notes"] else "force", r.get("hum", 50.))
        m = r["model"].split(","); e = p.fit(m + r["truth"])[0]
        if e > .02 * p.rms: say(c, f"refit: true model leaves {100*e/p.rms:.2f} %")
        for h in r["truth"]:
            w = p.fit(m + [x for x in r["truth"] if x != h])[0]
            if w < 2 * e or w < .04 * p.rms: say(c, f"refit: without {h} {w/e:.2f} x, {100*w/p.rms:.1f} %")
print(f"{len(T)} cases, groups {got}, {len(bad)} violations"); [print("  " + b) for b in bad]
sys.exit(bool(bad))
