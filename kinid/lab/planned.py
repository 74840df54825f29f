"""A planned trajectory as an experiment: what `kinid plan` wrote, carried out by the virtual arm."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from kinid.contact.series import contact_series
from kinid.data.rig import Rig
from kinid.errors import InputError
from kinid.lab.experiments import Vector, prepare
from kinid.lab.feasible import check_gains
from kinid.lab.protocol import Script
from kinid.lab.setup import LOG_EVERY, Result, Setup
from kinid.planning.following import SetPoints, set_points
from kinid.planning.limits import JERK, Limits
from kinid.planning.trajectory import Trajectory, read_trajectory
from kinid.robotics.robot import Robot

Array = NDArray[np.float64]

#: a trajectory begins at rest: no joint faster than this [rad/s]
REST = 0.01
#: accelerations are means over so long [s]; plans keep to the limits at each sample, but for rounding
SMOOTH, ROUNDED = 5e-3, 1.05
#: jerks beyond so many times what plans keep to, and a share of the speed beyond the arm's bandwidth, are said
JERKS, FAST = 2.0, 0.3
#: a guard looks at the mean of the measured force over so long [s]: noise doesn't stop the arm
REACTION = 0.01
#: by how much tip, slip and depth that a trajectory states may differ from where its joints put the tip [m]
SAME = 1e-4
#: set-points that are carried out, at most: at 1 kHz, half an hour and more
MOST_POINTS = 2_000_000
#: samples this far apart [s], between which no joint gets faster than the second [rad/s], have times in another unit
FAR_APART, CRAWLS = 0.5, 0.01
#: share of the speed (root mean squares) that stated velocities may differ by from the positions' changes
OTHER_SPEED = 0.1


@dataclass(frozen=True, eq=False)
class Planned(Script):
    """Set-points as a plan has them.

    Attributes:
        q: joints of the plan, log order, (n, N). positions: of the tip, base frame [m], (n, 3). rotations: (n, 3, 3).
        force_limit: of the measured normal force [N], (n,), infinite: no guard; None: none anywhere.
    """

    q: Array
    positions: Array
    rotations: Array
    force_limit: Array | None = None

    def poses(self, axes: Array, point: Array) -> tuple[Array, Array]:
        """Positions (n, 3) and rotations (n, 3, 3) of the tip, wherever the surface lies."""
        return self.positions, self.rotations

    def joints(self, rows: NDArray[np.int64], robot: Robot, axes: Array, point: Array, start: Array) -> Array:
        """The plan's own joints at some set-points, (rows, N)."""
        return self.q[rows]

    def held(self, row: int) -> Planned:
        """The same until a set-point, which is held from there on."""
        rows = np.minimum(np.arange(len(self.t)), row)
        phase = np.where(np.arange(len(self.t)) > row, "hold", self.phase)
        return dataclasses.replace(
            self,
            phase=phase,
            place=self.place[rows],
            tilt=self.tilt[rows],
            q=self.q[rows],
            positions=self.positions[rows],
            rotations=self.rotations[rows],
        )


def guarded(result: Result) -> tuple[Result, list[str]]:
    """The guarded move that a plan with a force limit asks for, and what came of it, one line each.

    Where the measured normal force passes the limit, set-points stand still: the run is made once more with the
    set-point held from there on. Until then nothing differs, because the seed alone decides.

    Args:
        result: of a plan, as if there were no limit.
    """
    script = result.setup.script
    if not isinstance(script, Planned) or script.force_limit is None or not np.isfinite(script.force_limit).any():
        return result, []
    limit, force = script.force_limit[::LOG_EVERY], _measured(result)
    over = np.flatnonzero(force > limit)
    if not len(over):
        return result, []
    row = LOG_EVERY * int(over[0])
    result = result.setup.replace(script=script.held(row)).run()
    return result, [
        f"the force passed the plan's limit of {limit[over[0]]:.4g} N ({_measured(result).max():.4g} N) after "
        f"{script.t[row]:.2f} s, in {script.phase[row]}: the set-point was held from there on"
    ]


def _measured(result: Result) -> Array:
    """The measured normal force of the log [N], (n,), meaned over what lies `REACTION` behind."""
    force = contact_series(result.log, result.setup.rig, trust_wrench=True).normal_force
    assert force is not None
    count = max(1, round(REACTION / (LOG_EVERY * result.setup.gains.period)))
    sums = np.cumsum(np.concatenate([np.zeros(count), np.nan_to_num(force)]))
    out: Array = (sums[count:] - sums[:-count]) / count
    return out


def planned(
    path: Path,
    rig: Rig | None = None,
    *,
    base: Setup | None = None,
    point: Vector | None = None,
    normal: Vector | None = None,
) -> tuple[Setup, bool]:
    """The set-up that carries a trajectory out, and whether set-points go ahead of it by the forces that the plan
    expects.

    Args:
        path: Parquet, CSV or NPZ, as `kinid.planning.read_trajectory` reads it.
        rig: that it was planned for: its surface and tool are touched and carried; default: the laboratory's.
        base: what is touched, gains, sensor and seed; default: as for a poke. point, normal: of the surface instead.

    Raises:
        InputError: no trajectory; another robot's joints, limits, kinematics or surface; times in another unit, or too
            many; velocities that aren't the positions'; a start in motion or in the material.
    """
    base = base or prepare("poke", point=point, normal=normal)
    check_gains(base.gains)
    moved = point is not None or normal is not None
    if rig is not None:
        base = _as_rigged(base, rig, moved)
    robot = base.robot
    motion = read_trajectory(path, robot.joint_names)
    _check_times(path, motion, base.gains.period)
    _check_velocities(path, motion)
    ahead = motion.force is not None and bool(np.isfinite(motion.force).all())
    points = set_points(motion, robot, base.gains.period, base.gains.translation if ahead else None)
    _check_limits(path, robot, points)
    _check_smooth(path, robot, points, base.gains.period)
    place, reached = _on_surface(base, points.positions), robot.kinematics(robot.tip_frame or "", motion.q).position
    tip = _on_surface(base, reached)
    _check_start(path, robot, points, tip)
    _check_tip(path, motion, reached)
    if rig is not None and rig.surface is not None and not moved:
        _check_surface(path, motion, tip)
    limit = None
    if motion.force_limit is not None:
        row = np.searchsorted(motion.t - motion.t[0], points.t + 1e-9, side="right") - 1
        limit = np.nan_to_num(motion.force_limit, nan=np.inf, posinf=np.inf)[row]
    script = Planned(
        points.t, points.phase, place, np.zeros((len(points.t), 2)), points.q, points.positions, points.rotations, limit
    )
    return base.replace(script=script), ahead


def _as_rigged(base: Setup, rig: Rig, moved: bool) -> Setup:
    """With the rig's surface and tool; its sensor stays the laboratory's."""
    ours, theirs = Rig.parse({"robot": {"model": base.model}}).robot, rig.robot
    if theirs is not None and theirs != ours:
        differ = [name for name in type(theirs).model_fields if getattr(theirs, name) != getattr(ours, name)]
        raise InputError(
            f"a rig whose [robot] {', '.join(differ)} isn't the laboratory's",
            f'[robot] model = "{base.model}" alone',
            "plan for it, or name its rig with --rig",
        )
    if rig.tool is not None:
        base = base.replace(tool=rig.tool)
    if moved or rig.surface is None:
        return base
    if rig.surface.point is None or rig.axes is None:
        raise InputError(
            "a rig whose surface is a mesh",
            "a plane: [surface] point and normal",
            "plan on a plane, or name another with --point and --normal",
        )
    tangent, _, normal = (tuple(axis.tolist()) for axis in rig.axes)
    return base.replace(point=rig.surface.point, normal=normal, tangent=tangent)


def _on_surface(setup: Setup, positions: Array) -> Array:
    """Along both tangents, and depth [m], (n, 3)."""
    out: Array = (positions - np.asarray(setup.point)) @ setup.axes.T * np.array([1.0, 1.0, -1.0])
    return out


def _check_times(path: Path, motion: Trajectory, period: float) -> None:
    """Times in seconds, and no more of them than can be carried out."""
    step, points = float(np.median(np.diff(motion.t))), motion.duration / period
    speed = float(np.abs(np.diff(motion.q, axis=0) / np.diff(motion.t)[:, None]).max())
    if step > FAR_APART and speed < CRAWLS:
        raise InputError(
            f"{path} with samples {step:.3g} s apart, between which no joint gets faster than {speed:.2g} rad/s",
            "times in s",
            "divide the column t by 1000, if it is in ms",
        )
    if points > MOST_POINTS:
        raise InputError(
            f"{path} of {motion.duration:.4g} s, {points:.3g} set-points at {1.0 / period:g} Hz",
            f"{MOST_POINTS} at most",
            "cut it into several, or write its times in s",
        )


def _check_velocities(path: Path, motion: Trajectory) -> None:
    """Stated velocities are the positions' derivative: q₁ − q₀ = h (q̇₀ + q̇₁) / 2 + h² (q̈₀ − q̈₁) / 12, but for the
    fifth power of the step h.
    """
    h = np.diff(motion.t)[:, None]
    moved = np.diff(motion.q, axis=0) / h
    stated = 0.5 * (motion.dq[1:] + motion.dq[:-1]) - h * np.diff(motion.ddq, axis=0) / 12.0
    apart, speed = (np.sqrt(np.mean(part**2, axis=0)) for part in (stated - moved, moved))
    j = int(np.argmax(apart))
    if not apart[j] <= OTHER_SPEED * max(float(speed.max()), REST):
        raise InputError(
            f"{path}, whose dq{j + 1} is not the derivative of q{j + 1}: {apart[j]:.3g} rad/s beside it, where the "
            f"joints move at {float(speed.max()):.3g} rad/s (root mean squares)",
            "velocities in rad/s, of these positions over these times",
            "correct dq and ddq, or the unit of t; or leave both out, and they are worked out",
        )


def _check_tip(path: Path, motion: Trajectory, reached: Array) -> None:
    """The tip that the plan states is where the joints put it, (n, 3)."""
    if not np.isfinite(motion.tip).all():
        return
    apart = float(np.linalg.norm(motion.tip - reached, axis=1).max())
    if apart > SAME:
        raise InputError(
            f"{path}, whose tip_x, tip_y, tip_z lie up to {1e3 * apart:.2f} mm beside where its joints put the tip",
            "joints and tip of one motion of this arm, in rad and m",
            "name the rig that it was planned for with --rig, or leave the tip's columns out: the joints are followed",
        )


def _check_limits(path: Path, robot: Robot, points: SetPoints) -> None:
    """Positions and speeds at every set-point."""
    over = np.maximum(points.q - robot.upper, robot.lower - points.q)
    if over.max() > 0.0:
        i, j = np.unravel_index(int(over.argmax()), over.shape)
        raise InputError(
            f"{path} with {robot.joint_names[j]} at {points.q[i, j]:.3f} rad after {points.t[i]:.2f} s (limits "
            f"{robot.lower[j]:.3f}, {robot.upper[j]:.3f})",
            "joints within their limits",
            "plan within the virtual arm's limits",
        )
    most = robot.velocity_limit
    share = np.abs(points.dq) / np.where(most > 0, most, np.inf)
    if share.max() > 1.0:
        i, j = np.unravel_index(int(share.argmax()), share.shape)
        raise InputError(
            f"{path} with {robot.joint_names[j]} at {points.dq[i, j]:.2f} rad/s after {points.t[i]:.2f} s (limit "
            f"{most[j]:.2f} "
            "rad/s)",
            "speeds within the joints' limits",
            "move more slowly, or repair a jump in the table",
        )


def _check_smooth(path: Path, robot: Robot, points: SetPoints, period: float) -> None:
    """Accelerations that the arm has: a plan that was hurried, and a log's noise, ask for others."""
    limits, h = Limits.of(robot), max(1, round(SMOOTH / period))
    if len(points.t) <= h:
        return
    mean = np.abs(points.dq[h:] - points.dq[:-h]) / (h * period)
    over = mean / limits.acceleration
    if over.max() > ROUNDED:
        i, j = np.unravel_index(int(over.argmax()), over.shape)
        raise InputError(
            f"{path} with {robot.joint_names[j]} at {mean[i, j]:.1f} rad/s² after {points.t[i]:.2f} s (limit "
            f"{limits.acceleration[j]:g} rad/s²)",
            "accelerations that the arm has",
            "move more slowly; smooth what was measured",
        )


def doubts(setup: Setup) -> list[str]:
    """What of a trajectory the arm won't follow, one line each: it is a mass behind the controller's spring."""
    script, period = setup.script, setup.gains.period
    assert isinstance(script, Planned)
    lines = []
    jerk = float(np.abs(np.diff(script.q, n=3, axis=0)).max(initial=0.0)) / period**3
    if jerk > JERKS * JERK:
        lines.append(
            f"joints asked to jerk by {jerk:.2g} rad/s³, where plans keep to {JERK:g}: a log's noise, or a hurried plan"
        )
    state = setup.arm.state(script.q[int(np.argmax(script.place[:, 2]))][setup.arm.columns])
    moved, inertia = state.jacobian[:3], state.mass + np.diag(setup.joints.packed[0])
    heaviest = 1.0 / float(np.linalg.eigvalsh(moved @ np.linalg.solve(inertia, moved.T))[0])
    bandwidth = float(np.sqrt(setup.gains.translation / heaviest)) / (2 * np.pi)
    speed = np.diff(script.positions, axis=0) / period
    power = (np.abs(np.fft.rfft(speed, axis=0)) ** 2).sum(axis=1)
    fast = np.fft.rfftfreq(len(speed), period) > bandwidth
    share = float(np.sqrt(power[fast].sum() / max(power.sum(), 1e-300)))
    if share > FAST:
        lines.append(
            f"{100 * share:.0f} % of the tip's speed (rms) are above {bandwidth:.1f} Hz, where a tip of "
            f"{heaviest:.1f} kg behind {setup.gains.translation:g} N/m no longer follows"
        )
    return lines


def _check_start(path: Path, robot: Robot, points: SetPoints, tip: Array) -> None:
    fast = int(np.abs(points.dq[0]).argmax())
    if abs(points.dq[0, fast]) > REST:
        raise InputError(
            f"{path}, which begins with {robot.joint_names[fast]} at {points.dq[0, fast]:.3f} rad/s",
            "a trajectory that begins at rest",
            "begin it with a moment of standing still",
        )
    if tip[0, 2] > 0.0:
        raise InputError(
            f"{path}, which begins {1e3 * tip[0, 2]:.2f} mm inside the material",
            "a start in the air",
            "begin above the surface, or name the rig that it was planned for with --rig",
        )


def _check_surface(path: Path, motion: Trajectory, tip: Array) -> None:
    """The slip and the depth that the plan states are those on this surface, (n, 3)."""
    if motion.place is None or not np.isfinite(motion.place).all():
        return
    apart = np.abs(motion.place - tip).max(axis=0)
    for what, most in (("depths", apart[2]), ("slips", apart[:2].max())):
        if most > SAME:
            raise InputError(
                f"{path}, whose {what} lie up to {1e3 * most:.2f} mm beside those on this surface",
                "a trajectory that was planned for it",
                "name the rig that it was planned for with --rig",
            )
