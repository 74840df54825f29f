"""A loop that speed does not change."""

from __future__ import annotations

from typing import final

import numpy as np

from kinid.effects._effect import Effect
from kinid.effects._example import Example
from kinid.effects._signals import Array, Layout, Recall, Signals
from kinid.kernels.memory import ELASTIC, bristles
from kinid.kernels.recall import recalled_bristles
from kinid.parameter import Parameter


@final
class Hysteresis(Effect):
    """N += min(r F_e + a, F_e) z with dz = (sgn δ̇ − z) |dδ| / ℓ: a Dahl loop over depth, in proportion to the elastic
    force or of one width (Bouc's), or both; ℓ [m].

    z runs from 0 at touch to ±1 over ℓ and depends on the path alone, not on time (Bouc-Wen with γ = 0, n = 1). The
    ratio r is 0…1, the amplitude a a force: loops of soft materials close at the surface, and nothing pulls.
    """

    id = "hysteresis"
    title = "rate-independent loop over depth"
    equation = "N += min(r F_e + a, F_e) z, dz = (sgn δ̇ − z) |dδ| / ℓ"
    source = (
        "P. R. Dahl, Aerospace Corp. TOR-0158(3107-18)-1, 1968; R. Bouc, 1967; Y. K. Wen, J. Eng. Mech. Div. 102, 1976"
    )
    signature = "a loop over depth of a width that speed doesn't change, and nothing moves while depth is held"
    confusions = {
        "relaxation": "slow and fast pokes, and a hold",
        "hunt-crossley-damping": "slow and fast pokes",
        "stress-softening": "the same depth twice: a loop remains in the second cycle",
    }
    excited_by = "the same path in and out at two speeds, with partial unloading"
    affine = False  # a loop is no wider than the force it is in
    null = {"ratio": 0.0, "amplitude": 0.0}
    grid = {"length": (1e-4, 3e-4, 1e-3, 3e-3, 1e-2)}
    # more would pull, less would give energy; longer than any poke
    admissible = {"ratio": (0.0, 1.0), "amplitude": (0.0, 1e3), "length": (0.0, 0.05)}
    example = Example(("kelvin-voigt",), {"ratio": 0.23, "amplitude": 0.1, "length": 0.8e-3})

    def parameters(self, layout: Layout) -> tuple[Parameter, ...]:
        """Ratio, amplitude, length."""
        return (
            Parameter("ratio", "r", "1", 0.1, 0.0, 1.0, scale=0.02),
            Parameter("amplitude", "a", "N", 0.0, 0.0, 1e3, scale=0.05),
            Parameter("length", "ℓ", "m", 1e-3, 1e-6, 0.2, scale=1e-4),
        )

    def normal(self, s: Signals, p: Array) -> None:
        """Add the loop."""
        path = np.empty((2, len(s)))
        bristles(s.depth_rate, np.zeros(len(s)), s.dt, s.depth, p[2], path)  # the same law, over depth
        width = np.minimum(p[0] * s.elastic + p[1], np.maximum(s.elastic, 0.0))
        s.normal = s.normal + width * path[0]
        if s.compliance > 0.0:
            rate, depth = s.depth_rate, s.depth
            s.recalls = (*s.recalls, lambda: _recall(rate, s.dt, depth, p[2], width))


def _recall(rate: Array, dt: Array, depth: Array, length: float, force: Array) -> Recall:
    """Of a loop that is so wide, `force` (n,)."""
    out = Recall.blank(len(dt), 2)
    recalled_bristles(rate, dt, depth, length, ELASTIC, out.keep, out.before, out.now)
    out.size[:, 0], out.size[:, 1] = (1.0 - ELASTIC) * force, force / length
    return out
