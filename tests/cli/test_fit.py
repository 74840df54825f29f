"""`kinid fit`, `kinid compare` and `kinid contact --compensate` as a user meets them."""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest

from kinid.lab.experiments import prepare
from kinid.lab.writing import write_log, write_rig

Run = Callable[..., tuple[int, str, str]]
Refused = Callable[..., None]


def test_fit_prints_and_writes_what_the_contract_says(run: Run, log: Path) -> None:
    folder = log.parent
    code, said, err = run(
        "fit",
        log,
        "--model",
        "kelvin-voigt,coulomb-friction",
        "--json",
        folder / "f.json",
        "--plot",
        folder / "f.html",
        "-o",
        folder / "f.parquet",
    )
    assert code == 0, err
    assert "kelvin-voigt.stiffness" in said
    facts = json.loads((folder / "f.json").read_text())
    assert facts["model"] == ["kelvin-voigt", "coulomb-friction"]
    stiffness = facts["parameters"]["kelvin-voigt.stiffness"]
    assert stiffness["low"] < 732.0 < stiffness["high"]
    assert stiffness["unit"] == "N/m"
    assert set(facts["error"]) == {"unit", "train", "held_out", "noise_floor"}
    assert "depth [mm]" in (folder / "f.html").read_text()
    table = pq.read_table(folder / "f.parquet")
    assert "normal_force_model" in table.column_names
    residual = table["normal_force"].to_numpy() - table["normal_force_model"].to_numpy()
    assert np.sqrt(np.nanmean(residual**2)) < 0.04  # the sensor's noise of 0.03 N


def test_compare_ranks(run: Run, log: Path) -> None:
    folder = log.parent
    code, said, err = run(
        "compare",
        log,
        "--model",
        "hooke",
        "--model",
        "kelvin-voigt",
        "--model",
        "hertz",
        "--reference",
        "hooke",
        "--json",
        folder / "c.json",
        "--plot",
        folder / "c.html",
    )
    assert code == 0, err
    facts = json.loads((folder / "c.json").read_text())
    assert facts["models"][0]["model"] == ["kelvin-voigt"]
    assert facts["reference"] == "hooke"
    assert "reference" in said
    assert (folder / "c.html").stat().st_size > 1e6


def test_joint_effects_are_fitted_to_joint_torques(run: Run, log: Path) -> None:
    code, said, err = run("fit", log, "--model", "rigid-body,joint-torque-offset,joint-coulomb-friction")
    assert code == 0, err
    assert "joint-coulomb-friction.coulomb[joint_7]" in said
    assert "N·m rms" in said


def test_coupling_is_fitted_and_taken_out(run: Run, log: Path) -> None:
    table = pq.read_table(log).to_pydict()
    fx = np.array(table["fx"]) + 0.05 * np.array(table["fz"])
    table["fx"] = list(fx)
    import pyarrow as pa

    pq.write_table(pa.table(table), log)
    fit = log.parent / "fit.json"
    code, _, err = run("fit", log, "--model", "kelvin-voigt,coulomb-friction,sensor-crosstalk", "--json", fit)
    assert code == 0, err
    code, said, err = run(
        "contact", log, "--compensate", fit, "-o", log.parent / "out.parquet", "--json", log.parent / "s.json"
    )
    assert code == 0, err
    assert "coupling taken out (sensor-crosstalk)" in said
    table = pq.read_table(log.parent / "out.parquet")
    poke = np.array(table["phase"].to_pylist()) == "hold"
    # held still before any slide, the true tangential force is nearly zero; 5 % of 2.9 N were false
    assert abs(np.mean(table["tangential_force1"].to_numpy()[poke])) < 0.03
    assert "lateral_rms_after" in json.loads((log.parent / "s.json").read_text())["compensated"]


def test_contact_takes_off_the_torques_of_free_motion(tmp_path: Path, run: Run) -> None:
    """Logs of an arm without a wrist sensor: one of motion in the air, one of a touch."""
    for name in ("wave", "poke"):
        result = prepare(name, seed=3).run()
        write_log(tmp_path / f"{name}.parquet", result.log.replace(wrench=None))
    write_rig(tmp_path, result.setup)
    rig, free = tmp_path / "rig.toml", tmp_path / "free.json"
    text = rig.read_text()
    rig.write_text(text[: text.index("[sensor]")])
    code, _, err = run("fit", tmp_path / "wave.parquet", "--model", "rigid-body,joint-coulomb-friction", "--json", free)
    assert code == 0, err
    poke = tmp_path / "poke.parquet"
    code, said, err = run(
        "contact", poke, "--compensate", free, "--json", tmp_path / "s.json", "-o", tmp_path / "o.csv"
    )
    assert code == 0, err
    assert "joint torques of free motion taken off as fitted (rigid-body, joint-coulomb-friction)" in said
    assert said.count("forces come from joint torques, not from a sensor") == 1
    assert "normal_force_sd" in (tmp_path / "o.csv").read_text().splitlines()[0]
    assert json.loads((tmp_path / "s.json").read_text())["compensated"]["effects"][0] == "rigid-body"
    rig.write_text(text)
    code, _, err = run("contact", poke, "--compensate", free)
    assert code == 2
    assert err.count("\n") == 1
    assert "a rig without [sensor]" in err


@pytest.fixture
def tester(tmp_path: Path) -> Path:
    """A log of a material tester, and no rig beside it."""
    t = np.arange(3000) / 1000
    w = 2 * np.pi * 1.1
    depth, rate = 4e-3 * np.sin(w * t), 4e-3 * w * np.cos(w * t)
    force = np.where(depth > 0, 700 * depth + 12 * rate, 0) + np.random.default_rng(0).normal(scale=0.03, size=3000)
    path = tmp_path / "tester" / "tester.csv"
    path.parent.mkdir()
    np.savetxt(path, np.column_stack([t, depth, force]), delimiter=",", header="t,depth,normal_force", comments="")
    return path


def test_a_material_tester_needs_no_rig(run: Run, refused: Refused, tester: Path) -> None:
    code, said, err = run("fit", tester, "--model", "kelvin-voigt", "--plot", tester.parent / "f.html")
    assert code == 0, err
    assert "kelvin-voigt.stiffness" in said
    code, said, err = run("contact", tester)
    assert code == 0, err
    assert "normal_force" in said
    page = tester.parent / "c.html"
    code, said, err = run("compare", tester, "--model", "hooke", "--model", "kelvin-voigt", "--plot", page)
    assert code == 0, err
    html = page.read_text()
    assert re.search("hooke: [^<]*this structure is rejected", html)
    assert "kelvin-voigt wins" in html
    # πcwA²/2 on the way in and out, c = 12 N·s/m at 1.1 Hz and 4 mm
    assert f"{1e3 * np.pi * 12 * 2 * np.pi * 1.1 * 4e-3**2 / 2:.3g}" == "2.08"
    assert "2.08 mJ" in html
    code, said, err = run("fit", tester, "--rig", tester.parent / "none.toml", "--model", "hooke")
    refused((code, said, err), "none.toml")


def test_a_log_that_does_not_speak_for_itself_needs_a_rig(run: Run, refused: Refused, log: Path) -> None:
    (log.parent / "rig.toml").unlink()
    refused(run("fit", log, "--model", "hooke"), "no rig")


def test_what_is_open_is_said_once(run: Run, log: Path) -> None:
    code, said, err = run("fit", log, "--model", "kelvin-voigt,sensor-crosstalk")
    assert code == 0, err
    assert "not identified" in said
    assert said.count("not identified") == 1
    assert " is open" not in said


@pytest.mark.parametrize(
    ("args", "words"),
    [
        (["fit", "--model", "hunt-crosley"], "hunt-crossley"),
        (["fit", "--model", ","], "names of effects"),
        (["fit", "--model", "hooke,hertz"], "one contact law"),
        (["fit", "--model", "presliding"], "coulomb-friction"),
        (["compare", "--model", "hooke", "--reference", "hertz"], "hertz"),
        (["contact", "--compensate", "nothing.json"], "nothing.json"),
    ],
)
def test_bad_use_is_refused_in_one_line(run: Run, refused: Refused, log: Path, args: list[str], words: str) -> None:
    refused(run(args[0], log, *args[1:]), words)


def test_a_surface_far_below_is_said(run: Run, refused: Refused, log: Path) -> None:
    rig = log.parent / "rig.toml"
    rig.write_text(rig.read_text().replace("0.10]", "-0.50]"))
    refused(run("fit", log, "--model", "hooke"), "never positive")


def test_a_rig_without_a_surface_is_said_of_a_law_of_contact(run: Run, refused: Refused, log: Path) -> None:
    rig = log.parent / "rig.toml"
    text = rig.read_text(encoding="utf-8")
    rig.write_text(text.partition("[surface]")[0], encoding="utf-8")
    for command in ("fit", "diagnose"):
        refused(run(command, log, "--model", "hooke"), "a rig without [surface]")
