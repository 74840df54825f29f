"""Composition: a model is an ordered set of effects, which act along the measurement chain."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, ClassVar

import numpy as np
from numpy.typing import NDArray

from kinid import effects as catalogue
from kinid.effects import Effect, Layout, Signals, Stage
from kinid.errors import InputError, expect
from kinid.modeling.forward import Course, Route
from kinid.parameter import Parameter

if TYPE_CHECKING:
    from kinid.contact.series import ContactSeries
    from kinid.data.log import Log
    from kinid.data.rig import Rig
    from kinid.identification.fit import Fit

Array = NDArray[np.float64]


@dataclass(frozen=True, repr=False)
class Model:
    """An ordered set of effects; `model + "relaxation"` is the model with one more.

    Args:
        effects: names of the catalogue, or effects, one by one or as one list; a base law first where there is one.
            "none" is free motion alone.

    Raises:
        InputError: an unknown name, two bases, an effect twice, or one that lacks what it acts on.
    """

    effects: tuple[Effect, ...]
    #: what estimates the parameters: `kinid.identification.fit`, which stands above this package, sets it
    fitter: ClassVar[Callable[..., Fit]]

    def __init__(self, *effects: str | Effect | Sequence[str | Effect]) -> None:
        flat: list[Effect] = []
        free = False
        for each in effects:
            for effect in each if isinstance(each, list | tuple) else (each,):
                remedy = "as Model('hooke', 'relaxation')"
                expect(effect, (str, Effect), "an effect of a model", "names of effects", remedy)
                free |= effect == "none"
                together = catalogue.TOGETHER.get(effect, (effect,)) if isinstance(effect, str) else (effect,)
                flat += [catalogue.get(item) if isinstance(item, str) else item for item in together]
        bases = [effect.id for effect in flat if effect.base]
        if free and bases:
            raise InputError(f"'none' beside {bases[0]}", "no contact, or a contact law", "leave one of them out")
        if len(bases) > 1:
            raise InputError(f"{len(bases)} bases, {' and '.join(bases)}", "one contact law at most", "choose one")
        names_seen = [effect.id for effect in flat]
        for name in names_seen:
            if names_seen.count(name) > 1:
                raise InputError(f"effect '{name}' twice in one model", "each effect once", "leave one out")
        flat.sort(key=lambda effect: not effect.base)
        for effect in flat:
            if effect.requires and not any(name in names_seen for name in effect.requires):
                beside, mend = "alone", f"add {effect.requires[0]}"
                if bases and catalogue.get(effect.requires[0]).base:
                    beside, mend = f"beside {bases[0]}", f"start from {effect.requires[0]} instead of {bases[0]}"
                raise InputError(
                    f"effect '{effect.id}' {beside}", f"{' or '.join(effect.requires)} in the same model", mend
                )
        object.__setattr__(self, "effects", tuple(effect.beside(names_seen) for effect in flat))

    def __getstate__(self) -> dict[str, object]:
        return {"effects": self.effects}  # what was remembered of logs stays here

    def __add__(self, other: str | Effect | Model) -> Model:
        more = other.effects if isinstance(other, Model) else (other,)
        return Model(*self.effects, *more)

    def __sub__(self, name: str) -> Model:
        if name not in self:
            raise InputError(f"no effect '{name}' in {self}", f"one of {', '.join(self.names)}", "check the name")
        return Model(*(effect for effect in self.effects if effect.id != name))

    def for_log(self, signals: Signals) -> Model:
        """The model with its effects as this log needs them (`Effect.for_log`)."""
        own = tuple(effect.for_log(signals) for effect in self.effects)
        return self if all(a is b for a, b in zip(own, self.effects)) else Model(*own)

    def __contains__(self, name: object) -> bool:
        return name in self.names

    def __getitem__(self, name: str) -> Effect:
        """One of its effects, as it is in this model."""
        if name not in self:
            raise InputError(f"no effect '{name}' in {self}", f"one of {', '.join(self.names)}", "check the name")
        return self.effects[self.names.index(name)]

    def __repr__(self) -> str:
        return f"Model({', '.join(map(repr, self.names))})"

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
        """Whether contact-frame quantities alone can't carry it: some effect acts on a wrench or on joint torques."""
        one = Layout(("normal_force",), "contact")
        return bool(self.needs & {"wrench", "joints"}) or any(not effect.parameters(one) for effect in self.effects)

    @property
    def contact_law(self) -> Effect | None:
        """The base that says what a material answers to a depth, None without one."""
        return next((effect for effect in self.effects if effect.base and "normal" in effect.needs), None)

    @property
    def tensile(self) -> bool:
        """Whether it pulls at a tool that retracts, without meaning adhesion: separation then tells it nothing."""
        return any(effect.tensile for effect in self.effects) and not any(
            effect.acts_outside for effect in self.effects
        )

    def parameters(self, layout: Layout) -> dict[str, Parameter]:
        """All parameters for logs of this layout, by the text of their `ParameterId`, in order."""
        if layout not in self._named:
            named = {f"{effect.id}.{p.name}": p for effect in self.effects for p in effect.parameters(layout)}
            self._named[layout] = named
        return self._named[layout].copy()

    def nominal(self, layout: Layout) -> Array:
        """Nominal values of all parameters."""
        return np.array([p.nominal for p in self.parameters(layout).values()])

    def predict(self, signals: Signals, values: Array | Mapping[str, float], near: Course | None = None) -> Array:
        """Readings that the model expects, (channels, n).

        Args:
            signals: the measured motion.
            values: of all parameters in order, or by name (those not named are nominal).
            near: the way of a prediction that may be the same at first, of this model or one much like it; saves time
                alone.
        """
        if isinstance(values, Mapping):
            named = self.parameters(signals.layout)
            unknown = set(values) - set(named)
            if unknown:
                raise InputError(f"parameter '{min(unknown)}'", f"one of {', '.join(named)}", "check the name")
            values = np.array([values.get(name, p.nominal) for name, p in named.items()])
        return self._route(signals.layout.kind).run(signals, self._split(signals.layout, values), near).reading

    def course(self, signals: Signals, values: Array, near: Course | None = None) -> Course:
        """The way along the chain to what `predict` gives; predictions may share it, and it may share another one."""
        return Course(self._route(signals.layout.kind), signals, self._split(signals.layout, values), near)

    def _route(self, kind: str) -> Route:
        if kind not in self._routes:
            self._routes[kind] = Route.of(self.effects, kind)
        return self._routes[kind]

    @cached_property
    def _routes(self) -> dict[str, Route]:
        return {}

    @cached_property
    def _named(self) -> dict[Layout, dict[str, Parameter]]:
        return {}

    @cached_property
    def _slices(self) -> dict[Layout, list[slice]]:
        return {}

    def place(self, name: str, layout: Layout) -> slice:
        """Where an effect's parameters stand among those of the model."""
        return self._places(layout)[self.names.index(name)]

    def _split(self, layout: Layout, values: Array) -> list[Array]:
        """Values of each effect's parameters."""
        return [values[part] for part in self._places(layout)]

    def _places(self, layout: Layout) -> list[slice]:
        """Where the parameters of each effect stand; remembered, because predictions ask for it often."""
        if layout not in self._slices:
            ends = np.cumsum([0] + [len(effect.parameters(layout)) for effect in self.effects])
            self._slices[layout] = [slice(int(a), int(b)) for a, b in zip(ends[:-1], ends[1:])]
        return self._slices[layout]

    def equation(self) -> str:
        """The model as equations, one line an effect."""
        return "\n".join(f"{effect.id}: {effect.equation}" for effect in self.effects) or "no contact"

    def fit(self, data: ContactSeries | Log, rig: Rig | None = None, **options: object) -> Fit:
        """Estimate the parameters from a log.

        Args:
            data: contact-frame quantities; or a log with its `rig`, for models that act on the whole wrench or on joint
                torques.
            rig: goes with a log.
            options: `start`, starting values by a parameter's name; `channels` of a contact frame to fit; `train`, a
                mask of the samples to fit to; `held_out=False`, no held-out error: as of
                `kinid.identification.fit.fit_model`.

        Raises:
            InputError: data that can't carry the model, and what to record instead.
        """
        return Model.fitter(self, data, rig, **options)
