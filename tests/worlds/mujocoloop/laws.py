"""Contact laws, sensor chain, kinematics of the log and the fit that judges a case (numba, SI units)."""
from __future__ import annotations
import xml.etree.ElementTree as ET
import numpy as np
from numba import njit
from scipy.signal import lfilter

NAMES = """k n c lam r1 tau1 r2 tau2 hysA hysL mulR mulL Fa La K2 db z0 drift inhA inhX inhY inhW inhType mu cv dmu vs len ftype vr p N0 aniso C
snapF snapD snapW breA breF dentR dentY magA magL cabK drag cabX cabY cabZ m cx cy cz Ixx Iyy Izz tox toy toz
b0 b1 b2 b3 b4 b5 d0 d1 d2 d3 d4 d5 gain x0 x1 x2 x3 x4 x5 m0 m1 m2 lag toff""".split()
IX = {n: i for i, n in enumerate(NAMES)}
NS = 13
NULL = dict(n=1.0, tau1=0.5, tau2=3.0, hysL=5e-4, mulL=1e-3, La=1e-3, db=3e-3, inhW=8e-3, vs=0.01, len=1e-4, vr=1e-3, p=1.0, N0=5.0, snapD=2e-3,
            snapW=4e-4, breF=0.5, dentY=1e-3, magL=4e-3)
(K, NN, CC, LAM, R1, T1, R2, T2, HA, HL, MR, ML, FA, LA, K2, DB, Z0, DR, IA, IXX, IYY, IW, IT, MU, CV, DMU, VS, LEN, FT, VR, PP, N0, AN, CO,
 SF, SD, SW, BA, BF, DNR, DNY, MA, MGL, CK, DG, CX, CY, CZ) = range(48)
# parameters that a name of the catalogue frees, and the typical size of a step in each
FREE: dict[str, list[str]] = {
    "hooke": ["k"], "kelvin-voigt": ["k", "c"], "hertz": ["k"], "hunt-crossley": ["k", "lam"], "zener": ["k", "r1", "tau1"],
    "hertz-exponent": ["n"], "viscous-damping": ["c"], "hunt-crossley-damping": ["lam"], "relaxation": ["r1", "tau1"], "hysteresis": ["hysA", "hysL"],
    "stress-softening": ["mulR", "mulL"], "adhesion": ["Fa", "La"], "stiffening-layer": ["K2", "db"], "surface-offset": ["z0"], "stiffness-drift": ["drift"],
    "stiffness-inhomogeneity": ["inhA", "inhX", "inhY", "inhW"], "coulomb-friction": ["mu"], "viscous-friction": ["cv"], "stribeck-friction": ["dmu", "vs"],
    "presliding": ["len"], "friction-rounding": ["vr"], "load-dependent-friction": ["p"], "friction-anisotropy": ["aniso"], "tool-mass": ["m"],
    "tool-com": ["cx", "cy", "cz"], "tool-inertia": ["Ixx", "Iyy", "Izz"], "structural-compliance": ["C"], "tip-offset": ["tox", "toy", "toz"],
    "sensor-bias": [f"b{i}" for i in range(6)], "sensor-drift": [f"d{i}" for i in range(6)], "sensor-crosstalk": [f"x{i}" for i in range(6)],
    "sensor-misalignment": ["m0", "m1", "m2"], "sensor-gain": ["gain"], "sensor-lag": ["lag"], "time-offset": ["toff"],
    "saturation": [], "quantization": [], "mains-hum": [], "none": []}
SCALE = dict(k=100, n=0.05, c=2, lam=0.3, r1=0.1, tau1=0.2, r2=0.1, tau2=1, hysA=0.3, hysL=2e-4, mulR=0.1, mulL=5e-4, Fa=0.2, La=3e-4, K2=500, db=3e-4,
             z0=1e-4, drift=0.1, inhA=0.1, inhX=1e-3, inhY=1e-3, inhW=1e-3, mu=0.05, cv=3, dmu=0.05, vs=3e-3, len=3e-5, vr=5e-4, p=0.05, aniso=0.05, C=1e-5,
             m=0.02, cx=2e-3, cy=2e-3, cz=2e-3, Ixx=3e-4, Iyy=3e-4, Izz=3e-4, tox=5e-4, toy=5e-4, toz=5e-4, gain=0.03, lag=3e-3, toff=2e-3)
SCALE |= {f"b{i}": 0.1 if i < 3 else 2e-3 for i in range(6)} | {f"d{i}": 0.3 if i < 3 else 6e-3 for i in range(6)}
SCALE |= {f"x{i}": 0.02 for i in range(6)} | {f"m{i}": 0.02 for i in range(3)}
POSITIVE = {"tau1", "tau2", "hysL", "mulL", "La", "vs", "len", "vr", "inhW", "lag", "k", "C", "db", "n", "Fa"}


def params(**kw: float) -> np.ndarray:
    """The parameter vector with every effect at rest, then kw."""
    P = np.zeros(len(NAMES))
    for k, v in {**NULL, **kw}.items():
        P[IX[k]] = v
    return P


@njit(inline="always")
def norm3(a, b):
    """Length of a plane vector."""
    return np.sqrt(a * a + b * b)


@njit
def contact_force(P, st, dt, t, s, v):
    """Force of the material on the tool: [N, T1, T2, world extra xyz] for s = (depth, slip1, slip2) [m] and its rates v [m/s].

    st: [branch 1, branch 2, last elastic force, hysteresis z, deepest depth, stuck, bristle 1, bristle 2, dent, last slip1, last slip2, begun, last depth]
    """
    F = np.zeros(6)
    w = 2 * np.pi * P[BF]
    d = s[0] + P[Z0] + P[BA] * np.sin(w * t)
    dd = v[0] + P[BA] * w * np.cos(w * t)
    de = d
    if P[DNR] > 0:  # plastic dent: a share of what goes beyond the yield depth stays
        st[8] = max(st[8], P[DNR] * max(0.0, d - P[DNY]))
        de = d - st[8]
    k = P[K] * (1 + P[DR] * t / 60)
    if P[IA] != 0:
        g1, g2 = s[1] - P[IXX], s[2] - P[IYY]
        if P[IT] == 0:
            k *= 1 + P[IA] * np.exp(-(g1 * g1 + g2 * g2) / (2 * P[IW] ** 2))
        else:
            k *= 1 + P[IA] * 0.5 * (1 + np.tanh(g1 / P[IW]))
    if de > 0 and P[CO] > 0:  # mount in series: x + C F(x) = depth
        x = de
        for _ in range(12):
            fx = k * x ** P[NN] + P[K2] * max(0.0, x - P[DB])
            dfx = k * P[NN] * x ** (P[NN] - 1) + (P[K2] if x > P[DB] else 0.0)
            x = max(x - (x + P[CO] * fx - de) / (1 + P[CO] * dfx), 1e-9)
        de = x
        dd = dd / (1 + P[CO] * (k * P[NN] * x ** (P[NN] - 1)))
    fe = 0.0
    if de > 0:
        fe = k * de ** P[NN] + P[K2] * max(0.0, de - P[DB])
        if P[SF] != 0:  # a wall that buckles: the force drops by snapF around snapD
            fe -= 0.5 * P[SF] * (np.tanh((de - P[SD]) / P[SW]) + np.tanh(P[SD] / P[SW]))
        if P[MR] != 0:
            if de > st[4]:
                st[4] = de
            fe *= 1 - P[MR] * (1 - np.exp(-(st[4] - de) / P[ML]))
    N = fe
    for i in range(2):
        r, tau = P[R1 + 2 * i], P[T1 + 2 * i]
        if r != 0:
            e = np.exp(-dt / tau)
            st[i] = st[i] * e + r * (fe - st[2]) * tau / dt * (1 - e)
            N += st[i]
    st[2] = fe
    if de > 0:
        N += P[CC] * dd + P[LAM] * fe * dd
        if P[HA] != 0:
            u = 1.0 if dd > 0 else -1.0
            st[3] = u + (st[3] - u) * np.exp(-abs(dd) * dt / P[HL])
            N += P[HA] * st[3]
        if N < 0:
            N = 0.0
    else:
        st[3] = 0.0
        N = 0.0
    load = N
    if P[FA] > 0:  # sticks once it has touched, lets go at La
        if de > 0:
            st[5] = 1.0
            N -= P[FA]
        elif de > -P[LA] and st[5] > 0:
            N -= P[FA] * (1 + de / P[LA])
        else:
            st[5] = 0.0
    if P[MA] > 0:
        N -= P[MA] * np.exp(-max(0.0, -de) / P[MGL])
    F[0] = N
    if P[CK] > 0 or P[DG] > 0:  # a hose on the tool; a liquid around it: in the air too
        sp = P[DG] * np.sqrt(v[0] ** 2 + v[1] ** 2 + v[2] ** 2)
        F[0] += P[CK] * (s[0] - P[CZ]) + sp * v[0]
        F[1] -= P[CK] * (s[1] - P[CX]) + sp * v[1]
        F[2] -= P[CK] * (s[2] - P[CY]) + sp * v[2]
    if load > 0 and st[11] > 0:
        sp = norm3(v[1], v[2])
        mu = (P[MU] + P[DMU] * np.exp(-(sp / P[VS]) ** 2)) * (load / P[N0]) ** (P[PP] - 1)
        if P[FT] == 2:
            r = 1 / np.sqrt(sp * sp + P[VR] ** 2)
            z1, z2 = v[1] * r, v[2] * r
        else:
            part = de / (de - st[12]) if st[12] < 0 else 1.0  # the share of the step since the touch
            d1, d2 = part * (s[1] - st[9]), part * (s[2] - st[10])
            ds = norm3(d1, d2)
            if P[FT] == 1:  # Dahl, exact for a straight step
                if ds > 0:
                    e = np.exp(-ds / P[LEN])
                    st[6] = d1 / ds + (st[6] - d1 / ds) * e
                    st[7] = d2 / ds + (st[7] - d2 / ds) * e
            else:  # Prandtl / Cundall-Strack
                ns = min(int(ds / (0.15 * P[LEN])) + 1, 60)
                for _ in range(ns):
                    st[6] += d1 / P[LEN] / ns
                    st[7] += d2 / P[LEN] / ns
                    q = norm3(st[6], st[7])
                    if q > 1:
                        st[6] /= q
                        st[7] /= q
            z1, z2 = st[6], st[7]
        F[1] -= mu * load * (1 + P[AN]) * z1 + P[CV] * v[1]
        F[2] -= mu * load * (1 - P[AN]) * z2 + P[CV] * v[2]
    else:
        st[6] = 0.0
        st[7] = 0.0
    st[9], st[10], st[11], st[12] = s[1], s[2], 1.0, de
    return F


@njit
def law_series(P, t, s, v):
    """contact_force along a log: rows [N, T1, T2]."""
    st, out = np.zeros(NS), np.zeros((len(t), 3))
    for i in range(len(t)):
        dt = t[i] - t[i - 1] if i else t[1] - t[0]
        out[i] = contact_force(P, st, dt, t[i], s[i], v[i])[:3]
    return out


def chain(urdf: str) -> tuple[np.ndarray, np.ndarray]:
    """Joint origins (along the chain, no rotations in this URDF) and axes from the URDF; the 8th origin is joint_7 to ft_sensor."""
    J = {j.get("name"): j for j in ET.parse(urdf).getroot().findall("joint")}
    xyz = lambda n, t: np.array([float(x) for x in J[n].find(t).get("xyz").split()])
    o = [xyz(f"joint_{i}", "origin") for i in range(1, 8)] + [xyz("flange_joint", "origin") + xyz("ft_sensor_joint", "origin")]
    return np.array(o), np.array([xyz(f"joint_{i}", "axis") for i in range(1, 8)])


@njit
def kinematics(org, axs, q, dq, ddq):
    """Own forward kinematics of a log: R (n,3,3), p, v, a of the sensor's origin [m, m/s, m/s^2], w, al [rad/s, rad/s^2], base frame."""
    n = len(q)
    Rs, p, v, a, w, al = np.zeros((n, 3, 3)), np.zeros((n, 3)), np.zeros((n, 3)), np.zeros((n, 3)), np.zeros((n, 3)), np.zeros((n, 3))
    for k in range(n):
        R = np.eye(3)
        for i in range(8):
            r = R @ org[i]
            p[k] += r
            wr = np.cross(w[k], r)
            v[k] += wr
            a[k] += np.cross(al[k], r) + np.cross(w[k], wr)
            if i < 7:
                x = axs[i]
                ax = R @ x
                al[k] += ax * ddq[k, i] + np.cross(w[k], ax) * dq[k, i]
                w[k] += ax * dq[k, i]
                c, s = np.cos(q[k, i]), np.sin(q[k, i])
                X = np.array([[0, -x[2], x[1]], [x[2], 0, -x[0]], [-x[1], x[0], 0]])
                R = R @ (np.eye(3) + s * X + (1 - c) * (X @ X))
        Rs[k] = R
    return Rs, p, v, a, w, al


class Motion:
    """Contact-frame motion of one log: everything that a wrench model needs, from joints and a rig."""

    def __init__(self, ch, t, q, dq, ddq, surf: np.ndarray, tip: np.ndarray, gravity: np.ndarray):
        self.t, self.surf, self.g, self.tip = t, surf, gravity, tip
        self.R, self.p, self.v, self.a, self.w, self.al = kinematics(ch[0], ch[1], q, dq, ddq)

    def contact(self, off: np.ndarray):
        """Depth and slips s [m] with rates v [m/s] of the tip moved by off [m, tool frame], and the lever in the sensor frame."""
        r = self.tip + off
        rw = self.R @ r
        x, v = self.p + rw - self.surf[0], self.v + np.cross(self.w, rw)
        B = np.array([-self.surf[1], self.surf[2], self.surf[3]]).T
        return x @ B, v @ B, r


def predict(P: np.ndarray, M: Motion) -> np.ndarray:
    """Readings (n, 6) of the sensor [N, N m] for the parameters P along the motion M."""
    s, v, r = M.contact(P[IX["tox"]:IX["toz"] + 1])
    N = law_series(P, M.t, s, v)
    fc = N[:, :1] * M.surf[1] + N[:, 1:2] * M.surf[2] + N[:, 2:] * M.surf[3]
    RT = M.R.transpose(0, 2, 1)
    rot = lambda x: np.einsum("nij,nj->ni", RT, x)
    com, m, I = P[IX["cx"]:IX["cz"] + 1], P[IX["m"]], P[IX["Ixx"]:IX["Izz"] + 1]
    cw = M.R @ com
    ac = M.a + np.cross(M.al, cw) + np.cross(M.w, np.cross(M.w, cw))
    ft, fc, w, al = rot(m * (M.g - ac)), rot(fc), rot(M.w), rot(M.al)
    tau = np.cross(com, ft) - al * I - np.cross(w, w * I) + np.cross(r, fc)
    return sensor_chain(P, M.t, np.hstack([ft + fc, tau]))


def sensor_chain(P: np.ndarray, t: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Rotation, crosstalk, gain, bias, drift, low-pass and clock of the sensor, on true wrenches y (n, 6) at times t [s]."""
    a = P[IX["m0"]:IX["m2"] + 1]
    if np.any(a):
        X = np.array([[0, -a[2], a[1]], [a[2], 0, -a[0]], [-a[1], a[0], 0]])
        Q = np.eye(3) + X + 0.5 * X @ X
        y = np.hstack([y[:, :3] @ Q, y[:, 3:] @ Q])
    x = P[IX["x0"]:IX["x5"] + 1]
    if np.any(x):
        y = y.copy()
        y[:, :3] = y[:, :3] @ np.array([[1, x[0], x[1]], [x[2], 1, x[3]], [x[4], x[5], 1]]).T
    y = (1 + P[IX["gain"]]) * y + P[IX["b0"]:IX["b5"] + 1] + np.outer(t - t[0], P[IX["d0"]:IX["d5"] + 1]) / 60
    if P[IX["lag"]] > 1e-6:
        e = np.exp(-np.median(np.diff(t)) / P[IX["lag"]])
        y = lfilter([1 - e], [1, -e], y, axis=0, zi=e * y[:1])[0]
    if P[IX["toff"]] != 0:
        y = np.column_stack([np.interp(t - P[IX["toff"]], t, y[:, i]) for i in range(6)])
    return y


def fit(f, P: np.ndarray, free: list[str], y: np.ndarray, w: np.ndarray, iters: int = 14) -> tuple[np.ndarray, np.ndarray]:
    """Levenberg-Marquardt of the named parameters: returns (P, residual (n, 6)). w: weights of the channels, rows with a mask built in."""
    P = P.copy()
    sc = np.array([SCALE[n] * (20 if n == "k" and P[IX["n"]] > 1.2 else 1) for n in free])
    ix = [IX[n] for n in free]
    res = y - f(P)
    cost, lm = np.sum((res * w) ** 2), 1e-4
    if not free:
        return P, res
    for _ in range(iters):
        Jm = np.empty((y.size, len(ix)))
        for j, i in enumerate(ix):
            Q = P.copy()
            Q[i] += 1e-2 * sc[j]
            Jm[:, j] = ((f(Q) - y + res) * w).ravel() / 1e-2
        A, b = Jm.T @ Jm, Jm.T @ (res * w).ravel()
        for _ in range(9):
            st = np.linalg.lstsq(A + lm * np.diag(np.diag(A) + 1e-9 * np.trace(A) + 1e-12), b, rcond=1e-13)[0]
            Q = P.copy()
            Q[ix] += np.clip(st, -20, 20) * sc
            for n in free:
                if n in POSITIVE:
                    Q[IX[n]] = max(Q[IX[n]], 0.2 * P[IX[n]], 1e-7)
            r2 = y - f(Q)
            c2 = np.sum((r2 * w) ** 2)
            if c2 < cost:
                break
            lm = max(10 * lm, 1e-5)
        else:
            break
        done = cost - c2 < 1e-5 * cost
        P, res, cost, lm = Q, r2, c2, max(lm / 5, 1e-9)
        if done:
            break
    return P, res
