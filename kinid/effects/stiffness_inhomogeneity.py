"""Stiffness that differs from place to place."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import final

import numpy as np
from numpy.typing import NDArray
from scipy.sparse.csgraph import connected_components

from kinid.effects._derived import derived
from kinid.effects._effect import Effect
from kinid.effects._example import Example
from kinid.effects._signals import Array, Layout, Signals
from kinid.parameter import Parameter

#: nodes along a line, and all of a plane's
ALONG, OVER = 15, 25
#: nodes are no closer than this [m]: a tip feels the mean over what it touches
CLOSEST = 2e-4
#: places within this share of their length lie along a line
NARROW = 0.08
#: places whose extents differ by less than this share have no direction; one so near a tangent is the tangent [rad]
ROUND, ALIGNED = 0.5, 0.1
#: a place that was poked at is no wider than so many sixtieths of all
WIDEST = 4
#: a node is kept where it is the nearest one of so many samples, and of this share of them
FEW, SHARE = 5, 2e-3
#: share of the visited places beyond either end of the nodes
BEYOND = 2e-3
#: prior of a profile that nothing was learnt of: size, and length as a share of its extent
SIZE, LENGTH = 0.3, 0.3
#: what is learnt of: sizes, and lengths in spacings of the nodes
SIZES, LENGTHS = np.geomspace(0.01, 5.0, 19), np.geomspace(0.5, 32.0, 13)


@dataclass(frozen=True)
class Nodes:
    """Places at which a profile is free: those that a tool poked at; or, of a grid turned against the tangents, those
    with samples around.

    Attributes:
        spots: that were poked at [m], along both tangents; () for a grid, and what follows is of one.
        origin: first node [m], along both tangents. angle: of the grid's first axis from the first tangent [rad].
        spacing: of nodes along both axes [m]. counts: how many there are along each.
        kept: those with samples around, as numbers i + j · counts[0]. reference: the one of them that the base's
            stiffness is of.
    """

    origin: tuple[float, float]
    angle: float
    spacing: tuple[float, float]
    counts: tuple[int, int]
    kept: tuple[int, ...]
    reference: int
    spots: tuple[tuple[float, float], ...] = ()

    @classmethod
    def of(cls, x: Array) -> Nodes | None:
        """Those of visited places x (2, n); None where there is one place alone."""
        if x.shape[1] < FEW:
            return None
        spots, often = _spots(x)
        if len(spots) > 1:
            listed = tuple((float(a), float(b)) for a, b in spots)
            return cls((0.0, 0.0), 0.0, (1.0, 1.0), (1, 1), tuple(range(len(listed))), int(np.argmax(often)), listed)
        angle = _direction(x)
        at = _turned(x, angle)
        low, high = np.quantile(at, [BEYOND, 1.0 - BEYOND], axis=1)
        span = high - low
        if not span.max() > 2.0 * CLOSEST:
            return None
        counts = _counts(span)
        spacing = np.where(counts > 1, span / np.maximum(counts - 1, 1), 1.0)
        low = np.where(counts > 1, low, 0.5 * (low + high))
        nearest = [np.clip(np.round((at[k] - low[k]) / spacing[k]), 0, counts[k] - 1).astype(int) for k in (0, 1)]
        number = np.bincount(nearest[0] + counts[0] * nearest[1], minlength=int(np.prod(counts)))
        kept = np.flatnonzero(number >= max(FEW, SHARE * x.shape[1]))
        if len(kept) < 2:
            return None
        a, b, c, d, e = (float(v) for v in (*_turned(low[:, None], -angle)[:, 0], angle, *spacing))
        return cls((a, b), c, (d, e), (int(counts[0]), int(counts[1])), tuple(kept.tolist()), int(np.argmax(number)))

    @cached_property
    def places(self) -> Array:
        """Of the kept nodes, along both tangents [m], (2, K)."""
        if self.spots:
            return np.array(self.spots).T
        kept = np.array(self.kept)
        grid = np.stack([kept % self.counts[0], kept // self.counts[0]]) * np.array(self.spacing)[:, None]
        out: Array = _turned(grid, -self.angle) + np.array(self.origin)[:, None]
        return out

    @property
    def step(self) -> float:
        """Least distance between two of them [m]."""
        far = np.linalg.norm(self.places[:, :, None] - self.places[:, None, :], axis=0)
        return float(far[far > 0.0].min())

    @property
    def extent(self) -> float:
        """Greatest distance between two of them [m]."""
        return float(np.linalg.norm(self.places[:, :, None] - self.places[:, None, :], axis=0).max())

    @property
    def free(self) -> tuple[int, ...]:
        """Numbers of the kept nodes but the reference."""
        return tuple(k for k in self.kept if k != self.reference)

    def shares(self, x: Array) -> Array:
        """How much of the value at each free node goes into that at places x (2, n), (K − 1, n).

        Linear between nodes of a grid; a spot's own reaches half way to the next.
        """
        if self.spots:
            nearest = np.argmin(np.sum((x[:, None] - self.places[:, :, None]) ** 2, axis=0), axis=0)
            one: Array = np.where(np.array(self.free)[:, None] == nearest, 1.0, 0.0)
            return one
        at = _turned(x - np.array(self.origin)[:, None], self.angle) / np.array(self.spacing)[:, None]
        at = np.clip(at, 0.0, np.array(self.counts)[:, None] - 1.0)
        kept = np.array(self.kept)
        off = np.stack(
            [at[0] - (kept % self.counts[0])[:, None], at[1] - (kept // self.counts[0])[:, None]]
        )  # (2, K, n)
        hats: Array = np.prod(np.maximum(1.0 - np.abs(off), 0.0), axis=0)
        total = hats.sum(axis=0)
        lost = total < 1e-6
        if lost.any():  # between nodes that no sample was near to: as at the nearest that is kept
            nearest = np.argmin(np.sum(off[:, :, lost] ** 2, axis=0), axis=0)
            hats[:, lost] = np.arange(len(kept))[:, None] == nearest
            total = hats.sum(axis=0)
        return np.ascontiguousarray((hats / total)[kept != self.reference])


@final
@dataclass(frozen=True)
class StiffnessInhomogeneity(Effect):
    """F_e ·= 1 + Σ w_k φ_k(x, y): a free profile over the visited places; x, y are the slips [m].

    φ_k is 1 at its node and falls linearly to 0 at the neighbouring ones. Nodes come from the log (`for_log`): up to
    fifteen along a line, about five by five over a plane, those alone that samples are near to. One of them is the
    reference: the base's stiffness is that there, and 1 + w_k the ratio of the stiffness at node k to it. Beyond the
    nodes the profile goes on as it ends. How smooth it is, is learnt: weights have a prior, that of a Gaussian process
    (Matérn 3/2) less its value at the reference, whose size and length are those under which the readings are most
    likely. Edges, inclusions and gradients are cases. Without a log it is a gradient g [1/m] along both tangents, F_e
    ·= 1 + g₁ x + g₂ y.

    Attributes:
        nodes: of a log; None without one.
        size, length: of the prior: standard deviation of the profile, and over which distance it changes [m].
    """

    nodes: Nodes | None = None
    size: float = SIZE
    length: float = 0.0

    id = "stiffness-inhomogeneity"
    title = "stiffness that depends on the place"
    equation = "F_e ·= 1 + Σ w_k φ_k(x, y)"
    source = (
        "graded materials: S. Suresh, Science 292, 2001; inclusions: P. S. Wellman, R. D. Howe, MICCAI 1999; "
        "smoothness: C. E. Rasmussen, C. K. I. Williams, Gaussian Processes for Machine Learning, 2006, ch. 5"
    )
    signature = "an error in proportion to the force, that returns at the same place"
    confusions = {
        "stiffness-drift": "the same place, later",
        "surface-offset": "several depths at each place: tilt shifts depth, stiffness scales force",
        "surface-tilt": "several depths at each place: tilt shifts depth, stiffness scales force",
    }
    excited_by = "pokes or slides of one depth at many places, along both tangents"
    needs = ("normal", "slip")
    null = {"gradient1": 0.0, "gradient2": 0.0, "weight": 0.0}
    # no place has a negative stiffness; bone in fat is some hundred times as stiff, an inclusion felt through a layer
    # less
    admissible = {"weight": (-1.0, 100.0)}
    order = 2
    example = Example(
        ("kelvin-voigt",),
        {
            "weight": (
                *(-0.18, -0.11, -0.02, 0.08, 0.15, 0.19),
                *(-0.18, -0.10, 0.04, 0.27, 0.29),
                *(-0.18, -0.10, 0.04, 0.27, 0.29, 0.22),
                *(-0.11, -0.02, 0.08, 0.15),
            )
        },
    )

    def for_log(self, signals: Signals) -> StiffnessInhomogeneity:
        """With nodes where the log touches; itself where it has nodes, or the log touches one place alone."""
        nodes = Nodes.of(signals.slip[:, signals.inside]) if self.nodes is None else None
        if nodes is None:
            return self
        return StiffnessInhomogeneity(nodes, SIZE, LENGTH * nodes.extent)

    def parameters(self, layout: Layout) -> tuple[Parameter, ...]:
        """Weight of each node but the reference; without nodes a gradient along both tangents."""
        if self.nodes is None:
            return tuple(Parameter(f"gradient{i}", f"g{'₁₂'[i - 1]}", "1/m", 0.0, -1e4, 1e4, scale=1.0) for i in (1, 2))
        return tuple(Parameter(f"weight[{k}]", "w", "1", 0.0, -1.0, 1e3, scale=0.05) for k in self.nodes.free)

    def null_for(self, base: str | None) -> Mapping[str, float]:
        """Neither gradient nor weights."""
        return {"gradient1": 0.0, "gradient2": 0.0} if self.nodes is None else {"weight": 0.0}

    def prior(self, layout: Layout) -> Array | None:
        """Precision of the weights; None of a gradient."""
        return None if self.nodes is None else _precision(_covariance(self.nodes, self.length), self.size)

    def learnt(self, layout: Layout, information: Array, gradient: Array) -> StiffnessInhomogeneity:
        """With size and length of the greatest marginal likelihood (Rasmussen & Williams 2006, eq. 5.8), of a grid."""
        if self.nodes is None:
            return self
        best, most = self, -math.inf
        for length in self.nodes.step * LENGTHS:
            shape = _covariance(self.nodes, float(length))
            for size in SIZES:
                precision = _precision(shape, float(size))
                both = precision + information
                likely = (
                    np.linalg.slogdet(precision)[1]
                    - np.linalg.slogdet(both)[1]
                    + gradient @ np.linalg.solve(both, gradient)
                )
                if likely > most:
                    best, most = replace(self, size=float(size), length=float(length)), float(likely)
        return best

    def implausible(
        self, values: Mapping[str, float], model_values: Mapping[str, float], signals: Signals | None = None
    ) -> str:
        """A gradient that leaves no stiffness at a touched place, too."""
        slope = np.array([values.get("gradient1", 0.0), values.get("gradient2", 0.0)])
        if signals is not None and slope.any() and (slope @ signals.slip[:, signals.inside] < -1.0).any():
            return (
                f"a gradient of {slope[0]:.3g} and {slope[1]:.3g} 1/m: no stiffness would be left at some "
                "touched places"
            )
        return super().implausible(values, model_values, signals)

    def meaning(self, values: Mapping[str, float]) -> str:
        """Where it is softest and where stiffest."""
        if self.nodes is None or not values:
            return ""
        ratio = {self.nodes.reference: 1.0} | {k: 1.0 + values.get(f"weight[{k}]", 0.0) for k in self.nodes.free}
        ends = sorted(self.nodes.kept, key=lambda k: ratio[k])
        soft, stiff = (1e3 * self.nodes.places[:, self.nodes.kept.index(k)] for k in (ends[0], ends[-1]))
        return (
            f"{ratio[ends[-1]] / max(ratio[ends[0]], 1e-3):.3g} times as stiff at ({stiff[0]:.1f}, {stiff[1]:.1f}) mm "
            f"as at ({soft[0]:.1f}, {soft[1]:.1f}) mm"
        )

    def elastic(self, s: Signals, p: Array) -> None:
        """Scale the elastic force."""
        if self.nodes is None:
            s.elastic = s.elastic * (1.0 + p[0] * s.slip[0] + p[1] * s.slip[1])
            return
        nodes = self.nodes
        shares = derived(f"shares of {nodes}", lambda: nodes.shares(s.slip), s.slip)
        s.elastic = s.elastic * (1.0 + p @ shares)


def _spots(x: Array) -> tuple[Array, Array]:
    """Middles of the few small places that visited ones x (2, n) gather at [m], (K, 2), and their samples."""
    cell = max(float(np.ptp(x, axis=1).max()) / 60.0, 0.5 * CLOSEST)
    cells, where, number = np.unique(
        np.floor(x / cell).astype(np.int64), axis=1, return_inverse=True, return_counts=True
    )
    none = np.empty((0, 2)), np.empty(0)
    if cells.shape[1] > 6 * OVER:
        return none
    # cells that touch, corners too, are one place
    near = np.abs(cells[:, :, None] - cells[:, None, :]).max(axis=0) <= 1
    count, label = connected_components(near, directed=False)
    often = np.bincount(label, weights=number)
    enough = often >= max(FEW, SHARE * x.shape[1])
    wide = max(int(np.ptp(cells[:, label == k], axis=1).max()) + 1 for k in range(count))
    if not 1 < enough.sum() <= OVER or wide > WIDEST:
        return none
    of_sample = label[where.ravel()]
    middles = [x[:, of_sample == k].mean(axis=1) for k in np.flatnonzero(enough)]
    return np.array(middles), often[enough]


def _direction(x: Array) -> float:
    """Angle of the grid's first axis for visited places x (2, n) [rad]; 0 where the first tangent is as good."""
    cell = max(float(np.ptp(x, axis=1).max()) / 200.0, CLOSEST / 10.0)
    cells = np.unique(np.floor(x / cell), axis=1)  # a place counts as one, however long the tool stayed
    if cells.shape[1] < 2:
        return 0.0
    axes, size, _ = np.linalg.svd(cells - cells.mean(axis=1)[:, None], full_matrices=False)
    angle = math.atan2(axes[1, 0], axes[0, 0])
    angle = (angle + 0.5 * math.pi) % math.pi - 0.5 * math.pi  # a line has two ends
    square = round(angle / (0.5 * math.pi)) * 0.5 * math.pi
    if size[1] > ROUND * size[0] or abs(angle - square) < ALIGNED:
        return 0.0 if size[1] > ROUND * size[0] else abs(square)
    return angle


def _counts(span: Array) -> NDArray[np.int64]:
    """How many nodes along two axes, for places that extend so far [m], (2,)."""
    most = np.maximum(np.floor(span / CLOSEST), 1.0) + 1.0
    if span[1] < NARROW * span[0] or span[1] <= 2.0 * CLOSEST:
        out = np.array([ALONG, 1.0])
    elif span[0] < NARROW * span[1] or span[0] <= 2.0 * CLOSEST:
        out = np.array([1.0, ALONG])
    else:
        first = min(max(math.sqrt(OVER * span[0] / span[1]), 2.0), 12.0)
        out = np.round([first, max(OVER / first, 2.0)])
    return np.asarray(np.minimum(out, most), dtype=np.int64)


def _turned(x: Array, angle: float) -> Array:
    """Places (2, n) in axes that are turned by an angle [rad]."""
    c, s = math.cos(angle), math.sin(angle)
    out: Array = np.array([[c, s], [-s, c]]) @ x
    return out


def _covariance(nodes: Nodes, length: float) -> Array:
    """Of values at the free nodes less that at the reference, for a profile of size 1 (Matérn 3/2), (K − 1, K − 1)."""
    x = nodes.places
    far = math.sqrt(3.0) * np.linalg.norm(x[:, :, None] - x[:, None, :], axis=0) / length
    full = (1.0 + far) * np.exp(-far)
    at = nodes.kept.index(nodes.reference)
    rest = np.arange(len(nodes.kept)) != at
    out: Array = full[np.ix_(rest, rest)] - full[rest, at][:, None] - full[at, rest] + full[at, at]
    return out + 1e-8 * np.eye(int(rest.sum()))


def _precision(shape: Array, size: float) -> Array:
    """Of weights whose covariance is that of a profile of size 1 times the square of a size."""
    inverse = np.linalg.inv(shape)
    out: Array = 0.5 * (inverse + inverse.T) / size**2
    return out
