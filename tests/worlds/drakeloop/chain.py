"""From motion and law to the six readings, back again (least squares), and instruments: encoders, clocks, noise. SI units."""
from __future__ import annotations
from typing import Any
import numpy as np
from numba import njit
from scipy.signal import butter, filtfilt
from scipy.spatial.transform import Rotation
import law
from arm import Arm, kin_series

Par = tuple[str, str, int]      # where ("P" law, "Q" chain), name, index (Q arrays; -1 for scalars)
SIGMA6 = np.array([0.02, 0.02, 0.03, 5e-4, 5e-4, 4e-4])


def chain_defaults() -> dict[str, Any]:
    """Neutral instrument and tool: kg, m, kg m^2, N, N m, s, rad."""
    return dict(mass=0.0, com=np.zeros(3), inertia=np.zeros(6), tip=np.zeros(3), bias=np.zeros(6), drift=np.zeros(6), mis=np.zeros(3),
                xt=np.zeros(36), gain=0.0, lag=0.0, toff=0.0, sat=1e9, hum=np.zeros(6), humf=50.0, hose=0.0, hose_p=np.zeros(3), quad=0.0, nl=0.0)


@njit(cache=True)
def lowpass(t, x, tau):
    """First-order low-pass of columns, exact for a step-wise input; tau [s]."""
    y = x.copy()
    for i in range(1, len(t)):
        e = np.exp(-(t[i] - t[i - 1]) / tau)
        y[i] = y[i - 1] * e + x[i] * (1 - e)
    return y


def kinematics(arm: Arm, q: np.ndarray, dq: np.ndarray, ddq: np.ndarray) -> tuple[np.ndarray, ...]:
    """Sensor origin p, v, a, R, omega, alpha along the motion."""
    c = np.ascontiguousarray
    return kin_series(arm.o8, arm.ax, c(q), c(dq), c(ddq))


def contact(kin: tuple, t: np.ndarray, P: np.ndarray, Q: dict, plane: np.ndarray, arm: Arm) -> tuple[np.ndarray, np.ndarray]:
    """The law along a motion: forces (N, T1, T2) [N] and depth [m]."""
    p, v, a, R, w, al = kin
    rr = R @ (arm.tip + Q["tip"])
    rel = p + rr - plane[0]
    vt = v + np.cross(w, rr)
    d = -(rel @ plane[1])
    F = law.series(P, t, d, -(vt @ plane[1]), np.ascontiguousarray(rel @ plane[2:].T), np.ascontiguousarray(vt @ plane[2:].T))
    return F, d


def clean_wrench(kin: tuple, F: np.ndarray, Q: dict, plane: np.ndarray, arm: Arm, g: np.ndarray) -> np.ndarray:
    """The load on the sensor (n,6) [N, N m] of contract 2: f = R^T (f_c + m (g - a_com)), moments at the sensor's origin."""
    p, v, a, R, w, al = kin
    Rt = np.swapaxes(R, 1, 2)
    rc = R @ Q["com"]
    acom = a + np.cross(al, rc) + np.cross(w, np.cross(w, rc))
    ft = (Rt @ (Q["mass"] * (g - acom))[..., None])[..., 0]
    fw = F @ plane[1:]
    fc = (Rt @ fw[..., None])[..., 0]
    i = Q["inertia"]
    I = np.array([[i[0], i[3], i[4]], [i[3], i[1], i[5]], [i[4], i[5], i[2]]])
    ws, als = (Rt @ w[..., None])[..., 0], (Rt @ al[..., None])[..., 0]
    tau = np.cross(Q["com"], ft) + np.cross(arm.tip + Q["tip"], fc) - als @ I.T - np.cross(ws, ws @ I.T)
    f = ft + fc
    if Q["hose"] != 0:
        f = f + (Rt @ (-Q["hose"] * (p - Q["hose_p"]))[..., None])[..., 0]
    return np.hstack([f, tau])


def sense(W: np.ndarray, t: np.ndarray, Q: dict) -> np.ndarray:
    """What the sensor makes of the load, noise and lattice apart."""
    if np.any(Q["mis"]):
        M = Rotation.from_rotvec(Q["mis"]).as_matrix()
        W = np.hstack([W[:, :3] @ M, W[:, 3:] @ M])
    if np.any(Q["xt"]):
        W = W + W @ Q["xt"].reshape(6, 6).T
    W = W * (1 + Q["gain"])
    if Q["nl"] or Q["quad"]:
        pk = max(float(np.abs(W[:, :3]).max()), 1.0) * np.array([1, 1, 1, 0.1, 0.1, 0.1])
        W = W + Q["nl"] * W * np.abs(W) / pk + Q["quad"] * W * W / pk * np.array([1, 1, 1, 0, 0, 0])
    if Q["lag"] > 0:
        W = lowpass(t, W, Q["lag"])
    if Q["toff"]:
        W = np.column_stack([np.interp(t - Q["toff"], t, c) for c in W.T])
    W = W + Q["bias"] + np.outer(t / 60, Q["drift"])
    if np.any(Q["hum"]):
        W = W + np.outer(np.sin(2 * np.pi * Q["humf"] * t) + 0.3 * np.sin(4 * np.pi * Q["humf"] * t + 1), Q["hum"])
    if Q["sat"] < 1e8:
        W = W.copy()
        W[:, 2] = np.clip(W[:, 2], -Q["sat"], Q["sat"])
    return W


def predict(kin: tuple, t: np.ndarray, P: np.ndarray, Q: dict, plane: np.ndarray, arm: Arm, g: np.ndarray) -> np.ndarray:
    """Readings (n,6) of a motion by law and chain."""
    return sense(clean_wrench(kin, contact(kin, t, P, Q, plane, arm)[0], Q, plane, arm, g), t, Q)


# name -> parameters that a user's fit frees: (where, name, index, scale, lower bound, upper bound)
FREE: dict[str, list[tuple[str, str, int, float, float, float]]] = {
    "hooke": [("P", "k", -1, 500, 10, 1e6)], "hertz": [("P", "k", -1, 500, 10, 1e6)],
    "kelvin-voigt": [("P", "k", -1, 500, 10, 1e6), ("P", "c", -1, 5, 0, 1e4)],
    "hunt-crossley": [("P", "k", -1, 500, 10, 1e6), ("P", "lam", -1, 1, 0, 1e3)],
    "maxwell": [("P", "k", -1, 500, 10, 1e6), ("P", "tau1", -1, 0.5, 0.01, 100)],
    "zener": [("P", "k", -1, 500, 10, 1e6), ("P", "r1", -1, 0.2, 0, 20), ("P", "tau1", -1, 0.3, 0.005, 100)],
    "hertz-exponent": [("P", "n", -1, 0.2, 0.5, 4)], "viscous-damping": [("P", "c", -1, 5, 0, 1e4)],
    "hunt-crossley-damping": [("P", "lam", -1, 1, 0, 1e3)], "relaxation": [("P", "r1", -1, 0.2, 0, 20), ("P", "tau1", -1, 0.3, 0.005, 100)],
    "hysteresis": [("P", "hyA", -1, 0.5, 0, 50), ("P", "hyL", -1, 3e-4, 2e-5, 0.1)],
    "stress-softening": [("P", "ssR", -1, 0.1, 0, 0.95), ("P", "ssL", -1, 5e-4, 2e-5, 0.1)],
    "adhesion": [("P", "adF", -1, 0.5, 0, 50), ("P", "adL", -1, 3e-4, 2e-5, 0.05)],
    "stiffening-layer": [("P", "slK", -1, 300, 0, 1e6), ("P", "slB", -1, 1e-3, 0, 0.1)],
    "surface-offset": [("P", "z0", -1, 1e-4, -0.01, 0.01)], "stiffness-drift": [("P", "drift", -1, 0.1, -10, 10)],
    "stiffness-inhomogeneity": [("P", "inA", -1, 0.2, -0.95, 20)],
    "coulomb-friction": [("P", "mu", -1, 0.2, 0, 5)], "viscous-friction": [("P", "cv", -1, 5, 0, 1e4)],
    "stribeck-friction": [("P", "dmu", -1, 0.1, -3, 5), ("P", "vs", -1, 5e-3, 2e-4, 1)],
    "presliding": [("P", "ell", -1, 3e-4, 2e-5, 0.1)], "friction-rounding": [("P", "vr", -1, 3e-3, 1e-5, 1)],
    "load-dependent-friction": [("P", "p", -1, 0.1, -0.95, 2)], "friction-anisotropy": [("P", "aniso", -1, 0.1, -1, 1)],
    "tool-mass": [("Q", "mass", -1, 0.05, 0, 20)], "tool-com": [("Q", "com", i, 5e-3, -1, 1) for i in range(3)],
    "tool-inertia": [("Q", "inertia", i, 1e-3, -1, 1) for i in range(6)],
    "structural-compliance": [("P", "C", -1, 5e-5, 0, 1e-2)], "tip-offset": [("Q", "tip", i, 1e-3, -0.05, 0.05) for i in range(3)],
    "sensor-bias": [("Q", "bias", i, 0.3 if i < 3 else 0.01, -50, 50) for i in range(6)],
    "sensor-drift": [("Q", "drift", i, 0.3 if i < 3 else 0.01, -50, 50) for i in range(6)],
    "sensor-crosstalk": [("Q", "xt", 6 * i + j, 0.05, -1, 1) for i in range(3) for j in range(3) if i != j],
    "sensor-misalignment": [("Q", "mis", i, 0.05, -1, 1) for i in range(3)], "sensor-gain": [("Q", "gain", -1, 0.05, -0.9, 5)],
    "sensor-lag": [("Q", "lag", -1, 0.01, 1e-5, 1)], "time-offset": [("Q", "toff", -1, 0.01, -0.5, 0.5)],
    "saturation": [], "quantization": [], "mains-hum": [],
}


def get(P: np.ndarray, Q: dict, f: tuple) -> float:
    return float(P[law.IX[f[1]]] if f[0] == "P" else Q[f[1]] if f[2] < 0 else Q[f[1]][f[2]])


def put(P: np.ndarray, Q: dict, fs: list[tuple], x: np.ndarray) -> tuple[np.ndarray, dict]:
    """Copies with the parameters fs set to x."""
    P, Q = P.copy(), {k: v.copy() if isinstance(v, np.ndarray) else v for k, v in Q.items()}
    for f, v in zip(fs, x):
        if f[0] == "P":
            P[law.IX[f[1]]] = v
        elif f[2] < 0:
            Q[f[1]] = float(v)
        else:
            Q[f[1]][f[2]] = v
    return P, Q


def fit(model, y: np.ndarray, P: np.ndarray, Q: dict, names: list[str], weight: np.ndarray, rounds: int = 6) -> tuple[np.ndarray, dict, np.ndarray]:
    """Levenberg-Marquardt over the parameters of `names`; model(P, Q) -> readings like y. Returns P, Q, prediction."""
    fs = list(dict.fromkeys(f for n in names for f in FREE[n]))
    x = np.array([get(P, Q, f) for f in fs])
    sc, lo, hi = (np.array([f[i] for f in fs]) for i in (3, 4, 5))
    res = lambda pr: ((y - pr) / weight).ravel()
    pr = model(P, Q)
    r, lam = res(pr), 1e-6
    for _ in range(rounds if len(fs) else 0):
        J = np.empty((len(r), len(fs)))
        for i in range(len(fs)):
            h = 0.02 * sc[i] * (1 if x[i] + 0.02 * sc[i] <= hi[i] else -1)
            xx = x.copy()
            xx[i] += h
            J[:, i] = (r - res(model(*put(P, Q, fs, xx)))) / h * sc[i]
        A, b = J.T @ J, J.T @ r
        A += 1e-9 * np.trace(A) * np.eye(len(fs)) + 1e-12 * np.eye(len(fs))
        better = False
        for _ in range(6):
            xn = np.clip(x + sc * np.linalg.solve(A + lam * np.diag(np.diag(A)), b), lo, hi)
            pn = model(*put(P, Q, fs, xn))
            rn = res(pn)
            if rn @ rn < r @ r:
                better = (r @ r - rn @ rn) > 1e-3 * (r @ r)
                x, r, pr, lam = xn, rn, pn, max(lam * 0.2, 1e-9)
                break
            lam = max(lam, 1e-4) * 8
        if not better:
            break
    P, Q = put(P, Q, fs, x)
    return P, Q, pr


def smooth_motion(t: np.ndarray, q: np.ndarray, dq: np.ndarray | None, fc: float = 20.0, rate: float = 1000.0) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """q, dq, ddq for the inverse from what the log holds: zero-phase Butterworth at fc [Hz] on a regular clock."""
    tt = np.arange(t[0], t[-1], 1 / rate)
    b, a = butter(2, min(fc / (rate / 2), 0.9))
    g = lambda x: np.column_stack([np.interp(tt, t, c) for c in x.T])
    lp = lambda x: filtfilt(b, a, x, axis=0)
    back = lambda x: np.column_stack([np.interp(t, tt, c) for c in x.T])
    qs = filtfilt(*butter(2, min(2.5 * fc / (rate / 2), 0.9)), g(q), axis=0)     # an encoder's steps would ratchet the bristles
    v = lp(np.gradient(qs, 1 / rate, axis=0))
    acc = np.gradient(v if dq is None else lp(g(dq)), 1 / rate, axis=0)
    return back(qs), back(v) if dq is None else dq, back(acc)


class Clock:
    """Sampling instants of a log: rate [Hz], jitter (share of a period), dropped share."""

    def __init__(self, rng: np.random.Generator, t_end: float, rate: float, jitter: float, dropped: float) -> None:
        n = int((t_end - 0.01) * rate)
        t = 0.004 + np.arange(n) / rate + jitter / rate * rng.uniform(-1, 1, n)
        self.t = t[rng.random(n) >= dropped] if dropped else t


def at(t: np.ndarray, tg: np.ndarray, x: np.ndarray) -> np.ndarray:
    """Linear interpolation of columns of the regular grid tg at t."""
    u = (t - tg[0]) / (tg[1] - tg[0])
    i = np.clip(u.astype(int), 0, len(tg) - 2)
    a = np.clip(u - i, 0, 1)
    return x[i] * (1 - a)[:, None] + x[i + 1] * a[:, None]


def encoders(rng: np.random.Generator, nu: dict, t: np.ndarray, tg: np.ndarray, q: np.ndarray, dq: np.ndarray) -> tuple[np.ndarray, np.ndarray | None]:
    """Logged q [rad] and dq [rad/s] (None if missing) with the nuisances in nu."""
    qs = nu["encoder_step"]
    ql = np.round(at(t, tg, q) / qs) * qs
    if nu["dq_missing"]:
        return ql, None
    d = dq
    if nu["dq_lowpass_hz"]:
        d = lowpass(tg, np.ascontiguousarray(dq), 1 / (2 * np.pi * nu["dq_lowpass_hz"]))
    d = at(t - nu["dq_lag"], tg, d)
    return ql, d + rng.normal(0, nu["dq_noise"], d.shape) + rng.uniform(-1, 1, 7) * nu["dq_bias"]


def draw_nuisances(rng: np.random.Generator, group: str, joints: bool) -> dict[str, Any]:
    """Instruments and clocks of a case."""
    none = group == "none"
    lu = lambda a, b: float(np.exp(rng.uniform(np.log(a), np.log(b))))
    rates = [100, 200, 250, 500, 1000] if joints else [200, 250, 400, 500, 500, 1000, 1000, 2000]
    nu = dict(rate=float(rng.choice(rates)), jitter=float(rng.choice([0, rng.uniform(0, 0.1)])), dropped=float(rng.choice([0, rng.uniform(0, 0.02)])),
              encoder_step=lu(2e-6, 1e-3 if joints else 2e-5), dq_missing=bool(rng.random() < 0.25), dq_noise=lu(1e-5, 5e-4),
              dq_bias=float(rng.uniform(0, 2e-4)), dq_lag=0.0, dq_lowpass_hz=0.0, base_tilt=float(rng.uniform(0, np.radians(0.2))),
              clock_off=float(rng.uniform(-2e-4, 2e-4)), nonlinearity=float(rng.uniform(-1, 1) * (0.003 if none else 0.006)))
    if rng.random() < 0.5:
        nu["dq_lag"] = float(rng.uniform(0, 0.005))
    else:
        nu["dq_lowpass_hz"] = lu(30, 100)
    return nu
