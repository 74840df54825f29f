"""The force at an arm's tip from its joint torques, for arms without a wrist sensor.

A force f on the tip (base axes) is held by joint torques −Jᵀ f beside those of the motion: r = τ − τ_model = −Jᵀ f + e.
On a smoothed motion this residual is what the generalised-momentum observer tends to without its lag (A. De Luca, R.
Mattone, IEEE ICRA 2003, 2005). A tip that touches at a point takes no moment: three unknowns for the equations of all
joints, which is better conditioned than six; what they have in common no force at the tip makes, and tells so.

The error e is learnt from free motion, where r is e: friction of each joint, a level that wanders with the posture,
and the covariance Σ of what is left. With a normal prior f ~ N(0, F² I) the force has the mean P J Σ⁻¹ (−r) and the
covariance P = (J Σ⁻¹ Jᵀ + I/F²)⁻¹: along directions that the joints don't feel, as in singular poses, it stays near
zero and its standard deviation rises to F, where least squares alone would make absurd forces of noise.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from kinid.kernels.memory import JOINT_BRISTLES, joint_directions
from kinid.robotics.robot import Robot
from kinid.signal.pieces import GAP_FACTOR

Array = NDArray[np.float64]
Rows = NDArray[np.int64]

#: standard deviation F of a contact force before anything is measured, along each axis [N]: what arms of this kind push
PRIOR = 100.0
#: a force that is known no better than to this share of that is not known
UNKNOWN = 0.5
#: free motion is averaged over so long for the level of the torques' error [s]
BLOCK = 0.25
#: so many of these averages, at most, are held out to see how well others tell them
HELD_OUT = 500
#: bristles by which dry friction of a joint turns over may be longer or shorter than stated by this factor
FORM = 3.0
#: standard deviation of a torque sensor's gain, which free motion tells of weights alone
GAIN = 0.02
#: samples of free motion, at least, from which errors are learnt; from less, they are this share of the largest torque
FEWEST, UNLEARNT = 100, 0.05
#: friction is at most so many times what free motion leaves, as standard deviations before it is looked at
LOOSE = 3.0
#: a joint's speed that says nothing of its viscous friction [rad/s or m/s]
SLOW = 0.02
#: variances are at least this share of the mean one, so that a joint that is never moved isn't believed without bound
LEAST = 1e-6


@dataclass(frozen=True, eq=False)
class TorqueError:
    """What joint torques hold beside the motion's and a contact's, at each sample.

    Attributes:
        mean: [N·m or N], (n, N). common: covariance that all samples have, (N, N). variance: of each joint at each
            sample beside that, (n, N).
        learnt: samples of free motion that it was learnt from; 0 where there were too few.
    """

    mean: Array
    common: Array
    variance: Array
    learnt: int

    def rows(self, rows: Rows) -> TorqueError:
        """The same at some samples."""
        return TorqueError(self.mean[rows], self.common, self.variance[rows], self.learnt)

    @property
    def covariance(self) -> Array:
        """At each sample, (n, N, N)."""
        return np.asarray(self.common + np.einsum("nj,jk->njk", self.variance, np.eye(len(self.common))))


@dataclass(frozen=True, eq=False)
class TipForce:
    """Force of the surroundings on the tip, base axes.

    Attributes:
        force: [N], (n, 3). covariance: [N²], (n, 3, 3).
        reduced_chi_square: of what no force at the tip makes of the torques, 1 where errors are as expected, (n,);
            NaN of arms of three joints or less, which leave nothing over.
    """

    force: Array
    covariance: Array
    reduced_chi_square: Array


def tip_jacobian(robot: Robot, q: Array) -> Array:
    """Velocity of the tip in base axes for each joint's own, (n, 3, N), joints in the log's order, q (n, N).

    Raises:
        InputError: no tip frame.
    """
    units = np.eye(robot.joint_count)
    columns = [robot.kinematics(robot.tip_frame or "", q, np.tile(unit, (len(q), 1))).velocity for unit in units]
    return np.stack(columns, axis=2)


@dataclass(frozen=True, eq=False)
class Directions:
    """Which way each joint last moved.

    Attributes:
        turned: from −1 to 1, (n, N). variance: of that, as the length of the bristles isn't known, (n, N).
    """

    turned: Array
    variance: Array


def directions(t: Array, dq: Array, period: float, slides: Sequence[bool]) -> Directions:
    """Which way each joint last moved, by Dahl's bristles (P. R. Dahl, 1968).

    Args:
        t: [s], (n,). dq: joint speeds, NaN where unknown, (n, N). period: of the log [s]; memory begins anew behind a
            gap. slides: whether each joint does, N.
    """
    dt = np.diff(t, prepend=t[0])
    dt[(dt > GAP_FACTOR * period) | ~np.isfinite(dq).all(axis=1)] = 0.0
    speed, lengths = np.nan_to_num(dq.T), np.array([JOINT_BRISTLES[int(slide)] for slide in slides])
    short, stated, long = (joint_directions(speed, dt, f * lengths).T for f in (1.0 / FORM, 1.0, FORM))
    return Directions(stated, 0.25 * (short - long) ** 2)


def torque_error(t: Array, residual: Array, dq: Array, moved: Directions, free: Rows, measured: Array) -> TorqueError:
    """Learn what the residual holds beside contact.

    Args:
        t: [s], (n,). residual: measured less modelled torques, (n, N). dq: joint speeds, (n, N). moved: `directions`.
        free: rows in free motion. measured: torques as logged, (n, N), whose size stands in where too few are free, as
            drives of one arm are alike.
    """
    free = free[np.isfinite(residual[free] + dq[free]).all(axis=1)]
    joints = residual.shape[1]
    if len(free) < FEWEST:
        size = UNLEARNT * float(np.nanmax(np.abs(measured), initial=0.0))
        return TorqueError(np.zeros_like(residual), size**2 * np.eye(joints), (GAIN * residual) ** 2, 0)
    rub, rub_variance = _friction(t, residual, dq, moved, free)
    level, covariance = _level(t, residual - rub, free)
    covariance += LEAST * np.trace(covariance) / joints * np.eye(joints)
    mean = rub + level
    return TorqueError(mean, covariance, rub_variance + (GAIN * (residual - mean)) ** 2, len(free))


def tip_force(jacobian: Array, residual: Array, error: TorqueError) -> TipForce:
    """The force on the tip that joint torques hold.

    Args:
        jacobian: of the tip in base axes, (n, 3, N). residual: measured less modelled torques, (n, N). error: in it.
    """
    torque, error_covariance = residual - error.mean, error.covariance
    weighted = np.linalg.solve(error_covariance, np.swapaxes(jacobian, 1, 2))  # Σ⁻¹ Jᵀ
    precision = jacobian @ weighted + np.eye(3) / PRIOR**2
    covariance = np.linalg.inv(precision)
    force = -np.einsum("nij,nkj,nk->ni", covariance, weighted, torque)
    left = torque + np.einsum("nij,ni->nj", jacobian, force)
    over = residual.shape[1] - 3
    square = np.einsum("nj,nj->n", left, np.linalg.solve(error_covariance, left[:, :, None])[:, :, 0])
    return TipForce(
        np.asarray(force), np.asarray(covariance), square / over if over > 0 else np.full_like(square, np.nan)
    )


def _friction(t: Array, residual: Array, dq: Array, moved: Directions, free: Rows) -> tuple[Array, Array]:
    """Viscous and dry friction of each joint as free motion shows it, and its variance, (n, N) each.

    Least squares with a loose normal prior: a joint that free motion doesn't turn both ways keeps a large variance
    where it does so in contact. Neighbouring samples count as one per `BLOCK`.
    """
    mean, variance = np.zeros_like(residual), np.zeros_like(residual)
    share = min(1.0, max(2.0, float(np.ptp(t[free])) / BLOCK) / len(free))
    for j in range(residual.shape[1]):
        features = np.stack([dq[:, j], moved.turned[:, j]], axis=1)
        centred = features - features[free].mean(axis=0)
        target = residual[free, j] - residual[free, j].mean()
        spread = max(float(np.std(target)), 1e-12)
        scale = np.array([max(float(np.std(dq[free, j])), SLOW), 1.0])
        prior = np.diag((scale / (LOOSE * spread)) ** 2)
        for _ in range(2):  # with the spread of all that is there, then with that of what friction leaves
            known = np.linalg.inv(share / spread**2 * centred[free].T @ centred[free] + prior)
            values = known @ (share / spread**2 * centred[free].T @ target)
            spread = max(float(np.std(target - centred[free] @ values)), 1e-12)
        mean[:, j] = centred @ values
        variance[:, j] = np.einsum("ni,ij,nj->n", centred, known, centred) + values[1] ** 2 * moved.variance[:, j]
    return mean, variance


def _block_means(t: Array, values: Array) -> tuple[Array, Array]:
    """Mean time and values of each `BLOCK` that holds samples, (k,) and (k, N)."""
    of, counts = np.unique(np.floor((t - t[0]) / BLOCK), return_inverse=True, return_counts=True)[1:]
    times = np.bincount(of, t) / counts
    means = np.stack([np.bincount(of, column) / counts for column in values.T], axis=1)
    return times, means


def _between(t: Array, times: Array, means: Array) -> Array:
    """The level at times t (n,): straight between the blocks before and after, (n, N)."""
    return np.stack([np.interp(t, times, column) for column in means.T], axis=1)


def _level(t: Array, values: Array, free: Rows) -> tuple[Array, Array]:
    """The level of torques (n, N) that free motion tells, (n, N), and the covariance of what is beside it, (N, N).

    Of each joint it is straight between the blocks of free motion before and after, or the mean of all where that comes
    nearer to blocks left out: a level that hangs on the posture is another soon after an arm has moved on. Each block
    in turn is predicted from those that are away from it by half the longest time without free motion, or a third of
    the time of all blocks where that is less.
    """
    times, means = _block_means(t[free], values[free])
    gap = float(np.diff(np.concatenate([t[:1], t[free], t[-1:]])).max())
    away = max(BLOCK, min(0.5 * gap, float(np.ptp(times)) / 3.0))
    local, common = [], []
    every = 1 + len(times) // HELD_OUT
    for time, mean in zip(times[::every], means[::every]):
        far = np.abs(times - time) >= away
        if far.any():
            local.append(mean - _between(np.array([time]), times[far], means[far])[0])
            common.append(mean - means[far].mean(axis=0))
    errors = np.array([local, common]).reshape(2, -1, values.shape[1])
    beside, quick = _between(t, times, means), values[free] - _between(t[free], times, means)
    near = np.sum(errors[0] ** 2, axis=0) <= np.sum(errors[1] ** 2, axis=0)
    chosen = np.where(near, errors[0], errors[1])
    level = np.where(near, beside, means.mean(axis=0))
    return level, np.asarray(quick.T @ quick / len(quick) + chosen.T @ chosen / max(1, len(chosen)))
