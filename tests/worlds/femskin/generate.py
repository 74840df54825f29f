"""Hidden world `femskin`: writes logs of pokes and slides on finite-element materials with a known truth (see README.md)."""
from __future__ import annotations

import os

os.environ.setdefault("OMP_NUM_THREADS", "1")
import argparse
import json
from dataclasses import replace
from pathlib import Path as File

import numpy as np
import pyarrow as pa
import pyarrow.csv
import pyarrow.parquet as pq
from scipy.optimize import curve_fit

import fem
from effects import EFFECTS, OUTSIDE, PAIRS, UNEXCITED, Effect
from motion import Arm, Kin, Path, wander
from physics import DEFAULT, contact, finish, low_pass, readings

BASE = {"hooke": ("F0",), "kelvin-voigt": ("F0", "c"), "hertz": ("F0",), "hunt-crossley": ("F0", "lam", "dn"), "zener": ("F0", "r1", "tau1")}
SCALE = dict(F0=3.0, dn=0.1, c=10, lam=1, r1=0.2, tau1=0.5, r2=0.2, tau2=3, A=0.3, LA=3e-4, rho=0.2, Lm=1e-3, Fa=0.3, La=4e-4, K=1000, db=1e-3, z0=1e-4,
             alpha=0.1, C=1e-5, mu=0.2, ell=5e-4, dmu=0.1, vs=5e-3, cv=5, p=0.1, aniso=0.1, vr=3e-3, inh=0.1, m=0.05, gain=0.03, lag=5e-3, toff=5e-3, ox=5e-4, oy=5e-4, oz=5e-4)
POSITIVE = {"tau1", "LA", "Lm", "La", "ell", "vs", "vr", "C", "lag", "F0", "mu", "rho", "Fa"}

# ---------------------------------------------------------------- motion programmes
def programme(rng: np.random.Generator, arm: bool, style: set[str], length: float) -> Path:
    """Path of a log: free turns (arm), pokes, slides, as the style asks; at least `length` s long."""
    up = -0.012 if arm else -0.004
    p = Path(np.array([0, 0, up, 0, 0, 0.0]))
    p.go("free", 0.6)
    if arm:
        big = 0.55 if "orient" in style else rng.uniform(0.12, 0.3)
        p.go("free", 1.0, d=-0.06)
        turns = [dict(rx=big), dict(rx=-big, ry=0.4 * big), dict(rx=0, ry=-big), dict(ry=big, rz=0.8 * big)]
        for turn in turns[: 4 if "orient" in style else 2]:
            p.go("free", rng.uniform(0.8, 1.2), **turn)
            p.go("rest", 0.25)
        p.go("free", 0.9, rx=0, ry=0, rz=0)
        side = 0.09 if "roam" in style else 0.04
        for k in (1, -1):
            p.go("free", rng.uniform(0.45, 0.8), s1=side * k, s2=-side * k * rng.uniform(0.3, 1), **({"d": -0.1 - 0.05 * k} if "roam" in style else {}))
        p.go("free", 1.2, s1=0, s2=0, d=up)
    shallow = "shallow" in style
    deep = [1.1e-3, 1.4e-3, 1.6e-3] if shallow else [1.6e-3, 2.8e-3, 4.2e-3, 5.6e-3]
    both = "slide" in style or "across" in style or "twist" in style
    while True:
        n = (2 if not {"fast", "tilt"} & style else 3) if both else (7 if "repeat" not in style else 8)
        depths = list(rng.choice(deep, n)) if "depths" not in style else [deep[i % len(deep)] for i in range(n)]
        if both and "depths" in style: depths = [deep[0], deep[-2], deep[-1]]
        if "repeat" in style: depths = ([deep[-2]] * 2 + [deep[0]] + [deep[-2]] * 2 + [deep[-1]] * 2 + [deep[1]])[:n + 1]
        if shallow: depths = deep[:n] + deep[:max(0, n - 3)]
        speeds = [0.006, 0.02, 0.045] + ([0.08, 0.06, 0.1] if "fast" in style else [])
        for i, d in enumerate(depths):
            d, v = float(d) * rng.uniform(0.95, 1.05), float(speeds[i % len(speeds)])
            if arm and both and "tilt" in style: p.go("free", 0.6, rx=(0.22, -0.2, 0)[i % 3], ry=(0.1, 0.2, -0.22)[i % 3])
            p.move("approach", 0.03, d=-0.0025)
            p.move("poke", v, d=d)
            p.go("hold", (rng.uniform(1.2, 2.3) if "hold" in style else rng.uniform(0.3, 0.8)))
            if "loops" in style:
                for back, vb in ((0.45, 0.004), (0.6, 0.03)): p.move("poke", vb, d=d * back).move("poke", vb, d=d)
            if "slow-retract" in style and i % 2 == 0:
                p.move("retract", 0.004, d=0.0006).move("retract", 0.0015, ramp=0.1, d=-0.0014)
            p.move("retract", max(v, 0.012), d=-0.0035)
            p.go("rest", rng.uniform(0.15, 0.4))
        if arm: p.go("free", 0.4, rx=0, ry=0)
        if both: slides(p, rng, style, arm)
        if p.t > length: break
    p.go("free", 0.8, s1=0, s2=0, d=up).go("free", 0.6)
    return p

def slides(p: Path, rng: np.random.Generator, style: set[str], arm: bool) -> None:
    """Strokes along both tangents at several depths and speeds, with micro strokes or turns where asked."""
    depths = [1.8e-3, 4.4e-3] if "loads" not in style else [1.2e-3, 2.8e-3, 5.2e-3]
    speeds = [0.045, 0.014] + ([0.004, 0.09] if "speeds" in style else [])
    if "one-load" in style: depths = [3.2e-3]
    if "one-speed" in style: speeds = [0.025]
    wide = 0.03 if "across" in style else 0.016
    for k, d in enumerate(depths):
        p.move("approach", 0.04, s1=-0.5 * wide, s2=0, d=-0.003)
        p.move("poke", 0.02, d=d * rng.uniform(0.95, 1.05))
        p.go("hold", 0.4)
        for v in speeds if "twist" not in style else ():
            if v < 0.01 and k: continue
            slow = v < 0.03 and "one-speed" not in style
            a, ramp = (0.35 * v, 0.4) if slow else (wide, 0.06 if "one-speed" in style else 0.3)
            x, y = p.x[:2] if slow else (0.0, 0.0)
            p.move("slide", v, ramp, s1=x + a).move("slide", v, ramp, s1=x - a)
            if "one-way" not in style:
                b = min(a, 0.012)
                p.move("slide", v, ramp, s2=y + b).move("slide", v, ramp, s2=y - b).move("slide", v, ramp, s1=x + 0.7 * a, s2=y + 0.7 * b)
            p.go("hold", 0.25)
        if "micro" in style:
            x, y = p.x[0], p.x[1]
            for a in (3e-4, 1e-3, 2.5e-3):
                p.go("slide", 0.35, s1=x + a, s2=y).go("slide", 0.4, s1=x - a).go("slide", 0.3, s1=x, s2=y + a).go("slide", 0.35, s2=y - a)
                p.go("hold", 0.2)
        if "twist" in style:
            for turn in (0.5, -0.5, 0.3, -0.2, 0.4, 0): p.go("slide", rng.uniform(0.6, 1.1), rz=turn)
            p.move("slide", 0.02, s1=0.004).move("slide", 0.02, s1=-0.004)
        p.move("retract", 0.03, d=-0.004)

# ---------------------------------------------------------------- fits
def project(kin: Kin, r: np.ndarray, channel: str, mask: np.ndarray) -> float:
    """Rms of residual readings in a channel: n normal, t tangential, f forces, m moments, z moment about the tool."""
    if kin.rot is None:
        slides = kin.s.any()
        return rms({"n": r[:, :1], "t": r[:, 1:], "f": r if slides else r[:, :1]}[channel][mask])
    if channel in "nt":
        base = np.einsum("nij,nj->ni", kin.rot, r[:, :3])
        return rms((base[:, 2:] if channel == "n" else base[:, :2])[mask])
    return rms({"f": r[:, :3], "m": r[:, 3:], "z": r[:, 5:]}[channel][mask])

def r5(x: float) -> float:
    return float(f"{x:.5g}")

def rms(x: np.ndarray) -> float:
    return float(np.sqrt(np.mean(x**2))) if x.size else 0.0

class Case:
    """One log: motion, truth, instruments; `strength` scales what is hidden."""

    def __init__(self, world: "World", spec: dict, rng: np.random.Generator):
        self.w, self.spec, self.rng = world, spec, rng
        self.arm = spec["kind"] == "wrench"
        self.hidden: list[str] = spec["hidden"]
        self.group = spec["group"]
        self.out: Effect | None = OUTSIDE[spec["outside"]][0] if spec.get("outside") else None
        self.defs = [self.out] if self.out else [EFFECTS[h] for h in self.hidden]
        style = set(spec.get("style", ()))
        if self.group != "unexcited": style |= {s for d in self.defs for s in d.style}
        if not style & {"pokes", "slide", "across", "twist", "shallow"} and rng.random() < 0.65 and not {"loops", "slow-retract"} & style:
            style.add("slide")
        if "pokes" in style: style -= {"slide", "across", "speeds", "loads", "micro"}
        self.style, self.slides = style, bool(style & {"slide", "across", "twist"})
        self.choose_model()
        self.draw_instruments()
        self.motion()

    # -- physics
    def choose_model(self) -> None:
        rng = self.rng
        bases = [b for b in ("hooke", "kelvin-voigt", "hertz", "hunt-crossley", "zener") if all(b in d.bases for d in self.defs)]
        if self.group == "unexcited" and "hooke" in self.style: bases = ["hooke"]
        self.base, laws, exponent = str(rng.choice(bases)), self.w.laws, "hertz-exponent" in self.hidden
        ball = self.base in ("hertz", "hunt-crossley")
        geometry = {(False, False): ["punch", "punch-worn"], (True, False): ["ball-foam", "ball-gel"], (False, True): ["ball-gel", "ball-foam", "ball-thin"],
                    (True, True): ["cone", "ball-thin"]}[(ball, exponent)]
        if self.group == "none": geometry = [g for g in geometry if g != "punch-worn"]
        self.law = laws[str(rng.choice(geometry))]
        self.nbase = 1.5 if ball else 1.0
        par = dict(F0=rng.uniform(4, 13) + 5 * ("shallow" in self.style), mu=rng.uniform(0.3, 0.9), ell=1e-4, fric=int(rng.integers(0, 4)), N0=3.0)
        if self.base == "kelvin-voigt": par["c"] = rng.uniform(6, 25)
        if self.base == "hunt-crossley": par["lam"] = rng.uniform(0.8, 3.5)
        if self.base == "zener": par |= dict(r1=rng.uniform(0.25, 0.6), tau1=rng.uniform(0.3, 1.2))
        if "presliding" in self.hidden: par["fric"] = int(rng.integers(1, 4))
        model = [self.base] + (["coulomb-friction"] if self.arm or self.slides else [])
        self.free, tangential = list(BASE[self.base]) + (["mu"] if len(model) > 1 else []), any(d.channel == "t" for d in self.defs)
        extra = {"relaxation": dict(r1=0.4, tau1=0.7), "surface-offset": dict(z0=2.5e-4), "sensor-bias": {f"b{j}": (0.4, -0.3, 0.5, .01, -.008, .004)[j] for j in range(6)},
                 "friction-anisotropy": dict(aniso=0.15), "viscous-friction": dict(cv=14.0), "presliding": dict(ell=8e-4)}
        names = (["relaxation", "sensor-bias"] if tangential else ["friction-anisotropy", "viscous-friction", "presliding"] if self.slides else [])
        if self.group == "none":
            names = ["relaxation", "surface-offset", "sensor-bias"] + (["friction-anisotropy", "viscous-friction", "presliding"] if self.slides else [])
        if self.base in ("zener", "hunt-crossley"): names = [n for n in names if n != "relaxation"]
        if names and self.group in ("single", "none", "pair") and rng.random() < 0.35 and not {"friction-rounding", "sensor-crosstalk"} & set(self.hidden):
            name = str(rng.choice([n for n in names if n not in self.hidden] or names))
            if name not in self.hidden:
                f = rng.uniform(0.7, 1.3)
                par |= {k: v * f for k, v in extra[name].items()}
                self.free += [k for k in extra[name] if self.arm or not k.startswith("b") or k in ("b0", "b1", "b2")]
                if name == "presliding" and par["fric"] == 0: par["fric"] = 1
                model.append(name)
        self.model, self.par = model, par
        heavy = "heavy" in self.style or {"tool-mass"} & set(self.hidden) and rng.random() < 0.4
        self.mass = rng.uniform(0.6, 0.9) if heavy else rng.uniform(0.15, 0.35)
        self.com = np.array([rng.uniform(-3e-3, 3e-3), rng.uniform(-3e-3, 3e-3), rng.uniform(0.035, 0.06)])
        self.tool = dict(m=self.mass, cx=self.com[0], cy=self.com[1], cz=self.com[2]) if self.arm else {}
        stiff = self.w.collar
        self.context = dict(arm=self.arm, m=self.mass, com=self.com, F0=par["F0"], wk=stiff[2], peak=20.0)
        self.u, self.profile = rng.random(8), self.w.profiles[str(rng.choice(list(self.w.profiles)))]

    def truth(self, strength: list[float], without: str | None = None) -> dict:
        """All law parameters, hidden effects at their strengths; `without` one of them (then at the nominal value)."""
        par = self.par | self.tool
        if without is not None and "hertz-exponent" in ([without] if without else self.hidden):
            par = par | dict(dn=self.nbase - self.law.n)
        names = self.hidden or ["outside"] * len(self.defs)
        for name, d, a in zip(names, self.defs, strength):
            if without is None or (without and name != without): par = par | d.make(a, self.u, self.context)
        return par

    # -- instruments
    def draw_instruments(self) -> None:
        rng, quiet = self.rng, self.group == "none"
        sf, st = rng.uniform(0.010, 0.035), rng.uniform(3e-4, 8e-4)
        self.sigma = np.array([sf, sf, min(1.5 * sf, 0.05), st, st, 0.7 * st]) if self.arm else np.full(3, sf)
        dm = np.clip(rng.uniform(-0.02, 0.02) * self.mass, -0.004, 0.004)
        n = dict(force_noise_N=float(self.sigma[0]), nonlinearity=float(rng.uniform(-1, 1) * (0.003 if quiet else 0.008)),
                 surface_error_m=float(rng.uniform(-1, 1) * 1.2e-5), clock_error_s=float(rng.uniform(-2e-4, 2e-4)),
                 drift_N_per_min=0.0, jitter=float(rng.uniform(0, 0.1)), dropped=float(rng.choice([0, rng.uniform(0, 0.02)])),
                 servo_rad=float(rng.uniform(5e-6, 3e-5)))
        if self.arm:
            n |= dict(torque_noise_Nm=float(st), base_tilt_rad=[float(x) for x in rng.uniform(-1, 1, 2) * 0.0024], mass_error_kg=float(dm),
                      com_error=float(rng.uniform(-0.02, 0.02)), encoder_step_rad=float(10 ** rng.uniform(np.log10(2e-6), np.log10(2e-5))),
                      dq_noise=float(10 ** rng.uniform(-5, np.log10(5e-4))), dq_bias=float(rng.uniform(-2e-4, 2e-4)), dq_missing=bool(rng.random() < 0.25))
            n |= dict(dq_lag_s=float(rng.uniform(0, 5e-3))) if rng.random() < 0.5 else dict(dq_lowpass_Hz=float(rng.uniform(20, 100)))
        else:
            n |= dict(depth_noise_m=float(rng.uniform(2e-7, 2e-6)), depth_step_m=float(rng.choice([1e-7, 5e-7, 1e-6])), rate_noise=float(rng.uniform(5e-5, 3e-4)),
                      has_rate=bool(rng.random() < 0.3))
        self.nuis = n
        rates = [200, 250, 500, 500, 1000] if self.arm else [250, 250, 400, 500, 1000] if self.slides else [50, 100, 200, 500, 1000]
        self.rate = float(self.spec.get("rate") or rng.choice(rates))
        if {"sensor-lag", "time-offset", "mains-hum"} & set(self.hidden): self.rate = max(self.rate, 250.0)
        self.length = self.spec.get("length", 0.0)

    def motion(self) -> None:
        rng, n = self.rng, self.nuis
        self.path = programme(rng, self.arm, self.style, self.length)
        dt = 2e-3 if self.path.t > 60 else 5e-4 if self.rate > 1000 else 1e-3
        t, k = np.arange(0, self.path.t - 0.01, dt), np.arange(0, self.path.t - 0.02, 1 / self.rate)
        tl = k + rng.uniform(-1, 1, len(k)) * n["jitter"] / self.rate
        self.tl = np.sort(tl[(rng.random(len(k)) >= n["dropped"]) & (tl >= 0)])
        if self.arm:
            arm = self.w.arm
            r, th = rng.uniform(0.5, 0.62), rng.uniform(-0.6, 0.6)
            self.point, yaw = np.round([r * np.cos(th), r * np.sin(th), rng.uniform(0.05, 0.2)], 4), rng.uniform(-0.3, 0.3)
            sp = arm.ik(self.path, self.point, yaw, rng, n["servo_rad"])
            self.spline, v, a = sp, sp.derivative(), sp.derivative(2)
            self.kin, q, step = arm.kin(t, sp(t), v(t), a(t), self.point), sp(self.tl), n["encoder_step_rad"]
            self.q = np.round(q / step) * step
            self.kl = arm.kin(self.tl, self.q, v(self.tl), a(self.tl), self.point)
            exact = arm.kin(self.tl, q, v(self.tl), a(self.tl), self.point)
            self.kl = replace(self.kl, dd=exact.dd, v=exact.v, acc=exact.acc, om=exact.om, al=exact.al)
            if "dq_lag_s" in n: dq = v(np.maximum(self.tl - n["dq_lag_s"], 0))
            else:
                y, z, tau = v(t), np.empty((len(t), 7)), 1 / (2 * np.pi * n["dq_lowpass_Hz"])
                low_pass(t, np.ascontiguousarray(y), tau, z)
                dq = np.stack([np.interp(self.tl, t, z[:, j]) for j in range(7)], 1)
            self.dq = dq + n["dq_bias"] * rng.uniform(-1, 1, 7) + rng.normal(0, n["dq_noise"], dq.shape)
        else:
            x = self.path.at(t)[:, [2, 0, 1]] + wander(rng, t, 3, 3e-6)
            if not self.slides: x[:, 1:] = 0
            v = np.gradient(x, dt, axis=0)
            self.kin = Kin(t, x[:, 0], v[:, 0], x[:, 1:].copy(), v[:, 1:].copy())
            at = lambda y: np.stack([np.interp(self.tl, t, y[:, j]) for j in range(3)], 1)
            xl, vl = at(x), at(v)
            xl = xl + rng.normal(0, n["depth_noise_m"], xl.shape)
            xl = np.round(xl / n["depth_step_m"]) * n["depth_step_m"] * [1, self.slides, self.slides]
            self.kl = Kin(self.tl, xl[:, 0], vl[:, 0], xl[:, 1:].copy(), vl[:, 1:].copy())
            self.rate_log = vl[:, 0] + rng.normal(0, n["rate_noise"], len(vl))
        every = max(1, len(t) // 9000)
        self.kf, self.noise = self.kin.take(np.arange(0, len(t), every)), rng.normal(0, 1, (len(self.tl), len(self.sigma))) * self.sigma
        self.noise_behind = bool(rng.random() < 0.3)
        n["drift_N_per_min"] = float(rng.uniform(-0.5, 0.5) * self.sigma[0] / max(self.path.t / 60, 0.1))
        y = readings(self.kf, self.par | self.tool, self.law, self.profile)
        self.context["peak"] = float(np.abs(y[:, 2 if self.arm else 0]).max())

    def measure(self, par: dict, step: bool = True) -> np.ndarray:
        """The logged readings: true motion, nuisances, noise."""
        n, par = self.nuis, dict(par)
        late = {k: par.pop(k) for k in ("hum", "hf", "hph", "sat", "step") if k in par}
        if not step: late.pop("step", None)
        late["nl"] = n["nonlinearity"]
        par["z0"] = par.get("z0", 0.0) + n["surface_error_m"]
        par["toff"] = par.get("toff", 0.0) + n["clock_error_s"]
        for j in range(3): par[f"k{j}"] = par.get(f"k{j}", 0.0) + n["drift_N_per_min"]
        if self.arm:
            par["m"] += n["mass_error_kg"]
            par |= {k: par[k] * (1 + n["com_error"]) for k in ("cx", "cy", "cz")}
            par["lx"], par["ly"] = n["base_tilt_rad"]
        y = readings(self.kin, par, self.law, self.profile)
        y = np.stack([np.interp(self.tl, self.kin.t, y[:, j]) for j in range(y.shape[1])], 1)
        return finish(self.tl, y, late, self.noise, not self.noise_behind)

    def predict(self, kin: Kin, par: dict, late: bool = True) -> np.ndarray:
        y = readings(kin, par, self.law, self.profile)
        return finish(kin.t, y, par if late else {k: v for k, v in par.items() if k != "step"})

    def fit(self, kin: Kin, y: np.ndarray, start: dict, free: list[str], rounds: int = 6) -> tuple[dict, np.ndarray]:
        """Levenberg-Marquardt over named parameters; returns parameters and residual."""
        use = np.ones(len(self.sigma), bool)
        if not self.arm and not self.slides: use[1:] = False
        wt, par = 1 / self.sigma[use], dict(start)
        f0, lam = self.predict(kin, par), 1e-4
        for _ in range(rounds):
            h = {k: 1e-3 * max(abs(par.get(k, DEFAULT.get(k, 0.0))), SCALE.get(k, 0.02)) for k in free}
            J = np.stack([((self.predict(kin, par | {k: par.get(k, DEFAULT.get(k, 0.0)) + h[k]}) - f0)[:, use] * wt).ravel() for k in free], 1)
            r = ((y - f0)[:, use] * wt).ravel()
            H, g = J.T @ J, J.T @ r
            for _ in range(5):
                dx, new = np.linalg.solve(H + lam * np.diag(np.diag(H) + 1e-9), g), dict(par)
                for k, x in zip(free, dx):
                    old = par.get(k, DEFAULT.get(k, 0.0))
                    new[k] = old + x * h[k]
                    if k in POSITIVE: new[k] = float(np.clip(new[k], 0.2 * old, 5 * old + 1e-9))
                f1 = self.predict(kin, new)
                if np.sum(((y - f1)[:, use] * wt) ** 2) < r @ r: break
                lam = max(lam * 10, 1e-3)
            else: break
            gain = 1 - np.sum(((y - f1)[:, use] * wt) ** 2) / (r @ r + 1e-30)
            par, f0, lam = new, f1, lam * 0.2
            if gain < 1e-4: break
        return par, y - f0

    def free_of(self, names: list[str]) -> list[str]:
        keys = list(self.free)
        for h in names:
            keys += [k for k in EFFECTS[h].free if k not in keys and (self.arm or k not in ("b3", "b4", "b5", "k3", "k4", "k5"))]
            if h == "relaxation" and self.truth(self.strength).get("r2"): keys += ["r2"]
        if not self.arm and not self.slides: keys = [k for k in keys if k not in ("b1", "b2", "k1", "k2")]
        return [k for k in keys if k not in ("sat", "step")]

    def mask(self, kin: Kin, par: dict, channel: str) -> np.ndarray:
        if channel in "fm": return np.ones(len(kin.t), bool)
        return np.abs(contact(kin, par, self.law, self.profile)[:, 0]) > 0.02

    def assess(self, strength: list[float], rounds: int = 4) -> None:
        """Effect and left-over rms of every hidden effect at these strengths."""
        self.strength = strength
        full = self.truth(strength)
        y, self.y = self.predict(self.kf, full), self.measure(full)
        clean = self.measure(full, step=False)
        left = clean - self.predict(self.kl, full, late=False)
        self.effect, self.left, self.read = [], [], []
        for i, d in enumerate(self.defs):
            name = self.hidden[i] if self.hidden else ""
            rest = [h for h in self.hidden if h != name]
            _, r = self.fit(self.kf, y, self.truth(strength, without=name), self.free_of(rest), rounds)
            mf, ml = self.mask(self.kf, full, d.channel), self.mask(self.kl, full, d.channel)
            self.effect.append(project(self.kf, r, d.channel, mf))
            self.left.append(project(self.kl, left, d.channel, ml))
            self.read.append(project(self.kl, self.y, d.channel, ml))
        if not self.defs:
            m = self.mask(self.kl, full, "n")
            self.effect, self.left, self.read = [0.0], [project(self.kl, left, "f", m)], [project(self.kl, self.y, "f", m)]

    def run(self) -> bool:
        """Bring the hidden effects to a fitting strength; false if that fails."""
        lo, hi = {"single": (3.5, 9), "pair": (3.5, 8), "outside": (6, 14), "weak": (0.42, 0.85)}.get(self.group, (1, 1))
        want, share = self.rng.uniform(lo, hi, len(self.defs)), {"single": 0.04, "pair": 0.04, "outside": 0.085}.get(self.group, 0.0)
        a = np.array([np.sqrt(d.lo * d.hi) for d in self.defs])
        for _ in range(6):
            self.assess([float(x) for x in a])
            if self.group == "none" or self.group == "unexcited" and self.effect[0] < 0.25 * self.left[0]: break
            goal = np.array([max(w * l, share * r * (4 if d.channel == "m" else 1)) for w, l, r, d in zip(want, self.left, self.read, self.defs)])
            ratio = goal / np.maximum(self.effect, 1e-9)
            if self.group == "unexcited": want = np.array([0.15])
            if self.group in ("weak", "unexcited"): ratio = want * self.left / np.maximum(self.effect, 1e-12)
            if np.all((ratio > 0.8) & (ratio < 1.25)): break
            new = np.array([np.clip(x * np.clip(r, 0.2, 4), d.lo * (0.05 if self.group in ("weak", "unexcited") else 1), d.hi) for x, r, d in zip(a, ratio, self.defs)])
            if np.allclose(new, a): break
            a = new
        e, l, r = np.array(self.effect), np.array(self.left), np.array(self.read)
        rules = {"single": (2.6, 1e9, 0.02), "pair": (2.6, 1e9, 0.02), "outside": (4.1, 1e9, 0.062), "weak": (0.3, 1, 0), "unexcited": (0, 0.3, 0)}
        low, high, part = rules.get(self.group, (0, 1, 0))
        return bool(np.all((e >= low * l) & (e <= high * l) & (e >= part * r)))

    def near(self) -> tuple[list[str], dict]:
        """Rivals that fit the truth as well (leave less than half of the noise and nuisances), and what each leaves."""
        if self.group == "unexcited" or not self.defs: return [], {}
        full = self.truth(self.strength)
        y = self.predict(self.kf, full)
        near, leaves = [], {}
        for i, (name, d) in enumerate(zip(self.hidden or [""], self.defs)):
            for rival in d.rivals:
                known = set(self.model) | set(self.hidden) | ({"viscous-damping"} if self.base == "kelvin-voigt" else set())
                known |= {"relaxation"} if self.base == "zener" else {"hunt-crossley-damping", "hertz-exponent"} if self.base == "hunt-crossley" else set()
                if rival in known or (not self.arm and EFFECTS[rival].kinds == "w") or (EFFECTS[rival].channel == "t" and not self.slides):
                    continue
                rest = [h for h in self.hidden if h != name]
                free, start = self.free_of(rest + [rival]), self.truth(self.strength, without=name)
                start |= {k: 0.3 * SCALE.get(k, 0.02) for k in EFFECTS[rival].free if k in free and k not in start and not k.startswith(("c", "m")) and k not in DEFAULT}
                if rival == "presliding": start["ell"] = 6e-4
                _, r = self.fit(self.kf, y, start, free, 8)
                leaves[rival] = r5(min(project(self.kf, r, d.channel, self.mask(self.kf, full, d.channel)), self.effect[i]))
                if leaves[rival] < (0.5 if self.group != "weak" else 0.3) * self.left[i] and rival not in near:
                    near.append(rival)
        return near, leaves

    def check(self) -> dict:
        """Refit of the true model to the log itself; residual rms over contact and, for arms, the static weight in the air."""
        full, free = self.truth(self.strength), [k for k in self.free_of(self.hidden)]
        got, r = self.fit(self.kl, self.y, full, free, 3)
        channel = self.defs[0].channel if self.defs else "f"
        m = self.mask(self.kl, full, channel if self.defs else "n")
        return {"refit_rms": r5(project(self.kl, r, channel, m)), "recovered": {k: r5(got[k]) for k in free if k in got}}

    # -- files
    def write(self, folder: File) -> None:
        folder.mkdir(parents=True, exist_ok=True)
        cols: dict[str, np.ndarray] = {"t": self.tl}
        if self.arm:
            cols |= {f"q{i + 1}": self.q[:, i] for i in range(7)}
            if not self.nuis["dq_missing"]: cols |= {f"dq{i + 1}": self.dq[:, i] for i in range(7)}
            cols |= {k: self.y[:, i] for i, k in enumerate("fx fy fz tx ty tz".split())}
        else:
            cols |= {"depth": self.kl.d, "normal_force": self.y[:, 0]}
            if self.nuis["has_rate"]: cols["depth_rate"] = self.rate_log
            if self.slides:
                cols |= {"slip1": self.kl.s[:, 0], "slip2": self.kl.s[:, 1], "tangential_force1": self.y[:, 1], "tangential_force2": self.y[:, 2]}
        if self.rng.random() < 0.6: cols["phase"] = self.path.phase(self.tl)
        form, table = str(self.rng.choice(["parquet"] * 8 + ["csv", "npz"])), pa.table(cols)
        if form == "csv": pa.csv.write_csv(table, folder / "log.csv")
        elif form == "npz":
            np.savez_compressed(folder / "log.npz", **{k: np.asarray(v, dtype=str if k == "phase" else float) for k, v in cols.items()})
        else: pq.write_table(table, folder / "log.parquet", compression="zstd")
        if self.arm and not self.nuis["dq_missing"]:
            pq.write_table(table.drop_columns([f"dq{i + 1}" for i in range(7)]), folder / "log_nodq.parquet", compression="zstd")
        arr = lambda v, n=5: "[" + ", ".join(f"{x:.{n}g}" for x in v) + "]"
        text = "# material tester: t, depth, forces; no robot\n"
        if self.arm:
            text = ('[robot]\nmodel = "lwr4plus"\nsensor_frame = "ft_sensor"\ntip_frame = "tool_tip"\ngravity = [0.0, 0.0, -9.81]\n\n'
                    f"[tool]\nmass = {self.mass:.6g}\ncom = {arr(self.com, 6)}\n\n[surface]\npoint = {arr(self.point, 8)}\nnormal = [0, 0, 1]\ntangent = [1, 0, 0]\n")
            if "saturation" not in self.hidden and self.rng.random() < 0.5:
                text += f"\n[sensor]\nrange = [40, 40, 120, 2, 2, 2]\nnoise = {arr(self.sigma, 3)}\n"
        (folder / "rig.toml").write_text(text)

    def entry(self, name: str) -> dict:
        near, leaves = self.near()
        worst = int(np.argmin(np.array(self.effect) / np.maximum(self.left, 1e-12)))
        if self.out: near = [r for r in self.out.rivals if self.arm or EFFECTS[r].kinds != "w" or not leaves]
        unit = lambda d: "N·m" if d and d.channel in "mz" else "N"
        full = self.truth(self.strength)
        notes = (f"{'outside: ' + self.spec['outside'] + '. ' if self.out else ''}FE geometry {self.law.name} (exponent {self.law.n:.3f}, off a power law "
                 f"{100 * self.law.misfit:.2f} %); friction {['Prandtl', 'Dahl', 'LuGre', 'elasto-plastic'][self.par['fric']]}; {self.rate:g} Hz, {self.path.t:.0f} s")
        out = {"case": name, "kind": self.spec["kind"], "group": self.group, "model": ",".join(self.model), "hidden": list(self.hidden),
               "true_model": ",".join(self.model + self.hidden), "near": near, "effect_rms": r5(self.effect[worst]), "left_rms": r5(self.left[worst]),
               "unit": unit(self.defs[worst] if self.defs else None), "readings_rms": r5(self.read[worst])}
        if len(self.effect) > 1:
            out["each"] = [{"effect": h, "effect_rms": r5(e), "left_rms": r5(l), "unit": unit(d)} for h, e, l, d in zip(self.hidden, self.effect, self.left, self.defs)]
        return out | {"rivals_leave": leaves, "nuisances": self.nuis | {"noise_behind_clip": self.noise_behind}, "notes": notes} | self.check() | {
            "parameters": {k: r5(float(v)) for k, v in full.items() if k != "fric"} | {"stiffness": r5(full["F0"] / self.law.d0**self.law.n), "exponent": r5(self.law.n)}}

# ---------------------------------------------------------------- the set
class World:
    def __init__(self, urdf: str):
        self.laws, self.profiles, self.arm = fem.build(), fem.profiles(), Arm(urdf)
        s = self.laws["stepped"]
        x = np.linspace(0, s.dmax, len(s.table))
        kink = lambda x, a, k, b, w: a * x + k * w * np.logaddexp(0, (x - b) / w)
        (a, k, b, w), _ = curve_fit(kink, x, s.table, p0=(300, 300, 0.6 * s.dmax, 1e-4))
        self.collar = (k / a, b, float(np.clip(abs(w), 2e-5, 1.5e-4)))      # rounding of the collar's kink [m]
        self.collar_misfit = rms(s.table - kink(x, a, k, b, w)) / rms(s.table)

def plan(seed: int) -> list[dict]:
    """48 specifications: groups, kinds, hidden effects."""
    rng, names = np.random.default_rng([seed, 7]), list(EFFECTS)
    only_w = [n for n in names if EFFECTS[n].kinds == "w"]
    keep, rest = list(rng.choice(only_w, 5, replace=False)), list(rng.permutation([n for n in names if n not in only_w]))[:17]
    spec = [dict(kind="wrench", group="single", hidden=[str(n)]) for n in keep]
    spec += [dict(kind="wrench" if i < 7 else "tester", group="single", hidden=[str(n)]) for i, n in enumerate(rest)]
    spec += [dict(kind="wrench" if i < 5 else "tester", group="none", hidden=[]) for i in range(9)]
    for kind, count in (("w", 4), ("t", 3)):
        pool = [p for p in PAIRS if p[0] == kind]
        spec += [dict(kind="wrench" if kind == "w" else "tester", group="pair", hidden=list(pool[i][1:])) for i in rng.permutation(len(pool))[:count]]
    outs = list(rng.permutation(list(OUTSIDE)))[:6]
    spec += [dict(kind="wrench" if OUTSIDE[o][0].kinds == "w" or (OUTSIDE[o][0].kinds == "wt" and i % 2 == 0) else "tester", group="outside", hidden=[], outside=str(o))
             for i, o in enumerate(outs)]
    weak = rng.permutation(["relaxation", "viscous-friction", "friction-anisotropy", "stribeck-friction", "hysteresis", "viscous-damping", "surface-offset"])
    spec += [dict(kind=k, group="weak", hidden=[str(h)]) for k, h in zip(("wrench", "tester"), weak)]
    for kind in ("w", "t"):
        pool = [u for u in UNEXCITED if u[0] == kind]
        u = pool[rng.integers(len(pool))]
        spec.append(dict(kind="wrench" if kind == "w" else "tester", group="unexcited", hidden=[u[1]], style=u[2]))
    drifts = [s for s in spec if s["group"] == "single" and s["hidden"][0] in ("stiffness-drift", "sensor-drift")]
    long = drifts[0] if drifts else [s for s in spec if s["group"] == "none"][-1]
    long |= dict(length=float(rng.uniform(125, 200)), rate=float(rng.choice([50, 100, 200])))
    fast = [s for s in spec if s["kind"] == "tester" and s["group"] == "none"][0]
    fast |= dict(rate=2000.0)
    return [spec[i] for i in rng.permutation(len(spec))]

def main() -> None:
    parse = argparse.ArgumentParser(description=__doc__)
    parse.add_argument("--seed", type=int, required=True)
    parse.add_argument("--out", type=File, required=True)
    parse.add_argument("--only", type=int)
    parse.add_argument("--urdf", default=str(File(__file__).resolve().parents[3] / "urdf" / "lwr4plus.urdf"))
    args = parse.parse_args()
    world, truth = World(args.urdf), []
    for i, spec in enumerate(plan(args.seed)):
        if args.only is not None and i != args.only: continue
        name = f"case_{i:03d}"
        for attempt in range(12):
            try:
                case = Case(world, spec, np.random.default_rng([args.seed, i, attempt]))
            except ValueError as error:
                print(name, "again:", error)
                continue
            if case.run(): break
            print(name, "again:", spec["hidden"] or spec.get("outside"), np.round(case.effect, 4), np.round(case.left, 4), case.strength)
        else:
            print(name, "GIVEN UP")
            continue
        case.write(args.out / name)
        truth.append(case.entry(name))
        e = truth[-1]
        print(f"{name} {e['kind']:7s} {e['group']:9s} {e['model']:42s} {','.join(e['hidden']) or spec.get('outside', '-'):40s} effect {e['effect_rms']:.4f} "
              f"left {e['left_rms']:.4f} refit {e['refit_rms']:.4f} read {e['readings_rms']:.2f} {e['unit']} near {e['near']} {case.path.t:.0f}s", flush=True)
    args.out.mkdir(parents=True, exist_ok=True)
    (args.out / "truth.json").write_text(json.dumps(truth, indent=1, ensure_ascii=False))

if __name__ == "__main__": main()
