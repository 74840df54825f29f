"""Arms: emits clean URDFs with the frames ft_sensor and tool_tip, and arrays for the kernels."""
import json, os
import numpy as np
import pinocchio as pin
HERE = os.path.dirname(os.path.abspath(__file__))


def raw(name):
    """list of (R, p, axis, m, com, I, lower, upper), flange (R, p)"""
    if name == "lwr":
        L = json.load(open(os.path.join(HERE, "lwr4plus_inertia.json")))
        off = [.11, .2005, .20, .20, .20, .19, .078]
        ax = [[0, 0, 1], [0, -1, 0], [0, 0, 1], [0, 1, 0], [0, 0, 1], [0, -1, 0], [0, 0, 1]]
        lim = np.radians([170, 120, 170, 120, 170, 120, 170])
        out = []
        for i in range(7):
            a = L[i]["I"]
            I = np.array([[a[0], a[3], a[4]], [a[3], a[1], a[5]], [a[4], a[5], a[2]]])
            out.append((np.eye(3), np.array([0, 0, off[i]]), np.array(ax[i], float), L[i]["m"], np.array(L[i]["com"]), I, -lim[i], lim[i]))
        return out, (np.eye(3), np.zeros(3))
    import example_robot_data as erd
    r = erd.load(name)
    m = r.model
    nj = {"panda": 7, "ur5": 6}[name]
    out = []
    for j in range(1, nj + 1):
        M = m.jointPlacements[j]
        sh = m.joints[j].shortname()
        ax = {"X": [1, 0, 0], "Y": [0, 1, 0], "Z": [0, 0, 1]}[sh[-1]]
        I = m.inertias[j]
        out.append((M.rotation.copy(), M.translation.copy(), np.array(ax, float), max(I.mass, .05), I.lever.copy(),
                    I.inertia + 1e-6 * np.eye(3), float(m.lowerPositionLimit[j - 1]), float(m.upperPositionLimit[j - 1])))
    if name == "panda":
        fl = (np.eye(3), np.array([0, 0, .107]))
    else:
        f = m.frames[m.getFrameId("tool0")].placement
        fl = (f.rotation.copy(), f.translation.copy())
    return out, fl


class Arm:
    def __init__(self, name, h_sensor, rz, tip, mass_last=None):
        self.name = name
        L, fl = raw(name)
        self.J = len(L)
        self.L = L
        self.RP = np.array([x[0] for x in L]); self.pP = np.array([x[1] for x in L]); self.AX = np.array([x[2] for x in L])
        self.M = np.array([x[3] for x in L], float); self.COM = np.array([x[4] for x in L]); self.I = np.array([x[5] for x in L])
        self.lo = np.array([x[6] for x in L]); self.hi = np.array([x[7] for x in L])
        Rz = pin.rpy.rpyToMatrix(0, 0, rz)
        self.fl = fl; self.h = h_sensor; self.rz = rz; self.tip = np.array(tip)
        self.Rs = fl[0] @ Rz; self.ps = fl[1] + fl[0] @ np.array([0, 0, h_sensor])

    def urdf(self):
        v = lambda a: " ".join("%.10g" % x for x in a)
        o = ['<?xml version="1.0"?>', f'<robot name="{self.name}">', '<link name="base_link"/>']
        par = "base_link"
        for i, (R, p, ax, m, com, I, lo, hi) in enumerate(self.L):
            o.append(f'<link name="link_{i+1}"><inertial><origin xyz="{v(com)}" rpy="0 0 0"/><mass value="{m:.10g}"/>'
                     f'<inertia ixx="{I[0,0]:.10g}" ixy="{I[0,1]:.10g}" ixz="{I[0,2]:.10g}" iyy="{I[1,1]:.10g}" iyz="{I[1,2]:.10g}" izz="{I[2,2]:.10g}"/></inertial></link>')
            o.append(f'<joint name="joint_{i+1}" type="revolute"><parent link="{par}"/><child link="link_{i+1}"/><origin xyz="{v(p)}" rpy="{v(pin.rpy.matrixToRpy(R))}"/>'
                     f'<axis xyz="{v(ax)}"/><limit lower="{lo:.6g}" upper="{hi:.6g}" effort="300" velocity="3"/></joint>')
            par = f"link_{i+1}"
        for nm, pa, xyz, rpy in [("flange", par, self.fl[1], pin.rpy.matrixToRpy(self.fl[0])), ("ft_sensor", "flange", [0, 0, self.h], [0, 0, self.rz]),
                                 ("tool_tip", "ft_sensor", self.tip, [0, 0, 0])]:
            o.append(f'<link name="{nm}"/><joint name="to_{nm}" type="fixed"><parent link="{pa}"/><child link="{nm}"/><origin xyz="{v(xyz)}" rpy="{v(rpy)}"/></joint>')
        return "\n".join(o + ["</robot>"])

    def load(self):
        self.model = pin.buildModelFromXML(self.urdf())
        self.data = self.model.createData()
        self.fid = self.model.getFrameId("tool_tip")

    def ik(self, q0, pos, R, iters=60, tol=1e-7):
        q = q0.copy()
        for _ in range(iters):
            pin.computeJointJacobians(self.model, self.data, q)
            X = pin.updateFramePlacement(self.model, self.data, self.fid)
            e = np.r_[pos - X.translation, pin.log3(R @ X.rotation.T)]
            if np.abs(e).max() < tol: return q, True
            Jm = pin.getFrameJacobian(self.model, self.data, self.fid, pin.ReferenceFrame.LOCAL_WORLD_ALIGNED)
            dq = Jm.T @ np.linalg.solve(Jm @ Jm.T + 1e-7 * np.eye(6), e)
            q = q + np.clip(dq, -.3, .3)
        return q, np.abs(e).max() < 1e-5


HOME = {"lwr": np.array([.1, -.6, .05, 1.5, 0.05, -1.04, .2]), "panda": np.array([.05, -.5, .05, -2.3, .05, 1.8, .8]),
        "ur5": np.array([.1, -1.7, 1.9, -1.75, -1.57, .2])}
