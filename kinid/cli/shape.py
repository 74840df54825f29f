"""`kinid shape`: touches of a surface that nobody knows to its mesh, and to a map of what it is made of."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from kinid.cli.options import PAGE, FirstRigFile, TouchModel, ending_in, names
from kinid.errors import InputError, KinidError

if TYPE_CHECKING:
    from kinid.mapping.shape.touches import Touches

EXAMPLES = """Examples:

kinid shape touches -o surface.stl --plot surface.html

kinid shape poke_1.parquet poke_2.parquet poke_3.parquet poke_4.parquet --tip-radius 0.004 --next 5 -o surface.ply
"""
#: the widest ball that a tool ends in [m]
WIDEST = 0.1
#: so many touches are proposed at most
MOST_NEXT = 100


# as long as its options and their help
def shape(
    logs: Annotated[
        list[Path], typer.Argument(help="Logs, or folders of logs, that touch or slide over it.", show_default=False)
    ],
    out: Annotated[
        Path,
        typer.Option(
            "-o",
            "--out",
            help="Mesh, which [surface] of a rig takes: .stl, .obj or .ply.",
            callback=ending_in(".stl", ".obj", ".ply"),
            show_default=False,
        ),
    ],
    rig: FirstRigFile = None,
    model: TouchModel = "kelvin-voigt",
    tip_radius: Annotated[
        float, typer.Option(help="Radius of the ball that the tool ends in, at its tip frame [m]; 0 for a point.")
    ] = 0.0,
    following: Annotated[
        int, typer.Option("--next", help="Propose so many touches that tell most of shape and property.")
    ] = 0,
    of: Annotated[
        str, typer.Option("--property", help="What the proposed touches are to tell beside the shape.")
    ] = "stiffness",
    plot: Annotated[
        Path | None,
        typer.Option(help="The surface by uncertainty and by properties: one offline HTML file.", callback=PAGE),
    ] = None,
    json_file: Annotated[
        Path | None, typer.Option("--json", help="The surface's facts, properties and proposed touches as JSON.")
    ] = None,
) -> None:
    """Touches and slides of a surface that nobody knows to its mesh, with what it is made of and how sure both are.

    The rig needs no [surface]. Touches come from one side: seen along their mean normal the surface doesn't overhang.
    """
    from kinid.cli.show import written
    from kinid.cli.show_map import in_map, map_facts, show_map
    from kinid.cli.show_shape import shape_facts, shape_lines, show_shape
    from kinid.mapping.probes import logs_in
    from kinid.mapping.shape import Shape
    from kinid.mapping.shape.exploration import next_touches
    from kinid.robotics.surface import mesh_bytes
    from kinid.writers import check_outputs, write_bytes, write_json, write_text

    _check(tip_radius, following)
    found = list(dict.fromkeys(logs_in(logs)))
    rig_file = rig or (logs[0] if logs[0].is_dir() else logs[0].parent) / "rig.toml"
    check_outputs((out, plot, json_file), [rig_file, *found])
    touches, skipped = _touches(found, rig_file, model, tip_radius)
    made = Shape.fit(touches)
    sheet = made.sheet()
    proposed = next_touches(made, of, following) if following else []
    lines, known = shape_lines(made, sheet), in_map(made.grown)
    write_bytes(out, mesh_bytes(sheet.located.points, sheet.faces, out.suffix))
    if plot is not None:
        from kinid.mapping.shape.page import shape_page

        write_text(plot, shape_page(made, sheet, out.name, lines, proposed))
    if json_file is not None:
        facts = map_facts(made.grown, known, len(made.grown), skipped) | shape_facts(made, sheet, proposed)
        write_json(json_file, facts | {"written": [str(path) for path in (out, plot, json_file) if path is not None]})
    show_map(made.grown, known, len(made.grown), skipped, rig_file)
    show_shape(lines, proposed, of, out)
    written([path for path in (out, plot, json_file) if path is not None])


def _check(tip_radius: float, following: int) -> None:
    """What can't be asked for."""
    if not 0.0 <= tip_radius <= WIDEST:
        raise InputError(f"--tip-radius {tip_radius}", f"0 to {WIDEST} m", "give it in metres, as 0.004")
    if not 0 <= following <= MOST_NEXT:
        raise InputError(f"--next {following}", f"0 to {MOST_NEXT} touches", "ask for fewer, and touch there first")


def _touches(logs: list[Path], rig: Path, model: str, tip_radius: float) -> tuple[Touches, dict[str, str]]:
    """The touches of all logs, and logs left out with the reason."""
    from kinid.cli.batch import counted
    from kinid.data.rig import Rig
    from kinid.mapping.shape.touches import touches_of_log
    from kinid.modeling.model import Model
    from kinid.robotics.reading import read
    from kinid.robotics.robot import Robot

    the_rig, the_model = Rig.load(rig), Model(*names(model))
    robot = Robot.load(the_rig)
    if the_model.contact_law is None:
        raise InputError(f"--model {model}", "a law of contact, fitted to each touch", "name one, as kelvin-voigt")
    every, skipped = None, dict[str, str]()
    with counted("touches") as progress:
        for number, path in enumerate(logs):
            progress(number, len(logs), path.name)
            try:
                log = read(path, the_rig, robot=robot)
                found = touches_of_log(log, the_rig, robot, the_model, tip_radius, str(path))
                every = found if every is None else every.with_more(found)
            except KinidError as error:
                skipped[str(path)] = str(error)
    if every is None:
        why = next(iter(skipped.values()), "no log there")
        raise InputError(f"no touch in {len(logs)} logs ({why})", "firm touches", "look at one with kinid contact LOG")
    return every, skipped
