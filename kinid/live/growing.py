"""A property map that a session's touches join as they end, and what its estimators start from."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from kinid.contact.touching import SHORTEST
from kinid.data.rig import Rig
from kinid.effects import Layout
from kinid.errors import InputError
from kinid.estimators.estimate import Estimate
from kinid.live.encoding import CONTACT
from kinid.live.events import Event
from kinid.live.latency import Latencies
from kinid.live.messages import Joints, Wrench
from kinid.live.pipeline import Pipeline
from kinid.live.sink import Sink
from kinid.mapping.probes import same_surface
from kinid.mapping.property_map import Probe, Property, PropertyMap
from kinid.modeling.model import Model
from kinid.robotics.surface import Mesh, Plane
from kinid.robotics.surface import load as load_surface
from kinid.writers import Json

Array = NDArray[np.float64]

#: readings of a contact frame
FORCES = ("normal_force", "tangential_force1", "tangential_force2")


class Growing(Sink):
    """A map on disk that grows: a touch joins it as it ends, or as a border or a jump ends what it was.

    As something is touched, and behind a border, a session's estimators start from what is known `nearest` to that
    place, in this map or in one of before; how much it may differ there is `pipeline.SPREAD`. Of a touch its last valid
    estimates are kept: what was never valid is left open, and a touch without any, or shorter than `touching.SHORTEST`,
    joins nothing.

    Args:
        path: of the map, which goes on where it is one of the same model and surface; None keeps it in memory alone.
        pipeline: whose touches they are.
        rig: with the surface that is touched. source: of the samples, for people.
        shows: are handed the map whenever it has grown.
        prior: a map to start from that doesn't grow: of another day, or predicted from a picture.

    Attributes:
        map: as it is now. joining: times that touches took to join [ns].

    Raises:
        InputError: a file that holds no map, or that of another model or surface; a prior on another surface.
    """

    def __init__(
        self,
        path: Path | None,
        pipeline: Pipeline,
        rig: Rig,
        source: str,
        shows: Sequence[Callable[[PropertyMap], None]] = (),
        prior: PropertyMap | None = None,
    ) -> None:
        super().__init__("map")
        self._path, self._pipeline, self._source, self._shows = path, pipeline, source, tuple(shows)
        self._noise = max(rig.sensor.noise[:3]) if rig.sensor.noise else float("nan")
        surface = load_surface(rig)
        assert isinstance(surface, Plane | Mesh)  # the pipeline asked for one
        model = Model(*pipeline.model)
        properties = _properties(pipeline.model)
        self.map = PropertyMap(surface, properties, (), str(model))
        if path is not None and path.is_file():
            self.map = PropertyMap.read(path)
            there = [p.name for p in self.map.properties]
            if (
                self.map.model != str(model)
                or there != [p.name for p in properties]
                or not same_surface(self.map.surface, surface)
            ):
                raise InputError(
                    f"a map of {self.map.model}, perhaps on another surface, at {path}",
                    f"a map of {model} on the rig's surface",
                    "write to another file",
                )
        if prior is not None and not same_surface(prior.surface, surface):
            raise InputError(
                "a prior on another surface than the rig's", "one surface", "take the rig that the prior was made with"
            )
        self._prior = prior
        self._places = self.map.places
        self._surface, self._written = surface, len(self.map)
        self.joining = Latencies()
        self._sum, self._first, self._last = np.zeros(4), 0, 0
        self._valid: dict[str, Estimate] = {}
        for show in shows if len(self.map) else ():
            show(self.map)
        self._thread.start()

    def sample(self, message: Joints | Wrench, stamp: int) -> None:
        """Nothing: the contact quantities say it all."""

    def state(self, topic: str, received: int, stamp: int, values: Json) -> None:
        """Where it touches, and the estimates that stand."""
        if topic != CONTACT or not values["in_contact"] or values["depth"] is None:
            return
        # the deeper, the more a place says about the estimate
        weight = max(float(values["depth"]), 0.0) + 1e-9
        self._sum += weight * np.append(self._pipeline.place, 1.0)
        self._first = self._first or stamp
        self._last = stamp
        self._valid |= {part: e for part, e in self._pipeline.estimates.items() if e.valid}

    def event(self, event: Event, received: int, stamp: int) -> None:
        """A touch that begins or ends, or what was touched that ends."""
        if event.kind not in ("touch", "leave", "reopened"):
            return
        begin = time.perf_counter_ns()
        if self._join():
            self.joining.add(time.perf_counter_ns() - begin)
        self._begin()

    def _begin(self) -> None:
        self._sum, self._first, self._last, self._valid = np.zeros(4), 0, 0, {}

    def nearest(self) -> dict[str, float] | None:
        """What is known nearest to where the tool is, in the map or the prior; None where nothing is.

        Of a prior of another model, properties of the same name and unit count.
        """
        at, nearest, least = self._pipeline.place, None, np.inf
        if not np.isfinite(at).all():
            return None
        known_maps = [(self.map, self._places)]
        if self._prior is not None:
            known_maps.append((self._prior, self._prior.places))
        for known_map, places in known_maps:
            away = ((places - at) ** 2).sum(axis=1)
            if len(away) and away.min() < least:
                nearest, least = (known_map.properties, known_map.probes[int(np.argmin(away))]), away.min()
        if nearest is None:
            return None
        properties, probe = nearest
        known = np.isfinite(np.diag(probe.covariance))
        units = {p.name: p.unit for p in self.map.properties}
        return {
            p.name: float(v)
            for p, v, is_known in zip(properties, probe.values, known)
            if is_known and units.get(p.name) == p.unit
        }

    def _join(self) -> bool:
        """The touch so far as a probe; whether it was one."""
        if not self._valid or self._last - self._first < 1e9 * SHORTEST:
            return False
        # a mean of points of a curved surface lies beside it
        place = self._surface.locate(self._sum[:3] / self._sum[3]).closest[0]
        names = [p.name for p in self.map.properties]
        values, covariance = np.zeros(len(names)), np.diag(np.full(len(names), np.inf))
        for estimate in self._valid.values():
            rows = [(names.index(name), k) for k, name in enumerate(estimate.names) if name in names]
            for i, k in rows:
                values[i] = estimate.values[k]
                for j, m in rows:
                    covariance[i, j] = estimate.covariance[k, m]
        normal = self._valid.get("normal")
        probe = Probe(
            place,
            values,
            covariance,
            float("nan") if normal is None else normal.noise,
            self._noise,
            f"{self._source}#{len(self.map)}",
        )
        try:
            self.map = self.map.added(probe)
        except InputError:  # an estimate that is none, as a stiffness that is surely negative
            return False
        self._places = np.vstack([self._places, place])
        for show in self._shows:
            show(self.map)
        return True

    def _write(self, topic: str, received: int, stamp: int, what: Joints | Wrench | Json) -> None:
        """Nothing waits."""

    def _commit(self) -> None:
        """The map as it is now on disk, whole or not at all; in the thread."""
        now = self.map
        if self._path is not None and len(now) != self._written:
            now.write(self._path)
            self._written = len(now)


def _properties(model: Sequence[str]) -> tuple[Property, ...]:
    """What maps hold of a model, named as `kinid map` names them."""
    out = []
    for effect in Model(*model).effects:
        parameters = effect.parameters(Layout(FORCES, "contact"))
        out += [Property(effect.map_names.get(p.name, p.name), p.unit) for p in parameters]
    return tuple(out)
