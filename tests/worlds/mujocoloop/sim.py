"""MuJoCo engine: builds the arm from the URDF and steps it natively (mj_step1/mj_step2 called from numba), SI units."""
from __future__ import annotations
import ctypes
import glob
import os
import xml.etree.ElementTree as ET
from dataclasses import dataclass, field
import mujoco
import numpy as np
from numba import njit
from laws import NS, contact_force, norm3

_LIB = ctypes.CDLL(glob.glob(os.path.join(os.path.dirname(mujoco.__file__), "libmujoco.so*"))[0])
_U = ctypes.c_uint64


def _c(name: str, n: int):
    """A MuJoCo C function taking n addresses, callable from nopython code."""
    f = getattr(_LIB, name)
    f.argtypes, f.restype = [_U] * n, None
    return f


_step1, _step2, _mul_m = _c("mj_step1", 2), _c("mj_step2", 2), _c("mj_mulM", 4)


@dataclass
class Tool:
    """What is mounted beyond the measuring plane: mass [kg], com [m, sensor frame], inertia about com [kg m^2], tip [m]."""
    mass: float = 0.24
    com: np.ndarray = field(default_factory=lambda: np.array([0.0, 0.0, 0.049]))
    inertia: np.ndarray = field(default_factory=lambda: np.array([2e-4, 2e-4, 3e-5]))
    tip: np.ndarray = field(default_factory=lambda: np.array([0.0, 0.0, 0.1]))


def build_arm(urdf: str, tool: Tool, gravity: np.ndarray, dt: float, armature: np.ndarray, slosh: tuple | None = None,
              link_extra: tuple | None = None, elastic: np.ndarray | None = None) -> mujoco.MjModel:
    """The LWR4+ with a tool. elastic: a spring [N m/rad] in series behind every drive, as a second hinge on the link's body. slosh = (mass, length, damping): a pendulum on the tool; link_extra = (link, mass, place): a lump on a link."""
    root = ET.parse(urdf).getroot()
    for link in root.iter("link"):
        for tag in ("visual", "collision"):
            for e in link.findall(tag):
                link.remove(e)
    spec = mujoco.MjSpec.from_string(ET.tostring(root, encoding="unicode"))
    spec.option.timestep, spec.option.gravity = dt, gravity
    spec.option.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_CONTACT) | int(mujoco.mjtDisableBit.mjDSBL_LIMIT)
    b = spec.body("ft_sensor")
    b.mass, b.ipos, b.inertia, b.explicitinertial = max(tool.mass, 1e-6), tool.com, np.maximum(tool.inertia, 1e-7), True
    b.add_site(name="ft")
    b.add_site(name="tip", pos=tool.tip)
    for typ in ("FORCE", "TORQUE"):
        spec.add_sensor(name=typ, type=getattr(mujoco.mjtSensor, f"mjSENS_{typ}"), objtype=mujoco.mjtObj.mjOBJ_SITE, objname="ft")
    if slosh is not None:
        mass, length, damp = slosh
        p = b.add_body(name="slosh", pos=[0, 0, 0.08])
        p.add_joint(name="slosh", axis=[0, 1, 0], damping=[damp] + [0.0] * 2)
        p.mass, p.ipos, p.inertia, p.explicitinertial = mass, [0, 0, length], [1e-4] * 3, True
    if link_extra is not None:
        p = spec.body(f"link_{link_extra[0]}").add_body(name="lump", pos=link_extra[2])
        p.mass, p.inertia, p.explicitinertial = link_extra[1], [1e-5] * 3, True
    for i in range(7):
        j = spec.joint(f"joint_{i + 1}")
        j.armature = float(armature[i])
        if elastic is not None:
            k = float(elastic[i])
            spec.body(f"link_{i + 1}").add_joint(name=f"elastic_{i + 1}", axis=j.axis, stiffness=[k, 0, 0], damping=[0.003 * k, 0, 0])
    return spec.compile()


def build_axis(inertia: float, dt: float) -> mujoco.MjModel:
    """One horizontal-plane hinge with a given inertia [kg m^2]."""
    spec = mujoco.MjSpec()
    spec.option.timestep = dt
    b = spec.worldbody.add_body(name="load")
    b.add_joint(name="axis", axis=[0, 0, 1])
    b.mass, b.inertia, b.explicitinertial = 1.0, [inertia] * 3, True
    return spec.compile()


def solve_ik(m: mujoco.MjModel, q0: np.ndarray, x: np.ndarray, R: np.ndarray) -> np.ndarray:
    """Joint angles that bring the site `tip` to x [m] with orientation R, by damped least squares from q0."""
    d, sid = mujoco.MjData(m), m.site("tip").id
    d.qpos[:7] = q0
    jp, jr = np.zeros((3, m.nv)), np.zeros((3, m.nv))
    for _ in range(200):
        mujoco.mj_kinematics(m, d)
        mujoco.mj_comPos(m, d)
        Rc = d.site_xmat[sid].reshape(3, 3)
        e = np.r_[x - d.site_xpos[sid], 0.5 * sum(np.cross(Rc[:, i], R[:, i]) for i in range(3))]
        if np.abs(e).max() < 1e-10:
            break
        mujoco.mj_jacSite(m, d, jp, jr, sid)
        J = np.vstack([jp, jr])[:, :7]
        d.qpos[:7] += J.T @ np.linalg.solve(J @ J.T + 1e-6 * np.eye(6), e)
    return d.qpos[:7].copy()


@njit
def _cart_loop(ma, da, n, dt, every, qpos, qvel, qacc, bias, applied, xfrc, xanchor, xaxis, sp, sm, xip, sens, jid,
               xd, vd, Rd, wd, K, Kr, zeta, meff, q0, P, surf, out, tipforce):
    """Impedance control of the tip along xd, Rd under the contact law P; writes [t q dq ddq wrench N T1 T2 tau] each `every` steps."""
    nv = qvel.shape[0]
    st = np.zeros(NS)
    J = np.zeros((6, 7))
    D, Dr = 2 * zeta * np.sqrt(K * meff), 2 * zeta * np.sqrt(Kr * 0.05)
    rec = 0
    for k in range(n):
        _step1(ma, da)
        p, Rt = sp[1], sm[1].reshape(3, 3)
        for i in range(7):
            a, r = xaxis[i], p - xanchor[i]
            J[0, i], J[1, i], J[2, i] = a[1] * r[2] - a[2] * r[1], a[2] * r[0] - a[0] * r[2], a[0] * r[1] - a[1] * r[0]
            J[3:, i] = a
        v = J @ qvel[:7]
        eo = np.zeros(3)
        for i in range(3):
            eo += 0.5 * np.cross(Rt[:, i].copy(), Rd[k, :, i].copy())
        F = np.zeros(6)
        F[:3] = K * (xd[k] - p) + D * (vd[k] - v[:3])
        F[3:] = Kr * eo + Dr * (wd[k] - v[3:])
        tau = bias[:7] + J.T @ F + 15.0 * (q0 - qpos[:7]) - 3.0 * qvel[:7]
        rel, vt = p - surf[0], v[:3]
        s = np.array([-np.dot(rel, surf[1]), np.dot(rel, surf[2]), np.dot(rel, surf[3])])
        sv = np.array([-np.dot(vt, surf[1]), np.dot(vt, surf[2]), np.dot(vt, surf[3])])
        fs = contact_force(P, st, dt, k * dt, s, sv)
        fw = fs[0] * surf[1] + fs[1] * surf[2] + fs[2] * surf[3] + fs[3:6]
        xfrc[:3] = fw
        xfrc[3:] = np.cross(p - xip, fw)
        applied[:7] = tau
        if k % every == 0:
            out[rec, 0] = k * dt
            out[rec, 1:8], out[rec, 8:15] = qpos[:7], qvel[:7]
        _step2(ma, da)
        if k % every == 0:
            out[rec, 15:22] = qacc[:7]
            out[rec, 22:28] = -sens
            out[rec, 28:31] = fs[:3]
            tipforce[rec] = fw
            rec += 1
    return rec


@njit
def _joint_loop(ma, da, tmp_in, tmp_out, tia, toa, n, dt, every, nj, qpos, qvel, qacc, bias, applied, qd, dqd, ddqd, wn, fr, ext, w, out):
    """Computed-torque control of the drives with link-side friction; out rows: link's [q dq ddq], tau applied, friction, spring's [e de].

    w: hinges a drive (2 with a series spring); fr: columns of joint_friction.
    """
    z = np.zeros(nj)
    rec = 0
    for k in range(n):
        _step1(ma, da)
        for i in range(nj):
            tmp_in[w * i] = ddqd[k, i] + wn * wn * (qd[k, i] - qpos[w * i]) + 2 * wn * (dqd[k, i] - qvel[w * i])
        _mul_m(ma, da, toa, tia)
        if k % every == 0:
            out[rec, 0] = k * dt
        for i in range(nj):
            v, tau = qvel[w * i], tmp_out[w * i] + bias[w * i]
            p, e, de = qpos[w * i], 0.0, 0.0
            if w == 2:
                e, de = qpos[w * i + 1], qvel[w * i + 1]
            f, z[i] = joint_friction(fr[:, i], v + de, z[i], dt, tau)
            applied[w * i] = tau - f + ext[k, i]
            if w == 2:
                applied[w * i + 1] = ext[k, i] - f
            if k % every == 0:
                out[rec, 1 + i], out[rec, 1 + nj + i], out[rec, 1 + 5 * nj + i], out[rec, 1 + 6 * nj + i] = p + e, v + de, e, de
                out[rec, 1 + 3 * nj + i], out[rec, 1 + 4 * nj + i] = tau, f
        _step2(ma, da)
        if k % every == 0:
            for i in range(nj):
                out[rec, 1 + 2 * nj + i] = qacc[w * i] + (qacc[w * i + 1] if w == 2 else 0.0)
            rec += 1
    return rec


@njit
def joint_friction(f, v, z, dt, tau):
    """Link-side friction [N m] at speed v [rad/s]; f = [Fc, Fv, dF, vs, asym, load, len, v0, quad]. Dahl over len [rad], else tanh(v/v0)."""
    s = np.tanh(v / f[7])
    if f[6] > 0:
        u = 1.0 if v > 0 else -1.0
        z = u + (z - u) * np.exp(-abs(v) * dt / f[6])
        s = z
    level = f[0] + f[2] * np.exp(-(v / f[3]) ** 2) + f[5] * abs(tau)
    return (level * s + f[1] * v) * (1 + f[4] * np.tanh(v / f[7])) + f[8] * v * abs(v), z


def run_cart(m: mujoco.MjModel, q0, xd, vd, Rd, wd, K: float, Kr: float, zeta: float, P, surf, every: int) -> np.ndarray:
    """Simulates a contact log. Returns rows [t, q7, dq7, ddq7, wrench6, N T1 T2] at every*timestep."""
    d = mujoco.MjData(m)
    d.qpos[:7] = q0
    n = len(xd)
    out, tf = np.zeros((n // every + 1, 31)), np.zeros((n // every + 1, 3))
    b = m.body("ft_sensor").id
    rec = _cart_loop(m._address, d._address, n, m.opt.timestep, every, d.qpos, d.qvel, d.qacc, d.qfrc_bias, d.qfrc_applied, d.xfrc_applied[b],
                     d.xanchor, d.xaxis, d.site_xpos, d.site_xmat, d.xipos[b], d.sensordata[:6], 0, xd, vd, Rd, wd, K, Kr, zeta, 4.0, q0, P, surf, out, tf)
    return np.hstack([out[:rec], tf[:rec]])


def run_joint(m: mujoco.MjModel, nj: int, qd, dqd, ddqd, wn: float, fr, ext, every: int, w: int = 1) -> np.ndarray:
    """Simulates free motion under computed torque. Returns rows [t, q, dq, ddq, tau_applied, friction, spring, spring rate]."""
    d = mujoco.MjData(m)
    d.qpos[:w * nj:w], d.qvel[:w * nj:w] = qd[0], dqd[0]
    ti, to = np.zeros(m.nv), np.zeros(m.nv)
    out = np.zeros((len(qd) // every + 1, 1 + 7 * nj))
    rec = _joint_loop(m._address, d._address, ti, to, ti.ctypes.data, to.ctypes.data, len(qd), m.opt.timestep, every, nj, d.qpos, d.qvel, d.qacc,
                      d.qfrc_bias, d.qfrc_applied, qd, dqd, ddqd, wn, fr, ext, w, out)
    return out[:rec]
