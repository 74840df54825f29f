"""The logs of a pooled fit: loaded when they are needed, a bounded number of them kept."""

from __future__ import annotations

import secrets
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Protocol, TypeVar

from kinid.effects._signals import RestForm
from kinid.identification.problem import Problem
from kinid.modeling.experiment import Experiment
from kinid.modeling.model import Model

if TYPE_CHECKING:
    from kinid.identification.pooling.search import Begun

In = TypeVar("In")
Out = TypeVar("Out")

#: samples of logs that are kept in memory at a time; a sample takes about a kilobyte
MOST_SAMPLES = 400_000


@dataclass(frozen=True, eq=False)
class PooledLog:
    """One log of several.

    Attributes:
        name: that results call it by. load: reads it, at its own rate, and refuses what can't carry the model.
        rig: name of what it was measured with; logs of one rig share what its calibration leaves open.
        groups: column → value of this log (day, robot, tool, operator …).
    """

    name: str
    load: Callable[[], Experiment] = field(repr=False)
    rig: str = ""
    groups: Mapping[str, str] = field(default_factory=dict)


class Elsewhere(Protocol):
    """Where logs are worked at, if not here: in other processes, or on other machines."""

    def run(self, do: Callable[[In], Out], items: Sequence[In]) -> list[Out]:
        """Results for all items, in their order; `do` is a function of a module."""

    def begun(self, model: Model, logs: Sequence[PooledLog], progress: Callable[[str], None]) -> list[Begun | str]:
        """Each log fitted by itself, or why it can't be (`search.begin_one`); progress is told in words."""


class Problems:
    """The problem of each log, made anew where it isn't kept: memory is that of `MOST_SAMPLES`, however many logs there
    are.

    Args:
        logs: in order. elsewhere: where they are worked at; default: here.
    """

    def __init__(self, logs: Sequence[PooledLog], elsewhere: Elsewhere | None = None) -> None:
        self.logs, self.elsewhere = tuple(logs), elsewhere
        self._kept = _Kept()
        self._token = secrets.token_hex(8)

    def __len__(self) -> int:
        return len(self.logs)

    def of(self, number: int, rest: RestForm | None = None) -> Problem:
        """The problem of a log, under a form of friction at rest.

        Raises:
            InputError: a log that can't be read, or that can't carry the model.
        """
        return self._kept.of(number, self.logs[number], rest)

    def each(self, do: Callable[..., Out], given: Sequence[tuple[Any, ...]], rests: Sequence[RestForm]) -> list[Out]:
        """`do(problem, …)` of every log, in order, wherever that is worked out.

        Args:
            do: a function of a module. given: what it takes beside the problem, of each log. rests: form of friction at
                rest of each.
        """
        if self.elsewhere is None:
            return [do(self.of(i, rest), *more) for i, (rest, more) in enumerate(zip(rests, given))]
        tasks = [((self._token, i), log, rests[i], do, given[i]) for i, log in enumerate(self.logs)]
        return self.elsewhere.run(_there, tasks)


class _Kept:
    """Problems that are kept, those of `MOST_SAMPLES` at most: the first ones and the last one.

    Logs are visited in turn, again and again: were it the last ones, each would be gone when it is wanted.
    """

    def __init__(self) -> None:
        self._problems: dict[int, Problem] = {}
        self._owner = ""

    def of(self, number: int, log: PooledLog, rest: RestForm | None, owner: str = "") -> Problem:
        if owner != self._owner:
            self._problems, self._owner = {}, owner
        problem = self._problems.get(number)
        if problem is None:
            problem = Problem.build(log.load())
        if rest is not None and rest != problem.whole.signals.rest:
            problem = problem.with_rest(rest)
        self._problems[number] = problem
        while len(self._problems) > 1 and sum(len(p.whole.signals) for p in self._problems.values()) > MOST_SAMPLES:
            del self._problems[next(key for key in reversed(self._problems) if key != number)]
        return problem


#: of the logs that this process works at for another one
_HERE = _Kept()


def _there(task: tuple[tuple[str, int], PooledLog, RestForm, Callable[..., Out], tuple[Any, ...]]) -> Out:
    """What one log says, worked out where its problem may still be kept."""
    (owner, number), log, rest, do, more = task
    return do(_HERE.of(number, log, rest, owner), *more)
