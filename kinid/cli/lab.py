"""`kinid lab`: virtual experiments whose truth is known."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from kinid.errors import InputError

if TYPE_CHECKING:
    from kinid.lab.campaign import Campaign
    from kinid.lab.setup import Result

EXAMPLES = """Examples:

kinid lab ecoflex-50 -o ecoflex

kinid lab poke --material sponge --hide relaxation --seed 7 -o secret

kinid lab mould --campaign 10x10 -o campaign

kinid lab mould --campaign 10x10 --hide relaxation --where 0,-0.05,0.05,0 -o campaign

kinid lab teleoperation -o study
"""

Vector = tuple[float, float, float]


def lab(
    experiment: Annotated[
        str,
        typer.Argument(help="poke, slide, band, sponge, ecoflex-50, dragon-skin-10, mould, wave; or teleoperation, a study.",
                       show_default=False),
    ],
    out: Annotated[Path, typer.Option("-o", "--out", help="Folder for logs, rig and truth.", show_default=False)],
    material: Annotated[str | None, typer.Option(help="What is touched; default: the experiment's.")] = None,
    hide: Annotated[str | None, typer.Option(help="Effect to plant, of a size by the seed; only truth/ tells it.")] = None,
    where: Annotated[
        str | None, typer.Option(help="Part of the surface that has it, along both tangents: x0,y0,x1,y1 [m]; default: all.")
    ] = None,
    seed: Annotated[int, typer.Option(help="Seed of sensor faults, noise and hidden effect.")] = 0,
    campaign: Annotated[
        str | None, typer.Option(help="A grid of pokes, as 10x10; started again, it goes on where it stopped.")
    ] = None,
    spacing: Annotated[float | None, typer.Option(help="Between the pokes of a campaign [m]; default: 0.01.")] = None,
    stiffness: Annotated[float, typer.Option(help="Translational stiffness of the impedance controller [N/m].")] = 5200.0,
    point: Annotated[str | None, typer.Option(help="A point of the surface, base frame: x,y,z [m].")] = None,
    normal: Annotated[str | None, typer.Option(help="Normal of the surface, base frame: x,y,z.")] = None,
    mcap: Annotated[
        bool | None, typer.Option(help="Write the streams, as MCAP and Parquet; default: of one experiment, not of a campaign.")
    ] = None,
) -> None:
    """An LWR4+ under impedance control pokes and slides: its raw log, the rig, and the truth in a folder of its own."""
    if seed < 0:
        raise InputError(f"--seed {seed}", "0 or more", "choose another")
    if out.exists() and not out.is_dir():
        raise InputError(f"a file at {out}", "a folder for the results", "choose another -o/--out")
    if where is not None and hide is None:
        raise InputError("--where without --hide", "the effect that is hidden there", "name it with --hide")
    if spacing is not None and campaign is None:
        raise InputError("--spacing without --campaign", "a grid of pokes", "name it with --campaign, as 10x10")
    at = None if point is None else _vector(point, "--point")
    up = None if normal is None else _vector(normal, "--normal")
    rectangle = None if where is None else _rectangle(where)
    if experiment == "teleoperation":
        others = {"--hide": hide, "--campaign": campaign, "--point": point, "--normal": normal, "--mcap": mcap,
                  "--stiffness": None if stiffness == 5200.0 else stiffness}  # fmt: skip
        if given := [name for name, value in others.items() if value is not None]:
            raise InputError(f"teleoperation with {', '.join(given)}", "--material and --seed alone", "leave the others out")
        _teleoperation(out, material or "ecoflex-50", seed)
        return
    if campaign is not None:
        _campaign(_task(experiment, material, campaign, spacing, seed, hide, rectangle, stiffness, at, up, bool(mcap)), out)
        return
    from kinid.cli.show import console
    from kinid.lab import experiments
    from kinid.lab.arm import Gains
    from kinid.lab.writing import check_mcap, write_experiment

    mcap = mcap is None or mcap
    if mcap:
        check_mcap()
    setup = experiments.prepare(experiment, material=material, seed=seed, gains=Gains(translation=stiffness), point=at, normal=up)
    truth: dict[str, object] = {"experiment": experiment}
    if hide is not None:
        from kinid.lab.hidden import hide as plant

        setup, truth["hidden"] = plant(setup, hide, seed, rectangle)
    setup.check()
    console().print(f"the arm follows {len(setup.script.t) * setup.gains.period:.1f} s of set-points …")
    result = setup.run()
    path = write_experiment(out, result, truth, mcap=mcap)
    _show(path, result, mcap)


def _teleoperation(out: Path, material: str, seed: int) -> None:
    from kinid.cli.show import console, written
    from kinid.lab import teleoperation

    found = teleoperation.compare(material, seed)
    console().print(found.study.table(), markup=False)
    written([out / "teleoperation.json", teleoperation.write(out, found)])


def _task(
    experiment: str, material: str | None, grid: str, spacing: float | None, seed: int, hide: str | None,
    where: tuple[tuple[float, float], tuple[float, float]] | None, stiffness: float, point: Vector | None, normal: Vector | None,
    mcap: bool,
) -> Campaign:  # fmt: skip
    from kinid.lab import experiments
    from kinid.lab.campaign import Campaign
    from kinid.lab.materials import material as named

    rows, columns = _grid(grid)
    chosen = named(material or experiments.named(experiment).material)
    apart = 0.01 if spacing is None else spacing
    return Campaign(rows, columns, apart, chosen.name, seed, hide, where, stiffness, point, normal, mcap)


def _campaign(task: Campaign, out: Path) -> None:
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

    from kinid.cli.show import console
    from kinid.lab import campaign
    from kinid.lab.campaign_page import NAME
    from kinid.lab.writing import check_mcap

    if task.mcap:
        check_mcap()
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    with Progress(*columns, console=console(), transient=True) as progress:
        bar = progress.add_task(f"pokes on {task.material}", total=task.count)
        made = campaign.run(task, out, lambda index: progress.update(bar, completed=index + 1))
    there = f" ({task.count - made} were there already)" if made < task.count else ""
    typer.echo(f"{made} pokes made{there}: {out}/poke_*.parquet, {out / 'rig.toml'}; at a glance: {out / NAME}; the truth, which "
               f"no other command reads: {out / 'truth'}")  # fmt: skip


def _show(path: Path, result: Result, mcap: bool) -> None:
    from rich.table import Table

    from kinid.cli.show import console

    table = Table(title=f"{path}")
    table.add_column("phase")
    table.add_column("time [s]", justify="right")
    table.add_column("measured force, greatest [N]", justify="right")
    script, force = result.setup.script, result.wrench[:, :3] - result.wrench[:50, :3].mean(axis=0)
    for name in dict.fromkeys(script.phase.tolist()):
        rows = script.phase == name
        table.add_row(name, f"{rows.sum() * result.setup.gains.period:.1f}", f"{(force[rows] ** 2).sum(axis=1).max() ** 0.5:.2f}")
    console().print(table)
    streams = f"; its streams: {path.with_suffix('.mcap')}, {path.parent / 'streams'}" if mcap else ""
    typer.echo(f"log: {path}{streams}; what measured it: {path.parent / 'rig.toml'}; the truth, which no other command reads: "
               f"{path.parent / 'truth'}")  # fmt: skip


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


def _vector(text: str, option: str) -> Vector:
    x, y, z = _numbers(text, 3, option, "0.55,0,0.1")
    return x, y, z


def _rectangle(text: str) -> tuple[tuple[float, float], tuple[float, float]]:
    x0, y0, x1, y1 = _numbers(text, 4, "--where", "0,-0.05,0.05,0")
    return (x0, y0), (x1, y1)
