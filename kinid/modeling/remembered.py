"""Results that are the same for many logs, worked out once."""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache, wraps
from typing import ParamSpec, TypeVar

P = ParamSpec("P")
Out = TypeVar("Out")

#: results of one function that are kept, the latest
LATEST = 256


def remembered(do: Callable[P, Out]) -> Callable[P, Out]:
    """A function of models, effects and layouts whose latest results are kept; what it gives isn't written into."""
    kept = lru_cache(maxsize=LATEST)(do)

    @wraps(do)
    def call(*args: P.args, **kwargs: P.kwargs) -> Out:
        try:
            hash(args)
        except TypeError:  # an effect of a user's own may hold arrays
            return do(*args, **kwargs)
        return kept(*args, **kwargs)  # type: ignore[arg-type]

    return call
