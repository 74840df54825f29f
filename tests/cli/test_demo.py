"""`kinid demo`: one command that tells the whole story, can be stopped, and spoils nobody's folder."""

from __future__ import annotations

import json
import signal
import subprocess
import sys
import time
import webbrowser
from collections.abc import Callable
from pathlib import Path

import pyarrow.parquet as pq
import pytest
from headless import CHROMIUM, complaints, needs_chromium

from kinid.cli import demo as demo_module
from kinid.cli.demo import LWR4PLUS_MOTION

Run = Callable[..., tuple[int, str, str]]
Refused = Callable[..., None]


@needs_chromium
def test_negative_control_of_the_browser(tmp_path: Path) -> None:
    """What is asked of the pages below can fail."""
    (tmp_path / "bad.html").write_text("<!doctype html><body><script>nowhere()</script></body>")
    good = '<!doctype html><link rel="icon" href="data:,"><body><script>console.log(1)</script></body>'
    (tmp_path / "good.html").write_text(good)
    assert any("nowhere" in line for line in complaints(tmp_path / "bad.html", tmp_path / "a"))
    assert complaints(tmp_path / "good.html", tmp_path / "b") == []


def test_the_whole_story(run: Run, refused: Refused, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    out, opened = tmp_path / "out", []
    monkeypatch.setattr(webbrowser, "open", opened.append)
    code, said, err = run("demo", "-o", out, "--real", tmp_path / "none", "--json", tmp_path / "summary.json", "--open")
    assert code == 0, err
    assert "\x1b[" not in said, "colours where the output is piped"
    # what it found, by its own files: the effect that was hidden, its size within a fifth, and the error down to twice
    # the noise
    summary = json.loads((tmp_path / "summary.json").read_text())
    found, truth = (
        json.loads((out / "found.json").read_text()),
        json.loads((out / "truth" / "log.json").read_text())["hidden"],
    )
    assert summary["added"] == found["added"] == [truth["effect"]] == ["relaxation"]
    for name, value in truth["parameters"].items():
        assert summary["parameters"]["relaxation"][name] == pytest.approx(value, rel=0.2)
    assert summary["error"]["after"] < 2 * summary["error"]["noise_floor"] < summary["error"]["before"]
    assert "fails" in said
    assert f"{summary['error']['before']:.3g} → {summary['error']['after']:.3g}" in said
    # every command it shows names files that are there, and every file that it names is there
    shown = [line for line in said.splitlines() if line.startswith("$ kinid ")]
    assert [line.split()[2] for line in shown] == [
        "lab",
        "contact",
        "fit",
        "compare",
        "diagnose",
        "lab",
        "map",
        "view",
        "view",
    ]
    for path in summary["files"].values():
        assert Path(path).stat().st_size > 1e5
        assert path in said
    assert opened == [Path(summary["files"][name]).resolve().as_uri() for name in ("report", "scene")]
    # every page opens in a browser that has no network, wide and narrow, without a complaint
    for name in ("report", "scene", "map scene", "map", "contact frame") if CHROMIUM is not None else ():
        assert complaints(Path(summary["files"][name]), tmp_path / "browser") == [], name
    if CHROMIUM is not None:
        assert complaints(Path(summary["files"]["report"]), tmp_path / "browser", "400,800") == []
    # the end says what was found and where to look
    last = said.strip().splitlines()[-3:]
    assert "relaxation" in last[0]
    assert last[1].startswith("the truth: relaxation")
    assert last[1].endswith("; found")
    assert "report.html" in last[2]
    # nothing unfinished is left, and another demo doesn't replace this one
    assert not list(out.rglob(".*"))
    before = (out / "log.parquet").read_bytes()
    refused(run("demo", "-o", out, "--seed", 6), "another experiment")
    assert (out / "log.parquet").read_bytes() == before


@pytest.mark.real
def test_the_measured_arm(run: Run, tmp_path: Path, real_data: Path) -> None:
    (tmp_path / "rig.toml").write_text(LWR4PLUS_MOTION)
    code, said, err = run(
        "contact",
        real_data / "lwr4plus-motion" / "measurements_1.npz",
        "--rig",
        tmp_path / "rig.toml",
        "--plot",
        tmp_path / "arm.html",
    )
    assert code == 0, err
    assert (tmp_path / "arm.html").stat().st_size > 1e6
    assert "joint_7" in said


def test_stopped_by_the_user(tmp_path: Path) -> None:
    """Ctrl-C ends in code 130 and one line; what is there is whole, and the next run takes it for its own."""
    out = tmp_path / "out"
    command = [
        sys.executable,
        "-c",
        "import signal; signal.signal(signal.SIGINT, signal.default_int_handler)\nfrom kinid.cli import main; main()",
        "demo",
        "-o",
        str(out),
        "--real",
        str(tmp_path),
    ]
    demo = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    until = time.monotonic() + 120
    while not (out / "log.parquet").is_file() and time.monotonic() < until:
        time.sleep(0.02)
    demo.send_signal(signal.SIGINT)
    _, err = demo.communicate(timeout=120)
    assert demo.returncode == 130
    assert err == "kinid: stopped; nothing was left half-written\n"
    assert not [path for path in out.rglob(".*") if path.is_file()]
    demo_module._claim(out, json.loads((out / "demo.json").read_text()))
    for path in out.rglob("*.parquet"):
        pq.read_table(path)


def test_a_folder_with_another_experiment_is_refused(run: Run, refused: Refused, tmp_path: Path) -> None:
    (tmp_path / "log.parquet").write_text("mine")
    refused(run("demo", "-o", tmp_path), "another experiment")
    assert [path.name for path in tmp_path.iterdir()] == ["log.parquet"]
    (tmp_path / "file").write_text("")
    refused(run("demo", "-o", tmp_path / "file"))


@pytest.mark.parametrize(
    ("added", "ending"),
    [
        (["relaxation"], "; found"),
        ([], "; not found"),
        (["relaxation", "hysteresis"], "; found; hysteresis is not there"),
        (["adhesion", "hysteresis"], "; not found; adhesion and hysteresis are not there"),
    ],
)
def test_the_end_admits_what_went_wrong(added: list[str], ending: str) -> None:
    class Teller:
        def __init__(self) -> None:
            self.lines: list[str] = []

        def say(self, line: str, **_: object) -> None:
            self.lines.append(line)

    tell = Teller()
    facts = {
        "error": {"before": 1.0, "after": 0.5, "noise_floor": 0.4, "unit": "N"},
        "files": {"report": "r", "scene": "s"},
    }
    truth = {"effect": "relaxation", "parameters": {"ratio": 0.3}}
    demo_module._farewell(tell, facts | {"truth": truth, "added": added, "parameters": {}, "seconds": 3.0})  # type: ignore[arg-type]
    assert tell.lines[-2].endswith(ending)
