"""Wrench logs: the arm in Bullet pokes and slides on a plane of material; readings in the sensor frame as contracts.md says."""
from __future__ import annotations

import numpy as np
import pinocchio as pin
from scipy.interpolate import CubicSpline

import arm as am
import instruments as ins
from arm import Arm, Tool, contact_path, fk_path
from drive import dahl
from truth import residual, rms

OFF = {"viscous-damping": {am.C: 0}, "hunt-crossley-damping": {am.LAM: 0}, "relaxation": {am.RATIO: 0}, "coulomb-friction": {am.MU: 0}, "stribeck-friction": {am.DMU: 0},
       "presliding": {am.LEN: 1e-4}, "viscous-friction": {am.CT: 0}, "load-dependent-friction": {am.PLOAD: 0}, "friction-anisotropy": {am.ANISO: 0},
       "stiffness-inhomogeneity": {am.KBLOB: 0}, "squeeze": {am.QUAD: 0}, "wear-in": {am.WEAR: 0}, "friction-rounding": {am.VR: 1e-4}}
FREE = {"hooke": [am.K], "kelvin-voigt": [am.K, am.C], "hunt-crossley": [am.K, am.NEXP, am.LAM], "viscous-damping": [am.C], "hunt-crossley-damping": [am.LAM],
        "relaxation": [am.RATIO], "coulomb-friction": [am.MU], "stribeck-friction": [am.DMU], "presliding": [am.LEN], "viscous-friction": [am.CT],
        "load-dependent-friction": [am.PLOAD], "friction-anisotropy": [am.ANISO], "stiffness-inhomogeneity": [am.KBLOB], "friction-rounding": [am.VR]}
STEP = {am.C: 1.0, am.LAM: 0.1, am.RATIO: 0.02, am.DMU: 0.02, am.CT: 0.5, am.PLOAD: 0.02, am.ANISO: 0.02, am.KBLOB: 0.02, am.LEN: 2e-5, am.MU: 0.02, am.VR: 1e-4}
BODY = {"tool-mass", "sensor-bias", "sensor-gain", "hose", "sensor-crosstalk"}
Q0 = np.array([0, -0.5, 0, 1.4, 0, -1.24, 0])


def plan(rng, frame, p0, spec: dict, depth: float, every: set) -> tuple:
    """Tip path [m], rotations and phases at 200 Hz: free turns, pokes with holds at several depths and speeds, slides along both tangents."""
    way, H = [], 0.02
    add = lambda T, x, phase, tilt=(0, 0): way.append((T, np.array(x, float), np.array(tilt, float), phase))
    add(0.4, (0, 0, H), "free")
    free = BODY & every
    for _ in range(5 if free else 2):
        far = 0.08 if "hose" not in every else 0.17
        add(1.1 if free else 0.8, (rng.uniform(-far, far), rng.uniform(-far, far), H + rng.uniform(0.04, 0.12)), "free", rng.uniform(-0.45, 0.45, 2))
    add(0.9, (0, 0, H), "free")
    speeds = [0.012, 0.03, 0.07, 0.12]
    places = [(0.0, 0.0), (0.02, 0.015), (-0.025, 0.01), (0.01, -0.02)]
    for i in range(4 if spec["slide"] else 6):
        x = places[i % 4] if i < 5 else (0.0, 0.0)
        d, s = depth * [1.0, 0.6, 0.8, 0.4, 0.9, 1.0][i], speeds[(i + rng.integers(2)) % 4]
        add(0.6, (*x, 0.006), "free")
        add((0.006 + d) / s, (*x, -d), "poke")
        add(1.2 if "relaxation" in every else 0.5, (*x, -d), "hold")
        add((0.006 + d) / min(s, 0.04), (*x, 0.006), "retract")
    if spec["slide"]:
        v = [0.004, 0.012, 0.03, 0.07] if {"stribeck-friction", "friction-rounding"} & every else [0.01, 0.03, 0.07]
        for d in (0.5 * depth, depth):
            add(0.6, (0, 0, 0.006), "free")
            add(0.5, (0, 0, -d), "poke")
            for s in v:
                L = min(0.02, 0.45 * s)
                for x in ((L, 0), (-L, 0), (0, 0), (0, L), (0, -L), (0, 0)) if not ("presliding" in every and s < 0.02) else ((3e-3, 0), (-2e-3, 0), (2e-3, 1e-3), (0, -2e-3), (0, 2e-3), (0, 0)):
                    step = np.linalg.norm(np.array([*x, -d]) - way[-1][1])
                    add(max(step / s * 1.15, 0.12), (*x, -d), "slide")
            add(0.5, (0, 0, H), "retract")
    add(1.0, (0.03, 0.02, H + 0.04), "free", (0.2, -0.1))
    dt, X, W, ph = 5e-3, [], [], []
    x, w = way[0][1], way[0][2]
    for T, x1, w1, name in way:
        n = max(2, int(T / dt))
        s = np.linspace(0, 1, n, endpoint=False)
        a = 0.18
        u = np.interp(s, [0, a, 1 - a, 1], [0, 1, 1, 0])
        u = np.sin(0.5 * np.pi * u) ** 2
        f = np.concatenate([[0], np.cumsum(u)[:-1]]) / np.sum(u)
        X.append(x + f[:, None] * (x1 - x)); W.append(w + f[:, None] * (w1 - w)); ph += [name] * n
        x, w = x1, w1
    X, W = np.vstack(X), np.vstack(W)
    R0 = fk_path(Q0[None], *spec["geo"])[0][0]
    down = np.column_stack([frame[1], np.cross(-frame[0], frame[1]), -frame[0]])
    down = down if np.trace(down.T @ R0) > 0 else down @ np.diag([-1.0, -1.0, 1.0])
    rot = np.array([down @ pin.exp3(np.array([*w, 0])) for w in W])
    return np.arange(len(X)) * dt, p0 + X[:, :1] * frame[1] + X[:, 1:2] * frame[2] + X[:, 2:] * frame[0], rot, np.array(ph)


def predict(M: dict, P: np.ndarray, ext: dict) -> np.ndarray:
    """Force readings (N×3) along a motion: contact law + tool + what the sensor adds."""
    L = contact_path(M["t"], M["X"], M["V"], P)
    F = L[:, :1] * M["frame"][0] + L[:, 1:2] * M["frame"][1] + L[:, 2:] * M["frame"][2]
    f = np.einsum("nji,nj->ni", M["R"], F + (M["mass"] + ext.get("tool-mass", 0.0)) * M["ga"])
    f = f @ (np.eye(3) + ext.get("sensor-crosstalk", np.zeros((3, 3)))).T * (1 + ext.get("sensor-gain", 0.0)) + ext.get("sensor-bias", np.zeros(3))
    return f + ext.get("hose", 0.0)


def jac(names: list, M: dict, P: np.ndarray, ext: dict, rows) -> list:
    """Finite-difference columns of the named effects' parameters."""
    base, cols = predict(M, P, ext), []
    push = lambda f, h: cols.append(((f - base)[rows] / h).ravel())
    for n in names:
        for i in FREE.get(n, []):
            h = STEP.get(i, 0.01 * P[i])
            Q = P.copy()
            Q[i] += h
            push(predict(M, Q, ext), h)
        if n == "tool-mass":
            push(predict(M, P, ext | {n: ext.get(n, 0) + 0.01}), 0.01)
        if n == "sensor-gain":
            push(predict(M, P, ext | {n: ext.get(n, 0) + 0.01}), 0.01)
        if n == "sensor-bias":
            for e in np.eye(3):
                push(base + e, 1.0)
        if n == "sensor-crosstalk":
            for i in range(3):
                for j in range(3):
                    if i != j:
                        D = np.zeros_like(base)
                        D[:, i] = base[:, j]
                        push(base + D, 1.0)
        if n == "sensor-drift":
            for e in np.eye(3):
                push(base + e * M["t"][:, None], 1.0)
        if n in ("time-offset", "sensor-lag"):
            push(base + np.gradient(base, axis=0) / np.gradient(M["t"])[:, None], 1.0)
    return cols


def case(rng, spec: dict, amps: dict, urdf: str) -> dict:
    """Simulate and measure one wrench log."""
    model, hidden, group = spec["model"], spec["hidden"], spec["group"]
    every = set(model) | set(hidden)
    nz = ins.draw(rng, True, group == "none")
    nz["rate"] = float(rng.choice([500, 500, 800, 1000]))
    nz["nonlinearity"] *= 0.5
    nz["controller_hz"] = max(9.0, nz["controller_hz"])
    has, u = lambda n: n in every, rng.uniform
    amp = lambda n: amps.get(n, 1.0) if n in hidden else 1.0
    tool_m, tool_c, dt = 0.24, 0.049, 5e-4
    grav = 9.81 * np.array([np.sin(np.radians(nz["base_tilt_deg"])) * np.cos(nz["tilt_dir"]), np.sin(np.radians(nz["base_tilt_deg"])) * np.sin(nz["tilt_dir"]), -np.cos(np.radians(nz["base_tilt_deg"]))])
    ext: dict = {}
    if has("tool-mass"):
        ext["tool-mass"] = u(0.06, 0.09) * amp("tool-mass")
    true_tool = Tool(tool_m * (1 + nz["tool_mass_error"]) + ext.get("tool-mass", 0.0), (0, 0, tool_c * (1 + nz["tool_com_error"])))
    robot = Arm(urdf, true_tool, grav)
    tip = robot.tip
    # material
    base = model[0]
    P = np.zeros(am.NPAR)
    P[[am.TAU_R, am.VS, am.N0, am.LEN, am.WEARL, am.BLOBW]] = [u(0.3, 1.0), u(0.012, 0.025), 5.0, 1e-4, 0.12, 4e-3]
    depth = u(0.004, 0.0065)
    if base == "hunt-crossley":
        P[am.NEXP] = u(1.3, 1.55)
        P[am.K], P[am.LAM] = u(6, 11) / depth ** P[am.NEXP], u(1.0, 2.0)
    else:
        P[am.NEXP] = 1 + u(-0.006, 0.006)
        P[am.K] = u(7, 13) / depth ** P[am.NEXP]
        P[am.C] = u(15, 30) if base == "kelvin-voigt" else 0
    if has("viscous-damping"):
        P[am.C] = u(30, 45) * amp("viscous-damping")
    if has("hunt-crossley-damping"):
        P[am.LAM] = u(2.5, 4) * amp("hunt-crossley-damping")
    if has("relaxation"):
        P[am.RATIO] = u(0.3, 0.5) * amp("relaxation")
    P[am.MU] = u(0.35, 0.6) * amp("coulomb-friction") * has("coulomb-friction")
    P[am.DMU] = u(0.12, 0.18) * amp("stribeck-friction") * has("stribeck-friction")
    P[am.CT] = u(8, 14) * amp("viscous-friction") * has("viscous-friction")
    P[am.PLOAD] = -min(u(0.25, 0.4) * amp("load-dependent-friction"), 0.5) * has("load-dependent-friction")
    P[am.ANISO] = u(0.15, 0.25) * amp("friction-anisotropy") * has("friction-anisotropy")
    P[am.KBLOB] = u(0.3, 0.5) * amp("stiffness-inhomogeneity") * has("stiffness-inhomogeneity")
    P[am.BLOBX] = u(-0.004, 0.006)
    P[am.LEN] = u(0.8e-3, 1.5e-3) * amp("presliding") if has("presliding") else 1e-4
    P[am.VR] = u(8e-3, 1.5e-2) if has("friction-rounding") else 0.0
    P[am.SIG1] = 0.0
    P[am.QUAD] = u(120, 200) * amps.get("squeeze", 1) * ("squeeze" in hidden)
    P[am.WEAR] = u(0.9, 1.3) * amps.get("wear-in", 1) * ("wear-in" in hidden)
    # place
    nrm = np.array([u(-0.12, 0.12), u(-0.12, 0.12), 1.0]) if rng.random() < 0.5 else np.array([0, 0, 1.0])
    nrm = np.round(nrm / np.linalg.norm(nrm), 6)
    nrm /= np.linalg.norm(nrm)
    t1 = np.array([1.0, 0, 0]) - nrm[0] * nrm
    t1 /= np.linalg.norm(t1)
    frame = np.array([nrm, t1, np.cross(nrm, t1)])
    p0 = np.round(np.array([u(0.5, 0.6), u(-0.12, 0.12), u(0.12, 0.25)]), 3)
    p_true = p0 + frame[0] * u(-2e-5, 2e-5)
    spec = spec | {"geo": (robot.off, robot.ax, tip)}
    tr, xr, rot, ph = plan(rng, frame, p0, spec, depth, every)
    qk = robot.ik(xr, rot, Q0)
    t = np.arange(0, tr[-1], dt)
    cs = CubicSpline(tr, qk, axis=0)
    qr, vr, ar = cs(t), cs(t, 1), cs(t, 2)
    k_ = np.ones(25) / 25
    ar = np.apply_along_axis(lambda c: np.convolve(c, k_, "same"), 0, ar)
    sim = robot.simulate(qr, vr, ar, dt, 2 * np.pi * nz["controller_hz"] * 1.6, 0.8, np.zeros_like(qr), {"frame": frame, "point": p_true, "P": P})
    q = sim["q"]
    acc = robot.com_acc(q, dt, true_tool.com)
    w = robot.wrench(q, sim["force"], acc, true_tool)
    R, p_com = fk_path(q, robot.off, robot.ax, robot.ft + np.array(true_tool.com))
    par: dict = {}
    if "hose" in hidden:
        state, F = np.zeros(3), np.zeros_like(p_com)
        anchor = p_com[0] + np.array([0, 0, 0.25])
        for i in range(1, len(p_com)):
            for j in range(3):
                state[j] = dahl(state[j], p_com[i, j] - p_com[i - 1, j], 0.045)
            F[i] = -0.9 * state - 2.5 * (p_com[i] - anchor) * np.array([1, 1, 0.3])
        h = np.einsum("nji,nj->ni", R, F * amps.get("hose", 1.0))
        w = w + np.hstack([h, np.cross(np.array(true_tool.com), h)])
    ts = ins.log_clock(rng, t[-1], nz["rate"], nz["jitter"], nz["drop"])
    y = ins.lin(t, w, ts - nz["clock"])
    gain = ext_cross = None
    if has("sensor-gain"):
        ext["sensor-gain"] = gain = u(0.06, 0.1) * rng.choice([-1, 1]) * amp("sensor-gain")
        y = y * (1 + gain)
    if has("sensor-crosstalk"):
        ext["sensor-crosstalk"] = ext_cross = np.triu(rng.choice([-1, 1], (3, 3)) * u(0.06, 0.12, (3, 3)), 1) * amp("sensor-crosstalk")
        y[:, :3] = y[:, :3] @ (np.eye(3) + ext_cross).T
    if has("sensor-bias"):
        ext["sensor-bias"] = rng.choice([-1, 1], 3) * u(0.3, 0.6, 3) * amp("sensor-bias")
        y[:, :3] += ext["sensor-bias"]
        y[:, 3:] += rng.choice([-1, 1], 3) * u(0.005, 0.02, 3) * amp("sensor-bias")
    s = u(0.01, 0.04) * np.array([1, 1, 1.5])
    st = u(3e-4, 8e-4)
    sig = np.concatenate([s, [st] * 3])
    y = ins.bend(y, nz["nonlinearity"]) + sig * rng.standard_normal(y.shape) + nz["drift_share"] * sig * (ts / ts[-1])[:, None]
    qm = ins.encode(rng, ins.at(t, q, ts), nz["encoder"])

    def motion(q_, v_, tt, a_com, gm) -> dict:
        Rm, p = fk_path(q_, robot.off, robot.ax, tip)
        x = (p - gm["point"]) @ frame.T
        xd = v_ if v_ is not None else np.gradient(x, axis=0) / np.gradient(tt)[:, None]
        X, V = np.column_stack([-x[:, 0], x[:, 1], x[:, 2]]), np.column_stack([-xd[:, 0], xd[:, 1], xd[:, 2]])
        return {"t": tt, "X": X, "V": V, "R": Rm, "frame": frame, "mass": gm["mass"], "ga": gm["g"] - a_com}
    xs = (fk_path(q, robot.off, robot.ax, tip)[1] - p_true) @ frame.T
    dec = 2
    ideal = motion(q[::dec], (np.gradient(xs, dt, axis=0))[::dec], t[::dec], acc[::dec], {"point": p_true, "mass": true_tool.mass - ext.get("tool-mass", 0.0), "g": grav})
    hose = h[::dec] if "hose" in hidden else 0.0
    extI = ext | {"hose": hose}

    def without(drop):
        Q, e = P.copy(), {k: x for k, x in extI.items() if k not in drop}
        for n in drop:
            for i, x in OFF.get(n, {}).items():
                Q[i] = x
        return Q, e
    P0, e0 = without(hidden)
    touching = ideal["X"][:, 0] > 0
    rows = np.flatnonzero(touching) if not BODY & set(hidden) else np.arange(len(touching))
    rows = rows[np.linspace(0, len(rows) - 1, min(6000, len(rows))).astype(int)]
    full = predict(ideal, P, extI)
    check = rms(full - (ins.lin(t, w[:, :3], ideal["t"]) if not (gain or ext_cross is not None or has("sensor-bias")) else full))
    J0 = jac(model, ideal, P0, e0, rows)
    each = {}
    for hname in hidden:
        Q, e = without([hname])
        each[hname] = rms(residual((full - predict(ideal, Q, e))[rows].ravel(), jac(model + [o for o in hidden if o != hname], ideal, Q, e, rows)))
    esum = (full - predict(ideal, P0, e0))[rows].ravel()
    total = rms(residual(esum, J0))
    # left: the true model on the measured motion
    best = None
    for fc in (15.0, 30.0, 60.0):
        qh, vh, ah = ins.derivatives(ts, qm, fc)
        g = np.arange(ts[0], ts[-1], dt)
        _, pc = fk_path(qh, robot.off, robot.ax, robot.ft + np.array([0, 0, tool_c]))
        a_com = ins.derivatives(ts, pc, fc)[2]
        Mm = motion(qh, None, ts, a_com, {"point": p0, "mass": tool_m, "g": np.array([0, 0, -9.81])})
        em = {k: x for k, x in ext.items()} | ({"hose": ins.lin(t, h, ts)} if "hose" in hidden else {})
        mr = np.flatnonzero(Mm["X"][:, 0] > 0) if not BODY & set(hidden) else np.arange(len(ts))
        mr = mr[np.linspace(0, len(mr) - 1, min(6000, len(mr))).astype(int)]
        r = residual((y[:, :3] - predict(Mm, P, em))[mr].ravel(), jac(model + [o for o in hidden if o not in ("hose", "squeeze", "wear-in")], Mm, P, em, mr))
        best = r if best is None or rms(r) < rms(best) else best
    left = rms(best)
    near = []
    if group not in ("none", "pair"):
        b0 = rms(residual(esum, J0))
        names = ["viscous-damping", "hunt-crossley-damping", "relaxation", "stribeck-friction", "presliding", "viscous-friction", "load-dependent-friction", "friction-anisotropy",
                 "tool-mass", "sensor-bias", "sensor-gain", "sensor-crosstalk", "sensor-drift", "time-offset", "sensor-lag", "coulomb-friction", "stiffness-inhomogeneity"]
        for c in names:
            if c in every or (c == "viscous-damping" and base == "kelvin-voigt") or (c == "hunt-crossley-damping" and base == "hunt-crossley"):
                continue
            rest = rms(residual(esum, J0 + jac([c], ideal, P0, e0, rows)))
            if (rest ** 2 < 0.6 * b0 ** 2) if group == "outside" else (rest < 0.5 * left and rest < 0.7 * b0):
                near.append(c)
    cols = {"t": ts} | {f"q{j+1}": qm[:, j] for j in range(7)}
    if nz["dq"]:
        dq = ins.measured_dq(rng, t, sim["v"], ts, nz)
        cols |= {f"dq{j+1}": dq[:, j] for j in range(7)}
    cols |= {n: y[:, j] for j, n in enumerate(("fx", "fy", "fz", "tx", "ty", "tz"))}
    if rng.random() < 0.6:
        cols["phase"] = ph[np.clip(np.searchsorted(tr, ts) - 1, 0, len(ph) - 1)].tolist()
    fmt = lambda x: "[" + ", ".join(f"{z:.9g}" for z in x) + "]"
    rig = (f'[robot]\nmodel = "lwr4plus"\nsensor_frame = "ft_sensor"\ntip_frame = "tool_tip"\ngravity = [0.0, 0.0, -9.81]\n\n[tool]\nmass = {tool_m}\ncom = [0.0, 0.0, {tool_c}]\n\n'
           f"[surface]\npoint = {fmt(p0)}\nnormal = {fmt(nrm)}\ntangent = {fmt(t1)}\n\n[sensor]\nrange = [40, 40, 120, 2, 2, 2]\n")
    nz |= {"force_noise": s, "torque_noise": st, "surface_off": float((p_true - p0) @ frame[0])}
    for k in ("torque_lowpass_hz", "torque_rate"):
        nz.pop(k)
    names = {v: k for k, v in vars(am).items() if isinstance(v, int) and k.isupper() and k != "NPAR"}
    par |= {names[i]: float(P[i]) for i in range(am.NPAR)} | {k: x for k, x in ext.items()} | {"chain_check": check, "depth": depth, "max_depth": float(ideal["X"][:, 0].max())}
    return {"cols": cols, "rig": rig, "each": each, "total": total, "left": left, "reading": rms(full[rows]), "near": near, "unit": "N", "nuisances": nz, "par": par}
