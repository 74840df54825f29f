"""Effects of the tool and of the joints."""

from __future__ import annotations

import numpy as np

from kinid.data.rig import ToolSpec
from kinid.lab.injectors._common import Array, Injected, Injector, Truth
from kinid.lab.setup import Setup, together


def _tool_mass(s: Setup, rng: np.random.Generator) -> Injected:
    mass = float(rng.uniform(0.03, 0.1))
    return s.replace(true_tool=together(s.tool, ToolSpec(mass=mass, com=s.tool.com))), {"mass": mass}


def _tool_com(s: Setup, rng: np.random.Generator) -> Injected:
    d = rng.uniform(4e-3, 1.2e-2, 3) * rng.choice([-1.0, 1.0], 3)
    com = tuple((np.asarray(s.tool.com) + d).tolist())
    return s.replace(true_tool=ToolSpec(mass=s.tool.mass, com=com, inertia=s.tool.inertia)), {"com": d.tolist()}


def _tool_inertia(s: Setup, rng: np.random.Generator) -> Injected:
    xx, yy = (float(v) for v in rng.uniform(2e-3, 5e-3, 2))
    more = (xx, yy, 0.5 * (xx + yy), 0.0, 0.0, 0.0)
    total = tuple(a + b for a, b in zip(s.tool.inertia, more))
    return s.replace(true_tool=ToolSpec(mass=s.tool.mass, com=s.tool.com, inertia=total)), {"inertia": list(more)}  # type: ignore[arg-type]


def _tip_offset(s: Setup, rng: np.random.Generator) -> Injected:
    d = rng.uniform(1e-3, 3e-3, 3) * rng.choice([-1.0, 1.0], 3) * np.array([1.0, 1.0, 0.1])
    return s.replace(true_tip=tuple(d.tolist())), {"offset": d.tolist()}


def _payload(s: Setup, rng: np.random.Generator) -> Injected:
    mass = float(rng.uniform(0.3, 1.0))
    com = rng.uniform(-0.03, 0.03, 3) - np.array([0.0, 0.0, 0.03])
    load = ToolSpec(mass=mass, com=tuple(com.tolist()))
    return s.replace(payload=load), {"mass": mass, "moment": (mass * com).tolist()}


def _gravity_error(s: Setup, rng: np.random.Generator) -> Injected:
    a, b = rng.uniform(0.02, 0.06, 2) * rng.choice([-1.0, 1.0], 2)  # [rad] by which the base is tilted
    g = np.asarray(s.robot.gravity)
    error = np.cross(g, [a, b, 0.0])
    error += np.cross(error, [a, b, 0.0]) / 2  # a rotation to second order
    return s.replace(gravity_error=tuple(error.tolist())), {"error": error.tolist()}


def _joints(name: str, parameter: str, low: Array | float, high: Array | float, signed: bool = False) -> Injector:
    def inject(s: Setup, rng: np.random.Generator) -> Injected:
        n = s.robot.joint_count
        values = rng.uniform(low, high, n) * (rng.choice([-1.0, 1.0], n) if signed else 1.0)
        return s.replace(joint_sensors=s.joint_sensors.replace(**{name: values})), {parameter: values.tolist()}

    return inject


def _joint_stribeck(s: Setup, rng: np.random.Generator) -> Injected:
    n = s.robot.joint_count
    excess, speed = rng.uniform(0.5, 2.0, n), rng.uniform(0.02, 0.1, n)
    truth: Truth = {"excess": excess.tolist(), "speed": speed.tolist()}
    return s.replace(joint_sensors=s.joint_sensors.replace(stribeck=excess, stribeck_speed=speed)), truth


def _joint_ripple(s: Setup, rng: np.random.Generator) -> Injected:
    n = s.robot.joint_count
    size, order = rng.uniform(0.3, 1.0, n), rng.choice([50.0, 80.0, 100.0, 160.0], n)
    truth: Truth = {"sine": size.tolist(), "order": order.tolist()}
    return s.replace(joint_sensors=s.joint_sensors.replace(ripple=size, ripple_order=order)), truth


def _motor_encoders(s: Setup, rng: np.random.Generator) -> Injected:
    k = rng.uniform(800.0, 2500.0, s.robot.joint_count)
    return s.replace(joint_sensors=s.joint_sensors.replace(bend=1.0 / k)), {"joint_stiffness": k.tolist()}


INJECTORS: dict[str, Injector] = {
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
}
