"""How often recursive estimators are right on closed-loop logs: their intervals, and the flag that says to trust them.

Each log is a run of the laboratory, whose sensor drifts and is noisy anew with each seed; the motion is the same. The
estimators see contact quantities alone, and nothing of the truth.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from kinid.contact.online import OnlineContact
from kinid.contact.series import ContactSeries, contact_series
from kinid.data.log import Log
from kinid.data.rig import CONTACT, Rig
from kinid.errors import InputError
from kinid.estimators import Friction, HuntCrossleyKalman, KelvinVoigt, Offset, SingleStage, Track, TwoStage
from kinid.estimators.forgetting import Constant
from kinid.lab.experiments import prepare
from kinid.lab.materials import Material
from kinid.lab.setup import Setup

Array = NDArray[np.float64]

#: a power law with losses that grow with force, as the estimators of Hunt-Crossley suppose it
POWER_LAW = Material("power-law", stiffness=4000.0, exponent=1.3, loss=2.0, friction=0.3)
#: the laboratory's rig states the sensor's bias to so many newtons; from there the zero wanders
ZERO = Offset(start=1e-5)
#: a value within this share of the truth is right; one of losses and of viscous friction within the second
RIGHT, RIGHT_LOSSES = 0.05, 0.15
#: the share of c is that of the friction force at this speed, which is that of the slides [m/s]
SLIDES = 3e-3


class Score(NamedTuple):
    """Of one parameter of an estimator on logs of one material.

    Attributes:
        estimator, material, parameter: names. truth: value. mean, spread: of the last estimates.
        covered: share of the logs whose last 95 % interval holds the truth.
        valid: share of the samples in use whose flag says that the estimate stands. true: share of these at which all
            parameters are right; NaN where none is.
        logs: how many there were.
    """

    estimator: str
    material: str
    parameter: str
    truth: float
    mean: float
    spread: float
    covered: float
    valid: float
    true: float
    logs: int


@dataclass(frozen=True)
class Study:
    """One estimator: what it is run on, and what is true there."""

    run: Callable[[ContactSeries], Track]
    truth: Callable[[Material], tuple[float, ...]]


def poked(touch: ContactSeries) -> NDArray[np.bool_]:
    """Samples of the poke: at the retraction dry contacts let go where the equation of Kelvin-Voigt would pull."""
    assert touch.phase is not None
    return touch.in_contact & np.isin(touch.phase, ("hold", "poke"))


def _friction(touch: ContactSeries) -> Track:
    slip = np.column_stack([touch.slip_rate1, touch.slip_rate2])
    force = np.column_stack([touch.tangential_force1, touch.tangential_force2])
    return Friction().run(touch.normal_force, slip, force, touch.t, touch.in_contact)


def _kelvin_voigt(touch: ContactSeries) -> Track:
    estimator = KelvinVoigt(forgetting=Constant(1.0), offset=ZERO)
    return estimator.run(touch.depth, touch.depth_rate, touch.normal_force, touch.t, poked(touch))


def _single_stage(touch: ContactSeries) -> Track:
    estimator = SingleStage(noise=0.03, forgetting=Constant(1.0), reference_depth=3e-3, offset=ZERO)
    return estimator.run(touch.depth, touch.depth_rate, touch.normal_force, touch.t, poked(touch))


def _two_stage(touch: ContactSeries) -> Track:
    estimator = TwoStage(noise=0.03, reference_depth=3e-3)
    return estimator.run(touch.depth, touch.depth_rate, touch.normal_force, touch.t, poked(touch))


def _kalman(touch: ContactSeries) -> Track:
    estimator = HuntCrossleyKalman(noise=0.03, reference_depth=3e-3)
    return estimator.run(touch.depth, touch.depth_rate, touch.normal_force, touch.t, poked(touch))


def _power(m: Material) -> tuple[float, ...]:
    return m.stiffness, m.loss * m.stiffness, m.exponent


STUDIES = {
    "Friction": Study(_friction, lambda m: (m.friction, m.viscous)),
    "KelvinVoigt": Study(_kelvin_voigt, lambda m: (m.stiffness, m.damping)),
    "SingleStage": Study(_single_stage, _power),
    "TwoStage": Study(_two_stage, _power),
    "HuntCrossleyKalman": Study(_kalman, lambda m: (*_power(m), 0.0)),
}
#: what the estimators are tried on
LINEAR = ("sponge", "ecoflex-50", "dragon-skin-10")
MATERIALS = {"Friction": LINEAR, "KelvinVoigt": LINEAR} | dict.fromkeys(
    ("SingleStage", "TwoStage", "HuntCrossleyKalman"), (POWER_LAW.name,)
)


def _setup(material: str, seed: int) -> Setup:
    if material == POWER_LAW.name:
        return prepare("poke", seed=seed).replace(material=POWER_LAW)
    return prepare(material, seed=seed)


def from_loop(log: Log, rig: Rig) -> ContactSeries:
    """What estimators are given inside the loop, of a log's samples one after the other; NaN where it is nothing."""
    assert log.q is not None
    assert log.wrench is not None
    contact, times, rows = OnlineContact(rig), [], []
    for t, q, wrench in zip(log.t.tolist(), np.array(log.q), np.array(log.wrench)):
        contact.step(t, q, wrench)
        while contact.next_delayed():
            times.append(contact.delayed_time)
            rows.append(contact.delayed.copy())
    quantities = np.full((len(CONTACT), len(log)), np.nan)
    quantities[:, np.searchsorted(log.t, np.array(times))] = np.transpose(rows)
    named: dict[str, Any] = dict(zip(CONTACT, quantities))
    force = named["normal_force"]
    return ContactSeries(
        t=log.t, in_contact=force > contact.threshold, valid=np.isfinite(force), phase=log.phase, **named
    )


def study(
    estimators: Iterable[str],
    seeds: Iterable[int],
    materials: Iterable[str] | None = None,
    *,
    series: Callable[[Log, Rig], ContactSeries] = contact_series,
) -> list[Score]:
    """Run estimators on closed-loop logs of every seed, and score them.

    Args:
        estimators: names of `STUDIES`. seeds: of sensor faults, drift and noise.
        materials: instead of those that an estimator is tried on.
        series: makes contact quantities of a log: offline, or `from_loop`.

    Raises:
        InputError: no such estimator, or no seeds.
    """
    names, numbers = list(estimators), list(seeds)
    if unknown := [name for name in names if name not in STUDIES]:
        raise InputError(f"estimator '{unknown[0]}'", f"one of {', '.join(STUDIES)}", "correct the name")
    if not numbers:
        raise InputError("a study without seeds", "one at least", "give some")
    wanted = None if materials is None else set(materials)
    tried = {name: [m for m in MATERIALS[name] if wanted is None or m in wanted] for name in names}
    tracks: dict[tuple[str, str], list[Track]] = {(name, m): [] for name in names for m in tried[name]}
    for material in dict.fromkeys(m for _, m in tracks):
        moved = _setup(material, 0).run().motion
        for seed in numbers:
            setup = _setup(material, seed)
            touch = series(setup.observe(moved).log, setup.rig)
            for name in names:
                if (name, material) in tracks:
                    tracks[name, material].append(STUDIES[name].run(touch))
    return [row for (name, m), found in tracks.items() for row in _scores(name, _setup(m, 0).material, found)]


def _scores(name: str, material: Material, tracks: list[Track]) -> list[Score]:
    """Every parameter of an estimator on the logs of a material."""
    truth = np.array(STUDIES[name].truth(material))
    last = np.array([track.final.values for track in tracks])
    ends = np.array([track.final.interval for track in tracks])
    inside = (ends[:, :, 0] <= truth) & (truth <= ends[:, :, 1])
    used = sum(int(np.count_nonzero(track.innovation)) for track in tracks)
    flagged = np.concatenate([track.theta[track.valid] for track in tracks])
    right = np.abs(flagged - truth) <= _tolerance(name, material)
    true = float(right.all(axis=1).mean()) if len(flagged) else float("nan")
    return [
        Score(
            name,
            material.name,
            parameter,
            float(truth[k]),
            float(last[:, k].mean()),
            float(last[:, k].std()),
            float(inside[:, k].mean()),
            len(flagged) / max(used, 1),
            true,
            len(tracks),
        )
        for k, parameter in enumerate(tracks[0].names)
    ]


def _tolerance(name: str, m: Material) -> Array:
    """How far each parameter may be off the truth and still be right."""
    if name == "Friction":  # both as shares of the coefficient, and of the force on a newton or so
        return np.array([RIGHT * m.friction, RIGHT * m.friction / SLIDES])
    if name == "KelvinVoigt":
        return np.array([RIGHT * m.stiffness, RIGHT_LOSSES * m.damping])
    # K of a power law goes with rⁿ: five per cent of the force at 3 mm are e^(0.05) of K or 0.9 % of n
    share = np.array([4 * RIGHT, 2 * RIGHT_LOSSES, RIGHT, 0.0])[: 4 if name == "HuntCrossleyKalman" else 3]
    out = share * np.array([m.stiffness, m.loss * m.stiffness, m.exponent, 0.0])[: len(share)]
    out[3:] = 1e-4  # of the surface [m]
    return np.asarray(out)


def table(scores: Iterable[Score]) -> str:
    """The scores as a table of Markdown."""
    rows = [
        "| estimator | material | parameter | true | mean ± spread | intervals that hold | valid | true of these |",
        "|---|---|---|---|---|---|---|---|",
    ]
    for s in scores:
        rows.append(
            f"| {s.estimator} | {s.material} | {s.parameter} | {s.truth:.4g} | {s.mean:.4g} ± {s.spread:.2g} | "
            f"{100 * s.covered:.0f} % of {s.logs} | {100 * s.valid:.0f} % | {100 * s.true:.1f} % |"
        )
    return "\n".join(rows)
