"""A material tester with a table that slides: force over depth and slip, without a robot."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from hidden.world.material import Matter, press
from hidden.world.path import FINE, Path, Script
from hidden.world.protocol import Protocol, perform
from hidden.world.rubbing import Rub, rub
from hidden.world.sensing import Chain, read
from hidden.world.strange import Strange, force_of, reading_of

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Setup:
    """What is on the table: material, friction, sensor, and what no catalogue holds; `error` is the calibration's.

    Attributes:
        error: misplaced surface [m], clock [s], and bias of each channel, all within what a calibration leaves.
        motion_noise: of the logged depth and slip [m]. noise: of each channel [N].
        peak: of each channel without a hidden effect [N].
    """

    matter: Matter = field(default_factory=Matter)
    rub: Rub = field(default_factory=Rub)
    chain: Chain = field(default_factory=Chain)
    strange: Strange | None = None
    surface_error: float = 0.0
    clock_error: float = 0.0
    bias_error: Array = field(default_factory=lambda: np.zeros(3))
    motion_noise: float = 2e-6
    noise: Array = field(default_factory=lambda: np.array([0.015, 0.015, 0.02]))
    peak: Array = field(default_factory=lambda: np.full(3, np.inf))


def imperfect(rng: np.random.Generator) -> dict[str, object]:
    """What a careful calibration leaves, and the noise of a good sensor."""
    return dict(
        surface_error=float(rng.uniform(-2e-5, 2e-5)),
        clock_error=float(rng.uniform(-2e-4, 2e-4)),
        bias_error=rng.uniform(-0.01, 0.01, 3),
        motion_noise=float(rng.uniform(1e-6, 2.5e-6)),
        noise=np.array([0.015, 0.015, 0.02]) * rng.uniform(0.7, 1.4),
    )


def path_of(rng: np.random.Generator, protocol: Protocol, act: Callable[[Script, Protocol], None] = perform) -> Path:
    """A path of x, y (along the tangents) and z (depth)."""
    script = Script(("x", "y", "z"), rng, z=-protocol.clear)
    act(script, protocol)
    return script.path(np.array([3e-7, 3e-7, 2e-6]))


def forces(setup: Setup, t: Array, motion: Array) -> Array:
    """Force on the tool along tangents and normal at the fine rate, (n, 3) [N], for its true place (n, 3)."""
    x, y, depth = motion.T
    normal, inside = press(setup.matter, t, depth + setup.surface_error, x, y)
    slip = np.stack([x, y])
    rate = np.gradient(slip, 1.0 / FINE, axis=1)
    tangential = rub(setup.rub, normal, slip, rate, inside > 0)
    out = np.concatenate([tangential, normal[None]]).T
    if setup.strange is not None:
        out = force_of(setup.strange, t, motion, inside, out)
    return out


def readings(setup: Setup, path: Path, rng: np.random.Generator, quiet: bool = False) -> Array:
    """What the sensor logs, (samples, 3); `quiet` leaves out noise."""
    at = path.t[path.logged]
    load = forces(setup, path.t, path.x)
    chain = setup.chain
    late = chain.late + setup.clock_error
    chain = dataclasses.replace(chain, late=late, bias=setup.bias_error + (0.0 if chain.bias is None else chain.bias))
    out = read(chain, load, at, np.zeros(3) if quiet else setup.noise, rng)
    if setup.strange is not None:
        out = reading_of(setup.strange, at, out)
    return out
