"""Contact forces from joint torques whose friction, offsets and payload a fit to free motion has found."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass

import numpy as np

from kinid.contact.series import ContactSeries, contact_series
from kinid.contact.torque_contact import by_torques
from kinid.data.log import Log
from kinid.data.rig import Rig
from kinid.errors import InputError
from kinid.identification.fitted import FittedModel
from kinid.robotics.inverse_dynamics import joint_torques
from kinid.writers import Json


@dataclass(frozen=True, eq=False)
class FromFreeMotion:
    """Contact quantities whose forces come from joint torques beside those of a fitted model.

    Attributes:
        touch: the contact quantities. effects: of the model.
    """

    touch: ContactSeries
    effects: tuple[str, ...]

    def line(self) -> str:
        """What a reader wants to know of it."""
        return f"joint torques of free motion taken off as fitted ({', '.join(self.effects)})"

    def facts(self) -> Json:
        """For JSON."""
        return {"effects": list(self.effects)}


def without_free_torques(log: Log, rig: Rig, fit: FittedModel) -> FromFreeMotion:
    """Contact quantities of a log without a wrist sensor, with the joint torques that a fit expects of its motion.

    Args:
        log: with joint torques. rig: of it. fit: of joint torques, as `kinid fit --model rigid-body,…` writes it.

    Raises:
        InputError: a log with a wrench, or a rig with a sensor; a fit to other joints.
    """
    if not by_torques(log, rig):
        raise InputError(
            f"a fit of {fit.model} for forces that don't come from joint torques",
            "a log with joint torques and no wrench, and a rig without [sensor]",
            "leave --compensate out, or name a fit with a coupling effect",
        )
    predicted = fit.predict(log, rig).T
    own = joint_torques(log, rig)
    valid = own.valid & np.isfinite(predicted).all(axis=1)
    touch = contact_series(log, rig, torques=dataclasses.replace(own, predicted=predicted, valid=valid))
    provenance = touch.provenance.then("joint torques of free motion taken off", effects=list(fit.model.names))
    return FromFreeMotion(dataclasses.replace(touch, provenance=provenance), fit.model.names)
