"""Results as short tables on a terminal; plain text where the output is piped."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from rich.console import Console
from rich.table import Column, Table

if TYPE_CHECKING:
    from kinid.contact.analysis import Analysis
    from kinid.contact.registration import FoundSurface
    from kinid.data.log import Log
    from kinid.identification.compare import Comparison
    from kinid.identification.fit import Fit
    from kinid.identification.fitted import FittedParameter
    from kinid.identification.pooling.result import PooledFit

#: a log without a touch that stays so far from the surface [m] was probably not meant
FAR_AWAY = 0.1
#: steps of an analysis that are shown
SHOWN_STEPS = ("surface", "wrench", "differentiate", "left out")


def console() -> Console:
    """Standard output; when piped, wide enough that no row is folded.

    Words are printed as they are: a unit in brackets is no markup. What has a colour is a `Text`.
    """
    out = Console(highlight=False, markup=False)
    return out if out.is_terminal else Console(highlight=False, markup=False, width=140)


def right(*headings: str) -> Iterator[Column]:
    """Columns of numbers."""
    return (Column(heading, justify="right") for heading in headings)


def plain_table(*columns: str | Column) -> Table:
    """A table without lines."""
    return Table(*columns, box=None, pad_edge=False)


def say(out: Console, *lines: str) -> None:
    """Lines that the terminal folds."""
    for line in lines:
        out.print(line, soft_wrap=True)


def estimates(parameters: Iterable[FittedParameter], digits: int) -> Table:
    """Estimates with intervals."""
    table = plain_table("parameter", *right("estimate", "95 % from", "to"), "unit")
    for p in parameters:
        table.add_row(p.name, *(f"{value:.{digits}g}" for value in (p.value, p.low, p.high)), p.unit)
    return table


def show_analysis(result: Analysis, log: Log) -> None:
    """Samples and contact, ranges of all quantities, joint torques."""
    out, facts = console(), result.summary()
    _show_samples(out, log)
    if result.contact is not None:
        out.print(f"in contact {100 * facts['in_contact']:.1f} % of the time, {facts['touches']} touches")
        nearest = (facts["ranges"].get("depth") or {"max": 0.0})["max"]
        if not facts["touches"] and nearest < -FAR_AWAY:
            say(
                out,
                f"doubt: the tip comes no nearer to the surface than {-1e3 * nearest:.0f} mm: check [surface], the "
                "tool's tip, and the unit of the joints",
            )
    say(out, *(f"{step}" for step in result.provenance.steps if step.name in SHOWN_STEPS))
    say(out, *(f"doubt: {warning}" for warning in result.provenance.warnings))
    _show_ranges(out, facts["ranges"])
    if result.torques is not None:
        table = plain_table("joint", *right("measured rms", "residual rms [N·m]"))
        for name, row in facts["joint_torques"].items():
            table.add_row(name, f"{row['measured_rms']:.3f}", f"{row['residual_rms']:.3f}")
        out.print("joint torques against inverse dynamics:")
        out.print(table)


def _show_samples(out: Console, log: Log) -> None:
    rate = f"{1 / log.period:.5g} Hz" if log.period > 0 and len(log) > 1 else "one sample"
    line = f"{len(log)} samples over {log.t[-1] - log.t[0]:.4g} s at {rate}"
    if not log.valid.all():
        line += f"; {int((~log.valid).sum())} invalid samples left empty"
    if len(log.pieces) > 1:
        line += f"; {len(log.pieces) - 1} gaps"
    out.print(line)


def _show_ranges(out: Console, ranges: Mapping[str, Mapping[str, float] | None]) -> None:
    """Lowest and highest value of each quantity but joint torques, which have a table of their own."""
    from kinid.contact.analysis import UNITS

    table = plain_table("quantity", "unit", *right("lowest", "highest"))
    for name, span in ranges.items():
        if name.startswith("tau"):
            continue
        unit = UNITS.get(name.removesuffix("_sd")) or (
            "N" if name.startswith("force") else "m/s" if "_v" in name else "m"
        )
        ends = ("unknown", "unknown") if span is None else (f"{span['min']:.5g}", f"{span['max']:.5g}")
        table.add_row(name, unit, *ends)
    if table.row_count:
        out.print(table)


def show_surface(found: FoundSurface) -> None:
    """The plane that touches gave, with its uncertainty, and as the rig states it for other commands."""
    out = console()
    say(out, *found.lines(), "for the rig, which fit and diagnose read it from:", *found.toml())


def show_fit(result: Fit) -> None:
    """Estimates with intervals, errors, the equation, doubts."""
    out, error = console(), result.error
    out.print(result.equation(), soft_wrap=True)
    if result.parameters:
        out.print(estimates(result.parameters.values(), 5))
    out.print(
        f"error {error.train:.4g} {error.unit} rms on samples seen, {error.held_out:.4g} on samples held out; "
        f"the noise is {error.noise_floor:.4g}",
        soft_wrap=True,
    )
    say(out, *(f"doubt: {warning}" for warning in result.warnings))


def show_comparison(result: Comparison) -> None:
    """Models by rank, with held-out error and the paired difference to the reference; which is best, if one is."""
    from kinid.reports.fit_plots import winner

    out = console()
    numbers = right(f"held-out error [{result.unit}]", "difference", "± standard error")
    table = plain_table("rank", "model", *numbers, "doubts")
    for row in result.rows:
        name = str(row.fit.model)
        same = name == result.reference
        table.add_row(
            str(row.rank),
            name,
            f"{row.held_out:.4g}",
            "reference" if same else f"{row.difference:+.3g}",
            "" if same else f"{row.standard_error:.2g}",
            str(len(row.fit.warnings) or ""),
        )
    out.print(table)
    say(
        out,
        winner(result),
        f"the noise is {result.noise_floor:.4g} {result.unit}; a difference is the mean over blocks of time, each of "
        f"which counts alike, of the error less that of {result.reference}",
        *shared_warnings([row.fit for row in result.rows]),
    )


def shared_warnings(fits: Sequence[Fit | PooledFit]) -> list[str]:
    """What to doubt of models side by side, each once; whose it is stands before it, where it isn't of all."""
    of: dict[str, list[str]] = {}
    for fit in fits:
        for warning in fit.warnings:
            of.setdefault(warning, []).append(str(fit.model))
    return [
        f"doubt: {warning}" if 1 < len(fits) == len(names) else f"doubt: {'; '.join(names)}: {warning}"
        for warning, names in of.items()
    ]


def written(paths: Iterable[Path | None]) -> None:
    """Say where results are, of those that were asked for."""
    out = console()
    for path in paths:
        if path is not None:
            out.print(f"wrote {path}", soft_wrap=True)
