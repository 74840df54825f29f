"""A ball-ended tip pressed into curved phantoms along rays: quasi-static, with noise; the truth stays in here.

The material is Kelvin-Voigt along the true normal, twice as stiff on one side of a line that nobody is given. What
estimators get is `TipMotion`: the path of the tool's end and the force on it.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import reduce

import numpy as np

from kinid.contact.registration import felt_in_motion
from kinid.mapping.shape import Shape
from kinid.mapping.shape.exploration import next_touches
from kinid.mapping.shape.touches import touches_of_motion
from kinid.modeling.model import Model
from kinid.robotics.motion import TipMotion
from kinid.signal.derivative import Differentiator

#: of the tip [m]; of position [m] and force [N]; samples a second
RADIUS, POSITION_NOISE, FORCE_NOISE, RATE = 4e-3, 1e-5, 0.02, 200.0
#: of a press: speed [m/s], the force that turns it round [N], how long it is held there [s], how far from where the
#: surface is expected it begins [m]
SPEED, ENOUGH, HOLD, BEFORE = 0.01, 1.5, 0.15, 8e-3
SOFT, DAMPING = 600.0, 5.0
DOWN = np.array([0.0, 0.0, -1.0])


@dataclass(frozen=True)
class Phantom:
    """z = height(x, y) with its slopes, in its own frame turned by `turn` about z and moved to `origin`; a line at
    `angle`, `offset` beyond which it is twice as stiff; half axes of the ellipse, or sides of the square, of what is
    touched.
    """

    surface: Callable[[np.ndarray, np.ndarray], tuple[np.ndarray, np.ndarray, np.ndarray]]
    half: tuple[float, float]
    round: bool
    turn: float
    angle: float
    offset: float
    origin: np.ndarray
    friction: float = 0.0

    @property
    def axes(self):
        c, s = np.cos(self.turn), np.sin(self.turn)
        return np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])

    def region(self, spacing):
        """Places of a square grid that can be touched, own frame (m, 2)."""
        ticks = [np.arange(-h + 0.5 * spacing, h, spacing) for h in self.half]
        q = np.stack(np.meshgrid(*ticks, indexing="ij"), -1).reshape(-1, 2)
        return q[np.sum((q / self.half) ** 2, axis=1) <= 1.0] if self.round else q

    def points(self, q):
        """On the surface, base frame (m, 3)."""
        return self.origin + np.column_stack([q, self.surface(*q.T)[0]]) @ self.axes

    def stiffness(self, q):
        across = q @ [np.cos(self.angle), np.sin(self.angle)] - self.offset
        return np.where(across > 0.0, 2.0 * SOFT, SOFT)

    def closest(self, points):
        """Signed distance (> 0 outside), normal, and place in its own frame of base points (m, 3)."""
        c = (points - self.origin) @ self.axes.T
        q = c[:, :2].copy()
        for _ in range(60):
            z, zx, zy = self.surface(*q.T)
            normal = np.column_stack([-zx, -zy, np.ones_like(z)])
            normal /= np.linalg.norm(normal, axis=1, keepdims=True)
            beside = c - np.column_stack([q, z])
            distance = np.einsum("mi,mi->m", beside, normal)
            q += 0.7 * (beside - distance[:, None] * normal)[:, :2]
        return distance, normal @ self.axes, q

    def path(self, place, direction, before=BEFORE, speed=SPEED):
        """The ball's middle while it is pressed in along `direction` and taken out, (n, 3).

        It would meet `place`, begins so far before it, and turns round at the force `ENOUGH`.
        """
        way = np.arange(-before, 0.03, speed / RATE)
        centre = place + (way - RADIUS)[:, None] * direction
        distance, _, q = self.closest(centre)
        end = int(np.argmax(self.stiffness(q) * (RADIUS - distance) >= ENOUGH))
        return centre[np.concatenate([np.arange(end), np.full(round(HOLD * RATE), end), np.arange(end, -1, -1)])]

    def press(self, place, direction, rng):
        """What a touch logs: motion, and the tool's axis, which points along `direction`."""
        return self.motion(self.path(place, direction), direction, rng)

    def slide(self, start, end, depth=1.5e-3):
        """The ball's middle while it is pressed in along the normal, slides at a depth and is taken out, (n, 3).

        Args:
            start, end: of the way, own frame, (2,).
        """
        way = np.linspace(start, end, round(float(np.linalg.norm(end - start)) / SPEED * RATE))
        normal = self.closest(self.points(way))[1]
        deep = self.points(way) + (RADIUS - depth) * normal
        far = np.arange(0.0, BEFORE, SPEED / RATE)[:, None]
        return np.concatenate([deep[0] + far[::-1] * normal[0], deep, deep[-1] + far * normal[-1]])

    def pushed(self, centre):
        """Force on the ball along a path of its middle, (n, 3), and its depth, (n,)."""
        distance, normal, q = self.closest(centre)
        t = np.arange(len(centre)) / RATE
        depth = RADIUS - distance
        size = np.maximum(self.stiffness(q) * depth + DAMPING * np.gradient(depth, t), 0.0) * (depth > 0.0)
        speed = np.gradient(centre, t, axis=0)
        slip = speed - np.einsum("ni,ni->n", speed, normal)[:, None] * normal
        slip /= np.hypot(1e-3, np.linalg.norm(slip, axis=1))[:, None]
        return size[:, None] * (normal - self.friction * slip), depth

    def motion(self, centre, axis, rng):
        """What is logged along a path of the ball's middle (n, 3)."""
        t = np.arange(len(centre)) / RATE
        position = centre + RADIUS * axis + POSITION_NOISE * rng.standard_normal(centre.shape)
        velocity = Differentiator()(t, position, (slice(0, len(t)),)).first
        force = self.pushed(centre)[0] + FORCE_NOISE * rng.standard_normal(centre.shape)
        return TipMotion(t, position, velocity, force), np.tile(axis, (len(t), 1))


MODEL = Model("kelvin-voigt")


def made_of(motion, axis):
    """What an estimator makes of a log."""
    return touches_of_motion(motion, felt_in_motion(motion), axis, MODEL, RADIUS, "touch")


def touched(phantom, place, direction, rng):
    """What an estimator makes of a touch."""
    return made_of(*phantom.press(place, direction, rng))


def together(parts):
    return reduce(lambda one, other: one.with_more(other), parts)


def by_grid(phantom, count, rng):
    """Touches from above in a square grid of at least so many."""
    spacing = 2.0 * np.sqrt(np.prod(phantom.half) / count)
    while len(q := phantom.region(spacing)) < count:
        spacing *= 0.99
    return together([touched(phantom, place, DOWN, rng) for place in phantom.points(q)])


def by_choice(phantom, count, rng, learn_every=5):
    """The shape after so many touches: the first from above, at the rim and within, then where most is told."""
    circle = np.linspace(0.0, 2.0 * np.pi, 9)[:-1]
    ring = np.column_stack([np.cos(circle), np.sin(circle)])
    ring = 0.97 * (ring if phantom.round else ring / np.abs(ring).max(axis=1, keepdims=True))
    start = np.vstack([ring, 0.4 * np.array([[1, 1], [1, -1], [-1, 1], [-1, -1]])]) * phantom.half
    touches = together([touched(phantom, place, DOWN, rng) for place in phantom.points(start)])
    shape, region = Shape.fit(touches), phantom.points(phantom.region(1.5e-3))
    while len(touches.touches) < count:
        flat = (region - shape.plane.point) @ shape.plane.axes[:2].T
        (chosen,) = next_touches(shape, "stiffness", 1, flat)
        touches = touches.with_more(touched(phantom, chosen.place, chosen.direction, rng))
        anew = len(touches.touches) % learn_every == 0
        shape = Shape.fit(touches, None if anew else shape.implicit.learnt)
    return shape


@dataclass(frozen=True)
class Errors:
    """Over the whole region: shape, rms [m]; share of it within the stated 95 %; stiffness, mean and rms of the
    ratio.
    """

    shape: float
    within: float
    stiffness: float
    stiffness_rms: float


def errors(phantom, shape):
    flat = (phantom.points(phantom.region(1.5e-3)) - shape.plane.point) @ shape.plane.axes[:2].T
    located = shape.at(flat)
    distance, _, q = phantom.closest(located.points)
    off = shape.interpolator("stiffness").at(flat).mean / phantom.stiffness(q) - 1.0
    assert np.isfinite(distance).all()
    assert np.isfinite(off).all()
    rms = float(np.sqrt(np.mean(distance**2)))
    within = float(np.mean(np.abs(distance) <= 1.96 * located.sd))
    return Errors(rms, within, float(np.mean(np.abs(off))), float(np.sqrt(np.mean(off**2))))


def egg(rng, friction=0.0):
    """Half an egg, 90 mm long and 30 mm high, blunter at one end."""
    a, b, c, blunt = 0.045 * rng.uniform(0.9, 1.1), 0.032, 0.030 * rng.uniform(0.9, 1.1), 0.25

    def surface(x, y):
        wide = b**2 * (1.0 + blunt * x / a)
        rest = np.maximum(1.0 - (x / a) ** 2 - y**2 / wide, 0.02)
        z = c * np.sqrt(rest)
        turn = c**2 / (2.0 * z)
        return z, turn * (-2.0 * x / a**2 + y**2 * b**2 * blunt / a / wide**2), turn * (-2.0 * y / wide)

    return Phantom(surface, (0.75 * a, 0.75 * b), True, *_placed(rng), friction)


def saddle(rng, friction=0.0):
    """A saddle of 60 mm × 60 mm whose sides rise and fall by some 11 mm."""
    up, down = 0.040 * rng.uniform(0.9, 1.1), 0.040 * rng.uniform(0.9, 1.1)

    def surface(x, y):
        return x**2 / (2 * up) - y**2 / (2 * down), x / up, -y / down

    return Phantom(surface, (0.03, 0.03), False, *_placed(rng), friction)


def _placed(rng):
    origin = np.array([0.55, 0.0, 0.10]) + rng.uniform(-0.01, 0.01, 3)
    return rng.uniform(0.0, np.pi), rng.uniform(0.0, 2 * np.pi), rng.uniform(-5e-3, 5e-3), origin


PHANTOMS = {"egg": egg, "saddle": saddle}
