"""Borders of a map: where the slides that it was made of cross from one material to another."""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from kinid.contact.series import contact_series
from kinid.data.rig import Rig
from kinid.errors import InputError
from kinid.mapping.changes import Change, find_changes
from kinid.mapping.property_map import PropertyMap
from kinid.robotics.reading import read
from kinid.robotics.robot import Robot

Array = NDArray[np.float64]


class SlideBorder(NamedTuple):
    """A border, and the log whose slide crossed it."""

    log: str
    change: Change

    def to_dict(self) -> dict[str, object]:
        """Its facts, as JSON has them."""
        return {"log": self.log, **self.change.to_dict()}


def slide_logs(grown: PropertyMap) -> list[Path]:
    """Logs of slides that were cut into probes of the map, those that are still there."""
    cut = dict.fromkeys(
        name.partition("#")[0] for name in (probe.source for probe in grown.probes) if "piece" in name.partition("#")[2]
    )
    return [path for path in map(Path, cut) if path.is_file()]


def slide_borders(grown: PropertyMap, rig: Rig) -> list[SlideBorder]:
    """Borders that the slides of a map crossed, log by log; those of both ways are there twice.

    Args:
        grown: with pieces of slides among its probes; without, nothing is found. rig: what they were measured with.
    """
    out: list[SlideBorder] = []
    paths = slide_logs(grown)
    robot = Robot.load(rig) if paths else None
    for path in paths:
        try:
            found = find_changes(contact_series(read(path, rig, robot=robot), rig, robot=robot))
        except InputError:  # no straight way, or a log that has changed: its probes are in the map, a border isn't
            continue
        out += [SlideBorder(str(path), change) for change in found]
    return out


def across(change: Change, half: float) -> Array:
    """Ends of the stroke that a border is drawn as, across the slip, along both tangents [m], (2, 2)."""
    side = np.array([-change.ahead[1], change.ahead[0]])
    return np.stack([change.place - half * side, change.place + half * side])
