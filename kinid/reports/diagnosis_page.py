"""The report of a diagnosis: one offline HTML page, readable on a phone and on paper."""

from __future__ import annotations

import html
import platform
from collections.abc import Iterable, Sequence

import numpy as np
from numpy.typing import NDArray

import kinid
from kinid import effects as catalogue
from kinid.data.log import Provenance
from kinid.diagnosis.result import Diagnosis, EffectGroup, EffectStatus, EffectVerdict
from kinid.identification.fitted import FittedParameter
from kinid.reports.diagnosis_figures import Shown, ladder, loops, readings
from kinid.reports.diagnosis_multiples import multiples
from kinid.reports.diagnosis_words import (
    acting,
    by_verdict,
    doubts,
    headline,
    indistinguishable_classes,
    leftover,
    one_sided,
    verdict_words,
)
from kinid.reports.plots import INK, asset, drawing, grid, key, page
from kinid.residuals import Cell
from kinid.residuals.words import channel_words, number, percent, sentence

Array = NDArray[np.float64]

MARK = {EffectStatus.PRESENT: "●", EffectStatus.INDISTINGUISHABLE: "◐"}
STAND_IN_MARK = "○"
#: first words of the headings of columns that hold numbers
NUMBERS = (
    "evidence",
    "gain",
    "seen",
    "held",
    "over",
    "explained",
    "estimate",
    "from",
    "to",
    "lowest",
    "highest",
    "noise",
    "signal",
    "step",
    "repeated",
    "flat",
)
#: samples at the very same largest reading that are a flat top
FLAT = 5
#: channels whose residual is divided every way, at most
MOST_DIVIDED = 3


def diagnosis_page(result: Diagnosis, title: str, provenance: Provenance | None = None) -> str:
    """A diagnosis as one HTML page.

    Args:
        result: what was found.
        title: of the page.
        provenance: of the log, where the caller has it: its source and what was done to it.
    """
    shown = Shown.of(result)
    curves = grid(loops(shown), wide=True) or "<p class=facts>Nothing is touched.</p>"
    head = "".join(
        (
            _headline(result),
            _section("Error as effects are added", drawing(ladder(result)) + _ladder_words(result)),
            _section("Where the model fails", _where(result.where)),
            _section("What is still left", _left(result)) if shown.after is not None and result.left_where else "",
            _section("Effects", _effects(result)),
            _section("What to measure next", _next(result)),
            _section("The model, with its numbers", _model(result)),
            _section(
                "Measured against predicted",
                _key(shown, measured=True, dashed=not shown.dense)
                + (
                    "<p class=facts>Predictions of each half of the log come from a fit to the other half. Below each: "
                    "what is left, "
                    "measured less predicted; dotted: ± 2 standard deviations of the noise.</p>"
                )
                + grid(readings(shown), wide=True),
            ),
            _section("The residual, divided", _divided(shown)),
            _section("Loops", _key(shown, measured=True, dashed=False) + curves),
            _section("Quality of the data", _quality(result)),
        )
    )
    return page(title, head, [], _provenance(result, provenance), asset("diagnosis.css"))


def _headline(result: Diagnosis) -> str:
    before, after = result.steps[0].held_out, result.steps[-1].held_out
    cards = [("held-out error, as asked", f"{before:.3g} {result.unit}")]
    if result.added:
        cards += [
            ("with what was added", f"{after:.3g} {result.unit}"),
            ("explained of the error", percent(result.explained)),
        ]
    cards += [
        ("noise alone", f"{result.noise_floor:.3g} {result.unit}"),
        ("left beside noise", f"{result.left.excess:.3g} {result.unit}"),
        ("left, of the reading", f"{100 * result.left.share_of_reading:.2g} %"),
        ("tolerance", f"{result.left.tolerance:.3g} {result.unit}"),
    ]
    doubted = "".join(f"<li>{_e(doubt)}</li>" for doubt in doubts(result))
    shown = "".join(f"<div class=card><span>{_e(what)}</span><b>{_e(value)}</b></div>" for what, value in cards)
    return (
        f'<p class="verdict {_e(result.verdict)}"><strong>{_e(result.verdict.capitalize())}.</strong> '
        f"{_e(headline(result))}</p>"
        + (f"<p>{_e(result.says)}</p>" if result.says else "")
        + f"<div class=cards>{shown}</div>"
        + (f"<h3>Doubts</h3><ul>{doubted}</ul>" if doubted else "")
    )


def _ladder_words(result: Diagnosis) -> str:
    rows = [
        (
            _e("as asked" if step.added is None else "+ " + step.added),
            number(step.train),
            number(step.held_out),
            _ratio(step.held_out, result.noise_floor),
            "" if step.added is None else percent(step.explained),
        )
        for step in result.steps
    ]
    heads = ("model", f"seen [{result.unit}]", f"held out [{result.unit}]", "over noise", "explained")
    return f"<p>{_e(leftover(result))}</p>{_table(heads, rows)}" + (
        "<p class=facts>Root mean squares over the same samples on every rung. Bars: held out, from a fit to the other "
        "half of "
        "the log; upright marks: samples seen; grey: what the tolerance allows beside noise. Explained: share of the "
        "first "
        "model's squared error beyond noise that is gone.</p>"
    )


def _ratio(error: float, noise: float) -> str:
    return f"{error / noise:.3g} ×" if noise > 0 else "–"


def _where(cells: Iterable[Cell]) -> str:
    items = "".join(
        f"<li>{_e(cell.says)}<div class=track><div class=bar "
        f'style="width:{max(1.0, 100 * cell.share):.0f}%"></div></div></li>'
        for cell in cells
    )
    if not items:
        return "<p>Nothing beyond noise.</p>"
    return (
        f"<ol class=where>{items}</ol><p class=facts>Shares are of the squared error beyond noise. Parts of different "
        f"kinds "
        "overlap: phases and channels together make up the whole.</p>"
    )


def _left(result: Diagnosis) -> str:
    return f"<p>With all that was added {_e(leftover(result))}</p>{_where(result.left_where)}"


def _next(result: Diagnosis) -> str:
    """How to separate rivals, and where it stands how to see what this log doesn't show."""
    rivals = indistinguishable_classes(result)
    hidden = sum(e.verdict == EffectStatus.NOT_EXCITED and e.acts for e in result.effects)
    out = "".join(
        f"<li><b>{_e(e.id)}</b> or {_e(' or '.join(e.equivalent_to))}: {_e(e.separate_by)}</li>" for e in rivals
    )
    out = f"<ul>{out}</ul>" if out else "<p>No effect that was found has a rival that fits as well.</p>"
    if hidden:
        out += f"<p>This log cannot show {hidden} effects: what to record for each stands among the effects, above.</p>"
    return out


def _effects(result: Diagnosis) -> str:
    """Every effect; what is absent or cannot be seen is folded away on a screen."""
    found = [e for e in by_verdict(result) if e.verdict in MARK]
    table = _table(
        ("effect", "verdict", "evidence", f"gain [{result.unit}]", "parameters (95 %)", "why", "how to tell"),
        [_row(e) for e in found],
        cards=True,
    )
    out = [table if found else "<p>None was found.</p>"]
    out.append(
        "<p class=facts>Evidence: the gain in held-out squared error that the effect brings, over the gain's standard "
        "error; 4 "
        "is the least that is accepted; none for marks in the samples. Gain: by how much the effect lowers the "
        "held-out error. A "
        "stand-in takes off less than is left: it may only follow what the catalogue does not hold.</p>"
    )
    folded = (
        (EffectGroup.LEFT_OUT, "left out, as no more effects were asked for", "how to try"),
        (EffectGroup.NOT_EXCITED, "that this log cannot tell", "what to record"),
        (EffectGroup.ABSENT, "absent", ""),
        (EffectGroup.FOREIGN, "that are not about logs of this kind", "what to record"),
    )
    for group, words, last in folded:
        rest = [e for e in by_verdict(result) if e.group == group]
        if rest:
            heads = ("effect", "evidence", "why", last)
            rows = [(_name(e), _evidence(e), _e(e.says), _e(e.separate_by)) for e in rest]
            width = 4 if last or any(e.separate_by for e in rest) else 3
            out.append(
                f"<details><summary>{len(rest)} {words}: {_e(', '.join(e.label for e in rest))}</summary>"
                f"{_table(heads[:width], [row[:width] for row in rows], cards=True)}</details>"
            )
    return "".join(out)


def _row(e: EffectVerdict) -> tuple[str, ...]:
    gain = number(e.held_out_gain) if np.isfinite(e.held_out_gain) and e.held_out_gain else "–"
    numbers = "<br>".join(_parameter(name, p) for name, p in acting(e.parameters).items())
    mark = STAND_IN_MARK if e.stand_in else MARK[e.verdict]
    return (_name(e), f"{mark} {_e(verdict_words(e))}", _evidence(e), gain, numbers, _e(e.says), _e(e.separate_by))


def _name(e: EffectVerdict) -> str:
    known = catalogue.catalogue()
    return f"<b>{_e(e.id)}</b><br>{_e(known[e.id].title)}" if e.id in known else f"<b>{_e(e.id)}</b>"


def _table(heads: Sequence[str], rows: Iterable[Sequence[str]], *, cards: bool = False) -> str:
    """A table whose cells are HTML; on a narrow screen it scrolls sideways, and only it, or becomes a card a row."""
    kinds = ["num" if head.split(" ")[0] in NUMBERS else "text" for head in heads]
    top = "".join(f"<th class={kind}>{_e(head)}</th>" for kind, head in zip(kinds, heads))
    marks = [f'class={kind} data-of="{_e(head)}"' if cards else f"class={kind}" for kind, head in zip(kinds, heads)]
    body = "".join(f"<tr>{''.join(f'<td {mark}>{cell}</td>' for mark, cell in zip(marks, row))}</tr>" for row in rows)
    opened = "<table class=cards_of>" if cards else "<table>"
    return f"<div class=scroll>{opened}<thead><tr>{top}</tr></thead><tbody>{body}</tbody></table></div>"


def _evidence(effect: EffectVerdict) -> str:
    if effect.verdict == EffectStatus.NOT_EXCITED or not np.isfinite(effect.evidence):
        return "–"
    value = effect.evidence
    if abs(value) < 1000:
        return f"{value:.3g}".replace("-", "−")
    return f"{float(f'{value:.3g}'):,.0f}".replace(",", "\u2009").replace("-", "−")


def _parameter(name: str, p: FittedParameter) -> str:
    unit, end = "" if p.unit == "1" else f" {p.unit}", one_sided(p, number)
    if end:
        return f"{_e(name)} {end}{_e(unit)}"
    return f"{_e(name)} = {number(p.value)} <span class=facts>[{_bound(p.low)}, {_bound(p.high)}]</span>{_e(unit)}"


def _bound(value: float) -> str:
    return number(value) if np.isfinite(value) else "open"


def _model(result: Diagnosis) -> str:
    shown = acting(result.fit.parameters).values()
    rows = [(_e(p.name), number(p.value), _bound(p.low), _bound(p.high), _e(p.unit)) for p in shown]
    table = (
        _table(("parameter", "estimate", "from", "to", "unit"), rows) + "<p class=facts>Intervals: 95 %.</p>"
        if rows
        else ""
    )
    return f"<p>{_e(str(result.best))}</p><pre>{_e(result.fit.equation())}</pre>{table}"


def _divided(shown: Shown) -> str:
    out = [
        _key(shown, measured=False, dashed=True),
        "<p class=facts>Root mean square of what is left, where the error is largest. Dotted: noise.</p>",
    ]
    for row in shown.worst(MOST_DIVIDED):
        out += [f"<h3>{_e(sentence(channel_words(shown.before, row)))}</h3>", grid(multiples(shown, row))]
    return "".join(out)


def _quality(result: Diagnosis) -> str:
    e = result.experiment
    s, n = e.signals, len(e.signals)
    steps = s.dt[s.dt > 0]
    gaps = int((s.dt == 0.0).sum()) - 1
    rate = f"{1 / float(np.median(steps)):.5g} Hz" if len(steps) else "single poses"
    lost = int((steps > 1.5 * np.median(steps)).sum()) if len(steps) else 0
    facts = [
        f"{n} samples over {float(s.t[-1]):.4g} s at {rate}",
        f"{gaps} gap{'' if gaps == 1 else 's'}",
        f"{lost} places where single samples are missing",
        f"{100 * (1 - e.valid.mean()):.3g} % of the samples invalid",
    ]
    if s.joints is None:
        facts.append(f"in contact {100 * e.in_contact.mean():.3g} % of the time")
    if e.band is not None:
        facts.append(f"readings and predictions are compared below {e.band:.3g} Hz")
    rows = []
    for name, unit, values, noise in zip(e.layout.channels, e.layout.units, e.measured, e.noise):
        v = values[e.valid & np.isfinite(values)]
        if len(v):
            rows.append((_e(name), *_channel_quality(v, float(noise)), _e(unit)))
        else:
            rows.append((_e(name), *["–"] * 7, _e(unit)))
    heads = ("channel", "lowest", "highest", "noise", "signal over noise", "step", "repeated", "flat tops", "unit")
    return f"<p>{_e('; '.join(facts))}.</p>{_table(heads, rows, cards=True)}"


def _channel_quality(v: Array, noise: float) -> tuple[str, ...]:
    """Range, noise, signal over noise, step where it is quantised, share of repeated values, samples at one end."""
    swing, away = float(v.std()), np.abs(np.diff(v))
    ratio = f"{max(0.0, 20 * np.log10(swing / noise)):.0f} dB" if noise > 0 and swing > 0 else "–"
    least = float(away[away > 0].min()) if (away > 0).any() else 0.0
    step = number(least) if least > 0.2 * noise else "none"
    same = f"{100 * float((away == 0).mean()):.2g} %" if len(away) else "–"
    ends = max(int((v == v.max()).sum()), int((v == v.min()).sum()))
    flat = f"{ends} samples" if ends >= FLAT and v.max() > v.min() else "none"
    return number(float(v.min())), number(float(v.max())), number(noise), ratio, step, same, flat


def _provenance(result: Diagnosis, provenance: Provenance | None) -> str:
    steps = (
        "".join(f"<li><code>{_e(str(step))}</code></li>" for step in provenance.steps) if provenance is not None else ""
    )
    source = f"Log: {_e(provenance.source)}. " if provenance is not None else ""
    return _section(
        "Provenance",
        (
            f"<p class=facts>{source}Asked about {_e(str(result.model))}; {len(result.effects)} effects of the "
            f"catalogue looked at. "
            f"kinid {_e(kinid.__version__)}, Python {platform.python_version()}, NumPy {np.__version__}.</p>"
            + (
                f"<details open><summary>What was done to the samples</summary><ol>{steps}</ol></details>"
                if steps
                else ""
            )
        ),
    )


def _key(shown: Shown, *, measured: bool, dashed: bool) -> str:
    """Which line is which; `dashed` where the pictures below dash what is dashed."""
    words = {"before": f"before ({shown.result.model})", "after": f"after ({shown.result.best})"}
    lines = [
        (words.get(name, name), colour, "dashed" if dashed and dash == "dash" else "solid")
        for name, _, colour, dash in shown.lines
    ]
    return key([("measured", INK, "solid"), *lines] if measured else lines)


def _section(name: str, inside: str) -> str:
    return f"<section><h2>{_e(name)}</h2>{inside}</section>"


def _e(text: str) -> str:
    return html.escape(text)
