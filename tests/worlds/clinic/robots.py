"""Arms: batch kinematics and Newton-Euler dynamics in numpy over whole logs (models read by Pinocchio, which check.py compares with)."""
import functools
import os

import numpy as np

HERE = os.path.dirname(os.path.abspath(__file__))
LWR = os.environ.get("CLINIC_LWR", os.path.join(HERE, "lwr4plus.urdf"))
G0 = np.array([0.0, 0.0, -9.81])

# name: sensor frame, tip frame, joints locked, home pose (tool roughly down), base for free motion
ARMS = {
    "lwr4plus": dict(sensor="ft_sensor", tip="tool_tip", n=7, home=[0.1, -0.45, 0.05, 1.65, 0.1, -1.05, 0.2]),
    "panda": dict(sensor="panda_link8", tip="panda_hand_tcp", n=7, home=[0.05, -0.35, 0.02, -2.25, 0.03, 1.95, 0.75]),
    "ur10": dict(sensor="wrist_3_link", tip="tool0", n=6, home=[0.3, -1.3, 1.9, -2.1, -1.5708, 0.4]),
}


def skew(v):
    z = np.zeros(v.shape[:-1])
    return np.stack([np.stack([z, -v[..., 2], v[..., 1]], -1), np.stack([v[..., 2], z, -v[..., 0]], -1),
                     np.stack([-v[..., 1], v[..., 0], z], -1)], -2)


def expm(v):
    """rotation matrices of rotation vectors (..., 3)."""
    v = np.asarray(v, float)
    a = np.linalg.norm(v, axis=-1)[..., None, None]
    K = skew(v)
    small = a < 1e-8
    a_ = np.where(small, 1.0, a)
    return np.eye(3) + np.where(small, 1.0, np.sin(a_) / a_) * K + np.where(small, 0.5, (1 - np.cos(a_)) / a_ ** 2) * (K @ K)


def logm(R):
    c = np.clip((np.trace(R, axis1=-2, axis2=-1) - 1) / 2, -1, 1)
    a = np.arccos(c)
    w = np.stack([R[..., 2, 1] - R[..., 1, 2], R[..., 0, 2] - R[..., 2, 0], R[..., 1, 0] - R[..., 0, 1]], -1) / 2
    s = np.where(a < 1e-6, 1.0, a / np.where(a < 1e-6, 1.0, np.sin(a)))
    return w * s[..., None]


def mv(R, v):
    return np.einsum("...ij,...j->...i", R, v)


class Arm:
    def __init__(self, name):
        import pinocchio as pin
        spec = ARMS[name]
        if name == "lwr4plus":
            model = pin.buildModelFromUrdf(LWR)
        else:
            import example_robot_data as erd
            model = erd.load(name).model
        locked = [i for i, j in enumerate(model.names) if "finger" in j]
        if locked:
            model = pin.buildReducedModel(model, locked, pin.neutral(model))
        self.pin, self.name, self.nq = model, name, model.nq
        self.joint_names = list(model.names)[1:]
        self.sensor, self.tip, self.home = spec["sensor"], spec["tip"], np.array(spec["home"])
        self.place_R = np.array([model.jointPlacements[i].rotation for i in range(1, model.njoints)])
        self.place_p = np.array([model.jointPlacements[i].translation for i in range(1, model.njoints)])
        axis = []
        for i in range(1, model.njoints):
            short = model.joints[i].shortname()
            axis.append({"X": [1, 0, 0], "Y": [0, 1, 0], "Z": [0, 0, 1]}[short[-1]] if short[-1] in "XYZ" else
                        np.array(model.joints[i].extract().axis if hasattr(model.joints[i], "extract") else self._axis(model, i)))
        self.axis = np.array(axis, float)
        self.mass = np.array([model.inertias[i].mass for i in range(1, model.njoints)])
        self.com = np.array([model.inertias[i].lever for i in range(1, model.njoints)])
        self.inertia = np.array([model.inertias[i].inertia for i in range(1, model.njoints)])
        fs, ft = (model.frames[model.getFrameId(f)] for f in (self.sensor, self.tip))
        self.s_R, self.s_p = fs.placement.rotation.copy(), fs.placement.translation.copy()
        rel = fs.placement.inverse() * ft.placement
        self.tip_in_sensor, self.tip_R = rel.translation.copy(), rel.rotation.copy()
        self.vmax, self.effort = model.velocityLimit.copy(), model.effortLimit.copy()
        self.qmin, self.qmax = model.lowerPositionLimit.copy(), model.upperPositionLimit.copy()

    @staticmethod
    def _axis(model, i):
        d = model.createData()
        import pinocchio as pin
        q = pin.neutral(model)
        pin.computeJointJacobians(model, d, q)
        return pin.getJointJacobian(model, d, i, pin.ReferenceFrame.LOCAL)[3:, model.joints[i].idx_v]

    def joint_rotation(self, i, q):
        a, K = self.axis[i], skew(self.axis[i])
        s, c = np.sin(q)[:, None, None], (1 - np.cos(q))[:, None, None]
        return self.place_R[i] @ (np.eye(3) + s * K + c * (K @ K))

    def chain(self, q, dq=None, ddq=None):
        """per joint: R, p, axis in base; with rates also omega, alpha and a of the joint frames (base frame, no gravity)."""
        n = len(q)
        R, p = np.broadcast_to(np.eye(3), (n, 3, 3)), np.zeros((n, 3))
        w = al = ac = np.zeros((n, 3))
        out = []
        for i in range(self.nq):
            d = mv(R, self.place_p[i])
            if dq is not None:
                ac = ac + np.cross(al, d) + np.cross(w, np.cross(w, d))
            p = p + d
            R = R @ self.joint_rotation(i, q[:, i])
            z = mv(R, self.axis[i])
            if dq is not None:
                al = al + z * ddq[:, i:i + 1] + np.cross(w, z) * dq[:, i:i + 1]
                w = w + z * dq[:, i:i + 1]
            out.append((R, p, z, w, al, ac))
        return out

    def sensor_motion(self, q, dq=None, ddq=None):
        """sensor rotation R, tip position and velocity (base), and in the sensor frame: omega, alpha, acceleration of its origin."""
        R, p, _, w, al, ac = self.chain(q, dq, ddq)[-1]
        d = mv(R, self.s_p)
        Rs, ps = R @ self.s_R, p + d
        tip = ps + mv(Rs, self.tip_in_sensor)
        if dq is None:
            return dict(R=Rs, p=tip)
        a_s = ac + np.cross(al, d) + np.cross(w, np.cross(w, d))
        T = np.swapaxes(Rs, 1, 2)
        J = self.tip_jacobian(q, tip)
        return dict(R=Rs, p=tip, v=np.einsum("nij,nj->ni", J, dq), w=mv(T, w), al=mv(T, al), a=mv(T, a_s), w_base=w)

    def tip_jacobian(self, q, tip=None):
        ch = self.chain(q)
        if tip is None:
            R, p = ch[-1][0], ch[-1][1]
            tip = p + mv(R, self.s_p) + mv(R @ self.s_R, self.tip_in_sensor)
        return np.stack([np.cross(z, tip - p) for _, p, z, *_ in ch], -1)

    def pose_jacobian(self, q):
        ch = self.chain(q)
        R, p = ch[-1][0], ch[-1][1]
        Rs = R @ self.s_R
        tip = p + mv(R, self.s_p) + mv(Rs, self.tip_in_sensor)
        return Rs, tip, np.stack([np.concatenate([np.cross(z, tip - p), z], -1) for _, p, z, *_ in ch], -1)

    def inverse(self, p, R, iterations=14):
        """joint paths for tip positions p and sensor rotations R: damped Newton from home, the target brought in by steps."""
        n = len(p)
        q = np.tile(self.home, (n, 1))
        R0, p0, _ = self.pose_jacobian(q[:1])
        rel = logm(R0[0].T @ R)
        for k in range(iterations):
            f = min(1.0, (k + 1) / (iterations - 6))
            Rt, pt = R0[0] @ expm(rel * f), p0[0] + (p - p0[0]) * f
            Rs, tip, J = self.pose_jacobian(q)
            e = np.concatenate([pt - tip, mv(Rs, logm(np.swapaxes(Rs, 1, 2) @ Rt))], -1)
            M = J @ np.swapaxes(J, 1, 2) + 1e-9 * np.eye(6)
            q = q + np.einsum("nji,nj->ni", J, np.linalg.solve(M, e[..., None])[..., 0])
        return q, np.abs(e).max()

    def rnea(self, q, dq, ddq, g=G0, extra=None):
        """joint torques; g (3,) in the base frame; extra = (mass, com in the sensor frame) bolted to the last link."""
        ch = self.chain(q, dq, ddq)
        n = len(q)
        tau = np.zeros((n, self.nq))
        f, m = np.zeros((n, 3)), np.zeros((n, 3))          # on the joint frame's origin
        for i in range(self.nq - 1, -1, -1):
            R, p, z, w, al, ac = ch[i]
            bodies = [(self.mass[i], self.com[i], self.inertia[i])]
            if extra is not None and i == self.nq - 1:
                bodies.append((extra[0], self.s_p + self.s_R @ np.asarray(extra[1]), np.zeros((3, 3))))
            if i + 1 < self.nq:
                m = m + np.cross(ch[i + 1][1] - p, f)
            for mass, com, I in bodies:
                c = mv(R, com)
                fi = mass * (ac + np.cross(al, c) + np.cross(w, np.cross(w, c)) - g)
                Ib = R @ I @ np.swapaxes(R, 1, 2)
                f = f + fi
                m = m + np.cross(c, fi) + mv(Ib, al) + np.cross(w, mv(Ib, w))
            tau[:, i] = np.einsum("ni,ni->n", z, m)
        return tau


@functools.lru_cache(None)
def arm(name):
    return Arm(name)
