"""What workers are given in tests: functions of a module, so that other processes find them."""

from __future__ import annotations

import os
import signal
import time
from pathlib import Path

import pyarrow as pa
import pyarrow.parquet as pq
from campaign.testers import several

from kinid.errors import InputError

MODEL = "kelvin-voigt", "surface-offset", "sensor-bias"


def square(x: int) -> int:
    return x * x


def refuses(x: int) -> int:
    if x == 2:
        raise InputError("two", "any other number", "leave it out")
    return x


def stumbles(task: tuple[int, str]) -> int:
    """Fails the first time, as a server that is busy does."""
    x, mark = task
    if x == 1 and not Path(mark).exists():
        Path(mark).touch()
        raise OSError("busy")
    return x


def kills(x: int) -> int:
    if x == 3:
        os.kill(os.getpid(), signal.SIGKILL)
    return x


def killed_once(task: tuple[int, str]) -> int:
    """A worker that somebody kills from outside while it works."""
    x, mark = task
    if x == 1 and not Path(mark).exists():
        Path(mark).touch()
        os.kill(os.getpid(), signal.SIGKILL)
    time.sleep(0.01)
    return x


def write_logs(folder: Path, count: int, seed: int = 0, **truth: float) -> list[Path]:
    """Logs of a material tester, as files."""
    folder.mkdir(exist_ok=True)
    out = []
    for i, log in enumerate(several(count, seed, **truth)):
        out.append(folder / f"poke_{seed}_{i}.parquet")
        pq.write_table(pa.table({"t": log.t, **log.contact}), out[-1])
    return out


def contents(folder: Path) -> dict[str, bytes]:
    """All files of a folder by their names in it."""
    return {str(p.relative_to(folder)): p.read_bytes() for p in sorted(folder.rglob("*")) if p.is_file()}
