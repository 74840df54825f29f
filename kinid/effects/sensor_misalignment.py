"""A sensor that is mounted askew."""

from __future__ import annotations

from typing import final

import numpy as np

from kinid.effects._effect import Effect
from kinid.effects._example import Example, Motion
from kinid.effects._signals import Array, Layout, Signals
from kinid.parameter import Parameter

_FORCES = ("tangential_force1", "tangential_force2", "normal_force")


@final
class SensorMisalignment(Effect):
    """y = exp(−[φ]×) f for forces and torques: the sensor is turned by the vector φ from where the rig has it.

    φ [rad] is given in the axes the rig states. In a contact frame it is about its axes, and needs all three forces.
    """

    id = "sensor-misalignment"
    title = "rotation of the sensor in its mount"
    equation = "y = exp(−[φ]×) f"
    source = "O. Rodrigues, J. Math. Pures Appl. 5, 1840"
    signature = "channels copy one another in pairs with opposite signs"
    confusions = {
        "sensor-crosstalk": "loads along x and along y: cross-talk need not be antisymmetric",
        "tool-com": "contact: a centre of mass has no part in it",
    }
    excited_by = "loads along two directions"
    couples = True
    needs = ()
    null = {"rotation": 0.0}
    calibration_tolerance = {"rotation": 3.5e-3}  # 0.2°: dowels and flanges
    admissible = {"rotation": (-0.8, 0.8)}  # beyond 45° another face of the flange is meant
    example = Example(("hooke",), {"rotation": (0.02, -0.03, 0.05)}, Motion.WRENCH)

    def parameters(self, layout: Layout) -> tuple[Parameter, ...]:
        """Rotation vector."""
        return tuple(Parameter(f"rotation[{axis}]", "φ", "rad", 0.0, -1.5, 1.5, scale=0.01) for axis in _axes(layout))

    def sensor(self, s: Signals, p: Array) -> None:
        """Turn the readings."""
        if not len(p):
            return
        turn = _rotation(-p)
        if s.layout.kind == "contact":
            rows = [s.layout.channels.index(name) for name in _FORCES]
            reading = s.reading.copy()
            reading[rows] = turn @ s.reading[rows]
            s.reading = reading
        else:
            s.reading = np.concatenate([turn @ s.reading[:3], turn @ s.reading[3:]])


def _axes(layout: Layout) -> tuple[str, ...]:
    if layout.kind == "wrench":
        return ("x", "y", "z")
    return ("tangent1", "tangent2", "normal") if set(_FORCES) <= set(layout.channels) else ()


def _rotation(v: Array) -> Array:
    """exp([v]×), smooth at zero, (3, 3)."""
    angle = float(np.sqrt(v @ v))
    skew = np.array([[0.0, -v[2], v[1]], [v[2], 0.0, -v[0]], [-v[1], v[0], 0.0]])
    out: Array = np.eye(3) + np.sinc(angle / np.pi) * skew + 0.5 * np.sinc(0.5 * angle / np.pi) ** 2 * skew @ skew
    return out
