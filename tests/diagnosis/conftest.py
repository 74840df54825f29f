"""Short logs of a material tester: what is in them is written here, on equations of its own."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.integrate import solve_ivp
from scipy.interpolate import CubicSpline

import kinid

Array = NDArray[np.float64]

RATE = 250.0
NOISE = 0.02
#: of a pressed material: stiffness [N/m], damping [N·s/m], friction
STIFFNESS, DAMPING, FRICTION = 800.0, 6.0, 0.4
#: share of the elastic force that decays, and in which time [s]
SHARE, DECAY = 0.3, 0.45


@dataclass(frozen=True, eq=False)
class Tester:
    """Motion of a tester: four touches of 4 s, each faster or deeper than the one before.

    Attributes:
        t, depth, rate, slip, slip_rate: (n,), slip along the first tangent. phase: of each sample.
    """

    t: Array
    depth: Array
    rate: Array
    slip: Array
    slip_rate: Array
    phase: NDArray[np.str_]

    def log(self, force: Array, rub: Array | None = None, seed: int = 0, phase: bool = True) -> kinid.Log:
        """What is recorded, noise included."""
        rng = np.random.default_rng(seed)
        contact = {"depth": self.depth.copy(), "normal_force": force + NOISE * rng.standard_normal(len(force))}
        if rub is not None:
            zero = np.zeros_like(force)
            contact |= {
                "slip1": self.slip.copy(),
                "slip2": zero,
                "tangential_force1": rub + NOISE * rng.standard_normal(len(force)),
                "tangential_force2": NOISE * rng.standard_normal(len(force)),
            }
        return kinid.Log(t=self.t.copy(), contact=contact, phase=self.phase if phase else None)

    def kelvin_voigt(self) -> Array:
        """A spring and a dashpot, which pulls when the tool leaves fast, as in the plain equation."""
        return np.where(self.depth > 0, STIFFNESS * self.depth + DAMPING * self.rate, 0.0)

    def relaxing(self) -> Array:
        """The same, and a share of the spring's force decays; solved to 1e-9 at steps of its own."""
        elastic = CubicSpline(self.t, STIFFNESS * np.maximum(self.depth, 0.0))
        flow = solve_ivp(
            lambda t, y: (elastic(t) - y) / DECAY,
            (self.t[0], self.t[-1]),
            [0.0],
            t_eval=self.t,
            rtol=1e-9,
            atol=1e-9,
            max_step=0.02,
        )
        spring = np.maximum(STIFFNESS * self.depth - SHARE * flow.y[0], 0.0)
        return np.where(self.depth > 0, spring + DAMPING * self.rate, 0.0)

    def rubbing(self, normal: Array, length: float = 1e-4) -> Array:
        """Coulomb's friction against the slip; its direction turns over a length [m] of slip, as on bristles."""
        state, out = 0.0, np.zeros_like(normal)
        for i in range(1, len(normal)):
            step = self.slip[i] - self.slip[i - 1]
            # dz = ds - |ds| z / L solved exactly for a step of constant direction
            way = np.sign(step)
            state = way + (state - way) * np.exp(-abs(step) / length) if step else state
            state = state if self.depth[i] > 0 else 0.0
            out[i] = -FRICTION * max(normal[i], 0.0) * state
        return out


def _moves() -> Tester:
    touch = 4.0
    knots, heights, names = [], [], []
    for k, (deep, fast) in enumerate([(2e-3, 0.25), (3e-3, 0.12), (2.5e-3, 0.4), (3.5e-3, 0.18)]):
        at = k * touch
        knots += [at, at + 0.4, at + 0.4 + fast, at + 2.0, at + 3.5, at + 3.5 + fast]
        heights += [-1e-3, -1e-3, deep, deep, deep, -1e-3]
        names += [
            (at, "free"),
            (at + 0.4, "approach"),
            (at + 0.4 + fast, "hold"),
            (at + 2.0, "slide"),
            (at + 3.5, "retract"),
            (at + 3.5 + fast, "free"),
        ]
    fine = np.arange(round(4 * touch * RATE)) / RATE
    from scipy.ndimage import gaussian_filter1d

    # corners rounded over 30 ms, so that the rate is the depth's derivative
    depth = gaussian_filter1d(np.interp(fine, knots, heights), 0.03 * RATE)
    within = fine % touch
    moving = (within > 2.0) & (within < 3.5)
    depth = depth + 0.4e-3 * np.where(moving, np.sin(2 * np.pi * 4.0 * (within - 2.0) / 1.5), 0.0)
    slip = np.where(moving, 4e-3 * np.sin(2 * np.pi * 2.0 * (within - 2.0) / 1.5), 0.0)
    starts, labels = zip(*names)
    phase = np.array(labels)[np.searchsorted(starts, fine, side="right") - 1]
    rate, slip_rate = (CubicSpline(fine, x)(fine, 1) for x in (depth, slip))
    return Tester(fine, depth, rate, slip, slip_rate, phase)


@pytest.fixture(scope="session")
def tester() -> Tester:
    return _moves()


@pytest.fixture(scope="session")
def relaxing_log(tester: Tester) -> kinid.Log:
    """Kelvin-Voigt and stress that relaxes, with friction; 16 s at 250 Hz."""
    force = tester.relaxing()
    return tester.log(force, tester.rubbing(force))
