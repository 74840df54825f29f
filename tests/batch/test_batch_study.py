"""How time and memory grow with logs: contact frames, single fits and a pooled model that begins from those, in this
process and by two others.

    KINID_LOGS=100,1000,10000 make figure OF=tests/batch/test_batch_study.py

Time is that of processors, of this process and its workers: other work on the machine changes it less than the time on
the clock, which is printed beside it.
"""

from __future__ import annotations

import os
import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from scripted import scripted_poke

import kinid
from kinid.batch.jobs import Job
from kinid.batch.logs import campaign_of, items_of
from kinid.batch.pooled import ByRunner, shelf_for
from kinid.batch.run import run
from kinid.batch.runners import Runner, runner
from kinid.batch.store import Store
from kinid.memory import give_back

MODEL = kinid.Model("kelvin-voigt", "coulomb-friction")
COUNTS = [int(count) for count in os.environ.get("KINID_LOGS", "20,40,80").split(",")]
SECONDS = 10.0
#: what a log may add to the first process of a pooled model [MB]
KEPT = 0.6


def write(folder: Path, count: int) -> None:
    """Pokes of 10 s at 500 Hz that differ in their noise alone: what is measured is the work, not the material."""
    poke = scripted_poke(seed=1)
    path = poke.write(folder)
    table = pq.read_table(path)
    path.unlink()
    table = table.slice(0, int(np.searchsorted(table["t"].to_numpy(), SECONDS)))
    rng = np.random.default_rng(7)
    for i in range(count):
        columns = {name: table[name] for name in table.column_names}
        for name in ("fx", "fy", "fz"):
            columns[name] = pa.array(table[name].to_numpy() + 0.01 * rng.standard_normal(table.num_rows))
        pq.write_table(pa.table(columns), folder / f"poke_{i:05d}.parquet")


@dataclass(frozen=True)
class Cost:
    """What something took: of processors, all together and in this process alone, and on the clock [s]; and the most
    memory that this process had meanwhile, and that one of the others had [MB].
    """

    seconds: float
    first: float
    clock: float
    memory: float
    others: float


def processor_seconds(pid: int) -> float:
    """Of a process, so far."""
    fields = Path(f"/proc/{pid}/stat").read_text(encoding="ascii").rsplit(")", 1)[1].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def peak(pid: int) -> float:
    """The most memory of a process since that was last forgotten [MB]."""
    status = Path(f"/proc/{pid}/status").read_text(encoding="ascii")
    return int(status.split("VmHWM:")[1].split()[0]) / 1024


def measured(do: Callable[[], object], by: Runner) -> Cost:
    """What something takes."""
    give_back()
    mine, theirs = os.getpid(), by.pids() if by.apart else []  # type: ignore[attr-defined]
    for pid in (mine, *theirs):
        Path(f"/proc/{pid}/clear_refs").write_text("5", encoding="ascii")
    before, clock = {pid: processor_seconds(pid) for pid in (mine, *theirs)}, time.perf_counter()
    do()
    clock = time.perf_counter() - clock
    now = by.pids() if by.apart else []  # type: ignore[attr-defined]
    took = {pid: processor_seconds(pid) - before.get(pid, 0.0) for pid in (mine, *now)}
    return Cost(sum(took.values()), took[mine], clock, peak(mine), max(map(peak, now), default=0.0))


def pooled(folder: Path, fits: Store, by: Runner, say: Callable[[str], None]) -> None:
    """One model over all logs, which begins from what fits of single logs found."""
    items, sharing = items_of([folder])
    with shelf_for(by, fits) as shelf:
        found = campaign_of(items, sharing, ByRunner.of(by, fits, items, shelf)).fit(MODEL)
        size = 0 if shelf is None else sum(file.stat().st_size for file in shelf.folder.iterdir())
    assert len(found.logs) == len(items)
    say(f"  {found.pool.steps} steps; on disk meanwhile {size / len(items) / 1e6:.2f} MB a log")


def spots(by: Runner, say: Callable[[str], None]) -> Callable[[int, int, str], None]:
    """Says of a job at a tenth, at half and at its end what processes took and had until then."""

    def progress(done: int, total: int, _: str) -> None:
        if done in {max(1, total // 10), max(1, total // 2), total}:
            pids = (os.getpid(), *(by.pids() if by.apart else ()))  # type: ignore[attr-defined]
            say(f"  {done} of {total}: " + ", ".join(f"{peak(pid):.0f} MB" for pid in pids))

    return progress


@pytest.mark.slow
@pytest.mark.skipif(not Path("/proc/self/clear_refs").exists(), reason="memory is read as Linux tells it")
@pytest.mark.parametrize("workers", [0, 1, 2])
def test_time_is_straight_and_memory_flat(workers: int, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    def say(words: str) -> None:
        with capsys.disabled():
            print(words, flush=True)

    found: dict[str, list[Cost]] = {}
    with runner("processes" if workers else "serial", workers or None) as by:
        progress = spots(by, say)
        for what in ("contact", "fit", "pooled"):
            for count in (5, *COUNTS):  # the first ones compile, and aren't looked at
                folder, fits = tmp_path / f"logs_{count}", Store(str(tmp_path / f"fit_{count}"))
                if not folder.exists():
                    folder.mkdir()
                    write(folder, count)
                if what == "pooled":
                    do: Callable[[], object] = partial(pooled, folder, fits, by, say)
                else:
                    store = fits if what == "fit" else Store(str(tmp_path / f"contact_{count}"))
                    do = partial(run, Job(what, MODEL.names if what == "fit" else ()), items_of([folder])[0], store, by)
                    do = partial(do, progress)
                cost = measured(do, by)
                if what != "pooled":
                    assert len(store.files(what)) == count
                found.setdefault(what, []).append(cost)
                say(
                    f"{what}, {workers or 'no'} workers: {count} logs, {cost.seconds:.2f} s of processors "
                    f"({cost.seconds / count:.4f} a log, {cost.first / count:.4f} of them in the first process), "
                    f"{cost.clock:.2f} s on the clock, {cost.memory:.0f} MB here, {cost.others:.0f} MB a worker"
                )
    for what, several in found.items():
        costs = several[1:]
        seconds = np.array([cost.seconds for cost in costs])
        line = np.polyval(np.polyfit(COUNTS, seconds, 1), COUNTS)
        # other work on the machine disturbs even the time of processors
        assert np.max(np.abs(seconds / line - 1.0)) < 0.15, what
        grown, more = costs[-1].memory - costs[0].memory, COUNTS[-1] - COUNTS[0]
        if what != "pooled":
            assert grown < 20.0 + 0.01 * COUNTS[-1], what
            assert costs[-1].others - costs[0].others < 40.0, what
        elif workers:  # what others say of each log is kept
            assert grown < 20.0 + KEPT * more, what
