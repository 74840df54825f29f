"""Friction of the joints that fades with speed."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import final

import numpy as np

from kinid.effects._axes import axes, directions
from kinid.effects._derived import derived
from kinid.effects._effect import Effect
from kinid.effects._example import Example, Motion
from kinid.effects._signals import Array, Layout, Signals
from kinid.parameter import Parameter


@final
class JointStribeckFriction(Effect):
    """τ += Δ u exp(−(q̇/v_s)²): dry friction exceeds that of fast motion by Δ where a joint is slow; it fades over v_s.

    u is that of `joint-coulomb-friction`, which turns within a fixed travel. Each joint has a v_s of its own: gears of
    one arm share their grease, but not their size.
    """

    id = "joint-stribeck-friction"
    title = "friction of the joints that fades with speed"
    equation = "τ += Δ u exp(−(q̇/v_s)²)"
    source = (
        "R. Stribeck, Z. VDI 46, 1902; for robots: B. Armstrong-Hélouvry, P. Dupont, C. Canudas de Wit, Automatica "
        "30(7), 1994; "
        "A. C. Bittencourt, S. Gunnarsson, J. Dyn. Syst. Meas. Control 134(5), 2012"
    )
    signature = "a step in the torque at reversals that is higher where the joint goes slowly"
    confusions = {
        "joint-coulomb-friction": "several speeds: this one fades",
        "joint-viscous-friction": "three speeds: one grows with speed, the other fades",
        "joint-load-friction": "one speed in several poses: this one doesn't follow the load",
    }
    excited_by = "motion in both directions at three speeds, the slowest well below v_s"
    needs = ("joints",)
    requires = ("joint-coulomb-friction",)
    null = {"excess": 0.0}
    tolerated = {"excess": math.inf}  # no friction has the form of a model where it comes to rest
    grid = {"speed": (0.01, 0.03, 0.1, 0.3)}
    # friction fades with speed (what grows is viscous); films of grease carry from some per cent of a drive's speed on
    admissible = {"excess": (0.0, 1e5), "speed": (1e-4, 3.0)}
    example = Example(("rigid-body", "joint-coulomb-friction"), {"speed": (0.3, 0.2), "excess": (0.5, 0.3)}, Motion.ARM)

    def parameters(self, layout: Layout) -> tuple[Parameter, ...]:
        """Excess of each joint, and the speed over which it fades."""
        every = axes(layout)
        return (
            *(
                Parameter(
                    f"excess{a.suffix}", "Δ", a.torque, 0.3 * a.size, 0.0, 1e4 * a.size, scale=0.1 * a.size, linear=True
                )
                for a in every
            ),
            *(
                Parameter(f"speed{a.suffix}", "v_s", f"{a.position}/s", 0.05 * reach, 1e-5, 100.0, scale=0.01 * reach)
                for a, reach in zip(every, _reach(layout).tolist())
            ),
        )

    def initial_guesses(self, signals: Signals) -> tuple[Array, ...]:
        """All joints with one speed after the other."""
        excess = [p.nominal for p in self.parameters(signals.layout) if p.linear]
        reach = _reach(signals.layout)
        return tuple(np.concatenate([excess, speed * reach]) for speed in self.grid["speed"])

    def implausible(
        self, values: Mapping[str, float], model_values: Mapping[str, float], signals: Signals | None = None
    ) -> str:
        """Dry friction that is negative at rest, too."""
        for name, value in values.items():
            suffix = name.removeprefix("excess")
            rest = model_values.get(f"joint-coulomb-friction.coulomb{suffix}", 0.0) + value
            if name.startswith("excess") and rest < 0.0:
                return f"{name} = {value:.3g} makes dry friction at rest {rest:.3g}: friction takes energy"
        return super().implausible(values, model_values, signals)

    def joint(self, s: Signals, p: Array) -> None:
        """Add the torque."""
        motion = s.joints
        assert motion is not None
        excess, speed = p.reshape(2, -1, 1)
        slow = derived(
            "slowness", lambda: np.exp(-((motion.dq / speed) ** 2)), motion.dq, at=tuple(speed.ravel().tolist())
        )
        s.reading = s.reading + excess * directions(s) * slow


def _reach(layout: Layout) -> Array:
    """What each joint moves by where others turn by a radian: 1 [rad], or 0.1 [m], (N,); 1 [m] where none turns."""
    turns = np.array([a.position == "rad" for a in axes(layout)], dtype=np.bool_)
    return np.where(turns | ~turns.any(), 1.0, 0.1)
