"""Joint-torque logs of free motion and single-axis drive logs: one case from a wish (SI units)."""
from __future__ import annotations
import numpy as np
import pinocchio as pin
import logio
import motion
from sim import Tool, build_arm, build_axis, run_joint

JOINT = ["joint-coulomb-friction", "joint-viscous-friction", "joint-friction-asymmetry", "joint-torque-offset", "rotor-inertia", "joint-torque-gain", "payload",
         "joint-elasticity", "gravity-error", "joint-stribeck-friction", "joint-load-friction", "joint-torque-ripple", "joint-spring"]
DRIVE = ["joint-coulomb-friction", "joint-viscous-friction", "joint-torque-offset", "joint-stribeck-friction", "joint-torque-ripple", "joint-spring"]
PAIRS = [("joint-coulomb-friction", "payload"), ("joint-viscous-friction", "joint-torque-offset"), ("joint-torque-ripple", "rotor-inertia"), ("joint-spring", "joint-stribeck-friction"),
         ("gravity-error", "joint-viscous-friction"), ("joint-load-friction", "joint-torque-offset")]
DRIVE_PAIRS = [("joint-torque-ripple", "joint-viscous-friction"), ("joint-spring", "joint-stribeck-friction"), ("joint-coulomb-friction", "joint-torque-offset")]
OUTSIDE = ["push", "torque-crosstalk", "slosh", "quadratic-drag"]
DRIVE_OUTSIDE = ["pulsing-load", "quadratic-drag"]
UNEXCITED = ["rotor-inertia", "joint-torque-ripple"]
NOISE = np.array([0.07, 0.07, 0.04, 0.04, 0.04, 0.015, 0.015])


def robot(urdf: str, tool: Tool | None) -> pin.Model:
    """The user's model of the arm with the rig's tool, for pinocchio."""
    m = pin.buildModelFromUrdf(urdf)
    if tool is not None:
        M = m.frames[m.getFrameId("ft_sensor")].placement
        m.appendBodyToJoint(7, pin.Inertia(tool.mass, tool.com, np.diag(tool.inertia)), M)
    return m


def rnea(m: pin.Model, q, dq, ddq) -> np.ndarray:
    """Inverse dynamics of a log, row by row [N m]."""
    d = m.createData()
    return np.array([pin.rnea(m, d, a, b, c) for a, b, c in zip(q, dq, ddq)])


def gravity(m: pin.Model, q) -> np.ndarray:
    """Gravity torques of a log [N m]."""
    d = m.createData()
    return np.array([pin.computeGeneralizedGravity(m, d, a) for a in q])


def columns(name: str, m: pin.Model | None, q, dq, ddq, tau, v0: float, vs: tuple) -> list[np.ndarray]:
    """Linear columns (n, nj) that a name of the catalogue offers, Stribeck at the speeds vs [rad/s] [N m per unit]."""
    nj = q.shape[1]
    sg = np.tanh(dq / v0)
    each = lambda y: [np.where(np.arange(nj) == j, y, 0.0) for j in range(nj)]
    grav = gravity(m, q) if m is not None and name in ("gravity-error",) else tau
    if name == "payload" and m is not None:
        d, out = m.createData(), np.zeros((10, len(q), nj))
        for k in range(len(q)):
            out[:, k] = pin.computeJointTorqueRegressor(m, d, q[k], dq[k], ddq[k])[:, -10:].T
        return list(out[:4])
    if name == "gravity-error" and m is not None:
        d, out = m.createData(), np.zeros((7 * 3, len(q), nj))
        for k in range(len(q)):
            Y = pin.computeJointTorqueRegressor(m, d, q[k], 0 * dq[k], 0 * ddq[k])
            for i in range(7):
                out[3 * i:3 * i + 3, k] = Y[:, 10 * i + 1:10 * i + 4].T
        return list(out) + each(grav)
    table = {"joint-coulomb-friction": lambda: each(sg), "joint-viscous-friction": lambda: each(dq), "joint-torque-offset": lambda: each(np.ones_like(q)),
             "rotor-inertia": lambda: each(ddq), "joint-torque-gain": lambda: each(tau), "joint-spring": lambda: each(q),
             "joint-load-friction": lambda: each(np.abs(tau) * sg), "joint-friction-asymmetry": lambda: each(np.abs(sg)) + each(np.abs(dq)),
             "joint-stribeck-friction": lambda: [c for v in vs for c in each(sg * np.exp(-(dq / v) ** 2))]}
    return table.get(name, list)()


def shrink(e: np.ndarray, cols: list[np.ndarray], mask: np.ndarray) -> np.ndarray:
    """What of e (n, nj) the columns can't take up, over the masked rows."""
    e = e[mask].ravel()
    if not cols:
        return e.reshape(mask.sum(), -1)
    A = np.column_stack([c[mask].ravel() for c in cols])
    A = A / (np.linalg.norm(A, axis=0) + 1e-12)
    return (e - A @ np.linalg.lstsq(A, e, rcond=1e-10)[0]).reshape(mask.sum(), -1)


def make(rng: np.random.Generator, urdf: str, group: str, hidden: list[str], outside: str | None, g: np.ndarray, drive: bool) -> dict:
    """One case of joint torques (drive: of a single axis) with strengths g of the hidden effects."""
    nj, dt = (1, 1 / 4000) if drive else (7, 1 / 4000)
    W = [*hidden, *([outside] if outside else [])]
    G = dict(zip(W, g))
    on = lambda n: float(G.get(n, 0.0))
    nu: dict = {}
    model = ["rigid-body"]
    base_f = ["joint-coulomb-friction", "joint-viscous-friction"]
    extra = [e for e in ("joint-torque-offset", "joint-stribeck-friction", "payload") if rng.random() < (0.18 if not (drive and e == "payload") and group != "outside" else 0.0)]
    if "joint-friction-asymmetry" in W and "joint-torque-offset" in extra:
        extra.remove("joint-torque-offset")
    if {"gravity-error", "joint-torque-gain", "rotor-inertia"} & set(W) and "payload" in extra:
        extra.remove("payload")
    model += [e for e in base_f + extra if e not in hidden]
    has = lambda n: n in model or n in hidden
    sc = np.ones(1) if drive else np.array([1, 1, 0.8, 0.8, 0.6, 0.35, 0.3])
    tool = Tool(mass=float(rng.uniform(0.3, 1.5)), com=np.array([0, 0, rng.uniform(0.04, 0.08)]), inertia=np.array([1e-3, 1e-3, 4e-4])) if not drive and rng.random() < 0.6 else None
    # --- motion
    T = float(rng.uniform(18, 40))
    slow = bool(set(W) & {"joint-stribeck-friction", "joint-friction-asymmetry", "joint-torque-offset", "gravity-error", "joint-spring", "joint-load-friction", "joint-coulomb-friction"} or
                "joint-stribeck-friction" in model)
    fast = bool(set(W) & {"rotor-inertia", "joint-elasticity", "slosh"})
    if drive:
        c, amp, vm, am = np.array([rng.uniform(-0.5, 0.5)]), np.array([rng.uniform(1.5, 3)]), np.array([rng.uniform(1.5, 4)]), np.array([7.0])
    else:
        c = np.array([0, -0.4, 0, 1.2, 0, -0.9, 0]) + rng.uniform(-0.2, 0.2, 7)
        amp, vm, am = np.array([0.9, 0.6, 0.9, 0.6, 1.2, 0.8, 1.6]), np.array([1.2, 1.1, 1.4, 1.3, 2.0, 1.8, 2.2]), np.array([3, 2.5, 3.5, 4, 6, 6, 8.0])
    still = []
    if group == "unexcited":
        vm, am = (vm * 0.08, am * 0.01) if "rotor-inertia" in W else (vm, am)
        if "joint-torque-ripple" in W:
            still = [2]
            amp = np.where(np.arange(nj) == 2, 1e-3, amp)
    t, qd, dqd, ddqd = motion.joint_motion(rng, T, dt, c, amp, vm, am, slow and not fast and not drive and "joint-torque-ripple" not in W, rng.uniform(0.6, 1.1) if group != "unexcited" else 0.05)
    if drive and (slow or rng.random() < 0.4):
        h = len(t) // 2
        t2, q2, _, _ = motion.joint_motion(rng, T, dt, c, amp, vm, am, True, 1.0)
        b = np.clip((t - t[h]) / 1.5, 0, 1)
        b = b ** 3 * (10 - 15 * b + 6 * b * b)
        qd = (1 - b[:, None]) * qd + b[:, None] * q2
        dqd = np.gradient(qd, dt, axis=0)
        ddqd = np.gradient(dqd, dt, axis=0)
    Kj = np.array([6000, 6000, 6000, 6000, 6000, 3500, 3500.0]) / max(on("joint-elasticity"), 0.2)
    # --- friction rows [Fc, Fv, dF, vs, asym, load, len, v0, quad]
    v0 = float(rng.uniform(2e-3, 5e-3))
    dahl = rng.random() < 0.35
    fr = np.zeros((9, nj))
    u = lambda a, b: rng.uniform(a, b, nj) * sc
    fr[0] = u(0.4, 0.9) * (on("joint-coulomb-friction") or 1.0)
    fr[1] = u(0.3, 0.9) * (on("joint-viscous-friction") or 1.0)
    fr[2] = u(0.4, 0.8) * (on("joint-stribeck-friction") or 1.0) if has("joint-stribeck-friction") else 0
    fr[3] = rng.uniform(0.03, 0.09)
    fr[4] = 0.35 * on("joint-friction-asymmetry") * rng.choice([-1, 1], nj)
    fr[5] = 0.06 * on("joint-load-friction")
    fr[6], fr[7] = (rng.uniform(1.5e-4, 5e-4) if dahl else 0.0), v0
    fr[8] = 2.5 * on("quadratic-drag") * sc
    fr[:3, still] *= 0.1
    nu |= {"friction": "dahl" if dahl else "tanh", "friction_length_rad": float(fr[6, 0]), "friction_v0": v0}
    arm = np.array([rng.uniform(0.05, 0.3)]) if drive else np.array([0.9, 0.9, 0.51, 0.51, 0.2, 0.13, 0.13]) * rng.uniform(0.8, 1.2)
    if on("rotor-inertia"):
        arm = arm * (0.7 * on("rotor-inertia"))
    tilt, az = np.radians(rng.uniform(0, 0.2)) * rng.choice([0, 1]), rng.uniform(0, 6.28)
    grav = 9.81 * np.array([np.sin(tilt) * np.cos(az), np.sin(tilt) * np.sin(az), -np.cos(tilt)])
    nu["base_tilt_rad"] = float(tilt)
    ext = np.zeros((len(t), nj))
    if outside == "push":
        for t0 in rng.uniform(0.1, 0.85, 4) * T:
            pulse = 14 * g[-1] * np.sin(np.pi * np.clip((t - t0) / rng.uniform(0.6, 1.6), 0, 1)) ** 2
            ext += pulse[:, None] * np.array([0.6, 1, 0.5, 0.6, 0.25, 0.15, 0.02]) * rng.choice([-1, 1], 7)
    if outside == "pulsing-load":
        ext[:, 0] = 2.5 * g[-1] * (0.5 + 0.5 * np.sin(2 * np.pi * rng.uniform(0.5, 0.9) * t + 2 * np.sin(0.3 * t))) ** 3 * (t > 2)
    J0 = float(rng.uniform(0.2, 0.8))
    loadm, loadc = 1.2 * (on("payload") or 1.0), np.array([rng.uniform(-0.03, 0.03), rng.uniform(-0.03, 0.03), 0.09])

    def tool_true() -> Tool:
        mo, co = 1 + rng.uniform(-0.02, 0.02) * (0.4 if group == "none" else 1), 1 + rng.uniform(-0.02, 0.02)
        nu.update(tool_mass_factor=mo, tool_com_factor=co)
        ms, cs, I = [1e-6], [np.zeros(3)], np.full(3, 1e-7)
        if tool is not None:
            ms, cs, I = ms + [tool.mass * mo], cs + [tool.com * co], I + tool.inertia
        if has("payload"):
            ms, cs, I = ms + [loadm], cs + [loadc], I + 1e-3 * loadm
        mt = sum(ms)
        cm = sum(a * b for a, b in zip(ms, cs)) / mt
        I = I + sum(a * ((b - cm) @ (b - cm) - (b - cm) ** 2) for a, b in zip(ms, cs))
        return Tool(mt, cm, I)

    if drive:
        mj = build_axis(J0, dt)
        mj.dof_armature[:] = arm
    else:
        lump = (4, 0.9 * on("gravity-error"), [0.07, 0.05, 0.08]) if on("gravity-error") else None
        mj = build_arm(urdf, tool_true(), grav, dt, arm, (0.8 * on("slosh"), 0.25, 0.01) if on("slosh") else None, lump, Kj if on("joint-elasticity") else None)
    el = bool(on("joint-elasticity"))
    o = run_joint(mj, nj, qd, dqd, ddqd, 14.0 if el else 45.0, fr, ext, 2, 2 if el else 1)
    t, q, dq, ddq, app, f_sim, spr, dspr = o[:, 0], *(o[:, 1 + i * nj:1 + (i + 1) * nj] for i in range(7))
    tau = app + 0.0 if (on("rotor-inertia") or drive) else app - arm * ddq
    if el:  # what the spring carries is what the sensor sees
        tau = -Kj * (spr + 0.003 * dspr)
    idyn = tau - f_sim
    n_on = rng.permutation(nj)[:max(1, nj - 3)] if not drive else np.array([0])
    if nj == 7 and set(W) & {"joint-torque-ripple", "joint-spring"}:
        n_on = rng.choice([0, 1, 2, 3], 2, replace=False)
    sel = np.isin(np.arange(nj), n_on)
    add: dict[str, np.ndarray] = {}
    offs = np.where(sel, u(0.5, 1.2) * rng.choice([-1, 1], nj), 0) * (on("joint-torque-offset") or 1.0)
    if has("joint-torque-offset"):
        add["joint-torque-offset"] = np.tile(offs, (len(t), 1))
    if on("joint-spring"):
        add["joint-spring"] = np.where(sel, 2.0 * on("joint-spring"), 0) * sc * q
    if "joint-torque-ripple" in W:
        k = float(rng.integers(6, 40))
        sel = np.arange(nj) == still[0] if still else sel
        x = k * (q - c) + rng.uniform(0, 6, nj) * (group != "unexcited")
        add["joint-torque-ripple"] = np.where(sel, 0.45 * on("joint-torque-ripple") * sc, 0) * (np.sin(x) + 0.25 * np.sin(2 * x + (group != "unexcited")))
        nu["ripple_per_rad"] = k
    gains = np.where(sel, 0.07 * rng.uniform(0.7, 1.2, nj) * rng.choice([-1, 1], nj), 0) * on("joint-torque-gain")
    total = tau + sum(add.values(), np.zeros_like(tau))
    if on("joint-torque-gain"):
        add["joint-torque-gain"] = gains * total
        total = total + add["joint-torque-gain"]
    if on("torque-crosstalk"):
        X = np.zeros((7, 7))
        X[2, 1] = X[0, 1] = X[4, 3] = X[3, 1] = 0.06 * on("torque-crosstalk")
        add["torque-crosstalk"] = total @ X.T
        total = total + add["torque-crosstalk"]
    # --- the effect along the executed motion, and the user's rigid body
    D = slice(0, None, max(1, len(t) // 2500))
    rb = None if drive else robot(urdf, tool)
    qs, ds, dds, ts = q[D], dq[D], ddq[D], total[D]
    moving = np.abs(ds).max(1) > 2e-3
    q_m, dq_m = q, dq
    if on("joint-elasticity"):  # the log holds the motor's angle
        q_m, dq_m = q - spr, dq - dspr
        ddq_m = np.gradient(dq_m, t, axis=0)
        add["joint-elasticity"] = np.zeros_like(tau)
        add["joint-elasticity"][D] = rnea(rb, q[D], dq[D], ddq[D]) - rnea(rb, q_m[D], dq_m[D], ddq_m[D])
    s_n = np.tanh(dq / v0)
    asy = 1 + fr[4] * s_n
    strib = fr[2] * np.exp(-(dq / fr[3]) ** 2)
    add |= {"joint-coulomb-friction": fr[0] * s_n * asy, "joint-viscous-friction": fr[1] * dq * asy, "joint-stribeck-friction": strib * s_n * asy,
            "joint-load-friction": fr[5] * np.abs(app) * s_n, "joint-friction-asymmetry": fr[4] * np.abs(s_n) * (fr[0] + fr[1] * np.abs(dq)),
            "rotor-inertia": arm * ddq, "quadratic-drag": fr[8] * dq * np.abs(dq), "push": -ext, "pulsing-load": -ext}
    if not drive and set(W) & {"payload", "gravity-error", "slosh"}:
        e = np.zeros_like(tau)
        e[D] = idyn[D] - rnea(rb, qs, ds, dds)
        for n in ("payload", "gravity-error", "slosh"):
            add.setdefault(n, e)
    true = model + hidden
    VS = (float(fr[3, 0]),)
    lin = lambda names: [c for n in names for c in columns(n, rb, qs, ds, dds, ts, v0, VS)] + ([dds] if drive else [])
    effects, keep, near, notes = {}, {}, [], []
    NEAR = ["joint-torque-offset", "rotor-inertia", "joint-torque-gain", "payload", "gravity-error", "joint-spring", "joint-load-friction", "joint-friction-asymmetry",
            "joint-stribeck-friction", "joint-viscous-friction", "joint-coulomb-friction"]
    NEAR = [n for n in NEAR if not drive or n not in ("rotor-inertia", "joint-torque-gain", "payload", "gravity-error")]
    for h in W:
        e = add[h][D]
        r = shrink(e, lin([n for n in true if n != h]), moving)
        lev = np.sqrt(np.mean(r ** 2, axis=0))
        keep[h] = lev > 0.25 * lev.max()
        effects[h] = float(np.sqrt(np.mean(r[:, keep[h]] ** 2)))
    # --- the log
    rate = float(rng.choice([100, 200, 250, 500, 1000], p=[0.1, 0.15, 0.2, 0.3, 0.25]))
    if set(W) & {"joint-torque-ripple", "rotor-inertia", "joint-elasticity"}:
        rate = max(rate, 250.0)
    tl = logio.clock(rng, t, rate, nu)
    toff = float(rng.uniform(-2e-4, 2e-4))
    filt = float(rng.uniform(25, 50)) if rng.random() < 0.5 else 0.0
    y = total
    if filt:
        y = logio.lowpass(total, filt, 1 / (t[1] - t[0]))
    tm = logio.at(tl + toff, t, y)
    if rng.random() < 0.25 and group != "none":
        r2 = float(rng.choice([125, 200, 250]))
        hold = rng.random() < 0.3 and not fast
        tg = np.arange(t[0], t[-1], 1 / r2)
        yg = logio.at(tg + toff, t, y)
        tm = yg[np.clip(np.searchsorted(tg, tl, side="right") - 1, 0, len(tg) - 1)] if hold else logio.at(tl, tg, yg)
        nu["torque_rate_hz"], nu["torque_resampled"] = r2, "hold" if hold else "lines"
    noise = (np.array([rng.uniform(0.01, 0.05)]) if drive else NOISE * rng.uniform(0.6, 1.3))
    eps = float(rng.uniform(0, 0.003 if group == "none" else 0.01))
    tm = tm + eps * tm * (tm / (np.abs(tm).max(0) + 1e-9)) ** 2 + rng.normal(0, 1, tm.shape) * noise
    nu |= {"clock_off_s": toff, "torque_lowpass_hz": filt, "sensor_nonlinearity": eps, "torque_noise": noise.tolist()}
    ql, dql = logio.joints(rng, t, q_m, dq_m, tl, nu, coarse=True, quiet=group == "none")
    # --- inverse of the whole chain from the log with the true model; nonlinear laws at their true shape
    v, a = logio.differentiate(tl, ql, dql, 0.06 if nu["encoder_step_rad"] < 3e-4 else 0.1)
    DL = slice(0, None, max(1, len(tl) // 4000))
    vs, as_, qls, tms = v[DL], a[DL], ql[DL], tm[DL]
    if on("joint-elasticity"):
        qls, vs, as_ = qls + logio.at(tl[DL], t, spr), vs + logio.at(tl[DL], t, dspr), logio.at(tl[DL], t, ddq)
        notes.append("left_rms of this elastic case takes the true twist of the springs and the arm's true accelerations")
    known = np.zeros_like(tms) if drive else rnea(rb, qls, vs, as_)
    mv = np.abs(vs).max(1) > 5e-3
    true_cols = [c for n in true if n not in ("joint-elasticity",) for c in columns(n, rb, qls, vs, as_, tms, v0, VS)] + ([as_] if drive else [])
    if "gravity-error" in true:
        true_cols += [np.where(np.arange(7) == j, as_, 0) for j in range(7)]
    if "payload" in true:
        d = rb.createData()
        full = np.array([pin.computeJointTorqueRegressor(rb, d, x, b, c)[:, -6:].T for x, b, c in zip(qls, vs, as_)])
        true_cols += [full[:, i] for i in range(6)]
    direct = np.zeros_like(tms)
    for n in ("joint-torque-ripple", *([outside] if outside else [])):
        if n in add and n in W:
            direct = direct + logio.at(tl[DL], t if n not in ("slosh",) else t[D], add[n] if n not in ("slosh",) else add[n][D])
    rl = shrink(tms - known - direct, true_cols, mv)
    h0 = min(effects, key=lambda n: effects[n] / np.sqrt(np.mean(rl[:, keep[n]] ** 2))) if effects else ""
    left = {h: float(np.sqrt(np.mean(rl[:, keep[h]] ** 2))) for h in W} or {"": float(np.sqrt(np.mean(rl ** 2)))}
    ratios = {h: effects[h] / left[h] for h in W}
    reading = float(np.sqrt(np.mean(tms[mv][:, keep[h0]] ** 2))) if h0 else float(np.sqrt(np.mean(tms[mv] ** 2)))
    for h in W:
        others = [n for n in true if n != h]
        base_cols = lin(others)
        for alt in NEAR:
            if alt == h or alt in true:
                continue
            r = shrink(add[h][D], base_cols + columns(alt, rb, qs, ds, dds, ts, v0, (0.02, 0.05, 0.1)), moving)
            rr = float(np.sqrt(np.mean(r[:, keep[h]] ** 2)))
            if (h == outside and rr < 0.85 * effects[h]) or (h != outside and group != "unexcited" and rr < min(0.6 * left[h], 0.5 * effects[h])):
                near.append(alt)
            if rr < 0.6 * effects[h]:
                notes.append(f"{h} as {alt}: {rr:.3g}")
    if filt:
        notes.append(f"torque low-pass {filt:.0f} Hz")
        lagged = shrink((y - total)[D], lin(true), moving)
        lag_rms = float(np.sqrt(np.mean(lagged ** 2)))
        notes.append(f"the low-pass changes the readings by {lag_rms:.3g} N m")
        if lag_rms > 0.3 * min(left.values()):
            near.append("sensor-lag")
    cols = {"t": tl} | {f"q{i + 1}": ql[:, i] for i in range(nj)}
    if dql is not None:
        cols |= {f"dq{i + 1}": dql[:, i] for i in range(nj)}
    cols |= {f"tau{i + 1}": tm[:, i] for i in range(nj)}
    L = lambda z: "[" + ", ".join(f"{float(x):.9g}" for x in z) + "]"
    rig = "# one axis, no robot: unknown inertia\n" if drive else '[robot]\nmodel = "lwr4plus"\nsensor_frame = "ft_sensor"\ntip_frame = "tool_tip"\ngravity = [0.0, 0.0, -9.81]\n'
    if tool is not None:
        rig += f"\n[tool]\nmass = {tool.mass:.9g}\ncom = {L(tool.com)}\ninertia = {L([*tool.inertia, 0, 0, 0])}\n"
    return {"kind": "drive" if drive else "joints", "group": group, "model": model, "hidden": W, "true": true, "near": sorted(set(near)), "effect": effects, "left": left,
            "ratios": ratios, "worst": h0, "unit": "N·m", "nuisances": nu, "notes": notes, "cols": cols, "reading": reading, "outside": outside, "rig": rig,
            "truth": {"friction": fr.tolist(), "armature": arm.tolist(), "channels": {h: [int(i + 1) for i in np.flatnonzero(keep[h])] for h in W}}}
