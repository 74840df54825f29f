"""The text of a parameter's identity, which JSON fixes, taken apart and put together."""

from __future__ import annotations

import pytest

from kinid.effects import Layout, catalogue
from kinid.parameter import ParameterId

WRENCH = ("fx", "fy", "fz", "tx", "ty", "tz")
LAYOUTS = (
    Layout(("normal_force", "tangential_force1", "tangential_force2"), "contact"),
    Layout(WRENCH, "wrench"),
    Layout(("tau1", "force2"), "joints", ("left.arm_1", "slide")),
    Layout(("tau1",), "joints"),
)


@pytest.mark.parametrize("layout", LAYOUTS, ids=lambda layout: layout.kind)
def test_every_parameter_of_the_catalogue_goes_there_and_back(layout: Layout) -> None:
    for name, effect in catalogue().items():
        for parameter in effect().parameters(layout):
            text = f"{name}.{parameter.name}"
            found = ParameterId.parse(text)
            assert str(found) == text
            assert (found.effect, found.name) == (name, parameter.stem)


@pytest.mark.parametrize(
    ("text", "parts"),
    [
        ("hunt-crossley.exponent", ("hunt-crossley", "exponent", "")),
        ("sensor-bias.bias[fx]", ("sensor-bias", "bias", "fx")),
        ("joint-coulomb-friction.coulomb[left.arm_1]", ("joint-coulomb-friction", "coulomb", "left.arm_1")),
        ("mains-hum.sine[fx,2]", ("mains-hum", "sine", "fx,2")),
        ("offset[N·m]", ("", "offset", "N·m")),
    ],
)
def test_a_dot_in_a_joints_name_is_no_effect(text: str, parts: tuple[str, str, str]) -> None:
    assert ParameterId.parse(text) == ParameterId(*parts)
    assert str(ParameterId(*parts)) == text
