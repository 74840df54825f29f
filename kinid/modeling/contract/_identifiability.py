"""Rules about what a log tells: parameters come back, an absent effect isn't found, what isn't excited is left open."""

from __future__ import annotations

import dataclasses

import numpy as np
from numpy.typing import NDArray
from scipy.stats import chi2

from kinid.effects import JointMotion, Samples, Signals, Stage
from kinid.effects._derived import sample_period
from kinid.estimators.batch import solve
from kinid.modeling.contract._case import Case, Rule, demand
from kinid.modeling.model import Model
from kinid.parameter import Parameter

Array = NDArray[np.float64]

#: how near parameters come back without noise, as a share of the value, or of the change that matters
RECOVERED = 1e-5
#: white noise of simulated logs, as a share of each channel's root mean square, and least as one of the largest channel
NOISE, LEAST_NOISE = 0.01, 1e-3
#: how often chance alone may earn an effect as much as it does in a log without it
BY_CHANCE = 1e-4
#: starts of a search that are tried, at most
MOST_STARTS = 12
#: how far a tool is held from the material where nothing is excited [m]: no bond reaches so far
FAR = 0.01
#: stages of forces between tool and material: nothing of them is left in the air
OF_CONTACT = {Stage.GEOMETRY, Stage.ELASTIC, Stage.NORMAL, Stage.FRICTION, Stage.FRAME}


def recovery(case: Case) -> str:
    """From the nominal values, parameters come back from a simulated log without noise."""
    if case.kind.detector:
        return "told by its mark, not by a search"
    if not case.own:
        return "no parameter"
    sigma = np.maximum(np.sqrt(np.mean(case.reading**2, axis=1)), 1e-6)
    found = solve(
        lambda v: case.model.predict(case.measured, v), case.reading, _free(case), sigma=sigma, covariance=False
    )
    worst = 0.0
    for i, (name, p) in zip(case.places, case.own.items()):
        value, truth = float(found.values[i]), float(case.values[i])
        off = abs(value - truth) / max(abs(truth), p.scale)
        demand(off <= RECOVERED, f"{name} = {value:.6g} {p.unit} instead of {truth:.6g}")
        worst = max(worst, off)
    return f"all within {worst:.1g} of the truth"


def present(case: Case) -> str:
    """In a simulated log with noise, it earns far more than chance would."""
    if case.kind.base:
        return "a base is what a model starts from"
    here = case.beside
    if case.kind.detector:
        return _mark(case, here.reading, True)
    gain, limit = _gain(here, here.reading)
    demand(gain > limit, f"a gain of {gain:.3g} in −2 log likelihood, chance gives {limit:.3g}")
    return f"gains {gain:.3g} in −2 log likelihood, chance gives {limit:.3g}"


def absent(case: Case) -> str:
    """In a simulated log without it, it earns no more than chance does."""
    if case.kind.base:
        return "a base is what a model starts from"
    here = case.beside
    without = here.rest.predict(here.signals, here.rest_values)
    if case.kind.detector:
        return _mark(case, without, False)
    gain, limit = _gain(here, without)
    demand(gain <= limit, f"a gain of {gain:.3g} in −2 log likelihood, chance gives {limit:.3g}")
    return f"gains {gain:.3g} in −2 log likelihood, chance gives {limit:.3g}"


def not_excited(case: Case) -> str:
    """With the tool held still in the air, or the joints still, what isn't seen is left open, and no force of contact
    is left.
    """
    signals = still(case.signals)
    model, values = case.model, case.values
    reading = model.predict(signals, values)
    demand(np.isfinite(reading).all(), "readings that aren't finite")
    seen = []
    for i, (name, p) in zip(case.places, case.own.items()):
        other = values.copy()
        other[i] += p.scale if other[i] + p.scale <= p.high else -p.scale
        if np.abs(model.predict(signals, other) - reading).max() > 0.0:
            seen.append(name)
    demand(not (seen and set(case.effect.stages()) <= OF_CONTACT), f"{', '.join(seen)} at work without contact")
    open_ = [name for name in case.own if name not in seen]
    if case.kind.detector or not open_:
        return f"seen at rest, too: {_some(seen)}" if seen else "nothing to estimate"
    sigma = noise_of(case.reading)
    noisy = reading + sigma[:, None] * np.random.default_rng(3).standard_normal(reading.shape)
    found = solve(lambda v: model.predict(signals, v), noisy, _free(case), sigma=sigma)
    own = dict(zip(case.own, found.standard_errors[case.places]))
    bounded = [name for name in open_ if np.isfinite(own[name])]
    demand(not bounded, f"an interval of {_some(bounded)}, which such a log doesn't show")
    return f"left open: {_some(open_)}" + (f"; seen at rest, too: {_some(seen)}" if seen else "")


def still(signals: Signals) -> Signals:
    """The same log with everything at rest as in its first sample; the tool in the air."""

    def held(array: Array) -> Array:
        out = np.ascontiguousarray(np.broadcast_to(array[..., :1], array.shape))
        out.setflags(write=False)
        return out

    n = len(signals)
    rest = {name: np.zeros_like(getattr(signals, name)) for name in ("depth_rate", "slip_rate")}
    out = dataclasses.replace(signals, depth=np.full(n, -FAR), slip=held(signals.slip), measured=None, **rest)
    if signals.sensor is not None:
        s = signals.sensor
        axes = np.ascontiguousarray(np.broadcast_to(s.to_contact[:1], s.to_contact.shape))
        turning = {name: np.zeros_like(getattr(s, name)) for name in ("omega", "alpha")}
        moved = {"to_contact": axes, "specific": held(s.specific), "load": held(s.load), **turning}
        out = dataclasses.replace(out, sensor=dataclasses.replace(s, **moved))
    if signals.joints is not None:
        j = signals.joints
        kept = {name: held(getattr(j, name)) for name in ("q", "rigid")}
        kept |= {name: held(array) for name in ("payload", "gravity") if (array := getattr(j, name)) is not None}
        kept |= {name: np.zeros_like(getattr(j, name)) for name in ("dq", "ddq")}
        joints = JointMotion(**{f.name: getattr(j, f.name) for f in dataclasses.fields(j)} | kept)
        out = dataclasses.replace(out, joints=dataclasses.replace(joints, moments=None, slopes=None))
    return out


def noise_of(reading: Array) -> Array:
    """Standard deviation of simulated noise in each channel, (channels,)."""
    size = np.sqrt(np.mean(reading**2, axis=1))
    out: Array = np.maximum(NOISE * size, LEAST_NOISE * max(float(size.max()), 1e-6))
    return out


def _free(case: Case) -> list[Parameter]:
    """The model's parameters; linear ones only where readings are affine in all of them."""
    return [p if case.affine else dataclasses.replace(p, linear=False) for p in case.named.values()]


def _gain(case: Case, reading: Array) -> tuple[float, float]:
    """How much the effect lowers −2 log likelihood of a noisy log, and how much chance would at most."""
    sigma = noise_of(case.reading)
    noisy = reading + sigma[:, None] * np.random.default_rng(7).standard_normal(reading.shape)
    signals = dataclasses.replace(case.signals, measured=noisy)

    def left(model: Model, starts: list[Array]) -> float:
        if not model.parameters(signals.layout):
            residual = noisy - model.predict(signals, np.zeros(0))
        else:
            free = list(model.parameters(signals.layout).values())
            free = free if case.affine else [dataclasses.replace(p, linear=False) for p in free]
            found = solve(
                lambda v: model.predict(signals, v), noisy, free, sigma=sigma, starts=starts, covariance=False
            )
            residual = found.residual
        return float(np.sum((residual / sigma[:, None]) ** 2))

    starts = list(case.starts())
    starts = starts[:: max(1, -(-len(starts) // MOST_STARTS))]
    gain = left(case.rest, []) - left(case.model, starts)
    # each start is another try
    return gain, float(chi2.isf(BY_CHANCE / (1 + len(starts)), len(case.own)))


def _mark(case: Case, reading: Array, wanted: bool) -> str:
    """Whether a detector finds its mark in readings."""
    signals, n = case.signals, len(case.signals)
    period = sample_period(signals)
    shown = Samples(
        reading, reading, np.full(len(reading), 1e-9), np.ones(n, np.bool_), signals.t, period, signals.layout
    )
    found = case.effect.detect(shown)
    if wanted:
        return f"its mark: {found.says}" if found is not None else "told by its mark, which this motion doesn't show"
    demand(found is None, f"a mark in a log without it: {found.says if found else ''}")
    return "no mark in a log without it"


def _some(names: list[str], limit: int = 3) -> str:
    return ", ".join(names[:limit]) + (f" and {len(names) - limit} more" if len(names) > limit else "")


IDENTIFIABILITY = (
    Rule("recovery", recovery, "each within 1e-5 of the truth, without noise", "excite it more, or mark fewer linear"),
    Rule("present", present, "a gain that chance has once in 10,000 at most", "show it more in the example"),
    Rule("absent", absent, "no more than chance gives in a log without it", "take parameters out that fit noise"),
    Rule("not excited", not_excited, "an open interval of what a log at rest doesn't show", "multiply by s.inside"),
)
