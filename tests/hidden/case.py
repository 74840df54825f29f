"""One case: a log, the model a user starts with, and what is hidden from it."""

from __future__ import annotations

from dataclasses import dataclass

import kinid


@dataclass(frozen=True, eq=False)
class Case:
    """A log with something hidden, or nothing.

    Attributes:
        name: kind, world and what is hidden, and a number.
        kind: "single", "pair", "none", "outside" (not in the catalogue) or "not-excited" (`truth` names effects that
            this log can't show).
        log, rig: as a user has them.
        model: what the user starts with, by names of the catalogue: all the rest of the case's physics.
        truth: names of what is hidden; empty for "none" and "outside".
        true_model: the catalogue's nearest full model.
        seed: of all that was drawn. note: sizes, in words.
    """

    name: str
    kind: str
    log: kinid.Log
    rig: kinid.Rig
    model: tuple[str, ...]
    truth: frozenset[str]
    true_model: tuple[str, ...]
    seed: int
    note: str
