"""`kinid map`: logs of touches to a map of properties over the surface."""

from __future__ import annotations

import time
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from kinid.cli import complete
from kinid.cli.batch import On, Workers, running
from kinid.cli.options import PAGE, FirstRigFile, TouchModel, check_method, names
from kinid.errors import InputError

if TYPE_CHECKING:
    from kinid.batch.runners import Runner
    from kinid.mapping.probes import Prober
    from kinid.mapping.property_map import PropertyMap
    from kinid.mapping.warm_start import Neighbourhood

EXAMPLES = """Examples:

kinid map mould -o mould.parquet --plot mould.html

kinid map poke_1.parquet poke_2.parquet --rig rig.toml -o map.parquet

kinid map running-campaign -o map.parquet --follow 10

kinid map short-pokes -o map.parquet --prior neighbours
"""
#: the map is written while it grows, but not more often than this [s]
EVERY = 0.5


# as long as its options and their help
def map_(
    logs: Annotated[
        list[Path], typer.Argument(help="Logs, or folders of logs; every touch is a probe.", show_default=False)
    ],
    out: Annotated[
        Path, typer.Option("-o", "--out", help="Map: .parquet; it can be read while it grows.", show_default=False)
    ],
    rig: FirstRigFile = None,
    model: TouchModel = "kelvin-voigt",
    plot: Annotated[
        Path | None, typer.Option(help="Pictures of the map: one offline HTML file.", callback=PAGE)
    ] = None,
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
    prior: Annotated[
        str | None,
        typer.Option(
            help="Join each touch with what is expected of its place: neighbours, a map or a fit (JSON) beside them.",
            show_default="each touch alone",
        ),
    ] = None,
    json_file: Annotated[
        Path | None, typer.Option("--json", help="Probes, ranges and left-out errors to write as JSON.")
    ] = None,
    anew: Annotated[bool, typer.Option("--anew", help="Don't go on with a map that is there.")] = False,
    on: On = None,
    workers: Workers = None,
) -> None:
    """Logs of touches to a map of stiffness, damping … over the surface, with covariance; started again, it goes on."""
    from kinid.batch.probing import found_in
    from kinid.batch.store import address_of, is_remote
    from kinid.cli.show import written
    from kinid.cli.show_map import in_map, map_facts, show_borders, show_map
    from kinid.mapping.origin import refuse_changed, unknown_origin
    from kinid.mapping.property_map import PropertyMap
    from kinid.mapping.slide_borders import slide_borders
    from kinid.mapping.warm_start import Expectation, Neighbourhood
    from kinid.writers import alone_with, check_outputs, write_json, write_text

    check_method(method)
    _check(out, follow, cell, export)
    given = [address_of(log) for log in logs]
    found = found_in(given)
    folder = logs[0] if logs[0].is_dir() or (is_remote(logs[0]) and found[0] != given[0]) else logs[0].parent
    rig_file = rig or folder / "rig.toml"
    check_outputs((out, plot, json_file), [rig_file, *map(Path, found), *([] if prior is None else [Path(prior)])])
    near = None if prior is None else Neighbourhood(Expectation.read(prior))
    prober = _prober(rig_file, model, along, cell)
    with alone_with(out), running(on, workers) as runner:
        start = PropertyMap.read(out) if out.is_file() and not anew else None
        if start is not None:
            refuse_changed(start, out.stat().st_mtime)
        grown, skipped = _grow(given, found, prober, start, out, follow, runner, near)
    borders = slide_borders(grown, prober.rig)
    if plot is not None:
        from kinid.mapping.map_page import map_page

        write_text(plot, map_page(grown, out.name, method, borders))
    known, new = in_map(grown), len(grown) - (0 if start is None else len(start))
    show_map(grown, known, new, skipped, rig_file)
    show_borders(borders)
    doubts = [] if start is None or not new else unknown_origin(start)
    for doubt in doubts:
        typer.echo(f"doubt: {doubt}")
    worlds: list[Path] = []
    if export is not None:
        from kinid.mapping.export import CELLS, FRICTION, cells_of
        from kinid.mapping.export import export as to_worlds

        worlds = to_worlds(grown, export, CELLS if cell is None else cells_of(grown, cell), method)
        if not any(p.name == "friction" and p.probes for p in known):
            typer.echo(f"assumed friction {FRICTION} in {export}: the map holds none")
    files = [path for path in (out, plot, *worlds, json_file) if path is not None]
    if json_file is not None:
        more: dict[str, object] = {
            "map": str(out),
            "method": method,
            "doubts": doubts,
            "written": [str(path) for path in files],
        }
        more |= {"borders": [border.to_dict() for border in borders]}
        write_json(json_file, map_facts(grown, known, new, skipped) | more)
    written(files)


def _check(out: Path, follow: float, cell: float | None, export: Path | None) -> None:
    """What can't be asked for."""
    if not 0 <= follow < 1e6:
        raise InputError(f"--follow {follow}", "seconds, 0 or more", "correct it")
    if cell is not None and (export is None or not 0 < cell < 1e3):
        raise InputError(
            f"--cell {cell}{' without --export' if export is None else ''}",
            "the size of the export's patches [m]",
            "name a folder with --export" if export is None else "correct it",
        )
    from kinid.mapping.map_file import check_map_name

    check_map_name(out)


def _prober(rig: Path, model: str, along: float, cell: float | None) -> Prober:
    """What fits the model to each touch on the rig's surface."""
    from kinid.batch.logs import rig_of
    from kinid.batch.store import address_of
    from kinid.mapping.probes import Prober
    from kinid.robotics.surface import Mesh

    prober = Prober.of(rig_of(address_of(rig), needed=True), names(model), along)
    if cell is not None and isinstance(prober.surface, Mesh):
        raise InputError(
            f"--cell {cell} for a mesh", "a plane; a mesh has a patch for each of its faces", "leave --cell out"
        )
    return prober


def _grow(
    logs: list[str],
    found: list[str],
    prober: Prober,
    start: PropertyMap | None,
    out: Path,
    follow: float,
    runner: Runner,
    near: Neighbourhood | None,
) -> tuple[PropertyMap, dict[str, str]]:
    """The map with all probes that come while it is waited, written as it grows; and logs left out, with the reason.

    Args:
        logs: files and folders. found: logs in them at first. start: a map to go on with. out: file of the map.
        follow: how long to wait for a log that is still to come [s]. runner: who makes the probes. near: see `build`.
    """
    from functools import partial

    from kinid.batch.probing import found_in, probed
    from kinid.mapping.probes import build, expected

    grown, skipped, last = start, dict[str, str](), 0.0
    quiet_since = time.monotonic()
    while True:
        before = len(grown) if grown is not None else 0
        todo = [path for path in found if path not in skipped]
        elsewhere = partial(probed, runner, prober)
        for latest in build(todo, prober, grown, lambda path, why: skipped.update({path: why}), elsewhere, near):
            grown = latest
            if time.monotonic() - last > EVERY:
                grown.write(out)
                last = time.monotonic()
        if grown is not None and (len(grown) > before or not out.is_file()):
            grown.write(out)
            quiet_since = time.monotonic()
        total = expected([Path(log) for log in logs])
        if (total is not None and len(found) >= total) or time.monotonic() - quiet_since >= follow:
            break
        time.sleep(min(0.5, follow))
        found = found_in(logs)
    if grown is None or not len(grown):
        why = next(iter(skipped.values()), "no log yet")
        raise InputError(
            f"no probe in {len(found)} logs ({why})",
            "a touch that carries the model",
            "look at one with kinid contact LOG",
        )
    return grown, skipped
