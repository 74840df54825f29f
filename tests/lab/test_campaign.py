"""A campaign that is killed and goes on, and its page."""

from __future__ import annotations

import dataclasses
import os
import re
import shutil
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
from kinid.lab.campaign_page import NAME, campaign_page
from kinid.lab.places import Grid

SMALL = Campaign(1, 2, spacing=0.05, seed=4)
CHILD = """
import sys
from pathlib import Path
from kinid.lab import campaign
from kinid.lab.campaign import Campaign
campaign.run(Campaign(2, 2, seed=5), Path(sys.argv[1]), lambda i: print(i, flush=True))
"""


def test_killed_campaign_goes_on_without_losing_or_repeating_a_poke(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    whole, killed = tmp_path / "whole", tmp_path / "killed"
    task = Campaign(2, 2, seed=5)
    assert campaigns.run(task, whole) == 4
    for _ in range(2):  # twice, each time in the middle of something
        process = subprocess.Popen(
            [sys.executable, "-c", CHILD, str(killed)], stdout=subprocess.PIPE, env=dict(os.environ)
        )
        assert process.stdout is not None
        there = len(list(campaigns.logs(killed)))
        for _ in range(there + 1):
            process.stdout.readline()
        time.sleep(0.05)
        process.send_signal(signal.SIGKILL)
        process.wait()
        process.stdout.close()
    before = {p.name: (p.stat().st_mtime_ns, p.read_bytes()) for p in campaigns.logs(killed)}
    assert 2 <= len(before) < 4
    (killed / ".poke_0003.dead.parquet").write_bytes(b"half")  # what a writer that was killed leaves
    assert campaigns.run(task, killed) == 4 - len(before)
    for name, (stamp, data) in before.items():
        assert (killed / name).stat().st_mtime_ns == stamp, "repeated"
        assert (killed / name).read_bytes() == data
    assert sorted(p.name for p in killed.rglob("*")) == sorted(p.name for p in whole.rglob("*"))
    for path in campaigns.logs(whole):
        assert path.read_bytes() == (killed / path.name).read_bytes()
    assert campaigns.run(task, killed) == 0
    with pytest.raises(InputError, match="another campaign"):
        campaigns.run(Campaign(2, 2, seed=6), killed)


def test_campaign_that_cannot_work_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="reach|limits"):
        campaigns.run(Campaign(3, 3, spacing=0.4, material="ecoflex-50"), tmp_path)
    assert not list(campaigns.logs(tmp_path))
    with pytest.raises(InputError):
        Campaign(0, 3)
    with pytest.raises(InputError):
        Campaign(2, 2, spacing=float("nan"))
    with pytest.raises(InputError, match="beside the mould"):
        campaigns.run(Campaign(3, 3, spacing=0.06), tmp_path / "never")
    assert not (tmp_path / "never").exists()


def test_a_surface_that_the_arm_can_t_reach_is_refused_for_the_whole_campaign(tmp_path: Path) -> None:
    for change, words in (
        ({"point": (-0.5, 0.0, 0.1)}, "behind the robot"),
        ({"normal": (0.0, 0.0, -1.0)}, "turned away"),
        ({"stiffness": 1e6}, "unstable"),
    ):
        with pytest.raises(InputError, match=words):
            campaigns.run(Campaign(2, 2, **change), tmp_path / "never")
    assert not (tmp_path / "never").exists()


def test_the_page_tells_places_forces_and_progress_and_nothing_of_the_truth(tmp_path: Path) -> None:
    task = Campaign(2, 2, spacing=0.05, seed=3, hidden="relaxation")

    def stop(index: int) -> None:
        if index == 1:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        campaigns.run(task, tmp_path, stop)
    half = (tmp_path / NAME).read_text()
    assert "2 of 4 pokes are done (50 %)" in half
    assert "Not done: poke_0002, poke_0003." in half
    campaigns.run(task, tmp_path)
    page = (tmp_path / NAME).read_text()
    assert "4 of 4 pokes are done (100 %)" in page
    assert "Not done" not in page
    least, middle, most = (
        float(v) for v in re.search(r"normal force held \[N\]\D+([\d.]+)\D+([\d.]+)\D+([\d.]+)", page).groups()
    )  # type: ignore[union-attr]
    assert 0.3 < least < middle < most < 4.0  # [N]: the rim is soft, the quarters differ
    assert b"relaxation" not in b"".join(path.read_bytes() for path in tmp_path.glob("*.*") if path.name != NAME)
    body = page[page.index("</script>") :]  # behind the drawing library
    assert "relaxation" not in body
    assert not re.search(r'(src|href)="?http', body)
    assert not list(tmp_path.glob(".*"))


def test_a_folder_that_holds_something_else_is_left_alone(tmp_path: Path) -> None:
    task = Campaign(1, 1)
    (tmp_path / "poke_0000.parquet").write_bytes(b"mine")
    with pytest.raises(InputError, match="pokes without"):
        campaigns.run(task, tmp_path)
    assert (tmp_path / "poke_0000.parquet").read_bytes() == b"mine"
    (tmp_path / "truth").mkdir()
    for damaged in ("{", "[1]", "null"):
        (tmp_path / "truth" / "campaign.json").write_text(damaged)
        with pytest.raises(InputError, match="no manifest|damaged|another campaign"):
            campaigns.run(task, tmp_path)


@pytest.fixture(scope="module")
def finished(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("campaign") / "done"
    campaigns.run(SMALL, folder)
    return folder


def test_what_is_damaged_or_gone_is_made_again(finished: Path, tmp_path: Path) -> None:
    folder = tmp_path / "c"
    shutil.copytree(finished, folder)
    whole = (folder / "poke_0001.parquet").read_bytes()
    turned = bytearray(whole)
    turned[len(turned) // 2] ^= 0xFF
    for damaged in (b"", b"damaged", whole[: len(whole) // 2], bytes(turned)):
        (folder / "poke_0001.parquet").write_bytes(damaged)
        assert campaigns.run(SMALL, folder) == 1
        assert (folder / "poke_0001.parquet").read_bytes() == whole
    for name in ("poke_0000.json", "poke_0001.parquet"):
        truth = folder / "truth" / name
        known = truth.read_bytes()
        truth.unlink()
        assert campaigns.run(SMALL, folder) == 1
        assert truth.read_bytes() == known
        truth.write_bytes(known[: len(known) // 2])
        assert campaigns.run(SMALL, folder) == 1
        assert truth.read_bytes() == known
    assert campaigns.run(SMALL, folder) == 0


def test_a_campaign_goes_on_with_its_own_rig_and_settings_alone(finished: Path, tmp_path: Path) -> None:
    folder = tmp_path / "c"
    shutil.copytree(finished, folder)
    for change in ({"stiffness": 3000.0}, {"torque_limit": (150.0,)}, {"touch": "slide"}, {"material": "sponge"}):
        with pytest.raises(InputError, match=f"another campaign.*{next(iter(change))}"):
            campaigns.run(dataclasses.replace(SMALL, **change), folder)
    text = (folder / "rig.toml").read_text()
    (folder / "rig.toml").write_text(text.replace("mass = 0.24", "mass = 0.25"))
    with pytest.raises(InputError, match=r"another \[tool\] than the campaign was begun with"):
        campaigns.run(SMALL, folder)
    (folder / "rig.toml").unlink()
    assert campaigns.run(SMALL, folder) == 0
    assert (folder / "rig.toml").read_text() == text


def test_two_processes_don_t_work_on_one_campaign(tmp_path: Path) -> None:
    """The second is refused as long as the first lives, and not when the first was killed."""
    process = subprocess.Popen([sys.executable, "-c", CHILD, str(tmp_path)], stdout=subprocess.PIPE)
    assert process.stdout is not None
    process.stdout.readline()
    with pytest.raises(InputError, match="another process at work"):
        campaigns.run(Campaign(2, 2, seed=5), tmp_path)
    process.send_signal(signal.SIGKILL)
    process.wait()
    process.stdout.close()
    assert 0 < campaigns.run(Campaign(2, 2, seed=5), tmp_path) < 4
    assert not list(tmp_path.glob(".*"))


def test_a_campaign_of_slides(tmp_path: Path) -> None:
    task = Campaign(1, 2, touch="slide", material="mould", spacing=0.09)
    assert campaigns.run(task, tmp_path) == 2
    assert [path.name for path in campaigns.logs(tmp_path)] == ["slide_0000.parquet", "slide_0001.parquet"]
    rig = kinid.Rig.load(tmp_path / "rig.toml")
    log = kinid.read(tmp_path / "slide_0001.parquet", rig)
    assert log.phase is not None
    assert "slide" in log.phase.tolist()
    touch = kinid.contact_series(log, rig)
    sliding = touch.phase == "slide"
    # 3 mm out and back along both tangents; 2.5 N of friction bend 5200 N/m by half a millimetre each way
    for slip in (touch.slip1, touch.slip2):
        assert 3e-3 < np.ptp(slip[sliding]) < 6e-3
    page = (tmp_path / NAME).read_text()
    assert "2 of 2 slides are done" in page
    with pytest.raises(InputError, match="campaign of 'wave'"):
        Campaign(1, 1, touch="wave")  # type: ignore[arg-type]


def test_what_is_hidden_where_nothing_is_touched_is_refused(tmp_path: Path) -> None:
    for where, words in (
        (((0.06, 0.0), (0.08, 0.02)), "off the mould"),
        (((0.02, 0.02), (0.03, 0.03)), "isn't touched"),
    ):
        with pytest.raises(InputError, match=words):
            campaigns.run(Campaign(2, 2, hidden="relaxation", where=where), tmp_path / "never")
    assert not (tmp_path / "never").exists()
    Campaign(2, 2, hidden="relaxation", where=((0.0, -0.05), (0.05, 0.0))).check()


def test_a_page_without_pokes() -> None:
    page = campaign_page("Pokes", Grid(2, 3), {})
    assert "0 of 6 pokes" in page
    assert "No place has been touched yet" in page


def test_grid() -> None:
    grid = Grid(3, 5, 0.01)
    assert grid.place(7) == (0.0, 0.0)
    assert grid.place(0) == (-0.01, -0.02)
    assert len(grid.rim()) == 12
    assert {grid.name(i) for i in range(grid.count)} == {f"poke_{i:04d}" for i in range(15)}
