"""The arm in closed loop: PyBullet's articulated-body dynamics under torque control, contact force applied as an external force each substep."""
import os, tempfile
import numpy as np
import pybullet as pb
from numba import njit
from scipy.interpolate import CubicSpline
from chain import Chain, forward, jacobian, rnea, mass_matrix, matmul3, rv
from laws import contact, NS, IX

C_IX = IX["C"]

_client = None


def client():
    global _client
    if _client is None:
        _client = pb.connect(pb.DIRECT)
    return _client


def urdf_for_bullet(ch: Chain, rotor):
    """The chain as a bare URDF: links with inertia only; reflected rotor inertia is added to the link's own as a sphere of flywheels."""
    out = ['<robot name="arm"><link name="base"/>']
    for i in range(ch.n):
        m, c, I = ch.m[i], ch.c[i], ch.I[i] + rotor[i] * np.eye(3)
        R, p = ch.Rj[i], ch.pj[i]
        sy = np.hypot(R[0, 0], R[1, 0])
        rp = (np.arctan2(R[2, 1], R[2, 2]), np.arctan2(-R[2, 0], sy), np.arctan2(R[1, 0], R[0, 0]))
        f = lambda v: " ".join(f"{x:.15g}" for x in v)
        out.append(f'<link name="l{i}"><inertial><origin xyz="{f(c)}"/><mass value="{m:.15g}"/><inertia ixx="{I[0,0]:.15g}" iyy="{I[1,1]:.15g}" '
                   f'izz="{I[2,2]:.15g}" ixy="{I[0,1]:.15g}" ixz="{I[0,2]:.15g}" iyz="{I[1,2]:.15g}"/></inertial></link>'
                   f'<joint name="j{i}" type="continuous"><parent link="{"base" if i == 0 else f"l{i-1}"}"/><child link="l{i}"/>'
                   f'<origin xyz="{f(p)}" rpy="{f(rp)}"/><axis xyz="{f(ch.ax[i])}"/></joint>')
    out.append("</robot>")
    return "".join(out)


@njit(cache=True)
def rot_error(R, Rd):
    """Rotation vector from R to Rd, world axes (small angles: the sine form suffices for tracking)."""
    e = np.zeros(3)
    for k in range(3):
        e[0] += 0.5 * (R[1, k] * Rd[2, k] - R[2, k] * Rd[1, k])
        e[1] += 0.5 * (R[2, k] * Rd[0, k] - R[0, k] * Rd[2, k])
        e[2] += 0.5 * (R[0, k] * Rd[1, k] - R[1, k] * Rd[0, k])
    return e


@njit(cache=True)
def mm(A, B):
    C = np.zeros((3, 3))
    matmul3(A, B, C)
    return C


@njit(cache=True)
def mv(A, x):
    y = rv(A, x)
    return np.array([y[0], y[1], y[2]])


@njit(cache=True)
def ik_track(Rj, pj, ax, Rs, tip, q0, X, RX, mid, iters0):
    """Joints along a tip path by damped Newton steps, the null space drawn towards mid-range."""
    N, n = len(X), len(q0)
    Q = np.zeros((N, n)); err = np.zeros(N)
    q = q0.copy()
    for k in range(N):
        for it in range(iters0 if k == 0 else 4):
            R, p, z = forward(Rj, pj, ax, q)
            x = p[n - 1] + mv(R[n - 1], tip)
            Rw = mm(R[n - 1], Rs)
            e = np.zeros(6)
            e[:3] = X[k] - x
            e[3:] = rot_error(Rw, RX[k])
            s = np.sqrt(np.sum(e * e))
            if s < 1e-10:
                break
            if s > 0.3:
                e *= 0.3 / s
            J = jacobian(p, z, x)
            A = J @ J.T + 1e-8 * np.eye(6) * (1.0 if s < 0.05 else 1e4)
            dq = J.T @ np.linalg.solve(A, e)
            z0 = (mid - q) * (0.1 if k == 0 else 0.0)
            q = q + dq + z0 - J.T @ np.linalg.solve(A, J @ z0)
        err[k] = s
        Q[k] = q
    return Q, err


def solve_path(ch, X, RX, rng, tries=60):
    """Joint path with the best margin to limits and singularities, or None."""
    best, score = None, 0.02
    tip = ch.ps + ch.Rs @ ch.rt
    mid = np.zeros(ch.n)
    coarse = slice(None, None, max(1, len(X) // 400))
    for _ in range(tries):
        q0 = rng.uniform(-.35, .35, ch.n)      # an arm that reaches out, its elbow either way
        q0[0] += np.arctan2(X[0, 1], X[0, 0]) + rng.choice([0, np.pi])
        q0[[1, 3, 5]] += rng.choice([-1, 1]) * np.array([.7, 1.5, .9]) * rng.choice([-1, 1], 3)
        q0[6] = rng.uniform(-2, 2)
        Q, err = ik_track(*ch.args(), ch.Rs, tip, q0, X[:1], RX[:1], mid, 80)
        if err[0] > 1e-6 or (Q[0] < ch.lo + .1).any() or (Q[0] > ch.hi - .1).any():
            continue
        q0 = Q[0]
        Q, err = ik_track(*ch.args(), ch.Rs, tip, q0, X[coarse], RX[coarse], mid, 80)
        if err.max() > 1e-5:
            continue
        margin = min(((Q - ch.lo) / (ch.hi - ch.lo)).min(), ((ch.hi - Q) / (ch.hi - ch.lo)).min())
        sig = 9.0
        for q in Q[::10]:
            R, p, z = forward(*ch.args(), q)
            sig = min(sig, np.linalg.svd(jacobian(p, z, p[-1] + R[-1] @ tip), compute_uv=False)[-1])
        s = min(margin, sig)
        if s > score:
            best, score = Q[0], s
            if s > 0.07:
                break
    if best is None:
        return None
    Q, err = ik_track(*ch.args(), ch.Rs, tip, best, X, RX, mid, 80)
    inside = ((Q > ch.lo + 0.02) & (Q < ch.hi - 0.02)).all()
    return Q if err.max() < 1e-5 and inside else None


@njit(cache=True)
def tick(Rj, pj, ax, m, c, I, rotor, Rs, tip, g, q, dq, qd, dqd, ddqd, mode, kp, kd, lead, jf, jz, jl, shake, frame, P, S, dt, t, Fprev, M, push):
    """One substep: contact force at the true tip, torque of controller minus joint friction. frame = rows: point, n, t1, t2."""
    n = len(q)
    R, p, z = forward(Rj, pj, ax, q)
    x = p[n - 1] + mv(R[n - 1], tip)
    J = jacobian(p, z, x)
    v = np.zeros(3)
    for i in range(n):
        for k in range(3):
            v[k] += J[k, i] * dq[i]
    r = x - frame[0]
    d = -(r[0] * frame[1, 0] + r[1] * frame[1, 1] + r[2] * frame[1, 2])
    dd = -(v[0] * frame[1, 0] + v[1] * frame[1, 1] + v[2] * frame[1, 2])
    s1 = r[0] * frame[2, 0] + r[1] * frame[2, 1] + r[2] * frame[2, 2]
    s2 = r[0] * frame[3, 0] + r[1] * frame[3, 1] + r[2] * frame[3, 2]
    v1 = v[0] * frame[2, 0] + v[1] * frame[2, 1] + v[2] * frame[2, 2]
    v2 = v[0] * frame[3, 0] + v[1] * frame[3, 1] + v[2] * frame[3, 2]
    N, T1, T2 = contact(P, S, dt, t, d - P[C_IX] * Fprev, dd, s1, s2, v1, v2)
    F = N * frame[1] + T1 * frame[2] + T2 * frame[3]
    h = rnea(Rj, pj, ax, m, c, I, q, dq, np.zeros(n), g)
    e = qd - q
    de = dqd - dq
    if mode == 0:        # joint impedance
        tau = h + kp * e + kd * de
        tau += M @ ddqd + rotor * ddqd
    elif mode == 1:      # Cartesian impedance with a joint-space remainder in the null space
        Rd, pd, zd = forward(Rj, pj, ax, qd)
        xd = pd[n - 1] + mv(Rd[n - 1], tip)
        Jd = jacobian(pd, zd, xd)
        w = np.zeros(6)
        vd = Jd @ dqd
        va = J @ dq
        er = rot_error(mm(R[n - 1], Rs), mm(Rd[n - 1], Rs))
        for k in range(3):
            w[k] = kp[0] * (xd[k] - x[k]) + kd[0] * (vd[k] - va[k])
            w[3 + k] = kp[1] * er[k] + kd[1] * (vd[3 + k] - va[3 + k])
        A = J @ J.T + 1e-6 * np.eye(6)
        u = kp[2] * e + kd[2] * de
        u = u - J.T @ np.linalg.solve(A, J @ u)
        tau = h + J.T @ w + u + M @ ddqd + rotor * ddqd
    else:                # computed torque
        y = ddqd + kp[0] * e + kd[0] * de
        tau = h + M @ y + rotor * y
    for i in range(n):   # the force expected at the commanded depth is fed forward
        for k in range(3):
            tau[i] -= J[k, i] * push * frame[1, k]
    for i in range(n):   # what friction the controller doesn't know: Dahl, plus tremor of the drives
        s = 1.0 if dq[i] > 0 else -1.0
        jz[i] = s + (jz[i] - s) * np.exp(-abs(dq[i]) * dt / jl)
        tau[i] += shake[i] - jf[i] * jz[i] - 0.3 * jf[i] * dq[i]
    return tau, F, x, d, N


def simulate(ch, tool, rotor, g, qpath, tpath, frame, P, ctrl, tip, dt, rng_seed, push):
    """tool = (mass, com, inertia) in the sensor frame; tip = true contact point in the sensor frame. Returns arrays at dt."""
    rng = np.random.default_rng(rng_seed)
    arm = ch.with_tool(*tool)
    cid = client()
    pb.resetSimulation(physicsClientId=cid)
    fd, fn = tempfile.mkstemp(suffix=".urdf")
    with os.fdopen(fd, "w") as f:
        f.write(urdf_for_bullet(arm, rotor).replace('<link name="base"/>', '<link name="base"><inertial><mass value="0"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>'))
    flags = pb.URDF_USE_INERTIA_FROM_FILE
    body = pb.loadURDF(fn, useFixedBase=True, flags=flags, physicsClientId=cid)
    os.unlink(fn)
    n = ch.n
    J = list(range(n))
    for i in range(-1, n):
        pb.changeDynamics(body, i, linearDamping=0, angularDamping=0, jointDamping=0, maxJointVelocity=50, physicsClientId=cid)
    pb.setJointMotorControlArray(body, J, pb.VELOCITY_CONTROL, forces=[0] * n, physicsClientId=cid)
    pb.setGravity(*g, physicsClientId=cid)
    pb.setTimeStep(dt, physicsClientId=cid)
    pb.setPhysicsEngineParameter(numSubSteps=0, physicsClientId=cid)
    spl = CubicSpline(tpath, qpath)
    t = np.arange(0, tpath[-1], dt)
    pushk = np.interp(t, tpath, push)
    Qd, dQd, ddQd = spl(t), spl(t, 1), spl(t, 2)
    for i in J:
        pb.resetJointState(body, i, Qd[0, i], dQd[0, i], physicsClientId=cid)
    # tremor: band-limited torque noise, 5 to 15 Hz
    from scipy.signal import butter, sosfilt
    sos = butter(2, [5, 15], "bandpass", fs=1 / dt, output="sos")
    shake = sosfilt(sos, rng.standard_normal((len(t), n)), axis=0)
    shake *= ctrl["tremor"] / (shake.std(0) + 1e-12) * ctrl["tremor_scale"]
    tipL = ch.ps + ch.Rs @ tip
    g = np.array(g, float)
    rotor = np.asarray(rotor, float)
    kp, kd = np.asarray(ctrl["kp"], float), np.asarray(ctrl["kd"], float)
    Q = np.zeros((len(t) + 1, n)); dQ = np.zeros((len(t) + 1, n)); F = np.zeros((len(t), 3)); N = 0.0
    S = np.zeros(NS)
    jz = np.zeros(n)
    get, put, ext, step = pb.getJointStates, pb.setJointMotorControlArray, pb.applyExternalForce, pb.stepSimulation
    dyn = arm.dyn()
    last = n - 1
    for k in range(len(t)):
        st = get(body, J, physicsClientId=cid)
        for i in range(n):
            Q[k, i] = st[i][0]; dQ[k, i] = st[i][1]
        if k == 0:
            S[8] = -1.0
        if k % 8 == 0:
            M = mass_matrix(*dyn, Q[k])
        tau, f, x, d, N = tick(*dyn, rotor, ch.Rs, tipL, g, Q[k], dQ[k], Qd[k], dQd[k], ddQd[k], ctrl["mode"], kp, kd, 0.0,
                               ctrl["jf"], jz, ctrl["jl"], shake[k], frame, P, S, dt, t[k], N, M, pushk[k])
        if k == 0:
            S[8:11] = (d, (x - frame[0]) @ frame[2], (x - frame[0]) @ frame[3])
        F[k] = f
        put(body, J, pb.TORQUE_CONTROL, forces=tau, physicsClientId=cid)
        if f[0] != 0.0 or f[1] != 0.0 or f[2] != 0.0:
            ext(body, last, f, x, pb.WORLD_FRAME, physicsClientId=cid)
        step(physicsClientId=cid)
        if k % 500 == 0 and not (np.abs(dQ[k]).max() < 20):
            raise RuntimeError("unstable")
    st = get(body, J, physicsClientId=cid)
    for i in range(n):
        Q[-1, i] = st[i][0]; dQ[-1, i] = st[i][1]
    ddQ = np.diff(dQ, axis=0) / dt
    dQm = 0.5 * (dQ[1:] + dQ[:-1])
    return t, Q[:-1], dQm, ddQ, F, Qd
