"""A surface in JSON, as it stands in a map's file: a plane in numbers, a mesh as packed arrays."""

from __future__ import annotations

import base64

import numpy as np
from numpy.typing import NDArray

from kinid.robotics.surface import Mesh, Plane
from kinid.writers import Json


def surface_to_dict(surface: Plane | Mesh) -> Json:
    """What a map's file says of its surface."""
    if isinstance(surface, Plane):
        return {"point": surface.point.tolist(), "axes": surface.axes.tolist()}
    tangent = None if surface.tangent is None else surface.tangent.tolist()
    return {
        "vertices": _packed(surface.vertices, "<f8"),
        "faces": _packed(surface.faces, "<i8"),
        "edge_radius": surface.edge_radius,
        "tangent": tangent,
        "source": surface.source,
    }


def surface_from_dict(facts: object) -> Plane | Mesh:
    """The surface again.

    Raises:
        InputError: a plane or a mesh that can't be. KeyError, TypeError, ValueError: facts of neither.
    """
    if not isinstance(facts, dict):
        raise TypeError(f"a surface that is {str(facts)[:40]}")
    if "axes" in facts:
        return Plane(np.array(facts["point"], dtype=float), np.array(facts["axes"], dtype=float))
    vertices = np.frombuffer(base64.b64decode(facts["vertices"]), "<f8").reshape(-1, 3)
    faces = np.frombuffer(base64.b64decode(facts["faces"]), "<i8").reshape(-1, 3)
    tangent = None if facts["tangent"] is None else np.array(facts["tangent"], dtype=float)
    return Mesh(vertices, faces, float(facts["edge_radius"]), tangent, str(facts["source"]))


def _packed(values: NDArray[np.generic], kind: str) -> str:
    return base64.b64encode(np.ascontiguousarray(values, dtype=kind).tobytes()).decode("ascii")
