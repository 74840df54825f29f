"""What `kinid plan` is told in short texts: places, corners, sines, grids; and a signal in a table."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from kinid.errors import InputError

if TYPE_CHECKING:
    from kinid.plan import Sampled


def signal_of(path: Path) -> Sampled:
    """A user's signal: the columns t and depth of a table."""
    import numpy as np

    from kinid.plan import Sampled
    from kinid.plan.trajectory import read_columns

    table = read_columns(path)
    if "t" not in table or "depth" not in table:
        raise InputError(f"{path} with the columns {', '.join(list(table)[:8])}", "t [s] and depth [m]", "name them so")
    return Sampled(np.asarray(table["t"], dtype=float), np.asarray(table["depth"], dtype=float))


def sines_of(text: str) -> tuple[tuple[float, float], ...]:
    """Amplitudes and frequencies: amplitude@frequency [m@Hz], separated by commas."""
    out = []
    for part in filter(None, (p.strip() for p in text.split(","))):
        amplitude, _, frequency = part.partition("@")
        try:
            out.append((float(amplitude), float(frequency)))
        except ValueError:
            raise InputError(f"--sines {part}", "amplitude@frequency in m and Hz, as 0.0015@0.9", "correct it") from None
    return tuple(out)


def grid_of(text: str) -> tuple[int, int]:
    """Rows and columns, as 10x10."""
    parts = text.lower().replace("×", "x").split("x")
    if len(parts) != 2 or not all(part.strip().isdigit() for part in parts):
        raise InputError(f"--grid {text}", "rows x columns, as 10x10", "correct it")
    return int(parts[0]), int(parts[1])


def numbers_of(text: str, option: str) -> tuple[float, ...]:
    """Numbers separated by commas."""
    try:
        return tuple(float(part) for part in text.split(","))
    except ValueError:
        raise InputError(f"{option} {text}", "numbers separated by commas", "correct it") from None


def place_of(text: str, option: str) -> tuple[float, ...]:
    """x,y along both tangents, or x,y,z in the base frame [m]."""
    values = numbers_of(text, option)
    if len(values) not in (2, 3):
        raise InputError(f"{option} {text}", "x,y along both tangents, or x,y,z in the base frame [m]", "correct it")
    return values


def corners_of(text: str, option: str) -> list[tuple[float, ...]]:
    """Places separated by semicolons."""
    return [place_of(part, option) for part in text.split(";") if part.strip()]
