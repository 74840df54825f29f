"""`--on`, `--each` and `kinid watch`: what they print, write and refuse."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import pytest
from batch.tasks import MODEL, write_logs
from scripted import scripted_poke

WITH = ("--model", ",".join(MODEL))
Run = Callable[..., tuple[int, str, str]]


@pytest.fixture
def logs(tmp_path: Path) -> Path:
    write_logs(tmp_path / "logs", 2)
    return tmp_path / "logs"


def test_each_log_by_itself(run: Run, logs: Path, tmp_path: Path) -> None:
    for command, *words in (("contact",), ("fit", *WITH, "--each"), ("diagnose", *WITH, "--each", "--max-effects", 0)):
        out = tmp_path / command
        code, said, err = run(command, logs, *words, "-o", out, "--json", tmp_path / "said.json")
        assert (code, err) == (0, "")
        assert "2 logs done; 0 put aside" in said
        assert json.loads((out / "manifest.json").read_text())["job"]["kind"] == command
        assert len(json.loads((tmp_path / "said.json").read_text())["done"]) == 2
        code, said, _ = run(command, logs, *words, "-o", out)
        assert "2 logs done, 2 of them before" in said


def test_one_model_is_the_same_by_a_runner(run: Run, logs: Path, tmp_path: Path) -> None:
    facts = []
    for words in ((), ("--on", "serial", "-o", tmp_path / "kept")):
        code, _, err = run("fit", logs, *WITH, "--json", tmp_path / "fit.json", *words)
        assert code == 0, err
        facts.append((tmp_path / "fit.json").read_text())
    assert facts[0] == facts[1]


def test_a_map_is_the_same_far_away(run: Run, tmp_path: Path, bucket: str) -> None:
    from kinid.batch.store import Store

    log = scripted_poke(seed=5).write(tmp_path)
    for path in (log, log.parent / "rig.toml"):
        Store(f"{bucket}/mould").write(path.name, path.read_bytes())
    values = []
    for place in (log, f"{bucket}/mould"):
        words = ("--json", tmp_path / "map.json", "--on", "serial")
        code, _, err = run("map", place, "-o", tmp_path / "out.parquet", "--anew", *words)
        assert code == 0, err
        values.append(json.loads((tmp_path / "map.json").read_text())["properties"])
    assert values[0] == values[1]


def test_a_watch_ends_when_nothing_comes(run: Run, logs: Path) -> None:
    facts = logs.parent / "watch.json"
    code, said, err = run("watch", logs, *WITH, "--every", 0.05, "--idle", 0, "--json", facts)
    assert code == 0, err
    assert "0 logs known" in said
    assert said.count("the noise is 0.0") == 2
    assert (logs / ".kinid" / "watch.html").is_file()
    found = json.loads(facts.read_text())
    assert list(found["logs"]) == ["poke_0_0.parquet", "poke_0_1.parquet"]
    assert (found["odd"], found["put_aside"]) == ({}, {})


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("contact", "logs"), "without -o"),
        (("contact", "logs", "-o", "logs/frames"), "inside of logs"),
        (("contact", "logs", "-o", "frames", "--plot", "a.html"), "options of one log"),
        (("contact", "logs", "-o", "frames", "--on", "dusk"), "did you mean"),
        (("fit", "logs", *WITH, "--each", "-o", "fits", "--plot", "a.html"), "with --each"),
        (("fit", "logs", *WITH, "--on", "serial", "--workers", 0), "0 workers"),
        (("watch", "nowhere", *WITH), "no folder nowhere"),
        (("watch", "logs", *WITH, "--every", 0), "--every 0"),
        (("watch", "logs", *WITH, "-o", "logs/out"), "inside of logs"),
    ],
)
def test_what_is_wrong_is_one_line(
    run: Run, logs: Path, monkeypatch: pytest.MonkeyPatch, words: tuple[object, ...], said: str
) -> None:
    monkeypatch.chdir(logs.parent)
    code, _, err = run(*words)
    assert code == 2, err
    assert said in err
    assert err.count("\n") == 1
    assert [path.name for path in logs.parent.iterdir()] == ["logs"]


def test_logs_none_of_which_can_be_used_are_no_success(
    run: Run, logs: Path, tmp_path: Path, refused: Callable[..., None]
) -> None:
    for log in logs.glob("*.parquet"):
        log.write_bytes(log.read_bytes()[:1000])
    result = run("contact", logs, "-o", tmp_path / "out")
    refused(result, "2 logs, none of which could be used")
    assert "0 logs done; 2 put aside" in result[1]
