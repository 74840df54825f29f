"""Wrench logs of compliant arms that poke and slide, and single-axis tester logs: motion, readings, hidden effects, refits."""
from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pinocchio as pin
from scipy.interpolate import CubicSpline
from scipy.signal import cont2discrete, lfilter

import laws
from arm import Arm
from common import Case, clock, encoder, gauss_newton, lowpass, rates, rms, smooth, wanted

I = laws.INDEX
BASES = {"hooke": ["k"], "kelvin-voigt": ["k", "c"], "hertz": ["k"], "hunt-crossley": ["k", "lam"], "zener": ["k", "r1", "t1"], "maxwell": ["k", "t1"]}
FREE = {**BASES, "hertz-exponent": ["n"], "viscous-damping": ["c"], "hunt-crossley-damping": ["lam"], "relaxation": ["r1", "t1"], "hysteresis": ["hA", "hL"],
        "stress-softening": ["mR", "mL"], "adhesion": ["aF", "aL"], "stiffening-layer": ["sK", "sD"], "surface-offset": ["z0"], "stiffness-drift": ["al"],
        "stiffness-inhomogeneity": ["iA", "iX", "iY", "iW"], "structural-compliance": ["C"], "coulomb-friction": ["mu"], "viscous-friction": ["cv"],
        "stribeck-friction": ["dmu", "vs"], "presliding": ["ell"], "friction-rounding": ["vr"], "load-dependent-friction": ["p"], "friction-anisotropy": ["an"],
        "tool-mass": ["dm"], "tool-com": ["cx", "cy", "cz"], "tip-offset": ["ox", "oy", "oz"], "sensor-bias": ["bx", "by", "bz", "btx", "bty", "btz"],
        "sensor-drift": ["dfx", "dfy", "dfz", "dtx", "dty", "dtz"], "sensor-misalignment": ["m1", "m2", "m3"], "sensor-gain": ["g1", "g2", "g3"],
        "sensor-crosstalk": ["x12", "x13", "x21", "x23", "x31", "x32"], "sensor-lag": ["lag"], "time-offset": ["toff"]}
UNIT = {"n": 0.2, "r1": 0.2, "hL": 5e-4, "mR": 0.2, "mL": 1e-3, "aL": 2e-4, "sD": 1e-3, "z0": 2e-4, "al": 0.2, "iA": 0.2, "iX": 5e-3, "iY": 5e-3, "iW": 5e-3,
        "C": 2e-5, "mu": 0.1, "cv": 2.0, "dmu": 0.1, "vs": 5e-3, "ell": 1e-4, "vr": 2e-3, "p": 0.1, "an": 0.1, "dm": 0.02, "lag": 5e-3, "toff": 3e-3, "aF": 0.2}
TANGENTIAL = {"coulomb-friction", "viscous-friction", "stribeck-friction", "presliding", "friction-rounding", "load-dependent-friction", "friction-anisotropy",
              "ageing", "grooves"}
TORQUE = {"tool-com", "tip-offset"}
FORCE = {"tool-mass", "sensor-bias", "sensor-drift", "sensor-misalignment", "sensor-gain", "sensor-crosstalk", "sensor-lag", "time-offset", "structural-compliance",
         "mains-hum", "quantization", "saturation"}
W6 = np.array([1, 1, 1, 30.0, 30, 30])


def scale_of(name: str, value: float) -> float:
    """Typical step of one parameter for the refits."""
    if name in UNIT:
        return UNIT[name]
    return max(0.2 * abs(value), {"k": 10.0, "c": 1.0, "lam": 0.1, "t1": 0.1, "hA": 0.1, "sK": 50.0}.get(name, 0.01))


def effect(rng: np.random.Generator, name: str, P: np.ndarray, s: float, u: dict) -> None:
    """Put the effect `name` of strength s (about 1) into P; u holds the draws of this case (depth scale `deep` [m], force `load` [N])."""
    deep, load, x = u["deep"], u["load"], u["draw"]
    table = {
        "hertz-exponent": lambda: dict(n=P[I["n"]] + 0.25 * s * u["sign"], k=u["soft"] * deep ** (1 - P[I["n"]] - 0.25 * s * u["sign"])), "viscous-damping": lambda: dict(c=0.25 * s * load / 0.05),
        "hunt-crossley-damping": lambda: dict(lam=6 * s), "hysteresis": lambda: dict(hA=0.12 * s * load, hL=deep * 0.12),
        "relaxation": lambda: dict(r1=min(0.3 * s, 0.7) * 0.8, t1=0.2 + 0.6 * x, r2=min(0.3 * s, 0.7) * 0.2, t2=3.5 * (0.2 + 0.6 * x)),
        "stress-softening": lambda: dict(mR=min(0.8, 0.3 * s), mL=deep * 0.25), "adhesion": lambda: dict(aF=0.12 * s * load, aL=3e-4 + 3e-4 * x),
        "stiffening-layer": lambda: dict(sK=1.2 * s * load / deep, sD=deep * (2.2 if u.get("buried") else 0.45 + 0.15 * x)), "surface-offset": lambda: dict(z0=0.1 * deep * s * u["sign"]),
        "stiffness-drift": lambda: dict(al=u["sign"] * min(0.3 * s / u["minutes"], 0.8 / u["minutes"])),
        "stiffness-inhomogeneity": lambda: dict(iA=min(0.35 * s, 0.9) * (u["sign"] if s < 1.5 else 1), iX=u["cx"], iY=u["cy"], iW=0.009 + 0.006 * x, iT=u["imap"]),
        "structural-compliance": lambda: dict(C=0.12 * s * deep / load), "viscous-friction": lambda: dict(cv=0.12 * s * load / 0.06),
        "stribeck-friction": lambda: dict(dmu=0.15 * s, vs=0.018 + 0.012 * x, mu=P[I["mu"]]), "presliding": lambda: dict(ell=1.2e-3 * s), "friction-rounding": lambda: dict(ft=3, vr=0.008 * s),
        "load-dependent-friction": lambda: dict(p=-0.3 * s if s < 2 else -0.6, ref=load * 0.5), "friction-anisotropy": lambda: dict(an=min(0.22 * s, 0.7) * u["sign"]),
        "tool-mass": lambda: dict(dm=0.04 * s), "tool-com": lambda: dict(cx=0.006 * s * u["sign"], cy=-0.004 * s, cz=0.006 * s), "tip-offset": lambda: dict(ox=0.0015 * s, oy=-0.001 * s * u["sign"]),
        "sensor-bias": lambda: dict(bx=0.15 * s, by=-0.1 * s, bz=0.2 * s, btx=0.004 * s), "sensor-drift": lambda: dict(dfx=0.3 * s, dfy=0.2 * s * u["sign"], dfz=-0.5 * s, dtx=0.01 * s),
        "sensor-misalignment": lambda: dict(m1=0.05 * s, m2=-0.04 * s * u["sign"], m3=0.06 * s), "sensor-gain": lambda: dict(g1=0.06 * s, g2=0.08 * s, g3=-0.05 * s),
        "sensor-crosstalk": lambda: dict(x12=0.04 * s, x13=-0.06 * s, x23=0.05 * s, x31=0.03 * s), "sensor-lag": lambda: dict(lag=0.012 * s), "time-offset": lambda: dict(toff=0.009 * s),
        "saturation": lambda: dict(sat=load * (0.75 - 0.12 * min(s - 1, 2.5))), "quantization": dict, "mains-hum": dict,
        "imprint": lambda: dict(yF=0.35 * load, yH=0.8 * s ** -1 * P[I["k"]] * deep ** (P[I["n"]] - 1)), "shear-thinning": lambda: dict(cs=0.8 * s * load * 0.3, cm=0.35),
        "puncture": lambda: dict(pD=0.62 * deep, pW=min(0.35 * s, 0.8)), "ageing": lambda: dict(age=0.12 * s, dc=8e-4), "grooves": lambda: dict(gx=min(0.3 * s, 0.6)),
    }
    for key, value in table[name]().items():
        P[I[key]] = value


@dataclass
class Motion:
    """Sensor-frame motion on samples: rotation, origin position, velocity, acceleration, angular rate and acceleration (base axes)."""
    t: np.ndarray
    R: np.ndarray
    p: np.ndarray
    v: np.ndarray
    a: np.ndarray
    om: np.ndarray
    al: np.ndarray


@dataclass
class Rig:
    """What is known beside the motion: tool mass [kg], com [m], gravity, surface point and rows (n, t1, t2)."""
    mass: float
    com: np.ndarray
    g: np.ndarray
    point: np.ndarray
    rows: np.ndarray
    r_tip: np.ndarray


def skew_apply(r: np.ndarray, f: np.ndarray) -> np.ndarray:
    """Cross product of one vector with rows."""
    return np.cross(np.broadcast_to(r, f.shape), f)


def sensor(P: np.ndarray, t: np.ndarray, f: np.ndarray, tau: np.ndarray) -> np.ndarray:
    """Sensor and acquisition chain on forces and torques (T,3): offset in time, lag, rotation, crosstalk, gain, bias, drift, clip."""
    w = np.hstack([f, tau])
    if P[I["toff"]]:
        w = np.column_stack([np.interp(t - P[I["toff"]], t, c) for c in w.T])
    if P[I["lag"]] > 1e-5:
        w = lowpass(w, 1 / (2 * np.pi * P[I["lag"]]), 1 / np.median(np.diff(t)))
    m = P[I["m1"]:I["m3"] + 1]
    if np.any(m):
        Q = pin.exp3(m).T
        w = np.hstack([w[:, :3] @ Q.T, w[:, 3:] @ Q.T])
    X = np.eye(3)
    X[[0, 0, 1, 1, 2, 2], [1, 2, 0, 2, 0, 1]] = P[I["x12"]:I["x32"] + 1]
    w[:, :3] = (w[:, :3] @ X.T) * (1 + P[I["g1"]:I["g3"] + 1])
    w = w + P[I["bx"]:I["btz"] + 1] + np.outer(t / 60, P[I["dfx"]:I["dtz"] + 1])
    return np.clip(w, -P[I["sat"]], P[I["sat"]]) if P[I["sat"]] < 1e8 else w


def wrench(P: np.ndarray, M: Motion, rig: Rig, sub: int = 2, still: float = 0.0) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Clean readings (T,6), contact forces (T,3: N, T1, T2) and depth along a motion; slip is seen behind a play of `still` [m] (encoder noise)."""
    arm = rig.r_tip + P[I["ox"]:I["oz"] + 1]
    r = M.R @ arm
    rel = (M.p + r - rig.point) @ rig.rows.T
    vel = (M.v + np.cross(M.om, r)) @ rig.rows.T
    if still and P[I["ft"]] != 3:
        vel[:, 1:] = np.column_stack(laws.play(M.t, rel[:, 1], rel[:, 2], still))
    c3 = laws.run(P, M.t, -rel[:, 0], -vel[:, 0], rel[:, 1], rel[:, 2], vel[:, 1], vel[:, 2], sub)
    com, mass = rig.com + P[I["cx"]:I["cz"] + 1], rig.mass + P[I["dm"]]
    rc = M.R @ com
    a = M.a + np.cross(M.al, rc) + np.cross(M.om, np.cross(M.om, rc))
    ft = np.einsum("tji,tj->ti", M.R, mass * (rig.g - a))
    fc = np.einsum("tji,tj->ti", M.R, c3 @ rig.rows)
    return sensor(P, M.t, fc + ft, skew_apply(com, ft) + skew_apply(arm, fc)), c3, -rel[:, 0]


def names_of(model: list[str], P: np.ndarray) -> list[str]:
    """Free parameters of a list of catalogue names."""
    return list(dict.fromkeys(n for m in model for n in FREE.get(m, []) if not (n in ("iX", "iY") and P[I["iA"]] == 0)))


def refit(model: list[str], P: np.ndarray, fn, target: np.ndarray, iters: int = 3) -> np.ndarray:
    """Residual of `target` after fitting the model's parameters from P; fn: parameters -> readings (weighted)."""
    free = names_of(model, P)

    def call(x: np.ndarray) -> np.ndarray:
        Q = P.copy()
        Q[[I[n] for n in free]] = x
        for n in ("t1", "t2", "hL", "mL", "aL", "ell", "vs", "vr", "iW", "dc"):
            Q[I[n]] = max(Q[I[n]], 2e-6)
        Q[I["lag"]] = max(Q[I["lag"]], 0.0)
        return fn(Q)
    return gauss_newton(call, P[[I[n] for n in free]], np.array([scale_of(n, P[I[n]]) for n in free]), target, iters)[1]


def without(P: np.ndarray, neutral: np.ndarray, name: str, hidden: list[str]) -> np.ndarray:
    """Parameters with one effect taken out (its own entries back to the base's)."""
    Q = P.copy()
    own = {"relaxation": ["r1", "r2"], "hysteresis": ["hA"], "stress-softening": ["mR"], "adhesion": ["aF"], "stiffening-layer": ["sK"], "stiffness-inhomogeneity": ["iA"],
           "stribeck-friction": ["dmu"], "friction-rounding": ["vr", "ft"], "imprint": ["yF", "yH"], "shear-thinning": ["cs"], "puncture": ["pD", "pW"],
           "ageing": ["age"], "grooves": ["gx"], "saturation": ["sat"]}.get(name, FREE.get(name, []))
    for key in own:
        Q[I[key]] = neutral[I[key]]
    return Q


def channels(name: str, w: np.ndarray, rows: np.ndarray, R: np.ndarray, hold: np.ndarray) -> tuple[float, str]:
    """rms of a residual (T,6; torques in N·m) in the channels that an effect is about, over samples `hold`."""
    if name in TORQUE:
        return rms(w[hold, 3:]), "N·m"
    if name in FORCE:
        return rms(w[hold, :3]), "N"
    local = np.einsum("tij,tj->ti", R, w[:, :3]) @ rows.T
    return (rms(local[hold, 1:]) if name in TANGENTIAL else rms(local[hold, 0])), "N"


def hum_or_grid(rng: np.random.Generator, name: str, s: float, t: np.ndarray, w: np.ndarray, noise: float) -> np.ndarray:
    """Add mains hum (50 Hz and third harmonic) or round to a lattice; columns are readings."""
    if name == "mains-hum":
        a = 6 * s * noise
        ph = 2 * np.pi * 50.0 * t
        return w + np.column_stack([a * (0.6 + 0.4 * (i % 3)) * (np.sin(ph + i) + 0.3 * np.sin(3 * ph + 2 * i)) * (1 if i < 3 else 0.02) for i in range(w.shape[1])])
    q = 12 * s * noise
    return np.column_stack([np.round(c / (q * (1 if i < 3 else 0.02))) * q * (1 if i < 3 else 0.02) for i, c in enumerate(w.T)])


def base_law(rng: np.random.Generator, base: str, soft: float, deep: float) -> np.ndarray:
    """Parameters of a base law that pushes soft*deep newtons at `deep` [m]."""
    P = laws.params(k=soft)
    if base in ("hertz", "hunt-crossley"):
        P[I["n"]] = 1.5
        P[I["k"]] = soft / deep ** 0.5
    if base == "kelvin-voigt":
        P[I["c"]] = soft * rng.uniform(0.01, 0.03)
    if base == "hunt-crossley":
        P[I["lam"]] = rng.uniform(0.5, 2.0)
    if base == "zener":
        P[I["r1"]], P[I["t1"]] = rng.uniform(0.25, 0.5), rng.uniform(0.2, 0.8)
    if base == "maxwell":
        P[I["r1"]], P[I["t1"]] = 1.0, rng.uniform(4, 8)
    return P


def route(rng: np.random.Generator, u: dict, free_ends: bool, one_way: bool) -> tuple[np.ndarray, np.ndarray, np.ndarray, list[tuple[float, str]]]:
    """Commanded tip path at 100 Hz: times, height/tangent coordinates (T,3) above the surface [m], tilt rotation vectors (T,3), phase marks (start, name)."""
    deep, comp = u["deep"], u["comp"]
    knots: list[tuple[float, np.ndarray, np.ndarray, str]] = []
    pos, rot, level = np.array([0.03, 0.0, 0.0]), np.zeros(3), rng.uniform(-0.08, 0.08, 3) * np.array([1, 1, 3])

    def to(p: list[float], r: np.ndarray, time: float, phase: str) -> None:
        knots.append((time, np.array(p, float), np.array(r, float), phase))
    tilts = [np.array([0.45, 0.1, 0.3]), np.array([-0.3, 0.4, -0.4]), np.array([0.1, -0.45, 0.5])]
    if free_ends:
        for r in tilts:
            to([0.05 + 0.03 * rng.random(), 0.03 * rng.standard_normal(), 0.03 * rng.standard_normal()], r, rng.uniform(0.7, 1.4), "free")
    to([0.012, 0, 0], level, 1.2, "free")
    spots = [(u["cx"], u["cy"])] + [tuple(rng.uniform(-0.018, 0.018, 2)) for _ in range(2)] + [(u["cx"], u["cy"])] + [tuple(rng.uniform(-0.018, 0.018, 2))]
    depths = deep * np.array([0.5, 1.0, 0.7, 1.0, 0.85]) * rng.uniform(0.92, 1.05, 5)
    for (x, y), d, speed in zip(spots, depths, rng.permutation([0.006, 0.015, 0.03, 0.06, 0.1])):
        c = -d * comp
        r = level + rng.uniform(-0.1, 0.1, 3) * u["retilt"]
        to([0.004, x, y], r, 0.5, "free")
        to([c, x, y], r, max(0.06, (0.004 - c) / speed), "poke")
        to([c, x, y], r, rng.uniform(0.3, 0.9), "hold")
        to([0.004, x, y], r, max(0.08, (0.004 - c) / rng.choice([0.015, 0.03, 0.07])), "retract")
    for d in (0.85 * deep, 0.4 * deep):
        c, L = -d * comp, 0.017
        to([0.004, -L, 0.0], level, 0.6, "free")
        to([c, -L, 0.0], level, 0.5, "approach")
        to([c, -L, 0.0], level, 0.3, "hold")
        for speed in rng.permutation([0.014, 0.035, 0.09] if d > 0.5 * deep else [0.025, 0.07]):
            to([c, L, 0.0], level, 2 * L / speed, "slide")
            to([c, L, 0.0], level, 0.25, "hold")
            to([c, -L, 0.0], level, 2 * L / speed, "slide")
        if not one_way:
            to([c, 0.0, 0.0], level, 0.5, "slide")
            for speed in (0.018, 0.07):
                to([c, 0.0, L], level, L / speed, "slide")
                to([c, 0.0, -L], level, 2 * L / speed, "slide")
                to([c, 0.0, 0.0], level, L / speed, "slide")
        to([0.004, knots[-1][1][1], knots[-1][1][2]], level, 0.4, "retract")
    to([0.04, 0, 0], level, 0.7, "free")
    if free_ends:
        to([0.05, 0.02, 0.02], tilts[0], 0.8, "free")
        to([0.05, -0.02, 0.0], tilts[1], 0.8, "free")
    ts, ps, rs, marks, now = [0.0, 0.4], [pos, pos], [rot, rot], [(0.0, "free")], 0.4
    for time, p, r, phase in knots:
        marks.append((now, phase))
        m = max(3, int(time / 0.01))
        s = np.arange(1, m + 1) / m
        b = min(0.35, 0.06 / time + 0.05)
        e = np.where(s < b, s * s / (2 * b * (1 - b)), np.where(s > 1 - b, 1 - (1 - s) ** 2 / (2 * b * (1 - b)), (s - b / 2) / (1 - b)))
        e = s ** 3 * (10 - 15 * s + 6 * s * s) if phase == "free" else e
        for x, si in zip(e, s):
            ts.append(now + si * m * 0.01)
            ps.append(pos + (p - pos) * x)
            rs.append(rot + (r - rot) * x)
        pos, rot, now = p, r, now + m * 0.01
    ts.append(now + 0.4), ps.append(pos), rs.append(rot)
    return np.array(ts), np.array(ps), np.array(rs), marks


def near_of(hidden: list[str], base: str) -> list[str]:
    """Catalogue names honestly alike."""
    table = {"structural-compliance": ["hertz-exponent"], "stiffening-layer": ["hertz-exponent"], "sensor-lag": ["time-offset"], "time-offset": ["sensor-lag"],
             "presliding": ["friction-rounding"], "friction-rounding": ["presliding"], "hertz-exponent": ["stiffening-layer", "structural-compliance"], "stribeck-friction": ["viscous-friction"],
             "viscous-friction": ["stribeck-friction"], "viscous-damping": ["hunt-crossley-damping"], "hunt-crossley-damping": ["viscous-damping"],
             "imprint": ["stress-softening", "hysteresis", "surface-offset"], "puncture": ["stress-softening", "stiffness-drift", "stiffness-inhomogeneity"],
             "shear-thinning": ["viscous-damping", "hunt-crossley-damping", "hysteresis", "relaxation"], "ageing": ["stribeck-friction", "presliding"],
             "grooves": ["friction-anisotropy", "sensor-crosstalk", "sensor-misalignment"]}
    return sorted({n for h in hidden for n in table.get(h, [])} - set(hidden))


def wrench_case(rng: np.random.Generator, group: str, hidden: list[str], urdf: Path, target: float) -> Case:
    """One log of an arm with a wrist sensor. target: wished effect/left ratio."""
    nuis: dict = {"robot": urdf.stem}
    calm = group in ("none", "outside", "weak")
    mass = rng.uniform(0.15, 0.35)
    com = np.array([rng.uniform(-3e-3, 3e-3), rng.uniform(-3e-3, 3e-3), rng.uniform(0.04, 0.06)])
    tilt = np.radians(rng.uniform(0, 0.2)) * np.array([np.cos(a := rng.uniform(0, 6.28)), np.sin(a), 0])
    g = pin.exp3(tilt) @ np.array([0, 0, -9.81])
    true_mass, true_com = mass * (1 + rng.uniform(-0.02, 0.02)), com * (1 + rng.uniform(-0.02, 0.02))
    arm = Arm(urdf, true_mass, true_com, g)
    deep = rng.uniform(4e-3, 7e-3)
    soft = rng.uniform(900, 3000)
    need_hertz = {"structural-compliance"} & set(hidden)
    bases = ["hertz", "hunt-crossley"] if need_hertz else ["kelvin-voigt", "hooke"] if {"hertz-exponent", "surface-offset", "stiffening-layer"} & set(hidden) else \
        ["hertz", "hooke"] if {"viscous-damping", "hunt-crossley-damping"} & set(hidden) else ["kelvin-voigt", "hunt-crossley", "hertz", "kelvin-voigt", "zener"]
    if {"relaxation", "imprint", "puncture", "shear-thinning"} & set(hidden):
        bases = ["kelvin-voigt", "hunt-crossley"]
    base = str(rng.choice(bases))
    P = base_law(rng, base, soft, deep)
    P[I["mu"]], P[I["ft"]], P[I["ell"]] = rng.uniform(0.25, 0.55), rng.choice([0, 1, 2, 4]), 1e-4
    P[I["sg"]] = 4.0 if P[I["ft"]] == 1 else 0.0
    if group != "outside" and rng.random() < 0.5:
        P[I["fu"]], nuis["material"] = 0.04 / deep, "Fung exponential, b*depth = 0.04 (below 1 % of a power law after refit)"
    model = [base, "coulomb-friction"]
    u = dict(deep=deep, soft=soft, load=soft * deep, draw=rng.random(), sign=rng.choice([-1, 1]), cx=rng.uniform(-0.01, 0.01), cy=rng.uniform(-0.008, 0.008), imap=rng.choice([0, 0, 1, 2]),
             retilt=1.0, minutes=0.55, buried=group == "unexcited")
    if rng.random() < 0.45 and group != "outside":
        extra = str(rng.choice(["relaxation", "viscous-friction", "sensor-bias", "presliding", "stribeck-friction"]))
        clash = {"relaxation", "zener"} & {base, *hidden} if extra == "relaxation" else {extra, "friction-rounding", "presliding"} & set(hidden) | ({"stribeck-friction", "viscous-friction"} & set(hidden) if "friction" in extra else set())
        if not clash:
            effect(rng, extra, P, 0.8 if extra != "presliding" else 0.3, u)
            model.append(extra)
    if "friction-rounding" not in hidden and "presliding" not in hidden + model and rng.random() < 0.25 and group != "outside" and P[I["dmu"]] == 0 and not set(hidden) & TANGENTIAL:
        P[I["ft"]], P[I["vr"]] = 3, 2e-3
        model.append("friction-rounding")
    if "presliding" in hidden:
        P[I["ft"]] = rng.choice([0, 1])
    nuis["friction"] = ["Dahl", "LuGre", "Dupont", "rounded", "Prandtl"][int(P[I["ft"]])]
    neutral = P.copy()
    rows = np.array([[0, 0, 1.0], [1, 0, 0], [0, 1, 0]])
    Rz = pin.exp3(np.array([0, 0, rng.uniform(-0.5, 0.5)]))
    rows = rows @ Rz.T
    point = np.array([0.45 if urdf.stem == "panda" else 0.42 if urdf.stem == "ur5" else 0.65, 0.1 * rng.standard_normal(), 0.12])
    stiff = rng.choice([0.6, 1.0, 1.8])
    kp = stiff * (np.array([3500, 3500, 2500, 2500, 900, 900, 700.]) if arm.n == 7 else np.array([4000, 4000, 3000, 1200, 1000, 800.]))
    down = pin.exp3(np.array([np.pi, 0, 0]))
    q = arm.ik(arm.home, pin.SE3(down, point), 400)
    pin.computeJointJacobians(arm.model, arm.data, q)
    J = pin.getFrameJacobian(arm.model, arm.data, arm.tip, pin.LOCAL_WORLD_ALIGNED)[:3]
    flex = arm.drive * (rng.uniform(0.2, 0.3) if need_hertz else 1.0)
    C = rows[0] @ (J / (kp if not need_hertz else 1 / (1 / kp ))) @ J.T @ rows[0]
    u["comp"] = 1 + soft * C
    nuis.update(joint_stiffness=float(kp[0]), drive_stiffness=float(flex[0]))
    s = 1.0
    for h in hidden:
        effect(rng, h, P, s, u)
    free_ends = bool(set(hidden) & (FORCE | TORQUE)) or rng.random() < 0.7
    times, path, rot, marks = route(rng, u, free_ends, False)
    qc = []
    for p, r in zip(path, rot):
        q = arm.ik(q, pin.SE3(down @ pin.exp3(r), point + p @ rows), 8 if qc else 200)
        qc.append(q)
    zoff = rng.uniform(-2e-5, 2e-5)
    P[I["z0"]] += zoff
    body = P.copy()
    body[I["C"]] = 0.0
    t, ql, th = arm.simulate(times, np.array(qc), kp, rng.uniform(0.5, 0.9), np.full(arm.n, 0.4), flex, (body, point, rows))
    if need_hertz:
        th = th - np.array([pin.computeGeneralizedGravity(arm.model, arm.data, q).copy() for q in th]) / flex
        P[I["C"]] = 0.0
    real, seen = CubicSpline(t, ql), CubicSpline(t, th if need_hertz else ql)
    rig_true = Rig(true_mass, true_com, g, point, rows, arm.r_tip)
    rig_user = Rig(mass, com, np.array([0, 0, -9.81]), point, rows, arm.r_tip)
    M = Motion(t, *arm.frames(real(t), real(t, 1), real(t, 2)))
    if need_hertz:
        Cn = float(rows[0] @ (J / flex) @ J.T @ rows[0])
        nuis["compliance_m_per_N"] = Cn
        M2 = Motion(t, *arm.frames(seen(t), seen(t, 1), seen(t, 2)))
    dec = slice(None, None, 3)
    Md = Motion(*[getattr(M if not need_hertz else M2, f)[dec] for f in ("t", "R", "p", "v", "a", "om", "al")])
    rate = float(rng.choice([250, 500, 500, 1000]))
    if {"mains-hum"} & set(hidden):
        rate = max(rate, 500.0)
    tl = clock(rng, t[-1], rate, nuis)
    step = float(10 ** rng.uniform(-5.7, -5.2 if calm else -4.8))
    qn = encoder(rng, seen(tl), step, nuis)
    dq = rates(rng, seen(tl, 1), rate, nuis)
    noise = float(rng.uniform(0.01, 0.025 if calm else 0.04))
    nt, nl = float(rng.uniform(3e-4, 8e-4)), float(rng.uniform(0, 0.003 if group == "none" else 0.006))
    skew = float(rng.uniform(-2e-4, 2e-4))
    drift = rng.uniform(-0.4, 0.4, 6) * np.array([noise] * 3 + [nt] * 3)
    draws = rng.standard_normal((len(tl), 6)) * np.array([noise] * 3 + [nt] * 3)
    nuis.update(force_noise=noise, torque_noise=nt, nonlinearity=nl, clock_offset=skew, tilt_deg=float(np.degrees(np.linalg.norm(tilt))), tool_mass_error=true_mass / mass - 1, surface_error=zoff, drift_over_log=float(abs(drift[0])))
    ql_s = smooth(tl, qn, 60.0)
    grid = ql_s.x[::max(1, round(rate / 400))]
    Mu = Motion(grid, *arm.frames(ql_s(grid), ql_s(grid, 1), ql_s(grid, 2)))

    def measure(PP: np.ndarray, strength: float) -> np.ndarray:
        w = wrench(PP, M, rig_true)[0]
        w = w * (1 + nl * (w / np.abs(w).max(axis=0)) ** 2 - nl / 2)
        w = np.column_stack([np.interp(tl - skew, t, c) for c in w.T]) + np.outer(tl / tl[-1], drift) + draws
        for h in hidden:
            if h in ("mains-hum", "quantization"):
                w = hum_or_grid(rng, h, strength, tl, w, noise)
        return np.clip(w, -PP[I["sat"]], PP[I["sat"]]) if PP[I["sat"]] < 1e8 else w

    chan = hidden[0] if hidden else "sensor-gain"
    touch_d = -(Md.p + Md.R @ arm.r_tip - point) @ rows[0] > -2e-5
    touch_u = -(Mu.p + Mu.R @ arm.r_tip - point) @ rows[0] > -2e-5
    everything = bool(set(hidden) & (FORCE | TORQUE)) and not need_hertz
    hold_d, hold_u = (np.ones_like(touch_d), np.ones_like(touch_u)) if everything else (touch_d, touch_u)
    known = [h for h in hidden if h in FREE]

    def assess(PP: np.ndarray, strength: float) -> tuple[list[float], list[float], np.ndarray]:
        w = measure(PP, strength)
        wu = np.column_stack([np.interp(grid, tl, c) for c in w.T])
        start = PP.copy()
        if need_hertz:
            start[I["C"]] = Cn
        start[I["z0"]] -= zoff
        if "mains-hum" in hidden or "quantization" in hidden:
            left = rms(draws[:, :3])
            return [rms((w - measure_clean(PP))[:, :3])], [left], w
        fit = refit(model + known, start, lambda Q: wrench(Q, Mu, rig_user, 3, 3e-6 + 0.2 * step)[0] * W6, wu * W6) / W6
        clean = wrench(PP, Motion(t, M.R, M.p, M.v, M.a, M.om, M.al), rig_true)[0][dec]
        es, ls = [], []
        for h in (hidden or [None]):
            ls.append(channels(h or chan, fit, rows, Mu.R, hold_u)[0])
            if h is None:
                es.append(0.0)
                continue
            off = without(start, neutral, h, hidden)
            r = refit([m for m in model + known if m != h], off, lambda Q: wrench(Q, Md, rig_true)[0] * W6, clean * W6) / W6
            es.append(channels(h, r, rows, Md.R, hold_d)[0])
        return es, ls, w

    def measure_clean(PP: np.ndarray) -> np.ndarray:
        w = wrench(PP, M, rig_true)[0]
        w = w * (1 + nl * (w / np.abs(w).max(axis=0)) ** 2 - nl / 2)
        return np.column_stack([np.interp(tl - skew, t, c) for c in w.T]) + np.outer(tl / tl[-1], drift) + draws

    es, ls, w = assess(P, s)
    for _ in range(4):
        ratio = min(e / l for e, l in zip(es, ls)) if hidden else 0
        grow = wanted(group, ratio, target, es[int(np.argmin([e / l for e, l in zip(es, ls)]))] / rms(w[:, 3:] if chan in TORQUE else w[np.interp(tl, Md.t, touch_d) > 0.5, :3]))
        if grow == 1.0 or need_hertz:
            break
        s = float(np.clip(s * grow, 0.05, 2.2))
        for h in hidden:
            PP = without(P, neutral, h, hidden)
            P[:] = PP
            P[I["z0"]] = zoff if "surface-offset" not in hidden else P[I["z0"]]
            effect(rng, h, P, s, u)
            if h == "surface-offset":
                P[I["z0"]] += zoff
        es, ls, w = assess(P, s)
    c3, depth = wrench(P, M, rig_true)[1:]
    names = ["fx", "fy", "fz", "tx", "ty", "tz"]
    cols: dict[str, np.ndarray] = {"t": tl, **{f"q{i + 1}": qn[:, i] for i in range(arm.n)}}
    if dq is not None:
        cols.update({f"dq{i + 1}": dq[:, i] for i in range(arm.n)})
    cols.update({n: w[:, i] for i, n in enumerate(names)})
    if rng.random() < 0.6:
        starts = np.array([m[0] for m in marks])
        cols["phase"] = np.array([marks[i][1] for i in np.clip(np.searchsorted(starts, tl, "right") - 1, 0, None)])
    unit = "N·m" if chan in TORQUE else "N"
    joints = ", ".join(f'"{n}"' for n in list(arm.model.names)[1:])
    vec = lambda v: "[" + ", ".join(f"{x:.6g}" for x in v) + "]"
    rig = f"""[robot]
model = "{urdf.name}"
sensor_frame = "ft_sensor"
tip_frame = "tool_tip"
joints = [{joints}]

[tool]
mass = {mass:.5f}
com = {vec(com)}

[surface]
point = {vec(point)}
normal = [0, 0, 1]
tangent = {vec(rows[1])}

[sensor]
range = [{', '.join([f'{PP_range(P, c3):.0f}'] * 3)}, 2, 2, 2]
noise = {vec([noise] * 3 + [nt] * 3)}
"""
    weight = rms(w[np.interp(tl, t, depth) > 0, :3])
    notes = f"strength {s:.2f}; per effect effect/left {[round(e / l, 2) for e, l in zip(es, ls)] if hidden else '-'}; readings rms in contact {weight:.2f} N; peak N {c3[:, 0].max():.1f}"
    if need_hertz:
        notes += "; joints logged on the motor side of elastic drives"
    out_hidden = hidden
    i = int(np.argmin([e / l for e, l in zip(es, ls)]))
    return Case("wrench", group, model, out_hidden, near_of(hidden, base), es[i], ls[i], "N·m" if (hidden and hidden[i] in TORQUE) else unit if not hidden else "N", nuis, notes, cols, rig, urdf,
                extra={"readings_rms": weight})


def PP_range(P: np.ndarray, c3: np.ndarray) -> float:
    """Sensor range written in the rig [N]: above the peak, or the clip level where the sensor saturates."""
    return float(P[I["sat"]]) if P[I["sat"]] < 1e8 else float(np.ceil(c3[:, 0].max() / 20 + 1) * 20)


def tester_case(rng: np.random.Generator, group: str, hidden: list[str], target: float, long: bool = False) -> Case:
    """Single-axis tester: depth and force of a crosshead with a second-order position servo."""
    nuis: dict = {"machine": "crosshead"}
    deep, soft = rng.uniform(2e-3, 5e-3), rng.uniform(800, 6000)
    h0 = set(hidden)
    bases = ["hertz"] if h0 & {"structural-compliance", "viscous-damping", "hunt-crossley-damping"} else ["hooke", "kelvin-voigt"] if h0 & {"hertz-exponent", "stiffening-layer", "surface-offset"} else \
        ["kelvin-voigt", "hunt-crossley", "hertz"] if h0 & {"relaxation", "imprint", "puncture", "shear-thinning"} else ["kelvin-voigt", "hunt-crossley", "zener", "hertz", "maxwell"]
    base = str(rng.choice(bases))
    P = base_law(rng, base, soft, deep)
    model = [base]
    u = dict(deep=deep, soft=soft, load=soft * deep, draw=rng.random(), sign=rng.choice([-1, 1]), cx=0.0, cy=0.0, imap=0, minutes=3.0 if long else 0.5)
    if rng.random() < 0.5 and base in ("kelvin-voigt", "hunt-crossley", "hertz") and "relaxation" not in hidden and group != "outside":
        effect(rng, "relaxation", P, 0.8, u)
        model.append("relaxation")
    neutral = P.copy()
    rate = float(rng.choice([50, 100]) if long else rng.choice([100, 200, 500, 1000, 2000]))
    if h0 & {"mains-hum", "sensor-lag", "time-offset", "hunt-crossley-damping", "viscous-damping"}:
        rate = max(rate, 500.0)
    cmd, knots = [], [(0.5, -1.0)]
    count = 24 if long else 7
    lev = deep * np.resize(rng.permutation([0.4, 0.6, 0.8, 1.0]), count) * rng.uniform(0.95, 1.05, count)
    if h0 & {"stress-softening", "imprint", "puncture"}:
        lev = deep * np.array([0.4, 0.4, 0.7, 0.4, 1.0, 0.7, 1.0])
    top = 1.2e-4 * rate
    now, depth = 0.0, -1e-3
    tt, dd = [0.0], [depth]

    def move(to: float, time: float) -> None:
        nonlocal now, depth
        now, depth = now + time, to
        tt.append(now), dd.append(to)
    move(depth, 0.6)
    for i, d in enumerate(lev):
        speed = [0.002, 0.01, 0.04, 0.1][int(rng.integers(0, 4))] if i > 3 else [0.01, 0.003, 0.05, 0.1][i]
        speed = min(speed, top)
        move(d, (d + 1e-3) / speed)
        move(d, rng.uniform(0.6, 2.0) * (3 if long else 1))
        move(-1e-3, (d + 1e-3) / min(top, rng.choice([0.003, 0.01, 0.05])))
        move(-1e-3, 0.3 if not long else 1.0)
    H = 5e-4 if not long else 2e-3
    t = np.arange(0, now, H)
    om, ze = rng.uniform(60, 120), rng.uniform(0.8, 1.0)
    (b, a, _) = cont2discrete(([om * om], [1, 2 * ze * om, om * om]), H)
    x = lfilter(b.ravel(), a, np.interp(t, tt, dd) + 1e-3) - 1e-3
    pos = CubicSpline(t, x)
    zoff = rng.uniform(-1e-5, 1e-5)
    noise = float(u["load"] * 10 ** rng.uniform(-3.1, -2.4))
    nl = float(rng.uniform(0, 0.003))
    tl = clock(rng, t[-1], rate, nuis)
    step = float(rng.choice([1e-7, 5e-7, 1e-6]))
    dl = np.round((pos(tl) + rng.normal(0, step, len(tl))) / step) * step
    drift, draws = rng.uniform(-0.4, 0.4) * noise, rng.standard_normal(len(tl)) * noise
    skew = float(rng.uniform(-2e-4, 2e-4)) if rate >= 500 else 0.0
    nuis.update(force_noise=noise, nonlinearity=nl, depth_step=step, clock_offset=skew, surface_error=zoff)
    sm = smooth(tl, dl[:, None], 40.0)
    grid = sm.x
    du, dru = sm(grid)[:, 0], sm(grid, 1)[:, 0]
    if "hysteresis" in hidden:
        dru = laws.play(grid, du, np.zeros(len(grid)), 3 * step)[0]
    zero = np.zeros

    def force(PP: np.ndarray, ts: np.ndarray, d: np.ndarray, dr: np.ndarray, sub: int) -> np.ndarray:
        z = zero(len(ts))
        n = laws.run(PP, ts, d, dr, z, z, z, z, sub)[:, 0]
        f = np.column_stack([z, z, n])
        return sensor(PP, ts, f, zero((len(ts), 3)))[:, 2:3]

    def read(PP: np.ndarray, strength: float) -> np.ndarray:
        w = force(PP, t, x, pos(t, 1), 1)
        w = w * (1 + nl * (w / u["load"]) ** 2 - nl / 2)
        w = np.interp(tl - skew, t, w[:, 0]) + drift * tl / tl[-1] + draws
        for h in h0 & {"mains-hum", "quantization"}:
            w = hum_or_grid(rng, h, strength, tl, w[:, None], noise)[:, 0]
        return np.clip(w, -1e9, PP[I["sat"]])
    known = [h for h in hidden if h in FREE]
    dec = max(1, round(1 / (H * 500)))
    hold_u, hold_c = du > 0, (x > 0)[::dec]

    def assess(PP: np.ndarray, strength: float) -> tuple[list[float], list[float], np.ndarray]:
        w = read(PP, strength)
        if h0 & {"mains-hum", "quantization"}:
            return [rms(w - read_clean(PP))], [rms(draws)], w
        start = PP.copy()
        start[I["z0"]] -= zoff
        sub = max(2, int(np.ceil(1000 / rate)))
        fit = refit(model + known, start, lambda Q: force(Q, grid, du, dru, sub), np.interp(grid, tl, w)[:, None], 4)
        clean = force(PP, t, x, pos(t, 1), 1)[::dec]
        es = []
        for h in hidden or []:
            off = without(start, neutral, h, hidden)
            r = refit([m for m in model + known if m != h], off, lambda Q: force(Q, t, x, pos(t, 1), 1)[::dec], clean, 4)
            es.append(rms(r[hold_c]))
        left = rms(fit[hold_u])
        return es or [0.0], [left] * max(1, len(es)), w

    def read_clean(PP: np.ndarray) -> np.ndarray:
        w = force(PP, t, x, pos(t, 1), 1)
        w = w * (1 + nl * (w / u["load"]) ** 2 - nl / 2)
        return np.interp(tl - skew, t, w[:, 0]) + drift * tl / tl[-1] + draws
    s = 1.0
    for _ in range(5):
        P[:] = neutral
        P[I["z0"]] = zoff
        for h in hidden:
            effect(rng, h, P, s, u)
            if h == "surface-offset":
                P[I["z0"]] += zoff
        es, ls, w = assess(P, s)
        ratio = min(e / l for e, l in zip(es, ls))
        grow = wanted(group, ratio, target, min(es) / rms(w[dl > 0]))
        if grow == 1.0:
            break
        s = float(np.clip(s * grow, 0.015, 2.5))
    cols = {"t": tl, "depth": dl, "normal_force": w}
    i = int(np.argmin([e / l for e, l in zip(es, ls)]))
    weight = rms(w[dl > 0])
    rig = f"# single-axis material tester: load cell of {max(50, np.ceil(u['load'] / 25) * 50):.0f} N, noise {noise:.3g} N; depth from the crosshead encoder; no robot\n"
    notes = f"strength {s:.2f}; effect/left {[round(e / l, 2) for e, l in zip(es, ls)] if hidden else '-'}; readings rms in contact {weight:.2f} N"
    fmt = str(rng.choice(["parquet", "csv", "npz"])) if not long else "parquet"
    return Case("tester", group, model, hidden, near_of(hidden, base), es[i], ls[i], "N", nuis, notes, cols, rig, None, fmt, {"readings_rms": weight})
