"""What injectors share: their type, a random sign, and the load that is to be expected."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from kinid.lab.setup import Setup

Array = NDArray[np.float64]
Truth = dict[str, object]
#: a set-up with one more effect, and the effect's parameters
Injected = tuple[Setup, Truth]
Injector = Callable[[Setup, np.random.Generator], Injected]


def sign(rng: np.random.Generator) -> float:
    return float(rng.choice([-1.0, 1.0]))


def load(setup: Setup) -> tuple[float, float]:
    """Greatest depth that is asked for [m], and the force there [N]."""
    depth = max(1e-3, float(setup.script.place[:, 2].max()))
    stiffness = float(setup.material.at(np.zeros(1), np.zeros(1))["stiffness"][0])
    return depth, stiffness * depth**setup.material.exponent
