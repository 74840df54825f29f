"""Robots: URDF chain -> own forward kinematics (numba) and a MuJoCo model with a welded tool and a force/torque sensor."""
import os
import xml.etree.ElementTree as ET
import numpy as np
from numba import njit

HERE = os.path.dirname(os.path.abspath(__file__))
ROBOTS = {
    "lwr4plus": dict(urdf="lwr4plus.urdf", sensor="ft_sensor", tip="tool_tip",
                     joints=[f"joint_{i}" for i in range(1, 8)], scale=[176, 176, 100, 100, 100, 38, 38],
                     armature=[1.0, 1.0, .6, .6, .25, .12, .08], wrist=(4, 5, 6),
                     home=np.array([0.1, -0.75, 0.1, 1.7, 0.0, -0.69, 0.2])),
    "ur5": dict(urdf="ur5_robot.urdf", sensor="wrist_3_link", tip="tool0",
                joints=["shoulder_pan_joint", "shoulder_lift_joint", "elbow_joint", "wrist_1_joint", "wrist_2_joint",
                        "wrist_3_joint"], scale=[150, 150, 150, 28, 28, 28],
                armature=[1.2, 1.2, .8, .25, .2, .15], wrist=(3, 4, 5),
                home=np.array([0.1, -1.26, 2.18, -2.49, -1.57, -1.2])),
}


def rpy(r, p, y):
    cr, sr, cp, sp, cy, sy = np.cos(r), np.sin(r), np.cos(p), np.sin(p), np.cos(y), np.sin(y)
    return np.array([[cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
                     [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr], [-sp, cp * sr, cp * cr]])


def rotvec(v):
    v = np.asarray(v, float)
    a = np.linalg.norm(v)
    if a < 1e-12:
        return np.eye(3)
    k = v / a
    S = np.array([[0, -k[2], k[1]], [k[2], 0, -k[0]], [-k[1], k[0], 0]])
    return np.eye(3) + np.sin(a) * S + (1 - np.cos(a)) * S @ S


def _tree(name):
    return ET.parse(os.path.join(HERE, "models", ROBOTS[name]["urdf"]))


class Chain:
    """Fixed transforms, axes; last: sensor frame and tip in the sensor frame."""

    def __init__(self, name):
        self.name = name
        spec = ROBOTS[name]
        by_child = {j.find("child").get("link"): j for j in _tree(name).getroot().findall("joint") if j.find("child") is not None}

        def up(link):
            out = []
            while link in by_child:
                out.append(by_child[link])
                link = by_child[link].find("parent").get("link")
            return out[::-1]

        def tf(j):
            o = j.find("origin")
            if o is None:
                return np.eye(3), np.zeros(3)
            g = lambda a: [float(v) for v in (o.get(a) or "0 0 0").split()]
            return rpy(*g("rpy")), np.array(g("xyz"))

        R, p = np.eye(3), np.zeros(3)
        Rs, ps, ax, lim = [], [], [], []
        for j in up(spec["sensor"]):
            Rj, pj = tf(j)
            R, p = R @ Rj, R @ pj + p
            if j.get("type") in ("revolute", "continuous"):
                Rs.append(R); ps.append(p)
                ax.append([float(v) for v in j.find("axis").get("xyz").split()])
                li = j.find("limit")
                lim.append([float(li.get(k)) for k in ("lower", "upper", "velocity")])
                R, p = np.eye(3), np.zeros(3)
        self.R, self.p, self.axis, self.limits = np.array(Rs), np.array(ps), np.array(ax), np.array(lim)
        self.Rs, self.ps = R, p                      # sensor frame in the last joint's frame
        R, p = np.eye(3), np.zeros(3)
        for j in up(spec["tip"])[len(up(spec["sensor"])):]:
            Rj, pj = tf(j)
            R, p = R @ Rj, R @ pj + p
        if spec["tip"] == "tool0":                   # a sibling branch: both hang on wrist_3_link
            assert up("tool0")[-1].find("parent").get("link") == "wrist_3_link"
        self.Rt, self.rtip = R, p                    # tip frame in the sensor frame
        self.n = len(ax)
        self.pack = (self.R, self.p, self.axis, self.Rs, self.ps)

    def batch(self, q):
        """Sensor origin (n,3) and rotation (n,3,3) for joint angles q (n,N)."""
        P, R = np.empty((len(q), 3)), np.empty((len(q), 3, 3))
        fk_batch(self.pack, np.ascontiguousarray(q), P, R)
        return P, R

    def ik(self, q0, path_p, path_R, qnom, w_null=0.02, tip=None):
        tip = self.rtip if tip is None else tip
        Q = np.empty((len(path_p), self.n))
        err = ik_path(self.pack, tip, np.array(q0, float), np.ascontiguousarray(path_p), np.ascontiguousarray(path_R), np.array(qnom, float), w_null, Q)
        return Q, err


@njit(cache=True, nogil=True)
def _rot(axis, a, R):
    c, s = np.cos(a), np.sin(a)
    x, y, z = axis
    R[0, 0] = c + x * x * (1 - c); R[0, 1] = x * y * (1 - c) - z * s; R[0, 2] = x * z * (1 - c) + y * s
    R[1, 0] = y * x * (1 - c) + z * s; R[1, 1] = c + y * y * (1 - c); R[1, 2] = y * z * (1 - c) - x * s
    R[2, 0] = z * x * (1 - c) - y * s; R[2, 1] = z * y * (1 - c) + x * s; R[2, 2] = c + z * z * (1 - c)


@njit(cache=True, nogil=True)
def mm(A, B, out):
    for i in range(3):
        for j in range(3):
            out[i, j] = A[i, 0] * B[0, j] + A[i, 1] * B[1, j] + A[i, 2] * B[2, j]


@njit(cache=True, nogil=True)
def mv(A, b, out):
    for i in range(3):
        out[i] = A[i, 0] * b[0] + A[i, 1] * b[1] + A[i, 2] * b[2]


@njit(cache=True, nogil=True)
def fk(pack, q, p, R, anch, axw):
    """Sensor pose p, R in the base; anchors and axes of the joints in the base."""
    Rj, pj, ax, Rs, ps = pack
    n = q.size
    A, B, v = np.empty((3, 3)), np.empty((3, 3)), np.empty(3)
    for i in range(3):
        p[i] = 0.0
        for j in range(3):
            R[i, j] = 1.0 if i == j else 0.0
    for k in range(n):
        mv(R, pj[k], v)
        for i in range(3):
            p[i] += v[i]
        mm(R, Rj[k], A)
        mv(A, ax[k], v)
        for i in range(3):
            anch[k, i] = p[i]
            axw[k, i] = v[i]
        _rot(ax[k], q[k], B)
        mm(A, B, R)
    mv(R, ps, v)
    for i in range(3):
        p[i] += v[i]
    mm(R, Rs, A)
    for i in range(3):
        for j in range(3):
            R[i, j] = A[i, j]


@njit(cache=True, nogil=True)
def fk_batch(pack, q, P, R):
    n = q.shape[1]
    an, ax = np.empty((n, 3)), np.empty((n, 3))
    for i in range(q.shape[0]):
        fk(pack, q[i], P[i], R[i], an, ax)


@njit(cache=True, nogil=True)
def cross(a, b, o):
    o[0] = a[1] * b[2] - a[2] * b[1]
    o[1] = a[2] * b[0] - a[0] * b[2]
    o[2] = a[0] * b[1] - a[1] * b[0]


@njit(cache=True, nogil=True)
def rot_error(Rd, R, e):
    """Small rotation vector (base frame) that takes R to Rd."""
    for i in range(3):
        e[i] = 0.0
    a, o = np.empty(3), np.empty(3)
    b = np.empty(3)
    for c in range(3):
        for i in range(3):
            a[i] = R[i, c]
            b[i] = Rd[i, c]
        cross(a, b, o)
        for i in range(3):
            e[i] += 0.5 * o[i]


@njit(cache=True, nogil=True)
def ik_path(pack, tip, q0, pp, RR, qnom, wn, Q):
    n = q0.size
    q = q0.copy()
    p, R = np.empty(3), np.empty((3, 3))
    an, ax = np.empty((n, 3)), np.empty((n, 3))
    J = np.empty((6, n))
    r, pt, e, o = np.empty(3), np.empty(3), np.empty(6), np.empty(3)
    worst = 0.0
    for k in range(pp.shape[0]):
        its = 200 if k == 0 else 6
        for it in range(its):
            fk(pack, q, p, R, an, ax)
            mv(R, tip, r)
            for i in range(3):
                pt[i] = p[i] + r[i]
                e[i] = pp[k, i] - pt[i]
            rot_error(RR[k], R, o)
            m = 0.0
            for i in range(3):
                e[3 + i] = o[i]
            for i in range(6):
                m = max(m, abs(e[i]))
            if m < 1e-10 and it > 1:
                break
            for j in range(n):
                for i in range(3):
                    r[i] = pt[i] - an[j, i]
                cross(ax[j], r, o)
                for i in range(3):
                    J[i, j] = o[i]
                    J[3 + i, j] = ax[j, i]
            H = J @ J.T + 1e-8 * np.eye(6)
            dq0 = wn * (qnom - q) if k > 0 or it < 150 else np.zeros(n)
            y = np.linalg.solve(H, e - J @ dq0)
            dq = dq0 + J.T @ y
            s = 1.0
            mx = np.max(np.abs(dq))
            if mx > 0.3:
                s = 0.3 / mx
            q = q + s * dq
        fk(pack, q, p, R, an, ax)
        mv(R, tip, r)
        for i in range(3):
            worst = max(worst, abs(pp[k, i] - p[i] - r[i]))
        for j in range(n):
            Q[k, j] = q[j]
    return worst


@njit(cache=True, nogil=True)
def kin_batch(pack, q, dq, ddq, P, R, V, W, A, AL):
    """Sensor frame: pose, velocity, angular velocity, acceleration, angular acceleration, all in the base frame."""
    Rj, pj, ax, Rs, ps = pack
    n = q.shape[1]
    M, B, C = np.empty((3, 3)), np.empty((3, 3)), np.empty((3, 3))
    T = np.zeros((6, 3))
    r, o, o2, a = T[0], T[1], T[2], T[3]
    for k in range(q.shape[0]):
        p, v, w, ac, al = P[k], V[k], W[k], A[k], AL[k]
        for i in range(3):
            p[i] = v[i] = w[i] = ac[i] = al[i] = 0.0
            for j in range(3):
                C[i, j] = 1.0 if i == j else 0.0
        for j in range(n + 1):
            mv(C, pj[j] if j < n else ps, r)
            cross(w, r, o)
            cross(w, o, o2)
            cross(al, r, a)
            for i in range(3):
                p[i] += r[i]
                v[i] += o[i]
                ac[i] += a[i] + o2[i]
            mm(C, Rj[j] if j < n else Rs, M)
            if j == n:
                for i in range(3):
                    for c in range(3):
                        R[k, i, c] = M[i, c]
                break
            mv(M, ax[j], a)
            cross(w, a, o)
            for i in range(3):
                al[i] += o[i] * dq[k, j] + a[i] * ddq[k, j]
                w[i] += a[i] * dq[k, j]
            _rot(ax[j], q[k, j], B)
            mm(M, B, C)


def mujoco_model(name, gravity, tool, dt, payload=None, damping=0.15, armature=True):
    """tool/payload: dict mass, com, inertia (6, about the com, sensor axes). The sensor sits on the welded tool body."""
    import mujoco
    root = _tree(name).getroot()
    for link in root.findall("link"):
        for tag in ("visual", "collision"):
            for e in link.findall(tag):
                link.remove(e)
    for e in root.findall("mujoco") + root.findall("transmission") + root.findall("gazebo"):
        root.remove(e)
    comp = ET.SubElement(ET.SubElement(root, "mujoco"), "compiler")
    for a in ("fusestatic", "inertiafromgeom", "discardvisual"):
        comp.set(a, "false")
    spec = mujoco.MjSpec.from_string(ET.tostring(root, encoding="unicode"))
    spec.option.timestep = dt
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    spec.option.gravity = list(gravity)
    spec.option.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_CONTACT) | int(mujoco.mjtDisableBit.mjDSBL_LIMIT)
    host = spec.body(ROBOTS[name]["sensor"])
    body = host.add_body(name="kit")

    def put(b, t):
        b.explicitinertial = True
        b.mass, b.ipos = float(t["mass"]), list(t["com"])
        b.fullinertia = [t["inertia"][0], t["inertia"][1], t["inertia"][2], t["inertia"][3], t["inertia"][4], t["inertia"][5]]
    put(body, tool)
    if payload is not None:
        put(host.add_body(name="payload"), payload)
    body.add_site(name="ft")
    for nm, ty in (("f", mujoco.mjtSensor.mjSENS_FORCE), ("t", mujoco.mjtSensor.mjSENS_TORQUE)):
        spec.add_sensor(name=nm, type=ty, objtype=mujoco.mjtObj.mjOBJ_SITE, objname="ft")
    for i, jn in enumerate(ROBOTS[name]["joints"]):
        j = spec.joint(jn)
        j.armature = ROBOTS[name]["armature"][i] if armature is True else float(armature[i])
        j.damping = [damping, 0.0, 0.0]
        j.frictionloss = 0.0
    m = spec.compile()
    return m, mujoco.MjData(m), m.body("kit").id


if __name__ == "__main__":
    import mujoco
    for nm in ROBOTS:
        c = Chain(nm)
        m, d, b = mujoco_model(nm, [0, 0, -9.81], dict(mass=.3, com=[0, 0, .05], inertia=[2e-4] * 3 + [0] * 3), 5e-4)
        q = np.random.default_rng(0).uniform(-1, 1, c.n)
        d.qpos[:] = q
        mujoco.mj_forward(m, d)
        p, R = c.batch(q[None])
        print(nm, m.nv, np.abs(d.xpos[b] - p[0]).max(), np.abs(d.xmat[b].reshape(3, 3) - R[0]).max(), c.rtip, [m.joint(i).name for i in range(m.nv)])
