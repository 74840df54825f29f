"""Compiled: the watch over the contact frame and over what both estimators expect there, sample by sample.

The watch is one float64 array: settings (`SETTINGS` of them), the range of each channel of the wrench (6), then state.
Its bits are those of `kinid.live.events`.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from kinid.kernels import chain
from kinid.kernels.types import Compiled
from kinid.live.events import ABOVE, CHANGE, DIVERGENCE, EXCITATION, LEAVE, RUBS, SATURATED, TOUCH

#: settings: normal force from which the tool touches, and below which it has left [N]; standard deviation of a force
#: [N]; drift and threshold of the cumulated sums, in standard deviations; time [s] that an estimate has to stand before
#: changes are looked for; share of the reading that a model may leave unexplained; share by which a force may be above;
#: share by which force over depth may change on the way
ON, OFF, NOISE, DRIFT, THRESHOLD, SETTLED, UNEXPLAINED, ABOVE_SHARE, SECANT_SHARE = range(9)
SETTINGS = 9
RANGE = SETTINGS
#: state: whether the tool touches; samples towards the other; time since which the normal law's estimate, and that of
#: friction, stand [s]; sums upwards and downwards of the normal force and of friction; mean squares of innovation and
#: force; since when something is (and is reported): divergence, no excitation, saturation, a force above
TOUCHING, TOWARDS, NORMAL_SINCE, FRICTION_SINCE = range(SETTINGS + 6, SETTINGS + 10)
SUMS = SETTINGS + 10
MEAN_INNOVATION, MEAN_FORCE = SUMS + 4, SUMS + 5
SINCE = SUMS + 6
REPORTED = SINCE + 4
EXCITED = REPORTED + 4
MEAN_SQUARES = EXCITED + 1
LAST_TIME = MEAN_SQUARES + 2
#: of a ratio on the way: its logarithm so far, and just now, and mean square of their difference; time on that way, and
#: since it has changed [s]
FAR, NEAR, SWING, ON_WAY, CHANGED = range(5)
#: those of force over depth, and of tangential over normal force; and the way's velocity along both tangents [m/s]
DEPTH_RATIO, FRICTION_RATIO, ALONG1, ALONG2 = LAST_TIME + 1, LAST_TIME + 6, LAST_TIME + 11, LAST_TIME + 12
#: of the law on the way: logarithm of force over depth to its power, without damping, now; time in touch [s]; the
#: exponent and damping over stiffness so far
LAW_RATIO, IN_TOUCH, EXPONENT, LOSS = range(4)
#: those of the sample that estimates rest on, and of the present one; of the latter its ratio in this touch so far, and
#: mean square of what that leaves; then of force over depth alone: its logarithm, that swing
LATE_LAW, LAW = LAST_TIME + 13, LAST_TIME + 17
USUAL_FORCE, FORCE_SWING, USUAL_SECANT, SECANT_SWING = range(LAST_TIME + 21, LAST_TIME + 25)
#: way since changes are looked for anew [m]; time of the last sample that they were sought in [s]
SLID, LATE_TIME = LAST_TIME + 25, LAST_TIME + 26
#: normal force that the law expects of this sample, NaN where it expects none [N]
EXPECTED = LAST_TIME + 27
#: the last stretch of time in which a channel was at the end of its range, from and to [s]
CUT_FROM, CUT_TO = LAST_TIME + 28, LAST_TIME + 29
PLACES = LAST_TIME + 30

#: samples in a row that make or end a touch; time constants of the mean squares that tell a divergence, and of the
#: usual size of innovations [s]
ROW, MEMORY, USUAL = 3, 0.1, 0.3
#: a channel that comes back to the end of its range within this was there all the while [s]
CUT_AGAIN = 0.02
#: what lasts so long is reported: divergence, no excitation, saturation, a force above [s]
LASTING = (0.1, 1.0, 0.0, 0.005)
#: an excitation that stood for less, altogether, is none that can be lost [s]
STOOD = 0.1
#: a channel is at the end of its range from this share of it on
FULL = 0.98
#: contact isn't sought further outside the material than this [m]
REACH = 5e-3
#: on the way is who slides at least so fast [m/s], so deep [m]; bristles bend on its first piece [m], where friction
#: grows
SLIDING, DEEP, BENDING = 5e-4, 3e-4, 2e-3
#: time constants of what force over depth was on the way, and is now; how long the way has to be before, and the change
#: has to last [s]
FAR_TIME, NEAR_TIME, WAY, LASTS = 1.0, 0.005, 0.4, 0.004
#: a depth that shakes makes force over depth swing, by damping: a change is beyond so many times its rms on the way
BEYOND_SWING = 3.0
#: damping over stiffness of a material that rests within so long is no longer damping [s]
LONGEST = 0.1
#: damping takes a force down to this share of it at most
LEAST_LEFT = 0.2
#: the way turns where it leaves its direction by 20°, or its speed by this share; both follow it so slowly [s]
TURNED, BRAKED, FOLLOWS = 0.94, 0.3, 0.05
#: an innovation counts for so many standard deviations at most, so that no single sample raises an alarm
CLIP = 6.0
#: whatever was usual, no law is trusted to less than this share of the force that it explains
ALWAYS = 0.05
#: an expected force is so many times the one that was read at most: the first values of a law may be any
WILD = 10.0
VALID, NOT_EXCITED, NO_CONTACT, NOT_SLIDING = 0, 2, 3, 7

_INNOVATION, _STATUS = -6, -3


@njit(error_model="numpy", forceinline=True)
def _leave_way(w: Compiled) -> None:
    """The next way is another one."""
    for ratio in (DEPTH_RATIO, FRICTION_RATIO):
        w[ratio + ON_WAY] = w[ratio + CHANGED] = 0.0


@njit(error_model="numpy", forceinline=True)
def _begin(w: Compiled) -> None:
    """Look for changes anew, once the estimates have settled."""
    w[SUMS : SUMS + 4] = 0.0
    w[NORMAL_SINCE] = w[FRICTION_SINCE] = np.inf
    w[SLID] = 0.0
    _leave_way(w)


@njit(error_model="numpy", forceinline=True)
def _touch(quantities: Compiled, w: Compiled) -> int:
    """Touch and leave, each after some samples in a row."""
    force, depth = quantities[chain.NORMAL], quantities[chain.DEPTH]
    gone = force < w[OFF] or depth < -REACH
    away = gone if w[TOUCHING] > 0.0 else force > w[ON] and depth > -REACH
    w[TOWARDS] = w[TOWARDS] + 1.0 if away else 0.0
    if w[TOWARDS] < ROW:
        return 0
    w[TOWARDS] = 0.0
    w[TOUCHING] = 1.0 - w[TOUCHING]
    _begin(w)
    w[MEAN_INNOVATION] = w[MEAN_FORCE] = w[EXCITED] = 0.0
    w[MEAN_SQUARES : MEAN_SQUARES + 2] = 0.0
    return TOUCH if w[TOUCHING] > 0.0 else LEAVE


@njit(error_model="numpy", forceinline=True)
def _expect(quantities: Compiled, normal: Compiled, w: Compiled) -> float:
    """Normal force less what the law makes of this sample's depth and rate [N]; NaN where nothing touches."""
    depth, force, parameters = quantities[chain.DEPTH], quantities[chain.NORMAL], (len(normal) - 6) // 2
    w[EXPECTED] = np.nan
    if depth > 0.0 and force > w[ON]:
        if parameters > 2:
            law = depth ** normal[2] * (normal[0] + normal[1] * quantities[chain.DEPTH_RATE])
        else:
            law = normal[0] * depth + normal[1] * quantities[chain.DEPTH_RATE]
        w[EXPECTED] = min(max(law, -WILD * force), WILD * force)
    return float(force - w[EXPECTED])


@njit(error_model="numpy", forceinline=True)
def _cumulate(
    t: float, dt: float, load: float, begun: bool, record: Compiled, w: Compiled, since: int, sums: int, squares: int
) -> bool:
    """Cumulated sums of one estimator's innovations (E. S. Page, Biometrika 41, 1954), each over its usual size.

    They count once it has `begun`. The usual size follows slowly what is left of the innovations: a law that doesn't
    quite fit is no border.
    """
    status = int(record[len(record) + _STATUS])
    if status in (NO_CONTACT, NOT_SLIDING):
        w[since] = np.inf
        w[sums] = w[sums + 1] = w[squares] = 0.0
        return False
    innovation = record[len(record) + _INNOVATION]
    if innovation == 0.0:  # nothing was learnt from this sample
        return False
    if w[since] == np.inf:
        w[since] = t
    # a mean of what there was: one that begins at zero is half the usual size after the time that it settles for
    share = dt / (min(USUAL, t - w[since]) + dt) if dt > 0.0 else 0.0
    if t - w[since] < w[SETTLED] or not begun:
        w[squares] += share * (innovation * innovation - w[squares])
        return False
    size = max(np.sqrt(w[squares]), w[NOISE], ALWAYS * abs(load))
    z = min(max(innovation / size, -CLIP), CLIP)
    # with the clipped one: what is being reported mustn't hide itself
    w[squares] += share * (size * size * z * z - w[squares])
    w[sums] = max(0.0, w[sums] + z - w[DRIFT])
    w[sums + 1] = max(0.0, w[sums + 1] - z - w[DRIFT])
    return bool(max(w[sums], w[sums + 1]) >= w[THRESHOLD])


@njit(error_model="numpy", forceinline=True)
def _turn(dt: float, quantities: Compiled, w: Compiled) -> None:
    """Begin anew where the way turns: friction, and what the material remembers, are others for a while."""
    v1, v2 = quantities[chain.SLIP_RATE1], quantities[chain.SLIP_RATE2]
    before, speed = math.hypot(w[ALONG1], w[ALONG2]), math.hypot(v1, v2)
    share = dt / (dt + FOLLOWS)
    straight = v1 * w[ALONG1] + v2 * w[ALONG2] >= TURNED * speed * before
    w[ALONG1] += share * (v1 - w[ALONG1])
    w[ALONG2] += share * (v2 - w[ALONG2])
    w[SLID] += speed * dt
    if max(speed, before) > SLIDING and not (straight and abs(speed - before) < BRAKED * max(speed, before)):
        _begin(w)


@njit(error_model="numpy", forceinline=True)
def _follow_law(dt: float, quantities: Compiled, normal: Compiled, w: Compiled, law: Compiled) -> bool:
    """The mean over a second of a law's exponent n and damping, and ln f − n ln x of the force without its damping.

    Returns:
        Whether the tip is deep enough in the material for it.
    """
    depth, force, parameters = quantities[chain.DEPTH], quantities[chain.NORMAL], (len(normal) - 6) // 2
    if w[TOUCHING] <= 0.0:
        law[IN_TOUCH] = 0.0
        return False
    if depth < DEEP or force < w[ON]:
        return False
    law[IN_TOUCH] += dt
    share = dt / (min(FAR_TIME, law[IN_TOUCH]) + dt)
    first = law[IN_TOUCH] == dt
    exponent = min(max(normal[2], 0.5), 3.0) if parameters > 2 else 1.0
    loss = min(max(normal[1] / normal[0], 0.0), LONGEST) if normal[0] > 0.0 else 0.0
    law[EXPONENT] = exponent if first else law[EXPONENT] + share * (exponent - law[EXPONENT])
    law[LOSS] = loss if first else law[LOSS] + share * (loss - law[LOSS])
    # Kelvin-Voigt loses f by the rate whatever the depth, Hunt-Crossley in parts of f
    damping = law[LOSS] * quantities[chain.DEPTH_RATE] / (1.0 if parameters > 2 else depth)
    law[LAW_RATIO] = math.log(force) - law[EXPONENT] * math.log(depth) - math.log(max(1.0 + damping, LEAST_LEFT))
    return True


@njit(error_model="numpy", forceinline=True)
def _passes(dt: float, quantities: Compiled, is_deep: bool, w: Compiled) -> tuple[bool, bool]:
    """Whether force over the law of the depth, and friction over force, have changed on the way.

    A border that is as wide as the tip follows no single sample, and of a small change the innovations say little.
    """
    force = quantities[chain.NORMAL]
    speed = math.hypot(quantities[chain.SLIP_RATE1], quantities[chain.SLIP_RATE2])
    if w[TOUCHING] <= 0.0:
        _leave_way(w)
        return False, False
    if speed < SLIDING or not is_deep:
        return False, False
    changed = _ratio_changed(dt, w[LATE_LAW + LAW_RATIO], w[DEPTH_RATIO:], w)
    friction = math.hypot(quantities[chain.TANGENT1], quantities[chain.TANGENT2])
    return changed, friction > w[ON] and _ratio_changed(dt, math.log(friction / force), w[FRICTION_RATIO:], w)


@njit(error_model="numpy", forceinline=True)
def _ratio_changed(dt: float, ratio: float, at: Compiled, w: Compiled) -> bool:
    """Whether the logarithm of a ratio has left its mean on the way, by more than it usually swings."""
    if at[ON_WAY] == 0.0:
        at[FAR] = at[NEAR] = ratio
        at[SWING] = 0.0
    at[ON_WAY] += dt
    at[NEAR] += dt / (NEAR_TIME + dt) * (ratio - at[NEAR])
    share = dt / (min(FAR_TIME, at[ON_WAY]) + dt)
    at[FAR] += share * (ratio - at[FAR])
    away = at[NEAR] - at[FAR]
    usual = BEYOND_SWING * math.sqrt(at[SWING])
    at[SWING] += share * (away * away - at[SWING])
    if abs(away) < max(w[SECANT_SHARE], usual):
        at[CHANGED] = 0.0
        return False
    at[CHANGED] += dt
    return bool(at[CHANGED] >= LASTS and at[ON_WAY] >= WAY)


@njit(error_model="numpy", forceinline=True)
def _is_above(dt: float, quantities: Compiled, w: Compiled) -> bool:
    """Whether the force is above what this touch has shown at that depth: a stop behind the material, a collision.

    A recursive estimate follows within tens of samples and would call any force its own. What is held against is the
    mean over a second of `LAW_RATIO`; and of ln f − ln x alone, for exponent and damping may be wrong.
    """
    depth, force, now = quantities[chain.DEPTH], quantities[chain.NORMAL], w[LAW + LAW_RATIO]
    share = dt / (min(FAR_TIME, w[LAW + IN_TOUCH]) + dt)
    secant = math.log(force / depth)
    if w[LAW + IN_TOUCH] <= w[SETTLED]:
        w[USUAL_FORCE], w[FORCE_SWING] = now, 0.0
        w[USUAL_SECANT], w[SECANT_SWING] = secant, 0.0
    beyond, further = now - w[USUAL_FORCE], secant - w[USUAL_SECANT]
    allowed = math.log1p(w[ABOVE_SHARE]) + 5.0 * w[NOISE] / force
    above = beyond > allowed + math.sqrt(w[FORCE_SWING]) and further > allowed + math.sqrt(w[SECANT_SWING])
    w[USUAL_FORCE] += share * beyond
    w[USUAL_SECANT] += share * further
    if not above:  # what is being reported mustn't hide itself
        w[FORCE_SWING] += share * (beyond * beyond - w[FORCE_SWING])
        w[SECANT_SWING] += share * (further * further - w[SECANT_SWING])
    return bool(above and w[LAW + IN_TOUCH] > w[SETTLED])


@njit(error_model="numpy", forceinline=True)
def _lasts(t: float, which: int, is_so: bool, longest: float, w: Compiled) -> bool:
    """Whether something has been so for its time, and hasn't been reported since."""
    if not is_so:
        w[SINCE + which] = np.inf
        w[REPORTED + which] = 0.0
        return False
    if w[SINCE + which] == np.inf:
        w[SINCE + which] = t
    if w[REPORTED + which] > 0.0 or t - w[SINCE + which] < longest:
        return False
    w[REPORTED + which] = 1.0
    return True


@njit(error_model="numpy", forceinline=True)
def seek_change(t: float, quantities: Compiled, normal: Compiled, friction: Compiled, w: Compiled) -> int:
    """Bits of a change that a sample shows which estimates have just been given: another material.

    Not the present one: what its rates and accelerations lack looks like a change where the depth shakes.
    """
    force = quantities[chain.NORMAL]
    if not abs(force) < np.inf:
        return 0
    dt = min(max(t - w[LATE_TIME], 0.0), MEMORY)
    w[LATE_TIME] = t
    _turn(dt, quantities, w)
    changed = _cumulate(t, dt, force, True, normal, w, NORMAL_SINCE, SUMS, MEAN_SQUARES)
    slides, rubs = w[SLID] > BENDING, math.hypot(quantities[chain.TANGENT1], quantities[chain.TANGENT2])
    rubs_otherwise = _cumulate(t, dt, rubs, slides, friction, w, FRICTION_SINCE, SUMS + 2, MEAN_SQUARES + 1)
    is_deep = _follow_law(dt, quantities, normal, w, w[LATE_LAW : LATE_LAW + 4])
    pressed, rubbed = _passes(dt, quantities, is_deep, w)
    changed |= pressed
    rubs_otherwise |= rubbed
    if not (changed or rubs_otherwise):
        return 0
    _begin(w)
    if w[TOUCHING] <= 0.0:
        return 0
    return CHANGE if changed else CHANGE | RUBS


@njit(error_model="numpy", forceinline=True)
def is_cut(t: float, w: Compiled) -> bool:
    """Whether a channel was at the end of its range then: what the sensor would have read nobody knows."""
    return bool(w[CUT_FROM] <= t <= w[CUT_TO])


@njit(error_model="numpy", forceinline=True)
def watch(t: float, wrench: Compiled, quantities: Compiled, normal: Compiled, w: Compiled) -> Compiled:
    """Bits of the other events, of the present sample."""
    event_bits = 0
    full = False
    for i in range(6):
        full |= abs(wrench[i]) >= FULL * w[RANGE + i]
    if _lasts(t, 2, full, LASTING[2], w):
        event_bits |= SATURATED
    if full:
        w[CUT_FROM] = w[CUT_FROM] if t - w[CUT_TO] < CUT_AGAIN else t
        w[CUT_TO] = t
    force = quantities[chain.NORMAL]
    if full or not abs(force) < np.inf:
        w[EXPECTED] = np.nan
        return event_bits
    dt = min(max(t - w[LAST_TIME], 0.0), MEMORY)
    w[LAST_TIME] = t
    event_bits |= _touch(quantities, w)
    touching = w[TOUCHING] > 0.0
    share = dt / (dt + MEMORY)
    innovation = _expect(quantities, normal, w)
    is_deep = _follow_law(dt, quantities, normal, w, w[LAW : LAW + 4])
    status = int(normal[len(normal) + _STATUS])
    settled = touching and t - w[NORMAL_SINCE] > w[SETTLED]
    if touching and not math.isnan(innovation):
        w[MEAN_INNOVATION] += share * (innovation * innovation - w[MEAN_INNOVATION])
        w[MEAN_FORCE] += share * (force * force - w[MEAN_FORCE])
    wrong = settled and w[MEAN_INNOVATION] > max(
        w[UNEXPLAINED] * w[UNEXPLAINED] * w[MEAN_FORCE], 25.0 * w[NOISE] * w[NOISE]
    )
    if _lasts(t, 0, wrong, LASTING[0], w):
        event_bits |= DIVERGENCE
    if touching and status == VALID:
        w[EXCITED] += dt
    if _lasts(t, 1, touching and status == NOT_EXCITED and w[EXCITED] >= STOOD, LASTING[1], w):
        event_bits |= EXCITATION
        w[EXCITED] = 0.0
    if _lasts(t, 3, is_deep and _is_above(dt, quantities, w), LASTING[3], w):
        event_bits |= ABOVE
    return event_bits
