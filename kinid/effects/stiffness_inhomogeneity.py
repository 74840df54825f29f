"""A material that differs from place to place."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import final

import numpy as np

from kinid.effects._effect import Effect
from kinid.effects._signals import Array, Layout, Signals
from kinid.parameter import Parameter

#: ends of a border's steepness [1/m] and curvature [1/m²]
STEEPEST, ROUNDEST = 1e5, 1e8


@final
@dataclass(frozen=True)
class StiffnessInhomogeneity(Effect):
    """F_e ·= 1 + g₁ x + g₂ y + h σ(l + s₁ x + s₂ y + c (x² + y²)), σ(q) = 1/(1 + e^−q); x, y are the slips [m].

    A gradient g [1/m] along both tangents, and one region that is stiffer by h (softer, if negative). Its border is the
    conic q = 0, smooth over 1/|∇q|: with c = 0 a straight edge of any direction, of width 1/√(s₁² + s₂²) and at
    −l/√(s₁² + s₂²) from the surface's point along (s₁, s₂); with c < 0 a round inclusion about −(s₁, s₂)/2c. For
    l ≪ 0 the inclusion is a Gaussian bump. Everything is smooth in all parameters; h and the gradient, times the base's
    stiffness, enter linearly. x and y are the slips as the surface defines them.

    Attributes:
        region: whether there is a region beside the gradient. A fit leaves it out, with open parameters, where it
            explains no more than chance would.
    """

    region: bool = True

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
    # a border without width
    ends = {"steepness1": (-STEEPEST, STEEPEST), "steepness2": (-STEEPEST, STEEPEST), "curvature": (-ROUNDEST, ROUNDEST)}
    grid = {"level": (-1.5, 0.0, 1.5), "steepness1": (-300.0, 0.0, 300.0), "steepness2": (-300.0, 0.0, 300.0),
            "curvature": (-1e5, 0.0)}  # fmt: skip
    turn = 2

    def parameters(self, layout: Layout) -> tuple[Parameter, ...]:
        """Gradient along both tangents; height, level, steepness along both tangents and curvature of the region."""
        gradient = (
            Parameter("gradient1", "g₁", "1/m", 0.0, -1e4, 1e4, scale=1.0),
            Parameter("gradient2", "g₂", "1/m", 0.0, -1e4, 1e4, scale=1.0),
        )
        if not self.region:
            return gradient
        return (
            *gradient,
            Parameter("height", "h", "1", 0.3, -1e3, 1e3, scale=0.05),
            Parameter("level", "l", "1", 0.0, -100.0, 100.0, scale=0.5),
            Parameter("steepness1", "s₁", "1/m", 200.0, -STEEPEST, STEEPEST, scale=50.0),
            Parameter("steepness2", "s₂", "1/m", 0.0, -STEEPEST, STEEPEST, scale=50.0),
            Parameter("curvature", "c", "1/m²", 0.0, -ROUNDEST, ROUNDEST, scale=1e4),
        )

    def null_for(self, base: str | None) -> Mapping[str, float]:
        """Neither gradient nor height."""
        return {name: 0.0 for name in self.null if self.region or name != "height"}

    def starts(self, signals: Signals) -> tuple[Array, ...]:
        """Edges across the touched places at their quartiles, diagonal ones in their middle, and round inclusions."""
        if not self.region or not signals.inside.any():
            return ()
        x, y = signals.slip[:, signals.inside]
        thirds = [np.quantile(axis, [0.25, 0.5, 0.75]) for axis in (x, y)]
        spans = [float(np.ptp(np.quantile(axis, [0.02, 0.98]))) for axis in (x, y)]
        wide = [span > 0.1 * max(spans) > 0.0 for span in spans]
        out = []
        for axis in (0, 1):
            for place in thirds[axis] if wide[axis] else ():
                s = np.zeros(2)
                s[axis] = 8.0 / spans[axis]
                out.append([0.0, 0.0, 0.3, -s[axis] * place, *s, 0.0])
        for sign in (1.0, -1.0) if all(wide) else ():
            s = np.array([8.0 / spans[0], sign * 8.0 / spans[1]]) / np.sqrt(2.0)
            out.append([0.0, 0.0, 0.3, -s[0] * thirds[0][1] - s[1] * thirds[1][1], *s, 0.0])
        curve = -2.0 / (0.25 * max(spans)) ** 2 if any(wide) else 0.0
        for x0 in thirds[0] if wide[0] else thirds[0][1:2] if wide[1] else ():
            for y0 in thirds[1] if wide[1] else thirds[1][1:2]:
                # q = 2 + c ((x − x₀)² + (y − y₀)²): its border a quarter of the span away
                out.append([0.0, 0.0, 0.3, 2.0 + curve * (x0**2 + y0**2), -2 * curve * x0, -2 * curve * y0, curve])
        bounds = [(p.low, p.high) for p in self.parameters(signals.layout)]
        return tuple(np.clip(start, *np.transpose(bounds)) for start in out)

    def simpler(self) -> StiffnessInhomogeneity | None:
        """A gradient alone."""
        return StiffnessInhomogeneity(region=False) if self.region else None

    def elastic(self, s: Signals, p: Array) -> None:
        """Scale the elastic force."""
        x, y = s.slip
        factor = 1.0 + p[0] * x + p[1] * y
        if self.region:
            q = p[3] + p[4] * x + p[5] * y + p[6] * (x**2 + y**2)
            # the logistic function as a tanh, which overflows nowhere
            factor = factor + p[2] * 0.5 * (1.0 + np.tanh(0.5 * q))
        s.elastic = s.elastic * factor
