"""Units that logs come in, and the factor to SI."""

from __future__ import annotations

import math
import re

from kinid.errors import InputError, near

_DEG = math.pi / 180.0
_G = 9.80665  # standard gravity, CGPM 1901 [m/s²]

#: newtons in a unit of force, and metres in the lengths of a torque
_FORCES = {"N": 1.0, "mN": 1e-3, "kN": 1e3, "kgf": _G, "gf": _G * 1e-3, "lbf": 4.4482216152605}
_ARMS = {"m": 1.0, "cm": 1e-2, "mm": 1e-3, "in": 0.0254, "ft": 0.3048}
#: torques by name, the products with a point between them; N·m, kN·mm … are written without one, too
TORQUES = {f"{force}·{arm}": _FORCES[force] * _ARMS[arm] for force in _FORCES for arm in _ARMS}
TORQUES |= {f"{force}{arm}": TORQUES[f"{force}·{arm}"] for force in ("N", "mN", "kN") for arm in ("m", "cm", "mm")}
#: signs that stand for the point of a product; other signs, and how they are written here
_TIMES = re.compile(r"(?<=[a-zA-Z])\s*[·⋅∙×*.\s-]\s*(?=[a-zA-Z])")
_SIGNS = str.maketrans({"²": "^2", "°": "deg", "μ": "µ"})

#: what parameters of effects come in: a product and quotient of powers of SI units, and of the minute; exponents may be
#: a parameter of the law
SI = re.compile(r"1?((^|[·/(])(kg|N|m|s|min|rad|A|V|Hz)(²|³|\^(\d+(\.\d+)?|n|\(n\+1\)))?\)?)*")

#: factor to SI by unit name
FACTORS: dict[str, float] = {
    "1": 1.0,
    # time
    "s": 1.0,
    "ms": 1e-3,
    "us": 1e-6,
    "µs": 1e-6,
    "ns": 1e-9,
    "min": 60.0,
    "h": 3600.0,
    # length and speed
    "m": 1.0,
    "dm": 0.1,
    "cm": 1e-2,
    "mm": 1e-3,
    "um": 1e-6,
    "µm": 1e-6,
    "in": 0.0254,
    "m/s": 1.0,
    "cm/s": 1e-2,
    "mm/s": 1e-3,
    "um/s": 1e-6,
    "µm/s": 1e-6,
    "m/s^2": 1.0,
    "mm/s^2": 1e-3,
    "g": _G,
    # angle
    "rad": 1.0,
    "deg": _DEG,
    "mrad": 1e-3,
    "rev": 2 * math.pi,
    "rad/s": 1.0,
    "deg/s": _DEG,
    "rpm": 2 * math.pi / 60.0,
    "rad/s^2": 1.0,
    "deg/s^2": _DEG,
    # force and torque
    **_FORCES,
    **TORQUES,
    # electrical, for drives that log a current or a voltage; scaled to torque by `scale`
    "A": 1.0,
    "mA": 1e-3,
    "V": 1.0,
    "mV": 1e-3,
}


def canonical(unit: str) -> str:
    """A unit's name as `FACTORS` has it, where it is one in other signs: N*mm, N mm or N-mm is N·mm, m/s² is m/s^2."""
    plain = _TIMES.sub("·", unit.strip().translate(_SIGNS))
    return plain if plain in FACTORS else unit


def factor(unit: str, where: str) -> float:
    """Factor that turns a value in `unit` into SI.

    Args:
        unit: a key of `FACTORS`, in these signs or in others.
        where: the place the unit stands, for the message.

    Raises:
        InputError: the unit is unknown.
    """
    try:
        return FACTORS[canonical(unit)]
    except KeyError:
        raise InputError(f"unit '{unit}' in {where}", "a unit that kinid knows", near_units(unit)) from None


def near_units(unit: str) -> str:
    """For a message: the units that are meant, or all of them; of torques those without a point."""
    return near(unit, [name for name in FACTORS if "·" not in name], limit=len(FACTORS))
