"""Errors planted in one part of a log are found there and said; noise alone is not an error anywhere."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from numpy.typing import NDArray

from kinid.effects import JointMotion, Layout, SensorMotion, Signals
from kinid.modeling.experiment import Experiment
from kinid.residuals import Cell
from kinid.residuals.localization import where
from kinid.residuals.parts import phases
from kinid.residuals.view import View

Array = NDArray[np.float64]

RATE = 200.0
NOISE = 0.02
CHANNELS = ("normal_force", "tangential_force1", "tangential_force2")


def touches(seed: int = 0) -> Experiment:
    """Six touches of 10 s at four places: air, press, hold, poke, slide out and back, leave."""
    rng = np.random.default_rng(seed)
    n = round(10 * RATE)
    t = np.arange(n) / RATE
    depth = np.interp(t, [0, 1, 1.5, 4.5, 7, 9, 9.5, 10], [-2e-3, -1e-3, 3e-3, 3e-3, 3e-3, 3e-3, -1e-3, -2e-3])
    depth = depth + 1e-3 * np.where((t > 4.5) & (t < 7), np.sin(2 * np.pi * 1.2 * (t - 4.5)), 0.0)
    slip = np.interp(t, [0, 7, 8, 9, 10], [0, 0, 4e-3, 0, 0])
    phase = np.select([t < 1, t < 1.5, t < 4.5, t < 7, t < 9], ["free", "approach", "hold", "poke", "slide"], "retract")
    depths, slips, phases_ = np.tile(depth, 6), [], np.tile(phase, 6)
    for k in range(6):
        place = np.array([[0.0, 0.0, 0.02, 0.02, 0.02, 0.0][k], [0.0, 0.02, 0.0, 0.02, 0.0, 0.02][k]])
        slips.append(np.stack([place[0] + slip, np.full(n, place[1])]))
    whole = np.concatenate(slips, axis=1)
    times = np.arange(6 * n) / RATE
    rate = np.gradient(whole, 1 / RATE, axis=1)
    rate[:, np.abs(rate).max(axis=0) > 0.1] = 0.0  # from place to place it is lifted
    dt = np.diff(times, prepend=times[0])
    measured = np.stack([800 * np.maximum(depths, 0), -300 * np.maximum(depths, 0) * np.sign(rate[0]), np.zeros(6 * n)])
    measured += NOISE * rng.standard_normal(measured.shape)
    depth_rate = np.gradient(depths, 1 / RATE)
    signals = Signals(Layout(CHANNELS, "contact"), times, dt, depths, depth_rate, whole, rate, measured=measured)
    return Experiment(
        signals, measured, np.ones(6 * n, np.bool_), np.full(3, NOISE), phases_, depths > 0, np.arange(6 * n)
    )


def noise(experiment: Experiment, seed: int = 1) -> Array:
    return NOISE * np.random.default_rng(seed).standard_normal(experiment.measured.shape)


def since_start(experiment: Experiment, name: str) -> Array:
    """Time since the beginning of each stretch of a phase; NaN outside."""
    mask = experiment.phase == name
    begins = mask & ~np.r_[False, mask[:-1]]
    start = np.maximum.accumulate(np.where(begins, np.arange(len(mask)), 0))
    return np.where(mask, experiment.signals.t - experiment.signals.t[start], np.nan)


def of(cells: tuple[Cell, ...], by: str) -> list[Cell]:
    return [cell for cell in cells if cell.by == by]


@pytest.mark.parametrize("seed", range(5))
def test_noise_has_no_place(seed: int) -> None:
    """Shares are of the error beyond noise: there is none."""
    e = touches(seed)
    cells = where(e, noise(e, 10 + seed), e.noise)
    assert all(cell.by == "phase" and cell.share == 0.0 for cell in cells)
    assert all("noise explains" in cell.says for cell in cells)


def test_a_decay_in_the_holds_is_found_and_said() -> None:
    e = touches()
    r = noise(e)
    age = since_start(e, "hold")
    r[0] += np.nan_to_num(0.5 * np.exp(-age / 0.8))
    cells = where(e, r, e.noise)
    assert (cells[0].channel, cells[0].phase, cells[0].by) == ("normal_force", "hold", "phase")
    assert cells[0].share > 0.98
    assert "holds of the normal force" in cells[0].says
    assert "decays: time constant about" in cells[0].says
    # steps of the grid of time constants are 14 %; noise adds less than 1 % to half of one
    assert float(cells[0].says.split("about ")[1].split(" s")[0]) == pytest.approx(0.8, rel=0.08)
    assert cells[0].rms == pytest.approx(np.sqrt(np.mean(r[0][e.phase == "hold"] ** 2)))


def test_a_decay_through_zero_is_a_decay() -> None:
    """A model that was fitted to the middle of the holds leaves as much error before as after."""
    e = touches()
    r = noise(e)
    r[0] += np.nan_to_num(0.5 * np.exp(-since_start(e, "hold") / 1.0) - 0.25)
    assert "decays: time constant" in where(e, r, e.noise)[0].says
    assert "grows: time constant" in where(e, -r, e.noise)[0].says


def test_a_constant_is_no_decay() -> None:
    e = touches()
    r = noise(e)
    r[0] += np.where(e.phase == "hold", -0.2, 0.0)
    says = where(e, r, e.noise)[0].says
    assert "is constant: about −0.2 N" in says
    assert "decays" not in says


def test_shares_add_up_over_phases_and_channels() -> None:
    """Three quarters of the squared error in one cell, one quarter in another."""
    e = touches()
    r = noise(e)
    holds, pokes = e.phase == "hold", e.phase == "poke"
    r[0] += np.where(holds, np.sqrt(0.75 / holds.sum()) * 30, 0.0)
    r[2] += np.where(pokes, np.sqrt(0.25 / pokes.sum()) * 30, 0.0)
    share = {(cell.channel, cell.phase): cell.share for cell in of(where(e, r, e.noise), "phase")}
    # noise of the sums: 2 σ Σ r of the planted steps, under 1 % of the whole here
    assert share["normal_force", "hold"] == pytest.approx(0.75, abs=0.01)
    assert share["tangential_force2", "poke"] == pytest.approx(0.25, abs=0.01)


def test_a_line_at_50_hz() -> None:
    e = touches()
    r = noise(e) + np.array([[0.0], [0.05], [0.0]]) * np.sin(2 * np.pi * 49.97 * e.signals.t + 0.3)
    line = [cell for cell in of(where(e, r, e.noise), "frequency") if "a line at 50 Hz" in cell.says]
    assert [cell.channel for cell in line] == ["tangential_force1"]
    assert line[0].share > 0.9
    # the 6000 samples of noise in the band of ±0.5 Hz around it move the amplitude by less than 1 %
    assert float(line[0].says.split("amplitude of ")[1].split(" N")[0]) == pytest.approx(0.05, rel=0.03)


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_noise_swings_at_no_frequency_though_errors_are_elsewhere(seed: int) -> None:
    """Bursts in all holds but the first, which holds a little more noise than was counted on."""
    e = touches()
    residual = noise(e, seed)
    holds = np.flatnonzero(e.phase == "hold")
    residual[:, holds[: round(3 * RATE)]] *= 1.01
    rng = np.random.default_rng(4)
    for at in rng.choice(holds[round(3.5 * RATE) :], 40):
        residual[0, at : at + 5] += 0.5 * rng.choice([-1, 1])
    sayings = [c.says for c in where(e, residual, e.noise) if "holds of the normal" in c.says]
    assert sayings
    assert not [says for says in sayings if "swings" in says or "line at" in says]


def test_frequencies_are_those_of_the_piece_that_holds_the_error() -> None:
    """A gap leaves most of the log in one piece without the error: its noise is at all frequencies, and says
    nothing.
    """
    e = touches()
    begins = round(15 * RATE)
    dt = e.signals.dt.copy()
    dt[begins] = 0.0
    e = dataclasses.replace(e, signals=dataclasses.replace(e.signals, dt=dt))
    residual = noise(e)
    residual[0, :begins] += 0.3 * np.sin(2 * np.pi * 8.0 * e.signals.t[:begins])
    cells = of(where(e, residual, e.noise), "frequency")
    assert cells
    assert all("between 5 and 15 Hz" in cell.says for cell in cells)


def test_a_bias_is_the_same_at_all_times() -> None:
    e = touches()
    r = noise(e) + np.array([[0.0], [-0.1], [0.0]])
    cells = where(e, r, e.noise)
    assert (cells[0].channel, cells[0].by) == ("tangential_force1", "time")
    assert "is the same at all times: about −0.1 N" in cells[0].says
    assert of(cells, "frequency") == []
    assert {cell.channel for cell in cells} == {"tangential_force1"}


def test_an_error_faster_than_the_reading() -> None:
    e = touches()
    r = noise(e)
    r[0] += 0.1 * np.sin(2 * np.pi * 8.0 * e.signals.t)
    cells = of(where(e, r, e.noise), "frequency")
    assert ["between 5 and 15 Hz" in cell.says for cell in cells] == [True]
    assert not any("a line at" in cell.says for cell in cells)


def test_an_error_at_one_place() -> None:
    e = touches()
    r = noise(e)
    x, y = e.signals.slip
    r[0] += np.where((x > 0.019) & (y > 0.019) & (e.signals.depth > 0), 0.3, 0.0)
    cells = of(where(e, r, e.noise), "place")
    assert len(cells) == 1
    assert cells[0].channel == "normal_force"
    # the last quarter of the surface along both tangents, where slides reach 4 mm further along the first
    assert "slip 1 of 17.9 to 23.8 mm" in cells[0].says
    assert "slip 2 of 15.0 to 20.0 mm" in cells[0].says
    assert cells[0].share > 0.9


def test_an_error_that_grows_with_time() -> None:
    e = touches()
    r = noise(e)
    r[0] += np.where(e.in_contact, 0.3 * e.signals.t / e.signals.t[-1], 0.0)
    time = of(where(e, r, e.noise), "time")
    assert len(time) == 1
    assert "last third" in time[0].says
    assert "grows with time" in time[0].says
    # ∫ t² over the last third is 19/27 of the whole
    assert time[0].share == pytest.approx(19 / 27, abs=0.05)
    fading = of(where(e, r[:, ::-1], e.noise), "time")
    assert "fades with time" in fading[0].says


def test_an_error_spread_evenly_is_at_no_place_depth_or_time() -> None:
    e = touches()
    r = noise(e)
    slow = np.repeat(np.random.default_rng(3).standard_normal(round(len(e.signals) / RATE * 4)), round(RATE / 4))
    r[0] += 0.1 * slow
    assert {cell.by for cell in where(e, r, e.noise)} <= {"phase", "frequency"}


def test_damping_that_is_missing_follows_the_speed_and_friction_the_direction() -> None:
    e = touches()
    r = noise(e)
    r[0] += np.where(e.phase == "poke", 10.0 * e.signals.depth_rate, 0.0)
    r[1] += np.where(e.phase == "slide", -0.3 * np.sign(e.signals.slip_rate[0]), 0.0)
    says = {(cell.channel, cell.phase): cell.says for cell in of(where(e, r, e.noise), "phase")}
    assert "follows the speed of pressing" in says["normal_force", "poke"]
    assert "changes sign with the direction of sliding" in says["tangential_force1", "slide"]


def test_unlabelled_phases_are_named_by_the_motion() -> None:
    """At least nine of ten samples get the name that the protocol gave them."""
    e = touches()
    bare = dataclasses.replace(e, phase=None)
    view = View.of(bare, np.zeros_like(e.measured), e.noise)
    named = phases(view)
    assert all(name.endswith("(by its motion)") for name in set(named.tolist()))
    assert e.phase is not None
    same = np.array([a.startswith(b) for a, b in zip(named, e.phase[view.edge])])
    inside = e.in_contact[view.edge]
    assert same[inside].mean() > 0.9
    r = noise(e)
    r[0] += np.nan_to_num(0.5 * np.exp(-since_start(e, "hold") / 0.8))
    first = where(bare, r, e.noise)[0]
    assert first.phase == "hold (by its motion)"
    assert "decays: time constant" in first.says
    assert first.share > 0.9


def test_samples_that_do_not_count_do_not_count() -> None:
    """What is not valid, or NaN, changes nothing, however large it is beside it."""
    e = touches()
    r = noise(e)
    r[0] += np.where(e.phase == "hold", 0.2, 0.0)
    valid = e.valid.copy()
    valid[(e.signals.t > 20) & (e.signals.t < 30)] = False
    spoilt = r.copy()
    spoilt[:, ~valid] = 1e3
    one = where(dataclasses.replace(e, valid=valid), spoilt, e.noise)
    spoilt[:, ~valid] = np.nan
    two = where(dataclasses.replace(e, valid=valid), spoilt, e.noise)
    assert one == two
    assert one[0].share > 0.98
    assert one[0].phase == "hold"


def wrench(rotation: Array, tip: Array) -> Experiment:
    """The same touches seen by a sensor whose axes are turned against the contact's."""
    e = touches()
    to_contact = np.broadcast_to(rotation, (len(e.signals), 3, 3))
    nothing = np.zeros((3, len(e.signals)))
    sensor = SensorMotion(to_contact, tip, nothing, nothing, nothing, np.zeros((6, len(e.signals))), 0.0, np.zeros(3))
    measured = np.zeros((6, len(e.signals)))
    signals = dataclasses.replace(
        e.signals, layout=Layout(("fx", "fy", "fz", "tx", "ty", "tz"), "wrench"), sensor=sensor, measured=measured
    )
    return dataclasses.replace(e, signals=signals, measured=measured, noise=np.array([NOISE] * 3 + [NOISE / 30] * 3))


def test_forces_of_a_wrench_are_read_along_the_contact_and_torques_about_the_tip() -> None:
    """An error of the normal force alone shows in fx, fz and, by its lever, in ty: it is named once."""
    angle, tip = 0.6, np.array([0.0, 0.0, 0.1])
    rotation = np.array([[np.cos(angle), 0, np.sin(angle)], [0, 1, 0], [-np.sin(angle), 0, np.cos(angle)]])
    e = wrench(rotation, tip)
    force = rotation.T @ np.stack([np.zeros(len(e.signals))] * 2 + [np.where(e.phase == "hold", 0.5, 0.0)])
    r = np.concatenate([force, np.cross(tip, force.T).T])
    r += e.noise[:, None] * np.random.default_rng(2).standard_normal(r.shape)
    assert np.sqrt(np.mean(r[0] ** 2)) > 5 * NOISE
    cells = where(e, r, e.noise)
    assert (cells[0].channel, cells[0].phase, cells[0].unit) == ("normal_force", "hold", "N")
    assert cells[0].share > 0.98
    assert cells[0].rms == pytest.approx(0.5, rel=0.02)


def test_an_error_of_one_axis_of_the_sensor_is_read_there() -> None:
    angle = 0.6
    rotation = np.array([[np.cos(angle), 0, np.sin(angle)], [0, 1, 0], [-np.sin(angle), 0, np.cos(angle)]])
    e = wrench(rotation, np.zeros(3))
    r = e.noise[:, None] * np.random.default_rng(2).standard_normal((6, len(e.signals)))
    r[0] += 0.3
    cells = where(e, r, e.noise)
    assert {cell.channel for cell in cells if cell.share > 0.01} == {"fx"}


def test_joints_are_told_by_name_and_by_the_direction_of_motion() -> None:
    rng = np.random.default_rng(0)
    t = np.arange(6000) / RATE
    q = np.stack([np.sin(0.9 * t), 0.5 * np.sin(1.7 * t + 1.0)])
    dq, ddq = np.gradient(q, 1 / RATE, axis=1), np.gradient(np.gradient(q, 1 / RATE, axis=1), 1 / RATE, axis=1)
    none, pair = np.zeros(len(t)), np.zeros((2, len(t)))
    layout = Layout(("tau1", "tau2"), "joints", ("shoulder", "elbow"))
    joints = JointMotion(q, dq, ddq, np.zeros_like(q), False)
    signals = Signals(layout, t, np.diff(t, prepend=0.0), none, none, pair, pair, joints=joints)
    signals.dt[0] = 0.0
    e = Experiment(
        signals, np.zeros_like(q), np.ones(len(t), np.bool_), np.full(2, 0.05), None, none > 0, np.arange(len(t))
    )
    r = 0.05 * rng.standard_normal(q.shape)
    r[1] += np.where(dq[1] > 0, 1.0, -1.0)
    first = where(e, r, e.noise)[0]
    assert first.channel == "tau2"
    assert first.unit == "N·m"
    assert "torque of elbow" in first.says
    assert "changes sign with the direction of motion" in first.says
    one_way = where(e, 0.05 * rng.standard_normal(q.shape) + np.stack([none, np.where(dq[1] > 0, 1.0, 0.0)]), e.noise)
    assert any(cell.by == "pose" and "while it moves forwards" in cell.says for cell in one_way)


def test_single_samples_far_apart_are_no_stretch() -> None:
    """Static poses, one row each: nothing has a time constant or a frequency, and nothing breaks."""
    e = touches()
    rows = slice(0, 12000, 300)
    s = e.signals
    thin = dataclasses.replace(
        s,
        t=s.t[rows],
        dt=np.zeros(40),
        depth=s.depth[rows],
        depth_rate=np.zeros(40),
        slip=s.slip[:, rows],
        slip_rate=np.zeros((2, 40)),
        measured=e.measured[:, rows],
    )
    poses = Experiment(
        thin, e.measured[:, rows], np.ones(40, np.bool_), e.noise, None, s.depth[rows] > 0, np.arange(40)
    )
    cells = where(poses, np.where(s.depth[rows] > 0, 0.5, 0.0) * np.ones((3, 1)), e.noise)
    assert cells[0].share > 0
    assert not any(cell.by == "frequency" for cell in cells)
