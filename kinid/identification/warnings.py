"""What a reader of a fit should doubt, in words, each with what to do about it."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from kinid.estimators.batch import ILL_CONDITIONED, Solution
from kinid.identification.error_model import reading_noise
from kinid.identification.lack_of_fit import LackOfFit
from kinid.identification.nuisance import MAX_SHIFT
from kinid.identification.state import State
from kinid.parameter import Parameter

Array = NDArray[np.float64]

#: condition of the sensitivity, its columns brought to length one, above which parameters stand in for each other
#: (Belsley, Kuh & Welsch 1980, ch. 3: strong from 30 to 100; a power law's stiffness and exponent alone reach 50)
MAX_CONDITION = 100.0
#: parameters that no material has below nothing: it would give energy, or pull where it is pressed
MATERIAL = ("stiffness", "damping")
PASSIVE = (*MATERIAL, "coefficient")
#: share of a unit vector above which a parameter takes part in a direction
MIN_PARTICIPATION = 0.2
#: share of the variance of a joint's torque that a model may leave, beside noise, where all joints together are well
MAX_LEFT_OF_A_JOINT = 0.5
#: standard errors by which calibration is beyond its tolerance, and blocks of time any one of which may be left out
SURE, BLOCKS = 2.0, 16
#: time constant of a low-pass from which on it is worth a word [s]
MIN_FILTER_LAG = 6e-3


def impossible(named: Mapping[str, Parameter], values: Array, covariance: Array) -> list[str]:
    """Parameters that are negative beyond their error, and that no material has so."""
    error = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    below = negative(named, values, 2.0 * error)
    if not below:
        return []
    return [
        f"{listed(below)} {_are(below)} negative beyond {'its' if len(below) == 1 else 'their'} error, which no "
        f"material is: "
        "a force that comes late or early (time-offset), a turned sign or an effect that the model lacks may stand "
        "behind it"
    ]


def negative(names: Iterable[str], values: Array, room: Array, kinds: Collection[str] = PASSIVE) -> list[str]:
    """Return the parameters of these kinds that are negative by more than their `room` (infinite if unidentified)."""
    return [name for name, value, r in zip(names, values, room) if name.rsplit(".", 1)[-1] in kinds and value < -r]


def of_nuisances(state: State, left: LackOfFit) -> list[str]:
    """Calibration that ended where its tolerance ends: an effect that the model lacks, most often."""
    ends: dict[str, list[str]] = {}
    for j, (nuisance, shift) in enumerate(zip(state.open_, state.shift)):
        if abs(shift) < MAX_SHIFT - 1e-6:
            continue
        # where much is left, calibration that is bound bends to what is missing: a diagnosis says what that is
        bound = np.isfinite(nuisance.high)
        if not bound or (not left.matters and _beyond_everywhere(state, j)):
            amount = f"{nuisance.name} {shift * nuisance.sd:.2g} {nuisance.unit}".removesuffix(" 1")
            ends.setdefault(nuisance.effect.id, []).append(amount)
    mend = "add it to the model, or mend the rig"
    if left.matters:
        mend = "what the model lacks may stand behind it, kinid diagnose says more; else mend the rig"
    return [
        f"{name} beyond what calibration is trusted to ({', '.join(amounts)}): {mend}" for name, amounts in ends.items()
    ]


def _beyond_everywhere(state: State, j: int) -> bool:
    """Whether readings take a nuisance that is bound, its number j, beyond its tolerance by more than its own error,
    whichever block of time is left out.

    A calibration that is off shows wherever readings change. What a law lacks at a reversal or an impact bends one as
    well, but there alone. Asked is the step that it would take from where it ended if nothing held it.
    """
    if not state.finite:
        return True
    p, (channels, groups) = len(state.values), state.problem.shape
    at = np.union1d(np.flatnonzero(state.free), [p + j])
    k = int(np.flatnonzero(at == p + j)[0])
    weighted = (state.jacobian[:, at] / state.error.sigma.reshape(-1, 1)).reshape(channels, groups, -1)
    residual = state.residual / state.error.sigma
    prior, placed = state.prior[np.ix_(at, at)], np.r_[np.zeros(p), state.shift][at]
    blocks = [rows for rows in np.array_split(np.arange(groups), BLOCKS) if len(rows)]
    parts = [(weighted[:, rows].reshape(-1, len(at)), residual[:, rows].ravel()) for rows in blocks]
    squares, gradients = np.array([m.T @ m for m, _ in parts]), np.array([m.T @ r for m, r in parts])
    whole, along = squares.sum(axis=0) + prior, gradients.sum(axis=0) - prior @ placed
    for square, gradient in zip(squares, gradients):
        inverse = np.linalg.pinv(whole - square, hermitian=True)[k]
        error = np.sqrt(max(float(inverse[k]), 0.0) * state.inflation)
        if abs(state.shift[j] + float(inverse @ (along - gradient))) - SURE * error <= MAX_SHIFT:
            return False
    return True


def of_joints(state: State, residual: Array, left: LackOfFit) -> list[str]:
    """Joints whose torque a model says next to nothing of, where others carry so much more that it doesn't show.

    Args:
        state: a fitted model. residual: of the whole log, (channels, n). left: what is left of all joints together.
    """
    experiment = state.problem.whole
    if experiment.signals.joints is None or left.matters:
        return []
    readings = np.where(np.isfinite(residual), experiment.measured, np.nan)
    noise = reading_noise(state.problem) ** 2
    moves = np.nanvar(readings, axis=1) - noise
    rest = np.nanmean(residual**2, axis=1) - noise
    return [
        f"of what moves in the torque of {name}, {100 * np.sqrt(after / before):.0f} % is left, little beside the "
        "other joints' torques: are sign, order and unit of its column right? kinid diagnose says what may be missing"
        for name, before, after in zip(experiment.layout.joints, moves, rest)
        if before > 0.0 and after > MAX_LEFT_OF_A_JOINT * before and after > noise.min()
    ]


def of_filter(state: State) -> list[str]:
    """A low-pass that torques seem to have come through."""
    rest = state.problem.experiment.signals.rest
    if not rest.lag > MIN_FILTER_LAG:
        return []
    return [
        f"torques come as through a low-pass of {1e3 * rest.lag:.0f} ms ({0.5 / np.pi / rest.lag:.2g} Hz), which was "
        "fitted, too: what is faster hardly shows; log them unfiltered"
    ]


def of_fit(
    named: Mapping[str, Parameter], solution: Solution, left: LackOfFit, start: Mapping[str, float], trade: Array
) -> list[str]:
    """Return warnings of unidentified, bounded and collinear parameters, and of a wrong structure."""
    out = []
    names = list(named)
    open_ = [name for name, is_open in zip(names, solution.unidentified) if is_open]
    if open_:
        out.append(f"{listed(open_)} {_are(open_)} not identified by this log: {_their(open_)} infinite")
    stuck = [
        f"{name} = {p.low if abs(value - p.low) < abs(value - p.high) else p.high:.4g}"
        for (name, p), value, bound, is_open in zip(
            named.items(), solution.values, solution.at_bound, solution.unidentified
        )
        if bound and not is_open and not p.is_share
    ]
    if stuck:
        out.append(
            f"{listed(stuck)} ended at {'its bound' if len(stuck) == 1 else 'their bounds'}: "
            "the law may be the wrong one, or the log doesn't excite it"
        )
    for name, began in start.items():
        p = named[name]
        if began in (p.low, p.high) and p.low != p.nominal != p.high:
            out.append(f"{name} started at its bound {began:.4g}: start inside")
    alike = collinear_groups(names, trade)
    if solution.condition > MAX_CONDITION and alike:
        how = "ill-conditioned" if solution.condition > ILL_CONDITIONED else "nearly ill-conditioned"
        out += [
            f"{how} ({solution.condition:.1e}): {listed(group)} can stand in for each other in this log"
            for group in alike
        ]
    elif solution.condition > ILL_CONDITIONED:
        out.append(
            f"ill-conditioned ({solution.condition:.1e}): some parameters can stand in for each other in this log"
        )
    out += impossible(named, solution.values, solution.covariance)
    if not solution.converged:
        out.append("the search stopped before it converged: start nearer, or use a smaller model")
    if left.matters:
        out.append(
            f"{left.excess:.3g} {left.unit} is left beside noise, {100 * left.share_of_reading:.2g} % of the reading: "
            "this structure is rejected, kinid diagnose says what may be missing"
        )
    return out


def collinear_groups(names: Sequence[str], covariance: Array) -> list[list[str]]:
    """Groups of parameters whose estimates hang on each other.

    From the information with its diagonal brought to one (Belsley, Kuh & Welsch 1980, ch. 3): a direction whose
    singular value is below 1/`MAX_CONDITION` of the greatest is a sum of effects that nearly cancels.
    """
    size = np.diag(covariance)
    kept = np.flatnonzero(np.isfinite(size) & (size > 0))
    if len(kept) < 2:
        return []
    scale = np.sqrt(size[kept])
    information = np.linalg.pinv(covariance[np.ix_(kept, kept)] / np.outer(scale, scale), rcond=1e-14, hermitian=True)
    length = np.sqrt(np.maximum(np.diag(information), 1e-150))
    values, vectors = np.linalg.eigh(information / length / length[:, None])
    values = np.maximum(values, 1e-300)
    out = []
    for k in np.flatnonzero(values < values[-1] / MAX_CONDITION**2):
        part = np.abs(vectors[:, k])
        group = [names[kept[i]] for i in np.argsort(-part) if part[i] > MIN_PARTICIPATION]
        if len(group) > 1:
            out.append(group)
    return out


def listed(names: Iterable[str]) -> str:
    """Names as in "a, b and c"."""
    *most, last = list(names) or [""]
    return f"{', '.join(most)} and {last}" if most else last


def _are(names: Sequence[str]) -> str:
    return "is" if len(names) == 1 else "are"


def _their(names: Sequence[str]) -> str:
    return "its interval is" if len(names) == 1 else "their intervals are"
