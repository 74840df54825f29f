"""What the best conceivable poke would tell: depths and speeds chosen at will, jumping from one to the next.

No motion within the same bounds tells more than the optimal design measure over all pairs of depth and rate (Kiefer &
Wolfowitz 1960). It is found by the multiplicative algorithm (Silvey, Titterington & Torsney 1978). It holds for laws
without memory, whose force depends on depth and rate alone.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from kinid.identification.fit import Z95
from kinid.planning.expected import Law
from kinid.planning.information import cost, information, sensitivities, sizes
from kinid.planning.poke_design import Bounds

Array = NDArray[np.float64]

#: depths and rates tried, and rounds of the algorithm
DEPTHS, RATES, ROUNDS = 48, 17, 600
#: share of the whole that is added in every direction
RIDGE = 1e-12


def has_memory(law: Law) -> bool:
    """Whether the force depends on more than depth and rate: then samples in another order give other forces."""
    rng = np.random.default_rng(0)
    t = np.linspace(0.0, 2.0, 200)
    depth, rate = rng.uniform(0.0, 0.01, 200), rng.uniform(-0.05, 0.05, 200)
    order = rng.permutation(200)
    one, two = law(law.signals(t, depth, rate))[2], law(law.signals(t, depth[order], rate[order]))[2]
    return not np.allclose(one[order], two, rtol=1e-9, atol=1e-12)


def ideal_information(law: Law, bounds: Bounds, *, criterion: str, noise: float, rate: float) -> Array | None:
    """Fisher's information of relative changes of the parameters that a poke tells, (p, p), by the optimal
    measure; None for a law with memory.

    Args:
        law, bounds, criterion, noise [N], rate [Hz]: as for `kinid.planning.excite.optimise`.
    """
    if has_memory(law):
        return None
    rows = _rows(law, bounds)
    rows = rows[:, np.any(rows != 0.0, axis=0)]
    weight = np.full(len(rows), 1.0 / len(rows))
    for _ in range(ROUNDS):
        seen = rows @ np.linalg.pinv(rows.T @ (weight[:, None] * rows))
        # D: s M⁻¹ s; A: s M⁻² s, of which the square root keeps the rounds from going back and forth
        weight *= np.sum(seen * rows, axis=1) if criterion == "D" else np.linalg.norm(seen, axis=1)
        weight /= weight.sum()
    each = np.sqrt(weight)[:, None] * rows
    return information(each[None], np.array([noise]), bounds.duration * rate)


def least_halves(law: Law, bounds: Bounds, *, noise: float, rate: float) -> dict[str, float] | None:
    """Half-widths of 95 % intervals that no motion within the bounds goes below, for each parameter by itself.

    For each the c-optimal measure (Elfving, Annals of Mathematical Statistics 23, 1952), by the same kind of algorithm;
    no motion has all of them at once. Arguments as of `ideal_information`; None for a law with memory.
    """
    if has_memory(law):
        return None
    rows, named = _rows(law, bounds), law.model.parameters(law.layout())
    rows = rows * np.sqrt(bounds.duration * rate) / noise
    out = {}
    for k, (name, size) in enumerate(zip(named, sizes(law.vector, named))):
        weight, one = np.full(len(rows), 1.0 / len(rows)), np.eye(len(named))[k]
        for _ in range(ROUNDS):
            weight *= np.abs(rows @ np.linalg.solve(_ridged(rows, weight), one))
            weight /= weight.sum()
        out[name] = float(Z95 * size * np.sqrt(np.linalg.inv(_ridged(rows, weight))[k, k]))
    return out


def _ridged(rows: Array, weight: Array) -> Array:
    """Information of a measure; a c-optimal one may leave other directions open, which a little of all of them
    closes.
    """
    matrix = rows.T @ (weight[:, None] * rows)
    out: Array = matrix + RIDGE * np.trace(matrix) * np.eye(len(matrix))
    return out


def _rows(law: Law, bounds: Bounds) -> Array:
    """What relative changes of the parameters do to the force, at each pair of depth and rate that is allowed, (n,
    p).
    """
    pairs: list[Array] = [
        part.ravel().astype(np.float64)
        for part in np.meshgrid(
            np.linspace(bounds.shallowest, bounds.deepest, DEPTHS), np.linspace(-bounds.speed, bounds.speed, RATES)
        )
    ]
    signals = law.signals(np.arange(len(pairs[0]), dtype=np.float64), *pairs)
    named = law.model.parameters(law.layout())
    found = sensitivities(lambda values: law.model.predict(signals, values)[:1], law.vector, named)
    out: Array = found[0][law(signals)[2] <= bounds.force]
    return out


def efficiency(reached: Array, ideal: Array, criterion: str) -> float:
    """In what share of its time the ideal one would tell as much as a motion, 0…1."""
    return float(
        np.exp(2.0 * (cost(ideal, criterion) - cost(reached, criterion)) / (len(ideal) if criterion == "D" else 1))
    )
