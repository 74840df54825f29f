"""rig.toml: what it means, and what is said when something in it can't be."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from kinid.data.rig import Rig, surface_axes
from kinid.errors import InputError

EXAMPLE = """
[robot]
model = "lwr4plus"
sensor_frame = "ft_sensor"
tip_frame = "tool_tip"
gravity = [0.0, 0.0, -9.81]
joints = ["joint_1", "joint_2"]
compliance = [[1e-4, 0, 0], [0, 1e-4, 0], [0, 0, 2e-4]]

[tool]
mass = 0.24
com = [0.0, 0.0, 0.049]
inertia = [0.4, 0.5, 0.6, 0.01, 0.02, 0.03]

[surface]
point = [0.55, 0.0, 0.10]
normal = [0, 0, 1]
tangent = [1, 0, 0]

[sensor]
range = [40, 40, 120, 2, 2, 2]
noise = [0.015, 0.014, 0.029, 0.0005, 0.0006, 0.0003]
bias = [1, 2, 3, 0.4, 0.5, 0.6]
wrench_frame = "base"

[columns]
depth = { column = 2, unit = "mm" }
q = { columns = ["a", "b"], unit = "deg" }
tau3 = { column = "current", unit = "A", scale = 31.4, offset = -0.2 }

[streams]
joints = "/joint_states"
wrench = "/wrench"
reference = "joints"
max_gap = 0.02
wrench_clock_offset = -0.004
"""


def load(folder: Path, text: str) -> Rig:
    (folder / "rig.toml").write_text(text, encoding="utf-8")
    return Rig.load(folder / "rig.toml")


def refused(folder: Path, text: str) -> InputError:
    """The message, which is one line and has its three parts."""
    with pytest.raises(InputError) as caught:
        load(folder, text)
    error = caught.value
    message = str(error)
    assert len(message.splitlines()) == 1
    assert message == f"found {error.found}; expected {error.expected}; to mend it, {error.mend}"
    assert error.found
    assert error.expected
    assert error.mend
    for jargon in ("pydantic", "Input should", "Value error", "RobotSpec", "ColumnSpec", "instance of", "Traceback"):
        assert jargon not in message, message
    assert len(message) < 500, message
    return error


def test_everything_that_may_stand_in_a_rig(tmp_path: Path) -> None:
    rig = load(tmp_path, EXAMPLE)
    assert rig.robot is not None
    assert rig.tool is not None
    assert rig.surface is not None
    assert rig.robot.joints == ("joint_1", "joint_2")
    assert rig.robot.compliance is not None
    assert rig.robot.compliance[2] == (0.0, 0.0, 2e-4)
    np.testing.assert_array_equal(rig.tool.inertia_matrix, [[0.4, 0.01, 0.02], [0.01, 0.5, 0.03], [0.02, 0.03, 0.6]])
    assert rig.sensor.wrench_frame == "base"
    assert rig.columns["depth"].column == 2
    assert rig.columns["q"].columns == ("a", "b")
    assert rig.columns["tau3"].offset == -0.2
    assert rig.streams.wrench_clock_offset == -0.004
    assert rig.folder == tmp_path


def test_every_table_is_optional(tmp_path: Path) -> None:
    rig = load(tmp_path, "")
    assert rig.robot is None
    assert rig.tool is None
    assert rig.surface is None
    assert rig.axes is None
    assert rig.sensor.wrench_frame == "sensor"
    assert rig.columns == {}


def test_defaults(tmp_path: Path) -> None:
    rig = load(tmp_path, '[robot]\nmodel = "ur5"\n[tool]\nmass = 1\n')
    assert rig.robot is not None
    assert rig.tool is not None
    assert rig.robot.gravity == (0.0, 0.0, -9.81)
    assert rig.robot.sensor_frame is None
    assert rig.tool.com == (0.0, 0.0, 0.0)
    assert not rig.tool.inertia_matrix.any()


def test_a_rig_can_not_be_changed(tmp_path: Path) -> None:
    rig = load(tmp_path, EXAMPLE)
    with pytest.raises(Exception, match="frozen"):
        rig.tool = None


@pytest.mark.parametrize(
    ("text", "found", "expected"),
    [
        # values that can't be
        ("[tool]\nmass = -1", "[tool] mass = -1", "greater than or equal to 0"),
        ("[tool]\nmass = nan", "[tool] mass = nan", "finite"),
        ("[tool]\nmass = inf", "[tool] mass = inf", "finite"),
        ('[tool]\nmass = "heavy"', "[tool] mass = 'heavy'", "number"),
        ("[tool]\nmass = 1\ncom = [0, 0]", "[tool] com = [0, 0]", "a list of 3"),
        ("[tool]\nmass = 1\ncom = [0, 0, 0, 0]", "[tool] com = [0, 0, 0, 0]", "a list of 3"),
        ("[tool]\nmass = 1\ncom = [0, nan, 0]", "com", "finite numbers"),
        ("[tool]\nmass = 1\ninertia = [1, 2, 3]", "[tool] inertia = [1, 2, 3]", "a list of 6"),
        ("[tool]\nmass = 1\ninertia = [1, 1, 9, 0, 0, 0]", "inertia", "an inertia that a body can have"),
        ("[tool]\nmass = 1\ncom = [0, 0, 49]", "com", "within 2 m"),
        ("[columns]\nfx = { scale = 0 }", "scale", "not zero"),
        ('[robot]\nmodel = "ur5"\ngravity = [0, 0, inf]', "gravity", "finite numbers"),
        ("[robot]\nmodel = 5", "[robot] model = 5", "string"),
        ('[robot]\nmodel = "x"\njoints = "joint_1"', "joints = 'joint_1'", "a list"),
        (
            '[robot]\nmodel = "x"\ncompliance = [[1, 0, 0], [0, 1, 0]]',
            "compliance = [[1, 0, 0], [0, 1, 0]]",
            "a list of 3",
        ),
        # surfaces that are none
        ("[surface]\npoint = [0, 0, 0]\nnormal = [0, 0, 0]", "normal", "not of zero length"),
        ("[surface]\npoint = [0, 0, 0]\nnormal = [0, 0, 1]\ntangent = [0, 0, 0]", "tangent", "not of zero length"),
        ("[surface]\npoint = [0, 0, 0]\nnormal = [0, 0, 1]\ntangent = [0, 0, -3]", "[surface]", "not parallel"),
        ("[surface]\npoint = [0, 0, 0]\nnormal = [0, 0, nan]", "normal", "finite numbers"),
        ("[surface]\nnormal = [0, 0, 1]", "[surface]", "a plane (point and normal) or a mesh"),
        ("[surface]\npoint = [0, 0, 1]", "[surface]", "a plane (point and normal) or a mesh"),
        ("[surface]\nedge_radius = 0.1", "[surface]", "a plane (point and normal) or a mesh"),
        ('[surface]\nmesh = "a.stl"\nedge_radius = 0', "edge_radius = 0", "greater than 0"),
        ('[surface]\nmesh = "a.stl"\nedge_radius = inf', "edge_radius = inf", "finite"),
        # sensors that are none
        ("[sensor]\nnoise = [1, 2, 3, 4, 5]", "noise = [1, 2, 3, 4, 5]", "a list of 6"),
        ("[sensor]\nnoise = [1, 2, 3, 4, 5, -6]", "noise", "not negative"),
        ("[sensor]\nrange = [1, 2, 3, 4, 5, 0]", "range", "positive"),
        (f"[sensor]\ncrosstalk = {[[0.0] * 6] * 6}", "crosstalk", "an invertible matrix"),
        (f"[sensor]\ncrosstalk = {np.diag([1, 1, 1, 1, 1, 1e-9]).tolist()}", "crosstalk", "an invertible matrix"),
        (f"[sensor]\ncrosstalk = {[[1.0] * 6] * 5}", "crosstalk = [[1.0,", "a list of 6"),
        ('[sensor]\nwrench_frame = "flange"', "wrench_frame = 'flange'", "'sensor' or 'base'"),
        # columns that are none
        ('[columns]\ndepht = { column = 2, unit = "mm" }', "", "'depth'"),
        ("[columns]\nq_0x = { column = 2 }", "", "a quantity of the log format"),
        ("[columns]\nforce = { columns = [1, 2, 3] }", "'force' in [columns]", "wrench = { columns = [fx, fy, fz, tx,"),
        ('[columns]\nvelocity = { column = 2, unit = "deg/s" }', "'velocity' in [columns]", "dq = { columns"),
        ("[columns]\nFx = { column = 2 }", "'Fx' in [columns]", "'fx'"),
        ('[columns]\nfx = { column = 2, unit = "m" }', "'fx' in [columns]", "a unit of fx"),
        ("[columns]\nfx1 = { column = 2 }", "", "'fx'"),
        ('[columns]\ndepth = { column = 2, unit = "mmm" }', "depth.unit = 'mmm'", "'mm'"),
        ('[columns]\nq = { column = "a", columns = ["b"] }', "q", "one of 'column', 'columns' and 'rate'"),
        ("[columns]\nq = { column = 1.5 }", "q.column = 1.5", "string"),
        ("[columns]\nq1 = { column = 1, scale = nan }", "q1.scale = nan", "finite"),
        ("[columns]\nq1 = { column = 1, offset = inf }", "q1.offset = inf", "finite"),
        ("[columns]\ndepth = 3", "depth = 3", "a table"),
        # streams that are none
        ("[streams]\nmax_gap = 0", "max_gap = 0", "greater than 0"),
        ("[streams]\nwrench_clock_offset = nan", "wrench_clock_offset = nan", "finite"),
        ('[streams]\nreference = "camera"', "reference = 'camera'", "'joints' or 'wrench'"),
        # tables that are none
        ('robot = "lwr4plus"', "'lwr4plus'", "a table"),
        ("surface = [1, 2]", "[1, 2]", "a table"),
        ("columns = 3", "3", "a table"),
    ],
)
def test_what_can_not_be_is_refused(tmp_path: Path, text: str, found: str, expected: str) -> None:
    error = refused(tmp_path, text)
    assert found in error.found, error
    assert expected in error.expected, error
    assert "rig.toml" in error.found


def test_a_table_that_is_true_is_no_column(tmp_path: Path) -> None:
    assert "[columns]" not in refused(tmp_path, "surface = true").found
    assert "'q' in [columns] of" in refused(tmp_path, '[columns]\nq = { unit = "N" }').found


@pytest.mark.parametrize(
    ("text", "found", "mend"),
    [
        ('[robot]\nmodel = "x"\ntip_fram = "t"', "unknown key 'tip_fram' in [robot]", "did you mean 'tip_frame'"),
        ("[tool]\nmass = 1\nweight = 2", "unknown key 'weight' in [tool]", "valid names: 'com', 'inertia', 'mass'"),
        ("[tol]\nmass = 1", "unknown key 'tol'", "did you mean 'tool'?"),
        ("[sensor]\ncrostalk = 1", "unknown key 'crostalk' in [sensor]", "did you mean 'crosstalk'?"),
        ("[surface]\npoint = [0,0,0]\nnormal = [0,0,1]\ntangent1 = [1,0,0]", "'tangent1' in [surface]", "'tangent'"),
        ('[columns]\ndepth = { column = 2, units = "mm" }', "'units' in [columns]", "did you mean 'unit'"),
        ('[streams]\ntopic = "/j"', "unknown key 'topic' in [streams]", "valid names:"),
        ("mass = 3", "unknown key 'mass' in the rig", "valid names:"),
    ],
)
def test_unknown_keys_are_refused_with_near_ones(tmp_path: Path, text: str, found: str, mend: str) -> None:
    error = refused(tmp_path, text)
    assert found in error.found
    assert mend in error.mend
    assert "folder" not in error.mend


def test_a_missing_key_is_named(tmp_path: Path) -> None:
    error = refused(tmp_path, "[tool]\ncom = [0, 0, 0]")
    assert "no 'mass' in [tool]" in error.found
    assert refused(tmp_path, "[robot]\ntip_frame = 'x'").found.startswith("no 'model' in [robot]")


def test_more_problems_are_counted(tmp_path: Path) -> None:
    assert "(and 1 more problem)" in refused(tmp_path, "[tool]\nmass = -1\nweight = 2").found
    error = refused(tmp_path, "[tool]\nmass = -1\nweight = 2\n[surface]\nnormal = [0, 0, 0]\n[sensor]\nnose = 1")
    assert "(and 3 more problems)" in error.found


def test_toml_that_is_none_is_refused_with_its_place(tmp_path: Path) -> None:
    error = refused(tmp_path, "[tool\nmass = 1")
    assert "line 1" in error.found
    assert error.expected == "valid TOML"
    refused(tmp_path, "[tool]\nmass = 1\nmass = 2")


def test_a_file_that_can_not_be_read(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"no readable rig at .*No such file"):
        Rig.load(tmp_path / "rig.toml")
    with pytest.raises(InputError, match="no readable rig"):
        Rig.load(tmp_path)
    (tmp_path / "rig.toml").write_bytes(b"\xff\xfe[\x00t")
    with pytest.raises(InputError, match="UTF-8"):
        Rig.load(tmp_path / "rig.toml")


def test_the_folder_is_not_for_the_file_to_say(tmp_path: Path) -> None:
    assert "folder" in refused(tmp_path, 'folder = "/etc"').found


def refusal(tables: dict[str, Any]) -> str | None:
    """The message, or None for a rig. Any other exception goes through."""
    try:
        Rig.parse(tables)
    except InputError as error:
        return str(error)
    return None


VALUES: st.SearchStrategy[Any] = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=8),
    lambda inner: st.lists(inner, max_size=7) | st.dictionaries(st.text(max_size=8), inner, max_size=4),
    max_leaves=8,
)
KEYS = (
    "model",
    "mass",
    "com",
    "point",
    "normal",
    "tangent",
    "mesh",
    "noise",
    "crosstalk",
    "bias",
    "column",
    "unit",
    "q",
)


@settings(max_examples=300, deadline=None)
@given(
    st.dictionaries(
        st.sampled_from(("robot", "tool", "surface", "sensor", "columns", "streams", "other")),
        st.dictionaries(st.sampled_from(KEYS), VALUES, max_size=4) | VALUES,
        max_size=3,
    )
)
def test_any_tables_are_a_rig_or_one_line(tables: dict[str, Any]) -> None:
    """Whatever stands there: never another exception, never a second line."""
    message = refusal(tables)
    assert message is None or (len(message.splitlines()) == 1 and len(message) < 600)


VECTOR = st.tuples(*[st.floats(-10, 10)] * 3).filter(lambda v: np.linalg.norm(v) > 0.1)


@given(normal=VECTOR, tangent=VECTOR | st.none())
def test_axes_are_right_handed_and_orthonormal(normal: Any, tangent: Any) -> None:
    if tangent is not None and np.linalg.norm(np.cross(normal, tangent)) < 1e-2:
        tangent = None
    axes = surface_axes(normal, tangent)
    np.testing.assert_allclose(axes @ axes.T, np.eye(3), atol=1e-12)
    assert np.linalg.det(axes) == pytest.approx(1.0, abs=1e-12)
    np.testing.assert_allclose(axes[2], np.array(normal) / np.linalg.norm(normal), atol=1e-12)
    if tangent is not None:
        # the first tangent leans to the wanted one and lies in its plane with the normal
        assert axes[0] @ tangent > 0
        assert abs(axes[1] @ tangent) < 1e-10


def test_axes_of_the_contract() -> None:
    np.testing.assert_array_equal(surface_axes([0, 0, 2], [1, 0, 0]), np.eye(3))
    np.testing.assert_array_equal(surface_axes([0, 0, 2]), np.eye(3))
    np.testing.assert_array_equal(surface_axes([5, 0, 0]), [[0, 1, 0], [0, 0, 1], [1, 0, 0]])
