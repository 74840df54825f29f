"""Names that the field has better words for stay away: `docs/glossary.md` has the terms."""

from __future__ import annotations

import ast
import io
import tokenize
from pathlib import Path

ROOT = Path(__file__).parents[1]
#: former names, each with the term that took its place
REPLACED = {
    "side_by_side": "parallel_map",
    "held_parameters": "fixed_parameters",
    "solve_between": "solve_box_constrained",
    "reformed": "with_best_rest_form",
    "one_by_one": "expand_names",
    "refuse_idle": "refuse_inapplicable",
    "promise": "predicted_gain",
    "pursue": "refine",
    "belief": "accepted",
    "looks": "screenings",
    "trusted_to": "calibration_tolerance",
    "stand_ins": "collinear_groups",
    "press_through": "solve_series_compliance",
    "imitations": "refit_directions",
    "doubts_of": "warnings_of",
    "let_go": "separated",
    "rivalries": "indistinguishable_classes",
    "told": "what it is: a mask by what it masks, settings, event_bits, labels",
    "told_apart": "identifiability",
    "ground": "sample_sites",
    "zones": "segments",
    "misfit": "local_bias; residual_over_noise of a probe",
}
SOURCES = [
    path
    for folder in ("kinid", "estimators", "controllers")
    for path in sorted((ROOT / folder).rglob("*.py"))
    if not path.is_symlink()
]


#: lines of a function beside its docstring, unless a comment above it says why
LONGEST = 60


def test_functions_are_short_or_say_why_not() -> None:
    for path in SOURCES:
        text = path.read_text(encoding="utf-8")
        lines = text.splitlines()
        for node in ast.walk(ast.parse(text)):
            if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
                doc = ast.get_docstring(node, clean=False)
                length = node.end_lineno - node.lineno + 1 - (len(doc.splitlines()) if doc else 0)
                first = min([node.lineno, *(d.lineno for d in node.decorator_list)])
                reason = lines[first - 2].lstrip().startswith("#")
                assert length <= LONGEST or reason, f"{path.name}: {node.name} has {length} lines"


def test_former_names_do_not_come_back() -> None:
    for path in SOURCES:
        found = {
            token.string
            for token in tokenize.generate_tokens(io.StringIO(path.read_text(encoding="utf-8")).readline)
            if token.type == tokenize.NAME and token.string in REPLACED
        }
        assert not found, (path, {name: REPLACED[name] for name in found})
