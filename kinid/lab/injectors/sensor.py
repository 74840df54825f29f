"""Effects of the force/torque sensor and of how its readings are taken."""

from __future__ import annotations

import numpy as np

from kinid.lab.injectors._common import Injected, Injector, Truth, load, sign
from kinid.lab.setup import Setup


def _sensor(setup: Setup, truth: Truth, **changes: object) -> Injected:
    return setup.replace(sensor=setup.sensor.replace(**changes)), truth


def _bias(s: Setup, rng: np.random.Generator) -> Injected:
    bias = rng.uniform(0.5, 1.5, 6) * rng.choice([-1.0, 1.0], 6) * np.array([2.0, 2.0, 4.0, 0.1, 0.1, 0.05])
    return _sensor(s, {"offset": bias.tolist()}, bias=s.sensor.bias + bias)


def _sensor_drift(s: Setup, rng: np.random.Generator) -> Injected:
    drift = rng.uniform(0.5, 1.5, 6) * rng.choice([-1.0, 1.0], 6) * np.array([0.6, 0.6, 0.8, 0.03, 0.03, 0.02])
    return _sensor(s, {"drift": drift.tolist()}, drift=drift)


def _crosstalk(s: Setup, rng: np.random.Generator) -> Injected:
    c = np.zeros((6, 6))
    c[:2, 2] = rng.uniform(0.04, 0.12, 2) * rng.choice([-1.0, 1.0], 2)
    c[2, :2] = rng.uniform(0.02, 0.06, 2) * rng.choice([-1.0, 1.0], 2)
    total = (np.eye(6) + s.sensor.crosstalk) @ (np.eye(6) + c) - np.eye(6)  # on top of what the rig knows
    return _sensor(s, {"crosstalk": c.tolist()}, crosstalk=total)


def _gain(s: Setup, rng: np.random.Generator) -> Injected:
    gain = sign(rng) * float(rng.uniform(0.06, 0.15))
    return _sensor(s, {"gain": gain}, gain=gain)


def _misalignment(s: Setup, rng: np.random.Generator) -> Injected:
    rotation = rng.uniform(0.05, 0.15, 3) * rng.choice([-1.0, 1.0], 3)
    return _sensor(s, {"rotation": rotation.tolist()}, rotation=rotation)


def _lag(s: Setup, rng: np.random.Generator) -> Injected:
    lag = float(rng.uniform(8e-3, 2e-2))
    return _sensor(s, {"time-constant": lag}, lag=lag)


def _time_offset(s: Setup, rng: np.random.Generator) -> Injected:
    delay = float(rng.uniform(5e-3, 1.5e-2))
    return _sensor(s, {"delay": delay}, delay=delay)


def _hum(s: Setup, rng: np.random.Generator) -> Injected:
    frequency = float(rng.choice([50.0, 60.0]))
    amplitude = rng.uniform(0.04, 0.12, 6) * np.array([1, 1, 1, 0.03, 0.03, 0.03])
    return _sensor(s, {"frequency": frequency, "amplitude": amplitude.tolist()}, hum=amplitude, hum_frequency=frequency)


def _quantization(s: Setup, rng: np.random.Generator) -> Injected:
    step = np.array([0.1, 0.1, 0.2, 2e-3, 2e-3, 2e-3]) * float(rng.choice([1.0, 2.0]))
    return _sensor(s, {"step": step.tolist()}, step=step)


def _saturation(s: Setup, rng: np.random.Generator) -> Injected:
    force, weight = load(s)[1], 9.81 * s.tool.mass
    # The hanging tool pulls (+z of the sensor), the material pushes, and both ends of the range are alike: so light a
    # push comes to its end where the sensor's zero has moved as well. The rig goes on stating the zero that was.
    limit = np.array([40.0, 40.0, weight + float(rng.uniform(0.1, 0.3)) * force, 2.0, 2.0, 2.0])
    bias = s.sensor.bias.copy()
    bias[2] = -limit[2] + float(rng.uniform(0.45, 0.6)) * force - weight
    return _sensor(s, {"limit": limit.tolist(), "offset": (bias - s.sensor.bias).tolist()}, limit=limit, bias=bias)


INJECTORS: dict[str, Injector] = {
    "sensor-bias": _bias,
    "sensor-drift": _sensor_drift,
    "sensor-crosstalk": _crosstalk,
    "sensor-gain": _gain,
    "sensor-misalignment": _misalignment,
    "sensor-lag": _lag,
    "time-offset": _time_offset,
    "saturation": _saturation,
    "quantization": _quantization,
    "mains-hum": _hum,
}
