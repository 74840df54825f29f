"""The poke that tells most about a contact model: a multisine whose frequencies, amplitudes, phases and depth are
optimised.

The readings' sensitivities to the parameters, at values that are assumed, give Fisher's information; its determinant
(D) or the sum of relative variances (A) is brought to its best by an interior-point method (casadi, ipopt), within
limits of depth, force, speed and of the bandwidth in which the robot follows; of a robot also within what its joints
can do.

What to expect: within the peak force and the time of the study's two sines, at most 3 Hz, an A-optimal poke leaves 0.53
to 0.74 of their intervals, and more than three sines narrow them no further. For stiffness and exponent no motion at
all within that force and 0.15 m/s leaves less than about half (`kinid.planning.ideal.least_halves`). With half as much
force again all three fall to half or less.
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from kinid.errors import InputError
from kinid.planning.expected import Law
from kinid.planning.information import CRITERIA, Interval, intervals, sizes
from kinid.planning.poke_design import Bounds, Design, Joints, candidates, search
from kinid.planning.signals import Multisine
from kinid.writers import Json

Array = NDArray[np.float64]

#: standard deviation of a Mini40's normal force [N] at the log's rate, where the rig states none
NOISE = 0.029
#: share of the force limit that the motion is planned for: the rest is for what lies between samples
SPARED = 0.99
#: so many shapes of candidates are searched from: the swing of several sines and the square wave
STARTS = 2
#: a poke whose every interval is this share of its parameter or wider tells nothing that helps
USELESS = 1.0


@dataclass(frozen=True, eq=False)
class Excitation:
    """An optimised signal, and what it is expected to tell.

    Attributes:
        signal: the motion phase. criterion: D or A. cost: its value. intervals: by parameter.
        force, speed, deepest: the largest that are expected. binding: names of the bounds that are reached.
        information: of relative changes of the parameters that a poke tells, (p, p).
    """

    signal: Multisine
    criterion: str
    cost: float
    intervals: dict[str, Interval]
    force: float
    speed: float
    deepest: float
    binding: tuple[str, ...]
    information: Array

    def to_dict(self) -> Json:
        """For provenance and JSON."""
        return {
            "criterion": self.criterion,
            "cost": self.cost,
            "signal": self.signal.to_dict(),
            "force": self.force,
            "speed": self.speed,
            "deepest": self.deepest,
            "binding": list(self.binding),
            "intervals": {name: each.to_dict() for name, each in self.intervals.items()},
        }


def expected_intervals(
    law: Law, signal: Multisine, *, noise: float = NOISE, rate: float = 500.0
) -> dict[str, Interval]:
    """The 95 % intervals that a log of this motion phase gives, samples at a rate [Hz] with white noise [N]."""
    design = Design(law, Bounds(), 1, "D", noise, rate)
    return intervals(design.information(signal, rate), law.vector, design.parameters)


def optimise(
    law: Law,
    bounds: Bounds | None = None,
    *,
    sines: int = 3,
    criterion: str = "D",
    noise: float = NOISE,
    rate: float = 500.0,
    joints: Joints | None = None,
) -> Excitation:
    """The multisine that tells most about a contact law within bounds: the best of simple candidates and of searches.

    A search that ends outside the bounds, or on less than its start, is no loss: the candidates stand beside it.

    Args:
        law: the model, and the values assumed. bounds: to be kept, default: those of `Bounds`. sines: how many.
        criterion: "D" or "A". noise: of the normal force, standard deviation at the log's rate [N].
        rate: of the log [Hz].
        joints: what the robot's joints can do there, as `Planner.joints` tells it; default: anything.

    Raises:
        InputError: bounds that leave no motion, or within which a poke tells nothing that helps.
    """
    check_asked(sines, criterion, noise)
    bounds = Bounds() if bounds is None else bounds
    bounds = dataclasses.replace(bounds, force=SPARED * bounds.force)
    design = Design(law, bounds, sines, criterion, noise, rate, joints)
    simple = candidates(design)
    if not simple:
        raise InputError(
            "bounds that no signal keeps", "room for a motion", "allow more depth, force or speed, or faster joints"
        )
    searched = [design.kept(search(design, begin)) for begin in simple[:STARTS]]
    signal = min((found for found in (*simple, *searched) if found is not None), key=design.cost)
    matrix, reached = design.information(signal, rate), design.reached(signal)
    expected = intervals(matrix, law.vector, design.parameters)
    _check_useful(design, expected)
    share = {
        "force": reached["force"] / bounds.force,
        "speed": reached["speed"] / bounds.speed,
        "deepest": reached["deepest"] / bounds.deepest,
        "bandwidth": max(s[1] for s in signal.sines) / bounds.bandwidth,
        "joints": reached["joints"],
    }
    return Excitation(
        signal,
        criterion,
        design.cost(signal),
        expected,
        reached["force"],
        reached["speed"],
        reached["deepest"],
        tuple(name for name, value in share.items() if value > 0.98),
        matrix[np.ix_(design.identifiable, design.identifiable)],
    )


def _check_useful(design: Design, expected: dict[str, Interval]) -> None:
    """Refuse a poke after which nothing is known better than to its own size."""
    identifiable = design.identifiable
    size = sizes(design.law.vector, design.parameters)[identifiable]
    wide = {name: each for k, (name, each) in enumerate(expected.items()) if k in identifiable}
    if all(each.half > USELESS * s for each, s in zip(wide.values(), size)):
        name, each = next(iter(wide.items()))
        raise InputError(
            f"bounds within which the best poke tells {name} to ± {each.half:.2g} {each.unit} of {each.value:.3g}",
            "room for a motion that tells something",
            "allow more depth, force, speed or time",
        )


def check_asked(sines: int, criterion: str, noise: float = NOISE) -> None:
    """Refuse what no search can begin with; arguments as of `optimise`."""
    if criterion not in CRITERIA:
        raise InputError(f"criterion '{criterion}'", f"one of {', '.join(CRITERIA)}", "choose one")
    if not 1 <= sines <= 8:
        raise InputError(f"{sines} sines", "1 to 8", "choose another number")
    if not (np.isfinite(noise) and noise > 0):
        raise InputError(f"a noise of {noise} N", "a positive number", "correct it")
