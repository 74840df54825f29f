"""From raw logs of the virtual laboratory back to its truth, with the estimators that a user has."""

from __future__ import annotations

from functools import cache

import numpy as np

import kinid
from kinid.contact import ContactSeries
from kinid.derivative import Differentiator
from kinid.fit import FittedParameter, fit_model
from kinid.lab.experiments import prepare
from kinid.model import Model

#: as published: stiffness [N/m], damping [N·s/m], friction
PUBLISHED = {"sponge": (280.0, 8.1, 0.27), "ecoflex-50": (732.0, 9.9, 0.82), "dragon-skin-10": (994.0, 14.5, 0.77)}
SEED = 2


@cache
def _touch(name: str) -> tuple[ContactSeries, tuple[float, float, float]]:
    setup = prepare(name, seed=SEED)
    m = setup.material
    result = setup.run()
    touch = kinid.contact_series(result.log, setup.rig, differentiator=Differentiator(bandwidth=40.0))
    return touch, (m.stiffness, m.damping, m.friction)


def _estimates(name: str) -> list[FittedParameter]:
    """Stiffness and damping from all but the slide, friction from all but the poke; the sensor's offset fitted along."""
    touch, _ = _touch(name)
    assert touch.phase is not None
    normal = fit_model(Model("kelvin-voigt", "sensor-bias"), touch, train=touch.phase != "slide")
    sliding = fit_model(Model("kelvin-voigt", "coulomb-friction", "sensor-bias"), touch, train=touch.phase != "poke")
    return [normal["stiffness"], normal["damping"], sliding["coefficient"]]


def test_published_materials_are_found_again() -> None:
    print("\nmaterial        parameter   published       true  estimated   95 % from         to")
    covered = 0
    for name, published in PUBLISHED.items():
        truth = _touch(name)[1]
        for found, known, said, within in zip(_estimates(name), truth, published, (0.03, 0.10, 0.05)):
            kind = found.name.split(".")[1]
            print(f"{name:15} {kind:11} {said:9.4g}  {known:9.4g}  {found.value:9.5g}  {found.low:9.5g}  {found.high:9.5g}")
            assert abs(found.value / known - 1.0) < within
            covered += found.low <= known <= found.high
            # intervals are no alibi either
            assert (found.high - found.low) / 2 < within * known
    assert covered == 9


def test_band_orders_the_laws_as_published() -> None:
    setup = prepare("band", seed=SEED)
    result = setup.run()
    touch = kinid.contact_series(result.log, setup.rig)
    fits = {name: fit_model(Model(name), touch, held_out=False) for name in ("hooke", "kelvin-voigt", "hunt-crossley")}
    dt = float(np.median(np.diff(touch.t)))
    left = {name: float(np.abs(fit.solution.residual[0][touch.in_contact]).sum() * dt) for name, fit in fits.items()}
    print("integrated residual [N·s], published 14.98 > 12.85 > 4.42:", {name: round(v, 3) for name, v in left.items()})
    print("K [N/m]", {name: round(fit["stiffness"].value, 2) for name, fit in fits.items()}, "published 99.4, 98.1, 92.5")
    assert left["hooke"] > 1.1 * left["kelvin-voigt"] > 1.1 * 1.1 * left["hunt-crossley"]
    best = fits["hunt-crossley"]
    m = setup.material
    assert abs(best["stiffness"].value / m.stiffness - 1) < 0.03
    assert abs(best["exponent"].value / m.exponent - 1) < 0.01
    assert abs(best["damping"].value / (m.loss * m.stiffness) - 1) < 0.10
