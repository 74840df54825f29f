"""Where to touch next, so that shape and property become known together.

A touch at x tells the surface's place there with the error σ_p of touches, and the property with its error σ_k. What it
says of both is, in nats (the information in reading a normal variable of standard deviation s with an error σ),

    I(x) = ½ ln(1 + s_p(x)²/σ_p²) + ½ ln(1 + s_k(x)²/σ_k²)

and it says that of the area around it, for which the square of the distance to the nearest touch stands: the next touch
is where that square times I is largest. No weight between shape and property is chosen: what is known to the error of a
touch asks for no more touches. Information as the aim: D. V. Lindley, Ann. Math. Stat. 27, 1956.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from kinid.errors import InputError
from kinid.mapping.shape import Located, Shape

Array = NDArray[np.float64]

#: places looked at along the longer side of what can be touched
LOOKED_AT = 50
#: a property changes by this share of its value within its errors, or it need not be known better
FINEST = 0.03


@dataclass(frozen=True, eq=False)
class NextTouch:
    """A touch that is proposed.

    Attributes:
        place: where the surface is expected, base frame [m], (3,). direction: to press in, unit, (3,). place_sd: how
        far
            off the surface may be along it, standard deviation [m]. property_sd: of the property, as a share of its
            value.
    """

    place: Array
    direction: Array
    place_sd: float
    property_sd: float


def next_touches(shape: Shape, name: str, count: int = 1, candidates: Array | None = None) -> list[NextTouch]:
    """The touches to make next, the most telling first; each as if those before it had found what is expected.

    Args:
        shape: so far. name: of the property that is to be known, too. count: of touches.
        candidates: places along the tangents of the shape's plane that can be touched [m], (m, 2); default: those
        between
            the touches made.

    Raises:
        InputError: no such property, or no place where the surface is found.
    """
    q = shape.over_grid(LOOKED_AT)[0] if candidates is None else np.asarray(candidates, dtype=float).reshape(-1, 2)
    k, out = shape.grown.index(name), list[NextTouch]()
    while len(out) < count:
        located, guess = shape.at(q), shape.interpolator(name).at(q)
        share = guess.sd / np.maximum(np.abs(guess.mean), 1e-300)
        gain = _gain(shape, name, q, located, share)
        if not np.isfinite(gain).any():
            raise InputError("no place where the surface is found", "places between the touches", "name others")
        best = int(np.nanargmax(gain))
        place = located.points[best]
        out.append(NextTouch(place, -located.normals[best], float(located.sd[best]), float(share[best])))
        nearest = int(np.argmin(np.linalg.norm(shape.touches.places - place, axis=1)))
        values = shape.touches.touches[nearest].probe.values.copy()
        values[k] = guess.mean[best]
        shape = shape.supposed(place, values)
    return out


def _gain(shape: Shape, name: str, q: Array, located: Located, share: Array) -> Array:
    """Information [nat] times the area that it is of [m²], (m,)."""
    from scipy.spatial import cKDTree

    apart = cKDTree(shape.sites).query(q)[0]
    values, noise = shape.grown.values(name), shape.grown.deviations(name)
    error = max(FINEST, float(np.nanmedian(noise / np.abs(values))))
    own = located.sd**2 - shape.common**2  # what touches are off together, another one doesn't tell
    return np.asarray(apart**2 * 0.5 * (np.log1p(own / shape.place_error**2) + np.log1p((share / error) ** 2)))
