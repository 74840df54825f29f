"""Inputs that ended otherwise once: by name the case, the input, and a word of the line that refuses it now."""

from __future__ import annotations

import copy
import json
from typing import Any

import numpy as np

from fuzz import sound


def _plan(**columns: Any) -> dict[str, Any]:
    return sound.planned() | {name: np.asarray(values) for name, values in columns.items()}


def _map(**facts: Any) -> bytes:
    columns, about = sound.mapped()
    about = copy.deepcopy(about)
    about["surface"] |= facts
    return sound.parquet(columns, about)


_TIME, _WORD = sound.planned()["t"], json.dumps(sound.COMMANDS[1].split() + ["a" * 5000]).encode()
_PLAN = sound.npz(sound.planned())
FAILED = {
    "a campaign of nothing": ("campaign", b'logs = [""]', "pattern"),
    "a campaign of half a pattern": ("campaign", b'logs = ["a**"]', "pattern"),
    "a campaign of a path from the root": ("campaign", b'logs = ["/a/*.csv"]', "relative"),
    "a campaign of a pattern without end": ("campaign", b'logs = ["' + 2000 * b"*/" + b'a.csv"]', "pattern"),
    "a plan that is cut off": ("plan.npz", _PLAN[:-30], "can't be read"),
    "a plan with a bit turned": (
        "plan.npz",
        _PLAN.replace(b"PK\x03\x04", b"PK\x03\x05", 1),
        "can't",
    ),
    "a plan of differing lengths": ("plan.npz", sound.npz(_plan(q3=np.zeros(3))), "lengths"),
    "a plan of too many phases": ("plan.npz", sound.npz(_plan(phase=np.full(len(_TIME) + 1, "poke"))), "lengths"),
    "a plan of touches without number": ("plan.npz", sound.npz(_plan(touch=np.full(len(_TIME), np.nan))), "touch"),
    "a plan of touches beyond number": ("plan.csv", sound.csv(_plan(touch=np.full(len(_TIME), np.inf))), "touch"),
    "a plan at no time": ("plan.csv", sound.csv(_plan(t=np.full(len(_TIME), np.inf))), "times"),
    "a mesh beyond the stars": ("mesh", sound.stl().replace(b"vertex 2", b"vertex 1e300"), "mesh"),
    "a fit with a number for warnings": ("fit", json.dumps(sound.fitted() | {"warnings": 1}).encode(), "warnings"),
    "a map on axes without end": ("map", _map(axes=[[1e90, 0, 0], [0, 1, 0], [0, 0, 1]]), "a plane has"),
    "a map beyond the stars": ("map", _map(point=[1e90, 0, 0]), "a plane has"),
    "a word that no system takes for a name": (sound.COMMANDS[1], _WORD, "leave them out"),
}
