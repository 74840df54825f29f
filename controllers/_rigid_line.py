"""The teleoperated line in six degrees of freedom, compiled: two rigid bodies, packets both ways.

Master and slave are rigid bodies, held, coupled and damped alike about all axes: a rotation counts as the way of a
lever ℓ, so that a mass m, a stiffness k and a damping b along an axis are m ℓ², k ℓ² and b ℓ² about it. Each touches
the surface z = 0 with a tip that stands out of the body: a force is a moment, too, and a rotation a way of the tip.
Along the surface the material is a spring of two thirds of its normal stiffness (R. D. Mindlin, J. Applied Mechanics
16, 1949, incompressible) that slips on the friction cone. Twists and wrenches are in base axes, about the body's
origin.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from kinid.controllers import _line, passivity, waves
from kinid.controllers._line import FINE, IMPEDANCE, PASSIVATED, TANK, WAVE, Line, play, protect, send
from kinid.controllers.packets import Schedule
from kinid.kernels.cached import cached

Array = NDArray[np.float64]

#: tangential over normal stiffness
SHEAR = 2.0 / 3.0
# places in a body's state (13,): position, quaternion (w, x, y, z), twist
TURN, TWIST = 3, 7


class Body(NamedTuple):
    """lever: ℓ [m]. tip: of both bodies, in their axes, (3,) [m]. friction: coefficient of material and map alike."""

    lever: float
    tip: Array
    friction: float


@njit
def _turned(s: Array, v: Array, out: Array) -> None:
    """A vector of the body in base axes."""
    w, x, y, z = s[3], s[4], s[5], s[6]
    a, b, c = 2 * (y * v[2] - z * v[1]), 2 * (z * v[0] - x * v[2]), 2 * (x * v[1] - y * v[0])
    out[0] = v[0] + w * a + y * c - z * b
    out[1] = v[1] + w * b + z * a - x * c
    out[2] = v[2] + w * c + x * b - y * a


@njit
def _step(s: Array, h: float) -> None:
    """Move a body on by its twist; the quaternion is kept at length 1."""
    for a in range(3):
        s[a] += h * s[TWIST + a]
    w, x, y, z = s[3], s[4], s[5], s[6]
    p, q, r = 0.5 * h * s[10], 0.5 * h * s[11], 0.5 * h * s[12]
    s[3], s[4] = w - p * x - q * y - r * z, x + p * w + q * z - r * y
    s[5], s[6] = y + q * w + r * x - p * z, z + r * w + p * y - q * x
    size = np.sqrt(s[3] ** 2 + s[4] ** 2 + s[5] ** 2 + s[6] ** 2)
    for a in range(TURN, TWIST):
        s[a] /= size


@njit
def _apart(s: Array, t: Array, out: Array) -> None:
    """From body s to t: way [m] and rotation vector [rad], base axes, (6,)."""
    for a in range(3):
        out[a] = t[a] - s[a]
    w = t[3] * s[3] + t[4] * s[4] + t[5] * s[5] + t[6] * s[6]
    x = -t[3] * s[4] + t[4] * s[3] - t[5] * s[6] + t[6] * s[5]
    y = -t[3] * s[5] + t[4] * s[6] + t[5] * s[3] - t[6] * s[4]
    z = -t[3] * s[6] - t[4] * s[5] + t[5] * s[4] + t[6] * s[3]
    size = np.sqrt(x * x + y * y + z * z)
    ratio = 2.0 if size < 1e-12 else 2.0 * np.arctan2(size, abs(w)) / size
    ratio = ratio if w >= 0.0 else -ratio
    out[3], out[4], out[5] = ratio * x, ratio * y, ratio * z


@njit
def _touch(s: Array, body: Body, stiffness: float, damping: float, anchor: Array, out: Array) -> float:
    """Wrench of the surface on a body; its tip's depth [m]. anchor: x, y, and 1 while it is touched, (3,)."""
    r, n = np.empty(3), 0.0
    _turned(s, body.tip, r)
    depth = float(-(s[2] + r[2]))
    out[:] = 0.0
    v_x, v_y = s[7] + s[11] * r[2] - s[12] * r[1], s[8] + s[12] * r[0] - s[10] * r[2]
    n = stiffness * depth - damping * (s[9] + s[10] * r[1] - s[11] * r[0])
    if depth <= 0.0 or n <= 0.0:
        anchor[2] = 0.0
        return depth
    x, y = s[0] + r[0], s[1] + r[1]
    if anchor[2] == 0.0:
        anchor[0], anchor[1], anchor[2] = x, y, 1.0
    pull = SHEAR * stiffness * np.hypot(x - anchor[0], y - anchor[1])
    held = SHEAR * damping
    if pull > body.friction * n:  # it slips, and follows on the cone
        share, held = body.friction * n / pull, 0.0
        anchor[0], anchor[1] = x - share * (x - anchor[0]), y - share * (y - anchor[1])
    out[0] = -SHEAR * stiffness * (x - anchor[0]) - held * v_x
    out[1] = -SHEAR * stiffness * (y - anchor[1]) - held * v_y
    out[2] = n
    out[3], out[4], out[5] = r[1] * n - r[2] * out[1], r[2] * out[0] - r[0] * n, r[0] * out[1] - r[1] * out[0]
    return depth


class State(NamedTuple):
    """What changes: bodies and set-point (13,); anchors of the slave's tip and of the map's image at the master (3,);
    wrench felt [N, N·m], way of the master over the last period [m, rad], means of the coupling's and the environment's
    wrench over it, the set-point's twist where nothing pulls at it, (6,).
    """

    master: Array
    slave: Array
    target: Array
    anchor: Array
    image: Array
    felt: Array
    moved: Array
    coupling: Array
    environment: Array
    wave: Array


class Waves(NamedTuple):
    """Integral and energy of what was sent forth and back, (6, n, 2), and of what was played out, (6, 2); the wrench at
    the master's port of the line, and the wave that the slave gets now, (6,).
    """

    sent: Array
    returned: Array
    given: Array
    taken: Array
    port: Array
    now: Array


@njit
def _fresh(start: Array) -> tuple[Array, Array, Array, Array, Array, Array, Array, Array, Array, Array]:
    """What `State` begins with."""
    return (
        start.copy(),
        start.copy(),
        start.copy(),
        np.zeros(3),
        np.zeros(3),
        np.zeros(6),
        np.zeros(6),
        np.zeros(6),
        np.zeros(6),
        np.zeros(6),
    )


@njit
def _depth(s: Array, body: Body) -> float:
    """Of a body's tip below the surface [m]."""
    r = np.empty(3)
    _turned(s, body.tip, r)
    return float(-(s[2] + r[2]))


@njit
def _period(o: Line, body: Body, z: State, scale: Array, loose: float, hand: Array) -> None:
    """Both bodies over one period.

    Args:
        loose: mobility of the set-point along an axis [m/s/N], that of a wave line; 0 where it is led. hand: where the
            hand wants the master to be, state (13,).
    """
    h = o.period / FINE
    e, f, pull = np.empty(6), np.empty(6), np.empty(6)
    z.moved[:], z.coupling[:], z.environment[:] = 0.0, 0.0, 0.0
    for _ in range(FINE):
        _touch(z.slave, body, o.environment_stiffness, o.environment_damping, z.anchor, f)
        _apart(z.slave, z.target, e)
        for a in range(6):
            spring = o.coupling_stiffness * e[a] + o.coupling_damping * (z.wave[a] - z.slave[TWIST + a])
            pull[a] = scale[a] * spring / (1.0 + o.coupling_damping * loose)
            z.target[TWIST + a] = z.wave[a] - loose * pull[a] / scale[a]
            z.coupling[a] += pull[a] / FINE
            z.environment[a] += f[a] / FINE
            drag = scale[a] * o.slave_damping * z.slave[TWIST + a]
            z.slave[TWIST + a] += h * (pull[a] - drag + f[a]) / (scale[a] * o.slave_mass)
        _step(z.slave, h)
        _step(z.target, h)
        _apart(z.master, hand, e)
        for a in range(6):
            push = o.hand_stiffness * e[a] + o.hand_damping * (hand[TWIST + a] - z.master[TWIST + a])
            push = scale[a] * (push - o.damping * z.master[TWIST + a])
            z.master[TWIST + a] += h * (push + z.felt[a]) / (scale[a] * o.mass)
            z.moved[a] += h * z.master[TWIST + a]
        _step(z.master, h)


@njit
def _exchange(o: Line, z: State, scale: Array, waves_: Waves, forth: Schedule, back: Schedule, i: int) -> None:
    """Send and play out waves of all axes: the set-point's twist and the wrench that is felt."""
    for a in range(6):
        b = o.wave_impedance * scale[a]
        root = np.sqrt(2.0 * b)
        send(waves_.sent[a], i, (b * z.moved[a] / o.period + waves_.port[a]) / root, o.period)
        waves_.now[a] = play(waves_.sent[a], forth, waves_.given[a], i, o.period)
        z.wave[a] = 2.0 * waves_.now[a] / root
        waves_.port[a] = b * z.master[TWIST + a] - root * play(waves_.returned[a], back, waves_.taken[a], i, o.period)
        z.felt[a] = -waves_.port[a] - b * z.master[TWIST + a]


@njit
def _answer(o: Line, z: State, scale: Array, waves_: Waves, i: int) -> None:
    """Send back what the set-point met over the last period."""
    for a in range(6):
        root = np.sqrt(2.0 * o.wave_impedance * scale[a])
        send(waves_.returned[a], i, waves_.now[a] - 2.0 / root * z.coupling[a], o.period)


@njit
def _protect(o: Line, z: State, scale: Array, tank: bool, stored: Array, eased: Array, held: Array) -> None:
    """A passivity controller on each axis, in units of the translations: an account each, or one tank for all."""
    for a in range(6):
        unit = np.sqrt(scale[a])
        way, rate = unit * z.moved[a], unit * z.master[TWIST + a]
        eased[a], held[a], _ = protect(o, tank, stored[a], eased[a], held[a], -z.felt[a] / unit, way, rate)
        z.felt[a] = eased[a] * z.felt[a] - unit * held[a]


@cached(_line, passivity, waves)
def run(o: Line, body: Body, forth: Schedule, back: Schedule, method: int, path: Array, out: Array) -> None:
    """Simulate as many periods as `path` has.

    Args:
        o: the line; stiffness and damping of materials along the normal. forth, back: what arrives when. method: see
            `kinid.controllers._line.run`.
        path: where the hand wants the master to be, states (n, 13), in base axes.
        out: (n, 22): of master and slave position [m] and rotation vector [rad], 6 each; wrench felt [N, N·m], 6; depth
            of both tips [m]; energy that the master's port took up, all axes [J]; normal force of the material [N].
    """
    n, scale, at_rest = len(path), np.ones(6), np.zeros(13)
    scale[3:], at_rest[TURN] = body.lever**2, 1.0
    z = State(*_fresh(path[0]))
    w = Waves(np.zeros((6, n, 2)), np.zeros((6, n, 2)), np.zeros((6, 2)), np.zeros((6, 2)), np.zeros(6), np.zeros(6))
    states, wrenches = np.zeros((n, 13)), np.zeros((n, 6))
    stored, tank, eased, held = np.zeros(6), np.full(6, o.capacity), np.ones(6), np.zeros(6)
    loose = 1.0 / o.wave_impedance if method == WAVE else 0.0
    for i in range(n):
        stored -= z.felt * z.moved
        tank[:] = min(o.capacity, tank[0] - (z.felt * z.moved).sum())
        states[i] = z.master
        late, newest = forth.newest[i], min(back.newest[i], i - 1)
        if method == WAVE:
            _exchange(o, z, scale, w, forth, back, i)
        else:
            z.target[:] = states[late] if late >= 0 else path[0]
            z.wave[:] = z.target[TWIST:]
            z.felt[:] = wrenches[newest]  # before the first packet the last one, which is still 0
        if method == IMPEDANCE:
            _touch(z.master, body, o.believed_stiffness, o.believed_damping, z.image, z.felt)
        elif method in (PASSIVATED, TANK):
            _protect(o, z, scale, method == TANK, tank if method == TANK else stored, eased, held)
        _apart(at_rest, z.master, out[i, 0:6])
        _apart(at_rest, z.slave, out[i, 6:12])
        out[i, 12:18], out[i, 18], out[i, 19] = z.felt, _depth(z.master, body), _depth(z.slave, body)
        out[i, 20] = stored.sum()
        _period(o, body, z, scale, loose, path[i])
        out[i, 21], wrenches[i] = z.environment[2], z.environment
        _answer(o, z, scale, w, i)
