"""Pages: small enough to send, links that lead somewhere, the same text each time, no code of Python's on them."""

from __future__ import annotations

import dataclasses
import fnmatch
import re
import tomllib
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from headless import complaints, needs_chromium

from kinid.cli.show import show_comparison
from kinid.contact.analysis import Analysis, analyse
from kinid.data.log import Log, Provenance, Step
from kinid.data.rig import Rig
from kinid.identification.compare import Comparison, compare
from kinid.modeling.model import Model
from kinid.reports.fit_plots import comparison_page, fit_page, winner
from kinid.reports.plots import analysis_page, round_span

ROOT = Path(__file__).parents[2]
#: what may be sent by mail and opened on a phone [bytes]
MOST = 4_000_000
NOISE = 0.02


class Page(HTMLParser):
    """Names within a page, links to them, and its text outside scripts and styles."""

    def __init__(self, page: str) -> None:
        super().__init__()
        self.names: set[str] = set()
        self.links: list[str] = []
        self.text, self._inside = "", ""
        self.feed(page)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        known = dict(attrs)
        self._inside = tag
        self.names |= {str(known["id"])} if "id" in known else set()
        self.links += [str(known["href"])[1:]] if str(known.get("href")).startswith("#") else []

    def handle_data(self, data: str) -> None:
        if self._inside not in ("script", "style"):
            self.text += data


@pytest.fixture(scope="module")
def tester() -> Log:
    """A long log of a material tester on a damped spring."""
    rng, n = np.random.default_rng(0), 60_000
    t = np.arange(n) / 1000.0
    depth = 3e-3 * np.sin(2 * np.pi * 0.4 * t) + 1e-3 * np.sin(2 * np.pi * 1.9 * t)
    force = np.where(depth > 0, 800 * depth + 12 * np.gradient(depth, 1e-3), 0.0) + NOISE * rng.standard_normal(n)
    return Log(t, contact={"depth": depth, "normal_force": force}, provenance=Provenance("tester.csv"))


@pytest.fixture(scope="module")
def compared(tester: Log) -> Comparison:
    return compare([Model("hooke"), Model("kelvin-voigt")], tester, Rig())


@pytest.fixture(scope="module")
def analysed(tester: Log) -> Analysis:
    return analyse(tester, Rig())


@pytest.fixture(scope="module")
def pages(compared: Comparison, analysed: Analysis) -> dict[str, str]:
    return {
        "contact": analysis_page(analysed, "tester.csv"),
        "fit": fit_page(compared.rows[0].fit, "tester.csv"),
        "compare": comparison_page(compared, "tester.csv"),
    }


def test_pages_are_small_and_their_links_lead_somewhere(pages: dict[str, str]) -> None:
    for name, text in pages.items():
        assert len(text.encode()) <= MOST, name
        page = Page(text)
        assert set(page.links) <= page.names, name
    contents = Page(pages["compare"]).links
    assert len(contents) >= 4
    assert len(set(contents)) == len(contents)


def test_a_page_is_the_same_each_time(pages: dict[str, str], compared: Comparison) -> None:
    assert comparison_page(compared, "tester.csv") == pages["compare"]


def test_the_comparison_names_the_winner_and_its_error_over_the_noise(
    pages: dict[str, str], compared: Comparison
) -> None:
    page = Page(pages["compare"])
    assert "kelvin-voigt wins" in page.text
    for row in compared.rows:
        assert f"{row.held_out:.4g} N rms" in page.text
    assert f"noise alone, {compared.noise_floor:.4g} N rms" in page.text
    # the bars are as long as the errors are large
    widths = [float(w) for w in re.findall(r'class="bar[^"]*" style="width:([\d.]+)%', pages["compare"])]
    line = float(re.search(r'class="noise" style="left:([\d.]+)%', pages["compare"]).group(1))  # type: ignore[union-attr]
    errors = [row.held_out for row in compared.rows]
    # widths are rounded to a tenth of a per cent
    np.testing.assert_allclose(
        [*widths, line], [100 * e / (1.02 * max(errors)) for e in (*errors, compared.noise_floor)], atol=0.06
    )


@pytest.mark.parametrize(
    ("reference", "difference", "begins"),
    [
        (0, 0.1, "kelvin-voigt wins"),
        (0, 0.001, "No winner: kelvin-voigt has the least held-out error"),
        (1, 0.1, "kelvin-voigt has the least held-out error, 0.1 ± 0.01 N below that of hooke."),
        (1, 0.001, "kelvin-voigt has the least held-out error, 0.001 ± 0.01 N below that of hooke, which may be"),
    ],
)
def test_who_wins(compared: Comparison, reference: int, difference: float, begins: str) -> None:
    """The difference stands at the model that isn't the reference: what is better is negative."""
    rows = list(compared.rows)
    gaps = [0.0, difference] if reference == 0 else [-difference, 0.0]
    rows = [dataclasses.replace(row, difference=gap, standard_error=0.01) for row, gap in zip(rows, gaps)]
    result = dataclasses.replace(compared, rows=tuple(rows), reference=str(rows[reference].fit.model))
    assert winner(result).startswith(begins)


def test_no_model_wins_where_chance_is_unknown(compared: Comparison) -> None:
    rows = [dataclasses.replace(row, difference=float("nan"), standard_error=float("nan")) for row in compared.rows]
    said = winner(dataclasses.replace(compared, rows=tuple(rows)))
    assert "wins" not in said
    assert "too little is held out" in said


def test_a_doubt_of_several_models_is_said_once(compared: Comparison, capsys: pytest.CaptureFixture[str]) -> None:
    """With the models that it is of, unless it is of all; and what a difference is stands on the screen, too."""
    own = ({"a", "b"}, {"a", "c"})
    rows = [
        dataclasses.replace(row, fit=dataclasses.replace(row.fit, warnings=tuple(sorted(each))))
        for row, each in zip(compared.rows, own)
    ]
    show_comparison(dataclasses.replace(compared, rows=tuple(rows)))
    said = capsys.readouterr().out
    doubts = [line for line in said.splitlines() if line.startswith("doubt: ")]
    first, second = (str(row.fit.model) for row in rows)
    assert doubts == ["doubt: a", f"doubt: {first}: b", f"doubt: {second}: c"]
    assert winner(compared) in said
    assert f"of the error less that of {compared.reference}" in said


def test_steps_are_told_in_words() -> None:
    """No dictionary and no name of a field as Python writes them."""
    facts: dict[str, Any] = {
        "columns": {"t": ["t"], "q": ["q1", "q2", "q3", "q4"], "wrench": ["fx", "fy"]},
        "bandwidth_hz": 20.0,
        "within_m": 0.005,
        "noise": [1e-3, 1e-3, 1e-3],
        "invalid_rows": 0,
        "ignored": [],
    }
    said = str(Step("read", facts))
    assert said == (
        "read: columns (t: t; q: q1 … q4; wrench: [fx, fy]), bandwidth 20 Hz, within 0.005 m, noise 0.001 each, "
        "invalid rows 0, ignored none"
    )


@pytest.mark.parametrize(
    ("low", "high", "ends"),
    [
        (507.8, 2399.0, (500.0, 2400.0)),
        (500.0, 2000.0, (500.0, 2000.0)),
        (0.0, 0.0337, (0.0, 0.034)),
        (-1.23, 4.56, (-1.5, 5.0)),
        (3.0, 3.0, (3.0, 3.0)),
    ],
)
def test_scales_end_at_round_numbers(low: float, high: float, ends: tuple[float, float]) -> None:
    assert round_span(low, high) == ends


def test_templates_are_part_of_the_package() -> None:
    """Every file beside the templates is named by what setuptools is told to pack."""
    packed = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["tool"]["setuptools"]["package-data"]
    folder = ROOT / "kinid" / "reports"
    for path in (folder / "templates").iterdir():
        assert any(fnmatch.fnmatch(str(path.relative_to(folder)), glob) for glob in packed["kinid.reports"]), path


@needs_chromium
def test_a_browser_draws_every_figure(pages: dict[str, str], tmp_path: Path) -> None:
    """Negative control included: the library is unpacked and draws, or the page says that on the console."""
    check = (
        "<script>setTimeout(() => { const all = document.querySelectorAll('.plot'); "
        "const drawn = document.querySelectorAll('.plot .main-svg').length; "
        "if (!all.length || drawn < all.length) console.log('error: ' + drawn + ' of ' + all.length); }, 4000)"
        "</script></body>"
    )
    for name, text in (
        ("good", pages["compare"]),
        ("bad", pages["compare"].replace('id="plotly">H4sI', 'id="plotly">AAAA')),
    ):
        path = tmp_path / f"{name}.html"
        path.write_text(text.replace("</body>", check), encoding="utf-8")
        assert bool(complaints(path, tmp_path / f"browser-{name}")) is (name == "bad")


@needs_chromium
def test_a_page_that_fails_after_it_was_loaded_is_seen(tmp_path: Path) -> None:
    """By a script of its own, too, that lies beside it."""
    page, script = tmp_path / "late.html", tmp_path / "own.js"
    page.write_text("<body><script src='own.js'></script></body>", encoding="utf-8")
    script.write_text("setTimeout(() => { throw new Error('late'); }, 500)", encoding="utf-8")
    assert any("late" in line for line in complaints(page, tmp_path / "profile"))
    assert sorted(path.name for path in tmp_path.iterdir()) == ["late.html", "own.js", "profile"]
