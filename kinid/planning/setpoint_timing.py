"""Set-point changes along a path: time-optimal with limited jerk (Berscheid & Kröger 2021, ruckig), and the trapezoid
beside.

Lengths along the path in m.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from kinid.errors import InputError, KinidError

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Pace:
    """Greatest speed [m/s], acceleration [m/s²] and jerk [m/s³] along a path."""

    speed: float
    acceleration: float
    jerk: float

    def __post_init__(self) -> None:
        for name in ("speed", "acceleration", "jerk"):
            value = getattr(self, name)
            if not (np.isfinite(value) and value > 0):
                raise InputError(f"a {name} of {value}", "a positive number", "correct it")

    def slower(self, factor: float) -> Pace:
        """The same motion in `factor` times the time."""
        return Pace(self.speed / factor, self.acceleration / factor**2, self.jerk / factor**3)


@dataclass(frozen=True, eq=False)
class Profile:
    """A motion along a path of pieces of constant jerk; at rest after its end.

    Attributes:
        times: when each piece begins, and the end [s], (k + 1,).
        states: position, speed, acceleration at the beginning of each, (k + 1, 3). jerks: (k + 1,), the last is 0.
    """

    times: Array
    states: Array
    jerks: Array

    @property
    def duration(self) -> float:
        """[s]"""
        return float(self.times[-1])

    def __call__(self, t: Array) -> Array:
        """Position [m] and its first three derivatives at times from the beginning, (4, n)."""
        t = np.clip(np.asarray(t, dtype=float), 0.0, self.duration)
        i = np.clip(np.searchsorted(self.times, t, side="right") - 1, 0, len(self.times) - 1)
        u = t - self.times[i]
        p, v, a = self.states[i].T
        j = self.jerks[i]
        return np.stack([p + u * (v + u * (a / 2 + u * j / 6)), v + u * (a + u * j / 2), a + u * j, j])

    def then(self, other: Profile) -> Profile:
        """One after the other; the other begins where this one ends."""
        if not np.allclose(self.states[-1], other.states[0], rtol=0, atol=1e-9):
            raise ValueError(f"a motion that ends at {self.states[-1]} and one that begins at {other.states[0]}")
        return Profile(
            np.append(self.times[:-1], self.duration + other.times),
            np.vstack([self.states[:-1], other.states]),
            np.append(self.jerks[:-1], other.jerks),
        )


def rest(position: float, duration: float) -> Profile:
    """Standing still for a time [s]."""
    state = [position, 0.0, 0.0]
    return Profile(np.array([0.0, duration]), np.array([state, state]), np.zeros(2))


def change(start: float, end: float, pace: Pace, *, start_speed: float = 0.0, end_speed: float = 0.0) -> Profile:
    """The quickest way from one position [m] to another within a pace, by ruckig.

    Args:
        start, end: [m]. pace: the limits. start_speed, end_speed: signed [m/s]; 0 is rest.

    Raises:
        InputError: numbers that no motion has.
    """
    import ruckig

    if not np.isfinite([start, end]).all():
        raise InputError(f"a change from {start} to {end} m", "finite positions", "correct them")
    if start == end and start_speed == end_speed == 0.0:
        return rest(start, 0.0)
    wanted = ruckig.InputParameter(1)
    wanted.current_position, wanted.current_velocity, wanted.current_acceleration = [start], [start_speed], [0.0]
    wanted.target_position, wanted.target_velocity, wanted.target_acceleration = [end], [end_speed], [0.0]
    wanted.max_velocity, wanted.max_acceleration, wanted.max_jerk = [pace.speed], [pace.acceleration], [pace.jerk]
    found = ruckig.Trajectory(1)
    try:
        result = ruckig.Ruckig(1).calculate(wanted, found)
    except Exception as error:  # ruckig's own
        raise KinidError(f"ruckig found no way from {start:g} to {end:g} m: {error}") from None
    if result not in (ruckig.Result.Working, ruckig.Result.Finished):
        raise KinidError(f"ruckig found no way from {start:g} to {end:g} m ({result})")
    profile = found.profiles[0][0]
    keep = np.array(profile.t) > 0.0
    times = np.concatenate([[0.0], np.cumsum(np.array(profile.t)[keep])])
    jerks = np.append(np.array(profile.j)[keep], 0.0)
    # states by integration of the jerks, so that pieces join to rounding
    states = np.empty((len(times), 3))
    states[0] = start, start_speed, 0.0
    for k, u in enumerate(np.diff(times)):
        p, v, a = states[k]
        j = jerks[k]
        states[k + 1] = p + u * (v + u * (a / 2 + u * j / 6)), v + u * (a + u * j / 2), a + u * j
    if abs(states[-1, 0] - end) > 1e-9 or abs(states[-1, 1] - end_speed) > 1e-9 or abs(states[-1, 2]) > 1e-9:
        raise KinidError(
            f"ruckig's way from {start:g} to {end:g} m misses its end by {states[-1] - [end, end_speed, 0.0]}"
        )
    states[-1] = end, end_speed, 0.0
    return Profile(times, states, jerks)


def trapezoid_duration(distance: float, pace: Pace) -> float:
    """Time of the usual profile under the same limits [s]: a trapezoid of speed, its corners rounded by a moving
    average.

    An average over T seconds has a jerk of at most the acceleration's change within T, by T (Biagiotti & Melchiorri,
    Trajectory Planning for Automatic Machines and Robots, 2008, ch. 4): T = a/j, or 2 a/j where the trapezoid goes from
    speeding up to braking within that time. Speed and acceleration stay within their limits.
    """
    distance = abs(distance)
    if distance == 0.0:
        return 0.0
    v, a = pace.speed, pace.acceleration
    cruise = max(0.0, distance / v - v / a)
    plain = cruise + 2.0 * v / a if distance >= v**2 / a else 2.0 * float(np.sqrt(distance / a))
    return plain + (a if cruise >= a / pace.jerk else 2.0 * a) / pace.jerk
