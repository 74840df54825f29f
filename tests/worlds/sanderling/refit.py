"""Own least squares from the written files: what a model leaves, with any catalogue effects added."""
import os, tomllib
import numpy as np, pinocchio as pin
import table
from scipy.optimize import least_squares
from scipy.signal import savgol_filter
import arms
from material import vector, predict, lag1, play, I

DREF = 3e-3
ZERO = np.zeros(1)


def fk(m, fids, Q):
    d = m.createData()
    P = np.zeros((len(fids), len(Q), 3)); R = np.zeros((len(fids), len(Q), 3, 3))
    for i in range(len(Q)):
        pin.framesForwardKinematics(m, d, Q[i])
        for j, f in enumerate(fids):
            P[j, i] = d.oMf[f].translation; R[j, i] = d.oMf[f].rotation
    return P, R


def smooth(t, X, win, deriv=0):
    """local cubic on an even grid, back to the rows"""
    X = np.asarray(X, float); sh = X.shape; X = X.reshape(len(t), -1)
    dt = float(np.median(np.diff(t)))
    tu = np.arange(t[0], t[-1], dt)
    w = int(win / dt) // 2 * 2 + 1
    w = max(w, 5)
    U = np.stack([np.interp(tu, t, X[:, j]) for j in range(X.shape[1])], 1)
    S = savgol_filter(U, w, 3, deriv=deriv, delta=dt, axis=0)
    return np.stack([np.interp(t, tu, S[:, j]) for j in range(X.shape[1])], 1).reshape(sh)


# parameters: (name, start values, scale or 'log')
N3 = ("x", "y", "z")
EFF = {
    "hooke": [("kk", [1000.], "log")],
    "kelvin-voigt": [("kk", [1000.], "log"), ("c", [0.], 10.)],
    "hertz": [("kk", [1000.], "log")],
    "hunt-crossley": [("kk", [1000.], "log"), ("lam", [0.], 1.), ("n", [1.2], .2)],
    "coulomb-friction": [("mu", [.3], .2)],
    "hertz-exponent": [("n", [1.05], .2)],
    "viscous-damping": [("c", [0.], 10.)],
    "hunt-crossley-damping": [("lam", [0.], 1.)],
    "relaxation": [("r1", [.2], .2), ("tau1", [.15, 1., 8.], "log")],
    "hysteresis": [("hy_ratio", [.1], .1), ("hy_len", [5e-4], "log")],
    "stress-softening": [("mu_ratio", [.15], .1), ("mu_len", [2e-3], "log")],
    "adhesion": [("fa", [.2], .5), ("fa_len", [1e-3], "log")],
    "stiffening-layer": [("K", [300.], 300.), ("db", [-.45, -.7], .2)],
    "surface-offset": [("z0", [0.], 3e-4)],
    "surface-tilt": [("tilt1", [0.], .01), ("tilt2", [0.], .01)],
    "stiffness-drift": [("drift", [0.], .1)],
    "stiffness-inhomogeneity": [(f"inh{i}", [0.], .1) for i in range(8)],
    "viscous-friction": [("cv", [0.], 3.)],
    "stribeck-friction": [("dmu", [.05], .1), ("vs", [4e-3, 2e-2], "log")],
    "presliding": [("flen", [5e-4, 2e-3], "log")],
    "friction-rounding": [("vr", [5e-3, 2e-2], "log")],
    "load-dependent-friction": [("p", [0.], .2)],
    "friction-anisotropy": [("aniso", [0.], .2)],
    "structural-compliance": [("comp", [2e-5], 5e-5)],
    "tip-offset": [(f"off{i}", [0.], 1e-3) for i in range(3)],
    "tool-mass": [("dm", [0.], .05)],
    "tool-com": [(f"dc{i}", [0.], .01) for i in range(3)],
    "tool-inertia": [(f"I{i}", [0.], 1e-3) for i in range(6)],
    "sensor-bias": [(f"b{i}", [0.], .3) for i in range(6)],
    "sensor-drift": [(f"d{i}", [0.], .3) for i in range(6)],
    "sensor-crosstalk": [(f"x{i}", [0.], .05) for i in range(6)],
    "sensor-misalignment": [(f"rot{i}", [0.], .05) for i in range(3)],
    "sensor-gain": [("g", [0.], .05)],
    "sensor-lag": [("lag", [.02, .1], "log")],
    "time-offset": [("delay", [0.], .01)],
    "saturation": [("sat", [.98, .8], .1)],
    "mains-hum": [(f"h{i}", [0.], .2) for i in range(6)],
}
PNAMES = set(I)


class Wrench:
    """logs with forces: contact of an arm, free tool, tester"""

    def __init__(self, dir_, judge="force", hum=50.):
        self.hum = hum; self.judge = judge
        f = [x for x in os.listdir(dir_) if x.startswith("log.")][0]
        L = table.read(f"{dir_}/{f}")
        rig = tomllib.load(open(f"{dir_}/rig.toml", "rb"))
        self.rig = rig
        t = L.t.to_numpy()
        step = max(1, len(t) // 4500)
        self.tester = "depth" in L
        self.free = "surface" not in rig and not self.tester
        if self.tester:
            dep = smooth(t, L.depth.to_numpy(), 3 * np.median(np.diff(t)))
            sl = slice(None, None, step)
            self.t = t[sl]; n = len(self.t)
            self.dep = dep[sl]; self.dd = smooth(t, L.depth.to_numpy(), .05, 1)[sl]
            s1 = L.slip1.to_numpy() if "slip1" in L else np.zeros(len(t))
            self.s = np.c_[s1, 0 * s1][sl]
            v1 = smooth(t, s1, .05, 1)
            self.v = np.c_[v1, 0 * v1][sl]
            self.f = np.c_[L.tangential_force1 if "tangential_force1" in L else 0 * t, 0 * t, L.normal_force][sl]
            self.cols = [0, 2] if "tangential_force1" in L else [2]
            self.W = np.zeros((n, 6)); self.R = np.tile(np.eye(3), (n, 1, 1)); self.E = np.eye(3)
            self.Rt = self.R; self.m = 0.
        else:
            r = rig["robot"]
            m = arms.get("lwr", open(f"{dir_}/{r['model']}").read()) if r["model"].endswith("urdf") else arms.get(r["model"])
            nq = m.nq
            Q = L[[f"q{i+1}" for i in range(nq)]].to_numpy()
            keep = slice(None, None, max(1, len(t) // 12000))
            t0, Q = t[keep], Q[keep]
            static = np.median(np.diff(t0)) > .2
            P, R = fk(m, [m.getFrameId(r["sensor_frame"]), m.getFrameId(r["tip_frame"])], Q)
            g = np.array(r.get("gravity", [0, 0, -9.81]))
            tool = rig["tool"]
            com = P[0] + R[0] @ np.array(tool["com"])
            ac = np.zeros_like(com) if static else smooth(t0, com, .09, 2)
            st2 = max(1, len(t0) // 4500); sl = slice(None, None, st2)
            self.t = t0[sl]; n = len(self.t)
            self.R = R[0][sl]; self.Rt = R[1][sl]
            self.m = tool["mass"]; self.com = np.array(tool["com"])
            self.ga = np.einsum("nji,nj->ni", self.R, g - ac[sl])
            self.fcols = L[["fx", "fy", "fz", "tx", "ty", "tz"]].to_numpy()[keep][sl]
            self.f = self.fcols
            if self.free:
                self.dep = np.zeros(n)
                self.alpha = None
                w = np.zeros((n, 3))
                self.cols = list(range(6)); self.wt = np.r_[1, 1, 1, np.ones(3) / .06]
                from scipy.spatial.transform import Rotation as Ro
                if not static:
                    dR = Ro.from_matrix(np.einsum("nji,njk->nik", R[0][:-1], R[0][1:])).as_rotvec() / np.diff(t0)[:, None]
                    dR = np.r_[dR, dR[-1:]]
                    self.om = smooth(t0, dR, .09)[sl]; self.al = smooth(t0, dR, .12, 1)[sl]
                else:
                    self.om = self.al = np.zeros((n, 3))
            else:
                s = rig["surface"]
                nrm = np.array(s["normal"], float); nrm /= np.linalg.norm(nrm)
                t1 = np.array(s["tangent"], float); t1 -= nrm * (t1 @ nrm); t1 /= np.linalg.norm(t1)
                self.E = np.array([t1, np.cross(nrm, t1), nrm])
                X = (P[1] - np.array(s["point"])) @ self.E.T
                Xs, V = smooth(t0, X, .035), smooth(t0, X, .06, 1)
                self.dep = -Xs[sl, 2]; self.dd = -V[sl, 2]; self.s = Xs[sl, :2]; self.v = V[sl, :2]
                self.cols = [0, 1, 2]; self.f = self.fcols[:, :3].copy()
        if not self.free:
            hp = self.s[2:] - 2 * self.s[1:-1] + self.s[:-2]
            w = min(2.5e-5, 3 * np.median(np.abs(hp)) / .67 / 2.4)
            y = play(np.ascontiguousarray(self.s), w)
            self.v = np.r_[np.zeros((1, 2)), np.diff(y, axis=0) / np.diff(self.t)[:, None]]
        self.ks = np.ones(n); self.one = np.ones(n)
        if self.free:
            self.mask = np.ones(n, bool)
            ref = self.f[:, :3] if judge == "force" else self.f[:, 3:]
            self.rms = np.sqrt((ref ** 2).sum(1).mean() / 3)
        else:
            # the same samples for all models: in contact, and the tail of separation
            self.mask = self.dep > -1e-3
            if self.tester:
                fc = self.f[:, self.cols]
            else:
                fc = self.f[:, :3] - self.m * self.ga
                self.fn = np.einsum("nij,nj->ni", self.R, fc) @ self.E[2]
            if self.tester:
                self.fn = self.f[:, 2]
            self.inc = self.dep > 0
            self.rms = np.sqrt((fc[self.inc] ** 2).mean())
            self.dmax = np.percentile(self.dep, 99.8)
            xy = self.s[self.inc]
            c, w = xy.mean(0), np.ptp(xy, axis=0) / 2 + 1e-4
            u = (self.s - c) / w
            self.B = np.clip(np.c_[u, u ** 2, u ** 3, u[:, :1] * u[:, 1:], u[:, :1] ** 4], -2, 2)
            self.fmax = np.abs(self.f[:, :3]).max(0)

    def thin(self, k):
        import copy
        o = copy.copy(self); n = len(self.t)
        for a, x in self.__dict__.items():
            if isinstance(x, np.ndarray) and x.ndim and len(x) == n:
                o.__dict__[a] = x[::k]
        if not self.free:       # the path, not the speed, is what friction needs
            y = np.cumsum(self.v * np.r_[0., np.diff(self.t)][:, None], 0)[::k]
            o.v = np.r_[np.zeros((1, 2)), np.diff(y, axis=0) / np.diff(o.t)[:, None]]
        return o

    def pred(self, th, on):
        """prediction in sensor axes"""
        t = self.t; n = len(t)
        if not self.free:
            kw = {k: v for k, v in th.items() if k in PNAMES}
            if "kk" in th:
                kw["k"] = th["kk"] * DREF ** (1 - th.get("n", 1.))
            if "db" in th:
                kw["db"] = -th["db"] * self.dmax
            comp = kw.pop("comp", 0.)
            kw["fkind"] = 2 if "vr" in th else 0
            dep, dd, s, v = self.dep, self.dd, self.s, self.v
            if "off0" in th:
                o = np.einsum("nij,j->ni", self.Rt, [th["off0"], th["off1"], th["off2"]]) @ self.E.T if not self.tester else np.tile([0, 0, -th["off2"]], (n, 1))
                dep = dep - o[:, 2]
                v = v + np.gradient(o[:, :2], t, axis=0); dd = dd - np.gradient(o[:, 2], t)
            if "tilt1" in th:
                dep = dep + s[:, 0] * th["tilt1"] + s[:, 1] * th["tilt2"]
            if comp:
                dep = dep - comp * np.maximum(self.fn, 0)
            ks = self.one
            if "inh0" in th:
                ks = 1 + self.B @ np.array([th[f"inh{i}"] for i in range(8)])
            o = predict(vector(**kw), ZERO, t, dep, dd, np.ascontiguousarray(v[:, 0]), np.ascontiguousarray(v[:, 1]), ks)
            fw = o[:, [1, 2, 0]] @ self.E
            if self.tester:
                f = fw
            else:
                f = np.einsum("nji,nj->ni", self.R, fw) + (self.m + th.get("dm", 0)) * self.ga
        else:
            mm = self.m + th.get("dm", 0)
            c = self.com + np.array([th.get(f"dc{i}", 0) for i in range(3)])
            f = mm * self.ga
            tau = np.cross(c, f)
            if "I0" in th:
                J = np.array([[th["I0"], th["I3"], th["I4"]], [th["I3"], th["I1"], th["I5"]], [th["I4"], th["I5"], th["I2"]]])
                tau = tau - self.al @ J - np.cross(self.om, self.om @ J)
            f = np.c_[f, tau]
        M = np.eye(3) * (1 + th.get("g", 0))
        if "x0" in th:
            M = M + np.array([[0, th["x0"], th["x1"]], [th["x2"], 0, th["x3"]], [th["x4"], th["x5"], 0]])
        if "rot0" in th:
            M = M @ pin.exp3(np.array([th["rot0"], th["rot1"], th["rot2"]]))
        if not np.array_equal(M, np.eye(3)):
            f = np.c_[f[:, :3] @ M.T, f[:, 3:] @ M.T] if f.shape[1] == 6 else f @ M.T
        if "delay" in th:
            f = np.stack([np.interp(t - th["delay"], t, f[:, j]) for j in range(f.shape[1])], 1)
        if "lag" in th:
            f = np.stack([lag1(t, np.ascontiguousarray(f[:, j]), th["lag"]) for j in range(f.shape[1])], 1)
        if "sat" in th:
            a = int(np.argmax(self.fmax)) if not self.free else 2
            f = f.copy(); L = th["sat"] * (self.fmax[a] if not self.free else np.abs(self.f[:, a]).max())
            f[:, a] = np.clip(f[:, a], -L, L)
        for key, fac in (("b", self.one), ("d", (t - t[0]) / 60)):
            if key + "0" in th:
                f = f + np.array([th[f"{key}{i}"] for i in range(f.shape[1])]) * fac[:, None]
        if "h0" in th:
            w = 2 * np.pi * self.hum * t
            h = np.array([th[f"h{i}"] for i in range(6)])
            f = f.copy(); f[:, :3] += np.outer(np.sin(w), h[:3]) + np.outer(np.cos(w), h[3:])
        return f

    def fit(self, names, starts=None, quick=14):
        ps = []
        for e in names:
            if e in ("none",):
                continue
            for p in EFF[e]:
                if p[0] in [x[0] for x in ps]:
                    continue
                if p[0] in ("b3", "b4", "b5", "d3", "d4", "d5") and not self.free:
                    continue
                if p[0] in ("x0", "x1", "x2", "x3", "x4", "x5") and self.tester:
                    continue
                ps.append(p)
        fixed = {}
        if "hertz" in names:
            fixed["n"] = 1.5
            ps = [p for p in ps if p[0] != "n"] if "hertz-exponent" not in names else ps
        nm = [p[0] for p in ps]
        sc = [p[2] for p in ps]
        m = self.mask
        if self.free:
            ncol = 6
        cols = self.cols
        def theta(u):
            th = dict(fixed)
            for (n_, st, s_), uu, s0 in zip(ps, u - 1, st0):
                th[n_] = s0 * np.exp(np.clip(uu, -6, 6)) if s_ == "log" else s0 + s_ * uu
            return th

        def res(u):
            th = theta(u)
            f = self.pred(th, names)
            r = (self.f - f)[:, cols]
            if self.free:
                r = r * self.wt
            r = r[m]
            r = np.where(np.isfinite(r), r, 1e3)
            return r.ravel()

        best = None
        nst = max([len(p[1]) for p in ps] + [1]) if ps else 1
        for j in range(nst):
            st0 = [p[1][min(j, len(p[1]) - 1)] for p in ps]
            if starts:
                st0 = [starts.get(n_, s) for n_, s in zip(nm, st0)] 
            if not ps:
                u = np.zeros(0)
                best = (res(u), {})
                break
            o = least_squares(res, np.ones(len(ps)), method="lm", max_nfev=quick * (len(ps) + 1), diff_step=1e-4, xtol=1e-6, ftol=1e-6)
            if best is None or o.cost < best[2]:
                best = (o.fun, theta(o.x), o.cost)
        r = best[0].reshape(-1, len(cols))
        if self.free:
            r = r / self.wt
            tot = np.sqrt(((r * self.wt) ** 2).mean())
            r = r[:, :3] if self.judge == "force" else r[:, 3:]
            return np.sqrt((r ** 2).mean()), best[1], tot
        e = np.sqrt((r[self.inc[m]] ** 2).mean()); tot = np.sqrt((r ** 2).mean())
        return e, best[1], tot


class Joints:
    """joint torques of an arm or a drive: linear regression on the catalogue's joint effects"""

    def __init__(self, dir_):
        f = [x for x in os.listdir(dir_) if x.startswith("log.")][0]
        L = table.read(f"{dir_}/{f}")
        rig = tomllib.load(open(f"{dir_}/rig.toml", "rb"))
        t = L.t.to_numpy()
        self.drive = "robot" not in rig
        nq = 1 if self.drive else len([c for c in L if c[0] == "q" and c[1:].isdigit()])
        Q = L[[f"q{i+1}" for i in range(nq)]].to_numpy(); Tq = L[[f"tau{i+1}" for i in range(nq)]].to_numpy()
        dt = np.median(np.diff(t))
        win = max(.12 if not self.drive else .06, 7 * dt)
        q, v, a = (smooth(t, Q, win, k) for k in range(3))
        if self.drive:       # as short as the encoder's steps allow
            st = np.diff(np.unique(np.round(Q[:, 0], 9))); sq = max(st.min(), 1e-7) / 3.46
            N = (720 * (sq / (.01 * np.std(a) * dt * dt)) ** 2) ** .2
            win = np.clip(N * dt, max(.008, 7 * dt), .2)
            q, v, a = (smooth(t, Q, win, k) for k in range(3))
        cut = slice(5, -5, max(1, len(t) // (4000 if not self.drive else 12000)))
        t, q, v, a, Tq = t[cut], q[cut], v[cut], a[cut], Tq[cut]
        self.q, self.v, self.a, self.tau, self.t, self.n = q, v, a, Tq, t, nq
        self.rms = np.sqrt((Tq ** 2).mean())
        self.sg = np.tanh(v / (4e-3 if not self.drive else .004 * np.std(v)))
        if not self.drive:
            r = rig["robot"]
            m = arms.get("lwr", open(f"{dir_}/{r['model']}").read()) if r["model"].endswith("urdf") else arms.get(r["model"])
            m.gravity.linear = np.array(r.get("gravity", [0, 0, -9.81]))
            d = m.createData()
            self.id = np.array([pin.rnea(m, d, q[i], v[i], a[i]) for i in range(len(t))])
            z = np.zeros(nq)
            full = np.array([pin.computeJointTorqueRegressor(m, d, q[i], v[i], a[i])[:, -10:-6] for i in range(len(t))])
            grav = np.array([pin.computeJointTorqueRegressor(m, d, q[i], z, z) for i in range(len(t))])
            keep = [10 * j + k for j in range(nq) for k in (0, 1, 2, 3)]
            self.pay, self.grav = full, grav[:, :, keep]
        else:
            self.id = 0 * q

    def regs(self, e, par=None):
        """list of (K, n) per-joint columns, or joint-coupled arrays (K, n, p)"""
        q, v, a, sg = self.q, self.v, self.a, self.sg
        one = np.ones_like(q)
        return {"rigid-body": [a] if self.drive else [], "joint-coulomb-friction": [sg], "joint-viscous-friction": [v], "joint-friction-asymmetry": [np.abs(sg)],
                "joint-torque-offset": [one], "rotor-inertia": [a], "joint-torque-gain": [self.id] if not self.drive else [a],
                "joint-stribeck-friction": [sg * np.exp(-(v / (par or .1)) ** 2)], "joint-load-friction": [sg * np.abs(self.tau if self.drive else self.id)],
                "joint-torque-ripple": [f(k * (par or 1) * q) for k in (1, 2) for f in (np.sin, np.cos)], "joint-spring": [q],
                "gravity-error": [np.sin(q), np.cos(q)] if self.drive else [], "payload": [], "joint-elasticity": [a]}[e]

    GRID = {"joint-stribeck-friction": [round(.01 * 1.3 ** i, 4) for i in range(22)], "joint-torque-ripple": list(range(1, 25))}

    def thin(self, k):
        return self

    def fit(self, names, par=None, starts=None, quick=0):
        g = [n for n in names if n in self.GRID]
        if g and (par is None or g[0] not in par):
            return min((self.fit(names, {**(par or {}), g[0]: x}) for x in self.GRID[g[0]]), key=lambda o: o[0])
        if len(g) > 1 and g[1] not in par:
            return min((self.fit(names, {**par, g[1]: x}) for x in self.GRID[g[1]]), key=lambda o: o[0])
        cols = []
        for e in names:
            if e != "none":
                cols += self.regs(e, (par or {}).get(e))
        K, n = self.q.shape
        y = self.tau - self.id
        coup = [self.pay] if "payload" in names and not self.drive else []
        coup += [self.grav] if "gravity-error" in names and not self.drive else []
        if not coup:
            r = np.zeros_like(y)
            co = []
            for j in range(n):
                if cols:
                    A = np.stack([c[:, j] for c in cols], 1)
                    x = np.linalg.lstsq(A, y[:, j], rcond=1e-9)[0]
                    r[:, j] = y[:, j] - A @ x; co.append(x)
                else:
                    r[:, j] = y[:, j]
        else:
            blocks = [c.reshape(K * n, -1) for c in coup]
            for c in cols:
                B = np.zeros((K, n, n)); B[:, range(n), range(n)] = c
                blocks.append(B.reshape(K * n, n))
            A = np.concatenate(blocks, 1)[:]
            G = A.T @ A; s = np.sqrt(np.diag(G)) + 1e-9
            x = np.linalg.lstsq(G / s / s[:, None], A.T @ y.ravel() / s, rcond=1e-10)[0] / s
            r = y - (A @ x).reshape(K, n); co = x
        e = np.sqrt((r ** 2).mean())
        return e, {"par": par, "coef": co}, e


CAND_C = [e for e in EFF if e not in ("hooke", "kelvin-voigt", "hertz", "hunt-crossley", "tool-com", "tool-inertia")]
CAND_T = [e for e in CAND_C if e not in ("coulomb-friction", "viscous-friction", "stribeck-friction", "presliding", "friction-rounding", "load-dependent-friction", "friction-anisotropy", "tip-offset",
          "tool-mass", "surface-tilt", "stiffness-inhomogeneity", "sensor-crosstalk", "sensor-misalignment")]
CAND_F = ["tool-mass", "tool-com", "tool-inertia", "sensor-bias", "sensor-drift", "sensor-crosstalk", "sensor-misalignment", "sensor-gain", "sensor-lag", "time-offset", "mains-hum", "saturation"]
CAND_J = ["joint-coulomb-friction", "joint-viscous-friction", "joint-friction-asymmetry", "joint-torque-offset", "rotor-inertia", "joint-torque-gain", "payload", "joint-stribeck-friction", "joint-load-friction",
          "joint-torque-ripple", "joint-spring", "gravity-error"]
CAND_D = [e for e in CAND_J if e not in ("payload", "rotor-inertia", "joint-torque-gain")]
