"""Programmes of the tip, the measurement chain, writers."""
import os
import numpy as np, pinocchio as pin
import table
from material import lag1


class Prog:
    """position of the tip in the surface frame (s1, s2, height of command, two tilts), minimum-jerk moves and sines at 200 Hz"""
    H = .005

    def __init__(self, z0):
        self.x = np.array([0., 0., z0, 0., 0.]); self.rows = []; self.ph = []

    def go(self, T, ph, s1=None, s2=None, z=None, a=None, b=None):
        y = self.x.copy()
        for i, v in enumerate((s1, s2, z, a, b)):
            if v is not None:
                y[i] = v
        n = max(2, int(T / self.H)); u = np.arange(1, n + 1)[:, None] / n
        self.rows.append(self.x + (y - self.x) * (10 * u ** 3 - 15 * u ** 4 + 6 * u ** 5)); self.ph += [ph] * n; self.x = y

    def const(self, T, ph, s1=None, s2=None):
        """constant speed with short ramps"""
        y = self.x.copy()
        y[0] = self.x[0] if s1 is None else s1; y[1] = self.x[1] if s2 is None else s2
        n = max(10, int(T / self.H)); r = min(40, n // 4)
        v = np.minimum(1, np.minimum(np.arange(n) / r, (n - 1 - np.arange(n)) / r)); u = np.cumsum(v); u = (u / u[-1])[:, None]
        self.rows.append(self.x + (y - self.x) * u); self.ph += [ph] * n; self.x = y

    def sine(self, T, ph, axis, amp, f, creep=0.):
        n = int(T / self.H); tt = np.arange(1, n + 1) * self.H
        w = np.sin(2 * np.pi * f * tt) * np.minimum(1, np.minimum(tt, T - tt) * 2 * f / .7)
        R = np.repeat(self.x[None], n, 0); R[:, axis] += amp * w
        if creep:
            u = tt / T; c = creep * T * (10 * u ** 3 - 15 * u ** 4 + 6 * u ** 5); R[:, 0] += c
            self.x = self.x.copy(); self.x[0] += c[-1]
        self.rows.append(R); self.ph += [ph] * n

    def hold(self, T, ph="hold"):
        self.go(T, ph)

    def done(self):
        R = np.vstack(self.rows)
        return np.arange(len(R)) * self.H, R, np.array(self.ph)


def contact_programme(rng, dcmd, tilt=0.08, slides=True, short=False, retract=True, deep=1.6):
    """dcmd: commanded depth of the first level"""
    u = lambda a, b: rng.uniform(a, b)
    p = Prog(.008)
    p.hold(u(.8, 2.), "free")
    cr = u(.4e-3, 1e-3) if slides else 0.
    p.go(u(1., 1.8), "approach", z=-dcmd, s1=u(.002, .004) * bool(slides))
    p.hold(u(.8, 2.5))
    p.sine(u(4, 7), "poke", 2, u(.3, .45) * dcmd, u(.3, .6), cr)
    p.sine(u(2, 3.5), "poke", 2, u(.2, .35) * dcmd, u(.9, 1.6), cr)
    p.hold(u(1., 2.5))
    L = u(.018, .035)
    if slides:
        p.const(u(1., 2.), "slide", s1=L); p.hold(.5)
        p.const(u(3., 6.), "slide", s1=0.)
        p.const(u(1., 2.), "slide", s2=.6 * L); p.const(u(.7, 1.2), "slide", s2=0.)
    if tilt > .05:
        p.sine(4., "poke", 3, tilt, .5, cr); p.sine(4., "poke", 4, tilt, .5, cr)
    p.go(u(.5, 1.2), "poke", z=-deep * dcmd, s1=p.x[0] + .002 * bool(slides))
    p.hold(u(1., 3.))
    p.sine(u(3, 5), "poke", 2, u(.2, .4) * dcmd, u(.3, .9), cr)
    if slides:
        p.const(u(.4, .8), "slide", s1=L); p.const(u(.8, 1.6), "slide", s1=0.); p.const(u(2., 4.), "slide", s2=.6 * L); p.const(u(.6, 1.), "slide", s2=0., s1=.5 * L)
        p.sine(u(4, 6), "slide", 0, u(1e-3, 3e-3), u(.4, .7)); p.hold(.8)
        p.const(1., "slide", s1=0.)
    p.go(u(.6, 1.2), "poke", z=-dcmd, s1=p.x[0] - .002 * bool(slides))
    p.hold(u(.8, 1.5))
    if retract:
        p.go(u(1.2, 2.5), "retract", z=.006, s1=p.x[0] - .002 * bool(slides))
        p.hold(u(.5, 1.), "free")
        if not short:
            p.go(u(.8, 1.5), "approach", z=-.8 * dcmd, s1=p.x[0] + .003 * bool(slides)); p.hold(1.); p.go(u(.8, 2.), "retract", z=.008, s1=p.x[0])
        p.hold(.8, "rest")
    return p.done()


def rows(rng, T, fs, jit, drop):
    n = int(T * fs)
    t = np.arange(n) / fs
    if jit > 0:
        t = t + rng.uniform(-.5, .5, n) * jit / fs
        t[0] = max(t[0], 0)
    if drop > 0:
        keep = rng.random(n) > drop
        keep[[0, -1]] = True
        t = t[keep]
    return t


def chain(ch, tw, w, tlog, rng):
    """true wrench (n,6) at tw -> readings at tlog"""
    w = w.copy()
    M = np.eye(3) * (1 + ch.get("g", 0.)) + ch.get("xt", np.zeros((3, 3)))
    M = M @ pin.exp3(np.asarray(ch.get("rot", np.zeros(3)), float))
    w[:, :3] = w[:, :3] @ M.T
    w[:, 3:] = w[:, 3:] @ M.T
    nl = ch.get("nonlin", 0.)
    if nl:
        s = np.abs(w).max(0) + 1e-9
        w = w + nl * (w / s) ** 3 * s - nl * .6 * w
    lag = ch.get("lag", 0.)
    if lag > 0:
        w = np.stack([lag1(tw, np.ascontiguousarray(w[:, j]), lag) for j in range(6)], 1)
    d = ch.get("delay", 0.)
    r = np.stack([np.interp(tlog - d, tw, w[:, j]) for j in range(6)], 1)
    nz = rng.standard_normal(r.shape) * ch["noise"]
    if "sat" in ch:
        a, L, behind = ch["sat"]
        if not behind:
            r = r + nz
        r[:, a] = np.clip(r[:, a], -L, L)
        if behind:
            r = r + nz
    else:
        r = r + nz
    T = tlog[-1] - tlog[0]
    r = r + ch.get("bias", np.zeros(6)) + np.outer((tlog - tlog[0]) / 60, ch.get("drift", np.zeros(6)))
    r = r + np.outer(np.sin(np.pi * (tlog - tlog[0]) / T * ch.get("wob", 1.)) , ch.get("temp", np.zeros(6)))
    if "hum" in ch:
        f, amp, ph = ch["hum"]
        for h, s in ((1, 1.), (2, .12)):
            r = r + s * amp * np.sin(2 * np.pi * f * h * tlog[:, None] + h * ph)
    q = ch.get("quant", 0.)
    if np.any(q):
        r = np.where(q > 0, np.round(r / np.where(q > 0, q, 1)) * q, r)
    return r


def joints(rng, cols, rec, tlog, enc, dq):
    """encoders; dq: None, or dict of noise, bias, lag"""
    n = rec["q"].shape[1]
    for j in range(n):
        q = np.interp(tlog, rec["t"], rec["q"][:, j])
        cols[f"q{j+1}"] = np.round(q / enc) * enc
    if dq is not None:
        for j in range(n):
            v = lag1(rec["t"], np.ascontiguousarray(rec["dq"][:, j]), dq["lag"])
            cols[f"dq{j+1}"] = np.interp(tlog, rec["t"], v) + dq["bias"] * rng.standard_normal() + dq["noise"] * rng.standard_normal(len(tlog))
    return cols


def write(dir_, df, rig, urdf=None, csv=False):
    os.makedirs(dir_, exist_ok=True)
    for f in os.listdir(dir_):
        os.remove(f"{dir_}/{f}")
    table.write(f"{dir_}/log." + ("csv" if csv else "parquet"), df)
    if urdf:
        open(f"{dir_}/robot.urdf", "w").write(urdf)
    out = []
    fmt = lambda v: '"' + v + '"' if isinstance(v, str) else ("[" + ", ".join(fmt(x) for x in v) + "]" if hasattr(v, "__len__") else repr(float(v)))
    for tab, d in rig.items():
        out.append(f"[{tab}]")
        out += [f"{k} = {fmt(v)}" for k, v in d.items()] + [""]
    open(f"{dir_}/rig.toml", "w").write("\n".join(out))
