"""Hidden effects: every one of the catalogue can be planted, and shows."""

from __future__ import annotations

import numpy as np
import pytest

from kinid.errors import InputError
from kinid.lab.experiments import prepare
from kinid.lab.hidden import PLANTS, hide


def test_every_effect_can_be_hidden() -> None:
    """Every effect of the catalogue but the laws that a model starts from; it changes what is logged."""
    from kinid import effects

    assert set(PLANTS) == {name for name, effect in effects.catalogue().items() if not effect.base}
    setup = prepare("ecoflex-50", seed=1)
    for name in PLANTS:
        truth = hide(setup, name, 7)[1]
        assert truth == hide(setup, name, 7)[1]
        assert truth["effect"] == name
        assert hide(setup, name, 8)[1] != truth or name == "quantization"


@pytest.mark.slow
@pytest.mark.parametrize("name", sorted(PLANTS))
def test_hidden_effects_show(name: str) -> None:
    setup = prepare("ecoflex-50", seed=1)
    log, other = setup.run().log, hide(setup, name, 7)[0].run().log
    assert log.tau is not None
    changed = (
        np.abs(np.asarray(log.wrench) - np.asarray(other.wrench)).max() > 0.02
        or np.abs(log.tau - other.tau).max() > 0.02
    )
    assert changed or not np.array_equal(log.q, other.q)


@pytest.mark.parametrize("name", ["hertz-exponent", "viscous-damping", "coulomb-friction", "stiffening-layer"])
def test_what_changes_over_a_surface_gives_way_to_what_is_planted(name: str) -> None:
    setup = prepare("mould")
    planted, truth = hide(setup, name, 7)
    x, y = np.array([-0.02, 0.02]), np.array([0.02, -0.02])
    before, after = setup.material.at(x, y), planted.material.at(x, y)
    parameters = truth["parameters"]
    assert isinstance(parameters, dict)
    if name == "hertz-exponent":
        assert planted.material.exponent == parameters["exponent"]
        ratio = after["stiffness"] / before["stiffness"]
        assert ratio[0] == pytest.approx(ratio[1])  # still a mould of different quarters
        assert ratio[0] > 3.0
    else:
        prop, parameter = {
            "viscous-damping": ("damping", "damping"),
            "coulomb-friction": ("friction", "coefficient"),
            "stiffening-layer": ("layer", "stiffness"),
        }[name]
        np.testing.assert_array_equal(after[prop], parameters[parameter])


def test_a_saturation_comes_with_the_offset_that_it_needs() -> None:
    """The push, and not the hanging tool, comes to the end of the range; an offset that was planted is told."""
    for name in ("ecoflex-50", "sponge", "band"):
        nominal = prepare(name, seed=1)
        planted, truth = hide(nominal, "saturation", 7)
        parameters = truth["parameters"]
        assert isinstance(parameters, dict)
        moved = planted.sensor.bias - nominal.sensor.bias
        np.testing.assert_allclose(parameters["offset"], moved)
        reading, limit, half = planted.run().wrench[:, 2], parameters["limit"][2], 0.011  # half a step of the converter
        assert (np.abs(reading + limit) < half).sum() > 500
        assert (reading < limit - half).all()


def test_unknown_effect() -> None:
    with pytest.raises(InputError, match="did you mean 'relaxation'"):
        hide(prepare("poke"), "relaxaton", 0)
