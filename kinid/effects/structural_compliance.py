"""An arm that gives way."""

from __future__ import annotations

from typing import final

from kinid.effects._effect import Effect
from kinid.effects._example import Example, Motion
from kinid.effects._signals import Array, Layout, Signals
from kinid.parameter import Parameter


@final
class StructuralCompliance(Effect):
    """δ → δ − C N, δ̇ → δ̇ − C Ṅ: the contact force bends joints, flange and sensor, and the tip stays behind the
    encoders.

    N is the force that the model itself expects, at which contact law and arm agree: a measured one would carry its
    noise into the depth, which makes C too small. Behind a linear spring k, N = k δ/(1 + C k): one stiffness, which k
    and C share in any way. A law that bends over depth, or that loses energy, tells them apart. Forces between the axes
    (`coupled-stiffness`) and friction don't bend the arm along the normal.
    """

    id = "structural-compliance"
    title = "compliance of arm and sensor"
    equation = "δ → δ − C N"
    source = "G. Alici, B. Shirinzadeh, IEEE Trans. Robotics 21, 2005 (deflection of a loaded arm)"
    signature = "softer than the material is, and the more so the larger the force"
    confusions = {
        "hooke": "nothing: behind a linear spring only their sum shows; press on something hard, or know one of them",
        "presliding": "fast deep pokes: compliance grows with the load, bristles end",
        "hertz-exponent": "a hard surface: compliance is there too",
        "stiffening-layer": "a hard surface: compliance is there too",
    }
    excited_by = "a wide range of forces on something whose stiffness changes with depth, best on something hard"
    null = {"compliance": 0.0}
    affine = False  # a force behind a spring is no sum of those of the law's parts
    grid = {"compliance": (1e-6, 1e-5, 1e-4, 1e-3)}
    admissible = {"compliance": (0.0, 1e-2)}  # a spring is stable; the softest impedance control has 100 N/m
    example = Example(("hertz",), {"hertz.stiffness": 3e4, "compliance": 8e-5}, Motion.WAVES)

    def parameters(self, layout: Layout) -> tuple[Parameter, ...]:
        """Compliance along the normal."""
        return (Parameter("compliance", "C", "m/N", 2e-5, 0.0, 1e-2, scale=1e-5),)

    def geometry(self, s: Signals, p: Array) -> None:
        """State the compliance that the contact law is behind."""
        s.compliance = float(p[0])
