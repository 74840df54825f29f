"""What is worth telling: of the material that is touched, of the estimates, and of the streams."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import NamedTuple

from kinid.writers import Json, finite

#: kinds of event, and what each means
KINDS = {
    "touch": "the tool touches",
    "leave": "the tool has left",
    "force-jump": "the force changed beyond what the model expects, at one place",
    "border": "the force changed beyond what the model expects while sliding: another material",
    "divergence": "the model no longer explains the force",
    "excitation-lost": "the motion no longer tells the parameters apart",
    "saturated": "a channel of the wrench is at the end of its range",
    "force-above": "the force is above what the model and its uncertainty allow",
    "reopened": "the estimators' covariance was opened",
    "warm-start": "the estimators started from what is known nearest to that place",
    "gap": "samples are missing, or a sender paused and caught up",
    "late": "a sample came behind a newer one and was left out",
    "repeated": "a sample came twice and was left out once",
    "delayed": "samples come later than before",
    "clock-jump": "the sender's clock jumped; time goes on from the last sample",
    "clock-offset": "the streams' clocks have different epochs; they were put together by the time of reception",
    "not-finite": "a sample holds what is no finite number, or none that a sensor gives",
    "dead-velocities": "velocities of the joints stay 0 while positions change; they are left out",
    "wrong-velocities": "velocities of the joints aren't the rates of the positions; they are left out",
    "joint-names": "a sample's joints are not the robot's",
    "malformed": "something came that is no sample",
    "unpaired": "a wrench without joint positions around it",
    "stream-lost": "a stream is silent",
    "stream-returned": "a stream is back",
    "overrun": "samples were overwritten before they were read",
    "recording-failed": "the recording, the map or the server ended early; the session goes on",
    "source-restarted": "the sender began anew",
    "topic": "more topics than one carry what is needed, and the first is taken; or the one that is named doesn't come",
}

#: those of them that faulty streams bring by the thousand, which are summed where people read them
OF_STREAMS = frozenset(
    (
        *("gap", "late", "repeated", "delayed", "clock-jump", "clock-offset", "not-finite", "joint-names"),
        *("malformed", "unpaired", "dead-velocities", "wrong-velocities", "overrun", "source-restarted", "topic"),
    )
)

#: bits that the compiled step sets, by kind; the last one beside a change that friction alone has shown
TOUCH, LEAVE, CHANGE, DIVERGENCE, EXCITATION, SATURATED, ABOVE, RUBS = (1 << i for i in range(8))


class Event(NamedTuple):
    """One of them.

    Attributes:
        kind: of `KINDS`. t: time since the first sample [s], of the sample it was found at.
        place: slip along both tangents and depth there [m]; NaN where no place belongs to it.
        force: normal force there [N]. says: figures, in words.
        values: that estimators started from, by the names of the parameters.
    """

    kind: str
    t: float
    says: str
    place: tuple[float, float, float] = (math.nan, math.nan, math.nan)
    force: float = math.nan
    values: Mapping[str, float] | None = None

    def __str__(self) -> str:
        where = ""
        if math.isfinite(self.place[0]):
            x, y, z = (1e3 * v for v in self.place)
            where = f" at ({x:.1f}, {y:.1f}) mm, {z:.2f} mm deep"
        return f"{self.t:9.3f} s  {self.kind}{where}: {self.says}"

    def to_dict(self) -> Json:
        """Plain types, for JSON; None where something isn't known."""
        numbers = {"slip1": self.place[0], "slip2": self.place[1], "depth": self.place[2], "normal_force": self.force}
        known = {name: finite(value) for name, value in numbers.items()}
        started = {} if self.values is None else {"values": dict(self.values)}
        return {"kind": self.kind, "t": self.t, **known, "says": self.says, **started}
