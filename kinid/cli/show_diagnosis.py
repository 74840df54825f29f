"""A diagnosis on a terminal: verdict, where the error sits, how it falls, which effects, what to measure next."""

from __future__ import annotations

from math import isfinite
from typing import TYPE_CHECKING

from rich.table import Table
from rich.text import Text

from kinid.cli.show import console, estimates, right, say

if TYPE_CHECKING:
    from rich.console import Console

    from kinid.diagnosis.result import Diagnosis, EffectVerdict

#: sentences on where the error sits, and characters of the longest bar
MOST_REGIONS, WIDE = 5, 32
#: hints on what to measure next, at most
MOST_HINTS = 6
#: where a hint's command begins
COMMAND = ": kinid "
#: parameters that have room beside an effect's verdict
MOST_NUMBERS = 3
COLOUR = {"adequate": "green", "missing": "yellow", "unexplained": "red"}
MARK = {"present": "●", "indistinguishable": "◐"}
STAND_IN_MARK = "○"


def show_diagnosis(result: Diagnosis) -> None:
    """Verdict first; what is absent or cannot be seen is summed up in a line each."""
    from kinid.reports.diagnosis_words import acting, beside, doubts, headline, leftover

    out = console()
    colour = COLOUR.get(result.verdict, "bold")
    out.print(Text.assemble((result.verdict, f"bold {colour}"), f": {headline(result)}"), soft_wrap=True)
    if result.says:
        say(out, result.says)
    say(out, *(f"doubt: {warning}" for warning in doubts(result)))
    regions = [region for region in result.where if region.share > 0][:MOST_REGIONS]
    if regions:
        out.print(f"\nwhere the model fails{beside(result)}", style="bold")
        say(out, *(f"  {region.says}" for region in regions))
    out.print(Text.assemble(("\nheld-out error", "bold"), f" [{result.unit} rms]"))
    _steps(out, result)
    out.print(leftover(result), soft_wrap=True)
    _effects(out, result)
    if result.fit.parameters:
        out.print(Text.assemble(("\nthe model now", "bold"), f": {result.best}"), soft_wrap=True)
        out.print(estimates(acting(result.fit.parameters).values(), 4))
    _next(out, result)


def _steps(out: Console, result: Diagnosis) -> None:
    """A bar a step, and the share that is explained by then; the noise is where no bar gets below."""
    from kinid.reports.diagnosis_words import SAME
    from kinid.residuals.words import percent

    steps = [
        (
            "as asked" if step.added is None else f"+ {step.added}",
            step.held_out,
            "" if step.added is None else f"{percent(step.explained)} explained",
        )
        for step in result.steps
    ]
    steps.append(("noise alone", result.noise_floor, ""))
    top = max(error for _, error, _ in steps) or 1.0
    table = Table(show_header=False, box=None, pad_edge=False, padding=(0, 2, 0, 0))
    for i, (name, error, explained) in enumerate(steps):
        shade = "dim" if name == "noise alone" else "red" if name == "as asked" and len(result.steps) > 1 else "blue"
        bar = Text("█" * max(1, round(WIDE * error / top)), shade)
        if 0 < i < len(result.steps) and error > (1.0 + SAME) * steps[i - 1][1]:
            last = i == len(result.steps) - 1
            why = "as readings are weighed by their noise" if last else "beside what follows"
            bar = Text.assemble(bar, (f" helps only {why}", "dim"))
        table.add_row(f"  {name}", f"{error:.4g}", explained, bar)
    out.print(table)


def _effects(out: Console, result: Diagnosis) -> None:
    from kinid.diagnosis.result import EffectGroup
    from kinid.reports.diagnosis_words import by_verdict, verdict_words

    shown = [e for e in by_verdict(result) if e.verdict in MARK]
    if shown:
        numbers = right("evidence", f"gain [{result.unit}]")
        table = Table(
            "effect", "verdict", *numbers, "parameters (95 %)", box=None, pad_edge=False, padding=(0, 2, 0, 0)
        )
        for e in shown:
            mark = STAND_IN_MARK if e.stand_in else MARK[e.verdict]
            evidence = f"{e.evidence:.4g}" if isfinite(e.evidence) else "–"
            table.add_row(
                e.id,
                f"{mark} {verdict_words(e)}",
                evidence,
                f"{e.held_out_gain:.3g}",
                _numbers(e),
            )
        out.print()
        out.print(table)
    for group, words in (
        (EffectGroup.ABSENT, "absent"),
        (EffectGroup.LEFT_OUT, "left out, as no more effects were asked for"),
        (EffectGroup.NOT_EXCITED, "this log cannot tell"),
        (EffectGroup.FOREIGN, "not about logs of this kind, or part of the model already"),
    ):
        names = [e.label for e in result.effects if e.group == group]
        if names:
            say(out, f"{words} ({len(names)}): {', '.join(names)}")


def _numbers(effect: EffectVerdict) -> str:
    from kinid import effects
    from kinid.reports.diagnosis_words import acting, one_sided

    shown = acting(effect.parameters)
    if len(shown) > MOST_NUMBERS:
        return effect.says if effects.get(effect.id).detector else f"{len(shown)} parameters"
    write = "{:.3g}".format
    return ", ".join(
        f"{name} {one_sided(p, write) or f'{write(p.value)} [{write(p.low)}, {write(p.high)}]'}"
        f"{'' if p.unit == '1' else ' ' + p.unit}"
        for name, p in shown.items()
    )


def _next(out: Console, result: Diagnosis) -> None:
    """How to separate rivals first, then how to see what this log doesn't show."""
    from kinid.reports.diagnosis_words import indistinguishable_classes

    rivals = indistinguishable_classes(result)
    hints = [f"{e.id} or {' or '.join(e.equivalent_to)}: {e.separate_by}" for e in rivals]
    hidden = [
        f"{e.id}: {e.separate_by}" for e in result.effects if e.verdict == "not-excited" and e.acts and e.separate_by
    ]
    if not hints and not hidden:
        return
    out.print("\nwhat to measure next", style="bold")
    for hint in [*hints, *hidden][: max(MOST_HINTS, len(hints))]:
        words, colon, command = hint.partition(COMMAND)
        # a command stands on a line of its own, to be copied
        say(out, f"  {words}{colon[:1]}", *([f"    {colon[2:]}{command}"] if command else []))
    more = len(hints) + len(hidden) - max(MOST_HINTS, len(hints))
    if more > 0:
        out.print(f"  and {more} more in the report and the JSON")
