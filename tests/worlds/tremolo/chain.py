"""A serial arm read from a URDF: kinematics, inverse dynamics and mass matrix (numba), written from the textbook
recursive Newton-Euler scheme (Luh, Walker & Paul 1980; Featherstone, Rigid Body Dynamics Algorithms, 2008, ch. 5)."""
import xml.etree.ElementTree as ET
from dataclasses import dataclass
import numpy as np
from numba import njit


def rpy(r):
    cr, sr, cp, sp, cy, sy = np.cos(r[0]), np.sin(r[0]), np.cos(r[1]), np.sin(r[1]), np.cos(r[2]), np.sin(r[2])
    return np.array([[cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
                     [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr],
                     [-sp, cp * sr, cp * cr]])


def rotvec(w):
    w = np.asarray(w, float)
    a = np.linalg.norm(w)
    if a < 1e-12:
        return np.eye(3) + skew(w)
    k = skew(w / a)
    return np.eye(3) + np.sin(a) * k + (1 - np.cos(a)) * k @ k


def skew(w):
    return np.array([[0, -w[2], w[1]], [w[2], 0, -w[0]], [-w[1], w[0], 0.0]])


def _floats(node, key, default):
    s = None if node is None else node.get(key)
    return np.array([float(x) for x in s.split()]) if s else np.array(default, float)


@dataclass
class Chain:
    names: list
    Rj: np.ndarray          # (n,3,3) fixed rotation parent link -> joint frame
    pj: np.ndarray
    ax: np.ndarray
    m: np.ndarray           # (n,) link masses, everything fixed to a link merged into it
    c: np.ndarray           # (n,3)
    I: np.ndarray           # (n,3,3) about the com
    Rs: np.ndarray          # sensor frame in the last link
    ps: np.ndarray
    rt: np.ndarray          # tip in the sensor frame (axes parallel)
    lo: np.ndarray
    hi: np.ndarray
    vmax: np.ndarray
    effort: np.ndarray

    @property
    def n(self):
        return len(self.m)

    def args(self):
        return self.Rj, self.pj, self.ax

    def dyn(self):
        return self.Rj, self.pj, self.ax, self.m, self.c, self.I

    def with_tool(self, mass, com, inertia=None):
        """A copy whose last link carries a tool given in the sensor frame."""
        com = self.ps + self.Rs @ np.asarray(com, float)
        inertia = np.zeros((3, 3)) if inertia is None else self.Rs @ inertia @ self.Rs.T
        m, c, I = self.m.copy(), self.c.copy(), self.I.copy()
        m[-1], c[-1], I[-1] = merge(m[-1], c[-1], I[-1], mass, com, inertia)
        return Chain(self.names, self.Rj, self.pj, self.ax, m, c, I, self.Rs, self.ps, self.rt, self.lo, self.hi, self.vmax, self.effort)


def merge(m1, c1, I1, m2, c2, I2):
    m = m1 + m2
    if m <= 0:
        return 0.0, np.zeros(3), I1 + I2
    c = (m1 * c1 + m2 * c2) / m
    out = I1 + I2
    for mm, cc in ((m1, c1), (m2, c2)):
        d = cc - c
        out = out + mm * (d @ d * np.eye(3) - np.outer(d, d))
    return m, c, out


def load(path, sensor="ft_sensor", tip="tool_tip"):
    root = ET.parse(path).getroot()
    links = {x.get("name"): x for x in root.findall("link")}
    by_child = {j.find("child").get("link"): j for j in root.findall("joint")}
    children = {}
    for j in by_child.values():
        children.setdefault(j.find("parent").get("link"), []).append(j)
    path_joints, link = [], tip
    while link in by_child:
        j = by_child[link]
        path_joints.insert(0, j)
        link = j.find("parent").get("link")

    def inertial(name):
        node = links[name].find("inertial")
        if node is None:
            return 0.0, np.zeros(3), np.zeros((3, 3))
        o, i = node.find("origin"), node.find("inertia")
        R = rpy(_floats(o, "rpy", [0, 0, 0]))
        v = {k: float(i.get(k, 0)) for k in ("ixx", "iyy", "izz", "ixy", "ixz", "iyz")}
        M = np.array([[v["ixx"], v["ixy"], v["ixz"]], [v["ixy"], v["iyy"], v["iyz"]], [v["ixz"], v["iyz"], v["izz"]]])
        return float(node.find("mass").get("value")), _floats(o, "xyz", [0, 0, 0]), R @ M @ R.T

    def lump(name):
        m, c, I = inertial(name)
        for j in children.get(name, []):
            if j.get("type") == "fixed":
                R, p = rpy(_floats(j.find("origin"), "rpy", [0, 0, 0])), _floats(j.find("origin"), "xyz", [0, 0, 0])
                m2, c2, I2 = lump(j.find("child").get("link"))
                m, c, I = merge(m, c, I, m2, R @ c2 + p, R @ I2 @ R.T)
        return m, c, I

    out = {k: [] for k in ("names", "Rj", "pj", "ax", "m", "c", "I", "lo", "hi", "v", "e")}
    R, p, frames = np.eye(3), np.zeros(3), {}
    for j in path_joints:
        o = j.find("origin")
        R, p = R @ rpy(_floats(o, "rpy", [0, 0, 0])), p + R @ _floats(o, "xyz", [0, 0, 0])
        name = j.find("child").get("link")
        if j.get("type") != "fixed":
            m, c, I = lump(name)
            lim = j.find("limit")
            for k, v in zip(("names", "Rj", "pj", "ax", "m", "c", "I", "lo", "hi", "v", "e"),
                            (j.get("name"), R, p, _floats(j.find("axis"), "xyz", [1, 0, 0]), m, c, I,
                             float(lim.get("lower", -3)), float(lim.get("upper", 3)), float(lim.get("velocity", 2)), float(lim.get("effort", 100)))):
                out[k].append(v)
            R, p = np.eye(3), np.zeros(3)
        frames[name] = (R.copy(), p.copy())
    Rs, ps = frames[sensor]
    rt = Rs.T @ (frames[tip][1] - ps)
    a = {k: np.array(v, float) for k, v in out.items() if k != "names"}
    return Chain(out["names"], a["Rj"], a["pj"], a["ax"], a["m"], a["c"], a["I"], Rs, ps, rt, a["lo"], a["hi"], a["v"], a["e"])


@njit(cache=True, inline="always")
def cr(a, b):
    return (a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0])


@njit(cache=True, inline="always")
def rv(A, x):
    return (A[0, 0] * x[0] + A[0, 1] * x[1] + A[0, 2] * x[2], A[1, 0] * x[0] + A[1, 1] * x[1] + A[1, 2] * x[2],
            A[2, 0] * x[0] + A[2, 1] * x[1] + A[2, 2] * x[2])


@njit(cache=True, inline="always")
def rtv(A, x):
    return (A[0, 0] * x[0] + A[1, 0] * x[1] + A[2, 0] * x[2], A[0, 1] * x[0] + A[1, 1] * x[1] + A[2, 1] * x[2],
            A[0, 2] * x[0] + A[1, 2] * x[1] + A[2, 2] * x[2])


@njit(cache=True, inline="always")
def add(a, b):
    return (a[0] + b[0], a[1] + b[1], a[2] + b[2])


@njit(cache=True, inline="always")
def mul(a, s):
    return (a[0] * s, a[1] * s, a[2] * s)


@njit(cache=True)
def turn(Rj, k, q, out):
    """out = Rj @ rotation of q about k."""
    s, c = np.sin(q), np.cos(q)
    v = 1 - c
    x, y, z = k[0], k[1], k[2]
    a00 = c + x * x * v; a01 = x * y * v - z * s; a02 = x * z * v + y * s
    a10 = y * x * v + z * s; a11 = c + y * y * v; a12 = y * z * v - x * s
    a20 = z * x * v - y * s; a21 = z * y * v + x * s; a22 = c + z * z * v
    for i in range(3):
        b0, b1, b2 = Rj[i, 0], Rj[i, 1], Rj[i, 2]
        out[i, 0] = b0 * a00 + b1 * a10 + b2 * a20
        out[i, 1] = b0 * a01 + b1 * a11 + b2 * a21
        out[i, 2] = b0 * a02 + b1 * a12 + b2 * a22


@njit(cache=True)
def matmul3(A, B, C):
    for i in range(3):
        a0, a1, a2 = A[i, 0], A[i, 1], A[i, 2]
        for j in range(3):
            C[i, j] = a0 * B[0, j] + a1 * B[1, j] + a2 * B[2, j]


@njit(cache=True)
def forward(Rj, pj, ax, q):
    """World rotation, origin and axis of every link frame."""
    n = len(q)
    R = np.zeros((n, 3, 3)); p = np.zeros((n, 3)); z = np.zeros((n, 3)); A = np.zeros((3, 3))
    for i in range(n):
        turn(Rj[i], ax[i], q[i], A)
        if i == 0:
            R[0] = A; p[0] = pj[0]
        else:
            matmul3(R[i - 1], A, R[i])
            b = rv(R[i - 1], pj[i])
            for k in range(3):
                p[i, k] = p[i - 1, k] + b[k]
        b = rv(R[i], ax[i])
        z[i, 0] = b[0]; z[i, 1] = b[1]; z[i, 2] = b[2]
    return R, p, z


@njit(cache=True)
def jacobian(p, z, x):
    n = len(p)
    J = np.zeros((6, n))
    for i in range(n):
        v = cr(z[i], (x[0] - p[i, 0], x[1] - p[i, 1], x[2] - p[i, 2]))
        for k in range(3):
            J[k, i] = v[k]; J[3 + k, i] = z[i, k]
    return J


@njit(cache=True)
def rotations(Rj, ax, q):
    Ri = np.zeros((len(q), 3, 3))
    for i in range(len(q)):
        turn(Rj[i], ax[i], q[i], Ri[i])
    return Ri


@njit(cache=True)
def newton_euler(Ri, pj, ax, m, c, I, dq, ddq, g, F, T, tau):
    n = len(m)
    w = (0.0, 0.0, 0.0); dw = (0.0, 0.0, 0.0); a = (-g[0], -g[1], -g[2])
    for i in range(n):
        A = Ri[i]
        a = rtv(A, add(a, add(cr(dw, pj[i]), cr(w, cr(w, pj[i])))))
        wp = rtv(A, w)
        dw = add(rtv(A, dw), add(mul(ax[i], ddq[i]), mul(cr(wp, ax[i]), dq[i])))
        w = add(wp, mul(ax[i], dq[i]))
        f = mul(add(a, add(cr(dw, c[i]), cr(w, cr(w, c[i])))), m[i])
        tt = add(rv(I[i], dw), add(cr(w, rv(I[i], w)), cr(c[i], f)))
        for k in range(3):
            F[i, k] = f[k]; T[i, k] = tt[k]
    for i in range(n - 1, -1, -1):
        tau[i] = T[i, 0] * ax[i, 0] + T[i, 1] * ax[i, 1] + T[i, 2] * ax[i, 2]
        if i > 0:
            f = rv(Ri[i], F[i])
            tt = add(rv(Ri[i], T[i]), cr(pj[i], f))
            for k in range(3):
                F[i - 1, k] += f[k]; T[i - 1, k] += tt[k]


@njit(cache=True)
def rnea(Rj, pj, ax, m, c, I, q, dq, ddq, g):
    n = len(q)
    tau = np.zeros(n); F = np.zeros((n, 3)); T = np.zeros((n, 3))
    newton_euler(rotations(Rj, ax, q), pj, ax, m, c, I, dq, ddq, g, F, T, tau)
    return tau


@njit(cache=True)
def mass_matrix(Rj, pj, ax, m, c, I, q):
    n = len(q)
    M = np.zeros((n, n)); z = np.zeros(n); g = np.zeros(3); e = np.zeros(n)
    tau = np.zeros(n); F = np.zeros((n, 3)); T = np.zeros((n, 3))
    Ri = rotations(Rj, ax, q)
    for i in range(n):
        e[i] = 1.0
        newton_euler(Ri, pj, ax, m, c, I, z, e, g, F, T, tau)
        for k in range(n):
            M[k, i] = tau[k]
        e[i] = 0.0
    return M


@njit(cache=True)
def rnea_many(Rj, pj, ax, m, c, I, Q, dQ, ddQ, g):
    out = np.zeros_like(Q)
    for k in range(len(Q)):
        out[k] = rnea(Rj, pj, ax, m, c, I, Q[k], dQ[k], ddQ[k], g)
    return out


@njit(cache=True)
def sensor_motion(Rj, pj, ax, Rs, ps, Q, dQ, ddQ):
    """Of the sensor frame: R (world), origin, velocity (world); rotation rate, its derivative and acceleration in sensor axes."""
    N, n = Q.shape
    R = np.zeros((N, 3, 3)); P = np.zeros((N, 3)); V = np.zeros((N, 3))
    W = np.zeros((N, 3)); dW = np.zeros((N, 3)); A = np.zeros((N, 3))
    Ri = np.zeros((3, 3)); Rw = np.zeros((3, 3)); Rn = np.zeros((3, 3))
    for k in range(N):
        w = (0.0, 0.0, 0.0); dw = w; a = w; v = w; pw = w
        Rw[:] = np.eye(3)
        for i in range(n):
            pw = add(pw, rv(Rw, pj[i]))
            turn(Rj[i], ax[i], Q[k, i], Ri)
            v = rtv(Ri, add(v, cr(w, pj[i])))
            a = rtv(Ri, add(a, add(cr(dw, pj[i]), cr(w, cr(w, pj[i])))))
            wp = rtv(Ri, w)
            dw = add(rtv(Ri, dw), add(mul(ax[i], ddQ[k, i]), mul(cr(wp, ax[i]), dQ[k, i])))
            w = add(wp, mul(ax[i], dQ[k, i]))
            matmul3(Rw, Ri, Rn)
            Rw[:] = Rn
        v = add(v, cr(w, ps))
        a = add(a, add(cr(dw, ps), cr(w, cr(w, ps))))
        pw = add(pw, rv(Rw, ps)); v = rv(Rw, v)
        w = rtv(Rs, w); dw = rtv(Rs, dw); a = rtv(Rs, a)
        matmul3(Rw, Rs, R[k])
        for j in range(3):
            P[k, j] = pw[j]; V[k, j] = v[j]; W[k, j] = w[j]; dW[k, j] = dw[j]; A[k, j] = a[j]
    return R, P, V, W, dW, A
