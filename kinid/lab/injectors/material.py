"""Effects of the material and of where its surface is."""

from __future__ import annotations

import numpy as np

from kinid.lab.injectors._common import Array, Injected, Injector, Truth, load, sign
from kinid.lab.materials import Field
from kinid.lab.setup import Setup


def _material(setup: Setup, truth: Truth, **changes: object) -> Injected:
    """What is planted holds everywhere, also where the property changed over the surface before."""
    fields = {name: field for name, field in setup.material.fields.items() if name not in changes}
    return setup.replace(material=setup.material.replace(**{"fields": fields, **changes})), truth


def _exponent(s: Setup, rng: np.random.Generator) -> Injected:
    n = float(rng.uniform(1.25, 1.7))
    base, gain = s.material, (0.5 * load(s)[0]) ** (s.material.exponent - n)  # as stiff at half depth as it was
    if "stiffness" in base.fields:

        def field(x: Array, y: Array) -> Array:
            return np.asarray(gain * base.at(x, y)["stiffness"])

        return _material(s, {"exponent": n}, exponent=n, fields={**base.fields, "stiffness": field})
    return _material(
        s, {"exponent": n, "stiffness": gain * base.stiffness}, exponent=n, stiffness=gain * base.stiffness
    )


def _damping(s: Setup, rng: np.random.Generator) -> Injected:
    usual = float(s.material.at(np.zeros(1), np.zeros(1))["damping"][0])
    c = float(rng.uniform(0.8, 2.0)) * max(5.0, usual)
    return _material(s, {"damping": c}, damping=c)


def _loss(s: Setup, rng: np.random.Generator) -> Injected:
    loss = float(rng.uniform(3.0, 8.0))
    return _material(s, {"damping": loss}, loss=loss)


def _relaxation(s: Setup, rng: np.random.Generator) -> Injected:
    ratio, tau = float(rng.uniform(0.2, 0.5)), float(np.exp(rng.uniform(np.log(0.2), np.log(1.5))))
    return _material(s, {"ratio": ratio, "time-constant": tau}, relaxation=((ratio, tau),))


def _hysteresis(s: Setup, rng: np.random.Generator) -> Injected:
    ratio, length = float(rng.uniform(0.1, 0.3)), float(rng.uniform(0.1, 0.3)) * 0.3 * load(s)[0]
    return _material(s, {"ratio": ratio, "length": length}, hysteresis=(ratio, length))


def _softening(s: Setup, rng: np.random.Generator) -> Injected:
    ratio, length = float(rng.uniform(0.2, 0.45)), float(rng.uniform(0.2, 0.5)) * load(s)[0]
    return _material(s, {"ratio": ratio, "length": length}, softening=(ratio, length))


def _adhesion(s: Setup, rng: np.random.Generator) -> Injected:
    force, length = float(rng.uniform(0.3, 0.9)), float(rng.uniform(4e-4, 1.2e-3))
    return _material(s, {"force": force, "length": length}, adhesion=(force, length))


def _layer(s: Setup, rng: np.random.Generator) -> Injected:
    depth, force = load(s)
    k, at = float(rng.uniform(0.6, 1.5)) * force / depth, float(rng.uniform(0.4, 0.65)) * depth
    return _material(s, {"stiffness": k, "depth": at}, layer=k, layer_depth=at)


def _drift(s: Setup, rng: np.random.Generator) -> Injected:
    rate = sign(rng) * float(rng.uniform(0.3, 0.8))
    return _material(s, {"rate": rate}, drift=rate)


def _inhomogeneity(s: Setup, rng: np.random.Generator) -> Injected:
    g1, g2 = (float(v) for v in rng.uniform(15.0, 50.0, 2) * rng.choice([-1.0, 1.0], 2))
    base = s.material

    def field(x: Array, y: Array) -> Array:
        return base.at(x, y)["stiffness"] * (1.0 + g1 * x + g2 * y)

    fields: dict[str, Field] = {**base.fields, "stiffness": field}
    return _material(s, {"gradient1": g1, "gradient2": g2}, fields=fields)


def _surface_offset(s: Setup, rng: np.random.Generator) -> Injected:
    offset = sign(rng) * float(rng.uniform(2e-4, 6e-4))
    return s.replace(surface_offset=offset), {"offset": offset}


def _surface_tilt(s: Setup, rng: np.random.Generator) -> Injected:
    a, b = (float(v) for v in rng.uniform(0.03, 0.08, 2) * rng.choice([-1.0, 1.0], 2))
    return s.replace(surface_slope=(a, b)), {"slope1": a, "slope2": b}


def _coupled(s: Setup, rng: np.random.Generator) -> Injected:
    depth, force = load(s)
    k = rng.uniform(0.05, 0.15, 2) * force / depth * rng.choice([-1.0, 1.0], 2)
    stiffness = np.zeros((3, 3))
    stiffness[0, 2], stiffness[1, 2] = k
    return _material(
        s, {"stiffness-1n": float(k[0]), "stiffness-2n": float(k[1])}, coupling=(stiffness, np.zeros((3, 3)))
    )


def _compliance(s: Setup, rng: np.random.Generator) -> Injected:
    c = float(rng.uniform(0.5e-4, 1.5e-4))
    return _material(s, {"compliance": c}, compliance=c)


def _friction(s: Setup, rng: np.random.Generator) -> Injected:
    mu = float(rng.uniform(0.3, 0.9))
    return _material(s, {"coefficient": mu}, friction=mu)


def _viscous(s: Setup, rng: np.random.Generator) -> Injected:
    c = float(rng.uniform(40.0, 120.0))
    return _material(s, {"damping": c}, viscous=c)


def _stribeck(s: Setup, rng: np.random.Generator) -> Injected:
    extra, speed = float(rng.uniform(0.06, 0.18)), float(rng.uniform(2.5e-3, 6e-3))
    return _material(s, {"coefficient": extra, "speed": speed}, stribeck=(extra, speed))


def _rounding(s: Setup, rng: np.random.Generator) -> Injected:
    speed = float(rng.uniform(2e-3, 8e-3))
    return _material(s, {"speed": speed}, rounding=speed)


def _presliding(s: Setup, rng: np.random.Generator) -> Injected:
    length = float(rng.uniform(5e-4, 1.5e-3))
    return _material(s, {"length": length}, bristle=length)


def _load_dependent(s: Setup, rng: np.random.Generator) -> Injected:
    p = -float(rng.uniform(0.2, 0.4))
    return _material(s, {"exponent": p}, load_exponent=p)


def _anisotropy(s: Setup, rng: np.random.Generator) -> Injected:
    a = sign(rng) * float(rng.uniform(0.15, 0.4))
    return _material(s, {"ratio": a}, anisotropy=a)


INJECTORS: dict[str, Injector] = {
    "hertz-exponent": _exponent,
    "viscous-damping": _damping,
    "hunt-crossley-damping": _loss,
    "relaxation": _relaxation,
    "hysteresis": _hysteresis,
    "stress-softening": _softening,
    "adhesion": _adhesion,
    "stiffening-layer": _layer,
    "surface-offset": _surface_offset,
    "stiffness-drift": _drift,
    "stiffness-inhomogeneity": _inhomogeneity,
    "surface-tilt": _surface_tilt,
    "coupled-stiffness": _coupled,
    "structural-compliance": _compliance,
    "coulomb-friction": _friction,
    "viscous-friction": _viscous,
    "stribeck-friction": _stribeck,
    "presliding": _presliding,
    "friction-rounding": _rounding,
    "load-dependent-friction": _load_dependent,
    "friction-anisotropy": _anisotropy,
}
