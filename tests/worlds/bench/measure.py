"""How large a hidden effect is in a log, what is left otherwise, and which other names would do as well: all by refits."""
import numpy as np
import catalog as C
from effects import ACTS, ACTS_TESTER

rms = lambda a: float(np.sqrt(np.mean(np.square(a)))) if np.size(a) else 0.0


def proj(D, W, which):
    if D.kind == "tester":
        return W[:, :1] if which == "normal" else W[:, 1:]
    if which == "force":
        return W[:, :3]
    if which == "torque":
        return W[:, 3:]
    if which == "normal":
        return np.einsum("ni,ni->n", W[:, :3], D.E[0])[:, None]
    return np.column_stack([np.einsum("ni,ni->n", W[:, :3], D.E[i]) for i in (1, 2)])


def domain(D, name, e=None):
    if name == "contact":
        return D.contact
    if name == "fast":
        a = np.linalg.norm(D.al, axis=1)
        return a > .15 * np.percentile(a, 99.5)
    if name == "acts" and e is not None:
        a = np.abs(e).max(1)
        return a > .05 * np.percentile(a, 99.9)
    return np.ones(D.n, bool)


def active(D):
    """In contact or in motion."""
    if D.kind == "tester":
        return D.contact | (np.abs(D.dd) > 1e-4)
    return D.contact | (np.linalg.norm(D.om, axis=1) > .02) | (np.linalg.norm(D.V, axis=1) > 2e-3)


def overall(D, pred, noise, which):
    """fit_rms, noise and reading_rms over all channels of a unit, in contact or motion."""
    a = active(D)
    if D.kind == "tester":
        cols = [0] if which in ("normal", "force") else list(range(1, D.nc))
    else:
        cols = [3, 4, 5] if which == "torque" else [0, 1, 2]
    y, p = D.y[a][:, cols], pred[a][:, cols]
    nz = float(np.sqrt(np.mean(np.asarray(noise)[cols] ** 2)))
    return dict(fit=rms(y - p), noise=nz, reading=rms(y), ok=rms(y - p) <= max(1.29 * nz, .0168 * rms(y)),
                near_ok=rms(y - p) <= max(1.6 * nz, .025 * rms(y)))


def analyse(D, model, hidden, truth, noise, pre=None, iters=10):
    """Refit with and without each hidden effect. pre: the reading before quantization, where that's hidden."""
    acts = ACTS_TESTER if D.kind == "tester" else ACTS
    fitted = [h for h in hidden if h != "quantization"]
    y_log = D.y
    if pre is not None:
        D.y = pre
    if D.kind == "wrench" or D.nc > 1:                      # which bristle stands for friction at rest: the best of three
        sub = np.arange(0, D.n, max(D.n // 4000, 1))
        cost = []
        for ft in (0, 1, 3):
            D.cap["ftype"] = ft
            cost.append((C.fit_model(D, model + fitted, truth, idx=sub, iters=3)[2], ft))
        D.cap["ftype"] = min(cost)[1]
    sub = np.arange(0, D.n, max(D.n // 5000, 1))
    th1, p1, _ = C.fit_model(D, model + fitted, truth, idx=sub, iters=iters)
    out = dict(th=th1, pred=p1, each={})
    for h in hidden:
        ch, dom = acts[h]
        if h == "quantization":
            e = proj(D, y_log - pre, ch)
        else:
            rest = [m for m in model + fitted if m != h]
            keys = {k for m in rest for k in C.TABLE[m][0]}
            base = {k: v for k, v in th1.items() if k in keys}
            for m in rest:
                base.update({k: v for k, v in C.BASES.get(m, {}).items() if k not in keys})
            _, p0, _ = C.fit_model(D, rest, truth, base=base, idx=sub, iters=iters)
            e = proj(D, p1 - p0, ch)
        mk = domain(D, dom, e)
        left = rms(proj(D, D.y - p1, ch)[mk])
        out["each"][h] = dict(effect=rms(e[mk]), left=left, ratio=rms(e[mk]) / max(left, 1e-12), mask=mk, ch=ch)
    out["force"] = overall(D, p1, noise, "force")
    out["second"] = overall(D, p1, noise, "torque") if D.kind == "wrench" or D.nc > 1 else None
    D.y = y_log
    return out


def near(D, D2, model, hidden, res, limit=2600):
    """Names whose refit in place of a hidden one leaves less than half of left_rms more. D2: the log thinned out for speed."""
    idx = np.arange(0, D2.n, max(D2.n // limit, 1))
    D2.cap = dict(D.cap)
    if D.cen is not None:
        D2.centres(D.cen)
    acts = ACTS_TESTER if D.kind == "tester" else ACTS
    keep = np.zeros(D2.n, bool)
    keep[idx] = True
    fitted = [q for q in hidden if q != "quantization"]
    th1, p1, _ = C.fit_model(D2, model + fitted, None, base=res["th"], idx=idx, iters=4)
    out = {}
    for h in fitted:
        R = res["each"][h]
        if R["ratio"] < .3 or h == "mains-hum":
            continue
        ch, dom = acts[h]
        rest = [m for m in model + fitted if m != h]
        keys = {k for m in rest for k in C.TABLE[m][0]}
        base = {k: v for k, v in th1.items() if k in keys}
        for m in rest:
            base.update({k: v for k, v in C.BASES.get(m, {}).items() if k not in keys})
        base, p0, _ = C.fit_model(D2, rest, None, base=base, idx=idx, iters=6)
        mk = domain(D2, dom, proj(D2, p1 - p0, ch)) & keep
        left = rms(proj(D2, D2.y - p1, ch)[mk])
        names = []
        for alt in C.TABLE:
            if alt in rest or alt == h or alt == "mains-hum" or not C.usable(D2, alt, rest):
                continue
            try:
                _, p, _ = C.fit_model(D2, rest + [alt], None, base=base, idx=idx, iters=7)
            except (np.linalg.LinAlgError, ValueError, FloatingPointError):
                continue
            if rms(proj(D2, D2.y - p, ch)[mk]) < 1.5 * left:
                names.append(alt)
        out[h] = names
    return out


def best_addition(D, model, base, which, mk, limit=2600):
    """Smallest residual that one more catalogue name reaches (for what lies outside the catalogue)."""
    idx = np.arange(0, D.n, max(D.n // limit, 1))
    best, name = np.inf, None
    base, _, _ = C.fit_model(D, model, None, base=base, idx=idx, iters=4)
    for alt in C.TABLE:
        if alt in model or not C.usable(D, alt, model):
            continue
        try:
            _, p, _ = C.fit_model(D, model + [alt], None, base=base, idx=idx, iters=5)
        except (np.linalg.LinAlgError, ValueError, FloatingPointError):
            continue
        r = rms(proj(D, D.y - p, which)[mk])
        if r < best:
            best, name = r, alt
    return best, name
