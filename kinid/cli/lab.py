"""`kinid lab`: virtual experiments whose truth is known."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from kinid.cli import complete
from kinid.errors import InputError

if TYPE_CHECKING:
    from rich.progress import Progress

    from kinid.lab.campaign import Campaign
    from kinid.lab.setup import Result, Setup

EXAMPLES = """Examples:

kinid lab ecoflex-50 -o ecoflex

kinid lab poke --material sponge --hide relaxation --seed 7 -o secret --json run.json

kinid lab mould --campaign 10x10 -o campaign

kinid lab mould --campaign 10x10 --hide relaxation --where 0,-0.05,0.05,0 -o part

kinid lab --trajectory plan.parquet --rig rig.toml --material dragon-skin-10 -o run

kinid lab study -o found

kinid lab teleoperation -o study

kinid lab teleoperation --material mould --map mould.parquet --at 0.02,0.02 -o study
"""

Vector = tuple[float, float, float]
Rectangle = tuple[tuple[float, float], tuple[float, float]]


@dataclass(frozen=True)
class Asked:
    """What every kind of experiment is asked for."""

    material: str | None
    hide: str | None
    where: Rectangle | None
    seed: int
    stiffness: float
    torque_limit: tuple[float, ...] | None
    point: Vector | None
    normal: Vector | None


def lab(
    out: Annotated[Path, typer.Option("-o", "--out", help="Folder for logs, rig and truth.", show_default=False)],
    experiment: Annotated[
        str | None,
        typer.Argument(
            help="poke, slide, band, sponge, ecoflex-50, dragon-skin-10, mould, wave; or a study: teleoperation, or "
            "study, which finds the published materials again.",
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
    stiffness: Annotated[
        float, typer.Option(help="Translational stiffness of the impedance controller [N/m].")
    ] = 5200.0,
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
            help="Of teleoperation: a map that kinid map wrote, reflected to the operator.",
            show_default="the place is poked first",
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
    if (experiment is None) == (trajectory is None):
        found = "neither an experiment nor --trajectory" if experiment is None else f"'{experiment}' and --trajectory"
        raise InputError(found, "one of them", "name an experiment, as kinid lab poke, or a trajectory")
    _check(
        experiment,
        seed,
        out,
        {
            "--where": where,
            "--hide": hide,
            "--spacing": spacing,
            "--campaign": campaign,
            "--rig": rig,
            "--trajectory": trajectory,
        },
    )
    if json_file is not None:
        from kinid.writers import check_outputs

        check_outputs((json_file,), (rig, trajectory, measured_map))
    asked = Asked(
        material,
        hide,
        None if where is None else _rectangle(where),
        seed,
        stiffness,
        None if torque_limit is None else _limits(torque_limit),
        None if point is None else _vector(point, "--point"),
        None if normal is None else _vector(normal, "--normal"),
    )
    for option, value in (("--map", measured_map), ("--at", at)):
        if value is not None and experiment != "teleoperation":
            raise InputError(
                f"{option} without teleoperation", "kinid lab teleoperation, which reflects a map", "leave it out"
            )
    if experiment == "teleoperation":
        others = {
            "--hide": hide,
            "--campaign": campaign,
            "--point": point,
            "--normal": normal,
            "--mcap": mcap,
            "--torque-limit": torque_limit,
            "--stiffness": None if stiffness == 5200.0 else stiffness,
        }
        if given := [name for name, value in others.items() if value is not None]:
            raise InputError(
                f"teleoperation with {', '.join(given)}",
                "--material, --seed, --map and --at alone",
                "leave the others out",
            )
        x, y = (0.0, 0.0) if at is None else _numbers(at, 2, "--at", "0.02,0.02")
        summary = _teleoperation(out, asked, measured_map, (x, y))
    elif experiment == "study":
        others = {
            "--material": material,
            "--hide": hide,
            "--campaign": campaign,
            "--point": point,
            "--normal": normal,
            "--mcap": mcap,
            "--torque-limit": torque_limit,
            "--stiffness": None if stiffness == 5200.0 else stiffness,
        }
        if given := [name for name, value in others.items() if value is not None]:
            raise InputError(f"study with {', '.join(given)}", "--seed alone", "leave the others out")
        from kinid.cli.lab_study import study

        summary = study(out, seed)
    elif campaign is not None and experiment is not None:
        summary = _campaign(_task(experiment, asked, campaign, 0.01 if spacing is None else spacing, bool(mcap)), out)
    else:
        summary = _single(out, asked, experiment, trajectory, rig, mcap is None or mcap)
    if json_file is not None:
        from kinid.cli.show import written
        from kinid.writers import write_text

        write_text(json_file, json.dumps(summary, indent=1) + "\n")
        written([json_file])


def _check(experiment: str | None, seed: int, out: Path, given: dict[str, object]) -> None:
    """What doesn't go together."""
    if seed < 0:
        raise InputError(f"--seed {seed}", "0 or more", "choose another")
    if out.exists() and not out.is_dir():
        raise InputError(f"a file at {out}", "a folder for the results", "choose another -o/--out")
    for option, needed, says in (
        ("--where", "--hide", "the effect that is hidden there"),
        ("--spacing", "--campaign", "a grid, as 10x10"),
        ("--rig", "--trajectory", "what was planned for it"),
    ):
        if given[option] is not None and given[needed] is None:
            raise InputError(f"{option} without {needed}", says, f"name it with {needed}")
    if given["--campaign"] is not None and experiment in (None, "wave"):
        raise InputError(
            f"--campaign with {experiment or '--trajectory'}",
            "pokes, or slides with slide",
            "leave it out, or plan the campaign with kinid plan poke --grid",
        )


def _single(
    out: Path, asked: Asked, experiment: str | None, trajectory: Path | None, rig: Path | None, mcap: bool
) -> dict[str, Any]:
    """One experiment, by its name or as it was planned."""
    from kinid.lab.folder import at_work, begin, check_free, done
    from kinid.lab.writing import check_mcap, write_experiment

    if mcap:
        check_mcap()
    check_free(out)
    setup = _prepared(asked, experiment)
    truth: dict[str, object] = {"experiment": experiment or "trajectory"}
    if trajectory is not None:
        setup, truth["trajectory"] = _planned(setup, asked, trajectory, rig), trajectory.name
    nominal = setup
    if asked.hide is not None:
        from kinid.lab.hidden import check_met
        from kinid.lab.hidden import hide as plant

        setup, truth["hidden"] = plant(setup, asked.hide, asked.seed, asked.where)
        if asked.where is not None:
            check_met(asked.where, setup.script.place[setup.script.touching, :2])
    setup.check()
    with _progress() as progress:
        bar = progress.add_task(f"{len(setup.script.t) * setup.gains.period:.1f} s of set-points", total=1.0)
        result = setup.run(lambda share: progress.update(bar, completed=share))
    guard: list[str] = []
    if trajectory is not None:
        from kinid.lab.planned import guarded

        result, guard = guarded(result)
    with at_work(out):
        check_free(out)
        begin(out)
        path = write_experiment(out, result, truth, mcap=mcap)
        done(out)
    return {"experiment": truth["experiment"], "seed": asked.seed} | _show(path, result, nominal, mcap, guard)


def _prepared(asked: Asked, experiment: str | None) -> Setup:
    from kinid.lab import experiments
    from kinid.lab.arm import Gains

    return experiments.prepare(
        experiment or "poke",
        material=asked.material,
        seed=asked.seed,
        point=asked.point,
        gains=Gains(translation=asked.stiffness),
        normal=asked.normal,
        torque_limit=asked.torque_limit,
    )


def _planned(base: Setup, asked: Asked, trajectory: Path, rig: Path | None) -> Setup:
    """The set-up that carries a trajectory out on its rig's surface."""
    from kinid.cli.show import console
    from kinid.data.rig import Rig
    from kinid.lab.planned import doubts, planned

    beside = trajectory.parent / "rig.toml"
    if rig is None and beside.is_file():
        rig = beside
    setup, ahead = planned(
        trajectory, None if rig is None else Rig.load(rig), base=base, point=asked.point, normal=asked.normal
    )
    console().print(
        f"surface and tool of {rig}" if rig is not None else "surface and tool of the laboratory; a rig's: --rig",
        markup=False,
    )
    for line in doubts(setup):
        console().print(line, style="yellow", markup=False)
    if not ahead:
        console().print(
            "the plan expects no forces (no --model): the tip stays behind it by force over stiffness", markup=False
        )
    return setup


def _teleoperation(out: Path, asked: Asked, measured_map: Path | None, place: tuple[float, float]) -> dict[str, Any]:
    from kinid.cli.show import console, written
    from kinid.lab import teleoperation
    from kinid.lab.folder import at_work, check_free

    check_free(out)
    with console().status("a poke, its fit, and the study …"):
        found = teleoperation.compare(
            asked.material or "ecoflex-50", asked.seed, measured_map=measured_map, place=place
        )
    with at_work(out):
        check_free(out)
        page = teleoperation.write(out, found)
    console().print(
        f"{found.material} at ({1e3 * place[0]:g}, {1e3 * place[1]:g}) mm: true {found.truth.stiffness:.4g} N/m and "
        f"{found.truth.damping:.3g} N·s/m; {found.told} says {found.believed.stiffness:.4g} N/m and "
        f"{found.believed.damping:.3g} N·s/m",
        markup=False,
    )
    console().print(found.study.table(), markup=False)
    written([out / "teleoperation.json", page])
    facts: dict[str, Any] = json.loads((out / "teleoperation.json").read_text(encoding="utf-8"))
    return {"experiment": "teleoperation", "seed": asked.seed, "page": str(page)} | facts


def _task(experiment: str, asked: Asked, grid: str, spacing: float, mcap: bool) -> Campaign:
    from kinid.lab import experiments
    from kinid.lab.campaign import Campaign
    from kinid.lab.materials import material as named

    rows, columns = _grid(grid)
    chosen = named(asked.material or experiments.named(experiment).material)
    return Campaign(
        rows,
        columns,
        spacing,
        "slide" if experiment == "slide" else "poke",
        material=chosen.name,
        seed=asked.seed,
        hidden=asked.hide,
        where=asked.where,
        stiffness=asked.stiffness,
        torque_limit=asked.torque_limit,
        point=asked.point,
        normal=asked.normal,
        mcap=mcap,
    )


def _progress() -> Progress:
    from rich.progress import BarColumn, Progress, TaskProgressColumn, TextColumn, TimeRemainingColumn

    from kinid.cli.show import console

    columns = (TextColumn("{task.description}"), BarColumn(), TaskProgressColumn(), TimeRemainingColumn())
    out = console()
    return Progress(*columns, console=out, transient=True, disable=not out.is_terminal)


def _campaign(task: Campaign, out: Path) -> dict[str, Any]:
    from kinid.lab import campaign
    from kinid.lab.campaign_page import NAME
    from kinid.lab.writing import check_mcap

    if task.mcap:
        check_mcap()
    with _progress() as progress:
        bar = progress.add_task(f"{task.count} {task.touch}s on {task.material}", total=task.count)
        try:
            made = campaign.run(task, out, lambda index: progress.update(bar, completed=index + 1))
        except KeyboardInterrupt:
            whole = round(progress.tasks[0].completed)
            typer.echo(
                f"stopped: {whole} of {task.count} {task.touch}s are whole in {out}; the same command again goes on "
                f"there",
                err=True,
            )
            raise typer.Exit(130) from None
    there = f" ({task.count - made} were there already)" if made < task.count else ""
    typer.echo(
        f"{made} {task.touch}s made{there}: {out}/{task.touch}_*.parquet, {out / 'rig.toml'}; at a glance: "
        f"{out / NAME}; "
        f"the truth, which no other command reads: {out / 'truth'}"
    )
    logs = sorted(out.glob(f"{task.touch}_*.parquet"))
    return {
        "experiment": "campaign",
        "seed": task.seed,
        "count": task.count,
        "made": made,
        "logs": [str(log) for log in logs],
        "rig": str(out / "rig.toml"),
        "page": str(out / NAME),
        "truth": str(out / "truth"),
    }


def _show(path: Path, result: Result, nominal: Setup, mcap: bool, guard: list[str]) -> dict[str, Any]:
    from rich.table import Table

    from kinid.cli.show import console
    from kinid.lab.outcome import outcomes, remarks

    found = outcomes(result)

    table = Table(title=f"{path}")
    table.add_column("phase")
    table.add_column("time \\[s]", justify="right")
    for title in ("deepest \\[mm]", "of \\[mm]", "off set-point \\[mm rms]", "force, most \\[N]"):
        table.add_column(title, justify="right")
    for o in found:
        inside = ("–", "–") if max(o.asked, o.reached) <= 0.0 else (f"{1e3 * o.reached:.2f}", f"{1e3 * o.asked:.2f}")
        table.add_row(o.phase, f"{o.duration:.1f}", *inside, f"{1e3 * o.apart:.2f}", f"{o.force:.2f}")
    console().print(table)
    doubts = [*guard, *remarks(found, result.setup, nominal)]
    for line in doubts:
        console().print(line, style="yellow", markup=False)
    streams = f"; its streams: {path.with_suffix('.mcap')}, {path.parent / 'streams'}" if mcap else ""
    typer.echo(
        f"log: {path}{streams}; what measured it: {path.parent / 'rig.toml'}; the truth, which no other command reads: "
        f"{path.parent / 'truth'}"
    )
    phases = [
        {
            "phase": o.phase,
            "duration": o.duration,
            "depth_asked": o.asked,
            "depth_reached": o.reached,
            "off_set_point": o.apart,
            "force": o.force,
        }
        for o in found
    ]
    made = {"log": path, "rig": path.parent / "rig.toml", "truth": path.parent / "truth"}
    if mcap:
        made |= {"mcap": path.with_suffix(".mcap"), "streams": path.parent / "streams"}
    return {name: str(file) for name, file in made.items()} | {"phases": phases, "doubts": list(doubts)}


def _grid(text: str) -> tuple[int, int]:
    parts = text.lower().replace("×", "x").split("x")
    if len(parts) != 2 or not all(part.strip().isdigit() for part in parts):
        raise InputError(f"--campaign {text}", "rows x columns, as 10x10", "correct it")
    return int(parts[0]), int(parts[1])


def _numbers(text: str, count: int, option: str, example: str) -> list[float]:
    try:
        values = [float(part) for part in text.split(",")]
    except ValueError:
        values = []
    if len(values) != count or not all(abs(v) < 1e6 for v in values):
        raise InputError(f"{option} {text}", f"{count} numbers, as {example}", "correct it")
    return values


def _limits(text: str) -> tuple[float, ...]:
    count = text.count(",") + 1
    return tuple(_numbers(text, count if count in (1, 7) else 7, "--torque-limit", "100, or seven of them"))


def _vector(text: str, option: str) -> Vector:
    x, y, z = _numbers(text, 3, option, "0.55,0,0.1")
    return x, y, z


def _rectangle(text: str) -> Rectangle:
    x0, y0, x1, y1 = _numbers(text, 4, "--where", "0,-0.05,0.05,0")
    return (x0, y0), (x1, y1)
