"""Logs of real machines with an effect planted in them: what else is in them nobody planted, and nobody knows fully.

    for case in measured(40, seed=1, real=folder): ...

The starting model of each log holds what such machines are known to have. What is planted is done to the measured
samples themselves: a clock shifted by a known amount, a constant or a ramp added, channels turned, gains, a filter, a
converter, friction on the measured speed, and the torques of a body that MuJoCo adds to the arm.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import scipy.io
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline
from scipy.linalg import expm

import kinid
from hidden.case import Case
from hidden.draw import Stream
from hidden.world.arm import GRAVITY, Body, dynamics, forward

Array = NDArray[np.float64]

DRY, VISCOUS, OFFSET = "joint-coulomb-friction", "joint-viscous-friction", "joint-torque-offset"
ASYMMETRY = "joint-friction-asymmetry"
#: what is done to a log: (log, random numbers) → log with the effect, its size in words
Plant = Callable[[kinid.Log, np.random.Generator], tuple[kinid.Log, str]]


@dataclass(frozen=True)
class Source:
    """A measured log: how it is read, what a user starts with, and what can be planted in it."""

    name: str
    read: Callable[[Path], tuple[kinid.Log, kinid.Rig]]
    model: tuple[str, ...]
    plants: dict[str, Plant]


def measured(count: int, seed: int, real: Path) -> Iterator[Case]:
    """So many cases, from all sources and plants in turn; deterministic in the seed.

    Args:
        count: how many. seed: another one, other sizes. real: folder of the measured logs.
    """
    every = [(source, effect) for source in SOURCES for effect in source.plants]
    for number in range(count):
        turn, place = divmod(number, len(every))
        source, effect = every[int(Stream(seed, "measured", turn).generator().permutation(len(every))[place])]
        stream = Stream(seed, "measured", number)
        log, rig = _recorded(source.name, real)
        planted, note = source.plants[effect](log, stream.generator())
        model = tuple(name for name in source.model if name != effect)
        yield Case(
            f"single/measured/{source.name}/{effect}/{number}",
            "single",
            planted,
            rig,
            model,
            frozenset({effect}),
            (*model, effect),
            stream.number,
            f"{source.name}: {note}",
        )


@cache
def _recorded(name: str, real: Path) -> tuple[kinid.Log, kinid.Rig]:
    source = next(source for source in SOURCES if source.name == name)
    return source.read(real)


# ---------------------------------------------------------------------------------------------------------- the logs


def lwr4plus(number: int) -> Callable[[Path], tuple[kinid.Log, kinid.Rig]]:
    """An arm with torque sensors in the air; positions, velocities, accelerations and torques."""

    def read(real: Path) -> tuple[kinid.Log, kinid.Rig]:
        with np.load(real / "lwr4plus-motion" / f"measurements_{number}.npz", allow_pickle=False) as raw:
            t, q, dq, ddq, tau = (raw[key] for key in ("times", "positions", "velocities", "accelerations", "torques"))
        log = kinid.Log(t=t - t[0], q=q, dq=dq, ddq=ddq, tau=tau, phase=np.full(len(t), "free"))
        return log, kinid.Rig.parse({"robot": {"model": "lwr4plus"}})

    return read


def drive(real: Path) -> tuple[kinid.Log, kinid.Rig]:
    """A prismatic drive at 1 kHz, position and motor force."""
    raw = scipy.io.loadmat(real / "drive-friction" / "DATA_EMPS.mat")
    t, q, force = (np.ravel(raw[key]) for key in ("t", "qm", "vir"))
    rig = kinid.Rig.parse({"columns": {"q1": {"column": "qm", "unit": "m"}, "tau1": {"column": "vir", "unit": "N"}}})
    return kinid.Log(t=t, q=q[:, None], tau=float(raw["gtau"][0, 0]) * force[:, None]), rig


def motor(real: Path) -> tuple[kinid.Log, kinid.Rig]:
    """The first joint of an upright arm, which nothing pulls on: position, speed and current."""
    raw = np.loadtxt(real / "ur10e-motion" / "joint_1.csv", delimiter=",")
    rig = kinid.Rig.parse({"columns": {"tau1": {"unit": "A"}}})
    keep = np.concatenate([[True], np.diff(raw[:, 0]) > 0])
    return kinid.Log(t=raw[keep, 0], q=raw[keep, 1:2], dq=raw[keep, 7:8], tau=raw[keep, 13:14]), rig


def silicone(name: str) -> Callable[[Path], tuple[kinid.Log, kinid.Rig]]:
    """A round indenter on a soft specimen at 500 Hz: depth and normal force."""

    def read(real: Path) -> tuple[kinid.Log, kinid.Rig]:
        raw = np.loadtxt(real / "silicone-indentation" / f"{name}.csv", delimiter=",")
        contact = {"depth": 1e-3 * raw[:, 2], "normal_force": raw[:, 4].copy()}
        return kinid.Log(t=np.arange(len(raw)) / 500.0, contact=contact), kinid.Rig()

    return read


def poses(real: Path) -> tuple[kinid.Log, kinid.Rig]:
    """A sensor with a tool in two dozen attitudes at rest. The arm that held it had other joints: those of the log turn
    the sensor as it was turned, which is all that weight depends on."""
    raw = np.genfromtxt(real / "med14-ft-imu" / "0-calibration_fts-accel.csv", delimiter=",", skip_header=1)
    wrench, rotation = raw[:, :6], raw[:, 12:21].reshape(-1, 3, 3)
    # the figures of these very poses, by least squares: bias, mass and first moment
    weight = rotation.transpose(0, 2, 1) @ [0.0, 0.0, -GRAVITY]
    rows = np.zeros((len(raw), 6, 10))
    rows[:, :, :6], rows[:, :3, 6] = np.eye(6), weight
    rows[:, 3:, 7:] = np.cross(np.eye(3)[None], weight[:, None, :]).transpose(0, 2, 1)
    found = np.linalg.lstsq(rows.reshape(-1, 10), wrench.ravel(), rcond=None)[0]
    tool = {"mass": float(found[6]), "com": (found[7:] / found[6]).tolist()}
    log = kinid.Log(
        t=60.0 * np.arange(len(raw)), q=_turned(rotation), wrench=wrench - found[:6], phase=np.full(len(raw), "free")
    )
    return log, kinid.Rig.parse({"robot": {"model": "lwr4plus"}, "tool": tool})


def _turned(rotation: Array) -> Array:
    """Joint positions whose tool has these attitudes, (n, 7), by damped least squares from several starts."""
    rng = np.random.default_rng(0)
    limit = np.deg2rad([169, 119, 169, 119, 169, 119, 169])
    out = np.full((len(rotation), 7), np.nan)
    while (left := np.flatnonzero(np.isnan(out[:, 0]))).size:
        q = rng.uniform(-0.6, 0.6, (len(left), 7)) * limit
        for _ in range(60):
            pose = forward(q)
            error = 0.5 * np.cross(pose.rotation, rotation[left], axis=1).sum(axis=2)
            j = pose.jacobian[:, 3:]
            q += (
                j.transpose(0, 2, 1) @ np.linalg.solve(j @ j.transpose(0, 2, 1) + 1e-6 * np.eye(3), error[:, :, None])
            )[:, :, 0]
        good = (np.abs(forward(q).rotation - rotation[left]).max(axis=(1, 2)) < 1e-3) & (np.abs(q) < limit).all(axis=1)
        out[left[good]] = q[good]
    return out


# -------------------------------------------------------------------------------------------------------- the effects


def _readings(log: kinid.Log) -> Array:
    """What sensors gave, (n, k)."""
    if log.tau is not None:
        return np.array(log.tau)
    return np.array(log.wrench) if log.wrench is not None else log.contact["normal_force"][:, None].copy()


def _with(log: kinid.Log, values: Array) -> kinid.Log:
    if log.tau is not None:
        return dataclasses.replace(log, tau=values)
    if log.wrench is not None:
        return dataclasses.replace(log, wrench=values)
    return dataclasses.replace(log, contact={**log.contact, "normal_force": values[:, 0]})


def _signs(rng: np.random.Generator, k: int) -> Array:
    out: Array = rng.uniform(0.5, 1.0, k) * rng.choice([-1.0, 1.0], k)
    return out


def shifted(low: float, high: float) -> Plant:
    """Readings that come late or early by a known time [s]."""

    def plant(log: kinid.Log, rng: np.random.Generator) -> tuple[kinid.Log, str]:
        late = float(rng.uniform(low, high) * rng.choice([-1, 1]))
        stream = CubicSpline(log.t, _readings(log), axis=0)
        return _with(log, stream(np.clip(log.t - late, log.t[0], log.t[-1]))), f"readings late by {late:.4g} s"

    return plant


def lagging(low: float, high: float) -> Plant:
    """Readings behind an amplifier of one pole, integrated in steps of a tenth of the log's."""

    def plant(log: kinid.Log, rng: np.random.Generator) -> tuple[kinid.Log, str]:
        tau = float(rng.uniform(low, high))
        h = log.period / 10
        fine = np.arange(log.t[0], log.t[-1] + h, h)
        stream = CubicSpline(log.t, _readings(log), axis=0)(np.minimum(fine, log.t[-1]))
        from scipy.signal import lfilter

        a = h / (2 * tau)  # trapezoidal
        out = lfilter([a / (1 + a)] * 2, [1, -(1 - a) / (1 + a)], stream - stream[0], axis=0) + stream[0]
        return _with(log, CubicSpline(fine, out, axis=0)(log.t)), f"a pole of {tau:.4g} s"

    return plant


def added(low: float, high: float) -> Plant:
    """A constant on each channel, relative to its spread."""

    def plant(log: kinid.Log, rng: np.random.Generator) -> tuple[kinid.Log, str]:
        values = _readings(log)
        more = rng.uniform(low, high) * values.std(axis=0) * _signs(rng, values.shape[1])
        return _with(log, values + more), f"{np.round(more, 3).tolist()} added"

    return plant


def drifting(low: float, high: float) -> Plant:
    """A ramp on each channel, relative to its spread in the whole log."""

    def plant(log: kinid.Log, rng: np.random.Generator) -> tuple[kinid.Log, str]:
        values = _readings(log)
        more = rng.uniform(low, high) * values.std(axis=0) * _signs(rng, values.shape[1])
        way = (log.t - log.t[0]) / (log.t[-1] - log.t[0])
        return _with(log, values + np.outer(way, more)), f"{np.round(more, 3).tolist()} more at the end"

    return plant


def scaled(low: float, high: float, alike: bool = False) -> Plant:
    """A gain on each channel, or one on all."""

    def plant(log: kinid.Log, rng: np.random.Generator) -> tuple[kinid.Log, str]:
        values = _readings(log)
        gain = rng.uniform(low, high) * _signs(rng, 1 if alike else values.shape[1])
        return _with(log, values * (1.0 + gain)), f"gains of {np.round(gain, 3).tolist()}"

    return plant


def stiffer_with_time(log: kinid.Log, rng: np.random.Generator) -> tuple[kinid.Log, str]:
    """A material whose force grows or fades in the course of the log."""
    rate = float(rng.uniform(0.8, 2.5) * rng.choice([-1, 1]))
    return _with(log, _readings(log) * (1.0 + rate / 60.0 * log.t[:, None])), f"force changing by {rate:.3g} a minute"


def clipped(log: kinid.Log, rng: np.random.Generator) -> tuple[kinid.Log, str]:
    """A converter at the end of its range."""
    values = _readings(log)
    limit = rng.uniform(0.55, 0.85) * np.abs(values).max(axis=0)
    return _with(log, np.clip(values, -limit, limit)), f"limits of {np.round(limit, 3).tolist()}"


def stepped(log: kinid.Log, rng: np.random.Generator) -> tuple[kinid.Log, str]:
    """A coarse converter."""
    values = _readings(log)
    step = rng.uniform(0.05, 0.2) * values.std(axis=0)
    return _with(log, step * np.round(values / step)), f"steps of {np.round(step, 4).tolist()}"


def humming(log: kinid.Log, rng: np.random.Generator) -> tuple[kinid.Log, str]:
    """The mains on the cable, a grid that wanders a little."""
    values = _readings(log)
    size = rng.uniform(0.06, 0.25) * values.std(axis=0)
    turn = 2 * np.pi * (50.0 * log.t + 0.02 * np.sin(0.07 * log.t) + rng.uniform())
    return _with(log, values + np.outer(np.sin(turn), size)), f"hum of {np.round(size, 4).tolist()}"


def rubbing(kind: str, low: float, high: float) -> Plant:
    """Friction or inertia on the measured motion of each joint: torque at the joint's own largest rate, relative to
    spread.
    """

    def plant(log: kinid.Log, rng: np.random.Generator) -> tuple[kinid.Log, str]:
        rate = np.gradient(log.q, log.t, axis=0) if log.dq is None else np.asarray(log.dq)
        if kind == "inertia":
            rate = np.asarray(log.ddq)
        shape = np.abs(rate) if kind == "one-sided" else rate
        values = _readings(log)
        k = values.shape[1]
        way = _signs(rng, k) if kind == "one-sided" else rng.uniform(0.5, 1.0, k)
        size = rng.uniform(low, high) * way * values.std(axis=0) / np.abs(rate).max(axis=0)
        return _with(log, values + size * shape), f"{kind} of {np.round(size, 3).tolist()}"

    return plant


def loaded(log: kinid.Log, rng: np.random.Generator) -> tuple[kinid.Log, str]:
    """A body behind the flange, by MuJoCo: torques with it less those without."""
    mass, com = float(rng.uniform(0.4, 3.0)), (*rng.uniform(-0.03, 0.03, 2), float(rng.uniform(0.0, 0.08)))
    motion = tuple(np.asarray(values) for values in (log.q, log.dq, log.ddq))
    body = Body(mass, com, (mass * 4e-4,) * 3 + (0.0,) * 3)
    more = dynamics((body,), *motion)[1] - dynamics((), *motion)[1]
    return _with(log, _readings(log) + more), f"a body of {mass:.3g} kg at {np.round(com, 3).tolist()}"


def heavier(log: kinid.Log, rng: np.random.Generator) -> tuple[kinid.Log, str]:
    """A mass at the tool's centre: its weight in the measured attitudes."""
    mass = float(rng.uniform(0.1, 0.5))
    weight = mass * forward(np.asarray(log.q)).rotation.transpose(0, 2, 1) @ [0.0, 0.0, -GRAVITY]
    more = np.concatenate([weight, np.cross(_com(log), weight)], axis=1)
    return _with(log, _readings(log) + more), f"{mass:.3g} kg more"


def shifted_centre(log: kinid.Log, rng: np.random.Generator) -> tuple[kinid.Log, str]:
    """A centre of the tool that is elsewhere: moments of the measured weight about it."""
    values, away = _readings(log), rng.uniform(4e-3, 15e-3, 3) * rng.choice([-1, 1], 3)
    more = np.concatenate([np.zeros((len(values), 3)), np.cross(away, values[:, :3])], axis=1)
    return _with(log, values + more), f"a centre that is {np.round(1e3 * away, 2).tolist()} mm away"


def _com(log: kinid.Log) -> Array:
    """Centre of what hangs on the sensor, from its forces and moments."""
    values = _readings(log)
    f = values[:, :3]
    hat = np.zeros((len(f), 3, 3))  # c × f = −[f]× c
    hat[:, 0, 1], hat[:, 0, 2], hat[:, 1, 2] = f[:, 2], -f[:, 1], f[:, 0]
    hat -= hat.transpose(0, 2, 1)
    return np.asarray(np.linalg.lstsq(hat.reshape(-1, 3), values[:, 3:].ravel(), rcond=None)[0])


def turned(log: kinid.Log, rng: np.random.Generator) -> tuple[kinid.Log, str]:
    """A sensor that sits turned in its mount."""
    x, y, z = way = rng.uniform(0.04, 0.2, 3) * rng.choice([-1, 1], 3)
    frame = expm(np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]]))
    values = _readings(log)
    return (
        _with(log, np.concatenate([values[:, :3] @ frame, values[:, 3:] @ frame], axis=1)),
        f"turned by {np.round(way, 3).tolist()} rad",
    )


_ARM: dict[str, Plant] = {
    # torques that change slowly and carry 0.3 N·m that nobody explains: less than this would not be seen
    "time-offset": shifted(40e-3, 100e-3),
    "sensor-lag": lagging(60e-3, 150e-3),
    "joint-torque-gain": scaled(0.08, 0.3),
    "payload": loaded,
    OFFSET: added(0.15, 0.6),
    VISCOUS: rubbing("viscous", 0.3, 1.0),
    ASYMMETRY: rubbing("one-sided", 0.2, 0.8),
    "rotor-inertia": rubbing("inertia", 0.3, 1.0),
    "sensor-drift": drifting(0.15, 0.5),
    "quantization": stepped,
    "saturation": clipped,
}
_AXIS: dict[str, Plant] = {
    "time-offset": shifted(3e-3, 15e-3),
    "sensor-lag": lagging(5e-3, 20e-3),
    OFFSET: added(0.15, 0.6),
    ASYMMETRY: rubbing("one-sided", 0.1, 0.5),
    "sensor-drift": drifting(0.1, 0.4),
    "quantization": stepped,
    "saturation": clipped,
}
_SOFT: dict[str, Plant] = {
    "time-offset": shifted(6e-3, 40e-3),
    "sensor-lag": lagging(10e-3, 60e-3),
    "sensor-bias": added(0.1, 0.4),
    "stiffness-drift": stiffer_with_time,
    "quantization": stepped,
    "saturation": clipped,
    "mains-hum": humming,
}
_POSES: dict[str, Plant] = {
    "sensor-bias": added(0.1, 0.5),
    "tool-mass": heavier,
    "tool-com": shifted_centre,
    "sensor-misalignment": turned,
    "sensor-gain": scaled(0.08, 0.3, alike=True),
}

SOURCES: tuple[Source, ...] = (
    *(Source(f"lwr4plus-motion-{k}", lwr4plus(k), ("rigid-body", OFFSET, DRY, VISCOUS), _ARM) for k in (1, 2)),
    Source("drive-friction", drive, ("rigid-body", DRY, VISCOUS, OFFSET, ASYMMETRY), _AXIS),
    Source("ur10e-motion-joint-1", motor, ("rigid-body", DRY, VISCOUS, OFFSET), _AXIS),
    Source(
        "silicone-two-cycles",
        silicone("two_cycles"),
        ("hooke", "hertz-exponent", "relaxation", "surface-offset"),
        _SOFT,
    ),
    *(
        Source(
            f"silicone-{name}",
            silicone(f"press_{name}"),
            ("hunt-crossley", "surface-offset"),
            {effect: plant for effect, plant in _SOFT.items() if effect != "sensor-bias"},
        )  # it never leaves the material
        for name in ("d5mm_hard", "d5mm_soft")
    ),
    Source("med14-poses", poses, ("none", "sensor-bias", "tool-com"), _POSES),
)


def known(real: Path) -> dict[str, Any]:
    """Every source as it was recorded, nothing planted: log, rig and starting model by name."""
    return {source.name: (*_recorded(source.name, real), source.model) for source in SOURCES}
