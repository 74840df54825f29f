"""Where a smooth surface and its probes disagree: what residuals of one sign, side by side, say a guess may be off by.

A probe that states a large error (a contact law that fails there, say) hardly pulls a Gaussian process: its sure
neighbours decide, and the process is as sure as they are. That is right for one such probe, whose error may be chance.
Where several beside each other deviate to one side by more than chance, the surface is another one there, and a guess
must say so.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

#: probes within so many spacings are neighbours: in a grid, all eight around one
NEAR = 1.5
#: neighbours whose error is this share of a probe's own, or more, bear witness; sure ones say nothing about it
ALIKE = 1.0 / 3.0
#: pooled residual over its standard error beyond which neighbours disagree by more than chance
LIMIT = 2.0
#: so many probes around a place share in what it may be off by
AROUND = 4
#: among such neighbours the value of a probe is so many standard deviations from a guess at most
PLAUSIBLE = 2.0
#: towards the side of a material a property changes as exp(distance / length), by all lengths alike, as logarithms,
#: from this share of a spacing, which one row of probes sees, to as many times it
SHORTEST, LENGTHS = 1.0 / 3.0, 25
#: errors this many times larger than what neighbours differ by are shared
SAME = 10.0


def local_bias(places: Array, residual: Array, error: Array, spacing: float, uniform: bool = False) -> Array:
    """What a guess may be off by at each probe, (n,); 0 where residuals are as small, or as mixed in sign, as chance
    has it.

    The mean of the residuals of a probe and its neighbours with alike errors, weighed by these. The witnesses are
    chosen by their errors and not by their residuals, so that their sum is as surely chance as it looks.

    Args:
        places: of probes [m], (n, 2) or (n, 3). residual: value less the guess, (n,). error: standard error of each,
            (n,).
        spacing: typical distance between neighbours [m]. uniform: whether the guess is one value for all, that all
            probes speak for: then neighbours are those within twice as far, and disagree beyond what the worst of n
            neighbourhoods does by chance in 1 of 20 maps (C. E. Bonferroni, 1936).
    """
    from scipy.spatial import cKDTree
    from scipy.special import ndtri

    limit, near = (float(ndtri(1.0 - 0.025 / len(places))), 2.0 * NEAR) if uniform else (LIMIT, NEAR)

    out = np.zeros(len(places))
    error = np.maximum(error, 1e-300)
    trust = 1.0 / error**2
    for i, around in enumerate(cKDTree(places).query_ball_point(places, near * spacing)):
        alike = np.array(around)[error[around] >= ALIKE * error[i]]
        pooled = abs(np.sum(residual[alike] / error[alike])) / np.sqrt(len(alike))
        if len(alike) > 1 and pooled > limit:
            mean = float(np.average(residual[alike], weights=trust[alike]))
            out[i] = max(out[i], abs(mean))
            same = alike[residual[alike] * mean > 0]
            out[same] = np.maximum(out[same], np.abs(residual[same]) / PLAUSIBLE)
    return out


def shared_error(places: Array, values: Array, noise: Array, pairs: NDArray[np.int64]) -> Array:
    """The part of each probe's error that its neighbours make too, (n,): 0 unless they agree far better than their
    errors say.

    Several pokes that one wrong law was fitted to have large errors, and yet the same value each time: what they are
    off by is alike. Such errors say how far all of them may be off, not how far from each other.

    Args:
        places: (n, 2). values, noise: of the probes and their standard errors, (n,) both. pairs: neighbours, (e, 2).
    """
    out = np.zeros(len(places))
    both = np.concatenate([pairs, pairs[:, ::-1]])
    # of alike errors alone: a sure neighbour of another material says nothing
    both = both[noise[both[:, 1]] >= ALIKE * noise[both[:, 0]]]
    for i in np.unique(both[:, 0]).tolist():
        around = both[both[:, 0] == i, 1]
        apart = np.sort(np.abs(values[around] - values[i]))[: max(2, len(around) // 2)]
        if len(apart) > 1 and noise[i] > SAME * apart[-1]:
            out[i] = np.sqrt(noise[i] ** 2 - (noise[i] / SAME) ** 2)
    return out


def unexplained(left_out: Array, noise: Array) -> Array:
    """What the other probes don't say of each one, (n,): its residual where it is left out; 0 where that may be noise.

    Where a border runs, a law changes, or a material ends, neighbours differ by more than the surface at large makes
    likely: what is between them is as uncertain as they are unlike.

    Args:
        left_out: value less what the others say of its place, (n,), NaN where there are none. noise: standard error of
            each, (n,).
    """
    off = np.nan_to_num(np.abs(left_out))
    return np.where(off > LIMIT * noise, off, 0.0)


def steps_to_side(places: Array, values: Array, noise: Array, outermost: NDArray[np.bool_]) -> Array:
    """What each outermost probe and the nearest one further in differ by beyond chance, (n,); 0 for the others.

    Left out, an outermost probe is told by its neighbours along the side, to which the same happens.

    Args:
        places: (n, d). values, noise: of the probes and their standard errors, (n,) both. outermost: (n,).
    """
    from scipy.spatial import cKDTree

    out = np.zeros(len(places))
    inner = np.flatnonzero(~outermost)
    if not len(inner) or not outermost.any():
        return out
    at = inner[cKDTree(places[inner]).query(places[outermost])[1]]
    step = np.abs(values[outermost] - values[at])
    chance = LIMIT * np.hypot(noise[outermost], noise[at])
    out[outermost] = np.where(step > chance, step, 0.0)
    return out


def continued(beyond: Array) -> Array:
    """By how many times the last step a property may go on changing at distances beyond the last probe, (m,).

    The distances are in spacings. A change of exp(x / l) makes the last step s over one spacing, and
    s (exp(x / l) − 1) / (1 − exp(−1 / l)) more beyond it; the root mean square over what l may be.
    """
    length = np.geomspace(SHORTEST, 1.0 / SHORTEST, LENGTHS)
    further = np.expm1(np.maximum(beyond, 0.0)[:, None] / length) / -np.expm1(-1.0 / length)
    return np.asarray(np.sqrt(np.mean(further**2, axis=1)))


def spread_over(
    places: Array, off: Array, queries: Array, within: float | None = None, values: Array | None = None
) -> Array:
    """The same between the probes, (m,): of the nearest ones, weighed by the inverse square of their distance
    (Shepard).

    Args:
        places: of probes [m], (n, d). off: at each, (n,). queries: places [m], (m, d). within: its square grows with
            the distance to the nearest probe, from nothing, up to this one [m], as that of a random walk does; None:
            it is the same at any distance. values: of the probes, (n,): no more than the nearest ones differ by.
    """
    from scipy.spatial import cKDTree

    if not off.any():
        return np.zeros(len(queries))
    count = min(AROUND, len(places))
    distance, at = cKDTree(places).query(queries, k=count)
    distance, at = distance.reshape(-1, count), at.reshape(-1, count)
    weight = 1.0 / (distance**2 + 1e-12 * float(np.ptp(places, axis=0).max()) ** 2 + 1e-300)
    square = np.sum(weight * off[at] ** 2, axis=1) / weight.sum(axis=1)
    if values is not None:
        square = np.minimum(square, np.ptp(values[at], axis=1) ** 2)
    if within is not None:
        square *= np.minimum(distance[:, 0] / within, 1.0)
    return np.asarray(np.sqrt(square))
