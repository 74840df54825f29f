"""A material tester: a position-servoed crosshead (and a sliding table) against the material, own semi-implicit Euler integrator at 4 kHz."""
import numpy as np
from numba import njit
from scipy.signal import butter, sosfilt, lfilter
import laws, motion, refit, effects
from laws import contact, NS
from effects import U, LU, sign
from io_log import write_log
import os


@njit(cache=True)
def servo(P, C, t, cmd, w, zeta, mass, shake):
    """cmd: depth, x, y (n,3). Returns travel, rates, forces (normal, two tangential)."""
    n = len(t)
    X = np.zeros((n, 3)); V = np.zeros((n, 3)); F = np.zeros((n, 3))
    S = np.zeros(16)
    x = cmd[0].copy(); v = np.zeros(3); a = np.zeros(3)
    S[8] = x[0]
    N = 0.0
    for k in range(n):
        dt = t[1] - t[0]
        N, T1, T2 = contact(P, S, dt, t[k], x[0] - C * N, v[0], x[1], x[2], v[1], v[2])
        X[k] = x; V[k] = v
        F[k, 0] = N; F[k, 1] = T1; F[k, 2] = T2
        for i in range(3):
            vc = (cmd[k + 1, i] - cmd[k, i]) / dt if k + 1 < n else 0.0
            load = -N if i == 0 else (T1 if i == 1 else T2)
            a[i] = w * w * (cmd[k, i] - x[i]) + 2 * zeta * w * (vc - v[i]) + load / mass + shake[k, i]
        for i in range(3):
            v[i] += a[i] * dt
            x[i] += v[i] * dt
    return X, V, F


class Tester:
    kind = "tester"

    def __init__(self, seed, plan):
        self.seed, self.plan = seed, plan
        self.model, self.hidden, self.group, self.targets = plan["model"], plan["hidden"], plan["group"], plan["targets"]
        self.names = self.model + self.hidden
        rng = np.random.default_rng(seed)
        self.soft, self.noise, self.Ldev = 1.0, 1.0, 0.0
        self.base, self.outside, self.out_A = self.model[0], plan.get("outside"), 1.0
        self.out_rng = int(rng.integers(1 << 30))
        n0 = self.n0 = refit.EXPONENT[self.base]
        has = lambda e: e in self.names
        tang = any(refit.GROUP.get(e) == "tang" for e in self.names)
        self.slide = tang
        self.moves = tang or has("stiffness-inhomogeneity")
        self.Fmax, self.dmax = LU(rng, 5, 60), U(rng, 1.5e-3, 6e-3)
        self.D0 = .6 * self.dmax
        ctx = dict(Fmax=self.Fmax, dmax=self.dmax, k=self.Fmax / self.dmax, base=self.base, n0=n0, mass=1., tester=True, reach=.012, mains=float(rng.choice([50, 60])))
        self.law = dict(F0=self.Fmax * .6 ** n0, D0=self.D0, N0=.4 * self.Fmax, n=n0, s1=2e-4)
        if has("kelvin-voigt"):
            self.law["c"] = U(rng, .5, 4) * self.Fmax
        if has("hunt-crossley"):
            self.law["lam"] = U(rng, .8, 5)
        if has("coulomb-friction"):
            self.law["mu"] = LU(rng, .1, .6)
        if set(self.hidden) & {"friction-anisotropy", "load-dependent-friction", "presliding"}:
            self.law["mu"] = U(rng, .18, .35)
        if set(self.hidden) & {"stribeck-friction", "friction-rounding"}:
            self.law["mu"] = U(rng, .05, .12)
        if has("friction-rounding"):
            self.law["vr"] = LU(rng, 2e-3, 7e-3)
        elif not has("presliding"):
            self.Ldev = U(rng, -.2, .2)
            self.law.update(L=1e-4, bristle=float(rng.choice([0, 1, 2, 3], p=[.25, .3, .15, .3])))
        self.amps = [effects.draw(e, rng, ctx) for e in self.hidden]
        self.extra = [effects.draw(e, rng, ctx) for e in self.model if e not in refit.BASES and e not in ("coulomb-friction", "friction-rounding")]
        for a in self.extra:
            a["A"] = float(np.clip(a["A"] * U(rng, .6, 1.5), a["lo"], a["hi"]))
        on = lambda p=.6: rng.random() < p
        q = self.nuis = {}
        q["eps"] = U(rng, -.02, .02) if on() else 0.
        q["r2"] = U(rng, .005, .02) if on(.5) else 0.
        q["surface"] = U(rng, -4e-5, 4e-5)
        q["drift"] = U(rng, -.05, .05) if on() else 0.
        q["nonlin"] = U(rng, -.008, .008) if on(.5) else 0.
        q["clock"] = U(rng, -3e-4, 3e-4) if on() else 0.
        q["lowpass"] = float(1 / (2 * np.pi * LU(rng, 70, 500))) if on(.7) else 0.
        q["colour"], q["colour_tau"] = (U(rng, .2, .6) if on(.6) else 0.), LU(rng, .01, .3)
        q["encoder"] = LU(rng, 1e-7, 2e-6)
        q["depth_noise"] = LU(rng, 5e-8, 1e-6)
        q["rate"] = bool(on(.4))
        q["rate_noise"], q["rate_lag"] = LU(rng, 2e-5, 2e-4), U(rng, 0, 4e-3)
        q["jitter"] = U(rng, .02, .12) if on(.25) else 0.
        q["drops"] = U(rng, .001, .02) if on(.25) else 0.
        q["bristle_length"] = 1e-4 * (1 + self.Ldev)
        q["bristle"] = "rounded" if has("friction-rounding") else ["Dahl", "Prandtl", "LuGre", "elasto-plastic"][int(self.law.get("bristle", 0))]
        self.servo_w, self.servo_z, self.servo_m = 2 * np.pi * LU(rng, 12, 40), U(rng, .6, 1.0), LU(rng, 3, 20)
        q.update(servo_Hz=self.servo_w / 2 / np.pi, servo_damping=self.servo_z)
        self.tau2 = LU(rng, .3, 3)
        self.sd = self.Fmax * LU(rng, .0025, .006)
        self.rate = float(plan.get("rate") or rng.choice([100, 250, 500, 500, 1000]))
        if has("mains-hum"):
            self.rate = max(self.rate, 500.)
        if has("sensor-lag") or has("time-offset"):
            self.rate = max(self.rate, 250.)
        o = effects.emphasis(self.hidden, rng, True)
        o.update(plan.get("opt", {}))
        tq, arr, self.tags = motion.tester_script(rng, self.dmax, self.slide, o)
        self.dt = 2.5e-4 if tq[-1] < 150 else 1e-3
        self.t = np.arange(0, tq[-1], self.dt)
        I = lambda i: np.interp(self.t, tq, arr[:, i])
        self.tq = tq
        self.cmd = np.column_stack([-I(2), I(0), I(1)])
        sos = butter(2, [5, 20], "bandpass", fs=1 / self.dt, output="sos")
        sh = sosfilt(sos, rng.standard_normal((len(self.t), 3)), axis=0)
        self.shake = sh / sh.std(0) * self.servo_w ** 2 * LU(rng, 5e-8, 2e-6)
        self.logseed = int(rng.integers(1 << 30))
        self.two = self.slide

    def _world(self):
        w = dict(law=dict(self.law), post={}, tip_off=np.zeros(3))
        for a in self.extra + self.amps:
            a["put"](w, a["A"])
        return w

    def ease(self):
        if "mu" in self.law and "coulomb-friction" not in self.hidden:
            self.law["mu"] *= .85
        self.Ldev *= .5
        return True

    def resim(self):
        L = self._world()["law"]
        L["eps"] = self.soft * self.nuis["eps"]
        if self.Ldev:
            L["L"] = 1e-4 * (1 + self.soft ** .5 * self.Ldev)
        relax = "relaxation" in self.names
        if self.nuis["r2"]:
            L.update(r2=self.soft * self.nuis["r2"] * (3 if relax else .6), tau2=L.get("tau1", 1) * 3 if relax else self.tau2)
        if self.outside == "breathing":
            L.update(wobA=self.out_A * .03 * self.dmax, wobF=.12 + .25 * ((self.out_rng % 97) / 97), wobP=1.0)
        if self.outside == "puncture":
            L.update(punR=min(.8, .3 * self.out_A), punD=.8 * self.dmax)
        P = laws.pack({k: v for k, v in L.items() if k in laws.IX})
        self.X, self.V, self.F = servo(P, L.get("C", 0.), self.t, self.cmd, self.servo_w, self.servo_z, self.servo_m, self.shake)

    def build(self):
        w, q, s = self._world(), self.nuis, self.soft
        post = w["post"]
        rng = np.random.default_rng(self.logseed)
        t, y = self.t, self.F.copy()
        if not self.slide:
            y = y[:, :1]
        if q["nonlin"]:
            y = y + s * q["nonlin"] * y * np.abs(y) / self.Fmax
        if self.outside == "pulse":      # a muscle that works: the whole load swells and sinks
            f = .1 + .3 * ((self.out_rng % 89) / 89)
            y = y * (1 + .12 * self.out_A * np.sin(2 * np.pi * f * t[:, None]))
        for tau in (s * q["lowpass"], post.get("lag", 0.)):
            if tau > 1e-5:
                y = refit.lagged(t, y, tau)
        m = y.shape[1]
        y = y + post.get("bias", np.zeros(6))[:m] + (t[:, None] / 60) * (post.get("drift", np.zeros(6))[:m] + s * q["drift"])
        if self.outside == "shift":
            rg = np.random.default_rng(self.out_rng)
            for f in (.31, .66):
                y[:, 0] += (t > f * t[-1]) * self.out_A * .05 * self.Fmax * sign(rg)
        n = int(t[-1] * self.rate)
        tk = np.arange(n) / self.rate
        if q["jitter"]:
            tk = np.clip(tk + rng.normal(size=n) * q["jitter"] / self.rate / 3, 0, t[-1])
        I = lambda tt, M: np.column_stack([np.interp(tt, t, M[:, i]) for i in range(M.shape[1])])
        y = I(tk - post.get("toff", 0.) - s * q["clock"], y)
        if "hum" in post:
            h = post["hum"][:m]
            h[0] = np.linalg.norm(post["hum"][:3]) if m == 1 else h[0]
            ph = 2 * np.pi * post["humf"] * tk
            y = y + np.outer(np.sin(ph), h) + .3 * np.outer(np.sin(2 * ph + 1), h) + .2 * np.outer(np.sin(3 * ph + 2), h)
        e = rng.normal(size=y.shape)
        if q["colour"]:
            a = np.exp(-1 / (self.rate * q["colour_tau"]))
            e = np.sqrt(1 - q["colour"] ** 2) * e + q["colour"] * np.sqrt(1 - a * a) * lfilter([1], [1, -a], rng.normal(size=y.shape), axis=0)
        self.clip = None
        if "clip" in post:
            top = np.abs(y[:, 0]).max() * (1 - post["clip"])
            self.clip = (0, float(top))
            if self.logseed % 2:
                y[:, 0] = np.minimum(y[:, 0], top)
        y = y + self.noise * self.sd * e
        if self.clip and not self.logseed % 2:
            y[:, 0] = np.minimum(y[:, 0], self.clip[1])
        yq = np.round(y / post["quant"]) * post["quant"] if "quant" in post else y
        X, V = I(tk, self.X), I(tk - q["rate_lag"], self.V)
        X[:, 0] += -post.get("surface", 0.) + s * q["surface"]
        X = np.round((X + rng.normal(size=X.shape) * q["depth_noise"]) / q["encoder"]) * q["encoder"]
        V = V + rng.normal(size=V.shape) * q["rate_noise"]
        keep = np.ones(n, bool)
        if q["drops"]:
            keep = rng.random(n) > q["drops"]
        return [v[keep] for v in (tk, X, V, y, yq)]

    def noise_rms(self):
        return self.noise * self.sd, 1.0

    def data(self):
        t, X, V, y, yq = self.logged = self.build()
        g, S, dS, fs = refit.on_grid(t, X, 40.0)
        step = max(1, int(np.ceil(len(t) / 9000)))
        tk = t[::step]
        I = lambda v: np.interp(tk, g, v)
        kin = dict(d=I(S[:, 0]), x=I(S[:, 1]), y=I(S[:, 2]), dd=I(dS[:, 0]), vx=I(dS[:, 1]), vy=I(dS[:, 2]))
        Fm = refit.smooth(np.interp(g, t, y[:, 0]), fs, 40.0)
        kin["Fm"] = I(Fm)
        D = refit.Data(tk, kin, y[::step], np.full(y.shape[1], self.noise * self.sd), self.base, self.D0, .4 * self.Fmax)
        return D, (yq - y)[::step]

    def theta(self):
        w = self._world()
        L, p = w["law"], w["post"]
        th = {k: L[k] for k in ("F0", "c", "lam", "n", "r1", "tau1", "hA", "hL", "mR", "mL", "aF", "aL", "sK", "sB", "alpha", "C", "mu", "cv", "dmu", "vs", "L", "vr", "p", "a") if k in L}
        if "friction-rounding" not in self.names:
            th.pop("vr", None)
        if "presliding" not in self.names:
            th.pop("L", None)
        th.update(z0=p.get("surface", 0.), lag=p.get("lag", 0.), toff=p.get("toff", 0.))
        if "humf" in p:
            th["hum"] = p["humf"]
        return th

    def write(self, folder, rng):
        t, X, V, y, yq = self.logged
        cols = {"t": t, "depth": X[:, 0]}
        if self.nuis["rate"]:
            cols["depth_rate"] = V[:, 0]
        cols["normal_force"] = yq[:, 0]
        if self.moves:
            cols.update(slip1=X[:, 1], slip2=X[:, 2])
            if self.nuis["rate"]:
                cols.update(slip_rate1=V[:, 1], slip_rate2=V[:, 2])
        if self.slide:
            cols.update(tangential_force1=yq[:, 1], tangential_force2=yq[:, 2])
        if rng.random() < .6:
            cols["phase"] = self.tags[np.clip(np.searchsorted(self.tq, t), 0, len(self.tags) - 1)]
        name = write_log(folder, cols, rng)
        with open(os.path.join(folder, "rig.toml"), "w") as f:
            f.write("" if rng.random() < .6 else "# material tester: nothing but the columns of the log\n")
        return name, float(t[-1] - t[0])

    def nuisances(self):
        return dict(self.nuis, scale=self.soft, rate_Hz=self.rate, noise_N=self.noise * self.sd)

    def parameters(self):
        w = self._world()
        c = lambda v: v.tolist() if isinstance(v, np.ndarray) else float(v)
        return dict(law={k: c(v) for k, v in w["law"].items()}, post={k: c(v) for k, v in w["post"].items()},
                    amplitude={e: a["A"] for e, a in zip(self.hidden, self.amps)}, **({"clip": list(self.clip)} if self.clip else {}),
                    **({"outside": self.outside, "outside_amplitude": self.out_A} if self.outside else {}))
