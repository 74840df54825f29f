"""One contact case, an arm with a wrench sensor or a material tester: draws, motion, physics, log, refits."""
import copy

import numpy as np

import catalogue as cat
import hidden as hid
import laws
import material
import motion
import sensing
from refit import Fit, Rejected, near, rms
from robots import arm, expm, mv


class ContactCase:
    def __init__(self, rng, plan):
        self.rng, self.plan, self.kind = rng, plan, plan["kind"]
        self.wrench = self.kind == "wrench"
        self.names, self.hidden = plan["model"], plan["hidden"]
        u, pick = rng.uniform, lambda *a: a[int(rng.integers(len(a)))]
        true = self.names + self.hidden
        has = lambda n: n in true
        self.base = true[0]
        self.stiff_tester = (not self.wrench) and u() < 0.3
        D = u(1.5e-3, 5e-3) if self.wrench else u(1e-3, 6e-3)
        Fmax = float(np.exp(u(np.log(5), np.log(18)))) if self.wrench else float(np.exp(u(np.log(2), np.log(30))))
        self.ctx = dict(depth=D, Fmax=Fmax, kind=self.kind, off=1.0)
        self.tangential = any(n == "coulomb-friction" or n in hid.FRICTIONAL for n in true)
        # ---- motion words
        want = set(plan.get("want", ()))
        for h in self.hidden:
            want |= hid.SPEC[h][3]
        if self.tangential:
            want |= {"slides"}
        want |= {w for w, p in (("tilt", 0.2), ("deep", 0.25), ("fast", 0.4), ("places", 0.1), ("diagonal", 0.3)) if u() < p}
        want |= {w for w in ("cycles",) if u() < 0.6}
        if set(self.hidden) & {"viscous-damping", "hunt-crossley-damping", "sensor-lag", "time-offset", "relaxation", "hysteresis"}:
            want |= {"cycles"}
        if "relaxation" in true or "zener" in true:
            want |= {"holds"}
        if "friction-rounding" in true and self.tangential:
            want |= {"norest"} if u() < 0.5 or has("friction-rounding") and self.hidden else set()
        if set(self.hidden) & {"tool-mass", "tool-com", "tool-inertia", "sensor-bias", "sensor-gain", "sensor-misalignment", "sensor-crosstalk", "sensor-drift"}:
            want |= {"turn"}
        mech = set(self.hidden) & (cat.NORMAL | cat.TANGENT)
        if mech and plan["group"] in ("single", "weak") and u() < 0.6:
            want |= {"shortturn"}
        if mech & cat.NORMAL and not mech & cat.TANGENT and u() < 0.6:
            want |= {"onedepth"}
        want -= set(plan.get("without", ()))
        if "fixed" in want:
            want -= {"tilt"}
        if "stiffness-inhomogeneity" not in self.hidden and not self.wrench:
            want -= {"places"}
        self.long = float(u(220, 420)) if plan.get("long") else 0.0
        if self.long:
            want |= {"long"}
        self.want = want
        scale = D * float(np.exp(u(np.log(0.6), np.log(2.0))))
        c = dict(depth=D, speeds=[scale * 0.8, scale * 3.5, scale * 11], slide=u(0.015, 0.04), hold=u(1.5, 3.2) if "holds" in want else u(0.6, 1.4), long=self.long,
                 slide_speeds=[u(1.5e-3, 4e-3), u(8e-3, 1.5e-2), u(2.5e-2, 5e-2)], shake=u(0.8, 1.3) * (1.6 if "shake" in want else 1.0),
                 gap=u(0.3e-3, 1e-3), short=(not self.wrench) and u() < 0.2 and not self.tangential, freqs=sorted(np.exp(u(np.log(0.5), np.log(7.0), 3))))
        self.c = c
        # ---- truth of the material (before hidden effects)
        off = u(0.003, 0.009)
        n0 = 1.5 if self.base in ("hertz", "hunt-crossley") else 1.0
        tgt = n0
        self.elastic = material.elastic(rng, tgt, off)
        p = dict(k=Fmax / D ** n0, n=n0, D=D * 1.15)
        vmax = c["speeds"][-1] * 1.0
        if self.base == "kelvin-voigt":
            p["c"] = Fmax / vmax * u(0.05, 0.2)
        if self.base == "hunt-crossley":
            p["lam"] = u(0.08, 0.3) / vmax
        self.zener = dict(r=u(0.15, 0.6), tau=float(np.exp(u(np.log(0.2), np.log(2.5)))), s=float(pick(0, u(0.2, 0.5)))) if self.base == "zener" else None
        fr = str(pick(*material.FRICTION))
        self.friction_kind, self.bristle, self.exotic = fr, u(0.8e-4, 1.2e-4), u(0.2, 0.8)
        if self.tangential:
            p["mu"] = u(0.15, 0.6)
            p.update(material.friction(rng, fr, self.bristle))
            if "friction-rounding" in self.names:
                p["mode"], p["vr"] = (laws.TANH if u() < 0.2 else laws.ROOT), u(5e-3, 1.5e-2)
        self.p0 = p
        self.ctx["tool"] = self.mass = float(np.exp(u(np.log(0.2), np.log(1.3))))
        self.extras = []                                         # effects that the model has and the truth too
        self.effects = {n: hid.Hidden(rng, n, self.ctx) for n in self.names[1:] + self.hidden if n != "coulomb-friction" or n in self.hidden}
        self.extra_amp = {n: hid.SPEC[n][0] * u(0.8, 1.6) for n in self.names[1:] if n in self.effects and n != "friction-rounding"}
        for n, f in (("viscous-damping", Fmax / vmax * 0.12), ("hunt-crossley-damping", 0.15 / vmax), ("hysteresis", 0.08 * Fmax),
                     ("viscous-friction", 0.1 * Fmax / c["slide_speeds"][-1]), ("structural-compliance", 0.1 * D / Fmax)):
            if n in self.extra_amp:
                self.extra_amp[n] = f * u(0.7, 1.4)
        self.outside = hid.Outside(rng, plan["outside"], 60.0) if plan.get("outside") else None
        # ---- sensor and nuisances
        self.nz_f = float(np.exp(u(np.log(0.006), np.log(0.035)))) if self.wrench else Fmax * float(np.exp(u(np.log(5e-4), np.log(4e-3))))
        self.sigma = self.nz_f * (np.array([1, u(0.8, 1.2), u(1, 1.6), 0.03, 0.03, 0.02]) if self.wrench else np.array([1.0, 0.8, 0.8]))
        self.nu = dict(mass=u(-0.015, 0.015), com=rng.normal(size=3) * 0.01, level=rng.normal(size=2) * 4e-4, surface=u(-1, 1) * min(5e-5, 0.5 * max(self.nz_f, 4e-3 * Fmax) * D / Fmax / n0),
                       nonlin=u(-0.01, 0.01), warm=rng.normal(size=6) * np.array([1, 1, 1, 0.02, 0.02, 0.02]) * 0.015, tip=pick(0.0, u(2e-4, 1.5e-3)))
        self.seed, self.shf = int(rng.integers(2 ** 31)), 1.0
        self.make_motion(plan)

    # ---- motion
    def make_motion(self, plan):
        rng, u = self.rng, self.rng.uniform
        if self.wrench:
            A = self.arm = arm(plan["robot"])
            nq = A.nq
            compliant = u() < 0.4
            kj = np.full(nq, np.exp(u(np.log(1500), np.log(4000)) if compliant else u(np.log(8e3), np.log(4e4)))) * rng.uniform(0.6, 1.4, nq)
            omega = 2 * np.pi * u(3.0, 6.0 if compliant else 12.0) * rng.uniform(0.96, 1.04, nq)
            zeta = u(0.5 if compliant else 0.7, 1.0) * np.ones(nq)
            self.nu["joint_stiffness"], self.nu["tracking_hz"] = float(kj.mean()), float(omega.mean() / 6.283)
            k_eff = self.ctx["Fmax"] / self.ctx["depth"]
            J0 = A.tip_jacobian(A.home[None])[0]
            self.c["reach"] = float(k_eff * (J0[2] ** 2 / kj).sum()) * 0.9
            T = 60.0 if not self.long else 300.0
            self.acq = sensing.draw_acquisition(rng, "wrench", T)
            round_ = "friction-rounding" in self.names + self.hidden
            if round_:
                self.acq["encoder"] = u(1e-6, 2e-6)
            fs = 2000.0 if self.acq["fs"] > 1000 else 1000.0
            if T > 200:
                fs = 500.0
            R, p, _ = A.pose_jacobian(A.home[None])
            a, b = u(-0.25, 0.25, 2) if u() < 0.4 else (0.0, 0.0)       # a couch that leans
            nrm = np.array([np.sin(a), np.sin(b), 1.0])
            nrm /= np.linalg.norm(nrm)
            az = u(0, 6.28)
            t1 = np.cross(np.cross(nrm, [np.cos(az), np.sin(az), 0]), nrm)
            t1 /= np.linalg.norm(t1)
            axes = np.stack([t1, np.cross(nrm, t1), nrm])
            z = (R[0] @ A.tip_R)[:, 2]
            v = np.cross(z, -nrm)
            sq = expm(v / max(np.linalg.norm(v), 1e-12) * np.arccos(np.clip(-z @ nrm, -1, 1)))
            point = p[0] + np.array([u(-0.03, 0.03), u(-0.03, 0.03), -u(0.06, 0.1)])
            point = np.round(point, 4)
            frame = dict(point=point, axes=axes, R0=sq @ R[0])
            for self.c["turn"] in (1.0, 0.8, 0.65, 0.5, 0.35):            # wrist turns as wide as the arm allows
                P = motion.arm_program(np.random.default_rng(self.seed + 5), self.want, self.c)
                t, cmd, phase, err = motion.arm_path(A, P, frame, fs, 25.0 if T > 200 else 50.0)
                fast = np.abs(np.diff(cmd, axis=0)).max(0) * fs
                if err < 1e-5 and (cmd > A.qmin + 0.03).all() and (cmd < A.qmax - 0.03).all() and (fast < A.vmax[:nq]).all():
                    break
            else:
                raise Rejected("out of the arm's reach")
            dt = 1 / fs
            cmd = cmd + motion.tremor(rng, len(t), nq, dt, u(0, 3e-5 if compliant else 8e-6) * (0.2 if round_ else 1.0))
            q, dq = motion.follow(dt, cmd, omega, zeta)
            ch = A.sensor_motion(q)
            rel = (ch["p"] - point) @ axes.T
            p0 = self.p0
            x = laws.deflection(dt, -rel[:, 2], np.ascontiguousarray(rel[:, :2]), np.ascontiguousarray(A.tip_jacobian(q, ch["p"])), axes,
                                omega, zeta, kj, p0["k"], p0["n"], p0.get("c", 0.0) + 0.01 * k_eff, p0.get("mu", 0.0), self.bristle)
            q = q + x
            dq = np.gradient(q, dt, axis=0)
            ddq = np.gradient(dq, dt, axis=0)
            self.frame, self.t, self.q, self.dq, self.cmd, self.phase = frame, t, q, dq, cmd, phase
            self.m = A.sensor_motion(q, dq, ddq)
            self.tool_com = np.array([u(-4e-3, 4e-3), u(-4e-3, 4e-3), u(0.03, 0.07)])
            out = A.tip_in_sensor / np.linalg.norm(A.tip_in_sensor)
            if abs(out[2]) < 0.5:
                self.tool_com = out * self.tool_com[2] + np.array([self.tool_com[0], 0, self.tool_com[1]])
        else:
            P = motion.tester_program(rng, self.want, self.c)
            T = P.t
            self.acq = sensing.draw_acquisition(rng, "tester", T)
            if "friction-rounding" in self.names + self.hidden:
                self.acq["encoder"] = u(2e-8, 1e-7)
            fs = 4000.0 if T < 40 else 2000.0 if T < 200 else 500.0
            t, cmd, phase = motion.resample(P, fs)
            w = 2 * np.pi * u(8, 25)
            cmd = cmd + motion.tremor(rng, len(t), 3, 1 / fs, u(0, 2e-6)) * np.array([1, 1, 1])
            x, v = motion.follow(1 / fs, cmd, [w] * 3, [u(0.7, 1.0)] * 3)
            self.t, self.x, self.v, self.phase = t, x, np.gradient(x, 1 / fs, axis=0), phase
        self.T = float(t[-1])
        self.t_log = sensing.sample_times(np.random.default_rng(self.seed + 1), self.T, self.acq["fs"], self.acq["jitter"], self.acq["drops"])
        if self.outside:
            self.outside = hid.Outside(rng, plan["outside"], self.T)

    # ---- truth
    def truth(self, amps, shrink):
        self.ctx["off"] = shrink
        p = dict(self.p0)
        p["poly"] = self.elastic["poly"] * shrink
        if self.zener:
            p.update(material.branches(np.random.default_rng(self.seed), self.zener["r"], self.zener["tau"], self.zener["s"] * shrink))
        for n, a in {**self.extra_amp, **amps}.items():
            if n in self.effects:
                self.effects[n].put(p, a)
        return p

    def physics(self, p, shrink, out_amp=0.0):
        """wrench or forces on the simulation's grid, before noise."""
        t, nu = self.t, self.nu
        if self.wrench:
            m, fr = self.m, self.frame
            d = np.array([p.get(f"d{i}", 0.0) for i in range(3)])
            off = mv(m["R"], d)
            tip = m["p"] + off
            roll = nu["tip"] * shrink                             # a ball of this radius: the lowest point wanders under tilt
            if roll:
                zt = mv(m["R"], self.arm.tip_R[:, 2])
                move = -roll * zt - roll * fr["axes"][2]
                tip = tip + move
                off = off + move
            rel = (tip - fr["point"]) @ fr["axes"].T
            vel = (m["v"] + np.cross(m["w_base"], off)) @ fr["axes"].T
            depth, rate, slip, sv = -rel[:, 2], -vel[:, 2], rel[:, :2], vel[:, :2]
        else:
            depth, rate, slip, sv = self.x[:, 0], self.v[:, 0], self.x[:, 1:], self.v[:, 1:]
        depth = depth + p.get("z0", 0.0) + nu["surface"] * shrink
        gain = p["k"] * (1 + p.get("alpha", 0.0) * t / 60) * hid.field(p.get("field"), slip, self.c["slide"])
        if self.outside:
            extra = self.outside.depth(t, out_amp)
            if np.ndim(extra):
                depth, rate = depth + extra, rate + np.gradient(extra, t)
            gain = gain * self.outside.gain(t, out_amp)
        N, _ = laws.normal(p, t, np.ascontiguousarray(depth), np.ascontiguousarray(rate), gain + 0 * t)
        T1 = T2 = np.zeros(len(t))
        if p.get("mu", 0.0) or p.get("cv", 0.0):
            args = [np.ascontiguousarray(x) for x in (slip[:, 0], slip[:, 1], sv[:, 0], sv[:, 1])] + [np.maximum(N, 0)]
            T1, T2 = laws.tangential(p, t, *args)
            share = self.exotic * self.shf
            if p.get("mode", 0) < laws.ROOT and share < 1:            # the rest of the patch is one plain bristle (Dahl if presliding)
                mean = float(np.dot(p["L"], p["w"]))
                slow = "presliding" in self.names + self.hidden
                D1, D2 = laws.tangential({**p, "mode": laws.DAHL if slow else laws.BRUSH, "L": [mean if slow else 1e-4 * (mean / 1e-4) ** self.shf],
                                          "w": [1.0]}, t, *args)
                T1, T2 = share * T1 + (1 - share) * D1, share * T2 + (1 - share) * D2
        self.Nmax = float(N.max())
        if self.wrench:
            f = N[:, None] * fr["axes"][2] + T1[:, None] * fr["axes"][0] + T2[:, None] * fr["axes"][1]
            RT = np.swapaxes(m["R"], 1, 2)
            lv = nu["level"] * shrink
            g = mv(RT, 9.81 * np.array([lv[0], lv[1], -np.sqrt(1 - lv @ lv)])) - m["a"]
            r = self.arm.tip_in_sensor + mv(RT, off)
            W = cat.wrench(mv(RT, f), r, self.mass + p.get("dm", 0.0), self.tool_com + [p.get(f"dc{i}", 0.0) for i in range(3)],
                           [p.get(f"I{i}", 0.0) for i in range(6)], g, m["w"], m["al"])
        else:
            W = np.stack([N, T1, T2], 1)[:, :3 if self.tangential else 1]
        if self.outside:
            W = W + self.outside.wrench(t, out_amp, W.shape[1], *((m["p"], m["R"]) if self.wrench else ()))
        return W

    def simulate(self, amps, shrink=1.0, out_amp=0.0, noise_scale=1.0):
        p = self.truth(amps, shrink)
        W = self.physics(p, shrink, out_amp)
        n = W.shape[1]
        late = {k: v for k, v in p.items() if k.startswith(("bias", "drift", "hum"))}
        chain = {k: v for k, v in p.items() if k.startswith(("rot", "X")) or k in ("g", "lag", "dt")}
        W = cat.sensor(W, self.t, chain)
        full = np.array([1.6 * self.ctx["Fmax"] + 10 * self.mass] * 3 + [1.0] * 3)[:n]
        W = W * (1 + self.nu["nonlin"] * shrink * (W / full) ** 2)
        fs = 1 / (self.t[1] - self.t[0])
        if self.acq["lowpass"]:
            W = sensing.low(W, fs, self.acq["lowpass"] / max(shrink, 0.2) ** 1.5)
        held = self.acq["held"] if self.acq["held"] and shrink > 0.5 else (None, None)
        y = sensing.other_rate(self.t, W, self.t_log, *held, offset=self.acq["clock"] * shrink)
        tt = self.t_log
        # temperature stays within 0.05 N/min and, over a long log, within the noise
        cap = min(1.0, 2.5 * self.nz_f / (0.04 * max(self.T, 1) / 60))
        y = y + self.nu["warm"][:n] * (tt - tt[0])[:, None] / 60 * shrink * cap
        y = cat.sensor(y, tt, late)
        rn = np.random.default_rng(self.seed)
        z = sensing.noise(rn, len(tt), self.sigma[:n] * noise_scale, self.acq["coloured"])
        self.noise_rms = (self.sigma * noise_scale)[:n]
        self.clip = None
        if "saturation" in self.effects:
            h = self.effects["saturation"]
            a = {**self.extra_amp, **amps}["saturation"]
            lim = float(np.abs(y[:, h.channel]).max() * (1 - a))
            if a > 0:
                self.clip = (h.channel, lim)
                if h.behind:
                    y[:, h.channel] = np.clip(y[:, h.channel], -lim, lim)
                    y = y + z
                else:
                    y = y + z
                    y[:, h.channel] = np.clip(y[:, h.channel], -lim, lim)
            else:
                y = y + z
        else:
            y = y + z
        self.smooth = y
        if "quantization" in self.effects:
            a = {**self.extra_amp, **amps}["quantization"]
            if a > 0:
                y = y.copy()
                y[:, :min(3, n)] = np.round(y[:, :min(3, n)] / a) * a
        return self.log(y, p)

    def log(self, y, p):
        t = self.t_log
        log = {"t": t}
        a = self.acq
        if self.wrench:
            q = sensing.encoder(sensing.at(self.t, self.q, t), a["encoder"])
            log.update({f"q{i + 1}": q[:, i] for i in range(q.shape[1])})
            if a["dq"]:
                dq = sensing.low(self.dq, 1 / (self.t[1] - self.t[0]), a["dq_fc"])
                dq = sensing.at(self.t, dq, t - a["dq_lag"]) + a["dq_bias"]
                log.update({f"dq{i + 1}": np.round(dq[:, i], 7) for i in range(q.shape[1])})
            cols = ["fx", "fy", "fz", "tx", "ty", "tz"]
        else:
            x = sensing.encoder(sensing.at(self.t, self.x, t), a["encoder"])
            log["depth"] = x[:, 0]
            if a["dq"] and self.seed % 2:
                log["depth_rate"] = np.round(sensing.at(self.t, self.v, t - a["dq_lag"])[:, 0], 7)
            if self.tangential:
                log["slip1"], log["slip2"] = x[:, 1], x[:, 2]
            cols = ["normal_force", "tangential_force1", "tangential_force2"][:y.shape[1]]
        log.update({c: np.round(y[:, j], 5 if j < 3 else 6) for j, c in enumerate(cols)})
        self.cols = cols
        return log

    def rig(self, shrink=1.0):
        if not self.wrench:
            return {}
        nu, fr = self.nu, self.frame
        r = {"robot": {"model": "lwr4plus" if self.arm.name == "lwr4plus" else self.arm.name, "sensor_frame": self.arm.sensor, "tip_frame": self.arm.tip}}
        if self.arm.name == "panda":
            r["robot"]["joints"] = self.arm.joint_names
        r["tool"] = {"mass": round(self.mass * (1 + nu["mass"] * shrink), 5), "com": [round(float(x), 6) for x in self.tool_com * (1 + nu["com"] * shrink)]}
        r["surface"] = {"point": [float(x) for x in fr["point"]], "normal": [float(x) for x in fr["axes"][2]], "tangent": [float(x) for x in fr["axes"][0]]}
        if self.seed % 3 == 0:
            r["sensor"] = {"noise": [float(f"{x:.2g}") for x in self.sigma]}
        return r

    # ---- refits (the interface of tune.run)
    def milder(self, D, f, shrink, by):
        """which nuisances to make smaller: those of friction at rest if the tangential forces hold most of the misfit, else all others."""
        T = 0.0
        if self.tangential and self.shf > 0.15:
            r = mv(D.R, f.r[:, :3]) @ D.axes.T if self.wrench else f.r[:, [1, 2, 0]]
            nz = float(np.mean(self.noise_rms[:3] ** 2))
            e = np.maximum(np.mean(r[D.contact] ** 2, 0) - nz, 1e-12)
            T = e[:2].sum() / e.sum()
        if T > 0.5:
            self.shf *= by
            return shrink * by ** 0.25
        self.shf *= by ** 0.25
        return shrink * by

    def same(self, D, shrink):
        return getattr(D, "made_with", None) == shrink

    def data(self, log, rig, D=None):
        shrink = self.ctx["off"]
        if D is None:
            D = cat.Contact(log, rig, limit=12000 if self.long else 4000, arm=self.arm if self.wrench else None)
            D.N0 = self.ctx["Fmax"] * 0.5
            D.made_with = shrink
        else:
            D.y = np.stack([log[c][D.rows] for c in D.cols], 1)
        D.smooth = self.smooth[D.rows]
        return D

    def unquantized(self, D):
        if "quantization" not in self.hidden:
            return D
        E = copy.copy(D)
        E.y = D.smooth
        return E

    def start(self, p):
        s = {k: v for k, v in p.items() if np.ndim(v) == 0 and k not in ("mode", "D") and not isinstance(v, dict)}
        if np.size(p.get("ratio", ())):
            s["ratio"], s["tau"] = float(np.sum(p["ratio"])), float(np.exp(np.average(np.log(p["tau"]), weights=np.asarray(p["ratio"]) + 1e-9)))
        if np.size(p.get("Ah", ())):
            w = np.asarray(p["Ah"])
            s["Ah"], s["Lh"] = float(w.sum()), float((w * p["Lh"]).sum() / w.sum())
        s["L"] = float(np.dot(p.get("L", [1e-4]), p.get("w", [1.0])))
        return s

    def restart(self, h, q):
        if h == "hertz-exponent":
            n0 = 1.5 if self.base in ("hertz", "hunt-crossley") else 1.0
            return {"k": q["k"] * self.ctx["depth"] ** (q["n"] - n0)}
        return {} if h in ("structural-compliance", "relaxation") else q

    def fixed(self, names):
        f = {}
        if "saturation" in names and self.clip:
            f.update(lim=self.clip[1], lim_ch=self.clip[0])
        if "presliding" in self.hidden and "presliding" not in names:
            f["mode"] = laws.DAHL                                # the same bristle, but 0.1 mm
        if "mains-hum" in names:
            f["hum_f"] = self.effects["mains-hum"].hum_f if "mains-hum" in self.effects else 50.0
        return f

    def fixed_of(self, c, names):
        return {**self.fixed(names), **({"hum_f": 50.0} if c == "mains-hum" else {})}

    def fit(self, D, names, sigma, p, iterations=7, start=None):
        return Fit(D, names, sigma, start or self.start(p), self.fixed(names), iterations)

    def weights(self, D, f=None):
        s = np.sqrt(self.noise_rms ** 2 + (0.005 * np.sqrt(np.mean(D.y ** 2, 0))) ** 2)
        if f is not None:
            s = np.maximum(self.noise_rms, np.sqrt(np.mean(f.r ** 2, 0)))
        if D.y.shape[1] == 6:
            s[:3], s[3:] = np.sqrt(np.mean(s[:3] ** 2)), np.sqrt(np.mean(s[3:] ** 2))
        return s

    def start_amplitude(self, h):
        if h == "friction-rounding":
            return self.p0["mu"]
        F, D = self.ctx["Fmax"], self.ctx["depth"]
        vs, v = self.c["slide_speeds"][-1], self.c["speeds"][-1]
        return {"viscous-damping": 0.06 * F / v, "hunt-crossley-damping": 0.08 / v, "hysteresis": 0.05 * F, "adhesion": 0.04 * F,
                "viscous-friction": 0.04 * F / vs, "structural-compliance": 0.08 * D / F, "coulomb-friction": 0.08,
                "surface-offset": 0.04 * D, "sensor-bias": 0.03 * F, "quantization": 8 * self.nz_f, "mains-hum": 4 * self.nz_f}.get(h, hid.SPEC[h][0])

    def bounds(self, h):
        return hid.SPEC[h][1:3]

    def metric(self, D, names, r):
        if names[0] == "outside":
            return (r[:, :3] if self.wrench else r).ravel()
        return D.metric(names, r, self.clip)

    def groups(self, D, names):
        """channel groups for fit_rms, the effect's own first."""
        if not self.wrench:
            g = ["N", "T"] if self.tangential else ["N"]
            return g[::-1] if names and names[0] in cat.TANGENT and len(g) > 1 else g
        return ["torque", "force"] if names and names[0] in cat.TORQUE else ["force", "torque"]

    def group_values(self, D, r, group):
        cols = {"N": [0], "T": [1, 2], "force": [0, 1, 2], "torque": [3, 4, 5]}[group]
        c = D.contact
        return r[c][:, cols], D.y[c][:, cols], rms(self.noise_rms[cols])

    def candidates(self, D):
        out = []
        for c in cat.EFFECTS:
            if c in ("saturation", "quantization") or (not self.wrench and c in cat.WRENCH_ONLY):
                continue
            if c in cat.TANGENT and not self.tangential or c == "mains-hum" and self.acq["fs"] < 250:
                continue
            if c in hid.FRICTIONAL - {"viscous-friction"} and "coulomb-friction" not in self.names + self.hidden:
                continue
            if c in ("presliding",) and "friction-rounding" in self.names + self.hidden:
                continue
            if c == "viscous-damping" and "kelvin-voigt" in self.names or c == "hunt-crossley-damping" and "hunt-crossley" in self.names:
                continue
            if c == "relaxation" and "zener" in self.names:
                continue
            if c == "stiffness-inhomogeneity" and np.ptp(D.slip_c, 0).max() < 3e-3:
                continue
            out.append(c)
        return out

    def near(self, fr, h, limit, D, others):
        return near(fr, limit, lambda r: self.metric(D, [h], r), others, self.starts(D), self.fixed_of)

    def starts(self, D):
        def of(c):
            return [{k: (v * D.deepest if k == "db" else v) for k, v in s.items()} for s in cat.EFFECTS[c][1]]
        return of

    def unit(self, hidden):
        return "N*m" if self.wrench and hidden and hidden[0] in cat.TORQUE else "N"

    def nuisances(self, shrink, noise):
        nu, a = self.nu, self.acq
        d = {"noise": [float(x) for x in self.noise_rms], "coloured": a["coloured"], "encoder": a["encoder"], "rate": a["fs"], "jitter": a["jitter"],
             "drops": a["drops"], "lowpass_hz": a["lowpass"] / max(shrink, 0.2) ** 1.5 if a["lowpass"] else 0.0, "held": a["held"] if shrink > 0.5 else None,
             "clock": a["clock"] * shrink, "nonlinearity": nu["nonlin"] * shrink, "surface": nu["surface"] * shrink, "warming": nu["warm"] * shrink,
             "material": {"table": self.elastic["table"], "off_form": self.elastic["left"] * shrink}, "shrink": shrink, "noise_scale": noise}
        if self.tangential:
            d["friction_at_rest"], d["bristle"], d["friction_share"] = self.friction_kind, self.bristle, self.exotic * self.shf
        if self.wrench:
            d.update(robot=self.arm.name, tool_mass=nu["mass"] * shrink, tool_com=nu["com"] * shrink, level=nu["level"] * shrink, tip_radius=nu["tip"] * shrink,
                     joint_stiffness=nu["joint_stiffness"], tracking_hz=nu["tracking_hz"], dq=a["dq"], dq_bias=a["dq_bias"], dq_lag=a["dq_lag"])
        return d

    def parameters(self, amps, p, out):
        d = {k: (float(v) if np.ndim(v) == 0 and not isinstance(v, dict) else v) for k, v in p.items() if k not in ("poly", "D", "w")}
        d["hidden"] = {n: self.effects[n].describe(a) for n, a in {**self.extra_amp, **amps}.items() if n in self.effects}
        if self.outside:
            d["outside"] = {"what": self.outside.name, "amplitude": float(out)}
        return d
