"""The catalogue's plain forms, driven by measured motion: contact laws and friction as one numba kernel, and the names of what each effect frees.
This is the ruler with which the truth's numbers are measured; it shares no code with the engine (contact.py, arm.py)."""
from __future__ import annotations

import numpy as np
from numba import njit

P_NAMES = "k n c lam r tau r2 tau2 ha hl mr ml fa al lk ld z0 C alpha mu cv dmu vs bl vr p ani n0".split()
PX = {k: i for i, k in enumerate(P_NAMES)}
(K, N_, C_, LAM, R_, TAU, R2, TAU2, HA, HL, MR, ML, FA, AL, LK, LD, Z0, CS, ALPHA, MU, CV, DMU, VS, BL, VR, PP, ANI, N0) = range(len(P_NAMES))
PLAIN = dict(n=1.0, tau=1.0, tau2=1.0, hl=1e-3, ml=1e-3, al=1e-3, ld=1.0, vs=0.01, bl=1e-4, vr=0.0, n0=5.0)


@njit(cache=True)
def law(t, d, dd, s1, s2, v1, v2, Fm, dFm, prof, p):
    n = t.shape[0]
    out = np.zeros((n, 3))
    h = h2 = fe0 = 0.0
    zh = 0.0
    xp = 0.0
    dmax = 0.0
    touched = False
    z1 = z2 = 0.0
    a1, a2 = s1[0], s2[0]
    tp = t[0]
    for i in range(n):
        dt = t[i] - tp
        tp = t[i]
        x = d[i] + p[Z0] - p[CS] * Fm[i]
        xr = dd[i] - p[CS] * dFm[i]
        fe = 0.0
        if x > 0.0:
            fe = p[K] * x ** p[N_] * (1.0 + p[ALPHA] * t[i] / 60.0) * (1.0 + prof[i])
        if x > dmax:
            dmax = x
        if p[MR] != 0.0:
            fe *= 1.0 - p[MR] * (1.0 - np.exp(-(dmax - max(x, 0.0)) / p[ML]))
        F = fe
        if p[R_] != 0.0 or p[R2] != 0.0:
            h = h * np.exp(-dt / p[TAU]) + (fe - fe0) * np.exp(-0.5 * dt / p[TAU])
            h2 = h2 * np.exp(-dt / p[TAU2]) + (fe - fe0) * np.exp(-0.5 * dt / p[TAU2])
            F = (1.0 - p[R_] - p[R2]) * fe + p[R_] * h + p[R2] * h2
        fe0 = fe
        if x > 0.0:
            F = F * (1.0 + p[LAM] * xr) + p[C_] * xr
            if x > p[LD]:
                F += p[LK] * (x - p[LD])
            if p[HA] != 0.0:
                dx = x - max(xp, 0.0)
                sg = 1.0 if dx > 0 else -1.0
                zh = sg + (zh - sg) * np.exp(-abs(dx) / p[HL])
                F += p[HA] * zh
        else:
            zh = 0.0
        xp = x
        if F < 0.0:
            F = 0.0
        Nn = F
        if p[FA] != 0.0:
            if x > 0:
                touched = True
                F -= p[FA]
            elif touched:
                if x > -p[AL]:
                    F -= p[FA] * (1.0 + x / p[AL])
                else:
                    touched = False
        out[i, 0] = F
        e1, e2 = s1[i] - a1, s2[i] - a2
        a1, a2 = s1[i], s2[i]
        if x > 0.0:
            v = np.sqrt(v1[i] * v1[i] + v2[i] * v2[i])
            mu = p[MU]
            if p[DMU] != 0.0:
                mu += p[DMU] * np.exp(-(v / p[VS]) ** 2)
            if p[PP] != 0.0 and Nn > 0.0:
                mu *= (Nn / p[N0]) ** p[PP]
            if p[VR] > 0.0:
                r = np.sqrt(v * v + p[VR] * p[VR])
                y1, y2 = v1[i] / r, v2[i] / r
            else:
                e = np.sqrt(e1 * e1 + e2 * e2)
                if e > 1e-12:
                    g = np.exp(-e / p[BL])
                    z1 = e1 / e + (z1 - e1 / e) * g
                    z2 = e2 / e + (z2 - e2 / e) * g
                y1, y2 = z1, z2
            out[i, 1] = -mu * (1.0 + p[ANI]) * Nn * y1 - p[CV] * v1[i]
            out[i, 2] = -mu * (1.0 - p[ANI]) * Nn * y2 - p[CV] * v2[i]
        else:
            z1 = z2 = 0.0
    return out


@njit(cache=True)
def lowpass(t, Y, tau):
    """First order, exact for inputs that are straight between samples."""
    out = Y.copy()
    for i in range(1, t.shape[0]):
        dt = t[i] - t[i - 1]
        e = np.exp(-dt / tau)
        b = tau / dt * (1 - e)
        for c in range(Y.shape[1]):
            out[i, c] = e * out[i - 1, c] + (b - e) * Y[i - 1, c] + (1 - b) * Y[i, c]
    return out


# what an effect frees: name, (scale of a sensible value), lower, upper, starts; 'log' parameters move on a log scale
def L(scale, lo, hi, *starts):
    return ("log", scale, lo, hi, starts or (scale,))


def S(scale, lo, hi, *starts):
    return ("lin", scale, lo, hi, starts or (0.0,))


FREES = {
    "hooke": {"k": L(1, 1e-9, 1e12)}, "kelvin-voigt": {"k": L(1, 1e-9, 1e12), "c": S(20, 0, 1e4, 5.0)},
    "hertz": {"k": L(1, 1e-9, 1e12)}, "hunt-crossley": {"k": L(1, 1e-9, 1e12), "lam": S(1, 0, 500, 0.5)},
    "zener": {"k": L(1, 1e-9, 1e12), "r": S(0.1, -0.2, 1, 0.2), "tau": L(1, 0.01, 60, 0.3, 3.0)},
    "maxwell": {"k": L(1, 1e-9, 1e12), "tau": L(1, 0.01, 600, 1.0)},
    "hertz-exponent": {"n": S(0.1, 0.5, 3)}, "viscous-damping": {"c": S(20, 0, 1e4, 2.0)}, "hunt-crossley-damping": {"lam": S(1, 0, 500, 0.2)},
    "relaxation": {"r": S(0.1, -0.1, 1, 0.1), "tau": L(1, 0.005, 60, 0.1, 0.6, 4.0)}, "hysteresis": {"ha": S(0.3, 0, 50, 0.1), "hl": L(1e-3, 3e-5, 1e-2, 3e-4)},
    "stress-softening": {"mr": S(0.1, 0, 0.95, 0.1), "ml": L(1e-3, 5e-5, 2e-2, 5e-4)}, "adhesion": {"fa": S(0.2, 0, 20, 0.1), "al": L(1e-3, 5e-5, 5e-3, 6e-4)},
    "stiffening-layer": {"lk": S(200, 0, 1e6, 50.0), "ld": L(1e-3, 1e-4, 2e-2)}, "surface-offset": {"z0": S(1e-4, -5e-3, 5e-3)},
    "stiffness-drift": {"alpha": S(0.1, -3, 3)}, "stiffness-inhomogeneity": {}, "structural-compliance": {"C": S(1e-5, 0, 1e-2, 1e-5)},
    "coulomb-friction": {"mu": S(0.1, 0, 3, 0.1)}, "viscous-friction": {"cv": S(5, 0, 1e3, 1.0)},
    "stribeck-friction": {"dmu": S(0.1, -1, 2, 0.03), "vs": L(0.01, 1e-3, 0.2, 4e-3, 0.02)}, "presliding": {"bl": L(3e-4, 1e-5, 2e-2)},
    "friction-rounding": {"vr": L(5e-3, 1e-4, 0.3, 5e-3)}, "load-dependent-friction": {"p": S(0.1, -2, 2)}, "friction-anisotropy": {"ani": S(0.1, -1, 1)},
}
NORMAL = ("hertz-exponent viscous-damping hunt-crossley-damping relaxation hysteresis stress-softening adhesion stiffening-layer surface-offset "
          "stiffness-drift stiffness-inhomogeneity").split()
TANGENTIAL = "coulomb-friction viscous-friction stribeck-friction presliding friction-rounding load-dependent-friction friction-anisotropy".split()
TOOL = "tool-mass tool-com tool-inertia structural-compliance tip-offset".split()
SENSOR = "sensor-bias sensor-drift sensor-crosstalk sensor-misalignment sensor-gain sensor-lag time-offset saturation quantization mains-hum".split()
JOINT = ("joint-coulomb-friction joint-viscous-friction joint-friction-asymmetry joint-torque-offset rotor-inertia joint-torque-gain payload joint-elasticity "
         "gravity-error joint-stribeck-friction joint-load-friction joint-torque-ripple joint-spring").split()
BASES = {"hooke": 1.0, "kelvin-voigt": 1.0, "zener": 1.0, "maxwell": 1.0, "hertz": 1.5, "hunt-crossley": 1.5}
