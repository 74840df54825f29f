"""Stiffness and damping of an impedance, and whether they are stable once they are sampled."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import eigh, expm

from kinid.controllers._given import is_number, numbers
from kinid.errors import InputError

Array = NDArray[np.float64]

#: the greatest translational stiffness that is accepted [N/m]: that of the source study's arm
GREATEST_STIFFNESS = 5200.0


@dataclass(frozen=True, eq=False)
class Gains:
    """Stiffness and damping of an impedance.

    Args:
        translation: stiffness along the three axes [N/m], one number or three; at most 5200.
        rotation: stiffness about them [N·m/rad], one number or three.
        axes: columns are the stiffness' axes in the base frame, (3, 3); default: the base's.
        ratio: damping ratio of each mode of stiffness and task-space inertia, 0 … 2.
        damping: a constant matrix instead, base axes, (6, 6) [N·s/m, N·s, N·m·s/rad].
        null_damping: of motions that leave the tip where it is [N·m·s/rad]; default: by the arm's masses, so that none
            lasts longer than `NULL_TIME`.

    Raises:
        InputError: a stiffness or damping that is negative, too great, not symmetric or not finite.
    """

    translation: float | tuple[float, float, float] = 2000.0
    rotation: float | tuple[float, float, float] = 100.0
    axes: Array = field(default_factory=lambda: np.eye(3))
    ratio: float = 0.7
    damping: Array | None = None
    null_damping: float | None = None

    def __post_init__(self) -> None:
        for name in ("translation", "rotation"):
            values = np.atleast_1d(numbers(getattr(self, name), (), f"{name} stiffness", "give one number, or three"))
            if values.shape not in ((1,), (3,)) or (values < 0).any():
                raise InputError(
                    f"{name} stiffness {getattr(self, name)}",
                    "one number or three, none negative",
                    "a negative stiffness pushes away from the target: unstable",
                )
            # a single number in a list is one number; lists and arrays become what they mean
            object.__setattr__(self, name, float(values[0]) if len(values) == 1 else tuple(values.tolist()))
        if np.max(self.translation) > GREATEST_STIFFNESS:
            raise InputError(
                f"translational stiffness {self.translation} N/m",
                f"at most {GREATEST_STIFFNESS:g} N/m",
                "choose a softer spring",
            )
        for name, most in (("ratio", 2.0), ("null_damping", np.inf)):
            value = getattr(self, name)
            if not (is_number(value) and 0 <= value <= most) and not (name == "null_damping" and value is None):
                raise InputError(
                    f"{name} {value}",
                    "a number that isn't negative" + (" nor above 2" if most == 2.0 else ""),
                    "negative damping gives energy: unstable",
                )
        axes = numbers(self.axes, (3, 3), "axes of the stiffness", "give a rotation")
        if np.abs(axes @ axes.T - np.eye(3)).max() > 1e-6 or np.linalg.det(axes) < 0:
            raise InputError(
                "axes of the stiffness that aren't orthonormal and right-handed",
                "a rotation (3, 3)",
                "normalise its columns, and turn one that is mirrored",
            )
        if self.damping is not None:
            check_dissipative(self.damping, "damping")
            object.__setattr__(self, "damping", np.ascontiguousarray(self.damping, dtype=float))

    def stiffness(self) -> Array:
        """K, base axes, (6, 6)."""
        axes, out = np.asarray(self.axes, dtype=float), np.zeros((6, 6))
        out[:3, :3] = axes @ np.diag(np.broadcast_to(self.translation, 3)) @ axes.T
        out[3:, 3:] = axes @ np.diag(np.broadcast_to(self.rotation, 3)) @ axes.T
        return out


def check_dissipative(matrix: Array, name: str) -> None:
    """Refuse a (6, 6) matrix that isn't symmetric and positive semi-definite."""
    values = numbers(matrix, (6, 6), name, "give linear rows first, then angular")
    scale = max(float(np.abs(values).max()), 1e-300)
    if np.abs(values - values.T).max() > 1e-9 * scale or np.linalg.eigvalsh(values).min() < -1e-9 * scale:
        raise InputError(
            f"a {name} matrix that can give energy",
            "a symmetric one without negative eigenvalues",
            "an active gain is unstable",
        )


def design_damping(stiffness: Array, inertia: Array, ratio: float) -> Array:
    """Damping that gives every mode of K and Λ the ratio ζ, by double diagonalisation, (6, 6).

    With Λ = Q Qᵀ and K = Q diag(k) Qᵀ it is 2 ζ Q diag(√k) Qᵀ (A. Albu-Schäffer, C. Ott, U. Frese, G. Hirzinger, ICRA
    2003).
    """
    values, vectors = eigh(stiffness, inertia)
    q = inertia @ vectors  # the inverse of vectorsᵀ, since vectorsᵀ Λ vectors = 1
    out = 2.0 * ratio * (q * np.sqrt(np.maximum(values, 0.0))) @ q.T
    return np.asarray(0.5 * (out + out.T))


def sampled_radius(stiffness: Array, damping: Array, inertia: Array, period: float) -> float:
    """Largest eigenvalue, in size, of inertia under a sampled spring and damper over one period; ≥ 1 is unstable.

    The wrench is held through the period, which makes a stiff spring give energy and a strong damper overshoot.
    """
    n = len(inertia)
    inverse = np.linalg.inv(inertia)
    whole = np.zeros((3 * n, 3 * n))
    whole[:n, n : 2 * n], whole[n : 2 * n, 2 * n :] = np.eye(n), inverse
    held = expm(whole * period)
    feedback = np.hstack([-stiffness, -damping])
    closed = held[: 2 * n, : 2 * n] + held[: 2 * n, 2 * n :] @ feedback
    return float(np.abs(np.linalg.eigvals(closed)).max())
