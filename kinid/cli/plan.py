"""`kinid plan`: motions of the robot that respect it and that excite what is to be estimated."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from kinid.cli.plan_arguments import corners_of, grid_of, numbers_of, place_of, signal_of, sines_of
from kinid.errors import InputError

if TYPE_CHECKING:
    from kinid.plan import Law, Planner, Trajectory
    from kinid.plan.information import Interval
    from kinid.rig import Rig

app = typer.Typer(
    help="Robot trajectories within all limits: pokes, slides, and the motion that tells most about a model.",
    no_args_is_help=True, rich_markup_mode=None, pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)  # fmt: skip

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

RigOption = Annotated[Path, typer.Option(help="What robot, tool and surface there are.")]
OutOption = Annotated[Path, typer.Option("-o", "--out", help="Trajectory to write: Parquet, CSV or NPZ.", show_default=False)]
PlotOption = Annotated[Path | None, typer.Option(help="Plots to write: one offline HTML file.")]
PreviewOption = Annotated[Path | None, typer.Option(help="The moving arm to write: one offline HTML file (meshcat).")]
McapOption = Annotated[Path | None, typer.Option(help="JointTrajectory for ROS 2 to write, as MCAP.")]
ModelOption = Annotated[str | None, typer.Option(help="Contact model to expect forces from; effects separated by commas.")]
FitOption = Annotated[Path | None, typer.Option(help="Model and values as kinid fit --json wrote them.")]
ValueOption = Annotated[list[str] | None, typer.Option(help="A parameter of the model, as stiffness=900; once for each.")]
ForceOption = Annotated[float | None, typer.Option("--force-limit", help="Guarded move: normal force never to pass [N].")]
YawOption = Annotated[float | None, typer.Option(help="Turn of the tool about its axis [rad]; default: what suits the arm.")]
RateOption = Annotated[float, typer.Option(help="Samples a second [Hz].")]
HeightOption = Annotated[float, typer.Option(help="Above the surface between touches [m].")]
PauseOption = Annotated[float, typer.Option(help="Standing in the air before and after each touch [s].")]
SpeedOption = Annotated[float, typer.Option("--travel-speed", help="Of the tip in the air [m/s].")]
ContactOption = Annotated[float, typer.Option("--contact-speed", help="Of the tip on its last way to the surface [m/s].")]
AccelerationOption = Annotated[float | None, typer.Option(help="Limit of all joints [rad/s²]; default: the URDF's, else 4.")]
JerkOption = Annotated[float | None, typer.Option(help="Limit of all joints [rad/s³]; default: the URDF's, else 1000.")]
CollisionOption = Annotated[bool, typer.Option("--collision/--no-collision", help="Whether collisions are looked for.")]


@app.command("poke", epilog=POKE_EXAMPLES)
def poke(
    out: OutOption,
    rig: RigOption = Path("rig.toml"),
    at: Annotated[str, typer.Option(help="Place: x,y along both tangents, or x,y,z of a mesh in the base frame [m].")] = "0,0",
    depth: Annotated[float, typer.Option(help="About which the signal swings [m].")] = 0.003,
    sines: Annotated[str, typer.Option(help="amplitude@frequency [m@Hz], separated by commas.")] = "0.0015@0.9,0.0005@5",
    signal: Annotated[Path | None, typer.Option(help="Instead: a table with t [s] and depth [m].")] = None,
    duration: Annotated[float, typer.Option(help="Of the signal [s].")] = 4.0,
    hold: Annotated[float, typer.Option(help="At the depth before the signal [s].")] = 1.0,
    grid: Annotated[str | None, typer.Option(help="A campaign about the place, as 10x10.")] = None,
    polygon: Annotated[str | None, typer.Option(help="A campaign within corners x,y;x,y;… along both tangents [m].")] = None,
    spacing: Annotated[float, typer.Option(help="Between the pokes of a campaign [m].")] = 0.01,
    model: ModelOption = None, fit: FitOption = None, value: ValueOption = None, force_limit: ForceOption = None,
    yaw: YawOption = None, rate: RateOption = 500.0, height: HeightOption = 0.015, pause: PauseOption = 0.2,
    travel_speed: SpeedOption = 0.1,
    contact_speed: ContactOption = 0.02, acceleration: AccelerationOption = None, jerk: JerkOption = None,
    collision: CollisionOption = True, plot: PlotOption = None, preview: PreviewOption = None, mcap: McapOption = None,
) -> None:  # fmt: skip
    """Approach, hold, poke, retract and return; one place, or a campaign over a grid or a polygon."""
    _check(out, plot, preview, mcap, inputs=(rig, fit, signal))
    from kinid.plan import Multisine, Poke, shortest_tour, within
    from kinid.plan import grid as lattice
    from kinid.plan.touches import tour_length

    moved: Any = Multisine(depth, sines_of(sines), duration) if signal is None else signal_of(signal)
    planner = _planner(rig, model, fit, value, force_limit, yaw, rate, height, pause, travel_speed, contact_speed, acceleration,
                       jerk, collision)  # fmt: skip
    centre = place_of(at, "--at")
    places: list[tuple[float, ...]] = [centre]
    if grid is not None and polygon is not None:
        raise InputError("--grid and --polygon", "one of them", "leave one out")
    if grid is not None or polygon is not None:
        if len(centre) != 2:
            raise InputError(f"--at {at} with a campaign", "a place along both tangents of a plane", "give two numbers")
        corners = corners_of(polygon or "", "--polygon")
        places = lattice(*grid_of(grid), spacing, centre) if grid is not None else within(corners, spacing)
    order = shortest_tour(places)
    motion = planner.plan([Poke(places[k], moved, hold) for k in order])
    if len(places) > 1:
        typer.echo(f"{len(places)} places, {tour_length(places, order):.3f} m of travel between them "
                   f"({tour_length(places, range(len(places))):.3f} m row by row)")  # fmt: skip
    _finish(motion, planner.rig, out, plot, preview, mcap)


@app.command("slide", epilog=SLIDE_EXAMPLES)
def slide(
    out: OutOption,
    rig: RigOption = Path("rig.toml"),
    through: Annotated[str | None, typer.Option(help="Corners x,y;x,y;… along both tangents, or x,y,z;… on a mesh [m].")] = None,
    four_paths: Annotated[float | None, typer.Option(help="Instead: both tangents and both diagonals, so long [m].")] = None,
    at: Annotated[str, typer.Option(help="Where the four paths cross, along both tangents x,y [m].")] = "0,0",
    depth: Annotated[float, typer.Option(help="Kept while sliding [m].")] = 0.0025,
    speed: Annotated[float, typer.Option(help="Along the surface [m/s].")] = 0.003,
    hold: Annotated[float, typer.Option(help="At the depth before sliding [s].")] = 1.0,
    back: Annotated[bool, typer.Option("--back/--one-way", help="Whether each path is slid back too.")] = True,
    model: ModelOption = None, fit: FitOption = None, value: ValueOption = None, force_limit: ForceOption = None,
    yaw: YawOption = None, rate: RateOption = 500.0, height: HeightOption = 0.015, pause: PauseOption = 0.2,
    travel_speed: SpeedOption = 0.1,
    contact_speed: ContactOption = 0.02, acceleration: AccelerationOption = None, jerk: JerkOption = None,
    collision: CollisionOption = True, plot: PlotOption = None, preview: PreviewOption = None, mcap: McapOption = None,
) -> None:  # fmt: skip
    """Approach, hold, slide along a polyline, retract and return."""
    _check(out, plot, preview, mcap, inputs=(rig, fit))
    from kinid.plan import Slide
    from kinid.plan import four_paths as crossing

    if (through is None) == (four_paths is None):
        raise InputError("--through and --four-paths" if through else "neither --through nor --four-paths", "one of them",
                         'name corners, as --through "0,0;0.02,0"')  # fmt: skip
    planner = _planner(rig, model, fit, value, force_limit, yaw, rate, height, pause, travel_speed, contact_speed, acceleration,
                       jerk, collision)  # fmt: skip
    if four_paths is not None:
        if not 0.0 < four_paths < 10.0:
            raise InputError(f"--four-paths {four_paths}", "a length in m", "correct it")
        slides = crossing(four_paths, place_of(at, "--at"), depth=depth, speed=speed, hold=hold, back=back)
    else:
        slides = (Slide(tuple(corners_of(through or "", "--through")), depth, speed, hold, back),)
    _finish(planner.plan(slides), planner.rig, out, plot, preview, mcap)


@app.command("excite", epilog=EXCITE_EXAMPLES)
def excite(
    out: OutOption,
    rig: RigOption = Path("rig.toml"),
    model: ModelOption = None, fit: FitOption = None, value: ValueOption = None,
    criterion: Annotated[str, typer.Option(help="D: volume of the confidence region; A: sum of squared intervals.")] = "D",
    duration: Annotated[float | None, typer.Option(help="Of the motion [s]; default: 4 in contact, 10 in the air.")] = None,
    max_depth: Annotated[float, typer.Option(help="Never deeper than this [m].")] = 0.02,
    min_depth: Annotated[float, typer.Option(help="Never less deep than this during the motion [m].")] = 0.0005,
    force_limit: ForceOption = None,
    max_speed: Annotated[float, typer.Option(help="Of the tip along the normal [m/s].")] = 0.15,
    bandwidth: Annotated[float, typer.Option(help="In which the robot follows; no sine is faster [Hz].")] = 3.0,
    sines: Annotated[int, typer.Option(help="How many (in the air: of each joint).")] = 3,
    noise: Annotated[float | None, typer.Option(help="Of the normal force [N]; default: the rig's, else 0.029.")] = None,
    at: Annotated[str, typer.Option(help="Place of the poke, as for kinid plan poke [m].")] = "0,0",
    hold: Annotated[float, typer.Option(help="Before the motion [s].")] = 1.0,
    start: Annotated[str | None, typer.Option(help="In the air: posture to swing about, q1,q2,… [rad].")] = None,
    yaw: YawOption = None, rate: RateOption = 500.0, height: HeightOption = 0.015, pause: PauseOption = 0.2,
    travel_speed: SpeedOption = 0.1,
    contact_speed: ContactOption = 0.02, acceleration: AccelerationOption = None, jerk: JerkOption = None,
    collision: CollisionOption = True,
    json_file: Annotated[Path | None, typer.Option("--json", help="The expected intervals as JSON.")] = None,
    plot: PlotOption = None, preview: PreviewOption = None, mcap: McapOption = None,
) -> None:  # fmt: skip
    """The motion that tells most about a model's parameters, and the 95 % intervals to expect before anything moves."""
    _check(out, plot, preview, mcap, json_file, inputs=(rig, fit))
    from kinid.model import Model
    from kinid.plan.excite import NOISE, Bounds, optimise

    chosen, values = _model(model, fit, value)
    if not any(effect.base for effect in chosen.effects if effect.id != "rigid-body"):
        _excite_free(rig, chosen, values, criterion, duration, bandwidth, sines, start, rate, acceleration, jerk, collision, out,
                     plot, preview, mcap, json_file)  # fmt: skip
        return
    assert isinstance(chosen, Model)
    from kinid.plan import Poke
    from kinid.plan.ideal import efficiency, ideal_information

    planner = _planner(rig, model, fit, value, force_limit, yaw, rate, height, pause, travel_speed, contact_speed, acceleration,
                       jerk, collision)  # fmt: skip
    law = planner.law
    assert law is not None
    stated = planner.rig.sensor.noise
    sigma = noise if noise is not None else float(stated[2]) if stated is not None and stated[2] > 0 else NOISE
    bounds = Bounds(max_depth, min_depth, float("inf") if force_limit is None else force_limit, max_speed, bandwidth,
                    4.0 if duration is None else duration)  # fmt: skip
    from kinid.cli.show import console

    console().print(f"the signal is optimised ({criterion}-optimal) …")
    found = optimise(law, bounds, sines=sines, criterion=criterion, noise=sigma, rate=rate)
    motion = planner.plan([Poke(place_of(at, "--at"), found.signal, hold)])
    ideal = ideal_information(law, bounds, criterion=criterion, noise=sigma, rate=rate)
    share = None if ideal is None else efficiency(found.information, ideal, criterion)
    facts = {**found.to_dict(), "efficiency": share, "model": list(law.model.names), "noise": sigma}
    provenance = {**motion.provenance, "excitation": facts, "intervals": facts["intervals"]}
    motion = dataclasses.replace(motion, provenance=provenance)
    lines = ", ".join(f"{1e3 * a:.3g} mm at {f:.3g} Hz" for a, f, *_ in found.signal.sines if abs(a) > 1e-5)
    bound = ", ".join(found.binding) or "nothing"
    typer.echo(f"{lines or 'no sine'} about {1e3 * found.signal.depth:.3g} mm; at most {1e3 * found.deepest:.3g} mm, "
               f"{found.force:.3g} N, {1e3 * found.speed:.3g} mm/s; bound by {bound}")  # fmt: skip
    if share is not None:
        typer.echo(f"the best conceivable poke within these bounds would tell as much in {100 * share:.0f} % of the time")
    _show_intervals(found.intervals.values())
    _write_json(json_file, facts)
    _finish(motion, planner.rig, out, plot, preview, mcap, json_file)


def _excite_free(rig: Path, model: Any, values: dict[str, float], criterion: str, duration: float | None, bandwidth: float,
                 sines: int, start: str | None, rate: float, acceleration: float | None, jerk: float | None, collision: bool,
                 out: Path, plot: Path | None, preview: Path | None, mcap: Path | None,
                 json_file: Path | None) -> None:  # fmt: skip
    import numpy as np

    import kinid.urdf
    from kinid.cli.show import console
    from kinid.plan import Limits
    from kinid.plan.excite import Bounds
    from kinid.plan.free_motion import excite_free
    from kinid.rig import Rig
    from kinid.robot import Robot

    the_rig = Rig.load(rig)
    robot = Robot.load(the_rig)
    limits = Limits.of(robot, kinid.urdf.path(robot.name, the_rig.folder), acceleration=acceleration, jerk=jerk)
    posture = None if start is None else np.array(numbers_of(start, "--start"))
    console().print(f"a free motion is sought ({criterion}-optimal) …")
    found = excite_free(the_rig, model, values, bounds=Bounds(bandwidth=bandwidth, duration=duration or 10.0), start=posture,
                        sines=sines, criterion=criterion, rate=rate, limits=limits, collisions=collision)  # fmt: skip
    _show_intervals(found.intervals.values())
    _write_json(json_file, {"model": list(model.names), "criterion": criterion, "cost": found.cost,
                            "swing": found.swing.to_dict(),
                            "intervals": {name: each.to_dict() for name, each in found.intervals.items()}})  # fmt: skip
    _finish(found.trajectory, the_rig, out, plot, preview, mcap, json_file)


@app.command("discriminate", epilog=DISCRIMINATE_EXAMPLES)
def discriminate_(
    out: OutOption,
    effects: Annotated[str, typer.Option(help="Candidates that are to be told apart, a,b or more.", show_default=False)],
    rig: RigOption = Path("rig.toml"),
    model: ModelOption = None, fit: FitOption = None, value: ValueOption = None,
    duration: Annotated[float, typer.Option(help="Of the experiment, about [s].")] = 20.0,
    max_depth: Annotated[float, typer.Option(help="Never deeper than this [m].")] = 0.004,
    bandwidth: Annotated[float, typer.Option(help="In which the robot follows; no sine is faster [Hz].")] = 3.0,
    at: Annotated[str, typer.Option(help="Place, as for kinid plan poke [m].")] = "0,0",
    force_limit: ForceOption = None,
    yaw: YawOption = None, rate: RateOption = 500.0, height: HeightOption = 0.015, pause: PauseOption = 0.2,
    travel_speed: SpeedOption = 0.1,
    contact_speed: ContactOption = 0.02, acceleration: AccelerationOption = None, jerk: JerkOption = None,
    collision: CollisionOption = True,
    json_file: Annotated[Path | None, typer.Option("--json", help="Choice, reasons and all experiments as JSON.")] = None,
    plot: PlotOption = None, preview: PreviewOption = None, mcap: McapOption = None,
) -> None:  # fmt: skip
    """The experiment that tells candidate effects apart best, and why it does."""
    _check(out, plot, preview, mcap, json_file, inputs=(rig, fit))
    from rich.table import Table

    from kinid.cli.show import console
    from kinid.plan.discriminate import discriminate

    chosen, values = _model(model, fit, value)
    planner = _planner(rig, None, None, None, force_limit, yaw, rate, height, pause, travel_speed, contact_speed, acceleration,
                       jerk, collision)  # fmt: skip
    names = [name.strip() for name in effects.split(",") if name.strip()]
    found = discriminate(planner, chosen, names, values, duration=duration, depth=max_depth, place=place_of(at, "--at"),
                         bandwidth=bandwidth)  # fmt: skip
    table = Table(title="How far apart the candidates are, in standard deviations of the noise")
    for name in ("experiment", "s", "apart"):
        table.add_column(name, justify="left" if name == "experiment" else "right")
    for _, title, seconds, distance in found.table:
        table.add_row(title, f"{seconds:.1f}", f"{distance**0.5:.3g}")
    console().print(table)
    typer.echo(found.words)
    for name, why in found.refused.items():
        typer.echo(f"left out: {name}: {why}")
    for name in found.open:
        typer.echo(f"no experiment tells {name}")
    _write_json(json_file, found.to_dict())
    _finish(found.trajectory, planner.rig, out, plot, preview, mcap, json_file)


def _planner(rig: Path, model: str | None, fit: Path | None, value: list[str] | None, force: float | None, yaw: float | None,
             rate: float, height: float, pause: float, travel: float, contact: float, acceleration: float | None,
             jerk: float | None, collision: bool) -> Planner:  # fmt: skip
    import kinid.urdf
    from kinid.plan import Guard, Law, Limits, Planner, Protocol
    from kinid.plan.setpoint import Pace
    from kinid.rig import Rig

    the_rig = Rig.load(rig)
    law: Law | None = None
    if model is not None or fit is not None:
        law = Law(*_model(model, fit, value))
    elif value:
        raise InputError("--value without --model", "the model that it belongs to", "name it with --model or --fit")
    default = Protocol()
    protocol = Protocol(
        height=height, pause=pause, clearance=min(default.clearance, 0.5 * height), rate=rate, yaw=yaw, collisions=collision,
        travel=Pace(travel, default.travel.acceleration, default.travel.jerk),
        contact=Pace(contact, default.contact.acceleration, default.contact.jerk),
        guard=None if force is None else Guard(force),
    )  # fmt: skip
    planner = Planner(the_rig, protocol, law)
    if acceleration is None and jerk is None:
        return planner
    path = kinid.urdf.path(planner.robot.name, the_rig.folder)
    return Planner(the_rig, protocol, law, Limits.of(planner.robot, path, acceleration=acceleration, jerk=jerk))


def _model(model: str | None, fit: Path | None, value: list[str] | None) -> tuple[Any, dict[str, float]]:
    """The model, and the values that are given for it."""
    from kinid.cli.fit import parse_model

    values: dict[str, float] = {}
    if fit is not None:
        from kinid.coupling import load_fit

        named, values = load_fit(fit)
        if model is None:
            model = ",".join(named.names)
        kept = {effect.id for effect in parse_model(model).effects}
        values = {name: v for name, v in values.items() if name.split(".", 1)[0] in kept}
    if model is None:
        raise InputError("no model", "the effects to plan for", "name them with --model, or a fit with --fit")
    for text in value or ():
        name, _, number = text.partition("=")
        try:
            values[name.strip()] = float(number)
        except ValueError:
            raise InputError(f"--value {text}", "a parameter and its value, as stiffness=900", "correct it") from None
    return parse_model(model), values


def _finish(motion: Trajectory, rig: Rig, out: Path, plot: Path | None, preview: Path | None, mcap: Path | None,
            *others: Path | None) -> None:  # fmt: skip
    """Write what was asked for, and show what the motion uses of each limit."""
    from rich.table import Table

    from kinid.cli.show import console, written
    from kinid.writers import write_text

    motion.write(out)
    if plot is not None:
        from kinid.plan.figures import plan_page

        write_text(plot, plan_page(motion, title=out.name))
    if preview is not None:
        from kinid.plan.preview import preview_page

        write_text(preview, preview_page(motion, rig, title=out.name))
    if mcap is not None:
        from kinid.plan.ros import write_joint_trajectory

        write_joint_trajectory(motion, mcap)
    table = Table(title=f"{len(motion)} samples over {motion.duration:.2f} s")
    for name in ("limit", "nearest to it", "used", "value", "limit"):
        table.add_column(name, justify="left" if name in ("limit", "nearest to it") and not table.columns[1:] else "right")
    for use in motion.provenance.get("used", ()):
        table.add_row(use["quantity"], use["joint"], f"{100 * use['share']:.0f} %", f"{use['value']:.4g}", f"{use['limit']:.4g}")
    console().print(table)
    for note in motion.provenance.get("notes", ()):
        typer.echo(f"note: {note}")
    written([path for path in (out, plot, preview, mcap, *others) if path is not None])


def _show_intervals(intervals: Any) -> None:
    from rich.markup import escape
    from rich.table import Table

    from kinid.cli.show import console

    table = Table(title="95 % intervals to expect")
    for name in ("parameter", "assumed", "±", "unit"):
        table.add_column(name, justify="left" if name in ("parameter", "unit") else "right")
    each: Interval
    for each in intervals:
        half = f"{each.half:.2g}" if each.half < float("inf") else "open"
        table.add_row(escape(each.name), f"{each.value:.5g}", half, each.unit)
    console().print(table)


def _write_json(path: Path | None, facts: dict[str, Any]) -> None:
    if path is not None:
        from kinid.writers import write_text

        write_text(path, json.dumps(facts, indent=2, default=str) + "\n")


def _check(out: Path, *others: Path | None, inputs: Sequence[Path | None]) -> None:
    from kinid.writers import check_outputs, check_table_name

    check_table_name(out)
    check_outputs((out, *others), inputs)
