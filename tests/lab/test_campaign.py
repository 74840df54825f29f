"""Logs on disk, hidden effects, and a campaign that is killed and goes on."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

import kinid
from kinid.errors import InputError
from kinid.lab import campaign as campaigns
from kinid.lab.campaign import Campaign
from kinid.lab.experiments import prepare
from kinid.lab.hidden import PLANTS, hide
from kinid.lab.materials import MOULD
from kinid.lab.protocol import Poke, five_phases
from kinid.lab.sensors import StreamSpec
from kinid.lab.writing import write_experiment
from kinid.rig import Rig

SHORT = five_phases(Poke(0.003, ((0.001, 2.0),), 0.6), free=0.4, hold=0.1, approach=0.6, height=0.008)


@pytest.fixture(scope="module")
def written(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("lab")
    setup = prepare("poke", seed=3)
    # one clock but for known offsets, so that both files can be held against each other
    setup = setup.replace(script=SHORT, wrench_stream=StreamSpec(losses=0.01), joint_stream=StreamSpec(every=2, losses=0.01))
    write_experiment(folder, setup.run(), {"experiment": "poke"})
    return folder


def test_parquet_and_mcap_hold_the_same(written: Path) -> None:
    rig = Rig.load(written / "rig.toml")
    table, bag = kinid.read(written / "log.parquet", rig), kinid.read(written / "log.mcap", rig)
    assert bag.q is not None
    assert table.q is not None
    assert len(bag) > 1.8 * len(table)  # the wrench's rate is twice the joints'
    shared = np.isfinite(bag.q.sum(axis=1))
    lost = 1.0 - len(bag) / (2 * len(table))
    assert 0.0 < lost < 0.05
    # between joint samples the reader interpolates: acceleration over half a step of 1 ms
    for j in range(7):
        assert np.abs(np.interp(bag.t[shared], table.t, table.q[:, j]) - bag.q[shared, j]).max() < 2e-5
    touch = kinid.contact_series(bag, rig)
    assert np.nanmax(touch.normal_force) > 1.0


def test_truth_stands_apart(written: Path) -> None:
    truth = json.loads((written / "truth" / "log.json").read_text())
    assert truth["material"]["stiffness"] == 732.0
    text = (written / "rig.toml").read_text()
    assert "732" not in text
    assert sorted(p.name for p in written.iterdir()) == ["log.mcap", "log.parquet", "rig.toml", "truth"]


def test_mcap_is_what_foxglove_opens(written: Path) -> None:
    from mcap.reader import make_reader

    with (written / "log.mcap").open("rb") as file:
        summary = make_reader(file).get_summary()
    assert summary is not None
    kinds = {s.name: s for s in summary.schemas.values()}
    assert set(kinds) == {"sensor_msgs/msg/JointState", "geometry_msgs/msg/WrenchStamped"}
    assert all(s.encoding == "ros2msg" and b"std_msgs/Header" in s.data for s in kinds.values())
    assert {c.message_encoding for c in summary.channels.values()} == {"cdr"}


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
    changed = np.abs(np.asarray(log.wrench) - np.asarray(other.wrench)).max() > 0.02 or np.abs(log.tau - other.tau).max() > 0.02
    assert changed or not np.array_equal(log.q, other.q)


def test_unknown_effect() -> None:
    with pytest.raises(InputError, match="did you mean 'relaxation'"):
        hide(prepare("poke"), "relaxaton", 0)


def test_mould_has_quarters_a_soft_rim_and_a_film() -> None:
    at = lambda x, y: {k: float(v[0]) for k, v in MOULD.at(np.array([x]), np.array([y])).items()}  # noqa: E731
    middles = [at(x, y)["stiffness"] for x, y in ((-0.025, -0.025), (-0.025, 0.025), (0.025, -0.025))]
    np.testing.assert_allclose(middles, [510.0, 732.0, 994.0], rtol=1e-3)
    assert at(-0.049, 0.025)["stiffness"] < 0.6 * 732.0
    film = at(0.025, 0.025)
    assert film["stiffness"] < 400.0
    assert film["stiffness"] + film["layer"] == pytest.approx(2400.0, rel=1e-2)
    assert 510.0 < at(-0.025, 0.0)["stiffness"] < 732.0
    assert MOULD.colors is not None
    colors = MOULD.colors(np.array([-0.03, -0.03, 0.03, 0.03]), np.array([-0.03, 0.03, -0.03, 0.03]))
    assert len(np.unique(np.round(colors, 3), axis=0)) == 4


CHILD = """
import sys
from pathlib import Path
from kinid.lab import campaign
from kinid.lab.campaign import Campaign
campaign.run(Campaign(2, 3, seed=5), Path(sys.argv[1]), lambda i: print(i, flush=True))
"""


def test_killed_campaign_goes_on_without_losing_or_repeating_a_poke(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    whole, killed = tmp_path / "whole", tmp_path / "killed"
    task = Campaign(2, 3, seed=5)
    assert campaigns.run(task, whole) == 6
    for _ in range(2):  # twice, each time in the middle of something
        process = subprocess.Popen([sys.executable, "-c", CHILD, str(killed)], stdout=subprocess.PIPE, env=dict(os.environ))
        assert process.stdout is not None
        there = len(list(campaigns.logs(killed)))
        for _ in range(there + 1):
            process.stdout.readline()
        time.sleep(0.05)
        process.send_signal(signal.SIGKILL)
        process.wait()
        process.stdout.close()
    before = {p.name: (p.stat().st_mtime_ns, p.read_bytes()) for p in campaigns.logs(killed)}
    assert 2 <= len(before) < 6
    (killed / ".poke_0005.dead.parquet").write_bytes(b"half")  # what a writer that was killed leaves
    assert campaigns.run(task, killed) == 6 - len(before)
    for name, (stamp, data) in before.items():
        assert (killed / name).stat().st_mtime_ns == stamp, "repeated"
        assert (killed / name).read_bytes() == data
    assert sorted(p.name for p in killed.rglob("*")) == sorted(p.name for p in whole.rglob("*"))
    for path in campaigns.logs(whole):
        assert path.read_bytes() == (killed / path.name).read_bytes()
    assert campaigns.run(task, killed) == 0
    with pytest.raises(InputError, match="another campaign"):
        campaigns.run(Campaign(2, 3, seed=6), killed)


def test_campaign_that_cannot_work_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="reach|limits"):
        campaigns.run(Campaign(3, 3, spacing=0.4), tmp_path)
    assert not list(campaigns.logs(tmp_path))
    with pytest.raises(InputError):
        Campaign(0, 3)
    with pytest.raises(InputError):
        Campaign(2, 2, spacing=float("nan"))
