"""Hunt-Crossley contact with a surface whose position is not known, by extended Kalman filters."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial

import numpy as np

from kinid.errors import InputError
from kinid.estimators._machine import Columns, Machine, Memory, Online, Out, contact_columns, one_contact, unit_covariance
from kinid.estimators.estimate import Array, Mask, Prior, Track
from kinid.estimators.excitation import Excitation
from kinid.estimators.forgetting import Constant

NAMES = ("stiffness", "damping", "exponent", "surface")

#: without a prior: depth at 1 N over the reference depth, B/K [s/m], 1/n, and their standard deviations
COLD = (0.5, 0.0, 0.72), (0.5, 0.3, 0.14)


@dataclass(frozen=True)
class HuntCrossleyKalman:
    """f = K (x + z)ⁿ (1 + (B/K) ẋ) with z [m] unknown: the tip is z deeper than the depth says.

    The law is turned round, x = c (f/(1 + b ẋ))^m − z with m = 1/n, which is linear in c and z wherever the surface is;
    force noise becomes depth noise by the slope of the law. What is left of nonlinearity is the exponent, so a bank of
    filters shares it out, each for a narrow range, weighed by how well it predicts (Gaussian sum, Alspach & Sorenson
    1972, IEEE T-AC 17(4):439-448). Members that are refuted cost nothing more. The first samples fade: they were
    linearised where nothing was known yet. Air tells nothing here. Covariances are kept as U·diag(d)·Uᵀ and
    rest on `noise`; the estimate's own `noise` is measured, and three times more is marked as misfit. Depth noise has
    to be small beside noise/(df/dx).

    Args:
        noise: ε, standard deviation of the force [N], > 0.
        prior: of K, B, n, as from `Prior.near`; None for a cold start.
        surface: standard deviation of z at the start [m]. Rather too large than too small.
        walk: standard deviations that ln K, B/K [s/m], n and z [m] gain in a second.
        period: sample time [s] where no time is given.
        reference_depth: a depth like those of the log [m].
        loudest: samples with less than this times ε are not used.
        members: filters in the bank; 1 is a plain extended Kalman filter.
        fading: first samples weigh 1 − fading[0]·exp(−i/fading[1]) less with each later one.
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
    fading: tuple[float, float] = (0.02, 1000.0)
    excitation: Excitation | None = field(default_factory=lambda: Excitation(window=500, threshold=0.005))

    def __post_init__(self) -> None:
        for name in ("noise", "surface", "period", "reference_depth", "loudest", "members"):
            value = getattr(self, name)
            if not (math.isfinite(value) and value > 0.0):
                raise InputError(f"{name} = {value}", "a positive number", "use the default or the sensor's data")
        if len(self.walk) != 4 or not all(math.isfinite(w) and w >= 0.0 for w in self.walk):
            raise InputError(f"walk = {self.walk}", "four finite numbers ≥ 0", "use 0 for what doesn't move")
        if len(self.fading) != 2 or not (0.0 <= self.fading[0] < 1.0 and self.fading[1] > 0.0):
            raise InputError(f"fading = {self.fading}", "0 ≤ first < 1 and second > 0", "use the default")

    def run(
        self, depth: Array, depth_rate: Array, normal_force: Array, t: Array | None = None,
        in_contact: Mask | None = None,
    ) -> Track:  # fmt: skip
        """All samples of a log.

        Args:
            depth: [m], (n,), from where the surface is believed to be.
            depth_rate: [m/s], (n,).
            normal_force: [N], (n,).
            t: time [s], (n,); by default samples are `period` apart.
            in_contact: False where a sample is known to be in the air, (n,).

        Raises:
            InputError: shapes that don't fit, no samples, time that doesn't grow.
        """
        time, columns = contact_columns(t, depth, depth_rate, normal_force, in_contact)
        return _KalmanMachine(self).run(columns, time)

    def online(self) -> Online:
        """`update(depth, depth_rate, normal_force, [in_contact,] t=…)` → `Estimate`."""
        return Online(_KalmanMachine(self), *one_contact())


class _KalmanMachine(Machine):
    """Columns: depth, depth rate, force, contact."""

    def __init__(self, settings: HuntCrossleyKalman) -> None:
        super().__init__(NAMES, 4, Constant(), settings.excitation)
        self._r = settings.reference_depth
        self._walk, self._period, self._fading = settings.walk, settings.period, settings.fading
        self._law = (settings.noise, math.log(self._r), math.inf, settings.loudest, 0.0)
        self._last: float | None = None
        mean, covariance = _inverted(settings.prior, self._r)
        values = np.append(mean, 0.0)
        start = np.zeros((4, 4))
        start[:3, :3], start[3, 3] = covariance, (settings.surface / self._r) ** 2
        members = _bank(values, start, settings.members)
        self._states = np.stack([Memory(prior, None).state for _, prior in members])
        self._weights = np.array([weight for weight, _ in members])
        self._limit = np.maximum(np.max([np.diagonal(prior.covariance) for _, prior in members], axis=0), 1e-300)

    def advance(self, columns: Columns, t: Array | None, out: Out) -> None:
        from kinid.estimators import _contact_kernels

        depth, rate, force, contact = columns
        _contact_kernels.kalman(
            self.shape, self._states, self._weights, depth, rate, force, contact, self._steps(t), self._walk, self._law,
            self._fading, self._limit, self.window, self.length, self.threshold, self.scratch, out,
        )  # fmt: skip

    def _steps(self, t: Array | None) -> Array:
        """Time since the sample before [s], (n,) or (1,)."""
        if t is None:
            return np.array([self._period])
        before = t[0] - self._period if self._last is None else self._last
        self._last = float(t[-1])
        return np.maximum(np.diff(t, prepend=before), 0.0)

    def whole(self) -> Callable[[], Array]:
        return partial(_mixture, self._states.copy(), self._weights.copy(), self._r)

    @property
    def updates(self) -> int:
        return int(self._states[:, -1].max())


def _mixture(states: Array, weights: Array, r: float) -> Array:
    """Covariance of K, B, n, z from the members' states and the logarithms of their weights, to first order."""
    share = np.where(weights > -50.0, np.exp(weights), 0.0)
    share /= share.sum()
    theta = states[:, :4]
    mean = share @ theta
    total = np.einsum("i,ij,ik->jk", share, theta - mean, theta - mean)
    for part, state in zip(share, states):
        total += part * unit_covariance(state, 4)
    c, b, m, _ = mean
    n, log_c = 1.0 / m, math.log(r * c)
    k = math.exp(min(max(-n * log_c, -200.0), 200.0))
    slope = np.array([-n / c, 0.0, n * n * log_c, 0.0])
    jacobian = np.array([k * slope, b * k * slope + [0.0, k, 0.0, 0.0], [0.0, 0.0, -n * n, 0.0], [0.0, 0.0, 0.0, r]])
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
    jacobian = np.array([[-c / (n * k), 0.0, c * math.log(k) / n**2], [-b / k**2, 1.0 / k, 0.0], [0.0, 0.0, -1.0 / n**2]])
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
