"""What the columns of a foreign log are, guessed from their names and values; each guess is said.

Names are compared without case, separators and the unit that many loggers put behind them, as in `Joint 1 [deg]` or
`tcp_force_x_N`. Where no unit is named, angles beyond a turn are degrees, and the step of the time tells its unit.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from kinid.data.plausible import KINDS
from kinid.data.readers import csv as text
from kinid.data.rig import WRENCH
from kinid.errors import InputError, KinidError

Array = NDArray[np.float64]

#: formats whose columns have names
SUFFIXES = (*text.SUFFIXES, ".parquet", ".npz")
#: positions beyond this are no radians [rad]
TURN = 2 * np.pi + 0.1
#: time steps of a log, by the unit that they are in: beyond each of these it is the next finer one [s]
STEPS = ((0.4, "ms"), (400.0, "us"), (4e5, "ns"))
#: names of joint quantities, in front of the joint's number
JOINTS = {
    "dq": r"(?:actual)?(?:dq|qd|jointvel|jointvelocity|jvel|vel|velocity|qdot)",
    "ddq": r"(?:actual)?(?:ddq|qdd|jointacc|jointacceleration|acc|acceleration)",
    "tau": r"(?:actual)?(?:tau|torque|effort|jointtorque|jtau|jtorque)",
    "q": r"(?:actual)?(?:q|j|joint|a|axis|jointpos|jointposition|jointangle|pos|position|angle|theta)",
}
#: what stands in front of an axis' letter
FORCE, TORQUE = r"(?:\w*force|f|tcpf|ft)", r"(?:\w*torque|\w*moment|t|m|tcpt|ftt)"
TIME = ("t", "time", "timestamp", "stamp", "sec", "secs", "seconds", "clock", "rostime", "elapsed", "elapsedtime")


@dataclass(frozen=True)
class Guess:
    """One quantity of the log format.

    Attributes:
        quantity: as `q1` or `fx`. column: its name in the log. unit: in which it stands; None for SI.
        why: of the unit, in words.
    """

    quantity: str
    column: str
    unit: str | None
    why: str


def columns_of(path: Path) -> dict[str, Array]:
    """Columns of numbers of a table, by name, (n,) each; what is text or has more dimensions is left out.

    Raises:
        InputError: a format without named columns, or a file that can't be read.
    """
    if not path.is_file():
        raise InputError(f"no file {path}", "a log", "check the path")
    if not path.name.lower().endswith(SUFFIXES):
        raise InputError(f"{path}", f"a log ending in {', '.join(SUFFIXES)}", "name one, or write rig.toml by hand")
    try:
        if path.suffix.lower() == ".npz":
            with np.load(path, allow_pickle=False) as archive:
                arrays = {name: archive[name] for name in archive.files}
        else:
            arrays = _table(path)
    except KinidError:
        raise
    except Exception as error:  # readers raise whatever comes up in a broken file
        raise InputError(f"no readable table in {path} ({str(error)[:80]})", "columns with names", "check it") from None
    if not arrays:
        raise InputError(
            f"no header in {path}",
            "columns with names",
            "number them in [columns] of a rig.toml: t = { column = 0 }, …",
        )
    return {
        name: np.asarray(values, dtype=float)
        for name, values in arrays.items()
        if values.ndim == 1 and values.dtype.kind in "fiu"
    }


def _table(path: Path) -> dict[str, NDArray[np.generic]]:
    if path.suffix.lower() == ".parquet":
        from pyarrow import parquet

        table = parquet.ParquetFile(path).read(use_threads=False)
        return {name: table[name].to_numpy() for name in table.column_names}
    return {name: column.to_numpy() for name, column in text.columns(path).items()}


def guesses(columns: Mapping[str, Array]) -> list[Guess]:
    """What each column is, those that are known; no quantity twice, the first column of a kind wins."""
    out: dict[str, Guess] = {}
    numbers: dict[str, list[tuple[int, str, str | None]]] = {}
    for name in columns:
        plain, unit = _plain(name)
        if plain in TIME and "t" not in out:
            stated = unit if unit in KINDS["t"] else None
            out["t"] = Guess("t", name, stated, "its name says so") if stated else _time(name, columns[name])
            continue
        axis = _axis(plain)
        if axis is not None and axis not in out:
            out[axis] = Guess(axis, name, unit if unit in KINDS[axis] else None, "its name says so")
            continue
        for group, pattern in JOINTS.items():
            if found := re.fullmatch(rf"{pattern}(\d{{1,2}})(?:pos|position|angle)?", plain):
                numbers.setdefault(group, []).append((int(found[1]), name, unit if unit in KINDS[group] else None))
                break
    for group, named in numbers.items():
        named.sort()
        first = named[0][0]
        if [number for number, *_ in named] != list(range(first, first + len(named))):
            continue  # a hole in the numbers: not to be guessed
        turned = group in ("q", "q_cmd") and _beyond_a_turn([columns[name] for _, name, _ in named])
        for number, name, unit in named:
            found_unit, why = (
                (unit, "its name says so") if unit else ("deg", "values beyond a turn") if turned else (None, "")
            )
            quantity = f"{group}{number - first + 1}"
            out[quantity] = Guess(quantity, name, found_unit, why)
    return list(out.values())


def _plain(name: str) -> tuple[str, str | None]:
    """A name without case, separators and unit; and the unit."""
    units = sorted({unit for kind in KINDS.values() for unit in kind}, key=len, reverse=True)
    unit = None
    if found := re.search(r"[\[(]\s*([^\])]+?)\s*[\])]\s*$", name):
        unit, name = found[1], name[: found.start()]
    else:
        for each in units:
            if re.search(rf"[_ ]{re.escape(each)}$", name, re.IGNORECASE) and len(name) > len(each) + 1:
                unit, name = each, name[: -len(each) - 1]
                break
    unit = {each.lower(): each for each in units}.get(unit.lower()) if unit else None
    return re.sub(r"[\W_]+", "", name.lower()), unit


def _axis(plain: str) -> str | None:
    """Fx … tz of a name without separators."""
    if found := re.fullmatch(rf"{FORCE}([xyz])", plain):
        return "f" + found[1]
    if found := re.fullmatch(rf"{TORQUE}([xyz])", plain):
        return "t" + found[1]
    return None


def _time(name: str, values: Array) -> Guess:
    step = float(np.median(np.diff(values))) if len(values) > 1 else 0.0
    unit = next((unit for limit, unit in reversed(STEPS) if step > limit), None)
    return Guess("t", name, unit, f"steps of {step:.3g}" if unit else "")


def _beyond_a_turn(values: Sequence[Array]) -> bool:
    return any(np.nanmax(np.abs(column), initial=0.0) > TURN for column in values)


def columns_table(found: Sequence[Guess]) -> str:
    """The lines of [columns] that the guesses need: none for what has the log format's own name and unit."""
    lines = []
    by_name = {guess.quantity: guess for guess in found}
    if any(axis in by_name for axis in WRENCH) and not all(axis in by_name for axis in WRENCH):
        lines.append(f"# a wrench has all of {' '.join(WRENCH)}; missing here: name them")
    for guess in found:
        if guess.column == guess.quantity and guess.unit is None:
            continue
        unit = f", unit = {quoted(guess.unit)}" if guess.unit else ""
        why = f"  # {guess.why}" if guess.unit and guess.why else ""
        lines.append(f"{guess.quantity} = {{ column = {quoted(guess.column)}{unit} }}{why}")
    return "\n".join(lines)


def quoted(text: str) -> str:
    """A TOML basic string."""
    escaped = "".join(f"\\u{ord(c):04x}" if ord(c) < 32 or c in '"\\\x7f' else c for c in text)
    return f'"{escaped}"'
