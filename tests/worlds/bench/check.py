#!/usr/bin/env python3
"""check.py DIR: do the logs obey the contract? Re-derived with Pinocchio alone (rnea of a free body, its frames), not with this
folder's own kinematics; and do the numbers in truth.json keep what the brief asks."""
import json
import os
import sys
for v in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
    os.environ[v] = "1"
HERE = os.path.dirname(os.path.abspath(__file__))
_venv = os.path.join(HERE, "venv", "bin", "python")
if os.path.exists(_venv) and os.path.abspath(sys.prefix) != os.path.join(HERE, "venv"):
    os.execv(_venv, [_venv] + sys.argv)
import tomllib
import numpy as np
import pandas as pd
import pinocchio as pin
from scipy.signal import savgol_filter

URDF = {"lwr4plus": "lwr4plus.urdf", "ur5": "ur5_robot.urdf"}
rms = lambda a: float(np.sqrt(np.mean(np.square(a))))


def read(folder):
    for ext, f in (("parquet", pd.read_parquet), ("csv", pd.read_csv), ("npz", lambda p: pd.DataFrame(dict(np.load(p))))):
        p = os.path.join(folder, "log." + ext)
        if os.path.exists(p):
            return f(p), tomllib.load(open(os.path.join(folder, "rig.toml"), "rb"))
    raise FileNotFoundError(folder)


def uniform(t, X, hz):
    g = np.arange(t[0], t[-1], 1 / hz)
    return g, np.column_stack([np.interp(g, t, X[:, j]) for j in range(X.shape[1])])


def wrench(df, rig, truth):
    bad = []
    m = pin.buildModelFromUrdf(os.path.join(HERE, "models", URDF[rig["robot"]["model"]]))
    d = m.createData()
    t = df["t"].to_numpy()
    N = m.nv
    q = df[[f"q{i+1}" for i in range(N)]].to_numpy()
    w = df[["fx", "fy", "fz", "tx", "ty", "tz"]].to_numpy()
    if np.any(q < m.lowerPositionLimit - 1e-3) or np.any(q > m.upperPositionLimit + 1e-3):
        bad.append("joint limits")
    hz = min(1 / np.median(np.diff(t)), 250.)
    g, q = uniform(t, q, hz)
    _, w = uniform(t, w, hz)
    win = max(int(.04 * hz) | 1, 5)
    qs, dq, ddq = (savgol_filter(q, win, 3, deriv=k, delta=1 / hz, axis=0) for k in range(3))
    if np.any(np.percentile(np.abs(dq), 99.9, axis=0) > m.velocityLimit):
        bad.append("joint speed")
    fs, ft = m.getFrameId(rig["robot"]["sensor_frame"]), m.getFrameId(rig["robot"]["tip_frame"])
    if fs >= m.nframes or ft >= m.nframes:
        return ["frames"]
    tool = rig["tool"]
    I = tool.get("inertia", [0] * 6)
    Y = pin.Inertia(tool["mass"], np.array(tool["com"]), np.array([[I[0], I[3], I[4]], [I[3], I[1], I[5]], [I[4], I[5], I[2]]]))
    body = pin.Model()                                             # a free body: rnea gives the wrench that must hold it; the reading is minus that
    j = body.addJoint(0, pin.JointModelFreeFlyer(), pin.SE3.Identity(), "tool")
    body.appendBodyToJoint(j, Y, pin.SE3.Identity())
    bd = body.createData()
    P, Rn, tip, W = [], [], [], np.zeros((len(g), 6))
    for i in range(len(g)):
        pin.forwardKinematics(m, d, qs[i], dq[i], ddq[i])
        pin.updateFramePlacements(m, d)
        M = d.oMf[fs]
        v = pin.getFrameVelocity(m, d, fs, pin.LOCAL)
        a = pin.getFrameAcceleration(m, d, fs, pin.LOCAL)
        qq = np.r_[M.translation, pin.Quaternion(M.rotation).coeffs()]
        W[i] = -pin.rnea(body, bd, qq, v.vector, a.vector)
        P.append(M.translation.copy()); Rn.append(M.rotation.copy()); tip.append(d.oMf[ft].translation.copy())
    Rn, tip = np.array(Rn), np.array(tip)
    if "surface" not in rig:
        free = np.ones(len(g), bool)
        depth = -np.ones(len(g))
    else:
        s = rig["surface"]
        n = np.array(s["normal"])
        depth = -(tip - np.array(s["point"])) @ n
        free = depth < -3e-3
    F = np.einsum("nij,nj->ni", Rn, w[:, :3] - W[:, :3])            # what's left, in the base
    slope = float((w[free][:, :3] * W[free][:, :3]).sum() / (W[free][:, :3] ** 2).sum())
    rest = rms((w - W)[free][:, :3])
    if truth["group"] != "outside" and abs(slope - 1) > .3 and rest > .25 * rms(W[free][:, :3]):
        bad.append(f"free wrench slope {slope:.2f}, rest {rest:.3f} N")
    info = dict(slope=round(slope, 3), free_rest=round(rest, 3))
    c = depth > .4 * np.percentile(depth, 99.5) if "surface" in rig else np.zeros(len(g), bool)
    if c.any():
        fn = F[c] @ n
        info["normal"] = round(float(fn.mean()), 2)
        if fn.mean() < 0 or np.mean(fn > 0) < .98:
            bad.append("normal force pulls")
        t1 = np.array(s["tangent"])
        t2 = np.cross(n, t1)
        vt = np.gradient(tip, 1 / hz, axis=0)
        power = (F[c] @ t1) * (vt[c] @ t1) + (F[c] @ t2) * (vt[c] @ t2)
        sl = np.hypot(vt[c] @ t1, vt[c] @ t2) > 3e-3
        if truth["parameters"]["base"].get("mu", 0) > 0 and sl.sum() > 50 and power[sl].mean() > 0:
            bad.append("friction drives")
        # moments about the sensor: tau - tau_tool = r_tip x f
        r = np.einsum("nji,nj->ni", Rn, tip - np.array(P))
        tq = np.cross(r, w[:, :3] - W[:, :3])
        e = (w - W)[c][:, 3:]
        if "sensor-bias" in truth["true_model"] or "sensor-drift" in truth["true_model"]:
            e, tq = e - e.mean(0), tq - tq[c].mean(0)
        k = float((e * tq[c]).sum() / (tq[c] ** 2).sum())
        info["moment_slope"] = round(k, 3)
        if abs(k - 1) > .35 and truth["group"] != "outside" and "quantization" not in truth["hidden"]:
            bad.append(f"moments slope {k:.2f}")
    print("   ", info, end="")
    return bad


def joints(df, rig, truth):
    bad = []
    m = pin.buildModelFromUrdf(os.path.join(HERE, "models", URDF[rig["robot"]["model"]]))
    if "tool" in rig:
        f = m.frames[m.getFrameId(rig["robot"]["sensor_frame"])]
        I = rig["tool"].get("inertia", [0] * 6)
        m.appendBodyToJoint(f.parentJoint, pin.Inertia(rig["tool"]["mass"], np.array(rig["tool"]["com"]), np.array([[I[0], I[3], I[4]], [I[3], I[1], I[5]], [I[4], I[5], I[2]]])), f.placement)
    d = m.createData()
    N, t = m.nv, df["t"].to_numpy()
    g, X = uniform(t, df[[f"{c}{i+1}" for c in ("q", "tau") for i in range(N)]].to_numpy(), 100.)
    q, tau = X[:, :N], X[:, N:]
    qs, dq, ddq = (savgol_filter(q, 11, 3, deriv=k, delta=.01, axis=0) for k in range(3))
    if np.any(q < m.lowerPositionLimit) or np.any(q > m.upperPositionLimit) or np.any(np.percentile(np.abs(dq), 99.9, axis=0) > m.velocityLimit):
        bad.append("joint limits or speed")
    rb = np.array([pin.rnea(m, d, qs[i], dq[i], ddq[i]) for i in range(len(g))])
    k = float((tau * rb).sum() / (rb ** 2).sum())
    fr = [float(np.mean((tau - rb)[:, j] * dq[:, j])) for j in range(N)]
    print("   ", dict(slope=round(k, 3), friction_power=[round(x, 3) for x in fr]), end="")
    if abs(k - 1) > (.5 if {"payload", "joint-torque-gain"} & set(truth["hidden"]) else .25):
        bad.append(f"rigid body slope {k:.2f}")
    if sum(x > -.02 for x in fr) < N - 1:
        bad.append("friction gives power")
    return bad


def tester(df, rig, truth):
    bad = []
    dep, f = df["depth"].to_numpy(), df["normal_force"].to_numpy()
    top = dep > .5 * dep.max()
    if not (1e-4 < dep.max() < .05 and f[top].mean() > 0 and np.corrcoef(dep[dep > 0], f[dep > 0])[0, 1] > .4):
        bad.append("depth or force")
    if "tangential_force1" in df:
        p = 0
        for i in (1, 2):
            v = np.gradient(df[f"slip{i}"].to_numpy(), df["t"].to_numpy())
            p += float(np.mean(v * df[f"tangential_force{i}"].to_numpy()))
        if p > 0:
            bad.append("friction drives")
    print("   ", dict(depth=round(float(dep.max()), 5), force=round(float(f.max()), 2)), end="")
    return bad


def drive(df, rig, truth):
    t = df["t"].to_numpy()
    g, X = uniform(t, df[["q1", "tau1"]].to_numpy(), 200.)
    v, a = (savgol_filter(X[:, 0], 21, 3, deriv=k, delta=.005) for k in (1, 2))
    A = np.column_stack([a, v, np.sign(v), np.ones(len(v))])
    x = np.linalg.lstsq(A, X[:, 1], rcond=None)[0]
    J = truth["parameters"]["inertia"]
    print("   ", dict(J=round(float(x[0]), 5), true=round(J, 5)), end="")
    return ["inertia"] if abs(x[0] / J - 1) > .25 else []


def sizes(c):
    bad = []
    lim = max(1.3 * c["noise_rms"], .017 * c["reading_rms"])
    if c["group"] in ("single", "none", "pair") and c["fit_rms"] > lim * 1.001:
        bad.append(f"fit {c['fit_rms']:.3g} > {lim:.3g}")
    if c["group"] in ("single", "pair"):
        for h, e in c["effects"].items():
            if not 2.5 <= e["effect_rms"] / e["left_rms"] <= 8:
                bad.append(f"{h} ratio {e['effect_rms'] / e['left_rms']:.2f}")
    if c["group"] == "weak" and c["effect_rms"] > .8 * c["left_rms"]:
        bad.append("not weak")
    if c["group"] == "outside" and (c["effect_rms"] < 4 * c["left_rms"] or c["effect_rms"] < .07 * c["reading_rms"]):
        bad.append("outside too small")
    return bad


def main(folder):
    truth = json.load(open(os.path.join(folder, "truth.json")))
    n = 0
    size = 0
    for c in truth:
        df, rig = read(os.path.join(folder, c["case"]))
        print(c["case"], c["kind"], len(df), end="")
        num = df.select_dtypes("number").to_numpy()
        bad = [] if np.isfinite(num).all() and np.all(np.diff(df["t"]) > 0) else ["not finite or time not increasing"]
        bad += dict(wrench=wrench, joints=joints, tester=tester, drive=drive)[c["kind"]](df, rig, c) + sizes(c)
        print("  ", "BAD " + "; ".join(bad) if bad else "ok", flush=True)
        n += bool(bad)
        size += sum(os.path.getsize(os.path.join(folder, c["case"], f)) for f in os.listdir(os.path.join(folder, c["case"])))
    kinds = {k: sum(c["kind"] == k for c in truth) for k in ("wrench", "tester", "joints", "drive")}
    groups = {k: sum(c["group"] == k for c in truth) for k in ("single", "none", "pair", "outside", "unexcited", "weak")}
    single = [c["hidden"][0] for c in truth if c["group"] == "single"]
    print(f"{len(truth)} cases, {n} bad, {size / 1e6:.0f} MB, {kinds}, {groups}, different single effects: {len(set(single))}")
    return n


if __name__ == "__main__":
    sys.exit(bool(main(sys.argv[1])))
