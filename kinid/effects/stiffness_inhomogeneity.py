"""A material that differs from place to place."""

from __future__ import annotations

from typing import final

import numpy as np

from kinid.effects._effect import Effect
from kinid.effects._signals import Array, Layout, Signals
from kinid.parameter import Parameter


@final
class StiffnessInhomogeneity(Effect):
    """F_e ·= 1 + g₁ x + g₂ y + h σ(l + s₁ x + s₂ y + c (x² + y²)), σ(q) = 1/(1 + e^−q); x, y are the slips [m].

    A gradient g [1/m] along both tangents, and one region that is stiffer by h (softer, if negative). Its border is the
    conic q = 0, smooth over 1/|∇q|: with c = 0 a straight edge of any direction, of width 1/√(s₁² + s₂²) and at
    −l/√(s₁² + s₂²) from the surface's point along (s₁, s₂); with c < 0 a round inclusion about −(s₁, s₂)/2c. For
    l ≪ 0 the inclusion is a Gaussian bump. Everything is smooth in all parameters; h and the gradient, times the base's
    stiffness, enter linearly. x and y are the slips as the surface defines them.
    """

    id = "stiffness-inhomogeneity"
    title = "stiffness that depends on the place"
    equation = "F_e ·= 1 + g₁ x + g₂ y + h σ(l + s₁ x + s₂ y + c (x² + y²))"
    source = (
        "graded materials: S. Suresh, Science 292, 2001; inclusions: P. S. Wellman, R. D. Howe, MICCAI 1999; "
        "logistic border: D. R. Cox, J. R. Stat. Soc. B 20, 1958"
    )
    signature = "an error in proportion to the force, that returns at the same place"
    confusions = {
        "stiffness-drift": "the same place, later",
        "surface-offset": "several depths at each place: tilt shifts depth, stiffness scales force",
    }
    excited_by = "pokes or slides of one depth at many places, along both tangents"
    needs = ("normal", "slip")
    null = {"gradient1": 0.0, "gradient2": 0.0, "height": 0.0}

    def parameters(self, layout: Layout) -> tuple[Parameter, ...]:
        """Gradient along both tangents; height, level, steepness along both tangents and curvature of the region."""
        return (
            Parameter("gradient1", "g₁", "1/m", 0.0, -1e4, 1e4, scale=1.0),
            Parameter("gradient2", "g₂", "1/m", 0.0, -1e4, 1e4, scale=1.0),
            Parameter("height", "h", "1", 0.3, -1e3, 1e3, scale=0.05),
            Parameter("level", "l", "1", 0.0, -100.0, 100.0, scale=0.5),
            Parameter("steepness1", "s₁", "1/m", 200.0, -1e5, 1e5, scale=50.0),
            Parameter("steepness2", "s₂", "1/m", 0.0, -1e5, 1e5, scale=50.0),
            Parameter("curvature", "c", "1/m²", 0.0, -1e8, 1e8, scale=1e4),
        )

    def elastic(self, s: Signals, p: Array) -> None:
        """Scale the elastic force."""
        x, y = s.slip
        q = p[3] + p[4] * x + p[5] * y + p[6] * (x**2 + y**2)
        # the logistic function as a tanh, which overflows nowhere
        s.elastic = s.elastic * (1.0 + p[0] * x + p[1] * y + p[2] * 0.5 * (1.0 + np.tanh(0.5 * q)))
