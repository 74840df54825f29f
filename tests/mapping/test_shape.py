"""Shape and stiffness of a surface that nobody knows, from touches with a ball-ended tip."""

from __future__ import annotations

from dataclasses import fields, replace

import curved
import numpy as np
import pytest
from curved import DOWN, by_choice, by_grid, errors, made_of, together, touched

from kinid.contact.registration import felt_in_motion
from kinid.errors import InputError
from kinid.mapping.property_map import Probe, Property
from kinid.mapping.shape import Shape
from kinid.mapping.shape.exploration import next_touches
from kinid.mapping.shape.implicit import SMOOTHNESS, Hyperparameters, ImplicitSurface, Observations, _evidence
from kinid.mapping.shape.touches import Touch, Touches, touches_of_motion
from kinid.robotics.surface import Plane


def ball(count=30, radius=0.04, seed=0, stiff=lambda p: 800.0):
    """Exact touches of the upper part of a ball, at random."""
    rng = np.random.default_rng(seed)
    n = np.column_stack([rng.uniform(-0.6, 0.6, (count, 2)), np.zeros(count)])
    n[:, 2] = np.sqrt(1.0 - np.sum(n**2, axis=1))
    touches = [
        Touch(Probe(radius * a, np.array([stiff(radius * a)]), np.eye(1)), a, 1e-5, radius * a[None], a[None])
        for a in n
    ]
    return Touches((Property("stiffness", "N/m"),), tuple(touches), np.zeros((0, 3)))


def seen(count=12, seed=0):
    touches = ball(count, seed=seed)
    places, normals = touches.places, touches.normals
    return Observations(places, np.zeros(count), np.full(count, 1e-5), places[::2], normals[::2])


@pytest.mark.parametrize("kind", SMOOTHNESS)
def test_derivatives(kind):
    """Of the surface by place, and of the likelihood by what is learnt, against difference quotients."""
    plane, data, rng = Plane(np.array([0.0, 0.0, 0.03]), np.eye(3)), seen(), np.random.default_rng(1)
    made = ImplicitSurface(plane, data, Hyperparameters(kind, 0.05, 0.01, 1e-5, 0.02))
    x, h = rng.uniform(-0.03, 0.03, (5, 3)) + [0.0, 0.0, 0.03], 1e-6
    steps = h * np.eye(3)
    quotient = np.stack([(made.distance(x + e)[0] - made.distance(x - e)[0]) / (2 * h) for e in steps], axis=1)
    assert np.allclose(made.distance(x)[1], quotient, atol=1e-6)
    away, turned = data.values + plane.locate(data.places).depth, data.normals - plane.normal
    logs = np.log([0.05, 0.01, 1e-4, 0.02])
    slope = _evidence(logs, kind, data, away, turned)[1]
    for k, e in enumerate(1e-4 * np.eye(4)):
        ends = [_evidence(logs + sign * e, kind, data, away, turned)[0] for sign in (1, -1)]
        assert slope[k] == pytest.approx((ends[0] - ends[1]) / 2e-4, rel=2e-3, abs=1e-3)


def test_a_ball_comes_back_with_its_normals():
    shape = Shape.fit(ball())
    q = np.random.default_rng(2).uniform(-0.015, 0.015, (200, 2))
    located = shape.at(q)
    assert np.allclose(np.linalg.norm(located.points, axis=1), 0.04, atol=5e-5)
    assert np.allclose(located.normals, located.points / 0.04, atol=0.02)
    # less sure beyond the touches than between them, and nowhere surer than onsets together
    assert shape.at([[0.04, 0.0]]).sd[0] > 2.0 * np.median(located.sd)
    assert located.sd.min() >= shape.common
    assert np.abs(shape.left_out).max() < 1e-3


def test_a_touch_that_is_left_out_counts_for_nothing():
    """In closed form what learning from the others alone would say, with the same hyperparameters."""
    whole = Shape.fit(ball(10))
    others = Touches(whole.touches.properties, whole.touches.touches[1:], whole.touches.air)
    first = whole.touches.touches[0]
    data = replace(
        whole.implicit.seen,
        places=others.places,
        values=np.zeros(9),
        sd=whole.implicit.seen.sd[1:],
        turned=others.places,
        normals=others.normals,
    )
    left = ImplicitSurface(whole.plane, data, whole.implicit.learnt)
    # f at the place, which is 0
    assert whole.left_out[0] == pytest.approx(-left.distance(first.probe.place[None])[0][0], rel=1e-3, abs=1e-8)


def test_places_in_the_air_are_left_free():
    """Touches around a dent that the tip went down into without touching."""
    angle = np.linspace(0.0, 2.0 * np.pi, 9)[:-1]
    ring = 0.02 * np.column_stack([np.cos(angle), np.sin(angle), np.zeros(8)])
    data = Observations(ring, np.zeros(8), np.full(8, 1e-5), ring, np.tile([0.0, 0.0, 1.0], (8, 1)))
    plane = Plane(np.zeros(3), np.eye(3))
    made = ImplicitSurface(plane, data, Hyperparameters(2.5, 0.01, 1e-3, 1e-5, 0.02))
    dip = np.column_stack([np.zeros((6, 2)), np.linspace(5e-3, -5e-3, 6)])
    assert made.distance(dip)[0][-1] < -4e-3
    free = made.outside(dip, clear=1e-3)
    assert free.distance(dip)[0].min() > 0.9e-3
    assert np.abs(free.distance(ring)[0]).max() < 1e-4
    assert len(free.seen.places) < 8 + len(dip)
    assert made.outside(dip[:1], clear=1e-3) is made


def test_the_next_touch_halves_a_border_and_fills_a_hole():
    stepped = Shape.fit(ball(40, stiff=lambda p: 800.0 if p[0] < 0.0 else 1600.0))
    places = np.array([each.place for each in next_touches(stepped, "stiffness", 3)])
    assert np.abs(places[:, 0]).max() < 6e-3
    assert np.linalg.norm(places[:, None] - places, axis=2)[np.triu_indices(3, 1)].min() > 2e-3
    even = ball(60)
    hole = np.linalg.norm(even.places[:, :2] - [0.008, 0.0], axis=1) < 0.012
    holed = Shape.fit(replace(even, touches=tuple(t for t, out in zip(even.touches, hole) if not out)))
    (chosen,) = next_touches(holed, "stiffness")
    assert np.linalg.norm(chosen.place[:2] - [0.008, 0.0]) < 0.012
    assert chosen.direction @ chosen.place / 0.04 == pytest.approx(-1.0, abs=0.01)
    with pytest.raises(InputError, match="property 'colour'"):
        next_touches(holed, "colour")


def test_what_is_no_surface_is_refused():
    whole = ball(20)

    def some(*touches):
        return replace(whole, touches=touches)

    with pytest.raises(InputError, match="3 touches"):
        Shape.fit(some(*whole.touches[:3]))
    turned = replace(whole.touches[0], normal=np.array([0.0, 0.0, -1.0]))
    with pytest.raises(InputError, match="from one side"):
        Shape.fit(some(turned, *whole.touches[1:]))
    line = [
        replace(t, probe=replace(t.probe, place=np.array([1e-3 * i, 0.0, 0.0]))) for i, t in enumerate(whole.touches)
    ]
    with pytest.raises(InputError, match="in one line"):
        Shape.fit(some(*line))
    with pytest.raises(InputError, match="the same properties"):
        whole.with_more(replace(whole, properties=(Property("exponent", "1"),)))


@pytest.mark.parametrize("friction", [0.0, 0.6])
def test_a_touch_on_a_slope(friction):
    """The ball's radius and friction are corrected for: where it touched, the normal there, and the stiffness."""
    rng = np.random.default_rng(7)
    phantom = curved.saddle(rng, friction)
    places = phantom.points(np.array([[0.02, 0.015], [-0.025, 0.0], [0.0, -0.02]]))
    for place in places:
        (touch,) = touched(phantom, place, DOWN, rng).touches
        distance, normal, q = phantom.closest(touch.probe.place[None])
        assert np.rad2deg(np.arccos(normal[0] @ -DOWN)) > 20.0
        assert abs(distance[0]) < 1e-4
        assert touch.normals[0] @ phantom.closest(touch.along[:1])[1][0] > np.cos(np.deg2rad(1.5))
        assert touch.probe.values[0] == pytest.approx(phantom.stiffness(q)[0], rel=0.06)
        motion, axis = phantom.press(place, DOWN, rng)
        (blunt,) = touches_of_motion(motion, felt_in_motion(motion), axis, curved.MODEL, 0.0, "touch").touches
        assert phantom.closest(blunt.probe.place[None])[0][0] > 2e-4


@pytest.mark.parametrize("name", curved.PHANTOMS)
def test_slides_tell_normals_whatever_the_friction(name):
    """Five touches, and five that slide on for some 25 mm: the same places, and the shape between them."""
    rng = np.random.default_rng(302)
    phantom = curved.PHANTOMS[name](rng, 0.5)
    start = np.array([[-0.6, -0.5], [0.6, -0.5], [-0.6, 0.5], [0.6, 0.5], [0.0, 0.0]]) * phantom.half
    ends = np.array([[-0.1, -0.7], [0.7, 0.1], [-0.7, -0.1], [0.1, 0.7], [0.3, 0.3]]) * phantom.half
    alone = together([touched(phantom, place, DOWN, rng) for place in phantom.points(start)])
    slid = together([made_of(*phantom.motion(phantom.slide(*way), DOWN, rng)) for way in zip(start, ends)])
    for touch in slid.touches:
        true = phantom.closest(touch.along)[1]
        assert len(true) > 4
        assert np.einsum("ni,ni->n", true, touch.normals).min() > np.cos(np.deg2rad(3.0))
        q = phantom.closest(touch.probe.place[None])[2]
        assert touch.probe.values[0] == pytest.approx(phantom.stiffness(q)[0], rel=0.06)
    found = errors(phantom, Shape.fit(slid)).shape
    assert found < 1.5e-4
    assert found < 0.7 * errors(phantom, Shape.fit(alone)).shape


def test_a_law_that_shifts_all_onsets_stays_within_the_interval():
    """Force that goes with the power 3/2 of depth is felt late everywhere: the surface seems to lie deeper."""

    class Round(curved.Phantom):
        def pushed(self, centre):
            force, depth = super().pushed(centre)
            return force * np.sqrt(np.maximum(depth, 0.0) / 2e-3)[:, None], depth

    rng = np.random.default_rng(301)
    plain = curved.saddle(rng, 0.3)
    phantom = Round(**{field.name: getattr(plain, field.name) for field in fields(plain)})
    found = errors(phantom, Shape.fit(by_grid(phantom, 16, rng)))
    assert 5e-5 < found.shape < 3e-4
    assert found.within > 0.9


@pytest.mark.parametrize("name", curved.PHANTOMS)
def test_a_few_touches_are_enough(name):
    """A small version of the study below, without its grid."""
    rng = np.random.default_rng(300)
    phantom = curved.PHANTOMS[name](rng, 0.3)
    found = errors(phantom, by_choice(phantom, 24, rng, learn_every=12))
    assert found.shape < 1e-4
    assert found.within > 0.8
    assert found.stiffness < 0.06


@pytest.mark.slow
@pytest.mark.parametrize("friction", [0.0, 0.5])
@pytest.mark.parametrize("name", curved.PHANTOMS)
def test_sixty_touches_against_a_grid_of_a_hundred(name, friction):
    """Eggs and saddles by lot, half of each twice as stiff: shape within 0.3 mm rms, stiffness within 6 %."""
    chosen, grid = [], []
    for seed in range(400, 405):
        rng = np.random.default_rng(seed)
        phantom = curved.PHANTOMS[name](rng, friction)
        chosen.append(errors(phantom, by_choice(phantom, 60, rng)))
        grid.append(errors(phantom, Shape.fit(by_grid(phantom, 100, rng))))
    for what, them in (("60 chosen", chosen), ("grid of 100", grid)):
        shape, within, mean, rms = (
            np.array([getattr(each, field) for each in them])
            for field in ("shape", "within", "stiffness", "stiffness_rms")
        )
        print(
            f"{name}, friction {friction}, {what}: shape {1e3 * shape.mean():.3f} mm rms "
            f"({1e3 * shape.max():.3f} at most), "
            f"{100 * within.mean():.0f} % of it within the stated 95 % ({100 * within.min():.0f} at least); stiffness "
            f"{100 * mean.mean():.1f} % ({100 * mean.max():.1f} at most), {100 * rms.mean():.1f} % rms"
        )
    assert max(each.shape for each in chosen) < 3e-4
    assert max(each.stiffness for each in chosen) < 0.06
    assert np.mean([each.stiffness for each in chosen]) < np.mean([each.stiffness for each in grid])
