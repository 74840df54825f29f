"""The case table and the planned paths (poke, slide, press, drive). Depths and lengths m, times s."""
from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from arm import Path

Rng = np.random.Generator


@dataclass(frozen=True)
class Case:
    """kind, group, path script, model asked about, hidden effects, parameters of the chain, options."""
    kind: str
    group: str
    script: str
    model: str
    hidden: tuple[str, ...] = ()
    par: dict[str, tuple[float, float] | float] = field(default_factory=dict)
    near: tuple[str, ...] = ()
    alts: tuple[str, ...] = ()
    note: str = ""
    opt: dict[str, float] = field(default_factory=dict)


def draw(par: dict[str, tuple[float, float] | float], rng: Rng) -> dict[str, float]:
    return {k: float(rng.uniform(*v)) if isinstance(v, tuple) else float(v) for k, v in par.items()}


def start(rng: Rng) -> Path:
    return Path(s1=0.0, s2=0.0, h=0.02, a1=0.0, a2=0.0, a3=0.0).go(0.6, "free")


def touch(p: Path, rng: Rng, depth: float, t_in: float, hold: float, t_out: float, rest: float, **place: float) -> None:
    """One poke: above the place, in, hold, out, rest."""
    p.go(rng.uniform(0.6, 1.0), "free", h=0.006, **place).go(0.3, "approach", h=0.0015)
    p.go(t_in, "poke", h=-depth).go(hold, "hold").go(t_out, "retract", h=0.004).go(rest, "rest")


def pokes(rng: Rng, o: dict[str, float]) -> Path:
    """Pokes of several depths and speeds with holds, some tilted; free moves with small turns around them."""
    p, top, n = start(rng), o.get("depth", 0.0045), int(o.get("n", 7))
    spread, tilt = o.get("spread", 0.0), o.get("tilt", 0.0)
    p.go(0.8, "free", a1=o.get("turn", 0.15), h=0.035).go(0.8, "free", a1=0.0, a2=-o.get("turn", 0.15), h=0.03).go(0.6, "free", a2=0.0)
    depths = top * np.linspace(0.45, 1.0, n)[rng.permutation(n)]
    speeds = np.geomspace(0.1, 1.4, n)[rng.permutation(n)] * o.get("slow", 1.0)
    for d, T in zip(depths, speeds):
        th = {"a1": float(rng.uniform(-tilt, tilt)), "a2": float(rng.uniform(-tilt, tilt))} if tilt else {}
        touch(p, rng, float(d), float(T), o.get("hold", 0.6) * rng.uniform(0.5, 1.5), float(T * rng.uniform(0.8, 2)), o.get("rest", 0.4),
              s1=float(rng.uniform(-spread, spread)), s2=float(rng.uniform(-spread, spread)), **th)
    p.go(0.8, "free", h=0.03, a1=0.0, a2=0.0)
    if o.get("oscillate"):                     # oscillating about a depth: range of frequencies
        p.go(0.6, "free", h=0.003, s1=0.0, s2=0.0).go(0.5, "poke", h=-0.6 * top)
        for T in np.repeat([0.5, 0.25, 0.12, 0.08], 4):
            p.go(T / 2, "poke", h=-0.85 * top).go(T / 2, "poke", h=-0.45 * top)
        p.go(0.5, "retract", h=0.02)
    return p.go(0.6, "free")


def slides(rng: Rng, o: dict[str, float]) -> Path:
    """Strokes both ways along both tangents at several depths and speeds, small strokes too; one or two pokes before."""
    p, L = start(rng), o.get("length", 0.03)
    p.go(0.8, "free", a1=0.12, h=0.03).go(0.8, "free", a1=0.0, a2=0.12).go(0.5, "free", a2=0.0)
    top = o.get("depth", 0.0035)
    for d, T in ((0.6 * top, 0.25), (top, 0.8)):
        touch(p, rng, d, T, 0.4, T, 0.3)
    speeds = np.geomspace(o.get("slowest", 0.005), o.get("fastest", 0.06), int(o.get("speeds", 3)))
    for d in top * np.linspace(o.get("shallow", 0.4), 1.0, int(o.get("depths", 2))):
        p.go(0.5, "free", h=0.003, s1=0.0, s2=0.0).go(0.4, "approach", h=-d).go(0.3, "hold")
        for v in speeds[rng.permutation(len(speeds))]:
            ell = min(L, v * o.get("stroke_time", 1.1))
            both = not o.get("one_tangent")
            p.go(ell / v, "slide", 0.15, s1=ell).go(0.15, "hold").go(ell / v, "slide", 0.15, s1=0.0)
            if both:
                p.go(ell / v, "slide", 0.15, s2=ell).go(0.15, "hold").go(ell / v, "slide", 0.15, s2=0.0)
        if o.get("small"):
            for a in (0.0006, 0.0015, 0.003):
                for sgn in (1, -1, 1, -1):
                    p.go(0.35, "slide", 0.3, s1=sgn * a)
                p.go(0.35, "slide", 0.3, s1=0.0, s2=a).go(0.35, "slide", 0.3, s2=-a).go(0.35, "slide", 0.3, s2=0.0)
        p.go(0.6, "retract", h=0.012)
    return p.go(0.8, "free", h=0.025)


def turns(rng: Rng, o: dict[str, float]) -> Path:
    """Free turning and shaking in the air, then pokes and strokes."""
    p = start(rng).go(0.8, "free", h=0.06)
    for a1, a2, a3 in ((0.6, 0.0, 0.0), (0.0, 0.55, 0.3), (-0.5, 0.0, 0.0), (0.2, -0.6, -0.3), (0.0, 0.0, 0.0)):
        p.go(1.2, "free", a1=a1, a2=a2, a3=a3).go(0.4, "free")
    for sgn in (1, -1, 1, -1, 0):
        p.go(0.35, "free", h=0.06 + 0.02 * sgn, s1=0.03 * sgn)
    for d, T in ((0.003, 0.2), (0.0045, 0.6), (0.0035, 1.0)):
        touch(p, rng, d, T, 0.5, T, 0.3, a1=float(rng.uniform(-0.15, 0.15)), a2=float(rng.uniform(-0.15, 0.15)))
    p.go(0.6, "free", a1=0.0, a2=0.0, h=0.003).go(0.4, "approach", h=-0.003)
    for v in (0.01, 0.04):
        for s in ("s1", "s2"):
            p.go(0.025 / v, "slide", 0.15, **{s: 0.025}).go(0.025 / v, "slide", 0.15, **{s: 0.0})
    return p.go(0.5, "retract", h=0.02).go(0.5, "free")


def long_pokes(rng: Rng, o: dict[str, float]) -> Path:
    """Two and a half minutes of pokes, strokes and waits in the air."""
    p = start(rng)
    for k in range(int(o.get("n", 20))):
        touch(p, rng, float(rng.uniform(0.0025, 0.005)), float(rng.uniform(0.3, 1.5)), float(rng.uniform(0.5, 1.5)), float(rng.uniform(0.3, 1)), 0.3)
        if k % 4 == 0:
            p.go(0.5, "approach", h=-0.003).go(1.0, "slide", 0.2, s1=0.02).go(1.5, "slide", 0.2, s1=0.0).go(0.8, "slide", 0.2, s2=0.02)
            p.go(0.8, "slide", 0.2, s2=0.0).go(0.4, "retract", h=0.01)
        p.go(1.0, "free", h=0.03, a1=float(rng.uniform(-.2, .2)), a2=float(rng.uniform(-.2, .2))).go(1.2, "free", h=0.02, a1=0.0, a2=0.0)
    return p


def press(rng: Rng, o: dict[str, float]) -> Path:
    """Tester: cycles of growing and mixed depth and speed, holds, waits outside."""
    p, top, n = Path(h=0.001).go(1.0, "free"), o.get("depth", 0.005), int(o.get("n", 8))
    order = np.linspace(0.4, 1.0, n) if o.get("growing") else np.linspace(0.4, 1.0, n)[rng.permutation(n)]
    for d, T in zip(order, np.geomspace(0.12, 2.5, n)[rng.permutation(n)]):
        hold = o.get("hold", 0.5) * rng.uniform(0.6, 1.4)
        for _ in range(int(o.get("repeat", 1))):
            p.go(T, "poke", 0.25, h=-float(top * d)).go(hold, "hold").go(float(T * rng.uniform(0.8, 1.5)), "retract", 0.25, h=0.001)
            p.go(o.get("rest", 0.5), "rest")
    for T in np.geomspace(0.08, 0.8, 5):
        p.go(0.4, "poke", h=-0.6 * top)
        for _ in range(3):
            p.go(T, "poke", h=-0.9 * top).go(T, "poke", h=-0.5 * top)
        p.go(0.4, "retract", h=0.001).go(0.3, "rest")
    return p


def turning(rng: Rng, o: dict[str, float]) -> Path:
    """Drive: constant speeds both ways from slow to fast with full turns, sine-like moves, dwells. Angle rad."""
    p, top = Path(q=0.0).go(0.8, "rest"), o.get("top", 8.0)
    for v in np.geomspace(o.get("slowest", 0.15), top, int(o.get("n", 6)))[rng.permutation(int(o.get("n", 6)))]:
        a = float(np.clip(v * 2.0, 0.15, 14.0) * rng.uniform(0.8, 1.1))
        p.go(a / v, "move", 0.2, q=a).go(0.3, "rest").go(a / v, "move", 0.2, q=0.0).go(0.3, "rest")
    for T in (1.2, 0.8, 0.5, 0.4) * int(o.get("swings", 1)):
        p.go(T, "move", q=1.2).go(T, "move", q=-1.2)
    p.go(0.8, "move", q=0.0).go(0.5, "rest")
    for _ in range(int(o.get("again", 0))):
        for a in (6.0, -6.0, 12.0, 0.0):
            p.go(float(rng.uniform(1.5, 5)), "move", 0.2, q=a)
    return p


SCRIPTS = {f.__name__: f for f in (pokes, slides, turns, long_pokes, press, turning)}
KV = {"K": (1400.0, 2600.0), "C": (8.0, 20.0)}
HZ = {"K": (2.4e4, 4.5e4), "N": 1.5, "XR": (60.0, 90.0)}
FR = {"MU": (0.25, 0.5), "MB": (0.8e-4, 1.2e-4)}
P = {"oscillate": 1.0}


def table() -> list[Case]:
    """The 48 cases. Parameters as (low, high) ranges are drawn for each seed."""
    w, t, d, j = "wrench", "tester", "drive", "joints"
    jf = "rigid-body,joint-coulomb-friction,joint-viscous-friction"
    s, c = "single", "coulomb-friction"
    return [
        Case(w, s, "pokes", "hertz,viscous-damping", ("structural-compliance",), {**HZ, "C": (5, 12), "CS": (1.0e-4, 1.4e-4)}, alts=("hertz-exponent",),
             opt={**P, "depth": 0.006}),
        Case(w, s, "slides", "kelvin-voigt,coulomb-friction", ("presliding",), {**KV, "MU": (.35, .5), "MB": (6e-4, 9e-4)}, opt={"small": 1, "speeds": 2},
             alts=("friction-rounding", "stribeck-friction")),
        Case(w, s, "slides", "hertz,viscous-damping,coulomb-friction", ("load-dependent-friction",), {**HZ, "C": (5, 12), **FR, "LP": (-.36, -.3)},
             opt={"depths": 3, "shallow": 0.25}, note="Hertz contact of constant shear strength: T ~ N^(2/3)"),
        Case(w, s, "slides", "kelvin-voigt,coulomb-friction", ("friction-anisotropy",), {**KV, **FR, "AN": (.15, .3)}, note="fibrous surface"),
        Case(w, s, "slides", "kelvin-voigt,coulomb-friction", ("stiffness-inhomogeneity",),
             {**KV, **FR, "IA": (.35, .5), "IX": (.012, .016), "IW": (.004, .006), "EA": (.2, .3), "EX": (.026, .03), "EW": .002},
             opt={"length": 0.04, "small": 1, "stroke_time": 1.5}, note="buried inclusion and an edge along the first tangent"),
        Case(w, s, "pokes", "kelvin-voigt", ("tip-offset",), {**KV, "TX": (1e-3, 2e-3), "TY": (-2e-3, -1e-3)}, opt={"tilt": 0.25, "spread": .02},
             note="tilted pokes on a lubricated gel; tip bent sideways"),
        Case(w, s, "turns", "kelvin-voigt,coulomb-friction", ("tool-mass",), {**KV, **FR, "DM": (.03, .06)}, alts=("sensor-gain",)),
        Case(w, s, "turns", "hertz,viscous-damping,coulomb-friction", ("sensor-crosstalk",), {**HZ, "C": (5, 12), **FR, "X02": (.03, .05), "X12": (-.04, -.02), "X20": (.03, .06)},
             alts=("sensor-misalignment",)),
        Case(w, s, "pokes", "hertz,coulomb-friction", ("time-offset",), {**HZ, **FR, "TOFF": (.008, .014)}, opt={**P, "slow": 0.7},
             alts=("sensor-lag", "viscous-damping", "hunt-crossley-damping")),
        Case(w, s, "slides", "kelvin-voigt,coulomb-friction", ("stribeck-friction",), {**KV, **FR, "SM": (.12, .2), "SV": (5e-3, 9e-3)},
             opt={"speeds": 5, "slowest": 0.0015, "fastest": 0.08, "stroke_time": 1.1, "depths": 2, "step": 2e-6}, alts=("viscous-friction", "friction-rounding")),
        Case(t, s, "press", "kelvin-voigt", ("relaxation",), {**KV, "R1": (.3, .5), "T1": (.4, .9), "R2": (.01, .02), "T2": 6.0}, opt={"hold": 1.6, "n": 5, "rest": 1.6},
             alts=("hysteresis",), note="Prony series, a second small branch of 6 s as nuisance"),
        Case(t, s, "press", "kelvin-voigt", ("stress-softening",), {**KV, "MR": (.25, .4), "ML": (6e-4, 1.2e-3)}, opt={"growing": 1, "repeat": 2, "n": 5, "hold": 0.3, "rest": 0.3}, alts=("hysteresis",),
             note="Ogden-Roxburgh softening"),
        Case(t, s, "press", "hertz,viscous-damping", ("adhesion",), {**HZ, "C": (3, 6), "AF": (.3, .5), "AL": (4e-4, 7e-4)}, opt={"depth": .003},
             alts=("surface-offset",), note="DMT pull with a Dugdale tail after separation"),
        Case(t, s, "press", "kelvin-voigt", ("stiffening-layer",), {**KV, "LK": (1500, 3000), "LB": (2.6e-3, 3.3e-3)}, alts=("hertz-exponent",)),
        Case(t, s, "press", "kelvin-voigt", ("hysteresis",), {**KV, "C": (2, 4), "HA": (.5, .8), "HL": (3e-4, 6e-4)}, alts=("relaxation",), note="Bouc-Wen loop of fixed amplitude"),
        Case(t, s, "press", "hertz", ("hunt-crossley-damping",), {**HZ, "LAM": (1.3, 2.0)}, alts=("viscous-damping",)),
        Case(d, s, "turning", jf, ("joint-torque-ripple",), {"amp": (.25, .4)}, note="sin(3q) and its half-strong second harmonic"),
        Case(d, s, "turning", jf, ("joint-stribeck-friction",), {"amp": (.6, .9)}, opt={"slowest": .03, "n": 9}),
        Case(d, s, "turning", jf, ("joint-spring",), {"amp": (.06, .1)}, note="coiled cable"),
        Case(j, s, "excite", jf, ("payload",), {"amp": (.8, 1.4)}, alts=()),
        Case(j, s, "excite", jf, ("rotor-inertia",), {"amp": (.6, 1.0)}),
        Case(j, s, "excite", jf, ("joint-load-friction",), {"amp": (.08, .12)}, note="(Fc + b|tau|) sign(dq); small motor-side gear loss"),
        Case(w, "none", "pokes", "kelvin-voigt,coulomb-friction", (), {**KV, **FR, "FT": 1.0}, opt={**P, "spread": .02}),
        Case(w, "none", "slides", "hertz,viscous-damping,coulomb-friction", (), {**HZ, "C": (6, 14), **FR, "FT": 3.0}, opt={"depth": .003},
             note="five-element partial slip (Mindlin/Iwan) of 0.1 mm mean length"),
        Case(w, "none", "slides", "hunt-crossley,coulomb-friction,presliding", (), {**HZ, "LAM": (.3, .6), "MU": (.3, .5), "MB": (5e-4, 9e-4)}, opt={"small": 1, "depth": .003}),
        Case(w, "none", "pokes", "kelvin-voigt,coulomb-friction,relaxation", (), {**KV, **FR, "R1": (.3, .5), "T1": (.5, .9)}, opt={"hold": 2.0, "rest": 1.5, "n": 5}),
        Case(t, "none", "press", "hunt-crossley", (), {**HZ, "LAM": (.4, .9)}, opt={"depth": .004}),
        Case(t, "none", "press", "zener", (), {"K": (1400, 2200), "R1": (.3, .5), "T1": (.5, .9)}, opt={"hold": 1.5, "n": 6, "rest": 2.0}),
        Case(d, "none", "turning", jf + ",joint-friction-asymmetry", (), {"amp": .15}),
        Case(j, "none", "excite", jf, ()),
        Case(j, "none", "excite", jf + ",rotor-inertia,joint-torque-offset", (), {"amp": (.3, .6)}),
        Case(w, "pair", "slides", "kelvin-voigt,coulomb-friction", ("hertz-exponent", "viscous-friction"), {"K": (1.2e4, 2e4), "N": (1.35, 1.45), "C": (8, 16), **FR, "CV": (9, 14)},
             opt={"fastest": .09, "length": .05, "depths": 3}, note="user assumes a flat punch, the tip is round on a thin layer"),
        Case(w, "pair", "pokes", "kelvin-voigt", ("relaxation", "surface-offset"), {**KV, "R1": (.35, .6), "T1": (.5, 1.0), "Z0": (4e-4, 7e-4)},
             opt={"hold": 2.0, "rest": 1.5, "n": 6}),
        Case(w, "pair", "long_pokes", "kelvin-voigt,coulomb-friction", ("stiffness-drift", "sensor-bias"),
             {**KV, **FR, "KD": (-.12, -.08), "B0": (.2, .4), "B1": (-.4, -.2), "B2": (.3, .5), "B3": (.004, .01), "B4": (-.01, -.004), "B5": .003},
             note="warming gel; sensor not zeroed"),
        Case(t, "pair", "press", "hertz", ("viscous-damping", "saturation"), {**HZ, "K": (3e4, 4e4), "C": (14, 24), "SAT": (7.0, 8.0)}, opt={"depth": .005}),
        Case(t, "pair", "press", "kelvin-voigt", ("hertz-exponent", "mains-hum"), {"K": (1.4e4, 2e4), "N": (1.3, 1.45), "C": (8, 16), "HUM": (.12, .2), "HPH": (0, 3)}),
        Case(d, "pair", "turning", jf, ("joint-friction-asymmetry", "joint-torque-ripple"), {"amp": .3, "amp2": (.25, .4)}, near=("joint-torque-offset",)),
        Case(j, "pair", "excite", jf, ("joint-torque-gain", "joint-friction-asymmetry"), {"amp": (.06, .1), "amp2": (.3, .4)}, near=("joint-torque-offset",)),
        Case(w, "outside", "turns", "kelvin-voigt,coulomb-friction", ("cable",), {**KV, **FR, "CAB": (12, 20)}, near=("sensor-bias", "tool-mass", "tool-com"),
             note="a hose pulls the tool from an anchor beside the place: slack below 0.14 m, then a spring"),
        Case(w, "outside", "slides", "kelvin-voigt,coulomb-friction", ("run-in",), {**KV, **FR, "RI": (1.2, 1.8), "RS": (.1, .2)},
             near=("stribeck-friction", "viscous-friction", "load-dependent-friction", "friction-anisotropy"),
             note="friction runs in: mu(1 + b exp(-travel/0.1..0.2 m)); a film wears off"),
        Case(t, "outside", "press", "kelvin-voigt", ("puncture",), {**KV, "PL": (.3, .4)}, near=("stress-softening", "stiffness-drift"),
             note="the skin tears once: stiffness drops for good in the middle of a press"),
        Case(d, "outside", "turning", jf, ("warm-up",), {"amp": (2.0, 3.0)}, near=("joint-viscous-friction", "joint-stribeck-friction", "joint-torque-gain"), opt={"again": 3, "swings": 2},
             note="grease warms: viscous and Coulomb friction fall exponentially with run time"),
        Case(d, "outside", "turning", jf, ("windage",), {"amp": (.03, .04)}, near=("joint-stribeck-friction", "joint-load-friction"), note="fan load: torque ~ dq|dq|"),
        Case(j, "outside", "excite", jf, ("eccentric-friction",), {"amp": (.8, .95)}, near=("joint-torque-ripple", "joint-load-friction", "joint-spring"),
             note="friction modulated by the joint's angle (eccentric wave generator): Fc(1 + e cos(q - q_e)) sign(dq)"),
        Case(w, "weak", "turns", "kelvin-voigt,coulomb-friction", ("sensor-drift",), {**KV, **FR, "D0": .1, "D1": -.1, "D2": .2}),
        Case(t, "weak", "press", "hertz", ("viscous-damping",), {**HZ, "C": 2.0}),
        Case(w, "unexcited", "pokes", "hooke", ("structural-compliance",), {"K": (1400.0, 2600.0), "CS": 8e-5}, opt={"slow": 1.5},
             note="a linear contact behind a linear compliance is a softer linear contact: k/(1 + kC)"),
        Case(j, "unexcited", "excite", jf, ("rotor-inertia",), {"amp": .2}, opt={"slow": 1}, note="slow motion: acceleration too small to show inertia"),
    ]
