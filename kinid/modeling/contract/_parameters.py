"""Rules about an effect's parameters: names, units, bounds, and values worth starting from."""

from __future__ import annotations

import re
from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from kinid.modeling.contract._case import Case, Rule, demand, short
from kinid.parameter import Parameter
from kinid.units import SI

Array = NDArray[np.float64]

#: of a name: kebab-case, perhaps a joint or channel in brackets
NAME = re.compile(r"[a-z]+(-[a-z0-9]+)*\d?(\[[^\]]+\])?")
#: values of a grid: more take long, one is a nominal value
FEWEST, MOST = 2, 8


def names(case: Case) -> str:
    """Each parameter has a name of its own and a symbol."""
    listed = case.effect.parameters(case.signals.layout)
    demand(len(case.own) == len(listed), f"a name twice in {', '.join(p.name for p in listed)}")
    demand(listed or case.kind.base, "no parameter")
    for p in listed:
        demand(NAME.fullmatch(p.name), f"a parameter '{p.name}'")
        demand(p.symbol, f"no symbol of {p.name}")
    return _joined(case)


def units(case: Case) -> str:
    """Units are SI."""
    for p in case.own.values():
        demand(p.unit and SI.fullmatch(p.unit), f"{p.name} in '{p.unit}'")
    return ", ".join(dict.fromkeys(p.unit for p in case.own.values())) or "none"


def bounds(case: Case) -> str:
    """True values and nulls lie within the bounds, and linear parameters may be zero."""
    for name, p in case.own.items():
        value = case.values[case.places[list(case.own).index(name)]]
        demand(np.isfinite([p.nominal, p.scale]).all(), f"{name} of nominal {p.nominal} and scale {p.scale}")
        demand(p.low <= value <= p.high, f"{name} = {value:g} in the example, within {p.low:g} to {p.high:g}")
        demand(not p.linear or p.low <= 0.0 <= p.high, f"{name} is linear, within {p.low:g} to {p.high:g}")
    before = {short(name) for name in case.own}
    if not case.kind.base:
        demand(case.null, "no null")
        demand(set(case.null) <= before, f"null of {', '.join(sorted(set(case.null) - before))}")
    for name, p in case.own.items():
        null = case.null.get(short(name), p.nominal)
        demand(p.low <= null <= p.high, f"null of {name} = {null:g}, within {p.low:g} to {p.high:g}")
    return "; ".join(f"{p.low:g} to {p.high:g} {p.unit}" for p in _kinds(case)) or "no parameter"


def admissible(case: Case) -> str:
    """True, nominal and null values are possible; what lies outside of a stated range is told."""
    kind, layout = case.effect, case.signals.layout
    every = dict(zip(case.named, case.values.tolist()))
    for said, values in (
        ("true", case.values),
        ("nominal", case.model.nominal(layout)),
        ("null", case.at_null),
    ):
        named = dict(zip(case.named, values.tolist()))
        wrong = kind.implausible({key: named[f"{case.name}.{key}"] for key in case.own}, named, case.signals)
        demand(not wrong, f"{said} values that can't be: {wrong}")
    known = {key for p in case.own.values() for key in (short(p.name), f"{short(p.name)}[{p.unit}]")}
    for attribute in ("admissible", "calibration_tolerance", "unremarkable", "tolerated", "tolerated_in_joints"):
        stated = getattr(kind, attribute)
        demand(not stated or known & set(stated), f"{attribute} of {', '.join(stated)}, no parameters of it")
    for name, p in case.own.items():
        low, high = kind.admissible_range(p) or (-np.inf, np.inf)
        demand(low < high, f"{name} possible from {low:g} to {high:g}")
        for end, beyond in ((low, low - p.scale), (high, high + p.scale)):
            own = {key: every[f"{case.name}.{key}"] for key in case.own} | {name: beyond}
            refused = not np.isfinite(end) or kind.implausible(
                own, every | {f"{case.name}.{name}": beyond}, case.signals
            )
            demand(refused, f"{name} = {beyond:g} taken for possible")
    return f"{len(kind.admissible)} ranges" if kind.admissible else "any value"


def starts(case: Case) -> str:
    """Shapes, which mean nothing where the effect does nothing, have values to start from, which predictions bear."""
    effect, named = case.effect, {short(name): p for name, p in case.own.items()}
    demand(set(effect.grid) <= set(named), f"a grid of {', '.join(sorted(set(effect.grid) - set(named)))}")
    shapes = {key for key, p in named.items() if not p.linear} - set(case.null)
    lacking = set() if effect.detector or effect.base else shapes - set(effect.grid)
    demand(not lacking, f"no grid of {', '.join(sorted(lacking))}")
    for key, values in effect.grid.items():
        demand(FEWEST <= len(values) <= MOST and list(values) == sorted(set(values)), f"{key}: {values} in the grid")
        wrong = [value for value in values if not named[key].low <= value <= named[key].high]
        demand(not wrong, f"{key} = {wrong[:1]} in the grid, outside of its bounds")
    found = list(effect.initial_guesses(case.signals))
    demand(bool(found) == bool(effect.grid), f"{len(found)} starts for a grid of {len(effect.grid)} parameters")
    _check_starts(case, found)
    return f"{len(found)} starts" if found else "the nominal values serve"


def prior(case: Case) -> str:
    """A prior is a precision, symmetric and positive; a log's own form of an effect stays what it is."""
    effect, layout = case.effect, case.signals.layout
    own = effect.for_log(case.measured)
    demand(own.id == case.name, f"'{own.id}' for this log")
    demand(own.for_log(case.measured) is own, "another form for this log at the second time")
    precision, count = effect.prior(layout), len(case.own)
    if precision is None:
        learnt = effect.learnt(layout, np.eye(count), np.ones(count))
        demand(learnt is effect, "something learnt about no prior")
        return "no prior"
    demand(precision.shape == (count, count), f"a precision of shape {precision.shape} for {count} parameters")
    demand(np.array_equal(precision, precision.T), "a precision that isn't symmetric")
    demand(np.linalg.eigvalsh(precision).min() > 0.0, "a precision that isn't positive")
    return f"of {count} parameters"


def _check_starts(case: Case, found: list[Array]) -> None:
    low, high = (np.array([getattr(p, end) for p in case.own.values()]) for end in ("low", "high"))
    for start, full in zip(found, case.starts()):
        demand(((start >= low) & (start <= high)).all(), f"a start {start} out of bounds")
        demand(np.isfinite(case.model.predict(case.signals, full)).all(), f"no finite prediction from {start}")


def _kinds(case: Case) -> Iterator[Parameter]:
    """The parameters, one of each name before the bracket."""
    return iter({short(name): p for name, p in case.own.items()}.values())


def _joined(case: Case) -> str:
    return ", ".join(f"{short(p.name)} ({p.symbol})" for p in _kinds(case)) or "no parameter"


PARAMETERS = (
    Rule("parameters", names, "names in kebab-case, each once, with a symbol", "rename or complete them"),
    Rule("units", units, "SI units, such as N·s/m or 1", "write the parameter in SI"),
    Rule("bounds", bounds, "true values, nulls, and zero of what is linear, within", "widen them, or mend null"),
    Rule("admissible", admissible, "ranges with true, nominal and null values within", "correct `admissible`"),
    Rule("starts", starts, "2 to 8 growing values of each shape", "give shapes a `grid` within their bounds"),
    Rule("prior", prior, "a symmetric, positive precision, or none", "correct `prior`, `learnt` or `for_log`"),
)
