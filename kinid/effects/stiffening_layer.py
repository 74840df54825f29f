"""Something stiffer underneath."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import final

import numpy as np

from kinid.effects._effect import Effect
from kinid.effects._example import Example
from kinid.effects._signals import Array, Layout, Signals
from kinid.parameter import Parameter


@final
class StiffeningLayer(Effect):
    """F_e += K (δ − δ_b) for δ > δ_b: extra stiffness K [N/m] beyond the depth δ_b [m]."""

    id = "stiffening-layer"
    title = "stiffer below one depth"
    equation = "F_e += K max(0, δ − δ_b)"
    source = "N. E. Waters, Br. J. Appl. Phys. 16, 1965 (thin layers on a stiff ground)"
    signature = "a bend in force over depth, at one depth"
    confusions = {"hertz-exponent": "a deeper poke: a layer is straight above and below its bend"}
    excited_by = "depths well on both sides of the layer"
    null = {"stiffness": 0.0}
    grid = {"depth": (3e-4, 1e-3, 2e-3, 4e-3, 8e-3, 1.6e-2)}
    order = 1
    map_names = {"depth": "film.thickness"}
    above = {"stiffness": "film.stiffness"}
    tolerated = {"stiffness": math.inf}  # no material has exactly the form of a law
    admissible = {
        "stiffness": (-1e8, 1e8),
        "depth": (0.0, 0.5),
    }  # a softer core is possible as long as the sum isn't negative
    example = Example(("hooke",), {"stiffness": 900.0, "depth": 2.3e-3})

    def parameters(self, layout: Layout) -> tuple[Parameter, ...]:
        """Extra stiffness, where it begins."""
        return (
            Parameter("stiffness", "K", "N/m", 500.0, -1e8, 1e8, scale=100.0, linear=True),
            Parameter("depth", "δ_b", "m", 2e-3, 0.0, 0.5, scale=1e-4),
        )

    def initial_guesses(self, signals: Signals) -> tuple[Array, ...]:
        """Layers that begin at depths which the log holds: a sixth of the samples inside between each and the next."""
        inside = signals.depth[signals.inside]
        if not len(inside):
            return ()
        stiffness = self.parameters(signals.layout)[0].nominal
        return tuple(np.array([stiffness, depth]) for depth in np.quantile(inside, np.arange(1, 6) / 6))

    def implausible(
        self, values: Mapping[str, float], model_values: Mapping[str, float], signals: Signals | None = None
    ) -> str:
        """A sum of base and layer that falls with depth is no material."""
        base = max(
            (value for name, value in model_values.items() if name in ("hooke.stiffness", "kelvin-voigt.stiffness")),
            default=math.inf,
        )
        if "hertz-exponent.exponent" not in model_values and base + values.get("stiffness", 0.0) < 0.0:
            return (
                f"stiffness = {values['stiffness']:.3g} N/m below the layer's depth: more than the {base:.3g} "
                "N/m above it"
            )
        return super().implausible(values, model_values, signals)

    def validity_range(self, signals: Signals) -> str:
        """Nothing is known of what lies deeper than the tool was."""
        return f"down to {1e3 * float(signals.depth.max(initial=0.0)):.2g} mm"

    def elastic(self, s: Signals, p: Array) -> None:
        """Add the layer."""
        s.elastic = s.elastic + p[0] * np.maximum(s.depth - p[1], 0.0)
