"""Time-domain passivity: an observer counts the energy that a port takes up, a controller pays what it gave too much.

(B. Hannaford, J.-H. Ryu, Time-domain passivity control of haptic interfaces, IEEE Trans. Robotics and Automation 18, 2002.)
The work of a held force over a period is exact, force times displacement, known one period later (J.-H. Ryu, C. Preusche,
B. Hannaford, G. Hirzinger, IEEE Trans. Control Systems Technology 13, 2005).
"""

from __future__ import annotations

from numba import njit

from kinid.errors import InputError


@njit(cache=True)
def pay(energy: float, speed_squared: float, period: float, most: float) -> float:
    """Damping [N·s/m] that takes a debt (−energy, where negative) back within one period, at most `most`.

    Args:
        energy: that the port took up so far [J]. speed_squared: [m²/s²]. period: [s].
        most: greatest damping; above 2 m/T a sampled damper makes a mass m overshoot.
    """
    if energy >= 0.0 or speed_squared <= 0.0:
        return 0.0
    return min(-energy / (speed_squared * period), most)


def check_period(period: float) -> None:
    """Refuse a period that isn't positive."""
    if not 0.0 < period < 1.0:
        raise InputError(f"a control period of {period} s", "between 0 and 1 s", "1 kHz is 0.001")
