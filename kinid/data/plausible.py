"""What a number in a rig can be at all: bounds far beyond any robot, so that what breaks them is a slip of the pen."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pydantic_core import PydanticCustomError

from kinid.units import TORQUES

#: lightest tool that has a mass at all, and the heaviest [kg]; largest bias [N, N·m], largest factor of a column
LIGHTEST, HEAVIEST, MOST_BIAS, MOST_SCALE = 1e-6, 1000.0, 1e5, 1e9
#: largest coordinate of a point [m] and largest offset of a column, in SI
FARTHEST, MOST_OFFSET = 1e3, 1e9
#: standard deviations of a surface along its normal [m] and in its tilt [rad]: of one that is known no better, the log
#: tells no depth
LOOSEST, MOST_TILTED = 1.0, 1.0
#: how well a sensor's gain is known, at worst
LOOSEST_GAIN = 0.5
#: between two clocks, one of which may count from 1970 [s]
MOST_CLOCK = 1e10
#: of gravity, from the Moon's to beyond Jupiter's [m/s²]
GRAVITY = (1.0, 30.0)
#: largest radius of gyration of a tool about its com [m]
WIDEST = 2.0
#: how far cross-talk may be from the identity: forces by forces and moments by moments, forces by moments [1/m], and
#: moments by forces [m]
MIXED, MIXED_FORCES, MIXED_MOMENTS = 0.5, 50.0, 0.5
#: softest structure [m/N]: an arm that yields by a centimetre under a newton is none
SOFTEST = 0.01
#: a compliance is symmetric (Maxwell and Betti) but for its estimate's error, as a share of its largest entry
ASYMMETRY = 0.1
#: kinds of units by quantity of the log format; a drive's current or voltage stands for a torque
ANGLE = ("rad", "deg", "mrad", "rev")
ANGLE_RATE = ("rad/s", "deg/s", "rpm")
ANGLE_ACCELERATION = ("rad/s^2", "deg/s^2")
LENGTH = ("m", "dm", "cm", "mm", "um", "µm", "in")
SPEED = ("m/s", "cm/s", "mm/s", "um/s", "µm/s")
ACCELERATION = ("m/s^2", "mm/s^2", "g")
TIME = ("s", "ms", "us", "µs", "ns", "min", "h")
FORCE = ("N", "mN", "kN", "kgf", "gf", "lbf")
TORQUE = tuple(sorted(TORQUES, key=lambda name: "·" in name))
ELECTRIC = ("A", "mA", "V", "mV")
#: of a joint's quantities, where it turns and where it slides
TURNS_OR_SLIDES = {
    "q": (ANGLE, LENGTH),
    "q_cmd": (ANGLE, LENGTH),
    "dq": (ANGLE_RATE, SPEED),
    "ddq": (ANGLE_ACCELERATION, ACCELERATION),
    "tau": (TORQUE, FORCE),
}
KINDS: dict[str, tuple[str, ...]] = {
    "t": TIME,
    **{name: turns + slides for name, (turns, slides) in TURNS_OR_SLIDES.items()},
    "tau": TORQUE + FORCE + ELECTRIC,
    "wrench": FORCE + TORQUE + ELECTRIC,
    **dict.fromkeys(("fx", "fy", "fz", "normal_force", "tangential_force1", "tangential_force2"), FORCE + ELECTRIC),
    **dict.fromkeys(("tx", "ty", "tz"), TORQUE + ELECTRIC),
    **dict.fromkeys(("depth", "slip1", "slip2"), LENGTH),
    **dict.fromkeys(("depth_rate", "slip_rate1", "slip_rate2"), SPEED),
}


def no_truth_values(value: object) -> object:
    """Refuse true and false where a number belongs: pydantic would read them as 1 and 0."""
    if isinstance(value, dict):
        for name, part in value.items():
            if _holds_truth(part):
                raise PydanticCustomError("number", "no true or false in '{name}'", {"name": str(name)})
    return value


def _holds_truth(value: object) -> bool:
    return isinstance(value, bool) or (isinstance(value, list | tuple) and any(_holds_truth(part) for part in value))


def gravity(values: tuple[float, ...]) -> tuple[float, ...]:
    """Gravity of a length that a robot lives in."""
    if not GRAVITY[0] <= math.hypot(*values) <= GRAVITY[1]:
        raise PydanticCustomError(
            "gravity", "a gravity of about 9.81 m/s², in the base frame: [0, 0, -9.81] for an upright arm"
        )
    return values


def mass(value: float) -> float:
    """A mass that a tool has, or 0."""
    if 0.0 < value < LIGHTEST:
        raise PydanticCustomError("mass", "a mass in kg, 0 or {least} at least", {"least": f"{LIGHTEST:g}"})
    return value


def inertia(mass: float, matrix: NDArray[np.float64]) -> None:
    """Refuse an inertia about the com that no body of this mass has; estimates are never perfect, so what is refused
    is clearly none's.
    """
    moments = np.linalg.eigvalsh(matrix)
    largest = float(np.abs(moments).max())
    if moments[0] < -0.05 * largest or moments[2] > 1.25 * (moments[0] + moments[1]) + 1e-12:
        raise PydanticCustomError(
            "inertia",
            "an inertia that a body can have: moments positive, none above the others' sum",
            {"field": "inertia"},
        )
    if largest > mass * WIDEST**2 > 0.0:
        raise PydanticCustomError(
            "inertia",
            "an inertia in kg·m² of a tool of {mass} kg that is no wider than {widest} m: {most} kg·m² at most",
            {"field": "inertia", "mass": f"{mass:g}", "widest": f"{2 * WIDEST:g}", "most": f"{mass * WIDEST**2:.3g}"},
        )


def crosstalk(rows: tuple[tuple[float, ...], ...]) -> tuple[tuple[float, ...], ...]:
    """Cross-talk that a sensor has: invertible, and each entry near the identity's."""
    mixing = np.abs(np.asarray(rows) - np.eye(6))
    most = np.kron([[MIXED, MIXED_FORCES], [MIXED_MOMENTS, MIXED]], np.ones((3, 3)))
    if not (mixing <= most).all() or np.linalg.cond(np.asarray(rows)) > 1e6:
        raise PydanticCustomError(
            "invertible",
            "an invertible matrix near the identity: within {like} of it for forces by forces and moments by moments, "
            "{forces} 1/m for forces by moments, {moments} m for moments by forces",
            {"like": MIXED, "forces": f"{MIXED_FORCES:g}", "moments": MIXED_MOMENTS},
        )
    return rows


def inside_range(words: str, values: tuple[float, ...] | None, most: tuple[float, ...] | None) -> None:
    """Refuse what a sensor states of itself and its own range doesn't hold."""
    if values is not None and most is not None and any(abs(v) > m for v, m in zip(values, most)):
        raise PydanticCustomError(
            "range",
            "a {words} within the sensor's range of {most}, in N and N·m",
            {"field": words, "words": words, "most": f"[{', '.join(f'{m:g}' for m in most)}]"},
        )


def compliance(rows: tuple[tuple[float, ...], ...]) -> tuple[tuple[float, ...], ...]:
    """A structure that yields along the force and no further than any arm does."""
    matrix = np.asarray(rows)
    if np.abs(matrix - matrix.T).max() > ASYMMETRY * np.abs(matrix).max():
        raise PydanticCustomError(
            "compliance", "a symmetric compliance in m/N: what a force along x moves along y, one along y moves along x"
        )
    moments = np.linalg.eigvalsh(0.5 * (matrix + matrix.T))
    if moments[0] < -1e-3 * max(abs(moments[-1]), 1e-12) or moments[-1] > SOFTEST:
        raise PydanticCustomError(
            "compliance",
            "a compliance in m/N, not negative and below {most}: 1 / stiffness, 1e-5 for 100 kN/m",
            {"most": SOFTEST},
        )
    return rows


def within(most: float, words: str) -> Any:
    """A validator of numbers or tuples of them that none is beyond a size."""

    def check(value: Any) -> Any:
        numbers = value if isinstance(value, tuple) else (value,)
        if not all(abs(number) <= most for number in numbers):
            raise PydanticCustomError("size", "{words} within ±{most}", {"words": words, "most": f"{most:g}"})
        return value

    return check


def kind_of_unit(quantity: str, unit: str | None, scaled: bool) -> None:
    """Refuse a unit of another kind than its quantity's; "1" goes with anything.

    Args:
        quantity, unit: as the rig says. scaled: whether it says a scale, too.
    """
    stem = quantity if quantity in KINDS else quantity.rstrip("0123456789")
    if unit is not None and unit != "1" and stem in KINDS and unit not in KINDS[stem]:
        raise PydanticCustomError(
            "kind",
            "a unit of {name}, as {known}; '{unit}' is one of another quantity",
            {"name": quantity, "known": ", ".join(u for u in KINDS[stem] if "·" not in u), "unit": unit},
        )
    if unit in ELECTRIC and stem != "tau" and stem in KINDS and not scaled:
        raise PydanticCustomError(
            "kind", "newtons or newton metres in one {unit}, as {name}.scale", {"name": quantity, "unit": unit}
        )
