"""The logs of a pooled fit: loaded when they are needed, a bounded number of them kept."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

from kinid.effects._signals import RestForm
from kinid.identification.problem import Problem
from kinid.modeling.experiment import Experiment

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


class Problems:
    """The problem of each log, made anew where it isn't kept: memory is that of `MOST_SAMPLES`, however many logs there
    are.

    Args:
        logs: in order.
    """

    def __init__(self, logs: Sequence[PooledLog]) -> None:
        self.logs = tuple(logs)
        self._kept: OrderedDict[int, Problem] = OrderedDict()

    def __len__(self) -> int:
        return len(self.logs)

    def of(self, number: int, rest: RestForm | None = None) -> Problem:
        """The problem of a log, under a form of friction at rest.

        Raises:
            InputError: a log that can't be read, or that can't carry the model.
        """
        problem = self._kept.pop(number, None)
        if problem is None:
            problem = Problem.build(self.logs[number].load())
            # the draws that count are the problem's own, in means
            problem.whole.__dict__.pop("motion_draws", None)
        if rest is not None and rest != problem.whole.signals.rest:
            problem = problem.with_rest(rest)
        self._kept[number] = problem
        while len(self._kept) > 1 and sum(len(p.whole.signals) for p in self._kept.values()) > MOST_SAMPLES:
            self._kept.popitem(last=False)
        return problem
