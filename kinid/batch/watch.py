"""A folder in which logs appear all day: each is taken in as it comes, and held against its fellows.

All that is known of a log lies in a store, so that a watch that was stopped, or killed, goes on where it was.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial

import numpy as np

from kinid.batch.jobs import Job, take_in, unparquet
from kinid.batch.logs import Item, items_of
from kinid.batch.run import claim, sweep
from kinid.batch.runners import Lost, Runner
from kinid.batch.store import Store
from kinid.batch.watch_page import watch_page
from kinid.campaign.files import NoLogs
from kinid.identification.fit import Z95
from kinid.identification.pooling.odd import USUAL, odd_values
from kinid.writers import Json

#: a file that hasn't changed for so long is whole [s]
SETTLED = 1.0
PAGE = "watch.html"


@dataclass(eq=False)
class Watch:
    """A watch over a folder.

    Attributes:
        folder: a path or an address. rig: of logs that have none beside them. model: names of its effects. store: where
            results go. runner: who works. progress: called with each log that was taken in, and what is said of it.
    """

    folder: str
    rig: str | None
    model: tuple[str, ...]
    store: Store
    runner: Runner
    progress: Callable[[str, str], None] = lambda *_: None
    #: of logs that were taken in, by key: facts of the fit, or why they are put aside
    _outcomes: dict[str, Json | str] = field(default_factory=dict)
    #: since when files are what they are, by key
    _since: dict[str, float] = field(default_factory=dict)
    _there: list[Item] = field(default_factory=list)

    def begin(self) -> int:
        """Remember what the store holds; how many logs those are.

        Raises:
            InputError: a store of something else, or that can't be read.
        """
        claim({"kind": "watch", "model": list(self.model)}, self.store, self.runner)
        there = set(self.store.files("fit"))
        self._there = self._items()
        for item in self._there:
            if _within("fit", item) in there:
                self._outcomes[item.key] = self._facts(item)
        return len(self._outcomes)

    def look(self) -> int:
        """Take in what is new and whole; how many logs that was.

        Raises:
            InputError: a folder or a rig that can't be read, or results that can't be written.
        """
        self._there, now = self._items(), time.monotonic()
        new = [item for item in self._there if item.key not in self._outcomes]
        self._since = {item.key: self._since.get(item.key, now) for item in new}
        whole = [item for item in new if now - self._since[item.key] >= SETTLED]
        jobs = Job("contact"), Job("fit", self.model)
        for job in jobs if whole else ():
            sweep(job.kind, whole, self.store, self.store.files(job.kind))
        for place, result in self.runner.run(partial(take_in, jobs, self.store), whole):
            item = whole[place]
            self._outcomes[item.key] = result.why if isinstance(result, Lost) else self._facts(item)
            self.progress(item.name, self.said(item))
        if whole or self.store.found(PAGE) is None:
            outcomes = [(item.name, self._outcomes[item.key]) for item in self._there if item.key in self._outcomes]
            self.store.write(PAGE, watch_page(self.folder, self.model, outcomes, self.odd).encode())
        return len(whole)

    @property
    def odd(self) -> dict[str, str]:
        """Logs that don't belong to the others, with why."""
        found = {item.name: self._outcomes.get(item.key) for item in self._there}
        return odd_values({name: _figures(facts) for name, facts in found.items() if isinstance(facts, dict)})

    def to_dict(self) -> Json:
        """What is known of all logs, for JSON."""
        outcomes = {item.name: self._outcomes[item.key] for item in self._there if item.key in self._outcomes}
        return {
            "model": list(self.model),
            "logs": {name: facts for name, facts in outcomes.items() if not isinstance(facts, str)},
            "put_aside": {name: why for name, why in outcomes.items() if isinstance(why, str)},
            "odd": self.odd,
        }

    def said(self, item: Item) -> str:
        """What there is to say of a log, in a line."""
        facts = self._outcomes[item.key]
        if isinstance(facts, str):
            return f"put aside: {facts}"
        odd = self.odd.get(item.name)
        if odd:
            return f"odd: {odd}"
        error = facts["error"]
        return f"error {error['train']:.3g} {error['unit']}, the noise is {error['noise_floor']:.3g}"

    def _items(self) -> list[Item]:
        try:
            return items_of([self.folder], self.rig)[0]
        except NoLogs:
            return []

    def _facts(self, item: Item) -> Json:
        out: Json = unparquet(self.store.read(item.part("fit")))[1]["fit"]
        return out


def _within(kind: str, item: Item) -> str:
    return item.part(kind).removeprefix(f"{kind}/")


def _figures(facts: Json) -> dict[str, tuple[float, float, str]]:
    """What logs are held against each other by: values, with their standard errors, and the error's size."""
    out = {}
    for name, p in facts["parameters"].items():
        known = p["low"] is not None and p["high"] is not None
        out[name] = float(p["value"]), (p["high"] - p["low"]) / (2.0 * Z95) if known else np.inf, str(p["unit"])
    # errors differ by factors
    size = facts["error"]["held_out"] or facts["error"]["train"] or 1e-12
    out["the logarithm of its error"] = float(np.log(max(size, 1e-12))), USUAL, ""
    return out
