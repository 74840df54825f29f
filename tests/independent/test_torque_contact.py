"""Forces from measured joint torques: a leg above an ATI sensor, and an arm that touches nothing."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from independent.test_leg_contact import URDF, record
from numpy.typing import NDArray

import kinid
from kinid.calibration.free_torques import without_free_torques
from kinid.identification.fitted import FittedModel

Array = NDArray[np.float64]

FORCES = ("tangential_force1", "tangential_force2", "normal_force")
#: below this the sensor under the foot reads nothing [N]: its noise is a tenth of it
AIR = 0.5

pytestmark = pytest.mark.real


@pytest.fixture
def leg(tmp_path: Path) -> kinid.Rig:
    """The leg without its sensor; its hip is in the base frame, and the ground far from it, as it hops."""
    (tmp_path / "leg.urdf").write_text(URDF)
    return kinid.Rig.parse(
        {
            "robot": {"model": "leg.urdf", "tip_frame": "foot"},
            "surface": {"point": [0.0, 0.0, 5.0], "normal": [0.0, 0.0, 1.0]},
        },
        folder=tmp_path,
    )


def against(log: kinid.Log, touch: kinid.ContactSeries, rows: NDArray[np.bool_]) -> dict[str, tuple[float, ...]]:
    """Error rms [N], said standard deviation [N], share inside two of it, correlation; of horizontal and vertical."""
    assert touch.force_sd is not None
    out = {}
    for name, k, axis in (("horizontal", 0, 0), ("vertical", 2, 2)):
        force, true, sd = getattr(touch, FORCES[k])[rows], np.asarray(log.wrench)[rows, axis], touch.force_sd[k][rows]
        error = force - true
        share, sure = float(np.mean(np.abs(error) < 2 * sd)), float(np.median(sd))
        out[name] = (float(np.sqrt(np.mean(error**2))), sure, share, float(np.corrcoef(force, true)[0, 1]))
    return out


def test_a_jump(leg: kinid.Rig, real_data: Path) -> None:
    """What 0.14 s in the air tell of the leg's friction serves the rest; sideways no joint feels anything."""
    log = record(real_data / "leg-contact" / "jump")
    air = np.abs(np.asarray(log.wrench)[:, 2]) < AIR
    touch = kinid.contact_series(log.replace(wrench=None, phase=np.where(air, "free", "touch")), leg)
    found = against(log, touch, ~air)
    print("\njump:", {name: [round(x, 3) for x in row] for name, row in found.items()})
    assert np.isnan(touch.tangential_force2).all()
    assert any("don't feel a force along the second tangent" in line for line in touch.warnings)
    assert found["vertical"][0] < 0.2 * float(np.sqrt(np.mean(np.asarray(log.wrench)[~air, 2] ** 2)))
    assert found["vertical"][3] > 0.95
    assert all(row[2] >= 0.9 for row in found.values())


def test_push_and_pull_without_free_motion(leg: kinid.Rig, real_data: Path) -> None:
    """Nothing to learn from: the stated share of the torque stands in, and is too little for the knee's gain."""
    log = record(real_data / "leg-contact" / "push_pull")
    touch = kinid.contact_series(log.replace(wrench=None), leg)
    found = against(log, touch, np.ones(len(log), np.bool_))
    print("\npush and pull:", {name: [round(x, 3) for x in row] for name, row in found.items()})
    assert any("no free motion to learn" in line for line in touch.warnings)
    assert found["vertical"][3] > 0.97
    assert found["vertical"][0] < 0.25 * float(np.sqrt(np.mean(np.asarray(log.wrench)[:, 2] ** 2)))
    assert found["vertical"][2] > 0.7  # of a normal distribution 0.95: a limit, in docs/limits.md


def panda(real: Path, touch: slice) -> tuple[kinid.Log, kinid.Rig]:
    """An exciting trajectory in the air; rows of `touch` aren't labelled as free."""
    folder = real / "panda-motion"
    q, dq, tau = (
        np.loadtxt(folder / f"exciting_traj_{name}.txt").reshape(-1, 7)[::4]
        for name in ("positions", "velocity", "torques")
    )
    t = np.loadtxt(folder / "exciting_traj_time.txt")[::4]
    phase = np.full(len(t), "free", dtype="<U5")
    phase[touch] = "touch"
    tables = {
        "robot": {"model": "panda", "joints": [f"panda_joint{k}" for k in range(1, 8)], "tip_frame": "panda_link8"},
        "surface": {"point": [0.0, 0.0, 5.0], "normal": [0.0, 0.0, 1.0]},
    }
    return kinid.Log(t, q=q, dq=dq, tau=tau, phase=phase), kinid.Rig.parse(tables)


def test_an_arm_that_touches_nothing(real_data: Path, tmp_path: Path) -> None:
    """The last 7 s of 21 s, all of which is free motion: every force is false. A fit to the first 14 s thirds it."""
    begin = 2 * 5136 // 3
    log, rig = panda(real_data, slice(begin, None))
    parts = {name: np.asarray(getattr(log, name))[:begin] for name in ("t", "q", "dq", "tau", "phase")}
    effects = ("joint-torque-offset", "joint-coulomb-friction", "joint-viscous-friction", "payload")
    kinid.Model("rigid-body", *effects).fit(kinid.Log(**parts), rig).save(tmp_path / "free.json")
    bare, helped = (
        kinid.contact_series(log, rig),
        without_free_torques(log, rig, FittedModel.load(tmp_path / "free.json")).touch,
    )
    sizes = []
    for name, touch in (("as it is", bare), ("with the fit", helped)):
        assert touch.force_sd is not None
        force = np.stack([getattr(touch, name) for name in FORCES])[:, begin:]
        sizes.append(np.sqrt(np.mean(force**2, axis=1)))
        share = np.mean(np.abs(force) < 2 * touch.force_sd[:, begin:], axis=1)
        said = np.median(touch.force_sd[:, begin:], axis=1)
        print(
            f"\n{name}: false force {sizes[-1].round(2)} N rms, said {said.round(2)}, inside two {share.round(3)}",
            end="",
        )
        assert (share >= 0.9).all()
    assert (sizes[0] < 6.0).all()
    assert (sizes[1] < 0.5 * sizes[0]).all()


def test_seven_seconds_of_other_poses(real_data: Path) -> None:
    """The middle 7 s, between free motion that is unlike it: deviations are too narrow, as docs/limits.md says."""
    rows = slice(5136 // 3, 2 * 5136 // 3)
    touch = kinid.contact_series(*panda(real_data, rows))
    assert touch.force_sd is not None
    force, sd = np.stack([getattr(touch, name) for name in FORCES])[:, rows], touch.force_sd[:, rows]
    share = np.mean(np.abs(force) < 2 * sd, axis=1)
    print(f"\nfalse force {np.sqrt(np.mean(force**2, axis=1)).round(2)} N rms, inside two {share.round(3)}", end="")
    assert (share > 0.6).all()
