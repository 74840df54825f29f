"""An arm with a wrist sensor pokes and slides: draws a world, runs the closed loop (arm.py), builds the readings and the log."""
import os, shutil
import numpy as np
import chain, arm, laws, motion, refit, effects
from chain import sensor_motion, rotvec
from effects import U, LU, sign, unit
from io_log import write_log, toml

HERE = os.path.dirname(os.path.abspath(__file__))
_chains = {}


def robot(name):
    if name not in _chains:
        _chains[name] = chain.load(os.path.join(HERE, "models", name + ".urdf"))
    return _chains[name]


ROTOR = np.array([.8, .8, .4, .4, .15, .08, .05])
OUTSIDE = ("breathing", "puncture", "hose", "shift", "hum23")


class Wrench:
    kind = "wrench"

    def __init__(self, seed, plan):
        self.seed, self.plan = seed, plan
        self.model, self.hidden, self.group, self.targets = plan["model"], plan["hidden"], plan["group"], plan["targets"]
        self.names = self.model + self.hidden
        rng = self.rng = np.random.default_rng(seed)
        self.soft, self.noise, self.Ldev = 1.0, 1.0, 0.
        has = lambda e: e in self.names
        self.base = self.model[0]
        self.n0 = refit.EXPONENT[self.base]
        self.outside = plan.get("outside")
        # -- material, tool, sensor
        self.Fmax, self.dmax = LU(rng, 9, 30), U(rng, 3e-3, 7e-3)
        if has("sensor-crosstalk") or has("structural-compliance") or has("tip-offset"):
            self.Fmax = U(rng, 18, 32)
        self.D0 = .6 * self.dmax
        F0 = self.Fmax * .6 ** self.n0
        self.mass, self.com = U(rng, .2, .55), np.array([U(rng, -.004, .004), U(rng, -.004, .004), U(rng, .035, .06)])
        ctx = dict(Fmax=self.Fmax, dmax=self.dmax, k=self.Fmax / self.dmax, base=self.base, n0=self.n0, mass=self.mass, reach=.03, mains=float(rng.choice([50, 60])))
        self.law = dict(F0=F0, D0=self.D0, N0=.4 * self.Fmax, n=self.n0, s1=7e-4)
        if has("kelvin-voigt"):
            self.law["c"] = U(rng, .5, 3) * self.Fmax
        if has("hunt-crossley"):
            self.law["lam"] = U(rng, .8, 4)
        if has("coulomb-friction"):
            self.law["mu"] = LU(rng, .07, .35)
        if set(self.hidden) & {"friction-anisotropy", "load-dependent-friction", "presliding"}:
            self.law["mu"] = U(rng, .18, .35)
        if set(self.hidden) & {"stribeck-friction", "friction-rounding"}:
            self.law["mu"] = U(rng, .05, .12)
        if has("friction-rounding"):
            self.law["vr"] = LU(rng, 2e-3, 7e-3)
        elif not has("presliding"):
            self.Ldev = U(rng, -.16, .16)
            self.law.update(L=1e-4, bristle=float(rng.choice([0, 1, 2, 3], p=[.2, .35, .15, .3])))
        self.amps = [effects.draw(e, rng, ctx) for e in self.hidden]
        self.extra = [effects.draw(e, rng, ctx) for e in self.model if e not in refit.BASES and e not in ("coulomb-friction", "friction-rounding")]
        for a in self.extra:        # what the base has beyond contact and friction
            a["A"] = float(np.clip(a["A"] * U(rng, .6, 1.5), a["lo"], a["hi"]))
        if "presliding" in self.hidden:
            self.law["bristle"] = float(rng.choice([0, 2]))
        # -- nuisances, each there or not
        on = lambda p=.6: rng.random() < p
        q = self.nuis = {}
        q["eps"] = U(rng, -.015, .015) if on() else 0.
        q["r2"] = U(rng, .005, .02) if on(.5) else 0.
        q["surface"] = U(rng, -4e-5, 4e-5)
        q["mass"] = U(rng, -.012, .012) if on() else 0.
        q["com"] = unit(rng) * U(rng, 0, 6e-4) if on() else np.zeros(3)
        q["tilt"] = unit(rng) * U(rng, 0, 1e-3) if on() else np.zeros(3)
        q["drift"] = np.concatenate([unit(rng) * U(rng, 0, .05), unit(rng) * U(rng, 0, .001)]) if on() else np.zeros(6)
        q["nonlin"] = U(rng, -.006, .006) if on(.5) else 0.
        q["clock"] = U(rng, -3e-4, 3e-4) if on() else 0.
        q["lowpass"] = float(1 / (2 * np.pi * LU(rng, 70, 400))) if on(.7) else 0.
        q["tip_radius"] = U(rng, 0, 1.2e-3) if on(.4) else 0.
        q["colour"] = U(rng, .2, .6) if on(.6) else 0.
        q["colour_tau"] = LU(rng, .01, .3)
        q["encoder"] = LU(rng, 2e-6, 1e-5)
        q["dq"] = bool(rng.random() > .25)
        q["dq_bias"], q["dq_lag"], q["dq_fc"], q["dq_noise"] = unit(rng, 7) * U(rng, 0, 2e-4), U(rng, 0, 5e-3), LU(rng, 20, 120), LU(rng, 1e-4, 1.5e-3)
        q["jitter"] = U(rng, .02, .15) if on(.3) else 0.
        q["drops"] = U(rng, .001, .02) if on(.3) else 0.
        q["bristle"] = ["Dahl", "Prandtl", "LuGre", "elasto-plastic"][int(self.law.get("bristle", 0))] if not has("friction-rounding") else "rounded"
        q["bristle_length"] = 1e-4 * (1 + self.Ldev)
        self.tau2 = LU(rng, .3, 3)
        self.sd_f = self.Fmax * LU(rng, .0024, .005)
        self.sd_t = self.sd_f * U(rng, .06, .12)
        self.chan = np.exp(rng.uniform(-.2, .2, 6))
        self.rate = float(plan.get("rate") or rng.choice([250, 500, 500, 1000, 1000]))
        if has("mains-hum"):
            self.rate = max(self.rate, 500.)
        self.dt = 5e-4 if self.rate > 1000 else 1e-3
        self.out_A, self.out_rng = 1.0, int(rng.integers(1 << 30))
        self._site(rng)
        self._script(rng)
        self.simseed = int(rng.integers(1 << 30))
        self.logseed = int(rng.integers(1 << 30))

    # ------------------------------------------------------------ where and how it moves
    def _site(self, rng):
        self.robot = self.plan.get("robot") or str(rng.choice(["lwr4plus", "iiwa"]))
        self.ch = robot(self.robot)
        self.g = np.array([0, 0, -9.81])
        if rng.random() < .12:
            self.g = rotvec([0, float(rng.choice([-1, 1])) * np.pi / 2, 0]) @ self.g
            self.g[np.abs(self.g) < 1e-9] = 0
        for _ in range(40):
            n = rotvec(np.append(rng.normal(size=2) * (.0 if rng.random() < .5 else .25), 0)) @ np.array([0, 0, 1.])
            yaw = U(rng, -np.pi, np.pi) if rng.random() < .6 else 0.
            t1 = rotvec(yaw * np.array([0, 0, 1.])) @ np.array([1., 0, 0])
            t1 -= n * (t1 @ n)
            t1 /= np.linalg.norm(t1)
            ang = U(rng, -np.pi, np.pi)
            P0 = np.array([U(rng, .42, .62) * np.cos(.6 * ang), U(rng, .42, .62) * np.sin(.6 * ang), U(rng, .05, .3)])
            frame = np.round(np.array([P0, n, t1, np.cross(n, t1)]), 6)
            frame[1] /= np.linalg.norm(frame[1]); frame[2] -= frame[1] * (frame[2] @ frame[1]); frame[2] /= np.linalg.norm(frame[2])
            frame[3] = np.cross(frame[1], frame[2])
            c = rotvec(U(rng, -np.pi, np.pi) * frame[1]) @ frame[2]
            R0 = np.array([c, np.cross(-frame[1], c), -frame[1]]).T
            turn = .7
            probe = [np.zeros(6)]
            for k in range(24):
                w = unit(rng) * turn * (k % 3 > 0)
                probe.append(np.array([U(rng, -.045, .045), U(rng, -.045, .045), .07 if k % 3 else 0., *w]))
                probe.append(np.array([0, 0, .02, 0, 0, 0]))
            probe = np.array(probe)
            up = np.repeat(np.linspace(0, 1, 10), 1)
            fine = np.vstack([a + (b - a) * u for a, b in zip(probe[:-1], probe[1:]) for u in up])
            X, R = motion.to_world(fine, frame, R0)
            Q = arm.solve_path(self.ch, X, R, rng, tries=25)
            if Q is not None:
                self.frame, self.R0, self.q0 = frame, R0, Q[0]
                return
        raise RuntimeError("no site")

    def _controller(self, rng):
        n = self.ch.n
        q = self.q0
        tip = self.ch.ps + self.ch.Rs @ self.ch.rt
        R, p, z = chain.forward(*self.ch.args(), q)
        J = chain.jacobian(p, z, p[-1] + R[-1] @ tip)
        tool = self.ch.with_tool(self.mass, self.com)
        M = chain.mass_matrix(*tool.dyn(), q) + np.diag(ROTOR)
        mode = int(rng.integers(0, 3))
        nn = self.frame[1]
        if mode == 0:
            kp = np.array([1500, 1500, 1200, 1200, 500, 350, 200]) * LU(rng, 1.5, 12)
            kd = 2 * U(rng, .5, 1) * np.sqrt(kp * np.diag(M))
            kc = 1 / (nn @ (J[:3] @ np.diag(1 / kp) @ J[:3].T) @ nn)
        elif mode == 1:
            kx = LU(rng, 6000, 25000)
            kp = np.array([kx, U(rng, 300, 700), 60.])
            me = 1 / np.linalg.eigvalsh(J[:3] @ np.linalg.inv(M) @ J[:3].T)[1]
            kd = np.array([2 * .7 * np.sqrt(kx * me), U(rng, 8, 14), 6.])
            kc = kx
        else:
            w = LU(rng, 45, 110)
            kp, kd = np.array([w * w]), np.array([2 * U(rng, .6, 1) * w])
            kc = w * w / (nn @ (J[:3] @ np.linalg.inv(M) @ J[:3].T) @ nn)
        self.ctrl = dict(mode=mode, kp=kp, kd=kd, tremor=np.array([.3, .3, .2, .2, .06, .04, .02]), tremor_scale=LU(rng, .03, .4),
                         jf=np.array([.6, .6, .4, .4, .15, .1, .06]) * U(rng, .2, 1.2), jl=LU(rng, 3e-4, 2e-3))
        self.kc = float(kc)

    def _script(self, rng):
        self._controller(rng)
        o = effects.emphasis(self.hidden, rng, False)
        o.update(self.plan.get("opt", {}))
        if "two" in o and not o["two"]:
            pass
        P = dict(self.law)
        for a in self.amps + self.extra:
            if a["stage"] == "law":
                w = dict(law={}, post={}); a["put"](w, a["A"]); P.update({k: v for k, v in w["law"].items() if k in ("n", "sK", "sB", "mR", "mL")})
        P.update(mu=0, s1=0, c=0, lam=0)
        Pv = laws.pack({k: v for k, v in P.items() if k in laws.IX})
        ff = U(rng, .75, 1.0)

        def force(d):
            return max(0, laws.contact(Pv, np.zeros(laws.NS), 1e-3, 0., d, 0., 0., 0., 0., 0.)[0])

        def press(d):
            return d + (1 - ff) * force(d) / self.kc
        for trial in range(8):
            ts, arr, tags = motion.wrench_script(rng, self.dmax, press, o)
            if trial:
                arr[:, 3:] *= 1 - .1 * trial
            X, R = motion.to_world(arr, self.frame, self.R0)
            Q, err = arm.ik_track(*self.ch.args(), self.ch.Rs, self.ch.ps + self.ch.Rs @ self.ch.rt, self.q0, X, R, np.zeros(7), 80)
            if err.max() < 1e-5 and (Q > self.ch.lo + .02).all() and (Q < self.ch.hi - .02).all():
                break
        else:
            raise RuntimeError("path leaves the joints' range")
        self.ts, self.Qp, self.tags, self.arr = ts, Q, tags, arr
        self.push = np.array([ff * force(-h) if h < 0 else 0. for h in arr[:, 2]])

    # ------------------------------------------------------------ the loop
    def _world(self):
        w = dict(law=dict(self.law), post={}, tip_off=np.zeros(3))
        for a in self.extra + self.amps:
            a["put"](w, a["A"])
        return w

    def resim(self):
        w = self._world()
        L = w["law"]
        L["eps"] = self.soft * self.nuis["eps"]
        if self.Ldev:
            L["L"] = 1e-4 * (1 + self.soft ** .5 * self.Ldev)
        relax = "relaxation" in self.names
        if self.nuis["r2"]:
            L.update(r2=self.soft * self.nuis["r2"] * (3 if relax else .6), tau2=L.get("tau1", 1) * 3 if relax else self.tau2)
        if self.outside == "breathing":
            L.update(wobA=3e-4 * self.out_A, wobF=.18 + .2 * ((self.out_rng % 97) / 97), wobP=1.0)
        if self.outside == "puncture":
            L.update(punR=min(.8, .3 * self.out_A), punD=.8 * self.dmax)
        P = laws.pack({k: v for k, v in L.items() if k in laws.IX})
        tool = (self.mass, self.com, None)
        try:
            self.sim = arm.simulate(self.ch, tool, ROTOR, self.g, self.Qp, self.ts, self.frame, P, self.ctrl, self.ch.rt + w["tip_off"], self.dt, self.simseed, self.push)
        except RuntimeError:
            self.ctrl["kp"] = self.ctrl["kp"] * .6; self.ctrl["kd"] = self.ctrl["kd"] * .7; self.dt = 5e-4
            self.sim = arm.simulate(self.ch, tool, ROTOR, self.g, self.Qp, self.ts, self.frame, P, self.ctrl, self.ch.rt + w["tip_off"], self.dt, self.simseed, self.push)

    def ease(self):
        """Softer nuisances that act inside the loop; less friction where it's the bristle that doesn't fit. True: run the loop again."""
        if "mu" in self.law and "coulomb-friction" not in self.hidden:
            self.law["mu"] *= .85
        self.Ldev *= .5
        self.ctrl["tremor_scale"] *= .7
        return True

    def rig(self):
        """What the careful user states."""
        w = self._world()["post"]
        s = self.soft
        f = self.frame.copy()
        f[0] = f[0] + f[1] * (s * self.nuis["surface"] - w.get("surface", 0.))
        mass = self.mass * (1 + s * self.nuis["mass"]) - w.get("dm", 0.)
        com = self.com + s * self.nuis["com"] - w.get("dcom", np.zeros(3))
        return dict(frame=f, gravity=self.g, mass=round(float(mass), 4), com=np.round(com, 5), tip=self.ch.rt)

    def wrench_truth(self):
        """Load on the tool in the sensor frame at the simulation's rate, before the sensor."""
        t, Q, dQ, ddQ, F, _ = self.sim
        w = self._world()
        R, P, V, W, dW, A = sensor_motion(*self.ch.args(), self.ch.Rs, self.ch.ps, Q, dQ, ddQ)
        g = rotvec(self.soft * self.nuis["tilt"]) @ self.g
        Rt = np.transpose(R, (0, 2, 1))
        a = Rt @ g - A
        c = self.com
        ft = self.mass * (a - np.cross(dW, c) - np.cross(W, np.cross(W, c)))
        tt = np.cross(c, ft)
        I = w["post"].get("inertia")
        if I is not None:
            tt = tt - dW @ I.T - np.cross(W, W @ I.T)
        fc = np.einsum("nij,nj->ni", Rt, F)
        ns = Rt @ self.frame[1]
        r = self.ch.rt + w["tip_off"] - self.soft * self.nuis["tip_radius"] * (np.array([0, 0, 1.]) + ns)
        out = np.hstack([ft + fc, tt + np.cross(r, fc)])
        if self.outside == "hose":      # a hose dragged along: elastic pull towards a point beside the wrist, with its own slack
            rg = np.random.default_rng(self.out_rng)
            hook = np.array([.12, .05, -.05]) * sign(rg)
            v = (self.frame[0] + .25 * unit(rg) + np.array([0, 0, .35])) - (P + R @ hook)
            L = np.linalg.norm(v, axis=1)
            L0 = np.quantile(L, .35)
            pull = self.out_A * 25 * np.maximum(L - L0, 0) / L
            fh = np.einsum("nij,nj->ni", Rt, v * pull[:, None])
            out += np.hstack([fh, np.cross(np.broadcast_to(hook, fh.shape), fh)])
        return t, out

    def build(self):
        """Log times, joints, readings (before and after quantization)."""
        t, w = self.wrench_truth()
        post, s, q = self._world()["post"], self.soft, self.nuis
        rng = np.random.default_rng(self.logseed)
        Q, dQ = self.sim[1], self.sim[2]
        fs = 1 / self.dt
        if "rot" in post:
            R = rotvec(post["rot"]); w = np.hstack([w[:, :3] @ R.T, w[:, 3:] @ R.T])
        w = w * (1 + post.get("gain", 0.))
        if "cross" in post:
            w = w @ (np.eye(6) + post["cross"]).T
        if q["nonlin"]:
            top = np.array([self.Fmax] * 3 + [.12 * self.Fmax] * 3)
            w = w + s * q["nonlin"] * w * np.abs(w) / top
        for tau in (s * q["lowpass"], post.get("lag", 0.)):
            if tau > 1e-5:
                w = refit.lagged(t, w, tau)
        w = w + post.get("bias", 0.) + (t[:, None] / 60) * (post.get("drift", np.zeros(6)) + s * q["drift"])
        if self.outside == "shift":      # something in the mount gives way, twice
            rg = np.random.default_rng(self.out_rng)
            for f in (.37, .71):
                w = w + (t > f * t[-1])[:, None] * np.concatenate([unit(rg), .04 * unit(rg)]) * self.out_A * .8 * sign(rg)
        if self.outside == "hum23":      # an unbalanced fan on the flange, with its speed hunting
            rg = np.random.default_rng(self.out_rng)
            ph = 2 * np.pi * np.cumsum(U(rg, 14, 24) * (1 + .08 * np.sin(2 * np.pi * t / 7.3))) * self.dt
            w = w + np.outer(np.sin(ph), np.concatenate([unit(rg), .03 * unit(rg)])) * self.out_A
        n = int(t[-1] * self.rate)
        tk = np.arange(n) / self.rate
        if q["jitter"]:
            tk = np.clip(tk + rng.normal(size=n) * q["jitter"] / self.rate / 3, 0, t[-1])
        keep = np.ones(n, bool)
        if q["drops"]:
            keep = rng.random(n) > q["drops"]
            keep[:2] = True
        I = lambda tt, M: np.column_stack([np.interp(tt, t, M[:, i]) for i in range(M.shape[1])])
        y = I(tk - post.get("toff", 0.) - s * q["clock"], w)
        if "hum" in post:
            ph = 2 * np.pi * post["humf"] * tk
            rg = np.random.default_rng(self.logseed + 1)
            y = y + np.outer(np.sin(ph), post["hum"]) + .3 * np.outer(np.sin(2 * ph + 1), post["hum"] * rg.uniform(-1, 1, 6)) + .2 * np.outer(np.sin(3 * ph + 2), post["hum"] * rg.uniform(-1, 1, 6))
        sd = self.noise * self.chan * np.array([self.sd_f] * 3 + [self.sd_t] * 3)
        e = rng.normal(size=(n, 6))
        if q["colour"]:
            a = np.exp(-1 / (self.rate * q["colour_tau"]))
            from scipy.signal import lfilter
            e = np.sqrt(1 - q["colour"] ** 2) * e + q["colour"] * np.sqrt(1 - a * a) * lfilter([1], [1, -a], rng.normal(size=(n, 6)), axis=0)
        clip = None
        if "clip" in post:
            j = 2 if np.abs(y[:, 2]).max() > .3 * np.abs(y[:, :3]).max() else int(np.argmax(np.abs(y[:, :3]).max(0)))
            top = np.abs(y[:, j]).max() * (1 - post["clip"])
            clip = (j, float(top))
        behind = self.logseed % 2      # noise behind the clip or before it
        if clip and behind:
            y[:, clip[0]] = np.clip(y[:, clip[0]], -clip[1], clip[1])
        y = y + e * sd
        if clip and not behind:
            y[:, clip[0]] = np.clip(y[:, clip[0]], -clip[1], clip[1])
        self.clip = clip
        yq = y
        if "quant" in post:
            st = np.array([post["quant"]] * 3 + [post["quant"] * .02] * 3)
            yq = np.round(y / st) * st
        qk = np.round((I(tk, Q) + rng.normal(size=(n, Q.shape[1])) * .3 * q["encoder"]) / q["encoder"]) * q["encoder"]
        from scipy.signal import butter, sosfilt
        sos = butter(1, min(q["dq_fc"], .4 * fs), fs=fs, output="sos")
        v = I(tk - q["dq_lag"], sosfilt(sos, dQ, axis=0)) + q["dq_bias"] + rng.normal(size=qk.shape) * q["dq_noise"]
        return [x[keep] for x in (tk, qk, v, y, yq)]

    def noise_rms(self):
        sd = self.noise * self.chan * np.array([self.sd_f] * 3 + [self.sd_t] * 3)
        return refit.rms(sd[:3]), refit.rms(sd[3:])

    def data(self):
        t, q, dq, y, yq = self.logged = self.build()
        sd = self.noise * self.chan * np.array([self.sd_f] * 3 + [self.sd_t] * 3)
        D = refit.arm_data(t, q, y, self.ch, self.rig(), self.base, sd, self.D0, .4 * self.Fmax)
        if "mains-hum" in self.names:
            D.stated["hum"] = self._world()["post"]["humf"]
        step = max(1, int(np.ceil(len(t) / 4500)))
        return D, (yq - y)[::step]

    def theta(self):
        w = self._world()
        L, p = w["law"], w["post"]
        th = {k: L[k] for k in ("F0", "c", "lam", "n", "r1", "tau1", "hA", "hL", "mR", "mL", "aF", "aL", "sK", "sB", "alpha", "C", "mu", "cv", "dmu", "vs", "L", "vr", "p", "a") if k in L}
        th.update(ox=w["tip_off"][0], oy=w["tip_off"][1], oz=w["tip_off"][2])
        if "friction-rounding" not in self.names:
            th.pop("vr", None)
        if "presliding" not in self.names:
            th.pop("L", None)
        th["z0"] = p.get("surface", 0.)
        th["dm"] = p.get("dm", 0.)
        d = p.get("dcom", np.zeros(3)); th.update(dcx=d[0], dcy=d[1], dcz=d[2])
        r = p.get("rot", np.zeros(3)); th.update(mx=r[0], my=r[1], mz=r[2])
        th.update(g=p.get("gain", 0.), lag=p.get("lag", 0.), toff=p.get("toff", 0.))
        if "humf" in p:
            th["hum"] = p["humf"]
        return th

    # ------------------------------------------------------------ out
    def write(self, folder, rng):
        t, q, dq, y, yq = self.logged
        cols = {"t": t}
        for i in range(q.shape[1]):
            cols[f"q{i+1}"] = q[:, i]
        if self.nuis["dq"]:
            for i in range(q.shape[1]):
                cols[f"dq{i+1}"] = dq[:, i].astype(np.float32)
        for i, k in enumerate(("fx", "fy", "fz", "tx", "ty", "tz")):
            cols[k] = yq[:, i] if "quantization" in self.names else yq[:, i].astype(np.float32)
        if rng.random() < .85:
            cols["phase"] = self.tags[np.clip(np.searchsorted(self.ts, t), 0, len(self.tags) - 1)]
        if rng.random() < .2:
            Qd = self.sim[5]
            for i in range(q.shape[1]):
                cols[f"q_cmd{i+1}"] = np.interp(t, self.sim[0], Qd[:, i])
        name = write_log(folder, cols, rng)
        r = self.rig()
        f = r["frame"]
        rob = dict(model="lwr4plus" if self.robot == "lwr4plus" else "iiwa.urdf", sensor_frame="ft_sensor", tip_frame="tool_tip")
        if self.robot != "lwr4plus":
            shutil.copy(os.path.join(HERE, "models", self.robot + ".urdf"), os.path.join(folder, "iiwa.urdf"))
            rob["joints"] = self.ch.names
        if abs(self.g[2] + 9.81) > 1e-9:
            rob["gravity"] = self.g
        tool = dict(mass=r["mass"], com=r["com"])
        doc = dict(robot=rob, tool=tool, surface=dict(point=np.round(f[0], 7), normal=f[1], tangent=f[2]))
        if rng.random() < .6:
            nf, nt = self.noise_rms()
            doc["sensor"] = dict(noise=[float(f"{nf:.2g}")] * 3 + [float(f"{nt:.2g}")] * 3)
        toml(os.path.join(folder, "rig.toml"), doc)
        return name, float(t[-1] - t[0])

    def nuisances(self):
        s = self.soft
        n = {k: (v.tolist() if isinstance(v, np.ndarray) else v) for k, v in self.nuis.items()}
        n.update(scale=s, rate=self.rate, noise_N=self.noise_rms()[0], noise_Nm=self.noise_rms()[1], controller=["joint impedance", "Cartesian impedance", "computed torque"][self.ctrl["mode"]],
                 tip_stiffness=self.kc, tremor_scale=self.ctrl["tremor_scale"], robot=self.robot)
        return n

    def parameters(self):
        w = self._world()
        c = lambda v: v.tolist() if isinstance(v, np.ndarray) else (float(v) if isinstance(v, (int, float, np.floating)) else v)
        return dict(law={k: c(v) for k, v in w["law"].items()}, post={k: c(v) for k, v in w["post"].items()}, tip_offset=c(w["tip_off"]),
                    tool_mass=self.mass, tool_com=c(self.com), amplitude={e: a["A"] for e, a in zip(self.hidden, self.amps)},
                    **({"clip": [int(self.clip[0]), self.clip[1]]} if getattr(self, "clip", None) else {}),
                    **({"outside": self.outside, "outside_amplitude": self.out_A} if self.outside else {}))
