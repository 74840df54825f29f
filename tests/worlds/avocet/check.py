"""check.py DATA: the rules that files alone can show."""
import json, os, sys, collections
import numpy as np, pyarrow.parquet as pq, pyarrow.csv as pc
try: import tomllib
except ImportError: import tomli as tomllib
D = sys.argv[1]; T = json.load(open(os.path.join(D, "truth.json"))); bad = 0
def say(c, *a):
    global bad; bad += 1; print(c, *a)
G = collections.Counter(r["group"] for r in T); print(dict(G), "cases", len(T)); print(collections.Counter(("joint" if "joint" in r["kind"] else r["kind"].split(",")[0].split()[0]) for r in T))
if G != dict(quiet=9, one=22, two=7, outside=6) | {"not-excited": 4}: say("counts", G)
LIM = {"lwr": 15., "panda": 15., "ur5": 15.}
for r in T:
    c = r["case"]; d = os.path.join(D, c); f = [x for x in os.listdir(d) if x.startswith("log.")]
    if len(f) != 1: say(c, "logs", f); continue
    t = (pq.read_table if f[0].endswith("parquet") else pc.read_csv)(os.path.join(d, f[0])); t = {k: np.array(t[k].to_pylist()) for k in t.column_names}
    rig = tomllib.load(open(os.path.join(d, "rig.toml"), "rb")); s = r["_size"]; fx = r["truth"] or ([r["notes"].split(";")[0]] if r["group"] == "outside" else ["-"])
    num = {k: v for k, v in t.items() if k != "phase"}
    if not all(np.isfinite(v).all() for v in num.values()): say(c, "not finite")
    dt = np.diff(t["t"]); fs = 1 / np.median(dt)
    if (dt <= 0).any(): say(c, "time goes back")
    if not (4 < t["t"][-1] < 320): say(c, "length", t["t"][-1])
    q = [k for k in t if k[0] == "q" and k[1:].isdigit()]
    Fx = [k for k in ("fx", "fy", "fz", "normal_force") if k in t]; tau = [k for k in t if k.startswith("tau")]
    mf = max([np.abs(t[k]).max() for k in Fx], default=0); mt = max([np.abs(t[k]).max() for k in tau], default=0)
    if Fx and not 2 < mf < 90: say(c, "force", mf)
    if len(tau) > 1 and not 5 < mt < 300: say(c, "torque", mt)
    if q:
        tg = np.arange(0, t["t"][-1], .02); v = max(np.abs(np.gradient(np.interp(tg, t["t"], t[k]), .02)).max() for k in q)
        if v > (12 if len(q) == 1 else 3): say(c, "speed", v)
    if "sensor" in rig and "range" in rig["sensor"] and Fx:
        for k, L in zip(["fx", "fy", "fz", "tx", "ty", "tz"], rig["sensor"]["range"]):
            if k in t and np.abs(t[k]).max() > L: say(c, "beyond range", k)
    if "fx" in t:
        air = np.sqrt(sum(t[k][: int(fs)].std() ** 2 for k in ("fx", "fy", "fz")))
        if "tool" not in rig or "surface" not in rig: say(c, "rig")
    if r["group"] in ("one", "two"):
        x = max((a / b for a, b in zip(s["fit"], s["true"])), default=0); y = max(a / max(1e-9, n) for a, n in zip(s["fit"], s["noise"])); sh = max(a / b for a, b in zip(s["fit"], s["reading"]))
        if y < 2 or sh < .02: say(c, "small", fx, "fit/true %.2f fit/noise %.2f share %.3f" % (x, y, sh))
    if r["group"] == "quiet" or r["group"] == "not-excited":
        for a, n, rd in zip(s["fit"], s["noise"], s["reading"]):
            if a > max(1.5 * n, .02 * rd): say(c, "not quiet", r["group"], fx, a, n, rd)
    for k in ("case", "group", "kind", "model", "truth", "near", "values", "true_error", "notes"):
        if k not in r: say(c, "lacks", k)
    if r["group"] == "outside" and "class" not in r: say(c, "lacks class")
    if not np.isfinite(list(r["values"].values())).all(): say(c, "values")
    print(f"{c} {r['group']:11s} {','.join(fx)[:40]:40s} {r['model'][:44]:44s} {t['t'][-1]:6.1f} s {fs:6.0f} Hz  max {mf:5.1f} N {mt:6.1f} Nm  true_error {r['true_error']:.4f}  near {r['near']}")
print("faults", bad)
