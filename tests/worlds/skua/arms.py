"""Arms of petrel/b: LWR4+ and `skua6` (UR5's published DH sizes and masses). Vectorised kinematics, URDF text, inverse kinematics."""
import json
import os
import numpy as np
from math import pi

def rotv(v):
    """exp of rotation vectors (...,3)"""
    v = np.asarray(v, float); a = np.linalg.norm(v, axis=-1)[..., None, None]
    K = np.zeros(v.shape[:-1]+(3, 3)); K[..., 0, 1] = -v[..., 2]; K[..., 0, 2] = v[..., 1]; K[..., 1, 2] = -v[..., 0]; K = K-np.swapaxes(K, -1, -2)
    return np.eye(3)+np.sinc(a/pi)*K+.5*np.sinc(a/2/pi)**2*(K @ K)

def arm(name, joints, links, flange, tip, seed):
    """joints: (xyz, roll, axis); flange (xyz, roll)"""
    return dict(name=name, joints=joints, links=links, flange=flange, sensor=.0125, tip=tip, seed=np.array(seed), n=len(joints))

_l = json.load(open(os.path.join(os.path.dirname(os.path.abspath(__file__)), os.pardir, "foundry", "lwr4plus_inertia.json")))
LWR = arm("lwr4plus_b", [((0, 0, z), 0., a) for z, a in zip((.11, .2005, .2, .2, .2, .19, .078-.078), ((0, 0, 1), (0, -1, 0), (0, 0, 1), (0, 1, 0), (0, 0, 1), (0, -1, 0), (0, 0, 1)))],
          [(a["m"], a["com"], a["I"]) for a in _l], ((0, 0, .078), 0.), .115, np.radians([10, 32, -6, -82, 8, 66, 20]))
# link 7 of the json has its frame at the flange (CENTRO: origin .078 above the wrist); keep that: joint 7 carries the .078
LWR["joints"][6] = ((0, 0, .078), 0., (0, 0, 1)); LWR["flange"] = ((0, 0, 0), 0.)
_d = [.089159, 0, 0, .10915, .09465, .0823]; _a = [0, -.425, -.39225, 0, 0, 0]; _al = [pi/2, 0, 0, pi/2, -pi/2, 0]
_c = [(0, -.02561, .00193), (.2125, 0, .11336), (.15, 0, .0265), (0, -.0018, .01634), (0, .0018, .01634), (0, 0, -.001159)]; _m = [3.7, 8.393, 2.275, 1.219, 1.219, .1879]
_I = [(.0103, .0103, .0067), (.0151, .226, .226), (.0041, .0494, .0494), (.0026, .0026, .0022), (.0026, .0026, .0022), (.0001, .0001, .00013)]
def _rx(a): return np.array([[1, 0, 0], [0, np.cos(a), -np.sin(a)], [0, np.sin(a), np.cos(a)]])
UR = arm("skua6", [((0, 0, 0), 0., (0, 0, 1))]+[((_a[i], 0, _d[i]), _al[i], (0, 0, 1)) for i in range(5)],
         [(m, tuple(np.array([a, 0, d])+_rx(al) @ np.array(c)), (*I, 0, 0, 0)) for m, c, I, a, d, al in zip(_m, _c, _I, _a, _d, _al)], ((0, 0, _d[5]), 0.), .13, np.radians([12, -95, 105, -100, -88, 15]))

def fk(rb, q, jac=False):
    q = np.atleast_2d(q); N = len(q); R = np.broadcast_to(np.eye(3), (N, 3, 3)); x = np.zeros((N, 3)); P, Z = [], []
    for (o, roll, a), qi in zip(rb["joints"], q.T):
        x = x+R @ np.array(o, float)
        if roll: R = R @ _rx(roll)
        a = np.array(a, float); Z.append(R @ a); P.append(x)
        R = R @ rotv(qi[:, None]*a)
    x = x+R @ (np.array(rb["flange"][0], float)+[0, 0, rb["sensor"]+rb["tip"]])
    if not jac: return R, x
    return R, x, np.stack([np.concatenate([np.cross(z, x-p), z], -1) for z, p in zip(Z, P)], -1)

def ik(rb, Rd, xd, it=9):
    q = np.tile(rb["seed"], (len(xd), 1))
    for i in range(it):
        R, x, J = fk(rb, q, True); E = Rd @ np.swapaxes(R, 1, 2)
        w = .5*np.stack([E[:, 2, 1]-E[:, 1, 2], E[:, 0, 2]-E[:, 2, 0], E[:, 1, 0]-E[:, 0, 1]], -1); e = np.concatenate([xd-x, w], -1)
        if np.abs(e).max() < 1e-9: break
        JJ = J @ np.swapaxes(J, 1, 2)+1e-10*np.eye(6); q = q+(np.swapaxes(J, 1, 2) @ np.linalg.solve(JJ, e[..., None]))[..., 0]
    assert np.abs(e).max() < 1e-7, "ik %g" % np.abs(e).max()
    return q

def urdf(rb):
    f = lambda v: " ".join("%.10g" % a for a in v); s = ['<?xml version="1.0"?>', f'<robot name="{rb["name"]}">', '  <link name="base_link"/>']; par = "base_link"
    for i, ((o, roll, a), (m, c, I)) in enumerate(zip(rb["joints"], rb["links"]), 1):
        s.append(f'  <link name="link_{i}"><inertial><origin xyz="{f(c)}" rpy="0 0 0"/><mass value="{m}"/><inertia ixx="{I[0]}" iyy="{I[1]}" izz="{I[2]}" ixy="{I[3]}" ixz="{I[4]}" iyz="{I[5]}"/></inertial></link>')
        s.append(f'  <joint name="joint_{i}" type="revolute"><parent link="{par}"/><child link="link_{i}"/><origin xyz="{f(o)}" rpy="{roll:.12g} 0 0"/><axis xyz="{f(a)}"/><limit lower="-6.2832" upper="6.2832" effort="300" velocity="4"/></joint>'); par = f"link_{i}"
    for nm, pr, z in (("flange", par, rb["flange"][0][2]), ("ft_sensor", "flange", rb["sensor"]), ("tool_tip", "ft_sensor", rb["tip"])):
        s.append(f'  <link name="{nm}"/><joint name="fix_{nm}" type="fixed"><parent link="{pr}"/><child link="{nm}"/><origin xyz="0 0 {z:.10g}" rpy="0 0 0"/></joint>')
    return "\n".join(s)+"\n</robot>\n"

if __name__ == "__main__":
    import pinocchio as pin
    for rb in (LWR, UR):
        m = pin.buildModelFromXML(urdf(rb)); d = m.createData(); q = np.random.default_rng(0).uniform(-1, 1, (3, rb["n"])); R, x = fk(rb, q)
        for i in range(3):
            pin.framesForwardKinematics(m, d, q[i]); T = d.oMf[m.getFrameId("tool_tip")]; print(rb["name"], np.abs(T.translation-x[i]).max(), np.abs(T.rotation-R[i]).max())
        R, x = fk(rb, rb["seed"]); print("seed tip", x[0].round(3), "tool z", R[0, :, 2].round(3), "g", pin.computeGeneralizedGravity(m, d, np.array([0., .5, 0, -1, 0, 1, 0])[:rb["n"]]).round(2))
