"""Brings each hidden effect to its drawn ratio, keeps the nuisances within the brief's bounds, and states what was measured."""
import time

import numpy as np

from refit import Rejected, rms


def check_fit(case, D, f, names, slack=2.0):
    """fit_rms, its bound, reading rms on the main channels, and whether every channel group keeps to the bound."""
    ok, main = True, None
    for group in case.groups(D, names):
        r, y, nz = case.group_values(D, f.r, group)
        lim = max(1.27 * nz, 0.0165 * rms(y))
        if rms(r) > lim * (1.0 if main is None else slack):
            ok = False
        if main is None:
            main = (rms(r), lim, rms(y), nz)
    return ok, main


def run(case, plan, rng, clock=None):
    t_start = time.time()
    names, hidden, group = plan["model"], plan["hidden"], plan["group"]
    true = names + hidden
    lo, hi = {"single": (2.5, 8.0), "pair": (2.5, 8.0), "weak": (0.2, 0.78), "outside": (4.0, 30.0)}.get(group, (0, np.inf))
    draw = {"single": (2.8, 7.2), "pair": (2.8, 6.8), "weak": (0.35, 0.68), "outside": (4.8, 8.5)}.get(group)
    target = {h: float(np.exp(rng.uniform(*np.log(draw)))) if draw else None for h in hidden or ["outside"]}
    amps = {h: case.start_amplitude(h) for h in hidden}
    out = case.outside.START[case.outside.name] if case.outside else 0.0
    shrink, noise = 1.0, 1.0
    D = f = None
    steps = {h: 1.0 for h in target}
    best = None
    for it in range(14):
        log = case.simulate(amps, shrink, out, noise)
        rig = case.rig(shrink)
        D = case.data(log, rig, D if D is not None and case.same(D, shrink) else None)
        sigma = case.weights(D, f)
        p = case.truth(amps, shrink)
        if case.outside:                                         # the same log without it
            D0 = case.data(case.simulate(amps, shrink, 0.0, noise), rig, None)
            f = case.fit(D0, true, sigma, p)
            ok, main = check_fit(case, D0, f, names)
            f1 = case.fit(D, names, sigma, p, start=f.p)
            left = rms(case.metric(D0, ["outside"], f.r))
            effect = np.sqrt(max(rms(case.metric(D, ["outside"], f1.r)) ** 2 - left ** 2, 0))
            reading = rms(case.metric(D, ["outside"], D.y))
            meas = {"outside": (effect, left, f1)}
            want = max(target["outside"] * left, 0.078 * reading)
            good = effect >= max(4.2 * left, 0.071 * reading) and effect < max(12 * left, 0.16 * reading)
            if ok and good:
                break
            if not ok:
                shrink = case.milder(D0, f, shrink, 0.6)
            out *= np.clip(want / max(effect, 1e-9), 0.2, 5.0)
            if it == 13:
                raise Rejected("outside out of reach")
            continue
        Df = case.unquantized(D)
        f = case.fit(Df, true, sigma, p)
        ok, main = check_fit(case, Df, f, hidden or names)
        if not ok:
            if shrink < 0.03:
                raise Rejected("fit_rms %.3g > %.3g" % main[:2])
            shrink = case.milder(Df, f, shrink, float(np.clip(0.9 * main[1] / main[0], 0.3, 0.75)))
            if shrink < 0.12:
                noise = min(noise * 1.35, 4.0)
            continue
        if not hidden:
            meas = {}
            break
        meas, far = {}, False
        for h in hidden:
            rest = [n for n in true if n != h]
            left = rms(case.metric(Df, [h], f.r))
            fr = case.fit(D, rest, sigma, p, start={**case.start(p), **case.restart(h, f.p)})
            effect = np.sqrt(max(rms(case.metric(D, [h], fr.r)) ** 2 - left ** 2, 0.0))
            meas[h] = (effect, left, fr)
            if draw is None:
                continue
            ratio = effect / left
            x = np.log(target[h] / max(ratio, 1e-3))
            if abs(x) > 0.16 or not lo * 1.06 < ratio < hi * 0.96:
                far = True
                a_lo, a_hi = case.bounds(h)
                new = float(np.clip(amps[h] * np.exp(np.clip(x * steps[h], -1.4, 1.4)), a_lo, a_hi))
                if new == amps[h]:
                    if lo * 1.06 < ratio < hi * 0.96:
                        far = False
                    else:
                        noise = float(np.clip(noise * (0.6 if x > 0 else 1.6), 0.25, 4.0))
                if it > 4:
                    steps[h] = 0.6
                amps_new = new
                case.pending = {**getattr(case, "pending", {}), h: amps_new}
        inside = all(lo * 1.04 < meas[h][0] / meas[h][1] < hi * 0.97 for h in hidden) if draw else True
        if draw is None or not far or (it >= 5 and inside):
            break
        amps = {**amps, **getattr(case, "pending", {})}
        case.pending = {}
        if it == 13:
            raise Rejected("ratios %s" % {h: round(float(meas[h][0] / meas[h][1]), 2) for h in hidden})
    else:
        raise Rejected("no convergence (last shrink %.2f)" % shrink)
    if group == "unexcited" and any(meas[h][0] > 0.5 * meas[h][1] for h in hidden):
        raise Rejected("excited after all")
    similar = []
    if group in ("single", "pair"):
        for h in hidden:
            effect, left, fr = meas[h]
            if h in ("quantization",):
                continue
            others = [c for c in case.candidates(D) if c not in true]
            similar += [c for c in case.near(fr, h, 1.5 * left, D, others) if c not in similar]
    if case.outside:
        _, left, f1 = meas["outside"]
        explain = case.near(f1, "outside", max(2.5 * left, 0.5 * meas["outside"][0]), D, [c for c in case.candidates(D) if c not in true])
        if explain:
            raise Rejected("outside, but %s would explain it" % explain)
    unit = case.unit(hidden)
    h0 = hidden[0] if hidden else "outside" if case.outside else None
    eff, left = (meas[h0][0], meas[h0][1]) if h0 else (0.0, main[0])
    if len(hidden) > 1:
        h0 = min(hidden, key=lambda h: meas[h][0] / meas[h][1])
        eff, left = meas[h0][:2]
    fit_rms = main[0]
    if case.outside:                                             # on the logged data the model leaves what it cannot hold
        r, _, _ = case.group_values(D, f1.r, case.groups(D, names)[0])
        fit_rms = rms(r)
    truth = {"kind": case.kind, "group": group, "model": ",".join(names), "hidden": hidden, "true_model": ",".join(true), "near": similar,
             "effect_rms": float(eff), "left_rms": float(left), "fit_rms": float(fit_rms), "reading_rms": float(main[2]), "unit": unit,
             "noise_rms": float(main[3]),
             "effect_each": {h: {"effect_rms": float(m[0]), "left_rms": float(m[1]), "unit": case.unit([h])} for h, m in meas.items()},
             "nuisances": case.nuisances(shrink, noise), "parameters": case.parameters(amps, p, out), "seconds": round(float(case.T), 2),
             "notes": plan.get("notes", "")}
    return log, rig, truth, time.time() - t_start
