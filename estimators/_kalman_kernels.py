"""Kernel of the Kalman filters of Hunt-Crossley contact with unknown surface.

`state` of a bank of m filters: theta, d, U, diagonal of P and tally of each (see `_kernels`) | logarithms of the
members' probabilities (m) | watch (6) = last normalised innovation ν, weighted sums of ν νʹ (νʹ the one before), of ν²,
of weights, time of the last sample, number of samples used.
`settings` = noise ε [N], ln r, limit of f/ε, sample time, memory of the watch in samples, walk (4), fading (2),
then accuracies (see `trust`).
"""

from __future__ import annotations

import math

import numpy as np

from kinid.estimators._contact_kernels import FAR
from kinid.estimators._factored_kernels import add_noise, covariance, hold, quadratic, rank_one
from kinid.estimators._jit import inlined, jit
from kinid.estimators._kernels import (
    BELOW_NOISE,
    DIVERGED,
    EARLY,
    MISFIT,
    NO_CONTACT,
    NOT_FINITE,
    VALID,
    carve,
    close,
    conclude,
    noise_variance,
    parts,
    trust,
)
from kinid.estimators._watch_kernels import exp
from kinid.kernels.types import Compiled

#: logarithm of a probability below which a member of the bank is given up
IMPOSSIBLE = -50.0

#: places of the watch
LAST, TOGETHER, SQUARES, WEIGHTS, TIME, USED = range(6)

#: a filter is lost where ν νʹ is on average more than this; noise of the stated size, however coloured, stays below 1
PERSISTENT = 2.0

#: … and more than this part of ν²: noise that is only larger than stated makes the whole large, not this part
LASTING = 0.5


@inlined
def bank(p: int, state: Compiled) -> Compiled:
    """Views of the members' states (m, …), the logarithms of their probabilities (m,) and the watch."""
    size = 3 * p + p * p + 4
    members = (len(state) - 6) // (size + 1)
    end = members * size
    return state[:end].reshape(members, size), state[end : end + members], state[end + members :]


@inlined
def notice(watch: Compiled, innovation: float, keep: float) -> None:
    """Take in one innovation over its standard deviation; beyond 10⁶ of them all are alike."""
    innovation = min(max(innovation, -1e6), 1e6)
    watch[TOGETHER] = keep * watch[TOGETHER] + innovation * watch[LAST]
    watch[SQUARES] = keep * watch[SQUARES] + innovation * innovation
    watch[WEIGHTS] = keep * watch[WEIGHTS] + 1.0
    watch[LAST] = innovation
    watch[USED] += 1.0


@inlined
def lost(watch: Compiled, patience: float) -> bool:
    """Whether the innovations lie far outside their covariance, and to one side for sample after sample."""
    limit = max(PERSISTENT * watch[WEIGHTS], LASTING * watch[SQUARES])
    return bool(watch[USED] > patience and watch[TOGETHER] > limit)


@inlined
def probability(weight: float) -> float:
    """Of a member of the bank, up to a factor; 0 once it is given up."""
    return math.exp(weight) if weight > IMPOSSIBLE else 0.0


@inlined
def confine(p: int, s: Compiled, u: Compiled, d: Compiled, i: int, low: float, high: float) -> None:
    """State i into its bounds, the others along with it as their covariance says (Simon 2010, IET CTA 4(8))."""
    move = min(max(s[i], low), high) - s[i]
    variance = covariance(p, u, d, i, i)
    if move != 0.0:
        for j in range(p):
            s[j] += move * (
                covariance(p, u, d, i, j) / variance if j != i and variance > 0.0 else 1.0 if j == i else 0.0
            )


@inlined
def along(p: int, member: Compiled, exponent: float, out: Compiled) -> None:
    """The values that a member expects where 1/n is `exponent`."""
    s, d, u, _, _ = parts(p, member)
    variance = covariance(p, u, d, 2, 2)
    for j in range(p):
        share = covariance(p, u, d, j, 2) / variance if variance > 0.0 else 0.0
        out[j] = s[j] + share * (exponent - s[2])
    out[0] = min(max(out[0], 1e-3), 1e3)
    out[2] = exponent


# one long function: a sample goes through prediction, bank and update without leaving scalars and scratch
@jit
def kalman(
    shape: Compiled,
    state: Compiled,
    depth: Compiled,
    rate: Compiled,
    force: Compiled,
    contact: Compiled,
    factors: Compiled,
    times: Compiled,
    settings: Compiled,
    limit: Compiled,
    window: Compiled,
    length: int,
    threshold: float,
    scratch: Compiled,
    out: Compiled,
) -> None:
    """A bank of extended Kalman filters of x = r c (f/(1 + b ẋ))^m − r z, one for each range of m.

    Each member's state is [c, b, m, z] with K = (r c)^(−1/m), b = B/K, n = 1/m, a force unit of 1 N. `times` holds the
    time of each sample, or one NaN where none is known.
    """
    p = len(shape)
    states, weights, watch = bank(p, state)
    members = len(weights)
    phi, work, gain = scratch[0], scratch[1], scratch[2]
    thetas, variances, innovations, noises, _, _, _ = out
    noise, log_r, ratio, period, patience = settings[0], settings[1], settings[2], settings[3], settings[4]
    walk, fading = settings[5:9], settings[9:11]
    keep = 1.0 - 1.0 / patience
    r = math.exp(log_r)
    best = 0
    for i in range(members):
        if weights[i] > weights[best]:
            best = i
    for k in range(len(depth)):
        x, v, f = depth[k] / r, rate[k], force[k]
        fine = abs(x) < FAR and abs(v) < FAR and abs(f) < FAR
        step, now = period, times[k if len(times) > 1 else 0]
        if not math.isnan(now):
            if not math.isnan(watch[TIME]):
                step = max(now - watch[TIME], 0.0)
            watch[TIME] = now
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
                error = x + s[3] - s[0] * exp(s[2] * math.log(f / damped))
                # slopes at the predicted force, whose error is independent of this sample's; at the measured one at
                # first
                clean = predicted if abs(f - predicted) < 5.0 * noise else f
                power = exp(s[2] * math.log(clean / damped))
                there = s[0] * power
                phi[0], phi[1], phi[2], phi[3] = (
                    power,
                    -s[2] * there * v / damped,
                    there * math.log(clean / damped),
                    -1.0,
                )
                # force noise as depth; with c still unknown it may be larger than c says
                sigma = noise / clean * s[2] * power * (s[0] + math.sqrt(covariance(p, u, d, 0, 0)))
                total = sigma * sigma + quadratic(p, u, d, phi)
                if i == best:
                    innovations[k] = f - predicted
                    notice(watch, error / math.sqrt(total), keep)
                rank_one(p, u, d, phi, 1.0 / (sigma * sigma), gain)
                for j in range(p):
                    s[j] += gain[j] * error / total
                confine(p, s, u, d, 0, 1e-3, 1e3)
                confine(p, s, u, d, 2, 0.2, 2.0)
                s[0] = min(max(s[0], 1e-3), 1e3)  # the second may have moved the first
                weights[i] -= 0.5 * (error * error / total + math.log(total / (sigma * sigma)))
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
        conclude(shape, k, code, tally, True, True, phi, window, length, threshold, scratch, out)
        if code == VALID and tally[3] > p + EARLY:
            if lost(watch, patience):
                out[5][k] = DIVERGED
            elif out[5][k] == VALID and noise_variance(tally) > 9.0:
                out[5][k] = MISFIT
        noises[k] = noise * noise * noise_variance(tally)
        # `work` is where the likeliest member says that the mixture's mean exponent lies: what fits alike is a valley
        # that bends, off which the mean of all values would lie. Each row of the Jacobian of K, B, n, z goes into `phi`
        mean = 0.0
        for i in range(members):
            mean += probability(weights[i]) / mass * states[i, 2]
        along(p, states[best], mean, work)
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
        trust(p, k, settings[11:], out)


@jit
def kalman_once(t: float, shape: Compiled, store: Compiled) -> None:
    """One contact: depth, rate, force, flag."""
    room = carve(shape, store)
    x = room.inputs
    room.time[0] = t
    kalman(
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
