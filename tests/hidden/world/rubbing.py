"""What holds a tool back that slides: a brush of bristles, asperities under load, flanks of grooves, a film."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

Array = NDArray[np.float64]


#: share of their length that bristles bend before they give way: at rest, a tremor then leaves friction as it is
PLAY = 0.02


@dataclass(frozen=True)
class Rub:
    """Friction of the surface, SI units.

    Attributes:
        mu: coefficient, at 1 N and in fast slip.
        turn [m]: slip in which friction turns around, in the mean of the brush; at first that which dry friction has in
            the catalogue, 0.1 mm. uneven: how much bristles differ in length (standard deviation of its logarithm).
        extra, extra_speed [m/s]: how much more there is of it at rest, and where that has faded.
        film [N·s/m]: shear of a film.
        area: "" for a coefficient that load doesn't change; "asperities" for an area of round asperities of different
            heights; "plough" for a round tip that ploughs. area_spread: how much the heights differ, or the share of
            ploughing.
        flank [rad]: slope of grooves that run along the first tangent (across it, if negative).
    """

    mu: float = 0.3
    turn: float = 1e-4
    uneven: float = 0.0
    extra: float = 0.0
    extra_speed: float = 8e-3
    film: float = 0.0
    area: str = ""
    area_spread: float = 0.0
    flank: float = 0.0


def rub(r: Rub, normal: Array, slip: Array, rate: Array, touching: NDArray[np.bool_]) -> Array:
    """Force of the material on the tool along both tangents, (2, n) [N].

    Args:
        r: the surface. normal: [N], (n,). slip: [m], rate: [m/s], (2, n). touching: (n,).
    """
    held = brush(r, slip, touching)
    speed2 = (rate[0] ** 2 + rate[1] ** 2) / r.extra_speed**2
    # a polynomial below the line fades faster than Lorentz's curve, slower than Gauss's
    mu = r.mu + r.extra / (1.0 + speed2 + 0.5 * speed2**2)
    load = np.maximum(normal, 0.0)
    if r.area == "asperities":
        mu = mu * _asperities(r.area_spread, load)
    elif r.area == "plough":
        # a spherical cap ploughs with its cross-section, as the 3/2 power of the contact's width, that is of √load
        mu = mu * ((1.0 - r.area_spread) + r.area_spread * np.sqrt(load))
    along, across = 1.0, 1.0
    if r.flank:
        # climbing one flank and descending the other, on average, against sliding along the groove
        steep, flat = np.tan(r.flank) ** 2, (1.0 + np.tan(r.flank) ** 2) ** 0.5
        climb = r.mu * (1.0 + steep) / (1.0 - r.mu**2 * steep) / r.mu
        mean = 0.5 * (climb + flat)
        along, across = (flat / mean, climb / mean) if r.flank > 0 else (climb / mean, flat / mean)
    out: Array = -load * mu * np.array([[along], [across]]) * held - r.film * rate * touching
    return out


def brush(r: Rub, slip: Array, touching: NDArray[np.bool_]) -> Array:
    """Mean deflection of the bristles along both tangents, of length 1 in full slip, (2, n)."""
    held = np.empty((2, slip.shape[1]))
    _brush(slip[0], slip[1], touching, _lengths(r), held)
    return held


def _asperities(spread: float, load: Array) -> Array:
    """Real area of contact for its load, 1 at 1 N: round asperities whose heights are spread (Archard; Greenwood,
    Williamson).

    With all at one height the area grows as the 2/3 power of the load, with a wide spread in proportion to it.
    """
    heights, many = np.zeros(1), np.ones(1)
    if spread > 0.01:  # so many of them between the highest and 1 below, ever more the lower
        heights = np.geomspace(1e-5, 1.0, 600)
        many = heights**spread
    gap = np.geomspace(1e-4, 3.0, 300)[:, None]
    pressed = np.maximum(gap - heights, 0.0)
    force, area = pressed**1.5 @ many, pressed @ many
    # the load of 1 N presses the tips by as much as their spread, where curves of all spreads are straight
    force, area = force / np.interp(0.3, gap[:, 0], force), area / np.interp(0.3, gap[:, 0], area)
    light = np.clip(load, force[0], force[-1])
    out: Array = np.exp(np.interp(np.log(light), np.log(force), np.log(area / force)))
    return out


def _lengths(r: Rub) -> Array:
    """Of the bristles [m]: one for all, or nine spread about their mean."""
    if not r.uneven:
        return np.array([r.turn])
    from scipy.special import ndtri

    spread = np.exp(r.uneven * ndtri((np.arange(9) + 0.5) / 9))
    out: Array = r.turn * spread / spread.mean()
    return out


@njit(cache=True)
def _brush(x, y, touching, lengths, out):
    """Mean deflection of bristles that bend with the slip and give way in proportion to it; Crank and Nicolson's rule.

    Their feet stand on asperities that bend first, by `PLAY` of the mean length, and carry a force in proportion.
    """
    m = lengths.shape[0]
    mean = lengths.mean()
    play = PLAY * mean
    a, b = np.zeros(m), np.zeros(m)
    u, v = 0.0, 0.0
    for i in range(x.shape[0]):
        if i == 0 or not touching[i]:
            a[:] = 0.0
            b[:] = 0.0
            u, v = 0.0, 0.0
            out[0, i] = 0.0
            out[1, i] = 0.0
            continue
        u += x[i] - x[i - 1]
        v += y[i] - y[i - 1]
        bent = np.sqrt(u * u + v * v)
        way = max(bent - play, 0.0)
        if way > 0.0:
            dx, dy = way * u / bent, way * v / bent
            u -= dx
            v -= dy
            for j in range(m):
                # the middle of the step counts on both sides: second order in it
                h = 0.5 * way / lengths[j]
                a[j] = (a[j] * (1.0 - h) + dx / lengths[j]) / (1.0 + h)
                b[j] = (b[j] * (1.0 - h) + dy / lengths[j]) / (1.0 + h)
        p, q = 0.0, 0.0
        for j in range(m):
            p += a[j]
            q += b[j]
        out[0, i] = (1.0 - PLAY) * p / m + u / mean
        out[1, i] = (1.0 - PLAY) * q / m + v / mean
