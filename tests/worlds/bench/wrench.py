"""Cases of the kind wrench: an arm in MuJoCo pokes and slides; the case object simulates, reads and measures itself."""
import numpy as np
import catalog as C
import effects as E
import measure
from laws import params
from motion import Path, Place, controller, compliance, H
from plant import Arm, EXT
from sensing import draw_nuisances, blank_sensor, read_channels, read_joints, stamps, FR

_ARMS = {}
BLANK = [0.0] * 6


def arm_of(name):
    if name not in _ARMS:
        _ARMS[name] = Arm(name)
    return _ARMS[name]


class WrenchCase:
    kind = "wrench"

    @property
    def unit(self):
        return "N·m" if self.hidden and E.ACTS[self.hidden[0]][0] == "torque" else "N"

    def __init__(self, seed, model, hidden, extra=None, flags=()):
        self.seed, self.model, self.hidden, self.flags = list(seed), list(model), list(hidden), set(flags)
        rng = np.random.default_rng(self.seed + [1])
        u = rng.uniform
        self.all = self.model + self.hidden
        self.arm = arm_of("lwr4plus" if rng.random() < .65 else "ur5")
        self.chain = self.arm.chain
        fast = {"tool-inertia", "sensor-lag", "time-offset", "mains-hum"} & set(self.all)
        self.long = "long" in self.flags
        self.rate = 100. if self.long else float(rng.choice([500, 1000, 1000, 2000] if fast else [250, 250, 400, 500, 500, 1000, 1000]))
        if not self.long and not fast and rng.random() < .08:
            self.rate = 100.
        if self.rate == 2000:
            self.flags.add("short")
        self.nu = draw_nuisances(rng, self.rate, "wrench")
        if "coulomb-friction" in self.hidden:
            self.nu["sigma_f"] = float(u(.05, .12))
            self.nu["sigma_t"] = .06 * self.nu["sigma_f"]
        self.place = Place(rng, self.arm)
        self.ctrl = controller(rng, self.arm.name)
        base = next((m for m in model if m in C.BASES), "none")
        self.base = base
        self.force, self.dmax = float(np.exp(u(np.log(6), np.log(24)))), float(u(2.2e-3, 4.5e-3))
        if "structural-compliance" in self.all or "sensor-misalignment" in self.all:
            self.force *= 1.4
        self.mu0 = float(np.exp(u(np.log(.06), np.log(.3))))
        if {"load-dependent-friction", "friction-anisotropy"} & set(self.hidden):
            self.mu0 = float(u(.2, .4))
        if "coulomb-friction" in self.hidden:
            self.force = min(self.force, float(u(6, 10)))
        self.law0 = E.draw_law(rng, base, self.force, self.dmax)
        m = float(np.exp(u(np.log(.25), np.log(.9))))
        ax = self.chain.rtip / np.linalg.norm(self.chain.rtip)
        com = ax * u(.3, .75) * np.linalg.norm(self.chain.rtip) + rng.normal(size=3) * .004
        self.tool_inertia_stated = "tool-inertia" not in self.hidden and rng.random() < .6
        r2 = ((.02 if self.tool_inertia_stated or "tool-inertia" in self.model else .006) * u(.6, 1.3)) ** 2    # unstated: small enough
        self.tool = dict(mass=m, com=com, inertia=[m * r2, m * r2 * 1.1, m * r2 * .9, 0, 0, 0])
        self.fric = np.column_stack([u(.1, 1.2, self.chain.n) * np.linspace(1, .4, self.chain.n), u(.1, 1., self.chain.n), np.full(self.chain.n, 3e-3)])
        self.rng_sizes = {e: None for e in self.all}
        self.make_motion(np.random.default_rng(self.seed + [2]))
        self.ctx = dict(dmax=self.dmax, force=self.force, T=self.T, level=1.0)
        r3 = np.random.default_rng(self.seed + [3])
        self.shapes = {e: E.shape(r3, e, self.ctx) for e in self.all if e in E.ACTS}
        self.model_amp = {e: float(r3.uniform(.8, 2.)) for e in self.model}
        self.extra, self.cache = extra, {}
        self.extra_u = r3.uniform(-1, 1, 12)
        self.rig_noise = r3.random() < .5
        self.with_phase = r3.random() < .6

    @property
    def main(self):
        return "second" if self.unit == "N·m" else "force"

    def relax(self, only_torque=False):
        """Nuisances and off-form terms halved, because the true model fitted too badly."""
        n = self.nu
        n["level"] *= .5
        half = lambda x: None if x is None else (np.array(x) * .5).tolist()
        for k in ("nonlin", "drift", "level_base", "tool_err"):
            n[k] = half(n[k])
        for k in ("clock", "surface", "toe", "ball", "jitter"):
            n[k] *= .5
        n["ell"] = 1e-4 + (n["ell"] - 1e-4) * .5
        n["encoder"] = max(n["encoder"] * .6, 2e-6)
        n["wrench_rate"] = None
        if n["second_tau"]:
            n["second_tau"][0] *= .5
        if n["lp_hz"]:
            n["lp_hz"] *= 1.6
        self.mu0 = max(self.mu0 * (.6 if only_torque else .75), .05)
        self.cache.clear()

    # ---------------------------------------------------------------- motion
    def make_motion(self, rng):
        u = rng.uniform
        fl, A = self.flags, set(self.all)
        slow = self.rate <= 100
        vmax = .02 if slow else .06
        dm = self.dmax
        P = Path([0, 0, -float(u(.08, .12)), 0, 0], len(self.arm.spec["wrist"]))
        fast = {"tool-inertia", "sensor-lag", "time-offset"} & A
        P.wait("rest", u(.3, .8))
        fm = 0.0 if slow else (float(u(2.5, 4)) if fast else (float(u(.8, 2)) if rng.random() < .6 else 0.0))
        amp = u(.6, 1.1, 3)
        if "unexcited" not in fl:
            P.turns(rng, float(u(5.5, 8)), amp, fm)
        speed = lambda a=.003: float(np.exp(u(np.log(a), np.log(vmax))))
        tang = bool(A & set(E.TANGENTIAL))
        cyc = 1
        if self.long:
            cyc = 6
        elif "short" in fl:
            cyc = 1
        one_depth = "one-depth" in fl
        tilt = .22 if "tip-offset" in A else .07
        if self.base == "none":                                       # free motion alone
            for _ in range(2):
                P.wait("rest", .4).go("free", .08, d=P.at[2] - .03, s1=float(u(-.04, .04))).turns(rng, float(u(6, 9)), u(.5, 1., 3), fm)
            cyc = 0
        else:
            P.go("approach", .05, d=-.003)
        for c in range(cyc):
            levels = list(rng.permutation([.4, .6, .8]))[:2 if rng.random() < .6 else 3] + [1.0, .6]
            if "stress-softening" in A:
                levels = [.4, .4, .7, .7, 1.0, 1.0, .7]
            for i, lv in enumerate(levels[:3] if "short" in fl else levels):
                P.go("poke", vmax if i == 1 else speed(), d=lv * dm)
                P.wait("hold", float(u(.3, .8)) * (3 if {"relaxation", "zener"} & A and i >= 2 else 1))
                damp = {"viscous-damping", "hunt-crossley-damping"} & set(self.hidden)
                if i == 2 or damp and i:                          # a few partial cycles at depth
                    for _ in range(5 if damp else 2):
                        v = float(u(.5, 1)) * vmax * 1.6 if damp else speed(.006)
                        P.go("poke", v, acc=.03 if damp else .06, d=.3 * lv * dm).go("poke", v, acc=.03 if damp else .06, d=lv * dm)
                P.go("retract", speed() if i != 3 else .004, d=-.0015)
                P.wait("rest", .15)
            if "adhesion" in A or rng.random() < .3:
                P.go("poke", .01, d=.3 * dm).wait("hold", .3).go("retract", .0015, d=-.0025)
            for sg in ((1, -1) if "tip-offset" in A else (1,)):
                P.go("approach", .05, ta=tilt * sg, tb=tilt * float(u(-1, 1))).go("poke", .02, d=.7 * dm).wait("hold", .4).go("retract", .02, d=-.003)
                P.go("approach", .05, ta=tilt * float(u(-.5, .5)), tb=-tilt * sg).go("poke", .02, d=.7 * dm).wait("hold", .4).go("retract", .02, d=-.003)
            P.go("approach", .05, ta=0, tb=0)
            if tang or "slides" in fl or rng.random() < .7:
                self.slides(P, rng, vmax, dm, one_depth, tang)
            if c == cyc - 1 or self.long:
                P.go("approach", .04, s1=0, s2=0).go("poke", speed(), d=.75 * dm).wait("hold", .5).go("retract", .01, d=-.004)
        P.go("retract", .06, d=-float(u(.08, .1)))
        if "unexcited" not in fl and ({"sensor-drift", "tool-mass", "sensor-bias"} & A or rng.random() < .5):
            P.turns(rng, float(u(4, 6)), amp * .8, fm)
        P.wait("rest", .4)
        X, O, ph = P.arrays()
        law = dict(self.law0)
        cz = compliance(self.place, self.ctrl, self.place.qh, self.chain.rtip)
        add = cz * E.static_force(law, X[:, 2]) if law else 0 * X[:, 2]
        X[:, 2] += add
        P2 = Path(X[0], P.nw)
        P2.x, P2.o, P2.ph = [X], [O], list(ph)
        self.ref, self.ph, _ = self.place.joints(P2, self.chain.rtip)
        self.T = len(self.ref) * H - .05

    def slides(self, P, rng, vmax, dm, one_depth, tang):
        u = rng.uniform
        A, fl = set(self.all), self.flags
        L = float(u(.010, .022))
        depths = [.7] if one_depth else [.45, .9]
        for k, dep in enumerate(depths):
            P.go("approach", .05, s1=0, s2=0).go("approach", .02, d=dep * dm).wait("rest", .2)
            speeds = [.3 * vmax, vmax, .07 * vmax] if {"stribeck-friction", "viscous-friction", "friction-rounding"} & A else [.3 * vmax, vmax]
            if "fast-only" in fl:
                speeds = [.8 * vmax, vmax]
            if "short" in fl:
                speeds = speeds[:1]
            for i, v in enumerate(speeds):
                ln = L if v > .1 * vmax else L * .25
                ax = ("s1",) if "one-way" in fl else ("s1", "s2")
                for a in ax:
                    P.go("slide", v, acc=.05, **{a: ln}).go("slide", v, acc=.05, **{a: 0.0})
                    if a == "s2" and i == 0:
                        P.wait("rest", .25)
                    if i == 0:
                        P.go("slide", v, acc=.05, **{a: -ln * .7}).go("slide", v, acc=.05, **{a: 0.0})
            if "one-way" not in fl and rng.random() < .6 and "short" not in fl:
                P.go("slide", .5 * vmax, s1=L * .6, s2=-L * .6).go("slide", .5 * vmax, s1=0, s2=0)
            if tang and "fast-only" not in fl:
                P.micro(rng, float(u(4e-4, 1.2e-3)), .004, 6, "s1" if k == 0 or "one-way" in fl else "s2")
            P.go("retract", .02, d=-.003)

    # ---------------------------------------------------------------- world
    def world(self, amps, with_extra=True):
        nu = self.nu
        self.ctx["level"] = nu["level"]
        w = dict(law=dict(self.law0), sensor=blank_sensor(), tip=self.chain.rtip.copy(), rtip=self.chain.rtip, z0=nu["surface"],
                 tool={k: (list(v) if k != "mass" else v) for k, v in self.tool.items()}, ext=np.zeros(len(EXT)))
        w["stated"] = dict(mass=self.tool["mass"], com=np.array(self.tool["com"]))
        if nu["toe"]:
            w["law"]["toe"] = nu["toe"]
        if "coulomb-friction" in self.model:
            w["law"]["mu"] = self.mu0
        w["law"].update(ftype=float(nu["ftype"]), ell=nu["ell"], lug=4e-4)
        if nu["second_tau"] and self.base != "none":
            w["law"].update(r4=nu["second_tau"][0], tau4=nu["second_tau"][1])
        w["ext"][EXT["ball"]] = nu["ball"] if "tip-offset" not in self.all else 0.0
        w["ext"][EXT["jump_t"]] = 1e9
        par = {}
        for e in self.model:
            if e in E.ACTS and e != "coulomb-friction":
                par[e] = E.apply(w, e, self.model_amp[e], self.shapes[e], self.ctx)
        for e in self.hidden:
            par[e] = E.apply(w, e, amps[e], self.shapes[e], self.ctx)
        if self.extra and with_extra:
            from outside import apply_wrench
            par["outside"] = apply_wrench(w, self.extra, amps["outside"], self.extra_u, self)
        er = nu["tool_err"]
        st = w["stated"]
        st["mass"] *= 1 + er[0]
        st["com"] = np.round(st["com"] * (1 + np.array(er[1:])), 5)
        st["mass"] = round(float(st["mass"]), 4)
        w["par"] = par
        return w

    def stream(self, w):
        key = repr((sorted(w["law"].items()), w["tip"].tolist(), w["tool"], w["z0"], w["ext"].tolist(), self.nu["level_base"]))
        if key not in self.cache:
            self.cache.clear()
            pl = self.place
            surf = np.array([pl.p + w["z0"] * pl.n, pl.n, pl.t1, pl.t2])
            a, b = self.nu["level_base"]
            g = np.array([9.81 * np.sin(a), 9.81 * np.sin(b), 0])
            g[2] = -np.sqrt(9.81 ** 2 - g[0] ** 2 - g[1] ** 2)
            law = dict(w["law"])
            if self.base == "none":
                law["k"] = 1e-9
            self.cache[key] = self.arm.run_contact(self.ref, H, self.T, surf, params(**law), w["tool"], g, w["tip"], self.ctrl, self.fric, w["ext"],
                                                   rec=2 if self.T > 100 else 1)
        return self.cache[key]

    def log(self, w):
        s = self.stream(w)
        nu = self.nu
        rng = np.random.default_rng(self.seed + [4])
        ts = s["t"]
        t = stamps(rng, ts[-1], self.rate, nu["jitter"], nu["drop"])
        S = w["sensor"]
        y = s["w"]
        M = np.eye(6) + S["cross"]
        r = S["misalign"]
        y = np.hstack([y[:, :3] - np.cross(r, y[:, :3]), y[:, 3:] - np.cross(r, y[:, 3:])]) * (1 + S["gain"])
        y = y @ M.T
        if S.get("sat_frac"):
            c = int(np.argmax(np.abs(y[:, :3]).max(0)))
            S["sat"] = np.full(6, np.inf)
            S["sat"][c] = S["sat_frac"] * np.abs(y[:, c]).max()
            w["par"]["saturation"]["limit"] = float(S["sat"][c])
        sg = np.r_[[nu["sigma_f"]] * 3, [nu["sigma_t"]] * 3]
        if S.get("quant_a"):
            S["quant"] = sg * 10 * S["quant_a"]
            w["par"]["quantization"]["step"] = float(S["quant"][0])
        out, pre, f = read_channels(ts, y, t, S, nu, rng, sg, FR)
        ql, dql = read_joints(ts, s["q"], s["dq"], t, nu, rng)
        ph = self.ph[np.clip((t / H).astype(int), 0, len(self.ph) - 1)]
        return dict(t=t, q=ql, dq=dql, w=out, pre=pre, phase=ph, sigma=sg * f, depth=s["depth"])

    def rig(self, w):
        pl, st = self.place, w["stated"]
        tool = dict(mass=st["mass"], com=st["com"])
        if "tool-inertia" not in self.hidden and (self.tool_inertia_stated or "tool-inertia" in self.model):
            tool["inertia"] = self.tool["inertia"]
        return dict(tool=tool, surf=np.array([pl.p, pl.n, pl.t1, pl.t2]), gravity=np.array([0, 0, -9.81]), tip=self.chain.rtip)

    def data(self, w, log, hz=150.):
        D = C.wrench_data(log, self.rig(w), self.chain, log["sigma"], hz)
        st = max(int(round(1 / hz / float(np.median(np.diff(log["t"]))))), 1)
        D.pre = log["pre"][::st]
        D.cap["N0"] = .5 * self.force
        S = w["sensor"]
        D.cap["hum_f"] = S["hum_f"]
        if S["sat"] is not None:
            D.cap["sat_ch"] = [int(np.argmin(S["sat"]))]
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
        n = self.chain.n
        cols = {"t": log["t"]}
        cols.update({f"q{i+1}": log["q"][:, i] for i in range(n)})
        if log["dq"] is not None:
            cols.update({f"dq{i+1}": log["dq"][:, i] for i in range(n)})
        cols.update({c: log["w"][:, i] for i, c in enumerate(("fx", "fy", "fz", "tx", "ty", "tz"))})
        if self.with_phase:
            cols["phase"] = log["phase"]
        tables.write_log(cols, folder, fmt)
        r = self.rig(w)
        tables.write_rig(folder, robot=dict(model=self.arm.name, sensor_frame=self.arm.spec["sensor"], tip_frame=self.arm.spec["tip"]),
                         tool=r["tool"], surface=None if self.base == "none" else dict(point=self.place.p, normal=self.place.n, tangent=self.place.t1),
                         noise=log["sigma"] if self.rig_noise else None)
