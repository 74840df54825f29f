"""The measured logs: how each is read, and what a user of such a machine starts with."""

from __future__ import annotations

import dataclasses
import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from hidden.measured import drive, lwr4plus, motor, poses, silicone
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

import kinid

Array = NDArray[np.float64]
Pair = tuple[kinid.Log, kinid.Rig]

DRY, VISCOUS, OFFSET = "joint-coulomb-friction", "joint-viscous-friction", "joint-torque-offset"
ASYMMETRY, GAIN = "joint-friction-asymmetry", "joint-torque-gain"
#: every fourth sample of the 1 kHz arm; the part of a long slide that is looked at
PANDA_STEP, SLIDE = 4, 6000
#: what turns currents of a UR10e into torques [N·m/A], joint by joint, as S. Mamedov found them; a user has such
#: figures
UR_GAINS = np.array([14.87, 13.26, 11.13, 10.62, 11.03, 11.47])


@dataclass(frozen=True)
class Source:
    """A measured log, and the model that a user starts from.

    Attributes:
        family: which changes fit it: "arm" (joint torques of a known robot), "axis" (of an axis alone), "tester" (force
            over depth), "places" (force and depth at many places), "slide" (with tangential forces), "wrench" (a tool
            in the air).
    """

    name: str
    family: str
    read: Callable[[Path], Pair]
    model: tuple[str, ...]


def part(log: kinid.Log, rows: slice) -> kinid.Log:
    """A stretch of a log."""
    some: dict[str, Any] = {
        name: getattr(log, name)[rows]
        for name in ("q", "dq", "ddq", "tau", "q_cmd", "wrench", "phase")
        if getattr(log, name) is not None
    }
    return dataclasses.replace(log, t=log.t[rows], contact={k: v[rows] for k, v in log.contact.items()}, **some)


def halves(log: kinid.Log) -> tuple[kinid.Log, kinid.Log]:
    """The first half in time, and the second."""
    middle = int(np.searchsorted(log.t, 0.5 * (log.t[0] + log.t[-1])))
    return part(log, slice(0, middle)), part(log, slice(middle, None))


def panda(real: Path) -> Pair:
    """An arm with torque sensors on an exciting trajectory; accelerations are not logged."""
    folder = real / "panda-motion"
    q, dq, tau = (
        np.loadtxt(folder / f"exciting_traj_{name}.txt").reshape(-1, 7)[::PANDA_STEP]
        for name in ("positions", "velocity", "torques")
    )
    t = np.loadtxt(folder / "exciting_traj_time.txt")[::PANDA_STEP]
    rig = {"robot": {"model": "panda", "joints": [f"panda_joint{k}" for k in range(1, 8)]}}
    return kinid.Log(t=t, q=q, dq=dq, tau=tau, phase=np.full(len(t), "free")), kinid.Rig.parse(rig)


def ur10e(name: str) -> Callable[[Path], Pair]:
    """An arm whose motor currents were logged; its nearest known model is that of the older UR10."""

    def read(real: Path) -> Pair:
        raw = np.loadtxt(real / "ur10e-motion" / f"{name}.csv", delimiter=",")
        raw = raw[np.concatenate([[True], np.diff(raw[:, 0]) > 0])]
        log = kinid.Log(
            t=raw[:, 0] - raw[0, 0],
            q=raw[:, 1:7],
            dq=raw[:, 7:13],
            tau=UR_GAINS * raw[:, 13:19],
            phase=np.full(len(raw), "free"),
        )
        return log, kinid.Rig.parse({"robot": {"model": "ur10"}})

    return read


def probes(real: Path) -> Pair:
    """Seven hundred probes of 2 mm on a phantom with hidden bodies, ten readings each, the tool at rest."""
    with np.load(real / "phantom-probing" / "probe_probingRAL2018_T1.npz", allow_pickle=False) as data:
        keep = np.linalg.norm(data["normal"], axis=1) > 0.5
        position, force, normal = 1e-3 * data["pos"][keep], data["force"][keep], data["normal"][keep]
        touch = 1e-3 * data["contact_ball_center"][keep]
    depth = -np.einsum("ijk,ik->ij", position - touch[:, None], normal)
    away = touch - touch.mean(axis=0)
    place = np.repeat(away @ np.linalg.svd(away, full_matrices=False)[2][:2].T, depth.shape[1], axis=0)
    still = np.zeros(depth.size)
    contact = {
        "depth": depth.ravel(),
        "depth_rate": still,
        "normal_force": np.einsum("ijk,ik->ij", force, normal).ravel(),
        "slip1": place[:, 0].copy(),
        "slip2": place[:, 1].copy(),
        "slip_rate1": still,
        "slip_rate2": still,
    }
    t = np.add.outer(2.0 * np.arange(len(depth)), 0.1 * np.arange(depth.shape[1])).ravel()
    return kinid.Log(t=t, contact=contact), kinid.Rig()


def slide(real: Path) -> Pair:
    """A ball sliding over the same phantom; depth is below the plane that lies 5 mm above its mean path."""
    with np.load(real / "phantom-probing" / "ContPalpRAL18T1.npz", allow_pickle=False) as data:
        t, place, force = (data[key][:SLIDE] for key in ("t", "pos_mm", "force_N"))
    touching = place[force[:, 2] > 0.3]
    slope = np.linalg.lstsq(np.c_[touching[:, :2], np.ones(len(touching))], touching[:, 2], rcond=None)[0]
    normal = np.array([-slope[0], -slope[1], 1.0]) / np.sqrt(1.0 + slope[0] ** 2 + slope[1] ** 2)
    first = np.cross([0.0, 1.0, 0.0], normal)
    axes = np.array([first / np.linalg.norm(first), np.cross(normal, first / np.linalg.norm(first)), normal])
    x, f = 1e-3 * (place - touching.mean(axis=0)) @ axes.T, force @ axes.T
    contact = {
        "depth": 5e-3 - x[:, 2],
        "normal_force": f[:, 2].copy(),
        "slip1": x[:, 0].copy(),
        "slip2": x[:, 1].copy(),
        "tangential_force1": f[:, 0].copy(),
        "tangential_force2": f[:, 1].copy(),
    }
    return kinid.Log(t=t - t[0], contact=contact), kinid.Rig()


@cache
def _folder() -> Path:
    return Path(tempfile.mkdtemp(prefix="kinid-measured-"))


LINK = (
    '<link name="{name}"><inertial><mass value="0.1"/><origin xyz="0 0 0"/>'
    '<inertia ixx="1e-4" iyy="1e-4" izz="1e-4" ixy="0" ixz="0" iyz="0"/></inertial></link>'
)
JOINT = (
    '<joint name="j{k}" type="revolute"><parent link="l{before}"/><child link="l{k}"/><origin xyz="0 0 0" rpy="{rpy}"/>'
    '<axis xyz="{axis}"/><limit lower="-7" upper="7" effort="100" velocity="100"/></joint>'
)
LEG = """<robot name="leg"><link name="body"/><link name="thigh"/><link name="shin"/><link name="foot"/>
<joint name="hip" type="revolute"><parent link="body"/><child link="thigh"/><axis xyz="0 1 0"/>
<limit lower="-3.1" upper="3.1" velocity="50" effort="5"/></joint>
<joint name="knee" type="revolute"><parent link="thigh"/><child link="shin"/><origin xyz="0 0 -0.16"/>
<axis xyz="0 1 0"/><limit lower="-3.1" upper="3.1" velocity="50" effort="5"/></joint>
<joint name="ankle" type="fixed"><parent link="shin"/><child link="foot"/><origin xyz="0 0 -0.16"/></joint></robot>
"""


def turning(real: Path) -> Pair:
    """A known tool while an arm turns it by half a turn in 6 s; a wrist of three axes stands for the arm, whose joints
    were not recorded. Orientation and wrench have clocks of their own."""
    wrench, attitude = (
        np.genfromtxt(real / "med14-ft-imu" / f"1-baseline_{name}.csv", delimiter=",", skip_header=1)
        for name in ("wrench", "orientations")
    )
    rotation = attitude[:, 1:].reshape(-1, 3, 3)
    angle = np.unwrap(Rotation.from_matrix(rotation[0].T @ rotation).as_euler("YXZ"), axis=0)
    t, rows = np.unique(1e-6 * (wrench[:, 0] - attitude[0, 0]), return_index=True)
    known = 1e-6 * (attitude[:, 0] - attitude[0, 0])
    inside = (t >= known[0]) & (t <= known[-1])
    q = np.stack([np.interp(t[inside], known, a) for a in angle.T], axis=1)
    first = " ".join(map(str, Rotation.from_matrix(rotation[0]).as_euler("xyz")))
    axes = (("0 1 0", first), ("1 0 0", "0 0 0"), ("0 0 1", "0 0 0"))
    text = "".join(
        [
            *(LINK.format(name=f"l{k}") for k in range(4)),
            *(JOINT.format(k=k + 1, before=k, axis=axis, rpy=rpy) for k, (axis, rpy) in enumerate(axes)),
        ]
    )
    (_folder() / "wrist.urdf").write_text(f'<robot name="wrist">{text}</robot>', encoding="utf-8")
    tool = poses(real)[1].tool
    assert tool is not None
    rig = kinid.Rig.parse(
        {
            "robot": {"model": str(_folder() / "wrist.urdf"), "sensor_frame": "l3", "tip_frame": "l3"},
            "tool": {"mass": tool.mass, "com": list(tool.com)},
        }
    )
    log = kinid.Log(t=t[inside], q=q, wrench=wrench[rows][inside][:, 1:], phase=np.full(int(inside.sum()), "free"))
    return log, rig


def leg(name: str) -> Callable[[Path], Pair]:
    """A leg of two massless links above a sensor on the ground, which says what the foot feels."""

    def read(real: Path) -> Pair:
        tables = [
            np.loadtxt(real / "leg-contact" / name / f"dg_hopper_teststand-{file}.dat")
            for file in ("joint_positions", "joint_torques", "ati_force")
        ]
        counter = tables[0][:, 0]
        for table in tables[1:]:
            counter = np.intersect1d(counter, table[:, 0])
        q, tau, force = (table[np.searchsorted(table[:, 0], counter), 1:] for table in tables)
        (_folder() / "leg.urdf").write_text(LEG, encoding="utf-8")
        rig = kinid.Rig.parse(
            {
                "robot": {"model": str(_folder() / "leg.urdf"), "sensor_frame": "foot", "tip_frame": "foot"},
                "sensor": {"wrench_frame": "base"},
            }
        )
        return kinid.Log(
            t=1e-3 * (counter - counter[0]), q=q, tau=tau, wrench=np.hstack([force, np.zeros_like(force)])
        ), rig

    return read


def bag(name: str) -> Callable[[Path], Pair]:
    """A UR10e in free motion: joints, and the wrench that its controller gives without the tool's weight."""

    def read(real: Path) -> Pair:
        log = kinid.read(real / "ur10e-bags" / f"{name}.bag")
        log = dataclasses.replace(log, tau=None, phase=np.full(len(log.t), "free"))
        return log, kinid.Rig.parse({"robot": {"model": "ur10", "sensor_frame": "tool0", "tip_frame": "tool0"}})

    return read


_ARM = ("rigid-body", OFFSET, DRY, VISCOUS)
_PRESS = ("hunt-crossley", "surface-offset")
SOURCES: tuple[Source, ...] = (
    *(Source(f"lwr4plus-motion-{k}", "arm", lwr4plus(k), _ARM) for k in (1, 2)),
    Source("panda-motion", "arm", panda, (*_ARM, "payload")),
    *(Source(f"ur10e-motion-{name[:2]}", "arm", ur10e(name), (*_ARM, GAIN)) for name in ("14harm50sec", "15harm50sec")),
    Source("ur10e-motion-joint-1", "axis", motor, _ARM),
    Source("drive-friction", "axis", drive, (*_ARM, ASYMMETRY)),
    Source(
        "silicone-two-cycles",
        "tester",
        silicone("two_cycles"),
        ("hooke", "hertz-exponent", "relaxation", "surface-offset"),
    ),
    *(
        Source(f"silicone-{name}", "tester", silicone(f"press_{name}"), _PRESS)
        for name in ("d5mm_hard", "d5mm_soft", "d10mm_soft", "d20mm_soft")
    ),
    Source("phantom-probes", "places", probes, ("hooke", "surface-offset")),
    Source(
        "phantom-slide",
        "slide",
        slide,
        ("hooke", "surface-offset", "stiffness-inhomogeneity", "coulomb-friction", "surface-tilt"),
    ),
    Source("med14-poses", "wrench", poses, ("none", "sensor-bias", "tool-com")),
    Source("med14-turning", "wrench", turning, ("none", "sensor-bias")),
    *(Source(f"leg-{name}", "leg", leg(name), _ARM) for name in ("jump", "push_pull")),
    *(
        Source(f"ur10e-bags-{name[10:]}", "wrench", bag(name), ("none", "sensor-bias"))
        for name in ("traj_real_30", "traj_real_100")
    ),
)
