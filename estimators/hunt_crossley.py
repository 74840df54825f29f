"""Hunt-Crossley contact, f = K xⁿ + B xⁿ ẋ, estimated online in one stage or in two (Hunt & Crossley 1975)."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from kinid.errors import InputError
from kinid.estimators import _store
from kinid.estimators._contact import COLUMNS, ContactEstimator, ContactMachine
from kinid.estimators._machine import Machine, Memory, covariance, stop_clock
from kinid.estimators.estimate import SAMPLE, Array, Prior
from kinid.estimators.excitation import Excitation
from kinid.estimators.forgetting import Constant, Forgetting
from kinid.estimators.offset import Offset
from kinid.kernels import contact_laws

NAMES = ("stiffness", "damping", "exponent")  # K [N/mⁿ], B [N·s/mⁿ⁺¹], n [1]
GROWTH = ("growth",)  # of ln K [1/s], where it is estimated
#: standard deviation of that rate in a second opinion [1/s], and room that its kernel needs
FASTEST_GROWTH, ROOM = 1.0, 12
CONDITIONS = ("speed", "noise")  # |ẋ| < 0.1 K/B, and K xⁿ > 10 ε

#: without a prior: ln(K rⁿ / 1 N), B/K [s/m] and n, and their standard deviations
COLD = (0.0, 0.0, 1.5), (10.0, 10.0, 1.0)


@dataclass(frozen=True)
class HuntCrossley(ContactEstimator):
    """What both estimators are told.

    Args:
        noise: ε, standard deviation of the force [N]; with 0 every force above 1 nN is used.
        forgetting, covariance_limit, excitation: as in `RecursiveLeastSquares`.
        prior: of K, B, n, as from `Prior.near`; None for a cold start.
        reference_depth: r [m], a depth like those of the log. The estimators work with ln(x/r): with x in metres ln x
            lies near −4, hard to tell from a constant. 1 is the form of the literature.
        fastest: largest |ẋ| B/K of a valid sample. ln(1 + e) ≈ e is 5 % off at e = 0.1, the force 0.5 %.
        loudest: smallest K xⁿ/ε of a valid sample.
        accuracy: half width of the 95 % intervals in a valid estimate, as a share of the value: of K and B alike, or of
            each of K, B and n; inf asks for excitation alone. A B that is known to K·1 ms, a delay of one sample, is
            known well enough. Intervals are no narrower than estimates of different samples scatter (see `scatter` of
            the kernels), where the past is forgotten.

    Raises:
        InputError: a number outside its range, a prior of another size or without stiffness.
    """

    noise: float = 0.02
    forgetting: Forgetting = field(default_factory=lambda: Constant(0.995))
    prior: Prior | None = None
    covariance_limit: float | None = 1.0
    excitation: Excitation | None = field(default_factory=Excitation)
    reference_depth: float = 0.01
    fastest: float = 0.1
    loudest: float = 10.0
    accuracy: float | tuple[float, float, float] = 0.15

    def __post_init__(self) -> None:
        if not (math.isfinite(self.noise) and self.noise >= 0.0):
            raise InputError(f"a force noise of {self.noise} N", "a finite number ≥ 0", "give the sensor's noise")
        for name in ("reference_depth", "fastest", "loudest"):
            value = getattr(self, name)
            if not (math.isfinite(value) and value > 0.0):
                raise InputError(f"{name} = {value}", "a positive number", "use the default")
        shares(self.accuracy, (True, True, False))

    def law(self, weighted: bool, more: int = 0) -> tuple[float, ...]:
        """What the kernels are told, of `more` values beside K, B and n."""
        asked = (*shares(self.accuracy, (True, True, False)), *(math.inf,) * more)
        floors = (0.0, SAMPLE, 0.0, *(0.0,) * more)
        return self.noise, math.log(self.reference_depth), self.fastest, self.loudest, float(weighted), *asked, *floors


def shares(accuracy: float | tuple[float, float, float], alone: tuple[bool, bool, bool]) -> tuple[float, ...]:
    """What is asked of K, B and n: of each its own, or a number of those it is asked of alone.

    Raises:
        InputError: no positive numbers, or not three.
    """
    asked = tuple(np.atleast_1d(np.asarray(accuracy, dtype=float)).tolist())
    if len(asked) not in (1, 3) or not all(share > 0.0 for share in asked):
        raise InputError(f"accuracy = {accuracy}", "a positive number, or one each of K, B and n", "use the default")
    return asked if len(asked) == 3 else tuple(asked[0] if one else math.inf for one in alone)


@dataclass(frozen=True)
class SingleStage(HuntCrossley):
    """ln f = ln K + (B/K) ẋ + n ln x: one recursive least squares, linear in [ln K, B/K, n].

    Haddadi & Hashtrudi-Zaad 2008 (IROS), 2012 (IEEE T-RO 28(3):555-566). It rests on |ẋ| < 0.1 K/B, where
    ln(1 + B ẋ/K) ≈ B ẋ/K, and on K xⁿ > 10 ε, where noise of the logarithm is small and even. A sample is not used
    where f ≤ 10 ε, or where even the low end of B/K's interval calls it too fast.

    A stiffness that grows within the memory looks like curvature, and B takes up what is left: 10 % a second and a
    memory of 0.1 s put B 15 % off. With `growth` the rate at which ln K grows is estimated along, as a fourth value
    [1/s]: the past is seen from now, ln K(t) = ln K + growth · (t − now). Then the memory can be long: as long as that
    line is straight within the noise. Without it, intervals know by how much values differ from those with it.

    Args:
        weighted: weigh each sample with its predicted force, since the logarithm makes noise of small forces large;
            `noise` of the estimate is then in newtons, else relative. The literature doesn't weigh.
        offset: the sensor's zero [N], of which intervals know; None for one that is exact.
        growth: standard deviation of the rate at which ln K may grow or shrink [1/s]; 0 for a material that stays.

    Raises:
        InputError: a growth that is negative or not finite; and as `HuntCrossley`.
    """

    weighted: bool = True
    offset: Offset | None = field(default_factory=Offset)
    growth: float = 0.0

    def __post_init__(self) -> None:
        super().__post_init__()
        if not (math.isfinite(self.growth) and self.growth >= 0.0):
            raise InputError(f"growth = {self.growth} 1/s", "a finite number ≥ 0", "use 0 for a material that stays")

    def _machine(self) -> Machine:
        return _SingleStageMachine(self)


@dataclass(frozen=True)
class TwoStage(HuntCrossley):
    """K and B from f = K xⁿ + B xⁿ ẋ with the last n; n from ln f − ln(K + B ẋ) = n ln x with the last K and B.

    Diolaiti, Melchiorri & Stramigioli 2005 (IEEE T-RO 21(5):925-935). No approximation for speed, but each stage takes
    the other's values for true: it converges slowly where ln x/r is one-sided. It has to forget: rows that were made
    with a wrong n stay for good where nothing is forgotten (K 20 % and n 3 % too large in the laboratory). So no
    estimate is valid before the start is forgotten, three memories later.
    """

    def _machine(self) -> Machine:
        return _TwoStageMachine(self)


class _HuntCrossleyMachine(ContactMachine):
    """What both machines share."""

    def __init__(
        self,
        settings: HuntCrossley,
        memory: Memory,
        weighted: bool,
        more: tuple[str, ...],
        limits: Array,
    ) -> None:
        super().__init__(
            (*NAMES, *more),
            memory,
            settings.forgetting,
            settings.excitation,
            COLUMNS,
            flags=1,
            settings=(*settings.law(weighted, len(more)), *limits.tolist()),
            conditions=CONDITIONS,
        )
        self._log_r = math.log(settings.reference_depth)

    #: of the state
    _watch: slice

    @property
    def watch(self) -> Array:
        view: Array = self.room.state[self._watch]
        return view

    def restart(self) -> None:
        self.watch[-1] = math.nan


class _SingleStageMachine(_HuntCrossleyMachine):
    """One regression of three parameters, and a second opinion; or of four."""

    def __init__(self, settings: SingleStage) -> None:
        # prior variances are weighed against the noise of a row: newtons where weighted, else of the logarithm
        noise = max(settings.noise, 1e-6) if settings.weighted else 0.01
        prior = logarithmic(settings.prior, math.log(settings.reference_depth), noise)
        grows = settings.growth > 0.0
        own = _growing(prior, settings.growth) if grows else prior
        memory = Memory.of(own, settings.covariance_limit, settings.offset)
        other = Memory.of(_growing(prior, FASTEST_GROWTH), settings.covariance_limit)
        more = [_watch(4)] if grows else [other.state, np.zeros(ROOM), _watch(3)]
        end = len(memory.state) - _store.TALLY
        self._watch = slice(end + sum(map(len, more[:-1])), end + sum(map(len, more)))
        self._end = end
        state = np.concatenate([memory.state[:end], *more, memory.state[end:]])
        super().__init__(
            settings, memory._replace(state=state), settings.weighted, GROWTH if grows else (), other.limit
        )

    @property
    def kernels(self) -> tuple[Callable[..., None], Callable[..., None]]:
        from kinid.estimators._contact_kernels import single_stage, single_stage_once

        return single_stage, single_stage_once

    def covariance(self, state: Array) -> Array:
        own = np.concatenate([state[: self._end], state[-_store.TALLY :]])
        return _widened(_stated(own, len(self.names), self._log_r), state[self._watch])

    def restart(self) -> None:
        super().restart()
        p = len(self.names)
        stop_clock(self.room.state[: self._end + _store.TALLY], p)


class _TwoStageMachine(_HuntCrossleyMachine):
    """A regression of K and B, one of n, and a second opinion of all."""

    def __init__(self, settings: TwoStage) -> None:
        log = logarithmic(settings.prior, math.log(settings.reference_depth), 1.0)
        noise = settings.prior.noise if settings.prior else max(settings.noise, 1e-6)
        unit = math.exp(log.values[0])  # K rⁿ and B rⁿ, and what ln and ratio say of their errors
        values = unit * np.array([1.0, log.values[1]])
        jacobian = unit * np.array([[1.0, 0.0], [log.values[1], 1.0]])
        first = Memory.of(
            Prior(values, jacobian @ log.covariance[:2, :2] @ jacobian.T, noise), settings.covariance_limit
        )
        second = Memory.of(Prior(log.values[2:], log.covariance[2:, 2:], 0.01), settings.covariance_limit)
        prior = Prior(log.values, log.covariance, noise)
        other = Memory.of(_growing(prior, FASTEST_GROWTH), settings.covariance_limit)
        parts = [first.state, other.state, np.zeros(ROOM), _watch(3), second.state]
        ends = np.cumsum([len(part) for part in parts])
        self._other, self._watch = slice(ends[0], ends[1]), slice(ends[2], ends[3])
        both = Memory(np.concatenate(parts), np.concatenate([first.limit, second.limit]))
        super().__init__(settings, both, False, (), other.limit)

    @property
    def kernels(self) -> tuple[Callable[..., None], Callable[..., None]]:
        from kinid.estimators._contact_kernels import two_stage, two_stage_once

        return two_stage, two_stage_once

    def covariance(self, state: Array) -> Array:
        return _widened(_stated(state[self._other], 4, self._log_r)[:3, :3], state[self._watch])


def _growing(prior: Prior, rate: float) -> Prior:
    """A prior of ln(K rⁿ), B/K, n as one with the rate at which ln K grows, known to a standard deviation [1/s]."""
    covariance = np.pad(prior.covariance, (0, 1))
    covariance[3, 3] = rate**2
    return Prior(np.append(prior.values, 0.0), covariance, prior.noise)


def _watch(p: int) -> Array:
    """What kernels watch p values by, before the first sample."""
    out = np.zeros(4 * p + 3)
    out[-1] = math.nan  # time of the last
    return out


def logarithmic(prior: Prior | None, log_r: float, noise: float) -> Prior:
    """A prior of K, B, n as one of ln(K rⁿ), B/K, n; without a prior a cold start, weighed against `noise`.

    Raises:
        InputError: another number of values, a stiffness that isn't positive.
    """
    if prior is None:
        values, deviations = COLD
        return Prior(np.array(values), np.square(deviations), noise)
    if len(prior.values) != 3 or not prior.values[0] > 0.0:
        raise InputError(f"a prior of values {prior.values}", "stiffness > 0, damping, exponent", "give those three")
    k, b, n = prior.values
    jacobian = np.array([[1.0 / k, 0.0, log_r], [-b / k**2, 1.0 / k, 0.0], [0.0, 0.0, 1.0]])
    return Prior(np.array([math.log(k) + n * log_r, b / k, n]), jacobian @ prior.covariance @ jacobian.T, prior.noise)


def _stated(state: Array, p: int, log_r: float) -> Array:
    """Covariance of K, B, n, and further values, from a state of ln(K rⁿ), B/K, n, …, to first order."""
    a, b, n = state[:3]
    k = math.exp(min(max(a - n * log_r, -200.0), 200.0))
    jacobian = np.eye(p)
    jacobian[:2, :3] = [[k, 0.0, -k * log_r], [b * k, k, -b * k * log_r]]
    return _sandwich(jacobian, covariance(state, p))


def _widened(inner: Array, watch: Array) -> Array:
    """A covariance (p, p) as wide as the kernels' watch has it."""
    p = len(inner)
    wide = np.sqrt(np.maximum(watch[3 * p : 4 * p], 1.0))
    return np.asarray(inner * np.outer(wide, wide))


def _sandwich(jacobian: Array, inner: Array) -> Array:
    """J C Jᵀ; all of it infinite where C isn't finite yet."""
    if not np.isfinite(inner).all():
        return np.full_like(inner, np.inf)
    return np.asarray(jacobian @ inner @ np.transpose(jacobian))


def force(depth: Array, depth_rate: Array, stiffness: Any, damping: Any, exponent: Any) -> Array:
    """Normal force [N] of the law where the depth is positive, else 0; all broadcast."""
    x = np.maximum(np.asarray(depth, dtype=np.float64), 0.0)
    return np.asarray(contact_laws.hunt_crossley(x**exponent * (x > 0.0), np.asarray(depth_rate), stiffness, damping))


def restitution(stiffness: float, damping: float, speed: float) -> float:
    """Coefficient of restitution of a free impact at `speed` [m/s], to first order in it, for any exponent.

    e ≈ 1 − α v with α = 2 B/(3 K) (Hunt & Crossley 1975, J. Appl. Mech. 42(2):440-445).
    """
    return 1.0 - 2.0 * damping * speed / (3.0 * stiffness)
