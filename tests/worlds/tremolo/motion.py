"""Experiments as a careful person would script them: tip paths for the arm, crosshead programmes for testers, excitation for free arms and drives.
Path state: [x along t1, y along t2, height over the surface, three rotation-vector components about the tip (tool axes)]."""
import numpy as np
from chain import rotvec


def jerk(u):
    return u ** 3 * (10 - 15 * u + 6 * u * u)


class Script:
    def __init__(self, start, fs=200.0):
        self.fs, self.now, self.rows, self.tags = fs, np.array(start, float), [], []

    @property
    def time(self):
        return len(self.rows) / self.fs

    def _emit(self, arr, tag):
        self.rows.extend(list(arr)); self.tags.extend([tag] * len(arr))

    def hold(self, T, tag):
        n = max(1, int(T * self.fs))
        self._emit(np.repeat(self.now[None], n, 0), tag)

    def to(self, T, tag, **kw):
        goal = self._goal(kw)
        n = max(2, int(T * self.fs))
        u = jerk(np.arange(1, n + 1) / n)[:, None]
        self._emit(self.now + (goal - self.now) * u, tag)
        self.now = goal

    def glide(self, speed, tag, ramp=0.12, **kw):
        """Constant speed with smooth ramps."""
        goal = self._goal(kw)
        L = np.linalg.norm((goal - self.now)[:3])
        if L < 1e-9:
            return
        T = L / speed + ramp
        n = max(3, int(T * self.fs))
        t = np.arange(1, n + 1) / self.fs
        v = np.minimum(1, np.minimum(jerk(np.clip(t / ramp, 0, 1)), jerk(np.clip((n / self.fs - t) / ramp, 0, 1))))
        u = np.cumsum(v); u /= u[-1]
        self._emit(self.now + (goal - self.now) * u[:, None], tag)
        self.now = goal

    def osc(self, amp, freq, T, tag, second=0.0):
        t = np.arange(1, int(T * self.fs) + 1) / self.fs
        env = np.minimum(1, np.minimum(jerk(np.clip(t / 0.4, 0, 1)), jerk(np.clip((t[-1] - t) / 0.4, 0, 1))))
        s = env * (np.sin(2 * np.pi * freq * t) + second * np.sin(2 * np.pi * 1.7 * freq * t + 0.6))
        self._emit(self.now + np.outer(s, amp), tag)

    def _goal(self, kw):
        g = self.now.copy()
        for k, v in kw.items():
            g[{"x": 0, "y": 1, "h": 2, "a": 3, "b": 4, "c": 5}[k]] = v
        return g

    def arrays(self):
        r = np.array(self.rows)
        from scipy.ndimage import gaussian_filter1d
        r = gaussian_filter1d(r, 1.6, axis=0, mode="nearest")
        return np.arange(len(r)) / self.fs, r, np.array(self.tags)


def wrench_script(rng, dmax, press, opt):
    """press(depth) -> commanded depth that reaches it under the compliant controller. opt: switches and emphases."""
    H = rng.uniform(0.05, 0.09)
    s = Script([0, 0, H, 0, 0, 0])
    ang = opt.get("turn", rng.uniform(0.4, 0.75))
    flip = lambda: rng.choice([-1, 1])

    def air(k, fast=True):
        s.hold(rng.uniform(0.4, 0.8), "free")
        for _ in range(k):
            w = rng.normal(size=3); w *= ang * rng.uniform(0.7, 1) / np.linalg.norm(w); w[2] *= 1.3
            s.to(rng.uniform(0.8, 1.3), "free", a=w[0], b=w[1], c=w[2])
            s.hold(rng.uniform(0.2, 0.5), "free")
        if fast:
            for _ in range(opt.get("shakes", 2)):
                amp = np.zeros(6)
                amp[rng.integers(0, 3)] = 0.012 * flip()
                amp[3:] = rng.normal(size=3); amp[3:] *= opt.get("shake", 0.09) / np.linalg.norm(amp[3:])
                s.osc(amp, rng.uniform(1.5, 2.8), rng.uniform(1.4, 2.2), "free", 0.5)
        s.to(rng.uniform(0.9, 1.3), "free", a=0, b=0, c=0)

    def poke(x, y, depth, speed, hold, inner=False, a=0.0, b=0.0, out=None):
        s.to(rng.uniform(0.6, 1.0), "approach", x=x, y=y, h=rng.uniform(0.003, 0.006), a=a, b=b)
        D = press(depth)
        T = (s.now[2] + D) / speed
        s.to(max(0.12, T * rng.uniform(0.9, 1.2)), "poke", h=-D)
        s.hold(hold, "hold")
        if inner:
            for f in rng.uniform(0.35, 0.8, opt.get("loops", 1)):
                s.to(max(0.15, D * (1 - f) / speed), "poke", h=-press(depth * f))
                s.to(max(0.15, D * (1 - f) / (speed * rng.uniform(0.5, 3))), "poke", h=-D)
                s.hold(0.3, "hold")
        s.to(max(0.15, 1.3 * D / (out or speed * rng.choice([0.6, 1.5]))), "retract", h=rng.uniform(0.003, 0.006))
        s.hold(0.2, "rest")

    def slides(depth, lines):
        x, y = s.now[0], s.now[1]
        D = press(depth)
        s.to(0.6, "approach", h=0.003, a=0, b=0)
        s.to(0.5, "poke", h=-D)
        s.hold(0.5, "hold")
        for dx, dy, v in lines:
            s.glide(v, "slide", x=np.clip(s.now[0] + dx, -0.045, 0.045), y=np.clip(s.now[1] + dy, -0.045, 0.045))
            s.hold(rng.uniform(0.12, 0.4), "rest")
        if opt.get("micro", True):
            th = rng.uniform(0, 2 * np.pi) if opt.get("two", True) else 0.0
            fine = opt.get("fine", False)      # strokes inside the bristle's length only where that's what is asked
            u = np.array([np.cos(th), np.sin(th)]) * (rng.uniform(0.8, 2.0) if fine else rng.uniform(2.5, 4)) * 1e-3
            for sg in (1, -1, 1, -1):
                s.glide(rng.uniform(0.003, 0.006) * (1 if fine else 2), "slide", ramp=0.1, x=s.now[0] + sg * u[0], y=s.now[1] + sg * u[1])
                s.hold(0.15, "rest")
        s.hold(0.3, "rest")
        s.to(0.5, "retract", h=rng.uniform(0.003, 0.006))

    def lines(lead):
        """Every speed both ways along one tangent, the middle one along the other too."""
        sp, two = opt.get("speeds", [0.006, 0.02, 0.05]), opt.get("two", True)
        out = []
        mid = sorted(sp)[len(sp) // 2]
        if lead and not opt.get("slow_twice", False):
            sp = sp[1:]
        for v in rng.permutation(sp):
            L = min(0.035, max(0.005, v * rng.uniform(0.4, 0.65)))
            sg = flip()
            for ax in ((0, 1) if two and v == mid else (lead if two else 0,)):
                d = (sg * L, 0) if ax == 0 else (0, sg * L)
                out += [(d[0], d[1], v), (-d[0], -d[1], v)]
        if two:
            L = rng.uniform(0.008, 0.015)
            out += [(L * flip(), L * flip(), sp[-1])]
        return out

    for cycle in range(opt.get("cycles", 1)):
        if opt.get("air", True):
            air(opt.get("turns", int(rng.integers(2, 4))))
        pl = opt.get("places", [(0, 0)])
        deep = opt.get("depths", [0.35, 0.65, 1.0])
        speeds = rng.permutation(opt.get("poke_speeds", [0.006, 0.015, 0.035]))
        for i, f in enumerate(deep):
            x, y = pl[i % len(pl)]
            poke(x, y, dmax * f * rng.uniform(0.95, 1.0), speeds[i % len(speeds)], rng.uniform(*opt.get("holds", (0.4, 1.2))), inner=opt.get("inner", i % 2 == 0),
                 out=opt.get("out"))
        if opt.get("tilts", True):
            for i in range(opt.get("ntilt", 1)):
                w = rng.choice([-1, 1]) * rng.uniform(0.14, 0.24)
                poke(pl[0][0], pl[0][1], dmax * rng.uniform(0.5, 0.75), speeds[-1], 0.3, a=w if i else 0, b=0 if i else w)
        if opt.get("slide", True):
            for lead, f in enumerate(opt.get("slide_depths", [0.4, 0.8])):
                s.to(0.7, "approach", x=rng.uniform(-0.01, 0.01), y=rng.uniform(-0.01, 0.01), h=0.005, a=0, b=0)
                slides(dmax * f, lines(lead % 2))
        x, y = pl[0]
        poke(x, y, dmax * deep[-1] * 0.93, 0.01, rng.uniform(*opt.get("last", (1., 2.5))), inner=opt.get("inner", True), out=opt.get("out"))
        s.to(0.8, "free", h=H)
        if cycle + 1 < opt.get("cycles", 1):
            s.hold(opt.get("pause", 2.0), "free")
    if opt.get("air", True):
        air(1, fast=False)
    s.hold(0.4, "free")
    return s.arrays()


def to_world(arr, frame, R0):
    X = frame[0] + arr[:, :1] * frame[2] + arr[:, 1:2] * frame[3] + arr[:, 2:3] * frame[1]
    R = np.array([R0 @ rotvec(w) for w in arr[:, 3:]])
    return X, R


def tester_script(rng, dmax, slide, opt):
    """Commanded depth and place of a material tester: ramps of several speeds, holds, sine sweeps, partial unloading, slides under load."""
    s = Script([0, 0, 0.002, 0, 0, 0], fs=500.0)
    pause = opt.get("pause", 0.3)
    deep = opt.get("depths", [0.3, 0.6, 1.0, 0.8])
    speeds = opt.get("poke_speeds", [0.002, 0.008, 0.03])
    pl = opt.get("places", [(0, 0)])
    for cycle in range(opt.get("cycles", 1)):
        for i, f in enumerate(deep):
            x, y = pl[i % len(pl)]
            if abs(s.now[0] - x) + abs(s.now[1] - y) > 1e-9:
                s.to(0.8, "free", x=x, y=y)
            v = speeds[(i + cycle) % len(speeds)] * rng.uniform(0.8, 1.25)
            D = dmax * f * rng.uniform(0.95, 1)
            s.hold(pause, "free")
            s.glide(v, "poke", ramp=0.05, h=-D)
            s.hold(rng.uniform(*opt.get("holds", (0.5, 2.0))), "hold")
            if opt.get("inner", True) and i % 2 == 0:
                for g in rng.uniform(0.4, 0.8, 2):
                    s.glide(v * rng.uniform(0.5, 2), "poke", ramp=0.05, h=-D * g)
                    s.glide(v * rng.uniform(0.5, 2), "poke", ramp=0.05, h=-D)
                s.hold(0.4, "hold")
            s.glide(opt.get("out", v * rng.choice([0.5, 1.0])), "retract", ramp=0.05, h=0.002)
        if opt.get("sweep", True):
            s.glide(0.006, "poke", ramp=0.05, h=-dmax * 0.55)
            s.hold(0.5, "hold")
            for fr in opt.get("freqs", [0.4, 2.0, 6.0]):
                s.osc([0, 0, -dmax * rng.uniform(0.12, 0.25) * min(1, 2.0 / fr) ** 0.4, 0, 0, 0], fr, max(2.0, 2.5 / fr), "sweep")
            s.glide(opt.get("out", 0.006), "retract", ramp=0.05, h=0.002)
        if slide:
            for f in opt.get("slide_depths", [0.4, 0.85]):
                s.hold(pause, "free")
                s.glide(0.006, "poke", ramp=0.05, h=-dmax * f)
                s.hold(0.6, "hold")
                for v in rng.permutation(opt.get("speeds", [0.004, 0.015, 0.05])):
                    L = min(0.02, max(0.006, v * 0.5))
                    sg = rng.choice([-1, 1])
                    moves = [(sg, 0), (-sg, 0)] + ([(0, sg), (0, -sg)] if opt.get("two", True) else [])
                    for dx, dy in moves:
                        s.glide(v, "slide", ramp=0.06, x=s.now[0] + dx * L, y=s.now[1] + dy * L)
                        s.hold(rng.uniform(0.15, 0.5), "rest")
                for sg in (1, -1, 1, -1):
                    s.glide(0.003, "slide", ramp=0.05, x=s.now[0] + sg * 0.0012)
                    s.hold(0.15, "rest")
                s.glide(0.01, "retract", ramp=0.05, h=0.002)
                s.to(0.8, "free", x=0, y=0)
        x, y = pl[0]
        s.to(0.6, "free", x=x, y=y)
        s.glide(0.006, "poke", ramp=0.05, h=-dmax * deep[-1])
        s.hold(rng.uniform(*opt.get("last", (2.0, 5.0))), "hold")
        s.glide(opt.get("out", 0.006), "retract", ramp=0.05, h=0.002)
        s.hold(opt.get("gap", 0.5), "free")
    return s.arrays()
