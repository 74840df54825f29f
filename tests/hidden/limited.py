"""Logs of limited protocols: what each of them can't show, however large it is, and must never be called absent."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

import kinid
from hidden import drive_cases
from hidden.case import Case
from hidden.draw import Stream
from hidden.tester_cases import Tester
from hidden.world.hiding import LINEAR, POWER
from hidden.world.protocol import Protocol, press_once, slide_once, turn_only
from hidden.wrist_cases import Arm

FRICTION = ("viscous-friction", "stribeck-friction", "presliding", "load-dependent-friction", "friction-anisotropy")
NORMAL = (
    "viscous-damping",
    "relaxation",
    "hysteresis",
    "stress-softening",
    "adhesion",
    "stiffening-layer",
    "surface-offset",
    "stiffness-drift",
    "structural-compliance",
)

#: log, rig and model of a stream's draw
Made = tuple[kinid.Log, kinid.Rig, tuple[str, ...]]


@dataclass(frozen=True)
class Limit:
    """A limited protocol: what it can't show, and why."""

    make: Callable[[Stream], Made]
    unseen: tuple[str, ...]
    why: str


def _base(seed: Stream) -> str:
    return str(seed.generator("base").choice(LINEAR + POWER))


def _no_slip(seed: Stream) -> Made:
    bench = Tester.draw(seed, _base(seed), False)
    return bench.log(bench.setup), bench.rig, bench.model


def _pressed_once(seed: Stream) -> Made:
    base = str(seed.generator("base").choice(["hooke", "hertz"]))
    bench = Tester.draw(seed, base, False, act=press_once)
    return bench.log(bench.setup), bench.rig, bench.model


def _slid_once(seed: Stream) -> Made:
    base = str(seed.generator("base").choice(["hooke", "hertz"]))
    bench = Tester.draw(seed, base, True, protocol=Protocol(), act=slide_once)
    return cropped(bench.log(bench.setup), slice(0, -100)), bench.rig, bench.model


def _seldom(seed: Stream) -> Made:
    bench = Tester.draw(seed, _base(seed), True)
    return cropped(bench.log(bench.setup), slice(0, None, 10)), bench.rig, bench.model


def _never_turned(seed: Stream) -> Made:
    bench = Arm.draw(seed, _base(seed), True, protocol=Protocol(turning=False, tilts=False))
    return bench.log(bench.setup), bench.rig, bench.model


def _never_touched(seed: Stream) -> Made:
    bench = Arm.draw(seed, "hooke", True, protocol=Protocol(clear=12e-3), act=turn_only)
    return bench.log(bench.setup), bench.rig, ("none",)


def _never_moved(seed: Stream) -> Made:
    bench = drive_cases.Bench.draw(seed, (), seconds=12.0, still=tuple(range(drive_cases.JOINTS)))
    return bench.log(bench.setup), bench.rig, bench.model


LIMITS: dict[str, tuple[Limit, ...]] = {
    "force-depth": (
        Limit(_no_slip, ("coulomb-friction", *FRICTION, "stiffness-inhomogeneity"), "no slip and no tangential force"),
        Limit(
            _pressed_once,
            ("adhesion", "stress-softening", "coulomb-friction", *FRICTION, "stiffness-inhomogeneity"),
            "one slow press that is not taken back, without slip",
        ),
        Limit(
            _slid_once,
            ("friction-anisotropy", "load-dependent-friction", "adhesion", "stress-softening"),
            "one stroke in one direction at one load, that is not taken back",
        ),
        Limit(_seldom, ("mains-hum",), "50 samples a second"),
    ),
    "wrench": (
        Limit(_never_turned, ("tool-inertia",), "a tool that never turns"),
        Limit(
            _never_touched,
            (*NORMAL, "coulomb-friction", *FRICTION, "stiffness-inhomogeneity", "tip-offset"),
            "no contact",
        ),
    ),
    "joints": (
        Limit(
            _never_moved,
            (
                "joint-viscous-friction",
                "joint-friction-asymmetry",
                "rotor-inertia",
                "joint-elasticity",
                "time-offset",
                "sensor-lag",
            ),
            "joints at rest",
        ),
    ),
}


def make(world: str, number: int, seed: int) -> Case:
    """The limited log of this number; `truth` names what it can't show."""
    limit = LIMITS[world][number % len(LIMITS[world])]
    stream = Stream(seed, world, "not-excited", number)
    log, rig, model = limit.make(stream)
    name = f"not-excited/{world}/{limit.why.replace(' ', '-')}/{number}"
    return Case(name, "not-excited", log, rig, model, frozenset(limit.unseen), model, stream.number, limit.why)


def cropped(log: kinid.Log, rows: slice) -> kinid.Log:
    """Some rows of a log."""
    parts = {
        name: None if (values := getattr(log, name)) is None else np.array(values[rows])
        for name in ("t", "q", "tau", "wrench", "phase")
    }
    contact = {name: np.array(values[rows]) for name, values in log.contact.items()}
    return dataclasses.replace(log, **parts, contact=contact)
