"""Kernels for Hunt-Crossley, f = K xⁿ + B xⁿ ẋ: one stage in logarithms, two stages, and Kalman filters.

All work with the depth over a reference depth r, so that ln(x/r) is near zero where the data are; with x in metres
ln x ≈ −4 hides behind the constant. `law` = noise ε [N], ln r, limit of |ẋ|B/K, limit of K xⁿ/ε, weighted (0 or 1).
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from kinid.estimators._jit import inlined, jit
from kinid.estimators._kernels import (
    BELOW_NOISE,
    EARLY,
    MISFIT,
    NO_CONTACT,
    NOT_EXCITED,
    NOT_FINITE,
    STARTING,
    TOO_FAST,
    VALID,
    add_noise,
    covariance,
    excite,
    hold,
    learn,
    noise_variance,
    parts,
    quadratic,
    rank_one,
    scaled,
    spread,
)

#: a depth [m or reference depths], a speed [m/s] or a force [N] beyond it is a fault of the log
FAR = 1e7

#: a force [N] below it is none, even where no noise is stated
FAINT = 1e-9

#: logarithm of a probability below which a member of the bank is given up
IMPOSSIBLE = -50.0


@inlined
def exp(value: float) -> float:
    """Exponential that can't overflow, for the first wild estimates."""
    return math.exp(min(max(value, -200.0), 200.0))


@inlined
def probability(weight: float) -> float:
    """Of a member of the bank, up to a factor; 0 once it is given up."""
    return math.exp(weight) if weight > IMPOSSIBLE else 0.0


@inlined
def confine(p: int, s: Any, u: Any, d: Any, i: int, low: float, high: float) -> None:
    """State i into its bounds, the others along with it as their covariance says (Simon 2010, IET CTA 4(8))."""
    move = min(max(s[i], low), high) - s[i]
    variance = covariance(p, u, d, i, i)
    if move != 0.0:
        for j in range(p):
            s[j] += move * (covariance(p, u, d, i, j) / variance if j != i and variance > 0.0 else 1.0 if j == i else 0.0)


@inlined
def first_check(x: float, v: float, f: float, contact: bool, ratio: float, noise: float) -> int:
    """Status of a sample before anything is estimated: is there a force to take the logarithm of?"""
    if not (abs(x) < FAR and abs(v) < FAR and abs(f) < FAR):
        return NOT_FINITE
    if x <= 0.0 or not contact:
        return NO_CONTACT
    return BELOW_NOISE if f <= max(ratio * noise, FAINT) else VALID


@inlined
def judge(updates: float, least: int, excitation: float, threshold: float, slow: bool, loud: bool) -> int:
    """Status of an estimate whose sample was used."""
    if updates <= least:
        return STARTING
    if excitation < threshold:
        return NOT_EXCITED
    if not slow:
        return TOO_FAST
    return VALID if loud else BELOW_NOISE


@inlined
def write_law(p: int, u: Any, d: Any, a: float, b: float, n: float, log_r: float, factor: float,
              values: Any, variances: Any) -> None:  # fmt: skip
    """K, B, n and their variances from ln(K rⁿ), B/K, n, to first order; `factor` scales the covariance."""
    k = exp(a - n * log_r)
    values[0], values[1], values[2] = k, b * k, n
    paa, pan, pnn = covariance(p, u, d, 0, 0), covariance(p, u, d, 0, 2), covariance(p, u, d, 2, 2)
    pab, pbn, pbb = covariance(p, u, d, 0, 1), covariance(p, u, d, 1, 2), covariance(p, u, d, 1, 1)
    log_k = paa - 2.0 * log_r * pan + log_r * log_r * pnn
    variances[0] = scaled(k * k * log_k, factor)
    variances[1] = scaled(k * k * (pbb + b * b * log_k + 2.0 * b * (pab - log_r * pbn)), factor)
    variances[2] = scaled(pnn, factor)


@jit
def single_stage(
    shape: Any, state: Any, depth: Any, rate: Any, force: Any, contact: Any, factors: Any, law: Any, limit: Any,
    window: Any, length: int, threshold: float, scratch: Any, out: Any,
) -> None:  # fmt: skip
    """One regression, ln f = ln(K rⁿ) + (B/K) ẋ + n ln(x/r) (Haddadi & Hashtrudi-Zaad 2008, 2012)."""
    p = len(shape)
    theta, d, u, own, tally = parts(p, state)
    phi, work, gain, a = scratch[0], scratch[1], scratch[2], scratch[3:]
    gram, scale, cursor = window
    thetas, variances, innovations, noises, excitations, statuses, conditions = out
    noise, log_r, fastest, ratio, weighted = law
    for k in range(len(depth)):
        x, v, f = depth[k], rate[k], force[k]
        code = first_check(x, v, f, contact[k], ratio, noise)
        innovations[k] = 0.0
        conditions[k, 0] = conditions[k, 1] = False
        for j in range(p):
            phi[j] = 0.0
        position = math.log(x) - log_r if code in (VALID, BELOW_NOISE) else 0.0
        if code == VALID:
            predicted = exp(theta[0] + theta[2] * position) * (1.0 + theta[1] * v)
            innovations[k] = f - predicted
            if tally[3] > p + EARLY:  # too fast for sure: the whole interval of B/K says so
                known = theta[1] - 2.0 * math.sqrt(covariance(p, u, d, 1, 1) * spread(tally))
                if abs(v) * known > fastest:
                    code = TOO_FAST
        if code == VALID:
            # in newtons: noise of ln f is noise of f over f. The measured f would correlate with its own noise.
            weight = min(max(predicted, 0.5 * f), 2.0 * f) if weighted > 0.0 else 1.0
            phi[0], phi[1], phi[2] = weight, weight * v, weight * position
            factor = factors[k if len(factors) > 1 else 0]
            learn(p, theta, d, u, own, tally, phi, weight * math.log(f), factor, limit, False, work, gain)
            phi[0], phi[1], phi[2] = 1.0, v, position
        if code in (VALID, BELOW_NOISE, TOO_FAST):
            conditions[k, 0] = abs(v * theta[1]) < fastest and code != TOO_FAST
            conditions[k, 1] = exp(theta[0] + theta[2] * position) > ratio * noise
        if length > 0:
            excite(p, shape, gram, scale, cursor, length, phi, work, a)
        if code == VALID:
            code = judge(tally[3], p + EARLY, cursor[3], threshold, conditions[k, 0], conditions[k, 1])
        statuses[k] = code
        noises[k] = noise_variance(tally)
        excitations[k] = cursor[3]
        write_law(p, u, d, theta[0], theta[1], theta[2], log_r, spread(tally), thetas[k], variances[k])


@jit
def two_stage(
    shape: Any, first: Any, second: Any, depth: Any, rate: Any, force: Any, contact: Any, factors: Any, law: Any,
    limit: Any, window: Any, length: int, threshold: float, scratch: Any, out: Any,
) -> None:  # fmt: skip
    """Fit f = K xⁿ + B xⁿ ẋ with the last n, then ln f − ln(K + B ẋ) = n ln x with the last K, B (Diolaiti et al. 2005).

    Inside, K and B stand for K rⁿ and B rⁿ. Covariances are those of each stage, given the other's values.
    """
    p, q = len(shape), 2
    theta, d, u, own, tally = parts(q, first)
    exponent, d2, u2, own2, tally2 = parts(1, second)
    phi, work, gain, a = scratch[0], scratch[1], scratch[2], scratch[3:]
    gram, scale, cursor = window
    thetas, variances, innovations, noises, excitations, statuses, conditions = out
    noise, log_r, fastest, ratio, _ = law
    for k in range(len(depth)):
        x, v, f = depth[k], rate[k], force[k]
        code = first_check(x, v, f, contact[k], ratio, noise)
        innovations[k] = 0.0
        conditions[k, 0] = conditions[k, 1] = False
        for j in range(p):
            phi[j] = 0.0
        position = math.log(x) - log_r if code in (VALID, BELOW_NOISE) else 0.0
        if code == VALID:
            factor = factors[k if len(factors) > 1 else 0]
            power = exp(exponent[0] * position)
            phi[0], phi[1] = power, power * v
            innovations[k] = learn(q, theta, d, u, own, tally, phi, f, factor, limit, False, work, gain)
            stiff = theta[0] + theta[1] * v
            if stiff > 0.0 and tally[3] > q:
                phi[0] = position
                learn(
                    1, exponent, d2, u2, own2, tally2, phi, math.log(f / stiff), factor, limit[q:], False, work, gain
                )
            phi[0], phi[1], phi[2] = 1.0, v, position
        if code in (VALID, BELOW_NOISE):
            conditions[k, 0] = abs(v * theta[1]) < fastest * theta[0]
            conditions[k, 1] = theta[0] * exp(exponent[0] * position) > ratio * noise
        if length > 0:
            excite(p, shape, gram, scale, cursor, length, phi, work, a)
        if code == VALID:
            code = judge(tally2[3], p + EARLY, cursor[3], threshold, True, conditions[k, 1])
        statuses[k] = code
        noises[k] = noise_variance(tally)
        excitations[k] = cursor[3]
        n, s1, s2 = exponent[0], spread(tally), spread(tally2)
        unit = exp(-n * log_r)
        thetas[k, 0], thetas[k, 1], thetas[k, 2] = theta[0] * unit, theta[1] * unit, n
        variances[k, 2] = scaled(d2[0], s2)
        for j in range(q):
            moved = theta[j] * log_r  # by the exponent's error
            variances[k, j] = unit * unit * (scaled(covariance(q, u, d, j, j), s1) + scaled(moved * moved * d2[0], s2))


@jit
def kalman(
    shape: Any, states: Any, weights: Any, depth: Any, rate: Any, force: Any, contact: Any, steps: Any, walk: Any,
    law: Any, fading: Any, limit: Any, window: Any, length: int, threshold: float, scratch: Any, out: Any,
) -> None:  # fmt: skip
    """A bank of extended Kalman filters of x = r c (f/(1 + b ẋ))^m − r z, one for each range of m.

    Each member's state is [c, b, m, z] with K = (r c)^(−1/m), b = B/K, n = 1/m, a force unit of 1 N; `weights` are
    logarithms of the members' probabilities.
    """
    p, members = len(shape), len(weights)
    phi, work, gain, a = scratch[0], scratch[1], scratch[2], scratch[3:]
    gram, scale, cursor = window
    thetas, variances, innovations, noises, excitations, statuses, _ = out
    noise, log_r, _, ratio, _ = law
    r = math.exp(log_r)
    best = 0
    for i in range(members):
        if weights[i] > weights[best]:
            best = i
    for k in range(len(depth)):
        x, v, f = depth[k] / r, rate[k], force[k]
        fine = abs(x) < FAR and abs(v) < FAR and abs(f) < FAR
        step = steps[k if len(steps) > 1 else 0]
        code = VALID
        innovations[k] = 0.0
        top = -np.inf
        for i in range(members):
            s, d, u, own, tally = parts(p, states[i])
            add_noise(p, u, d, 0, (walk[0] * s[0] * s[2]) ** 2 * step, work)
            add_noise(p, u, d, 1, walk[1] ** 2 * step, work)
            add_noise(p, u, d, 2, (walk[2] * s[2] * s[2]) ** 2 * step, work)
            add_noise(p, u, d, 3, (walk[3] / r) ** 2 * step, work)
            if fine and contact[k] and f > ratio * noise and weights[i] > IMPOSSIBLE:
                fade = 1.0 / (1.0 - fading[0] * math.exp(-tally[3] / fading[1]))
                for j in range(p):
                    d[j] *= fade
                hold(p, u, d, limit, work, gain)
                damped = max(1.0 + s[1] * v, 0.2)
                predicted = damped * (max(x + s[3], 0.0) / s[0]) ** (1.0 / s[2])
                if i == best:
                    innovations[k] = f - predicted
                error = x + s[3] - s[0] * exp(s[2] * math.log(f / damped))
                # slopes at the predicted force, whose error is independent of this sample's; at the measured one at first
                clean = predicted if abs(f - predicted) < 5.0 * noise else f
                power = exp(s[2] * math.log(clean / damped))
                there = s[0] * power
                phi[0], phi[1], phi[2], phi[3] = power, -s[2] * there * v / damped, there * math.log(clean / damped), -1.0
                # force noise as depth; with c still unknown it may be larger than c says
                sigma = noise / clean * s[2] * power * (s[0] + math.sqrt(covariance(p, u, d, 0, 0)))
                total = sigma * sigma + quadratic(p, u, d, phi)
                rank_one(p, u, d, phi, 1.0 / (sigma * sigma), gain)
                for j in range(p):
                    s[j] += gain[j] * error / total
                confine(p, s, u, d, 0, 1e-3, 1e3)
                confine(p, s, u, d, 2, 0.2, 2.0)
                s[0] = min(max(s[0], 1e-3), 1e3)  # the second may have moved the first
                weights[i] -= 0.5 * (error * error / total + math.log(total))
                tally[0] = 0.99 * tally[0] + error * error / total
                tally[1] = 0.99 * tally[1] + 1.0
                tally[3] += 1.0
            top = max(top, weights[i])
        mass = 0.0
        for i in range(members):
            weights[i] = max(weights[i] - top, 2.0 * IMPOSSIBLE)
            if weights[i] == 0.0:
                best = i
            mass += probability(weights[i])
        s, d, u, own, tally = parts(p, states[best])
        if not fine:
            code = NOT_FINITE
        elif not contact[k] or f <= ratio * noise:
            code = BELOW_NOISE if contact[k] and tally[3] > 0.0 and x + s[3] > 0.0 else NO_CONTACT
        for j in range(p):
            phi[j] = 0.0
        if code == VALID:
            power = exp(s[2] * math.log(f))
            phi[0], phi[1], phi[2], phi[3] = power, power * v, power * math.log(f), 1.0
        if length > 0:
            excite(p, shape, gram, scale, cursor, length, phi, work, a)
        if code == VALID:
            code = judge(tally[3], p + EARLY, cursor[3], threshold, True, True)
            if code == VALID and noise_variance(tally) > 9.0:
                code = MISFIT
        statuses[k] = code
        noises[k] = noise * noise * noise_variance(tally)
        excitations[k] = cursor[3]
        # moments of the mixture; `work` is its mean, each row of the Jacobian of K, B, n, z goes into `phi`
        for j in range(p):
            work[j] = 0.0
            for i in range(members):
                work[j] += probability(weights[i]) / mass * states[i, j]
        n = 1.0 / work[2]
        log_c = log_r + math.log(work[0])
        stiffness = exp(-n * log_c)
        thetas[k, 0], thetas[k, 1], thetas[k, 2], thetas[k, 3] = stiffness, work[1] * stiffness, n, r * work[3]
        for row in range(p):
            for j in range(p):
                phi[j] = 0.0
            if row < 2:
                size = stiffness if row == 0 else work[1] * stiffness
                phi[0], phi[1], phi[2] = -size * n / work[0], stiffness * row, size * n * n * log_c
            elif row == 2:
                phi[2] = -n * n
            else:
                phi[3] = r
            total = 0.0
            for i in range(members):
                if weights[i] > IMPOSSIBLE:
                    s, d, u, own, tally = parts(p, states[i])
                    apart = 0.0
                    for j in range(p):
                        apart += phi[j] * (s[j] - work[j])
                    total += probability(weights[i]) / mass * (quadratic(p, u, d, phi) + apart * apart)
            variances[k, row] = total
