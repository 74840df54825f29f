"""One model over many logs by a runner: what it says is what it says in one process."""

from __future__ import annotations

import json
import os
import signal
from pathlib import Path

import pytest
from batch.tasks import MODEL, write_logs

import kinid
from kinid.batch.logs import campaign_of, items_of
from kinid.batch.pooled import ByRunner
from kinid.batch.runners import Runner, runner
from kinid.batch.store import Store
from kinid.errors import InputError

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
