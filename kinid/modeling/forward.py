"""A model's way along the measurement chain, step by step; another one that is the same at first begins where they
differ.

joints → geometry → elastic → normal → friction → frame → tool → sensor → acquisition → reading
joints → rigid body + joint effects → sensor → acquisition → joint torques
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import NDArray

from kinid.effects import Effect, Signals, Stage
from kinid.effects._deflection import solve_series_compliance
from kinid.effects._derived import derived, sample_period
from kinid.errors import InputError
from kinid.kernels.acquisition import lag
from kinid.kernels.frames import contact_wrench
from kinid.kernels.memory import bristles
from kinid.kernels.zero_phase import symmetric

Array = NDArray[np.float64]

#: standard deviations of a Gaussian beyond which a filter's tail counts for nothing
SMOOTHING_REACH = 3.0
#: in place of an effect's number, where the chain itself acts; its parameters are none
CHAIN = -1
NONE = np.zeros(0)
#: arrays that effects replace
REPLACED = ("depth", "depth_rate", "slip", "slip_rate", "elastic", "normal", "pull", "mu", "tangential", "reading")


@dataclass(frozen=True, eq=False)
class Step:
    """One step along the chain.

    Attributes:
        what: whose it is and at which stage; steps of which this is equal do the same.
        effect: number of the effect whose parameters it takes, or `CHAIN`. act: changes signals.
    """

    what: tuple[object, ...]
    effect: int
    act: Callable[[Signals, Array], None]


@dataclass(frozen=True, eq=False)
class Route:
    """All steps of a model, in order; `law` are those of the contact law, which an arm that gives way stands before."""

    steps: tuple[Step, ...]
    law: range

    @classmethod
    def of(cls, effects: Sequence[Effect], kind: str) -> Route:
        """That of these effects for logs of a kind."""

        def acting(stage: Stage) -> list[Step]:
            return [
                Step((effect, stage), i, _act_of(effect, stage))
                for i, effect in sorted(enumerate(effects), key=lambda numbered: numbered[1].order)
                if stage in effect.stages()
            ]

        def chain(act: Callable[[Signals, Array], None]) -> Step:
            return Step((act,), CHAIN, act)

        reaching = any(effect.acts_outside for effect in effects)  # a force may act outside the material, too
        law = [chain(_unloaded), *acting(Stage.ELASTIC), chain(_loaded), *acting(Stage.NORMAL)]
        law += [] if reaching else [chain(_let_go)]
        friction, converter = acting(Stage.FRICTION), acting(Stage.ACQUISITION)
        before, after = acting(Stage.GEOMETRY), []
        if kind == "joints":
            before, law = acting(Stage.JOINT), []
        else:
            after = [*friction, *([chain(_rub)] if friction else []), *acting(Stage.FRAME), chain(_read)]
            after += acting(Stage.TOOL) if kind == "wrench" else []
        after += acting(Stage.SENSOR)
        after += [chain(_filter)] if kind == "joints" else []
        after += [chain(_as_read), *converter, chain(_as_true)] if converter else []
        return cls((*before, *law, *after), range(len(before), len(before) + len(law)))

    def run(
        self, signals: Signals, parts: Sequence[Array], near: Course | None = None, found: list[Signals] | None = None
    ) -> Signals:
        """Quantities at the end of the chain.

        Args:
            signals: the measured motion. parts: parameters of each effect. near: a way that may be the same at first.
            found: gets the quantities as each step found them, and as the last one left them.
        """
        at, s = (0, signals.fresh()) if near is None else near.shared(self, signals, parts)
        s.beside = found is None  # what others begin beside is agreed on in full
        if found is not None and near is not None:
            found += near.until(at)
        parts = (*parts, NONE)
        while at < len(self.steps):
            step, many = self.steps[at], 1
            before = s.copy() if found is not None else s
            if at == self.law.start and s.compliance > 0.0:
                many = len(self.law)
                solve_series_compliance(s, s.compliance, lambda bent: self._press(bent, parts))
            else:
                step.act(s, parts[step.effect])
            if found is not None:
                found += [before] * many
            at += many
        if found is not None:
            found.append(s)
        return s

    def _press(self, s: Signals, parts: Sequence[Array]) -> None:
        """The contact law: elastic and normal force from depth and rate."""
        for step in self.steps[self.law.start : self.law.stop]:
            step.act(s, parts[step.effect])


def _act_of(effect: Effect, stage: Stage) -> Callable[[Signals, Array], None]:
    """What an effect does at a stage; of one from outside this package, with its arrays' shapes asked."""
    own = type(effect).__module__.startswith("kinid.")
    return getattr(effect, stage.value) if own else partial(_checked, effect, stage)


def _checked(effect: Effect, stage: Stage, s: Signals, p: Array) -> None:
    """An effect's step, after which all arrays have the shapes that they had before.

    Raises:
        InputError: one has another.
    """
    before = {name: getattr(s, name).shape for name in REPLACED}
    act = getattr(effect, stage.value)
    act(s, p)
    for name, expected in before.items():
        found = np.asarray(getattr(s, name))
        if found.shape != expected or found.dtype.kind not in "fiub":
            of = f"shape {found.shape}" if found.dtype.kind in "fiub" else f"type {type(getattr(s, name)).__name__}"
            code = act.__code__
            raise InputError(
                f"s.{name} of {of} after the effect '{effect.id}' ({code.co_filename}, line {code.co_firstlineno}, "
                f"{stage.value})",
                f"shape {expected}, {len(s)} samples being the last number",
                f"correct it there, then run kinid effect check {code.co_filename}",
            )


class Course:
    """A way along the chain that was gone, with all that was found on it.

    Args:
        route, signals, parts, near: as `Route.run` takes them.

    Attributes:
        reading: what the sensor delivers, (channels, n).
    """

    def __init__(self, route: Route, signals: Signals, parts: Sequence[Array], near: Course | None = None) -> None:
        self._route, self._signals = route, signals
        self._values = [part.tobytes() for part in (*parts, NONE)]
        self._found: list[Signals] = []
        self.reading = route.run(signals, parts, near, self._found).reading

    @property
    def bent(self) -> bool:
        """Whether law and arm had to agree on the force."""
        return self._found[-1].agreed is not None

    def until(self, at: int) -> list[Signals]:
        """The quantities as each of so many steps found them."""
        return self._found[:at]

    def shared(self, route: Route, signals: Signals, parts: Sequence[Array]) -> tuple[int, Signals]:
        """How many steps of another one are the same as here, and the quantities behind them."""
        agreed = self._found[-1].agreed
        if signals is not self._signals:
            s = signals.fresh()
            s.agreed = agreed if len(signals) == len(self._signals) else None
            return 0, s
        at, parts = 0, (*parts, NONE)
        for mine, other in zip(self._route.steps, route.steps):
            if mine.what != other.what or self._values[mine.effect] != parts[other.effect].tobytes():
                break
            at += 1
        law = self._route.law
        if at in law and self._found[law.start].compliance > 0.0:
            at = law.start  # law and arm agree on the force together
        s = self._found[at].copy()
        if at <= law.start:
            s.agreed = agreed
        return at, s


def _unloaded(s: Signals, _: Array) -> None:
    s.exponent, s.elastic, s.recalls = 1.0, s.zeros[0], ()


def _loaded(s: Signals, _: Array) -> None:
    s.normal = s.elastic


def _let_go(s: Signals, _: Array) -> None:
    s.normal = np.where(s.inside, s.normal, 0.0)


def _rub(s: Signals, _: Array) -> None:
    if s.mu.any():
        s.tangential = s.tangential - s.mu * s.load * _direction(s)


def _direction(s: Signals) -> Array:
    """Direction of friction, shorter than 1 where it isn't full, (2, n): deflection of bristles, or slip over a speed.

    It depends on the motion alone, which one log's predictions share.
    """
    touch = s.depth if s.touch is None else s.touch

    def bend() -> Array:
        if s.rounding > 0.0:
            inside = s.inside if s.touch is None else touch > 0.0
            return np.where(inside, s.slip_rate / np.sqrt(np.sum(s.slip_rate**2, axis=0) + s.rounding**2), 0.0)
        u = np.empty((2, len(s)))
        bristles(s.slip_rate[0], s.slip_rate[1], s.dt, touch, s.bristle, u, s.rest.share, s.rest.tremor)
        return u

    form = (s.bristle, s.rounding, s.rest.share, s.rest.tremor)
    return derived("bristles", bend, s.slip_rate, touch, s.dt, at=form)


def _read(s: Signals, _: Array) -> None:
    """Contact forces as the sensor has them: a wrench at its origin with the rig's tool, or themselves."""
    if s.layout.kind == "contact":
        rows = {"normal_force": s.normal, "tangential_force1": s.tangential[0], "tangential_force2": s.tangential[1]}
        s.reading = np.stack([rows[name] for name in s.layout.channels])
    else:
        sensor = s.sensor
        assert sensor is not None
        s.reading = np.empty((6, len(s)))
        contact_wrench(s.tangential, s.normal, sensor.to_contact, sensor.tip, sensor.load, s.reading)


def _filter(s: Signals, _: Array) -> None:
    """Torques as filters leave them: one without delay, near enough to a Gaussian, and a low-pass of first order."""
    if s.rest.smoothing > 0.0:
        width = s.rest.smoothing / sample_period(s)
        weights = derived("smoothing", lambda: _gaussian(width), s.dt, at=(width,))
        smooth = np.empty(s.reading.shape)
        edges = np.array([*(run.start for run in s.runs), len(s)])
        symmetric(weights, edges, np.ascontiguousarray(s.reading), smooth)
        s.reading = smooth
    if s.rest.lag > 0.0:
        late = np.empty(s.reading.shape)
        lag(np.ascontiguousarray(s.reading), s.dt, s.rest.lag, late)
        s.reading = late


def _gaussian(width: float) -> Array:
    """Weights of a sample and of its neighbours on one side, of a Gaussian that is so many samples wide, (r + 1,)."""
    weights = np.exp(-0.5 * (np.arange(int(SMOOTHING_REACH * width + 0.5) + 1) / width) ** 2)
    return np.asarray(weights / (weights[0] + 2.0 * weights[1:].sum()))


def _as_read(s: Signals, _: Array) -> None:
    """The sensor's stated faults come back for the converter."""
    s.reading = s.reading if s.as_read is None else s.as_read.raw(s.reading)


def _as_true(s: Signals, _: Array) -> None:
    """… and go again."""
    s.reading = s.reading if s.as_read is None else s.as_read.true(s.reading)
