"""The refit for joint torques: linear least squares per joint with scans over what is not linear; one drive is a one-joint arm with unknown inertia."""
import os
import tomllib
import numpy as np
import pyarrow.parquet as pq
from scipy.signal import butter, sosfiltfilt
from scipy.optimize import lsq_linear
from numba import njit
import arms
from refit import bristle

FC = 6.0


@njit(cache=True)
def rnea_all(Q, V, A, R0, p0, ax, m, c, I, grav):
    N, n = Q.shape
    H = np.zeros((N, n)); M = np.zeros((n, n)); R = np.zeros((n, 3, 3)); p = np.zeros((n, 3)); z = np.zeros((n, 3)); tmp = np.zeros((10, max(n, 4), 3))
    for i in range(N):
        arms.dyn(Q[i], V[i], A[i], R0, p0, ax, m, c, I, grav, M, H[i], False, R, p, z, tmp)
    return H


class JD:
    pass


def read_dir(d, arm=None):
    tab = pq.read_table(os.path.join(d, "log.parquet"))
    L = {c: tab[c].to_numpy(zero_copy_only=False) for c in tab.column_names}
    rig = tomllib.load(open(os.path.join(d, "rig.toml"), "rb"))
    n = arm.n if arm else 1
    t = L["t"].astype(float)
    dt = np.median(np.diff(t)); tg = np.arange(t[0], t[-1], dt); fs = 1 / dt
    ip = lambda x: np.interp(tg, t, x)
    Q = np.stack([ip(L[f"q{i+1}"]) for i in range(n)], 1); T = np.stack([ip(L[f"tau{i+1}"]) for i in range(n)], 1)
    D = JD()
    D.lp = (lambda x: sosfiltfilt(butter(2, 2 * FC / fs, output="sos"), x, axis=0)) if fs > 3 * FC else (lambda x: x)
    q = sosfiltfilt(butter(2, min(.8, 2 * 15 / fs), output="sos"), Q, axis=0)
    v = np.gradient(q, dt, axis=0); a = np.gradient(v, dt, axis=0)
    D.t, D.q, D.v, D.a, D.n = tg, q, v, a, n
    D.T = T; D.arm = arm; D.dt = dt
    D.dec = max(1, int(fs / 25))
    D.cut = slice(int(.3 * fs), -int(.3 * fs), D.dec)
    D.Y = D.lp(T)[D.cut]
    if arm:
        D.g = np.array(rig["robot"].get("gravity", [0, 0, -9.81]))
        md = (arm.R0, arm.p0, arm.ax)
        D.ri = lambda g, m=arm.m_rig, c=arm.c_rig, I=arm.I_rig, acc=True: rnea_all(q, v if acc else v * 0, a if acc else a * 0, *md, m, c, I, g)
        D.rb = D.ri(D.g)
    else:
        D.rb = np.zeros_like(q)
    set_bristle(D, 1e-3)
    return D


def set_bristle(D, l):
    D.u = np.stack([bristle(np.ascontiguousarray(D.q[:, j]), np.zeros(len(D.q)), np.ones(len(D.q)), l)[:, 0] for j in range(D.n)], 1)


def tune_bristle(D, names):
    """the bristle length of the true model is unknown to the refit: the best of five, one for all joints"""
    e = []
    for l in (1e-4, 2e-4, 4e-4, 7e-4, 1e-3):
        set_bristle(D, l); e.append((fit(D, names)[0], l))
    set_bristle(D, min(e)[1])


def cols(D, e, j, par=None):
    """regressors of effect e on joint j"""
    u, v, a, q, rb = D.u[:, j], D.v[:, j], D.a[:, j], D.q[:, j], D.rb[:, j]
    o = np.ones_like(u)
    return {"joint-coulomb-friction": lambda: [u], "joint-viscous-friction": lambda: [v], "joint-friction-asymmetry": lambda: [abs(v), abs(u)],
            "joint-torque-offset": lambda: [o], "rotor-inertia": lambda: [a], "joint-torque-gain": lambda: [rb],
            "joint-load-friction": lambda: [abs(rb) * u], "joint-spring": lambda: [q, o],
            "joint-stribeck-friction": lambda: [u * np.exp(-(v / par) ** 2)],
            "joint-torque-ripple": lambda: [np.sin(par * q), np.cos(par * q), np.sin(2 * par * q), np.cos(2 * par * q)]}[e]()


SCAN = {"joint-stribeck-friction": np.geomspace(.01, 1.0, 10), "joint-torque-ripple": np.r_[1:21, 24:61:2, 70:170:10].astype(float)}
CAND = {"J": ["joint-coulomb-friction", "joint-viscous-friction", "joint-friction-asymmetry", "joint-torque-offset", "rotor-inertia", "joint-torque-gain", "payload",
              "gravity-error", "joint-stribeck-friction", "joint-load-friction", "joint-torque-ripple", "joint-spring"],
        "D": ["joint-coulomb-friction", "joint-viscous-friction", "joint-friction-asymmetry", "joint-torque-offset", "joint-stribeck-friction", "joint-torque-ripple", "joint-spring"]}


def shared(D, names):
    """columns for all joints at once: payload, gravity"""
    out = []
    if "payload" in names and D.arm:
        n = D.n
        for k in range(4):
            m = np.zeros(n); c = np.zeros((n, 3)); I = np.zeros((n, 3, 3))
            m[-1] = 1e-3 if k else 1.0
            if k:
                c[-1, k - 1] = 1e3 * 1.0
                # a first moment alone: linear part = (with +c) - (with -c) over two
                h1 = D.ri(D.g, m, c, I); h2 = D.ri(D.g, m, -c, I)
                out.append((h1 - h2) / 2)
            else:
                out.append(D.ri(D.g, m, c, I))
    if "gravity-error" in names and D.arm:
        for k in range(3):
            out.append(D.ri(np.eye(3)[k], acc=False))
    return out


def fit(D, names):
    names = [x for x in names if x not in ("rigid-body", "none")]
    sc = [x for x in names if x in SCAN]
    lin = [x for x in names if x not in SCAN and x not in ("payload", "gravity-error")]
    sh = [D.lp(x)[D.cut] for x in shared(D, names)]
    # per joint scan values found greedily on the joint's own residual (without the shared columns), then one joint solve
    cols_j = []
    for j in range(D.n):
        C = [] if D.arm else [D.a[:, j]]
        for e in lin:
            C += cols(D, e, j)
        C = [D.lp(c)[D.cut] for c in C] + [s[:, j] for s in sh]
        y = D.Y[:, j] - D.lp(D.rb[:, j])[D.cut]
        for e in sc:
            best = None
            Qo = np.linalg.qr(np.stack(C, 1))[0] if C else np.zeros((len(y), 0))
            y0 = y - Qo @ (Qo.T @ y)
            grid = SCAN[e]
            for rnd in range(2):
                for p in grid:
                    X = np.stack([c[D.cut] for c in cols(D, e, j, p)], 1)
                    X = X - Qo @ (Qo.T @ X)
                    r = y0 - X @ np.linalg.lstsq(X, y0, rcond=1e-9)[0]
                    if best is None or r @ r < best[0]:
                        best = (r @ r, None, p)
                if e != "joint-torque-ripple":
                    break
                grid = np.linspace(best[2] - 1, best[2] + 1, 21)
            best = (best[0], [D.lp(c)[D.cut] for c in cols(D, e, j, best[2])], best[2])
            C = C[:len(C) - len(sh)] + best[1] + C[len(C) - len(sh):] if sh else C + best[1]
        cols_j.append((C[:len(C) - len(sh)], y))
    N = len(D.Y)
    nl = [len(c) for c, _ in cols_j]
    tot = sum(nl) + len(sh)
    A = np.zeros((N * D.n, tot)); b = np.zeros(N * D.n)
    o = 0
    for j, (C, y) in enumerate(cols_j):
        for i, c in enumerate(C):
            A[j * N:(j + 1) * N, o + i] = c
        o += nl[j]
        for i, s in enumerate(sh):
            A[j * N:(j + 1) * N, sum(nl) + i] = s[:, j]
        b[j * N:(j + 1) * N] = y
    if tot == 0:
        return float(np.sqrt(np.mean(b ** 2))), None
    s = np.sqrt((A ** 2).mean(0)) + 1e-12
    th = np.linalg.lstsq(A / s, b, rcond=1e-9)[0]
    r = b - A / s @ th
    return float(np.sqrt(np.mean(r ** 2))), th / s
