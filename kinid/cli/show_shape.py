"""A surface that touches found, in words and in JSON."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from kinid.cli.show import console, plain_table, right, say
from kinid.estimators.estimate import NORMAL_95

if TYPE_CHECKING:
    from kinid.mapping.shape import Shape, Sheet
    from kinid.mapping.shape.exploration import NextTouch

#: normals that scatter by more about the surface are doubted [rad]
SCATTERED = np.deg2rad(5.0)


def shape_lines(shape: Shape, sheet: Sheet) -> list[str]:
    """What a reader wants to know of it, doubts at the end."""
    length, width = 1e3 * np.ptp(sheet.flat, axis=0)
    known = 1e3 * NORMAL_95 * sheet.located.sd
    left, tilt = 1e3 * float(np.sqrt(np.mean(shape.left_out**2))), shape.implicit.learnt.tilt
    lines = [
        f"surface of {length:.3g} × {width:.3g} mm from {len(shape.touches.touches)} touches, known along its normal "
        f"to ± {np.median(known):.2g} mm (95 %, median), ± {known.max():.2g} mm at most",
        f"touches left out lie {left:.2g} mm rms from what the others say",
    ]
    if tilt > SCATTERED:
        lines.append(
            f"doubt: forces turn {np.rad2deg(tilt):.2g}° rms away from the normals: press straight in and out, so that "
            "friction cancels"
        )
    if (ball := 1e3 * shape.touches.tip_radius) > 0.0:
        short = ball * (1.0 - float((sheet.located.normals @ shape.plane.normal).min()))
        lines.append(
            f"the surface is where a ball of {ball:.3g} mm touches; kinid contact counts depth from the tool's end, "
            f"which on its slopes gives up to {short:.2g} mm too little: without --tip-radius the mesh is where that "
            "end begins to touch"
        )
    return lines


def shape_facts(shape: Shape, sheet: Sheet, proposed: Sequence[NextTouch]) -> dict[str, object]:
    """The same for JSON, with the touches, and those proposed."""
    learnt, sd = shape.implicit.learnt, sheet.located.sd
    touches = zip(shape.touches.touches, shape.left_out)
    return {
        "plane": {"point": shape.plane.point.tolist(), "normal": shape.plane.normal.tolist()},
        "tip_radius": shape.touches.tip_radius,
        "place_sd": {"median": float(np.median(sd)), "largest": float(sd.max())},
        "left_out": float(np.sqrt(np.mean(shape.left_out**2))),
        "hyperparameters": {
            "smoothness": "infinite" if np.isinf(learnt.smoothness) else learnt.smoothness,
            "length": learnt.length,
            "size": learnt.size,
            "roughness": learnt.roughness,
            "tilt": learnt.tilt,
        },
        "touches": [
            {
                "source": touch.probe.source,
                "place": touch.probe.place.tolist(),
                "normal": touch.normal.tolist(),
                "place_sd": touch.place_sd,
                "left_out": float(left),
                "values": touch.probe.values.tolist(),
                "sd": np.sqrt(np.diag(touch.probe.covariance)).tolist(),
            }
            for touch, left in touches
        ],
        "next": [
            {
                "place": each.place.tolist(),
                "direction": each.direction.tolist(),
                "place_sd": each.place_sd,
                "property_sd": each.property_sd,
            }
            for each in proposed
        ],
    }


def show_shape(lines: Sequence[str], proposed: Sequence[NextTouch], of: str, mesh: Path) -> None:
    """The surface in words, as the rig states it for other commands, and touches that are proposed."""
    out = console()
    say(out, *lines, "for the rig, whose folder the mesh must be in or below:", "[surface]", f'mesh = "{mesh.name}"')
    if not proposed:
        return
    table = plain_table(
        "next touch", *right("x [m]", "y", "z", "direction x", "y", "z", "surface ± [mm]", f"{of} ± [%]")
    )
    for number, each in enumerate(proposed, 1):
        place, direction = (f"{value:.4f}" for value in each.place), (f"{value:.3f}" for value in each.direction)
        sds = f"{1e3 * NORMAL_95 * each.place_sd:.2g}", f"{100 * NORMAL_95 * each.property_sd:.2g}"
        table.add_row(str(number), *place, *direction, *sds)
    out.print(table)
