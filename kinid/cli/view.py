"""`kinid view`: a map, a log or a campaign in three dimensions, in the browser."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Annotated

import typer

from kinid.cli import complete
from kinid.cli.options import RigFile, check_method
from kinid.errors import InputError

EXAMPLES = """Examples:

kinid view mould.parquet

kinid view run/log.parquet --record run.html

kinid view running-campaign --property damping
"""


# as long as its options and their help
def view(
    target: Annotated[
        Path, typer.Argument(help="A map, a log, or a folder of logs, perhaps a running campaign.", show_default=False)
    ],
    rig: RigFile = None,
    shown: Annotated[
        str | None,
        typer.Option("--property", help="Property that colours the surface first.", autocompletion=complete.mapped),
    ] = None,
    method: Annotated[
        str,
        typer.Option(help="Between the probes: gp, triangles, biharmonic or nearest.", autocompletion=complete.method),
    ] = "gp",
    model: Annotated[
        str | None,
        typer.Option(
            help="Effects that predict a log's forces, or that pokes are fitted with.", autocompletion=complete.model
        ),
    ] = None,
    port: Annotated[int, typer.Option(help="On 127.0.0.1; 0 for any that is free.")] = 7000,
    record: Annotated[Path | None, typer.Option(help="Write one self-contained HTML file instead of serving.")] = None,
    json_file: Annotated[Path | None, typer.Option("--json", help="What is shown and where, to write as JSON.")] = None,
    browser: Annotated[bool, typer.Option("--open/--no-open", help="Open the browser.")] = True,
) -> None:
    """The arm moving through a log, or the surface coloured by a property, while it grows; to this machine only."""
    from kinid.planning.saved_doubts import is_trajectory, saved_doubts
    from kinid.viewer.page import page
    from kinid.viewer.server import ViewServer
    from kinid.viewer.viewer import Kind, View
    from kinid.viewer.viewer import record as recorded
    from kinid.writers import check_outputs, write_json, write_text

    check_method(method)
    if not 0 <= port < 65536:
        raise InputError(f"--port {port}", "0 to 65535", "choose another")
    check_outputs((record, json_file), (target, rig))
    seen = View(target, rig, shown, method, model)
    if seen.robot is not None and seen.kind is Kind.LOG and is_trajectory(target):
        for doubt in saved_doubts(target, seen.robot):
            typer.echo(f"doubt: {doubt}")
    if record is not None:
        write_text(record, recorded(seen))
        typer.echo(f"wrote {record}")
        if json_file is not None:
            write_json(json_file, seen.facts() | {"record": str(record)})
            typer.echo(f"wrote {json_file}")
        return
    server = ViewServer(lambda: page(seen.scene() | {"live": True}), port)
    if json_file is not None:
        write_json(json_file, seen.facts() | {"url": server.url, "port": server.port})
    typer.echo(f"{target} at {server.url} (for this machine only); stop with Ctrl+C")
    if browser:
        import webbrowser

        webbrowser.open(server.url)
    try:
        while True:
            time.sleep(0.3)
            if (message := seen.changed()) is not None:
                server.send(message)
    except KeyboardInterrupt:
        typer.echo("stopped")
    finally:
        server.close()
