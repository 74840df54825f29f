"""What follows from a log's signals alone, computed once and not at each prediction."""

from __future__ import annotations

import weakref
from collections.abc import Callable

import numpy as np

from kinid.derivative import Differentiator
from kinid.effects._signals import Array

# by the identities of the arrays it follows from: the first one's end is the entry's, the others live as long as it
_made: dict[tuple[object, ...], tuple[Array, tuple[Array, ...]]] = {}


def derived(name: str, make: Callable[[], Array], *sources: Array) -> Array:
    """The result of `make`, which follows from these read-only inputs of predictions."""
    key = (name, *map(id, sources))
    if key not in _made:
        _made[key] = (make(), sources[1:])
        weakref.finalize(sources[0], _forget, key).atexit = False
    return _made[key][0]


def _forget(key: tuple[object, ...]) -> None:
    _made.pop(key, None)


def rates(t: Array, dt: Array, x: Array, order: int) -> Array:
    """First or second time derivative of rows (k, n), by local polynomials of the default bandwidth; 0 where unknown."""
    edges = [*np.flatnonzero(dt == 0.0).tolist(), len(t)]
    made = Differentiator()(t, np.ascontiguousarray(x.T), [slice(a, b) for a, b in zip(edges[:-1], edges[1:])])
    return np.nan_to_num((made.first if order == 1 else made.second).T)
