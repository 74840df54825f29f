"""Amplitudes of hidden effects: ranges that real materials and machines have, the shape values that go with them, and which models lack them.
An effect's strength is one number a, tuned until the best refit without the effect leaves what is wanted."""
from __future__ import annotations

import numpy as np

from laws import BASES, JOINT, NORMAL, SENSOR, TANGENTIAL, TOOL
from measure import logu

FLAT = {"kelvin-voigt", "hooke", "zener"}

# lowest, first and largest amplitude
RANGE = {
    "hertz-exponent": (0.02, 0.15, 0.9), "viscous-damping": (1, 25, 600), "hunt-crossley-damping": (0.1, 1.5, 40), "relaxation": (0.01, 0.15, 0.8),
    "hysteresis": (0.02, 0.4, 6), "stress-softening": (0.01, 0.15, 0.75), "adhesion": (0.02, 0.4, 6), "stiffening-layer": (0.05, 0.6, 12),
    "surface-offset": (2e-5, 3e-4, 2.5e-3), "stiffness-drift": (0.01, 0.12, 0.9), "stiffness-inhomogeneity": (0.02, 0.15, 0.8),
    "coulomb-friction": (0.01, 0.1, 0.9), "viscous-friction": (0.3, 8, 300), "stribeck-friction": (0.01, 0.1, 0.4), "presliding": (2.5e-4, 1e-3, 1e-2),
    "friction-rounding": (1.5e-3, 5e-3, 0.15), "load-dependent-friction": (0.03, 0.2, 0.9), "friction-anisotropy": (0.02, 0.15, 0.7),
    "tool-mass": (3e-3, 0.04, 0.6), "tool-com": (2e-4, 4e-3, 0.05), "tool-inertia": (1e-4, 1.5e-3, 0.02), "structural-compliance": (0.01, 0.12, 0.7),
    "tip-offset": (1e-4, 1.5e-3, 0.015), "sensor-bias": (0.02, 0.4, 8), "sensor-drift": (0.03, 0.5, 10), "sensor-crosstalk": (0.003, 0.03, 0.2),
    "sensor-misalignment": (0.004, 0.04, 0.25), "sensor-gain": (0.01, 0.06, 0.4), "sensor-lag": (2e-3, 0.015, 0.15), "time-offset": (2e-3, 0.012, 0.1),
    "saturation": (0.03, 0.25, 0.65), "quantization": (0.01, 0.4, 6), "mains-hum": (0.01, 0.2, 6),
}


def shape(rng, name, ctx):
    """Random values that go with an effect but aren't its amplitude. ctx: dmax, tester (bool), T (seconds)."""
    d = ctx["dmax"]
    sg = float(rng.choice([-1, 1]))
    if name == "relaxation":
        return dict(tau=logu(rng, 0.25, 2.5))
    if name == "hysteresis":
        return dict(hl=d * rng.uniform(0.06, 0.15), hexp=rng.uniform(0.85, 1.2))
    if name == "stress-softening":
        return dict(ml=d * rng.uniform(0.12, 0.4))
    if name == "adhesion":
        return dict(al=logu(rng, 4e-4, 1.5e-3))
    if name == "stiffening-layer":
        return dict(ld=d * rng.uniform(0.45, 0.65), lr=0.02 * d * rng.random())
    if name == "hertz-exponent":
        return dict(sign=1.0)
    if name == "stiffness-inhomogeneity":
        kind = str(rng.choice(["gradient", "edge", "inclusion"]))
        return dict(kind=kind, sign=sg, angle=rng.uniform(-0.6, 0.6), width=rng.uniform(3e-3, 6e-3), at=rng.uniform(-5e-3, 5e-3),
                    place=(rng.uniform(-0.01, 0.01), rng.uniform(-4e-3, 4e-3)), radius=rng.uniform(7e-3, 12e-3))
    if name == "stribeck-friction":
        return dict(vs=logu(rng, 5e-3, 1.5e-2))
    if name == "sensor-crosstalk":
        X = np.zeros((6, 6))
        X[:3, :3] = rng.uniform(-1, 1, (3, 3))
        X[3:, 3:] = rng.uniform(-1, 1, (3, 3))
        X[3:, :3] = 0.02 * rng.uniform(-1, 1, (3, 3)) * (rng.random() < 0.5)
        X[:3, :3] = np.where(np.abs(X[:3, :3]) < 0.3, 0, X[:3, :3])
        np.fill_diagonal(X, 0)
        X[0, 2] = sg
        return dict(X=X)
    if name in ("sensor-misalignment", "tool-com", "tip-offset"):
        v = rng.normal(size=3)
        if name == "tip-offset":
            v[2] *= 0.2
        return dict(dir=v / np.linalg.norm(v))
    if name in ("sensor-bias", "sensor-drift"):
        v = rng.uniform(-1, 1, 6)
        v[3:] *= 0.04
        v[2] = sg * max(abs(v[2]), 0.6)
        return dict(dir=v)
    if name == "tool-inertia":
        return dict(ratio=(1.0, rng.uniform(0.6, 1.0), rng.uniform(0.15, 0.5)))
    if name == "mains-hum":
        n = 6 if not ctx.get("tester") else 3
        sc = np.array([1, 1, 1, 0.03, 0.03, 0.03])[:n] * rng.uniform(0.3, 1, n)
        return dict(f=float(rng.choice([50.0, 60.0])) + rng.uniform(-0.04, 0.04), amp=[sc, sc * rng.uniform(0, 0.5, n), sc * rng.uniform(0, 0.3, n)],
                    phase=[rng.uniform(0, 6.28, n) for _ in range(3)])
    if name == "saturation":
        return dict(behind=bool(rng.random() < 0.5))
    if name == "tool-mass":
        return dict(sign=sg)
    return dict(sign=sg)


def base_for(rng, hidden):
    """A contact law such that the hidden effects are in the plain forms' reach."""
    h = set(hidden)
    if "viscous-damping" in h:
        return "hooke"
    if "hunt-crossley-damping" in h:
        return "hertz" if "hysteresis" not in h and "adhesion" not in h else "hooke"
    if "hertz-exponent" in h:
        return str(rng.choice(["kelvin-voigt", "hooke"]))
    if "structural-compliance" in h:
        return str(rng.choice(["hertz", "hunt-crossley"]))
    if h & {"hysteresis", "adhesion", "stiffening-layer"}:
        return str(rng.choice(["kelvin-voigt", "kelvin-voigt", "hooke"]))
    if "relaxation" in h:
        return str(rng.choice(["kelvin-voigt", "hunt-crossley"]))
    return str(rng.choice(["kelvin-voigt", "kelvin-voigt", "hunt-crossley", "hunt-crossley", "zener", "hooke", "hertz"]))


def contact_parameters(rng, base, dmax):
    """Engine parameters of a base law."""
    n = BASES[base]
    Fmax = rng.uniform(9, 28)
    p = dict(k=Fmax / dmax ** n, n=n, Fmax=Fmax)
    if base == "kelvin-voigt":
        p["eta"] = rng.uniform(0.003, 0.02) * Fmax / dmax
    if base == "hunt-crossley":
        p["lam"] = rng.uniform(0.6, 4)
    if base == "zener":
        p["r1"], p["tau1"] = rng.uniform(0.15, 0.45), logu(rng, 0.3, 2.5)
    return p


def apply_contact(cp, name, a, sh):
    """Write an effect of the material into the engine's parameters."""
    d = cp["dmax"]
    if name == "hertz-exponent":
        cp["n"] = 1.0 + a
        cp["k"] = cp["Fmax"] / d ** cp["n"]
    elif name == "viscous-damping":
        cp["eta"] = a
    elif name == "hunt-crossley-damping":
        cp["lam"] = a
    elif name == "relaxation":
        cp["r1"], cp["tau1"] = a, sh["tau"]
    elif name == "hysteresis":
        cp.update(ha=a, hl=sh["hl"], hexp=sh["hexp"])
    elif name == "stress-softening":
        cp.update(mr=a, ml=sh["ml"])
    elif name == "adhesion":
        cp.update(fa=a, al=sh["al"])
    elif name == "stiffening-layer":
        cp.update(lk=a * cp["Fmax"] / d, ld=sh["ld"], lr=sh["lr"])
    elif name == "stiffness-drift":
        cp["drift"] = a * sh["sign"] if a < 0.5 else a
    elif name == "stiffness-inhomogeneity":
        b = a * sh["sign"]
        if sh["kind"] == "gradient":
            cp.update(pg1=b * np.cos(sh["angle"]) / 0.03, pg2=b * np.sin(sh["angle"]) / 0.03)
        elif sh["kind"] == "edge":
            cp.update(pe=b if b > 0 else b * 0.8, pe0=sh["at"], pew=sh["width"], pea=sh["angle"])
        else:
            cp.update(pi=b if b > 0 else b * 0.8, pi1=sh["place"][0], pi2=sh["place"][1], pir=sh["radius"])
    elif name == "structural-compliance":
        cp["cs"] = a * d / cp["Fmax"]
    elif name == "coulomb-friction":
        cp["mu"] = a
    elif name == "viscous-friction":
        cp["cv"] = a
    elif name == "stribeck-friction":
        cp.update(dmu=a, vs=sh["vs"])
    elif name == "presliding":
        cp["bl"] = a
        cp["fmode"] = "dahl" if cp["fmode"] == "rounded" else cp["fmode"]
    elif name == "friction-rounding":
        cp.update(fmode="rounded", vr=a)
    elif name == "load-dependent-friction":
        cp.update(p=a * sh["sign"], n0=0.4 * cp["Fmax"])
    elif name == "friction-anisotropy":
        cp["ani"] = a * sh["sign"]
    else:
        return False
    return True


def apply_sensor(sens, name, a, sh, C, peak):
    if name == "sensor-bias":
        sens["bias"] = sens.get("bias", 0) + a * sh["dir"][:C] * (1 if C == 6 else np.r_[sh["dir"][2], sh["dir"][:2]][:C] / sh["dir"][:C])
    elif name == "sensor-drift":
        sens["drift"] = a * (sh["dir"] if C == 6 else np.r_[sh["dir"][2], sh["dir"][:2]][:C])
    elif name == "sensor-crosstalk":
        X = np.asarray(sh["X"]).copy()
        sens["cross"] = a * X if C == 6 else a * X[:C, :C]
    elif name == "sensor-misalignment":
        sens["mis"] = a * sh["dir"]
    elif name == "sensor-gain":
        sens["gain"] = a * sh["sign"]
    elif name == "sensor-lag":
        sens["lag"] = a
    elif name == "time-offset":
        sens["dt"] = a * sh["sign"]
    elif name == "saturation":
        c = int(np.argmax(peak[:3]))
        sens.update(sat=float(peak[c] * (1 - a)), sat_channel=c, sat_noise_behind=sh["behind"])
    elif name == "quantization":
        sens["step"] = a * (np.array([1, 1, 1, 0.03, 0.03, 0.03])[:C] if C == 6 else 1.0)
    elif name == "mains-hum":
        sens["hum"] = dict(f=sh["f"], amp=[a * np.asarray(x)[:C] for x in sh["amp"]], phase=[np.asarray(x)[:C] for x in sh["phase"]])
    else:
        return False
    return True


STAGE = {**{e: "normal" for e in NORMAL}, **{e: "tangential" for e in TANGENTIAL}, **{e: "tool" for e in TOOL}, **{e: "sensor" for e in SENSOR},
         **{e: "joint" for e in JOINT}}
