"""What `contact` doubts of a log with joints, each named with the field that is really wrong."""

from __future__ import annotations

import dataclasses
import re
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from contact.doubting import changed, doubts, only, with_joints
from scripted import scripted_poke

import kinid.urdf
from kinid.contact.analysis import analyse
from kinid.contact.doubts import contact_doubts
from kinid.contact.series import contact_series
from kinid.data.log import Log
from kinid.data.rig import WRENCH, Rig, ToolSpec
from kinid.errors import InputError
from kinid.identification.fit import fit_model
from kinid.modeling.model import Model
from kinid.robotics.robot import Robot
from kinid.robotics.wrench import tool_load
from kinid.units import FACTORS


def test_a_good_log_is_not_doubted(touched: tuple[Log, Rig, Robot]) -> None:
    assert doubts(*touched) == ""


def test_a_tool_of_another_mass(touched: tuple[Log, Rig, Robot]) -> None:
    log, rig, robot = touched
    said = doubts(log, changed(rig, tool={"mass": 0.5}), robot)
    assert "correct [tool] mass" in said
    # the true one, 0.24 kg, within its error
    assert "reads a tool of 0.2" in said


@pytest.mark.parametrize(("factor", "unit"), [(1e3, "mN"), (1 / 9.80665, "kgf")])
def test_a_wrench_in_another_unit(touched: tuple[Log, Rig, Robot], factor: float, unit: str) -> None:
    log, rig, robot = touched
    assert log.wrench is not None
    rig = changed(rig, sensor={"range": (1e6,) * 6})
    said = doubts(dataclasses.replace(log, wrench=factor * np.asarray(log.wrench)), rig, robot)
    assert f'wrench = {{ unit = "{unit}" }}' in said


@pytest.mark.parametrize(
    ("axes", "signs", "words"), [((1, 0, 2), (1, 1, 1), "left-handed"), ((0, 1, 2), (-1, -1, 1), "fx is −fx")]
)
def test_axes_that_are_exchanged_or_turned(
    touched: tuple[Log, Rig, Robot], axes: tuple[int, ...], signs: tuple[int, ...], words: str
) -> None:
    log, rig, robot = touched
    assert log.wrench is not None
    wrench = np.array(log.wrench)
    wrench[:, :3] = wrench[:, axes] * signs
    said = doubts(dataclasses.replace(log, wrench=wrench), rig, robot)
    assert "gravity in free motion is explained" in said
    assert words in said


def test_a_reading_beyond_the_sensors_range(touched: tuple[Log, Rig, Robot]) -> None:
    log, rig, robot = touched
    assert "fz reaches" in doubts(log, changed(rig, sensor={"range": (40, 40, 1.0, 2, 2, 2)}), robot)


def with_bias(log: Log, rig: Rig, robot: Robot, off: float = 0.0) -> Rig:
    """The rig with the bias stated that free motion shows, off along fz."""
    bias = np.array(contact_series(log, rig, robot=robot).bias)
    bias[2] += off
    return changed(rig, sensor={"bias": tuple(bias)})


@pytest.mark.parametrize(("off", "doubted"), [(0.0, False), (0.5, False), (10.0, True), (-10.0, True)])
@pytest.mark.parametrize("turning", [True, False])
def test_a_stated_bias_that_free_motion_contradicts(
    touched: tuple[Log, Rig, Robot], off: float, doubted: bool, turning: bool
) -> None:
    log, rig, robot = touched
    first = 0 if turning else 2000
    phase = np.where(np.arange(len(log)) < 2200, "free", "touch")
    log = Log(t=log.t[first:], q=log.q[first:], wrench=log.wrench[first:], phase=phase[first:])  # type: ignore[index]
    said = doubts(log, with_bias(log, rig, robot, off), robot)
    assert ("correct [sensor] bias" in said) == doubted
    assert "|" not in said
    assert doubted or said == ""
    if off < 0.0:  # what pulls like a heavier tool may be one
        assert "or [tool] mass, as 1.2" in said


@pytest.mark.parametrize("stated", [True, False])
def test_a_tool_without_mass_whose_load_free_motion_shows(touched: tuple[Log, Rig, Robot], stated: bool) -> None:
    log, rig, robot = touched
    own = with_bias(log, rig, robot) if stated else rig
    assert "the rig says 0 kg: correct [tool] mass" in doubts(log, changed(own, tool={"mass": 0.0}), robot)


def test_a_unit_that_was_stated_by_mistake(touched: tuple[Log, Rig, Robot]) -> None:
    log, rig, robot = touched
    rig = Rig.parse({**rig.model_dump(exclude_none=True, exclude={"folder"}), "columns": {"wrench": {"unit": "mN"}}})
    said = doubts(dataclasses.replace(log, wrench=1e-3 * np.asarray(log.wrench)), rig, robot)
    assert 'wrench = { unit = "N" }' in said


def test_a_surface_metres_away(touched: tuple[Log, Rig, Robot]) -> None:
    log, rig, robot = touched
    assert "check [surface] point" in doubts(log, changed(rig, surface={"point": (0.55, 0.0, 1.1)}), robot)


@pytest.mark.parametrize(
    ("height", "words"),
    [
        (0.09, "mm or more outside"),
        (0.11, "mm or more inside"),
        (0.097, "mm or more outside"),
        (0.1035, "mm or more inside"),
        (0.2, "mm or more inside"),
        (0.0, "mm or more outside"),
    ],
)
@pytest.mark.parametrize("labelled", [True, False])
def test_a_surface_that_touches_begin_far_from(
    touched: tuple[Log, Rig, Robot], height: float, words: str, labelled: bool
) -> None:
    log, rig, robot = touched
    phase = np.where(np.arange(len(log)) < 2000, "free", "touch") if labelled else None
    said = doubts(dataclasses.replace(log, phase=phase), changed(rig, surface={"point": (0.55, 0.0, height)}), robot)
    assert f"{words} the surface: correct [surface] point" in said
    assert "kinid contact LOG --find-surface" in said
    assert "|" not in said


def test_a_surface_that_is_known_no_better_is_not_doubted(touched: tuple[Log, Rig, Robot]) -> None:
    log, rig, robot = touched
    assert doubts(log, changed(rig, surface={"point": (0.55, 0.0, 0.108), "offset_sd": 0.005}), robot) == ""


@pytest.mark.parametrize("length", [1.0, 1.62, 9.6, 10.0])
def test_gravity_of_a_length_that_no_place_on_earth_has(touched: tuple[Log, Rig, Robot], length: float) -> None:
    log, rig, _ = touched
    rig = changed(rig, robot={"gravity": (0.0, 0.0, -length)})
    assert f"[robot] gravity is {length:g} m/s² long" in doubts(log, rig, Robot.load(rig))


def test_a_noise_beyond_all_readings(touched: tuple[Log, Rig, Robot]) -> None:
    log, rig, robot = touched
    assert "[sensor] noise of 35 N" in doubts(log, changed(rig, sensor={"noise": (35.0, 0, 0, 0, 0, 0)}), robot)


@pytest.mark.parametrize(("offset", "left_out"), [(5.0, True), (1e-4, False)])
def test_a_clock_offset_that_a_table_has_no_use_for_is_said(
    touched: tuple[Log, Rig, Robot], offset: float, left_out: bool
) -> None:
    log, rig, robot = touched
    own = Rig.parse(
        {**rig.model_dump(exclude_none=True, exclude={"folder"}), "streams": {"wrench_clock_offset": offset}}
    )
    steps = [str(step) for step in analyse(log, own, robot=robot).provenance.steps]
    assert any("wrench_clock_offset of 5 s" in step for step in steps) == left_out


def test_joints_beyond_their_limits(touched: tuple[Log, Rig, Robot]) -> None:
    log, rig, robot = touched
    assert log.q is not None
    q = np.array(log.q)
    q[:, 3] += 2.5
    assert "joint_4 from" in doubts(dataclasses.replace(log, q=q), rig, robot)


@pytest.mark.parametrize("turns", [-1, 1, 2])
def test_a_joint_that_is_off_by_a_turn_is_in_no_other_unit(touched: tuple[Log, Rig, Robot], turns: int) -> None:
    log, rig, robot = touched
    q = np.array(log.q)
    q[:, 4] += 2 * np.pi * turns
    said = doubts(dataclasses.replace(log, q=q), rig, robot)
    assert f"q5 = {{ offset = {-2 * np.pi * turns:.6g} }}" in said
    assert "|" not in said


@pytest.mark.parametrize(
    ("factor", "words"),
    [
        (1e3, 't = { unit = "ms"'),
        (1e6, 't = { unit = "us"'),
        (1e-3, "2e-06 s between samples"),
        (60.0, "taken for poses at rest"),
    ],
)
def test_time_in_another_unit(touched: tuple[Log, Rig, Robot], factor: float, words: str) -> None:
    log, rig, robot = touched
    said = doubts(dataclasses.replace(log, t=factor * np.asarray(log.t)), rig, robot)
    assert words in said
    assert "is the time in another unit? Say so in [columns] of the rig: t = { unit = " in said
    assert "|" not in said


@pytest.mark.parametrize("labelled", [True, False])
def test_a_normal_that_points_into_the_material(touched: tuple[Log, Rig, Robot], labelled: bool) -> None:
    log, rig, robot = touched
    phase = np.where(np.arange(len(log)) < 2000, "free", "touch") if labelled else None
    said = doubts(dataclasses.replace(log, phase=phase), changed(rig, surface={"normal": (0.0, 0.0, -1.0)}), robot)
    assert "[surface] normal points into the material" in said
    assert "normal = [0, 0, 1]" in said
    assert "|" not in said  # and nothing else, that only follows from it


def tilted(rig: Rig, degrees: float) -> Rig:
    """The rig with its normal turned by so much, about the second tangent."""
    angle = np.deg2rad(degrees)
    return changed(rig, surface={"normal": (np.sin(angle), 0.0, np.cos(angle)), "tangent": (0.0, 1.0, 0.0)})


@pytest.mark.parametrize(
    ("degrees", "doubted"), [(0.0, False), (4.0, False), (20.0, True), (-30.0, True), (45.0, True)]
)
def test_a_normal_that_touches_do_not_push_along(
    touched: tuple[Log, Rig, Robot], degrees: float, doubted: bool
) -> None:
    log, rig, robot = touched
    said = doubts(log, tilted(rig, degrees), robot)
    assert ("off [surface] normal: correct it, as normal = [" in said) == doubted
    assert "|" not in said
    if doubted:
        assert abs(float(said.split("about ")[1].split("°")[0]) - abs(degrees)) < 6.0


def test_a_normal_that_is_known_no_better_is_not_doubted(touched: tuple[Log, Rig, Robot]) -> None:
    log, rig, robot = touched
    assert doubts(log, changed(tilted(rig, 20.0), surface={"tilt_sd": 0.1}), robot) == ""


@pytest.mark.parametrize("mass", [410.0, 240.0, 1.0])
def test_an_absurd_mass_is_the_tools_and_no_unit(touched: tuple[Log, Rig, Robot], mass: float) -> None:
    log, rig, robot = touched
    said = analyse(log, changed(rig, tool={"mass": mass}), robot=robot).provenance.warnings
    assert len(said) == 1
    assert f"the rig says {mass:g} kg: correct [tool] mass" in said[0]


@pytest.mark.parametrize(
    ("rows", "factor", "words"),
    [(slice(3, 6), 1e3, 'tx = { unit = "Nmm" }'), (slice(0, 3), 1e3, 'fx = { unit = "mN" }')],
)
def test_forces_and_moments_of_different_units(
    touched: tuple[Log, Rig, Robot], rows: slice, factor: float, words: str
) -> None:
    log, rig, robot = touched
    assert log.wrench is not None
    wrench = np.array(log.wrench)
    wrench[:, rows] *= factor
    said = doubts(dataclasses.replace(log, wrench=wrench), changed(rig, sensor={"range": (1e6,) * 6}), robot)
    assert words in said
    assert "|" not in said


@pytest.mark.parametrize(("factor", "said", "unit"), [(1e3, {}, "Nmm"), (1e-3, {"unit": "N·mm"}, "Nm")])
def test_one_moment_in_another_unit(
    touched: tuple[Log, Rig, Robot], factor: float, said: dict[str, str], unit: str
) -> None:
    log, rig, robot = touched
    assert log.wrench is not None
    whole = rig.model_dump(exclude_none=True, exclude={"folder"})
    rig = Rig.parse(whole | {"sensor": {}, "columns": {"ty": said} if said else {}})
    wrench = np.array(log.wrench)
    wrench[:, 4] *= factor
    words = doubts(dataclasses.replace(log, wrench=wrench), rig, robot)
    assert "ty is " in words
    assert f'ty = {{ unit = "{unit}" }}' in words.replace("·", "")


@pytest.mark.parametrize("noise", ["stated", "not stated"])
@pytest.mark.parametrize("turning", [True, False])
@pytest.mark.parametrize(
    ("name", "factor", "unit"),
    [
        ("fx", 1e3, "mN"),
        ("fz", 1e3, "mN"),
        ("fy", 1e-3, "kN"),
        ("fx", 1 / 9.80665, "kgf"),
        ("tx", 1e3, "Nmm"),
        ("tz", 1e3, "Nmm"),
        ("ty", 1e-3, "kNm"),
        ("ty", 1 / 9.80665, "kgf·m"),
    ],
)
def test_one_channel_in_another_unit_than_its_fellows(
    touched: tuple[Log, Rig, Robot], name: str, factor: float, unit: str, turning: bool, noise: str
) -> None:
    log, rig, robot = touched
    if noise == "not stated":
        rig = rig.model_copy(update={"sensor": rig.sensor.model_copy(update={"noise": None})})
    rows = slice(0 if turning else 2000, None)
    wrench = np.array(log.wrench)[rows]
    wrench[:, WRENCH.index(name)] *= factor
    said = doubts(Log(t=log.t[rows], q=np.asarray(log.q)[rows], wrench=wrench), rig, robot)
    assert said.startswith(f"{name} is ")
    assert said.endswith(f'[columns] of the rig: {name} = {{ unit = "{unit}" }}')  # and nothing that follows from it


@pytest.mark.parametrize(("name", "factor", "unit"), [("tx", 1e3, "Nmm"), ("ty", 1e-3, "kNm"), ("tx", 1e-3, "kNm")])
def test_levers_tell_a_moment_in_another_unit_behind_a_coarse_converter(
    touched: tuple[Log, Rig, Robot], name: str, factor: float, unit: str
) -> None:
    """Its noise tells nothing, nor does the moment of a tool whose com the rig doesn't know."""
    log, rig, robot = touched
    c, s = np.cos(0.6), np.sin(0.6)  # a tool turned about its axis, so that a slide shows in two forces
    axes = np.kron(np.eye(2), np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]]))
    steps = np.array([0.25, 0.25, 0.25, 0.01, 0.01, 0.01])
    wrench = np.round((np.asarray(log.wrench) @ axes.T)[2000:] / steps) * steps
    wrench[:, WRENCH.index(name)] *= factor
    q = np.array(log.q)[2000:] + 0.6 * (np.arange(7) == 6)
    rig = rig.model_copy(update={"sensor": rig.sensor.model_copy(update={"noise": None}), "tool": ToolSpec(mass=0.24)})
    said = doubts(Log(t=log.t[2000:], q=q, wrench=wrench), rig, robot)
    assert said.startswith(f"{name} is ")
    assert "the moment of the forces at the tool's com and tip" in said
    assert said.endswith(f'[columns] of the rig: {name} = {{ unit = "{unit}" }}')


def test_a_channel_whose_noise_is_another_is_in_no_other_unit(touched: tuple[Log, Rig, Robot]) -> None:
    """Filters, and a converter's noise, are no powers of ten."""
    log, rig, robot = touched
    for name, factor in (("fz", 30.0), ("tx", 0.1), ("ty", 20.0)):
        noise = list(rig.sensor.noise or ())
        noise[WRENCH.index(name)] /= factor
        assert "another unit" not in doubts(log, changed(rig, sensor={"noise": tuple(noise)}), robot)


def test_moments_on_other_axes_than_forces(touched: tuple[Log, Rig, Robot]) -> None:
    log, rig, robot = touched
    assert log.wrench is not None
    said = doubts(dataclasses.replace(log, wrench=np.asarray(log.wrench)[:, [0, 1, 2, 4, 3, 5]]), rig, robot)
    assert "the moments of the forces" in said
    assert "tx is ty, ty is tx" in said


@pytest.mark.parametrize("gravity", [(9.81, 0.0, 0.0), (0.0, 6.94, -6.94), (0.0, 0.0, 9.81)])
def test_gravity_of_another_direction(touched: tuple[Log, Rig, Robot], gravity: tuple[float, float, float]) -> None:
    log, rig, _ = touched
    rig = changed(rig, robot={"gravity": gravity})
    said = doubts(log, rig, Robot.load(rig))
    assert "correct [robot] gravity" in said
    assert "-9.8] m/s²" in said


@pytest.mark.parametrize("late", [-0.06, 0.04, 0.15])
def test_a_wrench_of_another_time_is_told_by_how_much(touched: tuple[Log, Rig, Robot], late: float) -> None:
    """It was a sensor that is turned."""
    log, rig, robot = touched
    t = np.asarray(log.t)
    wrench = np.stack([np.interp(t - late, t, channel) for channel in np.asarray(log.wrench).T], axis=1)
    said = doubts(dataclasses.replace(log, wrench=wrench), rig, robot)
    word = "after" if late > 0.0 else "before"
    found = re.search(rf"the wrench comes (\d+) ms {word} the joints", said)
    assert found is not None, said
    assert abs(int(found[1]) - 1e3 * abs(late)) <= 5  # a step of the search
    assert "turned" not in said


def test_spikes_are_no_other_time(touched: tuple[Log, Rig, Robot]) -> None:
    """Squares of a few, which a shift leaves out, say nothing of the rest."""
    log, rig, robot = touched
    wrench = np.array(log.wrench)
    wrench[np.random.default_rng(2).choice(1500, 15, replace=False), :3] += 20.0
    assert "the wrench comes" not in doubts(dataclasses.replace(log, wrench=wrench), rig, robot)


def test_a_sensor_turned_by_half_a_turn_is_no_gravity_of_the_other_sign(touched: tuple[Log, Rig, Robot]) -> None:
    """Changes of the load alone may look like the other sign; its mean doesn't."""
    log, rig, robot = touched
    turned = dataclasses.replace(log, wrench=np.asarray(log.wrench) * [-1, -1, 1, -1, -1, 1])
    with pytest.raises(InputError) as caught:
        analyse(turned, rig, robot=robot)
    assert "180° about its z" in caught.value.mend
    assert "signs of fx, fy, tx, ty" in caught.value.mend
    assert "correct [robot] gravity" not in caught.value.mend


def test_gravity_upside_down_is_told_from_a_turned_wrench_by_the_touch(touched: tuple[Log, Rig, Robot]) -> None:
    log, rig, robot = touched
    assert log.wrench is not None
    log = dataclasses.replace(log, t=3.0 * np.asarray(log.t))  # so slow that inertia tells nothing
    with pytest.raises(InputError) as wrench:
        analyse(dataclasses.replace(log, wrench=-np.asarray(log.wrench)), rig, robot=robot)
    assert "wrench = { scale = -1 }" in wrench.value.mend
    assert "gravity" not in wrench.value.mend
    hung = changed(rig, robot={"gravity": (0.0, 0.0, 9.81)})
    with pytest.raises(InputError) as gravity:
        analyse(log, hung, robot=Robot.load(hung))
    assert "correct [robot] gravity" in gravity.value.mend
    assert "scale" not in gravity.value.mend


@pytest.mark.parametrize(
    ("columns", "rows", "words"),
    [
        (range(6), slice(None), "the wrench never changes"),
        ([2], slice(None), "fz never changes"),
        ([3, 5], slice(None), "tx and tz never change,"),
        (range(6), slice(3000, 3250), "the wrench repeats one reading for 0.5 s"),
    ],
)
def test_a_sensor_that_stands_still(
    touched: tuple[Log, Rig, Robot], columns: list[int], rows: slice, words: str
) -> None:
    log, rig, robot = touched
    assert log.wrench is not None
    wrench = np.array(log.wrench)
    for k in columns:
        wrench[rows, k] = wrench[rows, k][0]
    said = doubts(dataclasses.replace(log, wrench=wrench), rig, robot)
    assert words in said
    assert "|" not in said


def test_a_stream_that_is_held_between_its_readings_did_not_freeze(touched: tuple[Log, Rig, Robot]) -> None:
    log, rig, robot = touched
    assert log.wrench is not None
    held = np.asarray(log.wrench)[np.arange(len(log)) // 20 * 20]
    assert "repeats" not in doubts(dataclasses.replace(log, wrench=held), rig, robot)


def test_joints_that_stand_still_through_a_touch(touched: tuple[Log, Rig, Robot]) -> None:
    log, rig, robot = touched
    assert log.q is not None
    q = np.tile(log.q[3000], (len(log), 1))
    assert "the joints never change, where f" in doubts(dataclasses.replace(log, q=q), rig, robot)


def test_moments_that_were_not_measured_are_no_dead_channels(touched: tuple[Log, Rig, Robot]) -> None:
    log, rig, robot = touched
    assert log.wrench is not None
    wrench = np.array(log.wrench)
    wrench[:, 3:] = 0.0
    assert doubts(dataclasses.replace(log, wrench=wrench), rig, robot) == ""


def test_a_fit_has_the_doubts_of_its_contact_frame(touched: tuple[Log, Rig, Robot]) -> None:
    log, rig, _ = touched
    log, rig = dataclasses.replace(log, tau=None), changed(rig, tool={"mass": 0.5})
    fits = [
        fit_model(Model("hooke"), data, own, held_out=False)
        for data, own in ((contact_series(log, rig), None), (log, rig))
    ]
    assert all(any("correct [tool] mass" in warning for warning in fit.warnings) for fit in fits)


def test_frames_that_are_missing_are_named_with_those_that_there_are(
    touched: tuple[Log, Rig, Robot], tmp_path: Path
) -> None:
    log, rig, _ = touched
    text = (Path(kinid.urdf.__file__).parent / "lwr4plus.urdf").read_text()
    (tmp_path / "arm.urdf").write_text(text.replace("ft_sensor", "gauge").replace("tool_tip", "nozzle"))
    bare = Rig.parse({"robot": {"model": str(tmp_path / "arm.urdf")}})
    with pytest.raises(InputError, match="nozzle, gauge") as refused:
        analyse(log, bare)
    assert "name [robot] tip_frame and sensor_frame" in refused.value.mend
    torques = analyse(dataclasses.replace(log, tau=np.zeros((len(log), 7)), wrench=None), bare)
    assert any("no 'ft_sensor'; name [robot]" in str(step) for step in torques.provenance.steps)
    tip = Rig.parse({"robot": {"model": str(tmp_path / "arm.urdf"), "tip_frame": "nozzle"}})
    assert any("name [robot] sensor_frame, of nozzle" in str(step) for step in analyse(log, tip).provenance.steps)


def stronger(log: Log) -> Log:
    return dataclasses.replace(log, wrench=np.asarray(log.wrench) * [1, 1, 1.3, 1, 1, 1])


def drifting(log: Log) -> Log:
    return dataclasses.replace(log, wrench=np.asarray(log.wrench) + (log.t - log.t[0])[:, None] * [0, 0, 1.0, 0, 0, 0])


def loud(log: Log) -> Log:
    noise = np.random.default_rng(3).normal(scale=4.0, size=(len(log), 3))
    return dataclasses.replace(log, wrench=np.asarray(log.wrench) + np.pad(noise, ((0, 0), (0, 3))))


@pytest.mark.parametrize(
    ("damaged", "words"),
    [
        (stronger, "are left beside the tool's load"),
        (drifting, "are left beside the tool's load"),
        (loud, "check the wrench's columns"),
    ],
)
def test_a_tip_inside_the_material_that_nothing_is_felt_of(
    touched: tuple[Log, Rig, Robot], damaged: Callable[[Log], Log], words: str
) -> None:
    log, rig, robot = touched
    rig = changed(
        with_bias(log, rig, robot), sensor={"range": (200,) * 3 + (20,) * 3, "noise": (0.03,) * 3 + (1e-3,) * 3}
    )
    # the poke alone: in one posture nothing else tells what is wrong
    poke = Log(t=log.t[2000:], q=log.q[2000:], wrench=log.wrench[2000:])  # type: ignore[index]
    assert doubts(poke, rig, robot) == ""
    said = doubts(damaged(poke), rig, robot)
    assert "mm inside the surface, and nothing counts as a touch" in said
    assert words in said


@pytest.mark.parametrize("com", [(0.0, 0.0, 0.3), (0.049, 0.0, 0.0), (0.0, 0.03, 0.049), (0.0, 0.0, -0.049)])
def test_a_com_that_the_moments_in_free_motion_contradict(
    touched: tuple[Log, Rig, Robot], com: tuple[float, float, float]
) -> None:
    log, rig, robot = touched
    said = doubts(log, changed(rig, tool={"com": com}), robot)
    assert "correct [tool] com" in said
    found = [float(x) for x in said.split("com at [")[1].split("]")[0].split(",")]
    np.testing.assert_allclose(found, [0.0, 0.0, 0.049], atol=0.003)


@pytest.mark.parametrize("com", [(0.0, 0.0, 0.055), (0.005, 0.0, 0.049)])
def test_a_com_that_is_roughly_known_is_not_doubted(
    touched: tuple[Log, Rig, Robot], com: tuple[float, float, float]
) -> None:
    log, rig, robot = touched
    assert "com" not in doubts(log, changed(rig, tool={"com": com}), robot)


@pytest.mark.parametrize("factor", [0.25, 0.4])
def test_a_time_that_the_tools_inertia_contradicts(touched: tuple[Log, Rig, Robot], factor: float) -> None:
    log, rig, robot = touched
    said = doubts(dataclasses.replace(log, t=factor * log.t), rig, robot)
    assert "correct unit or scale of t in [columns]" in said
    assert float(said.split("all times were ")[1].split()[0]) == pytest.approx(1 / factor, rel=0.1)


def test_rows_that_come_in_bursts_are_told_from_rows_that_are_lost(touched: tuple[Log, Rig, Robot]) -> None:
    whole, rig, robot = touched
    some = slice(1000, 5000)
    log = Log(t=whole.t[some], q=np.asarray(whole.q)[some], wrench=np.asarray(whole.wrench)[some])
    row = np.arange(len(log))
    bursts = log.t[row // 5 * 5] + 1e-4 * (row % 5)
    said = doubts(dataclasses.replace(log, t=bursts), rig, robot)
    assert float(said.split("t = { rate = ")[1].split()[0]) == pytest.approx(1 / log.period, rel=1e-3)
    assert "[tool]" not in said
    kept = row % 10 < 2
    lost = Log(t=log.t[kept], q=np.asarray(log.q)[kept], wrench=np.asarray(log.wrench)[kept])
    assert "bursts" not in doubts(lost, rig, robot)


def test_a_pause_of_days_lies_between_two_recordings(touched: tuple[Log, Rig, Robot]) -> None:
    log, rig, robot = touched
    behind = np.arange(len(log)) >= 3000
    for pause, said in ((2 * 86400.0, True), (20.0, False)):
        words = doubts(dataclasses.replace(log, t=log.t + pause * behind), rig, robot)
        assert ("two recordings" in words) == said
        assert not said or f"1.728e+05 s from {log.t[2999]:.4g} s on" in words


def test_a_sensor_that_stands_still_for_most_of_a_log(touched: tuple[Log, Rig, Robot]) -> None:
    log, rig, robot = touched
    wrench, q = np.array(log.wrench), np.array(log.q)
    wrench[len(log) // 3 :] = wrench[len(log) // 3]
    q += np.random.default_rng(2).normal(scale=1e-6, size=q.shape)
    assert "the wrench repeats one reading" in doubts(dataclasses.replace(log, wrench=wrench, q=q), rig, robot)


@pytest.mark.parametrize(
    ("change", "say"),
    [
        (lambda q: q / (2 * np.pi), 'q = { unit = "rev" }'),
        (lambda q: q * only(4, -1.0), "q4 = { scale = -1 }"),
        (lambda q: q * only(6, np.pi / 180.0), 'q6 = { unit = "rad" }'),
        (lambda q: q[:, [0, 1, 2, 3, 5, 4, 6]], "the columns of q5 and q6 exchanged"),
    ],
)
def test_joints_of_another_unit_sign_or_order_are_told_by_the_tools_weight(
    touched: tuple[Log, Rig, Robot], change: Callable[[np.ndarray], np.ndarray], say: str
) -> None:
    _, rig, robot = touched
    log = dataclasses.replace(with_joints(scripted_poke(seed=5).log, change), tau=None)
    try:
        said = " | ".join(analyse(log, rig, robot=robot).provenance.warnings)
    except InputError as refused:
        said = str(refused)
    assert say in said


@pytest.mark.parametrize("degrees", [10.0, -20.0])
def test_gravity_that_is_off_by_an_angle(touched: tuple[Log, Rig, Robot], degrees: float) -> None:
    log, rig, _ = touched
    angle = np.deg2rad(degrees)
    rig = changed(rig, robot={"gravity": (9.81 * np.sin(angle), 0.0, -9.81 * np.cos(angle))})
    said = doubts(log, rig, Robot.load(rig))
    assert "[robot] gravity" in said
    assert "-9.8" in said


@pytest.mark.parametrize("degrees", [30.0, -45.0])
def test_a_sensor_that_is_mounted_askew(touched: tuple[Log, Rig, Robot], degrees: float) -> None:
    log, rig, robot = touched
    assert log.wrench is not None
    c, s = np.cos(np.deg2rad(degrees)), np.sin(np.deg2rad(degrees))
    axes = np.kron(np.eye(2), np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]]))
    said = doubts(dataclasses.replace(log, wrench=np.asarray(log.wrench) @ axes.T), rig, robot)
    assert "the sensor is turned by " in said
    assert abs(float(said.split("turned by ")[1].split("°")[0]) - abs(degrees)) < 3.0
    assert f"{np.sign(degrees):.0f}] of its frame" in said


@pytest.mark.parametrize(
    ("rows", "factor", "names", "unit"),
    [
        (slice(0, 3), 1e-3, "f", "kN"),
        (slice(0, 3), 1 / 9.80665, "f", "kgf"),
        (slice(3, 6), 1e-3, "t", "kNm"),
        (slice(3, 6), 1e2, "t", "Ncm"),
    ],
)
def test_forces_alone_or_moments_alone_in_another_unit_are_named(
    touched: tuple[Log, Rig, Robot], rows: slice, factor: float, names: str, unit: str
) -> None:
    log, rig, robot = touched
    wrench = np.array(log.wrench)
    wrench[:, rows] *= factor
    said = doubts(dataclasses.replace(log, wrench=wrench), changed(rig, sensor={"range": (1e6,) * 6}), robot)
    assert ", ".join(f'{names}{axis} = {{ unit = "{unit}" }}' for axis in "xyz") in said
    assert "|" not in said


def test_forces_and_moments_of_two_units_are_no_wrong_com(touched: tuple[Log, Rig, Robot]) -> None:
    log, rig, robot = touched
    force, moment = "lbf", "lbf·in"
    wrench = np.asarray(log.wrench) / np.repeat([FACTORS[force], FACTORS[moment]], 3)
    said = doubts(dataclasses.replace(log, wrench=wrench), changed(rig, sensor={"range": (1e6,) * 6}), robot)
    assert ", ".join(f'f{axis} = {{ unit = "{force}" }}' for axis in "xyz") in said
    assert ", ".join(f't{axis} = {{ unit = "{moment}" }}' for axis in "xyz") in said
    assert "|" not in said


def test_moments_of_the_opposite_sign_are_no_wrong_com(touched: tuple[Log, Rig, Robot]) -> None:
    log, rig, robot = touched
    wrench = np.asarray(log.wrench) * [1, 1, 1, -1, -1, -1]
    said = doubts(dataclasses.replace(log, wrench=wrench), rig, robot)
    assert "are explained" in said
    assert "tx is −tx, ty is −ty" in said
    assert "com at [" not in said


@pytest.mark.parametrize("off", [(0.015, 0.0, 0.0), (0.0, -0.008, 0.0), (0.0, 0.0, 0.06)])
def test_a_tip_that_the_moments_of_touches_contradict(
    touched: tuple[Log, Rig, Robot], off: tuple[float, float, float]
) -> None:
    log, rig, robot = touched
    tip = robot.tip_in_sensor()
    load = tool_load(rig.carried, robot.kinematics("ft_sensor", log.q, 0.0 * log.q, 0.0 * log.q), robot.gravity)  # type: ignore[operator, arg-type]
    push = (np.asarray(log.wrench) - load)[:, :3]
    wrench = np.array(log.wrench)
    wrench[:, 3:] += np.cross(off, push - np.median(push[:2000], axis=0))
    said = doubts(dataclasses.replace(log, wrench=wrench), rig, robot)
    assert "correct [robot] tip_frame" in said
    found = [float(x) for x in said.split("tip at [")[1].split("]")[0].split(",")]
    np.testing.assert_allclose(found, tip + off, atol=0.004)


def test_a_tool_that_the_rig_lacks(touched: tuple[Log, Rig, Robot]) -> None:
    log, rig, robot = touched
    bare = rig.model_copy(update={"tool": None})
    said = doubts(log, bare, robot)
    assert "reads a tool of 0.2" in said
    assert said.endswith("the rig has no [tool]: state its mass and com")
    # a controller has taken the weight off, and left a little of another direction
    q = np.asarray(log.q)
    load = tool_load(rig.carried, robot.kinematics("ft_sensor", q, 0.0 * q, 0.0 * q), robot.gravity)
    taken = np.asarray(log.wrench) - load + 0.3 * load[:, [1, 0, 2, 4, 3, 5]]
    assert "[tool]" not in doubts(dataclasses.replace(log, wrench=taken), bare, robot)


@pytest.mark.parametrize("still", [slice(300, 900), slice(None)])
def test_a_reading_that_stands_alone_is_no_touch_of_joints_at_rest(
    touched: tuple[Log, Rig, Robot], still: slice
) -> None:
    log, rig, robot = touched
    q, wrench = np.array(log.q)[:2000], np.array(log.wrench)[:2000]
    q[still] = q[300]
    wrench[still] = wrench[300] + np.random.default_rng(4).normal(scale=0.015, size=wrench[still].shape)
    wrench[500] += [20.0, 0.0, 20.0, 0.0, 0.0, 0.0]
    said = contact_doubts(dataclasses.replace(log, t=log.t[:2000], q=q, wrench=wrench), rig, robot, None)
    assert not any("the robot's state" in line for line in said)


@pytest.mark.parametrize("joints", [[5], [4], list(range(7))])
def test_joints_whose_positions_stop_in_a_log(touched: tuple[Log, Rig, Robot], joints: list[int]) -> None:
    log, rig, robot = touched
    begin, end = (300, 900) if len(joints) == 1 else (3000, len(log) - 300)
    q = np.array(log.q)
    q[begin:end, joints] = q[begin, joints]
    said = doubts(dataclasses.replace(log, q=q), rig, robot)
    assert "the robot's state stood still" in said
    assert (f"q{joints[0] + 1} repeats" if len(joints) == 1 else "all joints repeat") in said


@pytest.mark.parametrize("since", [0.0, 3.2])
def test_touches_that_no_surface_is_near_are_not_passed_over(touched: tuple[Log, Rig, Robot], since: float) -> None:
    _, rig, robot = touched
    whole = scripted_poke(seed=5).log
    rows = slice(int(np.searchsorted(whole.t, since)), None)
    log = Log(t=whole.t[rows], q=np.asarray(whole.q)[rows] * only(6, -1.0), wrench=np.asarray(whole.wrench)[rows])
    said = doubts(log, rig, robot)
    assert "as in a touch, and nothing counts as one" in said
    assert "check unit, sign and order of q in [columns]" in said


def test_what_stands_still_is_said_once(touched: tuple[Log, Rig, Robot]) -> None:
    log, rig, robot = touched
    wrench = np.array(log.wrench)
    wrench[:, 0] = 0.5
    said = contact_doubts(dataclasses.replace(log, wrench=wrench), rig, robot, None)
    assert [line for line in said if "fx never changes" in line] == said[:1]
    assert len(set(said)) == len(said)
