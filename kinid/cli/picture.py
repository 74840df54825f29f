"""`kinid picture`: what a picture of a mapped surface, or of another one, says of a property."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from kinid.cli import complete
from kinid.cli.options import PAGE, numbers
from kinid.errors import InputError

if TYPE_CHECKING:
    from kinid.mapping.picture import Picture
    from kinid.mapping.picture_map import Sighted
    from kinid.mapping.property_map import PropertyMap

EXAMPLES = """Examples:

kinid picture mould.parquet mould.png --corners=-0.05,-0.05,0.05,0.05

kinid picture mould.parquet mould.png --corners=-0.05,-0.05,0.05,0.05 --onto next.png -o next.parquet --plot next.html

kinid picture mould.parquet mould.png --corners=-0.05,-0.05,0.05,0.05 --study --rgb --patch 50 --limits 600,920,1500
"""
CORNERS = (
    "Where the picture lies, along both tangents from the surface's point [m]: outer corner of its first pixel and of "
    "its last; "
    "rows run along tangent 1, columns along tangent 2. With a minus in front: --corners=-0.05,…"
)
Corners = tuple[tuple[float, float], tuple[float, float]]


# as long as its options and their help
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
    classes: Annotated[
        int | None, typer.Option(help="Of values. Default: as many as their sizes ask for, six at most.")
    ] = None,
    limits: Annotated[
        str | None, typer.Option(help="Between the classes, in the property's unit: 300,900,2000.", show_default=False)
    ] = None,
    patch: Annotated[int, typer.Option(help="Side of the patch around a place that is looked at [pixels].")] = 9,
    texture: Annotated[
        bool, typer.Option("--texture/--rgb", help="Colour and texture of a patch, or its mean colour alone.")
    ] = True,
    grey_world: Annotated[
        bool,
        typer.Option(
            "--grey-world", help="Colours relative to their mean: for another picture under another light or camera."
        ),
    ] = False,
    oversample: Annotated[
        bool, typer.Option("--oversample", help="Balanced class weights, as if rare classes had more samples.")
    ] = False,
    confusion: Annotated[
        Path | None, typer.Option(help="What left-out places were taken for: one offline HTML file.", callback=PAGE)
    ] = None,
    json_file: Annotated[Path | None, typer.Option("--json", help="Figures and classes to write as JSON.")] = None,
    plot: Annotated[Path | None, typer.Option(help="The predicted map: one offline HTML file.", callback=PAGE)] = None,
) -> None:
    """Learns what values look like, says how well that holds for places left out, and predicts a map; strangers stay
    unknown.
    """
    from kinid.mapping.map_file import check_map_name
    from kinid.mapping.picture_map import Sighted
    from kinid.mapping.property_map import PropertyMap
    from kinid.robotics.surface import Plane
    from kinid.writers import check_outputs, write_json

    if not 2 <= cells <= 60:
        raise InputError(f"--cells {cells}", "2 to 60", "correct it")
    if out is not None:
        check_map_name(out)
    if onto is None and onto_corners is not None:
        raise InputError("--onto-corners without --onto", "the other picture", "name it with --onto")
    check_outputs((out, json_file, plot, confusion), (grown, image, onto))
    between = _between(limits)
    read = partial(_read, patch=patch, texture=texture, grey_world=grey_world)
    first = second = read(image, _corners(corners, "--corners"))
    if onto is not None:
        second = read(onto, _corners(onto_corners or corners, "--onto-corners"))
    known = PropertyMap.read(grown)
    if not isinstance(known.surface, Plane):
        raise InputError("a map on a mesh", "a map on a plane", "map a plane")
    sighted = Sighted.learn(
        known, shown, first, calibrated=calibrated, balanced=oversample, classes=classes, limits=between
    )
    predicted, unknown = sighted.predicted(second, known.surface, cells)
    name = (onto or image).name
    if out is not None and len(predicted):
        predicted.write(out)
    if json_file is not None:
        write_json(json_file, _facts(sighted, predicted, unknown, name))
    if confusion is not None:
        _write_confusion(confusion, sighted, image.name)
    if plot is not None and len(predicted):
        _write_map(plot, predicted, name)
    _show(sighted, predicted, unknown, name)
    if not sighted.tells and out is None and plot is None:
        return
    _refuse_nothing(sighted, predicted, name)
    from kinid.cli.show import written

    written((out, json_file, plot, confusion))


def _between(limits: str | None) -> tuple[float, ...]:
    return () if limits is None else numbers(limits, "--limits", "values between the classes, in rising order")


def _read(path: Path, corners: Corners, *, patch: int, texture: bool, grey_world: bool) -> Picture:
    from kinid.mapping.picture import Picture

    found = Picture.read(path, *corners, patch=patch, texture=texture)
    return found.grey_world() if grey_world else found


def _refuse_nothing(sighted: Sighted, predicted: PropertyMap, name: str) -> None:
    """Refuse a picture that predicts nothing."""
    if not sighted.tells:
        raise InputError(
            f"a picture that tells nothing of {sighted.item.name}",
            "one whose colours go with it",
            "leave out -o and --plot, check --corners, or light it so that materials differ",
        )
    if not len(predicted):
        raise InputError(
            f"nothing in {name} that looks like what was learnt",
            "a picture of like materials",
            "poke this one, or light it as the first one",
        )


def _write_confusion(path: Path, sighted: Sighted, name: str) -> None:
    """The page of what left-out places of a picture were taken for."""
    from kinid.mapping.confusion_page import confusion_page
    from kinid.writers import write_text

    write_text(path, confusion_page(sighted, name))


def _write_map(path: Path, predicted: PropertyMap, name: str) -> None:
    """The page of a predicted map."""
    from kinid.mapping.map_page import map_page
    from kinid.writers import write_text

    write_text(path, map_page(predicted, name, "nearest"))


def _corners(text: str, option: str) -> Corners:
    from kinid.data.plausible import FARTHEST

    expected = f"four numbers [m], each below {FARTHEST:g}: low1,low2,high1,high2"
    a, b, c, d = numbers(text, option, expected, counts=(4,), below=FARTHEST)
    return (a, b), (c, d)


def _facts(sighted: Sighted, predicted: PropertyMap, unknown: int, name: str) -> dict[str, object]:
    """For JSON."""
    facts: dict[str, object] = sighted.to_dict() | {
        "picture": name,
        "cells": len(predicted) + unknown,
        "unknown_cells": unknown,
    }
    if len(predicted):
        values = predicted.values(sighted.item.name)
        facts["predicted"] = {"lowest": float(values.min()), "highest": float(values.max())}
    return facts


def _show(sighted: Sighted, predicted: PropertyMap, unknown: int, name: str) -> None:
    from kinid.cli.show import console, plain_table, right, say

    out, seen, item = console(), sighted.figures, sighted.item
    table = plain_table("class", *right("probes", f"{item.name} [{item.unit}]"))
    for kind, count, level in zip(sighted.classifier.classes, sighted.counts, sighted.levels):
        table.add_row(kind, str(int(count)), f"{level:.5g}")
    out.print(table)
    table = plain_table("places left out", *right("class recognised", f"error of {item.name}"))
    for words, recognised, error in (
        ("random folds, as in the study", seen.random_folds, sighted.errors[0]),
        ("spatial blocks, which is honest", seen.spatial_blocks, sighted.errors[1]),
    ):
        table.add_row(words, f"{100 * recognised:.1f} %", f"{100 * error:.1f} %")
    table.add_row("the commonest class, without a picture", f"{100 * seen.commonest:.1f} %", "–")
    out.print(table)
    table = plain_table("left out in blocks", *right(*(f"taken for {kind.split()[-1]}" for kind in seen.classes)))
    for kind, row in zip(seen.classes, seen.confusion[1]):
        table.add_row(kind, *(str(int(count)) for count in row))
    out.print(table)
    if not sighted.tells:
        say(
            out,
            f"doubt: the picture tells nothing of {item.name}: the commonest class alone is right at "
            f"{100 * seen.commonest:.1f} % of the places, and values follow no better; nothing is predicted",
        )
        return
    cells = len(predicted) + unknown
    say(
        out,
        f"{name}: {unknown} of {cells} cells ({100 * unknown / max(cells, 1):.0f} %) look like nothing that was "
        "learnt, and stay unknown",
    )
    if len(predicted):
        values = predicted.values(item.name)
        say(out, f"predicted: {values.min():.5g} to {values.max():.5g} {item.unit}")
