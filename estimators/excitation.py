"""Persistence of excitation: do the last samples tell the parameters apart?"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from kinid.errors import InputError
from kinid.estimators.estimate import Array

#: gram, scale and cursor of a window, as the kernels take them
Window = tuple[Array, Array, Array]


@dataclass(frozen=True)
class Excitation:
    """Smallest singular value of the regressors Φ over a sliding window, columns scaled to unit size.

    σ = σ_min(Φ S⁻¹) / √samples, with S the scale of each column: 1 where all regressors are as large as they ever are
    and orthogonal, 0 where one is missing or follows from the others. For n samples of noise s the worst-known
    combination of scaled parameters has the standard deviation s / (σ √n). Below `threshold` an estimate is marked:
    at 0.02 that deviation is 50 times that of ideal motion. A sample that isn't used counts as a row of zeros.

    The window is a ring of blocks; a block that leaves is dropped whole, nothing is subtracted, so no rounding
    accumulates. The value is renewed once a block.

    Args:
        window: samples.
        threshold: least σ of a valid estimate.
        scale: size of each regressor, (p,); by default the largest rms that it had in any full window so far. Give it
            where a log may begin without excitation.
        blocks: of the window.

    Raises:
        InputError: a window shorter than its blocks, or a scale that isn't positive.
    """

    window: int = 200
    threshold: float = 0.02
    scale: tuple[float, ...] | None = None
    blocks: int = 5

    def __post_init__(self) -> None:
        if not 1 <= self.blocks <= self.window:
            raise InputError(
                f"a window of {self.window} samples in {self.blocks} blocks", "1 ≤ blocks ≤ window", "lengthen it"
            )
        if self.scale is not None and not all(np.isfinite(s) and s > 0 for s in self.scale):
            raise InputError(f"a scale of {self.scale}", "positive numbers", "give the usual size of each regressor")

    @property
    def length(self) -> int:
        """Samples of a block."""
        return -(-self.window // self.blocks)

    def memory(self, p: int) -> Window:
        """An empty window for p regressors.

        Raises:
            InputError: a scale for another number of regressors.
        """
        cursor = np.zeros(5)
        scale = np.zeros(p)
        if self.scale is not None:
            if len(self.scale) != p:
                raise InputError(f"a scale of {len(self.scale)} numbers", f"{p}, one a regressor", "give them all")
            scale[:] = self.scale
            cursor[4] = 1.0
        return np.zeros((self.blocks, p, p)), scale, cursor

    def track(self, regressors: Array) -> Array:
        """σ after each row of regressors (n, p), all of which count, (n,)."""
        from kinid.estimators._excitation_kernels import excitation

        rows = np.ascontiguousarray(regressors, dtype=np.float64)
        if rows.ndim != 2 or not np.isfinite(rows).all():
            raise InputError(f"regressors of shape {rows.shape}", "finite numbers, (n, p)", "remove gaps first")
        n, p = rows.shape
        values = np.empty(n)
        excitation((0.0,) * p, rows, self.memory(p), self.length, np.empty((p + 1, p)), values)
        return values
