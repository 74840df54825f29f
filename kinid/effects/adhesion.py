"""A surface that sticks to the tool."""

from __future__ import annotations

from collections.abc import Mapping
from typing import final

import numpy as np

from kinid.effects._effect import Effect
from kinid.effects._example import Example
from kinid.effects._signals import Array, Layout, Recall, Signals
from kinid.kernels.recall import recalled_deepest
from kinid.parameter import Parameter

#: ends of the retraction until a bond pulls [m], and of the shape of its neck
SHORTEST, LATEST = 1e-6, 20.0


@final
class Adhesion(Effect):
    """N −= F_a (1 − (1 − s) exp(−(δ_m − δ)/r)) g(−δ/ℓ): a bond that has formed at contact pulls with F_a [N], until it
    tears at δ = −ℓ [m].

    A share s of the pull is there from touch on, in and out; the rest comes on the way out, from the deepest of this
    contact, δ_m, on, within a retraction of r [m]. Outside the material a neck tears, g(x) = 1 − xᵖ: nothing jumps at
    pull-off, but what has a neck of large p tears late and fast. On touching anew everything begins again. Cases, some
    within a few per cent of the pull: a constant pull with a neck (p large), a pull that fades with the distance
    (Dugdale, p = 1), and a soft sphere (JKR: s = 1 with p large, beside a base `hertz`). Friction is that of the load
    N + λ × pull, and none where that is negative: with λ = 1 the bond presses together what rubs (B. V. Derjaguin, Wear
    128, 1988), with λ = 0 it takes its pull off the load.
    """

    id = "adhesion"
    title = "pull until separation"
    equation = "N −= F_a (1 − (1 − s) exp(−(δ_m − δ)/r)), outside of the material times 1 − (−δ/ℓ)ᵖ until δ = −ℓ"
    source = (
        "K. L. Johnson, K. Kendall, A. D. Roberts, Proc. R. Soc. A 324, 1971; "
        "D. S. Dugdale, J. Mech. Phys. Solids 8, 1960; D. Maugis, J. Colloid Interface Sci. 150, 1992"
    )
    signature = "a pulling tail at separation, outside the material too"
    confusions = {
        "surface-offset": "a slow retraction: only a bond leaves a negative force",
        "hysteresis": "the tail outside the material, and a shallow poke",
        "viscous-damping": "a slow retraction",
    }
    excited_by = "a slow retraction until well outside the material"
    acts_outside = True
    affine, nearly_affine = False, True  # with λ < 1, where a bond would take off more load than there is
    null = {"force": 0.0}
    grid = {
        "tack": (0.1, 0.9),
        "length": (1e-4, 3e-4, 1e-3, 3e-3),
        "rise": (3e-5, 3e-4),
        "neck": (1.0, 4.0),
        "rubbing": (0.0, 1.0),
    }
    admissible = {"force": (0.0, 1e4), "length": (0.0, 0.02)}  # bonds pull; necks of gels reach a centimetre
    example = Example(
        ("hooke", "coulomb-friction"),
        {"force": 0.55, "tack": 0.27, "length": 0.6e-3, "rise": 0.4e-3, "neck": 2.6, "rubbing": 0.7},
    )

    def parameters(self, layout: Layout) -> tuple[Parameter, ...]:
        """Pull at its greatest, share of it on the way in, reach, retraction until it pulls, neck, share that rubs."""
        return (
            Parameter("force", "F_a", "N", 0.1, 0.0, 1e5, scale=0.05, linear=True),
            Parameter("tack", "s", "1", 0.0, 0.0, 1.0, scale=0.1),
            Parameter("length", "ℓ", "m", 5e-4, 1e-6, 0.1, scale=1e-4),
            Parameter("rise", "r", "m", 3e-4, SHORTEST, 0.1, scale=1e-4),
            Parameter("neck", "p", "1", 2.0, 0.5, LATEST, scale=0.5),
            Parameter("rubbing", "λ", "1", 1.0, 0.0, 1.0, scale=0.2),
        )

    def implausible(
        self, values: Mapping[str, float], model_values: Mapping[str, float], signals: Signals | None = None
    ) -> str:
        """A bond that nothing tears: what pulls on the way in as on the way out acts at a distance, too."""
        inside = signals.depth > 0.0 if signals is not None else np.zeros(0, bool)
        if signals is not None and inside.any():
            farthest = max(-float(np.nanmin(signals.depth[int(np.argmax(inside)) :])), 0.0)
            if values.get("length", 0.0) > farthest:
                return (
                    f"a bond that reaches {1e3 * values['length']:.3g} mm, where the tip goes back "
                    f"{1e3 * farthest:.3g} mm: it never tears"
                )
        return super().implausible(values, model_values, signals)

    def normal(self, s: Signals, p: Array) -> None:
        """Pull."""
        force, tack, length, rise, neck, rubbing = (float(value) for value in p)
        keep, reach, before = np.empty((len(s), 1, 1)), np.empty((len(s), 1)), np.empty(len(s))
        recalled_deepest(s.depth, s.dt, -length, keep, reach, before)
        most = np.maximum(before, s.penetration * reach[:, 0])
        pull = force * (1.0 - (1.0 - tack) * np.exp(np.minimum(s.depth - most, 0.0) / rise))
        pull = np.where(most > 0.0, pull * _left(s.depth, length, neck), 0.0)
        s.normal, s.pull, s.pressing = s.normal - pull, pull, rubbing
        if s.compliance > 0.0:
            depth = s.depth

            def recall() -> Recall:
                """Of how deep the bond was made."""
                out = Recall.blank(len(depth), 1)
                out.keep[:], out.reach[:] = keep, reach
                grown = np.exp(np.minimum(depth - before, 0.0) / rise)
                change = -force * (1.0 - tack) / rise * _left(depth, length, neck) * grown
                out.size[:, 0] = np.where(before > 0.0, change, 0.0)
                return out

            s.recalls = (*s.recalls, recall)


def _left(depth: Array, length: float, neck: float) -> Array:
    """Share of a bond that has not torn, (n,)."""
    out: Array = 1.0 - np.clip(-depth / length, 0.0, 1.0) ** neck
    return out
