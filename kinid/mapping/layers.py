"""Laws that hold a layer at some places of a surface: which touches show it, and what a map calls film and body."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from kinid.contact.series import ContactSeries
from kinid.effects import Effect
from kinid.identification.fit import Fit
from kinid.modeling.model import Model
from kinid.parameter import Parameter

Array = NDArray[np.float64]

#: a layer is there whose amount is so many standard errors from none: where there is none, its depth is free to make
#: the best of noise (R. B. Davies, Biometrika 74, 1987)
SURE = 4.0
#: and which takes off more of the squared error beyond noise than it leaves
TAKEN_OFF = 0.5


class Mapped(NamedTuple):
    """What a map calls the estimates of a law.

    Attributes:
        names, units: of the properties, in the model's order. weights: of the law's parameters in each, (p, p): a
            body's stiffness is that of its film and what it has more.
    """

    names: tuple[str, ...]
    units: tuple[str, ...]
    weights: Array


def fit_touch(model: Model, touch: ContactSeries) -> Fit:
    """A model fitted to a touch: without those layers that it doesn't show.

    Raises:
        InputError: a touch that can't carry the model without its layers.
    """
    layers = [effect for effect in model.effects if effect.above]
    if not layers:
        return model.fit(touch, held_out=False)
    plain = Model(*(effect for effect in model.effects if not effect.above))
    found = plain.fit(touch, held_out=False)
    if found.left.excess == 0.0:  # noise alone is left: nothing is missing
        return found
    layered = model.fit(touch, held_out=False)
    return layered if all(_shown(effect, layered) for effect in layers) and _explains(layered, found) else found


def _explains(layered: Fit, plain: Fit) -> bool:
    """Whether layers take off more of the squared error beyond noise than they leave."""
    return layered.left.excess**2 < TAKEN_OFF * plain.left.excess**2


def _shown(effect: Effect, fit: Fit) -> bool:
    """Whether a fit is sure of a layer, and of one that can be."""
    values = {name: p.value for name, p in fit.parameters.items()}
    place = fit.model.place(effect.id, fit.layout)
    error = np.sqrt(np.diag(fit.solution.covariance)[place])
    own = {p.name: float(v) for p, v in zip(effect.parameters(fit.layout), fit.values[place])}
    sure = all(abs(v - effect.null[n]) > SURE * e for (n, v), e in zip(own.items(), error) if n in effect.null)
    return sure and bool(np.isfinite(error).all()) and not effect.implausible(own, values, fit.experiment.signals)


def mapped(model: Model, fits: Sequence[Fit]) -> Mapped:
    """What a map calls all parameters of a model, of which fits may lack layers."""
    parameters = _parameters(model, fits[-1])
    for fit in fits:
        parameters |= {name: p for name, p in fit.model.parameters(fit.layout).items() if name in parameters}
    names, weights = {name: property_name(name, model, parameters) for name in parameters}, np.eye(len(parameters))
    keys = list(parameters)
    for effect in model.effects:
        for own, name in effect.above.items():
            mine, base = f"{effect.id}.{own}", _of_base(model, own, parameters)
            if base is None or parameters[base].unit != parameters[mine].unit:
                continue
            names |= {mine: name, base: own}
            i, j = keys.index(mine), keys.index(base)
            weights[[i, j]] = 0.0
            weights[i, j] = weights[j, i] = weights[j, j] = 1.0
    return Mapped(tuple(names.values()), tuple(p.unit for p in parameters.values()), weights)


def estimates(fit: Fit, model: Model, called: Mapped) -> tuple[Array, Array]:
    """Values (p,) and covariance (p, p) of a map's properties; infinite where a touch leaves one open."""
    keys, own = list(_parameters(model, fit)), list(fit.model.parameters(fit.layout))
    at = [keys.index(name) for name in own]
    lacks = np.setdiff1d(np.arange(len(keys)), at)
    weights = called.weights.copy()
    for k in lacks:  # without the layer a base's value is the body's alone
        weights[:, k] = 0.0
        weights[k] = 0.0
    mine = fit.solution.covariance
    values, covariance = np.zeros(len(keys)), np.zeros((len(keys), len(keys)))
    open_ = np.ones(len(keys), np.bool_)
    values[at] = fit.values
    covariance[np.ix_(at, at)] = np.where(np.isfinite(mine), mine, 0.0)
    open_[at] = ~np.isfinite(np.diag(mine))
    unknown = (np.abs(weights) @ open_ > 0) | np.isin(np.arange(len(keys)), lacks)
    covariance = weights @ covariance @ weights.T
    covariance[np.diag_indices_from(covariance)] += np.where(unknown, np.inf, 0.0)
    return weights @ values, covariance


def _parameters(model: Model, fit: Fit) -> dict[str, Parameter]:
    """Of a model in its order, as a fit has them where it does."""
    fitted = fit.model.parameters(fit.layout)
    out: dict[str, Parameter] = {}
    for effect in model.effects:
        own = {name: p for name, p in fitted.items() if name.startswith(f"{effect.id}.")}
        out |= own or {f"{effect.id}.{p.name}": p for p in effect.parameters(fit.layout)}
    return out


def _of_base(model: Model, own: str, parameters: dict[str, Parameter]) -> str | None:
    """The contact law's parameter of a name, None without one."""
    base = model.contact_law
    name = "" if base is None else f"{base.id}.{own}"
    return name if name in parameters else None


def property_name(name: str, model: Model, parameters: dict[str, Parameter]) -> str:
    """What maps call a parameter; else its name, without its effect where that is clear."""
    effect, own = name.split(".", 1)
    if own in model[effect].map_names:
        return model[effect].map_names[own]
    return own if sum(other.split(".", 1)[1] == own for other in parameters) == 1 else name
