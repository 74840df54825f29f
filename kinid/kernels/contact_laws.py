"""Contact laws: the force of a material on a tool inside it, of one sample or of many.

Effects, controllers and estimators take their laws from here; the virtual laboratory has laws of its own on purpose
(`kinid.lab`), so that it can prove something. Each law is linear in stiffness and damping: without damping it is the
elastic force, without stiffness the loss.
"""

from __future__ import annotations

from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

#: a number, or numbers over time (n,)
T = TypeVar("T", float, NDArray[np.float64])


def kelvin_voigt(depth: T, rate: T, stiffness: float, damping: float) -> T:
    """K x + B ẋ [N] of the depth x > 0 [m] and its rate ẋ [m/s]: K [N/m], B [N·s/m]. Without B it is Hooke's law.

    W. Thomson (Lord Kelvin), Proc. R. Soc. 14, 1865; W. Voigt, Ann. Phys. 283, 1892.
    """
    return stiffness * depth + damping * rate


def hunt_crossley(power: T, rate: T, stiffness: float, damping: float) -> T:
    """K xⁿ + B xⁿ ẋ [N] of the depth's power xⁿ [mⁿ], 0 outside, and its rate ẋ [m/s]: K [N/mⁿ], B [N·s/mⁿ⁺¹].

    K. H. Hunt, F. R. E. Crossley, J. Appl. Mech. 42, 1975, eq. 8.
    """
    return stiffness * power + damping * power * rate
