"""Composition: a model is an ordered set of effects, run along the measurement chain.

joints → geometry → elastic → normal → friction → frame → tool → sensor → acquisition → reading
joints → rigid body + joint effects → sensor → acquisition → joint torques
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from kinid import effects as catalogue
from kinid.effects import Effect, Layout, Signals, Stage
from kinid.effects._deflection import press_through
from kinid.effects._derived import derived
from kinid.errors import InputError
from kinid.kernels.frames import contact_wrench
from kinid.kernels.memory import bristles, steady
from kinid.parameter import Parameter

if TYPE_CHECKING:
    from kinid.contact import ContactSeries
    from kinid.fit import Fit
    from kinid.log import Log
    from kinid.rig import Rig

Array = NDArray[np.float64]

#: share of their length that bristles don't notice of what a path is off for moments
NOTICED = 0.1
#: names that stand for several effects
TOGETHER = {
    "dahl-friction": ("coulomb-friction", "presliding"),
    "lugre-friction": ("coulomb-friction", "stribeck-friction", "presliding", "viscous-friction"),
    "none": (),
}


@dataclass(frozen=True)
class Model:
    """An ordered set of effects; `model + "relaxation"` is the model with one more.

    Args:
        effects: names of the catalogue, or effects; a base law first where there is one. "none" is free motion alone.

    Raises:
        InputError: an unknown name, two bases, an effect twice, or one that lacks what it acts on.
    """

    effects: tuple[Effect, ...]

    def __init__(self, *effects: str | Effect) -> None:
        flat: list[Effect] = []
        for effect in effects:
            names = TOGETHER.get(effect, (effect,)) if isinstance(effect, str) else (effect,)
            flat += [catalogue.get(item) if isinstance(item, str) else item for item in names]
        bases = [effect.id for effect in flat if effect.base]
        if len(bases) > 1:
            raise InputError(f"{len(bases)} bases, {' and '.join(bases)}", "one contact law at most", "choose one")
        names_seen = [effect.id for effect in flat]
        for name in names_seen:
            if names_seen.count(name) > 1:
                raise InputError(f"effect '{name}' twice in one model", "each effect once", "leave one out")
        flat.sort(key=lambda effect: not effect.base)
        for effect in flat:
            if effect.wants and not any(name in names_seen for name in effect.wants):
                raise InputError(f"effect '{effect.id}' alone", f"{' or '.join(effect.wants)} in the same model",
                                 f"add {effect.wants[0]}")  # fmt: skip
        object.__setattr__(self, "effects", tuple(flat))

    def __add__(self, other: str | Effect | Model) -> Model:
        more = other.effects if isinstance(other, Model) else (other,)
        return Model(*self.effects, *more)

    def __sub__(self, name: str) -> Model:
        if name not in self:
            raise InputError(f"no effect '{name}' in {self}", f"one of {', '.join(self.names)}", "check the name")
        return Model(*(effect for effect in self.effects if effect.id != name))

    def __contains__(self, name: object) -> bool:
        return name in self.names

    def __str__(self) -> str:
        return " + ".join(self.names) or "none"

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the effects, the base first."""
        return tuple(effect.id for effect in self.effects)

    @cached_property
    def stages(self) -> frozenset[Stage]:
        """Stages at which any of its effects acts."""
        return frozenset(stage for effect in self.effects for stage in effect.stages())

    @property
    def needs(self) -> frozenset[str]:
        """Quantities that its effects can't do without."""
        return frozenset(need for effect in self.effects for need in effect.needs)

    @cached_property
    def needs_log(self) -> bool:
        """Whether contact-frame quantities alone can't carry it: some effect acts on the whole wrench, or on joint torques."""
        one = Layout(("normal_force",), "contact")
        return bool(self.needs & {"wrench", "joints"}) or any(not effect.parameters(one) for effect in self.effects)

    @property
    def pulls(self) -> bool:
        """Whether it pulls at a tool that retracts and no adhesion is meant: a material that lets go says nothing to it then."""
        return any(effect.pulls for effect in self.effects) and not self._reaches_out

    @property
    def acts_on_reading(self) -> bool:
        """Whether an effect of tool, sensor or acquisition is in it: such act on all that the sensor reads."""
        return bool(self.stages & {Stage.TOOL, Stage.SENSOR, Stage.ACQUISITION})

    def parameters(self, layout: Layout) -> dict[str, Parameter]:
        """All parameters for logs of this layout, by "effect.parameter", in order."""
        return {f"{effect.id}.{p.name}": p for effect in self.effects for p in effect.parameters(layout)}

    def nominal(self, layout: Layout) -> Array:
        """Nominal values of all parameters."""
        return np.array([p.nominal for p in self.parameters(layout).values()])

    def predict(self, signals: Signals, values: Array | Mapping[str, float]) -> Array:
        """Readings that the model expects, (channels, n).

        Args:
            signals: the measured motion.
            values: of all parameters in order, or by name (those not named are nominal).
        """
        if isinstance(values, Mapping):
            named = self.parameters(signals.layout)
            unknown = set(values) - set(named)
            if unknown:
                raise InputError(f"parameter '{min(unknown)}'", f"one of {', '.join(named)}", "check the name")
            values = np.array([values.get(name, p.nominal) for name, p in named.items()])
        s = signals.fresh()
        slices = [values[part] for part in self._parts(s.layout)]
        if s.layout.kind == "joints":
            self._run(Stage.JOINT, s, slices)
        else:
            self._contact(s, slices)
        self._run(Stage.SENSOR, s, slices)
        if Stage.ACQUISITION in self.stages:
            self._convert(s, slices)
        return s.reading

    def _convert(self, s: Signals, slices: list[Array]) -> None:
        """What happens to raw readings; the sensor's stated faults come back for it, and go again."""
        if s.as_read is not None:
            s.reading = s.as_read.raw(s.reading)
        self._run(Stage.ACQUISITION, s, slices)
        if s.as_read is not None:
            s.reading = s.as_read.true(s.reading)

    def _contact(self, s: Signals, slices: list[Array]) -> None:
        self._run(Stage.GEOMETRY, s, slices)
        if s.compliance > 0.0:
            press_through(s, s.compliance, lambda bent: self._press(bent, slices))
        else:
            self._press(s, slices)
        if Stage.FRICTION in self.stages:
            self._run(Stage.FRICTION, s, slices)
            if s.mu.any():
                s.tangential = s.tangential - s.mu * s.normal * self._bristles(s)
        self._run(Stage.FRAME, s, slices)
        if s.layout.kind == "contact":
            rows = {"normal_force": s.normal, "tangential_force1": s.tangential[0], "tangential_force2": s.tangential[1]}
            s.reading = np.stack([rows[name] for name in s.layout.channels])
        elif s.sensor is not None:
            s.reading = _wrench(s)
            self._run(Stage.TOOL, s, slices)

    def _bristles(self, s: Signals) -> Array:
        """Deflection of the bristles; it depends on the motion alone, which one log's predictions share.

        Noise of the slip would shake them loose, which no surface feels: what of it they aren't elastic enough to bear is
        taken out of the rates; so is a differentiator's overshoot, where they are short enough to notice.
        """
        beyond = max(s.dither - s.play * s.bristle, s.overshoot - NOTICED * s.bristle)

        def rested() -> Array:
            rates = np.empty_like(s.slip_rate)
            for rate, row in zip(s.slip_rate, rates):
                steady(rate, s.dt, beyond, row)
            return rates

        def bend() -> Array:
            rates, u = s.slip_rate, np.empty((2, len(s)))
            if beyond > 0.0:
                rates = derived("rates of a slip that rests", rested, s.slip_rate, s.dt, at=(beyond,))
            bristles(rates[0], rates[1], s.dt, s.depth, s.bristle, u, s.play)
            return u

        return derived("bristles", bend, s.slip_rate, s.depth, s.dt, at=(s.bristle, s.play, beyond))

    def _press(self, s: Signals, slices: list[Array]) -> None:
        """The contact law: elastic and normal force from depth and rate."""
        s.exponent, s.elastic, s.recall = 1.0, np.zeros(len(s)), None
        self._run(Stage.ELASTIC, s, slices)
        s.normal = s.elastic
        self._run(Stage.NORMAL, s, slices)
        s.normal = np.where(s.inside | self._reaches_out, s.normal, 0.0)

    @cached_property
    def _reaches_out(self) -> bool:
        """Whether a force may act outside the material too (adhesion)."""
        return "adhesion" in self

    def _run(self, stage: Stage, s: Signals, slices: list[Array]) -> None:
        for i, act in self._plan.get(stage, ()):
            act(s, slices[i])

    @cached_property
    def _plan(self) -> dict[Stage, list[tuple[int, Callable[[Signals, Array], None]]]]:
        """What acts at each stage, in order: number of the effect, and its method."""
        plan: dict[Stage, list[tuple[int, Callable[[Signals, Array], None]]]] = {}
        for i, effect in enumerate(self.effects):
            for stage in effect.stages():
                plan.setdefault(stage, []).append((i, getattr(effect, stage.value)))
        return plan

    @cached_property
    def _slices(self) -> dict[Layout, list[slice]]:
        return {}

    def _parts(self, layout: Layout) -> list[slice]:
        """Where each effect's parameters stand among all values; remembered, because predictions ask for it often."""
        if layout not in self._slices:
            ends = np.cumsum([0] + [len(effect.parameters(layout)) for effect in self.effects])
            self._slices[layout] = [slice(int(a), int(b)) for a, b in zip(ends[:-1], ends[1:])]
        return self._slices[layout]

    def equation(self) -> str:
        """The model as equations, one line an effect."""
        return "\n".join(f"{effect.id}: {effect.equation}" for effect in self.effects) or "no contact"

    def fit(self, data: ContactSeries | Log, rig: Rig | None = None, **options: object) -> Fit:
        """Estimate the parameters from a log; see `kinid.fit.fit_model`."""
        from kinid.fit import fit_model

        return fit_model(self, data, rig, **options)  # type: ignore[arg-type]


def _wrench(s: Signals) -> Array:
    """Contact force and the rig's tool at the sensor's origin, sensor axes, (6, n)."""
    sensor = s.sensor
    assert sensor is not None
    out = np.empty((6, len(s)))
    contact_wrench(s.tangential, s.normal, sensor.to_contact, sensor.tip, sensor.load, out)
    return out
