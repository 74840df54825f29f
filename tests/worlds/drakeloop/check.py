"""Checks of the chain itself: a static tool in the air reads m R^T g; with zero noise the load equals R^T (f_c + m (g - a)), kinematics by
Pinocchio and by Drake. python check.py [--urdf FILE]"""
from __future__ import annotations

from pathlib import Path
import argparse
import numpy as np
import pinocchio as pin
from arm import Arm, Tool
from chain import chain_defaults, clean_wrench, kinematics

ap = argparse.ArgumentParser()
ap.add_argument("--urdf", default=str(Path(__file__).resolve().parents[3] / "urdf" / "lwr4plus.urdf"))
arm = Arm(ap.parse_args().urdf)
m = pin.buildModelFromUrdf(arm and ap.parse_args().urdf)
d = m.createData()
fid = m.getFrameId("ft_sensor")
rng = np.random.default_rng(0)
g = np.array([0, 0, -9.81])
Q = chain_defaults()
Q.update(mass=0.7, com=np.array([0.003, -0.002, 0.05]), inertia=np.array([2e-3, 1.5e-3, 8e-4, 1e-4, 0, -1e-4]))
plane = np.array([[0.5, 0, 0.1], [0, 0, 1], [1, 0, 0], [0, 1, 0]], float)
worst = np.zeros(4)
for _ in range(50):
    q, v, a = rng.uniform(-1.5, 1.5, 7), rng.uniform(-1, 1, 7), rng.uniform(-5, 5, 7)
    F = rng.uniform(-5, 5, (1, 3))
    kin = kinematics(arm, q[None], v[None], a[None])
    W = clean_wrench(kin, F, Q, plane, arm, g)[0]
    pin.forwardKinematics(m, d, q, v, a)
    pin.updateFramePlacements(m, d)
    M = d.oMf[fid]
    acc = pin.getFrameAcceleration(m, d, fid, pin.LOCAL)          # spatial; the body's own inertial load by Newton-Euler
    vel = pin.getFrameVelocity(m, d, fid, pin.LOCAL)
    i = Q["inertia"]
    I = pin.Inertia(Q["mass"], Q["com"], np.array([[i[0], i[3], i[4]], [i[3], i[1], i[5]], [i[4], i[5], i[2]]]))
    gl = pin.Motion(M.rotation.T @ g, np.zeros(3))
    load = -(I * (acc - gl)).vector - vel.cross(I * vel).vector
    fc = M.rotation.T @ (F[0] @ plane[1:])
    ref = load + np.concatenate([fc, np.cross(arm.tip, fc)])
    worst[0] = max(worst[0], np.abs(W - ref).max())
    kin0 = kinematics(arm, q[None], 0 * v[None], 0 * v[None])
    worst[1] = max(worst[1], np.abs(clean_wrench(kin0, 0 * F, Q, plane, arm, g)[0, :3] - Q["mass"] * M.rotation.T @ g).max())
    worst[2] = max(worst[2], np.abs(kin[0][0] - M.translation).max())
    worst[3] = max(worst[3], np.abs(arm.plant(Tool(), g).inverse(q[None], v[None], a[None])[0] - pin.rnea(m, d, q, v, a)).max())
print("wrench vs pinocchio %.1e, static m R^T g %.1e N, position %.1e m, Drake inverse dynamics vs pinocchio %.1e N m" % tuple(worst))
assert worst.max() < 1e-8
