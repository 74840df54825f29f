"""The force that a model expects of a planned motion."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from kinid.effects import Layout, Signals, catalogue
from kinid.errors import InputError
from kinid.modeling.model import Model
from kinid.modeling.parameter_names import assumed_values
from kinid.writers import Json

Array = NDArray[np.float64]

CHANNELS = ("normal_force", "tangential_force1", "tangential_force2")


@dataclass(frozen=True, eq=False)
class Law:
    """A model with values of its parameters; those not named are nominal.

    Attributes:
        model: with a contact law, and nothing that needs the whole wrench or joint torques.
        values: by parameter name, with its effect or without.
    """

    model: Model
    values: Mapping[str, float] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if self.model.needs_log or not any(effect.base for effect in self.model.effects):
            raise InputError(
                f"{self.model} for the expected contact force",
                "a contact law, with effects of contact alone",
                "name one with --model, such as hunt-crossley",
            )
        named = self.model.parameters(self.layout())
        complete = {name: p.nominal for name, p in named.items()}
        complete |= assumed_values(self.model, self.values, self.layout())
        object.__setattr__(self, "values", complete)

    def layout(self) -> Layout:
        """The normal force, and tangential forces where the model speaks of slip."""
        return Layout(CHANNELS if "slip" in self.model.needs else CHANNELS[:1], "contact")

    @property
    def vector(self) -> Array:
        """All values in the model's order, (p,)."""
        return np.array(list(self.values.values()))

    def signals(
        self, t: Array, depth: Array, rate: Array, slip: Array | None = None, slip_rate: Array | None = None
    ) -> Signals:
        """What drives the model along a motion.

        Args:
            t: [s]. depth [m], rate [m/s]: (n,). slip [m], slip_rate [m/s]: along both tangents, (2, n); default: none.
        """
        still = np.zeros((2, len(t)))
        return Signals(
            self.layout(),
            t - t[0],
            np.diff(t, prepend=t[0]),
            depth,
            rate,
            still if slip is None else slip,
            still if slip_rate is None else slip_rate,
        )

    def __call__(self, signals: Signals) -> Array:
        """Forces along tangent1, tangent2 and normal [N], (3, n)."""
        reading = self.model.predict(signals, self.vector)
        out = np.zeros((3, reading.shape[1]))
        out[2] = reading[0]
        out[: len(reading) - 1] = reading[1:]
        return out

    def stiffness(self, deepest: float) -> float:
        """The steepest rise of the normal force with the depth, down to the deepest, in a slow motion [N/m]."""
        depth = np.linspace(0.0, max(deepest, 1e-6), 41)
        t = np.linspace(0.0, 40.0, 41)
        force = self(self.signals(t, depth, np.full(41, depth[1])))[2]
        return float(np.max(np.diff(force) / np.diff(depth)))

    def to_dict(self) -> Json:
        """For provenance."""
        return {"model": list(self.model.names), "values": dict(self.values)}


def expected_law(model: Model, values: dict[str, float]) -> Law | None:
    """The part of a model that says what force to expect of the material, or None where it holds no contact law.

    Effects of tool, sensor and joints have no part in it.
    """
    if model.contact_law is None:
        return None
    known = catalogue()
    kept: list[str] = []
    for effect in model.effects:
        stages = {stage.value for stage in effect.stages()}
        if (
            effect.id in known
            and not stages & {"tool", "sensor", "acquisition", "joint"}
            and "wrench" not in effect.needs
        ):
            try:
                part = Model(*kept, effect)
            except InputError:  # it acts on one that was left out
                continue
            if not part.needs_log:
                kept.append(effect.id)
    return Law(Model(*kept), {name: v for name, v in values.items() if name.split(".", 1)[0] in kept})
