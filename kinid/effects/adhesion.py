"""A surface that sticks to the tool."""

from __future__ import annotations

from typing import final

import numpy as np

from kinid.effects._effect import Effect
from kinid.effects._signals import Array, Layout, Recall, Signals
from kinid.kernels.memory import bond
from kinid.kernels.recall import recalled_deepest
from kinid.parameter import Parameter


@final
class Adhesion(Effect):
    """N −= F_a b: a bond that has formed at contact pulls on the way out, until it tears at δ = −ℓ; F_a [N], ℓ [m].

    b = 1 − exp(−(δ_m − δ)/ℓ), with δ_m the deepest of this contact: nothing on the way in, the whole pull after ℓ of
    retraction. Outside the material b also falls as (1 − (δ/ℓ)²)², so that nothing jumps at pull-off. On touching anew
    everything begins again.
    """

    id = "adhesion"
    title = "pull until separation"
    equation = "N −= F_a (1 − exp(−(δ_m − δ)/ℓ)), outside of the material times (1 − (δ/ℓ)²)² until δ = −ℓ"
    source = "K. L. Johnson, K. Kendall, A. D. Roberts, Proc. R. Soc. A 324, 1971; D. Maugis, J. Colloid Interface Sci. 150, 1992"
    signature = "a pulling tail at separation, outside the material too"
    confusions = {
        "surface-offset": "a slow retraction: only a bond leaves a negative force",
        "hysteresis": "the tail outside the material, and a shallow poke",
        "viscous-damping": "a slow retraction",
    }
    excited_by = "a slow retraction until well outside the material"
    null = {"force": 0.0}
    grid = {"length": (1e-4, 3e-4, 1e-3, 3e-3)}

    def parameters(self, layout: Layout) -> tuple[Parameter, ...]:
        """Greatest pull, length."""
        return (
            Parameter("force", "F_a", "N", 0.1, 0.0, 1e5, scale=0.05, linear=True),
            Parameter("length", "ℓ", "m", 5e-4, 1e-6, 0.1, scale=1e-4),
        )

    def normal(self, s: Signals, p: Array) -> None:
        """Pull."""
        b = np.empty(len(s))
        bond(s.depth, s.dt, p[1], b)
        s.normal = s.normal - p[0] * b
        if s.compliance > 0.0:
            depth = s.depth
            s.recalls = (*s.recalls, lambda: _recall(depth, s.dt, p))


def _recall(depth: Array, dt: Array, p: Array) -> Recall:
    """Of how deep the bond was made."""
    out, most = Recall.blank(len(dt), 1), np.empty(len(dt))
    recalled_deepest(depth, dt, -p[1], out.keep, out.reach, most)
    left = (1.0 - (np.minimum(depth, 0.0) / p[1]) ** 2) ** 2
    out.size[:, 0] = np.where(most > 0.0, -p[0] / p[1] * left * np.exp(np.minimum(depth - most, 0.0) / p[1]), 0.0)
    return out
