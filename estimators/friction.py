"""Friction while sliding: T = μ N u + c v, and the equivalent coefficient T/N."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from kinid.errors import InputError
from kinid.estimators._machine import Columns, Machine, Memory, Online, Out, vectors
from kinid.estimators.estimate import Array, Mask, Prior, Track
from kinid.estimators.excitation import Excitation
from kinid.estimators.forgetting import Constant
from kinid.estimators.offset import ZERO_AT_START, ZERO_DRIFT

NAMES = ("friction", "viscous")  # μ [1], c [N·s/m]

#: of the filter: values, their factors, room for an update, and its own numbers (see `_friction_kernels`)
_STATES, _NUMBERS, _TIME, _NOISE = 5, 20, 10, 11
#: without a prior: standard deviations of μ and c
COLD = (2.0, 100.0)


@dataclass(frozen=True)
class Friction:
    """Coulomb and viscous friction against the slip, T = μ |u| N + c v, recursively and with errors in all variables.

    T is the part of the tangential force that opposes the slip; a force across it is not friction. Least squares on
    [N, |v|] is wrong on measured logs, and sure of it: noise makes |v| too large and shrinks what is estimated from
    noisy regressors, the force turns around over a length where |v| starts anew at once, and the sensor's zeros wander
    by millinewtons. So this is an extended Kalman filter of μ, c and the three zeros, in which

    - u is the deflection of bristles of a fixed length (Dahl 1968; Dupont et al. 2002), the form that friction has in
      `kinid.effects`: at rest the force keeps what the last slip left, and a reversal takes a length;
    - the gain is made of instruments, means of N and v over the samples *before*, whose noise is another one (recursive
      instrumental variables: L. Ljung, T. Söderström, Theory and Practice of Recursive Identification, 1983, 3.6);
    - samples weigh less the less the bristles have turned around, since their form is known least there;
    - the zeros walk, and are read in the air where `in_contact` says so.

    An estimate is valid where its 95 % intervals are within `accuracy`: of μ, and of the friction force at the speeds
    seen for c. So it can be false in 5 % of the cases, if intervals are right, and the law is; innovations that are
    correlated by more than a half from sample to sample say that it isn't, and are marked as misfit.

    Args:
        prior: of μ and c; None for a cold start.
        least_speed: [m/s]; slower samples are not used: they say what holds the tip, not what resists its slip.
        least_load: [N]; samples with less normal force are not used.
        bristle: length ℓ over which friction turns around [m]; 0 for at once.
        reversal: standard deviation of the force while bristles are straight, in parts of μ N.
        noise: standard deviation of a force at the start [N]; it is estimated along.
        walk: standard deviations that μ and c [N·s/m] gain in a second.
        drift: the same of the zeros of a tangential and of the normal force [N]: millinewtons for strain gauges.
        accuracy: relative half width of the intervals of a valid estimate.
        period: sample time [s] where no time is given.
        excitation: window on [N, |v|], besides; None measures none.

    Raises:
        InputError: a number outside its range, or a prior of another size.
    """

    prior: Prior | None = None
    least_speed: float = 2e-4
    least_load: float = 0.1
    bristle: float = 1e-4
    reversal: float = 0.05
    noise: float = 0.02
    walk: tuple[float, float] = (0.0, 0.0)
    drift: tuple[float, float] = (6e-4, ZERO_DRIFT)
    accuracy: float = 0.05
    period: float = 1e-3
    excitation: Excitation | None = None

    def __post_init__(self) -> None:
        _thresholds(self.least_speed, self.least_load)
        for name, values in (
            ("bristle and reversal", (self.bristle, self.reversal)),
            ("walk", self.walk),
            ("drift", self.drift),
        ):
            if len(values) != 2 or not all(math.isfinite(value) and value >= 0.0 for value in values):
                raise InputError(f"{name} of {values}", "finite numbers ≥ 0", "use the defaults")
        for name in ("noise", "accuracy", "period"):
            value = getattr(self, name)
            if not (math.isfinite(value) and value > 0.0):
                raise InputError(f"{name} = {value}", "a positive number", "use the default or the sensor's data")
        if self.prior is not None and len(self.prior.values) != len(NAMES):
            raise InputError(
                f"a prior of {len(self.prior.values)} values", f"{len(NAMES)}: {', '.join(NAMES)}", "give both"
            )

    def run(
        self,
        normal_force: Array,
        slip_rate: Array,
        tangential_force: Array,
        t: Array | None = None,
        in_contact: Mask | None = None,
    ) -> Track:
        """All samples of a log.

        Args:
            normal_force: [N], (n,).
            slip_rate: [m/s], (n,) signed along one axis or (n, 2).
            tangential_force: of the material on the tool [N], like `slip_rate`.
            t: time [s], (n,); by default samples are `period` apart.
            in_contact: whether the tool touches, (n,); where it doesn't, forces are read as the sensor's zeros. By
                default it touches throughout.

        Raises:
            InputError: shapes that don't fit, no samples, time that doesn't grow.
        """
        time, columns = _columns(t, normal_force, slip_rate, tangential_force)
        contact = (
            np.ones(len(columns[0]), np.bool_) if in_contact is None else np.ascontiguousarray(in_contact, np.bool_)
        )
        if contact.shape != columns[0].shape:
            raise InputError(f"in_contact {contact.shape}", f"{columns[0].shape}, like normal_force", "align them")
        return self._machine(columns[1].shape[1]).run((*columns, contact), time)

    def online(self, axes: int = 2) -> Online:
        """`update(normal_force, slip_rate (axes,), tangential_force (axes,), [in_contact,] t=…)` → `Estimate`."""
        return Online(self._machine(axes))

    def _machine(self, axes: int) -> _FrictionMachine:
        return _FrictionMachine(self, axes)


class _FrictionMachine(Machine):
    """Columns: normal force (n,), slip rate (n, axes), tangential force (n, axes), flag of contact."""

    def __init__(self, settings: Friction, axes: int) -> None:
        prior = settings.prior or Prior(np.zeros(2), np.square(COLD))
        whole = np.diag([0.0, 0.0, *[ZERO_AT_START**2] * 3])
        whole[:2, :2] = prior.covariance
        start = Memory.of(Prior(np.append(prior.values, np.zeros(3)), whole), None)
        numbers = np.zeros(_NUMBERS)
        numbers[_TIME], numbers[_NOISE] = math.nan, settings.noise**2
        filled = 2 * _STATES + _STATES**2
        state = np.concatenate([start.state[:filled], np.zeros(3 * _STATES), numbers, [0.0]])
        fixed = (settings.least_speed, settings.least_load, settings.bristle, settings.reversal, settings.noise)
        super().__init__(
            NAMES,
            Memory(state, np.full(2, np.inf)),
            Constant(),
            settings.excitation,
            ((), (axes,), (axes,), ()),
            flags=1,
            settings=(*fixed, *settings.walk, *settings.drift, settings.accuracy, settings.period),
        )

    def advance(self, columns: Columns, t: Array | None, out: Out) -> None:
        from kinid.estimators._friction_kernels import friction

        room = self.room
        load, slip, force, contact = columns
        friction(
            self.shape,
            room.state,
            load,
            slip,
            force,
            contact,
            np.array([math.nan]) if t is None else t,
            room.settings,
            room.window,
            room.length,
            room.threshold,
            room.scratch,
            out,
        )

    @property
    def once(self) -> Callable[..., None]:
        from kinid.estimators._friction_kernels import friction_once

        return friction_once

    def restart(self) -> None:
        """The next sample is `period` after the last."""
        self.room.state[2 * _STATES + _STATES**2 + 3 * _STATES + _TIME] = math.nan

    def covariance(self, state: Array) -> Array:
        """Of μ and c."""
        if state[-1] <= 0.0:
            return np.full((2, 2), np.inf)
        u = state[2 * _STATES : 2 * _STATES + _STATES**2].reshape(_STATES, _STATES)
        return np.asarray(((u * state[_STATES : 2 * _STATES]) @ u.T)[:2, :2])


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
