"""Materials from the finite-element tables: elastic shape, structural relaxation, and the truth's parameters of the laws."""
import os

import numpy as np

import laws

HERE = os.path.dirname(os.path.abspath(__file__))
_T = None


def tables():
    global _T
    if _T is None:
        with np.load(os.path.join(HERE, "tables.npz")) as z:
            _T = {k.replace("__", "/"): z[k] for k in z.files}
    return _T


def departure(key):
    """the curve's best power law (weighted by force) and, over depth / deepest, the smoothed log ratio to it: (n, polynomial, scale)."""
    d, f = tables()[key]
    x = d / d[-1]
    w = f / f[-1]
    A = np.stack([np.ones_like(x), np.log(x)], 1)
    c = np.linalg.lstsq(A * w[:, None], np.log(f) * w, rcond=None)[0]
    e = np.log(f) - A @ c
    P = np.vander(x, 4, increasing=True)
    poly = np.linalg.lstsq(P * w[:, None] ** 0.5, e * w ** 0.5, rcond=None)[0]
    return c[1], poly, d[-1], np.sqrt(np.mean((w * (P @ poly)) ** 2) / np.mean(w ** 2))


def elastic(rng, n, size):
    """a table near the exponent n; its departure from the power scaled so that `size` (of the force's rms) is left."""
    keys = [k for k in tables() if not k.startswith("punch")]
    data = [(k,) + departure(k) for k in keys]
    data.sort(key=lambda z: abs(z[1] - n) + 0.05 * rng.random())
    key, nt, poly, dmax, left = data[int(rng.integers(min(4, len(data))))]
    beta = float(min(1.0, size / max(left, 1e-5)))
    return dict(table=key, table_n=float(nt), beta=beta, poly=poly * beta, left=float(left * beta))


def structural_prony(nu0, h, g, taus):
    """a bonded layer under a flat punch relaxes less than its shear modulus, for the bulk does not: ratios of k(t) by the
    correspondence principle on the punch table (G(t) = 1 + sum g e^-t/tau, K fixed); least squares on the same times."""
    nus, k = tables()[f"punch/h{h}"]
    t = np.geomspace(min(taus) / 20, max(taus) * 8, 200)
    G = 1 + sum(a * np.exp(-t / b) for a, b in zip(g, taus))
    K = 2 * (1 + nu0) / (3 * (1 - 2 * nu0))
    nu = (3 * K - 2 * G) / (2 * (3 * K + G))
    kt = G * np.interp(nu, nus, k)
    k0 = np.interp(nu0, nus, k)
    A = np.stack([np.exp(-t / b) for b in taus], 1)
    return np.maximum(np.linalg.lstsq(A, kt / k0 - 1, rcond=None)[0], 0.0)


def branches(rng, ratio, tau, spread):
    """two relaxation times about tau; spread 0: one."""
    if spread <= 0:
        return dict(ratio=[ratio], tau=[tau])
    s = float(np.exp(spread))
    taus = [tau / s, tau * s]
    part = structural_prony(float(rng.choice([0.47, 0.49, 0.495])), rng.choice([0.6, 1.2, 2.5]), [0.5 * ratio, 0.5 * ratio], taus)
    part = part * ratio / max(part.sum(), 1e-9)
    return dict(ratio=list(part), tau=taus)


FRICTION = {"dahl": laws.DAHL, "brush": laws.BRUSH, "prandtl-tomlinson": laws.TOMLINSON, "elasto-plastic": laws.ELASTOPLASTIC, "lugre": laws.LUGRE}


def friction(rng, kind, length):
    """bristles of a finite patch with this mean length."""
    mode = FRICTION[kind]
    if mode in (laws.BRUSH, laws.TOMLINSON):
        m = 12
        x = (np.arange(m) + 0.5) / m
        L = 0.35 + 1.3 * x if mode == laws.BRUSH else rng.permutation(0.5 + x)
        w = (1 - (2 * x - 1) ** 2) if mode == laws.BRUSH else np.ones(m)
        w = w / w.sum()
        L = length * L / (w * L).sum()
        return dict(mode=mode, L=L, w=w, drop=float(rng.uniform(0.8, 0.93)))
    return dict(mode=mode, L=[length], w=[1.0])


def hysteresis(amplitude, length, rich):
    if not rich:
        return dict(Ah=[amplitude], Lh=[length], hk=0)
    w = np.array([0.3, 0.4, 0.3])
    L = np.array([0.4, 1.0, 1.9])
    return dict(Ah=list(amplitude * w), Lh=list(length * L / (w * L).sum()), hk=1)
