"""Set-points of an experiment: approach, hold, motion, retract and return, in the axes of the surface."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from kinid.errors import InputError
from kinid.lab.arm import joints_along
from kinid.robotics.robot import Robot

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Poke:
    """A multisine about a depth: depth + Σ aᵢ sin(2π fᵢ t); amplitudes [m], frequencies [Hz]."""

    depth: float
    sines: tuple[tuple[float, float], ...]
    duration: float = 4.0

    name = "poke"

    def path(self, t: NDArray[np.floating]) -> Array:
        """Along tangent1, tangent2, and depth [m], (n, 3), for times from its beginning [s]."""
        out = np.zeros((len(t), 3))
        fade = minimum_jerk(np.minimum(t, self.duration - t) / 0.3)
        out[:, 2] = self.depth + fade * sum(a * np.sin(2 * np.pi * f * t) for a, f in self.sines)
        return out


@dataclass(frozen=True)
class Slide:
    """Out and back along each direction [rad from tangent1] in turn, at one speed [m/s] and depth [m]."""

    depth: float = 2.5e-3
    speed: float = 3e-3
    length: float = 6e-3
    directions: tuple[float, ...] = (0.0, np.pi / 2)

    name = "slide"

    @property
    def duration(self) -> float:
        """[s]"""
        return 4.0 * self.length / self.speed * len(self.directions)

    def path(self, t: NDArray[np.floating]) -> Array:
        """Along tangent1, tangent2, and depth [m], (n, 3), for times from its beginning [s]."""
        leg = 4.0 * self.length / self.speed
        out = np.zeros((len(t), 3))
        out[:, 2] = self.depth
        for k, angle in enumerate(self.directions):
            u = np.clip((t - k * leg) / leg, 0.0, 1.0)
            s = self.length * (1.0 - 4.0 * np.abs((u + 0.25) % 1.0 - 0.5))  # a triangle: 0, +1, 0, −1, 0
            s[(u <= 0.0) | (u >= 1.0)] = 0.0
            out[:, 0] += s * np.cos(angle)
            out[:, 1] += s * np.sin(angle)
        return out


@dataclass(frozen=True, eq=False)
class Script:
    """Set-points, one a control period.

    Attributes:
        t: [s], (n,). phase: its name, (n,). place: along both tangents from the surface's point, and depth [m], (n, 3).
        tilt: of the tool about both tangents [rad], (n, 2).
    """

    t: Array
    phase: NDArray[np.str_]
    place: Array
    tilt: Array

    def poses(self, axes: Array, point: Array) -> tuple[Array, Array]:
        """Positions (n, 3) and rotations (n, 3, 3) of the tip; the tool points into the material."""
        offset = self.place * np.array([1.0, 1.0, -1.0])
        positions = np.asarray(point) + offset @ axes
        t1, t2, normal = axes
        base = np.stack([-t1, t2, -normal], axis=1)
        if not self.tilt.any():
            return positions, np.ascontiguousarray(np.broadcast_to(base, (len(self.t), 3, 3)))
        turn = np.einsum("nij,njk->nik", _turn(self.tilt[:, 0], t1), _turn(self.tilt[:, 1], t2))
        return positions, np.ascontiguousarray(turn @ base)

    def joints(self, rows: NDArray[np.int64], robot: Robot, axes: Array, point: Array, start: Array) -> Array:
        """Joints at some set-points, log order, (rows, N); searched from a posture `start`.

        Raises:
            InputError: a pose out of reach, or one that needs a joint beyond its limits.
        """
        positions, rotations = self.poses(axes, point)
        return joints_along(robot, positions[rows], rotations[rows], start, "a motion")

    def ended(self, row: int) -> tuple[Script, int]:
        """The same up to a set-point, from there to where it ends however it moves, and then it stands there.

        Args:
            row: of a set-point before the retraction, the third or a later one.

        Returns:
            As many set-points as before, and how many of them there are until it has rested as long as before.
        """
        n, period = len(self.t), float(self.t[1] - self.t[0])
        back, rest = (int((self.phase == name).sum()) for name in ("retract", "rest"))
        before, last, here = self.place[row - 2 : row + 1]
        speed, acceleration = (here - last) / period, (here - 2.0 * last + before) / period**2
        path = _to_rest(here, speed, acceleration, self.place[-1], back * period, (np.arange(back) + 1.0) / back)
        count = row + 1 + back + rest
        place = np.vstack([self.place[: row + 1], path, np.tile(self.place[-1], (n, 1))])[:n]
        phase = np.concatenate([self.phase[: row + 1], np.repeat(["retract", "rest"], [back, n])])[:n]
        tilt = np.vstack([self.tilt[: row + 1], np.zeros((n, 2))])[:n]
        return Script(self.t, phase, place, tilt), count

    @property
    def touching(self) -> NDArray[np.bool_]:
        """Set-points inside the material, (n,)."""
        return np.asarray(self.place[:, 2] > 0.0)


def five_phases(
    *motions: Poke | Slide,
    place: tuple[float, float] = (0.0, 0.0),
    height: float = 0.015,
    free: float = 2.0,
    hold: float = 1.0,
    approach: float = 1.2,
    tilt: float = 0.3,
    period: float = 1e-3,
) -> Script:
    """Turn in the air (that shows weight and bias apart); then for each motion approach, hold, move, retract, and
    return.

    Each motion begins and ends in the air, so that a sensor that drifts is seen at zero before and after it. The return
    is the phase "rest".

    Args:
        motions: one after the other. place: along both tangents [m].
        height: above the surface [m]. free, hold, approach: [s]; no free phase for 0. tilt: in the air [rad].
        period: of the controller [s].

    Raises:
        InputError: nothing to do, or a duration or amplitude that is no positive number.
    """
    if not motions:
        raise InputError("an experiment without motion", "a poke or a slide", "add one")
    for motion in motions:
        if not (np.isfinite(motion.duration) and motion.duration > 0):
            raise InputError(f"a {motion.name} that takes {motion.duration} s", "a positive duration", "correct it")
    way = _Way(np.array([0.0, 0.0, -height]), period)
    if free > 0:
        way.turn("free", free, tilt)
    for motion in motions:
        way.go("approach", np.array([0.0, 0.0, motion.depth]), approach)
        way.stand("hold", hold)
        way.add(motion.name, motion.path((np.arange(round(motion.duration / period)) + 1) * period))
        way.go("retract", np.array([*way.here[:2], -height]), approach)
        way.go("rest", np.array([0.0, 0.0, -height]), 0.5 * approach)
    return way.script(place)


class _Way:
    """Parts of a script, each of which begins where the one before ends; from a place, at a control period [s]."""

    def __init__(self, here: Array, period: float) -> None:
        self.here, self.period = here, period
        self.parts: list[tuple[str, Array, Array]] = []

    def add(self, name: str, path: Array, tilts: Array | None = None) -> None:
        """A path, (n, 3), and the tool's tilts along it, (n, 2)."""
        self.parts.append((name, path, np.zeros((len(path), 2)) if tilts is None else tilts))
        self.here = path[-1]

    def stand(self, name: str, seconds: float) -> None:
        """Stay there for so long."""
        self.add(name, np.tile(self.here, (max(1, round(seconds / self.period)), 1)))

    def go(self, name: str, target: Array, seconds: float) -> None:
        """To a place in so long."""
        s = minimum_jerk((np.arange(round(seconds / self.period)) + 1) * self.period / seconds)[:, None]
        self.add(name, self.here + s * (target - self.here))

    def turn(self, name: str, seconds: float, tilt: float) -> None:
        """Tilt about both tangents in a circle, and stay there."""
        u = np.arange(round(seconds / self.period)) * self.period
        angle, size = 2 * np.pi * u / seconds * 1.5, tilt * np.sin(np.pi * u / seconds) ** 2
        wave = size[:, None] * np.column_stack([np.sin(angle), np.cos(angle)])
        self.add(name, np.tile(self.here, (len(u), 1)), wave)

    def script(self, place: tuple[float, float]) -> Script:
        """All of it, displaced along both tangents [m]."""
        names, paths, tilts = zip(*self.parts)
        phase = np.repeat(names, [len(path) for path in paths])
        places: Array = np.concatenate(paths)
        places[:, :2] += place
        times: Array = np.arange(len(phase), dtype=np.float64) * self.period
        return Script(times, phase, places, np.concatenate(tilts))


def minimum_jerk(s: NDArray[np.floating]) -> Array:
    """Rest to rest on [0, 1] with continuous acceleration (Flash & Hogan 1985)."""
    s = np.clip(s, 0.0, 1.0)
    return np.asarray(s**3 * (10 - 15 * s + 6 * s**2), dtype=np.float64)


def _to_rest(here: Array, speed: Array, acceleration: Array, there: Array, span: float, share: Array) -> Array:
    """From a motion to rest at another place within `span` [s]: the polynomial of fifth degree, (len(share), k).

    It has the least jerk of all that begin and end so (Flash & Hogan 1985). Shares of the span are 0…1, (n,).
    """
    s, way, v, a = share[:, None], there - here, speed * span, acceleration * span**2
    rise = (10.0 * way - 6.0 * v - 1.5 * a) + s * (
        (-15.0 * way + 8.0 * v + 1.5 * a) + s * (6.0 * way - 3.0 * v - 0.5 * a)
    )
    return np.asarray(here + s * (v + s * (0.5 * a + s * rise)))


def _turn(angle: Array, axis: Array) -> Array:
    """Rotations about an axis, (n, 3, 3)."""
    k = np.array([[0.0, -axis[2], axis[1]], [axis[2], 0.0, -axis[0]], [-axis[1], axis[0], 0.0]])
    out: Array = np.eye(3) + np.sin(angle)[:, None, None] * k + (1 - np.cos(angle))[:, None, None] * (k @ k)
    return out
