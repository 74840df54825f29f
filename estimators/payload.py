"""Mass, centre of mass and sensor bias of what a wrist force/torque sensor carries, by linear least squares.

With gravity g, acceleration a of the sensor's origin, ω, α, h = m·com, I about it, all in sensor axes:

    f = m (g − a) − α × h − ω × (ω × h) + b_f
    τ = h × (g − a) − I α − ω × I ω + b_τ

linear in m, h, b, I (Atkeson, An, Hollerbach 1986). The wrench is the load on the tool: at rest in the air it
reads m·g, and the mass is positive. What holds the tool would give a negative one.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from kinid.data.rig import ToolSpec
from kinid.errors import InputError
from kinid.estimators.wander import walk_scatter
from kinid.signal.autoregression import autoregression

__all__ = ["NAMES", "Payload", "Value", "fit_payload"]

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
Status = Literal["ok", "not-excited", "too-few", "negative-mass"]

#: quantities of a payload, in the order of `Payload.covariance`; the inertia only where the tool turned
NAMES = (
    "mass",
    "com_x",
    "com_y",
    "com_z",
    "bias_fx",
    "bias_fy",
    "bias_fz",
    "bias_tx",
    "bias_ty",
    "bias_tz",
    "inertia_xx",
    "inertia_yy",
    "inertia_zz",
    "inertia_xy",
    "inertia_xz",
    "inertia_yz",
)
UNITS = ("kg", *("m",) * 3, *("N",) * 3, *("N·m",) * 3, *("kg·m²",) * 6)

#: a combination of parameters that moves the reading by less than this share of the weight isn't identified;
#: that is a turn of 0.6°: how well an arm's attitude is known limits the fit, however small the noise
EXCITED = 0.01
# for that question all rows and parameters are in newtons: torques at an arm of 0.1 m, masses by their weight
_G, _ARM = 9.81, 0.1
_ROWS = np.array([1.0] * 3 + [1 / _ARM] * 3)
_COLUMNS = np.array([1 / _G] + [_ARM / _G] * 3 + [1.0] * 3 + [_ARM] * 3 + [_ARM**2 / _G] * 6)
_STREAM = 50  # with fewer rows than this they are taken as separate poses, whose errors are not correlated


class Value(NamedTuple):
    """An estimate with its confidence interval; NaN and infinite where the data can't tell."""

    value: float
    low: float
    high: float
    unit: str


@dataclass(frozen=True, eq=False)
class Payload:
    """What hangs on the sensor; `payload["mass"]` gives value, low, high and unit by name.

    Attributes:
        mass: [kg]. com: centre of mass in the sensor frame [m], (3,).
        bias: reading without any load [N, N·m], (6,).
        inertia: ixx iyy izz ixy ixz iyz about the com, sensor axes [kg·m²], (6,); None where nothing turned.
        low, high: ends of the confidence intervals, in the order of `NAMES`, (10,) or (16,).
        covariance: in the same order; infinite on the diagonal of what is not identified, NaN beside it.
        residual: measured less predicted [N, N·m], (n, 6); NaN in rows that were not usable.
        rms_force, rms_torque: root mean square of the residual over samples and axes [N], [N·m].
        condition: of the scaled problem; infinite where something is not identified.
        correlation: how many samples in a row err alike (1 for independent ones); it widened the intervals.
        used: number of usable samples.
        unidentified: names of the quantities that the data can't tell.
        status: "ok", or what is wrong. remedy: what to do about it; empty for "ok".
    """

    mass: float
    com: Array
    bias: Array
    inertia: Array | None
    low: Array
    high: Array
    covariance: Array
    residual: Array
    rms_force: float
    rms_torque: float
    condition: float
    correlation: float
    used: int
    unidentified: tuple[str, ...]
    status: Status
    remedy: str

    def __getitem__(self, name: str) -> Value:
        values = np.concatenate([[self.mass], self.com, self.bias, [] if self.inertia is None else self.inertia])
        if name not in NAMES[: len(values)]:
            raise KeyError(f"'{name}' is none of {', '.join(NAMES[: len(values)])}")
        i = NAMES.index(name)
        return Value(float(values[i]), float(self.low[i]), float(self.high[i]), UNITS[i])

    def tool(self) -> ToolSpec:
        """The `[tool]` of a rig; the bias belongs to `[sensor]`. An inertia that isn't identified stays out.

        Raises:
            InputError: mass or centre of mass are not identified, or the mass is negative.
        """
        missing = [name for name in NAMES[:4] if name in self.unidentified]
        if missing or self.mass < 0:
            found = f"poses that can't tell {', '.join(missing)}" if missing else f"a payload of {self.mass:.4g} kg"
            raise InputError(found, "mass and centre of mass of the tool", self.remedy or "add poses")
        inertia = np.zeros(6) if self.inertia is None or not np.isfinite(self.inertia).all() else self.inertia
        table = {"mass": self.mass, "com": self.com.tolist(), "inertia": inertia.tolist()}
        return ToolSpec.model_validate(table)


def fit_payload(
    wrench: ArrayLike,
    gravity: ArrayLike,
    *,
    acceleration: ArrayLike | None = None,
    angular_velocity: ArrayLike | None = None,
    angular_acceleration: ArrayLike | None = None,
    noise: ArrayLike | None = None,
    level: float = 0.95,
) -> Payload:
    """Fit mass, centre of mass and bias to free motion or poses at rest, and the inertia where it turned.

    Args:
        wrench: load on the tool, sensor frame at its origin [N, N·m], (n, 6).
        gravity: in sensor axes, Rᵀ g [m/s²], (n, 3).
        acceleration: of the sensor's origin in sensor axes [m/s²], (n, 3); none for poses at rest.
        angular_velocity: in sensor axes [rad/s], (n, 3).
        angular_acceleration: in sensor axes [rad/s²], (n, 3).
        noise: standard deviation of the six channels, at least; where it is not given, the residual tells it.
        level: of the confidence intervals.

    The intervals hold the scatter that the residual shows, each channel's own, and its correlation in time and the
    walk of its zero if the rows are a stream. They don't hold errors of the gravity direction, nor a sensor's
    cross-talk, which has to be taken out before: 1 % of it puts a mass 0.3 % off and a bias by 0.02 N.

    Raises:
        InputError: shapes that don't fit, no usable row, or a gravity that is not in m/s².
    """
    measured = _table(wrench, 6, "wrench")
    n = len(measured)
    g = _table(gravity, 3, "gravity", n)
    a = _table(acceleration, 3, "acceleration", n)
    w = _table(angular_velocity, 3, "angular velocity", n)
    alpha = _table(angular_acceleration, 3, "angular acceleration", n)
    usable: Mask = np.isfinite(np.concatenate([measured, g, a, w, alpha], axis=1).sum(axis=1))
    if not usable.any():
        raise InputError(f"no usable row among {n} of the wrench", "finite numbers", "check the log")
    size = float(np.median(np.linalg.norm(g[usable], axis=1)))
    if not 9.0 < size < 10.5:
        remedy = "scale it: an accelerometer in g wants a factor of 9.80665"
        raise InputError(f"gravity of {size:.4g} in the sensor frame", "about 9.81 m/s²", remedy)
    turning = angular_velocity is not None or angular_acceleration is not None
    design = _design(g[usable] - a[usable], w[usable], alpha[usable], turning)
    scaled = design * _ROWS[:, None] * _COLUMNS[: design.shape[2]]  # (n, 6, p)
    gram = np.einsum("nij,nik->ijk", scaled, scaled)  # one for each channel, (6, p, p)
    singular, right = _excitation(gram.sum(axis=0) / len(scaled))
    seen, unseen = right[singular > EXCITED], right[singular <= EXCITED]
    least = None if noise is None else _noise(noise) * _ROWS
    fit = _solve(scaled, measured[usable] * _ROWS, gram, seen, unseen, least)
    condition = np.inf if len(unseen) else float(singular[0] / singular[-1])
    return _payload(fit, unseen, condition, usable, level)


class _Fit(NamedTuple):
    """A fit in scaled rows and columns."""

    theta: Array  # parameters, (p,)
    covariance: Array  # (p, p); infinite without a degree of freedom
    residual: Array  # (n, 6)
    freedom: float  # degrees of freedom of the variance
    correlation: float


def _solve(scaled: Array, y: Array, gram: Array, seen: Array, unseen: Array, least: Array | None) -> _Fit:
    """Least squares in the seen directions; forces and torques weigh what their scatter allows.

    Normal equations do, and need no second table: with unseen directions out, the condition is moderate.
    """
    n, _, p = scaled.shape
    gram = seen @ gram @ seen.T
    moment = np.einsum("nij,ni->ij", scaled, y) @ seen.T
    ratio = 1.0
    for _ in range(4):
        weight = np.repeat([1.0, ratio], 3)  # inverse variances, up to a factor
        inverse = np.linalg.inv(np.einsum("i,ijk->jk", weight, gram))
        theta = inverse @ (weight @ moment) @ seen
        residual = y - scaled @ theta
        # what the fit has taken from each channel: the leverage of its rows
        freedom = n - weight * np.einsum("jk,ikj->i", inverse, gram)
        groups = freedom.reshape(2, 3).sum(axis=1)
        if groups.min() < 0.5:
            break
        pooled = (residual**2).reshape(n, 2, 3).sum(axis=(0, 2)) / groups
        pooled = np.maximum(pooled, (1e-12 * max(1.0, float(np.abs(y).max()))) ** 2)
        ratio = float(np.clip(pooled[0] / pooled[1], 1e-4, 1e4))
    nu, correlation = np.inf, np.ones(2)
    if groups.min() >= 0.5:
        own = (residual**2).sum(axis=0) / np.maximum(freedom, 1.0)
        variance = np.where(freedom >= 1.0, own, np.repeat(pooled, 3))
        correlation = np.array([_correlation(residual[:, i : i + 3]) for i in (0, 3)])
        # the worst channel's, so that a payload that hangs on one noisy channel is not called sure
        nu = max(1.0, float(freedom.min()) / float(correlation.max()))
        variance = variance if least is None else np.maximum(variance, least**2)
    elif least is not None:
        variance = least**2
    else:
        return _Fit(theta, np.full((p, p), np.inf), residual, 1.0, 1.0)
    scatter = np.einsum("i,ijk->jk", weight**2 * variance * np.repeat(correlation, 3), gram)
    for own, rows, w in zip(residual.T, scaled.transpose(1, 0, 2) if n >= _STREAM else (), weight):
        scatter += w * w * walk_scatter(own, rows @ seen.T, *autoregression(own))
    covariance = seen.T @ inverse @ scatter @ inverse @ seen
    # what is not seen may be as large as the reading, and leaks into what is seen by the tilt between them
    covariance += float(np.abs(y).max()) ** 2 * unseen.T @ unseen
    return _Fit(theta, covariance, residual, nu, float(correlation.max()))


def _payload(fit: _Fit, unseen: Array, condition: float, usable: Mask, level: float) -> Payload:
    """From the linear parameters m, m·com, bias, I about the origin to a rig's, with intervals and status."""
    from scipy.special import stdtrit

    p = len(fit.theta)
    known = bool(np.isfinite(fit.covariance).all())
    columns = _COLUMNS[:p]
    theta, covariance = columns * fit.theta, columns[:, None] * fit.covariance * columns
    with np.errstate(divide="ignore", invalid="ignore"):
        values = _physical(theta.astype(np.complex128)).real.copy()
        # the map is rational: a step along the imaginary axis gives its derivative without rounding
        jacobian = np.stack([_physical(theta + 1e-30j * unit).imag / 1e-30 for unit in np.eye(p)], axis=1)
        spread = jacobian @ covariance @ jacobian.T if known else np.full((p, p), np.inf)
    lost: Mask = np.asarray((np.abs(unseen) > EXCITED).any(axis=0))  # what has a part in the unseen
    lost[1:4] |= lost[0]
    lost[10:] |= lost[:4].any() or lost[10:].any()
    values[lost] = np.nan
    spread[lost] = spread[:, lost] = np.nan
    spread[lost, lost] = np.inf
    t = float(stdtrit(fit.freedom, 0.5 + 0.5 * level))
    half = t * np.sqrt(np.diag(spread))
    half[lost] = np.inf
    low, high = np.where(lost, -np.inf, values - half), np.where(lost, np.inf, values + half)
    for i in (1, 2, 3):
        if np.isfinite(half[i]):
            low[i], high[i] = _fieller(theta[[i, 0]], covariance[[i, 0]][:, [i, 0]], t)
    residual = np.full((len(usable), 6), np.nan)
    residual[usable] = fit.residual / _ROWS
    used = int(usable.sum())
    status, remedy = _verdict(unseen, known, float(high[0]), used)
    rms = np.sqrt(np.mean((fit.residual / _ROWS).reshape(used, 2, 3) ** 2, axis=(0, 2)))
    return Payload(
        mass=float(values[0]),
        com=values[1:4],
        bias=values[4:10],
        inertia=values[10:] if p > 10 else None,
        low=low,
        high=high,
        covariance=spread,
        condition=condition,
        correlation=fit.correlation,
        used=used,
        residual=residual,
        rms_force=float(rms[0]),
        rms_torque=float(rms[1]),
        unidentified=tuple(name for name, gone in zip(NAMES, lost) if gone),
        status=status,
        remedy=remedy,
    )


def _design(lift: Array, w: Array, alpha: Array, turning: bool) -> Array:
    """The wrench as a linear map of m, m·com, bias and, if it turned, I about the origin, (n, 6, 10/16)."""
    out = np.zeros((len(lift), 6, 16 if turning else 10))
    spin = _cross(w)
    out[:, :3, 0] = lift
    out[:, :3, 1:4] = -_cross(alpha) - spin @ spin
    out[:, 3:, 1:4] = -_cross(lift)
    out[:, :, 4:10] = np.eye(6)
    if turning:
        out[:, 3:, 10:] = -_times(alpha) - spin @ _times(w)
    return out


def _cross(v: Array) -> Array:
    """Matrices of v × ·, (n, 3, 3)."""
    out = np.zeros((len(v), 3, 3))
    out[:, 2, 1], out[:, 0, 2], out[:, 1, 0] = v.T
    return out - np.swapaxes(out, 1, 2)


def _times(v: Array) -> Array:
    """Matrices that turn ixx iyy izz ixy ixz iyz into I·v, (n, 3, 6)."""
    out = np.zeros((len(v), 3, 6))
    for axis, columns in enumerate(((0, 3, 4), (3, 1, 5), (4, 5, 2))):
        out[:, axis, list(columns)] = v
    return out


def _physical(theta: NDArray[np.complex128]) -> NDArray[np.complex128]:
    """m, com, bias, inertia about the com from m, m·com, bias, inertia about the origin."""
    m, com = theta[0], theta[1:4] / theta[0]
    x, y, z = com
    shift = m * np.array([y * y + z * z, x * x + z * z, x * x + y * y, -x * y, -x * z, -y * z])
    return np.concatenate([[m], com, theta[4:10], theta[10:] - shift[: len(theta[10:])]])


def _fieller(pair: Array, cov: Array, t: float) -> tuple[float, float]:
    """Interval of the ratio of two normal estimates (Fieller 1954); unbounded where it may be 1/0."""
    h, m = pair
    g = t * t * cov[1, 1] / (m * m)
    if not g < 1.0:
        return -np.inf, np.inf
    c = h / m
    inside = cov[0, 0] - 2 * c * cov[0, 1] + c * c * cov[1, 1] - (g * cov[0, 0] - (t * cov[0, 1] / m) ** 2)
    half = t / abs(m) * np.sqrt(max(inside, 0.0))
    middle = c - t * t * cov[0, 1] / (m * m)
    return float((middle - half) / (1 - g)), float((middle + half) / (1 - g))


def _excitation(gram: Array) -> tuple[Array, Array]:
    """Singular values of the design per sample, falling, and the directions they belong to, as rows."""
    values, vectors = np.linalg.eigh(gram)
    # what rounding leaves of a zero eigenvalue, 1e-16, is far below EXCITED²
    return np.sqrt(np.maximum(values[::-1], 0.0)), vectors[:, ::-1].T


def _correlation(residual: Array) -> float:
    """Integrated autocorrelation time in samples, at least 1, windowed as Sokal (1997) does."""
    n = len(residual)
    if n < _STREAM:
        return 1.0
    padded = np.fft.rfft(residual - residual.mean(axis=0), 2 * n, axis=0)
    cov = np.fft.irfft((np.abs(padded) ** 2).sum(axis=1))[: n // 2]
    if cov[0] <= 0.0:
        return 1.0
    times = 2.0 * np.cumsum(cov / cov[0]) - 1.0
    done = np.flatnonzero(np.arange(len(times)) >= 5.0 * times)
    return max(1.0, float(times[done[0] if len(done) else -1]))


def _verdict(unseen: Array, known: bool, highest_mass: float, used: int) -> tuple[Status, str]:
    if len(unseen):
        return "not-excited", _remedy(unseen)
    if not known:
        return "too-few", f"add poses, or give the sensor's noise: {used} leave no residual to tell it by"
    if highest_mass < 0.0:
        scale = "turn the sign of the wrench ([columns] wrench = {scale = -1}): "
        return "negative-mass", scale + "at rest in the air it is m·Rᵀ·g, the load on the tool"
    return "ok", ""


def _remedy(unseen: Array) -> str:
    """Poses, chosen one by one, in which gravity along an axis of the sensor shows most of what is hidden."""
    lifts, rest = _G * np.vstack([np.eye(3), -np.eye(3)]), np.zeros((6, 3))
    designs = _design(lifts, rest, rest, False) * _ROWS[:, None] * _COLUMNS[:10]
    poses = dict(zip(("+x", "+y", "+z", "-x", "-y", "-z"), designs))
    still, steps = unseen[:, :10], []
    while len(still):
        shown = {name: np.linalg.svd(pose @ still.T)[1:] for name, pose in poses.items()}
        best = max(shown, key=lambda k: (int((shown[k][0] > 0.3).sum()), float((shown[k][0] ** 2).sum())))
        found = int((shown[best][0] > 0.3).sum())
        if not found:
            break
        steps.append(f"the sensor's {best}")
        still = shown[best][1][found:] @ still
    said = [f"add poses in which gravity points along {', then '.join(steps)}"] if steps else []
    if not steps or np.abs(unseen[:, 10:]).max(initial=0.0) > 0.5:
        said.append("turn the tool faster, about each axis of the sensor")
    return "; ".join(said)


def _table(values: ArrayLike | None, width: int, name: str, n: int | None = None) -> Array:
    """The values as (n, width); zeros for those not given."""
    out = np.zeros((n or 0, width)) if values is None else np.asarray(values, dtype=float)
    if out.ndim != 2 or out.shape[1] != width or len(out) != (n or len(out)) or len(out) == 0:
        shape = f"shape ({n or 'n'}, {width})"
        raise InputError(f"{name} of shape {out.shape}", shape, "give one row a sample")
    return out


def _noise(values: ArrayLike) -> Array:
    out = np.asarray(values, dtype=float)
    if out.shape != (6,) or not (np.isfinite(out).all() and (out > 0).all()):
        raise InputError(f"a noise of {out.tolist()}", "six positive numbers [N, N·m]", "correct it")
    return out
