"""Commanded motions: pokes, slides and free swings of a tip in the frame of a surface, and joint excitations (SI units)."""
from __future__ import annotations
import numpy as np
from scipy.spatial.transform import Rotation


class Path:
    """Builds a command for the tip: place (slip1, slip2, depth) [m], tilt (three angles [rad]) and a phase label a sample."""

    def __init__(self, dt: float, start=(0.0, 0.0, -0.015)):
        self.dt, self.x, self.a = dt, np.array(start, float), np.zeros(3)
        self.X, self.A, self.ph = [], [], []

    def _put(self, X: np.ndarray, A: np.ndarray, phase: str) -> None:
        self.X.append(X)
        self.A.append(A)
        self.ph += [phase] * len(X)
        self.x, self.a = X[-1].copy(), A[-1].copy()

    def to(self, x, T: float, phase: str, tilt=None, flat: bool = False) -> "Path":
        """Moves within T [s]: minimum jerk, or flat: constant speed with short cosine ramps."""
        n = max(int(T / self.dt), 4)
        u = np.arange(1, n + 1) / n
        if flat:
            r = 0.12
            v = np.where(u < r, 0.5 - 0.5 * np.cos(np.pi * u / r), np.where(u > 1 - r, 0.5 - 0.5 * np.cos(np.pi * (1 - u) / r), 1.0))
            s = np.cumsum(v) / v.sum()
        else:
            s = u ** 3 * (10 - 15 * u + 6 * u * u)
        x1, a1 = np.array(x, float), self.a if tilt is None else np.array(tilt, float)
        self._put(self.x + s[:, None] * (x1 - self.x), self.a + s[:, None] * (a1 - self.a), phase)
        return self

    def hold(self, T: float, phase: str) -> "Path":
        """Stands still for T [s]."""
        return self.to(self.x, T, phase)

    def swing(self, T: float, amp_x, amp_a, f, phase: str = "free") -> "Path":
        """Sines around the present pose that begin and end softly: amplitudes [m], [rad], frequencies f [Hz] of the six."""
        n = int(T / self.dt)
        t = np.arange(n) * self.dt
        win = np.clip(np.minimum(t, T - t) / min(0.8, T / 3), 0, 1)
        win = (win ** 2 * (3 - 2 * win))[:, None]
        S = np.sin(2 * np.pi * t[:, None] * np.array(f))
        self._put(self.x + win * S[:, :3] * amp_x, self.a + win * S[:, 3:] * amp_a, phase)
        return self

    def command(self, surf: np.ndarray, R0: np.ndarray):
        """Tip position and velocity, orientation and angular velocity in the base frame, and the phases."""
        X, A = np.vstack(self.X), np.vstack(self.A)
        x = surf[0] + X[:, :1] * surf[2] + X[:, 1:2] * surf[3] - X[:, 2:] * surf[1]
        Rot = Rotation.from_matrix(R0) * Rotation.from_euler("xyz", A)
        R = Rot.as_matrix()
        w = np.zeros_like(x)
        w[:-1] = (Rot[1:] * Rot[:-1].inv()).as_rotvec() / self.dt
        return x, np.gradient(x, self.dt, axis=0), np.ascontiguousarray(R), w, np.array(self.ph)


def free_part(p: Path, rng: np.random.Generator, T: float, hard: float = 1.0, high: float = 0.03) -> None:
    """Rises, turns the tool about its axes and shakes it, returns."""
    x = p.x.copy()
    p.to([x[0], x[1], -high - 0.02], 1.0, "free")
    p.swing(T, np.array([0.02, 0.02, 0.01]) * hard, np.array([0.75, 0.75, 0.6]), rng.uniform([0.5, 0.5, 0.5, 0.2, 0.25, 0.2], [1.2, 1.2, 1.2, 0.5, 0.5, 0.5]))
    if hard > 1:
        p.swing(T / 2, np.zeros(3), np.array([0.22, 0.22, 0.5]), rng.uniform([1, 1, 1, 1.6, 1.6, 1.4], [1, 1, 1, 2.4, 2.4, 2.2]))
        p.swing(T / 3, np.array([0.012, 0.012, 0.01]), np.zeros(3), rng.uniform([2.5, 2.5, 2.5, 1, 1, 1], [4, 4, 4, 1, 1, 1]))


def pokes(p: Path, rng: np.random.Generator, dmax: float, gain: float, n: int, places=None, hold=(0.3, 1.2), tilt: float = 0.0, slow: bool = False,
          quick: bool = False, fresh: bool = False) -> None:
    """n pokes up to dmax [m] of different speed and depth; gain stretches the command for the softness of the control."""
    depths = dmax * rng.permutation(np.linspace(0.4, 1.0, n))
    depths = np.sort(depths) if fresh else depths
    speeds = rng.permutation(np.geomspace(0.004 if slow else 0.009, 0.12 if quick else 0.06, n))
    for i in range(n):
        x = np.zeros(2) if places is None else places[i % len(places)]
        a = [tilt * np.cos(2.4 * i), tilt * np.sin(2.4 * i), 0.0]
        c = depths[i] * gain
        p.to([*x, -0.006], 0.5, "approach", tilt=a)
        for _ in range(2 if fresh and i % 2 else 1):
            T = max(1.6 * (c + 0.006) / speeds[i], 0.12)
            p.to([*x, c], T, "poke")
            p.hold(rng.uniform(*hold), "hold")
            p.to([*x, -0.006], max(1.6 * (c + 0.006) / (speeds[i] * rng.uniform(0.6, 1.2)), 0.12), "retract")
    p.to([*p.x[:2], -0.012], 0.6, "free", tilt=[0, 0, 0])
    p.hold(0.5, "rest")


def slides(p: Path, rng: np.random.Generator, depths, gain: float, speeds, half: float, both: bool = True, dwell: float = 0.15) -> None:
    """Strokes of +-half [m] in both directions, along both tangents (or the first), at every depth [m] and speed [m/s]."""
    for d in depths:
        p.to([0, 0, -0.005], 0.5, "approach")
        p.to([0, 0, d * gain], 0.5, "poke")
        p.hold(0.2, "hold")
        for j, v in enumerate(speeds):
            for e in ([np.array([1.0, 0]), np.array([0, 1.0])] if both else [np.array([1.0, 0])]):
                off = half * (0.8 + 0.2 * (j % 2)) * e
                for q in (off, -off, np.zeros(2)):
                    p.to([*q, d * gain], 1.13 * np.linalg.norm(q - p.x[:2]) / v, "slide", flat=True)
                    p.hold(dwell, "hold")
        p.to([*p.x[:2], -0.01], 0.5, "retract")
    p.hold(0.4, "rest")


def joint_motion(rng: np.random.Generator, T: float, dt: float, centre: np.ndarray, amp: np.ndarray, vmax: np.ndarray, amax: np.ndarray, slow: bool, fmax: float = 1.0):
    """Joint angles, rates, accelerations: random point-to-point moves of different speed (some of them very slow), smoothed, plus a fading multisine."""
    n, nj = int(T / dt), len(centre)
    t = np.arange(n) * dt
    q = np.tile(centre, (n, 1))
    win = np.clip(t / 1.5, 0, 1)
    win = win ** 3 * (10 - 15 * win + 6 * win * win)
    for j in range(nj):
        k, x, u = 0, centre[j], []
        while k < n:
            y = centre[j] + amp[j] * rng.uniform(0.35, 1) * (-1 if x > centre[j] else 1)
            v = vmax[j] * (rng.choice([0.04, 0.12, 0.35, 0.8]) if slow else rng.uniform(0.25, 0.9))
            if v < 0.1 * vmax[j]:
                y = x + np.sign(y - x) * min(abs(y - x), v * 2.0)
            m = max(int(1.9 * abs(y - x) / v / dt), int(0.7 / dt), int(np.sqrt(5.8 * abs(y - x) / amax[j]) / dt), 8)
            s = np.arange(1, m + 1) / m
            u.append(x + (y - x) * s ** 3 * (10 - 15 * s + 6 * s * s))
            x, k = y, k + m
        q[:, j] = np.concatenate(u)[:n]
        if not slow:
            fr = rng.uniform(0.3, 1.0, 3) * fmax
            for f in fr:
                q[:, j] += min(0.25 * vmax[j] / (2 * np.pi * f), 0.15 * amp[j], 0.2 * amax[j] / (2 * np.pi * f) ** 2) * np.sin(2 * np.pi * f * t) * win
    dq = np.gradient(q, dt, axis=0)
    return t, q, dq, np.gradient(dq, dt, axis=0)
