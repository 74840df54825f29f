"""How time and memory grow with logs: contact frames, single fits and a pooled model; `KINID_LOGS=300,1000` for more.

Time is that of processors, of this process and its workers: other work on the machine changes it little.
"""

from __future__ import annotations

import os
import resource
import time
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


def used() -> float:
    """Processor time of this process [s]."""
    return time.process_time()


def peak() -> float:
    """Most memory that this process has had [MB]."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024


@pytest.mark.slow
def test_time_is_straight_and_memory_flat(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    found = []
    for count in (5, *COUNTS):  # the first ones compile and fill what is kept
        folder = tmp_path / f"logs_{count}"
        folder.mkdir()
        write(folder, count)
        items, sharing = items_of([folder])
        told: dict[str, float] = {"logs": count}
        with runner("serial") as by:
            for job in (Job("contact"), Job("fit", MODEL.names)):
                begin = used()
                outcome = run(job, items, Store(str(tmp_path / f"{job.kind}_{count}")), by)
                assert (len(outcome.done), outcome.aside) == (count, {})
                told[job.kind], told[f"{job.kind} MB"] = used() - begin, peak()
            begin = used()
            campaign_of(items, sharing, ByRunner.of(by, None, items, MODEL)).fit(MODEL)
            told["pooled"], told["pooled MB"] = used() - begin, peak()
        found.append(told)
        with capsys.disabled():
            print({name: round(value, 2) for name, value in told.items()}, flush=True)
    first, last = found[1], found[-1]
    for name, room in (("contact", 0.15), ("fit", 0.15)):
        line = np.polyfit([f["logs"] for f in found[1:]], [f[name] for f in found[1:]], 1)
        expected = np.polyval(line, [f["logs"] for f in found[1:]])
        assert np.max(np.abs([f[name] for f in found[1:]] / expected - 1.0)) < room, name
    # beyond the logs that a pooled model keeps, nothing grows with the folder but a row of it
    assert last["fit MB"] - first["pooled MB"] < 60.0 + 0.05 * last["logs"]
