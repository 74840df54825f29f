"""Sound inputs of every kind, small ones."""

from __future__ import annotations

import io
import json
import tempfile
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet
import scipy.io
from scripted import follow

import kinid
import kinid.urdf
from kinid.lab.campaign import Campaign
from kinid.live.messages import Joints, Wrench
from kinid.live.recording import Recorder
from kinid.mapping.property_map import Probe, Property, PropertyMap
from kinid.robotics.robot import Robot
from kinid.robotics.surface import Plane

RIG = """\
[robot]
model = "lwr4plus"
sensor_frame = "ft_sensor"
gravity = [0.0, 0.0, -9.81]

[tool]
mass = 0.24
com = [0.0, 0.0, 0.049]
inertia = [0.001, 0.001, 0.001, 0, 0, 0]

[surface]
point = [0.55, 0.0, 0.10]
normal = [0, 0, 1]
tangent = [1, 0, 0]

[sensor]
range = [40, 40, 120, 2, 2, 2]
noise = [0.015, 0.014, 0.029, 0.0005, 0.0006, 0.0003]

[columns]
fx = { unit = "N", scale = 1.0 }
"""
ROWS = 500
T = np.arange(ROWS) / 100.0
CAMPAIGN: Any = {"logs": ["*.csv"], "log": [{"file": "a.csv"}], "sharing": {"hooke.stiffness": "per robot"}}
LINE = b'{"t": 12.5, "q": [0.1, 0.2], "dq": [0, 0], "names": ["a", "b"], "wrench": [1, 2, 3, 0.1, 0.2, 0.3]}\n'
COMMANDS = (
    "contact log.csv --rig rig.toml --bias none -o out.parquet --json out.json",
    "contact log.csv --bandwidth 20 -o out.csv",
    "fit bench/tester.csv --model kelvin-voigt --json out.json -o out.parquet",
    "compare bench/tester.csv --model hooke --model kelvin-voigt --json out.json",
    "diagnose bench/tester.csv --model hooke --max-effects 0 --tolerance 0.1 --json out.json",
    "diagnose --explain relaxation",
    "init log.csv --robot lwr4plus -o out.toml --json out.json",
    "changes log.csv --false-alarms 0.001 --json out.json",
    "map log.csv --model hooke --method nearest --along 0.002 -o out.parquet --json out.json",
    "effect new my-law --stage normal -o my_law.py --json out.json",
    "view log.csv --record out.html --no-open --json out.json --port 0",
    "plan poke --at 0,0 --depth 0.002 --sines 0.001@1 --duration 1 --hold 0.5 --rate 100 -o out.parquet",
    "doctor --json out.json",
)


@cache
def joints() -> dict[str, Any]:
    """A log of the arm: in the air, two pokes, a slide there and back, in the air."""
    t = np.arange(400) / 100.0
    pushed = np.clip(np.minimum(t - 0.5, 3.5 - t) / 0.3, 0.0, 1.0)
    depth = 0.004 * pushed - 0.002 + 0.001 * pushed * np.sin(12.0 * t)
    along = 0.025 * np.sin(np.pi * np.clip((t - 1.5) / 1.5, 0.0, 1.0))
    targets = np.array([0.55, 0.0, 0.10]) + np.stack([along, 0.0 * t, -depth], axis=1)
    q = follow(Robot.load(kinid.Rig.parse_text(RIG)), targets, np.zeros((len(t), 2)))
    wrench = np.random.default_rng(1).normal(size=(len(t), 6)) * 0.01
    wrench[:, 2] += 0.24 * 9.81 - 800.0 * np.maximum(depth, 0.0)
    out = {"t": t} | {f"q{j + 1}": q[:, j] for j in range(7)}
    phase = np.select([t < 0.5, t < 1.5, t < 3.0], ["free", "poke", "slide"], "retract")
    return out | dict(zip(("fx", "fy", "fz", "tx", "ty", "tz"), wrench.T)) | {"phase": phase}


@cache
def tester() -> dict[str, Any]:
    """A log of a material tester: Kelvin-Voigt in sines, with noise."""
    depth = 0.002 * np.sin(6.0 * T) + 0.001 * np.sin(23.0 * T)
    force = np.maximum(0.0, 800.0 * depth + 9.0 * np.gradient(depth, T)) * (depth > 0)
    return {"t": T, "depth": depth, "normal_force": force + np.random.default_rng(2).normal(size=ROWS) * 0.01}


def csv(columns: dict[str, Any]) -> bytes:
    """Columns as text; shorter ones end early."""
    rows = max((values.shape[0] if values.ndim else 1 for values in columns.values()), default=0)
    cells = [[str(v) for v in np.atleast_1d(values).reshape(-1)[:rows]] for values in columns.values()]
    lines = [",".join(columns)] + [",".join(c[i] if i < len(c) else "" for c in cells) for i in range(rows)]
    return "\n".join(lines).encode()


def parquet(columns: dict[str, Any], meta: object = None) -> bytes:
    """Columns of one length; what has several axes becomes lists."""
    rows = max((values.shape[0] if values.ndim else 1 for values in columns.values()), default=0)
    arrays = []
    for values in columns.values():
        plain = [v.tolist() if isinstance(v, np.ndarray) else v.item() for v in np.atleast_1d(values)]
        arrays.append(pa.array((plain + [None] * rows)[:rows]))
    table = pa.Table.from_arrays(arrays, names=list(columns))
    if meta is not None:
        table = table.replace_schema_metadata({"kinid": meta if isinstance(meta, bytes) else json.dumps(meta)})
    pyarrow.parquet.write_table(table, out := io.BytesIO())
    return out.getvalue()


def npz(columns: dict[str, Any]) -> bytes:
    """Columns as they are."""
    np.savez_compressed(out := io.BytesIO(), **{name or "_": values for name, values in columns.items()})
    return out.getvalue()


def mat(columns: dict[str, Any]) -> bytes:
    """Columns as they are, where MATLAB has such names."""
    scipy.io.savemat(out := io.BytesIO(), {n: v for n, v in columns.items() if n.isidentifier() and n.isascii()})
    return out.getvalue()


@cache
def mcap() -> bytes:
    """What a live session records."""
    with tempfile.TemporaryDirectory() as folder:
        recorder = Recorder(Path(folder) / "a.mcap", [f"joint_{j + 1}" for j in range(7)], "ft_sensor", {})
        for i in range(0, 400, 4):
            stamp, row = 10**18 + 10**7 * i, {name: float(v[i]) for name, v in joints().items() if name != "phase"}
            recorder.sample(Joints(stamp, stamp, [row[f"q{j + 1}"] for j in range(7)]), stamp)
            recorder.sample(Wrench(stamp, stamp, [row[name] for name in ("fx", "fy", "fz", "tx", "ty", "tz")]), stamp)
        recorder.close()
        return (Path(folder) / "a.mcap").read_bytes()


@cache
def bag(version: int) -> bytes:
    """A bag of ROS 1, or the file of one of ROS 2, that holds wrenches."""
    from rosbags import rosbag1, rosbag2
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS1_NOETIC if version == 1 else Stores.ROS2_HUMBLE)
    kind, types = "geometry_msgs/msg/WrenchStamped", store.types
    vector, header = types["geometry_msgs/msg/Vector3"], {"seq": 0} if version == 1 else {}
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "bag"
        with rosbag1.Writer(path) if version == 1 else rosbag2.Writer(path, version=9) as writer:
            link = writer.add_connection("/wrench", kind, typestore=store)
            for i in range(40):
                time = types["builtin_interfaces/msg/Time"](sec=10**9, nanosec=i * 10**7)
                wrench = types["geometry_msgs/msg/Wrench"](vector(1.0, 2.0, 3.0), vector(0.1, 0.2, 0.3))
                message = types[kind](types["std_msgs/msg/Header"](**header, stamp=time, frame_id="s"), wrench)
                raw = store.serialize_ros1(message, kind) if version == 1 else store.serialize_cdr(message, kind)
                writer.write(link, 10**18 + i * 10**7, raw)
        return (path if version == 1 else path / "bag.db3").read_bytes()


@cache
def fitted() -> Any:
    """A fit as it is saved."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "fit.json"
        kinid.Model("kelvin-voigt").fit(touched(csv(tester()))).save(path)
        return json.loads(path.read_text(encoding="utf-8"))


@cache
def mapped() -> tuple[dict[str, Any], Any]:
    """A map's columns and what it says of itself."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "map.parquet"
        places = [(0.5 + 0.01 * i, 0.01 * j, 0.1) for i in range(4) for j in range(4)]
        probes = [
            Probe(np.array(place), np.array([500.0 + 9 * i]), np.array([[100.0]]), 0.03, 0.03, f"{i}")
            for i, place in enumerate(places)
        ]
        plane = Plane(np.array([0.5, 0.0, 0.1]), np.eye(3))
        PropertyMap(plane, (Property("stiffness", "N/m"),), tuple(probes), "hooke").write(path)
        table = pyarrow.parquet.read_table(path)
        return {n: np.array(table[n].to_pylist()) for n in table.column_names}, json.loads(
            table.schema.metadata[b"kinid"]
        )


@cache
def planned() -> dict[str, Any]:
    """A trajectory."""
    q = {f"q{j + 1}": 0.1 * np.sin(T + j) for j in range(7)}
    return {"t": T} | q | {"phase": np.full(ROWS, "poke"), "touch": np.zeros(ROWS, dtype=int)}


@cache
def stl() -> bytes:
    """Two triangles of a plane, and a third, as text."""
    corners = ((0, 0, 0), (1, 0, 0), (1, 1, 0)), ((0, 0, 0), (1, 1, 0), (0, 1, 0)), ((1, 0, 0), (2, 0, 0), (1, 1, 0))
    facets = (
        "facet normal 0 0 1\nouter loop\n"
        + "".join(f"vertex {x} {y} {z}\n" for x, y, z in three)
        + "endloop\nendfacet\n"
        for three in corners
    )
    return f"solid part\n{''.join(facets)}endsolid part\n".encode()


@cache
def picture(kind: str) -> bytes:
    """A small picture: PNG or JPEG."""
    from PIL import Image

    Image.fromarray(np.random.default_rng(3).integers(0, 255, (12, 16, 3), dtype=np.uint8)).save(
        out := io.BytesIO(), kind
    )
    return out.getvalue()


def toml(tree: Any) -> bytes:
    """TOML of tables with plain values; JSON's scalars and lists are TOML's too, nearly."""
    lines = []
    for key, table in tree.items():
        if isinstance(table, dict):
            lines.append(f"[{json.dumps(key, ensure_ascii=False)}]")
            lines += [f"{json.dumps(k, ensure_ascii=False)} = {_inline(v)}" for k, v in table.items()]
        else:
            lines.insert(0, f"{json.dumps(key, ensure_ascii=False)} = {_inline(table)}")
    return "\n".join(lines).encode()


def _inline(value: Any) -> str:
    if isinstance(value, dict):
        return "{" + ", ".join(f"{json.dumps(k)} = {_inline(v)}" for k, v in value.items()) + "}"
    if isinstance(value, list):
        return "[" + ", ".join(map(_inline, value)) + "]"
    if isinstance(value, float):
        return str(value)
    return '""' if value is None else json.dumps(value, ensure_ascii=False)


def urdf() -> bytes:
    """The arm that comes with kinid."""
    return kinid.urdf.path("lwr4plus", Path()).read_bytes()


def touched(text: bytes) -> kinid.ContactSeries:
    """Contact quantities of a table of text."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "a.csv"
        path.write_bytes(text)
        return kinid.contact_series(kinid.read(path, kinid.Rig()), kinid.Rig())


def request(port: int) -> bytes:
    """What a browser asks."""
    lines = (
        "GET / HTTP/1.1",
        f"Host: 127.0.0.1:{port}",
        "Accept: */*",
        "Content-Length: 0",
        "Connection: close",
        "",
        "",
    )
    return "\r\n".join(lines).encode()


def manifest() -> Any:
    """What a campaign of the laboratory left."""
    task = Campaign(1, 2, seed=4)
    return json.loads(json.dumps(task.manifest(task.base()[0].rig, everything=True)))


def map_file(columns: dict[str, Any]) -> bytes:
    """A map of these columns."""
    return parquet(columns, mapped()[1])
