"""The arm moving through a plan, with the forces to expect, as one offline HTML page."""

from __future__ import annotations

import base64

import numpy as np

from kinid.data.log import Log, Provenance
from kinid.data.rig import Rig
from kinid.errors import InputError
from kinid.planning.trajectory import Trajectory
from kinid.reports.plots import BLUE
from kinid.robotics.robot import Robot
from kinid.viewer import scene as scenes
from kinid.viewer.page import page
from kinid.writers import Json

#: a plan has forces to expect, and none that were measured
LEGEND = ((BLUE, "expected force"),)


def preview_page(motion: Trajectory, rig: Rig, robot: Robot | None = None, title: str = "plan") -> str:
    """An animation that plays in a browser without a network.

    Args:
        motion: to be shown. rig: with its robot; its surface is drawn where it has one. robot: of the rig, where loaded
            already.

    Raises:
        InputError: joints of another robot.
    """
    robot = robot or Robot.load(rig)
    if motion.joint_names != robot.joint_names:
        raise InputError(
            f"a trajectory of {', '.join(motion.joint_names)}", f"the joints of {robot.name}", "name its rig"
        )
    log = Log(motion.t, motion.q, phase=motion.phase, provenance=Provenance(title))
    shown: Json = {
        "title": title,
        "play": True,
        "robot": scenes.robot_scene(rig, robot),
        "motion": scenes.motion_scene(log, rig, robot),
        "facts": f"{len(motion)} samples, {motion.duration:.1f} s",
    }
    if motion.force is not None and np.nan_to_num(motion.force).any():
        # a force is drawn for the frames that the viewer shows: their times are those of the scene
        frames = np.frombuffer(base64.b64decode(shown["motion"]["t"]), dtype="<f4") + motion.t[0]
        rows = np.clip(np.searchsorted(motion.t, frames - 1e-6), 0, len(motion) - 1)
        force = np.nan_to_num(motion.force[rows])
        shown["motion"] |= {
            "tip": scenes.packed(motion.tip[rows], "<f4"),
            "predicted": scenes.packed(force, "<f4"),
            "scale": scenes.ARROW / max(float(np.linalg.norm(force, axis=1).max()), 0.1),
        }
    patch = scenes.patch_scene(rig)
    if patch is not None:
        shown["patch"] = patch
    middle = np.nanmean(motion.tip, axis=0) if np.isfinite(motion.tip).any() else np.array([0.3, 0.0, 0.3])
    shown["camera"] = scenes.camera(0.5 * middle + 0.5 * np.array([0.0, 0.0, 0.45]), np.array([0.0, 0.0, 1.0]), 1.75)
    return page(shown, LEGEND)
