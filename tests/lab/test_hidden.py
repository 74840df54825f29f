"""Hidden effects: those of the catalogue can be injected, and show."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from kinid.effects import Stage, catalogue, effect_file
from kinid.errors import InputError
from kinid.lab.experiments import prepare
from kinid.lab.hidden import hide
from kinid.lab.injectors import injectors


def test_effects_of_the_catalogue_can_be_hidden() -> None:
    """Each injector is of an effect that the catalogue holds and no base; a seed gives the same size again."""
    known = {name for name, effect in catalogue().items() if not effect.base}
    assert set(injectors()) <= known
    assert len(injectors()) >= 48  # all that the catalogue held when injectors became optional
    setup = prepare("ecoflex-50", seed=1)
    for name in injectors():
        truth = hide(setup, name, 7)[1]
        assert truth == hide(setup, name, 7)[1]
        assert truth["effect"] == name
        assert hide(setup, name, 8)[1] != truth or name == "quantization"


OWN = """
def inject(setup, rng):
    size = float(rng.uniform(100.0, 400.0))

    def force(motion):
        rate = np.gradient(motion.place[:, 2], motion.t)
        return size * (abs(rate) * rate * (motion.place[:, 2] > 0.0))[:, None] * np.array([0.0, 0.0, 1.0])

    return setup.replace(extra_force=force), {"damping": size}
"""


@pytest.fixture
def own(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """The file of an effect of one's own, in a folder that the catalogue reads; nothing of it stays behind."""
    monkeypatch.setenv("KINID_EFFECTS", str(tmp_path))
    file = tmp_path / "law_of_mine.py"
    file.write_text(effect_file("law-of-mine", Stage.NORMAL))
    catalogue.cache_clear()
    yield file
    monkeypatch.undo()
    catalogue.cache_clear()


def test_an_effect_brings_its_own_injector(own: Path) -> None:
    own.write_text(own.read_text().replace("import final\n", "import final\n\nimport numpy as np\n") + OWN)
    setup = prepare("poke", seed=1)
    injected, truth = hide(setup, "law-of-mine", 7)
    parameters = truth["parameters"]
    assert isinstance(parameters, dict)
    clean, other = setup.run(), injected.run()
    np.testing.assert_array_equal(other.q, clean.q)  # the arm doesn't feel it
    rate = np.gradient(clean.motion.place[:, 2], clean.motion.t)
    expected = parameters["damping"] * abs(rate) * rate * (clean.motion.place[:, 2] > 0.0)
    found = other.motion.force - clean.motion.force
    np.testing.assert_allclose(found[:, 2], expected, atol=1e-12)
    np.testing.assert_array_equal(found[:, :2], 0.0)
    assert np.abs(other.wrench[:, 2] - clean.wrench[:, 2]).max() == pytest.approx(np.abs(expected).max(), rel=0.2)


def test_an_effect_without_an_injector_is_refused_with_a_line(own: Path) -> None:
    with pytest.raises(InputError, match="give its file a function inject"):
        hide(prepare("poke"), "law-of-mine", 0)


def test_an_effect_has_one_injector(own: Path) -> None:
    """Those of the catalogue's effects stand with the laboratory."""
    relaxation = sys.modules["kinid.effects.relaxation"]
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(relaxation, "inject", lambda setup, rng: (setup, {}), raising=False)
        with pytest.raises(InputError, match="a second injector of 'relaxation'"):
            injectors()


@pytest.mark.slow
@pytest.mark.parametrize("name", sorted(injectors()))
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
def test_what_changes_over_a_surface_gives_way_to_what_is_injected(name: str) -> None:
    setup = prepare("mould")
    injected, truth = hide(setup, name, 7)
    x, y = np.array([-0.02, 0.02]), np.array([0.02, -0.02])
    before, after = setup.material.at(x, y), injected.material.at(x, y)
    parameters = truth["parameters"]
    assert isinstance(parameters, dict)
    if name == "hertz-exponent":
        assert injected.material.exponent == parameters["exponent"]
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
    """The push, and not the hanging tool, comes to the end of the range; an offset that was injected is told."""
    for name in ("ecoflex-50", "sponge", "band"):
        nominal = prepare(name, seed=1)
        injected, truth = hide(nominal, "saturation", 7)
        parameters = truth["parameters"]
        assert isinstance(parameters, dict)
        moved = injected.sensor.bias - nominal.sensor.bias
        np.testing.assert_allclose(parameters["offset"], moved)
        reading, limit, half = (
            injected.run().wrench[:, 2],
            parameters["limit"][2],
            0.011,
        )  # half a step of the converter
        assert (np.abs(reading + limit) < half).sum() > 500
        assert (reading < limit - half).all()


def test_unknown_effect() -> None:
    with pytest.raises(InputError, match="did you mean 'relaxation'"):
        hide(prepare("poke"), "relaxaton", 0)
