"""A poke that ends as soon as it has said enough: the recursive estimate during the poke, with what was expected."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from kinid.contact.online import OnlineContact, OnlineEstimator
from kinid.contact.touching import SHORTEST
from kinid.data.rig import Rig
from kinid.errors import InputError
from kinid.estimators.estimate import Estimate
from kinid.estimators.forgetting import Constant
from kinid.estimators.kelvin_voigt import KelvinVoigt
from kinid.estimators.warm_start import Learnt, WarmStart
from kinid.kernels.local_polynomial import differentiate
from kinid.robotics.robot import Robot
from kinid.signal.derivative import UNEVEN, Differentiator

Array = NDArray[np.float64]

#: of the differentiator: the pokes' 5 Hz and their phase come through [Hz]
BANDWIDTH = 40.0
#: it is asked after so many samples whether that is enough
EVERY = 10
#: a residual of more than so many times the rig's noise isn't noise: the law is another, and its intervals say nothing
MOST_NOISE = 1.5


class EarlyStop:
    """Follows a poke from raw joints and wrench, and says when stiffness and damping are known well enough.

    Velocities come from a symmetric window, so that depth, rate and force belong to the same instant; the estimate is
    late by half of that window instead (24 ms at 500 Hz). A poke whose residual isn't noise is never ended early: where
    Kelvin-Voigt doesn't hold, neither do its intervals.

    Args:
        rig: with a robot, a plane and the sensor's noise. precision: half of the 95 % intervals of stiffness and
            damping, as a share of their values. prior: of the place that is poked. robot: the rig's, where it is there.

    Attributes:
        learnt: stiffness and damping with what was expected; None before the touch tells both.
        noise: of a force by the rig [N]. alone: what the touch alone says of them. own: the recursive estimate.
        enough: whether the poke may end.

    Raises:
        InputError: a precision that is no share, or a rig without the sensor's noise.
    """

    def __init__(
        self, rig: Rig, precision: float, prior: WarmStart | None = None, *, robot: Robot | None = None
    ) -> None:
        check_precision(precision)
        if rig.sensor.noise is None:
            raise InputError(
                "a rig without [sensor] noise",
                "what a force scatters by, to tell a law that fails",
                "state it in the rig: the standard deviation of readings at rest",
            )
        self.noise, self._precision, self._prior = max(rig.sensor.noise[:3]), precision, prior or WarmStart()
        self._online = OnlineEstimator(
            OnlineContact(rig, robot=robot), KelvinVoigt(forgetting=Constant(1.0), accuracy=None).online()
        )
        self._differentiate = Differentiator(bandwidth=BANDWIDTH)
        self._t, self._q, self._wrench = np.empty(0), np.empty((0, 0)), np.empty((0, 6))
        #: half of the window, its convolution and the sample time, once there are samples
        self._window: tuple[int, Array, float] | None = None
        self.own: Estimate | None = None
        self.learnt: Learnt | None = None
        self.alone: Learnt | None = None
        self.enough = False

    def feed(self, t: ArrayLike, q: ArrayLike, wrench: ArrayLike) -> bool:
        """Learn samples, and say whether the poke may end.

        Args:
            t: time [s], (k,). q: joint positions, (k, N). wrench: in sensor axes [N, N·m], (k, 6). One sample or some
                at a time.
        """
        q = np.atleast_2d(np.asarray(q, dtype=float))
        self._t = np.append(self._t, np.asarray(t, dtype=float))
        self._q = np.vstack([self._q.reshape(-1, q.shape[1]), q])
        self._wrench = np.vstack([self._wrench, np.atleast_2d(np.asarray(wrench, dtype=float))])
        if self._window is None:
            if len(self._t) < 2:
                return False
            period = float(np.median(np.diff(self._t)))
            half = self._differentiate.half_window(period)
            self._window = half, self._differentiate.taps(half, period), period
        half, taps, period = self._window
        ready = len(self._t) - 2 * half
        if ready <= 0:
            return False
        first, second = np.full((2, *self._q.shape), np.nan)
        differentiate(self._t, self._q, half, self._differentiate.order, taps, UNEVEN * period, period, first, second)
        for k in range(half, half + ready):
            self.own = self._online.update(float(self._t[k]), self._q[k], self._wrench[k], first[k], second[k])
        self._t, self._q, self._wrench = self._t[ready:], self._q[ready:], self._wrench[ready:]
        self._weigh(period)
        return self.enough

    def _weigh(self, period: float) -> None:
        """What the touch so far says, with what was expected."""
        own = self.own
        if own is None or own.updates * period < SHORTEST:
            return
        # a residual that is by chance smaller than the sensor's noise knows nothing better
        covariance = own.covariance * max(1.0, (self.noise / max(own.noise, 1e-12)) ** 2)
        if not np.isfinite(covariance).all():
            return
        self.alone = WarmStart().after(own.values.copy(), covariance)
        self.learnt = self._prior.after(self.alone.values, covariance)
        self.enough = own.noise <= MOST_NOISE * self.noise and self.learnt.within(self._precision)


def check_precision(precision: float) -> None:
    """Refuse a precision that is none.

    Raises:
        InputError: which.
    """
    if not (math.isfinite(precision) and 0.0 < precision < 1.0):
        raise InputError(f"a precision of {precision}", "a share between 0 and 1, as 0.05", "correct it")
