"""What there is to touch: the mould, and effects that are planted in a part of a surface."""

from __future__ import annotations

import numpy as np
import pytest

import kinid
from kinid.errors import InputError
from kinid.lab.campaign import MOTIONS
from kinid.lab.experiments import prepare
from kinid.lab.hidden import hide
from kinid.lab.materials import MOULD, Material, Patch
from kinid.lab.protocol import Poke, five_phases


def test_mould_has_quarters_a_soft_rim_and_a_film() -> None:
    at = lambda x, y: {k: float(v[0]) for k, v in MOULD.at(np.array([x]), np.array([y])).items()}  # noqa: E731
    middles = [at(x, y)["stiffness"] for x, y in ((-0.025, -0.025), (-0.025, 0.025), (0.025, -0.025))]
    np.testing.assert_allclose(middles, [510.0, 732.0, 994.0], rtol=1e-3)
    assert at(-0.049, 0.025)["stiffness"] < 0.6 * 732.0
    film = at(0.025, 0.025)
    assert film["stiffness"] < 400.0
    assert film["stiffness"] + film["layer"] == pytest.approx(2400.0, rel=1e-2)
    assert 510.0 < at(-0.025, 0.0)["stiffness"] < 732.0
    assert MOULD.colors is not None
    colors = MOULD.colors(np.array([-0.03, -0.03, 0.03, 0.03]), np.array([-0.03, 0.03, -0.03, 0.03]))
    assert len(np.unique(np.round(colors, 3), axis=0)) == 4


@pytest.mark.parametrize(("name", "change"), [("free-mould", -0.233), ("walled-mould", 0.185)])
def test_pokes_beside_a_side_read_what_a_block_does_there(name: str, change: float) -> None:
    """At 5 mm from it stiffness and damping are both less at a free side, both more at a wall: from raw logs."""
    found = []
    for x in (-0.045, -0.02):
        script = five_phases(
            MOTIONS["poke"], place=(x, -0.025), height=0.008, free=0.4, hold=0.4, approach=0.8, tilt=0.1
        )
        setup = prepare("poke", material=name, seed=21).replace(script=script)
        fit = kinid.Model("kelvin-voigt").fit(kinid.contact_series(setup.run().log, setup.rig, robot=setup.robot))
        found.append((fit["stiffness"].value, fit["damping"].value))
    (stiffness, damping), (far, slow) = found
    assert stiffness / far == pytest.approx(1 + change, abs=0.02)
    assert damping / slow == pytest.approx(1 + change, abs=0.12)


def _force(place: tuple[float, float], effect: str | None) -> tuple[np.ndarray, np.ndarray]:
    script = five_phases(Poke(0.003, ((0.001, 2.0),), 0.6), place=place, free=0.0, hold=0.3, height=0.006)
    setup = prepare("poke", material="mould", seed=1).replace(script=script)
    if effect is not None:
        setup = hide(setup, effect, 7, ((0.0, -0.05), (0.05, 0.0)))[0]
    motion = setup.run().motion
    return motion.force[:, 2], motion.place[:, 2]


@pytest.mark.parametrize(
    "effect",
    [
        "relaxation",
        "hysteresis",
        "adhesion",
        "stress-softening",
        "stiffening-layer",
        "hertz-exponent",
        "hunt-crossley-damping",
    ],
)
def test_an_effect_can_be_planted_in_one_quarter(effect: str) -> None:
    inside, outside = (0.025, -0.025), (-0.025, -0.025)
    np.testing.assert_array_equal(_force(outside, effect)[0], _force(outside, None)[0])
    assert np.abs(_force(inside, effect)[0] - _force(inside, None)[0]).max() > 0.05


def test_patches_hold_their_own_law_and_the_last_one_wins() -> None:
    soft, hard = Material(stiffness=100.0), Material(stiffness=900.0, exponent=1.5, relaxation=((0.5, 1.0),))
    both = Material(
        stiffness=300.0, patches=(Patch((0.0, 0.0), (0.02, 0.02), soft), Patch((0.01, 0.0), (0.02, 0.02), hard))
    )
    x, y = np.array([-0.01, 0.005, 0.015]), np.full(3, 0.01)
    np.testing.assert_array_equal(both.at(x, y)["stiffness"], [300.0, 100.0, 900.0])
    np.testing.assert_allclose(both.press(x, y, np.full(3, 0.01)), [3.0, 1.0, 900.0 * 0.01**1.5])
    assert both.packed().shape[0] == 3
    assert both.raster()[1].max() == 2
    patches = both.truth()["patches"]
    assert isinstance(patches, list)
    assert patches[1]["material"]["relaxation"] == ((0.5, 1.0),)


def test_what_has_no_place_can_t_be_planted_at_one() -> None:
    setup = prepare("poke")
    for effect in ("sensor-bias", "joint-coulomb-friction", "tip-offset", "surface-offset"):
        with pytest.raises(InputError, match="part of the surface"):
            hide(setup, effect, 1, ((0.0, 0.0), (0.01, 0.01)))
    with pytest.raises(InputError, match="lower one first"):
        hide(setup, "relaxation", 1, ((0.0, 0.0), (0.01, -0.01)))
