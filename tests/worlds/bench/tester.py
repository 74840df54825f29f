"""Cases of the kind tester: a screw-driven press (and shear stage) on a material whose law is integrated as state equations."""
import numpy as np
from scipy.interpolate import CubicSpline
from scipy.signal import lfilter, bilinear
import catalog as C
import effects as E
from laws import params, mat_run
from motion import Path, H
from sensing import draw_nuisances, blank_sensor, read_channels, stamps, at, lp1


class TesterCase:
    kind, unit = "tester", "N"

    def __init__(self, seed, model, hidden, extra=None, flags=()):
        self.seed, self.model, self.hidden, self.flags = list(seed), list(model), list(hidden), set(flags)
        rng = np.random.default_rng(self.seed + [1])
        u = rng.uniform
        self.all = self.model + self.hidden
        A = set(self.all)
        self.long = "long" in self.flags
        fast = {"sensor-lag", "time-offset", "mains-hum"} & A
        self.rate = 50. if self.long else float(rng.choice([500, 1000, 2000] if fast else [100, 200, 250, 500, 500, 1000]))
        self.slip = bool(A & set(E.TANGENTIAL)) or "stiffness-inhomogeneity" in A or rng.random() < .15
        self.tang = bool(A & set(E.TANGENTIAL))                     # a shear load cell; without it slip alone is logged
        if not self.tang:
            self.slip = "stiffness-inhomogeneity" in A
        if (self.slip or {"hunt-crossley-damping", "viscous-damping"} & A) and not self.long:
            self.rate = max(self.rate, 250.)
        self.slow = self.rate <= 100
        base = next(m for m in model if m in C.BASES)
        self.base = base
        self.force, self.dmax = float(np.exp(u(np.log(5), np.log(60)))), float(u(1.5e-3, 6e-3))
        if "coulomb-friction" in self.hidden:
            self.force = float(u(5, 10))
        self.nu = nu = draw_nuisances(rng, self.rate, "tester", level=1.0)
        nu["sigma_f"] = self.force * float(np.exp(u(np.log(.0012), np.log(.005)))) * (2.5 if "coulomb-friction" in self.hidden else 1)
        nu["encoder"] = float(np.exp(u(np.log(5e-8), np.log(1e-6))))
        nu["lp_hz"] = float(u(60, 300)) if rng.random() < .4 and self.rate > 100 else None
        self.law0 = E.draw_law(rng, base, self.force, self.dmax)
        self.mu0 = float(np.exp(u(np.log(.1), np.log(.6))))
        self.fn, self.zeta = float(u(12, 40)), float(u(.6, .9))
        self.chatter = (float(u(0, 2e-6)), float(u(8, 40)))
        self.make_motion(np.random.default_rng(self.seed + [2]))
        self.ctx = dict(dmax=self.dmax, force=self.force, T=self.T, level=1.0)
        r3 = np.random.default_rng(self.seed + [3])
        self.shapes = {e: E.shape(r3, e, self.ctx) for e in self.all if e in E.ACTS}
        self.model_amp = {e: float(r3.uniform(.8, 2.)) for e in self.model}
        self.extra, self.cache = extra, {}
        self.extra_u = r3.uniform(-1, 1, 12)
        self.with_rate = r3.random() < .5
        self.with_noise = r3.random() < .3

    @property
    def main(self):
        return "second" if self.hidden and E.ACTS[self.hidden[0]][0] == "tangential" else "force"

    def relax(self, only_torque=False):
        n = self.nu
        n["level"] *= .5
        half = lambda x: None if x is None else (np.array(x) * .5).tolist()
        for k in ("nonlin", "drift"):
            n[k] = half(n[k])
        for k in ("clock", "surface", "toe", "jitter"):
            n[k] *= .5
        n["ell"] = 1e-4 + (n["ell"] - 1e-4) * .5
        n["encoder"] = max(n["encoder"] * .6, 1e-7)
        n["wrench_rate"] = None
        if n["second_tau"]:
            n["second_tau"][0] *= .5
        self.mu0 = max(self.mu0 * .8, .05)
        self.cache.clear()

    def make_motion(self, rng):
        u = rng.uniform
        A, fl, dm = set(self.all), self.flags, self.dmax
        vmax = .008 if self.slow else .04
        sp = lambda a=2e-3, b=vmax: float(np.exp(u(np.log(min(a, b)), np.log(b))))
        P = Path([0, 0, -.002, 0, 0], 1)
        P.wait("rest", u(.3, 1.0))
        cycles = int(rng.integers(9, 12)) if self.long else 1
        damp = {"viscous-damping", "hunt-crossley-damping"} & A
        for c in range(cycles):
            levels = [.35, .6, .6, 1.0, .75] if rng.random() < .5 else [.5, .8, .4, 1.0, 1.0]
            if "stress-softening" in A:
                levels = [.4, .4, .4, .7, .7, .7, 1.0, 1.0, .6]
            for i, lv in enumerate(levels):
                P.go("load", [.12 * vmax, vmax, sp(), .4 * vmax, sp()][i % 5], acc=.08, d=lv * dm)
                hold = float(u(.4, 1.2)) * (4 if {"relaxation", "zener", "stiffness-drift"} & A and i % 2 else 1)
                P.wait("hold", hold * (3 if self.long else 1))
                if i in (1, 3):                                    # sine-like cycles at two speeds round a middle depth
                    for v in (.1 * vmax, vmax * (1 if damp or i == 1 else .5)):
                        for _ in range(7 if damp and v > .2 * vmax else 2):
                            P.go("cycle", v, acc=.04, d=.35 * lv * dm).go("cycle", v, acc=.04, d=.95 * lv * dm)
                if self.slip and i in (0, 1, 3) and not ("stress-softening" in A and i > 3):
                    self.shear(P, rng, vmax, i)
                P.go("unload", [.3 * vmax, .12 * vmax, sp(), vmax, sp()][i % 5], acc=.08, d=-.0006)
                if "adhesion" in A or i == 2:
                    P.go("load", .004, d=.3 * dm).go("unload", .001, acc=.05, d=-.0018)
                P.wait("rest", float(u(.1, .6)))
                P.go("load", .01, d=-.0006)
            if self.long:
                P.wait("rest", float(u(3, 10)))
        P.go("unload", .01, d=-.002).wait("rest", u(.3, .8))
        X, _, ph = P.arrays()
        if len(X) * H > 598:
            X, ph = X[:int(598 / H)], ph[:int(598 / H)]
        self.X, self.ph, self.T = X[:, :3], ph, len(X) * H - .05

    def shear(self, P, rng, vmax, i):
        A, fl = set(self.all), self.flags
        L = float(rng.uniform(.006, .015))
        sp = [.3 * vmax, vmax, .06 * vmax] if {"stribeck-friction", "viscous-friction", "friction-rounding"} & A else [.4 * vmax, vmax]
        if "fast-only" in fl:
            sp = [.8 * vmax, vmax]
        for v in sp:
            ln = L if v > .1 * vmax else .25 * L
            for a in (("s1",) if "one-way" in fl else ("s1", "s2")):
                P.go("slide", v, acc=.05, **{a: ln}).go("slide", v, acc=.05, **{a: -.6 * ln}).go("slide", v, acc=.05, **{a: 0.})
            P.wait("rest", .2)
        if "fast-only" not in fl:
            P.micro(rng, float(rng.uniform(3e-4, 9e-4)), .003, 6, "s1" if i != 1 or "one-way" in fl else "s2")

    def world(self, amps, with_extra=True):
        nu = self.nu
        self.ctx["level"] = nu["level"]
        w = dict(law=dict(self.law0), sensor=blank_sensor(), z0=nu["surface"], extra=None)
        if nu["toe"]:
            w["law"]["toe"] = nu["toe"]
        if "coulomb-friction" in self.model:
            w["law"]["mu"] = self.mu0
        w["law"].update(ftype=float(nu["ftype"]), ell=nu["ell"], lug=4e-4)
        if nu["second_tau"]:
            w["law"].update(r4=nu["second_tau"][0], tau4=nu["second_tau"][1])
        par = {}
        for e in self.model:
            if e in E.ACTS and e != "coulomb-friction":
                par[e] = E.apply(w, e, self.model_amp[e], self.shapes[e], self.ctx)
        for e in self.hidden:
            par[e] = E.apply(w, e, amps[e], self.shapes[e], self.ctx)
        if "unexcited" in self.flags:
            if "stiffening-layer" in self.hidden:
                w["law"]["laD"] = par["stiffening-layer"]["depth"] = 1.2 * self.dmax
            if "saturation" in self.hidden:
                w["sensor"]["sat_frac"] = 1.25
        if self.extra and with_extra:
            from outside import note_tester
            w["extra"] = (self.extra, amps["outside"])
            par["outside"] = note_tester(self.extra, amps["outside"], self)
        w["par"] = par
        return w

    def stream(self, w):
        key = repr((sorted(w["law"].items()), w["z0"], w["extra"]))
        if key in self.cache:
            return self.cache[key]
        self.cache.clear()
        fs = 500. if self.T > 150 else 2000.
        n = int(self.T * fs)
        ts = np.arange(n) / fs
        wn, z = 2 * np.pi * self.fn, self.zeta                      # the press follows its command as a second-order drive
        b, a = bilinear([wn * wn], [1, 2 * z * wn, wn * wn], fs)
        x = CubicSpline(np.arange(len(self.X)) * H, self.X)(ts)
        x0 = x[0].copy()
        x = lfilter(b, a, x - x0, axis=0) + x0
        v = np.gradient(x, 1 / fs, axis=0)
        x[:, 2] += self.chatter[0] * np.sin(2 * np.pi * self.chatter[1] * ts) * np.minimum(np.abs(v[:, 2]) / .002, 1)
        v = np.gradient(x, 1 / fs, axis=0)
        o = np.empty((n, 3))
        c = lambda y: np.ascontiguousarray(y)
        d = x[:, 2] + w["z0"]
        dd = v[:, 2]
        if w["extra"]:
            from outside import tester_depth
            d = tester_depth(w["extra"], self, ts, d)
            dd = np.gradient(d, 1 / fs)
        mat_run(params(**w["law"]), ts, c(d), c(dd), c(x[:, 0]), c(x[:, 1]), c(v[:, 0]), c(v[:, 1]), np.zeros(1), False, o)
        if w["extra"]:
            from outside import tester_force
            o[:, 0] = tester_force(w["extra"], self, ts, d, o[:, 0])
        self.cache[key] = dict(t=ts, x=x, v=v, y=o if self.tang else o[:, :1])
        return self.cache[key]

    def log(self, w):
        s = self.stream(w)
        nu = self.nu
        rng = np.random.default_rng(self.seed + [4])
        ts = s["t"]
        t = stamps(rng, ts[-1], self.rate, nu["jitter"], nu["drop"])
        S = w["sensor"]
        y = s["y"]
        nc = y.shape[1]
        for k in ("bias", "drift", "hum"):                          # the press's axis takes what a wrench's z would
            if np.any(S[k]):
                m = np.abs(S[k][:3])
                S[k] = np.r_[np.sign(S[k][2]) * np.linalg.norm(m), S[k][:2], 0, 0, 0]
                for p in w["par"].values():
                    for q in ("bias", "drift_per_min", "amplitude"):
                        if isinstance(p.get(q), list):
                            p[q] = S[k][:nc].tolist()
        if S.get("sat_frac"):
            S["sat"] = np.full(6, np.inf)
            S["sat"][0] = S["sat_frac"] * y[:, 0].max()
            w["par"]["saturation"]["limit"] = float(S["sat"][0])
        sg = np.full(nc, nu["sigma_f"])
        if S.get("quant_a"):
            S["quant"] = np.full(6, nu["sigma_f"] * 10 * S["quant_a"])
            w["par"]["quantization"]["step"] = float(S["quant"][0])
        out, pre, f = read_channels(ts, y, t, S, nu, rng, sg, np.full(nc, 4 * self.force))
        st = nu["encoder"]
        x = np.round(at(ts, s["x"], t) / st) * st
        g = dict(t=t, depth=x[:, 2], normal_force=out[:, 0], pre=pre, sigma=sg * f)
        if self.slip:
            g.update(slip1=x[:, 0], slip2=x[:, 1])
        if self.tang:
            g.update(tangential_force1=out[:, 1], tangential_force2=out[:, 2])
        if self.with_rate:
            g["depth_rate"] = at(ts, lp1(s["v"][:, 2:], .002, ts[1] - ts[0]), t)[:, 0] + rng.normal(size=t.size) * 2e-5
        g["phase"] = self.ph[np.clip((t / H).astype(int), 0, len(self.ph) - 1)]
        return g

    def data(self, w, log, hz=250.):
        D = C.tester_data(log, log["sigma"], hz)
        st = max(int(round(1 / hz / float(np.median(np.diff(log["t"]))))), 1)
        D.pre = log["pre"][::st]
        D.cap["N0"] = .5 * self.force
        D.cap["hum_f"] = w["sensor"]["hum_f"]
        D.cap["sat_ch"] = [0]
        return D

    def truth(self, w):
        th = E.truth_theta(w, self.all, w["par"])
        if w["sensor"]["sat"] is not None:
            th["lim"] = float(np.min(w["sensor"]["sat"]))
        return th

    def analyse(self, w, log):
        import measure
        D = self.data(w, log)
        return D, measure.analyse(D, self.model, self.hidden, self.truth(w), log["sigma"], D.pre if "quantization" in self.hidden else None)

    def near(self, w, log, D, r):
        import measure
        return measure.near(D, self.data(w, log, 90.), self.model, self.hidden, r)

    def write(self, w, log, folder, fmt):
        import tables
        keys = ["t", "depth"] + (["depth_rate"] if self.with_rate else []) + (["slip1", "slip2"] if self.slip else []) + ["normal_force"] + \
            (["tangential_force1", "tangential_force2"] if self.tang else [])
        cols = {k: log[k] for k in keys}
        if self.seed[-1] % 2:
            cols["phase"] = log["phase"]
        tables.write_log(cols, folder, fmt)
        tables.write_rig(folder)
