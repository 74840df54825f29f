"""A folder that is watched: what comes is taken in once, an odd log is named, and a kill loses nothing."""

from __future__ import annotations

import os
import re
import signal
import subprocess
import sys
from pathlib import Path

import pytest
from batch.tasks import MODEL, contents, write_logs

from kinid.batch import watch as watching
from kinid.batch.runners import runner
from kinid.batch.store import Store
from kinid.batch.watch import Watch
from kinid.errors import InputError


class Clock:
    """Time that passes when a test says so [s]."""

    now = 0.0

    def monotonic(self) -> float:
        return self.now


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> Clock:
    made = Clock()
    monkeypatch.setattr(watching, "time", made)
    return made


def watch(folder: Path, said: list[tuple[str, str]]) -> Watch:
    return Watch(
        str(folder), None, MODEL, Store(str(folder / ".kinid")), runner("serial"), lambda *one: said.append(one)
    )


def test_logs_are_taken_in_as_they_come(tmp_path: Path, clock: Clock) -> None:
    said: list[tuple[str, str]] = []
    folder = tmp_path / "logs"
    folder.mkdir()
    w = watch(folder, said)
    assert w.begin() == 0
    assert w.look() == 0
    write_logs(folder, 6)
    (folder / "broken.parquet").write_bytes(b"PAR1")
    assert w.look() == 0  # they may still grow
    clock.now += watching.SETTLED
    assert w.look() == 7
    write_logs(folder, 1, seed=9, stiffness=950.0)
    w.look()
    clock.now += watching.SETTLED
    assert w.look() == 1
    lines = dict(said)
    assert lines["broken.parquet"].startswith("put aside: found")
    assert lines["poke_9_0.parquet"].startswith("odd: kelvin-voigt.stiffness is 9")
    assert all(lines[f"poke_0_{i}.parquet"].startswith("error 0.0") for i in range(6))
    page = (folder / ".kinid" / "watch.html").read_text(encoding="utf-8")
    assert all(name in page for name in lines)
    # error and noise of each log, both with their unit
    assert len(re.findall(r'<td class="num">[\d.e-]+ N</td>', page)) == 2 * 7
    assert len(Store(str(folder / ".kinid")).files("contact")) == 7


def test_it_goes_on_where_it_was(tmp_path: Path, clock: Clock) -> None:
    said: list[tuple[str, str]] = []
    write_logs(tmp_path / "logs", 2)
    w = watch(tmp_path / "logs", said)
    w.begin()
    w.look()
    clock.now += watching.SETTLED
    w.look()
    before = contents(tmp_path / "logs" / ".kinid")
    write_logs(tmp_path / "logs", 1, seed=4)
    again = watch(tmp_path / "logs", said)
    assert again.begin() == 2
    again.look()
    clock.now += watching.SETTLED
    assert again.look() == 1
    assert [name for name, _ in said] == ["poke_0_0.parquet", "poke_0_1.parquet", "poke_4_0.parquet"]
    after = contents(tmp_path / "logs" / ".kinid")
    assert all(after[name] == data for name, data in before.items() if name != "watch.html")
    with pytest.raises(InputError, match="which holds"):
        Watch(str(tmp_path / "logs"), None, ("hooke",), w.store, runner("serial")).begin()


@pytest.mark.slow
def test_a_kill_loses_nothing(tmp_path: Path, clock: Clock) -> None:
    write_logs(tmp_path / "logs", 3)
    words = ["watch", tmp_path / "logs", "--model", ",".join(MODEL), "--every", 0.05]
    command = [sys.executable, "-m", "kinid", *map(str, words)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        lines = [process.stdout.readline() for _ in range(2)]
        os.kill(process.pid, signal.SIGKILL)
    assert "0 logs known" in lines[0]
    said: list[tuple[str, str]] = []
    again = watch(tmp_path / "logs", said)
    known = again.begin()
    assert 1 <= known <= 3
    assert (tmp_path / "logs" / lines[1].split(":")[0]).exists()
    again.look()
    clock.now += watching.SETTLED
    assert again.look() == 3 - known == len(said)
    assert len(again.store.files("fit")) == 3
