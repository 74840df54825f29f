"""The teleoperated line, compiled: master and slave in fine steps, controllers and line once a period."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from kinid.controllers import passivity
from kinid.kernels.cached import cached

Array = NDArray[np.float64]

#: integration steps within a control period
FINE = 10
_pay, _afford, _ease, _refill = passivity.pay, passivity.afford, passivity.ease, passivity.refill


@cached(passivity)
def run(p: Array, delay: int, method: int, path: Array, moved: bool, out: Array) -> None:
    """Simulate as many periods as `path` has.

    Args:
        p: mass, damping of the master; damping, stiffness of the hand; mass, damping of the slave; stiffness, damping
            of its coupling; K, B of the environment; K, B that the map believes; most damping; capacity of the tank;
            period.
        delay: one-way, in periods. method: 0 direct, 1 impedance, 2 direct with observer and damper, 3 direct behind a
            tank.
        path: the intended place of the hand, (n,) [m]; where `moved`, the master's own, in contact that never opens.
        out: (7, n): master, slave [m], force felt [N], force of the environment [N], energy taken up at the master's
            port [J], added damping [N·s/m], share of the force that is rendered. The force is that of the period, its
            mean over it where `moved`.
    """
    mass, b_m, b_h, k_h, m_s, b_s, k_c, b_c, k_e, b_e, k_b, b_b, most, capacity, period = (
        p[0],
        p[1],
        p[2],
        p[3],
        p[4],
        p[5],
        p[6],
        p[7],
        p[8],
        p[9],
        p[10],
        p[11],
        p[12],
        p[13],
        p[14],
    )
    n, h = path.shape[0], period / FINE
    forces = np.zeros(n)
    x_m, v_m = path[0], 0.0
    x_s, v_s = path[0], 0.0
    energy, tank, felt, before = 0.0, capacity, 0.0, x_m
    f_e, eased = 0.0, 1.0
    for i in range(n):
        if moved:
            x_m = path[i]
            v_m = (path[i + 1] - path[i - 1]) / (2 * period) if 0 < i < n - 1 else 0.0
        target = path[i]  # of the hand
        rate = (path[i + 1] - path[i]) / period if i < n - 1 else 0.0
        energy += felt * (x_m - before)
        tank = min(capacity, tank + felt * (x_m - before))
        before = x_m
        out[0, i] = x_m
        # what crosses the line
        late = i - delay
        seen = out[0, late] if late >= 0 else path[0]
        speed = (seen - out[0, late - 1]) / period if late >= 1 else 0.0
        if method == 1:
            felt = k_b * x_m + b_b * v_m
            if not moved and (x_m <= 0.0 or felt < 0.0):
                felt = 0.0
        else:
            # a period's mean is known at its end
            newest = late if delay > 0 else i - 1
            felt = forces[newest] if newest >= 0 else 0.0
        added, share = 0.0, 1.0
        if method == 2:
            added = _pay(energy, v_m * v_m, period, most)
            felt += added * v_m
        elif method == 3:
            eased = _ease(eased, _afford(tank, -felt * v_m, abs(felt), v_m * v_m, period, most), period)
            share = eased
            added = _refill(tank, capacity, most)
            felt = share * felt + added * v_m
        out[2, i], out[4, i], out[5, i], out[6, i] = felt, energy, added, share
        mean = 0.0
        for _ in range(FINE):
            f_e = k_e * x_s + b_e * v_s
            if not moved and (x_s <= 0.0 or f_e < 0.0):
                f_e = 0.0
            mean += f_e
            pull = k_c * (seen - x_s) + b_c * (speed - v_s)
            v_s += h * (pull - b_s * v_s - f_e) / m_s
            x_s += h * v_s
            seen += h * speed
            if not moved:
                push = k_h * (target - x_m) + b_h * (rate - v_m)
                v_m += h * (push - b_m * v_m - felt) / mass
                x_m += h * v_m
                target += h * rate
        forces[i] = mean / FINE
        out[1, i], out[3, i] = x_s, forces[i]
