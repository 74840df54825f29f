"""Pokes of a campaign that end when they have said enough: what it has learnt so far, and how long it took."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from kinid.contact.early_stop import EVERY, EarlyStop
from kinid.data.log import Log
from kinid.data.rig import Rig
from kinid.errors import InputError
from kinid.estimators.kelvin_voigt import NAMES
from kinid.estimators.warm_start import WarmStart
from kinid.lab.loop_experiment import Motion
from kinid.lab.places import Grid
from kinid.lab.protocol import Script
from kinid.lab.setup import LOG_EVERY, Result, Setup
from kinid.mapping.property_map import Probe, Property, PropertyMap
from kinid.mapping.warm_start import Expectation, Neighbourhood
from kinid.planning.protocol import Protocol
from kinid.planning.setpoint_timing import change
from kinid.robotics.reading import read
from kinid.robotics.robot import Robot
from kinid.robotics.surface import Plane
from kinid.robotics.surface import load as load_surface

Array = NDArray[np.float64]
T = TypeVar("T", Script, Motion)

#: control periods until a decision is in the set-points
REACTION = 2


class Learning:
    """What a campaign knows of its surface while it goes on: a map of recursive estimates.

    What is known at a place follows from the logs of the places before it alone, so that a campaign that was stopped
    goes on with what it had learnt.

    Args:
        grid: of the campaign. rig: with a plane. precision: see `EarlyStop`.
        expectation: where pokes start from; None: each from nothing.
    """

    def __init__(self, grid: Grid, rig: Rig, precision: float, expectation: Expectation | None) -> None:
        plane = load_surface(rig)
        assert isinstance(plane, Plane)  # the laboratory's
        self._grid, self._rig, self._robot, self._plane = grid, rig, Robot.load(rig), plane
        self._precision, self._near = precision, None if expectation is None else Neighbourhood(expectation)
        kinds = tuple(Property(name, unit) for name, unit in zip(NAMES, ("N/m", "N·s/m")))
        self.map = PropertyMap(plane, kinds, (), "kelvin-voigt")

    def begin(self, index: int) -> EarlyStop:
        """What follows the poke at a place."""
        start = WarmStart() if self._near is None else self._near.at(self.map, self._place(index), NAMES)
        return EarlyStop(self._rig, self._precision, start, robot=self._robot)

    def add(self, index: int, poke: EarlyStop) -> None:
        """Keep what a poke showed."""
        if poke.learnt is None or poke.alone is None or poke.own is None:
            return
        if poke.enough and self._near is not None:
            self._near.learn(self.map, self._place(index), NAMES, poke.alone)
        learnt, name = poke.learnt, self._grid.name(index)
        probe = Probe(self._place(index), learnt.values, learnt.covariance, poke.own.noise, poke.noise, name)
        try:
            self.map = self.map.added(probe)
        except InputError:  # an estimate that is none, as a stiffness that is surely negative
            return

    def recall(self, index: int, path: Path) -> None:
        """The same of a log that is there already."""
        poke = self.begin(index)
        follow(read(path, self._rig, robot=self._robot), poke)
        self.add(index, poke)

    def _place(self, index: int) -> Array:
        out: Array = self._plane.point + np.array(self._grid.place(index)) @ self._plane.axes[:2]
        return out


def follow(log: Log, poke: EarlyStop) -> int | None:
    """Feed a log as it comes, up to its retraction; the row at which the poke may end, None where it may not."""
    assert log.q is not None
    assert log.wrench is not None
    assert log.phase is not None
    end = int(np.flatnonzero(log.phase == "retract")[0])
    for first in range(0, end - EVERY + 1, EVERY):
        rows = slice(first, first + EVERY)
        if poke.feed(log.t[rows], log.q[rows], log.wrench[rows]):
            return rows.stop - 1
    return None


def carry_out(setup: Setup, poke: EarlyStop) -> Result:
    """A poke that is ended when it has said enough.

    The run is made once as if it weren't; where it is, once more with the tip retracting from there on. Until then
    nothing differs, because the seed alone decides.

    Args:
        setup: of one poke. poke: follows it.

    Raises:
        InputError: see `Setup.check`.
    """
    whole = setup.run()
    row = follow(whole.log, poke)
    if row is None:
        return whole
    ended, count = setup.script.ended(LOG_EVERY * row + REACTION)
    return _first(setup.replace(script=ended).run(), count)


def _first(result: Result, count: int) -> Result:
    """The first control periods of a run."""
    script, motion = _rows(result.setup.script, count), _rows(result.motion, count)
    rows = {name: getattr(result, name)[:count] for name in ("clean", "wrench", "q", "tau")}
    return Result(result.setup.replace(script=script), motion, **rows)


def _rows(table: T, count: int) -> T:
    """The first rows of what holds arrays alone."""
    return type(table)(*(getattr(table, column.name)[:count] for column in dataclasses.fields(table)))


def robot_seconds(grid: Grid, folder: Path) -> float:
    """Time of the robot for the pokes of a campaign that are there [s]: logs, and the ways between their places.

    The ways are straight, at the pace that `kinid plan` has in the air.
    """
    import pyarrow.parquet as pq

    total, before, pace = 0.0, None, Protocol().travel
    for index in range(grid.count):
        path = folder / f"{grid.name(index)}.parquet"
        if not path.is_file():
            continue
        t = pq.read_table(path, columns=["t"])["t"].to_numpy()
        total += float(t[-1] - t[0])
        here = np.array(grid.place(index))
        if before is not None:
            total += change(0.0, float(np.linalg.norm(here - before)), pace).duration
        before = here
    return total
