"""Refits of joint-torque logs: linear regressors of the catalogue's joint effects, rigid body from Pinocchio."""
import os
import numpy as np
import pinocchio as pin
from numba import njit
from robots import HERE, ROBOTS
from sensing import smooth

LIN = ["joint-coulomb-friction", "joint-viscous-friction", "joint-friction-asymmetry", "joint-torque-offset", "rotor-inertia", "joint-torque-gain",
       "payload", "joint-elasticity", "gravity-error", "joint-stribeck-friction", "joint-load-friction", "joint-torque-ripple", "joint-spring"]
rms = lambda a: float(np.sqrt(np.mean(np.square(a)))) if np.size(a) else 0.0
_PIN = {}


def pin_model(name, tool, gravity):
    m = pin.buildModelFromUrdf(os.path.join(HERE, "models", ROBOTS[name]["urdf"]))
    fr = m.frames[m.getFrameId(ROBOTS[name]["sensor"])]
    if tool is not None:
        I = tool.get("inertia", [0] * 6)
        M = np.array([[I[0], I[3], I[4]], [I[3], I[1], I[5]], [I[4], I[5], I[2]]])
        m.appendBodyToJoint(fr.parentJoint, pin.Inertia(float(tool["mass"]), np.array(tool["com"], float), M), fr.placement)
    m.gravity.linear = np.array(gravity, float)
    return m


@njit(cache=True)
def bristle(q, ell):
    n, N = q.shape
    z = np.zeros((n, N))
    for j in range(N):
        for i in range(1, n):
            a = z[i - 1, j] + (q[i, j] - q[i - 1, j]) / ell
            z[i, j] = min(max(a, -1.0), 1.0)
    return z


class JData:
    def __init__(self, t, q, tau, sigma, robot=None, tool=None, gravity=(0, 0, -9.81), width=.03, ell=5e-4, limit=3000):
        dt = float(np.median(np.diff(t)))
        qs, dq, ddq = smooth(t, q, max(width, 5 * dt))
        z = bristle(qs, max(ell, 1e-6))
        st = max(len(t) // limit, 1)
        i = slice(None, None, st)
        self.t, self.q, self.dq, self.ddq, self.z, self.y = t[i], qs[i], dq[i], ddq[i], z[i], tau[i]
        self.n, self.N = self.y.shape
        self.sigma = np.asarray(sigma, float)
        self.wt = 1 / np.sqrt(self.sigma ** 2 + (.004 * np.sqrt(np.mean(tau ** 2, 0))) ** 2)
        self.robot = robot
        self.cache = {}
        if robot:
            self.m = pin_model(robot, tool, gravity)
            self.d = self.m.createData()
            self.rb = self.rnea(self.q, self.dq, self.ddq)
        else:
            self.rb = np.zeros_like(self.y)
        self.tdd = smooth(self.t, self.rb, max(.1, 5 * np.median(np.diff(self.t))))[2]   # torque carried by the rigid arm, twice differentiated
        self.moving = np.abs(self.dq).max(1) > .01 * np.abs(self.dq).max()

    def rnea(self, q, dq, ddq, m=None):
        m = m or self.m
        d = m.createData()
        return np.array([pin.rnea(m, d, q[i], dq[i], ddq[i]) for i in range(len(q))])

    def columns(self, e, aux):
        """List of (array (n,N), shared?) of an effect."""
        key = (e, aux.get("vs") if e == "joint-stribeck-friction" else aux.get("k") if e == "joint-torque-ripple" else None)
        if key in self.cache:
            return self.cache[key]
        one = np.ones_like(self.q)
        if e == "rigid-body":
            out = [] if self.robot else [(self.ddq, False)]
        elif e == "joint-coulomb-friction":
            out = [(self.z, False)]
        elif e == "joint-viscous-friction":
            out = [(self.dq, False)]
        elif e == "joint-friction-asymmetry":
            out = [(np.abs(self.z), False)]
        elif e == "joint-torque-offset":
            out = [(one, False)]
        elif e == "rotor-inertia":
            out = [(self.ddq, False)]
        elif e == "joint-torque-gain":
            out = [(aux["pred"], False)]
            key = None
        elif e == "joint-spring":
            out = [(self.q, False)]
        elif e == "joint-load-friction":
            out = [(np.abs(self.rb) * self.z, False)]
        elif e == "joint-stribeck-friction":
            out = [(self.z * np.exp(-(self.dq / aux["vs"]) ** 2), False)]
        elif e == "joint-torque-ripple":
            k = aux["k"]
            out = [(f(h * k * self.q), False) for f in (np.sin, np.cos) for h in (1, 2)]
        elif e == "payload":
            X = np.array([pin.computeJointTorqueRegressor(self.m, self.d, self.q[i], self.dq[i], self.ddq[i])[:, -10:-6] for i in range(self.n)])
            out = [(X[:, :, c], True) for c in range(4)]
        elif e == "gravity-error":
            z = np.zeros_like(self.q)
            g0 = self.m.gravity.linear.copy()
            out = []
            for c in range(3):
                self.m.gravity.linear = np.eye(3)[c]
                out.append((self.rnea(self.q, z, z), True))
            self.m.gravity.linear = g0
        elif e == "joint-elasticity":
            out = []
            eps = 1e-3 / (1 + np.abs(self.rb).max(0))
            for j in range(self.N):
                dqj, ddj = np.zeros_like(self.q), np.zeros_like(self.q)
                dqj[:, j] = self.rb[:, j] * eps[j]
                ddj[:, j] = self.tdd[:, j] * eps[j]
                out.append(((self.rnea(self.q - dqj, self.dq, self.ddq - ddj) - self.rb) / eps[j], True))
        if key is not None:
            self.cache[key] = out
        return out

    def solve(self, model, aux):
        cols = [(a, s) for e in model for a, s in self.columns(e, aux)]
        r = (self.y - self.rb) * self.wt
        per = [a * self.wt for a, s in cols if not s]
        sh = [(a * self.wt).ravel() for a, s in cols if s]
        p, N = len(per), self.N
        A = np.zeros((self.n, N, p * N + len(sh)))
        for c, a in enumerate(per):
            for j in range(N):
                A[:, j, c * N + j] = a[:, j]
        A = A.reshape(self.n * N, -1)
        for c, a in enumerate(sh):
            A[:, p * N + c] = a
        b = r.ravel()
        if A.shape[1] == 0:
            return self.rb.copy(), float(b @ b)
        s = np.sqrt((A * A).sum(0)) + 1e-30
        A /= s
        x = np.linalg.solve(A.T @ A + 1e-9 * np.eye(A.shape[1]), A.T @ b)
        pred = (A @ x).reshape(self.n, N) / self.wt + self.rb
        return pred, float(((self.y - pred) * self.wt).ravel() @ ((self.y - pred) * self.wt).ravel())

    def coefficients(self, model, aux):
        """Least squares, one number per column: list of (effect, column, joint or None, value)."""
        aux = dict(aux)
        if "joint-torque-gain" in model:
            aux["pred"] = self.fit(model, aux)[0]
        lab, A = [], []
        for e in model:
            for i, (a, shared) in enumerate(self.columns(e, aux)):
                for j in [None] if shared else range(self.N):
                    z = a * self.wt
                    if j is not None:
                        z = np.where(np.arange(self.N) == j, z, 0.0)
                    A.append(z.ravel())
                    lab.append((e, i, j))
        A = np.array(A).T
        s = np.sqrt((A * A).sum(0)) + 1e-30
        x = np.linalg.lstsq(A / s, ((self.y - self.rb) * self.wt).ravel(), rcond=1e-8)[0] / s
        return [(*k, float(v)) for k, v in zip(lab, x)]

    def fit(self, model, truth):
        """Best refit over the grids of the nonlinear parameters."""
        model = list(model)
        grids = [{}]
        top = np.percentile(np.abs(self.dq), 98)
        if "joint-stribeck-friction" in model:
            vs = [truth["vs"] * f for f in (.7, 1., 1.4)] if "vs" in truth else list(top * np.array([.01, .03, .08, .2, .4]))
            grids = [{**g, "vs": v} for g in grids for v in vs]
        if "joint-torque-ripple" in model:
            ks = [truth["k"]] if "k" in truth else [1, 2, 3, 4, 6, 8]
            grids = [{**g, "k": k} for g in grids for k in ks]
        best = None
        for g in grids:
            if "joint-torque-gain" in model:
                g["pred"] = self.solve([m for m in model if m != "joint-torque-gain"], g)[0]
                for _ in range(2):
                    p, c = self.solve(model, g)
                    g["pred"] = p
            p, c = self.solve(model, g)
            if best is None or c < best[1]:
                best = (p, c)
        return best


def usable(D, e, model):
    if not D.robot and e in ("joint-torque-gain", "payload", "gravity-error", "joint-load-friction", "rotor-inertia", "joint-elasticity"):
        return False
    return True


def analyse(D, model, hidden, truth, acts):
    """acts: hidden -> joints it acts on."""
    p1, _ = D.fit(model + hidden, truth)
    mv = D.moving
    out = dict(pred=p1, each={})
    for h in hidden:
        p0, _ = D.fit([m for m in model + hidden if m != h], truth)
        j = acts[h]
        e = (p1 - p0)[mv][:, j]
        left = (D.y - p1)[mv][:, j]
        if h == "joint-stribeck-friction":                      # it acts where it's slow
            a = np.abs(e) > .1 * np.percentile(np.abs(e), 99, axis=0)
        else:
            a = np.ones(e.shape, bool)
        e, left = e[a], rms(left[a])
        out["each"][h] = dict(effect=rms(e), left=left, ratio=rms(e) / max(left, 1e-12), j=j, at=a)
    y = D.y[mv]
    nz = float(np.sqrt(np.mean(D.sigma ** 2)))
    f = rms(y - p1[mv])
    per = [rms((y - p1[mv])[:, j]) / max(1.3 * D.sigma[j], .025 * rms(y[:, j]), .004 * rms(y)) for j in range(D.N)]
    out["force"] = dict(fit=f, noise=nz, reading=rms(y), ok=f <= max(1.29 * nz, .0168 * rms(y)) and max(per) < 2.2, near_ok=True, per=per)
    out["second"] = None
    return out


def near(D, model, hidden, res, truth):
    out = {}
    for h in hidden:
        j, mv = res["each"][h]["j"], D.moving
        at, left = res["each"][h]["at"], res["each"][h]["left"]
        rest = [m for m in model + hidden if m != h]
        tr = {k: v for k, v in truth.items() if not (h == "joint-torque-ripple" and k == "k" or h == "joint-stribeck-friction" and k == "vs")}
        names = []
        for alt in LIN:
            if alt in rest or alt == h or not usable(D, alt, rest):
                continue
            p, _ = D.fit(rest + [alt], tr)
            if rms((D.y - p)[mv][:, j][at]) < 1.5 * left:
                names.append(alt)
        out[h] = names
    return out


def best_addition(D, model, truth, j):
    best, name = np.inf, None
    for alt in LIN:
        if alt in model or not usable(D, alt, model):
            continue
        p, _ = D.fit(model + [alt], truth)
        r = rms((D.y - p)[D.moving][:, j])
        if r < best:
            best, name = r, alt
    return best, name
