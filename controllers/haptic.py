"""Haptic rendering of a property map: a proxy on the surface, a contact law below it, a friction cone along it.

The proxy is the place where the device would be if the surface were hard (C. Zilles, K. Salisbury, A constraint-based
god-object method for haptic display, IROS 1995): on a plane, the device's foot; on a mesh see
`kinid.controllers.mesh_surface`. Friction holds it back: while the spring between proxy and device pulls less than μ
f_n the proxy sticks, else it follows on the cone (W. S. Harwin, N. Melder, EuroHaptics 2002).
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from kinid.controllers._given import closest, is_number, is_positive, numbers
from kinid.controllers.passivity import SPRING, Observer, Passivity, check_period
from kinid.controllers.properties import Plane, Properties, PropertyMap, Touchable, checked_map, material_at
from kinid.controllers.state import ArmState
from kinid.errors import InputError
from kinid.kernels import contact_laws

if TYPE_CHECKING:
    from kinid.mapping.property_map import PropertyMap as Map

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
        return contact_laws.kelvin_voigt(depth, rate, material.stiffness, 0.0)


class KelvinVoigt(ContactLaw):
    """f = K x + B ẋ, cut off where it would pull."""

    def force(self, depth: float, rate: float, material: Properties) -> float:
        """See the class."""
        return max(0.0, contact_laws.kelvin_voigt(depth, rate, material.stiffness, material.damping))


class HuntCrossley(ContactLaw):
    """f = K xⁿ + B xⁿ ẋ, cut off where it would pull (K. H. Hunt, F. R. E. Crossley, J. Applied Mechanics 42, 1975)."""

    def force(self, depth: float, rate: float, material: Properties) -> float:
        """See the class."""
        power = float(depth**material.exponent)
        return max(0.0, contact_laws.hunt_crossley(power, rate, material.stiffness, material.damping))


class Rendered(NamedTuple):
    """One period of rendering, base axes.

    force: on the device and the hand, (3,) [N]. proxy: (3,) [m]. depth: of the device below the surface [m], ≥ 0.
    sliding: whether the proxy follows on the friction cone. added_damping [N·s/m], share of the law's force that is
    rendered, and energy [J] are of the passivity controllers, along the normal and along the surface. An observer's
    energy is what the material took up in this touch; negative is a debt, older ones included, that is being paid. A
    tank's is what it holds.
    limited: whether the law asked for more than the device's mass bears at this period, and was softened.
    """

    force: Array
    proxy: Array
    depth: float
    sliding: bool
    added_damping: tuple[float, float]
    share: tuple[float, float]
    energy: tuple[float, float]
    limited: bool = False

    def torques(self, jacobian: Array) -> Array:
        """Joint torques of the device or arm that render the force at its tip, Jᵀ f, (N,).

        Args:
            jacobian: of the tip, linear rows first, base axes, (3, N) or (6, N).
        """
        jacobian = np.asarray(jacobian)
        if jacobian.ndim != 2 or len(jacobian) not in (3, 6):
            raise InputError(f"a Jacobian of shape {jacobian.shape}", "(3, N) or (6, N)", "give linear rows first")
        return np.asarray(jacobian[:3].T @ self.force)


@dataclass(frozen=True, eq=False)
class HapticSettings:
    """How a map is rendered.

    Args:
        law: contact law along the normal; default: Kelvin-Voigt, and of a measured map with an exponent Hunt-Crossley.
        surface: where the map lies: a plane or a mesh; default: where it was measured, else the base's plane z = 0.
        shear: spring between device and proxy along the surface [N/m]; 0 renders no friction.
        period: of the loop [s]. force_limit: of the device [N]; the force is shortened to it.
        passivity: what keeps the rendered material from giving energy.
        mass: m, the least that moves with the device along any direction [kg]: laws are softened to the `most_damping`
            and `most_stiffness` that it bears, and `Rendered.limited` says when. Default: 50 g, a stylus; a heavier one
            bears more.

    Raises:
        InputError: a number outside its range, or a shear spring that such a mass doesn't bear.
    """

    law: ContactLaw | None = None
    surface: Touchable | None = None
    shear: float = 500.0
    period: float = 1e-3
    force_limit: float = np.inf
    passivity: Passivity = field(default_factory=Observer)
    mass: float = 0.05

    def __post_init__(self) -> None:
        check_period(self.period)
        for name, kind in (("law", ContactLaw), ("passivity", Passivity)):
            given, known = getattr(self, name), [f"{each.__name__}()" for each in kind.__subclasses__()]
            if not isinstance(given, kind) and not (name == "law" and given is None):
                raise InputError(f"{name} {given!r}", f"one of {', '.join(known)}", closest(given, known))
        if self.surface is not None and (isinstance(self.surface, type) or not isinstance(self.surface, Touchable)):
            raise InputError(f"surface {self.surface!r}", "a plane or a mesh", "use Plane() or MeshSurface(mesh)")
        if not (is_number(self.shear) and self.shear >= 0):
            raise InputError(
                f"shear {self.shear}", "a finite number that isn't negative", "a negative one gives energy"
            )
        if not is_positive(self.force_limit, or_infinite=True):
            raise InputError(
                f"force_limit {self.force_limit}", "a positive number [N]", "take it from the device's data sheet"
            )
        if not is_positive(self.mass):
            raise InputError(f"mass {self.mass}", "a positive number [kg]", "weigh what moves with the device")
        if self.shear > self.most_stiffness:
            raise InputError(
                f"a shear spring of {self.shear:g} N/m on {self.mass:g} kg at a period of {self.period:g} s",
                f"at most {self.most_stiffness:g} N/m",
                "lower shear, or state the device's mass",
            )

    @property
    def most_damping(self) -> float:
        """m/T: a held damper above 2 m/T turns the device's motion round and grows; at m/T it stops it [N·s/m]."""
        return self.mass / self.period

    @property
    def most_stiffness(self) -> float:
        """A tenth of m/T², but no more than the passivity controller can make up for [N/m].

        A spring held for T is a damper of −K T/2. At a tenth of m/T² it gives half of a touch's energy at most, ½ π ω T
        with ω² = K/m, before the controller knows; and that can pay while K T/2 is well below its own damping.
        """
        paid = getattr(self.passivity, "most_damping", 0.0) or np.inf
        return float(min(SPRING * self.mass / self.period**2, paid / self.period))


class HapticRendering:
    """Renders a map at a fixed rate: `command(position, velocity)` once a period. It remembers proxy and energy.

    A held force lags by half a period and gives energy (J. E. Colgate, J. M. Brown, ICRA 1994: passive if the device's
    own damping b > K T/2 + B), and so does a map whose stiffness changes below a finger that moves along it. Passivity
    controllers see to both, one along the normal and one along the surface, so that friction's losses don't excuse a
    spring's gains; see `kinid.controllers.passivity`.

    Args:
        materials: the map, or a measured one (`kinid.mapping.property_map.PropertyMap`), whose unknown places are then
            rendered as its softest known; see `Measured` for another choice. settings: see `HapticSettings`.

    Attributes:
        law, surface: that are rendered: those of the settings, else the map's.

    Raises:
        InputError: no map, or settings of another kind.
    """

    def __init__(self, materials: PropertyMap | Map, settings: HapticSettings | None = None) -> None:
        if not isinstance(settings, HapticSettings | None):
            raise InputError(f"settings {settings!r}", "HapticSettings(…)", "see its docstring")
        self.materials, self.settings = checked_map(materials), settings or HapticSettings()
        self.surface: Touchable = self.settings.surface or getattr(self.materials, "surface", None) or Plane()
        powers = "exponent" not in getattr(self.materials, "absent", ("exponent",))
        self.law: ContactLaw = self.settings.law or (HuntCrossley() if powers else KelvinVoigt())
        self.reset()

    def reset(self) -> None:
        """Forget proxy and energy."""
        s = self.settings
        self._tracker = self.surface.tracker()
        self._along, self._across = s.passivity.open(s.period), s.passivity.open(s.period)
        self._anchor: Array | None = None
        #: parts of the last force, along the normal and along the surface, and where it was rendered
        self._before: tuple[Array, Array, Array] | None = None

    def needed_damping(self, x: float, y: float) -> float:
        """Device damping b [N·s/m] above which a linear material there is passive without the controller: K T/2 + B."""
        material = material_at(self.materials, x, y)
        return 0.5 * material.stiffness * self.settings.period + material.damping

    def command(self, position: Array, velocity: Array) -> Rendered:
        """The force for a device at a position with a velocity, (3,) each, base axes [m], [m/s].

        Raises:
            InputError: a place of the map without usable properties, or a position or velocity that isn't three finite
                numbers.
        """
        position = numbers(position, (3,), "a device position", "check the device's driver")
        velocity = numbers(velocity, (3,), "a device velocity", "check the device's driver")
        if self._before is not None:
            moved = position - self._before[2]
            self._along.book(float(self._before[0] @ moved))
            self._across.book(float(self._before[1] @ moved))
        foot = self._tracker.follow(position)
        nothing = np.zeros(3)
        pressing, dragging, sliding = nothing, nothing, False
        extra, share, limited = (0.0, 0.0), (1.0, 1.0), False
        if foot.depth <= 0.0:
            self._anchor, proxy = None, position
            self._along.leave()
            self._across.leave()
        else:
            out = foot.normal
            anchor = foot.point if self._anchor is None else self._anchor
            material = material_at(self.materials, *self.surface.chart(anchor))
            rate = -float(out @ velocity)
            slip = velocity + rate * out
            normal, room, limited = self._borne(foot.depth, rate, material)
            # towards the anchor, within the surface: beyond an edge what lay along the normal is let go
            stretch = foot.point - anchor
            stretch = stretch - out * (out @ stretch)
            stretch, sliding = self._held(stretch, material.friction * normal)
            proxy = self._anchor = foot.point - stretch
            pressing, dragging = normal * out, -self.settings.shear * stretch
            share_n, extra_n = self._along.settle(-normal * rate, normal, rate * rate)
            drag = float(np.sqrt(dragging @ dragging))
            share_t, extra_t = self._across.settle(float(dragging @ slip), drag, float(slip @ slip))
            # the friction cone is that of the normal force that is rendered
            extra, share = (
                (min(extra_n, room), min(extra_t, self.settings.most_damping)),
                (share_n, min(share_t, share_n)),
            )
            pressing = share[0] * pressing + extra[0] * rate * out
            dragging = share[1] * dragging - extra[1] * slip
        pressing, dragging = self._limited(pressing, dragging)
        self._before = (pressing, dragging, position.copy())
        energy = self._along.energy, self._across.energy
        return Rendered(pressing + dragging, proxy, foot.depth, sliding, extra, share, energy, limited)

    def _borne(self, depth: float, rate: float, material: Properties) -> tuple[float, float, bool]:
        """The law's force as the device's mass bears it [N]; damping that may still be added; whether softened."""
        s = self.settings
        wanted, still = self.law.force(depth, rate, material), self.law.force(depth, 0.0, material)
        spring, damper = min(still, s.most_stiffness * depth), s.most_damping * abs(rate)
        loss = min(max(wanted - still, -damper), damper)
        force = max(0.0, spring + loss)
        room = s.most_damping - (abs(loss / rate) if rate != 0.0 else 0.0)
        return force, max(0.0, room), force < wanted or loss > wanted - still

    def _held(self, stretch: Array, most: float) -> tuple[Array, bool]:
        """How far the proxy lags behind the foot, on the friction cone at most, and whether it slides."""
        shear = self.settings.shear
        if shear == 0.0:
            return np.zeros(3), False
        size = shear * float(np.sqrt(stretch @ stretch))
        if size > most:
            return stretch * (most / size), True
        return stretch, False

    def _limited(self, pressing: Array, dragging: Array) -> tuple[Array, Array]:
        """Both shortened alike to what the device can give."""
        force = pressing + dragging
        size = float(np.sqrt(force @ force))
        if size <= self.settings.force_limit:
            return pressing, dragging
        return pressing * (self.settings.force_limit / size), dragging * (self.settings.force_limit / size)

    def torques(self, state: ArmState) -> Array:
        """Joint torques of an arm that is the device: weight held, map rendered at its tip, (N,); not clipped."""
        rendered = self.command(state.position, state.twist[:3])
        return np.asarray(state.gravity + rendered.torques(state.jacobian))
