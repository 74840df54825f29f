"""Contact laws with memory, stepped over a motion (numba). One pair of functions serves the rich truth and the plain catalogue forms:
the truth fills in lists (two relaxation branches, several hysteresis elements, a patch of bristles, a shape from finite elements), the plain
form has one entry each. Equations: quasi-linear viscoelasticity (Fung) with a Prony series, Kelvin-Voigt and Hunt-Crossley damping,
Mullins softening below the deepest depth, Dahl / Prandtl hysteresis, a pull until a neck breaks; friction by bristles (Dahl, a brush of
Prandtl elements, Prandtl-Tomlinson elements that snap back, elasto-plastic) or rounded (square root, tanh)."""
import numpy as np
from numba import njit

DAHL, BRUSH, TOMLINSON, ELASTOPLASTIC, LUGRE, ROOT, TANH = range(7)


@njit(cache=True, inline="always")
def shape(d, n, poly, D):
    """elastic shape: d^n times exp(poly(d/D)), the finite elements' departure from the power."""
    if d <= 0.0:
        return 0.0
    s = d if n == 1.0 else d * np.sqrt(d) if n == 1.5 else d ** n
    if D > 0.0:
        x = min(d / D, 1.0)
        e = 0.0
        for c in poly[::-1]:
            e = e * x + c
        s *= np.exp(e)
    return s


@njit(cache=True, inline="always")
def _force(i, de, rate, gain, dt, st, n, poly, D, K2, db, rnd, rm, lm, Ah, Lh, hk, ratio, tau, c, lam, Fa, La, neck, commit, out):
    """force at effective depth de from the states st; commit writes the new states. st: 0 deepest, 1 last Fe, 2 last de, 3 attached,
    4.. hysteresis, then branches. out[0] = N, out[1] = Fe."""
    nh, nr = len(Ah), len(ratio)
    Fe = gain * shape(de, n, poly, D)
    if K2 != 0.0 and de > 0.0:
        x = de - db
        if rnd > 0.0:
            x = 0.5 * (x + np.sqrt(x * x + rnd * rnd))
            x0 = 0.5 * (-db + np.sqrt(db * db + rnd * rnd))
            Fe += K2 * (x - x0)
        elif x > 0:
            Fe += K2 * x
    deepest = max(st[0], de)
    if rm != 0.0 and de > 0.0:
        Fe *= 1.0 - rm * (1.0 - np.exp(-(deepest - de) / lm))
    N = Fe
    touching = de > 0.0
    step = de - st[2]
    for j in range(nh):
        z = st[4 + j]
        if touching:
            s = step if st[2] > 0.0 else de
            if hk == 0:
                z = (z + s / Lh[j]) / (1.0 + abs(s) / Lh[j])
            else:
                z = min(1.0, max(-1.0, z + s / Lh[j]))
            N += Ah[j] * z
        else:
            z = 0.0
        if commit:
            st[4 + j] = z
    for j in range(nr):
        h = st[4 + nh + j]
        e = np.exp(-dt / tau[j])
        h = h * e + ratio[j] * (Fe - st[1]) * tau[j] / dt * (1.0 - e) if dt > 0 else h + ratio[j] * (Fe - st[1])
        N += h
        if commit:
            st[4 + nh + j] = h
    if touching:
        N += c * rate + lam * Fe * rate
    else:
        N = 0.0
    if N < 0.0:
        N = 0.0
    stuck = st[3]
    if Fa != 0.0:
        if touching:
            stuck = min(1.0, stuck + abs(step) / 5e-5) if neck > 0.0 else 1.0
            N -= Fa * stuck
        elif stuck > 0.0:
            if de < -La:
                stuck = 0.0
            else:
                N = -Fa * stuck * (1.0 + neck * de / La)
    if commit:
        st[0], st[1], st[2], st[3] = deepest, Fe, de, stuck
    out[0], out[1] = N, Fe


@njit(cache=True)
def normal_run(t, depth, rate, gain, n, poly, D, K2, db, rnd, rm, lm, Ah, Lh, hk, ratio, tau, c, lam, Fa, La, neck, C):
    m = len(t)
    N, Fe = np.zeros(m), np.zeros(m)
    st = np.zeros(4 + len(Ah) + len(ratio))
    out = np.zeros(2)
    st[2] = min(depth[0], 0.0)
    for i in range(m):
        dt = t[i] - t[i - 1] if i else 0.0
        de, ra = depth[i], rate[i]
        if C > 0.0 and de > 0.0:
            # depth = de + C N(de): secant
            a, b = de - C * max(N[i - 1], 0.0) if i else de, de
            prev = st[2]
            for _ in range(8):
                r = (a - prev) / dt if dt > 0 else ra
                r = ra if abs(r) > 2 * abs(ra) + 1e-3 else r
                _force(i, a, r, gain[i], dt, st, n, poly, D, K2, db, rnd, rm, lm, Ah, Lh, hk, ratio, tau, c, lam, Fa, La, neck, False, out)
                k = gain[i] * n * max(a, 1e-6) ** (n - 1) if a > 0 else gain[i]
                step = (de - C * out[0] - a) / (1 + C * k)
                a += step
                if abs(step) < 1e-10:
                    break
            de = a
            ra = (de - prev) / dt if dt > 0 and abs((de - prev) / dt) < 2 * abs(ra) + 1e-3 else ra
        _force(i, de, ra, gain[i], dt, st, n, poly, D, K2, db, rnd, rm, lm, Ah, Lh, hk, ratio, tau, c, lam, Fa, La, neck, True, out)
        N[i], Fe[i] = out[0], out[1]
    return N, Fe


@njit(cache=True)
def tangential_run(t, s1, s2, v1, v2, N, mu, p, N0, dmu, vs, an, cv, mode, L, w, drop, vr):
    m, ne = len(t), len(L)
    T1, T2 = np.zeros(m), np.zeros(m)
    z1, z2 = np.zeros(ne), np.zeros(ne)
    mean = 0.5 * (1.0 + drop) if mode == TOMLINSON else 1.0
    for i in range(m):
        if N[i] <= 0.0:
            z1[:] = 0.0
            z2[:] = 0.0
            continue
        v = np.sqrt(v1[i] ** 2 + v2[i] ** 2)
        a1, a2 = 0.0, 0.0
        if mode >= ROOT:
            g = 1.0 / np.sqrt(v * v + vr * vr) if mode == ROOT else np.tanh(v / vr) / max(v, 1e-12)
            a1, a2 = v1[i] * g, v2[i] * g
        elif i:
            d1, d2 = s1[i] - s1[i - 1], s2[i] - s2[i - 1]
            for j in range(ne):
                if mode == DAHL or mode == LUGRE:
                    q = 1.0 / (1.0 + np.sqrt(d1 * d1 + d2 * d2) / L[j])
                    y1, y2 = (z1[j] + d1 / L[j]) * q, (z2[j] + d2 / L[j]) * q
                elif mode == ELASTOPLASTIC:
                    r = np.sqrt(z1[j] ** 2 + z2[j] ** 2)
                    al = min(1.0, max(0.0, (r - 0.5) / 0.5))
                    if z1[j] * d1 + z2[j] * d2 < 0.0:
                        al = 0.0
                    q = 1.0 / (1.0 + al * np.sqrt(d1 * d1 + d2 * d2) / L[j])
                    y1, y2 = (z1[j] + d1 / L[j]) * q, (z2[j] + d2 / L[j]) * q
                    r = np.sqrt(y1 * y1 + y2 * y2)
                    if r > 1.0:
                        y1, y2 = y1 / r, y2 / r
                else:
                    y1, y2 = z1[j] + d1 / L[j], z2[j] + d2 / L[j]
                    r = np.sqrt(y1 * y1 + y2 * y2)
                    if r > 1.0:
                        q = 1.0 / r
                        if mode == TOMLINSON:             # slips back by 1 - drop as often as the step holds it
                            q = (1.0 - (r - 1.0) % (1.0 - drop)) / r
                        y1, y2 = y1 * q, y2 * q
                f = w[j] / mean
                a1 += f * y1
                a2 += f * y2
                if mode == LUGRE:
                    dt = max(t[i] - t[i - 1], 1e-6)
                    a1 += f * 4e-4 * (y1 - z1[j]) / dt
                    a2 += f * 4e-4 * (y2 - z2[j]) / dt
                z1[j], z2[j] = y1, y2
        f = mu * N[i]
        if p != 0.0:
            f *= (N[i] / N0) ** p
        if dmu != 0.0:
            f += dmu * N[i] * np.exp(-(v / vs) ** 2)
        T1[i] = -f * (1.0 + an) * a1 - cv * v1[i]
        T2[i] = -f * (1.0 - an) * a2 - cv * v2[i]
    return T1, T2


@njit(cache=True)
def lowpass(t, x, tau):
    """first-order low-pass, exact for inputs linear between samples; x (n, c)."""
    y = x.copy()
    for i in range(1, len(t)):
        dt = t[i] - t[i - 1]
        e = np.exp(-dt / tau)
        g = tau / dt * (1.0 - e)
        for c in range(x.shape[1]):
            y[i, c] = e * y[i - 1, c] + (1.0 - g) * x[i, c] + (g - e) * x[i - 1, c]
    return y


@njit(cache=True)
def tracking(dt, cmd, omega, zeta):
    """second-order tracking filter per joint: qdd = w^2 (cmd - q) - 2 z w qd (semi-implicit); returns q, qd."""
    m, nq = cmd.shape
    q, v = cmd.copy(), np.zeros_like(cmd)
    for j in range(nq):
        for i in range(1, m):
            a = omega[j] ** 2 * (cmd[i, j] - q[i - 1, j]) - 2 * zeta[j] * omega[j] * v[i - 1, j]
            v[i, j] = v[i - 1, j] + dt * a
            q[i, j] = q[i - 1, j] + dt * v[i, j]
    return q, v


@njit(cache=True)
def deflection(dt, depth0, slip0, J, axes, omega, zeta, kj, k, n, c, mu, L):
    """joint deflections under the contact force: each joint a spring kj behind its filter. J (m,3,nq) tip Jacobian in the base frame,
    axes rows: tangent 1, tangent 2, normal. A plain law (k d^n + c d', Dahl friction) stands in for the material here."""
    m, nq = len(depth0), J.shape[2]
    x, v = np.zeros((m, nq)), np.zeros(nq)
    z = np.zeros(2)
    last = np.zeros(3)
    for i in range(1, m):
        tip = np.zeros(3)
        for a in range(3):
            s = 0.0
            for b in range(3):
                for j in range(nq):
                    s += axes[a, b] * J[i, b, j] * x[i - 1, j]
            tip[a] = s
        now = np.array([slip0[i, 0] + tip[0], slip0[i, 1] + tip[1], depth0[i] - tip[2]])
        F = np.zeros(3)
        if now[2] > 0.0:
            rate = (now[2] - last[2]) / dt
            F[2] = max(0.0, k * now[2] ** n + c * rate)
            d1, d2 = now[0] - last[0], now[1] - last[1]
            q = 1.0 / (1.0 + np.sqrt(d1 * d1 + d2 * d2) / L)
            z[0], z[1] = (z[0] + d1 / L) * q, (z[1] + d2 / L) * q
            F[0], F[1] = -mu * F[2] * z[0], -mu * F[2] * z[1]
        else:
            z[:] = 0.0
        last = now
        for j in range(nq):
            tq = 0.0
            for b in range(3):
                tq += J[i, b, j] * (axes[0, b] * F[0] + axes[1, b] * F[1] + axes[2, b] * F[2])
            a = omega[j] ** 2 * (tq / kj[j] - x[i - 1, j]) - 2 * zeta[j] * omega[j] * v[j]
            v[j] += dt * a
            x[i, j] = x[i - 1, j] + dt * v[j]
    return x


# ---- dictionaries in, arrays out
NORMAL = dict(k=0.0, n=1.0, poly=(0.0,), D=0.0, K2=0.0, db=1.0, rnd=0.0, rm=0.0, lm=1e-3, Ah=(), Lh=(), hk=0, ratio=(), tau=(), c=0.0,
              lam=0.0, Fa=0.0, La=1e-3, neck=0.0, C=0.0)
TANGENTIAL = dict(mu=0.0, p=0.0, N0=1.0, dmu=0.0, vs=1e-2, an=0.0, cv=0.0, mode=DAHL, L=(1e-4,), w=(1.0,), drop=0.5, vr=1e-3)


def _vec(x):
    return np.atleast_1d(np.asarray(x, float))


def normal(p, t, depth, rate, gain):
    """N and Fe; gain: the stiffness over time and place (k included)."""
    g = {**NORMAL, **{a: b for a, b in p.items() if a in NORMAL}}
    v = lambda a: _vec(g[a]) if np.size(g[a]) else np.zeros(0)
    keep = lambda a, ref: v(a)[np.flatnonzero(v(ref) != 0)] if len(v(a)) == len(v(ref)) else v(a)
    return normal_run(t, depth, rate, gain, float(g["n"]), _vec(g["poly"]), float(g["D"]), float(g["K2"]), float(g["db"]), float(g["rnd"]),
                      float(g["rm"]), float(g["lm"]), keep("Ah", "Ah"), keep("Lh", "Ah"), int(g["hk"]), keep("ratio", "ratio"),
                      keep("tau", "ratio"), float(g["c"]), float(g["lam"]), float(g["Fa"]), float(g["La"]), float(g["neck"]), float(g["C"]))


def tangential(p, t, s1, s2, v1, v2, N):
    g = {**TANGENTIAL, **{a: b for a, b in p.items() if a in TANGENTIAL}}
    return tangential_run(t, s1, s2, v1, v2, N, float(g["mu"]), float(g["p"]), float(g["N0"]), float(g["dmu"]), float(g["vs"]),
                          float(g["an"]), float(g["cv"]), int(g["mode"]), _vec(g["L"]), _vec(g["w"]), float(g["drop"]), float(g["vr"]))
