"""Nonlinear least squares of plain models on a series (Levenberg-Marquardt, numerical Jacobian with the stages cached), the size of an effect,
and the effects that would explain a log as well."""
from __future__ import annotations

import numpy as np

from laws import BASES, FREES, PLAIN, PX, L, S, law, lowpass
from series import cross

TORQUE_ARM = 0.1                                          # scale of moments against forces


class Ruler:
    """A plain model over a series: its parameters and prediction."""

    def __init__(self, ser, effects, sigma):
        self.s, self.effects, self.w = ser, list(effects), 1 / np.asarray(sigma)
        self.base = next((e for e in effects if e in BASES), None)
        self.par = {}
        C = ser.channels
        fs = np.array([1.0, 1, 1, TORQUE_ARM, TORQUE_ARM, TORQUE_ARM])[:C]
        for e in effects:
            self.par.update(FREES.get(e, {}))
            if e == "stiffness-inhomogeneity":
                self.rbf = self._places()
                self.par.update({f"w{i}": S(0.1, -0.95, 5) for i in range(self.rbf.shape[1])})
            elif e == "tool-mass":
                self.par["dm"] = S(0.05, -3, 3)
            elif e == "tool-com":
                self.par.update({f"dc{i}": S(5e-3, -0.2, 0.2) for i in range(3)})
            elif e == "tool-inertia":
                self.par.update({f"I{i}": S(1e-3, -1, 1) for i in range(6)})
            elif e == "tip-offset":
                self.par.update({f"o{i}": S(1e-3, -0.05, 0.05) for i in range(3)})
            elif e == "sensor-bias":
                self.par.update({f"b{i}": S(0.2 * fs[i], -1e3, 1e3) for i in range(C)})
            elif e == "sensor-drift":
                self.par.update({f"r{i}": S(0.2 * fs[i], -1e3, 1e3) for i in range(C)})
            elif e == "sensor-crosstalk":
                for i in range(C):
                    for j in range(C):
                        if i != j:
                            self.par[f"x{i}{j}"] = S(0.02 * fs[i] / fs[j], -1, 1)
            elif e == "sensor-misalignment" and C == 6:
                self.par.update({f"m{i}": S(0.03, -1, 1) for i in range(3)})
            elif e == "sensor-gain":
                self.par["g"] = S(0.05, -0.9, 3)
            elif e == "sensor-lag":
                self.par["lag"] = L(5e-3, 2e-4, 0.5, 2e-3)
            elif e == "time-offset":
                self.par["dt"] = S(5e-3, -0.2, 0.2)
            elif e == "saturation":
                y = np.abs(ser.y[:, :min(3, C)])
                self.satc = int(np.argmax(np.percentile(y, 99.9, axis=0)))
                top = np.percentile(y[:, self.satc], 99.9)
                self.par["sat"] = L(top, 0.2 * top, 3 * top, 0.97 * top)
            elif e == "mains-hum":
                f0 = getattr(ser, "mains", 50.0)
                self.par["fm"] = S(0.05, f0 - 0.5, f0 + 0.5, f0)
                for h in (1, 2, 3):
                    for c in range(C):
                        self.par[f"ha{h}{c}"] = S(0.1 * fs[c], -50, 50)
                        self.par[f"hb{h}{c}"] = S(0.1 * fs[c], -50, 50)
        self.names = list(self.par)
        self.cache = {}

    def _places(self):
        s = self.s
        on = s.contact if s.contact.any() else np.ones(len(s.t), bool)
        n = 7 if np.ptp(s.s2[on]) > 0.3 * np.ptp(s.s1[on]) and np.ptp(s.s1[on]) > 0.3 * np.ptp(s.s2[on]) else 16
        ax = []
        for v in (s.s1, s.s2):
            lo, hi = v[on].min(), v[on].max()
            ax.append((lo, hi))
        long0 = np.ptp(s.s1[on]) >= np.ptp(s.s2[on])
        if n == 16:
            v = s.s1 if long0 else s.s2
            lo, hi = ax[0] if long0 else ax[1]
            c = np.linspace(lo, hi, n)
            B = np.exp(-((v[:, None] - c) / (1.2 * max(c[1] - c[0], 1e-5))) ** 2)
        else:
            c1, c2 = np.linspace(*ax[0], n), np.linspace(*ax[1], n)
            B1 = np.exp(-((s.s1[:, None] - c1) / (1.2 * max(c1[1] - c1[0], 1e-5))) ** 2)
            B2 = np.exp(-((s.s2[:, None] - c2) / (1.2 * max(c2[1] - c2[0], 1e-5))) ** 2)
            B = (B1[:, :, None] * B2[:, None, :]).reshape(len(v), -1)
            B = B[:, B[on].sum(0) > 0.01 * on.sum()]
        B = B - B[on].mean(0)
        u, sv, vt = np.linalg.svd(B[on], full_matrices=False)
        k = min(12, int((sv > 0.03 * sv[0]).sum()))
        return B @ vt[:k].T / (sv[:k] / np.sqrt(on.sum()))

    # internal coordinates
    def pack(self, v):
        return np.array([np.log(v[n] / p[1]) if p[0] == "log" else v[n] / p[1] for n, p in self.par.items()])

    def unpack(self, u):
        out = {}
        for x, (n, p) in zip(u, self.par.items()):
            val = p[1] * np.exp(min(x, 60.0)) if p[0] == "log" else x * p[1]
            out[n] = min(max(val, p[2]), p[3])
        return out

    def start(self, given=None, which=0):
        v = {n: p[4][min(which, len(p[4]) - 1)] for n, p in self.par.items()}
        s = self.s
        if "k" in v:
            on = s.contact & (s.d > 0.2 * np.percentile(s.d, 99))
            x = s.d[on] ** BASES[self.base]
            v["k"] = max(float(x @ s.Fm[on] / (x @ x)), 1.0)
        if "n" in v:
            v["n"] = BASES[self.base]
        if "ld" in v:
            v["ld"] = 0.6 * np.percentile(s.d, 99)
        if given:
            v.update({k: x for k, x in given.items() if k in v})
        return v

    def predict(self, v):
        s = self.s
        C = s.channels
        p = np.zeros(len(PX))
        for k, x in PLAIN.items():
            p[PX[k]] = x
        p[PX["n"]] = BASES.get(self.base, 1.0)
        for k in v:
            if k in PX:
                p[PX[k]] = v[k]
        if self.base == "maxwell":
            p[PX["r"]] = 1.0
        p[PX["n0"]] = self.n0 = getattr(self, "n0", max(np.median(s.Fm[s.contact]) if s.contact.any() else 1.0, 1e-3))
        if "friction-rounding" not in self.effects:
            p[PX["vr"]] = 0.0
        o = np.array([v.get(f"o{i}", 0.0) for i in range(3)])
        w = np.array([v[f"w{i}"] for i in range(self.rbf.shape[1])]) if "stiffness-inhomogeneity" in self.effects else np.zeros(0)
        key = (p.tobytes(), o.tobytes(), w.tobytes())
        T = self.cache.get(key)
        if T is None:
            prof = self.rbf @ w if len(w) else np.zeros(len(s.t))
            if len(s.tf) != len(s.t):
                prof = np.interp(s.tf, s.t, prof)
            d, s1, s2 = s.D
            dd, v1, v2 = s.V
            if o.any():
                up = lambda x: np.interp(s.tf, s.t, x)
                d, s1, s2 = d - up(s.en @ o), s1 + up(s.e1 @ o), s2 + up(s.e2 @ o)
                r = np.cross(s.w, o)
                dd = dd - up((r * s.en).sum(1))
                v1, v2 = v1 + up((r * s.e1).sum(1)), v2 + up((r * s.e2).sum(1))
            if self.base is None:
                T = np.zeros((len(s.t), 3))
            else:
                T = law(s.tf, d, dd, s1, s2, v1, v2, s.FD, s.dFD, prof, p)[s.sub]
            if len(self.cache) > 3:
                self.cache.clear()
            self.cache[key] = T
        if C == 6:
            Fs = T[:, :1] * s.en + T[:, 1:2] * s.e1 + T[:, 2:] * s.e2
            m = s.mass + v.get("dm", 0.0)
            c = s.com + np.array([v.get(f"dc{i}", 0.0) for i in range(3)])
            I = s.I0
            if "I0" in v:
                a, b, d_, e, f, g = (v[f"I{i}"] for i in range(6))
                I = np.array([[a, e, f], [e, b, g], [f, g, d_]]) + (0 if s.I0 is None else s.I0)
            ft, tt = s.tool(m, c, I)
            Y = np.column_stack([Fs + ft, tt - cross(Fs, s.tip + o)])
        else:
            Y = T[:, :C].copy()
        if "dt" in v:
            Y = np.column_stack([np.interp(s.t - v["dt"], s.t, Y[:, c]) for c in range(C)])
        if "lag" in v:
            Y = lowpass(s.t, Y, v["lag"])
        if "g" in v:
            Y = Y * (1 + v["g"])
        if "m0" in v:
            r = np.array([v["m0"], v["m1"], v["m2"]])
            Y = np.column_stack([Y[:, :3] + cross(Y[:, :3], r), Y[:, 3:] + cross(Y[:, 3:], r)])
        self.before = Y
        if "x01" in v:
            X = np.eye(C)
            for i in range(C):
                for j in range(C):
                    if i != j:
                        X[i, j] = v[f"x{i}{j}"]
            Y = Y @ X.T
        if "b0" in v:
            Y = Y + np.array([v[f"b{i}"] for i in range(C)])
        if "r0" in v:
            Y = Y + s.t[:, None] / 60 * np.array([v[f"r{i}"] for i in range(C)])
        if "fm" in v:
            for h in (1, 2, 3):
                if not any(v[f"ha{h}{c}"] or v[f"hb{h}{c}"] for c in range(C)):
                    continue
                ph = 2 * np.pi * h * v["fm"] * s.t
                Y = Y + np.sin(ph)[:, None] * np.array([v[f"ha{h}{c}"] for c in range(C)]) + np.cos(ph)[:, None] * np.array([v[f"hb{h}{c}"] for c in range(C)])
        if "sat" in v:
            Y = Y.copy()
            Y[:, self.satc] = np.clip(Y[:, self.satc], -v["sat"], v["sat"])
        return Y

    def straight(self, name, v, before):
        """Channel and derivative of a parameter in which the prediction is linear, or None."""
        if "sat" in v:
            return None
        s = self.s
        if name[0] == "b" and name[1:].isdigit():
            return int(name[1:]), np.ones(len(s.t))
        if name[0] == "r" and name[1:].isdigit():
            return int(name[1:]), s.t / 60
        if name[0] == "x" and name[1:].isdigit():
            return int(name[1]), before[:, int(name[2])]
        if name[:2] in ("ha", "hb") and name[2:].isdigit():
            ph = 2 * np.pi * int(name[2]) * v["fm"] * s.t
            return int(name[3]), np.sin(ph) if name[1] == "a" else np.cos(ph)
        return None

    def fit(self, start, iters=25, tol=2e-4):
        u = self.pack(start)
        v = self.unpack(u)
        y = self.s.y
        r = ((y - self.predict(v)) * self.w).ravel()
        sse = r @ r
        lam = 1e-3
        for it in range(iters):
            J = np.zeros((len(r), len(u)), order="F")
            self.predict(v)
            before = self.before
            for j in range(len(u)):
                col = self.straight(self.names[j], v, before)
                if col is not None:
                    c, x = col
                    J[c::self.s.channels, j] = -x * self.w[c] * self.par[self.names[j]][1]
                    continue
                h = 1e-3 if abs(u[j]) < 100 else 1e-3
                if self.names[j] == "fm":
                    h = 1e-2
                x = u.copy()
                x[j] += h
                vj = self.unpack(x)
                if vj == v:
                    x[j] -= 2 * h
                    h = -h
                    vj = self.unpack(x)
                J[:, j] = (((y - self.predict(vj)) * self.w).ravel() - r) / h
            A = J.T @ J
            b = -J.T @ r
            done = False
            for _ in range(7):
                try:
                    st = np.linalg.solve(A + lam * np.diag(np.diag(A)) + 1e-9 * np.trace(A) / len(u) * np.eye(len(u)), b)
                except np.linalg.LinAlgError:
                    st = np.zeros_like(b)
                st = np.clip(st, -8, 8)
                x = u + st
                vx = self.unpack(x)
                rx = ((y - self.predict(vx)) * self.w).ravel()
                sx = rx @ rx
                if sx < sse:
                    done = sse - sx < tol * sse
                    u, v, r, sse = self.pack_safe(vx, x), vx, rx, sx
                    lam = max(lam / 5, 1e-7)
                    break
                lam *= 6
            else:
                done = True
            if done:
                break
        self.v, self.sse = v, sse
        self.pred = self.predict(v)
        self.res = y - self.pred
        return self

    def pack_safe(self, v, x):
        """Internal coordinates, those beyond a bound brought back onto it."""
        out = x.copy()
        for j, (n, p) in enumerate(self.par.items()):
            if p[0] == "lin":
                out[j] = v[n] / p[1]
            elif v[n] > 0:
                out[j] = np.log(v[n] / p[1])
        return out


ZERO = {"hertz-exponent": ("n", None), "viscous-damping": ("c", 0), "hunt-crossley-damping": ("lam", 0), "relaxation": ("r", 0), "hysteresis": ("ha", 0),
        "stress-softening": ("mr", 0), "adhesion": ("fa", 0), "stiffening-layer": ("lk", 0), "surface-offset": ("z0", 0), "stiffness-drift": ("alpha", 0),
        "coulomb-friction": ("mu", 0), "viscous-friction": ("cv", 0), "stribeck-friction": ("dmu", 0), "presliding": ("bl", 1e-4),
        "friction-rounding": ("vr", 1e-4), "load-dependent-friction": ("p", 0), "friction-anisotropy": ("ani", 0), "structural-compliance": ("C", 0),
        "tool-mass": ("dm", 0), "sensor-gain": ("g", 0), "sensor-lag": ("lag", 1e-5), "time-offset": ("dt", 0), "saturation": ("sat", 1e9)}
PREFIX = {"stiffness-inhomogeneity": "w", "tool-com": "dc", "tool-inertia": "I", "tip-offset": "o", "sensor-bias": "b", "sensor-drift": "r",
          "sensor-crosstalk": "x", "sensor-misalignment": "m", "mains-hum": "h"}


def without(ruler, effect):
    """The fitted prediction with one effect switched off, the rest kept."""
    v = dict(ruler.v)
    if effect in ZERO:
        k, z = ZERO[effect]
        v[k] = BASES[ruler.base] if z is None else z
    else:
        pre = PREFIX[effect]
        for k in v:
            if k.startswith(pre) and (k[len(pre):].isdigit() or effect == "mains-hum" and k[:2] in ("ha", "hb") and k not in ("ha",)):
                v[k] = 0.0
    keep, ruler.cache = ruler.cache, {}
    out = ruler.predict(v)
    ruler.cache = keep
    return out


def rms(x):
    return float(np.sqrt(np.mean(np.square(x)))) if np.size(x) else 0.0
