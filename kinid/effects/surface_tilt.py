"""A surface that is not quite where the rig's plane is turned to."""

from __future__ import annotations

from collections.abc import Mapping
from typing import final

import numpy as np

from kinid.effects._effect import Effect
from kinid.effects._example import Example
from kinid.effects._signals import Array, Layout, Signals
from kinid.parameter import Parameter


@final
class SurfaceTilt(Effect):
    """The surface rises by a₁ and a₂ along the tangents: δ + a·s, and the normal force leans over by −a.

    First order in the tilt: with the true normal n − a₁ t₁ − a₂ t₂, a force (T, N) on the true surface reads
    (T − a N, N + a·T) in the rig's frame.
    """

    id = "surface-tilt"
    title = "surface turned against the rig's plane"
    equation = "δ + a·s;  s − a δ;  T − a N,  N + a·T"
    source = "small-angle rotation of the contact frame"
    signature = (
        "tangential force proportional to the normal force while nothing slides, and depth that drifts along a slide"
    )
    confusions = {
        "sensor-misalignment": "slide: a tilt changes the depth along the way, a turned sensor doesn't",
        "sensor-crosstalk": "slide: a tilt changes the depth along the way",
        "coupled-stiffness": "slide: a tilt changes the depth along the way",
    }
    excited_by = "pokes and slides along both tangents"
    couples = True
    needs = ("normal", "slip")
    null = {"slope1": 0.0, "slope2": 0.0}
    grid = {"slope1": (-0.05, 0.0, 0.05), "slope2": (-0.05, 0.0, 0.05)}
    order = 1
    # three points 30 mm apart, each touched to 0.1 mm
    calibration_tolerance = {"slope1": 3.5e-3, "slope2": 3.5e-3}
    admissible = {"slope1": (-0.2, 0.2), "slope2": (-0.2, 0.2)}  # first order: at 0.2, 2 % of the force are left out
    example = Example(("kelvin-voigt", "coulomb-friction"), {"slope1": 0.03, "slope2": -0.05})

    def parameters(self, layout: Layout) -> tuple[Parameter, ...]:
        """Slopes along the tangents."""
        return tuple(Parameter(f"slope{i}", f"a{i}", "1", 0.0, -0.5, 0.5, scale=0.02) for i in (1, 2))

    def calibration_sd(self, signals: Signals) -> Mapping[str, float]:
        """What the rig states of its surface, else what touching it by hand leaves open."""
        return {name: signals.surface_sd[1] or sd for name, sd in super().calibration_sd(signals).items()}

    def geometry(self, s: Signals, p: Array) -> None:
        """Change the depth along the slide, and the slip of a poke, which is not quite normal to the surface."""
        depth, rate = s.depth, s.depth_rate
        s.depth = depth + p @ s.slip
        s.depth_rate = rate + p @ s.slip_rate
        s.slip = s.slip - np.outer(p, depth)
        s.slip_rate = s.slip_rate - np.outer(p, rate)

    def frame(self, s: Signals, p: Array) -> None:
        """Lean the force over."""
        normal, tangential = s.normal, s.tangential
        s.tangential = tangential - np.outer(p, normal)
        s.normal = normal + p @ tangential
