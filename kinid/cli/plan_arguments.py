"""What `kinid plan` is told: options that all its commands share; places, corners, sines, grids; a signal in a
table.
"""

from __future__ import annotations

import dataclasses
import functools
import inspect
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, get_type_hints

import typer

from kinid.cli import complete
from kinid.cli.options import PAGE, ending_in, numbers
from kinid.errors import InputError

if TYPE_CHECKING:
    from kinid.data.rig import Rig
    from kinid.modeling.model import Model
    from kinid.planning import Limits, Planner, Sampled
    from kinid.robotics.robot import Robot


@dataclass(frozen=True, kw_only=True)
class Options:
    """Options of all commands: what there is, how it moves, and what is written. `with_options` gives them to a
    command.
    """

    out: Annotated[
        Path, typer.Option("-o", "--out", help="Trajectory to write: Parquet, CSV or NPZ.", show_default=False)
    ]
    rig: Annotated[Path, typer.Option(help="What robot, tool and surface there are.")] = Path("rig.toml")
    model: Annotated[
        str | None,
        typer.Option(
            help="Contact model to expect forces from; effects separated by commas.", autocompletion=complete.model
        ),
    ] = None
    fit: Annotated[Path | None, typer.Option(help="Model and values as kinid fit --json wrote them.")] = None
    value: Annotated[
        list[str] | None, typer.Option(help="A parameter of the model, as stiffness=900; once for each.")
    ] = None
    force: Annotated[
        float | None, typer.Option("--force-limit", help="Guarded move: normal force never to pass [N].")
    ] = None
    yaw: Annotated[
        float | None, typer.Option(help="Turn of the tool about its axis [rad]; default: what suits the arm.")
    ] = None
    rate: Annotated[float, typer.Option(help="Samples a second [Hz].")] = 500.0
    height: Annotated[float, typer.Option(help="Above the surface between touches [m].")] = 0.015
    pause: Annotated[float, typer.Option(help="Standing in the air before and after each touch [s].")] = 0.2
    travel: Annotated[float, typer.Option("--travel-speed", help="Of the tip in the air [m/s].")] = 0.1
    contact: Annotated[
        float, typer.Option("--contact-speed", help="Of the tip on its last way to the surface [m/s].")
    ] = 0.02
    acceleration: Annotated[
        float | None, typer.Option(help="Limit of all joints [rad/s²]; default: the URDF's, else 4.")
    ] = None
    jerk: Annotated[
        float | None, typer.Option(help="Limit of all joints [rad/s³]; default: the URDF's, else 1000.")
    ] = None
    collision: Annotated[
        bool, typer.Option("--collision/--no-collision", help="Whether collisions are looked for.")
    ] = True
    json: Annotated[Path | None, typer.Option("--json", help="What is planned, and why, as JSON.")] = None
    plot: Annotated[Path | None, typer.Option(help="Plots to write: one offline HTML file.", callback=PAGE)] = None
    preview: Annotated[
        Path | None, typer.Option(help="The moving arm to write: one offline HTML file (meshcat).", callback=PAGE)
    ] = None
    mcap: Annotated[
        Path | None, typer.Option(help="JointTrajectory for ROS 2 to write, as MCAP.", callback=ending_in(".mcap"))
    ] = None

    #: parameters of the command that the user named, its own among them: option and value
    given: Mapping[str, tuple[str, Any]] = field(default_factory=dict)

    @property
    def written(self) -> list[Path]:
        """All files that are asked for."""
        return [path for path in (self.out, self.plot, self.preview, self.mcap, self.json) if path is not None]

    def refuse(self, parameters: tuple[str, ...], why: str, expected: str) -> None:
        """Refuse options that would be ignored."""
        if ignored := [self.given[name][0] for name in parameters if name in self.given]:
            raise InputError(f"{' and '.join(ignored)} {why}", expected, "leave one of them out")


def with_options(command: Callable[..., None]) -> Callable[..., None]:
    """A command whose first argument is `Options`, as one that has all of these options beside its own."""
    fields = [field for field in dataclasses.fields(Options) if field.name != "given"]
    shared, own = get_type_hints(Options, include_extras=True), get_type_hints(command, include_extras=True)
    _, *rest = inspect.signature(command).parameters.values()
    empty = inspect.Parameter.empty
    parameters = [
        inspect.Parameter(
            field.name,
            inspect.Parameter.KEYWORD_ONLY,
            annotation=shared[field.name],
            default=empty if field.default is dataclasses.MISSING else field.default,
        )
        for field in fields
    ]
    # what is the command's own stands first in its help, after where the result goes
    own_parameters = [p.replace(kind=inspect.Parameter.KEYWORD_ONLY, annotation=own[p.name]) for p in rest]
    parameters[1:1] = own_parameters
    parameters.append(inspect.Parameter("context", inspect.Parameter.KEYWORD_ONLY, annotation=typer.Context))

    @functools.wraps(command)
    def run(context: typer.Context, **values: object) -> None:
        given = {
            p.name: (p.opts[-1], values[p.name])
            for p in context.command.params
            if p.name in values and _named(context, p.name)
        }
        command(Options(**{each.name: values.pop(each.name) for each in fields}, given=given), **values)  # type: ignore[arg-type]

    run.__signature__ = inspect.Signature(parameters)  # type: ignore[attr-defined]
    run.__annotations__ = {p.name: p.annotation for p in parameters}
    del run.__wrapped__
    return run


def _named(context: typer.Context, parameter: str) -> bool:
    """Whether the user named it, rather than a default."""
    source = context.get_parameter_source(parameter)
    return source is not None and not source.name.startswith("DEFAULT")


def signal_of(path: Path) -> Sampled:
    """A user's signal: the columns t and depth of a table."""
    import numpy as np

    from kinid.planning import Sampled
    from kinid.planning.trajectory import read_columns

    table = read_columns(path)
    if "t" not in table or "depth" not in table:
        raise InputError(f"{path} with the columns {', '.join(list(table)[:8])}", "t [s] and depth [m]", "name them so")
    return Sampled(np.asarray(table["t"], dtype=float), np.asarray(table["depth"], dtype=float))


def sines_of(text: str) -> tuple[tuple[float, float], ...]:
    """Amplitudes and frequencies: amplitude@frequency [m@Hz], separated by commas."""
    out = []
    for part in filter(None, (p.strip() for p in text.split(","))):
        amplitude, _, frequency = part.partition("@")
        try:
            out.append((float(amplitude), float(frequency)))
        except ValueError:
            raise InputError(
                f"--sines {part}", "amplitude@frequency in m and Hz, as 0.0015@0.9", "correct it"
            ) from None
    return tuple(out)


def place_of(text: str, option: str) -> tuple[float, ...]:
    """x,y along both tangents, or x,y,z in the base frame [m]."""
    values = numbers(text, option)
    if len(values) not in (2, 3):
        raise InputError(f"{option} {text}", "x,y along both tangents, or x,y,z in the base frame [m]", "correct it")
    return values


def angles_of(text: str, option: str) -> tuple[float, float]:
    """Two angles [rad]."""
    values = numbers(text, option)
    if len(values) != 2:
        raise InputError(f"{option} {text}", "two angles a,b in rad", "correct it")
    return values[0], values[1]


def corners_of(text: str, option: str) -> list[tuple[float, ...]]:
    """Places separated by semicolons."""
    return [place_of(part, option) for part in text.split(";") if part.strip()]


def planner_of(o: Options, *, expecting: bool = True) -> Planner:
    """What plans for these options; with the force to expect of their model, or without."""
    from kinid.data.rig import Rig
    from kinid.planning import Guard, Law, Planner, Protocol
    from kinid.planning.setpoint_timing import Pace

    the_rig = Rig.load(o.rig)
    law: Law | None = None
    if expecting and (o.model is not None or o.fit is not None):
        law = Law(*model_of(o))
    elif expecting and o.value:
        raise InputError("--value without --model", "the model that it belongs to", "name it with --model or --fit")
    elif expecting and o.force is not None:
        raise InputError(
            f"a force limit of {o.force:g} N without a model to expect forces from",
            "--model or --fit beside it",
            "name one, as --model hunt-crossley",
        )
    default = Protocol()
    protocol = Protocol(
        height=o.height,
        pause=o.pause,
        clearance=min(default.clearance, 0.5 * o.height),
        rate=o.rate,
        yaw=o.yaw,
        travel=Pace(o.travel, default.travel.acceleration, default.travel.jerk),
        contact=Pace(o.contact, default.contact.acceleration, default.contact.jerk),
        guard=None if o.force is None else Guard(o.force),
        collisions=o.collision,
    )
    planner = Planner(the_rig, protocol, law)
    if o.acceleration is None and o.jerk is None:
        return planner
    return Planner(the_rig, protocol, law, limits_of(o, the_rig, planner.robot))


def limits_of(o: Options, rig: Rig, robot: Robot) -> Limits:
    """Of the joints, with what was asked for."""
    import kinid.urdf
    from kinid.planning import Limits

    return Limits.of(robot, kinid.urdf.path(robot.name, rig.folder), acceleration=o.acceleration, jerk=o.jerk)


def model_of(o: Options) -> tuple[Model, dict[str, float]]:
    """The model, and the values that are given for it."""
    from kinid.cli.fit import parse_model

    model, values = o.model, dict[str, float]()
    if o.fit is not None:
        from kinid.calibration.coupling import load_fit

        named, values = load_fit(o.fit)
        if not named.names or not values:
            missing = "value" if named.names else "effect"
            raise InputError(f"no {missing} in {o.fit}", "a fit of what is touched", "fit anew, or name a --model")
        if model is None:
            model = ",".join(named.names)
        kept = {effect.id for effect in parse_model(model).effects}
        used = {name: v for name, v in values.items() if name.split(".", 1)[0] in kept}
        if not used:
            raise InputError(
                f"a fit of {', '.join(named.names)} in {o.fit}, and the model {model}",
                "values of that model",
                "fit it, or leave out --model or --fit",
            )
        values = used
    if model is None:
        raise InputError("no model", "the effects to plan for", "name them with --model, or a fit with --fit")
    given: list[str] = []
    for text in o.value or ():
        name, _, number = text.partition("=")
        name = name.strip()
        if any(name == other or name.endswith(f".{other}") or other.endswith(f".{name}") for other in given):
            raise InputError(f"two values of {name}", "one of each parameter", "leave out a --value")
        given.append(name)
        try:
            values[name] = float(number)
        except ValueError:
            raise InputError(f"--value {text}", "a parameter and its value, as stiffness=900", "correct it") from None
    return parse_model(model), values


def check(o: Options, signal: Path | None = None) -> None:
    """Refuse outputs that can't be written, before any work is done."""
    from kinid.writers import check_outputs, check_table_name

    check_table_name(o.out)
    check_outputs(o.written, (o.rig, o.fit, signal))
