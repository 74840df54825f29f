"""Amplitudes of the hidden effects are brought to the wanted size; nuisances are relaxed until the true model fits."""
import numpy as np

AMAX = {"hertz-exponent": 3.2, "relaxation": 4.0, "stress-softening": 6.0, "stiffness-inhomogeneity": 6., "presliding": 6.0, "friction-rounding": 6.,
        "tool-mass": 10., "tool-com": 12., "tip-offset": 10., "sensor-misalignment": 12., "sensor-crosstalk": 10., "sensor-gain": 8.,
        "load-dependent-friction": 6., "friction-anisotropy": 8., "sensor-lag": 6., "time-offset": 6., "saturation": 7., "structural-compliance": 14.,
        "tool-inertia": 20., "coulomb-friction": 14., "stribeck-friction": 9., "viscous-friction": 15., "surface-offset": 8.,
        "stiffness-drift": 10., "sensor-drift": 14, "sensor-bias": 14., "hysteresis": 12., "adhesion": 25., "stiffening-layer": 8.,
        "hunt-crossley-damping": 8., "viscous-damping": 10.,
        "joint-elasticity": 6., "gravity-error": 12., "payload": 16., "joint-torque-gain": 10., "rotor-inertia": 12., "joint-load-friction": 12., "joint-friction-asymmetry": 5.}

AMIN = {"friction-rounding": .25, "coulomb-friction": .6, "presliding": .12, "sensor-lag": .2, "time-offset": .25, "relaxation": .1, "stress-softening": .2,
        "hertz-exponent": .15, "joint-coulomb-friction": .03, "joint-viscous-friction": .03, "joint-elasticity": .05}


def tune(case, targets, trace=None, max_relax=6, its=7, window=(2.7, 7.4)):
    """Returns amplitudes and the last (world, log, D, result), or None when it can't be done."""
    amps = {h: 1.0 for h in case.hidden}
    ok_key = lambda r, k: r[k] is None or r[k]["near_ok"]
    last = {}
    relaxed = 0
    it = 0
    best = None
    while it < its:
        w = case.world(amps)
        log = case.log(w)
        D, r = case.analyse(w, log)
        main = case.main
        other = "force" if main == "second" else "second"
        fits = r[main]["ok"] and ok_key(r, other)
        rat = {h: r["each"][h]["ratio"] for h in case.hidden}
        if trace is not None:
            trace.append((relaxed, dict(amps), rat, r["force"]["fit"], max(1.3 * r["force"]["noise"], .017 * r["force"]["reading"]),
                          None if r["second"] is None else (r["second"]["fit"], max(1.3 * r["second"]["noise"], .017 * r["second"]["reading"]))))
        off = {h: abs(np.log(max(rat[h], 1e-6) / targets[h])) for h in case.hidden}
        inside = all(targets[h] < 1 and rat[h] < .78 * 1.0 and rat[h] > .2 or window[0] <= rat[h] <= window[1] and targets[h] >= 1 for h in case.hidden)
        if fits and inside and all(o < .22 or it >= 3 for o in off.values()):
            return amps, (w, log, D, r)
        top = [h for h in case.hidden if amps[h] >= .999 * AMAX.get(h, 20.) and rat[h] < window[0] <= targets[h]]
        if top and (fits or relaxed >= max_relax):
            return None                                        # as strong as it may be, and still too small
        if not fits and (top or all(o < 1.2 for o in off.values())):
            if relaxed >= max_relax:
                return None
            case.relax(r[main]["ok"])
            relaxed += 1
            if it > 2:
                it -= 1
            for h in case.hidden:
                last.pop(h, None)
            if not all(o > .35 for o in off.values()):
                continue
        for h in case.hidden:
            p = 1.0
            if h in last and abs(np.log(amps[h] / last[h][0])) > .05:
                p = np.log(max(rat[h], 1e-6) / max(last[h][1], 1e-6)) / np.log(amps[h] / last[h][0])
                p = float(np.clip(p, .35, 3.0))
            last[h] = (amps[h], rat[h])
            f = np.clip((targets[h] / max(rat[h], 1e-3)) ** (1 / p), .15, 6.0)
            amps[h] = float(np.clip(amps[h] * f, AMIN.get(h, 1e-3), AMAX.get(h, 20.)))
        it += 1
    return None
