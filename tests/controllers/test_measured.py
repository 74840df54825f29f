"""Measured maps in the controllers: what they say between, on and beyond the probes."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from kinid.controllers import (
    AdaptiveImpedance,
    Environment,
    Gains,
    HapticRendering,
    HapticSettings,
    HuntCrossley,
    Impedance,
    KelvinVoigt,
    Measured,
    Plane,
    Schedule,
    Target,
)
from kinid.controllers.measured import fixed_exponent
from kinid.errors import InputError
from kinid.mapping.property_map import Probe, Property, PropertyMap
from kinid.robotics.surface import Mesh
from kinid.robotics.surface import Plane as Surface

AXES = np.array([[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
POINT = np.array([0.5, 0.1, 0.2])
KV = (Property("stiffness", "N/m"), Property("damping", "N·s/m"), Property("friction", "1"))


def stiffness(x: Any, y: Any) -> Any:
    return 1000.0 + 1e4 * np.asarray(x) - 5e3 * np.asarray(y)


def measured(properties: tuple[Property, ...] = KV, values: tuple[float, ...] = (8.0, 0.5)) -> PropertyMap:
    """Probes 5 mm apart over 40 × 40 mm of a plane that is turned and moved."""
    probes = []
    for x in np.linspace(-0.02, 0.02, 9):
        for y in np.linspace(-0.02, 0.02, 9):
            place = POINT + np.array([x, y]) @ AXES[:2]
            probes.append(Probe(place, np.array([stiffness(x, y), *values]), np.diag([25.0, *[1e-4] * len(values)])))
    return PropertyMap(Surface(POINT, AXES), properties, tuple(probes))


def test_between_probes_and_beyond_them() -> None:
    table = Measured(measured())
    for x, y in ((0.0, 0.0), (0.0123, -0.0071), (-0.0199, 0.0188)):
        found = table.properties(x, y)
        assert table.knows(x, y)
        assert found.stiffness == pytest.approx(stiffness(x, y), rel=0.02)
        assert (found.damping, found.exponent, found.friction) == pytest.approx((8.0, 1.0, 0.5), rel=0.01)
    assert table.absent == ("exponent",)
    for x, y in ((0.05, 0.0), (-3.0, 2.0)):
        assert not table.knows(x, y)
        assert table.properties(x, y).stiffness == pytest.approx(700.0, rel=0.05)
        assert Measured(measured(), unknown="hardest").properties(x, y).stiffness == pytest.approx(1300.0, rel=0.05)
        with pytest.raises(InputError, match="doesn't know"):
            Measured(measured(), unknown="refuse").properties(x, y)
    # no jump on the way out, but from one cell of the table to the next
    way = [table.properties(x, 0.0).stiffness for x in np.linspace(0.0, 0.06, 2001)]
    assert np.abs(np.diff(way)).max() < 60.0


def test_a_map_from_its_file_is_felt_where_it_was_measured(tmp_path: Path) -> None:
    measured().write(tmp_path / "map.parquet")
    rendering = HapticRendering(PropertyMap.read(tmp_path / "map.parquet"))
    assert isinstance(rendering.law, KelvinVoigt)
    for x, y in ((0.0, 0.0), (0.01, -0.01)):
        rendering.reset()
        at = POINT + np.array([x, y]) @ AXES[:2] - [0, 0, 2e-3]
        found = rendering.command(at, np.array([0, 0, -0.01]))
        assert found.force[2] == pytest.approx(stiffness(x, y) * 2e-3 + 8.0 * 0.01, rel=0.02)
        # friction, as measured: the cone holds while the device slides on
        for i in range(200):
            found = rendering.command(at + [1e-4 * i, 0, 0], np.array([0.1, 0, 0]))
        assert found.sliding
        assert -found.force[0] == pytest.approx(0.5 * found.force[2], rel=0.05)


def test_laws_with_an_exponent() -> None:
    power = (Property("stiffness", "N/m^n"), Property("damping", "N·s/m^(n+1)"), Property("exponent", "1"))
    rendering = HapticRendering(measured(power, (20.0, 1.3)))
    assert isinstance(rendering.law, HuntCrossley)
    found = rendering.command(POINT - [0, 0, 2e-3], np.zeros(3))
    assert found.force[2] == pytest.approx(1000.0 * 2e-3**1.3, rel=0.02)
    hertz = measured((Property("stiffness", "N/m^1.5"), Property("damping", "1"), Property("friction", "1")))
    assert Measured(hertz).properties(0.0, 0.0).exponent == 1.5
    assert [fixed_exponent(unit) for unit in ("N/m", "N/m^n", "N/m^1.5")] == [1.0, 1.0, 1.5]


def test_teleoperation_and_an_adaptive_arm_read_it(bench: Any) -> None:
    e = Environment.at(measured(), 0.01, 0.0)
    assert e.stiffness == pytest.approx(1100.0, rel=0.02)
    assert e.damping == pytest.approx(8.0, rel=0.01)
    for bad in ({"x": "a", "y": 0.0}, {"x": 0.0, "y": np.nan}, {"x": 0.0, "y": 0.0, "depth": 0.0}):
        with pytest.raises(InputError):
            Environment.at(measured(), **bad)
    state = bench.state()
    grown = measured()
    lies = Surface(state.position, np.eye(3))
    moved = tuple(Probe(state.position + (p.place - POINT) @ AXES.T, p.values, p.covariance) for p in grown.probes)
    base = Impedance(Gains(3000.0), Target(state.rotation, state.position), bench.limit)
    control = AdaptiveImpedance(base, PropertyMap(lies, KV, moved), Schedule(series=400.0))
    np.testing.assert_allclose(control.plane.point, state.position)
    control.command(state)
    assert control.stiffness == pytest.approx(400 * 1000 / 600, rel=0.03)
    # where nobody has measured, the arm is as soft as on the hardest that is known
    far = type(state)(**(vars(state) | {"position": state.position + [0.2, 0, 0]}))
    control.reset()
    control.command(far)
    assert control.stiffness == pytest.approx(400 * 1300 / 900, rel=0.03)


def test_a_map_on_a_mesh() -> None:
    ticks = np.linspace(-0.02, 0.02, 9)
    x, y = (part.ravel() for part in np.meshgrid(ticks, ticks, indexing="ij"))
    vertices = np.column_stack([x, y, np.zeros(81)])
    corner = np.array([9 * i + j for i in range(8) for j in range(8)])
    faces = np.vstack(
        [np.column_stack([corner, corner + 9, corner + 10]), np.column_stack([corner, corner + 10, corner + 1])]
    )
    probes = tuple(
        Probe(v, np.array([stiffness(v[0], v[1]), 8.0, 0.5]), np.diag([25.0, 1e-4, 1e-4])) for v in vertices[::2]
    )
    grown = PropertyMap(Mesh(vertices, faces), KV, probes)
    rendering = HapticRendering(grown, HapticSettings(mass=0.2))
    rendering.command(np.array([0.01, -0.005, 1e-3]), np.zeros(3))
    found = rendering.command(np.array([0.01, -0.005, -2e-3]), np.zeros(3))
    assert found.force[2] == pytest.approx(stiffness(0.01, -0.005) * 2e-3, rel=0.05)
    with pytest.raises(InputError, match="mesh"):
        AdaptiveImpedance(Impedance(Gains(), Target(np.eye(3), np.zeros(3)), np.full(7, 100.0)), grown)


def test_what_is_no_map() -> None:
    for bad, words in ((7, "PropertyMap.read"), ("map.parquet", "PropertyMap.read")):
        with pytest.raises(InputError, match=words):
            Measured(bad)  # type: ignore[arg-type]
    with pytest.raises(InputError, match="unknown 'stiffest'"):
        Measured(measured(), unknown="stiffest")  # type: ignore[arg-type]
    with pytest.raises(InputError, match="holds stiffness"):
        Measured(measured((Property("hardness", "1"), *KV[1:])))
    with pytest.raises(InputError, match="a map"):
        HapticRendering(PropertyMap)  # type: ignore[arg-type]
    assert isinstance(HapticRendering(measured(), HapticSettings(surface=Plane())).surface, Plane)
