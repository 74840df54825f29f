"""Joints that wind up."""

from __future__ import annotations

from dataclasses import dataclass
from typing import final

import numpy as np
from numpy.typing import NDArray

from kinid.effects._axes import axes
from kinid.effects._derived import derived, rates, sample_period
from kinid.effects._effect import Effect
from kinid.effects._example import Example, Motion
from kinid.effects._signals import Array, JointMotion, Layout, Signals
from kinid.parameter import Parameter
from kinid.signal.smoother import smooth_motion

#: bandwidths that derivatives may have [Hz], and samples that tell which of them a log bears
BANDS, ENOUGH = (25.0, 12.0, 6.0), 200
#: angle and torque are averaged over so long [s], and their fourth differences compared: shorter, and noise of the
#: torque hides what winds up; longer, and the motion's own changes do. Fourth ones know nothing of slow motion
WINDOWS, DIFFERENCES = (0.03, 0.05, 0.08), 4
#: a joint winds up where they go together: correlation, and standard deviations of it by chance. A rigid joint's torque
#: is against its angle's changes, if anything: stiff arms under eighty loads came to 0.2 and 3.5, and 0.1 and 5.3
TOGETHER, CHANCE = 0.15, 4.0


@final
@dataclass(frozen=True)
class JointElasticity(Effect):
    """τ −= ε τ̈_r + (∂τ_r/∂q) s τ_r + M′ s τ̈_r: a spring K between encoder and link, to first order in 1/K.

    The encoder reads θ, the link is at q = θ − τ/K. Then τ = M q̈ = M θ̈ − (M/K) τ̈, with τ̈ that of the rigid-body
    torque τ_r: the fourth derivative of the position. ε = M/K = 1/ω₀² > 0, ω₀ the resonance of the link with the motor
    locked. With encoders on the links and torques of the motors, τ_m = τ_r + J q̈ + (J/K) τ̈_r: ε = −J/K < 0, J q̈
    being `rotor-inertia`. Links sag by s τ_r, s = 1/K, which turns and pushes what lies beyond: the other terms, M′
    being M without its diagonal. Of an axis without a robot the parameter is M²/K: τ −= (M²/K) d²q̈/dt².

    Where friction turns, the torque jumps and with it the angle, faster than any bandwidth bears. Joints that show it
    (`for_log`) are not expanded: the link's own motion q = θ − s τ, τ as measured, is smoothed anew, with s from these
    jumps, and what its torques differ in goes with s. They have no ε.

    Attributes:
        wound: joints whose angle jumps with the measured torque, and their 1/K [rad/N/m] as these jumps say it.
        bandwidth: of the derivatives [Hz]. With a log (`for_log`) that at which they go best with what is left of its
            torques beside offset, spring, inertia and friction: the fourth derivative of measured positions is noise
            soon.
    """

    bandwidth: float = BANDS[0]
    wound: tuple[tuple[str, float], ...] = ()

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
        """With the bandwidth that this log bears, and the joints that jump; itself where no torques tell them."""
        motion, measured = signals.joints, signals.measured
        if motion is None or measured is None or len(signals) < ENOUGH:
            return self
        jump = _jumps(signals, motion.q, measured) if motion.slopes is not None else np.zeros(len(motion.q))
        wound = tuple((name, float(s)) for name, s in zip(signals.layout.joints, jump) if s > 0.0)
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
        return self if (best, wound) == (self.bandwidth, self.wound) else JointElasticity(best, wound)

    def _bend(self, s: Signals, torque: Array, bandwidth: float) -> Array:
        """Second derivative of the torques, (N, n)."""
        return derived(f"second derivative at {bandwidth:g} Hz", lambda: rates(s, torque, 2, bandwidth), torque, s.dt)

    def parameters(self, layout: Layout) -> tuple[Parameter, ...]:
        """Inverse of the squared resonance of each joint, and of its stiffness."""
        if layout.joints:
            # the sag of one joint's spring acts on the torques of all
            bent = [axis for axis, free in zip(axes(layout), self._bent(layout)) if free]
            named = [(f"elasticity{axis.suffix}", "ε", "s²") for axis in bent]
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
        motion, rows = s.joints, np.flatnonzero(self._bent(s.layout))
        assert motion is not None
        torque = motion.rigid if s.layout.joints else motion.ddq
        bend = self._bend(s, torque, self.bandwidth)
        s.reading = s.reading.copy()
        s.reading[rows] -= p[: len(rows), None] * bend[rows]
        sag, slopes = p[len(rows) :], motion.slopes
        if slopes is None or not sag.any():
            return

        def make() -> Array:
            turned, swayed, pushed = slopes(motion.q.T, motion.dq.T, motion.ddq.T)
            angle, rate, change = self._wind_up(s, motion, torque, bend)
            pushed[rows, rows] = 0.0  # that is ε's
            return np.asarray(turned * angle[:, None] + swayed * rate[:, None] + pushed * change[:, None])

        given = (torque, s.dt) if s.measured is None else (torque, s.dt, s.measured)
        s.reading -= np.tensordot(sag, derived(f"sag at {self.bandwidth:g} Hz of {self.wound}", make, *given), axes=1)

    def _bent(self, layout: Layout) -> NDArray[np.bool_]:
        """Which joints have an ε, (N,)."""
        wound = dict(self.wound)
        return np.array([axis.suffix.strip("[]") not in wound for axis in axes(layout)], dtype=np.bool_)

    def _wind_up(self, s: Signals, motion: JointMotion, torque: Array, bend: Array) -> tuple[Array, Array, Array]:
        """How far the link's angle, rate and acceleration are behind the encoder's per 1/K, each (N, n)."""
        out = (torque.copy(), np.zeros_like(torque), bend.copy())
        if not self.wound or s.measured is None:
            return out
        at, size = [s.layout.joints.index(name) for name, _ in self.wound], np.array([[k] for _, k in self.wound])
        load = np.where(np.isfinite(s.measured), s.measured, torque)[at]
        link = smooth_motion(s.t, np.ascontiguousarray((motion.q[at] - size * load).T), s.runs)
        pairs = ((motion.q, link.value), (motion.dq, link.first), (motion.ddq, link.second))
        for own, (encoder, beyond) in zip(out, pairs):
            own[at] = np.nan_to_num((encoder[at] - beyond.T) / size)
        return out


def _jumps(s: Signals, q: Array, torque: Array) -> Array:
    """1/K of each joint whose angle jumps with its torque [rad/N/m], 0 of the others, (N,).

    Noise of the torque would make a regression on it too flat: its value half a window away is the instrument.
    """
    period = sample_period(s)
    best, out = np.zeros(len(q)), np.zeros(len(q))
    for window in WINDOWS:
        size = max(2, round(window / period))
        cut = [run for run in s.runs if run.stop - run.start > (DIFFERENCES + 2) * size]
        if sum(run.stop - run.start for run in cut) < ENOUGH:
            continue
        away = size // 2
        pairs = [(_differences(torque[:, run], size), _differences(q[:, run], size)) for run in cut]
        shifted = [(push[:, away:], push[:, :-away], turn[:, away:], turn[:, :-away]) for push, turn in pairs]
        late, early, turned_late, turned_early = (np.concatenate(side, axis=1) for side in zip(*shifted))
        known = np.isfinite(late + early).all(axis=0)
        late, early, turned_late, turned_early = (x[:, known] for x in (late, early, turned_late, turned_early))
        slope = (late * turned_early + early * turned_late).sum(axis=1) / np.maximum(
            2.0 * (late * early).sum(axis=1), 1e-300
        )
        together = (early * turned_early).sum(axis=1)
        together /= np.sqrt(np.maximum((early**2).sum(axis=1) * (turned_early**2).sum(axis=1), 1e-300))
        sure = (
            (together > TOGETHER) & (together * np.sqrt(known.sum() / size) > CHANCE) & (together > best) & (slope > 0)
        )
        best[sure], out[sure] = together[sure], slope[sure]
    return out


def _differences(x: Array, size: int) -> Array:
    """Differences of means over so many samples that follow each other, (N, samples)."""
    total = np.cumsum(np.pad(x, ((0, 0), (1, 0))), axis=1)
    out = (total[:, size:] - total[:, :-size]) / size
    for _ in range(DIFFERENCES):
        out = out[:, size:] - out[:, :-size]
    return out
