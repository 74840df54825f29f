"""Which unit forces or moments are of, where the tool's weight and the levers of the forces say that it is another."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from kinid.data.plausible import FORCE, TORQUE
from kinid.data.rig import Rig
from kinid.units import factor

Array = NDArray[np.float64]

#: a unit is named whose factor is within this share
MASS_SHARE = 0.1
#: an explanation leaves no more than this share of squares
LEFT = 0.3
#: moments are of another unit than forces where they are so many times what these do at their levers
UNIT_OF_MOMENTS = 30.0
#: forces, or moments, are those of the stated tool within this factor
OWN = 1.5
FORCES, MOMENTS = ("fx", "fy", "fz"), ("tx", "ty", "tz")


def unit_meant(
    times: float,
    rig: Rig,
    names: tuple[str, ...],
    units: tuple[str, ...],
    usual: tuple[str, ...] = (),
    within: float = OWN,
) -> str | None:
    """The unit of what reads so many times too much with what the rig says of it under the first of some names; where
    levers aren't known so well, one of the usual units, within a factor.
    """
    said = next((rig.columns[name] for name in names if name in rig.columns), None)
    true = (1.0 if said is None else said.to_si) / times if times else 0.0
    if not 0.0 < true < np.inf:  # turned around, or nothing: no unit does that
        return None
    off = {unit: abs(np.log(true / factor(unit, "[columns]"))) for unit in (*units, *usual)}
    near = sorted(off, key=lambda unit: off[unit])  # the first of those that are one by two names
    exact = next((unit for unit in near if unit in units and off[unit] < np.log(1.0 + MASS_SHARE)), None)
    return exact or next((unit for unit in near if unit in usual and off[unit] < np.log(within)), None)


def unit_of_moments(moment: Array, expected: Array, air: Array, load: Array, rig: Rig) -> str | None:
    """Whether the moment is a multiple of that of the forces at their levers that only another unit gives.

    Args:
        moment, expected: both without their means, (n, 3). air, load: force in free motion, and that of the tool,
            (m, 3). rig: says what units were stated.
    """
    slope = in_proportion(moment, expected)
    if slope is None:
        return None
    # the tool's weight says which of them is wrong; else it is the smaller unit that somebody forgot
    pulled = float(np.sum((air - air.mean(axis=0)) * (load - load.mean(axis=0)))) if len(air) else 0.0
    size = float(np.sum((load - load.mean(axis=0)) ** 2)) if len(load) else 0.0
    weight = pulled / size if size > 0.0 else 0.0
    weighs = 1.0 / OWN < weight < OWN or OWN > weight * slope > 1.0 / OWN
    forces = not 1.0 / OWN < weight < OWN if weighs else slope < 1.0
    wrong, every, usual = (FORCES, FORCE, ("mN", "kN")) if forces else (MOMENTS, TORQUE, ("Nmm", "Ncm", "kNm"))
    unit = unit_meant(1.0 / slope if forces else slope, rig, (wrong[0], "wrench"), every, usual)
    mend = "Correct their unit or scale in [columns] of the rig"
    if unit is not None:
        mend = say_units(dict.fromkeys(wrong, unit))
    return (
        f"the moments are {slope:.3g} times those of the forces at the tool's com and tip: are "
        f"{'the forces' if forces else 'they'} in another unit? {mend}"
    )


def unit_of_forces(force: Array, moment: Array, load: Array, rig: Rig) -> str | None:
    """Whether the forces in free motion are a multiple of the tool's weight that a unit gives, and the moments are its,
    or another multiple that one gives.

    Args:
        force, moment, load: without their means, (n, 3): measured, and weight and inertia of 1 kg.
    """
    mass, levered = rig.carried.mass, np.cross(rig.carried.com, load)
    if mass <= 0.0 or not levered.any() or not moment.any():
        return None
    times = float(np.sum(force * load)) / float(np.sum(load**2)) / mass
    turned = float(np.sum(moment * levered)) / float(np.sum(levered**2)) / mass
    unit = unit_meant(times, rig, ("fx", "wrench"), FORCE) if times > 0.0 else None
    explained = float(np.sum((moment - turned * mass * levered) ** 2)) <= LEFT * float(np.sum(moment**2))
    if unit is None or not explained or turned <= 0.0 or 1.0 / OWN < times < OWN:
        return None
    units = dict.fromkeys(FORCES, unit)
    if not 1.0 / OWN < turned < OWN:
        arm = unit_meant(turned, rig, ("tx", "wrench"), TORQUE)
        # of one unit all six are, which the weight alone tells
        if arm is None or abs(turned / times - 1.0) < MASS_SHARE:
            return None
        units |= dict.fromkeys(MOMENTS, arm)
    return (
        f"in free motion the forces are {times:.3g} times the tool's weight, and the moments {turned:.3g} times its: "
        f"are they in {' and '.join(dict.fromkeys(units.values()))}? {say_units(units)}"
    )


def say_units(units: Mapping[str, str]) -> str:
    """How a rig states units of columns by their names."""
    said = ", ".join(f'{name} = {{ unit = "{unit}" }}' for name, unit in units.items())
    return f"Say so in [columns] of the rig: {said}"


def in_proportion(readings: Array, expected: Array) -> float | None:
    """How many times what is expected the readings are, both of one shape, where only another unit explains that; else
    None.
    """
    whole, size = float(np.sum(readings**2)), float(np.sum(expected**2))
    slope = float(np.sum(readings * expected)) / size if size > 0.0 else 0.0
    other = slope > 0.0 and abs(np.log(slope)) > np.log(UNIT_OF_MOMENTS) and whole - slope**2 * size <= LEFT * whole
    return slope if other else None
