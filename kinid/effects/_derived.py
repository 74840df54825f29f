"""What follows from a log's signals alone, computed once and not at each prediction."""

from __future__ import annotations

import weakref
from collections.abc import Callable

import numpy as np

from kinid.effects._signals import Array, Signals
from kinid.signal.derivative import Differentiator

#: results of one name and the same arrays that are kept, the latest: a search moves one parameter at a time
LATEST = 4

# by the identities of the arrays it follows from, the end of any of which is the entry's; then by parameters
_made: dict[tuple[object, ...], dict[tuple[float, ...], Array]] = {}


def derived(name: str, make: Callable[[], Array], *sources: Array, at: tuple[float, ...] = ()) -> Array:
    """The result of `make`, which follows from these read-only inputs of predictions and the parameters `at`."""
    key = (name, *map(id, sources))
    made = _made.get(key)
    if made is None:
        made = _made[key] = {}
        for source in sources:
            weakref.finalize(source, _forget, key).atexit = False
    found = made.get(at)
    if found is None:
        found = made[at] = make()
        for earlier in list(made)[:-LATEST]:
            made.pop(earlier, None)  # another thread may have been first
    return found


def sample_period(s: Signals) -> float:
    """Median time between samples [s]; 1 where no two samples follow each other."""
    return float(derived("sample period", lambda: np.array(np.median(s.dt[s.dt > 0.0]) if s.dt.any() else 1.0), s.dt))


def power_of_depth(s: Signals, exponent: float) -> Array:
    """δ₊ⁿ, (n,): most parameters of a power law leave both as they are."""
    return derived("power of the depth", lambda: np.power(s.penetration, exponent), s.depth, at=(float(exponent),))


def _forget(key: tuple[object, ...]) -> None:
    _made.pop(key, None)


def rates(s: Signals, x: Array, order: int, bandwidth: float = 25.0) -> Array:
    """First or second time derivative of rows (k, n), by local polynomials of a bandwidth [Hz]; 0 where unknown."""
    made = Differentiator(bandwidth)(s.t, np.ascontiguousarray(x.T), s.runs)
    return np.nan_to_num((made.first if order == 1 else made.second).T)
