"""Many logs to tables in a folder: stopped, gone on with, on other workers, far away."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pyarrow.dataset as ds
import pyarrow.parquet as pq
import pytest
from batch.tasks import MODEL, contents, write_logs

import kinid
from kinid.batch.jobs import Job, unparquet
from kinid.batch.logs import items_of
from kinid.batch.run import run
from kinid.batch.runners import Runner, runner
from kinid.batch.store import Store
from kinid.errors import InputError

FIT = Job("fit", MODEL)


@pytest.fixture
def logs(tmp_path: Path) -> Path:
    write_logs(tmp_path / "logs", 5)
    return tmp_path / "logs"


def done_in(logs: Path, out: Path, by: Runner, job: Job = FIT) -> dict[str, bytes]:
    items, _ = items_of([logs])
    run(job, items, Store(str(out)), by)
    return contents(out)


def test_other_workers_write_the_same_bytes(logs: Path, tmp_path: Path, processes: Runner) -> None:
    (logs / "cut_off.parquet").write_bytes((logs / "poke_0_0.parquet").read_bytes()[:900])
    whole = done_in(logs, tmp_path / "a", runner("serial"))
    assert done_in(logs, tmp_path / "b", processes) == whole
    manifest = json.loads(whole["manifest.json"])
    assert (manifest["logs"], manifest["done"], list(manifest["put_aside"])) == (6, 5, ["cut_off.parquet"])
    rows = pq.read_table(tmp_path / "a" / "manifest.parquet").to_pylist()
    assert sum(bool(row["part"]) for row in rows) == 5
    assert all((tmp_path / "a" / row["part"]).stat().st_size == row["bytes"] for row in rows if row["part"])


@pytest.mark.slow
def test_a_cluster_writes_the_same_bytes(logs: Path, tmp_path: Path, cluster: Runner) -> None:
    assert done_in(logs, tmp_path / "a", cluster) == done_in(logs, tmp_path / "b", runner("serial"))


def test_a_row_is_what_a_fit_of_that_log_says(logs: Path, tmp_path: Path) -> None:
    done_in(logs, tmp_path / "out", runner("serial"))
    items, _ = items_of([logs])
    store = Store(str(tmp_path / "out"))
    found = {item.name: unparquet(store.read(item.part("fit")))[1]["fit"] for item in items}
    log = kinid.read(logs / "poke_0_3.parquet")
    assert found["poke_0_3.parquet"] == kinid.Model(*MODEL).fit(log).to_dict()
    # one table for whoever reads the folder
    table = ds.dataset(tmp_path / "out" / "fit", partitioning="hive").to_table()
    assert sorted(table["log"].to_pylist()) == sorted(found)
    stiffness = dict(zip(table["log"].to_pylist(), table["kelvin-voigt.stiffness"].to_pylist()))
    assert stiffness["poke_0_3.parquet"] == found["poke_0_3.parquet"]["parameters"]["kelvin-voigt.stiffness"]["value"]


def test_what_was_stopped_goes_on(logs: Path, tmp_path: Path) -> None:
    whole = done_in(logs, tmp_path / "a", runner("serial"))
    items, _ = items_of([logs])
    store, seen = Store(str(tmp_path / "b")), []

    def stop(count: int, total: int, name: str) -> None:
        seen.append(name)
        if count == 2:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        run(FIT, items, store, runner("serial"), stop)
    outcome = run(FIT, items, store, runner("serial"), lambda count, total, name: seen.append(name))
    assert outcome.before == 2
    assert seen == [item.name for item in items]
    assert contents(tmp_path / "b") == whole


def test_a_log_that_changed_is_done_anew(logs: Path, tmp_path: Path) -> None:
    before = done_in(logs, tmp_path / "out", runner("serial"))
    write_logs(logs, 1, stiffness=500.0)
    after = done_in(logs, tmp_path / "out", runner("serial"))
    parts = [{name for name in files if name.startswith("fit/")} for files in (before, after)]
    assert len(parts[1]) == 5
    assert len(parts[0] - parts[1]) == 1


def test_a_folder_far_away(bucket: str, logs: Path, tmp_path: Path) -> None:
    far = Store(f"{bucket}/tuesday")
    (logs / "rig.toml").write_text('[columns]\ndepth = { column = "depth", unit = "m" }\n')
    for path in logs.iterdir():
        far.write(path.name, path.read_bytes())
    job = Job("contact")
    items, _ = items_of([far.address])
    outcome = run(job, items, Store(f"{bucket}/frames"), runner("serial"))
    assert (list(outcome.done), outcome.aside) == ([f"poke_0_{i}.parquet" for i in range(5)], {})
    near = items_of([logs])[0]
    run(job, near, Store(str(tmp_path / "near")), runner("serial"))
    for here, there in zip(near, items):
        with Path(tmp_path / "near" / here.part("contact")).open("rb") as file:
            table = pq.read_table(file)
        (tmp_path / "copy.parquet").write_bytes(Store(f"{bucket}/frames").read(there.part("contact")))
        copy = pq.read_table(tmp_path / "copy.parquet")
        assert copy.column_names == table.column_names
        for name in table.column_names:
            np.testing.assert_array_equal(copy[name].to_numpy(), table[name].to_numpy())


def test_stores_of_something_else_are_refused(logs: Path, tmp_path: Path, processes: Runner) -> None:
    items, _ = items_of([logs])
    Store(str(tmp_path / "mine")).write("thesis.txt", b"")
    for job, where, by, said in (
        (FIT, "mine", runner("serial"), "an empty folder"),
        (FIT, "memory://x", processes, "other processes"),
    ):
        with pytest.raises(InputError, match=said):
            run(job, items, Store(where if "://" in where else str(tmp_path / where)), by)
    run(Job("contact"), items, Store(str(tmp_path / "frames")), runner("serial"))
    with pytest.raises(InputError, match="which holds"):
        run(FIT, items, Store(str(tmp_path / "frames")), runner("serial"))
    assert [p.name for p in (tmp_path / "mine").iterdir()] == ["thesis.txt"]
