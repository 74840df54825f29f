"""The 48 cases: what is hidden, what disturbs, how large."""
import os, time
import numpy as np, pinocchio as pin
from scipy.spatial.transform import Rotation as Ro
import arms, world, refit
from material import vector, tester, drive, lag1

CHAIN = {"sensor-bias", "sensor-drift", "sensor-crosstalk", "sensor-misalignment", "sensor-gain", "sensor-lag", "time-offset", "saturation", "mains-hum", "tool-mass", "tool-com", "tool-inertia"}
STAGE = {**{e: "normal" for e in "hertz-exponent viscous-damping hunt-crossley-damping relaxation hysteresis stress-softening adhesion stiffening-layer surface-offset stiffness-drift stiffness-inhomogeneity".split()},
         **{e: "tangential" for e in "coulomb-friction viscous-friction stribeck-friction presliding friction-rounding load-dependent-friction friction-anisotropy".split()},
         **{e: "robot and tool" for e in "tool-mass tool-com tool-inertia structural-compliance tip-offset".split()},
         **{e: "joint torques" for e in refit.CAND_J}, **{e: "sensor and acquisition" for e in "sensor-bias sensor-drift sensor-crosstalk sensor-misalignment sensor-gain sensor-lag time-offset saturation mains-hum".split()}}
NOVAL = {"time-offset", "sensor-misalignment", "hysteresis"}


class Case:
    def __init__(self, no, group, kind, hidden, seed, out, special=None):
        self.no, self.group, self.kind, self.hidden, self.special = no, group, kind, list(hidden), special
        self.name = f"sanderling_{no:02d}"; self.dir = f"{out}/{self.name}"
        self.seed = seed
        self.size = {e: 1.0 for e in hidden}
        self.tries = 0; self.notes = []; self.draw()

    # ---------- everything random that stays while the size is being found
    def draw(self):
        r = self.rng = np.random.default_rng([self.seed, self.no, self.tries])
        self.sub = int(r.integers(1 << 31))
        self.cache = None; self.values = {}
        self.noise = np.exp(r.uniform(np.log(.0025), np.log(.011)))      # share of the readings' rms
        self.R = np.exp(r.uniform(np.log(2.2), np.log(9.5)))
        self.hum = float(r.choice([50., 60.]))
        self.judge = "torque" if self.hidden and set(self.hidden) <= {"tool-com", "tool-inertia"} else "force"
        getattr(self, "draw_" + self.kind)(r)

    def has(self, e):
        return e in self.hidden

    def chain_nuis(self, r, scale, fs):
        z = np.array([1, 1, 1, .05, .05, .05])
        ch = {"noise": scale * self.noise * z * r.uniform(.7, 1.3, 6)}
        k = lambda p: r.random() < p
        if k(.6): ch["bias"] = r.normal(0, .003, 6) * scale * z
        if k(.4): ch["temp"] = r.normal(0, .003, 6) * scale * z; ch["wob"] = r.uniform(.4, 1.6)
        if k(.5): ch["nonlin"] = r.uniform(-.01, .01)
        if k(.4): ch["delay"] = float(r.choice([-1, 1])) * r.uniform(.001, .002)
        if k(.3): ch["lag"] = r.uniform(3e-4, 1.5e-3)
        if k(.3): ch["quant"] = np.array([.01, .01, .02, .00025, .00025, .00025])
        return ch

    def rates(self, r, lo=50, hi=1000, T=None):
        fs = float(r.choice([f for f in (50, 100, 125, 200, 250, 400, 500, 1000, 2000) if lo <= f <= hi]))
        return fs, (r.uniform(.02, .25) if r.random() < .6 else 0.), (r.uniform(.001, .02) if r.random() < .5 else 0.)

    # ---------- arms in contact
    def draw_C(self, r):
        self.robot = str(r.choice(["lwr", "lwr", "ur5", "ur10", "panda"]))
        h = self.hidden
        mat = ["normal", "tangential"]
        self.tanbase = True
        base = str(r.choice(["kelvin-voigt", "kelvin-voigt", "kelvin-voigt", "hunt-crossley", "hooke"]))
        if self.special in ("pulse",):
            base = "kelvin-voigt"
        if self.has("hertz-exponent") or self.has("stiffening-layer") or self.has("hunt-crossley-damping"): base = "kelvin-voigt"
        if self.has("viscous-damping"): base = "hooke"
        if self.has("structural-compliance"): base = "hertz"
        self.base = base
        self.model = [base] + (["coulomb-friction"] if not self.has("coulomb-friction") else [])
        self.slides = not (self.special == "no-slides")
        k = np.exp(r.uniform(np.log(600), np.log(2500)))
        d = r.uniform(.0025, .0045)
        self.k, self.d = k, d
        n = {"hertz": 1.5, "hunt-crossley": r.uniform(1.1, 1.5)}.get(base, 1.)
        if n > 1: k = k * 1.3
        self.nexp = n
        P = dict(n=n, k=k * refit.DREF ** (1 - n))
        P["c"] = r.uniform(8, 25) if base == "kelvin-voigt" else 0.
        P["lam"] = r.uniform(.5, 3.) if base == "hunt-crossley" else 0.
        if self.has("hunt-crossley-damping"): P["c"] = r.uniform(1, 4)
        P["r2"] = r.choice([0, r.uniform(.004, .015)]); P["tau2"] = np.exp(r.uniform(np.log(.05), np.log(.5)))
        P["mu"] = r.uniform(.2, .6) if self.slides else r.uniform(.01, .03)
        fk = int(r.choice([0, 1, 2, 3, 4]))
        if self.has("presliding"): fk = 0
        if self.has("friction-rounding"): fk = 2
        P["fkind"] = fk; P["flen"] = r.uniform(8e-5, 1.2e-4); P["vr"] = r.uniform(1e-4, 3e-4)
        if fk == 2 and not self.has("friction-rounding") and (self.group != "quiet"): P["fkind"] = 0
        if fk == 2 and P["fkind"] == 2 and not self.has("friction-rounding"): P["vr"] = 5e-5
        if self.has("adhesion"): P["fa_len"] = r.uniform(.8e-3, 2e-3)
        self.P = P
        self.spread = r.uniform(0, 2.5e-5)
        g = np.array([0, 0, -9.81])
        if r.random() < .3: g = Ro.from_rotvec(r.choice([np.pi / 2, np.pi, .7]) * np.array([np.cos(a := r.uniform(0, 6.28)), np.sin(a), 0])).apply(g)
        self.g_rig = g
        self.g_true = Ro.from_rotvec(np.radians(r.uniform(0, .5)) * r.standard_normal(3) / 1.8).apply(g) if r.random() < .4 else g
        self.mass = r.uniform(.15, .6)
        self.ctrl = dict(kind=str(r.choice(["ct", "pd"])), w=np.exp(r.uniform(np.log(25), np.log(80))), zeta=r.uniform(.7, 1.2))
        self.enc = np.exp(r.uniform(np.log(2e-6), np.log(2e-5)))
        self.fs, self.jit, self.drop = self.rates(r, 100, 1000)
        if self.has("mains-hum"): self.fs = float(r.choice([400., 500.])); self.jit = max(self.jit, .1)
        self.dq = dict(lag=r.uniform(.002, .02), bias=2e-4, noise=np.exp(r.uniform(np.log(3e-4), np.log(5e-3)))) if r.random() < .6 else None
        self.tilt = .0 if not self.has("tip-offset") else r.uniform(.12, .22)
        self.long = r.random() < .12
        self.csv = r.random() < .25
        self.off_nuis = r.normal(0, 2e-5, 3)
        self.phase = r.random() < .7
        self.dir_xt = r.normal(0, 1, (3, 3)); np.fill_diagonal(self.dir_xt, 0); self.dir_xt /= np.linalg.norm(self.dir_xt)
        self.dir_rot = r.normal(0, 1, 3); self.dir_rot /= np.linalg.norm(self.dir_rot)
        self.dir3 = r.normal(0, 1, 3); self.dir3 /= np.linalg.norm(self.dir3)
        self.dir6 = r.normal(0, 1, 6)
        self.misc = r.random(8)
        self.chn = None
        if self.special == "no-retract": self.retract = False
        # starting sizes
        self.x0 = {"relaxation": .25, "hysteresis": .15, "stress-softening": .2, "adhesion": .6, "stiffening-layer": .6, "hertz-exponent": .2, "hunt-crossley-damping": 3., "surface-offset": 3e-4,
                   "stiffness-drift": .15, "stiffness-inhomogeneity": .15, "viscous-damping": 20., "viscous-friction": 8. if self.slides else 3., "stribeck-friction": .08 if self.slides else .01, "presliding": 8e-4, "friction-rounding": 6e-3,
                   "load-dependent-friction": -.25, "friction-anisotropy": .2, "coulomb-friction": .2, "structural-compliance": 5e-5, "tip-offset": 2e-3, "sensor-bias": .5, "sensor-drift": .8,
                   "sensor-crosstalk": .08, "sensor-misalignment": .06, "sensor-gain": .1, "sensor-lag": .03, "time-offset": .012, "saturation": .12, "mains-hum": .5, "tool-mass": .1}

    def build_C(self):
        r = np.random.default_rng(self.sub)
        x = {e: self.x0[e] * self.size[e] for e in self.hidden}
        P = dict(self.P); V = {}
        if self.base == "kelvin-voigt": V["kelvin-voigt.damping"] = P["c"]
        if self.base == "hunt-crossley": V["hunt-crossley.exponent"] = P["n"]; V["hunt-crossley.damping"] = P["lam"] * P["k"]; V["hunt-crossley.stiffness"] = P["k"]
        if self.base in ("kelvin-voigt", "hooke") and "hertz-exponent" not in x: V[f"{self.base}.stiffness"] = P["k"]
        if self.base == "hertz": V["hertz.stiffness"] = P["k"]
        V["coulomb-friction.coefficient"] = P["mu"]
        ks = None; off = self.off_nuis.copy(); zs = ext = None
        u = self.misc
        dmax = self.d * 1.5
        for e, a in x.items():
            if e == "relaxation": P["r1"] = min(a, 1.5); P["tau1"] = .25 * (20 ** u[0]); V |= {"relaxation.ratio": P["r1"], "relaxation.time-constant": P["tau1"]}
            if e == "hysteresis": P["hy_ratio"] = a; P["hy_len"] = 3e-4 + 5e-4 * u[0]
            if e == "stress-softening": P["mu_ratio"] = min(a, .7); P["mu_len"] = (.6 + u[0]) * 1e-3; V |= {"stress-softening.ratio": P["mu_ratio"], "stress-softening.length": P["mu_len"]}
            if e == "adhesion": P["fa"] = a; V |= {"adhesion.force": a}
            if e == "stiffening-layer": P["K"] = a * P["k"]; P["db"] = .65 * dmax if self.group != "not-excited" else 3.5 * dmax; V |= {"stiffening-layer.stiffness": P["K"], "stiffening-layer.depth": P["db"]}
            if e == "hertz-exponent": P["n"] = 1 + min(a, .9); P["k"] = self.k * refit.DREF ** (1 - P["n"]); V |= {"hertz-exponent.exponent": P["n"]}
            if e == "hunt-crossley-damping": P["lam"] = a; V |= {"hunt-crossley-damping.damping": a}
            if e == "viscous-damping": P["c"] = a; V |= {"viscous-damping.damping": a}
            if e == "surface-offset": V |= {"surface-offset.offset": a}
            if e == "stiffness-drift": P["drift"] = a; V |= {"stiffness-drift.rate": a}
            if e == "stiffness-inhomogeneity":
                form = int(u[1] * 3); w = 2e-3 + 3e-3 * u[2]; c1 = .008 + .006 * u[3]; an = (u[4] - .5) * 1.6
                if self.group == "not-excited": form = 0; c1 = .12; an = 0; w = 2e-3
                if form == 0: ks = lambda p, q, t: 1 + a * .5 * (1 + np.tanh((p * np.cos(an) + q * np.sin(an) - c1) / w))
                elif form == 1: ks = lambda p, q, t: 1 + 1.6 * a * np.exp(-((p - c1) ** 2 + (q - .3 * c1) ** 2) / (2 * (.004 + w) ** 2))
                else: ks = lambda p, q, t: 1 + a * (p * np.cos(an) + q * np.sin(an)) / .015; V |= {"stiffness-inhomogeneity.gradient1": a * np.cos(an) / .015, "stiffness-inhomogeneity.gradient2": a * np.sin(an) / .015}
                self.form = ("edge", "inclusion", "gradient")[form]
            if e == "viscous-friction": P["cv"] = a; V |= {"viscous-friction.damping": a}
            if e == "stribeck-friction": P["dmu"] = a; P["vs"] = 12e-3 + .02 * u[0]; V |= {"stribeck-friction.coefficient": a, "stribeck-friction.speed": P["vs"]}
            if e == "presliding": P["flen"] = a; V |= {"presliding.length": a}
            if e == "friction-rounding": P["vr"] = a; V |= {"friction-rounding.speed": a}
            if e == "load-dependent-friction": P["p"] = np.clip(a, -.8, .8); P["N0"] = self.k * self.d; V |= {"load-dependent-friction.exponent": P["p"]}; V.pop("coulomb-friction.coefficient")
            if e == "friction-anisotropy": P["aniso"] = min(a, .8); V |= {"friction-anisotropy.ratio": P["aniso"]}
            if e == "coulomb-friction": P["mu"] = a; V["coulomb-friction.coefficient"] = a
            if e == "structural-compliance": P["comp"] = a; V |= {"structural-compliance.compliance": a}
            if e == "tip-offset": off = a * self.dir3 * np.array([1, 1, .3]); V |= {f"tip-offset.offset[{c}]": off[i] for i, c in enumerate("xyz")}
        key = repr([(e, x[e]) for e in x if e not in CHAIN])
        if self.cache is None or self.cache[0] != key:
            urdf = None
            if self.robot == "lwr":
                urdf = arms.lwr_urdf(r.uniform(.015, .05), r.uniform(-1, 1), r.uniform(.06, .14), r.normal(0, .004, 2), 0.)
            m = arms.get(self.robot, urdf); d = m.createData()
            q0 = np.array(arms.SEEDS[self.robot], float) + r.normal(0, .06, m.nq)
            sf, tf = arms.FRAMES[self.robot]; sid, tid = m.getFrameId(sf), m.getFrameId(tf)
            pin.framesForwardKinematics(m, d, q0)
            Mt, Ms = d.oMf[tid], d.oMf[sid]
            axis = (Ms.inverse() * Mt).translation
            if np.linalg.norm(axis) < .05: axis = np.array([0, 0, .08])
            com = axis * r.uniform(.3, .6) + r.normal(0, .003, 3)
            nrm = -Mt.rotation[:, 2]
            nrm = Ro.from_rotvec(r.normal(0, .03, 3)).apply(nrm)
            t1 = np.cross([0.3, 1, .2], nrm); t1 /= np.linalg.norm(t1)
            t1 = Ro.from_rotvec(nrm * r.uniform(0, 6.28)).apply(t1)
            E = np.array([t1, np.cross(nrm, t1), nrm])
            point = Mt.translation.copy()
            inert = np.diag(self.mass * r.uniform(2e-4, 6e-4, 3))
            last = m.joints[m.njoints - 1].id
            Mrel = m.frames[sid].placement
            extra = Mrel.act(pin.Inertia(self.mass, com, inert))
            J = pin.computeFrameJacobian(m, d, q0, tid, pin.LOCAL_WORLD_ALIGNED)[:3]
            Mq = pin.crba(m, d, q0); Mq = np.triu(Mq) + np.triu(Mq, 1).T + .02 * np.eye(m.nv)
            if self.ctrl["kind"] == "ct": Kc = self.ctrl["w"] ** 2 / (nrm @ J @ np.linalg.solve(Mq, J.T) @ nrm)
            else: Kc = self.ctrl["w"] ** 2 / (nrm @ (J / np.diag(Mq)) @ J.T @ nrm)
            keff = P["k"] * self.d ** (P["n"] - 1)
            dcmd = self.d * (1 + keff / Kc)
            if dcmd > .012: self.ctrl["w"] *= np.sqrt(dcmd / .012); dcmd = .012
            tr, X, ph = world.contact_programme(r, dcmd, tilt=self.tilt, slides=self.slides, retract=True, deep=1.45 if dcmd > .008 else 1.6)
            if self.long:
                n2 = int(self.misc[6] * 3) + 2
                X = np.vstack([X] * n2); ph = np.concatenate([ph] * n2); tr = np.arange(len(X)) * world.Prog.H
            pos = point + X[:, :2] @ E[:2] + X[:, 2:3] * nrm
            # the reference makes the true tip follow; rotations about the tangents
            Rt = Ro.from_rotvec(X[:, 3:4] * E[0] + X[:, 4:5] * E[1]).as_matrix() @ Mt.rotation
            Q = arms.ik(m, tid, q0, pos, Rt, tr)
            T = np.arange(0, tr[-1], 1e-3); K = len(T)
            if self.special == "pulse": zs = self.sp_size() * 4e-4 * np.sin(2 * np.pi * (.9 + u[0]) * T + 1.5 * np.sin(2 * np.pi * .07 * T))
            if self.special == "switch":
                sw = np.cumsum(r.exponential(2.5, 60)); lev = r.uniform(-1, 1, 61) * .35 * self.sp_size()
                ks = lambda p, q, t: 1 + lev[np.searchsorted(sw, t)]
            if self.special == "bumps":
                ext = np.zeros((K, 3)); tb = 0
                while (tb := tb + r.exponential(1.2)) < T[-1]:
                    ext += np.exp(-((T - tb) / r.uniform(.08, .35)) ** 2)[:, None] * r.normal(0, 1.2, 3) * self.sp_size()
            gaps = np.zeros(1) if self.spread < 5e-6 else self.spread * np.linspace(0, 1, 12) ** 2 * 3
            ct = dict(point=point, E=E, P=vector(**P), gaps=gaps, ks=ks, z=zs, ext=ext)
            rec = arms.simulate(m, self.g_true, extra, tid, off, tr, Q, 1e-3, self.ctrl, contact=ct)
            p, R = refit.fk(m, [sid], rec["q"][::2])
            t2 = rec["t"][::2]; p, R = p[0], R[0]
            cw = p + R @ com
            acc = np.gradient(np.gradient(cw, t2, axis=0), t2, axis=0)
            F, tip = rec["F"][::2], rec["tip"][::2]
            self.cache = (key, dict(rec=rec, t2=t2, p=p, R=R, acc=acc, F=F, tip=tip, E=E, point=point, com=com, urdf=urdf, m=m, sf=sf, tf=tf, ph=ph, tr=tr))
        c = self.cache[1]
        R, com = c["R"], c["com"]
        mass = self.mass
        fs_ = np.einsum("nji,nj->ni", R, c["F"]); ft = np.einsum("nji,nj->ni", R, mass * (self.g_true - c["acc"]))
        rt = np.einsum("nji,nj->ni", R, c["tip"] - c["p"])
        w = np.c_[fs_ + ft, np.cross(com, ft) + np.cross(rt, fs_)]
        scale = np.sqrt((c["F"][np.linalg.norm(c["F"], axis=1) > .05] ** 2).mean())
        if self.chn is None: self.chn = self.chain_nuis(r_ := np.random.default_rng(self.sub + 1), scale, self.fs)
        ch = dict(self.chn); z6 = np.r_[np.ones(3), .05 * np.ones(3)]
        rr = np.random.default_rng(self.sub + 2)
        mrig, crig = mass * (1 + rr.uniform(-.02, .02)), com * (1 + rr.uniform(-.02, .02))
        pt = c["point"].copy()
        for e, a in x.items():
            if e == "sensor-bias": ch["bias"] = ch.get("bias", 0) + a * scale / 5 * self.dir6 * z6; V |= {f"sensor-bias.offset[{n_}]": ch["bias"][i] for i, n_ in enumerate("fx fy fz".split())}
            if e == "sensor-drift": ch["drift"] = a * scale / 5 * self.dir6 * z6 * 60 / (c["rec"]["t"][-1]); V |= {f"sensor-drift.drift[{n_}]": ch["drift"][i] for i, n_ in enumerate("fx fy fz".split())}
            if e == "sensor-crosstalk": ch["xt"] = a * self.dir_xt * 2
            if e == "sensor-misalignment": ch["rot"] = a * self.dir_rot
            if e == "sensor-gain": ch["g"] = a; V |= {"sensor-gain.gain": a}
            if e == "sensor-lag": ch["lag"] = a; ch.pop("delay", 0); V |= {"sensor-lag.time-constant": a}
            if e == "time-offset": ch["delay"] = a * (1 if u[3] > .4 else -1)
            if e == "saturation":
                ax = int(np.argmax(np.abs(w[:, :3]).max(0))); L = np.abs(w[:, ax]).max() * (1 - min(a, .7))
                if self.group == "not-excited": L = np.abs(w[:, ax]).max() * 1.8
                ch["sat"] = (ax, L, u[4] > .5)
                V |= {"saturation.limit[" + "fx fy fz".split()[ax] + "]": L}
            if e == "mains-hum": ch["hum"] = (self.hum, a * scale / 5 * np.abs(self.dir6) * z6, self.dir6)
            if e == "tool-mass": mrig = mass - a; V |= {"tool-mass.mass": a}
            if e == "surface-offset": pt = pt - a * c["E"][2]
        t = world.rows(rr, c["rec"]["t"][-1] - .05, self.fs, self.jit, self.drop)
        wr = world.chain(ch, c["t2"], w, t, rr)
        df = world.joints(rr, {"t": t}, c["rec"], t, self.enc, self.dq)
        for i, n_ in enumerate("fx fy fz tx ty tz".split()): df[n_] = wr[:, i]
        if self.phase: df["phase"] = c["ph"][np.clip((t / world.Prog.H).astype(int), 0, len(c["ph"]) - 1)]
        rig = {"robot": {"model": "robot.urdf" if c["urdf"] else self.robot, "sensor_frame": c["sf"], "tip_frame": c["tf"], "gravity": self.g_rig, "joints": [n_ for n_ in list(c["m"].names)[1:]]},
               "tool": {"mass": mrig, "com": crig}, "surface": {"point": pt, "normal": c["E"][2], "tangent": c["E"][0]}, "sensor": {"noise": ch["noise"]}}
        world.write(self.dir, df, rig, c["urdf"], self.csv)
        self.values = V
        self.kindtext = f"contact, {self.robot}, {t[-1]-t[0]:.0f} s, {self.fs:g} Hz"

    def sp_size(self):
        return self.size.get("special", 1.)

    # ---------- free wrench
    def draw_F(self, r):
        self.robot = str(r.choice(["lwr", "ur5", "ur10", "panda"]))
        self.model = ["none"]
        self.static = r.random() < .35 and not (set(self.hidden) & {"sensor-lag", "time-offset", "mains-hum", "tool-inertia"}) and self.special is None
        if self.special == "static": self.static = True
        self.mass = r.uniform(.5, 1.8)
        g = np.array([0, 0, -9.81])
        self.g_rig = g
        self.g_true = Ro.from_rotvec(np.radians(r.uniform(0, .3)) * np.array([1., 0, 0])).apply(g)
        self.enc = np.exp(r.uniform(np.log(2e-6), np.log(3e-4)))
        self.fs, self.jit, self.drop = self.rates(r, 100, 1000)
        self.T = r.uniform(20, 50)
        if self.static: self.fs = float(r.choice([.2, .5, 1.])); self.T = r.uniform(60, 180) / self.fs ** .3; self.jit = self.drop = 0
        if self.has("mains-hum"): self.fs = 500.
        self.dq = dict(lag=r.uniform(.002, .02), bias=2e-4, noise=2e-3) if r.random() < .5 and not self.static else None
        self.csv = r.random() < .4
        self.dir6, self.dir3, self.dir_rot, self.misc = r.normal(0, 1, 6), r.normal(0, 1, 3), r.normal(0, 1, 3), r.random(8)
        self.dir3 /= np.linalg.norm(self.dir3); self.dir_rot /= np.linalg.norm(self.dir_rot)
        self.dir_xt = r.normal(0, 1, (3, 3)); np.fill_diagonal(self.dir_xt, 0); self.dir_xt /= np.linalg.norm(self.dir_xt)
        self.ctrl = dict(kind="ct", w=r.uniform(15, 50), zeta=.9)
        self.chn = None
        self.x0 = {"tool-mass": .1, "tool-com": .01, "tool-inertia": 4e-3, "sensor-bias": .4, "sensor-drift": .6, "sensor-crosstalk": .06, "sensor-misalignment": .06, "sensor-gain": .06,
                   "sensor-lag": .06, "time-offset": .03, "mains-hum": .4, "saturation": .12}

    def build_F(self):
        r = np.random.default_rng(self.sub)
        x = {e: self.x0[e] * self.size[e] for e in self.hidden}; V = {}; u = self.misc
        if self.cache is None or self.special == "slosh":
            urdf = arms.lwr_urdf(r.uniform(.015, .05), r.uniform(-1, 1), r.uniform(.06, .14), r.normal(0, .004, 2), 0.) if self.robot == "lwr" else None
            m = arms.get(self.robot, urdf); sf, tf = arms.FRAMES[self.robot]; sid, tid = m.getFrameId(sf), m.getFrameId(tf)
            q0 = np.array(arms.SEEDS[self.robot], float) + r.normal(0, .1, m.nq)
            dirn = m.frames[tid].placement.translation - m.frames[sid].placement.translation
            dirn = m.frames[sid].placement.rotation.T @ dirn; dirn /= np.linalg.norm(dirn) + 1e-9
            com = dirn * r.uniform(.03, .08) + r.normal(0, .01, 3)
            inert = np.diag(self.mass * r.uniform(3e-4, 1.2e-3, 3))
            amp = np.r_[.3 * np.ones(m.nq - 3), 1.0 * np.ones(3)]
            if self.static:
                K = int(self.T * self.fs)
                t2 = np.arange(K) / self.fs
                Q = q0 + r.uniform(-1.4, 1.4, (K, m.nq)) * amp
                rec = dict(t=t2, q=Q, dq=0 * Q); acc = np.zeros((K, 3)); p, R = refit.fk(m, [sid], Q); p, R = p[0], R[0]; al = om = np.zeros((K, 3))
            else:
                tr = np.arange(0, self.T, .005)
                Q = np.repeat(q0[None], len(tr), 0)
                for j in range(m.nq):
                    for _ in range(3):
                        f = np.exp(r.uniform(np.log(.06), np.log(.9)))
                        Q[:, j] += amp[j] * .55 * min(1, .35 / f) * np.sin(2 * np.pi * f * tr + r.uniform(0, 6.28))
                extra = m.frames[sid].placement.act(pin.Inertia(self.mass, com, inert))
                rec = arms.simulate(m, self.g_true, extra, tid, np.zeros(3), tr, Q, 1e-3, self.ctrl)
                t2 = rec["t"][::2]; p, R = refit.fk(m, [sid], rec["q"][::2]); p, R = p[0], R[0]
                acc = np.gradient(np.gradient(p + R @ com, t2, axis=0), t2, axis=0)
                dR = Ro.from_matrix(np.einsum("nji,njk->nik", R[:-1], R[1:])).as_rotvec() / np.diff(t2)[:, None]
                om = np.r_[dR, dR[-1:]]; al = np.gradient(om, t2, axis=0)
            f = self.mass * np.einsum("nji,nj->ni", R, self.g_true - acc)
            if self.special == "slosh":        # a liquid: two pendulums in the tool, driven by gravity and acceleration
                h = t2[1] - t2[0]; s = np.zeros((2, 3)); v = np.zeros((2, 3)); add = np.zeros_like(f)
                ge = np.einsum("nji,nj->ni", R, self.g_true - acc)
                w0 = 2 * np.pi * np.array([1.1 + u[0], 2.3 + u[1]])[:, None]
                P2 = np.eye(3) - np.outer(dirn, dirn)
                for i in range(len(t2)):
                    a_ = (P2 @ ge[i])[None] - w0 ** 2 * s - 2 * .012 * w0 * v
                    v = v + h * a_; s = s + h * v
                    add[i] = .18 * self.mass * self.sp_size() * ((w0 ** 2 * s).sum(0) - 2 * P2 @ ge[i])
                f = f + add
            w = np.c_[f, np.cross(com, f) - al @ inert - np.cross(om, om @ inert)]
            self.cache = ("", dict(rec=rec, t2=t2, w=w, m=m, com=com, urdf=urdf, sf=sf, tf=tf, inert=inert))
        c = self.cache[1]; w = c["w"]
        scale = np.sqrt((w[:, :3] ** 2).mean())
        if self.chn is None: self.chn = self.chain_nuis(np.random.default_rng(self.sub + 1), scale, self.fs)
        ch = dict(self.chn); rr = np.random.default_rng(self.sub + 2); z6 = np.r_[np.ones(3), .05 * np.ones(3)]
        mrig, crig = self.mass * (1 + rr.uniform(-.004, .004)), c["com"] * (1 + rr.uniform(-.02, .02)); inr = np.diag(c["inert"])
        give_I = not self.has("tool-inertia")
        for e, a in x.items():
            if e == "tool-mass": mrig = self.mass - a; V |= {"tool-mass.mass": self.mass - mrig}
            if e == "tool-com": d = a * self.dir3; crig = c["com"] - d; V |= {f"tool-com.com[{k}]": d[i] for i, k in enumerate("xyz")}
            if e == "tool-inertia": V |= {f"tool-inertia.inertia[{k}]": c["inert"][i, i] for i, k in enumerate(("xx", "yy", "zz"))}
            if e == "sensor-bias": ch["bias"] = a * scale / 5 * self.dir6 * z6; V |= {f"sensor-bias.offset[{n_}]": ch["bias"][i] for i, n_ in enumerate("fx fy fz tx ty tz".split())}
            if e == "sensor-drift": ch["drift"] = a * scale / 5 * self.dir6 * z6 * 60 / self.T; V |= {f"sensor-drift.drift[{n_}]": ch["drift"][i] for i, n_ in enumerate("fx fy fz tx ty tz".split())}
            if e == "sensor-crosstalk": ch["xt"] = 2 * a * self.dir_xt
            if e == "sensor-misalignment": ch["rot"] = a * self.dir_rot
            if e == "sensor-gain": ch["g"] = a; V |= {"sensor-gain.gain": a}
            if e == "sensor-lag": ch["lag"] = a; ch.pop("delay", 0); V |= {"sensor-lag.time-constant": a}
            if e == "time-offset": ch["delay"] = a * (1 if u[3] > .4 else -1)
            if e == "mains-hum": ch["hum"] = (self.hum, a * scale / 5 * np.abs(self.dir6) * z6, self.dir6)
            if e == "saturation": L = np.abs(w[:, 2]).max() * (1 - min(a, .7)); ch["sat"] = (2, L, u[4] > .5); V |= {"saturation.limit[fz]": L}
        if self.static: t = c["t2"]; ch.pop("delay", 0); ch.pop("lag", 0)
        else: t = world.rows(rr, c["t2"][-1] - .05, self.fs, self.jit, self.drop)
        wr = world.chain(ch, c["t2"], w, t, rr)
        df = world.joints(rr, {"t": t}, c["rec"], t, self.enc, self.dq)
        for i, n_ in enumerate("fx fy fz tx ty tz".split()): df[n_] = wr[:, i]
        tool = {"mass": mrig, "com": crig}
        if give_I: tool["inertia"] = [inr[0], inr[1], inr[2], 0, 0, 0]
        rig = {"robot": {"model": "robot.urdf" if c["urdf"] else self.robot, "sensor_frame": c["sf"], "tip_frame": c["tf"], "gravity": self.g_rig, "joints": list(c["m"].names)[1:]},
               "tool": tool, "sensor": {"noise": ch["noise"]}}
        world.write(self.dir, df, rig, c["urdf"], self.csv)
        self.values = V; self.kindtext = f"free wrench, {self.robot}, {'static poses' if self.static else 'moving'}, {t[-1]-t[0]:.0f} s, {self.fs:g} Hz"

    # ---------- joint torques of arms
    def draw_J(self, r):
        self.robot = str(r.choice(["lwr", "ur5", "ur10", "xarm7"]))
        fric = set(self.hidden) & {"joint-coulomb-friction"}
        self.hasfric = not fric and (set(self.hidden) & {"joint-stribeck-friction", "joint-load-friction", "joint-viscous-friction"} or r.random() < .5)
        self.model = ["rigid-body"] + (["joint-coulomb-friction"] + (["joint-viscous-friction"] if not self.has("joint-viscous-friction") else []) if self.hasfric else [])
        self.T = r.uniform(25, 60)
        self.enc = np.exp(r.uniform(np.log(3e-6), np.log(1e-4)))
        self.fs, self.jit, self.drop = self.rates(r, 100, 1000)
        self.cut = r.uniform(15, 50)
        self.fst = float(r.choice([self.fs, max(100, self.fs / 2)]))
        self.ctrl = dict(kind="ct", w=r.uniform(15, 40), zeta=1., comp=r.uniform(.6, 1.))
        g = np.array([0, 0, -9.81])
        if r.random() < .3: g = Ro.from_rotvec([r.choice([np.pi / 2, np.pi]), 0, 0]).apply(g)
        self.g = g; self.csv = r.random() < .3
        self.dq = dict(lag=r.uniform(.002, .02), bias=2e-4, noise=2e-3) if r.random() < .6 else None
        self.misc = r.random(8)
        self.x0 = {e: .1 for e in refit.CAND_J}; self.x0 |= {"payload": .8, "rotor-inertia": .3, "joint-torque-gain": .08, "gravity-error": .05}

    def build_J(self):
        r = np.random.default_rng(self.sub); x = {e: self.x0[e] * self.size[e] for e in self.hidden}; u = self.misc
        urdf = arms.lwr_urdf(.02, 0, .08, (0, 0), 0.) if self.robot == "lwr" else None
        m = arms.get(self.robot, urdf); n = m.nv
        m.gravity.linear = self.g
        q0 = np.array(arms.SEEDS[self.robot], float)
        tr = np.arange(0, self.T, .005); Q = np.repeat(q0[None], len(tr), 0)
        for j in range(n):
            for _ in range(3):
                f = np.exp(r.uniform(np.log(.04), np.log(.45)))
                Q[:, j] += .55 * min(1, .16 / f) * np.sin(2 * np.pi * f * tr + r.uniform(0, 6.28))
        ts = np.abs(pin.computeGeneralizedGravity(m, m.createData(), q0 + .3)) + 1.
        sc = .5 * ts + .15 * ts.max() * np.linspace(1, .25, n)
        fc = (.12 if self.hasfric else 0.) * sc * r.uniform(.6, 1.4, n); fv = (.06 if self.hasfric else 0.) * sc * r.uniform(.6, 1.4, n)
        off = np.zeros(n); dmu = np.zeros(n); lf = np.zeros(n); rip = np.zeros(n); spr = np.zeros(n); asym = np.zeros(n); gain = np.zeros(n)
        arm = np.zeros(n); true = m.copy()
        s = r.uniform(.5, 1.5, n); sg = r.choice([-1, 1], n); vs = .03 + .1 * u[0]; kr = int(5 + 12 * u[1]); php = r.uniform(0, 6.28, n)
        for e, a in x.items():
            if e == "joint-coulomb-friction": fc = a * sc * s
            if e == "joint-viscous-friction": fv = a * sc * s * 3
            if e == "joint-torque-offset": off = a * sc * s * sg
            if e == "joint-stribeck-friction": dmu = a * sc * s
            if e == "joint-load-friction": lf = a * s * 1.
            if e == "joint-torque-ripple": rip = a * sc * s
            if e == "joint-spring": spr = a * sc * s * 2
            if e == "joint-friction-asymmetry": asym = a * sc * s
            if e == "joint-torque-gain": gain = a * s * sg
            if e == "rotor-inertia": arm = a * s * np.linspace(1.5, .4, n) * 4
            if e == "payload":
                F = m.frames[m.getFrameId(arms.FRAMES[self.robot][1])].placement
                true.inertias[n] = true.inertias[n] + F.act(pin.Inertia(a, r.normal(0, .03, 3), np.eye(3) * 1e-4 * a))
            if e == "gravity-error":
                for j in range(2, n + 1):
                    Y = true.inertias[j]; true.inertias[j] = pin.Inertia(Y.mass, Y.lever + a * r.normal(0, 1, 3), Y.inertia)
        z = np.zeros(n)

        def fr(q, v, tau, dt):
            nonlocal z
            b = v * dt / 4e-4
            z = (z + b) / (1 + np.abs(b))
            return (fc + dmu * np.exp(-(v / vs) ** 2) + lf * np.abs(tau)) * z + fv * v + off + rip * np.sin(kr * q + php) + spr * q + asym * np.abs(z)
        rec = arms.simulate(true, self.g, None, m.getFrameId(arms.FRAMES[self.robot][1]), np.zeros(3), tr, Q, 1e-3, self.ctrl, joint=dict(f=fr, arm=arm + 0.))
        tau = rec["tau"] * (1 + gain)
        t1 = rec["t"]; rr = np.random.default_rng(self.sub + 2)
        if self.special == "tugs":     # somebody leans on the arm now and then
            J = m.createJointJacobian if False else None
            d = m.createData(); add = np.zeros_like(tau); tb = 0
            while (tb := tb + rr.exponential(2.5)) < t1[-1]:
                i = min(int(tb * 1000), len(t1) - 1); Jm = pin.computeFrameJacobian(m, d, rec["q"][i], m.getFrameId(arms.FRAMES[self.robot][1]), pin.LOCAL_WORLD_ALIGNED)[:3]
                add += np.exp(-((t1 - tb) / rr.uniform(.2, .7)) ** 2)[:, None] * (Jm.T @ rr.normal(0, 15, 3)) * self.sp_size()
            tau = tau - add
        rms = np.sqrt((tau ** 2).mean())
        tau = np.stack([lag1(t1, np.ascontiguousarray(tau[:, j]), 1 / (2 * np.pi * self.cut)) for j in range(n)], 1)
        t = world.rows(rr, t1[-1] - .05, self.fs, self.jit, self.drop)
        df = world.joints(rr, {"t": t}, rec, t, self.enc, self.dq)
        tq = np.floor(t * self.fst) / self.fst if self.fst < self.fs * .9 else t
        for j in range(n): 
            y = np.interp(tq, t1, tau[:, j])
            nz = rr.standard_normal(int(t[-1] * self.fst) + 3) * self.noise * rms
            df[f"tau{j+1}"] = y + nz[(tq * self.fst + .5).astype(int)]
        rig = {"robot": {"model": "robot.urdf" if urdf else self.robot, "gravity": self.g, "joints": list(m.names)[1:]}}
        if urdf: rig["robot"] |= {"sensor_frame": "ft_sensor", "tip_frame": "tool_tip"}
        world.write(self.dir, df, rig, urdf, self.csv)
        self.values = {}; self.kindtext = f"joint torques, {self.robot}, {self.T:.0f} s, {self.fs:g} Hz, torques low-passed at {self.cut:.0f} Hz"
        self.jn = f"offsets {np.round(off,3).tolist()}; coulomb {np.round(fc,3).tolist()}; viscous {np.round(fv,3).tolist()}; stribeck {np.round(dmu,3).tolist()} at {vs:.3f} rad/s; load {np.round(lf,3).tolist()}; ripple {np.round(rip,3).tolist()} k={kr}; spring {np.round(spr,3).tolist()}; asymmetry {np.round(asym,3).tolist()}; gain {np.round(gain,3).tolist()}; rotor {np.round(arm,3).tolist()}" + (f"; payload {x['payload']:.2f} kg" if "payload" in x else "")

    # ---------- drives
    def draw_D(self, r):
        self.model = ["rigid-body", "joint-coulomb-friction"] + (["joint-viscous-friction"] if not self.has("joint-viscous-friction") else [])
        self.T = float(np.exp(r.uniform(np.log(8), np.log(120))))
        if self.special == "long": self.T = 600.
        if self.has("joint-stribeck-friction"): self.T = float(np.clip(self.T, 40, 60))
        self.fs, self.jit, self.drop = self.rates(r, 200, 2000)
        if self.T > 60: self.fs = 200.
        self.enc = np.exp(r.uniform(np.log(2e-6), np.log((1e-5 if self.has("joint-stribeck-friction") else 1e-4) if self.T <= 60 else 3e-5)))
        self.cut = r.uniform(20, 50)
        self.csv = r.random() < .4; self.misc = r.random(8)
        self.dq = r.random() < .5
        self.x0 = {e: .08 for e in refit.CAND_D}

    def build_D(self):
        r = np.random.default_rng(self.sub); x = {e: self.x0[e] * self.size[e] for e in self.hidden}; u = self.misc
        dt = 5e-4; t = np.arange(0, self.T, dt)
        tq = np.exp(r.uniform(np.log(.3), np.log(8)))
        ref = np.zeros_like(t)
        if self.special == "fast-only":
            ref = 6 * t + .9 * np.sin(2 * np.pi * .6 * t) / (2 * np.pi * .6) * 2
        else:
            n_ = 4; turns = r.uniform(1.5, 5)
            for i in range(n_):
                f = max(np.exp(r.uniform(np.log(.05), np.log(.1 if self.has("joint-stribeck-friction") else .3))), 1.5 / self.T)
                ref += turns * min(1, .12 / f) * np.sin(2 * np.pi * f * t + r.uniform(0, 6.28))
        dref = np.gradient(ref, dt); am = np.abs(np.gradient(dref, dt)); J = tq / np.sqrt((am ** 2).mean()) * r.uniform(.5, 1.5)
        fc = tq * r.uniform(.1, .25) * (.5 if self.has("joint-stribeck-friction") else 1.); vmax = np.sqrt((dref ** 2).mean()); fv = tq * r.uniform(.1, .4) / vmax
        a = {e: x[e] * tq for e in x}
        kr = int(3 + 9 * u[1]); vs = (.3 + .3 * u[0]) * vmax
        ext = np.zeros_like(t)
        if self.special == "gusts":
            tb = 0; lev = 0.
            while (tb := tb + r.exponential(self.T / 25)) < self.T:
                lev = r.normal(0, .25); ext[int(tb / dt):] = lev * tq * self.sp_size()
            ext = lag1(t, ext, .03)
        kp = J * (2 * np.pi * 4) ** 2; kd = 2 * .9 * J * 2 * np.pi * 4
        if self.has("joint-viscous-friction"): fv = a["joint-viscous-friction"] / vmax
        o = drive(dt, ref, dref, J, fc, fv, a.get("joint-friction-asymmetry", 0.), a.get("joint-torque-offset", 0.), a.get("joint-stribeck-friction", 0.), vs, a.get("joint-spring", 0.) / np.std(ref),
                  a.get("joint-torque-ripple", 0.), float(kr), u[2] * 6.28, a.get("gravity-error", 0.), kp, kd, ext, vmax * np.exp(u[6] * 1.6) * (4e-6 if self.has("joint-stribeck-friction") else 2e-5))
        rms = np.sqrt((o[:, 3] ** 2).mean()); rr = np.random.default_rng(self.sub + 2)
        tau = lag1(t, np.ascontiguousarray(o[:, 3]), 1 / (2 * np.pi * self.cut) * .3)
        tl = world.rows(rr, self.T - .02, self.fs, self.jit, self.drop)
        df = {"t": tl, "q1": np.round(np.interp(tl, t, o[:, 0]) / self.enc) * self.enc}
        if self.dq: df["dq1"] = np.interp(tl, t, lag1(t, np.ascontiguousarray(o[:, 1]), .004)) + .003 * vmax * rr.standard_normal(len(tl))
        df["tau1"] = np.interp(tl, t, tau) + self.noise * rms * rr.standard_normal(len(tl))
        world.write(self.dir, df, {"sensor": {}}, None, self.csv)
        self.values = {}
        self.jn = f"inertia {J:.5g} kg m^2, coulomb {fc:.4g}, viscous {fv:.4g}; " + ", ".join(f"{e} {v:.4g} N m" for e, v in a.items()) + f"; ripple k={kr}; stribeck speed {vs:.3g} rad/s"
        self.kindtext = f"drive, {self.T:.0f} s, {self.fs:g} Hz"

    # ---------- testers
    def draw_T(self, r):
        base = str(r.choice(["kelvin-voigt", "hooke", "hunt-crossley"]))
        if self.has("hertz-exponent") or self.has("stiffening-layer") or self.has("hunt-crossley-damping"): base = "kelvin-voigt"
        if self.has("viscous-damping"): base = "hooke"
        if self.special == "hooke": base = "hooke"
        self.base = base; self.model = [base]
        self.fric = r.random() < .4 or bool([e for e in self.hidden if STAGE[e] == "tangential"])
        if self.fric: self.model.append("coulomb-friction")
        self.k = np.exp(r.uniform(np.log(800), np.log(20000))); self.d = r.uniform(.002, .006)
        self.T = float(np.exp(r.uniform(np.log(20), np.log(150))))
        if self.special == "long": self.T = 600.
        if self.special in ("wobble", "long") or self.has("stiffness-drift") or self.has("sensor-drift"): self.T = max(self.T, 60)
        self.fs, self.jit, self.drop = self.rates(r, 50, 1000)
        if self.T > 150: self.fs = 50.
        if self.has("mains-hum"): self.fs = 500.; self.T = min(self.T, 60)
        n = 1. if base != "hunt-crossley" else r.uniform(1.1, 1.5)
        self.P = dict(n=n, k=self.k * refit.DREF ** (1 - n), c=self.k * r.uniform(.01, .04) if base == "kelvin-voigt" else 0., lam=r.uniform(1, 6) if base == "hunt-crossley" else 0., mu=r.uniform(.2, .6) if self.fric else 0.,
                      fkind=int(r.choice([0, 1, 3, 4])), flen=r.uniform(8e-5, 1.2e-4), r2=r.choice([0., r.uniform(.003, .012)]), tau2=np.exp(r.uniform(np.log(.05), np.log(1.))), fa_len=r.uniform(.6e-3, 1.5e-3))
        if self.has("hunt-crossley-damping"): self.P["c"] = self.k * .003
        self.spread = r.uniform(0, 2.5e-5); self.csv = r.random() < .5; self.misc = r.random(8); self.chn = None
        self.give_rate = r.random() < .5
        self.x0 = {"relaxation": .25, "hysteresis": .15, "stress-softening": .2, "adhesion": .06, "stiffening-layer": .6, "hertz-exponent": .2, "hunt-crossley-damping": 6., "surface-offset": 3e-4, "stiffness-drift": .15,
                   "viscous-damping": .03, "sensor-bias": .1, "sensor-drift": .15, "sensor-lag": .05, "time-offset": .02, "saturation": .12, "mains-hum": .08, "structural-compliance": 5e-5,
                   "presliding": 8e-4, "friction-rounding": 6e-3, "load-dependent-friction": -.25, "stribeck-friction": .15, "viscous-friction": .03}

    def build_T(self):
        r = np.random.default_rng(self.sub); x = {e: self.x0[e] * self.size[e] for e in self.hidden}; u = self.misc; V = {}
        P = dict(self.P); Fs = self.k * self.d
        dt = 5e-4 if self.T < 200 else 1e-3
        p = world.Prog(-.001); p.H = .005
        d = self.d; tt = 0
        p.hold(.5, "free")
        reps = 0
        while len(p.ph) * p.H < self.T - 4:
            s = r.uniform(.5, 1.)
            if reps == 0: s = .6
            if reps == 2: s = 1.
            f = self.T / 40
            p.go(np.exp(r.uniform(np.log(.3), np.log(3))), "poke", z=s * d, s1=.003 * self.fric); p.hold(r.uniform(.5, 3) * max(1, f * .5), "hold")
            p.sine(r.uniform(2, 4), "poke", 2, .3 * s * d, r.uniform(.3, 1.5), 5e-4 * self.fric)
            if self.fric and self.special != "no-slides":
                p.const(r.uniform(.8, 2), "slide", s1=.015); p.hold(.4); p.const(r.uniform(1.5, 4), "slide", s1=0.); p.sine(3., "slide", 0, .002, .5)
            p.go(np.exp(r.uniform(np.log(.4), np.log(3))), "retract", z=-.0015 if r.random() < .6 or reps == 0 else .25 * d)
            p.hold(r.uniform(.3, 2), "rest"); reps += 1
        p.go(1., "retract", z=-.002); tr, X, ph = p.done()
        T = np.arange(0, tr[-1], dt); cmd = np.interp(T, tr, X[:, 2]); s1 = np.interp(T, tr, X[:, 0])
        v1 = lag1(T, np.gradient(s1, dt), .02); s1 = np.cumsum(v1) * dt
        z0 = 0.; ch = {}
        if self.base == "kelvin-voigt": V["kelvin-voigt.damping"] = P["c"]
        if self.base in ("kelvin-voigt", "hooke") and not self.has("hertz-exponent"): V[f"{self.base}.stiffness"] = P["k"]
        if self.base == "hunt-crossley": V |= {"hunt-crossley.damping": P["lam"] * P["k"], "hunt-crossley.stiffness": P["k"], "hunt-crossley.exponent": P["n"]}
        if self.fric: V["coulomb-friction.coefficient"] = P["mu"]
        for e, a in x.items():
            if e == "relaxation": P["r1"] = min(a, 1.5); P["tau1"] = .3 * 20 ** u[0]; V |= {"relaxation.ratio": P["r1"], "relaxation.time-constant": P["tau1"]}
            if e == "hysteresis": P["hy_ratio"] = a; P["hy_len"] = 3e-4 + 5e-4 * u[0]
            if e == "stress-softening": P["mu_ratio"] = min(a, .7); P["mu_len"] = (.6 + u[0]) * 1e-3; V |= {"stress-softening.ratio": P["mu_ratio"], "stress-softening.length": P["mu_len"]}
            if e == "adhesion": P["fa"] = a * Fs * 2; V |= {"adhesion.force": P["fa"]}
            if e == "stiffening-layer": P["K"] = a * P["k"]; P["db"] = .6 * d if self.group != "not-excited" else 3 * d; V |= {"stiffening-layer.stiffness": P["K"], "stiffening-layer.depth": P["db"]}
            if e == "hertz-exponent": P["n"] = 1 + min(a, .9); P["k"] = self.k * refit.DREF ** (1 - P["n"]); V |= {"hertz-exponent.exponent": P["n"]}
            if e == "hunt-crossley-damping": P["lam"] = a; V |= {"hunt-crossley-damping.damping": a}
            if e == "viscous-damping": P["c"] = a * self.k; V |= {"viscous-damping.damping": P["c"]}
            if e == "surface-offset": z0 = a; V |= {"surface-offset.offset": a}
            if e == "stiffness-drift": P["drift"] = a * 60 / self.T; V |= {"stiffness-drift.rate": P["drift"]}
            if e == "presliding": P["flen"] = a; P["fkind"] = 0; V |= {"presliding.length": a}
            if e == "friction-rounding": P["vr"] = a; P["fkind"] = 2; V |= {"friction-rounding.speed": a}
            if e == "load-dependent-friction": P["p"] = np.clip(a, -.8, .8); P["N0"] = Fs; V |= {"load-dependent-friction.exponent": P["p"]}; V.pop("coulomb-friction.coefficient")
            if e == "stribeck-friction": P["dmu"] = a; P["vs"] = 6e-3; V |= {"stribeck-friction.coefficient": a, "stribeck-friction.speed": P["vs"]}
            if e == "viscous-friction": P["cv"] = a * self.k * .1; V |= {"viscous-friction.damping": P["cv"]}
        P["z0"] = z0
        extz = np.zeros_like(T); extk = np.ones_like(T)
        if self.special == "pulse": extz = self.sp_size() * .08 * d * np.sin(2 * np.pi * (.6 + u[0]) * T + 2 * np.sin(2 * np.pi * .05 * T))
        if self.special == "switch":
            tb = 0
            while (tb := tb + r.exponential(2.)) < T[-1]: extk[int(tb / dt):] = 1 + self.sp_size() * .35 * r.uniform(-1, 1)
        gaps = np.zeros(1) if self.spread < 5e-6 else self.spread * np.linspace(0, 1, 12) ** 2 * 3
        o = tester(vector(**P), gaps, dt, cmd, 2 * np.pi * (6 + 8 * u[5]), extz, extk, v1, self.k * 25)
        w = np.zeros((len(T), 6)); w[:, 2] = o[:, 2]; w[:, 0] = o[:, 3]
        inn = o[:, 0] > 0; scale = np.sqrt((o[inn, 2] ** 2).mean())
        if self.chn is None: self.chn = self.chain_nuis(np.random.default_rng(self.sub + 1), scale, self.fs)
        ch = dict(self.chn); ch.pop("quant", 0); rr = np.random.default_rng(self.sub + 2)
        ez = np.array([.3, 0, 1, 0, 0, 0])
        for e, a in x.items():
            if e == "sensor-bias": ch["bias"] = a * scale * ez; V |= {"sensor-bias.offset[normal_force]": a * scale}
            if e == "sensor-drift": ch["drift"] = a * scale * ez * 60 / self.T; V |= {"sensor-drift.drift[normal_force]": ch["drift"][2]}
            if e == "sensor-lag": ch["lag"] = a; ch.pop("delay", 0); V |= {"sensor-lag.time-constant": a}
            if e == "time-offset": ch["delay"] = a * (1 if u[3] > .4 else -1)
            if e == "saturation":
                L = np.abs(w[:, 2]).max() * (1 - min(a, .7)) if self.group != "not-excited" else np.abs(w[:, 2]).max() * 2
                ch["sat"] = (2, L, u[4] > .5); V |= {"saturation.limit[normal_force]": L}
            if e == "mains-hum": ch["hum"] = (self.hum, a * scale * ez, np.ones(6) * u[2])
        t = world.rows(rr, T[-1] - .05, self.fs, self.jit, self.drop)
        wr = world.chain(ch, T, w, t, rr)
        res = d * np.exp(r.uniform(np.log(2e-5), np.log(1e-3)))
        df = {"t": t, "depth": np.round(np.interp(t, T, o[:, 0]) / res) * res}
        if self.give_rate: df["depth_rate"] = np.interp(t, T, o[:, 1]) + 2e-4 * rr.standard_normal(len(t))
        if self.fric: df |= {"slip1": np.interp(t, T, s1) + 1e-6 * rr.standard_normal(len(t)), "tangential_force1": wr[:, 0]}
        df["normal_force"] = wr[:, 2]
        world.write(self.dir, df, {"sensor": {}}, None, self.csv)
        self.values = V; self.kindtext = f"tester, {t[-1]:.0f} s, {self.fs:g} Hz" + (", with slides" if self.fric else "")

    # ---------- refit
    def prob(self):
        return refit.Joints(self.dir) if self.kind in "JD" else refit.Wrench(self.dir, self.judge, self.hum)

    def cands(self):
        c = {"C": refit.CAND_C, "T": refit.CAND_T, "F": refit.CAND_F, "J": refit.CAND_J, "D": refit.CAND_D}[self.kind]
        if self.kind == "T" and self.fric: c = c + ["viscous-friction", "stribeck-friction", "presliding", "friction-rounding", "load-dependent-friction"]
        return [e for e in c if e not in self.model and not (e == "hertz-exponent" and "hunt-crossley" in self.model) and not (e == "viscous-damping" and "kelvin-voigt" in self.model) and
                not (e == "hunt-crossley-damping" and "hunt-crossley" in self.model) and not (e == "structural-compliance" and self.kind == "T")
                and not ("coulomb-friction" not in self.model and e in ("presliding", "friction-rounding", "stribeck-friction", "load-dependent-friction", "friction-anisotropy"))]

    def measure(self):
        p = self.prob()
        full = p.fit(self.model + self.hidden)
        out = {"true": full[0], "rms": p.rms, "tot": full[2], "th": full[1]}
        for e in self.hidden:
            out[e] = p.fit(self.model + [h for h in self.hidden if h != e])[0]
        return p, out

    def ok(self, o):
        bad = []
        for e in self.hidden:
            if o[e] < 2 * o["true"]: bad.append(f"{e}: left out leaves {o[e]/o['true']:.2f} x true")
            if o[e] < .04 * o["rms"]: bad.append(f"{e}: left out leaves {100*o[e]/o['rms']:.1f} % of the rms")
        if o["true"] > .02 * o["rms"]: bad.append(f"true model leaves {100*o['true']/o['rms']:.2f} %")
        return bad

    def make(self, log=print, deadline=None):
        t0 = time.time()
        best = None
        for self.tries in range(6):
            if self.tries:
                sp = self.size.get("special"); self.size = {e: 1. for e in self.hidden}
                if sp: self.size["special"] = sp
                self.draw()
            if self.group in ("one", "two"):
                for it in range(4):
                    self.build(); p, o = self.measure(); bad = self.ok(o)
                    aim = {e: max(self.R * min(o["true"], .015 * o["rms"]), 2.2 * o["true"], .045 * o["rms"]) for e in self.hidden}
                    off = max(abs(np.log(o[e] / aim[e])) for e in self.hidden)
                    hopeless = o["true"] > .02 * o["rms"] and it >= 1
                    if (not bad and off < .25) or hopeless or it == 3: break
                    if deadline and time.process_time() > deadline and not bad: break
                    for e in self.hidden:
                        n2 = max(o[e] ** 2 - o["true"] ** 2, (.1 * o["true"]) ** 2)
                        self.size[e] *= np.clip(np.sqrt((aim[e] ** 2 - o["true"] ** 2) / n2), .15, 5)
                res = {"bad": bad}
            elif self.group == "quiet":
                self.build(); p, o = self.measure(); bad = [b for b in self.ok(o)]
            elif self.group == "not-excited":
                self.build(); p, o = self.measure(); w = p.fit(self.model)[0]
                bad = [f"true model leaves {100*o['true']/o['rms']:.2f} %"] if o["true"] > .02 * o["rms"] else []
                o["true"] = w
            else:
                for it in range(3):
                    self.build(); p = self.prob(); self.p_out(p)
                    o = self.out
                    goal = np.exp(self.rng.uniform(np.log(.06), np.log(.12)))
                    bad = [] if o["left"] >= .05 else [f"outside leaves only {100*o['left']:.1f} % after {o['best']}"]
                    if not bad: break
                    self.size["special"] = self.size.get("special", 1.) * np.clip(.075 / o["left"], 1.2, 3)
                o["true"] = o["err"]
            if not bad: break
            if deadline and time.process_time() > deadline: break
        self.bad = bad; self.o = o; self.p = p
        near = []
        if self.group in ("one", "two") and not bad:
            p2 = p.thin(2)
            lim = p2.fit(self.model + self.hidden, starts=o["th"])[2] * 1.02 if self.kind not in "JD" else o["tot"] * 1.02
            for e in self.hidden:
                rest = [h for h in self.hidden if h != e]
                b0 = p2.fit(self.model + rest)[1] if self.kind not in "JD" else None
                for c in self.cands():
                    if c in self.hidden: continue
                    if p2.fit(self.model + rest + [c], starts=b0, quick=7)[2] <= lim: near.append(c)
            if self.has("relaxation") and set(self.model) & {"hooke", "kelvin-voigt"}: near.append("zener")
            if self.kind in "JD" and "joint-torque-offset" in self.hidden and "joint-friction-asymmetry" not in near: pass
        self.near = sorted(set(near))
        log(f"{self.name} {self.group:11s} {self.kind} {self.model} {self.hidden or self.special} true {100*o['true']/p.rms:.2f}% " +
            " ".join(f"{e}:{o[e]/o['true']:.1f}x {100*o[e]/p.rms:.1f}%" for e in self.hidden if e in o) + (f" left {100*o['left']:.1f}% {o['best']}" if "left" in o else "") + f" near {self.near} bad {bad} tries {self.tries} {time.time()-t0:.1f} s")
        self.cache = None
        return self.row()

    def p_out(self, p):
        """what an outside case leaves after bias, drift, surface offset and the best two catalogue effects (greedy)"""
        free = {"C": ["sensor-bias", "sensor-drift", "surface-offset"], "T": ["sensor-bias", "sensor-drift", "surface-offset"], "F": ["sensor-bias", "sensor-drift"], "J": ["joint-torque-offset"], "D": ["joint-torque-offset"]}[self.kind]
        m = self.model + [f for f in free if f not in self.model]; got = []
        p = p.thin(2)
        e0 = p.fit(self.model)[0]; e, th = p.fit(m)[:2]
        cs = [c for c in self.cands() if c not in m]
        for _ in range(2):
            s = sorted((p.fit(m + [c], starts=th if self.kind not in "JD" else None, quick=4)[0], c) for c in cs if c not in m)
            m = m + [s[0][1]]; got.append(s[0][1])
            e2, th = p.fit(m, starts=th if self.kind not in "JD" else None)[:2]; e = min(e, e2, s[0][0])
        self.out = {"left": e / p.rms, "err": e, "best": got, "before": e0 / p.rms}

    def build(self):
        getattr(self, "build_" + self.kind)()

    def row(self):
        t = {"pulse": "the material's surface moves by itself (a pulse of wandering rate)", "switch": "the material's stiffness jumps at random times", "bumps": "a third party pushes the tool at random times",
             "slosh": "liquid in the tool: two lightly damped pendulums", "tugs": "somebody leans on the arm at random times", "gusts": "load torque that jumps at random times"}
        note = self.kindtext + (f"; {self.jn}" if self.kind in "JD" else "")
        for e in self.hidden:
            if e in self.o and self.group != "not-excited": note += f"; without {e} {100*self.o[e]/self.p.rms:.1f} % of the rms are left ({self.o[e]/self.o['true']:.1f} x)"
        if self.has("stiffness-inhomogeneity"): note += f"; form: {self.form}"
        if self.judge == "torque": note += "; errors and size over tx..tz"
        if self.group == "outside": note += f"; {100*self.o['before']:.1f} % before, {100*self.o['left']:.1f} % after offsets, drift and {', '.join(self.o['best'])}"
        v = {k: float(x) for k, x in self.values.items() if not any(k.startswith(e + ".") for e in NOVAL)}
        d = {"case": self.name, "group": self.group, "stage": STAGE[self.hidden[0]] if self.hidden else None, "kind": self.kindtext, "model": ",".join(self.model),
             "truth": self.hidden if self.group != "outside" else [t[self.special]], "near": self.near, "values": v, "true_error": float(self.o["true"]) if self.group != "outside" else None,
             "readings_rms": float(self.p.rms), "violations": self.bad, "hum": self.hum, "notes": note}
        if self.group == "outside": d["class"] = self.o["best"] if self.o["before"] - self.o["left"] > .25 * self.o["before"] else []; d["left_after_best_two"] = self.o["left"]
        return d
