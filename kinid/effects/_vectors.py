"""Vectors over time, (3, n)."""

from __future__ import annotations

import numpy as np

from kinid.effects._derived import derived
from kinid.effects._signals import Array, SensorMotion
from kinid.kernels import frames


def cross(a: Array, b: Array) -> Array:
    """Cross products of rows x, y, z; either may be one vector for all times, (3,) or (3, n)."""
    return np.stack([a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]])


def point_load(sensor: SensorMotion, mass: float, com: Array) -> Array:
    """Wrench at the sensor's origin of a mass [kg] at a point of the sensor frame [m], (6, n).

    f = m (g − a − α × c − ω × (ω × c)), τ = c × f.
    """

    def of_a_kilogram() -> Array:
        out = np.empty((6, sensor.specific.shape[1]))
        frames.point_load(sensor.specific, sensor.omega, sensor.alpha, np.asarray(com, dtype=np.float64), out)
        return out

    return mass * derived(
        "load of a kilogram", of_a_kilogram, sensor.specific, sensor.omega, sensor.alpha, at=tuple(com)
    )
