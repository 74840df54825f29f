"""Recursive least squares: plain, exponentially weighted, scheduled, directional; one numerically safe form."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from kinid.errors import InputError
from kinid.estimators._machine import (
    UNKNOWN_TIME,
    Columns,
    Machine,
    Memory,
    Online,
    Out,
    covariance,
    stop_clock,
    vectors,
)
from kinid.estimators.estimate import Array, Prior, Track
from kinid.estimators.excitation import Excitation
from kinid.estimators.forgetting import Constant, Forgetting
from kinid.estimators.offset import Offset

#: variance of a parameter of which nothing is known, over the noise variance
DIFFUSE = 1e12


@dataclass(frozen=True)
class RecursiveLeastSquares:
    """y = φᵀθ + noise, minimising Σ β^(n−i) (yᵢ − φᵢᵀθ)² + β^n (θ − θ₀)ᵀ P₀⁻¹ (θ − θ₀).

    β = 1 is plain least squares, with the prior as its ridge; a constant β < 1 weighs exponentially, `Scheduled` lets β
    grow. The covariance is kept as U·diag(d)·Uᵀ (Bierman 1977), which stays positive for any number of samples.

    Without excitation exponential forgetting would let it grow without end. Two means against this: no variance passes
    `covariance_limit` times its prior (as if each parameter that was forgotten that far were measured once more, with
    no new value; other directions go on forgetting), and `directional` forgetting, which forgets only what the sample
    informs (Kulhavý 1987).

    Intervals hold for white noise, an offset of the stated size, and constant parameters; other noise that is
    correlated in time or a parameter that moves within the memory makes them too narrow. With directional forgetting
    they are up to √2 too wide.

    Args:
        names: of the p parameters.
        forgetting: rule for β.
        prior: start; None for values 0 of which nothing is known (variances 1e12 times the noise's).
        directional: forget along the regressor only.
        covariance_limit: largest variance, in parts of the prior's; None for no limit.
        excitation: window and threshold; None measures none.
        offset: error that the outputs share, of which intervals should know; None for none.
        accuracy: an estimate is valid where half of each 95 % interval is within this share of its value, (p,); None
            asks for excitation alone.
        beside: … or within this share of the first value, (p,), in units of the one over the other: for parameters
            that may be none at all.

    Raises:
        InputError: no names or twice the same, a prior or accuracies of another size.
    """

    names: tuple[str, ...]
    forgetting: Forgetting = field(default_factory=Constant)
    prior: Prior | None = None
    directional: bool = False
    covariance_limit: float | None = 1.0
    excitation: Excitation | None = field(default_factory=Excitation)
    offset: Offset | None = None
    accuracy: tuple[float, ...] | None = None
    beside: tuple[float, ...] | None = None

    def __post_init__(self) -> None:
        if not self.names or len(set(self.names)) < len(self.names):
            raise InputError(f"parameter names {self.names}", "at least one, all different", "name each parameter")
        if self.prior is not None and len(self.prior.values) != len(self.names):
            raise InputError(
                f"a prior of {len(self.prior.values)} values",
                f"{len(self.names)}: {', '.join(self.names)}",
                "give a value for each parameter",
            )
        for name in ("accuracy", "beside"):
            shares = getattr(self, name)
            if shares is not None and not (len(shares) == len(self.names) and all(share >= 0.0 for share in shares)):
                raise InputError(
                    f"{name} = {shares}",
                    f"{len(self.names)} numbers ≥ 0: {', '.join(self.names)}",
                    "give a share for each parameter",
                )

    def run(self, regressors: Array, outputs: Array, t: Array | None = None) -> Track:
        """All samples of a log.

        Args:
            regressors: (n, p).
            outputs: (n,).
            t: time [s], (n,); needed by scheduled forgetting only.

        Raises:
            InputError: shapes that don't fit, no samples, time that doesn't grow.
        """
        time, (rows, y) = vectors(t, regressors=regressors, outputs=outputs)
        if rows.ndim != 2 or rows.shape[1] != len(self.names) or y.ndim != 1:
            raise InputError(
                f"regressors {rows.shape} and outputs {y.shape}",
                f"(n, {len(self.names)}) and (n,)",
                "give one row a sample and one column a parameter",
            )
        return self.machine().run((rows, y), time)

    def online(self) -> Online:
        """`update(regressor (p,), output, t=…)` → `Estimate`."""
        return Online(self.machine())

    def machine(self) -> LeastSquaresMachine:
        """Fresh memory."""
        return LeastSquaresMachine(self)


class LeastSquaresMachine(Machine):
    """Memory of running least squares. Columns: regressors (n, p), outputs (n,), optionally status codes (n,).

    Args:
        settings: of the least squares.
        columns: shapes of what a sample is made of, where rows are made from it; by default regressor and output.
        flags: as in `Machine`.
        row_settings: numbers that the making of rows needs.
    """

    def __init__(
        self,
        settings: RecursiveLeastSquares,
        columns: tuple[tuple[int, ...], ...] | None = None,
        flags: int = 0,
        row_settings: tuple[float, ...] = (),
    ) -> None:
        p = len(settings.names)
        nothing = (0.0,) * p
        accuracy = (settings.accuracy or (math.inf,) * p) + (settings.beside or nothing)
        self.directional = settings.directional
        super().__init__(
            settings.names,
            Memory.of(
                settings.prior or Prior(np.zeros(p), np.full(p, DIFFUSE)), settings.covariance_limit, settings.offset
            ),
            settings.forgetting,
            settings.excitation,
            columns or ((p,), ()),
            flags=flags,
            spare=p + 2 if columns else 1,  # a row is regressor, output, code
            settings=(float(self.directional), *accuracy, *row_settings),
        )
        self._all_used = np.zeros(1, np.int8)
        self._rows = (np.empty((0, p)), np.empty(0), np.empty(0, np.int8))

    def advance(self, columns: Columns, t: Array | None, out: Out) -> None:
        """See `Machine`."""
        from kinid.estimators import _kernels

        rows, y = columns[:2]
        codes: NDArray[np.int8] = columns[2] if len(columns) > 2 else self._all_used
        room = self.room
        _kernels.least_squares(
            self.shape,
            room.state,
            rows,
            y,
            self.forgetting.factors(t),
            UNKNOWN_TIME if t is None else t,
            codes,
            room.limit,
            self.directional,
            room.settings[1:],
            room.window,
            room.length,
            room.threshold,
            room.scratch,
            out,
        )

    @property
    def once(self) -> Callable[..., None]:
        """See `Machine`."""
        from kinid.estimators._kernels import least_squares_once

        return least_squares_once

    def restart(self) -> None:
        """See `Machine`."""
        stop_clock(self.room.state, len(self.names))

    def rows(self, n: int) -> tuple[Array, Array, NDArray[np.int8]]:
        """Regressors, outputs and codes for n samples, to be written; the same arrays as long as n stays."""
        if len(self._rows[0]) != n:
            self._rows = (np.empty((n, len(self.names))), np.empty(n), np.empty(n, np.int8))
        return self._rows

    def covariance(self, state: Array) -> Array:
        """See `Machine`."""
        return covariance(state, len(self.names))
