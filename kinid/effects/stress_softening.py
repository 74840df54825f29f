"""A material softer than before where it has been deeper."""

from __future__ import annotations

from typing import final

import numpy as np

from kinid.effects._effect import Effect
from kinid.effects._example import Example
from kinid.effects._signals import Array, Layout, Recall, Signals
from kinid.kernels.memory import deepest
from kinid.kernels.recall import recalled_deepest
from kinid.parameter import Parameter


@final
class StressSoftening(Effect):
    """F_e ·= 1 − r (1 − exp(−(δ_m − δ) / ℓ)): softer below the deepest past depth δ_m, by up to r; ℓ [m].

    On first loading δ = δ_m, and nothing changes; below, force follows one softer path in and out (a pseudo-elastic
    form as in Ogden & Roxburgh, in depth instead of energy). δ_m belongs to one place: a log that visits several must
    be split, or the material be conditioned beforehand.
    """

    id = "stress-softening"
    title = "Mullins effect"
    equation = "F_e ·= 1 − r (1 − exp(−(δ_m − δ) / ℓ))"
    source = (
        "L. Mullins, Rubber Chem. Technol. 21, 1948 and 42, 1969; R. W. Ogden, D. G. Roxburgh, Proc. R. "
        "Soc. A 455, 1999"
    )
    signature = "the first loading is stiffer than all later ones to the same depth"
    confusions = {
        "stiffness-drift": "a deeper poke later: the first path continues beyond the old depth",
        "hysteresis": "the same depth twice: no loop remains in the second cycle",
    }
    excited_by = "the same place twice, then deeper"
    null = {"ratio": 0.0}
    grid = {"length": (1e-4, 3e-4, 1e-3, 3e-3, 1e-2)}
    order = 3
    admissible = {"ratio": (0.0, 1.0), "length": (0.0, 0.05)}  # a share of the force; longer than any poke
    example = Example(("hertz",), {"ratio": 0.3, "length": 1.2e-3})

    def parameters(self, layout: Layout) -> tuple[Parameter, ...]:
        """Ratio, length."""
        return (
            Parameter("ratio", "r", "1", 0.2, 0.0, 1.0, scale=0.05),
            Parameter("length", "ℓ", "m", 1e-3, 1e-6, 0.2, scale=1e-4),
        )

    def elastic(self, s: Signals, p: Array) -> None:
        """Soften."""
        most = np.empty(len(s))
        deepest(s.depth, s.lasting, most)
        before = s.elastic
        s.elastic = before * (1.0 + p[0] * np.expm1((s.penetration - most) / p[1]))
        if s.compliance > 0.0:
            depth = s.depth
            s.recalls = (*s.recalls, lambda: _recall(depth, s.lasting, p, before))


def _recall(depth: Array, dt: Array, p: Array, force: Array) -> Recall:
    """Of the deepest, for a force without softening (n,)."""
    out, most = Recall.blank(len(dt), 1), np.empty(len(dt))
    recalled_deepest(depth, dt, -np.inf, out.keep, out.reach, most)
    soft = np.exp(np.minimum(np.maximum(depth, 0.0) - most, 0.0) / p[1])
    out.size[:, 0] = np.where(most > 0.0, -p[0] / p[1] * force * soft, 0.0)
    return out
