"""One case of joint torques, an arm in free motion or a single drive: draws, identification motion, torque chain, log, refits.
Refits are linear in the parameters (given speeds and orders on a small grid), joint by joint where an effect is a joint's own."""
import numpy as np
from scipy.signal import savgol_filter

import motion
import sensing
from refit import Rejected, rms
from robots import G0, arm

OWN = {"joint-coulomb-friction", "joint-viscous-friction", "joint-torque-offset", "joint-friction-asymmetry", "rotor-inertia", "joint-torque-gain",
       "joint-stribeck-friction", "joint-load-friction", "joint-torque-ripple", "joint-spring"}
ALL = sorted(OWN | {"payload", "gravity-error", "time-offset", "sensor-lag"})
# start amplitude in units of a joint's scale (or SI), least, most
SPEC = {"joint-coulomb-friction": (1.0, 0.02, 12), "joint-viscous-friction": (1.0, 0.02, 12), "joint-torque-offset": (1.0, 0.02, 12),
        "joint-friction-asymmetry": (1.0, 0.02, 8), "rotor-inertia": (1.0, 0.02, 20), "joint-torque-gain": (0.05, 5e-3, 0.25),
        "joint-stribeck-friction": (1.0, 0.03, 10), "joint-load-friction": (0.03, 1e-3, 0.3), "joint-torque-ripple": (1.0, 0.03, 10),
        "joint-spring": (1.0, 0.02, 12), "payload": (0.3, 0.01, 4.0), "gravity-error": (0.03, 2e-3, 0.2)}
OUTSIDE = {"joints": ["push", "warming", "coupling", "pump"], "drive": ["drag", "pump", "push"]}


def sgn(v, v0):
    return np.clip(v / v0, -1, 1)


class JointData:
    """smoothed measured motion on thinned rows, and the columns that effects add."""

    def __init__(self, log, A, wide, limit=3500):
        t = log["t"]
        nq = A.nq if A else 1
        fs = (len(t) - 1) / (t[-1] - t[0])
        tu = np.arange(t[0], t[-1], 1 / fs)
        q = np.stack([np.interp(tu, t, log[f"q{i + 1}"]) for i in range(nq)], 1)
        keep = np.arange(3, len(t) - 3)
        if len(keep) > limit:
            keep = np.sort(np.random.default_rng(3).choice(keep, limit, replace=False))
        self.rows, self.t, self.A, self.nq = keep, t[keep], A, nq

        def smooth(k):
            w = min(max(int(round(wide * fs)) | 1, 5), len(tu) // 2 * 2 - 1)
            x = savgol_filter(q, w, 3, deriv=k, delta=1 / fs, axis=0)
            return np.stack([np.interp(self.t, tu, x[:, j]) for j in range(nq)], 1)

        self.q, self.v, self.a = smooth(0), smooth(1), smooth(2)
        self.tau0 = A.rnea(self.q, self.v, self.a) if A else np.zeros_like(self.q)
        self.load = None
        self.set(log)
        self.moving = np.abs(self.v).max(1) > 0.02
        self.step_at(2e-3)

    def step_at(self, v0):
        """speed over which a friction step is taken."""
        self.v0, self.memo = v0, {}
        return self

    def set(self, log):
        self.y = np.stack([log[f"tau{i + 1}"][self.rows] for i in range(self.nq)], 1)

    def columns(self, name, shape=None):
        """(own, shared): own (n, nq, k) columns per joint; shared (n, nq, k) with one coefficient for all joints."""
        key = (name, shape)
        if key in self.memo:
            return self.memo[key]
        q, v, a, one = self.q, self.v, self.a, np.ones_like(self.q)
        own = shared = None
        base = self.tau0 if self.load is None else self.load
        if name == "rigid-body":
            own = a[..., None] if self.A is None else None
        elif name == "joint-coulomb-friction":
            own = sgn(v, self.v0)[..., None]
        elif name == "joint-viscous-friction":
            own = v[..., None]
        elif name == "joint-torque-offset":
            own = one[..., None]
        elif name == "joint-friction-asymmetry":
            own = np.stack([np.abs(sgn(v, self.v0)), np.abs(v)], -1)
        elif name == "rotor-inertia":
            own = a[..., None]
        elif name == "joint-torque-gain":
            own = base[..., None]
        elif name == "joint-stribeck-friction":
            own = (np.exp(-(v / shape) ** 2) * sgn(v, self.v0))[..., None]
        elif name == "joint-load-friction":
            own = (np.abs(base) * sgn(v, self.v0))[..., None]
        elif name == "joint-torque-ripple":
            own = np.stack([np.sin(shape * q), np.cos(shape * q), np.sin(2 * shape * q), np.cos(2 * shape * q)], -1)
        elif name == "joint-spring":
            own = q[..., None]
        elif name in ("time-offset", "sensor-lag"):
            shared = -np.gradient(base, self.t, axis=0)[..., None]
        elif name == "payload":
            c0 = [self.A.rnea(q, v, a, extra=(1.0, x)) - self.tau0 for x in np.vstack([np.zeros(3), 0.1 * np.eye(3)])]
            shared = np.stack([c0[0]] + [c - c0[0] for c in c0[1:]], -1)
        elif name == "gravity-error":
            z = np.zeros_like(q)
            shared = np.stack([self.A.rnea(q, z, z, g=np.array(g)) for g in ([9.81, 0, 0], [0, 9.81, 0])], -1)
        self.memo[key] = (own, shared)
        return own, shared


class LinearFit:
    """least squares of the sum of columns; shapes: {(name): value or per-joint values}."""

    def __init__(self, D, names, sigma, shapes):
        self.data, self.names, self.sigma, self.shapes = D, names, sigma, shapes
        k = D.moving
        n, nq = D.y[k].shape
        own = [[] for _ in range(nq)]
        shared = []
        for name in names:
            s = shapes.get(name)
            for j in range(nq):
                sj = s[j] if s is not None and np.ndim(s) else s
                o, sh = D.columns(name, sj)
                if o is not None:
                    own[j].append(o[k][:, j])
                elif j == 0 and sh is not None:
                    shared.append(sh[k])
        y = (D.y - D.tau0)[k] / sigma
        self.own = [np.concatenate(o, 1) / sigma[j] if o else np.zeros((n, 0)) for j, o in enumerate(own)]
        Q = []
        for O in self.own:
            if O.shape[1]:
                u, s, _ = np.linalg.svd(O / (np.linalg.norm(O, axis=0) + 1e-12), full_matrices=False)
                Q.append(u[:, s > 1e-7 * s[0]])
            else:
                Q.append(O)
        self.Q = Q
        r = np.stack([y[:, j] - Q[j] @ (Q[j].T @ y[:, j]) for j in range(nq)], 1)
        if shared:
            S = np.concatenate(shared, -1) / sigma[None, :, None]
            P = np.stack([S[:, j] - Q[j] @ (Q[j].T @ S[:, j]) for j in range(nq)], 1).reshape(n * nq, -1)
            c = np.linalg.lstsq(P / (np.linalg.norm(P, axis=0) + 1e-12), r.ravel(), rcond=1e-7)[0]
            r = r - (P / (np.linalg.norm(P, axis=0) + 1e-12) @ c).reshape(n, nq)
        self.r = np.zeros_like(D.y)
        self.r[k] = r * sigma


class JointCase:
    def __init__(self, rng, plan):
        self.rng, self.plan, self.kind = rng, plan, plan["kind"]
        u, pick = rng.uniform, lambda *a: a[int(rng.integers(len(a)))]
        self.names, self.hidden = plan["model"], plan["hidden"]
        self.A = arm(plan["robot"]) if self.kind == "joints" else None
        nq = self.nq = self.A.nq if self.A else 1
        self.seed = int(rng.integers(2 ** 31))
        self.effort = self.A.effort[:nq] if self.A else np.array([float(np.exp(u(np.log(0.5), np.log(40))))])
        self.unit_ = self.effort * u(0.004, 0.009) * rng.uniform(0.7, 1.3, nq)        # a joint's friction scale
        T = u(25, 60)
        self.acq = sensing.draw_acquisition(rng, self.kind, T)
        if plan.get("long"):
            self.acq["fs"] = 100.0
        self.fs = 1000.0 if self.acq["fs"] <= 1000 else 2000.0
        self.move(plan, T)
        v = np.abs(self.dq).max(0)
        self.v_typ = np.maximum(v, 0.05)
        acts = lambda: (rng.random(nq) < 0.75) if nq > 1 and u() < 0.4 else np.ones(nq, bool)
        self.par, self.amp0 = {}, {}
        for n in self.names[1:] + self.hidden:
            m = acts() if n in self.hidden else np.ones(nq, bool)
            m[int(rng.integers(min(nq, 4)))] = True
            span = np.maximum(np.ptp(self.q, axis=0), 0.2)
            k = np.array([int(rng.integers(7, 26)) if self.kind == "joints" else int(rng.choice([1, 2, 3, 4, 6, 12]))] * nq)
            self.par[n] = dict(mask=m, s=self.unit_ * m * rng.uniform(0.6, 1.4, nq) * rng.choice([-1, 1], nq), span=span,
                               vs=float(u(0.06, 0.16)) * float(np.median(self.v_typ)) * np.ones(nq), k=k, ph=u(0, 6.28, (2, nq)),
                               com=rng.normal(size=3) * 0.05 + np.array([0, 0, 0.05]), az=u(0, 6.28), q0=rng.normal(size=nq) * 0.3)
            self.amp0[n] = SPEC[n][0] * u(0.8, 1.5)
        self.inertia = float(self.effort[0] * u(0.02, 0.05) / max(np.abs(self.ddq).max(), 0.5) * 8) if self.kind == "drive" else 0.0
        self.sigma = self.effort * float(np.exp(u(np.log(4e-4), np.log(3e-3)))) * rng.uniform(0.7, 1.4, nq)
        self.bristle = dict(kind=pick("dahl", "prandtl", "rounded"), L=float(np.exp(u(np.log(2e-5), np.log(1.5e-4)))), vr=u(5e-4, 2e-3))
        g = np.zeros(nq)
        g[int(rng.integers(nq))] = u(-0.007, 0.007)
        if nq > 1:
            g[int(rng.integers(nq))] = u(-0.007, 0.007)
        self.nu = dict(gain=g * (self.kind == "joints"), nonlin=u(-0.01, 0.01), warm=rng.normal(size=nq) * 0.15 * self.unit_, level=rng.normal(size=2) * 4e-4)
        self.outside = JointOutside(rng, plan["outside"], self) if plan.get("outside") else None
        self.shf = 1.0

    # ---- motion
    def move(self, plan, T):
        rng, u, nq = self.rng, self.rng.uniform, self.nq
        fs = self.fs
        if self.A:
            A = self.A
            lo, hi = A.qmin[:nq], A.qmax[:nq]
            mid = np.clip(A.home + rng.normal(size=nq) * 0.15, lo + 0.5, hi - 0.5)
            half = np.minimum(np.minimum(mid - lo, hi - mid) - 0.08, u(0.8, 1.5))
            vmax, amax = 0.55 * A.vmax[:nq], np.full(nq, u(4, 9))
            base = u(0.06, 0.12)
            want = plan.get("want", set())
            if "slow" in want:
                vmax, amax = 0.06 * A.vmax[:nq], np.full(nq, 0.5)
            periods = max(1.2, (T if not plan.get("long") else u(180, 260)) * base / 1.5)
            t, cmd = motion.fourier(rng, nq, base, mid, half, vmax, amax, harmonics=int(rng.integers(5, 8)), slow=u(0.3, 0.5), fs=fs, periods=periods)
        else:
            P = motion.Path(["q"], [0.0], fs=200.0)
            V = float(np.exp(u(np.log(3), np.log(12))))
            P.hold(0.3, "rest")
            turns = 2 * np.pi
            brief = u() < 0.5
            for v in (0.05 * V, 0.25 * V, V, 0.5 * V) if not brief else (0.08 * V, V, 0.35 * V):
                for s in (1, -1):
                    d = min(max(v * u(1.5, 3), 0.35 if "part" in plan.get("want", ()) else turns * 1.05), turns * 6)
                    d = min(d, v * (6 if not brief else 2))
                    P.line(d / v, "turn", blend=0.4, q=P.now[0] + s * d)
            for f in (u(0.3, 0.6), u(0.7, 1.1), u(1.3, 2.0))[brief:]:
                P.sine(max(2.5 / f, 1.5), "sine", q=[(0.4 * V / (2 * np.pi * f), f), (0.1 * V / (2 * np.pi * f), 2.3 * f)])
            P.to(1.5, "turn", q=P.now[0] + 3)
            P.hold(0.3, "rest")
            t, cmd, _ = motion.resample(P, fs)
        w = 2 * np.pi * u(4, 12) * rng.uniform(0.9, 1.1, nq)
        cmd = cmd + motion.tremor(rng, len(t), nq, 1 / fs, u(0, 2e-5 if self.A else 3e-4), 0.05)
        q, dq = motion.follow(1 / fs, cmd, w, [u(0.6, 1.0)] * nq)
        cut = int(0.8 * fs) if self.A else 0                       # the log starts when the arm already moves
        t, q, dq, cmd = t[cut:] - t[cut], q[cut:], dq[cut:], cmd[cut:]
        self.t, self.q, self.dq, self.ddq, self.cmd = t, q, dq, np.gradient(dq, 1 / fs, axis=0), cmd
        self.T = float(t[-1])
        self.t_log = sensing.sample_times(np.random.default_rng(self.seed + 1), self.T, self.acq["fs"], self.acq["jitter"], self.acq["drops"])
        if self.A:
            self.rigid = {"g": None}

    # ---- truth
    def z(self, shrink):
        """state of the friction bristles, -1 .. 1."""
        b = self.bristle
        if b["kind"] == "rounded":
            return np.tanh(self.dq / b["vr"])
        import laws
        n = len(self.t)
        out = np.zeros_like(self.q)
        zero = np.zeros(n)
        for j in range(self.nq):
            x = np.ascontiguousarray(self.q[:, j])
            T, _ = laws.tangential(dict(mu=1.0, mode=laws.DAHL if b["kind"] == "dahl" else laws.BRUSH, L=[b["L"]], w=[1.0]), self.t, x, zero, zero, zero, 1 + zero)
            out[:, j] = -T
        return out

    def truth(self, amps, shrink):
        self.off = shrink
        return {"amps": {**{n: self.amp0[n] for n in self.names[1:]}, **amps}, "shrink": shrink}

    def torque(self, amps, shrink, out):
        t, q, v, a = self.t, self.q, self.dq, self.ddq
        am = self.truth(amps, shrink)["amps"]
        g = G0.copy()
        lv = self.nu["level"] * shrink
        g[:2] += 9.81 * lv
        if "gravity-error" in am:
            P, x = self.par["gravity-error"], am["gravity-error"]
            g = 9.81 * np.array([np.sin(x) * np.cos(P["az"]), np.sin(x) * np.sin(P["az"]), -np.cos(x)])
        extra = (am["payload"], self.par["payload"]["com"]) if am.get("payload") else None
        if self.A:
            key = (tuple(g), None if extra is None else extra[0])
            if self.rigid.get("g") != key:
                self.rigid = {"g": key, "tau": self.A.rnea(q, v, a, g=g, extra=extra)}
            tau0 = self.rigid["tau"]
        else:
            tau0 = self.inertia * a
        if not hasattr(self, "bristles"):
            self.bristles = self.z(shrink)
        z = self.bristles
        tau = tau0.copy()
        for n, x in am.items():
            P = self.par[n]
            s = P["s"] * x
            if n == "joint-coulomb-friction":
                tau += np.abs(s) * z
            elif n == "joint-viscous-friction":
                tau += np.abs(s) * v / self.v_typ
            elif n == "joint-torque-offset":
                tau += s
            elif n == "joint-friction-asymmetry":
                tau += s * np.abs(z) * (1 + np.abs(v) / self.v_typ)
            elif n == "rotor-inertia":
                tau += np.abs(s) * a / np.abs(a).max(0)
            elif n == "joint-stribeck-friction":
                tau += np.abs(s) * np.exp(-(v / P["vs"]) ** 2) * z
            elif n == "joint-load-friction":
                tau += x * P["mask"] * np.abs(tau0) * z
            elif n == "joint-torque-ripple":
                tau += s * (np.sin(P["k"] * q + P["ph"][0]) + 0.3 * np.sin(2 * P["k"] * q + P["ph"][1]))
            elif n == "joint-spring":
                tau += np.abs(s) * (q - P["q0"]) / P["span"]
        if self.outside:
            tau += self.outside.torque(t, q, v, z, out)
        self.tau0 = tau0
        if "joint-torque-gain" in am:
            P = self.par["joint-torque-gain"]
            tau *= 1 + am["joint-torque-gain"] * P["mask"] * np.sign(P["s"] + 1e-12)
        return tau

    def simulate(self, amps, shrink=1.0, out=0.0, noise_scale=1.0):
        tau = self.torque(amps, shrink, out)
        full = np.abs(tau).max(0) + 1e-9
        tau = tau * (1 + self.nu["gain"] * min(shrink * 1.5, 1) + self.nu["nonlin"] * 0.3 * shrink * (tau / full) ** 2)
        if self.acq["lowpass"]:
            tau = sensing.low(tau, self.fs, self.acq["lowpass"] / max(shrink, 0.1) ** 1.2)
        held = self.acq["held"] if self.acq["held"] and shrink > 0.3 else (None, None)
        tl = self.t_log
        y = sensing.other_rate(self.t, tau, tl, *held, offset=self.acq["clock"] * shrink)
        y = y + self.nu["warm"] * (tl - tl[0])[:, None] / 60 * shrink * min(1.0, 60 / self.T)
        z = sensing.noise(np.random.default_rng(self.seed), len(tl), self.sigma * noise_scale, self.acq["coloured"])
        self.noise_rms = self.sigma * noise_scale
        y = y + z
        q = sensing.at(self.t, self.q, tl)
        step = self.acq["encoder"] if shrink > 0.25 else min(self.acq["encoder"], 5e-5)
        self.step = step
        q = sensing.encoder(q, step)
        log = {"t": tl, **{f"q{i + 1}": q[:, i] for i in range(self.nq)}}
        if self.acq["dq"] and self.kind == "joints":
            a = self.acq
            dq = sensing.at(self.t, sensing.low(self.dq, self.fs, a["dq_fc"]), tl - a["dq_lag"]) + a["dq_bias"]
            log.update({f"dq{i + 1}": np.round(dq[:, i], 7) for i in range(self.nq)})
        log.update({f"tau{i + 1}": np.round(y[:, i], 6) for i in range(self.nq)})
        return log

    def rig(self, shrink=1.0):
        if not self.A:
            return {}
        r = {"robot": {"model": self.A.name, "sensor_frame": self.A.sensor, "tip_frame": self.A.tip}}
        if self.A.name == "panda":
            r["robot"]["joints"] = self.A.joint_names
        return r

    # ---- refits (the interface of tune.run)
    def milder(self, D, f, shrink, by):
        return shrink * by

    def same(self, D, shrink):
        return getattr(D, "step", None) == self.step

    def data(self, log, rig, D=None):
        if D is None:
            best = np.inf
            for wide in (0.03, 0.07, 0.14, 0.25):                    # the smoothing that serves the full model best
                E = JointData(log, self.A, wide)
                for v0 in (5e-4, 2e-3, 8e-3):
                    c = rms(self.fit(E.step_at(v0), self.names + self.hidden, self.weights(E), None).r / self.sigma)
                    if c < best:
                        best, D, v = c, E, v0
            D.step_at(v)
            D.step = self.step
        else:
            D.set(log)
        return D

    def unquantized(self, D):
        return D

    def weights(self, D, f=None):
        return np.maximum(self.noise_rms, rms_cols(f.r[D.moving])) if f is not None else np.sqrt(self.noise_rms ** 2 + (0.005 * rms_cols(D.y)) ** 2)

    def shapes(self, names):
        s = {}
        if "joint-stribeck-friction" in names:
            s["joint-stribeck-friction"] = self.par["joint-stribeck-friction"]["vs"]
        if "joint-torque-ripple" in names:
            s["joint-torque-ripple"] = self.par["joint-torque-ripple"]["k"]
        return s

    def start(self, p):
        return {}

    def restart(self, h, q):
        return {}

    def fit(self, D, names, sigma, p, start=None):
        f = LinearFit(D, names, sigma, self.shapes(names))
        f.p = {}
        return f

    def start_amplitude(self, h):
        return self.amp0[h]

    def bounds(self, h):
        return SPEC[h][1:3]

    def acting(self, h):
        if h in self.par and h in OWN:
            return np.flatnonzero(self.par[h]["mask"])
        return np.arange(self.nq)

    def metric(self, D, names, r):
        return r[D.moving][:, self.acting(names[0])].ravel()

    def groups(self, D, names):
        return [tuple(self.acting(names[0])), tuple(range(self.nq))]

    def group_values(self, D, r, group):
        c = list(group)
        return r[D.moving][:, c], D.y[D.moving][:, c], rms(self.noise_rms[c])

    def near(self, fr, h, limit, D, others):
        out = []
        for c in others:
            if self.A is None and c in ("payload", "gravity-error", "rotor-inertia", "joint-load-friction", "joint-torque-gain"):
                continue
            grids = {"joint-stribeck-friction": [0.03, 0.08, 0.2, 0.4], "joint-torque-ripple": [4, 8, 12, 16, 24] if self.A else [1, 2, 3, 4, 6, 12]}.get(c, [None])
            for s in grids:
                sh = dict(fr.shapes)
                if s is not None:
                    sh[c] = s
                if rms(self.metric(D, [h], LinearFit(D, fr.names + [c], fr.sigma, sh).r)) < limit:
                    out.append(c)
                    break
        return out

    def candidates(self, D):
        return ALL

    def unit(self, hidden):
        return "N*m"

    def nuisances(self, shrink, noise):
        a, nu = self.acq, self.nu
        return {"noise": self.noise_rms, "coloured": a["coloured"], "encoder": self.step, "rate": a["fs"], "jitter": a["jitter"], "drops": a["drops"],
                "lowpass_hz": a["lowpass"] / max(shrink, 0.1) ** 1.2 if a["lowpass"] else 0.0, "held": a["held"] if shrink > 0.3 else None,
                "clock": a["clock"] * shrink, "gain": nu["gain"] * min(shrink * 1.5, 1), "nonlinearity": nu["nonlin"] * 0.3 * shrink,
                "warming": nu["warm"] * shrink, "level": nu["level"] * shrink, "friction_at_rest": self.bristle, "shrink": shrink, "noise_scale": noise,
                "robot": self.A.name if self.A else None, "dq": bool(a["dq"]) and self.kind == "joints", "dq_bias": a["dq_bias"], "dq_lag": a["dq_lag"]}

    def parameters(self, amps, p, out):
        d = {}
        for n, x in p["amps"].items():
            P = self.par[n]
            e = {"amplitude": float(x), "joints": [int(i) + 1 for i in np.flatnonzero(P["mask"])]}
            if n in ("joint-coulomb-friction", "joint-torque-offset", "joint-torque-ripple", "joint-stribeck-friction", "joint-friction-asymmetry"):
                e["per_joint"] = x * P["s"]
            if n == "joint-viscous-friction":
                e["per_joint"] = np.abs(x * P["s"]) / self.v_typ
            if n == "rotor-inertia":
                e["per_joint"] = np.abs(x * P["s"]) / np.abs(self.ddq).max(0)
            if n == "joint-spring":
                e["per_joint"] = np.abs(x * P["s"]) / P["span"]
            if n == "joint-torque-gain":
                e["per_joint"] = x * P["mask"] * np.sign(P["s"] + 1e-12)
            e.update({k: P[k] for k in {"joint-stribeck-friction": ["vs"], "joint-torque-ripple": ["k"], "payload": ["com"], "gravity-error": ["az"]}.get(n, [])})
            d[n] = e
        if self.kind == "drive":
            d["inertia"] = self.inertia
        if self.outside:
            d["outside"] = {"what": self.outside.name, "amplitude": float(out)}
        return d


class JointOutside:
    """torques that no name stands for; a in N.m on the strongest joint (warming: share of the friction)."""

    def __init__(self, rng, name, case):
        u = rng.uniform
        self.name, self.case = name, case
        self.START = {name: float(case.effort.max() * 0.02)}
        T = case.T
        k = max(3, int(T / u(5, 8)))
        self.at = np.sort(u(0.05 * T, 0.9 * T, k))
        self.width = u(0.5, 1.6, k)
        self.force = rng.normal(size=(k, 3))
        self.scale = case.effort / case.effort.max() * rng.uniform(0.6, 1.4, case.nq)
        self.f, self.ph = u(1.1, 4.5), u(0, 6.28, case.nq)
        self.mix = rng.normal(size=(case.nq, case.nq)) * (1 - np.eye(case.nq)) * (rng.random((case.nq, case.nq)) < 0.4)
        self.tau = u(0.2, 0.4) * T

    def windows(self, t):
        return np.stack([np.exp(-0.5 * ((t - b) / (w / 2.5)) ** 4) for b, w in zip(self.at, self.width)], 1)

    def torque(self, t, q, v, z, a):
        c = self.case
        if self.name == "push" and c.A:
            if not hasattr(self, "J"):
                self.J = c.A.tip_jacobian(q)
            f = self.windows(t) @ self.force
            return a * np.einsum("nij,ni->nj", self.J, f)
        if self.name == "push":
            return a * (self.windows(t) @ self.force[:, :1])
        if self.name == "drag":
            return a * np.abs(self.windows(t) @ np.abs(self.force[:, :1])) * z
        if self.name == "warming":
            return a * self.scale * z * np.exp(-t / self.tau)[:, None] * (1 + 0.5 * np.abs(v) / c.v_typ)
        if self.name == "coupling":
            return a * self.scale * (np.sin(1.7 * (q - q.mean(0))) @ self.mix.T)
        s = np.sin(2 * np.pi * self.f * t[:, None] + self.ph) + 0.4 * np.sin(4 * np.pi * self.f * t[:, None] + 2 * self.ph)
        return a * self.scale * s


def rms_cols(x):
    return np.sqrt(np.mean(x ** 2, 0))
