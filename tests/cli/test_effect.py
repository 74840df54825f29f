"""`kinid effect`: a file that is written passes its check and is fitted; what is wrong with one is said."""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from kinid.effects import Stage, catalogue

Run = Callable[..., tuple[int, str, str]]


@pytest.fixture
def desk(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """A folder to work in; nothing of its effects stays in this process."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("KINID_EFFECTS", "")
    yield tmp_path
    monkeypatch.undo()
    catalogue.cache_clear()


@pytest.mark.parametrize("stage", [stage.value for stage in Stage])
def test_what_is_written_keeps_the_contract(stage: str, desk: Path, run: Run) -> None:
    (desk / "mine").mkdir()
    code, said, err = run("effect", "new", "law-of-mine", "--stage", stage, "--out", "mine", "--json", "new.json")
    assert code == 0, err
    file = desk / "mine" / "law_of_mine.py"
    assert file.is_file()
    assert "kinid effect check" in said
    assert json.loads((desk / "new.json").read_text()) == {
        "effect": "law-of-mine",
        "stage": stage,
        "file": str(Path("mine/law_of_mine.py")),
    }
    code, said, err = run("effect", "check", file, "--json", "found.json")
    assert code == 0, said + err
    facts = json.loads((desk / "found.json").read_text())
    assert facts["effect"] == "law-of-mine"
    assert facts["passed"]
    (acts,) = (check["found"] for check in facts["checks"] if check["check"] == "stages")
    assert acts == stage
    assert min(facts["angles"].values()) > 3.0  # the catalogue has no such law yet
    assert all(check["check"] in said and check["passed"] for check in facts["checks"])


def test_what_is_written_is_fitted(desk: Path, run: Run, log: Path) -> None:
    assert run("effect", "new", "law-of-mine", "--stage", "normal", "--out", "mine/law_of_mine.py")[0] == 0
    model = "kelvin-voigt,coulomb-friction,law-of-mine"
    code, said, err = run("fit", log, "--model", model, "--effects", desk / "mine")
    assert code == 0, err
    assert "law-of-mine.damping" in said


def test_folders_of_effects_stand_before_or_behind_the_command(
    desk: Path, run: Run, refused: Callable[..., None], log: Path
) -> None:
    assert run("effect", "new", "law-of-mine", "--stage", "normal", "--out", "mine/law_of_mine.py")[0] == 0
    explain = ("diagnose", "--explain", "law-of-mine")
    for words in (
        ("--effects", "mine", *explain),
        (*explain, "--effects", "mine"),
        (*explain, "--effects=mine"),
        ("diagnose", "--effects", "mine", *explain[1:]),
    ):
        code, said, err = run(*words)
        assert code == 0, err
        assert said.startswith("law-of-mine")
    refused(run(*explain, "--effects", "absent"), "no folder", "absent")
    for words in ((*explain, "--effects"), (*explain, "--effects="), ("diagnose", "--effects", *explain[1:])):
        refused(run(*words), "--effects without a folder")


def test_a_broken_rule_is_said_with_its_remedy(desk: Path, run: Run) -> None:
    run("effect", "new", "law-of-mine", "--stage", "normal")
    file = desk / "law_of_mine.py"
    file.write_text(
        file.read_text().replace('"N·s²/m²", 0.0', '"lbf", 0.0').replace("s.normal = s.normal +", "s.normal +=")
    )
    code, said, err = run("effect", "check", file, "--json", "found.json")
    assert code == 2
    assert err.count("\n") == 1
    assert "3 of 22 checks of" in err
    assert "units, purity, order" in err
    for words in ("damping in 'lbf'", "expected: SI units", "to mend it: write s.normal = s.normal + …, not +="):
        assert words in said
    facts = json.loads((desk / "found.json").read_text())
    assert not facts["passed"]
    assert [check["check"] for check in facts["checks"] if not check["passed"]] == ["units", "purity", "order"]


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("Law", "--stage", "normal"), "the name 'Law'"),
        (("law_one", "--stage", "normal"), "kebab-case"),
        (("hooke", "--stage", "normal"), "'hooke', which is taken"),
        (("none", "--stage", "normal"), "'none', which is taken"),
        (("my-law", "--stage", "norml"), "did you mean 'normal'"),
        (("my-law", "--stage", "normal", "--out", "other.py"), "a file my_law.py"),
        (("my-law", "--stage", "normal", "--out", "there"), "there already"),
    ],
)
def test_what_is_not_written(
    words: tuple[str, ...], said: str, desk: Path, run: Run, refused: Callable[..., None]
) -> None:
    (desk / "there").mkdir()
    (desk / "there" / "my_law.py").write_text("kept")
    refused(run("effect", "new", *words), said)
    assert (desk / "there" / "my_law.py").read_text() == "kept"
    assert [path.name for path in desk.iterdir()] == ["there"]


def test_what_is_not_checked(desk: Path, run: Run, refused: Callable[..., None]) -> None:
    refused(run("effect", "check", "absent.py"), "no file absent.py")
    (desk / "law.txt").write_text("x")
    refused(run("effect", "check", "law.txt"), "no Python file")
    (desk / "law.py").write_text("x =")
    refused(run("effect", "check", "law.py"), "SyntaxError")
    run("effect", "new", "my-law", "--stage", "normal")
    text = (desk / "my_law.py").read_text()
    (desk / "hooke.py").write_text(text.replace("my-law", "hooke"))
    refused(run("effect", "check", "hooke.py"), "a second effect 'hooke'")


def test_effects_of_the_catalogue_are_checked_by_their_files(desk: Path, run: Run) -> None:
    import kinid

    code, said, err = run("effect", "check", Path(kinid.__file__).parent / "effects" / "viscous_damping.py")
    assert code == 0, err
    assert "N += c δ̇" in said
    assert "BROKEN" not in said


def test_a_law_that_fails_is_named_with_its_line(desk: Path, run: Run, log: Path, refused: Callable[..., None]) -> None:
    code, _, err = run("effect", "new", "my-law", "--stage", "normal", "--out", "mine/my_law.py")
    assert code == 0, err
    file = desk / "mine" / "my_law.py"
    lines = file.read_text(encoding="utf-8").splitlines()
    row = next(i for i, line in enumerate(lines) if "s.normal = " in line)
    lines[row] = "        s.normal = float('nan') * (s.normal,)"
    file.write_text("\n".join(lines) + "\n", encoding="utf-8")
    result = run("fit", log, "--model", "kelvin-voigt,my-law", "--effects", desk / "mine")
    refused(result, "an effect of your own that fails", f"my_law.py, line {row + 1} (TypeError", "kinid effect check")


def test_a_pipe_among_effects_is_not_waited_for(desk: Path, run: Run, log: Path, refused: Callable[..., None]) -> None:
    (desk / "mine").mkdir()
    os.mkfifo(desk / "mine" / "my_law.py")
    refused(run("fit", log, "--model", "hooke", "--effects", desk / "mine"), "my_law.py (a pipe, no regular file)")


@pytest.mark.parametrize(
    ("sound", "broken"), [("null = {", 'null = {"damping": "0"}  # {'), ("return (", "return 2 * (")]
)
def test_what_fails_beside_a_broken_law_is_named_with_its_check(
    desk: Path, run: Run, log: Path, refused: Callable[..., None], sound: str, broken: str
) -> None:
    assert run("effect", "new", "my-law", "--stage", "normal", "--out", "mine/my_law.py")[0] == 0
    file = desk / "mine" / "my_law.py"
    text = file.read_text(encoding="utf-8")
    assert sound in text
    file.write_text(text.replace(sound, broken), encoding="utf-8")
    result = run("fit", log, "--model", "kelvin-voigt,my-law", "--effects", desk / "mine")
    refused(result, "an error beside effects of your own", f"kinid effect check {file}", "please report it with")
