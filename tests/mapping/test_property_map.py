"""The map as a thing of its own: it grows, it is written whole, and it comes back."""

from __future__ import annotations

import dataclasses
import threading

import numpy as np
import pyarrow as pa
import pytest
import trimesh
from pyarrow import parquet

from kinid.errors import InputError
from kinid.mapping import property_map
from kinid.mapping.map_file import is_map
from kinid.mapping.property_map import Probe, Property, PropertyMap
from kinid.robotics.surface import Mesh, Plane

AXES = np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [1.0, 0.0, 0.0]])
PROPERTIES = (Property("stiffness", "N/m"), Property("damping", "N·s/m"))


def probe(i: int, rng: np.random.Generator) -> Probe:
    root = rng.normal(size=(2, 2))
    place = np.array([0.5, *rng.uniform(-0.05, 0.05, 2)])
    return Probe(place, np.array([500.0 + i, 7.0]), root @ root.T, 0.03, 0.029, f"poke_{i}")


def test_what_is_written_comes_back(tmp_path):
    rng = np.random.default_rng(0)
    made = PropertyMap(Plane(np.array([0.5, 0.0, 0.0]), AXES), PROPERTIES, (), "kelvin-voigt").added(
        *(probe(i, rng) for i in range(5))
    )
    made.write(tmp_path / "a.parquet")
    back = PropertyMap.read(tmp_path / "a.parquet")
    assert is_map(tmp_path / "a.parquet")
    assert back.properties == PROPERTIES
    assert back.model == "kelvin-voigt"
    assert np.array_equal(back.places, made.places)
    for a, b in zip(back.probes, made.probes):
        assert np.array_equal(a.values, b.values)
        assert np.array_equal(a.covariance, b.covariance)
        assert (a.source, a.residual, a.noise) == (b.source, b.residual, b.noise)
    assert np.allclose(back.raised(back.flat(back.places)), back.places, atol=1e-15)


def test_a_mesh_travels_with_its_map(tmp_path):
    box = trimesh.creation.box((0.1, 0.1, 0.1))
    mesh = Mesh(np.asarray(box.vertices), np.asarray(box.faces), source="box.stl")
    PropertyMap(mesh, PROPERTIES, (Probe(np.array([0.05, 0, 0]), np.ones(2), np.eye(2)),)).write(tmp_path / "m.parquet")
    back = PropertyMap.read(tmp_path / "m.parquet").surface
    assert isinstance(back, Mesh)
    assert np.array_equal(back.vertices, mesh.vertices)
    assert np.array_equal(back.faces, mesh.faces)


def test_who_reads_while_it_grows_sees_a_whole_map(tmp_path):
    path, rng = tmp_path / "growing.parquet", np.random.default_rng(1)
    grown = PropertyMap(Plane(np.array([0.5, 0.0, 0.0]), AXES), PROPERTIES).added(probe(0, rng))
    grown.write(path)
    seen, failed, stop = [], [], threading.Event()

    def look():
        while not stop.is_set():
            try:
                seen.append(len(PropertyMap.read(path)))
            except Exception as error:
                failed.append(error)

    reader = threading.Thread(target=look)
    reader.start()
    for i in range(1, 60):
        grown = grown.added(probe(i, rng))
        grown.write(path)
    stop.set()
    reader.join()
    assert not failed
    assert seen == sorted(seen)
    assert len(PropertyMap.read(path)) == 60
    assert [f.name for f in tmp_path.iterdir()] == ["growing.parquet"]


def test_a_property_that_a_probe_leaves_open_is_not_used():
    rng = np.random.default_rng(2)
    probes = [probe(i, rng) for i in range(6)]
    open_ = Probe(probes[0].place + 1e-3, np.array([1e9, 7.0]), np.diag([np.inf, 1.0]))
    made = PropertyMap(Plane(np.array([0.5, 0.0, 0.0]), AXES), PROPERTIES, (*probes, open_))
    assert np.isnan(made.values("stiffness")[-1])
    assert made.interpolator("stiffness", "nearest").at(made.flat(open_.place[None])).mean[0] < 1000


def test_nonsense_is_refused(tmp_path):
    plane = Plane(np.array([0.5, 0.0, 0.0]), AXES)
    with pytest.raises(InputError, match="a probe with values"):
        PropertyMap(plane, PROPERTIES).added(Probe(np.zeros(3), np.ones(3), np.eye(3)))
    with pytest.raises(InputError, match="property 'hardness'"):
        PropertyMap(plane, PROPERTIES).values("hardness")
    (tmp_path / "no.parquet").write_bytes(b"not a table")
    with pytest.raises(InputError, match="no readable map"):
        PropertyMap.read(tmp_path / "no.parquet")
    assert not is_map(tmp_path / "no.parquet")
    with pytest.raises(InputError, match="ending in .parquet"):
        PropertyMap(plane, PROPERTIES).write(tmp_path / "m.csv")


def stored(values, covariance, place=(0.5, 0.0, 0.0)):
    plane = Plane(np.array([0.5, 0.0, 0.0]), AXES)
    probe = Probe(np.array(place), np.array(values, dtype=float), np.array(covariance, dtype=float), source="poke_9")
    return PropertyMap(plane, PROPERTIES).added(probe)


@pytest.mark.parametrize(
    ("values", "covariance", "found"),
    [
        ([np.nan, 7], np.eye(2), "stiffness nan of the probe poke_9"),
        ([np.inf, 7], np.eye(2), "stiffness inf"),
        ([500, 7], [[-1, 0], [0, 1]], "stiffness with variance -1"),
        ([500, 7], [[1, 0], [0, np.nan]], "damping with variance nan"),
        ([500, 7], [[1, 0.5], [0.2, 1]], "a covariance that is none"),
        ([500, 7], [[1, 2], [2, 1]], "a covariance that is none"),
        ([500, 7], [[1, np.nan], [np.nan, 1]], "a covariance that is none"),
        ([500, 7], [[1, np.inf], [np.inf, 1]], "a covariance that is none"),
        ([-500, 7], np.diag([100.0, 1]), "a stiffness of -500"),
    ],
)
def test_what_is_no_estimate_is_not_stored(values, covariance, found):
    with pytest.raises(InputError, match=found):
        stored(values, covariance)


@pytest.mark.parametrize("x", [np.nan, np.inf, 1e30])
def test_a_place_that_is_none_is_not_stored(x):
    with pytest.raises(InputError, match="three finite coordinates"):
        stored([500, 7], np.eye(2), (x, 0, 0))


@pytest.mark.parametrize("residual", [-1.0, np.inf])
def test_a_residual_that_is_none_is_not_stored(residual):
    probe = Probe(np.zeros(3), np.array([500.0]), np.eye(1), residual=residual)
    with pytest.raises(InputError, match="a residual of"):
        PropertyMap(Plane(np.zeros(3), np.eye(3)), (Property("stiffness", "N/m"),), (probe,))


def test_what_is_open_or_may_be_positive_is_stored():
    assert len(stored([-10, 7], np.diag([100.0, 1]))) == 1
    left_open = stored([np.nan, 7], [[np.inf, np.nan], [np.nan, 1]])
    assert np.isnan(left_open.values("stiffness")[0])
    assert left_open.values("damping")[0] == 7
    # rounding is no asymmetry
    assert len(stored([500, 7], [[4, 1], [1 + 1e-9, 1]])) == 1


@pytest.mark.parametrize(
    ("column", "values", "says"),
    [
        ("stiffness", [1e300], "stiffness = 1e\\+300"),
        ("stiffness", ["hard"], "no numbers"),
        ("stiffness", [True], "no numbers"),
        ("stiffness", [[1.0]], "no numbers"),
        ("cov.stiffness.stiffness", [1e300], "1e\\+300"),
        ("cov.stiffness.damping", ["a"], "no numbers"),
        ("x", [1e300], "x = 1e\\+300"),
    ],
)
def test_values_that_no_map_has_are_refused(column, values, says, tmp_path):
    path = tmp_path / "m.parquet"
    PropertyMap(Plane(np.zeros(3), AXES), PROPERTIES, (probe(0, np.random.default_rng(0)),)).write(path)
    table = parquet.read_table(path)
    parquet.write_table(table.set_column(table.column_names.index(column), column, pa.array(values)), path)
    with pytest.raises(InputError, match=says):
        PropertyMap.read(path)


@pytest.mark.parametrize(
    ("column", "change", "says"),
    [
        ("along1", lambda x: x + 0.01, "of different places"),
        ("x", lambda x: x + 10.0, "10 m off its plane"),
        ("noise", lambda x: x - 1.0, "a noise of -"),
    ],
)
def test_columns_that_contradict_each_other_are_refused(column, change, says, tmp_path):
    path = tmp_path / "m.parquet"
    rng = np.random.default_rng(0)
    PropertyMap(Plane(np.array([0.5, 0.0, 0.0]), AXES), PROPERTIES, tuple(probe(k, rng) for k in range(3))).write(path)
    table = parquet.read_table(path)
    changed = pa.array(change(np.nan_to_num(table[column].to_numpy())))
    parquet.write_table(table.set_column(table.column_names.index(column), column, changed), path)
    with pytest.raises(InputError, match=says):
        PropertyMap.read(path)


def test_a_unit_that_no_such_parameter_has_is_refused(tmp_path):
    path = tmp_path / "m.parquet"
    wrong = (Property("stiffness", "kg"), *PROPERTIES[1:])
    PropertyMap(Plane(np.array([0.5, 0.0, 0.0]), AXES), wrong, (probe(0, np.random.default_rng(0)),)).write(path)
    with pytest.raises(InputError, match="stiffness in kg"):
        PropertyMap.read(path)


def test_a_probe_that_stands_there_twice_is_refused(tmp_path):
    path = tmp_path / "m.parquet"
    one = dataclasses.replace(probe(0, np.random.default_rng(0)), digest="a" * 64)
    PropertyMap(Plane(np.array([0.5, 0.0, 0.0]), AXES), PROPERTIES, (one, one)).write(path)
    with pytest.raises(InputError, match="stands there twice"):
        PropertyMap.read(path)


def test_a_field_of_more_probes_than_can_be_is_refused(monkeypatch):
    monkeypatch.setattr(property_map, "MOST_PROBES", 2)
    rng = np.random.default_rng(0)
    made = PropertyMap(Plane(np.array([0.5, 0.0, 0.0]), AXES), PROPERTIES, tuple(probe(k, rng) for k in range(3)))
    with pytest.raises(InputError, match="3 probes of stiffness"):
        made.interpolator("stiffness")


@pytest.mark.parametrize(
    ("about", "says"),
    [
        (b'{"kind": ' + b"[" * 100_000 + b"]" * 100_000 + b"}", "levels deep"),
        (b'{"kind": "property map", "version": 1' + b"0" * 400 + b"}", "401 digits"),
        (b"[1]", "no property map"),
        (b"{", "no JSON"),
        (b"{}", "without kind"),
        (b'{"kind": "property map", "version": 1, "properties": [], "surface": null}', "a surface that is None"),
    ],
    ids=["deep", "long", "list", "cut", "empty", "no surface"],
)
def test_what_a_map_says_of_itself_has_limits(about, says, tmp_path):
    path = tmp_path / "m.parquet"
    PropertyMap(Plane(np.zeros(3), AXES), PROPERTIES, (probe(0, np.random.default_rng(0)),)).write(path)
    parquet.write_table(parquet.read_table(path).replace_schema_metadata({b"kinid": about}), path)
    assert is_map(path)  # it is no log, whatever is wrong with it
    with pytest.raises(InputError, match=says):
        PropertyMap.read(path)
