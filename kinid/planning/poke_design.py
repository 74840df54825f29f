"""What a poke is designed for and what it has to keep; simple candidates, and the interior-point search from them.

Variables of the search are the offset and the amplitudes by the room's size, frequencies and phases.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from kinid.errors import InputError
from kinid.parameter import Parameter
from kinid.planning.expected import Law
from kinid.planning.information import OPEN, cost, information, sensitivities
from kinid.planning.signals import FADE, Multisine
from kinid.writers import Json

if TYPE_CHECKING:
    import casadi

Array = NDArray[np.float64]

#: depth and its first three derivatives (4, n) → share of the joints' limits that each sample uses, (n,)
Joints = Callable[[Array], Array]

#: samples a second that the optimisation looks at: 30 for each turn of a 3 Hz sine
DESIGN_RATE = 100.0
#: share of the joints' limits that it is planned for: the mean jerk between samples and the way in and out want some
JOINTS = 0.97
#: a search begins with so much of a candidate's amplitudes: at a bound it would hardly move
INSIDE = 0.8
#: steps of a search
STEPS = 50
#: offsets of the candidates, as shares of the room
OFFSETS = (0.25, 0.5, 0.75, 0.95)
#: halvings of an interval in which a largest amplitude is sought
HALVINGS = 12


#: what no arm does in contact: faster [m/s], in a wider band [Hz], for longer [s]
MOST = {"speed": 10.0, "bandwidth": 1000.0, "duration": 3600.0}


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
        for name, most in MOST.items():
            if getattr(self, name) > most:
                raise InputError(f"a {name} of {getattr(self, name):g}", f"{most:g} at most", "correct it")
        if self.bandwidth * self.duration < 1.0:
            raise InputError(
                f"{self.duration:g} s within a bandwidth of {self.bandwidth:g} Hz",
                "time for one turn at least",
                "allow more time",
            )


@dataclass(frozen=True, eq=False)
class Design:
    """What a poke is designed for.

    Attributes:
        law: the model and the values assumed. bounds: to be kept. sines: how many. criterion: "D" or "A".
        noise: of the normal force, standard deviation at the log's rate [N]. rate: of the log [Hz].
        joints: share of the joints' limits that a motion uses; None for any.
    """

    law: Law
    bounds: Bounds
    sines: int
    criterion: str
    noise: float
    rate: float
    joints: Joints | None = None

    @property
    def parameters(self) -> dict[str, Parameter]:
        """Of the law, by full name."""
        return self.law.model.parameters(self.law.layout())

    def information(self, signal: Multisine, rate: float) -> Array:
        """Fisher's information of relative changes in the normal force, sampled at a rate [Hz], (p, p).

        The normal force alone: nothing slides in a poke.
        """
        t, motion = self._sampled(signal, rate)
        law, signals = self.law, self.law.signals(t, motion[0], motion[1])
        found = sensitivities(lambda values: law.model.predict(signals, values)[:1], law.vector, self.parameters)
        return information(found, np.array([self.noise]), self.rate / rate)

    def cost(self, signal: Multisine) -> float:
        """The criterion, over the parameters that a poke tells."""
        identifiable = self.identifiable
        return cost(self.information(signal, DESIGN_RATE)[np.ix_(identifiable, identifiable)], self.criterion)

    @cached_property
    def identifiable(self) -> NDArray[np.int64]:
        """Numbers of the parameters that a poke within the bounds tells at all: not those of friction, say.

        Raises:
            InputError: none.
        """
        low, high = self.room
        swing = 0.25 * (high - low)
        wide = tuple((swing / k, min(k / self.bounds.duration, self.bounds.bandwidth)) for k in (1.0, 3.0))
        diagonal = np.diag(
            self.information(Multisine(0.5 * (low + high), wide, self.bounds.duration, self.bounds.fade), DESIGN_RATE)
        )
        identifiable = np.flatnonzero(diagonal > OPEN * max(float(diagonal.max()), 1e-300))
        if not len(identifiable):
            raise InputError(f"{self.law.model}, of which a poke tells nothing", "a contact law", "name another model")
        return identifiable

    def force(self, t: Array, motion: Array) -> Array:
        """Expected normal force along a motion (4, n) [N], (n,)."""
        out: Array = self.law(self.law.signals(t, motion[0], motion[1]))[2]
        return out

    @cached_property
    def room(self) -> tuple[float, float]:
        """Depths between which the offset is sought [m]: not deeper than slow motion may press.

        Raises:
            InputError: a force limit that leaves no room.
        """
        bounds = self.bounds
        depth, t = np.linspace(bounds.shallowest, bounds.deepest, 200), np.linspace(0.0, bounds.duration, 200)
        force = self.force(t, np.stack([depth, np.full(200, np.ptp(depth) / bounds.duration)]))
        over = np.flatnonzero(force > bounds.force)
        if len(over) and over[0] < 2:
            raise InputError(
                f"a force limit of {bounds.force:g} N, which is passed at {1e3 * bounds.shallowest:g} mm already",
                "room for a motion",
                "allow more force, or go less deep",
            )
        return bounds.shallowest, float(depth[over[0] - 1]) if len(over) else bounds.deepest

    def keeps(self, signal: Multisine) -> bool:
        """Whether every sample keeps the bounds, in between those of the search too."""
        bounds, (t, motion) = self.bounds, self._sampled(signal, 1000.0)
        return bool(
            motion[0].min() >= bounds.shallowest - 1e-12
            and motion[0].max() <= bounds.deepest + 1e-12
            and np.abs(motion[1]).max() <= bounds.speed
            and self.force(t, motion).max() <= bounds.force
            and (self.joints is None or self.joints(motion).max() <= JOINTS)
        )

    def reached(self, signal: Multisine) -> dict[str, float]:
        """Largest force [N], speed [m/s] and depth [m] of a motion, and the share of the joints' limits."""
        t, motion = self._sampled(signal, 1000.0)
        return {
            "force": float(self.force(t, motion).max()),
            "speed": float(np.abs(motion[1]).max()),
            "deepest": float(motion[0].max()),
            "joints": 0.0 if self.joints is None else float(self.joints(motion).max()) / JOINTS,
        }

    def kept(self, signal: Multisine) -> Multisine | None:
        """The signal, its sines made as much smaller as the bounds ask for; None where even its offset breaks them."""

        def scaled(share: float) -> Multisine:
            return dataclasses.replace(signal, sines=tuple((share * s[0], *s[1:]) for s in signal.sines))

        if self.keeps(signal):
            return signal
        if not self.keeps(scaled(0.0)):
            return None
        low, high = 0.0, 1.0
        for _ in range(HALVINGS):
            share = 0.5 * (low + high)
            low, high = (share, high) if self.keeps(scaled(share)) else (low, share)
        return scaled(low)

    def signal(self, x: Array) -> Multisine:
        """The signal of a search's variables, (1 + 3 · sines,)."""
        low, high = self.room
        size = high - low
        sines = tuple((float(size * a), float(f), float(p)) for a, f, p in x[1:].reshape(3, self.sines).T)
        return Multisine(float(low + size * x[0]), sines, self.bounds.duration, self.bounds.fade)

    def variables(self, signal: Multisine) -> Array:
        """The other way round."""
        low, high = self.room
        a, f, p = np.array(signal.sines).T
        return np.concatenate([[(signal.depth - low) / (high - low)], a / (high - low), f, p])

    def _sampled(self, signal: Multisine, rate: float) -> tuple[Array, Array]:
        t = np.arange(round(signal.duration * rate)) / rate
        return t, signal(t)


def candidates(design: Design) -> list[Multisine]:
    """Simple motions as large as the bounds let them be: of each shape the one whose offset tells most.

    A swing of several sines near the bandwidth and one fast sine show damping; square waves of which the bandwidth
    lets some harmonics through, half the time deep and half the time shallow, show stiffness and exponent.
    """
    bounds, n = design.bounds, design.sines
    high = 0.9 * bounds.bandwidth
    slow = max(1.0 / bounds.duration, high / 7.0)
    order = 2.0 * np.arange(n) + 1.0
    shapes = [
        (np.full(n, 1.0 / n), np.geomspace(max(slow, 0.25 * bounds.bandwidth), high, n)),
        (1.0 / order, np.minimum(max(slow, high / 3.0) * order, high)),
        (np.append(np.full(n - 1, 0.05), 1.0), np.geomspace(slow, high, n)),
        (np.append(1.0, np.full(n - 1, 0.05)), np.geomspace(slow, high, n)),
    ]
    phases = np.random.default_rng(0).uniform(-0.2, 0.2, n)
    found = []
    for amplitudes, frequencies in shapes:
        asked = (design.signal(np.concatenate([[u], amplitudes, frequencies, phases])) for u in OFFSETS)
        kept = [signal for signal in map(design.kept, asked) if signal is not None]
        found += [min(kept, key=design.cost)] if kept else []
    return found


def search(design: Design, begin: Multisine) -> Multisine:
    """One run of the interior-point method from inside of a signal that keeps the bounds.

    What it ends with may break them between samples, and may tell less than its start.
    """
    import casadi

    begin = dataclasses.replace(begin, sines=tuple((INSIDE * s[0], *s[1:]) for s in begin.sines))

    bounds, sines, (low, high) = design.bounds, design.sines, design.room
    count = len(np.arange(round(bounds.duration * DESIGN_RATE))[::2])
    callback = _casadi_callback(design, count)
    x = casadi.MX.sym("x", 1 + 3 * sines)
    value, kept = callback(x)
    options: Json = {
        "ipopt.hessian_approximation": "limited-memory",
        "ipopt.max_iter": STEPS,
        "ipopt.tol": 1e-4,
        "ipopt.acceptable_tol": 1e-3,
        "ipopt.acceptable_iter": 4,
        "ipopt.print_level": 0,
        "ipopt.sb": "yes",
        "print_time": False,
    }
    problem: dict[str, casadi.MX] = {"x": x, "f": value, "g": kept}
    solver = casadi.nlpsol("search", "ipopt", problem, options)
    top, slow = (bounds.deepest - low) / (high - low), 1.0 / bounds.duration
    found = solver(
        x0=design.variables(begin),
        lbx=np.concatenate([[0.0], np.full(sines, -0.6), np.full(sines, slow), np.full(sines, -20.0)]),
        ubx=np.concatenate([[1.0], np.full(sines, 0.6), np.full(sines, bounds.bandwidth), np.full(sines, 20.0)]),
        lbg=np.concatenate([np.zeros(count), -np.ones(count), np.full(2 * count, -np.inf)]),
        ubg=np.concatenate([np.full(count, top), np.ones(3 * count)]),
    )
    return design.signal(np.array(found["x"]).ravel())


def _casadi_callback(design: Design, count: int) -> casadi.Callback:
    """Criterion, then depth, speed, force and joints at every other sample, each by its bound, as casadi asks it."""
    import casadi

    bounds, (low, high) = design.bounds, design.room
    t = (np.arange(round(bounds.duration * DESIGN_RATE)) / DESIGN_RATE)[::2]
    limit = bounds.force if np.isfinite(bounds.force) else 1e6

    class CriterionAndBounds(casadi.Callback):
        def __init__(self) -> None:
            casadi.Callback.__init__(self)
            self.construct("criterion_and_bounds", {"enable_fd": True, "fd_method": "forward"})

        def get_n_in(self) -> int:
            return 1

        def get_n_out(self) -> int:
            return 2

        def get_sparsity_in(self, _: int) -> casadi.Sparsity:
            return casadi.Sparsity.dense(1 + 3 * design.sines, 1)

        def get_sparsity_out(self, i: int) -> casadi.Sparsity:
            return casadi.Sparsity.dense(1 if i == 0 else 4 * count, 1)

        def eval(self, arguments: Sequence[casadi.DM]) -> list[casadi.DM]:
            signal = design.signal(np.array(arguments[0]).ravel())
            motion = signal(t)
            used = np.zeros(count) if design.joints is None else design.joints(motion) / JOINTS
            depth = (motion[0] - low) / (high - low)
            kept = np.concatenate([depth, motion[1] / bounds.speed, design.force(t, motion) / limit, used])
            return [casadi.DM(design.cost(signal)), casadi.DM(kept)]

    return CriterionAndBounds()
