"""A measured KUKA LWR4+ in free motion: joint torques against inverse dynamics of the shipped URDF."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

import kinid

Array = NDArray[np.float64]

# a reference implementation with the same inertial table leaves 1.32 0.79 0.53 0.85 1.29 0.67 0.27 on the first file
LIMITS = np.array([1.4, 0.85, 0.65, 0.95, 1.4, 0.75, 0.35])  # [N·m]
REFERENCE = np.array([1.32, 0.79, 0.53, 0.85, 1.29, 0.67, 0.27])
RIG = """\
[robot]
model = "lwr4plus"

[columns]
t = { column = "times" }
q = { column = "positions" }
tau = { column = "torques" }
"""
DERIVATIVES = """\
dq = { column = "velocities" }
ddq = { column = "accelerations" }
"""

pytestmark = pytest.mark.real


@pytest.fixture(params=[1, 2])
def path(request: pytest.FixtureRequest, real_data: Path) -> Path:
    return real_data / "lwr4plus-motion" / f"measurements_{request.param}.npz"


def torques(
    path: Path, folder: Path, text: str, differentiator: kinid.Differentiator | None = None
) -> kinid.JointTorques:
    """As a user would: a rig beside nothing in particular, the log where it was recorded."""
    (folder / "rig.toml").write_text(text)
    rig = kinid.Rig.load(folder / "rig.toml")
    return kinid.joint_torques(kinid.read(path, rig), rig, differentiator=differentiator)


def show(what: str, path: Path, found: kinid.JointTorques) -> None:
    print(f"\n{path.name}, {what}: residual rms {found.rms.round(3)} of {found.measured_rms.round(2)} N·m", end="")


def test_logged_derivatives(path: Path, tmp_path: Path) -> None:
    assert (torques(path, tmp_path, RIG + DERIVATIVES).rms <= LIMITS).all()  # smoothed with the positions
    found = torques(path, tmp_path, RIG + DERIVATIVES, kinid.Differentiator())  # as logged
    show("logged velocities and accelerations", path, found)
    assert found.valid.all()
    assert (found.rms <= LIMITS).all()
    if path.stem.endswith("1"):  # printed to two digits there
        np.testing.assert_allclose(found.rms, REFERENCE, atol=0.0051)


def test_positions_alone(path: Path, tmp_path: Path) -> None:
    """The arm moves below 0.2 Hz, so 10 Hz is ample; at 25 Hz the stamps' jitter (0.06 ms) shows on joint 2."""
    found = torques(path, tmp_path, RIG, kinid.Differentiator(bandwidth=10.0))
    show("positions alone, 10 Hz", path, found)
    show("positions alone, the usual 25 Hz", path, torques(path, tmp_path, RIG))
    assert (found.rms <= LIMITS).all()
    step = next(step for step in found.provenance.steps if step.name == "differentiate")
    assert step.facts["bandwidth_hz"] == pytest.approx(10.0, rel=0.1)


def test_the_residual_can_tell_a_wrong_model(path: Path, tmp_path: Path) -> None:
    """The limits are no matter of course: a tool that is not there, a hung base, or swapped joints break them."""
    tool = "[tool]\nmass = 0.5\ncom = [0.0, 0.0, 0.05]\n"
    hung = RIG.replace('"lwr4plus"', '"lwr4plus"\ngravity = [0.0, 0.0, 9.81]')
    order = [f"joint_{j}" for j in (1, 4, 3, 2, 5, 6, 7)]
    swapped = RIG.replace('"lwr4plus"', f'"lwr4plus"\njoints = {order}')
    for wrong in (tool + RIG, hung, swapped):
        assert (torques(path, tmp_path, wrong + DERIVATIVES).rms > LIMITS).any()


def test_what_remains_is_friction_not_noise(path: Path, tmp_path: Path) -> None:
    """The residual of the joints that turn without much load goes with the sign of their velocity."""
    found = torques(path, tmp_path, RIG + DERIVATIVES)
    with np.load(path, allow_pickle=False) as data:
        velocity = data["velocities"]
    follows = [float(np.corrcoef(np.sign(velocity[:, j]), found.residual[:, j])[0, 1]) for j in range(7)]
    print(f"\n{path.name}: correlation of the residual with the sign of the velocity {np.round(follows, 2)}", end="")
    assert min(follows[j] for j in (0, 2, 3, 4, 5)) > 0.7
