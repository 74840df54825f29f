"""A map that grows while one touches: what joins it, how soon, and what starting from it is worth."""

from __future__ import annotations

import time
from pathlib import Path

import numpy as np
import pytest
from live.prepared import NAMES, Prepared
from numpy.typing import NDArray
from scripted import Scripted

from kinid.data.rig import Rig
from kinid.errors import InputError
from kinid.live import Event, Pipeline, Session
from kinid.live.growing import Growing
from kinid.live.messages import Item
from kinid.mapping.probes import Prober
from kinid.mapping.property_map import PICTURE, Probe, Property, PropertyMap

Array = NDArray[np.float64]
MODEL = ("kelvin-voigt", "coulomb-friction")


def run(path: Path, rig: Rig, rows: list[Item], model: tuple[str, ...] = MODEL) -> tuple[Growing, Session]:
    pipeline = Pipeline(rig, model)
    growing = Growing(path, pipeline, rig, "stream")
    session = Session(Prepared(rows), pipeline, NAMES, sinks=[growing], known=growing)
    session.run()
    return growing, session


def test_a_touch_joins_the_map_as_it_ends(tmp_path: Path, rig: Rig, rows: list[Item], scripted: Scripted) -> None:
    path = tmp_path / "map.parquet"
    growing, first = run(path, rig, rows)
    assert not first.counts["warm-start"]
    found = PropertyMap.read(path)
    assert growing.joining.count >= 1
    assert len(found) == len(growing.map) >= 1
    # the scripted material, to what recursive estimates with a short memory are worth
    assert found.values("stiffness")[-1] == pytest.approx(732, rel=0.05)
    assert found.values("friction")[-1] == pytest.approx(0.45, rel=0.2)
    prober = Prober.of(rig, MODEL)
    properties, probes = prober.of_log(scripted.log, "log")
    assert (found.model, found.properties) == (prober.name, properties)
    # where the whole log has one: its long slides are cut into pieces
    assert min(np.linalg.norm(found.places[-1] - p.place) for p in probes) < 2e-3
    # it goes on
    again, session = run(path, rig, rows)
    assert len(PropertyMap.read(path)) == 2 * len(found)
    assert session.counts["warm-start"] >= 1
    (start, *_) = (event for event in session.events if event.kind == "warm-start")
    assert start.values == pytest.approx(dict(zip(("stiffness", "damping", "friction"), found.probes[-1].values)))
    assert len({probe.source for probe in again.map.probes}) == len(again.map)


class Watched(Pipeline):
    """Notes for how long, in the first second of the first touch, the stiffness was wrong by 10 %, and when it was
    first valid [s].
    """

    touched, wrong, valid, last = 0.0, 0.0, 0.0, 0.0

    def step(self, t: float, q: Array, wrench: Array, dq: Array) -> int:
        event_bits = super().step(t, q, wrench, dq)
        if self.touching and t < (self.touched or t) + 1.0:
            self.touched = self.touched or t
            estimate = self.estimates["normal"]
            if abs(float(estimate.values[0]) / 732.0 - 1.0) > 0.1:
                self.wrong += t - self.last
            if estimate.valid:
                self.valid = self.valid or t - self.touched
        self.last = t
        return event_bits


def test_starting_from_the_map_is_sooner(tmp_path: Path, rig: Rig, rows: list[Item]) -> None:
    path = tmp_path / "map.parquet"
    run(path, rig, rows)
    cold, warm = Watched(rig, MODEL), Watched(rig, MODEL)
    for pipeline, start in ((cold, tmp_path / "new.parquet"), (warm, path)):
        growing = Growing(start, pipeline, rig, "stream")
        Session(Prepared(rows), pipeline, NAMES, sinks=[growing], known=growing).run()
    print(
        f"wrong by 10 % for {cold.wrong:.3f} s, with a map {warm.wrong:.3f} s; valid {cold.valid:.3f}, {warm.valid:.3f}"
    )
    assert warm.wrong < cold.wrong
    assert warm.valid <= cold.valid


def test_starting_from_a_picture_is_sooner(rig: Rig, rows: list[Item]) -> None:
    """A map predicted from a picture knows a stiffness alone, here one that is a tenth off."""
    cold, warm = Watched(rig, MODEL), Watched(rig, MODEL)
    surface = Growing(None, cold, rig, "stream").map.surface
    cell = Probe(
        surface.locate([[0.55, 0.0, 0.10]]).closest[0], np.array([800.0]), np.array([[80.0**2]]), source="cell"
    )
    picture = PropertyMap(surface, (Property("stiffness", "N/m"),), (cell,), PICTURE)
    for pipeline, prior in ((cold, None), (warm, picture)):
        growing = Growing(None, pipeline, rig, "stream", prior=prior)
        Session(Prepared(rows), pipeline, NAMES, sinks=[growing], known=growing).run()
    print(f"wrong by 10 % for {cold.wrong:.3f} s, with a picture {warm.wrong:.3f} s")
    assert warm.wrong < cold.wrong
    other = rig.model_copy(update={"surface": rig.surface.model_copy(update={"point": (0.5, 0.0, 0.1)})})  # type: ignore[union-attr]
    with pytest.raises(InputError, match="prior on another surface"):
        Growing(None, Pipeline(other, MODEL), other, "stream", prior=picture)


def test_thousand_touches_are_no_slower(tmp_path: Path, rig: Rig) -> None:
    """A touch joins a map of many as it joins an empty one, by the events and quantities of a session."""
    path, properties = tmp_path / "map.parquet", (Property("stiffness", "N/m"), Property("damping", "N·s/m"))
    surface = Growing(tmp_path / "x.parquet", Pipeline(rig, ("kelvin-voigt",)), rig, "x")
    probes = tuple(Probe(np.array([0.5 + 1e-5 * k, 0.0, 0.1]), np.array([700.0, 9.0]), np.eye(2)) for k in range(2000))
    PropertyMap(surface.map.surface, properties, probes, surface.map.model).write(path)
    surface.close()
    pipeline = Pipeline(rig, ("kelvin-voigt",))
    growing = Growing(path, pipeline, rig, "many")
    begin = time.perf_counter()
    for _ in range(20):
        growing.event(Event("touch", 1.0, "", (0.0, 0.0, 0.0)), 0, 10**9)
        growing.event(Event("leave", 2.0, "", (0.0, 0.0, 0.0)), 0, 2 * 10**9)
    assert (time.perf_counter() - begin) / 40 < 5e-3
    growing.close()
    assert pipeline.estimates["normal"].names == ("stiffness", "damping")


def test_a_map_of_something_else_is_refused(tmp_path: Path, rig: Rig, rows: list[Item]) -> None:
    path = tmp_path / "map.parquet"
    run(path, rig, rows[:9000], ("kelvin-voigt",))
    if not path.is_file():  # nothing was touched for long enough
        run(path, rig, rows, ("kelvin-voigt",))
    before = path.read_bytes()
    with pytest.raises(InputError, match="another file"):
        Growing(path, Pipeline(rig, MODEL), rig, "stream")
    assert path.read_bytes() == before
