"""Ways to divide a log: by phase, depth, speed, direction, place, pose and time, each part in words."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from kinid.residuals.view import View
from kinid.residuals.words import number, span

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

#: motion is looked at over so long [s]
WINDOW = 0.25
#: less than this share of the farthest that it moves in such a time is standing still; sliding needs more
STILL, SLIDING = 0.04, 0.15
#: and less than this is nothing, whatever the log [m]
NOTHING = 1e-5
#: still for less long than this is no hold, moving for less long no phase [s]
SHORTEST = 0.15
#: a way that goes on for this share of its length is an approach or a retraction, not a poke
STRAIGHT = 0.8
#: a joint slower than this share of its fastest stands
STANDING = 0.02
#: cells of the grid on the surface, along each tangent
GRID = 4
#: where the tip moves less than this along the surface there is no place to tell from another [m]
LEAST_SPREAD = 5e-4
#: turning of the tool that shows in gravity [m/s²]
TURNING = 2.0
#: added to names of phases that the log doesn't have
BY_MOTION = " (by its motion)"

PLURAL = {
    "free": "free motion",
    "approach": "the approach",
    "hold": "the holds",
    "poke": "the pokes",
    "slide": "the slides",
    "retract": "the retraction",
    "rest": "the rests",
    "moving": "motion",
    "at rest": "standstill",
}


@dataclass(frozen=True, eq=False)
class Part:
    """A part of a log.

    Attributes:
        by: what the log was divided by. words: after "is" or "is in the normal force", e.g. "deeper than 3.2 mm".
        mask: its groups, (g,). within: what it is a part of, (g,): parts of the material's surface are parts of
            contact.
        phase: its name, where it is one. only: the channel that it concerns; "" for all.
    """

    by: str
    words: str
    mask: Mask
    within: Mask
    phase: str = ""
    only: str = ""


@dataclass(frozen=True, eq=False)
class Moving:
    """Which way each group moves, (g,): −1, 0 or 1."""

    normal: NDArray[np.int8]
    slip: tuple[NDArray[np.int8], NDArray[np.int8]]


def moving(view: View) -> Moving:
    """Directions of pressing and sliding; 0 where the tip stands still."""
    s = view.experiment.signals
    normal = _direction(view, s.depth, s.depth_rate, STILL)
    first, second = (_direction(view, s.slip[i], s.slip_rate[i], STILL) for i in range(2))
    return Moving(normal, (first, second))


def _direction(view: View, position: Array, rate: Array, share: float) -> NDArray[np.int8]:
    """Sign of a rate where it is faster than a share of what is fast in this log."""
    window = _window(view)
    still = _still(view, position, share) / window
    v = view.at(rate)
    return np.asarray(np.where(np.abs(v) > still, np.sign(v), 0.0), dtype=np.int8)


def _window(view: View) -> float:
    span = float(view.t[-1]) if len(view.t) else 0.0
    return max(WINDOW, 5 * view.period, span / 2000)


def _still(view: View, position: Array, share: float) -> float:
    """Way [m] in a window below which the tip stands still."""
    ways = _ways(view, position)[view.touching]
    third = np.diff(view.at(position), 3)
    noise = float(1.4826 * np.median(np.abs(third - np.median(third))) / np.sqrt(20.0)) if len(third) else 0.0
    return max(share * float(np.quantile(ways, 0.99)) if len(ways) else 0.0, 8 * noise, NOTHING)


def _ways(view: View, position: Array) -> Array:
    """How far a position goes within the window about each group, (g,)."""
    from scipy.ndimage import maximum_filter1d, minimum_filter1d

    p = view.at(position)
    size = _size(view)
    out: Array = maximum_filter1d(p, size) - minimum_filter1d(p, size)
    return out


def _size(view: View) -> int:
    """Groups in the window, an odd number."""
    step = view.period * float(np.median(view.count)) if len(view.count) else 1.0
    return max(3, 2 * round(_window(view) / step / 2) + 1)


def _sharp(view: View, moves: Mask) -> Mask:
    """Motion that a window saw, without the half window that it saw too early and too late."""
    from scipy.ndimage import minimum_filter1d

    return np.asarray(minimum_filter1d(moves.astype(np.int8), _size(view)) > 0)


def phases(view: View) -> NDArray[np.str_]:
    """Name of the phase of each group, (g,): the log's own, else by the motion, which the name then says."""
    if view.experiment.phase is not None:
        return np.asarray(view.at(view.experiment.phase).astype(str))
    if view.experiment.signals.joints is not None:
        dq = view.at(view.experiment.signals.joints.dq)
        top = np.max(np.abs(dq), axis=1, keepdims=True, initial=1e-12)
        rest = _steady((np.abs(dq) <= STANDING * top).all(axis=0).astype(np.int8), view) == 1
        return np.where(rest, "at rest", "moving")
    return np.asarray(np.char.add(_contact_phases(view), BY_MOTION))


def _contact_phases(view: View) -> NDArray[np.str_]:
    """free, hold, slide, approach, retract or poke of each group."""
    s = view.experiment.signals
    pressing = _ways(view, s.depth)
    sliding = np.maximum(*(_ways(view, s.slip[i]) for i in range(2)))
    presses = _sharp(view, pressing > _still(view, s.depth, STILL))
    slides = _sharp(
        view, (sliding > max(_still(view, s.slip[i], SLIDING) for i in range(2))) & (sliding > 0.5 * pressing)
    )
    depth = view.at(s.depth)
    kind = np.where(~view.touching, 0, np.where(slides, 1, np.where(presses, 2, 3))).astype(np.int8)
    kind = _steady(kind, view)
    names = np.array(["free", "slide", "poke", "hold"], dtype="<U16")[kind]
    for a, b in runs(kind == 2, view.piece):
        way = float(np.abs(np.diff(depth[a:b])).sum())
        net = float(depth[b - 1] - depth[a])
        if way > 0 and abs(net) > STRAIGHT * way:
            names[a:b] = "approach" if net > 0 else "retract"
    return names


def _steady(kind: NDArray[np.int8], view: View) -> NDArray[np.int8]:
    """The same without runs shorter than `SHORTEST`, which join what was before them."""
    out = kind.copy()
    change = np.flatnonzero(np.diff(kind) != 0) + 1
    edges = [0, *change.tolist(), len(kind)]
    step = view.period * float(np.median(view.count)) if len(kind) else 1.0
    for a, b in zip(edges[:-1], edges[1:]):
        if a > 0 and (b - a) * step < SHORTEST:
            out[a:b] = out[a - 1]
    return out


def runs(mask: Mask, piece: NDArray[np.int64]) -> list[tuple[int, int]]:
    """First group, and the group after the last, of each stretch where a mask holds; gaps end a stretch."""
    same = np.r_[True, np.diff(piece) == 0]
    begins = mask & ~np.r_[False, mask[:-1] & same[1:]]
    starts = np.flatnonzero(begins)
    out = []
    for a, until in zip(starts, [*starts[1:].tolist(), len(mask)]):
        stop = np.flatnonzero(~mask[a:until])
        out.append((int(a), int(a + stop[0]) if len(stop) else int(until)))
    return out


def phase_parts(view: View, names: NDArray[np.str_]) -> Iterator[Part]:
    """One part a phase; a log of one phase is whole."""
    everything = np.ones(len(names), dtype=np.bool_)
    order = list(dict.fromkeys(names.tolist()))
    for name in order:
        yield Part("phase", phase_words(name) if len(order) > 1 else "", names == name, everything, name)


def phase_words(name: str) -> str:
    """A phase as a reader speaks of it."""
    plain = name.removesuffix(BY_MOTION)
    words = PLURAL.get(plain, f"the phase '{plain}'")
    return words + (" (by their motion)" if name != plain and words.endswith("s") else name[len(plain) :])


def other_parts(view: View, way: Moving) -> Iterator[Part]:
    """All other ways to divide the log; `way` is how it moves."""
    if view.experiment.signals.joints is not None:
        yield from _joint_parts(view)
    elif view.touching.any():
        yield from _contact_parts(view, way)
    if view.experiment.signals.sensor is not None:
        yield from _tool_parts(view)
    everything = np.ones(len(view.t), dtype=np.bool_)
    third = float(view.t[-1]) / 3 if len(view.t) else 0.0
    for k, which in enumerate(("first", "middle", "last")):
        now = (view.t >= k * third) & ((view.t < (k + 1) * third) | (k == 2))
        yield Part("time", f"in the {which} third of the time", now, everything)


def _contact_parts(view: View, way: Moving) -> Iterator[Part]:
    s, inside = view.experiment.signals, view.touching
    depth, rate = view.at(s.depth), np.abs(view.at(s.depth_rate))
    yield from _quarters("depth", "at depths", depth, inside, 1e3, "mm", 2e-5)
    yield from _quarters("depth_rate", "at speeds of pressing", rate, inside & (way.normal != 0), 1e3, "mm/s", 1e-5)
    for sign, words in ((1, "while loading"), (-1, "while unloading"), (0, "while the depth is held")):
        yield Part("loading", words, inside & (way.normal == sign), inside)
    speed = np.hypot(*view.at(s.slip_rate))
    slides = inside & ((way.slip[0] != 0) | (way.slip[1] != 0))
    yield from _quarters("slip", "at speeds of sliding", speed, slides, 1e3, "mm/s", 1e-5)
    for i in range(2):
        for sign, words in ((1, "along"), (-1, "against")):
            mine = inside & (way.slip[i] == sign)
            yield Part("slip", f"while sliding {words} tangent {i + 1}", mine, slides)
    yield Part("slip", "while sliding", slides, inside)
    yield from _places(view, inside)


def _quarters(by: str, what: str, x: Array, within: Mask, factor: float, unit: str, least: float) -> Iterator[Part]:
    """Four parts that hold alike many groups, by a quantity whose spread is at least so much."""
    if within.sum() < 8:
        return
    cuts = np.quantile(x[within], [0.0, 0.25, 0.5, 0.75, 1.0])
    if cuts[-1] - cuts[0] < least:
        return
    top = cuts[-1]
    for a, b in zip(cuts[:-1], cuts[1:]):
        if b <= a:
            continue
        words = (
            f"{what} above {number(factor * a)} {unit}"
            if b == top
            else f"{what} of {span(factor * a, factor * b)} {unit}"
        )
        yield Part(by, words, within & (x >= a) & ((x < b) | (b == top)), within)


def _places(view: View, inside: Mask) -> Iterator[Part]:
    """Cells of a grid on the surface that the tip has been to."""
    edges, index = [], []
    for x in view.at(view.experiment.signals.slip):
        low, high = np.quantile(x[inside], [0.005, 0.995])
        count = GRID if high - low > LEAST_SPREAD else 1
        cut = np.linspace(low, high, count + 1)
        edges.append(cut)
        index.append(np.clip(np.searchsorted(cut, x, side="right") - 1, 0, count - 1))
    if all(len(cut) == 2 for cut in edges):
        return
    for i in range(len(edges[0]) - 1):
        for j in range(len(edges[1]) - 1):
            where = []
            for axis, k in ((0, i), (1, j)):
                if len(edges[axis]) > 2:
                    a, b = 1e3 * edges[axis][k], 1e3 * edges[axis][k + 1]
                    where.append(f"slip {axis + 1} of {span(a, b)} mm")
            yield Part(
                "place", f"at the place with {' and '.join(where)}", inside & (index[0] == i) & (index[1] == j), inside
            )


def _tool_parts(view: View) -> Iterator[Part]:
    """How the tool hangs, where it turns enough for gravity to tell."""
    sensor = view.experiment.signals.sensor
    assert sensor is not None
    everything = np.ones(len(view.t), dtype=np.bool_)
    for axis, g in zip("xyz", view.at(sensor.specific)):
        low, high = np.quantile(g, [0.01, 0.99])
        if high - low < TURNING:
            continue
        a, b = low + (high - low) / 3, low + 2 * (high - low) / 3
        down = "hangs down most" if high > 0 else "points up least"
        up = "points up most" if low < 0 else "hangs down least"
        yield Part("pose", f"where the sensor's {axis} axis {down}", g > b, everything)
        yield Part("pose", f"where the sensor's {axis} axis {up}", g < a, everything)


def _joint_parts(view: View) -> Iterator[Part]:
    """Of each joint: which way and how fast it moves, where it is, how it accelerates."""
    joints, layout = view.experiment.signals.joints, view.experiment.layout
    assert joints is not None
    everything = np.ones(len(view.t), dtype=np.bool_)
    for j, channel in enumerate(layout.channels):
        slides = channel.startswith("force")
        place, speed, push = ("m", "m/s", "m/s²") if slides else ("rad", "rad/s", "rad/s²")
        q, dq, ddq = (view.at(x[j]) for x in (joints.q, joints.dq, joints.ddq))
        top = max(float(np.abs(dq).max(initial=0.0)), 1e-12)
        for sign, words in ((1, "while it moves forwards"), (-1, "while it moves backwards")):
            yield Part("pose", words, sign * dq > STANDING * top, everything, only=channel)
        yield Part("pose", "while it stands", np.abs(dq) <= STANDING * top, everything, only=channel)
        for x, what, unit in (
            (np.abs(dq), "at speeds", speed),
            (q, "at positions", place),
            (np.abs(ddq), "at accelerations", push),
        ):
            for part in _quarters("pose", what, x, everything, 1.0, unit, 1e-6):
                yield Part("pose", part.words, part.mask, everything, only=channel)
