"""Joint-torque logs: an arm in free motion, and single drives. The torque is that between rotor and gear (rotor inertia beyond it, unless the log
has it), so it holds spring torque, gear friction, ripple and balancers: arm.py's recorded sums."""
from __future__ import annotations

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.ndimage import gaussian_filter1d

import arm as armlib
import contact
import dynamics as dyn
import measure as ms
import robots
from jointfit import JointJudge, JointSeries
from motion import Path
from score import Redraw

SCALE = {"lwr4plus": [1.5, 2, 1, 1, 0.4, 0.3, 0.15], "panda": [1, 2, 0.8, 1.2, 0.3, 0.3, 0.15], "ur5": [2, 2.5, 1.5, 0.4, 0.35, 0.25]}
JRANGE = {  # lowest, first, largest amplitude
    "joint-coulomb-friction": (0.02, 0.5, 2), "joint-viscous-friction": (0.02, 0.5, 3), "joint-friction-asymmetry": (0.02, 0.2, 0.85),
    "joint-torque-offset": (0.02, 0.6, 6), "rotor-inertia": (0.03, 0.6, 3), "joint-torque-gain": (0.005, 0.04, 0.3), "payload": (0.02, 0.4, 4),
    "joint-elasticity": (0.1, 10.0, 40), "gravity-error": (2e-3, 0.02, 0.15), "joint-stribeck-friction": (0.03, 0.6, 3), "joint-load-friction": (0.003, 0.04, 0.3),
    "joint-torque-ripple": (0.02, 0.5, 5), "joint-spring": (0.05, 1.0, 12)}
IN_DRIVE = ("joint-coulomb-friction joint-viscous-friction joint-friction-asymmetry joint-torque-offset joint-stribeck-friction joint-torque-ripple joint-spring").split()


def shape(rng, e, n, scale):
    some = rng.random(n) < 0.7
    some[int(rng.integers(min(n, 4)))] = True
    per = rng.uniform(0.6, 1.3, n)
    sg = rng.choice([-1.0, 1.0], n)
    if e in ("joint-coulomb-friction", "joint-viscous-friction", "rotor-inertia", "joint-stribeck-friction", "joint-elasticity"):
        return dict(per=per if e != "joint-stribeck-friction" else per * np.where(some, 1, 0.2), vs=ms.logu(rng, 0.03, 0.12))
    if e in ("joint-friction-asymmetry", "joint-torque-gain", "joint-torque-offset"):
        return dict(per=per * sg * some)
    if e == "joint-load-friction":
        return dict(per=per)
    if e == "joint-torque-ripple":
        return dict(per=per * some * scale, k=rng.integers(5, 25, n).astype(float), ph=rng.uniform(0, 6.28, (2, n)))
    if e == "joint-spring":
        j = np.zeros(n)
        j[rng.permutation(min(n, 4))[:int(rng.choice([1, 2]))]] = 1
        return dict(per=per * j * scale, q0=rng.uniform(-0.8, 0.8, n))
    if e == "payload":
        return dict(com=np.r_[rng.uniform(-0.03, 0.03, 2), rng.uniform(0.03, 0.12)])
    if e == "gravity-error":
        a = rng.uniform(0, 6.28)
        return dict(dir=np.array([np.cos(a), np.sin(a)]))
    raise KeyError(e)


class JointCase:
    kind = "joints"

    def __init__(self, rng, hidden, group, model=None, outside=None, plan=None, drive=False, quiet=()):
        self.rng, self.hidden, self.group, self.outside, self.drive = rng, list(hidden), group, outside, drive
        self.kind = "drive" if drive else "joints"
        h = set(hidden)
        base = ["joint-coulomb-friction", "joint-viscous-friction"]
        if rng.random() < 0.6 or "joint-friction-asymmetry" in h:
            base.append("joint-torque-offset")
        if not drive and rng.random() < 0.4:
            base.append("rotor-inertia")
        if drive and "joint-stribeck-friction" in h:
            h.add("joint-load-friction")
        more = [e for e in (["joint-stribeck-friction"] + ([] if drive else ["payload"])) if e not in h]
        if rng.random() < 0.3 and not h & {"joint-coulomb-friction", "joint-load-friction", "joint-viscous-friction", "joint-friction-asymmetry", "gravity-error", "joint-torque-gain", "joint-elasticity"}:
            base.append(str(rng.choice(more)))
        self.model = list(model) if model else ["rigid-body"] + [e for e in base if e not in h]
        if drive:
            self._drive()
        else:
            self._arm()
        n = self.arm.n
        self.scale = np.array(self.arm.extra["scale"])
        self.shapes = {e: shape(rng, e, n, self.scale) for e in self.model[1:] + list(hidden)}
        keep = {"joint-coulomb-friction": 1.0, "joint-viscous-friction": 1.0, "joint-torque-offset": 0.4, "rotor-inertia": 1.0, "joint-stribeck-friction": 0.5, "payload": 0.7}
        self.xamps = {e: keep.get(e, JRANGE[e][1]) * rng.uniform(0.6, 1.3) for e in self.model[1:]}
        if "joint-elasticity" in h:                          # sensors behind the gears: little friction is in the torque
            for e in ("joint-coulomb-friction", "joint-viscous-friction"):
                if e in self.xamps:
                    self.xamps[e] *= 0.4
        nu = ms.draw_common(rng, 200)
        enc = ms.logu(rng, 2e-6, 1e-3) if rng.random() < 0.6 else ms.logu(rng, 2e-6, 5e-5)
        lp = None if rng.random() < 0.5 else ms.logu(rng, 8, 50)
        nu.update(encoder=enc, sd=ms.logu(rng, 0.04, 0.2) * self.scale * rng.uniform(0.7, 1.3, n), lp=lp, lp_order=1, lp_zero=bool(rng.random() < 0.5),
                  native=None if rng.random() < 0.6 else float(rng.choice([100, 125, 250])), native_mode=str(rng.choice(["hold", "interp"])),
                  nonlin=float(rng.uniform(-0.005, 0.005)), temp=rng.uniform(-0.02, 0.02, n) * self.scale, tilt=rng.uniform(-1e-3, 1e-3, 2), strength=1.0)
        if "joint-elasticity" in h:
            nu.update(lp=None, native=None, encoder=min(nu["encoder"], 2e-5), sd=0.5 * nu["sd"])
        self.nu = nu
        self.seed_noise = int(rng.integers(2 ** 31))
        self._plan(plan)
        self.sim_cache = {}

    def _arm(self):
        rng = self.rng
        name = str(rng.choice(["lwr4plus", "panda", "ur5"]))
        self.arm = robots.load(name, yaw=0.0)
        self.arm.extra["scale"] = SCALE[name]
        self.tool = (float(rng.uniform(0.3, 2.0)), np.array([0, 0, rng.uniform(0.03, 0.08)])) if rng.random() < 0.5 else None
        self.gravity = np.array([0, 0, -9.81])

    def _drive(self):
        rng = self.rng
        J = ms.logu(rng, 0.02, 1.5)
        tau = J * 12.0
        one = lambda v: np.array([v], float)
        self.arm = robots.Arm("drive", "", ["axis"], np.eye(3)[None], np.zeros((1, 3)), np.array([[0, 0, 1.0]]), one(1e-9), np.zeros((1, 3)),
                              np.diag([J, J, J])[None], np.eye(3), np.zeros(3), np.zeros(3), one(J * (2 * np.pi * rng.uniform(15, 40)) ** 2), one(J * rng.uniform(0.3, 1.0)),
                              one(0.25 * tau), one(0.04 * tau), one(0.0), one(-1e9), one(1e9), one(1e9), extra=dict(scale=[0.3 * tau]))
        self.tool, self.gravity = None, np.zeros(3)

    def _plan(self, plan):
        rng, a = self.rng, self.arm
        n = a.n
        names = [f"q{i + 1}" for i in range(n)]
        p = Path(n, names, a.qn)
        if plan is not None:
            plan(rng, a, p)
        elif self.drive:
            p.hold(0.3, "rest")
            for w in rng.permutation([0.3, 1.0, 2.5, 6.0, 12.0, -0.3, -1.0, -2.5, -6.0, -12.0, 4.0, -4.0]):
                w = w * rng.uniform(0.8, 1.2)
                turn = np.sign(w) * min(max(abs(w) * 1.6, 1.0), 20)
                p.ramp(abs(w), "free", acc=rng.uniform(0.15, 0.5), q1=p.x[0] + turn)
            p.sine(6, "free", rng.uniform(0.3, 0.6), q1=2.5)
            p.sine(4, "free", rng.uniform(1.0, 1.8), q1=0.7)
            for _ in range(4):
                p.move(rng.uniform(0.6, 2.0), "free", q1=p.x[0] + rng.uniform(-6, 6))
        else:
            lim = lambda x: np.clip(x, a.lo + 0.15, a.hi - 0.15)
            R = np.minimum(0.95, 0.45 * (a.hi - a.lo))
            for _ in range(int(rng.integers(5, 8))):
                y = lim(a.qn + rng.uniform(-1, 1, n) * R)
                dv = np.abs(y - p.x) / (a.vmax * rng.uniform(0.25, 0.75))
                p.move(max(1.9 * dv.max(), 0.8), "free", frac=rng.uniform(0.2, 0.5), **dict(zip(names, y)))
            for _ in range(2):
                y = lim(p.x + rng.choice([-1, 1], n) * rng.uniform(0.15, 0.3, n))
                p.move(rng.uniform(3, 4), "free", frac=0.15, **dict(zip(names, y)))
                p.move(rng.uniform(2, 3), "free", frac=0.15, **dict(zip(names, lim(p.x - (y - p.x) - 0.2 * rng.choice([-1, 1], n)))))
            p.move(2.0, "free", **dict(zip(names, a.qn)))
            for lo, hi, am in ((0.12, 0.35, 0.6), (0.5, 1.1, 0.16)):
                f = rng.uniform(lo, hi, n)
                A = np.minimum(am * rng.uniform(0.6, 1.2, n), np.minimum(a.qn - a.lo, a.hi - a.qn) - 0.1)
                A = np.minimum(np.minimum(A, 0.7 * a.vmax / (2 * np.pi * f)), 5.0 / (2 * np.pi * f) ** 2)
                p.sine(rng.uniform(7, 10) if lo < 0.3 else rng.uniform(4, 6), "free", list(f), **dict(zip(names, A)))
            p.move(1.0, "free", **dict(zip(names, a.qn + 0.2 * rng.uniform(-1, 1, n))))
        t, X, ph = p.sample(250)
        cs = CubicSpline(t, X)
        self.tk = np.arange(int(t[-1] * 1000)) / 1000
        self.qd, self.dqd, self.ddqd = cs(self.tk), cs(self.tk, 1), cs(self.tk, 2)
        self.ddqd[:1] = 0
        if (np.abs(self.dqd).max(0) > a.vmax).any() or (self.qd < a.lo + 0.03).any() or (self.qd > a.hi - 0.03).any():
            raise Redraw("limits")
        self.phase = ph[np.minimum((self.tk * 250).astype(int), len(ph) - 1)]
        self.Tend = self.tk[-1]

    def world(self, amps):
        a = self.arm
        n = a.n
        fr = dict(fc=np.zeros(n), fv=np.zeros(n))
        w = dict(K=a.K * (2.0 if not self.drive else 4.0), rotor=0.0, sens={}, payload=None, tilt=None, motor_side=False)
        for e, v in {**self.xamps, **amps}.items():
            if e == "outside":
                continue
            sh = self.shapes[e]
            if e == "joint-coulomb-friction":
                fr["fc"] = fr["fc"] + v * a.Fc * sh["per"]
            elif e == "joint-viscous-friction":
                fr["fv"] = v * a.Fv * sh["per"]
            elif e == "joint-friction-asymmetry":
                fr["asym"] = v * sh["per"]
            elif e == "joint-stribeck-friction":
                fr.update(df=v * a.Fc * sh["per"], vs=sh["vs"] * (10 if self.drive else 1))
            elif e == "joint-load-friction":
                fr["lf"] = v * sh["per"]
            elif e == "joint-torque-ripple":
                fr.update(ra=v * sh["per"], ra2=0.3 * v * sh["per"], rk=sh["k"], rp=sh["ph"][0], rp2=sh["ph"][1])
            elif e == "joint-spring":
                fr.update(ks=v * sh["per"], k0=sh["q0"] * (4 if self.drive else 1))
            elif e == "joint-torque-offset":
                w["sens"]["bias"] = v * sh["per"] * self.scale
            elif e == "joint-torque-gain":
                w["sens"]["gain"] = v * sh["per"]
            elif e == "rotor-inertia":
                w["rotor"] = v * sh["per"]
            elif e == "payload":
                w["payload"] = (v, sh["com"])
            elif e == "gravity-error":
                w["tilt"] = v * sh["dir"]
            elif e == "joint-elasticity":
                w["K"], w["motor_side"] = a.K / (v * sh["per"]), True
        w["fr"] = fr
        return w

    def simulate(self, w, strength):
        a = self.arm
        n = a.n
        key = repr((w["fr"], w["K"], w["rotor"], w["payload"], w["tilt"], strength))
        if key in self.sim_cache:
            return self.sim_cache[key]
        m, c, I = a.m, a.c, a.I
        mass, com = self.tool if self.tool else (0.0, np.zeros(3))
        if w["payload"]:
            pm, pc = w["payload"]
            M = mass + pm
            cn = (mass * com + pm * pc) / M
            sh = lambda mm, d: mm * (d @ d * np.eye(3) - np.outer(d, d))
            m, c, I = a.with_tool(M, cn, sh(mass, com - cn) + sh(pm, pc - cn))
        elif self.tool:
            m, c, I = a.with_tool(mass, com)
        tilt = w["tilt"] if w["tilt"] is not None else strength * self.nu["tilt"]
        g = self.gravity.copy()
        if not self.drive:
            g[:2] += 9.81 * np.asarray(tilt)
        args = (a.Rp, a.pp, a.ax, m, c, I)
        if w["motor_side"]:
            self.sim_cache = {key: self.flat(w, g, args)}
            return self.sim_cache[key]
        tau = dyn.torques(self.qd, self.dqd, self.ddqd, g, *args)
        B = a.B
        om = 2 * np.pi * (4.0 if not self.drive else 6.0)
        kp, kd = B * om * om + 0.0 * B, 2 * 0.8 * om * B
        if not self.drive:
            kp, kd = (B + 0.5) * om * om, 1.6 * om * (B + 0.5)
        fr = w["fr"]
        fp = armlib.friction_array(n, **{k: v for k, v in fr.items()})
        fp[:, 6] = 5e-4
        tff = tau + B * self.ddqd + fr["fv"] * self.dqd + 0.8 * fr["fc"] * np.tanh(self.dqd / 0.02)
        thd = self.qd + tau / w["K"]
        dthd = np.gradient(thd, 1e-3, axis=0)
        rs = np.random.default_rng(self.seed_noise + 3)
        ch = rs.normal(size=self.qd.shape) * 0.01 * a.Fc
        z3 = np.zeros(3)
        if self.drive:
            D = 0.3 * np.sqrt(w["K"] * B)
        else:
            Rj, pj, zj, M = np.empty((n, 3, 3)), np.empty((n, 3)), np.empty((n, 3)), np.empty((n, n))
            dyn.fk(a.qn, a.Rp, a.pp, a.ax, Rj, pj, zj)
            dyn.crba(m, c, I, Rj, pj, zj, M)
            D = 2 * 0.2 * np.sqrt(w["K"] * np.diag(M))
        rec = armlib.simulate(thd, dthd, tff, 4, 2.5e-4, 4, kp, kd, np.zeros(6), np.zeros(6), a.Rp, a.pp, a.ax, a.Rs, a.ps, a.tip, m, c, I, g, w["K"], B, D, fp, ch,
                              False, z3, np.array([0, 0, 1.0]), np.array([1.0, 0, 0]), np.array([0, 1.0, 0]), 0.0, contact.pack({}), np.zeros(1), np.ones(1))
        q = rec[:, 1:1 + n]
        if not np.isfinite(rec).all() or np.abs(q[:len(self.qd)] - self.qd[:len(q)]).max() > (0.3 if not self.drive else 3.0):
            raise Redraw("the arm ran away")
        tl = rec[:, 1 + 6 * n:1 + 7 * n] + rec[:, 1 + 7 * n:1 + 8 * n]
        tl = tl + B * w["rotor"] * rec[:, 1 + 5 * n:1 + 6 * n]
        s = slice(1 + 3 * n, 1 + 4 * n) if w["motor_side"] else slice(1, 1 + n)
        s2 = slice(1 + 4 * n, 1 + 5 * n) if w["motor_side"] else slice(1 + n, 1 + 2 * n)
        out = dict(t=rec[:, 0], q=rec[:, s], dq=rec[:, s2], Y=tl)
        self.sim_cache = {key: out}
        return out

    def flat(self, w, g, args):
        """Encoders on the motors, soft undamped gears: a flatness-based controller (De Luca) keeps the links on their smoothed path, so that
        theta = q + tau_link(q) / K; a slow tracking error is added to the path."""
        n, dt = self.arm.n, 1e-3
        rs = np.random.default_rng(self.seed_noise + 5)
        path = np.pad(self.qd, ((600, 600), (0, 0)), mode="edge")                    # a rest before and after
        err = gaussian_filter1d(rs.normal(size=path.shape), 250, axis=0) * 30 * 6e-4
        q = gaussian_filter1d(path + err * np.clip(np.minimum(np.arange(len(path)), np.arange(len(path))[::-1]) / 1000, 0, 1)[:, None], 90, axis=0, mode="nearest")
        dq = np.gradient(q, dt, axis=0)
        ddq = np.gradient(dq, dt, axis=0)
        tau = dyn.torques(q, dq, ddq, g, *args)
        th = q + tau / w["K"]
        dth = np.gradient(th, dt, axis=0)
        fp = armlib.friction_array(n, **w["fr"])
        fp[:, 6] = 5e-4
        gear = armlib.gear_along(th, dth, tau, fp, dt)
        Y = tau + gear + self.arm.B * w["rotor"] * np.gradient(dth, dt, axis=0)
        return dict(t=np.arange(len(q)) * dt, q=th, dq=dth, Y=Y)

    def record(self, amps, strength, skip=()):
        w = self.world(amps)
        r = self.simulate(w, strength)
        n = self.arm.n
        nu = dict(self.nu, strength=strength)
        if nu["lp"] and strength < 1:
            nu["lp"] = nu["lp"] / max(strength, 1e-3)
            if nu["lp"] > 150:
                nu["lp"] = None
        if nu["native"] and strength < 0.5:
            nu["native"] = None
        rng = np.random.default_rng(self.seed_noise)
        t = ms.sample_times(rng, r["t"][-1], nu["fs"], nu["jitter"], nu["drop"])
        enc = 2e-6 * (nu["encoder"] / 2e-6) ** max(strength, 0.0)
        q = ms.encoder(rng, ms.at(r["t"], r["q"], t), enc)
        nu["encoder"] = enc
        log = {"t": t, **{f"q{i + 1}": q[:, i] for i in range(n)}}
        if nu["dq"] and not self.drive:
            v = ms.velocity(rng, r["t"], r["dq"], t, nu)
            log.update({f"dq{i + 1}": v[:, i] for i in range(n)})
        Y = r["Y"]
        if self.outside:
            Y = Y + self.outside.joints(self, r, amps)
        V = ms.sensor_chain(rng, r["t"], Y, t, w["sens"], nu, nu["sd"])
        log.update({f"tau{i + 1}": V[:, i] for i in range(n)})
        return log, dict(gravity=self.gravity, tool=self.tool), w, w["sens"], {}, nu


def judge(case, amps, strength, skip=()):
    log, rig, w, sens, tool, nu = case.record(amps, strength)
    span = 0.02 * max(1.0, (nu["encoder"] / 5e-6) ** 0.35)
    ser = JointSeries(log, None if case.drive else case.arm, case.gravity, case.tool, most=4000 if not case.drive else 8000, span=min(span, 0.12))
    sh = case.shapes.get("joint-torque-ripple")
    ripple = dict(enumerate(sh["k"])) if sh else None
    truth = {}
    if w["payload"]:
        pm, pc = w["payload"]
        x = case.arm.ps + case.arm.Rs @ pc
        truth.update(pm=pm, **{f"pc{i}": pm * x[i] for i in range(3)})
    if w["motor_side"]:
        truth.update({f"el{j}": 1 / w["K"][j] for j in range(case.arm.n)})
    if "vs" in w["fr"]:
        truth["sv"] = w["fr"]["vs"]
        truth.update({f"st{j}": w["fr"]["df"][j] for j in range(case.arm.n)})
    if "k0" in w["fr"]:
        truth.update({f"q0{j}": w["fr"]["k0"][j] for j in range(case.arm.n)})
        truth.update({f"ks{j}": w["fr"]["ks"][j] for j in range(case.arm.n)})
    j = JointJudge(ser, case.model, case.hidden, nu["sd"], truth, ripple)
    return j, (log, rig, w, sens, tool, nu)
