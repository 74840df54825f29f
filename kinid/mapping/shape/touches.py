"""Touches of a surface that nobody knows: where each met it, the normal there, and what a model says of the material.

A touch begins at its contact onset (`kinid.contact.registration`). The normal is that of the force without friction,
which acts along the slip: it turns the force to one side on the way in and to the other on the way out, and is left out
of a slide. Depth is counted from the tangent plane of the touch's own onset.

A tip that ends in a ball of radius r, with its end at the tip frame and the tool's outward axis z, touches the surface
at

    tip − r z − r n

which is the tip itself only where z = −n. Lengths in m, base frame.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from kinid.contact.kinds_of_motion import MOVES
from kinid.contact.registration import Felt, Onset, felt_in_log
from kinid.contact.series import ContactSeries
from kinid.data.log import Log
from kinid.data.rig import Rig, surface_axes
from kinid.errors import InputError
from kinid.mapping.layers import property_name
from kinid.mapping.property_map import Probe, Property
from kinid.modeling.model import Model
from kinid.robotics.motion import TipMotion
from kinid.robotics.robot import Robot
from kinid.robotics.surface import Plane

Array = NDArray[np.float64]

#: a tip slides where less than this share of its way is along the force; it is at rest where it goes less far than
#: `STILL` [m] within so long before and after [s]
ASIDE, STILL, MOMENT = 0.5, 1e-4, 0.05
#: a slide gives a normal each so far [m]
PIECE = 2e-3
#: sine of the angle to the surface within which a tip slides; steeper, it goes in or comes out
STEEP = 0.2
#: share by which the force may change from half to half of a piece: more, and the tip goes deeper or less deep there
STEADY = 0.05
#: cosine between the way in and the force: less would put an onset anywhere
LEAST = 0.2
#: a fit sees so much of the air before a touch [s]
BEFORE = 0.1
#: of the air, so many places of a log are kept at most, none of them nearer to a touch in time than this [s]
AIR, CLEAR = 100, 0.15


@dataclass(frozen=True, eq=False)
class Touch:
    """One stay in the material.

    Attributes:
        probe: where it met the surface, and what the model says of the material there. normal: outward, unit, (3,).
        place_sd: of the place along the normal [m]. along, normals: where it pressed in and slid, and the normals
        there, (k, 3) each.
    """

    probe: Probe
    normal: Array
    place_sd: float
    along: Array
    normals: Array


@dataclass(frozen=True, eq=False)
class Touches:
    """Of one log, or of many.

    Attributes:
        properties: that the model gives. touches: in the order they came. air: where the middle of the tip's ball was
            without touching, (k, 3). tip_radius: of the ball, 0 for a point. model: that was fitted.
    """

    properties: tuple[Property, ...]
    touches: tuple[Touch, ...]
    air: Array
    tip_radius: float = 0.0
    model: str = ""

    @property
    def places(self) -> Array:
        """Where the touches met the surface, (n, 3)."""
        return np.array([touch.probe.place for touch in self.touches]).reshape(-1, 3)

    @property
    def normals(self) -> Array:
        """There, (n, 3)."""
        return np.array([touch.normal for touch in self.touches]).reshape(-1, 3)

    def with_more(self, other: Touches) -> Touches:
        """These and others of the same tip.

        Raises:
            InputError: others that tell other properties.
        """
        if other.properties != self.properties:
            ours, theirs = (", ".join(item.name for item in part.properties) for part in (self, other))
            raise InputError(f"{theirs} beside {ours}", "logs that tell the same properties", "take logs of one kind")
        air = np.concatenate([self.air, other.air])
        return replace(self, touches=(*self.touches, *other.touches), air=air)


@dataclass(frozen=True, eq=False)
class Ball:
    """Motion of the middle of the tip's ball: t [s] (n,), position [m], velocity [m/s] and force on it [N], (n, 3)
    each.
    """

    t: Array
    position: Array
    velocity: Array
    force: Array
    radius: float


def touches_of_log(log: Log, rig: Rig, robot: Robot, model: Model, tip_radius: float, source: str) -> Touches:
    """The touches of a log.

    Args:
        log: with joints and wrench; it begins in the air, or labels its free motion "free". rig: its surface is not
        asked.
        robot: the rig's. model: fitted to each touch. tip_radius: of the ball that the tool ends in, 0 for a point.
        source: what the log is called.

    Raises:
        InputError: no wrench, no touch, or touches that can't carry the model.
    """
    motion, found = felt_in_log(log, rig, robot)
    assert log.q is not None  # the motion has come from them
    axis = robot.kinematics(robot.tip_frame or robot.sensor_frame or "", log.q).rotation[:, :, 2]
    return touches_of_motion(motion, found, axis, model, tip_radius, source)


def touches_of_motion(
    motion: TipMotion, found: Sequence[Felt], axis: Array, model: Model, tip_radius: float, source: str
) -> Touches:
    """The same from the tip's motion, the touches felt in it, and the tool's outward axis, (n, 3)."""
    if not found:
        raise InputError(f"no firm touch in {source}", "a log in which the tool touches the surface", "leave it out")
    assert motion.force is not None  # what was felt
    ball = Ball(motion.t, motion.position - tip_radius * axis, motion.velocity, motion.force, tip_radius)
    made, properties = list[Touch](), tuple[Property, ...]()
    free = np.isfinite(ball.position).all(axis=1)
    for number, each in enumerate(found):
        name = source if len(found) == 1 else f"{source}#{number}"
        lever = tip_radius * axis[each.rows.start]
        properties, touch = _touch(
            ball, replace(each.onset, position=each.onset.position - lever), each.rows, model, name
        )
        made.append(touch)
        free &= ~((ball.t > ball.t[each.rows.start] - CLEAR) & (ball.t < ball.t[each.rows.stop - 1] + CLEAR))
    air = ball.position[free]
    return Touches(properties, tuple(made), air[:: 1 + len(air) // AIR], tip_radius, str(model))


def _touch(ball: Ball, onset: Onset, rows: slice, model: Model, source: str) -> tuple[tuple[Property, ...], Touch]:
    """The properties that the model gives, and one touch, from the onset of the ball's middle and the rows of the
    touch.
    """
    leaves = _slides(ball, onset.direction, rows)
    slid = _slid(ball, onset.direction, _pieces(ball, leaves, rows.stop))
    press = slice(rows.start, leaves if slid else rows.stop)
    normal, way, free = _pressed(ball, onset.direction, press)
    if not free and slid:
        normal = slid[0][1]
    # the onset was sought along the force; it lies on the way of the ball
    first = ball.position[rows.start]
    middle = first - (first - onset.position) @ onset.direction / min(way @ onset.direction, -LEAST) * way
    fit = model.fit(_series(ball, Plane(middle, surface_axes(normal.tolist())), press), held_out=False)
    known = fit.model.parameters(fit.layout)
    properties = tuple(Property(property_name(name, fit.model, known), p.unit) for name, p in known.items())
    place, covariance = middle - ball.radius * normal, fit.solution.covariance.copy()
    probe = Probe(place, fit.values.copy(), covariance, fit.error.train, fit.error.noise_floor, source)
    turned = slid if slid and not free else [(_felt_at(ball, press), normal), *slid]
    middles, normals = (np.array(part) for part in zip(*turned))
    return properties, Touch(probe, normal, onset.sigma, middles - ball.radius * normals, normals)


def _slides(ball: Ball, direction: Array, rows: slice) -> int:
    """The row from which the tip slides, rather than going in or out along the force; the end where it doesn't."""
    reach = max(1, round(MOMENT / float(np.median(np.diff(ball.t)))))
    number = np.arange(rows.start, rows.stop)
    moved = ball.position[np.minimum(number + reach, rows.stop - 1)] - ball.position[np.maximum(number - reach, 0)]
    far = np.nan_to_num(np.linalg.norm(moved, axis=1))
    sliding = (far > max(STILL, MOVES * float(far.max()))) & (np.abs(moved @ direction) < ASIDE * far)
    return int(number[sliding.argmax()]) if sliding.any() else rows.stop


def _pressed(ball: Ball, direction: Array, rows: slice) -> tuple[Array, Array, bool]:
    """The normal where the tip pressed in, the unit direction in which it went in, and whether the normal is free of
    friction.

    Friction turns the force by one angle to one side on the way in and to the other on the way out: the normal is
    half-way between the two. Of a touch without a way out, the force of the way in has to do.

    Args:
        direction: of the force, about, (3,).
    """
    velocity, force = ball.velocity[rows], ball.force[rows]
    speed = velocity @ direction
    fast = MOVES * float(np.nanmax(np.abs(speed), initial=0.0))
    sound = np.isfinite(speed) & np.isfinite(force).all(axis=1)
    into, out = sound & (speed < -fast), sound & (speed > fast)
    ways = [part.sum(axis=0) for part in (force[into], force[out]) if len(part)] or [direction]
    normal = np.sum([each / max(float(np.linalg.norm(each)), 1e-12) for each in ways], axis=0)
    way = velocity[into].sum(axis=0) if into.any() else -direction
    return normal / np.linalg.norm(normal), way / np.linalg.norm(way), len(ways) > 1


def _series(ball: Ball, plane: Plane, rows: slice) -> ContactSeries:
    """Contact-frame quantities of rows and of the air before them, from the plane of the touch."""
    first = max(0, rows.start - round(BEFORE / float(np.median(np.diff(ball.t)))))
    place, speed, force = (
        (part[first : rows.stop] @ plane.axes.T).T for part in (ball.position - plane.point, ball.velocity, ball.force)
    )
    return ContactSeries(
        t=ball.t[first : rows.stop],
        depth=-place[2],
        depth_rate=-speed[2],
        slip1=place[0],
        slip2=place[1],
        slip_rate1=speed[0],
        slip_rate2=speed[1],
        normal_force=force[2],
        tangential_force1=force[0],
        tangential_force2=force[1],
        in_contact=np.arange(first, rows.stop) >= rows.start,
        valid=np.isfinite((place + speed + force).sum(axis=0)),
    )


def _pieces(ball: Ball, start: int, stop: int) -> list[slice]:
    """A slide in rows [start, stop), cut where the ball has gone so far again."""
    out = list[slice]()
    while start < stop:
        gone = np.linalg.norm(ball.position[start:stop] - ball.position[start], axis=1) >= PIECE
        if not gone.any():
            break
        out.append(slice(start, start + int(gone.argmax()) + 1))
        start = out[-1].stop
    return out


def _slid(ball: Ball, direction: Array, pieces: Sequence[slice]) -> list[tuple[Array, Array]]:
    """Where the ball's middle was on each piece of a slide, and the normal there.

    Friction acts along the slip: the rest of the force is along the normal. How deep the tip was does not matter, since
    a signed distance has one gradient all along a normal; that the depth stays the same does.

    Args:
        direction: of the force as the touch began, (3,). pieces: of the way; those that go in or come out are left out.
    """
    out = list[tuple[Array, Array]]()
    for rows in pieces:
        way = ball.position[rows.stop - 1] - ball.position[rows.start]
        force = np.nansum(ball.force[rows], axis=0)
        rest = force - (force @ way) / (way @ way) * way
        size = float(np.linalg.norm(rest))
        before, steepest = (out[-1][1], STEEP) if out else (direction, ASIDE)
        sizes = np.nan_to_num(np.linalg.norm(ball.force[rows], axis=1))
        first, last = (float(half.mean()) for half in np.array_split(sizes, 2))
        steady = abs(last - first) <= STEADY * first
        if size > 0.0 and steady and abs(way @ before) <= steepest * np.linalg.norm(way):
            out.append((_felt_at(ball, rows), rest / size))
    return out


def _felt_at(ball: Ball, rows: slice) -> Array:
    """Where the ball's middle was on average, weighted with the force, (3,)."""
    size = np.nan_to_num(np.linalg.norm(ball.force[rows], axis=1))
    return np.asarray(size @ np.nan_to_num(ball.position[rows]) / max(float(size.sum()), 1e-12))
