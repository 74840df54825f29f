"""Stiffness and damping between the axes of the contact frame."""

from __future__ import annotations

from typing import final

import numpy as np
from numpy.typing import NDArray

from kinid.effects._derived import derived
from kinid.effects._effect import Effect
from kinid.effects._example import Example
from kinid.effects._signals import Array, Layout, Signals
from kinid.parameter import Parameter

_AXES = ("1", "2", "n")
_PAIRS = tuple(f"{i}{j}" for i in _AXES for j in _AXES if i + j != "nn")


@final
class CoupledStiffness(Effect):
    """A full 3 × 3 stiffness and damping beside the scalar law of the normal: f += K x + C ẋ inside the material.

    x = (x₁, x₂, δ): slip since the touch began, and depth; f = (T₁, T₂, N). The entry nn belongs to the contact law. A
    tool that slides leaves what shear it has made behind: shear entries are for pokes, bonded tips and elastic bands.
    """

    id = "coupled-stiffness"
    title = "full stiffness and damping of the contact"
    equation = "f += K x + C ẋ,  x = (x₁, x₂, δ),  without K_nn, C_nn"
    source = "N. Hogan, Impedance control, J. Dyn. Syst. Meas. Control 107, 1985: stiffness as a full tensor"
    signature = "tangential force that follows the depth, or normal force that follows the slip"
    confusions = {
        "surface-tilt": "slide: a tilt changes the depth along the way",
        "sensor-misalignment": "other materials: a turned sensor couples in the same ratio everywhere",
        "sensor-crosstalk": "load in free air by turning the tool's weight: cross-talk couples there too",
        "presliding": "pokes without slip",
    }
    excited_by = "pokes with small slips along both tangents, in and out at several speeds"
    couples = True
    needs = ("normal", "slip")
    null = {f"{kind}-{pair}": 0.0 for kind in ("stiffness", "damping") for pair in _PAIRS}
    # a contact gives no energy: its own force along a tangent is against the motion
    admissible = {
        "stiffness-11": (-1e8, 0.0),
        "stiffness-22": (-1e8, 0.0),
        "damping-11": (-1e6, 0.0),
        "damping-22": (-1e6, 0.0),
    }
    example = Example(
        ("kelvin-voigt",),
        {
            f"{kind}-{pair}": size * (1.0 + 0.3 * k)
            for kind, size in (("stiffness", -70.0), ("damping", -2.0))
            for k, pair in enumerate(_PAIRS)
        },
    )

    def parameters(self, layout: Layout) -> tuple[Parameter, ...]:
        """Eight entries of stiffness and eight of damping, row (force) before column (motion)."""
        return tuple(
            Parameter(f"{kind}-{pair}", f"{symbol}_{pair}", unit, 0.0, scale=scale, linear=True)
            for kind, symbol, unit, scale in (("stiffness", "K", "N/m", 50.0), ("damping", "C", "N·s/m", 1.0))
            for pair in _PAIRS
        )

    def frame(self, s: Signals, p: Array) -> None:
        """Add the forces between the axes."""
        inside = s.inside
        x = derived(
            "motion since touch",
            lambda: np.stack([*_since_touch(s.slip, inside, s.dt), s.penetration]),
            s.slip,
            s.depth,
            s.dt,
        )
        v = derived(
            "speed inside",
            lambda: np.where(inside, np.stack([*s.slip_rate, s.depth_rate]), 0.0),
            s.slip_rate,
            s.depth_rate,
            s.depth,
        )
        stiffness, damping = np.append(p[:8], 0.0).reshape(3, 3), np.append(p[8:], 0.0).reshape(3, 3)
        force = stiffness @ x + damping @ v
        s.tangential = s.tangential + force[:2]
        s.normal = s.normal + force[2]


def _since_touch(slip: Array, inside: NDArray[np.bool_], dt: Array) -> Array:
    """Slip since each touch, or the record of it, began; zero outside, (2, n)."""
    begins = np.flatnonzero((np.diff(inside.astype(np.int8), prepend=0) == 1) | (inside & (dt == 0.0)))
    if not len(begins):
        return np.zeros_like(slip)
    touch = np.searchsorted(begins, np.arange(slip.shape[1]), side="right") - 1
    out: Array = np.where(inside, slip - slip[:, begins[np.maximum(touch, 0)]], 0.0)
    return out
