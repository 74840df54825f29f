"""`kinid lab`: virtual experiments whose truth is known."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from kinid.cli import complete
from kinid.cli.options import grid, numbers
from kinid.errors import InputError

EXAMPLES = """Examples:

kinid lab ecoflex-50 -o ecoflex

kinid lab poke --material sponge --hide relaxation --seed 7 -o secret --json run.json

kinid lab mould --campaign 10x10 -o campaign

kinid lab mould --campaign 10x10 --hide relaxation --where 0,-0.05,0.05,0 -o part

kinid lab mould --campaign 10x10 --precision 0.05 -o quick

kinid lab --trajectory plan.parquet --rig rig.toml --material dragon-skin-10 -o run

kinid lab study -o found

kinid lab slides -o slid

kinid lab teleoperation -o study

kinid lab teleoperation --material mould --map mould.parquet --at 0.02,0.02 -o study

kinid lab control -o control
"""

TELEOPERATION, STUDY, CONTROL, SLIDES = "teleoperation", "study", "control", "slides"
#: options that mean nothing without another one, and what that says
NEEDS = (
    ("--where", "--hide", "the effect that is hidden there"),
    ("--spacing", "--campaign", "a grid, as 10x10"),
    ("--rig", "--trajectory", "what was planned for it"),
    ("--precision", "--campaign", "a grid of pokes, as 10x10"),
    ("--prior", "--precision", "how well stiffness and damping are to be known, as 0.05"),
)
#: options that a study ignores, unless it takes them
NOT_OF_STUDIES = (
    "--material",
    "--hide",
    "--campaign",
    "--point",
    "--normal",
    "--mcap",
    "--torque-limit",
    "--stiffness",
)
#: the studies, with those that each takes, and all that it takes in words
STUDIES: dict[str | None, tuple[set[str], str]] = {
    TELEOPERATION: ({"--material"}, "--material, --seed, --map and --at alone"),
    STUDY: (set(), "--seed alone"),
    CONTROL: (set(), "--seed and --map alone"),
    SLIDES: (set(), "--seed alone"),
}
#: default of the controller's translational stiffness [N/m]
STIFFNESS = 5200.0


# as long as its options and their help
def lab(
    out: Annotated[Path, typer.Option("-o", "--out", help="Folder for logs, rig and truth.", show_default=False)],
    experiment: Annotated[
        str | None,
        typer.Argument(
            help="poke, slide, band, sponge, ecoflex-50, dragon-skin-10, mould, free-mould, walled-mould, wave; or a "
            "study: teleoperation; control, force control with a map; slides, borders along four slides over the "
            "mould; or study, which finds the published materials again.",
            show_default=False,
        ),
    ] = None,
    trajectory: Annotated[
        Path | None, typer.Option(help="Instead: a trajectory that kinid plan wrote, carried out.", show_default=False)
    ] = None,
    rig: Annotated[
        Path | None,
        typer.Option(help="The rig that the trajectory was planned for; default: rig.toml beside it, if any."),
    ] = None,
    material: Annotated[
        str | None, typer.Option(help="What is touched; default: the experiment's, else ecoflex-50.")
    ] = None,
    hide: Annotated[
        str | None,
        typer.Option(
            help="Effect to plant, of a size by the seed; only truth/ tells it.", autocompletion=complete.hidden
        ),
    ] = None,
    where: Annotated[
        str | None,
        typer.Option(help="Part of the surface that has it, along both tangents: x0,y0,x1,y1 [m]; default: all."),
    ] = None,
    seed: Annotated[int, typer.Option(help="Seed of sensor faults, noise and hidden effect.")] = 0,
    campaign: Annotated[
        str | None,
        typer.Option(
            help="A grid of pokes (of slides with slide), as 10x10; started again, it goes on where it stopped."
        ),
    ] = None,
    spacing: Annotated[float | None, typer.Option(help="Between the places of a campaign [m]; default: 0.01.")] = None,
    precision: Annotated[
        float | None,
        typer.Option(
            help="Of pokes of a campaign: each ends as soon as half of the 95 % intervals of stiffness and damping is "
            "this share of them, as 0.05."
        ),
    ] = None,
    prior: Annotated[
        str | None,
        typer.Option(
            help="What such pokes expect of their place: neighbours, a map or a fit (JSON) beside them, or none.",
            show_default="neighbours",
        ),
    ] = None,
    stiffness: Annotated[
        float, typer.Option(help="Translational stiffness of the impedance controller [N/m].")
    ] = STIFFNESS,
    torque_limit: Annotated[
        str | None,
        typer.Option(help="Of the drives: one for all joints, or seven, as 176,176,100,… [N·m]; default: the arm's."),
    ] = None,
    point: Annotated[str | None, typer.Option(help="A point of the surface, base frame: x,y,z [m].")] = None,
    normal: Annotated[str | None, typer.Option(help="Normal of the surface, base frame: x,y,z.")] = None,
    mcap: Annotated[
        bool | None,
        typer.Option(help="Write the streams, as MCAP and Parquet; default: of one experiment, not of a campaign."),
    ] = None,
    measured_map: Annotated[
        Path | None,
        typer.Option(
            "--map",
            help="Of teleoperation and control: a map that kinid map wrote, reflected to the operator or steered by.",
            show_default="poked first",
        ),
    ] = None,
    at: Annotated[
        str | None,
        typer.Option(help="Of teleoperation: the place that is touched, along both tangents: x,y [m]; default: 0,0."),
    ] = None,
    json_file: Annotated[
        Path | None,
        typer.Option("--json", help="Summary to write as JSON: what was made and how well it was followed."),
    ] = None,
) -> None:
    """An LWR4+ under impedance control pokes and slides: its raw log, the rig, and the truth in a folder of its own."""
    given = {
        "--rig": rig,
        "--trajectory": trajectory,
        "--material": material,
        "--hide": hide,
        "--where": where,
        "--campaign": campaign,
        "--spacing": spacing,
        "--precision": precision,
        "--prior": prior,
        "--point": point,
        "--normal": normal,
        "--mcap": mcap,
        "--torque-limit": torque_limit,
        "--stiffness": None if stiffness == STIFFNESS else stiffness,
        "--map": measured_map,
        "--at": at,
    }
    _check(experiment, seed, out, {name for name, value in given.items() if value is not None})
    from kinid.cli import lab_runs as runs
    from kinid.cli.show import written
    from kinid.writers import check_outputs, write_json

    check_outputs((json_file,), (rig, trajectory, measured_map, None if prior is None else Path(prior)))
    asked = runs.Asked(
        material,
        hide,
        None if where is None else _rectangle(where),
        seed,
        stiffness,
        None if torque_limit is None else _limits(torque_limit),
        None if point is None else _vector(point, "--point"),
        None if normal is None else _vector(normal, "--normal"),
    )
    if experiment == TELEOPERATION:
        x, y = (0.0, 0.0) if at is None else _numbers(at, 2, "--at", "0.02,0.02")
        from kinid.cli.lab_teleoperation import teleoperation

        summary = teleoperation(out, material or "ecoflex-50", seed, measured_map, (x, y))
    elif experiment == CONTROL:
        from kinid.cli.lab_control import control

        summary = control(out, seed, measured_map)
    elif experiment == STUDY:
        from kinid.cli.lab_study import study

        summary = study(out, seed)
    elif experiment == SLIDES:
        from kinid.cli.lab_slides import slides

        summary = slides(out, seed)
    elif campaign is not None and experiment is not None:
        places = grid(campaign, "--campaign")
        start = None if precision is None or prior == "none" else prior or "neighbours"
        apart = 0.01 if spacing is None else spacing
        summary = runs.campaign(experiment, asked, places, apart, bool(mcap), out, precision, start)
    else:
        summary = runs.single(out, asked, experiment, trajectory, rig, mcap is None or mcap)
    if json_file is not None:
        write_json(json_file, summary)
    written((json_file,))


def _check(experiment: str | None, seed: int, out: Path, given: set[str]) -> None:
    """What doesn't go together.

    Args:
        given: options that the user named.

    Raises:
        InputError: which.
    """
    if (experiment is None) == ("--trajectory" not in given):
        found = "neither an experiment nor --trajectory" if experiment is None else f"'{experiment}' and --trajectory"
        raise InputError(found, "one of them", "name an experiment, as kinid lab poke -o DIR, or a trajectory")
    if seed < 0:
        raise InputError(f"--seed {seed}", "0 or more", "choose another")
    if out.exists() and not out.is_dir():
        raise InputError(f"a file at {out}", "a folder for the results", "choose another -o/--out")
    for option, needed, says in NEEDS:
        if option in given and needed not in given:
            raise InputError(f"{option} without {needed}", says, f"name it with {needed}")
    if "--campaign" in given and experiment in (None, "wave"):
        raise InputError(
            f"--campaign with {experiment or '--trajectory'}",
            "pokes, or slides with slide",
            "leave it out, or plan the campaign with kinid plan poke --grid 3x3 -o PLAN.parquet",
        )
    for option, studies in (("--map", (TELEOPERATION, CONTROL)), ("--at", (TELEOPERATION,))):
        if option in given and experiment not in studies:
            raise InputError(
                f"{option} without {' or '.join(studies)}",
                "kinid lab teleoperation -o DIR, which reflects a map",
                "leave it out",
            )
    if experiment in STUDIES:
        takes, words = STUDIES[experiment]
        if ignored := [option for option in NOT_OF_STUDIES if option in given - takes]:
            raise InputError(f"{experiment} with {', '.join(ignored)}", words, "leave the others out")


def _numbers(text: str, count: int, option: str, example: str) -> tuple[float, ...]:
    return numbers(text, option, f"{count} numbers, as {example}", counts=(count,), below=1e6)


def _limits(text: str) -> tuple[float, ...]:
    count = text.count(",") + 1
    return _numbers(text, count if count in (1, 7) else 7, "--torque-limit", "100, or seven of them")


def _vector(text: str, option: str) -> tuple[float, float, float]:
    x, y, z = _numbers(text, 3, option, "0.55,0,0.1")
    return x, y, z


def _rectangle(text: str) -> tuple[tuple[float, float], tuple[float, float]]:
    x0, y0, x1, y1 = _numbers(text, 4, "--where", "0,-0.05,0.05,0")
    return (x0, y0), (x1, y1)
