"""Whoever does the work: the same results, whatever happens to a worker."""

from __future__ import annotations

import os
import signal
import threading
import time
from pathlib import Path

import pytest
from batch import tasks

from kinid.batch.runners import Lost, Runner, in_order, named, runner
from kinid.batch.runners.processes import Processes
from kinid.errors import InputError

RUNNERS = ("serial", "processes", "dask")
APART = RUNNERS[1:]


@pytest.fixture
def by(request: pytest.FixtureRequest) -> Runner:
    """The runner of a name."""
    fixture = {"processes": "processes", "dask": "cluster"}.get(request.param)
    return runner("serial") if fixture is None else request.getfixturevalue(fixture)


def test_each_file_of_the_folder_is_a_runner() -> None:
    assert named() == sorted(RUNNERS)


@pytest.mark.parametrize("by", RUNNERS, indirect=True)
def test_results_come_in_the_order_of_items(by: Runner) -> None:
    assert in_order(by, tasks.square, range(40)) == [x * x for x in range(40)]
    assert in_order(by, tasks.square, []) == []


@pytest.mark.parametrize("by", RUNNERS, indirect=True)
def test_bad_data_is_put_aside_and_a_busy_server_asked_again(by: Runner, tmp_path: Path) -> None:
    found = in_order(by, tasks.refuses, range(4))
    assert [found[i] for i in (0, 1, 3)] == [0, 1, 3]
    assert isinstance(found[2], Lost)
    assert "expected any other number" in found[2].why
    assert in_order(by, tasks.stumbles, [(x, str(tmp_path / "busy")) for x in range(3)]) == [0, 1, 2]


@pytest.mark.parametrize("by", APART, indirect=True)
def test_a_worker_that_is_killed_changes_nothing(by: Runner, tmp_path: Path) -> None:
    assert in_order(by, tasks.killed_once, [(x, str(tmp_path / "mark")) for x in range(12)]) == list(range(12))
    assert (tmp_path / "mark").exists()


@pytest.mark.parametrize("by", APART, indirect=True)
def test_an_item_that_kills_its_workers_is_put_aside_alone(by: Runner) -> None:
    found = in_order(by, tasks.kills, range(8))
    assert [x for x in found if not isinstance(x, Lost)] == [0, 1, 2, 4, 5, 6, 7]
    assert isinstance(found[3], Lost)
    assert "died of it" in found[3].why


def test_the_cluster_is_seen_from_this_machine_alone(cluster: Runner) -> None:
    assert cluster.dashboard.startswith("http://127.0.0.1:")


@pytest.mark.parametrize(
    ("on", "workers", "said"),
    [("dusk", None, "did you mean 'dask'"), ("serial", 0, "0 workers"), ("tcp://127.0.0.1:1", None, "no scheduler")],
)
def test_what_there_is_not_is_refused(on: str, workers: int | None, said: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("kinid.batch.runners.dask.PATIENCE", 0.2)
    with pytest.raises(InputError, match=said):
        runner(on, workers)


@pytest.mark.skipif(not hasattr(signal, "pthread_sigmask"), reason="no signals are held back here")
def test_ctrl_c_while_workers_begin_is_not_theirs(capfd: pytest.CaptureFixture[str]) -> None:
    """A terminal sends it to all processes of a command, also to those that still load."""
    with runner("processes", 2) as made:
        assert isinstance(made, Processes)
        hit: list[int] = []

        def interrupt() -> None:
            for _ in range(10):
                for pid in made.pids():
                    os.kill(pid, signal.SIGINT)
                    hit.append(pid)
                time.sleep(0.02)

        thread = threading.Thread(target=interrupt)
        results = made.run(tasks.square, range(8))
        thread.start()
        assert dict(results) == {i: i * i for i in range(8)}
        thread.join()
        assert set(hit) == set(made.pids())
    assert capfd.readouterr().err == ""
