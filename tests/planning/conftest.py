"""A rig to plan for, and ways to plan at random."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

import kinid
from kinid.planning import Law, Multisine, Planner, Poke, Protocol, Slide

TABLES: dict[str, Any] = {
    "robot": {"model": "lwr4plus"},
    "tool": {"mass": 0.24, "com": (0.0, 0.0, 0.049)},
    "surface": {"point": (0.55, 0.0, 0.10), "normal": (0, 0, 1), "tangent": (1, 0, 0)},
}


@pytest.fixture(scope="session")
def rig() -> Any:
    return kinid.Rig.parse(TABLES)


@pytest.fixture(scope="session")
def law() -> Law:
    return Law(kinid.Model("hunt-crossley"), {"stiffness": 1200.0, "damping": 1500.0, "exponent": 1.2})


@pytest.fixture(scope="session")
def drawn() -> Callable[[int], tuple[Planner, list[Any]]]:
    """A planner and touches by a seed: surface, paces, pokes and slides at random."""

    def make(seed: int) -> tuple[Planner, list[Any]]:
        rng = np.random.default_rng(seed)
        normal = np.array([*rng.uniform(-0.3, 0.3, 2), 1.0])
        point = np.array([0.55, 0.0, 0.12]) + rng.uniform(-1, 1, 3) * [0.1, 0.25, 0.06]
        tables = TABLES | {"surface": {"point": tuple(point), "normal": tuple(normal)}}
        default = Protocol()
        protocol = Protocol(
            height=rng.uniform(0.01, 0.03),
            rate=250.0,
            travel=default.travel.slower(rng.uniform(0.3, 2.0)),
            contact=default.contact.slower(rng.uniform(0.5, 2)),
        )
        touches: list[Any] = []
        for _ in range(rng.integers(1, 3)):
            place = tuple(rng.uniform(-0.03, 0.03, 2))
            if rng.random() < 0.6:
                base = rng.uniform(0.002, 0.012)
                sines = tuple(
                    (rng.uniform(0.1, 0.5) * base, rng.uniform(0.3, 3.0), rng.uniform(0, 6))
                    for _ in range(rng.integers(1, 4))
                )
                touches.append(Poke(place, Multisine(base, sines, rng.uniform(1.0, 3.0)), rng.uniform(0, 0.5)))
            else:
                corners = (place, *(tuple(place + rng.uniform(-0.02, 0.02, 2)) for _ in range(rng.integers(1, 3))))
                back = bool(rng.random() < 0.5)
                touches.append(Slide(corners, rng.uniform(0.001, 0.004), rng.uniform(0.004, 0.02), 0.2, back))
        law = Law(kinid.Model("hunt-crossley", "coulomb-friction"), {"stiffness": 2000.0, "exponent": 1.3})
        return Planner(kinid.Rig.parse(tables), protocol, law), touches

    return make
