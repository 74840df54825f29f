"""What an experimenter does with a tool: the full protocol, and those that leave something out."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from hidden.world.path import Script


@dataclass(frozen=True)
class Protocol:
    """What is done, and how far.

    Attributes:
        deep [m]: greatest depth. clear [m]: height in the air.
        stroke [m]: of a slide. apart [m]: distance of the places.
        hold, slides, places, fast, several_depths, second_direction, back_and_forth, late_return, turning, tilts: what
            is done; the last two by an arm alone.
    """

    deep: float = 4e-3
    clear: float = 6e-3
    stroke: float = 7e-3
    apart: float = 12e-3
    hold: bool = True
    slides: bool = True
    places: bool = True
    fast: bool = True
    several_depths: bool = True
    second_direction: bool = True
    back_and_forth: bool = True
    late_return: bool = True
    turning: bool = False
    tilts: bool = False


#: what appends motions to a script
Act = Callable[[Script, Protocol], None]


def perform(s: Script, p: Protocol) -> None:
    """Append the whole protocol to a script with the coordinates x, y (along the tangents) and z (depth); rx ry rz
    turn.
    """
    rng = s.rng
    shallow, middle, deep = np.array([0.42, 0.72, 1.0]) * p.deep * rng.uniform(0.95, 1.05)
    if not p.several_depths:
        shallow = middle = deep
    home = dict(x=0.0, y=0.0)
    s.move("free", 0.6, **home, z=-p.clear)
    s.sway("free", 1.2, 3, 0.5, 2.0, x=2e-3, y=2e-3, z=0.3 * p.clear)
    if p.turning:
        _turn(s, slow=True)
        if p.fast:
            _turn(s, slow=False)
    s.move("approach", 0.8, z=-0.4e-3)
    _hold(s, p, middle if p.several_depths else deep)
    _pokes(s, p, shallow, middle, deep)
    if p.slides:
        for depth in (shallow, deep) if p.several_depths else (deep,):
            _slides(s, p, depth)
    if p.tilts:
        _tilts(s, p, middle)
    if p.places:
        for x, y in (
            p.apart * rng.permutation([[0.7, 0.5], [-0.6, 0.6], [0.4, -0.8], [-0.7, -0.5]])[: 2 if p.tilts else 3]
        ):
            s.move("free", 0.4, x=x * rng.uniform(0.8, 1.2), y=y * rng.uniform(0.8, 1.2))
            for depth in (shallow, middle) if p.several_depths else (deep,):
                _poke(s, depth, rng.uniform(0.25, 0.4), rng.uniform(0.2, 0.4))
            s.move("retract", 0.25, z=-2e-3)
    if p.late_return:
        s.move("free", 0.6, **home)
        s.move("approach", 0.4, z=-0.4e-3)
        _hold(s, p, middle, short=True)
        _poke(s, deep, 0.5, 0.5)
        _pokes(s, p, shallow, middle, deep, short=True)
    s.move("poke", 0.6, z=shallow)
    slow = 1.8 if p.fast else 3.0
    s.move("retract", slow, z=-2.5e-3)
    s.move("retract", 0.6, z=-p.clear)
    s.rest("free", 0.8)
    if p.turning:
        _turn(s, slow=False)


def _hold(s: Script, p: Protocol, depth: float, short: bool = False) -> None:
    """In fast, stay, out fast, rest in the air."""
    rng = s.rng
    s.move("approach", rng.uniform(0.12, 0.2) if p.fast else 1.5, z=depth)
    if p.hold:
        s.rest("hold", rng.uniform(1.0, 1.4) if short else rng.uniform(2.6, 3.6))
    s.move("retract", rng.uniform(0.18, 0.3) if p.fast else 1.5, z=-1.5e-3)
    s.rest("rest", 0.8 if short else 1.5)


def _poke(s: Script, depth: float, seconds: float, stay: float) -> None:
    s.move("poke", seconds, z=depth)
    s.rest("poke", stay)
    s.move("poke", seconds, z=-0.8e-3)


def _pokes(s: Script, p: Protocol, shallow: float, middle: float, deep: float, short: bool = False) -> None:
    """A slow ramp, a sum of sines, and fast ramps."""
    rng = s.rng
    if not p.fast:
        s.move("poke", 3.0, z=middle)
        s.move("poke", 3.0, z=-0.8e-3)
        return
    centre = 0.55 * deep
    s.move("poke", rng.uniform(0.9, 1.3), z=centre)
    s.sway("poke", 1.5 if short else 3.4, 5, 1.0, 5.0, z=0.45 * centre)
    s.move("poke", rng.uniform(0.8, 1.1), z=deep if not short else middle)
    s.move("retract", rng.uniform(0.8, 1.2), z=-0.8e-3)
    s.rest("rest", 0.3)
    for depth in (shallow, middle) if short else (middle, shallow, middle, deep):
        s.move("poke", rng.uniform(0.12, 0.22), z=depth)
        s.move("poke", rng.uniform(0.12, 0.22), z=-0.6e-3)
        s.rest("rest", 0.15)


def _slides(s: Script, p: Protocol, depth: float) -> None:
    """Both tangents, three speeds, there and back, a pause, and short strokes that hardly slip."""
    rng = s.rng
    x, y = s["x"], s["y"]
    s.move("approach", 0.3, z=depth)
    s.rest("hold", 0.2)
    for axis in ("x", "y") if p.second_direction else ("x",):
        start = {"x": x, "y": y}[axis]
        for speed, share in ((4e-3, 0.35), (13e-3, 0.7), (45e-3, 1.1)):
            v, stroke = (speed * rng.uniform(0.85, 1.15), share * p.stroke) if p.fast else (8e-3, p.stroke)
            s.cruise("slide", v, **{axis: start + stroke})
            if p.back_and_forth:
                s.rest("slide", 0.1)
                s.cruise("slide", v, **{axis: start})
            else:
                start += stroke
            if not p.fast:
                break
    if p.back_and_forth and p.fast:
        s.sway("slide", 1.0, 2, 1.0, 2.0, x=0.5e-3)
        if p.second_direction:
            s.cruise("slide", 20e-3, x=x + 0.6 * p.stroke, y=y - 0.5 * p.stroke)
    s.move("retract", 0.3, z=-1.5e-3)
    s.move("free", 0.5, x=x, y=y)


def _turn(s: Script, slow: bool) -> None:
    """Re-orientation in the air about all axes."""
    size = s.rng.uniform(0.28, 0.4) if slow else s.rng.uniform(0.16, 0.22)
    low, high = (0.12, 0.4) if slow else (0.8, 1.6)
    s.sway("free", 4.0 if slow else 2.5, 3, low, high, rx=size, ry=size, rz=1.2 * size)


def _tilts(s: Script, p: Protocol, depth: float) -> None:
    """Pokes and a short slide with the tool tilted about either tangent."""
    for rx, ry in ((0.17, 0.0), (0.0, 0.17), (-0.13, -0.13)):
        s.move("free", 0.6, rx=rx, ry=ry, z=-1.5e-3)
        s.move("poke", 0.3, z=depth)
        s.rest("poke", 0.25)
        if p.slides and rx > 0:
            s.cruise("slide", 20e-3, x=s["x"] + 3e-3)
            s.cruise("slide", 20e-3, x=s["x"] - 3e-3)
        s.move("retract", 0.3, z=-1.5e-3)
    s.move("free", 0.6, rx=0.0, ry=0.0)


def press_once(s: Script, p: Protocol) -> None:
    """In slowly, and stay: the log ends before the tool leaves, and nothing was pressed twice."""
    s.rest("free", 1.5)
    s.move("approach", 2.5, z=-0.3e-3)
    s.move("poke", s.rng.uniform(2.0, 4.0), z=p.deep)
    s.rest("hold", s.rng.uniform(2.0, 4.0))


def slide_once(s: Script, p: Protocol) -> None:
    """In, and one stroke along the first tangent at one depth; the log ends while it goes on."""
    s.rest("free", 1.5)
    s.move("approach", 1.0, z=-0.3e-3)
    s.move("approach", 1.0, z=p.deep)
    s.rest("hold", 0.5)
    s.cruise("slide", s.rng.uniform(6e-3, 15e-3), x=s["x"] + 20e-3)


def turn_only(s: Script, p: Protocol) -> None:
    """In the air: all about, slow and fast, and nothing is touched."""
    s.rest("free", 0.5)
    for slow in (True, False, True, False):
        _turn(s, slow)
    s.sway("free", 4.0, 4, 0.5, 3.0, x=0.01, y=0.01, z=0.5 * p.clear)
    s.rest("free", 0.5)
