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

    u is that of `joint-coulomb-friction`, which turns within a fixed travel. One v_s serves all joints: drives of one
    arm share their lubricant. It is that of a joint that turns; one that slides has v_s · 0.1 m, and alone its own
    [m/s].
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
    example = Example(("rigid-body", "joint-coulomb-friction"), {"speed": 0.3, "excess": (0.5, 0.3)}, Motion.ARM)

    def parameters(self, layout: Layout) -> tuple[Parameter, ...]:
        """Excess of each joint, speed over which all fade."""
        every = axes(layout)
        if not every:
            return ()
        unit = "rad" if any(a.position == "rad" for a in every) else "m"
        return (
            *(
                Parameter(
                    f"excess{a.suffix}", "Δ", a.torque, 0.3 * a.size, 0.0, 1e4 * a.size, scale=0.1 * a.size, linear=True
                )
                for a in every
            ),
            Parameter("speed", "v_s", f"{unit}/s", 0.05, 1e-5, 100.0, scale=0.01),
        )

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
        positions = [a.position for a in axes(s.layout)]
        slide = 0.1 if "rad" in positions else 1.0
        speed = p[-1] * np.array([1.0 if position == "rad" else slide for position in positions])
        slow = derived("slowness", lambda: np.exp(-((motion.dq / speed[:, None]) ** 2)), motion.dq, at=(float(p[-1]),))
        s.reading = s.reading + p[:-1, None] * directions(s) * slow
