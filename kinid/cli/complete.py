"""What a shell offers while a name is typed: of models and effects from the catalogue, of properties from the map at
hand.
"""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

import typer


def model(incomplete: str) -> list[tuple[str, str]]:
    """Names that go on with a model, `a,b,…`, each with its title: laws of contact first, and none that is there
    already.
    """
    from kinid.effects import catalogue

    *before, begun = incomplete.split(",")
    known = catalogue()
    based = any(known[name].base for name in before if name in known)
    free = [name for name in known if name not in before and not (based and known[name].base)]
    head = "".join(f"{name}," for name in before)
    return [(head + name, title) for name, title in _titled(sorted(free, key=lambda n: (not known[n].base, n)), begun)]


def effects(incomplete: str) -> list[tuple[str, str]]:
    """Names that go on with a list of effects, `a,b,…`."""
    from kinid.effects import catalogue

    *before, begun = incomplete.split(",")
    head = "".join(f"{name}," for name in before)
    return [(head + name, title) for name, title in _titled(sorted(set(catalogue()) - set(before)), begun)]


def effect(incomplete: str) -> list[tuple[str, str]]:
    """Effects of the catalogue that begin so."""
    from kinid.effects import catalogue

    return _titled(sorted(catalogue()), incomplete)


def hidden(incomplete: str) -> list[tuple[str, str]]:
    """Effects that the laboratory can hide."""
    from kinid.lab.injectors import injectors

    return _titled(sorted(injectors()), incomplete)


def method(incomplete: str) -> list[tuple[str, str]]:
    """Ways to guess between probes."""
    from kinid.mapping.interpolation import METHODS

    return [(name, "") for name in METHODS if name.startswith(incomplete)]


def mapped(context: typer.Context, incomplete: str) -> list[tuple[str, str]]:
    """What the map that was typed before can be coloured by; without one, nothing."""
    from kinid.errors import KinidError
    from kinid.mapping.property_map import PropertyMap
    from kinid.viewer.scene import layers_of

    # words before an option that still lacks its value are left unparsed
    given = context.params.get("target") or context.params.get("grown") or next(iter(context.args), "")
    try:
        grown = PropertyMap.read(Path(str(given)))
    except (KinidError, OSError):
        return []
    units = {item.name: item.unit for item in grown.properties}
    return [(name, units.get(name, "")) for name in layers_of(grown) if name.startswith(incomplete)]


def _titled(names: Iterable[str], begun: str) -> list[tuple[str, str]]:
    from kinid.effects import catalogue

    known = catalogue()
    return [(name, known[name].title if name in known else "") for name in names if name.startswith(begun)]
