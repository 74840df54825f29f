"""`kinid live` from the command line, and what is made of its recording."""

from __future__ import annotations

import errno
import json
import os
import time
from collections.abc import Callable
from pathlib import Path

import pytest
from live.recordings import messages

from kinid.mapping.property_map import PropertyMap
from kinid.writers import alone_with

Run = Callable[..., tuple[int, str, str]]


def test_a_log_is_watched_recorded_and_read_again(run: Run, log: Path) -> None:
    record, summary = log.parent / "out.mcap", log.parent / "out.json"
    code, out, err = run(
        *("live", log, "--model", "kelvin-voigt,coulomb-friction", "--speed", 0, "--tare", 2),
        *("--record", record, "--json", summary),
    )
    assert code == 0, err
    assert "touch at" in out
    assert "7500 samples over 15 s" in out
    facts = json.loads(summary.read_text())
    assert facts["events"]["touch"] == 1
    assert facts["list"][0]["kind"] == "touch"
    assert facts["estimates"]["normal"]["values"]["stiffness"] == pytest.approx(732, rel=0.02)
    assert facts["estimates"]["friction"]["values"]["friction"] == pytest.approx(0.45, rel=0.2)
    code, out, err = run("contact", record, "-o", log.parent / "contact.parquet")
    assert code == 0, err
    assert "1 touches" in out


def test_a_map_grows_and_foxglove_may_look(run: Run, log: Path) -> None:
    grown = log.parent / "map.parquet"
    args = ("live", log, "--model", "kelvin-voigt", "--speed", 0, "--tare", 2, "--quiet", "--map", grown)
    code, out, err = run(*args, "--serve", "--port", 0)
    assert code == 0, err
    assert "ws://127.0.0.1:" in out
    assert Path(out.split("layout ")[1].splitlines()[0]).is_file()
    first = PropertyMap.read(grown)
    assert len(first) >= 1
    code, _, err = run("live", log, "--model", "coulomb-friction", "--speed", 0, "--map", grown)
    assert code == 2
    assert "another file" in err
    assert len(PropertyMap.read(grown)) == len(first)


def test_a_recording_alone_is_replayed_to_the_same_values(run: Run, log: Path) -> None:
    """With its own rig, and with the starts that a map gave, which has grown since."""
    grown, alone = log.parent / "map.parquet", log.parent / "elsewhere"
    alone.mkdir()
    record, summary = alone / "out.mcap", log.parent / "out.json"
    args = ("--model", "kelvin-voigt,coulomb-friction", "--speed", 0, "--quiet", "--json", summary)
    facts = []
    for source in (
        (log, "--tare", 2, "--map", grown),
        (log, "--tare", 2, "--map", grown, "--record", record),
        (record,),
    ):
        code, _, err = run("live", *source, *args)
        assert code == 0, err
        facts.append(json.loads(summary.read_text()))
    _, live, again = facts
    assert live["events"]["warm-start"] >= 1
    for name in ("events", "list", "estimates", "samples"):
        assert again[name] == live[name]
    # a rig that is named counts, also where there is none
    code, _, err = run("live", record, "--rig", log.parent / "none.toml", *args)
    assert code == 2
    assert "none.toml" in err


def test_a_recording_of_a_live_source_is_logged_by_the_clock_of_other_recordings(run: Run, log: Path) -> None:
    """Unix time: the robot's own bag can be laid beside it. Stamps are the sender's."""
    record, begun = log.parent / "out.mcap", time.time_ns()
    code, _, err = run(
        *("live", log, "--model", "kelvin-voigt", "--duration", 0.3, "--quiet", "--record", record),
    )
    assert code == 0, err
    times = [m[2] for m in messages(record)]
    assert len(times) > 300
    assert begun - 10**9 < min(times) <= max(times) < time.time_ns() + 10**9


def test_quiet_and_a_duration(run: Run, log: Path) -> None:
    code, out, _ = run("live", log, "--model", "kelvin-voigt", "--speed", 0, "--quiet", "--duration", 6)
    assert code == 0
    assert "touch at" not in out
    assert "over 6" in out
    assert "no bias" in out  # the rig states none, and nobody asked for a tare


@pytest.mark.parametrize(
    ("args", "words"),
    [
        (("--model", "relaxation"), "relaxation"),
        (("--model", "kelvin-voigt", "--speed", -1), "speed"),
        (("--model", "kelvin-voigt", "--tare", "-1"), "--tare"),
        (("--model", "kelvin-voigt", "--tare", "nan"), "--tare"),
        (("--model", "kelvin-voigt", "--duration", 0), "--duration"),
        (("--model", "kelvin-voigt", "--bandwidth", 0), "--bandwidth"),
        (("--model", "kelvin-voigt", "--bandwidth", 1001), "1000 Hz at most"),
        (("--model", "kelvin-voigt", "--speed", 0, "--quiet", "--bandwidth", 300), "250 Hz"),
        (("--model", "kelvin-voigt", "--port", 8765), "without --serve"),
        (("--model", "kelvin-voigt", "--record", "x.txt"), ".mcap"),
        (("--model", "kelvin-voigt", "--map", "x.txt"), ".parquet"),
        (("--model", "kelvin-voigt", "--map", "no/x.parquet"), "no folder"),
        (("--model", "kelvin-voigt", "--serve", "--port", -1), "--port"),
        (("--model", "kelvin-voigt", "--record", "no/x.mcap"), "no folder"),
    ],
)
def test_wrong_use_is_one_line(run: Run, log: Path, args: tuple[object, ...], words: str) -> None:
    code, _, err = run("live", log, *args)
    assert code == 2
    assert err.count("\n") == 1
    assert words in err


@pytest.mark.parametrize(
    ("seconds", "words"), [(100, "nothing came after 15 s"), (9, "the tool was near the surface from")]
)
def test_a_bias_of_less_than_was_asked_for_is_told(run: Run, log: Path, seconds: float, words: str) -> None:
    args = ("--model", "kelvin-voigt", "--speed", 0, "--quiet", "--duration", 1, "--tare")
    code, out, err = run("live", log, *args, seconds)
    assert code == 0, err
    assert f"--tare {seconds}: {words}" in out
    assert "--tare" not in run("live", log, *args, 2)[1]


def test_sources_without_a_rig(run: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    for source in ("udp://127.0.0.1:0", "shm:nothing", "log.parquet"):
        code, _, err = run("live", source, "--model", "kelvin-voigt")
        assert code == 2, source
        assert "rig" in err


def test_a_session_in_which_nothing_came_is_no_success(run: Run, log: Path, refused: Callable[..., None]) -> None:
    summary = log.parent / "out.json"
    args = ("--rig", log.parent / "rig.toml", "--model", "kelvin-voigt", "--duration", 0.1, "--json", summary)
    refused(run("live", "udp://127.0.0.1:0", *args), "nothing from udp://127.0.0.1", "begin the sender first")
    assert json.loads(summary.read_text())["events"]["stream-lost"] == 2


@pytest.mark.skipif(not Path("/proc/self").is_dir(), reason="a folder that not even root may write to is needed")
@pytest.mark.parametrize("option", [("--json", "x.json"), ("--record", "x.mcap"), ("--map", "x.parquet")])
def test_a_file_that_cannot_be_written_is_refused_before_anything_is_done(
    run: Run, log: Path, refused: Callable[..., None], option: tuple[str, str]
) -> None:
    result = run("live", log, "--model", "kelvin-voigt", "--speed", 0, option[0], f"/proc/{option[1]}")
    refused(result, f"no way to write /proc/{option[1]}")
    assert "samples" not in result[1]


@pytest.mark.parametrize("room", [20_000, 500_000])
def test_a_recording_that_ends_early_is_no_success(
    run: Run, log: Path, monkeypatch: pytest.MonkeyPatch, refused: Callable[..., None], room: int
) -> None:
    record, write = log.parent / "out.mcap", os.pwrite

    def into_little_room(file: int, data: bytes, at: int) -> int:
        if at + len(data) > room:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        return write(file, data, at)

    monkeypatch.setattr(os, "pwrite", into_little_room)
    result = run("live", log, "--model", "kelvin-voigt", "--speed", 0, "--quiet", "--record", record)
    refused(result, "No space left", f"what came before is in {record}")
    found = messages(record)
    said = float(result[2].split("holds the first ")[1].split(" s")[0])
    assert said == pytest.approx(1e-9 * (max(m[1] for m in found) - found[0][1]) if found else 0.0, abs=6e-3)
    assert "wrote" not in result[1]


def test_a_recording_that_another_process_writes_is_left_alone(
    run: Run, log: Path, refused: Callable[..., None]
) -> None:
    record = log.parent / "out.mcap"
    with alone_with(record):
        refused(
            run("live", log, "--model", "kelvin-voigt", "--speed", 0, "--record", record), "another process at work"
        )
    assert not record.exists()
