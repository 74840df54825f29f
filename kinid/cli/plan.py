"""`kinid plan`: motions of the robot that respect it and that excite what is to be estimated."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from kinid.cli import complete
from kinid.cli.options import grid as grid_of
from kinid.cli.options import names, numbers
from kinid.cli.plan_arguments import (
    Options,
    angles_of,
    check,
    corners_of,
    limits_of,
    model_of,
    place_of,
    planner_of,
    signal_of,
    sines_of,
    with_options,
)
from kinid.cli.plan_result import bound_words, finish, show_intervals
from kinid.errors import InputError

if TYPE_CHECKING:
    from kinid.modeling.model import Model
    from kinid.planning import Multisine, Sampled
    from kinid.planning.poke_design import Bounds

app = typer.Typer(
    help="Robot trajectories within all limits: pokes, slides, and the motion that tells most about a model.",
    no_args_is_help=True,
    rich_markup_mode=None,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)

POKE_EXAMPLES = """Examples:

kinid plan poke --rig rig.toml --depth 0.003 --sines 0.0015@0.9,0.0005@5 -o poke.parquet --plot poke.html

kinid plan poke --grid 10x10 --spacing 0.01 --duration 3 --hold 0.4 -o campaign.parquet

kinid plan poke --model hunt-crossley --value stiffness=3000 --value exponent=1.3 --force-limit 5 -o gentle.parquet
"""
SLIDE_EXAMPLES = """Examples:

kinid plan slide --through "0,0;0.02,0;0.02,0.02" --depth 0.0025 --speed 0.003 -o slide.parquet

kinid plan slide --four-paths 0.02 -o paths.parquet --preview paths.html
"""
EXCITE_EXAMPLES = """Examples:

kinid plan excite --model hunt-crossley --fit fit.json --force-limit 8 -o best.parquet --json best.json

kinid plan excite --model tool-mass,tool-com --duration 10 -o free.parquet

kinid plan excite --model rigid-body,joint-torque-offset,joint-coulomb-friction -o drives.parquet
"""
DISCRIMINATE_EXAMPLES = """Examples:

kinid plan discriminate --model hooke --value stiffness=1000 --effects relaxation,stiffness-drift -o hold.parquet

kinid plan discriminate --fit fit.json --effects viscous-friction,stribeck-friction --force-limit 8 -o slides.parquet

kinid plan discriminate --model none --effects tool-mass,sensor-bias -o turns.parquet --json why.json
"""


@app.command("poke", epilog=POKE_EXAMPLES)
@with_options
def poke(
    o: Options,
    at: Annotated[
        str, typer.Option(help="Place: x,y along both tangents, or x,y,z of a mesh in the base frame [m].")
    ] = "0,0",
    depth: Annotated[float, typer.Option(help="About which the signal swings [m].")] = 0.003,
    sines: Annotated[
        str, typer.Option(help="amplitude@frequency [m@Hz], separated by commas.")
    ] = "0.0015@0.9,0.0005@5",
    signal: Annotated[Path | None, typer.Option(help="Instead: a table with t [s] and depth [m].")] = None,
    duration: Annotated[float, typer.Option(help="Of the signal [s].")] = 4.0,
    hold: Annotated[float, typer.Option(help="At the depth before the signal [s].")] = 1.0,
    tilt: Annotated[str, typer.Option(help="Of the tool about both tangents [rad].")] = "0,0",
    grid: Annotated[str | None, typer.Option(help="A campaign about the place, as 10x10.")] = None,
    polygon: Annotated[
        str | None, typer.Option(help="A campaign within corners x,y;x,y;… along both tangents [m].")
    ] = None,
    spacing: Annotated[float, typer.Option(help="Between the pokes of a campaign [m].")] = 0.01,
) -> None:
    """Approach, hold, poke, retract and return; one place, or a campaign over a grid or a polygon."""
    check(o, signal)
    if signal is not None:
        o.refuse(
            ("sines", "depth", "duration"), "with --signal", "the signal's own depths and times, or a depth with sines"
        )
    if polygon is not None and grid is None:
        o.refuse(("at",), "with --polygon", "a polygon where its corners say")
    if polygon is None and grid is None:
        o.refuse(("spacing",), "without a campaign", "--grid or --polygon beside it")
    from kinid.planning import Multisine, Poke, shortest_tour, within
    from kinid.planning import grid as lattice
    from kinid.planning.touches import tour_length

    moved: Multisine | Sampled = Multisine(depth, sines_of(sines), duration) if signal is None else signal_of(signal)
    planner = planner_of(o)
    lean = angles_of(tilt, "--tilt")
    centre = place_of(at, "--at")
    places: list[tuple[float, ...]] = [centre]
    if grid is not None and polygon is not None:
        raise InputError("--grid and --polygon", "one of them", "leave one out")
    if grid is not None or polygon is not None:
        if len(centre) != 2:
            raise InputError(f"--at {at} with a campaign", "a place along both tangents of a plane", "give two numbers")
        corners = corners_of(polygon or "", "--polygon")
        places = lattice(*grid_of(grid, "--grid"), spacing, centre) if grid is not None else within(corners, spacing)
    order = shortest_tour(places)
    motion = planner.plan([Poke(places[k], moved, hold, lean) for k in order])
    travel = tour_length(places, order)
    if len(places) > 1:
        typer.echo(
            f"{len(places)} places, {travel:.3f} m of travel between them "
            f"({tour_length(places, range(len(places))):.3f} m row by row)"
        )
    visited = [list(places[k]) for k in order]
    facts = {"signal": moved.to_dict(), "hold": hold, "tilt": list(lean), "travel": travel, "places": visited}
    finish(o, motion, planner.rig, facts)


@app.command("slide", epilog=SLIDE_EXAMPLES)
@with_options
def slide(
    o: Options,
    through: Annotated[
        str | None, typer.Option(help="Corners x,y;x,y;… along both tangents, or x,y,z;… on a mesh [m].")
    ] = None,
    four_paths: Annotated[
        float | None, typer.Option(help="Instead: both tangents and both diagonals, so long [m].")
    ] = None,
    at: Annotated[str, typer.Option(help="Where the four paths cross, along both tangents x,y [m].")] = "0,0",
    depth: Annotated[float, typer.Option(help="Kept while sliding [m].")] = 0.0025,
    speed: Annotated[float, typer.Option(help="Along the surface [m/s].")] = 0.003,
    hold: Annotated[float, typer.Option(help="At the depth before sliding [s].")] = 1.0,
    back: Annotated[bool, typer.Option("--back/--one-way", help="Whether each path is slid back too.")] = True,
) -> None:
    """Approach, hold, slide along a polyline, retract and return."""
    check(o)
    from kinid.planning import Slide
    from kinid.planning import four_paths as crossing

    if (through is None) == (four_paths is None):
        raise InputError(
            "--through and --four-paths" if through else "neither --through nor --four-paths",
            "one of them",
            'name corners, as --through "0,0;0.02,0"',
        )
    if through is not None:
        o.refuse(("at",), "with --through", "--four-paths, which cross there")
    planner = planner_of(o)
    if four_paths is not None:
        if not 0.0 < four_paths < 10.0:
            raise InputError(f"--four-paths {four_paths}", "a length in m", "correct it")
        slides = crossing(four_paths, place_of(at, "--at"), depth=depth, speed=speed, hold=hold, back=back)
    else:
        slides = (Slide(tuple(corners_of(through or "", "--through")), depth, speed, hold, back),)
    finish(o, planner.plan(slides), planner.rig, {"slides": [each.to_dict() for each in slides]})


@app.command("excite", epilog=EXCITE_EXAMPLES)
@with_options
def excite(
    o: Options,
    criterion: Annotated[
        str, typer.Option(help="D: volume of the confidence region; A: sum of squared intervals.")
    ] = "D",
    duration: Annotated[
        float | None, typer.Option(help="Of the motion [s]; default: 4 in contact, 10 in the air.")
    ] = None,
    max_depth: Annotated[float, typer.Option(help="Never deeper than this [m].")] = 0.02,
    min_depth: Annotated[float, typer.Option(help="Never less deep than this during the motion [m].")] = 0.0005,
    max_speed: Annotated[float, typer.Option(help="Of the tip along the normal [m/s].")] = 0.15,
    bandwidth: Annotated[float, typer.Option(help="In which the robot follows; no sine is faster [Hz].")] = 3.0,
    sines: Annotated[int, typer.Option(help="How many (in the air: of each joint).")] = 3,
    noise: Annotated[
        float | None, typer.Option(help="Of the normal force [N]; default: the rig's, else 0.029.")
    ] = None,
    at: Annotated[str, typer.Option(help="Place of the poke, as for kinid plan poke [m].")] = "0,0",
    hold: Annotated[float, typer.Option(help="Before the motion [s].")] = 1.0,
    start: Annotated[str | None, typer.Option(help="In the air: posture to swing about, q1,q2,… [rad].")] = None,
) -> None:
    """The motion that tells most about a model's parameters, and the 95 % intervals to expect before anything moves."""
    check(o)
    from kinid.planning.excite import NOISE, check_asked
    from kinid.planning.poke_design import Bounds

    chosen, values = model_of(o)
    check_asked(sines, criterion, NOISE if noise is None else noise)
    if chosen.contact_law is None:
        o.refuse(
            ("force", "max_depth", "min_depth", "max_speed", "noise", "at", "hold"),
            "in the air",
            "a contact law in the model, or options of a motion in the air",
        )
        bounds = Bounds(bandwidth=bandwidth, duration=10.0 if duration is None else duration)
        _excite_free(o, chosen, values, bounds, criterion, sines, start)
        return
    o.refuse(("start",), "with a contact law", "--at, where it is poked")
    limit, seconds = float("inf") if o.force is None else o.force, 4.0 if duration is None else duration
    bounds = Bounds(max_depth, min_depth, limit, max_speed, bandwidth, seconds)
    _excite_contact(o, bounds, criterion, sines, noise, place_of(at, "--at"), hold)


def _excite_contact(
    o: Options,
    bounds: Bounds,
    criterion: str,
    sines: int,
    noise: float | None,
    place: tuple[float, ...],
    hold: float,
) -> None:
    from kinid.cli.show import console
    from kinid.planning import Poke
    from kinid.planning.excite import NOISE, optimise
    from kinid.planning.ideal import efficiency, ideal_information

    planner = planner_of(o)
    law, stated = planner.law, planner.rig.sensor.noise
    assert law is not None
    sigma = noise if noise is not None else float(stated[2]) if stated is not None and stated[2] > 0 else NOISE
    console().print(f"the signal is optimised ({criterion}-optimal) …")
    joints = planner.joints(place, bounds.deepest)
    found = optimise(law, bounds, sines=sines, criterion=criterion, noise=sigma, rate=o.rate, joints=joints)
    motion = planner.plan([Poke(place, found.signal, hold)])
    ideal = ideal_information(law, bounds, criterion=criterion, noise=sigma, rate=o.rate)
    share = None if ideal is None else efficiency(found.information, ideal, criterion)
    facts = {**found.to_dict(), "efficiency": share, "model": list(law.model.names), "noise": sigma}
    provenance = {**motion.provenance, "excitation": facts, "intervals": facts["intervals"]}
    motion = dataclasses.replace(motion, provenance=provenance)
    lines = ", ".join(f"{1e3 * a:.3g} mm at {f:.3g} Hz" for a, f, *_ in found.signal.sines if abs(a) > 1e-5)
    bound = ", ".join(bound_words(name, motion) for name in found.binding) or "nothing"
    typer.echo(
        f"{lines or 'no sine'} about {1e3 * found.signal.depth:.3g} mm; at most {1e3 * found.deepest:.3g} mm, "
        f"{found.force:.3g} N, {1e3 * found.speed:.3g} mm/s; bound by {bound}"
    )
    if share is not None:
        typer.echo(
            f"the best conceivable poke within these bounds would tell as much in {100 * share:.0f} % of the time"
        )
    show_intervals(found.intervals.values())
    finish(o, motion, planner.rig, facts)


def _excite_free(
    o: Options,
    model: Model,
    values: dict[str, float],
    bounds: Bounds,
    criterion: str,
    sines: int,
    start: str | None,
) -> None:
    import numpy as np

    from kinid.cli.show import console
    from kinid.data.rig import Rig
    from kinid.planning.free_motion import excite_free
    from kinid.robotics.robot import Robot

    the_rig = Rig.load(o.rig)
    robot = Robot.load(the_rig)
    posture = None if start is None else np.array(numbers(start, "--start"))
    console().print(f"a free motion is sought ({criterion}-optimal) …")
    found = excite_free(
        the_rig,
        model,
        values,
        bounds=bounds,
        start=posture,
        sines=sines,
        criterion=criterion,
        rate=o.rate,
        limits=limits_of(o, the_rig, robot),
        collisions=o.collision,
    )
    show_intervals(found.intervals.values())
    facts = {
        "model": list(model.names),
        "criterion": criterion,
        "cost": found.cost,
        "swing": found.swing.to_dict(),
        "intervals": {name: each.to_dict() for name, each in found.intervals.items()},
    }
    finish(o, found.trajectory, the_rig, facts)


@app.command("discriminate", epilog=DISCRIMINATE_EXAMPLES)
@with_options
def discriminate_(
    o: Options,
    effects: Annotated[
        str,
        typer.Option(
            help="Candidates that are to be told apart, a,b or more.",
            show_default=False,
            autocompletion=complete.effects,
        ),
    ],
    duration: Annotated[
        float, typer.Option(help="About [s]; the longer, the smaller the effects that it tells.")
    ] = 20.0,
    max_depth: Annotated[float, typer.Option(help="Never deeper than this [m].")] = 0.004,
    bandwidth: Annotated[float, typer.Option(help="In which the robot follows; no sine is faster [Hz].")] = 3.0,
    at: Annotated[str, typer.Option(help="Place, as for kinid plan poke [m].")] = "0,0",
) -> None:
    """The experiment that tells candidate effects apart best, and why it does."""
    check(o)
    from rich.table import Table

    from kinid.cli.show import console, right
    from kinid.planning.discriminate import HOPELESS, discriminate

    chosen, values = model_of(o)
    planner = planner_of(o, expecting=False)
    found = discriminate(
        planner,
        chosen,
        names(effects),
        values,
        duration=duration,
        depth=max_depth,
        place=place_of(at, "--at"),
        bandwidth=bandwidth,
    )
    title = "How far apart the candidates are, in standard deviations of the noise"
    table = Table("experiment", *right("s", "apart"), title=title)
    for _, title, seconds, distance in found.table:
        apart = f"{distance**0.5:.3g}" if distance >= HOPELESS else f"below {HOPELESS**0.5:g}"
        table.add_row(title, f"{seconds:.1f}", apart)
    console().print(table)
    typer.echo(found.words)
    for name, why in found.refused.items():
        typer.echo(f"left out: {name}: {why}")
    for form in found.open:
        typer.echo(f"beyond every experiment, and not counted above: to tell {form}")
    finish(o, found.trajectory, planner.rig, found.to_dict())
