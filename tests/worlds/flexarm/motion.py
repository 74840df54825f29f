"""Planned motions: segments at rest on both ends for the coordinates of the tip over the surface (height, two places, two tilts, yaw), or
for joints; ramps of constant speed with soft ends, holds, sines, wiggles."""
from __future__ import annotations

import numpy as np

COORDS = ("h", "s1", "s2", "a1", "a2", "yaw")          # h = -depth; a1, a2 tilts about t1, t2


def soft(u, frac):
    """0..1 with constant speed between two soft ends of the given share."""
    u = np.clip(u, 0, 1)
    f = min(max(frac, 1e-3), 0.5)
    vm = 1 / (1 - f)
    out = vm * (u - f / 2)
    a = u < f
    out = np.where(a, vm * (u / 2 - f / (2 * np.pi) * np.sin(np.pi * u / f)), out)
    b = u > 1 - f
    w = 1 - u
    return np.where(b, 1 - vm * (w / 2 - f / (2 * np.pi) * np.sin(np.pi * w / f)), out)


class Path:
    def __init__(self, dim=6, names=COORDS, start=None):
        self.names = list(names)
        self.x = np.zeros(dim) if start is None else np.array(start, float)
        self.x0 = self.x.copy()
        self.seg = []                                    # (duration, kind, start, target, extra, phase)
        self.T = 0.0

    def _target(self, kw):
        y = self.x.copy()
        for k, v in kw.items():
            y[self.names.index(k)] = v
        return y

    def move(self, dur, phase="free", frac=0.5, **kw):
        y = self._target(kw)
        self.seg.append((dur, "move", self.x.copy(), y, frac, phase))
        self.x = y
        self.T += dur
        return self

    def ramp(self, speed, phase, acc=0.08, **kw):
        """At constant speed (of the coordinate that moves furthest)."""
        y = self._target(kw)
        d = np.abs(y - self.x).max()
        dur = max(d / speed + acc, 2 * acc)
        return self.move(dur, phase, acc / dur, **kw)

    def hold(self, dur, phase="hold"):
        return self.move(dur, phase)

    def sine(self, dur, phase, freq, **amp):
        """Oscillation about the present point, faded in and out; amp per coordinate, freq a number or per coordinate."""
        a = np.zeros(len(self.x))
        f = np.zeros(len(self.x))
        for i, (k, v) in enumerate(amp.items()):
            j = self.names.index(k)
            a[j] = v
            f[j] = freq if np.isscalar(freq) else freq[i]
        self.seg.append((dur, "sine", self.x.copy(), self.x.copy(), (a, f), phase))
        self.T += dur
        return self

    def stretch(self, factor, phases=("free", "approach")):
        """Slower moves in the given phases."""
        self.seg = [(d * factor if k == "move" and ph in phases else d, k, a, b, e, ph) for d, k, a, b, e, ph in self.seg]
        self.T = sum(s[0] for s in self.seg)

    def flatten(self, factor, names=("a1", "a2", "yaw")):
        """Smaller tilts throughout."""
        w = np.array([factor if n in names else 1.0 for n in self.names])
        self.seg = [(d, k, a * w, b * w, e if k == "move" else (e[0] * w, e[1]), ph) for d, k, a, b, e, ph in self.seg]
        self.x0 = self.x0 * w

    def sample(self, rate):
        n = int(round(self.T * rate))
        t = np.arange(n) / rate
        X = np.empty((n, len(self.x0)))
        ph = np.empty(n, dtype=object)
        X[:] = self.x0
        t0 = 0.0
        for dur, kind, a, b, ex, phase in self.seg:
            i, j = int(np.ceil(t0 * rate - 1e-9)), min(n, int(np.ceil((t0 + dur) * rate - 1e-9)))
            tt = t[i:j] - t0
            if kind == "move":
                X[i:j] = a + (b - a) * soft(tt / dur, ex)[:, None]
            else:
                am, f = ex
                fade_s = 1.2 if self.names[0] == "q1" else 0.5
                fade = np.minimum(1, np.minimum(tt, dur - tt) / min(fade_s, dur / 3))
                fade = 0.5 - 0.5 * np.cos(np.pi * np.clip(fade, 0, 1))
                X[i:j] = a + fade[:, None] * am * np.sin(2 * np.pi * f * tt[:, None])
            ph[i:j] = phase
            t0 += dur
            X[j:] = b
        ph[ph == None] = "rest"                          # noqa: E711
        return t, X, ph


def surface_axes(normal, tangent):
    n = np.asarray(normal, float)
    n = n / np.linalg.norm(n)
    t1 = np.asarray(tangent, float)
    t1 = t1 - n * (n @ t1)
    t1 /= np.linalg.norm(t1)
    return n, t1, np.cross(n, t1)


def _rot(axis, a):
    K = np.array([[0, -axis[2], axis[1]], [axis[2], 0, -axis[0]], [-axis[1], axis[0], 0]])
    s, c = np.sin(a)[:, None, None], np.cos(a)[:, None, None]
    return np.eye(3) + s * K + (1 - c) * (K @ K)


def poses(X, point, n, t1, t2, R0):
    """Tip positions and sensor rotations of sampled coordinates; R0 is the rotation with the tool straight on the surface."""
    P = point + X[:, :1] * n + X[:, 1:2] * t1 + X[:, 2:3] * t2
    R = _rot(t1, X[:, 3]) @ _rot(t2, X[:, 4]) @ _rot(n, X[:, 5]) @ R0
    return P, R
