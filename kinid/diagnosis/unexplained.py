"""Whether something is missing that the catalogue does not hold, and where.

Two detectors, neither of which ever joins a model. A flexible regression of the residual on the state of motion, learnt on
one half of the log and tried on the other, finds what follows depth, speed, force, place or time in any form. What follows
nothing of the kind (a push by a person, ringing after an impact, slip-stick) shows as residual that is larger than its noise
for a while, or whose neighbours are alike.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from kinid.diagnosis.descent import State

Array = NDArray[np.float64]

#: weighted residual that noise and what was stated of calibration may leave
ALLOWED = 1.14
#: the same of readings that are stairs: few of them tell, and what they leave scatters by a tenth
ALLOWED_OF_STAIRS = 1.35
#: share of what a model failed to explain at first that an effect of another form may leave
FORM = 0.25
#: … but no more than this, in all
MOST_FORGIVEN = 2.5
#: from this multiple of the noise on, an effect that explains the rest is said to have another form than the catalogue's
OTHER_FORM = 1.4
#: share of the residual that a flexible regression may predict
PREDICTABLE = 0.08
#: features of the flexible regression
FEATURES = 160


@dataclass(frozen=True)
class Leftover:
    """What is left in a residual.

    Attributes:
        rms: of the weighted residual held out; 1 is noise alone.
        predictable: share of its variance that the flexible regression predicts where it has not seen it.
        slow: variance of means over eight neighbours, in units of what white noise of the same size has.
        bursts: share of the squared residual in blocks that hold more than twice their share of it, beyond what chance does.
        channel: where most of it is.
    """

    rms: float
    predictable: float
    slow: float
    bursts: float
    channel: str


def leftover(state: State) -> Leftover:
    """Measure what a fitted model leaves."""
    problem = state.problem
    channels = problem.experiment.layout.channels
    rows = state.held.reshape(len(channels), -1)
    guess = _flexible(state, rows)
    power = np.mean(rows**2, axis=1)
    gained = power - np.mean((rows - guess) ** 2, axis=1)
    predictable = float(gained.sum() / power.sum())
    k = 8
    n = rows.shape[1] // k * k
    means = rows[:, :n].reshape(len(rows), -1, k).mean(axis=2)
    slow = float(np.mean(k * means**2) / np.mean(rows**2))
    number = np.unique(problem.block[problem.valid], return_inverse=True)[1]
    size = np.bincount(number).astype(float)
    per = np.stack([np.bincount(number, row**2) / size for row in rows])
    middle = np.median(per, axis=1, keepdims=True)
    over = np.maximum(0.0, per - middle * (1.0 + 5.0 * np.sqrt(2.0 / size)))
    bursts = float((over * size).sum() / max(1e-12, (per * size).sum()))
    excess = power - 1.0 + gained
    return Leftover(state.rms, predictable, slow, bursts, channels[int(np.argmax(excess))])


def _flexible(state: State, rows: Array) -> Array:
    """Held-out prediction of the residual from the state of motion: ridge regression on random Fourier features."""
    x = _features(state).astype(np.float32)  # a detector: half the memory is exact enough
    rng = np.random.default_rng(0)
    frequency = rng.standard_normal((x.shape[1], FEATURES)) * 10 ** rng.uniform(-0.7, 0.4, FEATURES)
    z = np.empty((len(x), FEATURES + x.shape[1] + 1), np.float32)
    waves = z[:, :FEATURES]
    np.matmul(x, frequency.astype(np.float32), out=waves)
    waves += rng.uniform(0, 2 * np.pi, FEATURES).astype(np.float32)
    np.cos(waves, out=waves)
    z[:, FEATURES:-1], z[:, -1] = x, 1.0
    half = state.problem.even[state.problem.valid]
    out = np.zeros_like(rows)
    for learn in (half, ~half):
        if learn.sum() < 50 or (~learn).sum() < 50:
            continue
        zl = z[learn]
        gram = zl.T @ zl + 0.03 * learn.sum() * 0.5 * np.eye(z.shape[1])
        weights = np.linalg.solve(gram, zl.T @ rows[:, learn].T.astype(np.float32))
        out[:, ~learn] = (z[~learn] @ weights).T
    return out


def _features(state: State) -> Array:
    """State of motion, each column of about unit size, (g, k)."""
    p, s = state.problem, state.problem.experiment.signals
    columns: list[Array] = []

    def add(x: Array) -> None:
        mean = (np.add.reduceat(x, p.edge) / p.count)[p.valid]
        spread = float(mean.std())
        if spread > 0:
            columns.append((mean - mean.mean()) / spread)

    add(s.t)
    if s.layout.kind == "joints":
        assert s.joints is not None
        for row in (*s.joints.q, *s.joints.dq):
            add(row)
        for row in s.joints.dq:
            add(np.sign(row))
    else:
        inside = s.depth > 0
        add(inside.astype(float))
        add(np.where(inside, s.depth, 0.0))
        add(np.where(inside, s.depth_rate, 0.0))
        add(np.sign(s.depth_rate) * inside)
        for axis in (0, 1):
            add(s.slip[axis] * inside)
            add(s.slip_rate[axis] * inside)
            add(np.sign(s.slip_rate[axis]) * inside)
        since = _since(inside, s.dt)
        add(np.log1p(since / 0.2))
        add(np.maximum.accumulate(np.where(inside, s.depth, 0.0)))
        if s.sensor is not None:
            for row in s.sensor.specific:
                add(row)
    return np.stack(columns, axis=1)


def _since(inside: NDArray[np.bool_], dt: Array) -> Array:
    """Time since contact began [s], 0 outside, (n,)."""
    clock = np.cumsum(dt)
    begin = np.maximum.accumulate(np.where(inside & ~np.r_[False, inside[:-1]], clock, 0.0))
    return np.where(inside, clock - begin, 0.0)


@dataclass(frozen=True)
class Opinion:
    """Whether something is left that the catalogue does not hold, and that in words."""

    unexplained: bool
    says: str
    left: Leftover

    @property
    def left_says(self) -> str:
        """How much is left, without a reason."""
        return f"what is left in {self.left.channel} is {_times(self.left)}"


def judge(first: State, last: State) -> Opinion:
    """Hold what is left against what noise leaves, and against what was explained.

    A law of another form than the catalogue's leaves a part of what it explains: `FORM` of it is forgiven.
    """
    left = leftover(last)
    allowed = ALLOWED if last.problem.experiment.steps is None else ALLOWED_OF_STAIRS
    forgiven = min(MOST_FORGIVEN, float(np.sqrt(allowed**2 + (FORM * first.rms) ** 2)))
    much = left.rms > forgiven
    alike = left.predictable > PREDICTABLE and left.rms > 0.5 * (1.0 + forgiven)
    if not (much or alike):
        other = " (its form is not quite the catalogue's)" if left.rms > OTHER_FORM else ""
        return Opinion(False, f"what is left is {_times(left)}{other}", left)
    how = []
    if left.predictable > PREDICTABLE:
        how.append(f"{100 * left.predictable:.0f} % of it follows depth, speed, place or time in some form")
    if left.bursts > 0.3:
        how.append(f"{100 * left.bursts:.0f} % of it comes in bursts")
    if not how:
        how.append("it follows neither depth, speed nor place")
    return Opinion(True, f"what is left in {left.channel} is {_times(left)}, and no effect of the catalogue explains it: "
                   f"{', '.join(how)}", left)  # fmt: skip


def _times(left: Leftover) -> str:
    return f"{left.rms:.2f} times the noise of readings and positions"
