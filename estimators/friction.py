"""Friction while sliding: T = μ N + c |v|, and the equivalent coefficient T/N."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from kinid.errors import InputError
from kinid.estimators._machine import Columns, Online, Out, vectors
from kinid.estimators.estimate import Array, Mask, Prior, Track
from kinid.estimators.excitation import Excitation
from kinid.estimators.forgetting import Constant, Forgetting
from kinid.estimators.rls import LeastSquaresMachine, RecursiveLeastSquares

NAMES = ("friction", "viscous")  # μ [1], c [N·s/m]


@dataclass(frozen=True)
class Friction:
    """Recursive least squares on the regressors [N, |v|]: Coulomb and viscous friction against the slip.

    T is the part of the tangential force that opposes the slip, −f·v/|v|; a force across it is not friction.

    Args:
        forgetting, prior, directional, covariance_limit, excitation: as in `RecursiveLeastSquares`.
        least_speed: [m/s]; slower samples are not used: at rest friction is whatever holds the tip.
        least_load: [N]; samples with less normal force are not used.

    Raises:
        InputError: a threshold that is negative or not finite.
    """

    forgetting: Forgetting = field(default_factory=Constant)
    prior: Prior | None = None
    directional: bool = False
    covariance_limit: float | None = 1.0
    excitation: Excitation | None = field(default_factory=Excitation)
    least_speed: float = 1e-3
    least_load: float = 0.1

    def __post_init__(self) -> None:
        _thresholds(self.least_speed, self.least_load)

    def run(self, normal_force: Array, slip_rate: Array, tangential_force: Array, t: Array | None = None) -> Track:
        """All samples of a log.

        Args:
            normal_force: [N], (n,).
            slip_rate: [m/s], (n,) signed along one axis or (n, 2).
            tangential_force: of the material on the tool [N], like `slip_rate`.
            t: time [s], (n,); needed by scheduled forgetting only.

        Raises:
            InputError: shapes that don't fit, no samples, time that doesn't grow.
        """
        time, columns = _columns(t, normal_force, slip_rate, tangential_force)
        return self._machine(columns[1].shape[1]).run(columns, time)

    def online(self, axes: int = 2) -> Online:
        """`update(normal_force, slip_rate (axes,), tangential_force (axes,), t=…)` → `Estimate`."""
        return Online(self._machine(axes))

    def _machine(self, axes: int) -> _FrictionMachine:
        return _FrictionMachine(
            RecursiveLeastSquares(
                NAMES, self.forgetting, self.prior, self.directional, self.covariance_limit, self.excitation
            ),
            axes,
            (self.least_speed, self.least_load),
        )


class _FrictionMachine(LeastSquaresMachine):
    """Columns: normal force (n,), slip rate (n, axes), tangential force (n, axes)."""

    def __init__(self, settings: RecursiveLeastSquares, axes: int, least: tuple[float, float]) -> None:
        super().__init__(settings, ((), (axes,), (axes,)), told=least)
        self._least = least

    def advance(self, columns: Columns, t: Array | None, out: Out) -> None:
        from kinid.estimators import _kernels

        rows = self.rows(len(columns[0]))
        load, slip, force = columns
        _kernels.friction_rows(load, slip, force, *self._least, *rows)
        super().advance(rows, t, out)

    @property
    def once(self) -> Callable[..., None]:
        from kinid.estimators._kernels import friction_once

        return friction_once


@dataclass(frozen=True, eq=False)
class EquivalentFriction:
    """μ_eq = T/N of the samples that slide.

    Attributes:
        sliding: which samples they are, (n,).
        values: of those samples only, (m,).
        mean: Σ T N / Σ N², the least-squares ratio; low loads count little. 0 where nothing slides.
        std: scatter of the values about it, each weighted with N². 0 where nothing slides.
        status: a sentence; says what is missing where nothing slides.
    """

    sliding: Mask
    values: Array
    mean: float
    std: float
    status: str


def equivalent_friction(
    normal_force: Array, slip_rate: Array, tangential_force: Array, least_speed: float = 1e-3, least_load: float = 0.1
) -> EquivalentFriction:
    """Ratio of the force against the slip to the normal force while sliding.

    It holds everything that resists: Coulomb, viscous, ploughing. Arguments as `Friction`.

    Raises:
        InputError: shapes that don't fit, no samples, a bad threshold.
    """
    _thresholds(least_speed, least_load)
    _, (load, slip, force) = _columns(None, normal_force, slip_rate, tangential_force)
    with np.errstate(invalid="ignore"):  # what isn't finite doesn't slide
        speed = np.sqrt((slip * slip).sum(axis=1))
        along = -(slip * force).sum(axis=1)
        sliding = (load > least_load) & (speed > least_speed) & np.isfinite(along) & np.isfinite(load)
    load, tangential = load[sliding], along[sliding] / speed[sliding]
    if not sliding.any():
        status = f"no sample slides faster than {least_speed:g} m/s under more than {least_load:g} N: slide under load"
        return EquivalentFriction(sliding, tangential, 0.0, 0.0, status)
    values = tangential / load
    weights = load**2 / (load**2).sum()
    mean = float(weights @ values)
    std = float(np.sqrt(weights @ (values - mean) ** 2))
    return EquivalentFriction(sliding, values, mean, std, f"{sliding.sum()} of {sliding.size} samples slide")


def _columns(t: Array | None, load: Array, slip: Array, force: Array) -> tuple[Array | None, tuple[Array, ...]]:
    time, (n, v, f) = vectors(t, normal_force=load, slip_rate=slip, tangential_force=force)
    v, f = (a[:, None] if a.ndim == 1 else a for a in (v, f))
    if n.ndim != 1 or v.ndim != 2 or v.shape != f.shape:
        raise InputError(
            f"normal_force {n.shape}, slip_rate {v.shape}, tangential_force {f.shape}",
            "(n,), and twice (n,) or (n, 2)",
            "give slip and tangential force along the same axes",
        )
    return time, (n, v, f)


def _thresholds(*values: float) -> None:
    if not all(math.isfinite(value) and value >= 0.0 for value in values):
        raise InputError(f"least speed and load of {values}", "finite numbers ≥ 0", "use 1e-3 m/s and 0.1 N")
