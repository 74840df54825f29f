"""Places of a campaign: a grid over a surface, numbered."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from kinid.errors import InputError


@dataclass(frozen=True)
class Grid:
    """Places along both tangents, centred on the surface's point; columns run fastest.

    Attributes:
        rows, columns: of places, along tangent1 and tangent2. spacing: between them [m].

    Raises:
        InputError: no places, too many, or a spacing that is no positive length.
    """

    rows: int = 10
    columns: int = 10
    spacing: float = 0.01

    def __post_init__(self) -> None:
        if self.rows < 1 or self.columns < 1 or self.rows * self.columns > 100_000:
            raise InputError(f"a campaign of {self.rows} × {self.columns} pokes", "1 to 100 000 places", "correct it")
        if not (np.isfinite(self.spacing) and self.spacing > 0):
            raise InputError(f"a spacing of {self.spacing} m", "a positive length", "correct it")

    @property
    def count(self) -> int:
        """Number of places."""
        return self.rows * self.columns

    def place(self, index: int) -> tuple[float, float]:
        """Along both tangents [m]."""
        i, j = divmod(index, self.columns)
        return ((i - (self.rows - 1) / 2) * self.spacing, (j - (self.columns - 1) / 2) * self.spacing)

    @property
    def done_there(self) -> str:
        """What is done at each place."""
        return "poke"

    def name(self, index: int) -> str:
        """Of a place's files."""
        return f"{self.done_there}_{index:04d}"

    def rim(self) -> list[int]:
        """Numbers of the outermost places."""
        return [
            k
            for k in range(self.count)
            if k // self.columns in (0, self.rows - 1) or k % self.columns in (0, self.columns - 1)
        ]
