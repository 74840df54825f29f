"""Motion in the air that tells most about the tool's load or about joint effects: sines in every joint.

Each joint swings about a posture with a few sines (Swevers et al., IEEE Trans. Robotics and Automation 13, 1997,
without the demand that all share one period). Candidates are drawn by a fixed seed, each as large as the joints' limits
and the room allow; the one that tells most is improved by small changes while that helps (a random search with hill
climbing).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

import kinid.urdf
from kinid.data.log import Log, Provenance
from kinid.data.rig import WRENCH, Rig
from kinid.effects import Layout
from kinid.errors import InputError
from kinid.modeling.experiment import Experiment
from kinid.modeling.from_logs import from_joint_torques, from_wrench, joint_layout
from kinid.modeling.model import Model
from kinid.modeling.parameter_names import assumed_values
from kinid.planning.check import Usage, check
from kinid.planning.collision import Scene
from kinid.planning.information import Interval, cost, information, intervals, sensitivities, without
from kinid.planning.limits import Limits
from kinid.planning.poke_design import Bounds
from kinid.planning.reach import Reach
from kinid.planning.signals import fading
from kinid.planning.trajectory import Trajectory
from kinid.robotics.robot import Robot
from kinid.signal.derivative import Differentiator
from kinid.writers import Json

Array = NDArray[np.float64]

#: standard deviations where the rig states none: a Mini40's wrench [N, N·m], and a joint torque sensor's [N·m]
WRENCH_NOISE = np.array([0.015, 0.014, 0.029, 0.0005, 0.0006, 0.0003])
TORQUE_NOISE = 0.05
#: samples a second that the design looks at; motions drawn, and changes tried
DESIGN_RATE = 25.0
DRAWN, CHANGED = 16, 24
#: ten seconds, sines of at most 3 Hz
AIR = Bounds(duration=10.0)
#: share of each joint's limits that a motion uses at most
SHARE = 0.7


@dataclass(frozen=True, eq=False)
class Swing:
    """Joints about a posture: base + w(t) Σ a sin(2π f t + φ), w the fade.

    Attributes:
        base: [rad], (N,). amplitudes [rad], frequencies [Hz], phases [rad]: (N, k). duration, fade: [s].
    """

    base: Array
    amplitudes: Array
    frequencies: Array
    phases: Array
    duration: float
    fade: float

    def __call__(self, t: Array) -> tuple[Array, Array, Array, Array]:
        """Joints and their first three derivatives, each (n, N)."""
        w = 2 * np.pi * self.frequencies
        angle = t[:, None, None] * w + self.phases
        sine, cosine = self.amplitudes * np.sin(angle), self.amplitudes * np.cos(angle)
        u = [sine.sum(axis=2), (w * cosine).sum(axis=2), -(w**2 * sine).sum(axis=2), -(w**3 * cosine).sum(axis=2)]
        f = fading(t, self.duration, self.fade)[:, :, None]
        return (
            self.base + f[0] * u[0],
            f[1] * u[0] + f[0] * u[1],
            f[2] * u[0] + 2 * f[1] * u[1] + f[0] * u[2],
            f[3] * u[0] + 3 * f[2] * u[1] + 3 * f[1] * u[2] + f[0] * u[3],
        )

    def to_dict(self) -> Json:
        """For provenance."""
        return {name: getattr(self, name).tolist() for name in ("base", "amplitudes", "frequencies", "phases")} | {
            "duration": self.duration,
            "fade": self.fade,
        }


@dataclass(frozen=True, eq=False)
class FreeExcitation:
    """An optimised free motion: the robot's trajectory, and what it is expected to tell."""

    trajectory: Trajectory
    swing: Swing
    criterion: str
    cost: float
    intervals: dict[str, Interval]


@dataclass(frozen=True, eq=False)
class Design:
    """What stays the same while motions in the air are compared.

    Attributes:
        rig: without a surface where nothing is touched. robot, limits, reach: of it. model, values: that motions are to
            tell of, by full name. scene: what the arm may run into; None: collisions aren't looked for. criterion: "D"
            or "A".
        rate: of the log [Hz].
    """

    rig: Rig
    robot: Robot
    limits: Limits
    model: Model
    values: dict[str, float]
    reach: Reach
    scene: Scene | None
    criterion: str
    rate: float

    def fitted(self, swing: Swing) -> Swing | None:
        """As large as joint limits and torques allow, smaller where the arm would touch something; None: not at all."""
        t = np.arange(round(swing.duration * 100)) / 100
        q, *derivatives = swing(t)
        limits, share = self.limits, SHARE
        room = np.minimum(limits.upper - swing.base, swing.base - limits.lower)
        used = [np.abs(q - swing.base).max(axis=0) / np.minimum(room, np.pi)]
        used += [
            np.abs(d).max(axis=0) / getattr(limits, name)
            for d, name in zip(derivatives, ("velocity", "acceleration", "jerk"))
        ]
        largest = np.maximum(np.max(used, axis=0), 1e-9)
        swing = _scaled(swing, share / largest)
        for _ in range(8):
            q, dq, ddq, _ = swing(t)
            torque = self.reach.torques(q, dq, ddq, np.zeros((len(q), 3)))
            if (np.abs(torque) <= share * limits.torque).all() and self._apart(q):
                return swing
            swing = _scaled(swing, np.full(len(swing.base), 0.75))
        return None

    def _apart(self, q: Array) -> bool:
        if self.scene is None:
            return True
        try:
            self.scene.check(q)
        except InputError:
            return False
        return True

    def information(self, swing: Swing, rate: float) -> tuple[Array, Experiment]:
        """Information about the model's parameters of a motion logged at the rate of the design."""
        t = np.arange(round(swing.duration * rate)) / rate
        experiment = self.experiment(t, *swing(t)[:3])
        named = self.model.parameters(experiment.layout)
        values = np.array([self.values.get(name, p.nominal) for name, p in named.items()])
        found = sensitivities(lambda v: self.model.predict(experiment.signals, v), values, named)
        noise = TORQUE_NOISE * np.ones(len(found))
        constants = 0
        if experiment.layout.kind == "wrench":
            noise = np.asarray(self.rig.sensor.noise) if self.rig.sensor.noise is not None else WRENCH_NOISE
            noise = np.maximum(noise, 1e-9)
            if not any(
                effect.constant for effect in self.model.effects
            ):  # a fit estimates one constant a channel along
                constants = len(found)
                steady = np.broadcast_to(
                    (noise[:, None] * np.eye(constants))[:, None, :], (constants, len(t), constants)
                )
                found = np.concatenate([found, steady], axis=2)
        return without(information(found, noise, self.rate / rate), constants), experiment

    def experiment(self, t: Array, q: Array, dq: Array, ddq: Array) -> Experiment:
        """The signals that a log of this motion gives."""
        free = np.full(len(t), "free")
        if "joints" in self.model.needs:
            log = Log(t, q, dq, ddq, tau=np.zeros_like(q), phase=free, provenance=Provenance("the plan"))
            return from_joint_torques(log, self.rig, robot=self.robot, differentiator=Differentiator())
        log = Log(t, q, dq, ddq, wrench=np.zeros((len(t), 6)), phase=free, provenance=Provenance("the plan"))
        return from_wrench(
            log, self.rig, bias=(0.0,) * 6, robot=self.robot, trust_wrench=True, differentiator=Differentiator()
        )  # a plan's motion is exact

    def cost(self, swing: Swing) -> float:
        """What the search makes least."""
        return cost(self.information(swing, DESIGN_RATE)[0], self.criterion)


def excite_free(
    rig: Rig,
    model: Model,
    values: dict[str, float] | None = None,
    *,
    bounds: Bounds = AIR,
    start: Array | None = None,
    sines: int = 2,
    criterion: str = "D",
    rate: float = 500.0,
    limits: Limits | None = None,
    collisions: bool = True,
) -> FreeExcitation:
    """The free motion that tells most about effects of tool, sensor or joints.

    Args:
        rig: with a robot. model: without a contact law. values: assumed, others nominal.
        bounds: duration, bandwidth and fade count. start: posture to swing about [rad], (N,); default: found.
        sines: a joint. criterion: "D" or "A". rate: of log and trajectory [Hz]. limits: default: the URDF's.

    Raises:
        InputError: a model with contact, a value of no parameter of it or out of its bounds, no posture free to swing
            about, or parameters that no free motion tells.
    """
    if model.contact_law is not None or not model.effects:
        raise InputError(f"{model} for free motion", "effects of tool, sensor or joints", "plan contact laws by pokes")
    robot = Robot.load(rig)
    limits = limits or Limits.of(robot, kinid.urdf.path(robot.name, rig.folder))
    reach = Reach(robot, limits, rig.tool)
    scene = scene_of(rig, robot) if collisions else None
    bare = rig.model_copy(update={"surface": None})
    layout = joint_layout(rig, robot, robot.joint_count) if "joints" in model.needs else Layout(WRENCH, "wrench")
    assumed = assumed_values(model, values or {}, layout)
    design = Design(bare, robot, limits, model, assumed, reach, scene, criterion, rate)
    rng = np.random.default_rng(3)
    best: tuple[float, Swing] | None = None
    for number in range(DRAWN):
        base = np.asarray(start, dtype=float) if start is not None else posture(limits, rng, number)
        if base.shape != (robot.joint_count,) or not ((base > limits.lower) & (base < limits.upper)).all():
            shown = ", ".join(f"{v:g}" for v in base)
            raise InputError(
                f"a posture ({shown})", f"{robot.joint_count} joints within their limits", "choose another with --start"
            )
        swing = design.fitted(swing_drawn(base, bounds, sines, rng))
        if swing is not None and ((value := design.cost(swing)) < (best[0] if best else np.inf)):
            best = value, swing
    if best is None:
        raise InputError(
            "no posture free to swing about", "room around the arm", "choose another with --start, or a farther surface"
        )
    for number in range(CHANGED):
        changed = design.fitted(_changed(best[1], bounds, rng, 0.5 * 0.93**number))
        if changed is not None and (value := design.cost(changed)) < best[0]:
            best = value, changed
    return _finished(design, best[1], best[0], rate)


def _finished(design: Design, swing: Swing, value: float, rate: float) -> FreeExcitation:
    t = np.arange(int(np.ceil(swing.duration * rate)) + 1) / rate
    q, dq, ddq, _ = swing(np.minimum(t, swing.duration))
    robot = design.robot
    tip = robot.kinematics(robot.tip_frame, q).position if robot.tip_frame else np.full((len(t), 3), np.nan)
    zero = np.zeros((len(t), 3))
    trajectory = Trajectory(t, np.full(len(t), "free"), q, dq, ddq, tip, robot.joint_names, None, zero, zero[:, 0])
    used: tuple[Usage, ...] = check(
        trajectory, design.limits, design.reach.torques(q, dq, ddq, zero), "the free motion"
    )
    if design.scene is not None:
        design.scene.check(q, "the free motion")
    matrix, experiment = design.information(swing, 4 * DESIGN_RATE)
    named = design.model.parameters(experiment.layout)
    assumed = np.array([design.values.get(name, p.nominal) for name, p in named.items()])
    expected = intervals(matrix, assumed, named)
    import dataclasses

    asked = {"kind": "free motion", "model": list(design.model.names), "criterion": design.criterion}
    facts = {
        "robot": robot.name,
        "asked": asked,
        "swing": swing.to_dict(),
        "used": [use.to_dict() for use in used],
        "rate": rate,
        "intervals": {name: each.to_dict() for name, each in expected.items()},
    }
    return FreeExcitation(dataclasses.replace(trajectory, provenance=facts), swing, design.criterion, value, expected)


def scene_of(rig: Rig, robot: Robot) -> Scene:
    """What an arm that touches nothing has to keep clear of."""
    from kinid.robotics.surface import load

    return Scene.of(robot, rig.folder, load(rig))


def posture(limits: Limits, rng: np.random.Generator, number: int) -> Array:
    """The posture of this number to swing about: the middle of the joints' range first, then others near it."""
    lower, upper = (np.where(np.isfinite(v), v, s * np.pi) for v, s in ((limits.lower, -1.0), (limits.upper, 1.0)))
    shift = np.zeros(len(lower)) if number == 0 else rng.uniform(-0.4, 0.4, len(lower))
    return np.asarray(0.5 * (lower + upper) + shift * (upper - lower) / 2)


def swing_drawn(base: Array, bounds: Bounds, sines: int, rng: np.random.Generator) -> Swing:
    """Sines of random amplitude, frequency and phase in every joint about a base; their size is left to
    `Design.fitted`.
    """
    shape = (len(base), sines)
    slow = 1.0 / bounds.duration
    # fast sines reach the acceleration limit with small angles: most of the octaves are slow
    frequencies = np.exp(rng.uniform(np.log(slow), np.log(max(bounds.bandwidth, 1.01 * slow)), shape))
    return Swing(
        base,
        rng.uniform(0.2, 1.0, shape),
        frequencies,
        rng.uniform(0, 2 * np.pi, shape),
        bounds.duration,
        min(1.0, bounds.duration / 4),
    )


def _changed(swing: Swing, bounds: Bounds, rng: np.random.Generator, size: float) -> Swing:
    shape = swing.amplitudes.shape
    slow = 1.0 / bounds.duration
    return Swing(
        swing.base,
        swing.amplitudes * np.exp(size * rng.normal(size=shape)),
        np.clip(swing.frequencies * np.exp(size * rng.normal(size=shape)), slow, bounds.bandwidth),
        swing.phases + size * rng.normal(size=shape),
        swing.duration,
        swing.fade,
    )


def _scaled(swing: Swing, factors: Array) -> Swing:
    return Swing(
        swing.base, swing.amplitudes * factors[:, None], swing.frequencies, swing.phases, swing.duration, swing.fade
    )


__all__ = ["Design", "FreeExcitation", "Swing", "excite_free", "posture", "scene_of", "swing_drawn"]
