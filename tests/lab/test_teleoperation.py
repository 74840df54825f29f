"""The study of teleoperation on a poked material, its page, and what it refuses."""

from __future__ import annotations

import json
import re
from pathlib import Path

import numpy as np
import pytest

from kinid.controllers import Environment
from kinid.errors import InputError
from kinid.lab import materials, teleoperation
from kinid.lab.teleoperation import CHECKED, DELAYS, MISTAKEN, Comparison, at_place, poked


@pytest.fixture(scope="module")
def found() -> Comparison:
    return teleoperation.compare()


def test_reflection_from_a_measured_map_is_stable_and_transparent_where_direct_reflection_is_not(
    found: Comparison,
) -> None:
    print("\n" + found.study.table())
    print(
        f"map: {found.believed.stiffness:.1f} N/m, {found.believed.damping:.2f} N·s/m; true {found.truth.stiffness:g}, "
        f"{found.truth.damping:g}"
    )
    assert found.believed != found.truth  # a fit, not the truth
    assert {row.delay for row in found.study.rows} == set(DELAYS) == {0.05, 0.1, 0.2, 0.4}
    for row in found.study.rows:
        match row.method:
            case "impedance":
                assert row.stable
                assert row.nyquist
                assert row.error < 0.03  # what a poke's estimates leave
            case "direct":
                assert not row.stable
                assert not row.nyquist
                assert row.error > 1.0
            case _:
                assert row.stable
    # a map that is as wrong in both numbers everywhere is wrong by that everywhere
    assert found.mistaken == pytest.approx(MISTAKEN - 1.0)


def test_simulations_confirm_the_formulas_of_the_picture(found: Comparison) -> None:
    at = np.array(CHECKED)
    for (delay, method), dots in found.measured.items():
        curve = found.study.transmitted[delay, method]
        size = np.interp(np.log(at), np.log(found.study.frequency), np.log(np.abs(curve)))
        # a force held through 1 ms adds half of that to the way round: 2.5 % at 8 Hz
        np.testing.assert_allclose(np.log(np.abs(dots)), size, atol=0.03)


def test_the_page_stands_alone(found: Comparison, tmp_path: Path) -> None:
    page = teleoperation.write(tmp_path / "study", found).read_text()
    assert page.count("<h2>") == 3
    for words in ("50 ms, direct force reflection", "400 ms, impedance reflection from the map", "transparency error"):
        assert words in page
    assert not re.search(r'(src|href)="?http', page[page.index("</script>") :])
    facts = json.loads((tmp_path / "study" / "teleoperation.json").read_text())
    assert len(facts["cases"]) == 16
    assert facts["true"] == {"stiffness": 732.0, "damping": 9.9}


def test_materials_that_are_not_linear_or_not_the_same_everywhere_are_linearised() -> None:
    for name, place in (
        ("mould", (0.03, 0.03)),
        ("mould", (-0.03, -0.03)),
        ("band", (0.0, 0.0)),
        ("sponge", (0.0, 0.0)),
    ):
        truth, fitted = at_place(materials.material(name), *place), poked(name, 1, place)
        print(f"{name} at {place}: true {truth.stiffness:.1f} N/m, a poke says {fitted.stiffness:.1f}")
        assert fitted.stiffness == pytest.approx(truth.stiffness, rel=0.05)
    assert at_place(materials.ECOFLEX, 0.0, 0.0) == Environment(732.0, 9.9)
    with pytest.raises(InputError, match="material 'wood'"):
        teleoperation.compare("wood")
    with pytest.raises(InputError, match="beside the mould"):
        teleoperation.compare("mould", place=(0.1, 0.0))


def test_delays_are_checked_before_anything_is_poked(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(teleoperation, "poked", lambda *_: pytest.fail("it ran"))
    with pytest.raises(InputError, match="delay"):
        teleoperation.compare(delays=(0.1, -0.1))
