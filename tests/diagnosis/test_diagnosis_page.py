"""The report and the terminal say what the diagnosis holds, and no file's name or effect's text gets out of its
quotes.
"""

from __future__ import annotations

import dataclasses
import re
from html.parser import HTMLParser

import numpy as np
import pytest
from numpy.typing import NDArray

from kinid.cli.show_diagnosis import show_diagnosis
from kinid.data.log import Provenance
from kinid.diagnosis.result import Diagnosis, EffectStatus, EffectVerdict, Step, Verdict
from kinid.effects import Layout, Signals
from kinid.identification.fit import fit_model
from kinid.identification.fitted import FittedParameter
from kinid.identification.lack_of_fit import lack_of_fit
from kinid.identification.whole import held_out_residual
from kinid.modeling.experiment import Experiment
from kinid.modeling.model import Model
from kinid.reports.diagnosis_figures import MOST_POINTS, Shown, loops, readings
from kinid.reports.diagnosis_multiples import multiples
from kinid.reports.diagnosis_page import diagnosis_page
from kinid.reports.diagnosis_words import headline, leftover, one_sided
from kinid.reports.plots import decimate
from kinid.residuals.localization import where

NOISE = 0.02
SPITE = '<script>alert("x")</script> & [bold]'


@pytest.fixture(scope="module")
def found() -> Diagnosis:
    """A damped material that a spring was asked about; damping was added. The verdicts on others are made up."""
    rng, n = np.random.default_rng(0), 8000
    t = np.arange(n) / 400.0
    depth = np.clip(3e-3 * np.sin(2 * np.pi * 0.4 * t) + 1e-3 * np.sin(2 * np.pi * 1.9 * t), -1e-3, None)
    rate = np.gradient(depth, 1 / 400)
    force = np.where(depth > 0, 800 * depth + 12 * rate, 0.0) + NOISE * rng.standard_normal(n)
    pair = np.stack([6e-3 * np.sin(0.3 * t), np.zeros(n)])
    signals = Signals(
        Layout(("normal_force",), "contact"),
        t,
        np.diff(t, prepend=0.0),
        depth,
        rate,
        pair,
        np.gradient(pair, 1 / 400, axis=1),
        measured=force[None],
    )
    experiment = Experiment(
        signals, force[None], np.ones(n, np.bool_), np.array([NOISE]), None, depth > 0, np.arange(n)
    )
    model, best = Model("hooke"), Model("hooke", "viscous-damping")
    fits = [fit_model(m, experiment) for m in (model, best)]
    before, after = (held_out_residual(f.state) for f in fits)
    names = (None, "viscous-damping")
    steps = tuple(
        Step(added, f.model.names, f.error.train, f.error.held_out, explained)
        for added, f, explained in zip(names, fits, (0.0, 0.993))
    )
    damping = {"damping": dataclasses.replace(fits[1]["damping"], high=float("inf"))}
    effects = (
        EffectVerdict(
            "adhesion", EffectStatus.NOT_EXCITED, 0.0, "nothing pulls", separate_by="a slow retraction " + SPITE
        ),
        EffectVerdict("relaxation", EffectStatus.ABSENT, -7.5, "no decay"),
        EffectVerdict(
            "viscous-damping",
            EffectStatus.PRESENT,
            812.4,
            "loops",
            ("hunt-crossley-damping",),
            0.05,
            damping,
            "several depths",
        ),
    )
    return Diagnosis(
        model,
        best,
        Verdict.MISSING,
        SPITE,
        ("viscous-damping",),
        steps,
        fits[0].error.noise_floor,
        "N",
        effects,
        ("the log is short",),
        (),
        where(experiment, before, experiment.noise),
        where(experiment, after, experiment.noise),
        lack_of_fit(fits[1].state, after),
        experiment,
        before,
        after,
        fits[1],
    )


class Outline(HTMLParser):
    """Tags that were opened, text outside scripts and styles, and addresses that the page would ask for."""

    def __init__(self, page: str) -> None:
        super().__init__()
        self.text, self.asks, self.open = "", [], []
        self.feed(page)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        if tag not in ("meta", "link", "br", "img"):
            self.open.append(tag)
        self.asks += [
            value for name, value in attrs if name in ("src", "href") and value and not value.startswith(("data:", "#"))
        ]

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag, f"</{tag}> closes something else"

    def handle_data(self, data: str) -> None:
        if not {"script", "style"} & set(self.open):
            self.text += data


def test_the_page_tells_what_was_found_and_asks_nobody(found: Diagnosis) -> None:
    page = Outline(diagnosis_page(found, f"log {SPITE}", Provenance("log.csv " + SPITE).then("read", rows=8000)))
    assert page.open == []
    assert page.asks == []
    assert headline(found) in page.text
    for cell in (*found.where, *found.left_where):
        assert cell.says in page.text
    for step in found.steps:
        assert f"{step.held_out:.3g}" in page.text
    assert leftover(found) in page.text
    assert f"{found.left.tolerance:.3g} N" in page.text
    assert "99 %" in page.text  # explained
    assert "effort" not in page.text
    for effect in found.effects:
        assert effect.id in page.text
        assert effect.says in page.text
        assert effect.separate_by in page.text
    for word in (
        "812",
        "as good: hunt-crossley-damping",
        "N·s/m",
        "open]",
        "the log is short",
        "8000 samples",
        "400 Hz",
        "rows 8000",
        found.fit.equation().splitlines()[1],
    ):
        assert word in page.text, word


def test_text_stays_text(found: Diagnosis) -> None:
    """Spiteful names are shown as they are, five times: title, heading, verdict, hint, source."""
    page = diagnosis_page(found, SPITE, Provenance(SPITE))
    assert 'alert("x")' not in page
    assert Outline(page).text.count(SPITE) == 5


def test_after_is_left_out_where_nothing_was_added(found: Diagnosis) -> None:
    alone = dataclasses.replace(
        found, best=found.model, verdict=Verdict.UNEXPLAINED, added=(), steps=found.steps[:1], effects=()
    )
    text = Outline(diagnosis_page(alone, "log")).text
    assert "Unexplained." in text
    assert "after (" not in text
    assert "What is still left" not in text
    assert "None was found." in text
    assert Shown.of(alone).after is None


def peaks(rng: np.random.Generator, n: int) -> NDArray[np.float64]:
    x = rng.standard_normal(n)
    x[[n // 3, n // 2]] = 50.0, -60.0
    x[10:500] = np.nan
    return x


@pytest.mark.parametrize("n", [100, 3001, 100_003])
def test_pictures_thin_long_logs_and_keep_the_peaks(n: int) -> None:
    rng = np.random.default_rng(n)
    series = [peaks(rng, n) if n > 1000 else rng.standard_normal(n) for _ in range(3)]
    rows = decimate(3000, *series)
    assert len(rows) <= 3000
    assert (np.diff(rows) > 0).all()
    assert rows[0] == 0
    assert rows[-1] == n - 1
    if n <= 3000:
        assert len(rows) == n
    for x in series:
        assert np.nanmax(x[rows]) == np.nanmax(x)
        assert np.nanmin(x[rows]) == np.nanmin(x)


def test_pictures_show_the_numbers(found: Diagnosis) -> None:
    shown = Shown.of(found)
    (name, figure), *others = readings(shown)
    assert (name, others) == ("Normal force", [])
    by_name = {(trace.name, trace.yaxis): trace for trace in figure.data}
    measured, before = by_name["measured", "y"], by_name["before", "y"]
    assert all(len(trace.x) <= MOST_POINTS for trace in figure.data)
    rows = np.searchsorted(found.experiment.signals.t, np.asarray(measured.x) - 1e-4)
    # single precision: seven digits
    np.testing.assert_allclose(measured.y, found.experiment.measured[0][rows], rtol=1e-6)
    np.testing.assert_allclose(np.subtract(measured.y, before.y), found.residual[0][rows], atol=1e-5)
    phase, *divided = multiples(shown, 0)
    headings = [heading for heading, _ in divided]
    assert headings == [
        "depth [mm]",
        "speed of pressing [mm/s]",
        "speed of sliding [mm/s]",
        "direction",
        "place on the surface",
        "frequency [Hz]",
        "time [s]",
    ]
    bars = {trace.name: dict(zip(trace.x, trace.y)) for trace in phase[1].data}
    inside = found.experiment.in_contact
    # what moves in contact is a poke but for touches too brief to tell: the root mean square there is the poke's to a
    # few percent
    assert bars["before"]["pokes"] == pytest.approx(np.sqrt(np.mean(found.residual[0][inside] ** 2)), rel=0.05)
    assert bars["after"]["pokes"] == pytest.approx(NOISE, rel=0.05)
    for heading, loop in loops(shown):
        assert heading.endswith((": before", ": after"))
        assert {trace.name for trace in loop.data} == {"measured", heading.split(": ")[1]}
        assert "mm" in loop.layout.xaxis.title.text


def test_the_terminal_tells_the_same(found: Diagnosis, capsys: pytest.CaptureFixture[str]) -> None:
    show_diagnosis(found)
    out = capsys.readouterr().out
    assert not re.search(r"\x1b\[", out), "colours where the output is piped"
    assert f"missing: {headline(found)}" in out
    assert SPITE in out
    assert found.where[0].says in out
    rungs = [line for line in out.splitlines() if "█" in line]
    assert [line.split("  ")[1].strip() for line in rungs] == ["as asked", "+ viscous-damping", "noise alone"]
    assert ["explained" in line for line in rungs] == [False, True, False]
    assert "99 % explained" in rungs[1]
    assert leftover(found) in out
    assert "effort" not in out
    assert rungs[0].count("█") == 32
    # bars are as long as errors are large, to a character
    assert rungs[1].count("█") == pytest.approx(32 * found.steps[1].held_out / found.steps[0].held_out, abs=0.51)
    assert "present, as good: hunt-crossley-damping" in out
    assert "absent (1): relaxation" in out
    assert "this log cannot tell (1): adhesion" in out
    assert "viscous-damping or hunt-crossley-damping: several depths" in out
    assert "doubt: the log is short" in out
    assert "[N rms]" in out


@pytest.mark.parametrize(
    ("verdict", "added", "begins"),
    [
        ("adequate", (), "The model is adequate: the held-out error is 0.5 N, and noise alone is 0.03 N."),
        (
            "missing",
            ("relaxation",),
            "The model lacks relaxation: with it the held-out error falls from 0.5 to 0.1 N; noise",
        ),
        (
            "missing",
            ("a", "b", "c"),
            "The model lacks a, b and c: with them the held-out error falls from 0.5 to 0.1 N; noise",
        ),
        (
            "unexplained",
            (),
            "Something is missing that the catalogue does not hold: the held-out error is 0.5 N; noise",
        ),
        (
            "unexplained",
            ("a",),
            "Something is missing that the catalogue does not hold. a helps, but does not suffice: the",
        ),
    ],
)
def test_headlines(found: Diagnosis, verdict: str, added: tuple[str, ...], begins: str) -> None:
    steps = (Step(None, ("hooke",), 0.5, 0.5), *([Step(added[-1], ("hooke",), 0.1, 0.1)] if added else []))
    result = dataclasses.replace(found, verdict=verdict, added=added, steps=steps, noise_floor=0.03)
    assert headline(result).startswith(begins)


def test_what_was_forced_and_brings_nothing_is_not_lacking(found: Diagnosis) -> None:
    idle = dataclasses.replace(found.effects[0], id="relaxation", verdict=EffectStatus.NOT_EXCITED, equivalent_to=())
    steps = tuple(
        Step(name, ("hooke",), error, error) for name, error in ((None, 0.5), ("hysteresis", 0.1), ("relaxation", 0.1))
    )
    result = dataclasses.replace(found, added=("hysteresis", "relaxation"), effects=(idle,), steps=steps)
    assert headline(result).startswith(
        "The model lacks hysteresis: with all that was added the held-out error falls from 0.5 to"
    )


def test_what_is_left_is_said_with_what_may_be(found: Diagnosis) -> None:
    """Noise for noise; else its size beside noise, as a share of the reading, how long it remembers itself, and the
    tolerance.
    """
    rms, allowed = f"{found.left.rms:.3g}", f"{found.left.tolerance:.3g}"
    assert leftover(found) == f"{rms} N are left, and noise explains them. The tolerance is {allowed} N."
    left = dataclasses.replace(found.left, rms=0.5, noise=0.3, excess=0.4, reading=4.0, memory=0.126, tolerance=0.08)
    assert leftover(dataclasses.replace(found, left=left)) == (
        "0.5 N are left. Beside noise they are 0.4 N, 10 % of the reading, and remember themselves for 0.13 s. "
        "The tolerance is 0.08 N."
    )


def test_a_stand_in_is_said_to_be_one(found: Diagnosis, capsys: pytest.CaptureFixture[str]) -> None:
    """On the page, on the terminal and in the first line; the other addition, which is none, still helps."""
    damping = found.effects[-1]
    follows = dataclasses.replace(
        damping,
        id="hysteresis",
        verdict=EffectStatus.INDISTINGUISHABLE,
        equivalent_to=(),
        separate_by="",
        says="it takes off less than it leaves",
        stand_in=True,
    )
    steps = (*found.steps, dataclasses.replace(found.steps[-1], added="hysteresis"))
    result = dataclasses.replace(
        found,
        verdict=Verdict.UNEXPLAINED,
        added=("viscous-damping", "hysteresis"),
        steps=steps,
        effects=(damping, follows),
    )
    says = (
        "viscous-damping or hunt-crossley-damping helps, but does not suffice, and hysteresis is a stand-in for it: the"
    )
    assert f"does not hold. {says}" in headline(result)
    alone = dataclasses.replace(result, added=("hysteresis",), steps=found.steps, effects=(follows,))
    assert "does not hold. hysteresis is a stand-in for it: the" in headline(alone)
    show_diagnosis(result)
    printed = capsys.readouterr().out
    assert "○ stand-in" in printed
    assert "indistinguishable" not in printed
    page = Outline(diagnosis_page(result, "log")).text
    assert "○ stand-in" in page
    assert follows.says in page


def test_marks_in_the_samples_have_no_evidence(found: Diagnosis, capsys: pytest.CaptureFixture[str]) -> None:
    mark = dataclasses.replace(found.effects[-1], id="saturation", evidence=float("inf"))
    result = dataclasses.replace(found, effects=(mark,))
    assert result.to_dict()["effects"][0]["evidence"] is None
    show_diagnosis(result)
    assert " inf " not in capsys.readouterr().out
    assert "inf" not in Outline(diagnosis_page(result, "log")).text.replace("infinite", "").replace("information", "")


@pytest.mark.parametrize(
    ("last", "says"),
    [
        (0.5, "helps, but does not suffice: the held-out error falls from 1 to 0.5 N"),
        (0.998, "-damping does not suffice: the held-out error stays 1 N"),
        (1.2, "-damping does not suffice: the held-out error rises from 1 to 1.2 N"),
    ],
)
def test_an_error_that_does_not_fall_is_not_said_to(found: Diagnosis, last: float, says: str) -> None:
    steps = tuple(dataclasses.replace(step, held_out=error) for step, error in zip(found.steps, (1.0, last)))
    assert says in headline(dataclasses.replace(found, verdict=Verdict.UNEXPLAINED, steps=steps))


@pytest.mark.parametrize(
    ("errors", "said"), [((1.0, 1.2, 0.1), True), ((1.0, 0.6, 0.1), False), ((1.0, 0.1, 0.2), False)]
)
def test_a_rung_that_rises_says_that_it_helps_beside_the_next(
    found: Diagnosis, errors: tuple[float, ...], said: bool, capsys: pytest.CaptureFixture[str]
) -> None:
    steps = tuple(
        Step(name, ("hooke",), error, error) for name, error in zip((None, "relaxation", "hysteresis"), errors)
    )
    show_diagnosis(dataclasses.replace(found, added=("relaxation", "hysteresis"), steps=steps))
    lines = capsys.readouterr().out.splitlines()
    first, last = (next(line for line in lines if f"+ {name}" in line) for name in ("relaxation", "hysteresis"))
    assert ("helps only beside what follows" in first) is said
    assert ("helps only as readings are weighed" in last) is (errors[2] > errors[1])


@pytest.mark.parametrize(
    ("value", "low", "high", "says"),
    [
        (1e-6, 1e-6, 3e-5, "at most 3e-05"),
        (4.0, 2.0, 4.0, "at least 2"),
        (3.0, 2.0, 4.0, ""),
        (3.0, 3.0, 3.0, ""),
        (3.0, -np.inf, np.inf, ""),
    ],
)
def test_an_estimate_at_the_end_of_its_interval_has_one_side(value: float, low: float, high: float, says: str) -> None:
    assert one_sided(FittedParameter("presliding.length", value, low, high, "m"), "{:g}".format) == says
