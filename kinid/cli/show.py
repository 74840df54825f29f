"""Results as short tables on a terminal; plain text where the output is piped."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING

from rich.console import Console
from rich.markup import escape
from rich.table import Table

if TYPE_CHECKING:
    from kinid.contact.analysis import Analysis
    from kinid.contact.registration import FoundSurface
    from kinid.data.log import Log
    from kinid.identification.compare import Comparison
    from kinid.identification.fit import Fit


#: a log without a touch that stays so far from the surface [m] was probably not meant
FAR_AWAY = 0.1


def console() -> Console:
    """Standard output; when piped, wide enough that no row is folded."""
    out = Console(highlight=False)
    return out if out.is_terminal else Console(highlight=False, width=140)


def show_analysis(result: Analysis, log: Log) -> None:
    """Samples and contact, ranges of all quantities, joint torques."""
    from kinid.contact.analysis import UNITS

    out, facts = console(), result.summary()
    rate = f"{1 / log.period:.5g} Hz" if log.period > 0 and len(log) > 1 else "one sample"
    line = f"{len(log)} samples over {log.t[-1] - log.t[0]:.4g} s at {rate}"
    if not log.valid.all():
        line += f"; {int((~log.valid).sum())} invalid samples left empty"
    if len(log.pieces) > 1:
        line += f"; {len(log.pieces) - 1} gaps"
    out.print(line)
    if result.contact is not None:
        out.print(f"in contact {100 * facts['in_contact']:.1f} % of the time, {facts['touches']} touches")
        nearest = (facts["ranges"].get("depth") or {"max": 0.0})["max"]
        if not facts["touches"] and nearest < -FAR_AWAY:
            out.print(
                f"doubt: the tip comes no nearer to the surface than {-1e3 * nearest:.0f} mm: check \\[surface], the "
                "tool's tip, and the unit of the joints",
                soft_wrap=True,
            )
    for step in result.provenance.steps:
        if step.name in ("surface", "wrench", "differentiate"):
            out.print(f"{step}", soft_wrap=True, markup=False)
    for warning in result.provenance.warnings:
        out.print(f"doubt: {escape(warning)}", soft_wrap=True)
    table = Table("quantity", "unit", box=None, pad_edge=False)
    for heading in ("lowest", "highest"):
        table.add_column(heading, justify="right")
    for name, span in facts["ranges"].items():
        if name.startswith("tau"):
            continue
        unit = UNITS.get(name) or ("N" if name.startswith("force") else "m/s" if "_v" in name else "m")
        if span is None:
            table.add_row(name, unit, "unknown", "unknown")
        else:
            table.add_row(name, unit, f"{span['min']:.5g}", f"{span['max']:.5g}")
    if table.row_count:
        out.print(table)
    if result.torques is not None:
        table = Table("joint", box=None, pad_edge=False)
        for heading in ("measured rms", "residual rms [N·m]"):
            table.add_column(heading, justify="right")
        for name, row in facts["joint_torques"].items():
            table.add_row(name, f"{row['measured_rms']:.3f}", f"{row['residual_rms']:.3f}")
        out.print("joint torques against inverse dynamics:")
        out.print(table)


def show_surface(found: FoundSurface) -> None:
    """The plane that touches gave, with its uncertainty."""
    out = console()
    for line in found.lines():
        out.print(line, soft_wrap=True)


def show_fit(result: Fit) -> None:
    """Estimates with intervals, errors, the equation, doubts."""
    out = console()
    out.print(result.equation(), soft_wrap=True)
    table = Table("parameter", box=None, pad_edge=False)
    for heading in ("estimate", "95 % from", "to"):
        table.add_column(heading, justify="right")
    table.add_column("unit")
    for p in result.parameters.values():
        table.add_row(escape(p.name), f"{p.value:.5g}", f"{p.low:.5g}", f"{p.high:.5g}", p.unit)
    if table.row_count:
        out.print(table)
    error = result.error
    out.print(
        f"error {error.train:.4g} {error.unit} rms on samples seen, {error.held_out:.4g} on samples held out; "
        f"the noise is {error.noise_floor:.4g}",
        soft_wrap=True,
    )
    for warning in result.warnings:
        out.print(f"doubt: {escape(warning)}", soft_wrap=True)


def show_comparison(result: Comparison) -> None:
    """Models by rank, with held-out error and the paired difference to the reference."""
    out = console()
    table = Table("rank", "model", box=None, pad_edge=False)
    for heading in (f"held-out error [{result.unit}]", "difference", "± standard error"):
        table.add_column(heading, justify="right")
    table.add_column("doubts")
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
    out.print(
        f"the noise is {result.noise_floor:.4g} {result.unit}; differences are to {result.reference}", soft_wrap=True
    )
    for row in result.rows:
        for warning in row.fit.warnings:
            out.print(f"doubt: {row.fit.model}: {escape(warning)}", soft_wrap=True)


def written(paths: Iterable[Path]) -> None:
    """Say where results are."""
    out = console()
    for path in paths:
        out.print(f"wrote {path}", soft_wrap=True)
