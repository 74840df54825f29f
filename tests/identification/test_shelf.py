"""Logs that are kept on disk between visits: read again, they are what they were, to the last digit."""

from __future__ import annotations

import dataclasses
import shutil
from collections import namedtuple
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scripted import RIG, scripted_poke

import kinid
from kinid.effects import Signals
from kinid.identification.pooling.logs import PooledLog
from kinid.identification.pooling.shelf import shelf_in
from kinid.modeling.experiment import Experiment
from kinid.modeling.from_logs import from_contact, from_joint_torques, from_wrench

Usage = namedtuple("Usage", "total used free")


def pressed() -> Experiment:
    """Contact quantities of a material tester, and names of what was done."""
    rng, t = np.random.default_rng(3), np.arange(600) / 200.0
    depth = 2e-3 * np.sin(6.0 * t)
    force = 800.0 * np.maximum(depth, 0.0) + 0.02 * rng.standard_normal(len(t))
    phase = np.where(depth > 0.0, "poke", "free")
    contact = {"depth": depth, "depth_rate": 12e-3 * np.cos(6.0 * t), "normal_force": force}
    log = kinid.Log(t=t, contact=contact, phase=phase)
    return from_contact(kinid.contact_series(log, kinid.Rig()), ("normal_force",))


def wrench() -> Experiment:
    """An arm that pokes with a force sensor, which is driven by draws of its motion, too."""
    return from_wrench(scripted_poke(seed=2).log, kinid.Rig.parse_text(RIG))


def torques() -> Experiment:
    """An arm in free motion, whose torques at other places are worked out where they are asked for."""
    rng, t = np.random.default_rng(4), np.arange(800) / 200.0
    q = 0.4 * np.sin(np.outer(t, 1.0 + 0.3 * np.arange(7)) + np.arange(7))
    log = kinid.Log(t=t, q=q, tau=rng.standard_normal(q.shape))
    return from_joint_torques(log, kinid.Rig.parse({"robot": {"model": "lwr4plus"}}))


def same(one: Any, other: Any, where: str = "") -> None:
    """Both hold the same arrays, bit by bit, in the same order of memory, and the same plain values."""
    if isinstance(one, np.ndarray):
        assert one.dtype == other.dtype, where
        assert one.shape == other.shape, where
        assert one.tobytes() == other.tobytes(), where
        if min(one.shape, default=0) > 1:
            assert one.flags.c_contiguous == other.flags.c_contiguous, where
        assert other.flags.writeable, where
    elif callable(one):
        assert callable(other), where
    elif dataclasses.is_dataclass(one):
        assert type(one) is type(other), where
        for field in dataclasses.fields(one):
            if field.name != "touch" or isinstance(one, Signals):  # of an experiment: no visit asks for it
                same(getattr(one, field.name), getattr(other, field.name), f"{where}.{field.name}")
    else:
        assert one == other, where


class Loads:
    """Loads a log so many times."""

    def __init__(self, experiment: Experiment, times: int) -> None:
        self.experiment, self.left = experiment, times

    def __call__(self) -> Experiment:
        assert self.left > 0, "the log was read again"
        self.left -= 1
        return self.experiment


@pytest.mark.parametrize("make", [pressed, wrench, torques])
def test_what_is_read_again_is_what_was_kept(make: Callable[[], Experiment], tmp_path: Path) -> None:
    made = make()
    with shelf_in(tmp_path / "shelf") as shelf:
        log = shelf.of(PooledLog("one", Loads(made, 1)), "one")
        assert log.load() is made
        same(made, log.load())


def test_what_no_file_holds_is_made_from_the_log_when_it_is_wanted(tmp_path: Path) -> None:
    arm, poke = torques(), wrench()
    with shelf_in(tmp_path / "shelf") as shelf:
        logs = [shelf.of(PooledLog(str(i), Loads(made, 2)), str(i)) for i, made in enumerate((arm, poke))]
        (_, joints), (_, sensor) = ((log.load(), log.load()) for log in logs)
        motion, there = arm.signals.joints, joints.signals.joints
        assert motion is not None
        assert there is not None
        assert motion.moments is not None
        assert there.moments is not None
        np.testing.assert_array_equal(there.moments(motion.q.T), motion.moments(motion.q.T))
        for one, other in zip(poke.each_draw(), sensor.each_draw(), strict=True):
            same(one, other)


def test_a_file_that_was_cut_is_made_again(tmp_path: Path) -> None:
    made = pressed()
    with shelf_in(tmp_path / "shelf") as shelf:
        log = shelf.of(PooledLog("one", Loads(made, 3)), "one")
        log.load()
        (file,) = shelf.folder.iterdir()
        whole = file.read_bytes()
        for kept in (200, len(whole) // 2):
            file.write_bytes(whole[:kept])
            assert log.load() is made
            assert file.read_bytes() == whole
        same(made, log.load())


def test_a_disk_that_is_nearly_full_is_left_alone(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    made = pressed()
    monkeypatch.setattr(shutil, "disk_usage", lambda _: Usage(100_000_000_000, 91_000_000_000, 9_000_000_000))
    with shelf_in(tmp_path / "shelf") as shelf:
        log = shelf.of(PooledLog("one", Loads(made, 2)), "one")
        assert log.load() is log.load() is made
        assert not list(shelf.folder.iterdir())


def test_a_disk_that_is_full_costs_time_alone(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    made = pressed()

    def full(*_: Any, **__: Any) -> None:
        raise OSError(28, "No space left on device")

    with shelf_in(tmp_path / "shelf") as shelf:
        log = shelf.of(PooledLog("one", Loads(made, 2)), "one")
        monkeypatch.setattr(np, "save", full)
        assert log.load() is log.load() is made
        assert not list(shelf.folder.iterdir())


def test_nothing_is_left_behind(tmp_path: Path) -> None:
    folder = tmp_path / "shelf"
    folder.mkdir()
    (folder / "of-one-that-was-killed.npy").write_bytes(b"")
    with shelf_in(folder) as shelf:
        assert not list(folder.iterdir())
        shelf.of(PooledLog("one", Loads(pressed(), 1)), "one").load()
        assert list(folder.iterdir())
    assert not folder.exists()
