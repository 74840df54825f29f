#!/usr/bin/env python3
"""python check.py DIR: do the logs obey the contract? Frames and signs are re-derived with Pinocchio's own functions; truth.json against the brief."""
import collections
import json
import os
import sys
import tomllib

import numpy as np
import pandas as pd
import pinocchio as pin
from scipy.signal import savgol_filter

import catalogue
import joint_case
from robots import ARMS, arm


def free_body():
    """a tool as Pinocchio's free-flyer: our wrench formula is minus its inverse dynamics, seen at the sensor's origin, plus the contact."""
    rng = np.random.default_rng(0)
    worst = 0.0
    for _ in range(50):
        m, com, I = rng.uniform(0.2, 2), rng.normal(size=3) * 0.05, rng.uniform(1e-3, 5e-3, 3)
        model = pin.Model()
        j = model.addJoint(0, pin.JointModelFreeFlyer(), pin.SE3.Identity(), "tool")
        model.appendBodyToJoint(j, pin.Inertia(m, com, np.diag(I)), pin.SE3.Identity())
        model.gravity.linear = np.array([0, 0, -9.81])
        R = pin.SE3.Random().rotation
        q = np.concatenate([rng.normal(size=3), pin.Quaternion(R).coeffs()])
        v, a = rng.normal(size=6), rng.normal(size=6) * 3
        fc, r = rng.normal(size=3), rng.normal(size=3) * 0.1
        data = model.createData()
        need = pin.rnea(model, data, q, v, a)                    # what the sensor must give to the tool, without contact
        a_classical = a[:3] + np.cross(v[3:], v[:3])
        W = catalogue.wrench(fc[None], r, m, com, [*I, 0, 0, 0], (R.T @ [0, 0, -9.81] - a_classical)[None], v[None, 3:], a[None, 3:])[0]
        worst = max(worst, np.abs(W - (-need + np.concatenate([fc, np.cross(r, fc)]))).max())
    print(f"free body (Pinocchio rnea) against our wrench: {worst:.1e}")
    assert worst < 1e-10


def chains():
    rng = np.random.default_rng(1)
    for name in ARMS:
        A = arm(name)
        d = A.pin.createData()
        q = A.home + rng.normal(size=(4, A.nq)) * 0.3
        dq, ddq = rng.normal(size=q.shape), rng.normal(size=q.shape)
        e = np.abs(np.array([pin.rnea(A.pin, d, *x) for x in zip(q, dq, ddq)]) - A.rnea(q, dq, ddq)).max()
        s = A.sensor_motion(q, dq, ddq)
        for i in range(4):
            pin.forwardKinematics(A.pin, d, q[i], dq[i], ddq[i])
            pin.updateFramePlacements(A.pin, d)
            f, t = A.pin.getFrameId(A.sensor), A.pin.getFrameId(A.tip)
            e = max(e, np.abs(d.oMf[f].rotation - s["R"][i]).max(), np.abs(d.oMf[t].translation - s["p"][i]).max(),
                    np.abs(pin.getFrameClassicalAcceleration(A.pin, d, f, pin.LOCAL).linear - s["a"][i]).max())
        print(f"{name}: batch kinematics and dynamics against Pinocchio: {e:.1e}")
        assert e < 1e-10


def read(folder):
    for n in ("log.parquet", "log.csv", "log.npz"):
        p = os.path.join(folder, n)
        if os.path.exists(p):
            if n.endswith("npz"):
                return {k: v for k, v in np.load(p).items()}
            df = pd.read_parquet(p) if n.endswith("parquet") else pd.read_csv(p)
            return {c: df[c].to_numpy() for c in df.columns}
    raise FileNotFoundError(folder)


def smooth(log, cols):
    t = log["t"]
    fs = (len(t) - 1) / (t[-1] - t[0])
    tu = np.arange(t[0], t[-1], 1 / fs)
    x = np.stack([np.interp(tu, t, log[c]) for c in cols], 1)
    w = max(int(0.06 * fs) | 1, 5)
    k = np.linspace(10, len(tu) - 11, 400).astype(int)
    f = lambda d: savgol_filter(x, w, 3, deriv=d, delta=1 / fs, axis=0)[k]
    return tu[k], f(0), f(1), f(2), lambda c: np.interp(tu[k], t, log[c])


def wrench_case(log, rig, truth):
    """by Pinocchio alone, frame names and all from the rig: free-air load against m R^T (g - a), contact along the normal, friction against slip."""
    A = arm(rig["robot"]["model"])
    n = A.nq
    t, q, dq, ddq, col = smooth(log, [f"q{i + 1}" for i in range(n)])
    d = A.pin.createData()
    s, tool = rig["surface"], rig["tool"]
    nrm, t1 = np.array(s["normal"]), np.array(s["tangent"])
    t2 = np.cross(nrm, t1)
    fs, ft = A.pin.getFrameId(rig["robot"]["sensor_frame"]), A.pin.getFrameId(rig["robot"]["tip_frame"])
    W = np.stack([col(c) for c in ("fx", "fy", "fz", "tx", "ty", "tz")], 1)
    air, N, power, slide, depth = [], [], [], [], []
    for i in range(len(t)):
        pin.forwardKinematics(A.pin, d, q[i], dq[i], ddq[i])
        pin.updateFramePlacements(A.pin, d)
        R, tip = d.oMf[fs].rotation, d.oMf[ft].translation
        a = pin.getFrameClassicalAcceleration(A.pin, d, fs, pin.LOCAL).linear
        v = pin.getFrameVelocity(A.pin, d, ft, pin.LOCAL_WORLD_ALIGNED).linear
        load = tool["mass"] * (R.T @ [0, 0, -9.81] - a)
        f = R @ (W[i, :3] - load)
        de = -nrm @ (tip - s["point"])
        depth.append(de)
        if de < -1e-3:
            air.append(np.linalg.norm(f))
        elif de > 5e-4:
            N.append(f @ nrm)
            vt = np.array([t1 @ v, t2 @ v])
            if np.linalg.norm(vt) > 4e-3:
                power.append(np.array([t1 @ f, t2 @ f]) @ vt / np.linalg.norm(vt))
                slide.append(f @ nrm)
    mg = tool["mass"] * 9.81
    return dict(air=np.median(air) / mg, N=np.median(N), friction=np.median(power) / np.median(slide) if power else np.nan, deepest=max(depth))


def main(folder):
    free_body()
    chains()
    truths = json.load(open(os.path.join(folder, "truth.json")))
    known = set(catalogue.EFFECTS) | set(joint_case.OWN) | {"payload", "gravity-error"}
    bases = set(catalogue.BASES) | {"rigid-body", "maxwell"}
    bad = []
    for T in truths:
        path = os.path.join(folder, T["case"])
        log = read(path)
        rig = tomllib.load(open(os.path.join(path, "rig.toml"), "rb"))
        t = log["t"]
        say = lambda m: bad.append(f"{T['case']}: {m}")
        if not (np.diff(t) > 0).all():
            say("time not increasing")
        for c, x in log.items():
            if x.dtype.kind == "f" and not np.isfinite(x).all():
                say(f"{c} not finite")
        names = T["true_model"].split(",")
        if names[0] not in bases or not set(names[1:]) | set(T["near"]) <= known:
            say(f"unknown name in {names} {T['near']}")
        if T["model"].split(",") + T["hidden"] != names:
            say("true_model is not model + hidden")
        info = ""
        if T["kind"] == "wrench":
            r = wrench_case(log, rig, T)
            info = f"air {r['air']:.3f} mg, N {r['N']:.2f} N, T.v/N {r['friction']:.3f}, depth {r['deepest'] * 1e3:.2f} mm"
            if r["air"] > 0.35 or r["N"] < 0.2 or r["friction"] > 0.02 or not 5e-4 < r["deepest"] < 0.015:
                say("signs or frames? " + info)
        elif T["kind"] == "tester":
            deep = log["depth"] > 0.3 * log["depth"].max()
            info = f"N {np.median(log['normal_force'][deep]):.2f} N"
            if np.median(log["normal_force"][deep]) <= 0:
                say("normal force")
            if "slip1" in log:
                _, x, v, _, col = smooth(log, ["slip1", "slip2"])
                k = np.linalg.norm(v, axis=1) > 2e-3
                p = (col("tangential_force1")[k] * v[k, 0] + col("tangential_force2")[k] * v[k, 1]) / np.linalg.norm(v[k], axis=1)
                info += f", T.v/N {np.median(p) / max(np.median(col('normal_force')[k]), 1e-6):.3f}"
                if np.median(p) >= 0:
                    say("friction pushes")
        else:
            nq = sum(c[0] == "q" and c[1:].isdigit() for c in log)
            _, q, v, a, col = smooth(log, [f"q{i + 1}" for i in range(nq)])
            tau = np.stack([col(f"tau{i + 1}") for i in range(nq)], 1)
            if T["kind"] == "joints":
                A = arm(rig["robot"]["model"])
                d = A.pin.createData()
                m = np.array([pin.rnea(A.pin, d, *x) for x in zip(q, v, a)])
                info = f"share of the torque that rnea leaves {np.sqrt(np.mean((tau - m) ** 2) / np.mean(tau ** 2)):.3f}"
                if np.sqrt(np.mean((tau - m) ** 2) / np.mean(tau ** 2)) > 0.4:
                    say("dynamics? " + info)
                tau = tau - m
            dissipates = np.mean(np.sign(v) * tau, 0)
            info += f", friction {np.round(dissipates, 3)}"
            if (dissipates < -0.02 * np.sqrt(np.mean(tau ** 2))).any() and T["group"] != "outside" and "joint-spring" not in names:
                say("friction drives " + info)
        lim = max(1.3 * T["noise_rms"], 0.017 * T["reading_rms"])
        if T["group"] in ("single", "none", "pair") and T["fit_rms"] > lim:
            say(f"fit_rms {T['fit_rms']:.3g} > {lim:.3g}")
        for h, e in T["effect_each"].items():
            ratio = e["effect_rms"] / e["left_rms"]
            lo, hi = {"single": (2.5, 8), "pair": (2.5, 8), "weak": (0, 0.8), "unexcited": (0, 0.6), "outside": (4, 99)}[T["group"]]
            if not lo <= ratio <= hi:
                say(f"{h} ratio {ratio:.2f}")
            if T["group"] == "outside" and e["effect_rms"] < 0.07 * T["reading_rms"]:
                say("outside too small")
        print(T["case"], T["kind"], T["group"], T["hidden"], f"{len(t)} rows {t[-1]:.0f} s", info)
    if len(truths) == 48:
        print(collections.Counter(T["group"] for T in truths), collections.Counter(T["kind"] for T in truths))
        singles = [T["hidden"][0] for T in truths if T["group"] == "single"]
        if len(set(singles)) != 22:
            bad.append("singles not 22 different")
    print("\n".join(bad) or "all well")
    return bool(bad)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1]))
