"""An effect at work, declared in its own file: what the contract of all effects is checked on."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from enum import Enum

from kinid.effects._signals import Signals


class Motion(Enum):
    """Reference motions that examples name; `kinid.modeling.reference_motions` makes them."""

    POKES = "pokes"  # several depths and speeds, with holds, partial unloading and slides, in the contact frame
    WAVES = "waves"  # smooth pokes and slides that never rest, in the contact frame
    WRENCH = "wrench"  # the same with a heavy tool, turned and shaken in all directions: all six channels
    ARM = "arm"  # two links in a vertical plane that carry a payload: joint torques
    DRIVE = "drive"  # one axis that slides, without a robot: its force


@dataclass(frozen=True)
class Example:
    """One effect at work: a model that it lives in, true values, and a motion that excites it.

    Attributes:
        beside: names of the model's other effects.
        values: true values, others are nominal. Of the effect's own parameters by their name, or by the name before the
            bracket for all of that name, one after the other; of other effects' by "effect.parameter".
        motion: a reference motion, or a function that gives signals.
        form: fields of the effect that only a log tells, for an effect that has such.
    """

    beside: tuple[str, ...]
    values: Mapping[str, float | tuple[float, ...]]
    motion: Motion | Callable[[], Signals] = Motion.POKES
    form: Mapping[str, object] = field(default_factory=dict)
