"""Marks in the samples themselves: what is read off them, and how well it is known."""

from __future__ import annotations

import numpy as np
import pytest

import kinid
from kinid.reports.diagnosis_words import acting


def log_of(force: np.ndarray, t: np.ndarray, depth: np.ndarray) -> kinid.Log:
    """Force over depth, as it was recorded."""
    return kinid.Log(t=t, contact={"depth": depth, "normal_force": force})


def test_hum_of_a_grid_that_is_off_by_a_little_has_true_intervals() -> None:
    """Ten grids within 0.1 Hz of 50: frequency to 2 mHz, size to 2 %, and intervals that hold."""
    t = np.arange(10_000) / 500.0
    depth = -2e-3 + 5e-3 * np.maximum(0.0, np.sin(2 * np.pi * 0.25 * t))
    covered = 0
    for seed in range(10):
        rng = np.random.default_rng(seed)
        size, phase, grid = rng.uniform(0.05, 0.3), rng.uniform(0.0, 2 * np.pi), 50.0 + rng.uniform(-0.1, 0.1)
        force = (
            800.0 * np.maximum(depth, 0.0)
            + size * np.sin(2 * np.pi * grid * t + phase)
            + 0.02 * rng.standard_normal(len(t))
        )
        found = kinid.diagnose(log_of(force, t, depth), kinid.Rig(), model=kinid.Model("hooke"))
        assert found.added == ("mains-hum",)
        hum = next(effect for effect in found.best.effects if effect.id == "mains-hum")
        assert hum.frequency == pytest.approx(grid, abs=2e-3)
        waves = [found.fit.parameters[f"mains-hum.{wave}[normal_force,1]"] for wave in ("sine", "cosine")]
        assert np.hypot(*(p.value for p in waves)) == pytest.approx(size, rel=0.02)
        truth = size * np.cos(phase), size * np.sin(phase)
        covered += sum(p.low <= true <= p.high for p, true in zip(waves, truth))
    assert covered >= 17  # of 20; at 95 % each, fewer are one in a hundred


def test_channels_without_a_mark_are_not_shown() -> None:
    """A range that one channel reached says nothing of the other's."""
    rng = np.random.default_rng(1)
    t = np.arange(8_000) / 400.0
    depth = -1e-3 + 4e-3 * np.maximum(0.0, np.sin(2 * np.pi * 0.3 * t))
    speed = 0.01 * np.sign(np.sin(2 * np.pi * 0.05 * t))
    normal = 800.0 * np.maximum(depth, 0.0)
    log = kinid.Log(
        t=t,
        contact={
            "depth": depth,
            "normal_force": np.minimum(normal + 0.02 * rng.standard_normal(len(t)), 1.9),
            "slip1": np.cumsum(speed) / 400.0,
            "slip2": np.zeros_like(t),
            "tangential_force1": -0.3 * normal * np.sign(speed) + 0.02 * rng.standard_normal(len(t)),
        },
    )
    found = kinid.diagnose(log, kinid.Rig(), model=kinid.Model("hooke", "coulomb-friction"))
    assert "saturation" in found.added
    assert list(acting(found["saturation"].parameters)) == ["limit[normal_force]"]
    assert found["saturation"].parameters["limit[normal_force]"].value == pytest.approx(1.9)


def test_an_end_of_the_range_with_noise_behind_it_is_fitted() -> None:
    """The limit is found, the stiffness is that of the material, and what is left is noise."""
    rng = np.random.default_rng(1)
    t = np.arange(8_000) / 400.0
    depth = -1e-3 + 4e-3 * np.maximum(0.0, np.sin(2 * np.pi * 0.3 * t))
    force = np.minimum(800.0 * np.maximum(depth, 0.0), 1.7) + 0.02 * rng.standard_normal(len(t))
    found = kinid.diagnose(log_of(force, t, depth), kinid.Rig(), model=kinid.Model("hooke"))
    assert found.added == ("saturation",)
    assert found.fit["limit[normal_force]"].value == pytest.approx(1.7, abs=0.005)
    assert found.fit["stiffness"].low < 800.0 < found.fit["stiffness"].high
    assert found.steps[-1].held_out == pytest.approx(0.02, rel=0.05)
