"""How time and memory grow with logs: contact frames, single fits and a pooled model; `KINID_LOGS=300,1000` for more.

Time is that of processors, of this process and its workers: other work on the machine changes it little.
"""

from __future__ import annotations

import os
import time
from collections.abc import Callable
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
from kinid.batch.pooled import ByRunner
from kinid.batch.run import run
from kinid.batch.runners import runner
from kinid.batch.store import Store
from kinid.memory import give_back

MODEL = kinid.Model("kelvin-voigt", "coulomb-friction")
COUNTS = [int(count) for count in os.environ.get("KINID_LOGS", "20,40,80").split(",")]
SECONDS = 10.0


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


def measured(do: Callable[[], object]) -> tuple[float, float]:
    """Processor time that something takes [s], and the most memory that this process had meanwhile [MB]."""
    give_back()
    Path("/proc/self/clear_refs").write_text("5", encoding="ascii")
    begin = time.process_time()
    do()
    seconds = time.process_time() - begin
    status = Path("/proc/self/status").read_text(encoding="ascii")
    return seconds, int(status.split("VmHWM:")[1].split()[0]) / 1024


@pytest.mark.slow
@pytest.mark.skipif(not Path("/proc/self/clear_refs").exists(), reason="memory is read as Linux tells it")
def test_time_is_straight_and_memory_flat(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    found: dict[str, list[tuple[float, float]]] = {}
    with runner("serial") as by:
        for what in ("contact", "fit", "pooled"):
            for count in (5, *COUNTS):  # the first ones compile, and aren't looked at
                folder = tmp_path / f"logs_{count}"
                if not folder.exists():
                    folder.mkdir()
                    write(folder, count)
                items, sharing = items_of([folder])
                if what == "pooled":
                    campaign = campaign_of(items, sharing, ByRunner.of(by, None, items))
                    cost = measured(partial(campaign.fit, MODEL))
                else:
                    job, store = Job(what, MODEL.names), Store(str(tmp_path / f"{what}_{count}"))
                    cost = measured(partial(run, job, items, store, by))
                    assert len(store.files(what)) == count
                found.setdefault(what, []).append(cost)
                with capsys.disabled():
                    print(f"{what}: {count} logs, {cost[0]:.2f} s, {cost[1]:.0f} MB", flush=True)
    for what, several in found.items():
        seconds, memory = np.array(several[1:]).T
        line = np.polyval(np.polyfit(COUNTS, seconds, 1), COUNTS)
        # other work on the machine disturbs even the time of processors
        assert np.max(np.abs(seconds / line - 1.0)) < 0.15, what
        if what != "pooled":
            assert memory[-1] - memory[0] < 20.0 + 0.01 * COUNTS[-1], what
