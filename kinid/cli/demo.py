"""`kinid demo`: a virtual arm finds out what its model lacks. Every command that it shows is run as it stands there."""

from __future__ import annotations

import json
import os
import shlex
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from kinid.errors import InputError

if TYPE_CHECKING:
    from kinid.writers import Json

EXAMPLES = """Examples:

kinid demo

kinid demo -o somewhere --open

kinid demo --seed 8 --json summary.json

kinid demo --real path/to/measured/logs
"""

#: what the material hides, of a size by the seed, and the model that knows nothing of it
HIDDEN, MODEL = "relaxation", "kelvin-voigt,coulomb-friction"
LAWS = ("hooke", "kelvin-voigt", "hunt-crossley")
MATERIAL = "ecoflex-50"
#: pokes of the small map, their distance [m], and the quarter of the mould in which the effect is hidden
GRID, SPACING, QUARTER = "6x6", "0.016", "0,-0.05,0.05,0"
MANIFEST = "demo.json"

#: how the measured LWR4+ logs name their arrays
LWR4PLUS_MOTION = """\
[robot]
model = "lwr4plus"

[columns]
t    = { column = "times" }
q    = { column = "positions" }
dq   = { column = "velocities" }
ddq  = { column = "accelerations" }
tau  = { column = "torques" }
"""


def demo(
    out: Annotated[Path, typer.Option("-o", "--out", help="Folder for logs, tables, report and scenes.")] = Path(
        "kinid-demo"
    ),
    seed: Annotated[int, typer.Option(help="Seed of the sensor's faults and of the hidden effect's size.", min=0)] = 5,
    show: Annotated[bool, typer.Option("--open", help="Open report and scene in the browser when done.")] = False,
    json_file: Annotated[Path | None, typer.Option("--json", help="Summary to write as JSON.")] = None,
    real: Annotated[
        Path | None,
        typer.Option(
            help="Folder of measured logs; default: KINID_REAL_DATA, else ../shared/real; skipped where absent."
        ),
    ] = None,
) -> None:
    """A virtual LWR4+ touches a soft material that hides something: from its raw log to the name of what the model
    lacks.

    No network, no server, no robot: contact-frame quantities, estimates, the comparison of models, the diagnosis with
    the error falling, a small map, a report and scenes for the browser. Stopped and started again, it goes on.
    """
    from kinid.cli import ahead
    from kinid.writers import check_outputs, make_folder, write_json, write_text

    if json_file is not None and json_file.absolute().parent != out.absolute():
        check_outputs((json_file,), ())
    settings: Json = {"kind": "demo", "seed": seed, "hidden": HIDDEN}
    _claim(out, settings)
    make_folder(out)
    write_json(out / MANIFEST, settings)
    tell = _Teller(7 if (measured := _measured(real)) is not None else 6)

    ahead.start()
    log, mould = out / "log.parquet", out / "mould"
    model = _explore(tell, out, log, seed)
    _learn(tell, out, log, model)
    with tell.step(
        "A map of four silicones: one quarter hides the effect too, a film lies on another; there the model fails"
    ):
        places = ("--campaign", GRID, "--spacing", SPACING)
        tell.run("lab", "mould", *places, "--hide", HIDDEN, "--where", QUARTER, "--seed", seed, "-o", mould)
        tell.run("map", mould, "-o", out / "map.parquet", "--plot", out / "map.html")
    with tell.step("Scenes for the browser, each one file: the arm with measured and predicted forces, and the map"):
        better = json.loads((out / "found.json").read_text(encoding="utf-8"))["steps"][-1]["model"]
        tell.run("view", log, "--model", ",".join(_on_contact(better)), "--record", out / "scene.html")
        tell.run("view", mould, "--record", out / "map-scene.html")
    if measured is not None:
        with tell.step("A real LWR4+ moving freely, measured; the model that kinid ships predicts its joint torques"):
            write_text(out / "lwr4plus-motion.toml", LWR4PLUS_MOTION)
            tell.run("contact", measured, "--rig", out / "lwr4plus-motion.toml", "--plot", out / "lwr4plus-motion.html")
    else:
        tell.say("\nno measured logs found (KINID_REAL_DATA names their folder): that part is left out")
    summary = _summary(out, measured is not None, tell.elapsed)
    for path in (out / MANIFEST, *([json_file] if json_file is not None else [])):
        write_json(path, settings | summary)
    _farewell(tell, summary)
    if show:
        import webbrowser

        for name in ("report", "scene"):
            webbrowser.open(Path(summary["files"][name]).resolve().as_uri())


def _on_contact(model: list[str]) -> list[str]:
    """Those effects of a model that act on the contact, rather than on its readings."""
    from kinid import effects
    from kinid.effects import Stage

    readings = {Stage.SENSOR, Stage.ACQUISITION}
    return [name for name in model if readings.isdisjoint(effects.get(name).stages())]


def _claim(out: Path, settings: Json) -> None:
    """Refuse a folder that holds something else: nothing in it is replaced then."""
    path = out / MANIFEST
    try:
        there = json.loads(path.read_text(encoding="utf-8"))
        same = all(there.get(name) == value for name, value in settings.items())
    except FileNotFoundError:
        same = not any((out / name).exists() for name in ("log.parquet", "rig.toml", "mould"))
    except (OSError, ValueError, AttributeError, RecursionError):
        same = False
    if not same:
        raise InputError(
            f"another experiment in {out}", "a folder without one, or with the same demo", "choose another -o/--out"
        )


def _measured(real: Path | None) -> Path | None:
    folder = real or Path(os.environ.get("KINID_REAL_DATA") or "../shared/real")
    log = folder / "lwr4plus-motion" / "measurements_1.npz"
    return log if log.is_file() else None


def _explore(tell: _Teller, out: Path, log: Path, seed: int) -> str:
    """The log and what it says in the contact frame; the model to ask about, which knows what the rig doesn't state."""
    with tell.step(
        "A virtual LWR4+ under impedance control pokes a silicone and slides on it; something is hidden in it"
    ):
        if log.is_file():
            tell.say(f"  {log} is there already", soft_wrap=True)
        else:
            tell.run("lab", MATERIAL, "--hide", HIDDEN, "--seed", seed, "--no-mcap", "-o", out)
    with tell.step("From joint angles and a wrench to depth, slip and forces in the frame of the surface"):
        tell.run("contact", log, "-o", out / "contact.parquet", "--plot", out / "contact.html")
    from kinid.data.rig import Rig

    return MODEL if Rig.load(out / "rig.toml").sensor.bias is not None else f"{MODEL},sensor-bias"


def _learn(tell: _Teller, out: Path, log: Path, model: str) -> None:
    with tell.step("Estimates with intervals, and models side by side on samples that their fits have not seen"):
        tell.run("fit", log, "--model", MODEL, "--json", out / "fit.json", "--plot", out / "fit.html")
        rivals = [word for law in LAWS for word in ("--model", f"{law},coulomb-friction")]
        tell.run("compare", log, *rivals, "--plot", out / "compare.html")
    from kinid.effects import catalogue

    with tell.step(f"Where does the model fail, and which of {len(catalogue())} physical effects is missing?"):
        tell.run("diagnose", log, "--model", model, "--json", out / "found.json", "--report", out / "report.html")


def _summary(out: Path, measured: bool, seconds: float) -> Json:
    """What was found beside the truth, from the files that the commands wrote."""
    found = json.loads((out / "found.json").read_text(encoding="utf-8"))
    truth = json.loads((out / "truth" / "log.json").read_text(encoding="utf-8"))["hidden"]
    files = {
        "report": "report.html",
        "scene": "scene.html",
        "map scene": "map-scene.html",
        "map": "map.html",
        "contact frame": "contact.html",
        "fit": "fit.html",
        "models": "compare.html",
    }
    if measured:
        files["measured arm"] = "lwr4plus-motion.html"
    added = [e for e in found["effects"] if e["id"] in found["added"]]
    parameters = {e["id"]: {name: p["value"] for name, p in e["parameters"].items()} for e in added}
    return {
        "verdict": found["verdict"],
        "added": found["added"],
        "parameters": parameters,
        "truth": truth,
        "error": found["error"],
        "seconds": round(seconds, 1),
        "files": {name: str(out / file) for name, file in files.items()},
    }


def _farewell(tell: _Teller, summary: Json) -> None:
    error, truth = summary["error"], summary["truth"]
    tell.say("\nto look at, offline, in a browser", style="bold")
    for name, path in summary["files"].items():
        tell.say(f"  {name:14s}{path}", soft_wrap=True)
    tell.say("the same with a log of your own: put rig.toml beside it and give the commands above\n", soft_wrap=True)
    named = (
        " and ".join(f"{name} ({_numbers(summary['parameters'].get(name, {}))})" for name in summary["added"])
        or "nothing"
    )
    wrong = [name for name in summary["added"] if name != truth["effect"]]
    right = "found" if truth["effect"] in summary["added"] else "not found"
    right += f"; {' and '.join(wrong)} {'is' if len(wrong) == 1 else 'are'} not there" if wrong else ""
    fell = f"{error['before']:.3g} → {error['after']:.3g} {error['unit']}, noise alone {error['noise_floor']:.3g}"
    tell.say(f"named as missing: {named}; held-out error {fell}", soft_wrap=True)
    tell.say(
        f"the truth: {truth['effect']} ({_numbers(truth['parameters'])}), kept where no command reads it; {right}",
        soft_wrap=True,
    )
    tell.say(
        f"report: {summary['files']['report']}   scene: {summary['files']['scene']}   in {summary['seconds']:.0f} s",
        soft_wrap=True,
    )


def _numbers(parameters: dict[str, float]) -> str:
    return ", ".join(f"{name} {value:.3g}" for name, value in parameters.items())


class _Teller:
    """Says which step runs, shows its commands, and runs them through the same command line that a user has."""

    def __init__(self, steps: int) -> None:
        from kinid.cli.show import console

        self._steps, self._step, self._start = steps, 0, time.monotonic()
        self.say: Callable[..., None] = console().print
        self.say("A robot finds out what its model lacks.", style="bold")
        self.say("A minute or two; the first time longer, while loops are compiled.")

    @property
    def elapsed(self) -> float:
        """Since the beginning [s]."""
        return time.monotonic() - self._start

    @contextmanager
    def step(self, words: str) -> Iterator[None]:
        """A heading, what runs in it, and how long that took."""
        self._step += 1
        self.say(f"\n{self._step}/{self._steps}  {words}", soft_wrap=True, style="bold")
        begin = time.monotonic()
        yield
        self.say(f"({time.monotonic() - begin:.1f} s)", style="dim")

    def run(self, *words: object) -> None:
        """Show a command, and run it."""
        from kinid.cli import app
        from kinid.cli.ending import STOPPED

        arguments = [str(word) for word in words]
        self.say(f"$ kinid {shlex.join(arguments)}", soft_wrap=True, style="cyan")
        code = app(arguments, prog_name="kinid", standalone_mode=False)
        if code:  # typer turns Ctrl-C into a code
            raise KeyboardInterrupt if code == STOPPED else typer.Exit(code)
