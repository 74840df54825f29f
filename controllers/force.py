"""Force control through an impedance: a model of the contact turns a wanted force into a set-point.

Where u is the force that is to act and the contact is a spring K and a damper B, the tip has to stand at the depth x
with B ẋ + K x = u; an arm of inertia Λ that a spring K_r holds gets there with its set-point (u + Λ ẍ)/K_r beyond x. u
is the wanted force and an integral of its error,

    u = f_r + ω ∫ (f_r − f) dt,

with f_r the wanted force behind the filter that an arm can follow. On a contact as modelled the open loop is ω/s
times what elastic joints, sampling and the force's filter add: what is known of the contact sets gain and feed-forward
at once, and ω is the bandwidth [rad/s]. (The plant's inverse behind an integral: internal model control, M. Morari, E.
Zafiriou, Robust Process Control, 1989, ch. 2–4; force control around position control: B. Siciliano, L. Villani, Robot
Force Control, 1999, ch. 3.)
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple, Protocol

from kinid.controllers._given import is_positive
from kinid.controllers.passivity import check_period
from kinid.controllers.properties import Properties, PropertyMap, material_at
from kinid.errors import InputError
from kinid.estimators.estimate import NORMAL_95
from kinid.estimators.forgetting import Constant
from kinid.estimators.kelvin_voigt import KelvinVoigt

#: poles of the filter behind which a wanted force is asked for, three of them [rad/s]: with poles at 100 rad/s an LWR4+
#: on its elastic joints goes a sixth too far
REFERENCE = 60.0
#: what the recursive estimate keeps from sample to sample: it remembers some 0.2 s at 1 kHz
FORGETTING = 0.995
#: half width of the 95 % interval of an estimate that is used, as a share of it
SURE = 0.25


class Reading(NamedTuple):
    """Of one period: time [s], place along both tangents [m], depth [m] and its rate [m/s], normal force [N]."""

    t: float
    x: float
    y: float
    depth: float
    rate: float
    force: float


class ContactGains(NamedTuple):
    """The contact's model, and the bandwidth that may be asked of it.

    stiffness K [N/m], damping B [N·s/m], bandwidth ω [rad/s]. kept: whether the set-point stays where it is as the
    others change, since they were learnt anew and don't tell of another place.
    """

    stiffness: float
    damping: float
    bandwidth: float
    kept: bool = False


class GainSource(Protocol):
    """What tells the contact, period by period."""

    def contact(self, now: Reading) -> ContactGains:
        """At a reading."""


@dataclass(frozen=True)
class FixedGains:
    """One contact everywhere: constant gains."""

    material: Properties
    bandwidth: float

    def contact(self, now: Reading) -> ContactGains:
        """See `GainSource`."""
        return ContactGains(self.material.stiffness, self.material.damping, self.bandwidth)


@dataclass(frozen=True)
class MapGains:
    """The contact by a map at the tip's place.

    Attributes:
        surface: the map. bandwidth: ω where the map is right [rad/s].
        caution: of a place along both tangents [m]: the share of ω that is asked for where the map may be wrong.
        share: for studies of wrong maps: stiffness and damping count so many times.
    """

    surface: PropertyMap
    bandwidth: float
    caution: Callable[[float, float], float] = lambda x, y: 1.0
    share: float = 1.0

    def contact(self, now: Reading) -> ContactGains:
        """See `GainSource`."""
        here = material_at(self.surface, now.x, now.y)
        bandwidth = self.bandwidth * self.caution(now.x, now.y)
        return ContactGains(self.share * here.stiffness, self.share * here.damping, bandwidth)


class OnlineGains:
    """The contact by recursive least squares while it is touched: `kinid.estimators.KelvinVoigt`.

    Each of K and B is taken where its 95 % interval is narrower than ± `SURE` of it, and kept until the next such one;
    before the first it is the one that is assumed. Both stay within what is thought possible.

    Args:
        assumed: to begin with, at its own bandwidth. least, most: what is possible. bandwidth: ω once K is an estimate.

    Attributes:
        error: half widths of the intervals of K and B in use, as shares of them; infinite before they are told.
    """

    def __init__(self, assumed: FixedGains, least: Properties, most: Properties, bandwidth: float) -> None:
        self._now = [assumed.material.stiffness, assumed.material.damping]
        self._bounds, self._bandwidths = tuple(zip(least[:2], most[:2])), (assumed.bandwidth, bandwidth)
        self._estimator = KelvinVoigt(forgetting=Constant(FORGETTING), directional=True).online()
        self.error = [math.inf, math.inf]

    def contact(self, now: Reading) -> ContactGains:
        """See `GainSource`; learns the reading."""
        found = self._estimator.update(now.depth, now.rate, now.force, t=now.t)
        for k, (least, most) in enumerate(self._bounds):
            value, variance = float(found.values[k]), float(found.variance[k])
            half = NORMAL_95 * math.sqrt(variance) if 0.0 < variance < math.inf else math.inf
            if value > 0.0 and half < SURE * value:
                self._now[k], self.error[k] = min(max(value, least), most), half / value
        return ContactGains(self._now[0], self._now[1], self._bandwidths[self.error[0] < math.inf], kept=True)


class Reference:
    """The wanted force behind the filter that an arm can follow, and its slope."""

    def __init__(self, period: float) -> None:
        self._period, self._share, self._values = period, 1.0 - math.exp(-REFERENCE * period), [0.0, 0.0, 0.0]

    def step(self, wanted: float) -> tuple[float, float]:
        """f_r [N] and its rate [N/s] for the next wanted force [N]."""
        now, before = wanted, 0.0
        for i, before in enumerate(self._values):
            self._values[i] = now = before + self._share * (now - before)
        return now, (now - before) / self._period


class ForceControl:
    """Set-points of an impedance that give a wanted force; `command(…)` once a period. See the module.

    Args:
        stiffness, inertia: K_r [N/m] and Λ [kg] of the arm along the normal. period: [s].
        ahead: whether the wanted force is fed forward; else u is the integral of f_d − f alone.

    Raises:
        InputError: a number that isn't positive.
    """

    def __init__(self, stiffness: float, inertia: float, period: float = 1e-3, ahead: bool = True) -> None:
        check_period(period)
        for name, value in (("stiffness", stiffness), ("inertia", inertia)):
            if not is_positive(value):
                raise InputError(f"{name} {value}", "a positive number", "see the docstring of ForceControl")
        self.stiffness, self.inertia, self.period, self.ahead = stiffness, inertia, period, ahead
        self._reference, self._integral, self._depth, self._give = Reference(period), 0.0, 0.0, math.nan
        self._before: tuple[float, float] | None = None

    def command(self, wanted: float, force: float, known: ContactGains) -> tuple[float, float]:
        """Depth [m] and rate [m/s] of the set-point.

        Args:
            wanted, force: [N]. known: the contact's model.
        """
        k, b, h = known.stiffness, max(known.damping, known.stiffness * self.period), self.period
        fed, slope = self._reference.step(wanted) if self.ahead else (0.0, 0.0)
        error = (fed if self.ahead else wanted) - force
        give = 1.0 / k + 1.0 / self.stiffness  # of contact and arm in series
        if known.kept and not math.isnan(self._give):
            self._integral += (self._integral + fed) * (self._give / give - 1.0)
        self._give = give
        self._integral += known.bandwidth * h * error
        u, slope = fed + self._integral, slope + known.bandwidth * error
        left = math.exp(-k * h / b)
        self._depth = left * self._depth + (1.0 - left) * u / k
        rate = (u - k * self._depth) / b
        # Λ ẍ by the derivative of B ẋ + K x = u: K and B change as the tip moves on a map
        before, self._before = self._before, (k, b)
        if not known.kept and before is not None:
            slope -= ((k - before[0]) * self._depth + (b - before[1]) * rate) / h
        thrust = self.inertia * (slope - k * rate) / b
        return self._depth + (u + thrust) / self.stiffness, rate
