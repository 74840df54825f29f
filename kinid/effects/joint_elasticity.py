"""Joints that wind up."""

from __future__ import annotations

from dataclasses import dataclass
from typing import final

import numpy as np

from kinid.effects._axes import axes
from kinid.effects._derived import derived, rates
from kinid.effects._effect import Effect
from kinid.effects._example import Example, Motion
from kinid.effects._signals import Array, Layout, Signals
from kinid.parameter import Parameter

#: bandwidths that derivatives may have [Hz], and samples that tell which of them a log bears
BANDS, ENOUGH = (25.0, 12.0, 6.0), 200


@final
@dataclass(frozen=True)
class JointElasticity(Effect):
    """τ −= ε τ̈_r + (∂τ_r/∂q) s τ_r + M′ s τ̈_r: a spring K between encoder and link, to first order in 1/K.

    The encoder reads θ, the link is at q = θ − τ/K. Then τ = M q̈ = M θ̈ − (M/K) τ̈, with τ̈ that of the rigid-body
    torque τ_r: the fourth derivative of the position. ε = M/K = 1/ω₀² > 0, ω₀ the resonance of the link with the motor
    locked. With encoders on the links and torques of the motors, τ_m = τ_r + J q̈ + (J/K) τ̈_r: ε = −J/K < 0, J q̈
    being `rotor-inertia`. Links sag by s τ_r, s = 1/K, which turns and pushes what lies beyond: the other terms, M′
    being M without its diagonal. Of an axis without a robot the parameter is M²/K: τ −= (M²/K) d²q̈/dt².

    Attributes:
        bandwidth: of the derivatives [Hz]. With a log (`for_log`) that at which they go best with what is left of its
            torques beside offset, spring, inertia and friction: the fourth derivative of measured positions is noise
            soon.
    """

    bandwidth: float = BANDS[0]

    id = "joint-elasticity"
    title = "elasticity of the joints"
    equation = "τ −= ε d²τ_r/dt² + (∂τ_r/∂q) s τ_r + M′ s d²τ_r/dt²"
    source = "M. W. Spong, J. Dyn. Syst. Meas. Control 109(4), 1987, to first order in 1/K"
    signature = "torque that goes with the fourth derivative of the position: only fast motion shows it"
    confusions = {
        "rotor-inertia": "slow and fast motion: it grows with the fourth power of the frequency, not the second",
        "joint-torque-gain": "slow and fast motion: of one frequency alone it is a gain of ε ω²",
        "time-offset": "it is in phase with the acceleration, a delay is not",
    }
    excited_by = "motion at several frequencies, some near a third of the resonance"
    needs = ("joints",)
    null = {"elasticity": 0.0, "sag": 0.0}
    # a joint whose link swings at less than 1 Hz is no drive, nor is one softer than 500 N·m/rad that of an arm
    admissible = {"elasticity[s²]": (-0.025, 0.025), "sag": (-0.002, 0.002)}
    example = Example(("rigid-body",), {"elasticity": (6e-4, 9e-4)}, Motion.ARM)

    def for_log(self, signals: Signals) -> JointElasticity:
        """With the bandwidth that this log bears; itself where there are no torques to tell it."""
        motion, measured = signals.joints, signals.measured
        if motion is None or measured is None or len(signals) < ENOUGH:
            return self
        torque = motion.rigid if signals.layout.joints else motion.ddq
        known = np.isfinite(measured).all(axis=0)

        def seen(bandwidth: float) -> float:
            bends, total = self._bend(signals, torque, bandwidth), 0.0
            for q, dq, ddq, own, bend, left in zip(
                motion.q, motion.dq, motion.ddq, torque, bends, measured - motion.rigid
            ):
                simple = np.stack([np.ones_like(q), q, dq, np.sign(dq), ddq, own], axis=1)[known]
                both = np.stack([bend, left], axis=1)[known]
                a, b = (both - simple @ np.linalg.lstsq(simple, both, rcond=1e-10)[0]).T
                total += float((a @ b) ** 2 / max(1e-300, (a @ a) * (b @ b)))
            return total

        best = max(BANDS, key=seen)
        return self if best == self.bandwidth else JointElasticity(best)

    def _bend(self, s: Signals, torque: Array, bandwidth: float) -> Array:
        """Second derivative of the torques, (N, n)."""
        return derived(f"second derivative at {bandwidth:g} Hz", lambda: rates(s, torque, 2, bandwidth), torque, s.dt)

    def parameters(self, layout: Layout) -> tuple[Parameter, ...]:
        """Inverse of the squared resonance of each joint, and of its stiffness."""
        if layout.joints:
            # the sag of one joint's spring acts on the torques of all
            named = [(f"elasticity{a.suffix}", "ε", "s²") for a in axes(layout)]
            named += [(f"sag[{joint}.all]", "s", "rad/N/m") for joint in layout.joints]
            return tuple(Parameter(*each, 0.0, -1.0, 1.0, scale=1e-5, linear=True) for each in named)
        return tuple(
            Parameter(
                f"elasticity{a.suffix}",
                "M²/K",
                a.per("·s⁴"),
                0.0,
                -1e3 * a.size,
                1e3 * a.size,
                scale=1e-5 * a.size,
                linear=True,
            )
            for a in axes(layout)
        )

    def joint(self, s: Signals, p: Array) -> None:
        """Take off what the wind-up makes of the torque."""
        assert s.joints is not None
        torque = s.joints.rigid if s.layout.joints else s.joints.ddq
        bend = self._bend(s, torque, self.bandwidth)
        s.reading = s.reading - p[: len(bend), None] * bend
        sag, motion, slopes = p[len(bend) :], s.joints, s.joints.slopes
        if slopes is not None and sag.any():

            def make() -> Array:
                turned, pushed = slopes(motion.q.T, motion.dq.T, motion.ddq.T)
                return np.asarray(turned * torque[:, None] + pushed * bend[:, None])

            s.reading -= np.tensordot(sag, derived(f"sag at {self.bandwidth:g} Hz", make, torque, s.dt), axes=1)
