"""A minute of poking a material that drifts: when do estimators of Hunt-Crossley say that they stand?

Each log is a closed-loop run of its own: a power law whose constants and drift are drawn at random, under a sensor that
drifts and is noisy. An estimate is asked to be within `ASKED` of K, B and n; its flag should say when it is.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from kinid.contact.series import contact_series
from kinid.errors import InputError
from kinid.estimators import Constant, HuntCrossleyKalman, SingleStage, TwoStage
from kinid.estimators._contact import ContactEstimator
from kinid.lab.experiments import SILICONE_POKE, prepare
from kinid.lab.materials import Material
from kinid.lab.protocol import Poke, five_phases
from kinid.lab.recursive_study import ZERO, poked
from kinid.writers import finite, make_folder, write_json

Array = NDArray[np.float64]

#: share of its value that each of K, B and n may be off by, and that a valid estimate is asked to be known to
ASKED = 0.02
#: what is poked at, and how long [s]
DEPTH, SECONDS = 3e-3, 60.0
_ALL = (ASKED, ASKED, ASKED)
_SEEN: dict[str, Any] = {"noise": 0.03, "reference_depth": DEPTH, "accuracy": _ALL}
#: of materials: force at `DEPTH` [N], exponent, B/K [s/m], and change of the stiffness in a minute
FORCE, EXPONENT, LOSS, DRIFT = (2.0, 6.0), (1.1, 1.5), (1.5, 2.5), (-0.4, 0.4)
#: rates of ln K that the drift makes possible [1/s]
_GROWTH = 0.02

ESTIMATORS: dict[str, ContactEstimator] = {
    "one stage, nothing forgotten": SingleStage(forgetting=Constant(1.0), offset=ZERO, **_SEEN),
    "one stage, memory 5000": SingleStage(forgetting=Constant(1.0 - 1.0 / 5000.0), offset=ZERO, **_SEEN),
    "one stage, growth, memory 20000": SingleStage(
        forgetting=Constant(1.0 - 1.0 / 20000.0), offset=ZERO, growth=_GROWTH, **_SEEN
    ),
    "two stages, memory 1000": TwoStage(forgetting=Constant(1.0 - 1.0 / 1000.0), **_SEEN),
    "two stages, memory 5000": TwoStage(forgetting=Constant(1.0 - 1.0 / 5000.0), **_SEEN),
    "Kalman filter, values walk": HuntCrossleyKalman(walk=(5e-3, 2e-3, 0.0, 0.0), surface=1e-5, **_SEEN),
}


class Flagged(NamedTuple):
    """Of one estimator over all logs.

    Attributes:
        method: its name. logs: how many. valid: share of the samples in use at which the estimate is called valid.
        stiffness, damping, exponent, all: shares of these at which it is within `ASKED` of the truth; NaN without any.
    """

    method: str
    logs: int
    valid: float
    stiffness: float
    damping: float
    exponent: float
    all: float


class Minute(NamedTuple):
    """A log: time [s], depth [m], depth rate [m/s], normal force [N], samples in use, (n,), and the truth of K, B and
    n, (n, 3).
    """

    t: Array
    depth: Array
    depth_rate: Array
    normal_force: Array
    used: NDArray[np.bool_]
    truth: Array


def minutes(seeds: Iterable[int]) -> Iterator[Minute]:
    """A log of each seed."""
    waves = Poke(SILICONE_POKE.depth, SILICONE_POKE.sines, duration=SECONDS)
    for seed in seeds:
        rng = np.random.default_rng([seed, 5])
        exponent, force, drift, loss = (rng.uniform(*ends) for ends in (EXPONENT, FORCE, DRIFT, LOSS))
        stiffness = force / DEPTH**exponent
        material = Material("drifting", stiffness=stiffness, exponent=exponent, loss=loss, friction=0.3, drift=drift)
        setup = prepare("poke", seed=seed).replace(material=material, script=five_phases(waves))
        touch = contact_series(setup.run().log, setup.rig)
        now = stiffness * (1.0 + drift * touch.t / 60.0)
        truth = np.column_stack([now, loss * now, np.full(len(touch), exponent)])
        yield Minute(touch.t, touch.depth, touch.depth_rate, touch.normal_force, poked(touch), truth)


def study(seeds: Iterable[int]) -> list[Flagged]:
    """All estimators on a log of each seed.

    Raises:
        InputError: no seeds.
    """
    logs, valid, used = 0, dict.fromkeys(ESTIMATORS, 0), 0
    right: dict[str, list[NDArray[np.bool_]]] = {name: [] for name in ESTIMATORS}
    for log in minutes(seeds):
        logs, used = logs + 1, used + int(log.used.sum())
        for name, estimator in ESTIMATORS.items():
            track = estimator.run(log.depth, log.depth_rate, log.normal_force, log.t, log.used)
            stands = track.valid
            valid[name] += int(stands.sum())
            right[name].append(np.abs(track.theta[stands, :3] / log.truth[stands] - 1.0) <= ASKED)
    if not logs:
        raise InputError("a study without seeds", "one at least", "give some")
    out = []
    for name, parts in right.items():
        found = np.concatenate(parts)
        each = [float(v) for v in (*found.mean(axis=0), found.all(axis=1).mean())] if len(found) else [np.nan] * 4
        out.append(Flagged(name, logs, valid[name] / used, *each))
    return out


def write(folder: Path, rows: list[Flagged]) -> Path:
    """Write `minutes.json` into a folder; its path."""
    make_folder(folder)
    path = folder / "minutes.json"
    write_json(path, [{k: v if isinstance(v, str) else finite(v) for k, v in row._asdict().items()} for row in rows])
    return path
