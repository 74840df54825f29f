"""Kernel of recursive friction: an extended Kalman filter with instruments, bristles, and the sensor's zeros.

`state`: values μ, c, zeros of the tangential forces and of the normal force (5) | d (5) | U (25) | φ, work and gain of
an update (15) | numbers of the filter (see the places below) | number of samples used.
`settings` = least speed, least load, bristle length, share of a reversal, noise, walks of μ and c, walks of the zeros
of tangential and normal force, accuracy, sample time.
"""

from __future__ import annotations

import math

import numpy as np

from kinid.estimators._excitation_kernels import excite
from kinid.estimators._factored_kernels import add_noise, quadratic, rank_one
from kinid.estimators._jit import inlined, jit
from kinid.estimators._kernels import (
    HUGE,
    MISFIT,
    NO_CONTACT,
    NOT_EXCITED,
    NOT_FINITE,
    NOT_SLIDING,
    STARTING,
    VALID,
    carve,
    close,
)
from kinid.estimators.estimate import NORMAL_95
from kinid.kernels.types import Compiled

#: states of the filter
STATES = 5
FRICTION, VISCOUS, ZERO1, ZERO2, ZERO_NORMAL = range(STATES)

#: places of the filter's numbers
LOAD, RATE1, RATE2, TOUCHED = range(4)
AHEAD1, AHEAD2, BENT1, BENT2, LAST1, LAST2, TIME, NOISE, LEARNT = range(4, 13)
LAST_ERROR, TOGETHER, SQUARES, RESISTING, FAST, WEIGHTS, COLOURED = range(13, 20)
NUMBERS = 20

#: samples over which regressors are averaged to be instruments
INSTRUMENT = 20.0

#: share of a bristle's length over which it is purely elastic before it slips, as in `kinid.effects`
ELASTIC = 0.02
#: a way of no length [m]
TINY = 1e-12

#: friction that has turned around less than this far says little and hardly which way
LEAST_BENT = 0.2

#: the noise is averaged over so many samples, and as many as FIRM stand for what was stated of it
NOISE_MEMORY, FIRM = 2000.0, 200.0

#: samples that the watch over the innovations remembers; their correlation from one to the next beyond which they
#: follow a law of their own; and the share of all samples that may have done so, since a filter forgets nothing
PATIENCE, CORRELATED, LASTING = 1000.0, 0.5, 0.2

#: least μ, and c [N·s/m], that an opened filter takes for the size of its values
REOPENED_FRICTION, REOPENED_VISCOUS = 0.1, 1.0

#: samples after which that can be said
RIPE = 250.0


@inlined
def views(state: Compiled) -> Compiled:
    """Values, d, U, φ, work, gain and the filter's numbers."""
    m = 2 * STATES + STATES * STATES
    return (
        state[:STATES],
        state[STATES : 2 * STATES],
        state[2 * STATES : m].reshape(STATES, STATES),
        state[m : m + STATES],
        state[m + STATES : m + 2 * STATES],
        state[m + 2 * STATES : m + 3 * STATES],
        state[m + 3 * STATES : m + 3 * STATES + NUMBERS],
    )


def reopen(state: Compiled, spread: float) -> None:
    """Give μ and c, in parts of their values, a standard deviation as if nothing else were known; zeros stay known.

    The covariance is U D Uᵀ with U upper triangular, so that the zeros' part of it stands in their own rows.
    """
    m = 2 * STATES + STATES * STATES
    theta, d, u = state[:STATES], state[STATES : 2 * STATES], state[2 * STATES : m].reshape(STATES, STATES)
    u[: VISCOUS + 1] = np.eye(STATES)[: VISCOUS + 1]
    d[FRICTION] = (spread * max(abs(theta[FRICTION]), REOPENED_FRICTION)) ** 2
    d[VISCOUS] = (spread * max(abs(theta[VISCOUS]), REOPENED_VISCOUS)) ** 2
    numbers = state[m + 3 * STATES :]
    numbers[TOGETHER] = numbers[SQUARES] = numbers[COLOURED] = 0.0


@inlined
def correct(
    theta: Compiled, d: Compiled, u: Compiled, phi: Compiled, gain: Compiled, error: float, variance: float
) -> None:
    """A measurement with an innovation and a noise variance; φ its instrument."""
    total = rank_one(STATES, u, d, phi, 1.0 / variance, gain) * variance
    for j in range(STATES):
        theta[j] += gain[j] * error / total


@inlined
def bend(at: Compiled, step1: float, step2: float, length: float) -> None:
    """Bristles follow a step of slip [m]: Dahl's, behind an element that is elastic over a small share of ℓ."""
    at[AHEAD1] += step1
    at[AHEAD2] += step2
    if length <= 0.0:
        return
    far = math.sqrt(at[AHEAD1] ** 2 + at[AHEAD2] ** 2)
    moved = far - ELASTIC * length
    if moved > 0.0:
        a, b, gone = at[AHEAD1] / far, at[AHEAD2] / far, math.exp(-moved / length)
        at[AHEAD1], at[AHEAD2] = ELASTIC * length * a, ELASTIC * length * b
        at[BENT1], at[BENT2] = a + (at[BENT1] - a) * gone, b + (at[BENT2] - b) * gone


@inlined
def lift(at: Compiled) -> None:
    """What a touch begins with: bristles straight, no instruments yet."""
    for place in (TOUCHED, AHEAD1, AHEAD2, BENT1, BENT2):
        at[place] = 0.0


@inlined
def average(at: Compiled, load: float, v1: float, v2: float) -> None:
    """Take a sample into the means that are the next one's instruments."""
    share = 1.0 / min(at[TOUCHED] + 1.0, INSTRUMENT)
    at[LOAD] += share * (load - at[LOAD])
    at[RATE1] += share * (v1 - at[RATE1])
    at[RATE2] += share * (v2 - at[RATE2])
    at[TOUCHED] += 1.0


@inlined
def rest_zeros(
    theta: Compiled,
    d: Compiled,
    u: Compiled,
    phi: Compiled,
    gain: Compiled,
    axes: int,
    load: float,
    force: Compiled,
    noise: float,
) -> None:
    """What the sensor reads in the air are its zeros."""
    for i in range(3):
        if i == 1 and axes == 1:
            continue
        for j in range(STATES):
            phi[j] = 0.0
        phi[ZERO1 + i] = 1.0
        reading = load if i == 2 else force[i]
        correct(theta, d, u, phi, gain, reading - theta[ZERO1 + i], noise * noise)


@inlined
def along(
    theta: Compiled,
    d: Compiled,
    u: Compiled,
    phi: Compiled,
    gain: Compiled,
    at: Compiled,
    settings: Compiled,
    sample: Compiled,
) -> None:
    """The force against the slip: T = μ |u| (N − N₀) + c v − zero; `sample` = direction (2), |u|, load, v, T, step.

    What the bristles' form is off by is one number a turn, not one a sample: of the samples in which the tip goes a
    bristle's length, each says but its share.
    """
    a, b, bent, load, speed, resisting, step = sample
    slow = a * at[RATE1] + b * at[RATE2]
    for j in range(STATES):
        phi[j] = 0.0
    # what is not known of the values takes part where regressor and instrument differ
    phi[FRICTION], phi[VISCOUS] = (load - at[LOAD]) * bent, speed - slow
    apart = quadratic(STATES, u, d, phi)
    phi[FRICTION], phi[VISCOUS] = (at[LOAD] - theta[ZERO_NORMAL]) * bent, slow
    phi[ZERO1], phi[ZERO2] = -a, -b
    phi[ZERO_NORMAL] = -theta[FRICTION] * bent
    predicted = theta[FRICTION] * bent * (load - theta[ZERO_NORMAL]) + theta[VISCOUS] * speed
    error = resisting - (predicted - a * theta[ZERO1] - b * theta[ZERO2])
    turning = settings[3] * theta[FRICTION] * at[LOAD] * (1.0 - min(bent, 1.0))
    turning *= math.sqrt(max(settings[2] / max(abs(speed) * step, TINY), 1.0))
    variance = at[NOISE] + turning * turning + apart
    total = variance + quadratic(STATES, u, d, phi)
    normalised = error / math.sqrt(total)
    keep = 1.0 - 1.0 / PATIENCE
    at[TOGETHER] = keep * at[TOGETHER] + normalised * at[LAST_ERROR]
    at[SQUARES] = keep * at[SQUARES] + normalised * normalised
    at[LAST_ERROR] = normalised
    at[RESISTING] = keep * at[RESISTING] + predicted * predicted
    at[FAST] = keep * at[FAST] + speed * speed
    at[WEIGHTS] = keep * at[WEIGHTS] + 1.0
    if turning * turning + apart < at[NOISE]:
        at[LEARNT] = min(at[LEARNT] + 1.0, NOISE_MEMORY)
        own = error * error * variance / total - turning * turning - apart
        at[NOISE] = max(at[NOISE] + (own - at[NOISE]) / (at[LEARNT] + FIRM), 1e-12)
    correct(theta, d, u, phi, gain, error, variance)


@inlined
def learn(
    theta: Compiled,
    d: Compiled,
    u: Compiled,
    phi: Compiled,
    gain: Compiled,
    at: Compiled,
    settings: Compiled,
    sample: Compiled,
) -> int:
    """One sample in contact; `sample` = normal force, slip rates (2), tangential forces (2), step of time."""
    load, v1, v2, f1, f2, step = sample
    bent1 = (1.0 - ELASTIC) * at[BENT1] + at[AHEAD1] / settings[2] if settings[2] > 0.0 else v1
    bent2 = (1.0 - ELASTIC) * at[BENT2] + at[AHEAD2] / settings[2] if settings[2] > 0.0 else v2
    bent = math.sqrt(bent1 * bent1 + bent2 * bent2)
    slow = math.sqrt(at[RATE1] ** 2 + at[RATE2] ** 2) <= settings[0] or bent <= (
        LEAST_BENT if settings[2] > 0.0 else 0.0
    )
    code = NOT_SLIDING if slow or at[TOUCHED] < INSTRUMENT else VALID
    if code == VALID:
        a, b = bent1 / bent, bent2 / bent
        size = bent if settings[2] > 0.0 else 1.0
        along(theta, d, u, phi, gain, at, settings, (a, b, size, load, a * v1 + b * v2, -(a * f1 + b * f2), step))
    average(at, load, v1, v2)
    return code


@inlined
def judge(theta: Compiled, own1: float, own2: float, at: Compiled, accuracy: float, used: float) -> int:
    """Whether both values are as accurate as asked, and the innovations are noise."""
    if used <= RIPE:
        return STARTING
    coloured = at[TOGETHER] > CORRELATED * at[SQUARES]
    at[COLOURED] += 1.0 if coloured else 0.0
    if coloured or at[COLOURED] > LASTING * used:
        return MISFIT
    fast, resisting = math.sqrt(at[FAST] / at[WEIGHTS]), math.sqrt(at[RESISTING] / at[WEIGHTS])
    if NORMAL_95 * math.sqrt(own1) > accuracy * abs(theta[FRICTION]):
        return NOT_EXCITED
    if NORMAL_95 * math.sqrt(own2) * fast > accuracy * resisting:
        return NOT_EXCITED
    return VALID


@inlined
def pass_time(d: Compiled, u: Compiled, work: Compiled, at: Compiled, settings: Compiled, now: float) -> float:
    """Values and zeros walk until now, NaN where no time is known; returns the time since the last sample [s]."""
    step = settings[10]
    if not math.isnan(now):
        step = max(now - at[TIME], 0.0) if not math.isnan(at[TIME]) else step
        at[TIME] = now
    for i in range(STATES):
        walk = settings[5 + i] if i < ZERO1 else settings[8 if i == ZERO_NORMAL else 7]
        add_noise(STATES, u, d, i, walk * walk * step, work)
    return float(step)


@jit
def friction(
    shape: Compiled,
    state: Compiled,
    load: Compiled,
    slip: Compiled,
    force: Compiled,
    contact: Compiled,
    times: Compiled,
    settings: Compiled,
    window: Compiled,
    length: int,
    threshold: float,
    scratch: Compiled,
    out: Compiled,
) -> None:
    """All samples; `times` holds the time of each, or one NaN where none is known."""
    theta, d, u, phi, work, gain, at = views(state)
    gram, scale, cursor = window
    thetas, variances, innovations, noises, excitations, statuses, _ = out
    axes = slip.shape[1]
    for k in range(len(load)):
        v1, f1 = slip[k, 0], force[k, 0]
        v2, f2 = (slip[k, 1], force[k, 1]) if axes == 2 else (0.0, 0.0)
        innovations[k] = 0.0
        fine = abs(load[k]) < HUGE and abs(v1) < HUGE and abs(v2) < HUGE and abs(f1) < HUGE and abs(f2) < HUGE
        code, step = NOT_FINITE, 0.0
        if fine:  # nothing else changes anything that was learnt
            step = pass_time(d, u, work, at, settings, times[k if len(times) > 1 else 0])
            code = NO_CONTACT
        if fine and not contact[k]:
            lift(at)
            rest_zeros(theta, d, u, phi, gain, axes, load[k], force[k], settings[4])
        elif fine:
            bend(at, 0.5 * (v1 + at[LAST1]) * step, 0.5 * (v2 + at[LAST2]) * step, settings[2])
            if load[k] > settings[1]:
                code = learn(theta, d, u, phi, gain, at, settings, (load[k], v1, v2, f1, f2, step))
        if fine:
            at[LAST1], at[LAST2] = v1, v2
        own1, own2 = 0.0, 0.0
        for j in range(STATES):
            own1 += u[FRICTION, j] ** 2 * d[j]
            own2 += u[VISCOUS, j] ** 2 * d[j] if j >= VISCOUS else 0.0
        scratch[0, 0] = scratch[0, 1] = 0.0
        if code == VALID:
            state[-1] += 1.0
            innovations[k] = at[LAST_ERROR] * math.sqrt(at[NOISE])
            scratch[0, 0], scratch[0, 1] = load[k], math.sqrt(v1 * v1 + v2 * v2)
            code = judge(theta, own1, own2, at, settings[9], state[-1])
        if length > 0:
            excite(2, shape, gram, scale, cursor, length, scratch[0], scratch[1], scratch[3:])
            code = NOT_EXCITED if code == VALID and cursor[3] < threshold else code
        statuses[k], excitations[k], noises[k] = code, cursor[3], at[NOISE]
        thetas[k, 0], thetas[k, 1] = theta[FRICTION], theta[VISCOUS]
        # before there were residuals, nobody knows
        known = state[-1] > 0.0
        variances[k, 0], variances[k, 1] = (own1, own2) if known else (np.inf, np.inf)


@jit
def friction_once(t: float, shape: Compiled, store: Compiled) -> None:
    """One slip: load, slip rate and tangential force along each axis, flag of contact."""
    room = carve(shape, store)
    axes = (len(room.inputs) - 2) // 2
    room.time[0] = t
    friction(
        shape,
        room.state,
        room.inputs[:1],
        room.inputs[1 : 1 + axes].reshape(1, axes),
        room.inputs[1 + axes : 1 + 2 * axes].reshape(1, axes),
        room.inputs[1 + 2 * axes :],
        room.time,
        room.settings,
        room.window,
        room.length,
        room.threshold,
        room.scratch,
        room.out,
    )
    close(room.record, room.state[-1])
