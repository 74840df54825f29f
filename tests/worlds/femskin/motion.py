"""Kinematic motion: paths in contact coordinates, inverse kinematics of the LWR4+ (Pinocchio), quintic joint splines."""
from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import pinocchio as pin
from scipy.interpolate import make_interp_spline

def _shape(u: np.ndarray, f: float) -> np.ndarray:
    """0..1 over u in 0..1: velocity ramps up and down over the fraction f by a cubic, constant between."""
    ramp = lambda x: f * (x**3 - 0.5 * x**4)
    s = np.where(u < f, ramp(np.clip(u / f, 0, 1)), f / 2 + (u - f))
    return np.where(u > 1 - f, 1 - f - ramp(np.clip((1 - u) / f, 0, 1)), s) / (1 - f)

@dataclass
class Path:
    """Way points (s1, s2, depth [m], rx, ry, rz [rad]) with smooth legs between; `labels` a phase for each leg."""
    x: np.ndarray = field(default_factory=lambda: np.array([0, 0, -0.03, 0, 0, 0.0]))
    legs: list = field(default_factory=list)
    t: float = 0.0

    def go(self, label: str, duration: float, ramp: float = 0.25, **to: float) -> "Path":
        """Leg to new coordinates (s1=, s2=, d=, rx=, ry=, rz=) in `duration` s."""
        y = self.x.copy()
        for key, value in to.items():
            i = ("s1", "s2", "d", "rx", "ry", "rz").index(key)
            y[i] = value
        self.legs.append((self.t, duration, self.x, y, label, ramp))
        self.t, self.x = self.t + duration, y
        return self

    def move(self, label: str, speed: float, ramp: float = 0.25, **to: float) -> "Path":
        """Leg at a plateau speed [m/s]."""
        x0, n = self.x, len(self.legs)
        self.go(label, 1.0, ramp, **to)
        dist = np.linalg.norm(self.x[:3] - x0[:3])
        T = max(dist / speed / (1 - ramp), 0.05)
        t, _, a, b, lab, r = self.legs[n]
        self.legs[n] = (t, T, a, b, lab, r)
        self.t = t + T
        return self

    def at(self, t: np.ndarray) -> np.ndarray:
        """Coordinates at times t (n x 6)."""
        out = np.tile(self.legs[0][2], (len(t), 1)) if self.legs else np.tile(self.x, (len(t), 1))
        for t0, T, a, b, _, r in self.legs:
            k = t >= t0
            out[k] = a + _shape(np.clip((t[k] - t0) / T, 0, 1), r)[:, None] * (b - a)
        return out

    def phase(self, t: np.ndarray) -> np.ndarray:
        starts, labels = np.array([leg[0] for leg in self.legs]), np.array([leg[4] for leg in self.legs])
        return labels[np.clip(np.searchsorted(starts, t, side="right") - 1, 0, len(starts) - 1)]

def wander(rng: np.random.Generator, t: np.ndarray, n: int, amp: float) -> np.ndarray:
    """Servo error: n smooth signals of rms `amp` (sines of 0.3 to 5 Hz)."""
    f, ph = rng.uniform(0.3, 5, (n, 5)), rng.uniform(0, 2 * np.pi, (n, 5))
    w = rng.uniform(0.3, 1, (n, 5)) / np.sqrt(1 + f)
    y = np.einsum("nk,nkt->tn", w, np.sin(2 * np.pi * f[:, :, None] * t + ph[:, :, None]))
    return amp * y / np.sqrt(np.mean(y**2, axis=0))

@dataclass
class Kin:
    """Motion at times t: contact coordinates (SI) and, for arms, the sensor's rotation and accelerations (base frame)."""
    t: np.ndarray
    d: np.ndarray
    dd: np.ndarray
    s: np.ndarray                # n x 2
    v: np.ndarray                # n x 2
    rot: np.ndarray | None = None    # n x 3 x 3, sensor to base
    acc: np.ndarray | None = None    # sensor origin, m/s^2
    om: np.ndarray | None = None     # rad/s
    al: np.ndarray | None = None     # rad/s^2

    def take(self, i: np.ndarray) -> "Kin":
        return Kin(**{k: (None if v is None else v[i]) for k, v in self.__dict__.items()})

class Arm:
    """The LWR4+ above a horizontal surface at `point` [m, base frame]; tool z points down, yawed by `yaw` rad."""

    def __init__(self, urdf: str):
        self.model = pin.buildModelFromUrdf(urdf)
        self.data = self.model.createData()
        self.tip, self.sensor = self.model.getFrameId("tool_tip"), self.model.getFrameId("ft_sensor")

    def ik(self, path: Path, point: np.ndarray, yaw: float, rng: np.random.Generator, servo: float):
        """Joint spline (quintic) that follows `path`; `servo` rms joint error [rad]."""
        rate = 80.0 if path.t < 80 else 40.0
        t = np.arange(0, path.t + 1.5 / rate, 1 / rate)
        x, base = path.at(t), pin.rpy.rpyToMatrix(np.pi, 0, yaw)
        q, out = np.array([np.arctan2(point[1], point[0]), -0.5, 0.0, 1.2, 0.0, -1.2, 0.0]), np.empty((len(t), 7))
        for i in range(len(t)):
            goal = pin.SE3(base @ pin.rpy.rpyToMatrix(*x[i, 3:]), point + np.array([x[i, 0], x[i, 1], -x[i, 2]]))
            for _ in range(300 if i == 0 else 8):
                pin.forwardKinematics(self.model, self.data, q)
                pose = pin.updateFramePlacement(self.model, self.data, self.tip)
                err = pin.log6(pose.inverse() * goal).vector
                if np.abs(err).max() < 1e-9: break
                J = pin.computeFrameJacobian(self.model, self.data, q, self.tip)
                step = J.T @ np.linalg.solve(J @ J.T + 1e-8 * np.eye(6), err)
                q = q + step * min(1.0, 0.3 / max(np.abs(step).max(), 1e-9))
            out[i] = q
        if np.abs(err).max() > 1e-6 or np.any(np.abs(out) > np.deg2rad([170, 120, 170, 120, 170, 120, 170])):
            raise ValueError("pose out of reach")
        if np.abs(np.diff(out, axis=0)).max() * rate > 3.0: raise ValueError("joint too fast")
        return make_interp_spline(t, out + wander(rng, t, 7, servo), k=5)

    def kin(self, t: np.ndarray, q: np.ndarray, dq: np.ndarray, ddq: np.ndarray, point: np.ndarray) -> Kin:
        """Contact coordinates of the nominal tip and sensor motion for joint samples."""
        n = len(t)
        p, v, rot, acc, om, al = (np.empty((n, 3)), np.empty((n, 3)), np.empty((n, 3, 3)), np.empty((n, 3)), np.empty((n, 3)), np.empty((n, 3)))
        m, d, frame = self.model, self.data, pin.LOCAL_WORLD_ALIGNED
        for i in range(n):
            pin.forwardKinematics(m, d, q[i], dq[i], ddq[i])
            rot[i] = pin.updateFramePlacement(m, d, self.sensor).rotation
            p[i] = pin.updateFramePlacement(m, d, self.tip).translation
            v[i] = pin.getFrameVelocity(m, d, self.tip, frame).linear
            w, a = pin.getFrameVelocity(m, d, self.sensor, frame), pin.getFrameClassicalAcceleration(m, d, self.sensor, frame)
            om[i], acc[i], al[i] = w.angular, a.linear, a.angular
        x = p - point
        return Kin(t, -x[:, 2], -v[:, 2], x[:, :2].copy(), v[:, :2].copy(), rot, acc, om, al)
