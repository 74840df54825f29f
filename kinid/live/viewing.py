"""The session in a browser while it goes on: arm, force measured and expected, map, and marks where something was."""

from __future__ import annotations

import time
from collections import deque
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from kinid.data.rig import Rig
from kinid.live.encoding import CONTACT
from kinid.live.events import Event
from kinid.live.messages import Joints, Wrench
from kinid.live.pipeline import Pipeline
from kinid.live.sink import Sink
from kinid.mapping.property_map import PropertyMap
from kinid.viewer import scene as scenes
from kinid.viewer.page import page
from kinid.viewer.server import ViewServer
from kinid.writers import Json

Array = NDArray[np.float64]

#: frames a second, how many of them are shown, and time between two pictures [s]
FRAMES, KEPT, REFRESH = 20.0, 400, 0.2
#: an arrow is so long at the largest force of the picture [m]; smaller forces than that are none [N]
ARROW, LEAST = 0.12, 1.0
#: marks that are shown, and the events that get one with their colours
MARKS = 200
COLOURS = {
    "touch": "#009E73",
    "border": "#E69F00",
    "force-jump": "#CC79A7",
    "force-above": "#D55E00",
    "divergence": "#D55E00",
}


class Frame(NamedTuple):
    """One sample: time [s], positions (N,), tip (3,) [m], force measured and expected, base axes, (3,) [N]."""

    t: float
    q: Array
    tip: Array
    measured: Array
    expected: Array


class Viewing(Sink):
    """Shows a session to the browsers of this machine, the last seconds of it, and the map that grows.

    Args:
        pipeline: whose session it is. rig: with its robot and surface. title: of the page. port: 0 chooses a free one.

    Attributes:
        url: of the page.

    Raises:
        InputError: the port is taken, or meshcat's renderer isn't there.
    """

    def __init__(self, pipeline: Pipeline, rig: Rig, title: str, port: int = 0) -> None:
        super().__init__("view")
        self._pipeline, self._robot = pipeline, pipeline.contact.robot
        self._frames, self._marks = deque[Frame](maxlen=KEPT), deque[tuple[Array, str, str]](maxlen=MARKS)
        self._last, self._shown, self._sent, self._marked = -np.inf, -np.inf, 0.0, False
        self._map: PropertyMap | None = None
        self._scene: Json = {
            "title": title,
            "live": True,
            "robot": scenes.robot_scene(rig, self._robot),
            "ground": {"centre": [0.3, 0.0, -2e-3], "size": 0.9},
            "views": scenes.views(None, True, True),
        }
        patch = scenes.patch_scene(rig)
        if patch is not None:
            self._scene["patch"] = patch
        self._server = ViewServer(lambda: page(self._scene), port, "--view")
        self.url = self._server.url
        self._thread.start()

    def show(self, grown: PropertyMap) -> None:
        """The map has grown."""
        self._map = grown

    def sample(self, message: Joints | Wrench, stamp: int) -> None:
        """Nothing: the contact quantities say it all."""

    def state(self, topic: str, received: int, stamp: int, values: Json) -> None:
        """Where the arm is, and the forces at its tip."""
        if topic != CONTACT or values["depth"] is None or abs(values["t"] - self._last) < 1.0 / FRAMES:
            return
        contact, self._last = self._pipeline.contact, values["t"]
        axes = contact.axes
        measured = np.array([values["tangential_force1"], values["tangential_force2"], values["normal_force"]], float)
        expected = np.append(self._pipeline.predicted_friction, values["predicted_normal_force"] or 0.0)
        touching = bool(values["in_contact"])
        tip = contact.place - values["depth"] * axes[2]
        still = np.zeros(3)
        self._frames.append(
            Frame(
                values["t"],
                contact.positions,
                tip,
                np.nan_to_num(measured) @ axes if touching else still,
                np.nan_to_num(expected) @ axes if touching else still,
            )
        )

    def event(self, event: Event, received: int, stamp: int) -> None:
        """A mark where it was."""
        if event.kind in COLOURS:
            self._marks.append((self._pipeline.place, COLOURS[event.kind], str(event)))
            self._marked = True

    def close(self) -> None:
        """The last picture, and the server's end."""
        super().close()
        self._server.close()

    def _write(self, topic: str, received: int, stamp: int, what: Joints | Wrench | Json) -> None:
        """Nothing waits."""

    def _commit(self) -> None:
        """A picture, where it is time for one; in the thread."""
        now = time.monotonic()
        if now - self._sent < REFRESH:
            return
        self._sent = now
        frames = list(self._frames)
        message: Json = {}
        if len(frames) > 1 and frames[-1].t != self._shown:
            self._shown = frames[-1].t
            message |= {"motion": self._motion(frames), "follow": True}
        if self._marked:
            self._marked = False
            marks = list(self._marks)
            message["marks"] = [{"at": np.round(at, 5).tolist(), "color": c, "says": says} for at, c, says in marks]
        if self._map is not None:
            grown, self._map = self._map, None
            message["map"] = scenes.map_scene(grown)
            message["views"] = scenes.views(grown, True, True)
        if message:
            # who comes later begins at the newest frame
            self._scene = self._scene | message | {"frame": max(len(frames) - 1, 0)}
            self._server.send(message)

    def _motion(self, frames: list[Frame]) -> Json:
        """The last seconds as `kinid.viewer.scene.motion_scene` has those of a log."""
        t, q, tip, measured, expected = (np.array(column) for column in zip(*frames, strict=True))
        poses = np.array([scenes.joint_poses(self._robot, row) for row in self._robot.configuration(q)])
        largest = float(np.linalg.norm(measured, axis=1).max())
        return {
            "t": scenes.packed(t - t[0], "<f4"),
            "poses": scenes.packed(poses, "<f4"),
            "n": len(t),
            "joints": self._robot.model.njoints,
            "tip": scenes.packed(tip, "<f4"),
            "scale": ARROW / max(largest, LEAST),
            "measured": scenes.packed(measured, "<f4"),
            "predicted": scenes.packed(expected, "<f4"),
        }
