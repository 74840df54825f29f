"""A map of properties over a surface: estimates with covariance where it was probed, guesses with uncertainty between.

A map grows probe by probe. On disk it is one Parquet file with a row a probe, always whole: whoever reads it while it
grows sees the map as it was after some probe. The surface, a mesh included, is in the file.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from kinid import effects
from kinid.errors import InputError, near
from kinid.mapping.interpolation import MESH_METHODS, METHODS, Guess, Interpolator, PlaneSites
from kinid.mapping.interpolation.gaussian_process import interpolator
from kinid.mapping.interpolation.uniform import Uniform
from kinid.robotics.surface import Mesh, Plane
from kinid.writers import Json

Array = NDArray[np.float64]

#: stands for the model where values were predicted from a picture
PICTURE = "picture"
#: of entries of a covariance, relative
TOLERANCE = 1e-6
#: of the base, no probe lies further away [m]
FARTHEST = 100.0
#: of so many probes at most a field is made: its time grows with their cube
MOST_PROBES = 2000
#: standard errors to either side that hold 95 %
WITHIN = 1.96


@dataclass(frozen=True)
class Property:
    """What is mapped: name, as "stiffness", and unit."""

    name: str
    unit: str


@dataclass(frozen=True, eq=False)
class Probe:
    """Estimates at one place.

    Attributes:
        place: on the surface, base frame [m], (3,). values: (p,). covariance: (p, p), infinite where a property is
        open. residual, noise: what the model left, and what noise alone would have left [N]. source: where it came
        from. digest: of the log that it came from, SHA-256, by which the same log is known under another name.
    """

    place: Array
    values: Array
    covariance: Array
    residual: float = float("nan")
    noise: float = float("nan")
    source: str = ""
    digest: str = ""


@dataclass(frozen=True, eq=False)
class PropertyMap:
    """Probes on a plane or a mesh; nothing in it is a guess until it is asked for one.

    Attributes:
        surface: `Plane` or `Mesh`. properties: what is mapped. probes: in the order they came. model: that was fitted.
        origin: what they were made with; empty where nobody says.
    """

    surface: Plane | Mesh
    properties: tuple[Property, ...]
    probes: tuple[Probe, ...] = ()
    model: str = ""
    origin: Json = field(default_factory=dict, repr=False)
    _fitted: dict[tuple[str, str], Interpolator] = field(default_factory=dict, init=False, repr=False)

    def __post_init__(self) -> None:
        names = [p.name for p in self.properties]
        if not names or len(set(names)) != len(names):
            raise InputError(f"properties {names}", "one at least, each once", "name them apart")
        for probe in self.probes:
            self._check(probe)

    def __len__(self) -> int:
        return len(self.probes)

    @property
    def predicted(self) -> bool:
        """Whether it holds predictions and no measurements, which say nothing of how well they are predicted."""
        return self.model == PICTURE

    @property
    def words(self) -> str:
        """What it holds."""
        return f"{len(self)} " + ("cells predicted from a picture" if self.predicted else f"probes with {self.model}")

    def _check(self, probe: Probe) -> None:
        p = len(self.properties)
        if np.shape(probe.place) != (3,) or not (np.abs(probe.place) < FARTHEST).all():
            raise InputError(
                f"a probe at {probe.place}",
                f"three finite coordinates in the base frame, below {FARTHEST:g} m",
                "leave it out",
            )
        for what, size in (("residual", probe.residual), ("noise", probe.noise)):
            if size < 0.0 or np.isinf(size):
                raise InputError(f"a {what} of {size} N{_of(probe.source)}", "0 N or more", "leave the probe out")
        if np.shape(probe.values) != (p,) or np.shape(probe.covariance) != (p, p):
            raise InputError(
                f"a probe with values {np.shape(probe.values)} and covariance {np.shape(probe.covariance)}",
                f"({p},) and ({p}, {p}) for {', '.join(q.name for q in self.properties)}",
                "map logs of one kind together",
            )
        for item, value, variance in zip(self.properties, probe.values, np.diag(probe.covariance)):
            _check_estimate(item, float(value), float(variance), probe.source)
        finite = np.isfinite(np.diag(probe.covariance))
        cov, sd = np.asarray(probe.covariance)[np.ix_(finite, finite)], np.sqrt(np.diag(probe.covariance)[finite])
        most = np.outer(sd, sd)  # of each entry; rounding is relative to it
        with np.errstate(invalid="ignore"):  # of infinities
            bounded, symmetric = np.abs(cov) <= (1 + TOLERANCE) * most, np.abs(cov - cov.T) <= TOLERANCE * most
        if not (bounded.all() and symmetric.all()):
            raise InputError(
                f"a covariance that is none{_of(probe.source)}",
                "a finite, symmetric one with correlations within ±1",
                "leave the probe out",
            )

    def added(self, *probes: Probe) -> PropertyMap:
        """The map with more probes.

        Raises:
            InputError: no finite place; values that are no numbers though they are told; a covariance that is none; a
                stiffness that is surely negative.
        """
        for probe in probes:
            self._check(probe)
        made = object.__new__(PropertyMap)  # the others were checked when they came
        made.__dict__.update(self.__dict__, probes=(*self.probes, *probes), _fitted={})
        return made

    @property
    def places(self) -> Array:
        """Of the probes, base frame [m], (n, 3)."""
        return np.array([p.place for p in self.probes]).reshape(-1, 3)

    def values(self, name: str) -> Array:
        """Of one property, (n,); NaN where a probe left it open."""
        k = self.index(name)
        values = np.array([p.values[k] for p in self.probes])
        return np.where(np.isfinite(self.deviations(name)), values, np.nan)

    def deviations(self, name: str) -> Array:
        """Standard errors of one property, (n,)."""
        k = self.index(name)
        return np.asarray(np.sqrt(np.array([max(float(p.covariance[k, k]), 0.0) for p in self.probes])))

    @property
    def residual_over_noise(self) -> Array:
        """What the model left at each probe over what noise leaves, (n,): far above 1 the model fails there."""
        return np.array([p.residual / p.noise if p.noise > 0 else np.nan for p in self.probes])

    def index(self, name: str) -> int:
        """Which property has this name.

        Raises:
            InputError: none.
        """
        names = [p.name for p in self.properties]
        if name not in names:
            raise InputError(f"property '{name}'", f"one of {', '.join(names)}", near(name, names))
        return names.index(name)

    def flat(self, points: Array) -> Array:
        """Points of a plane, (m, 3), along its tangents from its point [m], (m, 2)."""
        if not isinstance(self.surface, Plane):
            raise InputError("a mesh", "a plane, to lay it flat", "ask at the mesh's vertices")
        return np.asarray((np.asarray(points).reshape(-1, 3) - self.surface.point) @ self.surface.axes[:2].T)

    def raised(self, flat: Array) -> Array:
        """The points of a plane (m, 3) with coordinates along its tangents (m, 2) [m]."""
        assert isinstance(self.surface, Plane)
        return np.asarray(self.surface.point + np.asarray(flat) @ self.surface.axes[:2])

    def interpolator(self, name: str, method: str = "gp") -> Interpolator:
        """One property between the probes; queries are (m, 2) along a plane's tangents, or vertex numbers of a mesh.

        It is fitted once, however often it is asked for.

        Raises:
            InputError: no probe that tells this property.
        """
        if (name, method) not in self._fitted:
            self._fitted[name, method] = self._fit(name, method)
        return self._fitted[name, method]

    def _fit(self, name: str, method: str) -> Interpolator:
        values, noise = self.values(name), self.deviations(name)
        tells = np.isfinite(values)
        if not tells.any():
            raise InputError(f"no probe that tells {name}", "one at least", "map logs that excite it")
        if tells.sum() > MOST_PROBES:
            raise InputError(
                f"{tells.sum()} probes of {name}",
                f"{MOST_PROBES} at most, as the time of a field grows with their cube",
                "make maps of parts of the surface",
            )
        errors = noise[tells], self._lasting(noise)[tells]
        if isinstance(self.surface, Plane):
            flat = self.flat(self.places)
            without = flat[~tells] if name in _of_layers(self.model) else None
            return interpolator(method, PlaneSites(flat[tells], without=without), values[tells], *errors)
        from kinid.mapping.interpolation.mesh import MeshSites, on_mesh

        return on_mesh(method, MeshSites(self.surface, self.places[tells]), values[tells], *errors)

    def _lasting(self, noise: Array) -> Array:
        """The part of errors (n,) that a law makes which is wrong at a place, (n,): further probes don't average it."""
        more = np.nan_to_num(self.residual_over_noise, nan=1.0)
        return np.where(np.isfinite(noise), noise, 0.0) * np.sqrt(1.0 - 1.0 / np.maximum(more, 1.0) ** 2)

    def uniform(self, name: str) -> Uniform | None:
        """The one value of a property that is the same everywhere, with its error; None where it varies.

        Raises:
            InputError: no probe that tells this property.
        """
        return None if self.predicted else self.interpolator(name).uniform

    def grid(self, cells: int = 100, margin: float = 0.45) -> tuple[Array, Array]:
        """Ticks along both tangents of a plane [m] that span the probes and `margin` of their spacing around them.

        Args:
            cells: along the longer side.
        """
        flat = self.flat(self.places)
        edge = margin * PlaneSites(flat).spacing
        low, high = flat.min(axis=0) - edge, flat.max(axis=0) + edge
        step = float((high - low).max()) / cells
        counts = np.maximum(2, np.round((high - low) / step).astype(int) + 1)
        return np.linspace(low[0], high[0], counts[0]), np.linspace(low[1], high[1], counts[1])

    def over_grid(self, name: str, ticks: tuple[Array, Array], method: str = "gp") -> Guess:
        """One property over a grid on a plane; fields have shape (len(ticks[0]), len(ticks[1]))."""
        x, y = np.meshgrid(*ticks, indexing="ij")
        guess = self.interpolator(name, method).at(np.column_stack([x.ravel(), y.ravel()]))
        return Guess(guess.mean.reshape(x.shape), guess.sd.reshape(x.shape), guess.known.reshape(x.shape))

    @property
    def methods(self) -> tuple[str, ...]:
        """Ways to interpolate on this surface."""
        return METHODS if isinstance(self.surface, Plane) else MESH_METHODS

    def held_out(self, name: str) -> dict[str, float]:
        """Root mean square error of each method where each probe is left out in turn, by its name."""
        return {method: self.interpolator(name, method).left_out_error for method in self.methods}

    def write(self, path: Path) -> None:
        """As Parquet, whole or not at all; a file that is there is replaced in one step.

        Raises:
            InputError: a name that doesn't end in .parquet, or a folder that can't be written to.
        """
        from kinid.mapping.map_file import write_map

        write_map(self, path)

    @classmethod
    def read(cls, path: Path) -> PropertyMap:
        """A map from its file.

        Raises:
            InputError: no map there, or one whose parts contradict each other.
        """
        from kinid.mapping.map_file import read_map

        return read_map(path)


def _check_estimate(item: Property, value: float, variance: float, source: str) -> None:
    """Refuse what is no estimate; one whose variance is infinite is left open, and its value says nothing."""
    if not variance >= 0.0:
        raise InputError(
            f"{item.name} with variance {variance}{_of(source)}",
            "0 or more, infinite where it is left open",
            "leave the probe out",
        )
    if not np.isfinite(variance):
        return
    if not np.isfinite(value):
        raise InputError(
            f"{item.name} {value}{_of(source)}",
            "a finite value, or an infinite variance where it is left open",
            "leave the probe out",
        )
    half = WITHIN * np.sqrt(variance)
    if item.name.rsplit(".", 1)[-1] == "stiffness" and value + half < 0.0:
        raise InputError(
            f"a stiffness of {value:.4g} ± {half:.2g} {item.unit}{_of(source)}",
            "one whose interval reaches positive values",
            "check the surface's normal and the sign of the force",
        )


def _of_layers(model: str) -> set[str]:
    """What a map calls properties that only places with a layer have, by the model's name."""
    known = [effects.get(name) for name in model.split(" + ") if name in effects.catalogue()]
    return {name for effect in known if effect.above for name in (*effect.above.values(), *effect.map_names.values())}


def _of(source: str) -> str:
    return f" of the probe {source}" if source else ""
