"""The virtual mould's truth, beside maps of it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pyarrow.parquet as pq

from kinid.lab.materials import MOULD
from kinid.mapping.exploration import Region
from kinid.mapping.interpolation import PlaneSites
from kinid.mapping.interpolation.triangles import Triangles

#: of the virtual arm's impedance controller [N/m]: under it the tip goes less deep where the material is stiff
IMPEDANCE = 5200.0


def felt(x, y):
    """What one spring is, that pushes back like the mould over the depths of a poke: under the film the law has a
    bend.
    """
    p = MOULD.at(x, y)
    wave = 3e-3 + 1.5e-3 * np.sin(np.linspace(0, 2 * np.pi, 100, endpoint=False))
    k = p["stiffness"] + p["layer"]
    for _ in range(40):
        depth = wave * (IMPEDANCE / (IMPEDANCE + k))[..., None]
        force = p["stiffness"][..., None] * depth + p["layer"][..., None] * np.maximum(
            depth - p["layer_depth"][..., None], 0
        )
        k = np.sum(force * depth, axis=-1) / np.sum(depth**2, axis=-1)
    return k


def errors_of(grown):
    """Mean relative errors of a map of the mould, over all of the region as `Triangles` have it, and away from borders
    as the Gaussian process has it: both where the film doesn't lie, and both everywhere.
    """
    q = Region((-0.045, -0.045), (0.045, 0.045)).grid(45)
    values = grown.values("stiffness")
    made = Triangles(PlaneSites(grown.flat(grown.places), reach=1.0), values, 0.005 * values).at(q).mean
    ticks = grown.grid(100)
    x, y = (part.ravel() for part in np.meshgrid(*ticks, indexing="ij"))
    guess = grown.over_grid("stiffness", ticks)
    away = (np.abs(x - 1.5e-3 * np.sin(90 * y)) > 0.01) & (np.abs(y + 1.2e-3 * np.sin(110 * x)) > 0.01)
    away &= (np.maximum(np.abs(x), np.abs(y)) < 0.04) & (np.abs(np.minimum(x, y) - 0.012) > 0.01) & guess.known.ravel()
    over = np.abs(made / felt(*q.T) - 1), np.abs(guess.mean.ravel() / felt(x, y) - 1)[away]
    bare = q.min(axis=1) < 0.009, np.minimum(x, y)[away] < 0.009
    return [float(np.mean(e[rows])) for e, rows in zip(over, bare)], [float(np.mean(e)) for e in over]


def covered(grown, folder):
    """How often 95 % intervals of stiffness and damping hold the truth where the tip was: at all places where no film
    lies, and at those of them that aren't at the rim, where the material changes under the tip; and their median half
    width, as a share of the value.
    """
    inside, rim, half = [], [], []
    for probe in grown.probes:
        name = Path(probe.source).stem
        way = pq.read_table(folder / "truth" / f"{name}.parquet", columns=["slip1", "slip2", "depth"])
        x, y, depth = (way[column].to_numpy() for column in way.column_names)
        place = np.average([x, y], axis=1, weights=np.maximum(depth, 0.0) ** 2)
        if place.min() > 0.01:
            continue
        there = MOULD.at(*place[:, None])
        truth = np.array([there["stiffness"][0] + there["layer"][0], there["damping"][0]])
        sd = np.sqrt(np.diag(probe.covariance))
        inside.append(np.abs(probe.values - truth) <= 1.96 * sd)
        half.append(1.96 * sd / probe.values)
        rim.append(np.abs(place).max() > 0.04)
    held, bulk = np.array(inside), ~np.array(rim)
    return held.mean(axis=0), held[bulk].mean(axis=0), np.median(half, axis=0)
