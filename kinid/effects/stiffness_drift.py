"""A material that changes with time."""

from __future__ import annotations

from collections.abc import Mapping
from typing import final

from kinid.effects._effect import Effect
from kinid.effects._example import Example
from kinid.effects._signals import Array, Layout, Signals
from kinid.parameter import Parameter


@final
class StiffnessDrift(Effect):
    """F_e ·= 1 + α t: α [1/min], t from the log's first sample (warming, drying, curing, wear)."""

    id = "stiffness-drift"
    title = "stiffness that changes with time"
    equation = "F_e ·= 1 + α t"
    source = "L. Ljung, System Identification, 2nd ed. 1999, ch. 11 (parameters that vary in time)"
    signature = "an error in proportion to the force, that grows with time"
    confusions = {
        "stiffness-inhomogeneity": "return to one place: the place remembers, time doesn't",
        "relaxation": "a rest between pokes: relaxation recovers",
        "stress-softening": "a deeper poke later",
        "sensor-drift": "a look in the air",
    }
    excited_by = "the same depth at one place early and late"
    null = {"rate": 0.0}
    order = 2
    example = Example(("hertz",), {"rate": 1.3})

    def parameters(self, layout: Layout) -> tuple[Parameter, ...]:
        """Rate."""
        return (Parameter("rate", "α", "1/min", 0.0, -1e3, 1e3, scale=0.05),)

    def implausible(
        self, values: Mapping[str, float], model_values: Mapping[str, float], signals: Signals | None = None
    ) -> str:
        """A stiffness that is gone before the log ends."""
        end = 1.0 if signals is None else 1.0 + values.get("rate", 0.0) * float(signals.t[-1]) / 60.0
        if end < 0.0:
            return f"rate = {values['rate']:.3g} 1/min: no stiffness would be left at the end of the log"
        return super().implausible(values, model_values, signals)

    def elastic(self, s: Signals, p: Array) -> None:
        """Scale the elastic force."""
        s.elastic = s.elastic * (1.0 + p[0] / 60.0 * s.t)
