"""Logs that hold contact quantities themselves, as a material tester's do, and the flag that says where there is
contact.
"""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from kinid.contact.series import ContactSeries, contact_series
from kinid.contact.touching import force_noise
from kinid.contact.touching import touches as touched
from kinid.data.log import Log
from kinid.data.rig import Rig
from kinid.errors import InputError

Array = NDArray[np.float64]


def test_a_material_tester() -> None:
    t = np.arange(2000) / 500
    depth = 2e-3 * np.sin(2 * t)
    force = np.maximum(0, 800 * depth)
    touch = contact_series(Log(t, contact={"depth": depth, "normal_force": force}), Rig())
    np.testing.assert_allclose(touch.depth, depth, atol=1e-9 * depth.max())  # smoothed, of noise-free positions
    np.testing.assert_array_equal(touch.normal_force, force)
    # slow against the bandwidth of 25 Hz; the ends see one side only
    np.testing.assert_allclose(touch.depth_rate, 4e-3 * np.cos(2 * t), atol=1e-6)
    assert np.isnan(touch.slip1).all()
    assert np.isnan(touch.tangential_force2).all()
    assert touch.valid.all()
    # to the noise of 1 nN at least that the flag assumes
    np.testing.assert_array_equal(touch.in_contact[1:], (force > 1e-8)[1:])
    made = next(step for step in touch.provenance.steps if step.name == "smooth")
    assert made.facts["quantity"] == "depth"
    own = contact_series(Log(t, contact={"depth": depth, "depth_rate": t, "normal_force": force}), Rig())
    # a rate that contradicts the depth isn't believed
    np.testing.assert_allclose(own.depth_rate, 4e-3 * np.cos(2 * t), atol=1e-5)


def test_a_hole_in_a_testers_log() -> None:
    t = np.arange(500) / 500
    depth = 1e-3 * np.sin(3 * t)
    depth[100] = np.nan
    touch = contact_series(Log(t, contact={"depth": depth, "normal_force": np.ones(500)}), Rig())
    assert list(np.flatnonzero(~touch.valid)) == [100]
    others = touch.valid
    np.testing.assert_allclose(touch.depth_rate[others], 3e-3 * np.cos(3 * t[others]), atol=1e-6)


def test_a_log_with_neither_joints_nor_depth() -> None:
    log = Log(np.arange(5.0), contact={"normal_force": np.ones(5)})
    with pytest.raises(InputError, match="neither joints nor depth"):
        contact_series(log, Rig())


# The contact flag


def ramp(noise: float, seconds: float, seed: int, rate: float = 1000.0) -> tuple[Log, Array]:
    """Slow press and release of a soft block, in a tester's log; and the true force."""
    t = np.arange(int(3 * seconds * rate)) / rate
    force = np.interp(t, [seconds, 1.5 * seconds, 2 * seconds], [0, 1, 0]) * 20 * noise
    measured = force + noise * np.random.default_rng(seed).normal(size=len(t))
    return Log(
        t,
        contact={
            "depth": np.interp(t, [0, 1.5 * seconds, 3 * seconds], [-4e-3, 4e-3, -4e-3]),
            "normal_force": measured,
        },
    ), force


def touches(touch: ContactSeries) -> int:
    return int((np.diff(touch.in_contact.astype(int), prepend=0) == 1).sum())


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("seconds", [0.05, 0.5, 5.0])
def test_the_flag_does_not_chatter(seed: int, seconds: float) -> None:
    """One touch is one touch, however slowly the force rises through the noise."""
    log, force = ramp(0.03, seconds, seed)
    touch = contact_series(log, Rig())
    assert touches(touch) == 1
    # pressed firmly: touching; nothing there: not
    assert touch.in_contact[force > 8 * 0.03].all()
    on = np.flatnonzero(touch.in_contact)
    near = np.flatnonzero(force > 0)
    assert on[0] >= near[0] - 30
    assert on[-1] <= near[-1] + 30


def test_the_flag_stays_off_in_noise() -> None:
    rng = np.random.default_rng(7)
    log = Log(
        np.arange(200_000) / 1000,
        contact={"depth": np.zeros(200_000), "normal_force": rng.normal(size=200_000)},
    )
    assert touches(contact_series(log, Rig())) == 0


def test_the_flag_stays_off_where_the_tool_is_not_quite_known() -> None:
    """Slow errors and filtered noise in free motion are larger than the white noise between samples."""
    rng = np.random.default_rng(10)
    t = np.arange(20_000) / 1000
    error = 0.2 * np.sin(3 * t) + np.convolve(rng.normal(size=len(t)), np.ones(20) / 20, "same")
    depth = np.interp(t, [0, 12, 14, 18], [-0.05, -0.05, 2e-3, 2e-3])
    force = error + np.where(depth > 0, 5000 * depth, 0)
    touch = contact_series(Log(t, contact={"depth": depth, "normal_force": force}), Rig())
    assert touches(touch) == 1
    assert not touch.in_contact[depth < -1e-3].any()
    assert touch.in_contact[force > 6].all()


def test_the_edges_of_a_sudden_contact_are_sharp() -> None:
    """The mean that keeps noise out doesn't smear them."""
    force = 0.03 * np.random.default_rng(11).normal(size=1000)
    force[300:500] += 10
    force[505:700] += 10  # a bounce of 5 ms
    touch = contact_series(Log(np.arange(1000) / 1000, contact={"depth": np.zeros(1000), "normal_force": force}), Rig())
    runs = np.flatnonzero(np.diff(touch.in_contact.astype(int)))
    assert runs[0] + 1 == 300
    assert runs[-1] + 1 == 700


def test_the_flag_needs_the_surface_near() -> None:
    """A force in the air, far from the surface, is not the surface's."""
    t = np.arange(100) / 100
    for depth, expected in ((-6e-3, False), (-4e-3, True), (1e-3, True)):
        log = Log(t, contact={"depth": np.full(100, depth), "normal_force": np.full(100, 5.0)})
        assert contact_series(log, Rig()).in_contact.all() == expected


def test_the_flag_starts_anew_after_a_hole() -> None:
    force = np.full(100, 5.0)
    force[40:50] = np.nan
    touch = contact_series(Log(np.arange(100) / 100, contact={"depth": np.zeros(100), "normal_force": force}), Rig())
    assert touch.in_contact[:40].all()
    assert not touch.in_contact[40:50].any()
    assert touch.in_contact[50:].all()


def test_force_noise_sees_noise_and_not_motion() -> None:
    rng = np.random.default_rng(8)
    t = np.arange(20_000) / 1000
    slow = 10 * np.sin(6 * t)
    slow[5000:5010] += 50  # an impact
    for level in (1e-3, 0.05, 1.0):
        # median of 2e4 correlated values: 2 %
        assert force_noise(slow + level * rng.normal(size=len(t))) == pytest.approx(level, rel=0.05)
    assert force_noise(np.zeros(100)) == 1e-9
    assert force_noise(np.zeros(3)) == 1e-9


def test_a_touch_that_is_interrupted_for_a_moment_is_one() -> None:
    """What is counted is what is shaded: 20 ms without force, or a sample that is lost, end no touch; 0.2 s do."""
    t = np.arange(1000) / 500
    flag = (t > 0.2) & (t < 1.8)
    flag[(t > 0.5) & (t < 0.52)] = False
    flag[(t > 1.0) & (t < 1.2)] = False
    valid = np.ones(1000, np.bool_)
    valid[700], flag[700] = False, False
    found = touched(t, flag, valid)
    np.testing.assert_allclose([(t[a], t[b - 1]) for a, b in found], [(0.202, 1.0), (1.2, 1.798)], atol=2e-3)
    assert touched(t, np.zeros(1000, np.bool_), valid) == []
