"""Figures of pooled fits and diagnoses over many draws: coverage, spread against logs, weak effects, odd logs."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass

import numpy as np
from campaign.testers import NOISE, RATE, SPAN, poked, swing
from numpy.typing import NDArray
from scripted import RIG, scripted_poke

import kinid

Array = NDArray[np.float64]

#: of a power law: stiffness [N/mⁿ], damping [N·s/mⁿ⁺¹], exponent
TRUTH = {"stiffness": 6000.0, "damping": 4e4, "exponent": 1.3}
#: noise of a force [N] behind which a weak effect hides in a single log
LOUD = 0.05
HUNT_CROSSLEY = kinid.Model("hunt-crossley", "sensor-bias")
SPRING_AND_FRICTION = kinid.Model("kelvin-voigt", "coulomb-friction", "sensor-bias")
KELVIN_VOIGT = kinid.Model("kelvin-voigt", "sensor-bias")


@dataclass(frozen=True)
class Draws:
    """Estimates and whether their 95 % intervals hold the truth, each (draws, parameters)."""

    estimates: Array
    covered: NDArray[np.bool_]

    @property
    def spread(self) -> Array:
        """Standard deviation of the estimates over draws, (parameters,)."""
        return self.estimates.std(axis=0, ddof=1)


def power_law(seed: int) -> kinid.Log:
    """A log of a Hunt-Crossley material: its zero, where its surface is and its clock are off as calibration leaves
    them, each by one standard deviation of 0.05 N, 30 µm and 0.25 ms.
    """
    rng = np.random.default_rng([seed, 7])
    bias, offset, late = np.array([0.05, 3e-5, 2.5e-4]) * rng.standard_normal(3)
    t = np.arange(int(SPAN * RATE)) / RATE
    depth, rate = swing(seed, t)
    true, speed = swing(seed, t - late)
    power = np.maximum(true + offset, 0.0) ** TRUTH["exponent"]
    force = np.maximum(power * (TRUTH["stiffness"] + TRUTH["damping"] * speed), 0.0)
    force += bias + NOISE * rng.standard_normal(len(t))
    return kinid.Log(t=t, contact={"depth": depth, "depth_rate": rate, "normal_force": force})


def recovered(draws: int, logs: int, seed: int = 0) -> Draws:
    """Pooled fits of so many campaigns of so many logs."""
    estimates, covered = [], []
    for draw in range(draws):
        first = 10_000 * (seed + draw)
        fit = kinid.Campaign([power_law(first + i) for i in range(logs)]).fit(HUNT_CROSSLEY)
        found = [fit[name] for name in TRUTH]
        estimates.append([p.value for p in found])
        covered.append([p.low <= truth <= p.high for p, truth in zip(found, TRUTH.values())])
    return Draws(np.array(estimates), np.array(covered))


def found_effects(draws: int, logs: int, stiffening: float, seed: int = 0) -> list[tuple[str, ...]]:
    """What diagnoses of so many campaigns add, where springs stiffen so much [N/m²].

    The sensor is loud enough that a log is too short for what changes readings by more than a sensor's linearity.
    """
    out = []
    for draw in range(draws):
        first = 10_000 * (seed + draw) + 5000
        some = [poked(first + i, stiffening=stiffening, noise=LOUD) for i in range(logs)]
        out.append(kinid.Campaign(some).diagnose(KELVIN_VOIGT, max_effects=1).added)
    return out


def named(draws: int, logs: int, kind: str, seed: int = 0) -> list[list[str]]:
    """Which logs are called odd in so many campaigns whose last log is of another kind."""
    out = []
    for draw in range(draws):
        first = 10_000 * (seed + draw) + 7000
        odd = {
            "tool": {"stiffness": 900.0, "damping": 9.0},
            "surface": {"offset": 3e-4},
            "sensor": {"gain": 1.08, "noise": 1.5 * NOISE},
            "none": {},
        }[kind]
        some = [poked(first + i) for i in range(logs - 1)]
        out.append(list(kinid.Campaign([*some, poked(first + logs, **odd)]).fit(KELVIN_VOIGT).odd))
    return out


def swapped(draws: int, logs: int, kind: str, seed: int = 0) -> list[list[str]]:
    """Which logs of an arm are called odd in so many campaigns whose last one was recorded with another wrist sensor.

    Args:
        kind: "calibration": readings of it through the matrix of the one before it, each element off by 3 % of its
            channel's range; "turned": it was mounted a quarter turn away from the rig's; "none": the same sensor.
    """
    rig, out = kinid.Rig.parse_text(RIG), []
    assert rig.sensor.range is not None
    ranges = np.array(rig.sensor.range)
    for draw in range(draws):
        rng, some = np.random.default_rng([seed, draw, 11]), []
        for number in range(1, logs + 1):
            scripted = scripted_poke(seed=10_000 * (seed + draw) + 9000 + number)
            log = scripted.log
            assert log.wrench is not None
            if number == logs and kind == "turned":
                log = dataclasses.replace(log, wrench=log.wrench[:, [1, 0, 2, 4, 3, 5]] * [1, -1, 1, 1, -1, 1])
            if number == logs and kind == "calibration":
                matrix = np.eye(6) + 0.03 * rng.standard_normal((6, 6)) * np.outer(ranges, 1.0 / ranges)
                log = dataclasses.replace(log, wrench=log.wrench @ matrix.T)
            some.append(log)
        out.append(list(kinid.Campaign(some, rig=rig).fit(SPRING_AND_FRICTION).odd))
    return out
