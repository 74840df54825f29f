"""Haptic rendering of a property map: a proxy on the surface, a contact law below it, a friction cone along it.

The proxy is the place where the device would be if the surface were hard (C. Zilles, K. Salisbury, A constraint-based
god-object method for haptic display, IROS 1995): on a plane, the device's foot. Friction holds it back: while the spring
between proxy and device pulls less than μ f_n the proxy sticks, else it follows on the cone (W. S. Harwin, N. Melder,
EuroHaptics 2002).
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from kinid.controllers.passivity import check_period, pay
from kinid.controllers.properties import Plane, Properties, PropertyMap
from kinid.controllers.state import ArmState
from kinid.errors import InputError

Array = NDArray[np.float64]


class ContactLaw(ABC):
    """How a material pushes back."""

    @abstractmethod
    def force(self, depth: float, rate: float, material: Properties) -> float:
        """Normal force [N] at a depth > 0 [m] and its rate [m/s], never negative."""


class Hooke(ContactLaw):
    """f = K x."""

    def force(self, depth: float, rate: float, material: Properties) -> float:
        """See the class."""
        return material.stiffness * depth


class KelvinVoigt(ContactLaw):
    """f = K x + B ẋ, cut off where it would pull."""

    def force(self, depth: float, rate: float, material: Properties) -> float:
        """See the class."""
        return max(0.0, material.stiffness * depth + material.damping * rate)


class HuntCrossley(ContactLaw):
    """f = K xⁿ + B xⁿ ẋ, cut off where it would pull (K. H. Hunt, F. R. E. Crossley, J. Applied Mechanics 42, 1975)."""

    def force(self, depth: float, rate: float, material: Properties) -> float:
        """See the class."""
        power = float(depth**material.exponent)
        return max(0.0, power * (material.stiffness + material.damping * rate))


class Rendered(NamedTuple):
    """One period of rendering, base axes.

    force: on the device and the hand, (3,) [N]. proxy: (3,) [m]. depth: of the device below the surface [m], ≥ 0.
    sliding: whether the proxy follows on the friction cone. added_damping: by the passivity controllers, along the normal
    and along the surface [N·s/m]. energy: that the rendered material took up in this touch, along the normal and along
    the surface [J]; negative is a debt, older ones included, that is being paid.
    """

    force: Array
    proxy: Array
    depth: float
    sliding: bool
    added_damping: tuple[float, float]
    energy: tuple[float, float]

    def torques(self, jacobian: Array) -> Array:
        """Joint torques of the device or arm that render the force at its tip, Jᵀ f, (N,).

        Args:
            jacobian: of the tip, linear rows first, base axes, (3, N) or (6, N).
        """
        return np.asarray(jacobian[:3].T @ self.force)


@dataclass(frozen=True, eq=False)
class HapticSettings:
    """How a map is rendered.

    Args:
        law: contact law along the normal. plane: where the map lies.
        shear: spring between device and proxy along the surface [N/m]; 0 renders no friction.
        period: of the loop [s]. force_limit: of the device [N]; the force is shortened to it.
        most_damping: the passivity controller's greatest [N·s/m], below 2 m/T of the device; 0 switches it off.

    Raises:
        InputError: a number outside its range.
    """

    law: ContactLaw = field(default_factory=KelvinVoigt)
    plane: Plane = field(default_factory=Plane)
    shear: float = 500.0
    period: float = 1e-3
    force_limit: float = np.inf
    most_damping: float = 20.0

    def __post_init__(self) -> None:
        check_period(self.period)
        for name in ("shear", "most_damping"):
            value = getattr(self, name)
            if not (np.isfinite(value) and value >= 0):
                raise InputError(f"{name} {value}", "a finite number that isn't negative", "a negative one gives energy")
        if not self.force_limit > 0:
            raise InputError(f"force_limit {self.force_limit}", "a positive number [N]", "take it from the device's data sheet")


class HapticRendering:
    """Renders a map at a fixed rate: `command(position, velocity)` once a period. It remembers proxy and energy.

    A held force lags by half a period and gives energy (J. E. Colgate, J. M. Brown, ICRA 1994: passive if the device's own
    damping b > K T/2 + B), and so does a map whose stiffness changes below a finger that moves along it. Passivity
    controllers take both back, one along the normal and one along the surface, so that friction's losses don't excuse a
    spring's gains. When a touch ends nothing is stored any more: what it dissipated is forgotten, what it owes stays.
    They hold as long as `most_damping` can pay what a touch owes, at most `most_damping` · speed · way.

    Args:
        surface: the map. settings: see `HapticSettings`.
    """

    def __init__(self, surface: PropertyMap, settings: HapticSettings | None = None) -> None:
        self.surface, self.settings = surface, settings or HapticSettings()
        self.reset()

    def reset(self) -> None:
        """Forget proxy and energy."""
        self._anchor: Array | None = None
        self._before: tuple[Array, Array] | None = None
        self._energy = np.zeros(2)

    def needed_damping(self, x: float, y: float) -> float:
        """Device damping b [N·s/m] above which a linear material there is passive without the controller: K T/2 + B."""
        material = self.surface.properties(x, y).checked(f"the map at ({x:g}, {y:g}) m")
        return 0.5 * material.stiffness * self.settings.period + material.damping

    def command(self, position: Array, velocity: Array) -> Rendered:
        """The force for a device at a position with a velocity, (3,) each, base axes [m], [m/s].

        Raises:
            InputError: a place of the map without usable properties, or a position that isn't finite.
        """
        position, velocity = np.asarray(position, dtype=float), np.asarray(velocity, dtype=float)
        if not (np.isfinite(position).all() and np.isfinite(velocity).all()):
            raise InputError("a device position or velocity that isn't finite", "numbers", "check the device's driver")
        s = self.settings
        if self._before is not None:
            work = (s.plane.axes @ self._before[0]) * (s.plane.axes @ (position - self._before[1]))
            self._energy -= [work[2], work[0] + work[1]]
        local, speed = s.plane.local(position), s.plane.axes @ velocity
        depth, force = -float(local[2]), np.zeros(3)
        sliding, extra = False, (0.0, 0.0)
        if depth <= 0.0:
            self._anchor, proxy = None, local
            self._energy = np.minimum(self._energy, 0.0)
        else:
            anchor = local[:2] if self._anchor is None else self._anchor
            x, y = float(anchor[0]), float(anchor[1])
            material = self.surface.properties(x, y).checked(f"the map at ({x:g}, {y:g}) m")
            force[2] = s.law.force(depth, -float(speed[2]), material)
            if s.shear > 0.0:
                stretch = local[:2] - anchor
                most = material.friction * force[2] / s.shear
                size = float(np.hypot(*stretch))
                sliding = size > most
                if sliding:
                    stretch = stretch * (most / size)
                force[:2] = -s.shear * stretch
                anchor = local[:2] - stretch
            else:
                anchor = local[:2]
            self._anchor = np.array(anchor)
            along = float(speed[0] ** 2 + speed[1] ** 2)
            extra = (pay(self._energy[0], float(speed[2] ** 2), s.period, s.most_damping),
                     pay(self._energy[1], along, s.period, s.most_damping))  # fmt: skip
            force -= speed * [extra[1], extra[1], extra[0]]
            proxy = np.array([anchor[0], anchor[1], 0.0])
        size = float(np.linalg.norm(force))
        if size > s.force_limit:
            force = force * (s.force_limit / size)
        force = s.plane.axes.T @ force
        self._before = (force, position.copy())
        return Rendered(force, s.plane.point + s.plane.axes.T @ proxy, max(depth, 0.0), sliding, extra,
                        (float(self._energy[0]), float(self._energy[1])))  # fmt: skip

    def torques(self, state: ArmState) -> Array:
        """Joint torques of an arm that is the device: weight held, map rendered at its tip, (N,); not clipped."""
        rendered = self.command(state.position, state.twist[:3])
        return np.asarray(state.gravity + rendered.torques(state.jacobian))
