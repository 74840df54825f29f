"""What pushes back: a punch on springs side by side, on a pad of springs, dashpots, sliders, fibres and threads.

The pad carries a plate. The tool touches the plate from one side only: where the pad recovers more slowly than the tool
leaves, the tool lifts off. Time goes in steps of 0.2 ms, implicitly.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

from hidden.world.path import FINE

Array = NDArray[np.float64]

#: depths of the tables of elastic force: so many, up to so deep [m]
TABLE, DEEPEST = 6001, 0.012
#: sliders of a bundle; threads; strengths of the fibres at one place
SLIDERS, THREADS, STRENGTHS = 16, 60, 24
#: depth [m] that stands for a thread that has torn
NO_BOND = -1.0
#: depths at which fibres begin to carry
FIBRES = 160


@dataclass(frozen=True)
class Matter:
    """Material and its surface, SI units; what is 0, or empty, is not there.

    Attributes:
        stiffness: force [N] at a depth of 1 mm, in thousands: N/m for a flat punch.
        profile: exponent of the punch's profile; infinite for a flat one, 2 for a round one, 1 for a cone.
        flat: half-width of a flat part in the middle, relative to that of the contact at 1 mm.
        dashpot [N·s/m]; loss: of Hunt and Crossley [s/m].
        arms: (share, time constant [s]) of springs behind dashpots.
        loop: relative force of internal sliders; loop_length [m] that they need to turn.
        fibres: share of the force that fibres carry; fibre_stretch [m] at which they break, fibre_shape of its spread.
        glue [N], glue_length [m]: greatest pull of threads, and how far out they reach.
        second: stiffness [N/m] of a second spring behind a gap [m]; gap_blur [m]: unevenness of the gap.
        warming: change of the stiffness in the end, and its time constant [s].
        inclusion: (height, x, y, radius, width of the edge) [1, m]; gradient: (1/m, 1/m).
        series [m/N]: a spring between encoder and tool.
        offset [m]: the surface is so much further out than believed.
    """

    stiffness: float = 1000.0
    profile: float = np.inf
    flat: float = 0.0
    dashpot: float = 0.0
    loss: float = 0.0
    arms: tuple[tuple[float, float], ...] = ()
    loop: float = 0.0
    loop_length: float = 3e-4
    fibres: float = 0.0
    fibre_stretch: float = 1e-3
    fibre_shape: float = 1.0
    glue: float = 0.0
    glue_length: float = 5e-4
    second: float = 0.0
    gap: float = 2e-3
    gap_blur: float = 5e-5
    warming: float = 0.0
    warming_time: float = 150.0
    inclusion: tuple[float, float, float, float, float] | None = None
    gradient: tuple[float, float] = (0.0, 0.0)
    series: float = 0.0
    offset: float = 0.0


def elastic_table(m: Matter) -> Array:
    """Force over depth of a punch pressed into springs side by side (reduction to one dimension: V. L. Popov, 2010).

    Each spring at x is pressed by δ − g(x); their sum is exact for round punches, cones and flat ones on a half-space.
    """
    depth = np.linspace(0.0, DEEPEST, TABLE)
    if np.isinf(m.profile):
        force = depth.copy()
    else:
        # the profile is 1 mm high at x = 1 from the edge of its flat part
        x = (np.arange(4000) + 0.5) / 4000 * (m.flat + (DEEPEST / 1e-3) ** (1 / m.profile))
        profile = 1e-3 * np.maximum(x - m.flat, 0.0) ** m.profile
        # pressed springs are those whose profile is below the depth: sums of 1 and of g up to there
        count = np.searchsorted(profile, depth)
        area = np.concatenate([[0.0], np.cumsum(np.ones_like(x))]) * (x[1] - x[0])
        height = np.concatenate([[0.0], np.cumsum(profile)]) * (x[1] - x[0])
        # the spring at the border is pressed in part only; its height is that of the depth itself
        edge = m.flat + (depth / 1e-3) ** (1 / m.profile)
        rest = edge - area[count]
        force = depth * edge - height[count] - rest * np.where(count < len(profile), depth, profile[-1])
    force = np.maximum.accumulate(np.maximum(force, 0.0))
    force *= 1e-3 * m.stiffness / np.interp(1e-3, depth, force)
    if m.second:
        # springs behind an uneven gap take part one after the other
        gaps = m.gap + m.gap_blur * np.linspace(-1.5, 1.5, 31)
        force = force + m.second * np.maximum(depth[:, None] - gaps, 0.0).mean(axis=1)
    out: Array = force
    return out


def place_and_time(m: Matter, t: Array, x: Array, y: Array) -> Array:
    """Factor of the stiffness at each instant, (n,)."""
    factor = 1.0 + m.warming * -np.expm1(-t / m.warming_time)
    if m.inclusion is not None:
        from scipy.special import erf

        height, cx, cy, radius, width = m.inclusion
        away = np.hypot(x - cx, y - cy)
        factor = factor * (1.0 + height * 0.5 * (1.0 + erf((radius - away) / (np.sqrt(2) * width))))
    factor *= np.exp(m.gradient[0] * x + m.gradient[1] * y)
    out: Array = factor
    return out


def yields(length: float) -> Array:
    """Lengths at which the sliders of a bundle yield, spread exponentially: the bundle turns as 1 − 2
    exp(−s/length).
    """
    u = (np.arange(SLIDERS) + 0.5) / SLIDERS
    return -0.5 * length * np.log1p(-u)


def press(m: Matter, t: Array, depth: Array, x: Array, y: Array) -> tuple[Array, Array]:
    """Normal force [N] and depth of the tool itself [m] over time, (n,) each, for the depth that the encoder knows.

    Args:
        m: the material. t: [s], depth [m], x, y: place along the tangents [m], (n,).
    """
    shares = np.array([share for share, _ in m.arms])
    decays = np.array([1.0 / (FINE * tau) for _, tau in m.arms])
    starts, strengths, kappa = _fibre_bundle(m)
    slack, reach = _threads(m)
    force, inside = np.empty(len(t)), np.empty(len(t))
    _press(
        depth + m.offset,
        place_and_time(m, t, x, y),
        elastic_table(m),
        shares,
        decays,
        m.dashpot * FINE,
        m.loss * FINE,
        m.loop,
        yields(m.loop_length) if m.loop else np.zeros(0),
        starts,
        strengths,
        kappa,
        m.glue,
        slack,
        reach,
        m.series,
        force,
        inside,
    )
    return force, inside


def _fibre_bundle(m: Matter) -> tuple[Array, Array, Array]:
    """Depths where fibres begin to carry, stretches at which they break, and stiffness at each of these depths.

    Some carry from the surface on, others come in deeper: so that, with breaks spread exponentially, the first loading
    runs straight (the density solves ∫ρ(a)(δ−a)e^{−(δ−a)/L} da = δ).
    """
    if not m.fibres:
        return np.zeros(0), np.ones(STRENGTHS), np.zeros(0)
    step = DEEPEST / FIBRES
    starts = (np.arange(FIBRES) + 0.5) * step
    length = m.fibre_stretch
    kappa = np.concatenate([[1.0], (2.0 / length + starts / length**2) * step])
    u = (np.arange(STRENGTHS) + 0.5) / STRENGTHS
    strengths = length * (-np.log1p(-u)) ** (1.0 / m.fibre_shape)
    return np.concatenate([[0.0], starts]), strengths, kappa * m.fibres * m.stiffness


def _threads(m: Matter) -> tuple[Array, Array]:
    """Way on which each thread becomes taut, and how far out it tears, in no common order, (THREADS,)."""
    u = (np.arange(THREADS) + 0.5) / THREADS
    slack = -m.glue_length * np.log1p(-u)
    reach = m.glue_length * 0.62 * (-np.log1p(-u)) ** 0.5
    return slack, reach[np.argsort(np.modf(u * 37.0)[0])]


@njit(cache=True)
def _lookup(table: Array, depth: float) -> float:
    if depth <= 0.0:
        return 0.0
    at = depth / DEEPEST * (TABLE - 1)
    i = min(int(at), TABLE - 2)
    return table[i] + (at - i) * (table[i + 1] - table[i])


@njit(cache=True)
def _fibres_force(depth: float, deepest: float, starts: Array, strengths: Array, kappa: Array) -> float:
    """Sum over the fibres that the deepest depth so far has left whole."""
    total = 0.0
    count = strengths.shape[0]
    whole = 0
    # those that begin deeper have been stretched less: the number of whole ones grows along the list
    for i in range(starts.shape[0]):
        if starts[i] >= depth:
            break
        stretch = deepest - starts[i]
        while whole < count and strengths[count - 1 - whole] > stretch:
            whole += 1
        total += kappa[i] * (depth - starts[i]) * whole / count
    return total


@njit(cache=True)
def _law(
    depth,
    before,
    deepest,
    gain,
    table,
    shares,
    decays,
    flowed,
    dashpot,
    loss,
    loop,
    limits,
    pins,
    starts,
    strengths,
    kappa,
    fibre_share,
    state,
):
    """Force at a trial depth of the plate [N]; `state` gets its elastic part."""
    elastic = _lookup(table, depth)
    if kappa.shape[0] > 0:
        elastic = (1.0 - fibre_share) * elastic + _fibres_force(
            max(depth, 0.0), max(deepest, depth), starts, strengths, kappa
        )
    elastic *= gain
    state[0] = elastic
    force = elastic
    for k in range(shares.shape[0]):
        force -= shares[k] * (flowed[k] + decays[k] * elastic) / (1.0 + decays[k])
    rate = depth - before
    force += dashpot * rate + loss * rate * elastic
    if loop != 0.0:
        total, most = 0.0, 0.0
        for j in range(limits.shape[0]):
            total += min(max(pins[j] + rate, -limits[j]), limits[j])
            most += limits[j]
        force += loop * elastic * total / most
    return force


@njit(cache=True)
def _press(
    depth,
    gain,
    table,
    shares,
    decays,
    dashpot,
    loss,
    loop,
    limits,
    starts,
    strengths,
    kappa,
    glue,
    slack,
    reach,
    series,
    out,
    inside,
):
    plate, deepest = 0.0, 0.0
    bonds = np.full(slack.shape[0], NO_BOND)
    flowed = np.zeros(shares.shape[0])
    pins = np.zeros(limits.shape[0])
    state = np.zeros(1)
    fibre_share = 0.0
    if kappa.shape[0] > 0:
        fibre_share = kappa[0] / (table[TABLE - 1] / DEEPEST)
    force = 0.0
    for i in range(depth.shape[0]):
        tool = depth[i] - series * max(force, 0.0)
        force = 0.0
        if tool > 0.0:
            force = _law(
                tool,
                plate,
                deepest,
                gain[i],
                table,
                shares,
                decays,
                flowed,
                dashpot,
                loss,
                loop,
                limits,
                pins,
                starts,
                strengths,
                kappa,
                fibre_share,
                state,
            )
        touching = tool > 0.0 and force > 0.0
        if touching and series > 0.0:
            # balance of tool and spring: N = law(depth − C N), by Newton's method
            for _ in range(4):
                tool = depth[i] - series * force
                now = _law(
                    tool,
                    plate,
                    deepest,
                    gain[i],
                    table,
                    shares,
                    decays,
                    flowed,
                    dashpot,
                    loss,
                    loop,
                    limits,
                    pins,
                    starts,
                    strengths,
                    kappa,
                    fibre_share,
                    state,
                )
                near = _law(
                    tool + 1e-8,
                    plate,
                    deepest,
                    gain[i],
                    table,
                    shares,
                    decays,
                    flowed,
                    dashpot,
                    loss,
                    loop,
                    limits,
                    pins,
                    starts,
                    strengths,
                    kappa,
                    fibre_share,
                    state,
                )
                force += (now - force) / (1.0 + series * (near - now) / 1e-8)
            tool = depth[i] - series * force
            force = _law(
                tool,
                plate,
                deepest,
                gain[i],
                table,
                shares,
                decays,
                flowed,
                dashpot,
                loss,
                loop,
                limits,
                pins,
                starts,
                strengths,
                kappa,
                fibre_share,
                state,
            )
        held = tool
        if not touching:
            # the plate by itself: where springs and dashpots hold it without the tool
            held = _free_plate(plate, gain[i], table, shares, decays, flowed, dashpot)
            force, tool = 0.0, depth[i]
            state[0] = gain[i] * _lookup(table, held)
        for k in range(shares.shape[0]):
            flowed[k] = (flowed[k] + decays[k] * state[0]) / (1.0 + decays[k])
        for j in range(limits.shape[0]):
            moved = pins[j] + held - plate
            pins[j] = min(max(moved, -limits[j]), limits[j]) if touching else 0.0
        plate = held
        deepest = max(deepest, held)
        pull = 0.0
        if glue > 0.0:
            # threads form where there is contact, and each keeps the deepest of its own life
            for k in range(slack.shape[0]):
                if touching:
                    bonds[k] = max(bonds[k], tool)
                elif -tool >= reach[k]:
                    bonds[k] = NO_BOND
                if bonds[k] > NO_BOND:
                    pull += min((bonds[k] - tool) / slack[k], 1.0) * glue / slack.shape[0]
        out[i] = force - pull
        inside[i] = tool


@njit(cache=True)
def _free_plate(plate, gain, table, shares, decays, flowed, dashpot):
    """Depth where a plate without a tool comes to in one step: the springs' force is what arms and dashpot hold."""
    held = 0.0
    keep = 1.0
    for k in range(shares.shape[0]):
        held += shares[k] * flowed[k] / (1.0 + decays[k])
        keep -= shares[k] * decays[k] / (1.0 + decays[k])
    if held <= 1e-9 and (dashpot == 0.0 or plate <= 1e-9):
        return 0.0
    if dashpot == 0.0:
        # the depth at which the springs alone carry so much
        force = held / (keep * gain)
        low, high = 0, TABLE - 1
        while high - low > 1:
            middle = (low + high) // 2
            if table[middle] > force:
                high = middle
            else:
                low = middle
        step = table[high] - table[low]
        return (low + (force - table[low]) / step if step > 0.0 else low) * DEEPEST / (TABLE - 1)
    a, b = 0.0, plate
    for _ in range(30):
        c = 0.5 * (a + b)
        if keep * gain * _lookup(table, c) + dashpot * (c - plate) > held:
            b = c
        else:
            a = c
    return 0.5 * (a + b)
