"""Material testers: a servo axis (and a lateral stage) presses a foundation in closed loop; no robot in the log."""
from __future__ import annotations

import numpy as np
from numba import njit

import contact
import effects as fx
import measure as ms
from contact import NF, NST, touch
from laws import BASES
from plans import WISHES, tester_plan
from score import Judge, Redraw
from series import TesterSeries
from wrench_case import FRICTIONS, plain_values


@njit(cache=True)
def machine(X, dX, dt, m, kp, kd, cp, gg, ww, shift):
    """Three axes in PD control against the foundation, semi-implicit Euler; rows: depth, slip1, slip2, rates, forces."""
    n = X.shape[0]
    st = np.zeros((gg.shape[0], NST))
    fs = np.zeros(NF)
    F = np.zeros(3)
    x = X[0].copy()
    v = np.zeros(3)
    out = np.empty((n, 9))
    for i in range(n):
        touch(dt, i * dt, x[0] + shift, v[0], x[1], x[2], v[1], v[2], cp, gg, ww, st, fs, F)
        for k in range(3):
            out[i, k] = x[k]
            out[i, 3 + k] = v[k]
            out[i, 6 + k] = F[k]
        for k in range(3):
            f = -F[0] if k == 0 else F[k]
            a = (kp * (X[i, k] - x[k]) + kd * dX[i, k] + f) / m
            v[k] = (v[k] + dt * a) / (1 + dt * kd / m)
            x[k] += dt * v[k]
    return out


class TesterCase:
    kind = "tester"

    def __init__(self, rng, hidden, group, model=None, slide=None, wish=(), long=False, extras=True, outside=None, plan=None):
        self.rng, self.hidden, self.group, self.outside, self.long = rng, list(hidden), group, outside, long
        self.dmax = ms.logu(rng, 8e-4, 5e-3)
        tang = any(fx.STAGE.get(h) == "tangential" for h in hidden) or "stiffness-inhomogeneity" in hidden
        self.slide = bool(tang or rng.random() < 0.35) if slide is None else slide
        base = fx.base_for(rng, hidden)
        self.model = [base] + (["coulomb-friction"] if self.slide and "coulomb-friction" not in hidden else [])
        self.extra = []
        if model:
            self.model, base = list(model), model[0]
        elif extras and rng.random() < 0.5:
            h = set(hidden)
            pool = []
            if not h & {"relaxation", "hysteresis", "stress-softening", "stiffness-drift", "viscous-damping", "hunt-crossley-damping", "sensor-drift"} and base not in ("zener", "maxwell"):
                pool.append("relaxation")
            if not h & {"surface-offset", "adhesion", "structural-compliance", "stiffening-layer", "hertz-exponent"}:
                pool.append("surface-offset")
            if "sensor-bias" not in h and "sensor-drift" not in h:
                pool.append("sensor-bias")
            if self.slide and not h & {"viscous-friction", "stribeck-friction", "friction-rounding", "coulomb-friction", "load-dependent-friction"}:
                pool.append("viscous-friction")
            if pool:
                self.extra = [str(rng.choice(pool))]
        self.model += self.extra
        self.C = 3 if self.slide else 1
        self.cp0 = fx.contact_parameters(rng, base, self.dmax)
        self.cp0.update(dmax=self.dmax, mu=float(rng.uniform(0.12, 0.5)), bl=float(rng.uniform(0.8e-4, 1.2e-4)), fmode=str(rng.choice(FRICTIONS)),
                        sig=float(rng.uniform(1e-4, 5e-4)), fb=float(rng.uniform(0.03, 0.3)), zba=float(rng.uniform(0.3, 0.7)))
        if base == "kelvin-voigt":
            self.cp0["eta"] = rng.uniform(0.01, 0.05) * self.cp0["Fmax"] / self.dmax
        if base == "maxwell":
            self.cp0.update(r1=1.0, tau1=ms.logu(rng, 2, 8))
        self.ctx = dict(dmax=self.dmax, tester=True)
        self.shapes = {h: fx.shape(rng, h, self.ctx) for h in hidden}
        self.xshapes = {e: fx.shape(rng, e, self.ctx) for e in self.extra + ([e for e in self.model if e in fx.RANGE and e != "coulomb-friction"] if model else [])}
        F = self.cp0["Fmax"]
        frac = {"sensor-bias": 0.05 * F, "viscous-friction": 0.8 * F, "surface-offset": 0.08 * self.dmax, "relaxation": 0.25}
        self.xamps = {e: frac.get(e, fx.RANGE[e][1]) * float(rng.uniform(0.5, 1.4)) for e in self.xshapes}
        for sh in list(self.shapes.values()) + list(self.xshapes.values()):
            if "al" in sh:
                sh["al"] = self.dmax * rng.uniform(0.12, 0.3)
        w = set(wish)
        for e in hidden:
            w |= set(WISHES.get(e, []))
        if {"zener", "relaxation", "maxwell"} & set(self.model):
            w.add("holds")
        if {"viscous-friction", "stribeck-friction", "friction-rounding"} & set(self.model):
            w.add("speeds")
        if "tail" in w and self.dmax < 2e-3:
            pass
        if long:
            w.add("long")
        self._nuisances(F)
        self.seed_noise = int(rng.integers(2 ** 31))
        self.path = tester_plan(rng, self.dmax, self.slide, w) if plan is None else plan(rng, self.dmax, self.slide)
        self.servo = dict(w=ms.logu(rng, 60, 220), m=float(rng.uniform(1.0, 6.0)))
        self.Tend = self.path.T
        self.sim_cache = {}
        self.peak = np.array([F, 1, 1])

    def _nuisances(self, F):
        rng = self.rng
        fast = {"sensor-lag", "time-offset", "mains-hum"} & set(self.hidden + self.model)
        nu = ms.draw_common(rng, 250 if fast else 50, self.long)
        if not fast and not self.long and rng.random() < 0.2:
            nu["fs"] = float(rng.choice([50, 100]))
        sd = ms.logu(rng, 1e-3, 6e-3) * F
        quiet = {"sensor-lag", "time-offset"} & set(self.hidden + self.model)
        nu.update(sd=sd * np.r_[1.0, rng.uniform(0.7, 1.3, 2)][:self.C], lp=None if rng.random() < 0.5 or quiet else ms.logu(rng, 50, 300), lp_order=int(rng.integers(1, 3)),
                  native=None if rng.random() < 0.7 else float(rng.choice([200, 400])), native_mode=str(rng.choice(["hold", "interp"])), nonlin=float(rng.uniform(-0.01, 0.01)),
                  temp=rng.uniform(-0.05, 0.05, 3), surface=float(rng.uniform(-0.01, 0.01)) * self.dmax, edge=float(rng.uniform(0, 0.08)), r2=float(rng.uniform(0, 0.04)),
                  tau2=ms.logu(rng, 0.03, 0.12), dn=float(rng.uniform(-0.02, 0.02)), encoder=ms.logu(rng, 5e-8, 1.0e-6), strength=1.0, rate=bool(rng.random() < 0.5))
        if {"sensor-drift", "stiffness-drift"} & set(self.hidden + self.model):
            nu["temp"] = nu["temp"] * 0.3
        if "surface-offset" in self.model:
            nu["surface"] = 0.0
        self.nu = nu

    def world(self, amps, strength):
        cp, sens, tool, nu = dict(self.cp0), {}, {}, self.nu
        for src, shp in ((self.xamps, self.xshapes), (amps, self.shapes)):
            for e, v in src.items():
                if e == "outside":
                    continue
                if not fx.apply_contact(cp, e, v, shp[e]) and not fx.apply_sensor(sens, e, v, shp[e], self.C, self.peak):
                    tool[e] = (v, shp[e])
        if cp["n"] == 1.5:
            cp["n"] = 1.5 + strength * nu["dn"]
            cp["k"] = cp["Fmax"] / self.dmax ** cp["n"]
        if self.model[0] in ("zener", "kelvin-voigt", "hunt-crossley"):
            cp["r2"], cp["tau2"] = min(strength * nu["r2"], 0.2 * amps.get("relaxation", 1.0)), nu["tau2"]
        cp["edge"] = strength * nu["edge"]
        cp["edge_depth"] = 0.1 * self.dmax
        if cp["fmode"] != "rounded" and "presliding" not in amps:
            cp["fb"] *= strength
            cp["bl"] = 1e-4 * (cp["bl"] / 1e-4) ** strength
        return cp, sens, tool

    def simulate(self, cp, tool, strength):
        shift = strength * self.nu["surface"]
        if "surface-offset" in tool:
            v, sh = tool["surface-offset"]
            shift += v * sh["sign"]
        key = repr((sorted(cp.items(), key=str), shift))
        if key in self.sim_cache:
            return self.sim_cache[key]
        rate = 2000 if not self.long else 1000
        t, X, ph = self.path.sample(rate)
        dX = np.gradient(X, 1 / rate, axis=0)
        m, w = self.servo["m"], self.servo["w"]
        kp, kd = m * w * w, 1.6 * m * w
        gg, ww = contact.foundation(cp["n"], 1.5 * self.dmax, cp["edge"], cp["edge_depth"])
        Fn = cp["k"] * np.clip(X[:, 0], 0, None) ** cp["n"]
        X = X + np.column_stack([0.8 * Fn / kp, np.zeros((len(t), 2))])          # stiffness of the drive made up for, roughly
        out = machine(X, dX, 1 / rate, m, kp, kd, contact.pack({k: v for k, v in cp.items() if k in contact.IX}), gg, ww, shift)
        if not np.isfinite(out).all() or out[:, 0].max() > 2 * self.dmax:
            raise Redraw("the tester ran away")
        r = dict(t=t, x=out[:, :3], v=out[:, 3:6], Y=out[:, 6:6 + self.C], phase=ph)
        self.peak = np.abs(out[:, 6:9]).max(0)
        self.sim_cache = {key: r}
        return r

    def record(self, amps, strength, skip=()):
        cp, sens, tool = self.world(amps, strength)
        r = self.simulate(cp, tool, strength)
        if "sat" in sens:
            cp, sens, tool = self.world(amps, strength)
        for k in skip:
            sens.pop(k, None)
        nu = dict(self.nu, strength=strength)
        if nu["lp"] and strength < 1:
            nu["lp"] = nu["lp"] / max(strength, 1e-3)
        if nu["native"] and strength < 0.3:
            nu["native"] = None
        rng = np.random.default_rng(self.seed_noise)
        t = ms.sample_times(rng, r["t"][-1], nu["fs"], nu["jitter"], nu["drop"])
        x = ms.encoder(rng, ms.at(r["t"], r["x"], t), nu["encoder"])
        Y = r["Y"]
        if self.outside:
            Y = Y + self.outside.tester(self, r, amps)
        V = ms.sensor_chain(rng, r["t"], Y, t, sens, nu, nu["sd"])
        log = {"t": t, "depth": x[:, 0], "normal_force": V[:, 0]}
        if nu["rate"]:
            v = ms.filt(r["t"], r["v"][:, :1], nu["dq_lp"], 1)
            log["depth_rate"] = ms.at(r["t"], v, np.maximum(t - nu["dq_lag"], 0))[:, 0] + 2e-3 * self.dmax * rng.normal(size=len(t))
        if self.slide:
            log.update(slip1=x[:, 1], slip2=x[:, 2], tangential_force1=V[:, 1], tangential_force2=V[:, 2])
        return log, {}, cp, sens, tool, nu


def judge(case, amps, strength, skip=()):
    log, rig, cp, sens, tool, nu = case.record(amps, strength, skip)
    span = 0.02 if nu["fs"] >= 200 else 0.03
    ser = TesterSeries(log, most=8000, span=span)
    if "hum" in sens:
        ser.mains = round(sens["hum"]["f"] / 10) * 10.0
    j = Judge(ser, case.model, case.hidden, nu["sd"], plain_values(cp, sens, tool))
    return j, (log, rig, cp, sens, tool, nu)


__all__ = ["TesterCase", "judge", "BASES"]
