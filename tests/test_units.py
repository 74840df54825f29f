"""Units against their definitions."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from kinid.errors import InputError
from kinid.units import FACTORS, canonical, factor

#: 0.45359237 kg (international yard and pound agreement, 1959) times standard gravity
POUND_FORCE = 0.45359237 * 9.80665


@pytest.mark.parametrize(
    ("amount", "unit", "si"),
    [
        (180, "deg", math.pi),
        (1, "rev", 2 * math.pi),
        (60, "rpm", 2 * math.pi),
        (1000, "mrad", 1),
        (360, "deg/s", 2 * math.pi),
        (180, "deg/s^2", math.pi),
        (1, "in", 0.0254),
        (1000, "mm", 1),
        (100, "cm", 1),
        (10, "dm", 1),
        (1e6, "µm", 1),
        (1e6, "um", 1),
        (1, "h", 3600),
        (1, "min", 60),
        (1e9, "ns", 1),
        (1e6, "us", 1),
        (1e3, "ms", 1),
        (1, "kN", 1000),
        (1000, "gf", 9.80665),
        (1, "kgf", 9.80665),
        (1, "g", 9.80665),
        (1, "lbf", POUND_FORCE),
        (1, "lbf·in", POUND_FORCE * 0.0254),
        (12, "lbf-in", POUND_FORCE * 0.3048),
        (1, "lbf-ft", POUND_FORCE * 0.3048),
        (1, "kNm", 1000),
        (1000, "Nmm", 1),
        (1000, "mNm", 1),
        (1000, "N*mm", 1),
        (100, "N·cm", 1),
        (100, "Ncm", 1),
        (1000, "N mm", 1),
        (1, "N.m", 1),
        (1, "kgf·cm", 0.0980665),
        (180, "°", math.pi),
        (1e6, "μm", 1),
        (1000, "mm/s²", 1),
        (1, "N·m", 1),
        (1000, "mA", 1),
        (1000, "mV", 1),
        (1000, "mm/s", 1),
        (1000, "mm/s^2", 1),
    ],
)
def test_units_are_what_they_are_defined_as(amount: float, unit: str, si: float) -> None:
    assert amount * factor(unit, "here") == pytest.approx(si, rel=1e-14)  # a few roundings


def test_every_factor_is_a_positive_number() -> None:
    assert all(math.isfinite(f) and f > 0 for f in FACTORS.values())


@pytest.mark.parametrize(("unit", "hint"), [("mmm", "'mm'"), ("degree", "'deg'"), ("Nm m", "'Nm"), ("newton", "valid")])
def test_an_unknown_unit_is_refused_with_near_ones(unit: str, hint: str) -> None:
    with pytest.raises(InputError, match=f"unit '{unit}' in column fx") as caught:
        factor(unit, "column fx")
    assert hint in caught.value.mend


@given(st.text(max_size=20).filter(lambda name: canonical(name) not in FACTORS))
def test_any_other_text_gives_one_line(unit: str) -> None:
    with pytest.raises(InputError) as caught:
        factor(unit, "here")
    assert len(str(caught.value).splitlines()) == 1
