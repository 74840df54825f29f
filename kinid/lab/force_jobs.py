"""What force control is tried on in the laboratory: pushes, slides across borders, and polishing, on the mould."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from kinid.lab.force_loop import Job
from kinid.lab.materials import Material

Array = NDArray[np.float64]

PERIOD = 1e-3
#: how deep the pushes ask for, and the force from which and back to which it is stepped [m, N]
DEPTH, LIGHT = 0.010, 1.0
#: in the middle of each silicone, and on two borders [m]
PLACES = ((-0.025, -0.025), (-0.025, 0.025), (0.025, -0.025), (0.025, 0.025), (0.0, -0.025), (-0.025, 0.0))
#: ends of the slides, each across one border [m]; their force and speed [N, m/s]
SLIDES = (
    ((-0.022, -0.025), (-0.022, 0.025)),
    ((-0.025, 0.022), (0.025, 0.022)),
    ((0.022, 0.025), (0.022, -0.025)),
    ((0.025, -0.022), (-0.025, -0.022)),
)
SLIDE_FORCE, SPEED = 3.0, 0.02
#: of polishing: force [N], a round over all four silicones of a radius [m] and a duration [s], with ten small rounds
POLISH_FORCE, ROUND, ROUND_TIME, SMALL, SMALL_ROUNDS = 5.0, 0.022, 10.0, 0.003, 10
#: until a force is there before a motion begins, and until a motion is at its speed [s]
SETTLE, START = 1.0, 0.3
TASKS = ("pushes of 10 mm", "slides at 3 N", "polishing at 5 N")


def push(material: Material, place: tuple[float, float]) -> Job:
    """A step to the force that a slow press of `DEPTH` takes at a place (2,) [m], and back."""
    t = np.arange(0.0, 3.3, PERIOD)
    x, y = np.full(1, place[0]), np.full(1, place[1])
    force = float(material.press(x, y, np.full(1, DEPTH))[0])
    wanted = np.where((t >= 0.8) & (t < 2.3), force, LIGHT * np.minimum(t / 0.4, 1.0))
    where = np.tile(place, (len(t), 1))
    name = f"push at ({1e3 * place[0]:g}, {1e3 * place[1]:g}) mm"
    return Job(name, where, wanted, np.asarray(t >= 0.8), LIGHT, PERIOD)


def slide(begin: tuple[float, float], end: tuple[float, float]) -> Job:
    """At `SLIDE_FORCE` straight from place to place (2,) [m]."""
    a, b = np.asarray(begin), np.asarray(end)
    length = float(np.hypot(*(b - a)))
    way = _progress(length / SPEED)
    name = "slide from ({:g}, {:g}) to ({:g}, {:g}) mm".format(*(1e3 * v for v in (*begin, *end)))
    return _moving(name, a + way[:, None] * (b - a), SLIDE_FORCE)


def polish() -> Job:
    """At `POLISH_FORCE` once round over all silicones, in small rounds."""
    turn = 2 * np.pi * _progress(ROUND_TIME)
    big, small = (
        ROUND * np.array([np.cos(turn), np.sin(turn)]),
        SMALL * np.array([np.cos(SMALL_ROUNDS * turn), np.sin(SMALL_ROUNDS * turn)]),
    )
    return _moving("polishing", (big + small).T, POLISH_FORCE)


def jobs(material: Material, task: str) -> list[Job]:
    """Of one of `TASKS`."""
    if task == TASKS[0]:
        return [push(material, place) for place in PLACES]
    return [slide(*ends) for ends in SLIDES] if task == TASKS[1] else [polish()]


def _progress(duration: float) -> Array:
    """Share of a way at even times, which begins with a rising speed and goes on steadily, 0…1."""
    t = np.arange(0.0, duration + START / 2, PERIOD)
    way = np.cumsum(np.minimum(t / START, 1.0))
    return np.asarray(way / way[-1], dtype=np.float64)


def _moving(name: str, way: Array, force: float) -> Job:
    rest = round(SETTLE / PERIOD)
    place = np.concatenate([np.tile(way[0], (rest, 1)), way])
    wanted = force * np.minimum(np.arange(len(place)) * PERIOD / 0.4, 1.0)
    return Job(name, place, wanted, np.arange(len(place)) >= rest, 0.0, PERIOD)
