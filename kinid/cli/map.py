"""`kinid map`: logs of touches to a map of properties over the surface."""

from __future__ import annotations

import dataclasses
import json
import time
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from kinid.cli import complete
from kinid.errors import InputError

if TYPE_CHECKING:
    from kinid.mapping.property_map import PropertyMap

EXAMPLES = """Examples:

kinid map mould -o mould.parquet --plot mould.html

kinid map poke_1.parquet poke_2.parquet --rig rig.toml -o map.parquet

kinid map running-campaign -o map.parquet --follow 10
"""
#: the map is written while it grows, but not more often than this [s]
EVERY = 0.5


def map_(
    logs: Annotated[
        list[Path], typer.Argument(help="Logs, or folders of logs; every touch is a probe.", show_default=False)
    ],
    out: Annotated[
        Path, typer.Option("-o", "--out", help="Map: .parquet; it can be read while it grows.", show_default=False)
    ],
    rig: Annotated[
        Path | None, typer.Option(help="What was measured with what; default: rig.toml beside the first log.")
    ] = None,
    model: Annotated[
        str, typer.Option(help="Effects that are fitted to each touch.", autocompletion=complete.model)
    ] = "kelvin-voigt",
    plot: Annotated[Path | None, typer.Option(help="Pictures of the map: one offline HTML file.")] = None,
    export: Annotated[
        Path | None,
        typer.Option(help="Folder for MuJoCo XML, SDF, glTF, and PNG with JSON, with properties per patch."),
    ] = None,
    cell: Annotated[
        float | None,
        typer.Option(help="Patches of the export are no smaller than this [m]: twice the tip's radius, or more."),
    ] = None,
    method: Annotated[
        str,
        typer.Option(
            help="Between the probes, in plot and export: gp, triangles, biharmonic or nearest.",
            autocompletion=complete.method,
        ),
    ] = "gp",
    follow: Annotated[
        float,
        typer.Option(help="Wait so long for logs that are still to come [s]; a campaign's count ends it earlier."),
    ] = 0.0,
    along: Annotated[
        float,
        typer.Option(help="A slide of more than 20 mm is cut into probes of this length [m]; 0 for one probe a touch."),
    ] = 0.002,
    json_file: Annotated[
        Path | None, typer.Option("--json", help="Probes, ranges and left-out errors to write as JSON.")
    ] = None,
    anew: Annotated[bool, typer.Option("--anew", help="Don't go on with a map that is there.")] = False,
) -> None:
    """Logs of touches to a map of stiffness, damping … over the surface, with covariance; started again, it goes on."""
    from kinid.data.rig import Rig
    from kinid.mapping.interpolation import METHODS
    from kinid.mapping.probes import Prober, build, expected, logs_in
    from kinid.mapping.property_map import PropertyMap
    from kinid.robotics.surface import Mesh
    from kinid.writers import check_outputs, write_text

    if method not in METHODS:
        raise InputError(f"--method {method}", f"one of {', '.join(METHODS)}", "choose one of them")
    if not 0 <= follow < 1e6:
        raise InputError(f"--follow {follow}", "seconds, 0 or more", "correct it")
    if cell is not None and (export is None or not 0 < cell < 1e3):
        raise InputError(
            f"--cell {cell}{' without --export' if export is None else ''}",
            "the size of the export's patches [m]",
            "name a folder with --export" if export is None else "correct it",
        )
    if out.suffix.lower() != ".parquet":
        raise InputError(f"map '{out.name}'", "a name ending in .parquet", "rename it")
    found = logs_in(logs)
    first = logs[0] if logs[0].is_dir() else logs[0].parent
    rig_file = rig or first / "rig.toml"
    check_outputs((out, plot, json_file), (rig_file, *found))
    prober = Prober.of(Rig.load(rig_file), [part.strip() for part in model.split(",") if part.strip()], along)
    if cell is not None and isinstance(prober.surface, Mesh):
        raise InputError(
            f"--cell {cell} for a mesh", "a plane; a mesh has a patch for each of its faces", "leave --cell out"
        )
    start = PropertyMap.read(out) if out.is_file() and not anew else None
    grown, skipped, last = start, dict[str, str](), 0.0
    quiet_since = time.monotonic()
    while True:
        before = len(grown) if grown is not None else 0
        todo = [path for path in found if str(path) not in skipped]
        for latest in build(todo, prober, grown, lambda path, why: skipped.update({str(path): why})):
            grown = latest
            if time.monotonic() - last > EVERY:
                grown.write(out)
                last = time.monotonic()
        if grown is not None and (len(grown) > before or not out.is_file()):
            grown.write(out)
            quiet_since = time.monotonic()
        total = expected(logs)
        if (total is not None and len(found) >= total) or time.monotonic() - quiet_since >= follow:
            break
        time.sleep(min(0.5, follow))
        found = logs_in(logs)
    if grown is None or not len(grown):
        why = next(iter(skipped.values()), "no log yet")
        raise InputError(
            f"no probe in {len(found)} logs ({why})", "a touch that carries the model", "look at one with kinid contact"
        )
    if plot is not None:
        from kinid.mapping.map_page import map_page

        write_text(plot, map_page(grown, out.name, method))
    facts = _facts(grown, len(grown) - (len(start) if start is not None else 0), skipped)
    _show(facts)
    worlds: list[Path] = []
    if export is not None:
        from kinid.mapping.export import CELLS, FRICTION, cells_of
        from kinid.mapping.export import export as to_worlds

        worlds = to_worlds(grown, export, CELLS if cell is None else cells_of(grown, cell), method)
        if not _tells(grown, "friction"):
            typer.echo(f"assumed friction {FRICTION} in {export}: the map holds none")
    from kinid.cli.show import written

    files = [path for path in (out, plot, *worlds, json_file) if path is not None]
    if json_file is not None:
        facts |= {"map": str(out), "method": method, "written": [str(path) for path in files]}
        write_text(json_file, json.dumps(facts, indent=2, ensure_ascii=False, allow_nan=False) + "\n")
    written(files)


def _tells(grown: PropertyMap, name: str) -> bool:
    import numpy as np

    return name in [p.name for p in grown.properties] and bool(np.isfinite(grown.values(name)).any())


def _facts(grown: PropertyMap, fresh: int, skipped: dict[str, str]) -> dict[str, Any]:
    """What a map holds, in the words of JSON; a property that no probe tells has no numbers."""
    import numpy as np

    properties: dict[str, Any] = {}
    for item in grown.properties:
        values, errors = grown.values(item.name), grown.deviations(item.name)
        told = np.isfinite(values)
        properties[item.name] = {"unit": item.unit, "probes": int(told.sum())}
        if told.any():
            held = {name: error if np.isfinite(error) else None for name, error in grown.held_out(item.name).items()}
            properties[item.name] |= {
                "lowest": float(values[told].min()),
                "highest": float(values[told].max()),
                "standard_error": float(np.median(errors[told])),
                "held_out": held,
                "uniform": _uniform(grown, item.name),
            }
    return {
        "model": grown.model,
        "probes": len(grown),
        "new": fresh,
        "properties": properties,
        "failing": int(np.nansum(grown.misfit > 3)),
        "left_out_logs": dict(skipped),
    }


def _uniform(grown: PropertyMap, name: str) -> dict[str, float] | None:
    found = grown.uniform(name)
    return None if found is None else dataclasses.asdict(found)


def _show(facts: dict[str, Any]) -> None:
    from rich.markup import escape
    from rich.table import Table

    from kinid.cli.show import console
    from kinid.mapping.interpolation.uniform import Uniform

    out, probes, fresh = console(), facts["probes"], facts["new"]
    old = f", {probes - fresh} of them there already" if fresh < probes else ""
    out.print(f"{probes} probes with {facts['model']}{old}", soft_wrap=True)
    # two tables: together they are wider than a terminal
    table = Table("property", "unit", box=None, pad_edge=False)
    for heading in ("lowest", "highest", "standard error"):
        table.add_column(heading, justify="right")
    told = {name: item for name, item in facts["properties"].items() if item["probes"]}
    for name, item in facts["properties"].items():
        numbers = (
            [f"{item['lowest']:.5g}", f"{item['highest']:.5g}", f"{item['standard_error']:.3g}"]
            if name in told
            else None
        )
        table.add_row(escape(name), item["unit"], *(numbers or ["unknown", "unknown", "–"]))
    out.print(table)
    table = Table("error of probes left out", box=None, pad_edge=False)
    methods = next(iter(told.values()))["held_out"] if told else {}
    for method in methods:
        table.add_column(method, justify="right")
    for name, item in told.items():
        table.add_row(escape(name), *("–" if error is None else f"{error:.3g}" for error in item["held_out"].values()))
    if told:
        out.print(table)
    for name, item in told.items():
        if item["uniform"] is not None:
            out.print(f"{escape(name)}: {Uniform(**item['uniform']).words(item['unit'])}", soft_wrap=True)
    if facts["failing"]:
        out.print(
            f"doubt: at {facts['failing']} of {probes} places the model leaves more than 3 times the noise; kinid "
            f"diagnose "
            "says what may be missing there",
            soft_wrap=True,
        )
    skipped = facts["left_out_logs"]
    for path, why in list(skipped.items())[:5]:
        out.print(f"left out: {escape(path)}: {escape(why)}", soft_wrap=True)
    if len(skipped) > 5:
        out.print(f"left out: {len(skipped) - 5} more")
