"""A map on disk: one Parquet file with a row a probe, and what it is of in its metadata."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from kinid import effects
from kinid.effects import Layout
from kinid.errors import InputError, check_name
from kinid.inputs import check_regular, parse_json
from kinid.mapping.property_map import Probe, Property, PropertyMap
from kinid.mapping.surface_facts import surface_from_dict, surface_to_dict
from kinid.modeling.reference_motions import CHANNELS
from kinid.robotics.surface import Plane
from kinid.writers import Json, replacing

Array = NDArray[np.float64]

VERSION = 1
#: no estimate and no variance of a map is larger, in any unit
LARGEST = 1e30
KIND, MAP = "property map", "a Parquet file of kinid map"
#: columns of text
TEXTS = ("source", "digest")
#: no place of a plane's map is further off it than this [m]; places in two kinds of coordinates agree to that
OFF_SURFACE, SAME_PLACE = 0.1, 1e-6
#: channels that mapped parameters are of
CONTACT = Layout(CHANNELS, "contact")


def write_map(made: PropertyMap, path: Path) -> None:
    """As Parquet, whole or not at all; a file that is there is replaced in one step.

    Raises:
        InputError: a name that doesn't end in .parquet, or a folder that can't be written to.
    """
    check_map_name(path)
    import pyarrow as pa
    from pyarrow import parquet

    names = [p.name for p in made.properties]
    columns: Json = {text: pa.array([getattr(p, text) for p in made.probes], pa.string()) for text in TEXTS}
    places = made.places
    columns |= {axis: places[:, i] for i, axis in enumerate("xyz")}
    if isinstance(made.surface, Plane) and len(made.probes):
        flat = made.flat(places)
        columns |= {"along1": flat[:, 0], "along2": flat[:, 1]}
    values = np.array([p.values for p in made.probes]).reshape(-1, len(names))
    covariances = np.array([p.covariance for p in made.probes]).reshape(-1, len(names), len(names))
    for i, name in enumerate(names):
        columns[name] = values[:, i]
        columns |= {f"cov.{name}.{names[j]}": covariances[:, i, j] for j in range(i, len(names))}
    columns["residual"] = np.array([p.residual for p in made.probes], dtype=float)
    columns["noise"] = np.array([p.noise for p in made.probes], dtype=float)
    table = pa.table(
        {name: pa.array(column) if isinstance(column, np.ndarray) else column for name, column in columns.items()}
    )
    about = {
        "kind": KIND,
        "version": VERSION,
        "model": made.model,
        "surface": surface_to_dict(made.surface),
        "properties": [{"name": p.name, "unit": p.unit} for p in made.properties],
        "origin": made.origin,
    }
    table = table.replace_schema_metadata({"kinid": json.dumps(about)})
    with replacing(path) as temporary:
        parquet.write_table(table, temporary, compression="snappy")


def read_map(path: Path) -> PropertyMap:
    """A map from its file.

    Raises:
        InputError: no map there.
    """
    import pyarrow as pa
    from pyarrow import parquet

    check_regular(path, "map", MAP, "make it anew")
    try:
        # opened once: a map that is replaced between two looks at its name would be half old and half new.
        # No thread of Arrow's may let go of a Python object after this: at exit that ends the process by an abort
        with pa.OSFile(str(path)) as file:
            table = parquet.ParquetFile(file).read(use_threads=False)
    except (OSError, ValueError) as error:  # Arrow's own are of both kinds
        raise InputError(f"no readable map at {path} ({str(error)[:80]})", MAP, "make it anew") from None
    try:
        meta = (table.schema.metadata or {}).get(b"kinid", b"{}")
        about = parse_json(meta, f"map in {path}", MAP, "make it anew", open_ends=True)
        if not isinstance(about, dict) or (about["kind"], about["version"]) != (KIND, VERSION):
            raise ValueError(f"it says of itself that it is {str(about)[:40]}")
        properties = tuple(Property(str(p["name"]), str(p["unit"])) for p in about["properties"])
        surface = surface_from_dict(about["surface"])
        names, n = [p.name for p in properties], table.num_rows
        column = {
            name: _numbers(table[name].to_numpy(), name, path) for name in table.column_names if name not in TEXTS
        }
        covariances = np.empty((n, len(names), len(names)))
        for i, a in enumerate(names):
            for j in range(i, len(names)):
                covariances[:, i, j] = covariances[:, j, i] = column[f"cov.{a}.{names[j]}"]
        places = np.column_stack([column[axis] for axis in "xyz"])
        values = np.column_stack([column[name] for name in names])
        texts = (  # a map of an earlier kinid doesn't know its logs' digests
            [str(text or "") for text in table[name].to_pylist()] if name in table.column_names else [""] * n
            for name in TEXTS
        )
        rows = zip(places, values, covariances, column["residual"].tolist(), column["noise"].tolist(), *texts)
        probes, origin = tuple(Probe(*row) for row in rows), dict(about.get("origin", {}))
        made = PropertyMap(surface, properties, probes, str(about["model"]), origin)
        _agrees(made, column)
        return made
    except (KeyError, ValueError, TypeError, AttributeError) as error:
        why = f"without {error.args[0]}" if isinstance(error, KeyError) else str(error)[:80]
        raise InputError(
            f"{path}, which is no property map ({why})",
            MAP,
            "make it with kinid map LOGS -o MAP.parquet",
        ) from None


def check_map_name(path: Path) -> None:
    """Refuse a map's name, before any work is done where it is asked early.

    Raises:
        InputError: an ending that no map has, or a name that is no UTF-8.
    """
    if path.suffix.lower() != ".parquet":
        raise InputError(f"map '{path.name}'", "a name ending in .parquet", "rename it")
    check_name(path)


def is_map(path: Path) -> bool:
    """Whether a Parquet file says that it is a property map, or has the columns of one."""
    import pyarrow as pa
    from pyarrow import parquet

    try:
        check_regular(path, "map", MAP, "make it anew")
        with pa.OSFile(str(path)) as file:
            schema = parquet.read_schema(file)
        said = KIND.encode() in (schema.metadata or {}).get(b"kinid", b"")
        return said or any(name.startswith("cov.") for name in schema.names)
    except Exception:  # whatever is wrong with it, it is no map
        return False


def _numbers(values: NDArray[np.generic], name: str, path: Path) -> Array:
    """A column of a map's file, (n,); infinite and absent values say that something is open."""
    if values.dtype.kind not in "fiu":
        raise InputError(f"a column {name} of no numbers in {path}", "numbers", "make the map anew")
    most = float(np.abs(values, where=np.isfinite(values), out=np.zeros(len(values))).max(initial=0.0))
    if most > LARGEST:
        raise InputError(f"{name} = {most:.3g} in {path}", f"{LARGEST:g} at most", "make the map anew")
    return np.asarray(values, dtype=float)


def _agrees(made: PropertyMap, column: Mapping[str, Array]) -> None:
    """Whether a file's own facts agree with each other: units, places, each probe once.

    Raises:
        ValueError: they don't.
    """
    for item in made.properties:
        units = _units(item.name)
        if units and item.unit not in units:
            raise ValueError(f"{item.name} in {item.unit}, not in {' or '.join(sorted(units))}")
    if isinstance(made.surface, Plane) and len(made):
        off = (made.places - made.surface.point) @ made.surface.axes[2]
        if np.abs(off).max() > OFF_SURFACE:
            raise ValueError(f"a probe {np.abs(off).max():.3g} m off its plane")
        for i, name in enumerate(("along1", "along2")):
            if name in column and np.abs(column[name] - made.flat(made.places)[:, i]).max() > SAME_PLACE:
                raise ValueError(f"{name} and x, y, z, which are of different places")
    named = [(p.digest, *p.place.tolist(), *p.values.tolist()) for p in made.probes if p.digest]
    if len(set(named)) < len(named):
        raise ValueError("a probe that stands there twice")


def _units(name: str) -> set[str]:
    """Units that a parameter of this name has in the catalogue, "effect.name" or name alone; none of a foreign one."""
    effect, _, last = name.rpartition(".")
    kinds = (
        [effects.get(effect)] if effect in effects.catalogue() else [kind() for kind in effects.catalogue().values()]
    )
    return {p.unit for kind in kinds for p in kind.parameters(CONTACT) if p.name == last}
