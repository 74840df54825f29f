"""Formulas of what is done to forces of a material, from measured depth and slip: branches, sliders, threads,
springs.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize_scalar
from scipy.signal import lfilter

from measured.changes import Draw, Shape, bias, clip, drift, hum, lag, late, lattice
from measured.scene import Scene

Array = NDArray[np.float64]

#: sliders of a bundle; they slip at lengths spread over this factor
SLIDERS, SPREAD = 8, 4.0


def elastic_force(scene: Scene) -> Array:
    """A power law of the depth, fitted to the measured normal force here, (n,)."""
    x, y = scene.inside / max(scene.inside.max(), 1e-12), scene.readings[:, 0]

    def law(n: float) -> Array:
        shape = x**n
        return np.asarray(shape * (shape @ y / max(shape @ shape, 1e-300)))

    best = minimize_scalar(lambda n: float(((y - law(n)) ** 2).sum()), bounds=(0.8, 3.0), method="bounded")
    return law(float(best.x))


def normal(scene: Scene, force: Array, rng: np.random.Generator | None = None, note: str = "") -> Shape:
    """A change of the normal force alone, with either sign where a generator draws it."""
    column = np.zeros_like(scene.readings)
    column[:, 0] = force
    return Shape(column[None], np.ones(1) if rng is None else rng.choice([-1.0, 1.0], 1), rng is not None, note)


def relaxation(scene: Scene, rng: np.random.Generator) -> Shape:
    """A Maxwell branch beside the spring: what is left of each increment of the elastic force after a time."""
    tau = float(np.exp(rng.uniform(np.log(0.08), np.log(2.0))))
    force, keep = elastic_force(scene), float(np.exp(-scene.log.period / tau))
    return normal(scene, lfilter([np.sqrt(keep)], [1, -keep], np.diff(force, prepend=force[0])), note=f"{tau:.2g} s")


def hysteresis(scene: Scene, rng: np.random.Generator) -> Shape:
    """A bundle of springs that slip, each at its own length: a loop that speed does not change."""
    depth = scene.inside
    length = float(rng.uniform(0.03, 0.15)) * depth.max()
    slips = length * np.geomspace(1 / SPREAD, SPREAD, SLIDERS)
    x, out = np.zeros(SLIDERS), np.zeros(len(depth))
    for i in range(1, len(depth)):
        x = np.clip(x + depth[i] - depth[i - 1], -slips, slips) if depth[i] > 0 else np.zeros(SLIDERS)
        out[i] = (x / slips).mean()
    return normal(scene, out, note=f"sliders of {1e3 * length:.2g} mm")


def adhesion(scene: Scene, rng: np.random.Generator) -> Shape:
    """Threads that the contact has made pull on the way out, and break outside, each at its own length."""
    offset = scene.inside.max() - scene.smooth(scene.depth).max()
    depth, length = scene.smooth(scene.depth) + offset, float(rng.uniform(0.05, 0.2)) * scene.inside.max()
    out, most = np.zeros(len(depth)), 0.0
    for i, d in enumerate(depth):
        most = max(most, d) if d > 0 or (most > 0 and d > -2 * length) else 0.0
        if most > 0:
            out[i] = -min(1.0, (most - d) / length) * np.clip(1.0 + min(d, 0.0) / (2 * length), 0.0, 1.0)
    return normal(scene, out, note=f"threads of {1e3 * length:.2g} mm")


def layer(scene: Scene, rng: np.random.Generator) -> Shape:
    """A second spring behind a gap."""
    at = float(rng.uniform(0.35, 0.7)) * scene.inside.max()
    return normal(scene, np.maximum(scene.inside - at, 0.0), note=f"from {1e3 * at:.2g} mm on")


def curvature(scene: Scene, rng: np.random.Generator) -> Shape:
    """A force that bends up with the depth as under a sphere."""
    return normal(scene, scene.inside**1.5)


def dashpot(scene: Scene, rng: np.random.Generator) -> Shape:
    """A linear dashpot inside the material; it never pulls more than the material pushes."""
    return normal(scene, scene.rate(scene.depth) * (scene.inside > 0) * (scene.readings[:, 0] > 0))


def loaded_dashpot(scene: Scene, rng: np.random.Generator) -> Shape:
    """Damping that grows with the elastic force."""
    return normal(scene, scene.rate(scene.depth) * elastic_force(scene))


def compliance(scene: Scene, rng: np.random.Generator) -> Shape:
    """A soft mount in series: it takes depth in proportion to the force, to first order."""
    force = elastic_force(scene)
    order = np.argsort(scene.inside)
    x, y = scene.inside[order], force[order]
    grid = np.linspace(0.0, x[-1], 200)
    slope = np.gradient(np.interp(grid, x, y), grid)
    return normal(scene, -force * np.interp(scene.inside, grid, slope))


def softening(scene: Scene, rng: np.random.Generator) -> Shape:
    """Mullins: less force below the deepest past depth."""
    deepest = np.maximum.accumulate(scene.inside)
    length = float(rng.uniform(0.1, 0.4)) * scene.inside.max()
    softer = 1.0 - np.exp(-(deepest - scene.inside) / length)
    return normal(scene, -elastic_force(scene) * softer, note=f"{1e3 * length:.2g} mm")


def ageing(scene: Scene, rng: np.random.Generator) -> Shape:
    """All forces of the material grow or fade with the time."""
    return Shape((scene.readings * (scene.log.t - scene.log.t[0])[:, None])[None], rng.choice([-1.0, 1.0], 1))


# ------------------------------------------------------------------------------------------------------------- sliding


def _slip(scene: Scene) -> tuple[Array, Array, Array]:
    """Direction of the slip (n, 2), its speed (n,), and the normal force (n,)."""
    v = np.stack([scene.rate(np.asarray(scene.log.contact[f"slip{i}"]), 6.0) for i in (1, 2)], axis=1)
    speed = np.sqrt((v**2).sum(axis=1))
    return v / np.sqrt(speed**2 + (0.02 * speed.max()) ** 2)[:, None], speed, np.maximum(scene.readings[:, 0], 0.0)


def tangential(
    scene: Scene, force: Array, signed: bool = False, rng: np.random.Generator | None = None, note: str = ""
) -> Shape:
    """A change of the tangential forces (n, 2)."""
    column = np.zeros_like(scene.readings)
    column[:, 1:] = force
    return Shape(column[None], np.ones(1) if rng is None else rng.choice([-1.0, 1.0], 1), signed, note)


def dry(scene: Scene, rng: np.random.Generator) -> Shape:
    """Against the slip, in proportion to the load."""
    way, _, load = _slip(scene)
    return tangential(scene, -load[:, None] * way)


def viscous(scene: Scene, rng: np.random.Generator) -> Shape:
    """Against the slip, in proportion to its speed."""
    way, speed, load = _slip(scene)
    return tangential(scene, -(speed * (load > 0))[:, None] * way)


def slow(scene: Scene, rng: np.random.Generator) -> Shape:
    """More friction when slow."""
    way, speed, load = _slip(scene)
    share = float(rng.uniform(0.15, 0.4))
    return tangential(
        scene,
        -(load * np.exp(-((speed / (share * np.percentile(speed, 95))) ** 2)))[:, None] * way,
        note=f"within {share:.2g} of the top speed",
    )


def by_load(scene: Scene, rng: np.random.Generator) -> Shape:
    """A coefficient that changes with the load: N ln N, the first term of a power."""
    way, _, load = _slip(scene)
    ratio = np.maximum(load / load.mean(), 1e-3)
    return tangential(scene, -(load * np.log(ratio))[:, None] * way, True, rng)


def two_ways(scene: Scene, rng: np.random.Generator) -> Shape:
    """More friction along than across."""
    way, _, load = _slip(scene)
    return tangential(scene, -load[:, None] * way * [1.0, -1.0], True, rng)


_CLOCK: dict[str, Draw] = {"time-offset": late, "sensor-lag": lag}
_CONVERTER: dict[str, Draw] = {"sensor-drift": drift, "quantization": lattice, "saturation": clip}
PRESS: dict[str, Draw] = {
    "relaxation": relaxation,
    "hysteresis": hysteresis,
    "stiffening-layer": layer,
    "viscous-damping": dashpot,
    "structural-compliance": compliance,
    "stress-softening": softening,
    "stiffness-drift": ageing,
    **_CLOCK,
    **_CONVERTER,
    "mains-hum": hum,
}
CYCLES: dict[str, Draw] = {
    **{name: draw for name, draw in PRESS.items() if name != "relaxation"},
    "adhesion": adhesion,
    "hunt-crossley-damping": loaded_dashpot,
    "sensor-bias": bias,
}
PLACES: dict[str, Draw] = {
    "hertz-exponent": curvature,
    "stiffening-layer": layer,
    "structural-compliance": compliance,
    "stiffness-drift": ageing,
    "sensor-bias": bias,
    **_CONVERTER,
}
SLIDE: dict[str, Draw] = {
    "coulomb-friction": dry,
    "viscous-friction": viscous,
    "stribeck-friction": slow,
    "load-dependent-friction": by_load,
    "friction-anisotropy": two_ways,
    "stiffness-drift": ageing,
    "sensor-bias": bias,
    **_CLOCK,
    **_CONVERTER,
}
