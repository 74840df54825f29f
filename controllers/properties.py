"""What a property map tells a controller: the material at each place of a surface, and where that surface lies."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, NamedTuple, Protocol, cast, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from kinid.controllers._given import is_number, numbers
from kinid.errors import InputError

if TYPE_CHECKING:
    from kinid.controllers.measured import Unknown

Array = NDArray[np.float64]


class Properties(NamedTuple):
    """A material: normal force f = K xⁿ + B xᵐ ẋ with m by the contact law, and Coulomb friction.

    stiffness K [N/mⁿ], damping B [N·s/mᵐ⁺¹], exponent n [1], friction μ [1].
    """

    stiffness: float
    damping: float = 0.0
    exponent: float = 1.0
    friction: float = 0.0

    def checked(self, where: str = "the map") -> Properties:
        """Itself.

        Raises:
            InputError: a number that is negative or not finite, or an exponent of 0: such a material gives energy.
        """
        for name, value in self._asdict().items():
            if not (is_number(value) and value >= 0) or (name == "exponent" and value == 0):
                raise InputError(
                    f"{name} {value} in {where}",
                    "a finite number that isn't negative" + (" nor zero" if name == "exponent" else ""),
                    "leave places that weren't measured out of the path, or fill them",
                )
        return self


class PropertyMap(Protocol):
    """Anything that knows the material at a place: x and y along the surface's tangents [m]."""

    def properties(self, x: float, y: float) -> Properties:
        """The material there."""


def checked_map(surface: object, unknown: Unknown = "softest") -> PropertyMap:
    """Itself; of a measured map what controllers read, `kinid.controllers.Measured`.

    Args:
        surface: see `PropertyMap`, or what `kinid.mapping.property_map.PropertyMap.read` gives. unknown: see
            `Measured`.

    Raises:
        InputError: nothing that knows the material at a place.
    """
    if not isinstance(surface, type) and callable(getattr(surface, "properties", None)):
        return cast(PropertyMap, surface)
    from kinid.mapping import property_map  # heavy, and seldom needed

    if isinstance(surface, property_map.PropertyMap):
        from kinid.controllers.measured import Measured

        return Measured(surface, unknown=unknown)
    raise InputError(
        f"a map {str(surface)[:40]!r}",
        "an object with properties(x, y), or a measured PropertyMap",
        "use Uniform(Properties(…)) or PropertyMap.read(path)",
    )


def material_at(surface: PropertyMap, x: float, y: float) -> Properties:
    """What a map says of a place.

    Raises:
        InputError: no `Properties`, or such that give energy.
    """
    material: object = surface.properties(x, y)
    if not isinstance(material, Properties):
        raise InputError(
            f"{str(material)[:40]} of the map at ({x:g}, {y:g}) m",
            "Properties(stiffness, damping, …)",
            "let properties(x, y) return Properties",
        )
    return material.checked(f"the map at ({x:g}, {y:g}) m")


@dataclass(frozen=True)
class Uniform:
    """A map with the same material everywhere."""

    material: Properties

    def __post_init__(self) -> None:
        if not isinstance(self.material, Properties):
            raise InputError(
                f"a material {str(self.material)[:40]!r}", "Properties(stiffness, damping, …)", "name them apart"
            )
        self.material.checked("the material")

    def properties(self, x: float, y: float) -> Properties:
        """The material."""
        return self.material


class Foot(NamedTuple):
    """Where a device would be if the surface were hard.

    point: of the surface, base frame, (3,) [m]. normal: unit, from the device out of the material, (3,).
    depth: how far the device is from there, ≥ 0 [m]; 0 in the air, where the point is the device's own.
    """

    point: Array
    normal: Array
    depth: float


class Tracker(ABC):
    """Follows a device period by period."""

    @abstractmethod
    def follow(self, position: Array) -> Foot:
        """The foot of a device's next position (3,) [m], base frame."""


@runtime_checkable
class Touchable(Protocol):
    """A surface that can be rendered: `Plane`, `kinid.controllers.MeshSurface`."""

    def tracker(self) -> Tracker:
        """What follows a device that comes from the outside."""

    def chart(self, point: Array) -> tuple[float, float]:
        """Where a point (3,) of the surface lies on the map, x and y [m]."""


@dataclass(frozen=True, eq=False)
class Plane:
    """Where the map lies: a point of the surface [m] and axes, rows tangent1, tangent2, outward normal, base frame."""

    point: Array = field(default_factory=lambda: np.zeros(3))
    axes: Array = field(default_factory=lambda: np.eye(3))

    def __post_init__(self) -> None:
        point = numbers(self.point, (3,), "a surface point", "give it in the base frame")
        axes = numbers(self.axes, (3, 3), "surface axes", "take them from Rig.axes")
        if np.abs(axes @ axes.T - np.eye(3)).max() > 1e-6 or np.linalg.det(axes) < 0:
            raise InputError(
                "surface axes that aren't orthonormal",
                "rows tangent1, tangent2, normal, right-handed",
                "take them from Rig.axes",
            )
        object.__setattr__(self, "point", point)
        object.__setattr__(self, "axes", axes)

    def local(self, position: Array) -> Array:
        """A position in surface axes: along the tangents, and the height above the surface, (3,)."""
        return np.asarray(self.axes @ (position - self.point))

    def tracker(self) -> Tracker:
        """Follows a device by its foot on the plane."""
        return _PlaneTracker(self)

    def chart(self, point: Array) -> tuple[float, float]:
        """Along both tangents [m]."""
        x, y, _ = self.local(point)
        return float(x), float(y)


@dataclass(frozen=True, eq=False)
class _PlaneTracker(Tracker):
    plane: Plane

    def follow(self, position: Array) -> Foot:
        normal = self.plane.axes[2]
        depth = -float(normal @ (position - self.plane.point))
        if depth <= 0.0:
            return Foot(position, normal, 0.0)
        return Foot(position + depth * normal, normal, depth)
