"""A sensor at the end of its range."""

from __future__ import annotations

from dataclasses import dataclass
from typing import final

import numpy as np

from kinid.effects._effect import Effect
from kinid.effects._example import Example, Motion
from kinid.effects._samples import QUIETEST, Detection, Mask, Samples, lattice
from kinid.effects._signals import Array, Layout, Signals
from kinid.parameter import Parameter
from kinid.signal.noise import ROBUST, THIRD_DIFFERENCE, white_noise

#: so many samples at the very same largest value are a flat top
FLAT = 5
#: … and, where noise comes behind the end of the range, so many within three standard deviations of one level, at a
#: density so many times that of the values below it
PILED, DENSER = 40, 5.0
#: values below the level, in standard deviations: near it, and on to where they come from, short of no load at all.
#: Loads that come to rest by themselves slow down and are denser near it, by 2 or more (a landing with s³, the top of a
#: sine); those that are cut off aren't
BELOW, NEAR, FAR, SLOWED = 3.5, 8.0, 40.0, 1.6
#: share of a log that must be left beside flat tops; else they stay in
ENOUGH_LEFT = 0.15
#: from this multiple of the noise on, a lattice lets several samples share their largest value by chance; so do
#: readings of which this share is that of the sample before
SHARED, REPEATED = 0.1, 0.02
#: fewer values than this are a lattice, not a range
FEWEST_VALUES = 20
#: what a model expects beyond a level by so many standard deviations is beyond it: so much of a pile must be, and where
#: it is so by as many of the model's own errors, so much of it must be in the pile; so much of the pile may be expected
#: below the level
BEYOND, PART_BEYOND, STAYS, PART_BELOW = 3.0, 0.5, 0.9, 0.2
#: what a model expects beyond the level by this share of it is what sensors within their data sheets leave
NONLINEAR = 0.02
#: however large a model's errors are, what it expects below the level by this share of it is below
FAR_BELOW = 0.25
#: readings from these shares of the largest on tell the noise at the end of the range, if they are so many
TOPS, ENOUGH = (0.9, 0.97), 20
#: in the pile, readings rise with all that is expected beyond it by less than so many standard deviations
RISES = 1.0
#: how wide a pile is at most, in standard deviations of the noise
NARROW = 1.3
#: a pile that a model confirms is this dense at least, beside the values below it, and this wide at most
CONFIRMED, WIDE = 0.8, 1.5
#: a model that was fitted to clipped readings expects too little everywhere, by this at most; a steep law that levels
#: off by more
FLATTENED = 3.0


@final
@dataclass(frozen=True)
class Saturation(Effect):
    """y = min(max(f, −L), L) for each channel, with noise before it or behind.

    Noise before the end of the range leaves a top that is exactly flat: the limit is read off it. Noise behind leaves
    values that pile up about the limit: it is a free parameter, and the pile where a search begins. A pile alone is no
    proof, as the holds of a load that comes with a jerk look alike: readings that a model expects beyond it are.

    Attributes:
        reached: numbers of the channels whose end of the range a model confirmed; None: the readings alone tell.
    """

    reached: tuple[int, ...] | None = None

    id = "saturation"
    title = "end of the sensor's range"
    equation = "y = min(max(f, −L), L)"
    source = "any sensor's data sheet (range)"
    signature = "flat tops at one value"
    confusions = {
        "stiffening-layer": "loads beyond the range; other channels: they go on",
        "relaxation": "loads beyond the range; other channels: they go on",
    }
    excited_by = "loads beyond the range"
    needs = ()
    detector = True
    detection_order = 0
    null = {"limit": 1e12}
    affine = False
    order = 3
    admissible = {"limit": (1e-9, 1e12)}  # a range of 0 reads nothing
    example = Example(("hooke",), {"limit": (8.0, 9.0, 12.0, 0.5, 0.4, 0.1)}, Motion.WRENCH)

    def parameters(self, layout: Layout) -> tuple[Parameter, ...]:
        """One limit a channel."""
        sizes = {"N": 100.0, "N·m": 5.0}
        return tuple(
            Parameter(f"limit[{name}]", "L", unit, sizes[unit], 0.0, 1e12, scale=0.01 * sizes[unit])
            for name, unit in zip(layout.channels, layout.units)
        )

    def detected(self, measured: Array) -> tuple[Array, Array]:
        """The largest reading where several samples share it; else none, and a free one where values pile up."""
        sizes = np.abs(np.where(np.isfinite(measured), measured, 0.0))
        top = sizes.max(axis=1)
        flat = ((sizes >= top[:, None] * (1 - 1e-9)).sum(axis=1) >= FLAT) & (top > 0)
        open_ = np.isfinite(self.piles(measured)) & ~flat
        if self.reached is not None:
            here = np.isin(np.arange(len(measured)), self.reached)
            flat, open_ = flat & here, open_ & here
        limits: Array = np.where(flat, top, self.null["limit"])
        return limits, np.where(open_, np.nan, limits)

    def piles(self, measured: Array) -> Array:
        """The level about which the largest readings of each channel pile up with noise, NaN without one."""
        return self._piles(measured, alone=self.reached is None)

    def _piles(self, measured: Array, alone: bool) -> Array:
        """The same; `alone` is whether the pile must tell it from loads that rest, which a model does else."""
        limits = (DENSER, SLOWED, NARROW) if alone else (CONFIRMED, np.inf, WIDE)
        return np.array([_pile(channel[np.isfinite(channel)], *limits) for channel in measured])

    def detect(self, samples: Samples) -> Detection | None:
        """Flat tops, exact ones or with noise where the model goes on; samples at and beside them don't count."""
        raw = samples.raw
        limits, flat = self._flat_tops(samples)
        exact = np.asarray(flat.any(axis=1))
        for channel, level in enumerate(self._piles(raw, alone=False)):
            x = raw[channel][np.isfinite(raw[channel])]
            if not exact[channel] and np.isfinite(level):
                found = [_cut_off_there(samples, channel, level, max(sigma, lattice(x))) for sigma in _noises(x)]
                flat[channel] = max(found, key=np.count_nonzero)
                limits[channel] = level
        hit = np.asarray(flat.any(axis=1))
        if not hit.any():
            return None
        limits = np.where(hit, limits, self.null["limit"])
        at = np.asarray(flat.any(axis=0))
        says = f"flat tops: {samples.named(limits, hit, 'at')} in {int(at.sum())} samples"
        if (hit & ~exact).any():
            says += ", with noise on them, where the model expects more"
        for wide in (1, 0):
            keep = ~(np.convolve(at, np.ones(2 * wide + 1), mode="same") > 0)
            if np.sum(keep & samples.valid) > ENOUGH_LEFT * samples.valid.sum():
                break
        else:
            keep = np.ones(len(at), np.bool_)  # clipped nearly everywhere: what is left would be no log
        # flat tops have no noise: a channel's own shows beside them
        noise = np.maximum(samples.noise, samples.white(raw, samples.valid & keep))
        reached = tuple(np.flatnonzero(hit).tolist())
        return Detection(limits, says, form={"reached": reached}, keep=keep, noise=noise, relative=not exact.any())

    def unseen(self, rate: float) -> str:
        """A load within the range says nothing of its end."""
        return "no reading stays at a largest value: the end of the range was not reached"

    def _flat_tops(self, samples: Samples) -> tuple[Array, Mask]:
        """Largest size of each channel, and samples, (channels, n), that have it where it is the end of a range."""
        raw = samples.raw
        limits = self.detected(raw)[0]
        flat: Mask = np.abs(raw) >= limits[:, None] * (1 - 1e-9)
        for channel, (x, limit) in enumerate(zip(raw, limits)):
            # a reading that never changes is not a clipped one; the end of a range holds a reading for a while, single
            # samples meet at a largest value by chance
            if len(np.unique(x[:: max(1, len(x) // 5000)])) <= FEWEST_VALUES or _resting(flat[channel]) < FLAT:
                flat[channel] = False
            # nor is a coarse one that reaches its highest step now and then, or one that is repeated, unless the model
            # goes on, or noise that is wider than a step stops there
            step, noise = lattice(x) if flat[channel].any() else 0.0, float(samples.noise[channel])
            chance = step > SHARED * noise or np.mean(np.diff(x[~flat[channel]]) == 0.0) > REPEATED
            asked = samples.expected is not None and flat[channel].any() and chance
            if asked and not _stops(x, samples.valid & ~flat[channel], limit, step):
                flat[channel] &= _cut_off_there(samples, channel, limit, max(step, noise)).any()
        return limits, flat

    def initial_guesses(self, signals: Signals) -> tuple[Array, ...]:
        """Limits at the piles."""
        if signals.measured is None:
            return ()
        raw = signals.measured if signals.as_read is None else signals.as_read.raw(signals.measured)
        shown, search = self.detected(raw)
        return (np.where(np.isnan(search), self.piles(raw), shown),) if np.isnan(search).any() else ()

    def acquisition(self, s: Signals, p: Array) -> None:
        """Clip the readings."""
        s.reading = np.clip(s.reading, -p[:, None], p[:, None])


def _resting(flags: Mask) -> int:
    """Samples that stand in rows of three or more, of flags (n,)."""
    edges = np.flatnonzero(np.diff(np.r_[0, flags.astype(np.int8), 0]))
    rows = edges[1::2] - edges[::2]
    return int(rows[rows >= 3].sum())


def _stops(x: Array, moving: Mask, top: float, step: float) -> bool:
    """Whether readings on a lattice finer than their noise have their largest size far more often than any within the
    noise below it.

    Args:
        x: readings, (n,). moving: those that tell the noise, (n,): what stands still has none. top: the largest size.
            step: of the lattice, or 0.
    """
    sizes, noise = np.abs(x), white_noise(x[moving])
    if not 0.0 < step <= noise:
        return False
    number = np.bincount(np.round((top - sizes[sizes > top - BEYOND * noise - 0.5 * step]) / step).astype(int))
    return bool(number[0] > DENSER * number[1:].max(initial=0))


def _cut_off_there(samples: Samples, channel: int, level: float, sigma: float) -> Mask:
    """Samples (n,) of a pile about a level that is the end of a range; none where the model says that the load rests
    there.

    The model goes on beyond the end of a range, by more and by less, and the readings don't. A load that rests is
    expected to; about one that is controlled to rest, a model errs both ways; dry friction stays at a level from the
    slowest motion on.
    """
    none = np.zeros(samples.raw.shape[1], np.bool_)
    if samples.expected is None:
        return none
    x, expected = samples.raw[channel], samples.expected[channel]
    side = 1.0 if np.nanmax(x) > -np.nanmin(x) else -1.0
    x, margin = side * x, BEYOND * sigma
    inside = samples.valid & (np.abs(x) < level - margin)
    expected = _as_below(x, side * expected, inside)
    off = ROBUST * float(np.median(np.abs(x - expected)[inside])) if inside.any() else 0.0
    sure = BEYOND * max(sigma, off)
    pile = samples.valid & (np.abs(x - level) < margin)
    past = max(margin, NONLINEAR * level)
    both, beyond = pile & (expected > level + past), samples.valid & (expected > level + max(past, sure))
    if both.sum() < max(PILED, PART_BEYOND * pile.sum()) or np.sum(beyond & pile) < STAYS * beyond.sum():
        return none
    if np.sum(pile & (expected < level - min(sure, FAR_BELOW * level))) > PART_BELOW * pile.sum():
        return none
    least, most = np.quantile(expected[both], (0.05, 0.95))
    away = expected[both] - expected[both].mean()
    rise = float(x[both] @ away) / float(away @ away) * (most - least) if most > least else np.inf
    if most - least < max(margin, off) or abs(rise) > RISES * sigma:
        return none
    with np.errstate(invalid="ignore"):
        return np.asarray(np.abs(x) > level - margin)


def _as_below(x: Array, expected: Array, below: Mask) -> Array:
    """What a model expects of readings (n,), in proportion to them where they aren't cut off."""
    away = expected[below] - expected[below].mean() if below.any() else np.zeros(0)
    power = float(away @ away)
    slope = float(x[below] @ away) / power if power > 0.0 else 0.0
    if not 1.0 < slope <= FLATTENED:
        return expected
    return np.asarray(x[below].mean() + slope * (expected - expected[below].mean()))


def _noises(x: Array) -> tuple[float, float]:
    """White noise of all readings (n,), and of the largest, whose own the end of a range takes off."""
    x, found = x if x.max() > -x.min() else -x, [0.0]
    change = np.abs(np.diff(x, n=3))
    for top in TOPS:
        high = np.convolve(x > top * x.max(), np.ones(4), mode="valid") == 4
        if high.sum() >= ENOUGH:
            found.append(ROBUST * float(np.median(change[high])) / THIRD_DIFFERENCE**0.5)
    return white_noise(x), max(found)


def _pile(values: Array, denser: float, slowed: float, narrow: float) -> float:
    """The level of a pile at either end of values in time (n,), NaN without one."""
    if len(values) < PILED:
        return float("nan")
    x = values if values.max() > -values.min() else -values  # both ends are as far out
    levels = [_pile_above(x, sigma, denser, slowed, narrow) for sigma in _noises(values) if sigma > QUIETEST * x.max()]
    return next((level for level in levels if np.isfinite(level)), float("nan"))


def _pile_above(x: Array, sigma: float, denser: float, slowed: float, narrow: float) -> float:
    near = x[x > x.max() - 15.0 * sigma]
    number, edges = np.histogram(near, bins=30)
    level = float(edges[int(np.argmax(number))] + 0.25 * sigma)
    for _ in range(3):
        about = x[np.abs(x - level) < 2.5 * sigma]
        if not len(about):
            return float("nan")
        level = float(np.median(about))
    off, far = (x - level) / sigma, min(FAR, 0.7 * level / sigma)
    pile = np.abs(off) < 3.0
    close = np.count_nonzero((off > -NEAR) & (off < -BELOW)) / (NEAR - BELOW)
    before = np.count_nonzero((off > -far) & (off <= -NEAR)) / max(far - NEAR, 1.0)
    chance = 3.0 * np.sqrt(max(close, 1.0) / (NEAR - BELOW))
    cut_off = before > 0.0 and close <= slowed * before + chance
    alone = np.count_nonzero(off > 4.5) <= 2e-3 * pile.sum()
    dense = pile.sum() >= PILED and pile.sum() / 6.0 > denser * max(close, before)
    return (
        level
        if level > 0.0 and cut_off and alone and dense and float(np.std(x[pile])) < narrow * sigma
        else float("nan")
    )
