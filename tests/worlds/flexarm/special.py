"""What the catalogue doesn't hold (group `outside`), and motions that can't show a hidden effect (group `unexcited`)."""
from __future__ import annotations

import numpy as np
from scipy.signal import lfilter

from measure import logu
from motion import Path


def pulses(rng, t, n, width):
    """n half-sine pushes at random times."""
    out = np.zeros(len(t))
    at = np.sort(rng.uniform(0.05, 0.9, n)) * t[-1]
    for a in at:
        w = rng.uniform(*width)
        x = (t - a) / w
        out += np.where((x > 0) & (x < 1), np.sin(np.pi * np.clip(x, 0, 1)), 0) * rng.choice([-1, 1]) * rng.uniform(0.5, 1)
    return out


def oscillator(u, dt, f, zeta):
    """A lightly damped resonance driven by u, unit static gain (semi-implicit, discretised)."""
    w = 2 * np.pi * f
    a1, a2 = 2 * np.exp(-zeta * w * dt) * np.cos(w * dt * np.sqrt(1 - zeta ** 2)), -np.exp(-2 * zeta * w * dt)
    return lfilter([1 - a1 - a2], [1, -a1, -a2], u, axis=0)


class Outside:
    """An addition to the true readings, of strength amps['outside'] (N, N m or relative)."""
    KINDS = {"wrench": ["hose", "hand", "bench", "cogging"], "tester": ["bench", "jumps", "cracks"], "joints": ["hand", "slosh"], "drive": ["machine", "jumps"]}
    SAYS = {"hose": "a hose pulls the tool towards an anchor, more when taut, and swings at its own frequency", "hand": "somebody pushes now and then",
            "bench": "the material's support vibrates by itself (a beat of two frequencies)", "cogging": "the sensor picks up a drive's field: a sine of a joint's angle times its speed",
            "jumps": "a loose connector: the zero jumps at random", "cracks": "the material snaps: force drops suddenly and recovers within a fraction of a second",
            "slosh": "a liquid load swings at its own frequency", "machine": "another machine on the shaft: a torque periodic in time"}

    def __init__(self, rng, kind, name=None):
        self.kind = name or str(rng.choice(self.KINDS[kind]))
        self.seed = int(rng.integers(2 ** 31))
        self.unit = {"hose": 1.0, "hand": 1.0, "bench": 0.3, "cogging": 1.0, "jumps": 1.0, "cracks": 1.0, "slosh": 1.0, "machine": 1.0}[self.kind]

    def wrench(self, case, r, amps):
        rng = np.random.default_rng(self.seed)
        a, t = amps["outside"], r["t"]
        dt = t[1] - t[0]
        n = len(t)
        tip = case.arm.tip
        if self.kind == "hand":
            u = rng.normal(size=3)
            F = pulses(rng, t, int(t[-1] / 5) + 2, (0.3, 1.5))[:, None] * (u / np.linalg.norm(u)) * a
            F = np.einsum("nij,nj->ni", r["RT"], F)
            return np.column_stack([F, np.cross(0.5 * tip, F)])
        if self.kind == "hose":
            anchor = case.point + np.array([rng.uniform(-0.2, 0.2), rng.uniform(-0.2, 0.2), 0.35])
            d = anchor - r["X"]
            L = np.linalg.norm(d, axis=1)
            taut = np.clip(L - np.percentile(L, 30), 0, None) / (np.ptp(L) + 1e-9)
            acc = np.gradient(np.gradient(r["X"], dt, axis=0), dt, axis=0)
            swing = oscillator(acc, dt, rng.uniform(0.7, 1.6), 0.03)
            F = a * (d / L[:, None] * taut[:, None] + 2.5 * swing)
            F = np.einsum("nij,nj->ni", r["RT"], F)
            return np.column_stack([F, np.cross(0.3 * tip, F)])
        if self.kind == "bench":
            z = self.beat(rng, t) * (r["N"] > 0.02 * case.cp0["Fmax"])
            F = np.column_stack([np.zeros((n, 2)), -a * z])
            return np.column_stack([F, np.cross(tip, F)])
        j = int(rng.integers(case.arm.n))
        k = rng.integers(20, 45)
        s = np.sin(k * r["q"][:, j] + 1.0) * np.tanh(np.abs(r["dq"][:, j]) / 0.05)
        c = rng.uniform(0.4, 1, 6) * np.r_[1, 1, 1, 0.03, 0.03, 0.03]
        return a * (s[:, None] + 0.4 * self.beat(rng, t)[:, None]) * c

    @staticmethod
    def beat(rng, t):
        f = rng.uniform(3, 9)
        g = f * rng.uniform(1.05, 1.35)
        wob = np.cumsum(lfilter([0.001], [1, -0.999], rng.normal(size=len(t)))) * (t[1] - t[0]) * 3
        return 0.6 * np.sin(2 * np.pi * f * t + wob) + 0.4 * np.sin(2 * np.pi * g * t + 2 * wob)

    @staticmethod
    def steps(rng, t, n):
        out = np.zeros(len(t))
        lv = 0.0
        for a in np.sort(rng.uniform(0.03, 0.97, n)) * t[-1]:
            new = rng.choice([-1, 0.0, 1.0, 0.5])
            out[t >= a] += new - lv
            lv = new
        return out

    def tester(self, case, r, amps):
        rng = np.random.default_rng(self.seed)
        a, t = amps["outside"], r["t"]
        out = np.zeros_like(r["Y"])
        on = r["Y"][:, 0] > 0.02 * case.cp0["Fmax"]
        if self.kind == "bench":
            out[:, 0] = a * self.beat(rng, t) * on
        elif self.kind == "jumps":
            out[:, 0] = a * self.steps(rng, t, int(t[-1] / 2) + 4)
        else:
            k = np.flatnonzero(on)
            for i in np.sort(rng.choice(k, max(10, int(len(k) * (t[1] - t[0]) / 0.7)), replace=False)):
                out[:, 0] -= np.where(t >= t[i], np.exp(-np.clip(t - t[i], 0, None) / rng.uniform(0.05, 0.3)), 0) * a * rng.uniform(0.4, 1.2)
            out[:, 0] *= on
        return out

    def joints(self, case, r, amps):
        rng = np.random.default_rng(self.seed)
        a, t = amps["outside"], r["t"]
        n = r["Y"].shape[1]
        sc = case.scale
        if self.kind == "hand":
            return a * np.column_stack([pulses(rng, t, int(t[-1] / 5) + 3, (0.4, 1.6)) * s for s in sc])
        if self.kind == "slosh":
            dt = t[1] - t[0]
            acc = np.gradient(r["dq"], dt, axis=0)
            s = oscillator(acc, dt, rng.uniform(0.8, 1.6), 0.02)
            s2 = oscillator(acc, dt, rng.uniform(1.7, 2.6), 0.02)
            return 0.25 * a * (s + s2) @ (np.eye(n) + 0.5 * rng.uniform(-1, 1, (n, n))) * sc
        if self.kind == "jumps":
            return a * self.steps(rng, t, int(t[-1] / 1.2) + 6)[:, None] * sc
        return 1.3 * a * self.beat(rng, t * 0.25)[:, None] * sc


def straight_plan(rng, dmax):
    """Never turned: pokes and slides at one tool angle."""
    p = Path(start=[0.03, 0, 0, 0, 0, 0])
    p.hold(1.0, "rest").move(1.2, "approach", h=0.004)
    for f in rng.permutation([0.4, 0.7, 1.0, 0.85]):
        v = logu(rng, 0.006, 0.03)
        p.ramp(v, "poke", h=-f * dmax).hold(0.6, "hold").ramp(v, "retract", h=0.003).hold(0.5, "rest")
    for f in (0.5, 0.9):
        p.ramp(0.015, "approach", h=-f * dmax).hold(0.3, "hold")
        for v in (0.015, 0.03):
            p.ramp(v, "slide", s1=0.015).ramp(v, "slide", s1=-0.01).ramp(v, "slide", s2=0.015).ramp(v, "slide", s2=-0.01).ramp(v, "slide", s1=0, s2=0)
        p.ramp(0.015, "retract", h=0.004).hold(0.4, "rest")
    p.move(1.0, "free", h=0.03).hold(1.0, "rest")
    return p


def one_load_plan(rng, dmax):
    """Turns in the air, pokes, then slides at a single depth."""
    p = Path(start=[0.04, 0, 0, 0, 0, 0])
    p.hold(0.5, "rest")
    for a1, a2, y in ((0.4, 0, 0), (-0.4, 0.2, 0.5), (0, 0.4, -0.5), (0, 0, 0)):
        p.move(1.2, "free", a1=a1, a2=a2, yaw=y)
    p.move(1.2, "approach", h=0.004)
    for f in (0.5, 0.8, 1.0):
        v = logu(rng, 0.008, 0.03)
        p.ramp(v, "poke", h=-f * dmax).hold(0.3, "hold").ramp(v, "retract", h=0.003).hold(0.4, "rest")
    p.ramp(0.02, "approach", h=-0.8 * dmax)
    for v in (0.015, 0.025, 0.04):
        p.ramp(v, "slide", s1=0.018).ramp(v, "slide", s1=-0.012).ramp(v, "slide", s2=0.018).ramp(v, "slide", s2=-0.012).ramp(v, "slide", s1=0, s2=0)
    p.ramp(0.02, "retract", h=0.004).hold(0.4, "rest").move(1.0, "free", h=0.04).move(1.0, "free", a1=0.3).move(1.0, "free", a1=0)
    return p


# hidden effect -> (kind, model, plan, fixed amplitude, shape changes)
UNEXCITED = {
    "wrench": {
        "sensor-gain": dict(model="kelvin-voigt,coulomb-friction,sensor-bias", plan=straight_plan, a=0.08),
        "tool-com": dict(model="hunt-crossley,coulomb-friction,sensor-bias", plan=straight_plan, a=0.004),
        "saturation": dict(model="kelvin-voigt,coulomb-friction", a=-0.3),
        "stiffening-layer": dict(model="hunt-crossley,coulomb-friction", a=1.5, shape=dict(ld=1.8)),
    },
    "tester": {
        "stiffening-layer": dict(model="kelvin-voigt", a=1.5, shape=dict(ld=1.7)),
        "saturation": dict(model="hunt-crossley", a=-0.3),
        "relaxation": dict(model="kelvin-voigt", a=0.2, shape=dict(tau=900.0)),
    },
}
