"""A map on a terminal and in JSON: ranges of its properties, errors of probes left out, logs that couldn't be used."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from kinid.cli.show import console, plain_table, right, say
from kinid.errors import InputError
from kinid.estimators.estimate import NORMAL_95
from kinid.writers import finite

if TYPE_CHECKING:
    from kinid.mapping.interpolation.uniform import Uniform
    from kinid.mapping.property_map import PropertyMap
    from kinid.mapping.slide_borders import SlideBorder

#: times the noise from which a model fails at a place
FAILING = 3
#: logs that were left out are named, so many
MOST_LEFT_OUT = 20


class Known(NamedTuple):
    """Of a property: how many probes tell it; its range, the median standard error, errors of probes left out, and the
    one value that it has everywhere, None where it differs from place to place.
    """

    name: str
    unit: str
    probes: int
    numbers: tuple[float, float, float]
    held_out: dict[str, float | None]
    uniform: Uniform | None = None


def in_map(grown: PropertyMap) -> list[Known]:
    """What a map holds of each property."""
    out = []
    for item in grown.properties:
        values, errors = grown.values(item.name), grown.deviations(item.name)
        known = np.isfinite(values)
        if not known.any():
            out.append(Known(item.name, item.unit, 0, (np.nan, np.nan, np.nan), {}))
            continue
        numbers = (float(values[known].min()), float(values[known].max()), float(np.median(errors[known])))
        held = {name: finite(error) for name, error in grown.held_out(item.name).items()}
        out.append(Known(item.name, item.unit, int(known.sum()), numbers, held, grown.uniform(item.name)))
    return out


def map_facts(grown: PropertyMap, known: Sequence[Known], new: int, left_out: Mapping[str, str]) -> dict[str, object]:
    """In the words of JSON; a property that no probe tells has no numbers."""
    properties: dict[str, dict[str, object]] = {p.name: {"unit": p.unit, "probes": p.probes} for p in known}
    for p in known:
        if p.probes:
            numbers = dict(zip(("lowest", "highest", "standard_error"), p.numbers))
            uniform = None if p.uniform is None else dataclasses.asdict(p.uniform)
            properties[p.name] |= {**numbers, "held_out": p.held_out, "uniform": uniform}
    return {
        "model": grown.model,
        "probes": len(grown),
        "new": new,
        "properties": properties,
        "failing": int(np.nansum(grown.residual_over_noise > FAILING)),
        "left_out_logs": dict(left_out),
    }


def _open_pieces(grown: PropertyMap) -> int:
    """Pieces of slides that don't tell stiffness."""
    if not any(p.name == "stiffness" for p in grown.properties):
        return 0
    return int(np.sum(_piece(grown) & np.isnan(grown.values("stiffness"))))


def _piece(grown: PropertyMap) -> NDArray[np.bool_]:
    """Which probes are pieces of slides, (n,)."""
    return np.array(["piece" in probe.source.rpartition("#")[2] for probe in grown.probes], np.bool_)


def _shown_by_some(grown: PropertyMap, known: Sequence[Known]) -> list[str]:
    """Which properties only some touches show, as those of a layer, and how many do."""
    touches = ~_piece(grown)
    by_count: dict[int, list[str]] = {}
    for p in known:
        by_count.setdefault(int(np.sum(touches & np.isfinite(grown.values(p.name)))), []).append(p.name)
    total = int(touches.sum())
    return [f"{', '.join(names)}: shown by {n} of {total} touches" for n, names in by_count.items() if 0 < n < total]


def _next(grown: PropertyMap, rig: Path) -> str:
    """The command that asks what the model lacks where it leaves most, or why that log can't be asked."""
    from kinid.cli.advice import to_diagnose
    from kinid.cli.contact import load
    from kinid.modeling.model import Model

    worst = grown.probes[int(np.nanargmax(grown.residual_over_noise))].source
    log = Path(worst if Path(worst).is_file() else worst.rpartition("#")[0])  # of several touches "#0", "#1" …
    if not log.is_file():
        return f"record a log at the worst of them ({worst}), which isn't there any more, and diagnose that"
    try:
        the_rig, data, _ = load(log, rig)
    except InputError as error:
        return f"look at the worst of them: {error}"
    return to_diagnose(log, rig, Model(*grown.model.split(" + ")), data, the_rig)


def show_map(grown: PropertyMap, known: Sequence[Known], new: int, left_out: Mapping[str, str], rig: Path) -> None:
    """Two tables: together they are wider than a terminal."""
    out, probes = console(), len(grown)
    old = f", {probes - new} of them there already" if new < probes else ""
    aside = f"; {len(left_out)} log{'s' * (len(left_out) != 1)} left out" if left_out else ""
    out.print(f"{grown.words}{old}{aside}", soft_wrap=True)
    table = plain_table("property", "unit", *right("lowest", "highest", "standard error"))
    for p in known:
        low, high, error = p.numbers
        numbers = (f"{low:.5g}", f"{high:.5g}", f"{error:.3g}") if p.probes else ("unknown", "unknown", "–")
        table.add_row(p.name, p.unit, *numbers)
    out.print(table)
    if probed := [p for p in known if p.probes]:
        table = plain_table("error of probes left out", *right(*probed[0].held_out))
        for p in probed:
            table.add_row(p.name, *("–" if e is None else f"{e:.3g}" for e in p.held_out.values()))
        out.print(table)
    if open_ := _open_pieces(grown):
        say(
            out,
            f"stiffness: open at {open_} pieces of slides: one depth doesn't tell the law's exponent; "
            "poke in the same log, too, or map whole slides with --along 0",
        )
    say(out, *_shown_by_some(grown, known))
    say(out, *(f"{p.name}: {p.uniform.words(p.unit)}" for p in known if p.uniform is not None))
    if failing := int(np.nansum(grown.residual_over_noise > FAILING)):
        say(
            out,
            f"doubt: at {failing} of {probes} places the model leaves more than {FAILING} times the noise",
            f"next: {_next(grown, rig)}",
        )
    say(out, *(f"left out: {path}: {why}" for path, why in list(left_out.items())[:MOST_LEFT_OUT]))
    if len(left_out) > MOST_LEFT_OUT:
        out.print(f"left out: {len(left_out) - MOST_LEFT_OUT} more")


def show_borders(borders: Sequence[SlideBorder]) -> None:
    """How many borders slides crossed, and how well the places are known; nothing where none was found."""
    if not borders:
        return
    doubtful = sum(bool(border.change.doubt) for border in borders)
    shown = [border.change.sd for border in borders if not border.change.doubt]
    sure = f", known to ± {1e3 * NORMAL_95 * float(np.median(shown)):.2g} mm (95 %, median)" if shown else ""
    doubt = f"; {doubtful} more that one way alone shows (kinid changes LOG)" if doubtful else ""
    say(console(), f"slides cross from one material to another {len(shown)} times{sure}{doubt}")
