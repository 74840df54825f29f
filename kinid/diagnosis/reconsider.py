"""A search that begins anew, where what it found tells of readings that are more open than they were taken to be."""

from __future__ import annotations

import dataclasses

from kinid.diagnosis.descent import State, fit
from kinid.diagnosis.look import weigh
from kinid.diagnosis.problem import Problem
from kinid.diagnosis.search import Trail
from kinid.diagnosis.unexplained import ALLOWED

#: share of the squares that noise carried through what was found must leave at most
TOLD = 0.97
#: … of logs with no more readings than this, in means
LONG = 60_000
#: models that leave less than so many times the least error are about as near
NEAREST = 1.2


def reweighted(state: State, found: Trail) -> State | None:
    """The model as it was asked about, where noise of positions goes through the last model of a search, or the nearest that
    it met (the simplest of those about as near); None where neither tells more of what is left.

    Friction that turns at once makes of a micrometre what a softer reversal would never show; a law may pull elsewhere.
    """
    if state.problem.experiment.layout.kind == "joints" or len(state.residual) > LONG:
        return None  # no noise of positions is carried; or it would take too long
    last = found.last
    met = (last, *(t.state for look in found.rounds for t in look.tried))
    near = NEAREST * min(s.rms for s in met)
    nearest = min((s for s in met if s.rms <= near), key=lambda s: (len(s.values), s.rms))
    # through what was asked about, noise was carried already
    for through in (s for s in dict.fromkeys((last, nearest)) if s.model is not state.model):
        carried = Problem.build(state.problem.experiment, through.model, through.plain.light().values)
        less = through.residual * (state.problem.sigma / carried.sigma)[:, carried.valid].ravel()
        if float(less @ less) < TOLD * float(through.residual @ through.residual) and not _stands(found, nearest, carried):
            return fit(carried, state.model, state.values, shift=state.shift)
    return None


def _stands(found: Trail, nearest: State, problem: Problem) -> bool:
    """Whether what was found needs no other look under a problem's weights: it explains all, and each step to it counts."""
    def weighed(state: State) -> State:
        ratio = (state.problem.sigma / problem.sigma)[:, problem.valid].ravel()
        out = dataclasses.replace(state, problem=problem, residual=state.residual * ratio)
        out.__dict__["held"] = state.held * ratio
        return out

    if weighed(found.last).rms >= ALLOWED:  # seen without the work of a conclusion
        return False
    path = [weighed(s) for s in found.end.states]
    steps = [*zip(path, path[1:]), *([(weighed(nearest), path[-1])] if nearest is not found.end.states[-1] else [])]
    return path[-1].rms < ALLOWED and all(weigh(before, after).sure for before, after in steps)
