"""Impedance whose stiffness along the surface's normal follows a map: the same push gives the same force everywhere."""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from kinid.controllers._given import is_number, is_positive
from kinid.controllers.cartesian import Impedance
from kinid.controllers.gains import GREATEST_STIFFNESS
from kinid.controllers.passivity import check_period
from kinid.controllers.properties import Plane, PropertyMap, checked_map, material_at
from kinid.controllers.state import ArmState, Target
from kinid.errors import InputError

if TYPE_CHECKING:
    from kinid.mapping.property_map import PropertyMap as Map

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Schedule:
    """How the arm's stiffness along the normal follows the environment's.

    Arm and environment are springs in series: a set-point a depth δ below the surface gives f = δ K_r K_e / (K_r +
    K_e). For the same κ = f/δ everywhere the arm needs K_r = κ K_e / (K_e − κ): soft on a hard material, stiff on a
    soft one.

    Args:
        series: κ [N/m]. least, most: bounds of K_r [N/m]; a material softer than κ gets the greatest.
        plane: where the map lies; default: where it was measured, else the base's plane z = 0.
        depth: at which a non-linear material's secant stiffness is taken [m].
        tank: energy that the stiffness may put into the spring at the start [J]; damping refills it up to this.
        period: of the controller [s].

    Raises:
        InputError: a number outside its range.
    """

    series: float = 500.0
    least: float = 200.0
    most: float = GREATEST_STIFFNESS
    plane: Plane | None = None
    depth: float = 2e-3
    tank: float = 0.1
    period: float = 1e-3

    def __post_init__(self) -> None:
        check_period(self.period)
        if not (is_number(self.least) and is_number(self.most) and 0.0 < self.least <= self.most <= GREATEST_STIFFNESS):
            raise InputError(
                f"a stiffness between {self.least} and {self.most} N/m",
                f"0 < least ≤ most ≤ {GREATEST_STIFFNESS:g}",
                "a negative stiffness is unstable",
            )
        if not isinstance(self.plane, Plane | None):
            raise InputError(
                f"plane {self.plane!r}", "Plane(point, axes)", "a mesh has no normal of its own to stiffen along"
            )
        for name in ("series", "depth", "tank"):
            if not is_positive(getattr(self, name)):
                raise InputError(f"{name} {getattr(self, name)}", "a positive number", "see the docstring of Schedule")

    def stiffness(self, environment: float) -> float:
        """K_r for an environment of stiffness K_e, both [N/m]."""
        if environment <= self.series:
            return self.most
        return float(np.clip(self.series * environment / (environment - self.series), self.least, self.most))


class AdaptiveImpedance:
    """`Impedance` with the normal stiffness of a schedule: `command(state)` once a period. It remembers its stiffness.

    A spring that stiffens while it is stretched gains ½ ΔK e² from nowhere. That energy comes from a tank which only
    damping fills (F. Ferraguti, C. Secchi, C. Fantuzzi, ICRA 2013); with an empty tank the stiffness waits.

    Args:
        base: the impedance whose normal stiffness is replaced; its other gains stay.
        surface: the map, or a measured one (`kinid.mapping.property_map.PropertyMap`) on a plane, whose unknown places
            then count as its hardest known: there the arm is softest. schedule: see there.

    Attributes:
        plane: where the map lies.

    Raises:
        InputError: no impedance, map or schedule, or stiffnesses along other axes than the surface's.
    """

    def __init__(self, base: Impedance, surface: PropertyMap | Map, schedule: Schedule | None = None) -> None:
        for name, given, kind in (("impedance", base, Impedance), ("schedule", schedule or Schedule(), Schedule)):
            if not isinstance(given, kind):
                raise InputError(f"{name} {str(given)[:40]!r}", f"{kind.__name__}(…)", "see its docstring")
        self.base, self.surface, self.schedule = base, checked_map(surface, "hardest"), schedule or Schedule()
        lies = self.schedule.plane or getattr(self.surface, "plane", Plane())
        if not isinstance(lies, Plane):
            raise InputError("a map on a mesh", "one on a plane", "a mesh has no normal of its own to stiffen along")
        self.plane = lies
        translation = base.gains.translation
        self._along = np.array(np.broadcast_to(translation, 3), dtype=float)
        if isinstance(translation, tuple) and not np.allclose(base.gains.axes.T, self.plane.axes):
            raise InputError(
                "three stiffnesses along axes that aren't the surface's",
                "axes whose columns are tangent1, tangent2, normal",
                "set Gains(axes=plane.axes.T)",
            )
        self.reset()

    def reset(self) -> None:
        """Forget the stiffness, and fill the tank."""
        self.tank, self._stiffness = self.schedule.tank, math.nan

    @property
    def stiffness(self) -> float:
        """K_r at the last command [N/m]; not a number before the first."""
        return self._stiffness

    def toward(self, target: Target | Impedance) -> None:
        """Follow another target, or that of another impedance, from now on; the gains stay the first's."""
        self.base = self.base.toward(target.target if isinstance(target, Impedance) else target)

    def check(self, state: ArmState, period: float | None = None) -> None:
        """Refuse a schedule whose softest or stiffest gains are unstable about a state; default: at its own period [s].

        Raises:
            InputError: see `Impedance.check`.
        """
        for stiffness in (self.schedule.least, self.schedule.most):
            self._with(stiffness).check(state, self.schedule.period if period is None else period)

    def _with(self, stiffness: float) -> Impedance:
        """The impedance with a stiffness along the normal."""
        along = (float(self._along[0]), float(self._along[1]), stiffness)
        gains = dataclasses.replace(self.base.gains, translation=along, axes=self.plane.axes.T)
        return dataclasses.replace(self.base, gains=gains)

    def command(self, state: ArmState) -> Array:
        """Joint torques [N·m], (N,)."""
        s = self.schedule
        material = material_at(self.surface, *self.plane.chart(state.position))
        wish = s.stiffness(material.stiffness * s.depth ** (material.exponent - 1.0))
        error = float(self.plane.axes[2] @ (self.base.target.position - state.position))
        if math.isnan(self._stiffness):
            self._stiffness = wish
        elif wish > self._stiffness:
            step = wish - self._stiffness
            if error != 0.0:
                step = min(step, 2.0 * self.tank / error**2)
            self._stiffness += step
            self.tank -= 0.5 * step * error**2
        else:  # a spring that softens loses energy; the tank takes none of it, to be on the safe side
            self._stiffness = wish
        controller = self._with(self._stiffness)
        damping = controller.damping(state)
        slip = self.base.target.velocity - state.twist
        self.tank = min(s.tank, max(0.0, self.tank) + s.period * float(slip @ damping @ slip))
        return controller.command(state)
