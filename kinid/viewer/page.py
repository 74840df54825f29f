"""The page of the viewer: one HTML text with everything in it, meshcat's renderer included; it asks nobody for
anything.
"""

from __future__ import annotations

import html
import importlib.util
import json
from pathlib import Path

from kinid.errors import InputError
from kinid.writers import Json

#: of the forces of a log
LEGEND = '<i style="background:#D55E00"></i>measured force <i style="background:#0072B2"></i>predicted'


def page(scene: Json, legend: str = LEGEND) -> str:
    """The viewer showing a scene (`kinid.viewer.scene`), with a legend (HTML) for its forces.

    Raises:
        InputError: meshcat's renderer isn't installed.
    """
    template = (Path(__file__).parent / "viewer.html").read_text(encoding="utf-8")
    # "<" opens no tag inside JSON text, whatever a file's name holds
    data = json.dumps(scene, allow_nan=False).replace("<", "\\u003c")
    out = template.replace("__TITLE__", html.escape(str(scene.get("title", "view"))))
    out = out.replace("__LEGEND__", legend, 1).replace("__SCENE__", data, 1)
    file = renderer()
    if file is None:
        raise InputError("no renderer of meshcat", "the package meshcat with its viewer", "pip install meshcat")
    # no tag is closed inside a script
    return out.replace("__MESHCAT__", file.read_text(encoding="utf-8").replace("</script", "<\\/script"), 1)


def renderer() -> Path | None:
    """Meshcat's renderer, if it is there; found without its server, which isn't used and takes a second to load."""
    spec = importlib.util.find_spec("meshcat")
    places = (spec.submodule_search_locations or ()) if spec is not None else ()
    files = (Path(place) / "viewer" / "dist" / "main.min.js" for place in places)
    return next((file for file in files if file.is_file()), None)
