"""A path of the tip as a spline of the joints over the length travelled: what a motion in time is laid on."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from kinid.planning.limits import Limits
from kinid.planning.reach import Reach
from kinid.planning.setpoint_timing import Pace

if TYPE_CHECKING:
    from scipy.interpolate import PPoly

Array = NDArray[np.float64]

#: poses along a path are solved so far apart [m]; joints bend over decimetres, so that a spline of fifth degree between
#: them is right to some 1e-9 rad
STEP = 0.008
#: a spline of fifth degree needs six points; more keep its ends calm
FEWEST = 9


@dataclass(frozen=True, eq=False)
class Course:
    """Joints q(s) over the length s from 0 to `length` [m].

    Attributes:
        length: [m]. nodes: where poses were solved, (k,). q: there, (k, N). slopes: largest |q′|, |q″|, |q‴| of each
            joint along the path, (3, N).
    """

    length: float
    nodes: Array
    q: Array
    slopes: Array = field(init=False)

    def __post_init__(self) -> None:
        from scipy.interpolate import make_interp_spline

        splines = [make_interp_spline(self.nodes, self.q, k=5)]
        splines += [splines[0].derivative(nu) for nu in (1, 2, 3)]
        object.__setattr__(self, "_splines", splines)
        fine = np.linspace(0.0, self.length, 4 * len(self.nodes))
        object.__setattr__(self, "slopes", np.stack([np.abs(s(fine)).max(axis=0) for s in splines[1:]]))

    @classmethod
    def through(cls, reach: Reach, nodes: Array, positions: Array, rotations: Array, start: Array, what: str) -> Course:
        """The course of poses at lengths `nodes`; arguments as in `Reach.along`."""
        return cls(float(nodes[-1]), nodes, reach.along(positions, rotations, start, what))

    def __call__(self, s: Array, ds: Array, dds: Array) -> tuple[Array, Array, Array]:
        """Joints, velocities and accelerations where the length and its derivatives are these, each (n, N)."""
        splines: list[PPoly] = self.__dict__["_splines"]
        s = np.clip(s, 0.0, self.length)
        bend, curl = splines[1](s), splines[2](s)
        return splines[0](s), bend * ds[:, None], bend * dds[:, None] + curl * (ds**2)[:, None]

    def jerk(self, s: Array, ds: Array, dds: Array, ddds: Array) -> Array:
        """Jerks of the joints, (n, N)."""
        splines: list[PPoly] = self.__dict__["_splines"]
        s = np.clip(s, 0.0, self.length)
        out: Array = (
            splines[1](s) * ddds[:, None] + 3.0 * splines[2](s) * (ds * dds)[:, None] + splines[3](s) * (ds**3)[:, None]
        )
        return out

    def pace(self, wanted: Pace, limits: Limits, share: float = 0.98) -> Pace:
        """The pace wanted, lowered until no joint can pass its limits along this course.

        q̇ = q′ṡ, q̈ = q′s̈ + q″ṡ², q⃛ = q′s⃛ + 3q″ṡs̈ + q‴ṡ³. The speed may spend half of the acceleration's and a
        quarter of the jerk's limit on the course's bends, the acceleration another quarter of the jerk's; what is left
        is for s̈ and s⃛.
        """
        first, second, third = self.slopes + 1e-12
        velocity, acceleration, jerk = (share * each for each in (limits.velocity, limits.acceleration, limits.jerk))
        v = min(
            wanted.speed,
            *(
                float(np.min(most))
                for most in (velocity / first, np.sqrt(0.5 * acceleration / second), np.cbrt(0.25 * jerk / third))
            ),
        )
        a = min(
            wanted.acceleration,
            float(np.min((acceleration - second * v**2) / first)),
            float(np.min(jerk / (12.0 * second * v))),
        )
        j = min(wanted.jerk, float(np.min((jerk - 3.0 * second * v * a - third * v**3) / first)))
        return Pace(v, a, j)


def line_nodes(length: float, step: float = STEP) -> Array:
    """Lengths at which poses of a straight path are solved."""
    return np.linspace(0.0, length, max(FEWEST, 1 + int(np.ceil(length / step))))
