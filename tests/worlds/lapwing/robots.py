"""Arms of the lapwing world: an LWR4+ written as URDF with a random tool, and arms by example-robot-data name."""
import json, os
import numpy as np, pinocchio as pin

HERE = os.path.dirname(os.path.abspath(__file__))
OFF = [0.11, 0.2005, 0.20, 0.20, 0.20, 0.19, 0.078]
AXES = ["0 0 1", "0 -1 0", "0 0 1", "0 1 0", "0 0 1", "0 -1 0", "0 0 1"]
LIM = [2.95, 2.09, 2.95, 2.09, 2.95, 2.09, 2.95]
SEEDS = {"lwr": [0.0, 0.52, 0.0, -1.57, 0.0, 1.05, 0.0], "ur5": [0.3, -1.35, 1.9, -2.1, -1.57, 0.2],
         "panda": [0.0, -0.4, 0.0, -2.2, 0.0, 1.85, 0.78]}

def rotz(a):
    c, s = np.cos(a), np.sin(a)
    return np.array([[c, -s, 0], [s, c, 0], [0, 0, 1.0]])

def lwr_urdf(sensor_h=0.032, sensor_rot=0.0, tip=(0, 0, 0.1)):
    links = json.load(open(os.path.join(HERE, "..", "lwr4plus_inertia.json")))
    o = ['<?xml version="1.0"?>', '<robot name="lwr4plus_lapwing">', '  <link name="base_link"/>']
    par = "base_link"
    for i, L in enumerate(links):
        I = L["I"]
        o.append(f'  <link name="link_{i+1}"><inertial><origin xyz="{L["com"][0]} {L["com"][1]} {L["com"][2]}" rpy="0 0 0"/>'
                 f'<mass value="{L["m"]}"/><inertia ixx="{I[0]}" iyy="{I[1]}" izz="{I[2]}" ixy="{I[3]}" ixz="{I[4]}" iyz="{I[5]}"/></inertial></link>')
        o.append(f'  <joint name="joint_{i+1}" type="revolute"><parent link="{par}"/><child link="link_{i+1}"/>'
                 f'<origin xyz="0 0 {OFF[i]}" rpy="0 0 0"/><axis xyz="{AXES[i]}"/>'
                 f'<limit lower="{-LIM[i]}" upper="{LIM[i]}" effort="200" velocity="2.5"/></joint>')
        par = f"link_{i+1}"
    # joint 7 sits at the flange face (link 7 has its com at z < 0)
    for nm, p, z, r in (("flange", "link_7", 0.0, 0.0),):
        o.append(f'  <link name="{nm}"/><joint name="{nm}_fix" type="fixed"><parent link="{p}"/><child link="{nm}"/><origin xyz="0 0 0" rpy="0 0 0"/></joint>')
    o.append(f'  <link name="ft_sensor"/><joint name="ft_sensor_fix" type="fixed"><parent link="flange"/><child link="ft_sensor"/><origin xyz="0 0 {sensor_h:.6f}" rpy="0 0 {sensor_rot:.8f}"/></joint>')
    o.append(f'  <link name="tool_tip"/><joint name="tool_tip_fix" type="fixed"><parent link="ft_sensor"/><child link="tool_tip"/><origin xyz="{tip[0]:.6f} {tip[1]:.6f} {tip[2]:.6f}" rpy="0 0 0"/></joint>')
    o.append("</robot>")
    return "\n".join(o) + "\n"

class Arm:
    """Serial chain as arrays for the engine; the frames are fixed in the last joint's frame."""
    def __init__(s, model, sensor, tip, gravity):
        s.n = n = model.nq
        d = model.createData()
        q0 = pin.neutral(model)
        pin.computeJointJacobians(model, d, q0)
        s.names = [model.names[i] for i in range(1, n + 1)]
        s.R0 = np.array([model.jointPlacements[i].rotation for i in range(1, n + 1)])
        s.p0 = np.array([model.jointPlacements[i].translation for i in range(1, n + 1)])
        s.ax = np.array([pin.getJointJacobian(model, d, i, pin.LOCAL)[3:, i - 1] for i in range(1, n + 1)])
        s.m = np.array([model.inertias[i].mass for i in range(1, n + 1)])
        s.c = np.array([model.inertias[i].lever for i in range(1, n + 1)])
        s.I = np.array([model.inertias[i].inertia for i in range(1, n + 1)])
        fs, ft = model.frames[model.getFrameId(sensor)], model.frames[model.getFrameId(tip)]
        assert fs.parentJoint == n and ft.parentJoint == n
        s.Rs, s.ps = fs.placement.rotation.copy(), fs.placement.translation.copy()
        s.Rt, s.pt = ft.placement.rotation.copy(), ft.placement.translation.copy()
        s.g = np.asarray(gravity, float)
        s.chain = tuple(np.ascontiguousarray(a) for a in (s.R0, s.p0, s.ax, s.m, s.c, s.I, s.g))

    def with_load(s, mass, com, I=np.zeros((3, 3))):
        """Chain with a body added to the last link (com in the last joint's frame)."""
        R0, p0, ax, m, c, II, g = [a.copy() for a in s.chain]
        b = pin.Inertia(m[-1], c[-1], II[-1]) + pin.Inertia(float(mass), np.asarray(com, float), I + 1e-9 * np.eye(3))
        m[-1], c[-1], II[-1] = b.mass, b.lever, b.inertia
        return (R0, p0, ax, m, c, II, g)

def load(model, sensor, tip, gravity=(0, 0, -9.81), joints=None, base="."):
    """By URDF path or example-robot-data name; joints not listed stay at neutral."""
    if model.endswith(".urdf"):
        m = pin.buildModelFromUrdf(os.path.join(base, model))
    elif model == "lwr4plus":
        m = pin.buildModelFromXML(lwr_urdf())
    else:
        import example_robot_data
        m = example_robot_data.load(model).model
    if joints:
        lock = [i for i in range(1, m.njoints) if m.names[i] not in joints]
        if lock:
            m = pin.buildReducedModel(m, lock, pin.neutral(m))
        assert [m.names[i] for i in range(1, m.njoints)] == list(joints)
    return Arm(m, sensor, tip, gravity)
