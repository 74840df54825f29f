"""Arms of the godwit world: URDFs of our own, chains pulled out of Pinocchio, compiled FK and path IK."""
import json, os
import numpy as np
import pinocchio as pin
from numba import njit

LWR_OFF = [0.11, 0.2005, 0.20, 0.20, 0.20, 0.19, 0.078]
LWR_AX = [(0, 0, 1), (0, -1, 0), (0, 0, 1), (0, 1, 0), (0, 0, 1), (0, -1, 0), (0, 0, 1)]
IIWA_OFF = [0.1575, 0.2025, 0.2045, 0.2155, 0.1845, 0.2155, 0.081]
IIWA_AX = [(0, 0, 1), (0, 1, 0), (0, 0, 1), (0, -1, 0), (0, 0, 1), (0, 1, 0), (0, 0, 1)]
IIWA_IN = [(4.1, (0, -.03, .12), (.05, .045, .018, 0, 0, .008)), (4.0, (.0003, .045, .06), (.045, .02, .04, 0, 0, -.008)),
           (3.0, (0, .03, .13), (.03, .027, .01, 0, 0, -.006)), (2.7, (0, .05, .034), (.022, .009, .019, 0, 0, -.004)),
           (1.7, (.0001, .021, .076), (.0125, .0085, .0045, 0, 0, -.0035)), (1.8, (0, .0006, .0004), (.0049, .0048, .0036, 0, 0, .0001)),
           (0.5, (0, 0, .012), (.0006, .0006, .0009, 0, 0, 0))]
LIM = ' <limit lower="-2.9" upper="2.9" effort="200" velocity="3"/>'


def urdf_text(name, off, ax, inert, sensor_z, tip_xyz, tip_rpy):
    """A seven-axis arm with flange, ft_sensor and tool_tip frames (all massless beyond link_7)."""
    s = ['<?xml version="1.0"?>', f'<robot name="{name}">', '<link name="base_link"/>']
    for i in range(7):
        m, c, I = inert[i]
        s.append(f'<link name="link_{i+1}"><inertial><origin xyz="{c[0]} {c[1]} {c[2]}" rpy="0 0 0"/><mass value="{m}"/>'
                 f'<inertia ixx="{I[0]}" iyy="{I[1]}" izz="{I[2]}" ixy="{I[3]}" ixz="{I[4]}" iyz="{I[5]}"/></inertial></link>')
        par = 'base_link' if i == 0 else f'link_{i}'
        s.append(f'<joint name="joint_{i+1}" type="revolute"><parent link="{par}"/><child link="link_{i+1}"/>'
                 f'<origin xyz="0 0 {off[i]}" rpy="0 0 0"/><axis xyz="{ax[i][0]} {ax[i][1]} {ax[i][2]}"/>{LIM}</joint>')

    def fixed(n, parent, xyz, rpy):
        s.append(f'<link name="{n}"/><joint name="{n}_fixed" type="fixed"><parent link="{parent}"/><child link="{n}"/>'
                 f'<origin xyz="{xyz[0]:.6f} {xyz[1]:.6f} {xyz[2]:.6f}" rpy="{rpy[0]:.6f} {rpy[1]:.6f} {rpy[2]:.6f}"/></joint>')
    fixed('flange', 'link_7', (0, 0, 0 if off[6] == 0.078 else 0.045), (0, 0, 0))
    fixed('ft_sensor', 'flange', (0, 0, sensor_z), (0, 0, 0.349066 if tip_rpy[2] else 0))
    fixed('tool_tip', 'ft_sensor', tip_xyz, tip_rpy)
    s.append('</robot>')
    return '\n'.join(s) + '\n'


def lwr_inertia():
    here = os.path.dirname(os.path.abspath(__file__))
    for p in (os.path.join(here, 'lwr4plus_inertia.json'),):
        if os.path.exists(p):
            return [(l['m'], l['com'], l['I']) for l in json.load(open(p))]
    raise FileNotFoundError('lwr4plus_inertia.json')


class Arm:
    """kind: lwr4plus (frames of the shipped model only), lwr (URDF of ours), iiwa, panda, ur5, ur10."""

    def __init__(self, kind, rng=None):
        self.kind, self.urdf, self.urdf_name = kind, None, None
        if kind in ('lwr4plus', 'lwr', 'iiwa'):
            sz = 0.02 if rng is None else round(float(rng.uniform(.005, .04)), 4)
            tip = (0., 0., .1) if rng is None else tuple(np.round([rng.uniform(-.02, .02), rng.uniform(-.02, .02), rng.uniform(.06, .16)], 4))
            rpy = (0., 0., 0.) if rng is None else tuple(np.round([rng.uniform(-.2, .2), rng.uniform(-.2, .2), rng.choice([0, .7])], 4))
            if kind == 'iiwa':
                self.urdf = urdf_text('iiwa_like', IIWA_OFF, IIWA_AX, IIWA_IN, sz, tip, rpy)
                self.q0 = np.array([.2, .5, .1, -1.4, -.1, 1.2, .3])
            else:
                self.urdf = urdf_text('lwr4plus_godwit', LWR_OFF, LWR_AX, lwr_inertia(), sz, tip, rpy)
                self.q0 = np.array([.2, .5, -.1, -1.4, .1, 1.2, .3])
            self.full = pin.buildModelFromXML(self.urdf)
            self.sensor, self.tip = 'ft_sensor', 'tool_tip'
            if kind == 'lwr4plus':
                self.sensor = self.tip = 'flange'
            self.urdf_name = None if kind == 'lwr4plus' else f'{kind}_arm.urdf'
            self.rig_model = 'lwr4plus' if kind == 'lwr4plus' else self.urdf_name
            self.model = self.full
        else:
            import example_robot_data as erd
            self.full = erd.load(kind).model
            self.rig_model = kind
            if kind == 'panda':
                lock = [self.full.getJointId(n) for n in ('panda_finger_joint1', 'panda_finger_joint2')]
                self.model = pin.buildReducedModel(self.full, lock, np.zeros(9))
                self.sensor, self.tip = 'panda_link8', 'panda_hand_tcp'
                self.q0 = np.array([.1, -.5, .1, -2.2, .1, 1.75, .8])
            else:
                self.model = self.full
                self.sensor, self.tip = 'wrist_3_link', 'tool0'
                self.q0 = np.array([.3, -1.2, 1.6, -1.9, -1.5, .3])
        m = self.model
        self.n = m.nq
        self.names = list(m.names)[1:]
        if rng is not None:
            self.q0 = self.q0 + rng.uniform(-.12, .12, self.n)
        d = m.createData()
        pin.computeJointJacobians(m, d, np.zeros(self.n))
        self.Rj = np.array([m.jointPlacements[i + 1].rotation for i in range(self.n)])
        self.pj = np.array([m.jointPlacements[i + 1].translation for i in range(self.n)])
        self.ax = np.array([pin.getJointJacobian(m, d, i + 1, pin.LOCAL)[3:, i] for i in range(self.n)])
        fs, ft = m.frames[m.getFrameId(self.sensor)], m.frames[m.getFrameId(self.tip)]
        assert fs.parentJoint == self.n and ft.parentJoint == self.n
        self.Rs, self.ps = np.array(fs.placement.rotation), np.array(fs.placement.translation)
        self.Rt, self.pt = np.array(ft.placement.rotation), np.array(ft.placement.translation)
        self.r_tip = self.Rs.T @ (self.pt - self.ps)          # tip in the sensor frame
        self.R_st = self.Rs.T @ self.Rt                        # tip axes in the sensor frame

    def fk(self, q):
        return fk_many(np.ascontiguousarray(q), self.Rj, self.pj, self.ax, self.Rt, self.pt)

    def ik(self, t, P, R):
        return ik_path(self.q0.copy(), t, P, R, self.Rj, self.pj, self.ax, self.Rt, self.pt)


@njit(cache=True)
def rot(ax, a):
    c, s = np.cos(a), np.sin(a)
    x, y, z = ax
    C = 1 - c
    return np.array([[c + x*x*C, x*y*C - z*s, x*z*C + y*s], [y*x*C + z*s, c + y*y*C, y*z*C - x*s], [z*x*C - y*s, z*y*C + x*s, c + z*z*C]])


@njit(cache=True)
def fk_many(Q, Rj, pj, ax, Rt, pt):
    N, n = Q.shape
    P, RR = np.empty((N, 3)), np.empty((N, 3, 3))
    for k in range(N):
        R, p = np.eye(3), np.zeros(3)
        for i in range(n):
            p = p + R @ pj[i]
            R = R @ Rj[i] @ rot(ax[i], Q[k, i])
        P[k] = p + R @ pt
        RR[k] = R @ Rt
    return P, RR


@njit(cache=True)
def ik_path(q, t, P, RR, Rj, pj, ax, Rt, pt):
    N, n = P.shape[0], q.shape[0]
    q0 = q.copy()
    Q = np.empty((N, n))
    og, zg = np.empty((n, 3)), np.empty((n, 3))
    worst = 0.0
    for k in range(N):
        e = np.zeros(6)
        for it in range(12 if k else 100):
            R, p = np.eye(3), np.zeros(3)
            for i in range(n):
                p = p + R @ pj[i]
                R = R @ Rj[i]
                og[i] = p
                zg[i] = R @ ax[i]
                R = R @ rot(ax[i], q[i])
            pe = p + R @ pt
            Re = RR[k] @ (R @ Rt).T
            e[:3] = P[k] - pe
            w = np.array([Re[2, 1] - Re[1, 2], Re[0, 2] - Re[2, 0], Re[1, 0] - Re[0, 1]])
            e[3:] = 0.5 * w
            if np.max(np.abs(e)) < 1e-10 and it > 0:
                break
            J = np.empty((6, n))
            for i in range(n):
                J[:3, i] = np.cross(zg[i], pe - og[i])
                J[3:, i] = zg[i]
            A = J @ J.T
            for i in range(6):
                A[i, i] += 1e-12
            dq = J.T @ np.linalg.solve(A, e)
            if n > 6 and it == 0 and k > 0:
                g = (q0 - q) * min(0.5 * (t[k] - t[k-1]), 0.1)
                dq = dq + g - J.T @ np.linalg.solve(A, J @ g)
            q = q + dq
        worst = max(worst, np.max(np.abs(e)))
        Q[k] = q
    return Q, worst


@njit(cache=True)
def expso3(W):
    N = W.shape[0]
    out = np.empty((N, 3, 3))
    for k in range(N):
        a = np.sqrt(W[k, 0]**2 + W[k, 1]**2 + W[k, 2]**2)
        if a < 1e-12:
            out[k] = np.eye(3)
        else:
            out[k] = rot(W[k] / a, a)
    return out
