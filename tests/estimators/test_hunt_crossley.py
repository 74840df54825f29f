"""The source study's simulation, recovery, validity conditions, restitution, separation, bad input."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from scipy.integrate import solve_ivp

from kinid.errors import InputError
from kinid.estimators import (
    Constant,
    HuntCrossleyKalman,
    KelvinVoigt,
    Prior,
    Scheduled,
    SingleStage,
    Status,
    TwoStage,
    restitution,
)
from kinid.estimators.hunt_crossley import force
from kinid.estimators.kelvin_voigt import force as kelvin_voigt

T = np.arange(0.0, 2.0, 1e-3)
EXPONENT = 1.2


def study(t=T):
    """Depth [m], rate [m/s], K and B of the source study."""
    slow, fast = 2 * np.pi * 2.0, 2 * np.pi * 5.0
    depth = 0.012 * np.sin(slow * t) + 0.003 * np.sin(fast * t) + 0.021
    rate = 0.012 * slow * np.cos(slow * t) + 0.003 * fast * np.cos(fast * t)
    return depth, rate, 100.0 + 10.0 * t, 10.0 + t


def noisy(clean, ratio, seed):
    """Force with noise at a ratio of rms amplitudes: 100 is 40 dB, √40 is a power ratio of 40."""
    sigma = np.sqrt(np.mean(clean**2)) / ratio
    return clean + sigma * np.random.default_rng(seed).normal(size=clean.shape), sigma


def settled(error, tolerance):
    """Time after which `error` stays within `tolerance` [s]; inf if it never does."""
    bad = np.flatnonzero(~(error <= tolerance))
    return 0.0 if not len(bad) else T[bad[-1] + 1] if bad[-1] + 1 < len(T) else math.inf


def rms(values):
    return float(np.sqrt(np.mean(np.square(values))))


READINGS = {"40 dB": 100.0, "amplitude ratio 40": 40.0, "power ratio 40": math.sqrt(40.0)}


def test_study_kelvin_voigt_converges_within_a_tenth_of_a_second():
    """β = 0.98. Converged: stiffness and damping within 5 % of the (drifting) truth, and no longer leaving it."""
    x, v, k, b = study()
    clean = kelvin_voigt(x, v, k, b)
    slowest, typical = {}, {}
    for name, ratio in READINGS.items():
        times = []
        for seed in range(20):
            y, _ = noisy(clean, ratio, seed)
            track = KelvinVoigt(Constant(0.98)).run(x, v, y)
            error = np.maximum(np.abs(track["stiffness"] / k - 1.0), np.abs(track["damping"] / b - 1.0))
            off = np.abs(kelvin_voigt(x, v, track["stiffness"], track["damping"]) - clean) / rms(clean)
            times.append((settled(error, 0.05), settled(off, 0.05), rms(error[100:])))
        median, worst = np.median(times, axis=0), np.max(times, axis=0)
        slowest[name], typical[name] = worst, median
        print(
            f"Kelvin-Voigt, SNR {name}: K and B within 5 % after {median[0]:.3f} s (worst of 20: {worst[0]:.3f} s), "
            f"force"
            f" within 5 % of its rms after {median[1]:.3f} s ({worst[1]:.3f} s), rms error of K, B "
            f"{100 * median[2]:.1f} %"
        )
    assert slowest["40 dB"][0] < 0.1
    assert slowest["amplitude ratio 40"][1] < 0.1
    assert typical["power ratio 40"][0] > 1.0  # 16 % noise over 50 samples can't give 5 %: not what was meant


def test_study_hunt_crossley_single_stage():
    """β(t) = 1 − 0.01·e^(−5(t−2)), 0.99 before t = 2 s. Within 1.5 %: of the force's rms, from 0.3 s to the end."""
    x, v, k, b = study()
    clean = force(x, v, k, b, EXPONENT)
    errors = {}
    for name, ratio in {"none": math.inf, **READINGS}.items():
        found = []
        for seed in range(20):
            y, sigma = noisy(clean, ratio, seed)
            track = SingleStage(noise=sigma, forgetting=Scheduled(5.0, 2.0)).run(x, v, y, T)
            off = np.abs(force(x, v, track["stiffness"], track["damping"], track["exponent"]) - clean)[300:]
            parameters = [
                np.abs(track[parameter] / truth - 1.0)[300:].max()
                for parameter, truth in (("stiffness", k), ("damping", b), ("exponent", EXPONENT))
            ]
            holds = track.conditions["speed"] & track.conditions["noise"]
            found.append(
                [off.max() / rms(clean), rms(off) / rms(clean), (off / clean[300:]).max(), *parameters, holds.mean()]
            )
        median, worst = np.median(found, axis=0), np.max(found, axis=0)
        errors[name] = median
        print(
            f"Hunt-Crossley, SNR {name}, t ≥ 0.3 s: force within {100 * median[0]:.2f} % of its rms (worst of 20:"
            f" {100 * worst[0]:.2f} %), rms {100 * median[1]:.2f} %, of its value {100 * median[2]:.2f} %; parameters"
            f" K {100 * median[3]:.1f}, B {100 * median[4]:.0f}, n {100 * median[5]:.2f} %; conditions hold in"
            f" {100 * median[6]:.1f} % of samples"
        )
    assert errors["none"][0] < 0.015
    assert errors["40 dB"][0] < 0.015
    # K moves by 1 % within the memory of 100 samples, which n mistakes for curvature: K can't be within 1.5 %
    assert errors["none"][3] > 0.015


def test_study_the_other_reading_of_the_schedule_lags():
    """The schedule starting with the log (t₀ = 0) forgets ever less while K grows: the force is late by seconds."""
    x, v, k, b = study()
    clean = force(x, v, k, b, EXPONENT)
    worst = {}
    for start in (0.0, 2.0):
        track = SingleStage(noise=1e-6, forgetting=Scheduled(5.0, start)).run(x, v, clean, T)
        off = np.abs(force(x, v, track["stiffness"], track["damping"], track["exponent"]) - clean)
        worst[start] = off[300:].max() / rms(clean), off[300:600].max() / rms(clean)
    print(
        "force error over its rms, 0.3…2 s and 0.3…0.6 s, by t₀:",
        {k: np.round(v, 4).tolist() for k, v in worst.items()},
    )
    assert worst[2.0][0] < 0.015
    assert worst[0.0][0] > 0.05


def test_study_validity_condition():
    """With the cold start of the literature, θ₀ = (1, 1, 1), P₀ = I, the conditions hold from about 0.33 s."""
    x, v, k, b = study()
    y, sigma = noisy(force(x, v, k, b, EXPONENT), 100.0, 1)
    e = math.e
    jacobian = np.array([[e, 0.0, 0.0], [e, e, 0.0], [0.0, 0.0, 1.0]])  # of K, B, n by ln K, B/K, n at θ₀
    classic = SingleStage(
        noise=sigma,
        forgetting=Scheduled(5.0, 2.0),
        prior=Prior(np.array([e, e, 1.0]), jacobian @ jacobian.T),
        covariance_limit=None,
        reference_depth=1.0,
        weighted=False,
    )
    from_when = {}
    for name, estimator in {
        "classic": classic,
        "default": SingleStage(noise=sigma, forgetting=Scheduled(5.0, 2.0)),
    }.items():
        track = estimator.run(x, v, y, T)
        holds = track.conditions["speed"] & track.conditions["noise"]
        from_when[name] = settled((~track.conditions["speed"]).astype(float), 0.5)
        print(f"{name} start: speed condition holds from {from_when[name]:.3f} s, both in {100 * holds.mean():.1f} %")
    truth = np.abs(v) < 0.1 * k / b
    assert truth.all()  # of the true K/B = 10 1/s it holds from the start: the 0.33 s are those of the estimate
    assert 0.30 < from_when["classic"] < 0.36
    assert from_when["default"] < 0.1


def approach_and_retract():
    t = np.arange(0.0, 0.5, 1e-3)
    x = 0.01 * np.sin(2 * np.pi * t)
    return t, x, 0.01 * 2 * np.pi * np.cos(2 * np.pi * t)


def test_kelvin_voigt_pulls_at_separation_and_hunt_crossley_does_not():
    t, x, v = approach_and_retract()
    leaving = slice(-60, -1)
    truth = kelvin_voigt(x, v, 500.0, 10.0)
    track = KelvinVoigt(Constant(1.0)).run(x, v, truth)
    kv = kelvin_voigt(x, v, *track.theta[-1])
    hc_truth = force(x, v, 800.0, 400.0, EXPONENT)
    hc_track = SingleStage(noise=1e-4, forgetting=Constant(1.0)).run(x, v, hc_truth)
    hc = force(x, v, *hc_track.theta[-1])
    loops = [np.trapezoid(f, x) for f in (kv, hc)]
    print(
        f"least force at separation: Kelvin-Voigt {kv[leaving].min():.3f} N, Hunt-Crossley {hc[leaving].min():.6f} N;"
        f" energy of the loop {1e3 * loops[0]:.3f} and {1e3 * loops[1]:.3f} mJ"
    )
    np.testing.assert_allclose(track.theta[-1], [500.0, 10.0], rtol=1e-9)
    assert kv[leaving].min() == pytest.approx(-10.0 * 0.02 * np.pi, rel=0.15)  # −B ẋ at x = 0; K x a sample before
    assert kv[1] > 0.5  # and it jumps at contact
    assert hc[leaving].min() >= 0.0
    assert hc[1] < 0.02
    assert min(loops) > 0.0  # both dissipate


@pytest.mark.parametrize("method", [SingleStage, TwoStage])
def test_recovers_without_noise(method):
    rng = np.random.default_rng(3)
    t = np.arange(0.0, 4.0, 1e-3)
    x = 0.006 + 0.004 * np.sin(2 * np.pi * 1.3 * t) + 0.001 * np.sin(2 * np.pi * 4.1 * t + rng.random())
    v = np.gradient(x, 1e-3)
    y = force(x, v, 2000.0, 50.0, 1.4)  # B/K = 0.025 s/m: B ẋ/K < 0.1 %, so ln(1 + e) = e to 1e-6
    exact = {"offset": None} if method is SingleStage else {}  # a zero that is right
    track = method(noise=1e-6, forgetting=Constant(0.99), **exact).run(x, v, y)
    error = np.abs(track.theta[-1] / [2000.0, 50.0, 1.4] - 1.0)
    print(f"{method.__name__}: relative errors of K, B, n without noise {error}")
    # single stage: e²/2 of the logarithm, below 1e-6 of the force; damping is 1e-3 of it, so up to 1e-3 of B. Two
    # stages: they draw nearer by a factor each period, not at once
    assert (error < ([1e-5, 2e-3, 1e-5] if method is SingleStage else [1e-5, 1e-4, 1e-5])).all()
    assert track.valid[-1]


def test_recovers_within_a_per_cent_from_noise():
    """0.05 N and 2 µm, K, n, B within 1 %: pokes at several speeds, ten seconds."""
    rng = np.random.default_rng(7)
    t = np.arange(0.0, 10.0, 1e-3)
    x = 0.0045 * (1.0 - np.cos(2 * np.pi * t**1.5)) - 0.0005
    v = 0.0045 * 2 * np.pi * 1.5 * np.sqrt(t) * np.sin(2 * np.pi * t**1.5)
    truth = np.array([20e3, 4e3, 1.4])
    y = force(x, v, *truth) + 0.05 * rng.normal(size=t.shape)
    track = SingleStage(noise=0.05, forgetting=Constant(1.0)).run(x + 2e-6 * rng.normal(size=t.shape), v, y)
    error = track.theta[-1] / truth - 1.0
    print(f"K, B, n from 0.05 N and 2 µm: errors {np.round(100 * error, 2)} %, noise found {track.noise[-1]:.4f} N")
    assert abs(error[0]) < 0.01
    assert abs(error[2]) < 0.01
    assert abs(error[1]) < 0.05  # linearised: ln(1 + e) − e is 5 % of e at the limit e = 0.1


def test_centred_depth_makes_two_stages_converge():
    """With x in metres (r = 1) ln x is nearly constant and each stage fits what the other left."""
    x, v, _, _ = study()
    y = force(x, v, 100.0, 10.0, EXPONENT)
    left = {}
    for r in (0.02, 1.0):
        track = TwoStage(noise=1e-6, forgetting=Constant(0.995), reference_depth=r).run(x, v, y)
        left[r] = abs(track["exponent"][-1] - EXPONENT)
    print(f"error of n after 2 s: {left[0.02]:.1e} with r = 20 mm, {left[1.0]:.1e} with r = 1 m")
    assert left[0.02] < 1e-4 < 1e-2 < left[1.0]


def test_intervals_of_the_single_stage_cover():
    x, v, _, _ = study()
    truth = np.array([150.0, 6.0, 1.3])
    clean = force(x, v, *truth)
    inside = np.zeros(3)
    for seed in range(300):
        y, sigma = noisy(clean, 100.0, seed)
        low, high = SingleStage(noise=sigma, forgetting=Constant(1.0)).run(x, v, y).final.interval.T
        inside += (low < truth) & (truth < high)
    print(f"single stage: 95 % intervals of K, B, n cover {np.round(inside / 3, 1)} %")
    assert (inside / 300 > 0.90).all()  # 300 runs: ±2.5 %; the logarithm's own bias costs a little


def test_restitution_is_one_minus_two_thirds_of_damping():
    """An impact integrated to separation: n = 1.5, unit mass."""
    k, b = 1e4, 2e3
    table = []
    for speed in (0.001, 0.01, 0.05, 0.1, 0.2):
        out = solve_ivp(
            lambda _, s: [s[1], -float(force(s[0], s[1], k, b, 1.5))],
            (0.0, 10.0),
            [0.0, speed],
            events=_separation,
            rtol=1e-10,
            atol=1e-14,
            max_step=0.01,
        )
        e = -out.y_events[0][0][1] / speed
        table.append((speed, e, restitution(k, b, speed)))
    alpha = [(1.0 - e) / speed for speed, e, _ in table]
    print("speed, restitution integrated, 1 − αv:", [tuple(round(float(n), 5) for n in row) for row in table])
    print(f"α at {table[0][0]} m/s: {alpha[0]:.5f}, 2d/(3k) = {2 * b / (3 * k):.5f}")
    assert alpha[0] == pytest.approx(2 * b / (3 * k), rel=1e-3)  # the next order is α v ≈ 1e-4 of it
    for speed, e, expected in table:
        assert abs(e - expected) < (2 * b / (3 * k) * speed) ** 2  # second order in α v


def _separation(_, state):
    return state[0] if state[1] < 0.0 else 1.0


_separation.terminal = True
_separation.direction = -1


def test_conditions_are_reported_where_they_fail():
    t = np.arange(0.0, 6.0, 1e-3)
    quick = t > 3.0
    pace = np.where(quick, 8.0, 1.0)
    x = 0.006 + 0.004 * np.sin(2 * np.pi * pace * t)
    v = 0.004 * 2 * np.pi * pace * np.cos(2 * np.pi * pace * t)
    y = force(x, v, 2000.0, 1600.0, 1.3)  # B/K = 0.8 s/m: the limit is 0.125 m/s; the quick part reaches 0.2
    rng = np.random.default_rng(0)
    y = y + 0.005 * rng.normal(size=t.shape)
    track = SingleStage(noise=0.1, forgetting=Constant(0.999)).run(x, v, y)
    fast = np.abs(v) > 0.14
    assert fast.sum() > 500
    assert not track.conditions["speed"][fast & (t > 0.5)].any()
    assert (track.status[fast & (y > 1.1) & (t > 0.5)] == Status.TOO_FAST).all()
    assert track.conditions["speed"][(np.abs(v) < 0.1) & (t > 0.5)].all()
    loud = force(x, 0.0, 2000.0, 0.0, 1.3) > 10 * 0.1
    agree = track.conditions["noise"][t > 0.5] == loud[t > 0.5]
    assert agree.mean() > 0.98  # the boundary moves a little with the estimate
    assert loud.mean() < 0.99
    assert "move slower" in Status.TOO_FAST.remedy


def test_samples_out_of_contact_do_not_update():
    x, v, k, b = study()
    y = force(x, v, k, b, EXPONENT)
    x, y = x.copy(), y.copy()
    x[800:1200], y[800:1200] = -0.002, 0.5
    contact = np.ones(len(T), bool)
    contact[1500:] = False
    for estimator in (SingleStage(noise=1e-3), TwoStage(noise=1e-3), KelvinVoigt()):
        track = estimator.run(x, v, y, in_contact=contact)
        assert (track.theta[800:1200] == track.theta[799]).all()
        assert (track.theta[1500:] == track.theta[1499]).all()
        assert (track.status[800:1200] == Status.NO_CONTACT).all()
        assert (track.innovation[800:1200] == 0.0).all()
        assert track.excitation[1199] == 0.0  # the window is empty
        assert track.final.updates <= 1100


@pytest.mark.parametrize("law", [KelvinVoigt, SingleStage, TwoStage])
def test_a_valid_estimate_is_as_accurate_as_is_asked(law):
    x, v, k, b = study()
    y, sigma = noisy(force(x, v, k, b, EXPONENT), 100.0, 0)
    asked = (lambda share: (share, share)) if law is KelvinVoigt else (lambda share: share)
    options = (
        {"forgetting": Constant(0.998), "offset": None} if law is not TwoStage else {"forgetting": Constant(0.998)}
    )
    options |= {} if law is KelvinVoigt else {"noise": sigma}
    free, strict = (law(**options, accuracy=asked(share)).run(x, v, y, T) for share in (np.inf, 0.02))
    assert not (strict.valid & ~free.valid).any()
    assert strict.valid.sum() < free.valid.sum()
    sure = strict.valid
    half = 1.96 * strict.std[:, :2]
    assert (half[sure, 0] <= 0.02001 * strict["stiffness"][sure]).all()
    # a B that is known to K·1 ms is known well enough
    floor = np.maximum(0.02001 * np.abs(strict["damping"]), 1.001e-3 * strict["stiffness"])
    assert (half[sure, 1] <= floor[sure]).all()


def test_online_is_the_batch():
    x, v, k, b = study()
    y, sigma = noisy(force(x, v, k, b, EXPONENT), 100.0, 0)
    y[50] = np.nan
    for estimator in (
        SingleStage(noise=sigma, forgetting=Scheduled(5.0, 2.0)),
        TwoStage(noise=sigma, forgetting=Scheduled(5.0, 2.0)),
        KelvinVoigt(Scheduled(5.0, 2.0)),
    ):
        track, online = estimator.run(x, v, y, T), estimator.online()
        for i in range(600):
            status = online.step(x[i], v[i], y[i], t=T[i])
            assert (online.values == track.theta[i]).all()
            assert status == track.status[i]
        rest = online.chunk(x[600:], v[600:], y[600:], t=T[600:])
        np.testing.assert_array_equal(rest.theta, track.theta[600:])
        np.testing.assert_array_equal(online.estimate.covariance, track.final.covariance)
        np.testing.assert_allclose(np.diagonal(track.final.covariance), track.variance[-1], rtol=1e-9)
        assert online.estimate.skipped == 1


@pytest.mark.parametrize(
    "estimator",
    [
        SingleStage(noise=1e-3, forgetting=Scheduled(5.0, 2.0)),
        TwoStage(noise=1e-3),
        KelvinVoigt(),
        HuntCrossleyKalman(),
    ],
    ids=lambda estimator: type(estimator).__name__,
)
def test_bad_time_and_bad_samples_change_nothing(estimator):
    x, v, k, b = study()
    y = force(x, v, k, b, EXPONENT)
    clean, disturbed = estimator.online(), estimator.online()
    for i in range(300):
        clean.step(x[i], v[i], y[i], t=T[i])
        if i % 10 == 9:
            for late in (T[i - 1], T[i - 9], math.nan, math.inf, "soon"):
                with pytest.raises(InputError, match="growing time.*reset"):
                    disturbed.step(x[i], 2.0 * v[i], 3.0 * y[i], t=late)
            for j, bad in enumerate((math.nan, math.inf, -math.inf)):
                sample = [x[i], v[i], y[i]]
                sample[j] = bad
                estimate = disturbed.update(*sample, t=T[i] + (j - 3) * 1e-4)
                assert estimate.status is Status.NOT_FINITE
                assert not estimate.valid
        disturbed.step(x[i], v[i], y[i], t=T[i])
    np.testing.assert_array_equal(disturbed.values, clean.values)
    learnt = clean.estimate.updates
    assert disturbed.estimate.updates == learnt > 290
    disturbed.reset()
    disturbed.step(x[0], v[0], y[0], t=T[0])  # a new log
    assert disturbed.estimate.updates == learnt + 1
    with pytest.raises(InputError, match="growing time"):
        disturbed.chunk(x[:5], v[:5], y[:5], t=T[:5])
    disturbed.chunk(x[1:5], v[1:5], y[1:5], t=T[1:5])
    with pytest.raises(InputError, match="growing time"):
        disturbed.step(x[3], v[3], y[3], t=T[3])


def test_an_estimate_is_of_its_sample():
    x, v, k, b = study()
    y, sigma = noisy(force(x, v, k, b, EXPONENT), 100.0, 0)
    online = SingleStage(noise=sigma).online()
    for i in range(400):
        estimate = online.update(x[i], v[i], y[i])
    values, covariance = estimate.values.copy(), estimate.covariance
    online.chunk(x[400:], v[400:], y[400:])
    np.testing.assert_array_equal(estimate.values, values)
    np.testing.assert_array_equal(estimate.covariance, covariance)
    assert (online.values != values).all()
    assert estimate.updates == 400
    assert repr(estimate).startswith("<Estimate stiffness")
    for name in ("values", "status", "updates"):
        with pytest.raises(AttributeError):
            setattr(estimate, name, 0)


def test_warm_start_is_better_at_once():
    x, v, _, _ = study()
    here, there = np.array([100.0, 10.0, 1.2]), np.array([110.0, 10.5, 1.22])
    y, sigma = noisy(force(x, v, *here), 100.0, 0)
    neighbour = SingleStage(noise=sigma, forgetting=Constant(1.0)).run(x, v, y).final
    y, _ = noisy(force(x, v, *there), 100.0, 1)
    for method in (SingleStage, TwoStage):
        cold = method(noise=sigma, forgetting=Constant(1.0)).run(x, v, y)
        warm = method(noise=sigma, forgetting=Constant(1.0), prior=Prior.near(neighbour, (0.2, 0.2, 0.05))).run(x, v, y)
        error = [np.abs(track["exponent"][3:30] - 1.22).mean() for track in (warm, cold)]
        print(f"{method.__name__}: error of n in the first 30 ms: warm {error[0]:.3f}, cold {error[1]:.3f}")
        assert error[0] < 0.5 * error[1]


def test_constant_depth_is_not_excited():
    n = 1000
    rng = np.random.default_rng(0)
    still = np.full(n, 0.005), np.zeros(n), 1.0 + 0.01 * rng.normal(size=n)
    for estimator in (SingleStage(noise=0.01), TwoStage(noise=0.01), KelvinVoigt()):
        track = estimator.run(*still)
        assert not track.valid.any()
        assert track.final.status is Status.NOT_EXCITED


def test_depth_always_negative_says_no_contact():
    track = SingleStage().run(np.full(50, -0.01), np.zeros(50), np.zeros(50))
    assert track.final.status is Status.NO_CONTACT
    assert track.counts() == {Status.NO_CONTACT: 50}
    assert "press the tool in" in str(track.final)
    assert np.isinf(track.variance).all()
    assert np.isfinite(track.theta).all()


numbers = st.floats(width=64)
anything = st.integers(1, 80).flatmap(
    lambda n: st.tuples(*[hnp.arrays(np.float64, n, elements=numbers | st.floats(-1.0, 1.0)) for _ in range(3)])
)


@given(sample=anything, noise=st.sampled_from([0.0, 0.02]))
@settings(max_examples=150, deadline=None)
def test_whatever_comes_in_numbers_come_out(sample, noise):
    for estimator in (
        SingleStage(noise=noise),
        SingleStage(noise=noise, weighted=False),
        TwoStage(noise=noise),
        KelvinVoigt(),
    ):
        track = estimator.run(*sample)
        for values in (track.theta, track.variance, track.innovation, track.noise_variance):
            assert not np.isnan(values).any()
        assert np.isfinite(track.theta).all()
        assert not np.isnan(track.final.covariance).any()
        largest = 1e50 if isinstance(estimator, KelvinVoigt) else 1e7
        finite = (np.abs(sample) < largest).all(axis=0)
        assert (track.status[~finite & ~(sample[0] <= 0.0)] == Status.NOT_FINITE).all()
        assert not (track.status[finite] == Status.NOT_FINITE).any()


def test_bad_input_is_named():
    ones = np.ones(5)
    for estimator in (SingleStage(), TwoStage(), KelvinVoigt()):
        with pytest.raises(InputError, match="one length"):
            estimator.run(ones, ones, np.ones(4))
        with pytest.raises(InputError, match=r"\(n,\) each"):
            estimator.run(ones[:, None], ones[:, None], ones[:, None])
        with pytest.raises(InputError, match="in_contact"):
            estimator.run(ones, ones, ones, in_contact=np.ones(3, bool))
        with pytest.raises(InputError, match="a sample of shapes"):
            estimator.online().update(1.0, 2.0)
    with pytest.raises(InputError, match="sensor's noise"):
        SingleStage(noise=-1.0)
    with pytest.raises(InputError, match="reference_depth"):
        SingleStage(reference_depth=0.0)
    with pytest.raises(InputError, match="stiffness > 0"):
        SingleStage(prior=Prior(np.array([-1.0, 0.0, 1.0]), np.ones(3))).online()


def grown(rate, seconds, seed, noise=0.01):
    """A poke of one material whose ln K grows by `rate` a second: depth, depth rate, force, time, and K at the end."""
    t = np.arange(0.0, seconds, 1e-3)
    x = 3e-3 + 1.5e-3 * np.sin(2 * np.pi * 0.9 * t) + 5e-4 * np.sin(2 * np.pi * 5.0 * t)
    v = np.gradient(x, t)
    k = 4000.0 * np.exp(rate * t)
    clean = force(x, v, k, 2.0 * k, 1.3)
    return x, v, clean + noise * np.random.default_rng(seed).normal(size=len(t)), t, float(k[-1])


@pytest.mark.parametrize("rate", [-0.03, 0.0, 0.05])
def test_a_stiffness_that_grows_is_told_with_its_rate(rate):
    """Intervals of four normal numbers at 95 %, ten logs: below 33 of 40 once in 400 times."""
    inside = 0
    for seed in range(10):
        x, v, y, t, last = grown(rate, 8.0, seed)
        final = (
            SingleStage(noise=0.01, reference_depth=3e-3, forgetting=Constant(1.0), growth=0.1, offset=None)
            .run(x, v, y, t)
            .final
        )
        assert final.names == ("stiffness", "damping", "exponent", "growth")
        truth = np.array([last, 2.0 * last, 1.3, rate])
        low, high = final.interval.T
        inside += int(((low < truth) & (truth < high)).sum())
        assert final["growth"] == pytest.approx(rate, abs=0.01)
    assert inside >= 33


def test_what_grows_and_was_taken_for_constant_is_doubted():
    """K grows by a third in the log: least squares of a constant is sure, and wrong, and says so."""
    x, v, y, t, last = grown(0.04, 8.0, 0)
    for law in (SingleStage, TwoStage):
        forgetting = Constant(1.0 - 1.0 / 2000.0)
        track = law(noise=0.01, reference_depth=3e-3, forgetting=forgetting, accuracy=(0.02, 0.02, 0.02)).run(
            x, v, y, t
        )
        off = abs(track.final["stiffness"] / last - 1.0)
        print(f"{law.__name__}: K {100 * off:.0f} % off, {off * last / track.final.std[0]:.1f} standard deviations")
        assert off > 0.04
        assert off * last < 3.0 * track.final.std[0]
        assert not track.valid.any()


def test_growth_is_checked():
    for growth in (-1.0, math.inf, math.nan):
        with pytest.raises(InputError, match="growth"):
            SingleStage(growth=growth)
    with pytest.raises(InputError, match="each of K, B and n"):
        SingleStage(accuracy=(0.1, 0.1))
    with pytest.raises(InputError, match="accuracy"):
        TwoStage(accuracy=(0.1, 0.1, 0.0))
