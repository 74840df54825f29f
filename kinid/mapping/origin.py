"""What a map's probes were made with, so that none is added to it by another rig, or from a log that has changed."""

from __future__ import annotations

import os
from pathlib import Path

import kinid.urdf
from kinid.data.rig import Rig
from kinid.errors import InputError
from kinid.inputs import digest
from kinid.mapping.property_map import PropertyMap
from kinid.writers import Json

#: what a user can do
ANEW = "make the map anew with --anew, or write to another file"
#: name of the digest of the robot's URDF beside the rig's tables
URDF = "urdf"
#: what places were expected to be like beside the rig's tables; absent where each touch speaks alone
PRIOR = "prior"


def origin(rig: Rig) -> Json:
    """The tables of a rig, and the digest of its robot's URDF, in plain types for JSON."""
    tables: Json = rig.model_dump(mode="json", exclude={"folder"})
    return tables if rig.robot is None else tables | {URDF: digest(kinid.urdf.path(rig.robot.model, rig.folder))}


def refuse_another(before: Json, now: Json) -> None:
    """Refuse to go on with a map that another rig made.

    Args:
        before: origin of the map; empty for one of an earlier kinid, which doesn't say. now: of what is to be added.

    Raises:
        InputError: what differs first.
    """
    if before and before.get(PRIOR) != now.get(PRIOR):
        asked, was = (facts.get(PRIOR, "none") for facts in (now, before))
        raise InputError(f"--prior {asked} for a map begun with {was}", "the same for all of its places", ANEW)
    for table, old in before.items():
        new = now.get(table)
        if table == URDF and old != new:
            raise InputError("another URDF than the map was begun with", "the robot as it was", ANEW)
        if old == new:
            continue
        name, was, now_is = f"[{table}]", old, new
        if isinstance(old, dict) and isinstance(new, dict):
            field = next(field for field in sorted({*old, *new}) if old.get(field) != new.get(field))
            name, was, now_is = f"[{table}] {field}", old.get(field), new.get(field)
        raise InputError(
            f"{name} = {_shown(now_is)} in the rig, {_shown(was)} when the map was begun",
            "the rig that the map was begun with",
            ANEW,
        )


def unknown_origin(start: PropertyMap) -> list[str]:
    """At most one sentence: of a map that doesn't say what its probes were made with."""
    if start.origin or not len(start):
        return []
    return [
        f"the map's {len(start)} earlier probes don't say which rig they were made with, as those of kinid live and of "
        f"earlier versions don't: if it was another than this, {ANEW}"
    ]


def refuse_changed(start: PropertyMap, since: float) -> None:
    """Refuse to go on with a map one of whose logs is another now.

    Args:
        start: the map. since: when it was written, as `stat` counts [s]; older logs aren't looked into.

    Raises:
        InputError: the log.
    """
    known = {probe.source.split("#")[0]: probe.digest for probe in start.probes if probe.digest}
    for source, was in known.items():
        if os.path.isfile(source) and os.stat(source).st_mtime > since and digest(Path(source)) != was:
            raise InputError(f"{source}, which has changed since the map was made", "logs as they were", ANEW)


def _shown(value: object) -> str:
    text = "nothing" if value is None else str(value)
    return text if len(text) <= 60 else f"{text[:57]}..."
