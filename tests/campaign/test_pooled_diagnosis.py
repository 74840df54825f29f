"""What a model lacks over many logs: an effect too weak for one, nothing where nothing is, odd logs, groups."""

from __future__ import annotations

import dataclasses
import json
from functools import cache

import numpy as np
import pytest
from campaign.testers import poked, several
from scripted import RIG, scripted_poke

import kinid
from kinid.campaign.diagnosis import CampaignDiagnosis
from kinid.campaign.oddness import reasons
from kinid.data.rig import Rig

MODEL = kinid.Model("kelvin-voigt", "sensor-bias")
#: laws that bend a spring over depth, which a small one can't be told by
BENDS = {"stiffening-layer", "hertz-exponent"}
#: N/m²: three thousandths of a newton at the usual depth, a sixth of the noise
WEAK = 9e3


@cache
def weak() -> CampaignDiagnosis:
    return kinid.Campaign([poked(i, stiffening=WEAK) for i in range(6)]).diagnose(MODEL, max_effects=1)


def test_an_effect_too_weak_for_one_log_is_found_in_several() -> None:
    single = kinid.diagnose(poked(0, stiffening=WEAK), kinid.Rig(), model=MODEL)
    assert not BENDS & set(single.added)
    found = weak()
    assert BENDS & {*found.added, *(name for effect in found.effects for name in effect.equivalent_to)}
    assert found.by_log[1] < found.by_log[0]
    assert found.steps[1].explained > 0.3
    shown = found.shown[found.added[0]]
    assert set(shown) == set(found.fit.logs[i].name for i in range(6))
    assert "absent" not in shown.values()


def test_its_facts_are_those_of_the_contract() -> None:
    facts = json.loads(json.dumps(weak().to_dict(), allow_nan=False))
    for key in ("model", "verdict", "added", "error", "steps", "where", "effects", "logs", "per_log", "error_by_log"):
        assert key in facts
    (first,) = [effect for effect in facts["effects"] if effect["id"] == facts["added"][0]]
    assert first["verdict"] == "present"
    assert set(first["by_log"]) == set(facts["logs"])
    assert first["parameters"]
    assert facts["odd"] == []


def test_nothing_is_found_where_nothing_is() -> None:
    found = kinid.Campaign([poked(i) for i in range(6)]).diagnose(MODEL)
    assert (found.verdict, found.added) == ("adequate", ())


def test_odd_logs_are_named() -> None:
    for odd, words in (
        (poked(7, stiffness=1000.0), "log 6"),
        (poked(7, offset=5e-4), "surface-offset"),
    ):
        campaign = kinid.Campaign([*(poked(i) for i in range(5)), odd])
        fit = campaign.fit(MODEL)
        assert list(fit.odd) == ["log 6"]
        # and left out of what is shared
        assert abs(fit["stiffness"].value - 800.0) < 4.0
        assert words in f"log 6: {reasons(fit, campaign, 'log 6', fit.odd['log 6'])}"
    assert kinid.Campaign(several(6)).fit(kinid.Model("kelvin-voigt", "surface-offset", "sensor-bias")).odd == {}


def test_a_sensor_with_swapped_axes_is_named_with_them() -> None:
    logs = [scripted_poke(seed=seed).log for seed in range(4)]
    wrench = logs[3].wrench
    assert wrench is not None
    logs[3] = dataclasses.replace(logs[3], wrench=wrench[:, [1, 0, 2, 4, 3, 5]])
    campaign = kinid.Campaign(logs, Rig.parse_text(RIG))
    fit = campaign.fit(kinid.Model("kelvin-voigt", "coulomb-friction"))
    assert list(fit.odd) == ["log 4"]
    assert "axes x, y, z read y, x, z of the others'" in reasons(fit, campaign, "log 4", "")
    # the rest tells what it would have told without it
    assert fit["stiffness"].value == pytest.approx(732.0, rel=0.005)


def test_groups_that_differ_are_told() -> None:
    robots = ["left", "right"] * 3
    logs = [poked(i, stiffness=800.0 if robot == "left" else 830.0) for i, robot in enumerate(robots)]
    found = kinid.Campaign(logs, columns={"robot": robots}).diagnose(MODEL, max_effects=0)
    assert [(one.column, one.parameter) for one in found.differences] == [("robot", "kelvin-voigt.stiffness")]
    values = found.differences[0].values
    assert np.isclose(values["right"] - values["left"], 30.0, atol=3.0)
    assert "differs by robot" in str(found.differences[0])
