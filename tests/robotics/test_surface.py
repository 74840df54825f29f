"""Planes and meshes as surfaces: where points lie, what files load, and what is refused."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from kinid.data.rig import Rig, surface_axes
from kinid.errors import InputError
from kinid.robotics.surface import Mesh, Plane, Surface, load

BOX = trimesh.creation.box((0.2, 0.1, 0.05))


def rig(folder, **surface) -> Rig:
    return Rig.parse({"surface": surface}, folder=folder)


def mesh(shape: trimesh.Trimesh, **more) -> Mesh:
    return Mesh(np.asarray(shape.vertices), np.asarray(shape.faces), **more)


def points(count: int = 200, seed: int = 0) -> np.ndarray:
    return np.random.default_rng(seed).uniform(-0.12, 0.12, (count, 3))


def test_no_surface_in_the_rig():
    assert load(Rig()) is None


def test_plane_of_a_rig():
    surface = load(Rig.parse({"surface": {"point": [0.5, 0, 0.1], "normal": [0, 0, 2], "tangent": [0, 1, 0.5]}}))
    assert isinstance(surface, Plane)
    assert surface.notes == ()
    found = surface.locate([[0.6, 0.2, 0.07], [0.4, 0, 0.3]])
    assert found.depth == pytest.approx([0.03, -0.2], abs=1e-15)
    assert found.closest == pytest.approx(np.array([[0.6, 0.2, 0.1], [0.4, 0, 0.1]]), abs=1e-15)
    assert found.gradient == pytest.approx(np.tile([0, 0, 1.0], (2, 1)), abs=1e-15)
    assert found.axes[1] == pytest.approx(np.array([[0, 1, 0], [-1, 0, 0], [0, 0, 1.0]]), abs=1e-15)


@given(turn=st.integers(0, 1000), shift=st.tuples(*[st.floats(-1, 1)] * 3))
@settings(max_examples=40, deadline=None)
def test_plane_anywhere(turn, shift):
    axes = Rotation.random(random_state=turn).as_matrix()
    local = points(20, turn)
    found = Plane(np.array(shift), axes).locate(local @ axes + shift)
    # rounding of coordinates of a metre
    assert found.depth == pytest.approx(-local[:, 2], abs=1e-15)
    assert (found.closest - shift) @ axes.T == pytest.approx(local * [1, 1, 0], abs=1e-15)


def test_plane_of_axes_that_are_none():
    with pytest.raises(ValueError, match="orthonormal"):
        Plane(np.zeros(3), np.ones((3, 3)))
    with pytest.raises(ValueError, match="orthonormal"):
        Plane(np.zeros(3), np.diag([1.0, 1.0, -1.0]))


@pytest.mark.parametrize("surface", [Plane(np.zeros(3), np.eye(3)), mesh(BOX)], ids=["plane", "mesh"])
def test_points_that_are_not_finite(surface: Surface):
    where = points(5)
    where[1, 0] = np.nan
    found = surface.locate(where)
    for array in (found.depth, found.gradient, found.axes, found.closest):
        assert np.isnan(array[1]).all()
        assert np.isfinite(array[[0, 2, 3, 4]]).all()


def test_surfaces_are_read_only_and_leave_their_makers_arrays_alone():
    vertices, faces = np.array(BOX.vertices), np.array(BOX.faces)
    made = Mesh(vertices, faces)
    with pytest.raises(ValueError, match="read-only"):
        made.vertices[0] = 1
    vertices[:], faces[:] = 0, 0
    assert made.locate([[0, 0, 0.03]]).depth == pytest.approx([-0.005], abs=1e-15)
    with pytest.raises(AttributeError):
        made.edge_radius = 1.0


def test_a_flat_mesh_is_a_plane():
    axes = surface_axes((1, 2, 3), (0, 1, 0))
    corners = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1], [0.1, 0.2]]) @ axes[:2] + [0.1, 0.2, 0.3]
    sheet = Mesh(corners, [[0, 1, 4], [1, 2, 4], [2, 3, 4], [3, 0, 4]], tangent=np.array([0, 1.0, 0]))
    plane = Plane(np.array([0.1, 0.2, 0.3]), axes)
    where = points() + [0.1, 0.2, 0.3]
    one, other = sheet.locate(where), plane.locate(where)
    # rounding; the normal comes from cross products of edges of a metre
    for name in ("depth", "gradient", "axes", "closest"):
        assert getattr(one, name) == pytest.approx(getattr(other, name), abs=1e-14), name
    assert "not closed (4 open edges)" in sheet.notes[0]


def test_box_is_its_analytic_distance():
    where = np.vstack([points(400), 0.4 * points(400, 1)])
    found = mesh(BOX).locate(where)
    over = np.abs(where) - [0.1, 0.05, 0.025]
    distance = np.linalg.norm(np.maximum(over, 0), axis=1) + np.minimum(over.max(axis=1), 0)
    assert found.depth == pytest.approx(-distance, abs=1e-15)
    assert (found.depth > 0).sum() > 50
    # depth and gradient lead to the closest point, where the depth is zero
    assert where + found.depth[:, None] * found.gradient == pytest.approx(found.closest, abs=1e-14)


def test_gradient_gives_the_rate_of_the_depth():
    ball = mesh(trimesh.creation.icosphere(subdivisions=3, radius=0.1))
    t = np.linspace(0, 1, 20_001)
    path = np.column_stack([0.11 * np.cos(t), 0.105 * np.sin(t), 0.09 * t])
    velocity = np.column_stack([-0.11 * np.sin(t), 0.105 * np.cos(t), np.full_like(t, 0.09)])
    found = ball.locate(path)
    rate = -np.sum(found.gradient * velocity, axis=1)
    # the trapezoidal rule over steps of 5e-5 s; a crease within a step costs a tenth of it times 0.01 m/s at most
    assert np.diff(found.depth) / np.diff(t) == pytest.approx(0.5 * (rate[1:] + rate[:-1]), abs=1e-2)
    assert np.sum(0.5 * (rate[1:] + rate[:-1]) * np.diff(t)) == pytest.approx(
        found.depth[-1] - found.depth[0], abs=1e-7
    )


@pytest.mark.parametrize("tangent", [None, (1, 2, 0.5), (0, 0, 1)])
def test_axes_on_a_mesh_are_orthonormal_and_follow_the_tangent(tangent):
    wanted = None if tangent is None else np.array(tangent, dtype=float)
    ball = mesh(trimesh.creation.icosphere(subdivisions=2, radius=0.1), tangent=wanted)
    # the poles of the tangent fields too
    where = np.vstack([points(300), *(s * 0.11 * np.array([np.eye(3)[0], tangent or (1, 0, 0)]) for s in (1, -1))])
    axes = ball.locate(where).axes
    assert axes @ axes.transpose(0, 2, 1) == pytest.approx(np.tile(np.eye(3), (len(where), 1, 1)), abs=1e-12)
    assert np.linalg.det(axes) == pytest.approx(1.0, abs=1e-12)
    wanted = np.array([1.0, 0, 0]) if wanted is None else wanted / np.linalg.norm(wanted)
    usual = np.abs(axes[:, 2] @ wanted) < (0.9 if tangent is None else 0.999)
    assert 0.6 < usual.mean() < 1.0  # few are at a pole, some are
    # in the plane of the wanted tangent and the normal, on the wanted one's side
    assert np.sum(axes[:, 1] * wanted, axis=1)[usual] == pytest.approx(0.0, abs=1e-12)
    assert (np.sum(axes[:, 0] * wanted, axis=1)[usual] > 0).all()


@pytest.mark.parametrize("tangent", [(0, 0, 1), (1, 0, 0), (0.3, 0, -4)])
def test_a_tangent_along_the_normal_gives_way(tangent):
    normal = np.array(tangent) / np.linalg.norm(tangent)
    sheet = Mesh([*surface_axes(normal)[:2], [0, 0, 0]], [[0, 1, 2]], tangent=np.array(tangent, dtype=float))
    frame = sheet.locate([normal]).axes[0]
    assert frame @ frame.T == pytest.approx(np.eye(3), abs=1e-12)
    assert frame[2] == pytest.approx(normal, abs=1e-12)


def test_axes_on_a_mesh_are_those_of_a_plane_with_its_normal():
    axes = mesh(trimesh.creation.icosphere(subdivisions=2, radius=0.1)).locate(points(300)).axes
    for frame in axes:
        assert frame == pytest.approx(surface_axes(frame[2]), abs=1e-12)


@pytest.mark.parametrize("kind", ["stl", "obj", "ply", "ascii.stl", "STL"])
def test_loads_a_mesh_beside_the_rig(tmp_path, kind):
    shape = BOX.copy()
    shape.vertices += [0.5, 0.0, 0.1]
    if kind == "obj":  # corners with a normal for each face: split in the file, one on the surface
        shape.unmerge_vertices()
    form = {"ascii.stl": "stl_ascii", "STL": "stl"}.get(kind, kind)
    (tmp_path / "parts").mkdir()
    shape.export(tmp_path / "parts" / f"box.{kind}", file_type=form)
    surface = load(rig(tmp_path, mesh=f"parts/box.{kind}", edge_radius=2e-3, tangent=[0, 1, 0]))
    assert isinstance(surface, Mesh)
    assert len(surface.vertices) == 8
    assert surface.notes == ()
    found = surface.locate([[0.52, 0.01, 0.12], [0.5, 0.0, 0.2], [0.5, 0.05 - 1e-3, 0.2]])
    # STL files hold single precision, 3e-8 m at half a metre
    assert found.depth[:2] == pytest.approx([0.005, -0.075], abs=1e-7)
    assert found.axes[1] == pytest.approx(np.array([[0, 1, 0], [-1, 0, 0], [0, 0, 1.0]]), abs=1e-6)
    # half of the wanted radius away from the edge at y = 0.05 the side's normal counts half
    assert found.axes[2, 2] == pytest.approx(np.array([0, 0.5, 1]) / np.sqrt(1.25), abs=1e-4)


#: an octahedron: every second face touches three of the others
OCTAHEDRON = trimesh.Trimesh(
    0.1 * np.vstack([np.eye(3), -np.eye(3)]),
    [[0, 1, 2], [0, 5, 1], [3, 2, 1], [3, 1, 5], [0, 2, 4], [0, 4, 5], [3, 4, 2], [3, 5, 4]],
    process=False,
)


def fan(chain: list[int]) -> list[list[int]]:
    """Triangles without an area between a chain of vertices on a straight edge and the edge as a whole."""
    if len(chain) < 3:
        return []
    middle = len(chain) // 2
    return [[chain[0], chain[-1], chain[middle]], *fan(chain[: middle + 1]), *fan(chain[middle:])]


def with_slivers(more: int, noise: float) -> tuple[np.ndarray, np.ndarray]:
    """The octahedron with more vertices on all edges, which every second face has only by slivers."""
    vertices, faces = list(OCTAHEDRON.vertices), []
    draw, chains = np.random.default_rng(0), {}
    for a, b in OCTAHEDRON.edges_unique.tolist():
        for spot in np.linspace(vertices[a], vertices[b], 2 * more + 2)[1:-1:2]:  # none in the middle
            vertices.append(spot + noise * draw.normal(size=3))
        chains[a, b] = [a, *range(len(vertices) - more, len(vertices)), b]
        chains[b, a] = chains[a, b][::-1]
    for face in OCTAHEDRON.faces.tolist():
        edges = [chains[edge] for edge in zip(face, face[1:] + face[:1])]
        if np.prod(OCTAHEDRON.vertices[face].sum(axis=0)) > 0:
            vertices.append(OCTAHEDRON.vertices[face].mean(axis=0))
            faces += [[*pair, len(vertices) - 1] for edge in edges for pair in zip(edge[:-1], edge[1:])]
        else:
            faces += [face, *(sliver for edge in edges for sliver in fan(edge[::-1]))]
    return np.array(vertices), np.array(faces)


@pytest.mark.parametrize("noise", [0.0, 1e-9, 2e-8])
@pytest.mark.parametrize("more", [1, 2, 7])
def test_slivers_are_turned_away_and_leave_no_slit(more, noise):
    vertices, faces = with_slivers(more, noise)
    cleaned = Mesh(vertices, faces)
    assert cleaned.notes == ()
    assert len(cleaned.faces) == len(faces)
    corners = cleaned.vertices[cleaned.faces]
    assert np.linalg.norm(np.cross(*np.diff(corners, axis=1).swapaxes(0, 1)), axis=1).min() > 1e-5
    where = np.vstack([points(500), vertices + 1e-3 * np.random.default_rng(1).normal(size=vertices.shape)])
    wanted = mesh(OCTAHEDRON).locate(where).depth
    assert cleaned.locate(where).depth == pytest.approx(wanted, abs=4 * noise + 1e-15)


@pytest.mark.parametrize("noise", [0.0, 1e-9, 2e-8])
@pytest.mark.parametrize("more", [1, 2])
def test_slivers_leave_no_trace_in_the_smooth_normal(more, noise):
    # near the middles of edges, clear of the new corners
    middles = np.repeat(OCTAHEDRON.vertices[OCTAHEDRON.edges_unique].mean(axis=1), 30, axis=0)
    near = middles + 4e-4 * np.random.default_rng(1).normal(size=middles.shape)
    one = Mesh(*with_slivers(more, noise)).locate(near).axes[:, 2]
    other = mesh(OCTAHEDRON).locate(near).axes[:, 2]
    turning = np.abs(np.abs(other) - 1 / np.sqrt(3)).max(axis=1) > 0.05
    assert turning.mean() > 0.5
    # the noise, over the 1 mm that the turn takes and over the tens of mm that the triangles are wide
    assert one == pytest.approx(other, abs=1e4 * noise + 1e-9)


def test_vertices_closer_than_rounding_are_one():
    draw = np.random.default_rng(0)
    soup = BOX.vertices[BOX.faces].reshape(-1, 3)  # as in an STL file, each face with its own corners
    surface = Mesh(soup + 1e-8 * draw.uniform(-1, 1, soup.shape), np.arange(36).reshape(-1, 3))
    assert len(surface.vertices) == 8
    assert surface.notes == ()


def test_faces_that_say_nothing_are_dropped():
    faces = np.vstack([BOX.faces, BOX.faces[:2, [1, 2, 0]], [[3, 3, 5]]])  # two again, one without an area
    surface = Mesh(np.vstack([BOX.vertices, [[9, 9, 9]]]), faces)  # and a vertex of no face
    assert len(surface.faces) == 12
    assert len(surface.vertices) == 8
    assert surface.notes == ()


def test_notes():
    open_box = trimesh.Trimesh(BOX.vertices, BOX.faces[2:], process=False)
    assert "not closed" in mesh(open_box, source="lid.stl").notes[0]
    assert "lid.stl" in mesh(open_box, source="lid.stl").notes[0]
    wide = trimesh.creation.box((200, 100, 50))
    assert "mm" in mesh(wide).notes[0]
    fin = np.vstack([BOX.faces, [[*BOX.faces[0, :2][::-1], 8]]])  # a third face on an edge
    assert any("more than two faces" in note for note in Mesh(np.vstack([BOX.vertices, [[0, 0, 1]]]), fin).notes)


def test_a_sheet_has_its_material_behind_it():
    sheet = Mesh([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0.0]], [[0, 1, 2], [0, 2, 3]])
    found = sheet.locate([[0.1, 0.2, -0.01], [0.1, 0.2, 0.01]])
    assert found.depth == pytest.approx([0.01, -0.01], abs=1e-15)
    assert found.gradient == pytest.approx(np.tile([0, 0, 1.0], (2, 1)), abs=1e-15)


@pytest.mark.parametrize(
    ("vertices", "faces", "says"),
    [
        (BOX.vertices, BOX.faces[:, ::-1], "inside out"),
        (BOX.vertices, np.vstack([BOX.faces[:1, ::-1], BOX.faces[1:]]), "wound against each other"),
        (BOX.vertices, np.zeros((0, 3)), "no triangles"),
        (np.zeros((0, 3)), BOX.faces, "no triangles"),
        (BOX.vertices * np.nan, BOX.faces, "not numbers"),
        (BOX.vertices[:5], BOX.faces, "absent"),
        ([[0, 0, 0], [1, 0, 0], [2, 0, 0]], [[0, 1, 2]], "without an area"),
        (np.ones((3, 3)), [[0, 1, 2]], "without an area"),
    ],
)
def test_refuses_a_mesh_that_is_no_surface(vertices, faces, says):
    with pytest.raises(InputError, match=says) as caught:
        Mesh(vertices, faces, source="part.stl")
    assert "part.stl" in str(caught.value)


def test_asks_to_flip_a_mesh_that_is_inside_out():
    with pytest.raises(InputError) as caught:
        Mesh(BOX.vertices + [5, 0, 0], BOX.faces[:, ::-1])
    assert "flip" in caught.value.mend


@pytest.mark.parametrize(
    ("name", "content", "says"),
    [
        ("absent.stl", None, "no readable mesh"),
        ("part.step", b"ISO-10303-21;", "one of .stl, .obj, .ply"),
        ("empty.stl", b"", "no triangles"),
        ("empty.ply", b"", "can't be read as PLY"),
        ("text.stl", b"hello", "no triangles"),
        ("points.obj", b"v 0 0 0\nv 1 0 0\nv 0 1 0\n", "no triangles"),
        ("far.obj", b"v 0 0 0\nf 1 2 3\n", "far.obj"),
        ("nan.obj", b"v nan 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n", "not numbers"),
        ("cut.stl", b"\0" * 80 + b"\x0c\0\0\0" + b"\0" * 70, "cut.stl"),
        ("huge.stl", b"\0" * 80 + b"\xff\xff\xff\x7f" + b"\0" * 50, "huge.stl"),
        (
            "inf.stl",
            b"\0" * 80 + b"\1\0\0\0" + np.float32([0, 0, 1, np.inf, 0, 0, 1, 0, 0, 0, 1, 0]).tobytes() + b"\0\0",
            "not numbers",
        ),
        ("zero\0.stl", None, "name of a file"),
        ("folder.stl/", None, "no readable mesh"),
    ],
)
def test_refuses_a_file_that_holds_no_mesh(tmp_path, name, content, says, capfd):
    if content is not None:
        (tmp_path / name).write_bytes(content)
    elif name.endswith("/"):
        (tmp_path / name).mkdir()
    with pytest.raises(InputError) as caught:
        load(rig(tmp_path, mesh=name))
    assert says in str(caught.value)
    assert "\n" not in str(caught.value)
    assert capfd.readouterr().err == ""


@pytest.mark.parametrize("name", ["../out.stl", "{folder}/out.stl", "parts/../../out.stl", "link.stl"])
def test_a_mesh_stays_in_the_folder_of_its_rig(tmp_path, name):
    BOX.export(tmp_path / "out.stl")
    inner = tmp_path / "inner"
    (inner / "parts").mkdir(parents=True)
    (inner / "link.stl").symlink_to(tmp_path / "out.stl")
    with pytest.raises(InputError, match="leaves the rig's folder"):
        load(rig(inner, mesh=name.format(folder=tmp_path)))


def test_an_obj_file_reads_no_other_file(tmp_path, monkeypatch):
    asked = []
    monkeypatch.setattr(trimesh.resolvers.FilePathResolver, "get", lambda self, name: asked.append(name))
    (tmp_path / "inner").mkdir()
    (tmp_path / "secret.mtl").write_text("newmtl a\nmap_Kd /dev/null\n")
    text = "mtllib ../secret.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nusemtl a\nf 1 2 3\n"
    (tmp_path / "inner" / "part.obj").write_text(text)
    assert len(load(rig(tmp_path / "inner", mesh="part.obj")).faces) == 1
    assert asked == []


def test_a_rig_with_a_mesh_and_a_plane(tmp_path):
    BOX.export(tmp_path / "box.stl")
    with pytest.raises(InputError, match="both a normal and a mesh"):
        load(rig(tmp_path, mesh="box.stl", point=[0, 0, 0], normal=[0, 0, 1]))
    assert isinstance(load(rig(tmp_path, mesh="box.stl", point=[0, 0, 0])), Mesh)


def test_a_missing_mesh_names_those_that_are_there(tmp_path):
    rig = Rig.parse({"surface": {"mesh": "parts/prt.stl"}}, folder=tmp_path)
    with pytest.raises(InputError, match="there is no folder"):
        load(rig)
    (tmp_path / "parts").mkdir()
    with pytest.raises(InputError, match="holds no mesh"):
        load(rig)
    (tmp_path / "parts" / "part.stl").write_bytes(b"")
    with pytest.raises(InputError, match=r"did you mean 'part\.stl'"):
        load(rig)
