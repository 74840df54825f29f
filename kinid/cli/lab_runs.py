"""What `kinid lab` runs: one experiment, a campaign, or a study; and what it shows of each."""

from __future__ import annotations

from contextlib import contextmanager
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING

import typer

from kinid.cli.show import console, right

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    from rich.progress import Progress

    from kinid.lab.campaign import Campaign
    from kinid.lab.setup import Result, Setup

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


@contextmanager
def _writing(out: Path) -> Iterator[None]:
    """A folder that nobody else writes to, still without results."""
    from kinid.lab.folder import at_work, check_free

    with at_work(out):
        check_free(out)
        yield


def single(
    out: Path, asked: Asked, experiment: str | None, trajectory: Path | None, rig: Path | None, mcap: bool
) -> dict[str, object]:
    """One experiment, by its name or as it was planned."""
    from kinid.lab.folder import check_free, making
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
        from kinid.lab.hidden import check_met, hide

        setup, truth["hidden"] = hide(setup, asked.hide, asked.seed, asked.where)
        if asked.where is not None:
            check_met(asked.where, setup.script.place[setup.script.touching, :2])
    setup.check()
    with progress_bar() as progress:
        bar = progress.add_task(f"{len(setup.script.t) * setup.gains.period:.1f} s of set-points", total=1.0)
        result = setup.run(lambda share: progress.update(bar, completed=share))
    guard: list[str] = []
    if trajectory is not None:
        from kinid.lab.planned import guarded

        result, guard = guarded(result)
    with _writing(out), making(out):
        path = write_experiment(out, result, truth, mcap=mcap)
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
    from kinid.data.rig import Rig
    from kinid.lab.planned import doubts, planned

    beside = trajectory.parent / "rig.toml"
    if rig is None and beside.is_file():
        rig = beside
    known = None if rig is None else Rig.load(rig)
    setup, ahead = planned(trajectory, known, base=base, point=asked.point, normal=asked.normal)
    out = console()
    out.print(
        "surface and tool of the laboratory; a rig's: --rig" if rig is None else f"surface and tool of {rig}",
    )
    for line in doubts(setup):
        out.print(line, style="yellow")
    if not ahead:
        out.print("the plan expects no forces (no --model): the tip stays behind it by force over stiffness")
    return setup


def _show(path: Path, result: Result, nominal: Setup, mcap: bool, guard: list[str]) -> dict[str, object]:
    """Phases of a run, and what wasn't reached; the same for JSON."""
    from rich.table import Table

    from kinid.lab.outcome import outcomes, remarks

    found, out, folder = outcomes(result), console(), path.parent
    numbers = ("time [s]", "deepest [mm]", "of [mm]", "off set-point [mm rms]", "force, most [N]")
    table = Table("phase", *right(*numbers), title=f"{path}")
    for o in found:
        inside = ("–", "–") if max(o.asked, o.reached) <= 0.0 else (f"{1e3 * o.reached:.2f}", f"{1e3 * o.asked:.2f}")
        table.add_row(o.phase, f"{o.duration:.1f}", *inside, f"{1e3 * o.apart:.2f}", f"{o.force:.2f}")
    out.print(table)
    doubts = [*guard, *remarks(found, result.setup, nominal)]
    for line in doubts:
        out.print(line, style="yellow")
    streams = {"mcap": path.with_suffix(".mcap"), "streams": folder / "streams"} if mcap else {}
    more = f"; its streams: {', '.join(str(place) for place in streams.values())}" if mcap else ""
    typer.echo(
        f"log: {path}{more}; what measured it: {folder / 'rig.toml'}; the truth, which no other command reads: "
        f"{folder / 'truth'}"
    )
    made = {"log": path, "rig": folder / "rig.toml", "truth": folder / "truth", **streams}
    names = ("phase", "duration", "depth_asked", "depth_reached", "off_set_point", "force")
    phases = [dict(zip(names, o)) for o in found]
    return {name: str(file) for name, file in made.items()} | {"phases": phases, "doubts": doubts}


def campaign(
    experiment: str,
    asked: Asked,
    places: tuple[int, int],
    spacing: float,
    mcap: bool,
    out: Path,
    precision: float | None = None,
    prior: str | None = None,
) -> dict[str, object]:
    """A grid of pokes, or of slides, so far apart [m]; pokes end early where a precision is asked."""
    from kinid.lab import campaign as lab
    from kinid.lab import experiments
    from kinid.lab.campaign_page import NAME
    from kinid.lab.early_stop import robot_seconds
    from kinid.lab.materials import material
    from kinid.lab.writing import check_mcap

    options = asdict(asked)
    options["material"] = material(asked.material or experiments.named(experiment).material).name
    options |= {"hidden": options.pop("hide"), "precision": precision, "prior": prior}
    task = lab.Campaign(*places, spacing, "slide" if experiment == "slide" else "poke", mcap=mcap, **options)
    if mcap:
        check_mcap()
    made, rig, page, truth = _made(task, out), out / "rig.toml", out / NAME, out / "truth"
    there = f" ({task.count - made} were there already)" if made < task.count else ""
    typer.echo(
        f"{made} {task.touch}s made{there}: {out}/{task.touch}_*.parquet, {rig}; at a glance: {page}; the truth, which "
        f"no other command reads: {truth}"
    )
    seconds = robot_seconds(task, out)
    learnt = f"; map of the recursive estimates: {out / lab.LEARNT}" if precision is not None else ""
    typer.echo(f"time of the robot: {seconds:.0f} s, ways between places included{learnt}")
    return {
        "experiment": "campaign",
        "seed": task.seed,
        "robot_seconds": seconds,
        "count": task.count,
        "made": made,
        "logs": [str(log) for log in sorted(out.glob(f"{task.touch}_*.parquet"))],
        "rig": str(rig),
        "page": str(page),
        "truth": str(truth),
    }


def _made(task: Campaign, out: Path) -> int:
    """How many touches of a campaign were made now."""
    from kinid.lab import campaign as lab
    from kinid.lab.folder import is_whole

    with progress_bar() as progress:
        bar = progress.add_task(f"{task.count} {task.touch}s on {task.material}", total=task.count)
        try:
            return lab.run(task, out, lambda index: progress.update(bar, completed=index + 1))
        except KeyboardInterrupt:
            # the one that was being looked at counts, too
            whole = sum(is_whole(out, task.name(index)) for index in range(task.count))
            typer.echo(
                f"stopped: {whole} of {task.count} {task.touch}s are whole in {out}; the same command again goes on "
                "there",
                err=True,
            )
            raise typer.Exit(130) from None


def progress_bar() -> Progress:
    """On a terminal; nothing is shown where output is piped."""
    from rich.progress import BarColumn, Progress, TaskProgressColumn, TextColumn, TimeRemainingColumn

    columns = (TextColumn("{task.description}", markup=False), BarColumn(), TaskProgressColumn(), TimeRemainingColumn())
    out = console()
    return Progress(*columns, console=out, transient=True, disable=not out.is_terminal)
