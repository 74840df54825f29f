"""Experiments worth choosing among: pokes, holds, slides and motion in the air, and how each becomes a robot's
trajectory.

All of them last about as long. A trajectory that can be driven is what an experiment is judged by, approach and retreat
included: what the robot can't do is not on the list.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from kinid.data.log import Log, Provenance
from kinid.errors import InputError
from kinid.modeling.experiment import Experiment
from kinid.modeling.from_logs import from_joint_torques, from_wrench
from kinid.modeling.model import Model
from kinid.planning.check import check
from kinid.planning.free_motion import Design, Swing, posture, scene_of, swing_drawn
from kinid.planning.planner import Planner
from kinid.planning.poke_design import Bounds
from kinid.planning.signals import Multisine
from kinid.planning.strokes import by_turns, stairs
from kinid.planning.touches import DEEPEST, Place, Poke, Slide, Touch
from kinid.planning.trajectory import Trajectory
from kinid.signal.derivative import Differentiator

Array = NDArray[np.float64]

#: what going there, approach, retreat and the pauses of a touch take [s], about
OVERHEAD = 1.5
#: what each experiment varies and what it keeps: why it can tell effects apart
WHY = {
    "long-hold": "the depth stays, so that what changes with time alone shows",
    "hold-between-looks-in-the-air": "the air before and after tells what drifts without contact from what contact "
    "changes",
    "slow-and-fast": "the same depths are passed at two rates, which sets what depends on the rate apart from what "
    "doesn't",
    "many-frequencies": "several rates at one depth set stiffness and loss apart at each of them",
    "slow-strokes": "the whole depth is passed again and again, so slowly that rates hardly count",
    "strokes": "the whole depth is passed in and out many times at one rate, which shows loops and what changes with "
    "time",
    "fast-strokes": "the whole depth is passed in and out quickly, which shows what depends on the rate",
    "alternating-strokes": "the same depths are passed at two rates by turns, so that nothing that changes with time "
    "is taken "
    "for what depends on the rate",
    "stairs": "rests at several depths on both ways set what depends on the depth apart from the way there",
    "several-depths": "the same motion at several depths shows what depends on the depth",
    "return-later": "the first place comes again after another, which sets time apart from place",
    "taps": "many landings show what happens where contact begins and ends",
    "rest-between-holds": "a rest in the air between two holds shows what recovers",
    "three-speeds": "one path at several speeds shows what depends on the speed",
    "reversals": "reversals along both tangents show what depends on the direction and on the way before",
    "two-loads": "one path under two loads sets what grows with the load apart from what doesn't",
    "speeds-and-loads": "one path at two speeds under two loads sets load and speed apart",
    "diagonals": "both diagonals under two loads show what depends on the direction",
    "slow-turns": "the tool's weight turns through the sensor while inertia hardly counts",
    "fast-turns": "inertia counts beside the tool's weight",
    "free-motion": "all joints move without contact",
}
#: drawn motions of all joints that are on the list, with a surface to touch and without
FREE_MOTIONS = 2, 12


@dataclass(frozen=True, eq=False)
class Proposal:
    """An experiment before it is planned.

    Attributes:
        name: kebab-case. title: in a few words, with its figures.
        touches: what is done to the surface; empty for motion in the air. pause: before and after each touch [s].
        wrist: of a motion in the air, turns of the last three joints alone, at this frequency [Hz]; None: of all
            joints.
        seed: of what is drawn. duration: of a motion in the air [s].
    """

    name: str
    title: str
    touches: tuple[Touch, ...] = ()
    pause: float = 0.2
    wrist: float | None = None
    seed: int = 0
    duration: float = 20.0

    @property
    def why(self) -> str:
        """What it varies and what it keeps, in words; "" where nobody thought about it."""
        return WHY.get(self.name.rstrip("-0123456789"), "")


def proposals(
    duration: float, depth: float, place: Place = (0.0, 0.0), *, contact: bool = True, bandwidth: float = 3.0
) -> list[Proposal]:
    """The list.

    Args:
        duration: of each, about [s]. depth: the deepest that any goes [m]. place: along both tangents [m].
        contact: whether the surface is touched at all. bandwidth: in which the robot follows [Hz].

    Raises:
        InputError: a duration, a depth or a bandwidth that leaves no room.
    """
    for what, value, least, most, unit in (
        ("duration", duration, 8.0, 600.0, "s"),
        ("depth", depth, 1e-5, DEEPEST, "m"),
        ("bandwidth", bandwidth, 0.5, 100.0, "Hz"),
    ):
        if not least <= value <= most:
            raise InputError(
                f"experiments with a {what} of {value:g} {unit}",
                f"{least:g} to {most:g} {unit}",
                f"allow {'more' if value < least else 'less'}",
            )
    out = list(_touching(duration, depth, place, bandwidth)) if contact else []
    slow, fast = 2.0 / duration, min(1.0, bandwidth)
    out += [
        Proposal("slow-turns", f"slow turns of the tool in the air ({slow:.2g} Hz)", wrist=slow, duration=duration),
        Proposal("fast-turns", f"fast turns of the tool in the air ({fast:.2g} Hz)", wrist=fast, duration=duration),
    ]
    out += [
        Proposal(f"free-motion-{k + 1}", f"motion of all joints in the air, draw {k + 1}", seed=k, duration=duration)
        for k in range(FREE_MOTIONS[0 if contact else 1])
    ]
    return list({proposal.title: proposal for proposal in out}.values())  # within a narrow bandwidth some are the same


def _touching(duration: float, depth: float, place: Place, bandwidth: float) -> Iterator[Proposal]:
    """All that touches: pokes, then slides."""
    yield from _poking(duration, depth, place, bandwidth)
    yield from _poking_anew(duration, depth, place)
    yield from _sliding(duration, depth, place)


def _shifted(place: Place, x: float, y: float) -> Place:
    """A place so far away along the tangents [m]."""
    return tuple(np.add(place, (x, y, 0.0)[: len(place)]))


def _sine(depth: float, frequency: float, seconds: float) -> Multisine:
    return Multisine(0.55 * depth, ((0.43 * depth, frequency),), seconds)


def _poking(duration: float, depth: float, place: Place, bandwidth: float) -> Iterator[Proposal]:
    """Pokes that hold, and that go in and out at several frequencies."""
    mm, still = 1e3 * depth, Multisine(depth, (), 0.6)
    one = duration - OVERHEAD
    hold = one - 0.6
    yield Proposal("long-hold", f"a hold of {hold:.0f} s at {mm:.2g} mm", (Poke(place, still, hold),))
    air = 0.3 * duration
    yield Proposal(
        "hold-between-looks-in-the-air",
        f"{air:.0f} s in the air, a hold at {mm:.2g} mm, {air:.0f} s in the air",
        (Poke(place, still, 0.4 * duration - OVERHEAD),),
        pause=air,
    )
    half = 0.5 * duration - OVERHEAD
    slow, fast = max(0.1, 2.0 / half), 0.9 * bandwidth
    yield Proposal(
        "slow-and-fast",
        f"pokes at {slow:.2g} Hz and at {fast:.2g} Hz",
        (Poke(place, _sine(depth, slow, half), 0.2), Poke(place, _sine(depth, fast, half), 0.2)),
    )
    tones = tuple(np.geomspace(2.0 / one, fast, 4))
    parts = tuple((0.42 * depth * w, f) for w, f in zip((0.4, 0.2, 0.2, 0.2), tones))
    yield Proposal(
        "many-frequencies",
        f"one poke with sines from {tones[0]:.2g} to {tones[-1]:.2g} Hz",
        (Poke(place, Multisine(0.55 * depth, parts, one - 0.5), 0.5),),
    )
    for name, f in (("slow-strokes", max(0.3, 2.0 / one)), ("strokes", min(1.0, fast)), ("fast-strokes", fast)):
        whole = Multisine(0.5 * depth, ((0.48 * depth, f),), one - 0.2)
        yield Proposal(name, f"one poke in and out at {f:.2g} Hz, as far as {mm:.2g} mm", (Poke(place, whole, 0.2),))
    f = max(0.3, 4.0 / one)
    yield Proposal(
        "alternating-strokes",
        f"one poke in and out, by turns at {f:.2g} and at {fast:.2g} Hz",
        (Poke(place, by_turns(f, fast, depth, one - 0.2), 0.2),),
    )


def _poking_anew(duration: float, depth: float, place: Place) -> Iterator[Proposal]:
    """Pokes of several depths, and with rests in the air."""
    mm, still = 1e3 * depth, Multisine(depth, (), 0.6)
    yield Proposal(
        "stairs",
        f"one poke that rests at five depths, up and down, as far as {mm:.2g} mm",
        (Poke(place, stairs(depth, duration - OVERHEAD - 0.2), 0.2),),
    )
    third = duration / 3 - OVERHEAD
    yield Proposal(
        "several-depths",
        f"pokes to {mm / 3:.2g}, {2 * mm / 3:.2g} and {mm:.2g} mm",
        tuple(Poke(place, _sine(k * depth / 3, 0.8, third), 0.3) for k in (1, 2, 3)),
    )
    yield Proposal(
        "return-later",
        f"a poke of {mm / 2:.2g} mm, one of {mm:.2g} mm elsewhere, and the first place again",
        (
            Poke(place, _sine(0.5 * depth, 0.8, third), 0.3),
            Poke(_shifted(place, 0.01, 0.0), _sine(depth, 0.8, third), 0.3),
            Poke(place, _sine(0.5 * depth, 0.8, third), 0.3),
        ),
    )
    taps = max(2, int(duration / (OVERHEAD + 0.7)))
    yield Proposal(
        "taps",
        f"{taps} touches to {mm:.2g} mm with quick retreats",
        tuple(Poke(place, still, 0.0) for _ in range(taps)),
    )
    twice = tuple(Poke(place, still, 0.3 * duration - OVERHEAD) for _ in range(2))
    yield Proposal(
        "rest-between-holds", "two holds at one place with a rest in the air between them", twice, 0.1 * duration
    )


def _sliding(duration: float, depth: float, place: Place) -> Iterator[Proposal]:
    """Slides that differ in speed, load and direction."""
    mm, pressed = 1e3 * depth, 0.6 * depth

    def there(length: float, speed: float, d: float = pressed) -> Slide:
        return Slide((_shifted(place, -0.5 * length, 0.0), _shifted(place, 0.5 * length, 0.0)), d, speed, 0.2)

    ways, length = duration - 3 * (OVERHEAD + 0.4), 0.016
    slowest = 2 * length * (1 + 1 / 3 + 1 / 9) / ways
    speeds = [slowest * 3**k for k in range(3)]
    listed = ", ".join(f"{1e3 * v:.2g}" for v in speeds)
    yield Proposal("three-speeds", f"slides at {listed} mm/s", tuple(there(length, v) for v in speeds))
    ways = duration - OVERHEAD - 0.4
    path = (
        _shifted(place, -0.005, 0.0),
        _shifted(place, 0.005, 0.0),
        _shifted(place, 0.0, 0.0),
        _shifted(place, 0.0, 0.005),
        _shifted(place, 0.0, -0.005),
    )
    yield Proposal(
        "reversals", "slides with reversals along both tangents", (Slide(path, pressed, 2 * 0.03 / ways, 0.2),)
    )
    ways = 0.5 * duration - OVERHEAD - 0.4
    yield Proposal(
        "two-loads",
        f"slides at {mm / 4:.2g} and {0.9 * mm:.2g} mm",
        tuple(there(0.012, 0.024 / ways, d) for d in (0.25 * depth, 0.9 * depth)),
    )
    ways = duration - 4 * (OVERHEAD + 0.4)
    if ways > 0.2 * duration:  # else there would be no slow slide among them
        slow = 2 * 2 * 0.012 * (1 + 1 / 9) / ways
        which = f"{1e3 * slow:.2g} and {9e3 * slow:.2g} mm/s, at {mm / 4:.2g} and {0.9 * mm:.2g} mm"
        yield Proposal(
            "speeds-and-loads",
            f"slides at {which}",
            tuple(there(0.012, v, d) for v in (slow, 9 * slow) for d in (0.25 * depth, 0.9 * depth)),
        )
    ways = 0.5 * duration - OVERHEAD - 0.4
    star = tuple(_shifted(place, x, y) for x, y in ((-0.004, -0.004), (0.004, 0.004), (0.004, -0.004), (-0.004, 0.004)))
    yield Proposal(
        "diagonals",
        f"slides along both diagonals at {mm / 4:.2g} and {0.9 * mm:.2g} mm",
        tuple(Slide(star, d, 2 * 0.0306 / ways, 0.2) for d in (0.25 * depth, 0.9 * depth)),
    )


def drawn_at_random(
    seed: int, duration: float, depth: float, place: Place = (0.0, 0.0), *, contact: bool = True, bandwidth: float = 3.0
) -> Proposal:
    """An experiment that nobody thought about, of the same length and bounds: a poke or a slide, or else a motion in
    the air.
    """
    rng = np.random.default_rng(seed)
    kind = rng.integers(2) if contact else 2
    one = duration - OVERHEAD
    if kind == 0:
        base = rng.uniform(0.3, 0.6) * depth
        sines = tuple(
            (base / 3 * a, float(f), float(w))
            for a, f, w in zip(rng.uniform(0.2, 1.0, 3), rng.uniform(0.1, 0.7 * bandwidth, 3), rng.uniform(0, 6, 3))
        )
        return Proposal("random-poke", "a poke at random", (Poke(place, Multisine(base, sines, one - 1.0), 1.0),))
    if kind == 1:
        corners = [tuple(np.add(place, (*rng.uniform(-0.008, 0.008, 2), 0.0)[: len(place)])) for _ in range(3)]
        length = sum(float(np.linalg.norm(np.subtract(b, a))) for a, b in zip(corners[:-1], corners[1:]))
        return Proposal(
            "random-slide",
            "a slide at random",
            (Slide(tuple(corners), rng.uniform(0.2, 0.9) * depth, 2 * length / (one - 1.0), 1.0),),
        )
    return Proposal("random-free-motion", "a motion in the air at random", seed=1000 + seed, duration=duration)


@dataclass(frozen=True, eq=False)
class Bench:
    """Turns proposals into trajectories, and those into the signals of the log that they will give.

    Attributes:
        planner: with rig, protocol and the expected law. joints: whether joint torques are read; else the wrench.
        bandwidth: in which the robot follows [Hz].
    """

    planner: Planner
    joints: bool = False
    bandwidth: float = 3.0

    def trajectory(self, proposal: Proposal, rate: float, *, collisions: bool) -> Trajectory:
        """Samples at a rate [Hz] within all limits.

        Raises:
            InputError: what the robot can't do, and the limit that forbids it.
        """
        if not proposal.touches:
            return self._in_the_air(proposal, rate, collisions)
        p = self.planner
        pause = max(p.protocol.pause, proposal.pause)
        protocol = dataclasses.replace(p.protocol, rate=rate, collisions=collisions, pause=pause)
        planner = Planner(p.rig, protocol, p.law, p.limits)
        # robot and reach are the same for all: built once
        planner.__dict__.update(robot=p.robot, reach=p.reach)
        return planner.plan(proposal.touches)

    def experiment(self, proposal: Proposal, motion: Trajectory) -> Experiment:
        """The log's signals; readings zero, because nothing was measured."""
        where, still = Provenance("the plan"), np.zeros_like(motion.q)
        if self.joints:
            log = Log(motion.t, motion.q, motion.dq, motion.ddq, tau=still, phase=motion.phase, provenance=where)
            return from_joint_torques(log, self.planner.rig, robot=self.planner.robot, differentiator=Differentiator())
        reading = np.zeros((len(motion), 6))
        log = Log(motion.t, motion.q, motion.dq, motion.ddq, wrench=reading, phase=motion.phase, provenance=where)
        rig = self.planner.rig if proposal.touches else self.planner.rig.model_copy(update={"surface": None})
        return from_wrench(
            log, rig, bias=(0.0,) * 6, robot=self.planner.robot, trust_wrench=True, differentiator=Differentiator()
        )  # a plan's motion is exact

    @cached_property
    def _design(self) -> Design:
        p = self.planner
        return Design(p.rig, p.robot, p.limits, Model(), {}, p.reach, None, "D", p.protocol.rate)

    @cached_property
    def _posture(self) -> Array:
        """From which turns of the tool begin: above the surface if there is one, else the middle of the joints'
        range.
        """
        p = self.planner
        if p.rig.surface is None or p.rig.surface.mesh is not None:
            return posture(p.limits, np.random.default_rng(0), 0)
        touch = Poke(signal=Multisine(1e-4, (), 0.6), hold=0.0)
        quick = dataclasses.replace(p.protocol, rate=50.0, collisions=False, height=0.1, pause=0.1)
        first: Array = Planner(p.rig, quick, None, p.limits).plan([touch]).q[0]
        return first

    def _in_the_air(self, proposal: Proposal, rate: float, collisions: bool) -> Trajectory:
        p, count = self.planner, self.planner.robot.joint_count
        rng = np.random.default_rng(proposal.seed)
        bounds = Bounds(bandwidth=self.bandwidth, duration=proposal.duration)
        design = dataclasses.replace(self._design, scene=scene_of(p.rig, p.robot) if collisions else None)
        if proposal.wrist is None:
            swing: Swing | None = swing_drawn(posture(p.limits, rng, proposal.seed), bounds, 2, rng)
        else:
            # the last three joints, out of step; as wide as limits allow, which for fast turns is not far
            amplitudes = np.zeros((count, 1))
            amplitudes[-3:] = 1.0
            spread = np.linspace(0.0, 1.0, count)[:, None]
            swing = Swing(
                self._posture,
                amplitudes,
                proposal.wrist * (1.0 + 0.3 * spread),
                np.pi * spread,
                proposal.duration,
                min(1.0, proposal.duration / 4),
            )
        assert swing is not None
        swing = design.fitted(swing)
        if swing is None:
            raise InputError(f"{proposal.title} for which there is no room", "room around the arm", "leave more room")
        t = np.arange(int(np.ceil(swing.duration * rate)) + 1) / rate
        q, dq, ddq, _ = swing(np.minimum(t, swing.duration))
        tip = p.robot.kinematics(p.robot.tip_frame, q).position if p.robot.tip_frame else np.full((len(t), 3), np.nan)
        zero = np.zeros((len(t), 3))
        motion = Trajectory(t, np.full(len(t), "free"), q, dq, ddq, tip, p.robot.joint_names, None, zero, zero[:, 0])
        used = check(motion, p.limits, p.reach.torques(q, dq, ddq, zero), proposal.title)
        if design.scene is not None:
            design.scene.check(q, proposal.title)
        facts = {
            "robot": p.robot.name,
            "asked": {"kind": proposal.name},
            "swing": swing.to_dict(),
            "rate": rate,
            "used": [use.to_dict() for use in used],
        }
        return dataclasses.replace(motion, provenance=facts)


__all__ = ["Bench", "Proposal", "drawn_at_random", "proposals"]
