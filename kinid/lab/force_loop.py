"""The laboratory's arm under force control: impedance, drives and contact as in `kinid.lab.loop_experiment`, with
set-points that a force controller chooses while it runs.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from kinid.controllers.force import ForceControl, GainSource, Reading, Reference
from kinid.errors import KinidError
from kinid.lab import _law as law
from kinid.lab import closed_loop as kernel
from kinid.lab.arm import design_damping, joints_along
from kinid.lab.protocol import Script
from kinid.lab.setup import Setup

Array = NDArray[np.float64]

#: time constant of the filter behind force, depth and rate [s]: the noise of a Mini40 at 1 kHz falls to a third
FILTER = 5e-3
#: standard deviation of the depth by encoders of 2 µrad on an arm of 0.6 m [m]
DEPTH_NOISE = 1e-6


@dataclass(frozen=True, eq=False)
class Job:
    """A wanted force along a path.

    Attributes:
        name: of the job. place: of the set-point along both tangents [m], (n, 2), one a control period.
        wanted: normal force [N], (n,). scored: periods that count, (n,).
        least: force from which it is stepped to the greatest wanted one [N]. period: of control [s].
    """

    name: str
    place: Array
    wanted: Array
    scored: NDArray[np.bool_]
    least: float = 0.0
    period: float = 1e-3


@dataclass(frozen=True, eq=False)
class Course:
    """What a run of a job gave, one row a control period.

    Attributes:
        job: that was done. force: of the material along the normal, as it is [N], (n,). place: along both tangents, and
            depth [m], (n, 3). model: of the contact in use, K [N/m], B [N·s/m] and the bandwidth ω [rad/s], (n, 3).
    """

    job: Job
    force: Array
    place: Array
    model: Array

    def error(self, reference: bool = False) -> float:
        """Root mean square of wanted less true force where it counts [N].

        Args:
            reference: what the arm is asked for counts as wanted, see `kinid.controllers.force.Reference`.
        """
        wanted = self.job.wanted
        if reference:
            smooth = Reference(self.job.period)
            wanted = np.array([smooth.step(float(value))[0] for value in wanted])
        return float(np.sqrt(np.mean((wanted - self.force)[self.job.scored] ** 2)))

    @property
    def overshoot(self) -> float:
        """Greatest force beyond the greatest wanted one, where it counts, as a share of the step to that [1]."""
        rows = self.job.scored
        most = float(self.job.wanted[rows].max())
        return max(0.0, float(self.force[rows].max()) - most) / (most - self.job.least)


class ForceLoop:
    """The arm of a set-up whose tip begins at the surface.

    Args:
        setup: its script isn't used.
    """

    def __init__(self, setup: Setup) -> None:
        self.setup, self._postures = setup, dict[tuple[float, ...], Array]()
        fields, patches, grid = setup.material.raster()
        material = (setup.material.packed(), patches, fields, grid, np.empty(law.FIELDS))
        point = np.asarray(setup.point) + setup.surface_offset * setup.axes[2]
        self._surface = kernel.Surface(np.ascontiguousarray(setup.true_axes), point, material)

    def posture(self, place: Array) -> Array:
        """Joints of the arm, in the chain's order, whose tip is on the rig's surface at a place (2,) [m]."""
        s, key = self.setup, tuple(np.asarray(place, dtype=float).tolist())
        if key not in self._postures:
            positions, rotations = _on_surface(np.atleast_2d(place), s)
            found = joints_along(s.robot, positions, rotations, s.start)[0, s.arm.columns]
            self._postures[key] = np.asarray(found, dtype=np.float64)
        return self._postures[key]

    def inertia(self, place: Array) -> float:
        """Of the tip along the normal, held in all other directions, at a place (2,) of the surface [kg]."""
        state, normal = self.setup.arm.state(self.posture(place)), self.setup.axes[2]
        mass = state.mass + np.diag(self.setup.joints.packed[0])
        task = np.linalg.inv(state.jacobian @ np.linalg.solve(mass, state.jacobian.T))
        return float(normal @ task[:3, :3] @ normal)

    def damping(self, joints: Array) -> Array:
        """Of the impedance at a posture, (6, 6)."""
        return np.ascontiguousarray(design_damping(self.setup.gains, self.setup.arm, self.setup.joints, joints))

    def run(self, job: Job, control: ForceControl, source: GainSource, seed: int = 0) -> Course:
        """Do a job.

        Args:
            job: the wanted force. control, source: new ones. seed: of the sensor's noise.

        Raises:
            KinidError: the loop diverged.
        """
        s, normal = self.setup, self.setup.axes[2]
        positions, rotations = _on_surface(job.place, s)
        speed = np.gradient(positions, s.gains.period, axis=0)
        arm, sensing = _Stepped(self, self.posture(job.place[0])), _Sensing(s, seed)
        force, place, model = np.empty(len(job.wanted)), np.empty((len(job.wanted), 3)), np.empty((len(speed), 3))
        now = Reading(0.0, float(job.place[0, 0]), float(job.place[0, 1]), 0.0, 0.0, 0.0)
        for i, wanted in enumerate(job.wanted):
            known = source.contact(now)
            depth, rate = control.command(float(wanted), now.force, known)
            force[i], place[i] = arm.step(positions[i] - depth * normal, speed[i] - rate * normal, rotations[i])
            model[i] = known[:3]
            now = sensing.read((i + 1) * s.gains.period, place[i], float(force[i]))
        if not np.isfinite(force).all() or np.abs(place[:, 2]).max() > 0.1:
            raise KinidError(f"force control of {job.name} diverged: lower its bandwidth")
        return Course(job, force, place, model)


def _on_surface(place: Array, setup: Setup) -> tuple[Array, Array]:
    """Poses of the tip on the rig's surface, as `Script.poses`."""
    n = len(place)
    flat = np.column_stack([place, np.zeros(n)])
    script = Script(np.zeros(n), np.full(n, "touch"), flat, np.zeros((n, 2)))
    return script.poses(setup.axes, np.asarray(setup.point))


class _Stepped:
    """The compiled loop, one control period at a time."""

    def __init__(self, loop: ForceLoop, q0: Array) -> None:
        s, n = loop.setup, loop.setup.arm.joints
        torque, drives = np.zeros(n), kernel.Drives(s.joints.packed, not s.joints.rigid, s.joints.presliding)
        values = (s.gains.stiffness, loop.damping(q0), s.gains.null, drives.joints[kernel.LIMIT], torque)
        body, seen = kernel.Body.of(s.arm), kernel.Body.of(s.arm)
        period = (s.gains.period, 4, 0.0)
        self._fixed = (body, seen, drives, kernel.Controller(torque, values), True, loop._surface, *period)
        rows = np.zeros((6, n))
        rows[kernel.Q] = q0
        self._moved = (rows, np.zeros(law.MEMORY + 1), kernel.Steps.empty(n))
        self._count, self._out = 0, np.empty((1, 4 * n + 10))

    def step(self, position: Array, speed: Array, rotation: Array) -> tuple[float, Array]:
        """Normal force [N] and place (3,) [m] as the period begins; moves on to its end."""
        twist = np.zeros((1, 6))
        twist[0, :3] = speed
        target = kernel.SetPoints(position[None], twist, rotation[None])
        kernel.run(*self._fixed, *self._moved, self._count, target, self._out)
        self._count += 1
        rest = self._out[0, -10:]
        return float(rest[2]), rest[3:6]


@dataclass
class _Sensing:
    """Noisy contact quantities behind one filter: a law that is linear in them holds behind it, too."""

    setup: Setup
    seed: int
    _last: Array = field(default_factory=lambda: np.zeros(2))

    def __post_init__(self) -> None:
        self._rng = np.random.default_rng(np.random.SeedSequence([self.seed, 5]))
        self._noise = np.array([DEPTH_NOISE, self.setup.sensor.noise[2]])
        self._share = blend(self.setup.gains.period)

    def read(self, t: float, place: Array, force: float) -> Reading:
        """What the controller gets in the next period."""
        depth, felt = np.array([place[2], force]) + self._noise * self._rng.normal(size=2)
        step, before = self.setup.sensor.step[2], self._last
        felt = step * np.round(felt / step) if step > 0.0 else felt
        self._last = before + self._share * (np.array([depth, felt]) - before)
        rate = (self._last[0] - before[0]) / self.setup.gains.period
        x, y, depth, felt = float(place[0]), float(place[1]), float(self._last[0]), float(self._last[1])
        return Reading(t, x, y, depth, float(rate), felt)


def blend(period: float) -> float:
    """Share of a new sample in the filter's value."""
    return float(1.0 - np.exp(-period / FILTER))
