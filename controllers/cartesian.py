"""Controllers of an arm's tip: impedance, with its own or a decoupled inertia, and wrenches through Jᵀ."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import expm

from kinid.controllers._given import is_number, numbers
from kinid.controllers.gains import Gains, check_dissipative, design_damping, sampled_radius
from kinid.controllers.impedance import impedance_torque
from kinid.controllers.passivity import check_period
from kinid.controllers.state import ArmState, Target
from kinid.errors import InputError

Array = NDArray[np.float64]

#: time constant of null motions where their damping isn't given [s]: stable down to control at 10 Hz
NULL_TIME = 0.05
#: a turn whose cosine is so near −1 is half a turn; and by how much less is then asked [rad]
BALANCED, ASIDE = 1e-6, 0.02
#: motions without stiffness sit on the unit circle, a double eigenvalue that rounding moves by its root
STEADY = 1.0 + 1e-6


def _idle(jacobian: Array) -> Array:
    """Projector onto joint motions that leave the tip where it is, (N, N)."""
    return np.asarray(np.eye(jacobian.shape[1]) - np.linalg.pinv(jacobian) @ jacobian)


@dataclass(frozen=True, eq=False)
class Impedance:
    """Geometric impedance about a target; the tip keeps the arm's own, coupled inertia. See
    `kinid.controllers.impedance`.

    Args:
        gains: stiffness and damping. target: where the tip shall be; `toward` gives the controller with the next one.
        torque_limit: of each joint [N·m], (N,); torques are clipped to it.

    Raises:
        InputError: a torque limit that isn't positive.
    """

    gains: Gains
    target: Target
    torque_limit: Array

    def __post_init__(self) -> None:
        for name, kind in (("gains", Gains), ("target", Target)):
            if not isinstance(getattr(self, name), kind):
                raise InputError(
                    f"{name} {str(getattr(self, name))[:40]!r}", f"{kind.__name__}(…)", "see its docstring"
                )
        object.__setattr__(self, "torque_limit", checked_limit(self.torque_limit))

    def toward(self, target: Target) -> Self:
        """The same controller with another target."""
        return dataclasses.replace(self, target=target)

    def damping(self, state: ArmState) -> Array:
        """D at a state, (6, 6)."""
        if self.gains.damping is not None:
            return self.gains.damping
        return design_damping(self.gains.stiffness(), state.task_inertia(), self.gains.ratio)

    def command(self, state: ArmState) -> Array:
        """Joint torques [N·m], (N,), clipped to the limits; `saturates` says whether they were.

        A target turned by half a turn, where the spring is in balance, is taken to be `ASIDE` short of it.
        """
        return self._torque(state, per_joint(self.torque_limit, state))

    def saturates(self, state: ArmState) -> bool:
        """Whether a joint can't give what the impedance asks of it: a far target, say; another wrench comes out."""
        limit = per_joint(self.torque_limit, state)
        return bool((np.abs(self._torque(state, np.full(len(limit), np.inf))) > limit).any())

    def _torque(self, state: ArmState, limit: Array) -> Array:
        """Joint torques clipped to limits, (N,) both."""
        out, target = np.empty(len(state.dq)), self.target
        impedance_torque(
            state.rotation,
            state.position,
            state.jacobian,
            state.dq,
            state.gravity,
            short_of_half_a_turn(target.rotation, state),
            target.position,
            target.velocity,
            self.gains.stiffness(),
            self.damping(state),
            self.null_damping(state),
            limit,
            out,
        )
        return out

    def check(self, state: ArmState, period: float) -> None:
        """Refuse gains that are unstable about a state when the controller runs once a period [s].

        All joint motions count: a null-space damping in numbers is the first to fail where the state's masses hold no
        rotors.

        Raises:
            InputError: the sampled loop has an eigenvalue outside the unit circle; which gain is to blame.
        """
        check_period(period)
        radius = self._radius(state, period)
        if radius > STEADY:
            cause, mend = self._blame(state, period)
            raise InputError(
                f"{cause}, whose sampled loop grows by {radius:.4g} a period of {period:g} s", "at most 1", mend
            )

    def _blame(self, state: ArmState, period: float) -> tuple[str, str]:
        """The gain without which the loop would be stable, and what to do about it."""
        gains = self.gains

        def steady(**changes: object) -> bool:
            other = dataclasses.replace(self, gains=dataclasses.replace(gains, **changes))  # type: ignore[arg-type]
            return other._radius(state, period) <= STEADY

        if gains.null_damping and steady(null_damping=0.0):
            return (
                f"a null-space damping of {gains.null_damping:g} N·m·s/rad that is too strong for the arm's masses",
                "lower null_damping, leave it out, or state the rotors' inertias (ArmState.of)",
            )
        if gains.damping is None and steady(ratio=0.7):
            high = gains.ratio > 0.7
            return (
                f"a damping ratio of {gains.ratio:g} that is too {'high' if high else 'low'}",
                f"{'lower' if high else 'raise'} it towards 0.7",
            )
        return "gains", "less stiffness, another damping, or a shorter period"

    def null_damping(self, state: ArmState) -> float:
        """Damping of motions that leave the tip where it is [N·m·s/rad]: the gains', or by the lightest one's mass."""
        if self.gains.null_damping is not None:
            return self.gains.null_damping
        idle = _idle(state.jacobian)
        # mass of a null motion n: 1 / (nᵀ M⁻¹ n)
        mobility = float(np.linalg.eigvalsh(idle @ np.linalg.solve(state.mass, idle))[-1])
        return 0.0 if mobility < 1e-9 else 1.0 / (mobility * NULL_TIME)

    def _radius(self, state: ArmState, period: float) -> float:
        j = state.jacobian
        damping = j.T @ self.damping(state) @ j + self.null_damping(state) * _idle(j)
        return sampled_radius(j.T @ self.gains.stiffness() @ j, damping, state.mass, period)


@dataclass(frozen=True, eq=False)
class DecoupledImpedance(Impedance):
    """The same impedance around a shaped, decoupled inertia: a wrench along one axis accelerates the tip along it
    alone.

    τ = b + Jᵀ [Λ (ẍ_d + Λ_d⁻¹ (w + f) − J̇ q̇) − f] + Nᵀ τ₀ with w the impedance's wrench and f the measured wrench of
    the environment, so that Λ_d (ẍ − ẍ_d) = w + f; Nᵀ = I − Jᵀ Λ J M⁻¹ is dynamically consistent (O. Khatib, 1987; C.
    Ott, Cartesian Impedance Control, 2008, ch. 3). It needs the wrench and the arm's masses, and isn't passive where
    they are wrong.

    Args:
        inertia: Λ_d, base axes, (6, 6) [kg, kg·m, kg·m²]; None is the diagonal of the arm's own at each state.
    """

    inertia: Array | None = None

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.inertia is not None:
            check_dissipative(self.inertia, "inertia")
            if np.linalg.eigvalsh(self.inertia).min() <= 0:
                raise InputError(
                    "an inertia of zero along some direction", "a positive one", "give each axis some mass"
                )

    def shaped_inertia(self, state: ArmState) -> Array:
        """Λ_d at a state, (6, 6)."""
        return np.diag(np.diag(state.task_inertia())) if self.inertia is None else self.inertia

    def damping(self, state: ArmState) -> Array:
        """D for the shaped inertia, (6, 6)."""
        if self.gains.damping is not None:
            return self.gains.damping
        return design_damping(self.gains.stiffness(), self.shaped_inertia(state), self.gains.ratio)

    def _radius(self, state: ArmState, period: float) -> float:
        tip = sampled_radius(self.gains.stiffness(), self.damping(state), self.shaped_inertia(state), period)
        j = state.jacobian
        idle = np.eye(len(state.dq)) - j.T @ state.task_inertia() @ np.linalg.solve(state.mass, j.T).T
        rest = np.linalg.eigvals(
            np.eye(len(idle)) - period * self.null_damping(state) * np.linalg.solve(state.mass, idle)
        )
        return max(tip, float(np.abs(rest).max()))

    def _torque(self, state: ArmState, limit: Array) -> Array:
        """Joint torques clipped to limits, (N,) both."""
        own, target, wrench = state.task_inertia(), self.target, np.empty(6)
        # an arm that is the tip itself turns the kernel's torques into the impedance's wrench
        impedance_torque(
            state.rotation,
            state.position,
            np.eye(6),
            state.twist,
            np.zeros(6),
            short_of_half_a_turn(target.rotation, state),
            target.position,
            target.velocity,
            self.gains.stiffness(),
            self.damping(state),
            0.0,
            np.full(6, np.inf),
            wrench,
        )
        acceleration = target.acceleration + np.linalg.solve(self.shaped_inertia(state), wrench + state.wrench)
        tip = own @ (acceleration - state.drift) - state.wrench
        null = -self.null_damping(state) * state.dq
        null = null - state.jacobian.T @ (own @ (state.jacobian @ np.linalg.solve(state.mass, null)))
        torque = state.bias + state.jacobian.T @ tip + null
        return np.asarray(np.clip(torque, -limit, limit))


@dataclass(frozen=True, eq=False)
class JacobianTranspose:
    """Renders a wrench at the tip by τ = g + Jᵀ w − d P q̇, clipped to the limits; no inertia is compensated.

    Args:
        wrench: that the tip puts on the hand or the environment, at the tip, force then moment, base axes, (6,) [N,
            N·m].
        torque_limit: [N·m], (N,). null_damping: [N·m·s/rad].

    Raises:
        InputError: a wrench that isn't six finite numbers, or a limit or damping that isn't positive.
    """

    wrench: Array
    torque_limit: Array
    null_damping: float = 0.0

    def __post_init__(self) -> None:
        object.__setattr__(self, "wrench", numbers(self.wrench, (6,), "a wrench", "give force, then moment"))
        if not (is_number(self.null_damping) and self.null_damping >= 0):
            raise InputError(f"null_damping {self.null_damping}", "a number that isn't negative", "use 0 for none")
        object.__setattr__(self, "torque_limit", checked_limit(self.torque_limit))

    def command(self, state: ArmState) -> Array:
        """Joint torques [N·m], (N,)."""
        out, zero = np.empty(len(state.dq)), np.zeros((6, 6))
        impedance_torque(
            state.rotation,
            state.position,
            state.jacobian,
            state.dq,
            state.gravity + state.jacobian.T @ self.wrench,
            state.rotation,
            state.position,
            np.zeros(6),
            zero,
            zero,
            self.null_damping,
            per_joint(self.torque_limit, state),
            out,
        )
        return out

    def saturates(self, state: ArmState) -> bool:
        """Whether a joint can't give its share of the wrench, so that another wrench comes out."""
        return bool(
            (np.abs(state.gravity + state.jacobian.T @ self.wrench) > per_joint(self.torque_limit, state)).any()
        )


def short_of_half_a_turn(rotation: Array, state: ArmState) -> Array:
    """A target's rotation; where it is half a turn from the tip's, `ASIDE` less: any way round is as short, and one is
    chosen.

    Exactly there the spring's moment about the axis of the turn vanishes; the tip would stay turned over, at rest.
    """
    left = rotation @ state.rotation.T
    if np.trace(left) > -1.0 + BALANCED:
        return rotation
    both = left + np.eye(3)  # 2 a aᵀ about an axis a
    axis = both[:, int(np.argmax(np.diag(both)))]
    x, y, z = -ASIDE * axis / np.sqrt(axis @ axis)
    return np.ascontiguousarray(expm(np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])) @ rotation)


def checked_limit(limit: Array) -> Array:
    """Torque limits as positive numbers, (N,)."""
    try:
        values = np.atleast_1d(np.asarray(limit, dtype=float))
    except (TypeError, ValueError):
        values = np.full(1, np.nan)
    if values.ndim != 1 or not (values > 0).all():
        raise InputError(
            f"torque limits {values}", "one positive number a joint [N·m]", "take them from the robot's data sheet"
        )
    return values


def per_joint(limit: Array, state: ArmState) -> Array:
    """Torque limits of this arm, (N,): one for all, or one a joint; kernels don't look at lengths.

    Raises:
        InputError: as many limits as the arm has no joints.
    """
    joints = len(state.gravity)
    if len(limit) not in (1, joints):
        raise InputError(
            f"{len(limit)} torque limits for {joints} joints",
            "one for all, or one a joint [N·m]",
            "take them from the robot's data sheet",
        )
    return np.ascontiguousarray(np.broadcast_to(limit, joints))
