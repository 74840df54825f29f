"""How touches are carried out: heights, paces, a guarding force; and what would take too long or go too deep."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from kinid.errors import InputError
from kinid.inputs import raised, size_limit
from kinid.planning.setpoint_timing import Pace
from kinid.planning.touches import DEEPEST, Poke, Slide, Touch

Array = NDArray[np.float64]

#: a plan of more samples than these doesn't fit into memory beside its checks: nearly three hours at 500 Hz
MOST_SAMPLES = 5_000_000


@dataclass(frozen=True)
class Guard:
    """A force that a material must not be pressed harder than.

    The approach is so slow that, from the moment the force is reached, the arm stops within a tenth more of it.

    Attributes:
        force: normal, at which the motion stops and retracts [N]. reaction: of sensor and controller until it brakes
            [s].
    """

    force: float
    reaction: float = 0.01

    def __post_init__(self) -> None:
        for name in ("force", "reaction"):
            if not (np.isfinite(getattr(self, name)) and getattr(self, name) > 0):
                raise InputError(f"a guard with a {name} of {getattr(self, name)}", "a positive number", "correct it")

    def speed(self, stiffness: float, acceleration: float) -> float:
        """The fastest approach [m/s] to a material of this stiffness [N/m]: v τ + v²/(2a) ≤ 0.1 F/k."""
        distance = 0.1 * self.force / max(stiffness, 1e-9)
        return float(acceleration * (np.sqrt(self.reaction**2 + 2.0 * distance / acceleration) - self.reaction))


@dataclass(frozen=True)
class Protocol:
    """How touches are carried out.

    Attributes:
        height: above the surface between touches [m]. pause: standing there before and after each, where the sensor's
            zero shows [s]. clearance: above the surface, from which the approach goes slowly [m].
        travel: pace in the air. contact: pace of the slow part. rate: samples a second [Hz].
        yaw: of the tool about its axis [rad]; None: what suits the arm best. guard: for fragile materials, or None.
        collisions: whether they are looked for.
    """

    height: float = 0.015
    pause: float = 0.2
    clearance: float = 0.004
    travel: Pace = Pace(0.1, 1.0, 20.0)
    contact: Pace = Pace(0.02, 0.5, 20.0)
    rate: float = 500.0
    yaw: float | None = None
    guard: Guard | None = None
    collisions: bool = True

    def __post_init__(self) -> None:
        if not (0 < self.clearance < self.height < 1.0):
            raise InputError(
                f"a height of {self.height} m with a clearance of {self.clearance} m",
                "0 < clearance < height < 1 m",
                "correct them",
            )
        if not (np.isfinite(self.pause) and self.pause >= 0):
            raise InputError(f"a pause of {self.pause} s", "0 or more", "correct it")
        if self.yaw is not None and not np.isfinite(self.yaw):
            raise InputError(f"a yaw of {self.yaw} rad", "a number, or none for what suits the arm", "correct it")
        if not (np.isfinite(self.rate) and 10 <= self.rate <= 10_000):
            raise InputError(f"a rate of {self.rate} Hz", "10 to 10 000 Hz", "correct it")


def check_length(touches: Sequence[Touch], protocol: Protocol) -> None:
    """Refuse what would take longer than a plan may, before it is laid out."""
    seconds = sum(_least_time(touch) + 2 * protocol.pause for touch in touches)
    samples = seconds * protocol.rate
    if samples > (most := size_limit(MOST_SAMPLES)):
        raise InputError(
            f"a plan of {seconds / 3600:.3g} h at least, {samples:.3g} samples at {protocol.rate:g} Hz",
            f"{most:.2g} samples at most",
            f"plan it in parts, with a lower --rate, {raised(samples, MOST_SAMPLES)}",
        )
    for touch in touches:
        if deepest_of(touch) > DEEPEST:
            raise InputError(
                f"a {touch.name} {deepest_of(touch):.3g} m deep",
                f"at most {DEEPEST:g} m: tools are no longer",
                "press less deep; depths are in m",
            )
        if isinstance(touch, Poke):
            highest = float(touch.signal(_often(touch))[0].min())
            if -highest > protocol.height:
                raise InputError(
                    f"a poke that rises {-1e3 * highest:.3g} mm above the surface",
                    f"at most the height between touches, {1e3 * protocol.height:g} mm",
                    "lower its amplitudes, press deeper, or raise --height",
                )


def _least_time(touch: Touch) -> float:
    """What a touch takes at least [s]."""
    if isinstance(touch, Poke):
        return touch.hold + touch.signal.duration
    length = sum(float(np.linalg.norm(np.subtract(b, a))) for a, b in zip(touch.corners[:-1], touch.corners[1:]))
    return touch.hold + length / touch.speed * (2.0 if touch.back else 1.0)


def _often(touch: Poke) -> Array:
    """Times of a poke's signal [s], 5 ms apart."""
    return np.linspace(0.0, touch.signal.duration, 2 + int(200 * touch.signal.duration))


def deepest_of(touch: Touch) -> float:
    """The deepest point that a touch asks for [m]."""
    if isinstance(touch, Slide):
        return touch.depth
    # between two samples 5 ms apart a sine of 5 Hz rises by 3 % of a millimetre at most
    return float(touch.signal(_often(touch))[0].max()) + 1e-4
