"""Which other single effect fits a case as well (own fit)?  Those go to `near`."""
import numpy as np
from scipy.optimize import least_squares
from contact import copyspec, sensor

ALT = {"hertz-exponent": ["stiffening-layer", "structural-compliance"], "viscous-damping": ["hunt-crossley-damping", "relaxation", "time-offset"], "hunt-crossley-damping": ["viscous-damping", "relaxation", "hysteresis"],
       "relaxation": ["hysteresis", "viscous-damping", "hunt-crossley-damping", "stress-softening"], "hysteresis": ["relaxation", "hunt-crossley-damping", "stress-softening"],
       "stress-softening": ["hysteresis", "stiffness-drift", "relaxation"], "adhesion": ["surface-offset", "hysteresis", "sensor-bias"], "stiffening-layer": ["hertz-exponent"],
       "surface-offset": ["tip-offset", "hertz-exponent", "adhesion"], "stiffness-drift": ["stiffness-inhomogeneity", "stress-softening"], "stiffness-inhomogeneity": ["stiffness-drift", "surface-tilt"],
       "structural-compliance": ["hertz-exponent", "stiffening-layer"], "viscous-friction": ["stribeck-friction"], "stribeck-friction": ["viscous-friction", "presliding"],
       "presliding": ["friction-rounding", "time-offset"], "friction-rounding": ["presliding", "viscous-friction"], "friction-anisotropy": ["sensor-crosstalk"],
       "surface-tilt": ["sensor-misalignment", "sensor-crosstalk", "coupled-stiffness"], "coupled-stiffness": ["surface-tilt", "sensor-misalignment", "sensor-crosstalk"],
       "tool-mass": ["sensor-gain", "sensor-bias"], "tool-com": ["sensor-misalignment", "sensor-bias", "tip-offset"], "tip-offset": ["surface-offset", "tool-com", "sensor-crosstalk"],
       "sensor-bias": ["tool-mass", "sensor-drift"], "sensor-drift": ["sensor-bias"], "sensor-crosstalk": ["sensor-misalignment", "coupled-stiffness", "surface-tilt"],
       "sensor-misalignment": ["sensor-crosstalk", "surface-tilt"], "sensor-gain": ["tool-mass"], "sensor-lag": ["time-offset"], "time-offset": ["sensor-lag", "viscous-damping", "hunt-crossley-damping"],
       "saturation": ["hertz-exponent"], "load-dependent-friction": ["viscous-friction"]}


def P(name, lo=0., hi=1e9):
    def f(sp, v): sp["P"][name] = float(np.clip(v, lo, hi))
    return f


def params(e, c, n0):
    """[(setter, start, scale)]"""
    F, d, vm, nc, T = c["F"], c["d"], c["vm"], c["nc"], c["T"] / 60
    def vec(key, i):
        def f(sp, v): sp[key][i] = v
        return f
    def sv(key, i, shape):
        def f(sp, v):
            x = sp["S"][key]; x = np.zeros(shape) if x is None else np.array(x, float); x[i] = v; sp["S"][key] = x
        return f
    def ss(key): return lambda sp, v: sp["S"].__setitem__(key, v)
    L = {"hertz-exponent": lambda: [(P("n", .7, 3), n0 * 1.05, .1)], "viscous-damping": lambda: [(P("c"), .05 * F / vm, .05 * F / vm)], "hunt-crossley-damping": lambda: [(P("lam"), .05 / vm, .05 / vm)],
         "relaxation": lambda: [(P("rho1", 0, 5), .3, .1), (P("tau1", .02, 30), .6, .3)], "hysteresis": lambda: [(P("hr", 0, .9), .1, .1), (P("hl", 1e-5, .01), .1 * d, .05 * d)],
         "stress-softening": lambda: [(P("sr", 0, .9), .1, .1), (P("sl", 1e-5, .05), .2 * d, .1 * d)], "adhesion": lambda: [(P("Fa"), .05 * F, .05 * F), (P("Fl", 1e-5, .01), 1e-3, 3e-4)],
         "stiffening-layer": lambda: [(P("K2", -1e9), .3 * F / d, .2 * F / d), (P("db", 0, 1), .5 * d, .1 * d)], "surface-offset": lambda: [(lambda sp, v: sp.__setitem__("z0", v), 0., 1e-4)],
         "stiffness-drift": lambda: [(P("drift", -1e3), 0., .1 / T)], "stiffness-inhomogeneity": lambda: [(P("g1", -1e4), 0., 5.), (P("g2", -1e4), 0., 5.)], "structural-compliance": lambda: [(P("C"), .05 * d / F, .05 * d / F)],
         "viscous-friction": lambda: [(P("cv", -1e4), 0., 1.)], "stribeck-friction": lambda: [(P("dmu"), .1, .1), (P("vs", 1e-4, .2), .008, .004)], "presliding": lambda: [(P("pl", 1e-6, .05), 5e-4, 2e-4)],
         "friction-rounding": lambda: [(P("vr", 1e-6, .2), 2e-3, 1e-3)], "surface-tilt": lambda: [(vec("tilt", 0), 0., .02), (vec("tilt", 1), 0., .02)],
         "coupled-stiffness": lambda: [(P("K1n", -1e9), 0., .05 * F / d), (P("K2n", -1e9), 0., .05 * F / d)], "tool-mass": lambda: [(lambda sp, v: sp.__setitem__("m", sp["m"] + v), 0., .02)],
         "tool-com": lambda: [(lambda sp, v, i=i: sp["com"].__setitem__(i, sp["com"][i] + v), 0., .003) for i in range(3)], "tip-offset": lambda: [(vec("tipd", i), 0., .0005) for i in range(3)],
         "sensor-bias": lambda: [(sv("bias", i, nc), 0., .02 * F * (1 if i < 3 else .05)) for i in range(nc)], "sensor-drift": lambda: [(sv("drift", i, nc), 0., .02 * F * (1 if i < 3 else .05)) for i in range(nc)],
         "sensor-crosstalk": lambda: [(sv("X", (i, j), (nc, nc)), 0., .02) for i in range(min(nc, 3)) for j in range(min(nc, 3)) if i != j], "sensor-misalignment": lambda: [(sv("rot", i, 3), 0., .02) for i in range(3)],
         "sensor-gain": lambda: [(ss("gain"), 0., .03)], "sensor-lag": lambda: [(lambda sp, v: sp["S"].__setitem__("lag", max(v, 1e-5)), .01, .005)], "time-offset": lambda: [(ss("delay"), 0., .005)]}
    return L[e]() if e in L else None


def near_contact(b, static):
    if len(b["fx"]) != 1 or b["fx"][0] not in ALT or b["group"] != "one": return static
    from cases_contact import allowed
    e0 = b["fx"][0]; al = allowed(b["law"], b["slides"], b["robot"] is not None); out = []
    sc, sub, Y, sig = b["thin"], b["sub"], b["Y"], b["sig"]; rs = b["rs"]
    for e in ALT[e0]:
        if e not in al: continue
        pr = params(e, b["ctx"], b["base"]["P"]["n"])
        if pr is None: continue
        if e == "relaxation" and b["fitbase"]["P"]["rho1"]: continue
        names = b["names"]; x0 = np.r_[np.log([max(b["ev"]["fitted"][n], 1e-9) for n in names]) / .1, [s / h for _, s, h in pr]]
        def res(x, full=False):
            sp = copyspec(b["fitbase"])
            for n, v in zip(names, np.exp(np.clip(x[:len(names)] * .1, -40, 40))): sp["P"][n] = v
            if e == "hertz-exponent":      # keep the force at the deepest point
                sp["P"]["k"] *= b["ctx"]["d"] ** (b["base"]["P"]["n"] - float(np.clip(x[len(names)] * pr[0][2], .7, 3)))
            for (f, _, h), v in zip(pr, x[len(names):]): f(sp, v * h)
            W = np.nan_to_num(sensor(sc.t, sc.wrench(sp), sp["S"])[sub], nan=1e3, posinf=1e3, neginf=-1e3); r = Y - W
            return r if full else (r / rs)[::2].ravel()
        try: o = least_squares(res, x0, method="lm", max_nfev=14 * (len(x0) + 1), diff_step=1e-4, ftol=1e-4, xtol=1e-4)
        except Exception: continue
        r = res(o.x, True); g = [b["live"]] + ([[3, 4, 5]] if b["nc"] == 6 else [])
        got = [float(np.sqrt((r[:, i] ** 2).mean())) for i in g]
        b.setdefault("alts", {})[e] = got
        if all(a < max(1.15 * max(q, n), .008 * rd) for a, q, n, rd in zip(got, b["quiet"]["fit"], b["quiet"]["noise"], b["ev"]["reading"])): out.append(e)
    return out
