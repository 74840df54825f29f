"""check.py DIR: do the logs obey the contract? Pinocchio rederives the wrench of the free tool (a free-flyer body's rnea), contact signs and joint torques; the truth's
bookkeeping is checked too (counts, sizes, near names, values). Exits 1 if something is wrong."""
import collections
import json
import pathlib
import sys
import tomllib

import numpy as np
import pinocchio as pin
import pyarrow.parquet as pq
from scipy.signal import savgol_filter

HERE = pathlib.Path(__file__).resolve().parent
COUNTS = dict(single=22, none=9, pair=7, outside=6, unexcited=2, weak=2)
KINDS = dict(wrench=20, tester=10, joints=7, drive=4)
bad = []


def need(ok, text):
    if not ok:
        bad.append(text)
        print("  WRONG:", text)


def read(folder):
    f = next(folder.glob("log.*"))
    if f.suffix == ".parquet":
        return {k: np.asarray(v) for k, v in pq.read_table(f).to_pydict().items()}
    if f.suffix == ".npz":
        return dict(np.load(f))
    rows = [x.split(",") for x in f.read_text().split("\n") if x]
    return {k: np.array([r[i].strip() for r in rows[1:]]).astype(str if k == "phase" else float) for i, k in enumerate(rows[0])}


def robot(folder, rig):
    name = rig["robot"]["model"]
    path = folder / name if name.endswith(".urdf") else HERE / "urdf" / f"{name}.urdf"
    m = pin.buildModelFromUrdf(str(path))
    m.gravity.linear[:] = rig["robot"].get("gravity", [0, 0, -9.81])
    need(list(m.names)[1:] == rig["robot"]["joints"], f"{folder.name}: joint order")
    return m


def uniform(t, Q, span):
    dt = np.median(np.diff(t))
    tu = np.arange(t[0], t[-1], dt)
    U = np.column_stack([np.interp(tu, t, Q[:, i]) for i in range(Q.shape[1])])
    w = max(7, int(round(span / dt)) | 1)
    return tu, [savgol_filter(U, w, 3, deriv=k, delta=dt, axis=0) for k in range(3)]


def tool_load(m, rig, fr, tu, q, dq, ddq):
    """What the sensor reads of the tool alone, by rnea of a free-flying body carried along: minus the wrench that moves it."""
    data = m.createData()
    tool = rig["tool"]
    b = pin.Model()
    b.gravity.linear[:] = m.gravity.linear
    j = b.addJoint(0, pin.JointModelFreeFlyer(), pin.SE3.Identity(), "tool")
    I = np.zeros((3, 3))
    if "inertia" in tool:
        a, d, f, x, y, z = tool["inertia"]
        I = np.array([[a, x, y], [x, d, z], [y, z, f]])
    b.appendBodyToJoint(j, pin.Inertia(tool["mass"], np.array(tool["com"]), I), pin.SE3.Identity())
    bd = b.createData()
    out = []
    for k in range(len(tu)):
        pin.forwardKinematics(m, data, q[k], dq[k], ddq[k])
        pin.updateFramePlacements(m, data)
        M = data.oMf[fr]
        v = pin.getFrameVelocity(m, data, fr, pin.LOCAL)
        a = pin.getFrameAcceleration(m, data, fr, pin.LOCAL)
        out.append(-pin.rnea(b, bd, pin.SE3ToXYZQUAT(M), v.vector, a.vector))
    return np.array(out)


def wrench(folder, log, rig, e):
    m = robot(folder, rig)
    n = m.nq
    Q = np.column_stack([log[f"q{i + 1}"] for i in range(n)])
    Y = np.column_stack([log[k] for k in ("fx", "fy", "fz", "tx", "ty", "tz")])
    tu, (q, dq, ddq) = uniform(log["t"], Q, 0.03)
    idx = np.linspace(20, len(tu) - 21, 1500).astype(int)
    row = np.clip(np.searchsorted(log["t"], tu[idx]), 0, len(Y) - 1)
    fs, ft = m.getFrameId(rig["robot"]["sensor_frame"]), m.getFrameId(rig["robot"]["tip_frame"])
    W = tool_load(m, rig, fs, tu[idx], q[idx], dq[idx], ddq[idx])
    nrm = np.array(rig["surface"]["normal"], float)
    nrm /= np.linalg.norm(nrm)
    data = m.createData()
    D, Rn, tip, V = [], [], None, []
    for k in idx:
        pin.framesForwardKinematics(m, data, q[k])
        D.append(-(data.oMf[ft].translation - np.array(rig["surface"]["point"])) @ nrm)
        R = data.oMf[fs].rotation
        tip = R.T @ (data.oMf[ft].translation - data.oMf[fs].translation)
        Rn.append(R.T)
        V.append(pin.computeFrameJacobian(m, data, q[k], ft, pin.LOCAL_WORLD_ALIGNED)[:3] @ dq[k])
    D, Rn, V = np.array(D), np.array(Rn), np.array(V)
    r = Y[row] - W
    air = D < -3e-3
    f = np.sqrt((r[air, :3] ** 2).mean())
    g = np.sqrt((W[air, :3] ** 2).mean())
    flip = np.sqrt(((Y[row] + W)[air, :3] ** 2).mean())
    on = D > 0.4 * np.percentile(D, 99.5)
    N = (r[:, :3] * (Rn @ nrm)).sum(1)
    rel = np.sqrt(((r[on, 3:] - np.cross(tip, r[on, :3])) ** 2).mean()) / np.sqrt((r[on, 3:] ** 2).mean())
    Vt = V - (V @ nrm)[:, None] * nrm
    slip = on & (np.linalg.norm(Vt, axis=1) > 5e-3)
    power = (np.einsum("nij,nj->ni", Rn, Vt)[slip] * r[slip, :3]).sum(1)
    print(f"{folder.name} wrench free tool: left {f:.3f} N of {g:.2f} (sign turned: {flip:.2f}); in contact N > 0 {100 * (N[on] > 0).mean():.0f} %, moments - r x f {100 * rel:.0f} %, "
          f"friction brakes {100 * (power < 0).mean():.0f} %")
    if e["group"] == "none" and not {"sensor-bias", "sensor-drift"} & set(e["model"].split(",")):
        need(f < 0.35 * g and flip > 1.5 * g, f"{folder.name}: free tool")
        need((N[on] > 0).mean() > 0.97 and rel < 0.25, f"{folder.name}: contact")
        need((power < 0).mean() > 0.9, f"{folder.name}: friction")


def joints(folder, log, rig, e):
    m = robot(folder, rig) if rig["robot"]["model"] != "ur5" else pin.buildModelFromUrdf(str(HERE / "urdf" / "ur5.urdf"))
    n = m.nq
    if "tool" in rig:
        f = m.frames[m.getFrameId(rig["robot"]["sensor_frame"])]
        m.appendBodyToJoint(f.parentJoint, pin.Inertia(rig["tool"]["mass"], np.array(rig["tool"]["com"]), np.zeros((3, 3))), f.placement)
    data = m.createData()
    Q = np.column_stack([log[f"q{i + 1}"] for i in range(n)])
    Y = np.column_stack([log[f"tau{i + 1}"] for i in range(n)])
    tu, (q, dq, ddq) = uniform(log["t"], Q, 0.06)
    idx = np.linspace(20, len(tu) - 21, 1500).astype(int)
    row = np.clip(np.searchsorted(log["t"], tu[idx]), 0, len(Y) - 1)
    T = np.array([pin.rnea(m, data, q[k], dq[k], ddq[k]) for k in idx])
    r = Y[row] - T
    A = [np.linalg.lstsq(np.column_stack([np.sign(dq[idx, i]), dq[idx, i], ddq[idx, i], np.ones(len(idx))]), r[:, i], rcond=None)[0] for i in range(n)]
    left = np.column_stack([r[:, i] - np.column_stack([np.sign(dq[idx, i]), dq[idx, i], ddq[idx, i], np.ones(len(idx))]) @ A[i] for i in range(n)])
    print(f"{folder.name} joints: rnea + friction leave {np.sqrt((left ** 2).mean()):.2f} of {np.sqrt((Y ** 2).mean()):.2f} N m (turned sign {np.sqrt(((Y[row] + T) ** 2).mean()):.2f}); "
          f"friction {np.round([a[0] for a in A], 2)}")
    if e["group"] == "none":
        need(np.sqrt((left ** 2).mean()) < 0.12 * np.sqrt((Y ** 2).mean()), f"{folder.name}: joint torques")


def tester(folder, log, e):
    on = log["depth"] > 0.5 * np.percentile(log["depth"], 99.5)
    N = log["normal_force"]
    text = f"{folder.name} tester: N in contact {N[on].mean():.2f}, in the air {N[log['depth'] < -1e-4].mean():.3f} N"
    need(N[on].mean() > 2, f"{folder.name}: normal force")
    if "slip1" in log:
        dt = np.median(np.diff(log["t"]))
        w = max(7, int(0.03 / dt) | 1)
        v = savgol_filter(log["slip1"], w, 2, deriv=1, delta=dt)
        s = on & (np.abs(v) > 3e-3)
        p = (v[s] * log["tangential_force1"][s] < 0).mean()
        text += f", friction brakes {100 * p:.0f} %"
        need(p > 0.9 or e["group"] != "none", f"{folder.name}: friction sign")
    print(text)


def main(folder):
    truth = json.loads((folder / "truth.json").read_text())
    need(len(truth) == 48, f"{len(truth)} cases")
    g, k = (collections.Counter(e[x] for e in truth) for x in ("group", "kind"))
    need(dict(g) == COUNTS, f"groups {dict(g)}")
    need(all(k[x] >= c for x, c in KINDS.items()), f"kinds {dict(k)}")
    singles = [e["hidden"][0] for e in truth if e["group"] == "single"]
    need(len(set(singles)) == 22, "single effects come twice")
    for e in truth:
        f = folder / e["case"]
        log, rig = read(f), tomllib.loads((f / "rig.toml").read_text())
        t = log["t"]
        need((np.diff(t) > 0).all() and all(np.isfinite(v).all() for c, v in log.items() if c != "phase"), f"{e['case']}: times or numbers")
        need(not set(e["hidden"]) & set(e["model"].split(",")), f"{e['case']}: hidden in model")
        need(e["true_model"].split(",") == e["model"].split(",") + e["hidden"], f"{e['case']}: true model")
        need(isinstance(e.get("values"), dict), f"{e['case']}: values")
        many = isinstance(e["effect_rms"], dict)
        R = [e["effect_rms"][h] / e["left_rms"][h] for h in e["effect_rms"]] if many else [e["effect_rms"] / max(e["left_rms"], 1e-12)]
        lo, hi = {"single": (2.5, 8), "pair": (2.5, 8), "outside": (4, 99), "weak": (0, 0.8)}.get(e["group"], (0, 99))
        need(all(lo <= x <= hi for x in R), f"{e['case']}: ratio {R}")
        if e["group"] in ("single", "none", "pair"):
            need(e["fit_rms"] <= 1.001 * max(1.3 * e["noise_rms"], 0.017 * e["reading_rms"]), f"{e['case']}: fit {e['fit_rms']}")
        if e["group"] == "outside":
            need(e["effect_rms"] >= 0.07 * e["reading_rms"], f"{e['case']}: outside too small")
        if e["kind"] == "wrench":
            wrench(f, log, rig, e)
        elif e["kind"] == "tester":
            tester(f, log, e)
        elif e["kind"] == "joints":
            joints(f, log, rig, e)
    print(dict(g), dict(k), "sizes MB", round(sum(p.stat().st_size for p in folder.rglob("*") if p.is_file()) / 1e6))
    print("all in order" if not bad else f"{len(bad)} wrong: {bad}")
    return 1 if bad else 0


if __name__ == "__main__":
    sys.exit(main(pathlib.Path(sys.argv[1])))
