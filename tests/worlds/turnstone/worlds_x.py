"""Testing machines (T), single drives (D) and arms' joint torques (J)."""
import math
import numpy as np
from numba import njit
import arms
import contact as ct
import scene
from io_ import write_case
from worlds_c import get_arm, SEED


def make_t(seed, folder, hidden, group, outside=None, silent=None, gain=1.0):
    rng = np.random.default_rng(seed)
    U = rng.uniform
    H = set(hidden)
    eff = list(hidden) + ([silent] if silent else [])
    base = str(rng.choice(["hooke", "hertz", "hooke", "kelvin-voigt", "hunt-crossley", "zener"]))
    if H & {"hertz-exponent", "stiffening-layer"}: base = str(rng.choice(["hooke", "kelvin-voigt"]))
    if H & {"viscous-damping", "hunt-crossley-damping", "relaxation", "hysteresis", "stress-softening", "adhesion"} or silent: base = str(rng.choice(["hooke", "hertz"]))
    if H & {"sensor-lag", "time-offset", "stiffness-drift"}: base = str(rng.choice(["hooke", "hertz"]))
    if "structural-compliance" in H: base = "hertz"
    dm = U(.001, .008); Fm = 10 ** U(.8, 2.3)
    n = {"hertz": 1.5, "hunt-crossley": U(1.2, 1.65)}.get(base, 1.0)
    if "hertz-exponent" in H: n = U(1.3, 2.1)
    K = Fm / dm ** n
    v0 = dm / .6
    kw, values, h, notes = {}, {}, {}, []
    if base == "kelvin-voigt": kw["c"] = U(.03, .15) * Fm / v0; values["kelvin-voigt.damping"] = kw["c"]
    if base == "hunt-crossley": kw["lam"] = U(.05, .3) / v0; values["hunt-crossley.exponent"] = n
    if base == "zener": kw.update(rho1=U(.2, .7), tau1=10 ** U(-.4, .6)); values.update({"zener.branch-ratio": kw["rho1"], "zener.time-constant": kw["tau1"]})
    if "hertz-exponent" not in H: values[base + ".stiffness"] = K
    s = gain
    servo = rng.random() < .5
    speeds, holds, deeper, air, T = True, bool(rng.random() < .4), False, bool(rng.random() < .6), U(15, 60)
    mono = False
    for e in eff:
        if e == "viscous-damping": kw["c"] = U(.15, .35) * s * Fm / v0; values[e + ".damping"] = kw["c"]
        elif e == "hunt-crossley-damping": kw["lam"] = U(.2, .45) * s / v0; values[e + ".damping"] = kw["lam"]
        elif e == "relaxation": kw.update(rho1=U(.2, .5) * s, tau1=10 ** U(-.7, 0), rho2=U(.2, .45) * s, tau2=10 ** U(.4, 1.0)); holds = True
        elif e == "hysteresis": kw.update(hys_r=U(.1, .25) * s, hys_l=(.02 if silent else U(.06, .2)) * dm); values[e + ".length"] = kw["hys_l"]
        elif e == "stress-softening": kw.update(mul_r=min(.8, U(.25, .5) * s), mul_l=U(.15, .35) * dm); deeper = True; values[e + ".ratio"] = kw["mul_r"]; values[e + ".length"] = kw["mul_l"]
        elif e == "adhesion": kw.update(adh_F=U(.12, .3) * Fm * s, adh_s=U(.3, .9), adh_l=U(.05, .2) * dm, adh_r=U(.15, .4) * dm, adh_p=U(.7, 1.6)); air = True; values[e + ".force"] = kw["adh_F"]
        elif e == "stiffening-layer":
            kw.update(lay_K=U(1., 3.) * s * Fm / dm, lay_d=(1.6 if silent else U(.4, .65)) * dm)
            if n <= 1: values[e + ".stiffness"] = kw["lay_K"]; values[e + ".depth"] = kw["lay_d"]
        elif e == "surface-offset": kw["z0"] = rng.choice([-1, 1]) * U(.1, .25) * dm * s; values[e + ".offset"] = kw["z0"]; air = True
        elif e == "stiffness-drift": T = U(50, 170); kw["drift"] = rng.choice([-.6, 1]) * U(.2, .35) * s * 60 / T; values[e + ".rate"] = kw["drift"]
        elif e == "structural-compliance": kw["C"] = U(.4, .9) * s * dm / Fm; values[e + ".compliance"] = kw["C"]
        elif e == "sensor-lag": h["lag"] = U(.03, .1) * s; values[e + ".time-constant"] = h["lag"]
        elif e == "time-offset": h["delay"] = U(.02, .06) * s * rng.choice([-1, 1]); values[e + ".delay"] = h["delay"]
        elif e == "sensor-bias": h["bias"] = np.array([rng.choice([-1, 1]) * U(.06, .15) * Fm * s]); values[e + ".offset"] = h["bias"][0]; air = True
        elif e == "sensor-drift": h["drift"] = np.array([rng.choice([-1, 1]) * U(.1, .3) * Fm * s]); values[e + ".drift"] = h["drift"][0]; T = U(40, 90); air = True
        elif e == "saturation": h["sat"] = (0, U(.5, .7) / min(s, 1.3)); 
        elif e == "mains-hum": h["hum"] = (float(rng.choice([50, 60])), [U(.03, .08) * Fm * s, .0], rng.uniform(-3, 3, 2)); h["humdir"] = np.ones(1)
    if silent in ("stress-softening", "hysteresis"): mono = True
    if outside:
        for k_, v in outside(rng, dm, Fm, gain).items():
            if k_ == "note": notes.append(v)
            elif k_ != "needs": kw[k_] = v
    kw["K"], kw["n"] = K, n
    P = ct.params(**kw)
    g, kk = ct.foundation(K, n, dm * 1.25, "rounded" if rng.random() < .5 else "exact")
    p = scene.Path(-(.1 * dm if air else 0.0) - 1e-6)
    if air: p.hold(U(.5, 2), "free")
    if mono:
        p.move(U(8, 25), "approach", d=dm, lin=True)
    while len(p.ph) * 1e-3 < T and not mono:
        v = 10 ** U(-.7, .8)
        top = dm * (min(1, .35 + .7 * len(p.ph) * 1e-3 / T) if deeper else U(.4, 1.0))
        q = rng.random()
        if q < .2 and not deeper:
            p.move(.8, "approach", d=.55 * dm); p.chirp(U(4, 8), .4 * dm, .3, U(3, 6), "poke")
        else:
            p.move(v, "poke", d=top, lin=rng.random() < .6)
            if holds and rng.random() < .6: p.hold(U(2, 7), "hold")
            p.move(v * U(.6, 1.5), "poke", d=-.15 * dm if air else .02 * dm, lin=rng.random() < .6)
            if rng.random() < .4: p.hold(U(.3, 2), "rest")
    X, _, _, ph = p.arrays()
    d = X[:, 2]
    if servo:       # hydraulic: second order behind the command
        d = scene.lowpass(d, U(8, 20)); notes.append("servo-hydraulic")
    else:           # stepper: microsteps with the motor's ring
        st = U(.3, 2) * 1e-6
        d = scene.lowpass(np.round(d / st) * st, 80); notes.append("stepper")
    t = np.arange(len(d)) * 1e-3
    F = ct.run_tester(P, g, kk, t, d, np.zeros_like(d), np.zeros((0, 5)), False)
    y = F[:, :1]
    noise = 10 ** U(-3.3, -2.2) * Fm
    if "sat" in h: h["sat"] = (0, float(h["sat"][1] * y.max())); values["saturation.limit"] = h["sat"][1]
    rate = float(rng.choice([50, 100, 250, 500, 1000, 2000] if "hum" not in h else [250, 500, 1000]))
    if rate == 2000 and len(t) > 70000: rate = 1000.
    y = scene.sense(y, rng, h, noise, dict(fc=U(40, 300) if "hum" not in h else 300, nl=U(0, .006)), t)
    ts = scene.stamps(rng, t[-1] - .15, rate, rng.choice([0, .02]), rng.choice([0, .003]))
    Y = scene.finish(scene.at(ts, y, shift=h.get("delay", 0.0) + rng.normal(0, .0004)), rng, h, noise)
    dn = 10 ** U(-7, -6)
    dep = scene.at(ts, d) + rng.normal(0, dn, len(ts))
    lg = {"t": ts, "depth": dep, "normal_force": Y[:, 0]}
    if rng.random() < .4:
        lg["depth_rate"] = scene.at(ts, scene.lowpass(np.gradient(d, 1e-3), U(15, 60))) + rng.normal(0, .01 * v0, len(ts))
    if rng.random() < .4: lg["phase"] = ph[np.minimum((ts / 1e-3).astype(int), len(ph) - 1)]
    write_case(folder, lg, {"sensor": {"noise": [0.0, 0.0, float(noise), 0.0, 0.0, 0.0]}} if rng.random() < .5 else {})
    model = [base]
    tm = model + list(hidden)
    notes.append(f"{base}, depth to {dm*1e3:.1f} mm, {Fm:.0f} N, {rate:.0f} Hz, {t[-1]:.0f} s")
    return dict(kind="T", model=model, hidden=list(hidden) or ([silent] if silent else []), true=tm, values={k: float(v) for k, v in values.items() if k.split(".")[0] in tm} if not outside else {},
                noise=float(noise), notes=notes, arm=None, rms=float(np.sqrt(np.mean(Y ** 2))))


def friction_draw(rng, n, big, model):
    """columns as arms.loop wants them; only what the model names, the rest as small nuisance"""
    Fr = scene.zero_friction(n)
    Fr[:, 7] = 10 ** rng.uniform(-3.7, -3.0, n)
    return Fr


JB = ["rigid-body", "joint-coulomb-friction", "joint-viscous-friction", "joint-torque-offset", "rotor-inertia"]


def make_j(seed, folder, hidden, group, outside=None, silent=None, gain=1.0):
    rng = np.random.default_rng(seed)
    U = rng.uniform
    name = str(rng.choice(["lwr-name", "lwr", "ur5", "ur10", "panda", "own"], p=[.2, .1, .2, .15, .15, .2]))
    arm = get_arm(name); n = arm.n
    H = set(hidden)
    s = gain
    T = U(20, 60)
    t = np.arange(0, T, scene.DT)
    q0 = SEED(name) * .8 + rng.normal(0, .15, n)
    full = "joint-torque-ripple" in H or "joint-spring" in H
    Qd = np.tile(q0, (len(t), 1))
    amp = np.linspace(.75, 1.1, n) * (1.2 if full else .9)
    for j in range(n):
        a = rng.uniform(.3, 1, 4); a /= a.sum()
        fr = np.r_[U(.03, .07), U(.08, .15), U(.15, .3), U(.3, .6 if "rotor-inertia" in H else .4)]
        for k_ in range(4):
            Qd[:, j] += amp[j] * a[k_] * np.sin(2 * np.pi * fr[k_] * t + U(-3, 3)) * (1 if k_ < 3 else .6)
    Qd = np.clip(Qd, -6, 6)
    env = np.minimum(1, t / 2.5)[:, None]; env = env ** 2 * (3 - 2 * env)
    Qd = q0 + (Qd - q0) * env
    if rng.random() < .5:       # pauses: every so often all joints rest
        w = np.ones(len(t))
        for c in np.arange(U(4, 7), T - 2, U(6, 10)):
            w[(t > c) & (t < c + U(.4, 1.2))] = 0.0
        w = scene.lowpass(w, 1.2, zero=True)
        tau_ = np.cumsum(np.clip(w, 0, 1)) * scene.DT
        Qd = scene.at(tau_, Qd)
    model = list(JB)
    big = np.linspace(1, .35, n)
    Fr = friction_draw(rng, n, big, model)
    Fr[:, 0] = rng.uniform(1.5, 4, n) * big; Fr[:, 3] = rng.uniform(1.5, 5, n) * big; Fr[:, 15] = rng.normal(0, .3, n) * big
    Jr = rng.uniform(.2, 1.2, n) * big
    values, notes = {}, []
    grig = np.array([0, 0, -9.81]); gt = grig.copy()
    if rng.random() < .25: grig = scene.rotvec(np.r_[rng.normal(0, .08, 2), 0]) @ grig; gt = grig.copy()
    if rng.random() < .15: grig = np.array([0, 9.81, 0.]); gt = grig.copy()
    gt = scene.rotvec(rng.normal(0, .0006, 3)) @ gt
    logg = np.zeros(n)
    for e in hidden:
        if e in model: model.remove(e)
        if e == "joint-coulomb-friction": Fr[:, 0] *= 2 * s
        elif e == "joint-viscous-friction": Fr[:, 3] = rng.uniform(5, 14, n) * big * s
        elif e == "joint-friction-asymmetry": Fr[:, 4] = rng.uniform(2, 6, n) * big * s * rng.choice([-1, 1], n); Fr[:, 5] = rng.uniform(.5, 2.0, n) * big * s * rng.choice([-1, 1], n)
        elif e == "joint-torque-offset": Fr[:, 15] = rng.choice([-1, 1], n) * rng.uniform(1.5, 5, n) * big * s
        elif e == "rotor-inertia": Jr = rng.uniform(1.5, 4, n) * big * s
        elif e == "joint-torque-gain": logg = rng.choice([-1, 1], n) * rng.uniform(.08, .18, n) * s
        elif e == "payload":
            m_ = U(1.2, 3.0) * s; c_ = arm.sp + arm.sR @ (arm.tip_s * U(.3, 1.0) + rng.normal(0, .02, 3)); notes.append(f"payload {m_:.2f} kg")
            arm.add_tool(m_, arm.sR.T @ (c_ - arm.sp), np.eye(3) * .002); values["payload.mass"] = m_
        elif e == "gravity-error": d = scene.rotvec(np.r_[rng.normal(0, 1, 2), 0] * U(.04, .09) * s); gt = d @ gt; notes.append(f"gravity really {np.round(gt, 3).tolist()}")
        elif e == "joint-stribeck-friction": Fr[:, 1] = rng.uniform(2, 5, n) * big * s; Fr[:, 2] = rng.uniform(.04, .2)
        elif e == "joint-load-friction": Fr[:, 6] = rng.uniform(.08, .2, n) * s; Fr[:, 0] *= .6
        elif e == "joint-torque-ripple":
            Fr[:, 8] = rng.normal(0, 1, n); Fr[:, 9] = rng.normal(0, 1, n)
            Fr[:, 8:10] *= (rng.uniform(1.2, 3, n) * big * s / np.hypot(Fr[:, 8], Fr[:, 9]))[:, None]; Fr[:, 13] = .2 * Fr[:, 8]
            Fr[:, 10] = rng.choice([4., 6., 8., 10., 12.], n); notes.append(f"ripple orders {Fr[:, 10].tolist()}")
        elif e == "joint-spring":
            jj = rng.permutation(n)[:int(rng.integers(1, 3))]; jj[0] = rng.integers(0, 4)
            Fr[jj, 11] = rng.uniform(8, 22, len(jj)) * big[jj] * s; Fr[jj, 12] = rng.normal(0, 3, len(jj)); notes.append(f"springs at joints {(jj+1).tolist()}")
    text = np.zeros_like(Qd)
    if outside:
        text = outside(rng, Qd, t, big, gain, notes)
    arm.m = arm.m * (1 + rng.normal(0, .002, n))
    ctl = scene.controller(arm, rng, 10 ** U(3.5, 4.1))
    ctl["Jr"] = Jr; ctl["Dq"] = 1.4 * np.sqrt(ctl["Kq"] * (Jr + .3 * big))
    r = scene.run_arm(arm, Qd, np.zeros_like(Qd), np.zeros(len(t)), np.zeros(len(t)), ctl, gt, Fr, text=text)
    if not np.isfinite(r["q"]).all(): raise RuntimeError("unstable")
    tau = r["tau"] * (1 + logg)
    lp = U(8, 50)
    zero = lp < 22 or rng.random() < .3
    tau = scene.lowpass(tau, lp, zero=bool(zero), order=2)
    rate = float(rng.choice([100, 125, 200, 250, 500, 1000]))
    ts = scene.stamps(rng, T - .1, rate, rng.choice([0, .05]), rng.choice([0, .004]))
    if rng.random() < .4:       # torques logged slower, held in between by interpolation
        r2 = rate / int(rng.integers(2, 5)); tg = np.arange(0, T, 1 / max(r2, 40)); tau = scene.at(tg, tau); tm_ = np.stack([np.interp(ts, tg, tau[:, j]) for j in range(n)], 1)
    else: tm_ = scene.at(ts, tau, shift=rng.normal(0, .0007))
    ns = 10 ** U(-2.2, -1.2)
    tm_ = tm_ + rng.normal(0, 1, tm_.shape) * ns * big * 2
    enc = 10 ** U(math.log10(2e-6), math.log10(3e-4))
    q = np.round(scene.at(ts, r["q"]) / enc) * enc
    lg = {"t": ts}
    for j in range(n): lg[f"q{j+1}"] = q[:, j]
    if rng.random() < .7:
        dqm = scene.at(ts, scene.lowpass(r["dq"], U(10, 60))) + rng.normal(0, 10 ** U(-5, math.log10(5e-4)), q.shape) + rng.uniform(-2e-4, 2e-4, n)
        for j in range(n): lg[f"dq{j+1}"] = dqm[:, j]
    for j in range(n): lg[f"tau{j+1}"] = tm_[:, j]
    rig = {"robot": {"model": arm.rigmodel, "gravity": grig.tolist(), "joints": arm.joints}}
    write_case(folder, lg, rig, arm)
    notes.append(f"{name}, {rate:.0f} Hz, {T:.0f} s, torque filter {lp:.0f} Hz {'zero-phase' if zero else 'causal'}, encoder {enc*1e6:.0f} µrad")
    return dict(kind="J", model=model, hidden=list(hidden), true=model + list(hidden), values=values, noise=float(ns * 2 * np.sqrt(np.mean(big ** 2))), notes=notes, arm=name,
                rms=float(np.sqrt(np.mean(tm_ ** 2))))


@njit(cache=True)
def drive(qd, dqd, ddqd, dt, J, K, D, Kg, Dg, Jl, F, text, fpos):
    """motor and load with a flexible harmonic gear; F as in arms.loop"""
    N = len(qd)
    q = np.zeros(N); v = np.zeros(N); tau = np.zeros(N)
    x = qd[0]; w = 0.0; xl = x; wl = 0.0; u = 0.0
    for i in range(N):
        dx = w * dt
        if dx != 0:
            s = 1.0 if dx > 0 else -1.0
            u = s + (u - s) * math.exp(-abs(dx) / F[7])
        fr = (F[0] * (1 + fpos * math.sin(2.3 * x + .4)) + F[1] * math.exp(-(w / F[2]) ** 2)) * u + F[3] * w + F[4] * abs(w) + F[5] * abs(u)
        ph = F[10] * x
        sp = F[8] * math.sin(ph) + F[9] * math.cos(ph) + F[13] * math.sin(2 * ph) + F[14] * math.cos(2 * ph) + F[11] * x + F[12] + F[15] + text[i]
        tq = K * (qd[i] - x) + D * (dqd[i] - w) + (J + Jl) * ddqd[i] + .8 * fr
        gear = Kg * (x - xl) + Dg * (w - wl)
        q[i] = x; v[i] = w; tau[i] = tq
        w += dt * (tq - fr - sp - gear) / J
        wl += dt * gear / Jl
        x += dt * w
        xl += dt * wl
    return q, v, tau


DB = ["rigid-body", "joint-coulomb-friction", "joint-viscous-friction", "joint-torque-offset"]


def make_d(seed, folder, hidden, group, outside=None, silent=None, gain=1.0):
    rng = np.random.default_rng(seed)
    U = rng.uniform
    H = set(hidden)
    T = U(12, 90); dt = 5e-4
    t = np.arange(0, T, dt)
    m = 10 ** U(-1, 1)                              # scale of the torques
    Jm, Jl = m * U(.02, .05), m * U(.03, .12)
    A = U(1.0, 6.0)
    if "joint-torque-ripple" in H: A = U(3, 8)
    one_way = silent == "joint-friction-asymmetry"
    if silent == "joint-spring": A = .2
    kind = int(rng.integers(0, 3))
    if one_way:
        sp = 1.2 + .7 * np.sin(2 * np.pi * .21 * t) + .3 * np.sin(2 * np.pi * .5 * t + 1)
        qd = np.cumsum(sp) * dt; notes0 = "turns one way"
    elif kind == 0:
        qd = A * sum(a * np.sin(2 * np.pi * f * t + p) for a, f, p in zip((.55, .3, .12), (U(.04, .1), U(.12, .25), U(.4, .8)), rng.uniform(-3, 3, 3))); notes0 = "sines"
    elif kind == 1:     # trapezoids at several speeds
        v = np.zeros(len(t)); x = 0.; i = 0; sg = 1
        while i < len(t):
            sp = A * 10 ** U(-1.2, -.05); d = int(min(1.4 * A / sp, 5) / dt); v[i:i + d] = sg * sp; i += d
            r = int(U(.1, .5) / dt); i += r; sg = -sg
        v = scene.lowpass(v, 1.5, fs=1 / dt, zero=True); qd = np.cumsum(v) * dt; qd = qd - qd.mean() * 0; notes0 = "trapezoids"
    else:
        f = .05 + .5 * t / T; qd = A * np.sin(2 * np.pi * np.cumsum(f) * dt) * (1 - .6 * t / T); notes0 = "chirp"
    vr = np.gradient(qd, dt); ar = np.gradient(vr, dt)
    vm = np.percentile(np.abs(vr), 90)
    F = np.zeros(16); F[2] = .1; F[7] = 10 ** U(-4, -3.2) * max(1, A / 3); F[10] = 1
    F[0] = U(.4, 1.0) * m; F[3] = U(.2, .6) * m / vm; F[15] = rng.normal(0, .08) * m
    model = list(DB); values, notes = {}, [notes0]
    s = gain
    for e in list(hidden) + ([silent] if silent else []):
        if e in model: model.remove(e)
        if e == "joint-coulomb-friction": pass
        elif e == "joint-viscous-friction": F[3] = U(.8, 1.6) * m / vm * s
        elif e == "joint-torque-offset": F[15] = rng.choice([-1, 1]) * U(.2, .6) * m * s
        elif e == "joint-friction-asymmetry": F[4] = U(.15, .4) * m / vm * s * rng.choice([-1, 1]); F[5] = U(.05, .3) * m * s; values.update({e + ".asymmetry": F[4], e + ".dry": F[5]}) if not silent else 0; model.remove("joint-torque-offset")
        elif e == "joint-stribeck-friction": F[1] = U(.3, .8) * m * s; F[2] = U(.08, .25) * vm; values.update({e + ".excess": F[1], e + ".speed": F[2]})
        elif e == "joint-torque-ripple":
            a = rng.normal(0, 1, 2); a *= U(.15, .4) * m * s / np.linalg.norm(a); F[8:10] = a; F[13] = .25 * a[0]; F[10] = float(rng.choice([2, 3, 4, 6, 8])); values[e + ".order"] = F[10]
        elif e == "joint-spring":
            F[11] = U(.3, .8) * m / A * s if not silent else U(.02, .05) * m; F[12] = rng.normal(0, .1) * m
            if not silent: values[e + ".rate"] = F[11]; model.remove("joint-torque-offset")
    values["joint-coulomb-friction.coulomb"] = F[0]; values["joint-viscous-friction.viscous"] = F[3]
    text = np.zeros(len(t)); fpos = 0.0
    if outside:
        text, fpos = outside(rng, qd, t, m, gain, notes)
    Kp = (Jm + Jl) * (2 * np.pi * U(4, 10)) ** 2
    w0 = 2 * np.pi * U(45, 90)
    Jred = Jm * Jl / (Jm + Jl)
    q, v, tau = drive(qd, vr, ar, dt, Jm, Kp, 1.4 * math.sqrt(Kp * (Jm + Jl)), Jred * w0 ** 2, .1 * Jred * w0, Jl, F, text, fpos)
    lp = U(10, 50); zero = bool(lp < 25 or rng.random() < .4)
    tau = scene.lowpass(tau, lp, fs=1 / dt, zero=zero)
    rate = float(rng.choice([100, 250, 500, 1000, 2000])) if T < 60 else float(rng.choice([50, 100, 250, 500]))
    ts = scene.stamps(rng, T - .1, rate, rng.choice([0, .05]), rng.choice([0, .004]))
    ns = 10 ** U(-2.5, -1.7) * m
    tm_ = scene.at(ts, tau, dt=dt, shift=rng.normal(0, .0006)) + rng.normal(0, ns, len(ts))
    enc = 10 ** U(math.log10(5e-6), -3)
    lg = {"t": ts, "q1": np.round(scene.at(ts, q, dt=dt) / enc) * enc}
    if rng.random() < .6: lg["dq1"] = scene.at(ts, scene.lowpass(v, U(10, 60), fs=1 / dt), dt=dt) + rng.normal(0, 10 ** U(-5, math.log10(5e-4)), len(ts)) + U(-2e-4, 2e-4)
    lg["tau1"] = tm_
    write_case(folder, lg, {})
    tm = model + list(hidden)
    notes.append(f"J {Jm+Jl:.3g}, {rate:.0f} Hz, {T:.0f} s, torque filter {lp:.0f} Hz {'zero-phase' if zero else 'causal'}, encoder {enc*1e6:.0f} µrad")
    return dict(kind="D", model=model, hidden=list(hidden) or ([silent] if silent else []), true=tm, values={k: float(x) for k, x in values.items() if k.split(".")[0] in tm} if not (outside or silent) else {},
                noise=float(ns), notes=notes, arm=None, rms=float(np.sqrt(np.mean(tm_ ** 2))))
