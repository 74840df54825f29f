"""No effect is named outside its own folder and the laboratory: what others must know of one is an attribute of
`Effect`.
"""

from __future__ import annotations

import ast
from collections.abc import Iterator
from pathlib import Path

import pytest

from kinid import effects

ROOT = Path(__file__).parents[2]
#: files that may name effects, and why
ALLOWED = {
    "kinid/cli/demo.py": "the demo's own models",
    "kinid/cli/map.py": "the command's default law",
    "kinid/cli/shape.py": "the command's default law",
    "kinid/mapping/probes.py": "the default law of a map",
    "kinid/viewer/scene.py": "the default law of a view",
}
#: folders that may, and links to folders that are looked at by their own names
ELSEWHERE = {("kinid", part) for part in ("effects", "lab", "controllers", "estimators", "urdf")}
#: names of effects that are quantities or modules, too
QUANTITIES = {"payload"}


def _sources() -> Iterator[Path]:
    for folder in ("kinid", "controllers", "estimators"):
        for path in sorted((ROOT / folder).rglob("*.py")):
            relative = path.relative_to(ROOT)
            if relative.parts[:2] not in ELSEWHERE and str(relative) not in ALLOWED:
                yield path


def _strings(tree: ast.AST) -> Iterator[ast.Constant]:
    """Strings that programs read: no docstrings, and no sentences, whose examples may name an effect."""
    docs = {
        id(node.body[0].value)
        for node in ast.walk(tree)
        if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef)
        and node.body
        and isinstance(node.body[0], ast.Expr)
    }
    for node in ast.walk(tree):
        if (
            isinstance(node, ast.Constant)
            and isinstance(node.value, str)
            and id(node) not in docs
            and " " not in node.value
        ):
            yield node


@pytest.mark.parametrize("path", list(_sources()), ids=lambda path: str(path.relative_to(ROOT)))
def test_no_effect_is_named(path: Path) -> None:
    known = set(effects.catalogue()) - QUANTITIES
    for node in _strings(ast.parse(path.read_text(encoding="utf-8"))):
        named = {part.split(".")[0].split("[")[0].strip() for part in node.value.split(",")} & known
        assert not named, f"{path}:{node.lineno} names {named}: make it an attribute of Effect"


def test_the_exceptions_are_needed() -> None:
    for name in ALLOWED:
        text = (ROOT / name).read_text(encoding="utf-8")
        assert any(f"{quote}{effect}" in text for effect in effects.catalogue() for quote in "\"'")
