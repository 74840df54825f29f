"""Contact logs (arms and testers): programs, the coupled world, the sensor's chain, and our own fits."""
import numpy as np
from numba import njit
from scipy.optimize import least_squares
from scipy.signal import butter, filtfilt, sosfiltfilt
from law import LAW, pack, run_law, simulate
from kin import expso3

DT = 2e-4
BASE_PAR = {'hooke': ['k'], 'kelvin-voigt': ['k', 'c'], 'hertz': ['k'], 'hunt-crossley': ['k', 'B', 'n'], 'zener': ['k', 'rho', 'tau'],
            'maxwell': ['k', 'tau'], 'coulomb-friction': ['mu']}
EFF_PAR = {'hertz-exponent': ['n'], 'viscous-damping': ['c'], 'hunt-crossley-damping': ['lam'], 'relaxation': ['rho', 'tau'],
           'hysteresis': ['hy_r', 'hy_l'], 'stress-softening': ['ss_r', 'ss_l'], 'adhesion': ['ad_F', 'ad_l'], 'stiffening-layer': ['st_K', 'st_d'],
           'surface-offset': ['z0'], 'stiffness-drift': ['drift'], 'stiffness-inhomogeneity': ['ih_a', 'ih_x', 'ih_w'],
           'coulomb-friction': ['mu'], 'viscous-friction': ['cv'], 'stribeck-friction': ['st_mu', 'st_v'], 'presliding': ['ell'],
           'friction-rounding': ['vr'], 'load-dependent-friction': ['p'], 'friction-anisotropy': ['an'],
           'tool-mass': ['dm'], 'tool-com': ['dcx', 'dcy', 'dcz'], 'tool-inertia': ['I0', 'I1', 'I2', 'I3', 'I4', 'I5'],
           'structural-compliance': ['C'], 'tip-offset': ['ox', 'oy', 'oz'], 'sensor-gain': ['gain'], 'sensor-misalignment': ['ph0', 'ph1', 'ph2'],
           'sensor-lag': ['lag'], 'time-offset': ['delay'], 'saturation': ['lim'], 'quantization': [],
           'sensor-bias': [], 'sensor-drift': [], 'sensor-crosstalk': [], 'mains-hum': []}
LINEAR = ('sensor-bias', 'sensor-drift', 'sensor-crosstalk', 'mains-hum')
NORMAL = ['hertz-exponent', 'viscous-damping', 'hunt-crossley-damping', 'relaxation', 'hysteresis', 'stress-softening', 'adhesion',
          'stiffening-layer', 'surface-offset', 'stiffness-drift', 'stiffness-inhomogeneity']
TANG = ['coulomb-friction', 'viscous-friction', 'stribeck-friction', 'presliding', 'friction-rounding', 'load-dependent-friction', 'friction-anisotropy']
TOOL = ['tool-mass', 'tool-com', 'tool-inertia', 'structural-compliance', 'tip-offset']
SENS = ['sensor-bias', 'sensor-drift', 'sensor-crosstalk', 'sensor-misalignment', 'sensor-gain', 'sensor-lag', 'time-offset', 'saturation',
        'quantization', 'mains-hum']
EFF_KEY = {'k': 'stiffness', 'c': 'damping', 'rho': 'ratio', 'tau': 'time-constant'}
CHAN = ['fx', 'fy', 'fz', 'tx', 'ty', 'tz']


class Prog:
    """Waypoints of [depth, s1, s2, rx, ry, rz] joined by minimum-jerk moves, holds and windowed oscillations."""

    def __init__(self, start):
        self.cur, self.parts, self.ph, self.T = np.array(start, float), [], [], 0.

    def _add(self, x, phase):
        self.parts.append(x)
        self.ph.append((phase, self.T, self.T + len(x) * DT))
        self.T += len(x) * DT

    def move(self, T, phase, **to):
        tgt = self.cur.copy()
        for k, v in to.items():
            i = {'d': 0, 's1': 1, 's2': 2}.get(k)
            if k == 'th':
                tgt[3:] = v
            else:
                tgt[i] = v
        u = np.arange(1, int(T / DT) + 1)[:, None] / int(T / DT)
        self._add(self.cur + (tgt - self.cur) * u**3 * (10 - 15*u + 6*u*u), phase)
        self.cur = tgt

    def ramp(self, T, phase, **to):           # constant speed with rounded ends
        tgt = self.cur.copy()
        tgt[{'s1': 1, 's2': 2, 'd': 0}[list(to)[0]]] = list(to.values())[0]
        n = int(T / DT)
        w = np.minimum(1, np.minimum(np.arange(n), n - 1 - np.arange(n)) * DT / 0.12)
        u = np.cumsum(w * w * (3 - 2 * w))
        self._add(self.cur + (tgt - self.cur) * (u / u[-1])[:, None], phase)
        self.cur = tgt

    def hold(self, T, phase):
        self._add(np.repeat(self.cur[None], int(T / DT), 0), phase)

    def osc(self, T, f, amp, phase):
        t = np.arange(1, int(T / DT) + 1) * DT
        w = np.minimum(1, np.minimum(t, T - t) * f)
        w = w * w * (3 - 2 * w)
        self._add(self.cur + np.array(amp)[None] * (w * np.sin(2 * np.pi * f * t))[:, None], phase)

    def path(self):
        return np.concatenate(self.parts)


def arm_program(rng, D, L, opt):
    """Free rotation, pokes of several depths and speeds, holds, slides both ways at several loads and speeds, free again."""
    u = rng.uniform
    p = Prog([-u(.012, .02), 0, 0, 0, 0, 0])
    th = lambda a: rng.uniform(-a, a, 3)
    tl = opt.get('tilt', .06)
    p.hold(u(.3, .8), 'rest')

    def free(big):
        for _ in range(2 if big else 1):
            p.move(u(.9, 1.5), 'free', th=rng.choice([-1, 1], 3) * rng.uniform(.15, .45, 3))
            p.hold(u(.2, .5), 'free')
        a = np.zeros(6)
        a[3:] = rng.uniform(.05, .13, 3) * rng.choice([-1, 1], 3)
        p.osc(u(1.6, 2.4), u(1.6, 2.6), a, 'free')
        p.move(u(.8, 1.2), 'free', th=th(tl))
    if opt.get('free', True):
        free(True)
    depths = D * np.sort(rng.uniform([.3, .5, .92], [.5, .8, 1.0]))
    if opt.get('one_depth'):
        depths = np.array([D, D, D])[:1]
    p.move(u(.5, .8), 'approach', d=-.001)
    for r in range(opt.get('rounds', 1)):
        order = rng.permutation(len(depths)) if not opt.get('one_load') else np.arange(len(depths))
        for j in order:
            if opt.get('places', True):
                p.move(u(.3, .5), 'approach', s1=u(-L, L), s2=u(-L / 2, L / 2), th=th(tl) if opt.get('retilt', True) else p.cur[3:])
            p.move(u(.25, 1.6), 'poke', d=depths[j])
            p.hold(u(.15, .5), 'hold')
            if opt.get('last_in') and j == order[-1] and r == opt.get('rounds', 1) - 1:
                break
            p.move(u(.25, 1.6), 'retract', d=-u(.0008, .002))
            p.hold(u(.1, .3), 'free')
        if opt.get('last_in'):
            p.hold(u(1.5, 2.5), 'hold')
            return p
        if opt.get('hold', True):
            p.move(u(.2, .35), 'poke', d=D * u(.75, .95))
            p.hold(opt.get('hold_s', u(2., 4.)), 'hold')
            if opt.get('shake', True):
                a = np.zeros(6)
                p.move(.5, 'poke', d=D * .6)
                a[0] = D * .3
                for f in (u(.4, .9), u(2., 3.5)):
                    p.osc(3 / f + .3, f, a, 'poke')
            p.move(u(.4, .9), 'retract', d=-.001)
        if opt.get('slides', True):
            sp = [u(.003, .006), u(.012, .02), u(.035, .06)]
            for j, dd in enumerate([D * u(.3, .42), D * u(.75, .9)]):
                p.move(.4, 'approach', s1=-L, s2=-L / 3)
                p.move(.5, 'approach', d=dd)
                p.hold(u(.2, .4), 'hold')
                for q in rng.permutation(3):
                    ln = L if sp[q] > .01 else L / 4
                    c = p.cur[1]
                    sg = 1 if c < 0 else -1
                    p.ramp(2 * ln / sp[q] + .1, 'slide', s1=c + sg * 2 * ln)
                    if u() < .6 or q == 0:
                        p.ramp(2 * ln / sp[q] + .1, 'slide', s1=c)
                c = p.cur[2]
                p.ramp(L / sp[1], 'slide', s2=c + L)
                p.ramp(L / sp[2], 'slide', s2=c)
                p.ramp(L / sp[2], 'slide', s2=c + L)
                p.hold(u(.3, .6), 'hold')
                p.move(.5, 'retract', d=-.001)
    if opt.get('free', True):
        p.move(u(.5, .8), 'retract', d=-u(.008, .015))
        free(False)
    p.hold(u(.3, .6), 'rest')
    return p


def tester_program(rng, D, L, opt):
    u = rng.uniform
    p = Prog([-.0008, 0, 0, 0, 0, 0])
    p.hold(u(.5, 1.0), 'rest')
    for r in range(opt.get('rounds', 2)):
        for a in rng.permutation([u(.35, .55), u(.6, .8), 1.0]):
            T = np.exp(u(np.log(.3), np.log(4.)))
            p.move(T, 'poke', d=D * a)
            p.hold(u(.2, .6), 'hold')
            p.move(np.exp(u(np.log(.3), np.log(4.))), 'retract', d=-.0008)
            p.hold(u(.2, .5), 'free')
        p.move(.3, 'poke', d=D * u(.8, .95))
        p.hold(u(3., 6.), 'hold')
        p.move(.5, 'poke', d=D * .6)
        for f in (u(.3, .8), u(2., 3.5)):
            p.osc(3 / f + .3, f, [D * .3, 0, 0, 0, 0, 0], 'poke')
        p.move(.6, 'retract', d=-.0008)
        if opt.get('slides'):
            for dd in (D * u(.3, .42), D * u(.75, .9)):
                p.move(.5, 'approach', d=dd)
                for v in (u(.003, .006), u(.012, .02), u(.035, .06)):
                    ln = L if v > .01 else L / 3
                    for sg in (1, -1, 1):
                        p.ramp(ln / v + .1, 'slide', s1=p.cur[1] + (ln if sg > 0 else -ln))
                    p.ramp(ln / v + .1, 'slide', s1=p.cur[1] - ln)
                p.move(.5, 'retract', d=-.0008)
    p.hold(.5, 'rest')
    return p


def lowpass(x, fs, f, order=2):
    if f >= fs * .45:
        return x
    return sosfiltfilt(butter(order, f / (fs / 2), output='sos'), x, axis=0)


def air(t, P, R, arm, g, fc=None):
    """Sensor-frame ingredients of the tool's own wrench: gs = Rᵀ(g − a_origin), ω, α in sensor axes, R of the sensor."""
    Rs = R @ arm.R_st.T
    ps = P - Rs @ arm.r_tip
    if fc:
        fs = 1 / np.median(np.diff(t))
        tu = np.arange(t[0], t[-1], 1 / fs)
        z = np.c_[ps, Rs.reshape(len(t), 9)]
        z = np.column_stack([np.interp(tu, t, z[:, i]) for i in range(12)])
        z = lowpass(z, fs, fc)
        a = np.gradient(np.gradient(z[:, :3], 1 / fs, axis=0), 1 / fs, axis=0)
        Ru = z[:, 3:].reshape(-1, 3, 3)
    else:
        tu, Ru = t, Rs
        dt = t[1] - t[0]
        a = np.zeros_like(ps)
        a[1:-1] = (ps[2:] - 2 * ps[1:-1] + ps[:-2]) / dt**2
    dR = np.gradient(Ru, tu, axis=0)
    Om = np.einsum('nji,njk->nik', Ru, dR)
    w = np.c_[Om[:, 2, 1] - Om[:, 1, 2], Om[:, 0, 2] - Om[:, 2, 0], Om[:, 1, 0] - Om[:, 0, 1]] / 2
    al = np.gradient(w, tu, axis=0)
    gs = np.einsum('nji,nj->ni', Ru, g - a)
    if fc:
        gs, w, al = [np.column_stack([np.interp(t, tu, x[:, i]) for i in range(3)]) for x in (gs, w, al)]
    return gs, w, al, Rs


def tool_wrench(m, c, I6, gs, w, al):
    c = np.asarray(c, float)
    f = m * (gs - np.cross(al, c) - np.cross(w, np.cross(w, c)))
    I = np.array([[I6[0], I6[3], I6[4]], [I6[3], I6[1], I6[5]], [I6[4], I6[5], I6[2]]])
    tau = np.cross(c, f) - al @ I - np.cross(w, w @ I)
    return np.c_[f, tau]


@njit(cache=True)
def lag1(t, x, tau):
    y = x.copy()
    for i in range(1, x.shape[0]):
        a = 1 - np.exp(-(t[i] - t[i-1]) / tau)
        # input linear between samples
        y[i] = y[i-1] + a * (0.5 * (x[i] + x[i-1]) - y[i-1])
    return y


def sensor_chain(t, y, S):
    """Misalignment, crosstalk, gain, lag, delay, drift and bias: what a bridge and its clock do to a clean reading (t fine)."""
    y = y.copy()
    if S.get('ph') is not None:
        M = expso3(-np.array(S['ph'])[None])[0]
        y[:, :3] = y[:, :3] @ M.T
        y[:, 3:] = y[:, 3:] @ M.T
    if S.get('E') is not None:
        y = y + y @ np.array(S['E']).T
    y *= 1 + S.get('gain', 0.)
    if S.get('nl'):
        y = y * (1 + S['nl'] * (np.abs(y) / np.abs(y).max(0).clip(1e-9) - .5))
    if S.get('lag', 0.) > 0:
        y = lag1(t, y, S['lag'])
    if S.get('delay'):
        y = np.column_stack([np.interp(t - S['delay'], t, y[:, i]) for i in range(y.shape[1])])
    if S.get('reson'):                       # the mount rings: second order, little damping
        f0, z = S['reson']
        y = ring(y, 2 * np.pi * f0, z, t[1] - t[0])
    if S.get('bias') is not None:
        y = y + np.array(S['bias'])
    if S.get('drift') is not None:
        y = y + np.outer(t / 60, S['drift'])
    if S.get('warm') is not None:
        y = y + np.outer(1 - np.exp(-t / S['warm'][0]), S['warm'][1])
    if S.get('hum'):
        f0, a, ph = S['hum']
        y = y + np.outer(np.sin(2 * np.pi * f0 * t + ph), a) + .2 * np.outer(np.sin(4 * np.pi * f0 * t + 1), a)
    return y


@njit(cache=True)
def ring(y, w, z, dt):
    n, m = y.shape
    out = y.copy()
    for c in range(m):
        x, v = y[0, c], 0.0
        for i in range(n):
            v += dt * (w * w * (y[i, c] - x) - 2 * z * w * v)
            x += dt * v
            out[i, c] = x
    return out


class World:
    """One contact scene. `law`, `sens`, `tool` hold the truth; effects change them; run() moves the mass and gives clean readings."""

    def __init__(self, rng, arm, tester=False, opt=None):
        u = rng.uniform
        self.rng, self.arm, self.tester, self.opt = rng, arm, tester, opt or {}
        self.D = u(.003, .007) if not tester else u(.0015, .006)
        self.F = np.exp(u(np.log(5), np.log(25))) if not tester else np.exp(u(np.log(8), np.log(150)))
        self.L = u(.010, .022)
        self.mass, self.K = (u(2.5, 6), np.exp(u(np.log(4e3), np.log(2e4)))) if not tester else (u(2, 4), u(2e5, 6e5))
        self.zeta = u(.6, 1.0)
        self.ncol = int(rng.choice([1, 7, 19]))
        self.h = np.zeros(1) if self.ncol == 1 else np.sort(rng.normal(0, u(4e-6, 1.2e-5), self.ncol))
        self.h -= self.h.mean()
        self.law, self.sens, self.tool, self.out = {}, {}, {}, {}
        if arm is not None:
            g0 = np.array([0, 0, -9.81])
            self.hung = u() < .2
            if self.hung:
                a, b = u(-np.pi, np.pi), u(.3, 2.8)
                g0 = 9.81 * np.array([np.sin(b) * np.cos(a), np.sin(b) * np.sin(a), -np.cos(b)])
                g0 = np.round(g0, 4)
            self.g_rig = g0
            lev = rng.uniform(-1, 1, 3) * u(0, .0012)
            self.g = expso3(lev[None])[0] @ g0
            self.m_rig = round(u(.12, .5), 4)
            self.c_rig = np.round([u(-.01, .01), u(-.01, .01), u(.02, .06)], 4)
            dm = u(-1, 1) * min(.015 * self.m_rig, .0010 * self.F / 9.81)
            self.m, self.c = self.m_rig + dm, self.c_rig * (1 + u(-.01, .01, 3))
            self.I_rig = np.round(np.r_[rng.uniform(1e-4, 4e-4, 3), 0, 0, 0], 6) if u() < .5 else np.zeros(6)
            self.I = self.I_rig.copy()
            P0, R0 = arm.fk(arm.q0[None])
            self.P0, self.R0 = P0[0], R0[0]
            n = -self.R0[:, 2] if arm.sensor != 'x' else None
            n = expso3((rng.uniform(-1, 1, 3) * .06)[None])[0] @ n
        else:
            self.P0, self.R0, n = np.zeros(3), np.eye(3), np.array([0, 0, 1.])
            self.m = 0.
        n = np.round(n / np.linalg.norm(n), 6)
        self.n = n / np.linalg.norm(n)
        a = rng.normal(size=3) if arm is not None else np.array([1., 0, 0])
        a -= self.n * (a @ self.n)
        self.t1 = a / np.linalg.norm(a)
        self.t2 = np.cross(self.n, self.t1)
        self.prog = (tester_program if tester else arm_program)(rng, self.D, self.L, self.opt)
        N = sum(len(x) for x in self.prog.parts)
        w = rng.normal(size=(N // 50 + 2, 3))
        b = butter(2, 8 / 50)
        w = filtfilt(*b, w, axis=0)
        self.jig = np.column_stack([np.interp(np.arange(N), np.arange(len(w)) * 50, w[:, i]) for i in range(3)]) * u(.02, .25)
        self.th_drift = u(-1, 1) * 3e-6

    def set_base(self, base, mu, fkind):
        k1, r = self.F / self.D, self.rng.uniform
        d = {'hooke': dict(k=k1), 'kelvin-voigt': dict(k=k1, c=k1 * r(.01, .03)), 'hertz': dict(k=self.F / self.D**1.5, n=1.5)}.get(base)
        if base == 'hunt-crossley':
            n = r(1.2, 1.7)
            k = self.F / self.D**n
            d = dict(k=k, n=n, nB=n, B=k * r(1., 3.))
        elif base == 'zener':
            rho = r(.3, .8)
            d = dict(k=k1 / (1 + rho / 2), rho=rho, tau=np.exp(r(np.log(.2), np.log(1.5))))
        elif base == 'maxwell':
            d = dict(k=k1, rho=1., el=0., tau=r(2., 6.))
        self.base = base
        self.law.update(d)
        if mu:
            self.law.update(mu=mu, ell=r(.93e-4, 1.07e-4), fkind=1. if fkind == 'prandtl' else 0., lg_s=.3 if fkind == 'lugre' else 0.)
            if fkind == 'stick-slip':
                self.law.update(st_mu=.012 * mu, st_v=.004)
        self.fkind = fkind

    def run(self):
        N0 = sum(len(x) for x in self.prog.parts)
        x = self.prog.path()
        n, t1, t2 = self.n, self.t1, self.t2
        soft = 1 + self.F / self.D / self.K
        d = np.where(x[:, 0] > 0, x[:, 0] * soft, x[:, 0])
        pc = self.P0 - d[:, None] * n + x[:, 1:2] * t1 + x[:, 2:3] * t2
        vc = np.gradient(pc, DT, axis=0)
        R = self.R0 @ expso3(np.ascontiguousarray(x[:, 3:]))
        off = np.zeros_like(pc)
        if 'off' in self.tool:
            off = R @ np.array(self.tool['off'])
        doff = np.gradient(off, DT, axis=0)
        dth = self.th_drift * np.arange(N0) * DT / 60
        nr = n
        X, A, F, W = simulate(pack(self.law), self.h, DT, pc, vc, off, doff, dth, self.P0, nr, t1, t2, self.mass, self.K,
                              2 * self.zeta * np.sqrt(self.K * self.mass), self.tool.get('C', 0.), self.jig)
        t = np.arange(N0) * DT
        self.t, self.X, self.R, self.W = t, X, R, W
        assert np.all(np.isfinite(X)), 'world blew up'
        if self.tester:
            y = W[:, 1:3].copy() if self.opt.get('slides') else W[:, 1:2].copy()
        else:
            gs, w, al, Rs = air(t, X, R, self.arm, self.g)
            y = tool_wrench(self.m + self.tool.get('dm', 0), self.c + np.array(self.tool.get('dc', np.zeros(3))), self.I + np.array(self.tool.get('dI', np.zeros(6))), gs, w, al)
            fc = np.einsum('nji,nj->ni', Rs, F)
            rt = self.arm.r_tip + self.arm.R_st @ np.array(self.tool.get('off', np.zeros(3)))
            y[:, :3] += fc
            y[:, 3:] += np.cross(rt, fc)
            if 'cable' in self.out:          # a cable pulls on the tool: a spring to a hook in the base frame, felt in the sensor
                kc, hook, arm_r = self.out['cable']
                dv = hook - (X - Rs @ self.arm.r_tip)
                ln = np.linalg.norm(dv, axis=1)[:, None]
                fcab = np.einsum('nji,nj->ni', Rs, dv / ln * (kc * (ln - ln.min())))
                y[:, :3] += fcab
                y[:, 3:] += np.cross(arm_r, fcab)
        y = lowpass(y, 1 / DT, 120.)
        self.y = sensor_chain(t, y, self.sens)
        return self

    def view(self, t):
        """The motion at times t, as perfect encoders would show it."""
        f = np.clip(t / DT, 0, len(self.t) - 1.001)
        i = f.astype(int)
        a = (f - i)[:, None]
        P = self.X[i] * (1 - a) + self.X[i + 1] * a
        x = self.prog.path()
        th = x[i, 3:] * (1 - a) + x[i + 1, 3:] * a
        return P, self.R0 @ expso3(np.ascontiguousarray(th))

    def read(self, t):
        return np.column_stack([np.interp(t, self.t, self.y[:, i]) for i in range(self.y.shape[1])])


class Fit:
    """Our own fit of a catalogue model on a measured motion. q: what the rig and the log tell, nothing else."""

    def __init__(self, w, t, P, R, y, sig, sub=2500, fc=45.):
        self.w, self.t, self.y, self.sig = w, t, y, sig
        self.fs = 1 / np.median(np.diff(t))
        n, t1, t2 = w.n, w.t1, w.t2
        tu = np.arange(t[0], t[-1], 1 / self.fs)
        z = np.column_stack([np.interp(tu, t, P[:, i]) for i in range(3)])
        v = np.gradient(lowpass(z, self.fs, fc), 1 / self.fs, axis=0)
        self.v = np.column_stack([np.interp(t, tu, v[:, i]) for i in range(3)])
        self.c = P - w.P0
        if not w.tester:
            self.gs, self.om, self.al, self.Rs = air(t, P, R, w.arm, w.g_rig, fc)
            self.R = R
            fb = np.einsum('nij,nj->ni', self.Rs, y[:, :3])
            fm = fb @ n - w.m_rig * (w.g_rig @ n)
        else:
            fm = y[:, 0]
        self.fm = np.maximum(lowpass(np.interp(tu, t, fm), self.fs, 25.), 0)
        self.dfm = np.interp(t, tu, np.gradient(self.fm, 1 / self.fs))
        self.fm = np.interp(t, tu, self.fm)
        self.sel = np.unique(np.linspace(0, len(t) - 1, min(sub, len(t))).astype(int))
        self.one = np.ones(len(t))

    def predict(self, th):
        w = self.w
        law = {k: v for k, v in th.items() if k in LAW}
        if w.base == 'hunt-crossley':
            law['nB'] = law['n']
        if w.base == 'maxwell':
            law.update(el=0., rho=1.)
        c, v = self.c, self.v
        rt = None if w.tester else w.arm.r_tip
        if 'ox' in th:
            o = np.array([th['ox'], th['oy'], th['oz']])
            ob = self.R @ o
            c = c + ob
            v = v + np.gradient(ob, self.t, axis=0)
            rt = rt + w.arm.R_st @ o
        d, dd = -c @ w.n, -v @ w.n
        if th.get('C'):
            d = d - th['C'] * self.fm
            dd = dd - th['C'] * self.dfm
        o = run_law(pack(law), self.t, d, dd, c @ w.t1, c @ w.t2, v @ w.t1, v @ w.t2, self.one)
        if w.tester:
            y = o[:, :self.y.shape[1]]
        else:
            F = o[:, :1] * w.n + o[:, 1:2] * w.t1 + o[:, 2:] * w.t2
            fc = np.einsum('nji,nj->ni', self.Rs, F)
            cc = w.c_rig + np.array([th.get('dcx', 0), th.get('dcy', 0), th.get('dcz', 0)])
            I = w.I_rig + np.array([th.get(f'I{i}', 0) for i in range(6)])
            y = tool_wrench(w.m_rig + th.get('dm', 0), cc, I, self.gs, self.om, self.al)
            y[:, :3] += fc
            y[:, 3:] += np.cross(rt, fc)
            if 'ph0' in th:
                M = expso3(-np.array([[th['ph0'], th['ph1'], th['ph2']]]))[0]
                y = np.c_[y[:, :3] @ M.T, y[:, 3:] @ M.T]
        y = y * (1 + th.get('gain', 0))
        if th.get('lag', 0) > 1e-5:
            y = lag1(self.t, y, th['lag'])
        if th.get('delay'):
            y = np.column_stack([np.interp(self.t - th['delay'], self.t, y[:, i]) for i in range(y.shape[1])])
        if 'lim' in th:
            j = w.sens['clip'][0] if 'clip' in w.sens else (2 if not w.tester else 0)
            y[:, j] = np.clip(y[:, j], -th['lim'], th['lim'])
        if 'step' in th:
            y = np.round(y / th['step']) * th['step']
        return y

    def linear(self, names, y):
        t = self.t[self.sel]
        cols = []
        if 'sensor-bias' in names:
            cols.append(np.ones_like(t))
        if 'sensor-drift' in names:
            cols.append(t / 60)
        if 'mains-hum' in names:
            for f in (self.w.sens['hum'][0] if 'hum' in self.w.sens else 50., ):
                cols += [np.sin(2*np.pi*f*t), np.cos(2*np.pi*f*t), np.sin(4*np.pi*f*t), np.cos(4*np.pi*f*t)]
        return cols

    def resid(self, th, names):
        y = self.predict(th)[self.sel]
        r = self.y[self.sel] - y
        base = self.linear(names, y)
        if base or 'sensor-crosstalk' in names:
            for j in range(r.shape[1]):
                B = list(base)
                if 'sensor-crosstalk' in names:
                    B += [y[:, i] for i in range(r.shape[1]) if i != j]
                B = np.array(B).T
                r[:, j] -= B @ np.linalg.lstsq(B, r[:, j], rcond=None)[0]
        return r

    SCALE = dict(n=.05, c=None, lam=1., rho=.1, tau=.2, hy_r=.1, hy_l=5e-4, ss_r=.1, ss_l=5e-4, ad_F=.3, ad_l=3e-4, st_d=3e-4, z0=1e-4, drift=.05,
                 ih_a=.05, ih_x=3e-3, ih_w=3e-3, mu=.05, ell=1e-4, st_mu=.05, st_v=3e-3, vr=2e-3, p=.05, an=.05, dm=.02, gain=.02, lag=4e-3,
                 delay=4e-3, C=2e-6)
    LOW = dict(tau=5e-3, ell=2e-6, hy_l=2e-5, ss_l=2e-5, ad_l=1e-5, st_v=2e-4, vr=0., ih_w=1e-3, c=0., st_K=None, ad_F=0., lag=0., k=0., C=0., n=.5, p=.2)

    def guess(self, name):
        w = self.w
        g = dict(n=w.law.get('n', 1.) * 1.05, c=.01 * w.F / w.D, lam=1., rho=.1, tau=.8, hy_r=.05, hy_l=.2 * w.D, ss_r=.08, ss_l=.3 * w.D, ad_F=.05 * w.F, ad_l=5e-4,
                 st_K=.3 * w.F / w.D, st_d=.6 * w.D, z0=.01 * w.D, drift=.02, ih_a=.03, ih_x=0., ih_w=.01, mu=.2, cv=.02 * w.F / .03, st_mu=.03,
                 st_v=.008, ell=2e-4, vr=2e-3, p=.95, an=.02, dm=.01, gain=.01, lag=5e-3, delay=3e-3, C=.01 * w.D / w.F)
        return g.get(name, 0.)

    def fit(self, names, nfev=25):
        """names: base, known effects, hidden effects to allow. Starts at the truth where there is one."""
        w = self.w
        th0, keys = {}, []
        for nme in names:
            for k in BASE_PAR.get(nme, []) + [k for k in EFF_PAR.get(nme, []) if k not in BASE_PAR.get(nme, [])]:
                if k in keys:
                    continue
                keys.append(k)
                tv = w.law.get(k, LAW.get(k, 0)) if k in LAW else w.tv.get(k, 0)
                d0 = LAW.get(k, 0.)
                th0[k] = tv if tv != d0 else (self.guess(k) if nme not in BASE_PAR or tv == 0 else tv)
        if 'n' not in th0:
            th0['n'] = 1.5 if w.base == 'hertz' else 1.
        if w.base == 'hertz' and 'hertz-exponent' not in names:
            th0['n'] = 1.5
        if 'coulomb-friction' in names:
            if 'presliding' not in names:
                th0['ell'] = 1e-4
        if 'stiffness-inhomogeneity' in names:
            th0['ih_kind'] = w.law.get('ih_kind', 1.) or 1.
            th0['ih_dir'] = w.law.get('ih_dir', 0.)
        if 'saturation' in names:
            th0['lim'] = w.sens['clip'][1] if 'clip' in w.sens else .9 * np.abs(self.y[:, 2 if not w.tester else 0]).max()
        if 'quantization' in names and 'step' in w.sens:
            th0['step'] = w.sens['step']
            if not hasattr(self, 'nostep'):
                self.nostep = True
        kw = {k: v for k, v in th0.items() if k not in keys}
        if th0.get('ih_kind') == 3 and 'ih_x' in keys:
            keys = [k for k in keys if k not in ('ih_x', 'ih_w')]
            th0['ih_x'], th0['ih_w'] = 0., w.law.get('ih_w', .02)
        sc = np.array([self.SCALE.get(k) or max(abs(th0[k]) * .1, {'c': .01 * w.F / w.D, 'st_K': .1 * w.F / w.D, 'cv': .01 * w.F / .03,
                       'lim': .1}.get(k, 1e-3)) for k in keys])
        stepv = kw.pop('step', None) or th0.pop('step', None)

        def full(x):
            th = dict(th0)
            for k, s, xi in zip(keys, sc, x):
                v = th0[k] + s * xi
                lo = self.LOW.get(k)
                th[k] = v if lo is None else max(v, lo)
            return th
        sg = self.sig[None]
        fun = lambda x: (self.resid(full(x), names) / sg).ravel()
        if keys:
            s = least_squares(fun, np.zeros(len(keys)), method='trf', diff_step=None, x_scale=1., max_nfev=nfev, jac=lambda x: jac(fun, x))
            th = full(s.x)
        else:
            th = th0
        if stepv:
            th['step'] = stepv
        r = self.resid(th, names)
        g = r / sg
        nf = 3 if not w.tester else r.shape[1]
        self.last = th
        return dict(e=float(np.sqrt(np.mean(g**2))), ef=float(np.sqrt(np.mean(r[:, :nf]**2))),
                    et=float(np.sqrt(np.mean(r[:, nf:]**2))) if nf < r.shape[1] else 0., th=th, r=r)

    def rms(self):
        y = self.y
        nf = 3 if not self.w.tester else y.shape[1]
        return float(np.sqrt(np.mean(y[:, :nf]**2))), float(np.sqrt(np.mean(y[:, nf:]**2))) if nf < y.shape[1] else np.inf


def jac(fun, x):
    f0 = fun(x)
    J = np.empty((len(f0), len(x)))
    for i in range(len(x)):
        h = .02
        xp = x.copy()
        xp[i] += h
        J[:, i] = (fun(xp) - f0) / h
    return J
