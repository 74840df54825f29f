"""Compile what first runs would wait for, while something else is shown.

    python -m kinid.cli.ahead

A short made-up log of an arm is taken through contact frame, fit and diagnosis; what is said of it is of no interest.
"""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import numpy as np

#: of the made-up log: samples, and how many a second [Hz]
SAMPLES, RATE = 1500, 500.0
#: stiffness [N/m], damping [N·s/m] and friction of what the arm touches there
STIFFNESS, DAMPING, FRICTION = 700.0, 10.0, 0.8


def start() -> None:
    """Compile in a process of its own, which ends by itself; nothing where that was done before."""
    from kinid.kernels.chain import contacts

    if any(Path(contacts.stats.cache_path).glob(f"*{contacts.py_func.__name__}*")):
        return
    subprocess.Popen(
        [sys.executable, "-m", __spec__.name],
        stdin=subprocess.DEVNULL,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        start_new_session=True,  # Ctrl-C is for what is shown
    )


def compile_ahead() -> None:
    """Contact frame, fit and diagnosis of a log that is made here."""
    import kinid
    from kinid.cli.demo import MODEL
    from kinid.planning.advice import Advisor

    t = np.arange(SAMPLES) / RATE
    arm = kinid.Rig.parse({"robot": {"model": "lwr4plus"}, "tool": {"mass": 0.0}})
    robot = kinid.Robot.load(arm)
    sway = np.array([0.02, 0.01, 0.02, 0.015, 0.01, 0.01, 0.01])
    q = np.array([0.0, 0.5, 0.0, -1.5, 0.0, 1.1, 0.0]) + sway * np.sin(
        2.0 * np.pi * np.outer(t, np.linspace(0.5, 1.1, 7))
    )
    noise = np.random.default_rng(0).standard_normal
    q += 2e-6 * noise(q.shape)
    tip = robot.kinematics(robot.tip_frame or "", q, np.gradient(q, 1.0 / RATE, axis=0))
    height = float(np.median(tip.position[:, 2]))
    depth = np.maximum(height - tip.position[:, 2], 0.0)
    force = np.zeros((SAMPLES, 3))
    force[:, 2] = np.where(depth > 0.0, STIFFNESS * depth - DAMPING * tip.velocity[:, 2], 0.0)
    speed = np.hypot(tip.velocity[:, 0], tip.velocity[:, 1]) + 1e-3
    force[:, :2] = -FRICTION * force[:, 2:] * tip.velocity[:, :2] / speed[:, None]
    sensor = robot.kinematics(robot.sensor_frame or "", q)
    wrench = np.zeros((SAMPLES, 6))
    wrench[:, :3] = np.einsum("nij,ni->nj", sensor.rotation, force)
    wrench += 0.01 * noise(wrench.shape)
    rig = kinid.Rig.parse(
        {
            "robot": {"model": "lwr4plus"},
            "tool": {"mass": 0.0},
            "surface": {"point": [0.0, 0.0, height], "normal": [0.0, 0.0, 1.0], "tangent": [1.0, 0.0, 0.0]},
            "sensor": {"bias": [0.0] * 6},
        }
    )
    log = kinid.Log(t=t, q=q, wrench=wrench)
    found = kinid.diagnose(log, rig, model=kinid.Model(*MODEL.split(",")))
    Advisor(found, rig, Path("rig.toml")).advised()


if __name__ == "__main__":
    compile_ahead()
