"""Friction of the joints that is another one in each direction."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import final

import numpy as np

from kinid.effects._axes import axes, directions, usual_offset
from kinid.effects._effect import Effect
from kinid.effects._example import Example, Motion
from kinid.effects._signals import Array, Layout, Signals
from kinid.parameter import Parameter, ParameterId


@final
class JointFrictionAsymmetry(Effect):
    """τ += a |q̇| + d |u|: viscosity is b + a forwards and b − a backwards, dry friction c + d and c − d.

    u is that of `joint-coulomb-friction`. Where a joint moves all the time, d is a `joint-torque-offset`.
    """

    id = "joint-friction-asymmetry"
    title = "friction that depends on the direction"
    equation = "τ += a |q̇| + d |u|"
    source = (
        "A. Janot, M. Gautier, M. Brunot, Workshop on Nonlinear System Identification Benchmarks, 2019 (EMPS drive)"
    )
    signature = "torque that grows with speed, or stays, with one sign in both directions"
    confusions = {"joint-torque-offset": "several speeds in both directions, and rests: an offset stays there"}
    excited_by = "several speeds in both directions"
    needs = ("joints",)
    null = {"asymmetry": 0.0, "dry": 0.0}
    example = Example(("rigid-body",), {"asymmetry": -31.0}, Motion.DRIVE)

    def parameters(self, layout: Layout) -> tuple[Parameter, ...]:
        """Half the difference of the viscosities of each joint, and of its dry frictions."""
        return tuple(
            Parameter(
                f"{name}{a.suffix}", symbol, unit, 0.0, -1e5 * a.size, 1e5 * a.size, scale=0.1 * a.size, linear=True
            )
            for a in axes(layout)
            for name, symbol, unit in (("asymmetry", "a", a.per("·s")), ("dry", "d", a.torque))
        )

    def usual(self, parameter: Parameter) -> float:
        """The offset of a sensor; viscosity is measured in the same torque, at 1 rad/s."""
        return usual_offset(parameter.name)

    def implausible(
        self, values: Mapping[str, float], model_values: Mapping[str, float], signals: Signals | None = None
    ) -> str:
        """Friction that gives energy in one direction."""
        whole = {
            "asymmetry": ParameterId("joint-viscous-friction", "viscous"),
            "dry": ParameterId("joint-coulomb-friction", "coulomb"),
        }
        for name, value in values.items():
            own = ParameterId.parse(name)
            mean = replace(whole[own.name], index=own.index)
            both = model_values.get(str(mean))
            if both is not None and abs(value) > both:
                return f"{name} = {value:.3g} beside {mean.name} {both:.3g}: one direction would give energy"
        return super().implausible(values, model_values, signals)

    def joint(self, s: Signals, p: Array) -> None:
        """Add the torque."""
        assert s.joints is not None
        s.reading = s.reading + p[0::2, None] * np.abs(s.joints.dq) + p[1::2, None] * np.abs(directions(s))
