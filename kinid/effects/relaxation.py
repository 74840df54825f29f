"""Stress that relaxes."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import final

import numpy as np

from kinid.effects._derived import sample_period
from kinid.effects._effect import Effect
from kinid.effects._example import Example
from kinid.effects._signals import Array, Layout, Signals
from kinid.errors import InputError
from kinid.kernels.memory import lowpass
from kinid.parameter import Parameter


@final
@dataclass(frozen=True)
class Relaxation(Effect):
    """N += max(Σ ρᵢ (F_e − yᵢ), −F_e) with τᵢ ẏᵢ = F_e − yᵢ: Maxwell branches, ρᵢ times as stiff as the spring beside
    them, lose their force in τᵢ [s].

    F_e is the force that lasts, that of the model without relaxation; (1 + Σ ρᵢ) F_e is there before anything has
    flowed. The branches are driven by F_e whatever its shape over depth (quasi-linear viscoelasticity). The material
    recovers with the same τᵢ after the tool has left. A tool that retracts faster than the material recovers leaves it:
    nothing pulls. In a Prony series of the force at once the branches have the shares ρᵢ / (1 + Σ ρᵢ).

    Attributes:
        branches: their number; parameters of the second one end in 2, and so on.

    Raises:
        InputError: no branch.
    """

    branches: int = 1

    id = "relaxation"
    title = "stress relaxation"
    equation = "N += max(Σ ρᵢ (F_e − yᵢ), −F_e), τᵢ ẏᵢ = F_e − yᵢ"
    source = "J. C. Maxwell, Phil. Trans. R. Soc. 157, 1867; quasi-linear: Y. C. Fung, Biomechanics, 1981, ch. 7"
    signature = "force that decays while depth is held, and a loop that is widest at one speed"
    confusions = {
        "hysteresis": "the same path at other speeds, and a hold",
        "stiffness-drift": "a long hold, then the same place again after a rest",
        "viscous-damping": "a wide range of frequencies",
    }
    excited_by = "a fast approach, then a hold of several time constants"
    null = {"ratio": 0.0}
    affine = False  # a tool that leaves does so at a force that all parameters of the law decide
    grid = {"time-constant": (0.02, 0.1, 0.4, 1.5, 6.0, 30.0)}
    unremarkable = {"ratio": 0.015}  # no soft material holds all of a force
    # glass is a thousand times as stiff as the same polymer when it has relaxed (J. D. Ferry 1980, ch. 2)
    admissible = {"ratio": (0.0, 1e3), "time-constant": (1e-4, 1e5)}
    example = Example(("kelvin-voigt", "stiffening-layer"), {"ratio": 1.6, "time-constant": 0.3})

    def __post_init__(self) -> None:
        if self.branches < 1:
            raise InputError(f"relaxation with {self.branches} branches", "1 or more", "leave the effect out instead")

    def null_for(self, base: str | None) -> Mapping[str, float]:
        """No branch holds anything."""
        return {f"ratio{end}": 0.0 for end in self._ends}

    @property
    def _ends(self) -> tuple[str, ...]:
        return ("", *(str(k) for k in range(2, self.branches + 1)))

    def validity_range(self, signals: Signals) -> str:
        """What relaxes much faster or more slowly than any touch looks like a spring."""
        looked_at = self.grid["time-constant"]
        return f"for time constants from {looked_at[0]:g} to {looked_at[-1]:g} s"

    def parameters(self, layout: Layout) -> tuple[Parameter, ...]:
        """Ratio and time constant of each branch; the branches start a decade apart."""
        return tuple(
            parameter
            for k, end in enumerate(self._ends)
            for parameter in (
                Parameter(f"ratio{end}", f"ρ{end}", "1", 0.25, 0.0, 1e4, scale=0.05),
                Parameter(f"time-constant{end}", f"τ{end}", "s", 0.5 * 10.0**k, 1e-4, 1e5, scale=0.1 * 10.0**k),
            )
        )

    def initial_guesses(self, signals: Signals) -> tuple[Array, ...]:
        """The grid's time constants for the fastest branch, the others a decade apart."""
        (ratio, _), high = (p.nominal for p in self.parameters(signals.layout)[:2]), 1e5
        return tuple(
            np.ravel([(ratio / self.branches, min(fastest * 10.0**k, high)) for k in range(self.branches)])
            for fastest in self.grid["time-constant"]
        )

    def implausible(
        self, values: Mapping[str, float], model_values: Mapping[str, float], signals: Signals | None = None
    ) -> str:
        """The range of each branch, and what flows faster than samples follow."""
        fastest = min((value for name, value in values.items() if name.startswith("time-constant")), default=np.inf)
        period = sample_period(signals) if signals is not None and signals.dt.any() else 0.0
        if fastest < period:
            return f"a time constant of {fastest:.2g} s, less than the {period:.2g} s between samples: that is damping"
        first = [{name.rstrip("0123456789"): value} for name, value in values.items()]
        return next((why for one in first if (why := super(Relaxation, self).implausible(one, model_values))), "")

    def normal(self, s: Signals, p: Array) -> None:
        """Add what the branches hold."""
        flowed, held = np.empty(len(s)), np.zeros(len(s))
        for ratio, time_constant in p.reshape(-1, 2):
            lowpass(s.elastic, s.flowing, time_constant, flowed)
            held = held + ratio * (s.elastic - flowed)
        s.normal = s.normal + np.maximum(held, -s.elastic) * s.inside
