"""Contact laws of the elastic half-space and the wrench chain from executed motion to sensor readings.

All units SI. Normal law: spherical indenter on a half-space (Sneddon's series over Hertz) or Boussinesq punch (n = 1),
Prony relaxation of the elastic force integrated exactly for each step (Fung's quasi-linear viscoelasticity), Kelvin-Voigt and
Hunt-Crossley damping, Ogden-Roxburgh softening, Bouc-Wen loop, DMT adhesion with a Dugdale tail. Tangential: Dahl/LuGre bristles
integrated exactly over the path, Prandtl, Iwan/Mindlin partial slip, rounded Coulomb.
"""
from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numba import njit
from scipy.optimize import least_squares
from scipy.signal import lfilter

NAMES: list[str] = (
    "K N XR C LAM R1 T1 R2 T2 HA HL MR ML AF AL LK LB Z0 KD IA IX IW EA EX EW MU MB FT VR CV SM SV LP AN CS "  # contact (35)
    "RI RS PT PL "                                                                  # run-in of friction, puncture (outside effects)
    "DM CX CY CZ TX TY TZ B0 B1 B2 B3 B4 B5 D0 D1 D2 G X02 X12 X20 M0 M1 M2 LAG TOFF SAT HUM HPH CAB").split()
I: dict[str, int] = {n: i for i, n in enumerate(NAMES)}
(K, N_, XR, C, LAM, R1, T1, R2, T2, HA, HL, MR, ML, AF, AL, LK, LB, Z0, KD, IA, IX, IW, EA, EX, EW, MU, MB, FT, VR, CV, SM, SV, LP,
 AN, CS, RI, RS, PT, PL) = range(39)
LOAD_REF = 3.0  # N, reference load of load-dependent friction

# free parameters by catalogue name, with sizes (for finite differences) used in refits; first one of an effect = its amplitude
FREE: dict[str, list[str]] = {
    "hooke": ["K"], "kelvin-voigt": ["K", "C"], "hertz": ["K"], "hunt-crossley": ["K", "LAM", "N"], "zener": ["K", "R1", "T1"],
    "none": [], "hertz-exponent": ["N"], "viscous-damping": ["C"], "hunt-crossley-damping": ["LAM"], "relaxation": ["R1", "T1"],
    "hysteresis": ["HA", "HL"], "stress-softening": ["MR", "ML"], "adhesion": ["AF", "AL"], "stiffening-layer": ["LK", "LB"],
    "surface-offset": ["Z0"], "stiffness-drift": ["KD"], "stiffness-inhomogeneity": ["IA", "IX", "IW", "EA", "EX", "EW"],
    "coulomb-friction": ["MU"], "viscous-friction": ["CV"], "stribeck-friction": ["SM", "SV"], "presliding": ["MB"],
    "friction-rounding": ["VR"], "load-dependent-friction": ["LP"], "friction-anisotropy": ["AN"], "tool-mass": ["DM"],
    "tool-com": ["CX", "CY", "CZ"], "tip-offset": ["TX", "TY", "TZ"], "structural-compliance": ["CS"],
    "sensor-bias": ["B0", "B1", "B2", "B3", "B4", "B5"], "sensor-drift": ["D0", "D1", "D2"], "sensor-gain": ["G"],
    "sensor-crosstalk": ["X02", "X12", "X20"], "sensor-misalignment": ["M0", "M1", "M2"], "sensor-lag": ["LAG"],
    "time-offset": ["TOFF"], "saturation": ["SAT"], "mains-hum": ["HUM", "HPH"]}
AMPLITUDES: dict[str, list[str]] = {"stiffness-inhomogeneity": ["IA", "EA"], "mains-hum": ["HUM"], "tool-com": ["CX", "CY", "CZ"],
                                    "tip-offset": ["TX", "TY", "TZ"], "sensor-bias": ["B0", "B1", "B2", "B3", "B4", "B5"],
                                    "sensor-drift": ["D0", "D1", "D2"], "sensor-crosstalk": ["X02", "X12", "X20"]}
TYPICAL: dict[str, float] = {"K": 1e3, "C": 10, "LAM": 0.3, "N": 1, "R1": 0.3, "T1": 0.5, "HA": 0.3, "HL": 5e-4, "MR": 0.2, "ML": 1e-3,
    "AF": 0.2, "AL": 5e-4, "LK": 1e3, "LB": 2e-3, "Z0": 2e-4, "KD": 0.1, "IA": 0.2, "IX": 0.02, "IW": 0.01, "EA": 0.2, "EX": 0.02,
    "EW": 5e-3, "MU": 0.3, "CV": 5, "SM": 0.1, "SV": 5e-3, "MB": 5e-4, "VR": 3e-3, "LP": 0.2, "AN": 0.2, "CS": 5e-5, "DM": 0.02, "CX": 3e-3,
    "CY": 3e-3, "CZ": 3e-3, "TX": 2e-3, "TY": 2e-3, "TZ": 2e-3, "B0": .2, "B1": .2, "B2": .2, "B3": .01, "B4": .01, "B5": .01, "D0": .2,
    "D1": .2, "D2": .2, "G": .05, "X02": .03, "X12": .03, "X20": .03, "M0": .03, "M1": .03, "M2": .03, "LAG": .01, "TOFF": .01,
    "SAT": 5, "HUM": .2, "HPH": 1}
DEFAULT: dict[str, float] = {"N": 1.0, "T1": 0.5, "T2": 3.0, "HL": 5e-4, "ML": 1e-3, "AL": 5e-4, "LB": 2e-3, "IW": 0.01, "EW": 5e-3,
                             "MB": 1e-4, "VR": 3e-3, "SV": 5e-3, "RS": 0.3, "PT": 1e9, "SAT": 1e9}
BASE_N: dict[str, float] = {"hertz": 1.5, "hunt-crossley": 1.5}


def theta(**kw: float) -> np.ndarray:
    """Parameter vector of the whole chain (SI), neutral where not given."""
    th = np.zeros(len(NAMES))
    for k, v in {**DEFAULT, **kw}.items():
        th[I[k]] = v
    return th


def neutral(th: np.ndarray, effect: str, base: str) -> np.ndarray:
    """The parameter vector with one effect taken out."""
    out = th.copy()
    for p in AMPLITUDES.get(effect, FREE[effect][:1]):
        out[I[p]] = BASE_N.get(base, 1.0) if p == "N" else DEFAULT.get(p, 0.0) if p in ("MB", "SAT") else 0.0
    return out


@njit(cache=True)
def normal_step(x: float, xd: float, t: float, s1: float, dt: float, st: np.ndarray, P: np.ndarray, commit: bool) -> float:
    """Normal force [N] at depth x [m], rate xd [m/s]; state st: q1, q2, fe, z, x, xmax, touched."""
    xe = max(x, 0.0)
    g = P[K] * (1 + P[KD] * t / 60)
    if P[IA] != 0.0:
        g *= 1 + P[IA] * math.exp(-0.5 * ((s1 - P[IX]) / P[IW]) ** 2)
    if P[EA] != 0.0:
        g *= 1 + 0.5 * P[EA] * (1 + math.tanh((s1 - P[EX]) / P[EW]))
    if t > P[PT]:
        g *= 1 - P[PL]
    r = xe * P[XR]
    fe = g * xe ** P[N_] * (1 - 0.1 * r - r * r / 840.0)
    if P[LK] != 0.0:
        w = 4e-5
        u = (xe - P[LB]) / w
        fe += P[LK] * (xe - P[LB] if u > 30 else w * math.log1p(math.exp(u)) if u > -30 else 0.0)
    xm = max(st[5], xe)
    if P[MR] != 0.0:
        m = P[N_] + 1
        wm = xm ** m
        fe *= 1 - P[MR] * math.erf((wm - xe ** m) / (P[ML] ** m + 0.25 * wm))
    f = fe
    q1 = q2 = 0.0
    if dt > 0:
        e1 = math.exp(-dt / P[T1])
        q1 = st[0] * e1 + (fe - st[2]) * P[T1] / dt * (1 - e1)
        e2 = math.exp(-dt / P[T2])
        q2 = st[1] * e2 + (fe - st[2]) * P[T2] / dt * (1 - e2)
        f += P[R1] * q1 + P[R2] * q2
    z = 0.0
    if x > 0:
        f += P[C] * xd + P[LAM] * fe * xd
        if P[HA] != 0.0:
            z = st[3]
            dx = x - max(st[4], 0.0)
            for _ in range(4):
                z += 0.25 * dx / P[HL] * (1 - abs(z) ** 1.5 if dx * z > 0 else 1.0)
            z = min(1.0, max(-1.0, z))
            f += P[HA] * z
        f = max(f, 0.0)
    else:
        f = 0.0
    touched = st[6]
    if x > 0:
        touched = 1.0
    elif x < -P[AL]:
        touched = 0.0
    if touched > 0 and P[AF] != 0.0:
        f -= P[AF] * (1.0 if x > 0 else 1 + x / P[AL])
    if commit:
        st[0], st[1], st[2], st[3], st[4], st[5], st[6] = q1, q2, fe, z, x, xm, touched
    return f


@njit(cache=True)
def contact(t: np.ndarray, d: np.ndarray, dd: np.ndarray, s: np.ndarray, v: np.ndarray, P: np.ndarray) -> np.ndarray:
    """Forces (n, 3) [N]: normal, tangential 1 and 2 (of the material on the tool)."""
    n = len(t)
    out = np.zeros((n, 3))
    st = np.zeros(7)
    st[4] = d[0]
    z = np.zeros((5, 2))
    travel = 0.0
    prev = 0.0
    for k in range(n):
        dt = t[k] - t[k - 1] if k > 0 else 0.0
        x, xd = d[k] + P[Z0], dd[k]
        if P[CS] > 0.0 and x > 0.0 and dt > 0:
            lo, hi = 0.0, 200.0
            for _ in range(45):
                mid = 0.5 * (lo + hi)
                if normal_step(x - P[CS] * mid, xd - P[CS] * (mid - prev) / dt, t[k], s[k, 0], dt, st, P, False) > mid:
                    lo = mid
                else:
                    hi = mid
            x, xd = x - P[CS] * lo, xd - P[CS] * (lo - prev) / dt
        f = normal_step(x, xd, t[k], s[k, 0], dt, st, P, True)
        prev = f
        out[k, 0] = f
        load = max(f, 0.0)
        if x <= 0.0 or k == 0:
            z[:] = 0.0
            continue
        dx, dy = s[k, 0] - s[k - 1, 0], s[k, 1] - s[k - 1, 1]
        path = math.sqrt(dx * dx + dy * dy)
        speed = math.sqrt(v[k, 0] ** 2 + v[k, 1] ** 2)
        travel += path
        mu = P[MU]
        if P[SM] != 0.0:
            mu += P[SM] * math.exp(-(speed / P[SV]) ** 2)
        if P[RI] != 0.0:
            mu *= 1 + P[RI] * math.exp(-travel / P[RS])
        if P[LP] != 0.0:
            mu *= (max(load, 0.05) / 3.0) ** P[LP]
        a1 = a2 = 0.0
        if P[FT] == 2.0:                       # rounded
            h = math.sqrt(speed * speed + P[VR] ** 2)
            a1, a2 = v[k, 0] / h, v[k, 1] / h
        elif P[FT] == 0.0:                     # Dahl, exact over the step
            if path > 0:
                e = math.exp(-path / P[MB])
                z[0, 0] = dx / path + (z[0, 0] - dx / path) * e
                z[0, 1] = dy / path + (z[0, 1] - dy / path) * e
            a1, a2 = z[0, 0], z[0, 1]
        else:                                  # Prandtl (one element) or Iwan/Mindlin (five)
            m = 1 if P[FT] == 1.0 else 5
            for j in range(m):
                ell = P[MB] * (1.0 if m == 1 else 2.0 * (j + 0.5) / m)
                z[j, 0] += dx / ell
                z[j, 1] += dy / ell
                h = math.sqrt(z[j, 0] ** 2 + z[j, 1] ** 2)
                if h > 1:
                    z[j, 0] /= h
                    z[j, 1] /= h
                a1 += z[j, 0] / m
                a2 += z[j, 1] / m
        out[k, 1] = -mu * (1 + P[AN]) * load * a1 - P[CV] * v[k, 0]
        out[k, 2] = -mu * (1 - P[AN]) * load * a2 - P[CV] * v[k, 1]
    return out


@dataclass(frozen=True)
class Env:
    """Rig as known (or as it truly is): surface, gravity (base frame), tool (sensor frame), tip (sensor frame)."""
    point: np.ndarray
    normal: np.ndarray
    t1: np.ndarray
    gravity: np.ndarray
    mass: float
    com: np.ndarray
    tip: np.ndarray

    @property
    def t2(self) -> np.ndarray:
        return np.cross(self.normal, self.t1)


@dataclass(frozen=True)
class Motion:
    """Motion of the sensor frame: t (n), R (n,3,3), p, v, a (n,3), w, al (n,3; base axes)."""
    t: np.ndarray
    R: np.ndarray
    p: np.ndarray
    v: np.ndarray
    a: np.ndarray
    w: np.ndarray
    al: np.ndarray

    def every(self, m: int) -> "Motion":
        return replace(self, **{k: getattr(self, k)[::m] for k in ("t", "R", "p", "v", "a", "w", "al")})


@dataclass(frozen=True)
class Press:
    """Motion of a tester: t [s], depth [m], rate [m/s]."""
    t: np.ndarray
    depth: np.ndarray
    rate: np.ndarray

    def every(self, m: int) -> "Press":
        return Press(self.t[::m], self.depth[::m], self.rate[::m])


def rotvec(r: np.ndarray) -> np.ndarray:
    """Rotation matrix of a rotation vector [rad]."""
    a = float(np.linalg.norm(r))
    S = np.array([[0, -r[2], r[1]], [r[2], 0, -r[0]], [-r[1], r[0], 0]])
    return np.eye(3) if a < 1e-12 else np.eye(3) + math.sin(a) / a * S + (1 - math.cos(a)) / a**2 * S @ S


def back(R: np.ndarray, x: np.ndarray) -> np.ndarray:
    return np.einsum("nji,nj->ni", R, x)


def chain(y: np.ndarray, t: np.ndarray, th: np.ndarray) -> np.ndarray:
    """Sensor behind the physics: lag, clock, bias, drift, hum, clip. y (n, channels)."""
    if th[I["LAG"]] > 0:
        e = math.exp(-float(np.median(np.diff(t))) / th[I["LAG"]])
        y = np.stack([lfilter([1 - e], [1, -e], c, zi=[e * c[0]])[0] for c in y.T], 1)
    if th[I["TOFF"]] != 0:
        y = np.stack([np.interp(t - th[I["TOFF"]], t, c) for c in y.T], 1)
    n = y.shape[1]
    b = th[[I[f"B{i}"] for i in range(6)]] if n == 6 else th[[I["B0"]]]
    y = y + b
    d = th[[I["D0"], I["D1"], I["D2"]]] if n == 6 else th[[I["D0"]]]
    y[:, :len(d)] += d * t[:, None] / 60
    if th[I["HUM"]] != 0:
        y[:, min(2, n - 1)] += th[I["HUM"]] * np.sin(2 * np.pi * 50 * t + th[I["HPH"]])
    if th[I["SAT"]] < 1e8:
        j = min(2, n - 1)
        y[:, j] = np.clip(y[:, j], -th[I["SAT"]], th[I["SAT"]])
    return y


def contact_frame(m: Motion, th: np.ndarray, env: Env) -> tuple[np.ndarray, ...]:
    """depth, depth rate, slips (n,2), slip rates (n,2), tip vector in base axes (n,3)."""
    r = m.R @ (env.tip + th[[I["TX"], I["TY"], I["TZ"]]])
    x, v = m.p + r - env.point, m.v + np.cross(m.w, r)
    tt = np.stack([env.t1, env.t2], 1)
    return -(x @ env.normal), -(v @ env.normal), x @ tt, v @ tt, r


def predict(m: Motion | Press, th: np.ndarray, env: Env | None) -> tuple[np.ndarray, np.ndarray]:
    """Readings (n, 6) [N, N·m] in the sensor frame (tester: (n, 1) [N]) and contact forces (n, 3)."""
    if isinstance(m, Press):
        zero = np.zeros((len(m.t), 2))
        fc = contact(m.t, m.depth, m.rate, zero, zero, th[:39])
        return chain(fc[:, :1] * (1 + th[I["G"]]), m.t, th), fc
    d, dd, s, v, r = contact_frame(m, th, env)
    fc = contact(m.t, d, dd, np.ascontiguousarray(s), np.ascontiguousarray(v), th[:39])
    F = fc @ np.stack([env.normal, env.t1, env.t2])
    if th[I["CAB"]] != 0:                       # umbilical hose: stretches from an anchor beside the place (outside effect)
        e = m.p - (env.point + 0.25 * env.normal - 0.12 * env.t1)
        length = np.linalg.norm(e, axis=1, keepdims=True)
        F = F - th[I["CAB"]] * np.maximum(length - 0.14, 0) * e / length
    com = env.com + th[[I["CX"], I["CY"], I["CZ"]]]
    mass = env.mass + th[I["DM"]]
    rc = m.R @ com
    acc = m.a + np.cross(m.al, rc) + np.cross(m.w, np.cross(m.w, rc))
    tool = back(m.R, mass * (env.gravity - acc))
    Fs = back(m.R, F)
    f, tau = Fs + tool, np.cross(com, tool) + np.cross(env.tip + th[[I["TX"], I["TY"], I["TZ"]]], Fs)
    X = np.eye(3)
    X[0, 2], X[1, 2], X[2, 0] = th[I["X02"]], th[I["X12"]], th[I["X20"]]
    Q = rotvec(th[[I["M0"], I["M1"], I["M2"]]])
    y = np.hstack([f @ (X @ Q).T, tau @ Q.T]) * (1 + th[I["G"]])
    return chain(y, m.t, th), fc


TORQUE = {"tip-offset", "tool-com"}
TANGENT = {"coulomb-friction", "viscous-friction", "stribeck-friction", "presliding", "friction-rounding", "load-dependent-friction",
           "friction-anisotropy", "run-in"}
SENSOR = {"tool-mass", "sensor-bias", "sensor-drift", "sensor-gain", "sensor-crosstalk", "sensor-misalignment", "cable", "mains-hum"}


def pick(res: np.ndarray, m: Motion | Press, fc: np.ndarray, env: Env | None, effect: str) -> np.ndarray:
    """Residual in the channels the effect is about, over the samples it is about (n', channels)."""
    touch = np.abs(fc[:, 0]) > 0
    if effect == "surface-offset" or effect == "adhesion":
        touch |= np.abs(res[:, -1 if res.shape[1] == 1 else 2]) > 1e-3
    if isinstance(m, Press):
        return res if effect in SENSOR else res[touch]
    if effect in TORQUE:
        return res[touch][:, 3:]
    if effect in SENSOR:
        return res[:, :3]
    world = np.einsum("nij,nj->ni", m.R, res[:, :3])[touch]
    return world @ np.stack([env.t1, env.t2], 1) if effect in TANGENT else world @ env.normal[:, None]


def refit(m: Motion | Press, y: np.ndarray, th: np.ndarray, names: list[str], env: Env | None, torque: bool) -> tuple[np.ndarray, np.ndarray]:
    """Refit the free parameters of the named laws to readings y; returns parameters and residual (n, channels)."""
    par: list[str] = []
    for e in names:
        par += [p for p in FREE[e] if p not in par]
    if "stiffness-inhomogeneity" in names:
        par = [p for p in par if p not in (["IA", "IX", "IW"] if th[I["IA"]] == 0 else []) + (["EA", "EX", "EW"] if th[I["EA"]] == 0 else [])]
    idx = np.array([I[p] for p in par], int)
    scale = np.array([max(TYPICAL[p], 0.3 * abs(th[I[p]])) for p in par])
    w = np.array([1.0] * 3 + ([50.0] * 3 if torque else [0.0] * 3)) if y.shape[1] == 6 else np.ones(1)
    fixed_positive = {"K", "T1", "HL", "ML", "AL", "LB", "IW", "EW", "SV", "MB", "VR", "N", "SAT"}
    lo = np.array([0.02 if p in fixed_positive else -np.inf for p in par]) * 1.0

    def res(u: np.ndarray) -> np.ndarray:
        full = th.copy()
        full[idx] = u * scale
        return (predict(m, full, env)[0] - y) * w

    sol = least_squares(lambda u: res(u).ravel(), np.maximum(th[idx] / scale, lo * 1.01), bounds=(lo, np.inf), max_nfev=14, diff_step=1e-4,
                        x_scale=1.0) if len(par) else None
    out = th.copy()
    if sol is not None:
        out[idx] = sol.x * scale
    return out, predict(m, out, env)[0] - y


def rms(x: np.ndarray) -> float:
    return float(np.sqrt(np.mean(np.square(x)))) if x.size else 0.0
