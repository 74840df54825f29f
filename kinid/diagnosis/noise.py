"""How far a reading may be from what a model expects: noise, noise of positions on its way through the model, tolerance."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from kinid.effects import Signals, Stage
from kinid.experiment import Experiment
from kinid.model import Model
from kinid.white_noise import white_noise

Array = NDArray[np.float64]

#: share of a reading that no sensor and no law gets right
RELATIVE = 2e-3
#: rates hold nothing above this [Hz]
RATE_BAND = 25.0
#: share of a usual force that is open where a material has let go
OPEN = 0.1
#: how often motion is shaken to see what its noise does
HELPINGS = 4


def spread(experiment: Experiment, model: Model, values: Array, edge: NDArray[np.int64], count: Array) -> Array:
    """Noise of mean readings, of positions through the model, and the share that no law gets right, (channels, g)."""
    s = experiment.signals
    predicted = experiment.in_band(model.predict(s, values))
    noise = experiment.noise.copy()
    units = np.array(s.layout.units)
    for unit in set(units.tolist()):
        alike = units == unit
        noise[alike] = np.maximum(noise[alike], 0.02 * noise[alike].max())
    scale = np.sqrt(np.mean(experiment.measured[:, experiment.valid] ** 2, axis=1)) if experiment.valid.any() else noise
    noise = np.maximum(noise, 1e-6 * np.maximum(scale, 1e-12))
    many = count
    if experiment.band is not None:
        # what the band lets through is spread over neighbours already: means take nothing more off it
        noise = noise * np.sqrt(min(1.0, 2.0 * experiment.band * period_of(s)))
        many = np.ones_like(count)
    white = noise[:, None] ** 2 / many
    mean = np.add.reduceat(predicted, edge, axis=1) / count
    if s.layout.kind != "joints" and (s.depth > 0).any():
        white = white + _carried(experiment, model, values, predicted, edge, count)
        open_ = _pulled(s, predicted, inside=s.depth > 0 if "adhesion" in model else None) + _left(experiment)
        white = white + (np.add.reduceat(open_, edge, axis=1) / count) ** 2
    out: Array = np.sqrt(white + (RELATIVE * mean) ** 2)
    return out


def as_their_like(values: Array, still: NDArray[np.bool_], units: Sequence[str]) -> Array:
    """Values (channels,) where those of channels that never change are the greatest of the same unit."""
    unit, out = np.array(units), values.copy()
    for i in np.flatnonzero(still):
        out[i] = values[unit == unit[i]].max()
    return out


def period_of(s: Signals) -> float:
    """Time between samples [s]."""
    steps = s.dt[s.dt > 0]
    return float(np.median(steps)) if len(steps) else 1.0


def _carried(experiment: Experiment, model: Model, values: Array, predicted: Array, edge: NDArray[np.int64],
             count: Array) -> Array:  # fmt: skip
    """Variance of mean readings that noise of positions makes on its way through the model, (channels, g).

    Seen, not derived: the motion gets another helping of its own noise, and memory and kinks do with it what they do.
    """
    from scipy.ndimage import gaussian_filter1d, uniform_filter1d

    s = experiment.signals
    rng = np.random.default_rng(0)
    period, width = period_of(s), _width(s)
    total = np.zeros((len(predicted), len(edge)))
    for _ in range(HELPINGS):
        shaken = []
        for x, v in ((s.depth, s.depth_rate), (s.slip[0], s.slip_rate[0]), (s.slip[1], s.slip_rate[1])):
            noise = white_noise(x) * rng.standard_normal(len(x))
            rate = np.gradient(gaussian_filter1d(noise, width), period) if len(x) > 2 and width > 0.5 else np.zeros(len(x))
            shaken.append((x + noise, v + rate))
        (d, dv), (x1, v1), (x2, v2) = shaken
        moved = dataclasses.replace(s, depth=d, depth_rate=dv, slip=np.stack([x1, x2]), slip_rate=np.stack([v1, v2]))
        change = np.add.reduceat(experiment.in_band(model.predict(moved, values)) - predicted, edge, axis=1) / count
        total += change**2 / HELPINGS
    for change in alike_at_each_turn(experiment, model, values, predicted):
        total += (np.add.reduceat(change, edge, axis=1) / count) ** 2
    if len(edge) == len(s):  # slow logs: what happens between samples shows in what is lost with every second one
        for phase in (0, 1):
            kept = np.arange(phase, len(s), 2)
            coarse = experiment.in_band(model.predict(_some(s, kept), values))
            total[:, kept] += (coarse - predicted[:, kept]) ** 2 / 2
    near = max(1, round(0.2 / (period * float(np.median(count)))))
    out: Array = uniform_filter1d(total, near, axis=1)
    return out


def alike_at_each_turn(experiment: Experiment, model: Model, values: Array, predicted: Array) -> Iterator[Array]:
    """How predictions (channels, n) may be wrong in the same way at each turn of the motion, which averages nowhere.

    What the band of the rates costs (the fastest motion loses as much again on its way through the same filter a second time, in
    logs without gaps); and that within the last of their length bristles are Dahl's, which creep at rest under any tremor, or
    elastic, for materials are either.
    """
    from scipy.ndimage import gaussian_filter1d

    s, width = experiment.signals, _width(experiment.signals)
    others = []
    if width > 0.5 and len(s.runs) == 1:
        smooth = [gaussian_filter1d(v, width) for v in (s.depth_rate, *s.slip_rate)]
        others.append(dataclasses.replace(s, depth_rate=smooth[0], slip_rate=np.stack(smooth[1:])))
    if Stage.FRICTION in model.stages:
        others.append(dataclasses.replace(s, play=0.0))
    for moved in others:
        yield experiment.in_band(model.predict(moved, values)) - predicted


def _width(s: Signals) -> float:
    """Standard deviation of the filter that makes the band of the rates, in samples."""
    return 1.0 / (2 * np.pi * RATE_BAND * period_of(s))


def _some(s: Signals, kept: NDArray[np.int64]) -> Signals:
    """Signals with a part of their samples; memory begins anew where a run of the whole began."""
    run = np.cumsum(s.dt == 0.0)[kept]
    dt = np.where(np.r_[True, np.diff(run) != 0], 0.0, np.diff(s.t[kept], prepend=s.t[kept[0]]))
    sensor = s.sensor
    if sensor is not None:
        sensor = dataclasses.replace(
            sensor, to_contact=np.ascontiguousarray(sensor.to_contact[kept]), specific=sensor.specific[:, kept],
            omega=sensor.omega[:, kept], alpha=sensor.alpha[:, kept], load=np.ascontiguousarray(sensor.load[:, kept]),
        )  # fmt: skip
    return dataclasses.replace(
        s, t=s.t[kept], dt=dt, depth=s.depth[kept], depth_rate=s.depth_rate[kept], slip=s.slip[:, kept],
        slip_rate=s.slip_rate[:, kept], measured=None if s.measured is None else s.measured[:, kept], sensor=sensor,
    )  # fmt: skip


def _pulled(s: Signals, predicted: Array, inside: NDArray[np.bool_] | None) -> Array:
    """What a law that pulls at separation puts into each reading, where a tool might as well have left, (channels, n).

    Args:
        inside: where pulling isn't what the law is for, (n,); nowhere is, if None.
    """
    out, air = np.zeros_like(predicted), s.depth <= 0
    inside = np.ones(len(s), np.bool_) if inside is None else inside
    force = predicted if s.layout.kind == "contact" or s.sensor is None else predicted - s.sensor.load
    if air.any():  # what is read where nothing is touched, a bias, pulls at no material
        force = force - np.median(force[:, air], axis=1, keepdims=True)
    if s.layout.kind == "contact":
        if "normal_force" in s.layout.channels:
            row = s.layout.channels.index("normal_force")
            out[row] = np.maximum(-force[row], 0.0) * inside
    elif s.sensor is not None:
        normal = s.sensor.to_contact[:, 2].T
        pull = np.maximum(-np.einsum("in,in->n", normal, force[:3]), 0.0) * inside
        out[:3] = np.abs(normal) * pull
        out[3:] = np.abs(np.cross(s.sensor.tip, normal, axis=0)) * pull
    return out


def _left(experiment: Experiment) -> Array:
    """What is open of each reading while a tool retracts from a material that has let it go already, (channels, n) [N, N·m].

    Linear dashpots pull there, and rub; materials that remember or lose energy don't: laws that differ in this alone are one.
    """
    s, normal = experiment.signals, experiment.normal_force
    if normal is None or not experiment.let_go.any():
        return np.zeros_like(experiment.measured)
    arm = 1.0 if s.sensor is None else float(np.linalg.norm(s.sensor.tip))
    lever = np.array([1.0 if unit == "N" else arm for unit in s.layout.units])
    usual = float(np.percentile(normal[s.depth > 0], 95))
    out: Array = lever[:, None] * (OPEN * usual * experiment.let_go)
    return out
