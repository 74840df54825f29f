"""check.py DATA: formats, signs (tool at rest in the air reads m R^T g; FK by pinocchio), counts, fairness of what generate.py recorded."""
import json, os, sys, tomllib
import numpy as np
import pinocchio as pin
import pyarrow.csv as pc, pyarrow.parquet as pq

D = sys.argv[1]; T = json.load(open(D + "/truth.json")); Pv = {x["case"]: x for x in json.load(open(D + "/private.json"))}; bad = []; size = 0; nrow = []; worst = 0.
for c in T:
    d = f"{D}/{c['case']}"; rig = tomllib.load(open(d + "/rig.toml", "rb")); p = d + "/log.parquet"
    t = pq.read_table(p) if os.path.exists(p) else pc.read_csv(d + "/log.csv"); L = {k: np.array(t[k].to_pylist()) for k in t.column_names}; n = len(L["t"]); nrow.append(n)
    size += sum(os.path.getsize(d + "/" + f) for f in os.listdir(d))
    num = {k: v for k, v in L.items() if k != "phase"}
    if n > 60000 or n < 500: bad.append((c["case"], "rows", n))
    if not all(np.isfinite(v).all() for v in num.values()): bad.append((c["case"], "nan"))
    if (np.diff(L["t"]) <= 0).any(): bad.append((c["case"], "time"))
    if any(np.ndim(v) for v in c["values"].values()): bad.append((c["case"], "values"))
    if "robot" in rig:
        m = pin.buildModelFromUrdf(os.path.join(d, rig["robot"]["model"])); da = m.createData(); fs, ft = m.getFrameId(rig["robot"]["sensor_frame"]), m.getFrameId(rig["robot"]["tip_frame"])
        if f"q{m.nq}" not in L or f"q{m.nq+1}" in L: bad.append((c["case"], "joints"))
        Q = np.stack([L[f"q{i+1}"] for i in range(m.nq)], 1)
        if "fx" in L:
            s = rig["surface"]; nn, tt, p0 = map(np.array, (s["normal"], s["tangent"], s["point"])); W = np.stack([L[k] for k in "fx fy fz tx ty tz".split()], 1); e = []; air = 0; fn = []; dep = []
            if abs(nn @ tt) > 1e-6 or abs(np.linalg.norm(nn) - 1) > 1e-6: bad.append((c["case"], "surface"))
            for i in range(0, n, max(n // 300, 1)):
                pin.framesForwardKinematics(m, da, Q[i]); R = da.oMf[fs].rotation; x = da.oMf[ft].translation - p0; f0 = rig["tool"]["mass"] * R.T @ np.array(rig["robot"]["gravity"])
                if x @ nn > .008: air += 1; e.append(W[i] - np.r_[f0, np.cross(rig["tool"]["com"], f0)])
                if x @ nn < 2e-3: dep.append(-x @ nn); fn.append(nn @ R @ (W[i, :3] - f0))
            e = np.sqrt((np.array(e) ** 2).mean(0)) if air else np.zeros(6); dep, fn = np.array(dep), np.array(fn); deep = dep > .7 * dep.max()
            okair = set(c["truth"]) & {"tool-mass", "tool-com", "tool-inertia", "sensor-bias", "sensor-drift", "sensor-gain", "quantization", "mains-hum", "sensor-misalignment", "sensor-crosstalk"} or c["kind"] in ("hose", "jump")
            if not okair: worst = max(worst, e[:3].max())
            if air < 5 or (not okair and (e[:3].max() > .2 or e[3:].max() > .02)): bad.append((c["case"], "air", air, e.round(3).tolist()))
            if fn[deep].mean() < 1.: bad.append((c["case"], "normal force sign", fn[deep].mean()))
        elif "tau1" not in L: bad.append((c["case"], "columns"))
    elif "depth" in L:
        deep = L["depth"] > .7 * L["depth"].max()
        if L["normal_force"][deep].mean() < .5: bad.append((c["case"], "sign"))
        if "slip1" in L:
            v = np.gradient(L["slip1"], L["t"]); k = (np.abs(v) > .01) & deep
            if k.sum() > 20 and np.mean(v[k] * L["tangential_force1"][k]) > 0: bad.append((c["case"], "tangential sign"))
    elif not {"q1", "tau1"} <= set(L): bad.append((c["case"], "columns"))
    if not Pv[c["case"]]["fair"]: bad.append((c["case"], "unfair", c["group"], c["truth"]))
g = {}
for c in T: g[c["group"]] = g.get(c["group"], 0) + 1
pl = {}
for c in Pv.values(): pl[c["platform"]] = pl.get(c["platform"], 0) + 1
print(g, pl, f"rows {min(nrow)}..{max(nrow)}, {size/1e6:.0f} MB, air force error worst {worst:.3f} N, distinct effects in one: {len({c['truth'][0] for c in T if c['group']=='one'})}"); print("BAD:", *bad, sep="\n  ") if bad else print("all good")
