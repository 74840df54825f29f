"""Maps in other programs' formats, read by independent readers and compared number by number."""

from __future__ import annotations

import io
import json
import xml.etree.ElementTree as ET

import mujoco
import numpy as np
import pytest
import trimesh

from kinid.errors import InputError
from kinid.mapping.export import IMPEDANCE, cells_of, export, patches, to_mujoco
from kinid.mapping.property_map import Probe, Property, PropertyMap
from kinid.robotics.surface import Mesh, Plane

# a surface that stands upright: x is its normal
AXES = np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [1.0, 0.0, 0.0]])


def made(axes=AXES):
    ticks = np.linspace(-0.04, 0.04, 5)
    plane = Plane(np.array([0.5, 0.0, 0.3]), axes)
    probes = [
        Probe(
            plane.point + x * axes[0] + y * axes[1],
            np.array([500 + 5000 * (x + 0.04), 8.0, 0.6]),
            np.diag([1.0, 1e-4, 1e-6]),
        )
        for x in ticks
        for y in ticks
    ]
    return PropertyMap(
        plane, (Property("stiffness", "N/m"), Property("damping", "N·s/m"), Property("friction", "1")), tuple(probes)
    )


@pytest.fixture(scope="module")
def exported(tmp_path_factory):
    folder = tmp_path_factory.mktemp("worlds")
    return folder, patches(made(), 8), export(made(), folder, 8)


def test_mujoco_reads_it(exported):
    folder, cells, _ = exported
    model = mujoco.MjModel.from_xml_path(str(folder / "map.xml"))
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    n = len(cells.centres)
    assert model.ngeom == n + 1
    assert np.allclose(-model.geom_solref[:n, 0] / (1 - IMPEDANCE), cells.values[:, 0], rtol=1e-6)
    assert np.allclose(-model.geom_solref[:n, 1] / (1 - IMPEDANCE), cells.values[:, 1], rtol=1e-6)
    assert np.allclose(model.geom_friction[:n, 0], cells.values[:, 2], rtol=1e-5)
    tops = data.geom_xpos + model.geom_size[:, 2:] * data.geom_xmat.reshape(-1, 3, 3)[:, :, 2]
    assert np.allclose(tops[:n], cells.centres, atol=1e-7)
    # the floor lies right under all of them, in their plane
    under = (tops[n] - cells.centres) @ AXES.T
    assert np.allclose(under[:, 2], -cells.thick, atol=1e-7)
    reach = model.geom_size[n, :2] - np.abs(under[:, :2])
    assert np.allclose(reach.min(axis=0), cells.half[0], atol=1e-7)


@pytest.mark.parametrize("count", [6, 20])
def test_nothing_falls_through(count):
    """A heavy small ball goes through soft patches that are narrower than it is deep; the floor stops it."""
    cells, radius = patches(made(np.eye(3)), count), 0.004
    middle = cells.centres.mean(axis=0)
    x, y, z = cells.centres[np.linalg.norm(cells.centres - middle, axis=1).argmin()]
    shape = f'<geom type="sphere" size="{radius}" mass="1"/>'
    ball = f'<body pos="{x} {y} {z + radius}"><freejoint/>{shape}</body></worldbody>'
    model = mujoco.MjModel.from_xml_string(to_mujoco(cells).replace("</worldbody>", ball))
    data = mujoco.MjData(model)
    for _ in range(6000):
        mujoco.mj_step(model, data)
    assert z - cells.thick - radius < data.xpos[-1, 2] < z + radius


def test_a_weight_in_mujoco_sinks_as_deep_as_the_stiffness_says():
    flat = made(np.eye(3))
    cells = patches(flat, 3)  # wider than the ball: a body that touches several patches feels them all
    i = len(cells.centres) // 2
    x, y, z = cells.centres[i]
    ball = f'<body pos="{x} {y} {z + 0.0105}">'
    ball += '<joint type="slide" axis="0 0 1"/><geom type="sphere" size="0.01" mass="1"/></body></worldbody>'
    model = mujoco.MjModel.from_xml_string(to_mujoco(cells).replace("</worldbody>", ball))
    model.opt.gravity[:] = 0, 0, -2.0
    data = mujoco.MjData(model)
    for _ in range(8000):
        mujoco.mj_step(model, data)
    depth = z + 0.01 - data.xpos[-1, 2]
    # the solver's own tolerance
    assert depth == pytest.approx(2.0 / cells.values[i, 0], rel=0.01)


@pytest.mark.parametrize("cell", [0.004, 0.011, 0.02, 0.03])
def test_patches_are_as_wide_as_asked(cell):
    cells = patches(made(), cells_of(made(), cell))
    assert 2 * cells.half.min() >= cell * (1 - 1e-6)
    assert 2 * cells.half.min() < 2 * cell


def test_patches_without_a_size_are_refused():
    for cell in (0.0, -1.0, float("nan"), 1.0):
        with pytest.raises(InputError, match="half the map's longer side"):
            cells_of(made(), cell)
    ball = trimesh.creation.icosphere(subdivisions=1, radius=0.05)
    mesh = Mesh(np.asarray(ball.vertices), np.asarray(ball.faces))
    probe = Probe(mesh.vertices[0], np.array([1000.0]), np.eye(1))
    with pytest.raises(InputError, match="on a mesh"):
        cells_of(PropertyMap(mesh, (Property("stiffness", "N/m"),), (probe,)), 0.01)


def test_a_disk_that_is_full_is_left_without_a_folder(tmp_path, monkeypatch):
    def full(*_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("os.replace", full)
    for out in (tmp_path / "new" / "worlds", tmp_path):
        with pytest.raises(InputError, match="No space left"):
            export(made(), out, 8)
    assert not list(tmp_path.iterdir())


def test_sdf_holds_the_same_numbers(exported):
    folder, cells, _ = exported
    collisions = ET.parse(folder / "map.sdf").getroot().findall("./model/link/collision")
    assert len(collisions) == len(cells.centres)
    for item, (k, c, mu) in zip(collisions, cells.values):
        assert float(item.findtext("./surface/contact/ode/kp")) == pytest.approx(k, rel=1e-6)
        assert float(item.findtext("./surface/contact/ode/kd")) == pytest.approx(c, rel=1e-6)
        assert float(item.findtext("./surface/friction/ode/mu")) == pytest.approx(mu, rel=1e-6)
    from scipy.spatial.transform import Rotation

    pose = np.array(collisions[0].findtext("pose").split(), dtype=float)
    turn = Rotation.from_euler("xyz", pose[3:]).as_matrix()  # fixed axes, as SDF has it
    assert np.allclose(turn, AXES.T, atol=1e-7)
    assert np.allclose(pose[:3] + 0.01 * turn[:, 2], cells.centres[0], atol=1e-7)


def test_gltf_png_and_json_are_read_back(exported):
    folder, cells, paths = exported
    mesh = trimesh.load(io.BytesIO((folder / "map.glb").read_bytes()), file_type="glb", force="mesh", process=False)
    assert len(mesh.faces) == 2 * len(cells.centres)
    middle = mesh.vertices.reshape(-1, 4, 3).mean(axis=1)
    assert np.allclose(np.column_stack([middle[:, 0], -middle[:, 2], middle[:, 1]]), cells.centres, atol=1e-6)
    image = pytest.importorskip("PIL.Image")
    about = json.loads((folder / "map.json").read_text(encoding="utf-8"))
    for k, role in enumerate(("stiffness", "damping", "friction")):
        facts = about["properties"][role]
        grey = np.asarray(image.open(folder / facts["image"])).astype(float)
        value = facts["low"] + (grey - 1) / 65534 * (facts["high"] - facts["low"])
        step = (facts["high"] - facts["low"]) / 65534
        assert np.allclose(value[tuple(cells.cells.T)], cells.values[:, k], atol=step + 1e-12)
    assert {p.name for p in paths} == {
        "map.xml",
        "map.sdf",
        "map.glb",
        "map.json",
        "stiffness.png",
        "damping.png",
        "friction.png",
    }


def test_a_mesh_is_a_patch_a_face(tmp_path):
    """A ball, stiffer at its top: read back by MuJoCo, SDF's XML and trimesh, every patch on the ball with its face's
    value.
    """
    ball = trimesh.creation.icosphere(subdivisions=2, radius=0.05)
    mesh = Mesh(np.asarray(ball.vertices), np.asarray(ball.faces), source="ball.stl")
    probes = tuple(Probe(p, np.array([1000 + 1e4 * p[2], 8.0]), np.diag([1.0, 1e-4])) for p in mesh.vertices)
    ball_map = PropertyMap(mesh, (Property("stiffness", "N/m"), Property("damping", "N·s/m")), probes)
    export(ball_map, tmp_path)
    facts = json.loads((tmp_path / "map.json").read_text(encoding="utf-8"))
    centres, stiffness = np.array(facts["centres"]), np.array(facts["properties"]["stiffness"]["values"])
    assert len(centres) == len(facts["faces"]) == len(mesh.faces)
    assert np.allclose(stiffness, 1000 + 1e4 * centres[:, 2], rtol=0.03)
    assert "friction" in facts["assumed"]
    model = mujoco.MjModel.from_xml_path(str(tmp_path / "map.xml"))
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    tops = data.geom_xpos + data.geom_xmat.reshape(-1, 3, 3)[:, :, 2] * model.geom_size[:, 2:]
    assert np.allclose(tops, centres, atol=1e-6)
    assert np.allclose(-model.geom_solref[:, 0] / (1 - IMPEDANCE), stiffness, rtol=1e-6)
    kp = [float(item.text) for item in ET.parse(tmp_path / "map.sdf").iter("kp")]
    assert np.allclose(kp, stiffness, rtol=1e-6)
    shape = trimesh.load(tmp_path / "map.glb", force="mesh")
    assert shape.area == pytest.approx(ball.area, rel=1e-4)
    assert not list(tmp_path.glob("*.png"))
    # where nobody touched it there are no patches
    half = PropertyMap(mesh, ball_map.properties, tuple(p for p in probes if p.place[2] > 0.01))
    assert patches(half).centres[:, 2].min() > -0.02
