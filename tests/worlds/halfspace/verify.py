"""python verify.py DIR: checks of one generated seed. Wrench chain against Pinocchio without noise; signs and weights read from the logs."""
from __future__ import annotations

import json
import sys
import tomllib
from pathlib import Path as File

import numpy as np
import pinocchio as pin
import pyarrow.parquet as pq

from arm import Robot, execute
from cases import SCRIPTS, draw, table
from generate import off, place
from laws import I, predict, theta

URDF = str(File(__file__).resolve().parents[3] / "urdf" / "lwr4plus.urdf")


def load(folder: File, name: str = "log") -> dict[str, np.ndarray]:
    if (f := folder / f"{name}.parquet").exists():
        t = pq.read_table(f)
        return {c: np.asarray(t[c].to_pylist()) for c in t.column_names}
    if (f := folder / f"{name}.npz").exists():
        return dict(np.load(f))
    d = np.genfromtxt(folder / f"{name}.csv", delimiter=",", names=True, dtype=None, encoding="utf8")
    return {c: d[c] for c in d.dtype.names}


def zero_noise(index: int) -> float:
    """Largest force difference [N] between the chain and Rᵀ(f_contact + m(g − a)) with Pinocchio's kinematics."""
    r, case, rng = Robot.load(URDF), table()[index], np.random.default_rng(3)
    th = theta(**{k: v for k, v in draw(case.par, rng).items() if k in ("K", "N", "XR", "C", "MU", "MB", "LAM")})
    env, q0 = place(r, rng)
    env, _ = off(env, rng)
    ex = execute(SCRIPTS[case.script](rng, case.opt), r, env, q0, th, rng)
    y, fc = predict(ex.motion, th, env)
    m, data = r.model, r.model.createData()
    fid, tip = m.getFrameId("ft_sensor"), m.getFrameId("tool_tip")
    ddq = np.gradient(ex.dq, ex.t, axis=0)
    worst = np.zeros(2)
    for k in range(50, len(ex.t) - 50, 37):
        pin.forwardKinematics(m, data, ex.q[k], ex.dq[k], ddq[k])
        pin.updateFramePlacements(m, data)
        W = pin.ReferenceFrame.LOCAL_WORLD_ALIGNED
        v, a, o = pin.getFrameVelocity(m, data, fid, W), pin.getFrameClassicalAcceleration(m, data, fid, W), data.oMf[fid]
        c = o.rotation @ env.com
        acc = a.linear + np.cross(a.angular, c) + np.cross(v.angular, np.cross(v.angular, c))
        F = fc[k] @ np.stack([env.normal, env.t1, np.cross(env.normal, env.t1)])
        tool = env.mass * (env.gravity - acc)
        f = o.rotation.T @ (F + tool)
        tau = o.rotation.T @ (np.cross(c, tool) + np.cross(data.oMf[tip].translation - o.translation, F))
        worst = np.maximum(worst, [np.abs(f - y[k, :3]).max(), np.abs(tau - y[k, 3:]).max()])
    print(f"case {index} without noise: force off by {worst[0]:.1e} N, torque off by {worst[1]:.1e} N·m")
    return float(worst.max())


def main() -> None:
    root = File(sys.argv[1])
    for i in (3, 6, 24):
        zero_noise(i)
    m = pin.buildModelFromUrdf(URDF)
    data, fid, tip = m.createData(), m.getFrameId("ft_sensor"), m.getFrameId("tool_tip")
    for e in json.loads((root / "truth.json").read_text()):
        d, rig = load(root / e["case"]), tomllib.loads((root / e["case"] / "rig.toml").read_text())
        bad = [k for k, v in d.items() if v.dtype.kind == "f" and not np.isfinite(v).all()]
        line = f"{e['case']} {e['kind']:7s} n={len(d['t'])} dt>0 {bool((np.diff(d['t']) > 0).all())} bad {bad}"
        if ("dq1" in d) != any((root / e["case"]).glob("log_nodq.*")):
            line += " NODQ?"
        if e["kind"] == "wrench":
            q = np.stack([d[f"q{j}"] for j in range(1, 8)], 1)
            n, t1 = (np.array(rig["surface"][k]) for k in ("normal", "tangent"))
            s, air, N, T, dep, sl = rig["surface"], [], [], [], [], []
            for k in range(0, len(q), max(1, len(q) // 1500)):
                pin.framesForwardKinematics(m, data, q[k])
                R, x = data.oMf[fid].rotation, data.oMf[tip].translation - np.array(s["point"])
                f = np.array([d[c][k] for c in ("fx", "fy", "fz")])
                c = R @ f - rig["tool"]["mass"] * np.array([0, 0, -9.81])
                dep.append(-x @ n), sl.append([x @ t1, x @ np.cross(n, t1)]), N.append(c @ n), T.append([c @ t1, c @ np.cross(n, t1)])
                air.append(R.T @ np.array([0, 0, -9.81]) * rig["tool"]["mass"] - f)
            dep, sl, N, T, air = map(np.array, (dep, sl, N, T, air))
            free, in_ = dep < -2e-3, dep > 1e-3
            v = np.gradient(sl, axis=0)
            fast = in_ & (np.abs(v).max(1) > 0.3 * np.abs(v[in_]).max())
            line += (f" air rms {np.sqrt((air[free]**2).mean()):.3f} N; N in contact {N[in_].min():.2f}..{N[in_].max():.1f}; T.v<0 in {(np.sum(T[fast] * v[fast], 1) < 0).mean():.2f}"
                     f"; depth max {1e3 * dep.max():.2f} mm; in contact {in_.mean():.2f}")
        elif e["kind"] == "tester":
            line += f" depth max {1e3 * d['depth'].max():.2f} mm force {d['normal_force'].min():.2f}..{d['normal_force'].max():.2f}"
        else:
            line += f" q {d['q1'].min():.2f}..{d['q1'].max():.2f} tau1 {d['tau1'].min():.1f}..{d['tau1'].max():.1f}"
        print(line, e["effects"] if e["effect_rms"] < 2.5 * e["left_rms"] and e["group"] in ("single", "pair", "outside") else "")


if __name__ == "__main__":
    main()
