"""Two-port bilateral teleoperation with transport delay: force reflected over the line, waves, or a map's impedance.

    operator ─ master ─ delay T ─► slave ─ environment        (the slave follows the master's delayed motion)
                  ▲                          │
                  ├──────── delay T ◄────────┘                direct: the measured force comes back, 2T late
                  └──── K̂ x + B̂ ẋ at the master              impedance reflection: no force crosses the line

With v = ẋ and impedances Z = force / velocity, the environment Z_e = B + K/s; master, hand and arm
Z_m = m s + b + k/s; the slave behind its coupling reaches V_s = G e^{−sT} V_m,
G = (b_c s + k_c) / (m_s s² + (b_s + b_c + B) s + k_c + K). The operator feels Z_t = Z_e G e^{−2sT} directly and Ẑ_e
from the map. Transparency is Z_t = Z_e (D. A. Lawrence, IEEE Trans. Robotics and Automation 9, 1993). Over a line of
waves with impedance b, which ends in the coupling Z_c = b_c + k_c/s and behind it the slave, the operator feels
Z_t = b + b (1 + Γ e^{−2sT}) / (1 − Γ e^{−2sT}) with Γ = (Z_s − b) / (Z_s + b), 1/Z_s = 1/Z_c + 1/(m_s s + b_s + Z_e),
where the first b is a damper at the master's port in which returning waves end. Delays here are one-way: direct
reflection comes back after twice the delay.

What bounds direct reflection behind a passivity controller: while a debt lasts, its damper adds B to the master, and
what is left is a loop K̄ e^{−2sT} / (k + B s), K̄ being the environment behind the coupling and k the hand. It is stable
as long as

    2T √(K̄² − k²) < (π − arccos(k/K̄)) B,  for any hand if  2T K̄ < π B / 2                                    (1)

A sampled damper is stable below 2 m/T_s. Where (1) asks for more, debts are never paid and an echo hammers on, however
right the account; so the damper stands behind a spring (`passivity.brake`), and B follows from (1).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np
from numpy.typing import NDArray

from kinid.controllers._given import is_number
from kinid.controllers.packets import Network
from kinid.controllers.passivity import SPRING, check_period
from kinid.controllers.properties import PropertyMap, checked_map, material_at
from kinid.errors import InputError, near

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]

#: direct: the slave's contact force; impedance: the map's at the master; passivated: direct, behind an observer and
#: controller of passivity at the master's port; tank: direct, behind an energy tank there; wave: wave variables
Method = Literal["direct", "impedance", "passivated", "tank", "wave"]
METHODS: tuple[str, ...] = get_args(Method)
#: those that reflect a force or a map
REFLECTIONS = METHODS[:4]
#: of which Z_t is a formula
LINEAR = ("direct", "impedance", "wave")


@dataclass(frozen=True)
class Environment:
    """What the slave touches: Kelvin-Voigt, stiffness K [N/m] and damping B [N·s/m]."""

    stiffness: float = 732.0
    damping: float = 9.9

    def __post_init__(self) -> None:
        _not_negative(self, "stiffness", "damping")

    @classmethod
    def at(cls, surface: PropertyMap, x: float, y: float, depth: float = 2e-3) -> Environment:
        """The material of a map at a place [m], linearised at a depth [m] by its secant.

        Args:
            surface: also a measured `kinid.mapping.property_map.PropertyMap`. x, y: along both tangents [m]. depth: >
                0.

        Raises:
            InputError: no map, a place without usable properties, or a depth that isn't positive.
        """
        if not (is_number(depth) and depth > 0):
            raise InputError(f"a depth of {depth} m", "a positive one", "give about the depth of a touch")
        for name, value in (("x", x), ("y", y)):
            if not is_number(value):
                raise InputError(f"{name} {value!r}", "a finite number [m]", "give a place along both tangents")
        material = material_at(checked_map(surface), x, y)
        power = depth ** (material.exponent - 1.0)
        return cls(material.stiffness * power, material.damping * (power * depth if material.exponent != 1.0 else 1.0))

    def impedance(self, frequency: Array) -> Complex:
        """Z_e at frequencies [Hz], force per velocity [N·s/m]."""
        return np.asarray(self.damping + self.stiffness / (2j * np.pi * frequency))


@dataclass(frozen=True)
class Teleoperator:
    """Master with the operator's hand on it, slave, and the line between them.

    Args:
        master_mass [kg], master_damping [N·s/m]: of the device.
        hand_mass [kg], hand_damping [N·s/m], hand_stiffness [N/m]: of the arm that holds it, towards its intended
        place. slave_mass, slave_damping: of the robot's tip. coupling_stiffness, coupling_damping: of its impedance
        controller.
        delay: one-way [s]. period: of both controllers [s]. network: what else the line does to packets.
        most_damping: the passivity controllers' greatest [N·s/m]; default: by (1) what holds a material as stiff as the
            coupling at this delay and jitter. tank: capacity of the energy tank [J].

    Waves have the impedance of the coupling's damping: both ends are matched to the line, so that quick waves end there
    and don't go to and fro (G. Niemeyer, J.-J. E. Slotine 1991).

    Raises:
        InputError: masses that aren't positive, negative gains, a master without damping on a delayed line, a gain that
            is unstable at the period.
    """

    master_mass: float = 0.3
    master_damping: float = 0.5
    hand_mass: float = 0.5
    hand_damping: float = 8.0
    hand_stiffness: float = 250.0
    slave_mass: float = 2.0
    slave_damping: float = 5.0
    coupling_stiffness: float = 5000.0
    coupling_damping: float = 140.0
    delay: float = 0.1
    period: float = 1e-3
    most_damping: float | None = None
    tank: float = 0.02
    network: Network = Network()

    def __post_init__(self) -> None:
        check_period(self.period)
        _not_negative(
            self,
            "master_damping",
            "hand_mass",
            "hand_damping",
            "hand_stiffness",
            "slave_damping",
            "coupling_stiffness",
            "coupling_damping",
            "delay",
        )
        if self.most_damping is not None:
            _not_negative(self, "most_damping")
        if not isinstance(self.network, Network):
            raise InputError(f"a network {self.network!r}", "Network(…)", "see its docstring")
        for name, unit in (("master_mass", "mass [kg]"), ("slave_mass", "mass [kg]"), ("tank", "energy [J]")):
            if not (is_number(getattr(self, name)) and getattr(self, name) > 0):
                raise InputError(
                    f"{name} {getattr(self, name)}", f"a positive {unit}", "see the docstring of Teleoperator"
                )
        if self.delay > 0 and self.master_damping + self.hand_damping == 0:
            raise InputError(
                "a master and a hand without damping on a delayed line",
                "some damping",
                "nothing would take out the energy that the delay gives",
            )
        if self.coupling_stiffness == 0 or self.coupling_damping + self.slave_damping == 0:
            raise InputError(
                "a slave that its coupling can't hold", "coupling stiffness and damping above 0", "raise both"
            )
        # semi-implicit integration at the controllers' period: c h + k h²/2 < 2 m
        h = self.period
        if self.coupling_damping * h + 0.5 * self.coupling_stiffness * h**2 > self.slave_mass:
            raise InputError(
                "a coupling too strong for the slave's mass at this period",
                "c T + k T²/2 ≤ m",
                "a shorter period, or a weaker coupling",
            )

    @property
    def moving_mass(self) -> float:
        """What moves at the master, device and hand [kg]."""
        return self.master_mass + self.hand_mass

    @property
    def wave_impedance(self) -> float:
        """Of the line, b [N·s/m]: the coupling's damping, or what a held force may be at the master if that is less."""
        return min(self.coupling_damping, self.plain_damping)

    @property
    def plain_damping(self) -> float:
        """What a held damper may be on the device, whoever holds it, m/T_s [N·s/m]."""
        return self.master_mass / self.period

    @property
    def brake_stiffness(self) -> float:
        """Of the spring before the passivity controllers' damper [N/m]: what the device bears, whoever holds it."""
        return SPRING * self.master_mass / self.period**2

    @property
    def full_damping(self) -> float:
        """B of the passivity controllers [N·s/m]: `most_damping`, or by (1) for any hand and K̄ half the coupling."""
        if self.most_damping is not None:
            return self.most_damping
        return self.round_trip * self.coupling_stiffness / np.pi

    @property
    def round_trip(self) -> float:
        """From a motion to its echo [s], jitter and the averaged and held force's one and a half periods included."""
        return 2.0 * (self.delay + self.network.jitter) + 1.5 * self.period

    def operator_impedance(self, frequency: Array) -> Complex:
        """Z_m of device and hand at frequencies [Hz]."""
        s = 2j * np.pi * frequency
        return np.asarray(self.moving_mass * s + self.master_damping + self.hand_damping + self.hand_stiffness / s)

    def following(self, environment: Environment, frequency: Array) -> Complex:
        """G: the slave's velocity by that of its set-point."""
        s = 2j * np.pi * frequency
        top = self.coupling_damping * s + self.coupling_stiffness
        damping = self.slave_damping + self.coupling_damping + environment.damping
        return np.asarray(
            top / (self.slave_mass * s**2 + damping * s + self.coupling_stiffness + environment.stiffness)
        )

    def transmitted(
        self, environment: Environment, frequency: Array, method: str, believed: Environment | None = None
    ) -> Complex:
        """Z_t that the operator feels at the master's port, device and hand apart, by the formula; no packet is lost.

        Args:
            environment: the true one. frequency: [Hz], (n,). method: `direct` or `impedance`; passivity controllers are
                not linear, so that the others have no formula. believed: what the map says; default: the truth.
        """
        if checked_method(method) == "impedance":
            return (believed or environment).impedance(frequency)
        if method not in LINEAR:
            raise InputError(f"a formula for '{method}'", "a linear method", "use measured_impedance")
        if method == "wave":
            return self._over_waves(environment, frequency)
        late = np.exp(-4j * np.pi * frequency * self.delay)
        return np.asarray(environment.impedance(frequency) * self.following(environment, frequency) * late)

    def _over_waves(self, environment: Environment, frequency: Array) -> Complex:
        """Z_t over a line of waves, which the buffer makes longer."""
        s, b = 2j * np.pi * frequency, self.wave_impedance
        coupling = self.coupling_damping + self.coupling_stiffness / s
        slave = self.slave_mass * s + self.slave_damping + environment.impedance(frequency)
        end = coupling * slave / (coupling + slave)
        one_way = self.delay + self.network.wait(self.period) * self.period
        echo = (end - b) / (end + b) * np.exp(-2.0 * s * one_way)
        return np.asarray(b + b * (1.0 + echo) / (1.0 - echo))

    def is_stable(self, environment: Environment, method: str, believed: Environment | None = None) -> bool:
        """Whether operator, master, line and slave in lasting contact are stable, by Nyquist's criterion on Z_t/Z_m.

        Both factors are stable on their own, so that 1 + Z_t/Z_m must not turn around 0.

        Raises:
            InputError: a method that isn't linear.
        """
        return self._encircles_nothing(
            lambda f: self.transmitted(environment, f, method, believed) / self.operator_impedance(f)
        )

    def pays(self, environment: Environment) -> bool:
        """Whether direct reflection is stable while a passivity controller damps in full: else debts are never paid.

        What (1) is with the master's mass, the slave, the damper's spring, and forces that are held for a period.
        """

        def loop(frequency: Array) -> Complex:
            s, spring, full = 2j * np.pi * frequency, self.brake_stiffness, self.full_damping
            damper = full * spring / (spring + full * s) * np.exp(-0.5 * self.period * s)
            echo = self.transmitted(environment, frequency, "direct") * np.exp(
                -s * (self.round_trip - 2.0 * self.delay)
            )
            return np.asarray((echo + damper) / self.operator_impedance(frequency))

        return self._encircles_nothing(loop)

    def _encircles_nothing(self, loop: Callable[[Array], Complex]) -> bool:
        """Whether 1 + loop doesn't turn around 0, of a stable loop over frequencies [Hz]."""
        coarse = np.geomspace(1e-4, 1e4, 2000)
        gain = np.abs(loop(coarse))
        # above `top` the gain stays below 1/2, and 1 + Z_t/Z_m to the right of 0
        top = 1.1 * float(coarse[gain > 0.5].max(initial=1.0))
        # the delay turns the phase by at most 0.02 rad a step
        steps = 4000 + int(2 * np.pi * self.round_trip * top / 0.02)
        frequency = np.concatenate([coarse[coarse < 0.01], np.linspace(0.01, top, steps)])
        phase = np.unwrap(np.angle(1.0 + loop(frequency)))
        return bool(abs(phase[-1] - phase[0]) < np.pi)


def checked_method(name: str) -> str:
    """A method's name, if it is one."""
    if name not in METHODS:
        raise InputError(f"method '{name}'", "a method of reflection", near(name, METHODS))
    return name


def _not_negative(thing: object, *names: str) -> None:
    for name in names:
        value = getattr(thing, name)
        if not (is_number(value) and value >= 0):
            raise InputError(
                f"{name} {value}", "a finite number that isn't negative", "a negative gain gives energy: unstable"
            )
