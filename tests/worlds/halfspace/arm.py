"""The arm: kinematics in numba, inverse kinematics, planned paths, executed motion, encoders and log clocks. SI units throughout."""
from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import pinocchio as pin
from numba import njit
from scipy.interpolate import CubicSpline
from scipy.signal import butter, lfilter, lfilter_zi, sosfiltfilt

from laws import Env, Motion, contact, contact_frame

DT = 1e-3  # s, step of the executed motion


@dataclass(frozen=True)
class Robot:
    """Joint placements of a serial revolute chain and the sensor frame and tip behind it."""
    rot: np.ndarray
    trans: np.ndarray
    axis: np.ndarray
    sensor_rot: np.ndarray
    sensor_trans: np.ndarray
    tip: np.ndarray
    model: pin.Model

    @staticmethod
    def load(urdf: str) -> "Robot":
        m = pin.buildModelFromUrdf(urdf)
        d = m.createData()
        axis = []
        for j in range(1, m.njoints):
            q = np.zeros(m.nq)
            pin.computeJointJacobians(m, d, q)
            axis.append(pin.getJointJacobian(m, d, j, pin.ReferenceFrame.LOCAL)[3:, j - 1])
        s, tip = (m.frames[m.getFrameId(f)].placement for f in ("ft_sensor", "tool_tip"))
        pl = [m.jointPlacements[j] for j in range(1, m.njoints)]
        return Robot(np.array([p.rotation for p in pl]), np.array([p.translation for p in pl]), np.array(axis), s.rotation.copy(),
                     s.translation.copy(), (s.inverse() * tip).translation, m)


@njit(cache=True)
def forward(q: np.ndarray, rot: np.ndarray, trans: np.ndarray, axis: np.ndarray, sr: np.ndarray, stt: np.ndarray, tip: np.ndarray):
    """Sensor rotation, sensor origin, Jacobian (6, n) of the tip [linear; angular] in base axes, for one q."""
    n = len(q)
    R = np.eye(3)
    p = np.zeros(3)
    ax = np.zeros((n, 3))
    org = np.zeros((n, 3))
    for j in range(n):
        p = p + R @ trans[j]
        R = R @ rot[j]
        a = axis[j]
        c, s = np.cos(q[j]), np.sin(q[j])
        S = np.array([[0.0, -a[2], a[1]], [a[2], 0.0, -a[0]], [-a[1], a[0], 0.0]])
        ax[j] = R @ a
        org[j] = p
        R = R @ (np.eye(3) + s * S + (1 - c) * (S @ S))
    ps = p + R @ stt
    Rs = R @ sr
    pt = ps + Rs @ tip
    J = np.zeros((6, n))
    for j in range(n):
        J[:3, j] = np.cross(ax[j], pt - org[j])
        J[3:, j] = ax[j]
    return Rs, ps, J


@njit(cache=True)
def forward_all(q, rot, trans, axis, sr, stt, tip):
    n = len(q)
    R, p, J = np.zeros((n, 3, 3)), np.zeros((n, 3)), np.zeros((n, 6, q.shape[1]))
    for k in range(n):
        R[k], p[k], J[k] = forward(q[k], rot, trans, axis, sr, stt, tip)
    return R, p, J


@njit(cache=True)
def inverse_all(q0, R_d, p_d, rot, trans, axis, sr, stt, tip):
    """Joint path whose tip follows poses (R_d, p_d); damped least squares, started from the sample before."""
    n = len(p_d)
    out = np.zeros((n, len(q0)))
    q = q0.copy()
    worst = 0.0
    for k in range(n):
        err = 0.0
        for _ in range(60 if k == 0 else 4):
            R, p, J = forward(q, rot, trans, axis, sr, stt, tip)
            e = np.zeros(6)
            e[:3] = p_d[k] - (p + R @ tip)
            E = R_d[k] @ R.T
            e[3], e[4], e[5] = 0.5 * (E[2, 1] - E[1, 2]), 0.5 * (E[0, 2] - E[2, 0]), 0.5 * (E[1, 0] - E[0, 1])
            err = np.sqrt((e * e).sum())
            if err < 1e-10:
                break
            q = q + J.T @ np.linalg.solve(J @ J.T + 1e-8 * np.eye(6), e)
        worst = max(worst, err)
        out[k] = q
    return out, worst


def kin_args(r: Robot) -> tuple[np.ndarray, ...]:
    return r.rot, r.trans, r.axis, r.sensor_rot, r.sensor_trans, r.tip


def motion_of(t: np.ndarray, q: np.ndarray, r: Robot) -> Motion:
    """Sensor frame motion of a joint path, derivatives by central differences."""
    R, p, _ = forward_all(np.ascontiguousarray(q), *kin_args(r))
    D = np.gradient(R, t, axis=0) @ np.transpose(R, (0, 2, 1))
    w = 0.5 * np.stack([D[:, 2, 1] - D[:, 1, 2], D[:, 0, 2] - D[:, 2, 0], D[:, 1, 0] - D[:, 0, 1]], 1)
    v = np.gradient(p, t, axis=0)
    return Motion(t, R, p, v, np.gradient(v, t, axis=0), w, np.gradient(w, t, axis=0))


class Path:
    """A planned path of named coordinates, made of legs with smooth speed (quintic ramps); sampled at DT."""

    def __init__(self, **start: float) -> None:
        self.now = dict(start)
        self.cols: dict[str, list[np.ndarray]] = {k: [] for k in start}
        self.phase: list[str] = []

    def go(self, T: float, phase: str, ramp: float = 0.5, **target: float) -> "Path":
        """Move to target in T seconds; ramp: share of T spent speeding up (0.5: no stretch of constant speed)."""
        n = max(int(round(T / DT)), 2)
        u = (np.arange(n) + 1) / n
        x = np.clip(np.minimum(u, 1 - u) / ramp, 0, 1)
        s = np.cumsum(x**3 * (10 - 15 * x + 6 * x * x))
        s /= s[-1]
        for k, c in self.cols.items():
            a, b = self.now[k], target.get(k, self.now[k])
            c.append(a + (b - a) * s)
            self.now[k] = b
        self.phase += [phase] * n
        return self

    def arrays(self) -> tuple[np.ndarray, dict[str, np.ndarray], np.ndarray]:
        c = {k: np.concatenate(v) for k, v in self.cols.items()}
        return np.arange(len(self.phase)) * DT, c, np.array(self.phase)


@dataclass
class Executed:
    """Executed motion on the fine clock, its rig and its phases."""
    t: np.ndarray
    q: np.ndarray
    dq: np.ndarray
    motion: Motion
    env: Env
    phase: np.ndarray
    info: dict[str, float] = field(default_factory=dict)


def small_rot(a: np.ndarray, axis: np.ndarray) -> np.ndarray:
    """Rotation matrices (n,3,3) about a fixed axis."""
    S = np.array([[0, -axis[2], axis[1]], [axis[2], 0, -axis[0]], [-axis[1], axis[0], 0]])
    return np.eye(3) + np.sin(a)[:, None, None] * S + (1 - np.cos(a))[:, None, None] * (S @ S)


def execute(path: Path, r: Robot, env: Env, q0: np.ndarray, th: np.ndarray, rng: np.random.Generator) -> Executed:
    """Inverse kinematics of the plan, second-order lag of each joint, deflection under the contact force, tracking noise."""
    t, c, phase = path.arrays()
    n, t1, t2 = env.normal, env.t1, env.t2
    R0 = np.stack([t1, -t2, -n], 1)
    R = small_rot(c["a1"], t1) @ small_rot(c["a2"], t2) @ small_rot(c["a3"], n) @ R0
    p = env.point + c["s1"][:, None] * t1 + c["s2"][:, None] * t2 + c["h"][:, None] * n
    knots = np.unique(np.append(np.arange(0, len(t), 5), len(t) - 1))
    qk, worst = inverse_all(q0, R[knots], p[knots], *kin_args(r))
    if worst > 1e-6:
        raise RuntimeError(f"inverse kinematics left {worst:.2e}")
    plan = CubicSpline(t[knots], qk)(t)
    stiff = float(rng.choice([1.0e4, 6.0e3, 3.0e3]))                       # N·m/rad of the joint controllers
    wn, zeta = 2 * np.pi * rng.uniform(5, 10, 7), rng.uniform(0.8, 1.0, 7)

    def track(u: np.ndarray) -> np.ndarray:
        out = np.empty_like(u)
        for j in range(u.shape[1]):
            k = 2 / DT
            b = wn[j]**2 * np.array([1.0, 2.0, 1.0])
            a = np.array([k * k + 2 * zeta[j] * wn[j] * k + wn[j]**2, 2 * wn[j]**2 - 2 * k * k, k * k - 2 * zeta[j] * wn[j] * k + wn[j]**2])
            b, a = b / a[0], a / a[0]
            out[:, j] = lfilter(b, a, u[:, j], zi=lfilter_zi(b, a) * u[0, j])[0]
        return out

    amp = rng.uniform(1e-6, 4e-6)
    noise = sosfiltfilt(butter(2, [2.0, 12.0], "bandpass", fs=1 / DT, output="sos"), rng.standard_normal(plan.shape), axis=0)
    noise *= amp / noise.std()
    defl = np.zeros_like(plan)
    q = plan
    for _ in range(3):
        q = track(plan + defl) + noise
        m = motion_of(t, q, r)
        d, dd, s, v, _r = contact_frame(m, th, env)
        fc = contact(t, d, dd, np.ascontiguousarray(s), np.ascontiguousarray(v), th[:39])
        J = forward_all(np.ascontiguousarray(q), *kin_args(r))[2]
        defl = 0.5 * defl + 0.5 * np.einsum("nij,ni->nj", J[:, :3], fc @ np.stack([n, t1, t2])) / stiff
        defl = sosfiltfilt(butter(2, 20.0, fs=1 / DT, output="sos"), defl, axis=0)
    m = motion_of(t, q, r)
    lim = np.abs(q)
    if (lim > np.deg2rad([170, 120, 170, 120, 170, 120, 170])).any():
        raise RuntimeError("joint limit")
    return Executed(t, q, np.gradient(q, t, axis=0), m, env, phase, {"controller_stiffness": stiff, "tracking_noise_rad": amp})


def clock(T: float, rate: float, rng: np.random.Generator, jitter: float, drop: float) -> np.ndarray:
    """Sampling times [s] with jitter (share of a period) and dropped samples (share)."""
    t = np.arange(0.01, T - 0.01, 1 / rate)
    t = t + rng.uniform(-jitter, jitter, len(t)) / rate
    return t[rng.random(len(t)) >= drop]


def encode(tl: np.ndarray, t: np.ndarray, q: np.ndarray, dq: np.ndarray, rng: np.random.Generator, step: float, nominal_noise: float,
           bias: float, mode: str, value: float) -> tuple[np.ndarray, np.ndarray]:
    """Logged q and dq (n, joints): encoder steps [rad], dq noise and bias [rad/s], dq 'lag' [s] or 'lowpass' [Hz]."""
    qi = np.stack([np.interp(tl, t, c) for c in q.T], 1)
    if step > 0:
        qi = np.round(qi / step) * step
    if mode == "lowpass":
        e = np.exp(-2 * np.pi * value * (t[1] - t[0]))
        dq = np.stack([lfilter([1 - e], [1, -e], c, zi=[e * c[0]])[0] for c in dq.T], 1)
    lag = value if mode == "lag" else 0.0
    di = np.stack([np.interp(tl - lag, t, c) for c in dq.T], 1)
    return qi, di + rng.normal(0, nominal_noise, di.shape) + bias * rng.uniform(-1, 1, di.shape[1])
