"""A rig and a log, as samples of two streams."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scripted import RIG, Scripted, scripted_poke

from kinid.data.rig import Rig
from kinid.live.messages import Item, Joints, Wrench


@pytest.fixture(scope="session")
def scripted() -> Scripted:
    return scripted_poke(seed=8)


@pytest.fixture
def log(scripted: Scripted, tmp_path: Path) -> Path:
    """The log on disk, with its rig beside it."""
    return scripted.write(tmp_path)


@pytest.fixture(scope="session")
def rig(scripted: Scripted) -> Rig:
    return Rig.parse_text(RIG + f"bias = {scripted.bias.tolist()}\n")


@pytest.fixture(scope="session")
def rows(scripted: Scripted) -> list[Item]:
    """The log's rows as samples of both streams, stamped from 1 s on."""
    log = scripted.log
    assert log.q is not None
    assert log.wrench is not None
    out: list[Item] = []
    for t, q, wrench in zip(log.t.tolist(), log.q, log.wrench):
        at = round(1e9 * t) + 1_000_000_000
        out += [Joints(at, at, np.array(q)), Wrench(at, at, np.array(wrench))]
    return out
