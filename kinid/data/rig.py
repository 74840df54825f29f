"""What was measured with what: `rig.toml`, validated once, with messages that a user can act on.

Lengths in m, angles in rad, mass in kg; vectors in the frame that the field's docstring names.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from functools import cached_property
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import AfterValidator, BaseModel, ConfigDict, Field, ValidationError, model_validator
from pydantic_core import PydanticCustomError

from kinid.data import plausible
from kinid.errors import InputError, expect, near
from kinid.inputs import parse_toml, read_text
from kinid.units import FACTORS, canonical, factor, near_units

Array = NDArray[np.float64]


def _finite(values: tuple[float, ...]) -> tuple[float, ...]:
    if not all(math.isfinite(v) for v in values):
        raise PydanticCustomError("finite", "finite numbers")
    return values


def _positive(values: tuple[float, ...]) -> tuple[float, ...]:
    if not all(v > 0 for v in values):
        raise PydanticCustomError("positive", "positive numbers")
    return values


def _not_negative(values: tuple[float, ...]) -> tuple[float, ...]:
    if not all(v >= 0 for v in values):
        raise PydanticCustomError("not_negative", "numbers that are not negative")
    return values


def _direction(values: tuple[float, float, float]) -> tuple[float, float, float]:
    if not 1e-9 <= math.hypot(*values) <= 1e9:
        raise PydanticCustomError("direction", "a direction, a vector that is not of zero length, nor beyond 1e9")
    return values


def _unit(unit: str) -> str:
    name = canonical(unit)
    if name not in FACTORS:
        raise PydanticCustomError("unit", "a unit that kinid knows ({near})", {"near": near_units(unit)})
    return name


Vec3 = Annotated[tuple[float, float, float], AfterValidator(_finite)]
Direction = Annotated[tuple[float, float, float], AfterValidator(_finite), AfterValidator(_direction)]
Vec6 = Annotated[tuple[float, float, float, float, float, float], AfterValidator(_finite)]
Finite = Annotated[float, Field(allow_inf_nan=False)]
Positive = Annotated[float, Field(gt=0, allow_inf_nan=False)]
Unit = Annotated[str, AfterValidator(_unit)]
Matrix3 = tuple[Vec3, Vec3, Vec3]
Matrix6 = Annotated[tuple[Vec6, Vec6, Vec6, Vec6, Vec6, Vec6], AfterValidator(plausible.crosstalk)]


class _Table(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid", strict=False)

    @model_validator(mode="before")
    @classmethod
    def _numbers(cls, value: object) -> object:
        return plausible.no_truth_values(value)


class RobotSpec(_Table):
    """The arm: a shipped name, an example-robot-data name, or a URDF path relative to the rig's file."""

    model: str
    sensor_frame: str | None = None  # frame whose axes the wrench is expressed in
    tip_frame: str | None = None  # the contact point
    gravity: Annotated[Vec3, AfterValidator(plausible.gravity)] = (0.0, 0.0, -9.81)  # [m/s²], base frame
    joints: tuple[str, ...] | None = None  # order of q1..qN in the log
    compliance: Annotated[Matrix3, AfterValidator(plausible.compliance)] | None = (
        None  # [m/N], base frame: where the tip goes under a force, beyond the joints
    )
    torques: Literal["measured", "external"] = "measured"  # external: the arm's own model is taken off tau already


class ToolSpec(_Table):
    """Everything beyond the sensor's measuring plane."""

    mass: Annotated[float, Field(ge=0, le=plausible.HEAVIEST, allow_inf_nan=False), AfterValidator(plausible.mass)]
    com: Vec3 = (0.0, 0.0, 0.0)  # [m], sensor frame
    inertia: Vec6 = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)  # [kg·m²] ixx iyy izz ixy ixz iyz about the com, sensor axes

    @model_validator(mode="after")
    def _possible(self) -> ToolSpec:
        if math.hypot(*self.com) > 2.0:
            raise PydanticCustomError("com", "a com within 2 m of the sensor, in m")
        plausible.inertia(self.mass, self.inertia_matrix)
        return self

    @property
    def inertia_matrix(self) -> Array:
        """Inertia about the com in sensor axes [kg·m²], (3, 3)."""
        xx, yy, zz, xy, xz, yz = self.inertia
        return np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])


class SurfaceSpec(_Table):
    """A plane in the base frame, or a triangle mesh; the normal points out of the material."""

    point: Annotated[Vec3, AfterValidator(plausible.within(plausible.FARTHEST, "a point"))] | None = None
    normal: Direction | None = None
    tangent: Direction | None = None
    mesh: str | None = None
    edge_radius: Positive = 1e-3  # [m] the normal turns smoothly within this distance of an edge
    offset_sd: Annotated[Positive, AfterValidator(plausible.within(plausible.LOOSEST, "a deviation in m"))] | None = (
        None  # [m] standard deviation of where it stands along its normal
    )
    tilt_sd: (
        Annotated[Positive, AfterValidator(plausible.within(plausible.MOST_TILTED, "a deviation in rad"))] | None
    ) = None  # [rad] standard deviation of its tilt about each tangent

    @model_validator(mode="after")
    def _plane_or_mesh(self) -> SurfaceSpec:
        if self.mesh is None and (self.point is None or self.normal is None):
            raise PydanticCustomError("surface", "a plane (point and normal) or a mesh")
        if self.normal is not None and self.tangent is not None:
            n, t = np.asarray(self.normal), np.asarray(self.tangent)
            if np.linalg.norm(np.cross(n, t)) < 1e-6 * np.linalg.norm(n) * np.linalg.norm(t):
                raise PydanticCustomError("surface", "a tangent that is not parallel to the normal")
        return self


class SensorSpec(_Table):
    """Known properties of the force/torque sensor, most as fx fy fz tx ty tz [N, N·m]."""

    range: Annotated[Vec6, AfterValidator(_positive)] | None = None
    noise: Annotated[Vec6, AfterValidator(_not_negative)] | None = None  # standard deviation at the log's rate
    bias: Annotated[Vec6, AfterValidator(plausible.within(plausible.MOST_BIAS, "a bias"))] | None = (
        None  # reading without any load
    )
    crosstalk: Matrix6 | None = None  # measured = crosstalk · true
    gain_sd: Annotated[Positive, AfterValidator(plausible.within(plausible.LOOSEST_GAIN, "a deviation"))] | None = (
        None  # standard deviation of its gain, as a share of 1
    )
    wrench_frame: Literal["sensor", "base"] = "sensor"  # axes that the log's wrench is expressed in

    @model_validator(mode="after")
    def _within_range(self) -> SensorSpec:
        plausible.inside_range("bias", self.bias, self.range)
        plausible.inside_range("noise", self.noise, self.range)
        return self

    @property
    def crosstalk_matrix(self) -> Array:
        """Measured = crosstalk · true, (6, 6); the identity where nothing is stated."""
        return np.eye(6) if self.crosstalk is None else np.asarray(self.crosstalk)

    @property
    def stated_bias(self) -> Array:
        """Reading without any load [N, N·m], (6,); zeros where nothing is stated."""
        return np.zeros(6) if self.bias is None else np.asarray(self.bias)


class ColumnSpec(_Table):
    """Where a quantity stands in a log with other names and units: SI value = (raw · scale) · unit + offset."""

    column: str | int | None = None
    columns: tuple[str | int, ...] | None = None  # for q, dq, ddq, tau, q_cmd, wrench: all their columns at once
    unit: Unit | None = None
    scale: Annotated[Finite, AfterValidator(plausible.within(plausible.MOST_SCALE, "a scale"))] = 1.0
    offset: Annotated[Finite, AfterValidator(plausible.within(plausible.MOST_OFFSET, "an offset"))] = 0.0
    rate: Positive | None = None  # [Hz], for t alone: rows come evenly, and no column holds the time

    @property
    def to_si(self) -> float:
        """SI units in one of the log's."""
        return self.scale * (factor(self.unit, "[columns]") if self.unit else 1.0)

    @model_validator(mode="after")
    def _one_source(self) -> ColumnSpec:
        if sum(source is not None for source in (self.column, self.columns, self.rate)) > 1:
            raise PydanticCustomError("columns", "one of 'column', 'columns' and 'rate'")
        if self.scale == 0.0:
            raise PydanticCustomError("scale", "a scale that is not zero")
        return self


class StreamsSpec(_Table):
    """Topics of a bag, and how streams with different rates and clocks come onto one clock."""

    joints: str | None = None  # topic of sensor_msgs/JointState
    wrench: str | None = None  # topic of geometry_msgs/WrenchStamped
    joint_commands: str | None = None  # topic of sensor_msgs/JointState with commanded positions
    reference: Literal["joints", "wrench"] | None = None  # whose clock the log keeps; default: the wrench's
    max_gap: Positive | None = None  # [s] samples further from a neighbour stay empty
    wrench_clock_offset: (
        Annotated[Finite, AfterValidator(plausible.within(plausible.MOST_CLOCK, "an offset"))] | None
    ) = None  # [s] added to the wrench's time stamps


#: quantities that `[columns]` may name: groups, single columns (with a number behind q, dq, …) and contact quantities
GROUPS = ("q", "dq", "ddq", "tau", "q_cmd", "wrench")
WRENCH = ("fx", "fy", "fz", "tx", "ty", "tz")
CONTACT = (
    "depth",
    "depth_rate",
    "slip1",
    "slip2",
    "slip_rate1",
    "slip_rate2",
    "normal_force",
    "tangential_force1",
    "tangential_force2",
)


#: what people call quantities of the log format otherwise
OTHER_WORDS = {
    "wrench": ("force", "forces", "torque", "torques", "moment", "moments", "ft"),
    "t": ("time", "timestamp", "stamp"),
    "q": ("position", "positions", "angle", "angles", "joints"),
    "dq": ("velocity", "velocities", "qd", "speed"),
    "ddq": ("acceleration", "accelerations", "qdd"),
    "tau": ("effort", "efforts", "joint_torque", "joint_torques"),
}


def _meant(name: str, valid: Sequence[str]) -> str:
    """What a name that is no quantity stands for, as a line of [columns] where people use it for one."""
    said = next((quantity for quantity, words in OTHER_WORDS.items() if name.lower() in words), None)
    if said == "wrench":
        return "the sensor's six are wrench = { columns = [fx, fy, fz, tx, ty, tz] }, one along the normal normal_force"
    if said == "t":
        return "it is t = { column = … }"
    return f"it is {said} = {{ columns = [one a joint] }}" if said else near(name, valid)


def _known_quantity(name: str) -> bool:
    stem = name.rstrip("0123456789")
    return name in (*GROUPS, *WRENCH, *CONTACT, "t", "phase") or (stem in GROUPS[:5] and stem != name)


class Rig(_Table):
    """What was measured with what. Every table is optional; a command says when it needs one that is absent."""

    robot: RobotSpec | None = None
    tool: ToolSpec | None = None
    surface: SurfaceSpec | None = None
    sensor: SensorSpec = SensorSpec()
    columns: dict[str, ColumnSpec] = Field(default_factory=dict)
    streams: StreamsSpec = StreamsSpec()
    folder: Path = Field(default_factory=Path.cwd, exclude=True)  # what relative paths are relative to

    @model_validator(mode="after")
    def _columns_known(self) -> Rig:
        for name, spec in self.columns.items():
            if spec.rate is not None and name != "t":
                raise PydanticCustomError("rate", "a rate for t alone", {"name": name})
            if not _known_quantity(name):
                valid = (*GROUPS, *WRENCH, *CONTACT, "t", "phase", "q1", "dq1", "ddq1", "tau1", "q_cmd1")
                raise PydanticCustomError(
                    "quantity",
                    "a quantity of the log format ({near})",
                    {"name": name, "near": _meant(name, valid)},
                )
            plausible.kind_of_unit(name, spec.unit, "scale" in spec.model_fields_set)
        return self

    @property
    def surface_sd(self) -> tuple[float, float]:
        """How well the surface is known along its normal [m] and in its tilt [rad], as standard deviations.

        0 where nothing is stated.
        """
        return (0.0, 0.0) if self.surface is None else (self.surface.offset_sd or 0.0, self.surface.tilt_sd or 0.0)

    def __repr__(self) -> str:
        parts = [] if self.robot is None else [self.robot.model]
        parts += [name for name in ("tool", "surface") if getattr(self, name) is not None]
        parts += ["sensor bias"] if self.sensor.bias is not None else []
        return f"<Rig of {', '.join(parts) or 'a log that says everything itself'}>"

    @classmethod
    def load(cls, path: str | Path) -> Rig:
        """Read and validate a rig.toml.

        Raises:
            InputError: the file is absent, is not TOML, or holds something that can't be a rig.
        """
        expect(path, (str, Path), "a rig", "the path of a rig.toml", "name the file")
        path = Path(path)
        text = read_text(path, "rig", "a rig.toml", "name it with --rig, or put rig.toml beside the log")
        return cls.parse_text(text, folder=path.parent, where=str(path))

    @classmethod
    def parse_text(cls, text: str, folder: str | Path = ".", where: str = "the rig") -> Rig:
        """Validate the text of a rig.toml; relative paths in it are relative to `folder`."""
        return cls.parse(parse_toml(text, where, "the tables of a rig"), folder=folder, where=where)

    @classmethod
    def parse(cls, tables: Mapping[str, object], folder: str | Path = ".", where: str = "the rig") -> Rig:
        """Validate tables as they stand in a rig.toml; relative paths in them are relative to `folder`."""
        if "folder" in tables:
            raise InputError(f"'folder' in {where}", "the tables of a rig", "remove it: paths are relative to the file")
        try:
            return cls.model_validate({**tables, "folder": Path(folder)})
        except ValidationError as error:
            raise _as_input_error(error, where, cls) from None

    @property
    def external_torques(self) -> bool:
        """Whether the arm's own model is taken off the logged joint torques already."""
        return self.robot is not None and self.robot.torques == "external"

    @property
    def carried(self) -> ToolSpec:
        """The tool; one without mass where none is stated."""
        return self.tool or ToolSpec(mass=0.0)

    @cached_property
    def axes(self) -> Array | None:
        """Rows tangent1, tangent2, normal of a plane surface in the base frame, (3, 3); None without a plane."""
        if self.surface is None or self.surface.normal is None:
            return None
        return surface_axes(self.surface.normal, self.surface.tangent)


def surface_axes(normal: Sequence[float], tangent: Sequence[float] | None = None) -> Array:
    """Orthonormal rows tangent1, tangent2 = normal × tangent1, normal; the first is along x where none is given."""
    n = np.asarray(normal, dtype=float) / np.linalg.norm(normal)
    if tangent is None:
        tangent = (1.0, 0.0, 0.0) if abs(n[0]) < 0.9 else (0.0, 1.0, 0.0)
    t1 = np.asarray(tangent, dtype=float)
    t1 = t1 - (t1 @ n) * n
    t1 /= np.linalg.norm(t1)
    return np.stack([t1, np.cross(n, t1), n])


def _as_input_error(error: ValidationError, where: str, rig: type[Rig]) -> InputError:
    """One line from pydantic's list: the first thing that is wrong, and how many more there are."""
    # a key that is misspelt explains one that is missing
    errors = sorted(error.errors(), key=lambda e: e["type"] != "extra_forbidden")
    first, more = errors[0], error.error_count() - 1
    # "str" and "int" are no keys but the alternatives that pydantic tried
    place = [str(part) for part in first["loc"] if part not in ("folder", "str", "int")]
    table = f"[{place[0]}]" if place else "the tables"
    shown = ".".join(place[1:]) if len(place) > 1 else ""
    given = first["input"]
    if len(place) == 1 and (field := first.get("ctx", {}).get("field")) is not None:  # of the whole table, one line
        shown, given = field, given[field]
    value = repr(given)
    value = value if len(value) <= 60 else value[:57] + "..."
    tail = f" (and {more} more problem{'s' if more > 1 else ''})" if more else ""
    if first["type"] == "extra_forbidden":
        field = rig.model_fields.get(place[0])
        owner = _spec_of(field.annotation) if field and len(place) > 1 else rig
        names = [n for n in owner.model_fields if n != "folder"]
        found = f"unknown key '{place[-1]}' in {table if len(place) > 1 else 'the rig'} of {where}{tail}"
        return InputError(found, "a key of the rig format", near(place[-1], names))
    if first["type"] in ("missing", "too_long") and (length := _length(error)) is not None:
        name = shown.rpartition(".")[0] if first["type"] == "missing" else shown
        return InputError(
            f"{table} {name} = {value} in {where}{tail}", f"a list of {length}", "correct that line of the rig"
        )
    if first["type"] == "missing":
        return InputError(f"no '{place[-1]}' in {table} of {where}{tail}", f"{table} {place[-1]}", "add that line")
    expected = _PLAIN.get(first["type"]) or first["msg"].removeprefix("Input should be ")
    found = f"{table} {shown + ' = ' if shown else ''}{value} in {where}{tail}"
    if not place and "name" in first.get("ctx", {}):  # of the whole rig, one name is what is wrong
        name = first["ctx"]["name"]
        found = f"'{name}' in {'' if name in rig.model_fields else '[columns] of '}{where}{tail}"
    return InputError(found, expected, "correct that line of the rig")


#: pydantic's words for what TOML calls otherwise, by the type of its error
_PLAIN = {
    "model_type": "a table",
    "dict_type": "a table",
    "tuple_type": "a list",
    "list_type": "a list",
    "finite_number": "a finite number",
}


def _length(error: ValidationError) -> int | None:
    """How long the list should be that the first problem says has too few or too many entries."""
    first = error.errors()[0]
    if first["type"] == "too_long":
        return int(first["ctx"]["max_length"])
    *before, last = first["loc"]
    if not isinstance(last, int):
        return None
    here = [e["loc"][-1] for e in error.errors() if list(e["loc"][:-1]) == before and isinstance(e["loc"][-1], int)]
    return 1 + max(int(index) for index in here)


def _spec_of(annotation: object) -> type[BaseModel]:
    for candidate in (annotation, *getattr(annotation, "__args__", ())):
        if isinstance(candidate, type) and issubclass(candidate, BaseModel):
            return candidate
    return Rig
