"""Where the material changes along a slide: steps in what is felt, each with an interval, at a stated false-alarm rate.

Two detectors. `by_slope` is the plain one: |∂F/∂x| above a threshold. `changes` is a cumulative-sum test: for every
place it compares what is felt before and behind it (force over depth, friction over force), beside a linear trend (a
surface that is a little tilted), and alarms where the largest of these contrasts exceeds what chance reaches with the
stated probability. A step's contrast is a weighted
cumulative sum of the forces (Page, Biometrika 41, 1954; Brown, Durbin & Evans, J. R. Stat. Soc. B 37, 1975); the
threshold comes from simulated noise, and coloured noise is allowed for by its long-run variance.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np
from numpy.typing import NDArray

from kinid.contact.series import ContactSeries
from kinid.errors import InputError

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

#: forces are averaged over so long a way [m]
BIN = 2e-4
#: so much of the way at its start is left out [m]
SETTLE = 1.5e-3
#: no step is looked for within this share of the ends, nor in a stretch of fewer bins
TRIM, FEWEST = 0.08, 25
#: half widths of the transitions that are tried [m]: a tip is blunt, and materials flow into each other
WIDTHS = (0.0, 5e-4, 1e-3, 2e-3)
#: −2 log likelihood ratio that 95 % of steps stay below at their true place (Hansen, Econometrica 68, 2000)
HANSEN = 7.35
#: thresholds are simulated for bins in steps of so many, so many times
STEP_OF_COUNT, SIMULATIONS = 10, 400
#: share of a transition's half width that its middle may be off
BLUR = 0.25
#: a step that is smaller than this share of the mean is no other material, however sure it is
MATERIAL = 0.04


@dataclass(frozen=True, eq=False)
class SlidePath:
    """What was felt along a straight way, in equal bins.

    Attributes:
        x: along the way, from the surface's point [m], (n,). normal, tangential: forces [N], (n,) each, the second
            against the slip. depth: [m], (n,).
        origin, direction: the way's own zero [m] and its unit vector, along both tangents, (2,) each.
    """

    x: Array
    normal: Array
    tangential: Array
    depth: Array
    origin: Array
    direction: Array

    @property
    def forces(self) -> Array:
        """Both, (2, n)."""
        return np.stack([self.normal, self.tangential])

    @property
    def felt(self) -> Array:
        """Force over depth [N/m] and tangential over normal force, (2, n): what depth and its transients change
        least.
        """
        return np.stack([self.normal / self.depth, self.tangential / self.normal])

    def at(self, x: float) -> Array:
        """Along both tangents [m], (2,)."""
        return np.asarray(self.origin + x * self.direction)

    def part(self, a: int, b: int) -> SlidePath:
        """Bins [a, b)."""
        return SlidePath(
            self.x[a:b], self.normal[a:b], self.tangential[a:b], self.depth[a:b], self.origin, self.direction
        )


@dataclass(frozen=True)
class Border:
    """A change of material along a slide: place and its 95 % interval along the way [m], half width [m].

    The steps are of force over depth [N/m] and of tangential over normal force; `score` is the contrast over the
    threshold: above 1 it is an alarm.
    """

    place: float
    low: float
    high: float
    stiffness_step: float
    friction_step: float
    score: float
    width: float


def paths(touch: ContactSeries, *, shortest: float = 4e-3, bin_size: float = BIN) -> list[SlidePath]:
    """The straight stretches of steady slip in one direction that are long enough [m].

    Raises:
        InputError: no such stretch.
    """
    good = touch.valid & touch.in_contact & np.isfinite(touch.slip_rate1 + touch.tangential_force1)
    rate = np.stack([touch.slip_rate1, touch.slip_rate2])
    speed = np.hypot(*np.nan_to_num(rate))
    moving = good & (speed > 0.5 * np.quantile(speed[good], 0.9) if good.any() else good)
    # a direction of one run: that of the samples around; a run ends where the direction turns
    out: list[SlidePath] = []
    edges = np.diff(moving.astype(np.int8), prepend=0, append=0)
    for a, b in zip(np.flatnonzero(edges == 1).tolist(), np.flatnonzero(edges == -1).tolist()):
        place = np.stack([touch.slip1[a:b], touch.slip2[a:b]])
        way = place[:, -1] - place[:, 0]
        length = float(np.hypot(*way))
        if length < shortest:
            continue
        u = way / length
        along = u @ place
        rows = np.stack(
            [
                touch.normal_force[a:b],
                -(u @ np.stack([touch.tangential_force1[a:b], touch.tangential_force2[a:b]])),
                touch.depth[a:b],
            ]
        )
        # where a slide starts and ends is left out: the tool has yet to tilt against its friction
        keep = (along - along[0] >= SETTLE) & (along[-1] - along >= bin_size) & (rows[0] > 0) & (rows[2] > 0)
        cell = np.floor((along[keep] - along[0]) / bin_size).astype(int)
        if len(np.unique(cell)) < FEWEST:
            continue
        count = np.bincount(cell)
        filled = count > 0
        x, *mean = [np.bincount(cell, row)[filled] / count[filled] for row in (along[keep], *rows[:, keep])]
        out.append(SlidePath(x, mean[0], mean[1], mean[2], place.mean(axis=1) - u * (u @ place.mean(axis=1)), u))
    if not out:
        raise InputError(
            f"no slide of {1e3 * shortest:g} mm in one direction in {touch.provenance.source}",
            "steady slip in contact",
            "slide further, or lower the shortest way",
        )
    return out


def by_slope(path: SlidePath, threshold: float, smooth: float = 1e-3) -> list[tuple[float, float]]:
    """Stretches in which a force changes faster than a threshold [N/m]: their ends [m].

    Args:
        path: a slide. threshold: of |∂F/∂x| of either force. smooth: half width of the window of the slope [m].
    """
    if not threshold > 0:
        raise InputError(f"a threshold of {threshold} N/m", "a positive slope", "correct it")
    half = max(2, round(smooth / float(np.median(np.diff(path.x)))))
    if len(path.x) < 2 * half + 1:
        return []
    above = np.zeros(len(path.x), np.bool_)
    for i in range(half, len(path.x) - half):
        x = path.x[i - half : i + half + 1] - path.x[i]
        above[i] = np.any(
            np.abs(path.forces[:, i - half : i + half + 1] @ (x - x.mean())) > threshold * (x @ (x - x.mean()))
        )
    edges = np.diff(above.astype(np.int8), prepend=0, append=0)
    starts, ends = np.flatnonzero(edges == 1), np.flatnonzero(edges == -1)
    return [(float(path.x[a]), float(path.x[b - 1])) for a, b in zip(starts, ends)]


def changes(path: SlidePath, false_alarms: float = 1e-3) -> list[Border]:
    """Where the material changes, in order of place.

    Args:
        path: a slide. false_alarms: probability that a slide on one material gives any alarm.

    Raises:
        InputError: a probability outside (0, 0.5], or too short a slide.
    """
    if not 0 < false_alarms <= 0.5:
        raise InputError(f"a false-alarm rate of {false_alarms}", "a probability above 0, up to 0.5", "correct it")
    if len(path.x) < FEWEST:
        raise InputError(f"a slide of {len(path.x)} bins", f"{FEWEST} at least", "slide further")
    found: list[Border] = []
    todo = [(0, len(path.x))]
    while todo:
        a, b = todo.pop()
        if b - a < FEWEST:
            continue
        border = _largest(path.part(a, b), false_alarms)
        if border is None:
            continue
        found.append(border)
        # what is beside the transition goes on being looked at
        gap = max(3 * border.width, border.high - border.low, 5 * BIN)
        cut_low = int(np.searchsorted(path.x, border.place - gap))
        cut_high = int(np.searchsorted(path.x, border.place + gap))
        todo += [(a, max(a, min(cut_low, b))), (min(b, max(cut_high, a)), b)]
    return sorted(found, key=lambda border: border.place)


def _largest(path: SlidePath, false_alarms: float) -> Border | None:
    """The step with the largest contrast, where it is an alarm."""
    x, felt = path.x, path.felt
    score, width = _contrasts(x, felt)
    top, limit = (
        float(score.max()),
        _threshold(STEP_OF_COUNT * round(len(x) / STEP_OF_COUNT), round(1e6 * false_alarms)),
    )
    if top <= limit:
        return None
    centres = _centres(x)
    k = int(score.argmax())
    inside = centres[score >= top - HANSEN]
    design = np.column_stack([_trend(x), _steps(x, centres[k : k + 1], width)[0]])
    step = np.linalg.lstsq(design, felt.T, rcond=None)[0][2]
    if np.all(np.abs(step) < MATERIAL * np.abs(felt.mean(axis=1))):
        return None
    # half a bin, and a part of the transition, whose shape is unknown
    half = 0.5 * float(np.median(np.diff(x))) + BLUR * width
    return Border(
        float(centres[k]),
        float(inside.min()) - half,
        float(inside.max()) + half,
        float(step[0]),
        float(step[1]),
        top / limit,
        width,
    )


def _contrasts(x: Array, felt: Array) -> tuple[Array, float]:
    """Squared contrast of a step at each of the centres over the noise, summed over both channels; and its half width
    [m].

    The noise is what a step of this width at its best place leaves, with its colour.
    """
    trend = _trend(x)
    clean = felt - (felt @ trend) @ trend.T
    white = _white(felt)
    best: tuple[float, Array, float] | None = None
    for width in WIDTHS:
        shapes = _steps(x, _centres(x), width)
        shapes -= (shapes @ trend) @ trend.T
        shapes /= np.linalg.norm(shapes, axis=1, keepdims=True)
        contrast = clean @ shapes.T  # (2, centres)
        k = int(np.argmax(np.sum((contrast / white[:, None]) ** 2, axis=0)))
        noise = _long_run(clean - np.outer(contrast[:, k], shapes[k]))
        score = np.sum((contrast / noise[:, None]) ** 2, axis=0)
        if best is None or score.max() > best[0]:
            best = (float(score.max()), score, width)
    assert best is not None
    return best[1], best[2]


def _trend(x: Array) -> Array:
    """Orthonormal level and slope, (n, 2)."""
    return np.asarray(np.linalg.qr(np.column_stack([np.ones(len(x)), x - x.mean()]))[0])


def _centres(x: Array) -> Array:
    """Places of steps that are tried."""
    cut = round(TRIM * len(x))
    return np.asarray(x[cut : len(x) - cut])


def _steps(x: Array, centres: Array, width: float) -> Array:
    """Unit steps at places, (centres, n)."""
    away = x - centres[:, None]
    if width == 0.0:
        return np.asarray(0.5 * (1.0 + np.sign(away + 1e-12)))
    return np.asarray(0.5 * (1.0 + np.tanh(away / width)))


def _white(forces: Array) -> Array:
    """White noise of each channel from differences of neighbours, (2,)."""
    return np.asarray(np.maximum(1.4826 * np.median(np.abs(np.diff(forces, axis=1)), axis=1) / np.sqrt(2), 1e-9))


def _long_run(residual: Array) -> Array:
    """Long-run standard deviation of residuals, σ (1 + ρ)/(1 − ρ) to the half with ρ of an AR(1), (2,)."""
    sigma = residual.std(axis=1)
    rho = np.sum(residual[:, 1:] * residual[:, :-1], axis=1) / np.maximum(np.sum(residual**2, axis=1), 1e-300)
    # short residuals understate their correlation (Kendall, Biometrika 41, 1954)
    rho = np.clip(rho + (1 + 4 * rho) / residual.shape[1], 0.0, 0.95)
    return np.asarray(np.maximum(sigma * np.sqrt((1 + rho) / (1 - rho)), _white(residual)))


@cache
def _threshold(n: int, parts_per_million: int) -> float:
    """What the largest contrast in n bins of coloured noise (AR(1), ρ = 0.5) exceeds with this probability.

    Simulated with the noise estimated as in a measurement; beyond 1 in 50 continued as its logarithm goes from 1 in 5
    on.
    """
    rng = np.random.default_rng(np.random.SeedSequence([n, 77]))
    x: Array = np.arange(n, dtype=np.float64) * BIN
    tops = np.empty(SIMULATIONS)
    for i in range(SIMULATIONS):
        noise = rng.standard_normal((2, n + 20))
        for k in range(1, n + 20):
            noise[:, k] += 0.5 * noise[:, k - 1]
        tops[i] = _contrasts(x, noise[:, 20:])[0].max()
    alpha = parts_per_million * 1e-6
    if alpha >= 0.02:
        return float(np.quantile(tops, 1 - alpha))
    often, seldom = np.quantile(tops, (0.8, 0.98))
    return float(seldom + (seldom - often) / np.log(10.0) * np.log(0.02 / alpha))
