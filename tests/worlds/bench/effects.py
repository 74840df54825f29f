"""Truth side of the contact effects: how an effect of relative amplitude a enters the world. Shapes are drawn once per case."""
import numpy as np
from laws import params, P, elastic

NORMAL = ["hertz-exponent", "viscous-damping", "hunt-crossley-damping", "relaxation", "hysteresis", "stress-softening", "adhesion",
          "stiffening-layer", "surface-offset", "stiffness-drift", "stiffness-inhomogeneity"]
TANGENTIAL = ["coulomb-friction", "viscous-friction", "stribeck-friction", "presliding", "friction-rounding",
              "load-dependent-friction", "friction-anisotropy"]
TOOL = ["tool-mass", "tool-com", "tool-inertia", "structural-compliance", "tip-offset"]
SENSOR = ["sensor-bias", "sensor-drift", "sensor-crosstalk", "sensor-misalignment", "sensor-gain", "sensor-lag", "time-offset",
          "saturation", "quantization", "mains-hum"]

# effect: (channels, domain) for the measurement of its size
ACTS = {**{e: ("normal", "contact") for e in NORMAL}, **{e: ("tangential", "contact") for e in TANGENTIAL},
        **{e: ("force", "all") for e in SENSOR}, "adhesion": ("normal", "acts"), "tool-mass": ("force", "all"), "tool-com": ("torque", "all"),
        "tool-inertia": ("torque", "fast"), "structural-compliance": ("normal", "contact"), "tip-offset": ("torque", "contact"),
        "saturation": ("force", "acts"), "sensor-lag": ("force", "contact"), "time-offset": ("force", "contact"), "presliding": ("tangential", "contact")}
ACTS_TESTER = {**ACTS, **{e: ("normal", "contact") for e in SENSOR}, "saturation": ("normal", "acts"), "sensor-bias": ("normal", "all"),
               "sensor-drift": ("normal", "all"), "mains-hum": ("normal", "all"), "quantization": ("normal", "all")}


def static_force(law, d):
    p = params(**law)
    out = np.array([elastic(p, 1.0, float(x)) for x in np.linspace(0, max(d.max(), 1e-4), 200)])
    return np.interp(np.maximum(d, 0), np.linspace(0, max(d.max(), 1e-4), 200), out)


def draw_law(rng, base, force, dmax):
    """Parameters of a base that reaches about `force` at dmax."""
    law = {}
    if base in ("hooke", "kelvin-voigt", "zener"):
        law.update(k=force / dmax, n=1.0)
        if base == "kelvin-voigt":
            law["c"] = law["k"] * float(np.exp(rng.uniform(np.log(.002), np.log(.012))))
        if base == "zener":
            law.update(r0=float(rng.uniform(.15, .4)), tau0=float(np.exp(rng.uniform(np.log(.3), np.log(3)))))
    elif base in ("hertz", "hunt-crossley"):
        law.update(k=force / dmax ** 1.5, n=1.5)
        if base == "hunt-crossley":
            law["lam"] = float(rng.uniform(.4, 3.0))
    return {k: float(v) for k, v in law.items()}


def shape(rng, e, ctx):
    """Random constants of one hidden effect (drawn once). ctx: dmax, force, T, place span, sigma."""
    u = rng.uniform
    lg = lambda a, b: float(np.exp(u(np.log(a), np.log(b))))
    v = rng.normal(size=3)
    v /= np.linalg.norm(v)
    s = dict(dir=v, sign=float(rng.choice([-1, 1])))
    if e == "relaxation":
        s["tau"] = lg(.25, 4.0)
        s["spread"] = lg(1.05, 1.6) if u() < .5 else 1.0
    if e == "hysteresis":
        s["L"] = lg(1.5e-4, 8e-4)
        s["B"] = float(u(0, .3))
    if e == "stress-softening":
        s["L"] = ctx["dmax"] * lg(.1, .4)
        s["B"] = float(u(0, .6))
    if e == "adhesion":
        s["L"] = lg(3e-4, 1.2e-3)
        s["B"] = float(u(.0, .5)) if u() < .5 else 0.0
    if e == "stiffening-layer":
        s["d"] = ctx["dmax"] * u(.45, .7)
        s["W"] = ctx["dmax"] * u(.0, .06)
    if e == "stiffness-inhomogeneity":
        s.update(kind=int(rng.integers(1, 4)), ang=float(u(0, 2 * np.pi)), w=lg(.004, .012), c=u(-.008, .008, 2))
    if e == "stribeck-friction":
        s["vs"] = lg(.004, .015)
        s["lag"] = float(rng.choice([0, .004]))
    if e == "friction-rounding":
        s["a"] = 1.0
    if e == "sensor-crosstalk":
        M = np.zeros((6, 6))
        for _ in range(int(rng.integers(2, 6))):
            i = int(rng.integers(0, 3))
            j = int(rng.choice([k for k in range(3) if k != i]))
            M[i, j] += rng.normal()
            M[3 + int(rng.integers(0, 3)), j] += .04 * rng.normal()
        s["M"] = M / np.abs(M[:3]).max()
    if e == "tool-inertia":
        r = rng.uniform(.6, 1.4, 3)
        s["I"] = np.r_[r[0] + r[1], r[1] + r[2], r[0] + r[2], .15 * rng.normal(size=3)]
    if e == "saturation":
        s["before"] = bool(rng.random() < .5)
    if e == "mains-hum":
        s.update(f=float(rng.choice([50., 60.])) + float(u(-.02, .02)), w=np.r_[u(.3, 1, 3), u(.01, .04, 3)], h=float(u(0, .4)))
    if e in ("sensor-bias", "sensor-drift"):
        t = rng.normal(size=3)
        s["v"] = np.r_[v, .02 * t]
    return s


def apply(w, e, a, s, ctx):
    """Put effect e of relative amplitude a into the world w (a dict of law, tip, tools, sensor). Returns its parameters."""
    L = w["law"]
    S = w["sensor"]
    dmax, F, T = ctx["dmax"], ctx["force"], ctx["T"]
    if e == "hertz-exponent":
        n = L["n"] + s["sign"] * .0 + .25 * a
        L["k"] *= (.75 * dmax) ** (L["n"] - n)
        L["n"] = n
        return dict(n=n)
    if e == "viscous-damping":
        L["c"] = L.get("c", 0) + 4e-3 * a * F / dmax
        return dict(c=L["c"])
    if e == "hunt-crossley-damping":
        L["lam"] = L.get("lam", 0) + .5 * a
        return dict(lam=L["lam"])
    if e == "relaxation":
        r = min(.2 * a, .85)
        g = s["spread"]
        for i, (f, q) in enumerate(((1, .6), (g, .2), (1 / g, .2))):
            L[f"r{i}"], L[f"tau{i}"] = r * q, s["tau"] * f
        return dict(ratio=r, tau=s["tau"])
    if e == "hysteresis":
        L.update(hyA=.04 * a * F, hyL=s["L"], hyB=s["B"] * ctx["level"])
        return dict(amplitude=L["hyA"], length=s["L"])
    if e == "stress-softening":
        L.update(soR=min(.12 * a, .8), soL=s["L"], soB=s["B"] * ctx["level"])
        return dict(ratio=L["soR"], length=s["L"])
    if e == "adhesion":
        L.update(adF=.03 * a * F, adL=s["L"], adB=s["B"] * ctx["level"])
        return dict(force=L["adF"], length=s["L"])
    if e == "stiffening-layer":
        L.update(laK=.4 * a * (F / dmax), laD=s["d"], laW=s["W"] * ctx["level"])
        return dict(stiffness=L["laK"], depth=s["d"])
    if e == "surface-offset":
        z = s["sign"] * 1.5e-4 * a
        w["z0"] += z
        return dict(offset=z)
    if e == "stiffness-drift":
        L["alpha"] = s["sign"] * .06 * a * 60 / T
        return dict(rate_per_min=L["alpha"])
    if e == "stiffness-inhomogeneity":
        L.update(ikind=float(s["kind"]), iA=min(.12 * a, .9), icx=float(s["c"][0]), icy=float(s["c"][1]), iang=s["ang"], iw=s["w"])
        return dict(kind=("gradient", "edge", "inclusion")[s["kind"] - 1], amplitude=L["iA"])
    if e == "coulomb-friction":
        L["mu"] = .05 * a
        return dict(mu=L["mu"])
    if e == "viscous-friction":
        L["cv"] = 4.0 * a
        return dict(c=L["cv"])
    if e == "stribeck-friction":
        L.update(dmu=.04 * a, vs=s["vs"], vlag=s["lag"] * ctx["level"])
        return dict(dmu=L["dmu"], vs=s["vs"])
    if e == "presliding":
        L.update(ell=1e-4 + 4e-4 * a)
        return dict(length=L["ell"])
    if e == "friction-rounding":
        L.update(ftype=4.0, vr=2.5e-3 * a)
        return dict(vr=L["vr"])
    if e == "load-dependent-friction":
        L.update(pN=float(np.clip(s["sign"] * .1 * a, -.6, .6)), N0=.5 * F)
        return dict(p=L["pN"])
    if e == "friction-anisotropy":
        L["aniso"] = s["sign"] * .05 * a
        return dict(a=L["aniso"])
    if e == "structural-compliance":
        L["comp"] = .03 * a * dmax / F
        return dict(compliance=L["comp"])
    if e == "tool-mass":
        d = s["sign"] * .02 * a
        w["stated"]["mass"] -= d
        return dict(dm=d)
    if e == "tool-com":
        d = s["dir"] * .002 * a
        w["stated"]["com"] = w["stated"]["com"] - d
        return dict(dcom=d.tolist())
    if e == "tool-inertia":
        I = s["I"] * 4e-4 * a
        w["tool"]["inertia"] = (np.array(w["tool"]["inertia"]) + I).tolist()
        return dict(inertia=I.tolist())
    if e == "tip-offset":
        ax = w["rtip"] / np.linalg.norm(w["rtip"])
        d = s["dir"] - .7 * ax * (s["dir"] @ ax)
        d = d / np.linalg.norm(d) * 5e-4 * a
        w["tip"] = w["tip"] + d
        return dict(offset=d.tolist())
    if e == "sensor-bias":
        S["bias"] = s["v"] * .1 * a
        return dict(bias=S["bias"].tolist())
    if e == "sensor-drift":
        S["drift"] = s["v"] * .2 * a * 60 / T
        return dict(drift_per_min=S["drift"].tolist())
    if e == "sensor-crosstalk":
        S["cross"] = s["M"] * .015 * a
        return dict(matrix=S["cross"].tolist())
    if e == "sensor-misalignment":
        S["misalign"] = s["dir"] * .015 * a
        return dict(rotvec=S["misalign"].tolist())
    if e == "sensor-gain":
        S["gain"] = s["sign"] * .03 * a
        return dict(gain=S["gain"])
    if e == "sensor-lag":
        S["lag"] = .012 * a
        return dict(tau=S["lag"])
    if e == "time-offset":
        S["toff"] = s["sign"] * .008 * a
        return dict(offset=S["toff"])
    if e == "saturation":
        S["sat_frac"] = float(np.exp(-.12 * a))
        S["sat_before"] = s["before"]
        return dict(fraction_of_peak=S["sat_frac"])
    if e == "quantization":
        S["quant_a"] = a
        return dict(step_in_sigma=10 * a)
    if e == "mains-hum":
        S.update(hum=s["w"] * .1 * a, hum_f=s["f"], hum_h=s["h"])
        return dict(amplitude=S["hum"].tolist(), frequency=s["f"])
    raise KeyError(e)


def truth_theta(w, model_effects, params_by_effect):
    """Starting values of a refit from what is known (keys of catalog.TABLE)."""
    L, S = w["law"], w["sensor"]
    th = {k: L[k] for k in ("k", "c", "lam", "n", "mu", "cv", "dmu", "vs", "pN", "aniso", "comp", "hyA", "hyL", "soR", "soL", "adF", "adL",
                            "laK", "laD", "alpha") if k in L}
    r = sum(L.get(f"r{i}", 0) for i in range(3))
    if r > 0:
        th.update(r0=r, tau0=L["tau0"])
    th["vr"] = L.get("vr", 1e-3)
    th["ell"] = L.get("ell", 1e-4)
    if S["lag"]:
        th["lag"] = S["lag"]
    if S["toff"]:
        th["toff"] = S["toff"]
    th["z0"] = w["z0"]
    return th
