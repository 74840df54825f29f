"""Joint-torque logs of arms in free motion and single-axis drive logs: motion, torques, hidden effects, refits. Units rad, N·m."""
from __future__ import annotations

from pathlib import Path

import numpy as np
import pinocchio as pin
from scipy.integrate import solve_ivp
from scipy.interpolate import CubicSpline

import laws
from arm import Arm
from common import Case, clock, encoder, lowpass, rates, rms, smooth, wanted

KINDS = ["Dahl", "LuGre", "Dupont", "rounded", "Prandtl"]
NEAR = {"payload": ["gravity-error"], "gravity-error": ["payload"], "quadratic-drag": ["joint-viscous-friction", "joint-stribeck-friction"], "warm-up": ["joint-viscous-friction", "joint-coulomb-friction"],
        "travel-friction": ["joint-torque-ripple", "joint-friction-asymmetry"], "frictional-lag": ["joint-viscous-friction", "joint-stribeck-friction", "joint-elasticity"],
        "joint-stribeck-friction": ["joint-viscous-friction"], "rotor-inertia": [], "joint-load-friction": ["joint-torque-gain"]}


def quintic_tour(rng: np.random.Generator, lo: np.ndarray, hi: np.ndarray, vmax: np.ndarray, total: float) -> tuple[np.ndarray, np.ndarray]:
    """Commanded angles at 100 Hz: moves between random poses at speeds of 5 to 60 % of vmax with short rests."""
    q, ts, qs, now = (lo + hi) / 2, [0.0], [(lo + hi) / 2], 0.0
    while now < total:
        far = rng.uniform(lo, hi)
        time = max(0.5, np.max(np.abs(far - q) / (vmax * rng.choice([0.06, 0.2, 0.4, 0.6]))) * 1.6)
        time = min(time, 7.0)
        m = int(time / 0.01)
        s = np.arange(1, m + 1) / m
        e = s ** 3 * (10 - 15 * s + 6 * s * s)
        ts.extend(now + s * m * 0.01), qs.extend(q + np.outer(e, far - q))
        q, now = far, now + m * 0.01
        ts.extend(now + np.array([0.1, 0.2, 0.3])), qs.extend([q] * 3)
        now += 0.3
    return np.array(ts), np.array(qs)


def terms(u: dict, t: np.ndarray, q: np.ndarray, v: np.ndarray, a: np.ndarray, rb: np.ndarray, kind: int | None) -> dict[str, np.ndarray]:
    """Torque of each effect (T,n) along a motion for the strengths in u; rb is the rigid-body torque. kind None: the user's bristle."""
    dt = np.gradient(t)
    z = np.column_stack([laws.axis_direction(u["kind"] if kind is None else kind, u["ell"], u["vr"], v[:, i], dt) for i in range(v.shape[1])])
    fc, fv, warm = u["fc"], u["fv"], np.exp(-t / 12.0)[:, None]
    return {"joint-coulomb-friction": fc * z, "joint-viscous-friction": fv * v, "joint-stribeck-friction": 0.7 * fc * z * np.exp(-(v / u["vs"]) ** 2),
            "joint-load-friction": 0.12 * np.abs(rb) * z, "joint-torque-ripple": fc * (0.5 * np.sin(u["cyc"] * q + u["ph"]) + 0.15 * np.sin(2 * u["cyc"] * q - u["ph"])),
            "joint-spring": u["spring"] * (q - u["q0"]), "rotor-inertia": u["rotor"] * a, "joint-friction-asymmetry": 0.35 * fc * np.abs(z) * u["sg"],
            "joint-torque-offset": 0.4 * fc * u["sg"] + 0 * v, "joint-torque-gain": 0.08 * u["sg"] * rb, "quadratic-drag": u["quad"] * v * np.abs(v),
            "warm-up": warm * (0.6 * fc * z + 1.0 * fv * v), "travel-friction": 0.6 * fc * z * (q - u["q0"]) / (np.abs(q - u["q0"]).max(axis=0) + 1e-9),
            "frictional-lag": 0.7 * fc * z * np.exp(-(lowpass(v, 1.0, 1 / np.median(dt)) / u["vs"]) ** 2)}


def project(y: np.ndarray, cols: list[np.ndarray]) -> np.ndarray:
    """Residual of y (T,n) after least squares of per-joint multiples of the columns."""
    out = np.empty_like(y)
    for i in range(y.shape[1]):
        A = np.column_stack([c[:, i] + 0 * y[:, i] for c in cols]) if cols else np.zeros((len(y), 1))
        out[:, i] = y[:, i] - A @ np.linalg.lstsq(A, y[:, i], rcond=1e-10)[0]
    return out


def axis_case(rng: np.random.Generator, kind: str, group: str, hidden: list[str], urdf: Path | None, target: float) -> Case:
    """A joints log (urdf given) or a drive log; the readings are motor current times constant, quantised, filtered."""
    nuis: dict = {}
    slow = group == "unexcited"
    bristle = int(rng.choice([0, 1, 2, 3, 4]))
    total = rng.uniform(20, 34)
    if urdf is not None:
        tilt = pin.exp3(np.radians(rng.uniform(-0.03, 0.03, 3) * np.array([1, 1, 0]))) @ np.array([0, 0, -9.81])
        arm, user = Arm(urdf, gravity=tilt), Arm(urdf)
        n, model = arm.n, arm.model
        size = np.minimum(model.effortLimit, 90.0)
        lo, hi = arm.home - np.minimum(1.3, (arm.home - model.lowerPositionLimit) * 0.9), arm.home + np.minimum(1.3, (model.upperPositionLimit - arm.home) * 0.9)
        if n == 6:
            lo[4:], hi[4:] = arm.home[4:] - 2.8, arm.home[4:] + 2.8
        vmax = model.velocityLimit * (0.1 if slow else 0.9)
        if slow:
            lo, hi = arm.home - 0.25 * (arm.home - lo), arm.home + 0.25 * (hi - arm.home)
        ts, qs = quintic_tour(rng, lo, hi, vmax, total)
        stiff = rng.choice([0.6, 1.0, 2.0])
        kp = stiff * (np.array([3500, 3500, 2500, 2500, 900, 900, 700.]) if n == 7 else np.array([4000, 4000, 3000, 1200, 1000, 800.]))
        fc = size * rng.uniform(0.03, 0.06, n)
        elastic = "joint-elasticity" in hidden
        flex = arm.drive * (0.06 if elastic else 1.0)
        if "payload" in hidden:
            arm = Arm(urdf, 0.5, np.array([0.01, 0.0, 0.08]), tilt)
        t, ql, th = arm.simulate(ts, qs, kp, rng.uniform(0.5, 0.9), 0.5 * fc, flex)
        nuis.update(robot=urdf.stem, joint_stiffness=float(kp[0]), drive_stiffness=float(flex[0]))
        rotor = arm.inertia * rng.uniform(0.6, 1.0)
        true = arm.model.copy()
        if "gravity-error" in hidden:
            for j in (2, 3, 4):
                true.inertias[j].lever = true.inertias[j].lever + rng.uniform(0.02, 0.05, 3) * rng.choice([-1, 1], 3)
        td, ud = true.createData(), user.model.createData()
    else:
        n, elastic = 1, False
        machine = str(rng.choice(["ball screw", "belt", "rotary table"]))
        J, fc = float(10 ** rng.uniform(-3.5, -1.5)), None
        vmax = np.array([20.0 if machine != "rotary table" else 6.0])
        span = np.array([rng.uniform(8, 25)]) * (1 if machine != "rotary table" else 0.3)
        ts, qs = quintic_tour(rng, -span, span, vmax, total)
        lead = J * np.abs(CubicSpline(ts, qs)(ts, 2)).max()
        fc = np.array([rng.uniform(0.3, 0.8) * lead])
        ref, w0 = CubicSpline(ts, qs), rng.uniform(60, 120)

        def rhs(time: float, x: np.ndarray) -> list[float]:
            """Motor and load through a stiff coupling under PD; friction regularised for the motion only."""
            pd = w0 ** 2 * (ref(time)[0] - x[0]) + 1.6 * w0 * (ref(time, 1)[0] - x[1]) + ref(time, 2)[0]
            return [x[1], pd - 0.1 * fc[0] / J * x[1] / np.sqrt(x[1] ** 2 + 1e-2)]
        t = np.arange(0, ts[-1], 1e-3)
        sol = solve_ivp(rhs, (0, t[-1]), [qs[0, 0], 0.0], method="LSODA", t_eval=t, rtol=1e-6, atol=1e-8, max_step=0.05)
        ql = th = sol.y[0][:, None]
        rotor, size = np.array([J]), np.array([lead * 1.5])
        nuis.update(machine=machine, servo_rad_s=float(w0))
    real = CubicSpline(t, ql)
    q, v, a = real(t), real(t, 1), real(t, 2)
    sg = rng.choice([-1.0, 1.0], n)
    vtop = np.percentile(np.abs(v), 90, axis=0) + 1e-6
    u = dict(kind=bristle, ell=2e-3 if kind == "joints" else 2e-2, vr=0.01 if kind == "joints" else 0.1, fc=fc, fv=fc * rng.uniform(0.5, 1.0, n) / vtop, vs=0.12 * vtop + 0.01, cyc=rng.choice([4.0, 6.0, 8.0, 12.0]) if kind == "joints" else rng.choice([1.0, 2.0, 4.0]),
             ph=rng.uniform(0, 6, n), spring=0.12 * size * sg / np.maximum(1.0, np.ptp(q, axis=0)), q0=q.mean(axis=0), rotor=rotor, sg=sg, quad=fc / vtop ** 2)

    def rigid(motion: np.ndarray, dv: np.ndarray, da: np.ndarray, truth: bool) -> np.ndarray:
        if urdf is None:
            return rotor * da
        m, d = (true, td) if truth else (user.model, ud)
        return np.array([pin.rnea(m, d, x, y, z).copy() for x, y, z in zip(motion, dv, da)])
    model_names = ["rigid-body", "joint-coulomb-friction", "joint-viscous-friction"]
    if kind == "joints":
        model_names += ["rotor-inertia"]
    if rng.random() < 0.5:
        model_names.append("joint-torque-offset")
    if rng.random() < 0.35 and kind == "drive" and "joint-spring" not in hidden:
        model_names.append("joint-stribeck-friction")
    if rng.random() < 0.3 and kind == "joints":
        model_names.append("joint-stribeck-friction")
    if "frictional-lag" in hidden and "joint-stribeck-friction" in model_names:
        model_names.remove("joint-stribeck-friction")
    model_names = [m for m in model_names if m not in hidden]
    rb = rigid(q, v, a, True)
    T = terms(u, t, q, v, a, rb, bristle)
    base = rb + sum(T[m] for m in model_names if m in T)
    used = {}
    for h in hidden:
        if h in ("payload", "gravity-error"):
            used[h] = rb - rigid(q, v, a, False)
        elif elastic and h == "joint-elasticity":
            seen_q = CubicSpline(t, th)
            used[h] = rb - rigid(seen_q(t), seen_q(t, 1), seen_q(t, 2), True)
        else:
            used[h] = T[h]
    seen = CubicSpline(t, th if elastic else ql)
    rate = float(rng.choice([100, 200, 250, 500]))
    tl = clock(rng, t[-1], rate, nuis)
    step = float(10 ** rng.uniform(-5.5, -3.7)) if kind == "joints" else float(rng.choice([1e-5, 1e-4, 2 * np.pi / 8192]))
    qn = encoder(rng, seen(tl), step, nuis)
    dq = rates(rng, seen(tl, 1), rate, nuis)
    amp, quant = rng.uniform(0.002, 0.005) * size, rng.uniform(0.001, 0.003) * size
    hz = float(rng.uniform(25, 50)) if rng.random() < 0.5 else 0.0
    slower = rng.random() < 0.2
    shift = rng.uniform(-0.3, 0.3, n) * amp
    draws = rng.standard_normal((len(tl), n)) * amp
    skew = float(rng.uniform(-2e-4, 2e-4))
    nuis.update(friction=KINDS[bristle], torque_lowpass_hz=hz, torque_other_rate="hold 100 Hz" if slower and rate > 100 else "", torque_noise=float(amp[0]), torque_step=float(quant[0]), clock_offset=skew)

    def measure(clean: np.ndarray) -> np.ndarray:
        w = lowpass(clean, hz, 1000.0) if hz else clean
        grid = np.floor(tl * 100) / 100 if (slower and rate > 100) else tl
        w = np.column_stack([np.interp(grid - skew, t, c) for c in w.T])
        return np.round((w + draws + np.outer(tl / tl[-1], shift)) / quant) * quant
    sm = smooth(tl, qn, 12.0 if kind == "joints" else 25.0)
    g = sm.x[::max(1, round(rate / 150))]
    qu, vu, au = sm(g), sm(g, 1), sm(g, 2)
    if elastic:
        full = CubicSpline(t, used["joint-elasticity"])
    rbu = rigid(qu, vu, au, False)
    U = terms(u, g, qu, vu, au, rbu, bristle)
    keep = slice(int(0.02 * len(g)), int(0.98 * len(g)))
    own = [m for m in model_names if m in T] + ([] if urdf is not None else ["rotor-inertia"])
    fixed = urdf is not None

    def assess(s: float) -> tuple[list[float], list[float], np.ndarray, np.ndarray]:
        clean = base + s * sum(used.values()) if hidden else base
        if set(hidden) & {"payload", "gravity-error", "joint-elasticity"}:
            extra = [h for h in hidden if h in ("payload", "gravity-error", "joint-elasticity")]
            clean = base + s * sum(x for h, x in used.items() if h not in extra)
        w = measure(clean)
        wu = np.column_stack([np.interp(g, tl, c) for c in w.T]) - (rbu if fixed else 0)
        for h, x in used.items():
            part = s if h not in ("payload", "gravity-error", "joint-elasticity") else 1.0
            wu = wu - part * (U[h] if h in U and h not in ("payload", "gravity-error") else np.column_stack([np.interp(g, t, c) for c in x.T]))
        left = rms(project(wu, [U[m] for m in own])[keep])
        es = []
        for h, x in used.items():
            part = s if h not in ("payload", "gravity-error", "joint-elasticity") else 1.0
            es.append(part * rms(project(x[::5], [T[m][::5] for m in own] + [used[o][::5] for o in used if o != h])))
        return es or [0.0], [left] * max(1, len(used)), w, clean
    s = 1.0
    for _ in range(4):
        es, ls, w, clean = assess(s)
        ratio = min(e / l for e, l in zip(es, ls))
        grow = wanted(group, ratio, target, min(es) / rms(w))
        if grow == 1.0:
            break
        s = float(np.clip(s * grow, 0.15, 3.0))
    cols = {"t": tl, **{f"q{i + 1}": qn[:, i] for i in range(n)}}
    if dq is not None:
        cols.update({f"dq{i + 1}": dq[:, i] for i in range(n)})
    cols.update({f"tau{i + 1}": w[:, i] for i in range(n)})
    near = sorted({x for h in hidden for x in NEAR.get(h, [])} - set(hidden))
    if urdf is not None:
        joints = ", ".join(f'"{x}"' for x in list(user.model.names)[1:])
        rig = f'[robot]\nmodel = "{urdf.name}"\nsensor_frame = "ft_sensor"\ntip_frame = "tool_tip"\njoints = [{joints}]\n'
    else:
        rig = f"# one {nuis['machine']} axis: motor angle q1 [rad], motor torque tau1 [N·m] from current; inertia unknown; no robot\n"
    weight = rms(w)
    i = int(np.argmin([e / l for e, l in zip(es, ls)]))
    notes = f"strength {s:.2f}; effect/left {[round(e / l, 2) for e, l in zip(es, ls)] if hidden else '-'}; readings rms {weight:.3f} N·m" + (f"; torque low-pass {hz:.0f} Hz first order" if hz else "")
    fmt = "csv" if kind == "drive" and rng.random() < 0.3 else "parquet"
    return Case(kind, group, model_names, hidden, near, es[i], ls[i], "N·m", nuis, notes, cols, rig, urdf, fmt, {"readings_rms": weight})
