"""Simulated teleoperation: contact over a delayed line, the impedance that is felt, and a study of both.

`kinid.controllers.teleoperator` has the equations.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from kinid.controllers._given import is_number
from kinid.controllers.teleoperator import (
    LINEAR,
    METHODS,
    REFLECTIONS,
    Array,
    Complex,
    Environment,
    Teleoperator,
    checked_method,
)
from kinid.errors import InputError

if TYPE_CHECKING:
    from kinid.controllers._line import Line

#: frequencies of a hand that explores [Hz]
BAND = (0.2, 8.0)
#: of the greatest depth: a residual oscillation of the master above this, at the end, is no rest
REST = 0.02


class Motion(NamedTuple):
    """A simulated contact; arrays (n,): t [s], master, slave and intended place [m, > 0 inside], force felt [N].

    port_energy: that the rendered force took up at the master's port so far [J], before this period's.
    injected: damping that the passivity controller adds [N·s/m]. share: of the force that the tank affords.
    stable: whether the master comes to rest.
    """

    t: Array
    master: Array
    slave: Array
    intended: Array
    force: Array
    environment_force: Array
    port_energy: Array
    injected: Array
    share: Array
    stable: bool


def simulate(
    teleoperator: Teleoperator,
    environment: Environment,
    method: str = "direct",
    believed: Environment | None = None,
    depth: float = 0.01,
    duration: float = 12.0,
) -> Motion:
    """The operator pushes from 5 mm above the surface to an intended depth [m] in one second, and holds.

    Contact is unilateral on both sides: an unstable line ends in a hammering limit cycle. `stable` compares the
    master's movement over the last quarter with `REST` of the intended way.

    Raises:
        InputError: an unknown method, a depth that isn't positive, or a duration shorter than ten round trips and 4 s.
    """
    t, intended = push(teleoperator, depth, duration)
    out = _run(teleoperator, environment, method, believed, intended, False)
    tail = out[0, 3 * len(t) // 4 :]
    stable = bool(np.isfinite(out).all() and tail.max() - tail.min() < REST * (depth + 0.005))
    return Motion(t, out[0], out[1], intended, out[2], out[3], out[4], out[5], out[6], stable)


def push(teleoperator: Teleoperator, depth: float, duration: float) -> tuple[Array, Array]:
    """Times [s] and the intended place [m, > 0 inside] of a push from 5 mm above the surface, held, (n,) each.

    Raises:
        InputError: see `simulate`.
    """
    shortest = max(4.0, 20 * teleoperator.delay)
    if not (is_number(depth) and depth > 0 and is_number(duration) and duration >= shortest):
        raise InputError(
            f"depth {depth} m and duration {duration} s", f"depth > 0, duration ≥ {shortest:g} s", "push in, and wait"
        )
    n = round(duration / teleoperator.period)
    t = np.arange(n, dtype=np.float64) * teleoperator.period
    s = np.minimum(t, 1.0)
    intended: Array = -0.005 + (depth + 0.005) * s**3 * (10 - 15 * s + 6 * s**2)
    return t, intended


def measured_impedance(
    teleoperator: Teleoperator,
    environment: Environment,
    frequency: Sequence[float],
    method: str,
    believed: Environment | None = None,
) -> Complex:
    """Z_t from simulations in which the master is moved as a sine, one frequency at a time, in lasting contact, (n,).

    A passivity controller's answer is that of its first harmonic. Frequencies are rounded to whole periods of samples.
    """
    out, h = [], teleoperator.period
    for f in frequency:
        per_cycle = max(8, round(1.0 / (f * h)))
        settle = math.ceil((2 * teleoperator.delay + 1.0) / (per_cycle * h)) + 1
        cycles = settle + 2
        k = np.arange(per_cycle * cycles)
        angle = 2 * np.pi * k / per_cycle
        result = _run(teleoperator, environment, method, believed, 0.005 + 1e-3 * np.sin(angle), True)
        rows = slice(settle * per_cycle, None)
        carrier = np.exp(-1j * angle[rows])
        motion, force = np.mean(result[0, rows] * carrier), np.mean(result[2, rows] * carrier)
        out.append(force / (motion * 2j * np.pi / (per_cycle * h)))
    return np.array(out)


class Row(NamedTuple):
    """One case of the study: one-way delay [s], method, stable by simulation, and by Nyquist's criterion (None for a
    non-linear method), transparency error [1].
    """

    delay: float
    method: str
    stable: bool
    nyquist: bool | None
    error: float


@dataclass(frozen=True, eq=False)
class Study:
    """The study's table, and what a figure needs.

    Attributes:
        rows: each delay with each method. frequency: [Hz], (n,). environment: Z_e, (n,).
        transmitted: Z_t, (n,), by delay and method. motions: simulations, by delay and method.
    """

    rows: tuple[Row, ...]
    frequency: Array
    environment: Complex
    transmitted: dict[tuple[float, str], Complex] = field(default_factory=dict)
    motions: dict[tuple[float, str], Motion] = field(default_factory=dict)

    def table(self) -> str:
        """Delay, method, stable?, transparency error: one line a case."""
        lines = ["one-way delay [ms]  method       stable  Nyquist  transparency error"]
        for row in self.rows:
            nyquist = "-" if row.nyquist is None else ("yes" if row.nyquist else "no")
            stable = "yes" if row.stable else "no"
            lines.append(f"{1e3 * row.delay:18.0f}  {row.method:<11}  {stable:<6}  {nyquist:<7}  {row.error:.4f}")
        return "\n".join(lines)


def transparency_error(transmitted: Complex, environment: Complex) -> float:
    """Root mean square of |Z_t − Z_e| / |Z_e| over the frequencies; 0 is transparent, 1 is nothing transmitted."""
    return float(np.sqrt(np.mean(np.abs(transmitted / environment - 1.0) ** 2)))


def study(
    environment: Environment | None = None,
    believed: Environment | None = None,
    delays: Sequence[float] = (0.05, 0.1, 0.2, 0.4),
    methods: Sequence[str] = REFLECTIONS,
    teleoperator: Teleoperator | None = None,
    points: int = 24,
) -> Study:
    """Each delay with each method: stability in contact, and transmitted against true impedance over `BAND`.

    Args:
        environment: the true one; default: Ecoflex 00-50. believed: what the map says; default: the truth.
        delays: one-way [s]. methods: see `Method`. teleoperator: all but the delay. points: frequencies, log-spaced.

    Raises:
        InputError: an unknown method, or no delays.
    """
    environment, teleoperator = environment or Environment(), teleoperator or Teleoperator()
    if not len(delays) or points < 2:
        raise InputError(
            f"{len(delays)} delays and {points} frequencies", "at least one delay, two frequencies", "give some"
        )
    for method in methods:
        checked_method(method)
    cases = [dataclasses.replace(teleoperator, delay=delay) for delay in delays]  # all checked before any runs
    frequency = np.geomspace(*BAND, points)
    truth, rows = environment.impedance(frequency), []
    transmitted, motions = {}, {}
    for case in cases:
        for method in methods:
            linear = method in LINEAR
            z_t = (
                case.transmitted(environment, frequency, method, believed)
                if linear
                else measured_impedance(case, environment, list(frequency), method, believed)
            )
            motion = simulate(case, environment, method, believed)
            nyquist = case.is_stable(environment, method, believed) if linear else None
            rows.append(Row(case.delay, method, motion.stable, nyquist, transparency_error(z_t, truth)))
            transmitted[case.delay, method], motions[case.delay, method] = z_t, motion
    return Study(tuple(rows), frequency, truth, transmitted, motions)


def _run(
    teleoperator: Teleoperator,
    environment: Environment,
    method: str,
    believed: Environment | None,
    path: Array,
    moved: bool,
) -> Array:
    from kinid.controllers import _line

    o, out = teleoperator, np.empty((7, len(path)))
    line, number = compiled_line(o, environment, believed or environment), METHODS.index(checked_method(method))
    forth, back = (o.network.schedule(len(path), o.delay, o.period, way) for way in (0, 1))
    _line.run(line, forth, back, number, np.ascontiguousarray(path), moved, out)
    return out


def compiled_line(o: Teleoperator, environment: Environment, believed: Environment) -> Line:
    """As the compiled line takes it; believed: what the map says."""
    from kinid.controllers import _line

    return _line.Line(
        mass=o.moving_mass,
        damping=o.master_damping,
        hand_damping=o.hand_damping,
        hand_stiffness=o.hand_stiffness,
        slave_mass=o.slave_mass,
        slave_damping=o.slave_damping,
        coupling_stiffness=o.coupling_stiffness,
        coupling_damping=o.coupling_damping,
        environment_stiffness=environment.stiffness,
        environment_damping=environment.damping,
        believed_stiffness=believed.stiffness,
        believed_damping=believed.damping,
        most_damping=o.full_damping,
        plain_damping=min(o.full_damping, o.plain_damping),
        brake_stiffness=o.brake_stiffness,
        capacity=o.tank,
        wave_impedance=o.wave_impedance,
        period=o.period,
    )
