"""The experiment that tells candidate effects apart."""

from __future__ import annotations

import dataclasses
import json
from typing import Any

import numpy as np
import pytest
from scipy.optimize import least_squares

import kinid
from kinid.errors import InputError
from kinid.planning import Guard, Planner, Protocol, read_trajectory
from kinid.planning.discriminate import DESIGN_RATE, criterion, discriminate, rank
from kinid.planning.discrimination import SURE
from kinid.planning.experiments import drawn_at_random, proposals
from tests.planning.test_plan_command import run  # noqa: F401

DURATION, DEPTH = 20.0, 0.004
STIFF = {"hooke.stiffness": 1000.0}


@pytest.mark.parametrize(
    ("model", "values", "pair", "best"),
    [
        (("hooke",), STIFF, ("relaxation", "stiffness-drift"), None),
        pytest.param(("hooke",), STIFF, ("viscous-damping", "relaxation"), None, marks=pytest.mark.slow),
        (("hooke", "coulomb-friction"), STIFF, ("viscous-friction", "stribeck-friction"), "speeds-and-loads"),
        (("none",), {}, ("tool-mass", "sensor-bias"), None),
        pytest.param(
            ("hooke",), STIFF, ("sensor-drift", "stiffness-drift"), "rest-between-holds", marks=pytest.mark.slow
        ),
        pytest.param(
            ("hooke", "coulomb-friction"),
            STIFF,
            ("load-dependent-friction", "friction-anisotropy"),
            "diagonals",
            marks=pytest.mark.slow,
        ),
    ],
)
def test_beats_experiments_drawn_at_random(
    rig: Any, model: tuple[str, ...], values: dict[str, float], pair: tuple[str, str], best: str | None
) -> None:
    ranking = rank(Planner(rig, Protocol()), kinid.Model(*model), pair, values, duration=DURATION, depth=DEPTH)
    first = ranking.verdicts[0]
    chosen = criterion(first, ranking.kept)
    if best is not None:
        assert first.proposal.name == best
    criteria = []
    for seed in range(4):
        drawn = drawn_at_random(seed, first.duration, DEPTH, contact=model != ("none",))
        verdict = ranking.judge.verdict(drawn)
        assert verdict.duration == pytest.approx(first.duration, abs=1.5)  # ways there and back differ
        criteria.append(criterion(verdict, ranking.kept))
    print(pair, first.proposal.name, f"{chosen:.4g}", [f"{value:.4g}" for value in sorted(criteria)])
    assert chosen > max(criteria)
    # a motion of all joints at random turns the tool well already; a poke or a slide at random misses what it takes
    assert chosen > (1.2 if model == ("none",) else 1.5) * np.median(criteria)


def test_distance_is_what_a_refit_leaves(rig: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    """Data of one effect, the other fitted to them nonlinearly: the sum of squares left is the distance that was
    predicted.
    """
    # how evenly it lies in time is another test's matter
    monkeypatch.setattr("kinid.planning.discriminate.even", lambda squares, t: 1.0)
    model = kinid.Model("hooke")
    ranking = rank(
        Planner(rig, Protocol()), model, ("viscous-damping", "stiffness-drift"), STIFF, duration=10.0, depth=DEPTH
    )
    judge, verdict = ranking.judge, ranking.verdicts[0]
    motion = judge.bench.trajectory(verdict.proposal, DESIGN_RATE, collisions=False)
    s = judge.bench.experiment(verdict.proposal, motion).signals
    form = judge.forms["viscous-damping"][0]
    # means of four samples at 125 Hz, of which no law is right to better than 0.2 %
    white = np.array([0.015, 0.014, 0.029, 0.0005, 0.0006, 0.0003])[:, None] / 2.0
    plain = model.predict(s, np.array([1000.0]))
    noise = np.sqrt((white**2 + (2e-3 * plain) ** 2) * DESIGN_RATE / 125.0)
    measured = (model + "viscous-damping").predict(s, np.array([1000.0, *form.values]))
    rival = model + "stiffness-drift"
    # what calibration leaves open, as the planner states it: surface 15 µm, clock 0.125 ms, bias 0.01 N and 0.5 mN·m
    tolerance = np.array([0.01, 0.01, 0.01, 5e-4, 5e-4, 5e-4])[:, None]
    slope = 1.25e-4 * np.gradient(plain, s.t, axis=1)

    def residual(x: Any) -> Any:
        moved = dataclasses.replace(s, depth=s.depth + 1.5e-5 * x[2])
        predicted = (
            rival.predict(moved, np.array([1000.0 + 10 * x[0], 0.1 * x[1]])) + slope * x[3] + tolerance * x[4:, None]
        )
        return np.concatenate([((predicted - measured) / noise).ravel(), x[2:]])

    left = 2 * least_squares(residual, np.zeros(10)).cost
    # the planner's view is linear; changes of a per cent leave it right to a few per cent
    assert verdict.distances["viscous-damping", "stiffness-drift"][0] == pytest.approx(left, rel=0.05)


def test_chosen_experiment_is_a_motion_within_limits(rig: Any) -> None:
    planner = Planner(rig, Protocol(rate=250.0))
    found = discriminate(planner, kinid.Model("hooke"), ("sensor-drift", "stiffness-drift"), STIFF, depth=DEPTH)
    assert found.sure
    assert found.distance >= SURE
    motion = found.trajectory
    assert motion.normal_force is not None
    # expected of the model: 1000 N/m at 4 mm
    assert motion.normal_force.max() == pytest.approx(4.0, rel=0.01)
    assert (np.abs(motion.dq) <= planner.limits.velocity).all()
    assert (np.abs(motion.ddq) <= planner.limits.acceleration).all()
    assert max(use["share"] for use in motion.provenance["used"]) <= 1.0
    assert motion.provenance["discrimination"]["experiment"] == found.proposal.name
    # what is looked at in the air between touches tells them apart
    assert found.proposal.name in ("rest-between-holds", "hold-between-looks-in-the-air", "taps")
    # the words name the experiment, why it tells, both effects, and where the difference lies; no other experiment
    assert found.words.startswith(f"{found.proposal.title}: {found.proposal.why}; sensor-drift shows as a ramp")
    assert "a long hold" not in found.words
    assert "% lies in" in found.words


@pytest.mark.parametrize("bandwidth", [0.5, 0.9, 3.0])
@pytest.mark.parametrize("contact", [True, False])
def test_each_experiment_has_a_title_of_its_own_and_says_why(bandwidth: float, contact: bool) -> None:
    listed = proposals(DURATION, DEPTH, contact=contact, bandwidth=bandwidth)
    assert len({proposal.title for proposal in listed}) == len(listed)
    assert all(proposal.why for proposal in listed)


def test_no_experiment_within_a_force_limit_is_one_sentence(rig: Any) -> None:
    planner = Planner(rig, Protocol(guard=Guard(0.01), rate=100.0, collisions=False))
    with pytest.raises(InputError, match="binding limit is the force") as raised:
        discriminate(
            planner, kinid.Model("hooke"), ("relaxation", "stiffness-drift"), STIFF, duration=10.0, depth=DEPTH
        )
    assert str(raised.value).count("found") == str(raised.value).count("to mend it") == 1


def test_force_limit_is_kept(rig: Any) -> None:
    planner = Planner(rig, Protocol(guard=Guard(3.0), rate=100.0, collisions=False))
    pair, values = ("viscous-damping", "stiffness-drift"), STIFF
    found = discriminate(planner, kinid.Model("hooke"), pair, values, duration=10.0, depth=DEPTH)
    normal, place = found.trajectory.normal_force, found.trajectory.place
    assert normal is not None
    assert place is not None
    assert 2.0 < normal.max() <= 3.0  # at 4 mm it would be 4 N
    # with force to spare it is pressed as deep as was asked for
    planner = Planner(rig, Protocol(guard=Guard(30.0), rate=100.0, collisions=False))
    ranking = rank(planner, kinid.Model("hooke"), pair, values, duration=10.0, depth=DEPTH)
    assert "at 4 mm" in next(v.proposal.title for v in ranking.verdicts if v.proposal.name == "long-hold")


def test_a_special_case_is_told_by_what_its_rival_does_more(rig: Any) -> None:
    """A turned sensor is cross-talk of a special form: no experiment shows what only the turn can do."""
    pair = ("sensor-crosstalk", "sensor-misalignment")
    model = kinid.Model("hooke", "coulomb-friction")
    ranking = rank(Planner(rig, Protocol(collisions=False)), model, pair, STIFF, duration=10.0, depth=DEPTH)
    assert not ranking.kept[pair[1], pair[0]].any()
    assert ranking.kept[pair].any()
    assert criterion(ranking.verdicts[0], ranking.kept) > 1.0
    found = discriminate(
        Planner(rig, Protocol(rate=100.0, collisions=False)), model, pair, STIFF, duration=10.0, depth=DEPTH
    )
    assert "sensor-crosstalk can imitate sensor-misalignment" in found.words


def test_joint_torques(rig: Any) -> None:
    pair = ("joint-coulomb-friction", "joint-viscous-friction")
    found = discriminate(Planner(rig, Protocol(rate=250.0)), kinid.Model("rigid-body"), pair, duration=10.0)
    assert found.trajectory.phase.tolist().count("free") == len(found.trajectory)
    assert found.sure


def test_experiments_last_about_as_long() -> None:
    listed = proposals(DURATION, DEPTH)
    assert len({proposal.name for proposal in listed}) == len(listed)
    for duration, depth, word in (
        (2.0, DEPTH, "duration"),
        (1e7, DEPTH, "duration"),
        (DURATION, 0.0, "depth"),
        (DURATION, 3.0, "depth"),
    ):
        with pytest.raises(InputError, match=word):
            proposals(duration, depth)


@pytest.mark.parametrize(
    ("args", "word"),
    [
        (("--model", "hooke", "--effects", "relaxatoin,stiffness-drift"), "did you mean 'relaxation'"),
        (("--model", "hooke", "--effects", "relaxation"), "two different effects"),
        (("--model", "hooke", "--effects", "relaxation,relaxation"), "two different effects"),
        (("--model", "hooke,relaxation", "--effects", "relaxation,stiffness-drift"), "without the candidates"),
        (("--model", "hooke", "--effects", "hertz,relaxation"), "not a contact law"),
        (("--model", "hooke", "--effects", "quantization,relaxation"), "kinid diagnose"),
        (
            ("--model", "hooke,coulomb-friction", "--effects", "viscous-damping,viscous-friction"),
            "which acts on tangential forces",
        ),
        (("--model", "hooke", "--effects", "joint-viscous-friction,relaxation"), "which acts on joint torques"),
        (("--model", "none", "--effects", "relaxation,sensor-bias"), "no contact law"),
        (("--model", "hooke", "--effects", "tool-mass,sensor-gain"), "no experiment on the list"),
        (("--model", "hooke", "--effects", "relaxation,stiffness-drift", "--at", "3,3"), "can't reach"),
        (("--effects", "relaxation,stiffness-drift"), "--model"),
    ],
)
def test_bad_input_is_one_line(run: Any, args: tuple[str, ...], word: str) -> None:  # noqa: F811
    code, _, err = run("discriminate", "-o", "d.parquet", "--rate", 100, *args)
    assert code == 2, err
    assert err.count("\n") == 1, err
    assert word in err, err


def test_command(run: Any, tmp_path: Any) -> None:  # noqa: F811
    code, out, err = run(
        "discriminate",
        "--model",
        "hooke,coulomb-friction",
        "--value",
        "stiffness=1000",
        "--rate",
        100,
        "--effects",
        "viscous-friction,stribeck-friction",
        "-o",
        "d.parquet",
        "--json",
        "d.json",
    )
    assert code == 0, err
    assert "at two speeds under two loads" in " ".join(out.split())
    assert "values and limits in rad, N·m and s" in out
    assert "e-" not in out  # what is below the least distance that counts is said so, not in powers of ten
    facts = json.loads((tmp_path / "d.json").read_text(encoding="utf-8"))
    assert facts["experiment"] == "speeds-and-loads"
    assert facts["experiments"][0]["distance"] == max(row["distance"] for row in facts["experiments"])
    motion = read_trajectory(tmp_path / "d.parquet")
    assert motion.touch is not None
    assert motion.touch.max() == 3  # two speeds at two loads: viscous friction does not grow with the load
    assert "slide" in motion.phase
