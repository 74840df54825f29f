"""Coupling between the axes, planted by hand: found, told apart where the log can, and taken out again."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from scripted import RIG, Material, Scripted, scripted_poke

from kinid.calibration.coupling import compensate, identifiability, load_fit
from kinid.contact.series import contact_series
from kinid.data.log import Log
from kinid.data.rig import Rig
from kinid.errors import InputError
from kinid.identification.fit import Fit, fit_model
from kinid.modeling.model import Model

RIG_READ = Rig.parse_text(RIG)


@pytest.fixture(scope="module")
def slippery() -> Scripted:
    """A poke whose true tangential force is zero: whatever shows is coupling."""
    return scripted_poke(seed=4, material=Material(friction=0.0))


def values(fit: Fit) -> dict[str, float]:
    return {name: p.value for name, p in fit.parameters.items()}


def with_wrench(log: Log, wrench: np.ndarray) -> Log:
    return log.replace(wrench=wrench)


def test_a_turned_sensor_loses_its_false_tangential_force(slippery: Scripted) -> None:
    turn = Rotation.from_rotvec([0.05, -0.03, 0.02]).as_matrix()  # some 3°
    raw = slippery.log.wrench
    assert raw is not None
    log = with_wrench(slippery.log, np.hstack([raw[:, :3] @ turn.T, raw[:, 3:] @ turn.T]))
    model = Model("kelvin-voigt", "sensor-misalignment", "sensor-bias")
    fit = fit_model(model, log, RIG_READ, held_out=False)
    touch = contact_series(log, RIG_READ)
    out = compensate(touch, log, RIG_READ, model, values(fit))
    print(out.line())
    noise = np.sqrt(2) * 0.016  # both tangential channels hold noise before and after
    assert out.before > 5 * noise
    assert np.sqrt(max(0.0, out.after**2 - noise**2)) < 0.1 * np.sqrt(out.before**2 - noise**2)


def test_a_material_that_pulls_sideways_loses_it_too(slippery: Scripted) -> None:
    axes = RIG_READ.axes
    assert axes is not None
    depth = np.maximum(slippery.depth, 0.0)
    rate = np.where(depth > 0, np.gradient(depth, slippery.log.t), 0.0)
    sideways = np.column_stack([120 * depth + 1.5 * rate, -60 * depth, 0 * depth])
    from kinid.robotics.robot import Robot

    robot = Robot.load(RIG_READ)
    rotation = robot.kinematics("ft_sensor", slippery.log.q).rotation
    force = np.einsum("nji,nj->ni", rotation, sideways @ axes)
    raw = np.array(slippery.log.wrench)
    raw += np.hstack([force, np.cross(robot.tip_in_sensor(), force)])
    log = with_wrench(slippery.log, raw)
    touch = contact_series(log, RIG_READ)
    model = Model("kelvin-voigt", "coupled-stiffness")
    fit = fit_model(model, touch, held_out=False)
    assert fit["stiffness-1n"].value == pytest.approx(120, rel=0.05)
    assert fit["stiffness-2n"].value == pytest.approx(-60, rel=0.05)
    assert fit["damping-1n"].value == pytest.approx(1.5, rel=0.3)
    out = compensate(touch, log, RIG_READ, model, values(fit))
    print(out.line())
    noise = np.sqrt(2) * 0.016
    assert np.sqrt(max(0.0, out.after**2 - noise**2)) < 0.1 * np.sqrt(out.before**2 - noise**2)
    np.testing.assert_array_equal(out.touch.depth, touch.depth)


def test_what_is_said_is_what_coupling_did() -> None:
    """Beside friction the whole force hardly changes, up or down; the coupling's part is told by itself."""
    turn = Rotation.from_rotvec([0.05, -0.03, 0.0]).as_matrix()
    rubbing = scripted_poke(seed=4, material=Material(friction=0.8))
    raw = rubbing.log.wrench
    assert raw is not None
    log = with_wrench(rubbing.log, np.hstack([raw[:, :3] @ turn.T, raw[:, 3:] @ turn.T]))
    model = Model("kelvin-voigt", "coulomb-friction", "sensor-misalignment", "sensor-bias")
    fit = fit_model(model, log, RIG_READ, held_out=False)
    straight = contact_series(rubbing.log, RIG_READ)
    touch = contact_series(log, RIG_READ)
    out = compensate(touch, log, RIG_READ, model, values(fit))
    false = np.hypot(
        touch.tangential_force1 - straight.tangential_force1, touch.tangential_force2 - straight.tangential_force2
    )[touch.in_contact]
    print(out.line())
    assert out.coupling == pytest.approx(np.sqrt(np.mean(false**2)), rel=0.1)
    assert f"{out.coupling:.4g} N rms of lateral force" in out.line()


def test_what_one_log_can_not_tell_apart_is_said(slippery: Scripted) -> None:
    """One slide along the first tangent: across it, a tilt and a material that pulls sideways look the same."""
    said = identifiability(
        fit_model(
            Model("kelvin-voigt", "surface-tilt", "coupled-stiffness"),
            contact_series(slippery.log, RIG_READ),
            held_out=False,
        )
    )
    print("\n".join(said))
    for name in ("surface-tilt.slope2", "coupled-stiffness.stiffness-2n"):
        assert any(name in line for line in said)
    # a turned sensor carries no moment to its origin, a tilted surface does: the torques tell these two apart
    turned = fit_model(
        Model("kelvin-voigt", "surface-tilt", "sensor-misalignment"), slippery.log, RIG_READ, held_out=False
    )
    assert not identifiability(turned)


def test_a_tilted_surface_is_measured() -> None:
    log = scripted_poke(seed=6, material=Material(friction=0.0)).log
    tilted = RIG.replace("normal = [0, 0, 1]", "normal = [0.03, 0, 1]")
    fit = fit_model(Model("kelvin-voigt", "surface-tilt"), contact_series(log, Rig.parse_text(tilted)), held_out=False)
    # the rig's normal leans towards +x by 0.03, so that the true surface falls along −x and rises along +x by 0.03
    assert fit["slope1"].value == pytest.approx(0.03, abs=0.002)


def test_a_file_that_is_no_fit_is_refused(tmp_path: Path, slippery: Scripted) -> None:
    path = tmp_path / "fit.json"
    for text in ("", "[]", '{"model": ["hooke"]}', '{"model": ["nothing"], "parameters": {}}'):
        path.write_text(text)
        with pytest.raises(InputError):
            load_fit(path)
    path.write_text(json.dumps({"model": ["hooke"], "parameters": {"hooke.stiffness": {"value": 3.0}}}))
    model, found = load_fit(path)
    assert found == {"hooke.stiffness": 3.0}
    with pytest.raises(InputError, match="without a coupling effect"):
        compensate(contact_series(slippery.log, RIG_READ), slippery.log, RIG_READ, model, found)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"unit": "N/mm"}, "hooke.stiffness in N/mm in .*expected it in N/m"),
        ({"unit": "s"}, "expected it in N/m"),
        ({"unit": 3}, "hooke.stiffness in 3"),
        ({"value": True}, "value = True"),
        ({"value": "500"}, "value = 500"),
        ({"value": None}, "without a value"),
    ],
)
def test_a_fit_with_another_unit_or_no_number_is_refused(
    changes: dict[str, object], words: str, tmp_path: Path
) -> None:
    path = tmp_path / "fit.json"
    fit = {
        "model": ["hooke"],
        "parameters": {"hooke.stiffness": {"value": 500.0, "unit": "N/m"} | changes},
        "layout": {"kind": "contact", "channels": ["normal_force"], "joints": []},
    }
    path.write_text(json.dumps(fit))
    with pytest.raises(InputError, match=words):
        load_fit(path)
