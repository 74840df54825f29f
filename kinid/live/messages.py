"""What a source hands over: joint samples, wrench samples, notices of its own, and starts of a recorded session."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, NamedTuple, Protocol, TypeAlias

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    Numbers: TypeAlias = Sequence[float] | NDArray[np.float64]


class Joints(NamedTuple):
    """One sample of the joints.

    Attributes:
        received: when it came, by the clock of who receives [ns].
        stamp: when it was measured, by the sender's clock [ns]; None where the sender says nothing.
        q: positions [rad or m]; dq [rad/s], tau [N·m] of the same length, or empty.
        names: of the joints, in that order; None where they come in the rig's order.
    """

    received: int
    stamp: int | None
    q: Numbers
    dq: Numbers = ()
    tau: Numbers = ()
    names: tuple[str, ...] | None = None


class Wrench(NamedTuple):
    """One sample of the sensor: fx fy fz tx ty tz in sensor axes [N, N·m]; times as in `Joints`."""

    received: int
    stamp: int | None
    wrench: Numbers


class Notice(NamedTuple):
    """Something that a source has to say of itself: the kind of event, and a sentence; missing: messages that by their
    running numbers never came before the next one.
    """

    received: int
    kind: str
    says: str
    missing: int = 0


class Start(NamedTuple):
    """What the estimators of a recorded session started from as something was touched.

    Attributes:
        received: as in `Joints`. stamp: of the sample at which they did, on the continuous clock [ns].
        values: by the names of the parameters.
    """

    received: int
    stamp: int
    values: Mapping[str, float]


#: what is no sample, for `isinstance` at each item: a union would be made anew every time
NO_SAMPLE = (Notice, Start)

#: None: nothing came for a while; whoever waits can look at the clock
Item: TypeAlias = Joints | Wrench | Notice | Start | None


class Source(Protocol):
    """A stream of samples: a file, a socket, a laboratory.

    Attributes:
        name: for people.
        live: whether samples are received by this machine's monotonic clock, so that silence can be measured by it.
    """

    name: str
    live: bool

    def items(self) -> Iterator[Item]:
        """Everything in the order in which it comes, until the source ends; it never raises on what a sender sent."""

    def close(self) -> None:
        """Give back what is held."""
