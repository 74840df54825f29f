"""Plain catalogue forms for contact logs (arm with wrench, material tester): what each name adds, predictions from the measured motion."""
import numpy as np
from scipy.signal import savgol_filter

import laws
from robots import expm, mv, skew

LOG, LIN = "log", "lin"
# name -> [(parameter, start, scale (LIN) or None, kind)], then starts to try when the name is a candidate
BASES = {
    "none": ([], {}),
    "hooke": ([("k", 1000., None, LOG)], {}),
    "kelvin-voigt": ([("k", 1000., None, LOG), ("c", 1., 1., LIN)], {}),
    "hertz": ([("k", 3e4, None, LOG)], {"n": 1.5}),
    "hunt-crossley": ([("k", 3e4, None, LOG), ("lam", 0.3, 0.3, LIN)], {"n": 1.5}),
    "zener": ([("k", 1000., None, LOG), ("ratio", 0.3, 0.2, LIN), ("tau", 0.5, None, LOG)], {}),
}
EFFECTS = {
    "hertz-exponent": ([("n", None, 0.1, LIN)], [{}]),
    "viscous-damping": ([("c", 0., 1., LIN)], [{}]),
    "hunt-crossley-damping": ([("lam", 0., 0.2, LIN)], [{}]),
    "relaxation": ([("ratio", 0.1, 0.1, LIN), ("tau", 0.5, None, LOG)], [{"tau": 0.08}, {"tau": 0.6}, {"tau": 4.}, {"tau": 20.}]),
    "hysteresis": ([("Ah", 0., 0.05, LIN), ("Lh", 3e-4, None, LOG)], [{"Lh": 1e-4}, {"Lh": 5e-4}, {"Lh": 2e-3}]),
    "stress-softening": ([("rm", 0., 0.1, LIN), ("lm", 1e-3, None, LOG)], [{"lm": 3e-4}, {"lm": 2e-3}]),
    "adhesion": ([("Fa", 0., 0.05, LIN), ("La", 4e-4, None, LOG)], [{"La": 2e-4}, {"La": 8e-4}]),
    "stiffening-layer": ([("K2", 0., 300., LIN), ("db", 2e-3, None, LOG)], [{"db": 0.35}, {"db": 0.6}, {"db": 0.8}]),   # x deepest
    "surface-offset": ([("z0", 0., 2e-5, LIN)], [{}]),
    "stiffness-drift": ([("alpha", 0., 0.05, LIN)], [{}]),
    "stiffness-inhomogeneity": ([(f"inh{i}", 0., 0.05, LIN) for i in range(16)], [{}]),
    "coulomb-friction": ([("mu", 0.1, 0.05, LIN)], [{}]),
    "viscous-friction": ([("cv", 0., 1., LIN)], [{}]),
    "stribeck-friction": ([("dmu", 0., 0.03, LIN), ("vs", 5e-3, None, LOG)], [{"vs": 2e-3}, {"vs": 8e-3}, {"vs": 2.5e-2}]),
    "presliding": ([("L", 1e-4, None, LOG)], [{"L": 2e-4}, {"L": 6e-4}]),
    "friction-rounding": ([("vr", 3e-3, None, LOG)], [{"vr": 3e-4}, {"vr": 3e-3}, {"vr": 1e-2}]),
    "load-dependent-friction": ([("p", 0., 0.05, LIN)], [{}]),
    "friction-anisotropy": ([("an", 0., 0.05, LIN)], [{}]),
    "tool-mass": ([("dm", 0., 0.01, LIN)], [{}]),
    "tool-com": ([(f"dc{i}", 0., 1e-3, LIN) for i in range(3)], [{}]),
    "tool-inertia": ([(f"I{i}", 0., 1e-3, LIN) for i in range(6)], [{}]),
    "structural-compliance": ([("C", 1e-6, 1e-5, LIN)], [{}]),
    "tip-offset": ([(f"d{i}", 0., 1e-3, LIN) for i in range(3)], [{}]),
    "sensor-bias": ([(f"bias{i}", 0., 0.02 if i < 3 else 1e-3, LIN) for i in range(6)], [{}]),
    "sensor-drift": ([(f"drift{i}", 0., 0.05 if i < 3 else 2e-3, LIN) for i in range(6)], [{}]),
    "sensor-crosstalk": ([(f"X{i}{j}", 0., 0.01, LIN) for i in range(6) for j in range(6) if i != j and (i > 2 or j < 3)], [{}]),
    "sensor-misalignment": ([(f"rot{i}", 0., 0.01, LIN) for i in range(3)], [{}]),
    "sensor-gain": ([("g", 0., 0.01, LIN)], [{}]),
    "sensor-lag": ([("lag", 4e-3, None, LOG)], [{"lag": 1e-3}, {"lag": 8e-3}]),
    "time-offset": ([("dt", 0., 3e-3, LIN)], [{}]),
    "saturation": ([], []), "quantization": ([], []), "mains-hum": ([(f"hum{i}", 0., 0.02, LIN) for i in range(12)], [{}]),
}
NORMAL = {"hertz-exponent", "viscous-damping", "hunt-crossley-damping", "relaxation", "hysteresis", "stress-softening", "adhesion",
          "stiffening-layer", "surface-offset", "stiffness-drift", "stiffness-inhomogeneity", "structural-compliance"}
TANGENT = {"coulomb-friction", "viscous-friction", "stribeck-friction", "presliding", "friction-rounding", "load-dependent-friction",
           "friction-anisotropy"}
TORQUE = {"tool-com", "tool-inertia", "tip-offset"}
WRENCH_ONLY = {"tool-mass", "tool-com", "tool-inertia", "tip-offset", "sensor-crosstalk", "sensor-misalignment", "sensor-gain"}
HUM = (50.0, 100.0)


def parameters(names):
    """free parameters of a model and its fixed settings."""
    free, fixed = {}, {}
    for n in names:
        if n in BASES:
            ps, fx = BASES[n]
            fixed.update(fx)
        else:
            ps = EFFECTS[n][0]
        for p, start, scale, kind in ps:
            free[p] = (start, scale, kind)
    fixed["mode"] = laws.ROOT if "friction-rounding" in names else laws.DAHL if "presliding" in names else laws.BRUSH
    if "n" in free:
        free["n"] = (fixed.pop("n", 1.0),) + free["n"][1:]
    return free, fixed


class Contact:
    """the measured motion on a fine grid and the readings of one log, thinned; arm=None: a tester, depth and slips are given."""

    def __init__(self, log, rig, limit=4500, fine=330.0, arm=None):
        self.tester = arm is None
        t0 = log["t"]
        fs = (len(t0) - 1) / (t0[-1] - t0[0])
        t = np.arange(t0[0], t0[-1], 1 / fs)
        m = max(int(fs // fine), 1)
        self.tf = t[::m]
        keep = np.arange(0, len(t0), m)                       # rows on the fine grid if the clock is even; a random share, for no beat
        if len(keep) > limit:
            keep = np.sort(np.random.default_rng(7).choice(keep, limit, replace=False))
        keep = keep[t0[keep] <= self.tf[-1]]
        self.rows, self.t = keep, t0[keep]
        i = np.clip(np.searchsorted(self.tf, self.t, side="right") - 1, 0, len(self.tf) - 2)
        self.i, self.wt = i, ((self.t - self.tf[i]) / (self.tf[i + 1] - self.tf[i]))[:, None]
        cols = ["depth", "slip1", "slip2"] if self.tester else [f"q{i + 1}" for i in range(arm.nq)]
        cols = [c for c in cols if c in log]
        q = np.stack([np.interp(t, t0, log[c]) for c in cols], 1)
        at = lambda x: np.stack([np.interp(self.tf, t, x[:, j]) for j in range(x.shape[1])], 1)

        def smooth(width, k):
            w = max(int(round(width * fs)) | 1, 5)
            return at(savgol_filter(q, w, 3, deriv=k, delta=1 / fs, axis=0))

        w0 = 0.012 if self.tester else 0.02
        x, dx = smooth(w0, 0), smooth(w0, 1)
        if self.tester:
            self.depth, self.rate = x[:, 0].copy(), dx[:, 0].copy()
            self.slip = x[:, 1:].copy() if x.shape[1] > 1 else np.zeros((len(x), 2))
            self.vel = dx[:, 1:].copy() if x.shape[1] > 1 else np.zeros((len(x), 2))
            self.cols = ["normal_force"] + (["tangential_force1", "tangential_force2"] if "slip1" in log else [])
        else:
            m = arm.sensor_motion(x, dx, smooth(0.05, 2))
            self.m, self.r_tip = m, arm.tip_in_sensor
            s = rig["surface"]
            nrm = np.array(s["normal"], float)
            self.axes = np.stack([s["tangent"], np.cross(nrm, s["tangent"]), nrm])
            self.point = np.array(s["point"], float)
            RT = np.swapaxes(m["R"], 1, 2)
            K = skew(m["w"])
            whole = [[mv(RT, a) for a in self.axes], mv(RT, np.array([0, 0, -9.81])) - m["a"], skew(m["al"]) + K @ K, m["w"], m["al"]]
            self.on = {True: whole, False: [[x[i] for x in whole[0]]] + [x[i] for x in whole[1:]]}
            self.mass, self.com = rig["tool"]["mass"], np.array(rig["tool"]["com"], float)
            self.cols = ["fx", "fy", "fz", "tx", "ty", "tz"]
            self.R = m["R"][i]
            self.last_d, self.cache = None, []
            self.geometry(np.zeros(3))
        self.y = np.stack([log[c][keep] for c in self.cols], 1)
        self.deepest = float(self.depth.max())
        self.depth_r = self.depth[i]
        self.contact = self.depth_r > 0
        self.slip_c = self.slip[i][self.contact]
        lo, hi = self.slip_c.min(0), self.slip_c.max(0)
        self.centres = np.stack(np.meshgrid(*[np.linspace(a, b, 4) for a, b in zip(lo, hi)]), -1).reshape(-1, 2)
        self.width = np.maximum((hi - lo) / 3, 1e-4)
        self.N0 = 1.0
        self.bumps, self.cache = None, []

    def geometry(self, d):
        if self.last_d is not None and np.array_equal(d, self.last_d):
            return
        m = self.m
        off = mv(m["R"], d)
        p, v = m["p"] + off - self.point, m["v"] + np.cross(m["w_base"], off)
        c, r = p @ self.axes.T, v @ self.axes.T
        self.depth, self.rate, self.slip, self.vel = -c[:, 2].copy(), -r[:, 2].copy(), c[:, :2].copy(), r[:, :2].copy()
        self.arm_r, self.last_d, self.cache = self.r_tip + d, np.array(d), []

    def contact_forces(self, p):
        """N, T1, T2 on the fine grid; the last few are kept, for many parameters leave them alone."""
        key = tuple(sorted((k, v) for k, v in p.items() if k[:2] not in ("bi", "dr", "hu", "li", "ro", "dc", "dm") and k[0] not in "XIg"
                           and k not in ("lag", "dt")))
        for k, v in self.cache:
            if k == key:
                return v
        t, get = self.tf, p.get
        depth = self.depth + get("z0", 0.)
        T1 = T2 = N = np.zeros(len(t))
        if get("k", 0.):
            gain = get("k") * (1 + get("alpha", 0.) * (t - t[0]) / 60)
            if "inh0" in p:
                if self.bumps is None:
                    x = (self.slip[:, None] - self.centres) / self.width
                    self.bumps = np.exp(-0.5 * (x ** 2).sum(-1))
                gain = gain * (1 + self.bumps @ np.array([p[f"inh{i}"] for i in range(16)]))
            N, _ = laws.normal(p, t, depth, self.rate, gain)
            if get("mu", 0.) or get("cv", 0.):
                T1, T2 = laws.tangential({**p, "N0": self.N0}, t, self.slip[:, 0].copy(), self.slip[:, 1].copy(), self.vel[:, 0].copy(),
                                         self.vel[:, 1].copy(), np.maximum(N, 0))
        out = np.stack([N, T1, T2], 1)
        self.cache = [(key, out)] + self.cache[:2]
        return out

    def predict(self, p):
        get = p.get
        if not self.tester:
            self.geometry(np.array([get("d0", 0.), get("d1", 0.), get("d2", 0.)]))
        C = self.contact_forces(p)
        chain = {k: v for k, v in p.items() if k[:3] == "rot" or k[0] == "X" or k in ("g", "lag", "dt")}
        slow = bool(get("lag") or get("dt"))
        down = lambda W: W[self.i] * (1 - self.wt) + W[self.i + 1] * self.wt
        if not slow:
            C = down(C)
        if self.tester:
            W = C[:, :len(self.cols)]
        else:
            b, g, spin, w, al = self.on[slow]
            f = C[:, :1] * b[2] + C[:, 1:2] * b[0] + C[:, 2:3] * b[1]
            com = self.com + [get("dc0", 0.), get("dc1", 0.), get("dc2", 0.)]
            ft = (self.mass + get("dm", 0.)) * (g - spin @ com)
            tq = cross(com, ft) + cross(self.arm_r, f)
            I = [get(f"I{i}", 0.) for i in range(6)]
            if any(I):
                M = np.array([[I[0], I[3], I[4]], [I[3], I[1], I[5]], [I[4], I[5], I[2]]])
                tq = tq - al @ M - np.cross(w, w @ M)
            W = np.concatenate([f + ft, tq], 1)
        W = sensor(W, self.tf, chain)
        if slow:
            W = down(W)
        return sensor(W, self.t, {k: v for k, v in p.items() if k[:4] == "bias" or k[:5] == "drift" or k[:3] in ("hum", "lim")})

    def metric(self, names, res, clip=None):
        """residuals that belong to these effects, as one vector: their channels, where they act."""
        name = names[0]
        if self.tester:
            if name in TANGENT:
                return res[self.contact][:, 1:].ravel()
            r = res[:, 0] if name in {"sensor-bias", "sensor-drift", "quantization", "mains-hum", "adhesion"} else res[self.contact, 0]
        elif name in TORQUE:
            r = res[:, 3:] if name != "tip-offset" else res[self.contact, 3:]
        elif name in NORMAL or name in TANGENT:
            f = mv(self.R, res[:, :3]) @ self.axes.T
            r = f[self.contact, 2] if name in NORMAL - {"adhesion"} else f[self.contact, :2] if name in TANGENT else f[:, 2]
        else:
            r = res[:, :3]
        if name == "adhesion":
            r = r[np.abs(self.depth_r + 1e-4) < 4e-4]
        if name == "saturation":
            ch, lim = clip
            r = res[np.abs(self.y[:, ch]) > 0.97 * lim, ch]
        return np.asarray(r).ravel()


def cross(a, b):
    """constant a (3,) times rows of b."""
    return np.stack([a[1] * b[:, 2] - a[2] * b[:, 1], a[2] * b[:, 0] - a[0] * b[:, 2], a[0] * b[:, 1] - a[1] * b[:, 0]], 1)


def wrench(f, r, m, com, I, g, w, al):
    """contact force f at r, tool (m, com, inertia about the com) under specific force g (gravity minus the origin's acceleration)."""
    ft = m * (g - np.cross(al, com) - np.cross(w, np.cross(w, com)))
    tq = np.cross(com, ft) + np.cross(r, f)
    if np.any(I):
        M = np.array([[I[0], I[3], I[4]], [I[3], I[1], I[5]], [I[4], I[5], I[2]]])
        tq = tq - al @ M - np.cross(w, w @ M)
    return np.concatenate([f + ft, tq], 1)


def sensor(W, t, p):
    """sensor and acquisition: misalignment, gain, crosstalk, lag, clock, bias, drift, hum, clip."""
    n = W.shape[1]
    if any(k.startswith("rot") for k in p):
        Rm = expm(np.array([p.get("rot0", 0.), p.get("rot1", 0.), p.get("rot2", 0.)]))
        W = np.concatenate([W[:, :3] @ Rm, W[:, 3:] @ Rm], 1)
    if p.get("g", 0.):
        W = W * (1 + p["g"])
    X = np.array([[p.get(f"X{i}{j}", 0.) for j in range(n)] for i in range(n)]) if any(k[0] == "X" for k in p) else None
    if X is not None:
        W = W + W @ X.T
    if p.get("lag", 0.) > 0:
        W = laws.lowpass(t, np.ascontiguousarray(W), p["lag"])
    if p.get("dt", 0.):
        W = np.stack([np.interp(t - p["dt"], t, W[:, j]) for j in range(n)], 1)
    for key, f in (("bias", 1.0), ("drift", (t - t[0])[:, None] / 60)):
        if key + "0" in p:
            W = W + np.array([p.get(f"{key}{i}", 0.) for i in range(n)]) * f
    if "hum0" in p:
        s, m = p.get("hum_f", 50.0), min(n, 3)
        for h in (1, 2):
            c = [p.get(f"hum{6 * (h - 1) + i}", 0.) for i in range(6)]
            a = 2 * np.pi * s * h * t[:, None]
            W = W + np.pad(np.cos(a) * c[:m] + np.sin(a) * c[3:3 + m], ((0, 0), (0, n - m)))
    if "lim" in p:
        W = W.copy()
        W[:, p["lim_ch"]] = np.clip(W[:, p["lim_ch"]], -p["lim"], p["lim"])
    return W
