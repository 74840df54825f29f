"""The LWR4+: mass matrix, bias and inverse dynamics by Drake's MultibodyPlant (1 kHz), kinematics in numba, and a
semi-implicit integrator at 8 kHz of arm + impedance controller + contact. SI units, base frame."""
from __future__ import annotations
import math
import xml.etree.ElementTree as ET
from dataclasses import dataclass, field
import numpy as np
from numba import njit
from scipy.interpolate import CubicSpline
from pydrake.all import (MultibodyPlant, Parser, SpatialInertia, UnitInertia, RotationalInertia, MultibodyForces)
import law

DT, SUB, REC = 1.25e-4, 8, 4      # inner step [s], inner steps an outer one, steps a recorded row (2 kHz)
ROTOR = np.array([0.6, 0.6, 0.4, 0.4, 0.15, 0.1, 0.1])   # shaped rotor inertia the arm moves with [kg m^2]


@dataclass
class Tool:
    """Mass [kg], centre of mass [m] and inertia about it (ixx iyy izz ixy ixz iyz) [kg m^2], in the sensor frame."""
    mass: float = 0.0
    com: np.ndarray = field(default_factory=lambda: np.zeros(3))
    inertia: np.ndarray = field(default_factory=lambda: np.zeros(6))


class Arm:
    """Chain constants from the URDF; `plant(...)` makes a Drake plant with a tool, gravity and link errors."""

    def __init__(self, urdf: str) -> None:
        self.text = open(urdf, encoding="utf8").read()
        root = ET.fromstring(self.text)
        js = {j.get("name"): j for j in root.findall("joint")}
        xyz = lambda e, tag: np.array([float(s) for s in e.find(tag).get("xyz").split()])
        rev = [js[f"joint_{i}"] for i in range(1, 8)]
        assert all(j.find("origin").get("rpy") in (None, "0 0 0") for j in js.values())
        self.o = np.array([xyz(j, "origin") for j in rev])
        self.ax = np.array([xyz(j, "axis") for j in rev])
        self.lim = np.array([float(j.find("limit").get("upper")) for j in rev])
        self.flange_to_sensor = xyz(js["flange_joint"], "origin") + xyz(js["ft_sensor_joint"], "origin")
        self.tip = xyz(js["tool_tip_joint"], "origin")
        self.o8 = np.vstack([self.o, self.flange_to_sensor])

    def plant(self, tool: Tool, g: np.ndarray, extra: dict[int, tuple[float, np.ndarray]] | None = None) -> "Plant":
        return Plant(self, tool, g, extra or {})


class Plant:
    """Drake plant and context; the tool and extra point masses {link: (kg, place in link axes [m])} are added in."""

    def __init__(self, arm: Arm, tool: Tool, g: np.ndarray, extra: dict[int, tuple[float, np.ndarray]]) -> None:
        self.p = MultibodyPlant(0.0)
        Parser(self.p).AddModelsFromString(arm.text, "urdf")
        self.p.WeldFrames(self.p.world_frame(), self.p.GetFrameByName("base_link"))
        self.p.mutable_gravity_field().set_gravity_vector(g)
        self.p.Finalize()
        self.c = self.p.CreateDefaultContext()
        self.f0 = MultibodyForces(self.p)
        adds = [(7, tool.mass, tool.com + arm.flange_to_sensor, tool.inertia)] if tool.mass > 0 else []
        adds += [(l, m, r, np.zeros(6)) for l, (m, r) in extra.items()]
        for l, m, r, i in adds:
            b = self.p.GetBodyByName(f"link_{l}")
            M = b.CalcSpatialInertiaInBodyFrame(self.c)
            a = abs(m)                       # Drake wants positive masses: subtract by hand below if negative
            I0 = RotationalInertia(*(i + np.array([a * (r @ r)] * 3 + [0, 0, 0]) - a * np.array([r[0] ** 2, r[1] ** 2, r[2] ** 2, r[0] * r[1], r[0] * r[2], r[1] * r[2]])))
            N = SpatialInertia(a, r, UnitInertia().SetFromRotationalInertia(I0, a))
            M += N
            b.SetSpatialInertiaInBodyFrame(self.c, M)

    def terms(self, q: np.ndarray, dq: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Mass matrix [kg m^2] and bias C dq - g [N m]."""
        self.p.SetPositions(self.c, q)
        self.p.SetVelocities(self.c, dq)
        return self.p.CalcMassMatrix(self.c), self.p.CalcBiasTerm(self.c) - self.p.CalcGravityGeneralizedForces(self.c)

    def inverse(self, q: np.ndarray, dq: np.ndarray, ddq: np.ndarray) -> np.ndarray:
        """Joint torques of the motion (n,7) [N m]."""
        out = np.empty_like(q)
        for i in range(len(q)):
            self.p.SetPositions(self.c, q[i])
            self.p.SetVelocities(self.c, dq[i])
            out[i] = self.p.CalcInverseDynamics(self.c, ddq[i], self.f0) - self.p.CalcGravityGeneralizedForces(self.c)
        return out


@njit(cache=True)
def rot(a, q):
    """Rotation about the unit axis a by q [rad]."""
    c, s = math.cos(q), math.sin(q)
    R = np.empty((3, 3))
    for i in range(3):
        for j in range(3):
            R[i, j] = (1 - c) * a[i] * a[j] + (c if i == j else 0.0)
    R[0, 1] -= s * a[2]; R[0, 2] += s * a[1]; R[1, 0] += s * a[2]
    R[1, 2] -= s * a[0]; R[2, 0] -= s * a[1]; R[2, 1] += s * a[0]
    return R


@njit(cache=True)
def mm(A, B):
    C = np.empty((3, 3))
    for i in range(3):
        for j in range(3):
            C[i, j] = A[i, 0] * B[0, j] + A[i, 1] * B[1, j] + A[i, 2] * B[2, j]
    return C


@njit(cache=True)
def mv(A, b):
    c = np.empty(3)
    for i in range(3):
        c[i] = A[i, 0] * b[0] + A[i, 1] * b[1] + A[i, 2] * b[2]
    return c


@njit(cache=True)
def cross(a, b):
    c = np.empty(3)
    c[0] = a[1] * b[2] - a[2] * b[1]
    c[1] = a[2] * b[0] - a[0] * b[2]
    c[2] = a[0] * b[1] - a[1] * b[0]
    return c


@njit(cache=True)
def fk(o8, ax, tip, q):
    """Tip position, sensor rotation, 6x7 Jacobian (linear, angular) at the tip."""
    R = np.eye(3)
    p = np.zeros(3)
    P = np.empty((7, 3))
    A = np.empty((7, 3))
    for i in range(7):
        p = p + mv(R, o8[i])
        A[i] = mv(R, ax[i])
        P[i] = p
        R = mm(R, rot(ax[i], q[i]))
    p = p + mv(R, o8[7] + tip)
    J = np.empty((6, 7))
    for i in range(7):
        J[:3, i] = cross(A[i], p - P[i])
        J[3:, i] = A[i]
    return p, R, J


@njit(cache=True)
def kin_series(o8, ax, q, dq, ddq):
    """Sensor origin's p, v, a, rotation R, omega, alpha along a motion (n,7)."""
    n = len(q)
    p_, v_, a_, w_, al_ = np.empty((n, 3)), np.empty((n, 3)), np.empty((n, 3)), np.empty((n, 3)), np.empty((n, 3))
    R_ = np.empty((n, 3, 3))
    for k in range(n):
        R = np.eye(3)
        p, v, a, w, al = np.zeros(3), np.zeros(3), np.zeros(3), np.zeros(3), np.zeros(3)
        for i in range(8):
            r = mv(R, o8[i])
            p = p + r
            wr = cross(w, r)
            v = v + wr
            a = a + cross(al, r) + cross(w, wr)
            if i < 7:
                z = mv(R, ax[i])
                al = al + z * ddq[k, i] + cross(w, z) * dq[k, i]
                w = w + z * dq[k, i]
                R = mm(R, rot(ax[i], q[k, i]))
        p_[k], v_[k], a_[k], w_[k], al_[k], R_[k] = p, v, a, w, al, R
    return p_, v_, a_, R_, w_, al_


@njit(cache=True)
def log3(R):
    """Rotation vector [rad] of R."""
    v = np.array([R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1]]) * 0.5
    s = math.sqrt(v[0] ** 2 + v[1] ** 2 + v[2] ** 2)
    c = 0.5 * (R[0, 0] + R[1, 1] + R[2, 2] - 1)
    return v * (math.atan2(s, c) / s if s > 1e-9 else 1.0)


@njit(cache=True)
def ik_series(o8, ax, tip, q, ps, Rs):
    """Joint path for tip poses; damped least squares from the start q, each from the one before."""
    n = len(ps)
    Q = np.empty((n, 7))
    for k in range(n):
        for it in range(60 if k == 0 else 4):
            p, R, J = fk(o8, ax, tip, q)
            e = np.empty(6)
            e[:3] = ps[k] - p
            e[3:] = log3(mm(Rs[k], R.T.copy()))
            if np.abs(e).max() < 1e-9:
                break
            q = q + J.T @ np.linalg.solve(J @ J.T + 1e-8 * np.eye(6), e)
        Q[k] = q
    return Q


@njit(cache=True)
def inner(o8, ax, tip, q, dq, Mi, h, qa, qb, dqa, dqb, cart, K, D, plane, P, S, O, jf, zj, u, t, n0, rec, out):
    """SUB steps at DT. cart: Cartesian impedance (K, D: 6, plus weak joint springs) or joint impedance (K, D: 7).
    plane: rows point, normal, t1, t2. jf rows: viscous, Coulomb, bristle [rad], stribeck amplitude, its speed, asymmetry of
    Coulomb and of viscous friction, load, spring, its zero, ripple amplitude, its cycles, phase."""
    o = np.zeros(3)
    fric = np.zeros(7)
    for s in range(SUB):
        a = s / SUB
        p, R, J = fk(o8, ax, tip, q)
        f = np.zeros(3)
        if plane[1, 0] != 0.0 or plane[1, 2] != 0.0:
            v = J[:3] @ dq
            r = p - plane[0]
            law.step(P, S, O, t + s * DT, DT, -(r @ plane[1]), -(v @ plane[1]), r @ plane[2], r @ plane[3], v @ plane[2], v @ plane[3], o)
            f = o[0] * plane[1] + o[1] * plane[2] + o[2] * plane[3]
        qd, dqd = qa + a * (qb - qa), dqa + a * (dqb - dqa)
        if cart:
            pd, Rd, Jd = fk(o8, ax, tip, qd)
            w = np.empty(6)
            V = J @ dq - Jd @ dqd
            rv = log3(mm(Rd, R.T.copy()))
            for i in range(3):
                w[i] = K[i] * (pd[i] - p[i]) - D[i] * V[i]
                w[3 + i] = K[3 + i] * rv[i] - D[3 + i] * V[3 + i]
            uu = J.T @ w + 20.0 * (qd - q) + 2.0 * (dqd - dq) + h
        else:
            uu = K * (qd - q) + D * (dqd - dq) + h
        for i in range(7):
            x = dq[i] * DT
            sg = 1.0 if x > 0 else -1.0
            zj[i] = sg + (zj[i] - sg) * math.exp(-abs(x) / jf[2, i])
            c = jf[1, i] + jf[3, i] * math.exp(-(dq[i] / jf[4, i]) ** 2) + jf[7, i] * abs(u[i])
            fric[i] = (jf[0, i] * dq[i] + c * zj[i] + jf[5, i] * abs(zj[i]) + jf[6, i] * abs(dq[i])
                       + jf[8, i] * (q[i] - jf[9, i]) + jf[10, i] * math.sin(jf[11, i] * q[i] + jf[12, i]))
        u[:] = uu
        ddq = Mi @ (uu - h - fric + J[:3].T @ f)
        k = n0 * SUB + s
        if k % rec == 0:
            b = k // rec
            out[b, :7], out[b, 7:14], out[b, 14:21], out[b, 21:24], out[b, 24:31] = q, dq, ddq, o, zj
        dq += DT * ddq
        q += DT * dq


def simulate(arm: Arm, plant: Plant, qd: np.ndarray, cart: bool, K: np.ndarray, D: np.ndarray, tip: np.ndarray, plane: np.ndarray,
             P: np.ndarray, jf: np.ndarray) -> dict[str, np.ndarray]:
    """Closed loop along the set-points qd (1 kHz, (n,7)). Rows at 2 kHz: t, q, dq, ddq, f = (N, T1, T2) [N], z."""
    n = len(qd) - 1
    dqd = np.gradient(qd, 1e-3, axis=0)
    q, dq = qd[0].copy(), np.zeros(7)
    S, O = np.zeros(law.NS), np.zeros(law.NS)
    r0 = fk(arm.o8, arm.ax, tip, q)[0] - plane[0]
    S[11], S[12] = r0 @ plane[2], r0 @ plane[3]
    out = np.zeros((n * SUB // REC, 31))
    zj, u = np.zeros(7), np.zeros(7)
    B = np.diag(ROTOR)
    for i in range(n):
        M, h = plant.terms(q, dq)
        inner(arm.o8, arm.ax, tip, q, dq, np.linalg.inv(M + B), h, qd[i], qd[i + 1], dqd[i], dqd[i + 1], cart, K, D, plane, P, S, O,
              jf, zj, u, i * 1e-3, i, REC, out)
        if not abs(q[0]) < 10:
            raise FloatingPointError("arm diverged")
    t = np.arange(len(out)) * DT * REC
    return dict(t=t, q=out[:, :7], dq=out[:, 7:14], ddq=out[:, 14:21], f=out[:, 21:24], z=out[:, 24:31])


def joint_path(arm: Arm, q0: np.ndarray, t: np.ndarray, ps: np.ndarray, Rs: np.ndarray) -> np.ndarray:
    """1 kHz joint set-points through tip poses given on the grid t (250 Hz)."""
    Q = ik_series(arm.o8, arm.ax, arm.tip, q0.copy(), ps, Rs)
    tt = np.arange(int(t[-1] * 1000) + 1) * 1e-3
    return CubicSpline(t, Q, axis=0)(tt)
