"""What a Gaussian process over a plane learns: Matérn's covariance of largest likelihood, or that of one value.

Rasmussen & Williams, Gaussian Processes for Machine Learning, 2006, §4.2.1 and §5.4.1.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from kinid.mapping.interpolation import PlaneSites
from kinid.mapping.interpolation.uniform import Uniform, sample_of

Array = NDArray[np.float64]
Index = NDArray[np.int64]

#: a uniform property is a process whose length is so many times the extent of the probes, and whose size so many times
#: their spread: a constant that the prior hardly pulls
UNIFORM_LENGTH, UNIFORM_SIZE = 1e4, 3.0
#: surfaces that a uniform property is held against: lengths in spacings, and sizes as shares of its value
LENGTHS, SIZES = np.array([1.0, 2.0, 4.0]), np.geomspace(0.01, 1.0, 9)
#: negative log likelihood of values that no covariance has
IMPOSSIBLE = 1e25


@dataclass(frozen=True)
class Covariance:
    """Matérn: smoothness ν, length [m], size (standard deviation of the property), nugget (what no neighbour
    shares).
    """

    smoothness: float
    length: float
    size: float
    nugget: float

    def correlation(
        self, distance: NDArray[np.floating], room: NDArray[np.floating] | None = None
    ) -> NDArray[np.floating]:
        """Of places a distance apart [m], in its precision and in its place; `room` of the same shape saves making
        some.

        ν = 1/2: e⁻ʳ; 3/2: (1 + r) e⁻ʳ; 5/2: (1 + r + r²/3) e⁻ʳ, with r = √(2ν) distance / length.
        """
        r, e = distance, np.empty_like(distance) if room is None else room
        kind = r.dtype.type
        r *= kind(np.sqrt(2 * self.smoothness) / self.length)
        np.negative(r, out=e)
        np.exp(e, out=e)
        if self.smoothness == 0.5:
            r[...] = e
            return r
        if self.smoothness == 2.5:
            r += kind(1.5)  # 1 + r + r²/3 = ((r + 3/2)² + 3/4) / 3
            r *= r
            r += kind(0.75)
            e *= kind(1 / 3)
        else:
            r += kind(1.0)
        r *= e
        return r


def diagonal(noise: Array, learnt: Covariance) -> Array:
    """What probes don't share, and what keeps the factor from rounding."""
    return np.asarray(noise**2 + learnt.nugget**2 + 1e-9 * learnt.size**2)


def distances(
    a: NDArray[np.floating],
    b: NDArray[np.floating],
    out: NDArray[np.floating] | None = None,
    room: NDArray[np.floating] | None = None,
) -> NDArray[np.floating]:
    """Between places, (m, n)."""
    out = np.subtract(a[:, 0, None], np.ascontiguousarray(b[:, 0]), out=out)
    room = np.subtract(a[:, 1, None], np.ascontiguousarray(b[:, 1]), out=room)
    out *= out
    room *= room
    out += room
    return np.asarray(np.sqrt(out, out=out))


def learn(
    sample_sites: PlaneSites,
    values: Array,
    noise: Array,
    spread: float,
    kinds: tuple[float, ...],
    segments: Index,
    across: float,
    near: Covariance | None = None,
) -> tuple[Covariance, float]:
    """The covariance with the largest marginal likelihood on the probes of `sample_of`, searched for from `near` on.

    With it the logarithm of that likelihood, less what choosing each segment costs: ln n, as in Schwarz' criterion.
    """
    from scipy.optimize import minimize

    n = len(values)
    if n < 4 or not np.ptp(sample_sites.places, axis=0).any():  # one place says nothing of distances
        return Covariance(1.5, max(sample_sites.spacing, 1e-6), spread, 1e-3 * spread), 0.0
    chosen = sample_of(n)
    places, y, variance = sample_sites.places[chosen], values[chosen], noise[chosen] ** 2
    distance = distances(places, places)
    shared = np.where(segments[chosen][:, None] == segments[chosen], 1.0, across)
    longest = 3.0 * max(float(distance.max()), 1e-9)
    shortest = max(0.2 * sample_sites.spacing, 1e-4 * longest)
    bounds = [
        (np.log(shortest), np.log(longest)),
        (np.log(1e-2 * spread), np.log(1e2 * spread)),
        (np.log(1e-4 * spread), np.log(2 * spread)),
    ]
    start = np.array(
        [np.log(np.clip(3 * sample_sites.spacing, shortest, longest)), np.log(spread), np.log(0.03 * spread)]
    )
    if near is not None:
        start = np.log(np.clip([near.length, near.size, near.nugget], *np.exp(np.array(bounds).T)))
    best: tuple[float, Covariance] | None = None
    for kind in kinds:
        found = minimize(
            evidence,
            start,
            args=(kind, distance, y, variance, shared),
            jac=True,
            bounds=bounds,
            method="L-BFGS-B",
            options={"maxiter": 25, "ftol": 1e-6},
        )
        learnt = Covariance(kind, *(float(v) for v in np.exp(found.x)))
        if best is None or found.fun < best[0]:
            best = (float(found.fun), learnt)
        start = found.x
    assert best is not None
    cost = len(np.unique(segments)) * np.log(len(y)) if across < 1.0 else 0.0
    return best[1], -best[0] - cost


def evidence(
    logs: Array, kind: float, distance: Array, y: Array, variance: Array, shared: Array | float = 1.0
) -> tuple[float, Array]:
    """Negative log marginal likelihood, and its derivative by the logarithms of length, size and nugget."""
    length, size, nugget = np.exp(logs)
    r = distance * (np.sqrt(2 * kind) / length)
    e = np.exp(-r)
    if kind == 0.5:
        shape, slope = e, r * e
    elif kind == 1.5:
        shape, slope = (1 + r) * e, r * r * e
    else:
        shape, slope = (1 + r + r * r / 3) * e, r * r * (1 + r) / 3 * e
    shape, slope = shape * shared, slope * shared
    system = size**2 * shape
    system[np.diag_indices_from(system)] += variance + nugget**2 + 1e-9 * size**2
    found = inverted(system)
    if found is None:
        return IMPOSSIBLE, np.zeros(3)
    inverse, half_log_determinant = found
    a = inverse @ y
    value = 0.5 * y @ a + half_log_determinant
    inner = np.outer(a, a) - inverse
    by_length = -0.5 * size**2 * np.sum(inner * slope)
    by_size = -np.sum(inner * (size**2 * shape))
    by_nugget = -(nugget**2) * np.trace(inner)
    return float(value), np.array([by_length, by_size, by_nugget])


def inverted(system: Array) -> tuple[Array, float] | None:
    """Inverse (n, n) of a covariance and half the logarithm of its determinant; None where it isn't positive."""
    from scipy.linalg import LinAlgError, cholesky
    from scipy.linalg.lapack import dpotri

    try:
        factor = cholesky(system, lower=True, check_finite=False)
    except LinAlgError:
        return None
    inverse = dpotri(factor, lower=1)[0]
    return np.tril(inverse) + np.tril(inverse, -1).T, float(np.log(np.diag(factor)).sum())


def doubted(sample_sites: PlaneSites, values: Array, noise: Array, found: Uniform) -> Uniform:
    """One value of all places, with the error that it has if it isn't one: what the probes can't rule out.

    The mean over a surface that varies, by one to a hundred per cent, all sizes and lengths alike, as logarithms, and
    one that doesn't, each as likely as the probes make it (model averaging: J. A. Hoeting et al., Stat. Sci. 14, 1999).
    Where probes are sure, or many, that is the error of their mean; where few and unsure ones can't tell one value from
    another surface, a place may be off by what that surface may.
    """
    chosen = sample_of(len(values))
    y, places = values[chosen] - found.value, sample_sites.places[chosen]
    spread = float(np.std(y))
    own = np.diag(noise[chosen] ** 2 + 1e-12 * spread**2 + 1e-300)
    shared = np.full(own.shape, (UNIFORM_SIZE * spread) ** 2)
    best = _averaged(y, own + found.scatter**2 * np.eye(len(y)), shared)
    if best is None:
        return found
    varying = []
    for length in sample_sites.spacing * LENGTHS:
        alike = Covariance(1.5, length, 1.0, 0.0).correlation(distances(places, places))
        varying += [_averaged(y, own, shared + (size * found.value) ** 2 * alike) for size in SIZES]
    able = np.array([one for one in varying if one is not None]).reshape(-1, 2)
    weight = np.exp(np.minimum(able[:, 0] - best[0], 500.0)) / len(varying)
    square = (found.standard_error**2 + float(weight @ able[:, 1])) / (1.0 + float(weight.sum()))
    return replace(found, standard_error=max(found.standard_error, float(np.sqrt(square))))


def _averaged(y: Array, own: Array, shared: Array) -> tuple[float, float] | None:
    """Log likelihood of values (n,), and the mean square that the property has at their places; None where impossible.

    Args:
        own, shared: covariance of their errors and of the property, (n, n) both.
    """
    found = inverted(own + shared)
    if found is None:
        return None
    inverse, half_log_determinant = found
    gain = shared @ inverse
    square = float(np.mean((gain @ y) ** 2 + np.maximum(np.diag(shared) - np.einsum("ij,ij->i", gain, shared), 0.0)))
    return -0.5 * float(y @ inverse @ y) - half_log_determinant, square


def constant(sample_sites: PlaneSites, spread: float, scatter: float) -> Covariance:
    """Of a property that is one value everywhere, which the prior hardly pulls, with what single probes scatter by."""
    extent = max(float(np.ptp(sample_sites.places, axis=0).max()), 1e-9)
    return Covariance(2.5, UNIFORM_LENGTH * extent, UNIFORM_SIZE * spread, scatter)
