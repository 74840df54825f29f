"""What estimators are given inside the loop: each sample a little later, with the motion that both its sides show."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest
from scripted import RIG

from kinid.contact.online import OnlineContact
from kinid.data.rig import CONTACT, Rig

Array = np.ndarray
START = np.deg2rad([0.0, -40.0, 0.0, 85.0, 0.0, -55.0, 0.0])
#: samples on each side of an instant, by their rate [Hz]
HALF = {100.0: 2, 250.0: 4, 500.0: 8, 1000.0: 8, 2000.0: 16, 4000.0: 24}


@pytest.fixture(scope="module")
def rig() -> Rig:
    return Rig.parse_text(RIG + "bias = [0.1, -0.2, 0.3, 0.0, 0.01, 0.0]\n")


def cubic(t: Array, rng: np.random.Generator) -> tuple[Array, Array, Array]:
    """Joints on cubics of time, with both derivatives, (n, 7) each."""
    a, b, c = rng.normal(scale=(0.02, 0.1, 0.3), size=(7, 3)).T
    u = t[:, None] - t.mean()
    return START + a * u + b * u**2 + c * u**3, a + 2 * b * u + 3 * c * u**2, 2 * b + 6 * c * u


def stamps(rate: float, n: int, rng: np.random.Generator) -> Array:
    return (np.arange(n) + rng.uniform(-0.3, 0.3, n)) / rate


def given(contact: OnlineContact) -> Iterator[tuple[float | None, Array]]:
    """What is ready, with its time."""
    while contact.next_delayed():
        yield contact.delayed_time, contact.delayed.copy()


def passed(contact: OnlineContact, t: Array, q: Array, wrench: Array, dq: Array | None = None) -> list[tuple[Any, ...]]:
    """Time and quantities of each delayed sample, and when it came."""
    out = []
    for k in range(len(t)):
        contact.step(float(t[k]), q[k], wrench[k], None if dq is None else dq[k])
        out += [(at, x, float(t[k])) for at, x in given(contact)]
    return out


def exact(rig: Rig, t: Array, q: Array, wrench: Array, dq: Array, ddq: Array) -> Array:
    contact = OnlineContact(rig)
    return np.array([contact.step(float(t[k]), q[k], wrench[k], dq[k], ddq[k]).copy() for k in range(len(t))])


@pytest.mark.parametrize("rate", HALF)
def test_motion_on_cubics_comes_without_any_error(rig: Rig, rate: float) -> None:
    rng = np.random.default_rng(3)
    t = stamps(rate, 300, rng)
    q, dq, ddq = cubic(t, rng)
    wrench = rng.normal(size=(len(t), 6))
    found = passed(OnlineContact(rig), t, q, wrench)
    rows = np.searchsorted(t, [at for at, _, _ in found])
    # each once, in order, but for those at both ends
    np.testing.assert_array_equal(rows, np.arange(rows[0], rows[-1] + 1))
    assert abs(rows[0] - HALF[rate]) <= 1
    assert abs(len(t) - 1 - rows[-1] - HALF[rate]) <= 1
    truth = exact(rig, t, q, wrench, dq, ddq)[rows]
    # a second derivative of positions of a radian over 8 ms: 1e-16/(0.008²) are 1e-12 rad/s² and some more where
    # samples are few
    np.testing.assert_allclose([x for _, x, _ in found], truth, atol=1e-8)


@pytest.mark.parametrize("rate", HALF)
def test_nothing_waits_longer_than_the_window(rig: Rig, rate: float) -> None:
    rng = np.random.default_rng(4)
    t = stamps(rate, 300, rng)
    found = passed(OnlineContact(rig), t, cubic(t, rng)[0], np.zeros((len(t), 6)))
    waited = np.array([now - at for at, _, now in found])
    assert np.abs(waited * rate - HALF[rate]).max() <= 1.6  # stamps shake by 0.3 of a sample, and may need one more
    assert np.median(waited) == pytest.approx(HALF[rate] / rate, abs=0.6 / rate)


def test_no_polynomial_goes_over_a_gap(rig: Rig) -> None:
    """Two pieces of other cubics, and at 60 ms and 1.6 s nothing but a lost sample each."""
    rng = np.random.default_rng(5)
    t = np.concatenate([stamps(1000.0, 200, rng), 0.25 + stamps(1000.0, 200, rng)])
    wrench = rng.normal(size=(len(t), 6))
    parts = [cubic(t[:200], rng), cubic(t[200:], rng)]
    q, dq, ddq = (np.concatenate([one, other]) for one, other in zip(*parts))
    kept = np.delete(np.arange(len(t)), [60, 360])
    found = passed(OnlineContact(rig), t[kept], q[kept], wrench[kept])
    rows = np.searchsorted(t, [at for at, _, _ in found])
    assert {60, 360} & set(rows) == set()
    for low in (0, 200):
        inside = rows[(rows >= low) & (rows < low + 200)]
        assert low + 7 <= inside[0] <= low + 9
        assert low + 190 <= inside[-1] <= low + 192
    np.testing.assert_allclose([x for _, x, _ in found], exact(rig, t, q, wrench, dq, ddq)[rows], atol=1e-8)


def test_a_new_log_begins_with_an_empty_window(rig: Rig) -> None:
    rng = np.random.default_rng(6)
    t = np.arange(60) / 1000.0
    contact = OnlineContact(rig)
    first = passed(contact, t, cubic(t, rng)[0], np.zeros((60, 6)))
    contact.reset()
    q, dq, ddq = cubic(t, rng)
    again = passed(contact, t, q, np.zeros((60, 6)))  # time starts anew
    assert [at for at, _, _ in again] == [at for at, _, _ in first] == t[8:52].tolist()
    np.testing.assert_allclose([x for _, x, _ in again], exact(rig, t, q, np.zeros((60, 6)), dq, ddq)[8:52], atol=1e-8)


def test_velocities_that_are_given_are_used(rig: Rig) -> None:
    """Those of the log differ from the slope of its positions: which they are shows in the depth's rate."""
    rng = np.random.default_rng(7)
    t = stamps(1000.0, 100, rng)
    q, dq, ddq = cubic(t, rng)
    found = passed(OnlineContact(rig), t, q, np.zeros((100, 6)), 1.5 * dq)
    rows = np.searchsorted(t, [at for at, _, _ in found])
    assert len(rows) > 70
    truth = exact(rig, t, q, np.zeros((100, 6)), 1.5 * dq, 1.5 * ddq)[rows]
    np.testing.assert_allclose([x for _, x, _ in found], truth, atol=1e-8)


def test_what_needs_no_window_comes_at_once(rig: Rig) -> None:
    rng = np.random.default_rng(8)
    t = np.arange(30) / 1000.0
    q, dq, ddq = cubic(t, rng)
    contact = OnlineContact(rig)
    for k in range(30):
        quantities = contact.step(float(t[k]), q[k], np.ones(6), dq[k], ddq[k])
        ((at, delayed),) = given(contact)
        assert at == t[k]
        np.testing.assert_array_equal(delayed, quantities)


def test_what_is_not_finite_is_told_at_once_and_left_out(rig: Rig) -> None:
    rng = np.random.default_rng(9)
    t = np.arange(100) / 1000.0
    q, dq, ddq = cubic(t, rng)
    wrench = rng.normal(size=(100, 6))
    broken_q, broken_wrench = q.copy(), wrench.copy()
    broken_q[40], broken_wrench[60] = np.nan, np.nan
    found = passed(OnlineContact(rig), t, broken_q, broken_wrench)
    told = [now for at, _, now in found if at is None]
    assert told == [t[40], t[60]]
    left = [(at, x) for at, x, _ in found if at is not None]
    rows = np.searchsorted(t, [at for at, _ in left])
    np.testing.assert_array_equal(rows, np.delete(np.arange(8, 92), [32, 52]))
    np.testing.assert_allclose([x for _, x in left], exact(rig, t, q, wrench, dq, ddq)[rows], atol=1e-8)


def test_what_nobody_asks_for_is_dropped(rig: Rig) -> None:
    rng = np.random.default_rng(10)
    t = np.arange(1000) / 1000.0
    q, dq, ddq = cubic(t, rng)
    contact = OnlineContact(rig)
    for k in range(1000):
        contact.step(float(t[k]), q[k], np.zeros(6))
    found = list(given(contact))
    rows = np.searchsorted(t, [at for at, _ in found])  # type: ignore[type-var]
    np.testing.assert_array_equal(rows, np.arange(rows[0], 992))
    assert rows[0] > 800
    np.testing.assert_allclose([x for _, x in found], exact(rig, t, q, np.zeros((1000, 6)), dq, ddq)[rows], atol=1e-8)


def test_velocities_are_those_of_both_sides(rig: Rig) -> None:
    """Joint 2 swings at 5 Hz and its encoder has steps: neither lag nor much noise, where low-passes have both."""
    t = np.arange(2000) / 1000.0
    q, dq, ddq = np.tile(START, (len(t), 1)), np.zeros((len(t), 7)), np.zeros((len(t), 7))
    omega = 2 * np.pi * 5.0
    q[:, 1] += 0.01 * np.sin(omega * t)
    dq[:, 1], ddq[:, 1] = 0.01 * omega * np.cos(omega * t), -0.01 * omega**2 * np.sin(omega * t)
    none = np.zeros((len(t), 6))
    truth = exact(rig, t, q, none, dq, ddq)
    contact, late, now = OnlineContact(rig), {}, []
    for k in range(len(t)):
        now.append(contact.step(float(t[k]), np.round(q[k] / 2e-6) * 2e-6, none[k]).copy())
        late |= dict(given(contact))
    rows = np.searchsorted(t, list(late))[500:]
    for name in ("depth_rate", "normal_force"):
        j = CONTACT.index(name)
        size = np.std(truth[rows, j])
        behind = np.std(np.array(now)[rows, j] - truth[rows, j]) / size
        here = np.std(np.array(list(late.values()))[500:, j] - truth[rows, j]) / size
        print(f"{name} at 5 Hz: wrong by {100 * behind:.2f} % of the present sample, {100 * here:.2f} % of the delayed")
        assert here < 0.2 * behind
