"""Gain and phase margins of force control on the laboratory's arm, from the loop's linear model.

The model is the compiled loop's, linearised at a posture in contact: seven links and motors behind elastic joints with
their viscous friction, the impedance sampled once a period, a contact K, B along the normal, the filter of the sensor
and one period until its reading acts. Left out are dry friction and what couples the normal with a slide.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from kinid.controllers.properties import Properties
from kinid.errors import KinidError
from kinid.lab.arm import sampled
from kinid.lab.force_loop import ForceLoop, blend

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]

#: frequencies of a response, from 0.01 Hz to the Nyquist frequency's neighbourhood
POINTS = 600


class Plant(NamedTuple):
    """x⁺ = A x + B r, f = C x: r is depth [m] and rate [m/s] of the set-point, f the normal force [N], each period."""

    a: Array
    b: Array
    c: Array


class Margins(NamedTuple):
    """Gain margin [1], phase margin [rad]; how much more gain, and how much more lag, make the loop unstable."""

    gain: float
    phase: float

    def __str__(self) -> str:
        return f"{20 * np.log10(self.gain):.1f} dB, {np.degrees(self.phase):.1f}°"


class Response(NamedTuple):
    """Open loop at a bandwidth of 1 rad/s; a loop of bandwidth ω has ω times as much.

    Attributes:
        angle: frequency times period [rad], (n,). loop: L, (n,).
    """

    angle: Array
    loop: Complex

    def margins(self, bandwidth: float) -> Margins:
        """At a bandwidth ω [rad/s]; the least over all crossings."""
        size, phase = bandwidth * np.abs(self.loop), np.unwrap(np.angle(self.loop))
        phase = phase - 2 * np.pi * np.round((phase[0] + np.pi / 2) / (2 * np.pi))  # an integral begins at −90°
        turns = np.concatenate([_crossings(phase + np.pi + 2 * np.pi * k, np.log(size)) for k in range(5)])
        lags = _crossings(np.log(size), phase)
        gain = float(np.exp(-turns.max())) if len(turns) else np.inf
        if len(lags) == 0:
            return Margins(gain, np.inf)
        return Margins(gain, float(np.min(lags + np.pi)))


def _crossings(level: Array, other: Array) -> Array:
    """The other curve where one crosses nought downwards or upwards; straight between points."""
    k = np.flatnonzero(np.sign(level[:-1]) * np.sign(level[1:]) < 0)
    share = level[k] / (level[k] - level[k + 1])
    return np.asarray(other[k] + share * (other[k + 1] - other[k]))


def plant(loop: ForceLoop, place: Array, contact: Properties) -> Plant:
    """Arm under impedance in contact at a place (2,) [m].

    Args:
        loop: the arm. contact: as it is.
    """
    s, q = loop.setup, loop.posture(place)
    jacobian, axis = s.arm.state(q).jacobian, np.concatenate([-s.axes[2], np.zeros(3)])  # into the material
    along, damping = axis @ jacobian, loop.damping(q)
    pushed, (_, _, _, _, drag, _, rub, _) = np.outer(along, along), s.joints.packed
    arm = sampled(
        s.gains,
        damping,
        s.arm,
        s.joints,
        q,
        push=contact.stiffness * pushed,
        drag=contact.damping * pushed + np.diag(rub),
        motor_drag=np.diag(drag),
    )
    wrench = jacobian.T @ np.column_stack([s.gains.stiffness @ axis, damping @ axis])
    felt = np.concatenate([contact.stiffness * along, contact.damping * along, np.zeros(2 * s.arm.joints)])
    return Plant(arm.closed, arm.driven @ wrench, felt)


def response(arm: Plant, model: Properties, stiffness: float, inertia: float, period: float) -> Response:
    """Open loop of `kinid.controllers.force.ForceControl` on a plant.

    Args:
        arm: see `plant`. model: of the contact, as the controller has it. stiffness: of the impedance [N/m].
        period: [s].
    """
    angle = np.geomspace(2 * np.pi * 0.01 * period, 0.98 * np.pi, POINTS)
    z = np.exp(1j * angle)
    values, vectors = np.linalg.eig(arm.a)
    modes = (arm.c @ vectors)[:, None] * np.linalg.solve(vectors, arm.b.astype(complex))
    to_force = (1.0 / (z[:, None] - values)) @ modes  # of depth and rate of the set-point, (n, 2)
    left = np.exp(-model.stiffness * period / model.damping)
    depth = (1.0 - left) / model.stiffness * z / (z - left)
    rate = (1.0 - model.stiffness * depth) / model.damping
    share = blend(period)
    reading = share * z / (z - (1.0 - share)) / z  # filter, and a period until it acts
    integral = period * z / (z - 1.0)
    chain = to_force[:, 0] * (depth + 1.0 / stiffness) + to_force[:, 1] * rate
    # the inertia's share: u̇ is the error itself, before the integral
    thrust = inertia / (model.damping * stiffness) * (1.0 - model.stiffness * integral * rate)
    return Response(angle, reading * (integral * chain + thrust * to_force[:, 0]))


def worst(responses: Iterable[Response], bandwidth: float) -> Margins:
    """The least margins of several loops at one bandwidth."""
    each = [one.margins(bandwidth) for one in responses]
    return Margins(min(m.gain for m in each), min(m.phase for m in each))


def bandwidth_of(responses: Iterable[Response], least: Margins) -> float:
    """The greatest bandwidth ω [rad/s] at which all loops have these margins at least.

    Raises:
        KinidError: there is none.
    """
    loops, low, high = list(responses), 1e-2, 1e3

    def holds(bandwidth: float) -> bool:
        now = worst(loops, bandwidth)
        return now.gain >= least.gain and now.phase >= least.phase

    if not holds(low):
        raise KinidError(f"no bandwidth with margins of {least}")
    for _ in range(60):
        middle = float(np.sqrt(low * high))
        low, high = (middle, high) if holds(middle) else (low, middle)
    return low
