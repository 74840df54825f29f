"""Kelvin-Voigt contact, f = K x + B ẋ, linear in its parameters."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from kinid.estimators._contact import COLUMNS, ContactEstimator
from kinid.estimators._machine import Columns, Out
from kinid.estimators.estimate import SAMPLE, Array, Prior
from kinid.estimators.excitation import Excitation
from kinid.estimators.forgetting import Constant, Forgetting
from kinid.estimators.offset import Offset
from kinid.estimators.rls import LeastSquaresMachine, RecursiveLeastSquares
from kinid.kernels import contact_laws

NAMES = ("stiffness", "damping")  # K [N/m], B [N·s/m]


@dataclass(frozen=True)
class KelvinVoigt(ContactEstimator):
    """Recursive least squares on the regressors [x, ẋ] while the depth is positive.

    The law pulls at separation (f < 0 where B ẋ < −K x), which no dry contact does; `HuntCrossley` doesn't.

    Args:
        forgetting, prior, directional, covariance_limit, excitation: as in `RecursiveLeastSquares`.
        offset: the sensor's zero [N], of which intervals know; None for one that is exact.
        accuracy: half width of the 95 % intervals of a valid estimate, as shares of K and B; None asks for excitation
            alone. A B that is known to K·1 ms is known well enough, too: it acts like a delay of one sample.
    """

    forgetting: Forgetting = field(default_factory=lambda: Constant(0.98))
    prior: Prior | None = None
    directional: bool = False
    covariance_limit: float | None = 1.0
    excitation: Excitation | None = field(default_factory=Excitation)
    offset: Offset | None = field(default_factory=Offset)
    accuracy: tuple[float, float] | None = (0.05, 0.15)

    def _machine(self) -> _KelvinVoigtMachine:
        return _KelvinVoigtMachine(
            RecursiveLeastSquares(
                NAMES,
                self.forgetting,
                self.prior,
                self.directional,
                self.covariance_limit,
                self.excitation,
                self.offset,
                self.accuracy,
                (0.0, SAMPLE),
            )
        )


class _KelvinVoigtMachine(LeastSquaresMachine):
    """Columns: depth, depth rate, force, contact."""

    def __init__(self, settings: RecursiveLeastSquares) -> None:
        super().__init__(settings, COLUMNS, flags=1)

    def advance(self, columns: Columns, t: Array | None, out: Out) -> None:
        from kinid.estimators import _kernels

        rows = self.rows(len(columns[0]))
        depth, rate, force, contact = columns
        _kernels.kelvin_voigt_rows(depth, rate, force, contact, *rows)
        super().advance(rows, t, out)

    @property
    def once(self) -> Callable[..., None]:
        from kinid.estimators._kernels import kelvin_voigt_once

        return kelvin_voigt_once


def force(depth: Array, depth_rate: Array, stiffness: Any, damping: Any) -> Array:
    """Normal force [N] of the law where the depth is positive, else 0; all broadcast."""
    law = contact_laws.kelvin_voigt(np.asarray(depth), np.asarray(depth_rate), stiffness, damping)
    return np.where(np.asarray(depth) > 0.0, law, 0.0)
