"""Whether a motion keeps the robot's limits: every sample of it, and what lies between."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from kinid.errors import InputError
from kinid.planning.limits import Limits
from kinid.planning.trajectory import Trajectory
from kinid.writers import Json

Array = NDArray[np.float64]

#: what samples may differ by beyond what jerk within its limit explains (rounding), relative to 1 rad
CONTINUOUS = 1e-9

_UNITS = {"position": "rad", "velocity": "rad/s", "acceleration": "rad/s²", "jerk": "rad/s³", "torque": "N·m"}


@dataclass(frozen=True)
class Usage:
    """How much of one limit a motion uses at most: by which joint, when, and figures. share > 1 breaks it."""

    quantity: str
    joint: str
    share: float
    value: float
    limit: float
    t: float

    def __str__(self) -> str:
        unit = _UNITS[self.quantity]
        return f"{self.quantity} of {self.joint}: {self.value:.4g} of {self.limit:.4g} {unit} at {self.t:.3f} s"

    def to_dict(self) -> Json:
        """For JSON."""
        return {
            "quantity": self.quantity,
            "joint": self.joint,
            "share": self.share,
            "value": self.value,
            "limit": self.limit,
            "t": self.t,
        }


def usage(trajectory: Trajectory, limits: Limits, torque: Array | None = None) -> tuple[Usage, ...]:
    """The greatest share of each limit that any sample uses.

    The jerk is that which leads from one sample's acceleration to the next: the mean over the interval.

    Args:
        trajectory: checked. limits: of its joints. torque: joint torques with the contact force [N·m], (n, N), where
            known.
    """
    x, t = trajectory, trajectory.t
    with np.errstate(invalid="ignore"):  # a joint that turns on and on has no limits
        middle, half = 0.5 * (limits.lower + limits.upper), 0.5 * (limits.upper - limits.lower)
        shares = {"position": np.where(np.isfinite(half), np.abs(x.q - middle) / half, 0.0)}
    values = {
        "position": x.q,
        "velocity": x.dq,
        "acceleration": x.ddq,
        "jerk": np.diff(x.ddq, axis=0, append=x.ddq[-1:]) / np.append(np.diff(t), 1.0)[:, None],
    }
    if torque is not None:
        values["torque"] = torque
    for name in ("velocity", "acceleration", "jerk", "torque"):
        if name in values:
            shares[name] = np.abs(values[name]) / getattr(limits, name)
    out = []
    for name, share in shares.items():
        i, j = np.unravel_index(int(np.argmax(np.where(np.isfinite(share), share, np.inf))), share.shape)
        value = float(values[name][i, j])
        limit = float(_side(limits, value > middle[j])[j] if name == "position" else getattr(limits, name)[j])
        out.append(Usage(name, limits.names[j], float(share[i, j]), value, limit, float(t[i])))
    return tuple(out)


def breaks(trajectory: Trajectory, limits: Limits) -> float:
    """How far neighbouring samples are apart beyond what the jerk's limit explains [rad, rad/s, rad/s²]; 0 is
    continuous.

    With |q⃛| ≤ J: |q₁ − q₀ − h q̇₀ − h²/2 q̈₀| ≤ J h³/6, |q̇₁ − q̇₀ − h q̈₀| ≤ J h²/2, |q̈₁ − q̈₀| ≤ J h.
    """
    x, h, j = trajectory, np.diff(trajectory.t)[:, None], limits.jerk
    if not np.isfinite(j).all():
        return 0.0
    gaps = (
        np.abs(np.diff(x.q, axis=0) - h * x.dq[:-1] - h**2 / 2 * x.ddq[:-1]) - j * h**3 / 6,
        np.abs(np.diff(x.dq, axis=0) - h * x.ddq[:-1]) - j * h**2 / 2,
        np.abs(np.diff(x.ddq, axis=0)) - j * h,
    )
    return float(max(0.0, *(gap.max() for gap in gaps)))


def check(
    trajectory: Trajectory, limits: Limits, torque: Array | None = None, what: str = "the motion"
) -> tuple[Usage, ...]:
    """Refuse a motion that breaks a limit, naming the one it breaks most; else how much of each it uses.

    Raises:
        InputError: the limit, the joint, the time and figures.
    """
    found = usage(trajectory, limits, torque)
    worst = max(found, key=lambda use: use.share if np.isfinite(use.share) else np.inf)
    if not worst.share <= 1.0:
        raise InputError(
            f"{what}, whose binding limit is the {worst}", f"{worst.quantity} within the limit", _MEND[worst.quantity]
        )
    gap = breaks(trajectory, limits)
    if gap > CONTINUOUS:
        raise InputError(
            f"{what} with a jump of {gap:.3g} between samples", "joints that move continuously", "plan it again"
        )
    return found


def _side(limits: Limits, above: bool) -> Array:
    return limits.upper if above else limits.lower


_MEND = {
    "position": "move the surface, or turn the tool with --yaw",
    "velocity": "move slower: lower amplitudes or frequencies",
    "acceleration": "move more gently: lower amplitudes or frequencies",
    "jerk": "move more gently: lower amplitudes or frequencies, or a longer fade",
    "torque": "press less deep, or move the surface nearer",
}
