"""How far a change of the readings is from what others imitate, how evenly in time that lies, and where.

Squared distances are in standard deviations of the noise.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from kinid.modeling.experiment import Experiment
from kinid.modeling.sample_times import BLOCK_LENGTH

Array = NDArray[np.float64]

#: standard errors from which evidence is believed
SURE = 3.0
#: directions that the rival's columns span less of than this are not its own
THIN = 1e-9
#: what counts of a change that lies in very few blocks: it is believed after all where none of the others speaks
#: against it
RARE = 0.1


def even(squares: Array, t: Array) -> float:
    """What counts of a squared distance whose squares (channels, n) lie at times t [s], (n,): from `RARE` to 1.

    Evidence is believed from k = `SURE` of its own standard errors on, which follow from its spread over blocks of
    time. An amount α of a change gives each block α²gᵢ, and noise of 2α√gᵢ. With G = Σgᵢ and v = Σgᵢ²/G² − 1/n it is
    believed from α²G = 4k²/(1 − k²v) on: as if G were G(1 − k²v), spread evenly.
    """
    block = (t / BLOCK_LENGTH).astype(np.int64)
    each = np.bincount(block, squares.sum(axis=0))
    total = float(each.sum())
    if total <= 0.0:
        return 1.0
    uneven = float(np.sum((each / total) ** 2)) - 1.0 / len(each)
    return max(RARE, 1.0 - SURE**2 * uneven)


def rest(x: Array, column: int, others: list[int], taken: Array, shape: tuple[int, ...]) -> Array:
    """What `taken` of other columns leaves of a column of x (m, c), by channel and sample."""
    out: Array = (x[:, column] - x[:, others] @ taken).reshape(shape)
    return out


def left(gram: Array, prior: Array, columns: list[int], forms: list[int]) -> tuple[Array, Array]:
    """Squared length of each form beyond what the columns imitate, (forms,), and how much of each that takes, (c,
    forms).
    """
    inner = gram[np.ix_(columns, columns)] + np.diag(prior[columns])
    length = np.sqrt(np.maximum(np.diag(inner), 1e-300))
    cross = gram[np.ix_(columns, forms)]
    part = np.linalg.pinv(inner / np.outer(length, length), rcond=THIN, hermitian=True) @ (cross / length[:, None])
    taken = part / length[:, None]
    whole = np.diag(gram)[forms]
    rest = whole - np.sum(cross * taken, axis=0)
    # sums of squares are exact to about this share of the whole
    return np.where(rest > 1e-10 * whole, rest, 0.0), taken


def cells(experiment: Experiment, touch: NDArray[np.int64] | None) -> tuple[list[str], NDArray[np.int64]]:
    """Names of the phases, with their touch where there are several, and which of them each sample is in, (n,)."""
    n = len(experiment.signals)
    phase = experiment.phase if experiment.phase is not None else np.full(n, "motion")
    names, which = np.unique(phase, return_inverse=True)
    several = touch is not None and touch.max() > 0
    number = touch[experiment.rows] if touch is not None else np.zeros(n, dtype=np.int64)
    cells, at = np.unique(which + len(names) * number, return_inverse=True)
    labels = [
        f"{names[cell % len(names)]}" + (f" of touch {cell // len(names) + 1}" if several else "") for cell in cells
    ]
    return labels, at


def where(squares: Array, names: list[str], at: NDArray[np.int64], channels: tuple[str, ...]) -> tuple[str, str, float]:
    """The phase and channel that hold most of (channels, n), and their share."""
    total = float(squares.sum())
    sums = np.stack([np.bincount(at, row, len(names)) for row in squares])
    i, k = np.unravel_index(int(np.argmax(sums)), sums.shape)
    return names[k], channels[i], float(sums[i, k]) / total if total > 0 else 0.0
