"""Joint-torque logs: free arms and drives. World, log, linear refit."""
import os, shutil
import numpy as np
from scipy.signal import butter, sosfilt, sosfiltfilt, lfilter
import joints as J
import refit
from chain import rnea_many
from effects import U, LU, sign, unit
from io_log import write_log, toml
from wrench import robot, HERE
from chain import rotvec

AMPS = {"joint-coulomb-friction": "fc", "joint-viscous-friction": "fv", "joint-friction-asymmetry": "fa", "joint-stribeck-friction": "fs", "joint-load-friction": "fl",
        "joint-torque-offset": "fo", "rotor-inertia": "B", "joint-spring": "ks", "joint-torque-ripple": "rA", "joint-elasticity": "K", "joint-torque-gain": "gain",
        "payload": "payload", "gravity-error": "tilt"}
ALL = list(AMPS)
# typical sizes at the big joints (N m, N m s/rad, kg m2, ...) and the range of the amplitude about them
TYP = dict(fc=2.5, fv=4., fa=1.5, fs=2., fl=.05, fo=1.5, B=.6, ks=2., rA=.8, gain=.05, payload=.6, tilt=.04, K=1.)


class Torque:
    def __init__(self, seed, plan):
        self.seed, self.plan = seed, plan
        self.kind = plan["kind"]
        self.model, self.hidden, self.group, self.targets = plan["model"], plan["hidden"], plan["group"], plan["targets"]
        self.names = self.model + self.hidden
        self.outside = plan.get("outside")
        self.out_A = 1.0
        rng = np.random.default_rng(seed)
        self.soft, self.noise = 1.0, 1.0
        drive = self.drive = self.kind == "drive"
        has = lambda e: e in self.names
        self.n = 1 if drive else 7
        if drive:
            self.size = np.ones(1) * LU(rng, .05, 2.)
            self.inertia = self.size[0] * LU(rng, .02, .12)
            self.vmax = np.array([LU(rng, 3, 15)])
            self.lo, self.hi = -np.ones(1) * U(rng, 3, 12), np.ones(1) * U(rng, 3, 12)
        else:
            self.robot = str(rng.choice(["lwr4plus", "iiwa"]))
            self.ch = robot(self.robot)
            self.size = J.SIZE * LU(rng, .6, 1.4)
            self.vmax = np.minimum(self.ch.vmax, 1.9) * U(rng, .6, 1)
            self.lo, self.hi = .8 * self.ch.lo, .8 * self.ch.hi
            self.tool = (U(rng, .3, 2.5), np.array([U(rng, -.02, .02), U(rng, -.02, .02), U(rng, .03, .09)])) if rng.random() < .65 or has("payload") and rng.random() < .4 else None
            self.g = np.array([0, 0, -9.81])
            if rng.random() < .12:
                self.g = np.array([9.81, 0, 0]) * sign(rng)
        self.p = {}
        draws = {}
        for e in self.names[1:]:
            draws[e] = self._draw(e, rng)
        self.amps = [draws[e] for e in self.hidden]
        self.extra = [draws[e] for e in self.model[1:]]
        on = lambda q=.6: rng.random() < q
        q = self.nuis = {}
        q["encoder"] = LU(rng, 2e-6, 1e-3) if drive else LU(rng, 2e-6, 4e-4)
        q["dq"] = bool(rng.random() > .25) and not drive
        q["dq_bias"], q["dq_lag"], q["dq_fc"], q["dq_noise"] = unit(rng, self.n) * U(rng, 0, 2e-4), U(rng, 0, 5e-3), LU(rng, 15, 100), LU(rng, 2e-4, 3e-3)
        q["lowpass"] = str(rng.choice(["none", "causal", "zero-phase"], p=[.4, .25, .35]))
        q["lowpass_Hz"] = U(rng, 25, 50) if q["lowpass"] == "causal" else U(rng, 5, 25)
        q["torque_rate"] = str(rng.choice(["same", "held", "interpolated"], p=[.55, .2, .25]))
        q["torque_Hz"] = float(rng.choice([100, 125, 200, 250]))
        q["clock"] = U(rng, -3e-4, 3e-4) if on() else 0.
        q["mass"] = U(rng, -.015, .015) if on() else 0.
        q["com"] = unit(rng) * U(rng, 0, 8e-4) if on() else np.zeros(3)
        q["tilt"] = unit(rng) * U(rng, 0, 1e-3) if on() and not has("gravity-error") else np.zeros(3)
        q["nonlin"] = U(rng, -.006, .006) if on(.4) else 0.
        q["colour"], q["colour_tau"] = (U(rng, .2, .6) if on(.6) else 0.), LU(rng, .01, .3)
        q["jitter"] = U(rng, .02, .12) if on(.25) else 0.
        q["drops"] = U(rng, .001, .02) if on(.25) else 0.
        q["bristle"], q["bristle_rad"] = ["Dahl", "Prandtl"][int(rng.integers(0, 2))], LU(rng, 3e-4, 1.2e-3)
        self.rate = float(plan.get("rate") or rng.choice([100, 250, 500, 1000]))
        if has("joint-elasticity"):
            self.rate = max(self.rate, 250.)
            q["encoder"] = min(q["encoder"], 3e-5)
        T = plan.get("T") or U(rng, 25, 55) * (1 if not drive else .7)
        o = {}
        if has("joint-elasticity") or has("rotor-inertia"):
            o["share"] = [("fourier", 1.0), ("fourier", 1.0), ("strokes", 1.0), ("fourier", .4)]
        if has("joint-torque-ripple"):
            o["share"] = [("strokes", .3), ("fourier", 1.0), ("fourier", .4)]
        if has("joint-stribeck-friction"):
            o["share"] = [("strokes", .25), ("fourier", .15), ("fourier", 1.0), ("fourier", .4)]
        if self.outside == "warm-up":
            o["share"] = [("fourier", 1.0), ("fourier", .6)] * 3
        t, x = J.excite(rng, self.lo, self.hi, self.vmax, T, o)
        self.dt = 5e-4 if T < 120 else 1e-3
        self.t, self.Qd, self.dQd, self.ddQd = J.sampled(t, x, self.dt)
        w = 2 * np.pi * LU(rng, 3, 8)
        self.kp, self.kd = w * w, 2 * U(rng, .6, 1.) * w
        if not drive:
            self.kp = np.array([2500, 2500, 1600, 1600, 500, 250, 120]) * LU(rng, .4, 2.5)
            self.kd = U(rng, .04, .08) * self.kp ** .5 * np.array([25, 25, 15, 15, 6, 3, 1.5]) ** .5 * 4
        sos = butter(2, [3, 12], "bandpass", fs=1 / self.dt, output="sos")
        s = sosfilt(sos, rng.standard_normal((len(self.t), self.n)), axis=0)
        self.shake = s / s.std(0) * self.size * LU(rng, .003, .04)
        self.sd = self.size * (LU(rng, .12, .35) if not drive else LU(rng, .008, .02))
        for e, f in (("joint-elasticity", .35), ("joint-stribeck-friction", .5), ("joint-load-friction", .6)):
            if e in self.hidden:
                self.sd = self.sd * f
        self.logseed, self.out_rng = int(rng.integers(1 << 30)), int(rng.integers(1 << 30))

    def _draw(self, e, rng):
        n = self.n
        k = AMPS[e]
        who = np.ones(n)
        if n > 1:
            who = (rng.random(n) > .15) * rng.uniform(.6, 1.4, n)
            who[1] = who[3] = U(rng, .8, 1.4)
        a = dict(name=e, key=k, A=TYP[k] * (1 if n > 1 else .12), lo=TYP[k] * .02, hi=TYP[k] * 12, who=who, stage="sim")
        if k in ("fa", "fo", "ks", "gain"):
            a["who"] = who * rng.choice([-1, 1], n)
        if k == "vs" or k == "fs":
            a["vs"] = LU(rng, .08, .25) * (1 if n > 1 else 3)
        if k == "rA":
            a["rk"] = rng.integers(3, 13, n).astype(float) if n > 1 else np.array([float(rng.integers(3, 25))])
            a["rp"] = rng.uniform(0, 6.28, n)
        if k == "payload":
            a["com"] = np.array([U(rng, -.04, .04), U(rng, -.04, .04), U(rng, .03, .12)])
        if k == "tilt":
            v = rng.normal(size=3)
            v -= v @ self.g * self.g / (self.g @ self.g)      # leaning, not turning about the vertical
            a["axis"] = v / np.linalg.norm(v)
        if k == "gain":
            a["hi"] = .4
        if k == "tilt":
            a["hi"] = .35
        if k == "fl":
            a["hi"] = .35
        if k == "payload":
            a["hi"] = 6.
        if k == "K":                                        # A scales the compliance of joints 2 and 4
            a["who"] = np.array([0, 1 / 9000, 0, 1 / 6000, 0, 0, 0])[:n]
            a["lo"], a["hi"] = .1, 12.
        return a

    def resim(self):
        n = self.n
        p = np.zeros((len(J.FR), n))
        p[4] = .05
        row = {k: i for i, k in enumerate(J.FR)}
        self.gain, self.tiltv, self.pay, self.comp = np.zeros(n), np.zeros(3), None, np.zeros(n)
        for a in self.extra + self.amps:
            k, A = a["key"], a["A"]
            if k == "gain":
                self.gain = np.clip(A * a["who"], -.5, .5)
            elif k == "tilt":
                self.tiltv = A * a["axis"]
            elif k == "payload":
                self.pay = (A, a["com"])
            elif k == "K":
                self.comp = A * a["who"]
            else:
                s = self.size if k != "fl" else np.ones(n)
                if k == "B":
                    s = self.size if n > 1 else np.ones(1) * self.inertia
                p[row[k]] = A * a["who"] * s
                if k == "fs":
                    p[4] = a["vs"]
                if k == "rA":
                    p[10], p[11] = a["rk"], a["rp"]
        self.pm = p
        kind = 0 if self.nuis["bristle"] == "Dahl" else 1
        L = self.nuis["bristle_rad"] * (1 if n > 1 else 3)
        wear = np.ones(len(self.t)); push = np.zeros((len(self.t), n))
        rg = np.random.default_rng(self.out_rng)
        if self.outside == "warm-up":      # the grease gets warm, friction goes down as the log runs, back up in a pause
            wear = 1 - min(.85, .45 * self.out_A) * (1 - np.exp(-self.t / (self.t[-1] * U(rg, .2, .4))))
        if self.outside == "pump":         # a load with a clock of its own
            f = U(rg, .35, .9)
            push[:] = (self.out_A * .25 * self.size * (np.sin(2 * np.pi * f * self.t) + .4 * np.sin(4 * np.pi * f * self.t + 1))[:, None])
        if n == 1:
            self.Q, self.dQ, self.T = J.run_drive(self.inertia, self.Qd, self.dQd, self.ddQd, self.dt, p, kind, L, self.kp, self.kd, self.shake, wear, push)
            return
        nominal = self.ch.with_tool(*self.tool) if self.tool else self.ch
        true = nominal
        if self.pay:
            true = true.with_tool(*self.pay)
        g = rotvec(self.soft * self.nuis["tilt"] + self.tiltv) @ self.g
        el = np.where(self.comp > 0, 1 / np.maximum(self.comp, 1e-9), 0.)
        c = self.ch
        self.Q, self.dQ, self.ddQ, self.T = J.run_arm(*c.args(), true.m, true.c, true.I, nominal.m, nominal.c, nominal.I, g, self.g, self.Qd, self.dQd, self.ddQd, self.dt,
                                                      p, kind, L, self.kp, self.kd, self.shake, el, wear, push)
        if not np.isfinite(self.Q).all() or np.abs(self.Q - self.Qd).max() > 1.0:
            raise RuntimeError("lost")

    def ease(self):
        self.nuis["encoder"] *= .5
        return False

    def stated(self):
        if self.drive or not self.tool:
            return None
        return round(float(self.tool[0] * (1 + self.soft * self.nuis["mass"])), 4), np.round(self.tool[1] + self.soft * self.nuis["com"], 5)

    def build(self):
        rng = np.random.default_rng(self.logseed)
        q, s, t = self.nuis, self.soft, self.t
        tau = self.T * (1 + self.gain)
        if q["nonlin"]:
            tau = tau + s * q["nonlin"] * tau * np.abs(tau) / np.abs(tau).max(0).clip(1e-6)
        fs = 1 / self.dt
        if q["lowpass"] == "causal":
            tau = refit.lagged(t, tau, s / (2 * np.pi * q["lowpass_Hz"]))
        if q["lowpass"] == "zero-phase" and "joint-elasticity" not in self.names:
            tau = sosfiltfilt(butter(2, q["lowpass_Hz"] / s, fs=fs, output="sos") if q["lowpass_Hz"] / s < .4 * fs else butter(2, .4 * fs, fs=fs, output="sos"), tau, axis=0)
        n = int(t[-1] * self.rate)
        tk = np.arange(n) / self.rate
        if q["jitter"]:
            tk = np.clip(tk + rng.normal(size=n) * q["jitter"] / self.rate / 3, 0, t[-1])
        I = lambda tt, M: np.column_stack([np.interp(tt, t, M[:, i]) for i in range(M.shape[1])])
        noise = self.noise * self.sd
        if q["torque_rate"] == "same" or q["torque_Hz"] >= self.rate:
            y = I(tk - s * q["clock"], tau)
            e = rng.normal(size=y.shape)
            if q["colour"]:
                a = np.exp(-1 / (self.rate * q["colour_tau"]))
                e = np.sqrt(1 - q["colour"] ** 2) * e + q["colour"] * np.sqrt(1 - a * a) * lfilter([1], [1, -a], rng.normal(size=y.shape), axis=0)
            y = y + e * noise
        else:
            tr = np.arange(0, t[-1], 1 / q["torque_Hz"])
            yr = I(tr - s * q["clock"], tau) + rng.normal(size=(len(tr), self.n)) * noise
            if q["torque_rate"] == "held":
                y = yr[np.clip(np.searchsorted(tr, tk + (1 - s) * .5 / q["torque_Hz"], side="right") - 1, 0, len(tr) - 1)]
            else:
                y = np.column_stack([np.interp(tk, tr, yr[:, i]) for i in range(self.n)])
        Q = np.round((I(tk, self.Q) + rng.normal(size=(n, self.n)) * .3 * q["encoder"]) / q["encoder"]) * q["encoder"]
        sos = butter(1, min(q["dq_fc"], .4 * fs), fs=fs, output="sos")
        V = I(tk - q["dq_lag"], sosfilt(sos, self.dQ, axis=0)) + q["dq_bias"] + rng.normal(size=Q.shape) * q["dq_noise"]
        keep = np.ones(n, bool)
        if q["drops"]:
            keep = rng.random(n) > q["drops"]
        return [v[keep] for v in (tk, Q, V, y)]

    def noise_rms(self):
        return refit.rms(self.noise * self.sd), 1.0

    # ------------------------------------------------------------ the refit: linear in all but a few grids
    def data(self):
        self.logged = t, Q, V, y = self.build()
        fc = 12. if self.nuis["encoder"] < 1e-4 else 7.
        if "joint-elasticity" in self.names:
            fc = 25.
        g, S, dS, fs = refit.on_grid(t, Q, fc)
        ddS = np.gradient(dS, 1 / fs, axis=0)
        Ts = refit.smooth(np.column_stack([np.interp(g, t, y[:, i]) for i in range(self.n)]), fs, min(fc, 25.))
        Z = J.plain_bristle(S, self.nuis["bristle_rad"] * (1 if self.n > 1 else 3), 0 if self.nuis["bristle"] == "Dahl" else 1)
        step = max(1, int(np.ceil(len(t) / 5000)))
        tk = t[::step]
        I = lambda M: np.column_stack([np.interp(tk, g, M[:, i]) for i in range(self.n)])
        D = dict(t=tk, q=I(S), dq=I(dS), ddq=I(ddS), z=I(Z), y=y[::step], ts=I(Ts), sd=self.noise * self.sd)
        if self.n > 1:
            st = self.stated()
            ch = self.ch.with_tool(*st) if st else self.ch
            self.fitchain = ch
            D["rb"] = rnea_many(*ch.dyn(), D["q"], D["dq"], D["ddq"], self.g)
            T2 = np.gradient(Ts, 1 / fs, axis=0)
            D["ts1"], D["ts2"] = I(T2), I(np.gradient(T2, 1 / fs, axis=0))
        else:
            D["rb"] = np.zeros_like(D["q"])
        k = np.abs(D["dq"]) > .02 * np.abs(D["dq"]).max(0)
        D["moving"] = k.any(1)
        D["cache"] = {}
        return D, None

    def cols(self, D, e, **kw):
        key = (e, tuple(sorted(kw.items())))
        if key in D["cache"]:
            return D["cache"][key]
        n, N = self.n, len(D["t"])
        eye = np.eye(n)[:, None, :]
        per = lambda X: list(eye * X[None])
        if e == "rigid-body":
            out = [D["ddq"]] if n == 1 else []
        elif e == "joint-coulomb-friction":
            out = per(D["z"])
        elif e == "joint-viscous-friction":
            out = per(D["dq"])
        elif e == "joint-friction-asymmetry":
            out = per(np.abs(D["z"]))
        elif e == "joint-stribeck-friction":
            out = per(D["z"] * np.exp(-(D["dq"] / kw.get("vs", .08)) ** 2))
        elif e == "joint-load-friction":
            # the load is what the model says the gears transmit; the measured torque would explain itself
            out = per(np.abs(D["rb"] if n > 1 else D["ddq"]) * D["z"])
        elif e == "joint-torque-offset":
            out = per(np.ones((N, n)))
        elif e == "rotor-inertia":
            out = per(D["ddq"]) if n > 1 else []
        elif e == "joint-spring":
            out = per(D["q"])
        elif e == "joint-torque-ripple":
            k = np.array(kw.get("k", (6.,) * n))
            out = [c for h in (1, 2) for f in (np.sin, np.cos) for c in per(f(h * k * D["q"]))]
        elif e == "joint-torque-gain":
            out = per(D["rb"])
            if n == 1:
                out = []
        elif e == "payload":
            out = []
            zero = self.ch.m * 0
            for i in range(4):
                m, c, I = zero.copy(), self.ch.c * 0, self.ch.I * 0
                v = np.zeros(3)
                if i:
                    v[i - 1] = 1.
                m[-1], c[-1] = 1., v
                I[-1] = -(v @ v * np.eye(3) - np.outer(v, v))
                out.append(rnea_many(*self.ch.args(), m, c, I, D["q"], D["dq"], D["ddq"], self.g))
            out = [out[0]] + [o - out[0] for o in out[1:]]
        elif e == "gravity-error":
            z = np.zeros_like(D["q"])
            c = self.fitchain
            out = [rnea_many(*c.dyn(), D["q"], z, z, v) for v in np.eye(3)]
        elif e == "joint-elasticity":
            out = []
            if n > 1:
                c = self.fitchain
                for j in range(n):
                    h = 1e-4 / max(1e-6, refit.rms(D["ts"][:, j]))
                    u = np.zeros_like(D["q"]); u1 = u.copy(); u2 = u.copy()
                    u[:, j], u1[:, j], u2[:, j] = D["ts"][:, j], D["ts1"][:, j], D["ts2"][:, j]
                    out.append((rnea_many(*c.dyn(), D["q"] - h * u, D["dq"] - h * u1, D["ddq"] - h * u2, self.g) - D["rb"]) / h)
        else:
            raise KeyError(e)
        D["cache"][key] = out
        return out

    def grids(self, e):
        if e == "joint-stribeck-friction":
            s = 1 if self.n > 1 else 3
            tr = [a["vs"] for a in self.amps + self.extra if a["key"] == "fs"]
            return [dict(vs=v) for v in (tr or [])] + [dict(vs=v * s) for v in (.04, .1, .25)]
        if e == "joint-torque-ripple":
            tr = [tuple(a["rk"]) for a in self.amps + self.extra if a["key"] == "rA"]
            return [dict(k=k) for k in tr] if tr else [dict(k=(v,) * self.n) for v in (1., 2., 4., 6., 9.)]
        return [{}]

    def lsq(self, D, names, fixed={}):
        """Least squares over whitened joints, nonlinear parameters from small grids. Returns prediction and the grid taken."""
        best = None
        free = [e for e in names if len(self.grids(e)) > 1 and e not in fixed]
        pick = {e: fixed.get(e, self.grids(e)[0]) for e in names}
        for e in free or [None]:
            for gp in (self.grids(e) if e else [None]):
                if e:
                    pick = {**pick, e: gp}
                C = [c for x in names for c in self.cols(D, x, **pick[x])]
                r, k = ((D["y"] - D["rb"]) / D["sd"]).ravel(), []
                A = np.array([(c / D["sd"]).ravel() for c in C]) if C else np.zeros((0, r.size))
                H = A @ A.T
                if len(A):
                    H[np.diag_indices_from(H)] *= 1 + 1e-9
                    H[np.diag_indices_from(H)] += 1e-11 * np.trace(H)
                    k = np.linalg.solve(H, A @ r)
                    r = r - k @ A
                c = r @ r
                if best is None or c < best[0]:
                    self.sol = (dict(pick), k)
                    best = (c, D["y"] - r.reshape(D["y"].shape) * D["sd"], dict(pick))
        return best[1], best[2]

    def sizes(self, D, quant=None):
        names = self.names
        w, pick = self.lsq(D, names)
        self.coefficients = self._named(D, names)
        m = D["moving"]
        left = refit.rms((D["y"] - w)[m])
        res = dict(w=w, each=[], names=names, fit=(left, 0.), reading=(refit.rms(D["y"][m]), 0.))
        for h in self.hidden:
            nb = [x for x in names if x != h]
            wb, _ = self.lsq(D, nb, {k: v for k, v in pick.items() if k != h})
            eff = refit.rms((w - wb)[m])
            res["each"].append(dict(effect=h, group="torque", effect_rms=eff, left_rms=left, ratio=eff / left, names=nb, w=wb))
        return res

    def _named(self, D, names):
        """The last fit's coefficients by the names of values.py."""
        pick, k = self.sol
        per = {"joint-coulomb-friction": "coulomb", "joint-viscous-friction": "viscous", "joint-friction-asymmetry": "asymmetry", "joint-load-friction": "load",
               "joint-torque-offset": "offset", "joint-spring": "stiffness", "rotor-inertia": "inertia", "joint-elasticity": "compliance", "joint-torque-gain": "gain",
               "joint-stribeck-friction": "stribeck"}
        out, i = {}, 0
        for e in names:
            n = len(self.cols(D, e, **pick[e]))
            if e in per:
                out.update({f"{e}.{per[e]}[{j}]": float(x) for j, x in zip(["joint_1"] if self.drive else self.ch.names, k[i:i + n])})
            if e == "payload":
                out["payload.mass"] = float(k[i])
            if e == "rigid-body" and self.drive:
                out["rigid-body.inertia[joint_1]"] = float(k[i])
            i += n
        return out

    def near(self, D, names, limit, pick=None):
        out, alls = [], []
        for e in ALL:
            if e in names or e in self.hidden:
                continue
            if self.n == 1 and e in ("payload", "gravity-error", "joint-torque-gain", "joint-elasticity", "rotor-inertia"):
                continue
            w, _ = self.lsq(D, names + [e])
            v = refit.rms((D["y"] - w)[D["moving"]])
            alls.append((e, v))
            if v <= limit:
                out.append(e)
        return out, alls

    # ------------------------------------------------------------ out
    def write(self, folder, rng):
        t, Q, V, y = self.logged
        cols = {"t": t}
        for i in range(self.n):
            cols[f"q{i+1}"] = Q[:, i]
        if self.nuis["dq"]:
            for i in range(self.n):
                cols[f"dq{i+1}"] = V[:, i]
        for i in range(self.n):
            cols[f"tau{i+1}"] = y[:, i]
        name = write_log(folder, cols, rng)
        doc = {}
        if not self.drive:
            rob = dict(model="lwr4plus" if self.robot == "lwr4plus" else "iiwa.urdf", sensor_frame="ft_sensor", tip_frame="tool_tip")
            if self.robot != "lwr4plus":
                shutil.copy(os.path.join(HERE, "models", self.robot + ".urdf"), os.path.join(folder, "iiwa.urdf"))
                rob["joints"] = self.ch.names
            if abs(self.g[2] + 9.81) > 1e-9:
                rob["gravity"] = self.g
            doc["robot"] = rob
            if self.tool:
                m, c = self.stated()
                doc["tool"] = dict(mass=m, com=c)
        toml(os.path.join(folder, "rig.toml"), doc)
        return name, float(t[-1] - t[0])

    def nuisances(self):
        n = {k: (v.tolist() if isinstance(v, np.ndarray) else v) for k, v in self.nuis.items()}
        n.update(scale=self.soft, rate_Hz=self.rate, noise_Nm=(self.noise * self.sd).tolist(), **({} if self.drive else {"robot": self.robot}))
        return n

    def parameters(self):
        p = {k: self.pm[i].tolist() for i, k in enumerate(J.FR[:-1]) if self.pm[i].any() and (k != "vs" or self.pm[3].any())}
        if self.gain.any():
            p["gain"] = self.gain.tolist()
        if self.tiltv.any():
            p["tilt"] = self.tiltv.tolist()
        if self.pay:
            p["payload"] = dict(mass=self.pay[0], com_in_sensor_frame=self.pay[1].tolist())
        if self.comp.any():
            p["compliance_rad_per_Nm"] = self.comp.tolist()
        if self.drive:
            p["inertia"] = self.inertia
        p["amplitude"] = {a["name"]: a["A"] for a in self.amps}
        if self.outside:
            p.update(outside=self.outside, outside_amplitude=self.out_A)
        return p
