"""Where the error of a model sits: parts of the log that hold more of it than their share, in words.

What noise explains is taken off first: white noise of each channel, sample by sample. Channels of different units are
pooled after division by the noise of their unit, so that among channels of one unit shares are of squared newtons (or
newton metres). A part other than a phase is named only if, in its channel, it holds `LIFT` times the error that its
samples would hold if error were spread evenly within each phase, and blocks of half a second agree (`SURE` standard
errors).
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from kinid.modeling.experiment import Experiment
from kinid.residuals.parts import Moving, Part, moving, other_parts, phase_parts, phases
from kinid.residuals.shapes import MAINS, NEAR, held_still, shape
from kinid.residuals.view import View
from kinid.residuals.words import channel_words, number, percent
from kinid.writers import Json

Array = NDArray[np.float64]

#: error in a part over what evenly spread error would put there, and by how much it must exceed it as a share of its
#: channel
LIFT, MARGIN = 1.5, 0.1
#: parts with less of the whole error are not worth a sentence
LEAST = 0.05
#: standard errors by which error in a part exceeds that outside, from blocks of so many seconds
SURE, BLOCK = 2.5, 0.5
#: with few blocks their spread is a poor guess: a block's error is taken to scatter by this share at least
SCATTER = 0.3
#: share of a channel's error that one constant explains, for that to be what it is
CONSTANT = 0.8
#: edges of frequency bands [Hz]
BANDS = (0.0, 0.5, 2.0, 5.0, 15.0, np.inf)
#: a line holds this share of the whole error, and this multiple of what lies beside it
LINE, STANDS_OUT = 0.02, 8.0


@dataclass(frozen=True)
class Cell:
    """A part of the log that holds a share of the error.

    Attributes:
        channel: of the reading. by: what the log was divided by ("phase", "depth", "depth_rate", "loading", "slip",
            "frequency", "place", "pose", "time"); phase: the phase, where it was divided by that, else "".
        share: of the whole squared error beyond the noise, 0…1. rms: of the residual there, in `unit`.
        says: in words.
    """

    channel: str
    by: str
    phase: str
    share: float
    rms: float
    unit: str
    says: str

    def to_dict(self) -> Json:
        """For JSON."""
        return {
            "channel": self.channel,
            "phase": self.phase,
            "share": self.share,
            "says": self.says,
            "by": self.by,
            "rms": self.rms,
            "unit": self.unit,
        }


def where(experiment: Experiment, residual: Array, sigma: Array, most: int = 8) -> tuple[Cell, ...]:
    """Cells in which the error sits, the largest share first.

    Every phase of every channel is a candidate; other parts only where error is concentrated, one of each kind a
    channel. At least half of what is told is phases, where there are so many. Forces of a wrench that touches are read
    along the contact's axes, unless one axis of the sensor tells more plainly.

    Args:
        experiment: what was predicted.
        residual: measured less predicted, (channels, n), in the channels' units; NaN where a sample doesn't count.
        sigma: white noise of each channel, (channels,).
        most: cells to return, at most.
    """
    view = View.of(experiment, residual, sigma)
    names = phases(view)
    way = moving(view)
    by_phase = sorted(_phase_cells(view, names, way), key=lambda cell: (-cell.share, -cell.rms))
    described = {cell.channel for cell in by_phase if ", and " in cell.says}
    others = [*_constant_cells(view), *_part_cells(view, names, way, described), *_frequency_cells(view)]
    others.sort(key=lambda cell: -cell.share)
    if not others and view.total <= 0:
        return tuple(by_phase[:most])
    telling = [cell for cell in by_phase if cell.share >= 0.01]
    kept = telling[: max(most - len(others), most // 2)]
    kept += others[: most - len(kept)]
    return tuple(sorted(kept, key=lambda cell: -cell.share))


def _phase_cells(view: View, names: NDArray[np.str_], way: Moving) -> Iterator[Cell]:
    for part in phase_parts(view, names):
        held = held_still(view, part.mask, way)
        for row, channel in enumerate(view.channels):
            count = float(view.samples[row][part.mask].sum())
            if not count:
                continue
            share, rms = _share(view, row, part), _rms(view, row, part)
            unit, of = view.units[row], channel_words(view, row)
            place = f" in {part.words}" if part.words else ""
            if view.total <= 0 or share < 0.005:
                says = f"the error of {of}{place} is next to none, or what noise explains: {number(rms)} {unit} rms"
            else:
                place = f"in {part.words} of {of}" if part.words else f"in {of}"
                says = f"{percent(share)} of the error is {place} ({number(rms)} {unit} rms)"
                found = shape(view, row, part.mask, way, held=held)
                if found is not None:
                    says += f", and {found.words} ({percent(found.explained)} of it)"
            yield Cell(channel, "phase", part.phase, share, rms, unit, says)


def _constant_cells(view: View) -> Iterator[Cell]:
    """Channels whose error is one constant from beginning to end."""
    for row, channel in enumerate(view.channels):
        count, error = float(view.samples[row].sum()), float(view.excess[row].sum()) * view.scale[row] ** 2
        if error <= 0:
            continue
        level = float((view.samples[row] * view.mean[row]).sum()) / count
        explained = min(1.0, count * level**2 / error)
        share = _part_of(view, explained * error / view.scale[row] ** 2)
        if explained >= CONSTANT and share >= LEAST:
            yield Cell(
                channel,
                "time",
                "",
                share,
                abs(level),
                view.units[row],
                f"{percent(share)} of the error is in {channel_words(view, row)} and is the same at all times: about "
                f"{number(level)} {view.units[row]} ({percent(explained)} of it)",
            )


def _part_cells(view: View, names: NDArray[np.str_], way: Moving, described: set[str]) -> Iterator[Cell]:
    """Of each way to divide the log and each channel, the part in which error is most concentrated."""
    parts = list(other_parts(view, way))
    block = np.unique((view.t / BLOCK).astype(np.int64), return_inverse=True)[1]
    _, code = np.unique(names, return_inverse=True)
    for row, channel in enumerate(view.channels):
        if not view.beyond[row]:
            continue
        error, samples = view.excess[row], view.samples[row]
        # what each group would hold if the error of its phase were spread evenly over the phase
        count = np.bincount(code, samples)
        even = samples * (np.bincount(code, error) / np.maximum(count, 1.0))[code]
        found: dict[str, tuple[float, Part]] = {}
        for part in parts:
            if part.by == "time" and not _trend(parts, part, error, samples):
                continue
            if part.only in ("", channel) and _concentrated(part, error, samples, even, block):
                share = _share(view, row, part)
                if share >= max(LEAST, found[part.by][0] if part.by in found else 0.0):
                    found[part.by] = (share, part)
        for share, part in found.values():
            rms, unit = _rms(view, row, part), view.units[row]
            amount = float(samples[part.mask].sum() / samples.sum())
            says = (
                f"{percent(share)} of the error is in {channel_words(view, row)} {part.words}, in {percent(amount)} of "
                f"the "
                f"samples ({number(rms)} {unit} rms)"
            )
            if part.by == "time":
                says += f": it {_trend(parts, part, error, samples)} with time"
            else:
                # what a phase says of this channel already is not said again
                shaped = None if channel in described else shape(view, row, part.mask, way, held=False)
                says += f", and {shaped.words} ({percent(shaped.explained)} of it)" if shaped is not None else ""
            yield Cell(channel, part.by, "", share, rms, unit, says)


def _concentrated(part: Part, error: Array, samples: Array, even: Array, block: NDArray[np.int64]) -> bool:
    """Whether a part holds notably more of a channel's error than its samples do."""
    whole, many = float(error[part.within].sum()), float(samples[part.within].sum())
    inside = float(samples[part.mask].sum())
    if whole <= 0 or not inside or inside >= many:
        return False
    mine = float(error[part.mask].sum()) / whole
    expected = max(inside / many, float(even[part.mask].sum()) / max(float(even[part.within].sum()), 1e-300))
    if mine < LIFT * expected or mine < expected + MARGIN:
        return False
    level, spread, blocks = _mean(error, samples, part.mask, block)
    other, beside, _ = _mean(error, samples, part.within & ~part.mask, block)
    return blocks >= 2 and level - other > SURE * float(
        np.hypot(max(spread, SCATTER * level / np.sqrt(blocks)), beside)
    )


def _mean(error: Array, samples: Array, mask: NDArray[np.bool_], block: NDArray[np.int64]) -> tuple[float, float, int]:
    """Mean error of a sample, its standard error from blocks, and how many there are."""
    count = np.bincount(block, samples * mask)
    total = np.bincount(block, error * mask)
    some = count > 0
    n, e = count[some], total[some]
    level = float(e.sum() / n.sum()) if len(n) else 0.0
    spread = float(np.sqrt(((e - level * n) ** 2).sum()) / n.sum()) if len(n) > 1 else abs(level)
    return level, spread, int(some.sum())


def _trend(parts: list[Part], part: Part, error: Array, samples: Array) -> str:
    """Whether mean square error "grows" or "fades" from third to third of the time towards this third; else ""."""
    thirds = [p for p in parts if p.by == "time"]
    means = [float(error[p.mask].sum() / max(samples[p.mask].sum(), 1.0)) for p in thirds]
    if part is thirds[-1] and means == sorted(means) and means[-1] > LIFT * means[0]:
        return "grows"
    if part is thirds[0] and means == sorted(means, reverse=True) and means[0] > LIFT * means[-1]:
        return "fades"
    return ""


def _frequency_cells(view: View) -> Iterator[Cell]:
    """Bands in which the error is more at home than the reading itself, and lines of the mains."""
    if len(view.t) < 64 or view.total <= 0:
        return
    for row in map(int, np.flatnonzero(view.beyond)):
        run = _fullest(view, view.residual[row])
        f, power = spectrum(view, view.residual[row], run)
        if not len(f):
            continue
        lines = []
        for mains in MAINS:
            line = _mains_cell(view, row, f, power, mains)
            if line is not None:
                lines.append(np.abs(f - mains) <= NEAR)
                yield line
        constant_or_line = np.any([f == 0.0, *lines], axis=0)
        band = _band_cell(view, row, run, f, power, constant_or_line)
        if band is not None:
            yield band


def _mains_cell(view: View, row: int, f: Array, power: Array, mains: float) -> Cell | None:
    """The line of a mains frequency [Hz] in a channel's error with this spectrum, None where there is none."""
    line, amplitude = _line(f, power, mains, float(view.samples[row].sum()))
    share, unit = _part_of(view, line / view.scale[row] ** 2), view.units[row]
    if share < LINE:
        return None
    says = (
        f"{percent(share)} of the error is a line at {mains:.0f} Hz in {channel_words(view, row)}, with an amplitude "
        f"of {number(amplitude)} {unit}"
    )
    return Cell(view.channels[row], "frequency", "", share, amplitude / np.sqrt(2), unit, says)


def _band_cell(view: View, row: int, run: slice, f: Array, power: Array, passed_over: NDArray[np.bool_]) -> Cell | None:
    """The band that holds most of a channel's error, where it holds notably less of the reading; None without one."""
    n, unit = float(view.samples[row].sum()), view.units[row]
    floor = n * view.sigma[row] ** 2 / len(f)
    rest = np.where(passed_over, floor, power)
    measured = view.readings(view.experiment.measured)[row]
    moving = np.where(np.isfinite(view.residual[row]), measured - np.nanmean(measured), np.nan)
    _, own = spectrum(view, moving, run)
    best: Cell | None = None
    for low, high in zip(BANDS[:-1], BANDS[1:]):
        band = (f >= low) & (f < high)
        if not band.any():
            continue
        inside = float(rest[band].sum() - band.sum() * floor)
        mine = inside / max(float(rest.sum() - len(f) * floor), 1e-300)
        usual = float(own[band].sum() / max(own.sum(), 1e-300))
        share = _part_of(view, inside / view.scale[row] ** 2)
        at_home = mine >= LIFT * usual and mine >= usual + MARGIN
        if share < LEAST or not at_home or (best is not None and share < best.share):
            continue
        span = f"below {high:g} Hz" if low == 0 else f"between {low:g} and {high:g} Hz"
        span = f"above {low:g} Hz" if high > f[-1] and low > 0 else span
        rms = float(np.sqrt(max(float(rest[band].sum()), 0.0) / n))
        says = (
            f"{percent(share)} of the error is in {channel_words(view, row)} {span} ({number(rms)} {unit} rms); of "
            f"the reading's own changes {'only ' if usual >= 0.01 else ''}{percent(usual)} are in this range"
        )
        best = Cell(view.channels[row], "frequency", "", share, rms, unit, says)
    return best


def _fullest(view: View, values: Array) -> slice:
    """Samples of the log's piece without gaps that holds the most of the squared values: the longest may lie in the
    air.
    """
    return max(view.experiment.signals.runs, key=lambda run: float(np.nansum(values[run] ** 2)), default=slice(0, 0))


def spectrum(view: View, values: Array, run: slice | None = None) -> tuple[Array, Array]:
    """Frequencies [Hz] and energy at each, whose sum is that of the squared values; from one piece of the log, scaled
    up.
    """
    from scipy.fft import next_fast_len, rfft

    piece = np.nan_to_num(values[run or _fullest(view, values)])
    if len(piece) < 64:
        return np.zeros(0), np.zeros(0)
    size = next_fast_len(len(piece), real=True)
    power = np.abs(rfft(piece, size)) ** 2 / size
    power[1 : (size + 1) // 2] *= 2.0
    energy, whole = float(power.sum()), float(np.nansum(values**2))
    return np.asarray(np.fft.rfftfreq(size, view.period), dtype=np.float64), power * (
        whole / energy if energy > 0 else 1.0
    )


def _line(f: Array, power: Array, mains: float, n: float) -> tuple[float, float]:
    """Energy of a line beyond what lies beside it, and its amplitude; zero where none stands out."""
    if f[-1] < mains + 10 * NEAR:
        return 0.0, 0.0
    away = np.abs(f - mains)
    on, beside = away <= NEAR, (away > NEAR) & (away < 10 * NEAR)
    level = float(np.mean(power[beside])) if beside.any() else 0.0
    energy = float(power[on].sum())
    if not on.any() or energy < STANDS_OUT * level * on.sum():
        return 0.0, 0.0
    energy -= level * float(on.sum())
    return energy, float(np.sqrt(2 * energy / n))


def _share(view: View, row: int, part: Part) -> float:
    return _part_of(view, float(view.excess[row][part.mask].sum()))


def _part_of(view: View, error: float) -> float:
    return min(1.0, max(0.0, error / view.total)) if view.total > 0 else 0.0


def _rms(view: View, row: int, part: Part) -> float:
    count = float(view.samples[row][part.mask].sum())
    return float(np.sqrt(view.squares[row][part.mask].sum() / count)) if count else 0.0
