"""Refits of contact logs (arm or tester): the plain catalogue laws driven by the measured motion, Gauss-Newton on whitened channels.
Everything judged about a case (effect_rms, left_rms, fit_rms, near) is measured here, from the logged data, not from the hidden truth."""
import numpy as np
from dataclasses import dataclass, field
from numba import njit
from scipy.signal import butter, sosfiltfilt
from chain import sensor_motion
import laws

BASES = {"hooke": ["F0"], "kelvin-voigt": ["F0", "c"], "hertz": ["F0"], "hunt-crossley": ["F0", "lam"], "none": []}
EXPONENT = {"hooke": 1.0, "kelvin-voigt": 1.0, "hertz": 1.5, "hunt-crossley": 1.5, "none": 1.0}
# parameter: (start, step, low, high, logarithmic)
PAR = {"F0": (1, .01, 1e-3, 1e4, 1), "c": (0, 2, -50, 2000, 0), "lam": (0, .2, -5, 60, 0), "n": (None, .02, .5, 4, 0), "r1": (0, .03, -.1, .95, 0),
       "tau1": (1, .1, .01, 200, 1), "hA": (0, .05, -5, 20, 0), "hL": (5e-4, .1, 2e-5, 1e-2, 1), "mR": (0, .03, -.2, .95, 0), "mL": (1e-3, .1, 5e-5, .02, 1),
       "aF": (0, .03, -2, 20, 0), "aL": (5e-4, .1, 2e-5, 5e-3, 1), "sK": (0, 50, -2e4, 1e5, 0), "sB": (1e-3, .03, 1e-4, .03, 1), "z0": (0, 1e-5, -3e-3, 3e-3, 0),
       "alpha": (0, .01, -2, 2, 0), "C": (0, 2e-6, 0, 1e-3, 0), "mu": (.2, .01, 0, 3, 0), "cv": (0, .5, -50, 200, 0), "dmu": (0, .02, -1, 2, 0),
       "vs": (.01, .1, 5e-4, .2, 1), "L": (3e-4, .1, 1e-5, 1e-2, 1), "vr": (1e-3, .1, 5e-5, .1, 1), "p": (0, .02, -1, 1, 0), "a": (0, .02, -.9, .9, 0),
       "dm": (0, 5e-3, -1, 2, 0), "dcx": (0, 1e-3, -.1, .1, 0), "dcy": (0, 1e-3, -.1, .1, 0), "dcz": (0, 1e-3, -.1, .1, 0),
       "ox": (0, 2e-4, -.03, .03, 0), "oy": (0, 2e-4, -.03, .03, 0), "oz": (0, 2e-5, -.03, .03, 0), "mx": (0, .01, -.5, .5, 0), "my": (0, .01, -.5, .5, 0),
       "mz": (0, .01, -.5, .5, 0), "g": (0, .01, -.5, .5, 0), "lag": (0, 2e-3, 0, .3, 0), "toff": (0, 1e-3, -.1, .1, 0)}
EFF = {"hertz-exponent": ["n"], "viscous-damping": ["c"], "hunt-crossley-damping": ["lam"], "relaxation": ["r1", "tau1"], "hysteresis": ["hA", "hL"],
       "stress-softening": ["mR", "mL"], "adhesion": ["aF", "aL"], "stiffening-layer": ["sK", "sB"], "surface-offset": ["z0"], "stiffness-drift": ["alpha"],
       "stiffness-inhomogeneity": [], "coulomb-friction": ["mu"], "viscous-friction": ["cv"], "stribeck-friction": ["dmu", "vs"], "presliding": ["L"],
       "friction-rounding": ["vr"], "load-dependent-friction": ["p"], "friction-anisotropy": ["a"], "tool-mass": ["dm"], "tool-com": ["dcx", "dcy", "dcz"],
       "tool-inertia": [], "structural-compliance": ["C"], "tip-offset": ["ox", "oy", "oz"], "sensor-bias": [], "sensor-drift": [], "sensor-crosstalk": [],
       "sensor-misalignment": ["mx", "my", "mz"], "sensor-gain": ["g"], "sensor-lag": ["lag"], "time-offset": ["toff"], "saturation": [], "mains-hum": [],
       "quantization": []}
LIN = {"stiffness-inhomogeneity", "tool-inertia", "sensor-bias", "sensor-drift", "sensor-crosstalk", "mains-hum"}
GROUP = {**{k: "normal" for k in list(EFF)[:11]}, **{k: "tang" for k in list(EFF)[11:18]}, "tool-mass": "force", "tool-com": "torque", "tool-inertia": "torque",
         "structural-compliance": "normal", "tip-offset": "torque", **{k: "force" for k in list(EFF)[23:]}}
NEEDS_FRICTION = {"viscous-friction": False, "stribeck-friction": True, "presliding": True, "friction-rounding": True, "load-dependent-friction": True,
                  "friction-anisotropy": True}
GRID = {"relaxation": [dict(tau1=v) for v in (.05, .2, .8, 3, 15)], "hysteresis": [dict(hL=v) for v in (1e-4, 4e-4, 1.5e-3)],
        "stress-softening": [dict(mL=v) for v in (2e-4, 7e-4, 2.5e-3)], "adhesion": [dict(aL=v) for v in (1e-4, 4e-4, 1.2e-3)],
        "stribeck-friction": [dict(vs=v) for v in (.003, .01, .03)], "presliding": [dict(L=v) for v in (4e-5, 3e-4, 1e-3)],
        "friction-rounding": [dict(vr=v) for v in (3e-4, 1.5e-3, 6e-3)], "mains-hum": [dict(hum=50.), dict(hum=60.)]}


@dataclass
class Data:
    t: np.ndarray
    kin: dict                 # d dd x y vx vy, and for an arm ns t1s t2s A W w dw Fs...
    y: np.ndarray             # readings (n, channels)
    sd: np.ndarray
    base: str
    D0: float
    N0: float
    stated: dict = field(default_factory=dict)   # tool mass, com, tip (arm)
    places: np.ndarray = None
    cache: dict = field(default_factory=dict)
    bristle: int = 1          # the plain form of friction at rest: 1 Prandtl, 0 Dahl; tune.py takes the one that fits better

    @property
    def arm(self):
        return "ns" in self.kin


def smooth(x, fs, fc):
    fc = min(fc, 0.35 * fs)
    return sosfiltfilt(butter(2, fc, fs=fs, output="sos"), x, axis=0, padlen=min(len(x) - 1, int(3 * fs / fc)))


def on_grid(t, X, fc):
    fs = 1 / np.median(np.diff(t))
    g = np.arange(t[0], t[-1], 1 / fs)
    Y = np.column_stack([np.interp(g, t, X[:, i]) for i in range(X.shape[1])])
    S = smooth(Y, fs, fc)
    return g, S, np.gradient(S, 1 / fs, axis=0), fs


def arm_data(t, q, wrench, ch, rig, base, sd, D0, N0, fc=30.0, most=4500):
    g, Q, dQ, fs = on_grid(t, q, fc)
    ddQ = np.gradient(dQ, 1 / fs, axis=0)
    step = max(1, int(np.ceil(len(t) / most)))
    k = np.arange(0, len(t), step)
    tk = t[k]
    I = lambda M: np.column_stack([np.interp(tk, g, M[:, i]) for i in range(M.shape[1])])
    R, P, V, W, dW, A = sensor_motion(*ch.args(), ch.Rs, ch.ps, I(Q), I(dQ), I(ddQ))
    F = rig["frame"]
    grav = np.asarray(rig["gravity"], float)
    Rt = np.transpose(R, (0, 2, 1))
    kin = dict(ns=Rt @ F[1], t1s=Rt @ F[2], t2s=Rt @ F[3], G=Rt @ grav - A, w=W, dw=dW, P=P, R=R, V=V, Fr=F)
    sk = lambda v: np.stack([np.stack([0 * v[:, 0], -v[:, 2], v[:, 1]], 1), np.stack([v[:, 2], 0 * v[:, 0], -v[:, 0]], 1),
                             np.stack([-v[:, 1], v[:, 0], 0 * v[:, 0]], 1)], 1)
    kin["H"] = sk(dW) + sk(W) @ sk(W)
    y = wrench[k]
    D = Data(tk, kin, y, sd, base, D0, N0, rig)
    motion_at(D, rig["tip"])
    ft = tool_wrench(D, {})[:, :3]
    fm = smooth(np.column_stack([np.interp(g, t, wrench[:, i]) for i in range(3)]), fs, fc)
    D.kin["Fm"] = np.einsum("ij,ij->i", I(fm) - ft, kin["ns"])
    return D


def motion_at(D, r):
    """Depth, slips and rates of a point r of the sensor frame."""
    k = D.kin
    rw = np.einsum("nij,j->ni", k["R"], r)
    p = k["P"] + rw - k["Fr"][0]
    v = k["V"] + np.einsum("nij,nj->ni", k["R"], np.cross(k["w"], r))
    k.update(d=-p @ k["Fr"][1], x=p @ k["Fr"][2], y=p @ k["Fr"][3], dd=-v @ k["Fr"][1], vx=v @ k["Fr"][2], vy=v @ k["Fr"][3])


def tool_wrench(D, th):
    s, k = D.stated, D.kin
    m = s["mass"] + th.get("dm", 0.0)
    c = np.asarray(s["com"], float) + np.array([th.get("dcx", 0), th.get("dcy", 0), th.get("dcz", 0)])
    f = m * (k["G"] - k["H"] @ c)
    tau = np.cross(c, f)
    I = np.asarray(s.get("inertia", np.zeros((3, 3))), float)
    if I.any():
        tau = tau - k["dw"] @ I.T - np.cross(k["w"], k["w"] @ I.T)
    return np.hstack([f, tau])


@njit(cache=True)
def lagged(t, y, tau):
    out = y.copy()
    for k in range(1, len(t)):
        dt = t[k] - t[k - 1]
        e = np.exp(-dt / tau)
        b = (1 - e) * tau / dt
        for i in range(y.shape[1]):
            # exact for an input that is straight between samples
            out[k, i] = e * out[k - 1, i] + (b - e) * y[k - 1, i] + (1 - b) * y[k, i]
    return out


def contact_part(D, th, names):
    base = D.base
    P = dict(F0=th.get("F0", 0.0), D0=D.D0, N0=D.N0, n=EXPONENT[base], mu=0.0, L=1e-4, bristle=D.bristle)
    for k in ("c", "lam", "r1", "tau1", "hA", "hL", "mR", "mL", "aF", "aL", "sK", "sB", "z0", "alpha", "mu", "cv", "dmu", "vs", "L", "vr", "p", "a", "n"):
        if k in th and any(k in (EFF.get(x) or BASES.get(x) or []) for x in names):
            P[k] = th[k]
    C = th.get("C", 0.0) if "structural-compliance" in names else 0.0
    o = np.array([th.get("ox", 0), th.get("oy", 0), th.get("oz", 0)]) if "tip-offset" in names else np.zeros(3)
    key = (tuple(sorted(P.items())), C, tuple(o))
    if key in D.cache:
        return D.cache[key]
    k = D.kin
    d, x, y, dd, vx, vy = k["d"], k["x"], k["y"], k["dd"], k["vx"], k["vy"]
    if o.any():
        v = np.cross(k["w"], o)
        dot = lambda a, b: np.einsum("ij,ij->i", a, b)
        d, x, y = d - k["ns"] @ o, x + k["t1s"] @ o, y + k["t2s"] @ o
        dd, vx, vy = dd - dot(k["ns"], v), vx + dot(k["t1s"], v), vy + dot(k["t2s"], v)
    if C:
        d = d - C * k["Fm"]
    N = laws.run(laws.pack(P), D.t, d, dd, x, y, vx, vy)
    if D.arm:
        f = N[:, :1] * k["ns"] + N[:, 1:2] * k["t1s"] + N[:, 2:] * k["t2s"]
        N = np.hstack([f, np.cross(D.stated["tip"] + o, f)])
    else:
        N = N[:, :D.y.shape[1]]
    if len(D.cache) > 60:
        D.cache.clear()
    D.cache[key] = N
    return N


def predict(D, th, names):
    c = contact_part(D, th, names)
    w = c + tool_wrench(D, {k: v for k, v in th.items() if any(k in EFF.get(x, []) for x in names)}) if D.arm else c.copy()
    if "sensor-gain" in names:
        w = w * (1 + th.get("g", 0.0))
    if "sensor-misalignment" in names:
        r = np.array([th.get("mx", 0), th.get("my", 0), th.get("mz", 0)])
        w = np.hstack([w[:, :3] + np.cross(r, w[:, :3]), w[:, 3:] + np.cross(r, w[:, 3:])])
    if "sensor-lag" in names and th.get("lag", 0) > 1e-5:
        w = lagged(D.t, w, th["lag"])
    if "time-offset" in names and th.get("toff", 0):
        w = np.column_stack([np.interp(D.t - th["toff"], D.t, w[:, i]) for i in range(w.shape[1])])
    for x in names:
        if x in LIN and x + "#" in th:
            w = w + np.tensordot(columns(D, th, names, x, w, c), th[x + "#"], (0, 0))
    if "saturation" in names:
        w = np.clip(w, D.y.min(0), D.y.max(0))
    return w


def columns(D, th, names, x, w, c):
    """Columns (k, n, channels) of an effect that's linear in its parameters."""
    n, m = D.y.shape
    unit = np.eye(m)
    if x == "sensor-bias":
        return np.repeat(unit[:, None, :], n, 1)
    if x == "sensor-drift":
        return unit[:, None, :] * ((D.t - D.t[0]) / 60)[None, :, None]
    if x == "sensor-crosstalk":
        out = []
        for i in range(m):
            for j in range(m):
                if i != j:
                    z = np.zeros((n, m)); z[:, i] = w[:, j]
                    out.append(z)
        return np.array(out)
    if x == "mains-hum":
        out = []
        for h in (1, 2, 3):
            ph = 2 * np.pi * th.get("hum", 50.) * h * D.t
            for s in (np.sin(ph), np.cos(ph)):
                out.extend(unit[:, None, :] * s[None, :, None])
        return np.array(out)
    if x == "tool-inertia":
        out, k = [], D.kin
        for i, j in ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2)):
            I = np.zeros((3, 3)); I[i, j] = I[j, i] = 1
            z = np.zeros((n, m)); z[:, 3:] = -(k["dw"] @ I) - np.cross(k["w"], k["w"] @ I)
            out.append(z)
        return np.array(out)
    if x == "stiffness-inhomogeneity":
        if D.places is None:
            on = D.kin["d"] > 0
            p = np.column_stack([D.kin["x"], D.kin["y"]])
            span = max(1e-3, np.ptp(p[on], axis=0).max())
            cell = span / 6
            q = np.unique(np.round(p[on] / cell), axis=0) * cell
            D.places = (q, cell)
        q, cell = D.places
        p = np.column_stack([D.kin["x"], D.kin["y"]])
        B = np.exp(-((p[:, None, :] - q[None]) ** 2).sum(2) / (2 * (1.0 * cell) ** 2))
        return (B.T / np.maximum(B.sum(1), 1e-3))[:, :, None] * c[None]
    raise KeyError(x)


def params(D, names):
    out = []
    for x in names:
        out += BASES.get(x, []) or EFF.get(x, [])
    return list(dict.fromkeys(out))


def start(D, names, th):
    th = dict(th)
    for p in params(D, names):
        if p not in th:
            th[p] = EXPONENT[D.base] if p == "n" else (D.N0 if p == "F0" else PAR[p][0])
    return th


def jac(D, th, names, w0):
    cols, ps = [], params(D, names)
    for p in ps:
        _, st, lo, hi, log = PAR[p]
        q = dict(th)
        q[p] = th[p] * (1 + st) if log else th[p] + st * (1 if th[p] + st <= hi else -1)
        cols.append((predict(D, q, names) - w0) / ((np.log(q[p] / th[p])) if log else q[p] - th[p]))
    return ps, cols


def fit(D, names, th, iters=6):
    """Gauss-Newton with damping. Returns parameters and prediction."""
    names = list(names)
    th = start(D, names, th)
    lin = [x for x in names if x in LIN]
    w = predict(D, th, names)
    cost = (((D.y - w) / D.sd) ** 2).sum()
    damp = 1e-6
    for it in range(iters):
        ps, cols = jac(D, th, names, w)
        c = contact_part(D, th, names)
        sizes = []
        for x in lin:
            A = columns(D, th, names, x, w, c)
            sizes.append(len(A)); cols.extend(A)
        if not cols:
            break
        J = np.array([(k / D.sd).ravel() for k in cols])
        r = ((D.y - w) / D.sd).ravel()
        H, g = J @ J.T, J @ r
        dg = np.diag(H) + 1e-12 * np.trace(H) + 1e-30
        ok = False
        for _ in range(4):
            ridge = np.full(len(g), damp)
            step = np.linalg.solve(H + np.diag(dg * (ridge + 1e-9)), g)
            new = dict(th)
            for p, s in zip(ps, step):
                _, st, lo, hi, log = PAR[p]
                v = th[p] * np.exp(np.clip(s, -1, 1)) if log else th[p] + s
                new[p] = float(np.clip(v, lo, hi))
            i = len(ps)
            for x, k in zip(lin, sizes):
                new[x + "#"] = th.get(x + "#", np.zeros(k)) + step[i:i + k]
                i += k
            w2 = predict(D, new, names)
            c2 = (((D.y - w2) / D.sd) ** 2).sum()
            if c2 < cost:
                ok = True
                break
            damp = max(damp * 30, 1e-3)
        if not ok:
            break
        gain = (cost - c2) / cost
        th, w, cost, damp = new, w2, c2, damp / 10
        if gain < 1e-5:
            break
    return th, w


# ---------------------------------------------------------------- what's left, where, in which channels
def project(D, e, group):
    if not D.arm:
        return e[:, :1] if group in ("normal",) else (e[:, 1:] if group == "tang" and e.shape[1] > 1 else e)
    k = D.kin
    dot = lambda a, b: np.einsum("ij,ij->i", a, b)[:, None]
    if group == "normal":
        return dot(e[:, :3], k["ns"])
    if group == "tang":
        return np.hstack([dot(e[:, :3], k["t1s"]), dot(e[:, :3], k["t2s"])])
    return e[:, 3:] if group == "torque" else e[:, :3]


def mask(D, effect):
    on = D.kin["d"] > 0
    if effect == "adhesion":
        return D.kin["d"] > -1.5e-3
    if effect == "tip-offset" or GROUP.get(effect, "normal") in ("normal", "tang") or effect == "saturation":
        return on
    if effect in ("tool-com", "tool-inertia"):
        return ~on
    return np.ones(len(D.t), bool)


def rms(x):
    return float(np.sqrt(np.mean(np.square(x)))) if np.size(x) else 0.0


def tidy(names):
    """friction-rounding needs and changes the Coulomb law; nothing else to settle."""
    return list(dict.fromkeys(names))


def candidates(D, names, hidden):
    has = set(names)
    fr = "coulomb-friction" in has
    slide = D.arm or D.y.shape[1] > 1
    out = []
    for e in EFF:
        if e in has or e in hidden or e == "quantization":
            continue
        g = GROUP[e]
        if not D.arm and (e in ("tool-mass", "tool-com", "tool-inertia", "tip-offset", "sensor-crosstalk", "sensor-misalignment", "sensor-gain")):
            continue
        if g == "tang" and (not slide or (NEEDS_FRICTION.get(e) and not fr)):
            continue
        if e == "stiffness-inhomogeneity" and np.ptp(D.kin["x"]) + np.ptp(D.kin["y"]) < 1e-3:
            continue
        if e == "hertz-exponent" and D.base == "hunt-crossley":
            continue
        if e == "viscous-damping" and "kelvin-voigt" in has or e == "hunt-crossley-damping" and "hunt-crossley" in has:
            continue
        out.append(e)
    return out


def near(D, names, hidden, th0, w0, effect, limit, most=8):
    """Effects that, put into `names`, leave at most `limit` (rms over the channels and samples of `effect`). First by projection, then by a full refit."""
    grp, m = GROUP[effect], mask(D, effect)
    ps, cols = jac(D, th0, names, w0)
    for x in names:
        if x in LIN:
            cols.extend(columns(D, th0, names, x, w0, contact_part(D, th0, names)))
    Jb = np.array([(k / D.sd).ravel() for k in cols]) if cols else np.zeros((0, D.y.size))
    r0 = ((D.y - w0) / D.sd).ravel()
    full = rms(project(D, D.y - w0, grp)[m])
    short = []
    for e in candidates(D, names, hidden):
        best = (9e9, None)
        for gp in GRID.get(e, [{}]):
            th = start(D, names + [e], {**th0, **gp})
            if e == "stiffening-layer":
                dm = np.quantile(D.kin["d"], 0.999)
                grid = [0.3, 0.55, 0.8]
            else:
                grid = [None]
            for gg in grid:
                t2 = dict(th, sB=dm * gg) if gg else th
                if e in LIN:
                    A = columns(D, t2, names + [e], e, w0, contact_part(D, th0, names))
                    J = np.vstack([Jb, np.array([(k / D.sd).ravel() for k in A])])
                    r = r0
                else:
                    w1 = predict(D, t2, names + [e])
                    r = ((D.y - w1) / D.sd).ravel()
                    p = EFF[e]
                    amp = [k for k in p if k not in ("tau1", "hL", "mL", "aL", "sB", "vs")]
                    ex = []
                    for k in amp:
                        st, log = PAR[k][1], PAR[k][4]
                        q = dict(t2)
                        q[k] = t2[k] * (1 + st) if log else t2[k] + st
                        ex.append(((predict(D, q, names + [e]) - w1) / (st if not log else np.log(1 + st)) / D.sd).ravel())
                    J = np.vstack([Jb] + ex) if ex else Jb
                if len(J):
                    H = J @ J.T
                    H[np.diag_indices_from(H)] *= 1 + 1e-9
                    H[np.diag_indices_from(H)] += 1e-12 * np.trace(H)
                    s = np.linalg.solve(H, J @ r)
                    r = r - s @ J
                e1 = rms(project(D, r.reshape(D.y.shape) * D.sd, grp)[m])
                if e1 < best[0]:
                    sv = {k: float(np.clip(t2[k] + v, PAR[k][2], PAR[k][3])) for k, v in zip(amp, s[len(Jb):])} if e not in LIN and not any(PAR[k][4] for k in EFF[e]
                          if k in ("L", "vr")) and len(J) > len(Jb) else {}
                    best = (e1, {**t2, **sv})
        short.append((best[0], e, best[1]))
    short.sort(key=lambda z: z[0])
    out = []
    for e1, e, th in short[:most]:
        if e1 > limit + 0.55 * max(full - limit, 0) and out is not None and e1 > 1.6 * limit:
            continue
        th2, w2 = fit(D, names + [e], th, 6)
        e2 = rms(project(D, D.y - w2, grp)[m])
        out.append((e, e2))
    return [e for e, v in out if v <= limit], out
