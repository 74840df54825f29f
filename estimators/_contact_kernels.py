"""Kernels for Hunt-Crossley, f = K xⁿ + B xⁿ ẋ: one stage in logarithms, and two stages.

Both work with the depth over a reference depth r, so that ln(x/r) is near zero where the data are; with x in metres
ln x ≈ −4 hides behind the constant. `law` = noise ε [N], ln r, limit of |ẋ|B/K, limit of K xⁿ/ε, weighted (0 or 1),
then accuracies (see `trust`), and the largest variances of the second opinion.
"""

from __future__ import annotations

import math

from kinid.estimators._factored_kernels import covariance
from kinid.estimators._jit import inlined, jit
from kinid.estimators._kernels import (
    BELOW_NOISE,
    EARLY,
    NO_CONTACT,
    NOT_FINITE,
    STARTING,
    TOO_FAST,
    VALID,
    carve,
    close,
    conclude,
    learn,
    noise_variance,
    offset_place,
    parts,
    spread,
    trust,
    wait,
)
from kinid.estimators._store import TALLY
from kinid.estimators._watch_kernels import (
    SETTLED,
    elapsed,
    exp,
    grow,
    grow_shared,
    judge_errors,
    second_opinion,
    second_size,
    watch_size,
    write_law,
)
from kinid.kernels.types import Compiled

#: a depth [m or reference depths], a speed [m/s] or a force [N] beyond it is a fault of the log
FAR = 1e7

#: a force [N] below it is none, even where no noise is stated
FAINT = 1e-9


@inlined
def first_check(x: float, v: float, f: float, contact: bool, ratio: float, noise: float) -> int:
    """Status of a sample before anything is estimated: is there a force to take the logarithm of?"""
    if not (abs(x) < FAR and abs(v) < FAR and abs(f) < FAR):
        return NOT_FINITE
    if x <= 0.0 or not contact:
        return NO_CONTACT
    return BELOW_NOISE if f <= max(ratio * noise, FAINT) else VALID


@inlined
def enter(
    p: int, k: int, x: float, v: float, f: float, contact: bool, law: Compiled, phi: Compiled, out: Compiled
) -> Compiled:
    """How sample k begins: its status, and ln(x/r) where there is one; what is said of it is reset."""
    conditions = out[6]
    out[2][k] = 0.0
    conditions[k, 0] = conditions[k, 1] = False
    for j in range(p):
        phi[j] = 0.0
    code = first_check(x, v, f, contact, law[3], law[0])
    return code, math.log(x) - law[1] if code in (VALID, BELOW_NOISE) else 0.0


# one long function: a sample goes through regression, second opinion and watch without leaving scalars and scratch
@jit
def single_stage(
    shape: Compiled,
    state: Compiled,
    depth: Compiled,
    rate: Compiled,
    force: Compiled,
    contact: Compiled,
    factors: Compiled,
    times: Compiled,
    law: Compiled,
    limit: Compiled,
    window: Compiled,
    length: int,
    threshold: float,
    scratch: Compiled,
    out: Compiled,
) -> None:
    """One regression, ln f = ln(K rⁿ) + (B/K) ẋ + n ln(x/r) (Haddadi & Hashtrudi-Zaad 2008, 2012).

    Of four parameters, the last is the rate at which ln K grows: its regressor is the time until now, always 0. Of
    three, a second opinion lets it grow. `state`: that of the regression, before its tally that opinion and the watch.
    """
    p = len(shape)
    theta, d, u, own, tally = parts(p, state)
    phi, work, gain = scratch[0], scratch[1], scratch[2]
    thetas, variances, innovations, noises, _, _, conditions = out
    noise, log_r, fastest, ratio = law[0], law[1], law[2], law[3]
    weighted = law[4] > 0.0
    end = len(state) - TALLY - watch_size(p)
    begin = end - (second_size() if p == 3 else 0)
    offset, second, watch = state[offset_place(p) : begin], state[begin:end], state[end : len(state) - TALLY]
    for k in range(len(depth)):
        now = times[k if len(times) > 1 else 0]
        wait(offset, now)
        x, v, f = depth[k], rate[k], force[k]
        code, position = enter(p, k, x, v, f, contact[k], law, phi, out)
        factor = factors[k if len(factors) > 1 else 0]
        if code == VALID:
            step = elapsed(watch, now)
            if p > 3:
                moved = exp(grow(p, theta, u, step))
                watch[0] *= moved  # K and B, that of their ratio being constant
                watch[1] *= moved
                grow_shared(p, offset, step)
            predicted = exp(theta[0] + theta[2] * position) * (1.0 + theta[1] * v)
            innovations[k] = f - predicted
            if tally[3] > p + EARLY:  # too fast for sure: the whole interval of B/K says so
                known = theta[1] - 2.0 * math.sqrt(covariance(p, u, d, 1, 1) * spread(tally))
                if abs(v) * known > fastest:
                    code = TOO_FAST
        if code == VALID:
            # in newtons: noise of ln f is noise of f over f. The measured f would correlate with its own noise.
            weight = min(max(predicted, 0.5 * f), 2.0 * f) if weighted else 1.0
            phi[0], phi[1], phi[2] = weight, weight * v, weight * position
            y = weight * math.log(f)
            learn(p, theta, d, u, own, tally, phi, y, factor, limit, False, work, gain, offset, weight / f)
            if p == 3:
                second_opinion(second, step, weight, v, position, y, factor, law[5 + 2 * p :])
            phi[0], phi[1], phi[2] = 1.0, v, position
            if p > 3:  # time tells growth, no motion has to: in its place stands what is never like another regressor
                phi[3] = 1.0 if tally[3] % 2.0 == 0.0 else -1.0
        used, slow, loud = code == VALID, False, False
        if code in (VALID, BELOW_NOISE, TOO_FAST):
            slow = abs(v * theta[1]) < fastest and code != TOO_FAST
            loud = exp(theta[0] + theta[2] * position) > ratio * noise
            conditions[k, 0], conditions[k, 1] = slow, loud
        conclude(shape, k, code, tally, slow, loud, phi, window, length, threshold, scratch, out)
        noises[k] = noise_variance(tally)
        write_law(p, u, d, theta, log_r, spread(tally), offset, phi, thetas[k], variances[k])
        judge_errors(p, second, watch, log_r, factor, used, True, phi, thetas[k], variances[k])
        trust(p, k, law[5:], out)


# one long function: a sample goes through regression, second opinion and watch without leaving scalars and scratch
@jit
def two_stage(
    shape: Compiled,
    state: Compiled,
    depth: Compiled,
    rate: Compiled,
    force: Compiled,
    contact: Compiled,
    factors: Compiled,
    times: Compiled,
    law: Compiled,
    limit: Compiled,
    window: Compiled,
    length: int,
    threshold: float,
    scratch: Compiled,
    out: Compiled,
) -> None:
    """Fit f = K xⁿ + B xⁿ ẋ with the last n, then ln f − ln(K + B ẋ) = n ln x with the last K, B (Diolaiti et al.
    2005).

    Inside, K and B stand for K rⁿ and B rⁿ; `state` is that of both, a second opinion, the watch, then that of n. Each
    stage's covariance is that of its values given the other's; what is stated is that of the second opinion.
    """
    p, q = len(shape), 2
    split = offset_place(q) + TALLY
    middle = split + second_size()
    end = middle + watch_size(p)
    theta, d, u, own, tally = parts(q, state[:split])
    second, watch = state[split:middle], state[middle:end]
    exponent, d2, u2, own2, tally2 = parts(1, state[end:])
    none = state[:0]  # no offset is considered
    phi, work, gain = scratch[0], scratch[1], scratch[2]
    thetas, variances, innovations, noises, _, _, conditions = out
    noise, log_r, fastest, ratio = law[0], law[1], law[2], law[3]
    for k in range(len(depth)):
        x, v, f = depth[k], rate[k], force[k]
        code, position = enter(p, k, x, v, f, contact[k], law, phi, out)
        factor = factors[k if len(factors) > 1 else 0]
        used = code == VALID
        if code == VALID:
            step = elapsed(watch, times[k if len(times) > 1 else 0])
            power = exp(exponent[0] * position)
            ratio_now = theta[1] / theta[0] if theta[0] > 0.0 else 0.0
            damped = max(1.0 + ratio_now * v, 0.2)  # the logarithm is linearised around B/K as it is known
            weight = min(max(power * theta[0] * damped, 0.5 * f), 2.0 * f)
            slope = v / damped
            level = weight * (math.log(f / damped) + ratio_now * slope)
            second_opinion(second, step, weight, slope, position, level, factor, law[5 + 2 * p :])
            phi[0], phi[1] = power, power * v
            innovations[k] = learn(q, theta, d, u, own, tally, phi, f, factor, limit, False, work, gain, none, 1.0)
            stiff = theta[0] + theta[1] * v
            if stiff > 0.0 and tally[3] > q:
                phi[0] = position
                y, last = math.log(f / stiff), limit[q:]
                learn(1, exponent, d2, u2, own2, tally2, phi, y, factor, last, False, work, gain, none, 0.0)
            phi[0], phi[1], phi[2] = 1.0, v, position
        loud = False
        if code in (VALID, BELOW_NOISE):
            loud = theta[0] * exp(exponent[0] * position) > ratio * noise
            conditions[k, 0], conditions[k, 1] = abs(v * theta[1]) < fastest * theta[0], loud
        conclude(shape, k, code, tally2, True, loud, phi, window, length, threshold, scratch, out)
        noises[k] = noise_variance(tally)
        unit = exp(-exponent[0] * log_r)
        thetas[k, 0], thetas[k, 1], thetas[k, 2] = theta[0] * unit, theta[1] * unit, exponent[0]
        judge_errors(p, second, watch, log_r, factor, used, False, phi, thetas[k], variances[k])
        if out[5][k] == VALID and watch[4 * p + 1] <= SETTLED:
            out[5][k] = STARTING  # rows that were made with another exponent still count
        trust(p, k, law[5:], out)


@jit
def single_stage_once(t: float, shape: Compiled, store: Compiled) -> None:
    """One contact: depth, rate, force, flag."""
    room = carve(shape, store)
    room.time[0] = t
    x = room.inputs
    single_stage(
        shape,
        room.state,
        x[:1],
        x[1:2],
        x[2:3],
        x[3:],
        room.factor,
        room.time,
        room.settings,
        room.limit,
        room.window,
        room.length,
        room.threshold,
        room.scratch,
        room.out,
    )
    close(room.record, room.state[-1])


@jit
def two_stage_once(t: float, shape: Compiled, store: Compiled) -> None:
    """One contact: depth, rate, force, flag."""
    room = carve(shape, store)
    room.time[0] = t
    x = room.inputs
    two_stage(
        shape,
        room.state,
        x[:1],
        x[1:2],
        x[2:3],
        x[3:],
        room.factor,
        room.time,
        room.settings,
        room.limit,
        room.window,
        room.length,
        room.threshold,
        room.scratch,
        room.out,
    )
    close(room.record, room.state[-1])
