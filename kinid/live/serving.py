"""A session for Foxglove: the recording's channels, events as a log, and the map as a cloud of points, on loopback.

The server is that of Foxglove's SDK. It offers nothing that a client could change or command: no parameters, services
or messages from clients. Only channels that somebody looks at are encoded. A gate stands before it
(`kinid.live.gate`).
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from kinid.errors import InputError, MissingDependencyError
from kinid.live.encoding import EVENTS, Coder
from kinid.live.gate import LOOPBACK, Gate, hidden_address
from kinid.live.messages import Joints, Wrench
from kinid.live.sink import Sink
from kinid.mapping.property_map import PropertyMap
from kinid.writers import Json

#: topics beside those of a recording
LOG, MAP = "/kinid/log", "/kinid/map"
#: Foxglove's usual port
PORT = 8765
#: frame that the map's places are in
FRAME = "base"
#: panels to import in Foxglove
LAYOUT = Path(__file__).with_name("foxglove.json")
#: what was sent last has so long to get there [s]
DRAIN = 0.1


class Server(Sink):
    """Serves a session to this machine. Args: joints, sensor: as `Coder`; port: 0 chooses a free one.

    Attributes:
        port: that is served. url: for Foxglove.

    Raises:
        MissingDependencyError: no SDK. InputError: the port is taken.
    """

    def __init__(self, joints: Sequence[str], sensor: str, port: int = PORT) -> None:
        try:
            import foxglove
            from foxglove import channels, messages
        except ImportError:
            raise MissingDependencyError("foxglove-sdk", "live") from None
        super().__init__("server")
        self._coder, self._messages = Coder(joints, sensor), messages
        self._context = context = foxglove.Context()  # kept: its channels go with it
        self._channels = {
            c.topic: foxglove.Channel(
                c.topic,
                schema=foxglove.Schema(name=c.schema, encoding=c.language, data=c.text),
                message_encoding=c.encoding,
                context=context,
            )
            for c in self._coder.channels
        }
        self._log = channels.LogChannel(LOG, context=context)
        self._points = channels.PointCloudChannel(MAP, context=context)
        self._map: PropertyMap | None = None
        self._stamp, self._changed = 0, False
        try:
            self._gate = Gate(port)
        except (OSError, OverflowError) as error:
            raise InputError(
                f"port {port}, which can't be had ({str(error)[:80]})",
                "a free port of this machine",
                "choose another --port, or 0 for any",
            ) from None
        address = hidden_address()
        self._server = foxglove.start_server(
            name="kinid", host=address, port=0, capabilities=[], context=context, server_listener=_listener(self)
        )
        self._gate.open(address, int(self._server.port))
        self.port = self._gate.port
        self.url = f"ws://{LOOPBACK}:{self.port}"
        self._thread.start()

    def show(self, grown: PropertyMap) -> None:
        """The map as it is now; it is sent with the time of what was sent last."""
        self._map, self._changed = grown, True

    def show_again(self) -> None:
        """Somebody has come who hasn't seen the map."""
        self._changed = True

    def close(self) -> None:
        """Send what waits, and stop serving."""
        super().close()
        time.sleep(DRAIN)  # the SDK forgets what is still on its way
        self._server.stop()
        self._gate.close()

    def _write(self, topic: str, received: int, stamp: int, what: Joints | Wrench | Json) -> None:
        # what is told before the first pair has no time of the session's
        self._stamp = stamp = stamp or self._stamp or time.time_ns()
        channel = self._channels[topic]
        if channel.has_sinks():
            channel.log(self._coder(stamp, what), log_time=stamp)
        if topic == EVENTS and self._log.has_sinks() and isinstance(what, dict):
            m = self._messages
            said = m.Log(
                timestamp=m.Timestamp(*divmod(stamp, 1_000_000_000)),
                level=m.LogLevel.Info,
                message=f"{what['kind']}: {what['says']}",
                name="kinid",
            )
            self._log.log(said, log_time=stamp)

    def _commit(self) -> None:
        if self._changed and self._map is not None and self._stamp and self._points.has_sinks():
            self._changed = False
            self._points.log(cloud(self._map, self._stamp), log_time=self._stamp)


def _listener(server: Server) -> Any:
    """Tells the server who comes; whatever a client wants else, it gets nothing."""
    from foxglove.websocket import ServerListener

    class Listener(ServerListener):  # type: ignore[misc]
        """See there."""

        def on_subscribe(self, client: object, channel: Any) -> None:
            """See there."""
            if channel.topic == MAP:
                server.show_again()

    return Listener()


def cloud(grown: PropertyMap, stamp: int) -> Any:
    """Foxglove's cloud of a map's probes: places [m] and properties, NaN where one is open. Args: stamp: [ns]."""
    from foxglove import messages as m

    names = [p.name for p in grown.properties]
    rows = np.column_stack([grown.places, *(grown.values(name) for name in names)]).astype("<f4")
    kind = m.PackedElementFieldNumericType.Float32
    fields = [
        m.PackedElementField(name=name, offset=4 * i, type=kind) for i, name in enumerate(("x", "y", "z", *names))
    ]
    return m.PointCloud(
        timestamp=m.Timestamp(*divmod(stamp, 1_000_000_000)),
        frame_id=FRAME,
        pose=m.Pose(position=m.Vector3(x=0, y=0, z=0), orientation=m.Quaternion(x=0, y=0, z=0, w=1)),
        point_stride=4 * len(fields),
        fields=fields,
        data=rows.tobytes(),
    )
