"""The arm: PyBullet integrates the links (Featherstone, leapfrog reading of its semi-implicit steps); contact law and controller are ours.

Bullet gets a stripped copy of the URDF whose link_7 carries the tool (and payload); pinocchio gives inverse dynamics of what the user believes.
Leapfrog: q_k and torque_k hold at t_k, Bullet's velocity after step k at t_k + dt/2, so v(t_k) = (v_k + v_{k+1})/2 and a(t_k) = (v_{k+1} - v_k)/dt.
"""
from __future__ import annotations

import tempfile
import xml.etree.ElementTree as ET
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pinocchio as pin
import pybullet as pb
from numba import njit

# contact law's parameter indices (SI): see contact_step
(K, NEXP, C, LAM, RATIO, TAU_R, MU, DMU, VS, PLOAD, N0, ANISO, LEN, VR, CT, KGRAD, SIG1, QUAD, WEAR, WEARL, KBLOB, BLOBW, BLOBX) = range(23)
NPAR = 23
RIGID = {"payload", "gravity-error", "joint-elasticity"}


@njit(cache=True)
def contact_step(d, dd, s1, s2, v1, v2, dt, P, S):
    """Force [N] of the material on the tool: normal N >= 0 and tangential (T1, T2). S = bristle z1, z2 [m], Maxwell force, slid path, last depth.

    F_e = k δⁿ (with a place-dependent k), Maxwell branch ratio·F_e relaxing with τ, c δ̇ + λ F_e δ̇ + quad F_e|δ̇|δ̇ [Hunt & Crossley 1975; Forchheimer];
    friction: Dahl's bristle in two dimensions, LuGre's g(v) = μ + Δμ exp(−(v/v_s)²) [Canudas de Wit 1995], or rounded v/√(v²+v_r²).
    """
    if d <= 0.0:
        S[0] = 0.0; S[1] = 0.0; S[4] = 0.0
        S[2] *= np.exp(-dt / P[TAU_R])
        return 0.0, 0.0, 0.0
    k = P[K] * (1.0 + P[KGRAD] * s1 + P[KBLOB] / (1.0 + np.exp(-(s1 - P[BLOBX]) / P[BLOBW])))
    fe = k * d ** P[NEXP]
    fold = k * S[4] ** P[NEXP]
    e = np.exp(-dt / P[TAU_R])
    S[2] = S[2] * e + P[RATIO] * (fe - fold) * (1 - e) / dt * P[TAU_R]
    S[4] = d
    n = fe + S[2] + P[C] * dd + P[LAM] * fe * dd + P[QUAD] * fe * dd * abs(dd)
    if n <= 0.0:
        S[0] = 0.0; S[1] = 0.0
        return 0.0, 0.0, 0.0
    v = np.sqrt(v1 * v1 + v2 * v2)
    S[3] += v * dt
    mu = (P[MU] + P[DMU] * np.exp(-(v / P[VS]) ** 2)) * (n / P[N0]) ** P[PLOAD] * (1 + P[WEAR] * np.exp(-S[3] / P[WEARL]))
    if P[VR] > 0.0:
        r = np.sqrt(v * v + P[VR] ** 2)
        x1 = v1 / r
        x2 = v2 / r
    else:
        a = v * dt / P[LEN]
        e = np.exp(-a)
        g = (1 - e) / a if a > 1e-9 else 1.0
        S[0] = S[0] * e + v1 * dt * g
        S[1] = S[1] * e + v2 * dt * g
        x1 = S[0] / P[LEN] + P[SIG1] * v1
        x2 = S[1] / P[LEN] + P[SIG1] * v2
    return n, -mu * (1 + P[ANISO]) * n * x1 - P[CT] * v1, -mu * (1 - P[ANISO]) * n * x2 - P[CT] * v2


@njit(cache=True)
def contact_path(t, X, V, P):
    """Forces (N×3: normal, tangential 1, 2) along a motion: X = depth, slip1, slip2 [m], V their rates [m/s]."""
    out = np.zeros((len(t), 3))
    S = np.zeros(5)
    for i in range(1, len(t)):
        out[i, 0], out[i, 1], out[i, 2] = contact_step(X[i, 0], V[i, 0], X[i, 1], X[i, 2], V[i, 1], V[i, 2], t[i] - t[i - 1], P, S)
    return out


@njit(cache=True)
def fk(q, off, ax, tail):
    """Rotation of the last link, its origin, and world axes and origins of all joints (all URDF frames parallel at zero); tail along local z [m]."""
    R = np.eye(3)
    p = np.zeros(3)
    W = np.zeros((7, 3))
    O = np.zeros((7, 3))
    for j in range(7):
        p = p + R @ off[j]
        W[j] = R @ ax[j]
        O[j] = p
        c, s = np.cos(q[j]), np.sin(q[j])
        x, y, z = ax[j]
        Rj = np.array([[c + x * x * (1 - c), x * y * (1 - c) - z * s, x * z * (1 - c) + y * s],
                       [y * x * (1 - c) + z * s, c + y * y * (1 - c), y * z * (1 - c) - x * s],
                       [z * x * (1 - c) - y * s, z * y * (1 - c) + x * s, c + z * z * (1 - c)]])
        R = R @ Rj
    return R, p + R @ tail, W, O


@njit(cache=True)
def fk_path(Q, off, ax, tail):
    """Rotations (N×3×3) and positions (N×3) of a point of the last link along a motion."""
    n = len(Q)
    R = np.zeros((n, 3, 3))
    p = np.zeros((n, 3))
    for i in range(n):
        R[i], p[i], _, _ = fk(Q[i], off, ax, tail)
    return R, p


@njit(cache=True)
def loop_step(q, v, qr, vr, ff, kp, kd, off, ax, tip, frame, p0, touch, dt, P, S):
    """One controller and contact step: joint torques [N·m], contact force in the base frame [N] and the tip's place."""
    tau = ff + kp * (qr - q) + kd * (vr - v)
    F = np.zeros(3)
    p = np.zeros(3)
    c = np.zeros(3)
    if touch:
        R, p, W, O = fk(q, off, ax, tip)
        w = np.zeros(3)
        for j in range(7):
            w += np.cross(W[j], p - O[j]) * v[j]
        x = frame @ (p - p0)
        u = frame @ w
        c[0], c[1], c[2] = contact_step(-x[0], -u[0], x[1], x[2], -u[0] * 0 + u[1], u[2], dt, P, S)
        F = frame.T @ c
    return tau, F, p, c


@dataclass
class Tool:
    """What hangs beyond the measuring plane: mass [kg], centre of mass in the sensor frame [m]; a point mass."""
    mass: float = 0.24
    com: tuple = (0.0, 0.0, 0.049)


class Arm:
    """Kinematics and dynamics of the URDF with a tool; gravity [m/s²] in the base frame."""

    def __init__(self, urdf: str, tool: Tool, gravity=(0, 0, -9.81), payload: tuple | None = None):
        self.urdf, self.tool, self.gravity = urdf, tool, np.array(gravity, float)
        self.model = pin.buildModelFromUrdf(urdf)
        root = ET.parse(urdf).getroot()
        joints = {j.get("name"): j for j in root.findall("joint")}
        xyz = lambda j: np.array([float(x) for x in joints[j].find("origin").get("xyz").split()])
        self.off = np.array([xyz(f"joint_{i}") for i in range(1, 8)])
        self.ax = np.array([[float(x) for x in joints[f"joint_{i}"].find("axis").get("xyz").split()] for i in range(1, 8)])
        self.ft = xyz("flange_joint") + xyz("ft_sensor_joint")
        self.tip = self.ft + xyz("tool_tip_joint")
        last = self.model.inertias[7]
        for m, c in [(tool.mass, np.array(tool.com))] + ([payload] if payload else []):
            last = last + pin.Inertia(m, self.ft + np.asarray(c, float), np.zeros((3, 3)))
        self.model.inertias[7] = last
        self.model.gravity.linear = self.gravity
        self.data = self.model.createData()

    def rnea(self, q, v, a) -> np.ndarray:
        """Inverse dynamics along a motion, N×7 [N·m]."""
        return np.array([pin.rnea(self.model, self.data, q[i], v[i], a[i]) for i in range(len(q))])

    def bullet_urdf(self) -> str:
        """A copy for Bullet: seven links, no shapes, the tool inside link_7."""
        root = ET.parse(self.urdf).getroot()
        for child in list(root):
            if child.tag in ("mujoco", "material") or child.get("name") in ("flange", "ft_sensor", "tool_tip", "flange_joint", "ft_sensor_joint", "tool_tip_joint"):
                root.remove(child)
        for link in root.findall("link"):
            for tag in ("visual", "collision"):
                for e in link.findall(tag):
                    link.remove(e)
            if link.get("name") == "link_7":
                Y, i = self.model.inertias[7], link.find("inertial")
                i.find("origin").set("xyz", " ".join(repr(float(x)) for x in Y.lever))
                i.find("mass").set("value", repr(float(Y.mass)))
                for a, b, n in ((0, 0, "ixx"), (1, 1, "iyy"), (2, 2, "izz"), (0, 1, "ixy"), (0, 2, "ixz"), (1, 2, "iyz")):
                    i.find("inertia").set(n, repr(float(Y.inertia[a, b])))
        with tempfile.NamedTemporaryFile("w", suffix=".urdf", delete=False) as f:
            f.write(ET.tostring(root, encoding="unicode"))
        return f.name

    def simulate(self, qr, vr, ar, dt: float, wn: float, zeta: float, dist, contact: dict | None = None) -> dict:
        """Torque-controlled motion along a reference (feed-forward + joint PD of bandwidth wn [rad/s]); dist: N×7 disturbing torque [N·m].

        contact: {"frame": rows n, t1, t2; "point"; "P"}. Returns t, q, v, a, tau (link side, as applied), force (base frame), law (N, T1, T2)."""
        n = len(qr)
        ff = self.rnea(qr, vr, ar) + dist
        I = np.median([1 / np.diag(np.linalg.inv(pin.crba(self.model, self.data, qr[i]))) for i in range(0, n, max(1, n // 40))], axis=0)
        kp = I * wn ** 2
        if contact:
            kp = np.maximum(kp, [0, 0, 0, 0, 250, 250, 120])
        kd = 2 * zeta * np.sqrt(kp * I)
        if not pb.isConnected():
            pb.connect(pb.DIRECT)
        pb.resetSimulation()
        path = self.bullet_urdf()
        body = pb.loadURDF(path, useFixedBase=True, flags=pb.URDF_USE_INERTIA_FROM_FILE)
        Path(path).unlink()
        pb.setGravity(*self.gravity)
        pb.setTimeStep(dt)
        idx = list(range(7))
        for j in range(-1, 7):
            pb.changeDynamics(body, j, linearDamping=0, angularDamping=0, jointDamping=0, maxJointVelocity=1e3)
        for j in idx:
            pb.resetJointState(body, j, qr[0, j], vr[0, j])
        pb.setJointMotorControlArray(body, idx, pb.VELOCITY_CONTROL, forces=[0.0] * 7)
        touch = contact is not None
        frame, p0, P = (contact["frame"], contact["point"], contact["P"]) if touch else (np.eye(3), np.zeros(3), np.zeros(NPAR))
        S = np.zeros(5)
        Q, V, T, F, L = (np.zeros((n + 1, 7)), np.zeros((n + 1, 7)), np.zeros((n, 7)), np.zeros((n, 3)), np.zeros((n, 3)))
        get, put, step, push, mode = pb.getJointStates, pb.setJointMotorControlArray, pb.stepSimulation, pb.applyExternalForce, pb.TORQUE_CONTROL
        for i in range(n):
            st = get(body, idx)
            for j in range(7):
                s = st[j]
                Q[i, j] = s[0]
                V[i, j] = s[1]
            T[i], F[i], p, L[i] = loop_step(Q[i], V[i], qr[i], vr[i], ff[i], kp, kd, self.off, self.ax, self.tip, frame, p0, touch, dt, P, S)
            put(body, idx, mode, forces=T[i].tolist())
            if L[i, 0] > 0:
                push(body, 6, F[i].tolist(), p.tolist(), pb.WORLD_FRAME)
            step()
        st = get(body, idx)
        V[n] = [s[1] for s in st]
        return {"t": np.arange(n) * dt, "q": Q[:n], "v": 0.5 * (V[:n] + V[1:]), "a": np.diff(V, axis=0) / dt, "tau": T, "force": F, "law": L}

    def wrench(self, q, force, acc_com, tool: Tool) -> np.ndarray:
        """Readings f = Rᵀ(f_contact + m(g − a_com)), τ = com × f_tool + r_tip × f_contact in the sensor frame, N×6."""
        R, _ = fk_path(q, self.off, self.ax, self.tip)
        ft = np.einsum("nji,nj->ni", R, tool.mass * (self.gravity - acc_com))
        fc = np.einsum("nji,nj->ni", R, force)
        return np.hstack([ft + fc, np.cross(np.array(tool.com), ft) + np.cross(self.tip - self.ft, fc)])

    def com_acc(self, q, dt: float, com) -> np.ndarray:
        """Acceleration of the tool's centre of mass [m/s²] by central differences of the position."""
        _, p = fk_path(q, self.off, self.ax, self.ft + np.asarray(com, float))
        a = np.zeros_like(p)
        a[1:-1] = (p[2:] - 2 * p[1:-1] + p[:-2]) / dt ** 2
        return a

    def ik(self, pos, rot, q0) -> np.ndarray:
        """Joint path whose tip follows pos (N×3) and rot (N×3×3): Newton with a pseudo-inverse, warm started."""
        q, out = np.array(q0, float), np.zeros((len(pos), 7))
        for i in range(len(pos)):
            for _ in range(30 if i == 0 else 3):
                R, p, W, O = fk(q, self.off, self.ax, self.tip)
                J = np.vstack([np.cross(W, p - O).T, W.T])
                e = np.concatenate([pos[i] - p, R @ pin.log3(R.T @ rot[i])])
                q = q + J.T @ np.linalg.solve(J @ J.T + 1e-8 * np.eye(6), e)
            out[i] = q
        return out
