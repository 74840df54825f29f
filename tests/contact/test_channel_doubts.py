"""What `contact` doubts of single channels and readings of the wrench."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable

import numpy as np
import pytest
from contact.doubting import doubts

from kinid.data.log import Log
from kinid.data.rig import Rig
from kinid.robotics.robot import Robot

Change = Callable[[np.ndarray], np.ndarray]


def held(wrench: np.ndarray) -> np.ndarray:
    wrench[5000:7000, 1] = wrench[5000, 1]
    return wrench


def spiked(wrench: np.ndarray) -> np.ndarray:
    wrench[[1200, 6000], 2] += 30.0
    return wrench


def dropped(wrench: np.ndarray) -> np.ndarray:
    wrench[np.random.default_rng(0).random(len(wrench)) < 0.05] = 0.0
    return wrench


def cut(wrench: np.ndarray) -> np.ndarray:
    wrench[:, 2] = np.maximum(wrench[:, 2] - np.quantile(wrench[:, 2], 0.3), 0.0)
    return wrench


def clipped(wrench: np.ndarray) -> np.ndarray:
    wrench[:, 2] = np.clip(wrench[:, 2], *np.quantile(wrench[:, 2], [0.1, 0.9]))
    return wrench


def clipped_above(wrench: np.ndarray) -> np.ndarray:
    wrench[:, 0] = np.minimum(wrench[:, 0], np.quantile(wrench[:, 0], 0.95))
    return wrench


def copied(wrench: np.ndarray) -> np.ndarray:
    wrench[:, 3] = wrench[:, 0]
    return wrench


def flagged(wrench: np.ndarray) -> np.ndarray:
    wrench[:, 0] = wrench[:, 2] > np.median(wrench[:, 2])
    return wrench


@pytest.mark.parametrize(
    ("change", "says"),
    [
        (held, "fy repeats one reading for 4 s from"),
        (spiked, "fz jumps by 30 N and returns at once (2 samples"),
        (dropped, "is exactly 0 in"),
        (cut, "it is cut off at 0"),
        (clipped, "fz is exactly -"),
        (clipped, " samples, and shows noise elsewhere: it is cut off there"),
        (clipped_above, "fx is exactly "),
        (copied, "fx and tx hold the same numbers throughout"),
        (flagged, "fx is 0 or 1 and nothing between"),
    ],
)
def test_a_channel_that_no_sensor_gives(touched: tuple[Log, Rig, Robot], change: Change, says: str) -> None:
    log, rig, robot = touched
    assert says in doubts(dataclasses.replace(log, wrench=change(np.array(log.wrench))), rig, robot)


def test_a_phase_that_is_another_column(touched: tuple[Log, Rig, Robot]) -> None:
    log, rig, robot = touched
    assert log.wrench is not None
    labels = np.array([f"{force:.2f}" for force in log.wrench[:, 2]])
    assert "different labels" in doubts(dataclasses.replace(log, phase=labels), rig, robot)


def test_readings_of_a_coarse_converter_are_no_channel_that_stood_still(touched: tuple[Log, Rig, Robot]) -> None:
    log, rig, robot = touched
    steps = np.array([0.25, 0.25, 0.25, 0.01, 0.01, 0.01])
    said = doubts(dataclasses.replace(log, wrench=np.round(np.asarray(log.wrench) / steps) * steps), rig, robot)
    assert "stood still" not in said
    assert "cut off" not in said
