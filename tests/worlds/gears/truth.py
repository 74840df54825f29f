"""Own inverse by least squares: what of an effect the other laws' parameters can't take up, what noise leaves, which effects look alike."""
from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

PER_JOINT = ["joint-coulomb-friction", "joint-viscous-friction", "joint-friction-asymmetry", "joint-torque-offset", "rotor-inertia", "joint-torque-gain",
             "joint-stribeck-friction", "joint-load-friction", "joint-torque-ripple", "joint-spring"]
CANDIDATES = PER_JOINT + ["payload", "joint-elasticity", "gravity-error", "time-offset", "sensor-lag"]


@dataclass
class Signals:
    """Motion and rigid torque of a joint log at its instants: t [s], q, v, a (N×n), tau (rigid or transmitted torque, N×n [N·m])."""
    t: np.ndarray
    q: np.ndarray
    v: np.ndarray
    a: np.ndarray
    tau: np.ndarray
    k: float = 10.0      # ripple's waves per rad
    vs: float = 0.04     # Stribeck velocity
    vr: float = 2e-3     # rounding of sign(v)
    arm: object = None   # nominal arm, None for a drive
    cache: dict = field(default_factory=dict)

    def cut(self, rows) -> "Signals":
        return Signals(self.t[rows], self.q[rows], self.v[rows], self.a[rows], self.tau[rows], self.k, self.vs, self.vr, self.arm)


def columns(name: str, S: Signals) -> tuple:
    """(per-joint columns, shared columns) of an effect: lists of N×n arrays."""
    s = S.v / np.sqrt(S.v ** 2 + S.vr ** 2)
    n = S.q.shape[1]
    one = {"joint-coulomb-friction": [s], "joint-viscous-friction": [S.v], "joint-friction-asymmetry": [np.abs(s)], "joint-torque-offset": [np.ones_like(S.v)],
           "rotor-inertia": [S.a], "joint-torque-gain": [S.tau], "joint-stribeck-friction": [s * np.exp(-(S.v / S.vs) ** 2)],
           "joint-load-friction": [s * np.abs(S.tau)], "joint-spring": [S.q]}
    if name in one:
        return one[name], []
    if name == "joint-torque-ripple":
        return [f(m * S.k * S.q) for m in (1, 2) for f in (np.sin, np.cos)], []
    if name in ("time-offset", "sensor-lag"):
        d = np.gradient(S.tau, axis=0) / np.maximum(np.gradient(S.t), 1e-6)[:, None] if "dtau" not in S.cache else S.cache["dtau"]
        return [], [d]
    if name in ("rigid-body",):
        return ([S.a] if S.arm is None else []), []
    if S.arm is None:
        return ([S.cache["ddtau"]] if name == "joint-elasticity" and "ddtau" in S.cache else []), []
    if name in S.cache:
        return [], S.cache[name]
    base, out = S.arm.rnea(S.q, S.v, S.a), []
    if name == "joint-elasticity":
        d2 = S.cache["ddtau"]
        for j in range(n):
            dq, da = np.zeros_like(S.q), np.zeros_like(S.a)
            dq[:, j], da[:, j] = -1e-4 * S.tau[:, j], -1e-4 * d2[:, j]
            out.append(S.arm.rnea(S.q + dq, S.v, S.a + da) - base)
    elif name == "gravity-error":
        g = S.arm.model.gravity.linear.copy()
        for j in range(3):
            S.arm.model.gravity.linear = g + np.eye(3)[j]
            out.append(S.arm.rnea(S.q, S.v, S.a) - base)
        S.arm.model.gravity.linear = g
    elif name == "payload":
        import pinocchio as pin
        Y = S.arm.model.inertias[7]
        for c in ((0, 0, 0.1), (0.05, 0, 0.1), (0, 0.05, 0.1), (0, 0, 0.2)):
            S.arm.model.inertias[7] = Y + pin.Inertia(0.3, np.array(c, float), np.zeros((3, 3)))
            out.append(S.arm.rnea(S.q, S.v, S.a) - base)
        S.arm.model.inertias[7] = Y
    S.cache[name] = out
    return [], out


def project(y: np.ndarray, names: list, S: Signals) -> np.ndarray:
    """y (N×n) less its best fit by the columns of the named effects."""
    n = y.shape[1]
    cols = []
    for name in names:
        per, shared = columns(name, S)
        for c in per:
            for j in range(n):
                z = np.zeros_like(y)
                z[:, j] = c[:, j]
                cols.append(z.ravel())
        cols += [c.ravel() for c in shared]
    return residual(y.ravel(), cols).reshape(y.shape)


def residual(y: np.ndarray, cols: list) -> np.ndarray:
    """Least-squares residual, columns scaled, tiny ridge."""
    if not cols:
        return y
    A = np.column_stack(cols)
    A = A / (np.sqrt(np.mean(A ** 2, axis=0)) + 1e-12)
    x = np.linalg.solve(A.T @ A + 1e-9 * len(y) * np.eye(A.shape[1]), A.T @ y)
    return y - A @ x


def rms(x: np.ndarray) -> float:
    return float(np.sqrt(np.mean(np.square(x))))


def calm(t: np.ndarray, v: np.ndarray, ts: np.ndarray, gap: float) -> np.ndarray:
    """True where an axis is farther than gap [s] from a reversal (there our inverse's filter fails, not the log)."""
    out = np.ones((len(ts), v.shape[1]), bool)
    for j in range(v.shape[1]):
        z = np.append(t[1:][np.diff(np.sign(v[:, j])) != 0], -1e9)
        i = np.searchsorted(np.sort(z), ts)
        z = np.append(np.sort(z), 1e9)
        out[:, j] = (z[i] - ts > gap) & (ts - z[i - 1] > gap)
    return out


def alike(e: np.ndarray, model: list, hidden: list, S: Signals, left: float, outside: bool, candidates=CANDIDATES) -> list:
    """Catalogue effects that fit e honestly as well (what they leave is below half of the noise), or halfway (outside: ≥ 40 % of the square)."""
    base, near = rms(project(e, model, S)), []
    for c in candidates:
        if c in model or c in hidden:
            continue
        rest = rms(project(e, model + [c], S))
        if (rest ** 2 < 0.6 * base ** 2) if outside else (rest < 0.5 * left and rest < 0.7 * base):
            near.append(c)
    return near
