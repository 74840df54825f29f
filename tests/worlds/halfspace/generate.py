"""python generate.py --seed S --out DIR [--only I] [--urdf F]: writes the logs of the world `halfspace` and their truth."""
from __future__ import annotations

import argparse
import json
import time
from dataclasses import replace
from pathlib import Path as File

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from scipy.signal import butter, sosfilt, sosfilt_zi, sosfiltfilt

import laws
from arm import DT, Executed, Robot, clock, encode, execute, forward, kin_args, motion_of
from axes import FC, FV, SIGMA, Axes, columns, contribution, excite, project, spin
from cases import SCRIPTS, Case, draw, table
from laws import AMPLITUDES, BASE_N, FREE, I, TORQUE, TYPICAL, Env, Motion, Press, neutral, pick, predict, refit, rms, theta

Rng = np.random.Generator
Truth = dict[str, object]
FREE.update({"cable": ["CAB"], "run-in": ["RI", "RS"], "puncture": ["PL"]})
TYPICAL.update({"CAB": 10, "RI": 0.5, "RS": 0.1, "PL": 0.2})


def write(folder: File, cols: dict[str, np.ndarray], form: str) -> None:
    """The log and, where it has dq columns, the same log without them."""
    folder.mkdir(parents=True, exist_ok=True)
    logs = [("log", cols)]
    if "dq1" in cols:
        logs.append(("log_nodq", {k: v for k, v in cols.items() if not k.startswith("dq")}))
    for name, c in logs:
        if form == "npz":
            np.savez(folder / f"{name}.npz", **c)
        elif form == "csv":
            rows = zip(*[x if x.dtype.kind == "U" else np.char.mod("%.9g", x) for x in c.values()])
            (folder / f"{name}.csv").write_text(",".join(c) + "\n" + "\n".join(",".join(r) for r in rows) + "\n")
        else:
            pq.write_table(pa.table({k: pa.array(v.tolist() if v.dtype.kind == "U" else v) for k, v in c.items()}), folder / f"{name}.parquet")


def vec(x: np.ndarray) -> str:
    return "[" + ", ".join(repr(float(v)) for v in x) + "]"


def write_rig(folder: File, env: Env | None, robot: bool, noise: tuple[float, ...] = ()) -> None:
    """What the user knows."""
    lines = ["# world halfspace: what the user knows"]
    if robot:
        lines += ["[robot]", 'model = "lwr4plus"', 'sensor_frame = "ft_sensor"', 'tip_frame = "tool_tip"', "gravity = [0.0, 0.0, -9.81]", ""]
    if env is not None:
        lines += ["[tool]", f"mass = {env.mass!r}", f"com = {vec(env.com)}", "", "[surface]", f"point = {vec(env.point)}",
                  f"normal = {vec(env.normal)}", f"tangent = {vec(env.t1)}", ""]
        lines += ["[sensor]", "range = [40, 40, 120, 2, 2, 2]", f"noise = {vec(np.array(noise))}", ""] if noise else []
    (folder / "rig.toml").write_text("\n".join(lines) + "\n")


def place(r: Robot, rng: Rng) -> tuple[Env, np.ndarray]:
    """A surface in front of the arm and joints that hold the tool over it."""
    q0 = np.deg2rad([rng.uniform(-60, 60), rng.uniform(-38, -24), rng.uniform(-8, 8), rng.uniform(82, 98), 0.0, 0.0, rng.uniform(-30, 30)])
    q0[5] = -q0[1] + q0[3] - np.pi
    R, ps, _ = forward(q0, *kin_args(r))
    lean = laws.rotvec(np.append(rng.uniform(-0.12, 0.12, 2) * (rng.random() < 0.5), 0))
    n = lean @ np.array([0.0, 0.0, 1.0])
    x = laws.rotvec(n * rng.uniform(-0.3, 0.3)) @ R[:, 0]
    t1 = x - n * (x @ n)
    t1 /= np.linalg.norm(t1)
    mass, com = round(float(rng.uniform(0.12, 0.3)), 3), np.array([0.0, 0.0, round(float(rng.uniform(0.035, 0.055)), 3)])
    return Env(np.round(ps + R @ r.tip, 4), n, t1, np.array([0.0, 0.0, -9.81]), mass, com, r.tip.copy()), q0


def off(env: Env, rng: Rng) -> tuple[Env, dict[str, float]]:
    """The rig as it is: tool up to 2 % off, surface up to 0.02 mm, base up to 0.2 deg."""
    dm, dz, tilt = float(rng.uniform(-.012, .012)), float(rng.uniform(-2e-5, 2e-5)), np.deg2rad(rng.uniform(-.12, .12, 2))
    com = env.com + rng.uniform(-.01, .01, 3) * float(np.linalg.norm(env.com))
    true = replace(env, mass=env.mass * (1 + dm), com=com, point=env.point + dz * env.normal, gravity=laws.rotvec(np.append(tilt, 0)) @ env.gravity)
    return true, {"tool_mass_off": dm, "surface_off_m": dz, "base_tilt_deg": float(np.rad2deg(np.hypot(*tilt)))}


def bend(y: np.ndarray, nl: np.ndarray, full: np.ndarray) -> np.ndarray:
    """Sensor nonlinearity: share nl of the full-scale reading, quadratic (zero at 0 and at full)."""
    return y + nl * y * (np.abs(y) / full - 1)


def drift(tl: np.ndarray, size: np.ndarray, rng: Rng) -> np.ndarray:
    """Slow temperature drift of at most size over the log, per channel."""
    u = (tl - tl[0]) / (tl[-1] - tl[0])
    return (1 - np.exp(-u * rng.uniform(0.5, 2)))[:, None] * size * rng.uniform(-1, 1, len(size))


def log_clock(case: Case, T: float, rng: Rng, rates: list[int]) -> tuple[np.ndarray, dict[str, float]]:
    rate = float(case.opt.get("rate", 100 if T > 90 else rng.choice(rates)))
    jit, drop = float(rng.choice([0.0, 0.03, 0.1])), float(rng.choice([0.0, 0.005, 0.02]))
    return clock(T, rate, rng, jit, drop), {"rate_hz": rate, "jitter": jit, "dropped": drop}


def dq_nuisance(rng: Rng) -> tuple[dict[str, object], tuple[float, float, str, float]]:
    noise, bias = float(10 ** rng.uniform(-5, np.log10(5e-4))), float(rng.uniform(0, 2e-4))
    mode = str(rng.choice(["lag", "lowpass"]))
    value = float(rng.uniform(0, 5e-3)) if mode == "lag" else float(rng.uniform(25, 100))
    return {"dq_noise": noise, "dq_bias": bias, "dq_" + mode: value}, (noise, bias, mode, value)


def scaled(th: np.ndarray, case: Case, f: dict[str, float], base: str) -> np.ndarray:
    """Parameters with the hidden effects' amplitudes scaled."""
    out = th.copy()
    for h in case.hidden:
        if h == "saturation":
            continue
        flat = neutral(out, h, base)
        for p in AMPLITUDES.get(h, FREE[h][:1]):
            out[I[p]] = flat[I[p]] + f[h] * (out[I[p]] - flat[I[p]])
    return out


def measured(m: Motion | Press, log_t: np.ndarray, q: np.ndarray, r: Robot) -> Motion | Press:
    """Motion as a user would rebuild it from the log: even clock, zero-phase low-pass, central differences."""
    rate = 1 / float(np.median(np.diff(log_t)))
    t = np.arange(log_t[0], log_t[-1], 1 / rate)
    qu = np.stack([np.interp(t, log_t, c) for c in q.T], 1)
    if isinstance(m, Press):
        qu = sosfiltfilt(butter(2, min(60.0, 0.3 * rate), fs=rate, output="sos"), qu, axis=0)
        return Press(t, qu[:, 0], np.gradient(qu[:, 0], t))
    return motion_of(t, sosfiltfilt(butter(2, min(35.0, 0.3 * rate), fs=rate, output="sos"), qu, axis=0), r)


def contact_case(case: Case, r: Robot, rng: Rng, folder: File, form: str) -> Truth:
    """One wrench or tester log."""
    tester = case.kind == "tester"
    names, base = case.model.split(","), case.model.split(",")[0]
    true_names = names + list(case.hidden)
    path = SCRIPTS[case.script](rng, case.opt)
    par = draw(case.par, rng)
    th = theta(**par)
    info: dict[str, object] = {}
    t, c, phase = path.arrays()
    env: Env | None = None
    if "puncture" in case.hidden:
        deep = np.flatnonzero((phase == "poke") & (c["h"] < -2e-3) & (t > 0.4 * t[-1]))
        th[I["PT"]] = t[deep[0]]
    if tester:
        sos = butter(2, float(rng.uniform(8, 15)), fs=1 / DT, output="sos")
        h = -sosfilt(sos, c["h"], zi=sosfilt_zi(sos) * c["h"][0])[0]
        force = laws.contact(t, h, np.gradient(h, t), np.zeros((len(t), 2)), np.zeros((len(t), 2)), th[:39])[:, 0]
        machine = float(rng.uniform(0, 1e-5))              # m/N: the drive yields before the displacement gauge
        h = h - sosfiltfilt(butter(2, 20.0, fs=1 / DT, output="sos"), force) * machine
        m: Motion | Press = Press(t, h, np.gradient(h, t))
        true_env, q, dq = None, h[:, None], m.rate[:, None]
        info["drive_compliance"] = machine
    else:
        for attempt in range(8):                           # another place where the joints do not reach
            env, q0 = place(r, rng)
            true_env, info = off(env, rng)
            try:
                ex: Executed = execute(path, r, true_env, q0, th, rng)
                break
            except RuntimeError:
                if attempt == 7:
                    raise
        info.update(ex.info)
        m, q, dq = ex.motion, ex.q, ex.dq
    # instruments
    n_ch = 1 if tester else 6
    sxy, st = float(rng.uniform(0.01, 0.025)), float(rng.uniform(3e-4, 8e-4))
    sigma = np.array([float(rng.uniform(0.008, 0.03))]) if tester else np.array([sxy, sxy, min(0.05, sxy * rng.uniform(1.2, 2)), st, st, 0.7 * st])
    top = 0.003 if case.group == "none" else 0.01
    full = np.array([15.0]) if tester else np.array([20, 20, 20, 1, 1, 1.0])
    nl = rng.uniform(-top, top, n_ch)
    step = float(rng.choice([1e-7, 1e-6])) if tester else float(rng.choice([2e-6, 5e-6, 1e-5, 2e-5]))
    step = case.opt.get("step", step)
    tl, ck = log_clock(case, t[-1], rng, [500, 1000, 2000] if tester and "HUM" in par else [200, 500, 500, 1000])
    shift = float(rng.uniform(-2e-4, 2e-4))
    dn, dargs = dq_nuisance(rng)
    qm, dqm = encode(tl, t, q, dq, rng, step, *(dargs if not tester else (2e-5, 0.0, "lag", 0.0)))
    white, slow = rng.standard_normal((len(tl), n_ch)) * sigma, drift(tl, 0.5 * sigma, rng)
    mm = measured(m, tl, qm, r)
    # amplitude of the hidden effects against what is left; refit of the other laws on every few samples of the executed motion
    md = m.every(max(1, len(t) // 12000))
    f = {h: 1.0 for h in case.hidden}
    effects: dict[str, dict[str, float]] = {}
    sat = case.hidden and "saturation" in case.hidden
    for _ in range(9):
        tht = scaled(th, case, f, base)
        clean = predict(m, tht, true_env)[0]
        y = np.stack([np.interp(tl + shift, t, x) for x in clean.T], 1)
        y = bend(y, nl, full) + slow + white
        if sat:
            y = np.clip(y, -par["SAT"], par["SAT"])
        model_y, fc_m = predict(mm, tht, env)
        rest = np.stack([np.interp(mm.t, tl, a) for a in y.T], 1)       # the log on the even clock
        raw, fc_log = y - np.stack([np.interp(tl, mm.t, a) for a in model_y.T], 1), np.stack([np.interp(tl, mm.t, a) for a in fc_m.T], 1)
        Rl = Press(tl, tl, tl) if tester else replace(mm, t=tl, R=mm.R[np.clip(np.searchsorted(mm.t, tl), 0, len(mm.t) - 1)])
        yd, fcd = predict(md, tht, env)
        again = False
        for h in case.hidden or ("",):
            left = rms(pick(raw, Rl, fc_log, env, h))
            if not h:
                effects[h] = {"effect": 0.0, "left": left}
                continue
            others = [x for x in true_names if x != h]
            if h == "saturation":
                effect, read = rms((yd - predict(md, neutral(tht, h, base), env)[0])[np.abs(yd[:, 0]) > 0.1]), rms(yd)
            else:
                _, res = refit(md, yd, neutral(tht, h, base), others, env, h in TORQUE)
                effect, read = rms(pick(res, md, fcd, env, h)), rms(pick(yd, md, fcd, env, h))
            effects[h] = {"effect": effect, "left": left, "share_of_reading": effect / read}
            need = max(4.6 * left, 0.07 * read) if case.group == "outside" else 3.2 * left
            if case.group in ("single", "pair", "outside") and effect < need and h != "saturation":
                f[h] *= float(np.clip(1.08 * need / max(effect, 1e-9), 1.1, 2.0))
                again = True
            if case.group == "weak" and not 0.45 < effect / left < 0.8:
                f[h] *= float(np.clip(0.6 * left / max(effect, 1e-9), 0.1, 4))
                again = True
        if not again:
            break
    near = list(case.near)
    for alt in case.alts:
        a0 = neutral(tht, case.hidden[0], base)
        for p in FREE[alt]:
            if p != "N":
                a0[I[p]] = TYPICAL[p] * (1.0 if a0[I[p]] == DEFAULT_OF(p) and DEFAULT_OF(p) != 0 else 0.3)
        if alt == "friction-rounding":
            a0[I["FT"]] = 2.0
        _, res = refit(md, yd, a0, names + [alt], env, False)
        part = rms(pick(res, md, fcd, env, case.hidden[0]))
        info[f"left_with_{alt}"] = part
        if part < 0.5 * effects[case.hidden[0]]["left"]:
            near.append(alt)
    # the inverse of the chain: true model refit on the logged motion
    fit_names = [x for x in true_names if x not in ("saturation", "puncture")]
    k = max(1, len(mm.t) // 12000)
    plain = tht.copy()                                     # the catalogue's plain forms: Hertz without Sneddon's series, one branch, Dahl of 0.1 mm
    plain[[I["XR"], I["R2"], I["FT"]]] = 0.0
    if "presliding" not in true_names:
        plain[I["MB"]] = 1e-4
    torque = any(h in TORQUE for h in case.hidden)
    fits = [refit(mm.every(k), rest[::k], x, fit_names, env, torque)[1] for x in (tht, plain)]
    for h, e in effects.items():
        e["fit_own"], e["fit_plain"] = (rms(pick(x, mm.every(k), fc_m[::k], env, h)) for x in fits)
        e["left"] = max(e["left"], e["fit_plain"])
    worst = min(effects, key=lambda h: effects[h]["effect"] / effects[h]["left"])
    fit_rms, info["material_form_off"] = effects[worst]["fit_plain"], float(np.sqrt(max(effects[worst]["fit_plain"]**2 - effects[worst]["fit_own"]**2, 0)))
    # files
    cols: dict[str, np.ndarray] = {"t": tl}
    has_dq = bool(rng.random() >= 0.25)
    if tester:
        cols["depth"] = qm[:, 0]
        if has_dq:
            cols["depth_rate"] = dqm[:, 0]
        cols["normal_force"] = y[:, 0]
    else:
        cols.update({f"q{j + 1}": qm[:, j] for j in range(7)})
        if has_dq:
            cols.update({f"dq{j + 1}": dqm[:, j] for j in range(7)})
        cols.update({k: y[:, j] for j, k in enumerate(("fx", "fy", "fz", "tx", "ty", "tz"))})
    has_phase = bool(rng.random() < 0.6)
    if has_phase:
        cols["phase"] = phase[np.clip(np.searchsorted(t, tl), 0, len(t) - 1)]
    write(folder, cols, form)
    write_rig(folder, env, not tester, tuple(sigma) if not tester and rng.random() < 0.7 else ())
    info.update({**ck, "force_noise": sigma.tolist(), "nonlinearity": nl.tolist(), "encoder_step": step, "clock_off_s": shift, "has_dq": has_dq,
                 "has_phase": has_phase, "drift_of_noise": 0.5, **(dn if not tester else {})})
    used = {n: float(tht[I[n]]) for n in laws.NAMES if tht[I[n]] != theta()[I[n]]}
    return {"effects": effects, "near": near, "effect_rms": effects[worst]["effect"], "left_rms": effects[worst]["left"], "fit_rms": fit_rms,
            "reading_rms": rms(pick(yd, md, fcd, env, worst)), "unit": "N·m" if worst in TORQUE else "N", "nuisances": info, "parameters": used,
            "seconds": float(t[-1])}


def DEFAULT_OF(p: str) -> float:
    return laws.DEFAULT.get(p, 0.0)


def axes_case(case: Case, r: Robot, rng: Rng, folder: File, form: str) -> Truth:
    """One log of joint torques (arm) or of a single drive."""
    drive = case.kind == "drive"
    par = draw(case.par, rng)
    names, hidden = case.model.split(","), list(case.hidden)
    a: Axes = spin(SCRIPTS[case.script](rng, case.opt), rng) if drive else excite(r, rng, bool(case.opt.get("slow")), par["amp"] if "payload" in hidden else 0.0)
    nj = a.q.shape[1]
    size = np.array([1.0]) if drive else FC / FC[0] * rng.uniform(0.7, 1.3, 7)
    fc = rng.uniform(0.4, 0.8, 1) if drive else FC * rng.uniform(0.7, 1.3, 7)
    fv = rng.uniform(0.06, 0.12, 1) if drive else FV * rng.uniform(0.7, 1.3, 7)
    sigma = rng.uniform(0.008, 0.02, 1) if drive else SIGMA * rng.uniform(0.6, 1.1)
    visible = [n for n in names if n not in ("rigid-body", "joint-coulomb-friction", "joint-viscous-friction")]
    amps = {n: (par.get("amp2") if i == 1 and hidden else par.get("amp", 0.0)) or 0.0 for i, n in enumerate(hidden or visible)}
    rigid = a.rigid if drive else np.asarray(a.info["level"])
    tilt = a.rigid - rigid
    lvl = replace(a, rigid=rigid)
    lp = float(rng.uniform(25, 50)) if (not drive and rng.random() < 0.5) or (drive and rng.random() < 0.25) else 0.0
    top = 0.003 if case.group == "none" else 0.006
    nl, full = rng.uniform(-top, top, nj), np.array([8.0]) if drive else np.array([50, 80, 40, 40, 20, 15, 10.0])
    tl, ck = log_clock(case, a.t[-1], rng, [200, 500, 1000] if not drive else [200, 500, 1000, 1000])
    other = str(rng.choice(["none", "none", "hold", "interpolated"]))
    other = "none" if other == "hold" and ck["rate_hz"] < 500 else other
    white, slow = rng.standard_normal((len(tl), nj)) * sigma, drift(tl, 0.5 * sigma, rng)
    move = np.abs(a.dq) > 0.01
    ml = np.stack([np.interp(tl, a.t, x) for x in move.T.astype(float)], 1) > 0.5
    f = {h: 1.0 for h in hidden}
    effects: dict[str, dict[str, float]] = {}
    for _ in range(8):
        parts = {n: contribution(n, amps[n] * f.get(n, 1.0), lvl, fc, fv, size, drive) for n in amps}
        clean = rigid + fc * a.s + fv * a.dq + sum(parts.values())
        y = clean + tilt
        if lp:
            sos = butter(1, lp, fs=1 / DT, output="sos")
            y = np.stack([sosfilt(sos, x, zi=sosfilt_zi(sos) * x[0])[0] for x in y.T], 1)
        ts = np.arange(0, a.t[-1], 1 / (0.5 * ck["rate_hz"]))
        if other == "hold":
            src = ts[np.clip(np.searchsorted(ts, tl, "right") - 1, 0, None)]
            yl = np.stack([np.interp(src, a.t, x) for x in y.T], 1)
        elif other == "interpolated":
            yl = np.stack([np.interp(tl, ts, np.interp(ts, a.t, x)) for x in y.T], 1)
        else:
            yl = np.stack([np.interp(tl, a.t, x) for x in y.T], 1)
        yl = bend(yl, nl, full) + slow + white
        cl = np.stack([np.interp(tl, a.t, x) for x in clean.T], 1)
        left = rms((yl - cl)[ml])
        read = rms(clean[move])
        effects = {"": {"effect": 0.0, "left": left}} if not hidden else {}
        again = False
        for h in hidden:
            effect = rms(project(parts[h], names + [x for x in hidden if x != h], lvl, drive)[move])
            effects[h] = {"effect": effect, "left": left, "share_of_reading": effect / read}
            need = max(4.6 * left, 0.07 * read) if case.group == "outside" else 3.2 * left
            if case.group in ("single", "pair", "outside") and effect < need and h != "payload":
                f[h] *= float(np.clip(1.08 * need / max(effect, 1e-9), 1.1, 2.0))
                again = True
        if not again:
            break
    at_log = Axes(tl, *[np.stack([np.interp(tl, a.t, x) for x in z.T], 1) for z in (a.q, a.dq, a.ddq, rigid, a.s)],
                  None if a.load is None else np.stack([np.interp(tl, a.t, x) for x in a.load.T], 1), a.phase, {})
    fit_rms = rms(project(yl - (0 if drive else at_log.rigid), names + hidden, at_log, drive)[ml])
    step = float(rng.choice([5e-6, 5e-5, 3e-4])) if drive else float(rng.choice([2e-6, 5e-6, 5e-5, 1e-4]))
    dn, dargs = dq_nuisance(rng)
    qm, dqm = encode(tl, a.t, a.q, a.dq, rng, step, *dargs)
    has_dq = bool(rng.random() >= 0.25)
    cols: dict[str, np.ndarray] = {"t": tl, **{f"q{j + 1}": qm[:, j] for j in range(nj)}}
    if has_dq:
        cols.update({f"dq{j + 1}": dqm[:, j] for j in range(nj)})
    cols.update({f"tau{j + 1}": yl[:, j] for j in range(nj)})
    has_phase = bool(rng.random() < 0.5)
    if has_phase:
        cols["phase"] = np.where(ml.any(1), "free", "rest")
    write(folder, cols, form)
    write_rig(folder, None, not drive)
    worst = min(effects, key=lambda h: effects[h]["effect"] / effects[h]["left"])
    info: dict[str, object] = {**ck, "torque_noise": sigma.tolist(), "nonlinearity": nl.tolist(), "encoder_step": step, "torque_lowpass_hz": lp, "torque_rate": other,
                               "has_dq": has_dq, "has_phase": has_phase, "drift_of_noise": 0.5, **dn, **{k: v for k, v in a.info.items() if k != "level"}}
    near = list(case.near) + (["sensor-lag"] if lp else []) + (["sensor-lag", "time-offset"] if other == "hold" else [])
    return {"effects": effects, "near": near, "effect_rms": effects[worst]["effect"], "left_rms": effects[worst]["left"], "fit_rms": fit_rms,
            "reading_rms": read, "unit": "N·m", "nuisances": info, "seconds": float(a.t[-1]),
            "parameters": {"Fc": fc.tolist(), "Fv": fv.tolist(), **{n: amps[n] * f.get(n, 1.0) for n in amps}, "size": size.tolist()}}


def main() -> None:
    ap = argparse.ArgumentParser()
    ap.add_argument("--seed", type=int, required=True)
    ap.add_argument("--out", type=File, required=True)
    ap.add_argument("--only", type=int)
    ap.add_argument("--urdf", default=str(File(__file__).resolve().parents[3] / "urdf" / "lwr4plus.urdf"))
    args = ap.parse_args()
    args.out.mkdir(parents=True, exist_ok=True)
    r = Robot.load(args.urdf)
    truth: list[Truth] = []
    for i, case in enumerate(table()):
        if args.only is not None and i != args.only:
            continue
        t0, rng, name = time.time(), np.random.default_rng([args.seed, i, 7]), f"case_{i:03d}"
        form = {5: "csv", 10: "npz"}.get(i % 12, "parquet")
        out = (contact_case if case.kind in ("wrench", "tester") else axes_case)(case, r, rng, args.out / name, form)
        outside = case.group == "outside"
        truth.append({"case": name, "kind": case.kind, "group": case.group, "model": case.model, "hidden": list(case.hidden),
                      "true_model": ",".join(case.model.split(",") + list(case.hidden)), **out, "notes": case.note, **({"outside": True} if outside else {})})
        e = "; ".join(f"{h or '-'} {v['effect']:.3f}/{v['left']:.3f}={v['effect'] / v['left']:.1f} ({100 * v.get('share_of_reading', 0):.0f}%)" for h, v in out["effects"].items())
        print(f"{name} {case.kind:7s} {case.group:9s} {e} fit {out['fit_rms']:.3f} read {out['reading_rms']:.2f} T {out['seconds']:.0f}s "
              f"near {out['near']} {time.time() - t0:.1f}s", flush=True)
    if args.only is None:
        (args.out / "truth.json").write_text(json.dumps(truth, indent=1, ensure_ascii=False))


if __name__ == "__main__":
    main()
