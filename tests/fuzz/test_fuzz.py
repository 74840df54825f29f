"""Whatever is wrong with an input, it ends in success or in one clear line: no traceback, hang or half-written file.

`python -m pytest -m slow tests/fuzz` tries ten thousand of them; those of all runs are the same.
"""

from __future__ import annotations

import resource
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path
from random import Random

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from fuzz import sound
from fuzz.cases import CASES
from fuzz.corpus import FAILED
from fuzz.harness import LONGEST, MOST_BYTES, attempt

ALL, FEW, PROCESSES = 10_000, 300, 300
BY_COMMAND = [name for name, case in CASES.items() if case.words]


@pytest.mark.parametrize("name", CASES)
def test_a_sound_input_is_taken(name: str, tmp_path: Path) -> None:
    """Else what follows would ask nothing."""
    assert attempt(CASES[name], CASES[name].input.sound(), tmp_path) is None


@pytest.mark.parametrize("many", [FEW, pytest.param(ALL, marks=pytest.mark.slow)])
@pytest.mark.parametrize("name", CASES)
def test_a_damaged_input_is_taken_or_refused(name: str, many: int, tmp_path: Path) -> None:
    case = CASES[name]
    share = case.share / sum(other.share for other in CASES.values())

    @settings(
        max_examples=max(1, round(many * share)), deadline=None, database=None, suppress_health_check=[*HealthCheck]
    )
    @given(st.randoms(use_true_random=False))
    def tried(rng: Random) -> None:
        folder = Path(tempfile.mkdtemp(dir=tmp_path))  # stays where it fails, with the input in it
        attempt(case, case.changed(rng), folder)
        shutil.rmtree(folder)

    tried()


@pytest.mark.parametrize("name", FAILED)
def test_what_failed_once_is_refused(name: str, tmp_path: Path) -> None:
    case, data, said = FAILED[name]
    refused = attempt(CASES[case], data, tmp_path)
    assert said in (refused or "taken")


@pytest.mark.slow
@pytest.mark.parametrize("name", BY_COMMAND)
def test_a_command_stays_within_its_memory(name: str, tmp_path: Path) -> None:
    """The same in a process of its own, whose memory is limited by the system."""
    case = CASES[name]
    for i in range(PROCESSES // len(BY_COMMAND)):
        folder = tmp_path / str(i)
        folder.mkdir()
        (folder / "rig.toml").write_text(sound.RIG, encoding="utf-8")
        (folder / "log.csv").write_bytes(sound.csv(sound.joints()))
        data = case.changed(Random(f"{name} {i}"))
        (folder / f"damaged{''.join(Path(case.file).suffixes)}").write_bytes(data)
        words = case.words.replace("FILE", f"damaged{''.join(Path(case.file).suffixes)}").split()
        done = subprocess.run(
            [sys.executable, "-m", "kinid", *words],
            cwd=folder,
            capture_output=True,
            text=True,
            timeout=LONGEST,
            check=False,
            preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_DATA, (MOST_BYTES, MOST_BYTES)),
        )
        assert done.returncode in (0, 2), (folder, done.stderr)
        assert done.returncode == 0 or done.stderr.count("\n") == 1, (folder, done.stderr)
        assert "Traceback" not in done.stderr + done.stdout, folder
        assert not list(folder.glob(".*")), folder
        assert done.returncode == 0 or not list(folder.glob("out*")), folder
