"""Guesses between probes: accuracy on a known surface, honest uncertainty, edges, and places that nobody knows."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import check_grad

from kinid.errors import InputError
from kinid.mapping.interpolation import METHODS, PlaneSites
from kinid.mapping.interpolation.covariance import distances, evidence
from kinid.mapping.interpolation.gaussian_process import GaussianProcess, interpolator
from kinid.mapping.interpolation.segments import belonging


def franke(p):
    """Franke's test surface (1982) on the square of 0.1 m."""
    x, y = 90 * p[:, 0], 90 * p[:, 1]
    return (
        0.75 * np.exp(-((x - 2) ** 2 + (y - 2) ** 2) / 4)
        + 0.75 * np.exp(-((x + 1) ** 2) / 49 - (y + 1) / 10)
        + 0.5 * np.exp(-((x - 7) ** 2 + (y - 3) ** 2) / 4)
        - 0.2 * np.exp(-((x - 4) ** 2) - (y - 7) ** 2)
    )


@pytest.fixture(scope="module")
def smooth():
    rng = np.random.default_rng(0)
    places = rng.uniform(0, 0.1, (600, 2))
    truth = franke(places)
    noise = np.full(600, 0.01 * np.ptp(truth))
    ticks = np.linspace(0, 0.1, 60)
    queries = np.stack(np.meshgrid(ticks, ticks, indexing="ij"), -1).reshape(-1, 2)
    return places, truth + noise * rng.standard_normal(600), noise, queries, franke(queries)


# noise of 1 % at each of 600 probes: the two smoothers average it, the nearest value can't
@pytest.mark.parametrize(("method", "limit"), [("gp", 0.010), ("biharmonic", 0.010), ("nearest", 0.04)])
def test_a_smooth_surface_comes_back(smooth, method, limit):
    places, values, noise, queries, truth = smooth
    guess = interpolator(method, PlaneSites(places), values, noise).at(queries)
    assert guess.known.mean() > 0.9
    error = np.sqrt(np.nanmean((guess.mean - truth) ** 2)) / np.ptp(truth)
    assert error < limit


def test_the_process_states_its_uncertainty_truly(smooth):
    places, values, noise, queries, truth = smooth
    process = GaussianProcess.fit(PlaneSites(places), values, noise)
    guess = process.at(queries)
    inside = np.abs(guess.mean - truth)[guess.known] < 1.96 * guess.sd[guess.known]
    # 3600 correlated answers: the share scatters by some per cent about 95 %
    assert 0.90 < inside.mean() < 0.995
    assert 0.90 < np.mean(np.abs(process.left_out) < 1.96 * process.left_out_sd) < 0.99


def test_many_queries_at_once_are_answered_as_single_ones(smooth):
    places, values, noise, queries, _ = smooth
    process = GaussianProcess.fit(PlaneSites(places), values, noise)
    many, few = process.at(queries), process.at(queries[:50])
    size = process.covariance.size
    # single precision: 1e-3 of the prior for deviations, as stated
    assert np.allclose(many.mean[:50], few.mean, atol=1e-3 * size, equal_nan=True)
    assert np.allclose(many.sd[:50], few.sd, atol=2e-3 * size, equal_nan=True)


def test_a_probe_added_is_a_probe_fitted(smooth):
    places, values, noise, queries, _ = smooth
    whole = GaussianProcess.fit(PlaneSites(places[:80]), values[:80], noise[:80])
    part = GaussianProcess._built(
        PlaneSites(places[:79]),
        values[:79],
        noise[:79],
        whole.covariance,
        whole.mean,
        np.zeros(79, dtype=np.int64),
        1.0,
    )
    grown = part.added(places[79], values[79], noise[79])
    assert np.allclose(grown.factor, whole.factor, atol=1e-10)
    assert np.allclose(grown.at(queries[::70], sd=False).mean, whole.at(queries[::70], sd=False).mean, equal_nan=True)


@pytest.mark.parametrize("kind", [0.5, 1.5, 2.5])
def test_the_evidence_has_the_derivative_that_is_used(smooth, kind):
    places, values, noise, _, _ = smooth
    distance = distances(places[:40], places[:40])
    shared = np.where(np.arange(40)[:, None] % 2 == np.arange(40) % 2, 1.0, 0.5)
    at = np.log([0.02, 0.3, 0.02])
    arguments = (kind, distance, values[:40], noise[:40] ** 2, shared)
    error = check_grad(lambda t: evidence(t, *arguments)[0], lambda t: evidence(t, *arguments)[1], at)
    assert error < 1e-4 * np.linalg.norm(evidence(at, *arguments)[1])


@pytest.mark.parametrize("method", ["gp", "biharmonic"])
def test_leaving_out_in_closed_form_is_leaving_out(smooth, method):
    places, values, noise, _, _ = smooth
    places, values, noise = places[:30], values[:30], noise[:30] if method == "gp" else None
    whole = interpolator(method, PlaneSites(places, reach=1.0), values, noise)
    i = 7
    rest = np.arange(30) != i
    sample_sites = PlaneSites(places[rest], reach=1.0)
    if method == "gp":
        other = GaussianProcess._built(
            sample_sites, values[rest], noise[rest], whole.covariance, whole.mean, np.zeros(29, dtype=np.int64), 1.0
        )
    else:
        other = interpolator(method, sample_sites, values[rest])
    alone = other.at(places[i : i + 1]).mean[0]
    assert whole.left_out[i] == pytest.approx(values[i] - alone, rel=1e-5, abs=1e-7)


def test_a_sharp_edge_stays_sharp():
    rng = np.random.default_rng(1)
    ticks = np.linspace(-0.045, 0.045, 10)
    places = np.stack(np.meshgrid(ticks, ticks, indexing="ij"), -1).reshape(-1, 2)
    values = np.where(places[:, 0] < 0, 500.0, 1000.0) * (1 + 0.005 * rng.standard_normal(100))
    process = GaussianProcess.fit(PlaneSites(places), values, 0.005 * values)
    assert process.across < 1.0
    sides = process.at(np.array([[-0.004, 0.012], [0.004, 0.012], [0.0, 0.012]]))
    # half-way between probes on each side: a smooth surface would be a quarter of the step off
    assert sides.mean[0] == pytest.approx(500, rel=0.05)
    assert sides.mean[1] == pytest.approx(1000, rel=0.05)
    assert sides.sd[2] > 5 * process.at(np.array([[-0.03, 0.012]])).sd[0]


def test_a_smooth_slope_has_no_edges():
    ticks = np.linspace(-0.045, 0.045, 9)
    places = np.stack(np.meshgrid(ticks, ticks, indexing="ij"), -1).reshape(-1, 2)
    values = 1000 + 5000 * places[:, 0] + np.random.default_rng(0).normal(scale=2.0, size=81)
    assert GaussianProcess.fit(PlaneSites(places), values, np.full(81, 2.0)).across == 1.0


@pytest.mark.parametrize("method", METHODS)
def test_empty_places_are_unknown(method):
    rng = np.random.default_rng(2)
    places = rng.uniform(0, 0.1, (200, 2))
    places = places[np.hypot(*(places - 0.05).T) > 0.03]
    guess = interpolator(method, PlaneSites(places), np.sin(30 * places[:, 0]), np.full(len(places), 0.01)).at(
        np.array([[0.05, 0.05], [0.3, 0.3], places[0]])
    )
    assert guess.known.tolist() == [False, False, True]
    assert np.isnan(guess.mean[:2]).all()
    assert np.isfinite(guess.mean[2])


def test_the_unit_of_length_does_not_matter_to_the_spline():
    rng = np.random.default_rng(3)
    places, values = rng.uniform(0, 0.1, (25, 2)), rng.normal(size=25)
    metres = interpolator("biharmonic", PlaneSites(places, reach=1.0), values).at(places[:5] + 1e-3).mean
    feet = (
        interpolator("biharmonic", PlaneSites(places / 0.3048, reach=4.0), values).at((places[:5] + 1e-3) / 0.3048).mean
    )
    assert np.allclose(metres, feet, rtol=1e-6, atol=1e-8, equal_nan=True)


def test_bad_input_is_said():
    sample_sites = PlaneSites(np.zeros((2, 2)) + [[0.0, 0], [0.01, 0]])
    with pytest.raises(InputError, match="method 'krig'"):
        interpolator("krig", sample_sites, np.ones(2))
    with pytest.raises(InputError, match="a number for each place"):
        interpolator("gp", sample_sites, np.array([1.0, np.nan]))
    with pytest.raises(InputError, match="places of shape"):
        PlaneSites(np.array([[0.0, np.nan]]))


@pytest.mark.real
def test_a_measured_phantom_is_mapped_no_worse_than_by_scikit_learn(real_data):
    """728 probes of a silicone phantom, five folds: 42.1 N/m against 42.2 N/m at a spread of 77 N/m."""
    process = pytest.importorskip("sklearn.gaussian_process")
    kernels = pytest.importorskip("sklearn.gaussian_process.kernels")
    data = np.load(real_data / "phantom-probing" / "probe_probingRAL2018_T1.npz")
    keep = np.linalg.norm(data["normal"], axis=1) > 0.5
    position, force, normal = 1e-3 * data["pos"][keep], data["force"][keep], data["normal"][keep]
    depth = -np.einsum("ijk,ik->ij", position - position[:, :1], normal)
    load = np.einsum("ijk,ik->ij", force, normal)
    away = depth - depth.mean(axis=1, keepdims=True)
    size = np.sum(away**2, axis=1)
    slope = np.sum(away * load, axis=1) / size
    left = load - load.mean(axis=1, keepdims=True) - slope[:, None] * away
    error = np.sqrt(np.sum(left**2, axis=1) / 8 / size)
    centre = 1e-3 * data["contact_ball_center"][keep]
    centre = centre - centre.mean(axis=0)
    flat = centre @ np.linalg.svd(centre, full_matrices=False)[2][:2].T
    fold = np.random.default_rng(0).permutation(len(slope)) % 5
    ours, theirs = [], []
    for k in (0, 1):
        train, test = fold != k, fold == k
        mine = GaussianProcess.fit(PlaneSites(flat[train], reach=1.0), slope[train], error[train]).at(flat[test])
        ours.append(np.where(mine.known, mine.mean, slope[train].mean()) - slope[test])
        spread = slope[train].std()
        kernel = kernels.ConstantKernel(1.0) * kernels.Matern(0.01, (1e-3, 1.0), nu=1.5) + kernels.WhiteKernel(0.1)
        peer = process.GaussianProcessRegressor(kernel, alpha=(error[train] / spread) ** 2, normalize_y=True).fit(
            flat[train], slope[train]
        )
        theirs.append(peer.predict(flat[test]) - slope[test])
    # no worse, within what two folds scatter
    assert np.sqrt(np.mean(np.concatenate(ours) ** 2)) < 1.02 * np.sqrt(np.mean(np.concatenate(theirs) ** 2))


def test_edges_of_triangles_run_along_a_border():
    """A slanted border, felt at random places: triangles that know the values smear it less than Delaunay's."""
    from scipy.interpolate import LinearNDInterpolator

    from kinid.mapping.interpolation.triangles import triangulate

    rng = np.random.default_rng(9)
    places = rng.uniform(0, 0.1, (60, 2))
    inside = rng.uniform(0.015, 0.085, (500, 2))

    def truth(q):
        return np.where(q[:, 1] > 0.02 + 0.55 * q[:, 0], 1000.0, 500.0)

    mapped = interpolator("triangles", PlaneSites(places, reach=1.0), truth(places), np.ones(60)).at(inside)
    plain = np.exp(LinearNDInterpolator(places, np.log(truth(places)))(inside))
    wrong = np.abs(mapped.mean / truth(inside) - 1)
    assert np.nanmean(wrong) < 0.85 * np.nanmean(np.abs(plain / truth(inside) - 1))
    # what it gets wrong it says: within two of its deviations, which are large at the border alone
    assert np.mean(np.abs(mapped.mean - truth(inside)) <= 2 * mapped.sd) > 0.9
    assert np.median(mapped.sd) < 50
    corners = triangulate(places, truth(places))
    a, b, c = (places[corners[:, k]] for k in range(3))
    area = 0.5 * ((b - a)[:, 0] * (c - a)[:, 1] - (b - a)[:, 1] * (c - a)[:, 0])
    from scipy.spatial import ConvexHull

    assert (area > 0).all()
    assert area.sum() == pytest.approx(ConvexHull(places).volume)


def test_triangles_meet_their_probes_and_are_exact_on_a_plane():
    rng = np.random.default_rng(10)
    places = rng.uniform(0, 0.1, (40, 2))
    values = np.exp(1 + 3 * places[:, 0] - 5 * places[:, 1])
    mapped = interpolator("triangles", PlaneSites(places, reach=1.0), values, np.full(40, 1e-6))
    assert np.allclose(mapped.at(places).mean, values)
    middle = rng.uniform(0.03, 0.07, (50, 2))
    assert np.allclose(mapped.at(middle).mean, np.exp(1 + 3 * middle[:, 0] - 5 * middle[:, 1]))
    for count in (1, 2, 3):
        few = interpolator("triangles", PlaneSites(places[:count], reach=1.0), values[:count], np.full(count, 1e-6))
        assert np.allclose(few.at(places[:count]).mean, values[:count])


def stubborn(agree: bool):
    """A grid of sure probes about 2400, in whose corner 3 × 3 say 1700 ± 450, or as much above as below."""
    ticks = 0.01 * np.arange(7)
    places = np.stack(np.meshgrid(ticks, ticks, indexing="ij"), -1).reshape(-1, 2)
    rng = np.random.default_rng(4)
    values, noise = 2400.0 + rng.normal(scale=5.0, size=49), np.full(49, 5.0)
    corner = (places >= 0.035).all(axis=1)
    sign = np.ones(9) if agree else np.array([1, -1, 1, -1, 1, -1, 1, -1, 0])
    values[corner] = 2400.0 - 700.0 * sign
    noise[corner] = 450.0
    return places, values, noise, corner


def test_where_probes_agree_against_the_surface_it_is_not_sure():
    places, values, noise, corner = stubborn(True)
    guess = GaussianProcess.fit(PlaneSites(places), values, noise).at(places)
    away = np.abs(guess.mean - values)
    assert (guess.sd[corner] >= 0.5 * away[corner]).all()
    # those who agree with the surface know their places as before
    assert (guess.sd[~corner] < 10.0).all()


def test_probes_that_agree_far_better_than_their_errors_are_believed_among_themselves():
    """Two materials, and a corner in which one wrong law was fitted each time: the surface follows its probes there,
    and says that all of them may be off."""
    ticks = np.linspace(0.0, 0.05, 6)
    places = np.stack(np.meshgrid(ticks, ticks, indexing="ij"), -1).reshape(-1, 2)
    corner = (places >= 0.035).all(axis=1)
    rng = np.random.default_rng(3)
    values = np.where(corner, 1700.0, np.where(places[:, 0] < 0.025, 1000.0, 2400.0)) + 3.0 * rng.standard_normal(36)
    noise = np.where(corner, 430.0, 3.0)
    grown = GaussianProcess.fit(PlaneSites(places), values, noise)
    guess = grown.at(places)
    assert np.allclose(guess.mean, values, atol=40.0)
    assert (guess.sd[corner] > 400.0).all()
    assert (guess.sd[~corner] < 40.0).all()
    # large errors that are each a probe's own are not believed
    alone = np.where(corner, 2400.0 + 430.0 * rng.standard_normal(36), values)
    own = GaussianProcess.fit(PlaneSites(places), alone, noise)
    assert own.shared is None
    assert np.abs(own.at(places).mean[corner] - 2400.0).max() < 200.0


def test_left_out_a_probe_is_of_the_zone_of_most_of_its_neighbours():
    places = np.array([[-1.0, 0.0], [0.0, 1.0], [0.0, -1.0], [1.0, 0.0]])
    segments, share = belonging(np.zeros((1, 2)), places, np.array([0, 0, 0, 1]), 1.0)
    assert segments.tolist() == [[0, 1]]
    assert share[0] == pytest.approx([0.75, 0.25])
    # beside one of them it is of that one's
    segments, share = belonging(np.array([[0.9, 0.0]]), places, np.array([0, 0, 0, 1]), 1.0)
    assert segments[0, 0] == 1
    assert share[0, 0] > 0.98
    segments, share = belonging(np.zeros((2, 2)), places, np.zeros(4, dtype=int), 1.0)
    assert (segments.tolist(), share.tolist()) == ([[0, 0]] * 2, [[1.0, 0.0]] * 2)


def test_errors_to_both_sides_are_chance():
    places, values, noise, corner = stubborn(False)
    process = GaussianProcess.fit(PlaneSites(places), values, noise)
    assert not process.local_bias[corner].any()
    assert (process.at(places[corner]).sd < 0.5 * 450.0).all()


def test_chance_alone_is_seldom_taken_for_disagreement(smooth):
    places, values, noise, _, _ = smooth
    process = GaussianProcess.fit(PlaneSites(places), values, noise)
    # the process takes up what neighbours share, so that fewer stay beyond two standard errors than the 5 % of white
    # noise, each of them with its neighbours
    assert np.mean(process.local_bias > 0) < 0.2
    own = np.sqrt(noise**2 + process.covariance.nugget**2)
    assert np.max(process.local_bias / own) < 2.5


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("query", [[[np.nan, 0.0]], [[np.inf, 0.0]], [[0.0, 0.0, 0.0]], [["here", "there"]]])
def test_places_that_are_none_are_refused(method, query):
    sample_sites = PlaneSites(np.random.default_rng(0).uniform(0, 0.1, (12, 2)))
    between = interpolator(method, sample_sites, np.arange(12.0) + 1.0, np.ones(12))
    with pytest.raises(InputError, match=r"along the plane's tangents \[m\]"):
        between.at(query)
    assert len(between.at(np.zeros((0, 2))).mean) == 0


def test_probes_all_at_one_place_are_their_mean_there() -> None:
    """They say nothing of distances, which a search for a length fell over."""
    values = np.random.default_rng(0).normal(500.0, 1.0, 8)
    guess = interpolator("gp", PlaneSites(np.zeros((8, 2))), values, np.full(8, 1.0)).at(np.zeros((1, 2)))
    assert guess.mean[0] == pytest.approx(values.mean(), abs=0.5)  # a standard error of eight values is 0.35
