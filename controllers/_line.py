"""The teleoperated line, compiled: master and slave in fine steps, controllers and line once a period."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from kinid.controllers import passivity
from kinid.kernels import contact_laws
from kinid.kernels.cached import cached

Array = NDArray[np.float64]

#: integration steps within a control period
FINE = 10
#: for one sample at a time
_kelvin_voigt = njit(cache=True)(contact_laws.kelvin_voigt)
_pay, _afford, _ease, _refill = passivity.pay, passivity.afford, passivity.ease, passivity.refill


class Line(NamedTuple):
    """Operator, devices and environment, as the compiled line takes them.

    mass [kg], damping [N·s/m]: of the master with the hand on it. hand_damping, hand_stiffness [N/m]: of the arm that
    moves it. slave_mass, slave_damping: of the slave. coupling_stiffness, coupling_damping: of its controller.
    environment_…: stiffness and damping of what it touches, believed_…: the same as the map has it.
    most_damping, capacity: of the passivity controllers [N·s/m, J]. period: [s].
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
    capacity: float
    period: float


@njit  # not kept on disk: its own cache would not see a change of the law in another file
def _material(depth: float, rate: float, stiffness: float, damping: float, lasting: bool) -> float:
    """Force of a Kelvin-Voigt material [N], which doesn't pull unless contact lasts whatever happens."""
    force = _kelvin_voigt(depth, rate, stiffness, damping)
    return 0.0 if not lasting and (depth <= 0.0 or force < 0.0) else force


@cached(passivity, contact_laws)
def run(o: Line, delay: int, method: int, path: Array, moved: bool, out: Array) -> None:
    """Simulate as many periods as `path` has.

    Args:
        o: the line. delay: one-way, in periods.
        method: 0 direct, 1 impedance, 2 direct with observer and damper, 3 direct behind a tank.
        path: the intended place of the hand, (n,) [m]; where `moved`, the master's own, in contact that never opens.
        out: (7, n): master, slave [m], force felt, force of the environment [N], the mean over each period, energy
            taken up at the master's port [J], added damping [N·s/m], share of the force that is rendered.
    """
    n, period = path.shape[0], o.period
    h = period / FINE
    forces, eased = np.zeros(n), 1.0
    x_m, v_m, x_s, v_s = path[0], 0.0, path[0], 0.0
    energy, tank, felt, before = 0.0, o.capacity, 0.0, x_m
    for i in range(n):
        if moved:
            x_m = path[i]
            v_m = (path[i + 1] - path[i - 1]) / (2 * period) if 0 < i < n - 1 else 0.0
        target = path[i]  # of the hand
        rate = (path[i + 1] - path[i]) / period if i < n - 1 else 0.0
        energy += felt * (x_m - before)
        tank = min(o.capacity, tank + felt * (x_m - before))
        before = x_m
        out[0, i] = x_m
        # what crosses the line
        late = i - delay
        seen = out[0, late] if late >= 0 else path[0]
        speed = (seen - out[0, late - 1]) / period if late >= 1 else 0.0
        if method == 1:
            felt = _material(x_m, v_m, o.believed_stiffness, o.believed_damping, moved)
        else:
            # a period's mean is known at its end
            newest = late if delay > 0 else i - 1
            felt = forces[newest] if newest >= 0 else 0.0
        added, share = 0.0, 1.0
        if method == 2:
            added = _pay(energy, v_m * v_m, period, o.most_damping)
            felt += added * v_m
        elif method == 3:
            share = _afford(tank, -felt * v_m, abs(felt), v_m * v_m, period, o.most_damping)
            share = eased = _ease(eased, share, period)
            added = _refill(tank, o.capacity, o.most_damping)
            felt = share * felt + added * v_m
        out[2, i], out[4, i], out[5, i], out[6, i] = felt, energy, added, share
        mean = 0.0
        for _ in range(FINE):
            f_e = _material(x_s, v_s, o.environment_stiffness, o.environment_damping, moved)
            mean += f_e
            pull = o.coupling_stiffness * (seen - x_s) + o.coupling_damping * (speed - v_s)
            v_s += h * (pull - o.slave_damping * v_s - f_e) / o.slave_mass
            x_s += h * v_s
            seen += h * speed
            if not moved:
                push = o.hand_stiffness * (target - x_m) + o.hand_damping * (rate - v_m)
                v_m += h * (push - o.damping * v_m - felt) / o.mass
                x_m += h * v_m
                target += h * rate
        forces[i] = mean / FINE
        out[1, i], out[3, i] = x_s, forces[i]
