"""Torque that goes up and down as a joint turns."""

from __future__ import annotations

import itertools
from collections.abc import Mapping
from dataclasses import dataclass
from typing import final

import numpy as np

from kinid.effects._axes import Axis, axes
from kinid.effects._derived import derived
from kinid.effects._effect import Effect
from kinid.effects._example import Example, Motion
from kinid.effects._signals import Array, Layout, Signals
from kinid.parameter import Parameter

#: a ripple and one harmonic
HARMONICS = (1, 2)
#: a ripple passes so often over the travel, at least: what does less is no more a ripple than a slope
PERIODS = 1.5
#: orders that are looked for: no higher than this for each radian, or metre
HIGHEST = {"rad": 1000.0, "m": 2e4}
#: bins of the angle for each turn of the highest order, and the most of them
FINE, MOST_BINS = 4, 1 << 15
#: lines that are looked at more closely; and how far above their neighbourhood one stands that is no chance
LINES, STANDS_OUT = 6, 16.0
#: samples of a sweep, at least; samples that a line is sharpened with, at most
SWEEP, MOST_FITTED = 30, 6000
#: half an order is taken where it leaves less than this share of what the order itself does
HALVED = 0.9
#: so many neighbours to both sides tell how high a spectrum is beside a line
BESIDE = 40


@final
@dataclass(frozen=True)
class JointTorqueRipple(Effect):
    """τ += Σ_h a_h sin(h k q) + b_h cos(h k q), h = 1, 2: k [1] of each joint, cycles for each turn.

    Teeth of gears and the magnets of motors pass so many times a turn; a flexspline twice for each turn of its wave
    generator, an eccentric torque sensor once or twice a turn of the joint. With a log (`for_log`) those joints have
    parameters whose torque shows a line over the angle, beside what is smooth within a sweep; if none does, the one
    that is nearest to it. Without a log all have.

    Attributes:
        orders: joint → k that a search starts from; None without a log. lowest: of each of these joints, k that passes
            `PERIODS` times over the travel; empty for no limit.
    """

    orders: tuple[tuple[str, float], ...] | None = None
    lowest: tuple[float, ...] = ()

    id = "joint-torque-ripple"
    title = "ripple of the torque over the angle"
    equation = "τ += Σ_h a_h sin(h k q) + b_h cos(h k q), h = 1, 2"
    source = (
        "T. D. Tuttle, W. P. Seering, IEEE Trans. Robotics and Automation 12(3), 1996 (harmonic drives); "
        "periodogram: N. R. Lomb, Astrophys. Space Sci. 39, 1976"
    )
    signature = "torque that goes up and down over the angle, and returns with it at every speed"
    confusions = {
        "gravity-error": "full turns, with the other joints in several positions",
        "joint-spring": "a travel of several periods",
        "mains-hum": "several speeds: a ripple follows the angle, not the time",
    }
    excited_by = "travel over several periods, at several speeds"
    needs = ("joints",)
    null = {"sine": 0.0, "cosine": 0.0}
    grid = {"order": (1.0, 2.0, 50.0, 100.0, 200.0)}
    # of a joint once a turn, of a motor's magnets behind a gear of 1:300 some thousands
    admissible = {"order[1]": (0.5, 5000.0)}
    example = Example(
        ("rigid-body",),
        {"order": (8.0, 20.0), "sine": (0.6, 0.2, -0.3, 0.1), "cosine": (-0.2, 0.1, 0.4, -0.2)},
        Motion.ARM,
        form={"orders": (("[shoulder]", 7.9), ("[elbow]", 20.1))},
    )

    def for_log(self, signals: Signals) -> JointTorqueRipple:
        """With those joints alone that show it; itself where it has them."""
        if self.orders is not None or signals.joints is None or signals.measured is None:
            return self
        found = [(axis.suffix, *_lines(signals, j, axis)) for j, axis in enumerate(axes(signals.layout))]
        shown = [(suffix, orders[0], height) for suffix, orders, height in found if len(orders)]
        if not shown:
            return self
        most = max(height for _, _, height in shown)
        shown = [(suffix, order, height) for suffix, order, height in shown if height >= min(most, STANDS_OUT)]
        q = dict(zip((axis.suffix for axis in axes(signals.layout)), signals.joints.q))
        return JointTorqueRipple(
            tuple((suffix, order) for suffix, order, _ in shown), tuple(_lowest(q[suffix]) for suffix, _, _ in shown)
        )

    def parameters(self, layout: Layout) -> tuple[Parameter, ...]:
        """Order, and sine and cosine of each harmonic, joint by joint."""
        out = []
        for (axis, order), low in zip(self._joints(layout), self.lowest or itertools.repeat(0.1)):
            unit, joint = ("1", "rad/m")[axis.position == "m"], axis.suffix.strip("[]")
            out.append(Parameter(f"order{axis.suffix}", "k", unit, max(order, low), low, 1e5, scale=0.01))
            out += [
                Parameter(
                    f"{wave}[{joint},{h}]" if joint else f"{wave}[{h}]",
                    symbol,
                    axis.torque,
                    0.0,
                    -1e3 * axis.size,
                    1e3 * axis.size,
                    scale=0.05 * axis.size,
                    linear=True,
                )
                for h in HARMONICS
                for wave, symbol in (("sine", "a"), ("cosine", "b"))
            ]
        return tuple(out)

    def initial_guesses(self, signals: Signals) -> tuple[Array, ...]:
        """The highest lines of each joint, together; those of the grid where readings aren't known."""
        every = axes(signals.layout)
        joints = [axis.suffix for axis, _ in self._joints(signals.layout)]
        if not joints:
            return ()
        places = {axis.suffix: j for j, axis in enumerate(every)}
        trials = [np.full(len(joints), order) for order in self.grid["order"]]
        if signals.joints is not None and signals.measured is not None:
            lines = [_lines(signals, places[suffix], every[places[suffix]])[0] for suffix in joints]
            if any(lines):
                trials = [np.array([own[min(k, len(own) - 1)] if own else 1.0 for own in lines]) for k in range(LINES)]
                trials += [
                    np.full(len(joints), order) for order in self.grid["order"][:2]
                ]  # too slow for a sweep to show
        if self.orders is not None:
            trials.insert(0, np.array([order for _, order in self.orders]))
        if self.lowest:
            trials = [np.maximum(trial, self.lowest) for trial in trials]
        rest = np.zeros((len(joints), 2 * len(HARMONICS)))
        return tuple(np.concatenate([trial[:, None], rest], axis=1).ravel() for trial in trials)

    def implausible(
        self, values: Mapping[str, float], model_values: Mapping[str, float], signals: Signals | None = None
    ) -> str:
        """A ripple larger than the torque that it is part of, or one that passes too seldom over the travel, too."""
        if signals is not None and signals.measured is not None and signals.joints is not None:
            for j, axis in enumerate(axes(signals.layout)):
                order, travel = values.get(f"order{axis.suffix}", np.inf), float(np.ptp(signals.joints.q[j]))
                if order < 0.999 * _lowest(signals.joints.q[j]):
                    return (
                        f"a ripple with a period of {2.0 * np.pi / order:.3g} {axis.position} in a travel of "
                        f"{travel:.3g}"
                    )
                end = f"{axis.suffix.strip('[]')}," if axis.suffix else ""
                size = float(np.hypot(values.get(f"sine[{end}1]", 0.0), values.get(f"cosine[{end}1]", 0.0)))
                most = float(np.nanmax(np.abs(signals.measured[j]), initial=0.0))
                if size > most:
                    return (
                        f"a ripple of {size:.3g} {axis.torque} in a torque that never exceeds {most:.3g} {axis.torque}"
                    )
        return super().implausible(values, model_values, signals)

    def joint(self, s: Signals, p: Array) -> None:
        """Add the torque."""
        assert s.joints is not None
        places = {axis.suffix: j for j, axis in enumerate(axes(s.layout))}
        reading = s.reading.copy()
        for (axis, _), (order, *waves) in zip(self._joints(s.layout), p.reshape(-1, 1 + 2 * len(HARMONICS))):
            j = places[axis.suffix]
            reading[j] += np.asarray(waves) @ _waves(s.joints.q, j, order)
        s.reading = reading

    def _joints(self, layout: Layout) -> list[tuple[Axis, float]]:
        """Joints that have parameters, and the order of each to begin with."""
        if self.orders is None:
            return [(axis, 100.0) for axis in axes(layout)]
        known = dict(self.orders)
        return [(axis, known[axis.suffix]) for axis in axes(layout) if axis.suffix in known]


def _lowest(q: Array) -> float:
    """Order that passes `PERIODS` times over the travel of a joint."""
    return float(2.0 * np.pi * PERIODS / max(1e-9, np.ptp(q)))


def _waves(q: Array, j: int, order: float) -> Array:
    """Sine and cosine of each harmonic of a joint's angle, (2 · harmonics, n)."""

    def make() -> Array:
        return np.stack([wave(h * order * q[j]) for h in HARMONICS for wave in (np.sin, np.cos)])

    return derived(f"waves of joint {j}", make, q, at=(float(order),))


def _lines(s: Signals, j: int, axis: Axis) -> tuple[list[float], float]:
    """Orders of lines of a joint's torque over its angle, the best first; and how far it stands out."""
    assert s.joints is not None
    assert s.measured is not None

    def found() -> Array:
        orders, height = _searched(s, j, axis)
        return np.array([height, *orders])

    height, *orders = derived(f"lines of joint {j}", found, s.measured, s.joints.q).tolist()
    return orders, height


def _searched(s: Signals, j: int, axis: Axis) -> tuple[list[float], float]:
    motion, measured = s.joints, s.measured
    assert motion is not None
    assert measured is not None
    known = np.isfinite(measured[j])
    q, y = _sweeps(motion.q[j], np.where(known, measured[j] - motion.rigid[j], np.nan))
    travel = float(np.ptp(q)) if len(q) > 100 else 0.0
    if not travel > 0.0:
        return [], 0.0
    one, pace = 2.0 * np.pi / travel, np.abs(np.diff(motion.q[j]))
    moving = pace[pace > 0.1 * np.median(pace)]
    highest = min(HIGHEST[axis.position], np.pi / float(np.median(moving))) if len(moving) else 0.0
    if highest < PERIODS * one:
        return [], 0.0
    many = int(min(MOST_BINS, max(256.0, FINE * highest / one)))
    place = np.minimum(((q - q.min()) / travel * many).astype(np.int64), many - 1)
    binned = np.bincount(place, weights=y, minlength=many)
    power = np.abs(np.fft.rfft(binned, 4 * many)) ** 2  # finer than the travel resolves, so that no line falls between
    order = np.arange(len(power)) * one / 4.0
    use = (order >= PERIODS * one) & (order <= highest)
    power, order = power[use], order[use]
    height = power / np.maximum(_beside(power), 1e-300)
    peaks = np.flatnonzero((height[1:-1] >= height[:-2]) & (height[1:-1] > height[2:])) + 1
    peaks = peaks[np.argsort(height[peaks])[::-1][:LINES]]
    if not len(peaks):
        return [], 0.0
    out: list[float] = []
    for _, k in sorted((_closer(q, y, float(trial), one) for trial in order[peaks]), key=lambda near: near[0]):
        if all(abs(k - other) > 0.5 * one for other in out):
            out.append(k)
    if 0.5 * out[0] >= PERIODS * one and _closer(q, y, 0.5 * out[0], one)[0] < HALVED * _closer(q, y, out[0], one)[0]:
        out.insert(0, 0.5 * out[0])  # the line was a harmonic
    return out, float(height[peaks[0]])


def _sweeps(q: Array, y: Array) -> tuple[Array, Array]:
    """Angles and torques of sweeps between reversals, less a parabola over the angle of each: no friction left."""
    step = np.diff(q, prepend=q[:1])
    still = (
        np.abs(step) < 0.02 * np.median(np.abs(step[step != 0.0])) if (step != 0.0).any() else np.ones(len(q), np.bool_)
    )
    way = np.where(still, 0, np.sign(step))
    edges = np.flatnonzero(np.diff(way, prepend=0, append=0))
    parts = []
    for begin, end in zip(edges[:-1], edges[1:]):
        use = begin + np.flatnonzero(np.isfinite(y[begin:end]))
        if way[begin] == 0 or len(use) < SWEEP or not np.ptp(q[use]) > 0.0:
            continue
        x = (q[use] - q[use].mean()) / np.ptp(q[use])
        powers = np.stack([np.ones_like(x), x, x**2], axis=1)
        parts.append((q[use], y[use] - powers @ np.linalg.lstsq(powers, y[use])[0]))
    if not parts:
        return np.empty(0), np.empty(0)
    return np.concatenate([part[0] for part in parts]), np.concatenate([part[1] for part in parts])


def _beside(power: Array) -> Array:
    """Height of a spectrum beside each line: its neighbours' median over that of an exponential law, (n,)."""
    wide = min(4 * BESIDE, len(power) // 2)
    padded = np.pad(power, wide, mode="reflect")
    blocks = np.lib.stride_tricks.sliding_window_view(padded, 2 * wide + 1)[:: max(1, wide // 4)]
    at = np.arange(len(power))[:: max(1, wide // 4)]
    out: Array = np.interp(np.arange(len(power)), at, np.median(blocks, axis=1) / np.log(2.0))
    return out


def _closer(q: Array, y: Array, order: float, one: float) -> tuple[float, float]:
    """The order near another that leaves least of a torque, with its harmonic: what is left, and the order.

    Args:
        q, y: angle and torque, (n,). order: that is looked near. one: order that passes once over the travel.
    """
    step = max(1, len(q) // MOST_FITTED)
    q, y = q[::step], y[::step]

    def left(k: float) -> float:
        waves = np.stack([wave(h * k * q) for h in HARMONICS for wave in (np.sin, np.cos)], axis=1)
        found = np.linalg.lstsq(waves.T @ waves, waves.T @ y, rcond=1e-10)[0]
        return float(y @ y - found @ (waves.T @ y))

    for width in (0.25 * one, 0.06 * one, 0.015 * one):
        near = order + width * np.linspace(-1.0, 1.0, 9)
        order = float(near[int(np.argmin([left(k) for k in near]))])
    return left(order), order
