"""How much work a search may do, so that an answer takes seconds whatever a log holds.

Counted in predictions, not in seconds: the same log gives the same answer on every machine.
"""

from __future__ import annotations

import numpy as np

from kinid.diagnosis.problem import Problem
from kinid.effects import Stage
from kinid.model import Model

#: predictions that a search may ask for: of the logs of a minute that it was tried on, less than one in ten asks for more
PREDICTIONS = 2300.0
#: … and so many more of a search that begins anew, beside what the first one left
AGAIN = 300.0
#: … and to look at rivals of what was found
RIVALS = 200.0
#: … of which the first look at the whole catalogue takes about
SCREENING = 100.0
#: … and a refit so many
REFITTING = 60.0
#: behind an arm that gives way a prediction takes as long as so many others, and as so many for each effect beside its base law
BEHIND, OF_LAW = 2.5, 4.0
#: … and so many times as long where a coarse converter's stairs are rounded to on its way into the band that counts
STAIRS = 12.0
#: of a log with fewer means than this, all channels together, a prediction counts for that share of one, and for this at least
WHOLE, SMALLEST = 20_000, 0.2


def weight_of(model: Model, problem: Problem) -> float:
    """What a prediction of a model counts."""
    experiment = problem.experiment
    weight = float(np.clip(problem.sigma.size / WHOLE, SMALLEST, 1.0))
    if experiment.steps is not None and experiment.band is not None:
        weight *= STAIRS
    if "structural-compliance" in model:
        law = sum(bool({Stage.ELASTIC, Stage.NORMAL} & set(effect.stages())) for effect in model.effects)
        weight *= BEHIND + OF_LAW * (law - 1)
    return weight


class Effort:
    """What is left of it.

    Args:
        most: predictions. times: so many times as many, of all that is spoken of here.

    Attributes:
        left: as many. short: whether more was asked for than there was.
    """

    def __init__(self, most: float = PREDICTIONS, times: float = 1.0) -> None:
        self._times = times
        self.left, self.short = times * most, False

    def spend(self, predictions: float) -> None:
        """Take so many off."""
        self.left -= predictions

    def allow(self, predictions: float) -> None:
        """Have so many left at least."""
        self.left = max(self.left, self._times * predictions)

    def once_more(self) -> Effort:
        """Of a search that begins anew: what is left, and a little more."""
        out = Effort(AGAIN, self._times)
        out.left += max(self.left, 0.0)
        return out

    def lasts(self, predictions: float = 0.0) -> bool:
        """Whether there is any left for what is asked for now, and as many as that."""
        enough = self.left > predictions
        self.short = self.short or not enough
        return enough
