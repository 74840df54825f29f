"""Arms: Pinocchio for kinematics of references, MuJoCo for arm and controller in closed loop."""
import json, os
import numpy as np, pinocchio as pin, mujoco
from scipy.interpolate import CubicSpline
from scipy.spatial.transform import Rotation as Ro
from material import mat_step, NS

HERE = os.path.dirname(os.path.abspath(__file__))
SEEDS = {"lwr": [0, .6, 0, -1.4, 0, 1.14, 0], "ur5": [0, -1.25, 1.9, -2.22, -1.57, .3], "ur10": [0, -1.25, 1.9, -2.22, -1.57, .3], "ur3": [0, -1.25, 1.9, -2.22, -1.57, .3],
         "panda": [0, -.3, 0, -2.2, 0, 1.9, .78], "xarm7": [0, -.3, 0, 1.0, 0, 1.3, 0]}
FRAMES = {"ur5": ("wrist_3_link", "tool0"), "ur10": ("wrist_3_link", "tool0"), "ur3": ("wrist_3_link", "tool0"), "panda": ("panda_link8", "panda_hand_tcp"), "lwr": ("ft_sensor", "tool_tip"),
          "xarm7": ("link7", "link_eef")}


def lwr_urdf(h_sensor, turn, h_tip, tip_xy, tip_tilt):
    L = json.load(open(os.path.join(HERE, "lwr4plus_inertia.json")))
    z = [.11, .2005, .2, .2, .2, .19, .078]
    ax = ["0 0 1", "0 -1 0", "0 0 1", "0 1 0", "0 0 1", "0 -1 0", "0 0 1"]
    s = ['<robot name="sander_lwr">', '<link name="base_link"/>']
    for i, l in enumerate(L):
        c, J = l["com"], l["I"]
        s.append(f'<link name="link_{i+1}"><inertial><origin xyz="{c[0]} {c[1]} {c[2]}"/><mass value="{l["m"]}"/>'
                 f'<inertia ixx="{J[0]}" iyy="{J[1]}" izz="{J[2]}" ixy="{J[3]}" ixz="{J[4]}" iyz="{J[5]}"/></inertial></link>')
        lim = 2.96 if i % 2 == 0 else 2.09
        s.append(f'<joint name="joint_{i+1}" type="revolute"><parent link="{"base_link" if i == 0 else f"link_{i}"}"/><child link="link_{i+1}"/>'
                 f'<origin xyz="0 0 {z[i]}" rpy="0 0 0"/><axis xyz="{ax[i]}"/><limit lower="-{lim}" upper="{lim}" effort="200" velocity="3"/></joint>')
    for n, p, x, r in (("flange", "link_7", (0, 0, .078), (0, 0, 0)), ("ft_sensor", "flange", (0, 0, h_sensor), (0, 0, turn)),
                       ("tool_tip", "ft_sensor", (tip_xy[0], tip_xy[1], h_tip), (tip_tilt, 0, 0))):
        s.append(f'<link name="{n}"/><joint name="to_{n}" type="fixed"><parent link="{p}"/><child link="{n}"/>'
                 f'<origin xyz="{x[0]:.6f} {x[1]:.6f} {x[2]:.6f}" rpy="{r[0]:.6f} {r[1]:.6f} {r[2]:.6f}"/></joint>')
    return "\n".join(s + ["</robot>"])


def load(name, urdf=None):
    if name == "lwr":
        m = pin.buildModelFromXML(urdf)
    else:
        import example_robot_data as erd
        m = erd.load(name).model
    if name == "panda":
        m = pin.buildReducedModel(m, [m.getJointId("panda_finger_joint1"), m.getJointId("panda_finger_joint2")], pin.neutral(m))
    return m


_cache = {}


def get(name, urdf=None):
    key = name if name != "lwr" else urdf
    if key not in _cache:
        _cache[key] = load(name, urdf)
    return _cache[key].copy()


def to_mujoco(m, gravity, extra, tip_id, off, dt):
    """MJCF from the Pinocchio model's placements and inertias; extra = inertia added to the last body"""
    x = [f'<mujoco><option timestep="{dt}" gravity="{gravity[0]} {gravity[1]} {gravity[2]}" integrator="Euler"><flag contact="disable"/></option><compiler inertiafromgeom="false" balanceinertia="false" autolimits="false" boundmass="1e-6" boundinertia="1e-8"/><worldbody>']
    n = m.njoints
    for j in range(1, n):
        M = m.jointPlacements[j]
        q = pin.Quaternion(M.rotation)
        Y = m.inertias[j] + extra if j == n - 1 and extra is not None else m.inertias[j]
        J = Y.inertia + 1e-6 * np.eye(3)
        ax = pin.computeJointJacobian(m, m.createData(), pin.neutral(m), j)[3:, j - 1]
        x.append(f'<body name="b{j}" pos="{M.translation[0]:.12g} {M.translation[1]:.12g} {M.translation[2]:.12g}" quat="{q.w:.15g} {q.x:.15g} {q.y:.15g} {q.z:.15g}">'
                 f'<inertial pos="{Y.lever[0]:.12g} {Y.lever[1]:.12g} {Y.lever[2]:.12g}" mass="{max(Y.mass,1e-4):.12g}" fullinertia="{J[0,0]:.12g} {J[1,1]:.12g} {J[2,2]:.12g} {J[0,1]:.12g} {J[0,2]:.12g} {J[1,2]:.12g}"/>'
                 f'<joint name="j{j}" type="hinge" axis="{ax[0]:.12g} {ax[1]:.12g} {ax[2]:.12g}" armature="0.02"/>')
        if j == n - 1:
            F = m.frames[tip_id].placement
            p = F.translation + F.rotation @ off
            x.append(f'<site name="tip" pos="{p[0]:.12g} {p[1]:.12g} {p[2]:.12g}"/>')
    x.append('</body>' * (n - 1) + '</worldbody></mujoco>')
    return mujoco.MjModel.from_xml_string("".join(x))


def ik(m, tip, q0, pos, rot, t):
    """references by damped least squares along the path (sampled), spline through it"""
    d = m.createData()
    q = q0.copy()
    Q = np.zeros((len(t), m.nq))
    for i in range(len(t)):
        for _ in range(8 if i == 0 else 2):
            pin.computeJointJacobians(m, d, q)
            pin.updateFramePlacement(m, d, tip)
            J = pin.getFrameJacobian(m, d, tip, pin.LOCAL_WORLD_ALIGNED)
            M = d.oMf[tip]
            e = np.r_[pos[i] - M.translation, pin.log3(rot[i] @ M.rotation.T)]
            dq = J.T @ np.linalg.solve(J @ J.T + 1e-8 * np.eye(6), e)
            q = q + np.clip(dq, -.2, .2)
        Q[i] = q
    pin.framesForwardKinematics(m, d, Q[-1])
    return Q


def simulate(m, gravity, extra, tip, off, tref, Qref, dt, ctrl, contact=None, joint=None, rng=None):
    """closed loop. contact: dict(point, E (rows t1,t2,n), P, gaps, ks(s1,s2,t), z(t), ext(t)->3 forces); joint: friction function of (q, dq, state, tau) -> torque"""
    mj = to_mujoco(m, gravity, extra, tip, off, dt)
    d = mujoco.MjData(mj)
    n = m.nv
    sp = CubicSpline(tref, Qref)
    T = np.arange(0, tref[-1], dt)
    qr, vr, ar = sp(T), sp(T, 1), sp(T, 2)
    if joint is not None and "arm" in joint:
        mj.dof_armature[:] = joint["arm"]
    else:
        mj.dof_armature[:] = 0.02
    d.qpos[:] = qr[0]; d.qvel[:] = vr[0]
    kp, kd = ctrl["w"] ** 2, 2 * ctrl["zeta"] * ctrl["w"]
    K = len(T)
    rec = {k: np.zeros((K, n)) for k in ("q", "dq", "ddq", "tau")}
    F = np.zeros((K, 3)); tipp = np.zeros((K, 3))
    S = np.zeros(NS); jp = np.zeros((3, n)); tmp = np.zeros(n)
    M0 = None
    if contact is not None:
        E, P, gaps, pt = contact["E"], contact["P"], contact["gaps"], contact["point"]
        fz, ks, ext = contact.get("z"), contact.get("ks"), contact.get("ext")
    for i in range(K):
        mujoco.mj_step1(mj, d)
        e = kp * (qr[i] - d.qpos) + kd * (vr[i] - d.qvel)
        if ctrl["kind"] == "ct":
            mujoco.mj_mulM(mj, d, tmp, e + ar[i])
            tau = tmp + d.qfrc_bias
        else:
            if M0 is None:
                full = np.zeros((n, n)); mujoco.mj_fullM(mj, d, full); M0 = np.diag(full).copy()
            tau = M0 * e + d.qfrc_bias
        fr = 0.0
        if joint is not None and joint.get("f") is not None:
            fr = joint["f"](d.qpos, d.qvel, tau, dt)
            tau = tau + ctrl.get("comp", .9) * fr
        q_app = tau - fr
        if contact is not None:
            mujoco.mj_jacSite(mj, d, jp, None, 0)
            x = E @ (d.site_xpos[0] - pt)
            v = E @ (jp @ d.qvel)
            dep, dd = -x[2], -v[2]
            if fz is not None:
                dep += fz[i]; dd += (fz[i] - fz[i - 1]) / dt if i else 0
            k_ = 1.0 if ks is None else ks(x[0], x[1], T[i])
            N, T1, T2 = mat_step(P, gaps, S, dt, T[i], dep, dd, v[0], v[1], k_)
            fc = np.array([T1, T2, N])
            if ext is not None and dep > 0:
                fc = fc + ext[i]
            w = fc @ E
            F[i] = w
            q_app = q_app + jp.T @ w
            tipp[i] = d.site_xpos[0]
        d.qfrc_applied[:] = q_app
        rec["q"][i] = d.qpos; rec["dq"][i] = d.qvel
        mujoco.mj_step2(mj, d)
        rec["ddq"][i] = d.qacc; rec["tau"][i] = tau
    rec.update(t=T, F=F, tip=tipp)
    return rec
