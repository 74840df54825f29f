"""Drive logs (t, q1, tau1): the two-mass model of drive.py, measured at the motor (angle and torque at the gear's output side)."""
from __future__ import annotations

import numpy as np
from scipy.signal import butter, filtfilt

import drive as dv
import instruments as ins
from truth import Signals, alike, calm, project, rms

STRUCT = {"joint-elasticity", "backlash"}
OUTSIDE = {"warming": 8, "load-cogging": 9}


def case(rng, spec: dict, amps: dict, urdf: str) -> dict:
    """Simulate and measure one drive log."""
    model, hidden, group = spec["model"], spec["hidden"], spec["group"]
    every = set(model) | set(hidden)
    nz = ins.draw(rng, False, group == "none")
    for k in ("base_tilt_deg", "tilt_dir", "tool_mass_error", "tool_com_error"):
        nz.pop(k)
    nz["controller_hz"] = float(rng.choice([6, 8, 12]))
    has = lambda n: n in every
    amp = lambda n: amps.get(n, 1.0) if n in hidden else 1.0
    linear = bool(rng.random() < 0.35) and not {"joint-torque-ripple", "load-cogging"} & every
    if group in ("none", "weak", "unexcited") or {"sensor-lag", "time-offset", "joint-elasticity", "backlash", "joint-torque-ripple", "load-cogging", "joint-stribeck-friction"} & every:
        nz["torque_lowpass_hz"] = nz["torque_rate"] = 0.0
    if {"joint-elasticity", "joint-torque-ripple", "backlash", "load-cogging", "sensor-lag", "time-offset"} & every:
        nz["encoder"] = min(nz["encoder"], 2e-5)
        nz["rate"] = max(nz["rate"], 500.0)
        nz["torque_rate"] = 0.0
    if linear:
        nz["encoder"] = min(nz["encoder"], 5e-6)
    if nz["rate"] < 300:
        nz["rate"] = 333.0
    T, dt, sub = spec.get("T") or rng.uniform(14, 36), 5e-4, 10
    if T > 60:
        nz["rate"] = 200.0
    J = rng.uniform(12, 50) if linear else rng.uniform(0.4, 1.8)        # kg or kg·m²
    vmax = rng.uniform(0.25, 0.5) if linear else rng.uniform(1.2, 2.4)
    span = vmax * rng.uniform(0.5, 0.8)
    scale = J * vmax * 6                                                # a typical inertial torque (N or N·m)
    brisk = {"joint-elasticity", "sensor-lag", "time-offset", "backlash"} & every
    fmax, chirp = (3.0, 7.0) if brisk else (2.0, 0.0)
    r, vr, ar = dv.motion(rng, T, dt, vmax * (0.5 if brisk else 1), span, "joint-stribeck-friction" in every and spec.get("pace") != "fast",
                          "joint-friction-asymmetry" in every, fmax, chirp)
    if spec.get("pace") == "static":
        r, vr, ar = r, vr * 1.0, ar
    P = np.zeros(32)
    jm = rng.uniform(0.4, 0.7)
    P[dv.JM], P[dv.JL] = jm * J, (1 - jm) * J
    fa = rng.uniform(70, 120)                                           # antiresonance (motor held) [Hz]
    if has("joint-elasticity") and group != "unexcited":
        fa = rng.uniform(18, 24) / np.sqrt(amp("joint-elasticity"))
        P[dv.JM], P[dv.JL] = 0.3 * J, 0.7 * J
    P[dv.KG] = P[dv.JL] * (2 * np.pi * fa) ** 2
    P[dv.DG] = 2 * 0.05 * np.sqrt(P[dv.KG] * P[dv.JL])
    P[dv.ELL], P[dv.WS], P[dv.XC], P[dv.HX], P[dv.CTH] = (vmax * rng.uniform(3e-5, 2e-4), vmax * rng.uniform(0.06, 0.11), 0.5, 1e-3, 0)
    rounded = bool(rng.random() < 0.35)
    P[dv.VRD] = vmax * rng.uniform(1.5e-3, 4e-3) if rounded else 0.0
    u = rng.uniform
    fc = 0.22 * scale * u(0.6, 1.3)
    P[dv.FC] = fc * amp("joint-coulomb-friction") * has("joint-coulomb-friction")
    P[dv.FV] = 0.25 * scale / vmax * u(0.6, 1.3) * amp("joint-viscous-friction") * has("joint-viscous-friction")
    P[dv.ASYM] = 0.35 * fc * rng.choice([-1, 1]) * amp("joint-friction-asymmetry") * has("joint-friction-asymmetry")
    P[dv.OFF] = 0.2 * scale * rng.choice([-1, 1]) * u(0.7, 1.3) * amp("joint-torque-offset") * has("joint-torque-offset")
    P[dv.FS] = 0.7 * fc * u(0.8, 1.3) * amp("joint-stribeck-friction") * has("joint-stribeck-friction")
    if "joint-stribeck-friction" in hidden and group == "unexcited":
        P[dv.WS] *= 0.05
        P[dv.FS] *= 0.3
    P[dv.FL] = u(0.2, 0.35) * amp("joint-load-friction") * has("joint-load-friction")
    P[dv.KSPR] = 0.5 * scale / span * u(0.6, 1.2) * amp("joint-spring") * has("joint-spring")
    P[dv.KR] = max(4.0, float(np.round(u(14, 45) / vmax)))
    P[dv.A1] = 0.12 * scale * u(0.7, 1.2) * amp("joint-torque-ripple") * has("joint-torque-ripple")
    P[dv.A2], P[dv.PH1], P[dv.PH2] = 0.35 * P[dv.A1], u(0, 6.28), u(0, 6.28)
    P[dv.COG], P[dv.NCOG], P[dv.PHC] = 0.35 * amps.get("load-cogging", 1) * ("load-cogging" in hidden), P[dv.KR], u(0, 6.28)
    if "load-cogging" in hidden:
        P[dv.NCOG] = P[dv.KR]
    if "warming" in hidden:
        P[dv.BETA] = 0.03 * amps.get("warming", 1)
        P[dv.FV] *= 2.0
        P[dv.HTH] = 1 / 90.0
        P[dv.CTH] = 35 * P[dv.HTH] / (P[dv.FV] * vmax ** 2 * 0.14 + P[dv.FC] * vmax * 0.3)
    if "backlash" in hidden:
        P[dv.JM], P[dv.JL] = 0.35 * J, 0.65 * J
        P[dv.KG] = P[dv.JL] * (2 * np.pi * 45) ** 2
        P[dv.DG] = 2 * 0.12 * np.sqrt(P[dv.KG] * P[dv.JL])
        P[dv.BACK] = 0.002 * vmax * amps.get("backlash", 1)
    if rng.random() < 0.4:                                              # hysteresis of the gear's spring, a nuisance
        P[dv.HA] = 0.03 * scale
        P[dv.HX] = P[dv.HA] / P[dv.KG]
    P[dv.COMP] = u(0.93, 0.99)                                          # the controller's friction feed-forward
    wn = 2 * np.pi * nz["controller_hz"]
    b, a = butter(2, 12 * 2 * dt)
    dist = filtfilt(b, a, rng.standard_normal(len(r))) * 0.01 * scale
    x, terms = dv.simulate(r, vr, ar, dt, sub, P, J * wn ** 2, 2 * 0.7 * J * wn, dist)
    t = np.arange(len(r)) * dt
    q, v, acc, tg, tau = x[:, :1], x[:, 1:2], x[:, 2:3], x[:, 3:4], x[:, 4:5]
    ts = ins.log_clock(rng, T, nz["rate"], nz["jitter"], nz["drop"])
    eff = {n: terms[:, i:i + 1] for i, n in enumerate(dv.TERMS)}
    par = {"inertia": J, "motor_share": float(P[dv.JM] / J), "antiresonance_hz": float(np.sqrt(P[dv.KG] / P[dv.JL]) / 2 / np.pi), "linear": linear}
    for s in STRUCT & set(hidden):
        eff[s] = tau * 0
    effect = {n: ins.at(t, e, ts) for n, e in eff.items() if n in every}
    clean = tau
    if has("time-offset"):
        par["delay"] = float(u(0.010, 0.020) * amp("time-offset"))
        y = ins.at(t, tau, t - par["delay"])
        effect["time-offset"], tau = ins.at(t, y - tau, ts), y
    if has("sensor-lag"):
        par["lag"] = float(u(0.012, 0.025) * amp("sensor-lag"))
        y = ins.first_order(tau, dt, par["lag"])
        effect["sensor-lag"], tau = ins.at(t, y - tau, ts), y
    before = ins.at(t, tau, ts)
    if nz["torque_lowpass_hz"] > 0:
        tau = ins.first_order(tau, dt, 1 / (2 * np.pi * nz["torque_lowpass_hz"]))
    lag_rms = rms(ins.at(t, tau, ts) - before)
    if nz["torque_rate"] > 0:
        grid = np.arange(0, T, 1 / nz["torque_rate"])
        y = ins.lin(grid, ins.at(t, tau, grid), ts - nz["clock"])
    else:
        y = ins.at(t, tau, ts - nz["clock"])
    sigma = rms(clean) * rng.uniform(0.004, 0.012)
    y = ins.bend(y, nz["nonlinearity"]) + sigma * rng.standard_normal(y.shape) + nz["drift_share"] * sigma * (ts / ts[-1])[:, None]
    if has("quantization"):
        par["step"] = float("%.2g" % (rms(clean) * u(0.15, 0.25) * amp("quantization")))
        yq = np.round(y / par["step"]) * par["step"]
        effect["quantization"], y = yq - y, yq
    q_i, v_i, a_i = (ins.at(t, z, ts) for z in (q, v, acc))
    qm = ins.encode(rng, q_i, nz["encoder"])
    for s in STRUCT & set(hidden):                                      # as an inverse of finite bandwidth sees it
        effect[s] = ins.at(t, clean - terms[:, :10].sum(axis=1, keepdims=True), ts) - J * ins.derivatives(ts, q_i, 30.0)[2]
    rows = np.flatnonzero(np.abs(v_i[:, 0]) > 0.002 * vmax)
    rows = rows[np.linspace(0, len(rows) - 1, min(5000, len(rows))).astype(int)]
    load = tg + eff["joint-spring"] * 0
    lo = butter(2, 25 * 2 * dt)
    td = filtfilt(*lo, clean, axis=0)
    ders = [ins.at(t, np.gradient(td, dt, axis=0), ts)[rows], ins.at(t, np.gradient(np.gradient(td, dt, axis=0), dt, axis=0), ts)[rows]]

    def signals(q_, v_, a_):
        S = Signals(ts[rows], q_[rows], v_[rows], a_[rows], ins.at(t, load, ts)[rows], P[dv.KR], P[dv.WS], P[dv.VRD] or 1e-3 * vmax)
        S.cache |= {"dtau": ders[0], "ddtau": ders[1]}
        return S
    S, best = signals(q_i, v_i, a_i), None
    zero = np.zeros((len(rows), 1))
    for fc_ in (30.0,) if STRUCT & set(hidden) else (6.0, 12.0, 25.0, 60.0):
        M = signals(*ins.derivatives(ts, qm, min(fc_, nz["rate"] / 5)))
        for M.vr in (0.5 * S.vr, S.vr, 3 * S.vr, 8 * S.vr):
            res = project(y[rows] - J * M.a - sum((effect[h][rows] for h in hidden), zero), model, M)
            best = res if best is None or rms(res) < rms(best) else best
    left = rms(best[calm(t, v, ts[rows], 0.04)])
    own = set(STRUCT) | set(OUTSIDE)
    each = {h: rms(project(effect[h][rows], model + [o for o in hidden if o != h and o not in own], S)) for h in hidden}
    esum = sum((effect[h][rows] for h in hidden), zero)
    cand = [c for c in ("joint-coulomb-friction", "joint-viscous-friction", "joint-friction-asymmetry", "joint-torque-offset", "joint-stribeck-friction", "joint-load-friction",
                        "joint-torque-ripple", "joint-spring", "joint-elasticity", "time-offset", "sensor-lag")]
    near = alike(esum, model, hidden, S, left, group == "outside", cand) if group not in ("none", "pair") and hidden != ["quantization"] else []
    if {"sensor-lag", "time-offset"} & set(hidden) and left > 0.2 * max(each.values()):
        near = sorted(set(near) | {"sensor-lag", "time-offset"} - every)
    if lag_rms > 0.5 * left and "sensor-lag" not in hidden:
        near = sorted(set(near) | {"sensor-lag"})
    cols = {"t": ts, "q1": qm[:, 0]}
    if nz["dq"]:
        cols["dq1"] = ins.measured_dq(rng, t, v, ts, nz)[:, 0]
    cols["tau1"] = y[:, 0]
    nz |= {"torque_noise": sigma, "friction": "rounded" if rounded else "dahl", "bristle": P[dv.ELL], "rounding": P[dv.VRD], "lag_rms": lag_rms}
    rig = f"# one axis, {'a linear stage: q1 in m, tau1 in N' if linear else 'q1 in rad, tau1 in N·m'}, both at the gear's output; inertia unknown\n"
    par |= {k: float(P[getattr(dv, k)]) for k in ("FC", "FV", "FS", "WS", "FL", "KSPR", "A1", "KR", "OFF", "ASYM", "BACK", "COG", "BETA", "HA", "COMP")}
    return {"cols": cols, "rig": rig, "each": each, "total": rms(project(esum, model, S)) if hidden else 0.0, "left": left, "reading": rms(y[rows]), "near": near,
            "unit": "N" if linear else "N·m", "nuisances": nz, "par": par}
