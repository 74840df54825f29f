"""Programs of motion, the arm in contact or in the air, and the chain of measurement."""
import math
import numpy as np
from scipy.interpolate import CubicSpline
from scipy.signal import butter, filtfilt, lfilter, sosfilt, sosfiltfilt
import arms
import contact as ct

DT = 1e-3


class Path:
    """a program in the contact frame on a 1 ms grid: slip1, slip2, depth, tilt about t1, tilt about t2, force mode, wanted force"""
    def __init__(self, d0=-0.004):
        self.x = np.array([0.0, 0.0, d0, 0.0, 0.0])
        self.rows, self.fm, self.fd, self.ph = [], [], [], []

    def _add(self, X, phase, fm=0.0, fd=0.0):
        n = len(X)
        self.rows.append(X); self.fm.append(np.full(n, fm)); self.fd.append(np.broadcast_to(fd, (n,)).astype(float)); self.ph += [phase] * n
        self.x = X[-1].copy()

    def move(self, T, phase, s1=None, s2=None, d=None, a=None, b=None, fm=0.0, fd=0.0, lin=False):
        n = max(2, int(T / DT))
        z = self.x.copy()
        for i, v in enumerate((s1, s2, d, a, b)):
            if v is not None:
                z[i] = v
        s = np.arange(1, n + 1) / n
        r = min(0.2, 0.15 / max(T, 0.16)) if lin else None
        if lin:      # constant speed with short rounded ends
            acc = np.minimum(1, np.minimum(s / r, (1 - s) / r + 1e-9))
            w = np.cumsum(acc); w /= w[-1]
        else:
            w = s ** 3 * (10 - 15 * s + 6 * s * s)
        self._add(self.x + w[:, None] * (z - self.x), phase, fm, fd)

    def hold(self, T, phase, fm=0.0, fd=0.0):
        self._add(np.tile(self.x, (max(2, int(T / DT)), 1)), phase, fm, fd)

    def chirp(self, T, amp, f0, f1, phase, axis=2, amp2=0.0):
        t = np.arange(1, int(T / DT) + 1) * DT
        ph = 2 * np.pi * (f0 * t + (f1 - f0) * t * t / (2 * T))
        env = np.minimum(1, np.minimum(t / 0.5, (T - t) / 0.5))
        X = np.tile(self.x, (len(t), 1))
        X[:, axis] += amp * env * np.sin(ph)
        if amp2:
            X[:, 1] += amp2 * env * (np.cos(ph) if axis == 0 else np.cos(ph * 1.37))
        self._add(X, phase)

    def arrays(self):
        return np.vstack(self.rows), np.concatenate(self.fm), np.concatenate(self.fd), np.array(self.ph)


def program(rng, dm, needs, T=25.0, F0=5.0):
    """dm: deepest depth; needs: what the case has to show"""
    p = Path(-rng.uniform(.002, .006))
    U = rng.uniform
    if rng.random() < .7 or "air" in needs:
        p.hold(U(.5, 1.5), "free")
    if "airtilt" in needs:
        for _ in range(5):
            p.move(U(1.5, 2.5), "free", a=U(-.5, .5), b=U(-.5, .5), d=-.03); p.hold(.4, "free")
        p.move(2.0, "free", a=0, b=0, d=-.004)
    t0 = lambda: len(p.ph) * DT
    first = True
    kinds = []
    if "pokes" in needs or not needs & {"slides"}:
        kinds += ["poke"] * 3
    if "slides" in needs:
        kinds += ["slide"] * 3 + ["poke"]
    if "hold" in needs:
        kinds += ["hold"] * 2
    if "chirp" in needs:
        kinds += ["chirp"] * 2
    if "tilt" in needs:
        kinds += ["tilt"] * 3
    if "place" in needs:
        kinds += ["grid"] * 2
    if "loops" in needs:
        kinds += ["loop"] * 2
    if "force" in needs:
        kinds += ["fslide"] * 2
    order = list(dict.fromkeys(kinds))
    rng.shuffle(order)
    i = 0
    span = U(.012, .03)
    onedir = "onedir" in needs
    while t0() < T - 2 or i < len(order):
        kd = order[i] if i < len(order) else kinds[rng.integers(len(kinds))]
        i += 1
        one = U(.55, 1.0) if "depths" in needs else U(.85, 1.0)
        if kd == "poke":
            d = dm * (U(.35, 1.0) if "depths" in needs else U(.75, 1.0))
            if "deeper" in needs:
                d = dm * min(1.0, .4 + .6 * t0() / T)
            v = 10 ** U(-.55, .65) if "speeds" in needs else 10 ** U(-.2, .4)
            for _ in range(int(rng.integers(1, 4))):
                p.move(v, "poke", d=d); p.hold(U(.05, .5), "poke")
                p.move(v * U(.6, 1.4), "poke", d=-U(.0005, .002) if ("air" in needs or rng.random() < .5) else .15 * dm)
        elif kd == "hold":
            p.move(U(.3, .6), "approach", d=dm * one); p.hold(U(2.5, 5.5), "hold")
            p.move(U(.3, .6), "retract", d=dm * .3 if rng.random() < .5 else -.001); p.hold(U(.8, 2.0), "rest")
        elif kd == "chirp":
            p.move(.8, "approach", d=dm * .6); p.chirp(U(4, 7), dm * .35, .4, U(4, 7), "poke")
        elif kd == "slide":
            p.move(.7, "approach", d=dm * one)
            for _ in range(int(rng.integers(2, 5))):
                v = 10 ** U(-2.9, -1.3) if "sspeeds" in needs else (.01 if "samespeed" in needs else 10 ** U(-2.2, -1.5))
                ang = 0.0 if onedir else (rng.choice([0, np.pi / 2, np.pi, -np.pi / 2]) if "dirs" in needs else U(-np.pi, np.pi))
                L = min(span, max(v * 2.5, .002)) if "samespeed" not in needs else .01
                tgt = np.array([p.x[0] + L * math.cos(ang), p.x[1] + L * math.sin(ang)])
                if np.abs(tgt).max() > span and not onedir:
                    tgt = p.x[:2] * .0 + np.clip(2 * p.x[:2] - tgt, -span, span)
                Lr = np.linalg.norm(tgt - p.x[:2]) + 1e-9
                p.move(max(.3, Lr / v), "slide", s1=tgt[0], s2=tgt[1], lin=True)
                if "depths" in needs:
                    p.move(.4, "slide", d=dm * U(.4, 1.0))
                if rng.random() < .5:
                    p.hold(U(.1, .8), "rest")
            if "micro" in needs:
                p.chirp(U(3, 4), U(.6, 1.5) * 1e-3, .5, 1.2, "slide", axis=0)
            p.move(.5, "retract", d=-.002)
            if onedir:
                p.move(1.0, "free", s1=0.0, s2=0.0)
        elif kd == "loop":
            p.move(.7, "approach", d=dm * one)
            p.chirp(U(4, 7), span * .5, U(.15, .4), U(.4, 1.0), "slide", axis=0, amp2=span * .5)
            p.move(.5, "retract", d=.2 * dm)
        elif kd == "tilt":
            p.move(.5, "retract", d=-.006)
            p.move(1.0, "free", a=U(-.35, .35), b=U(-.35, .35)); p.move(.5, "approach", d=dm * one * .9); p.hold(.3, "hold")
            p.move(.5, "retract", d=-.003)
        elif kd == "grid":
            for _ in range(4):
                p.move(.5, "retract", d=-.002); p.move(.6, "free", s1=U(-span, span), s2=U(-span, span) * .5); p.move(.5, "poke", d=dm * one)
            p.move(span * 2 / .012, "slide", s1=-p.x[0] / (abs(p.x[0]) + 1e-9) * span, lin=True)
        elif kd == "fslide":
            p.move(.6, "approach", d=dm * .5)
            p.hold(.8, "hold", fm=1.0, fd=F0)
            p.move(U(1.5, 4), "slide", s1=(U(-span, span) if not onedir else p.x[0] + span), s2=None if onedir else U(-span, span), fm=1.0, fd=F0 * (1.0 if "constload" in needs else U(.5, 1.4)), lin=True)
            p.move(.5, "retract", d=-.002)
            if onedir:
                p.move(1.0, "free", s1=0.0, s2=0.0)
        if t0() > 2.2 * T:
            break
    p.move(.8, "retract", d=-.004, a=0, b=0)
    p.hold(U(.6, 2.0), "free")
    return p.arrays()


def frame_from(n, rng, level=True):
    a = np.array([1.0, 0, 0]) if abs(n[0]) < .8 else np.array([0, 0, 1.0])
    a = a - n * (a @ n); a /= np.linalg.norm(a)
    th = rng.uniform(-np.pi, np.pi)
    b = np.cross(n, a)
    t1 = math.cos(th) * a + math.sin(th) * b
    return t1, np.cross(n, t1)


def rotvec(v):
    a = np.linalg.norm(v)
    K = np.array([[0, -v[2], v[1]], [v[2], 0, -v[0]], [-v[1], v[0], 0]])
    if a < 1e-12:
        return np.eye(3) + K
    return np.eye(3) + math.sin(a) / a * K + (1 - math.cos(a)) / a ** 2 * K @ K


REACH = {"lwr": (.45, .62), "lwr-name": (.45, .62), "ur5": (.4, .62), "ur10": (.5, .8), "panda": (.38, .58), "own": (.42, .62)}
SEEDQ = {"lwr": [0, -.5, 0, 1.4, 0, -1.0, 0], "ur5": [0, -1.2, 1.6, -1.9, -1.5, 0], "ur10": [0, -1.2, 1.6, -1.9, -1.5, 0], "panda": [0, -.4, 0, -2.0, 0, 1.7, .7],
         "own": [0, -.9, 1.3, 0, .8, 0]}
SEEDQ["lwr-name"] = SEEDQ["lwr"]


def place(arm, rng, X, normal, tipd=None):
    """a surface point and joint path for the program X; None if not reachable"""
    a_tip = arm.r_sp.T @ (arm.tip_s / np.linalg.norm(arm.tip_s))        # tool's way out in tip axes
    for _ in range(30):
        lo, hi = REACH[arm.name]
        r, az = rng.uniform(lo, hi), rng.uniform(-1.2, 1.2)
        pt = np.array([r * math.cos(az), r * math.sin(az), rng.uniform(.05, .35)])
        t1, t2 = frame_from(normal, rng)
        # tip orientation: a_tip -> -normal
        z = -normal
        x = t1; y = np.cross(z, x)
        b = np.array([1.0, 0, 0]) if abs(a_tip[0]) < .8 else np.array([0, 0, 1.0])
        b = b - a_tip * (a_tip @ b); b /= np.linalg.norm(b)
        Rb = np.stack([b, np.cross(a_tip, b), a_tip], 1)
        Rd0 = np.stack([x, y, z], 1) @ Rb.T
        st = 20
        Xs = X[::st]
        n_ = len(Xs)
        pos = pt + Xs[:, :1] * t1 + Xs[:, 1:2] * t2 - Xs[:, 2:3] * normal
        if np.abs(X[:, 3:]).max() < 1e-9:
            Rd = np.tile(Rd0, (n_, 1, 1))
        else:
            Rd = np.stack([rotvec(t1 * p[3] + t2 * p[4]) @ Rd0 for p in Xs])
        q0 = np.array(SEEDQ[arm.name], float); q0[0] += az
        q0 = q0 + rng.normal(0, .15, arm.n)
        Q1, e1 = arms.ik(pos[:1], Rd[:1], q0, arm.R0, arm.p0, arm.ax, arm.tp, arm.tR, arm.lo, arm.hi, 12)
        if e1[0] > 1e-6 or (Q1[0] < arm.lo - 3).any() or (np.abs(Q1[0]) > 3.6).any():
            continue
        Q, e = arms.ik(pos, Rd, Q1[0], arm.R0, arm.p0, arm.ax, arm.tp, arm.tR, arm.lo, arm.hi, 3)
        if e.max() > 1e-5 or np.abs(np.diff(Q, axis=0)).max() > .06 or np.abs(Q).max() > 4.2:
            continue
        tt = np.arange(n_) * st
        cs = CubicSpline(tt, Q)
        ti = np.minimum(np.arange(len(X)), tt[-1])
        Qd = cs(ti)
        # joint direction of a metre along the normal
        Rn, pn = arm.fk(Q[::25])
        B = np.zeros((len(Q[::25]), arm.n))
        for i, q in enumerate(Q[::25]):
            J = jac(arm, q)
            B[i] = J.T @ np.linalg.solve(J @ J.T + 1e-6 * np.eye(6), np.r_[normal, 0, 0, 0])
        Bi = np.stack([np.interp(np.arange(len(X)), np.arange(len(B)) * st * 25, B[:, j]) for j in range(arm.n)], 1)
        if np.abs(Bi).max() > 12:
            continue
        return pt, t1, t2, Qd, Bi
    return None


def jac(arm, q):
    n = arm.n
    R = np.zeros((n, 3, 3)); p = np.zeros((n, 3)); z = np.zeros((n, 3))
    arms.chain(q, arm.R0, arm.p0, arm.ax, R, p, z)
    pt = p[-1] + R[-1] @ arm.tp
    return np.vstack([np.cross(z, pt - p).T, z.T])


def zero_friction(n):
    Fr = np.zeros((n, 16)); Fr[:, 2] = .1; Fr[:, 7] = 1e-3; Fr[:, 10] = 1
    return Fr


def run_arm(arm, Qd, B, fm, fd, ctl, grav, Fr, P=None, gk=None, inh=None, surf=None, tip_true=None, dt=5e-4, text=None):
    n = arm.n
    keep = int(round(DT / dt))
    Qd = np.ascontiguousarray(Qd)
    dQ = np.gradient(Qd, DT, axis=0)
    ddQ = np.gradient(dQ, DT, axis=0)
    on = P is not None
    P = ct.params() if P is None else P
    g, k = gk if gk is not None else (np.zeros(ct.NE), np.zeros(ct.NE))
    inh = np.zeros((0, 5)) if inh is None else inh
    pt, nn, t1, t2 = surf if surf is not None else (np.zeros(3),) * 4
    tp = arm.tp if tip_true is None else tip_true
    text = np.zeros_like(Qd) if text is None else text
    r = arms.loop(len(Qd) * keep, dt, keep, Qd, dQ, ddQ, B, fm, fd, ctl["kf"], ctl["Kq"], ctl["Dq"], ctl["ffm"], arm.R0, arm.p0, arm.ax, arm.m, arm.c, arm.I,
                  np.asarray(grav, float), ctl["Jr"], Fr, ctl["Ft"], text, tp, pt, nn, t1, t2, P, g, k, inh, on)
    return dict(zip(("q", "dq", "ddq", "tau", "fc", "x"), r))


def controller(arm, rng, stiff=None):
    n = arm.n
    s = stiff or 10 ** rng.uniform(3.3, 4.1)
    big = np.array([1.0, 1, .9, .9, .6, .4, .4][:n]) if n == 7 else np.array([1, 1, .9, .6, .5, .4])
    Jr = np.array([1.2, 1.2, .8, .8, .5, .35, .35][:n]) if n == 7 else np.array([1.3, 1.3, 1.0, .5, .4, .35])
    Jr = Jr * rng.uniform(.6, 1.2)
    Kq = s * big
    Dq = 2 * rng.uniform(.5, .9) * np.sqrt(Kq * (Jr + .3 * big))
    return dict(Kq=Kq, Dq=Dq, Jr=Jr, kf=rng.uniform(.3, 1.2) * 1e-3, ffm=1.0, Ft=np.full(n, rng.uniform(.7, 1.0)), s=s)


def lowpass(x, fc, fs=1000.0, order=2, zero=False):
    if fc >= .45 * fs:
        return x
    sos = butter(order, fc / (fs / 2), output="sos")
    if zero:
        return sosfiltfilt(sos, x, axis=0)
    zi = np.array([[0.0, 0.0]])
    from scipy.signal import sosfilt_zi
    z0 = sosfilt_zi(sos)
    x = np.asarray(x)
    if x.ndim == 1:
        return sosfilt(sos, x, zi=z0 * x[0])[0]
    return np.stack([sosfilt(sos, x[:, j], zi=z0 * x[0, j])[0] for j in range(x.shape[1])], 1)


def lag1(x, T, dt=DT):
    a = math.exp(-dt / T)
    y, _ = lfilter([1 - a], [1, -a], x, axis=0, zi=a * np.atleast_2d(x[0]) if x.ndim == 2 else np.array([a * x[0]]))
    return y


def wrench(arm, q, fc_world, grav, mass, com, inertia, tip_s):
    """at 1 ms: the load in the sensor frame"""
    R6, p6 = arm.fk(q)
    Rs = R6 @ arm.sR
    ps = p6 + R6 @ arm.sp
    pc = ps + Rs @ com
    sm = lambda x: sosfiltfilt(butter(3, 120 / 500, output="sos"), x, axis=0)
    a = np.gradient(np.gradient(sm(pc), DT, axis=0), DT, axis=0)
    dR = np.gradient(Rs, DT, axis=0)
    Wm = np.einsum("nji,njk->nik", Rs, dR)                          # body rates
    w = sm(np.stack([Wm[:, 2, 1], Wm[:, 0, 2], Wm[:, 1, 0]], 1))
    al = np.gradient(w, DT, axis=0)
    f_tool = np.einsum("nji,nj->ni", Rs, mass * (np.asarray(grav) - a))
    f_c = np.einsum("nji,nj->ni", Rs, fc_world)
    tq = np.cross(com, f_tool) + np.cross(tip_s, f_c)
    tq -= al @ inertia.T + np.cross(w, w @ inertia.T)
    return np.hstack([f_tool + f_c, tq]), Rs


def sense(y, rng, h, noise, chain, t):
    """h: hidden sensor effects; chain: nuisances. y (N,6) on the 1 ms grid, still without sampling and noise"""
    y = y.copy()
    if "lag" in h:
        y = lag1(y, h["lag"])
    if chain.get("fc"):
        y = lowpass(y, chain["fc"])
    if "mis" in h:
        R = rotvec(-np.asarray(h["mis"]))
        y = np.hstack([y[:, :3] @ R.T, y[:, 3:] @ R.T])
    if "xtalk" in h:
        y = y + y @ h["xtalk"].T
    if "bias" in h:
        y = y + h["bias"]
    if "drift" in h:
        y = y + np.outer(t / 60.0, h["drift"])
    nl = chain.get("nl", 0.0)
    if nl:
        full = np.maximum(np.abs(y).max(0), 1e-6)
        y = y + nl * full * ((y / full) ** 2 - .3) * np.sign(y) * (np.abs(y) / full)
    if "hum" in h:
        f0, am, ph = h["hum"]
        for j, (A, p_) in enumerate(zip(am, ph)):
            y = y + A * np.sin(2 * np.pi * f0 * (j + 1) * t + p_)[:, None] * h["humdir"]
    if "burst" in h:
        y = y + h["burst"]
    return y


def finish(y, rng, h, noise):
    """after sampling: clip with noise before it, lattice of a fine converter"""
    y = y + rng.normal(0, 1, y.shape) * noise
    if "sat" in h:
        ch, L = h["sat"]
        y[:, ch] = np.clip(y[:, ch], -L, L)
    st = h.get("adc", noise * .3)
    return np.round(y / st) * st


def stamps(rng, T, rate, jitter, drop):
    t = np.arange(0, T, 1.0 / rate)
    if jitter:
        t = t + np.clip(rng.normal(0, jitter, len(t)), -.4, .4) / rate
    if drop:
        k = rng.random(len(t)) > drop
        i = rng.integers(len(t) // 3, len(t) - 20)
        k[i:i + rng.integers(1, 8)] = False
        k[0] = True
        t = t[k]
    t = np.sort(np.maximum(t, 0))
    return t[np.r_[True, np.diff(t) > 1e-6]]


def at(t, x, dt=DT, shift=0.0):
    tt = np.arange(len(x)) * dt
    if x.ndim == 1:
        return np.interp(t - shift, tt, x)
    return np.stack([np.interp(t - shift, tt, x[:, j]) for j in range(x.shape[1])], 1)
