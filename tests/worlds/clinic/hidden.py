"""The effects as they are put into the truth of contact logs: amplitude -> parameters, bounds, what the motion must hold; and things that
no name of the catalogue stands for."""
import numpy as np

import laws
import material

# start amplitude, least, most (SI; for some relative), words for the motion
SPEC = {
    "hertz-exponent": (0.15, 0.02, 0.9, {"deep"}),
    "viscous-damping": (5.0, 0.1, 400.0, {"fast"}),
    "hunt-crossley-damping": (0.5, 0.02, 8.0, {"fast", "deep"}),
    "relaxation": (0.15, 0.01, 2.0, set()),
    "hysteresis": (0.2, 0.005, 4.0, set()),
    "stress-softening": (0.1, 0.01, 0.7, {"deep"}),
    "adhesion": (0.2, 0.01, 3.0, {"slow_retract"}),
    "stiffening-layer": (0.3, 0.02, 6.0, {"deep"}),
    "surface-offset": (1e-4, 1e-5, 2e-3, {"tilt"}),
    "stiffness-drift": (0.15, 0.005, 1.2, {"places"}),
    "stiffness-inhomogeneity": (0.15, 0.01, 0.9, {"places"}),
    "coulomb-friction": (0.1, 0.005, 1.0, set()),
    "viscous-friction": (5.0, 0.1, 300.0, set()),
    "stribeck-friction": (0.08, 0.003, 0.8, set()),
    "presliding": (3.0, 1.2, 40.0, {"micro"}),
    "friction-rounding": (0.15, 5e-3, 0.8, set()),
    "load-dependent-friction": (0.15, 0.01, 0.7, set()),
    "friction-anisotropy": (0.15, 0.01, 0.6, {"diagonal"}),
    "tool-mass": (0.02, 1e-3, 0.5, set()),
    "tool-com": (3e-3, 1e-4, 4e-2, set()),
    "tool-inertia": (1.5e-3, 5e-5, 2e-2, {"shake"}),
    "structural-compliance": (2e-5, 5e-7, 6e-4, {"deep", "fast"}),
    "tip-offset": (2e-3, 1e-4, 1.5e-2, {"tilt"}),
    "sensor-bias": (0.1, 5e-3, 3.0, set()),
    "sensor-drift": (0.2, 5e-3, 3.0, set()),
    "sensor-crosstalk": (0.02, 1e-3, 0.12, set()),
    "sensor-misalignment": (0.02, 1e-3, 0.2, set()),
    "sensor-gain": (0.03, 1e-3, 0.2, set()),
    "sensor-lag": (8e-3, 5e-4, 8e-2, {"fast", "shake"}),
    "time-offset": (8e-3, 5e-4, 6e-2, {"fast", "shake"}),
    "saturation": (0.15, 0.02, 0.55, {"deep"}),
    "quantization": (0.15, 5e-3, 2.0, set()),
    "mains-hum": (0.06, 2e-3, 1.0, set()),
}
FRICTIONAL = {"viscous-friction", "stribeck-friction", "presliding", "friction-rounding", "load-dependent-friction", "friction-anisotropy"}


class Hidden:
    """one hidden effect: its fixed draws (times, lengths, directions); put(p, a, ctx) writes it into the truth's parameters."""

    def __init__(self, rng, name, ctx):
        u = rng.uniform
        self.name, self.ctx = name, ctx
        D = ctx["depth"]
        self.sign = 1 if u() < 0.5 else -1
        self.dir3 = rng.normal(size=3)
        self.dir3 /= np.linalg.norm(self.dir3)
        self.dir3b = rng.normal(size=3)
        self.dir3b /= np.linalg.norm(self.dir3b)
        self.tau = float(np.exp(u(np.log(0.15), np.log(4.0))))
        self.spread = float(rng.choice([0, 0, u(0.2, 0.6)]))
        self.length = D * float(np.exp(u(np.log(0.05), np.log(0.4))))
        self.rich = u() < 0.6
        self.db = D * u(0.45, 0.7)
        self.vs = float(np.exp(u(np.log(3e-3), np.log(1.2e-2))))
        self.field = dict(kind=str(rng.choice(["bump", "edge", "gradient"])), x=u(-0.2, 0.2), y=u(-0.2, 0.2), w=u(0.25, 0.45), ang=u(0, 6.28))
        self.vr = u(3e-3, 1e-2)
        self.La = u(2e-4, 8e-4)
        self.cells = rng.normal(size=(6, 6)) * (rng.random((6, 6)) < 0.45)
        self.cells[1, 0] = self.cells[0, 2] = 1.0
        self.channel = int(rng.choice([2, 2, 0])) if ctx["kind"] == "wrench" else 0
        self.behind = u() < 0.5
        self.hum_f = float(rng.choice([50.0, 60.0]))
        self.hum = rng.normal(size=12) * np.repeat([1.0, u(0.1, 0.5)], 6)
        self.grow = u(0.5, 1.5)

    def put(self, p, a):
        n, D, s, ctx = self.name, self.ctx["depth"], self.sign, self.ctx
        if n == "hertz-exponent":
            p["n"] = p["n"] + a
            p["k"] = p["k"] * D ** -a
        elif n == "viscous-damping":
            p["c"] = a
        elif n == "hunt-crossley-damping":
            p["lam"] = a
        elif n == "relaxation":
            p.update(material.branches(np.random.default_rng(1), a, self.tau, self.spread * ctx["off"]))
        elif n == "hysteresis":
            p.update(material.hysteresis(a, self.length, self.rich))
        elif n == "stress-softening":
            p["rm"], p["lm"] = a, self.length * 2
        elif n == "adhesion":
            p["Fa"], p["La"], p["neck"] = a, self.La, 0.15 * self.rich * ctx["off"]
        elif n == "stiffening-layer":
            p["K2"], p["db"] = a * p["k"] * p["n"] * D ** (p["n"] - 1), self.db
            p["rnd"] = 0.12 * self.db * self.rich * ctx["off"]
        elif n == "surface-offset":
            p["z0"] = s * a
        elif n == "stiffness-drift":
            p["alpha"] = s * a
        elif n == "stiffness-inhomogeneity":
            p["field"] = dict(self.field, a=s * a)
        elif n == "coulomb-friction":
            p["mu"] = a
        elif n == "viscous-friction":
            p["cv"] = a
        elif n == "stribeck-friction":
            p["dmu"], p["vs"] = a, self.vs
        elif n == "presliding":
            p["L"] = np.asarray(p["L"]) * (1 + a)
        elif n == "friction-rounding":
            p["mode"], p["vr"], p["mu"] = laws.ROOT, self.vr, a            # the amplitude is the friction's: mu
        elif n == "load-dependent-friction":
            p["p"], p["N0"] = (-a if s < 0 or a > 0.35 else a), ctx["Fmax"] * 0.5
        elif n == "friction-anisotropy":
            p["an"] = s * a
        elif n == "tool-mass":
            p["dm"] = s * a if a < 0.4 * ctx.get("tool", 1.0) else a
        elif n == "tool-com":
            d = self.dir3 * np.array([1, 1, 0.5])
            p.update({f"dc{i}": a * d[i] for i in range(3)})
        elif n == "tool-inertia":
            p.update({f"I{i}": a * v for i, v in enumerate((1.0, 0.8 * self.grow ** 0.3, 0.6, 0.0, 0.0, 0.0))})
        elif n == "structural-compliance":
            p["C"] = a
        elif n == "tip-offset":
            d = self.dir3 * np.array([1, 1, 0.4])
            p.update({f"d{i}": a * d[i] for i in range(3)})
        elif n in ("sensor-bias", "sensor-drift"):
            key = "bias" if n == "sensor-bias" else "drift"
            m = 6 if ctx["kind"] == "wrench" else 1
            v = np.concatenate([self.dir3 * a, self.dir3b * a * 0.025])[:m] if m == 6 else [s * a] + [0.0] * 2
            p.update({f"{key}{i}": float(x) for i, x in enumerate(v)})
        elif n == "sensor-crosstalk":
            for i in range(6):
                for j in range(6):
                    if i != j and (i > 2 or j < 3) and self.cells[i, j]:
                        p[f"X{i}{j}"] = float(a * np.clip(self.cells[i, j], -1.5, 1.5) * (0.05 if i > 2 > j else 1.0))
        elif n == "sensor-misalignment":
            p.update({f"rot{i}": float(a * self.dir3[i]) for i in range(3)})
        elif n == "sensor-gain":
            p["g"] = s * a
        elif n == "sensor-lag":
            p["lag"] = a
        elif n == "time-offset":
            p["dt"] = s * a
        elif n == "mains-hum":
            p["hum_f"] = self.hum_f
            p.update({f"hum{i}": float(a * v) for i, v in enumerate(self.hum)})

    def describe(self, a):
        d = {"amplitude": float(a)}
        keys = {"relaxation": ["tau", "spread"], "hysteresis": ["length", "rich"], "stress-softening": ["length"], "adhesion": ["La"],
                "stiffening-layer": ["db", "rich"], "stribeck-friction": ["vs"], "friction-rounding": ["vr"], "mains-hum": ["hum_f"], "saturation": ["channel", "behind"],
                "stiffness-inhomogeneity": ["field"], "quantization": []}.get(self.name, [])
        d.update({k: getattr(self, k) for k in keys})
        return d


def field(f, s, width):
    """1 + a * profile over place s (n, 2); width: the visited half width."""
    if not f:
        return 1.0
    x = s / width - np.array([f["x"], f["y"]])
    if f["kind"] == "bump":
        g = np.exp(-0.5 * (x ** 2).sum(1) / f["w"] ** 2)
    else:
        y = x @ np.array([np.cos(f["ang"]), np.sin(f["ang"])])
        g = 0.5 * np.tanh(y / f["w"]) if f["kind"] == "edge" else 0.6 * y
    return 1 + f["a"] * g


OUTSIDE = {"wrench": ["breathing", "hose", "zero-jumps", "guarding", "pulse"], "tester": ["breathing", "zero-jumps", "guarding", "pulse"]}


class Outside:
    """something real that the catalogue doesn't hold; a: amplitude (m, N or a share)."""
    START = {"breathing": 2e-4, "hose": 0.5, "zero-jumps": 0.3, "guarding": 0.2, "pulse": 0.1}

    def __init__(self, rng, name, T):
        u = rng.uniform
        self.name = name
        self.f, self.ph = u(0.2, 0.4), u(0, 6.28)
        self.rate = u(0.95, 1.4)
        k = max(4, int(T / u(5, 9)))
        self.times = (np.arange(k) + u(0.2, 0.8, k)) * T / k
        self.steps = rng.choice([-1, 1], (k, 6)) * u(0.5, 1.2, (k, 6)) * np.array([1, 1, 1, 0.02, 0.02, 0.02])
        self.anchor = np.array([u(0.05, 0.15), u(-0.15, 0.15), u(0.1, 0.25)])

    def depth(self, t, a):
        if self.name != "breathing":
            return 0.0
        s = np.sin(2 * np.pi * self.f * t + self.ph)
        return a * (s + 0.25 * np.sin(4 * np.pi * self.f * t + 1.0))

    def gain(self, t, a):
        """muscle guarding: stiffness that rises and lets go again; pulse: an artery below, load-proportional beat."""
        if self.name == "guarding":
            g = np.zeros(len(t))
            for i, b in enumerate(self.times):
                g += (1 if i % 2 == 0 else -1) / (1 + np.exp(-(t - b) / 0.12))
            return 1 + a * g
        if self.name == "pulse":
            ph = (self.rate * t + 0.02 * np.sin(2 * np.pi * 0.25 * t)) % 1.0
            return 1 + a * (np.exp(-((ph - 0.2) / 0.07) ** 2) + 0.35 * np.exp(-((ph - 0.5) / 0.1) ** 2))
        return 1.0

    def wrench(self, t, a, n, tip=None, R=None):
        W = np.zeros((len(t), n))
        if self.name == "zero-jumps":
            for i, b in enumerate(self.times):                    # knocked one way, and back
                W += a * (1 if i % 2 == 0 else -1) * (t >= b)[:, None] * self.steps[0, :n]
        if self.name == "hose":                                   # a strap, slack up to a length, hitched to the tool
            d = tip[0] + self.anchor - tip
            l = np.linalg.norm(d, axis=1)
            pull = np.maximum(l - 0.8 * np.median(l), 0) / (0.1 + 0 * l) * a
            f = np.einsum("nji,nj->ni", R, d / l[:, None] * pull[:, None])
            W += np.concatenate([f, np.cross(np.array([0.01, 0.0, 0.02]), f)], 1)
        return W
