"""What is doubted of a log and its rig, and either of them changed."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable

import numpy as np

from kinid.contact.analysis import analyse
from kinid.data.log import Log
from kinid.data.rig import Rig
from kinid.robotics.robot import Robot


def doubts(log: Log, rig: Rig, robot: Robot, **options: object) -> str:
    return " | ".join(analyse(log, rig, robot=robot, trust_wrench=True, **options).provenance.warnings)  # type: ignore[arg-type]


def changed(rig: Rig, **tables: dict[str, object]) -> Rig:
    whole = rig.model_dump(exclude_none=True)
    for name, fields in tables.items():
        whole[name] = {**whole[name], **fields}
    return Rig.parse({k: v for k, v in whole.items() if k != "folder"}, folder=rig.folder)


def with_joints(log: Log, change: Callable[[np.ndarray], np.ndarray]) -> Log:
    return dataclasses.replace(log, q=change(np.array(log.q)))


def only(j: int, factor: float) -> np.ndarray:
    return np.where(np.arange(7) == j - 1, factor, 1.0)
