"""Fits on disk: what `kinid fit --json` writes, read again with every field checked. Nothing in it is run."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import get_args

import numpy as np

from kinid.data.rig import WRENCH
from kinid.effects import Kind, Layout
from kinid.effects._signals import RestForm
from kinid.errors import InputError
from kinid.inputs import read_json
from kinid.modeling.model import Model
from kinid.modeling.reference_motions import CHANNELS
from kinid.writers import Json

WHAT, MEND = "what fit.save or kinid fit --json wrote", "fit anew and save that"


def fit_facts(path: Path) -> Json:
    """The fields of a fit in a file; of a diagnosis those of its best model's fit.

    Raises:
        InputError: no such file, one that is too large or too deep, or no fit.
    """
    facts = read_json(path, "fit", WHAT, MEND)
    facts = facts.get("fit", facts) if isinstance(facts, dict) else facts
    if not isinstance(facts, dict) or not isinstance(facts.get("parameters"), dict):
        raise InputError(f"{path}, which is no fit", WHAT, MEND)
    return facts


def model_in(facts: Json, path: Path) -> Model:
    """The model of a saved fit.

    Raises:
        InputError: no list of names.
    """
    names = facts.get("model")
    if not isinstance(names, list) or not all(isinstance(name, str) for name in names):
        raise InputError(f"the model {str(names)[:60]} in {path}", "a list of names of effects", MEND)
    return Model(*names)


def number_in(facts: Json, name: str, path: Path, *, open_end: float = np.nan) -> float:
    """A number of a saved fit; `open_end` where it is null.

    Raises:
        InputError: something else.
    """
    value = facts.get(name)
    if value is None:
        return open_end
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise InputError(f"{name} = {str(value)[:40]} in {path}", "a number, or null", MEND)
    return float(value)


def layout_in(facts: Json, path: Path) -> Layout:
    """The channels that a saved fit was made to.

    Raises:
        InputError: none, as in what an earlier kinid wrote.
    """
    found = facts.get("layout")
    found = found if isinstance(found, dict) else {}
    channels, joints = found.get("channels"), found.get("joints")
    kind: Kind | None = next((known for known in get_args(Kind) if known == found.get("kind")), None)
    if not (isinstance(channels, list) and channels and isinstance(joints, list) and kind):
        raise InputError(f"no layout of channels in {path}", f"{WHAT}, of this version", MEND)
    known = {"wrench": WRENCH, "contact": CHANNELS}.get(kind)
    if known is not None and not set(map(str, channels)) <= set(known):
        raise InputError(f"channels {str(channels)[:60]} of a {kind} in {path}", f"of {', '.join(known)}", MEND)
    return Layout(tuple(map(str, channels)), kind, tuple(map(str, joints)))


def rest_in(facts: Json, path: Path) -> RestForm:
    """The form of friction at rest that a saved fit found."""
    found = facts.get("rest")
    if not isinstance(found, dict):
        return RestForm()
    values: Json = {}
    for field in dataclasses.fields(RestForm):
        if field.name in found:
            own = found[field.name]
            values[field.name] = own if isinstance(own, bool) else number_in(found, field.name, path)
    return RestForm(**values)
