"""From a log and a rig to what the plain laws are driven by, as a careful user would: smoothing local polynomials on the joint angles (the logged
dq is not trusted), kinematics, tool terms. Nothing here knows the truth."""
from __future__ import annotations

import numpy as np
from numba import njit
from scipy.interpolate import CubicSpline
from scipy.signal import savgol_filter

import dynamics as dyn
from motion import surface_axes


def uniform(t, Y):
    """Rows onto a uniform grid of the median rate."""
    dt = np.median(np.diff(t))
    n = int(round((t[-1] - t[0]) / dt)) + 1
    tu = t[0] + dt * np.arange(n)
    tu[-1] = min(tu[-1], t[-1])
    keep = np.r_[True, np.diff(t) > 1e-9]
    return tu, dt, CubicSpline(t[keep], Y[keep])(tu)


def window(dt, span):
    w = int(round(span / dt)) | 1
    return max(w, 5)


def smooth(Y, dt, span, order=3):
    w = window(dt, span)
    return [savgol_filter(Y, w, order, deriv=k, delta=dt, axis=0) for k in range(3)]


def cross(A, b):
    """Rows of A times one vector."""
    return A @ np.array([[0, -b[2], b[1]], [b[2], 0, -b[0]], [-b[1], b[0], 0]])


def calm(D, dt, span):
    """Slips (columns 1, 2) smoothed over a longer window where they are slow: a bristle mustn't creep with the encoders' jitter."""
    if len(D) < 4 * window(dt, 0.25):
        return D
    long = savgol_filter(D[:, 1:], window(dt, 0.25), 1, axis=0)
    v = np.hypot(*savgol_filter(D[:, 1:], window(dt, 0.12), 1, deriv=1, delta=dt, axis=0).T)
    v = np.maximum(v, np.maximum(np.roll(v, int(0.06 / dt)), np.roll(v, -int(0.06 / dt))))
    a = np.clip((v - 2e-5) / 6e-5, 0, 1)[:, None]
    out = D.copy()
    out[:, 1:] = a * D[:, 1:] + (1 - a) * long
    return out


@njit(cache=True)
def backlash(s1, s2, w):
    """Slip without jitter: it follows once it has moved by w."""
    a, b = s1.copy(), s2.copy()
    for i in range(1, len(s1)):
        x, y = s1[i] - a[i - 1], s2[i] - b[i - 1]
        r = np.sqrt(x * x + y * y)
        g = max(r - w, 0.0) / r if r > 0 else 0.0
        a[i] = a[i - 1] + g * x
        b[i] = b[i - 1] + g * y
    return a, b


class Series:
    """t, y (n, channels), d, dd, s1, s2, v1, v2, Fm and for wrenches the sensor axes and tool terms; `rows` picks of the log."""

    tool_key = None

    def fine(self, t, most):
        """Rows on which the laws are driven (up to 500 Hz) and, of them, those that are compared."""
        n = len(t)
        k = max(1, int(round(0.002 / np.median(np.diff(t)))), int(np.ceil(n / 60000)))
        fine = np.arange(0, n, k)
        self.sub = np.arange(0, len(fine), max(1, int(np.ceil(len(fine) / most))))
        self.rows = fine[self.sub]
        return fine

    def drive(self, tf, D, V, jitter=1e-9):
        self.tf = tf
        self.D, self.V = np.ascontiguousarray(D.T), np.ascontiguousarray(V.T)
        self.D[1], self.D[2] = backlash(self.D[1], self.D[2], jitter)
        self.d, self.s1, self.s2 = (x[self.sub] for x in self.D)
        self.dd, self.v1, self.v2 = (x[self.sub] for x in self.V)

    def force(self):
        """Measured normal force, smoothed, and its rate, for compliances."""
        ws = window(np.median(np.diff(self.t)), 0.03)
        F = savgol_filter(self.Fm, ws, 2)
        self.Fm = F
        self.FD = np.interp(self.tf, self.t, F)
        self.dFD = np.interp(self.tf, self.t, savgol_filter(np.gradient(F, self.t), ws, 2))
        self.contact = self.d > 0


class WrenchSeries(Series):
    channels = 6

    def __init__(self, log, rig, arm, most=6000, span=0.025, jitter=1e-9):
        t = log["t"]
        n = arm.n
        q = np.column_stack([log[f"q{i + 1}"] for i in range(n)])
        tu, dt, qu = uniform(t, q)
        qs, dq, ddq = smooth(qu, dt, span)
        Rs, Ps, X, Kin = dyn.frames(qs, dq, ddq, arm.Rp, arm.pp, arm.ax, arm.Rs, arm.ps, rig["tip"])
        nrm, t1, t2 = surface_axes(rig["normal"], rig["tangent"])
        rel = X - np.asarray(rig["point"])
        D = calm(np.column_stack([-rel @ nrm, rel @ t1, rel @ t2]), dt, span)
        V = savgol_filter(D, window(dt, span), 3, deriv=1, delta=dt, axis=0)
        fine = self.fine(t, most)
        rows = self.rows
        self.t = t[rows] - t[0]
        at = np.clip((t[fine] - tu[0]) / dt, 0, len(tu) - 1.000001)
        i = at.astype(int)
        f = at - i

        def pick(A):
            w = f.reshape((-1,) + (1,) * (A.ndim - 1))
            return A[i] * (1 - w) + A[i + 1] * w
        self.drive(t[fine] - t[0], pick(D), pick(V), jitter)
        at = np.clip((t[rows] - tu[0]) / dt, 0, len(tu) - 1.000001)
        i = at.astype(int)
        f = at - i
        RT = pick(Rs).transpose(0, 2, 1)
        self.en, self.e1, self.e2 = RT @ nrm, RT @ t1, RT @ t2
        w, al, a = (pick(Kin[:, k]) for k in range(3))
        g = np.asarray(rig["gravity"])
        self.w = np.einsum("nij,nj->ni", RT, w)
        self.al = np.einsum("nij,nj->ni", RT, al)
        self.ga = np.einsum("nij,nj->ni", RT, g - a)               # gravity minus the acceleration of the sensor's origin
        self.y = np.column_stack([log[k] for k in ("fx", "fy", "fz", "tx", "ty", "tz")])[rows]
        self.mass, self.com, self.I0, self.tip = rig["mass"], np.asarray(rig["com"]), rig["inertia"], np.asarray(rig["tip"])
        f0, _ = self.tool(self.mass, self.com, self.I0)
        self.Fm = np.clip(np.einsum("ni,ni->n", self.y[:, :3] - f0, self.en), 0, None)
        self.force()

    def tool(self, m, c, I):
        """Load of a rigid tool: force m (g - a_com), moment about the sensor's origin."""
        key = (m, c.tobytes(), None if I is None else I.tobytes())
        if key != self.tool_key:
            w = self.w
            ac = cross(self.al, c) + w * (w @ c)[:, None] - (w * w).sum(1)[:, None] * c
            f = m * (self.ga - ac)
            tq = -cross(f, c)
            if I is not None:
                tq = tq - self.al @ I - np.cross(w, w @ I)
            self.tool_key, self.tool_val = key, (f, tq)
        return self.tool_val


class TesterSeries(Series):
    def __init__(self, log, most=6000, span=0.02):
        t = log["t"]
        cols = ["depth"] + [c for c in ("slip1", "slip2") if c in log]
        tu, dt, Z = uniform(t, np.column_stack([log[c] for c in cols]))
        Zs, dZ, _ = smooth(Z, dt, span)
        fine = self.fine(t, most)
        rows = self.rows
        self.t = t[rows] - t[0]
        q = lambda A: np.column_stack([np.interp(t[fine], tu, A[:, c]) if c < A.shape[1] else np.zeros(len(fine)) for c in range(3)])
        self.drive(t[fine] - t[0], q(Zs), q(dZ))
        self.names = ["normal_force"] + [c for c in ("tangential_force1", "tangential_force2") if c in log]
        self.channels = len(self.names)
        self.y = np.column_stack([log[c] for c in self.names])[rows]
        self.Fm = np.clip(self.y[:, 0], 0, None)
        self.force()
