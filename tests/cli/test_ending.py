"""However a command ends: one line on stderr, an exit code that says which way, nothing half-written."""

from __future__ import annotations

import json
import os
import re
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

import kinid.cli

#: a shell that starts jobs in the background makes them ignore Ctrl-C
WITH_SIGINT = "import signal; signal.signal(signal.SIGINT, signal.default_int_handler)\n"
SHIM = "from kinid.cli import main; main()"


def test_an_error_that_was_not_foreseen_is_one_line_and_a_file(run, monkeypatch, tmp_path):
    monkeypatch.setenv("TMPDIR", str(tmp_path))
    monkeypatch.setattr("tempfile.tempdir", None)

    def broken(*_args, **_options):
        raise ZeroDivisionError("something that\nnobody thought of")

    monkeypatch.setattr(kinid.cli, "app", broken)
    code, out, err = run("doctor")
    assert code == 70
    assert out == ""
    assert err.count("\n") == 1
    assert "ZeroDivisionError: something that nobody thought of" in err
    assert "please report" in err
    report = Path(re.search(r"\S+kinid-error-\S+\.txt", err)[0].rstrip(";,"))
    text = report.read_text(encoding="utf-8")
    assert "Traceback" in text
    assert "kinid doctor" in text
    assert report.stat().st_mode & 0o077 == 0  # it may hold names of the user's files


@pytest.mark.parametrize("after", [0.15, 0.4])
def test_ctrl_c_while_modules_are_loaded_shows_no_traceback(after: float) -> None:
    code = WITH_SIGINT + "import sys; sys.argv = ['kinid', 'doctor']; from kinid.__main__ import run\n"
    code += "print('ready', flush=True); run()"
    with subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE, stderr=subprocess.PIPE) as running:
        assert running.stdout is not None
        assert running.stdout.readline() == b"ready\n"
        time.sleep(after)
        running.send_signal(signal.SIGINT)
        _, said = running.communicate(timeout=60)
    assert b"Traceback" not in said
    assert running.returncode in (0, 130)


@pytest.mark.parametrize("text", ["[" * 100_000, '{"a":' * 100_000, "1" + "0" * 5000])
def test_json_that_is_nested_or_long_beyond_measure_is_bad_input(run, log, text):
    (log.parent / "fit.json").write_text(text, encoding="utf-8")
    code, _, err = run(
        "plan",
        "excite",
        "--rig",
        log.parent / "rig.toml",
        "--model",
        "hooke",
        "--fit",
        log.parent / "fit.json",
        "-o",
        log.parent / "best.parquet",
    )
    assert code == 2, err
    assert err.count("\n") == 1


def test_toml_that_is_nested_beyond_measure_is_bad_input(run, log):
    (log.parent / "rig.toml").write_text("a = " + "[" * 50_000, encoding="utf-8")
    code, _, err = run("fit", log, "--model", "hooke")
    assert code == 2, err
    assert err.count("\n") == 1


@pytest.mark.parametrize("name", ["/dev/zero", "large.toml"])
def test_a_rig_without_end_is_not_read(run, log, name):
    large = log.parent / "large.toml"
    large.write_bytes(b"# " + b"x" * 3_000_000 + b"\n")
    rig = large if name == "large.toml" else Path(name)
    started = time.monotonic()
    code, _, err = run("fit", log, "--rig", rig, "--model", "hooke")
    assert code == 2
    assert "expected" in err
    # it is refused before it is read: 8 GB took minutes
    assert time.monotonic() - started < 20


def test_more_memory_than_there_is_is_said(run, monkeypatch):
    def hungry(*_args, **_options):
        raise MemoryError

    monkeypatch.setattr(kinid.cli, "app", hungry)
    code, _, err = run("doctor")
    assert code == 2
    assert "memory" in err
    assert err.count("\n") == 1


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_stops_it_in_one_line(number, log):
    """While a plan is made, which takes seconds; a plan that was there stays as it was."""
    out = log.parent / "best.parquet"
    out.write_bytes(b"as it was")
    words = [
        "plan",
        "excite",
        "--rig",
        log.parent / "rig.toml",
        "--model",
        "kelvin-voigt",
        "--force-limit",
        "8",
        "-o",
        out,
    ]
    child = subprocess.Popen(
        [sys.executable, "-c", WITH_SIGINT + SHIM, *map(str, words)],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    assert child.stdout is not None
    child.stdout.readline()  # it says that it begins
    child.send_signal(number)
    _, err = child.communicate(timeout=60)
    assert child.returncode == 130
    assert err == "kinid: stopped; nothing was left half-written\n"
    assert out.read_bytes() == b"as it was"
    assert [path.name for path in log.parent.iterdir() if path.name.startswith(".")] == []


def ends(words: list[object], out: object, **environment: str) -> tuple[int, bytes]:
    """Exit code and stderr of a command line whose stdout is `out`."""
    done = subprocess.run(
        [sys.executable, "-c", SHIM, *map(str, words)],
        stdout=out,
        stderr=subprocess.PIPE,
        env=os.environ | environment,
        check=False,
    )
    return done.returncode, done.stderr


PRINTS = [["diagnose", "--explain", "all"], ["diagnose", "--help"]]  # by rich, and by typer


@pytest.mark.parametrize("words", PRINTS)
def test_a_pipe_whose_reader_has_gone_says_nothing(words):
    read, write = os.pipe()
    os.close(read)
    with os.fdopen(write, "wb") as out:
        assert ends(words, out) == (141, b"")


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="a device of Linux")
def test_an_output_without_room_is_said():
    with Path("/dev/full").open("wb") as out:
        code, err = ends(["diagnose", "--help"], out)
    assert code == 2
    assert err.count(b"\n") == 1
    assert b"No space left" in err


def test_an_output_that_lacks_signs_gets_others(tmp_path):
    with (tmp_path / "said.txt").open("wb") as out:
        assert ends(["diagnose", "--explain", "hooke"], out, PYTHONIOENCODING="ascii") == (0, b"")
    assert b"N/m" in (tmp_path / "said.txt").read_bytes()
    assert (tmp_path / "said.txt").read_bytes().isascii()


def test_streams_that_are_closed_are_none_to_stumble_over(tmp_path):
    script = f"import os, sys; os.close(0); os.close(1); os.execv(sys.executable, [sys.executable, '-c', {SHIM!r}, "
    done = subprocess.run(
        [sys.executable, "-c", script + "'diagnose', '--explain', 'hooke'])"], stderr=subprocess.PIPE, check=False
    )
    assert (done.returncode, done.stderr) == (0, b"")


def test_a_process_of_its_own_leaves_without_the_interpreters_end():
    """What was registered for the exit is done, the rest isn't: threads that still begin would abort it."""
    script = """
import atexit, sys
from kinid.__main__ import run
class Late:
    def __del__(self): print("taken apart")
late = Late()
sys.argv = ["kinid", "diagnose", "--explain", "nonsense"]
import kinid.cli
inside = kinid.cli.app
def app(*words, **options):
    atexit.register(print, "at exit, within")
    return inside(*words, **options)
kinid.cli.app = app
run()
"""
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=False)
    assert done.returncode == 2
    assert done.stderr.startswith("kinid: found effect 'nonsense'")
    assert done.stdout == "at exit, within\n"


def test_a_library_that_ends_the_program_is_not_foreseen(run, monkeypatch, tmp_path):
    """Nor is it a success, whatever code it names."""
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    monkeypatch.setattr(kinid.cli, "app", lambda *_a, **_k: sys.exit(0))
    code, _, err = run("doctor")
    assert code == 70
    assert "SystemExit: 0" in err


def test_patches_beyond_number_are_refused_before_any_is_made(run, log, tmp_path):
    code, _, err = run("map", log, "-o", tmp_path / "m.parquet", "--export", tmp_path / "w", "--cell", "1e-9")
    assert code == 2
    assert "patches" in err
    assert not (tmp_path / "w").exists()


def test_the_report_of_an_error_is_named_in_json_free_words(run, monkeypatch, tmp_path):
    """Words of the error that hold braces or newlines stay on the one line."""
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    monkeypatch.setattr(kinid.cli, "app", lambda *_a, **_k: json.loads("{}")["a\nb"])
    code, _, err = run("doctor")
    assert code == 70
    assert err.count("\n") == 1


def test_a_name_that_the_system_refuses_is_bad_input(run, tmp_path):
    for name in ("x" * 300, "x" * 5000):  # advice looks at the words of a command line, too
        code, _, err = run("compare", name, name, "--model", "hooke")
        assert code == 2
        assert err.count("\n") == 1
    code, _, err = run("contact", tmp_path / ("x" * 300))
    assert code == 2
    assert "File name too long" in err
    assert err.count("\n") == 1
    (tmp_path / "ring.toml").symlink_to("ring.toml")
    (tmp_path / "a.csv").write_text("t,q1\n0,1\n1,2\n", encoding="utf-8")
    code, _, err = run("contact", tmp_path / "a.csv", "--rig", tmp_path / "ring.toml", "-o", tmp_path / "o.parquet")
    assert code == 2
    assert "Too many levels of symbolic links" in err


def test_a_working_folder_that_has_been_removed_is_bad_input(run, tmp_path, monkeypatch, refused):
    folder = tmp_path / "gone"
    folder.mkdir()
    monkeypatch.chdir(folder)
    folder.rmdir()
    refused(run("contact", "log.parquet"), "no working folder")


@pytest.mark.parametrize("threads", ["0", "x", "-1", "1.5", ""])
def test_a_number_of_threads_that_is_none_is_bad_input(run, log, monkeypatch, refused, threads):
    monkeypatch.setenv("NUMBA_NUM_THREADS", threads)
    refused(run("contact", log), f"NUMBA_NUM_THREADS={threads}")
