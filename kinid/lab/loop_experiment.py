"""An experiment of the closed loop: set-points in, motion out."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from kinid.errors import KinidError
from kinid.lab import _law as law
from kinid.lab import closed_loop as kernel
from kinid.lab.arm import Arm, Gains, Joints, design_damping
from kinid.lab.materials import Material

Array = NDArray[np.float64]

#: periods after which the loop says how far it is
PART = 2000


@dataclass(frozen=True, eq=False)
class Motion:
    """What the loop did, one row a control period; joints in the chain's order.

    Attributes:
        t: [s], (n,). q, dq, ddq, tau: (n, N), tau on the link side of the drive.
        force: of the material on the tool, along tangent1, tangent2, normal [N], (n, 3).
        place: along both tangents, and depth [m], (n, 3). tip: base frame [m], (n, 3).
        work: that the material has done on the tool so far [J], (n,).
    """

    t: Array
    q: Array
    dq: Array
    ddq: Array
    tau: Array
    force: Array
    place: Array
    tip: Array
    work: Array


@dataclass(frozen=True, eq=False)
class Loop:
    """Arm, drives, controller and surface; `run` makes the experiment.

    Attributes:
        arm, joints, gains: see their classes. damping: (6, 6) of the impedance; default: designed where the motion
        begins.
        axes: rows tangent1, tangent2, normal of the surface. point: of it [m].
        substeps: integration steps a control period; 4 are stable for the elastic joints of the LWR4+.
    """

    arm: Arm
    joints: Joints
    gains: Gains = Gains()
    axes: Array = field(default_factory=lambda: np.eye(3))
    point: Array = field(default_factory=lambda: np.array([0.0, 0.0, -1e3]))
    damping: Array | None = None
    substeps: int = 4

    def run(
        self,
        q0: Array,
        positions: Array,
        rotations: Array,
        material: Material,
        *,
        dq0: Array | None = None,
        controlled: bool = True,
        t0: float = 0.0,
        progress: Callable[[float], None] | None = None,
    ) -> Motion:
        """Follow set-points, one a control period.

        Args:
            q0: joints to begin with, (N,). positions: (n, 3) [m]. rotations: (n, 3, 3). material: touched.
            dq0: speeds to begin with; default: rest. controlled: False lets the arm go.
            t0: the material's time at the beginning [s]. progress: told the share that is done, 0…1, now and then.

        Raises:
            KinidError: the loop diverged.
        """
        n, dt, gains = self.arm.joints, self.gains.period, self.gains
        damping = self.damping if self.damping is not None else design_damping(gains, self.arm, self.joints, q0)
        targets = kernel.SetPoints(
            *(np.ascontiguousarray(each) for each in (positions, twists(positions, rotations, dt), rotations))
        )
        drives = kernel.Drives(self.joints.packed, not self.joints.rigid, self.joints.presliding)
        torque, limit = np.zeros(n), drives.joints[kernel.LIMIT]
        values = (gains.stiffness, np.ascontiguousarray(damping), gains.null, limit, torque)
        axes, point = np.ascontiguousarray(self.axes), np.asarray(self.point, dtype=float)
        fields, patches, grid = material.raster()
        surface = kernel.Surface(axes, point, (material.packed(), patches, fields, grid, np.empty(law.FIELDS)))
        out, rows, memory = np.empty((len(positions), 4 * n + 10)), np.zeros((6, n)), np.zeros(law.MEMORY + 1)
        rows[kernel.Q], rows[kernel.DQ] = q0, 0.0 if dq0 is None else dq0
        body, seen, controller = kernel.Body.of(self.arm), kernel.Body.of(self.arm), kernel.Controller(torque, values)
        fixed = (body, seen, drives, controller, controlled, surface, dt, self.substeps, t0)
        moved = (rows, memory, kernel.Steps.empty(n))
        for first in range(0, len(out), PART):
            part = slice(first, first + PART)
            kernel.run(*fixed, *moved, first, kernel.SetPoints(*(each[part] for each in targets)), out[part])
            if progress is not None:
                progress(min(1.0, (first + PART) / len(out)))
        if not np.isfinite(out).all() or np.abs(out[:, n : 2 * n]).max() > 1e3:
            raise KinidError("the virtual experiment diverged: the gains don't suit arm and material")
        q, dq, ddq, tau, rest = np.split(out, [n, 2 * n, 3 * n, 4 * n], axis=1)
        t = np.asarray(np.arange(len(out)) * dt, dtype=np.float64)
        return Motion(t, q, dq, ddq, tau, rest[:, :3], rest[:, 3:6], rest[:, 6:9], rest[:, 9])


def twists(positions: Array, rotations: Array, dt: float) -> Array:
    """Linear and angular velocity of set-points, base axes, (n, 6); central differences."""
    out = np.zeros((len(positions), 6))
    if len(positions) < 3:
        return out
    out[:, :3] = np.gradient(positions, dt, axis=0)
    spin = np.einsum("nij,nkj->nik", np.gradient(rotations, dt, axis=0), rotations)
    for k, (i, j) in enumerate(((2, 1), (0, 2), (1, 0))):
        out[:, 3 + k] = 0.5 * (spin[:, i, j] - spin[:, j, i])
    return out
