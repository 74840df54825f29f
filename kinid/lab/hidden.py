"""A hidden effect: planted in a set-up with a plausible size, by seed; what was planted is told to the truth alone."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from kinid.controllers._given import closest
from kinid.data.rig import ToolSpec
from kinid.errors import InputError
from kinid.lab.materials import SURFACE, Field, Patch
from kinid.lab.setup import Setup, together

Array = NDArray[np.float64]
Truth = dict[str, object]
Planted = tuple[Setup, Truth]
#: name of a parameter, and its bounds
Size = tuple[str, float, float]
Plant = Callable[[Setup, np.random.Generator], Planted]
#: lower and upper corner along both tangents [m]
Rectangle = tuple[tuple[float, float], tuple[float, float]]


def hide(setup: Setup, effect: str, seed: int, where: Rectangle | None = None) -> Planted:
    """The set-up with one more effect, and its parameters by the catalogue's names.

    Args:
        setup: with nothing hidden. effect: of the catalogue. seed: of its size.
        where: for an effect of the material, the rectangle of the surface that has it, lower and upper corner along
            both tangents [m]; default: everywhere.

    Raises:
        InputError: no such effect, or one that isn't at a place.
    """
    if effect not in PLANTS:
        raise InputError(f"effect '{effect}' to hide", f"one of {', '.join(sorted(PLANTS))}", closest(effect, PLANTS))
    rng = np.random.default_rng(np.random.SeedSequence([seed, *effect.encode()]))
    planted, parameters = PLANTS[effect](setup, rng)
    truth: Truth = {"effect": effect, "parameters": parameters}
    if where is not None:
        changed = {f.name for f in dataclasses.fields(setup) if getattr(planted, f.name) is not getattr(setup, f.name)}
        if changed != {"material"}:
            raise InputError(
                f"'{effect}' to hide in a part of the surface",
                "an effect of the material",
                "hide it without a place: it is everywhere",
            )
        patch = Patch(*where, planted.material)
        check_where(setup, where)
        planted = setup.replace(material=setup.material.replace(patches=(*setup.material.patches, patch)))
        truth["where"] = where
    return planted, truth


def check_where(setup: Setup, where: Rectangle) -> None:
    """Refuse a part of the surface that lies off the piece.

    Raises:
        InputError: no point in common.
    """
    half = min(setup.material.side / 2, SURFACE)
    if max(where[0]) >= half or min(where[1]) <= -half:
        raise InputError(
            f"a part of the surface {_shown(where)}, off the {setup.material.name}",
            f"places within ±{1e3 * half:g} mm of its middle",
            "move or enlarge it",
        )


def check_met(where: Rectangle, places: Array) -> None:
    """Refuse a part of the surface that no motion touches: what is hidden there would never show.

    Args:
        where: its corners [m]. places: that are touched, along both tangents [m], (n, 2).

    Raises:
        InputError: none of them lies in it.
    """
    low, high = np.asarray(where)
    if not ((places >= low) & (places <= high)).all(axis=1).any():
        near, far = 1e3 * places.min(axis=0, initial=np.inf), 1e3 * places.max(axis=0, initial=-np.inf)
        touched = f"({near[0]:.3g}, {near[1]:.3g}) to ({far[0]:.3g}, {far[1]:.3g}) mm" if len(places) else "nothing"
        raise InputError(
            f"a part of the surface {_shown(where)} that isn't touched",
            f"some of what is: {touched}",
            "move or enlarge it, or touch elsewhere",
        )


def _shown(where: Rectangle) -> str:
    (a, b), (c, d) = where
    return f"from ({1e3 * a:g}, {1e3 * b:g}) to ({1e3 * c:g}, {1e3 * d:g}) mm"


def _material(setup: Setup, truth: Truth, **changes: object) -> Planted:
    """What is planted holds everywhere, also where the property changed over the surface before."""
    fields = {name: field for name, field in setup.material.fields.items() if name not in changes}
    return setup.replace(material=setup.material.replace(**{"fields": fields, **changes})), truth


def _sign(rng: np.random.Generator) -> float:
    return float(rng.choice([-1.0, 1.0]))


def _of_material(attribute: str, *sizes: Size, sign: float | None = 1.0) -> Plant:
    """One number of the material, or several, each evenly between its bounds; of a sign, or of either one."""

    def plant(s: Setup, rng: np.random.Generator) -> Planted:
        factor = _sign(rng) if sign is None else sign
        truth = {name: factor * float(rng.uniform(low, high)) for name, low, high in sizes}
        values = tuple(truth.values())
        return _material(s, dict(truth), **{attribute: values[0] if len(values) == 1 else values})

    return plant


def _of_sensor(attribute: str, name: str, low: float, high: float, *, signed: bool = False) -> Plant:
    """One number of the sensor, evenly between bounds."""

    def plant(s: Setup, rng: np.random.Generator) -> Planted:
        value = (_sign(rng) if signed else 1.0) * float(rng.uniform(low, high))
        return _sensor(s, {name: value}, **{attribute: value})

    return plant


def _load(setup: Setup) -> tuple[float, float]:
    """Greatest depth that is asked for [m], and the force there [N]."""
    depth = max(1e-3, float(setup.script.place[:, 2].max()))
    stiffness = float(setup.material.at(np.zeros(1), np.zeros(1))["stiffness"][0])
    return depth, stiffness * depth**setup.material.exponent


# ------------------------------------------------------------------------------------------ normal


def _exponent(s: Setup, rng: np.random.Generator) -> Planted:
    n = float(rng.uniform(1.25, 1.7))
    base, gain = s.material, (0.5 * _load(s)[0]) ** (s.material.exponent - n)  # as stiff at half depth as it was
    if "stiffness" in base.fields:

        def field(x: Array, y: Array) -> Array:
            return np.asarray(gain * base.at(x, y)["stiffness"])

        return _material(s, {"exponent": n}, exponent=n, fields={**base.fields, "stiffness": field})
    return _material(
        s, {"exponent": n, "stiffness": gain * base.stiffness}, exponent=n, stiffness=gain * base.stiffness
    )


def _damping(s: Setup, rng: np.random.Generator) -> Planted:
    usual = float(s.material.at(np.zeros(1), np.zeros(1))["damping"][0])
    c = float(rng.uniform(0.8, 2.0)) * max(5.0, usual)
    return _material(s, {"damping": c}, damping=c)


def _relaxation(s: Setup, rng: np.random.Generator) -> Planted:
    ratio, tau = float(rng.uniform(0.2, 0.5)), float(np.exp(rng.uniform(np.log(0.2), np.log(1.5))))
    return _material(s, {"ratio": ratio, "time-constant": tau}, relaxation=((ratio, tau),))


def _hysteresis(s: Setup, rng: np.random.Generator) -> Planted:
    amplitude, length = float(rng.uniform(0.1, 0.3)), float(rng.uniform(0.1, 0.3)) * 0.3 * _load(s)[0]
    return _material(s, {"amplitude": amplitude, "length": length}, hysteresis=(amplitude, length))


def _softening(s: Setup, rng: np.random.Generator) -> Planted:
    ratio, length = float(rng.uniform(0.2, 0.45)), float(rng.uniform(0.2, 0.5)) * _load(s)[0]
    return _material(s, {"ratio": ratio, "length": length}, softening=(ratio, length))


def _layer(s: Setup, rng: np.random.Generator) -> Planted:
    depth, force = _load(s)
    k, at = float(rng.uniform(0.6, 1.5)) * force / depth, float(rng.uniform(0.4, 0.65)) * depth
    return _material(s, {"stiffness": k, "depth": at}, layer=k, layer_depth=at)


def _inhomogeneity(s: Setup, rng: np.random.Generator) -> Planted:
    g1, g2 = (float(v) for v in rng.uniform(15.0, 50.0, 2) * rng.choice([-1.0, 1.0], 2))
    base = s.material

    def field(x: Array, y: Array) -> Array:
        return base.at(x, y)["stiffness"] * (1.0 + g1 * x + g2 * y)

    fields: dict[str, Field] = {**base.fields, "stiffness": field}
    return _material(s, {"gradient1": g1, "gradient2": g2}, fields=fields)


def _surface_offset(s: Setup, rng: np.random.Generator) -> Planted:
    offset = _sign(rng) * float(rng.uniform(2e-4, 6e-4))
    return s.replace(surface_offset=offset), {"offset": offset}


def _surface_tilt(s: Setup, rng: np.random.Generator) -> Planted:
    a, b = (float(v) for v in rng.uniform(0.03, 0.08, 2) * rng.choice([-1.0, 1.0], 2))
    return s.replace(surface_slope=(a, b)), {"slope1": a, "slope2": b}


def _coupled(s: Setup, rng: np.random.Generator) -> Planted:
    depth, force = _load(s)
    k = rng.uniform(0.05, 0.15, 2) * force / depth * rng.choice([-1.0, 1.0], 2)
    stiffness = np.zeros((3, 3))
    stiffness[0, 2], stiffness[1, 2] = k
    return _material(
        s, {"stiffness-1n": float(k[0]), "stiffness-2n": float(k[1])}, coupling=(stiffness, np.zeros((3, 3)))
    )


# ------------------------------------------------------------------------------------ robot and tool


def _tool_mass(s: Setup, rng: np.random.Generator) -> Planted:
    mass = float(rng.uniform(0.03, 0.1))
    return s.replace(true_tool=together(s.tool, ToolSpec(mass=mass, com=s.tool.com))), {"mass": mass}


def _tool_com(s: Setup, rng: np.random.Generator) -> Planted:
    d = rng.uniform(4e-3, 1.2e-2, 3) * rng.choice([-1.0, 1.0], 3)
    com = tuple((np.asarray(s.tool.com) + d).tolist())
    return s.replace(true_tool=ToolSpec(mass=s.tool.mass, com=com, inertia=s.tool.inertia)), {"com": d.tolist()}


def _tool_inertia(s: Setup, rng: np.random.Generator) -> Planted:
    xx, yy = (float(v) for v in rng.uniform(2e-3, 5e-3, 2))
    more = (xx, yy, 0.5 * (xx + yy), 0.0, 0.0, 0.0)
    total = tuple(a + b for a, b in zip(s.tool.inertia, more))
    return s.replace(true_tool=ToolSpec(mass=s.tool.mass, com=s.tool.com, inertia=total)), {"inertia": list(more)}  # type: ignore[arg-type]


def _tip_offset(s: Setup, rng: np.random.Generator) -> Planted:
    d = rng.uniform(1e-3, 3e-3, 3) * rng.choice([-1.0, 1.0], 3) * np.array([1.0, 1.0, 0.1])
    return s.replace(true_tip=tuple(d.tolist())), {"offset": d.tolist()}


def _payload(s: Setup, rng: np.random.Generator) -> Planted:
    mass = float(rng.uniform(0.3, 1.0))
    com = rng.uniform(-0.03, 0.03, 3) - np.array([0.0, 0.0, 0.03])
    load = ToolSpec(mass=mass, com=tuple(com.tolist()))
    return s.replace(payload=load), {"mass": mass, "moment": (mass * com).tolist()}


def _gravity_error(s: Setup, rng: np.random.Generator) -> Planted:
    a, b = rng.uniform(0.02, 0.06, 2) * rng.choice([-1.0, 1.0], 2)  # [rad] by which the base is tilted
    g = np.asarray(s.robot.gravity)
    error = np.cross(g, [a, b, 0.0])
    error += np.cross(error, [a, b, 0.0]) / 2  # a rotation to second order
    return s.replace(gravity_error=tuple(error.tolist())), {"error": error.tolist()}


def _joints(name: str, parameter: str, low: Array | float, high: Array | float, signed: bool = False) -> Plant:
    def plant(s: Setup, rng: np.random.Generator) -> Planted:
        n = s.robot.joint_count
        values = rng.uniform(low, high, n) * (rng.choice([-1.0, 1.0], n) if signed else 1.0)
        return s.replace(joint_sensors=s.joint_sensors.replace(**{name: values})), {parameter: values.tolist()}

    return plant


def _joint_stribeck(s: Setup, rng: np.random.Generator) -> Planted:
    excess, speed = rng.uniform(0.5, 2.0, s.robot.joint_count), float(rng.uniform(0.02, 0.1))
    truth: Truth = {"excess": excess.tolist(), "speed": speed}
    return s.replace(joint_sensors=s.joint_sensors.replace(stribeck=excess, stribeck_speed=speed)), truth


def _joint_ripple(s: Setup, rng: np.random.Generator) -> Planted:
    n = s.robot.joint_count
    size, order = rng.uniform(0.3, 1.0, n), rng.choice([50.0, 80.0, 100.0, 160.0], n)
    truth: Truth = {"sine": size.tolist(), "order": order.tolist()}
    return s.replace(joint_sensors=s.joint_sensors.replace(ripple=size, ripple_order=order)), truth


def _motor_encoders(s: Setup, rng: np.random.Generator) -> Planted:
    k = rng.uniform(800.0, 2500.0, s.robot.joint_count)
    return s.replace(joint_sensors=s.joint_sensors.replace(bend=1.0 / k)), {"joint_stiffness": k.tolist()}


# ------------------------------------------------------------------------------- sensor, acquisition


def _sensor(setup: Setup, truth: Truth, **changes: object) -> Planted:
    return setup.replace(sensor=setup.sensor.replace(**changes)), truth


def _bias(s: Setup, rng: np.random.Generator) -> Planted:
    bias = rng.uniform(0.5, 1.5, 6) * rng.choice([-1.0, 1.0], 6) * np.array([2.0, 2.0, 4.0, 0.1, 0.1, 0.05])
    return _sensor(s, {"offset": bias.tolist()}, bias=s.sensor.bias + bias)


def _sensor_drift(s: Setup, rng: np.random.Generator) -> Planted:
    drift = rng.uniform(0.5, 1.5, 6) * rng.choice([-1.0, 1.0], 6) * np.array([0.6, 0.6, 0.8, 0.03, 0.03, 0.02])
    return _sensor(s, {"drift": drift.tolist()}, drift=drift)


def _crosstalk(s: Setup, rng: np.random.Generator) -> Planted:
    c = np.zeros((6, 6))
    c[:2, 2] = rng.uniform(0.04, 0.12, 2) * rng.choice([-1.0, 1.0], 2)
    c[2, :2] = rng.uniform(0.02, 0.06, 2) * rng.choice([-1.0, 1.0], 2)
    total = (np.eye(6) + s.sensor.crosstalk) @ (np.eye(6) + c) - np.eye(6)  # on top of what the rig knows
    return _sensor(s, {"crosstalk": c.tolist()}, crosstalk=total)


def _misalignment(s: Setup, rng: np.random.Generator) -> Planted:
    rotation = rng.uniform(0.05, 0.15, 3) * rng.choice([-1.0, 1.0], 3)
    return _sensor(s, {"rotation": rotation.tolist()}, rotation=rotation)


def _hum(s: Setup, rng: np.random.Generator) -> Planted:
    frequency = float(rng.choice([50.0, 60.0]))
    amplitude = rng.uniform(0.04, 0.12, 6) * np.array([1, 1, 1, 0.03, 0.03, 0.03])
    return _sensor(s, {"frequency": frequency, "amplitude": amplitude.tolist()}, hum=amplitude, hum_frequency=frequency)


def _quantization(s: Setup, rng: np.random.Generator) -> Planted:
    step = np.array([0.1, 0.1, 0.2, 2e-3, 2e-3, 2e-3]) * float(rng.choice([1.0, 2.0]))
    return _sensor(s, {"step": step.tolist()}, step=step)


def _saturation(s: Setup, rng: np.random.Generator) -> Planted:
    force, weight = _load(s)[1], 9.81 * s.tool.mass
    # The hanging tool pulls (+z of the sensor), the material pushes, and both ends of the range are alike: so light a
    # push comes to its end where the sensor's zero has moved as well. The rig goes on stating the zero that was.
    limit = np.array([40.0, 40.0, weight + float(rng.uniform(0.1, 0.3)) * force, 2.0, 2.0, 2.0])
    bias = s.sensor.bias.copy()
    bias[2] = -limit[2] + float(rng.uniform(0.45, 0.6)) * force - weight
    return _sensor(s, {"limit": limit.tolist(), "offset": (bias - s.sensor.bias).tolist()}, limit=limit, bias=bias)


PLANTS: dict[str, Plant] = {
    "hertz-exponent": _exponent,
    "viscous-damping": _damping,
    "hunt-crossley-damping": _of_material("loss", ("damping", 3.0, 8.0)),
    "relaxation": _relaxation,
    "hysteresis": _hysteresis,
    "stress-softening": _softening,
    "adhesion": _of_material("adhesion", ("force", 0.3, 0.9), ("length", 4e-4, 1.2e-3)),
    "stiffening-layer": _layer,
    "surface-offset": _surface_offset,
    "stiffness-drift": _of_material("drift", ("rate", 0.3, 0.8), sign=None),
    "stiffness-inhomogeneity": _inhomogeneity,
    "surface-tilt": _surface_tilt,
    "coupled-stiffness": _coupled,
    "structural-compliance": _of_material("compliance", ("compliance", 0.5e-4, 1.5e-4)),
    "coulomb-friction": _of_material("friction", ("coefficient", 0.3, 0.9)),
    "viscous-friction": _of_material("viscous", ("damping", 40.0, 120.0)),
    "stribeck-friction": _of_material("stribeck", ("coefficient", 0.06, 0.18), ("speed", 2.5e-3, 6e-3)),
    "presliding": _of_material("bristle", ("length", 5e-4, 1.5e-3)),
    "friction-rounding": _of_material("rounding", ("speed", 2e-3, 8e-3)),
    "load-dependent-friction": _of_material("load_exponent", ("exponent", 0.2, 0.4), sign=-1.0),
    "friction-anisotropy": _of_material("anisotropy", ("ratio", 0.15, 0.4), sign=None),
    "tool-mass": _tool_mass,
    "tool-com": _tool_com,
    "tool-inertia": _tool_inertia,
    "tip-offset": _tip_offset,
    "payload": _payload,
    "gravity-error": _gravity_error,
    "joint-elasticity": _motor_encoders,
    "joint-coulomb-friction": _joints("coulomb", "torque", 0.5, 3.0),
    "joint-viscous-friction": _joints("viscous", "damping", 1.0, 6.0),
    "joint-friction-asymmetry": _joints("asymmetry", "damping", 0.8, 3.0, signed=True),
    "joint-torque-offset": _joints("offset", "offset", 0.3, 1.5, signed=True),
    "joint-torque-gain": _joints("gain", "gain", 0.05, 0.2, signed=True),
    "joint-stribeck-friction": _joint_stribeck,
    "joint-torque-ripple": _joint_ripple,
    "joint-load-friction": _joints("load", "load", 0.03, 0.12),
    "joint-spring": _joints("spring", "rate", 1.0, 6.0, signed=True),
    "rotor-inertia": _joints("rotor", "inertia", 0.3, 2.5),
    "sensor-bias": _bias,
    "sensor-drift": _sensor_drift,
    "sensor-crosstalk": _crosstalk,
    "sensor-gain": _of_sensor("gain", "gain", 0.06, 0.15, signed=True),
    "sensor-misalignment": _misalignment,
    "sensor-lag": _of_sensor("lag", "time-constant", 8e-3, 2e-2),
    "time-offset": _of_sensor("delay", "delay", 5e-3, 1.5e-2),
    "saturation": _saturation,
    "quantization": _quantization,
    "mains-hum": _hum,
}
