"""Kelvin-Voigt contact, f = K x + B ẋ, linear in its parameters."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from kinid.estimators._machine import Columns, Online, Out, contact_columns, one_contact
from kinid.estimators.estimate import Array, Mask, Prior, Track
from kinid.estimators.excitation import Excitation
from kinid.estimators.forgetting import Constant, Forgetting
from kinid.estimators.rls import LeastSquaresMachine, RecursiveLeastSquares

NAMES = ("stiffness", "damping")  # K [N/m], B [N·s/m]


@dataclass(frozen=True)
class KelvinVoigt:
    """Recursive least squares on the regressors [x, ẋ] while the depth is positive.

    The law pulls at separation (f < 0 where B ẋ < −K x), which no dry contact does; `HuntCrossley` doesn't.

    Args:
        forgetting, prior, directional, covariance_limit, excitation: as in `RecursiveLeastSquares`.
    """

    forgetting: Forgetting = field(default_factory=lambda: Constant(0.98))
    prior: Prior | None = None
    directional: bool = False
    covariance_limit: float | None = 1.0
    excitation: Excitation | None = field(default_factory=Excitation)

    def run(
        self, depth: Array, depth_rate: Array, normal_force: Array, t: Array | None = None,
        in_contact: Mask | None = None,
    ) -> Track:  # fmt: skip
        """All samples of a log.

        Args:
            depth: [m], (n,), positive inside the material.
            depth_rate: [m/s], (n,).
            normal_force: [N], (n,).
            t: time [s], (n,); needed by scheduled forgetting only.
            in_contact: samples that may be used, (n,); by default all whose depth is positive.

        Raises:
            InputError: shapes that don't fit, no samples, time that doesn't grow.
        """
        time, columns = contact_columns(t, depth, depth_rate, normal_force, in_contact)
        return self._machine().run(columns, time)

    def online(self) -> Online:
        """`update(depth, depth_rate, normal_force, [in_contact,] t=…)` → `Estimate`."""
        return Online(self._machine(), *one_contact())

    def _machine(self) -> _KelvinVoigtMachine:
        return _KelvinVoigtMachine(
            RecursiveLeastSquares(
                NAMES, self.forgetting, self.prior, self.directional, self.covariance_limit, self.excitation
            )
        )


class _KelvinVoigtMachine(LeastSquaresMachine):
    """Columns: depth, depth rate, force, contact."""

    def advance(self, columns: Columns, t: Array | None, out: Out) -> None:
        from kinid.estimators import _kernels

        rows = self.room(len(columns[0]))
        depth, rate, force, contact = columns
        _kernels.kelvin_voigt_rows(depth, rate, force, contact, *rows)
        super().advance(rows, t, out)


def force(depth: Array, depth_rate: Array, stiffness: Any, damping: Any) -> Array:
    """Normal force [N] of the law where the depth is positive, else 0; all broadcast."""
    return np.where(np.asarray(depth) > 0.0, stiffness * np.asarray(depth) + damping * np.asarray(depth_rate), 0.0)
