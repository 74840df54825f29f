"""Time-domain passivity: no port gives more energy than it took up, whatever made its force.

Two ways to see to that, with one ledger: the work of a held force over a period is exact, force times displacement,
known one period later (J.-H. Ryu, C. Preusche, B. Hannaford, G. Hirzinger, IEEE Trans. Control Systems Technology 13,
2005).

- An *observer* counts what the port took up and gave; where it gave too much a damper pays (B. Hannaford, J.-H. Ryu,
  Time-domain passivity control of haptic interfaces, IEEE Trans. Robotics and Automation 18, 2002). The force is
  followed in full, damping is added.
- A *tank* holds what the port took up, at most its capacity; a force that would give more than there is shrinks to what
  the tank affords, and a damper fills the tank when it runs low (M. Franken, S. Stramigioli, S. Misra, C. Secchi, A.
  Macchelli, Bilateral telemanipulation with time delays: a two-layer approach, IEEE Trans. Robotics 27, 2011). There is
  no debt: force is missing where energy is.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass

import numpy as np
from numba import njit

from kinid.controllers._given import is_number
from kinid.errors import InputError

#: share of m/T² up to which a held spring is rendered
SPRING = 0.1
#: periods that a tank's energy lasts for
LASTS = 10
#: time constant with which a share comes back [s]
RETURN = 0.2


@njit(cache=True, error_model="numpy")
def pay(energy: float, speed_squared: float, period: float, most: float) -> float:
    """Damping [N·s/m] that takes a debt (−energy, where negative) back within one period, at most `most`.

    Args:
        energy: that the port took up so far [J]. speed_squared: [m²/s²]. period: [s].
        most: greatest damping; above 2 m/T a sampled damper makes a mass m overshoot.
    """
    if energy >= 0.0 or speed_squared <= 0.0:
        return 0.0
    return min(-energy / (speed_squared * period), most)


@njit(cache=True, error_model="numpy")
def brake(force: float, way: float, stiffness: float, damping: float, period: float) -> float:
    """Force of a damper behind a spring over the next period [N].

    A damper alone must stay below 2 m/T, see `pay`. Behind a spring it may be as strong as it has to: slow motion meets
    the damper, fast motion the spring, which a held force can render up to `SPRING` m/T². Without damping the spring is
    released.

    Args:
        force: over the last period [N]. way: of the device over it [m]. stiffness: [N/m]. damping: [N·s/m]. period:
            [s].
    """
    return 0.0 if damping <= 0.0 else (force + stiffness * way) / (1.0 + stiffness * period / damping)


@njit(cache=True, error_model="numpy")
def afford(energy: float, power: float, size: float, speed_squared: float, period: float, most: float) -> float:
    """Share of a force, 0…1, that a tank affords over the next period; never more than it holds.

    What it holds is to last for `LASTS` periods at least: a force that was cut off only where the tank is empty would
    go on and off with its level. At rest a force costs nothing, whatever the level. An empty tank affords no force
    along the motion, and against it none that could turn the motion round within the period and give energy then: at
    most a damper's.

    Args:
        energy: in the tank [J]. power: that the force is about to give [W]; negative where it takes. size: of the force
            [N].
        speed_squared: [m²/s²]. period: [s]. most: greatest damping that a force against the motion acts like where the
            tank is empty [N·s/m]; see `pay`.
    """
    most_power = max(energy, 0.0) / (LASTS * period)
    if abs(power) <= most_power:
        return 1.0 if energy > 0.0 else 0.0
    share = most_power / abs(power)
    return share if power > 0.0 else float(min(1.0, share + most * np.sqrt(speed_squared) / size))


@njit(cache=True, error_model="numpy")
def ease(before: float, wanted: float, period: float) -> float:
    """The share to render: it falls at once, as the tank demands, and comes back slowly, lest it go on and off.

    Args:
        before: share of the last period. wanted: that the tank affords. period: [s].
    """
    return wanted if wanted <= before else before + (wanted - before) * min(1.0, period / RETURN)


@njit(cache=True, error_model="numpy")
def refill(energy: float, filling: float, most: float) -> float:
    """Damping [N·s/m] that fills a tank whose level is below half its filling: the more, the emptier it is.

    Args:
        energy: in the tank [J]. filling: that it began with [J]. most: greatest damping, where the tank is empty.
    """
    return most * min(1.0, max(0.0, 1.0 - 2.0 * energy / filling))


def check_period(period: float) -> None:
    """Refuse a period that isn't positive."""
    if not (is_number(period) and 0.0 < period < 1.0):
        raise InputError(f"a control period of {period} s", "between 0 and 1 s", "1 kHz is 0.001")


class Ledger(ABC):
    """A port's account: it is told each period's work, and says what of the next force may be rendered."""

    energy: float  #: [J]; of an observer what the port took up, of a tank what it holds

    @abstractmethod
    def book(self, work: float) -> None:
        """Enter the work that the rendered force did on the device over the last period [J]."""

    @abstractmethod
    def settle(self, power: float, size: float, speed_squared: float) -> tuple[float, float]:
        """Share of the force to render, 0…1, and damping to add [N·s/m].

        Args:
            power: that the force is about to give [W]. size: of the force [N].
            speed_squared: of the device along the port [m²/s²].
        """

    @abstractmethod
    def leave(self) -> None:
        """The touch has ended: nothing is stored in the material any more."""


class Passivity(ABC):
    """How a port is kept passive; `open` makes the account of one port."""

    @abstractmethod
    def open(self, period: float) -> Ledger:
        """An account for a controller with this period [s]."""


@dataclass(frozen=True)
class Observer(Passivity):
    """Observe the energy and pay debts by damping.

    Args:
        most_damping: the controller's greatest [N·s/m], below 2 m/T of the device; 0 switches it off. It holds as long
            as that can pay what a touch owes, at most `most_damping` · speed · way.

    Raises:
        InputError: a damping that is negative or not finite.
    """

    most_damping: float = 20.0

    def __post_init__(self) -> None:
        if not (is_number(self.most_damping) and self.most_damping >= 0):
            raise InputError(
                f"most_damping {self.most_damping}",
                "a finite number that isn't negative",
                "a negative one gives energy",
            )

    def open(self, period: float) -> Ledger:
        """See the class."""
        return _Observed(self.most_damping, period)


@dataclass(frozen=True)
class EnergyTank(Passivity):
    """Hold what the port took up, and give no more.

    Args:
        capacity: of the tank [J]. About what a material stores when it is pressed, K δ²/2, renders a spring without
            loss.
        most_damping: of the damper that fills it when it is below half its filling; where it is empty, a force against
            the motion acts at most like such a damper, too [N·s/m]. Below m/T of the device.
        filling: that it begins with [J], and that it keeps at most when a touch ends: what a material may give in all
            beyond what was put into it. A millijoule lifts a device of 100 g by a millimetre.

    Raises:
        InputError: a capacity or damping that isn't positive, or a filling that isn't within the capacity.
    """

    capacity: float = 0.02
    most_damping: float = 20.0
    filling: float = 1e-3

    def __post_init__(self) -> None:
        if not (is_number(self.capacity) and self.capacity > 0):
            raise InputError(
                f"a tank of {self.capacity} J", "a positive capacity", "K δ²/2 of the deepest touch is a good one"
            )
        if not (is_number(self.most_damping) and self.most_damping > 0):
            raise InputError(
                f"most_damping {self.most_damping}", "a positive number [N·s/m]", "below m/T of the device"
            )
        if not (is_number(self.filling) and 0 < self.filling <= self.capacity):
            raise InputError(
                f"a filling of {self.filling} J",
                f"a positive energy up to the capacity, {self.capacity:g} J",
                "what the material may give beyond what was put into it",
            )

    def open(self, period: float) -> Ledger:
        """See the class."""
        return _Held(self, period)


class _Observed(Ledger):
    def __init__(self, most: float, period: float) -> None:
        self.energy, self._most, self._period = 0.0, most, period

    def book(self, work: float) -> None:
        self.energy -= work

    def settle(self, power: float, size: float, speed_squared: float) -> tuple[float, float]:
        return 1.0, pay(self.energy, speed_squared, self._period, self._most)

    def leave(self) -> None:
        # what was dissipated is forgotten, what is owed stays
        self.energy = min(self.energy, 0.0)


class _Held(Ledger):
    def __init__(self, tank: EnergyTank, period: float) -> None:
        self.energy, self._tank, self._period, self._share = tank.filling, tank, period, 1.0

    def book(self, work: float) -> None:
        self.energy = min(self._tank.capacity, self.energy - work)

    def settle(self, power: float, size: float, speed_squared: float) -> tuple[float, float]:
        tank = self._tank
        wanted = afford(self.energy, power, size, speed_squared, self._period, tank.most_damping)
        self._share = ease(self._share, wanted, self._period)
        return self._share, refill(self.energy, tank.filling, tank.most_damping)

    def leave(self) -> None:
        # what was dissipated is forgotten, what was given beyond stays given
        self.energy, self._share = min(self.energy, self._tank.filling), 1.0
