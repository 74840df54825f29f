"""What is written is true: commands and code in the pages run, links resolve, the example of an effect works, the site
builds.
"""

from __future__ import annotations

import io
import re
import shlex
import subprocess
import sys
from collections.abc import Iterator
from contextlib import redirect_stdout
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

import numpy as np
import pytest
from headless import CHROMIUM, complaints

ROOT = Path(__file__).parent.parent
PAGES = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", ROOT / "CHANGELOG.md", *sorted((ROOT / "docs").rglob("*.md"))]
RUN = [page for page in PAGES if page.name != "CHANGELOG.md"]
named = pytest.mark.parametrize("page", RUN, ids=lambda page: str(page.relative_to(ROOT)))


def fences(page: Path, *languages: str) -> Iterator[str]:
    """Fenced blocks of some languages."""
    text = page.read_text(encoding="utf-8")
    for language, body in re.findall(r"^```([\w-]+)[^\n]*\n(.*?)^```", text, re.DOTALL | re.MULTILINE):
        if language in languages:
            yield body


def slugs(page: Path) -> set[str]:
    """Anchors of a page's headings, as GitHub and the site make them."""
    text = re.sub(r"^```.*?^```", "", page.read_text(encoding="utf-8"), flags=re.DOTALL | re.MULTILINE)
    heads = re.findall(r"^#+ +(.+?) *$", text, re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", head.lower()).replace(" ", "-") for head in heads}


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_links_resolve(page: Path) -> None:
    text = re.sub(r"^```.*?^```", "", page.read_text(encoding="utf-8"), flags=re.DOTALL | re.MULTILINE)
    for target in re.findall(r"!?\[[^\]]*\]\(([^)\s]+)\)", re.sub(r"`[^`]*`", "", text)):
        parts = urlsplit(target)
        if parts.scheme:
            assert parts.scheme == "https", target
            assert re.fullmatch(r"[\w-]+(\.[\w-]+)+", parts.netloc), target
            continue
        there = page if not parts.path else (page.parent / parts.path).resolve()
        assert there.is_relative_to(ROOT), target
        assert there.exists(), f"{page.name}: {target} leads nowhere"
        if parts.fragment:
            assert parts.fragment in slugs(there), f"{page.name}: no heading {parts.fragment} in {there.name}"


def commands(page: Path) -> list[list[str]]:
    """What a page tells to type, without remarks and prompts; what a command prints stands in blocks without a
    language.
    """
    out = []
    for body in fences(page, "sh", "console", "bash"):
        for line in re.sub(r"\\\n\s*", " ", body).splitlines():
            words = shlex.split(line.removeprefix("$ "), comments=True)
            if words:
                out.append(words)
    return out


@pytest.fixture(scope="module")
def desk(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder as a reader has it: a log as poke.csv and poke.parquet with its rig, and a picture of a mould."""
    import pyarrow.parquet as pq
    from pyarrow import csv
    from scripted import scripted_poke

    folder = tmp_path_factory.mktemp("desk")
    log = scripted_poke(seed=5).write(folder)
    csv.write_csv(pq.read_table(log), folder / "poke.csv")
    log.rename(folder / "poke.parquet")
    return folder


def quick(words: list[str]) -> list[str]:
    """The same with fewer pokes, and without a server that nobody would stop."""
    words = ["2x2" if word == "10x10" else word for word in words]
    if words[:2] == ["kinid", "view"] and "--record" not in words:
        words += ["--record", "seen.html"]
    return [word for word in words if word != "--open"]


@pytest.fixture
def own_catalogue(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """Folders of effects that commands are given don't outlast them."""
    from kinid.effects import catalogue

    monkeypatch.setenv("KINID_EFFECTS", "")
    yield
    monkeypatch.undo()
    catalogue.cache_clear()


@pytest.mark.parametrize("page", RUN[1:], ids=lambda page: str(page.relative_to(ROOT)))  # README's: test_readme.py
@pytest.mark.usefixtures("own_catalogue")
def test_commands_run(
    page: Path, desk: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    from kinid.cli import main
    from kinid.lab import teleoperation_study

    for name, fewer in (("DELAYS", (0.1,)), ("STIFFNESSES", (1853.0,))):
        monkeypatch.setattr(teleoperation_study, name, fewer)
    monkeypatch.chdir(desk)
    targets = set(re.findall(r"^(\w+):", (ROOT / "Makefile").read_text(), re.MULTILINE))
    for words in map(quick, commands(page)):
        if words[0] == "make":
            assert {word for word in words[1:] if "=" not in word} <= targets, words
        elif words[:2] == ["pip", "install"]:
            assert re.fullmatch(r"(-e )?\.(\[[\w,]+\])?", " ".join(words[2:])), words
        else:
            assert words[0] == "kinid", f"{page.name} tells to run {words[0]}, which this test doesn't know"
            if words[1] in ("demo", "--version", "--install-completion"):  # the demo has a test of its own
                continue
            monkeypatch.setattr(sys, "argv", words)
            with pytest.raises(SystemExit) as stop:
                main()
            assert not stop.value.code, f"{shlex.join(words)}: {capsys.readouterr().err}"


@named
def test_code_runs(page: Path, desk: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(desk)
    import kinid

    rig = kinid.Rig.load(desk / "rig.toml")
    log = kinid.read(desk / "poke.csv", rig)
    assert log.q is not None
    assert log.wrench is not None
    names: dict[str, Any] = {"t": log.t[0], "q": log.q[0], "wrench": log.wrench[0], "rig": rig, "kinid": kinid}
    for block in fences(page, "python"):
        if "class " in block:  # the example of an effect: see below
            continue
        with redirect_stdout(io.StringIO()):
            exec(compile(block, str(page), "exec"), names)


@named
def test_rigs_are_valid(page: Path) -> None:
    import kinid

    for block in fences(page, "toml"):
        kinid.Rig.parse_text(block)


def test_an_effect_is_one_file(tmp_path: Path) -> None:
    """The effect in CONTRIBUTING.md, written to a file: explained, fitted, and found where a log hides it."""
    folder = tmp_path / "effects"
    folder.mkdir()
    # under a name of its own, so that a tree may hold that of the page
    text = next(iter(fences(ROOT / "CONTRIBUTING.md", "python"))).replace("quadratic-damping", "law-of-a-page")
    (folder / "law_of_a_page.py").write_text(text)
    # a log of a material tester from equations of its own: 900 N/m, and 260 N s2/m2 that the model asked about doesn't
    # have
    t = np.arange(0, 30, 0.004)
    swing = 1e-3 * (3.0 * np.sin(2 * np.pi * 0.7 * t) + 1.2 * np.sin(2 * np.pi * 3.1 * t + 1.0)) * (t % 10 > 3)
    depth = 6e-3 + np.convolve(swing, np.hanning(41) / np.hanning(41).sum(), "same")
    rate = np.gradient(depth, t)
    force = 900.0 * depth + 260.0 * np.sign(rate) * rate**2
    rng = np.random.default_rng(4)
    np.savez(
        tmp_path / "tester.npz",
        t=t,
        depth=depth,
        depth_rate=rate,
        normal_force=force + rng.normal(scale=0.02, size=t.size),
    )

    def ask(*words: str) -> str:
        done = subprocess.run(
            [sys.executable, "-c", "from kinid.cli import main; main()", *words, "--effects", "effects"],
            cwd=tmp_path,
            check=False,
            capture_output=True,
            text=True,
        )
        assert done.returncode == 0, done.stderr
        return done.stdout

    assert "Forchheimer" in ask("diagnose", "--explain", "law-of-a-page")
    assert "law-of-a-page" in ask("fit", "tester.npz", "--model", "hooke,law-of-a-page", "--json", "fit.json")
    import json

    estimate = json.loads((tmp_path / "fit.json").read_text())["parameters"]["law-of-a-page.damping"]
    assert estimate["low"] < 260.0 < estimate["high"]
    assert estimate["value"] == pytest.approx(260.0, rel=0.05)
    ask("diagnose", "tester.npz", "--model", "hooke", "--json", "found.json")
    found = json.loads((tmp_path / "found.json").read_text())
    assert found["verdict"] == "missing"
    assert found["added"] == ["law-of-a-page"]
    # nothing of it stays behind: this process's catalogue doesn't know it
    from kinid.effects import catalogue

    assert "law-of-a-page" not in catalogue()


def test_commands_have_their_line() -> None:
    """The table of commands names each of them, and of their options only those that they have."""
    import typer

    from kinid.cli import app

    def walk(command: Any, path: str) -> Iterator[tuple[str, set[str]]]:
        children = getattr(command, "commands", None) or {}
        if not children:
            yield path, {option for parameter in command.params for option in parameter.opts}
        for name, child in children.items():
            yield from walk(child, f"{path} {name}")

    known = dict(walk(typer.main.get_command(app), "kinid"))
    page = (ROOT / "docs" / "commands.md").read_text(encoding="utf-8")
    rows = re.findall(r"^\| `(kinid .+?) \|.*\| (.*) \|$", page, re.MULTILINE)
    said: dict[str, set[str]] = {}
    for heads, files in rows:
        first, *more = re.findall(r"[\w ]*\w", re.sub(r" [A-Z]+\S*", "", heads))
        for name in (first, *(f"{first.rsplit(' ', 1)[0]} {other}" for other in more if other.strip())):
            said[name.strip()] = set(re.findall(r"`(-{1,2}\w+)`", files))
    assert said.keys() == known.keys()
    assert {name: options - known[name] for name, options in said.items() if options - known[name]} == {}


def test_the_site(tmp_path: Path) -> None:
    """It builds without a warning, holds every effect and command, and asks nobody for anything."""
    pytest.importorskip("sphinx")
    pytest.importorskip("furo")
    pytest.importorskip("myst_parser")
    site = tmp_path / "site"
    done = subprocess.run(
        [
            sys.executable,
            "-m",
            "sphinx",
            "-q",
            "-W",
            "-b",
            "html",
            "-d",
            str(tmp_path / "doctrees"),
            str(ROOT / "docs"),
            str(site),
        ],
        check=False,
        capture_output=True,
        text=True,
    )
    assert done.returncode == 0, done.stderr
    from kinid.effects import catalogue

    effects = (site / "effects.html").read_text(encoding="utf-8")
    assert [name for name in catalogue() if f'id="{name}"' not in effects] == []
    assert "kinid plan excite" in (site / "commands.html").read_text(encoding="utf-8")
    assert "kinid.contact_series" in (site / "reference" / "kinid.html").read_text(encoding="utf-8")
    loads = re.compile(r"(?:<(?:script|img|iframe)[^>]*src|<link[^>]*href)=\"(?:https?:)?//[^\"]*")
    assert [found for page in site.rglob("*.html") for found in loads.findall(page.read_text(encoding="utf-8"))] == []
    for page in ("index.html", "reference/kinid.html") if CHROMIUM is not None else ():
        assert complaints(site / page, tmp_path / "browser") == [], page


def test_the_guide_lists_every_unit_of_columns() -> None:
    """But products, of which it says how they are written."""
    from kinid.units import FACTORS, TORQUES

    stated = set(re.findall(r"`([^`]+)`", (ROOT / "docs" / "guide.md").read_text(encoding="utf-8")))
    signs = {"µm": "um", "µs": "us", "µm/s": "um/s"}
    lacking = [unit for unit in FACTORS if unit not in TORQUES and signs.get(unit, unit) not in stated | {"1"}]
    assert lacking == []
