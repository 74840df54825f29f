"""Inside the loop: the same numbers as offline, and estimates from raw joints and wrench."""

from __future__ import annotations

import numpy as np
import pytest

from kinid.contact import contact_series
from kinid.errors import InputError
from kinid.estimators.friction import Friction
from kinid.estimators.hunt_crossley import SingleStage
from kinid.estimators.kelvin_voigt import KelvinVoigt
from kinid.lab.scripted import RIG, Scripted, scripted_poke
from kinid.online import OnlineContact, OnlineEstimator
from kinid.rig import CONTACT, Rig


@pytest.fixture(scope="module")
def scripted() -> Scripted:
    return scripted_poke(seed=8)


@pytest.fixture(scope="module")
def rig(scripted: Scripted) -> Rig:
    return Rig.parse_text(RIG + f"bias = {scripted.bias.tolist()}\n")


def test_sample_by_sample_gives_what_the_log_gives(scripted: Scripted, rig: Rig) -> None:
    q = scripted.log.q
    assert q is not None
    dq = np.gradient(q, scripted.log.t, axis=0)
    ddq = np.gradient(dq, scripted.log.t, axis=0)
    offline = contact_series(scripted.log.replace(dq=dq, ddq=ddq), rig, bias=scripted.bias.tolist())
    online = OnlineContact(rig)
    for k in range(0, len(q), 97):
        found = online.step(float(scripted.log.t[k]), q[k], scripted.log.wrench[k], dq[k], ddq[k])  # type: ignore[index]
        # the same kernel, one sample wide
        np.testing.assert_allclose(found, [getattr(offline, name)[k] for name in CONTACT], atol=1e-12)


def test_velocities_of_its_own_are_near_the_true_ones(scripted: Scripted, rig: Rig) -> None:
    offline = contact_series(scripted.log, rig)
    online, rates = OnlineContact(rig), []
    for t, q, w in zip(scripted.log.t, scripted.log.q, scripted.log.wrench):  # type: ignore[arg-type]
        rates.append(online.step(float(t), q, w)[CONTACT.index("depth_rate")])
    # a low-pass of 40 Hz delays by 4 ms: of a 4 Hz poke it loses 2π·4·0.004 = 10 %
    error = np.array(rates) - offline.depth_rate
    assert np.sqrt(np.mean(error**2)) < 0.12 * np.sqrt(np.mean(offline.depth_rate**2))


@pytest.mark.parametrize("kind", ["kelvin-voigt", "hunt-crossley", "friction"])
def test_estimates_from_raw_samples(scripted: Scripted, rig: Rig, kind: str) -> None:
    contact = OnlineContact(rig, bandwidth=60.0)
    if kind == "kelvin-voigt":
        loop = OnlineEstimator(contact, KelvinVoigt().online())
    elif kind == "hunt-crossley":
        loop = OnlineEstimator(contact, SingleStage().online())
    else:
        takes = ("normal_force", "slip_rate1", "tangential_force1")
        loop = OnlineEstimator(contact, Friction(least_speed=8e-3).online(axes=1), takes)
    for t, q, w in zip(scripted.log.t, scripted.log.q, scripted.log.wrench):  # type: ignore[arg-type]
        estimate = loop.update(float(t), q, w)
    print(estimate)
    truth = scripted.material
    if kind == "kelvin-voigt":
        assert estimate.values[0] == pytest.approx(truth.stiffness, rel=0.02)
        assert estimate.values[1] == pytest.approx(truth.damping, rel=0.15)
    elif kind == "friction":
        assert estimate.values[0] == pytest.approx(truth.friction, rel=0.05)
    else:
        # the material is linear and loses force at every depth alike, which this law can't say: its force in the middle
        # of the poke is right, its exponent need not be
        stiffness, exponent = estimate["stiffness"], estimate["exponent"]
        assert stiffness * 4e-3**exponent == pytest.approx(truth.stiffness * 4e-3, rel=0.05)


def test_a_rig_without_a_plane_is_refused() -> None:
    with pytest.raises(InputError, match="plane"):
        OnlineContact(Rig.parse({"robot": {"model": "lwr4plus"}}))
