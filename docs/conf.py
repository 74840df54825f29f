"""The site: concepts, commands, and the reference from the docstrings. `make docs` builds it; it asks the network for
nothing.

Docstrings are plain text with `code` in single backticks; what reStructuredText would take for its own marks is
escaped.
"""

from __future__ import annotations

import re
import textwrap
from typing import Any

import kinid

project = "kinid"
author = "the kinid authors"
version = release = kinid.__version__
extensions = ["myst_parser", "sphinx.ext.autodoc"]
exclude_patterns = ["conf.py"]
# links to files of the repository, which a test looks at; and names in signatures that mean several things
suppress_warnings = ["myst.xref_missing", "ref.python"]
myst_heading_anchors = 3
html_theme = "furo"
html_title = f"kinid {version}"
html_copy_source = False
html_show_sourcelink = False
html_show_copyright = False
templates_path: list[str] = []
autodoc_member_order = "bysource"
autodoc_typehints = "signature"
autodoc_class_signature = "mixed"
autodoc_preserve_defaults = True
autodoc_default_options = {"members": True}
python_use_unqualified_type_names = True
python_maximum_signature_line_length = 100


#: what begins a part of a docstring
SECTIONS = ("Args:", "Attributes:", "Class attributes:", "Raises:", "Returns:", "Yields:")


def plain(line: str) -> str:
    """A line of a docstring with its code as literals, and all else meaning itself."""
    parts = re.split(r"(`+[^`]+`+)", line)
    for i, part in enumerate(parts):
        if part.startswith("`"):
            parts[i] = f"``{part.strip('`')}``"
        else:
            parts[i] = re.sub(r"([\\*|])", r"\\\1", part)
            parts[i] = re.sub(r"(?<=\w)_(?!\w)", r"\\_", parts[i])
    # a literal ends before a letter only with a sign of no width between
    return re.sub(r"(?<=``)(?=\w)(?<!\s``)", r"\\ ", "".join(parts))


def section(lines: list[str]) -> list[str]:
    """Entries of "Args:" and the like as a list; `a, b: text` names several, and so it stays."""
    out: list[str] = []
    for line in textwrap.dedent("\n".join(lines)).splitlines():
        entry = re.match(r"([\w*][^:]*?): (.*)", line)
        if entry:
            out.append(f"- **{plain(entry[1])}**: {plain(entry[2])}")
        elif line.strip():
            out.append(f"  {plain(line.strip())}" if out else plain(line.strip()))
    return out


def docstring(_app: Any, _what: str, _name: str, _object: Any, _options: Any, lines: list[str]) -> None:
    """A docstring as reStructuredText."""
    out: list[str] = []
    rest = list(lines)
    while rest:
        line = rest.pop(0)
        if line not in SECTIONS:
            out.append(plain(line))
            continue
        body: list[str] = []
        while rest and (not rest[0] or rest[0].startswith(" ")):
            body.append(rest.pop(0))
        out += ["", f"*{line[:-1]}*", "", *section(body), ""]
    lines[:] = out


def signature(
    _app: Any, _what: str, _name: str, _object: Any, _options: Any, arguments: str | None, returned: str | None
) -> tuple[str | None, str | None]:
    """Arrays by the name that the sources give them."""
    short = [
        None
        if text is None
        else re.sub(
            r"(?:~?numpy\.)?ndarray\[tuple\[(?:~?typing\.)?Any, \.\.\.\], "
            r"(?:~?numpy\.)?dtype\[(?:~?numpy\.|~?typing\.)?(\w+?)_?\]\]",
            r"NDArray[\1]",
            text,
        )
        for text in (arguments, returned)
    ]
    return short[0], short[1]


def filled(_app: Any, name: str, source: list[str]) -> None:
    """What pages take from the program itself."""
    if name == "effects":
        source[0] = source[0].replace("<!-- catalogue -->", catalogue())
    if name == "commands":
        source[0] = source[0].replace("<!-- commands -->", commands())


def catalogue() -> str:
    """Every effect: equation, signature, what it is mistaken for, what excites it, source."""
    from kinid.effects import catalogue as effects

    out = ["## The catalogue", f"{len(effects())} effects, in the order of their names."]
    for name, effect in sorted(effects().items()):
        rivals = "; ".join(f"`{rival}` ({how})" for rival, how in effect.confusions.items()) or "nothing"
        out.append(
            f"### {name}\n\n{effect.title[0].upper() + effect.title[1:]}.\n\n```text\n{effect.equation}\n```\n\n"
            f"- In a residual: {effect.signature}\n- Seen with: {effect.excited_by}\n- Mistaken for: {rivals}\n"
            f"- Source: {effect.source}\n"
        )
    return "\n\n".join(out)


def commands() -> str:
    """The help of every command, as the terminal shows it."""
    import typer

    from kinid.cli import app

    out: list[str] = []

    def walk(command: Any, path: str) -> None:
        children = getattr(command, "commands", None) or {}
        if path != "kinid":
            context = command.make_context(path, [], resilient_parsing=True)
            out.append(f"## {path}\n\n```text\n{command.get_help(context)}\n```")
        for name, child in sorted(children.items()):
            walk(child, f"{path} {name}")

    walk(typer.main.get_command(app), "kinid")
    return "\n\n".join(out)


def setup(app: Any) -> None:
    """Connect what is above."""
    app.connect("autodoc-process-docstring", docstring)
    app.connect("autodoc-process-signature", signature)
    app.connect("source-read", filled)
