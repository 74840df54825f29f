"""Which effects a model could gain, and how much of its residual each would explain: the cheap look at the whole catalogue."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from kinid import effects as catalogue
from kinid.diagnosis.calibration import MOST_SHIFT
from kinid.diagnosis.descent import LOOSE, State
from kinid.diagnosis.together import together
from kinid.effects import Effect, Layout, Signals
from kinid.model import Model

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Candidate:
    """One effect, at the best of the shapes it was tried at.

    Attributes:
        effect: the one.
        gain: what it would take off the weighted sum of squares, in the linear view. rank: parameters it would add.
        start: values of model + effect to search from, shift: of calibration there; origin: values at which it is the model
            without the effect, with the same shapes. place: of its first parameter among all.
        small: whether each amplitude was moved by no more than its scale.
        columns: sensitivity to its own parameters there, (m, k), in their scales; None where nobody will search from here.
        sensitivity: length of the weighted readings' change per unit of each amplitude (by index among its parameters),
            beyond what the model can take up itself.
    """

    effect: Effect
    gain: float
    rank: int
    start: Array
    shift: Array
    place: int
    small: bool
    columns: NDArray[np.float32] | None
    sensitivity: dict[int, float]
    origin: Array

    def guess(self, state: State) -> Array | None:
        """Sensitivity to begin a search with, (m, p), in scales."""
        if self.columns is None:
            return None
        p, k = len(state.values), self.columns.shape[1]
        out = np.empty((len(state.residual), p + k), order="F")
        out[:, : self.place], out[:, self.place + k :] = state.jacobian[:, : self.place], state.jacobian[:, self.place : p]
        out[:, self.place : self.place + k] = self.columns
        return out


#: so many points of an effect are searched from, at most
SEARCHED = 2
#: and only from such as explain this share of what the best one does
NEAR = 0.5
#: of joint torques these are one and the same
SAME = {"sensor-bias": "joint-torque-offset"}


def base_of(model: Model) -> str | None:
    """Name of its base law, or None."""
    return next((effect.id for effect in model.effects if effect.base), None)


def able(model: Model, layout: Layout) -> Iterator[tuple[Effect, str]]:
    """Every effect that isn't a base and isn't in the model, with why it can't act in this log ("" where it can)."""
    base = base_of(model)
    for name in catalogue.catalogue():
        effect = catalogue.get(name)
        if effect.base or name in model:
            continue
        yield effect, _why_not(effect, model, base, layout)


def _why_not(effect: Effect, model: Model, base: str | None, layout: Layout) -> str:
    """Why an effect can't act in this log, "" where it can: the first that holds."""
    stages = {stage.value for stage in effect.stages()}
    reading = bool(stages & {"tool", "sensor", "acquisition"})
    torques = layout.kind == "joints"
    slides = any(channel.startswith("tangential") for channel in layout.channels)
    foreign = "joint" not in stages and (not reading or "tool" in stages or "wrench" in effect.needs)
    wanted = " or ".join(effect.wants)
    reasons = (
        (torques and foreign, "it acts on contact forces, and this model is of joint torques"),
        (not torques and "joint" in stages, "it acts on joint torques, and this model is of contact forces"),
        (torques and effect.id in SAME, f"of joint torques it is {SAME.get(effect.id, '')}"),
        (layout.kind == "contact" and "wrench" in effect.needs,
         "it acts on the whole wrench: record joints and the six channels of the sensor"),
        (layout.kind == "contact" and not slides and stages <= {"friction"}, "no tangential force was recorded"),
        (not torques and "normal" in effect.needs and base is None, "it acts on contact, and the model has no contact law"),
        (bool(effect.wants) and not any(name in model for name in effect.wants), f"it acts on {wanted}, which the model lacks"),
        (not effect.parameters(layout), "this log lacks the channels that it acts on"),
    )
    return next((why for holds, why in reasons if holds), "")


def amplitudes(effect: Effect, layout: Layout, base: str | None) -> dict[int, float]:
    """Which of its parameters make it vanish, with the value at which they do: index → null."""
    null = effect.null_for(base)
    out = {}
    for i, p in enumerate(effect.parameters(layout)):
        key = p.name if p.name in null else p.name.split("[")[0]
        if key in null:
            out[i] = null[key]
    return out


def tried(effect: Effect, signals: Signals, amplitude: dict[int, float]) -> Iterator[tuple[Array, list[int]]]:
    """Points to look at: values of all its parameters, and which amplitudes are away from null there, each alone.

    Shapes come from what the effect calls worth starting from in this log. An amplitude that has a grid of its own (a delay, an
    exponent) changes readings differently when it is large; it is looked at point by point.
    """
    parameters = effect.parameters(signals.layout)
    null = np.array([amplitude.get(i, p.nominal) for i, p in enumerate(parameters)])
    own = [i for i in amplitude if parameters[i].name in effect.grid]
    seen = set()
    for point in effect.starts(signals) or (null,):
        at = null.copy()
        for i in range(len(at)):
            if i not in amplitude or i in own:
                at[i] = point[i]
        moving = [i for i in own if at[i] != null[i]] if own else list(amplitude)
        key = tuple(at)
        if moving and key not in seen:
            seen.add(key)
            yield at, moving
    if own:  # and a small step of each
        yield null, list(amplitude)


def screen(state: State, effect: Effect) -> list[Candidate]:
    """How much of the residual this effect could explain, at each point of its grid; the best first.

    Its change of the readings is simulated, freed of what the model's own parameters and the tolerances can take up, and
    projected on the residual (a score test at finite steps).
    """
    problem, model = state.problem, state.model
    layout = problem.experiment.layout
    base = base_of(model)
    parameters = effect.parameters(layout)
    amplitude = amplitudes(effect, layout, base)
    larger = model + effect
    place = list(larger.names).index(effect.id)
    before = sum(len(e.parameters(layout)) for e in larger.effects[:place])
    signals, predicted = state.signals(), state.course.reading
    beside = state.standing(predicted)
    out: list[Candidate] = []
    for at, moving in tried(effect, problem.experiment.signals, amplitude):
        null = np.array([amplitude[i] for i in moving])
        steps = at[moving] - null
        scale = np.array([parameters[i].scale for i in moving])
        steps = np.where(steps != 0.0, steps, np.where(null + scale <= [parameters[i].high for i in moving], scale, -scale))
        d = np.zeros((len(state.residual), len(moving)), order="F")
        for group in together([(j, parameters[i].name) for j, i in enumerate(moving)], layout):
            values, these = at.copy(), list(group.values())
            values[moving] = null
            values[[moving[j] for j in these]] += steps[these]
            full = np.insert(state.values, before, values)
            moved = problem.predict(larger, full, signals, state.course)
            problem.changed_apart(moved, predicted, beside, group, np.ones(len(moving)), d)
        if not np.isfinite(d).all():
            continue
        dj = state.jacobian.T @ d
        own = d.T @ d
        gram = own - dj.T @ state.inverse @ dj
        slope = d.T @ state.residual - dj.T @ state.promised  # what the model's own parameters promise is no effect's
        size = np.sqrt(np.maximum(np.diag(gram), 0.0))
        h = gram + np.diag(1e-7 * np.diag(own) + LOOSE)
        coefficient = np.linalg.solve(h, slope)
        start = at.copy()
        for i, step, c in zip(moving, steps, coefficient):
            start[i] = float(np.clip(amplitude[i] + c * step, parameters[i].low, parameters[i].high))
        # an amplitude that its bound holds explains nothing
        used = np.array([(start[i] - amplitude[i]) / step for i, step in zip(moving, steps)])
        gain = float(2 * slope @ used - used @ gram @ used)
        taken = state.promised - state.inverse @ (dj @ used)
        p = len(state.values)
        theta = state.values + taken[:p] * state.scale
        shift = np.clip(state.shift + taken[p:], -MOST_SHIFT, MOST_SHIFT)
        own_columns = None
        if sum(c.gain > gain for c in out) < SEARCHED:
            # its own sensitivity to begin with, in scales of its parameters (nothing for shapes)
            own_columns = np.zeros((len(d), len(parameters)), np.float32)  # a first guess: half the memory is exact enough
            own_columns[:, moving] = d * (np.array([parameters[i].scale for i in moving]) / steps)
        small = all(abs(step) <= parameters[i].scale for i, step in zip(moving, steps)) or not effect.grid.keys() & {
            parameters[i].name for i in amplitude}
        out.append(Candidate(effect, gain, len(parameters), np.insert(theta, before, start), shift, before, small, own_columns,
                             {i: float(z / abs(step)) for i, z, step in zip(moving, size, steps)},
                             np.insert(state.values, before, [amplitude.get(i, v) for i, v in enumerate(at)])))  # fmt: skip
    out.sort(key=lambda c: -c.gain)
    return [c if i < SEARCHED and c.gain >= NEAR * out[0].gain else dataclasses.replace(c, columns=None)
            for i, c in enumerate(out)]  # fmt: skip
