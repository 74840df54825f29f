"""Wave variables: a line that sends waves instead of motion and force gives no energy, whatever its delay.

With wave impedance b [N·s/m], velocity v and force F of a port

    u = (b v + F) / √(2b)   into the line          w = (b v − F) / √(2b)   out of it          F v = u²/2 − w²/2

(G. Niemeyer, J.-J. E. Slotine, Stable adaptive teleoperation, IEEE J. Oceanic Engineering 16, 1991). Both ends convert
what they get: the master renders F = b v − √(2b) w, the slave's set-point moves with v = √(2/b) u − F/b. A constant
delay stores what is on its way, and gives it back later; held force meets the spring b/T of the line.

Packets that come late, at uneven times or never may change the waves, but not to more energy than was sent: see
`reconstruct`. The work of a held force over a period is exact, so is that of a wave's mean over one at most.
"""

from __future__ import annotations

import numpy as np
from numba import njit


@njit(cache=True, error_model="numpy")
def reconstruct(total: float, energy: float, given: float, spent: float, periods: int, period: float) -> float:
    """The wave to play out over the next period, in √W.

    What is missing, the wave and its energy, is spread evenly over the periods up to the packet that is known. The mean
    of a wave has no more energy than the wave (Cauchy, Schwarz), so that a gap between two packets costs none; where
    the wave comes late and has to catch up, it is cut to the energy that was sent and has not come out (G. Niemeyer,
    J.-J. E. Slotine, Towards force-reflecting teleoperation over the Internet, ICRA 1998).

    Args:
        total, energy: integral of the wave that was sent up to a packet [√W·s], and its energy, ∫ u²/2 dt [J]. given,
            spent: the same of what has been played out. periods: to play out the rest in. period: [s].
    """
    wave = (total - given) / (periods * period)
    most = np.sqrt(2.0 * max(0.0, energy - spent) / (periods * period))
    return float(min(most, max(-most, wave)))
