"""Plain models of joint torques, driven by the measured angles: rigid body of the rig's robot (or one unknown inertia) and the catalogue's joint effects."""
from __future__ import annotations

import numpy as np
from scipy.signal import savgol_filter

import dynamics as dyn
from laws import JOINT, L, S
from refit import Ruler, rms
from score import Judge, jac, measure
from series import Series, smooth, uniform

BRISTLE = 5e-4


def bristle(q, length=BRISTLE):
    """Direction of motion that stays at rest: a Dahl bristle of fixed length."""
    z = np.zeros_like(q)
    d = np.diff(q, axis=0)
    e = np.exp(-np.abs(d) / length)
    s = np.sign(d)
    for i in range(1, len(q)):
        z[i] = s[i - 1] + (z[i - 1] - s[i - 1]) * e[i - 1]
    return z


class JointSeries(Series):
    """t, q, dq, ddq (smoothed) and y = torques; arm None: a single drive."""

    def __init__(self, log, arm, gravity, tool=None, most=5000, span=0.04):
        t = log["t"]
        n = arm.n if arm is not None else 1
        q = np.column_stack([log[f"q{i + 1}"] for i in range(n)])
        tu, dt, qu = uniform(t, q)
        qs, dq, ddq = smooth(qu, dt, span)
        zs = bristle(qs)
        self.fine(t, most)
        rows = self.rows
        self.t = t[rows] - t[0]
        pick = lambda A: np.column_stack([np.interp(t[rows], tu, A[:, c]) for c in range(n)])
        self.q, self.dq, self.ddq, self.z = pick(qs), pick(dq), pick(ddq), pick(zs)
        self.y = np.column_stack([log[f"tau{i + 1}"] for i in range(n)])[rows]
        self.n = self.channels = n
        self.arm, self.g = arm, np.asarray(gravity)
        self.contact = np.ones(len(rows), bool)
        self.span = span
        if arm is not None:
            self.m, self.c, self.I = arm.with_tool(*tool) if tool else (arm.m, arm.c, arm.I)
            self.rb = self.rigid(self.q, self.dq, self.ddq, self.g)
        else:
            self.rb = np.zeros((len(rows), 1))

    def flex(self, Y):
        """Torques smoothed, with two derivatives, at the compared rows."""
        dt = np.median(np.diff(self.t))
        tu = np.arange(0, self.t[-1], dt)
        w = max(7, int(round(0.16 / dt)) | 1)
        R = np.column_stack([np.interp(tu, self.t, Y[:, j]) for j in range(self.n)])
        out = [savgol_filter(R, w, min(3, w - 2), deriv=k, delta=dt, axis=0) for k in range(3)]
        return [np.column_stack([np.interp(self.t, tu, o[:, j]) for j in range(self.n)]) for o in out]

    def rigid(self, q, dq, ddq, g, m=None, c=None, I=None):
        a = self.arm
        m, c, I = (self.m, self.c, self.I) if m is None else (m, c, I)
        return dyn.torques(q, dq, ddq, g, a.Rp, a.pp, a.ax, m, c, I)


COLUMNS = {"joint-coulomb-friction": "fc", "joint-viscous-friction": "fv", "joint-torque-offset": "of", "rotor-inertia": "ro", "joint-stribeck-friction": "st",
           "joint-load-friction": "lf", "joint-torque-gain": "gn", "joint-elasticity": "el"}


class JointRuler(Ruler):
    def __init__(self, ser, effects, sigma, ripple=None):
        self.s, self.effects, self.w = ser, list(effects), 1 / np.asarray(sigma)
        self.base = "rigid-body"
        self.par, self.cache = {}, {}
        n = ser.n
        sc = np.array([max(rms(ser.y[:, j]), 1e-3) for j in range(n)])
        if ser.arm is None:
            self.par["J0"] = S(sc[0] / max(rms(ser.ddq), 1e-6), 0, 1e6, 0.5 * sc[0] / max(rms(ser.ddq), 1e-6))
        self.phi = {}
        for e in effects:
            for j in range(n):
                v, s = max(rms(ser.dq[:, j]), 1e-6), 0.1 * sc[j]
                if e == "joint-coulomb-friction":
                    self._col(f"fc{j}", s, ser.z[:, j], j)
                elif e == "joint-viscous-friction":
                    self._col(f"fv{j}", s / v, ser.dq[:, j], j)
                elif e == "joint-friction-asymmetry":
                    self._col(f"ac{j}", s, np.abs(ser.z[:, j]), j)
                    self._col(f"av{j}", s / v, np.abs(ser.dq[:, j]), j)
                elif e == "joint-torque-offset":
                    self._col(f"of{j}", s, np.ones(len(ser.t)), j)
                elif e == "rotor-inertia":
                    self._col(f"ro{j}", s / max(rms(ser.ddq[:, j]), 1e-6), ser.ddq[:, j], j)
                elif e == "joint-load-friction":
                    self._col(f"lf{j}", 0.03, np.abs(ser.rb[:, j]) * ser.z[:, j], j)
                elif e == "joint-torque-ripple":
                    k = self.ripple_at(j, ripple)
                    for h in (1, 2):
                        self._col(f"ra{h}{j}", s, np.sin(h * k * ser.q[:, j]), j)
                        self._col(f"rb{h}{j}", s, np.cos(h * k * ser.q[:, j]), j)
                elif e == "joint-stribeck-friction":
                    self.par[f"st{j}"] = S(s, -1e4, 1e4, 0.5 * s)
                elif e == "joint-torque-gain":
                    self.par[f"gn{j}"] = S(0.05, -0.8, 3)
                elif e == "joint-elasticity":
                    self.par[f"el{j}"] = S(1e-4, 0, 1e-2, 2e-5)
                elif e == "joint-spring":
                    self.par[f"ks{j}"] = S(s, -1e4, 1e4, 0.1 * s)
                    self.par[f"q0{j}"] = S(1.0, -3.2, 3.2)
            if e == "joint-stribeck-friction":
                v = np.percentile(np.abs(ser.dq), 60)
                self.par["sv"] = L(0.1 * v, 2e-3 * v, 3 * v, 0.08 * v, 0.4 * v)
            if e == "payload":
                self.par["pm"] = S(0.2, -5, 20)
                self.par.update({f"pc{i}": S(0.02, -2, 2) for i in range(3)})
            if e == "gravity-error":
                self.par.update({"gx": S(0.01, -0.5, 0.5), "gy": S(0.01, -0.5, 0.5)})
        self.names = list(self.par)

    def _col(self, name, scale, phi, j):
        self.par[name] = S(scale, -1e6, 1e6)
        self.phi[name] = (j, phi)

    def ripple_at(self, j, ripple):
        """Its frequency over the angle: given, or where the residual of a rough fit has its line."""
        if isinstance(ripple, dict) and j in ripple:
            return ripple[j]
        s = self.s
        if ripple is None or not hasattr(ripple, "res"):
            return 6.0
        r, q = ripple.res[:, j], s.q[:, j]
        ks = np.arange(1.0, 61.0, 0.5 if np.ptp(q) < 6 else 0.25)
        p = [np.abs(np.sum(r * np.exp(-1j * k * q))) for k in ks]
        return float(ks[int(np.argmax(p))])

    def start(self, given=None, which=0):
        v = {n: p[4][min(which, len(p[4]) - 1)] for n, p in self.par.items()}
        if given:
            v.update({k: x for k, x in given.items() if k in v})
        return v

    def predict(self, v):
        s = self.s
        Y = self.body(v)
        for n, (j, phi) in self.phi.items():
            if v[n] != 0.0:
                Y[:, j] += v[n] * phi
        for j in range(s.n):
            if f"st{j}" in v:
                Y[:, j] += v[f"st{j}"] * np.exp(-(s.dq[:, j] / v["sv"]) ** 2) * s.z[:, j]
            if f"ks{j}" in v:
                Y[:, j] += v[f"ks{j}"] * (s.q[:, j] - v[f"q0{j}"])
            if f"gn{j}" in v:
                Y[:, j] *= 1 + v[f"gn{j}"]
        self.before = Y
        return Y

    def body(self, v):
        s = self.s
        if s.arm is None:
            return v["J0"] * s.ddq
        key = tuple(v[k] for k in ("pm", "pc0", "pc1", "pc2", "gx", "gy", *[f"el{j}" for j in range(s.n)]) if k in v)
        if not key:
            return s.rb.copy()
        if key in self.cache:
            return self.cache[key].copy()
        g = s.g
        if "gx" in v:
            k = int(np.argmax(np.abs(g)))
            a, b = [i for i in range(3) if i != k]
            g = g.copy()
            g[a] += np.linalg.norm(s.g) * v["gx"]
            g[b] += np.linalg.norm(s.g) * v["gy"]
        q, dq, ddq = s.q, s.dq, s.ddq
        m, c, I = s.m, s.c, s.I
        if "pm" in v:
            m, c, I = m.copy(), c.copy(), I.copy()
            M = max(m[-1] + v["pm"], 1e-3)
            pc = np.array([v["pc0"], v["pc1"], v["pc2"]])            # first moment about the last joint's origin
            cn = (m[-1] * c[-1] + pc) / M
            sh = lambda mm, d: mm * (d @ d * np.eye(3) - np.outer(d, d))
            x = pc / v["pm"] if abs(v["pm"]) > 1e-3 else np.zeros(3)
            if np.linalg.norm(x) > 0.5:
                x = x * 0.5 / np.linalg.norm(x)
            I[-1] = I[-1] + sh(m[-1], c[-1] - cn) + sh(v["pm"], x - cn)
            m[-1], c[-1] = M, cn
        if "el0" in v:
            el = np.array([v[f"el{j}"] for j in range(s.n)])
            d = self.wound()
            q, dq, ddq = q - el * d[0], dq - el * d[1], ddq - el * d[2]
        Y = s.rigid(q, dq, ddq, g, m, c, I)
        if len(self.cache) > 4:
            self.cache.clear()
        self.cache[key] = Y
        return Y.copy()

    def wound(self):
        """What winds the springs: the measured torque less the friction of a rough fit."""
        if not hasattr(self, "_wound"):
            r = JointRuler(self.s, [e for e in self.effects if e != "joint-elasticity"], 1 / self.w)
            r.fit(r.start(), 8)
            self._wound = self.s.flex(self.s.y - (r.pred - r.body(r.v)))
        return self._wound

    def straight(self, name, v, before):
        if name in self.phi:
            j, phi = self.phi[name]
            return j, phi * (1 + v.get(f"gn{j}", 0.0))
        return None


PRE = {"joint-coulomb-friction": ("fc",), "joint-viscous-friction": ("fv",), "joint-friction-asymmetry": ("ac", "av"), "joint-torque-offset": ("of",),
       "rotor-inertia": ("ro",), "joint-load-friction": ("lf",), "joint-torque-ripple": ("ra", "rb"), "joint-stribeck-friction": ("st",),
       "joint-torque-gain": ("gn",), "joint-elasticity": ("el",), "joint-spring": ("ks",), "payload": ("pm", "pc"), "gravity-error": ("gx", "gy")}


class JointJudge(Judge):
    def __init__(self, ser, model, hidden, sigma, truth, ripple=None):
        self.ser, self.model, self.hidden, self.noise, self.rip = ser, model, hidden, np.asarray(sigma), ripple
        floor = np.array([0.004 * rms(ser.y[:, c]) for c in range(ser.n)])
        self.sigma = np.sqrt(self.noise ** 2 + floor ** 2)
        self.true = self._ruler(model + list(hidden))
        self.true.fit(self.true.start(truth), 20)
        self.bases = {}

    def _ruler(self, effects, ripple=None):
        return JointRuler(self.ser, effects, self.sigma, ripple if ripple is not None else self.rip)

    def lacking(self, name):
        if name not in self.bases:
            r = self._ruler(self.model + [h for h in self.hidden if h != name])
            r.fit(r.start(self.true.v), 20)
            self.bases[name] = r
        return self.bases[name]

    def size(self, name):
        base = self.lacking(name)
        v = {k: (0.0 if k.startswith(PRE[name]) else x) for k, x in self.true.v.items()}
        own = self.true.pred - self.true.predict(v)
        u = {"N·m": list(range(self.ser.n))}
        self.m = measure(own, self.true.pred - base.pred, self.true.res, self.ser.n, u)
        return self.m

    def fits(self):
        f, read, no = rms(self.true.res), rms(self.ser.y), rms(self.noise)
        return f / max(1.3 * no, 0.017 * read), (f, read, no)

    def near(self, name):
        eff, left, _, mask, use = self.size(name)
        base = self.lacking(name)
        r_true = rms(self.true.res[mask][:, use])
        drive = self.ser.arm is None
        out = []
        for a in JOINT:
            if a in self.model or a in self.hidden or drive and a in ("rotor-inertia", "payload", "gravity-error", "joint-torque-gain", "joint-elasticity", "joint-load-friction"):
                continue
            if a in ("joint-stribeck-friction", "joint-load-friction") and "joint-coulomb-friction" == name:
                continue
            best = None
            for k in range(2 if a == "joint-stribeck-friction" else 1):
                R = self._ruler(base.effects + [a], base if a == "joint-torque-ripple" else None)
                v = R.start(base.v, k)
                R.fit(v, 8, 2e-3)
                if best is None or R.sse < best.sse:
                    best = R
            if rms(best.res[mask][:, use]) - r_true < 0.5 * left:
                out.append(a)
        return out


__all__ = ["JointSeries", "JointRuler", "JointJudge", "jac"]
