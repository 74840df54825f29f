"""Which logs don't belong to the others: another tool, a surface that moved, a sensor that was turned or rewired.

A log is compared with its fellows, not with a table: three figures of each log are held against their median and their
spread over all logs (median absolute deviation, P. J. Rousseeuw, C. Croux, J. Am. Stat. Assoc. 88, 1993), so that a
model that errs everywhere makes no log an odd one.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.stats import chi2

from kinid.identification.pooling.result import LogResult

Array = NDArray[np.float64]

#: logs from which on one can be odd, and the share of them that may be
FEWEST, MOST = 4, 0.34
#: deviations from the median beyond which a log is odd: of ten thousand normal ones none is expected
BEYOND = 6.0
#: an error is odd where it is so many times the usual, a disagreement where chance makes it so rarely
TIMES, CHANCE = 1.5, 1e-5
#: spread of the logarithm of an error that any logs have
USUAL = 0.1


def odd_logs(logs: Sequence[LogResult], scales: Mapping[str, float]) -> dict[str, str]:
    """Names of the odd logs, with why, the oddest first.

    Args:
        logs: of one pooled fit. scales: of parameters that logs have for themselves, what of each matters.
    """
    if len(logs) < FEWEST:
        return {}
    found: list[tuple[float, str, str]] = []
    error = np.log(np.maximum([log.by_log_averaged for log in logs], 1e-12))
    usual = float(np.exp(np.median(error)))
    for log, away in zip(logs, _deviations(error, USUAL)):
        if away > BEYOND and log.by_log_averaged > TIMES * usual:
            words = f"what the other logs say leaves {log.by_log_averaged:.3g} {log.error.unit}, {usual:.2g} is usual"
            found.append((away, log.name, words))
    # half of all logs disagree by less than the median of χ², where nothing but chance makes them
    middle = [log.disagreement * log.freedom / float(chi2.median(max(1.0, log.freedom))) for log in logs]
    typical = max(1.0, float(np.median(middle)))
    for log in logs:
        times = log.disagreement / typical
        if chi2.sf(times * log.freedom, max(1.0, log.freedom)) < CHANCE:
            words = f"its own values are {np.sqrt(times):.2g} times as far from the others' as chance makes them"
            found.append((times, log.name, words))
    for name in {name for log in logs for name in log.parameters}:
        having = [log for log in logs if name in log.parameters and np.isfinite(log.parameters[name].high)]
        if len(having) < FEWEST:
            continue
        values = np.array([log.parameters[name].value for log in having])
        for log, away in zip(having, _deviations(values, scales.get(name, 0.0))):
            if abs(away) > BEYOND:
                p = log.parameters[name]
                words = f"{name} is {p.value:.3g} {p.unit}, {np.median(values):.2g} is usual".replace(" 1,", ",")
                found.append((abs(away), log.name, words))
    return _named(found, len(logs))


def odd_values(logs: Mapping[str, Mapping[str, tuple[float, float, str]]]) -> dict[str, str]:
    """Names of the odd ones among logs that were fitted each by itself, with why, the oddest first.

    Args:
        logs: of each its figures by name: value, standard error (infinite where it is open) and unit.
    """
    found: list[tuple[float, str, str]] = []
    for name in dict.fromkeys(name for figures in logs.values() for name in figures):
        known = {log: figures[name] for log, figures in logs.items() if name in figures}
        known = {log: figure for log, figure in known.items() if np.isfinite(figure[:2]).all()}
        if len(known) < FEWEST:
            continue
        values, errors = np.array([(value, error) for value, error, _ in known.values()]).T
        away = np.abs(_deviations(values, float(np.median(errors)), errors))
        for (log, (value, _, unit)), times in zip(known.items(), away):
            if times > BEYOND:
                words = f"{name} is {value:.3g} {unit}, {np.median(values):.3g} is usual".replace(" 1,", ",")
                found.append((float(times), log, words))
    return _named(found, len(logs))


def _named(found: list[tuple[float, str, str]], count: int) -> dict[str, str]:
    """Why each log is odd, the oddest first; nothing where they are no few."""
    out: dict[str, str] = {}
    for _, name, words in sorted(found, key=lambda item: -item[0]):
        out[name] = f"{out[name]}; {words}" if name in out else words
    return out if len(out) <= MOST * count else {}


def _deviations(values: Array, least: float, errors: Array | float = 0.0) -> Array:
    """How many spreads each is above the median, (n,), its own error beside them; a spread is no less than `least`."""
    middle = np.median(values)
    spread = max(1.4826 * float(np.median(np.abs(values - middle))), least, 1e-300)
    out: Array = (values - middle) / np.hypot(spread, errors)
    return out
