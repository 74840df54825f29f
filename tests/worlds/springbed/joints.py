"""Joint-torque logs of the freely moving LWR4+ (7 joints) and of single drives: inverse dynamics plus drive friction.

Friction: generalized Maxwell-slip (Al-Bender, Lampaert, Swevers 2005; four elements, short lengths) whose limit is the static curve of Bittencourt &
Gunnarsson (2012): Fc + f_load |tau_load| + Fs exp(-|v/vs|^a) + Fv v, with a = 1.9 and near-linear viscosity. SI units; torques on the link side.
"""
from __future__ import annotations

from pathlib import Path

import numpy as np
from numba import njit
from scipy.ndimage import gaussian_filter1d
from scipy.spatial.transform import Rotation as Rot

import arm as am
import instruments as ins

G = np.array([0, 0, -9.81])
FC = np.array([.8, .8, .55, .55, .45, .3, .3])        # link-side Coulomb [N m]
FV = np.array([.9, .9, .5, .6, .3, .2, .15])          # link-side viscous [N m s]
SD = np.array([.07, .07, .04, .04, .03, .015, .015])  # torque noise [N m]
JM = np.array([.9, .9, .51, .51, .2, .13, .13])       # reflected rotor inertia [kg m2]
ALT = {"joint-coulomb-friction": [], "payload": ["gravity-error"], "gravity-error": ["payload"], "joint-friction-asymmetry": ["joint-torque-offset"],
       "joint-torque-offset": ["joint-friction-asymmetry"], "joint-elasticity": ["gravity-error"], "joint-viscous-friction": ["joint-stribeck-friction"],
       "joint-stribeck-friction": [], "joint-load-friction": [], "joint-spring": ["gravity-error"], "rotor-inertia": [], "joint-torque-gain": [], "joint-torque-ripple": []}


@njit(cache=True)
def gms(v, dt, lim, length):
    """Generalized Maxwell-slip friction in units of its limit: four Jenkins elements of stiffness 1/length spread; v (n,k)."""
    n, k = v.shape
    a = np.array([.4, .3, .2, .1])
    L = np.array([.4, .8, 1.4, 2.2]) * length
    z = np.zeros((k, 4))
    F = np.zeros((n, k))
    for i in range(n):
        for j in range(k):
            for e in range(4):
                z[j, e] = min(max(z[j, e] + v[i, j] * dt / L[e], -1.0), 1.0)
                F[i, j] += a[e] * z[j, e]
            F[i, j] *= lim[i, j]
    return F


def excite(rng: np.random.Generator, T: float, dt: float, k: int, q0: np.ndarray, amp: np.ndarray, vmax: np.ndarray, slow: bool, wide: bool) -> tuple[np.ndarray, ...]:
    """Fourier-series motion (Swevers 1997) under a smooth change of pace: t, q, dq, ddq [rad, s]."""
    t = np.arange(0, T, dt)
    pace = np.where((t % 10) < (4 if slow else 0), .12, 1.0) if slow else np.where((t % 12) < 3, .45, 1.0)
    win = np.hanning(int(.8 / dt))
    pace = np.convolve(np.pad(pace, len(win) // 2, mode="edge"), win / win.sum(), mode="same")[len(win) // 2:][:len(t)]
    pace *= np.clip((t - .4) / .8, 0, 1) ** 2 * (3 - 2 * np.clip((t - .4) / .8, 0, 1))
    s = np.concatenate([[0], np.cumsum((pace[1:] + pace[:-1]) / 2 * dt)])
    ds = np.gradient(pace, dt)
    q, d1, d2 = (np.zeros((len(t), k)) for _ in range(3))
    w0 = 2 * np.pi * (.06 if wide else .11)
    for j in range(k):
        for h in range(1, 6):
            c, ph, w = rng.uniform(.4, 1) / h ** (1.3 if wide else .5), rng.uniform(0, 2 * np.pi), w0 * h
            q[:, j] += c * np.sin(w * s + ph)
            d1[:, j] += c * w * np.cos(w * s + ph)
            d2[:, j] -= c * w * w * np.sin(w * s + ph)
        f = min(amp[j] / np.abs(q[:, j]).max(), .85 * vmax[j] / np.abs(d1[:, j]).max())
        q[:, j], d1[:, j], d2[:, j] = q0[j] + f * q[:, j], f * d1[:, j], f * d2[:, j]
    return t, q, d1 * pace[:, None], d2 * pace[:, None] ** 2 + d1 * ds[:, None]


def run_case(seed: list[int], spec: dict, A: am.Arm, folder: Path | None, amp: float = 1.0) -> dict:
    """Simulate, write and judge one joints or drive case."""
    rng = np.random.default_rng(seed)
    drive, hidden, model, out = spec["kind"] == "drive", spec["hidden"], spec["model"], spec.get("outside", "")
    names, nu, k = set(model) | set(hidden), {}, 1 if spec["kind"] == "drive" else 7
    on = lambda n: n in names
    c = lambda n: amp if n in hidden else .8
    T = spec.get("T", rng.uniform(22, 38))
    rate = spec.get("rate", float(rng.choice([100, 200, 250, 500, 1000], p=[.15, .25, .25, .25, .1])))
    dt = 1e-3 if drive or rate > 500 else 2e-3
    fc, fv, sd, jm = (np.array([rng.uniform(*b)]) for b in ((.8, 2), (.3, .8), (.02, .04), (.3, .6))) if drive else (FC, FV, SD * rng.uniform(.6, 1), JM)
    if out == "warm-up":                                  # motor-side friction (Jubien 2014), no link-side torque sensor
        fc, fv = 8 * FC, 8 * FV
    q0 = np.zeros(k) if drive else np.array([0, -.3, 0, .8, 0, -.5, 0]) * rng.uniform(.7, 1.3)
    wide = bool(names & {"joint-torque-ripple", "joint-spring"}) or out == "position-friction"
    lim = np.array([9.0]) if drive else .9 * A.qmax - np.abs(q0)
    sl = on("joint-stribeck-friction") or on("joint-load-friction") or rng.random() < .3
    t, q, v, a = excite(rng, T, dt, k, q0, lim * (1 if wide or drive else rng.uniform(.5, .8)), np.array([4.0]) if drive else A.vmax, sl and spec.get("slow", True), wide)
    g, base, Aw = G.copy(), None, A
    if not drive:
        Aw = A.with_tool(.24, np.array([0, 0, .0612]))
        mp = rng.uniform(.35, .6) * c("payload")
        lv = np.deg2rad(rng.uniform(0, .2)) * np.array([np.cos(T), np.sin(T), 0])
        if on("gravity-error"):
            lv = np.deg2rad(rng.uniform(3, 5) * c("gravity-error")) * np.array([np.cos(T), np.sin(T), 0])
        g = Rot.from_rotvec(lv).apply(G)
    if out == "moving-base":                              # arm on a cart that sways
        fr = rng.uniform(.9, 1.6)
        base = amp * .9 * np.stack([np.sin(2 * np.pi * fr * t), .7 * np.sin(2 * np.pi * fr * 1.27 * t + 1), 0 * t], 1)
    part = rng.uniform(.7, 1.3, k)
    period, phase = rng.integers(1, 4, k), rng.uniform(0, 6, k)
    Lz = rng.uniform(2e-4, 8e-4)
    elas = rng.uniform(1200, 2500) / c("joint-elasticity") * np.array([1, 1, 1, 1, 1, .6, .6])

    def torque(sk: set[str], o: str) -> np.ndarray:
        """Joint torques with the effects `sk` (names) and the outside effect o."""
        arm = Aw.with_tool(mp, np.array([.01, 0, .14])) if "payload" in sk else Aw
        gg = g if "gravity-error" in sk or not on("gravity-error") else G
        if drive:
            rb = jm * a
        else:
            rb = am.torques(arm, q, v, a, gg, base if o == "moving-base" else None)
            if "joint-elasticity" in sk:                  # encoder on the motor: the link hangs by tau/K
                for _ in range(3):
                    e = gaussian_filter1d(rb / elas, .03 / dt, axis=0)
                    ve = np.gradient(e, dt, axis=0)
                    rb = am.torques(arm, q - e, v - ve, a - np.gradient(ve, dt, axis=0), gg)
        tau = rb.copy()
        if not drive and "rotor-inertia" in sk:
            tau += jm * part * c("rotor-inertia") * a
        limf = np.zeros_like(v)
        if "joint-coulomb-friction" in sk:
            limf += fc * part
        if "joint-stribeck-friction" in sk:
            limf += .6 * fc * c("joint-stribeck-friction") * np.exp(-(np.abs(v) / (.12 if not drive else .25)) ** 1.9)
        if "joint-load-friction" in sk:
            limf += .05 * c("joint-load-friction") * np.abs(rb)
        if o == "position-friction":
            limf *= 1 + .6 * min(amp, 1.5) * np.cos(period * q + phase)
        fr_ = gms(v, dt, limf, Lz)
        warm = 1 + (.6 * amp * np.exp(-t / 45) if o == "warm-up" else 0 * t)[:, None]
        if "joint-viscous-friction" in sk:
            fr_ += fv * part[::-1] * v * warm * (1 - .004 * np.abs(v))
        if o == "brake":                                  # eddy-current brake peaking at a critical speed (Smythe 1942)
            fr_ += 4 * amp * fc * (v / .5) / (1 + (v / .5) ** 2)
        if "joint-friction-asymmetry" in sk:
            fr_ += .5 * c("joint-friction-asymmetry") * np.abs(gms(v, dt, fc * part + 0 * v, Lz))
        tau += fr_
        if "joint-torque-offset" in sk:
            tau += .5 * FC[:k] * part * np.where(phase > 3, 1, -1) * c("joint-torque-offset")
        if "joint-torque-ripple" in sk:
            A_ = .45 * fc * part * c("joint-torque-ripple")
            tau += A_ * (np.sin((period + 2) * 2 * q + phase) + .3 * np.sin((period + 2) * 4 * q + 2 * phase))
        if "joint-spring" in sk:
            tau += 1.2 * fc * part * c("joint-spring") * (q - q0)
        if "joint-torque-gain" in sk:
            tau *= 1 + .06 * c("joint-torque-gain") * np.where(phase > 3, 1, -1) * part
        return tau

    tau = torque(names, out)
    clean = tau.copy()
    nl = rng.uniform(-1, 1) * (.002 if spec["group"] == "none" else .005)
    tau = tau * (1 + nl * tau / (np.abs(tau).max(0) + 1e-9))
    tl = ins.sample_times(rng, T, rate, nu)
    near, note = [], ""
    if rng.random() < .5:
        lag_ok = rng.random() < .8
        cut = rng.uniform(25, 50) if lag_ok else rng.uniform(10, 25)
        tau = ins.lowpass(tau, 1 / dt, cut)
        note = f"torque low-pass {cut:.1f} Hz (first order, causal; all joints)."
        near += [] if lag_ok else ["sensor-lag"]
    clk = rng.uniform(-2e-4, 2e-4)
    at = lambda x, tt: np.stack([np.interp(tt, t, x[:, j]) for j in range(k)], 1)
    share, nc = rng.uniform(.2, .6), rng.uniform(50, 200)
    drift = rng.uniform(-.5, .5, k) * sd
    meas = at(tau, tl - clk) + ins.noise(rng, len(tl), rate, sd, share, nc) + np.outer(tl / T, drift)
    if rng.random() < .25 and rate >= 200:
        t2 = tl[::int(rng.integers(2, 4))]
        hold = rng.random() < .3 and rate >= 400
        m2 = meas[np.searchsorted(tl, t2)]
        meas = m2[np.clip(np.searchsorted(t2, tl, side="right") - 1, 0, len(t2) - 1)] if hold else np.stack([np.interp(tl, t2, m2[:, j]) for j in range(k)], 1)
        note += f" torques logged slower ({len(t2) / T:.0f} Hz, {'hold' if hold else 'interpolated'})."
    enc = 10 ** rng.uniform(np.log10(2e-6), -3)
    Qm, V = ins.encoder(at(q, tl), enc), at(v, tl)
    dq = ins.rates(rng, tl, V, rate, nu)
    nu.update(encoder_step_rad=float(enc), noise_sd=sd.tolist(), coloured_share=float(share), coloured_cut_hz=float(nc), clock_off_s=float(clk), sensor_nonlinearity=float(nl), friction_length_rad=float(Lz))
    cols = {"t": tl} | {f"q{j+1}": Qm[:, j] for j in range(k)}
    if dq is not None:
        cols |= {f"dq{j+1}": dq[:, j] for j in range(k)}
    cols |= {f"tau{j+1}": meas[:, j] for j in range(k)}
    # judge: linear regressors of what the user's model holds, per joint
    mot = np.abs(V) > .004
    rb = np.ones((len(tl), k)) if drive else at(am.torques(A.with_tool(.24, np.array([0, 0, .0612])), q, v, a, G), tl)
    av, Vq = at(a, tl), V
    gr = [np.zeros_like(rb)] * 0
    if not drive:
        T0 = am.torques(Aw, q, 0 * v, 0 * a, G)
        gr = [at(am.torques(Aw, q, 0 * v, 0 * a, G + e) - T0, tl) for e in (np.array([1.0, 0, 0]), np.array([0, 1.0, 0]))]
        pay = at(am.torques(A.with_tool(.24 + .4, np.array([0, 0, .09])), q, v, a, G), tl) - rb

    def regs(ns: set[str], j: int) -> np.ndarray:
        """Regressors of the laws ns at joint j."""
        s_ = gms(v, dt, np.ones_like(v), Lz)[:, [j]]
        sg = at(np.tile(s_, (1, k)), tl)[:, 0]
        x = Vq[:, j]
        R = {"joint-coulomb-friction": [sg], "joint-viscous-friction": [x], "joint-torque-offset": [np.ones_like(x)], "joint-stribeck-friction": [sg * np.exp(-(x / (.12 if not drive else .25)) ** 2)],
             "joint-load-friction": [sg * np.abs(rb[:, j])], "joint-friction-asymmetry": [np.abs(sg)], "rotor-inertia": [av[:, j]], "joint-torque-gain": [meas[:, j] * 0 + rb[:, j]],
             "joint-torque-ripple": [f(h * (period[j] + 2) * 2 * Qm[:, j]) for h in (1, 2) for f in (np.sin, np.cos)], "joint-spring": [Qm[:, j]] + [np.ones_like(x)]}
        cols_ = [z for n in sorted(ns) for z in R.get(n, [])] + ([av[:, j]] if drive else [])
        if not drive:
            cols_ += [gg[:, j] for gg in gr] if "gravity-error" in ns else []
            cols_ += [pay[:, j]] if "payload" in ns else []
        return np.stack(cols_, 1) if cols_ else np.zeros((len(x), 0))

    def left_over(e: np.ndarray, ns: set[str]) -> float:
        """rms over joints in motion of e after least squares on the regressors of ns."""
        r2, n = 0.0, 0
        for j in range(k):
            Xr, m = regs(ns, j), mot[:, j]
            r = e[m, j] - (Xr[m] @ np.linalg.lstsq(Xr[m], e[m, j], rcond=None)[0] if Xr.shape[1] else 0)
            r2, n = r2 + np.sum(r * r), n + m.sum()
        return float(np.sqrt(r2 / n))

    each = {}
    left = left_over(meas - at(clean, tl), set(model))
    for h in hidden:
        e = at(clean - torque(names - {h}, out), tl)
        mm = set(model) | (set(hidden) - {h})
        each[h] = left_over(e, mm)
        near += [x for x in ALT.get(h, []) if x not in mm and left_over(e, mm | {x}) < .7 * left]
    if out:
        each[out] = left_over(at(clean - torque(names, ""), tl), set(model))
    # own inverse with the true model's catalogue regressors
    inv = left_over(meas - (0 if drive else rb), names)
    read = float(np.sqrt(np.mean(meas[mot] ** 2)))
    if folder is not None:
        ins.write_log(folder, cols, spec.get("fmt", "parquet"))
        rig = {"sensor": {}} if drive else {"robot": dict(model="lwr4plus", sensor_frame="ft_sensor", tip_frame="tool_tip"), "tool": dict(mass=.24, com=[0.0, 0.0, .049])}
        ins.write_rig(folder, rig)
    return dict(effect_rms=min(each.values()) if each else 0.0, left_rms=left, reading_rms=read, each=each, near=list(dict.fromkeys(near)), unit="N·m", nuisances=nu, noise_rms=float(np.sqrt(np.mean(sd ** 2))),
                inverse_rms=inv, notes=f"{spec.get('notes', '')} {note} duration {T:.0f} s. inverse residual with true model {inv:.4f} N·m".strip())
