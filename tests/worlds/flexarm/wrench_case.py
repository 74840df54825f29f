"""Wrench logs: an arm presses and slides on a foundation, a wrist sensor listens."""
from __future__ import annotations

import numpy as np
from scipy.interpolate import CubicSpline

import arm as armlib
import contact
import dynamics as dyn
import effects as fx
import measure as ms
import robots
from laws import BASES
from motion import poses, surface_axes
from plans import WISHES, wrench_plan
from score import Judge, Redraw, tune

DT, SUB = 2.5e-4, 4
FRICTIONS = ["dahl", "prandtl", "lugre", "elasto-plastic", "iwan"]


class WrenchCase:
    kind = "wrench"

    def __init__(self, rng, hidden, group, model=None, wish=(), long=False, free_only=False, extras=True, outside=None):
        self.rng, self.hidden, self.group, self.outside, self.long = rng, list(hidden), group, outside, long
        self.dmax = float(rng.uniform(2.2e-3, 5e-3))
        base = fx.base_for(rng, hidden)
        self.model = [base] + ([] if "coulomb-friction" in hidden else ["coulomb-friction"])
        self.extra = {}
        if model:
            self.model = list(model)
            base = self.model[0]
        self.cp0 = fx.contact_parameters(rng, base, self.dmax)
        self.cp0.update(dmax=self.dmax, mu=float(rng.uniform(0.12, 0.45)), bl=float(rng.uniform(0.8e-4, 1.2e-4)), fmode=str(rng.choice(FRICTIONS)),
                        sig=float(rng.uniform(1e-4, 5e-4)), fb=float(rng.uniform(0.03, 0.3)), zba=float(rng.uniform(0.3, 0.7)))
        if "friction-rounding" in hidden:                     # a lubricated contact
            self.cp0["mu"] *= 0.3
        if extras and not model and rng.random() < 0.55:
            pool = [e for e in ("sensor-bias", "viscous-friction", "surface-offset", "stribeck-friction", "relaxation") if self._may(e)]
            for e in rng.permutation(pool)[:int(rng.choice([1, 1, 2]))]:
                self.extra[str(e)] = None
        self.model += [e for e in self.extra]
        everything = list(hidden) + self.model
        self.wish = set(wish)
        for e in hidden:
            self.wish |= set(WISHES.get(e, []))
        if {"viscous-friction", "stribeck-friction", "friction-rounding"} & set(everything):
            self.wish.add("speeds")
        if {"zener", "relaxation"} & set(everything):
            self.wish.add("holds")
        self._robot()
        self.ctx = dict(dmax=self.dmax)
        self.shapes = {h: fx.shape(rng, h, self.ctx) for h in hidden}
        self.xshapes = {e: fx.shape(rng, e, self.ctx) for e in self.model if e in self.extra or (model and e in fx.RANGE)}
        frac = {"sensor-bias": 0.05 * self.cp0["Fmax"], "viscous-friction": 0.1 * self.cp0["Fmax"] / 0.03 * 0.3, "surface-offset": 0.1 * self.dmax,
                "stribeck-friction": 0.1, "relaxation": 0.25, "sensor-drift": 0.5, "friction-rounding": 8e-3}
        self.xamps = {e: frac.get(e, fx.RANGE[e][1]) * float(rng.uniform(0.5, 1.4)) for e in self.xshapes}
        self._nuisances()
        self.seed_noise = int(rng.integers(2 ** 31))
        self._plan(free_only)
        self.sim_cache = {}

    def _may(self, e):
        h = set(self.hidden)
        no = {"sensor-bias": {"sensor-bias", "tool-mass"}, "surface-offset": {"surface-offset", "adhesion", "structural-compliance", "stiffening-layer", "tip-offset"},
              "viscous-friction": {"viscous-friction", "stribeck-friction", "friction-rounding", "coulomb-friction", "load-dependent-friction"},
              "stribeck-friction": {"viscous-friction", "stribeck-friction", "friction-rounding", "coulomb-friction", "presliding"},
              "relaxation": {"relaxation", "hysteresis", "stress-softening", "stiffness-drift", "viscous-damping", "hunt-crossley-damping"},
              "sensor-drift": {"sensor-drift", "stiffness-drift", "sensor-bias"}}
        if self.model[0] in ("zener", "maxwell") and e == "relaxation":
            return False
        return not (no[e] & h)

    def _robot(self):
        rng = self.rng
        name = str(rng.choice(["lwr4plus", "panda", "ur5"]))
        self.tip_z = 0.1 if name == "lwr4plus" else float(rng.uniform(0.08, 0.18))
        self.arm = robots.load(name, sensor_z=float(rng.uniform(0.01, 0.04)), tip_z=self.tip_z, yaw=float(rng.choice([0, 0.7854, -0.7854, 1.5708])))
        a = self.arm
        self.mass = float(ms.logu(rng, 0.15, 0.8))
        self.com = np.array([rng.uniform(-4e-3, 4e-3), rng.uniform(-4e-3, 4e-3), rng.uniform(0.3, 0.55) * self.tip_z])
        r2 = np.array([0.3, 0.3, 0.08]) * self.tip_z
        self.inertia = self.mass * np.diag([r2[1] ** 2 + r2[2] ** 2, r2[0] ** 2 + r2[2] ** 2, 2 * r2[2] ** 2])
        self.gravity = np.array([0, 0, -9.81])
        u = rng.random()
        if u < 0.12:
            self.gravity = np.array([0, 0, 9.81])
        elif u < 0.22:
            self.gravity = np.array([-9.81, 0, 0.0])
        # surface: near the nominal tool-down pose, leaning a little
        z0 = dyn.frames(a.qn[None], 0 * a.qn[None], 0 * a.qn[None], a.Rp, a.pp, a.ax, a.Rs, a.ps, a.tip)
        self.point = np.round(z0[2][0] + rng.uniform(-0.04, 0.04, 3), 4)
        lean = rng.uniform(-0.3, 0.3, 2) if rng.random() < 0.4 else np.zeros(2)
        nrm = np.array([np.sin(lean[0]), np.sin(lean[1]), 1.0])
        if rng.random() < 0.5:
            nrm = np.round(nrm, 3)
        tan = np.array([[1.0, 0, 0], [0, 1.0, 0], [0.8, 0.6, 0]][int(rng.integers(3))])
        self.n, self.t1, self.t2 = surface_axes(nrm, tan)
        R0 = z0[0][0]
        zt = R0[:, 2]
        v, c = np.cross(zt, -self.n), zt @ -self.n
        K = np.array([[0, -v[2], v[1]], [v[2], 0, -v[0]], [-v[1], v[0], 0]])
        self.R0 = (np.eye(3) + K + K @ K / (1 + c)) @ R0
        s = float(ms.logu(rng, 0.5, 1.6))
        self.K = a.K * s
        w = float(ms.logu(rng, 28, 110))
        self.cart = bool(rng.random() < 0.4)
        self.ctl = dict(w=w, cart=float(ms.logu(rng, 1500, 9000)))

    def _nuisances(self):
        rng = self.rng
        nu = ms.draw_common(rng, 250 if {"sensor-lag", "time-offset", "mains-hum"} & set(self.hidden) else 125)
        if rng.random() < 0.08 and not {"sensor-lag", "time-offset", "mains-hum", "tool-inertia", "presliding"} & set(self.hidden):
            nu["fs"] = 100.0
        quiet = {"sensor-lag", "time-offset"} & (set(self.hidden) | set(self.model))
        sd = ms.logu(rng, 0.02, 0.1)
        nu.update(sd=sd * np.r_[rng.uniform(0.7, 1.3, 3), rng.uniform(0.015, 0.04, 3)], lp=None if rng.random() < 0.4 or quiet else ms.logu(rng, 60, 400),
                  lp_order=int(rng.integers(1, 3)), native=None if rng.random() < 0.6 else float(rng.choice([250, 333, 500, 1000])),
                  native_mode=str(rng.choice(["hold", "interp"])), nonlin=float(rng.uniform(-0.01, 0.01)), temp=rng.uniform(-0.05, 0.05, 6) * np.r_[np.ones(3), 0.03 * np.ones(3)],
                  tilt=rng.uniform(-1e-3, 1e-3, 2), mass_err=float(rng.uniform(-0.02, 0.02)), com_err=rng.uniform(-0.02, 0.02, 3),
                  surface=float(rng.uniform(-5e-5, 5e-5)), edge=float(rng.uniform(0, 0.08)), r2=float(rng.uniform(0, 0.04)), tau2=ms.logu(rng, 0.03, 0.12),
                  radius=float(rng.uniform(3e-4, 2.5e-3)), encoder=ms.logu(rng, 1e-6, 8e-6), dn=float(rng.uniform(-0.02, 0.02)), strength=1.0)
        if "friction-rounding" in self.hidden:
            nu["sd"], nu["encoder"] = nu["sd"] * np.r_[1.3, 1.3, 1.3, 2, 2, 2], min(nu["encoder"], 2e-6)
        if "coulomb-friction" in self.hidden:                 # else a hundredth would be seen
            nu["sd"] = nu["sd"] * np.r_[2.0, 2, 2, 4, 4, 4]
        if {"sensor-drift", "stiffness-drift"} & set(self.hidden + self.model):
            nu["temp"] = nu["temp"] * 0.3
        if self.long:
            nu["fs"] = float(rng.choice([50, 100, 125, 250]))
        if "surface-offset" in self.model:
            nu["surface"] = 0.0
        self.nu = nu

    def _plan(self, free_only):
        rng = self.rng
        a = self.arm
        self.path = wrench_plan(rng, self.dmax, self.wish, self.long)
        if free_only:
            self.path = free_only(rng, self.dmax)
        args = (a.Rp, a.pp, a.ax, a.Rs, a.ps, a.tip)
        for attempt in range(7):
            t, X, ph = self.path.sample(125)
            P, R = poses(X, self.point, self.n, self.t1, self.t2, self.R0)
            Q, err = dyn.ik(R, P, a.qn, a.qn, *args, 30, 0.02)
            if err.max() > 1e-6 or (Q < a.lo + 0.02).any() or (Q > a.hi - 0.02).any():
                self.path.flatten(0.75)
                continue
            cs = CubicSpline(t, Q)
            tk = np.arange(int(t[-1] * 1000)) / 1000
            self.qd, self.dqd = cs(tk), cs(tk, 1)
            over = (np.abs(self.dqd).max(0) / (0.9 * a.vmax)).max()
            if over <= 1:
                break
            self.path.flatten(max(0.7, 0.95 / over))
            self.path.stretch(1.15)
        else:
            raise Redraw("unreachable or too fast")
        self.tk, self.Tend = tk, tk[-1]
        d = np.clip(-np.interp(tk, t, X[:, 0]), 0, None)
        i = np.minimum((tk * 125).astype(int), len(t) - 1)
        self.phase = ph[i]
        self.depth_ref = d

    # the world for given amplitudes
    def world(self, amps, strength):
        cp = dict(self.cp0)
        sens, tool = {}, {}
        nu = self.nu
        peak = getattr(self, "peak", np.array([1.0, 1, 30, 1, 1, 1]))
        for src, shp in ((self.xamps, self.xshapes), (amps, self.shapes)):
            for e, v in src.items():
                if e == "outside":
                    continue
                if not fx.apply_contact(cp, e, v, shp[e]) and not fx.apply_sensor(sens, e, v, shp[e], 6, peak):
                    tool[e] = (v, shp[e])
        if cp["n"] == 1.5:
            cp["n"] = 1.5 + strength * nu["dn"]
            cp["k"] = cp["Fmax"] / self.dmax ** cp["n"]
        if "relaxation" in amps or "relaxation" in self.model or self.model[0] in ("zener", "kelvin-voigt", "hunt-crossley"):
            cp["r2"], cp["tau2"] = min(strength * nu["r2"], 0.2 * amps.get("relaxation", 1.0)), nu["tau2"]
        cp["edge"] = strength * nu["edge"]
        if cp["fmode"] != "rounded" and "presliding" not in amps:
            cp["fb"] = cp["fb"] * strength
            cp["bl"] = 1e-4 * (cp["bl"] / 1e-4) ** strength
        return cp, sens, tool

    def simulate(self, cp, tool, strength):
        a = self.arm
        inertia = self.inertia.copy()
        if "tool-inertia" in tool:
            v, sh = tool["tool-inertia"]
            inertia = np.diag(np.array(sh["ratio"]) * v)
        tip = a.tip.copy()
        if "tip-offset" in tool:
            v, sh = tool["tip-offset"]
            tip = tip + v * sh["dir"]
        K = self.K
        key = repr((sorted((k, v) for k, v in cp.items()), inertia.tolist(), tip.tolist(), self.stated_shift(tool, strength), strength * self._tilt(), strength * self.nu["radius"]))
        if key in self.sim_cache:
            return self.sim_cache[key]
        m, c, I = a.with_tool(self.mass, self.com, inertia)
        g = self.gravity + np.linalg.norm(self.gravity) * strength * self._tilt()
        ddqd = np.gradient(self.dqd, 1e-3, axis=0)
        G = dyn.torques(self.qd, self.dqd, ddqd, g, a.Rp, a.pp, a.ax, m, c, I)
        N0 = cp["k"] * self.depth_ref ** cp["n"]
        JF = dyn.tip_torque(self.qd, N0[:, None] * self.n, a.Rp, a.pp, a.ax, a.Rs, a.ps, a.tip)
        need = G - JF
        thd = self.qd + need / K
        dthd = np.gradient(thd, 1e-3, axis=0)
        B, w = 0.5 * a.B, self.ctl["w"]                  # torque feedback halves the motors' inertia and quarters their friction (Albu-Schaeffer 2007)
        Fc, Fv = 0.25 * a.Fc, 0.5 * a.Fv
        kp, kd = B * w * w, 2 * 0.75 * w * B
        Kx, Dx = np.zeros(6), np.zeros(6)
        if self.cart:
            kp, kd = B * 12.0 ** 2, 2 * 0.8 * 12 * B
            Kx[:3], Kx[3:] = self.ctl["cart"], self.ctl["cart"] * 0.03
            Dx[:3], Dx[3:] = 1.4 * np.sqrt(Kx[:3] * 2.5), 1.4 * np.sqrt(Kx[3:] * 0.08)
        rs = np.random.default_rng(self.seed_noise + 7)
        chatter = rs.normal(size=(len(self.tk), a.n)) * 0.002 * Fc
        fp = armlib.friction_array(a.n, fc=Fc, fv=Fv)
        tff = need + 0.85 * Fc * np.tanh(self.dqd / 0.004) + Fv * self.dqd + B * ddqd
        gg, ww = contact.foundation(cp["n"], 1.5 * self.dmax, cp["edge"])
        cpa = contact.pack({k: v for k, v in cp.items() if k in contact.IX})
        place = self.point + self.stated_shift(tool, strength) * self.n
        rec = armlib.simulate(thd, dthd, tff, SUB, DT, 2 if self.nu["fs"] > 600 else 4, kp, kd, Kx, Dx, a.Rp, a.pp, a.ax, a.Rs, a.ps, tip, m, c, I, g, K, B, 0.02 * np.sqrt(K) + 0.05, fp, chatter,
                              True, place, self.n, self.t1, self.t2, strength * self.nu["radius"], cpa, gg, ww)
        n = a.n
        if not np.isfinite(rec).all() or np.abs(rec[::max(1, len(rec) // len(self.qd)), 1:1 + n][:len(self.qd)] - self.qd).max() > 0.1:
            raise Redraw("the arm ran away")
        q, dq, ddq = rec[:, 1:1 + n], rec[:, 1 + n:1 + 2 * n], rec[:, 1 + 2 * n:1 + 3 * n]
        Rs, Ps, Xt, Kin = dyn.frames(q, dq, ddq, a.Rp, a.pp, a.ax, a.Rs, a.ps, tip)
        RT = Rs.transpose(0, 2, 1)
        Fw = rec[:, -6:-5] * self.n + rec[:, -5:-4] * self.t1 + rec[:, -4:-3] * self.t2
        Fs = np.einsum("nij,nj->ni", RT, Fw)
        rc = np.einsum("nij,nj->ni", RT, rec[:, -3:] - Ps)
        wv, al, ga = (np.einsum("nij,nj->ni", RT, x) for x in (Kin[:, 0], Kin[:, 1], g - Kin[:, 2]))
        ft = self.mass * (ga - np.cross(al, self.com) - np.cross(wv, np.cross(wv, self.com)))
        tt = np.cross(self.com, ft) - al @ inertia - np.cross(wv, wv @ inertia)
        Y = np.column_stack([Fs + ft, tt + np.cross(rc, Fs)])
        out = dict(t=rec[:, 0], q=q, dq=dq, Y=Y, X=Xt, N=rec[:, -6], Kin=Kin, RT=RT, inertia=inertia)
        if len(self.sim_cache) > 2:
            self.sim_cache.clear()
        self.sim_cache[key] = out
        self.peak = np.abs(Y[:, :3]).max(0)
        return out

    def _tilt(self):
        g = self.gravity / np.linalg.norm(self.gravity)
        e = np.eye(3)[int(np.argmin(np.abs(g)))]
        u = np.cross(g, e)
        u /= np.linalg.norm(u)
        return self.nu["tilt"][0] * u + self.nu["tilt"][1] * np.cross(g, u)

    def stated_shift(self, tool, strength):
        """How much the true surface stands out of the stated one: d_true = d_stated + shift."""
        z = strength * self.nu["surface"]
        if "surface-offset" in tool:
            v, sh = tool["surface-offset"]
            z += v * sh["sign"]
        return z

    def rig(self, tool, strength):
        s, nu = strength, self.nu
        mass = self.mass * (1 + s * nu["mass_err"] * ("tool-mass" not in self.hidden + self.model))
        com = self.com * (1 + s * nu["com_err"] * ("tool-com" not in self.hidden + self.model))
        inertia = self.inertia
        if "tool-mass" in tool:
            v, sh = tool["tool-mass"]
            mass = self.mass - min(v, 0.9 * self.mass) * sh["sign"] if sh["sign"] > 0 else self.mass + v
        if "tool-com" in tool:
            v, sh = tool["tool-com"]
            com = self.com - v * sh["dir"]
        if "tool-inertia" in self.hidden + self.model:
            inertia = None
        return dict(mass=mass, com=com, inertia=inertia, tip=self.arm.tip, point=self.point, normal=self.n, tangent=self.t1, gravity=self.gravity)

    def record(self, amps, strength, skip=()):
        cp, sens, tool = self.world(amps, strength)
        r = self.simulate(cp, tool, strength)
        if "sat" in sens:
            cp, sens, tool = self.world(amps, strength)              # with the peak now known
        for k in skip:
            sens.pop(k, None)
        nu = dict(self.nu, strength=strength)
        if nu["lp"] and strength < 1:
            nu["lp"] = nu["lp"] / max(strength, 1e-3) if nu["lp"] / max(strength, 1e-3) < 900 else None
        if nu["native"] and strength < 0.3:
            nu["native"] = None
        rng = np.random.default_rng(self.seed_noise)
        t = ms.sample_times(rng, r["t"][-1], nu["fs"], nu["jitter"], nu["drop"])
        q = ms.at(r["t"], r["q"], t)
        log = {"t": t}
        nu["encoder"] = 1e-6 + (nu["encoder"] - 1e-6) * strength
        q = ms.encoder(rng, q, nu["encoder"])
        for i in range(self.arm.n):
            log[f"q{i + 1}"] = q[:, i]
        if nu["dq"]:
            v = ms.velocity(rng, r["t"], r["dq"], t, nu)
            for i in range(self.arm.n):
                log[f"dq{i + 1}"] = v[:, i]
        Y = r["Y"]
        if self.outside:
            Y = Y + self.outside.wrench(self, r, amps)
        V = ms.sensor_chain(rng, r["t"], Y, t, sens, nu, nu["sd"])
        for i, k in enumerate(("fx", "fy", "fz", "tx", "ty", "tz")):
            log[k] = V[:, i]
        i = np.minimum((t * 1000).astype(int), len(self.phase) - 1)
        log["phase"] = self.phase[i].astype(str)
        return log, self.rig(tool, strength), cp, sens, tool, nu


def plain_values(cp, sens, tool):
    """The engine's numbers as starts of the plain model's."""
    out = {"k": cp["k"], "mu": cp["mu"], "c": cp.get("eta", 0.0), "lam": cp.get("lam", 0.0), "r": max(cp.get("r1", 0.0), 1e-3), "tau": cp.get("tau1", 1.0)}
    for a, b in (("ha", "ha"), ("hl", "hl"), ("mr", "mr"), ("ml", "ml"), ("fa", "fa"), ("al", "al"), ("lk", "lk"), ("ld", "ld"), ("alpha", "drift"),
                 ("cv", "cv"), ("dmu", "dmu"), ("vs", "vs"), ("bl", "bl"), ("p", "p"), ("ani", "ani"), ("vr", "vr"), ("n", "n"), ("C", "cs")):
        if b in cp:
            out[a] = cp[b]
    sg = lambda e: tool[e][0] * tool[e][1].get("sign", 1)
    if "surface-offset" in tool:
        out["z0"] = sg("surface-offset")
    if "tip-offset" in tool:
        out.update({f"o{i}": tool["tip-offset"][0] * tool["tip-offset"][1]["dir"][i] for i in range(3)})
    if "lag" in sens:
        out["lag"] = sens["lag"]
    if "dt" in sens:
        out["dt"] = sens["dt"]
    if "sat" in sens:
        out["sat"] = sens["sat"]
    if "hum" in sens:
        out["fm"] = sens["hum"]["f"]
    if "gain" in sens:
        out["g"] = sens["gain"]
    return out


def judge(case, amps, strength, skip=()):
    from series import WrenchSeries
    log, rig, cp, sens, tool, nu = case.record(amps, strength, skip)
    ser = WrenchSeries(log, rig, case.arm, most=6000, jitter=max(0.08 * nu["encoder"], 1e-8))
    if "hum" in sens:
        ser.mains = round(sens["hum"]["f"] / 10) * 10.0
    j = Judge(ser, case.model, case.hidden, nu["sd"], plain_values(cp, sens, tool))
    return j, (log, rig, cp, sens, tool, nu)


__all__ = ["WrenchCase", "judge", "tune", "BASES"]
