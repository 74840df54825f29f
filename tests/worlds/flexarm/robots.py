"""The three arms: geometry and inertia as flat arrays for numba, their drives (Spong), and the URDF text written beside a rig.

lwr4plus is named in the rig as the project ships it; panda and ur5 come from example-robot-data, stripped of meshes and given the frames
ft_sensor and tool_tip. Pinocchio parses the URDF, so the arrays are what it believes.
"""
from __future__ import annotations

import pathlib
import xml.etree.ElementTree as ET
from dataclasses import dataclass, field

import numpy as np
import pinocchio as pin

BRIEF = pathlib.Path(__file__).resolve().parent / "urdf"


@dataclass
class Arm:
    name: str
    rig_model: str
    joints: list
    Rp: np.ndarray          # (n,3,3) placement of a joint in its parent
    pp: np.ndarray          # (n,3)
    ax: np.ndarray          # (n,3) axis in the joint's frame
    m: np.ndarray
    c: np.ndarray
    I: np.ndarray           # (n,3,3) about the centre of mass, joint axes
    Rs: np.ndarray          # sensor in the last body
    ps: np.ndarray
    tip: np.ndarray         # tip in the sensor frame (the same axes)
    K: np.ndarray           # joint stiffness [N m/rad]
    B: np.ndarray           # motor inertia reflected to the link side
    Fc: np.ndarray          # gear friction, Coulomb and viscous
    Fv: np.ndarray
    qn: np.ndarray          # a pose with the tool down
    lo: np.ndarray
    hi: np.ndarray
    vmax: np.ndarray
    urdf: str | None = None
    sensor_frame: str = "ft_sensor"
    tip_frame: str = "tool_tip"
    extra: dict = field(default_factory=dict)

    @property
    def n(self):
        return len(self.m)

    def with_tool(self, mass, com, inertia=None):
        """(m, c, I) with a rigid tool (com and inertia in sensor axes) joined to the last body."""
        m, c, I = self.m.copy(), self.c.copy(), self.I.copy()
        if mass <= 0:
            return m, c, I
        It = np.zeros((3, 3)) if inertia is None else inertia
        ct = self.ps + self.Rs @ np.asarray(com)
        M = m[-1] + mass
        cn = (m[-1] * c[-1] + mass * ct) / M

        def shift(mm, d):
            return mm * (d @ d * np.eye(3) - np.outer(d, d))
        I[-1] = I[-1] + shift(m[-1], c[-1] - cn) + self.Rs @ It @ self.Rs.T + shift(mass, ct - cn)
        m[-1], c[-1] = M, cn
        return m, c, I


DRIVES = {  # joint stiffness, reflected motor inertia, friction: Albu-Schaeffer (LWR), Gaz/Flacco/De Luca 2019 (panda), Hauser et al. (ur5), rounded
    "lwr4plus": dict(K=[12000, 12000, 9000, 9000, 6000, 5000, 4000], B=[1.6, 1.6, 1.1, 1.1, 0.45, 0.3, 0.2],
                     Fc=[4.0, 4.5, 3.0, 3.0, 1.6, 1.1, 0.9], Fv=[6.0, 6.0, 4.0, 4.0, 2.0, 1.2, 1.0]),
    "panda": dict(K=[14000, 14000, 12000, 12000, 8000, 7000, 6000], B=[0.7, 0.7, 0.6, 0.6, 0.25, 0.2, 0.15],
                  Fc=[1.1, 1.6, 1.0, 1.3, 0.7, 0.5, 0.5], Fv=[2.2, 2.4, 1.6, 1.9, 1.0, 0.7, 0.6]),
    "ur5": dict(K=[13000, 13000, 11000, 4500, 4500, 4000], B=[1.8, 1.8, 1.4, 0.35, 0.35, 0.3],
                Fc=[6.5, 7.0, 5.5, 1.6, 1.4, 1.1], Fv=[9.0, 9.5, 7.0, 1.8, 1.6, 1.3]),
}
NOMINAL = {"lwr4plus": [0, -0.5, 0, 1.6, 0, -1.04, 0], "panda": [0, -0.5, 0, -2.25, 0, 1.75, 0.785],
           "ur5": [0, -1.25, 1.85, -2.17, -1.57, 0.0]}
VMAX = {"lwr4plus": [1.9, 1.9, 2.2, 2.2, 3.5, 3.2, 3.2], "panda": [2.1] * 4 + [2.6] * 3, "ur5": [3.1] * 6}


def _strip(text):
    root = ET.fromstring(text)
    for e in list(root):
        if e.tag not in ("link", "joint"):
            root.remove(e)
        elif e.tag == "link":
            for k in list(e):
                if k.tag != "inertial":
                    e.remove(k)
        else:
            for k in list(e):
                if k.tag not in ("parent", "child", "origin", "axis", "limit"):
                    e.remove(k)
    return root


def _drop(root, links):
    for e in list(root):
        child = e.find("child")
        if (e.tag == "link" and e.get("name") in links) or (e.tag == "joint" and child is not None and child.get("link") in links):
            root.remove(e)


def _add(root, parent, name, xyz, rpy=(0, 0, 0)):
    ET.SubElement(root, "link", name=name)
    j = ET.SubElement(root, "joint", name=name + "_joint", type="fixed")
    ET.SubElement(j, "parent", link=parent)
    ET.SubElement(j, "child", link=name)
    ET.SubElement(j, "origin", xyz=" ".join(f"{v:.9g}" for v in xyz), rpy=" ".join(f"{v:.9g}" for v in rpy))


def urdf_text(name, sensor_z=0.02, tip_z=0.1, yaw=0.0):
    """URDF text of an arm; tool length and the sensor's mounting angle as wanted (lwr4plus has its own)."""
    root = _strip((BRIEF / f"{name}.urdf").read_text())
    if name == "panda":
        _drop(root, {"panda_hand", "panda_leftfinger", "panda_rightfinger", "panda_hand_tcp"})
        _add(root, "panda_link8", "ft_sensor", (0, 0, sensor_z), (0, 0, yaw))
    elif name == "ur5":
        _add(root, "tool0", "ft_sensor", (0, 0, sensor_z), (0, 0, yaw))
    if name != "lwr4plus":
        _add(root, "ft_sensor", "tool_tip", (0, 0, tip_z))
    root.set("name", name)
    ET.indent(root)
    return '<?xml version="1.0"?>\n' + ET.tostring(root, encoding="unicode") + "\n"


def load(name, sensor_z=0.02, tip_z=0.1, yaw=0.0) -> Arm:
    text = urdf_text(name, sensor_z, tip_z, yaw)
    mod = pin.buildModelFromXML(text)
    n = mod.nq
    Rp = np.array([mod.jointPlacements[i + 1].rotation for i in range(n)])
    pp = np.array([mod.jointPlacements[i + 1].translation for i in range(n)])
    data = mod.createData()
    q0 = np.zeros(n)
    pin.computeJointJacobians(mod, data, q0)
    pin.framesForwardKinematics(mod, data, q0)
    ax = np.zeros((n, 3))
    for i in range(n):
        J = pin.getJointJacobian(mod, data, i + 1, pin.LOCAL)
        ax[i] = J[3:, i]
    Y = [mod.inertias[i + 1] for i in range(n)]
    fs, ft = mod.frames[mod.getFrameId("ft_sensor")], mod.frames[mod.getFrameId("tool_tip")]
    assert fs.parentJoint == n and ft.parentJoint == n
    S, T = fs.placement, ft.placement
    tip = S.rotation.T @ (T.translation - S.translation)
    d = DRIVES[name]
    a = lambda k: np.array(d[k], float)
    return Arm(name, "lwr4plus" if name == "lwr4plus" else f"{name}_ft.urdf", list(mod.names)[1:], Rp, pp, ax, np.array([y.mass for y in Y]),
               np.array([y.lever for y in Y]), np.array([y.inertia for y in Y]), S.rotation.copy(), S.translation.copy(), tip,
               a("K"), a("B"), a("Fc"), a("Fv"), np.array(NOMINAL[name]), np.array(mod.lowerPositionLimit), np.array(mod.upperPositionLimit),
               np.array(VMAX[name]), None if name == "lwr4plus" else text)
