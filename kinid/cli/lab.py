"""`kinid lab`: virtual experiments whose truth is known."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from kinid.errors import InputError

EXAMPLES = """Examples:

kinid lab ecoflex-50 -o ecoflex

kinid lab poke --material sponge --hide relaxation --seed 7 -o secret

kinid lab mould --campaign 10x10 -o campaign
"""


def lab(
    experiment: Annotated[
        str,
        typer.Argument(help="poke, slide, band, sponge, ecoflex-50, dragon-skin-10, mould or wave.", show_default=False),
    ],
    out: Annotated[Path, typer.Option("-o", "--out", help="Folder for logs, rig and truth.", show_default=False)],
    material: Annotated[str | None, typer.Option(help="What is touched; default: the experiment's.")] = None,
    hide: Annotated[str | None, typer.Option(help="Effect to plant, of a size by the seed; only truth/ tells it.")] = None,
    seed: Annotated[int, typer.Option(help="Seed of sensor faults, noise and hidden effect.")] = 0,
    campaign: Annotated[
        str | None, typer.Option(help="A grid of pokes, as 10x10; started again, it goes on where it stopped.")
    ] = None,
    spacing: Annotated[float, typer.Option(help="Between the pokes of a campaign [m].")] = 0.01,
    stiffness: Annotated[float, typer.Option(help="Translational stiffness of the impedance controller [N/m].")] = 5200.0,
    point: Annotated[str | None, typer.Option(help="A point of the surface, base frame: x,y,z [m].")] = None,
    normal: Annotated[str | None, typer.Option(help="Normal of the surface, base frame: x,y,z.")] = None,
    mcap: Annotated[bool, typer.Option(help="Write the streams as MCAP too.")] = True,
) -> None:
    """An LWR4+ under impedance control pokes and slides: its raw log, the rig, and the truth in a folder of its own."""
    if seed < 0:
        raise InputError(f"--seed {seed}", "0 or more", "choose another")
    if out.exists() and not out.is_dir():
        raise InputError(f"a file at {out}", "a folder for the results", "choose another -o/--out")
    if campaign is not None:
        rows, columns = _grid(campaign)
        _campaign(experiment, out, material, hide, seed, rows, columns, spacing, stiffness)
        return
    import dataclasses

    from kinid.lab import experiments
    from kinid.lab.arm import Gains
    from kinid.lab.writing import write_experiment

    setup = experiments.prepare(experiment, material=material, seed=seed, gains=Gains(translation=stiffness))
    changes: dict[str, object] = {}
    if point is not None:
        changes["point"] = _vector(point, "--point")
    if normal is not None:
        changes["normal"] = _vector(normal, "--normal")
        n = changes["normal"]
        changes["tangent"] = (0.0, 1.0, 0.0) if isinstance(n, tuple) and abs(n[0]) > 0.9 * max(map(abs, n)) else (1.0, 0.0, 0.0)
    setup = dataclasses.replace(setup, **changes)  # type: ignore[arg-type]
    truth: dict[str, object] = {"experiment": experiment}
    if hide is not None:
        from kinid.lab.hidden import hide as plant

        setup, truth["hidden"] = plant(setup, hide, seed)
    from kinid.cli.show import console

    console().print(f"the arm follows {len(setup.script.t) * setup.gains.period:.1f} s of set-points …")
    result = setup.run()
    path = write_experiment(out, result, truth, mcap=mcap)
    _show(path, result, mcap)


def _campaign(experiment: str, out: Path, material: str | None, hide: str | None, seed: int, rows: int, columns: int,
              spacing: float, stiffness: float) -> None:  # fmt: skip
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

    from kinid.cli.show import console
    from kinid.lab import campaign, experiments
    from kinid.lab.materials import material as named

    if experiment not in experiments.EXPERIMENTS:
        experiments.prepare(experiment)
    chosen = named(material or experiments.EXPERIMENTS[experiment].material)
    task = campaign.Campaign(rows, columns, spacing, chosen.name, seed, hide, stiffness)
    columns_ = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    with Progress(*columns_, console=console(), transient=True) as progress:
        bar = progress.add_task(f"pokes on {chosen.name}", total=task.count)
        made = campaign.run(task, out, lambda index: progress.update(bar, completed=index + 1))
    there = f" ({task.count - made} were there already)" if made < task.count else ""
    typer.echo(f"{made} pokes made{there}: {out}/poke_*.parquet, {out / 'rig.toml'}; the truth, which no other command reads: "
               f"{out / 'truth'}")  # fmt: skip


def _show(path: Path, result: object, mcap: bool) -> None:
    from rich.table import Table

    from kinid.cli.show import console
    from kinid.lab.setup import Result

    assert isinstance(result, Result)
    table = Table(title=f"{path}")
    table.add_column("phase")
    table.add_column("time [s]", justify="right")
    table.add_column("measured force, greatest [N]", justify="right")
    script, force = result.setup.script, result.wrench[:, :3] - result.wrench[:50, :3].mean(axis=0)
    for name in dict.fromkeys(script.phase.tolist()):
        rows = script.phase == name
        table.add_row(name, f"{rows.sum() * result.setup.gains.period:.1f}", f"{(force[rows] ** 2).sum(axis=1).max() ** 0.5:.2f}")
    console().print(table)
    streams = f", {path.with_suffix('.mcap')}" if mcap else ""
    typer.echo(f"log: {path}{streams}; what measured it: {path.parent / 'rig.toml'}; the truth, which no other command reads: "
               f"{path.parent / 'truth'}")  # fmt: skip


def _grid(text: str) -> tuple[int, int]:
    parts = text.lower().replace("×", "x").split("x")
    if len(parts) != 2 or not all(part.strip().isdigit() for part in parts):
        raise InputError(f"--campaign {text}", "rows x columns, as 10x10", "correct it")
    return int(parts[0]), int(parts[1])


def _vector(text: str, option: str) -> tuple[float, float, float]:
    try:
        values = tuple(float(part) for part in text.split(","))
    except ValueError:
        values = ()
    if len(values) != 3 or not all(abs(v) < 1e6 for v in values):
        raise InputError(f"{option} {text}", "three numbers, as 0.55,0,0.1", "correct it")
    return values[0], values[1], values[2]
