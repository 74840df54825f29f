"""`kinid live`: the same quantities from a robot's stream, as they come."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from contextlib import AbstractContextManager, ExitStack, closing, nullcontext
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from kinid.cli import complete
from kinid.errors import InputError

if TYPE_CHECKING:
    from rich.console import Console

    from kinid.data.rig import Rig
    from kinid.live.events import Event
    from kinid.live.growing import Growing
    from kinid.live.messages import Source
    from kinid.live.pipeline import Pipeline
    from kinid.live.recording import Recorder
    from kinid.live.serving import Server
    from kinid.live.session import Session
    from kinid.live.sink import Sink
    from kinid.robotics.robot import Robot
    from kinid.writers import Json


@dataclass(frozen=True)
class Outputs:
    """Where a session goes: a recording, a map (and what its estimators start from), ports of Foxglove's server and of
    the view, JSON; None for what isn't asked for.
    """

    record: Path | None
    map_file: Path | None
    prior: Path | None
    port: int | None
    view: int | None
    json_file: Path | None


#: bandwidth of velocities that a stream lacks, and the largest that may be asked for [Hz]
BANDWIDTH, MOST_BANDWIDTH = 40.0, 1000.0

EXAMPLES = """Examples:

kinid live udp://127.0.0.1:5005 --rig rig.toml --model kelvin-voigt,coulomb-friction --record out.mcap

kinid live zenoh: --rig rig.toml --model kelvin-voigt          (topics of ROS 2, from rmw_zenoh's router)

kinid live poke.parquet --model hunt-crossley --speed 0 --json live.json          (a log, as fast as it goes)

kinid live udp://127.0.0.1:5005 --rig rig.toml --model kelvin-voigt,coulomb-friction --map map.parquet --serve

kinid live lab:mould --model kelvin-voigt,coulomb-friction          (the virtual laboratory)
"""


# as long as its options and their help
def live(
    source: Annotated[
        str,
        typer.Argument(
            help="zenoh://HOST:PORT, udp://HOST:PORT, shm:PATH, lab:EXPERIMENT[:SEED], or a log to be replayed.",
            show_default=False,
        ),
    ],
    model: Annotated[
        str,
        typer.Option(
            help="Effects that are estimated: a contact law, friction, or both.",
            show_default=False,
            autocompletion=complete.model,
        ),
    ],
    rig: Annotated[
        Path | None,
        typer.Option(help="What is measured with what; default: rig.toml beside the log, or the laboratory's."),
    ] = None,
    record: Annotated[
        Path | None, typer.Option(help="Recording to write: one MCAP file, whole at any moment.", show_default=False)
    ] = None,
    map_file: Annotated[
        Path | None,
        typer.Option("--map", help="Map that touches join as they end, and start from.", show_default=False),
    ] = None,
    prior: Annotated[
        Path | None,
        typer.Option(
            help="Map that estimators start from, too, and that doesn't grow: of kinid map or kinid picture.",
            show_default=False,
        ),
    ] = None,
    serve: Annotated[
        bool, typer.Option("--serve", help="Serve the session to Foxglove, on this machine alone.")
    ] = False,
    port: Annotated[
        int | None, typer.Option(help="Of that server; default: 8765; 0 chooses a free one.", show_default=False)
    ] = None,
    view: Annotated[
        int | None,
        typer.Option(
            help="Show arm, forces, map and events to the browsers of this machine at this port; 0 chooses a free one.",
            show_default=False,
        ),
    ] = None,
    json_file: Annotated[Path | None, typer.Option("--json", help="Summary and events to write as JSON.")] = None,
    speed: Annotated[
        float, typer.Option(help="Of what is replayed, in parts of its own; 0: as fast as it goes.")
    ] = 1.0,
    duration: Annotated[
        float | None, typer.Option(help="Time after which it ends [s]; default: with the source, or Ctrl-C.")
    ] = None,
    tare: Annotated[
        float, typer.Option(help="Seconds in the air at the beginning that the sensor's bias is learnt from.")
    ] = 0.0,
    bandwidth: Annotated[
        float | None,
        typer.Option(help="Of velocities that the stream lacks [Hz]; default: 40.", show_default=False),
    ] = None,
    quiet: Annotated[bool, typer.Option("--quiet", help="Print the summary alone.")] = False,
) -> None:
    """Contact frame, estimates and events of a robot's stream, sample by sample; nothing here commands a robot."""
    names = [name.strip() for name in model.split(",") if name.strip()]
    if duration is not None and not duration > 0.0:
        raise InputError(f"--duration {duration:g}", "a time > 0 s", "leave it out to go on until the source ends")
    if not (math.isfinite(tare) and tare >= 0.0):
        raise InputError(f"--tare {tare:g}", "seconds ≥ 0", "leave it out for the rig's bias")
    if bandwidth is not None and not 0.0 < bandwidth <= MOST_BANDWIDTH:
        raise InputError(
            f"--bandwidth {bandwidth:g}", f"a frequency > 0 Hz, {MOST_BANDWIDTH:g} Hz at most", "leave it out for 40"
        )
    for name, given in (("port", port or 0), ("view", view or 0)):
        if not 0 <= given < 65536:
            raise InputError(f"--{name} {given}", "a port from 0 to 65535", "0 chooses a free one")
    if port is not None and not serve:
        raise InputError(f"--port {port} without --serve", "both, or neither", "add --serve, or leave --port out")
    from kinid.cli.contact import rig_of, rig_path
    from kinid.live.serving import PORT
    from kinid.writers import alone_with, check_outputs

    path = _log_of(source)
    beside = rig if path is None else rig_path(path, rig)
    check_outputs((record, json_file, map_file), (path, beside, prior))
    if record is not None and record.suffix.lower() != ".mcap":
        raise InputError(f"--record {record.name}", "a name ending in .mcap", "rename it")
    if map_file is not None:
        from kinid.mapping.map_file import check_map_name

        check_map_name(map_file)
    held = None if path is None else rig_of(path, rig)
    opened, the_rig, robot = _open(source, beside, held, speed)
    with closing(opened), ExitStack() as alone:
        for file in (map_file, record, json_file):
            if file is not None:
                alone.enter_context(alone_with(file))
        outputs = Outputs(record, map_file, prior, (PORT if port is None else port) if serve else None, view, json_file)
        _run(opened, the_rig, robot, names, outputs, duration, tare, bandwidth, quiet)


def _log_of(source: str) -> Path | None:
    """The log that a source replays; None for any other source."""
    scheme, colon, rest = source.partition(":")
    from kinid.live.sources import kinds

    if (colon and scheme in kinds().keys() - {"file"}) or rest.startswith("//"):
        return None
    return Path(rest if scheme == "file" and colon else source)


def _open(source: str, rig: Path | None, held: Rig | None, speed: float) -> tuple[Source, Rig, Robot]:
    """The source, and what is measured with what; held: the rig of the log that it replays, where that has one."""
    from kinid.data.rig import Rig
    from kinid.live.sources import Asked, open_source
    from kinid.robotics.robot import Robot

    if rig is None:
        opened = open_source(source, Asked(None, None, speed))
        the_rig = getattr(opened, "rig", None)
        if the_rig is None:
            opened.close()
            raise InputError(f"no rig for {source}", "what is measured with what", "name it with --rig rig.toml")
        return opened, the_rig, Robot.load(the_rig)
    the_rig = Rig.load(rig) if held is None else held
    if the_rig.robot is None:
        raise InputError(f"a rig without [robot] at {rig}", "a robot, for its joints", "add [robot] model")
    if the_rig.streams.reference == "joints":
        raise InputError(
            f'[streams] reference = "joints" in {rig}', "the wrench's clock, which is kept live", "remove that line"
        )
    robot = Robot.load(the_rig)
    return open_source(source, Asked(the_rig, tuple(robot.joint_names), speed)), the_rig, robot


def _run(
    opened: Source,
    rig: Rig,
    robot: Robot,
    names: list[str],
    outputs: Outputs,
    duration: float | None,
    seconds: float,
    asked: float | None,
    quiet: bool,
) -> None:
    """One session."""
    from kinid.cli.show import console
    from kinid.live.pipeline import Pipeline
    from kinid.live.session import Session
    from kinid.live.tare import tare
    from kinid.live.terminal import Lines, Screen, show

    out, bandwidth = console(), BANDWIDTH if asked is None else asked
    pipeline = Pipeline(rig, names, robot=robot, bandwidth=bandwidth)  # compiles: no sample waits for that
    if seconds > 0.0:
        out.print(f"keep the tool in the air for {seconds:g} s …")
        rig = tare(opened, rig, robot, seconds, lambda says: out.print(f"doubt: {says}", soft_wrap=True))
        pipeline = Pipeline(rig, names, robot=robot, bandwidth=bandwidth)
    elif rig.sensor.bias is None:
        out.print("doubt: the rig states no bias of the sensor: add [sensor] bias, or --tare 2 in the air")
    sinks, known = _sinks(outputs, opened, pipeline, rig, robot, bandwidth, out)
    kept: list[Event] = []
    shows: list[Callable[[Event], None]] = []
    lines = Lines(out)

    def tell(event: Event) -> None:
        if outputs.json_file is not None and len(kept) < 100_000:
            kept.append(event)
        for show_event in shows:
            show_event(event)

    session = Session(
        opened,
        pipeline,
        tuple(robot.joint_names),
        wrench_offset=rig.streams.wrench_clock_offset or 0.0,
        max_gap=rig.streams.max_gap,
        sinks=sinks,
        tell=tell,
        known=known,
        full=rig.sensor.range,
        bandwidth=asked,
    )
    limit = math.inf if duration is None else duration
    screen = Screen(session, out)
    if not quiet:
        shows.append(screen if out.is_terminal else lines)
    drawn: AbstractContextManager[object] = screen.live if screen in shows else nullcontext()
    with drawn:
        session.run(limit)
    lines.close()
    show(session, out)
    _end(session, kept, outputs, sinks)


def _end(session: Session, kept: list[Event], outputs: Outputs, sinks: list[Sink]) -> None:
    """Write what is written at the end, and say what was.

    Raises:
        InputError: a sink has given up, or nothing came.
    """
    from kinid.writers import write_json

    if outputs.json_file is not None:
        facts: Json = {**session.summary(), "list": [event.to_dict() for event in kept]}
        write_json(outputs.json_file, facts)
    _say_written(outputs, sinks)
    if session.samples == 0:
        raise _nothing(session)


def _nothing(session: Session) -> InputError:
    """What is wrong where no wrench came together with joints."""
    came = [name for name, clock in session.aligner.clocks.items() if clock.started]
    missing = next((event.says for event in session.events if event.kind == "topic"), None)
    found = f"{' and '.join(came) or 'nothing'} from {session.source.name}, and no pair of joints and wrench"
    mend = "see the events above" if session.counts.keys() - {"stream-lost"} else "begin the sender first"
    return InputError(found + (f": {missing}" if missing else ""), "both, with times that overlap", mend)


def _say_written(outputs: Outputs, sinks: list[Sink]) -> None:
    """Say what was written.

    Raises:
        InputError: a sink has given up.
    """
    from kinid.cli.show import written

    files = (outputs.record, outputs.map_file, outputs.json_file)
    made = [path for path in files if path is not None and path.exists()]
    failed = next((sink.error for sink in sinks if sink.error), "")
    written([] if failed else made)
    if failed:
        raise InputError(
            f"a recording, a map or a server that ended before the session did ({failed})",
            "room for all of the session",
            f"make room, and record again; what came before is in {' and '.join(map(str, made)) or 'no file'}",
        )


def _sinks(
    outputs: Outputs, opened: Source, pipeline: Pipeline, rig: Rig, robot: Robot, bandwidth: float, out: Console
) -> tuple[list[Sink], Growing | None]:
    """All that takes the session, and the map that it starts from; the recording last: it may not begin in vain."""
    server = None if outputs.port is None else _server(outputs.port, robot, out)
    sinks: list[Sink] = [] if server is None else [server]
    shows = [] if server is None else [server.show]
    known = None
    try:
        if outputs.view is not None:
            from kinid.live.viewing import Viewing

            viewing = Viewing(pipeline, rig, opened.name, outputs.view)
            out.print(f"arm, forces and events: {viewing.url} (for this machine only)", soft_wrap=True)
            sinks.append(viewing)
            shows.append(viewing.show)
        if outputs.map_file is not None or outputs.prior is not None:
            from kinid.live.growing import Growing
            from kinid.mapping.property_map import PropertyMap

            prior = None if outputs.prior is None else PropertyMap.read(outputs.prior)
            known = Growing(outputs.map_file, pipeline, rig, opened.name, shows, prior)
            sinks.append(known)
        if outputs.record is not None:
            sinks.append(_recorder(outputs.record, opened, rig, robot, list(pipeline.model), bandwidth))
    except Exception:
        for sink in sinks:
            sink.close()
        raise
    return sinks, known


def _recorder(record: Path, source: Source, rig: Rig, robot: Robot, names: list[str], bandwidth: float) -> Recorder:
    import kinid
    from kinid.live.recording import Recorder

    provenance = {
        "version": kinid.__version__,
        "source": source.name,
        "model": ",".join(names),
        "bandwidth_hz": str(bandwidth),
        "rig": rig.model_dump_json(exclude_none=True, exclude={"folder"}),
    }
    # what comes live is received by a clock that begins with the machine: other recordings of it have Unix time
    epoch = time.time_ns() - time.monotonic_ns() if source.live else 0
    return Recorder(record, robot.joint_names, robot.sensor_frame or "", provenance, epoch)


def _server(port: int, robot: Robot, out: Console) -> Server:
    from kinid.live.serving import LAYOUT, Server

    server = Server(robot.joint_names, robot.sensor_frame or "", port)
    out.print(f"Foxglove: open a connection to {server.url}, import the layout {LAYOUT}", soft_wrap=True)
    return server
