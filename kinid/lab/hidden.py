"""A hidden effect: put into a set-up with a plausible size, by seed; what was injected is told to the truth alone."""

from __future__ import annotations

import dataclasses
from collections.abc import Collection

import numpy as np
from numpy.typing import NDArray

from kinid.controllers._given import closest
from kinid.effects import catalogue
from kinid.errors import InputError
from kinid.lab.injectors import Injected, Truth, injectors
from kinid.lab.materials import SURFACE, Patch
from kinid.lab.setup import Setup

Array = NDArray[np.float64]
#: lower and upper corner along both tangents [m]
Rectangle = tuple[tuple[float, float], tuple[float, float]]


def hide(setup: Setup, effect: str, seed: int, where: Rectangle | None = None) -> Injected:
    """The set-up with one more effect, and its parameters by the catalogue's names.

    Args:
        setup: with nothing hidden. effect: of the catalogue. seed: of its size.
        where: for an effect of the material, the rectangle of the surface that has it, lower and upper corner along
            both tangents [m]; default: everywhere.

    Raises:
        InputError: no such effect, or one that isn't at a place.
    """
    known = injectors()
    if effect not in known:
        raise InputError(f"effect '{effect}' to hide", f"one of {', '.join(sorted(known))}", _mend(effect, known))
    rng = np.random.default_rng(np.random.SeedSequence([seed, *effect.encode()]))
    injected, parameters = known[effect](setup, rng)
    truth: Truth = {"effect": effect, "parameters": parameters}
    if where is not None:
        changed = {f.name for f in dataclasses.fields(setup) if getattr(injected, f.name) is not getattr(setup, f.name)}
        if changed != {"material"}:
            raise InputError(
                f"'{effect}' to hide in a part of the surface",
                "an effect of the material",
                "hide it without a place: it is everywhere",
            )
        patch = Patch(*where, injected.material)
        check_where(setup, where)
        injected = setup.replace(material=setup.material.replace(patches=(*setup.material.patches, patch)))
        truth["where"] = where
    return injected, truth


def _mend(effect: str, known: Collection[str]) -> str:
    """What helps with an effect that can't be hidden."""
    if effect in catalogue():
        return "give its file a function inject(setup, rng), see CONTRIBUTING.md"
    return closest(effect, known)


def check_where(setup: Setup, where: Rectangle) -> None:
    """Refuse a part of the surface that lies off the piece.

    Raises:
        InputError: no point in common.
    """
    half = min(setup.material.side / 2, SURFACE)
    if max(where[0]) >= half or min(where[1]) <= -half:
        raise InputError(
            f"a part of the surface {_shown(where)}, off the {setup.material.name}",
            f"places within ±{1e3 * half:g} mm of its middle",
            "move or enlarge it",
        )


def check_met(where: Rectangle, places: Array) -> None:
    """Refuse a part of the surface that no motion touches: what is hidden there would never show.

    Args:
        where: its corners [m]. places: that are touched, along both tangents [m], (n, 2).

    Raises:
        InputError: none of them lies in it.
    """
    low, high = np.asarray(where)
    if not ((places >= low) & (places <= high)).all(axis=1).any():
        near, far = 1e3 * places.min(axis=0, initial=np.inf), 1e3 * places.max(axis=0, initial=-np.inf)
        touched = f"({near[0]:.3g}, {near[1]:.3g}) to ({far[0]:.3g}, {far[1]:.3g}) mm" if len(places) else "nothing"
        raise InputError(
            f"a part of the surface {_shown(where)} that isn't touched",
            f"some of what is: {touched}",
            "move or enlarge it, or touch elsewhere",
        )


def _shown(where: Rectangle) -> str:
    (a, b), (c, d) = where
    return f"from ({1e3 * a:g}, {1e3 * b:g}) to ({1e3 * c:g}, {1e3 * d:g}) mm"
