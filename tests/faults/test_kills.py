"""`kill -9` at any moment: what was done stays, no half of a file bears its name, and the next run goes on."""

from __future__ import annotations

import os
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from fuzz import sound

from faults.files import assert_whole
from kinid.lab import campaign as campaigns

#: of the long version, for each of four kinds of work (those of recordings stand with the recordings)
MANY = 25
WORKS = {
    "campaign": "lab mould --campaign 2x2 --spacing 0.05 --seed 3 -o camp",
    "map": "map pokes -o map.parquet --model kelvin-voigt",
    "diagnosis": "diagnose bench/tester.csv --model hooke --max-effects 1 --json found.json --report found.html",
}


def start(work: str, folder: Path) -> subprocess.Popen[bytes]:
    """A command in a folder."""
    path = os.pathsep.join(sys.path)
    words = [sys.executable, "-m", "kinid", *WORKS[work].split()]
    quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
    return subprocess.Popen(words, cwd=folder, env={**os.environ, "PYTHONPATH": path}, **quiet)  # type: ignore[call-overload]


def results(folder: Path) -> dict[str, bytes]:
    """Files that aren't hidden, and weren't there before; pages hold the time."""
    found = {str(path.relative_to(folder)): path for path in folder.rglob("*") if path.is_file()}
    given = ("pokes/", "bench/")
    return {
        name: path.read_bytes()
        for name, path in sorted(found.items())
        if not name.startswith(given) and not path.name.startswith(".")
    }


@pytest.fixture(scope="module")
def pokes(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("made") / "pokes"
    campaigns.run(campaigns.Campaign(1, 2, spacing=0.05, seed=4), folder)
    return folder


def desk(folder: Path, pokes: Path) -> Path:
    """A folder that holds what the commands read."""
    (folder / "bench").mkdir(parents=True)
    (folder / "bench" / "tester.csv").write_bytes(sound.csv(sound.tester()))
    (folder / "pokes").symlink_to(pokes, target_is_directory=True)
    return folder


@pytest.mark.slow  # a campaign's two kills, and a recording's, run in each test of the whole
@pytest.mark.parametrize(("work", "many"), [("map", 1), *((work, MANY) for work in WORKS)])
def test_a_kill_loses_nothing(work: str, many: int, pokes: Path, tmp_path: Path) -> None:
    whole, folder = desk(tmp_path / "whole", pokes), desk(tmp_path / "killed", pokes)
    begun = time.monotonic()
    assert start(work, whole).wait(timeout=300) == 0
    lasted, rng = time.monotonic() - begun, np.random.default_rng(len(work))
    done: dict[str, bytes] = {}
    for _ in range(many):
        process = start(work, folder)
        time.sleep(rng.uniform(0.3, 1.0) * lasted)
        process.kill()
        process.wait()
        now = results(folder)
        for name in now:
            assert_whole(folder / name)
        assert {n for n in done if n.endswith(".parquet")} <= set(now)
        if work == "campaign":
            assert all(now[name] == data for name, data in done.items() if "poke_" in name)
        done = now
    assert start(work, folder).wait(timeout=300) == 0
    there, wanted = results(folder), results(whole)
    assert set(there) == set(wanted)
    assert all(there[name] == data for name, data in wanted.items() if not name.endswith(".html"))


@pytest.mark.slow
@pytest.mark.parametrize("work", ["map", "diagnosis"])
def test_two_at_the_same_file_leave_a_whole_one(work: str, pokes: Path, tmp_path: Path) -> None:
    folder = desk(tmp_path / "both", pokes)
    both = [start(work, folder) for _ in range(2)]
    assert {process.wait(timeout=300) for process in both} <= {0, 2}
    assert results(folder)
    for name in results(folder):
        assert_whole(folder / name)
