"""A plane through touched points: where it is, how sure that is, and which touches were stray.

Orthogonal least squares: the normal is the direction of least scatter about the weighted centroid. In the
principal axes of the scatter the errors of offset and tilts are independent: with noise σ at weight 1 and
scatter λᵢ = Σ w xᵢ² along axis i, λ₃ off the plane, var(offset) = σ² / Σ w, and the tilt that the scatter
along i resists has σ² λᵢ / (λᵢ − λ₃)² (T. W. Anderson, "Asymptotic theory for principal component analysis",
Ann. Math. Statist. 34, 1963).

Stray touches: least trimmed squares finds the half of the points that agree best (P. J. Rousseeuw, K. Van
Driessen, "Computing LTS regression for large data sets", Data Min. Knowl. Discov. 12, 2006). The others come
back, nearest first, until one's deletion residual is further out than chance allows (A. S. Hadi, J. S.
Simonoff, "Procedures for the identification of multiple outliers in linear models", J. Am. Stat. Assoc. 88,
1993).
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations
from math import comb
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import special

from kinid.errors import InputError

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

#: chance that one test calls a good touch stray; tests follow each other, so that in all about 1 % of planes
#: lose a good touch (simulated with 7 to 20 touches)
STRAY = 0.004
#: chance that touches that scatter as their sigma says are held to scatter more
TOO_ROUGH = 1e-3
#: starts of the search for the half that agrees best, and how many points it looks at
STARTS, LOOKED_AT = 300, 1000
#: width over length of the touched area below which fewer than six touches don't show a tilt
NARROW = 0.02
#: width of the touched area over its roughness, both RMS, below which the normal may be any
BLUNT = 3.0


@dataclass(frozen=True, eq=False)
class PlaneEstimate:
    """A plane in the frame of its points, and how sure it is.

    Attributes:
        point: weighted centroid of the points used [m], (3,).
        normal: unit normal towards the outward hint, (3,).
        covariance: of the offset along the normal at `point` [m²] and the tilts about `tilt_axes` [rad²],
            (3, 3), diagonal; infinite for three points without a sigma.
        tilt_axes: rows are unit axes in the plane, right-handed with the normal, (2, 3). The first lies along
            the touched area: the tilt about it is the less certain one. A tilt θ adds θ axis × normal.
        rms: root mean square distance of the points used from the plane [m].
        n: number of points used.
        inliers: True for the points used, False for stray ones, (number of points given,).
        freedom: degrees of freedom of the covariance; infinite when it comes from a sigma.
        roughness: residuals over sigma, near 1 when they agree, 1 where it can't be told. When it is greater
            than chance allows, the covariance comes from the residuals in spite of a sigma.
    """

    point: Array
    normal: Array
    covariance: Array
    tilt_axes: Array
    rms: float
    n: int
    inliers: Mask
    freedom: float
    roughness: float

    @property
    def offset_interval(self) -> tuple[float, float]:
        """95 % interval of the true plane's offset from `point`, along the normal [m]."""
        reach = self._quantile * float(np.sqrt(self.covariance[0, 0]))
        return -reach, reach

    @property
    def tilt_interval(self) -> Array:
        """95 % intervals of the true normal's tilts about `tilt_axes` [rad], rows low, high, (2, 2)."""
        reach = self._quantile * np.sqrt(np.diag(self.covariance)[1:])
        return np.stack([-reach, reach], axis=1)

    @property
    def _quantile(self) -> float:
        return float(special.stdtrit(self.freedom, 0.975)) if self.freedom > 0 else 1.0  # of what is infinite


class _Fit(NamedTuple):
    centroid: Array  # (3,)
    axes: Array  # (3, 3) rows in order of falling scatter: along, across, normal
    scatter: Array  # (3,) weighted sums of squares along the axes
    weight: float  # sum of weights
    n: int

    @property
    def noise(self) -> float:
        """Standard deviation at weight 1, from the residuals; 0 for three points."""
        return float(np.sqrt(self.scatter[2] / max(self.n - 3, 1)))


def fit_plane(points: ArrayLike, sigma: ArrayLike | None = None, outward: ArrayLike = (0.0, 0.0, 1.0)) -> PlaneEstimate:
    """Fit a plane to touched points.

    Args:
        points: where the surface was touched [m], (n, 3), n ≥ 3, in any one frame.
        sigma: standard deviation of the points along the normal [m], a number or (n,); None: from residuals.
        outward: a direction roughly out of the material, same frame, (3,).

    Raises:
        InputError: fewer than three points; points, sigmas or a hint that can't be used; points (nearly) in
            one place or on a line.
    """
    p, hint = _points(points), _hint(outward)
    known, w = (None, np.ones(len(p))) if sigma is None else _weights(sigma, len(p))
    inliers = _inliers(p, w, known)
    fit = _fit(p[inliers], w[inliers])
    _refuse_narrow(fit, known, hint, len(p) - fit.n)
    side = float(fit.axes[2] @ hint)
    if abs(side) < 0.05:
        raise InputError(
            "an outward hint within 3° of the touched plane",
            "a direction out of the material",
            "give one, say from the material towards the tool",
        )

    variance, freedom, roughness = _noise(fit, known)
    along, across, off = fit.scatter
    # the tilt about the first axis moves along the second, whose scatter resists it
    unit = np.array([1.0 / fit.weight, across / (across - off) ** 2, along / (along - off) ** 2])
    normal = np.sign(side) * fit.axes[2]
    first = fit.axes[0] * np.sign(fit.axes[0][np.abs(fit.axes[0]).argmax()])
    return PlaneEstimate(
        point=fit.centroid,
        normal=normal,
        covariance=np.diag(variance * unit),
        tilt_axes=np.stack([first, np.cross(normal, first)]),
        rms=float(np.sqrt(np.mean(((p[inliers] - fit.centroid) @ normal) ** 2))),
        n=fit.n,
        inliers=inliers,
        freedom=freedom,
        roughness=roughness,
    )


def _noise(fit: _Fit, known: float | None) -> tuple[float, float, float]:
    """Variance at weight 1 [m²], its degrees of freedom, and residuals over sigma."""
    freedom = fit.n - 3
    if freedom == 0:
        return (np.inf, 0.0, 1.0) if known is None else (known**2, np.inf, 1.0)
    if known is None:
        return fit.noise**2, float(freedom), 1.0
    roughness = fit.noise / known
    if special.chdtrc(freedom, freedom * roughness**2) > TOO_ROUGH:
        return known**2, np.inf, roughness
    return fit.noise**2, float(freedom), roughness


def _points(points: ArrayLike) -> Array:
    p = np.asarray(points, dtype=np.float64).reshape(-1, 3)
    if len(p) < 3:
        count = "no touch" if len(p) == 0 else "one touch" if len(p) == 1 else "two touches"
        raise InputError(
            f"{count} of the surface",
            "at least three, which a plane needs",
            "touch it in places that are not on one line, better six or more",
        )
    if not np.isfinite(p).all():
        row = int(np.flatnonzero(~np.isfinite(p).all(axis=1))[0])
        raise InputError(f"touch {row + 1} at {_shown(p[row])}", "finite coordinates in m", "leave it out")
    return p


def _hint(outward: ArrayLike) -> Array:
    hint = np.asarray(outward, dtype=np.float64).reshape(-1)
    size = float(np.linalg.norm(hint))
    if hint.shape != (3,) or not 0 < size < np.inf:
        raise InputError(f"outward hint {hint.tolist()}", "a direction out of the material", "give three numbers")
    return hint / size


def _weights(sigma: ArrayLike, n: int) -> tuple[float, Array]:
    """Median standard deviation, and weights that are 1 where a point has it."""
    deviation = np.asarray(sigma, dtype=np.float64)
    if deviation.shape not in ((), (n,)) or not (np.isfinite(deviation) & (deviation > 0)).all():
        raise InputError(
            f"sigma of shape {deviation.shape}, or not all of it > 0",
            f"one number > 0 [m], or {n}",
            "correct it, or leave it out to take it from the residuals",
        )
    middle = float(np.median(deviation))
    return middle, np.broadcast_to((middle / deviation) ** 2, (n,))


def _fit(p: Array, w: Array) -> _Fit:
    """Weighted orthogonal least squares; the normal's side is arbitrary."""
    centroid = w @ p / w.sum()
    # singular values of the points, not eigenvalues of their squares: a plane without noise stays exact
    _, values, axes = np.linalg.svd(np.sqrt(w)[:, None] * (p - centroid), full_matrices=False)
    return _Fit(centroid, axes, values**2, float(w.sum()), len(p))


def _inliers(p: Array, w: Array, known: float | None) -> Mask:
    """Touches that agree; all of them when fewer than five, too few to outvote one."""
    n = len(p)
    keep = np.ones(n, dtype=np.bool_)
    if n < 5:
        return keep
    inside = _best_half(p, w)
    # rounding is no noise: points that lie on a plane exactly are not held against each other
    rounding = 1e-12 * float(np.ptp(p, axis=0).max()) + 1e-15 * float(np.abs(p).max())
    while (m := len(inside)) < n:
        fit = _fit(p[inside], w[inside])
        x = (p - fit.centroid) @ fit.axes.T
        resisted = np.maximum(fit.scatter[:2] - fit.scatter[2], 1e-300)
        lever = 1.0 / fit.weight + (x[:, :2] ** 2 / resisted).sum(axis=1)
        within = np.zeros(n, dtype=np.bool_)
        within[inside] = True
        # variance of a residual: less the share that the point itself pulled, or more by the fit's own error
        share = np.where(within, np.maximum(1.0 / w - lever, 1e-3 / w), 1.0 / w + lever)
        distance = np.abs(x[:, 2]) / np.sqrt(share)
        variance, freedom, _ = _noise(fit, known)
        chance = STRAY / (2.0 * (m + 1))
        limit = max(np.sqrt(variance), fit.noise, rounding) * -float(special.stdtrit(freedom, chance))
        nearest = np.sort(distance[~within])[: 1 + m // 50]  # many touches come back in small groups
        passed = int((nearest <= limit).sum())
        if passed == 0:
            return within
        inside = np.argsort(distance, kind="stable")[: m + passed]
    return keep


def _best_half(p: Array, w: Array) -> NDArray[np.intp]:
    """The half of the points with the least sum of squares about their own plane, from starts of three."""
    n, draw = len(p), np.random.default_rng(0)
    seen = draw.choice(n, LOOKED_AT, replace=False) if n > LOOKED_AT else np.arange(n)
    q, v = p[seen], w[seen]
    if comb(len(q), 3) <= STARTS:
        triples = np.array(list(combinations(range(len(q)), 3)))
    else:
        triples = np.argpartition(draw.random((STARTS, len(q))), 3, axis=1)[:, :3]
    a, b, c = (q[triples[:, k]] for k in range(3))
    centre, normal = a, np.cross(b - a, c - a)
    normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-300)
    half = (len(q) + 4) // 2
    for _ in range(3):
        squares = v * np.einsum("snj,sj->sn", q - centre[:, None, :], normal) ** 2
        chosen = np.argpartition(squares, half - 1, axis=1)[:, :half]
        part, weight = q[chosen], v[chosen][:, :, None]
        centre = (weight * part).sum(axis=1) / weight.sum(axis=1)
        part = part - centre[:, None, :]
        normal = np.linalg.eigh(np.swapaxes(weight * part, 1, 2) @ part)[1][:, :, 0]
    squares = v * np.einsum("snj,sj->sn", q - centre[:, None, :], normal) ** 2
    best = int(np.partition(squares, half - 1, axis=1)[:, :half].sum(axis=1).argmin())
    far = w * ((p - centre[best]) @ normal[best]) ** 2
    return np.argsort(far, kind="stable")[: (n + 4) // 2]


def _refuse_narrow(fit: _Fit, known: float | None, hint: Array, strays: int) -> None:
    """InputError where the touches don't show a plane, with the next place to touch."""
    along, across, off = np.sqrt(fit.scatter / fit.weight)
    rough = off if known is None else known * np.sqrt(fit.n / fit.weight)
    if along < max(BLUNT * rough, 1e-9):
        raise InputError(
            f"touches in one place, within {1e3 * along:.2g} mm of {_shown(fit.centroid)}",
            "touches that span an area",
            "touch at least two more places, well apart and not on one line",
        )
    few = fit.n < 6 and known is None
    if across >= max(BLUNT * rough, (NARROW if few else 1e-6) * along):
        return
    aside = np.cross(hint, fit.axes[0])
    size = float(np.linalg.norm(aside))
    aside = aside / size if size > 0.1 else fit.axes[1]
    rest = f" once {strays} stray ones are left out" if strays else ""
    raise InputError(
        f"touches on a line along {_shown(fit.axes[0], 2)}{rest} (spread {1e3 * along:.3g} mm along it, "
        f"{1e3 * across:.2g} mm across, roughness {1e3 * rough:.2g} mm), so the tilt about it is unknown",
        "touches that span an area",
        f"touch aside of the line too, for instance near {_shown(fit.centroid + 2.0 * along * aside)} m",
    )


def _shown(values: Array, digits: int = 4) -> str:
    return "(" + ", ".join(f"{value:.{digits}f}" for value in values + 0.0) + ")"
