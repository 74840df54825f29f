"""Per sample: motion, contact frame, both estimators and the watch over them, in compiled code.

Quantities, touches, what is expected of a sample and alarms are of the present; estimates, and the changes of material
that they show, rest on all samples that are older than `OnlineContact.DELAY`, whose motion is known without a lag.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from kinid import effects
from kinid.contact.online import OnlineContact
from kinid.data.rig import CONTACT, Rig
from kinid.errors import InputError
from kinid.estimators import Friction, KelvinVoigt, SingleStage
from kinid.estimators._friction_kernels import reopen as reopen_friction
from kinid.estimators._machine import Machine, Online
from kinid.estimators.estimate import Estimate, Prior, Status
from kinid.estimators.hunt_crossley import logarithmic
from kinid.kernels.causal import FLAG
from kinid.live import _watch_kernels as kernels
from kinid.live import events
from kinid.live._learn_kernels import compile_learn
from kinid.live.events import Event

if TYPE_CHECKING:
    from kinid.robotics.robot import Robot

Array = NDArray[np.float64]

#: recursive estimators of normal laws that run live, by their names (`Effect.recursive`)
LAWS = {"KelvinVoigt": KelvinVoigt, "SingleStage": SingleStage}
#: normal force from which the tool touches, in standard deviations of the sensor's noise, and at least [N]
TOUCHES, LEAST_FORCE = 6.0, 0.1
#: noise of a force where the rig states none [N]
UNSTATED_NOISE = 0.02
#: a border is sought while the tip slides at least so fast [m/s]
SLIDING = 5e-4
#: what an opened estimator may be wrong by, in parts of its values
SPREAD = 1.0

_DEPTH, _RATE, _SLIP1, _SLIP2, _SLIP_RATE1, _SLIP_RATE2, _NORMAL, _TANGENT1, _TANGENT2 = range(9)


@dataclass(frozen=True)
class Watch:
    """When something is told.

    Attributes:
        drift, threshold: of the cumulated sums that tell a change, in standard deviations of the innovations.
        settled: time that an estimate has to stand before changes are looked for [s].
        unexplained: rms of the innovations over that of the force from which the model has lost it.
        above: share by which a force may be above its prediction.
        secant: share by which force over depth may change on the way before it is called a border.
        reopen: whether a change opens the estimators' covariance.
    """

    drift: float = 1.5
    threshold: float = 15.0
    settled: float = 0.1
    unexplained: float = 0.25
    above: float = 0.3
    secant: float = 0.15
    reopen: bool = True


class Pipeline:
    """From aligned samples to quantities, estimates and events.

    Args:
        rig: with a robot, a surface, and what is known of tool and sensor.
        model: names of effects that a recursive estimator follows: a contact law, friction.
        bandwidth: of the velocities that the stream lacks [Hz], as in `OnlineContact`.
        watch: when something is told.
        contact_force: normal force from which the tool touches [N]; None: six standard deviations of the rig's noise.

    Attributes:
        rig, model, watch: as given.
        quantities: contact quantities of the last sample, in the order of `CONTACT`; overwritten by the next.

    Raises:
        InputError: a rig without robot or surface, or a model that isn't estimated live.
    """

    def __init__(
        self,
        rig: Rig,
        model: Sequence[str],
        *,
        robot: Robot | None = None,
        bandwidth: float = 40.0,
        watch: Watch | None = None,
        contact_force: float | None = None,
    ) -> None:
        law = _law(model)
        noise = UNSTATED_NOISE if rig.sensor.noise is None else max(1e-4, *rig.sensor.noise[:3])
        on = max(LEAST_FORCE, TOUCHES * noise) if contact_force is None else contact_force
        self._noise = noise
        self.rig, self.model, self.watch = rig, tuple(model), watch or Watch()
        self.contact = OnlineContact(rig, robot=robot, bandwidth=bandwidth, contact_force=on)
        self.normal: Machine = (
            (SingleStage(noise=noise) if law == SingleStage.__name__ else KelvinVoigt()).online().machine
        )
        self.friction: Machine = Friction().online().machine
        self._watch_state = np.full(kernels.PLACES, 0.0)
        self._set_up(rig, on, noise)
        self._learn = compile_learn(self.normal.once, len(self.normal.shape), self.friction.once)
        self._normal = _inputs(self.normal, ("depth", "depth_rate", "normal_force", "in_contact"))
        rubbing = ("normal_force", "slip_rate1", "slip_rate2", "tangential_force1", "tangential_force2", "in_contact")
        self._friction = _inputs(self.friction, rubbing)
        self._rest = (self.contact.store, *self._normal, *self._friction, self._watch_state)
        self.quantities = self.contact.quantities

    @property
    def touching(self) -> bool:
        """Whether the tool touches, with hysteresis."""
        return bool(self._watch_state[kernels.TOUCHING] > 0.0)

    @property
    def place(self) -> Array:
        """The surface's point nearest to the tip at the last sample, base frame, (3,) [m]."""
        return self.contact.place

    @property
    def free(self) -> bool:
        """Whether the last sample was clear of the surface, by force and by place."""
        return not self.touching and bool(self.quantities[_DEPTH] < 0.0)

    @property
    def estimates(self) -> dict[str, Estimate]:
        """What is known now of the model's parts: "normal" and "friction"."""
        followed = {effects.get(name).recursive for name in self.model}
        parts = {"normal": self.normal} if followed & set(LAWS) else {}
        if Friction.__name__ in followed:
            parts["friction"] = self.friction
        return {name: machine.estimate() for name, machine in parts.items()}

    @property
    def predicted(self) -> float:
        """Normal force that the law expects of the last sample [N]; NaN where nothing touches."""
        return float(self._watch_state[kernels.EXPECTED])

    @property
    def predicted_friction(self) -> Array:
        """Tangential forces that friction's estimate expects of the last sample [N], (2,); 0 where nothing slides."""
        rates = self.quantities[[_SLIP_RATE1, _SLIP_RATE2]]
        speed = math.hypot(*rates)
        if "friction" not in self.estimates or not self.touching or not speed > SLIDING:
            return np.zeros(2)
        return np.asarray(-_rubbed(self, speed) * rates / speed)

    def step(self, t: float, q: Array, wrench: Array, dq: Array) -> int:
        """Work out one sample; bits of its events (`kinid.live.events`), for `explain`.

        It allocates nothing but what Python's call does.

        Args:
            t: time [s], which has to grow. q: positions (N,). wrench: fx fy fz tx ty tz in sensor axes, (6,).
            dq: velocities (N,), the first of which is NaN where there are none.

        Returns:
            The bits; a negative number for a sample that was left out.
        """
        return self._learn(t, q, wrench, dq, *self._rest)

    def explain(self, event_bits: int, t: float) -> list[Event]:
        """The events that the bits of the last sample stand for; a change opens the estimators' covariance.

        Args:
            event_bits: > 0. t: time of that sample [s].
        """
        out = []
        x = self.quantities
        place, force = (float(x[_SLIP1]), float(x[_SLIP2]), float(x[_DEPTH])), float(x[_NORMAL])
        for bit, kind, says in _BITS:
            if event_bits & bit:
                slides = bit == events.CHANGE and math.hypot(x[_SLIP_RATE1], x[_SLIP_RATE2]) > SLIDING
                shown = _friction if bit == events.CHANGE and event_bits & events.RUBS else says
                out.append(Event("border" if slides else kind, t, shown(self), place, force))
        if event_bits & events.CHANGE and self.watch.reopen:
            self.reopen()
            out.append(Event("reopened", t, f"each parameter may be off by {100 * SPREAD:.0f} %", place, force))
        return out

    def reopen(self) -> None:
        """Open both estimators' covariance: what was learnt stays as a start, which the next samples may overrule.

        Those that still wait are all newer than what has shown the change.
        """
        reopen(self.normal, self._noise)
        reopen_friction(self.friction.room.state, SPREAD)

    def start(self, values: Mapping[str, float]) -> None:
        """Start from what is known of another place, each value with the standard deviation `SPREAD`.

        Args:
            values: by the names of the parameters. Of a law that isn't linear all are needed, else the stiffness at
                least, and no exponent; without them an estimator goes on as it is.
        """
        names, state = self.normal.names, self.normal.room.state
        known = np.array([name in values for name in names])
        same_law = known.all() if "exponent" in names else known[0] and "exponent" not in values
        if same_law and values[names[0]] > 0.0:
            given = np.array([values.get(name, 0.0) for name in names])
            if "exponent" in names:  # that machine keeps the logarithm of its law
                given = logarithmic(Prior(given, np.eye(3)), math.log(SingleStage().reference_depth), 1.0).values
            state[: len(names)] = given
            reopen(self.normal, self._noise, known)
        if "friction" in values:
            self.friction.room.state[0] = values["friction"]
            reopen_friction(self.friction.room.state, SPREAD)

    def restart(self) -> None:
        """A new log begins, whose time may start anew; what was learnt stays."""
        self.contact.reset()
        self.normal.restart()
        self.friction.restart()

    def _set_up(self, rig: Rig, on: float, noise: float) -> None:
        w, state = self.watch, self._watch_state
        state[kernels.ON], state[kernels.OFF], state[kernels.NOISE] = on, 0.5 * on, noise
        state[kernels.DRIFT], state[kernels.THRESHOLD], state[kernels.SETTLED] = w.drift, w.threshold, w.settled
        state[kernels.SECANT_SHARE] = w.secant
        state[kernels.UNEXPLAINED], state[kernels.ABOVE_SHARE] = w.unexplained, w.above
        state[kernels.RANGE : kernels.RANGE + 6] = np.inf if rig.sensor.range is None else rig.sensor.range
        state[kernels.NORMAL_SINCE] = state[kernels.FRICTION_SINCE] = np.inf
        state[kernels.SINCE : kernels.SINCE + 4] = np.inf
        state[kernels.LAST_TIME] = state[kernels.LATE_TIME] = 0.0
        state[kernels.EXPECTED] = state[kernels.CUT_FROM] = math.nan
        state[kernels.CUT_TO] = -math.inf


def reopen(machine: Machine, force_noise: float, known: NDArray[np.bool_] | None = None) -> None:
    """Give an estimator its values with the standard deviation `SPREAD` of each, as if nothing else were known.

    Args:
        force_noise: of a reading [N]: the first residuals of a touch show less by chance, or none.
        known: which values are, (p,); the others are as open as at the beginning. None: all.
    """
    state, p = machine.room.state, len(machine.names)
    shown = float(machine.room.record[2 * p + 1])
    noise = max(shown if math.isfinite(shown) else 0.0, force_noise**2)
    unit = np.minimum(np.maximum((SPREAD * state[:p]) ** 2, 1e-12) / noise, machine.room.limit)
    if known is not None:
        unit = np.where(known, unit, machine.room.limit)
    state[p : 2 * p] = unit
    state[2 * p : 2 * p + p * p] = np.eye(p).ravel()
    state[2 * p + p * p : 3 * p + p * p] = unit
    updates = state[-1]
    state[-4:] = 0.0
    machine.watch[:-1] = 0.0  # but for its clock
    # at least one residual of the size that was usual, so that the first intervals aren't of zero width
    state[-4], state[-3], state[-2], state[-1] = noise, 1.0, 1.0, min(updates, 1.0)


def _law(model: Sequence[str]) -> str | None:
    """Name of the recursive estimator of a model's contact law, None without one."""
    followed = {name: effects.get(name).recursive for name in model}
    unknown = [name for name, estimator in followed.items() if estimator not in (*LAWS, Friction.__name__)]
    if unknown:
        known = [name for name, kind in effects.catalogue().items() if kind.recursive in (*LAWS, Friction.__name__)]
        raise InputError(
            f"effect '{unknown[0]}' in a live model",
            f"one of {', '.join(known)}",
            "leave it out, and ask of the recording: kinid diagnose LOG --model MODEL",
        )
    laws = [name for name in model if followed[name] in LAWS]
    if len(laws) > 1:
        raise InputError(f"{len(laws)} contact laws, {' and '.join(laws)}", "one at most", "choose one")
    if not model:
        raise InputError("a live model without effects", "a contact law, friction, or both", "name one with --model")
    return followed[laws[0]] if laws else None


def _inputs(machine: Machine, takes: Sequence[str]) -> tuple[NDArray[np.int64], int, tuple[float, ...], Array]:
    """What the compiled step needs of an estimator: rows of quantities, place of the inputs, shape and store."""
    Online(machine)  # compiles its kernel
    rows = np.array([FLAG if name == "in_contact" else CONTACT.index(name) for name in takes], dtype=np.int64)
    start = (machine.room.inputs.ctypes.data - machine.store.ctypes.data) // machine.store.itemsize
    return rows, start, machine.shape, machine.store


def _residual(pipeline: Pipeline) -> str:
    return f"{float(pipeline.quantities[_NORMAL]):.2f} N, {pipeline.predicted:.2f} N expected"


def _rubbed(pipeline: Pipeline, speed: float) -> float:
    """Force along the surface that friction's estimate expects while the tip slides at a speed [m/s], in N."""
    friction, viscous = pipeline.friction.estimate().values[:2]
    return float(friction * pipeline.quantities[_NORMAL] + viscous * speed)


def _friction(pipeline: Pipeline) -> str:
    x = pipeline.quantities
    expected = _rubbed(pipeline, math.hypot(x[_SLIP_RATE1], x[_SLIP_RATE2]))
    return f"{math.hypot(x[_TANGENT1], x[_TANGENT2]):.2f} N along the surface, {expected:.2f} N expected"


def _force(pipeline: Pipeline) -> str:
    return f"{float(pipeline.quantities[_NORMAL]):.2f} N"


def _status(pipeline: Pipeline) -> str:
    return Status(pipeline.normal.estimate().status).remedy


_BITS: tuple[tuple[int, str, Callable[[Pipeline], str]], ...] = (
    (events.SATURATED, "saturated", lambda _: "a channel at the end of the rig's range"),
    (events.TOUCH, "touch", _force),
    (events.LEAVE, "leave", _force),
    (events.CHANGE, "force-jump", _residual),
    (events.DIVERGENCE, "divergence", _residual),
    (events.EXCITATION, "excitation-lost", _status),
    (events.ABOVE, "force-above", _residual),
)
