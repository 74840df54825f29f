"""`kinid picture`: what a picture of a mapped surface, or of another one, says of a property."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from kinid.cli import complete
from kinid.errors import InputError

if TYPE_CHECKING:
    from kinid.mapping.picture_map import Sighted

EXAMPLES = """Examples:

kinid picture mould.parquet mould.png --corners=-0.05,-0.05,0.05,0.05

kinid picture mould.parquet mould.png --corners=-0.05,-0.05,0.05,0.05 --onto next.png -o next.parquet --plot next.html
"""
CORNERS = (
    "Where the picture lies, along both tangents from the surface's point [m]: outer corner of its first pixel and of "
    "its last; "
    "rows run along tangent 1, columns along tangent 2. With a minus in front: --corners=-0.05,…"
)
Corners = tuple[tuple[float, float], tuple[float, float]]


def picture(
    grown: Annotated[
        Path, typer.Argument(metavar="MAP", help="A map on a plane: .parquet of kinid map.", show_default=False)
    ],
    image: Annotated[Path, typer.Argument(help="A picture of what was mapped: PNG or JPEG.", show_default=False)],
    corners: Annotated[str, typer.Option(help=CORNERS, show_default=False)],
    shown: Annotated[
        str, typer.Option("--property", help="What is learnt.", autocompletion=complete.mapped)
    ] = "stiffness",
    onto: Annotated[Path | None, typer.Option(help="Another picture to predict from; default: the same.")] = None,
    onto_corners: Annotated[str | None, typer.Option(help="Of the other picture; default: as --corners.")] = None,
    out: Annotated[
        Path | None, typer.Option("-o", "--out", help="The predicted map: .parquet, for view, or as a prior.")
    ] = None,
    cells: Annotated[int, typer.Option(help="Of the predicted map, along its longer side.")] = 30,
    calibrated: Annotated[
        bool,
        typer.Option("--calibrated/--study", help="Calibrated probabilities, or the study's support-vector machine."),
    ] = True,
    json_file: Annotated[Path | None, typer.Option("--json", help="Figures and classes to write as JSON.")] = None,
    plot: Annotated[Path | None, typer.Option(help="The predicted map: one offline HTML file.")] = None,
) -> None:
    """Learns what values look like, says how well that holds for places left out, and predicts a map; strangers stay
    unknown.
    """
    from kinid.mapping.picture_map import Sighted
    from kinid.mapping.property_map import PropertyMap
    from kinid.mapping.vision import Picture
    from kinid.robotics.surface import Plane
    from kinid.writers import check_outputs, write_text

    if not 2 <= cells <= 60:
        raise InputError(f"--cells {cells}", "2 to 60", "correct it")
    if out is not None and out.suffix.lower() != ".parquet":
        raise InputError(f"map '{out.name}'", "a name ending in .parquet", "rename it")
    if onto is None and onto_corners is not None:
        raise InputError("--onto-corners without --onto", "the other picture", "name it with --onto")
    check_outputs((out, json_file, plot), (grown, image, onto))
    place = _corners(corners, "--corners")
    first = Picture.read(image, *place)
    second = (
        first
        if onto is None
        else Picture.read(onto, *(_corners(onto_corners, "--onto-corners") if onto_corners else place))
    )
    known = PropertyMap.read(grown)
    if not isinstance(known.surface, Plane):
        raise InputError("a map on a mesh", "a map on a plane", "map a plane")
    sighted = Sighted.learn(known, shown, first, calibrated=calibrated)
    predicted, unknown = sighted.predicted(second, known.surface, cells)
    facts = sighted.to_dict() | {
        "picture": (onto or image).name,
        "cells": len(predicted) + unknown,
        "unknown_cells": unknown,
    }
    if len(predicted):
        values = predicted.values(shown)
        facts["predicted"] = {"lowest": float(values.min()), "highest": float(values.max())}
    if out is not None and len(predicted):
        predicted.write(out)
    if json_file is not None:
        write_text(json_file, json.dumps(facts, indent=2, ensure_ascii=False) + "\n")
    if plot is not None and len(predicted):
        from kinid.mapping.map_page import map_page

        write_text(plot, map_page(predicted, (onto or image).name, "nearest"))
    _show(sighted, facts)
    if not sighted.tells:
        if out is None and plot is None:
            return
        raise InputError(
            f"a picture that tells nothing of {shown}",
            "one whose colours go with it",
            "leave out -o and --plot, check --corners, or light it so that materials differ",
        )
    if not len(predicted):
        raise InputError(
            f"nothing in {(onto or image).name} that looks like what was learnt",
            "a picture of like materials",
            "poke this one, or light it as the first one",
        )
    from kinid.cli.show import written

    written([path for path in (out, json_file, plot) if path is not None])


def _corners(text: str, option: str) -> Corners:
    """Two corners of four numbers."""
    try:
        a, b, c, d = (float(part) for part in text.split(","))
    except ValueError:
        raise InputError(f"{option} {text}", "four numbers [m]: low1,low2,high1,high2", "correct it") from None
    return (a, b), (c, d)


def _show(sighted: Sighted, facts: dict[str, Any]) -> None:
    from rich.table import Table

    from kinid.cli.show import console

    out, unit = console(), sighted.item.unit
    table = Table("class", box=None, pad_edge=False)
    for heading in ("probes", f"{sighted.item.name} [{unit}]"):
        table.add_column(heading, justify="right")
    for row in facts["classes"]:
        table.add_row(row["name"], str(row["probes"]), f"{row['mean']:.5g}")
    out.print(table)
    held = facts["held_out"]
    table = Table("places left out", box=None, pad_edge=False)
    for heading in ("class recognised", f"error of {sighted.item.name}"):
        table.add_column(heading, justify="right")
    for name, words in (
        ("random_folds", "random folds, as in the study"),
        ("spatial_blocks", "spatial blocks, which is honest"),
    ):
        table.add_row(words, f"{100 * held[name]['recognised']:.1f} %", f"{100 * held[name]['error']:.1f} %")
    table.add_row("the commonest class, without a picture", f"{100 * sighted.figures.commonest:.1f} %", "–")
    out.print(table)
    if not sighted.tells:
        out.print(
            f"doubt: the picture tells nothing of {sighted.item.name}: the commonest class alone is right at "
            f"{100 * sighted.figures.commonest:.1f} % of the places, and values follow no better; nothing is predicted",
            soft_wrap=True,
        )
        return
    share = facts["unknown_cells"] / max(facts["cells"], 1)
    out.print(
        f"{facts['picture']}: {facts['unknown_cells']} of {facts['cells']} cells ({100 * share:.0f} %) look like "
        f"nothing "
        "that was learnt, and stay unknown",
        soft_wrap=True,
    )
    if "predicted" in facts:
        span = facts["predicted"]
        out.print(f"predicted: {span['lowest']:.5g} to {span['highest']:.5g} {unit}", soft_wrap=True)
