"""What one log says without a model of the material: contact frame or tip motion, and joint torques."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from kinid.contact.doubts import contact_doubts, left_out, unused_offset
from kinid.contact.series import ContactSeries, contact_series, tip_motion
from kinid.contact.torque_doubts import torque_doubts
from kinid.contact.touching import touches
from kinid.data.log import Log, Provenance, Step
from kinid.data.rig import CONTACT, Rig
from kinid.errors import InputError
from kinid.robotics.inverse_dynamics import JointTorques, joint_torques
from kinid.robotics.motion import TipMotion
from kinid.robotics.robot import Robot
from kinid.robotics.wrench import Bias
from kinid.signal.derivative import Differentiator
from kinid.writers import Json

#: unit of each contact quantity
UNITS = dict(zip(CONTACT, ("m", "m/s", "m", "m", "m/s", "m/s", "N", "N", "N")))


@dataclass(frozen=True, eq=False)
class Analysis:
    """What a log and its rig gave: contact-frame quantities, or the tip's motion; and joint torques where logged."""

    contact: ContactSeries | None
    tip: TipMotion | None
    torques: JointTorques | None
    provenance: Provenance

    def with_contact(self, touch: ContactSeries) -> Analysis:
        """The same with other contact quantities."""
        return dataclasses.replace(self, contact=touch, provenance=touch.provenance)

    def columns(self) -> dict[str, NDArray[np.generic]]:
        """Columns of the table to write."""
        if self.contact is not None:
            return self.contact.columns()
        out: dict[str, NDArray[np.generic]] = dict(self.tip.columns()) if self.tip is not None else {}
        if self.torques is not None:
            out.setdefault("t", self.torques.t)
            out |= {f"tau{j + 1}_model": self.torques.predicted[:, j] for j in range(self.torques.predicted.shape[1])}
        return out

    def summary(self) -> Json:
        """Figures for a terminal or JSON: ranges, contact, joint torques, provenance."""
        columns = {k: v.astype(np.float64) for k, v in self.columns().items() if v.dtype.kind == "f" and k != "t"}
        out: Json = {"ranges": {k: _range(v) for k, v in columns.items()}}
        if self.contact is not None:
            touch = self.contact
            out |= {
                "samples": len(touch),
                "invalid_samples": int((~touch.valid).sum()),
                "in_contact": float(np.mean(touch.in_contact)),
                "touches": len(touches(touch.t, touch.in_contact, touch.valid)),
            }
        if self.torques is not None:
            out["joint_torques"] = {
                name: {"measured_rms": float(m), "residual_rms": float(r)}
                for name, m, r in zip(self.torques.joint_names, self.torques.measured_rms, self.torques.rms)
            }
        out["provenance"] = self.provenance.to_dict()
        return out


def analyse(
    log: Log,
    rig: Rig,
    *,
    robot: Robot | None = None,
    bias: Bias = "auto",
    differentiator: Differentiator | None = None,
    trust_wrench: bool = False,
) -> Analysis:
    """Contact quantities where the rig has a surface (or the log holds them itself), else the tip's motion; torques
    too.

    Raises:
        InputError: a log that holds neither joints nor contact quantities.
    """
    contact = tip = torques = None
    if log.q is None and not log.contact:
        raise InputError(
            f"neither joints nor depth in {log.provenance.source}",
            "q1…qN, or depth and normal_force",
            "name the columns in [columns] of the rig",
        )
    if log.q is not None:
        robot = robot or Robot.load(rig)
    if log.q is None or rig.surface is not None:
        contact = contact_series(
            log, rig, robot=robot, bias=bias, differentiator=differentiator, trust_wrench=trust_wrench
        )
    elif robot is not None and (robot.tip_frame or robot.sensor_frame):
        tip = tip_motion(log, rig, robot=robot, bias=bias, differentiator=differentiator, trust_wrench=trust_wrench)
    if log.tau is not None and log.q is not None and not rig.external_torques:
        # the bias that motion clear of the surface has shown serves the torques too
        known = bias if contact is None or contact.bias is None else contact.bias.tolist()
        torques = joint_torques(log, rig, robot=robot, bias=known, differentiator=differentiator)
    if contact is None and tip is None and torques is None and robot is not None:
        raise InputError(
            f"a rig without [surface] and {robot.name} without the frames 'tool_tip' and 'ft_sensor'",
            "the contact point and the sensor's frame",
            f"name [robot] tip_frame and sensor_frame, at the end of the arm: {', '.join(robot.end_frames)}; with "
            "[surface] point and normal there are contact-frame quantities",
        )
    made = contact or torques
    provenance = made.provenance if made else log.provenance
    if made is None and tip is not None:
        provenance = provenance.after(*tip.steps)
    absent = (left_out(log, rig, robot), unused_offset(log, rig))
    provenance = provenance.after(*(step for step in absent if step is not None))
    doubts = [*contact_doubts(log, rig, robot, contact), *torque_doubts(torques, rig, log, robot)]
    if doubts:
        provenance = provenance.after(Step("doubts", {}, tuple(doubts)))
    return Analysis(contact, tip, torques, provenance)


def _range(values: NDArray[np.float64]) -> dict[str, float] | None:
    finite = values[np.isfinite(values)]
    return {"min": float(finite.min()), "max": float(finite.max())} if len(finite) else None
