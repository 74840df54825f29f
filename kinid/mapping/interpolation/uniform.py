"""Whether a property is the same everywhere: one value with an error, in place of a surface."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from kinid.estimators.estimate import NORMAL_95

Array = NDArray[np.float64]

#: fewer probes cannot tell a uniform property from one that varies
FEWEST = 4
#: likelihoods are compared on so many probes at most
LEARN_FROM = 150
#: a uniform property's probes scatter by this multiple of their errors at most, or by this share of its value
MOST_ERRORS, MOST_SHARE = 2.0, 0.05
#: parameters that a Gaussian process has beyond mean and scatter: its length and its size
MORE = 2
#: scatters that are tried, as shares of the values' spread
SHARES = np.append(0.0, np.geomspace(1e-3, 2.0, 60))


@dataclass(frozen=True)
class Uniform:
    """One value for all places.

    Attributes:
        value: of the property. standard_error: of that value. scatter: standard deviation of single probes beyond
            their own errors; all in the property's unit.
    """

    value: float
    standard_error: float
    scatter: float

    def with_shared(self, shared: Array) -> Uniform:
        """The same where all probes are off by an error that they make together, (n,): no mean of many takes it off."""
        return replace(self, standard_error=float(np.hypot(self.standard_error, np.sqrt(np.mean(shared**2)))))

    def words(self, unit: str) -> str:
        """As a reader wants it, with the interval that holds 95 %."""
        number = f"{self.value:.4g} ± {NORMAL_95 * self.standard_error:.2g} {unit}".removesuffix(" 1")
        return f"uniform, {number} (95 %)"


def sample_of(n: int) -> NDArray[np.int64]:
    """Rows of the probes that likelihoods are compared on, (at most `LEARN_FROM`,)."""
    if n <= LEARN_FROM:
        return np.arange(n)
    return np.sort(np.random.default_rng(0).choice(n, LEARN_FROM, replace=False))


def uniform_value(values: Array, noise: Array, evidence: float) -> Uniform | None:
    """The value that all probes share, or None where the property varies.

    The log marginal likelihood of a varying property must exceed that of one value by ½ ln n for each of its `MORE`
    parameters (Schwarz, Ann. Stat. 6, 1978). Probes that scatter by far more than their errors say nothing of the
    places between them, whatever the likelihood: such a property is not uniform.

    Args:
        values, noise: of all probes and their standard errors, (n,) both. evidence: log marginal likelihood of the
            varying property on the probes of `sample_of`, without its constant ½ n ln 2π.
    """
    n = len(values)
    if n < FEWEST:
        return None
    rows, spread = sample_of(n), float(np.std(values))
    fits = [_one_value(values[rows], noise[rows], share * spread) for share in SHARES]
    scatter, likelihood = max(((share * spread, fit[2]) for share, fit in zip(SHARES, fits)), key=lambda pair: pair[1])
    if evidence - likelihood > 0.5 * MORE * np.log(len(rows)):
        return None
    value, error, _ = _one_value(values, noise, scatter)
    if scatter > max(MOST_ERRORS * float(np.median(noise)), MOST_SHARE * abs(value)):
        return None
    return Uniform(value, error, scatter)


def blended(values: Array, noise: Array, bordering: NDArray[np.bool_]) -> float:
    """What probes at the border of what is mapped differ by from those within, beyond their errors: they read what lies
    beside, too.

    The variance between the two by moments (R. DerSimonian, N. Laird, Control. Clin. Trials 7, 1986); 0 without
    `FEWEST` probes within.

    Args:
        values, noise: of all probes and their standard errors, (n,) both. bordering: which are at a border, (n,).
    """
    within = ~bordering
    if within.sum() < FEWEST or not bordering.any():
        return 0.0
    trust = 1.0 / np.maximum(noise, 1e-9 * np.abs(values) + 1e-300) ** 2
    mean, own = float(np.average(values[within], weights=trust[within])), 1.0 / trust + 1.0 / trust[within].sum()
    square = np.average((values - mean)[bordering] ** 2 - own[bordering], weights=1.0 / own[bordering])
    return float(np.sqrt(max(float(square), 0.0)))


def _one_value(values: Array, noise: Array, scatter: float) -> tuple[float, float, float]:
    """Weighted mean, its standard error, and the log likelihood without its constant."""
    variance = noise**2 + scatter**2 + 1e-18 * float(np.mean(values**2)) + 1e-300
    trust = 1.0 / variance
    mean = float(trust @ values / trust.sum())
    likelihood = -0.5 * float(trust @ (values - mean) ** 2) - 0.5 * float(np.log(variance).sum())
    return mean, float(1.0 / np.sqrt(trust.sum())), likelihood
