"""What a model is held against: long logs in means, none of their samples lost."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.signal import butter, sosfiltfilt

import kinid
from kinid.identification.dataset import MAX_DENSE, MAX_SAMPLES, averaged
from kinid.identification.error_model import reading_variance
from kinid.identification.problem import MANY_MEANS, MEAN_RATE, Problem
from kinid.modeling.experiment import Experiment
from kinid.modeling.readings import all_channels

Array = NDArray[np.float64]

MODEL = kinid.Model("kelvin-voigt")


def _long(seconds: float, rate: float, channels: int = 1) -> Experiment:
    t = np.arange(round(seconds * rate)) / rate
    depth = 4e-3 * np.sin(1.3 * t)
    noise = 0.02 * np.random.default_rng(3).standard_normal((3, len(t)))
    contact = {"depth": depth, "normal_force": np.where(depth > 0, 900.0 * depth, 0.0) + noise[0]}
    for i in range(1, channels):
        contact |= {f"slip{i}": 1e-3 * np.sin(t), f"tangential_force{i}": noise[i]}
    return all_channels(kinid.Log(t=t, contact=contact), kinid.Rig(), MODEL)


@pytest.mark.parametrize(
    ("seconds", "rate", "channels", "many"),
    [
        (20.0, 500.0, 3, 1),
        (80.0, 200.0, 3, 1),
        (60.0, 500.0, 1, 3),
        (60.0, 500.0, 3, 3),
        (60.0, 1000.0, 3, 6),
        (120.0, 500.0, 3, 3),
        (200.0, 250.0, 1, 2),
        (300.0, 1000.0, 1, 8),
    ],
)
def test_long_logs_are_followed_in_means(seconds: float, rate: float, channels: int, many: int) -> None:
    whole = _long(seconds, rate, channels)
    assert len(whole.measured) == channels
    short, _ = averaged(whole)
    assert len(short.signals) == -(-len(whole.signals) // many)
    assert len(short.signals) <= MAX_SAMPLES
    needed = -(-len(whole.signals) // MAX_SAMPLES)
    assert len(short.signals) <= MAX_DENSE or rate / many >= 0.9 * 160.0 or many <= max(1, needed)
    kept = len(whole.signals) // many * many
    mean = whole.measured[0, :kept].reshape(-1, many).mean(axis=1)
    np.testing.assert_allclose(short.measured[0, : len(mean)], mean, rtol=0, atol=1e-12)
    np.testing.assert_allclose(short.noise, whole.noise / np.sqrt(many))


@pytest.mark.parametrize(("seconds", "channels"), [(20.0, 3), (60.0, 1), (70.0, 3), (100.0, 3)])
def test_of_many_readings_fewer_means_are_compared(seconds: float, channels: int) -> None:
    """Means are the faster the fewer there are, and none is lost: each sample is in one of them."""
    problem = Problem.build(_long(seconds, 500.0, channels))
    rate = problem.shape[1] / seconds
    if channels * seconds * MEAN_RATE < MANY_MEANS:
        assert MEAN_RATE / 1.5 <= rate < 1.5 * MEAN_RATE  # the nearest that a whole number of samples makes
    else:
        assert 0.5 * MEAN_RATE / 1.5 <= rate < MEAN_RATE
    assert problem.count.sum() == len(problem.experiment.signals)


def test_readings_below_a_frequency() -> None:
    """The band against scipy's own filter, and a channel that holds nothing stays so."""
    experiment = dataclasses.replace(_long(20.0, 500.0), band=25.0)
    readings = np.random.default_rng(1).standard_normal((3, len(experiment.signals)))
    readings[1] = 0.0
    found = experiment.in_band(readings)
    wanted = sosfiltfilt(butter(4, 25.0, output="sos", fs=500.0), readings, axis=1)
    np.testing.assert_allclose(found, wanted, rtol=0, atol=1e-12)
    assert not found[1].any()


def test_no_mean_tells_itself_how_much_it_counts() -> None:
    """Near the end of a retraction a reading that is up counts as one that is down: else all laws lie high."""
    t = np.arange(1600) / 100.0
    depth = 1e-3 * np.sin(t)
    force = 900.0 * np.maximum(depth, 0.0) + 0.02 * np.random.default_rng(4).standard_normal(len(t))

    def variance(change: float, at: int = 0) -> Array:
        read = force + change * (np.arange(len(t)) == at)
        contact = {"depth": depth, "normal_force": read}
        problem = Problem.build(all_channels(kinid.Log(t=t, contact=contact), kinid.Rig(), MODEL))
        assert problem.shape[1] == len(t)
        return reading_variance(problem)[0]

    usual = variance(0.0)
    falling = np.flatnonzero((depth > 0) & (np.gradient(depth) < 0) & (depth < 1e-4))
    open_ = falling[usual[falling] > 10.0 * np.median(usual)]
    assert len(open_) > 3
    for at in open_[:4]:
        moved = variance(0.2, int(at))
        assert moved[at] == pytest.approx(usual[at], rel=0.05)
        assert moved[at - 1] < 0.1 * usual[at] or moved[at + 1] < 0.1 * usual[at]
