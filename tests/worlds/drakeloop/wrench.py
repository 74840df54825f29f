"""Wrench logs: the arm under impedance control pokes and strokes a soft plane. SI units."""
from __future__ import annotations
from dataclasses import dataclass
from typing import Any, Callable
import numpy as np
import law
from arm import Arm, Tool, fk, joint_path, rot, simulate
from chain import (Clock, FREE, at, chain_defaults, clean_wrench, contact, draw_nuisances, encoders, fit, get, kinematics, predict, put,
                   sense, smooth_motion)

Item = tuple[str, str, int, float, float, bool]     # where, name, index, value, neutral value, scales with the magnitude


@dataclass
class Effect:
    """How a hidden effect is made: section, channel (n, t, f, m), bases it suits, style of motion, parameters, look-alikes."""
    section: str
    channel: str
    bases: tuple[str, ...]
    style: str
    draw: Callable[[np.random.Generator, dict], list[Item]]
    alike: tuple[str, ...] = ()


ANY = ("kelvin-voigt", "hunt-crossley", "hertz", "zener", "kelvin-voigt", "maxwell")
ELA = ("kelvin-voigt", "hertz", "hunt-crossley")
KV = ("hooke", "kelvin-voigt")


def p(name: str, a: float, b: float, neutral: float = 0.0, scale: bool = True, sign: bool = False, log: bool = False):
    """One law parameter drawn between a and b."""
    def f(rng: np.random.Generator, c: dict) -> list[Item]:
        v = float(np.exp(rng.uniform(np.log(a), np.log(b)))) if log else float(rng.uniform(a, b))
        return [("P", name, -1, v * (rng.choice([-1, 1]) if sign else 1), neutral, scale)]
    return f


def both(*fs):
    return lambda rng, c: [i for f in fs for i in f(rng, c)]


def qv(name: str, lo: float, hi: float, n: int, scale6: tuple[float, ...] | None = None):
    """A chain vector: random direction, size between lo and hi."""
    def f(rng: np.random.Generator, c: dict) -> list[Item]:
        v = rng.normal(size=n)
        v *= rng.uniform(lo, hi) / np.linalg.norm(v)
        s = scale6 or (1.0,) * n
        return [("Q", name, i, float(v[i] * s[i]), float(c["Q"][name][i]), True) for i in range(n)]
    return f


def vec(rng, c, name, v):
    return [("Q", name, i, float(c["Q"][name][i] + x), float(c["Q"][name][i]), True) for i, x in enumerate(v)]


def q1(name: str, a: float, b: float, sign: bool = False):
    return lambda rng, c: [("Q", name, -1, float(c["Q"][name] + rng.uniform(a, b) * (rng.choice([-1, 1]) if sign else 1)), float(c["Q"][name]), True)]


def xtalk(rng: np.random.Generator, c: dict) -> list[Item]:
    ks = rng.choice([1, 2, 3, 5, 6, 7], 3, replace=False)      # rows of Fx, Fy, Fz in the 6x6 matrix
    idx = {1: 1, 2: 2, 3: 6, 5: 8, 6: 12, 7: 13}
    return [("Q", "xt", idx[int(k)], float(rng.uniform(0.03, 0.09) * rng.choice([-1, 1])), 0.0, True) for k in ks]


def layer(rng, c):
    return [("P", "slK", -1, float(rng.uniform(0.4, 1.2) * c["F"] / c["d"]), 0.0, True), ("P", "slB", -1, float(rng.uniform(0.4, 0.6) * c["d"]), 1.0, False)]


def bump(a: str, x: str, y: str, w: str):
    def f(rng, c):
        return [("P", a, -1, float(rng.uniform(0.25, 0.7)), 0.0, True), ("P", x, -1, float(rng.uniform(-0.02, 0.02)), 0.0, False),
                ("P", y, -1, float(rng.uniform(-0.015, 0.015)), 0.0, False), ("P", w, -1, float(rng.uniform(0.008, 0.014)), 0.01, False)]
    return f


def exponent(rng, c):
    n0 = 1.5 if c["base"] in ("hertz", "hunt-crossley") else 1.0
    return [("P", "n", -1, float(rng.uniform(1.25, 1.6) if n0 == 1 else rng.choice([rng.uniform(1.1, 1.3), rng.uniform(1.8, 2.1)])), n0, True)]


def sat(rng, c):
    return [("Q", "sat", -1, float(rng.uniform(0.55, 0.8) * c["F"]), 1e9, False)]


def hum(rng, c):
    a = rng.uniform(0.05, 0.3, 3)
    return [("Q", "hum", i, float(a[i] if i < 3 else a[i - 3] * 0.01), 0.0, True) for i in range(6)] + \
        [("Q", "humf", -1, float(rng.choice([50.0, 60.0])), 50.0, False)]


EFFECTS: dict[str, Effect] = {
    "hertz-exponent": Effect("normal", "n", KV + ("hertz",), "poke", exponent, ("stiffening-layer", "surface-offset")),
    "viscous-damping": Effect("normal", "n", ("hooke", "hertz"), "poke", p("c", 8, 35), ("hunt-crossley-damping", "relaxation", "hysteresis")),
    "hunt-crossley-damping": Effect("normal", "n", ("hooke", "hertz"), "poke", p("lam", 1.5, 7), ("viscous-damping", "relaxation", "hysteresis")),
    "relaxation": Effect("normal", "n", ELA, "poke", both(p("r1", 0.25, 0.8), p("tau1", 0.15, 1.5, 1, False, log=True)), ("hysteresis", "stiffness-drift")),
    "hysteresis": Effect("normal", "n", ELA, "poke", both(p("hyA", 0.4, 1.5), p("hyL", 3e-4, 1e-3, 5e-4, False)), ("relaxation", "viscous-damping")),
    "stress-softening": Effect("normal", "n", ELA, "poke", both(p("ssR", 0.15, 0.4), p("ssL", 4e-4, 1.5e-3, 1e-3, False)), ("stiffness-drift",)),
    "adhesion": Effect("normal", "n", ELA, "poke", both(p("adF", 0.5, 2.5), p("adL", 5e-4, 2e-3, 1e-3, False)), ("surface-offset", "sensor-bias")),
    "stiffening-layer": Effect("normal", "n", ELA, "poke", layer, ("hertz-exponent",)),
    "surface-offset": Effect("normal", "n", ELA, "poke", p("z0", 1.5e-4, 6e-4, sign=True), ("hertz-exponent", "tip-offset")),
    "stiffness-drift": Effect("normal", "n", ELA, "poke", p("drift", 0.2, 0.6, sign=True), ("stress-softening", "sensor-drift", "stiffness-inhomogeneity")),
    "stiffness-inhomogeneity": Effect("normal", "n", ELA, "slide", bump("inA", "inX", "inY", "inW"), ("stiffness-drift",)),
    "coulomb-friction": Effect("tangential", "t", ANY, "slide", p("mu", 0.25, 0.8), ("sensor-misalignment", "viscous-friction", "friction-rounding")),
    "viscous-friction": Effect("tangential", "t", ANY, "slide", p("cv", 8, 30), ("friction-rounding", "stribeck-friction")),
    "stribeck-friction": Effect("tangential", "t", ANY, "slide", both(p("dmu", 0.15, 0.4), p("vs", 6e-3, 2e-2, 1e-2, False)), ("viscous-friction", "friction-rounding")),
    "presliding": Effect("tangential", "t", ANY, "slide", p("ell", 7e-4, 2.5e-3, 1e-4), ("friction-rounding", "structural-compliance")),
    "friction-rounding": Effect("tangential", "t", ANY, "slide", both(lambda r, c: [("P", "fmode", -1, 2.0, 0.0, False)], p("vr", 5e-3, 2e-2, 1e-3)), ("presliding", "viscous-friction")),
    "load-dependent-friction": Effect("tangential", "t", ELA, "slide", p("p", -0.45, -0.2), ()),
    "friction-anisotropy": Effect("tangential", "t", ANY, "slide", p("aniso", 0.1, 0.3, sign=True), ()),
    "tool-mass": Effect("robot", "f", ANY, "turn", q1("mass", 0.03, 0.12, True), ("sensor-gain", "sensor-bias")),
    "tool-com": Effect("robot", "m", ANY, "turn", lambda r, c: vec(r, c, "com", r.uniform(4e-3, 1.2e-2) * np.array([np.cos(a := r.uniform(0, 6.28)), np.sin(a), r.uniform(-.5, .5)])), ("sensor-bias", "tip-offset", "sensor-misalignment")),
    "tool-inertia": Effect("robot", "m", ANY, "shake", lambda r, c: vec(r, c, "inertia", r.uniform(2e-3, 5e-3) * np.array([1, r.uniform(.7, 1), r.uniform(.3, .6), 0, 0, 0])), ("tool-com", "sensor-lag")),
    "structural-compliance": Effect("robot", "n", ("hertz", "hertz", "hunt-crossley"), "poke", p("C", 5e-5, 2e-4), ("hertz-exponent", "surface-offset")),
    "tip-offset": Effect("robot", "m", ANY, "mix", lambda r, c: vec(r, c, "tip", r.uniform(1e-3, 3e-3) * np.array([np.cos(a := r.uniform(0, 6.28)), np.sin(a), 0])), ("tool-com", "sensor-bias")),
    "sensor-bias": Effect("sensor", "f", ELA, "turn", qv("bias", 0.3, 1.2, 6, (1, 1, 1, .02, .02, .02)), ("tool-mass", "sensor-drift")),
    "sensor-drift": Effect("sensor", "f", ELA, "mix", qv("drift", 0.8, 3.0, 6, (1, 1, 1, .02, .02, .02)), ("sensor-bias", "stiffness-drift")),
    "sensor-crosstalk": Effect("sensor", "f", ELA, "mix", xtalk, ("sensor-misalignment",)),
    "sensor-misalignment": Effect("sensor", "f", ELA, "mix", qv("mis", 0.04, 0.12, 3), ("sensor-crosstalk",)),
    "sensor-gain": Effect("sensor", "f", ELA, "turn", q1("gain", 0.06, 0.15, True), ("tool-mass",)),
    "sensor-lag": Effect("sensor", "f", ("kelvin-voigt", "hertz"), "fast", q1("lag", 0.012, 0.04), ("time-offset",)),
    "time-offset": Effect("sensor", "f", ("kelvin-voigt", "hertz"), "fast", q1("toff", 0.01, 0.035, True), ("sensor-lag",)),
    "saturation": Effect("sensor", "n", ELA, "poke", sat, ()),
    "quantization": Effect("sensor", "f", ELA, "mix", lambda r, c: [], ()),
    "mains-hum": Effect("sensor", "f", ELA, "mix", hum, ()),
}
OUTSIDE: dict[str, Effect] = {
    "hose-pull": Effect("outside", "f", ELA, "turn", lambda r, c: [("Q", "hose", -1, float(r.uniform(15, 50)), 0.0, True)], ("tool-mass", "sensor-bias")),
    "viscoelastic-lift": Effect("outside", "n", ("kelvin-voigt", "hertz"), "slide", p("lift", 0.4, 0.9), ()),
    "friction-patch": Effect("outside", "t", ELA, "slide", bump("paA", "paX", "paY", "paW"), ()),
    "friction-wear": Effect("outside", "t", ELA, "slide", both(p("wearA", 0.5, 1.2), p("wearL", 0.1, 0.3, 0.2, False)), ()),
    "table-vibration": Effect("outside", "n", ELA, "mix", both(p("vibA", 2e-4, 6e-4), p("vibF", 3, 9, 5, False)), ()),
    "surface-waves": Effect("outside", "n", ELA, "slide", both(p("wavA", 4e-4, 1e-3), p("wavL", 0.02, 0.04, 0.04, False)), ("stiffness-inhomogeneity",)),
    "one-sided-sensor": Effect("outside", "f", ("hertz",), "turn", lambda r, c: [("Q", "quad", -1, float(r.uniform(0.12, 0.3) * r.choice([-1, 1])), 0.0, True)], ("sensor-gain", "hertz-exponent")),
}


def trapezoid(u: np.ndarray, a: float = 0.2) -> np.ndarray:
    """0..1 with constant speed in between, smooth (quintic-blended) ends."""
    s = np.clip(u / a, 0, 1); e = np.clip((1 - u) / a, 0, 1)
    ramp = lambda x: x ** 4 * (2.5 - 3 * x + x * x)       # integral of smoothstep5
    v = 1 / (1 - a)
    return np.where(u < 0.5, v * (a * ramp(s) + np.maximum(u - a, 0)), 1 - v * (a * ramp(e) + np.maximum(1 - u - a, 0)))


class Path:
    """Tool poses over the plane at 250 Hz: (height of the set-point, x1, x2, tilt about t1, tilt about t2, spin), with phases."""
    DT = 0.004

    def __init__(self, start: list[float]) -> None:
        self.y, self.ph = [np.array([start], float)], ["free"]

    def to(self, phase: str, seconds: float, **kw: float) -> None:
        y0 = self.y[-1][-1]
        y1 = y0.copy()
        for k, v in kw.items():
            y1[("h", "x1", "x2", "a1", "a2", "sp").index(k)] = v
        n = max(int(round(seconds / self.DT)), 4)
        s = trapezoid(np.arange(1, n + 1) / n)[:, None]
        self.y.append(y0 + s * (y1 - y0))
        self.ph += [phase] * n

    def wag(self, seconds: float, amp: np.ndarray, hz: np.ndarray) -> None:
        n = int(seconds / self.DT)
        t = np.arange(1, n + 1) * self.DT
        y = np.repeat(self.y[-1][-1:], n, 0)
        env = np.minimum(1, np.minimum(t, seconds - t) / 0.4)
        env = env * env * (3 - 2 * env)
        for j in range(3):
            y[:, 3 + j] += env * amp[j] * np.sin(2 * np.pi * hz[j] * t)
        self.y.append(y)
        self.ph += ["free"] * n


def make_path(rng: np.random.Generator, style: str, dmax: float, cmd: Callable[[float], float], seconds: float, same_place: bool, one_tangent: bool,
              max_depth: float = 1.0) -> Path:
    """Pokes and / or strokes; cmd(depth) is the set-point below the surface that reaches a depth [m]."""
    sp0 = rng.uniform(-0.5, 0.5)
    b1, b2 = rng.uniform(-0.06, 0.06, 2)
    up = rng.uniform(0.012, 0.025)
    w = Path([up, 0, 0, b1, b2, sp0])
    w.to("free", 0.6)
    if style in ("turn", "shake", "fast") or rng.random() < 0.75:
        big = style == "turn"
        w.wag(6.0 if big else 2.5, rng.uniform(0.3, 0.55, 3) if big else rng.uniform(0.1, 0.3, 3), rng.uniform(0.15, 0.45, 3) if style != "shake" else rng.uniform(0.5, 1.0, 3))
    if style == "shake":
        w.wag(5.0, rng.uniform(0.08, 0.14, 3), rng.uniform(1.8, 3.0, 3))
    near = 0.003
    dwell = lambda: w.to("rest", rng.uniform(0.3, 0.8))

    def poke(d: float, v: float, hold: float, x: np.ndarray, tilt: float) -> None:
        w.to("free", 0.5, x1=x[0], x2=x[1], a1=b1 + rng.uniform(-tilt, tilt), a2=b2 + rng.uniform(-tilt, tilt))
        w.to("approach", 0.4, h=near)
        D = cmd(d)
        w.to("poke", (near + D) / v, h=-D)
        w.to("hold", hold)
        w.to("retract", (near + D) / min(v * rng.uniform(0.7, 1.5), 0.08), h=near)
        dwell()
        w.to("retract", 0.3, h=up * 0.5)

    def strokes(d: float, n: int) -> None:
        x = rng.uniform(-0.012, 0.012, 2)
        w.to("free", 0.6, x1=x[0], x2=x[1], a1=b1, a2=b2)
        w.to("approach", 0.4, h=near)
        w.to("poke", 0.6, h=-cmd(d))
        for i in range(n):
            L = rng.uniform(0.02, 0.045)
            v = float(np.exp(rng.uniform(np.log(0.007), np.log(0.09))))
            k = "x1" if one_tangent or i % 4 < 2 else "x2"
            cur = w.y[-1][-1][1 if k == "x1" else 2]
            w.to("slide", L / v, **{k: cur + L * (-1 if cur > 0 else 1)})
            if i % 3 == 2 and rng.random() < 0.6:
                w.to("slide", 0.3, h=-cmd(d * rng.uniform(0.55, 1.0)))
        w.to("hold", 0.4)
        w.to("retract", 0.5, h=up * 0.5)

    if style == "fast":
        for i in range(7):
            poke(dmax * rng.uniform(0.6, 1), rng.uniform(0.06, 0.16), 0.15, rng.uniform(-0.01, 0.01, 2), 0.05)
    if one_tangent:
        b1 = b2 = 0.0
    np_ = {"poke": 6, "turn": 3, "shake": 2, "mix": 4, "slide": 0 if one_tangent else 1, "fast": 0}[style]
    tilt = 0.14 if style in ("mix", "turn") else 0.05
    places = rng.uniform(-0.015, 0.015, (3, 2)) if not same_place else np.zeros((3, 2))
    for i in range(np_):
        d = dmax * max_depth * (rng.uniform(0.35, 0.55) if i < 2 and np_ > 4 else 1.0 if i == np_ // 2 else rng.uniform(0.45, 1.0))
        v = (0.008, 0.05, 0.015, 0.03, 0.006, 0.06)[i % 6] * rng.uniform(0.8, 1.3)
        poke(d, v, rng.uniform(0.3, 0.7) if i % 3 else rng.uniform(1.0, 2.0), places[0] if style == "poke" else places[i % 3], tilt)
    ns = {"poke": 0, "turn": 5, "shake": 4, "mix": 8, "slide": 4, "fast": 3}[style]
    if style == "poke" and not same_place and rng.random() < 0.6:
        ns = 4
    while ns:
        for d in ((0.45, 0.75, 1.0) if style == "slide" else (0.5, 0.9)):
            strokes(d * dmax * max_depth, max(2, ns // (1 if style == "slide" else 2)))
        if len(w.ph) * w.DT > seconds:
            break
        if seconds < 60:
            break
    while seconds > 60 and len(w.ph) * w.DT < seconds:
        poke(dmax * rng.uniform(0.5, 1), rng.uniform(0.008, 0.04), 1.0, places[0], tilt)
        w.to("rest", rng.uniform(1, 4))
    w.to("free", 0.8, h=up)
    return w


def run(rng: np.random.Generator, arm: Arm, group: str, base: str, hidden: list[str], mag: dict[str, float], long: bool, quiet: float) -> dict[str, Any]:
    """One wrench case: simulate, measure, judge. `mag` scales the hidden effects; quiet scales the sensor's noise."""
    effs = {h: (EFFECTS.get(h) or OUTSIDE[h]) for h in hidden}
    order = ["fast", "shake", "turn", "slide", "mix", "poke"]
    styles = {e.style for e in effs.values()} or {str(rng.choice(["poke", "slide", "mix", "turn"]))}
    style = min(styles, key=order.index)
    if styles in ({"poke", "slide"}, {"poke", "slide", "mix"}):
        style = "mix"
    F, d = float(rng.uniform(7, 20)), float(rng.uniform(3e-3, 6.5e-3))
    dk: dict[str, float] = dict(mu=float(rng.uniform(0.25, 0.8)))
    n = 1.5 if base in ("hertz", "hunt-crossley") else 1.0
    dk["n"] = n
    dk["k"] = F / (law.D0 * (d / law.D0) ** n)
    model = [base]
    if base == "kelvin-voigt":
        dk["c"] = float(rng.uniform(3, 20))
    if base == "hunt-crossley":
        dk["lam"] = float(rng.uniform(0.8, 4))
    if base == "zener":
        dk.update(r1=float(rng.uniform(0.3, 0.8)), tau1=float(rng.uniform(0.15, 1.0)))
        dk["k"] *= 0.7
    if base == "maxwell":
        dk.update(keq=0.0, r1=1.0, tau1=float(rng.uniform(2, 8)))
    form = "dahl"
    if "coulomb-friction" not in hidden:
        model.append("coulomb-friction")
    if not {"presliding", "friction-rounding", "coulomb-friction"} & set(hidden):
        form = str(rng.choice(["dahl", "spring", "spring", "spring", "presliding", "rounded"]))
        if form == "spring":
            dk["fmode"] = 1.0
        if form == "presliding":
            dk["ell"] = float(rng.uniform(3e-4, 1.2e-3))
            model.append("presliding")
        if form == "rounded":
            dk.update(fmode=2.0, vr=float(rng.uniform(3e-3, 1e-2)))
            model.append("friction-rounding")
    Q = chain_defaults()
    heavy = bool({"tool-com", "sensor-gain", "tool-inertia"} & set(hidden)) or rng.random() < 0.2
    Q["mass"] = float(rng.uniform(0.6, 1.2) if heavy else rng.uniform(0.15, 0.35))
    Q["com"] = np.array([*rng.uniform(-2e-3, 2e-3, 2), rng.uniform(0.04, 0.06)])
    rig_inertia = np.zeros(6) if heavy is False or "tool-inertia" in hidden else Q["mass"] * np.array([8e-4, 8e-4, 3e-4, 0, 0, 0])
    Q["inertia"] = rig_inertia.copy()
    rig_tool = Tool(Q["mass"], Q["com"].copy(), rig_inertia.copy())
    ctx = dict(F=F, d=d, base=base, Q=Q)
    Pn, items = law.pvec(dk), {}
    neutral = (Pn.copy(), {k: v.copy() if isinstance(v, np.ndarray) else v for k, v in Q.items()})
    for h, e in effs.items():
        items[h] = [(a, b, i, nv + (v - nv) * (mag[h] if s else 1.0), nv, s) for a, b, i, v, nv, s in e.draw(rng, ctx)]
        if group == "unexcited" and h == "stiffening-layer":
            items[h] = [(a, b, i, (1.3 * d if b == "slB" else v), nv, s) for a, b, i, v, nv, s in items[h]]
        Pn, Q = put(Pn, Q, [(i[0], i[1], i[2]) for i in items[h]], np.array([i[3] for i in items[h]]))
    # truth with nuisances
    nu = draw_nuisances(rng, group, False)
    if {"sensor-lag", "time-offset", "mains-hum"} & set(hidden):
        nu["rate"] = max(nu["rate"], 500.0)
    if long:
        nu["rate"] = min(nu["rate"], 250.0)
    nu.update(noise_force=float(rng.uniform(0.01, 0.03) * quiet), surface_off=float(rng.uniform(-2e-5, 2e-5)), tool_mass_rel=float(rng.uniform(-0.02, 0.02)),
              tool_com_rel=float(rng.uniform(-0.02, 0.02)), onset_patch=float(rng.choice([0, rng.uniform(5e-6, 3e-5)])), second_branch=float(rng.choice([0, rng.uniform(0, 0.004)])),
              friction_form=form)
    nu["noise_force"] = max(nu["noise_force"], 0.01)
    nu["encoder_step"] = min(nu["encoder_step"], 2e-5 if form == "rounded" and quiet >= 1 else 5e-6)
    if quiet < 1:
        nu.update(surface_off=nu["surface_off"] * 0.3, tool_mass_rel=nu["tool_mass_rel"] * 0.3, tool_com_rel=nu["tool_com_rel"] * 0.3, base_tilt=nu["base_tilt"] * 0.3, nonlinearity=nu["nonlinearity"] * 0.3)
    noise = np.array([1, 1, 1.6, 0.03, 0.03, 0.02]) * nu["noise_force"]
    noise[:3], noise[3:] = np.minimum(noise[:3], 0.05), np.clip(noise[3:], 3e-4, 8e-4)
    Pt = Pn.copy()
    Pt[law.IX["z0"]] += nu["surface_off"]
    Pt[law.IX["found"]] = nu["onset_patch"]
    Pt[law.IX["r2"]], Pt[law.IX["tau2"]] = nu["second_branch"], 0.3
    Qt = {k: v.copy() if isinstance(v, np.ndarray) else v for k, v in Q.items()}
    Qt["mass"] = Q["mass"] + nu["tool_mass_rel"] * rig_tool.mass
    Qt["com"] = Q["com"] + nu["tool_com_rel"] * rig_tool.com
    Qt["nl"] = nu["nonlinearity"]
    # place, controller, path
    a, b = np.radians(rng.uniform(22, 38)), np.radians(rng.uniform(80, 100))
    q0 = np.array([rng.uniform(-0.5, 0.5), -a, rng.uniform(-0.2, 0.2), b, rng.uniform(-0.2, 0.2), -(np.pi - a - b), rng.uniform(-0.4, 0.4)])
    tilt = rng.uniform(0, np.radians(15)) if rng.random() < 0.6 else 0.0
    yaw = rng.uniform(-np.pi, np.pi)
    nrm = np.array([np.sin(tilt) * np.cos(yaw), np.sin(tilt) * np.sin(yaw), np.cos(tilt)])
    pt, R0, J0 = fk(arm.o8, arm.ax, arm.tip, q0)
    t1 = np.array([np.cos(yaw * 0.7), np.sin(yaw * 0.7), 0.0])
    t1 = t1 - (t1 @ nrm) * nrm
    t1 /= np.linalg.norm(t1)
    plane = np.ascontiguousarray(np.array([pt - [0, 0, 0.02], nrm, t1, np.cross(nrm, t1)]))
    if Q["hose"]:
        neutral[1]["hose_p"] = Q["hose_p"] = Qt["hose_p"] = pt + np.array([*rng.uniform(-0.04, 0.04, 2), rng.uniform(0.1, 0.2)])
    one_way = group == "unexcited" and "friction-anisotropy" in hidden
    cart = bool(rng.random() < 0.5) or one_way        # joint impedance would slide sideways when pressed
    if cart:
        kx = float(np.exp(rng.uniform(np.log(1200), np.log(5000))))
        kr = float(rng.uniform(100, 250))
        K = np.array([kx] * 3 + [kr] * 3)
        D = np.array([1.4 * np.sqrt(kx * 4.0)] * 3 + [1.4 * np.sqrt(kr * 0.15)] * 3)
        kn = kx
    else:
        kj = float(np.exp(rng.uniform(np.log(600), np.log(2000))))
        K = kj * np.array([1, 1, 1, 1, 0.5, 0.4, 0.4])
        D = 1.4 * np.sqrt(K * (np.array([1.5, 2, .4, .5, .05, .03, .01]) + 0.3))
        kn = 1 / (nrm @ J0[:3] @ np.diag(1 / K) @ J0[:3].T @ nrm)
    nu["controller"] = dict(kind="cartesian" if cart else "joint", stiffness=K[0], normal_stiffness=float(kn))

    def cmd(depth: float) -> float:
        ts = np.linspace(0, 0.5, 60)
        z = np.zeros((60, 2))
        Pc = Pn.copy()
        Pc[law.IX["C"]] = 0
        f = law.series(Pc, ts, depth * np.minimum(1, ts / 0.3), np.zeros(60), z, z)[-1, 0]
        return depth + f / kn

    same = "stiffness-inhomogeneity" in hidden and group == "unexcited"
    path = make_path(rng, "poke" if same else style, d, cmd, 170.0 if long else 40.0, same, one_way)
    y = np.vstack(path.y)
    tp = np.arange(len(y)) * path.DT
    Rb = np.column_stack([t1, -plane[3], -nrm])
    ps = plane[0] + y[:, :1] * nrm + y[:, 1:2] * t1 + y[:, 2:3] * plane[3]
    best = max(range(24), key=lambda i: np.trace(R0.T @ rot(nrm, i * np.pi / 12) @ Rb))
    Rb = rot(nrm, best * np.pi / 12) @ Rb
    Rs = np.array([rot(t1, r[3]) @ rot(plane[3], r[4]) @ rot(nrm, r[5]) @ Rb for r in y])
    qd = joint_path(arm, q0, tp, ps, Rs)
    gt = np.array([np.sin(nu["base_tilt"]), 0, -np.cos(nu["base_tilt"])]) * 9.81
    gn = np.array([0, 0, -9.81])
    jf = np.zeros((13, 7))
    jf[0], jf[1], jf[2], jf[4] = rng.uniform(0.2, 0.8, 7), rng.uniform(0.02, 0.25, 7), 3e-4, 0.1
    plant = arm.plant(Tool(Qt["mass"], Qt["com"], Qt["inertia"]), gt)
    sim = simulate(arm, plant, qd, cart, K, D, np.ascontiguousarray(arm.tip + Qt["tip"]), plane, Pt, jf)
    tg = sim["t"]
    nu["margin_to_joint_limits"] = float((arm.lim - np.abs(sim["q"]).max(0)).min())
    # readings
    kin_g = kinematics(arm, sim["q"], sim["dq"], sim["ddq"])
    W0 = clean_wrench(kin_g, sim["f"], Qt, plane, arm, gt)
    step = float(rng.uniform(0.2, 0.5) * mag.get("quantization", 1.0)) if "quantization" in hidden else 0.0
    drift = rng.uniform(-0.5, 0.5, 6) * noise / (tg[-1] / 60)
    nu["temperature_drift"] = drift.tolist()
    W = sense(W0, tg, {**Qt, "drift": Qt["drift"] + drift})
    t = Clock(rng, tg[-1], nu["rate"], nu["jitter"], nu["dropped"]).t
    Y = at(t + nu["clock_off"], tg, W) + rng.normal(size=(len(t), 6)) * noise
    if Q["sat"] < 1e8:
        Y[:, 2] = np.clip(Y[:, 2], -Q["sat"], Q["sat"])
    lattice = np.array([0.01, 0.01, 0.02, 2.5e-4, 2.5e-4, 2.5e-4])
    if step:
        lattice = np.array([step, step, step, step / 50, step / 50, step / 50])
    Y = np.round(Y / lattice) * lattice
    ql, dql = encoders(rng, nu, t, tg, sim["q"], sim["dq"])
    # judge: along the executed motion, at the log's instants
    st = max(1, int(nu["rate"] // 400))
    t_all, Y_all, t, Y = t, Y, t[::st], Y[::st]
    kin_t = kinematics(arm, *(at(t, tg, sim[k]) for k in ("q", "dq", "ddq")))
    mdl = lambda kin: (lambda P_, Q_: predict(kin, t, P_, Q_, plane, arm, gn))
    Yc = predict(kin_t, t, Pn, Q, plane, arm, gn)
    if step:
        Yc = np.round((Yc + rng.normal(size=Yc.shape) * noise) / lattice) * lattice
    Fc, dep = contact(kin_t, t, Pn, Q, plane, arm)
    touch = np.abs(Fc[:, 0]) > 0.05
    world = lambda E: (kin_t[3] @ E[:, :3, None])[..., 0]

    def channels(E: np.ndarray, ch: str) -> np.ndarray:
        if ch == "n":
            return world(E)[touch] @ plane[1]
        if ch == "t":
            return (world(E)[touch] @ plane[2:].T).ravel()
        return E[:, :3].ravel() if ch == "f" else E[:, 3:].ravel()

    rms = lambda v: float(np.sqrt(np.mean(np.square(v)))) if len(v) else 0.0
    wgt = np.hypot(noise, lattice / np.sqrt(12))
    names = model + [h for h in hidden if h in EFFECTS]
    q_, v_, a_ = (x[::st] for x in smooth_motion(t_all, ql, dql))
    kin_l = kinematics(arm, q_, v_, a_)
    frame = lambda E, kin: np.hstack([world(E) @ plane[1:].T, E[:, 3:]])       # readings on (normal, tangents), moments
    far = 1e6                                                                  # a fit looks at its own channel only
    weights = {"n": wgt * [1, far, far, far, far, far], "t": wgt * [1, 1, 1, far, far, far], "f": wgt * [1, 1, 1, far, far, far], "m": wgt}
    weights = {k: (np.abs(w_) if k == "m" else np.concatenate([np.full(3, wgt[:3].mean()), wgt[3:]]) * (w_ / wgt)) for k, w_ in weights.items()}
    in_frame = lambda kin, ch: (lambda P_, Q_: mdl(kin)(P_, Q_) if ch == "m" else frame(mdl(kin)(P_, Q_), kin))
    seen = lambda E, ch, kin: E if ch == "m" else frame(E, kin)

    def residual(ch: str) -> tuple:
        """What the true model leaves of the log's readings, refitted to the channel."""
        P_, Q_, _ = fit(in_frame(kin_l, ch), seen(Y, ch, kin_l), Pn, Q, names, weights[ch], 2)
        a_, b_ = Y - mdl(kin_l)(P_, Q_), Y - mdl(kin_l)(Pn, Q)
        return (P_, Q_, a_) if rms(channels(a_, ch)) <= rms(channels(b_, ch)) else (Pn, Q, b_)

    lefts = {ch: residual(ch) for ch in sorted({"f"} | {e.channel for e in effs.values()})}
    Pf, Qf, L = lefts["f"]
    eff, left, near, share = {}, {}, [], {}
    for h, e in effs.items():
        fs = [(i[0], i[1], i[2]) for i in items[h]]
        P0, Q0 = put(Pn, Q, fs, np.array([i[4] for i in items[h]]))
        others = model + [o for o in hidden if o != h and o in EFFECTS]
        if h == "quantization":
            E = Yc - predict(kin_t, t, Pn, Q, plane, arm, gn)
        else:
            ch = e.channel
            P1, Q1, _ = fit(in_frame(kin_t, ch), seen(Yc, ch, kin_t), P0, Q0, others, weights[ch])
            E = Yc - mdl(kin_t)(P1, Q1)
        eff[h], left[h] = rms(channels(E, e.channel)), rms(channels(lefts[e.channel][2], e.channel))
        if h == "quantization":
            left[h] = float(np.sqrt(np.mean(noise[:3] ** 2)))
        ftool = predict(kin_t, t, law.pvec({}), neutral[1], plane, arm, gn)
        share[h] = eff[h] / max(rms(channels(Yc - (ftool if e.channel in "nt" else 0), e.channel)), 1e-9)
        for alt in e.alike if group in ("single", "pair", "outside", "weak") and h != "quantization" else ():
            if alt in others or (alt == "hertz-exponent" and base == "hunt-crossley"):
                continue
            Pa, Qa = put(P1, Q1, [f[:3] for f in FREE[alt] if abs(get(P1, Q1, f)) < 1e-12 and f[4] >= 0], np.array([0.3 * f[3] for f in FREE[alt] if abs(get(P1, Q1, f)) < 1e-12 and f[4] >= 0]))
            if alt == "friction-rounding":
                Pa[law.IX["fmode"]], Pa[law.IX["vr"]] = 2.0, 4e-3
            if alt == "stiffening-layer":
                Pa[law.IX["slB"]] = 0.5 * d
            if alt == "stiffness-inhomogeneity":
                continue
            Pa, Qa, _ = fit(in_frame(kin_t, ch), seen(Yc, ch, kin_t), Pa, Qa, others + [alt], weights[ch])
            rest = rms(channels(Yc - mdl(kin_t)(Pa, Qa), ch))
            if rest < max(0.5 * left[h], (0.5 if group == "outside" else 0.08) * eff[h]):
                near.append(alt)
    if group == "outside":
        near = sorted(set(near) | set(effs[hidden[0]].alike))
    allf = rms(L[:, :3])
    t, Y, tj = t_all, Y_all, t
    cols = {"t": t, **{f"q{i+1}": ql[:, i] for i in range(7)}}
    if dql is not None:
        cols.update({f"dq{i+1}": dql[:, i] for i in range(7)})
    cols.update({k: Y[:, i] for i, k in enumerate(("fx", "fy", "fz", "tx", "ty", "tz"))})
    if rng.random() < 0.65:
        cols["phase"] = np.array(path.ph)[np.clip((t / path.DT).astype(int), 0, len(path.ph) - 1)]
    v = lambda x: "[" + ", ".join(f"{float(i):.9g}" for i in x) + "]"
    rig = ['[robot]', 'model = "lwr4plus"', 'sensor_frame = "ft_sensor"', 'tip_frame = "tool_tip"', 'gravity = [0.0, 0.0, -9.81]', "", "[tool]",
           f"mass = {rig_tool.mass:.9g}", f"com = {v(rig_tool.com)}"] + ([f"inertia = {v(rig_tool.inertia)}"] if rig_tool.inertia.any() else []) + \
          ["", "[surface]", f"point = {v(plane[0])}", f"normal = {v(nrm)}", f"tangent = {v(t1)}", "", "[sensor]", "range = [40, 40, 120, 2, 2, 2]", f"noise = {v(noise)}", ""]
    params = {h: [{"name": i[1], "index": i[2], "value": i[3]} for i in items[h]] for h in hidden}
    if step:
        params["quantization"] = [{"name": "step", "index": -1, "value": step}]
    return dict(model=model, eff=eff, left=left, share=share, near=sorted(set(near)), unit="N·m" if effs and all(e.channel == "m" for e in effs.values()) else "N",
                left_forces=allf, cols=cols, rig="\n".join(rig), nuisances=nu, params=params, noise=rms(noise[:3]), true={k: float(Pt[law.IX[k]]) for k in law.NAMES if Pt[law.IX[k]]},
                fitted={f"{f[1]}": get(Pf, Qf, f) for m in model for f in FREE[m]}, style=style, peak=float(Fc[:, 0].max()), depth=float(dep.max()), seconds=float(t[-1]),
                debug=dict(Y=Y[::st], pr=Y[::st] - L, t=tj, touch=touch, kin=kin_l, clean=Yc))
