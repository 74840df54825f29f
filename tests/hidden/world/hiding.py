"""How each effect comes into a world of contact: which bases show it, what carries it, and how large it may be."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

#: what carries an effect: a setup with `matter`, `rub`, `chain` and its size → that setup with the effect in it
Put = Callable[[Any, float], Any]

LINEAR, POWER = ("hooke", "kelvin-voigt"), ("hertz", "hunt-crossley")


@dataclass(frozen=True)
class Plan:
    """One effect at work: `put` it into a setup at a size between `low` and `high`; `sign` is drawn before."""

    put: Put
    low: float
    high: float
    start: float


@dataclass(frozen=True)
class Hideable:
    """An effect that can be hidden: bases it is hidden behind, how it is drawn, and whether only slip or a wrench shows
    it.

    Attributes:
        draw: (rng, greatest depth [m], base) → plan.
        slip: needs tangential forces. family: effects of one family are not hidden together.
    """

    draw: Callable[[np.random.Generator, float, str], Plan]
    family: str
    bases: tuple[str, ...] = LINEAR + POWER
    slip: bool = False


def _matter(setup: Any, **changes: Any) -> Any:
    return dataclasses.replace(setup, matter=dataclasses.replace(setup.matter, **changes))


def _rub(setup: Any, **changes: Any) -> Any:
    return dataclasses.replace(setup, rub=dataclasses.replace(setup.rub, **changes))


def _chain(setup: Any, **changes: Any) -> Any:
    return dataclasses.replace(setup, chain=dataclasses.replace(setup.chain, **changes))


def _sign(rng: np.random.Generator) -> float:
    return float(rng.choice([-1.0, 1.0]))


def _log(rng: np.random.Generator, low: float, high: float) -> float:
    return float(np.exp(rng.uniform(np.log(low), np.log(high))))


def _power(rng: np.random.Generator, deep: float, base: str) -> Plan:
    n0 = {"hertz": 1.5}.get(base, 1.0)
    way = _sign(rng) if base == "hertz" else 1.0
    flat = float(rng.uniform(0.05, 0.3)) if base != "hertz" and rng.uniform() < 0.25 else 0.0
    most = 0.45 if base == "hertz" else 0.9
    return Plan(lambda s, x: _matter(s, profile=1.0 / max(n0 + way * x - 1.0, 1e-9), flat=flat), 0.005, most, 0.1)


def _relaxation(rng: np.random.Generator, deep: float, base: str) -> Plan:
    tau, second = _log(rng, 0.08, 2.5), rng.uniform() < 0.25
    shares = ((0.6, tau), (0.4, 2.2 * tau)) if second else ((1.0, tau),)
    return Plan(lambda s, x: _matter(s, arms=tuple((share * x, time) for share, time in shares)), 0.003, 0.6, 0.1)


def _layer(rng: np.random.Generator, deep: float, base: str) -> Plan:
    gap, blur = deep * rng.uniform(0.45, 0.75), _log(rng, 1e-5, 1e-4)
    return Plan(lambda s, x: _matter(s, second=x * s.matter.stiffness, gap=gap, gap_blur=blur), 0.01, 3.0, 0.3)


def _place(rng: np.random.Generator, deep: float, base: str) -> Plan:
    way = _sign(rng)
    if rng.uniform() < 0.3:
        angle = rng.uniform(0, 2 * np.pi)
        return Plan(lambda s, x: _matter(s, gradient=(x * np.cos(angle), x * np.sin(angle))), 0.5, 40.0, 5.0)
    x0, y0 = rng.uniform(-8e-3, 8e-3, 2)
    radius, width = rng.uniform(4e-3, 9e-3), rng.uniform(1.2e-3, 3e-3)
    return Plan(
        lambda s, x: _matter(s, inclusion=(way * x, x0, y0, radius, width)), 0.005, 0.6 if way < 0 else 1.5, 0.1
    )


def _softening(rng: np.random.Generator, deep: float, base: str) -> Plan:
    stretch, shape = rng.uniform(0.15, 0.6) * deep, rng.uniform(0.9, 1.3)
    return Plan(lambda s, x: _matter(s, fibres=x, fibre_stretch=stretch, fibre_shape=shape), 0.005, 0.6, 0.1)


def _hysteresis(rng: np.random.Generator, deep: float, base: str) -> Plan:
    length = _log(rng, 0.05, 0.35) * deep
    return Plan(lambda s, x: _matter(s, loop=x, loop_length=length), 0.003, 0.25, 0.05)


def _adhesion(rng: np.random.Generator, deep: float, base: str) -> Plan:
    length = rng.uniform(2e-4, 1e-3)
    return Plan(lambda s, x: _matter(s, glue=x, glue_length=length), 0.01, 2.0, 0.2)


def _offset(rng: np.random.Generator, deep: float, base: str) -> Plan:
    way = _sign(rng)
    return Plan(lambda s, x: _matter(s, offset=way * x), 8e-5, 0.3 * deep, 3e-4)


def _warming(rng: np.random.Generator, deep: float, base: str) -> Plan:
    way, tau = _sign(rng), rng.uniform(80, 400)
    return Plan(lambda s, x: _matter(s, warming=way * x, warming_time=tau), 0.005, 0.9, 0.1)


def _stribeck(rng: np.random.Generator, deep: float, base: str) -> Plan:
    speed = _log(rng, 7e-3, 2e-2)
    return Plan(lambda s, x: _rub(s, extra=x, extra_speed=speed), 0.005, 0.6, 0.1)


def _bristles(rng: np.random.Generator, deep: float, base: str) -> Plan:
    uneven = rng.uniform(0.1, 0.5)
    if rng.uniform() < 0.4:  # shorter ones, which turn all but at once
        return Plan(lambda s, x: _rub(s, turn=1e-4 * np.exp(-x), uneven=uneven), 0.2, 4.0, 1.0)
    return Plan(lambda s, x: _rub(s, turn=1e-4 + x, uneven=uneven), 5e-5, 2.5e-3, 3e-4)


def _load(rng: np.random.Generator, deep: float, base: str) -> Plan:
    if rng.uniform() < 0.4:
        return Plan(lambda s, x: _rub(s, area="plough", area_spread=x), 0.02, 0.9, 0.2)
    # the narrower the heights are spread, the more the area lags behind the load: size 1 has none at all
    return Plan(lambda s, x: _rub(s, area="asperities", area_spread=max(0.0, 1.0 / x - 1.0)), 0.1, 1.0, 0.5)


def _grooves(rng: np.random.Generator, deep: float, base: str) -> Plan:
    way = _sign(rng)
    return Plan(lambda s, x: _rub(s, flank=way * np.sqrt(x)), 0.003, 0.5, 0.1)


#: what a moment [N·m] weighs beside a force [N]: their channels' noise and load differ by about this
MOMENT = 0.04


def _units(setup: Any) -> Array:
    """Size of each channel of a setup: forces 1, moments less."""
    return np.where(np.arange(len(setup.noise)) < 3, 1.0, MOMENT)


def _mix(rng: np.random.Generator, deep: float, base: str) -> Plan:
    shape = rng.uniform(-1, 1, (6, 6)) * ~np.eye(6, dtype=bool)

    def put(s: Any, x: float) -> Any:
        units = _units(s)
        k = len(units)
        return _chain(s, mix=np.eye(k) + x * shape[:k, :k] * np.outer(units, 1 / units))

    return Plan(put, 0.002, 0.15, 0.02)


def _turned(rng: np.random.Generator, deep: float, base: str) -> Plan:
    way = rng.standard_normal(3) * [1, 1, 0.5]
    way /= np.linalg.norm(way)
    return Plan(lambda s, x: _chain(s, turned=x * way), 0.002, 0.2, 0.02)


def _bias(rng: np.random.Generator, deep: float, base: str) -> Plan:
    way = rng.uniform(0.4, 1.0, 6) * rng.choice([-1, 1], 6)
    return Plan(lambda s, x: _chain(s, bias=x * way[: len(s.noise)] * _units(s)), 0.03, 2.0, 0.1)


def _drift(rng: np.random.Generator, deep: float, base: str) -> Plan:
    way = rng.uniform(0.4, 1.0, 6) * rng.choice([-1, 1], 6)
    return Plan(lambda s, x: _chain(s, drift=x * way[: len(s.noise)] * _units(s)), 0.01, 2.0, 0.1)


def _lag(rng: np.random.Generator, deep: float, base: str) -> Plan:
    # one pole dominates: two alike, or a mean over a window, would be nearer to a pure delay
    split = rng.uniform(0.02, 0.15)
    return Plan(lambda s, x: _chain(s, poles=((1 - split) * x, split * x)), 1e-3, 0.03, 4e-3)


def _late(rng: np.random.Generator, deep: float, base: str) -> Plan:
    way = _sign(rng)
    return Plan(lambda s, x: _chain(s, late=way * x), 8e-4, 0.04, 4e-3)


def _hum(rng: np.random.Generator, deep: float, base: str) -> Plan:
    way = rng.uniform(0.3, 1.0, 6)
    return Plan(lambda s, x: _chain(s, hum=x * way[: len(s.noise)] * _units(s)), 0.004, 0.3, 0.02)


def _second_body(rng: np.random.Generator, deep: float, base: str) -> Plan:
    """A mass at the centre of the tool's own, of which the rig knows nothing."""

    def put(s: Any, x: float) -> Any:
        return dataclasses.replace(s, bodies=(*s.bodies, dataclasses.replace(s.bodies[0], mass=x)))

    return Plan(put, 2e-4, 0.5, 0.02)


def _moved_body(rng: np.random.Generator, deep: float, base: str) -> Plan:
    way = rng.standard_normal(3)
    way /= np.linalg.norm(way)

    def put(s: Any, x: float) -> Any:
        tool = s.bodies[0]
        return dataclasses.replace(s, bodies=(dataclasses.replace(tool, com=tuple(tool.com + x * way)), *s.bodies[1:]))

    return Plan(put, 5e-5, 0.03, 1e-3)


def _spread_body(rng: np.random.Generator, deep: float, base: str) -> Plan:
    """A tool whose mass is not in one point: that of a solid body of some shape, turned somehow."""
    from scipy.spatial.transform import Rotation

    extent = rng.uniform(0.3, 1.0, 3)
    turn = Rotation.random(random_state=int(rng.integers(2**31))).as_matrix()
    inertia = turn @ np.diag(extent.sum() - extent) @ turn.T

    def put(s: Any, x: float) -> Any:
        entries = tuple(x * inertia[[0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]])
        return dataclasses.replace(s, bodies=(dataclasses.replace(s.bodies[0], inertia=entries), *s.bodies[1:]))

    return Plan(put, 2e-5, 5e-3, 3e-4)


def _tip(rng: np.random.Generator, deep: float, base: str) -> Plan:
    way = rng.standard_normal(3) * [1, 1, 0.3]
    way /= np.linalg.norm(way)
    return Plan(lambda s, x: dataclasses.replace(s, tip_error=tuple(x * way)), 5e-5, 6e-3, 5e-4)


def _gain(rng: np.random.Generator, deep: float, base: str) -> Plan:
    way = _sign(rng)
    return Plan(lambda s, x: _chain(s, gain=way * x), 1e-3, 0.4, 0.02)


HIDEABLE: dict[str, Hideable] = {
    "hertz-exponent": Hideable(_power, "elastic", (*LINEAR, "hertz")),
    "stiffening-layer": Hideable(_layer, "elastic", (*LINEAR, "hertz")),
    "viscous-damping": Hideable(
        lambda r, d, b: Plan(lambda s, x: _matter(s, dashpot=x), 0.05, 20.0, 3.0), "loss", ("hooke", *POWER)
    ),
    "hunt-crossley-damping": Hideable(
        lambda r, d, b: Plan(lambda s, x: _matter(s, loss=x), 0.05, 15.0, 1.5), "loss", (*LINEAR, "hertz")
    ),
    "relaxation": Hideable(_relaxation, "memory"),
    "hysteresis": Hideable(_hysteresis, "memory"),
    "stress-softening": Hideable(_softening, "memory", LINEAR),
    "adhesion": Hideable(_adhesion, "adhesion"),
    "surface-offset": Hideable(_offset, "geometry"),
    "structural-compliance": Hideable(
        lambda r, d, b: Plan(lambda s, x: _matter(s, series=x), 5e-6, 4e-4, 4e-5), "elastic", ("hertz",)
    ),
    "stiffness-drift": Hideable(_warming, "drift"),
    "stiffness-inhomogeneity": Hideable(_place, "place", slip=True),
    "coulomb-friction": Hideable(
        lambda r, d, b: Plan(lambda s, x: _rub(s, mu=x), 0.01, 0.8, 0.2), "friction", slip=True
    ),
    "viscous-friction": Hideable(
        lambda r, d, b: Plan(lambda s, x: _rub(s, film=x), 0.2, 40.0, 4.0), "speed", slip=True
    ),
    "stribeck-friction": Hideable(_stribeck, "speed", slip=True),
    "presliding": Hideable(_bristles, "turn", slip=True),
    "load-dependent-friction": Hideable(_load, "load", slip=True),
    "friction-anisotropy": Hideable(_grooves, "direction", slip=True),
    "sensor-bias": Hideable(_bias, "sensor"),
    "sensor-drift": Hideable(_drift, "sensor"),
    "sensor-crosstalk": Hideable(_mix, "channels", slip=True),
    "sensor-misalignment": Hideable(_turned, "channels", slip=True),
    "sensor-lag": Hideable(_lag, "clock"),
    "time-offset": Hideable(_late, "clock"),
    "sensor-gain": Hideable(_gain, "gain"),
    "tool-mass": Hideable(_second_body, "tool"),
    "tool-com": Hideable(_moved_body, "tool"),
    "tool-inertia": Hideable(_spread_body, "tool"),
    "tip-offset": Hideable(_tip, "geometry"),
    "mains-hum": Hideable(_hum, "mark"),
    "saturation": Hideable(
        lambda r, d, b: Plan(lambda s, x: _chain(s, limit=(1.0 - x) * s.peak), 0.02, 0.6, 0.3), "mark"
    ),
    "quantization": Hideable(lambda r, d, b: Plan(lambda s, x: _chain(s, step=x * _units(s)), 0.02, 0.5, 0.1), "mark"),
}
