"""Joint-torque logs: arms in free motion, one-axis drives.  Own dynamics kernel, Dahl or rounded friction, own linear fit."""
import os
import numpy as np
from numba import njit
from scipy.interpolate import CubicSpline
from scipy.signal import butter, sosfilt, sosfiltfilt
from core import arm
from robots import Arm, HOME
from write import clock, colour, measure, rates, table, toml

ARM_ONE = ["joint-coulomb-friction", "joint-viscous-friction", "joint-friction-asymmetry", "joint-torque-offset", "rotor-inertia", "joint-torque-gain", "payload", "joint-elasticity",
           "gravity-error", "joint-stribeck-friction", "joint-load-friction", "joint-torque-ripple", "joint-spring", "time-offset", "saturation", "mains-hum"]
DRIVE_ONE = ["joint-coulomb-friction", "joint-viscous-friction", "joint-friction-asymmetry", "joint-torque-offset", "joint-stribeck-friction", "joint-torque-ripple", "joint-spring", "time-offset",
             "saturation", "mains-hum", "quantization"]
ARM_TWO = [("payload", "joint-viscous-friction"), ("rotor-inertia", "joint-torque-offset"), ("joint-stribeck-friction", "gravity-error"), ("joint-torque-ripple", "payload"),
           ("joint-spring", "joint-friction-asymmetry"), ("joint-coulomb-friction", "joint-torque-offset"), ("joint-load-friction", "joint-torque-offset"), ("mains-hum", "payload")]
DRIVE_TWO = [("joint-torque-offset", "joint-stribeck-friction"), ("joint-spring", "joint-viscous-friction"), ("joint-torque-ripple", "joint-friction-asymmetry"), ("mains-hum", "joint-torque-offset")]
OUT = {"OUT-friction-warm-up": ["joint-load-friction", "joint-stribeck-friction"], "OUT-friction-by-angle": ["joint-load-friction"], "OUT-push": ["payload"],
       "OUT-offset-wander": ["joint-torque-offset"], "OUT-cable": ["joint-spring", "joint-coulomb-friction", "joint-torque-ripple"]}


@njit(cache=True)
def dahl(dq, dt, l):
    n, J = dq.shape; u = np.zeros((n, J))
    for j in range(J):
        x = 0.
        for i in range(n):
            s = abs(dq[i, j]) * dt
            if s > 0:
                g = np.exp(-s / l); x = x * g + np.sign(dq[i, j]) * (1 - g)
            u[i, j] = x
    return u


def motion(rng, J, mid, ff, T, o, lo=None, hi=None):
    """rests, multi-sine, point-to-point moves at three speeds; (n,J)"""
    vmax = o.get("v", rng.uniform(.4, 1.1)); R = o.get("range", .7)
    parts = [np.repeat(mid[None], int(.5 * ff), 0)]; q = mid.copy()
    def line(b, dur):
        nonlocal q
        s = np.arange(1, int(dur * ff) + 1) / max(1, int(dur * ff)); w = s ** 3 * (10 - 15 * s + 6 * s * s)
        parts.append(q + np.outer(w, b - q)); q = b
    def rest(d): parts.append(np.repeat(q[None], int(d * ff), 0))
    def sines(dur, quick):
        tt = np.arange(int(dur * ff)) / ff; w = np.clip(np.minimum(tt, dur - tt) / 1.5, 0, 1); w = w ** 3 * (10 - 15 * w + 6 * w * w)
        X = np.zeros((len(tt), J))
        for j in range(J):
            x = 0
            for f in rng.uniform(.05, .45, 4): x = x + rng.uniform(.3, 1) * np.sin(2 * np.pi * f * tt + rng.uniform(0, 6.28)) / (.5 + 3 * f)
            if quick: x = x + .15 * sum(np.sin(2 * np.pi * f * tt + rng.uniform(0, 6.28)) / f ** .5 for f in rng.uniform(1., o.get("fq", 2.5), 3))
            v = np.abs(np.gradient(x) * ff).max(); a = min(R / np.abs(x).max(), vmax * rng.uniform(.6, 1) / v); X[:, j] = x * a * w
        parts.append(q + X)
    n = lambda: sum(len(p) for p in parts) / ff
    line(mid + rng.uniform(-.1, .1, J), 1.5)
    k = 0
    while n() < T - 3:
        left = T - n() - 2
        if k % 3 == 0 and not o.get("slow") and not o.get("nosine"): sines(min(max(12., T * .25), left + 2), o.get("quick", rng.random() < .4)); rest(rng.uniform(.05, .15))
        else:
            v = o["speeds"][k % len(o["speeds"])] if "speeds" in o else vmax * [.06, .3, 1.][k % 3 if J > 1 else (k // 2) % 3]
            b = mid + rng.uniform(-R, R, J)
            if J == 1: b = mid + R * (1 if q[0] < mid[0] else -1) * rng.uniform(.5, 1)
            d = np.abs(b - q).max() * 1.875 / v
            if d > max(left, 1.5):
                b = q + (b - q) * max(left, 1.5) / d; d = max(left, 1.5)
            line(b, d); rest(rng.uniform(.03, .12))
        k += 1
    rest(.4)
    X = np.concatenate(parts)
    X = sosfiltfilt(butter(2, min(15., .3 * ff) / (ff / 2), output="sos"), X, axis=0)
    return np.arange(len(X)) / ff, X


class World:
    def __init__(self, rng, group, fx, drive=False, o=None):
        o = dict(o or {}); self.o = o; self.rng = rng; self.group = group; self.fx = fx
        self.drive = drive; self.A = None
        T = o.get("T", float(np.exp(rng.uniform(np.log(25), np.log(120)))))
        if drive: T = min(T, 70)
        if "joint-elasticity" in fx and not o.get("slow"): o.update(quick=True, fq=5.)
        if "joint-stribeck-friction" in fx and "speeds" not in o: o["speeds"] = [.01, .05, .3, .02, .8]
        self.fs = float(rng.choice([100, 200, 250, 500, 1000])) if T < 150 else 100.
        if "mains-hum" in fx: self.fs = max(self.fs, 250.)
        ff = self.ff = 500 if self.fs <= 500 else 1000
        if drive:
            J = self.J = 1; self.I = float(np.exp(rng.uniform(np.log(.02), np.log(2)))); mid = np.array([rng.uniform(-1, 1)])
            o.setdefault("v", rng.uniform(1.5, 5)); o.setdefault("range", rng.uniform(1.5, 6)); self.name = "drive"; o.setdefault("quick", True)
        else:
            self.name = str(o.get("robot") or rng.choice(["lwr", "panda", "ur5", "lwr"]))
            self.A = Arm(self.name, .03, 0., [0, 0, .1]); self.A.load(); J = self.J = self.A.J; mid = HOME[self.name] + rng.uniform(-.15, .15, J)
            if self.name == "lwr": o.setdefault("range", .9)
        for _ in range(20):
            self.t, self.q = motion(rng, J, mid, ff, T, o)
            if drive or not ((self.q < self.A.lo + .02) | (self.q > self.A.hi - .02)).any(): break
            o["range"] = o.get("range", .7) * .9
        cs = CubicSpline(self.t, self.q); self.dq, self.ddq = cs(self.t, 1), cs(self.t, 2)
        self.g0 = np.array([0, 0, -9.81])
        self.rb0 = self.rb(self.q, self.dq, self.ddq)
        self.gcols()
        self.rms = np.sqrt((self.rb0 ** 2).mean(0)); self.fsc = .1 * self.rms + .02 * self.rms.max()
        f = self.fsc; self.vv = np.sqrt((self.dq ** 2).mean(0)) + 1e-9; self.v0 = self.vv.max()
        self.lb = rng.uniform(1.5e-4, 3.5e-4) * (1 if not drive else 3) if rng.random() < .7 else 0.; self.vr = self.v0 * rng.uniform(.004, .012)
        self.model = ["rigid-body"] + [e for e in ("joint-coulomb-friction", "joint-viscous-friction") if e not in fx]
        if rng.random() < .35 and not set(fx) & {"joint-torque-offset", "joint-spring", "payload", "gravity-error"}: self.model.append("joint-torque-offset")
        self.B = dict(Fc=f * rng.uniform(.3, .9, J), b=f * rng.uniform(.2, .8, J) / self.vv * .6, off=f * rng.uniform(-1, 1, J) * .5 if "joint-torque-offset" in self.model else np.zeros(J))
        if "joint-coulomb-friction" not in self.model: self.B["Fc"] *= 0
        if "joint-viscous-friction" not in self.model: self.B["b"] *= 0
        # nuisances
        self.sig = np.maximum(.0015 * self.rms.max(), .003 * self.rms) * rng.uniform(.5, 1.5) + .0005 * self.rms.max()
        cut = rng.uniform(8, 50) if rng.random() < .6 else 0
        if cut and set(fx) & {"joint-torque-ripple", "time-offset", "mains-hum"}: cut = 45.
        if "mains-hum" in fx: cut = 0
        self.nz = dict(lev=np.radians(rng.uniform(.1, .3)) * rng.choice([-1, 1], 2), nl=rng.uniform(-.01, .01), clock=rng.uniform(-2e-3, 2e-3), drift=rng.uniform(-.006, .006, J) * self.rms,
                       off=rng.uniform(-.003, .003, J) * self.rms, cut=cut, zero=rng.random() < .5, enc=2e-6 * 150 ** rng.random(), rate=float(rng.choice([0, 0, 100, 250])), hold=rng.random() < .5)
        if self.nz["rate"] >= self.fs or "time-offset" in fx or "mains-hum" in fx or self.fs <= 100: self.nz["rate"] = 0.
        self.us = [rng.random((10, J)) for _ in fx]
        self.seed = int(rng.integers(1 << 30))
        n = min(4000, len(self.t)); self.sub = np.linspace(0, len(self.t) - 1, n).astype(int)

    def gcols(self):
        """what a change of gravity does (linear)"""
        if self.drive: return
        n = len(self.q); i = np.unique(np.r_[np.arange(0, n, max(1, self.ff // 25)), n - 1]); q = self.q[i]; z = np.zeros_like(q); b = self._rb(q, z, z)
        self.G = [CubicSpline(i, self._rb(q, z, z, self.g0 + a) - b)(np.arange(n)) for a in np.eye(3)]

    def thin(self, rate=250):
        """the same world on a coarser grid"""
        import copy
        k = max(1, int(self.ff // rate)); o = copy.copy(self)
        for a in ("t", "q", "dq", "ddq", "rb0"): setattr(o, a, np.ascontiguousarray(getattr(self, a)[::k]))
        if not self.drive: o.G = [np.ascontiguousarray(x[::k]) for x in self.G]
        o.ff = self.ff / k; n = min(3000 if self.drive else 1500, len(o.t)); o.sub = np.linspace(0, len(o.t) - 1, n).astype(int); o.E = {}
        return o

    def rb(self, q, dq, ddq, g=None, m=0., c=None, fc=None):
        """m, c: a mass that hangs on the last link, at c in its frame"""
        if self.drive: return self.I * ddq
        A = self.A; n = len(q); st = max(1, int(self.ff // 125))
        if n > 4000 and st > 1:     # smooth motion: on a coarse grid, then splines
            i = np.unique(np.r_[np.arange(0, n, st), n - 1])
            return CubicSpline(i, self.rb(q[i], dq[i], ddq[i], g, m, c, None if fc is None else fc[i]) if len(i) <= 4000 else self._rb(q[i], dq[i], ddq[i], g, m, c, None if fc is None else fc[i]))(np.arange(n))
        return self._rb(q, dq, ddq, g, m, c, fc)

    def _rb(self, q, dq, ddq, g=None, m=0., c=None, fc=None):
        A = self.A; n = len(q)
        return arm(q, dq, ddq, A.RP, A.pP, A.AX, A.M, A.COM, A.I, np.eye(3), np.zeros(3), np.zeros(3), self.g0 if g is None else g, float(m), np.zeros(3) if c is None else c, np.zeros((3, 3)),
                   np.zeros((n, 3)) if fc is None else fc)[0]

    def fric(self, dq):
        return dahl(dq, self.t[1] - self.t[0], self.lb) if self.lb else dq / np.sqrt(dq * dq + self.vr ** 2)

    def world(self, s, k, fx, us, calib=True):
        """torques on the fine grid with sizes s of the effects and nuisances k; (tau, logged q, values)"""
        B = self.B; J = self.J; t = self.t; q, dq, ddq = self.q, self.dq, self.ddq; f, v = self.fsc, self.vv; V = {}
        nm = (lambda j: f"joint_{j+1}") if not self.drive else (lambda j: "joint_1")
        def put(e, p, x):
            for j in range(J):
                if x[j]: V[f"{e}.{p}[{nm(j)}]"] = float(x[j])
        lev = self.nz["lev"] * k; g = 9.81 * np.array([np.sin(lev[0]), np.sin(lev[1]), -1]); m = 0.; c = None; fc = None; U = dict(zip(fx, us)); Sz = dict(zip(fx, s if isinstance(s, (list, tuple)) else [s] * len(fx)))
        if "payload" in U:
            s = Sz["payload"]; u = U["payload"]; m = min(.12 * s * (1 + u[0, 0]), 4.); c = np.array([.08 * (u[1, 0] - .5), .08 * (u[2, 0] - .5), .05 + .12 * u[3, 0]])
            V["payload.mass"] = m; V.update({f"payload.moment[{a}]": m * c[i] for i, a in enumerate("xyz")})
        if "gravity-error" in U:
            s = Sz["gravity-error"]; u = U["gravity-error"]; d = np.array([np.cos(6.28 * u[0, 0]), np.sin(6.28 * u[0, 0]), .2 * (u[1, 0] - .5)]) * .25 * s; g = g + d
            V.update({f"gravity-error.error[{a}]": d[i] for i, a in enumerate("xyz")})
        if "OUT-push" in U:
            s = Sz["OUT-push"]; u = U["OUT-push"]; fc = np.zeros((len(t), 3))
            for i in range(8):
                t0 = (i + .3 + .4 * u[i, 0]) / 8 * t[-1]; w = .25 + .3 * u[i, 1]
                fc += np.exp(-((t - t0) / w) ** 4)[:, None] * np.array([u[i, 2] - .5, u[i, 3] - .5, .4 * (u[i, 4] - .5)]) * 12 * s
        r = self.rb0
        if m or fc is not None: r = self.rb(q, dq, ddq, None, m, c, fc)
        if not self.drive:
            for i in range(3):
                if g[i] != self.g0[i]: r = r + self.G[i] * (g - self.g0)[i]
        ql = q
        if "joint-elasticity" in U:
            s = Sz["joint-elasticity"]; K = s * 2e-4 * (.7 + .6 * U["joint-elasticity"][0]) * (self.rms.max() / np.maximum(self.rms, .1 * self.rms.max())) ** .5 / self.rms.max() * 20
            ql = q + K * r; put("joint-elasticity", "sag", K)
            if self.drive: V = {"joint-elasticity.elasticity[joint_1]": self.I * K[0]}
        u_ = self.fric(dq)
        Fc = B["Fc"]; tau = r + B["b"] * dq + B["off"]; Fm = np.ones(1)
        if "OUT-friction-warm-up" in U: s = Sz["OUT-friction-warm-up"]; Fm = 1 + .35 * s * np.exp(-t / (t[-1] * .3))[:, None]
        if "OUT-friction-by-angle" in U: s = Sz["OUT-friction-by-angle"]; Fm = np.maximum(1 + .3 * s * np.sin(3 * q / max(self.o.get("range", .7), .3) + 6.28 * U["OUT-friction-by-angle"][0]), .05)
        tau = tau + Fc * Fm * u_
        for e, u in U.items():
            s = Sz[e]
            sg = np.where(u[0] < .5, -1., 1.)
            if e == "joint-coulomb-friction": x = s * .25 * f * (.6 + u[1]); tau = tau + x * u_; put(e, "coulomb", x)
            elif e == "joint-viscous-friction": x = s * .25 * f / v * (.6 + u[1]); tau = tau + x * dq; put(e, "viscous", x)
            elif e == "joint-friction-asymmetry": x = sg * s * .25 * f / v * (.6 + u[1]); tau = tau + x * np.abs(dq); put(e, "asymmetry", x)
            elif e == "joint-torque-offset": x = sg * s * .25 * f * (.6 + u[1]); tau = tau + x; put(e, "offset", x)
            elif e == "rotor-inertia":
                x = s * .1 * (.6 + .8 * u[1]) * f / np.sqrt((ddq ** 2).mean(0) + 1e-9) * 2
                if self.group == "not-excited": x = s * .2 * (.6 + .8 * u[1])
                tau = tau + x * ddq; put(e, "inertia", x)
            elif e == "joint-stribeck-friction":
                vs = (.04 if not self.drive else .03 * self.v0) * (.6 + .8 * u[2]) if self.group != "not-excited" else .0005 * (1 + u[2])
                x = s * .3 * f * (.6 + u[1]); tau = tau + x * u_ * np.exp(-(dq / vs) ** 2); put(e, "excess", x); put(e, "speed", vs)
            elif e == "joint-load-friction": x = np.minimum(s * .02 * (.6 + .8 * u[1]), .35); tau = tau + x * np.abs(r) * u_; put(e, "load", x)
            elif e == "joint-torque-ripple":
                kk = np.round(20 + 25 * u[1]) if not self.drive else np.round(4 + 16 * u[1])
                if self.group == "not-excited": kk = np.full(J, 1.)
                a, b = s * .3 * f * np.cos(6.28 * u[2]), s * .3 * f * np.sin(6.28 * u[2])
                tau = tau + a * np.sin(kk * q) + b * np.cos(kk * q) + .25 * s * .3 * f * np.sin(2 * kk * q); put(e, "order", kk)
                for j in range(J): V.update({f"{e}.sine[{nm(j)},1]": a[j], f"{e}.cosine[{nm(j)},1]": b[j], f"{e}.sine[{nm(j)},2]": .075 * s * f[j]})
            elif e == "joint-spring":
                x = s * .2 * f * (.6 + u[1]) / max(self.o.get("range", .7) * .6, .1); p = sg * .3 * s * f * u[2]; tau = tau + x * q + p; put(e, "rate", x); put(e, "preload", p)
            elif e == "OUT-offset-wander":
                tau = tau + s * .35 * f * sum(np.sin(2 * np.pi * h * t / t[-1] + 6.28 * u[i])[:, None] if False else np.sin(2 * np.pi * h * t[:, None] / t[-1] + 6.28 * u[i]) for i, h in enumerate([1.6, 2.7, 4.4]))
            elif e == "OUT-cable": tau = tau + s * .4 * f * dahl(dq, t[1] - t[0], .25 * self.o.get("range", .7))
        ideal = tau
        if "joint-torque-gain" in U:
            s = Sz["joint-torque-gain"]; u = U["joint-torque-gain"]; x = np.where(u[0] < .5, -1., 1.) * np.minimum(s * .025 * (.6 + .8 * u[1]), .45); tau = tau * (1 + x); put("joint-torque-gain", "gain", x)
        # the sensor
        sc = np.abs(tau).max(0) + 1e-9
        if k: tau = tau + self.nz["nl"] * k * sc * np.sin(np.pi * tau / sc) / 2 + self.nz["off"] * k + self.nz["drift"] * k * t[:, None] / 60
        d = self.nz["clock"] * k
        if "time-offset" in U: s = Sz["time-offset"]; x = (1 if U["time-offset"][0, 0] > .5 else -1) * .006 * s; d += x; V["time-offset.delay"] = x
        if d: tau = np.c_[tuple(np.interp(t - d, t, tau[:, j]) for j in range(J))]
        if k and self.nz["cut"]:
            w = min(self.nz["cut"] / min(k, 1.) ** .8, .45 * self.ff) / (self.ff / 2)
            y0 = tau[0]; tau = sosfiltfilt(butter(1, w, output="sos"), tau, axis=0) if self.nz["zero"] else sosfilt(butter(1, w, output="sos"), tau - y0, axis=0) + y0
        if "mains-hum" in U:
            s = Sz["mains-hum"]; u = U["mains-hum"]; f0 = 50. if u[0, 0] < .7 else 60.; am = .2 * s * f * (.6 + u[1]); ph = 6.28 * u[2, 0]
            tau = tau + am * np.sin(2 * np.pi * f0 * t[:, None] + ph)
            for j in range(J): V.update({f"mains-hum.sine[{self.chn(j)},1]": am[j] * np.cos(ph), f"mains-hum.cosine[{self.chn(j)},1]": am[j] * np.sin(ph)})
        S = dict(sat=None, quant=None)
        if "saturation" in U:
            s = Sz["saturation"]; j = int(np.argmax(self.rms)); L = np.full(J, np.inf); L[j] = np.abs(self.rb0[:, j]).max() * max(.97 - .05 * s, .4); S["sat"] = L; V[f"saturation.limit[{self.chn(j)}]"] = L[j]
        if "quantization" in U: s = Sz["quantization"]; S["quant"] = .25 * s * f; put("quantization", "step", S["quant"]); V = {a.replace("joint_", "tau"): b for a, b in V.items()} if list(U) == ["quantization"] else V
        return tau, ql, V, S

    def chn(self, j): return f"tau{j+1}"

    def cut(self, Y, S):
        if S["sat"] is not None: Y = np.clip(Y, -S["sat"], S["sat"])
        if S["quant"] is not None: Y = np.round(Y / S["quant"]) * S["quant"]
        return Y

    def columns(self, e, q, dq, ddq, u, r):
        """list of (n, J) regressors of effect e"""
        J = self.J; n = len(q); E = []
        per = {"joint-coulomb-friction": u, "joint-viscous-friction": dq, "joint-torque-offset": np.ones_like(q), "joint-friction-asymmetry": np.abs(dq), "rotor-inertia": ddq, "joint-torque-gain": r,
               "joint-load-friction": np.abs(r) * u}
        if e in per or e == "joint-spring":
            for P in ([per[e]] if e in per else [q, np.ones_like(q)]):
                for j in range(J):
                    X = np.zeros((n, J)); X[:, j] = P[:, j]; E.append(X)
            return E
        if e == "payload":
            b = self.rb(q, dq, ddq)
            for c in (np.zeros(3), *(.1 * np.eye(3))): E.append(self.rb(q, dq, ddq, None, 1., c) - b)
        if e == "gravity-error":
            z = np.zeros_like(q); b = self.rb(q, z, z)
            for a in np.eye(3): E.append(self.rb(q, z, z, self.g0 + a) - b)
            for j in range(J):
                for a in np.eye(3):
                    C = self.A.COM.copy(); self.A.COM = C.copy(); self.A.COM[j] = C[j] + .05 / self.A.M[j] * a; E.append(self.rb(q, z, z) - b); self.A.COM = C
        return E

    def fit(self, Y, ql, extra=()):
        i = self.sub
        if ql is self.q: q, dq, ddq, r = self.q, self.dq, self.ddq, self.rb0
        else:
            cs = CubicSpline(self.t, ql); q, dq, ddq = ql, cs(self.t, 1), cs(self.t, 2); r = self.rb(q, dq, ddq)
        u = dahl(dq, self.t[1] - self.t[0], 2e-4 * (3 if self.drive else 1))
        key = (id(q), tuple(extra)); q, dq, ddq, u, r = q[i], dq[i], ddq[i], u[i], r[i]
        E = [] if not self.drive else [ddq]
        for e in self.model[1:] + list(extra):
            if key[0] == id(self.q) and e in self.E: E += self.E[e]; continue
            c = self.columns(e, q, dq, ddq, u, r); E += c
            if key[0] == id(self.q): self.E[e] = c
        w = 1 / (self.sig + .005 * self.rms + .002 * self.rms.max())
        R = Y - (0 if self.drive else r)
        M = np.array([(x * w).ravel() for x in E]).T if E else np.zeros((R.size, 1)); y = (R * w).ravel()
        if E:
            n_ = np.sqrt((M ** 2).sum(0)) + 1e-12; p = np.linalg.lstsq(M / n_, y, rcond=1e-9)[0] / n_; y = y - M @ p
        return y.reshape(R.shape) / w

    def evaluate(self, s, k, fx, us, extra=()):
        Y, ql, V, S = self.world(s, k, fx, us); Mi = self.world(s, 0., fx, us)[0][self.sub]
        rng = np.random.default_rng(self.seed); Y = self.cut(Y[self.sub] + rng.normal(size=(len(self.sub), self.J)) * self.sig, S); Mi = self.cut(Mi, S)
        q = lambda X: float(np.sqrt((X ** 2).mean()))
        self.last = (Y, ql)
        return dict(reading=q(Y), fit=q(self.fit(Y, ql, extra)), true=q(Y - Mi), noise=q(self.sig), V=V)


def make(rng, group, fx, drive, o=None):
    big = World(rng, group, fx, drive, o); w = big.thin()
    q = w.evaluate(0., 0., [], [])
    if max(q["fit"] ** 2 - q["noise"] ** 2, 0) ** .5 > max(.007 * q["reading"], .3 * q["noise"]): w.lb = 2e-4 * (3 if drive else 1)     # another friction than the tool's: only where it stays small
    k = 1.
    for _ in range(12):
        q = w.evaluate(0., k, [], [])
        x = max(q["fit"] ** 2 - q["noise"] ** 2, 0) ** .5; y = max(q["true"] ** 2 - q["noise"] ** 2, 0) ** .5
        if x < max(.011 * q["reading"], .5 * q["noise"]) and y < max(.015 * q["reading"], .6 * q["noise"]): break
        k *= .65
    else: print("   joint: nuisances stay", w.name, q); return None
    quiet = q; s, ev = 0., q; near = []
    if group == "not-excited":
        s = 2.
        for _ in range(14):
            ev = w.evaluate(s, k, fx, w.us)
            if max(ev["fit"] ** 2 - quiet["fit"] ** 2, 0) ** .5 < max(.007 * ev["reading"], .4 * ev["noise"]): break
            s *= .65
        else: return None
    elif fx:
        R = 2.5 * 3. ** rng.random() if group != "two" else 3 * 2 ** rng.random()
        ss = []
        for e, u in zip(fx, w.us):
            s = .4; tried = []
            for _ in range(14):
                z = w.evaluate(s, k, [e], [u])
                x = z["fit"] / max(quiet["fit"], z["noise"]) if z["fit"] ** 2 - quiet["fit"] ** 2 > (.035 * z["reading"]) ** 2 else 1.; tried.append((s, x))
                if x >= R: break
                s *= 1.4
            good = [a for a in tried if a[1] >= 2.2]
            if not good: print("   joint: too small", fx, w.name, tried[-1]); return None
            ss.append(good[-1][0])
        s = ss; ev = w.evaluate(s, k, fx, w.us)
        Y, ql = w.last
        if group == "one":
            ref = max(quiet["fit"], ev["noise"])
            cand = ["joint-torque-offset", "joint-spring", "joint-friction-asymmetry", "joint-load-friction", "joint-coulomb-friction", "joint-viscous-friction"] + ([] if drive else ["rotor-inertia", "joint-torque-gain", "payload", "gravity-error"])
            for e in cand:
                if e in w.model or e in fx: continue
                if e == "joint-spring" and fx == ["joint-torque-offset"]: continue
                if np.sqrt((w.fit(Y, ql, [e]) ** 2).mean()) < 1.15 * ref: near.append(e)
            if "joint-torque-offset" in near and "joint-spring" in near: near.remove("joint-spring")
            if fx == ["time-offset"] and w.world(s, 0, fx, w.us)[2]["time-offset.delay"] > 0: near.append("sensor-lag")
    big.s, big.k, big.ev, big.quiet, big.near, big.lb, big.rng = s, k, ev, quiet, near, w.lb, rng
    return big


def write(w, d):
    rng = w.rng; os.makedirs(d, exist_ok=True); J = w.J
    Y, ql, V, S = w.world(w.s, w.k, w.fx, w.us); Mi, _, _, _ = w.world(w.s, 0., w.fx, w.us)
    T = w.t[-1]; jit, drop = (rng.uniform(.01, .1) if rng.random() < .4 else 0), (rng.uniform(5e-4, 5e-3) if rng.random() < .3 else 0)
    t = clock(rng, T, w.fs, jit, drop); n = len(t)
    I = lambda X: np.c_[tuple(np.interp(t, w.t, X[:, j]) for j in range(J))]
    Ys = I(Y)
    if w.nz["rate"] and w.k > .3 and not w.fx:       # the torques' own, slower rate: interpolated
        tr = np.arange(0, T, 1 / w.nz["rate"]); Ys = np.c_[tuple(np.interp(t, tr, np.interp(tr, w.t, Y[:, j])) for j in range(J))]
    cut = rng.choice([0, 0, 50, 100, 200])
    Ys = w.cut(Ys + colour(rng, n, J, w.fs, cut) * w.sig, S); Mi = w.cut(I(Mi), S)
    enc = w.nz["enc"] * (5 if w.drive else 1)
    Q = measure(rng, t, I(ql), enc if rng.random() < .7 else 0., .3 * enc)
    cols = {"t": np.round(t, 7)}
    for j in range(J): cols[f"q{j+1}"] = Q[:, j]
    if rng.random() < .6:
        v = rates(rng, t, None, I(np.gradient(ql, w.t, axis=0)), "there", w.fs)
        for j in range(J): cols[f"dq{j+1}"] = v[:, j]
    for j in range(J): cols[f"tau{j+1}"] = Ys[:, j]
    rig = {}
    if not w.drive:
        open(os.path.join(d, "arm.urdf"), "w").write(w.A.urdf())
        rig["robot"] = dict(model="arm.urdf", gravity=[0, 0, -9.81], joints=[f"joint_{j+1}" for j in range(J)])
    table(d, cols, "log.csv" if n * len(cols) < 250000 and rng.random() < .3 else "log.parquet"); toml(d, rig)
    if w.drive: open(os.path.join(d, "rig.toml"), "w").write("# one axis, no robot model: t, q1 [rad], tau1 [N m]\n")
    vals = {}
    nm = lambda j: f"joint_{j+1}"
    for e, p, x in (("joint-coulomb-friction", "coulomb", "Fc"), ("joint-viscous-friction", "viscous", "b"), ("joint-torque-offset", "offset", "off")):
        if e in w.model: vals.update({f"{e}.{p}[{nm(j)}]": float(w.B[x][j]) for j in range(J)})
    if w.drive: vals["rigid-body.inertia[joint_1]"] = w.I
    vals.update({a: float(b) for a, b in V.items()})
    te = float(np.sqrt(((Ys - Mi) ** 2).mean()))
    fx = w.fx; e = w.ev
    r = dict(group=w.group, kind="one-axis drive" if w.drive else f"arm {w.name}, joint torques", model=",".join(w.model), truth=[f for f in fx if not f.startswith("OUT")], near=w.near, values=vals, true_error=te,
             notes=f"{w.o}; friction {'bristles of %.2g rad' % w.lb if w.lb else 'rounded'}; nuisances x{w.k:.2f}; own fit without it / with the truth / reading rms: {e['fit']:.4g} / {e['true']:.4g} / {e['reading']:.4g}; quiet fit {w.quiet['fit']:.4g}")
    if w.group == "outside": r["notes"] = fx[0][4:] + "; " + r["notes"]; r["class"] = OUT[fx[0]]
    r["_size"] = dict(fit=[e["fit"]], true=[e["true"]], reading=[e["reading"]], noise=[e["noise"]])
    return r


def attempt(rng, group, choose, drive):
    for _ in range(6):
        fx, o = choose()
        w = make(rng, group, fx, drive, o)
        if w is not None: return lambda d: write(w, d)
    return None


def arm_case(rng, group, f, o=None):
    def choose():
        oo = dict(o or {})
        if group == "quiet": return [], oo
        if group == "one": return list(f), oo
        if group == "two": return list(ARM_TWO[rng.integers(len(ARM_TWO))]), oo
        if group == "outside": return [str(rng.choice(list(OUT)))], oo
        e = str(rng.choice(["rotor-inertia", "joint-elasticity", "joint-stribeck-friction"]))
        return [e], dict(slow=True, v=.12, **oo) if e != "joint-stribeck-friction" else dict(speeds=[.3, .5, .9], **oo)
    return attempt(rng, group, choose, False)


def drive(rng, group, f):
    def choose():
        if group == "quiet": return [], {}
        if group == "one": return [str(rng.choice(DRIVE_ONE))], {}
        if group == "two": return list(DRIVE_TWO[rng.integers(len(DRIVE_TWO))]), {}
        if group == "outside": return [str(rng.choice([x for x in OUT if x != "OUT-push"]))], {}
        e = str(rng.choice(["joint-elasticity", "joint-stribeck-friction"]))
        return [e], dict(quick=False, nosine=True) if e == "joint-elasticity" else dict(speeds=[1., 2., 3.])
    return attempt(rng, group, choose, True)
