"""Joint-torque logs of the arm (inverse dynamics and gear friction) and of a single geared drive. N·m, rad, s."""
from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pinocchio as pin
from numba import njit
from scipy.interpolate import CubicSpline
from scipy.signal import butter, sosfilt, sosfilt_zi

from arm import DT, Path, Robot

Rng = np.random.Generator
FC = np.array([1.6, 1.7, 1.1, 1.2, 0.8, 0.5, 0.4])         # N·m, part of the gear friction that reaches the link side
FV = np.array([1.2, 1.3, 0.8, 0.9, 0.5, 0.3, 0.25])        # N·m·s/rad
SIGMA = np.array([0.05, 0.05, 0.035, 0.035, 0.03, 0.015, 0.012])
ROTOR = np.array([1.0, 1.0, 0.6, 0.6, 0.25, 0.15, 0.15])


@njit(cache=True)
def dahl(q: np.ndarray, ell: float) -> np.ndarray:
    """Dahl bristle state in -1..1 over the path q, exact for each step; ell [rad]."""
    z = np.zeros(len(q))
    for k in range(1, len(q)):
        d = q[k] - q[k - 1]
        e = np.exp(-abs(d) / ell)
        z[k] = z[k - 1] * e + (1 - e) * (1.0 if d > 0 else -1.0)
    return z


@dataclass
class Axes:
    """Executed motion of the joints on the fine clock and the torque of the rigid body; s: friction direction in -1..1."""
    t: np.ndarray
    q: np.ndarray
    dq: np.ndarray
    ddq: np.ndarray
    rigid: np.ndarray
    s: np.ndarray
    load: np.ndarray | None
    phase: np.ndarray
    info: dict[str, object]


def rnea(model: pin.Model, q: np.ndarray, dq: np.ndarray, ddq: np.ndarray) -> np.ndarray:
    data = model.createData()
    return np.array([pin.rnea(model, data, a, b, c) for a, b, c in zip(q, dq, ddq)])


def friction_state(q: np.ndarray, dq: np.ndarray, rng: Rng, scale: float) -> tuple[np.ndarray, str]:
    """sign(dq) as gears show it: rounded (v/sqrt(v²+v_r²)) or a Dahl bristle."""
    if rng.random() < 0.5:
        ell = float(rng.uniform(1e-4, 4e-4)) * scale
        return np.stack([dahl(c, ell) for c in q.T], 1), f"Dahl {ell:.1e} rad"
    vr = float(rng.uniform(1e-3, 4e-3)) * scale
    return dq / np.sqrt(dq**2 + vr**2), f"rounded {vr:.1e} rad/s"


def excite(r: Robot, rng: Rng, slow: bool, payload: float) -> Axes:
    """Fourier excitation (five harmonics a joint) between rests; base not level by up to 0.2 deg."""
    T, f0 = (60.0, 0.01) if slow else (float(rng.uniform(22, 32)), float(rng.uniform(0.07, 0.09)))
    t = np.arange(0, T, DT)
    centre = np.deg2rad([0, -25, 0, 60, 0, -40, 0]) + rng.uniform(-0.25, 0.25, 7)
    reach = np.array([1.4, 0.9, 1.2, 0.9, 1.6, 0.9, 1.6])
    k = np.arange(1, 3 if slow else 6)
    wave = np.zeros((len(t), 7))
    for j in range(7):
        a, ph = rng.uniform(0.5, 1, len(k)) / k**0.7, rng.uniform(0, 2 * np.pi, len(k))
        w = (a[:, None] * np.sin(2 * np.pi * f0 * k[:, None] * t + ph[:, None])).sum(0)
        wave[:, j] = w / np.abs(w).max() * min(reach[j], (0.06 if slow else 1.1) / (np.abs(np.gradient(w / np.abs(w).max(), t)).max()))
    u = np.clip(np.minimum(t - 0.8, T - 0.8 - t) / (15.0 if slow else 2.5), 0, 1)
    spl = CubicSpline(t, centre + wave * (u**3 * (10 - 15 * u + 6 * u * u))[:, None])
    q, dq, ddq = spl(t), spl(t, 1), spl(t, 2)
    model = r.model.copy()
    tilt = np.deg2rad(rng.uniform(-0.12, 0.12, 2))
    model.gravity.linear = 9.81 * np.array([np.sin(tilt[0]), np.sin(tilt[1]), -np.sqrt(1 - np.sum(np.sin(tilt)**2))])
    sub = np.unique(np.append(np.arange(0, len(t), 4), len(t) - 1))   # rigid torques are smooth: every 4 ms, then a spline

    def smooth(m: pin.Model) -> np.ndarray:
        return CubicSpline(t[sub], rnea(m, q[sub], dq[sub], ddq[sub]))(t)

    rigid = smooth(model)
    load = None
    if payload > 0:
        loaded = r.model.copy()
        loaded.appendBodyToJoint(7, pin.Inertia(payload, np.array([0.01, -0.015, 0.06]), 1e-3 * payload * np.eye(3)), pin.SE3.Identity())
        load = smooth(loaded) - smooth(r.model)
    s, how = friction_state(q, dq, rng, 1.0)
    return Axes(t, q, dq, ddq, rigid, s, load, np.where((t < 0.8) | (t > T - 0.8), "rest", "free"),
                {"base_tilt_deg": np.rad2deg(tilt).tolist(), "friction": how, "level": smooth(r.model)})


def spin(path: Path, rng: Rng) -> Axes:
    """A geared motor with a balanced load on a horizontal turntable."""
    t, c, phase = path.arrays()
    sos = butter(2, float(rng.uniform(8, 14)), fs=1 / DT, output="sos")
    q = sosfilt(sos, c["q"], zi=sosfilt_zi(sos) * c["q"][0])[0][:, None]
    dq = np.gradient(q, t, axis=0)
    ddq = np.gradient(dq, t, axis=0)
    inertia = float(rng.uniform(0.05, 0.15))
    s, how = friction_state(q, dq, rng, 3.0)
    return Axes(t, q, dq, ddq, inertia * ddq, s, None, phase, {"inertia": inertia, "friction": how})


def columns(name: str, a: Axes, drive: bool) -> list[np.ndarray]:
    """Regressors (n, joints) of a law, free for each joint."""
    if name == "rigid-body":
        return [a.ddq] if drive else []
    vs = 0.15 if drive else 0.08
    ripple = [f(k * a.q) for k in (3, 6) for f in (np.sin, np.cos)]
    table = {"joint-coulomb-friction": [a.s], "joint-viscous-friction": [a.dq], "joint-friction-asymmetry": [np.abs(a.s)],
             "joint-torque-offset": [np.ones_like(a.q)], "joint-torque-ripple": ripple, "joint-spring": [a.q], "rotor-inertia": [a.ddq],
             "joint-stribeck-friction": [np.exp(-(a.dq / vs)**2) * a.s], "joint-load-friction": [np.abs(a.rigid) * a.s],
             "joint-torque-gain": [a.rigid], "payload": [a.load], "windage": [a.dq * np.abs(a.dq)],
             "eccentric-friction": [np.cos(a.q) * a.s, np.sin(a.q) * a.s],
             "warm-up": [np.exp(-a.t / (0.25 * a.t[-1]))[:, None] * x for x in (a.s, a.dq)]}
    return table[name]


def contribution(name: str, amp: float, a: Axes, fc: np.ndarray, fv: np.ndarray, size: np.ndarray, drive: bool) -> np.ndarray:
    """Torque (n, joints) that a law adds; amp in the unit the case table means, size: relative size of the joints."""
    col = columns(name, a, drive)
    if name == "joint-torque-ripple":
        return amp * size * (0.8 * col[0] + 0.6 * col[1] + 0.3 * col[2] - 0.4 * col[3])
    if name == "joint-load-friction" or name == "payload":
        return (amp if name != "payload" else 1.0) * col[0]
    if name == "eccentric-friction":
        return amp * fc * (0.8 * col[0] + 0.6 * col[1])
    if name == "warm-up":
        return amp * (fc * col[0] + fv * col[1])
    if name == "joint-torque-gain":
        return amp * (a.rigid + fc * a.s + fv * a.dq) * np.where(np.arange(len(size)) % 2, -1, 1)
    if name == "rotor-inertia":
        return amp * ROTOR * col[0]
    return amp * size * col[0]


def project(y: np.ndarray, names: list[str], a: Axes, drive: bool) -> np.ndarray:
    """What of y (n, joints) the laws' free parameters cannot take up (least squares for each joint)."""
    cols = [c for n in names for c in columns(n, a, drive)]
    out = np.empty_like(y)
    for j in range(y.shape[1]):
        A = np.stack([c[:, j] for c in cols], 1)
        A = A / np.maximum(np.linalg.norm(A, axis=0), 1e-30)
        out[:, j] = y[:, j] - A @ np.linalg.lstsq(A, y[:, j], rcond=1e-9)[0]
    return out
