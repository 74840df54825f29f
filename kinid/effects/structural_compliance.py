"""An arm that gives way."""

from __future__ import annotations

from typing import final

import numpy as np

from kinid.effects._derived import derived, rates
from kinid.effects._effect import Effect
from kinid.effects._signals import Array, Layout, Signals
from kinid.parameter import Parameter


@final
class StructuralCompliance(Effect):
    """δ → δ − C N, δ̇ → δ̇ − C Ṅ: the contact force bends joints, flange and sensor, and the tip stays behind the encoders.

    N is the measured normal force, less the tool's load and the bias of free motion. Its noise moves the depth by C times
    as much: 2 µm for 0.05 N on an arm of 4e-5 m/N, 5 nm on a sensor of 1e-7 m/N; its rate is taken at 25 Hz.
    Where nothing was measured (a motion that is only planned), N x^n is what is left of a normal force N ∝ δ^n, with
    x = 1 − C N xⁿ/δ; n is the law's exponent, and deflection is taken to follow at once.
    """

    id = "structural-compliance"
    title = "compliance of arm and sensor"
    equation = "δ → δ − C N"
    source = "G. Alici, B. Shirinzadeh, IEEE Trans. Robotics 21, 2005 (deflection of a loaded arm)"
    signature = "softer than the material is, and the more so the larger the force"
    confusions = {
        "presliding": "fast deep pokes: compliance grows with the load, bristles end",
        "hertz-exponent": "a hard surface: compliance is there too",
        "stiffening-layer": "a hard surface: compliance is there too",
    }
    excited_by = "a wide range of forces, best on something hard"
    null = {"compliance": 0.0}

    def parameters(self, layout: Layout) -> tuple[Parameter, ...]:
        """Compliance along the normal."""
        return (Parameter("compliance", "C", "m/N", 2e-5, 0.0, 1e-2, scale=1e-5),)

    def geometry(self, s: Signals, p: Array) -> None:
        """Take the deflection off the depth, where the force was measured."""
        measured = s.measured
        if measured is None:
            return
        sources = (measured, s.dt) if s.sensor is None else (measured, s.dt, s.sensor.load, s.sensor.to_contact)
        force = derived("normal force", lambda: _normal_force(s, measured), *sources)
        rate = derived("rate of normal force", lambda: rates(s.t, s.dt, force[None, :], 1)[0], *sources)
        s.depth = s.depth - p[0] * force
        s.depth_rate = s.depth_rate - p[0] * rate

    def normal(self, s: Signals, p: Array) -> None:
        """Take off the force what deflection costs, where none was measured."""
        if s.measured is not None:
            return
        share = np.ones(len(s))
        pushed = s.inside & (s.normal > 0.0)
        a, n = p[0] * s.normal[pushed] / s.depth[pushed], s.exponent
        x = 1.0 / (1.0 + a)
        for _ in range(50):
            step = (x - 1.0 + a * x**n) / (1.0 + a * n * x ** (n - 1.0))
            x = np.clip(x - step, 0.1 * x, 2.0 * x)
            if np.abs(step).max(initial=0.0) < 1e-15:
                break
        share[pushed] = x**n
        s.normal = s.normal * share


def _normal_force(s: Signals, measured: Array) -> Array:
    """Measured force along the normal [N], (n,); 0 where it isn't a number or isn't among the channels."""
    if s.layout.kind == "contact":
        if "normal_force" not in s.layout.channels:
            return np.zeros(len(s))
        return np.asarray(np.nan_to_num(measured[s.layout.channels.index("normal_force")]))
    if s.sensor is None:
        return np.zeros(len(s))
    contact = measured[:3] - s.sensor.load[:3]
    return np.asarray(np.nan_to_num(np.einsum("nj,jn->n", s.sensor.to_contact[:, 2], contact)))
