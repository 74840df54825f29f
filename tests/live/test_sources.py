"""Where samples come from: the senders of the documentation against the sources, files, and the laboratory."""

from __future__ import annotations

import json
import shutil
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scripted import Scripted

from kinid.data.rig import Rig
from kinid.errors import InputError
from kinid.live import open_source
from kinid.live.messages import Item, Joints, Notice, Source, Wrench
from kinid.live.sources import Asked, kinds
from kinid.live.sources.udp import Socket, parse

SENDERS = Path(__file__).parents[2] / "docs" / "senders"
NAMES = tuple(f"joint_{i}" for i in range(1, 8))
CYCLES = 200


def sender(name: str, folder: Path) -> list[str]:
    """The command of a sender; those in C++ are compiled."""
    path = SENDERS / name
    if path.suffix == ".py":
        return [sys.executable, str(path)]
    if shutil.which("g++") is None:
        pytest.skip("no C++ compiler")
    program = folder / path.stem
    subprocess.run(["g++", "-std=c++20", "-O1", "-Wall", "-Werror", "-o", program, path], check=True)
    return [str(program)]


def collect(source: Source, enough: Callable[[list[Item]], bool], seconds: float = 20.0) -> list[Item]:
    """Items until there are enough, or time is up."""
    end, out = time.monotonic() + seconds, []
    for item in source.items():
        if item is not None:
            out.append(item)
        if enough(out) or time.monotonic() > end:
            break
    source.close()
    return out


def check(items: list[Item]) -> None:
    """Both streams whole, with stamps that grow."""
    joints = [item for item in items if isinstance(item, Joints)]
    wrench = [item for item in items if isinstance(item, Wrench)]
    assert [type(i) for i in items if isinstance(i, Notice)] == []
    assert len(joints) == len(wrench) == CYCLES
    assert all(len(item.q) == 7 for item in joints)
    assert all(list(item.wrench) == [0.0, 0.0, -2.4, 0.0, 0.0, 0.0] for item in wrench)
    stamps = [item.stamp or 0 for item in joints]
    assert np.diff(stamps).min() > 0
    assert abs(stamps[0] - time.time_ns()) < 60e9


@pytest.mark.parametrize("name", ["send_udp.py", "send_udp.cpp"])
def test_senders_over_udp(name: str, tmp_path: Path) -> None:
    source = Socket("127.0.0.1:0")
    with subprocess.Popen([*sender(name, tmp_path), str(source.port), str(CYCLES)]) as process:
        check(collect(source, lambda out: len(out) >= 2 * CYCLES))
        process.wait(20)


@pytest.mark.parametrize("name", ["send_ring.py", "send_ring.cpp"])
def test_senders_in_shared_memory(name: str, tmp_path: Path) -> None:
    ring = tmp_path / "ring"
    with subprocess.Popen([*sender(name, tmp_path), str(ring), str(CYCLES)]) as process:
        while not ring.is_file() or ring.stat().st_size == 0 or ring.read_bytes()[:8] != b"KINIDSHM":
            time.sleep(0.01)
        source = open_source(f"shm:{ring}", Asked(joints=NAMES))
        check(collect(source, lambda out: len(out) >= 2 * CYCLES))
        process.wait(20)


def test_senders_are_short() -> None:
    assert {path.name: len(path.read_text().splitlines()) <= 40 for path in SENDERS.iterdir()} == dict.fromkeys(
        ("send_udp.py", "send_udp.cpp", "send_ring.py", "send_ring.cpp"), True
    )


def test_a_ring_that_runs_ahead_is_told(tmp_path: Path) -> None:
    space: dict[str, Any] = {"__name__": "sender"}
    exec((SENDERS / "send_ring.py").read_text(), space)
    path = tmp_path / "ring"
    ring = space["Ring"](path)
    source = open_source(f"shm:{path}", Asked(joints=NAMES))
    items = source.items()
    assert next(items) is None  # nothing yet
    for k in range(space["SLOTS"] + 7):
        ring.put(2, k, [float(k)] * 6)
    lost, first = next(items), next(items)
    assert isinstance(lost, Notice)
    assert (lost.kind, lost.says) == ("overrun", "7 samples were missed")
    assert isinstance(first, Wrench)
    assert first.wrench[0] == 7.0
    for _ in range(space["SLOTS"] - 1):
        next(items)
    ring.put(1, 0, [0.0] * 9)
    odd = next(items)
    assert isinstance(odd, Notice)
    assert odd.kind == "malformed"
    source.close()


@pytest.mark.parametrize(
    "line",
    [
        b"",
        b"{",
        b"[]",
        b"3",
        b"{}",
        b'{"t": "x", "q": [1]}',
        b'{"q": ["a"]}',
        b'{"t": 1e400, "q": [1]}',
        b"\xff\x00",
        b"[",
    ],
)
def test_what_is_no_line_is_told(line: bytes) -> None:
    (notice,) = parse(line * (10_000 if line == b"[" else 1), 5)
    assert isinstance(notice, Notice)
    assert notice.kind == "malformed"
    assert len(notice.says) < 400


def test_a_line_holds_what_was_sent() -> None:
    line = b'{"t": 2.5, "q": [1, 2], "dq": [3, null], "names": ["a", "b"], "wrench": [1, 2, 3, 4, 5, 6]}'
    joints, wrench = parse(line, 7)
    assert isinstance(joints, Joints)
    assert joints[:3] == (7, 2_500_000_000, [1.0, 2.0])
    assert joints.names == ("a", "b")
    assert np.isnan(joints.dq[1])
    assert wrench == Wrench(7, 2_500_000_000, [1.0, 2.0, 3.0, 4.0, 5.0, 6.0])
    assert next(parse(b'{"t_ns": 1700000000123456789, "q": [1]}', 7))[1] == 1_700_000_000_123_456_789
    assert next(parse(b'{"q": [1]}', 7))[1] is None


def test_udp_listens_on_this_machine_alone() -> None:
    source = open_source("udp://:0", Asked())
    assert isinstance(source, Socket)
    assert source.name.startswith("udp://127.0.0.1:")
    threading.Timer(0.2, source.close).start()  # a loop that waits ends when it is closed
    assert all(item is None for item in source.items())
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as taken:
        taken.bind(("127.0.0.1", 0))
        with pytest.raises(InputError, match="no way to listen"):
            open_source(f"udp://127.0.0.1:{taken.getsockname()[1]}", Asked())


def test_each_lost_line_is_known_by_its_number() -> None:
    source = open_source("udp://127.0.0.1:0", Asked(joints=NAMES))
    assert isinstance(source, Socket)
    numbers = [0, 1, 2, 4, 3, 5, 5, 9, 400, 0, 1, "7", None, 2]
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as out:
        for k, number in enumerate(numbers):
            line = {"n": number, "t": 1.0 + 1e-3 * k, "wrench": [0, 0, 0, 0, 0, 0]}
            out.sendto(json.dumps(line).encode(), ("127.0.0.1", source.port))
    items = collect(source, lambda seen: len(seen) >= len(numbers) + 4)
    notices = [(item.kind, item.says.split(" ", 1)[0]) for item in items if isinstance(item, Notice)]
    assert [kind for kind, _ in notices] == ["gap", "gap", "gap", "source-restarted", "malformed"]
    assert [says for kind, says in notices if kind == "gap"] == ["1", "3", "390"]
    assert [item.missing for item in items if isinstance(item, Notice) and item.kind == "gap"] == [1, 3, 390]
    assert sum(isinstance(item, Wrench) for item in items) == len(numbers) - 1


def test_a_log_is_replayed_as_it_is(scripted: Scripted, tmp_path: Path, rig: Rig) -> None:
    log = scripted.write(tmp_path)
    items = list(open_source(str(log), Asked(rig, NAMES, 0.0)).items())
    joints = [item for item in items if isinstance(item, Joints)]
    assert len(items) == 2 * len(scripted.log)
    assert scripted.log.q is not None
    np.testing.assert_array_equal([item.q for item in joints], scripted.log.q)
    assert [(item.stamp or 0) - 10**9 for item in joints] == np.round(1e9 * scripted.log.t).astype(int).tolist()


def test_a_replay_takes_its_time(scripted: Scripted, tmp_path: Path, rig: Rig) -> None:
    log = scripted.write(tmp_path)
    source, begin = open_source(f"file:{log}", Asked(rig, NAMES, 20.0)), time.monotonic()
    n = sum(1 for _ in source.items())
    # 15 s at twenty times the speed; a busy machine takes longer, none takes less
    assert time.monotonic() - begin >= 14.99 / 20.0
    assert n == 2 * len(scripted.log)


@pytest.mark.parametrize(
    ("address", "says"),
    [
        ("tcp://127.0.0.1:5", "udp"),
        ("udp://nowhere", "HOST:PORT"),
        ("udp://127.0.0.1:99999", "HOST:PORT"),
        ("zenoh://nowhere", "HOST:PORT"),
        ("zenoh://127.0.0.1:7447/x", "HOST:PORT/DOMAIN"),
        ("shm:/no/such/file", "begin the sender first"),
        ("lab:nothing", "one of poke"),
        ("lab:poke:x", "a whole number"),
        ("no.parquet", "no file"),
    ],
)
def test_addresses_that_lead_nowhere(address: str, says: str) -> None:
    with pytest.raises(InputError, match=says):
        open_source(address, Asked(joints=NAMES))
    with pytest.raises(InputError, match="a speed"):
        open_source("udp://127.0.0.1:0", Asked(speed=-1.0))


def test_sources_are_found_by_a_scan() -> None:
    assert set(kinds()) == {"file", "udp", "shm", "lab", "zenoh"}
    assert all(module.HELP for module in kinds().values())


def test_a_file_that_is_no_ring(tmp_path: Path) -> None:
    path = tmp_path / "x"
    for content in (b"", b"KINIDSHM", bytes(200)):
        path.write_bytes(content)
        with pytest.raises(InputError, match="ring"):
            open_source(f"shm:{path}", Asked(joints=NAMES))


def test_a_sender_that_begins_anew_again_and_again_ends_no_reader(tmp_path: Path) -> None:
    """It cuts the file off while it is read, or puts another one in its place."""
    space: dict[str, Any] = {"__name__": "sender"}
    exec((SENDERS / "send_ring.py").read_text(), space)
    path = tmp_path / "ring"
    space["Ring"](path)
    source = open_source(f"shm:{path}", Asked(joints=NAMES))
    seen: list[Item] = []
    reader = threading.Thread(target=lambda: seen.extend(item for item in source.items() if item is not None))
    reader.start()
    for run in range(30):
        if run % 3 == 2:
            path.unlink()
        ring = space["Ring"](path)
        for _ in range(5):
            ring.put(2, time.time_ns(), [float(run)] * 6)
            time.sleep(2e-3)
        if run % 3 == 2:
            time.sleep(0.1)  # another file is looked for where it is quiet
    time.sleep(0.3)
    source.close()
    reader.join(10.0)
    assert not reader.is_alive()
    told = [item for item in seen if isinstance(item, Notice)]
    assert {item.kind for item in told} <= {"source-restarted", "overrun"}
    assert sum(item.kind == "source-restarted" for item in told) >= 20
    assert max(item.wrench[0] for item in seen if isinstance(item, Wrench)) == 29.0


@pytest.mark.parametrize(
    "line",
    [b'{"wrench": [true, false, 0, 0, 0, 0]}', b'{"wrench": ["1", 0, 0, 0, 0, 0]}', b'{"q": [false]}'],
    ids=["flags", "text", "a flag"],
)
def test_what_is_no_number_is_no_sample(line: bytes) -> None:
    assert [item.kind for item in parse(line, 1) if isinstance(item, Notice)] == ["malformed"]


def test_a_table_on_one_clock_is_replayed_and_recorded_as_it_stands(tmp_path: Path, scripted: Scripted) -> None:
    """The rig's offset of the wrench's clock is of streams that aren't aligned yet."""
    from kinid.data.readers import read
    from kinid.data.readers.mcap import recorded_rig
    from kinid.live import Pipeline, Recorder, Session

    path = scripted.write(tmp_path)
    plain = (tmp_path / "rig.toml").read_text() + f"bias = {scripted.bias.tolist()}\n"
    rig = Rig.parse_text(plain + "\n[streams]\nwrench_clock_offset = -0.0013\n", folder=tmp_path)
    log = read(path, rig, NAMES)
    source = open_source(str(path), Asked(rig, NAMES, 0.0))
    pipeline = Pipeline(rig, ("kelvin-voigt",))
    tables = rig.model_dump_json(exclude_none=True, exclude={"folder"})
    recorder = Recorder(tmp_path / "out.mcap", NAMES, "ft_sensor", {"rig": tables})
    session = Session(source, pipeline, NAMES, wrench_offset=-0.0013, sinks=[recorder])
    session.run()
    again = read(tmp_path / "out.mcap", rig, NAMES)
    rows = slice(1, len(again) - 1)
    assert len(again) >= len(log) - 2
    first = int(np.argmin(np.abs(log.t - log.t[0] - (again.t[1] - again.t[0]))))
    np.testing.assert_allclose(again.q[rows], log.q[first : first + len(again) - 2], atol=1e-12)  # type: ignore[index]
    np.testing.assert_allclose(again.wrench[rows], log.wrench[first : first + len(again) - 2], atol=1e-12)  # type: ignore[index]
    found = recorded_rig(tmp_path / "out.mcap")
    assert found is not None
    assert found.sensor.bias == rig.sensor.bias
