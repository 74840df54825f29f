"""The figures that README and the guide show are those that their commands print."""

from __future__ import annotations

import os
import re
import shlex
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent
SHIM = "from kinid.cli import main; main()"
#: shown figures are rounded, and hardware rounds differently: estimates agree to a share of themselves
CLOSE = 0.005
#: the ends of intervals move with every change of how they are made; beyond this README shows others than a reader sees
CLOSE_INTERVAL = 0.02


def run(line: str, folder: Path) -> str:
    """What a command of the pages prints on a wide terminal."""
    done = subprocess.run(
        [sys.executable, "-c", SHIM, *shlex.split(line)[1:]],
        cwd=folder,
        capture_output=True,
        text=True,
        check=False,
        env={**os.environ, "COLUMNS": "160"},
    )
    assert done.returncode == 0, f"{line}: {done.stderr}"
    return done.stdout


def commands(page: str) -> list[str]:
    """Those of kinid in a page, in their order."""
    blocks = re.findall(r"^```sh\n(.*?)^```", (ROOT / page).read_text(encoding="utf-8"), re.DOTALL | re.MULTILINE)
    lines = [line.split("  #")[0].strip() for block in blocks for line in block.splitlines()]
    return [line for line in lines if line.startswith("kinid ")]


def shown() -> list[str]:
    """README's blocks of output."""
    text = (ROOT / "README.md").read_text(encoding="utf-8")
    blocks = re.findall(r"^```(\w*)\n(.*?)^```$", text, re.DOTALL | re.MULTILINE)
    return [body for language, body in blocks if not language]


def rows(text: str) -> dict[str, list[float]]:
    """Numbers of each line that begins with a parameter's name, by that name; of a page or of a screen."""
    found = re.findall(r"^\W*([a-z-]+\.[a-z-]+)\s+[│ ]*(.*)$", text, re.MULTILINE)
    return {name: [float(v) for v in re.findall(r"(?<![\w.])-?\d+\.?\d*(?:e-?\d+)?", rest)][:3] for name, rest in found}


@pytest.fixture(scope="module")
def desk(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, dict[str, str]]:
    """README's commands in their order, but the demo, which has a test of its own: what each prints."""
    folder = tmp_path_factory.mktemp("reader")
    wanted = [line for line in commands("README.md") if line.split()[1] != "demo"]
    return folder, {" ".join(line.split()[1:3]): run(line, folder) for line in wanted}


@pytest.mark.parametrize(("command", "block"), [("fit run/log.parquet", 0), ("diagnose run/log.parquet", 1)])
def test_tables_in_readme_are_those_of_its_commands(
    desk: tuple[Path, dict[str, str]], command: str, block: int
) -> None:
    printed, page = rows(desk[1][command]), rows(shown()[block])
    assert len(page) >= 3
    for name, (value, *interval) in page.items():
        assert printed[name][0] == pytest.approx(value, rel=CLOSE), name
        assert printed[name][1:] == pytest.approx(interval, rel=CLOSE_INTERVAL), name


def test_sentences_in_readme_are_those_of_its_commands(desk: tuple[Path, dict[str, str]]) -> None:
    """The verdict, and the errors before and after."""
    verdict = shown()[1].splitlines()[0]
    assert verdict in desk[1]["diagnose run/log.parquet"]
    stated, printed = (
        next(line for line in text.splitlines() if line.startswith("error"))
        for text in (shown()[0], desk[1]["fit run/log.parquet"])
    )
    number = r"\d+\.\d+"
    assert re.split(number, stated) == re.split(number, printed)
    values = [[float(v) for v in re.findall(number, line)] for line in (stated, printed)]
    assert values[1] == pytest.approx(values[0], rel=CLOSE)


def test_the_truth_in_readme_is_in_the_found_intervals() -> None:
    page = rows(shown()[1])
    stated = re.search(
        r"The truth in `run/truth/` is ([\d.]+) N/m, ([\d.]+) N·s/m, ([\d.]+), a ratio of ([\d.]+) and "
        r"([\d.]+) s",
        (ROOT / "README.md").read_text(encoding="utf-8"),
    )
    assert stated is not None
    for truth, (_, low, high) in zip(map(float, stated.groups()), page.values(), strict=True):
        # an interval of 95 % need not hold each of five truths; twice as wide it does
        assert 1.5 * low - 0.5 * high <= truth <= 1.5 * high - 0.5 * low


def test_the_planned_excitation_uses_the_force_it_is_given(desk: tuple[Path, dict[str, str]]) -> None:
    (line,) = [line for line in commands("docs/guide.md") if line.startswith("kinid plan excite")]
    said = run(f"{line} --rig run/rig.toml", desk[0])
    force = re.search(r"at most ([\d.]+) mm, ([\d.]+) N", " ".join(said.split()))
    assert force is not None
    # of 8 N one hundredth is spared for what lies between samples; a stalled search gave 0.37 N
    assert float(force[2]) > 7.0
    assert "bound by nothing" not in said
    assert (desk[0] / "best.parquet").is_file()


def test_the_catalogue_is_as_large_as_readme_says() -> None:
    from kinid.effects import catalogue

    own = [name for name, effect in catalogue().items() if effect.__module__.startswith("kinid.")]
    (stated,) = re.findall(r"catalogue of more than (\d+)", (ROOT / "README.md").read_text(encoding="utf-8"))
    assert int(stated) < len(own) <= int(stated) + 10  # an effect more needs no other page
