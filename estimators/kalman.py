"""Hunt-Crossley contact with a surface whose position is not known, by extended Kalman filters."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from kinid.errors import InputError
from kinid.estimators._contact import COLUMNS, ContactEstimator, ContactMachine
from kinid.estimators._machine import Memory, unit_covariance
from kinid.estimators.estimate import SAMPLE, Array, Prior
from kinid.estimators.excitation import Excitation
from kinid.estimators.forgetting import Constant
from kinid.estimators.hunt_crossley import shares

NAMES = ("stiffness", "damping", "exponent", "surface")

#: without a prior: depth at 1 N over the reference depth, B/K [s/m], 1/n, and their standard deviations
COLD = (0.5, 0.0, 0.72), (0.5, 0.3, 0.14)

#: numbers of the watch over the bank, at the end of its state (see `_kalman_kernels`)
WATCH = 6


@dataclass(frozen=True)
class HuntCrossleyKalman(ContactEstimator):
    """f = K (x + z)ⁿ (1 + (B/K) ẋ) with z [m] unknown: the tip is z deeper than the depth says.

    The law is turned round, x = c (f/(1 + b ẋ))^m − z with m = 1/n, which is linear in c and z wherever the surface is;
    force noise becomes depth noise by the slope of the law. What is left of nonlinearity is the exponent, so a bank of
    filters shares it out, each for a narrow range, weighed by how well it predicts (Gaussian sum, Alspach & Sorenson
    1972, IEEE T-AC 17(4):439-448). Members that are refuted cost nothing more. The first samples fade: they were
    linearised where nothing was known yet. Air tells nothing here. Covariances are kept as U·diag(d)·Uᵀ and
    rest on `noise`; the estimate's own `noise` is measured, and three times more is marked as misfit. Depth noise has
    to be small beside noise/(df/dx).

    A filter that has lost its way goes on believing its covariance. So the innovations ν, each over the standard
    deviation that the filter expects, are watched over the last `patience` samples used: in a sound filter they are
    white with variance 1; where the filter lags behind the material, or took a wrong turn, they are large and stay on
    one side from sample to sample. Samples at which the mean of ν ν′ (ν′ the one before) exceeds 2, and half the mean
    of ν², are marked as diverged. Noise of the stated size can't reach 2, whatever its colour, and white noise that is
    larger than stated can't reach the half.

    Args:
        noise: ε, standard deviation of the force [N], > 0.
        prior: of K, B, n, as from `Prior.near`; None for a cold start.
        surface: standard deviation of z at the start [m]. Rather too large than too small.
        walk: standard deviations that ln K, B/K [s/m], n and z [m] gain in a second.
        period: sample time [s] where no time is given.
        reference_depth: a depth like those of the log [m].
        loudest: samples with less than this times ε are not used.
        members: filters in the bank; 1 is a plain extended Kalman filter.
        patience: memory of the watch over the innovations [samples used], > 1; nothing is marked as diverged before.
        fading: first samples weigh 1 − fading[0]·exp(−i/fading[1]) less with each later one.
        accuracy: half width of 95 % intervals in a valid estimate, as a share of the value: of n alone, or of each of
            K, B and n; inf asks for excitation alone. A B that is known to K·1 ms is known well enough.
        excitation: measured on [p, p ẋ, p ln f, 1] with p = f^m.

    Raises:
        InputError: a number outside its range, a prior of another size or without stiffness.
    """

    noise: float = 0.02
    prior: Prior | None = None
    surface: float = 0.005
    walk: tuple[float, float, float, float] = (0.0, 0.0, 0.0, 0.0)
    period: float = 1e-3
    reference_depth: float = 0.01
    loudest: float = 10.0
    members: int = 5
    patience: int = 200
    fading: tuple[float, float] = (0.02, 1000.0)
    accuracy: float | tuple[float, float, float] = 0.05
    excitation: Excitation | None = field(default_factory=lambda: Excitation(window=500, threshold=0.005))

    def __post_init__(self) -> None:
        for name in ("noise", "surface", "period", "reference_depth", "loudest", "members"):
            value = getattr(self, name)
            if not (math.isfinite(value) and value > 0.0):
                raise InputError(f"{name} = {value}", "a positive number", "use the default or the sensor's data")
        shares(self.accuracy, (False, False, True))
        if not self.patience > 1:
            raise InputError(f"patience = {self.patience}", "a number of samples > 1", "use the default")
        if len(self.walk) != 4 or not all(math.isfinite(w) and w >= 0.0 for w in self.walk):
            raise InputError(f"walk = {self.walk}", "four finite numbers ≥ 0", "use 0 for what doesn't move")
        if len(self.fading) != 2 or not (0.0 <= self.fading[0] < 1.0 and self.fading[1] > 0.0):
            raise InputError(f"fading = {self.fading}", "0 ≤ first < 1 and second > 0", "use the default")

    def _machine(self) -> _KalmanMachine:
        return _KalmanMachine(self)


class _KalmanMachine(ContactMachine):
    """A bank of filters, and the watch over them."""

    def __init__(self, settings: HuntCrossleyKalman) -> None:
        self._r = settings.reference_depth
        mean, covariance = _inverted(settings.prior, self._r)
        values = np.append(mean, 0.0)
        start = np.zeros((4, 4))
        start[:3, :3], start[3, 3] = covariance, (settings.surface / self._r) ** 2
        members = _bank(values, start, settings.members)
        self._members = len(members)
        memory = Memory(
            np.concatenate(
                [
                    *(Memory.of(prior, None).state for _, prior in members),
                    [weight for weight, _ in members],
                    [0.0, 0.0, 0.0, 0.0, math.nan, 0.0],
                ]
            ),
            np.maximum(np.max([np.diagonal(prior.covariance) for _, prior in members], axis=0), 1e-300),
        )
        accuracy = (*shares(settings.accuracy, (False, False, True)), math.inf, 0.0, SAMPLE, 0.0, 0.0)
        fixed = (settings.noise, math.log(self._r), settings.loudest, settings.period, float(settings.patience))
        super().__init__(
            NAMES,
            memory,
            Constant(),
            settings.excitation,
            COLUMNS,
            flags=1,
            settings=(*fixed, *settings.walk, *settings.fading, *accuracy),
        )

    @property
    def kernels(self) -> tuple[Callable[..., None], Callable[..., None]]:
        from kinid.estimators._kalman_kernels import kalman, kalman_once

        return kalman, kalman_once

    def restart(self) -> None:
        """The next sample is `period` after the last."""
        self.room.state[-2] = math.nan

    def covariance(self, state: Array) -> Array:
        """Of K, B, n, z from the members' states and the logarithms of their weights, to first order."""
        size = (len(state) - WATCH) // self._members - 1
        states = state[: self._members * size].reshape(self._members, size)
        weights = state[self._members * size : -WATCH]
        share = np.where(weights > -50.0, np.exp(weights), 0.0)
        share /= share.sum()
        theta, best = states[:, :4], states[np.argmax(weights)]
        own = unit_covariance(best, 4)
        mean = best[:4] + (own[2] / own[2, 2] if own[2, 2] > 0.0 else 0.0) * (share @ theta[:, 2] - best[2])
        mean[0], mean[2] = min(max(mean[0], 1e-3), 1e3), share @ theta[:, 2]
        total = np.einsum("i,ij,ik->jk", share, theta - mean, theta - mean)
        for part, member in zip(share, states):
            total += part * unit_covariance(member, 4)
        c, b, m, _ = mean
        n, log_c = 1.0 / m, math.log(self._r * c)
        k = math.exp(min(max(-n * log_c, -200.0), 200.0))
        slope = np.array([-n / c, 0.0, n * n * log_c, 0.0])
        jacobian = np.array(
            [k * slope, b * k * slope + [0.0, k, 0.0, 0.0], [0.0, 0.0, -n * n, 0.0], [0.0, 0.0, 0.0, self._r]]
        )
        return np.asarray(jacobian @ total @ jacobian.T)


def _inverted(prior: Prior | None, r: float) -> tuple[Array, Array]:
    """Mean and covariance of [K^(−1/n)/r, B/K, 1/n] from those of K, B, n."""
    if prior is None:
        values, deviations = COLD
        return np.array(values), np.diag(np.square(deviations))
    if len(prior.values) != 3 or not (prior.values[0] > 0.0 and prior.values[2] > 0.0):
        raise InputError(
            f"a prior of values {prior.values}", "stiffness > 0, damping, exponent > 0", "give those three"
        )
    k, b, n = prior.values
    c = k ** (-1.0 / n) / r
    jacobian = np.array(
        [[-c / (n * k), 0.0, c * math.log(k) / n**2], [-b / k**2, 1.0 / k, 0.0], [0.0, 0.0, -1.0 / n**2]]
    )
    return np.array([c, b / k, 1.0 / n]), jacobian @ prior.covariance @ jacobian.T


def _bank(values: Array, covariance: Array, members: int) -> list[tuple[float, Prior]]:
    """The Gaussian of [c, b, m, z] as a sum of narrower ones along m, each with the logarithm of its weight."""
    variance = covariance[2, 2]
    if members == 1 or variance <= 0.0:
        return [(0.0, Prior(values, covariance))]
    apart = 4.0 / members  # standard deviations; the members reach from −2 to 2
    along = covariance[:, 2] / variance
    narrow = (0.6 * apart) ** 2 * variance
    rest = covariance - np.outer(along, along) * (variance - narrow)
    places = (np.arange(members) + 0.5) * apart - 2.0
    return [(-0.5 * s * s, Prior(values + along * s * math.sqrt(variance), rest)) for s in places]
