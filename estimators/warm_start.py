"""What a place may be like before it is touched, and what a touch makes of that.

The material may be that of a place near by, or another one: a mixture, whose members are weighed anew by how well each
foretold what the touch says. One that is contradicted loses its weight within a few samples, and the estimate is then
the touch's own.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from kinid.errors import InputError
from kinid.estimators.estimate import NORMAL_95

Array = NDArray[np.float64]

#: a property of which nothing is expected lies anywhere within so many natural logarithms, two decades
UNKNOWN_RANGE = math.log(100.0)


@dataclass(frozen=True, eq=False)
class Candidate:
    """A material that may lie at a place.

    Attributes:
        values: of the p parameters, (p,), SI. covariance: of the material there about them, (p, p); infinite on the
            diagonal where nothing is expected of a parameter. share: how probable it is, beside the others.

    Raises:
        InputError: shapes that differ, a variance that is none, or a share that isn't positive.
    """

    values: Array
    covariance: Array
    share: float

    def __post_init__(self) -> None:
        p = len(self.values)
        if np.shape(self.covariance) != (p, p) or not (np.diagonal(self.covariance) > 0.0).all():
            raise InputError(
                f"a candidate of {p} values with a covariance {np.shape(self.covariance)}",
                "variances above 0, infinite where nothing is expected",
                "give a row for each parameter",
            )
        if not (math.isfinite(self.share) and self.share > 0.0):
            raise InputError(f"a candidate with a share of {self.share}", "a positive number", "leave it out")

    @property
    def expects(self) -> NDArray[np.bool_]:
        """Of which parameters something is expected, (p,)."""
        return np.isfinite(np.diagonal(self.covariance))


@dataclass(frozen=True, eq=False)
class Learnt:
    """What is known of a place after a touch.

    Attributes:
        values: (p,), SI. covariance: of the values' error, (p, p). another: how probable it is that none of the
            candidates lies there. evidence: logarithm of the density that the touch's own values were expected with.
    """

    values: Array
    covariance: Array
    another: float
    evidence: float

    def within(self, precision: float) -> bool:
        """Whether half of each 95 % interval is at most this share of its value."""
        half = NORMAL_95 * np.sqrt(np.diagonal(self.covariance))
        return bool((half <= precision * np.abs(self.values)).all())


@dataclass(frozen=True, eq=False)
class WarmStart:
    """A mixture of materials that may lie at a place, and of any other one.

    Attributes:
        candidates: materials that are expected. another: share of places that are like none of them. A material of
            which nothing is known has parameters whose logarithms lie anywhere within `UNKNOWN_RANGE`.

    Raises:
        InputError: a share of others outside (0, 1].
    """

    candidates: Sequence[Candidate] = ()
    another: float = 1.0

    def __post_init__(self) -> None:
        if not 0.0 < self.another <= 1.0:
            raise InputError(f"a share of {self.another} for another material", "more than 0, at most 1", "correct it")

    def after(self, values: Array, covariance: Array) -> Learnt:
        """What is known with the touch, whose own estimate is normal: mean and covariance of the mixture's posterior.

        Each candidate is updated by Bayes' rule and weighed by its marginal likelihood (D. M. Titterington, A. F. M.
        Smith, U. E. Makov, Statistical Analysis of Finite Mixture Distributions, 1985, ch. 6).

        Args:
            values: that the touch alone says, (p,). covariance: of their error, (p, p), finite and positive definite.
        """
        total = sum(candidate.share for candidate in self.candidates)
        means, covariances, weights = [values], [covariance], [math.log(self.another) + _anything(values, covariance)]
        for candidate in self.candidates:
            share = (1.0 - self.another) * candidate.share / total
            if share <= 0.0 or not candidate.expects.any():
                continue
            mean, left, likelihood = _updated(candidate, values, covariance)
            means.append(mean)
            covariances.append(left)
            weights.append(math.log(share) + likelihood)
        odds = np.exp(np.array(weights) - max(weights))
        evidence = max(weights) + math.log(float(odds.sum()))
        odds /= odds.sum()
        mean = odds @ np.array(means)
        apart = np.array(means) - mean
        spread = np.einsum("k,kij->ij", odds, np.array(covariances)) + np.einsum("k,ki,kj->ij", odds, apart, apart)
        return Learnt(mean, spread, float(odds[0]), evidence)


def _anything(values: Array, covariance: Array) -> float:
    """Logarithm of the density of a touch's values where any material may lie, evenly over logarithms."""
    size = np.maximum(np.abs(values), np.sqrt(np.diagonal(covariance)))
    return -float(np.log(UNKNOWN_RANGE * size).sum())


def _updated(candidate: Candidate, values: Array, covariance: Array) -> tuple[Array, Array, float]:
    """Mean, covariance, and logarithm of the marginal likelihood of a candidate with a touch's estimate."""
    known = candidate.expects
    prior = candidate.covariance[np.ix_(known, known)]
    innovation = values[known] - candidate.values[known]
    both = prior + covariance[np.ix_(known, known)]
    # the touch's estimate learns from the candidate as from a measurement of the parameters that it expects
    gain = np.linalg.solve(both, covariance[known]).T
    mean = values - gain @ innovation
    left = covariance - gain @ covariance[known]
    _, size = np.linalg.slogdet(2.0 * np.pi * both)
    likelihood = -0.5 * (float(innovation @ np.linalg.solve(both, innovation)) + float(size))
    if not known.all():
        likelihood += _anything(values[~known], covariance[np.ix_(~known, ~known)])
    return mean, 0.5 * (left + left.T), likelihood
