"""Closed loops inside MuJoCo: the numba loop calls mj_step1/mj_step2 of libmujoco by address; own controllers, own contact,
own joint friction. The wrench is MuJoCo's force and torque sensor between the wrist and the welded tool body."""
import ctypes
import glob
import math
import os
import numpy as np
import mujoco
from numba import njit
from robots import Chain, ROBOTS, mujoco_model, fk, mv, mm, cross, rot_error
from laws import mat_step, place_gain, NX

_lib = ctypes.CDLL(glob.glob(os.path.join(os.path.dirname(mujoco.__file__), "libmujoco.so*"))[0])
_s1, _s2 = _lib.mj_step1, _lib.mj_step2
for _s in (_s1, _s2):
    _s.argtypes, _s.restype = [ctypes.c_void_p] * 2, None

# ext: things outside the catalogue, in the contact loop
EXT = {n: i for i, n in enumerate("slope1 slope2 wave_a wave_l vib_a vib_f jump_a jump_t hose_k hx hy hz ax ay az torsion ball".split())}


@njit
def arm_loop(ma, da, qpos, qvel, bias, applied, xfrc, sens, pack, tip, com, rq, rdq, rh, n, dt, rec, mode, K, D, Kx, Dx,
             fr, surf, p, ext, O):
    nv = qpos.size
    ps, R = np.empty(3), np.empty((3, 3))
    pd, Rd = np.empty(3), np.empty((3, 3))
    an, ax = np.empty((nv, 3)), np.empty((nv, 3))
    and_, axd = np.empty((nv, 3)), np.empty((nv, 3))
    B = np.zeros((10, 3))
    r, rt, f, tq, tmp, e, v, om, vd, omd = B[0], B[1], B[2], B[3], B[4], B[5], B[6], B[7], B[8], B[9]
    q_d, dq_d, tau, z = np.zeros(nv), np.zeros(nv), np.zeros(nv), np.zeros(nv)
    ltip = math.sqrt(tip[0] ** 2 + tip[1] ** 2 + tip[2] ** 2)
    x, o = np.zeros(NX), np.zeros(4)
    P0, nn, t1, t2 = surf[0], surf[1], surf[2], surf[3]
    nref = rq.shape[0]
    row = 0
    for k in range(n):
        t = k * dt
        _s1(ma, da)
        # reference by cubic Hermite
        u = t / rh
        i0 = min(int(u), nref - 2)
        u -= i0
        u2, u3 = u * u, u * u * u
        for j in range(nv):
            a, b, da_, db = rq[i0, j], rq[i0 + 1, j], rdq[i0, j] * rh, rdq[i0 + 1, j] * rh
            q_d[j] = (2 * u3 - 3 * u2 + 1) * a + (u3 - 2 * u2 + u) * da_ + (3 * u2 - 2 * u3) * b + (u3 - u2) * db
            dq_d[j] = ((6 * u2 - 6 * u) * (a - b) + (3 * u2 - 4 * u + 1) * da_ + (3 * u2 - 2 * u) * db) / rh
        fk(pack, qpos, ps, R, an, ax)
        mv(R, tip, rt)
        if ext[16] > 0.0:                                    # a ball: the lowest point of it touches
            for i in range(3):
                rt[i] = rt[i] * (1.0 - ext[16] / ltip) - ext[16] * nn[i]
        for i in range(3):
            v[i] = 0.0
            om[i] = 0.0
        for j in range(nv):
            for i in range(3):
                r[i] = ps[i] + rt[i] - an[j, i]
            cross(ax[j], r, tmp)
            for i in range(3):
                v[i] += tmp[i] * qvel[j]
                om[i] += ax[j, i] * qvel[j]
        d = s1 = s2 = dd = v1 = v2 = w = 0.0
        for i in range(3):
            u = ps[i] + rt[i] - P0[i]
            d -= u * nn[i]; s1 += u * t1[i]; s2 += u * t2[i]
            dd -= v[i] * nn[i]; v1 += v[i] * t1[i]; v2 += v[i] * t2[i]
            w += om[i] * nn[i]
        ph = 2 * math.pi * s1 / ext[3] if ext[3] > 0.0 else 0.0
        dm = d + ext[0] * s1 + ext[1] * s2 + ext[2] * math.sin(ph) + ext[4] * math.sin(2 * math.pi * ext[5] * t)
        ddm = dd + ext[0] * v1 + ext[1] * v2 + ext[4] * 2 * math.pi * ext[5] * math.cos(2 * math.pi * ext[5] * t)
        if ext[3] > 0.0:
            ddm += ext[2] * math.cos(ph) * 2 * math.pi * v1 / ext[3]
        if t > ext[7]:
            dm += ext[6]
        mat_step(p, x, t, dt, dm, ddm, s1, s2, v1, v2, place_gain(p, s1, s2), o)
        for i in range(3):
            f[i] = o[0] * nn[i] + o[1] * t1[i] + o[2] * t2[i]
        mv(R, com, tmp)
        for i in range(3):
            r[i] = rt[i] - tmp[i]
        cross(r, f, tq)
        spin = -ext[15] * max(o[0], 0.0) * math.tanh(w / 0.03)
        for i in range(3):
            xfrc[i] = f[i]
            xfrc[3 + i] = tq[i] + spin * nn[i]
        if ext[8] > 0.0:                                     # a hose from the tool to the table
            for i in range(3):
                tmp[i] = R[i, 0] * (ext[12] - com[0]) + R[i, 1] * (ext[13] - com[1]) + R[i, 2] * (ext[14] - com[2])
            for i in range(3):
                r[i] = ext[8] * (ext[9 + i] - ps[i] - R[i, 0] * ext[12] - R[i, 1] * ext[13] - R[i, 2] * ext[14])
            cross(tmp, r, tq)
            for i in range(3):
                xfrc[i] += r[i]
                xfrc[3 + i] += tq[i]
        # control
        for j in range(nv):
            tau[j] = bias[j] + K[j] * (q_d[j] - qpos[j]) + D[j] * (dq_d[j] - qvel[j])
        if mode == 1:
            fk(pack, q_d, pd, Rd, and_, axd)
            mv(R, tip, rt)
            mv(Rd, tip, tmp)
            for i in range(3):
                vd[i] = 0.0; omd[i] = 0.0; v[i] = 0.0
            for i in range(3):
                e[i] = pd[i] + tmp[i] - ps[i] - rt[i]
            for j in range(nv):
                for i in range(3):
                    r[i] = pd[i] + tmp[i] - and_[j, i]
                cross(axd[j], r, tq)
                for i in range(3):
                    vd[i] += tq[i] * dq_d[j]; omd[i] += axd[j, i] * dq_d[j]
                for i in range(3):
                    r[i] = ps[i] + rt[i] - an[j, i]
                cross(ax[j], r, tq)
                for i in range(3):
                    v[i] += tq[i] * qvel[j]
            rot_error(Rd, R, r)
            for i in range(3):
                f[i] = Kx[i] * e[i] + Dx[i] * (vd[i] - v[i])
                tmp[i] = Kx[3 + i] * r[i] + Dx[3 + i] * (omd[i] - om[i])
            for j in range(nv):
                for i in range(3):
                    r[i] = ps[i] + rt[i] - an[j, i]
                cross(r, f, tq)
                for i in range(3):
                    tau[j] += ax[j, i] * (tq[i] + tmp[i])
        for j in range(nv):                                  # joint friction (Dahl)
            ex = math.exp(-abs(qvel[j]) * dt / fr[j, 2])
            z[j] = (fr[j, 2] * (1 - ex) * (1.0 if qvel[j] > 0 else -1.0)) / fr[j, 2] + z[j] * ex
            applied[j] = tau[j] - fr[j, 0] * z[j] - fr[j, 1] * qvel[j]
        if k % rec == 0 and row < O.shape[0]:
            O[row, 0] = t
            for j in range(nv):
                O[row, 1 + j] = qpos[j]
                O[row, 1 + nv + j] = qvel[j]
        _s2(ma, da)
        if k % rec == 0 and row < O.shape[0]:
            c = 1 + 2 * nv
            for i in range(6):
                O[row, c + i] = -sens[i]      # MuJoCo: parent on child; the contract: load on the tool
            O[row, c + 6] = o[0]; O[row, c + 7] = o[1]; O[row, c + 8] = o[2]; O[row, c + 9] = d
            row += 1
    return row


JP = {n: i for i, n in enumerate(("fc fv df vs ell load asym ra rk rph ra2 spring sq0 vlag warm warm_t couple drag fpos fk "
                                  "push push_t1 push_t2").split())}


@njit(cache=True, nogil=True)
def joint_friction(jp, t, q, v, dt, z, vl, load):
    """Torque that the joint takes beside the rigid body; returns it, new bristle state and lagged speed."""
    ell = jp[4]
    ex = math.exp(-abs(v) * dt / ell)
    z = (1 - ex) * (1.0 if v > 0 else (-1.0 if v < 0 else 0.0)) + z * ex
    if jp[13] > 0:
        vl += (1 - math.exp(-dt / jp[13])) * (abs(v) - vl)
    else:
        vl = abs(v)
    warm = 1.0 + jp[14] * math.exp(-t / jp[15]) if jp[14] != 0.0 else 1.0
    fc = jp[0] * (1 + jp[18] * math.sin(jp[19] * q)) * (1.0 + jp[6] * z) * warm
    f = (fc + jp[2] * math.exp(-(vl / jp[3]) ** 2) + jp[5] * abs(load)) * z + jp[1] * v * warm + jp[17] * v * abs(v)
    f += jp[7] * math.sin(jp[8] * q + jp[9]) + jp[10] * math.sin(2 * jp[8] * q + 1.3 * jp[9]) + jp[11] * (q - jp[12])
    if jp[20] != 0.0:                                        # a hand leans on the arm, in pulses
        for c in range(4):
            u = (t - jp[21] - c * jp[22]) / 0.9
            if 0.0 < u < 1.0:
                f -= jp[20] * math.sin(math.pi * u) ** 2
    return f, z, vl


@njit
def joint_loop(ma, da, qpos, qvel, qacc, bias, applied, rq, rdq, rh, n, dt, rec, K, D, jp, arm, O):
    nv = qpos.size
    B = np.zeros((7, nv))
    q_d, dq_d, tau, z, vl, F, acc = B[0], B[1], B[2], B[3], B[4], B[5], B[6]
    nref = rq.shape[0]
    row = 0
    for k in range(n):
        t = k * dt
        _s1(ma, da)
        u = t / rh
        i0 = min(int(u), nref - 2)
        u -= i0
        u2, u3 = u * u, u * u * u
        for j in range(nv):
            a, b, da_, db = rq[i0, j], rq[i0 + 1, j], rdq[i0, j] * rh, rdq[i0 + 1, j] * rh
            q_d[j] = (2 * u3 - 3 * u2 + 1) * a + (u3 - 2 * u2 + u) * da_ + (3 * u2 - 2 * u3) * b + (u3 - u2) * db
            dq_d[j] = ((6 * u2 - 6 * u) * (a - b) + (3 * u2 - 4 * u + 1) * da_ + (3 * u2 - 2 * u) * db) / rh
        for j in range(nv):
            tau[j] = bias[j] + K[j] * (q_d[j] - qpos[j]) + D[j] * (dq_d[j] - qvel[j])
            load = tau[j] - F[j] - arm[j] * acc[j]
            F[j], z[j], vl[j] = joint_friction(jp[j], t, qpos[j], qvel[j], dt, z[j], vl[j], load)
        for j in range(nv):
            applied[j] = tau[j] - F[j]
            if jp[j, 16] != 0.0:                             # a joint drags its neighbour's gear along
                applied[j] -= jp[j, 16] * F[j - 1]
        w = k % rec == 0 and row < O.shape[0]
        if w:
            O[row, 0] = t
            for j in range(nv):
                O[row, 1 + j] = qpos[j]
                O[row, 1 + nv + j] = qvel[j]
                O[row, 1 + 2 * nv + j] = tau[j]
        _s2(ma, da)
        for j in range(nv):
            acc[j] = qacc[j]
        if w:
            for j in range(nv):
                O[row, 1 + 3 * nv + j] = acc[j]
            row += 1
    return row


class Arm:
    def __init__(self, name):
        self.name, self.chain, self.spec = name, Chain(name), ROBOTS[name]

    def run_contact(self, ref_q, ref_h, T, surf, p, tool, gravity, tip, ctrl, fric, ext=None, dt=5e-4, rec=1):
        """Closed loop with contact; returns dict of arrays at dt*rec: t q dq w(6) force(3) depth."""
        m, d, body = mujoco_model(self.name, gravity, tool, dt)
        nv = m.nv
        n = int(round(T / dt))
        O = np.zeros((n // rec, 1 + 2 * nv + 10))
        d.qpos[:] = ref_q[0]
        rdq = np.gradient(ref_q, ref_h, axis=0)
        ex = np.zeros(len(EXT)) if ext is None else ext
        rows = arm_loop(m._address, d._address, d.qpos, d.qvel, d.qfrc_bias, d.qfrc_applied, d.xfrc_applied[body], d.sensordata,
                        self.chain.pack, np.array(tip, float), np.array(tool["com"], float), ref_q, rdq, ref_h, n, dt, rec,
                        ctrl["mode"], ctrl["K"], ctrl["D"], ctrl["Kx"], ctrl["Dx"], fric, surf, p, ex, O)
        O = O[:rows]
        c = 1 + 2 * nv
        return dict(t=O[:, 0], q=O[:, 1:1 + nv], dq=O[:, 1 + nv:c], w=O[:, c:c + 6], f=O[:, c + 6:c + 9], depth=O[:, c + 9])

    def run_free(self, ref_q, ref_h, T, jp, tool, gravity, ctrl, armature, payload=None, dt=5e-4, rec=1):
        m, d, _ = mujoco_model(self.name, gravity, tool, dt, payload=payload, damping=0.0, armature=armature)
        nv = m.nv
        n = int(round(T / dt))
        O = np.zeros((n // rec, 1 + 4 * nv))
        d.qpos[:] = ref_q[0]
        rdq = np.gradient(ref_q, ref_h, axis=0)
        rows = joint_loop(m._address, d._address, d.qpos, d.qvel, d.qacc, d.qfrc_bias, d.qfrc_applied, ref_q, rdq, ref_h, n, dt,
                          rec, ctrl["K"], ctrl["D"], jp, np.array(armature, float), O)
        O = O[:rows]
        return dict(t=O[:, 0], q=O[:, 1:1 + nv], dq=O[:, 1 + nv:1 + 2 * nv], tau=O[:, 1 + 2 * nv:1 + 3 * nv], ddq=O[:, 1 + 3 * nv:])
