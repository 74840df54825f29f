"""Readings of a coarse converter: materials that come back through it, and effects that hide behind its steps."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest
from numpy.typing import NDArray

import kinid

if TYPE_CHECKING:
    from conftest import Tester

Array = NDArray[np.float64]

STEP = 0.25
RIG = kinid.Rig()


def rounded(tester: Tester, force: Array, step: float = STEP) -> kinid.Log:
    """The log of a force whose converter has this step."""
    log = tester.log(force)
    read = step * np.round(log.contact["normal_force"] / step)
    return kinid.Log(t=log.t, contact={**log.contact, "normal_force": read}, phase=log.phase)


@pytest.mark.parametrize("step", [0.15, 0.25, 0.3, 0.38, 0.45, 0.6])
def test_stiffness_and_damping_come_back_through_a_converter(tester: Tester, step: float) -> None:
    model = kinid.Model("kelvin-voigt")
    log = rounded(tester, tester.kelvin_voigt(), step)
    found = kinid.diagnose(log, RIG, model=model).fit
    # steps of seven to thirty times the noise, each transition known to a share of its step: 800 N/m to 1.3 … 5 %
    assert found["stiffness"].value == pytest.approx(800.0, rel=step / 12.0)
    assert found["kelvin-voigt.damping"].value == pytest.approx(6.0, rel=0.15)
    for name, truth in (("stiffness", 800.0), ("kelvin-voigt.damping", 6.0)):
        p = found[name]
        assert abs(p.value - truth) < p.high - p.low  # twice the half width: 1 of 10 000


def test_a_dashpot_hides_behind_steps_of_twelve_times_the_noise(tester: Tester) -> None:
    found = kinid.diagnose(rounded(tester, tester.kelvin_voigt()), RIG, model=kinid.Model("hooke"))
    assert found.verdict == "missing"
    assert set(found.added) & {"viscous-damping", "time-offset"}
    assert "quantization" in found.added


@pytest.mark.parametrize("step", [0.1, 0.25, 0.5, 1.0])
def test_nothing_is_found_in_the_steps_themselves(tester: Tester, step: float) -> None:
    found = kinid.diagnose(rounded(tester, tester.kelvin_voigt(), step), RIG, model=kinid.Model("kelvin-voigt"))
    assert found.added == ("quantization",)
    assert found.verdict == "missing"


@pytest.mark.parametrize("step", [0.0, STEP])
def test_a_channel_that_never_changes_hides_no_friction(tester: Tester, step: float) -> None:
    """Nothing slides along the second tangent: its sensor reads nought throughout, and is no proof against friction."""
    force = tester.kelvin_voigt()
    log = tester.log(force, tester.rubbing(force))
    names = ("normal_force", "tangential_force1")
    read = {name: step * np.round(log.contact[name] / step) if step else log.contact[name] for name in names}
    read["tangential_force2"] = np.zeros(len(log.t))
    log = kinid.Log(t=log.t, contact={**log.contact, **read}, phase=log.phase)
    found = kinid.diagnose(log, RIG, model=kinid.Model("kelvin-voigt"))
    assert found.added[0] == "coulomb-friction"
    friction = found["coulomb-friction"].parameters["coefficient"]
    assert friction.value == pytest.approx(0.4, rel=0.05)
