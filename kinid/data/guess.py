"""What the columns of a foreign log are, guessed from their names and values; each guess is said.

Names are compared without case, separators and the unit that many loggers put behind them, as in `Joint 1 [deg]` or
`tcp_force_x_N`. Where no unit is named, angles beyond a turn are degrees, and the step of the time tells its unit.
"""

from __future__ import annotations

import dataclasses
import itertools
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
from kinid.inputs import check_regular
from kinid.units import canonical

Array = NDArray[np.float64]

#: formats whose columns have names
SUFFIXES = (*text.SUFFIXES, ".parquet", ".npz")
#: positions beyond this are no radians [rad]
TURN = 2 * np.pi + 0.1
#: time steps of a log, by the unit that they are in: beyond each of these it is the next finer one [s]
STEPS = ((0.4, "ms"), (400.0, "us"), (4e5, "ns"))
#: what joint quantities are called, in front of the joint's number or name, or behind it
JOINTS = {
    "dq": "dq qd jointvel jointvelocity jvel vel velocity qdot speed geschwindigkeit",
    "ddq": "ddq qdd jointacc jointacceleration acc acceleration beschleunigung",
    "tau": "tau torque effort jointtorque jtau jtorque load moment drehmoment",
    "q": "q j joint a axis jointpos jointposition jointangle pos position ang angle theta winkel achse gelenk",
}
#: the same as a pattern; a controller may write "actual" in front, and what it calls a joint in front of its number
_JOINTS = {group: rf"(?:actual)?(?:{words.replace(' ', '|')})" for group, words in JOINTS.items()}
_NUMBERED = r"(?:m|motor|j|joint|axis|achse)?(\d{1,2})(?:pos|position|angle)?"
#: what stands in front of an axis' letter
FORCE, TORQUE = r"(?:\w*force|\w*kraft|f|tcpf|ft)", r"(?:\w*torque|\w*moment|t|m|tcpt|ftt)"
_CLOCKS = ("t", "time", "timestamp", "stamp", "sec", "secs", "seconds", "clock", "rostime", "elapsed", "elapsedtime")
TIME = (*_CLOCKS, "zeit", "zeitstempel", "temps", "tiempo")
#: units that quantities are taken for where nothing says another one
SI = {"t": "s", "q": "rad", "dq": "rad/s", "ddq": "rad/s^2", "tau": "N·m", **dict.fromkeys(("fx", "fy", "fz"), "N")}
SI |= dict.fromkeys(("tx", "ty", "tz"), "N·m")
#: a lever longer than this [m] is none: torques are in another unit than N·m
LEVER = 5.0


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
    check_regular(path, "log", "a log in a file", "copy it into one")
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


def guesses(columns: Mapping[str, Array], joints: Sequence[str] = ()) -> list[Guess]:
    """What each column is, those that are known; no quantity twice, the first column of a kind wins.

    Args:
        columns: of the log, by name. joints: of the robot, whose names columns may have.
    """
    out: dict[str, Guess] = {}
    time = _time_of(columns)
    if time is not None:
        unit = _plain(time)[1]
        stated = unit in KINDS["t"]
        out["t"] = Guess("t", time, unit, "its name says so") if stated else _time(time, columns[time])
    numbers: dict[str, list[tuple[int, str]]] = {}
    for name in columns:
        plain = _plain(name)[0]
        axis = _axis(plain, name)
        if name == time or (axis is not None and axis in out):
            continue
        if axis is not None:
            out[axis] = Guess(axis, name, *_stated(name, axis))
            continue
        for group, pattern in _JOINTS.items():
            if found := re.fullmatch(pattern + _NUMBERED, plain):
                numbers.setdefault(group, []).append((int(found[1]), name))
                break
    named = {group: _in_a_row(rows) for group, rows in numbers.items()} | _by_joint(columns, joints)
    for group, names in named.items():
        turned = group in ("q", "q_cmd") and _beyond_a_turn([columns[name] for name in names])
        for i, name in enumerate(names, start=1):
            unit, why = _stated(name, group)
            if unit is None and turned:
                unit, why = "deg", "values beyond a turn"
            out[f"{group}{i}"] = Guess(f"{group}{i}", name, unit, why)
    return _with_levers(list(out.values()), columns)


def _time_of(columns: Mapping[str, Array]) -> str | None:
    """The column that is the time: by its name, else by a word in it, else the only one that grows at every row."""
    named = [name for name in columns if _plain(name)[0] in TIME]
    if named:
        return named[0]
    steps = {name: np.diff(values) for name, values in columns.items()}
    # one that counts rows is no time
    growing = [name for name, step in steps.items() if len(step) and (step > 0).all() and not (step == 1).all()]
    word = [name for name in growing if set(re.split(r"[\W_]+", name.lower())) & set(TIME)]
    return word[0] if word else growing[0] if len(growing) == 1 else None


def _stated(name: str, quantity: str) -> tuple[str | None, str]:
    """The unit in a column's name where it is one of the quantity's, and why it is believed."""
    unit = _plain(name)[1]
    return (unit, "its name says so") if unit in KINDS[quantity] else (None, "")


def _in_a_row(rows: list[tuple[int, str]]) -> list[str]:
    """Columns by their joints' numbers; none where the numbers have a hole: that isn't to be guessed."""
    rows = sorted(rows)
    return [name for _, name in rows] if [i for i, _ in rows] == [*range(rows[0][0], rows[0][0] + len(rows))] else []


def _by_joint(columns: Mapping[str, Array], joints: Sequence[str]) -> dict[str, list[str]]:
    """Columns of each joint quantity that carry the names of all of a robot's joints, in their order."""
    bare = [_bare(joint) for joint in joints]
    same = "".join(letters[0] for letters in itertools.takewhile(lambda each: len(set(each)) == 1, zip(*bare)))
    names = {_bare(name): name for name in columns} | {_plain(n)[0]: n for n in columns}
    out: dict[str, list[str]] = {}
    for group, words in JOINTS.items():
        for word in words.split():
            for own in (bare, [joint.removeprefix(same) for joint in bare]):
                found = [names.get(word + joint, names.get(joint + word)) for joint in own if joint]
                if joints and None not in found and len(set(found)) == len(joints):
                    out.setdefault(group, [name for name in found if name is not None])
    return out


def _with_levers(found: list[Guess], columns: Mapping[str, Array]) -> list[Guess]:
    """Torques whose unit nobody names, in N·mm where they would need a lever beyond any tool's."""
    sizes = {guess.quantity: float(np.sqrt(np.nanmean(columns[guess.column] ** 2))) for guess in found}
    force, torque = (max((sizes.get(name, 0.0) for name in axes), default=0.0) for axes in (WRENCH[:3], WRENCH[3:]))
    if torque <= LEVER * force or force == 0.0:
        return found
    why = f"in N·m a lever of {torque / force:.2g} m"
    return [
        dataclasses.replace(guess, unit="N·mm", why=why)
        if guess.quantity in WRENCH[3:] and guess.unit is None
        else guess
        for guess in found
    ]


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
    unit = {each.lower(): each for each in units}.get(canonical(unit).lower()) if unit else None
    return _bare(name), unit


def _bare(name: str) -> str:
    """A name without case and separators."""
    return re.sub(r"[\W_]+", "", name.lower())


def _axis(plain: str, name: str) -> str | None:
    """Fx … tz of a name without separators, or of one of its words."""
    for word in (plain, *re.split(r"[\W_]+", name.lower())):
        # of a word among others two letters have to say it
        if found := re.fullmatch(rf"{FORCE if word == plain else 'f'}([xyz])", word):
            return "f" + found[1]
        if found := re.fullmatch(rf"{TORQUE if word == plain else '[tm]'}([xyz])", word):
            return "t" + found[1]
    return None


def unit_of_steps(step: float) -> str | None:
    """The unit that a log's time has if these are its steps; None where they may be seconds."""
    return next((unit for limit, unit in reversed(STEPS) if step > limit), None)


def _time(name: str, values: Array) -> Guess:
    step = float(np.median(np.diff(values))) if len(values) > 1 else 0.0
    unit = unit_of_steps(step)
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
        taken = f"no unit is named: {SI[stem]} is taken" if (stem := guess.quantity.rstrip("0123456789")) in SI else ""
        why = guess.why if guess.unit else taken
        why = f"  # {why}" if why else ""
        lines.append(f"{guess.quantity} = {{ column = {quoted(guess.column)}{unit} }}{why}")
    return "\n".join(lines)


def quoted(text: str) -> str:
    """A TOML basic string."""
    escaped = "".join(f"\\u{ord(c):04x}" if ord(c) < 32 or c in '"\\\x7f' else c for c in text)
    return f'"{escaped}"'
