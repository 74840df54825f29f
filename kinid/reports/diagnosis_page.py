"""The report of a diagnosis: one offline HTML page, readable on a phone and on paper."""

from __future__ import annotations

import platform

import numpy as np
from numpy.typing import NDArray

import kinid
from kinid import effects as catalogue
from kinid.data.log import Provenance
from kinid.diagnosis.result import Diagnosis, EffectGroup, EffectStatus, EffectVerdict
from kinid.reports import diagnosis_words as words
from kinid.reports.diagnosis_figures import Shown, ladder, loops, readings
from kinid.reports.diagnosis_multiples import multiples
from kinid.reports.plots import INK, Entry
from kinid.reports.render import render
from kinid.residuals.words import channel_words, number, sentence

Array = NDArray[np.float64]

#: samples at the very same largest reading that are a flat top
FLAT = 5
#: channels whose residual is divided every way, at most
MOST_DIVIDED = 3
#: effects that are folded away: which, in words, and what their last column holds
FOLDED = (
    (EffectGroup.LEFT_OUT, "left out, as no more effects were asked for", "how to try"),
    (EffectGroup.NOT_EXCITED, "that this log cannot tell", "what to record"),
    (EffectGroup.ABSENT, "absent", ""),
    (EffectGroup.FOREIGN, "that are not about logs of this kind", "what to record"),
)


def diagnosis_page(result: Diagnosis, title: str, provenance: Provenance | None = None) -> str:
    """A diagnosis as one HTML page.

    Args:
        result: what was found.
        title: of the page.
        provenance: of the log, where the caller has it: its source and what was done to it.
    """
    shown, ordered = Shown.of(result), words.by_verdict(result)
    return render(
        "diagnosis.html",
        title,
        r=result,
        headline=words.headline(result),
        leftover=words.leftover(result),
        beside=words.beside(result),
        doubts=words.doubts(result),
        ladder=ladder(result),
        after=shown.after is not None,
        found=[e for e in ordered if e.verdict in (EffectStatus.PRESENT, EffectStatus.INDISTINGUISHABLE)],
        folded=[(says, last, [e for e in ordered if e.group == group]) for group, says, last in FOLDED],
        rivals=words.indistinguishable_classes(result),
        hidden=sum(e.verdict == EffectStatus.NOT_EXCITED and e.acts for e in result.effects),
        known=catalogue.catalogue(),
        acting=words.acting,
        one_sided=words.one_sided,
        verdict_words=words.verdict_words,
        number=number,
        evidence=_evidence,
        key=lambda measured, dashed: _key(shown, measured, dashed),
        dense=shown.dense,
        readings=readings(shown),
        divided=[
            (sentence(channel_words(shown.before, row)), multiples(shown, row)) for row in shown.worst(MOST_DIVIDED)
        ],
        loops=list(loops(shown)),
        quality=_quality(result),
        source=provenance,
        versions=f"kinid {kinid.__version__}, Python {platform.python_version()}, NumPy {np.__version__}",
    )


def _evidence(effect: EffectVerdict) -> str:
    if effect.verdict == EffectStatus.NOT_EXCITED or not np.isfinite(effect.evidence):
        return "–"
    value = effect.evidence
    if abs(value) < 1000:
        return number(value)
    return f"{float(f'{value:.3g}'):,.0f}".replace(",", "\u2009").replace("-", "−")


def _quality(result: Diagnosis) -> dict[str, object]:
    """What the samples are like, in words, and each channel with its unit and figures."""
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
    channels = []
    for name, unit, values, noise in zip(e.layout.channels, e.layout.units, e.measured, e.noise):
        v = values[e.valid & np.isfinite(values)]
        channels.append((name, unit, _channel_quality(v, float(noise)) if len(v) else ("–",) * 7))
    return {"facts": facts, "channels": channels}


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


def _key(shown: Shown, measured: bool, dashed: bool) -> list[Entry]:
    """Which line is which; `dashed` where the pictures below dash what is dashed."""
    models = {"before": f"before ({shown.result.model})", "after": f"after ({shown.result.best})"}
    lines = [
        (models.get(name, name), colour, "dashed" if dashed and dash == "dash" else "solid")
        for name, _, colour, dash in shown.lines
    ]
    return [("measured", INK, "solid"), *lines] if measured else lines
