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
    """N −= min(Σ rᵢ yᵢ, F_e) with τᵢ ẏᵢ = F_e − yᵢ: Maxwell branches hold a share rᵢ of the elastic force and lose it
    in τᵢ [s].

    F_e is the force before anything has flowed; (1 − Σ rᵢ) F_e remains in the end. The branches are driven by F_e
    whatever its shape over depth (quasi-linear viscoelasticity). The material recovers with the same τᵢ after the tool
    has left. A tool that retracts faster than the material recovers leaves it: nothing pulls.

    Attributes:
        branches: their number; parameters of the second one end in 2, and so on.

    Raises:
        InputError: no branch.
    """

    branches: int = 1

    id = "relaxation"
    title = "stress relaxation"
    equation = "N −= min(Σ rᵢ yᵢ, F_e), τᵢ ẏᵢ = F_e − yᵢ"
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
    # a share of the force, of either branch alone and of all together (`implausible`)
    admissible = {"ratio": (0.0, 1.0), "time-constant": (1e-4, 1e5)}
    example = Example(("kelvin-voigt", "stiffening-layer"), {"ratio": 0.62, "time-constant": 0.3})

    def __post_init__(self) -> None:
        if self.branches < 1:
            raise InputError(f"relaxation with {self.branches} branches", "1 or more", "leave the effect out instead")

    def null_for(self, base: str | None) -> Mapping[str, float]:
        """No branch holds anything."""
        return {f"ratio{end}": 0.0 for end in self._ends}

    @property
    def _ends(self) -> tuple[str, ...]:
        return ("", *(str(k) for k in range(2, self.branches + 1)))

    def parameters(self, layout: Layout) -> tuple[Parameter, ...]:
        """Ratio and time constant of each branch; the branches start a decade apart."""
        return tuple(
            parameter
            for k, end in enumerate(self._ends)
            for parameter in (
                Parameter(f"ratio{end}", f"r{end}", "1", 0.2, 0.0, 1.0, scale=0.05),
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
        """Shares of all branches together, too, the range of each, and what flows faster than samples follow."""
        held = [value for name, value in values.items() if name.startswith("ratio")]
        if sum(held) > 1.0 + 1e-9:
            return f"branches hold {sum(held):.3g} of the elastic force: no more than all of it relaxes"
        fastest = min((value for name, value in values.items() if name.startswith("time-constant")), default=np.inf)
        period = sample_period(signals) if signals is not None and signals.dt.any() else 0.0
        if fastest < period:
            return f"a time constant of {fastest:.2g} s, less than the {period:.2g} s between samples: that is damping"
        first = [{name.rstrip("0123456789"): value} for name, value in values.items()]
        return next((why for one in first if (why := super(Relaxation, self).implausible(one, model_values))), "")

    def normal(self, s: Signals, p: Array) -> None:
        """Take off what has flowed."""
        flowed, total = np.empty(len(s)), np.zeros(len(s))
        for ratio, time_constant in p.reshape(-1, 2):
            lowpass(s.elastic, s.flowing, time_constant, flowed)
            total = total + ratio * flowed
        s.normal = s.normal - np.minimum(total, s.elastic) * s.inside
