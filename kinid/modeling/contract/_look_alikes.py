"""What an effect looks like: the angle between its mark in the readings and what other effects could make of them."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from kinid.effects import Effect, catalogue, get
from kinid.modeling.contract._case import Case, short
from kinid.modeling.contract._identifiability import noise_of
from kinid.modeling.model import Model

Array = NDArray[np.float64]

#: forms of another effect that are tried, at most
MOST_FORMS = 8


def look_alikes(case: Case) -> dict[str, float]:
    """Angle between what an effect changes and what others of the catalogue can change, in its example.

    The angle is that of weighted readings, beside all that the rest of the model takes up: 0° for effects that can't be
    told apart in this motion, 90° for such as have nothing in common.

    Returns:
        Angle [°] by name, smallest first; of effects that can act in a log of this layout beside the rest of the model.
    """
    here = case.beside
    weight = 1.0 / noise_of(here.reading)[:, None]
    rest, values = here.rest, here.rest_values
    without = rest.predict(here.signals, values)
    taken = _basis(_columns(rest, values, case, weight, list(range(len(values)))))
    mark = ((here.reading - without) * weight).ravel()
    mark = mark - taken @ (taken.T @ mark)
    size = float(np.linalg.norm(mark))
    if case.kind.base or size == 0.0:
        return {}
    out: dict[str, float] = {}
    for name in catalogue():
        other = get(name)
        if name in case.model or other.base or other.detector or not _can_act(other, case):
            continue
        share = max((_shared(form, case, taken, mark / size, weight) for form in _forms(other, case)), default=0.0)
        out[name] = float(np.degrees(np.arccos(np.clip(share, 0.0, 1.0))))
    return dict(sorted(out.items(), key=lambda item: item[1]))


def _can_act(other: Effect, case: Case) -> bool:
    """Whether another effect can act in this log, beside the rest of the model."""
    kind, names = case.signals.layout.kind, case.rest.names
    wrong_log = ("wrench" in other.needs and kind != "wrench") or (("joints" in other.needs) != (kind == "joints"))
    if wrong_log and not (kind != "joints" and not other.needs):
        return False
    return (not other.requires or bool(set(other.requires) & set(names))) and bool(
        other.parameters(case.signals.layout)
    )


def _forms(other: Effect, case: Case) -> list[tuple[Model, Array]]:
    """The rest of the model with another effect at its null, for each of its shapes that a search starts from."""
    model = Model(*case.rest.effects, other).for_log(case.measured)
    place = model.place(other.id, case.signals.layout)
    kept = dict(zip(case.rest.parameters(case.signals.layout), case.rest_values))
    base = next((effect.id for effect in model.effects if effect.base), "")
    null = model[other.id].null_for(base)
    out = []
    starts = model[other.id].initial_guesses(case.signals) or (model.nominal(case.signals.layout)[place],)
    for start in starts[:: max(1, -(-len(starts) // MOST_FORMS))]:
        values = np.array([kept.get(key, p.nominal) for key, p in model.parameters(case.signals.layout).items()])
        own = model[other.id].parameters(case.signals.layout)
        values[place] = [null.get(short(p.name), value) for p, value in zip(own, start)]
        out.append((model, values))
    return out


def _shared(form: tuple[Model, Array], case: Case, taken: Array, mark: Array, weight: Array) -> float:
    """Cosine between the mark, of length one, and the nearest change that a form can make."""
    model, values = form
    name = next(name for name in model.names if name not in case.rest)
    place = model.place(name, case.signals.layout)
    columns = _columns(model, values, case, weight, list(range(place.start, place.stop)))
    columns = columns - taken @ (taken.T @ columns)
    return float(np.linalg.norm(_basis(columns).T @ mark))


def _columns(model: Model, values: Array, case: Case, weight: Array, places: list[int]) -> Array:
    """Change of weighted readings with some parameters, of one scale each, (m, k)."""
    signals = case.measured
    listed = list(model.parameters(signals.layout).values())
    before = model.predict(signals, values)
    out = []
    for i in places:
        step = 1e-3 * listed[i].scale
        other = values.copy()
        other[i] += step if values[i] + step <= listed[i].high else -step
        change = (model.predict(signals, other) - before) / (other[i] - values[i]) * listed[i].scale
        out.append((change * weight).ravel())
    return np.stack(out, axis=1) if out else np.zeros((before.size, 0))


def _basis(columns: Array) -> Array:
    """Orthonormal directions of columns, without those of no length, (m, r)."""
    size = np.linalg.norm(columns, axis=0)
    columns = columns[:, size > 1e-9] / size[size > 1e-9]
    if not columns.shape[1]:
        return columns
    u, s, _ = np.linalg.svd(columns, full_matrices=False)
    out: Array = u[:, s > 1e-6 * s[0]]
    return out
