"""For one model and log `fit`, `compare` and `diagnose` say the same: values, intervals and errors."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scripted import RIG, scripted_poke
from typer.testing import CliRunner

import kinid
from kinid.cli import app
from kinid.identification.compare import compare
from kinid.identification.fit import Fit, fit_model
from kinid.writers import write_table

Case = tuple[kinid.Log, kinid.Rig, kinid.Model]


def pressed() -> Case:
    """Pokes at several speeds and slides; the model knows the spring, and neither dashpot nor relaxation nor
    friction.
    """
    t = np.arange(6000) / 250.0
    rng = np.random.default_rng(4)
    depth = 3e-3 * np.sin(1.3 * t) + 1e-3 * np.sin(7.0 * t) * (np.sin(0.5 * t) > 0)
    slip = 4e-3 * np.sin(2.1 * t)
    normal = np.where(depth > 0, np.maximum(800.0 * depth + 6.0 * np.gradient(depth, t), 0.0), 0.0)
    zero = np.zeros_like(t)
    noise = 0.02 * rng.standard_normal((3, len(t)))
    contact = {
        "depth": depth,
        "normal_force": normal + noise[0],
        "slip1": slip,
        "slip2": zero,
        "tangential_force1": -0.4 * normal * np.tanh(np.gradient(slip, t) / 1e-3) + noise[1],
        "tangential_force2": noise[2],
    }
    return kinid.Log(t=t, contact=contact), kinid.Rig(), kinid.Model("hooke")


def wrench() -> Case:
    """The scripted poke of an arm, six channels."""
    return scripted_poke(seed=2).log, kinid.Rig.parse_text(RIG), kinid.Model("kelvin-voigt", "coulomb-friction")


def joints(swing: Callable[..., Any]) -> Case:
    """Half a minute of an arm that rubs, in free motion."""
    rng, t = np.random.default_rng(8), np.arange(6000) / 200.0
    q, dq, ddq = swing(np.deg2rad([0.0, -40.0, 0.0, 85.0, 0.0, -55.0, 0.0]), seed=3, size=0.5, speed=3.0)(t)
    rig = kinid.Rig.parse({"robot": {"model": "lwr4plus"}})
    from kinid.robotics.inverse_dynamics import inverse_dynamics
    from kinid.robotics.robot import Robot

    tau = inverse_dynamics(Robot.load(rig), q, dq, ddq) + 0.4 * np.tanh(20.0 * dq) + 0.2 * dq
    log = kinid.Log(t, q=q, dq=dq, ddq=ddq, tau=tau + 0.02 * rng.standard_normal(q.shape))
    return log, rig, kinid.Model("rigid-body", "joint-coulomb-friction")


@pytest.fixture(scope="module", params=["tester", "wrench", "joints"])
def case(request: pytest.FixtureRequest, swing: Callable[..., Any]) -> Case:
    return {"tester": pressed, "wrench": wrench, "joints": lambda: joints(swing)}[request.param]()


@pytest.fixture(scope="module")
def fitted(case: Case) -> Fit:
    log, rig, model = case
    return fit_model(model, log, rig)


def same(one: Fit, other: Fit) -> None:
    """To the last digit: it is one way from a log to a fit."""
    assert one.model.names == other.model.names
    assert one.parameters == other.parameters
    assert one.error == other.error


def test_compare_says_what_fit_says(case: Case, fitted: Fit) -> None:
    log, rig, model = case
    (row,) = compare([model], log, rig).rows
    same(row.fit, fitted)
    assert row.held_out == fitted.error.held_out
    assert compare([model], log, rig).noise_floor == fitted.error.noise_floor


def test_diagnose_says_what_fit_says(case: Case, fitted: Fit) -> None:
    """Of the model that is asked about: from the log, and from the fit."""
    log, rig, model = case
    found = kinid.diagnose(log, rig, model=model, max_effects=0)
    same(found.fit, fitted)
    assert (found.steps[0].train, found.steps[0].held_out) == pytest.approx(
        (fitted.error.train, fitted.error.held_out), rel=1e-9
    )
    assert found.noise_floor == pytest.approx(fitted.error.noise_floor, rel=1e-9)
    again = kinid.diagnose(fitted, max_effects=0)
    assert again.steps[0].held_out == pytest.approx(fitted.error.held_out, rel=1e-3)
    for name, p in again.fit.parameters.items():
        assert abs(p.value - fitted[name].value) < 0.02 * (fitted[name].high - fitted[name].low)


def test_the_model_that_was_found_is_fitted_alike(case: Case) -> None:
    """A search from a diagnosis' values and one from nothing end at one place: within 2 % of an interval, errors to 1
    %.
    """
    log, rig, model = case
    found = kinid.diagnose(log, rig, model=model, max_effects=1)
    assert len(found.added) == 1
    better = fit_model(model + found.added[0], log, rig)
    assert better.error.held_out == pytest.approx(found.steps[-1].held_out, rel=0.01)
    assert better.error.held_out == pytest.approx(found.fit.error.held_out, rel=0.01)
    for name, p in found.fit.parameters.items():
        wide = p.high - p.low
        assert abs(better[name].value - p.value) < max(0.02 * wide, 1e-6 * abs(p.value)), name
        assert better[name].high - better[name].low == pytest.approx(wide, rel=0.05), name


def test_the_command_line_says_it_too(tmp_path: Path) -> None:
    log, _, model = pressed()
    write_table(tmp_path / "log.parquet", {"t": log.t, **log.contact})
    files = {}
    for command in ("fit", "compare", "diagnose"):
        files[command] = tmp_path / f"{command}.json"
        more = ["--max-effects", "0"] if command == "diagnose" else []
        words = [command, tmp_path / "log.parquet", "--model", model, *more, "--json", files[command]]
        done = CliRunner().invoke(app, list(map(str, words)))
        assert done.exit_code == 0, done.output
    fit, compared, diagnosed = (json.loads(path.read_text()) for path in files.values())
    row = compared["models"][0]
    assert row["parameters"] == fit["parameters"]
    assert row["error"] == fit["error"]
    assert diagnosed["error"]["before"] == pytest.approx(fit["error"]["held_out"], rel=1e-9)
    assert diagnosed["error"]["noise_floor"] == pytest.approx(fit["error"]["noise_floor"], rel=1e-9)
    assert diagnosed["error"]["unit"] == fit["error"]["unit"]


def test_a_bias_that_contact_quantities_lack_is_not_diagnosed() -> None:
    """The wrench behind a touch is looked at without the bias of free motion that the touch was freed of."""
    log, rig, model = wrench()
    touch = kinid.contact_series(log, rig)
    assert rig.sensor.bias is None
    assert touch.bias is not None
    assert np.abs(touch.bias).max() > 0.1
    stated = rig.model_copy(update={"sensor": rig.sensor.model_copy(update={"bias": tuple(touch.bias.tolist())})})
    found = kinid.diagnose(model.fit(touch), max_effects=0)
    held_out = kinid.diagnose(log, stated, model=model, max_effects=0).steps[0].held_out
    assert found.steps[0].held_out == pytest.approx(held_out, rel=0.01)
    assert kinid.diagnose(log, rig, model=model, max_effects=1).added == ("sensor-bias",)
