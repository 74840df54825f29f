"""Arms: models (Pinocchio only to read the URDFs), an own Newton-Euler dynamics in world axes and the closed loop with contact."""
import json
import math
import os
import numpy as np
from numba import njit
import contact as ct

IN = os.path.dirname(os.path.abspath(__file__))
LIM_D = 0.0


def _urdf(name, links, joints, fixed):
    s = [f'<?xml version="1.0"?>\n<robot name="{name}">']
    for ln, m, c, I in links:
        if m is None:
            s.append(f'  <link name="{ln}"/>')
        else:
            s.append(f'  <link name="{ln}"><inertial><origin xyz="{c[0]} {c[1]} {c[2]}" rpy="0 0 0"/><mass value="{m}"/>'
                     f'<inertia ixx="{I[0]}" iyy="{I[1]}" izz="{I[2]}" ixy="{I[3]}" ixz="{I[4]}" iyz="{I[5]}"/></inertial></link>')
    for jn, pa, ch, xyz, rpy, ax, lim, eff, vel in joints:
        s.append(f'  <joint name="{jn}" type="revolute"><parent link="{pa}"/><child link="{ch}"/><origin xyz="{xyz[0]} {xyz[1]} {xyz[2]}" '
                 f'rpy="{rpy[0]} {rpy[1]} {rpy[2]}"/><axis xyz="{ax[0]} {ax[1]} {ax[2]}"/><limit lower="{-lim}" upper="{lim}" effort="{eff}" velocity="{vel}"/></joint>')
    for jn, pa, ch, xyz, rpy in fixed:
        s.append(f'  <joint name="{jn}" type="fixed"><parent link="{pa}"/><child link="{ch}"/><origin xyz="{xyz[0]} {xyz[1]} {xyz[2]}" rpy="{rpy[0]} {rpy[1]} {rpy[2]}"/></joint>')
    return "\n".join(s + ["</robot>\n"])


def lwr_urdf():
    T = json.load(open(os.path.join(IN, "lwr4plus_inertia.json")))
    z = [0.11, 0.2005, 0.2, 0.2, 0.2, 0.19, 0.078]
    ax = [(0, 0, 1), (0, -1, 0), (0, 0, 1), (0, 1, 0), (0, 0, 1), (0, -1, 0), (0, 0, 1)]
    lim = [2.967, 2.094, 2.967, 2.094, 2.967, 2.094, 2.967]
    links = [("base_link", 1.6, (-.0006, 0, .0482), (.00347, .00371, .00406, 0, -.00005, 0))]
    links += [(f"link_{i+1}", r["m"], r["com"], r["I"]) for i, r in enumerate(T)]
    links += [("flange", None, 0, 0), ("ft_sensor", None, 0, 0), ("tool_tip", None, 0, 0)]
    joints = [(f"joint_{i+1}", "base_link" if i == 0 else f"link_{i}", f"link_{i+1}", (0, 0, z[i]), (0, 0, 0), ax[i], lim[i], 176, 2.0) for i in range(7)]
    fixed = [("to_flange", "link_7", "flange", (0, 0, 0), (0, 0, 0)), ("to_sensor", "flange", "ft_sensor", (0, 0, .0358), (0, 0, 0.3)),
             ("to_tip", "ft_sensor", "tool_tip", (0, 0, .11), (0, 0, 0))]
    return _urdf("lwr4plus_with_tool", links, joints, fixed)


def own_urdf():
    """turnstone_arm: six axes, elbow offset, spherical wrist; a hanging or standing mid-size arm of our own."""
    links = [("foot", 6.0, (0, 0, .05), (.02, .02, .03, 0, 0, 0)),
             ("turret", 5.2, (.01, 0, .11), (.034, .036, .021, 0, .001, 0)),
             ("upper", 6.1, (.19, .02, 0), (.016, .145, .142, .002, 0, 0)),
             ("fore", 3.4, (.08, -.01, .03), (.013, .028, .026, 0, -.002, 0)),
             ("roll", 1.9, (.10, 0, 0), (.0025, .0085, .0083, 0, 0, 0)),
             ("pitch", .9, (.03, 0, .0), (.0010, .0016, .0015, 0, 0, 0)),
             ("hub", .35, (.035, 0, 0), (.00025, .00028, .00028, 0, 0, 0)),
             ("plate", None, 0, 0), ("probe", None, 0, 0)]
    J = [("a1", "foot", "turret", (0, 0, .16), (0, 0, 0), (0, 0, 1)), ("a2", "turret", "upper", (.04, 0, .22), (0, 0, 0), (0, 1, 0)),
         ("a3", "upper", "fore", (.41, 0, 0), (0, 0, 0), (0, 1, 0)), ("a4", "fore", "roll", (.12, 0, .035), (0, 0, 0), (1, 0, 0)),
         ("a5", "roll", "pitch", (.25, 0, 0), (0, 0, 0), (0, 1, 0)), ("a6", "pitch", "hub", (.07, 0, 0), (0, 0, 0), (1, 0, 0))]
    joints = [j + (2.9, 150, 3.0) for j in J]
    fixed = [("plate_fix", "hub", "plate", (.055, 0, 0), (0, math.pi / 2, 0)), ("probe_fix", "plate", "probe", (0, 0, .135), (0, 0, 0))]
    return _urdf("turnstone_arm", links, joints, fixed)


class Arm:
    """name: lwr, lwr-name, ur5, ur10, panda, own."""
    def __init__(self, name):
        import pinocchio as pin
        import tempfile
        self.name = name
        self.urdf = None
        if name in ("lwr", "lwr-name", "own"):
            self.urdf = own_urdf() if name == "own" else lwr_urdf()
            m = pin.buildModelFromXML(self.urdf)
            self.rigmodel = {"lwr": "lwr4_tool.urdf", "lwr-name": "lwr4plus", "own": "turnstone_arm.urdf"}[name]
            self.sensor, self.tip = ("plate", "probe") if name == "own" else ("ft_sensor", "tool_tip")
        else:
            import example_robot_data as erd
            m = erd.load(name).model
            self.rigmodel = name
            if name == "panda":
                m = pin.buildReducedModel(m, [m.getJointId("panda_finger_joint1"), m.getJointId("panda_finger_joint2")], pin.neutral(m))
                self.sensor, self.tip = "panda_link8", "panda_hand_tcp"
            else:
                self.sensor, self.tip = "wrist_3_link", "tool0"
        self.joints = list(m.names)[1:]
        n = self.n = m.nq
        self.R0 = np.zeros((n, 3, 3)); self.p0 = np.zeros((n, 3)); self.ax = np.zeros((n, 3))
        self.m = np.zeros(n); self.c = np.zeros((n, 3)); self.I = np.zeros((n, 3, 3))
        d = m.createData()
        for i in range(n):
            pl = m.jointPlacements[i + 1]
            self.R0[i] = pl.rotation; self.p0[i] = pl.translation
            jm = m.joints[i + 1]
            sn = jm.shortname()
            self.ax[i] = {"JointModelRX": (1, 0, 0), "JointModelRY": (0, 1, 0), "JointModelRZ": (0, 0, 1)}.get(sn, (0, 0, 0))
            if not self.ax[i].any():
                q = pin.neutral(m); q[i] = 1e-6
                j = jm.createData(); jm.calc(j, q, np.eye(m.nv)[i]); self.ax[i] = np.round(np.array(j.S).ravel()[3:], 9)
            Y = m.inertias[i + 1]
            self.m[i], self.c[i], self.I[i] = Y.mass, Y.lever, Y.inertia
        fs, ft = (m.frames[m.getFrameId(f)].placement for f in (self.sensor, self.tip))
        self.sR, self.sp, self.tR, self.tp = fs.rotation.copy(), fs.translation.copy(), ft.rotation.copy(), ft.translation.copy()
        self.m_rig, self.c_rig, self.I_rig = self.m.copy(), self.c.copy(), self.I.copy()
        self.tip_s = self.sR.T @ (self.tp - self.sp)                 # tip in the sensor frame
        self.r_sp = self.sR.T @ self.tR                              # tip axes in the sensor frame
        self.lo, self.hi = m.lowerPositionLimit.copy(), m.upperPositionLimit.copy()
        self.lo = np.maximum(self.lo, -2.9); self.hi = np.minimum(self.hi, 2.9)

    def add_tool(self, mass, com_s, inertia=np.zeros((3, 3))):
        """put a body (sensor frame) on the last link"""
        m0, c0, I0 = self.m[-1], self.c[-1].copy(), self.I[-1].copy()
        c1 = self.sp + self.sR @ com_s
        M = m0 + mass
        c = (m0 * c0 + mass * c1) / M
        def st(m, r):
            return m * (r @ r * np.eye(3) - np.outer(r, r))
        self.I[-1] = I0 + st(m0, c0 - c) + self.sR @ inertia @ self.sR.T + st(mass, c1 - c)
        self.m[-1], self.c[-1] = M, c

    def fk(self, Q):
        """last link's rotation and origin for all rows"""
        return fk_all(np.ascontiguousarray(np.atleast_2d(Q)), self.R0, self.p0, self.ax)


@njit(cache=True)
def rot(ax, q, R):
    c = math.cos(q); s = math.sin(q); v = 1 - c
    x = ax[0]; y = ax[1]; z = ax[2]
    R[0, 0] = c + x * x * v; R[0, 1] = x * y * v - z * s; R[0, 2] = x * z * v + y * s
    R[1, 0] = y * x * v + z * s; R[1, 1] = c + y * y * v; R[1, 2] = y * z * v - x * s
    R[2, 0] = z * x * v - y * s; R[2, 1] = z * y * v + x * s; R[2, 2] = c + z * z * v


@njit(cache=True)
def mm(A, B, C):
    for i in range(3):
        for j in range(3):
            C[i, j] = A[i, 0] * B[0, j] + A[i, 1] * B[1, j] + A[i, 2] * B[2, j]


@njit(cache=True)
def mv(A, b, c):
    for i in range(3):
        c[i] = A[i, 0] * b[0] + A[i, 1] * b[1] + A[i, 2] * b[2]


@njit(cache=True)
def chain(q, R0, p0, ax, R, p, z):
    n = q.shape[0]
    A = np.zeros((3, 3)); B = np.zeros((3, 3)); w = np.zeros(3)
    for i in range(n):
        rot(ax[i], q[i], A)
        mm(R0[i], A, B)
        if i == 0:
            R[0] = B
            p[0] = p0[0]
        else:
            mm(R[i - 1], B, R[i])
            mv(R[i - 1], p0[i], w)
            for k in range(3):
                p[i, k] = p[i - 1, k] + w[k]
        mv(R[i], ax[i], z[i])


@njit(cache=True)
def fk_all(Q, R0, p0, ax):
    N, n = Q.shape
    RR = np.zeros((N, 3, 3)); PP = np.zeros((N, 3))
    R = np.zeros((n, 3, 3)); p = np.zeros((n, 3)); z = np.zeros((n, 3))
    for i in range(N):
        chain(Q[i], R0, p0, ax, R, p, z)
        RR[i] = R[n - 1]; PP[i] = p[n - 1]
    return RR, PP


@njit(cache=True)
def cr(a, b, o):
    o[0] = a[1] * b[2] - a[2] * b[1]; o[1] = a[2] * b[0] - a[0] * b[2]; o[2] = a[0] * b[1] - a[1] * b[0]


@njit(cache=True)
def dyn(q, dq, ddq, R0, p0, ax, m, c, I, grav, M, h, wantM, R, p, z, tmp):
    """h = ID(q,dq,ddq); M = mass matrix if wantM. tmp: (12+..., 3) scratch kept by the caller."""
    n = q.shape[0]
    chain(q, R0, p0, ax, R, p, z)
    W = tmp[0]; AL = tmp[1]; A = tmp[2]; F = tmp[3]; NM = tmp[4]; C = tmp[5]
    x = tmp[6, 0]; y = tmp[6, 1]; u = tmp[6, 2]; d = tmp[6, 3]
    for i in range(n):
        for k in range(3):
            if i == 0:
                W[i, k] = z[i, k] * dq[i]
                AL[i, k] = z[i, k] * ddq[i]
                A[i, k] = -grav[k]
            else:
                W[i, k] = W[i - 1, k] + z[i, k] * dq[i]
        if i > 0:
            cr(W[i - 1], z[i], x)
            for k in range(3):
                AL[i, k] = AL[i - 1, k] + z[i, k] * ddq[i] + x[k] * dq[i]
                d[k] = p[i, k] - p[i - 1, k]
            cr(AL[i - 1], d, x); cr(W[i - 1], d, y); cr(W[i - 1], y, u)
            for k in range(3):
                A[i, k] = A[i - 1, k] + x[k] + u[k]
        mv(R[i], c[i], C[i])
        cr(AL[i], C[i], x); cr(W[i], C[i], y); cr(W[i], y, u)
        for k in range(3):
            F[i, k] = m[i] * (A[i, k] + x[k] + u[k])
        # moment about the com in world axes
        for k in range(3):
            x[k] = R[i, 0, k] * W[i, 0] + R[i, 1, k] * W[i, 1] + R[i, 2, k] * W[i, 2]
            y[k] = R[i, 0, k] * AL[i, 0] + R[i, 1, k] * AL[i, 1] + R[i, 2, k] * AL[i, 2]
        mv(I[i], x, u)
        cr(x, u, d)
        mv(I[i], y, u)
        for k in range(3):
            d[k] += u[k]
        mv(R[i], d, NM[i])
        for k in range(3):
            C[i, k] += p[i, k]
    f0 = f1 = f2 = 0.0
    n0 = n1 = n2 = 0.0
    for i in range(n - 1, -1, -1):
        # f, n about origin of joint i
        if i < n - 1:
            a = p[i + 1, 0] - p[i, 0]; b = p[i + 1, 1] - p[i, 1]; e = p[i + 1, 2] - p[i, 2]
            n0 += b * f2 - e * f1; n1 += e * f0 - a * f2; n2 += a * f1 - b * f0
        a = C[i, 0] - p[i, 0]; b = C[i, 1] - p[i, 1]; e = C[i, 2] - p[i, 2]
        n0 += NM[i, 0] + b * F[i, 2] - e * F[i, 1]; n1 += NM[i, 1] + e * F[i, 0] - a * F[i, 2]; n2 += NM[i, 2] + a * F[i, 1] - b * F[i, 0]
        f0 += F[i, 0]; f1 += F[i, 1]; f2 += F[i, 2]
        h[i] = z[i, 0] * n0 + z[i, 1] * n1 + z[i, 2] * n2
    if wantM:
        for i in range(n):
            for j in range(n):
                M[i, j] = 0.0
        G = tmp[7]; H = tmp[8]; Q = tmp[9]
        for l in range(n):
            for i in range(l + 1):
                for k in range(3):
                    d[k] = C[l, k] - p[i, k]
                    x[k] = R[l, 0, k] * z[i, 0] + R[l, 1, k] * z[i, 1] + R[l, 2, k] * z[i, 2]
                    H[i, k] = x[k]
                cr(z[i], d, G[i])
                mv(I[l], x, Q[i])
            for i in range(l + 1):
                for j in range(i + 1):
                    s = m[l] * (G[i, 0] * G[j, 0] + G[i, 1] * G[j, 1] + G[i, 2] * G[j, 2]) + Q[i, 0] * H[j, 0] + Q[i, 1] * H[j, 1] + Q[i, 2] * H[j, 2]
                    M[i, j] += s
                    if i != j:
                        M[j, i] += s


@njit(cache=True)
def chol_solve(M, b, L, x):
    n = b.shape[0]
    for i in range(n):
        for j in range(i + 1):
            s = M[i, j]
            for k in range(j):
                s -= L[i, k] * L[j, k]
            if i == j:
                L[i, i] = math.sqrt(s if s > 1e-12 else 1e-12)
            else:
                L[i, j] = s / L[j, j]
    for i in range(n):
        s = b[i]
        for k in range(i):
            s -= L[i, k] * x[k]
        x[i] = s / L[i, i]
    for i in range(n - 1, -1, -1):
        s = x[i]
        for k in range(i + 1, n):
            s -= L[k, i] * x[k]
        x[i] = s / L[i, i]


@njit(cache=True)
def ik(pos, Rd, q0, R0, p0, ax, tp, tR, lo, hi, iters):
    """damped Newton along a path: pos (N,3), Rd (N,3,3) of the tip; stays near the middle of the joints"""
    N = pos.shape[0]; n = q0.shape[0]
    Q = np.zeros((N, n)); err = np.zeros(N)
    R = np.zeros((n, 3, 3)); p = np.zeros((n, 3)); z = np.zeros((n, 3))
    q = q0.copy(); J = np.zeros((6, n)); e = np.zeros(6)
    for i in range(N):
        it = iters * 12 if i == 0 else iters
        for _ in range(it):
            chain(q, R0, p0, ax, R, p, z)
            pt = p[n - 1] + R[n - 1] @ tp
            Rt = R[n - 1] @ tR
            e[:3] = pos[i] - pt
            E = Rd[i] @ Rt.T
            w = 0.5 * np.array([E[2, 1] - E[1, 2], E[0, 2] - E[2, 0], E[1, 0] - E[0, 1]])
            if E[0, 0] + E[1, 1] + E[2, 2] < 0:
                w = w / (np.sqrt(w @ w) + 1e-9) * 0.5
            e[3:] = w
            for j in range(n):
                J[:3, j] = np.cross(z[j], pt - p[j])
                J[3:, j] = z[j]
            ee = e.copy()
            s = np.sqrt(ee @ ee)
            if s > 0.2:
                ee *= 0.2 / s
            A = J @ J.T + 1e-8 * np.eye(6) if i > 0 else J @ J.T + 1e-4 * np.eye(6)
            q = q + J.T @ np.linalg.solve(A, ee)
        Q[i] = q
        err[i] = np.sqrt(e @ e)
    return Q, err


@njit(cache=True)
def loop(nst, dt, keep, Qd, dQd, ddQd, B, fmode, fdes, kf, Kq, Dq, ffm, R0, p0, ax, m, c, I, grav, Jr, Fr, Ft, tau_ext,
         tp, spt, snn, st1, st2, P, g, k, inh, contact_on):
    """closed loop; Qd.. at dt*keep grid (linear), B: joint direction of one metre along the normal; Fr: per joint
    [Fc, Fs, vs, b, asym, dry, load, len, ra, rb, order, ka, k0, r2a, r2b, offset]. Returns q, dq, ddq, tau, contact force (N,T1,T2), true depth, slip."""
    n = Qd.shape[1]
    no = nst // keep
    oq = np.zeros((no, n)); od = np.zeros((no, n)); oa = np.zeros((no, n)); ot = np.zeros((no, n)); of = np.zeros((no, 3)); ox = np.zeros((no, 3))
    q = Qd[0].copy(); dq = np.zeros(n); ddq = np.zeros(n)
    M = np.zeros((n, n)); Mi = np.zeros((n, n)); L = np.zeros((n, n)); h = np.zeros(n); hc = np.zeros(n); b = np.zeros(n); x = np.zeros(n)
    R = np.zeros((n, 3, 3)); p = np.zeros((n, 3)); z = np.zeros((n, 3)); tmp = np.zeros((10, max(n, 4), 3)); zero = np.zeros(n); zacc = np.zeros(n)
    u = np.zeros(n); tau = np.zeros(n); tj = np.zeros(n); S = np.zeros(ct.NS); out = np.zeros(3)
    xn = 0.0; nf = 0.0
    pt = np.zeros(3); vt = np.zeros(3); w = np.zeros(3); fw = np.zeros(3); rd = np.zeros(3)
    for s in range(nst):
        i = s // keep
        fr = (s - i * keep) / keep
        i1 = min(i + 1, no - 1)
        t = s * dt
        dyn(q, dq, zero, R0, p0, ax, m, c, I, grav, M, h, s % 2 == 0, R, p, z, tmp)
        # tip
        mv(R[n - 1], tp, rd)
        for kk in range(3):
            pt[kk] = p[n - 1, kk] + rd[kk]
            vt[kk] = 0.0
        for j in range(n):
            for kk in range(3):
                rd[kk] = pt[kk] - p[j, kk]
            cr(z[j], rd, w)
            for kk in range(3):
                vt[kk] += w[kk] * dq[j]
        if contact_on:
            dep = 0.0; rate = 0.0; s1 = 0.0; s2 = 0.0; v1 = 0.0; v2 = 0.0
            for kk in range(3):
                e = pt[kk] - spt[kk]
                dep -= e * snn[kk]; s1 += e * st1[kk]; s2 += e * st2[kk]
                rate -= vt[kk] * snn[kk]; v1 += vt[kk] * st1[kk]; v2 += vt[kk] * st2[kk]
            ct.step(P, g, k, S, dep, rate, s1, s2, v1, v2, t, dt, ct.place_factor(P, inh, s1, s2), out)
            for kk in range(3):
                fw[kk] = out[0] * snn[kk] + out[1] * st1[kk] + out[2] * st2[kk]
        nf += (out[0] - nf) * dt / 0.01
        # hybrid position/force: the outer loop moves the reference along the normal
        fm = fmode[i]
        if fm > 0:
            xn += dt * kf * (fdes[i] - nf)
        else:
            xn -= dt * xn / 0.4
        xn = min(max(xn, -0.03), 0.03)
        for j in range(n):
            qd = Qd[i, j] + fr * (Qd[i1, j] - Qd[i, j]) - B[i, j] * xn
            dd = dQd[i, j] + fr * (dQd[i1, j] - dQd[i, j])
            aa = ddQd[i, j] + fr * (ddQd[i1, j] - ddQd[i, j])
            # joint friction, elastic at rest
            dx = dq[j] * dt
            if dx != 0:
                sg = 1.0 if dx > 0 else -1.0
                u[j] = sg + (u[j] - sg) * math.exp(-abs(dx) / Fr[j, 7])
            tr = tau[j]
            fric = (Fr[j, 0] + Fr[j, 1] * math.exp(-(dq[j] / Fr[j, 2]) ** 2) + Fr[j, 6] * abs(tj[j])) * u[j] + Fr[j, 3] * dq[j] + Fr[j, 4] * abs(dq[j]) + Fr[j, 5] * abs(u[j])
            ph = Fr[j, 10] * q[j]
            spring = Fr[j, 8] * math.sin(ph) + Fr[j, 9] * math.cos(ph) + Fr[j, 13] * math.sin(2 * ph) + Fr[j, 14] * math.cos(2 * ph) + Fr[j, 11] * q[j] + Fr[j, 12]
            tau[j] = Kq[j] * (qd - q[j]) + Dq[j] * (dd - dq[j]) + h[j] + ffm * (M[j, j] + Jr[j]) * aa + Ft[j] * fric
            b[j] = tau[j] - h[j] - fric - spring - Fr[j, 15] - tau_ext[i, j]
            hc[j] = fric + spring + Fr[j, 15] + tau_ext[i, j]
        if contact_on:
            for j in range(n):
                for kk in range(3):
                    rd[kk] = pt[kk] - p[j, kk]
                cr(z[j], rd, w)
                b[j] += w[0] * fw[0] + w[1] * fw[1] + w[2] * fw[2]
        if s % 2 == 0:
            for j in range(n):
                for l in range(n):
                    Mi[j, l] = M[j, l]
                Mi[j, j] += Jr[j]
        chol_solve(Mi, b, L, x)
        if s % keep == 0:
            for j in range(n):
                oq[i, j] = q[j]; od[i, j] = dq[j]; oa[i, j] = x[j]; ot[i, j] = tau[j]
            for kk in range(3):
                of[i, kk] = out[kk]
            if contact_on:
                ox[i, 0] = dep; ox[i, 1] = s1; ox[i, 2] = s2
        for j in range(n):
            tj[j] = tau[j] - hc[j] - Jr[j] * x[j]
            ddq[j] = x[j]
            dq[j] += dt * x[j]
            q[j] += dt * dq[j]
    return oq, od, oa, ot, of, ox
