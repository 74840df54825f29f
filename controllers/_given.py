"""What a caller gives, as numbers: text, missing numbers and wrong shapes end in one clear line."""

from __future__ import annotations

import math
from collections.abc import Iterable
from numbers import Real

import numpy as np
from numpy.typing import NDArray

from kinid.errors import InputError, near

Array = NDArray[np.float64]


def closest(name: object, valid: Iterable[str]) -> str:
    """How to mend a name where the message lists all valid ones already."""
    said = near(str(name), valid)
    return said if said.startswith("did you mean") else "correct the name"


def is_number(value: object) -> bool:
    """Whether it is one finite number."""
    return isinstance(value, Real) and not isinstance(value, bool) and math.isfinite(value)


def is_positive(value: object, or_infinite: bool = False) -> bool:
    """Whether it is one number above 0, finite or not."""
    return (is_number(value) and float(value) > 0.0) or (or_infinite and isinstance(value, Real) and value == math.inf)  # type: ignore[arg-type]


def numbers(value: object, shape: tuple[int, ...], what: str, mend: str = "check it") -> Array:
    """An array of finite numbers of a shape.

    Args:
        value: anything. shape: of the array; () for any. what: it is, for the message. mend: for the message.

    Raises:
        InputError: no numbers, another shape, or numbers that aren't finite.
    """
    try:
        out = np.ascontiguousarray(value, dtype=float)
        if np.asarray(value).dtype == np.bool_:
            raise TypeError("truth values")
    except (TypeError, ValueError):
        raise InputError(f"{what} {str(value)[:40]!r}", f"finite numbers of shape {shape}", mend) from None
    if shape and out.shape != shape:
        raise InputError(f"{what} of shape {out.shape}", f"finite numbers of shape {shape}", mend)
    if not np.isfinite(out).all():
        raise InputError(
            f"{what} with {int((~np.isfinite(out)).sum())} values that aren't finite",
            f"finite numbers of shape {shape}",
            mend,
        )
    return out
