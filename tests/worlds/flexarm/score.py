"""How large is what is hidden: refits with and without, ratios, names that would do as well; the loop that tunes amplitudes to the wanted ratio."""
from __future__ import annotations

import numpy as np

from laws import BASES, NORMAL, SENSOR, TANGENTIAL, TOOL
from refit import Ruler, rms, without


class Redraw(Exception):
    """This draw can't be made into the wanted case: another one is drawn."""


def groups(C):
    return {"N": [0, 1, 2], "N·m": [3, 4, 5]} if C == 6 else {"N": list(range(C))}


def measure(own, delta, res, C, units=None, where=None):
    """(effect_rms, left_rms, unit, mask, channels) in the group of channels where the effect stands out most."""
    best = None
    for unit, ch in (units or groups(C)).items():
        a = np.sqrt((own[:, ch] ** 2).sum(1))
        if a.max() <= 1e-9:
            continue
        mask = a > 0.03 * np.percentile(a, 99.9) if where is None else where
        if mask.sum() < 20:
            continue
        e = np.array([rms(own[mask, c]) / max(rms(res[mask, c]), 1e-12) for c in ch])
        use = [c for c, x in zip(ch, e) if x >= 0.3 * e.max()]
        left = rms(res[mask][:, use])
        eff = rms(delta[mask][:, use])
        if best is None or eff / left > best[0] / best[1]:
            best = (eff, left, unit, mask, use)
    if best is None:
        return 0.0, 1.0, "N", np.ones(len(own), bool), [0]
    return best


class Judge:
    """Refits one series with the true model and with models that lack something."""

    def __init__(self, ser, model, hidden, sigma, truth):
        self.ser, self.model, self.hidden = ser, model, hidden
        C = ser.channels
        floor = np.array([0.004 * rms(ser.y[ser.contact][:, c] if ser.contact.any() else ser.y[:, c]) for c in range(C)])
        self.sigma = np.sqrt(np.asarray(sigma) ** 2 + floor ** 2)
        self.noise = np.asarray(sigma)
        fitted = [h for h in hidden if h != "quantization"]
        self.true = Ruler(ser, model + fitted, self.sigma)
        self.true.fit(self.true.start(truth), 20)
        self.bases = {}

    def lacking(self, name):
        """The refit of the model that lacks one hidden effect and has the others."""
        if name not in self.bases:
            eff = self.model + [h for h in self.hidden if h not in (name, "quantization")]
            r = Ruler(self.ser, eff, self.sigma)
            r.fit(r.start(self.true.v), 25)
            self.bases[name] = r
        return self.bases[name]

    def size(self, name):
        base = self.lacking(name)
        own = self.true.pred - without(self.true, name)
        self.m = measure(own, self.true.pred - base.pred, self.true.res, self.ser.channels,
                         where=self.ser.contact if name == "saturation" else None)
        return self.m

    def fits(self):
        """Worst of fit / allowance over groups, and the numbers of the force group."""
        s = self.ser
        on = s.contact if s.contact.sum() > 20 else np.ones(len(s.t), bool)
        worst, out = 0.0, None
        for unit, ch in groups(s.channels).items():
            f, read, no = rms(self.true.res[on][:, ch]), rms(s.y[on][:, ch]), rms(self.noise[ch])
            fa = rms(self.true.res[:, ch])
            lim = max(1.3 * no, 0.017 * read)
            worst = max(worst, f / lim, fa / lim)
            if out is None:
                out = (f, read, no)
        return worst, out

    def alternatives(self):
        have = set(self.model) | set(self.hidden)
        out = []
        for a in NORMAL + TANGENTIAL + TOOL + SENSOR:
            if a in have or a == "quantization":
                continue
            b = self.true.base
            if a == "viscous-damping" and b == "kelvin-voigt" or a == "relaxation" and b in ("zener", "maxwell") or a == "hunt-crossley-damping" and b == "hunt-crossley":
                continue
            if self.ser.channels < 6 and (a in TOOL and a != "structural-compliance" or a == "sensor-misalignment"):
                continue
            if self.ser.channels < 3 and a in TANGENTIAL:
                continue
            if a in ("stribeck-friction", "presliding", "friction-rounding", "load-dependent-friction", "friction-anisotropy") and "coulomb-friction" not in have:
                continue
            out.append(a)
        return out

    def near(self, name):
        """Other effects whose refit in the place of `name` leaves less than half of left_rms more than the true one."""
        eff, left, _, mask, use = self.size(name)
        base = self.lacking(name)
        r_true = rms(self.true.res[mask][:, use])
        sse_t, sse_b = self.true.sse, base.sse
        sel = slice(None, None, 3)                                  # every third row will do for the screening
        J = jac(base, base.v, rows=sel)
        r = (base.res * base.w)[sel].ravel()
        Q, _ = np.linalg.qr(J)
        rp = r - Q @ (Q.T @ r)
        found = []
        for a in self.alternatives():
            R = Ruler(self.ser, base.effects + [a], self.sigma)
            new = [n for n in R.names if n not in base.names]
            if not new and a != "friction-rounding":
                continue
            starts = max([len(R.par[n][4]) for n in new] or [1])
            best, vb = 0.0, None
            for k in range(starts):
                v = R.start(base.v, k)
                v.update({n: R.start(None, k)[n] for n in new})
                if a == "friction-rounding":
                    gain = np.inf
                else:
                    Ja = jac(R, v, new, sel)
                    Ja = Ja - Q @ (Q.T @ Ja)
                    A, b = Ja.T @ Ja, Ja.T @ rp
                    A = A + 1e-9 * np.trace(A) * np.eye(len(b)) + 1e-30 * np.eye(len(b))
                    gain = 3 * float(b @ np.linalg.solve(A, b))
                if gain > best:
                    best, vb = gain, v
            if best < 0.3 * max(sse_b - sse_t, 0) and a != "saturation":
                continue
            R.fit(vb if vb is not None else R.start(base.v), 12, 1e-3)
            if rms(R.res[mask][:, use]) - r_true < 0.5 * left:
                found.append(a)
        return found


def jac(R, v, only=None, rows=slice(None)):
    u = R.pack_safe(v, R.pack({k: max(x, 1e-12) if R.par[k][0] == "log" else x for k, x in v.items()}))
    p0 = R.predict(v)
    before = R.before
    names = only if only is not None else R.names
    C = p0.shape[1]
    J = np.zeros((p0[rows].size, len(names)), order="F")
    for j, n in enumerate(names):
        i = R.names.index(n)
        col = R.straight(n, v, before)
        if col is not None:
            J[col[0]::C, j] = (col[1] * R.w[col[0]] * R.par[n][1])[rows] if np.size(col[1]) > 1 else col[1] * R.w[col[0]] * R.par[n][1]
            continue
        x = u.copy()
        h = 1e-3 if R.par[n][0] == "log" else 1e-2
        x[i] += h
        vn = R.unpack(x)
        J[:, j] = ((R.predict(vn) - p0) * R.w)[rows].ravel() / h
    return J


def tune(evaluate, hidden, targets, ranges, first, limits=(2.6, 7.8), rounds=7, tol=0.13):
    """Amplitudes by secants on log scales. evaluate(amps, strength) -> (ratios, worst fit / allowance, payload).
    Nuisances are weakened when the true model itself doesn't fit."""
    amps = dict(first)
    strength = 1.0
    hist = {h: [] for h in hidden}
    good = None
    last = np.inf
    for it in range(rounds):
        ratios, worst, load = evaluate(amps, strength)
        if good is None and worst > 1.15 and strength < 0.35 and worst > 0.93 * last:
            break                                     # not the nuisances' doing
        last = worst
        if worst > 1.0:
            if strength < 0.05:
                if it > 2:
                    break
            else:
                strength *= max(0.3, min(0.75, 0.85 / worst))
                hist = {h: [] for h in hidden}
                if it > 3:
                    rounds += 0
        ok = worst <= 1.0 and all(limits[0] <= ratios[h] <= limits[1] for h in hidden)
        far = max([abs(np.log(max(ratios[h], 1e-3) / targets[h])) for h in hidden] or [0])
        if ok and (good is None or far < good[0]):
            good = (far, load, dict(amps), strength, dict(ratios))
        if ok and far < tol:
            break
        if worst <= 1.0 and not hidden:
            good = (0, load, dict(amps), strength, {})
            break
        if worst > 1.0 and not hidden:
            continue
        for h in hidden:
            x, y = np.log(amps[h]), np.log(max(ratios[h], 1e-3))
            p = 1.0
            if hist[h]:
                x0, y0 = hist[h][-1]
                if abs(x - x0) > 0.02:
                    p = min(max((y - y0) / (x - x0), 0.35), 3.0)
            hist[h].append((x, y))
            dx = min(max((np.log(targets[h]) - y) / p, -2.0), 1.8)
            amps[h] = float(np.clip(np.exp(x + dx), ranges[h][0], ranges[h][2]))
    if good is None:
        raise Redraw(f"ratios {ratios}, worst {worst:.2f}, amps {amps}, strength {strength:.2f}")
    return good


__all__ = ["Judge", "Redraw", "tune", "measure", "groups", "BASES"]
