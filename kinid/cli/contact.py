"""`kinid contact`: a raw log to contact-frame quantities."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from kinid.cli.advice import filled
from kinid.cli.batch import On, Workers
from kinid.cli.options import LogFiles, PlotFile, RigFile
from kinid.errors import InputError, near

if TYPE_CHECKING:
    from kinid.calibration.coupling import Compensated
    from kinid.calibration.free_torques import FromFreeMotion
    from kinid.contact.analysis import Analysis
    from kinid.contact.registration import FoundSurface
    from kinid.data.log import Log
    from kinid.data.rig import Rig
    from kinid.robotics.robot import Robot

EXAMPLES = """Examples:

kinid contact poke.parquet --rig rig.toml -o contact.parquet

kinid contact poke.csv --plot poke.html

kinid contact touches.bag --rig rig.toml --find-surface

kinid contact tuesday -o frames --on dask             (a folder of logs, a folder of tables)
"""


# as long as its options and their help
def contact(
    logs: LogFiles,
    rig: RigFile = None,
    out: Annotated[
        Path | None,
        typer.Option("-o", "--out", help="Table to write: .parquet, .csv or .npz; of many logs a folder of tables."),
    ] = None,
    plot: PlotFile = None,
    json_file: Annotated[Path | None, typer.Option("--json", help="Summary and provenance to write as JSON.")] = None,
    bias: Annotated[str, typer.Option(help="Sensor bias: auto (the rig's, else free motion) or none.")] = "auto",
    bandwidth: Annotated[
        float | None,
        typer.Option(
            help="Instead of the smoother: velocities that the log lacks by a differentiator of this bandwidth [Hz].",
            show_default=False,
        ),
    ] = None,
    find_surface: Annotated[
        bool, typer.Option("--find-surface", help="Fit the plane to the touches in the log, and use it.")
    ] = False,
    compensate: Annotated[
        Path | None,
        typer.Option(
            help="Fit (kinid fit --json) whose coupling between the axes, or torques of free motion, are taken out."
        ),
    ] = None,
    trust_wrench: Annotated[
        bool, typer.Option("--trust-wrench", help="Don't ask whether gravity contradicts the wrench.")
    ] = False,
    on: On = None,
    workers: Workers = None,
) -> None:
    """Raw log to contact-frame quantities: depth, slip and forces in the frame of the surface.

    Without a [surface] in the rig: the tip's motion and the force on it. With joint torques in the log: inverse
    dynamics beside them; and forces from them where there is neither a wrench nor a [sensor].
    """
    if bias not in ("auto", "none"):
        raise InputError(f"--bias {bias}", "auto or none", near(bias, ("auto", "none")))
    from kinid.cli.campaign import is_many

    if on is not None or workers is not None or is_many(logs):
        given = plot or find_surface or compensate or trust_wrench or bias != "auto" or bandwidth is not None
        many_contacts(logs, rig, out, json_file, on, workers, bool(given))
        return
    (log,) = logs
    from kinid.signal.derivative import Differentiator
    from kinid.writers import check_outputs, check_table_name, write_json, write_table, write_text

    if out is not None:
        check_table_name(out)
    check_outputs((out, plot, json_file), (log, rig_path(log, rig), compensate))
    the_rig, the_log, robot = load(log, rig)
    differentiator = None if bandwidth is None else Differentiator(bandwidth)
    if bandwidth is not None:
        _check_bandwidth(bandwidth, the_log)
    found = None
    if find_surface:
        from kinid.contact.registration import find_surface as find

        found = find([the_log], the_rig, robot=robot, differentiator=differentiator)
        the_rig = found.rig
    from kinid.contact.analysis import analyse

    result = analyse(
        the_log,
        the_rig,
        robot=robot,
        bias="auto" if bias == "auto" else "none",
        differentiator=differentiator,
        trust_wrench=trust_wrench,
    )
    compensated = None if compensate is None else _compensated(result, the_log, the_rig, compensate)
    if compensated is not None:
        result = result.with_contact(compensated.touch)
    if out is not None:
        write_table(out, result.columns(), result.provenance.to_dict())
    if plot is not None:
        from kinid.reports.plots import analysis_page

        write_text(plot, analysis_page(result, title=log.name))
    if json_file is not None:
        write_json(json_file, _facts(result, found, compensated))
    from kinid.cli.show import show_analysis, show_surface, written

    if found is not None:
        show_surface(found)
    show_analysis(result, the_log)
    if compensated is not None:
        typer.echo(compensated.line())
    written((out, plot, json_file))
    _say_what_lacks(result, the_log, the_rig)


def _say_what_lacks(result: Analysis, log: Log, rig: Rig) -> None:
    """Without a surface there is no contact frame, nor free motion that tells the bias."""
    if result.contact is not None or log.wrench is None:
        return
    held = [] if rig.sensor.bias is not None else ["the sensor's bias"]
    held += [] if rig.tool is not None else ["the weight of a tool that no [tool] states"]
    if held:
        typer.echo(f"doubt: the force holds {' and '.join(held)}")
    advice = "next: state [surface] in the rig, or let touches find it: kinid contact LOG --find-surface"
    typer.echo(filled(advice, sys.argv[1:]))


def _check_bandwidth(bandwidth: float, log: Log) -> None:
    """Refuse a bandwidth that the log's samples don't hold, or that lets none of its motion pass."""
    least, most = 1.0 / max(float(log.t[-1] - log.t[0]), log.period), 0.5 / log.period
    if len(log) > 1 and not least <= bandwidth < most:
        raise InputError(
            f"--bandwidth {bandwidth:g} for {len(log)} samples at {1.0 / log.period:.4g} Hz",
            f"a frequency from {least:.3g} Hz, one period in the log, to below {most:.4g} Hz, half its rate",
            "leave it out for the smoother",
        )


def many_contacts(
    logs: list[Path],
    rig: Path | None,
    out: Path | None,
    json_file: Path | None,
    on: str | None,
    workers: int | None,
    given: bool,
) -> None:
    """Contact-frame quantities of many logs."""
    from kinid.batch.jobs import Job
    from kinid.cli.batch import each_log

    if given:
        raise InputError(
            "options of one log for many", "--rig, -o, --json, --on and --workers", "leave them out, or name one log"
        )
    each_log(Job("contact"), logs, rig, out, on, workers, json_file)


def _compensated(result: Analysis, log: Log, rig: Rig, fit: Path) -> Compensated | FromFreeMotion:
    """Without the coupling between the axes that a fit found, or the joint torques that one to free motion did."""
    from kinid.calibration.coupling import compensate, load_fit

    if result.contact is None:
        raise InputError("a rig without [surface]", "contact-frame quantities to compensate", "add [surface]")
    model, values = load_fit(fit)
    if "joints" in model.needs:
        from kinid.calibration.free_torques import without_free_torques
        from kinid.identification.fitted import FittedModel

        return without_free_torques(log, rig, FittedModel.load(fit))
    return compensate(result.contact, log, rig, model, values)


def _facts(
    result: Analysis, found: FoundSurface | None, compensated: Compensated | FromFreeMotion | None
) -> dict[str, object]:
    """For JSON."""
    facts: dict[str, object] = result.summary()
    if found is not None:
        facts["surface"] = found.to_dict()
    if compensated is not None:
        facts["compensated"] = compensated.facts()
    return facts


def load(log: Path, rig: Path | None) -> tuple[Rig, Log, Robot | None]:
    """The rig, the log with its joints in the robot's order, and the robot (None for a rig without one).

    A log that says everything itself (depth and force of a material tester, one drive) needs no rig.
    """
    from kinid.data.rig import Rig
    from kinid.robotics.reading import read

    the_rig = rig_of(log, rig)
    if the_rig is None:
        plain = Rig()
        the_log = read(log, plain)
        one_axis = the_log.q is not None and the_log.q.shape[1] == 1 and the_log.wrench is None
        if the_log.contact and "depth" not in the_log.contact and the_log.q is None:
            raise InputError(
                f"{', '.join(the_log.contact)} without a depth in {log}",
                "a column depth [m] beside the force",
                "record it, or name its column in [columns] of a rig.toml",
            )
        if "depth" not in the_log.contact and not one_axis:
            raise InputError(
                f"no rig for {log}",
                "a rig.toml that says what was measured with what",
                "name it with --rig, or put rig.toml beside the log",
            )
        return plain, the_log, None
    return _read_with(the_rig, log)


def rig_of(log: Path, rig: Path | None) -> Rig | None:
    """The rig as named, else beside the log, else as a recording of `kinid live` holds it; None without any."""
    from kinid.data.rig import Rig

    if rig is not None or rig_path(log, rig).is_file():
        return Rig.load(rig_path(log, rig))
    if log.suffix.lower() != ".mcap" or not log.is_file():
        return None
    from kinid.data.readers.mcap import recorded_rig

    return recorded_rig(log)


def _read_with(rig: Rig, log: Path) -> tuple[Rig, Log, Robot | None]:
    from kinid.robotics.reading import read

    robot = None
    if rig.robot is not None:
        from kinid.robotics.robot import Robot

        robot = Robot.load(rig)
    return rig, read(log, rig, robot=robot), robot


def rig_path(log: Path, rig: Path | None) -> Path:
    """The rig's file: as named, else beside the log."""
    return rig if rig is not None else log.parent / "rig.toml"
