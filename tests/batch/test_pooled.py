"""One model over many logs by a runner: what it says is what it says in one process."""

from __future__ import annotations

import json
import os
import shutil
import signal
from collections.abc import Callable
from pathlib import Path

import pytest
from batch.tasks import MODEL, write_logs

import kinid
from kinid.batch.jobs import Job
from kinid.batch.logs import campaign_of, items_of
from kinid.batch.pooled import ByRunner, shelf_for
from kinid.batch.run import run as run_job
from kinid.batch.runners import Runner, runner
from kinid.batch.store import Store
from kinid.errors import InputError

Run = Callable[..., tuple[int, str, str]]
ASKED = kinid.Model(*MODEL)


@pytest.fixture(scope="module")
def logs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("pooled") / "logs"
    write_logs(folder, 3)
    (folder / "cut_off.parquet").write_bytes(b"PAR1")
    return folder


@pytest.fixture(scope="module")
def expected(logs: Path) -> kinid.CampaignDiagnosis:
    return kinid.Campaign([logs]).diagnose(ASKED, max_effects=0)


def by(made: Runner, logs: Path, store: Store | None = None) -> kinid.Campaign:
    items, sharing = items_of([logs])
    return campaign_of(items, sharing, ByRunner.of(made, store, items))


def test_a_diagnosis_by_processes_one_of_which_is_killed_is_the_same(
    logs: Path, processes: Runner, expected: kinid.CampaignDiagnosis
) -> None:
    found = by(processes, logs).diagnose(ASKED, max_effects=0, progress=Kills(processes))
    # all sums are made in one order: not to 1e-12 but to the last digit
    assert json.dumps(found.to_dict()) == json.dumps(expected.to_dict())
    assert list(found.before.put_aside) == ["cut_off.parquet"]


@pytest.mark.slow
def test_a_fit_by_a_cluster_whose_worker_is_killed_is_the_same(
    logs: Path, cluster: Runner, expected: kinid.CampaignDiagnosis, tmp_path: Path
) -> None:
    found = by(cluster, logs, Store(str(tmp_path))).fit(ASKED, progress=Kills(cluster))
    assert json.dumps(found.to_dict()) == json.dumps(expected.before.to_dict())


class Kills:
    """Kills a worker once, when the first log is fitted."""

    def __init__(self, runner: Runner) -> None:
        self.runner, self.done = runner, False

    def __call__(self, words: str) -> None:
        if not self.done:
            self.done = True
            os.kill(self.runner.pids()[0], signal.SIGKILL)  # type: ignore[attr-defined]


def test_it_goes_on_from_fits_that_are_kept(
    logs: Path, tmp_path: Path, expected: kinid.CampaignDiagnosis, monkeypatch: pytest.MonkeyPatch
) -> None:
    store = Store(str(tmp_path))
    by(runner("serial"), logs, store).fit(ASKED)
    assert len(store.files("own")) == 3

    def never(*_: object) -> None:
        raise AssertionError("fitted twice")

    monkeypatch.setattr("kinid.batch.pooled.begin_one", never)
    found = by(runner("serial"), logs, store).fit(ASKED)
    assert json.dumps(found.to_dict()) == json.dumps(expected.before.to_dict())
    # one that is broken is named
    store.write(f"own/{next(iter(store.files('own')))}", b"PK")
    found = by(runner("serial"), logs, store).fit(ASKED)
    assert sum("isn't whole" in why for why in found.put_aside.values()) == 1


def test_fits_of_single_logs_are_what_one_model_begins_from(
    logs: Path, tmp_path: Path, expected: kinid.CampaignDiagnosis, run: Run, monkeypatch: pytest.MonkeyPatch
) -> None:
    def never(*_: object) -> None:
        raise AssertionError("fitted twice")

    job = logs, "--model", ",".join(MODEL), "-o", tmp_path / "fits", "--on", "serial"
    assert run("fit", *job, "--each")[0] == 0
    assert len(Store(str(tmp_path / "fits")).files("own")) == 3
    monkeypatch.setattr("kinid.batch.pooled.begin_one", never)
    code, _, err = run("fit", *job, "--json", tmp_path / "pooled.json")
    assert code == 0, err
    found = json.loads((tmp_path / "pooled.json").read_text())
    assert found["logs"] == json.loads(json.dumps(expected.before.to_dict()))["logs"]
    # the shelf has gone, and the folder is still that of the fits
    assert not list((tmp_path / "fits").glob(".*"))
    assert run("fit", *job, "--each")[1].startswith("3 logs done, 3 of them before")
    # fits of another model don't serve
    code, _, err = run("fit", logs, "--model", "hooke", *job[3:])
    assert code == 2
    assert "'kelvin-voigt'" in err


def test_a_fit_of_a_log_that_has_changed_is_not_begun_from(logs: Path, tmp_path: Path) -> None:
    shutil.copytree(logs, tmp_path / "logs")
    store, job = Store(str(tmp_path / "fits")), Job("fit", ASKED.names)
    run_job(job, items_of([tmp_path / "logs"])[0], store, runner("serial"))
    before = set(store.files("own"))
    os.utime(tmp_path / "logs" / "poke_0_1.parquet", (1.0, 1.0))
    run_job(job, items_of([tmp_path / "logs"])[0], store, runner("serial"))
    after = set(store.files("own"))
    assert len(after) == 3
    assert len(after & before) == 2


@pytest.mark.parametrize("on", ["serial", "processes"])
def test_logs_are_read_once(
    on: str, logs: Path, tmp_path: Path, processes: Runner, expected: kinid.CampaignDiagnosis
) -> None:
    """Whoever fitted them may go, and so may the logs: all visits are of what was made of them."""
    shutil.copytree(logs, tmp_path / "logs")
    made, store = runner("serial") if on == "serial" else processes, Store(str(tmp_path / "kept"))

    def fitted(words: str) -> None:
        if words.startswith("fitting all"):
            shutil.rmtree(tmp_path / "logs")

    items, sharing = items_of([tmp_path / "logs"])
    with shelf_for(made, store) as shelf:
        found = campaign_of(items, sharing, ByRunner.of(made, store, items, shelf)).fit(ASKED, progress=fitted)
    assert json.dumps(found.to_dict()["parameters"]) == json.dumps(expected.before.to_dict()["parameters"])
    assert json.dumps(found.to_dict()["logs"]) == json.dumps(expected.before.to_dict()["logs"])


def test_a_log_that_is_gone_when_it_is_visited_is_one_line(logs: Path) -> None:
    class Loses(Runner):
        """Fits logs, and finds them no more."""

        gone = False

        def run(self, do, items):  # type: ignore[no-untyped-def]
            todo, self.gone = (_gone if self.gone else do), True
            return runner("serial").run(todo, items)

    with pytest.raises(InputError, match="lost on the way"):
        by(Loses(), logs).fit(ASKED)


def _gone(item: object) -> None:
    raise InputError("no log", "a log", "bring it back")
