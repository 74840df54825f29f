"""Planned paths: minimum-jerk pieces (quintic splines) with sines on top, for arms (tip place, height, wrist turn), testers (depth, slips) and
single joints; Fourier trajectories of identification; hand-like tremor; the arm that follows them (tracking filter, contact deflection)."""
import numpy as np
from scipy.interpolate import CubicSpline
from scipy.signal import butter, sosfilt

import laws
from robots import expm


class Path:
    """a vector path; coordinates by name, pieces appended one after another."""

    def __init__(self, names, start, fs=200.0):
        self.names, self.fs = names, fs
        self.now = np.array(start, float)
        self.rows, self.phase, self.n = [], [], 0

    @property
    def t(self):
        return self.n / self.fs

    def _add(self, block, phase):
        self.rows.append(block)
        self.phase += [phase] * len(block)
        self.n += len(block)

    def to(self, dur, phase, **target):
        """minimum-jerk move to the named coordinates."""
        m = max(int(round(dur * self.fs)), 2)
        s = np.arange(1, m + 1) / m
        s = s ** 3 * (10 - 15 * s + 6 * s * s)
        goal = self.now.copy()
        for k, v in target.items():
            goal[self.names.index(k)] = v
        self._add(self.now + s[:, None] * (goal - self.now), phase)
        self.now = goal

    def line(self, dur, phase, blend=0.08, **target):
        """constant speed with short smooth ends."""
        m = max(int(round(dur * self.fs)), 4)
        s = np.arange(1, m + 1) / m
        b = min(max(blend / dur, 2.0 / m), 0.45)
        v = np.clip(np.minimum(s, 1 - s) / b, 0, 1)
        v = v * v * (3 - 2 * v)
        s = np.cumsum(v) / v.sum()
        goal = self.now.copy()
        for k, val in target.items():
            goal[self.names.index(k)] = val
        self._add(self.now + s[:, None] * (goal - self.now), phase)
        self.now = goal

    def hold(self, dur, phase):
        self._add(np.tile(self.now, (max(int(round(dur * self.fs)), 1), 1)), phase)

    def sine(self, dur, phase, **waves):
        """name = [(amplitude, Hz), ...] about the present point, faded in and out."""
        m = max(int(round(dur * self.fs)), 8)
        t = np.arange(1, m + 1) / self.fs
        fade = np.clip(np.minimum(t, t[-1] - t) / min(0.8, dur / 4), 0, 1)
        fade = fade * fade * (3 - 2 * fade)
        block = np.tile(self.now, (m, 1))
        for k, ws in waves.items():
            for a, f in ws:
                block[:, self.names.index(k)] += fade * a * np.sin(2 * np.pi * f * t)
        self._add(block, phase)

    def done(self):
        return np.vstack(self.rows), np.array(self.phase)


def arm_program(rng, want, c):
    """tip path in the surface frame: x y along the tangents, h above the surface, turn a b (tilts), s (spin).
    want: set of words (turns, tilt, deep, places, long, slow_retract, fixed, oneway, gentle); c: depth scale, speeds."""
    P = Path(["x", "y", "h", "a", "b", "s"], [0, 0, 0.045, 0, 0, 0])
    D = c["depth"]
    u = rng.uniform
    over = c.get("reach", 0.0)                    # the command goes deeper for the arm yields
    deep = lambda f: -(D * f * (1 + over))
    phase, k_turn = "free", c.get("turn", 1.0)
    P.hold(u(0.3, 0.8), "rest")
    if "fixed" not in want:
        up = u(0.09, 0.13)
        P.to(u(1.0, 1.8), phase, h=up)
        k = c.get("turn", 1.0)
        for _ in range(2 if "turn" in want else 1):
            A, B, S = k * u(0.5, 0.95), k * u(0.5, 0.95), k * u(0.6, 1.2)
            for s in (1, -1) if "shortturn" not in want else (1,):
                P.to(u(0.9, 1.4), phase, a=s * A, b=0.3 * B * s, s=-s * S)
                P.to(u(0.9, 1.4), phase, a=-0.2 * A * s, b=s * B, s=s * S)
                if u() < 0.6:
                    P.hold(u(0.2, 0.6), "rest")
        P.to(u(1, 1.5), phase, a=0, b=0, s=0)
        k = c.get("shake", 1.0)
        P.sine(u(2.2, 3.0), phase, a=[(0.10 * k, u(0.7, 1.1))], b=[(0.07 * k, u(1.2, 1.7))], s=[(0.16 * k, u(0.9, 1.5))],
               x=[(0.006 * k, u(1.5, 2.5))], h=[(0.008 * k, u(1.8, 2.6))])
        P.sine(u(1.2, 1.8), phase, a=[(0.03 * k, u(2.5, 3.5))], b=[(0.03 * k, u(3, 4))], s=[(0.06 * k, u(2.5, 3.5))])
    tilt = dict(a=0.0, b=0.0)

    def touch(x, y, h=0.004):
        P.to(u(0.6, 1.0), "approach", x=x, y=y, h=h)

    def poke(f, dur, hold, up=0.003):
        P.to(dur, "poke", h=deep(f))
        P.hold(hold, "hold")
        P.to(dur * u(0.8, 1.3), "retract", h=up)

    places = [(0.0, 0.0)]
    if "places" in want:
        w = c["slide"] * 0.5
        places += [(w * u(0.7, 1), w * u(-0.6, 0.6)), (-w * u(0.7, 1), w * u(0.4, 0.9)), (w * u(-0.3, 0.3), -w * u(0.6, 1))]
    speed = lambda: float(rng.choice(c["speeds"]))                # depth per second
    for r in range(2 if "places" in want and "long" not in want else 1):
        for x, y in places:
            touch(x, y)
            if len(places) > 1:
                f = u(0.55, 0.95)
                poke(f, 1.6 * D * f / speed() + 0.12, u(0.3, 0.8))
                continue
            todo = [0.35, 0.6, 0.85] + ([0.6] if "deep" in want else [])
            rng.shuffle(todo)
            sp = sorted(c["speeds"])
            for i, f in enumerate(todo):
                v = sp[i % len(sp)]
                poke(f * u(0.9, 1.1), 1.8 * D * f / v + 0.05, u(0.3, 0.7) if i else c.get("hold", 1.5))
            P.to(1.8 * D * 0.6 / sp[1] + 0.1, "poke", h=deep(0.6))
            P.sine(u(2.0, 3.0), "poke", h=[(0.16 * D, u(0.5, 0.9)), (0.10 * D, u(1.8, 3.2))])
            if "fast" in want:
                P.sine(u(1.5, 2.2), "poke", h=[(0.07 * D, u(4, 7))])
            P.hold(u(0.3, 0.8), "hold")
            P.to(u(0.5, 1.2) if "slow_retract" not in want else u(2, 3), "retract", h=0.003)
    if "tilt" in want:
        for s in (1, -1):
            touch(0, 0, 0.006)
            P.to(0.9, "approach", a=s * u(0.15, 0.28), b=-s * u(0.1, 0.25))
            poke(u(0.5, 0.8), u(0.6, 1.0), u(0.4, 0.8), 0.005)
        P.to(0.9, "free", a=0, b=0)
    if "slides" in want:
        levels = [0.45, 0.85] if "onedepth" not in want else [0.65]
        vs = sorted(c["slide_speeds"])
        L = c["slide"]
        for li, f in enumerate(levels):
            touch(0, 0)
            P.to(0.6, "poke", h=deep(f))
            P.hold(0.3, "hold")
            for v in (vs[1:2] if "onespeed" in want else vs if li == 0 else vs[::2]):
                l = min(L, v * 0.8) * u(0.8, 1.0)
                dirs = [("x", l), ("y", l)] if "oneway" not in want else [("x", l)]
                if li and "oneway" not in want and "diagonal" not in want:
                    dirs = dirs[:1] if v == vs[0] else dirs[1:]
                for axis, amp in dirs:
                    T = amp / v
                    for goal, part in ((amp / 2, 0.5), (-amp / 2, 1.0), (amp / 2, 0.7), (0, 0.4)):
                        P.line(max(T * part, 0.12), "slide", blend=0.06, **{axis: goal})
                        if u() < 0.25 and "norest" not in want:
                            P.hold(u(0.2, 0.4), "hold")
            if "diagonal" in want and "oneway" not in want:
                l, v = L * 0.5, vs[-1]
                P.line(l / v + 0.1, "slide", x=l / 2, y=l / 2)
                P.line(2 * l / v + 0.1, "slide", x=-l / 2, y=-l / 2)
                P.line(l / v + 0.1, "slide", x=0, y=0)
            if "micro" in want:                          # reversals shorter and longer than a bristle
                for amp in (2e-4, 6e-4, 2e-3):
                    P.sine(1.8, "slide", x=[(amp, 0.9)], y=[(amp * 0.6, 0.6)])
            P.to(u(0.5, 0.9), "retract", h=0.004)
    if "onereturn" not in want and ("deep" in want or "places" in want or u() < 0.4):
        touch(0, 0)
        poke(0.7 if "deep" not in want else 1.0, 0.8, u(0.4, 0.8))
        if "deep" in want:
            poke(0.6, 0.6, 0.3)
    if "long" in want:
        while P.t < c["long"]:
            x, y = places[int(rng.integers(len(places)))]
            touch(x, y)
            poke(u(0.4, 1.0), 1.8 * D / speed() + 0.1, u(0.5, 6.0))
            if u() < 0.5:
                P.to(1.0, "poke", h=deep(0.5))
                for goal in (0.4, -0.4, 0.0):
                    P.line(u(0.8, 2.5), "slide", x=x + goal * c["slide"])
                P.to(0.8, "retract", h=0.004)
            P.hold(u(0.3, 4.0), "rest")
    P.to(u(0.8, 1.4), "retract", h=0.09)
    if "fixed" not in want:
        for _ in range(2 if "turn" in want else 1):
            P.to(u(1, 1.6), "free", a=k_turn * u(-0.8, 0.8), b=k_turn * u(-0.8, 0.8), s=k_turn * u(-0.9, 0.9))
    P.hold(u(0.3, 0.8), "rest")
    return P


def tester_program(rng, want, c):
    """depth d and slips s1, s2 of a material tester."""
    P = Path(["d", "s1", "s2"], [-c["gap"], 0, 0], fs=400.0 if c["short"] else 200.0)
    D, u = c["depth"], rng.uniform
    out = -c["gap"]
    sp = sorted(c["speeds"])
    P.hold(u(0.2, 0.5), "rest")
    levels = [0.3, 0.55, 0.8] if "deep" in want else [0.4, 0.7, 1.0]
    k = 0
    reps = 1 if c["short"] or u() < 0.75 else 2
    for rep in range(reps):
        for f in levels:
            for v in (sp if not c["short"] else sp[k % len(sp):][:1] + sp[-1:]):
                f_ = f * u(0.92, 1.05)
                P.line((D * f_ + c["gap"]) / v + 0.03, "poke", blend=0.05, d=D * f_)
                if k % 2 == 0 or "holds" in want:
                    P.hold(c["hold"] * u(0.6, 1.3), "hold")
                P.line((D * f_ + c["gap"]) / v + 0.03, "retract", blend=0.05, d=out)
                k += 1
        if "cycles" in want:
            P.line(0.6, "poke", d=0.6 * D)
            for fr in c["freqs"]:
                P.sine(max(2.0 / fr, 0.8), "poke", d=[(0.22 * D, fr)])
            P.line(0.5, "retract", d=out)
    if "deep" in want:
        for f in (1.0, 0.75, 1.05):
            P.line(0.5 + D / sp[0] * 0.3, "poke", d=D * f)
            P.hold(0.2, "hold")
            P.line(0.5 + D / sp[0] * 0.3, "retract", d=out)
    if "slides" in want:
        vs = sorted(c["slide_speeds"])
        for f in ([0.45, 0.9] if "onedepth" not in want else [0.7]):
            P.line(0.6, "poke", d=D * f)
            P.hold(0.3, "hold")
            for v in (vs[-1:] if "onespeed" in want else vs if f < 0.6 else vs[::2]):
                l = min(c["slide"], v * 0.7)
                for axis in (("s1", "s2") if "oneway" not in want else ("s1",)):
                    for goal, part in ((l / 2, 0.5), (-l / 2, 1), (l / 2, 1), (0, 0.5)):
                        P.line(max(l * part / v, 0.1), "slide", blend=0.04, **{axis: goal})
                    if u() < 0.4 and "norest" not in want:
                        P.hold(0.25, "hold")
            if "micro" in want:
                for amp in (1.5e-4, 5e-4, 1.5e-3):
                    P.sine(2.0, "slide", s1=[(amp, 0.8)], s2=[(amp * 0.7, 0.55)])
            P.line(0.5, "retract", d=out)
    if "long" in want:
        while P.t < c["long"]:
            f, v = u(0.4, 1.0), float(rng.choice(sp))
            P.line(D * f / v + 0.05, "poke", d=D * f)
            P.hold(u(0.5, 12.0), "hold")
            P.line(D * f / v + 0.05, "retract", d=out)
            P.hold(u(0.5, 5.0), "rest")
    P.hold(0.3, "rest")
    return P


def tremor(rng, n, nq, dt, size, fast=0.5):
    """narrow-band 7-12 Hz shaking and slow wander of every coordinate, rms `size`."""
    out = np.zeros((n, nq))
    for lo, hi, part in ((7.0, 12.0, fast), (0.15, 1.5, 1.0)):
        sos = butter(2, [lo * 2 * dt, hi * 2 * dt], "band", output="sos")
        x = sosfilt(sos, rng.standard_normal((n, nq)), axis=0)
        out += part * x / (x.std(0) + 1e-12)
    return size * out


def resample(P, fs):
    """the path on a grid of rate fs (cubic splines through its points)."""
    rows, phase = P.done()
    t = np.arange(len(rows)) / P.fs
    m = int(t[-1] * fs)
    tt = np.arange(m) / fs
    return tt, CubicSpline(t, rows)(tt), phase[np.minimum((tt * P.fs).astype(int), len(phase) - 1)]


def arm_path(A, P, frame, fs, k):
    """command in joints for the path: frame has point, axes (rows t1, t2, n) and R0 (sensor rotation with the tool square to the surface)."""
    rows, phase = P.done()
    step = max(int(P.fs / k), 1)
    t = np.arange(len(rows)) / P.fs
    idx = np.append(np.arange(0, len(rows) - 1, step), len(rows) - 1)
    r = rows[idx]
    E = frame["axes"]
    p = frame["point"] + r[:, :1] * E[0] + r[:, 1:2] * E[1] + r[:, 2:3] * E[2]
    turn = r[:, 3:4] * E[0] + r[:, 4:5] * E[1] + r[:, 5:6] * E[2]
    R = expm(turn) @ frame["R0"]
    q, err = A.inverse(p, R)
    m = int(t[-1] * fs)
    tt = np.arange(m) / fs
    return tt, CubicSpline(t[idx], q)(tt), phase[np.minimum((tt * P.fs).astype(int), len(phase) - 1)], err


def fourier(rng, nq, base, mid, half, vmax, amax, harmonics=5, slow=0.35, ramp=0.6, fs=500.0, periods=2.0):
    """identification trajectory (Swevers et al.): sums of sines, played at full and at reduced speed; within mid +- half, vmax, amax."""
    T = 1 / base
    s_end = periods * T
    # play speed: full, slow, full; smooth in between
    speeds = [1.0, slow, 1.0] if slow < 1 else [1.0]
    parts = [s_end * 0.5, s_end * 0.28 * slow / 0.35, s_end * 0.22] if slow < 1 else [s_end]
    sd = []
    for v, s in zip(speeds, parts):
        sd += [v] * int(s / v * fs)
    sd = np.array(sd)
    w = int(ramp * fs) | 1
    sd = np.convolve(np.pad(sd, w // 2, mode="edge"), np.hanning(w + 2)[1:-1] / np.hanning(w + 2).sum(), "valid")
    s = np.cumsum(sd) / fs
    q = np.zeros((len(s), nq))
    for j in range(nq):
        x = v = a = 0
        for l in range(1, harmonics + 1):
            A, B = rng.normal(size=2) / l ** 0.5
            w_ = 2 * np.pi * base * l
            x = x + A / w_ * np.sin(w_ * s) - B / w_ * np.cos(w_ * s)
            v = v + A * np.cos(w_ * s) + B * np.sin(w_ * s)
            a = a - A * w_ * np.sin(w_ * s) + B * w_ * np.cos(w_ * s)
        x = x - (x.max() + x.min()) / 2
        f = min(half[j] / np.abs(x).max(), vmax[j] / np.abs(v).max(), amax[j] / np.abs(a).max())
        q[:, j] = mid[j] + f * x
    return np.arange(len(s)) / fs, q


def follow(dt, cmd, omega, zeta):
    return laws.tracking(dt, np.ascontiguousarray(cmd), np.asarray(omega, float), np.asarray(zeta, float))
