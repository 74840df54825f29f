"""Turns a case's amplitudes until the sizes that the brief asks for are there, measured by refit.py on the logged data."""
import numpy as np
import refit
from refit import fit, project, mask, rms, GROUP


class Failed(Exception):
    pass


def sizes(D, model, hidden, th0, quant=None):
    """True fit and, for each hidden effect, the refit without it. Returns a dict."""
    real = [h for h in hidden if h != "quantization"]
    names = model + real
    th, w = fit(D, names, th0, 8)
    if "coulomb-friction" in names and "friction-rounding" not in names:
        D.bristle = 0
        D.cache.clear()
        t2, w2 = fit(D, names, th, 5)
        if (((D.y - w2) / D.sd) ** 2).sum() < (((D.y - w) / D.sd) ** 2).sum():
            th, w = t2, w2
        else:
            D.bristle = 1
            D.cache.clear()
    res = dict(th=th, w=w, names=names, each=[])
    for h in hidden:
        grp, m = GROUP[h], mask(D, h)
        left = rms(project(D, D.y - w, grp)[m])
        if h == "quantization":
            eff, wb, tb = rms(project(D, quant, grp)[m]), w, th
        else:
            nb = [x for x in names if x != h]
            tb, wb = fit(D, nb, {k: v for k, v in th.items() if k not in refit.EFF.get(h, []) or k in refit.params(D, nb)} | _undo(h), 8)
            eff = rms(project(D, w - wb, grp)[m])
        res["each"].append(dict(effect=h, group=grp, effect_rms=eff, left_rms=left, ratio=eff / max(left, 1e-12), theta=tb, w=wb, names=[x for x in names if x != h]))
    res["fit"] = overall(D, D.y - w)
    res["reading"] = overall(D, D.y)
    return res


def _undo(h):
    return {"presliding": {"L": 1e-4}, "friction-rounding": {"vr": 0.0}}.get(h, {})


def overall(D, e):
    """rms over forces (N) and, for an arm, torques (N m), in contact or motion."""
    k = D.kin
    on = k["d"] > 0
    if D.arm:
        on = on | (np.linalg.norm(k["w"], axis=1) > .03) | (np.linalg.norm(k["V"], axis=1) > .01)
        return rms(e[on][:, :3]), rms(e[on][:, 3:])
    return rms(e[on]), 0.0


def settle(case, tries=9, say=None):
    """case: .model .hidden .group .targets .amps(list of draws) .resim() .data() -> (Data, quantisation error) .theta() .soft .noise"""
    lo, hi = {"single": (2.5, 8), "pair": (2.5, 8), "weak": (.15, .8), "unexcited": (0, .3), "none": (0, 99), "outside": (0, 99)}[case.group]
    fresh = True
    last = None
    for it in range(tries):
        if fresh:
            case.resim()
        fresh = False
        D, qe = case.data()
        r = case.sizes(D, qe) if hasattr(case, "sizes") else sizes(D, case.model, case.hidden, case.theta(), qe)
        nf, nt = case.noise_rms()
        ok = True
        note, over = [], 0.0
        for v, n, rd in ((r["fit"][0], nf, r["reading"][0]), (r["fit"][1], nt, r["reading"][1])):
            lim = max(1.3 * n, .017 * rd)
            if v > lim and case.group in ("single", "pair", "none", "weak", "unexcited"):
                ok = False
                over = max(over, v / lim)
                note.append(f"fit {v:.4f}>{lim:.4f}")
        if over > 1:
            if over < 1.2:
                case.noise *= min(1.25, over * 1.08)
                case.soft *= .9
            else:
                case.soft *= .6
                fresh = case.ease()
            if it >= 3 and over > 1.6 or it >= 5 and over > 1.2:
                raise Failed("fit too poor: " + ", ".join(note))
        for x, a, tg in zip(r["each"], case.amps, case.targets):
            if case.group == "unexcited":
                good = x["ratio"] <= hi
                if not good:
                    raise Failed(f"{x['effect']} shows: {x['ratio']:.2f}")
                continue
            rd = r["reading"][0] if hasattr(case, "sizes") else rms(project(D, D.y, x["group"])[mask(D, x["effect"])])
            floor = .026 * rd / x["left_rms"] if case.group in ("single", "pair") else 0
            goal = max(tg, floor)
            if goal > 7:
                case.noise *= min(1.6, goal / 6)
                goal, ok = 6.5, False
                note.append("noise up")
            good = lo * 1.04 <= x["ratio"] <= hi * .97 and x["ratio"] >= .9 * floor
            if it < 2 and case.group == "single" and not goal / 1.5 < x["ratio"] < goal * 1.5:
                good = False
            if not good:
                ok = False
                note.append(f"{x['effect']} {x['ratio']:.2f}->{goal:.2f} A={a['A']:.4g}")
                f = np.clip(goal / max(x["ratio"], 1e-3), .15, 6)
                A = float(np.clip(a["A"] * f ** (.9 if it < 4 else .6), a["lo"], a["hi"]))
                if abs(A / a["A"] - 1) < .02:      # at its end: turn the noise instead
                    case.noise = float(np.clip(case.noise * (1.5 if f < 1 else .6), .05, 12))
                    note.append("noise %.2f" % case.noise)
                a["A"] = A
                if a["stage"] != "post":
                    fresh = True
        if say:
            say(f"   it {it} soft {case.soft:.2f} noise {case.noise:.2f} fit {r['fit'][0]:.4f} of {r['reading'][0]:.3f} "
                + " ".join(f"{x['effect']}:{x['ratio']:.2f}" for x in r["each"]) + (" | " + "; ".join(note) if note else ""))
        if ok:
            return D, r
        last = r
    raise Failed("no settlement: " + "; ".join(note))


def settle_outside(case, say=None):
    """Something that the catalogue doesn't hold: large enough, and not to be had from any one effect of the catalogue."""
    def look(A):
        case.out_A = A
        case.resim()
        D, qe = case.data()
        r = case.sizes(D, qe) if hasattr(case, "sizes") else sizes(D, case.model, [], case.theta(), qe)
        return D, r, r["fit"][0], r["reading"][0]
    left = look(0.0)[2]
    A = 1.0
    for it in range(6):
        D, r, res, rd = look(A)
        eff = float(np.sqrt(max(res ** 2 - left ** 2, 0)))
        need = max(4.6 * left, .085 * rd)
        if say:
            say(f"   it {it} A {A:.3g} left {left:.4f} residual {res:.4f} of {rd:.3f}, needed {need:.4f}")
        if need <= eff <= max(2.2 * need, .25 * rd):
            break
        A *= float(np.clip(1.35 * need / max(eff, 1e-9), .2, 5))
    else:
        raise Failed(f"outside: {eff:.4f} of {need:.4f}")
    if hasattr(case, "sizes"):
        got = case.near(D, case.model, 0)[1]
    else:
        got = refit.near(D, case.model, [], r["th"], r["w"], "sensor-bias", .5 * res)[1]
        full = rms(project(D, D.y - r["w"], "force"))
        got = [(e, v * res / full) for e, v in got]
    best = min(got, key=lambda z: z[1]) if got else ("none", res)
    if best[1] < .6 * res:
        raise Failed(f"{best[0]} has it: {best[1]:.4f} of {res:.4f}")
    r.update(effect=eff, left=left, best=f"{best[0]} leaves {best[1] / res:.2f} of it")
    return D, r
