"""A disk that is full at any moment: one line says so, and what is there is whole."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest
from fuzz import sound

from faults.files import assert_whole
from kinid.errors import InputError
from kinid.live.messages import Wrench
from kinid.live.recording import Recorder

CHILD = Path(__file__).with_name("full_disk_child.py")
FIT = "bench/tester.csv --model hooke"
QUICK = (
    "contact log.csv -o 0.parquet --json 0.json",
    f"fit {FIT} --json 1.json",
    f"diagnose {FIT} --max-effects 0 --report 2.html",
    "init log.csv --robot lwr4plus -o 3.toml",
    "effect new my-law --stage normal -o my_law.py",
)
LONG = (
    *QUICK,
    "contact log.csv -o 5.npz --plot 5.html",
    "map log.csv --model hooke -o 6.parquet --plot 6.html --export worlds",
    "plan poke --depth 0.002 --duration 1 -o 7.csv",
    "view log.csv --record 8.html --no-open",
    "lab ecoflex-50 --seed 1 -o lab",
    "lab mould --campaign 1x2 --spacing 0.05 -o camp",
    "live log.csv --rig rig.toml --model kelvin-voigt --speed 0 --record 9.mcap --json 9.json",
)


@pytest.mark.parametrize(
    ("lines", "limits"),
    [(QUICK, (0, 700)), pytest.param(LONG, (0, 1, 700, 5000, 50_000, 500_000), marks=pytest.mark.slow)],
    ids=["few", "all"],
)
def test_no_file_may_grow(lines: tuple[str, ...], limits: tuple[int, ...], tmp_path: Path) -> None:
    (tmp_path / "bench").mkdir()
    (tmp_path / "rig.toml").write_text(sound.RIG, encoding="utf-8")
    (tmp_path / "log.csv").write_bytes(sound.csv(sound.joints()))
    (tmp_path / "bench" / "tester.csv").write_bytes(sound.csv(sound.tester()))
    tasks = json.dumps([(line, limit) for limit in limits for line in lines])
    path = os.pathsep.join(sys.path)
    done = subprocess.run(
        [sys.executable, str(CHILD), tasks],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        check=True,
        env={**os.environ, "PYTHONPATH": path},
    )
    ends = [json.loads(line) for line in done.stdout.splitlines()]
    assert len(ends) == len(lines) * len(limits)
    for line, limit, code, said, left in ends:
        assert code in (0, 2), (line, limit, said)
        assert code == 0 or said.count("\n") == 1, (line, limit, said)
        assert limit or code == 2, (line, said)
        assert not any(Path(name).name.startswith(".") for name in left), (line, limit, left)
        for name in left:
            assert_whole(tmp_path / name)


def test_a_recording_keeps_what_it_had(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The disk takes half of a go, which had written over the end of the file; what was before it is read."""
    path, write = tmp_path / "a.mcap", os.pwrite
    recorder = Recorder(path, ("a",), "s", {})
    begun = path.read_bytes()
    assert_whole(path)
    room = [10]

    def full(file: int, data: bytes, at: int) -> int:
        if len(data) > 60 and not room:
            raise OSError(28, "No space left on device")
        return write(file, data[: room.pop()] if len(data) > 60 else data, at)

    monkeypatch.setattr(os, "pwrite", full)
    recorder.sample(Wrench(1, 1, [0.0] * 6), 1)
    recorder.close()
    assert "No space left" in recorder.error
    assert path.read_bytes() == begun
    assert_whole(path)


def test_a_recording_that_cannot_begin_leaves_no_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(*_: object) -> int:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "pwrite", full)
    with pytest.raises(InputError, match="No space left"):
        Recorder(tmp_path / "a.mcap", ("a",), "s", {})
    assert not list(tmp_path.iterdir())
