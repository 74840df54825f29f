"""python check.py DIR: do the logs obey the contract? Everything is re-derived from log and rig alone, with Pinocchio (no module of this world is imported)."""
import json, os, sys, tomllib
from collections import Counter
import numpy as np
import pandas as pd
import pinocchio as pin
from scipy.signal import butter, sosfiltfilt

HERE = os.path.dirname(os.path.abspath(__file__))
bad = []
rms = lambda x: float(np.sqrt(np.mean(np.square(x))))


def want(case, ok, text):
    if not ok:
        bad.append(f"{case}: {text}")
        print(f"  FAIL {case}: {text}")


def read(folder):
    for n in ("log.parquet", "log.csv", "log.npz"):
        p = os.path.join(folder, n)
        if os.path.exists(p):
            if n.endswith("npz"):
                z = np.load(p)
                return {k: z[k] for k in z.files}
            d = pd.read_parquet(p) if n.endswith("parquet") else pd.read_csv(p)
            return {k: d[k].to_numpy() for k in d}
    raise FileNotFoundError(folder)


def model(rig, folder, tool):
    name = rig["robot"]["model"]
    m = pin.buildModelFromUrdf(os.path.join(HERE, "models", "lwr4plus.urdf") if name == "lwr4plus" else os.path.join(folder, name))
    m.gravity.linear = np.array(rig["robot"].get("gravity", [0, 0, -9.81]), float)
    f = m.frames[m.getFrameId("ft_sensor")]
    if tool and "tool" in rig:
        m.appendBodyToJoint(f.parentJoint, pin.Inertia(rig["tool"]["mass"], np.array(rig["tool"]["com"]), np.zeros((3, 3))), f.placement)
    return m


def smoothed(log, n, fc):
    """Joints and derivatives on an even grid, and the grid."""
    t = log["t"]
    h = np.median(np.diff(t))
    g = np.arange(t[0], t[-1], h)
    Q = np.column_stack([np.interp(g, t, log[f"q{i+1}"]) for i in range(n)])
    Q = sosfiltfilt(butter(2, min(fc, .4 / h), fs=1 / h, output="sos"), Q, axis=0)
    V = np.gradient(Q, h, axis=0)
    return g, Q, V, np.gradient(V, h, axis=0)


def wrench(c, log, rig, folder):
    m = model(rig, folder, False)
    d = m.createData()
    g, Q, V, A = smoothed(log, 7, 25.)
    step = max(1, len(g) // 3000)
    g, Q, V, A = g[::step], Q[::step], V[::step], A[::step]
    Y = np.column_stack([np.interp(g, log["t"], log[k]) for k in ("fx", "fy", "fz", "tx", "ty", "tz")])
    free = pin.Model()                       # the tool alone: a body with six degrees of freedom at the sensor frame
    free.addJoint(0, pin.JointModelFreeFlyer(), pin.SE3.Identity(), "float")
    free.appendBodyToJoint(1, pin.Inertia(rig["tool"]["mass"], np.array(rig["tool"]["com"]), np.zeros((3, 3))), pin.SE3.Identity())
    free.gravity.linear = m.gravity.linear
    fd = free.createData()
    fs, tip = m.getFrameId("ft_sensor"), m.getFrameId("tool_tip")
    n, t1, p0 = (np.array(rig["surface"][k]) for k in ("normal", "tangent", "point"))
    t2 = np.cross(n, t1)
    T = np.zeros((len(g), 6)); depth = np.zeros(len(g)); N = np.zeros(len(g)); F = np.zeros((len(g), 2)); S = np.zeros((len(g), 2)); mom = np.zeros((len(g), 3))
    for k in range(len(g)):
        pin.forwardKinematics(m, d, Q[k], V[k], A[k])
        pin.updateFramePlacements(m, d)
        v, a = pin.getFrameVelocity(m, d, fs), pin.getFrameAcceleration(m, d, fs)
        M = d.oMf[fs]
        q = np.concatenate([M.translation, pin.Quaternion(M.rotation).coeffs()])
        T[k] = -pin.rnea(free, fd, q, v.vector, a.vector)       # what holds the tool is minus what loads the sensor
        x = d.oMf[tip].translation - p0
        depth[k] = -x @ n
        fc = Y[k, :3] - T[k, :3]
        w = M.rotation @ fc
        N[k], F[k] = w @ n, (w @ t1, w @ t2)
        vt = pin.getFrameVelocity(m, d, tip, pin.LOCAL_WORLD_ALIGNED).linear
        S[k] = vt @ t1, vt @ t2
        r = M.actInv(d.oMf[tip]).translation
        mom[k] = Y[k, 3:] - T[k, 3:] - np.cross(r, fc)
    h = set(c["hidden"])
    air = depth < -.002
    if air.sum() > 50:
        e = rms((Y - T)[air, :3]) / rms(T[air, :3])
        want(c["case"], np.corrcoef(Y[air, :3].ravel(), T[air, :3].ravel())[0, 1] > .85 or h & {"sensor-bias", "sensor-drift", "mains-hum", "quantization", "tool-mass"} or c["group"] == "outside"
             or "sensor-bias" in c["model"], f"in the air the reading isn't the tool's load ({e:.2f})")
    on = depth > .25 * depth.max()
    want(c["case"], depth.max() > 1e-3 and np.median(N[on]) > 0, "contact doesn't push out")
    want(c["case"], np.corrcoef(depth[on], N[on])[0, 1] > .4, "force doesn't grow with depth")
    fast = on & (np.linalg.norm(S, axis=1) > .004)
    if fast.sum() > 40 and c["kind"] == "wrench":
        fa = on & ~fast
        want(c["case"], ((F - np.median(F[fa], axis=0))[fast] * S[fast]).sum() < 0, "friction drives the slide")
    want(c["case"], rms(mom) < .35 * max(rms(Y[:, 3:]), 1e-3) or c["group"] == "outside" or h | set(c["model"]) & {"sensor-bias"}, "moments aren't com x f + r x f")
    return f"air {rms((Y - T)[air, :3]):.3f} N of {rms(T[air, :3]):.2f}, contact up to {N.max():.1f} N at {depth.max()*1e3:.1f} mm, moment left {rms(mom):.4f} of {rms(Y[:, 3:]):.3f} N m"


def torques(c, log, rig, folder, n):
    g, Q, V, A = smoothed(log, n, 10.)
    step = max(1, len(g) // 3000)
    Y = np.column_stack([np.interp(g, log["t"], log[f"tau{i+1}"]) for i in range(n)])[::step]
    Q, V, A = Q[::step], V[::step], A[::step]
    if n > 1:
        m = model(rig, folder, True)
        d = m.createData()
        T = np.array([pin.rnea(m, d, *x) for x in zip(Q, V, A)])
    out = []
    for j in range(n):
        s = np.tanh(V[:, j] / (.02 * np.abs(V[:, j]).max()))
        B = np.column_stack([s, V[:, j], np.ones(len(Q)), T[:, j] if n > 1 else A[:, j]])
        k = np.linalg.lstsq(B, Y[:, j], rcond=None)[0]
        out.append(k)
    out = np.array(out)
    if n > 1:
        want(c["case"], np.all(np.abs(out[[1, 3], 3] - 1) < .45), f"gain on rnea of the big joints {out[[1, 3], 3]}")
        return f"gain on rnea at joints 2 and 4: {out[1, 3]:.3f} {out[3, 3]:.3f}"
    want(c["case"], out[0, 3] > 0, "inertia not positive")
    return f"inertia {out[0, 3]:.4g} kg m2"


def tester(c, log):
    on = log["depth"] > .3 * log["depth"].max()
    want(c["case"], np.median(log["normal_force"][on]) > 0 and np.corrcoef(log["depth"][on], log["normal_force"][on])[0, 1] > .2, "normal force against depth")
    if "depth_rate" in log:
        d = np.gradient(log["depth"], log["t"])
        want(c["case"], np.corrcoef(d, log["depth_rate"])[0, 1] > .3, "depth_rate isn't the rate of depth")
    if "tangential_force1" in log:
        for k in ("1", "2"):
            s = np.gradient(log["slip" + k], log["t"])
            m = on & (np.abs(s) > .3 * np.abs(s).max())
            want(c["case"], (log["tangential_force" + k][m] * s[m]).sum() < 0, f"friction {k} drives the slide")
    return f"{log['normal_force'].max():.1f} N at {log['depth'].max()*1e3:.2f} mm"


def sizes(c):
    n, g = c["case"], c["group"]
    if g in ("single", "pair", "none"):
        lims = [max(1.3 * c["noise_rms"], .017 * c["reading_rms"])]
        want(n, c["fit_rms"] <= lims[0] * 1.001, f"fit_rms {c['fit_rms']:.4g} > {lims[0]:.4g}")
    for x in c["each"]:
        lo, hi = {"single": (2.5, 8), "pair": (2.5, 8), "weak": (0, .8), "unexcited": (0, .3)}[g]
        want(n, lo <= x["ratio"] <= hi, f"{x['effect']} ratio {x['ratio']:.2f}")
    if g == "outside":
        want(n, c["effect_rms"] >= 4 * c["left_rms"] and c["effect_rms"] >= .07 * c["reading_rms"], "outside too small")
        want(n, c["hidden"] == [] and c["true_model"] == c["model"], "outside must hide nothing of the catalogue")
    want(n, len(c["hidden"]) == {"single": 1, "weak": 1, "unexcited": 1, "pair": 2, "none": 0, "outside": 0}[g], "number of hidden effects")
    want(n, c["true_model"] == ",".join(c["model"].split(",") + c["hidden"]) and not set(c["hidden"]) & set(c["model"].split(",")), "true_model")
    want(n, all(k.split(".")[0] in c["hidden"] and np.isfinite(v) for k, v in c["values"].items()), "values")


def main(out):
    truth = json.load(open(os.path.join(out, "truth.json")))
    need = "case kind group model hidden true_model near effect_rms left_rms fit_rms reading_rms unit nuisances parameters values seconds notes".split()
    for c in truth:
        folder = os.path.join(out, c["case"])
        log, rig = read(folder), tomllib.load(open(os.path.join(folder, "rig.toml"), "rb"))
        want(c["case"], all(k in c for k in need), "fields of truth")
        num = [k for k in log if k != "phase"]
        want(c["case"], all(np.isfinite(log[k]).all() for k in num), "not finite")
        want(c["case"], (np.diff(log["t"]) >= 0).all(), "time goes back")
        sizes(c)
        k = c["kind"]
        s = wrench(c, log, rig, folder) if k == "wrench" else tester(c, log) if k == "tester" else torques(c, log, rig, folder, 7 if k == "joints" else 1)
        print(f"{c['case']} {k:7s}{c['seconds']:6.0f} s {len(log['t']) / c['seconds']:6.0f} Hz  {s}")
    groups, kinds = Counter(c["group"] for c in truth), Counter(c["kind"] for c in truth)
    print(dict(groups), dict(kinds))
    want("all", groups == dict(single=22, none=9, pair=7, outside=6, unexcited=2, weak=2), "groups")
    want("all", kinds["wrench"] >= 20 and kinds["tester"] >= 10 and kinds["joints"] >= 7 and kinds["drive"] >= 4, "kinds")
    one = [c["hidden"][0] for c in truth if c["group"] == "single"]
    want("all", len(set(one)) == len(one), f"single effects twice: {[k for k, v in Counter(one).items() if v > 1]}")
    size = sum(os.path.getsize(os.path.join(p, f)) for p, _, fs in os.walk(out) for f in fs) / 1e6
    want("all", size < 300, f"{size:.0f} MB")
    print(f"{size:.0f} MB; " + ("all well" if not bad else f"{len(bad)} complaints"))
    sys.exit(bool(bad))


if __name__ == "__main__":
    main(sys.argv[1])
