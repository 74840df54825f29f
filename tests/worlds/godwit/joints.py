"""Joint-torque logs and one-axis drives: forward dynamics under PD control with friction that has a bristle, and our own regressions."""
import numpy as np
import pinocchio as pin
from numba import njit
from contact import lowpass
from kin import Arm

J_EFF = ['joint-coulomb-friction', 'joint-viscous-friction', 'joint-friction-asymmetry', 'joint-torque-offset', 'rotor-inertia',
         'joint-torque-gain', 'payload', 'joint-elasticity', 'gravity-error', 'joint-stribeck-friction', 'joint-load-friction',
         'joint-torque-ripple', 'joint-spring']
D_EFF = ['joint-coulomb-friction', 'joint-viscous-friction', 'joint-friction-asymmetry', 'joint-torque-offset', 'joint-stribeck-friction',
         'joint-torque-ripple', 'joint-spring']
J_OUT = {'torque-sensor-jumps': ['joint-torque-offset', 'joint-torque-gain', 'joint-coulomb-friction', 'gravity-error'],
         'warming-friction': ['joint-viscous-friction', 'joint-coulomb-friction', 'joint-stribeck-friction'],
         'backlash-knock': ['joint-elasticity', 'joint-friction-asymmetry', 'joint-coulomb-friction', 'rotor-inertia'],
         'hose-that-swings': ['joint-spring', 'joint-elasticity', 'gravity-error', 'rotor-inertia', 'joint-viscous-friction']}
KNOWN = ['joint-coulomb-friction', 'joint-viscous-friction']
DTJ = 1e-3


@njit(cache=True)
def bristle(t, q, ell):
    """Dahl's state on a given motion, per joint."""
    u = np.zeros_like(q)
    for j in range(q.shape[1]):
        for i in range(1, q.shape[0]):
            x = (q[i, j] - q[i-1, j]) / ell
            s = np.sign(x)
            u[i, j] = s + (u[i-1, j] - s) * np.exp(-abs(x))
    return u


class JointWorld:
    def __init__(self, rng, kind):
        u = rng.uniform
        self.rng, self.kind = rng, kind
        self.arm = None if kind == 'drive' else Arm(kind, rng)
        n = self.n = 1 if kind == 'drive' else self.arm.n
        if kind == 'drive':
            self.J = np.exp(u(np.log(.002), np.log(.5)))
            self.names = ['1']
            self.amp = np.array([u(2., 8.)])
            self.scale = np.array([self.J * u(15, 40)])
            q0 = np.zeros(1)
        else:
            self.names = self.arm.names
            lo, hi = np.maximum(self.arm.model.lowerPositionLimit, -2.8), np.minimum(self.arm.model.upperPositionLimit, 2.8)
            self.amp = np.minimum(rng.uniform(.5, 1.1, n), .42 * (hi - lo))
            q0 = np.clip(self.arm.q0, lo + self.amp * 1.05, hi - self.amp * 1.05)
        self.T = u(24, 55)
        # excitation: random fourier sums, then a slow part and constant-speed sweeps
        t = np.arange(0, self.T, DTJ)
        self.t = t
        f0 = u(.06, .1)
        x = np.zeros((len(t), n))
        for h in range(1, 6):
            a, ph = rng.uniform(.4, 1., n) / h ** .6, rng.uniform(0, 2 * np.pi, n)
            x += a * np.sin(2 * np.pi * f0 * h * t[:, None] + ph)
        x /= np.abs(x).max(0)
        tri = 2 / np.pi * np.arcsin(.985 * np.sin(2 * np.pi * t[:, None] * rng.uniform(.05, .16, n) + rng.uniform(0, 6, n)))
        pace = .5 + .5 * np.tanh((t - self.T * u(.55, .65)) / .8)[:, None]
        x = x * (1 - pace) + tri * pace * .95
        w = np.minimum(1, np.minimum(t / 2, (self.T - t) / 2))[:, None]
        w = w * w * (3 - 2 * w)
        self.qd = q0 + self.amp * x * w
        self.still = None

    def base_friction(self, fr):
        r = self.rng.uniform
        n = self.n
        if self.kind != 'drive':
            self.scale = np.maximum(np.array([20, 20, 10, 10, 3, 3, 1.5][:n]) * r(.6, 1.4), .5)
        self.Fc = self.scale * self.rng.uniform(.05, .15, n) if fr else np.zeros(n)
        self.Fv = self.scale * self.rng.uniform(.04, .12, n) if fr else np.zeros(n)
        self.ell = np.full(n, r(4e-4, 1.2e-3))

    def effect(self, h, s):
        g = np.random.default_rng(self.eff_seed + sum(map(ord, h)))
        n, S = self.n, self.scale
        v = g.uniform(.5, 1., n)
        sg = g.choice([-1, 1], n)
        E = self.E
        if h == 'joint-coulomb-friction': E['Fc'] = .15 * s * S * v
        elif h == 'joint-viscous-friction': E['Fv'] = .15 * s * S * v
        elif h == 'joint-friction-asymmetry': E['Fa'] = .2 * s * S * v * sg
        elif h == 'joint-torque-offset': E['off'] = .1 * s * S * v * sg
        elif h == 'rotor-inertia': E['rot'] = .12 * s * S * v
        elif h == 'joint-torque-gain': E['gain'] = .1 * s * v * sg
        elif h == 'payload': E['pay'] = (.4 * s, g.uniform(-.03, .03, 3) + [0, 0, .05])
        elif h == 'joint-elasticity': E['K'] = (60 * S if self.kind != 'drive' else 30 * S) / s
        elif h == 'gravity-error': E['grav'] = .06 * s * sg * v
        elif h == 'joint-stribeck-friction': E['st'] = (.2 * s * S * v, g.uniform(.08, .2))
        elif h == 'joint-load-friction': E['load'] = .12 * s * v
        elif h == 'joint-torque-ripple': E['rip'] = (.12 * s * S * v, float(g.integers(6, 18)), g.uniform(0, 6, n))
        elif h == 'joint-spring': E['spr'] = .15 * s * S * v
        elif h == 'torque-sensor-jumps': E['jump'] = (s * .5 * S * sg * v, np.sort(g.uniform(.15, .9, (n, 2)) * self.T, axis=1))
        elif h == 'warming-friction': E['warm'] = (.6 * s * S * v, self.T * g.uniform(.15, .35))
        elif h == 'backlash-knock': E['knock'] = (.8 * s * S * v, g.uniform(.004, .01))
        elif h == 'hose-that-swings': E['hose'] = (.3 * s * S * v, g.uniform(.25, .5), .05)
        else: raise KeyError(h)
        if self.still is not None:            # only the braked joint has it
            k = {'rotor-inertia': 'rot', 'joint-viscous-friction': 'Fv'}[h]
            E[k] = np.where(np.arange(n) == self.still, E[k], 0.)

    def passive(self, u, v, q, load):
        """Friction and springs on the link side: opposes motion, given the bristle u."""
        E = self.E
        f = (self.Fc + E.get('Fc', 0)) * u + (self.Fv + E.get('Fv', 0)) * v
        if 'Fa' in E:
            f = f + E['Fa'] * np.abs(u) * (1 if True else 0)
        if 'st' in E:
            f = f + E['st'][0] * np.exp(-(v / E['st'][1]) ** 2) * u
        if 'load' in E:
            f = f + E['load'] * np.abs(load) * u
        if 'spr' in E:
            f = f + E['spr'] * q
        return f

    def run(self, sizes):
        self.E = {}
        for h, s in sizes.items():
            self.effect(h, s)
        n, t = self.n, self.t
        N = len(t)
        qd = self.qd
        vd = np.gradient(qd, DTJ, axis=0)
        ad = np.gradient(vd, DTJ, axis=0)
        q, v, u = qd[0].copy(), vd[0].copy(), np.zeros(n)
        Q, V, A = np.empty((N, n)), np.empty((N, n)), np.empty((N, n))
        if self.arm is not None:
            m = self.true_model()
            self.mt = m
            d = m.createData()
            arma = np.maximum(self.scale * .06, .05)
        else:
            arma = np.zeros(1)
        wn = self.wn
        load = np.zeros(n)
        for i in range(N):
            if i:
                x = (q - Q[i-1]) / self.ell
                sx = np.sign(x)
                u = sx + (u - sx) * np.exp(-np.abs(x))
            fr = self.passive(u, v, q, load)
            acmd = ad[i] + 1.4 * wn * (vd[i] - v) + wn * wn * (qd[i] - q)
            if self.arm is None:
                # the drive's controller thinks the inertia is 10 % larger and knows no friction
                a = (1.1 * self.J * acmd - fr) / self.J
            else:
                M = pin.crba(m, d, q)
                M = np.triu(M) + np.triu(M, 1).T + np.diag(arma)
                h_ = np.array(d.tau * 0)
                h_ = pin.nonLinearEffects(m, d, q, v)
                load = h_
                # computed torque with a nominal model that is a little wrong, no friction known
                tau = 1.03 * (M @ acmd) + .985 * h_
                a = np.linalg.solve(M, tau - h_ - fr)
            Q[i], V[i], A[i] = q, v, a
            v = v + a * DTJ
            q = q + v * DTJ
        self.Q, self.V, self.A = Q, V, A
        assert np.all(np.isfinite(Q))
        self.tau = self.torque()
        return self

    def true_model(self):
        m = self.arm.model.copy()
        if 'pay' in self.E:
            mass, c = self.E['pay']
            f = m.frames[m.getFrameId(self.arm.tip)]
            m.appendBodyToJoint(self.n, pin.Inertia(mass, np.array(c), np.eye(3) * 1e-5 * 0), f.placement)
        if 'grav' in self.E:                 # the links' masses sit a little elsewhere than the model says (mass and CoM, not inertia)
            for j in range(self.n):
                Y = m.inertias[j + 1]
                e = self.E['grav'][j]
                m.inertias[j + 1] = pin.Inertia(Y.mass * (1 + e), Y.lever * (1 + e), Y.inertia)
        if self.level is not None:
            m.gravity.linear = self.level
        return m

    def torque(self):
        """The reading, before its filter: link side, true motion."""
        Q, V, A, E = self.Q, self.V, self.A, self.E
        if self.arm is None:
            rb = self.J * A
        else:
            d = self.mt.createData()
            rb = np.array([pin.rnea(self.mt, d, q, v, a) for q, v, a in zip(Q, V, A)])
        U = bristle(self.t, Q, self.ell[0])
        hl = rb
        fr = self.passive(U, V, Q, np.abs(hl))
        tau = rb + fr
        if 'rot' in E: tau = tau + E['rot'] * A
        if 'rip' in E:
            a, k, ph = E['rip']
            tau = tau + a * np.sin(k * Q + ph) + .2 * a * np.sin(2 * k * Q + 1.)
        if 'jump' in E:
            a, tj = E['jump']
            for j in range(self.n):
                tau[:, j] += a[j] * ((self.t > tj[j, 0]) & (self.t < tj[j, 1]))
        if 'warm' in E:
            tau = tau + E['warm'][0] * np.exp(-self.t / E['warm'][1])[:, None] * (.5 * U + .8 * V)
        if 'knock' in E:
            a, w = E['knock']
            rv = np.diff(np.sign(lowpass(V, 1000, 10)), axis=0, prepend=np.sign(V[:1]))
            k = np.exp(-np.arange(400) / 120.) * np.sin(np.arange(400) / 30.)
            for j in range(self.n):
                tau[:, j] += a[j] * np.convolve(rv[:, j], k)[:len(tau)]
        if 'hose' in E:                       # a hanging hose: its own pendulum driven by the joint, pulling back
            a, f, z = E['hose']
            w = 2 * np.pi * f
            x, xv = self.Q[0].copy(), np.zeros(self.n)
            for i in range(len(tau)):
                xv += DTJ * (w * w * (Q[i] - x) - 2 * z * w * xv)
                x += DTJ * xv
                tau[i] += a * (Q[i] - x)
        if 'off' in E: tau = tau + E['off']
        if 'gain' in E: tau = tau * (1 + E['gain'])
        return tau

    def encoders(self):
        Q = self.Q
        if 'K' in self.E:                     # the encoder sits before the spring of the gear
            return Q + self.tau / self.E['K']
        return Q


class JointFit:
    """Regressions on what the log shows: q (filtered, differentiated) and tau through the same filter."""

    def __init__(self, w, t, q, tau, fc):
        self.w, self.fs = w, 1 / np.median(np.diff(t))
        tu = np.arange(t[0], t[-1], 1 / self.fs)
        iq = lambda X: np.column_stack([np.interp(tu, t, X[:, i]) for i in range(X.shape[1])])
        q, tau = iq(q), iq(tau)
        self.U = lowpass(bristle(tu, q, w.ell[0]), self.fs, fc, 3)
        self.rawtau = tau
        q = lowpass(q, self.fs, fc, 3)
        self.v = np.gradient(q, 1 / self.fs, axis=0)
        self.a = np.gradient(self.v, 1 / self.fs, axis=0)
        self.q, self.tau, self.t = q, lowpass(tau, self.fs, fc, 3), tu
        e = int(.6 * self.fs)
        st = max(1, (len(tu) - 2 * e) // 3000)
        self.sel = np.arange(e, len(tu) - e, st)
        self.noise = None
        s = self.sel
        if w.arm is None:
            self.rb = np.zeros((len(s), 1))
        else:
            m = w.arm.model
            d = m.createData()
            self.rb = np.array([pin.rnea(m, d, q[i], self.v[i], self.a[i]) for i in s])
        self.fc = fc

    def regress(self, h):
        """Columns of an effect: list of (n_samples, n) arrays; per joint blocks are separate columns."""
        w, s = self.w, self.sel
        q, v, a, U, n = self.q[s], self.v[s], self.a[s], self.U[s], self.w.n
        per = None
        if h == 'rigid-body': per = [a] if w.arm is None else []
        elif h == 'joint-coulomb-friction': per = [U]
        elif h == 'joint-viscous-friction': per = [v]
        elif h == 'joint-friction-asymmetry': per = [np.abs(U)]
        elif h == 'joint-torque-offset': per = [np.ones_like(q)]
        elif h == 'rotor-inertia': per = [a]
        elif h == 'joint-torque-gain': per = [self.tau[s]]
        elif h == 'joint-spring': per = [q, np.ones_like(q)] if 'joint-torque-offset' not in self.names and False else [q]
        elif h == 'joint-load-friction': per = [np.abs(self.rb if w.arm is not None else self.tau[s]) * U]
        elif h == 'joint-stribeck-friction':
            vs = w.E['st'][1] if 'st' in w.E else .1
            per = [U * np.exp(-(v / vs) ** 2)]
        elif h == 'joint-torque-ripple':
            k = w.E['rip'][1] if 'rip' in w.E else 9.
            per = [f(j * k * q) for j in (1, 2) for f in (np.sin, np.cos)]
        elif h == 'joint-elasticity':
            if w.arm is None:
                tdd = np.gradient(np.gradient(self.tau, 1 / self.fs, axis=0), 1 / self.fs, axis=0)[s]
                per = [tdd]
            else:                             # d(rnea)/dq · (−τ/K) and −M τ̈/K, one column per joint
                m = w.arm.model
                d = m.createData()
                tdd = np.gradient(np.gradient(self.tau, 1 / self.fs, axis=0), 1 / self.fs, axis=0)
                out = np.zeros((n, len(s), n))
                for r, i in enumerate(s):
                    pin.computeRNEADerivatives(m, d, self.q[i], self.v[i], self.a[i])
                    M = pin.crba(m, d, self.q[i])
                    M = np.triu(M) + np.triu(M, 1).T
                    out[:, r, :] = (-d.dtau_dq * self.tau[i] - M * tdd[i]).T
                return list(out)
        elif h in ('payload', 'gravity-error'):
            m = w.arm.model
            d = m.createData()
            blocks = []
            for i in s:
                Y = pin.computeJointTorqueRegressor(m, d, self.q[i], self.v[i], self.a[i])
                blocks.append(Y)
            Y = np.array(blocks)
            if h == 'payload':
                return [Y[:, :, 10 * (n - 1) + k] for k in range(4)]
            return [Y[:, :, 10 * j + k] for j in range(n) for k in range(4)]
        return [np.where(np.arange(n)[None] == j, c, 0.) for c in per for j in range(n)]

    def fit(self, names):
        self.names = names
        cols = []
        for h in names:
            cols += self.regress(h)
        y = self.tau[self.sel] - self.rb
        sg = self.weights()
        if cols:
            B = np.stack([(c / sg).ravel() for c in cols], 1)
            sc = np.sqrt((B ** 2).mean(0)) + 1e-12
            x = np.linalg.lstsq(B / sc, (y / sg).ravel(), rcond=1e-8)[0] / sc
            r = y - (np.stack([c.ravel() for c in cols], 1) @ x).reshape(y.shape)
        else:
            r, x = y, np.zeros(0)
        return dict(ef=float(np.sqrt((r ** 2).mean())), e=float(np.sqrt(((r / sg) ** 2).mean())), x=x, r=r)

    def weights(self):
        return np.ones(self.w.n)


def build_joint(rng, group, hidden, spec, log=print):
    w = JointWorld(rng, spec['robot'])
    w.eff_seed = int(rng.integers(1 << 30))
    w.level = None
    w.wn = rng.uniform(12, 30)
    if w.arm is not None and rng.random() < .4:
        e = rng.uniform(-.001, .001, 2)
        w.level = np.array([9.81 * e[0], 9.81 * e[1], -9.81])
    w.base_friction(spec['friction'])
    known = [h for h in hidden if h not in J_OUT]
    model = ['rigid-body'] + [k for k in KNOWN if spec['friction'] and k not in hidden]
    if spec['friction']:
        if 'joint-coulomb-friction' in hidden: w.Fc = w.Fc * 0
        if 'joint-viscous-friction' in hidden: w.Fv = w.Fv * 0
    if group == 'not-excited':               # one joint stands still: what hangs on it cannot be seen
        j = w.n - 1 if w.n > 1 else 0
        w.still = j
        w.qd[:, j] = w.qd[0, j]
    sizes = {h: 1. for h in hidden}
    target = rng.uniform(.05, .1)
    fc = 8.

    def clean(sz):
        w.run(sz)
        if w.still is not None:
            w.Q[:, w.still] = w.Q[0, w.still]
            w.V[:, w.still] = w.A[:, w.still] = 0
            w.tau = w.torque()
        return JointFit(w, w.t, w.encoders(), w.tau, fc)
    if group in ('one', 'two', 'outside'):
        for h in hidden:
            for it in range(3):
                f = clean({h: sizes[h]})
                sh = f.fit(model)['ef'] / np.sqrt((f.tau[f.sel] ** 2).mean())
                if abs(np.log(sh / target)) < .25:
                    break
                sizes[h] *= np.clip(target / max(sh, 1e-4), .25, 4.)
    elif group == 'not-excited':
        w.eff_still = hidden[0]
    f = clean(sizes)
    rms = np.sqrt((f.tau[f.sel] ** 2).mean())
    e0 = f.fit(model)['ef']
    e1 = f.fit(model + known)['ef'] if known else e0
    # noise is white; what the fit sees passed its filter, the raw reading's noise is larger
    if group in ('one', 'two', 'outside'):
        parts = [f.fit(model + [k for k in known if k != h])['ef'] for h in known] if len(known) > 1 else [e0]
        lo = min(parts)
        r = rng.uniform(2.6, 4.) if len(known) > 1 else rng.uniform(2.8, 6.)
        if group == 'outside': e1 = 0
        s2 = (lo ** 2 - r * r * e1 ** 2) / (r * r - 1)
        nu = np.sqrt(max(s2, (.12 * lo) ** 2))
    else:
        nu = rms * rng.uniform(.003, .015)
    rate = float(rng.choice([200, 250, 500, 500, 1000]))
    t = np.arange(.01, w.T - .02, 1 / rate)
    if rng.random() < .4: t = t + rng.uniform(-.1, .1, len(t)) / rate
    if rng.random() < .3: t = t[rng.random(len(t)) > .005]
    at = lambda X, tt: np.column_stack([np.interp(tt, w.t, X[:, i]) for i in range(w.n)])
    enc = w.encoders()
    res = np.exp(rng.uniform(np.log(2e-6), np.log(spec.get('res', 3e-4))))
    q = np.round(at(enc, t) / res) * res
    tt = t
    tau = w.tau
    flt = rng.random() < .5
    tauc = lowpass(tau, 1000, rng.uniform(20, 50)) if flt else tau
    per = w.scale / np.sqrt((w.scale ** 2).mean()) * .6 + .4
    if rng.random() < .4:                    # logged by a slower bus, then interpolated
        tb = np.arange(0, w.T, 1 / rng.choice([100., 125.]))
        yb = at(tauc, tb) + rng.normal(size=(len(tb), w.n)) * nu * per
        y = np.column_stack([np.interp(tt, tb, yb[:, i]) for i in range(w.n)])
    else:
        y = at(tauc, tt + rng.uniform(-3e-4, 3e-4)) + rng.normal(size=(len(t), w.n)) * nu * per
    cols = {'t': t}
    for i in range(w.n): cols[f'q{i+1}'] = q[:, i]
    if rng.random() < .4:
        dq = at(lowpass(w.V, 1000, rng.uniform(20, 60)), t - rng.uniform(0, .003)) + rng.uniform(-1, 1, w.n) * 1.5e-4
        for i in range(w.n): cols[f'dq{i+1}'] = dq[:, i]
    for i in range(w.n): cols[f'tau{i+1}'] = y[:, i]
    F = JointFit(w, t, q, y, fc)
    # errors against raw readings, as a user would meet them: the filtered residual and the noise together
    raw = np.sqrt(((F.rawtau - F.tau)[F.sel] ** 2).mean())
    b = F.fit(model)
    rms = np.sqrt((F.tau[F.sel] ** 2).mean())
    tot = lambda e: float(np.hypot(e, raw))
    out = dict(w=w, cols=cols, arm=w.arm, model=model, hidden=hidden, group=group, base_fit=b, nf=nu, nt=0., sizes=sizes, near=[], joint=True)
    if known and group in ('one', 'two'):
        tr = F.fit(model + known)
        et = tot(tr['ef'])
        parts = [tot(F.fit(model + [k for k in known if k != h])['ef']) / et for h in known] if len(known) > 1 else []
        out.update(true=dict(ef=et, et=0.), ratio=tot(b['ef']) / et, share=b['ef'] / rms, parts=parts)
        out['ok'] = 2. <= out['ratio'] <= 9. and out['share'] > .035 and (not parts or min(parts) > 1.5)
        if group == 'one':
            for c in (D_EFF if w.arm is None else J_EFF):
                if c not in hidden and c not in model and tot(F.fit(model + [c])['ef']) < 1.15 * et:
                    out['near'].append(c)
    elif group == 'outside':
        out.update(true=dict(ef=tot(b['ef']), et=0.), ratio=tot(b['ef']) / max(raw, 1e-9), share=b['ef'] / rms)
        out['ok'] = out['share'] > .03 and out['ratio'] > 1.5
    else:
        out.update(true=dict(ef=tot(b['ef']), et=0.), ratio=1., share=b['ef'] / rms)
        out['ok'] = b['ef'] < max(.011 * rms, .5 * nu)
    out['e_filtered'] = b['ef']
    # values
    v, E = {}, w.E
    idx = (lambda p, a: {f'{p}[{nm}]' if w.arm is not None else p: float(x) for nm, x in zip(w.names, a)})
    if group != 'outside':
        if w.arm is None and 'joint-elasticity' not in known: v['rigid-body.inertia'] = float(w.J)
        if spec['friction'] and 'joint-torque-gain' not in known and group != 'not-excited':
            if 'joint-viscous-friction' in model: v.update(idx('joint-viscous-friction.viscous', w.Fv))
            if 'joint-coulomb-friction' in model: v.update(idx('joint-coulomb-friction.coulomb', w.Fc))
        names = {'joint-coulomb-friction': ('coulomb', 'Fc'), 'joint-viscous-friction': ('viscous', 'Fv'), 'joint-torque-offset': ('offset', 'off'),
                 'rotor-inertia': ('inertia', 'rot'), 'joint-torque-gain': ('gain', 'gain'), 'joint-load-friction': ('load', 'load'), 'joint-spring': ('rate', 'spr')}
        for h in known:
            if h in names and group != 'not-excited' and not ('joint-torque-gain' in known and h != 'joint-torque-gain'):
                v.update(idx(f'{h}.{names[h][0]}', E[names[h][1]] * np.ones(w.n)))
        if 'payload' in known: v['payload.mass'] = float(E['pay'][0])
        if 'joint-stribeck-friction' in known: v.update(idx('joint-stribeck-friction.excess', E['st'][0]))
    out['values'] = v
    return out
