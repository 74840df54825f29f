"""What the arm is asked to do: turns of the wrist in the air, pokes, holds, slides, rests, as a joint path."""
import numpy as np
from scipy.interpolate import CubicSpline
from robots import rotvec, ROBOTS

H = 0.004                        # s, grid of the reference


def ramp(n, frac):
    """0..1 with smooth (cosine) acceleration over the given fraction at both ends, constant speed between."""
    u = np.linspace(0, 1, n)
    a = min(max(frac, 1e-3), 0.5)
    v = np.where(u < a, 0.5 - 0.5 * np.cos(np.pi * u / a), np.where(u > 1 - a, 0.5 - 0.5 * np.cos(np.pi * (1 - u) / a), 1.0))
    s = np.concatenate([[0], np.cumsum(0.5 * (v[1:] + v[:-1]))])
    return s / s[-1]


class Path:
    """Local coordinates: s1 s2 depth tilt1 tilt2, and offsets of the wrist joints."""

    def __init__(self, start, wrist):
        self.x, self.o, self.ph = [np.array(start, float)[None]], [np.zeros((1, wrist))], ["rest"]
        self.nw = wrist

    @property
    def at(self):
        return self.x[-1][-1].copy()

    def _add(self, X, O, phase):
        self.x.append(X), self.o.append(O)
        self.ph += [phase] * len(X)

    def go(self, phase, speed, acc=0.12, **kw):
        """Straight to the named coordinates; speed in m/s along the path (tilts: time for 0.5 rad/s)."""
        a = self.at
        b = a.copy()
        for k, v in kw.items():
            b["s1 s2 d ta tb".split().index(k)] = v
        L = np.linalg.norm((b - a)[:3])
        T = max(L / speed, np.linalg.norm((b - a)[3:]) / 0.6, 2 * H)
        ta = min(acc, T)
        T += ta
        n = max(int(round(T / H)), 3)
        s = ramp(n + 1, ta / T)[1:, None]
        self._add(a + (b - a) * s, np.zeros((n, self.nw)), phase)
        return self

    def wait(self, phase, T):
        n = max(int(round(T / H)), 1)
        self._add(np.repeat(self.at[None], n, 0), np.zeros((n, self.nw)), phase)
        return self

    def turns(self, rng, seconds, amp, fmax, phase="free"):
        """Wrist joints through a few sines with an envelope that starts and ends at rest."""
        n = int(round(seconds / H))
        t = np.arange(1, n + 1) * H
        env = np.clip(np.minimum(t, seconds - t) / min(1.2, seconds / 3), 0, 1)
        env = env * env * (3 - 2 * env)
        O = np.zeros((n, self.nw))
        for j in range(self.nw):
            f = rng.uniform(0.12, 0.3)
            y = np.sin(2 * np.pi * f * t + rng.uniform(0, 6.28)) + 0.25 * np.sin(2 * np.pi * rng.uniform(.4, .8) * t + rng.uniform(0, 6.28))
            if fmax > 0.5:
                late = np.clip((t - 0.45 * seconds) / 0.3, 0, 1)
                y = y + late * 0.1 * amp_cap(fmax) * np.sin(2 * np.pi * fmax * rng.uniform(.8, 1.0) * t + rng.uniform(0, 6.28))
            O[:, j] = y * env * amp[j]
        self._add(np.repeat(self.at[None], n, 0), O, phase)
        return self

    def micro(self, rng, amp, speed, n, axis="s1"):
        for i in range(n):
            a = amp * (1 - 0.18 * (i // 2))
            self.go("slide", speed, acc=0.1, **{axis: self.at[0 if axis == "s1" else 1] + (a if i % 2 == 0 else -a)})
            if i % 2:
                self.wait("rest", 0.15)
        return self

    def arrays(self):
        return np.concatenate(self.x), np.concatenate(self.o), np.array(self.ph)


def amp_cap(f):
    return min(1.2, 2.5 / f)


class Place:
    """Where the arm touches: point, normal, tangent, a reachable posture."""

    def __init__(self, rng, arm, slope=0.35):
        self.arm = arm
        ch = arm.chain
        for _ in range(60):
            p = np.array([rng.uniform(.46, .60), rng.uniform(-.15, .15), rng.uniform(.05, .2)]) if arm.name == "lwr4plus" else \
                np.array([rng.uniform(.42, .58), rng.uniform(-.1, .2), rng.uniform(.03, .15)])
            n = rotvec(np.append(rng.normal(size=2) * slope * 0.5, 0)) @ np.array([0, 0, 1.0])
            if rng.random() < 0.4:
                n = np.array([0, 0, 1.0])
            yaw = rng.uniform(-0.8, 0.8)
            t1 = np.array([np.cos(yaw), np.sin(yaw), 0])
            t1 -= n * (t1 @ n)
            t1 /= np.linalg.norm(t1)
            p, n, t1 = np.round(p, 4), np.round(n, 5), t1
            n /= np.linalg.norm(n)
            self.p, self.n, self.t1 = p, n, t1
            self.t2 = np.cross(n, t1)
            self.R0 = np.column_stack([t1, np.cross(-n, t1), -n])        # tip frame: z into the material
            home = arm.spec["home"]
            # the flange's yaw is free: take the one nearest to home
            best = None
            for w in np.linspace(-np.pi, np.pi, 13)[:-1]:
                Rw = self.R0 @ rotvec([0, 0, w])
                q, e = ch.ik(home, self.pose(np.array([[0, 0, -.08, 0, 0]]))[0], (Rw @ ch.Rt.T)[None], home)
                if e < 1e-8 and np.abs(q[0]).max() < 2.75 and (best is None or np.abs(q[0] - home).max() < best[0]):
                    best = (np.abs(q[0] - home).max(), q[0], Rw)
            if best is not None and best[0] < 1.1:
                self.qh, self.R0 = best[1], best[2]
                return
        raise RuntimeError("no posture")

    def pose(self, X):
        return (self.p + X[:, :1] * self.t1 + X[:, 1:2] * self.t2 - X[:, 2:3] * self.n,)[0], None

    def joints(self, path, tip):
        """Joint path of the whole motion on the grid H. tip: the stated tip in the sensor frame."""
        X, O, ph = path.arrays()
        step = 3
        idx = np.unique(np.r_[np.arange(0, len(X), step), len(X) - 1])
        P, _ = self.pose(X[idx])
        R = np.empty((len(idx), 3, 3))
        last, Rl = None, None
        for i, k in enumerate(idx):
            a = tuple(X[k, 3:])
            if a != last:
                Rl = rotvec(a[0] * self.t1 + a[1] * self.t2) @ self.R0 @ self.arm.chain.Rt.T
                last = a
            R[i] = Rl
        Q, err = self.arm.chain.ik(self.qh, P, R, self.qh, tip=tip)
        if err > 1e-6:
            raise RuntimeError(f"ik {err}")
        q = CubicSpline(idx * H, Q)(np.arange(len(X)) * H)
        w = list(self.arm.spec["wrist"])
        for _ in range(12):                                            # keep the turns clear of the table
            qq = q.copy()
            qq[:, w] += O
            Pb, Rb = self.arm.chain.batch(qq[::10])
            free = np.abs(O[::10]).max(1) > 1e-9
            dep = -((Pb + Rb @ tip - self.p) @ self.n)
            lim = self.arm.chain.limits
            fast = np.abs(np.diff(qq, axis=0) / H).max(0) > .88 * lim[:, 2]
            out = (qq < lim[:, 0] + .05).any() or (qq > lim[:, 1] - .05).any()
            if not fast.any() and not out and (not free.any() or dep[free].max() < -0.012):
                break
            O = O * 0.85
        else:
            raise RuntimeError("turns don't fit")
        return np.ascontiguousarray(qq), ph, X


def compliance(place, ctrl, q, tip):
    """m/N along the normal of the controlled arm."""
    from robots import fk
    ch = place.arm.chain
    p, R, an, ax = np.empty(3), np.empty((3, 3)), np.empty((ch.n, 3)), np.empty((ch.n, 3))
    fk(ch.pack, np.ascontiguousarray(q), p, R, an, ax)
    J = np.cross(ax, p + R @ tip - an).T
    K = np.diag(ctrl["K"])
    if ctrl["mode"] == 1:
        Ja = np.vstack([J, ax.T])
        K = K + Ja.T @ np.diag(ctrl["Kx"]) @ Ja
    return float(place.n @ J @ np.linalg.solve(K, J.T) @ place.n)


def controller(rng, name):
    """Closed loop of random stiffness: joint impedance (0) or Cartesian impedance (1)."""
    arm = np.array(ROBOTS[name]["armature"])
    n = len(arm)
    if rng.random() < 0.55:
        s = np.exp(rng.uniform(np.log(0.35), np.log(2.0)))
        K = (np.array([6000, 6000, 4000, 4000, 1500, 900, 500.]) if n == 7 else np.array([7000, 7000, 5000, 1800, 1200, 600.])) * s
        M = arm + (np.array([1.5, 1.5, .5, .5, .06, .05, .01]) if n == 7 else np.array([2.5, 2.5, 1.0, .3, .25, .05]))
        return dict(mode=0, K=K, D=2 * rng.uniform(.5, .9) * np.sqrt(K * M), Kx=np.zeros(6), Dx=np.zeros(6), kind="joint impedance", scale=float(s))
    kx = np.exp(rng.uniform(np.log(2500), np.log(9000)))
    kr = rng.uniform(120, 300)
    z = rng.uniform(.6, .9)
    return dict(mode=1, K=arm * 60., D=arm * 10, Kx=np.r_[[kx] * 3, [kr] * 3], Dx=np.r_[[2 * z * np.sqrt(kx * 6.)] * 3, [2 * z * np.sqrt(kr * .25)] * 3],
                kind="cartesian impedance", scale=float(kx))
