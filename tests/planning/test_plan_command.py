"""`kinid plan` on the command line."""

from __future__ import annotations

import json
import re
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from kinid.cli import main
from kinid.planning import Trajectory, read_trajectory
from kinid.planning.check import usage
from kinid.planning.limits import Limits

RIG = """
[robot]
model = "lwr4plus"
[tool]
mass = 0.24
com = [0.0, 0.0, 0.049]
[surface]
point = [0.55, 0.0, 0.10]
normal = [0, 0, 1]
tangent = [1, 0, 0]
"""
LAW = ("--model", "hunt-crossley", "--value", "stiffness=1200", "--value", "damping=1500", "--value", "exponent=1.2")


@pytest.fixture
def run(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path) -> Any:
    (tmp_path / "rig.toml").write_text(RIG, encoding="utf-8")
    monkeypatch.chdir(tmp_path)

    def call(*args: object) -> tuple[int, str, str]:
        monkeypatch.setattr(sys, "argv", ["kinid", "plan", *map(str, args)])
        with pytest.raises(SystemExit) as stop:
            main()
        said = capsys.readouterr()
        return int(stop.value.code or 0), said.out, said.err

    return call


def test_poke(run: Any, tmp_path: Path) -> None:
    code, out, err = run(
        "poke",
        "-o",
        "p.parquet",
        "--sines",
        "0.001@1",
        "--duration",
        1,
        *LAW,
        "--force-limit",
        8,
        "--plot",
        "p.html",
        "--preview",
        "v.html",
    )
    assert code == 0, err
    assert "torque" in out
    motion = read_trajectory(tmp_path / "p.parquet")
    assert {"free", "approach", "hold", "poke", "retract", "rest"} == set(motion.phase.tolist())
    assert motion.provenance["guard"]["force"] == 8.0
    assert (tmp_path / "p.html").stat().st_size > 1_000_000
    assert (tmp_path / "v.html").stat().st_size > 100_000


def test_facts_of_plans_as_json(run: Any, tmp_path: Path) -> None:
    for args in (("poke", "--grid", "1x2", "--duration", 1, "--tilt", "0.1,0"), ("slide", "--through", "0,0;0.01,0")):
        code, out, err = run(*args, "--rate", 100, "-o", "p.parquet", "--json", "p.json", "--model", "hooke")
        assert code == 0, err
        assert "p.json" in out
        facts = json.loads((tmp_path / "p.json").read_text(encoding="utf-8"))
        motion = read_trajectory(tmp_path / "p.parquet")
        assert facts["motion"]["samples"] == len(motion) == sum(facts["motion"]["phases"].values())
        assert motion.place is not None
        assert facts["motion"]["deepest"] == pytest.approx(motion.place[:, 2].max())
        assert facts["motion"]["largest_normal_force"] == pytest.approx(1e3 * motion.place[:, 2].max(), rel=1e-6)
        assert max(use["share"] for use in facts["motion"]["used"]) <= 1.0
        assert len(facts["places"] if args[0] == "poke" else facts["slides"][0]["corners"]) == 2


def test_excite_finds_what_the_joints_can_do(run: Any, tmp_path: Path) -> None:
    """With no bound given the joints are what binds, and the motion keeps to them."""
    code, out, err = run(
        "excite",
        "--model",
        "kelvin-voigt",
        "--value",
        "stiffness=732",
        "--value",
        "damping=9.9",
        "-o",
        "e.parquet",
        "--json",
        "e.json",
        "--rate",
        200,
    )
    assert code == 0, err
    assert re.search(r"bound by (.*, )?the acceleration of joint_", " ".join(out.split()))
    facts = json.loads((tmp_path / "e.json").read_text(encoding="utf-8"))
    used = {use["quantity"]: use["share"] for use in facts["motion"]["used"]}
    assert 0.9 < used["acceleration"] <= 1.0
    # where joints are quicker, more can be told
    code, _, err = run(
        "excite",
        "--model",
        "kelvin-voigt",
        "--value",
        "stiffness=732",
        "--value",
        "damping=9.9",
        "-o",
        "f.parquet",
        "--json",
        "f.json",
        "--rate",
        200,
        "--acceleration",
        12,
    )
    assert code == 0, err
    more = json.loads((tmp_path / "f.json").read_text(encoding="utf-8"))
    assert more["intervals"]["kelvin-voigt.damping"]["half"] < facts["intervals"]["kelvin-voigt.damping"]["half"]


def test_campaigns(run: Any, tmp_path: Path) -> None:
    code, out, err = run("poke", "-o", "c.parquet", "--grid", "2x3", "--duration", 1, "--hold", 0.1, "--rate", 100)
    assert code == 0, err
    assert "6 places" in out
    motion = read_trajectory(tmp_path / "c.parquet")
    assert motion.touch is not None
    assert motion.touch.max() == 5
    code, out, err = run(
        "poke", "-o", "c.csv", "--polygon", "0,0;0.02,0;0,0.02", "--spacing", 0.01, "--duration", 1, "--rate", 100
    )
    assert code == 0, err
    assert "6 places" in out


def test_own_signal_and_slides(run: Any, tmp_path: Path) -> None:
    t = np.linspace(0, 2, 101)
    rows = "\n".join(f"{a:.6f},{0.003 + 0.001 * np.sin(4 * a):.9f}" for a in t)
    (tmp_path / "own.csv").write_text(f"t,depth\n{rows}\n", encoding="utf-8")
    assert run("poke", "-o", "o.parquet", "--signal", "own.csv")[0] == 0
    motion = read_trajectory(tmp_path / "o.parquet")
    assert motion.place is not None
    assert motion.place[:, 2].max() == pytest.approx(0.004, abs=1e-5)
    assert run("slide", "-o", "s.parquet", "--through", "0,0;0.01,0.01", "--speed", 0.01)[0] == 0
    code, _, err = run("slide", "-o", "f.npz", "--four-paths", 0.01, "--speed", 0.01, "--rate", 100)
    assert code == 0, err


def test_excite_in_contact_and_in_the_air(run: Any, tmp_path: Path) -> None:
    code, out, err = run(
        "excite", *LAW, "--force-limit", 8, "-o", "e.parquet", "--json", "e.json", "--criterion", "A", "--sines", 2
    )
    assert code == 0, err
    assert "best conceivable" in out
    facts = json.loads((tmp_path / "e.json").read_text(encoding="utf-8"))
    assert set(facts["intervals"]) == {"hunt-crossley.stiffness", "hunt-crossley.damping", "hunt-crossley.exponent"}
    motion = read_trajectory(tmp_path / "e.parquet")
    assert motion.normal_force is not None
    assert motion.normal_force.max() <= 8.0
    code, out, err = run("excite", "--model", "tool-mass,tool-com", "--duration", 4, "--rate", 100, "-o", "f.parquet")
    assert code == 0, err
    assert "com[x]" in out


@pytest.mark.parametrize(
    ("args", "word"),
    [
        (("poke", "-o", "p.txt"), "ending"),
        (("poke", "-o", "p.parquet", "--rig", "no.toml"), "rig"),
        (("poke", "-o", "p.parquet", "--at", "1;2"), "numbers"),
        (("poke", "-o", "p.parquet", "--at", "2,0"), "reach"),
        (("poke", "-o", "p.parquet", "--sines", "1mm"), "amplitude@frequency"),
        (("poke", "-o", "p.parquet", "--sines", "0.003@9"), "acceleration of joint_"),
        (("poke", "-o", "p.parquet", "--depth", -0.001), "in the air"),
        (("poke", "-o", "p.parquet", "--depth", 0), "above 0 m"),
        (("poke", "-o", "p.parquet", "--depth", 3), "depths are in m"),
        (
            ("poke", "-o", "p.parquet", "--depth", 0.12, "--rate", 100),
            "flange comes within 6 mm of surface at a depth of 9",
        ),
        (("poke", "-o", "p.parquet", "--sines", "0.05@0.3"), "rises 47 mm above the surface"),
        (("poke", "-o", "p.parquet", "--duration", 1e6), "samples at most"),
        (("slide", "-o", "p.parquet", "--through", "0,0;0.02,0", "--speed", 1e-9), "samples at most"),
        (("poke", "-o", "p.parquet", "--acceleration", -1), "limits of acceleration"),
        (("excite", "-o", "p.parquet", "--model", "tool-mass", "--duration", 0), "duration"),
        (("poke", "-o", "p.parquet", "--yaw", "inf"), "yaw"),
        (("poke", "-o", "p.parquet", "--tilt", "0.1"), "two angles"),
        (("poke", "-o", "p.parquet", "--tilt", "2,0"), "lean"),
        (("poke", "-o", "p.parquet", "--json", "p.parquet"), "two outputs"),
        (("poke", "-o", "p.parquet", "--grid", "10"), "rows x columns"),
        (("poke", "-o", "p.parquet", "--grid", "2x2", "--polygon", "0,0;1,0;0,1"), "one of them"),
        (("poke", "-o", "p.parquet", "--value", "stiffness=3"), "--model"),
        (("poke", "-o", "p.parquet", "--model", "hooke", "--value", "stiffness=x"), "stiffness=900"),
        (("poke", "-o", "p.parquet", "--signal", "rig.toml"), ".parquet"),
        (("poke", "-o", "p.parquet", "--signal", "own.csv", "--sines", "0.001@1"), "--sines with --signal"),
        (("poke", "-o", "p.parquet", "--force-limit", 1), "without a model to expect forces from"),
        (("poke", "-o", "p.parquet", "--polygon", "0,0;0.02,0.02;0.02,0;0,0.02"), "edges 1 and 3 cross"),
        (("poke", "-o", "p.parquet", "--polygon", "0,0;0.01,0.01;0.02,0.02"), "on one line"),
        (
            ("poke", "-o", "p.parquet", "--model", "hooke", "--value", "stiffness=1", "--value", "hooke.stiffness=2"),
            "two values",
        ),
        (("poke", "-o", "p.parquet", "--json", "-"), "named -"),
        (("poke", "-o", "p.parquet", "--duration", 0.5), "--duration 0.6 or more"),
        (("slide", "-o", "p.parquet", "--through", "0,0;0.01,0", "--at", "0.1,0"), "--at with --through"),
        (("excite", "-o", "p.parquet", "--model", "tool-mass", "--force-limit", 3), "--force-limit in the air"),
        (("poke", "-o", "rig.toml"), "ending"),
        (("slide", "-o", "p.parquet"), "one of them"),
        (("slide", "-o", "p.parquet", "--through", "0,0"), "two or more"),
        (("excite", "-o", "p.parquet"), "--model"),
        (("excite", "-o", "p.parquet", "--model", "hooke", "--criterion", "E"), "one of D, A"),
        (("excite", "-o", "p.parquet", "--model", "tool-mass", "--start", "1,2"), "7 joints"),
    ],
)
def test_bad_input_is_one_line(run: Any, tmp_path: Path, args: tuple[str, ...], word: str) -> None:
    before = sorted(tmp_path.iterdir())
    code, _, err = run(*args)
    assert code == 2, err
    assert err.count("\n") == 1, err
    assert word in err, err
    assert sorted(tmp_path.iterdir()) == before


@pytest.mark.parametrize(("option", "value"), [("--criterion", "E"), ("--sines", 0), ("--noise", 0)])
def test_what_no_search_can_begin_with_is_refused_before_it(run: Any, option: str, value: object) -> None:
    code, out, _ = run("excite", "-o", "p.parquet", "--model", "hooke", option, value)
    assert code == 2
    assert "optimised" not in out


@pytest.mark.parametrize("model", ["panda", "ur5"])
@pytest.mark.parametrize("command", [("poke",), ("slide", "--through", "0,0;0.01,0")])
def test_an_arm_without_a_tip_is_refused(run: Any, tmp_path: Path, model: str, command: tuple[str, ...]) -> None:
    (tmp_path / "bare.toml").write_text(
        f'[robot]\nmodel = "{model}"\n[surface]\npoint = [0.5, 0, 0.1]\nnormal = [0, 0, 1]\n'
    )
    code, _, err = run(*command, "-o", "p.parquet", "--rig", "bare.toml")
    assert code == 2
    assert f"{model} without a tip frame" in err
    assert "[robot] tip_frame" in err


def test_what_a_plan_rests_on_is_said(run: Any, tmp_path: Path) -> None:
    """Values that nobody gave, a fit that is in doubt, and speeds that aren't reached."""
    short = ("poke", "-o", "p.parquet", "--duration", 1, "--rate", 100, "--no-collision")
    assert "assumed: stiffness 1000 N/m (name it with --value or --fit)" in run(*short, "--model", "hooke")[1]
    out = run(*short, "--model", "hooke", "--value", "stiffness=800")[1]
    assert "assumed" not in out
    assert "reached at most" not in out
    out = run(*short, "--travel-speed", 10)[1]
    assert "--travel-speed 10: reached at most" in out
    fit = {"model": ["hooke"], "parameters": {"hooke.stiffness": {"value": 900.0}}, "warnings": []}
    for warnings in ([], ["the residual is 3.1 times the noise: this structure is rejected, kinid diagnose says more"]):
        (tmp_path / "fit.json").write_text(json.dumps({**fit, "warnings": warnings}))
        out = run(*short, "--fit", "fit.json", "--json", "p.json")[1]
        assert ("the fit says: the residual is 3.1 times the noise" in out) == bool(warnings)
        assert ("its intervals promise too much" in out) == bool(warnings)
        assert len(json.loads((tmp_path / "p.json").read_text())["remarks"]) == len(warnings)
    (tmp_path / "fit.json").write_text(json.dumps({**fit, "warnings": 3}))
    code, _, err = run(*short, "--fit", "fit.json")
    assert code == 2
    assert "warnings = 3 in fit.json" in err
    for broken, named in (
        ({"model": []}, "beside the model"),
        ({"parameters": {}}, "no value in fit.json"),
        ({"parameters": {}, "model": []}, "no effect in fit.json"),
        ({"model": ["kelvin-voigt"]}, "hooke.stiffness beside the model"),
        ({"parameters": {"hooke.stiffness": {"value": 900.0, "low": 9e9}}}, "outside its interval"),
    ):
        (tmp_path / "fit.json").write_text(json.dumps(fit | broken))
        code, _, err = run(*short, "--fit", "fit.json")
        assert code == 2
        assert named in err


def test_the_preview_of_a_plan_speaks_of_expected_forces(run: Any, tmp_path: Path) -> None:
    code, _, err = run(
        "poke", "-o", "p.parquet", "--duration", 1, "--rate", 100, "--model", "hooke", "--preview", "v.html"
    )
    assert code == 0, err
    page = (tmp_path / "v.html").read_text(encoding="utf-8")
    assert "measured force" not in page
    assert "expected force" in page


def test_help_loads_nothing_heavy() -> None:
    heavy = ("casadi", "ruckig", "meshcat", "pinocchio", "plotly")
    code = f"import sys, kinid.cli.plan; print([m for m in {heavy!r} if m in sys.modules])"
    said = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert said.stdout.strip() == "[]"


def test_joints_that_turn_on_and_on_use_no_share_of_a_position() -> None:
    """Every warning fails a test: limits of −∞ and ∞ have no middle."""
    n, some = 5, np.full(2, 2.0)
    limits = Limits(("a", "b"), np.array([-np.inf, -1.0]), np.array([np.inf, 1.0]), some, some, some, some)
    zeros, q = np.zeros((n, 2)), np.full((n, 2), 0.5)
    still = Trajectory(np.arange(n) * 0.01, np.full(n, "free"), q, zeros, zeros, np.zeros((n, 3)), ("a", "b"))
    position = usage(still, limits)[0]
    assert (position.joint, position.share) == ("b", 0.5)


@pytest.mark.parametrize("option", ["--max-speed=inf", "--bandwidth=1e308", "--duration=1e308", "--max-speed=nan"])
def test_a_motion_that_no_arm_makes_is_refused(run: Any, option: str) -> None:
    code, _, err = run("excite", "-o", "p.parquet", "--model", "hooke", option)
    assert code == 2
    assert err.count("\n") == 1
