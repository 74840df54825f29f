"""A planned motion of a robot: joints, tip, phases and expected force over time, and how it is kept on disk."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from kinid.data.log import frozen
from kinid.data.readers._guard import readable
from kinid.errors import InputError
from kinid.inputs import check_regular, parse_json
from kinid.writers import TABLE_SUFFIXES, Json, write_table

Array = NDArray[np.float64]
Columns = dict[str, NDArray[np.generic]]

KIND, VERSION = "trajectory", 1


@dataclass(frozen=True, eq=False)
class Trajectory:
    """Samples at an even rate; arrays are read-only. Joints are in the order of `joint_names`, which is the log's.

    Attributes:
        t: [s], (n,). phase: free, approach, hold, poke, slide, retract, rest, (n,).
        q, dq, ddq: joints, their velocities and accelerations, (n, N).
        tip: base frame [m], (n, 3). place: slip1, slip2, depth [m] where there is a surface, (n, 3), or None.
        force: expected of the material on the tool, base axes [N], (n, 3). normal_force: along the normal [N], (n,);
            both NaN where no model was given and the tip is in the material.
        force_limit: the motion stops and retracts where the measured normal force passes this [N], (n,); infinite: no
            guard.
        touch: number of the touch that a sample belongs to, from 0, (n,).
        joint_names: (N,). provenance: what was asked for, limits and how much of each is used.
    """

    t: Array
    phase: NDArray[np.str_]
    q: Array
    dq: Array
    ddq: Array
    tip: Array
    joint_names: tuple[str, ...]
    place: Array | None = None
    force: Array | None = None
    normal_force: Array | None = None
    force_limit: Array | None = None
    touch: NDArray[np.int64] | None = None
    provenance: Json = field(default_factory=dict)

    def __post_init__(self) -> None:
        n, joints = len(self.t), len(self.joint_names)
        shapes = {
            "t": (n,),
            "q": (n, joints),
            "dq": (n, joints),
            "ddq": (n, joints),
            "tip": (n, 3),
            "place": (n, 3),
            "force": (n, 3),
            "normal_force": (n,),
            "force_limit": (n,),
        }
        for name, shape in shapes.items():
            value = getattr(self, name)
            if value is None:
                continue
            if np.shape(value) != shape:
                raise ValueError(f"{name} of shape {np.shape(value)}, not {shape}")
            object.__setattr__(self, name, frozen(value))
        if len(self.phase) != n:
            raise ValueError(f"{len(self.phase)} phases for {n} samples")
        for name in ("phase", "touch"):
            if getattr(self, name) is not None:
                values = np.array(getattr(self, name))
                values.setflags(write=False)
                object.__setattr__(self, name, values)
        if n < 2 or not (np.diff(self.t) > 0).all():
            raise ValueError("a trajectory has two samples or more, at rising times")

    def __len__(self) -> int:
        return len(self.t)

    @property
    def duration(self) -> float:
        """[s]"""
        return float(self.t[-1] - self.t[0])

    def columns(self) -> Columns:
        """The table: t, phase, q1…, dq1…, ddq1…, tip_x tip_y tip_z, and what else is known."""
        out: Columns = {"t": self.t, "phase": self.phase}
        for name in ("q", "dq", "ddq"):
            out |= {f"{name}{j + 1}": getattr(self, name)[:, j] for j in range(len(self.joint_names))}
        out |= {f"tip_{axis}": self.tip[:, i] for i, axis in enumerate("xyz")}
        if self.place is not None:
            out |= {name: self.place[:, i] for i, name in enumerate(("slip1", "slip2", "depth"))}
        if self.force is not None:
            out |= {f"expected_force_{axis}": self.force[:, i] for i, axis in enumerate("xyz")}
        if self.normal_force is not None:
            out["expected_normal_force"] = self.normal_force
        if self.force_limit is not None:
            out["force_limit"] = self.force_limit
        if self.touch is not None:
            out["touch"] = self.touch
        return out

    def write(self, path: Path) -> None:
        """Write as Parquet (with provenance), CSV or NPZ, whole or not at all."""
        facts = {"kind": KIND, "version": VERSION, "joint_names": list(self.joint_names), **self.provenance}
        write_table(path, self.columns(), facts)


#: no time stamp, angle, speed, acceleration or force of a motion is larger, in SI units; and none lasts longer [s]
LARGEST, LONGEST = 1e10, 1e6


def read_trajectory(path: Path, joint_names: tuple[str, ...] | None = None) -> Trajectory:
    """A trajectory from a table that `Trajectory.write`, or anyone, wrote: t and q1…qN at least.

    Velocities and accelerations that are absent are those of a spline of fifth degree through the positions.

    Args:
        path: Parquet, CSV or NPZ. joint_names: of its joints, where the file doesn't say.

    Raises:
        InputError: not a table, or not a trajectory.
    """
    table, facts = _table(path)
    count = 0
    while f"q{count + 1}" in table:
        count += 1
    if "t" not in table or not count:
        raise InputError(
            f"{path} with the columns {', '.join(list(table)[:8]) or 'none'}",
            "a trajectory: t, q1…qN",
            "name a trajectory, as of kinid plan poke -o PLAN.parquet",
        )
    names = facts.get("joint_names") or joint_names or [f"joint_{j + 1}" for j in range(count)]
    if not isinstance(names, list | tuple) or not all(isinstance(name, str) for name in names):
        raise InputError(f"joint_names = {str(names)[:60]} in {path}", "a list of names", "plan it again")
    if len(names) != count:
        raise InputError(
            f"{count} joints in {path}", f"{len(names)}: {', '.join(names)}", "choose the rig that it was planned for"
        )

    def block(*columns: str) -> Array | None:
        if any(name not in table for name in columns):
            return None
        return np.stack([_numbers(table, name, path) for name in columns], axis=1)

    t, q = _numbers(table, "t", path), block(*(f"q{j + 1}" for j in range(count)))
    assert q is not None
    numbers = np.isfinite(q).all() and np.isfinite(t).all()
    if len(t) < 6 or not numbers or not (np.diff(t) > 0).all() or t[-1] - t[0] > LONGEST:
        raise InputError(
            f"{path} with {len(t)} samples, times that don't rise, or joints that are no numbers",
            f"at least 6 samples at rising times, over {LONGEST:g} s at most",
            "repair the table",
        )
    dq, ddq = (block(*(f"{name}{j + 1}" for j in range(count))) for name in ("dq", "ddq"))
    if dq is None or ddq is None:
        from scipy.interpolate import make_interp_spline

        spline = make_interp_spline(t, q, k=5)
        dq, ddq = spline(t, 1), spline(t, 2)
    single = {
        name: _numbers(table, name, path) if name in table else None
        for name in ("expected_normal_force", "force_limit")
    }
    tip = block("tip_x", "tip_y", "tip_z")
    phase = np.array([str(word) for word in table["phase"]] if "phase" in table else ["motion"] * len(t), dtype=np.str_)
    return Trajectory(
        t,
        phase,
        q,
        dq,
        ddq,
        np.full((len(t), 3), np.nan) if tip is None else tip,
        tuple(names),
        block("slip1", "slip2", "depth"),
        block("expected_force_x", "expected_force_y", "expected_force_z"),
        single["expected_normal_force"],
        single["force_limit"],
        _touch(table, path),
        {k: v for k, v in facts.items() if k not in ("kind", "version", "joint_names")},
    )


def _touch(table: Columns, path: Path) -> NDArray[np.int64] | None:
    """The touch that each sample belongs to, (n,); None where the table doesn't say.

    Raises:
        InputError: values that are absent, or no numbers.
    """
    if "touch" not in table:
        return None
    touch = _numbers(table, "touch", path)
    if not np.isfinite(touch).all():
        raise InputError(f"a column touch in {path} with no numbers in it", "numbers of touches", "repair the table")
    return touch.astype(np.int64)


def _numbers(table: Columns, name: str, path: Path) -> Array:
    """A column of numbers that a motion can have, (n,); absent values are let through."""
    try:
        values = np.asarray(table[name], dtype=float)
    except (TypeError, ValueError):
        raise InputError(f"a column {name} of no numbers in {path}", "numbers", "repair the table") from None
    if values.ndim != 1 or (np.abs(values[np.isfinite(values)]) > LARGEST).any():
        raise InputError(
            f"a column {name} in {path} of lists, or of more than {LARGEST:g}", "s, rad, m and N", "repair the table"
        )
    return values


def read_columns(path: Path) -> Columns:
    """The columns of a Parquet, CSV or NPZ table."""
    return _table(path)[0]


def _table(path: Path) -> tuple[Columns, Json]:
    """Columns of a file, and its provenance."""
    check_regular(path, "table", "a table as Parquet, CSV or NPZ", "copy it into a file")
    if not path.is_file():
        raise InputError(f"no file {path}", "a table as Parquet, CSV or NPZ", "check its name")
    if path.suffix.lower() not in TABLE_SUFFIXES:
        raise InputError(f"table '{path.name}'", f"a name ending in {', '.join(TABLE_SUFFIXES)}", "convert it")
    with readable(path, "a table", "write it again"):
        columns, meta = _columns(path)
    facts = parse_json(meta, f"provenance in {path}", "a trajectory of kinid", "plan it again", open_ends=True)
    if not isinstance(facts, dict):
        raise InputError(f"a provenance in {path} that is a list", "an object", "plan it again")
    if len({np.shape(values)[:1] for values in columns.values()}) > 1:
        raise InputError(f"columns of differing lengths in {path}", "a value a sample in each", "write it again")
    return columns, facts


def _columns(path: Path) -> tuple[Columns, bytes]:
    """The columns of a file, whatever they are, and what it says of itself."""
    suffix = path.suffix.lower()
    if suffix == ".npz":
        with path.open("rb") as file, np.load(file, allow_pickle=False) as archive:
            return dict(archive), b"{}"
    if suffix == ".csv":
        from pyarrow import csv

        table = csv.read_csv(path)
    else:
        from pyarrow import parquet

        table = parquet.read_table(path)
    meta: bytes = (table.schema.metadata or {}).get(b"kinid", b"{}")
    return {name: table[name].to_numpy() for name in table.column_names}, meta
