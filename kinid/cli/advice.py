"""Commands that other commands advise, as they run: with the log, the rig and the model of the command line."""

from __future__ import annotations

import os
import re
import shlex
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from kinid.errors import InputError

if TYPE_CHECKING:
    from kinid.data.log import Log
    from kinid.data.rig import Rig
    from kinid.modeling.model import Model

#: commands whose arguments are logs
OF_LOGS = ("contact", "fit", "compare", "diagnose", "changes", "map", "shape", "live", "view")
#: such a command within a sentence, as a message advises it
OF_A_LOG = re.compile(rf"\bkinid ((?:{'|'.join(OF_LOGS)}|plan) )")
#: names folders of effects, as kinid.effects reads it
EFFECTS = "KINID_EFFECTS"
#: what is advised only where the log's touches do give a surface
FOUND_BY_TOUCHES = re.compile(r", or let touches find it: kinid contact LOG --find-surface")


def filled(message: str, words: Sequence[str]) -> str:
    """A message whose advised commands hold LOG or MODEL, with those of the command line in their place.

    Args:
        message: of an error. words: of the command line, without the program's name.
    """
    options = dict(zip(words, words[1:]))
    if words and words[0] in OF_LOGS:
        # what stands behind an option is its value
        given = [word for before, word in zip(words, words[1:]) if not before.startswith("-") and os.path.exists(word)]
        rig = ["--rig", options["--rig"]] if "--rig" in options else []
        if given:
            named = Path(options["--rig"]) if rig else None
            message = FOUND_BY_TOUCHES.sub(lambda advice: advice[0] + _untouched(given, named), message)
            message = re.sub(r"\bLOG\b", lambda _: shlex.join([*given, *rig]), message)
    if "--model" in options:
        message = re.sub(r"\bMODEL\b", lambda _: shlex.quote(options["--model"]), message)
    if os.environ.get(EFFECTS):
        from kinid.effects import effect_options

        own = shlex.join(effect_options())
        message = OF_A_LOG.sub(lambda command: f"kinid {own} {command[1]}", message)
    return message


def _untouched(logs: Sequence[str], rig: Path | None) -> str:
    """Why touches in a log don't give the surface yet; "" where they do."""
    from kinid.cli.contact import load
    from kinid.contact.registration import find_surface

    try:
        the_rig, log, robot = load(Path(logs[0]), rig)
        find_surface([log], the_rig, robot=robot)
    except InputError as error:
        return f" (once the log has more of them; now it is refused: {error.mend})"
    return ""


def to_diagnose_all(
    logs: Sequence[Path], rig: Path | None, model: Model, on: str | None = None, workers: int | None = None
) -> str:
    """The command that asks what a model of logs lacks."""
    from kinid.effects import effect_options

    given = {"--rig": rig, "--model": ",".join(model.names) or "none", "--on": on, "--workers": workers}
    options = [word for name, value in given.items() if value is not None for word in (name, str(value))]
    return shlex.join(["kinid", *effect_options(), "diagnose", *map(str, logs), *options])


def to_diagnose(log: Path, rig: Path | None, model: Model, data: Log, the_rig: Rig) -> str:
    """The command that asks what a model of a log lacks, or why that log can't be asked."""
    from kinid.diagnosis.inquiry import diagnosable

    try:
        diagnosable(data, the_rig, model)
    except InputError as error:
        return f"this log can't be diagnosed: {error.found}; instead, {error.mend}"
    return to_diagnose_all([log], rig, model)
