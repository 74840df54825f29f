"""Pokes that end when they have said enough, in the closed loop of the laboratory."""

from __future__ import annotations

import dataclasses
import json
import shutil
from pathlib import Path

import numpy as np
import pytest
import typer
from typer.testing import CliRunner

import kinid
from kinid.cli.lab import lab
from kinid.cli.map import map_
from kinid.contact.early_stop import EarlyStop
from kinid.errors import InputError
from kinid.estimators.warm_start import Candidate, WarmStart
from kinid.lab import campaign as campaigns
from kinid.lab.campaign import LEARNT, Campaign
from kinid.lab.early_stop import carry_out, robot_seconds
from kinid.mapping.probes import Prober, build, logs_in
from kinid.mapping.property_map import PropertyMap

#: places at −20, 0 and 20 mm of the second tangent
FEW = Campaign(1, 3, spacing=0.02, seed=31, precision=0.05, prior="neighbours", point=(0.55, 0.0, 0.1))
TRUE = np.array([732.0, 9.9])


def setup_of(material: str = "ecoflex-50", seed: int = 31):
    return Campaign(1, 1, material=material, seed=seed, precision=0.05).setup(0)[0]


@pytest.fixture(scope="module")
def whole():
    """A poke that isn't ended, whoever follows it."""
    return setup_of().run()


def followed(precision: float = 0.05, prior: WarmStart | None = None):
    setup = setup_of()
    poke = EarlyStop(setup.rig, precision, prior, robot=setup.robot)
    return carry_out(setup, poke), poke


def test_a_poke_ends_early_and_is_the_same_until_then(whole) -> None:
    result, poke = followed()
    assert poke.enough
    assert poke.learnt is not None
    half = 1.96 * np.sqrt(np.diag(poke.learnt.covariance))
    assert (half <= 0.05 * poke.learnt.values).all()
    assert (np.abs(poke.learnt.values - TRUE) <= 1.5 * half).all()
    n = int(np.flatnonzero(result.setup.script.phase == "retract")[0])
    assert np.array_equal(result.wrench[: n - 2], whole.wrench[: n - 2])
    assert np.array_equal(result.q[: n - 2], whole.q[: n - 2])
    assert result.motion.t[-1] < 0.6 * whole.motion.t[-1]
    # back in the air, as smoothly as it was moving
    assert result.motion.place[-1, 2] < -0.006
    assert np.abs(np.diff(result.setup.script.place[:, 2], n=2)).max() < 2e-6
    assert len(result.log.t) == len(range(0, len(result.motion.t), 2))


def test_what_agrees_saves_time_and_what_contradicts_costs_no_truth() -> None:
    def expected(*values: float) -> WarmStart:
        mean = np.array(values)
        return WarmStart([Candidate(mean, np.diag((0.02 * mean) ** 2), 1.0)], 0.2)

    alone, _ = followed(0.03)
    warm, agrees = followed(0.03, expected(735.0, 9.8))
    wrong, contradicts = followed(0.03, expected(994.0, 14.5))
    assert warm.motion.t[-1] < alone.motion.t[-1] - 0.05
    assert wrong.motion.t[-1] == alone.motion.t[-1]
    for poke in (agrees, contradicts):
        assert poke.learnt is not None
        assert (np.abs(poke.learnt.values / TRUE - 1.0) <= [0.02, 0.05]).all()
    assert contradicts.learnt.another > 0.99  # type: ignore[union-attr]


def test_where_the_law_fails_a_poke_goes_on_to_its_end() -> None:
    """Under the film of the mould."""
    base = Campaign(1, 1, precision=0.05, seed=31)
    setup = base.setup(0)[0]
    script = dataclasses.replace(setup.script, place=setup.script.place + [0.025, 0.025, 0.0])
    setup = setup.replace(script=script)
    poke = EarlyStop(setup.rig, 0.05, robot=setup.robot)
    result = carry_out(setup, poke)
    assert not poke.enough
    assert len(result.motion.t) == len(setup.script.t)
    assert poke.own is not None
    assert poke.own.noise > 5.0 * poke.noise


def test_a_campaign_goes_on_with_what_it_had_learnt(tmp_path: Path) -> None:
    once, twice = tmp_path / "once", tmp_path / "twice"
    assert campaigns.run(FEW, once) == 3
    shutil.copytree(once, twice)
    logs = [path.name for path in campaigns.logs(once)]
    for name in (logs[1], logs[2]):
        (twice / name).unlink()
        assert campaigns.run(FEW, twice) == 1
        assert (twice / name).read_bytes() == (once / name).read_bytes()
    plain = tmp_path / "plain"
    campaigns.run(dataclasses.replace(FEW, precision=None, prior=None), plain)
    assert robot_seconds(FEW, once) < 0.6 * robot_seconds(FEW, plain)
    with pytest.raises(InputError, match="another campaign"):
        campaigns.run(dataclasses.replace(FEW, precision=0.1), once)
    # every touch is long enough for a map, and that of the recursive estimates agrees
    prober, learnt = Prober.of(kinid.Rig.load(once / "rig.toml")), PropertyMap.read(once / LEARNT)
    *_, grown = build(logs_in([once]), prober)
    assert np.allclose(grown.values("stiffness"), learnt.values("stiffness"), rtol=0.03)


def test_the_commands(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    app = typer.Typer()
    app.command("lab")(lab)
    app.command("map")(map_)
    quick, out, facts = tmp_path / "quick", tmp_path / "map.parquet", tmp_path / "run.json"
    words = ["lab", "mould", "--campaign", "1x2", "--precision", "0.05", "-o", str(quick), "--json", str(facts)]
    made = CliRunner().invoke(app, words)
    assert made.exit_code == 0, made.output
    assert f"map of the recursive estimates: {quick / LEARNT}" in made.output.replace("\n", "")
    assert 3.0 < json.loads(facts.read_text())["robot_seconds"] < 8.0
    joined = CliRunner().invoke(app, ["map", str(quick), "-o", str(out), "--prior", "neighbours"])
    assert joined.exit_code == 0, joined.output
    assert len(PropertyMap.read(out)) == 2
    for wrong, said in (
        (["map", str(quick), "-o", str(out)], "--prior none for a map begun with neighbours"),
        (["lab", "mould", "--campaign", "1x2", "--prior", "none", "-o", str(tmp_path / "x")], "--prior without --prec"),
        (["lab", "mould", "--precision", "0.05", "-o", str(tmp_path / "x")], "--precision without --campaign"),
        ([*words[:6], "--prior", "no.json", "-o", str(tmp_path / "x")], "no.json"),
    ):
        refused = CliRunner().invoke(app, wrong)
        assert isinstance(refused.exception, InputError)
        assert said in str(refused.exception)
    assert not (tmp_path / "x").exists()


def test_what_can_t_be_asked_is_refused() -> None:
    for precision in (0.0, 1.0, float("nan")):
        with pytest.raises(InputError, match="a precision of"):
            Campaign(1, 1, precision=precision)
    with pytest.raises(InputError, match="a precision of slides"):
        Campaign(1, 1, touch="slide", precision=0.05)
    rig = setup_of().rig
    with pytest.raises(InputError, match=r"\[sensor\] noise"):
        EarlyStop(rig.model_copy(update={"sensor": rig.sensor.model_copy(update={"noise": None})}), 0.05)
