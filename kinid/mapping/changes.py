"""Borders along slides: any number on each, all placed together, with their standard deviations.

Along a straight stretch of slip in one direction two quantities are felt, N/δ and T/N, that depth and its transients
change least. The model of both is a level, a slope (a surface that is a little tilted) and a sum of smooth steps
½ (1 + tanh((x − p)/w)), whose places p and half widths w both share. Steps are added one by one where they explain
most, and each time all places and widths are fitted anew by least squares, levels and steps projected out (G. H. Golub,
V. Pereyra, SIAM J. Numer. Anal. 10, 1973): up and down again looks like nothing to a single step. Then the least of
them goes, as long as it gains less in −2 log likelihood than the largest of all candidates reaches by chance with the
stated probability, or is too small to be another material.

The noise is the long-run one of what is left: colour is allowed for. A material that relaxes behind each turn, or a law
that lacks something else, draws steps too, which no noise explains. They go with time and not with place: a border is
believed where passes in both directions show it; else it has a doubt.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from kinid.contact.series import ContactSeries
from kinid.errors import InputError

Array = NDArray[np.float64]

#: what is felt is averaged over so long a way [m]
BIN = 1e-4
#: so much of a leg's start and end is left out [m]: bristles and the tool have yet to turn around
SETTLE, END = 1e-3, 2e-4
#: shortest leg [m], and fewest bins of one
SHORTEST, FEWEST = 4e-3, 25
#: a leg's slip is faster than this share of the usual, and turns by less than this cosine
MOVING, STRAIGHT = 0.3, 0.9
#: half widths of steps that are tried [m], and the least and largest that a fit may find
WIDTHS, NARROWEST, WIDEST = (1e-4, 3e-4, 1e-3, 2e-3), 3e-5, 4e-3
#: no step is looked for nearer to a leg's ends than this, nor to another step [m]; a fit moves one by so much at once
RIM, APART, REACH = 6e-4, 1.5e-3, 4e-4
#: a step below this share of the level is no other material, however sure it is
MATERIAL = 0.04
#: share of a transition's half width that its middle may be off: its shape isn't known
BLUR = 0.15
#: nearer than this to a leg's end the level beyond a border is hardly seen [m], and its place is off by such a share of
#: what is lacking
HARDLY, LACKING = 1.5e-3, 0.1
#: a leg with more borders than this is no row of materials
MOST = 30
#: two passes show one border where their places differ by no more than this beside their standard deviations, and their
#: ways by no more than that across [m], and their steps by no more than this factor
SAME, ACROSS, ALIKE = 1e-3, 3e-3, 2.0


class Felt(NamedTuple):
    """What a material is felt by: stiffness N/δ [N/m] and friction T/N."""

    stiffness: float
    friction: float


@dataclass(frozen=True)
class Change:
    """A border that a slide crossed.

    Attributes:
        t: when [s]. slip1, slip2: where [m]. sd: standard deviation of the place along the slip [m].
        before, after: what was felt on both sides, in the order of time. width: half width of the transition [m].
        direction: of the slip, from tangent1 [rad]. score: gain over what chance reaches; above 1 is an alarm.
        doubt: why it may be none; "" where nothing speaks against it.
    """

    t: float
    slip1: float
    slip2: float
    sd: float
    before: Felt
    after: Felt
    width: float
    direction: float
    score: float
    doubt: str = ""

    @property
    def place(self) -> Array:
        """Along both tangents [m], (2,)."""
        return np.array([self.slip1, self.slip2])

    @property
    def ahead(self) -> Array:
        """Unit vector of the slip along both tangents, (2,)."""
        return np.array([np.cos(self.direction), np.sin(self.direction)])

    @property
    def share(self) -> Array:
        """The steps of stiffness and friction in the order of time, as shares of their level, (2,)."""
        before, after = np.array(self.before), np.array(self.after)
        return np.asarray(2.0 * (after - before) / np.maximum(np.abs(after + before), 1e-12))

    def to_dict(self) -> dict[str, object]:
        """Its facts, as JSON has them."""
        return {
            "t": self.t,
            "slip1": self.slip1,
            "slip2": self.slip2,
            "sd": self.sd,
            "before": self.before._asdict(),
            "after": self.after._asdict(),
            "width": self.width,
            "direction": self.direction,
            "doubt": self.doubt or None,
        }


@dataclass(frozen=True, eq=False)
class Leg:
    """A straight stretch in one direction, in bins: way from its start [m], what is felt (2, n), and time [s]."""

    x: Array
    felt: Array
    t: Array
    start: Array
    direction: Array

    def crosses(self, place: Array) -> bool:
        """Whether it passes a place (2,) [m] as a border could be seen there."""
        along = float((place - self.start) @ self.direction)
        aside = float(np.hypot(*(place - self.start - along * self.direction)))
        return aside <= ACROSS and self.x[0] + RIM <= along <= self.x[-1] - RIM


def find_changes(touch: ContactSeries, false_alarms: float = 1e-3) -> list[Change]:
    """Where the material changes along the slides of a log, in the order of time.

    Args:
        touch: a log with slides. false_alarms: probability that a leg on one material gives any alarm.

    Raises:
        InputError: a probability outside (0, 0.5], or no slide.
    """
    if not 0 < false_alarms <= 0.5:
        raise InputError(f"a false-alarm rate of {false_alarms}", "a probability above 0, up to 0.5", "correct it")
    found = legs(touch)
    if not found:
        raise InputError(
            f"no slide of {1e3 * SHORTEST:g} mm in one direction in {touch.provenance.source}",
            "steady slip in contact, along a straight way",
            "slide further",
        )
    borders = [change for leg in found for change in _changes(leg, false_alarms)]
    return [replace(change, doubt=_doubt(change, borders, found)) for change in borders]


def _doubt(change: Change, every: list[Change], passes: list[Leg]) -> str:
    """Why a border may be none; "" where a way back shows it, too."""
    if any(_same(change, other) for other in every):
        return ""
    back = any(leg.direction @ change.ahead < -STRAIGHT and leg.crosses(change.place) for leg in passes)
    return "the way back across it shows none" if back else "nothing slid back across it"


def _same(change: Change, back: Change) -> bool:
    """Whether a border is that of a way back: at one place, and the other way round."""
    off = back.place - change.place
    near = abs(float(off @ change.ahead)) <= SAME + 2.0 * float(np.hypot(change.sd, back.sd))
    largest = int(np.argmax(np.abs(change.share)))
    ratio = -float(back.share[largest]) / float(change.share[largest])  # what is crossed the other way round
    turned = float(back.ahead @ change.ahead) < -STRAIGHT and 1.0 / ALIKE <= ratio <= ALIKE
    return turned and near and float(np.hypot(*off)) <= ACROSS


def legs(touch: ContactSeries) -> list[Leg]:
    """The straight stretches of slip in one direction."""
    rate = np.stack([touch.slip_rate1, touch.slip_rate2])
    good = touch.valid & touch.in_contact & np.isfinite(rate.sum(axis=0) + touch.tangential_force1)
    good &= (touch.depth > 0.0) & (touch.normal_force > 0.0)
    speed = np.hypot(*np.nan_to_num(rate))
    if not good.any():
        return []
    moving = good & (speed > MOVING * np.quantile(speed[good], 0.9))
    out: list[Leg] = []
    edges = np.diff(moving.astype(np.int8), prepend=0, append=0)
    for a, b in zip(np.flatnonzero(edges == 1).tolist(), np.flatnonzero(edges == -1).tolist()):
        place = np.stack([touch.slip1[a:b], touch.slip2[a:b]])
        way = place[:, -1] - place[:, 0]
        length = float(np.hypot(*way))
        travelled = float(np.hypot(*np.diff(place, axis=1)).sum()) if b - a > 1 else 0.0
        if length < SHORTEST:
            continue
        u = way / length
        # noise makes the travelled way longer than it is, but not by much; a turn makes the straight one shorter
        if np.median((u @ rate[:, a:b]) / speed[a:b]) < STRAIGHT or travelled > 2.0 * length:
            continue
        leg = _binned(touch, slice(a, b), place, u)
        if leg is not None:
            out.append(leg)
    return out


def _binned(touch: ContactSeries, rows: slice, place: Array, u: Array) -> Leg | None:
    """Means over equal ways of what a leg felt; None where too little is left."""
    along = u @ (place - place[:, :1])
    keep = (along >= SETTLE) & (along[-1] - along >= END)
    if np.count_nonzero(keep) < FEWEST:
        return None
    resisting = -(u @ np.stack([touch.tangential_force1[rows], touch.tangential_force2[rows]]))
    columns = np.stack([along, touch.normal_force[rows], resisting, touch.depth[rows], touch.t[rows]])[:, keep]
    cell = ((columns[0] - columns[0].min()) / BIN).astype(int)
    count = np.bincount(cell)
    filled = count > 0
    if np.count_nonzero(filled) < FEWEST:
        return None
    x, normal, tangential, depth, t = (np.bincount(cell, row)[filled] / count[filled] for row in columns)
    return Leg(x, np.stack([normal / depth, tangential / normal]), t, place[:, 0], u)


def _changes(leg: Leg, false_alarms: float) -> list[Change]:
    """The borders of a leg."""
    noise = _white(leg.felt)
    limit = 2.0 * np.log(len(leg.x) * len(WIDTHS) / false_alarms)
    places, widths = np.empty(0), np.empty(0)
    while len(places) < MOST:
        best = _candidate(leg, places, widths, noise)
        if best is None or best[2] <= limit:
            break
        places, widths = _refined(leg, np.append(places, best[0]), np.append(widths, best[1]), noise)
    while len(places):
        long_run = _long_run(_left(leg, places, widths))
        scores = np.array([_gain(leg, places, widths, k, long_run) for k in range(len(places))]) / limit
        steps = np.abs(_levels(leg, places, widths)[2:]) / np.abs(leg.felt.mean(axis=1))
        scores = np.minimum(scores, steps.max(axis=1) / MATERIAL)
        least = int(scores.argmin())
        if scores[least] >= 1.0:
            sd = _deviations(leg, places, widths, long_run)
            return [_change(leg, places, widths, int(k), sd, scores) for k in np.argsort(places)]
        places, widths = _refined(leg, np.delete(places, least), np.delete(widths, least), noise)
    return []


def _gain(leg: Leg, places: Array, widths: Array, k: int, noise: Array) -> float:
    """What a step explains beside the others, as a difference of −2 log likelihood."""
    without = _left(leg, np.delete(places, k), np.delete(widths, k))
    change = (without**2).sum(axis=1) - (_left(leg, places, widths) ** 2).sum(axis=1)
    return float((change / noise**2).sum())


def _change(leg: Leg, places: Array, widths: Array, k: int, sd: Array, scores: Array) -> Change:
    """One of the borders, with what was felt beside it."""
    levels = _levels(leg, places, widths)
    order = np.argsort(places)
    passed = [i for i in order if places[i] < places[k]]
    before = levels[0] + levels[1] * (places[k] - leg.x.mean()) + levels[[2 + i for i in passed]].sum(axis=0)
    after = before + levels[2 + k]
    where = leg.start + places[k] * leg.direction
    return Change(
        float(np.interp(places[k], leg.x, leg.t)),
        float(where[0]),
        float(where[1]),
        float(sd[k]),
        Felt(*map(float, before)),
        Felt(*map(float, after)),
        float(widths[k]),
        float(np.arctan2(leg.direction[1], leg.direction[0])),
        float(scores[k]),
    )


def _design(x: Array, places: Array, widths: Array) -> Array:
    """Level, slope and steps, (n, 2 + k)."""
    steps = 0.5 * (1.0 + np.tanh((x[:, None] - places) / widths))
    return np.column_stack([np.ones(len(x)), x - x.mean(), steps])


def _levels(leg: Leg, places: Array, widths: Array) -> Array:
    """Level, slope and steps of both quantities, (2 + k, 2)."""
    return np.asarray(np.linalg.lstsq(_design(leg.x, places, widths), leg.felt.T, rcond=None)[0])


def _left(leg: Leg, places: Array, widths: Array) -> Array:
    """What the model leaves, (2, n)."""
    return np.asarray(leg.felt - (_design(leg.x, places, widths) @ _levels(leg, places, widths)).T)


def _candidate(leg: Leg, places: Array, widths: Array, noise: Array) -> tuple[float, float, float] | None:
    """Place, width and gain of the step that explains most of what is left; None where there is no room."""
    basis = np.linalg.qr(_design(leg.x, places, widths))[0]
    left = (leg.felt - (leg.felt @ basis) @ basis.T) / noise[:, None]
    centres = leg.x[(leg.x - leg.x[0] >= RIM) & (leg.x[-1] - leg.x >= RIM)]
    centres = centres[[bool(np.all(np.abs(c - places) >= APART)) for c in centres]]
    best: tuple[float, float, float] | None = None
    for width in WIDTHS:
        if len(centres) == 0:
            return None
        steps = 0.5 * (1.0 + np.tanh((leg.x - centres[:, None]) / width))
        steps -= (steps @ basis) @ basis.T
        size = np.maximum(np.linalg.norm(steps, axis=1), 1e-6)
        gain = ((left @ (steps / size[:, None]).T) ** 2).sum(axis=0)
        k = int(gain.argmax())
        if best is None or gain[k] > best[2]:
            best = float(centres[k]), width, float(gain[k])
    return best


def _refined(leg: Leg, places: Array, widths: Array, noise: Array) -> tuple[Array, Array]:
    """Places and widths by least squares, all together, levels and steps projected out."""
    from scipy.optimize import least_squares

    k = len(places)
    if k == 0:
        return places, widths
    low = np.concatenate([np.maximum(places - REACH, leg.x[0]), np.full(k, np.log(NARROWEST))])
    high = np.concatenate([np.minimum(places + REACH, leg.x[-1]), np.full(k, np.log(WIDEST))])

    def residual(p: Array) -> Array:
        return np.ravel(_left(leg, p[:k], np.exp(p[k:])) / noise[:, None])

    start = np.clip(np.concatenate([places, np.log(widths)]), low + 1e-9, high - 1e-9)
    scale = np.concatenate([np.full(k, BIN), np.ones(k)])
    found = least_squares(residual, start, bounds=(low, high), x_scale=scale, diff_step=1e-4, max_nfev=60)
    return found.x[:k], np.exp(found.x[k:])


def _deviations(leg: Leg, places: Array, widths: Array, noise: Array) -> Array:
    """Standard deviations of the places [m]: of the fit, the bins, the transition's shape, and of short ends."""
    k = len(places)
    steps = np.concatenate([np.full(k, 0.1 * BIN), np.full(k, 0.02)])
    p = np.concatenate([places, np.log(widths)])
    columns = []
    for i in range(2 * k):
        up, down = p.copy(), p.copy()
        up[i], down[i] = p[i] + steps[i], p[i] - steps[i]
        change = _left(leg, up[:k], np.exp(up[k:])) - _left(leg, down[:k], np.exp(down[k:]))
        columns.append(np.ravel(change / noise[:, None]) / (2.0 * steps[i]))
    information = np.array(columns) @ np.array(columns).T
    # nothing is known beforehand of widths but that they lie within a factor of about ten
    information[range(k, 2 * k), range(k, 2 * k)] += 1.0 / 1.2**2
    variance = np.diagonal(np.linalg.pinv(information))[:k]
    lacking = LACKING * np.maximum(HARDLY - np.minimum(places - leg.x[0], leg.x[-1] - places), 0.0)
    return np.asarray(np.sqrt(variance + BIN**2 / 12.0 + (BLUR * widths) ** 2 + lacking**2))


def _white(felt: Array) -> Array:
    """White noise of each quantity from differences of neighbours, (2,)."""
    return np.asarray(np.maximum(1.4826 * np.median(np.abs(np.diff(felt, axis=1)), axis=1) / np.sqrt(2), 1e-9))


def _long_run(residual: Array) -> Array:
    """Long-run standard deviation of residuals, σ √((1 + ρ)/(1 − ρ)) with ρ of an AR(1), (2,)."""
    sigma = residual.std(axis=1)
    rho = np.sum(residual[:, 1:] * residual[:, :-1], axis=1) / np.maximum(np.sum(residual**2, axis=1), 1e-300)
    # short residuals understate their correlation (Kendall, Biometrika 41, 1954)
    rho = np.clip(rho + (1 + 4 * rho) / residual.shape[1], 0.0, 0.95)
    return np.asarray(np.maximum(sigma * np.sqrt((1 + rho) / (1 - rho)), _white(residual)))
