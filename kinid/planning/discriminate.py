"""The experiment that tells candidate effects apart: what one predicts and the other, refitted, can't imitate.

For every ordered pair (a, b) of candidates, a plausible amount of a changes the readings; the model with b takes up
what it can of that change with all of its parameters and with what calibration leaves open (linearised least squares).
What is left, in squared standard deviations of the noise, is the discrimination power of T-optimal design (Atkinson &
Fedorov, Biometrika 62, 1975), summed over the readings. It counts no further than a itself would be believed: what it
does to a model with neither, less what lies so unevenly in time that chance explains it (`kinid.planning.distances`).
The experiment is chosen whose worst pair, at its worst shape, is best.
"""

from __future__ import annotations

import dataclasses
import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from threadpoolctl import threadpool_limits

from kinid.effects import Effect, Layout, Signals, Stage
from kinid.errors import InputError
from kinid.identification.nuisance import nuisances, predict_with
from kinid.identification.problem import MEAN_RATE
from kinid.modeling.applicability import base_of, candidate_effects
from kinid.modeling.experiment import Experiment
from kinid.modeling.model import Model
from kinid.modeling.parameter_names import assumed_values
from kinid.planning.discrimination import SURE, Discrimination, Pair, Verdict, why_separable
from kinid.planning.distances import cells, even, left, rest, where
from kinid.planning.expected import expected_law
from kinid.planning.experiments import Bench, Proposal, proposals
from kinid.planning.forms import Form, candidates, forms, refit_directions
from kinid.planning.free_motion import TORQUE_NOISE, WRENCH_NOISE
from kinid.planning.information import sensitivities
from kinid.planning.planner import Planner
from kinid.planning.touches import Place
from kinid.planning.trajectory import Trajectory

Array = NDArray[np.float64]

#: samples a second that experiments are judged at
DESIGN_RATE = 100.0
#: squared distance below which two candidates are one and the same
HOPELESS = 1e-2
#: share of a reading that no law is trusted to better than
RELATIVE = 2e-3
#: share of a guard's force that slow pressing may reach
PRESSED = 0.8


@dataclass(frozen=True, eq=False)
class Judge:
    """Compares experiments for one model and its candidates.

    Attributes:
        bench: what plans them. model: without the candidates. values: assumed, by full name; others nominal.
        effects: candidates, two or more. rate: of the log [Hz]. forms: of each that count as plausible; see `ready`.
    """

    bench: Bench
    model: Model
    values: Mapping[str, float]
    effects: tuple[Effect, ...]
    rate: float = 500.0
    forms: dict[str, list[Form]] = field(default_factory=dict)

    @cached_property
    def pairs(self) -> list[Pair]:
        """Ordered pairs of candidates."""
        return list(itertools.permutations([effect.id for effect in self.effects], 2))

    def ready(self, experiments: Sequence[Experiment]) -> None:
        """Lay down which forms of each candidate are plausible in any of these experiments; the same for all.

        Raises:
            InputError: a candidate that can't act there, and why.
        """
        why = {effect.id: reason for effect, reason in candidate_effects(self.model, experiments[0].layout)}
        for effect in self.effects:
            if why.get(effect.id):
                raise InputError(
                    f"'{effect.id}' for {self.model}: {why[effect.id]}",
                    "one that acts on these readings",
                    "choose another candidate, or another model",
                )
            self.forms[effect.id] = forms(effect, [e.signals for e in experiments], base_of(self.model))
            if not self.forms[effect.id]:
                raise InputError(
                    f"effect '{effect.id}', which can't be made small",
                    "effects that change readings by degrees",
                    "choose another candidate",
                )

    def __call__(
        self, proposal: Proposal, experiment: Experiment, duration: float, touch: NDArray[np.int64] | None
    ) -> Verdict:
        """How well an experiment tells."""
        s, model = experiment.signals, self.model
        named = model.parameters(s.layout)
        values = np.array([self.values.get(name, p.nominal) for name, p in named.items()])
        predicted = model.predict(s, values)
        # diagnosis works with means at a rate of its own, and trusts no law to better than a share of the reading
        noise = self._noise(experiment.layout)[:, None]
        per_second = min(MEAN_RATE, self.rate)
        weight = np.sqrt(per_second / DESIGN_RATE / (noise**2 * per_second / self.rate + (RELATIVE * predicted) ** 2))

        def stack(readings: Array) -> Array:
            out: Array = (readings * weight).ravel()
            return out

        columns: list[Array] = []
        if named:
            found = sensitivities(lambda v: model.predict(s, v), values, named) * weight[:, :, None]
            columns += list(found.reshape(-1, len(values)).T)
        free = len(columns)
        columns += [stack(change) for change in _tolerances(model, values, s, predicted, {e.id for e in self.effects})]
        tolerated = slice(free, len(columns))
        common = list(range(len(columns)))

        def change(effect: Effect, own: Array) -> Array:
            larger = model + effect
            before = larger.place(effect.id, s.layout).start
            return stack(larger.predict(s, np.insert(values, before, own)) - predicted)

        places: dict[str, list[int]] = {}
        rivals: dict[str, list[list[int]]] = {}
        for effect in self.effects:
            first = len(columns)
            columns += [change(effect, form.values) for form in self.forms[effect.id]]
            places[effect.id] = list(range(first, len(columns)))
            rivals[effect.id] = []
            for group in refit_directions(effect, s, base_of(model)):
                first = len(columns)
                columns += [change(effect, a) - change(effect, b) for a, b in group]
                rivals[effect.id].append(list(range(first, len(columns))))
        x = np.stack(columns).T  # each column contiguous
        x[~np.isfinite(x)] = 0.0
        gram = x.T @ x
        prior = np.zeros(len(columns))
        prior[tolerated] = 1.0
        named_cells = cells(experiment, touch)
        distances: dict[Pair, Array] = {}
        lies: dict[Pair, list[tuple[str, str, float]]] = {}
        believed = {name: self._believed(x, gram, prior, common, own, s) for name, own in places.items()}
        for a, b in self.pairs:
            each = [left(gram, prior, common + group, places[a]) for group in rivals[b]]
            found = np.array([distance for distance, _ in each])
            best = np.argmin(found, axis=0)  # the rival's own best shape
            distances[a, b] = np.minimum(found.min(axis=0), believed[a])
            lies[a, b] = []
            for k, column in enumerate(places[a]):
                squares = rest(x, column, common + rivals[b][best[k]], each[best[k]][1][:, k], predicted.shape) ** 2
                lies[a, b].append(where(squares, *named_cells, s.layout.channels))
        return Verdict(proposal, duration, distances, lies)

    @staticmethod
    def _believed(x: Array, gram: Array, prior: Array, common: list[int], own: list[int], s: Signals) -> Array:
        """Squared distance of each form of an effect (forms,) from the model with no candidate, as far as it is
        believed.
        """
        distance, taken = left(gram, prior, common, own)
        share = [even(rest(x, column, common, taken[:, k], (-1, len(s))) ** 2, s.t) for k, column in enumerate(own)]
        out: Array = distance * np.array(share)
        return out

    def verdict(self, proposal: Proposal) -> Verdict:
        """Plan and judge; collisions are left for the chosen one.

        Raises:
            InputError: what the robot can't do.
        """
        motion = self.bench.trajectory(proposal, DESIGN_RATE, collisions=False)
        return self(proposal, self.bench.experiment(proposal, motion), motion.duration, motion.touch)

    def _noise(self, layout: Layout) -> Array:
        if layout.kind == "joints":
            return np.full(len(layout.channels), TORQUE_NOISE)
        stated = self.bench.planner.rig.sensor.noise
        out: Array = np.maximum(WRENCH_NOISE if stated is None else np.asarray(stated), 1e-9)
        return out


@dataclass(frozen=True, eq=False)
class Ranking:
    """Experiments compared.

    Attributes:
        judge: what compared them. verdicts: the best first. kept: forms that count; see `counting`.
        refused: experiments that the robot can't do, and why.
    """

    judge: Judge
    verdicts: tuple[Verdict, ...]
    kept: dict[Pair, NDArray[np.bool_]]
    refused: dict[str, InputError]


def criterion(verdict: Verdict, kept: Mapping[Pair, NDArray[np.bool_]]) -> float:
    """The squared distance of the worst pair, at the worst of its forms that count."""
    return min(float(distances[kept[pair]].min()) for pair, distances in verdict.distances.items() if kept[pair].any())


def counting(verdicts: Sequence[Verdict]) -> dict[Pair, NDArray[np.bool_]]:
    """Which forms count: those that some experiment tells; where none does for a pair, those that come nearest to it.

    An effect that its rival can imitate, such as a special case of it, is told from it by no experiment, and needn't
    be: of two that explain a log equally well the one with fewer parameters is named. What counts then are the rival's
    own forms.
    """
    best = {pair: np.max([verdict.distances[pair] for verdict in verdicts], axis=0) for pair in verdicts[0].distances}
    separable = {pair: float(each.max()) >= HOPELESS for pair, each in best.items()}
    least = {pair: min(SURE, 0.5 * float(each.max())) for pair, each in best.items()}
    kept = {
        (a, b): each >= least[a, b] if separable[a, b] or not separable[b, a] else np.zeros(len(each), np.bool_)
        for (a, b), each in best.items()
    }
    if not any(separable.values()) or max(criterion(verdict, kept) for verdict in verdicts) >= HOPELESS:
        return kept
    # places that no one path visits, for instance: what is told by the experiment that tells most
    seen = [
        {pair: kept[pair] & (each >= least[pair]) for pair, each in verdict.distances.items()} for verdict in verdicts
    ]
    return max(seen, key=lambda each: sum(int(forms.sum()) for forms in each.values()))


def judge_for(
    planner: Planner, model: Model, values: Mapping[str, float], names: Sequence[str], *, bandwidth: float = 3.0
) -> Judge:
    """What compares experiments for these candidates.

    Raises:
        InputError: unknown candidates, or such as no experiment has to tell apart.
    """
    chosen = tuple(candidates(model, names))
    law = expected_law(model, dict(values))
    joints = "joints" in model.needs or (law is None and all(Stage.JOINT in effect.stages() for effect in chosen))
    planner = Planner(planner.rig, planner.protocol, None if joints else law, planner.limits)
    return Judge(Bench(planner, joints, bandwidth), model, dict(values), chosen, planner.protocol.rate)


def rank(
    planner: Planner,
    model: Model,
    names: Sequence[str],
    values: Mapping[str, float] | None = None,
    *,
    duration: float = 20.0,
    depth: float = 0.004,
    place: Place = (0.0, 0.0),
    bandwidth: float = 3.0,
) -> Ranking:
    """All experiments on the list, the best first; arguments and errors as of `discriminate`."""
    judge = judge_for(planner, model, values or {}, names, bandwidth=bandwidth)
    bench = judge.bench
    contact = bench.planner.law is not None and not bench.joints
    if contact:
        _ = bench.planner.surface  # says what is missing
        depth = _gentle(bench.planner, depth)
    refused: dict[str, InputError] = {}
    planned: list[tuple[Proposal, Trajectory, Experiment]] = []
    for proposal in proposals(duration, depth, place, contact=contact, bandwidth=bandwidth):
        try:
            motion = bench.trajectory(proposal, DESIGN_RATE, collisions=False)
        except InputError as error:
            refused[proposal.name] = error
            continue
        planned.append((proposal, motion, bench.experiment(proposal, motion)))
    if not planned:
        raise _none(refused)
    judge = dataclasses.replace(judge, values=assumed_values(model, judge.values, planned[0][2].layout))
    judge.ready([experiment for _, _, experiment in planned])
    with threadpool_limits(1, user_api="blas"):  # products of a few columns: threads would only wait for each other
        verdicts = [judge(proposal, each, motion.duration, motion.touch) for proposal, motion, each in planned]
    kept = counting(verdicts)
    verdicts.sort(key=lambda verdict: -criterion(verdict, kept))
    return Ranking(judge, tuple(verdicts), kept, refused)


def discriminate(
    planner: Planner,
    model: Model,
    names: Sequence[str],
    values: Mapping[str, float] | None = None,
    *,
    duration: float = 20.0,
    depth: float = 0.004,
    place: Place = (0.0, 0.0),
    bandwidth: float = 3.0,
) -> Discrimination:
    """The experiment that tells candidate effects apart best, as a trajectory of the robot.

    Args:
        planner: with rig and protocol. model: what is believed so far, without the candidates. names: of candidates.
        values: of the model's parameters; others nominal. duration: of the experiment, about [s].
        depth: the deepest that it goes [m], less where the guard's force forbids it. place: along both tangents [m].
        bandwidth: in which the robot follows [Hz].

    Raises:
        InputError: candidates that are unknown, in the model already, that act on different readings, or that nothing
            tells apart; no experiment that the robot can do.
    """
    ranking = rank(planner, model, names, values, duration=duration, depth=depth, place=place, bandwidth=bandwidth)
    judge, kept, refused = ranking.judge, ranking.kept, dict(ranking.refused)
    if criterion(ranking.verdicts[0], kept) < HOPELESS:
        if refused and not any(v.proposal.touches for v in ranking.verdicts):  # what touches might have told
            raise _none(refused)
        raise InputError(
            f"{' and '.join(names)}, which no experiment on the list tells apart for {model}",
            "effects of which one can't imitate the other",
            "learn one of them by other means: a calibration, a scale",
        )
    for verdict in ranking.verdicts:
        try:
            protocol = planner.protocol
            motion = judge.bench.trajectory(verdict.proposal, protocol.rate, collisions=protocol.collisions)
        except InputError as error:
            refused[verdict.proposal.name] = error
            continue
        break
    else:
        raise _none(refused)
    table = tuple(
        (v.proposal.name, v.proposal.title, v.duration, criterion(v, kept))
        for v in ranking.verdicts
        if v.proposal.name not in refused
    )
    lost = {
        f"{form.described()} from {b}": None
        for (a, b), seen in kept.items()
        if seen.any()
        for form, ok in zip(judge.forms[a], seen)
        if not ok
    }
    left_out = {name: f"{why.found}; to mend it, {why.mend}" for name, why in refused.items()}
    found = Discrimination(
        tuple(e.id for e in judge.effects),
        verdict.proposal,
        motion,
        criterion(verdict, kept),
        why_separable(judge.effects, judge.forms, verdict, kept),
        table,
        left_out,
        tuple(lost),
    )
    facts = {**motion.provenance, "discrimination": found.to_dict()}
    return dataclasses.replace(found, trajectory=dataclasses.replace(motion, provenance=facts))


def _gentle(planner: Planner, depth: float) -> float:
    """The depth, or less: where slow pressing keeps to most of the guard's force, so that there is room for fast
    motion.
    """
    guard, law = planner.protocol.guard, planner.law
    if guard is None or law is None:
        return depth
    down, t = np.linspace(0.0, depth, 201), np.linspace(0.0, 20.0, 201)
    force = np.maximum.accumulate(law(law.signals(t, down, np.full(201, depth / 20.0)))[2])
    return float(down[max(int(np.searchsorted(force, PRESSED * guard.force, side="right")) - 1, 1)])


def _none(refused: Mapping[str, InputError]) -> InputError:
    why = next(iter(refused.values()))
    return InputError(f"no experiment that the robot can do: {why.found}", why.expected, why.mend)


def _tolerances(model: Model, values: Array, s: Signals, predicted: Array, candidates: set[str]) -> list[Array]:
    """Changes of the readings per tolerance of surface, clock and bias: as diagnosis trusts calibration, prior N(0, 1).

    What is itself a candidate isn't tolerated as well: it would have to be told from itself.
    """
    here = model.course(s, values)
    return [
        predict_with(nuisance, model, values, s, here) - predicted
        for nuisance in nuisances(model, s)
        if nuisance.effect.id not in candidates
    ]
