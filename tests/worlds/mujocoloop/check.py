"""Checks of signs and of the two independent chains: python check.py [--urdf FILE] (no noise; prints deviations)."""
from __future__ import annotations

from pathlib import Path
import sys
import numpy as np
import joints
import laws
from sim import Tool, build_arm, build_axis, run_cart, run_joint, solve_ik

URDF = sys.argv[2] if len(sys.argv) > 2 else str(Path(__file__).resolve().parents[3] / "urdf" / "lwr4plus.urdf")
tool, g, n = Tool(), np.array([0, 0, -9.81]), 40000
m = build_arm(URDF, tool, g, 1 / 4000, np.full(7, 0.12))
surf = np.array([[0.55, 0, 0.1], [0, 0, 1], [1, 0, 0], [0, 1, 0.0]])
R0 = np.diag([1.0, -1, -1])
q0 = solve_ik(m, np.array([0, -0.6, 0, 1.5, 0, -1.0, 0]), np.array([0.55, 0, 0.13]), R0)
t = np.arange(n) / 4000
x = np.tile([0.55, 0, 0.13], (n, 1))
P = laws.params(k=2000, c=5, mu=0.5, m=tool.mass, cz=tool.com[2], Ixx=tool.inertia[0], Iyy=tool.inertia[1], Izz=tool.inertia[2])
for moving in (False, True):
    if moving:
        x[:, 2] -= 0.036 * np.sin(np.pi * t / 5) ** 2
        x[:, 0] += 0.02 * np.sin(4 * t)
    o = run_cart(m, q0, x, np.gradient(x, 1 / 4000, axis=0), np.tile(R0, (n, 1, 1)), np.zeros((n, 3)), 5000.0, 350.0, 0.8, P, surf, 1)
    M = laws.Motion(laws.chain(URDF), o[:, 0], o[:, 1:8], o[:, 8:15], o[:, 15:22], surf, tool.tip, g)
    d = laws.predict(P, M) - o[:, 22:28]
    # contracts.md spelled out, with the engine's own contact force (columns 31:34, base frame)
    cw = M.R @ tool.com
    a = M.a + np.cross(M.al, cw) + np.cross(M.w, np.cross(M.w, cw))
    f = np.einsum("nji,nj->ni", M.R, o[:, 31:34] + tool.mass * (g - a))
    print("moving" if moving else "at rest", "| f = R'(f_c + m(g - a)) - MuJoCo's sensor, max:", np.abs(f - o[:, 22:25]).max(), "N | law + sensor from the log, rms:", d.std(0).round(6))
    if not moving:
        print("  reads", o[-1, 22:25].round(6), "; m R' g =", (tool.mass * M.R[-1].T @ g).round(6))
    else:
        print("  contact normal force >= 0:", bool((o[:, 28] >= 0).all()), "; power of friction <= 0 (mean of T v):", float(np.mean(o[:, 29] * M.contact(np.zeros(3))[1][:, 1])))
qd = np.array([0, -0.4, 0, 1.2, 0, -0.9, 0]) + 0.4 * np.sin(np.outer(t, np.linspace(0.8, 1.6, 7))) - 0.0
dqd = np.gradient(qd, 1 / 4000, axis=0)
fr = np.zeros((9, 7))
fr[3] = fr[7] = 1e-2
arm = np.full(7, 0.2)
o = run_joint(build_arm(URDF, tool, g, 1 / 4000, arm), 7, qd, dqd, np.gradient(dqd, 1 / 4000, axis=0), 45.0, fr, np.zeros((n, 7)), 4)[50:-5]
tau = o[:, 22:29] - arm * o[:, 15:22]
print("joints: MuJoCo torque - pinocchio rnea, max", np.abs(tau - joints.rnea(joints.robot(URDF, tool), o[:, 1:8], o[:, 8:15], o[:, 15:22])).max(), "N m")
