"""Units that logs come in, and the factor to SI."""

from __future__ import annotations

import math

from kinid.errors import InputError, near

_DEG = math.pi / 180.0
_G = 9.80665  # standard gravity, CGPM 1901 [m/s²]

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
    "N": 1.0,
    "mN": 1e-3,
    "kN": 1e3,
    "kgf": _G,
    "gf": _G * 1e-3,
    "lbf": 4.4482216152605,
    "Nm": 1.0,
    "N·m": 1.0,
    "N.m": 1.0,
    "N*m": 1.0,
    "mNm": 1e-3,
    "Nmm": 1e-3,
    "N·mm": 1e-3,
    "kNm": 1e3,
    "lbf·in": 0.1129848290276167,
    "lbf-in": 0.1129848290276167,
    "lbf·ft": 1.3558179483314004,
    "lbf-ft": 1.3558179483314004,
    # electrical, for drives that log a current or a voltage; scaled to torque by `scale`
    "A": 1.0,
    "mA": 1e-3,
    "V": 1.0,
    "mV": 1e-3,
}


def factor(unit: str, where: str) -> float:
    """Factor that turns a value in `unit` into SI.

    Args:
        unit: a key of `FACTORS`.
        where: the place the unit stands, for the message.

    Raises:
        InputError: the unit is unknown.
    """
    try:
        return FACTORS[unit]
    except KeyError:
        raise InputError(f"unit '{unit}' in {where}", "a unit that kinid knows", near(unit, FACTORS)) from None
