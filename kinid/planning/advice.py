"""What to measure next, as a command that runs: an experiment is planned before anybody is told to plan it."""

from __future__ import annotations

import dataclasses
import itertools
import shlex
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from kinid import effects as catalogue
from kinid.data.rig import Rig
from kinid.diagnosis import Diagnosis, EffectStatus, EffectVerdict
from kinid.errors import InputError
from kinid.modeling.model import Model
from kinid.planning.discriminate import discriminate
from kinid.planning.planner import Planner

#: experiments that are planned for effects that the log doesn't show; more would keep a reader waiting
MOST_HIDDEN = 2


@dataclass(frozen=True, eq=False)
class Advisor:
    """Plans the experiments that a diagnosis asks for.

    Attributes:
        found: the diagnosis. rig: of its log. rig_file: its path, as the reader of a command would name it.
        fit_file: the diagnosis as JSON, where it is to be written: commands then take model and values from there.
    """

    found: Diagnosis
    rig: Rig
    rig_file: Path
    fit_file: Path | None = None

    def advised(self, progress: Callable[[str], None] = lambda _: None) -> Diagnosis:
        """The diagnosis, with commands beside what tells effects apart; where nothing can be planned, why not.

        Effects that the log can't tell apart all get one; of those that it doesn't show, the first few.
        """
        if self.rig.robot is None:
            return self.found
        progress("planning what to measure next")
        said: dict[frozenset[str], tuple[bool, str]] = {}
        hidden: dict[frozenset[str], str] = {}  # and the first effect that got it
        out = []
        for verdict in self.found.effects:
            names = _candidates(verdict, self.found.best)
            key = frozenset(names)
            rivals = bool(verdict.equivalent_to)
            if len(names) < 2 or not (rivals or key in hidden or len(hidden) < MOST_HIDDEN):
                out.append(verdict)
                continue
            if key not in said:
                said[key] = self._said(names)
            planned, words = said[key]
            if not rivals and hidden.setdefault(key, verdict.id) != verdict.id:
                words = f"what is planned for {hidden[key]} is for it, too"
            if not planned:  # words on what to record are the better advice
                words = "; ".join(filter(None, (verdict.separate_by, words if rivals else "")))
            out.append(dataclasses.replace(verdict, separate_by=words))
        return dataclasses.replace(self.found, effects=tuple(out))

    def _said(self, names: Sequence[str]) -> tuple[bool, str]:
        """Whether an experiment that tells effects apart is planned; what it is and the command that plans it, or why
        there is none.
        """
        first: InputError | None = None
        # of many that are alike, two that a robot can tell apart are a beginning
        for chosen in dict.fromkeys([tuple(names), *itertools.product(names[:1], names[1:])]):
            model = Model(*(effect for effect in self.found.best.effects if effect.id not in names))
            values = {
                name: float(f"{p.value:.6g}") if self.fit_file is None else p.value
                for name, p in self.found.fit.parameters.items()
                if name.partition(".")[0] in model
            }
            try:
                best = discriminate(Planner(self.rig), model, chosen, values)
            except InputError as error:
                first = first or error
            except (ArithmeticError, ValueError) as error:
                # a diagnosis that took minutes isn't lost for want of an advice
                return False, f"no trajectory could be planned for it ({type(error).__name__})"
            else:
                purpose = f"record {best.proposal.title}, to tell {' from '.join(chosen)}"
                return True, f"{purpose}: {shlex.join(self._command(model, chosen, values))}"
        assert first is not None  # there was a pair to plan for
        return False, f"no trajectory is known for it: {first.found}; instead, {first.mend}"

    def _command(self, model: Model, names: Sequence[str], values: dict[str, float]) -> Iterator[str]:
        yield from ("kinid", *catalogue.effect_options(), "plan", "discriminate", "--rig", str(self.rig_file))
        yield from ("--model", ",".join(model.names) or "none")
        if values and self.fit_file is not None:
            yield from ("--fit", str(self.fit_file))
        elif values:
            for name, value in values.items():
                yield from ("--value", f"{name}={value:.6g}")
        yield from ("--effects", ",".join(names), "-o", f"{'-or-'.join(names[:2])}.parquet")


def _candidates(verdict: EffectVerdict, model: Model) -> tuple[str, ...]:
    """Effects that an experiment is to tell apart: of one that the log doesn't show, it and what it is mistaken for."""
    if verdict.equivalent_to:
        return (verdict.id, *verdict.equivalent_to)
    if verdict.verdict != EffectStatus.NOT_EXCITED or not verdict.acts or verdict.left_out:
        return ()
    known = catalogue.catalogue()
    usual = (n for n in catalogue.get(verdict.id).confusions if n in known and n not in model)
    rival = next((n for n in usual if not (catalogue.get(n).base or catalogue.get(n).detector)), None)
    return () if rival is None else tuple(sorted((verdict.id, rival)))
