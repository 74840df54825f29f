"""A measured property map as controllers read it: tabled once, looked up once a period."""

from __future__ import annotations

from typing import Literal, get_args

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from kinid.controllers._given import closest
from kinid.controllers.mesh_surface import MeshSurface
from kinid.controllers.properties import Plane, Properties, Touchable
from kinid.errors import InputError
from kinid.mapping.property_map import PropertyMap as Map
from kinid.robotics.surface import Mesh

Array = NDArray[np.float64]
Unknown = Literal["softest", "hardest", "refuse"]

#: of the table along the longer side of a plane
CELLS = 100
#: by which the table goes beyond the probes, in their spacings: its edge is unknown, so that nothing jumps there
EDGE = 1.0
#: a map's properties by their names there, and what they are where it doesn't hold them
ROLES = {"stiffness": 0.0, "damping": 0.0, "exponent": 1.0, "friction": 0.0}


class Measured:
    """What `kinid map` wrote, for `HapticRendering`, `AdaptiveImpedance` and `Environment.at`.

    Between probes a guess is interpolated, and kept within what the probes found; the table is bilinear on a plane, and
    has an entry for each vertex of a mesh. Where the map knows nothing the material is, property by property, the least
    or the most that it knows anywhere: a device that renders the softest is safe, and so is an arm, which softens on
    what is hard, that expects the hardest.

    Args:
        grown: the map. method: of interpolation, see `kinid.mapping.property_map`. unknown: places that no probe
            reaches are the softest or the hardest known, or refused.

    Attributes:
        surface: where the map lies, for `HapticSettings`. plane: the same for `Schedule`; None on a mesh.
        absent: properties that the map doesn't hold: without damping there is none, and so on.

    Raises:
        InputError: no map, one without stiffness or without a place that it knows, or no such way to fill it.
    """

    def __init__(self, grown: Map, method: str = "gp", unknown: Unknown = "softest") -> None:
        if not isinstance(grown, Map):
            raise InputError(
                f"a map {str(grown)[:40]!r}", "what PropertyMap.read(path) gives", "use kinid.mapping.property_map"
            )
        if unknown not in get_args(Unknown):
            ways = get_args(Unknown)
            raise InputError(f"unknown {unknown!r}", f"one of {', '.join(ways)}", closest(unknown, ways))
        units = {p.name: p.unit for p in grown.properties if np.isfinite(grown.values(p.name)).any()}
        if "stiffness" not in units:
            raise InputError(
                f"a map of {', '.join(units) or 'nothing'}", "one that holds stiffness", "map with a model that has one"
            )
        self.unknown: Unknown = unknown
        self.absent = tuple(role for role in ROLES if role not in units)
        self.surface: Touchable
        self.plane: Plane | None = None
        if isinstance(grown.surface, Mesh):
            self._vertices = cKDTree(grown.surface.vertices)
            self.surface = MeshSurface(grown.surface, self._vertex)
        else:
            self.surface = self.plane = Plane(grown.surface.point, grown.surface.axes)
            self._ticks = grown.grid(CELLS, EDGE)
        self._table, self._known = self._tabled(grown, method, units)

    def _tabled(self, grown: Map, method: str, units: dict[str, str]) -> tuple[Array, NDArray[np.bool_]]:
        """The table, (nx, ny, roles) or (vertices, roles), and where it is known."""
        columns, known = [], np.ones(1, dtype=np.bool_)
        for role in units.keys() & ROLES.keys():
            if self.plane is None:
                guess = grown.interpolator(role, method).at(np.arange(self._vertices.n, dtype=np.int64), sd=False)
            else:
                guess = grown.over_grid(role, self._ticks, method)
            values = grown.values(role)
            columns.append((role, np.clip(guess.mean, max(np.nanmin(values), 0.0), max(np.nanmax(values), 0.0))))
            known = known & guess.known
        if not known.any():
            raise InputError("a map that knows no place", "probes near each other", "poke more")
        table = np.empty((*known.shape, len(ROLES)))
        self._nowhere = np.empty(len(ROLES))
        absent = {**ROLES, "exponent": fixed_exponent(units["stiffness"])}
        for k, role in enumerate(ROLES):
            column = dict(columns).get(role, np.full(known.shape, absent[role]))
            self._nowhere[k] = column[known].max() if self.unknown == "hardest" else column[known].min()
            table[..., k] = np.where(known, column, self._nowhere[k])
        return table, known

    def _vertex(self, point: Array) -> tuple[float, float]:
        """Number of the mesh's vertex nearest to a point (3,), and 0: its place on the map."""
        return float(self._vertices.query(point)[1]), 0.0

    def _cell(self, x: float, y: float) -> tuple[int, int, float, float] | None:
        """The table's cell at a place of the plane, and the place in it, 0…1; None beyond the table."""
        at = []
        for value, ticks in zip((x, y), self._ticks):
            share = (value - ticks[0]) / (ticks[1] - ticks[0])
            if not -1e-9 <= share <= len(ticks) - 1 + 1e-9:
                return None
            i = min(max(int(share), 0), len(ticks) - 2)
            at.append((i, share - i))
        return at[0][0], at[1][0], at[0][1], at[1][1]

    def knows(self, x: float, y: float) -> bool:
        """Whether probes reach a place: along both tangents of a plane [m]; on a mesh the number of a vertex, and 0."""
        if self.plane is None:
            return bool(self._known[int(x)])
        cell = self._cell(x, y)
        return cell is not None and bool(self._known[cell[0] : cell[0] + 2, cell[1] : cell[1] + 2].all())

    def properties(self, x: float, y: float) -> Properties:
        """The material at a place, see `knows`.

        Raises:
            InputError: an unknown place, where those are refused.
        """
        if self.unknown == "refuse" and not self.knows(x, y):
            raise InputError(
                f"a place ({x:g}, {y:g}) m that the map doesn't know",
                "a place near a probe",
                'poke there, or fill it: Measured(map, unknown="softest")',
            )
        if self.plane is None:
            return Properties(*self._table[int(x)].tolist())
        cell, t = self._cell(x, y), self._table
        if cell is None:
            return Properties(*self._nowhere.tolist())
        i, j, a, b = cell
        found = (1 - a) * ((1 - b) * t[i, j] + b * t[i, j + 1]) + a * ((1 - b) * t[i + 1, j] + b * t[i + 1, j + 1])
        return Properties(*found.tolist())


def fixed_exponent(unit: str) -> float:
    """Exponent of a law that has a fixed one, by the unit of its stiffness: "N/m^1.5" is Hertz's; 1 where it is N/m."""
    try:
        return float(unit.removeprefix("N/m^"))
    except ValueError:
        return 1.0
