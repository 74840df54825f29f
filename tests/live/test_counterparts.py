"""Sessions seen by what others wrote: Foxglove's client library, MCAP's reader in TypeScript, a command-line reader.

`make counterparts` installs them; without them these tests skip by name.
"""

from __future__ import annotations

import base64
import json
import os
import shutil
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from live.prepared import NAMES, Prepared
from live.recordings import killed, messages
from scripted import Scripted

from kinid.data.rig import Rig
from kinid.live import Pipeline, Recorder, Session
from kinid.live.messages import Item
from kinid.mapping.property_map import PropertyMap

pytest.importorskip("foxglove")

ROOT = Path(__file__).parents[2]
SCRIPTS = Path(__file__).with_name("foxglove_client")
NODE = shutil.which("node")
#: npm writes it when all is there
INSTALLED = SCRIPTS / "node_modules" / ".package-lock.json"
needs_client = pytest.mark.skipif(
    NODE is None or not INSTALLED.is_file(), reason="no Foxglove client library: make counterparts, which needs npm"
)
READER = ROOT / ".venv" / "mcap-cli"
needs_reader = pytest.mark.skipif(
    not (READER / ".ready").is_file(), reason="no program that reads MCAP: make counterparts"
)
JOINTS, WRENCH, CONTACT, ESTIMATES, EVENTS = STREAMS = (
    *("/joint_states", "/ft_sensor/wrench", "/kinid/contact", "/kinid/estimates"),
    "/kinid/events",
)
TOPICS = {*STREAMS, "/kinid/log", "/kinid/map"}


@dataclass(frozen=True)
class Seen:
    """A session with two clients: lines of one that looked, and of one that gave orders; recording and map."""

    look: list[Any]
    orders: list[Any]
    recording: Path
    grown: PropertyMap
    said: str

    def of(self, topic: str) -> dict[int, Any]:
        """Messages of a topic by their stamp [ns], as the one that looked decoded them."""
        return {int(line["stamp"]): line["message"] for line in self.look if line.get("topic") == topic}


@pytest.fixture(scope="module")
def seen(scripted: Scripted, tmp_path_factory: pytest.TempPathFactory) -> Seen:
    """15 s of a log at three times its speed, served, recorded and mapped; both clients join as it begins."""
    folder = tmp_path_factory.mktemp("seen")
    recording, grown = folder / "out.mcap", folder / "map.parquet"
    command = [sys.executable, "-m", "kinid", "live", scripted.write(folder)]
    command += ["--model", "kelvin-voigt,coulomb-friction", "--speed", "3", "--tare", "2"]
    command += ["--record", recording, "--map", grown, "--serve", "--port", "0"]
    outputs = [folder / "look", folder / "orders"]
    with subprocess.Popen([*map(str, command)], stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True) as session:
        assert session.stdout is not None
        said = ""
        while "ws://" not in said:
            line = session.stdout.readline()
            assert line, said
            said += line
        url = said.split("ws://")[1].split(",")[0]
        clients = []
        for output in outputs:
            with output.open("wb") as file:
                asked = [str(NODE), str(SCRIPTS / "look.mjs"), f"ws://{url}", str(len(TOPICS)), output.name]
                clients.append(subprocess.Popen(asked, stdout=file, stderr=subprocess.PIPE, text=True))
        said += session.communicate(timeout=60)[0]
        ends = [client.communicate(timeout=30)[1] for client in clients]
    assert session.returncode == 0, said
    assert [client.returncode for client in clients] == [0, 0], ends
    look, orders = ([json.loads(line) for line in output.read_text().splitlines()] for output in outputs)
    return Seen(look, orders, recording, PropertyMap.read(grown), said)


def plain(message: Any) -> Any:
    """A message of ROS 2 as a client in another language has it: fields by name."""
    if hasattr(message, "__dataclass_fields__"):
        fields = [name for name in message.__dataclass_fields__ if not name.startswith("__")]
        return {name: plain(getattr(message, name)) for name in fields}
    return message.tolist() if isinstance(message, np.ndarray) else message


@needs_client
def test_foxgloves_client_library_sees_what_is_recorded(seen: Seen) -> None:
    """Each message that it decodes is the recording's to the last bit, and from its first on none is missing."""
    info, channels = seen.look[0]["info"], seen.look[1]["channels"]
    assert (info["name"], info["capabilities"]) == ("kinid", [])
    assert {channel["topic"] for channel in channels} == TOPICS
    assert not [line for line in seen.look if "status" in line]
    recorded: dict[str, dict[int, Any]] = {topic: {} for topic in STREAMS}
    for topic, stamp, _, message in messages(seen.recording):
        recorded[topic][stamp] = plain(message)
    begin = max(min(seen.of(topic)) for topic in (JOINTS, WRENCH, CONTACT, ESTIMATES))
    for topic in STREAMS:
        found = seen.of(topic)
        first = begin if topic == EVENTS else min(found)
        expected = {stamp: message for stamp, message in recorded[topic].items() if first <= stamp <= max(found)}
        assert found == expected, topic
        print(f"{topic}: {len(found)} of {len(recorded[topic])} messages")
        # it takes the client a second to start, three of the log's; the touch comes after four
        assert len(found) > 0.5 * len(recorded[topic]), topic
    assert seen.of(EVENTS)[max(recorded[EVENTS])]["kind"] == "leave"


@needs_client
def test_it_sees_events_as_a_log_and_the_map_as_a_cloud(seen: Seen) -> None:
    expected = {stamp: f"{event['kind']}: {event['says']}" for stamp, event in seen.of(EVENTS).items()}
    log = seen.of("/kinid/log")
    assert {stamp: message["message"] for stamp, message in log.items()} == expected
    for stamp, message in log.items():
        assert 10**9 * int(message["timestamp"]["seconds"]) + message["timestamp"]["nanos"] == stamp
        assert (message["level"], message["name"]) == (2, "kinid")
    cloud = seen.of("/kinid/map")
    last = cloud[max(cloud)]
    names = [field["name"] for field in last["fields"]]
    assert names == ["x", "y", "z", *(p.name for p in seen.grown.properties)]
    assert [field["type"] for field in last["fields"]] == [7] * len(names)  # Foxglove's float32
    assert [field["offset"] for field in last["fields"]] == [4 * i for i in range(len(names))]
    assert last["pointStride"] == 4 * len(names)
    rows = np.frombuffer(base64.b64decode(last["data"]), "<f4").reshape(-1, len(names))
    values = [seen.grown.values(p.name) for p in seen.grown.properties]
    np.testing.assert_array_equal(rows, np.column_stack([seen.grown.places, *values]).astype("<f4"))
    assert len(rows) > 0


@needs_client
def test_it_is_refused_all_orders(seen: Seen) -> None:
    """A topic of its own, messages on it and on ours, parameters, services, files and the graph."""
    answers = [line for line in seen.orders if "status" in line or "answer" in line]
    said = [line["status"]["message"] if "status" in line else line["what"]["message"] for line in answers]
    for what in ("clientPublish", "parameters", "parametersSubscribe", "services", "assets", "connection graph"):
        assert any(message.startswith(f"Server does not support {what}") for message in said), what
    assert sum(message.startswith("Unknown channel ID") for message in said) == 2
    assert all(line["status"]["level"] == 2 for line in answers if "status" in line)  # errors
    assert {line["answer"] for line in answers if "answer" in line} == {"serviceCallFailure"}
    # and the session went on as if nobody had asked
    assert {topic for topic, *_ in messages(seen.recording)} == set(STREAMS)
    assert "7500 samples over 15 s" in seen.said


def read(path: Path) -> list[Any]:
    """What MCAP's reader in TypeScript finds, a line each."""
    done = subprocess.run(
        [str(NODE), str(SCRIPTS / "read.mjs"), str(path)], capture_output=True, text=True, timeout=60, check=False
    )
    assert done.returncode == 0, done.stderr
    return [json.loads(line) for line in done.stdout.splitlines()]


@needs_client
def test_mcaps_reader_in_typescript_reads_a_recording(seen: Seen) -> None:
    header, metadata, *found, end = read(seen.recording)
    assert header["header"] == {"profile": "ros2", "library": "kinid"}
    assert metadata["metadata"]["values"]["model"] == "kelvin-voigt,coulomb-friction"
    # all of it by its index, too: Foxglove takes no file of more than a gibibyte without
    in_time = sorted(found, key=lambda m: int(m["logTime"]))
    assert end == {"whole": True, "sought": [m["sequence"] for m in in_time]}
    assert [(m["topic"], int(m["publishTime"]), int(m["logTime"]), m["message"]) for m in found] == [
        (topic, stamp, received, plain(message)) for topic, stamp, received, message in messages(seen.recording)
    ]


@needs_client
def test_it_reads_what_a_killed_program_leaves(tmp_path: Path) -> None:
    killed(tmp_path / "out.mcap", 0.4)
    _, _, *found, end = read(tmp_path / "out.mcap")
    assert end == {"whole": True, "sought": None}
    forces = [m["message"]["wrench"]["force"]["x"] for m in found]
    assert len(forces) > 200  # of 400
    assert forces == list(range(len(forces)))


def ask(verb: str, path: Path) -> list[Any]:
    """Lines of JSON that the program answers."""
    options = ["--format", "jsonl"] if verb == "doctor" else []
    done = subprocess.run(
        [str(READER / "bin" / "pymcap-cli"), verb, *options, str(path)],
        env=os.environ | {"PYTHONPATH": str(READER)},
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    return [json.loads(line) for line in done.stdout.splitlines()]


@needs_reader
@pytest.mark.parametrize("whole", [True, False])
def test_a_program_that_reads_mcap_finds_no_fault(rig: Rig, rows: list[Item], tmp_path: Path, whole: bool) -> None:
    """It holds the file against the format's specification, and prints the same messages."""
    path = tmp_path / "out.mcap"
    if whole:
        sinks = [Recorder(path, NAMES, "ft_sensor", {"model": "kelvin-voigt"})]
        Session(Prepared(rows[:6000]), Pipeline(rig, ("kelvin-voigt",)), NAMES, sinks=sinks).run()
    else:
        killed(path, 0.4)
    expected = messages(path)
    *findings, summary = ask("doctor", path)
    # no attachment, nothing compressed, no summary where the program was killed: as the specification leaves open
    assert {one["severity"] for one in findings} <= {"info"}
    assert (summary["errors"], summary["warnings"], summary["messages"]) == (0, 0, len(expected))
    assert [(m["topic"], m["publish_time"], m["log_time"], m["message"]) for m in ask("cat", path)] == [
        (topic, stamp, received, plain(message)) for topic, stamp, received, message in expected
    ]
