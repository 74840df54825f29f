"""Marks in samples: flat tops, lattices and lines, found where they are and nowhere else.

All loads are formulas of the test's own.
"""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from numpy.typing import NDArray

from kinid.diagnosis.detectors import detect
from kinid.effects import AsRead, Detection, Layout, Samples, Signals, catalogue, get
from kinid.modeling.experiment import Experiment

Array = NDArray[np.float64]

PERIOD = 4e-3
T: Array = PERIOD * np.arange(10_000.0)
DETECTORS = ("saturation", "quantization", "mains-hum")
#: sizes of a load, channel by channel, and units that its noise is counted in
WRENCH, JOINTS = ("fx", "fy", "fz", "tx", "ty", "tz"), ("tau1", "tau2")


def load_of(kind: str) -> tuple[Array, Array, Layout]:
    """Loads (channels, n), the columns of a model that holds each, (channels, columns, n), and the layout."""
    poke = np.maximum(0.0, np.sin(1.5 * T)) * (1.0 + 0.3 * np.sin(0.4 * T))
    if kind == "contact":
        return 6.0 * poke[None], poke[None, None], Layout(("normal_force",), "contact")
    swing = np.sin(0.9 * T) + 0.4 * np.sin(2.3 * T + 1.0)
    rate, accelerated = np.gradient(swing, T), np.gradient(np.gradient(swing, T), T)
    if kind == "joints":
        columns = np.array([[np.sin(swing), rate, accelerated]] * 2)
        return np.array([[9.0, 2.0, 3.0], [2.0, 0.4, 0.2]]) @ columns[0], columns, Layout(JOINTS, "joints")
    ones = np.ones_like(T)
    columns = np.array([[swing, poke, ones]] * 6)
    size = np.array(
        [[3.0, 1.0, 0.5], [2.0, 0.5, -1.0], [1.0, -9.0, 2.0], [0.1, 0.02, 0.0], [0.05, 0.2, 0.0], [0.03, 0.0, 0.01]]
    )
    return size @ columns[0], columns, Layout(WRENCH, "wrench")


def samples(raw: Array, columns: Array, layout: Layout) -> Samples:
    """As a diagnosis shows them: the model is fitted to the readings as they are."""
    expected = np.array([c.T @ np.linalg.lstsq(c.T, x, rcond=None)[0] for c, x in zip(columns, raw)])
    shown = Samples(
        raw, expected, np.ones(len(raw)), np.ones(raw.shape[1], np.bool_), T[: raw.shape[1]], PERIOD, layout
    )
    return dataclasses.replace(shown, noise=shown.white(raw))


def noise_of(load: Array, seed: int = 0) -> tuple[Array, Array]:
    """White noise, and its standard deviation in each channel: 0.3 % of the load's size."""
    sigma = 0.003 * np.abs(load).max(axis=1)
    return sigma[:, None] * np.random.default_rng(seed).standard_normal(load.shape), sigma


def found_in(shown: Samples) -> dict[str, Detection]:
    """What each detector finds in the samples as they are."""
    every = {name: get(name).detect(shown) for name in DETECTORS}
    return {name: found for name, found in every.items() if found is not None}


def test_detectors_are_those_of_the_catalogue() -> None:
    """In the order in which they look."""
    kinds = sorted((kind for kind in catalogue().values() if kind.detector), key=lambda kind: kind.detection_order)
    assert tuple(kind.id for kind in kinds if kind.id in DETECTORS) == DETECTORS
    assert get("hooke").detect(samples(*load_of("contact"))) is None
    assert get("hooke").unseen(10.0) == ""
    assert get("quantization").unseen(10.0) == ""
    assert "125" not in get("mains-hum").unseen(200.0)
    assert "100 Hz" in get("mains-hum").unseen(100.0)
    assert "not reached" in get("saturation").unseen(1000.0)


@pytest.mark.parametrize("kind", ["contact", "wrench", "joints"])
@pytest.mark.parametrize("noise", [0.0, 1.0, 4.0])
def test_nothing_is_found_in_clean_logs(kind: str, noise: float) -> None:
    """Also by a model that expects a third more, or too little."""
    load, columns, layout = load_of(kind)
    shown = samples(load + noise * noise_of(load)[0], columns, layout)
    assert shown.expected is not None
    for factor in (1.0, 1.3, 0.7):
        assert not found_in(dataclasses.replace(shown, expected=factor * shown.expected)), factor


@pytest.mark.parametrize(
    ("kind", "channel"), [("contact", 0), ("wrench", 2), ("wrench", 4), ("joints", 0), ("joints", 1)]
)
@pytest.mark.parametrize("share", [0.6, 0.8])
def test_flat_tops_are_read_off(kind: str, channel: int, share: float) -> None:
    """Noise before the end of the range: the limit is exact, on the channel that has it alone."""
    load, columns, layout = load_of(kind)
    raw = load + noise_of(load)[0]
    limit = share * np.abs(load[channel]).max()
    raw[channel] = np.clip(raw[channel], -limit, limit)
    found = found_in(samples(raw, columns, layout))
    assert list(found) == ["saturation"]
    expected = np.full(len(raw), 1e12)
    expected[channel] = limit
    np.testing.assert_allclose(found["saturation"].values, expected, rtol=1e-12)
    at = np.abs(raw[channel]) == limit
    keep = found["saturation"].keep
    assert keep is not None
    assert not keep[at].any()
    assert not keep[1:][at[:-1]].any()
    assert keep.sum() > 0.98 * (~at).sum()


@pytest.mark.parametrize(
    ("kind", "channel"), [("contact", 0), ("wrench", 2), ("wrench", 4), ("joints", 0), ("joints", 1)]
)
@pytest.mark.parametrize("share", [0.6, 0.8])
@pytest.mark.parametrize("noise", [1.0, 2.0, 4.0])
def test_an_end_of_the_range_with_noise_behind_it(kind: str, channel: int, share: float, noise: float) -> None:
    """Readings pile up about the limit where the model goes on: it is known to half the noise, and they count no
    longer.
    """
    load, columns, layout = load_of(kind)
    white, sigma = noise_of(load)
    limit = share * np.abs(load[channel]).max()
    raw = load.copy()
    raw[channel] = np.clip(load[channel], -limit, limit)
    found = found_in(samples(raw + noise * white, columns, layout))
    assert list(found) == ["saturation"]
    values, keep = found["saturation"].values, found["saturation"].keep
    assert values[channel] == pytest.approx(limit, abs=0.5 * noise * sigma[channel])
    assert (np.delete(values, channel) == 1e12).all()
    assert keep is not None
    assert not keep[np.abs(load[channel]) > limit].any()
    assert keep.mean() > 0.15


def test_holds_are_no_end_of_a_range() -> None:
    """A load that rests at one depth by a jerk piles up alike; the model expects it to rest, even one that expects too
    much.
    """
    phase = T % 8.0
    ramp = np.clip(phase, 0, 1) - np.clip(phase - 4.0, 0, 1)
    rng = np.random.default_rng(0)
    for way in (ramp, ramp**3 * (10 - 15 * ramp + 6 * ramp**2)):
        raw = (5.0 * way + 0.01 * rng.standard_normal(len(T)))[None]
        seen = (way + 1e-3 * rng.standard_normal(len(T)))[None]
        shown = samples(raw, seen[:, None], Layout(("normal_force",), "contact"))
        for factor in (1.0, 1.05, 1.5):
            assert not found_in(dataclasses.replace(shown, expected=factor * 5.0 * seen))


def test_a_controlled_force_is_no_end_of_a_range() -> None:
    """It rests while the depth goes on over a material that isn't alike everywhere: a model errs both ways."""
    rng = np.random.default_rng(0)
    on = np.clip(5.0 * np.sin(0.3 * T), 0.0, 1.0)
    raw = (5.0 * on + 0.01 * rng.standard_normal(len(T)))[None]
    depth = on * (1.0 + 0.2 * np.sin(1.1 * T))
    assert not found_in(samples(raw, depth[None, None], Layout(("normal_force",), "contact")))


@pytest.mark.parametrize("viscous", [0.0, 0.3, 1.0])
def test_dry_friction_is_no_end_of_a_range(viscous: float) -> None:
    """It stays at a level from the slowest motion on, which a model without it expects to rise."""
    speed = np.sin(1.2 * T)
    raw = (5.0 * np.tanh(speed / 0.01) + viscous * speed + 0.02 * np.random.default_rng(0).standard_normal(len(T)))[
        None
    ]
    assert not found_in(samples(raw, speed[None, None], Layout(("tau1",), "joints")))


@pytest.mark.parametrize(
    ("kind", "channel"), [("contact", 0), ("wrench", 0), ("wrench", 5), ("joints", 0), ("joints", 1)]
)
@pytest.mark.parametrize("steps", [2.0, 5.0, 20.0])
def test_a_coarse_lattice(kind: str, channel: int, steps: float) -> None:
    """Steps of more than the noise, of one channel; no flat top is made of its highest value."""
    load, columns, layout = load_of(kind)
    white, sigma = noise_of(load)
    raw, step = load + white, steps * sigma[channel]
    raw[channel] = step * np.round(raw[channel] / step)
    shown = samples(raw, columns, layout)
    found = found_in(shown)
    assert list(found) == ["quantization"]
    expected = np.zeros(len(raw))
    expected[channel] = step
    np.testing.assert_allclose(found["quantization"].values, expected, rtol=1e-6)
    noise = found["quantization"].noise
    assert noise is not None
    assert noise[channel] > 0.99 * step / np.sqrt(12.0)


def test_the_lattice_of_every_converter_is_fine() -> None:
    """Steps well below the noise cost nothing."""
    load, columns, layout = load_of("joints")
    white, sigma = noise_of(load)
    step = 0.5 * sigma[:, None]
    assert not found_in(samples(step * np.round((load + white) / step), columns, layout))


@pytest.mark.parametrize("steps", [0.2, 2.0, 5.0])
def test_an_end_of_the_range_off_a_lattice(steps: float) -> None:
    """Both marks in one channel are told apart, wherever the range ends."""
    load, columns, layout = load_of("joints")
    white, sigma = noise_of(load)
    raw, step, limit = load + white, steps * sigma[0], 0.6 * np.abs(load[0]).max() + 0.37 * steps * sigma[0]
    raw[0] = np.clip(step * np.round(raw[0] / step), -limit, limit)
    found = found_in(samples(raw, columns, layout))
    assert found["saturation"].values[0] == pytest.approx(limit, rel=1e-12)
    assert ("quantization" in found) == (steps > 1.0)
    if steps > 1.0:
        assert found["quantization"].values[0] == pytest.approx(step, rel=1e-6)


@pytest.mark.parametrize("steps", [0.5, 0.7])
def test_noise_wider_than_a_step_does_not_stop_at_one_reading_by_chance(steps: float) -> None:
    """On a lattice finer than the noise a flat top is one, whatever the model expects; a load that rests has none."""
    load, _, layout = load_of("contact")
    white, sigma = noise_of(load)
    step = steps * float(sigma[0])
    limit = step * round(0.7 * load.max() / step)
    clipped = step * np.round(np.clip(load + white, -limit, limit) / step)
    shown = samples(clipped, np.minimum(load, limit)[None], layout)  # nothing goes on beyond
    assert found_in(shown)["saturation"].values[0] == pytest.approx(limit, rel=1e-12)
    resting = step * np.round((np.minimum(load, limit) + white) / step)
    assert not found_in(samples(resting, np.minimum(load, limit)[None], layout))


def test_repeated_readings_are_no_flat_top() -> None:
    """A slow sensor in a fast log: each reading stands for eight samples, the largest one too."""
    load, columns, layout = load_of("joints")
    raw = (load + noise_of(load)[0])[:, np.arange(len(T)) // 8 * 8]
    assert not found_in(samples(raw, columns, layout))


@pytest.mark.parametrize("kind", ["contact", "wrench", "joints"])
def test_a_line_with_harmonics(kind: str) -> None:
    """Frequency to 2 mHz, amplitudes to 5 %, and what is taken off is the line."""
    t: Array = 2e-3 * np.arange(float(len(T)))
    load, columns, layout = load_of(kind)
    white, sigma = noise_of(load)
    size = 3.0 * sigma[:, None]
    hum = size * (np.sin(2 * np.pi * 49.97 * t + 0.3) + 0.3 * np.sin(2 * np.pi * 3 * 49.97 * t))
    shown = samples(load + white + hum, columns, layout)
    found = get("mains-hum").detect(dataclasses.replace(shown, t=t, period=2e-3))
    assert found is not None
    assert found.form["frequency"] == pytest.approx(49.97, abs=2e-3)
    assert found.form["harmonics"] == (1, 3)
    pairs = found.values.reshape(len(load), 2, 2)
    np.testing.assert_allclose(np.hypot(pairs[..., 0], pairs[..., 1]), size * [1.0, 0.3], rtol=0.05, atol=0.0)
    assert found.removed is not None
    inner = slice(500, -500)
    assert (np.std((found.removed - hum)[:, inner], axis=1) < 0.2 * sigma).all()
    assert found.noise is not None
    assert (found.noise < 1.1 * sigma).all()


# ---- in an experiment -----------------------------------------------------------------------------------------------


def experiment(raw: Array, layout: Layout, t: Array = T, as_read: AsRead | None = None) -> Experiment:
    """Readings alone, without the faults that are stated."""
    n = len(t)
    none, pair = np.zeros(n), np.zeros((2, n))
    measured = raw if as_read is None else as_read.true(raw)
    signals = Signals(layout, t, np.diff(t, prepend=t[0]), none, none, pair, pair, measured=measured, as_read=as_read)
    noise = Samples(measured, None, np.ones(len(raw)), np.ones(n, np.bool_), t, t[1], layout).white(measured)
    return Experiment(signals, measured, np.ones(n, np.bool_), noise, None, np.zeros(n, np.bool_), np.arange(n))


def test_marks_of_a_sensor_with_stated_faults() -> None:
    """Converters act on raw readings: limits, steps and lines are found there, and predictions get them there."""
    t: Array = 2e-3 * np.arange(float(len(T)))
    rng = np.random.default_rng(0)
    inverse = np.eye(6) + 0.05 * rng.standard_normal((6, 6)) * np.outer(
        [1, 1, 1, 0.05, 0.05, 0.05], [1, 1, 1, 20, 20, 20]
    )
    as_read = AsRead.stated(inverse, np.array([2.0, -1.0, 3.0, 0.1, 0.0, 0.2]))
    assert as_read is not None
    load, _, layout = load_of("wrench")
    white, sigma = noise_of(load)
    hum = 3.0 * sigma[:, None] * np.sin(2 * np.pi * 50.02 * t)
    raw = as_read.raw(load) + white + hum * (np.arange(6) == 0)[:, None]
    limit = 0.7 * np.abs(raw[2]).max()
    raw[2] = np.clip(raw[2], -limit, limit)
    raw[5] = 6.0 * sigma[5] * np.round(raw[5] / (6.0 * sigma[5]))
    whole = experiment(raw, layout, t, as_read)
    cleaned = detect(whole, (), load)
    assert tuple(mark.effect.id for mark in cleaned.marks) == DETECTORS
    clip, steps, line = cleaned.marks
    assert clip.values[2] == pytest.approx(limit, rel=1e-9)
    np.testing.assert_allclose(steps.values, 6.0 * sigma * (np.arange(6) == 5), rtol=1e-6)
    assert getattr(line.effect, "frequency") == pytest.approx(50.02, abs=2e-3)  # noqa: B009
    assert not cleaned.experiment.valid[np.abs(raw[2]) == limit].any()
    predicted = clip.apply(load, whole)
    assert np.abs(as_read.raw(predicted)[2]).max() == pytest.approx(limit, rel=1e-9)
    np.testing.assert_allclose(
        steps.apply(load, whole), load, atol=1e-12
    )  # rounding moves a reading up as often as down
    added = as_read.raw(line.apply(load, whole)) - as_read.raw(load)
    inner = slice(500, -500)
    assert np.std((added - hum)[0, inner]) < 0.4 * sigma[0]
    np.testing.assert_allclose(cleaned.experiment.measured, as_read.true(raw - added), atol=1e-9)


def test_a_model_that_has_the_effect_is_not_told_of_it() -> None:
    load, _, layout = load_of("joints")
    limit = 0.6 * np.abs(load[0]).max()
    raw = np.clip(load + noise_of(load)[0], -limit, limit)
    assert [mark.effect.id for mark in detect(experiment(raw, layout), (), load).marks] == ["saturation"]
    assert not detect(experiment(raw, layout), ("saturation",), load).marks
    assert [mark.effect.id for mark in detect(experiment(raw, layout), ()).marks] == ["saturation"]
