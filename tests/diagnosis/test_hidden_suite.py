"""Diagnosis of effects that were hidden by equations which are not the catalogue's.

A small part runs always. The whole study is marked slow; its figures, confusion matrix and every case are written to
`KINID_ARTEFACTS`, or to the test's own folder, and the figures are printed beside what was asked for.

Thresholds were chosen on cases of other seeds than those here.
"""

from __future__ import annotations

import json
import os
from pathlib import Path

import pytest
from hidden.cases import case
from hidden.study import REPORT, Answer, Figure, Job, figures, jobs, report, run, side_by_side, write

import kinid

#: of the small part; the study has another one
SEED = 2001


def answers(kind: str, *worlds: tuple[str, int, int]) -> list[Answer]:
    """What is said of cases number `first` to `last` of a kind in each world."""
    found = [
        run(Job(kind, number, SEED, world, refit=False))
        for world, first, last in worlds
        for number in range(first, last)
    ]
    print("\n" + "\n".join(t.line() for t in found), end="")
    assert not [t.crash for t in found if t.crash]
    return found


@pytest.mark.parametrize(
    ("worlds", "least"),
    [
        ((("force-depth", 3, 7), ("wrench", 0, 1)), 4),
        pytest.param((("force-depth", 3, 8), ("wrench", 0, 1), ("joints", 1, 2)), 5, marks=pytest.mark.slow),
    ],
)
def test_one_hidden_effect_is_named(worlds: tuple[tuple[str, int, int], ...], least: int) -> None:
    """Of a few, one may be mistaken for another that fits about as well: 95 % are asked for."""
    found = answers("single", *worlds)
    visible = [t for t in found if t.counts]
    assert len(visible) >= least  # they are drawn to be from a fifth of the noise on; most of them matter
    assert sum(t.first for t in visible) >= len(visible) - 1
    assert sum(t.right for t in visible) >= len(visible) - 1  # and nothing else was added
    for t in [t for t in visible if t.first]:
        assert t.after < 0.99 * t.before
        assert t.after <= 1.1 * t.best


def test_adding_what_is_there_does_not_raise_the_error() -> None:
    """A weak effect, and a surface that is off by what calibration is trusted to: one must not pay for the other."""
    hidden = case("single", 0, REPORT, "force-depth")
    found = kinid.diagnose(hidden.log, hidden.rig, model=kinid.Model(*hidden.model))
    assert set(found.added) <= hidden.truth
    assert found.steps[-1].held_out <= found.steps[0].held_out


def test_two_effects_that_help_most_together() -> None:
    """A surface that is deeper than stated, and a stiffer layer that begins there: the layer alone, beside a surface as
    far off as calibration leaves open, takes off some of the error, and both take off most of it.
    """
    hidden = case("pair", 11, 11001, "wrench")
    assert hidden.truth == {"stiffening-layer", "surface-offset"}
    found = kinid.diagnose(hidden.log, hidden.rig, model=kinid.Model(*hidden.model), max_effects=2)
    assert set(found.added) == hidden.truth
    assert found.steps[-1].held_out < 0.4 * found.steps[0].held_out
    assert found.steps[-1].held_out < found.steps[1].held_out


@pytest.mark.slow
def test_one_of_two_alone_leaves_more_than_both() -> None:
    hidden = case("pair", 11, 11001, "wrench")
    both, alone = (
        kinid.diagnose(hidden.log, hidden.rig, model=kinid.Model(*hidden.model), max_effects=n) for n in (2, 1)
    )
    assert set(alone.added) < hidden.truth
    assert both.steps[-1].held_out < alone.steps[-1].held_out


def test_an_offset_within_a_step_of_the_converter_is_no_finding() -> None:
    """Some joints rest on one step; what speaks for an offset is no more than every torque sensor has: one of 0.05 N·m
    explains as much as the best."""
    hidden = case("pair", 4, 19001, "joints")
    assert hidden.truth == {"joint-torque-offset", "quantization"}
    found = kinid.diagnose(hidden.log, hidden.rig, model=kinid.Model(*hidden.model))
    assert found.added == ("quantization",)
    assert found["joint-torque-offset"].verdict != "present"


def test_nothing_hidden_nothing_found() -> None:
    assert all(t.right for t in answers("none", ("force-depth", 0, 4)))


def test_what_no_catalogue_holds_is_said_to_be_unexplained() -> None:
    """Nine of ten are asked for; of four one may look like noise."""
    assert sum(t.verdict == "unexplained" for t in answers("outside", ("force-depth", 0, 4))) >= 3


def test_two_hidden_effects_are_named() -> None:
    found = answers("pair", ("force-depth", 0, 2))
    assert all(t.hits >= 1 for t in found)
    assert any(t.hits == 2 for t in found)


def test_what_a_log_can_not_show_is_not_called_absent() -> None:
    found = answers("not-excited", ("force-depth", 0, 4), ("joints", 0, 1))
    assert sum(t.unseen for t in found) >= 20
    assert not [t.line() for t in found if t.absent]


# ------------------------------------------------------------------------------------------------------- the whole
# study


@pytest.mark.slow
def test_the_whole_study(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Figures beside what was asked for.

    A share that was asked for is taken to be missed where so few hits would come once in a hundred studies if it were
    the true
    one: so many cases can't tell 95 % from 94 %. Which figures fell short, if only by chance, is printed all the same.
    """
    folder = Path(os.environ.get("KINID_ARTEFACTS") or tmp_path)
    work = jobs(REPORT)
    assert len(work) >= 200

    def tell(line: str) -> None:
        with capsys.disabled():
            print("\n" + line[:150], end="", flush=True)

    found = side_by_side(work, 2, tell)
    write(found, folder, "hidden-effects")
    with capsys.disabled():
        print("\n\n" + report(found).split("\n\nhidden →")[0] + f"\n\nwritten to {folder}")
    result = figures(found)
    assert sum(t.unseen for t in found) >= 100
    assert [share.line() for share in result.shares if not share.believable] == []
    assert result.set_size <= 1.5
    assert result.median_ratio <= 1.02


# ----------------------------------------------------------------------------------------------------- how it is
# counted


def case_of(kind: str = "single", truth: tuple[str, ...] = ("a",), **more: object) -> Answer:
    values = {"verdict": "missing", "before": 1.0, "after": 0.5, "best": 0.5} | more
    return Answer("x", kind, "force-depth", truth, "", **values)  # type: ignore[arg-type]


def test_cases_are_counted_as_they_are() -> None:
    good = case_of(added=("a",), declared=(("a", "b"),))
    rival = case_of(added=("b",), declared=(("b", "a"),), after=0.6)
    wrong = case_of(added=("c",), declared=(("c",),), verdict="unexplained")
    small = case_of(best=0.995, after=1.0, verdict="adequate")
    alarm = case_of("none", (), added=("a",), declared=(("a",),), best=1.0)
    blind = case_of("not-excited", ("a", "b", "c"), absent=("b",), unseen=3)
    crash = case_of(crash="ValueError: no")
    one = case_of("pair", ("a", "b"), added=("a",), declared=(("a",),), quiet={"b": 0.502})
    both = case_of("pair", ("a", "b"), added=("b", "a"), declared=(("b",), ("a",)))
    assert [t.right for t in (good, rival, wrong, alarm, blind, crash, both)] == [
        True,
        False,
        False,
        False,
        False,
        False,
        True,
    ]
    assert not small.counts
    assert not one.counts  # the other one is worth less than 1 %
    shares = {
        f.name: (f.hits, f.cases) for f in figures([good, rival, wrong, small, alarm, blind, crash, one, both]).shares
    }
    assert shares["one hidden: named first"] == (1, 4)
    assert shares["one hidden: in the declared set"] == (2, 4)
    assert shares["nothing hidden: false alarms"] == (1, 1)
    assert shares["known effects: unexplained"] == (1, 5)
    assert shares["two hidden: both"] == (1, 1)
    assert shares["error after adding ≤ 1.1 × that of the true model"] == (4, 5)
    assert shares["not excited, but called absent"] == (1, 3)
    assert shares["crashes"] == (1, 9)


def test_chance_is_told_from_failure() -> None:
    assert not Figure("x", 94, 100, 0.95).reached
    assert Figure("x", 94, 100, 0.95).believable
    assert not Figure("x", 88, 100, 0.95).believable
    assert Figure("x", 2, 40, 0.03, least=False).believable
    assert not Figure("x", 6, 40, 0.03, least=False).believable
    assert not Figure("x", 1, 100, 0.0, least=False).believable


def test_the_artefact_is_json_and_text(tmp_path: Path) -> None:
    write([case_of(added=("a",), declared=(("a",),)), case_of("outside", (), best=float("nan"))], tmp_path, "study")
    facts = json.loads((tmp_path / "study.json").read_text(), parse_constant=lambda name: pytest.fail(name))
    assert len(facts["cases"]) == 2
    assert facts["figures"][0]["share"] == 1.0
    assert facts["cases"][1]["best"] is None
    assert "named first" in (tmp_path / "study.txt").read_text()
