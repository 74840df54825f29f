"""What a residual does within a part of a log: decays, grows, stays constant, follows a quantity, swings; only what is
measured.

Each description is a least-squares fit to the residual there. `explained` is the share of the squared error beyond
noise that it takes away. One is said only if that is at least `ENOUGH`, and at least `MORE` above what a constant
explains.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from kinid.residuals.parts import STANDING, TURNING, Moving, runs
from kinid.residuals.view import View
from kinid.residuals.words import number

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

#: share of the error that a description explains, at least, and how much more than a constant does
ENOUGH, MORE = 0.5, 0.25
#: a later reason in the list must explain so much more than an earlier one: the plainer comes first
PLAINER = 0.07
#: share of the groups in which a thing moves each way, before it can be said to change sign with it
BOTH = 0.03
#: what a further coefficient must explain at least, in the same measure
PER_COEFFICIENT = 0.02
#: a stretch shorter than this, or of fewer groups, tells no time constant [s]
SHORTEST, FEWEST = 0.25, 8
#: time constants tried, as shares of the longest stretch; beyond `STEADY` a decay is a steady drift
TIME_CONSTANTS = np.geomspace(0.02, 3.0, 40)
STEADY = 1.5
#: one end of a stretch is this much larger than the other: it decays, or it grows
CLEARLY = 1.5
#: share of a cell's groups in which the depth is held, for a decay to be of the material
QUIET = 0.6
#: a swing is looked for in stretches at least so long [s]
LONG = 2.0
#: mains [Hz], and how far from them a line may be
MAINS, NEAR = (50.0, 60.0), 0.5


@dataclass(frozen=True)
class Shape:
    """A description: in words after "and", and the share of the error that it explains."""

    words: str
    explained: float


def shape(view: View, row: int, mask: Mask, way: Moving, *, held: bool) -> Shape | None:
    """The description that explains most of a channel's residual in some groups, or None.

    Args:
        view: the residual. row: of the channel. mask: the groups, (g,). way: how the tip moves in this log.
        held: whether the depth is held there, or nothing is touched: then time since the beginning of each stretch may
            be the reason, and motion, which there is hardly any of, is not.
    """
    use = mask & (view.samples[row] > 0)
    error = float(view.excess[row][use].sum()) * view.scale[row] ** 2
    if use.sum() < FEWEST or error <= 0:
        return None
    r, w = view.mean[row], view.samples[row]
    whole = float((w * r**2)[use].sum())
    unit = view.units[row]

    def explained(fitted: Array) -> float:
        """Of a fit to the groups in use."""
        return float((whole - np.sum(w[use] * (r[use] - fitted) ** 2)) / error)

    level = float((w * r)[use].sum() / w[use].sum())
    constant = Shape(f"is constant: about {number(level)} {unit}", min(1.0, explained(np.full(use.sum(), level))))
    best: Shape | None = None
    for words, columns in _turning(view, row, use) + ([] if held else _reasons(view, row, way)):
        x = np.vstack([np.ones(use.sum()), columns[:, use]]).T
        if (np.ptp(x[:, 1:], axis=0) == 0).all():
            continue
        root = np.sqrt(w[use])
        fitted = x @ np.linalg.lstsq(x * root[:, None], r[use] * root, rcond=None)[0]
        best = _better(best, Shape(words, explained(fitted) - PER_COEFFICIENT * (len(columns) - 1)))
    if held:
        best = _better(best, _settling(view, row, use, error))
    least = max(ENOUGH, constant.explained + max(MORE, 0.5 * (1.0 - constant.explained)))
    if best is not None and best.explained >= least:
        return Shape(best.words, min(1.0, best.explained))
    if constant.explained >= ENOUGH:
        return constant
    swing = _swing(view, row, use, level, error / float(w[use].sum()))
    return swing if swing is not None and swing.explained >= ENOUGH else None


def held_still(view: View, mask: Mask, way: Moving) -> bool:
    """Whether nothing is touched in these groups, or the depth is held."""
    if view.experiment.signals.joints is not None:
        return False
    quiet = (way.normal == 0) | ~view.touching
    return bool(mask.any() and quiet[mask].mean() >= QUIET and not (way.slip[0][mask] != 0).mean() > 1 - QUIET)


def _better(one: Shape | None, other: Shape | None) -> Shape | None:
    if one is None or other is None:
        return one or other
    return other if other.explained > one.explained + PLAINER else one


def _reasons(view: View, row: int, way: Moving) -> list[tuple[str, Array]]:
    """Quantities of motion and contact that a residual may follow: in words, and their values, (columns, g)."""
    s, channel = view.experiment.signals, view.channels[row]
    out: list[tuple[str, Array]] = []
    if s.joints is not None:
        j = row
        q, dq, ddq = (view.at(x[j]) for x in (s.joints.q, s.joints.dq, s.joints.ddq))
        top = max(float(np.abs(dq).max(initial=0.0)), 1e-12)
        out += [
            *_turns(
                "changes sign with the direction of motion", np.where(np.abs(dq) > STANDING * top, np.sign(dq), 0.0)
            ),
            ("follows the speed", dq[None]),
            ("follows the acceleration", ddq[None]),
            ("follows the position", q[None]),
        ]
        if s.joints.known:
            out.append(("follows the torque that the joint carries", view.at(s.joints.rigid[j])[None]))
    elif view.touching.any():
        depth = np.maximum(view.at(s.depth), 0.0)
        measured = view.at(np.nan_to_num(view.readings(view.experiment.measured)))
        if channel.startswith("tangential"):
            i = int(channel[-1]) - 1
            out += [
                *_turns("changes sign with the direction of sliding", *_sliding(view, way, i)),
                ("follows the speed of sliding", view.at(s.slip_rate[i])[None]),
                ("follows the slip", view.at(s.slip[i])[None]),
            ]
        if channel in view.channels and "normal_force" in view.channels and channel != "normal_force":
            out.append(("follows the normal force", measured[view.channels.index("normal_force")][None]))
        out += [
            *_turns("changes sign with the direction of pressing", way.normal),
            ("follows the speed of pressing", np.where(depth > 0, view.at(s.depth_rate), 0.0)[None]),
            ("follows the depth", depth[None]),
        ]
        if channel == "normal_force":
            out.append(("follows the force itself", measured[row][None]))
    return out


def _turning(view: View, row: int, mask: Mask) -> list[tuple[str, Array]]:
    """Those of the tool, where it turns: gravity in the sensor's axes, and for torques angular acceleration."""
    sensor = view.experiment.signals.sensor
    if sensor is None:
        return []
    out, specific = [], view.at(sensor.specific)
    if np.ptp(specific[:, mask], axis=1).max(initial=0.0) > TURNING:
        out.append(("turns with the tool's orientation", specific))
    if view.channels[row] in ("tx", "ty", "tz"):
        out.append(("follows the angular acceleration of the tool", view.at(sensor.alpha)))
    return out


def _turns(words: str, *directions: NDArray[np.int8] | Array) -> list[tuple[str, Array]]:
    """The reason of a direction, where both ways occur."""
    both = [np.asarray(d, dtype=float)[None] for d in directions if min((d > 0).mean(), (d < 0).mean()) > BOTH]
    return [(words, d) for d in both]


def _sliding(view: View, way: Moving, i: int) -> tuple[Array, Array]:
    """Component of the direction of sliding along one tangent, (g,): zero at rest, and as dry friction keeps it at
    rest.

    A bristle keeps the last direction until the tip slides another way, or leaves.
    """
    slides = (way.slip[0] != 0) | (way.slip[1] != 0)
    rate = view.at(view.experiment.signals.slip_rate)
    direction = np.where(slides, rate[i] / np.maximum(np.hypot(*rate), 1e-12), 0.0)
    n = np.arange(len(direction))
    last = np.maximum.accumulate(np.where(slides, n, -1))
    left = np.maximum.accumulate(np.where(~view.touching, n, -1))
    return direction, np.where((last >= 0) & (last > left), direction[last], 0.0)


def _settling(view: View, row: int, use: Mask, error: float) -> Shape | None:
    """Each stretch settles from one level to another, all with one time constant (variable projection over its
    grid).
    """
    step = view.period * float(np.median(view.count))
    least = max(FEWEST, round(SHORTEST / step))
    stretches = [(a, b) for a, b in runs(use, view.piece) if b - a >= least]
    if not stretches:
        return None
    count = np.array([b - a for a, b in stretches])
    at = np.concatenate([np.arange(a, b) for a, b in stretches])
    first_of = np.r_[0, np.cumsum(count)[:-1]]
    since = view.t[at] - np.repeat(view.t[at[first_of]], count)
    lasts = since[first_of + count - 1]
    longest = float(lasts.max())
    w, wr = view.samples[row][at], (view.samples[row] * view.mean[row])[at]

    def of_each(x: Array) -> Array:
        """Sum over each stretch."""
        out: Array = np.add.reduceat(x, first_of)
        return out

    sw, swr = of_each(w), of_each(wr)
    flat = float((swr**2 / sw).sum())
    most, tau, begin, end = -np.inf, 0.0, np.zeros(len(count)), np.zeros(len(count))
    for trial in TIME_CONSTANTS * longest:
        e = np.exp(-since / trial)
        swe, swee, swre = of_each(w * e), of_each(w * e**2), of_each(wr * e)
        # normal equations of a level and a jump; a stretch too short for its curve has a level alone
        spread = sw * swee - swe**2
        curved = spread > 1e-10 * sw * swee
        jump = np.where(curved, (sw * swre - swe * swr) / np.where(curved, spread, 1.0), 0.0)
        level = (swr - jump * swe) / sw
        fits = float((level * swr + jump * swre).sum())
        if fits > most:
            most, tau, begin, end = fits, float(trial), level + jump, level + jump * e[first_of + count - 1]
    explained = most / error
    if explained < flat / error + MORE:  # a level of its own for each stretch does as well
        return None
    if tau > STEADY * longest:
        slope = float(np.average((end - begin) / lasts, weights=lasts))
        return Shape(f"drifts steadily: about {number(slope)} {view.units[row]}/s", explained)
    first, last = np.sqrt(np.mean(begin**2)), np.sqrt(np.mean(end**2))
    if first > CLEARLY * last:
        verb = "decays"
    elif last > CLEARLY * first:
        verb = "grows"
    else:  # it crosses zero, because the model was fitted to its middle: what the reading itself does tells
        reading = np.nan_to_num(view.readings(view.experiment.measured)[row])[view.edge]
        verb = "decays" if float((begin - end).sum()) * float(reading[use].sum()) > 0 else "grows"
    return Shape(f"{verb}: time constant about {number(float(f'{tau:.2g}'))} s", explained)


def _swing(view: View, row: int, use: Mask, level: float, usual: float) -> Shape | None:
    """One frequency that holds most of the error in the longest stretch, where that is no quieter than `usual`,
    squared.
    """
    stretches = runs(use, view.piece)
    a, b = max(stretches, key=lambda ab: ab[1] - ab[0])
    s = view.experiment.signals
    begin = int(view.edge[a])
    end = int(view.edge[b]) if b < len(view.edge) else len(s)
    if float(s.t[end - 1] - s.t[begin]) < LONG or end - begin < 64:
        return None
    r = np.nan_to_num(view.residual[row, begin:end] - level)
    power = np.abs(np.fft.rfft(r)) ** 2
    power[0] = 0.0
    frequency = np.fft.rfftfreq(len(r), view.period)
    top = int(np.argmax(power))
    if top < 2:
        return None
    beside = power[max(1, top - 2) : top + 3]
    error = float(power.sum()) - len(r) * view.sigma[row] ** 2 * len(r) / 2
    if 2.0 * error / len(r) ** 2 < ENOUGH * usual:
        return None
    f = float((beside @ frequency[max(1, top - 2) : top + 3]) / beside.sum())
    mains = next((m for m in MAINS if abs(f - m) < NEAR), None)
    words = f"is a line at {mains:.0f} Hz" if mains else f"swings at {f:.2g} Hz"
    return Shape(words, min(1.0, float(beside.sum()) / error)) if error > 0 else None
