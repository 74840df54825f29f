"""Friction of the joints that is another one in each direction."""

from __future__ import annotations

from collections.abc import Mapping
from typing import final

import numpy as np

from kinid.effects._axes import axes
from kinid.effects._effect import Effect
from kinid.effects._signals import Array, Layout, Signals
from kinid.parameter import Parameter


@final
class JointFrictionAsymmetry(Effect):
    """τ += a |q̇|: viscosity is b + a forwards and b − a backwards.

    Dry friction that differs between the directions by a constant is a `joint-torque-offset` wherever the joint moves.
    """

    id = "joint-friction-asymmetry"
    title = "viscous friction that depends on the direction"
    equation = "τ += a |q̇|"
    source = "A. Janot, M. Gautier, M. Brunot, Workshop on Nonlinear System Identification Benchmarks, 2019 (EMPS drive)"
    signature = "torque that grows with speed, with one sign in both directions"
    confusions = {"joint-torque-offset": "several speeds in both directions"}
    excited_by = "several speeds in both directions"
    needs = ("joints",)
    null = {"asymmetry": 0.0}

    def parameters(self, layout: Layout) -> tuple[Parameter, ...]:
        """Half the difference of the viscosities of each joint."""
        return tuple(
            Parameter(f"asymmetry{a.suffix}", "a", a.per("·s"), 0.0, -1e5 * a.size, 1e5 * a.size, scale=0.1 * a.size,
                      linear=True)
            for a in axes(layout)
        )  # fmt: skip

    def implausible(self, values: Mapping[str, float], model_values: Mapping[str, float], signals: Signals | None = None) -> str:
        """A viscosity that gives energy in one direction."""
        for name, value in values.items():
            both = model_values.get(f"joint-viscous-friction.viscous{name.removeprefix('asymmetry')}")
            if both is not None and abs(value) > both:
                return f"{name} = {value:.3g} beside a viscosity of {both:.3g}: one direction would give energy"
        return super().implausible(values, model_values, signals)

    def joint(self, s: Signals, p: Array) -> None:
        """Add the torque."""
        assert s.joints is not None
        s.reading = s.reading + p[:, None] * np.abs(s.joints.dq)
