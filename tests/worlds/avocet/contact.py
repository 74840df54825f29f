"""Contact logs (arms and materials testers): motion, hidden effects, sensors, own fit."""
import numpy as np
from scipy.interpolate import CubicSpline
from scipy.optimize import least_squares
from scipy.signal import butter, lfilter, sosfilt, sosfiltfilt
from core import arm, law, pvec, CP
from robots import Arm, HOME

LAWS = {"hooke": ["k"], "kelvin-voigt": ["k", "c"], "hertz": ["k"], "hunt-crossley": ["k", "lam", "n"], "maxwell": ["k", "tau1"], "zener": ["k", "rho1", "tau1"]}


def minjerk(segs, x0, fs):
    """segs: (duration, target or None, phase) -> path, phases on a grid"""
    T = sum(s[0] for s in segs); n = int(T * fs) + 1
    t = np.arange(n) / fs; X = np.zeros((n, len(x0))); ph = np.empty(n, object)
    x = np.array(x0, float); a = 0.
    for d, tg, name in segs:
        i = slice(int(np.ceil((a - 1e-9) * fs)), n if a + d >= T - 1e-9 else min(n, int((a + d) * fs) + 2))
        b = x if tg is None else np.array([x[j] if v is None else v for j, v in enumerate(tg)], float)
        s = np.clip((t[i] - a) / d, 0, 1); w = s ** 3 * (10 - 15 * s + 6 * s * s)
        X[i] = x + np.outer(w, b - x); ph[i] = name
        x = b; a += d
    return t, X, ph


def program(rng, kind, dmax, fast, arm_log, opt):
    """way points [s1 s2 depth rx ry rz]; kind poke|slide|poke-slide"""
    S = []; up = -opt.get("lift", .03) if arm_log else -.002
    if arm_log:
        S.append((1.2, None, "free"))
        if opt.get("turn", True):
            A = opt.get("turnamp", .5); q = opt.get("turnquick", 1.)
            for k in range(rng.integers(4, 7)):
                v = rng.uniform(-A, A, 3); v[2] *= 1.3
                S += [(rng.uniform(.85, 1.5) / q, [None, None, None, *v], "free"), (rng.uniform(.1, .5), None, "free")]
            if opt.get("shake"):
                for k in range(8):
                    v = np.zeros(3); v[k % 3] = .25 * (-1) ** (k // 3)
                    S.append((.22, [None, None, None, *v], "free"))
            S.append((.9, [None, None, None, 0, 0, 0], "free"))
    else:
        S.append((1.1, None, "free"))
    near = -.0025 if arm_log else -.001
    def goto(x, y, tl): S.append((1.0 if arm_log else .4, [x, y, near, *tl], "approach"))
    span = opt.get("span", .02); tilt = opt.get("tilt", 0.)
    places = [(0., 0.)] if opt.get("oneplace") else [(0, 0)] + [tuple(rng.uniform(-span, span, 2)) for _ in range(rng.integers(2, 4))]
    T6 = lambda: [rng.uniform(-tilt, tilt), rng.uniform(-tilt, tilt), rng.uniform(-.3, .3)] if tilt else [0, 0, 0]
    def poke(x, y, d, v, hold, tl):
        goto(x, y, tl)
        L = d - near
        S.extend([(1.7 * L / v + .04, [None, None, d, None, None, None], "poke"), (hold, None, "hold"),
                  (1.7 * L / (v * rng.choice([.4, 1.])) + .04, [None, None, near, None, None, None], "retract"), (opt.get("rest", rng.uniform(.2, .6)), None, "rest")])
    if "poke" in kind:
        ds = opt.get("depths", [.45, 1., .7]); vs = np.array([.08, .35, 1.]) * fast
        hold = opt.get("hold", rng.uniform(2, 5))
        plan = [(ds[0], 2), (ds[0], 0), (ds[2 % len(ds)], 1), (ds[1 % len(ds)], 2), (ds[2 % len(ds)], 2), (ds[1 % len(ds)], 0)]
        if opt.get("short"): plan = [(ds[i % len(ds)], 2) for i in range(6)]
        for k, (d, v) in enumerate(plan):
            p = places[0] if k < 2 else places[k % len(places)]
            if opt.get("partial") and k == 3:
                goto(*p, T6())
                for dd in (d, .5 * d, d, .3 * d, d): S.append((1.7 * .6 * dmax / (fast * .5) + .05, [None, None, dd * dmax, None, None, None], "poke"))
                S.append((.6, [None, None, near, None, None, None], "retract"))
            poke(*p, d * dmax, vs[v] * rng.uniform(.9, 1.1), hold if v == 2 else opt.get("shold", .4), T6())
        if arm_log and len(places) > 1 and not opt.get("short"):
            for p in places[1:]: poke(*p, .8 * dmax, vs[1], .4, T6())
        poke(*places[0], dmax, vs[1], .5, [0, 0, 0])
    if "slide" in kind:
        Ls = opt.get("length", rng.uniform(.015, .03)); vs = opt.get("slidev", [.003, .012, .04])
        dss = opt.get("sdepths", [.4, .95, .65])
        for k, d in enumerate(dss):
            goto(-Ls / 2, 0, [0, 0, 0])
            S.append((.8, [None, None, d * dmax, None, None, None], "poke")); S.append((.4, None, "hold"))
            for v in (vs if k != 2 else vs[1:]):
                L = min(Ls, v * 3.)
                dirs = [(1, 0), (0, 1)] if not opt.get("onedir") else [(1, 0)]
                for c, s in dirs:
                    for sg in ((1, -1) if not opt.get("oneway") else (1,)):
                        b = [-Ls / 2 + L * c * (sg > 0), L * s * (sg > 0), None, None, None, None]
                        # trapezoid-like: long min-jerk
                        S.append((1.4 * L / v, b, "slide")); S.append((rng.choice([.05, .4]), None, "hold"))
            S.append((.6, [None, None, near, None, None, None], "retract")); S.append((.3, None, "rest"))
    if opt.get("stay"): S = S[:-2]
    else: S.append((1., [None, None, up, None, None, None], "free"))
    S.append((.8, None, None if False else ("hold" if opt.get("stay") else "free")))
    return S, np.array([0, 0, up, 0, 0, 0.])


class Scene:
    """the motion and its kinematics on a fine grid"""
    def __init__(self, rng, robot, kind, dmax, fast, fs, opt, kctrl_ratio):
        self.arm_log = robot is not None
        S, x0 = program(rng, kind, dmax, fast, self.arm_log, opt)
        want = opt.get("T")
        self.ff = ff = 1000 if fs >= 500 else 500
        if fs >= 2000: self.ff = ff = 2000
        t, X, ph = minjerk(S, x0, ff)
        if want:    # idle between the parts is no gain: stretch by repeating
            k = max(1, int(round(want / t[-1])))
            if k > 1: t, X, ph = minjerk(S * k, x0, ff)
        d = X[:, 2]; X[:, 2] = np.where(d > 0, d / (1 + kctrl_ratio) * (1 + kctrl_ratio * .7), d)      # a soft controller gives way
        w = opt.get("wc", rng.uniform(8, 25))
        X = sosfiltfilt(butter(2, w / (ff / 2), output="sos"), X, axis=0)
        if self.arm_log:
            for j in range(3):      # wander of the controller
                X[:, j] += sum(rng.uniform(5e-7, 3e-6) * np.sin(2 * np.pi * f * t + rng.uniform(0, 6)) for f in rng.uniform(.3, 6, 3))
        self.t, self.ph = t, ph
        if not self.arm_log:
            self.X = X
            self.s = X[:, :2]; self.de = X[:, 2]
            return
        A = self.A = robot
        q0 = HOME[A.name]; import pinocchio as pin
        pin.framesForwardKinematics(A.model, A.data, q0); M = A.data.oMf[A.fid]
        inc = opt.get("incline", 0.)
        n = pin.rpy.rpyToMatrix(inc, inc / 2, 0) @ np.array([0, 0, 1.]); t1 = np.array([1, 0, 0.]) - n[0] * n; t1 /= np.linalg.norm(t1); t2 = np.cross(n, t1)
        z = -n; x = M.rotation[:, 0] - (M.rotation[:, 0] @ z) * z; x /= np.linalg.norm(x)
        R0 = np.c_[x, np.cross(z, x), z]
        p0 = np.round(M.translation, 3)
        self.p0, self.n, self.t1, self.t2 = p0, n, t1, t2
        kn = max(1, ff // 50); idx = np.r_[np.arange(0, len(t), kn), len(t) - 1]; idx = np.unique(idx)
        Q = np.zeros((len(idx), A.J)); q = q0; bad = 0
        for i, j in enumerate(idx):
            P = p0 + X[j, 0] * t1 + X[j, 1] * t2 - X[j, 2] * n
            q, ok = A.ik(q, P, R0 @ pin.exp3(X[j, 3:]), 200 if i == 0 else 12, 1e-8); bad += not ok
            Q[i] = q
        if bad: raise RuntimeError("IK failed at %d" % bad)
        if ((Q < A.lo + .02) | (Q > A.hi - .02)).any(): raise RuntimeError("limits")
        cs = CubicSpline(t[idx], Q); self.q, self.dq, self.ddq = cs(t), cs(t, 1), cs(t, 2)
        self.kin()

    def kin(self):
        """orientation, tip, rates and acceleration of the sensor's origin, vectorised"""
        A = self.A; n = len(self.t); q, dq, ddq = self.q, self.dq, self.ddq; R = np.broadcast_to(np.eye(3), (n, 3, 3)); p = np.zeros((n, 3)); w = np.zeros((n, 3)); al = np.zeros((n, 3)); a = np.zeros((n, 3)); X = np.cross
        for j in range(A.J):
            d = R @ A.pP[j]; a = a + X(al, d) + X(w, X(w, d)); p = p + d; R = R @ A.RP[j]; z = R @ A.AX[j]
            al = al + z * ddq[:, j:j + 1] + X(w, z) * dq[:, j:j + 1]; w = w + z * dq[:, j:j + 1]
            x = A.AX[j]; K = np.array([[0, -x[2], x[1]], [x[2], 0, -x[0]], [-x[1], x[0], 0]]); c, s_ = np.cos(q[:, j])[:, None, None], np.sin(q[:, j])[:, None, None]
            R = R @ (np.eye(3) + s_ * K + (1 - c) * (K @ K))
        d = R @ A.ps; a = a + X(al, d) + X(w, X(w, d)); R = R @ A.Rs
        self.R, self.tip, self.w, self.al, self.a = R, p + d + R @ A.tip, w, al, a

    def thin(self, k):
        import copy
        o = copy.copy(self)
        if k <= 1: return o
        for a in ("t", "ph", "X", "s", "de", "q", "dq", "ddq", "R", "tip", "w", "al", "a"):
            if hasattr(o, a): setattr(o, a, np.ascontiguousarray(getattr(o, a)[::k]) if a != "ph" else self.ph[::k])
        return o

    def frame(self, sp):
        """contact coordinates under a spec's geometry"""
        t = self.t
        if self.arm_log:
            g = sp["tipd"]; a1, a2 = sp["tilt"]
            p = self.tip + self.R @ g - self.p0
            n = self.n - a1 * self.t1 - a2 * self.t2; n /= np.linalg.norm(n)
            t1 = self.t1 + a1 * self.n; t1 -= (t1 @ n) * n; t1 /= np.linalg.norm(t1); t2 = np.cross(n, t1)
            de = -p @ n + sp["z0"]; s1, s2 = p @ t1, p @ t2
        else:
            n = t1 = t2 = None
            a1, a2 = sp["tilt"]
            de, s1, s2 = self.de + sp["z0"] + a1 * self.s[:, 0] + a2 * self.s[:, 1], self.s[:, 0].copy(), self.s[:, 1].copy()
        dt = t[1] - t[0]
        return de, s1, s2, np.gradient(de, dt), np.gradient(s1, dt), np.gradient(s2, dt), n, t1, t2

    def forces(self, sp):
        de, s1, s2, dd, v1, v2, n, t1, t2 = self.frame(sp)
        acc = np.gradient(dd, self.t[1] - self.t[0]) if sp["P"].get("addm") else dd
        N, T1, T2 = law(self.t, de, dd, s1, s2, v1, v2, acc, pvec(**sp["P"]))
        return N, T1, T2, (n, t1, t2), de

    def wrench(self, sp):
        """ideal reading (before the sensor's own effects) on the fine grid, (n,6); tester: (n,3) T1 T2 N"""
        N, T1, T2, (n, t1, t2), de = self.forces(sp)
        self.last = (N, T1, T2, de)
        if not self.arm_log: return np.c_[T1, T2, N]
        f = N[:, None] * n + T1[:, None] * t1 + T2[:, None] * t2
        self.fc = f
        R = self.R; c = R @ sp["com"]
        ac = self.a + np.cross(self.al, c) + np.cross(self.w, np.cross(self.w, c))
        ft = sp["m"] * (sp["g"] - ac)
        I = sp["I"]; Rt = R.transpose(0, 2, 1)
        tol = lambda v: np.einsum("nij,nj->ni", Rt, v)
        w, al = tol(self.w), tol(self.al)
        fl, cl = tol(ft), tol(f)
        tq = np.cross(sp["com"], fl) + np.cross(self.A.tip + sp["tipd"], cl) - (al @ I.T) - np.cross(w, w @ I.T)
        return np.c_[fl + cl, tq]


def spec0(P, arm_=None, m=0., com=None, g=None):
    return dict(P=dict(P), z0=0., tilt=np.zeros(2), tipd=np.zeros(3), m=m, com=np.zeros(3) if com is None else com, I=np.zeros((3, 3)),
                g=np.array([0, 0, -9.81]) if g is None else g,
                S=dict(rot=np.zeros(3), X=None, gain=0., bias=None, drift=None, lag=0., delay=0., sat=None, quant=0., hum=None, nl=0., ring=0., skew=0., warm=None, cub=0.))


def copyspec(s):
    o = dict(s); o["P"] = dict(s["P"]); o["S"] = dict(s["S"])
    for k in ("tilt", "tipd", "com", "g", "I"): o[k] = np.array(s[k])
    return o


def sensor(t, W, S):
    """the sensor's effects on the fine grid (not clip and converter)"""
    from scipy.spatial.transform import Rotation
    n = W.shape[1]; W = W.copy(); scale = np.abs(W).max(0) + 1e-9
    if np.any(S["rot"]):
        R = Rotation.from_rotvec(-S["rot"]).as_matrix()
        W[:, :3] = W[:, :3] @ R.T
        W[:, 3:] = W[:, 3:] @ R.T
    if S["X"] is not None: W = W + W @ S["X"].T
    W = W * (1 + S["gain"])
    if S["cub"]: W = W * (1 - S["cub"] * (np.abs(W) / scale))
    if S["nl"]: W = W + S["nl"] * scale * np.sin(np.pi * W / scale) / 2
    if S["bias"] is not None: W = W + S["bias"]
    if S["drift"] is not None: W = W + np.outer(t / 60, S["drift"])
    if S["warm"] is not None: W = W + np.outer(1 - np.exp(-t / S["warm"][0]), S["warm"][1])
    if S["ring"]:      # the sensor's mount rings (second order, lightly damped)
        dt = t[1] - t[0]; w0 = 2 * np.pi * S["ring"]; z = .08
        from scipy.signal import cont2discrete
        a, b, c, d, _ = cont2discrete((np.array([[0, 1], [-w0 * w0, -2 * z * w0]]), np.array([[0], [w0 * w0]]), np.array([[1., 0]]), np.array([[0.]])), dt)
        from scipy.signal import ss2tf
        num, den = ss2tf(a, b, c, d); W0 = W[0]; W = lfilter(num[0], den, W - W0, axis=0) + W0
    if S["lag"]:
        a = np.exp(-(t[1] - t[0]) / S["lag"]); W0 = W[0]; W = lfilter([1 - a], [1, -a], W - W0, axis=0) + W0
    if S["delay"] or S["skew"]:
        tt = t - S["delay"] - S["skew"] * t
        W = np.c_[tuple(np.interp(tt, t, W[:, i]) for i in range(n))]
    if S["hum"] is not None:
        f0, am, ph, second = S["hum"]
        W = W + np.sin(2 * np.pi * f0 * t + ph)[:, None] * am + second * np.sin(4 * np.pi * f0 * t + 2 * ph)[:, None] * am
    return W


def finish(W, noise, S, before=True):
    W = W + noise if before else W
    if S["sat"] is not None: W = np.clip(W, -S["sat"], S["sat"])
    if not before: W = W + noise
    if S["quant"]: W = S["quant"] * np.round(W / S["quant"]) if np.isscalar(S["quant"]) else np.where(S["quant"] > 0, np.round(W / np.where(S["quant"] > 0, S["quant"], 1)) * S["quant"], W)
    return W


def fit(sc, sp, names, tl, Y, sig, start=None, extra=None):
    """best fit of the model's own parameters (log scale); returns spec, residual (n, ch)"""
    x0 = np.log([max(sp["P"][n], 1e-9) for n in names])
    def res(x, full=False):
        s = copyspec(sp)
        for n, v in zip(names, np.exp(x)): s["P"][n] = v
        W = sc.wrench(s)
        if s["P"].get("n", 1) and not np.isfinite(W).all(): W = np.nan_to_num(W)
        M = np.c_[tuple(np.interp(tl, sc.t, W[:, i]) for i in range(W.shape[1]))]
        r = Y - M
        return (s, r) if full else (r / sig).ravel()
    if not names: return res(x0, True)
    o = least_squares(res, x0, method="lm", max_nfev=30, ftol=1e-5, xtol=1e-5, x_scale=.1, diff_step=1e-4)
    return res(o.x, True)
