"""Campaigns: which places, and in which order."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from kinid.errors import InputError
from kinid.planning.signals import Multisine
from kinid.planning.touches import Poke, Slide, four_paths, grid, shortest_tour, tour_length, within


def test_grid_is_centred_and_evenly_spaced() -> None:
    places = np.array(grid(4, 3, 0.01, (0.1, -0.2)))
    assert places.shape == (12, 2)
    np.testing.assert_allclose(places.mean(axis=0), (0.1, -0.2), atol=1e-15)
    np.testing.assert_allclose(np.unique(np.round(np.diff(np.unique(places[:, 0])), 12)), 0.01)


def test_a_concave_polygon_holds_the_places_that_it_should() -> None:
    ell = [(0.0, 0.0), (0.04, 0.0), (0.04, 0.01), (0.01, 0.01), (0.01, 0.04), (0.0, 0.04)]
    found = {(round(x, 6), round(y, 6)) for x, y in within(ell, 0.01)}
    wanted = {(x, y) for x, y in itertools.product((0.0, 0.01, 0.02, 0.03, 0.04), repeat=2) if x <= 0.01 or y <= 0.01}
    assert found == wanted
    with pytest.raises(InputError, match="holds no place"):
        within(ell, 0.05)  # the one place is the middle of the square that the L is cut from


@pytest.mark.parametrize("n", [5, 8])
def test_short_tours_are_near_the_shortest(n: int) -> None:
    rng = np.random.default_rng(n)
    for _ in range(5):
        places = [tuple(p) for p in rng.uniform(0, 1, (n, 2))]
        order = shortest_tour(places)
        assert sorted(order) == list(range(n))
        assert order[0] == 0
        best = min(tour_length(places, (0, *rest)) for rest in itertools.permutations(range(1, n)))
        # 2-opt's tours are within 5 % of the optimum on average (Johnson & McGeoch 1997); for so few places nearly
        # always
        assert tour_length(places, order) <= 1.1 * best


def test_a_grid_is_toured_almost_without_detour() -> None:
    places = grid(10, 10, 0.01)
    length = tour_length(places, shortest_tour(places))
    assert length <= 1.1 * 100 * 0.01  # an even grid has a tour of 100 steps
    assert length < 0.6 * tour_length(places, range(100))


def test_four_paths_cross_in_their_middle() -> None:
    paths = four_paths(0.02, (0.01, 0.0))
    assert len(paths) == 4
    ends = np.array([path.corners for path in paths])
    np.testing.assert_allclose(ends.mean(axis=1), np.tile((0.01, 0.0), (4, 1)), atol=1e-15)
    np.testing.assert_allclose(np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1), 0.02)


@pytest.mark.parametrize(
    "make",
    [
        lambda: Poke((0.0,)),
        lambda: Poke((0.0, float("nan"))),
        lambda: Poke(hold=-1.0),
        lambda: Slide(((0.0, 0.0),)),
        lambda: Poke(signal=Multisine(-0.001)),
        lambda: Poke(signal=Multisine(0.0, ((0.001, 1.0),))),
        lambda: Slide(((0.0, 0.0), (0.0, 0.0))),
        lambda: Slide(((0.0, 0.0), (0.01, 0.0)), speed=0.0),
        lambda: grid(0, 3, 0.01),
        lambda: grid(3, 3, -0.01),
        lambda: within([(0, 0), (1, 1)], 0.1),
        lambda: within([(0, 0), (9, 0), (0, 9)], 0.001),
    ],
)
def test_nonsense_is_refused(make: object) -> None:
    with pytest.raises(InputError):
        make()  # type: ignore[operator]


@pytest.mark.parametrize(("rows", "columns", "spacing"), [(0, 0, 0.01), (0, 3, 0.01), (3, 3, 0.0), (3, 3, np.nan)])
def test_no_limit_is_raised_where_none_is_in_the_way(rows: int, columns: int, spacing: float) -> None:
    with pytest.raises(InputError) as refused:
        grid(rows, columns, spacing)
    assert "LIMIT" not in refused.value.mend
