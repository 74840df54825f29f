"""Independent look at the written files: Pinocchio from the log's own URDF and joint columns (no kernel of ours)."""
import json, os, sys
import numpy as np, pinocchio as pin, pyarrow.parquet as pq, pyarrow.csv as pc, tomllib
from scipy.signal import butter, sosfiltfilt
from scipy.optimize import nnls
D = sys.argv[1]; T = json.load(open(D + "/truth.json"))
for r in T:
    if not r["kind"].startswith("arm"): continue
    d = f"{D}/{r['case']}"; f = [x for x in os.listdir(d) if x.startswith("log.")][0]
    t = (pq.read_table if f.endswith("parquet") else pc.read_csv)(f"{d}/{f}"); C = lambda k: np.array(t[k]); rig = tomllib.load(open(d + "/rig.toml", "rb"))
    m = pin.buildModelFromUrdf(d + "/arm.urdf"); da = m.createData(); tt = C("t"); fs = 1 / np.median(np.diff(tt)); g = np.arange(tt[0], tt[-1], 1 / fs)
    q = np.c_[tuple(np.interp(g, tt, C(f"q{j+1}")) for j in range(m.nq))]; so = butter(2, min(12, .3 * fs) / (fs / 2), output="sos"); q = sosfiltfilt(so, q, axis=0)
    v = np.gradient(q, 1 / fs, axis=0); a = np.gradient(v, 1 / fs, axis=0); st = max(1, len(g) // 4000); I = slice(int(fs), len(g) - int(fs), st)
    tr = (r["truth"] or [r["notes"].split(";")[0]])
    if "tau1" in t.column_names:
        Y = np.c_[tuple(np.interp(g, tt, C(f"tau{j+1}")) for j in range(m.nq))][I]; R = Y - np.array([pin.rnea(m, da, x, y, z) for x, y, z in zip(q[I], v[I], a[I])])
        E = []; Z = []; raw = np.sqrt((R ** 2).mean())
        for j in range(m.nq):
            M = [np.zeros(len(R))]
            if "joint-coulomb" in r["model"]: M.append(np.tanh(v[I][:, j] / 5e-4))
            if "joint-viscous" in r["model"]: M.append(v[I][:, j])
            if "offset" in r["model"]: M.append(np.ones(len(R)))
            M = np.array(M).T; E.append((R[:, j] - M @ np.linalg.lstsq(M, R[:, j], rcond=None)[0])); k = np.abs(v[I][:, j]) > 3e-3; c = np.linalg.lstsq(M[k], R[k, j], rcond=None)[0]; Z.append((R[k, j] - M[k] @ c) ** 2)
        e = np.sqrt((np.array(E) ** 2).mean()); y = np.sqrt((Y ** 2).mean()); print(f"{r['case']} {r['group']:11s} {','.join(tr)[:40]:40s} torque rms {y:7.3f} max {np.abs(Y).max():6.1f} rb-res {raw:6.3f} left {e:6.3f} = {100*e/y:5.2f} %, in motion {np.sqrt(np.concatenate(Z).mean()):.3f} own {r['_size']['fit'][0]:.3f}", flush=True)
    else:
        fid = m.getFrameId("tool_tip"); sid = m.getFrameId("ft_sensor"); W = np.c_[tuple(np.interp(g, tt, C(k)) for k in ("fx", "fy", "fz"))][I]
        n = np.array(rig["surface"]["normal"]); p0 = np.array(rig["surface"]["point"]); t1 = np.array(rig["surface"]["tangent"]); dep = []; F = []
        for x, w in zip(q[I], W):
            pin.framesForwardKinematics(m, da, x); dep.append(-(da.oMf[fid].translation - p0) @ n); F.append(da.oMf[sid].rotation @ w - rig["tool"]["mass"] * np.array([0, 0, -9.81]))
        dep = np.array(dep); F = np.array(F); N = F @ n; Tt = np.linalg.norm(F - np.outer(N, n), axis=1); air = dep < -2e-3; con = dep > 0
        b = (0., 1e9)
        for e in np.arange(1, 2.01, .05):
            z = dep[con] ** e; k = (z @ N[con]) / (z @ z); b = min(b, (e, np.sqrt(((N[con] - k * z) ** 2).mean())), key=lambda x: x[1])
        print(f"{r['case']} {r['group']:11s} {','.join(tr)[:40]:40s} air |f| rms {np.sqrt((F[air]**2).sum(1).mean()):.4f} depth max {1e3*dep.max():5.2f} mm N max {N.max():5.1f} min {N.min():5.2f} T/N {np.median(Tt[con][N[con]>1]/N[con][N[con]>1]):.2f} power law n {b[0]:.2f} left {100*b[1]/np.sqrt((N[con]**2).mean()):5.2f} %", flush=True)
