"""The author's own fit of base models, used only to judge fairness."""
import numpy as np
from numba import njit
from scipy.optimize import least_squares
from scipy.signal import savgol_filter


@njit(cache=True)
def bristle(dx, touch, l):
    z = np.zeros(2); o = np.zeros((dx.shape[0], 2))
    for k in range(dx.shape[0]):
        if touch[k]:
            z[0] += dx[k, 0]; z[1] += dx[k, 1]; a = np.sqrt(z[0] ** 2 + z[1] ** 2)
            if a > l: z *= l / a
        else: z[:] = 0
        o[k, 0] = -z[0] / l; o[k, 1] = -z[1] / l
    return o


@njit(cache=True)
def branch(u, t, tau):
    y = 0.0; o = np.zeros(u.size)
    for k in range(1, u.size):
        e = 1 - np.exp(-(t[k] - t[k - 1]) / tau); y += e * (0.5 * (u[k] + u[k - 1]) - y); o[k] = u[k] - y
    return o


def smooth_rate(t, y, T, d=1):
    dt = np.median(np.diff(t)); tu = np.arange(t[0], t[-1], dt); w = max(5, int(T / dt) | 1)
    z = np.stack([np.interp(tu, t, y[:, j]) for j in range(y.shape[1])], 1)
    z = savgol_filter(z, w, 3, deriv=d, delta=dt, axis=0)
    return np.stack([np.interp(t, tu, z[:, j]) for j in range(y.shape[1])], 1)


def base_fit(law, fric, F):
    """residuals (N, C) of the base model at its best parameters"""
    t, x, Y = F["t"], F["x"], F["Y"]; u = np.maximum(-x[:, 2], 0); rate = -smooth_rate(t, x, .03)[:, 2] * (u > 0)
    D = u.max(); Fm = max(np.percentile(np.abs(Y[:, :F["forces"]]).max(1), 99.5), .1)
    fd = bristle(np.diff(x[:, :2], axis=0, prepend=x[:1, :2]), u > 0, 1e-4)
    sd = np.maximum(F["sd"], .01 * np.sqrt((Y ** 2).mean(0)))
    if F["R"] is not None:
        R, tip = F["R"], F["tip"]; pc = x @ F["B"].T + np.einsum("nij,j->ni", R, F["com"] - tip)
        ft = F["mass"] * (np.einsum("nji,nj->ni", R, F["g"] - smooth_rate(t, pc, .04, 2))); Y0 = np.concatenate([ft, np.cross(F["com"], ft)], 1)
    else: Y0 = 0.0

    def normal(p):
        if law == "hooke": return p[0] * Fm / D * u
        if law == "hertz": return p[0] * Fm / D ** 1.5 * u ** 1.5
        if law == "kelvin-voigt": return np.maximum(Fm / D * (p[0] * u + p[1] * .02 * rate), 0)
        if law == "hunt-crossley": return np.maximum(p[0] * Fm * (u / D) ** p[2] * (1 + p[1] * 5 * rate), 0)
        b = branch(u, t, np.exp(p[1]))
        return np.maximum(Fm / D * (p[0] * b if law == "maxwell" else p[0] * u + p[2] * b), 0)

    def res(p):
        N = normal(p); T = fd * (p[-1] * N)[:, None] if fric else np.zeros((len(N), 2))
        if F["R"] is None: return Y - np.stack([N, T[:, 0], T[:, 1]], 1)[:, :Y.shape[1]]
        fc = np.einsum("nji,nj->ni", F["R"], np.stack([T[:, 0], T[:, 1], N], 1) @ F["B"].T)
        return Y - Y0 - np.concatenate([fc, np.cross(F["tip"], fc)], 1)
    p0 = {"hooke": [1.], "hertz": [1.], "kelvin-voigt": [1., .2], "hunt-crossley": [1., .5, 1.3], "maxwell": [1., 1.], "zener": [.8, -.5, .5]}[law] + ([.4] if fric else [])
    st = max(1, len(t) // 3000); s = least_squares(lambda p: (res(p)[::st] / sd).ravel(), p0, x_scale=1.0, diff_step=1e-4, max_nfev=30)
    return res(s.x)


def rms(a): return float(np.sqrt((a ** 2).mean())) if a.size else 0.0


def compare(r1, r0, seg):
    """largest change against what is left over channels and segments, and the pooled one"""
    best, who = 0., ""
    for nm, m in seg.items():
        if m.sum() < 50: continue
        for c in range(r1.shape[1]):
            a, b = rms(r1[m, c]), rms(r0[m, c]); v = np.sqrt(max(a * a - b * b, 0)) / b
            if v > best: best, who = v, f"channel {c} {nm}"
    z = np.sqrt((r0 ** 2).mean(0)); a, b = rms(r1 / z), rms(r0 / z)
    return float(best), who, float(np.sqrt(max(a * a - b * b, 0)) / b)
