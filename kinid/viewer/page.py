"""The page of the viewer: one HTML text with everything in it, meshcat's renderer included; it asks nobody for
anything.
"""

from __future__ import annotations

import importlib.util
from collections.abc import Sequence
from pathlib import Path

from markupsafe import Markup

from kinid.errors import InputError
from kinid.reports.plots import BLUE, VERMILION
from kinid.reports.render import render
from kinid.writers import Json

#: of the forces of a log
LEGEND = ((VERMILION, "measured force"), (BLUE, "predicted"))


def page(scene: Json, legend: Sequence[tuple[str, str]] = LEGEND) -> str:
    """The viewer showing a scene (`kinid.viewer.scene`), with the colours of its forces and their names.

    Raises:
        InputError: meshcat's renderer isn't installed.
    """
    file = renderer()
    if file is None:
        raise InputError("no renderer of meshcat", "the package meshcat with its viewer", "pip install meshcat")
    # no tag is closed inside a script
    script = Markup(file.read_text(encoding="utf-8").replace("</script", "<\\/script"))
    return render("viewer.html", str(scene.get("title", "view")), scene=scene, legend=legend, renderer=script)


def renderer() -> Path | None:
    """Meshcat's renderer, if it is there; found without its server, which isn't used and takes a second to load."""
    spec = importlib.util.find_spec("meshcat")
    places = (spec.submodule_search_locations or ()) if spec is not None else ()
    files = (Path(place) / "viewer" / "dist" / "main.min.js" for place in places)
    return next((file for file in files if file.is_file()), None)
