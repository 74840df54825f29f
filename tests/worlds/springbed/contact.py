"""Wrench and tester cases: commands, world physics, readings, checks by an own least-squares inverse."""
from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from scipy.ndimage import gaussian_filter1d
from scipy.spatial.transform import Rotation as Rot

import arm as am
import bed
import instruments as ins

DT = 5e-4
TORQUE = {"tool-com", "tip-offset", "tool-inertia"}
BASE = {"hooke": ["K"], "kelvin-voigt": ["K", "C"], "hertz": ["K"], "hunt-crossley": ["K", "LAM"], "zener": ["K", "R1", "T1"], "none": []}
FIT = BASE | {
    "hertz-exponent": ["N"], "viscous-damping": ["C"], "hunt-crossley-damping": ["LAM"], "relaxation": ["R1", "T1"], "hysteresis": ["HA", "HL"],
    "stress-softening": ["SR", "SL"], "adhesion": ["FA"], "stiffening-layer": ["KB", "DB"], "surface-offset": ["Z0"], "stiffness-drift": ["ALPHA"],
    "stiffness-inhomogeneity": ["PA"], "coulomb-friction": ["MU"], "viscous-friction": ["CV"], "stribeck-friction": ["DMU", "VS"], "presliding": ["LB"],
    "friction-rounding": ["VR"], "load-dependent-friction": ["PEXP"], "friction-anisotropy": ["ANI"], "structural-compliance": ["CC"],
    "tool-mass": ["dm"], "tool-com": ["cx", "cy", "cz"], "tool-inertia": ["ix", "iy", "iz"], "tip-offset": ["ox", "oy", "oz"],
    "sensor-bias": [f"b{i}" for i in range(6)], "sensor-drift": [f"d{i}" for i in range(6)], "sensor-crosstalk": [f"x{i}" for i in range(6)],
    "sensor-misalignment": ["m0", "m1", "m2"], "sensor-gain": ["gain"], "sensor-lag": ["lag"], "time-offset": ["toff"], "saturation": ["sat"],
    "quantization": [], "mains-hum": []}
SCALE = dict(K=100, N=.1, C=5, LAM=1, R1=.2, T1=.5, HA=.2, HL=2e-4, SR=.1, SL=5e-4, FA=.1, KB=200, DB=3e-4, Z0=1e-4, ALPHA=.1, PA=.1, MU=.1, CV=3, DMU=.1,
             VS=4e-3, LB=2e-4, VR=1e-3, PEXP=.1, ANI=.1, CC=2e-5, gain=.05, lag=5e-3, toff=5e-3, dm=.02, sat=1.0)
ALTS = {"viscous-damping": ["hunt-crossley-damping", "relaxation"], "hunt-crossley-damping": ["viscous-damping", "relaxation"],
        "hertz-exponent": ["stiffening-layer"], "stiffening-layer": ["hertz-exponent"], "structural-compliance": ["hertz-exponent", "surface-offset"],
        "surface-offset": ["hertz-exponent", "stiffening-layer"], "stiffness-drift": ["stress-softening"], "stress-softening": ["stiffness-drift", "hysteresis"],
        "relaxation": ["hysteresis"], "hysteresis": ["relaxation", "stress-softening"], "adhesion": ["surface-offset"],
        "viscous-friction": ["stribeck-friction"], "stribeck-friction": ["viscous-friction"], "presliding": ["friction-rounding", "structural-compliance"],
        "friction-rounding": ["presliding", "viscous-friction"], "tool-mass": ["sensor-gain"], "sensor-gain": ["tool-mass", "sensor-bias"], "tool-com": ["sensor-misalignment"],
        "sensor-lag": ["time-offset"], "time-offset": ["sensor-lag"], "sensor-crosstalk": ["sensor-misalignment"],
        "sensor-misalignment": ["sensor-crosstalk"], "sensor-drift": ["sensor-bias"], "tip-offset": ["sensor-misalignment"], "tool-inertia": ["sensor-lag"],
        "sensor-bias": ["tool-mass"]}
AIR = {"tool-mass", "tool-com", "tool-inertia", "sensor-bias", "sensor-drift", "sensor-gain", "tip-offset", "sensor-misalignment"}


@dataclass
class Kin:
    """Motion of the tool: bed-frame tip position/velocity [m], rotation, angular velocity/acceleration, acceleration in the base frame."""
    t: np.ndarray
    X: np.ndarray
    V: np.ndarray
    R: np.ndarray = field(default_factory=lambda: np.zeros(0))
    w: np.ndarray = field(default_factory=lambda: np.zeros(0))
    al: np.ndarray = field(default_factory=lambda: np.zeros(0))
    a: np.ndarray = field(default_factory=lambda: np.zeros(0))


@dataclass
class Tool:
    """Tool and frames: mass [kg], com [m], gravity (base) [m/s2], bed axes Rs (columns t1, t2, n)."""
    m: float
    com: np.ndarray
    g: np.ndarray
    Rs: np.ndarray


def readings(F: np.ndarray, k: Kin, tool: Tool, s: dict, tester: bool) -> np.ndarray:
    """Sensor readings from forces on the tool F (bed frame) and sensor parameters s: (n,6) wrench, or (n,2) Fn, Ft1 for a tester."""
    if tester:
        f = np.stack([F[:, 2], F[:, 0]], 1)
    else:
        m, com = tool.m + s.get("dm", 0), tool.com + np.array([s.get(c, 0) for c in ("cx", "cy", "cz")])
        tip = np.array([0, 0, 0.1]) + np.array([s.get(c, 0) for c in ("ox", "oy", "oz")])
        r = np.einsum("nij,j->ni", k.R, com - np.array([0, 0, 0.1]))
        ac = k.a + np.cross(k.al, r) + np.cross(k.w, np.cross(k.w, r))
        ft = np.einsum("nji,nj->ni", k.R, m * (tool.g - ac))
        fc = np.einsum("nji,nj->ni", k.R, F @ tool.Rs.T)
        tau = np.cross(com, ft) + np.cross(tip, fc)
        if any(c in s for c in ("ix", "iy", "iz")):
            I = np.array([s.get(c, 0) for c in ("ix", "iy", "iz")])
            wl, al = np.einsum("nji,nj->ni", k.R, k.w), np.einsum("nji,nj->ni", k.R, k.al)
            tau -= I * al + np.cross(wl, I * wl)
        f = np.hstack([ft + fc, tau])
    n = f.shape[1]
    if "m0" in s and not tester:
        Q = Rot.from_rotvec([s["m0"], s["m1"], s["m2"]]).as_matrix()
        f = np.hstack([f[:, :3] @ Q, f[:, 3:] @ Q])
    if "x0" in s and not tester:
        f = f.copy()
        f[:, :3] = f[:, :3] @ (np.eye(3) + np.array([[0, s["x0"], s["x1"]], [s["x2"], 0, s["x3"]], [s["x4"], s["x5"], 0]]))
    f = f * (1 + s.get("gain", 0))
    if s.get("lag", 0) > 1e-5:
        e = np.exp(-np.diff(k.t) / s["lag"])
        g, y = f.copy(), f[0].copy()
        for i in range(1, len(f)):
            y = f[i] - (f[i] - f[i - 1]) * s["lag"] * (1 - e[i - 1]) / (k.t[i] - k.t[i - 1]) - (f[i - 1] - y) * e[i - 1]
            g[i] = y
        f = g
    if s.get("toff", 0):
        f = np.stack([np.interp(k.t - s["toff"], k.t, f[:, j]) for j in range(n)], 1)
    f = f + np.array([s.get(f"b{i}", 0) for i in range(n)]) + np.outer(k.t / 60, [s.get(f"d{i}", 0) for i in range(n)])
    if "sat" in s:
        f[:, :3] = np.clip(f[:, :3], -s["sat"], s["sat"])
    return f


def predict(par: dict, k: Kin, tool: Tool, fixed: np.ndarray, contact: bool, tester: bool) -> np.ndarray:
    """Catalogue prediction: laws' parameters in `par` over neutral `fixed`."""
    F = np.zeros_like(k.X)
    if contact:
        P = fixed.copy()
        for n, v in par.items():
            if n in bed.IX:
                P[bed.IX[n]] = v
        for n, lo in (("HL", 2e-5), ("SL", 5e-5), ("T1", 5e-3), ("LB", 1e-5), ("VS", 3e-4), ("VR", 1e-5), ("K", 1), ("N", .7), ("R1", 0), ("SR", 0)):
            P[bed.IX[n]] = max(P[bed.IX[n]], lo)
        X, V = k.X, k.V
        if "ox" in par:
            d = np.einsum("nij,j->ni", k.R, np.array([par["ox"], par["oy"], par["oz"]]))
            X, V = X + d @ tool.Rs, V + np.cross(k.w, d) @ tool.Rs
        F = bed.replay(P, k.t, X, V)
    return readings(F, k, tool, par, tester)


def fit(names: list[str], start: dict, y: np.ndarray, k: Kin, tool: Tool, fixed: np.ndarray, wt: np.ndarray, contact: bool, tester: bool, iters: int = 7) -> tuple[dict, np.ndarray]:
    """Levenberg-Marquardt over the parameters that `names` free, from `start`; returns parameters and residual (n, channels)."""
    keys = list(dict.fromkeys(p for n in names for p in FIT[n]))
    par = {q: start.get(q, {"T1": .5, "HL": 3e-4, "SL": 1e-3, "DB": 2e-3, "VS": 8e-3, "LB": 1e-4, "VR": 2e-3, "lag": 2e-3, "sat": 1e3, "N": fixed[bed.N]}.get(q, 0.0)) for q in keys}
    sc = np.array([SCALE.get(q, 1e-2 if q[0] in "bdx" or q[0] == "m" else (1e-4 if q[0] == "i" else 1e-3)) for q in keys])
    pr = lambda v: predict(dict(zip(keys, v)), k, tool, fixed, contact, tester)
    v = np.array([par[q] for q in keys])
    r = (y - pr(v)) * wt
    lam, cost = 1e-4, np.sum(r * r)
    for _ in range(iters if keys else 0):
        r0 = pr(v)
        J = np.stack([((pr(v + 2e-2 * sc[i] * e) - r0) * wt).ravel() / 2e-2 for i, e in enumerate(np.eye(len(keys)))], 1)
        H, g = J.T @ J, J.T @ r.ravel()
        ok = False
        for _ in range(5):
            stp = np.linalg.solve(H + lam * np.diag(np.diag(H) + 1e-9 * (1 + H.max())), g)
            vn = v + np.clip(stp, -8, 8) * sc
            rn = (y - pr(vn)) * wt
            cn = np.sum(rn * rn)
            if cn < cost:
                ok, drop = True, (cost - cn) / cost
                v, r, cost, lam = vn, rn, cn, max(lam / 10, 1e-9)
                break
            lam = max(lam, 1e-6) * 10
        if not ok or drop < 1e-5:
            break
    return dict(zip(keys, v)), r / np.where(wt > 0, wt, 1)


class Path6:
    """Command builder: piecewise linear tip position (bed frame) [m] and tool angles (about t1, t2, tool z) [rad]."""

    def __init__(self, rng: np.random.Generator, z0: float):
        self.rng, self.t, self.x, self.ph = rng, [0.0], [np.array([0, 0, z0, 0, 0, 0.0])], ["free"]
        self.shakes: list[tuple[float, float, float, float, float]] = []

    def to(self, dur: float, phase: str, **kw: float) -> None:
        """Move over dur [s] to the given coordinates (x, y, z, a, b, c)."""
        n = self.x[-1].copy()
        for c, v in kw.items():
            n["xyzabc".index(c)] = v
        self.t.append(self.t[-1] + max(dur, 0.02))
        self.x.append(n)
        self.ph.append(phase)

    def sample(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Time, smoothed command (n,6), phase."""
        t = np.arange(0, self.t[-1], DT)
        c = np.stack([np.interp(t, self.t, np.array(self.x)[:, j]) for j in range(6)], 1)
        c[:, :3] = gaussian_filter1d(c[:, :3], 0.015 / DT, axis=0, mode="nearest")
        c[:, 3:] = gaussian_filter1d(c[:, 3:], 0.10 / DT, axis=0, mode="nearest")
        for t0, t1, f, lin, ang in self.shakes:
            win = np.clip(np.minimum(t - t0, t1 - t) / 0.3, 0, 1)
            win = win * win * (3 - 2 * win)
            for j in range(3):
                c[:, j] += win * lin * np.sin(2 * np.pi * f * (1 + 0.23 * j) * (t - t0))
                c[:, 3 + j] += win * ang * np.sin(2 * np.pi * f * (1 + 0.31 * j) * (t - t0) + j)
        idx = np.clip(np.searchsorted(self.t, t, side="left"), 0, len(self.ph) - 1)
        return t, c, np.array(self.ph)[idx]


def plan_motion(rng: np.random.Generator, names: set[str], hid: set[str], depth: float, load, Kz: float, contact: bool, tester: bool, one_way: str = "") -> Path6:
    """Pokes with holds, slides along both tangents in both directions, free motion; the parts that the effects need are there."""
    p = Path6(rng, 0.006 if tester else 0.02)
    zc = lambda d: -(d + load(d) / Kz)
    slide = contact and bool((names | hid) & {"coulomb-friction", "stiffness-inhomogeneity"})
    p.to(rng.uniform(.6, 1.5), "free")
    big = bool(hid & AIR) or not contact
    if not tester:
        p.to(.7, "free", z=.05)
        A = 0.55 if big else rng.choice([0.08, 0.2])
        seq = [(A, 0, 0), (0, A, .9), (-A, -A / 2, -.9), (A / 2, -A, .4), (0, 0, 0)] if big else [(A, A, .3), (-A, 0, -.3), (0, 0, 0)]
        for rep in range(1 if contact else 2):
            for a, b, c in seq:
                p.to(rng.uniform(.9, 1.4), "free", a=a * (1 - .3 * rep), b=b, c=c)
                p.to(rng.uniform(.2, .6), "free")
        if "tool-inertia" in hid and one_way != "slow" or not contact and one_way != "slow" or "sensor-lag" in hid or "time-offset" in hid:
            inert = "tool-inertia" in hid
            t0 = p.t[-1]
            p.to(5.0 if inert else 3.5, "free")
            p.shakes.append((t0, p.t[-1], rng.uniform(3, 4) if inert else rng.uniform(2, 3), .003, 0.05 if inert else .03))
    if contact:
        pokes = 3 if slide and not hid & {"adhesion", "stiffening-layer", "hertz-exponent", "stress-softening"} else int(rng.integers(6, 9))
        if hid & {"stiffness-drift", "sensor-drift"}:
            pokes += 6
        ds = np.linspace(.35, 1.0, pokes)[rng.permutation(pokes)]
        if hid & {"stress-softening"}:
            ds = np.sort(ds)
            ds[1::3] = .45
        vs = 10 ** rng.uniform(np.log10(.008), np.log10(.05), pokes)
        vs[:3] = [.006, .02, .06]
        spread = 0.0 if hid & {"stress-softening", "stiffness-drift"} else .02
        for i in range(pokes):
            x, y = rng.uniform(-spread, spread, 2)
            tl = rng.uniform(-.25, .25, 2) if "tip-offset" in hid else (0, 0)
            p.to(.7, "free", x=x, y=y, z=.008 if not tester else .005, a=tl[0], b=tl[1])
            p.to(.3, "approach", z=.003)
            d = depth * ds[i]
            p.to((.003 - zc(d)) / vs[i], "poke", z=zc(d))
            p.to(rng.uniform(.4, 2.5 if {"relaxation", "zener"} & names else 1.2), "hold")
            if rng.random() < .4:
                p.to(.5 * depth / vs[i] + .1, "poke", z=zc(.6 * d))
                p.to(.4, "hold")
            up = vs[i] if "adhesion" not in hid else .006
            p.to((.003 - zc(d)) / up, "retract", z=.003)
        if slide:
            dl = [1.0, .5] if one_way != "load" else [.7, .7]
            for d in (dl if not hid & {"load-dependent-friction", "stribeck-friction", "viscous-friction"} else [dl[0], dl[1], np.mean(dl)]):
                p.to(.6, "free", x=-.02 if tester else 0, y=0, z=.004, a=0, b=0)
                p.to(.4, "poke", z=zc(depth * d))
                p.to(.2, "hold")
                sp = ([.006, .015, .05] if d == dl[0] else [.015, .05]) if one_way != "stribeck" else [.03, .05, .06]
                for v in sp:
                    v = v * rng.uniform(.8, 1.25)
                    L = .004 if v < .01 else (.012 if v < .025 else .025)
                    for ax in (["x"] if tester or one_way == "aniso" else ["x", "y"]):
                        tr = [(rng.uniform(-.06, .06), rng.uniform(-.06, .06)) for _ in range(2)] if "tip-offset" in hid else [(0, 0)] * 2
                        p.to(max(L / 2 / v, .05), "slide", **{ax: L / 2})
                        p.to(L / v, "slide", **{ax: -L / 2})
                        p.to(.06, "slide")
                        p.to(max(L / v, .05), "slide", a=tr[0][0], b=tr[0][1], **{ax: L / 2})
                        p.to(max(L / 2 / v, .05), "slide", **{ax: 0})
                    if rng.random() < .5 and "presliding" in names | hid:
                        for _ in range(3):
                            p.to(.4, "slide", x=.001)
                            p.to(.4, "slide", x=-.001)
                        p.to(.2, "slide", x=0)
                p.to(.3, "retract", z=.006)
    p.to(.6, "free", z=.02 if not tester else .006)
    p.to(rng.uniform(.5, 1.0), "free")
    return p


def set_effect(P: np.ndarray, s: dict, name: str, c: float, rng: np.random.Generator, depth: float, flat: bool) -> None:
    """Put the effect `name` with strength c (1 = typical) in law parameters P or sensor parameters s."""
    u, sg, ix = rng.uniform, rng.choice([-1.0, 1.0]), bed.IX
    F = P[bed.K] * depth ** P[bed.N]
    law = {"viscous-damping": dict(C=u(25, 45) * c), "hunt-crossley-damping": dict(LAM=u(4, 7) * c), "relaxation": dict(R1=u(.4, .7) * c, T1=u(.25, 1.2)),
           "hysteresis": dict(HA=u(.12, .2) * F * c, HL=u(2e-4, 5e-4)), "stress-softening": dict(SR=min(u(.25, .4) * c, .8), SL=u(.2, .5) * depth),
           "adhesion": dict(FA=u(.5, .9) * c, AL=u(4e-4, 1e-3)), "stiffening-layer": dict(KB=u(.7, 1.3) * F / depth * c, DB=u(.4, .6) * depth),
           "surface-offset": dict(Z0=sg * u(2e-4, 4e-4) * c), "stiffness-drift": dict(ALPHA=sg * u(.2, .35) * min(c, 2)),
           "stiffness-inhomogeneity": dict(PT=rng.integers(1, 4), PA=u(.25, .45) * c, PX=u(-.004, .004), PW=u(.004, .009)),
           "coulomb-friction": dict(MU=u(.35, .7), LB=1e-4), "viscous-friction": dict(CV=u(9, 16) * c), "stribeck-friction": dict(DMU=u(.2, .3) * c, VS=u(.008, .014)),
           "presliding": dict(LB=u(1e-3, 2e-3) * c, MODE=rng.choice([1, 3])), "friction-rounding": dict(VR=u(.004, .008) * c, MODE=0), "load-dependent-friction": dict(PEXP=-u(.2, .33) * c),
           "friction-anisotropy": dict(ANI=sg * u(.15, .25) * c), "structural-compliance": dict(CC=u(.12, .2) * depth / F * c)}.get(name)
    if name == "hertz-exponent":
        e = u(.25, .45) * c
        law = dict(N=P[bed.N] + e, K=P[bed.K] * depth ** -e)
    if name == "stiffness-inhomogeneity" and law["PT"] == 3:
        law["PW"] = .02
    if law:
        for k, v in law.items():
            P[ix[k]] = v
        return
    d3 = lambda a, b: rng.choice([-1, 1], 3) * u(a, b, 3)
    s.update({"tool-mass": lambda: dict(dm=u(.03, .06) * c), "tool-com": lambda: dict(zip(("cx", "cy", "cz"), d3(.003, .007) * c)),
              "tool-inertia": lambda: dict(zip(("ix", "iy", "iz"), np.array([1, 1, .5]) * u(6e-4, 1e-3, 3) * c)),
              "tip-offset": lambda: dict(zip(("ox", "oy", "oz"), d3(8e-4, 2e-3) * c * np.array([1, 1, .1]))),
              "sensor-bias": lambda: {f"b{i}": v for i, v in enumerate(np.r_[d3(.2, .5), d3(.004, .01)] * c)},
              "sensor-drift": lambda: {f"d{i}": v for i, v in enumerate(np.r_[d3(.5, 1.0), d3(.005, .02)] * c)},
              "sensor-crosstalk": lambda: {f"x{i}": v for i, v in enumerate(rng.choice([-1, 1], 6) * u(.03, .09, 6) * c)},
              "sensor-misalignment": lambda: {f"m{i}": v for i, v in enumerate(d3(.05, .1) * c)}, "sensor-gain": lambda: dict(gain=sg * u(.1, .16) * c),
              "sensor-lag": lambda: dict(lag=u(.012, .02) * c), "time-offset": lambda: dict(toff=sg * u(.012, .02) * c), "saturation": lambda: dict(sat=max(F, .5) * u(.6, .75)),
              "quantization": lambda: dict(quant=u(.25, .4) * c), "mains-hum": lambda: dict(hum=u(.15, .25) * c)}[name]())


def run_case(seed: list[int], spec: dict, A: am.Arm, folder: Path | None, amp: float = 1.0) -> dict:
    """Simulate, write (folder not None) and judge one wrench or tester case. Returns a truth record."""
    rng = np.random.default_rng(seed)
    tester, group, hidden, model, out = spec["kind"] == "tester", spec["group"], spec["hidden"], list(spec["model"]), spec.get("outside")
    base, contact, nu = model[0], model[0] != "none", {}
    names, hid = set(model) | set(hidden), set(hidden)
    flat = base not in ("hertz", "hunt-crossley")
    depth = rng.uniform(.0025, .0045)
    Fmax = rng.uniform(5, 11) if group != "none" else rng.uniform(6, 12)
    n0 = 1.0 if flat else 1.5
    P = bed.params(K=Fmax / depth ** n0, N=n0, MODE=float(rng.choice([1, 2, 3, 4], p=[.4, .2, .3, .1] if group in ("single", "none", "pair") else [.6, 0, .4, 0])), NLS=rng.uniform(-2, 2))
    s: dict = {}
    if base == "kelvin-voigt":
        P[bed.C] = rng.uniform(5, 15)
    if base == "hunt-crossley":
        P[bed.LAM] = rng.uniform(2, 5)
    if base == "zener":
        P[bed.R1], P[bed.T1] = rng.uniform(.25, .5), rng.uniform(.2, .8)
    if tester and "coulomb-friction" in names and group in ("none", "pair") and not hid & {"presliding", "friction-rounding", "stribeck-friction"}:
        P[bed.MODE], P[bed.RSA], P[bed.RSB], P[bed.DC] = 5, .002, .0025, 1e-5
        nu["friction_law"] = "rate-and-state, a=0.002 b=0.0025 (weak)"
    else:
        nu["friction_law"] = ["rounded", "Dahl", "Prandtl", "LuGre", "elasto-plastic (Dupont)"][int(P[bed.MODE])]
    for nme in model[1:]:
        set_effect(P, s, nme, .8, rng, depth, flat)
    for nme in hidden:
        set_effect(P, s, nme, amp * spec.get("pre", 1.0), rng, depth, flat)
    unex = spec.get("unexcited", "")
    if unex == "layer":
        P[bed.DB] = 1.8 * depth
    if unex == "stribeck":
        P[bed.VS] = 4e-4
    if out:
        o = {"lift": dict(LIFT=rng.uniform(45, 75) * amp), "wave": dict(WAVE=rng.uniform(.12, .2) * depth * amp, WLEN=rng.uniform(.012, .02)),
             "puncture": dict(PUNCT=rng.uniform(.5, .6) * depth, PLEFT=max(.45 / max(amp, .1), .2) if amp > 0 else 1.0), "hose": {}, "plough": dict(PLOUGH=rng.uniform(.25, .4) * Fmax / depth * amp, PLL=rng.uniform(.006, .01))}[out]
        for k_, v in o.items():
            P[bed.IX[k_]] = v
    if P[bed.R1] > 0:
        P[bed.R2], P[bed.T2] = .12 * P[bed.R1], 1.8 * P[bed.T1]
    P[bed.OFFN] = rng.uniform(-2e-5, 2e-5) * (0 if "surface-offset" in hid else 1)
    # frames
    yaw, tilt = rng.uniform(-.6, .6), rng.choice([0, 0, rng.uniform(.05, .2)])
    Rs = (Rot.from_euler("z", yaw) * Rot.from_rotvec(tilt * np.array([np.cos(2.2), np.sin(2.2), 0]))).as_matrix()
    point = np.array([rng.uniform(.52, .62), rng.uniform(-.1, .1), rng.uniform(.06, .16)])
    lvl = np.deg2rad(rng.uniform(0, .2)) * np.array([np.cos(yaw * 9), np.sin(yaw * 9), 0])
    heavy = "tool-inertia" in hid
    m_rig, com_rig = (.24, np.array([0, 0, .049])) if not heavy else (.45, np.array([0, 0, .055]))
    off = rng.uniform(-.02, .02) * (1 if not hid & {"tool-mass", "sensor-gain"} else .2)
    true = Tool(m_rig * (1 + off), com_rig * (1 + rng.uniform(-.02, .02)), Rot.from_rotvec(lvl).apply([0, 0, -9.81]), Rs)
    rigt = Tool(m_rig, com_rig, np.array([0, 0, -9.81]), Rs)
    nu.update(base_tilt_deg=float(np.rad2deg(np.linalg.norm(lvl))), tool_mass_off=float(off), surface_off_m=float(P[bed.OFFN]))
    # motion
    if tester:
        M, Kc, zeta = np.array([1.0, 1, 20]), np.array([rng.uniform(2e3, 6e3), 4e4, 4e5]), np.array([.15, .7, .7])
    else:
        M, Kc, zeta = np.full(3, rng.uniform(3, 6)), np.append(np.full(2, rng.uniform(1500, 5000)), rng.choice([rng.uniform(1500, 5000), rng.uniform(8e3, 2e4)])), np.full(3, .75)
    nu["controller_N_per_m"] = [float(v) for v in Kc]
    load = lambda d: P[bed.K] * d ** P[bed.N] * (1 + .5 * P[bed.R1]) + P[bed.KB] * max(d - P[bed.DB], 0)
    p = plan_motion(rng, names, hid | ({"viscous-friction"} if out in ("lift", "wave", "plough") else set()), depth, load, Kc[2], contact, tester, unex)
    t, cmd, ph = p.sample()
    h, W = bed.rings(P, "flat" if flat else "round", depth * 1.25)
    mat = P[bed.N] if flat else P[bed.N] - 1
    Psim = P.copy()
    if not contact:
        Psim[bed.K], W = 0, W * 0
    Psim[bed.Z0] += 0
    to = np.array([s.get(c, 0) for c in ("ox", "oy", "oz")])
    R = np.einsum("ij,njk->nik", Rs, (Rot.from_euler("YXZ", cmd[:, [4, 3, 5]]) * Rot.from_rotvec([np.pi, 0, 0])).as_matrix())
    if not tester:                                                # turn the tool about its axis so that joint 7 starts in mid range
        q0 = np.array([np.arctan2(point[1], point[0]), -.6, 0, 1.4, 0, -1.1, 0.0])
        for _ in range(2):
            Q1, _, _ = am.ik_path(A.offset, A.axis, q0, (point + Rs @ cmd[0, :3])[None], R[:1], np.zeros((1, 6)), am.TIP)
            R, q0 = R @ Rot.from_rotvec([0, 0, -Q1[0, 6]]).as_matrix(), np.r_[Q1[0, :6], 0.0]
    shift = np.einsum("nij,j->ni", R, to) @ Rs                     # true contact point relative to the rig's tip, bed frame
    X, V, Acc, F = bed.simulate(Psim, h, W, mat, np.ascontiguousarray(cmd[:, :3] + shift), DT, 2, M, Kc, 2 * zeta * np.sqrt(Kc * M))
    Vs = np.gradient(shift, DT, axis=0)
    X, V, Acc = X - shift, V - Vs, Acc - np.gradient(Vs, DT, axis=0)
    Om = np.gradient(R, DT, axis=0) @ R.transpose(0, 2, 1)
    w = np.stack([Om[:, 2, 1] - Om[:, 1, 2], Om[:, 0, 2] - Om[:, 2, 0], Om[:, 1, 0] - Om[:, 0, 1]], 1) / 2
    kg = Kin(t, X, V, R, w, np.gradient(w, DT, axis=0), Acc @ Rs.T)
    if out == "hose":                                             # umbilical: a soft spring from the tool to a fixed hook, also in the air
        F = F - amp * np.array([30, 22, 12]) * (X - np.array([.03, -.02, .0]))
    f = readings(F, kg, true, s, tester)
    nch = f.shape[1]
    nl = rng.uniform(-1, 1) * (.003 if group == "none" else .008)
    f = f * (1 + nl * f / np.array([40, 40, 40, 2, 2, 2])[:nch]) if not tester else f * (1 + nl * f / 40)
    nu["sensor_nonlinearity"] = float(nl)
    # log
    rate = float(rng.choice([200, 250, 500, 500, 1000, 1000, 100 if tester else 2000], p=[.12, .12, .2, .2, .16, .16, .04]))
    if hid & {"mains-hum", "sensor-lag", "time-offset"}:
        rate = max(rate, 500.0)
    tl = ins.sample_times(rng, t[-1], rate, nu)
    clk = rng.uniform(-2e-4, 2e-4)
    at = lambda a, tt: np.stack([np.interp(tt, t, a[:, j]) for j in range(a.shape[1])], 1)
    sd = np.array([rng.uniform(.01, .03)] * 2 + [rng.uniform(.02, .05)] + [rng.uniform(3e-4, 8e-4)] * 3) if not tester else np.array([rng.uniform(.01, .03), rng.uniform(.01, .03)])
    share, cut = rng.uniform(.2, .7), rng.uniform(50, 200)
    drift = rng.uniform(-.5, .5, nch) * sd * (0 if "sensor-drift" in hid else 1)
    y = at(f, tl - clk) + ins.noise(rng, len(tl), rate, sd, share, cut) + np.outer(tl / tl[-1], drift)
    if "sat" in s:
        y[:, :3] = np.clip(y[:, :3], -s["sat"], s["sat"]) + .15 * ins.noise(rng, len(tl), rate, sd, share, cut)[:, :3]
    if "hum" in s:
        fr, ph0 = rng.choice([50.0, 60.0]), rng.uniform(0, 6, nch)
        hum = np.stack([s["hum"] * (1 if j < 3 else .01) * (np.sin(2 * np.pi * fr * tl + ph0[j]) + .3 * np.sin(4 * np.pi * fr * tl + 2 * ph0[j])) for j in range(nch)], 1)
        y = y + hum
    if "quant" in s:
        st = s["quant"] * np.array([1, 1, 1, .02, .02, .02])[:nch]
        y = np.round(y / st) * st
    nu.update(noise_sd=[float(v) for v in sd], coloured_share=float(share), coloured_cut_hz=float(cut), clock_off_s=float(clk))
    if tester:
        kl = Kin(tl, np.round(at(X, tl) / 1e-6) * 1e-6, at(V, tl))
        cols = {"t": tl, "depth": -kl.X[:, 2], "normal_force": y[:, 0]}
        if rng.random() < .6:
            cols["depth_rate"] = -kl.V[:, 2] + 1e-5 * rng.standard_normal(len(tl))
        if "coulomb-friction" in names:
            cols.update(slip1=kl.X[:, 0], tangential_force1=y[:, 1])
            if "depth_rate" in cols:
                cols["slip_rate1"] = kl.V[:, 0] + 1e-5 * rng.standard_normal(len(tl))
    else:
        idx = np.searchsorted(t, tl)
        Rl = Rot.from_matrix(R[idx - 1]) * Rot.from_rotvec((Rot.from_matrix(R[idx - 1]).inv() * Rot.from_matrix(R[idx])).as_rotvec() * ((tl - t[idx - 1]) / DT)[:, None])
        Rm, Xl, Vl = Rl.as_matrix(), at(X, tl), at(V, tl)
        Q, D, err = am.ik_path(A.offset, A.axis, q0, point + Xl @ Rs.T, Rm, np.hstack([Vl @ Rs.T, at(w, tl)]), am.TIP)
        assert err < 1e-8 and np.all(np.abs(Q) < A.qmax), ("IK", err, np.abs(Q).max(0))
        nu["dq_over_limit"] = float(np.max(np.abs(D) / A.vmax))
        assert nu["dq_over_limit"] <= 1.1, ("joint speed", nu["dq_over_limit"])
        enc = 10 ** rng.uniform(np.log10(2e-6), np.log10(2e-5))
        nu["encoder_step_rad"] = float(enc)
        Qm = ins.encoder(Q, enc)
        dqm = ins.rates(rng, tl, D, rate, nu)
        Pl, Rq = am.fk(A.offset, A.axis, Qm, am.TIP)
        kl = Kin(tl, Xl + gaussian_filter1d((Pl - point) @ Rs - Xl, .004 * rate, axis=0), Vl, Rq, at(w, tl), at(kg.al, tl), at(kg.a, tl))
        cols = {"t": tl} | {f"q{j+1}": Qm[:, j] for j in range(7)}
        if dqm is not None:
            cols |= {f"dq{j+1}": dqm[:, j] for j in range(7)}
        cols |= {n: y[:, j] for j, n in enumerate(("fx", "fy", "fz", "tx", "ty", "tz"))}
    if rng.random() < .6 and not tester:
        cols["phase"] = ph[np.minimum(np.searchsorted(t, tl), len(t) - 1)]
    rec = judge(spec, P, s, y, kl, F[np.minimum(np.searchsorted(t, tl), len(t) - 1), 2], rigt, sd, contact, tester, rate, "slip1" in cols, amp) if spec.get("judge", True) else {}
    if not contact:
        nu.pop("friction_law")
    rec.update(nuisances=nu, notes=f"{spec.get('notes', '')} duration {tl[-1]:.1f} s; law {({n: round(float(P[i]), 7) for n, i in bed.IX.items() if P[i] != bed.params()[i]}) if contact else 'none'}; sensor {({k_: round(float(v), 6) for k_, v in s.items()})}".strip())
    if folder is not None:
        ins.write_log(folder, cols, spec.get("fmt", "parquet"))
        rig: dict = {} if tester else {"robot": dict(model="lwr4plus", sensor_frame="ft_sensor", tip_frame="tool_tip"), "tool": dict(mass=m_rig, com=com_rig.tolist()),
                                       "surface": dict(point=point.tolist(), normal=Rs[:, 2].tolist(), tangent=Rs[:, 0].tolist())}
        if not contact:
            rig.pop("surface")
        rig["sensor"] = dict(noise=sd.tolist()) if not tester else {}
        if not tester:
            rig["sensor"]["range"] = [40, 40, 120, 2, 2, 2]
        ins.write_rig(folder, rig)
    return rec


def judge(spec: dict, P: np.ndarray, s: dict, y: np.ndarray, kl: Kin, Fn: np.ndarray, rigt: Tool, sd: np.ndarray, contact: bool, tester: bool, rate: float, fric: bool, amp: float) -> dict:
    """effect_rms, left_rms and near by own fits of the catalogue's plain forms to the log's motion."""
    hidden, model = spec["hidden"], spec["model"]
    det = [h for h in hidden if h in ("quantization", "mains-hum")]
    hid = [h for h in hidden if h not in det]
    st = max(1, int(rate // 240))
    sub = lambda a: a[::st] if len(a) else a
    k = Kin(*(sub(v) for v in (kl.t, kl.X, kl.V, kl.R, kl.w, kl.al, kl.a)))
    yy, touch = sub(y), sub(Fn) > .05
    tq = bool(set(hidden) & TORQUE)
    wt = np.array([1, 1, 1, 25, 25, 25.0]) if not tester else np.array([1, 1.0 if fric else 0])
    ch = slice(3, 6) if tq else (slice(0, 3) if not tester else slice(0, 2 if fric else 1))
    sel = np.ones_like(touch) if not contact or set(hidden) & AIR else touch
    fx = bed.params(N=P[bed.N] if "hertz-exponent" in model else (1.0 if model[0] not in ("hertz", "hunt-crossley") else 1.5), MODE=0 if "friction-rounding" in model else (2 if P[bed.MODE] in (2, 4) else 1), PT=P[bed.PT], PX=P[bed.PX], PW=P[bed.PW], AL=P[bed.AL], T1=P[bed.T1], MU=0)
    ft = fx.copy()
    if "friction-rounding" in hid:
        ft[bed.MODE] = 0
    start = {n: float(P[i]) for n, i in bed.IX.items()} | {k_: float(v) for k_, v in s.items()}
    rms = lambda r: float(np.sqrt(np.mean(r[sel][:, ch] ** 2)))
    args = (k, rigt)
    th, res = fit(model + hid, start, yy, *args, ft, wt, contact, tester)
    if spec.get("debug") is not None:
        spec["debug"].update(res=res, k=k, touch=touch, yy=yy)
    if spec["group"] == "unexcited":
        th0, res = fit(model, start, yy, *args, ft, wt, contact, tester)
        th = {q: start[q] for h in hid for q in FIT[h]} | th0
    left, read = rms(res), rms(yy)
    eff, near, each = 0.0, [], {}
    if hid:
        clean = predict(th, *args, ft, contact, tester)
        st0 = {k_: v for k_, v in th.items() if k_ in {q for m in model for q in FIT[m]}}
        for h in hid:
            mm = model + [g for g in hid if g != h]
            _, r = fit(mm, st0 | {k_: v for k_, v in th.items() if k_ in {q for m in mm for q in FIT[m]}}, clean, *args, ft if h != "friction-rounding" else fx, wt, contact, tester)
            each[h] = rms(r)
            for a in (ALTS.get(h, []) if contact or h in AIR else []):
                if a in model + hid or tester and a in AIR or (a == "sensor-misalignment" or a == "sensor-bias") and tester:
                    continue
                f2 = (ft if h != "friction-rounding" else fx).copy()
                if a == "friction-rounding":
                    f2[bed.MODE] = 0
                _, r = fit(mm + [a], st0 | th | ({"R1": .3, "HA": .3, "SR": .1, "CC": 1e-5}), clean, *args, f2, wt, contact, tester, 6)
                if rms(r) < .7 * left:
                    near.append(a)
        eff = min(each.values())
    for h in det:
        each[h] = s["quant"] / np.sqrt(12) if h == "quantization" else s["hum"] * np.sqrt(.5 * 1.09)
        left = np.sqrt(max(left ** 2 - each[h] ** 2, float(np.mean(sd[:3] ** 2)) if not tester else 0))
        eff = each[h] if not hid else min(eff, each[h])
    return dict(effect_rms=eff, left_rms=float(left), reading_rms=read, each={h: float(v) for h, v in each.items()}, near=near, unit="N·m" if tq else "N",
                noise_rms=float(np.sqrt(np.mean(sd[ch] ** 2))), fit_true={k_: float(v) for k_, v in th.items()})
