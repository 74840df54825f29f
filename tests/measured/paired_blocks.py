"""The peer of the diagnosis: forward selection by paired errors on blocks that a fit has not seen, with a solver of its
own.

Each channel is weighed by what is left in it. Derived from a script of 74 lines that stood on the project's own search.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

import kinid
from kinid import effects
from kinid.errors import InputError
from measured.solver import Fitting, blocks

Array = NDArray[np.float64]
#: paired t; least share of the error; rivals (s.e.); samples of the first look; full fits; effects; starts of a new one
#: and steps from each
T, SHARE, SAME, SCREEN, FULL, MOST, STARTS, QUICK = 3.0, 0.03, 2.0, 3000, 5, 4, 3, 5


def gain(before: Array, after: Array, t: Array) -> tuple[float, float]:
    """Share of the weighed squared error that goes, and its paired t over blocks."""
    weight = 1.0 / np.maximum(np.nansum(after**2, 1), 1e-12 * np.nansum(before**2))[:, None]
    a, b = (np.bincount(blocks(t), np.nansum(r**2 * weight, 0)) for r in (after, before))
    d = (b - a)[b > 0]
    return d.sum() / b.sum(), d.sum() / max(d.std(ddof=1) * np.sqrt(len(d)), 1e-300)


def starts(name: str, fitting: Fitting, known: dict[str, float]) -> Iterator[Array]:
    """Where a search for a new effect begins: nominal, and some of the effect's grid."""
    yield fitting.start(known)
    of = [key for key in fitting.named if key.startswith(f"{name}.")]
    grid = effects.get(name).initial_guesses(fitting.e.signals) if of else ()
    for values in list(grid)[:: max(1, len(grid) // STARTS)][:STARTS]:
        yield fitting.start(known | dict(zip(of, values)))


def select(model: kinid.Model, experiment: Any) -> list[tuple[str, float, float, list[str]]]:
    """Names that are added, each with its share, t and rivals that fit as well."""
    step = max(1, len(experiment.signals.t) // SCREEN)
    small = experiment.thinned(step) if step > 1 else experiment
    added: list[tuple[str, float, float, list[str]]] = []
    first = Fitting(model, experiment)
    values = first.solve(first.start({}), first.valid)
    now = first.held_out(values)
    weight = 1.0 / np.maximum(np.sqrt(np.nanmean(now**2, 1)), 1e-9)
    while len(added) < MOST:
        known = dict(zip(first.named, values))
        look = Fitting(model, small, weight)
        was, looks = look.held_out(look.start(known)), []
        for name in effects.catalogue():
            if effects.get(name).base or name in model:
                continue
            try:
                new = Fitting(model + name, small, weight)
                if len(new.named) > len(look.named):
                    tried = [new.solve(start, new.valid, QUICK) for start in starts(name, new, known)]
                    cost = [
                        np.sum(((new.measured - new.predict(v)) * weight[:, None])[:, new.valid] ** 2) for v in tried
                    ]
                    best = tried[int(np.argmin(cost))]
                    looks.append((gain(was, new.held_out(best), small.signals.t)[0], name, best))
            except (InputError, ValueError, np.linalg.LinAlgError, ZeroDivisionError):
                continue
        full = []
        for share, name, best in sorted(looks, key=lambda x: -x[0])[:FULL]:
            if share > SHARE / 2:
                new = Fitting(model + name, experiment, weight)
                after = new.held_out(best)
                full.append((*gain(now, after, experiment.signals.t), name, after, new, best))
        full = sorted((x for x in full if x[0] > SHARE and x[1] > T), key=lambda x: -x[0])
        if not full:
            break
        share, t, name, after, first, best = full[0]
        rivals = [x[2] for x in full[1:] if gain(x[3], after, experiment.signals.t)[1] < SAME]
        added.append((name, round(float(share), 3), round(float(t), 1), rivals))
        model, now, values = model + name, after, first.solve(best, first.valid)
        weight = 1.0 / np.maximum(np.sqrt(np.nanmean(now**2, 1)), 1e-9)
    return added
