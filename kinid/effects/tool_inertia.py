"""Rotational inertia that the rig's tool lacks."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import final

import numpy as np

from kinid.effects._effect import Effect
from kinid.effects._example import Example, Motion
from kinid.effects._signals import Array, Layout, Signals
from kinid.effects._vectors import cross
from kinid.parameter import Parameter

#: share within which moments of inertia are known from a drawing, or a mass that is off while the shape is right
DRAWN = 0.1
#: a principal moment that is negative by less than a share of the largest may be an axis that hardly turns
NEGATIVE = 0.5
ENTRIES = ("xx", "yy", "zz", "xy", "xz", "yz")


@final
class ToolInertia(Effect):
    """τ −= ΔI α + ω × ΔI ω, ΔI about the tool's centre of mass in sensor axes, beyond the rig's.

    The rig's tool always carries its m·a; where a rig has no tool, or a mass that is too small, `tool-mass` adds it.
    """

    id = "tool-inertia"
    title = "rotational inertia of the tool"
    equation = "τ −= ΔI α + ω × ΔI ω"
    source = (
        "L. Euler, Theoria motus corporum solidorum, 1765; C. G. Atkeson et al., Int. J. Robotics Research 5(3), 1986"
    )
    signature = "torques in the air as large as the angular acceleration"
    confusions = {
        "tool-mass": "slow and fast free motion: weight is there at rest too",
        "sensor-lag": "slow and fast free motion: a lag delays all channels",
    }
    excited_by = "fast turning in the air, about each axis of the sensor"
    needs = ("wrench",)
    null = {"inertia": 0.0}
    admissible = {"inertia": (-1.0, 1.0)}  # of tools that a hand carries
    example = Example(("hooke",), {"inertia": (4e-4, 3e-4, 2e-4, -5e-5, 4e-5, 6e-5)}, Motion.WRENCH)

    def parameters(self, layout: Layout) -> tuple[Parameter, ...]:
        """The six entries of the inertia."""
        return tuple(
            Parameter(f"inertia[{entry}]", "ΔI", "kg·m²", 0.0, -10.0, 10.0, scale=1e-4, linear=True)
            for entry in ENTRIES
        )

    def calibration_sd(self, signals: Signals) -> Mapping[str, float]:
        """A share of what the rig states: drawings know a tool's outline better than its screws and cables."""
        stated = () if signals.sensor is None else zip(ENTRIES, signals.sensor.moments.tolist())
        return {f"inertia[{entry}]": DRAWN * moment for entry, moment in stated if moment > 0.0}

    def implausible(
        self, values: Mapping[str, float], model_values: Mapping[str, float], signals: Signals | None = None
    ) -> str:
        """A tool that turns more easily than nothing: accelerations of coarse positions follow noise, and load so."""
        if signals is not None and signals.sensor is not None:
            added = _tensor([values.get(f"inertia[{entry}]", 0.0) for entry in ENTRIES])
            least, _, most = np.linalg.eigvalsh(np.diag(signals.sensor.moments) + added)
            if least < -NEGATIVE * max(most, 0.0):
                return f"a tool whose moments of inertia are {least:.2g} to {most:.2g} kg·m²"
        return super().implausible(values, model_values, signals)

    def tool(self, s: Signals, p: Array) -> None:
        """Add what turns it."""
        assert s.sensor is not None
        inertia = _tensor(p)
        omega, alpha = s.sensor.omega, s.sensor.alpha
        torque = -inertia @ alpha - cross(omega, inertia @ omega)
        s.reading = s.reading + np.concatenate([np.zeros_like(torque), torque])


def _tensor(entries: Sequence[float] | Array) -> Array:
    """The symmetric tensor (3, 3) of its six entries."""
    xx, yy, zz, xy, xz, yz = entries
    return np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
