"""Joint-torque logs of the arm: Bullet's links, our drives on top (flat outputs of the two-mass drive: θ = q + τ_J/K, τ_m = τ_J + B θ̈ + F(θ̇, τ_J))."""
from __future__ import annotations

import numpy as np
from numba import njit
from scipy.signal import butter, filtfilt

import instruments as ins
from arm import RIGID, Arm, Tool
from drive import dahl
from truth import Signals, alike, calm, project, rms

FCJ = np.array([2.5, 2.5, 1.6, 1.8, 1.2, 0.7, 0.6])       # N·m, motor-side, a good fifth of the published 11.9 … 6.04 (after the controller's own compensation)
FVJ = np.array([3.0, 3.0, 1.8, 2.0, 1.0, 0.5, 0.5])       # N·m·s/rad
BJ = np.array([0.9, 0.9, 0.51, 0.51, 0.2, 0.13, 0.13])    # kg·m² reflected (FloBaRoID's estimates)
NOISE = np.array([0.07, 0.07, 0.04, 0.04, 0.04, 0.015, 0.015])
MEMORY = {"cable", "warming", "load-cogging"}


@njit(cache=True)
def bristles(q, ell):
    """Dahl states along joint paths (N×n), one length a joint [rad]."""
    z = np.zeros_like(q)
    for j in range(q.shape[1]):
        for i in range(1, len(q)):
            z[i, j] = dahl(z[i - 1, j], q[i, j] - q[i - 1, j], ell[j])
    return z


def trajectory(rng, T: float, dt: float, pace: str) -> tuple:
    """Fourier paths of a phase s(t) whose rate makes slow, fast and resting parts. Returns q, v, a (N×7)."""
    n = int(T / dt)
    rate, i = np.zeros(n), int(0.3 / dt)
    levels = {"normal": [1, 1, 0.6], "slow-fast": [1, 0.3, 0.12, 0.06], "rests": [1, 0, 0.7, 0], "brisk": [1, 1.0], "static": [0.03], "fast": [1.0]}[pace]
    k = 0
    while i < n - int(0.4 / dt):
        lv = levels[k % len(levels)]
        m = int((1.2 if lv == 0 else rng.uniform(2, 4)) / dt)
        rate[i:i + m] = lv
        i += m
        k += 1
    rate[n - int(0.4 / dt):] = 0
    w = int(0.12 / dt)
    for _ in range(2):
        rate = np.convolve(rate, np.ones(w) / w, "same")
    s = np.cumsum(rate) * dt
    f0 = rng.uniform(0.16, 0.22) if pace == "brisk" else rng.uniform(0.09, 0.13)
    q0 = np.array([rng.uniform(-0.6, 0.6), rng.uniform(-0.6, 0.6), rng.uniform(-0.5, 0.5), rng.choice([-1, 1]) * rng.uniform(0.7, 1.1), rng.uniform(-0.5, 0.5), rng.uniform(-0.6, 0.6), 0])
    lim_q, lim_v = np.array([1.4, 0.9, 1.3, 0.8, 1.4, 1.0, 1.5]), np.array([1.2, 1.0, 1.4, 1.3, 1.8, 1.7, 1.9])
    q = np.zeros((n, 7))
    for j in range(7):
        x = np.zeros(n)
        for h in (1, 2, 3, 5) if pace == "brisk" else (1, 2, 3):
            x += rng.uniform(0.4, 1) / h ** (0.6 if pace == "brisk" else 0.9) * np.sin(2 * np.pi * f0 * h * (1 + 0.07 * j) * s + rng.uniform(0, 6.28))
        scale = min(lim_q[j] / np.max(np.abs(x)), lim_v[j] / np.max(np.abs(np.gradient(x, dt))) if pace != "static" else 9)
        q[:, j] = q0[j] + scale * x
    v = np.gradient(q, dt, axis=0)
    return q, v, np.gradient(v, dt, axis=0)


def case(rng, spec: dict, amps: dict, urdf: str) -> dict:
    """Simulate and measure one joint log; see generate.py for the keys of spec. Returns log columns, rig, truth numbers."""
    model, hidden, group = spec["model"], spec["hidden"], spec["group"]
    every = set(model) | set(hidden)
    nz = ins.draw(rng, False, group == "none")
    T, dt = (spec.get("T") or rng.uniform(14, 34)), 1e-3
    if T > 60:
        nz["rate"] = 200.0
    if group in ("none", "weak", "unexcited") or {"sensor-lag", "time-offset", "joint-elasticity", "rotor-inertia", "joint-torque-ripple", "load-cogging", "joint-stribeck-friction"} & every:
        nz["torque_lowpass_hz"] = nz["torque_rate"] = 0.0
    if {'joint-elasticity', 'rotor-inertia', 'joint-stribeck-friction', 'joint-friction-asymmetry'} & every:
        nz['encoder'] = min(nz['encoder'], 1e-5)
    has = lambda n: n in every
    amp = lambda n: amps.get(n, 1.0) if n in hidden else 1.0
    U = lambda a, b: rng.uniform(a, b, 7)
    sgn = lambda: rng.choice([-1.0, 1.0], 7)
    tool_m, tool_c = rng.choice([0.24, 0.4, 0.6]), 0.049
    nominal = Arm(urdf, Tool(float(tool_m), (0, 0, tool_c)))
    true_tool = Tool(float(tool_m * (1 + nz["tool_mass_error"])), (0, 0, tool_c * (1 + nz["tool_com_error"])))
    grav = lambda deg: 9.81 * np.array([np.sin(np.radians(deg)) * np.cos(nz["tilt_dir"]), np.sin(np.radians(deg)) * np.sin(nz["tilt_dir"]), -np.cos(np.radians(deg))])
    nuis = Arm(urdf, true_tool, grav(nz["base_tilt_deg"]))
    pay = (rng.uniform(0.5, 0.9) * amp("payload"), (rng.uniform(-0.04, 0.04), rng.uniform(-0.04, 0.04), rng.uniform(0.04, 0.12))) if has("payload") else None
    tilt_hidden = rng.uniform(3, 6) * amp("gravity-error")
    g = grav(tilt_hidden) if has("gravity-error") else nuis.gravity
    true = Arm(urdf, true_tool, g, pay)
    qr, vr, ar = trajectory(rng, T, dt, spec.get("pace", "normal"))
    b, a = butter(2, 7 * 2 * dt)
    dist = filtfilt(b, a, rng.standard_normal(qr.shape), axis=0) * 0.2 * np.array([1.5, 1.5, 0.4, 0.4, 0.01, 0.01, 0.001])
    sim = nuis.__class__.simulate(true, qr, vr, ar, dt, 2 * np.pi * nz["controller_hz"], 0.7, dist)
    t, tauJ = sim["t"], sim["tau"]
    q, v, acc = sim["q"], sim["v"], sim["a"]
    par: dict = {}
    if has("joint-elasticity"):
        par["stiffness"] = np.array([1e4] * 5 + [7.5e3] * 2) / (5 * amp("joint-elasticity")) * U(0.8, 1.2)
        b, a = butter(2, 30 * 2 * dt)
        q = q + filtfilt(b, a, tauJ, axis=0) / par["stiffness"]
        v = np.gradient(q, dt, axis=0)
        acc = np.gradient(v, dt, axis=0)
    rounded = bool(rng.random() < 0.4)
    ell, vr_ = (rng.uniform(1e-5, 3e-5), rng.uniform(2e-4, 6e-4)) if spec.get("pace") == "slow-fast" else (rng.uniform(2e-5, 1.2e-4), rng.uniform(5e-4, 3e-3))
    z = v / np.sqrt(v ** 2 + vr_ ** 2) if rounded else bristles(q, np.full(7, ell))
    fc, fv = FCJ * U(0.7, 1.5) * amp("joint-coulomb-friction"), FVJ * U(0.5, 1.3) * amp("joint-viscous-friction")
    vs, kr = rng.uniform(0.03, 0.08), float(rng.choice([6, 8, 12, 16, 20, 30, 40]))
    terms = {}
    put = lambda name, x, **p: (terms.update({name: x}), par.update(p)) if has(name) else None
    put("joint-coulomb-friction", fc * z, coulomb=fc)
    put("joint-viscous-friction", fv * v, viscous=fv)
    x = 0.35 * fc * sgn() * U(0.5, 1) * amp("joint-friction-asymmetry")
    put("joint-friction-asymmetry", x * np.abs(z), asymmetry=x)
    x = np.array([1.6, 2.0, 1.0, 1.2, 0.7, 0.4, 0.3]) * sgn() * U(0.5, 1) * amp("joint-torque-offset")
    put("joint-torque-offset", x * np.ones_like(v), offset=x)
    x = BJ * U(1.0, 2.0) * amp("rotor-inertia")
    put("rotor-inertia", x * acc, rotor=x)
    x = 0.7 * fc * U(0.6, 1.2) * amp("joint-stribeck-friction")
    put("joint-stribeck-friction", x * z * np.exp(-(v / vs) ** 2), stribeck=x, vs=vs)
    x = U(0.05, 0.1) * amp("joint-load-friction")
    put("joint-load-friction", x * z * np.abs(tauJ), load=x)
    x, ph = np.array([1.2, 1.5, 0.8, 0.9, 0.6, 0.3, 0.3]) * U(0.6, 1.3) * amp("joint-torque-ripple"), U(0, 6.28)
    put("joint-torque-ripple", x * (np.sin(kr * q + ph) + 0.35 * np.sin(2 * kr * q + 2.1 * ph)), ripple=x, k=kr)
    x = np.array([4, 8, 3, 6, 2, 1, 1]) * np.isin(np.arange(7), rng.choice(7, 4, replace=False, p=[.2, .3, .1, .2, .1, .05, .05])) * U(0.7, 1.3) * amp("joint-spring")
    put("joint-spring", x * q, spring=x)
    if "cable" in hidden:
        x = np.array([2.5, 3.0, 1.8, 2.0, 1.0, 0.4, 0.3]) * U(0.8, 1.3) * amps.get("cable", 1.0)
        terms["cable"] = x * (0.6 * bristles(q, np.full(7, 0.35)) + 0.4 * bristles(q, np.full(7, 0.9)))
        par["cable"] = x
    if "warming" in hidden:
        fv_boost = 1.5 + amps.get("warming", 1.0)
        terms["joint-viscous-friction"] = fv_boost * terms["joint-viscous-friction"]
        power = np.abs((terms["joint-viscous-friction"] + terms.get("joint-coulomb-friction", 0)) * v)
        Tm = np.cumsum(ins.first_order(power, dt, 1.0) - 0, axis=0) * dt
        Tm = 40 * (1 - np.exp(-Tm / (0.45 * Tm[-1] + 1e-9)))           # K above start: adiabatic at first, then settling
        terms["warming"] = terms["joint-viscous-friction"] * (np.exp(-0.028 * Tm) - 1)
        par["warming_end_K"] = Tm[-1]
    if "load-cogging" in hidden:
        x = U(0.10, 0.16) * amps.get("load-cogging", 1.0)
        terms["load-cogging"] = x * np.abs(tauJ) * np.sin(kr * q + ph)
        par.update(k=kr, load_cogging=x)
    tau = tauJ + sum(terms.values())
    # instruments
    ts = ins.log_clock(rng, T, nz["rate"], nz["jitter"], nz["drop"])
    tau_l = ins.at(t, tau, ts)
    effect = {n: ins.at(t, x, ts) for n, x in terms.items()}
    if has("joint-torque-gain"):
        gain = U(0.03, 0.09) * sgn() * amp("joint-torque-gain")
        effect["joint-torque-gain"], tau, par["gain"] = gain * tau_l, tau * (1 + gain), gain
    if has("time-offset"):
        par["delay"] = float(rng.uniform(0.010, 0.025) * amp("time-offset"))
        effect["time-offset"] = ins.at(t, tau, ts - par["delay"]) - ins.at(t, tau, ts)
        tau = ins.at(t, tau, t - par["delay"])
    if has("sensor-lag"):
        par["lag"] = float(rng.uniform(0.012, 0.03) * amp("sensor-lag"))
        y = ins.first_order(tau, dt, par["lag"])
        effect["sensor-lag"], tau = ins.at(t, y - tau, ts), y
    clean_l = ins.at(t, tau, ts)
    if nz["torque_lowpass_hz"] > 0:
        tau = ins.first_order(tau, dt, 1 / (2 * np.pi * nz["torque_lowpass_hz"]))
    lag_rms = rms(ins.at(t, tau, ts) - clean_l)
    if nz["torque_rate"] > 0:
        grid = np.arange(0, T, 1 / nz["torque_rate"])
        y = ins.lin(grid, ins.at(t, tau, grid), ts - nz["clock"])
    else:
        y = ins.at(t, tau, ts - nz["clock"])
    sigma = NOISE * rng.uniform(0.7, 1.6)
    y = ins.bend(y, nz["nonlinearity"]) + sigma * rng.standard_normal(y.shape) + nz["drift_share"] * sigma * (ts / ts[-1])[:, None] * sgn()
    if has("quantization"):
        par["step"] = float(rng.choice([1.0, 1.5, 2.0]) * amp("quantization"))
        yq = np.round(y / par["step"]) * par["step"]
        effect["quantization"], y = yq - y, yq
    q_ideal, v_ideal, a_ideal = (ins.at(t, x, ts) for x in (q, v, acc))
    qm = ins.encode(rng, q_ideal, nz["encoder"])
    # truth
    rows = np.flatnonzero(np.any(np.abs(v_ideal) > 0.01, axis=1))
    rows = rows[np.linspace(0, len(rows) - 1, min(1300, len(rows))).astype(int)]
    tJ = ins.at(t, tauJ, ts)
    for h in set(hidden) & RIGID:
        e = np.zeros_like(y)
        e[rows] = tJ[rows] - nuis.rnea(q_ideal[rows], v_ideal[rows], a_ideal[rows])
        effect[h] = e
    def signals(q_, v_, a_):
        S = Signals(ts[rows], q_[rows], v_[rows], a_[rows], tJ[rows], kr, vs, vr_ if rounded else (5e-4 if spec.get('pace') == 'slow-fast' else 2e-3), nominal)
        dt_ = np.gradient(clean_l, axis=0) / np.gradient(ts)[:, None]
        S.cache["dtau"] = dt_[rows]
        d2 = filtfilt(*butter(2, 20 * 2 * dt), tauJ, axis=0)
        S.cache["ddtau"] = ins.at(t, np.gradient(np.gradient(d2, dt, axis=0), dt, axis=0), ts)[rows]
        return S
    S, best = signals(q_ideal, v_ideal, a_ideal), None
    for fc_ in (6.0, 12.0, 25.0):
        qh, vh, ah = ins.derivatives(ts, qm, fc_)
        M = signals(qh, vh, ah)
        r = y[rows] - nominal.rnea(M.q, M.v, M.a) - sum(effect[h][rows] for h in hidden)
        for M.vr in (3e-4, 1e-3, 3e-3):
            p = project(r, model, M)
            best = p if best is None or rms(p) < rms(best) else best
    left = rms(best[calm(t, v, ts[rows], 0.02)])
    each = {h: rms(project(effect[h][rows], model + [o for o in hidden if o != h and o not in MEMORY], S)) for h in hidden}
    total = rms(project(sum((effect[h][rows] for h in hidden), np.zeros((len(rows), 7))), model, S))
    near = alike(sum(effect[h][rows] for h in hidden), model, hidden, S, left, group == "outside") if group not in ("none", "pair") and hidden != ["quantization"] else []
    if {"sensor-lag", "time-offset"} & set(hidden) and "quantization" not in hidden:
        near = sorted(set(near) | ({"sensor-lag", "time-offset"} - every if left > 0.2 * each.get("sensor-lag", each.get("time-offset", 0)) else set()))
    if lag_rms > 0.5 * left:
        near = sorted(set(near) | {"sensor-lag"})
    cols = {"t": ts} | {f"q{j+1}": qm[:, j] for j in range(7)}
    if nz["dq"]:
        dq = ins.measured_dq(rng, t, v, ts, nz)
        cols |= {f"dq{j+1}": dq[:, j] for j in range(7)}
    cols |= {f"tau{j+1}": y[:, j] for j in range(7)}
    rig = f'[robot]\nmodel = "lwr4plus"\ngravity = [0.0, 0.0, -9.81]\n\n[tool]\nmass = {tool_m}\ncom = [0.0, 0.0, {tool_c}]\n'
    nz |= {"torque_noise": sigma, "friction": "rounded" if rounded else "dahl", "bristle_rad": ell, "rounding": vr_, "lag_rms": lag_rms}
    return {"cols": cols, "rig": rig, "each": each, "total": total, "left": left, "reading": rms(y[rows]), "near": near, "unit": "N·m", "nuisances": nz, "par": par,
            "by_joint": np.sqrt(np.mean(sum((effect[h][rows] for h in hidden), np.zeros((len(rows), 7))) ** 2, axis=0))}
