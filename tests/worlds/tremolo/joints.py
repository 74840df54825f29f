"""Arms in free motion and single drives, own integrator: closed loop (computed torque or PD) round the true dynamics with friction, elasticity and the rest.
tau = M(q) q'' + h(q, q') + everything hidden; friction after Armstrong-Helouvry et al. 1994 and Bona & Indri 2005, load term after Dohring et al. 1993 /
Hamon et al. 2010, elastic joints after Spong 1987, rotor inertia on the axes (Sciavicco & Siciliano), ripple as harmonics of the joint's angle."""
import numpy as np
from numba import njit
from scipy.interpolate import CubicSpline
from chain import rnea, mass_matrix

SIZE = np.array([1., 1., .7, .7, .3, .2, .12])
FR = ("fc", "fv", "fa", "fs", "vs", "fl", "fo", "B", "ks", "rA", "rk", "rp", "K")


@njit(cache=True)
def friction(p, z, q, dq, load):
    """Per joint, p rows as in FR: Coulomb, viscous, asymmetry, Stribeck, load, offset, spring, ripple (two harmonics)."""
    out = np.zeros(len(q))
    for i in range(len(q)):
        s = p[0, i] + p[3, i] * np.exp(-(dq[i] / p[4, i]) ** 2) + p[5, i] * abs(load[i])
        out[i] = s * z[i] + p[2, i] * abs(z[i]) + p[1, i] * dq[i] + p[6, i] + p[8, i] * q[i]
        if p[9, i] != 0.0:
            out[i] += p[9, i] * (np.sin(p[10, i] * q[i] + p[11, i]) + 0.35 * np.sin(2 * p[10, i] * q[i] + 2.1 * p[11, i]))
    return out


@njit(cache=True)
def bristle(kind, z, step, L):
    for i in range(len(z)):
        s = 1.0 if step[i] > 0 else -1.0
        if kind == 0:
            z[i] = s + (z[i] - s) * np.exp(-abs(step[i]) / L)
        else:
            z[i] = min(1.0, max(-1.0, z[i] + step[i] / L))


@njit(cache=True)
def run_arm(Rj, pj, ax, m, c, I, mn, cn, In, g, gn, Qd, dQd, ddQd, dt, p, kind, L, kp, kd, shake, elastic, wear, push):
    """m,c,I true masses, mn.. the controller's. elastic: stiffness per joint, 0 = rigid. wear: factor of friction in time. push: outside torque."""
    N, n = Qd.shape
    Q = np.zeros((N, n)); dQ = np.zeros((N, n)); ddQ = np.zeros((N, n)); T = np.zeros((N, n))
    q = Qd[0].copy(); dq = dQd[0].copy(); th = q.copy(); dth = dq.copy()
    z = np.zeros(n); zero = np.zeros(n); a = np.zeros(n); load = np.zeros(n)
    M = np.zeros((n, n)); h = np.zeros(n)
    for i in range(n):
        if elastic[i] > 0:
            h0 = rnea(Rj, pj, ax, m, c, I, q, zero, zero, g)
            th[i] = q[i] + h0[i] / elastic[i]
    for k in range(N):
        if k % 4 == 0:
            M = mass_matrix(Rj, pj, ax, m, c, I, q)
        h = rnea(Rj, pj, ax, m, c, I, q, dq, zero, g)
        qm = q.copy(); dqm = dq.copy()
        for i in range(n):
            if elastic[i] > 0:
                qm[i] = th[i]; dqm[i] = dth[i]
        u = M @ ddQd[k] + rnea(Rj, pj, ax, mn, cn, In, qm, dqm, zero, gn) + shake[k] + kp * (Qd[k] - qm) + kd * (dQd[k] - dqm)
        for i in range(n):
            u[i] += (p[7, i] + (0.3 if elastic[i] > 0 else 0.0)) * ddQd[k, i] + 0.7 * p[0, i] * np.tanh(dQd[k, i] / 0.02)
        for i in range(n):      # the torque that the gears transmit: the links' own, last substep's acceleration
            load[i] = h[i]
            for j in range(n):
                load[i] += M[i, j] * a[j]
        fr = friction(p, z, qm, dqm, load)
        for i in range(n):
            w = p[0, i] * z[i] + p[1, i] * dqm[i]
            fr[i] += (wear[k] - 1.0) * w + push[k, i]
        A = M.copy(); b = np.zeros(n); joint = np.zeros(n)
        for i in range(n):
            if elastic[i] > 0:
                joint[i] = elastic[i] * (th[i] - q[i]) + 0.004 * elastic[i] * (dth[i] - dq[i])
                b[i] = joint[i] - h[i] - fr[i]
            else:
                A[i, i] += p[7, i] + dt * kd[i] + dt * dt * (kp[i] + p[0, i] / L)      # implicit damping and springs
                b[i] = u[i] - h[i] - fr[i]
        a[:] = np.linalg.solve(A, b)
        Q[k] = qm; dQ[k] = dqm; ddQ[k] = a
        for i in range(n):
            T[k, i] = joint[i] if elastic[i] > 0 else u[i] - (dt * kd[i] + dt * dt * kp[i]) * a[i]
        dq = dq + dt * a
        step = dt * dq
        q = q + step
        for i in range(n):
            if elastic[i] > 0:
                dth[i] += dt * (u[i] - joint[i]) / (0.3 + dt * kd[i])
                s = dt * dth[i]
                th[i] += s
                step[i] = s
        bristle(kind, z, step, L)
    return Q, dQ, ddQ, T


@njit(cache=True)
def run_drive(inertia, Qd, dQd, ddQd, dt, p, kind, L, kp, kd, shake, wear, push):
    N = len(Qd)
    Q = np.zeros((N, 1)); dQ = np.zeros((N, 1)); T = np.zeros((N, 1))
    q = Qd[0].copy(); dq = dQd[0].copy(); z = np.zeros(1); ld = np.zeros(1)
    for k in range(N):
        u = inertia * (ddQd[k, 0] + kp * (Qd[k, 0] - q[0]) + kd * (dQd[k, 0] - dq[0])) + p[0, 0] * np.sign(dQd[k, 0]) * 0.8 + shake[k, 0]
        ld[0] = abs(u)
        fr = friction(p, z, q, dq, ld)[0] + (wear[k] - 1.0) * (p[0, 0] * z[0] + p[1, 0] * dq[0]) + push[k, 0]
        a = (u - fr) / (inertia + p[7, 0])
        Q[k, 0] = q[0]; dQ[k, 0] = dq[0]; T[k, 0] = u
        dq = dq + dt * a
        s = dt * dq
        q = q + s
        bristle(kind, z, s, L)
    return Q, dQ, T


@njit(cache=True)
def plain_bristle(Q, L, kind):
    Z = np.zeros_like(Q)
    z = np.zeros(Q.shape[1])
    for k in range(1, len(Q)):
        bristle(kind, z, Q[k] - Q[k - 1], L)
        Z[k] = z
    return Z


def excite(rng, lo, hi, vmax, T, opt, fs=200.0):
    """Fourier excitation (Swevers et al. 1997) fast and slow, single-joint strokes of constant speed, short rests."""
    n = len(lo)
    mid, half = .5 * (lo + hi), .5 * (hi - lo)
    rows = []
    now = mid + half * rng.uniform(-.3, .3, n)

    def blend(goal, T):
        nonlocal now
        k = max(2, int(T * fs)); u = np.arange(1, k + 1) / k
        s = u ** 3 * (10 - 15 * u + 6 * u * u)
        rows.append(now + s[:, None] * (goal - now)); now = goal.copy()

    def rest(T):
        rows.append(np.repeat(now[None], int(T * fs), 0))
    rest(.2)
    share = opt.get("share", [("fourier", 1.0), ("strokes", .5), ("fourier", .3), ("fourier", .7)])
    tot = sum(w for _, w in [(k, 1) for k, _ in share])
    for kind, speed in share:
        D = T / tot
        if kind == "fourier":
            t = np.arange(int(D * fs)) / fs
            w0 = 2 * np.pi / max(8.0, D / 2) * (speed if speed < 1 else 1)
            x = np.zeros((len(t), n))
            for j in range(n):
                for h in range(1, 6):
                    x[:, j] += rng.normal() / h ** .7 * np.sin(h * w0 * t + rng.uniform(0, 6.3))
            x /= np.abs(x).max(0)
            amp = np.minimum(half * rng.uniform(.55, .85, n), 4.)
            v = np.abs(np.gradient(x, 1 / fs, axis=0)).max(0) * amp
            amp *= np.minimum(1, .5 * vmax * min(1, speed + .2) / v)
            x = x * amp + mid
            blend(x[0], 1.5)
            rows.append(x); now = x[-1].copy()
        else:
            first = len(rows)
            for j in rng.permutation(n)[:max(1, int(D / 4))] if n > 1 else [0] * max(1, int(D / 5)):
                a = now.copy(); b = now.copy()
                far = half[j] * opt.get("turn", .8)
                v = vmax[j] * speed * rng.uniform(.1, .9)
                for goal in (mid[j] + far, mid[j] - far):
                    b = now.copy(); b[j] = goal
                    L = abs(goal - now[j]); k = max(4, int(min(L / v + .4, 7.) * fs))
                    tt = np.arange(1, k + 1) / k
                    r = min(.45, .3 * fs / k)
                    vv = np.minimum(1, np.minimum(tt / r, (1 - tt) / r)); u = np.cumsum(vv); u /= u[-1]
                    rows.append(now + u[:, None] * (b - now)); now = b
            block = np.vstack(rows[first:])      # the other joints sway meanwhile: a joint at rest tells nothing of its friction
            del rows[first:]
            tt = np.arange(len(block)) / fs
            env = np.minimum(1, np.minimum(tt, tt[-1] - tt) / .6)
            for j in range(n):
                if n > 1:
                    A = .12 * half[j] * rng.uniform(.7, 1.3)
                    block[:, j] += A * env * np.sin(2 * np.pi * rng.uniform(.12, .3) * tt + rng.uniform(0, 6.28))
            rows.append(block)
        rest(rng.uniform(.1, .25))
    from scipy.ndimage import gaussian_filter1d
    x = gaussian_filter1d(np.vstack(rows), 6, axis=0, mode="nearest")
    t = np.arange(len(x)) / fs
    return t, x


def sampled(t, x, dt):
    s = CubicSpline(t, x)
    tt = np.arange(0, t[-1], dt)
    return tt, s(tt), s(tt, 1), s(tt, 2)
