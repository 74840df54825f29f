"""Experiments by name: what they touch, and how."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from kinid.controllers._given import closest, numbers
from kinid.errors import InputError
from kinid.lab import materials
from kinid.lab.arm import Gains, Joints, lwr4plus_joints
from kinid.lab.protocol import Poke, Script, Slide, five_phases, minimum_jerk
from kinid.lab.sensors import Sensor, StreamSpec
from kinid.lab.setup import Setup

Vector = tuple[float, float, float]

#: the study's signals: amplitudes [m] and frequencies [Hz] about a depth [m]
SPONGE_POKE = Poke(0.012, ((0.003, 0.9), (0.001, 5.0)))
SILICONE_POKE = Poke(0.003, ((0.0015, 0.9), (0.0005, 5.0)))
BAND_POKE = Poke(0.08, ((0.025, 1.7), (0.010, 4.0)), duration=8.0)
SLIDE = Slide(depth=2.5e-3, speed=3e-3, length=6e-3)


@dataclass(frozen=True)
class Experiment:
    """A name, one line on it, its material, its script, and where its surface lies [m]."""

    name: str
    says: str
    material: str
    script: Callable[[], Script]
    point: Vector = (0.55, 0.0, 0.10)


def _touch(poke: Poke) -> Callable[[], Script]:
    return lambda: five_phases(poke, SLIDE)


def _wave() -> Script:
    """A large slow motion in the air that moves every joint."""
    period, duration = 1e-3, 20.0
    t = np.asarray(np.arange(round(duration / period)) * period, dtype=float)
    fade = minimum_jerk(np.minimum(t, duration - t) / 2.0)[:, None]
    w = 2 * np.pi * np.array([0.23, 0.31, 0.41])
    place = np.array([0.0, 0.0, -0.22]) + fade * np.sin(np.outer(t, w)) * np.array([0.08, 0.2, 0.08])
    tilt = fade * np.sin(np.outer(t, 2 * np.pi * np.array([0.37, 0.29]))) * np.array([0.35, 0.35])
    return Script(t.astype(np.float64), np.full(len(t), "free"), place, tilt)


EXPERIMENTS = {
    e.name: e
    for e in (
        Experiment("poke", "a multisine about a depth", "ecoflex-50", lambda: five_phases(SILICONE_POKE)),
        Experiment(
            "slide", "out and back along both tangents at constant set-point", "ecoflex-50", lambda: five_phases(SLIDE)
        ),
        Experiment(
            "band",
            "a quasi-elastic band, pressed by centimetres",
            "band",
            lambda: five_phases(BAND_POKE, approach=2.4),
            (0.55, 0.0, 0.25),
        ),
        Experiment("sponge", "an anechoic sponge, poked and slid on", "sponge", _touch(SPONGE_POKE)),
        Experiment("ecoflex-50", "Ecoflex 00-50, poked and slid on", "ecoflex-50", _touch(SILICONE_POKE)),
        Experiment("dragon-skin-10", "Dragon Skin 10, poked and slid on", "dragon-skin-10", _touch(SILICONE_POKE)),
        Experiment(
            "mould",
            "four silicones in quarters, poked at their common corner and slid on",
            "mould",
            _touch(SILICONE_POKE),
        ),
        Experiment("free-mould", "the same with the free sides of a block", "free-mould", _touch(SILICONE_POKE)),
        Experiment("walled-mould", "the same, stuck to rigid walls", "walled-mould", _touch(SILICONE_POKE)),
        Experiment("wave", "free motion of all joints, nothing touched", "ecoflex-50", _wave),
    )
}
#: what can be asked for by name: these, and the studies of teleoperation, control, borders and published materials
STUDIES = ("teleoperation", "control", "slides", "study")
NAMES = (*EXPERIMENTS, *STUDIES)


def named(name: str) -> Experiment:
    """An experiment by its name.

    Raises:
        InputError: no such experiment.
    """
    if name not in EXPERIMENTS:
        raise InputError(f"experiment '{name}'", f"one of {', '.join(NAMES)}", closest(name, NAMES))
    return EXPERIMENTS[name]


def limited(torque_limit: Sequence[float] | None) -> Joints:
    """The LWR4+'s drives, with other torque limits [N·m]: one for all joints, or one for each.

    Raises:
        InputError: a number of limits that isn't the arm's, or one that isn't positive.
    """
    joints = lwr4plus_joints()
    if torque_limit is None:
        return joints
    count = len(joints.torque_limit)
    limit = np.atleast_1d(
        numbers(torque_limit, (), "torque limits", f"one positive number [N·m] for all joints, or {count}")
    )
    if limit.shape not in ((1,), (count,)) or not (limit > 0).all():
        raise InputError(
            f"torque limits {', '.join(f'{v:g}' for v in limit)}",
            f"one positive number [N·m] for all joints, or {count}",
            "correct them",
        )
    return dataclasses.replace(joints, torque_limit=np.broadcast_to(limit, count).copy())


def prepare(
    name: str,
    *,
    material: str | None = None,
    seed: int = 0,
    gains: Gains | None = None,
    point: Vector | None = None,
    normal: Vector | None = None,
    torque_limit: Sequence[float] | None = None,
) -> Setup:
    """The set-up of a named experiment, its sensor and clocks by the seed.

    Args:
        name: of the experiment. material: touched; default: the experiment's. seed: of sensor and noise.
        gains: of the controller. point [m], normal: of the surface, base frame; default: the experiment's, upwards.
        torque_limit: of the drives [N·m], one for all joints or one for each; default: the arm's.

    Raises:
        InputError: no such experiment or material, or a seed, gains, point, normal or limit that are none.
    """
    experiment = named(name)
    if isinstance(seed, bool) or not isinstance(seed, int | np.integer) or seed < 0:
        raise InputError(f"seed {seed!r}", "a whole number, 0 or more", "choose another")
    if not isinstance(gains, Gains | None):
        raise InputError(f"gains {str(gains)[:40]!r}", "kinid.lab.arm.Gains(…)", "see its docstring")
    for what, vector in (("point", point), ("normal", normal)):
        if vector is not None:
            numbers(vector, (3,), f"a surface's {what}", "give three numbers in the base frame")
    rng = np.random.default_rng(np.random.SeedSequence([seed, 0]))
    sensor = Sensor.mini40(rng)
    wrench = StreamSpec(
        offset=float(rng.uniform(-2e-3, 2e-3)),
        delay=float(rng.uniform(0.0, 1e-3)),
        jitter=2e-5,
        losses=2e-3,
        skew=float(rng.normal(scale=5e-6)),
    )
    joints = StreamSpec(every=2, jitter=2e-5, losses=1e-3)
    # as an experimenter finds it who compares the clocks once: to the microsecond, and not how they drift apart
    known = round(joints.offset + joints.delay - wrench.offset - wrench.delay, 6)
    out = normal or (0.0, 0.0, 1.0)
    tangent = (0.0, 1.0, 0.0) if abs(out[0]) > 0.9 * max(map(abs, out)) else (1.0, 0.0, 0.0)
    return Setup(
        experiment.script(),
        materials.material(material or experiment.material),
        gains or Gains(),
        joints=limited(torque_limit),
        point=point or experiment.point,
        normal=out,
        tangent=tangent,
        sensor=sensor,
        known_crosstalk=sensor.crosstalk,
        known_bias=sensor.bias,
        wrench_stream=wrench,
        joint_stream=joints,
        known_clock_offset=known,
        seed=seed,
    )
