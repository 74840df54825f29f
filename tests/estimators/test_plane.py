"""The plane through touches: exact without noise, honest with it, unmoved by stray touches."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from kinid.errors import InputError
from kinid.estimators.plane import PlaneEstimate, fit_plane

#: twelve touches of a 200 mm × 80 mm patch, not on a lattice
PATCH = np.array(
    [
        [-0.10, -0.04],
        [-0.04, -0.03],
        [0.03, -0.04],
        [0.10, -0.035],
        [-0.09, 0.00],
        [-0.03, 0.01],
        [0.04, 0.00],
        [0.09, 0.005],
        [-0.10, 0.04],
        [-0.05, 0.035],
        [0.05, 0.04],
        [0.10, 0.04],
    ]
)


def touches(
    rotation: Rotation, at: np.ndarray, height: np.ndarray | float = 0.0, patch: np.ndarray = PATCH
) -> np.ndarray:
    """Touches of the plane whose normal is the rotation's z axis, with errors `height` along it."""
    return at + rotation.apply(np.column_stack([patch, np.broadcast_to(height, len(patch))]))


def some(n: int) -> np.ndarray:
    """The first n touches of an order in which any few span the patch."""
    return PATCH[[0, 3, 9, 5, 8, 1, 2, 4, 6, 7, 10, 11][:n]]


def errors(fit: PlaneEstimate, at: np.ndarray, normal: np.ndarray) -> np.ndarray:
    """Offset of the true plane along the estimated normal at `fit.point`, and the true normal's two tilts."""
    offset = (at - fit.point) @ normal / (fit.normal @ normal)
    tilts = [np.cross(axis, fit.normal) @ normal for axis in fit.tilt_axes]
    return np.array([offset, *tilts])


def covered(fit: PlaneEstimate, error: np.ndarray) -> np.ndarray:
    bounds = np.vstack([fit.offset_interval, fit.tilt_interval])
    return (bounds[:, 0] <= error) & (error <= bounds[:, 1])


@pytest.mark.parametrize("n", [3, 4, 5, 6, 12])
@given(turn=st.integers(0, 10_000), at=st.tuples(*[st.floats(-2, 2)] * 3))
@settings(max_examples=15, deadline=None)
def test_recovers_a_plane_without_noise(n, turn, at):
    rotation = Rotation.random(random_state=turn)
    normal = rotation.apply([0, 0, 1])
    fit = fit_plane(touches(rotation, np.array(at), patch=some(n)), 1e-4, normal)
    # rounding of coordinates of 2 m, 4e-16 m, over a patch of 0.1 m
    assert fit.normal == pytest.approx(normal, abs=1e-13)
    assert (fit.point - at) @ normal == pytest.approx(0.0, abs=1e-14)
    assert fit.inliers.all()
    assert fit.n == n
    assert fit.rms < 1e-14


@pytest.mark.parametrize("n", [5, 6, 12])
def test_rounding_is_not_taken_for_noise(n):
    # without a sigma the residuals are rounding alone, which must not be held against each other
    for turn in range(50):
        rotation = Rotation.random(random_state=turn)
        points = touches(rotation, np.array([1.7, -0.9, 0.4]), patch=some(n))
        assert fit_plane(points, outward=rotation.apply([0, 0, 1])).inliers.all()
    # nor where most have no rounding at all
    assert fit_plane(np.column_stack([some(n), np.where(np.arange(n) == 1, 1e-17, 0.0)])).inliers.all()


@pytest.mark.parametrize(
    ("n", "known", "uneven"),
    [(5, 0, 0), (8, 0, 0), (12, 0, 0), (4, 1, 0), (12, 1, 0), (12, 1, 1)],
)
def test_intervals_hold_the_truth_as_often_as_they_say(n, known, uneven):
    draw = np.random.default_rng(20)
    hits = np.zeros(3)
    patch = some(n)
    for _ in range(500):
        rotation = Rotation.random(random_state=int(draw.integers(1 << 30)))
        at, normal = draw.uniform(-1, 1, 3), rotation.apply([0, 0, 1])
        sigma = 2e-4 * (draw.uniform(0.3, 3.0, n) if uneven else np.ones(n))
        points = touches(rotation, at, sigma * draw.normal(size=n), patch)
        fit = fit_plane(points, sigma if known else None, normal)
        hits += covered(fit, errors(fit, at, normal))
    # 500 draws of a 95 % interval: standard error 1 %
    assert hits.min() / 500 >= 0.93
    assert hits.max() / 500 <= 0.97


def test_covariance_is_that_of_the_errors():
    draw = np.random.default_rng(3)
    rotation, at = Rotation.random(random_state=1), np.array([0.5, 0.1, 0.2])
    normal = rotation.apply([0, 0, 1])
    found = []
    for _ in range(1500):
        fit = fit_plane(touches(rotation, at, 2e-4 * draw.normal(size=12)), 2e-4, normal)
        found.append(errors(fit, at, normal) / np.sqrt(np.diag(fit.covariance)))
    # correlations of 1500 draws: standard error 1/√1500 = 0.026; variances: √(2/1500) = 0.037
    assert np.cov(np.array(found).T) == pytest.approx(np.eye(3), abs=0.12)


@given(turn=st.integers(0, 10_000), shift=st.tuples(*[st.floats(-1, 1)] * 3), seed=st.integers(0, 50))
@settings(max_examples=60, deadline=None)
def test_moves_with_its_points(turn, shift, seed):
    draw = np.random.default_rng(seed)
    points = np.column_stack([PATCH, 3e-4 * draw.normal(size=12)])
    points[seed % 12, 2] += 0.02  # a stray touch
    sigma = draw.uniform(1e-4, 5e-4, 12) if seed % 2 else None
    motion = Rotation.random(random_state=turn)
    here = fit_plane(points, sigma)
    there = fit_plane(motion.apply(points) + shift, sigma, motion.apply([0, 0, 1]))
    # rounding: 1 m · 2e-16, magnified by a metre of lever over a patch of 0.1 m
    assert there.point == pytest.approx(motion.apply(here.point) + shift, abs=1e-13)
    assert there.normal == pytest.approx(motion.apply(here.normal), abs=1e-12)
    assert (there.inliers == here.inliers).all()
    assert there.covariance == pytest.approx(here.covariance, rel=1e-8, abs=1e-30)
    # an axis has no side
    along = np.abs(np.sum(there.tilt_axes * motion.apply(here.tilt_axes), axis=1))
    assert along == pytest.approx(1.0, abs=1e-9)


@pytest.mark.parametrize("sigma", [None, 2e-4])
@pytest.mark.parametrize("strays", [1, 3, 5])
def test_stray_touches_do_not_move_the_plane(strays, sigma):
    draw = np.random.default_rng(7 + strays)
    rotation, at = Rotation.random(random_state=4), np.array([0.4, -0.2, 0.3])
    normal = rotation.apply([0, 0, 1])
    height = 2e-4 * draw.normal(size=24)
    # all on one side and in one corner, where least squares gives way most
    height[:strays] += draw.uniform(5e-3, 2e-2, strays)
    patch = np.vstack([PATCH, 0.7 * PATCH[:, ::-1] * [2, 0.5]])
    points = touches(rotation, at, height, patch)
    fit = fit_plane(points, sigma, normal)
    clean = fit_plane(points[strays:], sigma, normal)
    assert not fit.inliers[:strays].any()
    assert fit.inliers[strays:].all()
    assert fit.n == 24 - strays
    assert fit.normal == pytest.approx(clean.normal, abs=1e-13)
    assert fit.covariance == pytest.approx(clean.covariance, rel=1e-9)
    assert covered(fit, errors(fit, at, normal)).all()


def test_good_touches_are_rarely_called_stray():
    draw = np.random.default_rng(11)
    lost = 0
    for _ in range(600):
        lost += not fit_plane(np.column_stack([PATCH[:10], 1e-4 * draw.normal(size=10)])).inliers.all()
    assert lost <= 18  # 1 % of 600 expected, and never beyond 3 %


@pytest.mark.parametrize(("sigma", "share"), [(None, 0.6), (1e-4, 0.95)])
def test_a_touch_ten_sigma_out_is_found(sigma, share):
    draw = np.random.default_rng(12)
    found = 0
    for i in range(200):
        height = 1e-4 * draw.normal(size=12)
        height[i % 12] += 1e-3
        fit = fit_plane(np.column_stack([PATCH, height]), sigma)
        found += not fit.inliers[i % 12]
    assert found / 200 >= share  # at a corner its own pull hides part of it


def test_three_touches_fit_any_plane_so_nothing_is_known_of_their_error():
    fit = fit_plane(np.column_stack([PATCH[[0, 3, 9]], np.zeros(3)]))
    assert fit.offset_interval == (-np.inf, np.inf)
    assert np.isinf(fit.tilt_interval).all()
    assert np.isfinite(fit_plane(np.column_stack([PATCH[[0, 3, 9]], np.zeros(3)]), 1e-4).tilt_interval).all()


def test_students_t_widens_the_interval_of_few_touches():
    height = np.array([1, -1, -1, 1]) * 1e-4  # RMS 1e-4 over four, 2e-4 with one degree of freedom
    square = np.array([[-1, -1], [1, -1], [-1, 1], [1, 1]]) * 0.05
    fit = fit_plane(np.column_stack([square, height]))
    assert fit.freedom == 1
    assert fit.rms == pytest.approx(1e-4, rel=1e-9)
    # 12.706 is Student's t of one degree of freedom at 97.5 %; the mean of four halves the noise of 2e-4 m
    assert fit.offset_interval[1] == pytest.approx(12.7062 * 1e-4, rel=1e-4)
    # four touches 50 mm off the axis: noise / √(4 · 0.05²), to second order in noise over patch
    assert fit.tilt_interval[:, 1] == pytest.approx(12.7062 * 2e-4 / 0.1, rel=1e-4)


def test_a_sigma_that_the_residuals_belie_is_not_believed():
    draw = np.random.default_rng(2)
    points = np.column_stack([PATCH, 1e-3 * draw.normal(size=12)])
    believed, belied = fit_plane(points, 1e-3), fit_plane(points, 1e-5)
    assert believed.freedom == np.inf
    assert believed.covariance[0, 0] == pytest.approx(1e-6 / 12, rel=1e-12)
    assert belied.inliers.all()
    assert belied.roughness > 50
    assert belied.freedom == 9
    assert belied.covariance == pytest.approx(fit_plane(points).covariance, rel=1e-9)


def test_a_sigma_weighs_the_touches():
    points = np.column_stack([PATCH, np.zeros(12)])
    points[:, 2] = np.where(np.arange(12) % 2, 1e-3, -1e-3)
    sigma = np.where(np.arange(12) % 2, 1e-3, 1e-1)
    # the certain touches lie at 1 mm; the others count 10⁻⁴ as much
    assert fit_plane(points, sigma).point[2] == pytest.approx(1e-3, abs=1e-6)


def test_the_hint_chooses_the_side():
    points = np.column_stack([PATCH, 1e-4 * np.random.default_rng(0).normal(size=12)])
    up, down = fit_plane(points, outward=(0.3, 0, 1)), fit_plane(points, outward=(0.3, 0, -1))
    assert up.normal[2] > 0
    assert down.normal == pytest.approx(-up.normal, abs=0)
    for fit in (up, down):
        frame = np.vstack([fit.tilt_axes, fit.normal])
        assert frame @ frame.T == pytest.approx(np.eye(3), abs=1e-12)
        assert np.linalg.det(frame) == pytest.approx(1.0)


def test_many_touches():
    draw = np.random.default_rng(0)
    points = np.column_stack([draw.uniform(-1, 1, (4000, 2)), 1e-3 * draw.normal(size=4000)])
    points[:800, 2] += draw.uniform(0.01, 0.1, 800)
    fit = fit_plane(points)
    assert not fit.inliers[:800].any()
    assert fit.inliers[800:].sum() >= 3195
    assert abs(fit.point[2]) < 5e-3 / np.sqrt(3200)


@pytest.mark.parametrize(
    ("points", "says"),
    [
        (np.zeros((0, 3)), "no touch"),
        ([[0, 0, 0.0]], "one touch"),
        ([[0, 0, 0], [1, 0, 0.0]], "two touches"),
        ([[0, 0, 0], [1, 0, 0], [0, np.nan, 0]], "touch 3"),
        (np.ones((8, 3)), "one place"),
        (np.outer(np.linspace(0, 0.1, 8), [1, 0, 0]), "on a line along (1.00, 0.00, 0.00)"),
        (np.outer(np.linspace(0, 0.1, 3), [0, 1, 1]), "tilt about it is unknown"),
    ],
)
def test_refuses_touches_that_show_no_plane(points, says):
    with pytest.raises(InputError, match="touch") as caught:
        fit_plane(points)
    assert says in caught.value.found
    assert "\n" not in str(caught.value)


def test_says_where_to_touch_next():
    draw = np.random.default_rng(1)
    line = np.linspace([0.4, 0.2, 0.1], [0.6, 0.2, 0.1], 10)
    line[:, 1:] += 1e-4 * draw.normal(size=(10, 2))
    with pytest.raises(InputError) as caught:
        fit_plane(line)
    place = np.array([float(x) for x in caught.value.mend.split("(")[1].split(")")[0].split(",")])
    assert place[[0, 2]] == pytest.approx([0.5, 0.1], abs=2e-3)
    assert abs(place[1] - 0.2) > 0.05
    # and indeed: with touches there, the plane is known
    more = np.vstack([line, place, place - np.array([0.03, 0, 1e-4])])
    assert np.abs(fit_plane(more).tilt_interval).max() < 5e-3


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        ({"sigma": 0.0}, "sigma"),
        ({"sigma": [1e-4] * 3}, "sigma"),
        ({"sigma": np.nan}, "sigma"),
        ({"outward": (0, 0, 0)}, "hint"),
        ({"outward": (1, 0, 0.01)}, "hint"),
    ],
)
def test_refuses_a_sigma_or_hint_that_says_nothing(arguments, says):
    with pytest.raises(InputError, match=says):
        fit_plane(np.column_stack([PATCH, np.zeros(12)]), **arguments)
