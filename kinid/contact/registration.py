"""A surface that nobody measured, found by touching it: contact onsets in the logs, and the plane through them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import maximum_filter1d

from kinid.contact.series import tip_motions
from kinid.contact.touching import OFF, ON, force_noise
from kinid.data.log import Log
from kinid.data.rig import Rig, SurfaceSpec
from kinid.errors import InputError, expect
from kinid.estimators.estimate import NORMAL_95
from kinid.estimators.plane import PlaneEstimate, fit_plane
from kinid.kernels.hysteresis import contact_flag
from kinid.robotics.motion import TipMotion
from kinid.robotics.robot import Robot
from kinid.signal.derivative import Differentiator

Array = NDArray[np.float64]

#: a log without labels is taken to begin in the air for so long [s]
STARTS_FREE = 0.25
#: free motion ends and begins so long before and after a touch [s]
MARGIN = 0.1
#: a touch reaches this multiple of the force it is noticed at; less is a knock or a vibration
FIRM = 2.0
#: shapes of force over depth that an onset is extrapolated with, from linear to a cone's
EXPONENTS = (1.0, 1.1, 1.2, 1.3, 1.4, 1.5, 1.75, 2.0)


@dataclass(frozen=True, eq=False)
class Onset:
    """Where a touch began: time [s], tip position in base axes [m] (3,), force's direction (3,), uncertainty [m]."""

    t: float
    position: Array
    direction: Array
    sigma: float


@dataclass(frozen=True, eq=False)
class FoundSurface:
    """The plane through the onsets of touches, with its uncertainty, and the rig with this surface in it."""

    plane: PlaneEstimate
    onsets: tuple[Onset, ...]
    rig: Rig

    def lines(self) -> list[str]:
        """What a reader wants to know of it."""
        point, normal = self.plane.point, self.plane.normal
        low, high = self.offset_interval
        stray = len(self.onsets) - int(np.sum(self.plane.inliers))
        tilt = np.rad2deg(np.max(np.abs(self.plane.tilt_interval)))
        return [
            f"surface from {len(self.onsets)} touches: point [{point[0]:.5f}, {point[1]:.5f}, {point[2]:.5f}] m, "
            f"normal [{normal[0]:.5f}, {normal[1]:.5f}, {normal[2]:.5f}]",
            f"its height along the normal is known to ± {500 * (high - low):.3g} mm and its tilt to ± {tilt:.2g}° (95 "
            f"%), "
            f"onsets scatter {1e3 * self.plane.rms:.3g} mm rms about it"
            + (f"; {stray} touch{'es' if stray > 1 else ''} off the plane left out" if stray else ""),
        ]

    def toml(self) -> list[str]:
        """The lines of the rig that state it."""
        surface = self.rig.surface
        assert surface is not None  # it was found
        rows = {name: getattr(surface, name) for name in ("point", "normal", "tangent")}
        shown = {name: ", ".join(f"{x:.6g}" for x in row) for name, row in rows.items() if row is not None}
        known = [f"{name} = {getattr(surface, name):.2g}" for name in ("offset_sd", "tilt_sd")]
        return ["[surface]", *(f"{name} = [{numbers}]" for name, numbers in shown.items()), *known]

    @property
    def offset_interval(self) -> tuple[float, float]:
        """95 % interval of the plane's height along its normal, about the point [m].

        Onsets are found early or late together, because one law of the material shifts them all: what an onset may be
        off adds to what their scatter tells.
        """
        low, high = self.plane.offset_interval
        common = NORMAL_95 * float(np.mean([onset.sigma for onset in self.onsets]))
        return float(low) - common, float(high) + common

    @property
    def sd(self) -> tuple[float, float]:
        """Standard deviations for the rig: along the normal [m], of the tilt [rad].

        Three touches have no scatter; then what each onset may be off by counts, at the places touched.
        """
        onset = float(np.mean([onset.sigma for onset in self.onsets]))
        low, high = self.offset_interval
        tilt = float(np.max(np.abs(self.plane.tilt_interval)))
        if np.isfinite(high - low) and np.isfinite(tilt):
            return (high - low) / 2 / NORMAL_95, tilt / NORMAL_95
        places = np.array([onset.position for onset in self.onsets])
        lever = float(np.linalg.svd(places - places.mean(axis=0), compute_uv=False)[1])
        return onset, onset / lever

    def to_dict(self) -> dict[str, object]:
        """Plain types, for JSON: paste point and normal into [surface]."""
        return {
            "point": self.plane.point.tolist(),
            "normal": self.plane.normal.tolist(),
            "rms": float(self.plane.rms),
            "offset_interval": list(self.offset_interval),
            "tilt_interval": np.asarray(self.plane.tilt_interval).tolist(),
            "touches": len(self.onsets),
            "onsets": [onset.position.tolist() for onset in self.onsets],
        }


def find_surface(
    logs: Log | Sequence[Log], rig: Rig, *, robot: Robot | None = None, differentiator: Differentiator | None = None
) -> FoundSurface:
    """The plane that touches in the logs began at; three touches at least, not in one line.

    Each log begins in the air, or labels its free motion "free".

    Raises:
        InputError: no wrench, too few touches, or touches that leave the plane open.
    """
    if isinstance(logs, Log):
        logs = [logs]
    expect(rig, Rig, "a rig", "what was measured with what", "load it with kinid.Rig.load(path)")
    for log in logs:
        expect(log, Log, "a log", "logs that were read", "read each with kinid.read(path, rig)")
    robot = robot or Robot.load(rig)
    found: list[Onset] = []
    for log in logs:
        found += onsets(log, rig, robot, differentiator)
    if found:
        # a plane pushes one way: what pushes elsewhere was a knock, or the inertia of an abrupt motion
        common = np.median([onset.direction for onset in found], axis=0)
        found = [onset for onset in found if onset.direction @ common > 0.7 * np.linalg.norm(common)]
    where = ", ".join(log.provenance.source for log in logs)
    if len(found) < 3:
        raise InputError(
            f"{len(found)} touch{'es' if len(found) != 1 else ''} in {where}",
            "three firm touches at least, at places that are not in one line",
            "touch the surface in three corners and record again",
        )
    outward = np.mean([onset.direction for onset in found], axis=0)
    plane = fit_plane(
        np.array([onset.position for onset in found]), np.array([onset.sigma for onset in found]), outward=outward
    )
    tangent = None if rig.surface is None else rig.surface.tangent
    surface = SurfaceSpec(point=_triple(plane.point), normal=_triple(plane.normal), tangent=tangent)
    out = FoundSurface(plane, tuple(found), rig)
    offset_sd, tilt_sd = out.sd
    known = surface.model_copy(update={"offset_sd": offset_sd, "tilt_sd": tilt_sd})
    return replace(out, rig=rig.model_copy(update={"surface": known}))


@dataclass(frozen=True, eq=False)
class Felt:
    """One touch in a motion: where it began, and its rows."""

    onset: Onset
    rows: slice


def onsets(log: Log, rig: Rig, robot: Robot, differentiator: Differentiator | None = None) -> list[Onset]:
    """Where the touches of one log began, in order of time."""
    return [each.onset for each in felt_in_log(log, rig, robot, differentiator)[1]]


def felt_in_log(
    log: Log, rig: Rig, robot: Robot, differentiator: Differentiator | None = None
) -> tuple[TipMotion, list[Felt]]:
    """The tip's motion in a log, and its touches in order of time."""
    if log.wrench is None:
        raise InputError(
            f"no wrench in {log.provenance.source}",
            "fx fy fz tx ty tz, to feel the touches with",
            "record the force/torque sensor too",
        )
    free = log.labelled_free
    labelled = len(free) > 0
    if not labelled:
        free = np.flatnonzero(log.t < log.t[0] + STARTS_FREE)
    motion_beside = tip_motions(log, rig, robot=robot, differentiator=differentiator)
    for _ in range(1 if labelled else 3):  # what is free follows from what touches, and the bias from what is free
        motion = motion_beside(free)
        flag, on, noise = _flagged(motion, free)
        if not labelled:
            free = np.flatnonzero(~_widened(flag, max(1, round(MARGIN / log.period))))
    return motion, _felt(motion, flag, on, noise)


def felt_in_motion(motion: TipMotion) -> list[Felt]:
    """The touches of a motion that begins in the air, in order of time."""
    return _felt(motion, *_flagged(motion, np.flatnonzero(motion.t < motion.t[0] + STARTS_FREE)))


def _flagged(motion: TipMotion, free: NDArray[np.int64]) -> tuple[NDArray[np.bool_], float, float]:
    """Where a force is felt, (n,), the force that it is noticed at, and the noise [N]."""
    force, size = _force(motion)
    noise = max(float(force_noise(axis[np.isfinite(size)])) for axis in force.T)
    # the length of a noisy vector is never zero: its mean is 1.6 and it rarely exceeds 4 noises
    quiet = size[free][np.isfinite(size[free])]
    on = max(2 * ON * noise, 1.5 * float(np.quantile(quiet, 0.999)) if len(quiet) else 0.0)
    flag = np.zeros(len(size), dtype=np.bool_)
    contact_flag(size, np.zeros(len(size)), on, on * OFF / ON, 1.0, flag)
    return flag, on, noise


def _felt(motion: TipMotion, flag: NDArray[np.bool_], on: float, noise: float) -> list[Felt]:
    """The touches that are firm enough to have an onset."""
    # a flag that flickers at a light touch is one touch
    bridged = round(MARGIN / 2 / float(np.median(np.diff(motion.t)))) if len(motion.t) > 1 else 0
    joined = ~_widened(~_widened(flag, bridged), bridged)
    edges = np.diff((joined | flag).astype(np.int8), prepend=0, append=0)
    spans = zip(np.flatnonzero(edges == 1).tolist(), np.flatnonzero(edges == -1).tolist())
    force, size = _force(motion)
    made = ((slice(a, b), _onset(motion, force, size, a, b, on, noise)) for a, b in spans)
    return [Felt(onset, rows) for rows, onset in made if onset is not None]


def _force(motion: TipMotion) -> tuple[Array, Array]:
    """The force (n, 3) and its size (n,) [N]."""
    force = np.zeros_like(motion.position) if motion.force is None else motion.force
    return force, np.asarray(np.linalg.norm(force, axis=1))


def _onset(motion: TipMotion, force: Array, size: Array, start: int, end: int, on: float, noise: float) -> Onset | None:
    """Extrapolate force over depth back to zero force, within the samples between air and touch."""
    peak = start + int(np.argmax(size[start:end]))
    stop = start + 1 + int(np.argmax(size[start : peak + 1] >= min(size[peak], 12 * on)))
    if start == 0 or stop - start < 3 or size[peak] < FIRM * on:
        return None
    direction = force[start:stop].mean(axis=0)
    direction /= np.linalg.norm(direction)
    depth = -(motion.position[start:stop] - motion.position[start]) @ direction
    load = size[start:stop]
    best: tuple[float, float, float] | None = None
    for exponent in EXPONENTS:
        # F^(1/n) is a line over depth; its zero is the onset
        y = load ** (1 / exponent)
        spread = depth - depth.mean()
        if spread @ spread < 1e-14:
            return None
        slope = float(spread @ (y - y.mean())) / float(spread @ spread)
        if slope <= 0:
            continue
        residual = y - y.mean() - slope * spread
        zero = depth.mean() - y.mean() / slope
        scale = float(residual @ residual) / float((y - y.mean()) @ (y - y.mean()) + 1e-30)
        sigma = float(np.sqrt(residual @ residual / max(1, len(y) - 2) / len(y))) / slope
        if best is None or scale < best[0]:
            best = (scale, float(zero), sigma)
    if best is None:
        return None
    # the touch began after the last sample in which nothing was felt, and before the first in which it was
    quiet = start - 1
    while quiet > 0 and size[quiet] > 3 * noise and start - quiet < 50:
        quiet -= 1
    earliest = float(-(motion.position[quiet] - motion.position[start]) @ direction)
    zero = float(np.clip(best[1], min(earliest, 0.0), 0.0))
    # where between these two the law of the material puts it is a guess; no better than a quarter of the way
    blur = max(abs(earliest) / 4, abs(depth[1] - depth[0]) / np.sqrt(12))
    return Onset(
        float(motion.t[start]), motion.position[start] - zero * direction, direction, float(np.hypot(best[2], blur))
    )


def _widened(flag: NDArray[np.bool_], margin: int) -> NDArray[np.bool_]:
    """A flag that is up `margin` samples earlier and later."""
    return np.asarray(maximum_filter1d(flag.astype(np.uint8), 2 * margin + 1, mode="constant") > 0)


def _triple(values: Array) -> tuple[float, float, float]:
    return float(values[0]), float(values[1]), float(values[2])
