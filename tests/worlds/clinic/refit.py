"""Own refits: Levenberg-Marquardt through the plain forms, what an effect leaves when it is left out, and what else would do as well."""
import numpy as np

import catalogue as cat


def rms(x):
    x = np.asarray(x)
    return float(np.sqrt(np.mean(x ** 2))) if x.size else 0.0


class Rejected(Exception):
    """a draw that cannot meet the brief's bounds; another is drawn."""


class Fit:
    """least squares of a model (names) on data (predict, y); sigma per channel; start: known good values."""

    def __init__(self, data, names, sigma, start=None, fixed=None, iterations=7, parameters=cat.parameters):
        self.data, self.names, self.sigma = data, list(names), sigma
        free, fx = parameters(names)
        self.fixed = {**fx, **(fixed or {})}
        self.keys = [k for k in free if k not in (fixed or {})]
        self.kind = {k: free[k][2] for k in self.keys}
        self.scale = {k: free[k][1] or 1.0 for k in self.keys}
        start = start or {}
        self.p = {k: float(start.get(k, free[k][0])) for k in self.keys}
        self.ridge = np.array([0.02 if k[:3] == "inh" else 1e-4 if k[0] == "X" else 1e-7 for k in self.keys])
        self.solve(iterations)

    def full(self, p=None):
        return {**self.fixed, **(p or self.p)}

    def residual(self, p):
        return self.data.y - self.data.predict(self.full(p))

    def vec(self, r):
        return (r / self.sigma).ravel()

    def move(self, p, k, x):
        q = dict(p)
        q[k] = p[k] * np.exp(np.clip(x, -1.0, 1.0)) if self.kind[k] == cat.LOG else p[k] + x * self.scale[k]
        if k == "C":
            q[k] = max(q[k], 0.0)
        return q

    def jacobian(self, p, r, keys=None):
        J = []
        for k in keys or self.keys:
            h = 1e-3 if self.kind[k] == cat.LOG else 0.02
            J.append(self.vec(self.residual(self.move(p, k, h)) - r) / h)
        return -np.array(J).T

    def solve(self, iterations):
        p, lam = self.p, 1e-3
        r = self.residual(p)
        v = self.vec(r)
        cost = v @ v
        for _ in range(iterations):
            if not self.keys:
                break
            J = self.jacobian(p, r)
            A, g = J.T @ J, J.T @ v
            d = np.diag(A) + 1e-12
            better = False
            for _ in range(5):
                s = np.linalg.lstsq(A + np.diag(d * (lam + self.ridge)) + 1e-9 * np.eye(len(d)), g, rcond=None)[0]
                q = p
                for k, x in zip(self.keys, s):
                    q = self.move(q, k, x)
                rq = self.residual(q)
                vq = self.vec(rq)
                c = vq @ vq
                if np.isfinite(c) and c < cost:
                    gain = (cost - c) / cost
                    p, r, v, cost, lam, better = q, rq, vq, c, max(lam / 5, 1e-9), True
                    break
                lam = lam * 8 + 1e-6
            if not better or gain < 2e-4:
                break
        self.p, self.r, self.cost = p, r, cost


def near(reduced, limit, metric, candidates, starts, fixed_of=lambda c, names: {}):
    """candidates whose refit leaves less than `limit`; a linear projection screens, a full fit decides."""
    out = []
    data, sigma = reduced.data, reduced.sigma
    J0 = reduced.jacobian(reduced.p, reduced.r) if reduced.keys else np.zeros((reduced.vec(reduced.r).size, 0))
    worst = rms(metric(reduced.r))
    for c in candidates:
        best = np.inf
        for st in starts(c):
            f = Fit(data, reduced.names + [c], sigma, {**reduced.p, **st}, fixed_of(c, reduced.names), iterations=0)
            new = [k for k in f.keys if k not in reduced.keys]
            amp = [k for k in new if k not in st]
            start = {k: f.p[k] for k in new}
            if amp and c not in ("friction-rounding", "presliding", "sensor-lag"):
                Jc = f.jacobian(f.p, f.r, amp)
                J = np.hstack([J0, Jc])
                s = np.linalg.lstsq(J.T @ J + 1e-6 * np.diag((J ** 2).sum(0) + 1e-9), J.T @ f.vec(f.r), rcond=None)[0]
                m = rms(metric((f.vec(f.r) - J @ s).reshape(f.r.shape) * sigma))
                for k, x in zip(amp, s[J0.shape[1]:]):
                    f.p = f.move(f.p, k, x)
                start.update({k: f.p[k] for k in amp})
            else:
                m = rms(metric(f.r))
            if m > min(1.35 * limit, 0.92 * worst) and c not in ("friction-rounding", "presliding") or m > 0.98 * worst:
                best = min(best, m)
                continue
            f = Fit(data, reduced.names + [c], sigma, {**reduced.p, **start}, fixed_of(c, reduced.names), iterations=4)
            best = min(best, rms(metric(f.r)))
            if best < limit:
                break
        if best < limit:
            out.append(c)
    return out
