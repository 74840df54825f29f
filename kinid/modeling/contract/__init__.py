"""The contract that every effect keeps, checked on the example that its own file declares.

`check_effect` asks every rule about one effect; the tests ask the same of the whole catalogue, and `kinid effect check`
of a user's file.
"""

from __future__ import annotations

from kinid.effects import Effect
from kinid.errors import InputError
from kinid.modeling.contract._case import Case, Outcome, Rule, true_values
from kinid.modeling.contract._identifiability import IDENTIFIABILITY
from kinid.modeling.contract._look_alikes import look_alikes
from kinid.modeling.contract._parameters import PARAMETERS
from kinid.modeling.contract._prediction import PREDICTION, departure_from_affine
from kinid.modeling.contract._texts import TEXTS

__all__ = ["RULES", "Case", "Outcome", "Rule", "check_effect", "departure_from_affine", "look_alikes", "true_values"]

#: all rules, in the order in which they are asked: what others rest on comes first
RULES: tuple[Rule, ...] = (*TEXTS, *PARAMETERS, *PREDICTION, *IDENTIFIABILITY)


def check_effect(kind: type[Effect]) -> tuple[Outcome, ...]:
    """What each rule finds of an effect.

    Returns:
        An outcome for each rule; for an effect whose example can't be built, that of the example alone.
    """
    try:
        case = Case.of(kind)
    except Exception as error:  # the effect's own code may raise anything
        found = error.found if isinstance(error, InputError) else f"{type(error).__name__}: {error}"
        expected, mend = "an example that makes a model", "see CONTRIBUTING.md, or kinid effect new NAME --stage normal"
        if isinstance(error, InputError):
            expected, mend = error.expected, error.mend
        return (Outcome("example", False, found, expected, mend),)
    return tuple(rule.ask(case) for rule in RULES)
