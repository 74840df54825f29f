"""A robot arm with flexible drives under joint PD and gravity compensation, integrated by exponential Rosenbrock-Euler; pin for rigid-body terms.

x = (q, theta, dq, dtheta):  M(q) ddq + h(q, dq) = K (theta - q) + D (dtheta - dq) + J' f,   B ddtheta = tau_pd - K (theta - q) - D (...) - friction
(Spong 1987).  x+ = x + h phi1(hA) f(x) (Hochbruck, Ostermann, Schweitzer 2009); A is frozen for 25 ms with M.
"""
from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pinocchio as pin
from scipy.interpolate import CubicSpline
from scipy.linalg import expm, solve

import laws

H = 1e-3


@dataclass
class Arm:
    """Robot model with a tool beyond the sensor plane; lengths m, mass kg, angles rad."""
    urdf: Path
    tool_mass: float = 0.0
    tool_com: np.ndarray = field(default_factory=lambda: np.zeros(3))
    gravity: np.ndarray = field(default_factory=lambda: np.array([0, 0, -9.81]))

    def __post_init__(self) -> None:
        self.model = pin.buildModelFromUrdf(str(self.urdf))
        self.model.gravity.linear = self.gravity
        self.sensor = self.model.getFrameId("ft_sensor")
        self.tip = self.model.getFrameId("tool_tip")
        self.data0 = self.model.createData()
        self.n = self.model.nv
        self.name = self.urdf.stem
        frame = self.model.frames[self.sensor]
        if self.tool_mass:
            self.model.appendBodyToJoint(frame.parentJoint, pin.Inertia(self.tool_mass, self.tool_com, np.eye(3) * 1e-4), frame.placement)
        self.data = self.model.createData()
        self.r_tip = np.array([0, 0, 0.118])
        self.home = np.array([0.0, -0.5, 0.0, -2.2, 0.0, 1.75, 0.8]) if self.n == 7 else np.array([0.0, -1.3, 1.7, -1.97, -1.57, 0.2])
        scale = 1.0 if self.name != "ur10" else 2.0
        self.inertia = scale * (np.array([0.8, 0.8, 0.5, 0.5, 0.2, 0.2, 0.2]) if self.n == 7 else np.array([0.9, 0.9, 0.7, 0.2, 0.2, 0.2]))
        self.drive = scale * (np.array([2.5, 2.5, 1.8, 1.8, 0.9, 0.9, 0.9]) if self.n == 7 else np.array([2.2, 2.2, 1.8, 0.8, 0.8, 0.8])) * 1e4

    def tip_pose(self, q: np.ndarray) -> pin.SE3:
        """Placement of tool_tip in the base frame."""
        pin.forwardKinematics(self.model, self.data, q)
        return pin.updateFramePlacement(self.model, self.data, self.tip).copy()

    def ik(self, q: np.ndarray, target: pin.SE3, steps: int = 40) -> np.ndarray:
        """Damped Newton inverse kinematics from q."""
        for _ in range(steps):
            pin.computeJointJacobians(self.model, self.data, q)
            err = pin.log6(pin.updateFramePlacement(self.model, self.data, self.tip).actInv(target)).vector
            if np.abs(err).max() < 1e-7:
                break
            J = pin.getFrameJacobian(self.model, self.data, self.tip, pin.LOCAL)
            dq = J.T @ np.linalg.solve(J @ J.T + 1e-8 * np.eye(6), err)
            q = q + dq * min(1.0, 0.3 / max(1e-9, np.abs(dq).max()))
        return q

    def simulate(self, times: np.ndarray, q_cmd: np.ndarray, kp: np.ndarray, zeta: float, fric: np.ndarray, drive: np.ndarray | None = None,
                 contact: tuple[np.ndarray, np.ndarray, np.ndarray] | None = None) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Executed (t, q, theta) on a 1 ms grid. contact = (law parameters, surface point, rows n,t1,t2 in the base frame)."""
        n, model, data = self.n, self.model, self.data
        ref = CubicSpline(times, q_cmd)
        t = np.arange(0.0, times[-1], H)
        Q, V = ref(t), ref(t, 1)
        K = self.drive if drive is None else drive
        B = self.inertia
        kd = 2 * zeta * np.sqrt(kp * (B + pin.crba(model, data, self.home).diagonal()))
        D = 0.06 * 2 * np.sqrt(K * B)
        x = np.concatenate([Q[0], Q[0], V[0], V[0]])
        hold = pin.computeGeneralizedGravity(model, data, Q[0]).copy()
        x[n:2 * n] += hold / K
        out = np.empty((len(t), 2 * n))
        st = np.zeros(laws.NSTATE)
        E = np.eye(4 * n)
        for i in range(len(t)):
            q, th, v, w = x[:n], x[n:2 * n], x[2 * n:3 * n], x[3 * n:]
            if i % 25 == 0:
                M = pin.crba(model, data, q)
                M = np.triu(M) + np.triu(M, 1).T
                Mi = np.linalg.inv(M)
                A = np.zeros((4 * n, 4 * n))
                A[:2 * n, 2 * n:] = np.eye(2 * n)
                A[2 * n:3 * n, :n], A[2 * n:3 * n, n:2 * n] = -Mi * K, Mi * K
                A[2 * n:3 * n, 2 * n:3 * n], A[2 * n:3 * n, 3 * n:] = -Mi * D, Mi * D
                A[3 * n:, :n], A[3 * n:, n:2 * n] = np.diag(K / B), np.diag(-(K + kp) / B)
                A[3 * n:, 2 * n:3 * n], A[3 * n:, 3 * n:] = np.diag(D / B), np.diag(-(D + kd) / B)
                phi = solve(A, expm(H * A) - E)
            tau_j = K * (th - q) + D * (w - v)
            tau = tau_j
            if contact is not None:
                P, point, rows = contact
                pin.computeJointJacobians(model, data, q)
                pos = pin.updateFramePlacement(model, data, self.tip).translation
                J = pin.getFrameJacobian(model, data, self.tip, pin.LOCAL_WORLD_ALIGNED)[:3]
                rel, vel = rows @ (pos - point), rows @ (J @ v)
                f = laws.step(st, P, -rel[0], -vel[0], rel[1], rel[2], vel[1], vel[2], t[i], H)
                tau = tau_j + J.T @ (rows.T @ np.array(f))
            acc = pin.aba(model, data, q, v, tau)
            if i % 5 == 0:
                hold = pin.computeGeneralizedGravity(model, data, Q[i]).copy()
            motor = hold + kp * (Q[i] + hold / K - th) + kd * (V[i] - w) - fric * w / np.sqrt(w * w + 4e-4)
            f_x = np.concatenate([v, w, acc, (motor - tau_j) / B])
            out[i] = x[:2 * n]
            x = x + phi @ f_x
        return t, out[:, :n], out[:, n:]

    def frames(self, q: np.ndarray, v: np.ndarray, a: np.ndarray) -> tuple[np.ndarray, ...]:
        """Sensor rotation (T,3,3), tip position and velocity, velocity and acceleration of the sensor origin, angular rate and acceleration (base axes)."""
        m, d, T = self.model, self.data, len(q)
        R, p, acc, om, al = np.empty((T, 3, 3)), np.empty((T, 3)), np.empty((T, 3)), np.empty((T, 3)), np.empty((T, 3))
        vo = np.empty((T, 3))
        mode = pin.LOCAL_WORLD_ALIGNED
        for i in range(T):
            pin.forwardKinematics(m, d, q[i], v[i], a[i])
            s = pin.updateFramePlacement(m, d, self.sensor)
            R[i], p[i] = s.rotation, s.translation
            u = pin.getFrameVelocity(m, d, self.sensor, mode)
            vo[i], om[i] = u.linear, u.angular
            w = pin.getFrameClassicalAcceleration(m, d, self.sensor, mode)
            acc[i], al[i] = w.linear, w.angular
        return R, p, vo, acc, om, al
