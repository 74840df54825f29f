"""For each effect a model that it lives in, true values, and a motion that excites it. Arrays are read-only.

`EXAMPLES` maps an effect's id to an `Example`; a neighbour `_examples_*.py` that has an `EXAMPLES` of its own, of the
same shape, is merged in by the contract suite.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache

import numpy as np
from numpy.typing import NDArray

from kinid.effects import Effect, Layout, Signals
from kinid.effects.stiffness_inhomogeneity import StiffnessInhomogeneity

Array = NDArray[np.float64]
CHANNELS = ("normal_force", "tangential_force1", "tangential_force2")


@dataclass(frozen=True, eq=False)
class Example:
    """One effect at work.

    Attributes:
        model: the model's effects, this one among them.
        values: true values by "effect.parameter"; those not named are nominal.
        signals: motion that excites the effect.
    """

    model: tuple[str | Effect, ...]
    values: Mapping[str, float]
    signals: Signals


def read_only(*arrays: Array) -> tuple[Array, ...]:
    """The arrays, closed for writing."""
    for array in arrays:
        array.setflags(write=False)
    return arrays


def glide(t: Array, *knots: tuple[float, float]) -> tuple[Array, Array]:
    """Value [m] and rate of a motion that rests at each knot (time [s], value [mm]) and runs smoothly between them."""
    at, value = np.array(knots).T * np.array([[1.0], [1e-3]])
    k = np.clip(np.searchsorted(at, t, side="right") - 1, 0, len(at) - 2)
    span, rise = at[k + 1] - at[k], value[k + 1] - value[k]
    s = np.clip((t - at[k]) / span, 0.0, 1.0)
    return value[k] + rise * s**3 * (10 - 15 * s + 6 * s**2), rise / span * 30 * s**2 * (1 - s) ** 2


@cache
def contact_motion(n: int = 2400) -> Signals:
    """Pokes of several depths and speeds with holds, partial unloading, and slides both ways; uneven time, a gap."""
    steps = np.random.default_rng(7).uniform(0.3, 1.7, n)
    t = 12.0 * (np.cumsum(steps) - steps[0]) / steps.sum()
    depth, rate = glide(
        t,
        (0, -1),
        (0.3, 1.5),
        (0.8, 1.5),
        (0.9, 0.6),
        (1, 1.8),
        (1.6, -1.2),
        (1.8, 4),
        (2.6, 4),
        (2.7, 1),
        (3, 3),
        (3.4, -1),
        (4, -1),
        (4.3, 2),
        (6, 2.1),
        (6.2, 3.2),
        (8, 3),
        (8.1, 5.2),
        (8.6, 4.8),
        (9, -1.5),
        (9.5, 5.5),
        (9.7, -0.4),
        (10.2, 4.5),
        (11.5, 3.5),
        (12, -1),
    )
    slip1, rate1 = glide(
        t,
        (0, -9),
        (1.2, -8.8),
        (1.7, -8),
        (2.4, -7.4),
        (4.2, -9),
        (5, 9),
        (5.1, 8.7),
        (5.2, 9),
        (5.9, -5),
        (7, 6),
        (7.4, 6.5),
        (8.3, -8),
        (8.8, -9),
        (9.6, 2),
        (9.8, 2),
        (10.6, -4),
        (10.7, -3.9),
        (12, 9),
    )
    slip2, rate2 = glide(
        t,
        (0, 4),
        (1.5, 5),
        (3.1, -2),
        (4.4, -6),
        (5.3, -6),
        (6.4, 6),
        (6.5, 5.8),
        (7.5, 5),
        (8.2, -5),
        (9.4, -5),
        (10, 5),
        (10.8, -6),
        (12, 3),
    )
    dt = np.diff(t, prepend=0.0)
    dt[np.searchsorted(t, 5.5)] = 0.0  # memory begins anew in the middle of a slide
    arrays = read_only(t, dt, depth, rate, np.stack([slip1, slip2]), np.stack([rate1, rate2]))
    return Signals(Layout(CHANNELS, "contact"), *arrays)


def contact(*model: str | Effect, **values: float) -> Example:
    """An example in the contact frame; names of values with underscores for "." (twice) and "-"."""
    named = {name.replace("__", ".").replace("_", "-"): value for name, value in values.items()}
    return Example(model, named, contact_motion())


def _profile() -> Example:
    """A bump and a slope over the places that are touched."""
    effect = StiffnessInhomogeneity().for_log(contact_motion())
    assert effect.nodes is not None
    at = 1e3 * effect.nodes.places[:, [k != effect.nodes.reference for k in effect.nodes.kept]]
    profile = 0.3 * np.exp(-((at[0] - 3) ** 2 + at[1] ** 2) / 20) + 0.02 * at[0]
    return Example(
        ("kelvin-voigt", effect),
        {f"stiffness-inhomogeneity.weight[{k}]": float(w) for k, w in zip(effect.nodes.free, profile)},
        contact_motion(),
    )


EXAMPLES: dict[str, Example] = {
    "hooke": contact("hooke", hooke__stiffness=830.0),
    "kelvin-voigt": contact("kelvin-voigt", kelvin_voigt__stiffness=830.0, kelvin_voigt__damping=14.0),
    "hertz": contact("hertz", hertz__stiffness=1.4e4),
    "hunt-crossley": contact(
        "hunt-crossley", hunt_crossley__stiffness=2300.0, hunt_crossley__damping=1700.0, hunt_crossley__exponent=1.31
    ),
    "maxwell": contact("maxwell", maxwell__stiffness=1200.0, maxwell__time_constant=0.8),
    "zener": contact("zener", zener__stiffness=600.0, zener__branch_ratio=0.7, zener__time_constant=0.35),
    "hertz-exponent": contact("hooke", "hertz-exponent", hooke__stiffness=5200.0, hertz_exponent__exponent=1.37),
    "viscous-damping": contact("hertz", "viscous-damping", viscous_damping__damping=11.0),
    "hunt-crossley-damping": contact("hertz", "hunt-crossley-damping", hunt_crossley_damping__damping=2.2),
    "relaxation": contact(
        "kelvin-voigt", "stiffening-layer", "relaxation", relaxation__ratio=0.62, relaxation__time_constant=0.3
    ),
    "hysteresis": contact(
        "kelvin-voigt", "hysteresis", hysteresis__amplitude=0.23, hysteresis__force=0.1, hysteresis__length=0.8e-3
    ),
    "stress-softening": contact(
        "hertz", "stress-softening", stress_softening__ratio=0.3, stress_softening__length=1.2e-3
    ),
    "adhesion": contact(
        "hooke",
        "adhesion",
        "coulomb-friction",
        adhesion__force=0.4,
        adhesion__tack=0.15,
        adhesion__length=0.6e-3,
        adhesion__rise=0.4e-3,
        adhesion__neck=2.6,
    ),
    "stiffening-layer": contact(
        "hooke", "stiffening-layer", stiffening_layer__stiffness=900.0, stiffening_layer__depth=2.3e-3
    ),
    "surface-offset": contact("kelvin-voigt", "surface-offset", "coulomb-friction", surface_offset__offset=2.1e-4),
    "stiffness-drift": contact("hertz", "stiffness-drift", stiffness_drift__rate=1.3),
    "stiffness-inhomogeneity": _profile(),
    "coulomb-friction": contact("hunt-crossley", "coulomb-friction", coulomb_friction__coefficient=0.34),
    "viscous-friction": contact("hooke", "coulomb-friction", "viscous-friction", viscous_friction__damping=7.0),
    "stribeck-friction": contact(
        "hooke",
        "coulomb-friction",
        "stribeck-friction",
        stribeck_friction__coefficient=0.17,
        stribeck_friction__speed=8e-3,
    ),
    "presliding": contact("kelvin-voigt", "coulomb-friction", "presliding", presliding__length=4.2e-4),
    "friction-rounding": contact(
        "kelvin-voigt", "coulomb-friction", "friction-rounding", friction_rounding__speed=6e-3
    ),
    "load-dependent-friction": contact(
        "hooke", "coulomb-friction", "load-dependent-friction", load_dependent_friction__exponent=-0.27
    ),
    "surface-tilt": contact(
        "kelvin-voigt", "coulomb-friction", "surface-tilt", surface_tilt__slope1=0.03, surface_tilt__slope2=-0.05
    ),
    "coupled-stiffness": Example(
        ("kelvin-voigt", "coupled-stiffness"),
        {
            f"coupled-stiffness.{kind}-{i}{j}": size * (1.0 + 0.3 * k)
            for kind, size in (("stiffness", -70.0), ("damping", -2.0))
            for k, (i, j) in enumerate((i, j) for i in "12n" for j in "12n" if i + j != "nn")
        },
        contact_motion(),
    ),
    "friction-anisotropy": contact("hooke", "coulomb-friction", "friction-anisotropy", friction_anisotropy__ratio=0.21),
}
