"""What the rules of the contract are asked about, and what they answer."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cache, cached_property

import numpy as np
from numpy.typing import NDArray

from kinid.effects import Effect, Example, Layout, Motion, Signals
from kinid.errors import InputError
from kinid.modeling.model import Model
from kinid.modeling.reference_motions import closed, reference_motion
from kinid.parameter import Parameter

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Outcome:
    """What a rule found of an effect.

    Attributes:
        rule: its name. passed: whether the effect keeps it. found, expected, mend: in words; `mend` is empty where it
            passed.
    """

    rule: str
    passed: bool
    found: str
    expected: str
    mend: str


class Violation(Exception):
    """An effect breaks a rule; its text is what was found."""


@dataclass(frozen=True)
class Rule:
    """One rule of the contract.

    Attributes:
        name: of the rule. look: what it finds of a case, in words.
        expected, mend: what an effect needs to pass, and what to do where it doesn't.
    """

    name: str
    look: Callable[[Case], str]
    expected: str
    mend: str

    def ask(self, case: Case) -> Outcome:
        """Its outcome for a case; whatever the effect's own code raises is what was found."""
        try:
            return Outcome(self.name, True, self.look(case), self.expected, "")
        except Violation as error:
            found = str(error)
        except Exception as error:
            found = f"{type(error).__name__}: {' '.join(str(error).split())}"
        return Outcome(self.name, False, found, self.expected, self.mend)


def demand(holds: object, found: str) -> None:
    """Say what was found where something doesn't hold.

    Raises:
        Violation: it doesn't hold.
    """
    if not holds:
        raise Violation(found)


@dataclass(frozen=True, eq=False)
class Case:
    """An effect's own example, built: what every rule is asked about.

    Attributes:
        kind: the effect's class. model: that of its example, its effects as the motion needs them.
        values: true values of the model's parameters, in order. signals: the motion; its arrays can't be written into.
    """

    kind: type[Effect]
    model: Model
    values: Array
    signals: Signals

    @classmethod
    def of(cls, kind: type[Effect]) -> Case:
        """From the example that a class declares.

        Raises:
            InputError: it declares none, or one with values of parameters that the model doesn't have.
        """
        example = kind.example
        if not isinstance(example, Example):
            raise InputError(f"no example in {kind.__name__}", "example = Example(…)", "declare one, as in `hooke.py`")
        motion = example.motion
        signals = reference_motion(motion) if isinstance(motion, Motion) else closed(motion())
        model = Model(*example.beside, kind(**example.form)).for_log(signals)
        named = model.parameters(signals.layout)
        known = _spread(kind.id, example, list(named))
        values = np.array([known.get(key, p.nominal) for key, p in named.items()])
        values.setflags(write=False)
        return cls(kind, model, values, signals)

    @property
    def name(self) -> str:
        """The effect's name."""
        return self.kind.id

    @cached_property
    def effect(self) -> Effect:
        """The effect, as it is in the model."""
        return self.model[self.name]

    @cached_property
    def named(self) -> dict[str, Parameter]:
        """The model's parameters, by "effect.parameter"."""
        return self.model.parameters(self.signals.layout)

    @cached_property
    def own(self) -> dict[str, Parameter]:
        """The effect's own parameters, by their names."""
        return {p.name: p for p in self.effect.parameters(self.signals.layout)}

    @cached_property
    def places(self) -> list[int]:
        """Where the effect's own parameters stand among those of the model."""
        place = self.model.place(self.name, self.signals.layout)
        return list(range(place.start, place.stop))

    @cached_property
    def reading(self) -> Array:
        """What the model predicts at the true values, (channels, n)."""
        out = self.model.predict(self.signals, self.values)
        out.setflags(write=False)
        return out

    @cached_property
    def measured(self) -> Signals:
        """The motion as a fit meets it: with those readings, that some laws are driven by."""
        return dataclasses.replace(self.signals, measured=self.reading)

    @cached_property
    def rest(self) -> Model:
        """The model without the effect, and without those that need it."""
        return Model(*(e for e in self.model.effects if e.id != self.name and self.name not in e.requires))

    @cached_property
    def beside(self) -> Case:
        """The case without the effects that need this one."""
        if len(self.rest.effects) + 1 == len(self.model.effects):
            return self
        kept = dict(zip(self.named, self.values))
        model = Model(*(e for e in self.model.effects if e.id == self.name or e.id in self.rest))
        values = np.array([kept[key] for key in model.parameters(self.signals.layout)])
        return Case(self.kind, model, values, self.signals)

    @cached_property
    def rest_values(self) -> Array:
        """True values of the model without the effect."""
        kept = dict(zip(self.named, self.values))
        return np.array([kept[key] for key in self.rest.parameters(self.signals.layout)])

    @cached_property
    def null(self) -> dict[str, float]:
        """Values at which the effect does nothing, by names before the bracket."""
        base = next((effect.id for effect in self.model.effects if effect.base), None)
        return dict(self.effect.null_for(base))

    @cached_property
    def at_null(self) -> Array:
        """The true values with the effect's own at its null."""
        out = self.values.copy()
        for i, name in zip(self.places, self.own):
            out[i] = self.null.get(short(name), out[i])
        return out

    @property
    def affine(self) -> bool:
        """Whether readings are affine in all linear parameters of the model at once."""
        return all(effect.affine for effect in self.model.effects)

    def starts(self) -> Iterator[Array]:
        """Values of all the model's parameters that the effect says a search is worth starting from."""
        for start in self.effect.initial_guesses(self.signals):
            full = self.model.nominal(self.signals.layout)
            full[self.places] = start
            yield full


def true_values(model: Model, layout: Layout) -> Array:
    """Each effect's own values as in its example, else nominal."""
    known: dict[str, float] = {}
    for effect in model.effects:
        known |= _stated(type(effect))
    return np.array([known.get(key, p.nominal) for key, p in model.parameters(layout).items()])


@cache
def _stated(kind: type[Effect]) -> dict[str, float]:
    """The example's values of an effect's own parameters, by "effect.parameter"."""
    if kind.example is None:
        return {}
    case = Case.of(kind)
    return {f"{case.name}.{name}": float(case.values[i]) for i, name in zip(case.places, case.own)}


def short(name: str) -> str:
    """A parameter's name before the bracket."""
    return name.split("[", maxsplit=1)[0]


def _spread(own: str, example: Example, names: list[str]) -> dict[str, float]:
    """An example's values by full names, those that stand for several parameters one by one.

    Raises:
        InputError: there is no such parameter, or not so many.
    """
    out: dict[str, float] = {}
    for key, value in example.values.items():
        full = key if "." in key.split("[")[0] else f"{own}.{key}"
        if not isinstance(value, tuple):
            if full not in names:
                raise InputError(f"an example with '{key}'", f"a parameter of {', '.join(names)}", "correct the name")
            out[full] = value
            continue
        several = [name for name in names if short(name) == full]
        if len(several) != len(value):
            raise InputError(
                f"an example with {len(value)} values of '{key}'",
                f"{len(several)} values, one for each of {', '.join(several) or ', '.join(names)}",
                "give as many",
            )
        out |= dict(zip(several, value))
    return out
