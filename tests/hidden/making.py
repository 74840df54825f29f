"""Cases with nothing, one or two hidden effects, or with what no catalogue holds, made in any world of contact."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from functools import partial
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

import kinid
from hidden.case import Case
from hidden.draw import WEAK, Stream, choose, tuned, wanted
from hidden.world.hiding import HIDEABLE, LINEAR, POWER, Plan
from hidden.world.strange import KINDS, MOST, STARTS, Strange

Array = NDArray[np.float64]


class Bench(Protocol):
    """A motion, a setup whose readings a starting model describes fully, and how to record a log of any other setup."""

    base: str
    deep: float
    setup: Any
    model: tuple[str, ...]
    seed: Stream
    rig: kinid.Rig

    def matters(self, setup: Any, proxies_too: bool = False) -> float:
        """What this setup leaves in the residual of the starting model, as a multiple of the noise.

        With `proxies_too` so much is absorbed too as the catalogue's effects can follow, each in its simplest form.
        """

    def log(self, setup: Any) -> kinid.Log:
        """What is recorded."""


@dataclasses.dataclass(frozen=True)
class Place:
    """A world: its name, the effects that it can hide, and its benches (stream, base, with slip, without friction)."""

    name: str
    hideable: tuple[str, ...]
    bench: Callable[[Stream, str, bool, bool], Bench]
    always_slips: bool = False


def case_of(place: Place, kind: str, bench: Bench, setup: Any, truth: tuple[str, ...], number: int, note: str) -> Case:
    """The case of a setup on a bench."""
    name = f"{kind}/{place.name}/{'+'.join(truth) or 'none'}/{number}"
    return Case(
        name,
        kind,
        bench.log(setup),
        bench.rig,
        bench.model,
        frozenset(truth),
        (*bench.model, *truth),
        bench.seed.number,
        note,
    )


def nothing(place: Place, number: int, seed: int) -> Case:
    """Nothing hidden."""
    base = choose(LINEAR + POWER, number, seed, "base")
    bench = place.bench(Stream(seed, place.name, "none", number), base, place.always_slips or number % 3 != 2, False)
    return case_of(place, "none", bench, bench.setup, (), number, f"{base}, nothing else")


def hidden(place: Place, count: int, number: int, seed: int) -> Case:
    """One or two hidden effects; draws again where a log can't show what was drawn."""
    kind = {1: "single", 2: "pair"}[count]
    first = choose(place.hideable, number, seed, kind + place.name)
    for attempt in range(20):
        stream = Stream(seed, place.name, kind, number, attempt)
        rng = stream.generator("what")
        names = (first,) if count == 1 else (first, _second(rng, first, place.hideable))
        bases = [base for base in LINEAR + POWER if all(base in HIDEABLE[name].bases for name in names)]
        slip = place.always_slips or any(HIDEABLE[name].slip for name in names) or rng.uniform() < 0.7
        bench = place.bench(stream, str(rng.choice(bases)), slip, "coulomb-friction" in names)
        setup, notes, enough = bench.setup, [], True
        for name in names:
            plan = HIDEABLE[name].draw(rng, bench.deep, bench.base)
            size, found = _sized(bench, plan, wanted(rng))
            setup = plan.put(setup, size)
            notes.append(f"{name} of size {size:.3g}, {found:.3g} times the noise")
            enough = enough and found > 0.75 * WEAK
        if enough:
            return case_of(place, kind, bench, setup, names, number, f"{bench.base}; " + "; ".join(notes))
    raise RuntimeError(f"{first} can't be hidden in {place.name}")


def outside(place: Place, number: int, seed: int) -> Case:
    """Something that no catalogue holds."""
    kind = choose(KINDS, number, seed, "outside" + place.name)
    for attempt in range(20):
        stream = Stream(seed, place.name, "outside", number, attempt)
        rng = stream.generator("what")
        slip = place.always_slips or kind in ("texture", "stick-slip", "cable") or rng.uniform() < 0.7
        bench = place.bench(stream, str(rng.choice(LINEAR + POWER)), slip, False)
        shape = int(rng.integers(2**31))
        put = partial(_strange, kind, shape)
        size, found = _sized(
            bench, Plan(put, 0.0, MOST.get(kind, np.inf), STARTS[kind]), wanted(rng, 0.6), proxies=True
        )
        if found > 0.45:
            case = case_of(
                place,
                "outside",
                bench,
                put(bench.setup, size),
                (),
                number,
                f"{bench.base}; {kind} of size {size:.3g}, {found:.3g} times the noise",
            )
            return dataclasses.replace(case, name=f"outside/{place.name}/{kind}/{number}")
    raise RuntimeError(f"{kind} can't be seen in {place.name}")


def _strange(kind: str, shape: int, setup: Any, size: float) -> Any:
    return dataclasses.replace(setup, strange=Strange(kind, size, shape))


def _sized(bench: Bench, plan: Plan, aim: float, proxies: bool = False) -> tuple[float, float]:
    return tuned(lambda size: bench.matters(plan.put(bench.setup, size), proxies), plan.start, plan.low, plan.high, aim)


def _second(rng: np.random.Generator, first: str, names: tuple[str, ...]) -> str:
    """Another effect of another family that some base shows together with the first."""
    fit = [
        name
        for name in names
        if HIDEABLE[name].family != HIDEABLE[first].family
        and set(HIDEABLE[name].bases) & set(HIDEABLE[first].bases)
        and not _clash(first, name)
    ]
    return str(rng.choice(fit))


def _clash(one: str, other: str) -> bool:
    """Whether an effect needs what the other one hides: friction of some form without friction."""
    rubbing = {"stribeck-friction", "presliding", "load-dependent-friction", "friction-anisotropy"}
    return "coulomb-friction" in (one, other) and bool(rubbing & {one, other})
