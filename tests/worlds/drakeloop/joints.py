"""Joint-torque logs of free motion: arm under joint impedance control along Fourier series. N m, rad, s."""
from __future__ import annotations
from typing import Any
import numpy as np
from numba import njit
from arm import Arm, Tool, simulate
from chain import Clock, at, draw_nuisances, encoders, lowpass, smooth_motion
import law

SIZE = np.array([1, 1, 0.6, 0.6, 0.3, 0.2, 0.15])     # joints' strength against each other
NOISE = np.array([0.07, 0.07, 0.04, 0.04, 0.03, 0.015, 0.015])   # torque noise [N m], lwr4plus.md 3
SINGLES = ("payload", "joint-viscous-friction", "joint-coulomb-friction", "joint-torque-offset", "joint-torque-gain", "rotor-inertia",
           "gravity-error", "joint-friction-asymmetry", "joint-spring", "time-offset", "joint-stribeck-friction", "joint-load-friction", "joint-torque-ripple")
OUT = ("friction-warm-up", "cable-coupling")


@njit(cache=True)
def bristle(q, l):
    """Dahl state -1..1 of every joint along a motion (n,7); l [rad]."""
    z = np.zeros_like(q)
    for i in range(1, len(q)):
        for j in range(7):
            x = q[i, j] - q[i - 1, j]
            s = 1.0 if x > 0 else -1.0
            z[i, j] = s + (z[i - 1, j] - s) * np.exp(-abs(x) / l)
    return z


def effect(name: str, a: dict, t, q, dq, ddq, z, tau0) -> np.ndarray:
    """Torque (n,7) [N m] that the effect adds to tau0 (rigid body) along the motion; a holds its sizes (7,)."""
    if name == "joint-viscous-friction":
        return a["fv"] * dq
    if name == "joint-coulomb-friction":
        return a["fc"] * z
    if name == "joint-torque-offset":
        return np.ones_like(q) * a["off"]
    if name == "joint-torque-gain":
        return a["gain"] * tau0
    if name == "rotor-inertia":
        return a["B"] * ddq
    if name == "joint-friction-asymmetry":
        return a["ac"] * np.abs(z) + a["av"] * np.abs(dq)
    if name == "joint-spring":
        return a["ks"] * (q - a["qs"])
    if name == "joint-stribeck-friction":
        return a["fs"] * np.exp(-(dq / a["vs"]) ** 2) * z
    if name == "joint-load-friction":
        return a["load"] * np.abs(tau0) * z
    if name == "joint-torque-ripple":
        return a["rip"] * np.sin(a["cyc"] * q + a["ph"])
    if name == "friction-warm-up":      # lubricant thins: viscous friction falls as the joint warms
        return a["fv"] * a["warm"] * np.exp(-t / a["tw"])[:, None] * dq
    if name == "cable-coupling":        # dress pack and wrist gearing: a joint is dragged by its neighbour's motion
        return a["couple"] * np.roll(dq, 1, axis=1)
    raise KeyError(name)


def columns(name: str, a: dict, j: int, t, q, dq, ddq, z, tau0) -> list[np.ndarray]:
    """Regressors of a name for joint j that a user's fit frees."""
    e = lambda: effect(name, a, t, q, dq, ddq, z, tau0)[:, j]
    if name == "rigid-body":
        return []
    if name == "joint-friction-asymmetry":
        return [np.abs(z[:, j]), np.abs(dq[:, j])]
    if name == "joint-spring":
        return [q[:, j], np.ones(len(t))]
    if name == "joint-torque-ripple":
        return [np.sin(a["cyc"][j] * q[:, j]), np.cos(a["cyc"][j] * q[:, j])]
    one = {"joint-viscous-friction": dq, "joint-coulomb-friction": z, "joint-torque-gain": tau0, "rotor-inertia": ddq}
    if name in one:
        return [one[name][:, j]]
    if name == "joint-torque-offset":
        return [np.ones(len(t))]
    if name == "joint-stribeck-friction":
        return [np.exp(-(dq[:, j] / a["vs"][j]) ** 2) * z[:, j]]
    if name == "joint-load-friction":
        return [np.abs(tau0[:, j]) * z[:, j]]
    return [e()]


ALIKE = {"payload": ("joint-torque-offset", "joint-torque-gain"), "joint-viscous-friction": ("joint-coulomb-friction",), "joint-coulomb-friction": ("joint-viscous-friction", "joint-stribeck-friction"),
         "joint-torque-offset": ("joint-friction-asymmetry", "joint-spring"), "joint-torque-gain": ("rotor-inertia",), "gravity-error": ("joint-torque-gain", "joint-torque-offset", "joint-spring"),
         "joint-friction-asymmetry": ("joint-torque-offset",), "joint-spring": ("joint-torque-ripple", "joint-torque-gain"), "time-offset": ("joint-viscous-friction", "rotor-inertia"), "rotor-inertia": ("joint-spring",),
         "joint-stribeck-friction": ("joint-viscous-friction",), "joint-load-friction": ("joint-coulomb-friction",), "joint-torque-ripple": ("joint-spring",)}


def run(rng: np.random.Generator, arm: Arm, group: str, base: str, hidden: list[str], mag: dict[str, float], long: bool, quiet: float) -> dict[str, Any]:
    """One joint-torque case."""
    nu = draw_nuisances(rng, group, True)
    if "time-offset" in hidden:
        nu["rate"] = max(nu["rate"], 250.0)
    nu["encoder_step"] = min(nu["encoder_step"], 1e-3 if quiet >= 1 else 1e-4)
    nu["base_tilt"] *= 0.3 * min(quiet, 1)
    if long:
        nu["rate"] = 100.0
    nu.pop("nonlinearity")
    T = float(130.0 if long else rng.uniform(18, 34))
    f0, H = (0.2, 5) if {"time-offset", "rotor-inertia"} & set(hidden) else (0.1, 5)
    brisk = 1.4 if f0 > 0.1 else 0.5 if "joint-stribeck-friction" in hidden else 1.0
    t = np.arange(int(T * 1000) + 1) * 1e-3
    mid = np.array([0, -0.5, 0, 1.1, 0, -0.95, 0]) + rng.uniform(-0.2, 0.2, 7)
    A = rng.normal(size=(7, H, 2)) / np.arange(1, H + 1)[None, :, None] ** 0.7
    w = 2 * np.pi * f0 * np.arange(1, H + 1)
    s = np.einsum("jh,ht->tj", A[:, :, 0], np.sin(np.outer(w, t))) + np.einsum("jh,ht->tj", A[:, :, 1], np.cos(np.outer(w, t)))
    s *= np.minimum(rng.uniform(0.5, 0.75, 7) / np.abs(s).max(0), brisk * rng.uniform(0.6, 1.3, 7) / np.abs(np.gradient(s, 1e-3, axis=0)).max(0))
    u = np.clip(np.minimum(t - 0.5, T - 0.7 - t) / 1.5, 0, 1)
    qd = mid + s * (u ** 3 * (10 - 15 * u + 6 * u * u))[:, None]
    m = mag
    a: dict[str, Any] = dict(fv=rng.uniform(0.5, 1.5, 7) * SIZE * 3, fc=rng.uniform(0.3, 1.0, 7) * SIZE * 1.5, vs=rng.uniform(0.04, 0.1, 7), cyc=np.round(rng.uniform(4, 12, 7)),
                             ph=rng.uniform(0, 6.28, 7), warm=1.0, tw=float(rng.uniform(6, 12)))
    Z = lambda: np.zeros(7)
    js = {h: sorted(rng.choice(4 if h in ("gravity-error", "joint-torque-gain", "joint-load-friction", "joint-spring") else 6, 2, replace=False).tolist()) for h in hidden}
    extra: dict[int, tuple[float, np.ndarray]] = {}
    pick = lambda h, lo, hi, sign=True: np.where(np.isin(np.arange(7), js[h]), rng.uniform(lo, hi, 7) * (rng.choice([-1, 1], 7) if sign else 1), 0) * m.get(h, 1)
    toff = 0.0
    for h in hidden:
        if h in ("joint-torque-gain", "joint-load-friction"):
            js[h] = [1, 3]
        if h == "joint-spring":
            js[h] = [int(rng.choice([1, 3]))]
        if h == "payload":
            extra[7] = (float(rng.uniform(0.5, 1.5) * m[h]), np.array([*rng.uniform(-0.03, 0.03, 2), rng.uniform(0.04, 0.12)])); js[h] = [1, 3, 5]
        elif h == "gravity-error":
            extra[int(rng.choice([3, 4]))] = (float(rng.uniform(0.5, 1.2) * m[h]), np.array([*rng.uniform(-0.06, 0.06, 2), rng.uniform(0.0, 0.15)])); js[h] = [1, 3]
        elif h == "joint-torque-offset":
            a["off"] = pick(h, 0.5, 1.5) * SIZE
        elif h == "joint-torque-gain":
            a["gain"] = pick(h, 0.04, 0.1)
        elif h == "rotor-inertia":
            a["B"] = np.array([0.9, 0.9, 0.51, 0.51, 0.2, 0.13, 0.13]) * rng.uniform(0.8, 2.2) * m[h]; js[h] = list(range(7))
        elif h == "joint-friction-asymmetry":
            a["ac"], a["av"] = pick(h, 0.1, 0.3, False) * SIZE, pick(h, 1.0, 2.5) * SIZE
        elif h == "joint-spring":
            a["ks"], a["qs"] = pick(h, 3, 9, False), mid + rng.uniform(-0.4, 0.4, 7)
        elif h == "time-offset":
            toff = float(rng.choice([-1, 1]) * rng.uniform(0.02, 0.045) * m[h]); js[h] = [1, 3]
        elif h == "joint-stribeck-friction":
            js[h] = list(range(7)); a["fs"] = rng.uniform(1.2, 2.2, 7) * SIZE * 1.5 * m[h]; a["vs"] = rng.uniform(0.06, 0.15, 7)
        elif h == "joint-load-friction":
            a["load"] = pick(h, 0.05, 0.1, False)
        elif h == "joint-torque-ripple":
            a["rip"] = pick(h, 0.5, 1.2, False) * SIZE * 1.5
        elif h == "friction-warm-up":
            js[h] = list(range(7)); a["warm"] = float(rng.uniform(1.5, 3) * m[h])
            a["fv"] = a["fv"] * 1.6
        elif h == "cable-coupling":
            js[h] = list(range(7)); a["couple"] = 3.0 * SIZE * rng.uniform(0.7, 1.4) * m[h]
        elif h in ("joint-viscous-friction", "joint-coulomb-friction"):
            js[h] = list(range(7)); k = "fv" if "viscous" in h else "fc"; a[k] = a[k] * m[h]
    model = ["rigid-body"] + [n for n in ("joint-viscous-friction", "joint-coulomb-friction") if n not in hidden]
    tool = Tool(float(rng.uniform(0.2, 0.5)), np.array([*rng.uniform(-2e-3, 2e-3, 2), rng.uniform(0.04, 0.06)])) if rng.random() < 0.5 else Tool()
    gt = np.array([np.sin(nu["base_tilt"]), 0, -np.cos(nu["base_tilt"])]) * 9.81
    nu["tool_mass_rel"] = float(rng.uniform(-0.02, 0.02))
    true_tool = Tool(tool.mass * (1 + nu["tool_mass_rel"]), tool.com, tool.inertia)
    plant, plain, rigp = arm.plant(true_tool, gt, extra), arm.plant(true_tool, gt), arm.plant(tool, np.array([0, 0, -9.81]))
    full = arm.plant(tool, np.array([0, 0, -9.81]), extra)
    jf = np.zeros((13, 7))
    jf[0], jf[1], jf[2], jf[4] = a["fv"], a["fc"], 2e-4, 0.1
    z7 = Z()
    jf[3], jf[5], jf[6], jf[7] = a.get("fs", z7), a.get("ac", z7), a.get("av", z7), a.get("load", z7)
    jf[4] = a["vs"]
    jf[8], jf[9], jf[10], jf[11], jf[12] = a.get("ks", z7), a.get("qs", z7), a.get("rip", z7), a["cyc"], a["ph"]
    kj = float(np.exp(rng.uniform(np.log(300), np.log(2000))))
    K = kj * np.array([1, 1, 1, 1, 0.6, 0.5, 0.5])
    D = 1.4 * np.sqrt(K * (np.array([1.5, 2, 0.4, 0.5, 0.05, 0.03, 0.01]) + 0.3))
    nu["controller"] = dict(kind="joint", stiffness=kj)
    sim = simulate(arm, plant, qd, False, K, D, arm.tip, np.zeros((4, 3)), law.pvec({}), jf)
    g = slice(None, None, 4)                       # truth at 500 Hz
    tg, q, dq, ddq, z = (sim[k][g] for k in ("t", "q", "dq", "ddq", "z"))
    friction = [n for n in ("joint-viscous-friction", "joint-coulomb-friction")]
    rb = plant.inverse(q, dq, ddq)
    tau = rb + sum(effect(n, a, tg, q, dq, ddq, z, rb) for n in friction)
    for h in hidden:
        if h not in ("payload", "gravity-error", "time-offset", "joint-torque-gain", *friction):
            tau = tau + effect(h, a, tg, q, dq, ddq, z, rb)
    clean = tau if "gain" not in a else tau * (1 + a["gain"])
    if toff:
        clean = at(tg - toff, tg, clean)
    W, near = clean, []
    nu["torque_lowpass_hz"] = float(rng.uniform(25, 50)) if rng.random() < 0.5 else 0.0
    if nu["torque_lowpass_hz"] and not toff:
        W = lowpass(tg, np.ascontiguousarray(W), 1 / (2 * np.pi * nu["torque_lowpass_hz"]))
    else:
        nu["torque_lowpass_hz"] = 0.0
    nu["torque_log"] = str(rng.choice(["same", "same", "hold", "interpolation"]))
    tl = Clock(rng, tg[-1], nu["rate"], nu["jitter"], nu["dropped"]).t
    noise = NOISE * rng.uniform(0.5, 1.0) * min(quiet, 1)
    nu["torque_noise"] = noise.tolist()
    tw = tl + nu["clock_off"]
    if nu["torque_log"] != "same":
        r = max(nu["rate"] * 0.5, 125.0)
        nu["torque_rate"] = r
        ts = np.arange(0, tg[-1], 1 / r)
        V = at(ts, tg, W) + rng.normal(size=(len(ts), 7)) * noise
        Y = at(tw, ts, V) if nu["torque_log"] == "interpolation" else V[np.clip((tw * r).astype(int), 0, len(ts) - 1)]
    else:
        Y = at(tw, tg, W) + rng.normal(size=(len(tl), 7)) * noise
    Y = np.round(Y / 1e-3) * 1e-3
    nu["dq_noise"] = min(nu["dq_noise"], 5e-4)
    ql, dql = encoders(rng, nu, tl, sim["t"], sim["q"], sim["dq"])
    # judge on at most 100 Hz
    st = max(1, int(nu["rate"] // 100))
    q_, v_, a_ = (x[::st] for x in smooth_motion(tl, ql, dql, 6.0))
    tj = tl[::st]
    qt, dt_, at_, zt = (at(tj, tg, x) for x in (q, dq, ddq, z))
    rb0, rbx = rigp.inverse(qt, dt_, at_), full.inverse(qt, dt_, at_)
    yc = at(tj, tg, clean) - plain.inverse(qt, dt_, at_) + rb0        # clean truth with the rig's own base and tool
    zl = bristle(np.ascontiguousarray(q_), 2e-4)
    rbl = full.inverse(q_, v_, a_)
    if toff:
        Yl = np.column_stack([np.interp(tj + toff, tl, c) for c in Y.T])
    else:
        Yl = Y[::st]
    move = np.abs(dt_).max(1) > 0.01
    rms = lambda x: float(np.sqrt(np.mean(np.square(x)))) if len(x) else 0.0

    def rest(y, names, j, t_, q0, dq0, ddq0, z0, r0):
        cols = [c for n in names if n not in ("payload", "gravity-error", "time-offset") for c in columns(n, a, j, t_, q0, dq0, ddq0, z0, r0)]
        if not cols:
            return y
        X = np.column_stack(cols)
        k = move if len(y) == len(move) else slice(None)
        return y - X @ np.linalg.lstsq(X[k], y[k], rcond=None)[0]

    true = model + [h for h in hidden if h not in OUT]
    out_l = sum((effect(h, a, tj, q_, v_, a_, zl, rbl) for h in hidden if h in OUT), np.zeros_like(Yl))
    L = np.column_stack([rest(Yl[:, j] - rbl[:, j] - out_l[:, j], true, j, tj, q_, v_, a_, zl, rbl) for j in range(7)])
    eff, left, share = {}, {}, {}
    for h in hidden:
        c = js[h]
        o = [n for n in true if n != h]
        ref = rb0 if h in ("payload", "gravity-error") else rbx
        y = yc
        if toff and h != "time-offset":
            y = at(tj + toff, tg, clean) - plain.inverse(qt, dt_, at_) + rb0
        E = np.column_stack([rest(y[:, j] - ref[:, j], o, j, tj, qt, dt_, at_, zt, ref) for j in c])
        eff[h], left[h] = rms(E[move]), rms(L[move][:, c])
        share[h] = eff[h] * np.sqrt(len(c) / 7) / rms(yc[move])
        for alt in ALIKE.get(h, ()):
            if alt in o:
                continue
            R = np.column_stack([rest(y[:, j] - ref[:, j], o + [alt], j, tj, qt, dt_, at_, zt, ref) for j in c])
            if rms(R[move]) < max(0.5 * left[h], 0.08 * eff[h]):
                near.append(alt)
        if h in ("gravity-error", "payload"):        # can the other one do it? masses and moments at link 7, linear
            pr = [(1.0, np.zeros(3)), (1.0, np.array([0.1, 0, 0])), (1.0, np.array([0, 0.1, 0])), (1.0, np.array([0, 0, 0.1]))]
            if h == "gravity-error":
                G = [arm.plant(tool, np.array([0, 0, -9.81]), {7: x}).inverse(qt, dt_, at_) - rb0 for x in pr]
                y2 = np.concatenate([rest(y[:, j] - ref[:, j], o, j, tj, qt, dt_, at_, zt, ref)[move] for j in range(7)])
                X = np.column_stack([np.concatenate([x[move][:, j] for j in range(7)]) for x in G])
                if rms(y2 - X @ np.linalg.lstsq(X, y2, rcond=None)[0]) < 0.3 * rms(y2):
                    near.append("payload")
    if nu["torque_lowpass_hz"] and nu["torque_lowpass_hz"] < 25:
        near.append("sensor-lag")
    cols = {"t": tl, **{f"q{i+1}": ql[:, i] for i in range(7)}}
    if dql is not None:
        cols.update({f"dq{i+1}": dql[:, i] for i in range(7)})
    cols.update({f"tau{i+1}": Y[:, i] for i in range(7)})
    v = lambda x: "[" + ", ".join(f"{float(i):.9g}" for i in x) + "]"
    rig = ["[robot]", 'model = "lwr4plus"', "gravity = [0.0, 0.0, -9.81]", ""] + (["[tool]", f"mass = {tool.mass:.9g}", f"com = {v(tool.com)}", ""] if tool.mass else [])
    params = {h: {k: (np.asarray(x).tolist()) for k, x in a.items()} if h not in ("payload", "gravity-error", "time-offset") else
              ({str(l): [mm_, r.tolist()] for l, (mm_, r) in extra.items()} if h != "time-offset" else {"offset": toff}) for h in hidden}
    return dict(model=model, eff=eff, left=left, share=share, near=sorted(set(near)), unit="N·m", left_forces=rms(L[move]), cols=cols, rig="\n".join(rig), nuisances=nu, params=params,
                noise=float(np.sqrt(np.mean(noise ** 2))), style="fourier", seconds=float(tl[-1]), about={h: [f"tau{j+1}" for j in js[h]] for h in hidden}, fitted={}, true={})
