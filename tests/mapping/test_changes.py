"""Borders found along slides of the virtual arm: all of them, in both directions, where they are."""

from __future__ import annotations

import dataclasses
from functools import cache

import numpy as np
import pytest

import kinid
from kinid.contact.series import ContactSeries
from kinid.errors import InputError
from kinid.lab.experiments import prepare
from kinid.lab.materials import DRAGON_SKIN, ECOFLEX, ECOFLEX_30, SPONGE, Material, Patch
from kinid.lab.protocol import Slide, five_phases
from kinid.mapping.changes import Change, find_changes

#: how near a border must come [m]
NEAR = 0.5e-3
#: borders between the raster's points, so that they are where they are said to be [m], and what lies between them
CASES: dict[str, tuple[tuple[float, ...], tuple[Material, ...], float]] = {
    "one": ((1.25e-3,), (DRAGON_SKIN, ECOFLEX), 0.0),
    "three": ((-7.25e-3, 1.75e-3, 8.25e-3), (ECOFLEX, DRAGON_SKIN, ECOFLEX_30, SPONGE), 0.0),
    "four, aslant": ((-5.75e-3, -1.25e-3, 3.25e-3, 7.25e-3), (ECOFLEX, SPONGE, ECOFLEX, SPONGE, DRAGON_SKIN), 0.4),
}


@cache
def slid(borders: tuple[float, ...], stripes: tuple[Material, ...], angle: float, seed: int) -> ContactSeries:
    """Out and back across stripes whose borders lie along tangent 1."""
    edges = (-0.1, *borders, 0.1)
    patches = tuple(Patch((a, -0.1), (b, 0.1), m) for a, b, m in zip(edges, edges[1:], stripes))
    script = five_phases(Slide(speed=5e-3, length=15e-3, directions=(angle,)))
    setup = prepare("slide", seed=seed).replace(material=stripes[0].replace(patches=patches), script=script)
    return kinid.contact_series(setup.run().log, setup.rig)


@pytest.mark.parametrize("case", CASES)
def test_all_borders_are_found_where_they_are(case: str) -> None:
    borders, stripes, angle = CASES[case]
    touch = slid(borders, stripes, angle, 61)
    found = find_changes(touch)
    errors = [min(abs(change.slip1 - border) for border in borders) for change in found]
    print(f"{case}: {len(found)} crossings, errors {1e3 * np.array(errors)} mm, sd {[1e3 * c.sd for c in found]}")
    assert max(errors) <= NEAR
    assert max(change.sd for change in found) <= NEAR
    for border in borders:  # to the right and back; the first and the last leg begin in the middle
        near = [change for change in found if abs(change.slip1 - border) < NEAR]
        assert len(near) == 2
        assert _direction(near[0]) == -_direction(near[1])
    for change, error in zip(found, errors):
        assert error < 4 * change.sd  # one in 16 000 by chance
        assert np.interp(change.t, touch.t, touch.slip1) == pytest.approx(change.slip1, abs=2e-4)
        if change.sd > 0.06e-3:  # too near to a leg's end to see what lies behind it
            continue
        # it says what lies on both sides, in the order of time
        k = int(np.argmin(np.abs(np.array(borders) - change.slip1)))
        sides = stripes[k : k + 2] if _direction(change) > 0 else stripes[k : k + 2][::-1]
        for felt, material in zip((change.before, change.after), sides):
            assert felt.stiffness == pytest.approx(material.stiffness, rel=0.1)
            assert felt.friction == pytest.approx(material.friction, rel=0.1)
    assert [change.t for change in found] == sorted(change.t for change in found)
    assert not any(change.doubt for change in found)


def _direction(change: Change) -> float:
    return float(np.sign(np.cos(change.direction)))


def test_one_material_has_no_border() -> None:
    for seed in range(62, 65):
        assert find_changes(slid((), (ECOFLEX,), 0.0, seed)) == []


@pytest.mark.parametrize(("ratio", "constant"), [(0.34, 0.6), (0.5, 1.0), (0.3, 3.0)])
def test_steps_that_go_with_time_are_doubted(ratio: float, constant: float) -> None:
    """One material that relaxes behind each turn: what looks like a border isn't there on the way back."""
    found = find_changes(slid((), (ECOFLEX.replace(relaxation=((ratio, constant),)),), 0.0, 61))
    assert found
    assert all(change.doubt for change in found)


def test_a_border_that_a_single_way_shows_is_doubted() -> None:
    borders, stripes, angle = CASES["one"]
    touch = slid(borders, stripes, angle, 61)
    back = find_changes(touch)[1].t
    once = dataclasses.replace(touch, in_contact=touch.in_contact & (np.abs(touch.t - back) > 2.0))
    (alone,) = find_changes(once)
    assert alone.doubt == "nothing slid back across it"


def test_what_cannot_be_asked_is_said() -> None:
    touch = slid((), (ECOFLEX,), 0.0, 62)
    with pytest.raises(InputError, match="false-alarm"):
        find_changes(touch, 0.0)
    poke = prepare("poke")
    with pytest.raises(InputError, match="slide further"):
        find_changes(kinid.contact_series(poke.run().log, poke.rig))
