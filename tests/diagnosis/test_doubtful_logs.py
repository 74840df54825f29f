"""Logs that a stranger brings: textbook friction, clocks that are late, turned signs, lost samples, other units.

Their equations are written here; each asks for one sentence that must be there, and for none where there is no reason.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from numpy.typing import NDArray

import kinid
from kinid.errors import InputError
from kinid.reports.diagnosis_words import headline
from kinid.robotics.robot import Robot

if TYPE_CHECKING:
    from conftest import Tester

RIG = kinid.Rig()
STIFFNESS, DAMPING, NOISE, MU = 900.0, 6.0, 0.02, 0.4


def motion(rate: float = 250.0) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Time, depth and its rate: pokes of four depths, seconds outside between them."""
    t = np.arange(round(24.0 * rate)) / rate
    deep = np.array([2e-3, 5e-3, 3e-3, 6e-3])[(t // 6.0).astype(int)]
    part = t % 6.0
    swing = 0.5 * (1.0 - np.cos(2.0 * np.pi * (part - 2.0) / 4.0)) * (part > 2.0)
    quick = 0.15 * np.sin(2.0 * np.pi * 3.0 * part) * (swing > 0.3)
    depth = -3e-3 + (deep + 3e-3) * (swing + quick * (swing - 0.3))
    return t, depth, np.gradient(depth, t)


def poked(late: float = 0.0, rate: float = 250.0) -> kinid.Log:
    """Kelvin-Voigt that relaxes by a quarter, the force so many seconds late."""
    t, depth, speed = motion(rate)
    elastic = STIFFNESS * np.maximum(depth, 0.0)
    held, slow = 0.0, np.zeros_like(t)
    for i in range(1, len(t)):
        held += (1.0 / rate) / 0.8 * (elastic[i] - held)
        slow[i] = held
    force = np.where(depth > 0, np.maximum(elastic - 0.25 * slow + DAMPING * speed, 0.0), 0.0)
    noise = NOISE * np.random.default_rng(3).standard_normal(len(t))
    return kinid.Log(t=t, contact={"depth": depth, "normal_force": np.interp(t - late, t, force) + noise})


@pytest.mark.parametrize(("begins", "ends", "doubted"), [(3.2, 3.9, True), (0.5, 1.2, False), (2.0, 3.3, True)])
def test_what_is_remembered_over_a_gap_is_not_held_against_the_model(begins: float, ends: float, doubted: bool) -> None:
    """Samples lost while the material relaxes, in the air, and from the air until deep in the material."""
    whole = poked()
    kept = ~((whole.t % 12.0 > begins) & (whole.t % 12.0 < ends))
    log = kinid.Log(t=whole.t[kept], contact={name: x[kept] for name, x in whole.contact.items()})
    found = kinid.diagnose(log, RIG, model=kinid.Model("kelvin-voigt", "relaxation"))
    assert found.verdict == "adequate"
    assert any(f"2 gaps of up to {ends - begins:.1f} s in contact" in w for w in found.warnings) is doubted


@pytest.mark.parametrize("lost", [(13.2, 15.6), (19.0, 21.9), (-1.0, 4.0)])
def test_a_loop_whose_beginning_is_lost_is_a_loop(lost: tuple[float, float]) -> None:
    """A loop over depth, F (1 + 0.2 z); samples lost from the air until deep in the material, or a log that begins
    there: how z got there isn't known.
    """
    t, depth, _ = motion(250.0)
    z = np.zeros_like(t)
    for i in range(1, len(t)):
        step = depth[i] - depth[i - 1]
        z[i] = z[i - 1] + (np.sign(step) - z[i - 1]) * -np.expm1(-abs(step) / 3e-3) if depth[i] > 0 else 0.0
    force = STIFFNESS * np.maximum(depth, 0.0) * (1.0 + 0.2 * z)
    force += NOISE * np.random.default_rng(8).standard_normal(len(t))
    kept = (t < lost[0]) | (t > lost[1])
    log = kinid.Log(t=t[kept], contact={"depth": depth[kept], "normal_force": force[kept]})
    found = kinid.diagnose(log, RIG, model=kinid.Model("hooke"))
    assert (found.verdict, found.added) == ("missing", ("hysteresis",))
    assert found.fit["hysteresis.ratio"].value == pytest.approx(0.2, rel=0.1)  # its length trades
    assert any("the log begins in contact" in w for w in found.warnings) is (lost[0] < 0)


def test_a_material_remembers_over_short_gaps() -> None:
    """A sixth of a second lost in every other touch: relaxation is found as in the whole log, with rows or readings
    gone.
    """
    whole = poked()
    gone = (whole.t % 12.0 > 3.4) & (whole.t % 12.0 < 3.57)
    rows = kinid.Log(t=whole.t[~gone], contact={name: x[~gone] for name, x in whole.contact.items()})
    cells = kinid.Log(
        t=whole.t, contact={**whole.contact, "normal_force": np.where(gone, np.nan, whole.contact["normal_force"])}
    )
    estimates = []
    for log in (whole, rows, cells):
        found = kinid.diagnose(log, RIG, model=kinid.Model("kelvin-voigt"))
        assert (found.verdict, found.added) == ("missing", ("relaxation",))
        estimates.append((found.fit["relaxation.ratio"].value, found.fit["relaxation.time-constant"].value))
    print("ratio, time constant:", ", ".join(f"{r:.4f}, {tau:.4f} s" for r, tau in estimates))
    np.testing.assert_allclose(estimates[1:], [estimates[0], estimates[0]], rtol=0.02)


@pytest.mark.parametrize("shaky", [0.0, 1e-6])
@pytest.mark.parametrize("rate", [250.0, 500.0])
def test_friction_that_turns_at_once_is_a_form_at_rest(rate: float, shaky: float) -> None:
    """T = −μ N v/|v|, without any way to give, slip that rests and slips that turn: presliding of no length.

    At rest, friction keeps its direction, whatever noise the slip is measured with.
    """
    t = np.arange(round(24.0 * rate)) / rate
    depth = np.where(t % 6.0 < 1.0, -2e-3, 4e-3 + 1e-3 * np.sin(2 * np.pi * 0.7 * t))
    depth = np.convolve(np.pad(depth, 25, mode="edge"), np.ones(51) / 51, mode="valid")
    far = np.array([4e-3, 9e-3, 2e-3])[(t // 3.0).astype(int) % 3]
    speed = np.where(
        t % 3.0 < 2.0, np.pi * far * np.sin(2 * np.pi * t), 0.0
    )  # there and back, twice, and a second of rest
    slip, press = np.cumsum(speed) / rate, np.gradient(depth, t)
    sign = np.where(np.abs(speed) > 2e-4, np.sign(speed), 0.0)
    last = np.maximum.accumulate(np.where(sign != 0, np.arange(len(t)), 0))
    touched = np.maximum.accumulate(np.where(depth <= 0, np.arange(len(t)), 0))
    sign = np.where(last > touched, sign[last], 0.0)  # until the tip leaves
    normal = np.where(depth > 0, np.maximum(STIFFNESS * depth + DAMPING * press, 0.0), 0.0)
    rng = np.random.default_rng(5)
    zero = np.zeros_like(t)
    log = kinid.Log(
        t=t,
        contact={
            "depth": depth,
            "slip1": slip + shaky * rng.standard_normal(len(t)),
            "slip2": zero,
            "normal_force": normal + NOISE * rng.standard_normal(len(t)),
            "tangential_force1": -MU * normal * sign + NOISE * rng.standard_normal(len(t)),
            "tangential_force2": NOISE * rng.standard_normal(len(t)),
        },
    )
    found = kinid.diagnose(log, RIG, model=kinid.Model("kelvin-voigt", "coulomb-friction"))
    assert found.verdict == "adequate"
    assert found.added == ()
    assert found.fit["coefficient"].value == pytest.approx(MU, rel=0.02)


def test_damping_that_no_material_has_is_doubted() -> None:
    """Half a poke's period is 0.17 s: 15 ms late make a dashpot of −K·0.015 = −13 N·s/m, beside the true 6."""
    late = kinid.Model("kelvin-voigt", "relaxation").fit(kinid.contact_series(poked(late=0.015), RIG))
    assert late["kelvin-voigt.damping"].value < 0
    assert [w for w in late.warnings if "kelvin-voigt.damping is negative" in w]
    found = kinid.diagnose(poked(late=0.015), RIG, model=kinid.Model("kelvin-voigt"), add=["relaxation"], max_effects=1)
    assert [w for w in found.warnings if "kelvin-voigt.damping is negative" in w]
    fine = kinid.Model("kelvin-voigt", "relaxation").fit(kinid.contact_series(poked(), RIG))
    assert not [w for w in fine.warnings if "negative" in w]


def test_a_turned_force_is_refused() -> None:
    log = poked()
    turned = dataclasses.replace(log, contact={**log.contact, "normal_force": -log.contact["normal_force"]})
    with pytest.raises(InputError, match=r"falls to -\d.* as the tool goes deeper.*scale = -1"):
        kinid.diagnose(turned, RIG, model=kinid.Model("kelvin-voigt"))


def test_a_turned_depth_is_refused() -> None:
    log = poked()
    turned = dataclasses.replace(log, contact={**log.contact, "depth": -log.contact["depth"]})
    with pytest.raises(InputError, match=r"where the depth is negative.*scale = -1"):
        kinid.diagnose(turned, RIG, model=kinid.Model("kelvin-voigt"))
    assert [w for w in kinid.Model("hooke").fit(kinid.contact_series(turned, RIG)).warnings if "depth is negative" in w]
    # a surface that is stated 1.5 mm too deep leaves as much force outside as inside
    shifted = dataclasses.replace(log, contact={**log.contact, "depth": log.contact["depth"] - 1.5e-3})
    assert not [
        w for w in kinid.Model("hooke").fit(kinid.contact_series(shifted, RIG)).warnings if "depth is negative" in w
    ]


def test_turned_tangential_forces_are_refused() -> None:
    """Friction acts on the tool against the slip; along it, it would drive it."""
    t = np.arange(0, 8, 2e-3)
    depth, speed = 2e-3 * np.sin(np.pi * t / 8), 0.02 * np.cos(2 * np.pi * t)
    rub = 0.5 * 800 * depth * np.tanh(speed / 1e-3)
    contact = {
        "depth": depth,
        "normal_force": 800 * depth,
        "slip1": np.cumsum(speed) * 2e-3,
        "slip2": 0 * t,
        "tangential_force1": rub,
        "tangential_force2": 0 * t,
    }
    rng = np.random.default_rng(5)
    noise = {name: contact[name] + NOISE * rng.standard_normal(len(t)) for name in contact if "force" in name}
    with pytest.raises(InputError, match="points along the slip"):
        kinid.diagnose(
            kinid.Log(t=t, contact={**contact, **noise}), RIG, model=kinid.Model("hooke", "coulomb-friction")
        )
    right = kinid.Log(t=t, contact={**contact, **noise, "tangential_force1": -noise["tangential_force1"]})
    fit = kinid.Model("hooke", "coulomb-friction").fit(kinid.contact_series(right, RIG))
    assert not [w for w in fit.warnings if "along the slip" in w]


def test_forces_in_another_unit_are_doubted() -> None:
    log = poked()
    micro = dataclasses.replace(log, contact={**log.contact, "normal_force": 1e6 * log.contact["normal_force"]})
    assert [w for w in kinid.Model("hooke").fit(kinid.contact_series(micro, RIG)).warnings if "another unit" in w]
    assert not [w for w in kinid.Model("hooke").fit(kinid.contact_series(log, RIG)).warnings if "another unit" in w]


def test_a_depth_in_millimetres_is_refused() -> None:
    log = poked()
    milli = dataclasses.replace(log, contact={**log.contact, "depth": 1e3 * log.contact["depth"]})
    with pytest.raises(InputError, match=r'depths of up to 6.* m.*unit = "mm"'):
        kinid.diagnose(milli, RIG, model=kinid.Model("kelvin-voigt"))


def test_a_reading_beyond_all_measure_is_refused() -> None:
    log = poked()
    force = log.contact["normal_force"].copy()
    force[2500] = 1e9
    spiked = dataclasses.replace(log, contact={**log.contact, "normal_force": force})
    with pytest.raises(InputError, match=r"normal_force of 1e\+09 N, 10 s after .*leave out"):
        kinid.diagnose(spiked, RIG, model=kinid.Model("kelvin-voigt"))


def test_a_damping_that_gives_energy_is_not_believed() -> None:
    """A force that comes early looks like a dashpot that pushes: that stands in for a clock, and for the relaxation
    beside it.
    """
    found = kinid.diagnose(poked(late=-0.02), RIG, model=kinid.Model("hooke"))
    assert "time-offset" in found.added
    assert not {"viscous-damping", "hunt-crossley-damping"} & set(found.added)
    assert not [name for name, p in found.fit.parameters.items() if name.endswith("damping") and p.high < 0.0]


def test_a_bias_does_not_hide_free_motion() -> None:
    log = poked()
    biased = dataclasses.replace(log, contact={**log.contact, "normal_force": log.contact["normal_force"] + 0.2})
    found = kinid.diagnose(biased, RIG, model=kinid.Model("kelvin-voigt", "relaxation"))
    assert found.added == ("sensor-bias",)
    assert not [w for w in found.warnings if "no free motion" in w or "begins in contact" in w]
    inside = kinid.Log(t=log.t, contact={**log.contact, "depth": log.contact["depth"] + 4e-3})
    assert [w for w in kinid.Model("hooke").fit(kinid.contact_series(inside, RIG)).warnings if "no free motion" in w]


@pytest.mark.parametrize(("bias", "reported"), [(0.022, False), (0.06, True)])
def test_a_bias_beyond_what_calibration_is_trusted_to_is_told_beside_what_was_added(
    bias: float, reported: bool
) -> None:
    """Calibration has a standard deviation of 20 mN and is trusted to twice that: 22 mN are inside.

    (Before, 20 mN were an end of its range, so that 22 mN were beyond.)
    """
    log = poked()
    biased = dataclasses.replace(log, contact={**log.contact, "normal_force": log.contact["normal_force"] + bias})
    found = kinid.diagnose(biased, RIG, model=kinid.Model("kelvin-voigt"))
    assert found.added == (("relaxation", "sensor-bias") if reported else ("relaxation",))
    assert found.steps[-1].held_out < 1.1 * NOISE
    if reported:
        assert found.fit["sensor-bias.offset[normal_force]"].value == pytest.approx(bias, abs=0.002)
    else:
        assert found["sensor-bias"].verdict == "absent"
        assert "0.04" in found["sensor-bias"].says


def test_where_the_model_fails_is_said_beside_a_bias() -> None:
    """A bias that the rig doesn't state is most of the error; where the model fails is of what it leaves."""
    log = poked()
    biased = dataclasses.replace(log, contact={**log.contact, "normal_force": log.contact["normal_force"] + 2.0})
    plain, found = (kinid.diagnose(of, RIG, model=kinid.Model("kelvin-voigt")) for of in (log, biased))
    assert (plain.corrected, plain.added) == ((), ("relaxation",))
    assert (found.corrected, found.added) == (("sensor-bias",), ("sensor-bias", "relaxation"))
    # the same law is missing in the same log: the worst place is the same, and as wrong, to what the bias' own fit adds
    assert (found.where[0].channel, found.where[0].phase) == (plain.where[0].channel, plain.where[0].phase)
    assert found.where[0].rms == pytest.approx(plain.where[0].rms, rel=0.1)
    assert found.to_dict()["corrected"] == ["sensor-bias"]


@pytest.mark.parametrize("size", [0.1, pytest.param(0.4, marks=pytest.mark.slow)])
def test_what_is_left_that_looks_like_an_effect_does_not_leave_it_absent(size: float) -> None:
    """A pull at a tool that leaves, only within 0.8 mm of the surface: not the catalogue's adhesion, but no proof of
    none.
    """
    t, depth, speed = motion()
    force = np.where(depth > 0, np.maximum(STIFFNESS * depth + DAMPING * speed, 0.0), 0.0)
    force -= np.where((speed < 0) & (np.abs(depth) < 8e-4), size * (1.0 - (depth / 8e-4) ** 2), 0.0)
    force += NOISE * np.random.default_rng(5).standard_normal(len(t))
    log = kinid.Log(t=t, contact={"depth": depth, "normal_force": force})
    found = kinid.diagnose(log, RIG, model=kinid.Model("kelvin-voigt"))
    assert found["adhesion"].verdict != "absent"


def test_time_in_another_unit_and_leaps_of_depth_are_doubted() -> None:
    log, model = poked(), kinid.Model("kelvin-voigt")
    assert not [w for w in model.fit(kinid.contact_series(log, RIG)).warnings if "unit" in w or "leaps" in w]
    slow = kinid.Log(t=1000.0 * log.t, contact=log.contact)
    assert [w for w in model.fit(kinid.contact_series(slow, RIG)).warnings if "is the time in another unit" in w]
    depth = log.contact["depth"].copy()
    depth[250:300] = 5e-3  # in the air, 3 mm outside
    lost = kinid.Log(t=log.t, contact={**log.contact, "depth": depth})
    assert [w for w in model.fit(kinid.contact_series(lost, RIG)).warnings if "the depth leaps by" in w]


def test_a_tangential_force_without_its_slip_is_doubted() -> None:
    t = np.arange(0, 8, 4e-3)
    depth = 2e-3 * np.sin(np.pi * t / 8)
    rng = np.random.default_rng(2)
    contact = {
        "depth": depth,
        "normal_force": 800 * depth + NOISE * rng.standard_normal(len(t)),
        "slip1": 0.004 * np.sin(3 * t),
        "slip2": 0.003 * np.cos(2 * t),
        "tangential_force1": -320 * depth * np.sign(np.cos(3 * t)) + NOISE * rng.standard_normal(len(t)),
        "tangential_force2": 320 * depth * np.sign(np.sin(2 * t)) + NOISE * rng.standard_normal(len(t)),
    }
    model = kinid.Model("hooke", "coulomb-friction")

    def doubts(without: str) -> list[str]:
        left = {name: values for name, values in contact.items() if name != without}
        return [
            w
            for w in model.fit(kinid.contact_series(kinid.Log(t=t, contact=left), RIG)).warnings
            if "without slip" in w
        ]

    assert doubts("slip2")
    assert "tangential_force2 without slip2" in doubts("slip2")[0]
    assert not doubts("nothing")
    assert not doubts("tangential_force2")


@pytest.mark.parametrize(
    ("slips", "forces", "doubt"),
    [
        ((1, 2), (1, 2), ""),
        ((2, 1), (1, 2), "are they exchanged?"),
        ((1, 2), (1,), "slip2 without tangential_force2"),
    ],
)
def test_exchanged_slips_and_a_missing_force_are_doubted(
    slips: tuple[int, ...], forces: tuple[int, ...], doubt: str
) -> None:
    """Friction against circles of slip, its columns mixed up or left out."""
    t = np.arange(5000) / 250.0
    rng = np.random.default_rng(7)
    depth = np.where(t % 5.0 < 1.0, -1e-3, 3e-3 + 5e-4 * np.sin(2.0 * t))
    rate = 0.01 * np.stack([np.cos(t), np.sin(t)])
    normal = np.where(depth > 0, 800.0 * depth, 0.0)
    contact = {"depth": depth, "normal_force": normal + 0.02 * rng.standard_normal(len(t))}
    contact |= {f"slip{i}": np.cumsum(rate[k - 1]) / 250.0 for i, k in zip((1, 2), slips)}
    contact |= {
        f"tangential_force{i}": -0.4 * normal * rate[i - 1] / 0.01 + 0.02 * rng.standard_normal(len(t)) for i in forces
    }
    found = kinid.diagnose(
        kinid.Log(t=t, contact=contact), RIG, model=kinid.Model("hooke", "coulomb-friction"), max_effects=0
    )
    doubts = [w for w in found.warnings if "exchanged" in w or "without tangential_force" in w]
    assert len(doubts) == bool(doubt)
    assert all(doubt in w for w in doubts)


def test_what_was_not_searched_for_is_neither_absent_nor_as_good_as_what_was_asked_for(tester: Tester) -> None:
    log = tester.log(tester.relaxing())
    found = kinid.diagnose(log, RIG, model=kinid.Model("kelvin-voigt"), add=["surface-tilt"], max_effects=1)
    assert found.added == ("surface-tilt",)
    assert not found["surface-tilt"].equivalent_to
    assert found["relaxation"].verdict == "not-excited"
    assert "left out" in found["relaxation"].says
    assert "--max-effects" in found["relaxation"].separate_by


def test_a_force_that_is_nothing_but_zeros_is_no_exchange_of_slips() -> None:
    t = np.arange(3000) / 250.0
    rate = 0.01 * np.stack([np.cos(t), np.sin(t)])
    depth = np.where(t % 5.0 < 1.0, -1e-3, 2e-3 + 5e-4 * np.sin(2.0 * t))
    force = np.where(depth > 0, 800.0 * depth, 0.0) + 0.02 * np.random.default_rng(1).standard_normal(len(t))
    contact = {"depth": depth, "normal_force": force, "tangential_force1": 0.0 * t, "tangential_force2": 0.0 * t}
    contact |= {f"slip{i + 1}": np.cumsum(rate[i]) / 250.0 for i in range(2)}
    found = kinid.Model("hooke", "coulomb-friction").fit(kinid.contact_series(kinid.Log(t=t, contact=contact), RIG))
    assert not [w for w in found.warnings if "exchanged" in w]


def test_rivals_stand_in_the_first_line(tester: Tester) -> None:
    """A dead zone of the sensor is a surface elsewhere, or a soft skin: the first line must not choose."""
    log = tester.log(tester.kelvin_voigt())
    force = log.contact["normal_force"]
    dead = dataclasses.replace(
        log,
        contact={
            **log.contact,
            "normal_force": np.sign(force) * np.maximum(np.abs(force) - 0.15, 0.0)
            + NOISE * np.random.default_rng(1).standard_normal(len(force)),
        },
    )
    found = kinid.diagnose(dead, RIG, model=kinid.Model("kelvin-voigt"))
    rivals = [e for name in found.added for e in found[name].equivalent_to]
    assert ("this log can't tell which" in headline(found)) == bool(rivals)
    assert all(rival in headline(found) for rival in rivals)


def test_contact_without_a_contact_law_is_said() -> None:
    found = kinid.diagnose(poked(), RIG, model=kinid.Model(), max_effects=0)
    assert [w for w in found.warnings if "no contact law" in w and "kelvin-voigt" in w]


def test_an_effect_whose_predictions_overflow_ends_no_diagnosis(tester: Tester) -> None:
    """A spring behind a dashpot that pushes runs away; what is hidden is found all the same."""
    rng = np.random.default_rng(3)
    rng.standard_normal((3, len(tester.t)))
    depth = np.maximum(tester.depth + 0.5e-3, 0.0)
    force = np.where(depth > 0.0, 22e3 * depth**1.5 * (1.0 + 0.15 * tester.rate), 0.0)
    force = np.interp(tester.t - 0.008, tester.t, force) + NOISE * rng.standard_normal(len(depth))
    log = kinid.Log(t=tester.t, phase=tester.phase, contact={"depth": tester.depth, "normal_force": force})
    found = kinid.diagnose(log, RIG, model=kinid.Model("hertz", "hunt-crossley-damping"))
    assert set(found.added) == {"surface-offset", "time-offset"}
    assert found.fit["surface-offset.offset"].value == pytest.approx(0.5e-3, rel=0.1)


@pytest.mark.parametrize(("offset", "late"), [(0.25e-3, 0.0082), (0.25e-3, 0.0081), (0.3e-3, 0.0084)])
def test_two_that_explain_too_little_alone_are_found_together(tester: Tester, offset: float, late: float) -> None:
    """A surface and a clock that are off by a little more than calibration is trusted to."""
    t, rate = tester.t / 2.0, 2.0 * tester.rate
    depth = np.maximum(tester.depth + offset, 0.0)
    force = np.where(depth > 0.0, 757.0 * depth * (1.0 + 0.2 * rate), 0.0)
    force = np.interp(t - late, t, force) + NOISE * np.random.default_rng(37).standard_normal(len(t))
    log = kinid.Log(t=t, phase=tester.phase, contact={"depth": tester.depth, "normal_force": force})
    found = kinid.diagnose(log, RIG, model=kinid.Model("hooke", "hunt-crossley-damping"))
    assert set(found.added) == {"surface-offset", "time-offset"}
    assert found.steps[-1].held_out < 1.1 * NOISE
    assert found.fit["time-offset.delay"].value == pytest.approx(late, rel=0.1)


def test_a_tool_that_is_lighter_as_a_whole_is_not_told_from_a_gain(
    swing: Callable[..., Any], weighed: Callable[..., Any]
) -> None:
    """Its moments of inertia are off as its mass is: what only they would tell is no evidence for the sensor."""
    t = np.arange(0.0, 24.0, 5e-3)
    q, dq, ddq = swing(np.deg2rad([0.0, -40.0, 0.0, 85.0, 0.0, -55.0, 0.0]), seed=4, size=0.4, speed=2.5)(t)
    tool = {"mass": 0.7, "com": [0.01, 0.0, 0.06], "inertia": [2e-3, 2e-3, 1e-3, 0.0, 0.0, 0.0]}
    rig = kinid.Rig.parse({"robot": {"model": "lwr4plus"}, "tool": tool, "sensor": {"bias": [0.0] * 6}})
    load = weighed(rig, Robot.load(rig), q, dq, ddq)
    noise = np.random.default_rng(8).standard_normal((len(t), 6)) * [0.02, 0.02, 0.02, 5e-4, 5e-4, 5e-4]
    log = kinid.Log(t, q=q + 2e-6 * np.random.default_rng(9).standard_normal(q.shape), wrench=0.88 * load + noise)
    found = kinid.diagnose(log, rig, model=kinid.Model())
    assert len(found.added) == 1
    first = found.added[0]
    assert {first, *found[first].equivalent_to} == {"sensor-gain", "tool-mass"}
