"""The server for Foxglove, seen by a WebSocket client that speaks its protocol."""

from __future__ import annotations

import contextlib
import json
import re
import socket
import struct
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from live.prepared import NAMES, Prepared

pytest.importorskip("foxglove")

from rosbags.typesys import Stores, get_typestore
from websockets.exceptions import ConnectionClosed, WebSocketException
from websockets.sync.client import ClientConnection, connect
from websockets.typing import Origin, Subprotocol

from kinid.data.rig import Rig
from kinid.errors import InputError, MissingDependencyError
from kinid.live import Event, Pipeline, Session
from kinid.live.messages import Item, Joints, Wrench
from kinid.live.serving import LAYOUT, Server
from kinid.mapping.property_map import Probe, Property, PropertyMap
from kinid.robotics.surface import Plane

PROTOCOL = Subprotocol("foxglove.sdk.v1")
TOPICS = {
    *("/joint_states", "/ft_sensor/wrench", "/kinid/contact", "/kinid/estimates"),
    *("/kinid/events", "/kinid/log", "/kinid/map"),
}


@pytest.fixture
def server() -> Iterator[Server]:
    made = Server(NAMES, "sensor", 0)
    yield made
    made.close()


class Viewer:
    """What Foxglove does: it takes the channels that are offered, and subscribes to all of them."""

    def __init__(self, connection: ClientConnection) -> None:
        self.connection = connection
        self.info = json.loads(self.connection.recv(5))
        self.channels = {}
        while len(self.channels) < len(TOPICS):
            message = json.loads(self.connection.recv(5))
            if message["op"] == "advertise":
                self.channels.update({channel["id"]: channel for channel in message["channels"]})
        wanted = [{"id": number, "channelId": number} for number in self.channels]
        self.connection.send(json.dumps({"op": "subscribe", "subscriptions": wanted}))

    def messages(self, seconds: float = 0.5) -> list[tuple[str, int, bytes]]:
        """Topic, time [ns] and bytes of all that comes until nothing does for so long, or the server ends."""
        out = []
        while True:
            try:
                data = self.connection.recv(seconds)
            except (TimeoutError, ConnectionClosed):
                return out
            if isinstance(data, bytes) and data[0] == 1:
                number, stamp = struct.unpack_from("<IQ", data, 1)
                out.append((self.channels[number]["topic"], stamp, data[13:]))


@contextlib.contextmanager
def viewed(server: Server) -> Iterator[Viewer]:
    with connect(server.url, subprotocols=[PROTOCOL], max_size=None, max_queue=None) as connection:
        yield Viewer(connection)


def test_a_session_is_seen(server: Server, rig: Rig, rows: list[Item]) -> None:
    with viewed(server) as viewer:
        assert viewer.info["name"] == "kinid"
        assert viewer.info["capabilities"] == []
        assert {c["topic"] for c in viewer.channels.values()} == TOPICS
        time.sleep(0.1)  # its subscriptions get there
        session = Session(Prepared(rows[:6000]), Pipeline(rig, ("kelvin-voigt",)), NAMES, sinks=[server])
        server.show(grown())
        session.run()
        found = viewer.messages()
    by_topic = {topic: [(stamp, data) for name, stamp, data in found if name == topic] for topic in TOPICS}
    assert all(by_topic.values()), {topic: len(of) for topic, of in by_topic.items()}
    store = get_typestore(Stores.ROS2_HUMBLE)
    sent: Any = {(type(row), row.stamp): row for row in rows if isinstance(row, Joints | Wrench)}
    for stamp, data in by_topic["/joint_states"]:
        last: Any = store.deserialize_cdr(data, "sensor_msgs/msg/JointState")
        assert last.position.tolist() == sent[Joints, stamp].q.tolist()
    assert tuple(last.name) == NAMES
    for stamp, data in by_topic["/ft_sensor/wrench"]:
        force: Any = store.deserialize_cdr(data, "geometry_msgs/msg/WrenchStamped")
        assert force.wrench.force.z == sent[Wrench, stamp].wrench[2]
    assert json.loads(by_topic["/kinid/events"][0][1])["kind"] == "touch"
    assert b"touch: " in by_topic["/kinid/log"][0][1]
    assert "stiffness" in json.loads(by_topic["/kinid/estimates"][-1][1])["values"]
    contact = json.loads(by_topic["/kinid/contact"][-1][1])
    assert contact["in_contact"] is True
    assert by_topic["/kinid/contact"][-1][0] == 10**9 + round(1e9 * contact["t"])


def grown() -> PropertyMap:
    surface = Plane(np.array([0.55, 0.0, 0.1]), np.eye(3))
    probes = [
        Probe(np.array([0.5 + 0.01 * k, 0.0, 0.1]), np.array([700.0 + k, 0.4]), np.diag([1.0, 1e-4])) for k in range(5)
    ]
    return PropertyMap(surface, (Property("stiffness", "N/m"), Property("friction", "1")), tuple(probes))


def test_who_comes_late_sees_the_map(server: Server) -> None:
    server.show(grown())
    server.event(Event("gap", 0.0, "so long"), 0, 7)
    time.sleep(0.1)
    for _ in range(2):
        with viewed(server) as viewer:
            ((topic, stamp, data),) = viewer.messages()
        assert (topic, stamp) == ("/kinid/map", 7)
        assert np.array([[0.54, 0.0, 0.1, 704.0, 0.4]], "<f4").tobytes() in data
        assert all(name in data for name in (b"stiffness", b"friction", b"base"))


def test_it_answers_this_machine_alone_and_takes_no_orders(server: Server) -> None:
    lines = [line.split() for line in Path("/proc/net/tcp").read_text().splitlines()[1:]]
    assert [line[1] for line in lines if line[3] == "0A" and line[1].endswith(f":{server.port:04X}")] == [
        f"0100007F:{server.port:04X}"
    ]
    with pytest.raises(WebSocketException), connect(server.url):  # without the protocol
        pass
    order = {"op": "advertise", "channels": [{"id": 1, "topic": "/x", "encoding": "json", "schemaName": ""}]}
    with viewed(server) as viewer:
        viewer.connection.send(json.dumps(order))
        said = json.loads(viewer.connection.recv(5))
    assert (said["op"], said["level"]) == ("status", 2)


@pytest.mark.parametrize("origin", ["https://app.foxglove.dev", "http://localhost:8080", "file://"])
def test_pages_of_foxglove_and_of_this_machine_may_look(server: Server, origin: str) -> None:
    with connect(server.url, subprotocols=[PROTOCOL], origin=Origin(origin)) as connection:
        assert json.loads(connection.recv(5))["op"] == "serverInfo"


@pytest.mark.parametrize(
    "headers",
    [
        {"Origin": "https://example.org"},
        {"Origin": "null"},
        {"Origin": "https://app.foxglove.dev.example.org"},
        {"Origin": "http://localhost.example.org"},
        {"Host": "example.org:8765"},
    ],
)
def test_pages_of_elsewhere_get_nothing(server: Server, headers: dict[str, str]) -> None:
    sent = {"Host": f"127.0.0.1:{server.port}", "Upgrade": "websocket", "Connection": "Upgrade"} | headers
    sent |= {"Sec-WebSocket-Key": "x" * 22 + "==", "Sec-WebSocket-Version": "13", "Sec-WebSocket-Protocol": PROTOCOL}
    with socket.create_connection(("127.0.0.1", server.port)) as visitor:
        visitor.sendall("".join(["GET / HTTP/1.1\r\n", *(f"{k}: {v}\r\n" for k, v in sent.items()), "\r\n"]).encode())
        visitor.settimeout(5)
        answer = b""
        while some := visitor.recv(4096):
            answer += some
    assert answer.startswith(b"HTTP/1.1 403")


def test_visitors_that_speak_no_http_harm_nobody(server: Server) -> None:
    with socket.create_connection(("127.0.0.1", server.port)) as mute, viewed(server):
        for bytes_ in (b"\x00" * 200_000, b"GET"):
            with contextlib.suppress(OSError), socket.create_connection(("127.0.0.1", server.port)) as rude:
                rude.sendall(bytes_)
        assert mute.fileno() > 0
        with viewed(server):  # and others are answered meanwhile
            pass


def test_the_gate_ends_with_the_process() -> None:
    code = (
        "import sys; from kinid.live.serving import Server; s = Server(['a'], 'sensor', 0); print(s.port, flush=True);"
        "import os, signal; os.kill(os.getpid(), signal.SIGKILL)"
    )
    port = int(subprocess.run([sys.executable, "-c", code], capture_output=True, check=False).stdout)
    for _ in range(50):
        try:
            socket.create_connection(("127.0.0.1", port)).close()
        except ConnectionRefusedError:
            return
        time.sleep(0.1)
    pytest.fail("somebody still listens")


def test_what_the_layout_shows_is_served(server: Server) -> None:
    """Each topic and field of its panels is one of the server's."""
    layout = json.loads(LAYOUT.read_text())
    panels = layout["configById"]
    placed = re.findall(r'"([A-Za-z0-9]+![a-z]+)"', json.dumps(layout["layout"]))
    assert sorted(placed) == sorted(panels)
    with viewed(server) as viewer:
        schemas = {c["topic"]: c for c in viewer.channels.values()}
    paths = [path["value"] for panel in panels.values() for path in panel.get("paths", ())]
    assert len(paths) > 10
    for path in paths:
        topic, *fields = path.split(".")
        schema = schemas[topic]["schema"]
        if schemas[topic]["schemaEncoding"] == "jsonschema":
            at = json.loads(schema)
            for field in fields:
                at = at["properties"][field]
            assert at["type"] == "number", path
        else:
            assert all(re.search(rf"\b{field.split('[')[0]}\b", schema) for field in fields), path
    assert set(panels["3D!map"]["topics"]) <= TOPICS
    assert panels["RosOut!events"]["topicToRender"] in TOPICS


def test_wrong_use_is_one_line(monkeypatch: pytest.MonkeyPatch) -> None:
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        with pytest.raises(InputError, match="can't be had"):
            Server(NAMES, "sensor", taken.getsockname()[1])
    monkeypatch.setitem(sys.modules, "foxglove", None)
    with pytest.raises(MissingDependencyError, match=r"kinid\[live\]"):
        Server(NAMES, "sensor", 0)
