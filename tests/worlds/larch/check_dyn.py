"""Own dynamics and URDF against Pinocchio."""
import numpy as np, pinocchio as pin, os, tempfile
from chain import *
for k in ARMS:
    A = ARMS[k](); write_urdf(A, os.path.join(tempfile.gettempdir(), "%s.urdf" % A.name)); mod = pin.buildModelFromUrdf(os.path.join(tempfile.gettempdir(), "%s.urdf" % A.name)); da = mod.createData()
    n = A.n; R0 = np.array([rpy(*v) for v in A.rpy]); rng = np.random.default_rng(0)
    for _ in range(3):
        q = rng.uniform(-1, 1, n); dq = rng.normal(size=n); g = np.array([.3, -.2, -9.8]); mod.gravity.linear = g
        R = np.zeros((n, 3, 3)); p = np.zeros((n, 3)); z = np.zeros((n, 3)); M = np.zeros((n, n)); h = np.zeros(n)
        fk(n, R0, A.xyz.astype(float), A.axis, q, R, p, z); dyn(n, R, p, z, A.mass, A.com.astype(float), A.I, dq, g, M, h, True, np.zeros((12, 7, 3)))
        hp = pin.rnea(mod, da, q, dq, np.zeros(n)); Mp = pin.crba(mod, da, q); Mp = np.triu(Mp)+np.triu(Mp, 1).T
        pin.framesForwardKinematics(mod, da, q); f = da.oMf[mod.getFrameId(A.tipname)]
        from build import fkine
        Rs, ps, tip = fkine(A, q)
        print(k, abs(h-hp).max(), abs(M-Mp).max(), abs(tip-f.translation).max(), abs(Rs-f.rotation).max())
    Rs, ps, tip = fkine(A, A.seed); print("seed tip", tip, "z", Rs[:, 2])
