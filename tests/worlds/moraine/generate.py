"""The blind test world 'moraine'.   generate.py --seed N --out OUT"""
import argparse, json, os, time
import numpy as np
from scipy.interpolate import CubicSpline
import pyarrow as pa, pyarrow.parquet as pq
import phys
from phys import law, Arm

DT = 2.5e-4
KEEP = 2                       # states kept at 2 kHz


# ---------------------------------------------------------------- writing
def write(path, cols, fmts):
    names = list(cols)
    if path.endswith(".parquet"):
        pq.write_table(pa.table({k: (v if isinstance(v, list) else np.asarray(v, float)) for k, v in cols.items()}), path, compression="zstd")
        return
    num = [k for k in names if not isinstance(cols[k], list)]
    A = np.column_stack([cols[k] for k in num])
    fmt = ",".join(fmts(k) for k in num)
    txt = [k for k in names if isinstance(cols[k], list)]
    with open(path, "w") as f:
        f.write(",".join(num + txt) + "\n")
        if txt:
            ph = cols[txt[0]]
            f.write("\n".join((fmt % tuple(r)) + "," + p for r, p in zip(A.tolist(), ph)))
        else:
            f.write("\n".join(fmt % tuple(r) for r in A.tolist()))
        f.write("\n")


def fmtof(k):
    if k == "t": return "%.6f"
    if k[0] == "q" or k.startswith("dq"): return "%.8f"
    if k in ("depth", "slip1", "slip2"): return "%.8f"
    if k.endswith("rate"): return "%.7f"
    return "%.6f"


def arr(v):
    return "[" + ", ".join("%.6g" % x for x in np.asarray(v).ravel()) + "]"


class Row:
    def __init__(s, seed, i, key):
        s.rng = np.random.default_rng([seed, i, 11])
        s.key = key
        s.fmt = "parquet" if s.rng.random() < .45 else "csv"
        s.note = {}

    def u(s, a, b, n=None):
        return s.rng.uniform(a, b, n)

    def pick(s, *a):
        return a[s.rng.integers(len(a))]

    def yes(s, p):
        return bool(s.rng.random() < p)


# ---------------------------------------------------------------- programmes of motion
class Prog:
    F = 500

    def __init__(s, **a):
        s.now = dict(x=0., y=0., h=.012, rx=0., ry=0.)
        s.now.update(a)
        s.a = {k: [] for k in s.now}
        s.ph = []

    def go(s, dur, phase, kind="q", **tg):
        n = max(int(round(dur * s.F)), 4)
        u = np.arange(1, n + 1) / n
        if kind == "q":
            p = 10 * u**3 - 15 * u**4 + 6 * u**5
        else:                                   # steady speed with short smooth ends
            r = min(.25, .12 / dur)
            v = np.clip(np.minimum(u, 1 - u) / r, 0, 1)
            v = v * v * (3 - 2 * v)
            p = np.cumsum(v); p /= p[-1]
        for k in s.now:
            e = tg.get(k, s.now[k])
            s.a[k].append(s.now[k] + (e - s.now[k]) * p)
            s.now[k] = e
        s.ph += [phase] * n
        return s

    def sine(s, dur, phase, **ac):              # k=(amplitude, f0, f1): chirp round the present value
        n = int(dur * s.F); t = np.arange(1, n + 1) / s.F
        w = np.clip(np.minimum(t, dur - t) / .4, 0, 1); w = w * w * (3 - 2 * w)
        for k in s.now:
            if k in ac:
                A, f0, f1 = ac[k]
                s.a[k].append(s.now[k] + w * A * np.sin(2 * np.pi * (f0 * t + (f1 - f0) * t * t / 2 / dur)))
            else:
                s.a[k].append(np.full(n, s.now[k]))
        s.ph += [phase] * n
        return s

    def arrays(s):
        return {k: np.concatenate(v) for k, v in s.a.items()}


def pokes(p, r, deep, speeds, hold, clear=.006, x=None, tilt=0., axis="xy", drag=.011):
    """oblique pokes to depths `deep` at speeds [m/s]: the tip drags a few mm along while it goes in and out, so that friction is settled"""
    for i, (d, v) in enumerate(zip(deep, speeds)):
        tg = {}
        if x is not None: tg = dict(x=x[i][0], y=x[i][1])
        if tilt: tg.update(rx=r.u(-tilt, tilt), ry=r.u(-tilt, tilt))
        p.go(.7, "free", h=clear, **tg)
        T = (clear + d) / v * 1.3
        a = r.pick(0., np.pi) if axis == "x" else r.u(0, 2 * np.pi)
        x0, y0 = p.now["x"], p.now["y"]
        cx, cy = drag * np.cos(a), drag * np.sin(a)
        p.go(T, "poke", h=-d, x=x0 + cx, y=y0 + cy)
        p.go(hold if np.isscalar(hold) else hold[i], "hold")
        p.go(T * r.u(.8, 1.3), "retract", h=clear, x=x0 + 1.8 * cx, y=y0 + 1.8 * cy)
        p.go(.3, "free", x=x0, y=y0)
    return p


def slides(p, r, depth, speeds, L, dirs=("x", "y"), tilt=0.):
    tg = {}
    if tilt: tg = dict(rx=r.u(-tilt, tilt), ry=r.u(-tilt, tilt))
    p.go(.8, "approach", h=.003, **tg)
    p.go(.9, "poke", h=-depth, **({"x": p.now["x"] + .012} if "x" in dirs else {"y": p.now["y"] + .012}))
    p.go(.5, "hold")
    for v in speeds:
        for d in dirs:
            for s in (1, -1, 0) if d != "xy" else (1, -1, 0):
                a = dict(x=s * L, y=0.) if d == "x" else dict(x=0., y=s * L) if d == "y" else dict(x=s * L, y=.6 * s * L)
                dist = np.hypot(a["x"] - p.now["x"], a["y"] - p.now["y"])
                if dist > 1e-6: p.go(dist / v * 1.1 + .1, "slide", "t", **a)
    p.go(.4, "hold")
    p.go(1.0, "retract", h=.008, **({"x": p.now["x"] + .012} if "x" in dirs else {"y": p.now["y"] + .012}))
    p.go(.5, "free", x=0., y=0.)
    return p


# ---------------------------------------------------------------- robots in contact and in the air
def scene(r, arm, prog, opt):
    """surface frame in the base, tool rotation, joint path"""
    if arm.name == "crane3":
        point = np.array([r.u(.46, .50), r.u(-.05, .05), .32]); n = np.array([-1., 0, 0]); t1 = np.array([0., 1, 0])
        Rd0 = np.array([[0., 0, 1], [1, 0, 0], [0, 1, 0]])
    else:
        point = np.array([r.u(.46, .52), r.u(-.06, .06), r.u(.30, .36) if arm.name == "heron6" else r.u(.20, .28)])
        a, b, c = r.u(-.1, .1), r.u(-.1, .1), r.u(-.5, .5)
        S = phys.rpy(a, b, c)
        n, t1 = S[:, 2], S[:, 0]
        Rd0 = np.column_stack([t1, -np.cross(n, t1), -n]) @ phys.rpy(0, 0, r.u(-.3, .3))
    t2 = np.cross(n, t1)
    A = prog.arrays()
    N = len(A["x"])
    Pw = point + np.outer(A["x"], t1) + np.outer(A["y"], t2) + np.outer(A["h"], n)
    Rd = np.empty((N, 3, 3))
    if np.ptp(A["rx"]) + np.ptp(A["ry"]) == 0:
        Rd[:] = Rd0 @ phys.rpy(A["rx"][0], A["ry"][0], 0)
    else:
        for i in range(N):
            Rd[i] = Rd0 @ phys.rpy(A["rx"][i], A["ry"][i], 0)
    off = opt.get("tip_off", np.zeros(3))
    pt = arm.tip_on_link(off)
    q, bad = phys.ik_path(*arm.chain(), pt, arm.Rs, arm.home, Pw, Rd, .3)
    if bad > 2e-5: raise RuntimeError(f"{r.key}: IK off by {bad:.2g} m")
    return point, n, t1, t2, q


def closed_loop(r, arm, body, qk, fk, g, contact, P, pt, sc, wn, joint_fric=None, rotor=None, ki=.3):
    n = arm.n
    tk = np.arange(len(qk)) / fk
    cs = CubicSpline(tk, qk, axis=0)
    t = np.arange(0, tk[-1], DT)
    qd, dqd, ddqd = cs(t), cs(t, 1), cs(t, 2)
    if rotor is None: rotor = {6: np.array([.9, .9, .5, .2, .15, .1]), 7: np.array([.9, .9, .5, .5, .2, .13, .13]), 3: np.array([.5, .3, .1])}[n]
    if joint_fric is None:
        joint_fric = np.zeros((n, 7))
        joint_fric[:, 0] = r.u(.4, 1.5) * {6: np.array([2, 2, 1, .4, .3, .2]), 7: np.array([2, 2, 1.5, 1.2, .8, .4, .4]), 3: np.array([2, 1.2, .5])}[n]
        joint_fric[:, 1] = 2 * joint_fric[:, 0]
        joint_fric[:, 4] = 1.; joint_fric[:, 5] = r.u(2e-4, 1.5e-3)
    M = np.zeros(n)
    for j in range(n):
        M[j] = mass_diag(arm, body, qk[0], j)
    M = M + rotor
    Kp = wn**2 * M; Kd = 2 * r.u(.7, 1.) * wn * M; Ki = ki * wn * Kp
    return phys.simulate(*arm.chain(), *body, rotor, g, pt, qd, dqd, ddqd, DT, Kp, Kd, Ki, joint_fric, contact, P, *sc, KEEP) + (rotor, joint_fric)


def mass_diag(arm, body, q, j):
    n = arm.n
    z = np.zeros; e = z(n); e[j] = 1
    tau = z(n)
    phys.rnea(*arm.chain(), *body, q, z(n), e, z(3), z(3), z(3), tau, z((n, 3, 3)), z((n, 3)), z((n, 3)), z((n, 3)), z((n, 3)), z((n, 3)))
    return tau[j]


def clocks(r, T, fs, note):
    t = np.arange(.05, T - .06, 1 / fs)
    if r.yes(.35):
        t = t + np.clip(r.rng.normal(0, .12 / fs, len(t)), -.4 / fs, .4 / fs); note["jitter"] = .12
    if r.yes(.35):
        keep = r.rng.random(len(t)) > r.u(.005, .03)
        g0 = r.u(.2, .8) * T
        keep &= ~((t > g0) & (t < g0 + r.u(.02, .06)))
        t = t[keep]; note["dropped"] = round(1 - keep.mean(), 3)
    return t


def at(x, t):
    """2 kHz states at times t"""
    tt = np.arange(len(x)) * DT * KEEP
    if x.ndim == 1: return np.interp(t, tt, x)
    return np.column_stack([np.interp(t, tt, x[:, i]) for i in range(x.shape[1])])


def dq_logged(r, dq, t, note, enc):
    """filtered, biased, noisy rates - or none"""
    if r.yes(.35):
        note["dq"] = "none"; return None
    f = r.u(15, 80)
    y = np.column_stack([phys.lowpass(np.ascontiguousarray(dq[:, i]), DT * KEEP, 1 / (2 * np.pi * f)) for i in range(dq.shape[1])])
    lag = r.u(0, .003)
    y = at(y, t - lag)
    y = y + r.rng.normal(0, 3e-4, y.shape[1]) + r.rng.normal(0, r.u(2e-4, 2e-3), y.shape)
    note["dq"] = f"low-passed {f:.0f} Hz, late {lag*1e3:.1f} ms, biased"
    return y


def wrench_log(r, W, t, sens, T, note, mild=1.0):
    """W: true wrench at 2 kHz (n,6). returns logged and ideal (hidden effects only) at times t"""
    hs = DT * KEEP
    M = sens.get("M", np.eye(6))
    X = W @ M.T
    if sens.get("lag"):
        X = np.column_stack([phys.lowpass(np.ascontiguousarray(X[:, i]), hs, sens["lag"]) for i in range(6)])
    d = sens.get("delay", 0.)
    extra = lambda tt: sens.get("bias", np.zeros(6)) + np.outer(tt / 60, sens.get("drift", np.zeros(6))) + \
        (np.outer(np.sin(2 * np.pi * 50.0 * tt + 1.), sens["hum"]) if "hum" in sens else 0)
    ideal = at(X, t - d) + extra(t)
    Y = X
    if r.yes(.5):
        f = r.u(70, 200) / mild; note["wrench_filter_hz"] = round(f)
        Y = np.column_stack([phys.lowpass(np.ascontiguousarray(X[:, i]), hs, 1 / (2 * np.pi * f)) for i in range(6)])
    ck = r.u(-.0015, .0015) * mild if r.yes(.5) else 0.
    if ck: note["clock_ms"] = round(ck * 1e3, 2)
    te = t - d - ck
    if r.yes(.3):
        fz = r.pick(250., 400., 500.); te = np.floor(te * fz) / fz + .5 / fz; note["wrench_held_hz"] = fz
    y = at(Y, te) + extra(t)
    rms = np.sqrt(np.mean(ideal[:, :3]**2)); rt = np.sqrt(np.mean(ideal[:, 3:]**2))
    if r.yes(.5):
        b = np.r_[r.rng.normal(0, .003 * rms, 3), r.rng.normal(0, .003 * rt, 3)] * mild; y = y + b; note["bias"] = "<=0.5%"
    if r.yes(.4):
        y = y + np.outer((t - t[0]) / t[-1], np.r_[r.rng.normal(0, .004 * rms, 3), r.rng.normal(0, .004 * rt, 3)]) * mild; note["temperature_drift"] = "<=0.6%"
    if r.yes(.4):
        fm = np.abs(y).max(0) + 1e-9
        y = y * (1 + r.rng.uniform(-.01, .01, 6) * (np.abs(y) / fm)) ; note["nonlinear"] = "1%"
    nf = max(.012, rms * r.u(.005, .010)) * sens.get("quiet", 1.); nt = max(4e-4, rt * r.u(.004, .009)) * sens.get("quiet", 1.)
    noise = np.r_[nf * r.u(.7, 1.2, 2), nf * r.u(1, 1.8), nt * r.u(.6, 1.3, 3)]
    y = y + r.rng.normal(0, 1, y.shape) * noise
    if "clip" in sens:
        y = np.clip(y, -sens["clip"], sens["clip"]); ideal = np.clip(ideal, -sens["clip"], sens["clip"])
    return y, ideal, noise


def rig_text(r, arm, surf, tool_stated, noise, g_true, note, stated, rng_sensor=None, joints=True):
    s = [f"# rig of world moraine, {r.key}", "[robot]", 'model = "arm.urdf"', 'sensor_frame = "ft_sensor"', 'tip_frame = "tool_tip"']
    if stated or abs(g_true[2] + 9.81) > .2:
        s += ["gravity = " + arr(g_true)]
        note["gravity"] = "stated"
    if r.yes(.4): s += ["joints = [" + ", ".join(f'"joint_{i+1}"' for i in range(arm.n)) + "]"]
    if tool_stated is not None:
        s += ["", "[tool]", f"mass = {tool_stated[0]:.4f}", "com = " + arr(tool_stated[1])]
        if tool_stated[2] is not None:
            I = tool_stated[2]; s += ["inertia = " + arr([I[0, 0], I[1, 1], I[2, 2], I[0, 1], I[0, 2], I[1, 2]])]
    if surf is not None:
        s += ["", "[surface]", "point = " + arr(surf[0]), "normal = " + "[" + ", ".join("%.9g" % x for x in surf[1]) + "]", "tangent = " + "[" + ", ".join("%.9g" % x for x in surf[2]) + "]"]
    if noise is not None and stated:
        s += ["", "[sensor]", "noise = " + arr(noise)]
        if rng_sensor: s += ["range = " + arr(rng_sensor)]
    if stated:
        s += ["# from the logger's sheet: " + json.dumps({k: v for k, v in note.items() if k in ("wrench_filter_hz", "clock_ms", "torque_filter_hz", "dq", "encoder", "bias")})]
    return "\n".join(s) + "\n"


def tilt_g(r, note, big=.012):
    a, b = r.rng.normal(0, big / 2, 2)
    note["base_tilt_deg"] = round(np.degrees(np.hypot(a, b)), 2)
    return phys.rpy(a, b, 0) @ np.array([0, 0, -9.81])


def robot_wrench(out, r, arm, prog, P, opt):
    """a log of a robot with a wrench, in contact (prog: Prog) or free (prog: (joint path, fs))"""
    note = r.note
    contact = P is not None
    stated = r.yes(.5)
    note["stated"] = stated
    tm = opt.get("tool", (r.u(.18, .5), np.r_[r.rng.normal(0, .004, 2), r.u(.03, .06)], None))
    mt, ct, It = tm
    It = np.diag([1e-6] * 3) if It is None else It
    off = opt.get("mass_off", r.u(-.02, .02) if contact else r.u(-.006, .006))
    st = opt.get("tool_stated", (mt * (1 + off), ct, None))
    note["tool_off"] = f"{off*100:.1f}%" if "tool_stated" not in opt else "see truth"
    g = tilt_g(r, note)
    body = arm.body((mt, ct, It))
    toff = np.asarray(opt.get("tip_off", np.zeros(3)))
    pt = arm.tip_on_link(toff)
    wn = opt.get("wn", r.pick(25., 45., 75.)); note["controller_rad_s"] = wn
    if contact:
        point, n, t1, t2, qk = scene(r, arm, prog, opt)
        sc = (point, n, t1, t2); fk = Prog.F
    else:
        qk, fk = prog
        sc = (np.zeros(3),) * 4; n = t1 = t2 = np.zeros(3)
    oq, od, oa, ot, of, rot, jf = closed_loop(r, arm, body, qk, fk, g, contact, P if contact else law(), pt, sc, wn)
    note["joint_friction_Nm"] = round(float(jf[0, 0]), 2)
    Rw, ps, w, al, gm = phys.frames(*arm.chain(), oq, od, oa, g, arm.Rs, arm.sensor_xyz, ct)
    fw = of[:, :1] * n + of[:, 1:2] * t1 + of[:, 2:3] * t2
    if "cable" in opt:                           # a cable that tugs at the tool's end
        p0, l0, kc = opt["cable"]
        tip = ps + np.einsum("tij,j->ti", Rw, arm.tip)
        v = p0 - tip; l = np.linalg.norm(v, axis=1)
        fw = fw + v / l[:, None] * (kc * np.maximum(l - l0, 0))[:, None]
    fc = np.einsum("tji,tj->ti", Rw, fw)
    ft = mt * gm
    rt = arm.tip + toff
    Ia = al @ It.T + np.cross(w, w @ It.T)
    W = np.column_stack([fc + ft, np.cross(ct, ft) - Ia + np.cross(rt, fc)])
    T = len(oq) * DT * KEEP
    fs = opt.get("fs", r.pick(125, 200, 250, 400)); note["rate"] = fs
    t = clocks(r, T, fs, note)
    y, ideal, noise = wrench_log(r, W, t, opt.get("sens", {}), T, note, opt.get("mild", 1.))
    enc = opt.get("enc", r.pick(2e-6, 2e-6, 4e-6, 8e-6) if contact else r.pick(1e-5, 5e-5)); note["encoder"] = enc
    q = np.round(at(oq, t) / enc) * enc
    cols = {"t": t}
    for i in range(arm.n): cols[f"q{i+1}"] = q[:, i]
    dq = dq_logged(r, od, t, note, enc)
    if opt.get("no_dq"): dq = None; note["dq"] = "none"
    if dq is not None:
        for i in range(arm.n): cols[f"dq{i+1}"] = dq[:, i]
    for i, k in enumerate(["fx", "fy", "fz", "tx", "ty", "tz"]): cols[k] = y[:, i]
    if contact and r.yes(.5):
        ph = np.array(prog.ph)[np.clip((t * Prog.F).astype(int), 0, len(prog.ph) - 1)]
        cols["phase"] = ph.tolist(); note["phase"] = True
    open(f"{out}/arm.urdf", "w").write(arm.urdf())
    open(f"{out}/rig.toml", "w").write(rig_text(r, arm, (point, n, t1) if contact else None, st, noise, g, note, stated, opt.get("range")))
    write(f"{out}/log.{r.fmt}", cols, fmtof)
    e = y - ideal
    return dict(error_true_model=float(np.sqrt(np.mean(e[:, :3]**2))), error_true_model_torque=float(np.sqrt(np.mean(e[:, 3:]**2))), arm=arm.name)


# ---------------------------------------------------------------- presses
def press_path(r, seq, gap=.0015, fs=4000, rest=.5):
    """seq of (depth, speed, hold, speed back, depth after, rest); returns depth of the stage"""
    p = [np.full(int(.8 * fs), -gap)]
    now = -gap
    for d, v, hold, vb, after, rs in seq:
        for tgt, sp, w in ((d, v, hold), (after, vb, rs)):
            T = max(abs(tgt - now) / sp * 1.15, .02)
            n = int(T * fs); u = np.arange(1, n + 1) / n
            ra = min(.25, .05 / T) if T > .2 else .25
            ve = np.clip(np.minimum(u, 1 - u) / ra, 0, 1); ve = ve * ve * (3 - 2 * ve)
            c = np.cumsum(ve); c /= c[-1]
            p.append(now + (tgt - now) * c); now = tgt
            if w > 0: p.append(np.full(int(w * fs), now))
    p.append(np.full(int(rest * fs), now))
    return np.concatenate(p)


def stage(r, d, fs=4000):
    """the servo of the stage: second order, with a screw's ripple"""
    w = 2 * np.pi * r.u(12, 30); z = r.u(.75, 1.)
    y = d.copy(); v = np.zeros_like(d)
    x, vv = d[0], 0.
    h = 1 / fs
    x, v = _servo(d, w, z, h)
    rip = r.u(1e-6, 4e-6) * np.sin(x / 5e-4 * 2 * np.pi)
    x = x + rip
    return x, np.gradient(x, h)


from numba import njit


@njit(cache=True)
def _servo(d, w, z, h):
    x = d[0]; v = 0.
    o = np.empty_like(d); ov = np.empty_like(d)
    for i in range(len(d)):
        a = w * w * (d[i] - x) - 2 * z * w * v
        v += h * a; x += h * v
        o[i] = x; ov[i] = v
    return o, ov


def press(out, r, P, seq, opt, force=None):
    note = r.note; fs0 = 4000
    d0 = press_path(r, seq) if not isinstance(seq, np.ndarray) else seq
    d, dd = stage(r, d0)
    t0 = np.arange(len(d)) / fs0
    z = np.zeros_like(d)
    F = phys.drive_law(P, t0, d, dd, z, z, z, z)[:, 0] if force is None else force(t0, d, dd)
    G = F.copy()
    T = t0[-1]
    fs = opt.get("fs", r.pick(100, 200, 400)); note["rate"] = fs
    t = clocks(r, T, fs, note)
    ideal = np.interp(t, t0, F)
    hum = opt.get("hum", 0.) * np.sin(2 * np.pi * 50.0 * t + .4) + opt.get("hum", 0.) * .25 * np.sin(2 * np.pi * 150.0 * t)
    pump = 0.
    if "pump" in opt:
        A, f = opt["pump"]; pump = A * (1 + .5 * np.sin(2 * np.pi * .21 * t)) * np.sin(2 * np.pi * f * t + 2.5 * np.sin(2 * np.pi * .07 * t))
    if r.yes(.5):
        f = r.u(60, 200) / opt.get("mild", 1.); G = phys.lowpass(G, 1 / fs0, 1 / (2 * np.pi * f)); note["force_filter_hz"] = round(f)
    ck = r.u(-.0015, .0015) * opt.get("mild", 1.) if r.yes(.5) else 0.
    if ck: note["clock_ms"] = round(ck * 1e3, 2)
    rms = np.sqrt(np.mean(ideal**2))
    y = np.interp(t - ck, t0, G) + hum + pump
    if r.yes(.5): y = y + r.rng.normal(0, .003) * rms; note["bias"] = "<=0.5%"
    if r.yes(.4): y = y + r.rng.normal(0, .004) * rms * t / T; note["temperature_drift"] = "<=0.6%"
    if r.yes(.4): y = y * (1 + r.u(-.01, .01) * np.abs(y) / np.abs(y).max()); note["nonlinear"] = "1%"
    nf = opt.get("nf", rms * r.u(.006, .011))
    y = y + r.rng.normal(0, nf, len(y))
    dl = np.interp(t, t0, d) + r.rng.normal(0, r.pick(2e-7, 6e-7), len(t))
    st = r.pick(1e-7, 5e-7, 1e-6); dl = np.round(dl / st) * st; note["encoder"] = st
    cols = {"t": t, "depth": dl}
    if opt.get("rate_col", r.yes(.5)):
        f = r.u(20, 80)
        cols["depth_rate"] = np.interp(t, t0, phys.lowpass(dd, 1 / fs0, 1 / (2 * np.pi * f))) + r.rng.normal(0, 2e-5, len(t)) + r.u(-1, 1) * 2e-5
        note["depth_rate"] = f"low-passed {f:.0f} Hz, biased"
    cols["normal_force"] = y
    stated = r.yes(.5); note["stated"] = stated
    s = f"# material tester, world moraine, {r.key}\n"
    if stated: s += "[sensor]\nnoise = " + arr([nf, nf, nf, .001, .001, .001]) + "\n# " + json.dumps(note) + "\n"
    open(f"{out}/rig.toml", "w").write(s)
    write(f"{out}/log.{r.fmt}", cols, fmtof)
    tr = ideal + (hum if "hum" in opt else 0)
    e = y - tr - pump
    return dict(error_true_model=float(np.sqrt(np.mean(e**2))))


def tribo(out, r, P, loads, opt):
    """a sled dragged over the specimen: loads = list of (depth, [(speed, stroke), ...])"""
    note = r.note; fs = 5000
    D = [np.full(int(.5 * fs), -.001)]; X = [np.zeros(int(.5 * fs))]
    d, x = -.001, 0.

    def ramp(a, b, T):
        n = int(T * fs); u = np.arange(1, n + 1) / n
        return a + (b - a) * (10 * u**3 - 15 * u**4 + 6 * u**5)

    for depth, sl in loads:
        q = ramp(d, depth, .8); D.append(q); X.append(np.full(len(q), x)); d = depth
        D.append(np.full(int(.3 * fs), d)); X.append(np.full(int(.3 * fs), x))
        for v, L in sl:
            for s in (1, -1):
                T = L / v * 1.05 + .1
                n = int(T * fs); u = np.arange(1, n + 1) / n
                ra = min(.25, .06 / T); ve = np.clip(np.minimum(u, 1 - u) / ra, 0, 1); ve = ve * ve * (3 - 2 * ve)
                c = np.cumsum(ve); c /= c[-1]
                X.append(x + s * L * c); D.append(np.full(n, d)); x = x + s * L
    q = ramp(d, -.001, .8); D.append(q); X.append(np.full(len(q), x))
    D = np.concatenate(D); X = np.concatenate(X)
    dd = np.gradient(D, 1 / fs); vx = np.gradient(X, 1 / fs)
    sub = 4                                       # the bristle is stiff: 20 kHz
    t4 = np.arange(len(D) * sub) / (fs * sub)
    up = lambda z: np.interp(t4, np.arange(len(D)) / fs, z)
    mass = r.u(.3, .8); ks = opt.get("ks", r.u(8e3, 3e4)); note["drag_spring"] = round(ks)
    o = phys.sim_sled(P, t4, 1 / (fs * sub), up(D), up(dd), up(X), up(vx), mass, ks, 2 * opt.get("zeta", .4) * np.sqrt(ks * mass), 10)
    t0 = np.arange(len(o)) / 2000.
    T = t0[-1]
    fl = opt.get("fs", r.pick(200, 400, 500)); note["rate"] = fl
    t = clocks(r, T, fl, note)
    g = lambda z: np.interp(t, t0, z)
    N, Tt = g(o[:, 4]), g(o[:, 5])
    rms = np.sqrt(np.mean(np.r_[N, Tt]**2))
    ck = r.u(-.001, .001) if r.yes(.5) else 0.
    if ck: note["clock_ms"] = round(ck * 1e3, 2)
    nf = rms * r.u(.005, .009)
    yN = np.interp(t - ck, t0, o[:, 4]); yT = np.interp(t - ck, t0, o[:, 5])
    if r.yes(.5): yN = yN + r.rng.normal(0, .003) * rms; yT = yT + r.rng.normal(0, .002) * rms; note["bias"] = "<=0.5%"
    yN = yN + r.rng.normal(0, nf, len(t)); yT = yT + r.rng.normal(0, nf, len(t))
    cols = {"t": t, "depth": np.round(g(o[:, 0]) / 2e-7) * 2e-7, "slip1": np.round(g(o[:, 2]) / 1e-6) * 1e-6}
    if r.yes(.6):
        f = r.u(40, 100); cols["slip_rate1"] = g(phys.lowpass(np.ascontiguousarray(o[:, 3]), 1 / 2000., 1 / (2 * np.pi * f))) + r.rng.normal(0, 1e-4, len(t))
        cols["depth_rate"] = g(phys.lowpass(np.ascontiguousarray(o[:, 1]), 1 / 2000., 1 / (2 * np.pi * f)))
        note["slip_rate"] = f"low-passed {f:.0f} Hz"
    cols["normal_force"] = yN; cols["tangential_force1"] = yT
    stated = r.yes(.5); note["stated"] = stated
    s = f"# sled on a specimen, world moraine, {r.key}\n"
    if stated: s += "[sensor]\nnoise = " + arr([nf, nf, nf, .001, .001, .001]) + "\n"
    open(f"{out}/rig.toml", "w").write(s)
    write(f"{out}/log.{r.fmt}", cols, fmtof)
    return dict(error_true_model=float(np.sqrt(np.mean(np.r_[yN - N, yT - Tt]**2))))


# ---------------------------------------------------------------- joint torques
def fourier(r, n, T, f0, nh, amp, centre, fs=500):
    t = np.arange(0, T, 1 / fs)
    q = np.zeros((len(t), n))
    w = np.clip(np.minimum(t, T - t) / 1.5, 0, 1); w = w**3 * (10 - 15 * w + 6 * w * w)
    for j in range(n):
        x = np.zeros(len(t))
        for k in range(1, nh + 1):
            x += r.rng.normal() * np.sin(2 * np.pi * f0 * k * t + r.u(0, 6.28)) / k**.6
        q[:, j] = centre[j] + amp[j] * w * x / np.abs(x).max()
    return q, fs


def arm_torque(out, r, arm, path, opt):
    note = r.note
    stated = r.yes(.5); note["stated"] = stated
    g = tilt_g(r, note, .012 if stated else .003)
    body = arm.body()
    if "payload" in opt:
        body = arm.body((opt["payload"][0], opt["payload"][1], np.diag([2e-3] * 3)))
    rot_hidden = opt.get("rotor")
    rotor = rot_hidden if rot_hidden is not None else None
    qk, fk = path
    oq, od, oa, ot, of, rot, jf = closed_loop(r, arm, body, qk, fk, g, False, law(), arm.tip_on_link(), (np.zeros(3),) * 4, opt.get("wn", r.pick(35., 60.)), opt["fric"], rotor)
    if rot_hidden is None: ot = ot - oa * rot            # torque sensors behind the gears
    T = len(oq) * DT * KEEP
    fs = opt.get("fs", r.pick(100, 200, 250, 500)); note["rate"] = fs
    t = clocks(r, T, fs, note)
    ff = opt.get("tau_filter", r.u(30, 50)); note["torque_filter_hz"] = round(ff)
    Y = np.column_stack([phys.lowpass(np.ascontiguousarray(ot[:, i]), DT * KEEP, 1 / (2 * np.pi * ff)) for i in range(arm.n)])
    ck = r.u(-.002, .002) if r.yes(.5) else 0.
    if ck: note["clock_ms"] = round(ck * 1e3, 2)
    te = t - ck
    if r.yes(.4): fz = r.pick(200., 250., 333.); te = np.floor(te * fz) / fz; note["torque_held_hz"] = fz
    y = at(Y, te)
    ideal = at(ot, t)
    rms = np.sqrt(np.mean(ideal**2, axis=0))
    sd = opt.get("ntau", .006) * np.maximum(rms, .1 * rms.max()) * r.u(.6, 1.4, arm.n)
    y = y + r.rng.normal(0, 1, y.shape) * sd
    enc = opt.get("enc", r.pick(2e-6, 2e-5, 5e-5)); note["encoder"] = enc
    q = np.round(at(oq, t) / enc) * enc
    cols = {"t": t}
    for i in range(arm.n): cols[f"q{i+1}"] = q[:, i]
    dq = dq_logged(r, od, t, note, enc)
    if dq is not None:
        for i in range(arm.n): cols[f"dq{i+1}"] = dq[:, i]
    for i in range(arm.n): cols[f"tau{i+1}"] = y[:, i]
    open(f"{out}/arm.urdf", "w").write(arm.urdf())
    open(f"{out}/rig.toml", "w").write(rig_text(r, arm, None, None, None, g, note, stated))
    write(f"{out}/log.{r.fmt}", cols, fmtof)
    return dict(error_true_model=float(np.sqrt(np.mean((y - ideal)**2))), arm=arm.name)


def drive(out, r, segs, p, opt):
    """segs: list of (kind, ...): ("v", speed, time), ("s", amplitude, f, time)"""
    note = r.note; fs = 8000; h = 1 / fs
    v = []
    now = 0.
    for s in segs:
        if s[0] == "v":
            n = int(.25 * fs); u = np.arange(1, n + 1) / n; u = u * u * (3 - 2 * u)
            v.append(now + (s[1] - now) * u); v.append(np.full(int(s[2] * fs), s[1])); now = s[1]
        else:
            n = int(s[3] * fs); u = np.arange(1, n + 1) / fs; w = np.clip(np.minimum(u, s[3] - u) / .3, 0, 1)
            if now: v.append(np.linspace(now, 0, int(.2 * fs))); now = 0.
            v.append(w * s[1] * np.sin(2 * np.pi * s[2] * u)); now = 0.
    v = np.concatenate(v); v = phys.lowpass(v, h, .02)
    q = np.cumsum(v) * h; a = np.gradient(v, h)
    wn = r.pick(30., 60.); I = p["I"]
    o = phys.sim_drive(q, v, a, h, I, I * .9, p["fc"], p["fv"], p.get("fst", 0.), p.get("vst", 1.), p.get("L", 2e-4), p.get("rA", 0.), p.get("rk", 1.), p.get("rph", 0.),
                       p.get("warm", 0.), p.get("tw", 60.), p.get("spring", 0.), wn * wn * I, 1.6 * wn * I, 4)
    T = len(o) / 2000.
    lf = opt.get("fs", r.pick(100, 200, 500)); note["rate"] = lf
    t = clocks(r, T, lf, note)
    ff = opt.get("tau_filter", r.u(25, 50)); note["torque_filter_hz"] = round(ff)
    Y = phys.lowpass(np.ascontiguousarray(o[:, 3]), 1 / 2000., 1 / (2 * np.pi * ff))
    te = t
    if r.yes(.4): fz = r.pick(200., 250.); te = np.floor(t * fz) / fz; note["torque_held_hz"] = fz
    y = np.interp(te, np.arange(len(Y)) / 2000., Y)
    ideal = np.interp(t, np.arange(len(Y)) / 2000., o[:, 3])
    y = y + r.rng.normal(0, .006 * np.sqrt(np.mean(ideal**2)), len(y))
    enc = opt.get("enc", r.pick(2e-5, 1e-4)); note["encoder"] = enc
    qq = np.interp(t, np.arange(len(Y)) / 2000., o[:, 0])
    cols = {"t": t, "q1": np.round(qq / enc) * enc}
    if opt.get("dq", True):
        d = dq_logged(r, o[:, 1:2], t, note, enc)
        if d is not None: cols["dq1"] = d[:, 0]
    else:
        note["dq"] = "none"
    cols["tau1"] = y
    open(f"{out}/rig.toml", "w").write(f"# single drive on a vertical shaft, world moraine, {r.key}\n")
    write(f"{out}/log.{r.fmt}", cols, fmtof)
    return dict(error_true_model=float(np.sqrt(np.mean((y - ideal)**2))))


# ---------------------------------------------------------------- the 48 rows
ROWS = []


def row(key, kind, base, truth, near=(), cls=()):
    def f(fn):
        ROWS.append((key, kind, base.split(), truth.split(), list(near), list(cls), fn)); return fn
    return f


def frac(r, k, alpha=.22, tot=.8):
    """seven Maxwell branches, half a decade apart, weighted as a springpot"""
    tau = np.geomspace(.03, 30, 7)
    w = tau**-alpha; w *= tot / w.sum()
    return {**{f"b{i+1}": w[i] for i in range(7)}, **{f"t{i+1}": tau[i] for i in range(7)}}


def seq(r, depths, speeds, hold, after=-.0015, rest=.6):
    return [(d, v, h, v * r.u(.7, 1.4), after, rest) for d, v, h in zip(depths, speeds, hold)]


# ---- presses
@row("press-relaxation", "one", "kelvin-voigt", "relaxation")
def _(o, r):
    k = r.u(1500, 4000)
    P = law(k=k, c=r.u(5, 15), **frac(r, k, tot=.6))
    s = seq(r, [.003, .005, .004, .006, .005, .003], [.03, .003, .001, .02, .006, .06], [6, 3, 1, 12, .2, 4], rest=2.)
    return press(o, r, P, s, {}), {}


@row("press-softening", "one", "hertz", "stress-softening")
def _(o, r):
    P = law(k=r.u(2e4, 6e4), n=1.5, soft_r=r.u(.13, .18), soft_l=r.u(.8e-3, 1.5e-3), b1=0)
    s = seq(r, [.002, .002, .002, .004, .004, .003, .004, .006, .006, .005, .006], [.004] * 11, [.3] * 11)
    return press(o, r, P, s, {}), {}


@row("press-adhesion", "one", "kelvin-voigt", "adhesion")
def _(o, r):
    Fa = r.u(.28, .36)
    P = law(k=r.u(800, 1500), c=r.u(5, 15), adh=Fa, adh_l=r.u(6e-4, 1.2e-3))
    s = seq(r, [.002, .005, .003, .006, .0025, .005, .004, .003], [.002, .004, .002, .008, .001, .002, .003, .0015], [.5] * 8, after=-.002)
    return press(o, r, P, s, {}), {"adhesion.F_a": Fa}


@row("press-hysteresis", "one", "hooke", "hysteresis")
def _(o, r):
    A = r.u(.45, .65)
    P = law(k=r.u(1500, 3000), hyA=A, hyL=r.u(4e-4, 8e-4))
    s = []
    for d, v in [(.004, .001), (.006, .01), (.005, .03), (.006, .003), (.004, .05), (.006, .002)]:
        s += [(d, v, 1.5, v, .002, .3), (d, v, .4, v, .0025, .3), (d * .9, v, .4, v, -.0015, .5)]
    return press(o, r, P, s, {}), {"hysteresis.amplitude": A}


@row("press-hc-damping", "one", "hertz", "hunt-crossley-damping")
def _(o, r):
    lam = r.u(3.2, 4.)
    P = law(k=r.u(2e4, 6e4), n=1.5, lam=lam)
    s = seq(r, [.003, .006, .004, .006, .002, .005, .006, .003], [.04, .02, .06, .005, .03, .05, .06, .01], [.2] * 8, rest=.2)
    return press(o, r, P, s, {"fs": 400, "mild": .25}), {"hunt-crossley-damping.lambda": lam}


@row("press-exponent", "one", "kelvin-voigt", "hertz-exponent")
def _(o, r):
    n = r.u(1.17, 1.22)
    P = law(k=r.u(4e3, 8e3), n=n, c=r.u(5, 12))
    s = seq(r, [.002, .005, .007, .004, .008, .003], [.02, .01, .004, .03, .01, .04], [.5] * 6)
    return press(o, r, P, s, {}), {"hertz-exponent.n": n}


@row("press-relaxation+hum", "pair", "kelvin-voigt", "relaxation mains-hum")
def _(o, r):
    k = r.u(1500, 3000); tau = r.u(.6, 1.5); hum = r.u(.3, .38)
    P = law(k=k, c=r.u(5, 12), b1=r.u(.13, .17), t1=tau)
    s = seq(r, [.003, .005, .004, .006, .003], [.03, .004, .02, .05, .01], [4, 2, 3, 4, 3], rest=1.5)
    return press(o, r, P, s, {"hum": hum, "fs": 1000}), {"relaxation.tau": tau, "mains-hum.frequency": 50.0}


@row("press-zener", "none", "zener", "")
def _(o, r):
    k = r.u(1500, 3000)
    P = law(k=k, b1=r.u(.3, .5), t1=r.u(.5, 1.5), b2=.012, t2=8., n=1.005)
    s = seq(r, [.003, .005, .004, .006, .003], [.03, .004, .02, .05, .01], [4, 2, 3, 4, 3], rest=1.5)
    return press(o, r, P, s, {}), {}


@row("press-hunt-crossley", "none", "hunt-crossley", "")
def _(o, r):
    P = law(k=r.u(1e4, 3e4), n=r.u(1.35, 1.5), lam=r.u(1.5, 3), b1=0)
    s = seq(r, [.003, .006, .004, .006, .002, .005], [.04, .02, .06, .005, .03, .05], [.4] * 6)
    return press(o, r, P, s, {}), {}


@row("press-lattice-rings", "outside", "hooke", "")
def _(o, r):
    f = r.u(3.0, 4.0)
    m = .05; ks = 4000.; kg = 400.
    # the lightly damped chain answers in its own time: no relaxation can ring
    d = press_path(r, [(.005, .05, 5., .05, .003, 5.), (.006, .05, 5., .05, .003, 5.), (.0055, .05, 5., .06, .002, 5.), (.005, .03, 4., .05, -.0015, 1.)])
    M = law(k=1)

    def force(t, dd0, dd):
        return phys.lattice(t, t[1] - t[0], dd0, 5, r.u(.75, 1.1) * m * 60, ks, kg, r.u(1.2, 2.), 1)
    return press(o, r, M, d, {"fs": 200}, force), {}


@row("press-pump", "outside", "kelvin-voigt", "")
def _(o, r):
    P = law(k=r.u(1500, 3000), c=r.u(5, 15))
    s = seq(r, [.003, .005, .004, .006, .003], [.03, .004, .02, .05, .01], [3] * 5, rest=1.5)
    return press(o, r, P, s, {"pump": (r.u(1., 1.6), r.u(6.5, 8.5))}), {}


@row("press-slow-damper", "not-excited", "hooke", "viscous-damping")
def _(o, r):
    c = r.u(10, 20)
    P = law(k=r.u(1500, 3000), c=c)
    s = seq(r, [.002, .003, .004], [.0004] * 3, [8, 8, 8], rest=3, after=.0005)
    return press(o, r, P, s, {"fs": 50, "rate_col": False}), {}


# ---- sleds
SP = [(.003, .012), (.008, .03), (.02, .05), (.06, .08), (.12, .1)]


@row("sled-stribeck", "one", "hooke coulomb-friction", "stribeck-friction")
def _(o, r):
    dm, vs = r.u(.12, .16), r.u(.015, .022)
    P = law(k=r.u(2000, 4000), mu=r.u(.3, .4), dmu=dm, vs=vs, L=1e-4)
    return tribo(o, r, P, [(.002, SP), (.0045, SP)], {"ks": 3e4, "zeta": 1.5}), {"stribeck-friction.dmu": dm, "stribeck-friction.v_s": vs}


@row("sled-load", "one", "hooke coulomb-friction", "load-dependent-friction")
def _(o, r):
    p = -r.u(.16, .2)
    P = law(k=r.u(3000, 5000), mu=r.u(.5, .7), p=p, N0=10., L=1e-4)
    m = [(.01, .03), (.04, .05)]
    return tribo(o, r, P, [(.0007, m), (.0015, m), (.003, m), (.006, m), (.002, m)], {}), {"load-dependent-friction.p": p}


@row("sled-none", "none", "hooke coulomb-friction", "")
def _(o, r):
    P = law(k=r.u(2000, 4000), n=1.004, mu=r.u(.4, .6), L=9e-5)
    m = [(.004, .015), (.02, .04), (.06, .06)]
    return tribo(o, r, P, [(.0015, m), (.003, m), (.0045, m)], {}), {}


@row("sled-wear", "outside", "hooke coulomb-friction", "")
def _(o, r):
    P = law(k=r.u(2000, 4000), mu=r.u(.22, .28), wear=r.u(.35, .5), wear_l=r.u(.35, .5), L=1e-4)
    m = [(.02, .05), (.05, .08)]
    return tribo(o, r, P, [(.003, m), (.0015, m), (.0045, m), (.003, m), (.002, m), (.0045, m)], {}), {}


# ---- robots in contact
def kv(r, lo=1200, hi=2500, c=(6, 14), mu=(.35, .55), **k):
    a = dict(k=r.u(lo, hi), c=r.u(*c), mu=r.u(*mu), L=r.u(9e-5, 1.1e-4)); a.update(k)
    return law(**a)


def mixed(r, d=(.004, .007), v=(.01, .03, .06), np_=4, L=.03, dirs=("x", "y"), tilt=0.):
    p = Prog()
    p.go(.8, "free")
    pokes(p, r, r.u(d[0] * .6, d[1], np_), [v[i % len(v)] for i in range(np_)], .6, tilt=tilt, axis="x" if dirs == ("x",) else "xy")
    slides(p, r, d[0], v, L, dirs, tilt)
    slides(p, r, d[1], v, L, dirs, tilt)
    p.go(.6, "rest")
    return p


@row("arm-viscous-friction", "one", "kelvin-voigt coulomb-friction", "viscous-friction")
def _(o, r):
    c = r.u(16, 21)
    return robot_wrench(o, r, phys.loon7(), mixed(r, v=(.008, .03, .08)), kv(r, cv=c), {"mild": .7}), {"viscous-friction.c": c}


@row("arm-anisotropy", "one", "kelvin-voigt coulomb-friction", "friction-anisotropy")
def _(o, r):
    a = r.u(.09, .12)
    return robot_wrench(o, r, phys.heron6(), mixed(r), kv(r, an=a), {}), {"friction-anisotropy.a": a}


@row("arm-inclusion", "one", "kelvin-voigt coulomb-friction", "stiffness-inhomogeneity")
def _(o, r):
    p = Prog(); p.go(.8, "free")
    xs = [(-.03, 0), (-.015, 0), (0, 0), (.015, 0), (.03, 0), (.005, 0)]
    pokes(p, r, [.005] * 6, [.03, .01, .03, .05, .02, .01], .4, x=xs, axis="x", drag=.008)
    for d in (.004, .006):
        p.go(.8, "free", x=-.047, y=0., h=.004)
        p.go(.8, "poke", h=-d, x=-.035)
        for v in (.015, .04):
            for s in (1, -1): p.go(.07 / v * 1.1, "slide", "t", x=s * .035)
        p.go(1., "retract", h=.008, x=-.047)
    P = kv(r, inh_a=r.u(.13, .17), inh_x=r.u(-.008, .008), inh_w=r.u(.009, .013))
    return robot_wrench(o, r, phys.heron6(), p, P, {}), {}


@row("arm-compliance", "one", "hertz coulomb-friction", "structural-compliance", near=["hertz-exponent"])
def _(o, r):
    C = r.u(5e-5, 7e-5)
    P = law(k=r.u(7e4, 9e4), n=1.5, mu=r.u(.3, .45), C=C, L=1e-4)
    p = Prog(); p.go(.8, "free")
    pokes(p, r, [.001, .002, .004, .0065, .008, .006, .0075], [.01, .02, .02, .03, .03, .04, .02], .5)
    slides(p, r, .003, (.02, .05), .025); slides(p, r, .007, (.02,), .025)
    return robot_wrench(o, r, phys.heron6(), p, P, {"wn": 75., "enc": 2e-6}), {"structural-compliance.C": C}


@row("arm-tip-offset", "one", "kelvin-voigt coulomb-friction", "tip-offset")
def _(o, r):
    off = np.array([r.pick(-1, 1) * r.u(.002, .003), r.pick(-1, 1) * r.u(.002, .003), 0.])
    return robot_wrench(o, r, phys.loon7(), mixed(r, np_=8, tilt=.2), kv(r), {"tip_off": off}), {"tip-offset.x": off[0], "tip-offset.y": off[1]}


@row("arm-crosstalk", "one", "kelvin-voigt coulomb-friction", "sensor-crosstalk")
def _(o, r):
    M = np.eye(6); M[0, 2] = r.u(.05, .07); M[1, 2] = -r.u(.05, .07); M[2, 0] = r.u(.06, .09); M[0, 1] = r.u(.05, .07)
    return robot_wrench(o, r, phys.heron6(), mixed(r, np_=6), kv(r), {"sens": {"M": M}, "mild": .5}), {}


@row("arm-saturation", "one", "kelvin-voigt coulomb-friction", "saturation")
def _(o, r):
    lim = r.u(11.4, 11.8)
    P = kv(r, 2200, 2500)
    clip = np.array([1e3, 1e3, lim, 1e3, 1e3, 1e3])
    return robot_wrench(o, r, phys.heron6(), mixed(r, d=(.0035, .0075), np_=6), P, {"sens": {"clip": clip}, "mass_off": .005, "tool": (.2, np.array([0, 0, .04]), None)}), {"saturation.limit": lim}


@row("arm-time-offset", "one", "kelvin-voigt coulomb-friction", "time-offset")
def _(o, r):
    d = r.u(.008, .010)
    p = Prog(); p.go(.8, "free")
    pokes(p, r, r.u(.004, .007, 8), [.02, .05, .08, .03, .06, .1, .04, .08], .3)
    p.go(.8, "poke", h=-.005, x=.01)
    p.sine(8, "poke", h=(.0025, .5, 3.), x=(.01, .4, 1.5)); p.sine(8, "slide", x=(.01, .3, 2.), y=(.008, .5, 1.2), h=(.002, .7, 1.5)); p.go(.8, "retract", h=.008)
    return robot_wrench(o, r, phys.heron6(), p, kv(r), {"mild": .4, "sens": {"delay": d}, "fs": 400, "wn": 75.}), {}


@row("arm-damping+drift", "pair", "hooke coulomb-friction", "viscous-damping sensor-drift")
def _(o, r):
    c = r.u(38, 48)
    p = Prog(); p.go(1.2, "free")
    pokes(p, r, r.u(.003, .006, 9), [.02, .06, .1, .03, .08, .01, .06, .1, .04], .4)
    slides(p, r, .004, (.02, .05), .03)
    p.go(.5, "free", h=.008)
    pokes(p, r, r.u(.003, .006, 8), [.05, .02, .1, .03, .08, .06, .1, .04], .4); p.go(2., "rest", h=.012)
    dr = np.array([r.u(.45, .6), -r.u(.45, .6), r.u(.5, .7), .008, -.008, .004])
    return robot_wrench(o, r, phys.loon7(), p, law(k=r.u(2000, 2600), c=c, mu=r.u(.35, .5), L=1e-4), {"mild": .4, "sens": {"drift": dr, "quiet": .65}, "wn": 75.}), \
        {"viscous-damping.c": c, "sensor-drift.fx": dr[0], "sensor-drift.fy": dr[1], "sensor-drift.fz": dr[2]}


@row("arm-hc+bias", "pair", "hertz coulomb-friction", "hunt-crossley-damping sensor-bias")
def _(o, r):
    lam = r.u(4, 5)
    b = np.array([r.u(.13, .18), -r.u(.13, .18), -r.u(.15, .22), .004, .005, -.003])
    p = Prog(); p.go(1., "free")
    pokes(p, r, r.u(.004, .007, 10), [.03, .06, .1, .02, .08, .1, .05, .1, .04, .07], .3)
    slides(p, r, .005, (.02, .05), .03)
    p.sine(1., "rest")
    return robot_wrench(o, r, phys.heron6(), p, law(k=r.u(1.8e4, 2.6e4), n=1.5, lam=lam, mu=r.u(.35, .5), L=1e-4), {"mild": .4, "sens": {"bias": b}, "wn": 75.}), \
        {"hunt-crossley-damping.lambda": lam, "sensor-bias.fx": b[0], "sensor-bias.fy": b[1], "sensor-bias.fz": b[2]}


@row("arm-stribeck+kdrift", "pair", "kelvin-voigt coulomb-friction", "stribeck-friction stiffness-drift")
def _(o, r):
    dm, vs, al = r.u(.08, .11), r.u(.014, .02), r.u(.05, .07)
    p = Prog(); p.go(.8, "free")
    for d in (.005, .007, .004):
        pokes(p, r, [d, d * .7], [.02, .05], .4)
        slides(p, r, d, (.005, .012, .03, .08), .02)
    pokes(p, r, [.006, .004], [.02, .05], .4)
    return robot_wrench(o, r, phys.loon7(), p, kv(r, mu=(.25, .32), dmu=dm, vs=vs, alpha=al), {"fs": 250, "wn": 75.}), \
        {"stribeck-friction.dmu": dm, "stribeck-friction.v_s": vs, "stiffness-drift.alpha": al}


@row("arm-tip+presliding", "pair", "kelvin-voigt coulomb-friction", "tip-offset presliding")
def _(o, r):
    off = np.array([r.pick(-1, 1) * r.u(.0008, .001), r.pick(-1, 1) * r.u(.0008, .001), 0.])
    L = r.u(.0002, .00025)
    p = Prog(); p.go(.8, "free")
    pokes(p, r, r.u(.003, .007, 6), [.02, .05, .03, .06, .02, .04], .4, tilt=.2)
    for d in (.004, .006):
        p.go(.8, "approach", h=.003, rx=r.u(-.2, .2), ry=r.u(-.2, .2)); p.go(.8, "poke", h=-d, x=.01)
        p.sine(12, "slide", x=(.009, .15, .5), y=(.007, .1, .3)); p.sine(8, "slide", x=(.014, .2, .4)); p.sine(6, "slide", y=(.006, .3, .5)); p.go(.8, "retract", h=.006)
    return robot_wrench(o, r, phys.heron6(), p, kv(r, mu=(.45, .6), L=L), {"tip_off": off, "wn": 75.}), \
        {"tip-offset.x": off[0], "tip-offset.y": off[1], "presliding.length": L}


@row("arm-layer+viscous-friction", "pair", "kelvin-voigt coulomb-friction", "stiffening-layer viscous-friction")
def _(o, r):
    k = r.u(1200, 1800); K2, db, c = k * r.u(.25, .32), r.u(.003, .0034), r.u(9, 12)
    p = Prog(); p.go(.8, "free")
    pokes(p, r, r.u(.004, .008, 6), [.02, .05, .03, .06, .02, .04], .4)
    for d in (.003, .006): slides(p, r, d, (.01, .04, .09), .03)
    return robot_wrench(o, r, phys.loon7(), p, law(k=k, c=8., mu=r.u(.3, .4), L=1e-4, K2=K2, db=db, cv=c), {"wn": 75., "mild": .5}), \
        {"stiffening-layer.K": K2, "stiffening-layer.delta_b": db, "viscous-friction.c": c}


@row("arm-none-kv", "none", "kelvin-voigt coulomb-friction", "")
def _(o, r):
    k = r.u(1200, 2500)
    return robot_wrench(o, r, phys.heron6(), mixed(r), kv(r, k=k, n=1.006, b1=.012, t1=1.5), {}), {}


@row("crane-none-hooke", "none", "hooke coulomb-friction", "")
def _(o, r):
    return robot_wrench(o, r, phys.crane3(), mixed(r, dirs=("x",), v=(.006, .02, .05)), law(k=r.u(1200, 2500), mu=r.u(.35, .55), L=9e-5), {"no_dq": True, "enc": 5e-6}), {}


@row("arm-none-hertz", "none", "hertz surface-offset coulomb-friction", "")
def _(o, r):
    P = law(k=r.u(1.8e4, 3e4), n=1.5, mu=r.u(.3, .5), L=1e-4, z0=r.u(.0004, .001), lam=.05)
    return robot_wrench(o, r, phys.loon7(), mixed(r, d=(.004, .0065)), P, {}), {}


@row("arm-groove-wall", "outside", "kelvin-voigt coulomb-friction", "")
def _(o, r):
    P = kv(r, wall_k=r.u(260, 340), wall_x=r.u(.006, .012), wall_mu=0.)
    p = mixed(r, L=.028)
    return robot_wrench(o, r, phys.loon7(), p, P, {}), {}


@row("sled-one-way", "not-excited", "hooke coulomb-friction", "friction-anisotropy")
def _(o, r):
    # one axis of slip: along and across cannot be compared
    P = law(k=r.u(2000, 4000), mu=r.u(.4, .5), an=r.u(.15, .25), L=1e-4)
    m = [(.006, .02), (.02, .04), (.06, .06)]
    return tribo(o, r, P, [(.0015, m), (.003, m), (.0045, m)], {}), {}


# ---- free motion
def tool(r):
    m = r.u(.5, .9)
    return m, np.r_[r.rng.normal(0, .006, 2), r.u(.05, .08)], np.diag([.0008, .0009, .0004]) * m


@row("free-com", "one", "none", "tool-com")
def _(o, r):
    arm = phys.heron6(); m, c, I = tool(r)
    dc = r.rng.normal(0, 1, 3); dc *= r.u(.0024, .0028) / np.linalg.norm(dc); dc[2] = np.sign(dc[2]) * max(abs(dc[2]), .001)
    path = fourier(r, 6, 40, .06, 4, [.6, .3, .3, 1.2, .7, 1.5], arm.home)
    return robot_wrench(o, r, arm, path, None, {"tool": (m, c, I), "tool_stated": (m, c - dc, I), "mild": .5}), {"tool-com.x": dc[0], "tool-com.y": dc[1], "tool-com.z": dc[2]}


@row("free-mass+lag", "pair", "none", "tool-mass sensor-lag")
def _(o, r):
    arm = phys.loon7(); m, c, I = tool(r)
    dm, lag = r.u(.045, .055) * m, r.u(.014, .018)
    path = fourier(r, 7, 40, .25, 6, [.2, .15, .2, .2, .6, .4, .8], arm.home)
    return robot_wrench(o, r, arm, path, None, {"tool": (m, c, I), "tool_stated": (m - dm, c, I), "sens": {"lag": lag}, "mild": .5, "wn": 75., "fs": 400}), {"tool-mass.dm": dm, "sensor-lag.tau": lag}


@row("free-none", "none", "none", "")
def _(o, r):
    arm = phys.heron6(); m, c, I = tool(r)
    path = fourier(r, 6, 45, .06, 4, [.6, .3, .3, 1.2, .7, 1.5], arm.home)
    return robot_wrench(o, r, arm, path, None, {"tool": (m, c, I), "tool_stated": (m * r.u(.995, 1.005), c, I), "mild": .5}), {}


@row("free-cable", "outside", "none", "")
def _(o, r):
    arm = phys.loon7(); m, c, I = tool(r)
    path = fourier(r, 7, 60, .07, 4, [.7, .35, .4, .4, 1.0, .6, 1.2], arm.home)
    cab = (np.array([.2, r.u(.25, .35), .75]), .48, r.u(14, 20))
    return robot_wrench(o, r, arm, path, None, {"tool": (m, c, I), "tool_stated": (m, c, I), "cable": cab, "mild": .5}), {}


@row("free-slow-inertia", "not-excited", "none", "tool-inertia")
def _(o, r):
    arm = phys.heron6(); m, c, _ = tool(r)
    I = np.diag(r.u(.001, .002, 3))
    P = [arm.home]; fs = 500
    q = [np.tile(arm.home, (fs, 1))]
    for i in range(12):
        a = arm.home + r.rng.uniform(-1, 1, 6) * [.4, .2, .2, 1., .6, 1.2]
        u = np.arange(1, 8 * fs + 1) / (8 * fs); s = 10 * u**3 - 15 * u**4 + 6 * u**5
        q += [P[-1] + np.outer(s, a - P[-1]), np.tile(a, (2 * fs, 1))]; P.append(a)
    return robot_wrench(o, r, arm, (np.concatenate(q), fs), None, {"tool": (m, c, I), "tool_stated": (m, c, None), "mild": .5, "fs": 50}), {}


# ---- joint torques of arms
def fric(arm, r, load=0.):
    n = arm.n; F = np.zeros((n, 7))
    F[:, 0] = r.u(.8, 1.2, n) * {6: np.array([6, 7, 4, 1.6, 1.2, .8]), 7: np.array([4, 4, 3., 2.8, 2., 1.3, 1.3])}[n]
    F[:, 1] = r.u(.8, 1.2, n) * {6: np.array([9, 10, 5, 2, 1.5, 1.]), 7: np.array([7, 8, 4, 5, 2., 1.2, .9])}[n]
    F[:, 6] = .9 * F[:, 0]; F[:, 2] = load; F[:, 4] = 1.; F[:, 5] = r.u(5e-5, 1.2e-4)
    return F


BASEJ = "rigid-body joint-coulomb-friction joint-viscous-friction"


@row("joints-load-friction", "one", BASEJ, "joint-load-friction")
def _(o, r):
    arm = phys.loon7()
    path = fourier(r, 7, 70, .04, 4, [1., .6, .9, .8, 1.1, .9, 1.2], arm.home)
    return arm_torque(o, r, arm, path, {"fric": fric(arm, r, r.u(.28, .34)), "tau_filter": 50, "fs": 250, "enc": 2e-6}), {}


@row("joints-payload", "one", BASEJ, "payload")
def _(o, r):
    arm = phys.heron6(); m = r.u(.45, .6)
    path = fourier(r, 6, 60, .05, 5, [1.2, .5, .6, 1.3, 1., 1.5], arm.home)
    return arm_torque(o, r, arm, path, {"fric": fric(arm, r), "payload": (m, np.array([.01, -.01, .06]))}), {"payload.mass": m}


@row("joints-rotor", "one", BASEJ, "rotor-inertia")
def _(o, r):
    arm = phys.heron6(); J = r.u(.8, 1.2, 6) * np.array([.45, .5, .25, .1, .08, .05])
    path = fourier(r, 6, 45, .12, 6, [.9, .4, .5, 1.2, .9, 1.4], arm.home)
    return arm_torque(o, r, arm, path, {"fric": fric(arm, r), "rotor": J, "tau_filter": 50, "fs": 250}), {f"rotor-inertia.joint_{i+1}": J[i] for i in range(6)}


@row("joints-none", "none", BASEJ, "")
def _(o, r):
    arm = phys.heron6()
    path = fourier(r, 6, 90, .04, 5, [1.2, .5, .6, 1.3, 1., 1.5], arm.home)
    return arm_torque(o, r, arm, path, {"fric": fric(arm, r), "tau_filter": r.u(20, 30)}), {}


@row("joints-slow-rotor", "not-excited", BASEJ, "rotor-inertia")
def _(o, r):
    arm = phys.heron6(); J = r.u(.8, 1.2, 6) * np.array([.25, .25, .15, .05, .05, .04])
    path = fourier(r, 6, 120, .012, 3, [.9, .4, .5, 1.0, .8, 1.1], arm.home)
    return arm_torque(o, r, arm, path, {"fric": fric(arm, r), "rotor": J, "ntau": .008, "fs": 100, "enc": 2e-5, "tau_filter": 25}), {}


# ---- drives
def steps(r, vs, T=2.0):
    s = []
    for sg in (1, -1):
        for v in vs: s += [("v", sg * v, T)]
    return s


@row("drive-ripple", "one", BASEJ, "joint-torque-ripple")
def _(o, r):
    A, k = r.u(.16, .2), float(r.pick(6, 8, 11))
    p = dict(I=r.u(.15, .3), fc=r.u(1., 1.5), fv=r.u(.4, .6), rA=A, rk=k, rph=r.u(0, 6))
    return drive(o, r, steps(r, [.5, 1., 2., 3.], 4.) + [("s", 2., .25, 12)], p, {"fs": 500, "tau_filter": 50}), {"joint-torque-ripple.amplitude": A, "joint-torque-ripple.k": k}


@row("drive-stribeck", "one", BASEJ, "joint-stribeck-friction")
def _(o, r):
    p = dict(I=r.u(.15, .3), fc=r.u(.9, 1.2), fv=r.u(.3, .5), fst=r.u(.3, .4), vst=r.u(.15, .25), L=1.5e-4)
    return drive(o, r, steps(r, [.04, .08, .15, .25, .4, .8, 1.5, 3.], 3.) + [("s", 1., .3, 10)], p, {}), {"joint-stribeck-friction.v_s": p["vst"]}


@row("drive-none-coarse", "none", BASEJ, "")
def _(o, r):
    p = dict(I=r.u(.08, .12), fc=r.u(1., 1.5), fv=r.u(.5, .8), L=4e-4)
    return drive(o, r, steps(r, [.3, .6, 1.2, 2.], 3.) + [("s", 1.5, .4, 12)], p, {"enc": 1e-3, "dq": False, "fs": 200, "tau_filter": 40}), {}


@row("drive-warms-up", "outside", BASEJ, "")
def _(o, r):
    p = dict(I=r.u(.15, .3), fc=r.u(1.2, 1.6), fv=r.u(.6, .9), warm=r.u(.5, .6), tw=r.u(40, 60))
    s = []
    for i in range(7): s += steps(r, [.5, 1.2, 2.5], 2.) + [("s", 2., .35, 8)]
    return drive(o, r, s, p, {}), {}


def main():
    a = argparse.ArgumentParser()
    a.add_argument("--seed", type=int, default=1); a.add_argument("--out", default="out"); a.add_argument("--only", default="")
    a = a.parse_args()
    os.makedirs(a.out, exist_ok=True)
    order = np.random.default_rng([a.seed, 99]).permutation(len(ROWS))
    rows = []; t0 = time.time()
    keys = {}
    for c, i in enumerate(order):
        key, kind, base, truth, near, cls, fn = ROWS[i]
        name = f"case_{c:03d}"
        if a.only and not any(x in key for x in a.only.split(",")): continue
        d = os.path.join(a.out, name); os.makedirs(d, exist_ok=True)
        for f in os.listdir(d): os.remove(os.path.join(d, f))
        r = Row(a.seed, int(i), name)
        t1 = time.time()
        info, vals = fn(d, r)
        rows.append({"log": f"{name}/log.{r.fmt}", "rig": f"{name}/rig.toml", "base": base, "truth": truth, "kind": kind, "class": cls, "near": near,
                     "values": {k: float(v) for k, v in vals.items()}, "error_true_model": info["error_true_model"],
                     "error_true_model_unit": "N.m" if key.startswith(("joints", "drive")) else "N"})
        if "error_true_model_torque" in info: rows[-1]["error_true_model_torque"] = info["error_true_model_torque"]
        keys[name] = {"key": key, "nuisances": r.note, "arm": info.get("arm")}
        print(f"{name} {key:28s} {time.time()-t1:5.1f} s", flush=True)
    json.dump(rows, open(f"{a.out}/truth.json", "w"), indent=1)
    json.dump(keys, open(f"{a.out}/builder.json", "w"), indent=1, default=str)
    print(f"{len(rows)} rows, {time.time()-t0:.0f} s")


if __name__ == "__main__":
    main()
