"""What CONTRIBUTING.md promises of one file: an effect and a log format, put into a copy of the tree as the page has
them, need nothing else; the tests of the copy find and check them.
"""

from __future__ import annotations

import json
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent
#: what the copy needs of the tree
PARTS = ("kinid", "controllers", "estimators", "urdf", "tests", "pyproject.toml")
#: tests that look at what is new, and how many of them there are at least: rules of the contract and more
SELECTED = {
    "tests/effects/test_catalogue.py": ("quadratic-damping", 22),
    "tests/effects/test_names.py": ("test_names", 100),
    "tests/lab/test_hidden.py": ("can_be_hidden", 1),
    "tests/data/readers/test_formats.py": ("test_formats", 80),
}


def blocks() -> dict[str, str]:
    """Files that the page names before a block of code, as "…, as `path`:", with their text."""
    text = (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8")
    found = re.findall(r"`(kinid/[\w/]+\.py)`:\n\n```python\n(.*?)^```", text, re.DOTALL | re.MULTILINE)
    return {path: body for path, body in found}


@pytest.fixture(scope="module")
def tree(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A copy of the tree with those files in it."""
    copy = tmp_path_factory.mktemp("tree")
    for part in PARTS:
        if (ROOT / part).is_dir():
            left_out = shutil.ignore_patterns("worlds")
            shutil.copytree(ROOT / part, copy / part, symlinks=True, ignore=left_out)
        else:
            shutil.copy(ROOT / part, copy)
    for path, body in blocks().items():
        assert not (copy / path).exists(), f"the tree has {path} already"
        (copy / path).write_text(body, encoding="utf-8")
    return copy


def ask(tree: Path, *words: str) -> str:
    """What Python says in the copy."""
    done = subprocess.run(
        [sys.executable, *words],
        cwd=tree,
        # The copy has no measured logs beside it, and what is chosen of its tests needs none.
        env=os.environ | {"PYTHONPATH": str(tree), "KINID_EFFECTS": "", "CI": ""},
        check=False,
        capture_output=True,
        text=True,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


def test_the_page_has_an_effect_and_a_format() -> None:
    assert list(blocks()) == ["kinid/effects/quadratic_damping.py", "kinid/data/readers/json_lines.py"]


def test_the_tests_of_the_tree_find_it_and_pass(tree: Path) -> None:
    chosen = " or ".join(f"({Path(file).name} and {part})" for file, (part, _) in SELECTED.items())
    pytest_alone = "import sys, pytest; sys.exit(pytest.main(sys.argv[1:]))"
    said = ask(tree, "-c", pytest_alone, "-v", "-p", "no:cacheprovider", *SELECTED, "-k", chosen)
    for file, (_, least) in SELECTED.items():
        assert len(re.findall(rf"^{file}::.* PASSED", said, re.MULTILINE)) >= least, said


def test_commands_know_it(tree: Path) -> None:
    main = "from kinid.cli import main; main()"
    assert str(tree) in ask(tree, "-c", "import kinid; print(kinid.__file__)")
    said = ask(tree, "-c", main, "effect", "check", "kinid/effects/quadratic_damping.py")
    assert "BROKEN" not in said
    assert "Forchheimer" in ask(tree, "-c", main, "diagnose", "--explain", "quadratic-damping")
    assert "quadratic-damping" in ask(tree, "-c", main, "diagnose", "--explain", "all")
    (tree / "log.jsonl").write_text(
        "".join(
            f'{{"t": {0.01 * i}, "depth": {1e-4 * (i % 40)}, "normal_force": {0.1 * (i % 40)}}}\n' for i in range(400)
        )
    )
    said = ask(tree, "-c", main, "fit", "log.jsonl", "--model", "hooke,quadratic-damping")
    assert "quadratic-damping.damping" in said


def test_the_laboratory_hides_what_the_law_says(tree: Path) -> None:
    """A fit of the true model finds what the page's `inject` drew, inside its interval's double."""
    main = "from kinid.cli import main; main()"
    ask(tree, "-c", main, "lab", "ecoflex-50", "--hide", "quadratic-damping", "--seed", "5", "-o", "hidden")
    model = "kelvin-voigt,coulomb-friction,quadratic-damping"
    words = ("fit", "hidden/log.parquet", "--rig", "hidden/rig.toml", "--model", model, "--json", "fit.json")
    ask(tree, "-c", main, *words)
    truth = json.loads((tree / "hidden/truth/log.json").read_text(encoding="utf-8"))["hidden"]["parameters"]["damping"]
    found = json.loads((tree / "fit.json").read_text(encoding="utf-8"))["parameters"]["quadratic-damping.damping"]
    print(f"hidden {truth:.4g}, found {found['value']:.4g} [{found['low']:.4g}, {found['high']:.4g}]")
    assert abs(found["value"] - truth) < found["high"] - found["low"]
    assert found["high"] - found["low"] < 0.5 * truth


def test_the_style_of_what_is_new(tree: Path) -> None:
    """As the project's own: `make lint` passes with it."""
    ask(tree, "-m", "ruff", "check", *blocks())
    ask(tree, "-m", "ruff", "format", "--check", *blocks())
