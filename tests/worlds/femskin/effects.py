"""The effects this world can hide: their parameters, strengths, channels and rivals; and what lies outside the catalogue."""
from __future__ import annotations

from dataclasses import dataclass
from typing import Callable

import numpy as np

@dataclass(frozen=True)
class Effect:
    """`make(a, u, c)`: parameters at strength a with fixed random u in 0..1 (8) and context c; channels: n, t, f, m, z."""
    free: tuple[str, ...]
    make: Callable
    lo: float
    hi: float
    channel: str
    kinds: str                   # w, t
    bases: tuple[str, ...]       # asked bases that go with it
    rivals: tuple[str, ...] = ()
    style: tuple[str, ...] = ()  # needs of the motion

ANY = ("hooke", "kelvin-voigt", "hertz", "hunt-crossley", "zener")
sg = lambda x: 1.0 if x > 0.5 else -1.0
vec = lambda u, n: (lambda x: x / np.linalg.norm(x))(np.array([2 * u[i] - 1 + 0.01 for i in range(n)]))
XK = tuple(f"x{i}{j}" for b in (0, 3) for i in range(b, b + 3) for j in range(b, b + 3) if i != j)
B6, K6 = tuple(f"b{j}" for j in range(6)), tuple(f"k{j}" for j in range(6))

def _axis(keys, scale=1.0):
    return lambda a, u, c: {k: a * scale * x for k, x in zip(keys, vec(u, len(keys)))}

def _wrench(keys, torque=0.03):
    """Force part and, at `torque` m, torque part (six values for an arm, three for a tester)."""
    def make(a, u, c):
        out = {k: a * x for k, x in zip(keys[:3], np.array([1, 1, 1.0]) * [sg(u[i]) * (0.5 + 0.5 * u[i + 3]) for i in range(3)])}
        if c["arm"]: out |= {k: a * torque * x for k, x in zip(keys[3:], vec(u, 3))}
        return out
    return make

EFFECTS: dict[str, Effect] = {
    "relaxation": Effect(("r1", "tau1"), lambda a, u, c: dict(r1=a, tau1=0.4 + 1.4 * u[0]) | (dict(r2=0.5 * a, tau2=6.0) if u[1] > 0.5 else {}),
                         0.08, 0.9, "n", "wt", ANY[:4], ("hysteresis", "viscous-damping", "hunt-crossley-damping", "stiffness-drift"), ("hold",)),
    "hysteresis": Effect(("A", "LA"), lambda a, u, c: dict(A=a, LA=3e-4 + 5e-4 * u[0]), 0.1, 3, "n", "wt", ANY[:4],
                         ("relaxation", "stress-softening", "viscous-damping", "adhesion"), ("loops", "hold")),
    "stress-softening": Effect(("rho", "Lm"), lambda a, u, c: dict(rho=a, Lm=1e-3 + 1.2e-3 * u[0]), 0.1, 0.6, "n", "wt", ANY[:4],
                               ("stiffness-drift", "hysteresis", "relaxation"), ("pokes", "repeat")),
    "adhesion": Effect(("Fa", "La"), lambda a, u, c: dict(Fa=a, La=3e-4 + 6e-4 * u[0]), 0.2, 3, "n", "wt", ANY[:4],
                       ("surface-offset", "sensor-bias"), ("slow-retract",)),
    "stiffening-layer": Effect(("K", "db"), lambda a, u, c: dict(K=a * c["F0"] / 3.4375e-3, db=2.2e-3 + 1.6e-3 * u[0], wk=c["wk"]), 0.2, 3, "n",
                               "wt", ANY, ("hertz-exponent",), ("depths",)),
    "surface-offset": Effect(("z0",), lambda a, u, c: dict(z0=a * sg(u[0])), 8e-5, 9e-4, "n", "wt", ANY,
                             ("tip-offset", "hertz-exponent", "sensor-bias"), ("depths",)),
    "stiffness-drift": Effect(("alpha",), lambda a, u, c: dict(alpha=-a * sg(u[0] + 0.1)), 0.03, 0.9, "n", "wt", ANY,
                              ("relaxation", "stress-softening"), ("repeat",)),
    "stiffness-inhomogeneity": Effect(("inh",), lambda a, u, c: dict(inh=a), 0.08, 0.6, "n", "wt", ANY, ("stiffness-drift",), ("across",)),
    "hertz-exponent": Effect(("dn",), lambda a, u, c: {}, 1, 1, "n", "wt", ("kelvin-voigt", "hertz"),
                             ("stiffening-layer", "surface-offset", "structural-compliance"), ("depths",)),
    "viscous-damping": Effect(("c",), lambda a, u, c: dict(c=a), 8, 90, "n", "wt", ("hooke", "hertz"),
                              ("hunt-crossley-damping", "relaxation"), ("fast",)),
    "hunt-crossley-damping": Effect(("lam",), lambda a, u, c: dict(lam=a), 1, 10, "n", "wt", ("hertz", "kelvin-voigt", "hooke"),
                                    ("viscous-damping", "relaxation"), ("fast",)),
    "presliding": Effect(("ell",), lambda a, u, c: dict(ell=a), 2.5e-4, 3e-3, "t", "wt", ANY, ("friction-rounding",), ("slide", "micro")),
    "stribeck-friction": Effect(("dmu", "vs"), lambda a, u, c: dict(dmu=a, vs=6e-3 + 8e-3 * u[0]), 0.08, 0.6, "t", "wt", ANY,
                                ("viscous-friction", "friction-rounding"), ("slide", "speeds")),
    "viscous-friction": Effect(("cv",), lambda a, u, c: dict(cv=a), 4, 80, "t", "wt", ANY, ("stribeck-friction", "load-dependent-friction"),
                               ("slide", "speeds")),
    "load-dependent-friction": Effect(("p",), lambda a, u, c: dict(p=-a), 0.1, 0.5, "t", "wt", ANY, ("viscous-friction",), ("slide", "loads")),
    "friction-anisotropy": Effect(("aniso",), lambda a, u, c: dict(aniso=a * sg(u[0])), 0.06, 0.4, "t", "wt", ANY, ("sensor-crosstalk",), ("slide",)),
    "friction-rounding": Effect(("vr",), lambda a, u, c: dict(vr=a), 2e-3, 2.5e-2, "t", "wt", ANY, ("presliding", "viscous-friction"),
                                ("slide", "speeds", "micro")),
    "tool-mass": Effect(("m",), lambda a, u, c: dict(m=c["m"] + a * sg(u[0] + 0.2)), 0.02, 0.2, "f", "w", ANY, ("sensor-gain", "sensor-bias"), ("orient",)),
    "tool-com": Effect(("cx", "cy", "cz"), lambda a, u, c: {f"c{k}": c["com"][i] + a * x for i, (k, x) in enumerate(zip("xyz", vec(u, 3)))},
                       2e-3, 3e-2, "m", "w", ANY, ("sensor-misalignment", "sensor-bias", "tip-offset"), ("orient",)),
    "sensor-bias": Effect(B6, _wrench(B6), 0.08, 2, "f", "wt", ANY, ("tool-mass", "surface-offset", "adhesion"), ("orient",)),
    "sensor-drift": Effect(K6, _wrench(K6), 0.1, 4, "f", "wt", ANY, ("sensor-bias", "stiffness-drift"), ("orient", "repeat")),
    "sensor-gain": Effect(("gain",), lambda a, u, c: dict(gain=a * sg(u[0])), 0.03, 0.2, "f", "w", ANY, ("tool-mass",), ("orient", "heavy")),
    "sensor-lag": Effect(("lag",), lambda a, u, c: dict(lag=a), 4e-3, 6e-2, "f", "wt", ANY, ("time-offset",), ("fast",)),
    "time-offset": Effect(("toff",), lambda a, u, c: dict(toff=a * sg(u[0] + 0.2)), 4e-3, 6e-2, "f", "wt", ANY, ("sensor-lag",), ("fast",)),
    "saturation": Effect(("sat",), lambda a, u, c: dict(sat=c["peak"] * (1 - a)), 0.2, 0.55, "n", "wt", ANY, (), ("depths",)),
    "quantization": Effect(("step",), lambda a, u, c: dict(step=a), 0.1, 1.5, "f", "wt", ANY),
    "mains-hum": Effect(("hum",), lambda a, u, c: dict(hum=a, hf=50.0 if u[0] > 0.4 else 60.0, hph=6 * u[1]), 0.06, 0.9, "f", "wt", ANY),
    "sensor-misalignment": Effect(("ex", "ey", "ez"), _axis(("ex", "ey", "ez")), 0.01, 0.12, "f", "w", ANY, ("sensor-crosstalk",), ("orient", "slide")),
    "sensor-crosstalk": Effect(XK, lambda a, u, c: {XK[int(6 * u[0])]: a, XK[int(6 * u[1])]: -0.8 * a, XK[6 + int(6 * u[2])]: a}, 0.01, 0.12, "f", "w",
                               ANY, ("sensor-misalignment",), ("orient", "slide")),
    "tip-offset": Effect(("ox", "oy", "oz"), _axis(("ox", "oy", "oz")), 4e-4, 6e-3, "m", "w", ANY,
                         ("sensor-crosstalk", "sensor-misalignment", "tool-com"), ("tilt", "slide")),
    "structural-compliance": Effect(("C",), lambda a, u, c: dict(C=a), 1e-5, 1.2e-4, "n", "w", ("hertz",), ("hertz-exponent", "surface-offset"),
                                    ("depths",)),
}

OUTSIDE: dict[str, tuple[Effect, str]] = {
    "surface breathes (0.2 to 0.45 Hz)": (Effect((), lambda a, u, c: dict(breath=a, bf=0.2 + 0.25 * u[0], bph=6 * u[1]), 5e-5, 8e-4, "n", "wt", ANY[:4],
                                                ("surface-offset", "stiffness-drift", "relaxation", "hysteresis"), ("hold",)), "n"),
    "fixture rings after each touch": (Effect((), lambda a, u, c: dict(T0=a, zeta=0.01 + 0.02 * u[0]), 0.03, 0.35, "n", "wt", ANY[:4],
                                             ("sensor-lag", "time-offset"), ("fast", "hold")), "n"),
    "friction runs in with the distance slid": (Effect((), lambda a, u, c: dict(run=a, S0=0.2 + 0.3 * u[0]), 0.2, 2.5, "t", "wt", ANY,
                                                      ("load-dependent-friction", "viscous-friction", "stribeck-friction"), ("slide",)), "t"),
    "sticky half of the surface (friction over place)": (Effect((), lambda a, u, c: dict(patch=a, px=4e-3 * u[0]), 0.2, 1.5, "t", "wt", ANY,
                                                               ("friction-anisotropy", "load-dependent-friction"), ("slide",)), "t"),
    "hose pulls at the tool": (Effect((), lambda a, u, c: dict(hose=a), 2, 90, "f", "w", ANY,
                                     ("sensor-bias", "tool-mass", "tool-com", "sensor-misalignment", "sensor-crosstalk", "sensor-gain", "sensor-drift"),
                                     ("orient", "roam")), "f"),
    "torsional friction of the contact patch": (Effect((), lambda a, u, c: dict(spin=a), 5e-4, 8e-3, "z", "w", ANY,
                                                      ("tip-offset", "sensor-crosstalk", "sensor-misalignment"), ("twist",)), "z"),
    "nap: normal force depends on the sliding direction": (Effect((), lambda a, u, c: dict(nap=a * sg(u[0])), 0.04, 0.35, "n", "t", ANY,
                                                                 ("sensor-crosstalk", "sensor-misalignment", "stiffness-inhomogeneity"), ("slide",)), "n"),
    "snap-through of a shell, with two thresholds": (Effect((), lambda a, u, c: dict(snap=a, d1=2.8e-3 + 8e-4 * u[0], d2=1.4e-3 + 6e-4 * u[1]), 0.1, 0.5,
                                                           "n", "wt", ANY[:4], ("hysteresis", "stress-softening", "stiffening-layer", "relaxation"),
                                                           ("loops", "depths")), "n"),
    "attraction over a gap (magnet)": (Effect((), lambda a, u, c: dict(Fm=a, g0=1.5e-3 + 2e-3 * u[0]), 0.3, 4, "n", "wt", ANY[:4],
                                             ("adhesion", "surface-offset", "sensor-bias"), ("slow-retract",)), "n"),
}

PAIRS = [("w", "relaxation", "stribeck-friction"), ("t", "hysteresis", "friction-anisotropy"), ("w", "tool-mass", "viscous-damping"),
         ("t", "viscous-damping", "mains-hum"), ("w", "sensor-bias", "relaxation"), ("t", "stress-softening", "sensor-bias"),
         ("w", "tip-offset", "hunt-crossley-damping"), ("t", "surface-offset", "load-dependent-friction"), ("w", "sensor-drift", "friction-anisotropy"),
         ("t", "stiffening-layer", "viscous-friction"), ("w", "load-dependent-friction", "relaxation"), ("t", "relaxation", "presliding"),
         ("w", "tool-com", "viscous-friction"), ("t", "hertz-exponent", "stribeck-friction"), ("w", "stiffness-inhomogeneity", "tool-mass"),
         ("t", "sensor-lag", "stribeck-friction"), ("w", "hertz-exponent", "friction-anisotropy"), ("t", "stiffness-drift", "adhesion")]

UNEXCITED = [("t", "load-dependent-friction", ("slide", "one-load")), ("w", "friction-anisotropy", ("slide", "one-way")),
             ("t", "stiffening-layer", ("shallow",)), ("w", "structural-compliance", ("hooke",)), ("w", "stiffness-inhomogeneity", ("pokes",)),
             ("t", "viscous-friction", ("slide", "one-load", "one-speed")), ("w", "stiffening-layer", ("shallow",))]
