"""The five-phase protocol as a motion of the robot: approach, hold, move, retract, return; within limits or refused."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

import kinid.urdf
from kinid.data.rig import Rig
from kinid.errors import InputError
from kinid.planning import paths
from kinid.planning.check import Usage, check
from kinid.planning.collision import Scene
from kinid.planning.course import Course
from kinid.planning.expected import Law
from kinid.planning.limits import Limits
from kinid.planning.protocol import Guard, Protocol, check_length, deepest_of
from kinid.planning.reach import TURNS, Reach
from kinid.planning.setpoint_timing import Pace, Profile, change, rest
from kinid.planning.touches import Place, Poke, Touch
from kinid.planning.trajectory import Trajectory
from kinid.robotics.robot import Robot
from kinid.robotics.surface import Plane, Surface
from kinid.robotics.surface import load as load_surface
from kinid.writers import Json

Array = NDArray[np.float64]

#: postures to begin with that are tried before a plan is given up
TRIES = 6


@dataclass(frozen=True, eq=False)
class _Piece:
    """A stretch of time on a course: `law` gives the length along it and its derivatives, (4, n)."""

    phase: str
    course: Course
    law: Callable[[Array], Array]
    duration: float
    touch: int


@dataclass(frozen=True, eq=False)
class Planner:
    """Plans touches for the robot and surface of a rig.

    Attributes:
        rig: with a robot and a surface. protocol: how. law: the force to expect; None: unknown. limits: default: the
            URDF's.
    """

    rig: Rig
    protocol: Protocol = Protocol()
    law: Law | None = None
    given_limits: Limits | None = None

    @cached_property
    def robot(self) -> Robot:
        """Of the rig."""
        return Robot.load(self.rig)

    @cached_property
    def limits(self) -> Limits:
        """Of its joints."""
        if self.given_limits is not None:
            return self.given_limits
        return Limits.of(self.robot, kinid.urdf.path(self.robot.name, self.rig.folder))

    @cached_property
    def surface(self) -> Surface:
        """Of the rig."""
        surface = load_surface(self.rig)
        if surface is None:
            raise InputError(
                "a rig without [surface]", "the surface to touch", "add [surface] point and normal, or mesh"
            )
        return surface

    @cached_property
    def reach(self) -> Reach:
        """Poses to joints."""
        return Reach(self.robot, self.limits, self.rig.tool)

    def plan(self, touches: Sequence[Touch]) -> Trajectory:
        """The motion: from above the first touch through all of them in their order, back to where it began.

        Raises:
            InputError: what can't be done, and the limit that forbids it.
        """
        if not touches:
            raise InputError("no touch to plan", "a poke or a slide", "add one")
        check_length(touches, self.protocol)
        _ = self.reach  # says what the arm lacks before anything else needs it
        spots = [paths.spots(self.surface, touch, self.protocol.height) for touch in touches]
        scene = self._scene(spots, touches)
        first: InputError | None = None
        for tries, (posture, frames) in enumerate(self._starts(spots[0][0], "the first touch")):
            if tries == TRIES:
                break
            try:
                return self._from(posture, frames, touches, spots, scene)
            except InputError as error:  # the most comfortable posture's reason is the one to tell
                first = first or error
        assert first is not None
        raise first

    def joints(self, place: Place, deepest: float) -> Callable[[Array], Array]:
        """Depth and its first three derivatives (4, n) → share of velocity, acceleration and jerk that joints use
        there, (n,).

        Args:
            place: of a poke. deepest: that it may go [m].

        Raises:
            InputError: a place that the robot can't reach.
        """
        (spot,) = paths.spots(self.surface, Poke(place), self.protocol.height)
        posture, frames = next(self._starts(spot, "the poke"))
        course = self._down(spot, deepest, frames, posture, "the poke")
        limits, height = self.limits, self.protocol.height

        def shares(motion: Array) -> Array:
            s = motion[0] + height
            _, dq, ddq = course(s, motion[1], motion[2])
            used = (dq / limits.velocity, ddq / limits.acceleration, course.jerk(s, *motion[1:]) / limits.jerk)
            out: Array = np.max(np.abs(used), axis=(0, 2))
            return out

        return shares

    def _starts(self, spot: paths.Spot, what: str) -> Iterator[tuple[Array, paths.Frames]]:
        """Postures above a spot, the most comfortable first, and how the tool is turned in each."""
        yaws = [self.protocol.yaw] if self.protocol.yaw is not None else [k * 2 * np.pi / TURNS for k in range(TURNS)]
        frames = [paths.Frames(spot.normal, self.surface, yaw) for yaw in yaws]
        rotations = np.stack([frame.at(spot) for frame in frames])
        for posture, k in self.reach.postures(spot.above(self.protocol.height), rotations, what):
            yield posture, frames[k]

    def _scene(self, spots: list[list[paths.Spot]], touches: Sequence[Touch]) -> Scene | None:
        if not self.protocol.collisions:
            return None
        places = np.array([spot.point for each in spots for spot in each])
        return Scene.of(self.robot, self.rig.folder, self.surface, places=places, deepest=max(map(deepest_of, touches)))

    def _from(
        self,
        posture: Array,
        frames: paths.Frames,
        touches: Sequence[Touch],
        spots: list[list[paths.Spot]],
        scene: Scene | None,
    ) -> Trajectory:
        pieces: list[_Piece] = []
        here, at = posture, spots[0][0]
        home, home_q = at, posture
        approach = self._contact_pace(max(map(deepest_of, touches)))
        for number, (touch, corners) in enumerate(zip(touches, spots)):
            if number:
                here = self._travel(pieces, at, corners[0], frames, here, number - 1)
            here, at = self._touch(pieces, touch, corners, frames, here, number, approach)
        if at is not home:
            here = self._travel(pieces, at, home, frames, here, len(touches) - 1)
        if np.abs(here - home_q).max() > 1e-6:
            raise InputError(
                "touches after which the arm comes back in another posture",
                "places around which it can go in one",
                "plan them in parts",
            )
        return self._sampled(pieces, touches, scene)

    def _contact_pace(self, deepest: float) -> Pace:
        pace, guard = self.protocol.contact, self.protocol.guard
        if guard is None or self.law is None:
            return pace
        slow = guard.speed(self.law.stiffness(deepest), pace.acceleration)
        return Pace(min(pace.speed, slow), pace.acceleration, pace.jerk)

    def _travel(
        self, pieces: list[_Piece], a: paths.Spot, b: paths.Spot, frames: paths.Frames, here: Array, touch: int
    ) -> Array:
        """Through the air from above one spot to above another; the joints there."""
        nodes, positions, rotations = paths.travel(a, b, frames, self.protocol.height)
        if nodes[-1] < 1e-9:
            return here
        course = Course.through(self.reach, nodes, positions, rotations, here, "the way to the next touch")
        profile = change(0.0, course.length, course.pace(self.protocol.travel, self.limits))
        pieces.append(_Piece("rest", course, profile, profile.duration, touch))
        last: Array = course.q[-1]
        return last

    def _touch(
        self,
        pieces: list[_Piece],
        touch: Touch,
        corners: list[paths.Spot],
        frames: paths.Frames,
        here: Array,
        number: int,
        approach: Pace,
    ) -> tuple[Array, paths.Spot]:
        height, what = self.protocol.height, f"the {touch.name}"
        down = self._down(corners[0], deepest_of(touch), frames, here, what)
        low = height + touch.depth

        def add(phase: str, course: Course, law: Callable[[Array], Array], duration: float) -> None:
            if duration > 0:
                pieces.append(_Piece(phase, course, law, duration, number))

        into = self._approach(down, low, approach)
        add("free", down, rest(0.0, self.protocol.pause), self.protocol.pause)
        add("approach", down, into, into.duration)
        add("hold", down, rest(low, touch.hold), touch.hold)
        end, up = corners[0], down
        if isinstance(touch, Poke):
            signal = touch.signal

            def poke(t: Array) -> Array:
                out: Array = signal(t)
                out[0] += height
                return out

            add("poke", down, poke, signal.duration)
        else:
            q = down(np.array([low]), np.zeros(1), np.zeros(1))[0][0]
            legs = []
            for a, b in zip(corners[:-1], corners[1:]):
                leg = Course.through(self.reach, *paths.leg(self.surface, a, b, touch.depth, frames), q, what)
                legs.append(leg)
                q = leg.q[-1]
            travel = self.protocol.travel
            for leg, forth in [(leg, True) for leg in legs] + [(leg, False) for leg in reversed(legs) if touch.back]:
                pace = leg.pace(Pace(touch.speed, travel.acceleration, travel.jerk), self.limits)
                profile = change(0.0, leg.length, pace) if forth else change(leg.length, 0.0, pace)
                add("slide", leg, profile, profile.duration)
            if not touch.back:
                end = corners[-1]
                up = self._down(end, touch.depth, frames, None, what, below=q)
        out = change(low, 0.0, up.pace(self.protocol.travel, self.limits))
        add("retract", up, out, out.duration)
        add("rest", up, rest(0.0, self.protocol.pause), self.protocol.pause)
        return up.q[0], end

    def _down(
        self,
        spot: paths.Spot,
        deepest: float,
        frames: paths.Frames,
        here: Array | None,
        what: str,
        below: Array | None = None,
    ) -> Course:
        """The course from above a spot into the material, solved from its top (`here`) or from its end (`below`)."""
        nodes, positions, rotations = paths.down(spot, self.protocol.height, deepest, frames)
        if here is not None:
            return Course.through(self.reach, nodes, positions, rotations, here, what)
        assert below is not None
        q = self.reach.along(positions[::-1], rotations[::-1], below, what)
        return Course(float(nodes[-1]), nodes, q[::-1])

    def _approach(self, course: Course, low: float, slow: Pace) -> Profile:
        """Quickly to the clearance, then slowly into the material."""
        fast, slow = course.pace(self.protocol.travel, self.limits), course.pace(slow, self.limits)
        turn = self.protocol.height - self.protocol.clearance
        # for such a short way a speed at the turn may be more than can be stopped
        for speed in (min(slow.speed, fast.speed), 0.0):
            both = change(0.0, turn, fast, end_speed=speed).then(change(turn, low, slow, start_speed=speed))
            if both.states[:, 1].min() >= -1e-12 and both.states[:, 0].max() <= low + 1e-9:
                break
        return both

    def _sampled(self, pieces: list[_Piece], touches: Sequence[Touch], scene: Scene | None) -> Trajectory:
        starts = np.cumsum([0.0] + [piece.duration for piece in pieces])
        t = np.arange(int(np.ceil(starts[-1] * self.protocol.rate)) + 1) / self.protocol.rate
        edges = np.searchsorted(t, starts, side="left")
        edges[-1] = len(t)
        n, joints = len(t), self.robot.joint_count
        q, dq, ddq = np.empty((n, joints)), np.empty((n, joints)), np.empty((n, joints))
        gap, last = 0.0, None
        for i, piece in enumerate(pieces):
            a, b = edges[i], edges[i + 1]
            # both ends of the piece ride along: they tell how well it joins its neighbours
            when = np.concatenate([[0.0], t[a:b] - starts[i], [piece.duration]])
            s, ds, dds, _ = piece.law(when)
            row = piece.course(s, ds, dds)
            q[a:b], dq[a:b], ddq[a:b] = (part[1:-1] for part in row)
            if last is not None:
                gap = max(gap, *(float(np.abs(part[0] - before).max()) for part, before in zip(row, last)))
            last = [part[-1] for part in row]
        if gap > 1e-9:
            raise InputError(
                f"a plan with a jump of {gap:.3g} between two of its parts",
                "joints that move continuously",
                "choose a signal that begins and ends at rest",
            )
        counts = np.diff(edges)
        phase = np.repeat(np.array([piece.phase for piece in pieces]), counts)
        touch = np.repeat(np.array([piece.touch for piece in pieces], dtype=np.int64), counts)
        return self._complete(t, phase, touch, q, dq, ddq, touches, scene, gap)

    def _complete(
        self,
        t: Array,
        phase: NDArray[np.str_],
        touch: NDArray[np.int64],
        q: Array,
        dq: Array,
        ddq: Array,
        touches: Sequence[Touch],
        scene: Scene | None,
        gap: float,
    ) -> Trajectory:
        """Tip, depth, expected forces, and all checks."""
        tip = self.robot.kinematics(self.robot.tip_frame or "", q, dq)
        place, rates, axes = paths.in_surface(self.surface, t, tip.position, tip.velocity)
        guard = self.protocol.guard
        inside = place[:, 2] > 0
        normal, force = np.where(inside, np.nan, 0.0), np.where(inside[:, None], np.nan, np.zeros((1, 3)))
        assumed = np.zeros((len(t), 3))
        if self.law is not None:
            # memory of the material begins anew with each touch: it has come back by then
            law, local = self.law, np.empty((3, len(t)))
            signals = law.signals(t, place[:, 2], rates[:, 2], place[:, :2].T.copy(), rates[:, :2].T.copy())
            signals.dt[np.flatnonzero(np.diff(touch)) + 1] = 0.0
            local = law(signals)
            normal = local[2]
            assumed = force = np.einsum("kn,nkj->nj", local, axes)
        elif guard is not None:
            assumed = np.where(inside[:, None], guard.force * axes[:, 2], 0.0)
        if guard is not None and self.law is not None and normal.max() > guard.force:
            row = int(np.argmax(normal))
            raise InputError(
                f"a {phase[row]} whose binding limit is the force: {normal[row]:.4g} N expected at "
                f"{1e3 * place[row, 2]:.3g} mm, of {guard.force:g} N allowed",
                "a force within the limit",
                "press less deep, or allow more",
            )
        asked: Json = {
            "touches": len(touches),
            "first": touches[0].to_dict(),
            "corners": [[list(map(float, c)) for c in touch.corners] for touch in touches],
        }
        motion = Trajectory(
            t,
            phase,
            q,
            dq,
            ddq,
            tip.position,
            self.robot.joint_names,
            place,
            force,
            normal,
            np.full(len(t), np.inf if guard is None else guard.force),
            touch,
        )
        # what the arm would run into comes first: along a way into it joints may well be fast, which is not what
        # forbids it
        checked = scene.check(q, depth=place[:, 2]) if scene is not None else 0
        used = check(motion, self.limits, self.reach.torques(q, dq, ddq, assumed), "a motion")
        return _with(motion, self._facts(used, asked, gap, checked, scene))

    def _facts(self, used: tuple[Usage, ...], asked: Json, gap: float, checked: int, scene: Scene | None) -> Json:
        import kinid as package

        limits = self.limits
        return {
            "made_by": f"kinid {package.__version__}",
            "robot": self.robot.name,
            "asked": asked,
            "rate": self.protocol.rate,
            "law": None if self.law is None else self.law.to_dict(),
            "guard": None
            if self.protocol.guard is None
            else {"force": self.protocol.guard.force, "reaction": self.protocol.guard.reaction, "then": "retract"},
            "limits": {
                name: getattr(limits, name).tolist()
                for name in ("lower", "upper", "velocity", "acceleration", "jerk", "torque")
            },
            "used": [use.to_dict() for use in used],
            "joins": gap,
            "postures_checked_for_collision": checked,
            "notes": list(() if scene is None else scene.notes),
        }


def _with(motion: Trajectory, facts: Json) -> Trajectory:
    import dataclasses

    return dataclasses.replace(motion, provenance=facts)


__all__ = ["Guard", "Plane", "Planner", "Protocol"]
