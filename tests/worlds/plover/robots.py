"""Arms as plain chains (all frames parallel at zero), their URDF, vectorised kinematics and inverse kinematics."""
import json
import numpy as np

Z, Y, Yn = (0, 0, 1), (0, 1, 0), (0, -1, 0)
_lw = json.load(open(__import__("os").path.join(__import__("os").path.dirname(__import__("os").path.abspath(__file__)), "lwr4plus_inertia.json")))
ARMS = {
    "lwr4plus": dict(joints=[((0, 0, .11), Z), ((0, 0, .2005), Yn), ((0, 0, .2), Z), ((0, 0, .2), Y), ((0, 0, .2), Z), ((0, 0, .19), Yn), ((0, 0, .078), Z)],
                     links=[(l["m"], l["com"], l["I"]) for l in _lw], flange=(0, 0, 0), down=[0, .5, 0, -1.5, 0, 1.1416, 0]),
    "heron6": dict(joints=[((0, 0, .15), Z), ((.03, 0, .12), Y), ((0, 0, .42), Y), ((.02, 0, .11), Z), ((0, 0, .27), Y), ((0, 0, .09), Z)],
                   links=[(6.2, (.01, 0, .07), (.03, .03, .02, 0, 0, 0)), (8.1, (0, .03, .2), (.14, .14, .02, 0, 0, .002)), (4.4, (.01, -.01, .06), (.02, .02, .012, 0, .001, 0)),
                          (2.9, (0, .005, .15), (.024, .024, .004, 0, 0, 0)), (1.3, (0, .004, .04), (.002, .002, .0012, 0, 0, 0)), (.4, (0, 0, .01), (.0003, .0003, .0004, 0, 0, 0))],
                   flange=(0, 0, .035), down=[.1, .35, 1.35, 0, 1.4416, 0]),
    "stilt6": dict(joints=[((0, 0, .2), Z), ((0, .06, .05), Yn), ((0, 0, .34), Yn), ((0, -.04, .33), Yn), ((0, .05, .06), Z), ((0, 0, .07), Yn), ((0, 0, .05), Z)],
                   links=[(4., (0, .02, .02), (.015, .015, .012, 0, 0, 0)), (5.5, (0, .02, .17), (.07, .07, .01, 0, 0, 0)), (3.1, (0, -.01, .15), (.035, .035, .004, 0, 0, 0)),
                          (1.2, (0, .02, .02), (.002, .002, .0015, 0, 0, 0)), (1.0, (0, 0, .03), (.0015, .0015, .001, 0, 0, 0)), (.8, (0, 0, .02), (.001, .001, .0008, 0, 0, 0)), (.3, (0, 0, .015), (.0002, .0002, .0003, 0, 0, 0))],
                   flange=(0, 0, .02), down=[0, .3, 1.2, .5, .2, 1.1, 0]),
}


def urdf(arm, name, sens=(0, 0, .03), yaw=0.0, tip=(0, 0, .12)):
    A = ARMS[arm]; o = [f'<?xml version="1.0"?>\n<robot name="{name}">\n<link name="base_link"/>']
    for i, (m, c, I) in enumerate(A["links"], 1):
        o.append(f'<link name="link_{i}"><inertial><origin xyz="{c[0]} {c[1]} {c[2]}" rpy="0 0 0"/><mass value="{m}"/><inertia ixx="{I[0]}" iyy="{I[1]}" '
                 f'izz="{I[2]}" ixy="{I[3]}" ixz="{I[4]}" iyz="{I[5]}"/></inertial></link>')
    for i, (p, a) in enumerate(A["joints"], 1):
        par = "base_link" if i == 1 else f"link_{i-1}"
        o.append(f'<joint name="joint_{i}" type="revolute"><parent link="{par}"/><child link="link_{i}"/><origin xyz="{p[0]} {p[1]} {p[2]}" rpy="0 0 0"/>'
                 f'<axis xyz="{a[0]} {a[1]} {a[2]}"/><limit lower="-6.3" upper="6.3" effort="500" velocity="10"/></joint>')
    f = A["flange"]
    for nm, par, p, y in (("flange", f"link_{len(A['links'])}", f, 0), ("ft_sensor", "flange", sens, yaw), ("tool_tip", "ft_sensor", tip, 0)):
        o.append(f'<link name="{nm}"/>\n<joint name="{nm}_fixed" type="fixed"><parent link="{par}"/><child link="{nm}"/>'
                 f'<origin xyz="{p[0]} {p[1]} {p[2]}" rpy="0 0 {y!r}"/></joint>')
    return "\n".join(o) + "\n</robot>\n"


def rotz(y):
    c, s = np.cos(y), np.sin(y); return np.array([[c, -s, 0], [s, c, 0], [0, 0, 1.]])


def exps(w):
    """rotation vectors (N,3) -> matrices"""
    t = np.linalg.norm(w, axis=1); k = w / np.maximum(t, 1e-12)[:, None]
    K = np.zeros((len(w), 3, 3)); K[:, 0, 1] = -k[:, 2]; K[:, 0, 2] = k[:, 1]; K[:, 1, 0] = k[:, 2]; K[:, 1, 2] = -k[:, 0]; K[:, 2, 0] = -k[:, 1]; K[:, 2, 1] = k[:, 0]
    return np.eye(3) + np.sin(t)[:, None, None] * K + (1 - np.cos(t))[:, None, None] * (K @ K)


class Arm:
    def __init__(s, arm, sens=(0, 0, .03), yaw=0.0, tip=(0, 0, .12)):
        s.J = ARMS[arm]["joints"]; s.n = len(s.J); s.fl = np.array(ARMS[arm]["flange"]) + np.array(sens); s.Ry = rotz(yaw); s.tip = np.array(tip)

    def fk(s, q, jac=False):
        """sensor rotation, tip position (N,…)"""
        N = len(q); R = np.repeat(np.eye(3)[None], N, 0); p = np.zeros((N, 3)); ax, ps = [], []
        for i, (x, a) in enumerate(s.J):
            p = p + R @ np.array(x, float); a = np.array(a, float)
            if jac: ax.append(R @ a); ps.append(p)
            c, sn = np.cos(q[:, i]), np.sin(q[:, i]); B = np.empty_like(R)
            u = int(np.argmax(np.abs(a))); sn = sn * a[u]
            j, k = (u + 1) % 3, (u + 2) % 3
            B[:, :, u] = R[:, :, u]
            B[:, :, j] = c[:, None] * R[:, :, j] + sn[:, None] * R[:, :, k]
            B[:, :, k] = c[:, None] * R[:, :, k] - sn[:, None] * R[:, :, j]
            R = B
        p = p + R @ s.fl; R = R @ s.Ry; p = p + R @ s.tip
        if not jac: return R, p
        J = np.empty((N, 6, s.n))
        for i in range(s.n):
            J[:, :3, i] = np.cross(ax[i], p - ps[i]); J[:, 3:, i] = ax[i]
        return R, p, J

    def ik(s, q0, Rt, pt, stages=2, it=7):
        N = len(pt); q = np.repeat(np.asarray(q0, float)[None], N, 0)
        R0, p0 = s.fk(q[:1]); R0, p0 = R0[0], p0[0]
        D = R0.T @ Rt; tr = np.clip((np.trace(D, axis1=1, axis2=2) - 1) / 2, -1, 1); an = np.arccos(tr)
        v = np.stack([D[:, 2, 1] - D[:, 1, 2], D[:, 0, 2] - D[:, 2, 0], D[:, 1, 0] - D[:, 0, 1]], 1) / 2
        w = v * np.where(an > 1e-6, an / np.maximum(np.sin(an), 1e-9), 1.0)[:, None]
        for st in range(1, stages + 1):
            l = st / stages; Ra = R0 @ exps(w * l) if st < stages else Rt; pa = p0 + (pt - p0) * l
            for k in range(it if st == stages else 2):
                R, p, J = s.fk(q, True); E = Ra @ np.swapaxes(R, 1, 2)
                e = np.concatenate([pa - p, np.stack([E[:, 2, 1] - E[:, 1, 2], E[:, 0, 2] - E[:, 2, 0], E[:, 1, 0] - E[:, 0, 1]], 1) / 2], 1)
                if st == stages and np.abs(e).max() < 1e-10: break
                JT = np.swapaxes(J, 1, 2)
                q = q + (JT @ np.linalg.solve(J @ JT + 1e-10 * np.eye(6), e[:, :, None]))[:, :, 0]
        return q, np.abs(e).max()
