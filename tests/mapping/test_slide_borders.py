"""`kinid map` shows where the slides that it is made of cross from one material to another."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import pytest

from kinid.lab.experiments import prepare
from kinid.lab.materials import DRAGON_SKIN, ECOFLEX, Material, Patch
from kinid.lab.protocol import Slide, five_phases
from kinid.lab.writing import write_log, write_rig

#: where the border is along tangent 1 [m], and how near a border must come [m]
BORDER, NEAR = 1.25e-3, 0.5e-3


def slid(folder: Path, material: Material) -> None:
    """Log and rig of a slide of 30 mm, out and back."""
    setup = prepare("slide", seed=61).replace(
        material=material, script=five_phases(Slide(speed=5e-3, length=15e-3, directions=(0.0,)))
    )
    write_log(folder / "slide.parquet", setup.run().log)
    write_rig(folder, setup)


@pytest.mark.parametrize("two", [True, False])
def test_borders_of_slides_are_in_the_map(tmp_path: Path, run: Callable[..., tuple[int, str, str]], two: bool) -> None:
    patches = (Patch((-0.1, -0.1), (BORDER, 0.1), DRAGON_SKIN), Patch((BORDER, -0.1), (0.1, 0.1), ECOFLEX))
    slid(tmp_path, DRAGON_SKIN.replace(patches=patches) if two else DRAGON_SKIN)
    out, page, facts = (tmp_path / name for name in ("map.parquet", "map.html", "map.json"))
    code, said, error = run("map", tmp_path / "slide.parquet", "-o", out, "--plot", page, "--json", facts)
    assert code == 0, error
    borders = json.loads(facts.read_text())["borders"]
    assert len(borders) == (2 if two else 0)  # there and back
    assert all(abs(border["slip1"] - BORDER) < NEAR and border["log"].endswith("slide.parquet") for border in borders)
    assert ("cross from one material to another 2 times" in said) is two
    assert ("border of slide.parquet" in page.read_text()) is two
