"""Plans carried out by the virtual arm, and read back."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import typer
from typer.testing import CliRunner

import kinid
from kinid.cli.lab import lab
from kinid.cli.plan import app as plan_app
from kinid.data.rig import Rig
from kinid.errors import InputError
from kinid.identification.fit import fit_model
from kinid.lab.arm import Gains
from kinid.lab.experiments import prepare
from kinid.lab.planned import doubts, planned
from kinid.lab.writing import write_rig
from kinid.modeling.model import Model
from kinid.planning.trajectory import Trajectory, read_trajectory
from kinid.signal.derivative import Differentiator
from kinid.writers import write_table

VALUES = ["--value", "stiffness=732", "--value", "damping=9.9"]
TRUE = {"stiffness": (732.0, 0.03), "damping": (9.9, 0.10), "coefficient": (0.82, 0.05)}
PLANS = {
    "poke": ["poke", "--model", "kelvin-voigt", *VALUES],
    "slide": [
        "slide",
        "--through",
        "0,0;0.006,0;0.006,0.006",
        "--model",
        "kelvin-voigt,coulomb-friction",
        *VALUES,
        "--value",
        "coefficient=0.82",
    ],
    "excite": ["excite", "--model", "kelvin-voigt", *VALUES, "--bandwidth", "2", "--max-depth", "0.01"],
    "free": ["excite", "--model", "tool-mass,tool-com"],
    "blind": ["poke"],
}


@pytest.fixture(scope="module")
def app() -> typer.Typer:
    app = typer.Typer()
    app.command()(lab)
    return app


@pytest.fixture(scope="module")
def plans(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Plans, and the rig beside them that they are for."""
    folder = tmp_path_factory.mktemp("plans")
    write_rig(folder, prepare("poke"))
    for name, words in PLANS.items():
        made = CliRunner().invoke(
            plan_app, [*words, "--rig", str(folder / "rig.toml"), "-o", str(folder / f"{name}.parquet")]
        )
        assert made.exit_code == 0, made.output
    return folder


def carried_out(app: typer.Typer, plans: Path, name: str, out: Path, *words: str) -> tuple[kinid.ContactSeries, str]:
    result = CliRunner().invoke(app, ["--trajectory", str(plans / f"{name}.parquet"), "-o", str(out), *words])
    assert result.exit_code == 0, (result.output, result.exception)
    rig = Rig.load(out / "rig.toml")
    log = kinid.read(out / "log.parquet", rig)
    return kinid.contact_series(log, rig, differentiator=Differentiator(bandwidth=40.0)), result.output


@pytest.mark.parametrize(
    ("name", "effects"),
    [
        ("poke", ("kelvin-voigt",)),
        ("excite", ("kelvin-voigt",)),
        ("slide", ("kelvin-voigt", "coulomb-friction")),
    ],
)
def test_a_plan_that_is_carried_out_gives_the_material_back(
    app: typer.Typer, plans: Path, tmp_path: Path, name: str, effects: tuple[str, ...]
) -> None:
    touch, _ = carried_out(app, plans, name, tmp_path / "x", "--seed", "3")
    assert {path.name for path in (tmp_path / "x").iterdir()} == {
        "log.parquet",
        "log.mcap",
        "streams",
        "rig.toml",
        "truth",
    }
    assert touch.phase is not None
    channels = ("normal_force", "tangential_force1", "tangential_force2") if len(effects) > 1 else ("normal_force",)
    # without the retraction: the material lets go where the equation of Kelvin-Voigt would pull
    fit = fit_model(
        Model(*effects, "sensor-bias"), touch, channels=channels, train=touch.phase != "retract", held_out=False
    )
    for parameter in ("stiffness", "damping", "coefficient")[: 1 + len(effects)]:
        (true, within), found = TRUE[parameter], fit[parameter]
        print(f"{name}: {found}, true {true:g}")
        assert found.value == pytest.approx(true, rel=within)


def test_the_tip_goes_where_the_plan_says(plans: Path) -> None:
    rig, motion = Rig.load(plans / "rig.toml"), read_trajectory(plans / "poke.parquet")
    setup, ahead = planned(plans / "poke.parquet", rig)
    assert ahead
    assert setup.rig.surface == rig.surface
    result = setup.run()
    wanted = np.stack([np.interp(result.motion.t, motion.t - motion.t[0], motion.tip[:, k]) for k in range(3)], axis=1)
    # 5 Hz of the signal is beyond the arm's 3 Hz
    assert np.sqrt(np.mean((result.motion.tip - wanted) ** 2)) < 3e-4
    with pytest.raises(InputError, match="translational stiffness"):
        planned(plans / "poke.parquet", rig, base=prepare("poke", gains=Gains(translation=0.0)))
    blind, ahead = planned(plans / "blind.parquet", rig)
    assert not ahead
    assert blind.run().motion.place[:, 2].max() < result.motion.place[:, 2].max()


def test_free_motion_and_what_is_said_without_forces(app: typer.Typer, plans: Path, tmp_path: Path) -> None:
    touch, _ = carried_out(app, plans, "free", tmp_path / "free")
    assert not touch.in_contact.any()
    assert "expects no forces" in carried_out(app, plans, "blind", tmp_path / "blind")[1]


def test_what_is_hidden_is_told_to_the_truth_alone(app: typer.Typer, plans: Path, tmp_path: Path) -> None:
    _, said = carried_out(app, plans, "poke", tmp_path / "x", "--hide", "relaxation", "--seed", "7")
    truth = json.loads((tmp_path / "x" / "truth" / "log.json").read_text())
    assert truth["hidden"]["effect"] == "relaxation"
    assert truth["trajectory"] == "poke.parquet"
    assert "relaxation" not in said
    for path in (tmp_path / "x").rglob("*"):
        assert path.is_dir() or path.parent.name == "truth" or b"relaxation" not in path.read_bytes()


def test_the_seed_alone_decides(app: typer.Typer, plans: Path, tmp_path: Path) -> None:
    logs = []
    for name, seed in (("a", "1"), ("b", "1"), ("c", "2")):
        carried_out(app, plans, "poke", tmp_path / name, "--seed", seed)
        logs.append((tmp_path / name / "log.parquet").read_bytes())
    assert logs[0] == logs[1] != logs[2]


def _changed(columns: dict[str, Any], **changes: Any) -> dict[str, Any]:
    return {**columns, **changes}


def test_a_trajectory_that_does_not_fit_is_refused(plans: Path, tmp_path: Path, app: typer.Typer) -> None:
    motion = read_trajectory(plans / "poke.parquet")
    only = {
        name: values for name, values in motion.columns().items() if name[0] in "tq" and name[:3] not in ("tip", "tou")
    }
    far, jump, moving = (only["q2"].copy() for _ in range(3))
    far[100:] += 3.0
    jump[100:] += 0.05
    late = len(only["t"]) // 2
    cases: list[tuple[dict[str, Any], str]] = [
        (_changed(only, q2=far), "joint_2 at .* limits"),
        (_changed(only, q2=jump), "joint_2 at .* rad/s .* limit"),
        ({name: values[late:] for name, values in only.items()}, "begins"),
        ({name: values for name, values in only.items() if name != "q7"}, "6 joints"),
        (_changed(only, q2=np.full(len(moving), np.nan)), "no numbers"),
    ]
    for i, (columns, words) in enumerate(cases):
        path = tmp_path / f"{i}.parquet"
        write_table(path, columns)
        for name, options in (("table", ["--rig", str(plans / "rig.toml")]), ("no rig", [])):
            refused = CliRunner().invoke(app, ["--trajectory", str(path), *options, "-o", str(tmp_path / "never")])
            with pytest.raises(InputError, match=words):
                raise refused.exception or AssertionError(name)
    # another arm's joints, as the file says
    other = dataclasses.replace(motion, joint_names=tuple(f"panda_joint{j + 1}" for j in range(7)))
    other.write(tmp_path / "panda.parquet")
    with pytest.raises(InputError, match="trajectory of panda_joint1.*joints of lwr4plus"):
        planned(tmp_path / "panda.parquet", Rig.load(plans / "rig.toml"))
    assert not (tmp_path / "never").exists()


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda m: {"t": 1e3 * m.t}, "samples 2 s apart.*expected times in s"),
        (lambda m: {"t": 1e3 * m.t, "dq": 1e-3 * m.dq, "ddq": 1e-6 * m.ddq}, "samples 2 s apart.*expected times in s"),
        (lambda m: {"t": np.concatenate([m.t[:-1], [2100.0]])}, "2.1e.06 set-points at 1000 Hz"),
        (lambda m: {"dq": np.rad2deg(m.dq)}, "whose dq. is not the derivative"),
        (lambda m: {"dq": 0.0 * m.dq, "ddq": 0.0 * m.ddq}, "whose dq. is not the derivative"),
        (lambda m: {"tip": 1e3 * m.tip}, "tip_x, tip_y, tip_z lie up to"),
        (lambda m: {"tip": m.tip + [0.001, 0.0, 0.0]}, "lie up to 1.00 mm beside where its joints"),
        (lambda m: {"place": m.place + [0.02, 0.0, 0.0]}, "slips lie up to 20.00 mm beside"),
    ],
)
def test_a_trajectory_that_contradicts_itself_is_refused(
    plans: Path, tmp_path: Path, change: Callable[[Trajectory], dict[str, Any]], words: str
) -> None:
    motion = read_trajectory(plans / "poke.parquet")
    dataclasses.replace(motion, **change(motion)).write(tmp_path / "other.parquet")
    with pytest.raises(InputError, match=words):
        planned(tmp_path / "other.parquet", Rig.load(plans / "rig.toml"))


@pytest.mark.parametrize("name", list(PLANS))
@pytest.mark.parametrize("every", [1, 25])
def test_plans_are_taken_at_any_rate(plans: Path, tmp_path: Path, name: str, every: int) -> None:
    motion = read_trajectory(plans / f"{name}.parquet")
    rows = {key: values[::every] for key, values in motion.columns().items()}
    write_table(tmp_path / "plan.csv", rows)
    planned(tmp_path / "plan.csv", Rig.load(plans / "rig.toml"))


def test_a_log_is_no_plan_and_a_hurried_plan_neither(app: typer.Typer, plans: Path, tmp_path: Path) -> None:
    """A plan ten times as fast asks for accelerations that the arm hasn't; what a log's noise asks for is said."""
    out = tmp_path / "x"
    assert CliRunner().invoke(app, ["--trajectory", str(plans / "poke.parquet"), "-o", str(out)]).exit_code == 0
    words = ["--trajectory", str(out / "log.parquet"), "--rig", str(plans / "rig.toml"), "-o", str(tmp_path / "again")]
    assert "a log's noise" in " ".join(CliRunner().invoke(app, words).output.split())
    motion = read_trajectory(plans / "poke.parquet")
    columns = {"t": 0.1 * motion.t} | {f"q{j + 1}": motion.q[:, j] for j in range(7)}
    write_table(tmp_path / "fast.parquet", columns)
    words = [
        "--trajectory",
        str(tmp_path / "fast.parquet"),
        "--rig",
        str(plans / "rig.toml"),
        "-o",
        str(tmp_path / "no"),
    ]
    assert "rad/s" in str(CliRunner().invoke(app, words).exception)
    assert not (tmp_path / "no").exists()
    setup, _ = planned(plans / "poke.parquet", Rig.load(plans / "rig.toml"))
    said = doubts(setup)
    assert not [line for line in said if "jerk" in line]
    # the study's signal has half of its speed in 5 Hz
    assert [line for line in said if "no longer follows" in line]
    assert not doubts(planned(plans / "slide.parquet", Rig.load(plans / "rig.toml"))[0])


def test_a_rig_that_is_not_the_plan_s_is_refused(plans: Path) -> None:
    rig = Rig.load(plans / "rig.toml")
    assert rig.surface is not None
    lower = rig.model_copy(update={"surface": rig.surface.model_copy(update={"point": (0.55, 0.0, 0.09)})})
    with pytest.raises(InputError, match="depths lie up to 10.00 mm beside"):
        planned(plans / "poke.parquet", lower)
    for tables, words in (
        ({"robot": {"model": "panda"}}, "isn't the laboratory's"),
        ({"robot": {"model": "lwr4plus", "gravity": [0.0, 9.81, 0.0]}}, "gravity"),
        ({"surface": {"mesh": "part.stl"}}, "mesh"),
    ):
        with pytest.raises(InputError, match=words):
            planned(plans / "poke.parquet", Rig.parse(tables))
    with pytest.raises(InputError, match="inside the material"):
        planned(plans / "poke.parquet", rig, point=(0.55, 0.0, 0.2))


def test_a_force_limit_makes_the_run_a_guarded_move(app: typer.Typer, plans: Path, tmp_path: Path) -> None:
    """A material harder than the plan believed: the arm stands still where the limit is passed, and the run says so."""
    words = ["poke", "--model", "hooke", "--value", "stiffness=200", "--rig", str(plans / "rig.toml")]
    for name, limit in (("soft", 1.0), ("free", None)):
        more = [] if limit is None else ["--force-limit", str(limit)]
        made = CliRunner().invoke(plan_app, [*words, *more, "-o", str(tmp_path / f"{name}.parquet")])
        assert made.exit_code == 0, made.output
    most = {}
    for name in ("soft", "free"):
        touch, said = carried_out(app, tmp_path, name, tmp_path / name, "--rig", str(plans / "rig.toml"))
        assert touch.normal_force is not None
        most[name] = float(touch.normal_force.max())
        assert ("the force passed the plan's limit of 1 N" in said) == (name == "soft")
    print(f"measured at most: {most}")
    assert most["free"] > most["soft"] > 1.0
    # it overshoots: the approach was slow enough for the softer material that the plan believed in
    assert most["soft"] - 1.0 < 0.5 * (most["free"] - 1.0)
