"""Refits of contact logs with the plain catalogue forms: staged prediction (contact, tool, sensor) and Levenberg-Marquardt."""
import numpy as np
from numba import njit
from laws import P, mat_run, params
from robots import kin_batch
from sensing import smooth

BASES = {"none": {}, "hooke": dict(n=1.0), "kelvin-voigt": dict(n=1.0), "hertz": dict(n=1.5), "hunt-crossley": dict(n=1.5), "zener": dict(n=1.0)}
# effect -> (keys, list of starting values, scale)          keys of laws go to the contact stage, others to their own stage
TABLE = {
    "hooke": (("k",), [(1000.,)]), "hertz": (("k",), [(3e4,)]), "kelvin-voigt": (("k", "c"), [(1000., 5.)]), "none": ((), [()]),
    "hunt-crossley": (("k", "lam"), [(3e4, .3)]), "zener": (("k", "r0", "tau0"), [(1000., .3, 1.)]),
    "hertz-exponent": (("n",), [(None,)]), "viscous-damping": (("c",), [(1.,)]), "hunt-crossley-damping": (("lam",), [(.1,)]),
    "relaxation": (("r0", "tau0"), [(.1, .15), (.1, 1.), (.1, 6.)]),
    "hysteresis": (("hyA", "hyL"), [(.1, 2e-4), (.2, 1e-3), (.2, 4e-3)]),
    "stress-softening": (("soR", "soL"), [(.1, 5e-4), (.1, 2e-3)]),
    "adhesion": (("adF", "adL"), [(.1, 3e-4), (.1, 1e-3)]),
    "stiffening-layer": (("laK", "laD"), [("k.2", "d.4"), ("k.2", "d.6"), ("k.2", "d.8")]),
    "surface-offset": (("z0",), [(1e-6,)]), "stiffness-drift": (("alpha",), [(.001,)]), "stiffness-inhomogeneity": (("kap",), [()]),
    "coulomb-friction": (("mu",), [(.3,)]), "viscous-friction": (("cv",), [(.5,)]),
    "stribeck-friction": (("dmu", "vs"), [(.02, .004), (.02, .015)]), "presliding": (("ell",), [(3e-4,), (1e-3,)]),
    "friction-rounding": (("vr",), [(1e-3,), (6e-3,)]), "load-dependent-friction": (("pN",), [(-.01,)]),
    "friction-anisotropy": (("aniso",), [(.01,)]), "structural-compliance": (("comp",), [(5e-6,)]),
    "tool-mass": (("dm",), [(.0,)]), "tool-com": (("cx", "cy", "cz"), [(0., 0., 0.)]),
    "tool-inertia": (("ixx", "iyy", "izz", "ixy", "ixz", "iyz"), [(0.,) * 6]), "tip-offset": (("px", "py", "pz"), [(0., 0., 0.)]),
    "sensor-bias": (("b*",), [()]), "sensor-drift": (("d*",), [()]), "sensor-crosstalk": (("x*",), [()]),
    "sensor-misalignment": (("mx", "my", "mz"), [(0., 0., 0.)]), "sensor-gain": (("g",), [(0.,)]),
    "sensor-lag": (("lag",), [(.004,), (.02,)]), "time-offset": (("toff",), [(.002,), (-.002,)]), "saturation": (("lim",), [("top",)]),
    "mains-hum": (("h*",), [()]),
}
SCALE = dict(k=300., c=3., lam=.05, n=.05, r0=.05, hyA=.1, soR=.05, adF=.1, laK=300., z0=5e-5, alpha=.02, mu=.05, cv=1., dmu=.05, pN=.05,
             aniso=.05, comp=1e-5, dm=.01, cx=1e-3, cy=1e-3, cz=1e-3, ixx=1e-4, iyy=1e-4, izz=1e-4, ixy=1e-4, ixz=1e-4, iyz=1e-4,
             px=1e-4, py=1e-4, pz=1e-4, mx=.01, my=.01, mz=.01, g=.01, toff=.002, lim=.5)
LOGP = ("tau0", "hyL", "soL", "adL", "vs", "ell", "vr", "lag", "laD", "lim", "k")     # positive: stepped in the logarithm
LAW = set(P) | {"kap", "px", "py", "pz"}
TOOL = {"dm", "cx", "cy", "cz", "ixx", "iyy", "izz", "ixy", "ixz", "iyz"}
TANG = {"coulomb-friction", "viscous-friction", "stribeck-friction", "presliding", "friction-rounding", "load-dependent-friction", "friction-anisotropy"}


@njit(cache=True)
def lag_run(y, dt, tau, out):
    for c in range(y.shape[1]):
        out[0, c] = y[0, c]
    for i in range(1, y.shape[0]):
        a = np.exp(-dt[i] / tau)
        w = (1 - a) * tau / dt[i]                     # exact for input linear over the step
        for c in range(y.shape[1]):
            out[i, c] = a * out[i - 1, c] + (w - a) * y[i - 1, c] + (1 - w) * y[i, c]


class Data:
    """What a refit sees of one log."""

    def common(self, t, y, sigma, d, dd, s, v):
        self.t, self.y, self.n = t, np.ascontiguousarray(y), len(t)
        self.dt = np.r_[1e-3, np.diff(t)]
        self.d, self.dd, self.s, self.v = d, dd, s, v
        scale = np.sqrt(np.mean(y ** 2, 0))
        self.sigma = np.asarray(sigma, float)
        self.wt = 1 / np.sqrt(self.sigma ** 2 + (.006 * scale) ** 2)
        c = d > 0
        self.dmax = float(np.percentile(d[c], 99)) if c.any() else 1e-3
        self.contact = c
        self.cap = {}
        self.centres()

    def centres(self, cen=None):
        """Places of a smooth stiffness profile (normalised Gaussians), from the visits or given."""
        c = self.contact & (self.d > .2 * self.dmax)
        self.B = self.cen = None
        if cen is None:
            if c.sum() < 20 or not np.any(self.s):
                return
            a = self.s[c]
            h = max(.003, np.ptp(a, 0).max() / 5)
            g, m = np.unique(np.round(a / h).astype(int), return_counts=True, axis=0)
            g, m = g[m > 10] * h, m[m > 10]
            if len(g) < 2:
                return
            cen = (g[np.argsort(-m)[:11]], h)
        self.cen = cen
        g, h = cen
        self.B = np.exp(-((self.s[:, None, :] - g) ** 2).sum(2) / (2 * (.8 * h) ** 2))
        self.B = self.B / np.maximum(self.B.sum(1, keepdims=True), .2)


def tester_data(log, sigma, hz=250.0):
    t = log["t"]
    dt = float(np.median(np.diff(t)))
    cols = [log["depth"][:, None]] + ([log["slip1"][:, None], log["slip2"][:, None]] if "slip1" in log else [])
    X = np.hstack(cols)
    q, dq, _ = smooth(t, X, max(.02, 5 * dt))
    y = [log["normal_force"]] + ([log["tangential_force1"], log["tangential_force2"]] if "tangential_force1" in log else [])
    st = max(int(round(1 / hz / dt)), 1)
    i = slice(None, None, st)
    D = Data()
    D.kind = "tester"
    z = np.zeros((len(t), 2))
    s, v = (q[:, 1:3], dq[:, 1:3]) if "slip1" in log else (z, z)
    ok = lambda a: np.ascontiguousarray(a[i])
    D.common(ok(t), np.column_stack(y)[i], sigma[:len(y)], ok(q[:, 0]), ok(dq[:, 0]), ok(s), ok(v))
    D.nc = len(y)
    D.free = ~D.contact
    return D


def wrench_data(log, rig, chain, sigma, hz=150.0):
    """rig: stated tool (mass, com, inertia), surface (p n t1 t2), gravity, tip."""
    t, q = log["t"], log["q"]
    dt = float(np.median(np.diff(t)))
    qs, dq, _ = smooth(t, q, max(.016, 5 * dt))
    _, _, ddq = smooth(t, q, max(.028, 5 * dt))
    st = max(int(round(1 / hz / dt)), 1)
    i = slice(None, None, st)
    t, qs, dq, ddq = (np.ascontiguousarray(a[i]) for a in (t, qs, dq, ddq))
    n = len(t)
    Pp, R = np.empty((n, 3)), np.empty((n, 3, 3))
    V, W, A, AL = (np.empty((n, 3)) for _ in range(4))
    kin_batch(chain.pack, qs, dq, ddq, Pp, R, V, W, A, AL)
    D = Data()
    D.kind, D.nc, D.rig = "wrench", 6, rig
    loc = lambda b: np.einsum("nji,nj->ni", R, b) if b.ndim == 2 else np.einsum("nji,j->ni", R, b)
    p0, nn, t1, t2 = rig["surf"]
    D.E = [loc(nn), loc(t1), loc(t2)]
    om, al = loc(W), loc(AL)
    D.om, D.al = om, al
    D.Ed = [np.cross(e, om) for e in D.E]
    D.G = loc(rig["gravity"] - A)
    S = lambda a: np.stack([np.stack([0 * a[:, 0], -a[:, 2], a[:, 1]], 1), np.stack([a[:, 2], 0 * a[:, 0], -a[:, 0]], 1),
                            np.stack([-a[:, 1], a[:, 0], 0 * a[:, 0]], 1)], 1)
    So = S(om)
    D.Am = S(al) + So @ So
    D.rel, D.V = Pp - p0, V
    D.proj = [-D.rel @ nn, D.rel @ t1, D.rel @ t2]
    D.projd = [-V @ nn, V @ t1, V @ t2]
    d, dd, s, v = motion(D, rig["tip"])
    y = log["w"][i]
    D.common(t, y, sigma, d, dd, s, v)
    D.free = D.d < -1e-3
    return D


def motion(D, tip):
    E, Ed = D.E, D.Ed
    d = D.proj[0] - E[0] @ tip
    dd = D.projd[0] - Ed[0] @ tip
    s = np.column_stack([D.proj[1] + E[1] @ tip, D.proj[2] + E[2] @ tip])
    v = np.column_stack([D.projd[1] + Ed[1] @ tip, D.projd[2] + Ed[2] @ tip])
    return d, dd, s, v


def stage_contact(D, th):
    base = dict(mu=0.0, ftype=float(D.cap.get("ftype", 0)))
    p = params(**{**base, **{k: v for k, v in th.items() if k in P}})
    if "vr" in th:
        p[P["ftype"]] = 4
    p[P["N0"]] = D.cap.get("N0", 5.0)
    off = np.array([th.get("px", 0.), th.get("py", 0.), th.get("pz", 0.)])
    d, dd, s, v = (D.d, D.dd, D.s, D.v) if not off.any() else motion(D, D.rig["tip"] + off)
    kap, use = (D.B @ th["kap"], True) if "kap" in th and D.B is not None else (np.zeros(1), True)
    if len(kap) == 1:
        kap = np.zeros(D.n)
    o = np.empty((D.n, 3))
    mat_run(p, D.t, d, dd, np.ascontiguousarray(s[:, 0]), np.ascontiguousarray(s[:, 1]), np.ascontiguousarray(v[:, 0]),
            np.ascontiguousarray(v[:, 1]), kap, use, o)
    if D.kind == "tester":
        return o[:, :D.nc]
    f = D.E[0] * o[:, :1] + D.E[1] * o[:, 1:2] + D.E[2] * o[:, 2:3]
    return np.hstack([f, np.cross(np.broadcast_to(D.rig["tip"] + off, f.shape), f)])


def stage_tool(D, th):
    if D.kind == "tester":
        return 0.0
    tl = D.rig["tool"]
    m = tl["mass"] + th.get("dm", 0.)
    c = np.array(tl["com"]) + [th.get("cx", 0.), th.get("cy", 0.), th.get("cz", 0.)]
    I = np.array(tl.get("inertia", [0.] * 6)) + [th.get(k, 0.) for k in ("ixx", "iyy", "izz", "ixy", "ixz", "iyz")]
    M = np.array([[I[0], I[3], I[4]], [I[3], I[1], I[5]], [I[4], I[5], I[2]]])
    f = m * (D.G - D.Am @ c)
    H = D.om @ M
    return np.hstack([f, np.cross(c, f) - D.al @ M - np.cross(D.om, H)])


def stage_sensor(D, th, w):
    nc = D.nc
    if "mx" in th:
        r = np.array([th["mx"], th["my"], th["mz"]])
        w = np.hstack([w[:, :3] - np.cross(r, w[:, :3]), w[:, 3:] - np.cross(r, w[:, 3:])])
    if "g" in th:
        w = w * (1 + th["g"])
    if "x*" in th:
        M = np.zeros((nc, nc))
        M[~np.eye(nc, dtype=bool)] = th["x*"] * D.cap["xs"]
        w = w + w @ M.T
    if "lag" in th:
        o = np.empty_like(w)
        lag_run(np.ascontiguousarray(w), D.dt, th["lag"], o)
        w = o
    if "toff" in th:
        w = np.column_stack([np.interp(D.t - th["toff"], D.t, w[:, c]) for c in range(nc)])
    if "b*" in th:
        w = w + th["b*"] / D.wt
    if "d*" in th:
        w = w + (th["d*"] / D.wt) * D.t[:, None] / 60
    if "h*" in th:
        ph = 2 * np.pi * D.cap.get("hum_f", 50.) * D.t[:, None]
        h = th["h*"].reshape(4, nc) / D.wt
        w = w + h[0] * np.sin(ph) + h[1] * np.cos(ph) + h[2] * np.sin(2 * ph) + h[3] * np.cos(2 * ph)
    if "lim" in th:
        w = w.copy()
        for c in D.cap.get("sat_ch", [0]):
            w[:, c] = np.clip(w[:, c], -th["lim"], th["lim"])
    return w


def starts(D, eff, th0):
    keys, st = TABLE[eff]
    out = []
    for vals in st:
        th = {}
        if keys == ("kap",):
            th["kap"] = np.zeros(D.B.shape[1]) if D.B is not None else np.zeros(0)
        elif keys and keys[0].endswith("*"):
            n = {"b": D.nc, "d": D.nc, "x": D.nc * (D.nc - 1), "h": 4 * D.nc}[keys[0][0]]
            th[keys[0]] = np.zeros(n)
            if keys[0] == "x*":
                i, j = np.where(~np.eye(D.nc, dtype=bool))
                D.cap["xs"] = .02 * np.where((i < 3) & (j >= 3), 10., np.where((i >= 3) & (j < 3), .05, 1.))
        else:
            for k, v in zip(keys, vals):
                if v is None:
                    v = th0.get("n", 1.0)
                elif v == "top":
                    c = D.cap.setdefault("sat_ch", [int(np.argmax(np.abs(D.y[:, :min(3, D.nc)]).max(0)))])
                    v = .97 * np.abs(D.y[:, c[0]]).max()
                elif isinstance(v, str):
                    v = float(v[1:]) * (th0["k"] if v[0] == "k" else D.dmax)
                th[k] = v
        out.append(th)
    return out


def usable(D, eff, model):
    """Could this effect be fitted in such a log at all?"""
    if eff in BASES:
        return False
    if D.kind == "tester" and (TABLE[eff][0][0] in TOOL | {"px", "mx", "g"} or eff == "sensor-crosstalk" or (eff in TANG and D.nc == 1)):
        return False
    if eff in TANG and eff != "coulomb-friction" and "coulomb-friction" not in model and eff != "viscous-friction":
        return False
    if eff == "stiffness-inhomogeneity" and D.B is None:
        return False
    if "none" in model and TABLE[eff][0][0] in LAW:
        return False
    return True


def known_column(D, k, i, stage, idx):
    col = np.zeros((D.n, D.nc))
    nc = D.nc
    if k == "b*":
        col[:, i] = 1.0
    elif k == "d*":
        col[:, i] = D.t / 60
    elif k == "h*":
        ph = 2 * np.pi * D.cap.get("hum_f", 50.) * D.t
        col[:, i % nc] = (np.sin(ph), np.cos(ph), np.sin(2 * ph), np.cos(2 * ph))[i // nc]
    else:
        r, c = np.where(~np.eye(nc, dtype=bool))
        w = stage["law"] + stage["tool"]
        col[:, r[i]] = w[:, c[i]] * D.cap["xs"][i] * D.wt[r[i]]
    return col[idx].ravel()


def pack_free(th, free):
    return [(k, i) for k in free for i in (range(len(th[k])) if isinstance(th[k], np.ndarray) else [None])]


def fit(D, model, th, free, idx=None, iters=8, prior=1e-3, tol=1e-4):
    """LM on the weighted residual over samples idx. Returns theta, prediction (all samples), cost."""
    idx = slice(None) if idx is None else idx
    y, wt = D.y[idx], D.wt
    th = {k: (v.copy() if isinstance(v, np.ndarray) else v) for k, v in th.items()}
    stage = {}

    def full(th, dirty=None):
        s = stage if dirty is not None else {}
        con = stage_contact(D, th) if dirty in (None, "law") else s["law"]
        tool = stage_tool(D, th) if dirty in (None, "tool") else s["tool"]
        if dirty is None:
            stage["law"], stage["tool"] = con, tool
        return stage_sensor(D, th, con + tool)

    slots = pack_free(th, free)
    cur = full(th)
    res = ((y - cur[idx]) * wt).ravel()
    cost = float(res @ res)
    mu, best = 1e-3, cost
    for it in range(iters):
        J = np.empty((res.size, len(slots)))
        for c, (k, i) in enumerate(slots):
            if k in ("b*", "d*", "h*", "x*") and "lim" not in th:    # columns known without a prediction
                J[:, c] = known_column(D, k, i, stage, idx)
                continue
            t2 = dict(th)
            if i is None:
                h = 1e-3 * th[k] if k in LOGP else 1e-3 * SCALE.get(k, .01)
                t2[k] = th[k] + h
                unit = th[k] if k in LOGP else SCALE.get(k, .01)
            else:
                a = th[k].copy()
                unit = .1 if k == "kap" else 1.0
                h = 1e-3 * unit
                a[i] += h
                t2[k] = a
            dirty = "law" if k in LAW else ("tool" if k in TOOL else "sensor")
            J[:, c] = ((full(t2, dirty)[idx] - cur[idx]) * wt).ravel() * (unit / h)
        H, g = J.T @ J, J.T @ res
        ok = False
        for _ in range(5):
            step = np.linalg.solve(H + mu * np.diag(np.diag(H)) + prior * np.eye(len(g)), g)
            t2 = dict(th)
            for c, (k, i) in enumerate(slots):
                if i is None:
                    t2[k] = th[k] * np.exp(np.clip(step[c], -1.0, 1.0)) if k in LOGP else th[k] + step[c] * SCALE.get(k, .01)
                    if k == "n":
                        t2[k] = float(np.clip(t2[k], .6, 3.0))
                    if k in ("comp", "c", "lam") and t2[k] < 0:
                        t2[k] = 1e-9
                else:
                    if t2[k] is th[k]:
                        t2[k] = th[k].copy()
                    t2[k][i] += step[c] * (.1 if k == "kap" else 1.0)
            old = dict(stage)
            new = full(t2)
            r2 = ((y - new[idx]) * wt).ravel()
            c2 = float(r2 @ r2)
            if np.isfinite(c2) and c2 < cost:
                ok = True
                break
            stage.update(old)
            mu = max(mu * 10, 1e-3)
        if not ok:
            break
        gain = (cost - c2) / cost
        th, cur, res, cost, mu = t2, new, r2, c2, mu * .2
        if gain < tol:
            break
    return th, cur, cost


def fit_model(D, model, truth=None, base=None, idx=None, iters=8, scan=1):
    """Refit a list of names. truth: starting values by key where known; base: an earlier fit to start from."""
    th = dict(base) if base else {}
    todo = []
    for e in model:
        keys = TABLE[e][0]
        if base and all(k in base for k in keys):
            continue
        if e in BASES:
            th.update(BASES[e])
        todo.append(e)
    free = [k for e in model for k in TABLE[e][0]]
    cand = [th]
    for e in todo:
        opts = starts(D, e, th if "k" in th else {"k": 1000., "n": 1.})
        if truth and all(k in truth for k in TABLE[e][0]):
            opts = [{k: truth[k] for k in TABLE[e][0]}]
        cand = [{**c, **o} for c in cand for o in opts]
    if len(cand) > scan:
        tried = sorted(((fit(D, model, c, free, idx, iters=2)[2], i) for i, c in enumerate(cand)))
        cand = [cand[i] for _, i in tried[:scan]]
    best = None
    for c in cand:
        r = fit(D, model, c, free, idx, iters)
        if best is None or r[2] < best[2]:
            best = r
    return best
