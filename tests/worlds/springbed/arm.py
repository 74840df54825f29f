"""LWR4+ from its URDF: forward kinematics, inverse kinematics along a path, recursive Newton-Euler (own code, numba)."""
from __future__ import annotations

import xml.etree.ElementTree as ET
from dataclasses import dataclass, replace

import numpy as np
from numba import njit

TIP = 0.1122       # link_7 origin (flange face) to tool_tip along z [m]
SENSOR = 0.0122    # link_7 origin to ft_sensor along z [m]


@dataclass
class Arm:
    """Joint offsets [m], axes, masses [kg], CoMs [m] and inertias about the CoM [kg m2] of seven links."""
    offset: np.ndarray
    axis: np.ndarray
    mass: np.ndarray
    com: np.ndarray
    inertia: np.ndarray
    qmax: np.ndarray
    vmax: np.ndarray

    def with_tool(self, mass: float, com: np.ndarray, inertia: np.ndarray | None = None) -> "Arm":
        """Arm with a body (com in link_7 frame, inertia about its com) rigidly added to link 7."""
        m, c, inr = self.mass.copy(), self.com.copy(), self.inertia.copy()
        c0, m0 = c[6].copy(), m[6]
        m[6] = m0 + mass
        c[6] = (m0 * c0 + mass * com) / m[6]

        def shift(mm: float, d: np.ndarray) -> np.ndarray:
            return mm * (d @ d * np.eye(3) - np.outer(d, d))
        inr[6] = inr[6] + shift(m0, c0 - c[6]) + (0 if inertia is None else inertia) + shift(mass, com - c[6])
        return replace(self, mass=m, com=c, inertia=inr)


def load(path: str) -> Arm:
    """Read joints 1..7 and their child links' inertials from a URDF whose frames are parallel at zero."""
    root = ET.parse(path).getroot()
    links = {e.get("name"): e for e in root.findall("link")}
    vec = lambda s: np.array([float(v) for v in s.split()])
    off, ax, m, c, inr, qm, vm = [], [], [], [], [], [], []
    for j in root.findall("joint"):
        if j.get("type") != "revolute":
            continue
        off.append(vec(j.find("origin").get("xyz")))
        ax.append(vec(j.find("axis").get("xyz")))
        qm.append(float(j.find("limit").get("upper")))
        vm.append(float(j.find("limit").get("velocity")))
        e = links[j.find("child").get("link")].find("inertial")
        c.append(vec(e.find("origin").get("xyz")))
        m.append(float(e.find("mass").get("value")))
        i = {k: float(v) for k, v in e.find("inertia").attrib.items()}
        inr.append([[i["ixx"], i["ixy"], i["ixz"]], [i["ixy"], i["iyy"], i["iyz"]], [i["ixz"], i["iyz"], i["izz"]]])
    return Arm(*(np.array(v) for v in (off, ax, m, c, inr, qm, vm)))


@njit(cache=True)
def _rot(ax, q):
    """Rodrigues rotation about a unit axis."""
    c, s = np.cos(q), np.sin(q)
    K = np.array([[0.0, -ax[2], ax[1]], [ax[2], 0.0, -ax[0]], [-ax[1], ax[0], 0.0]])
    return np.eye(3) + s * K + (1 - c) * (K @ K)


@njit(cache=True)
def _fk_jac(off, ax, q, tip):
    """Position and rotation of the tip [m] and its 6x7 Jacobian in the base frame."""
    n = q.size
    R = np.eye(3)
    p = np.zeros(3)
    P = np.zeros((n, 3))
    Z = np.zeros((n, 3))
    for j in range(n):
        p = p + R @ off[j]
        R = R @ _rot(ax[j], q[j])
        P[j] = p
        Z[j] = R @ ax[j]
    p = p + R[:, 2] * tip
    J = np.zeros((6, n))
    for j in range(n):
        J[:3, j] = np.cross(Z[j], p - P[j])
        J[3:, j] = Z[j]
    return p, R, J


@njit(cache=True)
def fk(off, ax, Q, tip):
    """Tip positions and rotations for rows of Q."""
    n = Q.shape[0]
    P, R = np.zeros((n, 3)), np.zeros((n, 3, 3))
    for i in range(n):
        P[i], R[i], _ = _fk_jac(off, ax, Q[i], tip)
    return P, R


@njit(cache=True)
def ik_path(off, ax, q0, P, R, V, tip):
    """Joint path (min-norm Newton, warm started) through poses P, R, and rates from twists V (n,6). Last: worst error [m]."""
    n = P.shape[0]
    Q, D = np.zeros((n, 7)), np.zeros((n, 7))
    q = q0.copy()
    worst = 0.0
    for i in range(n):
        e6 = np.zeros(6)
        for it in range(200 if i == 0 else 8):
            p, Rc, J = _fk_jac(off, ax, q, tip)
            E = R[i] @ Rc.T
            e6[:3] = P[i] - p
            e6[3] = 0.5 * (E[2, 1] - E[1, 2])
            e6[4] = 0.5 * (E[0, 2] - E[2, 0])
            e6[5] = 0.5 * (E[1, 0] - E[0, 1])
            nrm = np.sqrt(np.sum(e6 * e6))
            if nrm < 1e-11:
                break
            lam = 1e-3 if nrm > 0.05 else 0.0
            dq = J.T @ np.linalg.solve(J @ J.T + lam * np.eye(6), e6)
            mx = np.max(np.abs(dq))
            q = q + dq * (0.2 / mx if mx > 0.2 else 1.0)
        worst = max(worst, np.max(np.abs(e6)))
        Q[i] = q
        p, Rc, J = _fk_jac(off, ax, q, tip)
        D[i] = J.T @ np.linalg.solve(J @ J.T, V[i])
    return Q, D, worst


@njit(cache=True)
def rnea(off, ax, m, c, inr, Q, D, A, acc):
    """Recursive Newton-Euler (Luh, Walker, Paul 1980). acc: (n,3) base acceleration minus gravity [m/s2]; torques [N m]."""
    n, k = Q.shape
    T = np.zeros((n, k))
    for s in range(n):
        Rw, Zw, Pw = np.zeros((k, 3, 3)), np.zeros((k, 3)), np.zeros((k, 3))
        F, N = np.zeros((k, 3)), np.zeros((k, 3))
        R, p = np.eye(3), np.zeros(3)
        w, al, a = np.zeros(3), np.zeros(3), acc[s].copy()
        for j in range(k):
            r = R @ off[j]
            a = a + np.cross(al, r) + np.cross(w, np.cross(w, r))
            p = p + r
            R = R @ _rot(ax[j], Q[s, j])
            z = R @ ax[j]
            al = al + z * A[s, j] + np.cross(w, z * D[s, j])
            w = w + z * D[s, j]
            rc = R @ c[j]
            ac = a + np.cross(al, rc) + np.cross(w, np.cross(w, rc))
            I = R @ inr[j] @ R.T
            F[j] = m[j] * ac
            N[j] = I @ al + np.cross(w, I @ w) + np.cross(p + rc, F[j])   # about the base origin
            Zw[j], Pw[j] = z, p
        f, nn = np.zeros(3), np.zeros(3)
        for j in range(k - 1, -1, -1):
            f = f + F[j]
            nn = nn + N[j]
            T[s, j] = Zw[j] @ (nn - np.cross(Pw[j], f))
    return T


def torques(arm: Arm, Q: np.ndarray, D: np.ndarray, A: np.ndarray, g: np.ndarray, base_acc: np.ndarray | None = None) -> np.ndarray:
    """Inverse dynamics torques [N m] with gravity g (3,) and an optional base acceleration (n,3) [m/s2]."""
    acc = np.tile(-np.asarray(g, float), (len(Q), 1)) + (0 if base_acc is None else base_acc)
    return rnea(arm.offset, arm.axis, arm.mass, arm.com, arm.inertia, np.ascontiguousarray(Q), np.ascontiguousarray(D), np.ascontiguousarray(A), acc)
