"""`kinid effect new` and `kinid effect check`: an effect of one's own, in one file."""

from __future__ import annotations

import re
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from kinid.errors import InputError, near

if TYPE_CHECKING:
    from kinid.effects import Effect, Stage
    from kinid.modeling.contract import Case, Outcome
    from kinid.writers import Json

NEW_EXAMPLES = """Examples:

kinid effect new quadratic-damping --stage normal

kinid effect new hose-pull --stage tool --out my_effects/hose_pull.py
"""

CHECK_EXAMPLES = """Examples:

kinid effect check quadratic_damping.py

kinid effect check my_effects/hose_pull.py --json found.json
"""

#: of the effects that it looks like, so many are listed
LISTED = 5

app = typer.Typer(name="effect", no_args_is_help=True, help="An effect of your own, in one file.")


def _stages(incomplete: str) -> list[str]:
    from kinid.effects import Stage

    return [stage.value for stage in Stage if stage.value.startswith(incomplete)]


def new(
    name: Annotated[str, typer.Argument(help="Name of the effect, in kebab-case.", show_default=False)],
    stage: Annotated[
        str,
        typer.Option(
            help="Where in the chain it acts: geometry, elastic, normal, friction, frame, tool, sensor, acquisition "
            "or joint.",
            show_default=False,
            autocompletion=_stages,
        ),
    ],
    out: Annotated[
        Path | None,
        typer.Option("-o", "--out", help="File to write, or a folder that is there; default: the name, here."),
    ] = None,
    json_file: Annotated[Path | None, typer.Option("--json", help="What was written, as JSON.")] = None,
) -> None:
    """Write an effect of that name and stage: a small law, commented, that passes `kinid effect check` as it stands."""
    from kinid.cli.show import written
    from kinid.effects import effect_file
    from kinid.writers import check_outputs, write_json, write_text

    chosen = _stage(stage)
    _check_name(name)
    path = _path(name, out)
    check_outputs((json_file,), (path,))
    path.parent.mkdir(parents=True, exist_ok=True)
    write_text(path, effect_file(name, chosen))
    if json_file is not None:
        write_json(json_file, {"effect": name, "stage": chosen.value, "file": str(path)})
    typer.echo(f"{name}, which acts at the {chosen.value} stage; to check it: kinid effect check {path}")
    written([item for item in (path, json_file) if item is not None])


def check(
    file: Annotated[Path, typer.Argument(help="A Python file that holds one effect.", show_default=False)],
    json_file: Annotated[Path | None, typer.Option("--json", help="What was found, to write as JSON.")] = None,
) -> None:
    """Ask the contract of all effects about one, on its own example: names, units, bounds, derivatives, recovery of its
    parameters, and what logs without it and at rest say.
    """
    from kinid.cli.show import written
    from kinid.modeling.contract import Case, check_effect, look_alikes
    from kinid.writers import check_outputs, write_json

    check_outputs((json_file,), (file,))
    kind = _load(file)
    outcomes = check_effect(kind)
    broken = [outcome.rule for outcome in outcomes if not outcome.passed]
    alike: dict[str, float] = {}
    _show_outcomes(outcomes)
    if not broken:
        case = Case.of(kind)
        alike = look_alikes(case)
        _show_page(case, alike)
    if json_file is not None:
        write_json(json_file, _facts(kind, outcomes, alike))
        written([json_file])
    if broken:
        raise InputError(
            f"{len(broken)} of {len(outcomes)} checks of {file} broken: {', '.join(broken)}",
            "an effect that keeps the contract",
            "see the lines above",
        )


def _stage(text: str) -> Stage:
    """The stage of this name.

    Raises:
        InputError: there is none.
    """
    from kinid.effects import Stage

    known = [stage.value for stage in Stage]
    if text not in known:
        raise InputError(f"--stage '{text}'", f"one of {', '.join(known)}", near(text, known))
    return Stage(text)


def _check_name(name: str) -> None:
    """Refuse a name that no effect can have, or that is taken.

    Raises:
        InputError: it isn't kebab-case, or the catalogue holds it.
    """
    from kinid.effects import TOGETHER, catalogue

    if not re.fullmatch(r"[a-z]+(-[a-z]+)*", name):
        raise InputError(f"the name '{name}'", "letters a to z in kebab-case, such as my-law", "rename it")
    if name in {**catalogue(), **TOGETHER}:
        raise InputError(
            f"the name '{name}', which is taken", "a name of its own", f"another name; kinid diagnose --explain {name}"
        )


def _path(name: str, out: Path | None) -> Path:
    """Where the file goes: an effect and its file have one name.

    Raises:
        InputError: another name, a file that is there, or a folder that isn't.
    """
    own = f"{name.replace('-', '_')}.py"
    path = Path(own) if out is None else out / own if out.is_dir() else out
    if path.name != own:
        raise InputError(f"--out {path}", f"a file {own}, as the effect is named", f"--out {path.with_name(own)}")
    if path.exists():
        raise InputError(f"{path}, which is there already", "a new file", "remove it, or choose another name")
    return path


def _load(file: Path) -> type[Effect]:
    """The effect of a file; of a file of the catalogue the catalogue's own.

    Raises:
        InputError: no file, none or several effects in it, or one whose name another file has.
    """
    from kinid.effects import catalogue, load_effect

    if not file.is_file():
        raise InputError(
            f"no file {file}",
            "a Python file that holds one effect",
            "check the path, or kinid effect new NAME --stage normal",
        )
    if file.suffix != ".py":
        raise InputError(f"{file}, which is no Python file", "a file ending in .py", "name the effect's own file")
    known = {Path(str(sys.modules[kind.__module__].__file__)).resolve(): kind for kind in catalogue().values()}
    kind = known.get(file.resolve()) or load_effect(file)
    taken = catalogue().get(kind.id)
    if taken is not None and taken is not kind:
        place = sys.modules[taken.__module__].__file__
        raise InputError(f"a second effect '{kind.id}' in {file}", f"a name of its own; {place} has it", "rename it")
    return kind


def _show_outcomes(outcomes: tuple[Outcome, ...]) -> None:
    """A line for each rule; of a broken one what was expected, and how to mend it, too."""
    from kinid.cli.show import console

    out = console()
    for outcome in outcomes:
        head = f"{outcome.rule:13s} {'kept' if outcome.passed else 'BROKEN':7s}"
        out.print(f"{head} {outcome.found}", soft_wrap=True)
        if not outcome.passed:
            for said in (f"expected: {outcome.expected}", f"to mend it: {outcome.mend}"):
                out.print(f"{'':21s} {said}", soft_wrap=True)


def _show_page(case: Case, alike: dict[str, float]) -> None:
    """The effect's equation and parameters, and what it looks like in its example."""
    from kinid.cli.show import console

    out = console()
    lines = ["", f"{case.name}: {case.kind.title}", f"  {case.kind.equation}"]
    lines += [f"  {p.symbol:4s} {name} [{p.unit}]" for name, p in case.own.items()]
    if alike:
        lines.append("looks like, in its example (0°: the same readings; 90°: nothing in common)")
        lines += [
            f"  {angle:3.0f}°  {name}" + (f": {case.kind.confusions[name]}" if name in case.kind.confusions else "")
            for name, angle in list(alike.items())[:LISTED]
        ]
    for line in lines:
        out.print(line, soft_wrap=True)


def _facts(kind: type[Effect], outcomes: tuple[Outcome, ...], alike: dict[str, float]) -> Json:
    """What was found, for JSON."""
    checks = [
        {"check": o.rule, "passed": o.passed, "found": o.found, "expected": o.expected, "mend": o.mend}
        for o in outcomes
    ]
    passed = all(outcome.passed for outcome in outcomes)
    return {
        "effect": kind.id,
        "passed": passed,
        "checks": checks,
        "angles": {name: round(angle, 2) for name, angle in alike.items()},
    }


app.command("new", epilog=NEW_EXAMPLES, short_help="Write an example that runs, to put your law into.")(new)
app.command("check", epilog=CHECK_EXAMPLES, short_help="Does it keep the contract of all effects?")(check)
