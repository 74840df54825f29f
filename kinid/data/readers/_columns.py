"""From a table with the user's names and units to a `Log`: which column is which quantity, in SI."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from kinid.data.log import Array, Log, Provenance, Step
from kinid.data.readers._cells import Column, numbers, seconds, words
from kinid.data.rig import CONTACT, GROUPS, WRENCH, ColumnSpec, Rig
from kinid.data.streams import apart
from kinid.errors import InputError, near
from kinid.signal.pieces import finite_rows

Arrays = list[Column]
#: a rate and the times of the rows are one where they differ by this share, at most
RATE_KNOWN = 0.1
JOINT_GROUPS = tuple(g for g in GROUPS if g != "wrench")
#: columns of a table that `kinid contact` wrote from a log: names and units are the format's, whatever the log's were
CONTACT_TABLE = frozenset(("t", *CONTACT, "in_contact"))


@dataclass(frozen=True)
class Table:
    """Columns that can be read.

    Attributes:
        source: path, for messages.
        kind: name of the format.
        names: of the columns; None without a header.
        width: number of columns.
        blocks: positions of columns that are 2-D arrays, one row a sample.
        load: arrays of the columns at the given positions, one list after the other, so that a list can be
            released before the next is read.
    """

    source: str
    kind: str
    names: tuple[str, ...] | None
    width: int
    blocks: frozenset[int]
    load: Callable[[Sequence[Sequence[int]]], Iterator[Arrays]]

    def label(self, position: int) -> str:
        """Name of a column, or its number without a header."""
        return self.names[position] if self.names is not None else str(position)

    def position(self, key: str | int, where: str) -> int:
        """Position of the column that the rig calls by name, or by number counted from 0.

        Raises:
            InputError: there is none, or there are two of the name.
        """
        if isinstance(key, int):
            if 0 <= key < self.width:
                return key
            found = f"column {key} for {where}, and {self.width} columns in {self.source}"
            raise InputError(found, f"a number from 0 to {self.width - 1}", "correct [columns] of the rig")
        if self.names is None:
            found = f"column '{key}' for {where}, and no header in {self.source}"
            raise InputError(found, f"a number from 0 to {self.width - 1}", "number columns in [columns]")
        count = self.names.count(key)
        if count == 1:
            return self.names.index(key)
        if count:
            raise InputError(
                f"{count} columns '{key}' in {self.source}",
                "one column of the name",
                "name it by its number, counted from 0, in [columns]",
            )
        found = f"no column '{key}' for {where} in {self.source}"
        raise InputError(found, "a column of the log", self.suggest(key))

    def suggest(self, key: str) -> str:
        """What a message offers instead of a name that is absent."""
        return near(key, self.names) if self.names else f"number one of its {self.width} columns, from 0"


class _Source(NamedTuple):
    """One column of a quantity: where it stands, and how it becomes SI."""

    position: int
    spec: ColumnSpec


Plan = dict[str, list[_Source]]


def to_log(table: Table, rig: Rig, joints: Sequence[str] | None = None) -> Log:
    """Read the columns that the log format and the rig name.

    Args:
        table: columns of a file.
        rig: [columns] maps other names and units, but those of a table that `kinid contact` wrote.
        joints: names of the joints, for their number where the rig names only the first of their columns.

    Raises:
        InputError: no time, a column that the rig names and the table lacks, a hole in the numbers of joints,
            cells that are no numbers, columns of differing length, no row that has all quantities, or what `Log`
            refuses.
    """
    ours = frozenset(table.names or ()) >= CONTACT_TABLE
    if ours:
        rig = rig.model_copy(update={"columns": {}})
    plan = _plan(table, rig, joints)
    facts = _facts(table, plan)
    loaded = table.load([[s.position for s in sources] for sources in plan.values()])
    t: Array | None = None
    phase = None
    joined: dict[str, Array] = {}
    contact: dict[str, Array] = {}
    n = 0
    for (quantity, sources), arrays in zip(plan.items(), loaded):
        labels = [table.label(s.position) for s in sources]
        if quantity == "t":
            t, origin = seconds(arrays[0], sources[0].spec, table.source, labels[0])
            n = len(t)
            _check_rate(t, sources[0].spec.rate, table.source, labels[0])
            facts |= {"rows": n} | ({"time_origin": origin} if origin is not None else {})
            continue
        if t is None:  # rows that come evenly: the first quantity tells how many
            n = len(arrays[0])
            t = np.arange(n) / (rig.columns["t"].rate or 1.0)
            facts |= {"rows": n, "time_from_rate_hz": rig.columns["t"].rate}
        shapes = [a.shape for a in arrays if a.shape[:1] != (n,)]
        if shapes:
            found = f"{quantity} of shape {shapes[0]} beside {n} times in {table.source}"
            raise InputError(found, f"{n} rows", "write arrays with one row a sample")
        if quantity == "phase":
            phase = words(arrays[0])
        else:
            values = _fill(arrays, sources, labels, table.source, n)
            if ours and not np.isfinite(values).any():  # unknown in the log, and written all the same
                continue
            if quantity in CONTACT:
                contact[quantity] = values if values.shape[1] > 1 else values[:, 0]
            else:
                joined[quantity] = values
        arrays.clear()
    assert t is not None
    log = Log(t, contact=contact, phase=phase, provenance=Provenance(table.source), **joined)  # type: ignore[arg-type]
    _check_joints(log, rig, table.source)
    facts |= {"invalid_rows": int((~log.valid).sum())}
    return replace(log, provenance=log.provenance.after(Step("read", facts, _apart(log))))


def _apart(log: Log) -> tuple[str, ...]:
    """A doubt where joints or readings begin late or end early beside the others of a table.

    Raises:
        InputError: no row has all of them.
    """
    if log.valid.all():
        return ()
    groups = {
        name: finite_rows(values) for name in (*JOINT_GROUPS, "wrench") if (values := getattr(log, name)) is not None
    }
    groups |= {name: np.isfinite(values) for name, values in log.contact.items()}
    spans = {name: (log.t[rows][0], log.t[rows][-1]) for name, rows in groups.items() if rows.any()}
    if len(spans) < len(groups):  # what is empty throughout is said where it is needed
        return ()
    if not log.valid.any():
        shown = " and ".join(f"{name} from {a:.4g} to {b:.4g} s" for name, (a, b) in spans.items())
        raise InputError(
            f"no row of {log.provenance.source} with all of {shown}",
            "joints and readings of one time in one row",
            "bring them onto one clock before they are written, or record them as streams of one bag",
        )
    return apart(spans, ", or leave out the rows that lack one of them")


def _check_rate(t: Array, rate: float | None, source: str, label: str) -> None:
    """Refuse a rate in the rig that the log's own times contradict."""
    if rate is None or len(t) < 2:
        return
    own = 1.0 / max(float(np.median(np.diff(t))), 1e-300)
    if not abs(own / rate - 1.0) <= RATE_KNOWN:
        raise InputError(
            f"t = {{ rate = {rate:g} }} in [columns], and {own:.4g} rows/s by the times in '{label}' of {source}",
            "one of them",
            f"take rate out of t in [columns], or correct it; or leave '{label}' out of the log",
        )


def _fill(arrays: Arrays, sources: list[_Source], labels: list[str], source: str, n: int) -> Array:
    """Columns in SI side by side, (n, N)."""
    if len(arrays) == 1 and arrays[0].ndim == 2:
        block = numbers(arrays[0], source, labels[0])
        spec, scale = sources[0].spec, sources[0].spec.to_si
        block = block if scale == 1.0 and spec.offset == 0.0 else block * scale + spec.offset
        return np.ascontiguousarray(block)
    out = np.empty((n, len(arrays)))
    for i, (array, column, label) in enumerate(zip(arrays, sources, labels)):
        if array.ndim != 1:
            raise InputError(
                f"{array.ndim}-D array '{label}' as one column in {source}",
                "1-D",
                'name it as a whole, such as q = { column = "positions" }',
            )
        target = out[:, i]
        target[:] = numbers(array, source, label)
        if column.spec.to_si != 1.0:
            target *= column.spec.to_si
        if column.spec.offset != 0.0:
            target += column.spec.offset
    return out


def _facts(table: Table, plan: Plan) -> dict[str, object]:
    """What the provenance says of the mapping."""
    used = {source.position for sources in plan.values() for source in sources}
    scales = {name: _one_or_all([s.spec.to_si for s in sources]) for name, sources in plan.items()}
    offsets = {name: _one_or_all([s.spec.offset for s in sources]) for name, sources in plan.items()}
    facts: dict[str, object] = {
        "format": table.kind,
        "columns": {name: [table.label(s.position) for s in sources] for name, sources in plan.items()},
        "to_si": {name: scale for name, scale in scales.items() if scale != 1.0},
        "offset": {name: offset for name, offset in offsets.items() if offset != 0.0},
        "ignored": [table.label(i) for i in range(table.width) if i not in used],
    }
    return {name: fact for name, fact in facts.items() if fact}


def _one_or_all(values: list[float]) -> float | list[float]:
    return values[0] if len(set(values)) == 1 else values


def _check_joints(log: Log, rig: Rig, source: str) -> None:
    named = rig.robot.joints if rig.robot else None
    if named and log.joint_count and log.joint_count != len(named):
        found = f"{log.joint_count} joints in {source}, and {len(named)} names in [robot] joints of the rig"
        raise InputError(found, f"{len(named)} columns of each of q, dq, tau", "correct [columns] or [robot]")


# -------------------------------------------------------------------------------------- which column is which


def _plan(table: Table, rig: Rig, joints: Sequence[str] | None) -> Plan:
    """Where each quantity comes from, the time first."""
    plan: Plan = {}
    single = {name: _single(table, rig, name) for name in ("t", "phase", *CONTACT)}
    if single["t"] is not None:
        plan["t"] = [single["t"]]
    elif "t" not in rig.columns or rig.columns["t"].rate is None:
        raise InputError(
            f"no time in {table.source} {_shown(table)}",
            "a column 't' [s]",
            'name it: [columns] t = { column = …, unit = "s" }, or, for rows that come evenly, t = { rate = 500 }',
        )
    groups = {group: _group(table, rig, group, None) for group in JOINT_GROUPS}
    # where the rig names only a group's first column, the other groups or the robot say how many there are
    counts = [len(g) for g in groups.values() if g and g[0].position not in table.blocks]
    count = counts[0] if counts else len(joints) if joints else None
    for group, sources in groups.items():
        if sources is None and count is None:
            mend = f"list them all: {group} = {{ columns = […] }}, or give [robot] joints"
            raise InputError(f"only the first column of {group} for {table.source}", "their number", mend)
        found = sources if sources is not None else _group(table, rig, group, count)
        plan |= {group: found} if found else {}
    wrench = _group(table, rig, "wrench", len(WRENCH))
    if wrench:
        plan["wrench"] = wrench
    plan |= {name: [source] for name, source in single.items() if source is not None and name != "t"}
    for quantity, sources in plan.items():
        _refuse_doubles(table, quantity, sources)
    if not plan.keys() - {"t", "phase"}:
        raise InputError(
            f"no quantity beside the time in {table.source} {_shown(table)}",
            "q1 …, fx … tz, or depth …",
            "name its columns in [columns] of the rig",
        )
    return plan


def _refuse_doubles(table: Table, quantity: str, sources: list[_Source]) -> None:
    """No column is two of one quantity's."""
    positions = [source.position for source in sources]
    double = next((position for position in positions if positions.count(position) > 1), None)
    if double is not None:
        found = f"column '{table.label(double)}' of {table.source} named {positions.count(double)} times for {quantity}"
        raise InputError(found, "a column of its own for each", f"correct {quantity} in [columns] of the rig")


def _shown(table: Table) -> str:
    """The columns, for a message."""
    names = [f"'{name}'" for name in table.names or ()]
    names = [*names[:12], "…"] if len(names) > 12 else names
    return f"with columns {', '.join(names)}" if names else f"with {table.width} columns and no header"


def _refined(rig: Rig, name: str, spec: ColumnSpec) -> ColumnSpec:
    """What the rig says of one column of a group; what that leaves open, the group says."""
    own = rig.columns.get(name)
    if own is None:
        return spec.model_copy(update={"column": None, "columns": None}) if spec.columns is not None else spec
    said = {key: getattr(own, key) for key in own.model_fields_set}
    spec = spec.model_copy(update={"column": None, "columns": None} | said)
    if spec.columns is not None:
        raise InputError(f"several columns for {name} in [columns]", "one column", "name it by 'column'")
    return spec


def _single(table: Table, rig: Rig, name: str, default: ColumnSpec | None = None) -> _Source | None:
    """The column of one quantity, by the rig or by its own name; None: the table lacks it."""
    own, spec = rig.columns.get(name), _refined(rig, name, default or ColumnSpec())
    if own is not None and spec.column is not None:
        return _Source(table.position(spec.column, name), spec)
    if table.names is None or name not in table.names:
        if own is not None and spec.column is None and name not in ("t", *CONTACT, "phase"):
            raise InputError(
                f"no column '{name}' in {table.source}", "the column that [columns] describes", table.suggest(name)
            )
        return None
    return _Source(table.position(name, name), spec)


def _group(table: Table, rig: Rig, group: str, count: int | None) -> list[_Source] | None:
    """Columns of a group, none if the table lacks it; None if its number of columns must be known first."""
    spec = rig.columns.get(group) or ColumnSpec()
    if spec.columns is not None:
        if group == "wrench" and len(spec.columns) != len(WRENCH):
            found = f"{len(spec.columns)} columns for wrench in [columns]"
            raise InputError(found, " ".join(WRENCH), "list all six")
        parts = WRENCH if group == "wrench" else [f"{group}{i + 1}" for i in range(len(spec.columns))]
        each = [_refined(rig, part, spec) for part in parts]
        keys = [key if one.column is None else one.column for key, one in zip(spec.columns, each)]
        return [_Source(table.position(key, group), one) for key, one in zip(keys, each)]
    if spec.column is not None:
        return _from_first(table, spec, group, table.position(spec.column, group), count)
    return _by_name(table, rig, group, spec)


def _from_first(table: Table, spec: ColumnSpec, group: str, first: int, count: int | None) -> list[_Source] | None:
    """The 2-D array at this position, or `count` columns from there on."""
    if first in table.blocks:
        return [_Source(first, spec)]
    if count is None:
        return None
    if first + count > table.width:
        found = f"{count} columns of {group} from column {first}, and {table.width} in {table.source}"
        raise InputError(found, f"at least {first + count} columns", "correct [columns] of the rig")
    return [_Source(i, spec) for i in range(first, first + count)]


def _by_name(table: Table, rig: Rig, group: str, spec: ColumnSpec) -> list[_Source]:
    """The array of the group's name, or its columns by their own names."""
    whole = table.names is not None and group in table.names
    if not whole or table.position(group, group) not in table.blocks:
        parts = _wrench_names(table, rig) if group == "wrench" else _numbered(table, rig, group)
        # a single axis may be logged without a number
        if parts or not whole or group == "wrench":
            each = [_single(table, rig, part, spec) for part in parts]
            return [source for source in each if source is not None]
    return [_Source(table.position(group, group), spec)]


def _wrench_names(table: Table, rig: Rig) -> tuple[str, ...]:
    """Names fx … tz where the log has a force; a log with tx ty tz alone means a position by them."""
    there = [name for name in WRENCH if name in (table.names or ()) or name in rig.columns]
    if not set(there) & set(WRENCH[:3]):
        return ()
    if len(there) < len(WRENCH):
        missing = " ".join(name for name in WRENCH if name not in there)
        found = f"{' '.join(there)} without {missing} in {table.source}"
        raise InputError(found, " ".join(WRENCH), "name them in [columns], or give one force as normal_force")
    return WRENCH


def _numbered(table: Table, rig: Rig, group: str) -> list[str]:
    """q1 … qN.

    Raises:
        InputError: the numbers don't run from 1 to N.
    """
    pattern = re.compile(rf"{group}(\d+)")
    there = [pattern.fullmatch(name) for name in (*(table.names or ()), *rig.columns)]
    given = sorted({int(m[1]) for m in there if m})
    if given and given != list(range(1, len(given) + 1)):
        shown = ", ".join(f"{group}{i}" for i in given)
        raise InputError(
            f"{shown} in {table.source}",
            f"{group}1 to {group}N without a hole",
            f"name the columns: [columns] {group} = {{ columns = […] }}",
        )
    return [f"{group}{i}" for i in given]
