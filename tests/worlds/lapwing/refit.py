"""Own least-squares check of every case, from the written files: sizes of what is hidden, and what imitates it."""
import os, tomllib
import numpy as np
from numba import njit
from scipy.optimize import least_squares
from scipy.signal import savgol_filter, lfilter
import engine as E, robots

CH = ("fx", "fy", "fz", "tx", "ty", "tz")
LW = 0.1          # lever that weighs torques against forces

def read(case):
    f = os.path.join(case, "log.parquet")
    if os.path.exists(f):
        import pyarrow.parquet as pq
        tb = pq.read_table(f)
        log = {c: np.asarray(tb[c].to_pylist() if c == "phase" else tb[c].to_numpy()) for c in tb.column_names}
    else:
        import csv
        rows = list(csv.reader(open(os.path.join(case, "log.csv"))))
        log = {c: np.array([r[i] if c == "phase" else float(r[i]) for r in rows[1:]]) for i, c in enumerate(rows[0])}
    return log, tomllib.load(open(os.path.join(case, "rig.toml"), "rb"))

@njit(cache=True)
def law(t, d, v, s1, s2, v1, v2, g, p):
    n = len(t)
    out = np.zeros((n, 3))
    k, ex, c, lam, r1, tau1, r2, tau2, hA, hl, sr, sl, Fa, al, LK, db, dr, mu, zl, ct, dmu, vs, lp, an, vr, c2 = p
    b1, b2, hz, dm, z1, z2, stuck, eo = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for i in range(n):
        h = t[i] - t[i - 1] if i > 0 else 1e-3
        x = d[i]
        F = 0.0
        xe = max(x, 0.0)
        e = k * xe ** ex
        if sr > 0:
            if xe > dm:
                dm = xe
            e *= 1 - sr * (1 - np.exp(-(dm - xe) / sl))
        e1, e2 = np.exp(-h / tau1), np.exp(-h / tau2)
        if x > 0:
            b1 = b1 * e1 + r1 * (e - eo) * tau1 / h * (1 - e1)
            b2 = b2 * e2 + r2 * (e - eo) * tau2 / h * (1 - e2)
            F = e * (1 + lam * v[i]) + c * v[i] + b1 + b2
            if hA > 0:
                dx = x - max(d[i - 1], 0.0) if i > 0 else 0.0
                hz = (hz + dx / hl) / (1 + abs(dx) / hl)
                F += hA * hz
            F += LK * max(x - db, 0.0)
        else:
            b1 *= e1; b2 *= e2; hz = 0.0
        eo = e
        F *= g[i] * (1 + dr * t[i] / 60)
        if Fa > 0:
            if x > 0:
                stuck = max(stuck, 1 - np.exp(-x / c2))
                F -= Fa * stuck
            elif stuck > 0:
                F -= Fa * stuck * np.exp(x / al)
                if x < -3.5 * al:
                    stuck = 0.0
        elif F < 0:
            F = 0.0
        N = max(F, 0.0)
        sp = np.sqrt(v1[i] ** 2 + v2[i] ** 2)
        m = mu + dmu * np.exp(-(sp / vs) ** 2)
        if lp != 0 and N > 0:
            m *= (N / 5.0) ** lp
        if vr > 0:
            f1, f2 = -m * N * v1[i] / np.sqrt(sp * sp + vr * vr), -m * N * v2[i] / np.sqrt(sp * sp + vr * vr)
        else:
            if N > 0:
                a1, a2 = (s1[i] - s1[i - 1], s2[i] - s2[i - 1]) if i > 0 else (0.0, 0.0)
                q = 1 / (1 + np.sqrt(a1 * a1 + a2 * a2) / zl)
                z1, z2 = q * (z1 + a1 / zl), q * (z2 + a2 / zl)
            else:
                z1, z2 = 0.0, 0.0
            f1, f2 = -m * N * z1, -m * N * z2
        if N > 0:
            f1 -= ct * v1[i]; f2 -= ct * v2[i]
        out[i, 0], out[i, 1], out[i, 2] = F, f1 * (1 + an), f2 * (1 - an)
    return out

LAWP = ("k", "ex", "c", "lam", "r1", "tau1", "r2", "tau2", "hA", "hl", "sr", "sl", "Fa", "al", "LK", "db", "dr", "mu", "zl", "ct", "dmu", "vs", "lp", "an", "vr", "c2")
DEF = dict(ex=1.0, c=0, lam=0, r1=0, tau1=1, r2=0, tau2=1, hA=0, hl=1e-3, sr=0, sl=1e-3, Fa=0, al=1e-3, LK=0, db=0, dr=0, mu=0, zl=1e-4, ct=0, dmu=0, vs=1, lp=0, an=0, vr=0, c2=1e-4)
# effect -> list of starts; each: (parameter, start, scale, low, high); k0/F0/D0 are filled from the data
I = np.inf
EFF = {
    "hooke": [[]], "kelvin-voigt": [[("c", 1, 1, -I, I)]], "hertz": [[]], "none": [[]],
    "hunt-crossley": [[("ex", 1.4, .1, .4, 3.5), ("lam", .5, .5, -50, 500)]],
    "zener": [[("r1", .3, .3, 0, 50), ("tau1", .5, .5, 1e-3, 100)]],
    "hertz-exponent": [[("ex", 1.2, .1, .4, 3.5)]], "viscous-damping": [[("c", 1, 1, -I, I)]], "hunt-crossley-damping": [[("lam", .5, .5, -50, 500)]],
    "relaxation": [[("r1", .3, .3, 0, 50), ("tau1", t, t, 1e-3, 300)] for t in (.05, .4, 4)],
    "hysteresis": [[("hA", .1, .1, 0, I), ("hl", l, l, 1e-5, .05)] for l in (2e-4, 1.5e-3)],
    "stress-softening": [[("sr", .2, .2, 0, .95), ("sl", 1e-3, 1e-3, 1e-5, .05)]],
    "adhesion": [[("Fa", .2, .2, 0, I), ("al", 5e-4, 5e-4, 2e-5, .02), ("c2", 1e-4, 1e-4, 1e-5, .01)]],
    "stiffening-layer": [[("LK", 50, 50, -I, I), ("db", q, 5e-4, 0, .05)] for q in ("q3", "q7")],
    "surface-offset": [[("z0", 1e-4, 1e-4, -.02, .02)]], "stiffness-drift": [[("dr", .01, .01, -10, 10)]],
    "stiffness-inhomogeneity": [[(f"g{i}", 0, .1, -3, 3) for i in range(9)]],
    "coulomb-friction": [[("mu", .2, .2, 0, 5)]], "viscous-friction": [[("ct", 1, 1, -I, I)]],
    "stribeck-friction": [[("dmu", .05, .05, -3, 3), ("vs", v, v, 1e-4, 3)] for v in (.005, .05)],
    "presliding": [[("zl", 4e-4, 3e-4, 1e-6, .05)]], "friction-rounding": [[("vr", .003, .003, 1e-6, 1)]],
    "load-dependent-friction": [[("lp", -.05, .1, -.9, 3)]], "friction-anisotropy": [[("an", .02, .1, -1, 1)]],
    "tool-mass": [[("dm", 0, .02, -5, 5)]], "tool-com": [[(f"dc{i}", 0, .003, -.5, .5) for i in range(3)]],
    "tool-inertia": [[(f"I{i}", 0, 1e-3, -1, 1) for i in range(6)]], "structural-compliance": [[("cs", 1e-5, 1e-5, 0, .005)]],
    "tip-offset": [[(f"o{i}", 0, 1e-3, -.05, .05) for i in range(3)]],
    "sensor-bias": [[(f"b{i}", 0, .1, -I, I) for i in range(6)]], "sensor-drift": [[(f"dr{i}", 0, .1, -I, I) for i in range(6)]],
    "sensor-crosstalk": [[(f"x{a}{b}", 0, .02, -1, 1) for a in range(3) for b in range(3) if a != b]], "sensor-misalignment": [[(f"w{i}", 0, .02, -1, 1) for i in range(3)]],
    "sensor-gain": [[("gain", 0, .05, -.9, 3)]], "sensor-lag": [[("lag", .005, .01, 0, 1)]], "time-offset": [[("del", s, .01, -.4, .4)] for s in (.003, -.003)],
    "saturation": [[("sat", "s9", .5, .1, I)]],
}
CONTACT = [e for e in EFF if e not in ("hooke", "kelvin-voigt", "hertz", "hunt-crossley", "zener", "none")]
TOOL = ["tool-mass", "tool-com", "tool-inertia", "sensor-bias", "sensor-drift", "sensor-crosstalk", "sensor-misalignment", "sensor-gain", "sensor-lag", "time-offset", "saturation"]

class Wrench:
    """A contact or free-motion log of an arm, or a tester's log."""
    def __init__(s, case, nmax=5000):
        log, rig = read(case)
        s.tester = "depth" in log
        t = log["t"]
        dt = np.median(np.diff(t))
        tu = np.arange(t[0], t[-1], dt)
        w = max(5, int((0.024 if s.tester or "surface" in rig else 0.06) / dt) | 1)      # free motion: accelerations from encoders
        sm = lambda y, k=0: savgol_filter(np.interp(tu, t, y), w, 3, deriv=k, delta=dt)
        dec = max(1, int(np.ceil(len(tu) / nmax)))
        cut = slice(w, len(tu) - w, dec)
        s.t, s.dt = tu[cut], dt * dec
        n = len(s.t)
        s.con = True
        if s.tester:
            s.d, s.v = sm(log["depth"])[cut], sm(log["depth"], 1)[cut]
            z = np.zeros(n)
            s.s = np.column_stack([sm(log["slip1"])[cut] if "slip1" in log else z, z])
            s.sv = np.column_stack([sm(log["slip1"], 1)[cut] if "slip1" in log else z, z])
            cols = ["normal_force"] + (["tangential_force1"] if "tangential_force1" in log else [])
            s.Y = np.column_stack([sm(log[c])[cut] for c in cols])
            s.F = s.Y
            s.fn = s.Y[:, 0]
        else:
            ro = rig["robot"]
            arm = robots.load(ro["model"], ro["sensor_frame"], ro["tip_frame"], ro["gravity"], ro.get("joints"), case)
            Q, DQ, DDQ = (np.ascontiguousarray(np.column_stack([sm(log[f"q{i+1}"], k)[cut] for i in range(arm.n)])) for k in (0, 1, 2))
            R, p, wv, al, a = E.motion(arm.chain, Q, DQ, DDQ)
            s.Y = np.column_stack([sm(log[c])[cut] for c in CH])
            m, com = rig["tool"]["mass"], np.array(rig["tool"]["com"])
            s.m, s.com = m, com
            Rs = R @ arm.Rs
            rc = R @ (arm.ps + arm.Rs @ com)
            ac = a + np.cross(al, rc) + np.cross(wv, np.cross(wv, rc))
            tos = lambda x: np.einsum("nji,nj->ni", Rs, x)
            s.sf, s.ws, s.als = tos(arm.g - ac), tos(wv), tos(al)
            s.W0 = np.hstack([m * s.sf, np.cross(com, m * s.sf)])
            s.con = "surface" in rig
            if s.con:
                su = rig["surface"]
                s.n, t1 = np.array(su["normal"], float), np.array(su["tangent"], float)
                t2 = np.cross(s.n, t1)
                s.T = np.vstack([s.n, t1, t2])
                x = p + R @ arm.pt - np.array(su["point"])
                s.rt = arm.Rs.T @ (arm.pt - arm.ps)
                s.Rst = arm.Rs.T @ arm.Rt
                s.Rtip_n = np.einsum("nij,i->nj", R @ arm.Rt, s.n)
                s.d = -x @ s.n
                s.s = np.column_stack([x @ t1, x @ t2])
                s.v, s.sv = np.gradient(s.d, s.dt), np.gradient(s.s, s.dt, axis=0)
                s.TtoS = np.einsum("nji,kj->nik", Rs, s.T)          # contact axes -> sensor
                s.F = np.einsum("nik,ni->nk", s.TtoS, (s.Y - s.W0)[:, :3])
                s.fn = s.F[:, 0]
        s.wt = np.array([1, 1, 1, 1 / LW, 1 / LW, 1 / LW]) if not s.tester else np.ones(s.Y.shape[1])
        if s.con:
            c = (s.d > 0) | (np.abs(s.fn) > 0.05 * np.abs(s.fn).max())
            s.use = c | np.roll(c, 50) | np.roll(c, -50)
            s.read_rms = float(np.sqrt(np.mean(s.F[c] ** 2)))
            s.cmask = c
            x = (s.s[c] - s.s[c].min(0)) / np.maximum(np.ptp(s.s[c], axis=0), 1e-3)
            X = np.clip((s.s - s.s[c].min(0)) / np.maximum(np.ptp(s.s[c], axis=0), 1e-3), 0, 1)
            s.G = np.column_stack([np.cos(np.pi * (i * X[:, 0])) * np.cos(np.pi * j * X[:, 1]) for i, j in ((1, 0), (2, 0), (3, 0), (4, 0), (0, 1), (0, 2), (1, 1), (2, 1), (1, 2))])
        else:
            s.read_rms = float(np.sqrt(np.mean(s.Y[:, :3] ** 2)))
            s.read_tau = float(np.sqrt(np.mean(s.Y[:, 3:] ** 2)))
            s.cmask = np.ones(n, bool)

    def predict(s, q):
        P = {**DEF, **q}
        if s.con:
            d = s.d + P.get("z0", 0.0)
            if "o0" in P:
                o = np.array([P["o0"], P["o1"], P["o2"]])
                d = d - s.Rtip_n @ o
            if "cs" in P:
                d = d - P["cs"] * s.fn
            v = s.v if "cs" not in P else np.gradient(d, s.dt)
            g = 1 + s.G @ np.array([P[f"g{i}"] for i in range(9)]) if "g0" in P else np.ones(len(d))
            F = law(s.t, d, v, s.s[:, 0], s.s[:, 1], s.sv[:, 0], s.sv[:, 1], g, tuple(float(P[k]) for k in LAWP))
            if s.tester:
                W = F[:, :s.Y.shape[1]].copy()
            else:
                f = np.einsum("nik,nk->ni", s.TtoS, F)
                rt = s.rt + (s.Rst @ o if "o0" in P else 0)
                W = s.W0 + np.hstack([f, np.cross(rt, f)])
        else:
            W = s.W0.copy()
        if "dm" in P:
            W = W + P["dm"] * np.hstack([s.sf, np.cross(s.com, s.sf)])
        if "dc0" in P:
            dc, m = np.array([P["dc0"], P["dc1"], P["dc2"]]), s.m + P.get("dm", 0)
            df = -m * (np.cross(s.als, dc) + np.cross(s.ws, np.cross(s.ws, dc)))
            W = W + np.hstack([df, np.cross(dc, m * s.sf + df) + np.cross(s.com, df)])
        if "I0" in P:
            J = np.array([[P["I0"], P["I3"], P["I4"]], [P["I3"], P["I1"], P["I5"]], [P["I4"], P["I5"], P["I2"]]])
            W = W.copy(); W[:, 3:] -= s.als @ J + np.cross(s.ws, s.ws @ J)
        if not s.tester:
            if "w0" in P:
                from scipy.spatial.transform import Rotation
                R = Rotation.from_rotvec([P["w0"], P["w1"], P["w2"]]).as_matrix()
                W = np.hstack([W[:, :3] @ R, W[:, 3:] @ R])
            if "x01" in P:
                X = np.eye(6)
                for a in range(3):
                    for b in range(3):
                        if a != b:
                            X[a, b] = P[f"x{a}{b}"]
                W = W @ X.T
        if "gain" in P:
            W = W * (1 + P["gain"])
        if P.get("lag", 0) > 1e-6:
            a = np.exp(-s.dt / P["lag"])
            W = lfilter([1 - a], [1, -a], W - W[:1], axis=0) + W[:1]
        if "del" in P:
            W = np.column_stack([np.interp(s.t - P["del"], s.t, W[:, i]) for i in range(W.shape[1])])
        nc = W.shape[1]
        sc = np.array([1, 1, 1, LW, LW, LW])[:nc]
        if "b0" in P:
            W = W + sc * np.array([P[f"b{i}"] for i in range(nc)])
        if "dr0" in P:
            W = W + np.outer(s.t / 60, sc * np.array([P[f"dr{i}"] for i in range(nc)]))
        if "sat" in P:
            W = W.copy(); j = 0 if s.tester else 2
            W[:, j] = np.clip(W[:, j], -P["sat"], P["sat"])
        return W

    def starts(s, effects):
        """Lists of (name, start, scale, low, high) for all combinations of starts."""
        out = [[]]
        dmax = s.d.max() if s.con else 0
        for e in effects:
            new = []
            for st in EFF[e]:
                lst = []
                for nm, x0, sc, lo, hi in st:
                    if s.tester and nm[0] in "b" and nm[1:].isdigit() and int(nm[1:]) >= s.Y.shape[1] or s.tester and nm[:2] == "dr" and nm[2:].isdigit() and int(nm[2:]) >= s.Y.shape[1]:
                        continue
                    if x0 in ("q3", "q7"):
                        x0 = dmax * (0.3 if x0 == "q3" else 0.65)
                    if x0 == "s9":
                        x0 = 0.9 * np.abs(s.Y[:, 0 if s.tester else 2]).max()
                    if nm in ("LK", "hA"):
                        sc = {"LK": s.kscale * 0.3, "hA": 0.05 * s.fn.max()}[nm]; x0 = sc * 0.3
                    if all(nm != y[0] for o in lst for y in [o]):
                        lst.append((nm, x0, sc, lo, hi))
                new += [[*o, *[y for y in lst if all(y[0] != z[0] for z in o)]] for o in out]
            out = new
        return out

    kscale = 1000.0

    def fit(s, effects, warm=None, nfev=14):
        """Best fit over the starts: (error rms of forces in contact, weighted error, params)."""
        base = effects[0]
        best = None
        if s.con:
            ex = 1.5 if base == "hertz" else 1.0
            k0 = float(np.sum(s.fn[s.cmask] * np.maximum(s.d[s.cmask], 0) ** ex) / np.sum(np.maximum(s.d[s.cmask], 0) ** (2 * ex)))
            s.kscale = float(s.fn.max() / s.d.max())
        for st in s.starts(effects):
            names = [x[0] for x in st]
            lo, hi = np.array([x[3] for x in st], float), np.array([x[4] for x in st], float)
            x0 = np.array([(warm or {}).get(x[0], x[1]) for x in st], float)
            sc = np.array([x[2] for x in st], float)
            fixed = {"ex": 1.5} if base == "hertz" and "ex" not in names else {}
            if s.con:                                      # stiffness as the force at a typical depth
                dref = 0.6 * s.d.max()
                names, lo, hi = ["kf"] + names, np.r_[1e-6, lo], np.r_[I, hi]
                f0 = (warm or {}).get("kf", k0 * dref ** ex)
                x0, sc = np.r_[f0, x0], np.r_[0.1 * f0, sc]

            def par(x):
                q = dict(zip(names, x)); q.update(fixed)
                if s.con:
                    q["k"] = q["kf"] / dref ** q.get("ex", DEF["ex"])
                return q

            use = s.use if s.con else slice(None)
            fun = lambda x: ((s.predict(par(x)) - s.Y)[use] * s.wt).ravel()
            if not len(names):
                x = x0
            else:
                x0 = np.clip(x0, lo + 1e-9 * sc, hi - 1e-9 * sc)
                def jac(x, fun=fun, sc=sc, hi=hi):
                    f = fun(x); J = np.empty((len(f), len(x)))
                    for i in range(len(x)):
                        h = 0.01 * sc[i] if x[i] + 0.01 * sc[i] < hi[i] else -0.01 * sc[i]
                        y = x.copy(); y[i] += h
                        J[:, i] = (fun(y) - f) / h
                    return J
                try:
                    x = least_squares(fun, x0, jac=jac, bounds=(lo, hi), x_scale=sc, max_nfev=nfev, ftol=1e-5, xtol=1e-5).x
                except (ValueError, np.linalg.LinAlgError):
                    x = x0
            r = fun(x)
            c = float(np.sqrt(np.mean(r ** 2)))
            if best is None or c < best[1]:
                R = s.predict(par(x)) - s.Y
                nf = 3 if not s.tester else R.shape[1]
                e = float(np.sqrt(np.mean(R[s.cmask][:, :nf] ** 2)))
                et = float(np.sqrt(np.mean(R[s.cmask][:, 3:] ** 2))) if not s.tester else 0.0
                best = (e, c, par(x), et)
        return best

@njit(cache=True)
def bristle(q, l):
    z, out = 0.0, np.zeros(len(q))
    for i in range(1, len(q)):
        dq = q[i] - q[i - 1]
        z = (z + dq / l) / (1 + abs(dq) / l)
        out[i] = z
    return out

# ---- joint torques: linear in the parameters, with scans over the few that are not -------------------------------
class Joints:
    def __init__(s, case, nmax=6000):
        log, rig = read(case)
        t = log["t"]
        dt = np.median(np.diff(t))
        tu = np.arange(t[0], t[-1], dt)
        s.n = n = sum(c[:3] == "tau" for c in log)
        s.drive = "robot" not in rig
        w = max(7, int(0.06 / dt) | 1)
        sm = lambda y, k=0: savgol_filter(np.interp(tu, t, y), w, 3, deriv=k, delta=dt)
        dec = max(1, len(tu) // nmax)
        cut = slice(w, len(tu) - w, dec)
        s.t = tu[cut]
        s.Q, s.DQ, s.DDQ = (np.ascontiguousarray(np.column_stack([sm(log[f"q{i+1}"], k)[cut] for i in range(n)])) for k in (0, 1, 2))
        s.Y = np.column_stack([sm(log[f"tau{i+1}"])[cut] for i in range(n)])
        s.read_rms = float(np.sqrt(np.mean(s.Y ** 2)))
        s.base = np.zeros_like(s.Y)
        if not s.drive:
            ro = rig["robot"]
            f = {"lwr4plus": "flange", "ur5": "tool0", "panda": "panda_hand"}.get(ro["model"], "ft_sensor")
            s.arm = robots.load(ro["model"], f, f, ro["gravity"], ro.get("joints"), case)
            s.base = np.array([E.rnea(s.arm.chain, s.Q[k], s.DQ[k], s.DDQ[k], 1.0) for k in range(len(s.t))])
        s.sg = np.column_stack([bristle(s.Q[:, j], 2e-4) for j in range(n)])

    def chain_diff(s, dm, dc):
        """Torques of a unit point mass at the flange (payload): numerically from the chain."""
        ch = s.arm.with_load(dm, s.arm.ps + dc)
        return np.array([E.rnea(ch, s.Q[k], s.DQ[k], s.DDQ[k], 1.0) for k in range(len(s.t))]) - s.base

    def cols(s, e, j):
        """Regressors of effect e at joint j: list of alternative column sets."""
        q, v, a, y, sg = s.Q[:, j], s.DQ[:, j], s.DDQ[:, j], s.Y[:, j], s.sg[:, j]
        one = np.ones_like(q)
        if e == "rigid-body": return [[a]] if s.drive else [[]]
        if e == "joint-coulomb-friction": return [[sg]]
        if e == "joint-viscous-friction": return [[v]]
        if e == "joint-friction-asymmetry": return [[np.abs(v), np.abs(sg)]]
        if e == "joint-torque-offset": return [[one]]
        if e == "rotor-inertia": return [[a]]
        if e == "joint-torque-gain": return [[s.base[:, j]]]
        if e == "joint-elasticity": return [[np.gradient(np.gradient(y, s.t), s.t), np.gradient(a, s.t)]]
        if e == "joint-spring": return [[q, one]]
        if e == "joint-load-friction": return [[sg * np.abs(s.base[:, j] if not s.drive else y)]]
        if e == "joint-stribeck-friction": return [[sg * np.exp(-(v / x) ** 2)] for x in (0.03, 0.1, 0.2, 0.35, 0.5, 0.7, 1.0)]
        if e == "joint-torque-ripple": return [[np.sin(o * q), np.cos(o * q), np.sin(2 * o * q), np.cos(2 * o * q)] for o in ((1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 12, 16, 20, 32) if s.drive else (1, 4, 16))]
        return [[]]

    def fit(s, effects):
        R = np.empty_like(s.Y)
        if not s.drive and ("payload" in effects or "gravity-error" in effects):
            G = []
            if "payload" in effects:
                G += [s.chain_diff(1.0, np.zeros(3))] + [(s.chain_diff(1.0, d) - s.chain_diff(1.0, -d)) / 0.1 for d in 0.05 * np.eye(3)]
            if "gravity-error" in effects:
                for d in np.eye(3):
                    ch = s.arm.chain[:6] + (s.arm.g + d,)
                    G.append(np.array([E.rnea(ch, s.Q[k], s.DQ[k], s.DDQ[k], 1.0) for k in range(len(s.t))]) - s.base)
            rows, blocks = len(s.t), []
            loc = [[c for e in effects for c in s.cols(e, j)[0]] for j in range(s.n)]
            tot = sum(map(len, loc))
            A = np.zeros((rows * s.n, len(G) + tot)); k = len(G)
            for j in range(s.n):
                sl = slice(j * rows, (j + 1) * rows)
                for i, g in enumerate(G): A[sl, i] = g[:, j]
                for c in loc[j]: A[sl, k] = c; k += 1
            b = (s.Y - s.base).T.ravel()
            x = np.linalg.lstsq(A, b, rcond=1e-9)[0]
            return float(np.sqrt(np.mean((A @ x - b) ** 2))), None
        val = []
        for j in range(s.n):
            b, best = s.Y[:, j] - s.base[:, j], None
            sets = [[]]
            for e in effects:
                sets = [o + c for o in sets for c in s.cols(e, j)]
            for c in sets:
                if c:
                    A = np.column_stack(c); x = np.linalg.lstsq(A, b, rcond=1e-9)[0]; r = b - A @ x
                else:
                    x, r = None, b
                if best is None or r @ r < best[0]:
                    best = (r @ r, r, x)
            R[:, j] = best[1]; val.append(best[2])
        return float(np.sqrt(np.mean(R ** 2))), val

JOINT = ["joint-coulomb-friction", "joint-viscous-friction", "joint-friction-asymmetry", "joint-torque-offset", "rotor-inertia", "joint-torque-gain", "payload", "joint-elasticity",
         "gravity-error", "joint-stribeck-friction", "joint-load-friction", "joint-torque-ripple", "joint-spring"]

def audit(case, group, model, truth, quick=False):
    """Figures of one case: errors without and with the truth, near imitators, size rule."""
    out = dict(near=[])
    log, rig = read(case)
    joint = any(c.startswith("tau") for c in log) and "fx" not in log
    D = Joints(case) if joint else Wrench(case)
    out["read"] = D.read_rms
    if joint:
        cand = [e for e in JOINT if not (D.drive and e in ("rotor-inertia", "payload", "gravity-error", "joint-torque-gain"))]
        fit = lambda effs, w=None: (lambda r: (r[0], r[0], r[1], 0.0))(D.fit(effs))
    elif not D.con:
        cand = TOOL
        fit = lambda effs, w=None: D.fit(effs, w)
    elif D.tester:
        cand = [e for e in CONTACT if e not in ("tip-offset", "tool-mass", "tool-com", "tool-inertia", "sensor-crosstalk", "sensor-misalignment", "sensor-gain", "friction-anisotropy")
                and (CF_in(log) or e not in ("coulomb-friction", "viscous-friction", "stribeck-friction", "presliding", "friction-rounding", "load-dependent-friction"))]
        fit = lambda effs, w=None: D.fit(effs, w)
    else:
        cand = [e for e in CONTACT if e not in ("tool-inertia", "sensor-gain")]
        fit = lambda effs, w=None: D.fit(effs, w)
    m0 = fit(model)
    tr = truth if group in ("one", "two") else []
    full = fit(model + tr, m0[2] if not joint else None) if tr else m0
    out.update(before=m0[0], true=full[0], before_w=m0[1], true_w=full[1], before_t=m0[3], true_t=full[3], par=full[2], single={})
    if tr:
        for drop in tr:
            rest = [x for x in tr if x != drop]
            part = fit(model + rest, m0[2] if not joint else None) if rest else m0
            out["single"][drop] = (part[0], part[3], part[1])
            if quick:
                continue
            for e in cand:
                if e in model or e in tr:
                    continue
                if fit(model + rest + [e], part[2] if not joint else None)[1] <= 1.15 * full[1]:
                    out["near"].append(e)
    if group == "outside":
        extra = [e for e in (["joint-torque-offset"] if joint else ["sensor-bias", "sensor-drift", "surface-offset"] if D.con else ["sensor-bias", "sensor-drift"])]
        b = fit(model + extra, m0[2] if not joint else None)
        r = sorted((fit(model + extra + [e], b[2] if not joint else None)[:2][::-1] + (e,) for e in cand if e not in model + extra and e != "sensor-bias"))
        top = [e for _, _, e in r[:3]]
        pairs = [(top[0], top[1]), (top[0], top[2]), (top[1], top[2])]
        f = min((fit(model + extra + list(p), b[2] if not joint else None)[:2][::-1] + (p,) for p in pairs))
        out.update(left=f[1], with_bias=b[0], best_two=list(f[2]))
    return out

def CF_in(log):
    return "tangential_force1" in log
