"""What an effect is: one physical law, in one file, acting at one or more places of the measurement chain."""

from __future__ import annotations

import functools
import itertools
import math
from abc import ABC
from collections.abc import Collection, Mapping
from dataclasses import dataclass
from enum import Enum
from typing import ClassVar, TypeVar

import numpy as np

from kinid.effects._example import Example
from kinid.effects._samples import Detection, Samples
from kinid.effects._signals import Array, Layout, Signals
from kinid.parameter import Parameter, ParameterId

T = TypeVar("T")


class Stage(Enum):
    """Where in the chain an effect acts, in the chain's order; the value is the name of the method it implements."""

    GEOMETRY = "geometry"  # changes depth and slip before any law sees them
    ELASTIC = "elastic"  # changes the elastic force F_e
    NORMAL = "normal"  # adds to the normal force N what is not elastic
    FRICTION = "friction"  # changes the friction coefficient μ, the bristles' length, or adds a tangential force
    FRAME = "frame"  # turns or couples contact forces on their way into the contact frame of the rig
    TOOL = "tool"  # adds to the load of the tool on the sensor
    SENSOR = "sensor"  # changes the reading, sample by sample
    ACQUISITION = "acquisition"  # changes the reading over time
    JOINT = "joint"  # adds to the joint torques


@dataclass(frozen=True)
class Effect(ABC):
    """One physical law. A subclass is final, stands alone in its file, and implements one method a stage it acts at.

    Class attributes:
        id: its name everywhere, kebab-case.
        title: in a few words.
        equation: as it is printed, with the parameters' symbols.
        source: where the equation comes from.
        base: a contact law (or `rigid-body`) that a model starts from; a model has one at most.
        signature: what its absence looks like in a residual, in words.
        confusions: effects it can be mistaken for → what tells them apart.
        excited_by: what a log must hold for its parameters to be seen.
        needs: quantities of the signals without which it can't act: "normal", "slip", "wrench", "joints".
        requires: effects that must be in the model for this one to do anything (at least one of them).
        detector: whether it is recognised by its mark in the samples alone (flat tops, a lattice, a line in the
            spectrum).
        detection_order: when a detector looks at the samples, lower ones first: it sees them without what was found
            before it.
        null: parameter name → value at which the effect does nothing (for names with a channel or joint in brackets,
            the part before the bracket); parameters that aren't named there may have any value then. Empty for a base.
        grid: parameter name → values worth starting a search from, of the parameters that one start can miss: shapes
            (lengths, speeds, time constants), and those whose best value may hide behind a hill. Where the effect is
            small, all others change readings in proportion, and any start serves.
        affine: whether readings stay affine in the linear parameters of a model that holds it; False for a law that
            bends what others predict (a power of the normal force, a clipped reading).
        nearly_affine: of one that isn't: whether all but few samples are, so that a search may try linear parameters at
            their best all the same.
        tensile: whether the law pulls at a tool that retracts, as a linear dashpot does and no material that lets go.
        acts_outside: whether its force acts outside the material, too.
        couples: whether it carries force or motion from one axis into another.
        per_log: whether its parameters differ from log to log of one rig, as a surface that is touched anew, a sensor
            that is zeroed, clocks that start; a fit to many logs shares those of all others unless it is told
            otherwise.
        constant: whether it is one constant a channel, which a fit estimates along where a model lacks it.
        recursive: name of the estimator in `kinid.estimators` that follows its parameters sample by sample.
        map_names: parameter name → what a map calls it.
        above: of an effect that some places of a surface have and others lack, as a film: amount → what a map calls the
            contact law's parameter of that name where the effect hasn't begun; the sum of both has the law's own name.
        unremarkable: parameter name → distance from its null that every material and every rig has; names as below.
        tolerated: parameter name → distance that many a rig has: no finding where the error with it is inside the
            tolerance; infinite for what has no exact form: a finding where it takes off what is beyond noise.
            tolerated_in_joints: the same of joint torques, where it is another: drives filter them.
        calibration_tolerance: parameter name → standard deviation within which every rig's calibration leaves it open.
            Names are those before the bracket; where channels differ in their unit it stands in brackets: "offset[N]",
            "offset[N·m]".
        admissible: parameter name, written alike → range that is physically possible, ends included. A search may go
            beyond it, within the parameter's own bounds: where the best value lies there, something else is missing.
        generalises: effects that it is a more general form of: where one of them explains as much, it is no
            alternative.
        includes: effects that it includes already, so that they have nothing to add beside it.
        same_for_joints: name of the effect that is the same thing in a log of joint torques.
        example: the effect at work, which the contract of all effects is checked on (`kinid effect check`).
        order: when it acts among the effects of one stage, however a model lists them: lower ones first. Effects that
            share an order and a stage act alike either way round. Elastic: what bends the base's spring, 1
            what adds, 2 what scales, 3 what remembers; friction: what adds, 1 what scales; sensor: its mounting, 1 its
            axes, 2 what it adds; acquisition: its filter, 1 the clock, 2 the cable, 3 and 4 the converter.
    """

    id: ClassVar[str]
    title: ClassVar[str]
    equation: ClassVar[str]
    source: ClassVar[str]
    base: ClassVar[bool] = False
    signature: ClassVar[str]
    confusions: ClassVar[Mapping[str, str]] = {}
    excited_by: ClassVar[str]
    needs: ClassVar[tuple[str, ...]] = ("normal",)
    requires: ClassVar[tuple[str, ...]] = ()
    detector: ClassVar[bool] = False
    detection_order: ClassVar[int] = 0
    null: ClassVar[Mapping[str, float]] = {}
    grid: ClassVar[Mapping[str, tuple[float, ...]]] = {}
    affine: ClassVar[bool] = True
    nearly_affine: ClassVar[bool] = False
    tensile: ClassVar[bool] = False
    acts_outside: ClassVar[bool] = False
    couples: ClassVar[bool] = False
    per_log: ClassVar[bool] = False
    constant: ClassVar[bool] = False
    recursive: ClassVar[str] = ""
    map_names: ClassVar[Mapping[str, str]] = {}
    above: ClassVar[Mapping[str, str]] = {}
    unremarkable: ClassVar[Mapping[str, float]] = {}
    tolerated: ClassVar[Mapping[str, float]] = {}
    tolerated_in_joints: ClassVar[Mapping[str, float]] = {}
    calibration_tolerance: ClassVar[Mapping[str, float]] = {}
    admissible: ClassVar[Mapping[str, tuple[float, float]]] = {}
    order: ClassVar[int] = 0
    generalises: ClassVar[tuple[str, ...]] = ()
    includes: ClassVar[tuple[str, ...]] = ()
    same_for_joints: ClassVar[str] = ""
    example: ClassVar[Example | None] = None

    def for_log(self, signals: Signals) -> Effect:
        """The effect as this log needs it, where parameters depend on what a log visits; else itself."""
        return self

    def beside(self, names: Collection[str]) -> Effect:
        """The effect as a model of these effects needs it, where another one takes a part over; parameters stay."""
        return self

    def prior(self, layout: Layout) -> Array | None:
        """Precision (k, k) of a normal prior about the null of its parameters, in their units; None without one."""
        return None

    def learnt(self, layout: Layout, information: Array, gradient: Array) -> Effect:
        """The effect with the prior under which readings are most likely; itself where its prior has nothing to learn.

        Args:
            layout: of the readings.
            information: of the readings about its parameters, others projected out, AᵀΣ⁻¹A, (k, k).
            gradient: of half the weighted squared residual at its null, with its sign turned, AᵀΣ⁻¹r, (k,).
        """
        return self

    def null_for(self, base: str | None) -> Mapping[str, float]:
        """`null` in a model with this base, for the effects where it depends on it."""
        return self.null

    def parameters(self, layout: Layout) -> tuple[Parameter, ...]:
        """Its parameters for logs of this layout."""
        raise NotImplementedError

    def initial_guesses(self, signals: Signals) -> tuple[Array, ...]:
        """Values of all its parameters that a search in this log is worth starting from: the grid's, others nominal."""
        parameters = self.parameters(signals.layout)
        if not any(p.name in self.grid for p in parameters):
            return ()
        return tuple(
            np.array(values) for values in itertools.product(*(self.grid.get(p.name, (p.nominal,)) for p in parameters))
        )

    def detected(self, measured: Array) -> tuple[Array, Array] | None:
        """For a detector: parameters as readings (channels, n) show them, and as a search for the others holds them."""
        return None

    def detect(self, samples: Samples) -> Detection | None:
        """For a detector: its mark in samples of a log, None without one."""
        return None

    def unseen(self, rate: float) -> str:
        """For a detector without a mark: why a log of this rate [Hz] says nothing of it; "" where it is absent."""
        return ""

    def calibration_sd(self, signals: Signals) -> Mapping[str, float]:
        """Standard deviation within which calibration leaves each parameter open; {} where it is no calibration."""
        kind = signals.layout.kind
        if ("wrench" in self.needs and kind != "wrench") or (
            ("joints" in self.needs) != (kind == "joints") and self.needs
        ):
            return {}
        named = ((p.name, _looked_up(self.calibration_tolerance, p)) for p in self.parameters(signals.layout))
        return {name: sd for name, sd in named if sd is not None}

    def calibration_bound(self, layout: Layout) -> float:
        """How many of these standard deviations a fit may take it to beside a model that lacks the effect."""
        return 2.0

    def usual(self, parameter: Parameter) -> float:
        """How far from where it does nothing a parameter is in every material and every rig."""
        return _looked_up(self.unremarkable, parameter) or 0.0

    def tolerated_at_any_share(self, layout: Layout) -> bool:
        """Whether what is tolerated is no finding however much of the error it is: an amount, not a form."""
        return any(0.0 < self.tolerable(parameter, layout) < math.inf for parameter in self.parameters(layout))

    def tolerable(self, parameter: Parameter, layout: Layout) -> float:
        """How far from where it does nothing a parameter is in many a rig."""
        of_joints = _looked_up(self.tolerated_in_joints, parameter) if layout.kind == "joints" else None
        return of_joints or _looked_up(self.tolerated, parameter) or 0.0

    def admissible_range(self, parameter: Parameter) -> tuple[float, float] | None:
        """Range of a parameter's values that is physically possible, None where `admissible` says nothing of it."""
        return _looked_up(self.admissible, parameter)

    def implausible(
        self, values: Mapping[str, float], model_values: Mapping[str, float], signals: Signals | None = None
    ) -> str:
        """Why a value can't be, in words; "" where all are possible.

        No standard error is looked at: a value that may be possible by chance should be moved by its error first.

        Args:
            values: of its parameters, by name. model_values: of all parameters of the model, by "effect.parameter".
            signals: of the log. Without them, what depends on units or on the motion isn't asked.
        """
        own = {p.name: p for p in self.parameters(signals.layout)} if signals is not None else {}
        for name, value in values.items():
            found = (
                _looked_up(self.admissible, own[name])
                if name in own
                else self.admissible.get(ParameterId.parse(name).name)
            )
            if found is not None and not found[0] <= value <= found[1]:
                unit = f" {own[name].unit}" if name in own and own[name].unit != "1" else ""
                return f"{name} = {value:.3g}{unit}, possible is {_range(*found)}{unit}"
        return ""

    def meaning(self, values: Mapping[str, float]) -> str:
        """What values of its parameters say that its name doesn't, in words; "" where the name says it."""
        return ""

    def validity_range(self, signals: Signals) -> str:
        """How far its absence reaches, where a log without it says nothing of one elsewhere; "" else."""
        return ""

    def stages(self) -> tuple[Stage, ...]:
        """The stages it acts at: those whose method its class implements."""
        return _stages(type(self))

    # One method a stage. `s` is this prediction's own: arrays in it are replaced, never written into. `p` are the
    # values of the parameters, in their order.
    def geometry(self, s: Signals, p: Array) -> None:
        """Change `s.depth`, `s.depth_rate`, `s.slip`, `s.slip_rate`."""

    def elastic(self, s: Signals, p: Array) -> None:
        """Set or change `s.elastic`, and `s.exponent` where it is a power law."""

    def normal(self, s: Signals, p: Array) -> None:
        """Add to `s.normal`, which begins as `s.elastic`."""

    def friction(self, s: Signals, p: Array) -> None:
        """Change `s.mu`, `s.bristle`, `s.rounding` or `s.tangential`; the chain then adds −μ N along the bristles."""

    def frame(self, s: Signals, p: Array) -> None:
        """Change `s.normal` and `s.tangential` once friction is in them."""

    def tool(self, s: Signals, p: Array) -> None:
        """Add to `s.reading`, the wrench at the sensor's origin."""

    def sensor(self, s: Signals, p: Array) -> None:
        """Change `s.reading` sample by sample."""

    def acquisition(self, s: Signals, p: Array) -> None:
        """Change `s.reading` over time."""

    def joint(self, s: Signals, p: Array) -> None:
        """Add to `s.reading`, the joint torques."""


def _looked_up(by_name: Mapping[str, T], p: Parameter) -> T | None:
    """What a mapping says of a parameter, by "name[unit]" or by its name before the bracket; None if nothing."""
    return by_name.get(f"{p.stem}[{p.unit}]", by_name.get(p.stem))


def _range(low: float, high: float) -> str:
    if low == -math.inf:
        return f"at most {high:g}"
    return f"at least {low:g}" if high == math.inf else f"{low:g} to {high:g}"


@functools.cache
def _stages(kind: type[Effect]) -> tuple[Stage, ...]:
    return tuple(stage for stage in Stage if getattr(kind, stage.value) is not getattr(Effect, stage.value))
