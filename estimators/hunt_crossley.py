"""Hunt-Crossley contact, f = K xⁿ + B xⁿ ẋ, estimated online in one stage or in two (Hunt & Crossley 1975)."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from kinid.errors import InputError
from kinid.estimators._contact import COLUMNS, ContactEstimator, ContactMachine
from kinid.estimators._machine import Machine, Memory, covariance, stop_clock
from kinid.estimators.estimate import SAMPLE, Array, Prior
from kinid.estimators.excitation import Excitation
from kinid.estimators.forgetting import Constant, Forgetting
from kinid.estimators.offset import Offset
from kinid.kernels import contact_laws

NAMES = ("stiffness", "damping", "exponent")  # K [N/mⁿ], B [N·s/mⁿ⁺¹], n [1]
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
        accuracy: half width of the 95 % intervals of K and B in a valid estimate, as a share of each; inf asks for
            excitation alone. A B that is known to K·1 ms, a delay of one sample, is known well enough.

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
    accuracy: float = 0.15

    def __post_init__(self) -> None:
        if not (math.isfinite(self.noise) and self.noise >= 0.0):
            raise InputError(f"a force noise of {self.noise} N", "a finite number ≥ 0", "give the sensor's noise")
        for name in ("reference_depth", "fastest", "loudest", "accuracy"):
            value = getattr(self, name)
            if not (value > 0.0 and (math.isfinite(value) or name == "accuracy")):
                raise InputError(f"{name} = {value}", "a positive number", "use the default")

    def law(self, weighted: bool) -> tuple[float, ...]:
        """What the kernels are told."""
        accuracy = (self.accuracy, self.accuracy, math.inf, 0.0, SAMPLE, 0.0)  # of n none is asked
        return self.noise, math.log(self.reference_depth), self.fastest, self.loudest, float(weighted), *accuracy


@dataclass(frozen=True)
class SingleStage(HuntCrossley):
    """ln f = ln K + (B/K) ẋ + n ln x: one recursive least squares, linear in [ln K, B/K, n].

    Haddadi & Hashtrudi-Zaad 2008 (IROS), 2012 (IEEE T-RO 28(3):555-566). It rests on |ẋ| < 0.1 K/B, where
    ln(1 + B ẋ/K) ≈ B ẋ/K, and on K xⁿ > 10 ε, where noise of the logarithm is small and even. A sample is not used
    where f ≤ 10 ε, or where even the low end of B/K's interval calls it too fast.

    Args:
        weighted: weigh each sample with its predicted force, since the logarithm makes noise of small forces large;
            `noise` of the estimate is then in newtons, else relative. The literature doesn't weigh.
        offset: the sensor's zero [N], of which intervals know; None for one that is exact.
    """

    weighted: bool = True
    offset: Offset | None = field(default_factory=Offset)

    def _machine(self) -> Machine:
        return _SingleStageMachine(self)


@dataclass(frozen=True)
class TwoStage(HuntCrossley):
    """K and B from f = K xⁿ + B xⁿ ẋ with the last n; n from ln f − ln(K + B ẋ) = n ln x with the last K and B.

    Diolaiti, Melchiorri & Stramigioli 2005 (IEEE T-RO 21(5):925-935). No approximation for speed, but each stage takes
    the other's values for true: it converges slowly where ln x/r is one-sided. It has to forget: rows that were made
    with a wrong n stay for good where nothing is forgotten (K 20 % and n 3 % too large in the laboratory).
    """

    def _machine(self) -> Machine:
        return _TwoStageMachine(self)


class _HuntCrossleyMachine(ContactMachine):
    """What both machines share."""

    def __init__(self, settings: HuntCrossley, memory: Memory, weighted: bool) -> None:
        super().__init__(
            NAMES,
            memory,
            settings.forgetting,
            settings.excitation,
            COLUMNS,
            flags=1,
            settings=settings.law(weighted),
            conditions=CONDITIONS,
        )
        self._log_r = math.log(settings.reference_depth)


class _SingleStageMachine(_HuntCrossleyMachine):
    """One regression of three parameters."""

    def __init__(self, settings: SingleStage) -> None:
        # prior variances are weighed against the noise of a row: newtons where weighted, else of the logarithm
        noise = max(settings.noise, 1e-6) if settings.weighted else 0.01
        prior = logarithmic(settings.prior, math.log(settings.reference_depth), noise)
        super().__init__(settings, Memory.of(prior, settings.covariance_limit, settings.offset), settings.weighted)

    @property
    def kernels(self) -> tuple[Callable[..., None], Callable[..., None]]:
        from kinid.estimators._contact_kernels import single_stage, single_stage_once

        return single_stage, single_stage_once

    def covariance(self, state: Array) -> Array:
        return _of_one(state, self._log_r)

    def restart(self) -> None:
        stop_clock(self.room.state, len(NAMES))


class _TwoStageMachine(_HuntCrossleyMachine):
    """A regression of K and B, and one of n."""

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
        self._split = len(first.state)
        both = Memory(np.concatenate([first.state, second.state]), np.concatenate([first.limit, second.limit]))
        super().__init__(settings, both, False)

    @property
    def kernels(self) -> tuple[Callable[..., None], Callable[..., None]]:
        from kinid.estimators._contact_kernels import two_stage, two_stage_once

        return two_stage, two_stage_once

    def covariance(self, state: Array) -> Array:
        return _of_two(state[: self._split], state[self._split :], self._log_r)


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


def _of_one(state: Array, log_r: float) -> Array:
    """Covariance of K, B, n from a state of ln(K rⁿ), B/K, n, to first order."""
    a, b, n = state[:3]
    k = math.exp(min(max(a - n * log_r, -200.0), 200.0))
    return _sandwich([[k, 0.0, -k * log_r], [b * k, k, -b * k * log_r], [0.0, 0.0, 1.0]], covariance(state, 3))


def _of_two(first: Array, second: Array, log_r: float) -> Array:
    """Covariance of K, B, n from states of K rⁿ, B rⁿ and of n, which know nothing of each other."""
    unit = math.exp(min(max(-second[0] * log_r, -200.0), 200.0))
    k, b = first[:2] * unit
    inner = np.zeros((3, 3))
    inner[:2, :2], inner[2:, 2:] = covariance(first, 2), covariance(second, 1)
    return _sandwich([[unit, 0.0, -k * log_r], [0.0, unit, -b * log_r], [0.0, 0.0, 1.0]], inner)


def _sandwich(jacobian: list[list[float]], inner: Array) -> Array:
    """J C Jᵀ; all of it infinite where C isn't finite yet."""
    if not np.isfinite(inner).all():
        return np.full((3, 3), np.inf)
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
