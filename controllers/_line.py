"""The teleoperated line, compiled: master and slave in fine steps, controllers and line once a period."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from kinid.controllers import passivity, waves
from kinid.controllers.packets import Schedule
from kinid.kernels import contact_laws
from kinid.kernels.cached import cached

Array = NDArray[np.float64]

#: integration steps within a control period
FINE = 10
#: for one sample at a time
_kelvin_voigt = njit(cache=True)(contact_laws.kelvin_voigt)
_pay, _afford, _ease, _refill = passivity.pay, passivity.afford, passivity.ease, passivity.refill
_brake, _reconstruct = passivity.brake, waves.reconstruct
#: share of the tank's capacity that it is kept above: full damping there, none where it is full
KEPT = 0.9
#: methods by their number
IMPEDANCE, PASSIVATED, TANK, WAVE = 1, 2, 3, 4


class Line(NamedTuple):
    """Operator, devices and environment, as the compiled line takes them.

    mass [kg], damping [N·s/m]: of the master with the hand on it. hand_damping, hand_stiffness [N/m]: of the arm that
    moves it. slave_mass, slave_damping: of the slave. coupling_stiffness, coupling_damping: of its controller.
    environment_…: stiffness and damping of what it touches, believed_…: the same as the map has it.
    most_damping, plain_damping, brake_stiffness, capacity: of the passivity controllers, with and without a spring
    [N·s/m, N/m, J]. wave_impedance: [N·s/m]. period: [s].
    """

    mass: float
    damping: float
    hand_damping: float
    hand_stiffness: float
    slave_mass: float
    slave_damping: float
    coupling_stiffness: float
    coupling_damping: float
    environment_stiffness: float
    environment_damping: float
    believed_stiffness: float
    believed_damping: float
    most_damping: float
    plain_damping: float
    brake_stiffness: float
    capacity: float
    wave_impedance: float
    period: float


@njit  # not kept on disk: its own cache would not see a change of the law in another file
def _material(depth: float, rate: float, stiffness: float, damping: float, lasting: bool) -> float:
    """Force of a Kelvin-Voigt material [N], which doesn't pull unless contact lasts whatever happens."""
    force = _kelvin_voigt(depth, rate, stiffness, damping)
    return 0.0 if not lasting and (depth <= 0.0 or force < 0.0) else force


@njit
def protect(
    o: Line, tank: bool, stored: float, eased: float, held: float, wanted: float, way: float, rate: float
) -> tuple[float, float, float]:
    """What a passivity controller lets be of a force along one axis: share of it, force and damping that it adds.

    An observer damps while it has a debt. A tank damps where it isn't full: one that waits until it is nearly empty
    damps too little for a late force, which then takes all that there is, over and over.

    Args:
        stored: energy that the port took up, or that the tank holds [J]. eased: share of the last period. held: force
            that was added over it [N]. wanted: force against the motion [N]. way, rate: over the last period [m], now
            [m/s].
    """
    share = 1.0
    if tank:
        share = _afford(stored, -wanted * rate, abs(wanted), rate * rate, o.period, o.plain_damping)
        share = _ease(eased, share, o.period)
        # none where it is full, all of it from KEPT downwards
        added = _refill(stored - KEPT * o.capacity, 2.0 * (1.0 - KEPT) * o.capacity, o.most_damping)
    else:
        added = _pay(stored, rate * rate, o.period, o.most_damping)
    return share, _brake(held, way, o.brake_stiffness, added, o.period), added


@njit
def play(sums: Array, schedule: Schedule, given: Array, i: int, period: float) -> float:
    """The wave to play out over period i [√W]; what has been played out is counted up.

    Args:
        sums: integral and energy of what was sent, at each packet, (n, 2). given: of what was played out, (2,).
    """
    k = schedule.due[i]
    if k < 0:
        return 0.0
    wave = _reconstruct(sums[k, 0], sums[k, 1], given[0], given[1], k - i + schedule.buffer + 1, period)
    given[0] += wave * period
    given[1] += 0.5 * wave * wave * period
    return float(wave)


@njit
def send(sums: Array, i: int, wave: float, period: float) -> None:
    """Count up a wave that is sent in packet i, (n, 2)."""
    sums[i, 0], sums[i, 1] = wave * period, 0.5 * wave * wave * period
    if i > 0:
        sums[i, 0] += sums[i - 1, 0]
        sums[i, 1] += sums[i - 1, 1]


# one loop: what crosses the line, the controllers, both bodies in fine steps
@cached(passivity, contact_laws, waves)
def run(o: Line, forth: Schedule, back: Schedule, method: int, path: Array, moved: bool, out: Array) -> None:
    """Simulate as many periods as `path` has.

    Args:
        o: the line. forth, back: what arrives when.
        method: 0 direct, 1 impedance, 2 direct with observer and damper, 3 direct behind a tank, 4 waves.
        path: the intended place of the hand, (n,) [m]; where `moved`, the master's own, in contact that never opens.
        out: (7, n): master, slave [m], force felt, force of the environment [N], the mean over each period, energy
            taken up at the master's port [J], added damping [N·s/m], share of the force that is rendered.
    """
    n, period, b = path.shape[0], o.period, o.wave_impedance
    h, forces, eased, loose = period / FINE, np.zeros(n), 1.0, 1.0 / b if method == WAVE else 0.0
    x_m, v_m, x_s, v_s, seen = path[0], 0.0, path[0], 0.0, path[0]
    energy, tank, felt, held, port, before = 0.0, o.capacity, 0.0, 0.0, 0.0, path[0]
    sent, returned, given, taken = np.zeros((n, 2)), np.zeros((n, 2)), np.zeros(2), np.zeros(2)
    for i in range(n):
        if moved:
            x_m = path[i]
            v_m = (path[i + 1] - path[i - 1]) / (2 * period) if 0 < i < n - 1 else 0.0
        target, way = path[i], x_m - before  # of the hand; of the master over the last period
        rate = (path[i + 1] - path[i]) / period if i < n - 1 else 0.0
        energy += felt * way
        tank = min(o.capacity, tank + felt * way)
        before = out[0, i] = x_m
        added, wave = 0.0, 0.0
        # what crosses the line; a period's mean is known at its end
        late, newest = forth.newest[i], min(back.newest[i], i - 1)
        if method == WAVE:
            send(sent, i, (b * way / period + port) / np.sqrt(2.0 * b), period)
            wave = play(sent, forth, given, i, period)
            port = b * v_m - np.sqrt(2.0 * b) * play(returned, back, taken, i, period)
            felt = port + b * v_m  # a damper in which what comes back ends
            speed = np.sqrt(2.0 / b) * wave
        else:
            seen = out[0, late] if late >= 0 else path[0]
            speed = (seen - out[0, late - 1]) / period if late >= 1 else 0.0
            felt = forces[newest] if newest >= 0 else 0.0
        if method == IMPEDANCE:
            felt = _material(x_m, v_m, o.believed_stiffness, o.believed_damping, moved)
        elif method in (PASSIVATED, TANK):
            stored = tank if method == TANK else energy
            eased, held, added = protect(o, method == TANK, stored, eased, held, felt, way, v_m)
            felt = eased * felt + held
        out[2, i], out[4, i], out[5, i], out[6, i] = felt, energy, added, eased
        mean, pulled = 0.0, 0.0
        for _ in range(FINE):
            f_e = _material(x_s, v_s, o.environment_stiffness, o.environment_damping, moved)
            pull = o.coupling_stiffness * (seen - x_s) + o.coupling_damping * (speed - v_s)
            pull /= 1.0 + o.coupling_damping * loose
            mean += f_e
            pulled += pull
            v_s += h * (pull - o.slave_damping * v_s - f_e) / o.slave_mass
            x_s += h * v_s
            seen += h * (speed - loose * pull)
            if not moved:
                push = o.hand_stiffness * (target - x_m) + o.hand_damping * (rate - v_m)
                v_m += h * (push - o.damping * v_m - felt) / o.mass
                x_m += h * v_m
                target += h * rate
        send(returned, i, wave - np.sqrt(2.0 / b) * pulled / FINE, period)
        forces[i] = mean / FINE
        out[1, i], out[3, i] = x_s, forces[i]
