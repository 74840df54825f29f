"""The poke that tells most about a contact model: a multisine whose frequencies, amplitudes, phases and depth are
optimised.

The readings' sensitivities to the parameters, at values that are assumed, give Fisher's information; its determinant
(D) or the sum of relative variances (A) is brought to its best by an interior-point method (casadi, ipopt), within
limits of depth, force, speed and of the bandwidth in which the robot follows; of a robot also within what its joints
can do.

What to expect: within the peak force and the time of the study's two sines, at most 3 Hz, an A-optimal poke leaves 0.53
to 0.74 of their intervals, and more than three sines narrow them no further. For stiffness and exponent no motion at
all within that force and 0.15 m/s leaves less than about half (`kinid.planning.ideal.least_halves`). With half as much
force again all three fall to half or less.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from kinid.errors import InputError
from kinid.planning.expected import Law
from kinid.planning.information import CRITERIA, Interval, cost, information, intervals, sensitivities
from kinid.planning.signals import FADE, Multisine

Array = NDArray[np.float64]

#: depth and its first three derivatives (4, n) → share of the joints' limits that each sample uses, (n,)
Joints = Callable[[Array], Array]

#: standard deviation of a Mini40's normal force [N] at the log's rate, where the rig states none
NOISE = 0.029
#: samples a second that the optimisation looks at: 30 for each turn of a 3 Hz sine
DESIGN_RATE = 100.0
#: share of the force limit that the motion is planned for: the rest is for what lies between samples
SPARED = 0.99
#: share of the joints' limits that it is planned for: the mean jerk between samples and the way in and out want some
JOINTS = 0.97
#: starts of the search, and steps of each
STARTS, STEPS = 2, 50


@dataclass(frozen=True)
class Bounds:
    """What the motion has to keep.

    Attributes:
        deepest, shallowest: depths [m]. force: largest expected normal force [N]. speed: along the normal [m/s].
        bandwidth: of the robot's tracking; no sine is faster [Hz]. duration [s]. fade: in and out [s].
    """

    deepest: float = 0.02
    shallowest: float = 5e-4
    force: float = np.inf
    speed: float = 0.05
    bandwidth: float = 3.0
    duration: float = 4.0
    fade: float = FADE

    def __post_init__(self) -> None:
        if not (np.isfinite(self.deepest) and 0 <= self.shallowest < self.deepest):
            raise InputError(
                f"depths from {self.shallowest} to {self.deepest} m", "0 ≤ shallowest < deepest", "correct them"
            )
        for name in ("force", "speed", "bandwidth", "duration", "fade"):
            if not getattr(self, name) > 0:
                raise InputError(f"a {name} of {getattr(self, name)}", "a positive number", "correct it")
        if self.bandwidth * self.duration < 1.0:
            raise InputError(
                f"{self.duration:g} s within a bandwidth of {self.bandwidth:g} Hz",
                "time for one turn at least",
                "allow more time",
            )


@dataclass(frozen=True, eq=False)
class Excitation:
    """An optimised signal, and what it is expected to tell.

    Attributes:
        signal: the motion phase. criterion: D or A. cost: its value. intervals: by parameter.
        force, speed, deepest: the largest that are expected. binding: names of the bounds that are reached.
        information: of relative changes, (p, p).
    """

    signal: Multisine
    criterion: str
    cost: float
    intervals: dict[str, Interval]
    force: float
    speed: float
    deepest: float
    binding: tuple[str, ...]
    information: Array

    def to_dict(self) -> dict[str, Any]:
        """For provenance and JSON."""
        return {
            "criterion": self.criterion,
            "cost": self.cost,
            "signal": self.signal.to_dict(),
            "force": self.force,
            "speed": self.speed,
            "deepest": self.deepest,
            "binding": list(self.binding),
            "intervals": {name: each.to_dict() for name, each in self.intervals.items()},
        }


def expected_intervals(
    law: Law, signal: Multisine, *, noise: float = NOISE, rate: float = 500.0
) -> dict[str, Interval]:
    """The 95 % intervals that a log of this motion phase gives, samples at a rate [Hz] with white noise [N]."""
    t = np.arange(round(signal.duration * rate)) / rate
    motion = signal(t)
    return intervals(_information(law, t, motion[0], motion[1], noise, 1.0), law.vector, _parameters(law))


def optimise(
    law: Law,
    bounds: Bounds = Bounds(),
    *,
    sines: int = 3,
    criterion: str = "D",
    noise: float = NOISE,
    rate: float = 500.0,
    joints: Joints | None = None,
) -> Excitation:
    """The multisine that tells most about a contact law within bounds.

    Args:
        law: the model, and the values assumed. bounds: to be kept. sines: how many. criterion: "D" or "A".
        noise: of the normal force, standard deviation at the log's rate [N]. rate: of the log [Hz].
        joints: what the robot's joints can do there, as `Planner.joints` tells it; default: anything.

    Raises:
        InputError: bounds that leave no motion, or a parameter that no poke tells.
    """
    check_asked(sines, criterion, noise)
    bounds = dataclasses.replace(bounds, force=SPARED * bounds.force)
    room = _room(law, bounds)
    best: tuple[float, Multisine] | None = None
    for number in range(STARTS):
        found = _kept(law, bounds, _search(law, bounds, room, sines, criterion, noise, rate, number, joints), joints)
        t = np.arange(round(found.duration * DESIGN_RATE)) / DESIGN_RATE
        motion = found(t)
        value = cost(_information(law, t, motion[0], motion[1], noise, rate / DESIGN_RATE), criterion)
        if best is None or value < best[0]:
            best = value, found
    assert best is not None
    signal = best[1]
    t = np.arange(round(signal.duration * 1000)) / 1000
    motion = signal(t)
    force, speed, deepest = float(_force(law, t, motion).max()), float(np.abs(motion[1]).max()), float(motion[0].max())
    reached = {
        "force": force / bounds.force,
        "speed": speed / bounds.speed,
        "deepest": deepest / bounds.deepest,
        "bandwidth": max(s[1] for s in signal.sines) / bounds.bandwidth,
        "joints": 0.0 if joints is None else float(joints(motion).max()) / JOINTS,
    }
    t = np.arange(round(signal.duration * rate)) / rate
    motion = signal(t)
    matrix = _information(law, t, motion[0], motion[1], noise, 1.0)
    return Excitation(
        signal,
        criterion,
        best[0],
        intervals(matrix, law.vector, _parameters(law)),
        force,
        speed,
        deepest,
        tuple(name for name, share in reached.items() if share > 0.99),
        matrix,
    )


def check_asked(sines: int, criterion: str, noise: float = NOISE) -> None:
    """Refuse what no search can begin with; arguments as of `optimise`."""
    if criterion not in CRITERIA:
        raise InputError(f"criterion '{criterion}'", f"one of {', '.join(CRITERIA)}", "choose one")
    if not 1 <= sines <= 8:
        raise InputError(f"{sines} sines", "1 to 8", "choose another number")
    if not (np.isfinite(noise) and noise > 0):
        raise InputError(f"a noise of {noise} N", "a positive number", "correct it")


def _parameters(law: Law) -> dict[str, Any]:
    return law.model.parameters(law.layout())


def _information(law: Law, t: Array, depth: Array, rate: Array, noise: float, repeats: float) -> Array:
    """Of the normal force alone: nothing slides in a poke."""
    signals = law.signals(t, depth, rate)
    found = sensitivities(lambda values: law.model.predict(signals, values)[:1], law.vector, _parameters(law))
    return information(found, np.array([noise]), repeats)


def _force(law: Law, t: Array, motion: Array) -> Array:
    out: Array = law(law.signals(t, motion[0], motion[1]))[2]
    return out


def _room(law: Law, bounds: Bounds) -> tuple[float, float]:
    """Depths between which the offset is sought: not deeper than slow motion may press."""
    depth = np.linspace(bounds.shallowest, bounds.deepest, 200)
    t = np.linspace(0.0, bounds.duration, 200)
    force = _force(law, t, np.stack([depth, np.full(200, np.ptp(depth) / bounds.duration)]))
    over = np.flatnonzero(force > bounds.force)
    if len(over) and over[0] < 2:
        raise InputError(
            f"a force limit of {bounds.force:g} N, which is passed at {1e3 * bounds.shallowest:g} mm already",
            "room for a motion",
            "allow more force, or go less deep",
        )
    return bounds.shallowest, float(depth[over[0] - 1]) if len(over) else bounds.deepest


def _search(
    law: Law,
    bounds: Bounds,
    room: tuple[float, float],
    sines: int,
    criterion: str,
    noise: float,
    rate: float,
    number: int,
    joints: Joints | None,
) -> Multisine:
    """One run of the interior-point method; variables: offset and amplitudes by the room's size, frequencies,
    phases.
    """
    import casadi

    low, high = room
    size = high - low
    t = np.arange(round(bounds.duration * DESIGN_RATE)) / DESIGN_RATE

    def signal(x: Array) -> Multisine:
        a, f, p = x[1:].reshape(3, sines)
        return Multisine(
            float(low + size * x[0]),
            tuple((float(size * u), float(v), float(w)) for u, v, w in zip(a, f, p)),
            bounds.duration,
            bounds.fade,
        )

    def used(motion: Array) -> Array:
        return np.zeros(motion.shape[1]) if joints is None else joints(motion) / JOINTS

    class Told(casadi.Callback):
        """Criterion, then depth, speed, force and joints at every so manieth sample, each by its bound."""

        def __init__(self) -> None:
            casadi.Callback.__init__(self)
            self.construct("told", {"enable_fd": True, "fd_method": "forward"})

        def get_n_in(self) -> int:
            return 1

        def get_n_out(self) -> int:
            return 2

        def get_sparsity_in(self, _: int) -> Any:
            return casadi.Sparsity.dense(1 + 3 * sines, 1)

        def get_sparsity_out(self, i: int) -> Any:
            return casadi.Sparsity.dense(1 if i == 0 else 4 * len(t[::2]), 1)

        def eval(self, arguments: Any) -> Any:
            motion = signal(np.array(arguments[0]).ravel())(t)
            matrix = _information(law, t, motion[0], motion[1], noise, rate / DESIGN_RATE)
            limit = bounds.force if np.isfinite(bounds.force) else 1e6
            kept = np.concatenate(
                [
                    (motion[0, ::2] - low) / size,
                    motion[1, ::2] / bounds.speed,
                    _force(law, t, motion)[::2] / limit,
                    used(motion[:, ::2]),
                ]
            )
            return [casadi.DM(cost(matrix, criterion)), casadi.DM(kept)]

    told = Told()
    x = casadi.MX.sym("x", 1 + 3 * sines)
    value, kept = told(x)
    count = len(t[::2])
    top = (bounds.deepest - low) / size
    solver = casadi.nlpsol(
        "search",
        "ipopt",
        {"x": x, "f": value, "g": kept},
        {
            "ipopt.hessian_approximation": "limited-memory",
            "ipopt.max_iter": STEPS,
            "ipopt.tol": 1e-4,
            "ipopt.acceptable_tol": 1e-3,
            "ipopt.acceptable_iter": 4,
            "ipopt.print_level": 0,
            "ipopt.sb": "yes",
            "print_time": False,
        },
    )
    slow = 1.0 / bounds.duration
    begin = np.concatenate([[0.5], *_start(bounds, size, sines, number)])
    found = solver(
        x0=begin,
        lbx=np.concatenate([[0.0], np.full(sines, -0.6), np.full(sines, slow), np.full(sines, -20.0)]),
        ubx=np.concatenate([[1.0], np.full(sines, 0.6), np.full(sines, bounds.bandwidth), np.full(sines, 20.0)]),
        lbg=np.concatenate([np.zeros(count), -np.ones(count), np.full(2 * count, -np.inf)]),
        ubg=np.concatenate([np.full(count, top), np.ones(3 * count)]),
    )
    return signal(np.array(found["x"]).ravel())


def _start(bounds: Bounds, size: float, sines: int, number: int) -> tuple[Array, Array, Array]:
    """Amplitudes by the room's size, frequencies and phases to begin a search with.

    The first start is a swing near the bandwidth, which shows damping; the others are square waves of which the
    bandwidth lets some harmonics through: half the time deep, half the time shallow, which shows stiffness and
    exponent.
    """
    high = 0.9 * bounds.bandwidth
    slow = max(1.0 / bounds.duration, high / 7.0)
    if number == 0:
        frequencies = np.geomspace(max(slow, 0.25 * bounds.bandwidth), high, sines)
        amplitudes = np.full(sines, 0.4 / sines)
    else:
        base = max(slow, high / (2 * number + 1))
        order = 2.0 * np.arange(sines) + 1.0
        frequencies, amplitudes = np.minimum(base * order, high), 0.5 / order
    # no faster together than the speed allows
    fastest = float(np.sum(2 * np.pi * frequencies * amplitudes)) * size
    amplitudes = amplitudes * min(1.0, 0.8 * bounds.speed / fastest)
    return amplitudes, frequencies, np.random.default_rng(number).uniform(-0.2, 0.2, sines)


def _kept(law: Law, bounds: Bounds, signal: Multisine, joints: Joints | None) -> Multisine:
    """The signal drawn towards its start until every sample keeps the bounds, in between those of the search too."""
    t = np.arange(round(signal.duration * 1000)) / 1000
    floor = bounds.shallowest

    def drawn(share: float) -> Multisine:
        depth = floor + max(share, 1e-3) * (min(signal.depth, bounds.deepest) - floor)
        return Multisine(depth, tuple((share * s[0], *s[1:]) for s in signal.sines), signal.duration, signal.fade)

    def keeps(share: float) -> bool:
        motion = drawn(share)(t)
        return bool(
            motion[0].min() >= floor - 1e-12
            and motion[0].max() <= bounds.deepest + 1e-12
            and np.abs(motion[1]).max() <= bounds.speed
            and _force(law, t, motion).max() <= bounds.force
            and (joints is None or joints(motion).max() <= JOINTS)
        )

    if keeps(1.0):
        return signal
    # sines alone first: a swing that touches the floor is mended without losing depth
    low, high = 0.0, 1.0
    for _ in range(40):
        share = 0.5 * (low + high)
        low, high = (share, high) if keeps(share) else (low, share)
    if low == 0.0:
        raise InputError(
            "bounds that no signal keeps", "room for a motion", "allow more depth, force or speed, or faster joints"
        )
    return drawn(low)
