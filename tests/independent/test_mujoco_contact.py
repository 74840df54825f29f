"""MuJoCo has the arm press, tilt, turn and slide a tool on a soft block; kinid reads its logs.

It shares nothing with kinid but the URDF's text and the tool's numbers: it has its own kinematics, dynamics,
contact and sensors. The tool is a body at the sensor's frame and ends in a small ball around `tool_tip`. A ball
touches a plane when the tip is a radius above it: the surface that kinid is given lies a radius outside of the
block, and the tip's depth below it is MuJoCo's penetration, however the tool is tilted.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

import kinid
import kinid.urdf
from kinid.estimators.payload import fit_payload

#: MuJoCo's own velocities and accelerations are exact: the chain behind them is what is compared, not the smoother
AS_LOGGED = kinid.Differentiator()

Array = NDArray[np.float64]

STEP, EVERY = 5e-4, 2  # [s] of the simulation; every second step is logged, 1 kHz
DURATION = 3.0
ARM = "arm/"  # prefix of the URDF's names in the scene
RADIUS, TIP = 4e-3, (0.0, 0.0, 0.1)  # of the ball, and its centre in the sensor frame: tool_tip of the URDF
MASS, COM = 0.9, (0.015, -0.022, 0.058)
INERTIA = (1.9e-3, 1.7e-3, 0.8e-3, 1.1e-4, -1.6e-4, 2.3e-4)  # ixx iyy izz ixy ixz iyz about the com
BIAS = np.array([4.0, -2.5, 11.0, 0.3, -0.15, 0.08])  # what the log's sensor reads without any load
SOFT = [-250.0, -2.0]  # MuJoCo stiffness and damping per effective mass: millimetres under some newtons
LIMIT = 0.01  # of the peak


@dataclass(frozen=True, eq=False)
class Mount:
    """How the base hangs in the world, and where the block's face is in the base frame."""

    name: str
    base: Rotation  # base to world
    normal: tuple[float, float, float] = (0.0, 0.0, 1.0)
    point: tuple[float, float, float] = (-0.54, 0.05, 0.25)

    @property
    def axes(self) -> Array:
        """Columns tangent1, tangent2, normal in the base frame."""
        n = np.array(self.normal) / np.linalg.norm(self.normal)
        t = np.array([1.0, 0.0, 0.0]) - n[0] * n
        t /= np.linalg.norm(t)
        return np.stack([t, np.cross(n, t), n], axis=1)

    @property
    def gravity(self) -> Array:
        return self.base.inv().apply([0.0, 0.0, -9.81])


MOUNTS = (
    Mount("upright", Rotation.identity()),
    Mount("tilted", Rotation.from_euler("xyz", [35, -20, 10], degrees=True), (0.2, -0.15, 1.0)),
    Mount("hung", Rotation.from_euler("xz", [180, 25], degrees=True)),
)


@dataclass(frozen=True, eq=False)
class Run:
    """What MuJoCo said at each logged step; vectors along tangent1, tangent2, normal of the face."""

    t: Array
    q: Array
    dq: Array
    ddq: Array
    tau: Array  # what the controller applied at the joints
    wrench: Array  # force and torque sensor, site axes, turned to the log's sign, (n, 6)
    penetration: Array  # of the ball, from MuJoCo's geometry [m], (n,)
    distance: Array  # as MuJoCo's contact says; NaN out of contact
    force: Array  # on the tool, (n, 3)
    moment: Array  # on the tool about the ball's centre, (n, 3)
    velocity: Array  # of the ball's centre, (n, 3)
    inertial: Array  # mass times acceleration of the tool's com [N], (n,)


def scene(mount: Mount) -> mujoco.MjModel:
    """The shipped URDF on its mount, a tool at the sensor, a soft block, sensors, and no other collisions."""
    spec = mujoco.MjSpec()
    spec.option.timestep = STEP
    spec.option.cone = mujoco.mjtCone.mjCONE_ELLIPTIC
    spec.option.tolerance, spec.option.iterations = 0.0, 50  # contact forces that balance to rounding
    arm = mujoco.MjSpec.from_file(str(kinid.urdf.path("lwr4plus", Path())))
    for geom in arm.geoms:
        geom.contype = geom.conaffinity = 0
    frame = spec.worldbody.add_frame(quat=mount.base.as_quat(scalar_first=True))
    frame.attach_body(arm.body("base_link"), ARM, "")
    tool = spec.body(ARM + "ft_sensor").add_body(name="tool", mass=MASS, ipos=COM, fullinertia=INERTIA)
    tool.explicitinertial = True
    tool.add_site(name="site")
    ball = tool.add_geom(name="ball", type=mujoco.mjtGeom.mjGEOM_SPHERE, size=[RADIUS, 0, 0], pos=TIP, mass=0)
    block = spec.body(ARM + "base_link").add_geom(
        name="block",
        type=mujoco.mjtGeom.mjGEOM_BOX,
        size=[0.3, 0.3, 0.04],
        mass=0,
        pos=np.array(mount.point) - 0.04 * mount.axes[:, 2],
        quat=Rotation.from_matrix(mount.axes).as_quat(scalar_first=True),
    )
    for geom in (block, ball):
        geom.contype = geom.conaffinity = 1
        geom.condim = 4  # sliding and torsional friction
        geom.friction = [0.5, 0.01, 0.0]
        geom.solref = SOFT
        geom.solimp = [0.01, 0.6, 6e-3, 0.5, 2]  # soft at first: no step at the onset
    for kind in (mujoco.mjtSensor.mjSENS_FORCE, mujoco.mjtSensor.mjSENS_TORQUE):
        spec.add_sensor(type=kind, objtype=mujoco.mjtObj.mjOBJ_SITE, objname="site")
    return spec.compile()


def wanted(mount: Mount, t: Array) -> tuple[Array, Array]:
    """Position of the tip [m] and attitude of the tool in the base frame: free motion, then all at once."""
    s = np.clip((t - 0.6) / 0.5, 0, 1)
    depth = -0.012 + 0.020 * s**3 * (10 - 15 * s + 6 * s**2) + 1e-3 * np.sin(2 * np.pi * 2.3 * t)
    slide = 0.025 * np.cos(2 * np.pi * 1.6 * t), 0.025 * np.sin(2 * np.pi * 1.6 * t)
    position = np.array(mount.point) + np.stack([*slide, RADIUS - depth], axis=1) @ mount.axes.T
    angle = np.array([0.3, 0.1, 0.21]) * np.sin(2 * np.pi * np.outer(t, [0.8, 1.1, 1.4]))
    into = Rotation.from_matrix(mount.axes @ np.diag([-1.0, 1.0, -1.0]))  # the tool's z axis into the material
    return position, (into * Rotation.from_euler("ZXY", angle)).as_matrix()


@cache
def simulate(mount: Mount) -> Run:
    """Run MuJoCo under a computed-torque controller on MuJoCo's own Jacobian, mass matrix and bias forces."""
    model = scene(mount)
    data = mujoco.MjData(model)
    base, tip = mount.base.as_matrix(), model.body(ARM + "tool_tip").id
    t = STEP * np.arange(-2, round(DURATION / STEP) + 2)  # two more steps at each end, for central differences
    position, attitude = wanted(mount, t)
    position, attitude = position @ base.T, base @ attitude  # MuJoCo works in the world
    turn = Rotation.from_matrix(attitude[2:]) * Rotation.from_matrix(attitude[:-2]).inv()
    twist = np.concatenate([position[2:] - position[:-2], turn.as_rotvec()], axis=1) / (2 * STEP)
    feed = (twist[2:] - twist[:-2]) / (2 * STEP)
    t, position, attitude, twist = t[2:-2], position[2:-2], attitude[2:-2], twist[1:-1]
    jacobian = np.empty((6, model.nv))

    def error(k: int) -> Array:
        mujoco.mj_jacBody(model, data, jacobian[:3], jacobian[3:], tip)
        off = Rotation.from_matrix(attitude[k] @ data.xmat[tip].reshape(3, 3).T).as_rotvec()
        return np.concatenate([position[k] - data.xpos[tip], off])

    data.qpos[:] = np.deg2rad([-60.0, 45.0, 80.0, -90.0, -50.0, 50.0, 0.0])
    for _ in range(60):  # inverse kinematics of the start
        mujoco.mj_fwdPosition(model, data)
        offset = error(0)
        data.qpos += 0.5 * np.linalg.pinv(jacobian) @ offset
    assert np.abs(offset).max() < 1e-9, "the start can't be reached"
    sign, start = sensor_sign(model, data), data.qpos.copy()
    data.qvel[:] = np.linalg.pinv(jacobian) @ twist[0]
    rows, torque = [], np.empty(model.nv)
    for k in range(len(t)):
        mujoco.mj_fwdPosition(model, data)
        mujoco.mj_fwdVelocity(model, data)
        asked = feed[k] + 3600.0 * error(k) + 120.0 * (twist[k] - jacobian @ data.qvel)
        inverse = np.linalg.pinv(jacobian)
        idle = 100.0 * (start - data.qpos) - 20.0 * data.qvel  # what the task leaves free stays near the start
        mujoco.mj_mulM(model, data, torque, inverse @ (asked - jacobian @ idle) + idle)
        data.qfrc_applied[:] = torque + data.qfrc_bias
        before, velocity = np.concatenate([data.qpos, data.qvel]), jacobian[:3] @ data.qvel
        mujoco.mj_step(model, data)  # acceleration, sensors and contacts are those of the state before the step
        if k % EVERY == 0:
            joints = before, data.qacc, data.qfrc_applied
            tool = sign * data.sensordata, contact(model, data), velocity, data.body("tool").xipos
            rows.append(np.concatenate([[t[k]], *joints, *tool]))
    return unpack(mount, np.array(rows))


def sensor_sign(model: mujoco.MjModel, data: mujoco.MjData) -> float:
    """MuJoCo's sensor against the log's format: at rest in the air a tool reads m·Rᵀ·g and its moment.

    MuJoCo gives what the parent does to the tool (it holds it up), the log what the tool does to its parent.
    """
    data.qvel[:] = 0.0
    mujoco.mj_forward(model, data)
    data.qfrc_applied[:] = data.qfrc_bias
    mujoco.mj_forward(model, data)
    assert data.ncon == 0
    assert np.abs(data.qacc).max() < 1e-9
    weight = MASS * data.site("site").xmat.reshape(3, 3).T @ model.opt.gravity
    load = np.concatenate([weight, np.cross(COM, weight)])
    np.testing.assert_allclose(-data.sensordata, load, atol=1e-9)
    return -1.0


def contact(model: mujoco.MjModel, data: mujoco.MjData) -> Array:
    """Force on the tool, its moment about the ball's centre, that centre (world axes), and the distance, (10,)."""
    ball, centre = model.geom("ball").id, data.geom("ball").xpos
    force, moment, distance, reaction = np.zeros(3), np.zeros(3), np.nan, np.empty(6)
    for i in range(data.ncon):
        touch = data.contact[i]
        mujoco.mj_contactForce(model, data, i, reaction)
        axes = touch.frame.reshape(3, 3).T * (1.0 if touch.geom2 == ball else -1.0)  # it acts on the second geom
        force += axes @ reaction[:3]
        moment += axes @ reaction[3:] + np.cross(touch.pos - centre, axes @ reaction[:3])
        distance = touch.dist
    return np.concatenate([force, moment, centre, [distance]])


def unpack(mount: Mount, rows: Array) -> Run:
    """Columns of the rows, in the face's axes."""
    t, q, dq, ddq, tau, wrench, force, moment, centre, distance, velocity, com = np.split(
        rows, np.cumsum([1, 7, 7, 7, 7, 6, 3, 3, 3, 1, 3]), axis=1
    )
    turn = mount.base.as_matrix() @ mount.axes
    height = (mount.base.inv().apply(centre) - mount.point) @ mount.axes[:, 2]
    acceleration = np.gradient(np.gradient(com, EVERY * STEP, axis=0), EVERY * STEP, axis=0)
    return Run(
        t[:, 0],
        q,
        dq,
        ddq,
        tau,
        wrench,
        RADIUS - height,
        distance[:, 0],
        force @ turn,
        moment @ turn,
        velocity @ turn,
        MASS * np.linalg.norm(acceleration, axis=1),
    )


def rig(mount: Mount, **changes: Any) -> kinid.Rig:
    """What a user would write; a table that is None is left out."""
    n = mount.axes[:, 2]
    tables: dict[str, Any] = {
        "robot": {"model": "lwr4plus", "gravity": mount.gravity.tolist()},
        "tool": {"mass": MASS, "com": COM, "inertia": INERTIA},
        "surface": {
            "point": (np.array(mount.point) + RADIUS * n).tolist(),
            "normal": n.tolist(),
            "tangent": mount.axes[:, 0].tolist(),
        },
    } | changes
    return kinid.Rig.parse({name: table for name, table in tables.items() if table is not None})


def errors(touch: kinid.ContactSeries, run: Run, rows: slice = slice(None)) -> dict[str, float]:
    """Largest difference from MuJoCo within some rows, as a share of the peak of each quantity."""
    assert touch.valid.all()
    tangential = np.stack([touch.tangential_force1, touch.tangential_force2], axis=1)
    pairs = {
        "depth": (touch.depth, run.penetration),
        "normal force": (touch.normal_force, run.force[:, 2]),
        "tangential force": (tangential, run.force[:, :2]),
    }
    return {name: float(np.abs(a - b)[rows].max() / peak(b)) for name, (a, b) in pairs.items()}


def peak(values: Array) -> float:
    """In contact; depths are counted inside of the material."""
    return float(values.max() if values.ndim == 1 else np.linalg.norm(values, axis=1).max())


def show(mount: Mount, what: str, values: dict[str, float]) -> None:
    shares = ", ".join(f"{name} {100 * value:.2g} %" for name, value in values.items())
    print(f"\n{mount.name}, {what}: {shares} (of the peak)", end="")


@pytest.fixture(params=MOUNTS, ids=lambda mount: mount.name)
def mount(request: pytest.FixtureRequest) -> Mount:
    chosen: Mount = request.param
    return chosen


def test_the_run_is_worth_comparing_with(mount: Mount) -> None:
    run = simulate(mount)
    touching = ~np.isnan(run.distance)
    inertial = run.inertial[touching][5:-5].max()
    print(
        f"\n{mount.name}: depth to {1e3 * peak(run.penetration):.1f} mm, normal force to {peak(run.force[:, 2]):.1f} "
        f"N, "
        f"tangential to {peak(run.force[:, :2]):.1f} N, inertial force of the tool in contact to {inertial:.1f} N, "
        f"joint speed to {np.abs(run.dq).max():.1f} rad/s",
        end="",
    )
    # MuJoCo's contact and its geometry tell the same depth, and there is no contact outside of the block
    np.testing.assert_allclose(run.penetration[touching], -run.distance[touching], atol=1e-12)
    assert run.penetration[~touching].max() < 1e-6
    assert 0.5 < touching.mean() < 0.8
    assert inertial > 0.1 * peak(run.force[:, 2])
    assert peak(run.force[:, :2]) > 0.3 * peak(run.force[:, 2])


def test_contact_frame_quantities_are_those_of_mujoco(mount: Mount) -> None:
    """With logged velocities and accelerations and an unknown bias, nothing but rounding is left."""
    run = simulate(mount)
    log = kinid.Log(t=run.t, q=run.q, dq=run.dq, ddq=run.ddq, wrench=run.wrench + BIAS)
    touch = kinid.contact_series(log, rig(mount), moments=True, differentiator=AS_LOGGED)
    found = errors(touch, run)
    show(mount, "logged derivatives", found)
    assert max(found.values()) < LIMIT  # what is asked for
    assert max(found.values()) < 1e-9  # what it is: two engines, the same mechanics
    rates = np.stack([touch.slip_rate1, touch.slip_rate2, -touch.depth_rate], axis=1)
    np.testing.assert_allclose(rates, run.velocity, atol=1e-9)
    assert touch.moment is not None
    np.testing.assert_allclose(touch.moment.T, run.moment, atol=1e-9)
    # the flag follows the normal force, whose noise here is rounding
    assert np.mean(touch.in_contact == ~np.isnan(run.distance)) > 0.99


def test_positions_alone_do(mount: Mount) -> None:
    """Velocities and accelerations from the differentiator with its usual 25 Hz."""
    run = simulate(mount)
    log = kinid.Log(t=run.t, q=run.q, wrench=run.wrench + BIAS)
    touch = kinid.contact_series(log, rig(mount), differentiator=AS_LOGGED)
    # at the ends of a log the derivative comes from one side only: half a window, 26 samples, is shown apart
    inside, whole = errors(touch, run, slice(26, -26)), errors(touch, run)
    show(mount, "positions alone", inside)
    show(mount, "with the ends of the log", whole)
    assert max(inside.values()) < LIMIT
    assert max(whole.values()) < 2 * LIMIT
    # MuJoCo's integrator puts velocities half a step off its own positions, so that these are compared with
    path = np.gradient(run.penetration, run.t)
    assert np.abs(touch.depth_rate - path)[26:-26].max() < LIMIT * np.abs(path).max()


def test_weight_and_inertia_of_the_tool_matter(mount: Mount) -> None:
    """The same comparison fails without the tool, and without its inertia."""
    run = simulate(mount)
    log = kinid.Log(t=run.t, q=run.q, dq=run.dq, ddq=run.ddq, wrench=run.wrench)
    still = kinid.Log(t=run.t, q=run.q, dq=0 * run.q, ddq=0 * run.q, wrench=run.wrench)
    point = {"mass": MASS, "com": (0.0, 0.0, 0.0)}
    cases = {
        "no tool": (log, rig(mount, tool=None)),
        "its weight alone": (still, rig(mount)),
        "a com in the sensor's plane": (log, rig(mount, tool=point)),
    }
    for what, (readings, wrong) in cases.items():
        found = errors(kinid.contact_series(readings, wrong, bias="none", differentiator=AS_LOGGED), run)
        show(mount, what, found)
        assert found["depth"] < 1e-9
        assert found["normal force"] > LIMIT
        assert found["tangential force"] > LIMIT


def test_a_wrench_of_the_opposite_sign_is_refused(mount: Mount) -> None:
    """MuJoCo's own sign, taken as it comes: gravity in free motion tells."""
    run = simulate(mount)
    log = kinid.Log(t=run.t, q=run.q, dq=run.dq, ddq=run.ddq, wrench=-run.wrench)
    with pytest.raises(kinid.InputError, match="opposite sign"):
        kinid.contact_series(log, rig(mount), differentiator=AS_LOGGED)


def test_a_mesh_of_the_face_gives_the_same(mount: Mount, tmp_path: Path) -> None:
    run = simulate(mount)
    n = mount.axes[:, 2]
    centre = np.array(mount.point) + RADIUS * n
    corners = centre + 0.3 * np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) @ mount.axes[:, :2].T
    lines = ["solid face"]
    for triangle in ((0, 1, 2), (0, 2, 3)):
        lines += ["facet normal 0 0 0", "outer loop"]
        lines += ["vertex " + " ".join(repr(float(x)) for x in corners[i]) for i in triangle]
        lines += ["endloop", "endfacet"]
    (tmp_path / "face.stl").write_text("\n".join([*lines, "endsolid face\n"]))
    tables = rig(mount, surface={"mesh": "face.stl"}).model_dump(exclude_none=True)
    log = kinid.Log(t=run.t, q=run.q, dq=run.dq, ddq=run.ddq, wrench=run.wrench + BIAS)
    touch = kinid.contact_series(log, kinid.Rig.parse(tables, folder=tmp_path), differentiator=AS_LOGGED)
    assert touch.valid.all()
    np.testing.assert_allclose(touch.depth, run.penetration, atol=1e-8)  # the mesh may be held in single precision
    np.testing.assert_allclose(touch.normal_force, run.force[:, 2], atol=1e-6)
    # the mesh chooses its own tangents
    sideways = np.hypot(touch.tangential_force1, touch.tangential_force2)
    np.testing.assert_allclose(sideways, np.linalg.norm(run.force[:, :2], axis=1), atol=1e-6)


def test_joint_torques_are_those_of_mujoco(mount: Mount) -> None:
    """Inverse dynamics of the arm, with all that is beyond the sensor taken from the sensor."""
    run = simulate(mount)
    log = kinid.Log(t=run.t, q=run.q, dq=run.dq, ddq=run.ddq, tau=run.tau, wrench=run.wrench)
    torques = kinid.joint_torques(log, rig(mount), bias="none", differentiator=AS_LOGGED)
    worst, largest = np.abs(torques.residual).max(), np.abs(run.tau).max()
    print(f"\n{mount.name}: joint torques to {largest:.1f} N·m, residual to {worst:.1g} N·m", end="")
    assert worst < 1e-9


def test_the_payload_is_found_in_free_motion(mount: Mount) -> None:
    """From MuJoCo's sensor before it touches: mass, centre of mass, bias and inertia."""
    run = simulate(mount)
    free = slice(0, int(np.argmax(~np.isnan(run.distance))))
    robot = kinid.Robot.load(rig(mount))
    motion = robot.kinematics("ft_sensor", run.q[free], run.dq[free], run.ddq[free])
    gravity, a, w, alpha = (
        np.einsum("nji,nj->ni", motion.rotation, np.broadcast_to(v, motion.position.shape))
        for v in (mount.gravity, motion.acceleration, motion.angular_velocity, motion.angular_acceleration)
    )
    fit = fit_payload(run.wrench[free] + BIAS, gravity, acceleration=a, angular_velocity=w, angular_acceleration=alpha)
    print(f"\n{mount.name}: payload {fit.mass:.6f} kg, com {fit.com}, inertia {fit.inertia}, {fit.status}", end="")
    assert fit.mass == pytest.approx(MASS, rel=1e-6)
    np.testing.assert_allclose(fit.com, COM, atol=1e-6)
    np.testing.assert_allclose(fit.bias, BIAS, atol=1e-6)
    assert fit.inertia is not None
    np.testing.assert_allclose(fit.inertia, INERTIA, atol=1e-7)
