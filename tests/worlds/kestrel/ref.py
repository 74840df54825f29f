"""A plain reference estimator used only to check this world: log + rig + list of effects -> residual. Not the tool under test."""
import os, json, tomllib, xml.etree.ElementTree as ET
import numpy as np
from numba import njit
from scipy.optimize import least_squares
from scipy.signal import butter, sosfiltfilt
from scipy.interpolate import BSpline
import sim

def read_log(path):
    if path.endswith('.parquet'):
        import pyarrow.parquet as pq
        t = pq.read_table(path); return {c: np.array(t[c].to_pylist()) if c == 'phase' else t[c].to_numpy() for c in t.column_names}
    if path.endswith('.npz'):
        z = np.load(path, allow_pickle=False); return {k: z[k] for k in z.files}
    with open(path) as f: head = f.readline().strip().split(',')
    if 'phase' in head:
        i = head.index('phase'); use = [j for j in range(len(head)) if j != i]
        a = np.loadtxt(path, delimiter=',', skiprows=1, usecols=use)
        return {head[j]: a[:, k] for k, j in enumerate(use)}
    a = np.loadtxt(path, delimiter=',', skiprows=1, ndmin=2)
    return {h: a[:, i] for i, h in enumerate(head)}

def read_urdf(path):
    r = ET.parse(path).getroot(); L = {l.get('name'): l for l in r.findall('link')}
    v = lambda s: np.array([float(x) for x in s.split()])
    p, ax, m, c, I, fx = [], [], [], [], [], {}
    for j in r.findall('joint'):
        o = v(j.find('origin').get('xyz')); y = v(j.find('origin').get('rpy'))[2]
        if j.get('type') == 'fixed': fx[j.find('child').get('link')] = (o, y); continue
        p.append(o); ax.append(v(j.find('axis').get('xyz')))
        i = L[j.find('child').get('link')].find('inertial'); m.append(float(i.find('mass').get('value'))); c.append(v(i.find('origin').get('xyz')))
        t = i.find('inertia'); g = lambda k: float(t.get(k))
        I.append([[g('ixx'), g('ixy'), g('ixz')], [g('ixy'), g('iyy'), g('iyz')], [g('ixz'), g('iyz'), g('izz')]])
    return dict(p=np.array(p), ax=np.array(ax), m=np.array(m), c=np.array(c), I=np.array(I), fixed=fx)

@njit(cache=True)
def fk_series(q, p, ax):
    T, n = q.shape
    O = np.empty((T, 3)); R = np.empty((T, 3, 3))
    for k in range(T):
        o, z, r = sim.fk(q[k], p, ax); O[k] = o[n-1]; R[k] = r[n-1]
    return O, R

def smooth(x, t, fc):
    dt = np.median(np.diff(t)); fs = 1/dt
    if fc >= .45*fs or len(t) < 40: return x
    tu = np.arange(t[0], t[-1] + dt/2, dt)
    sos = butter(2, fc, fs=fs, output='sos'); X = np.atleast_2d(x.T).T
    out = np.empty(X.shape)
    for j in range(X.shape[1]): out[:, j] = np.interp(t, tu, sosfiltfilt(sos, np.interp(tu, t, X[:, j])))
    return out.reshape(x.shape)

def grad(x, t): return np.gradient(x, t, axis=0)

@njit(cache=True)
def normal_law(t, d, dd, th, h, mode):
    # th: k n c lam r1 t1 r2 t2 hA hL mull mulllen Fa La K2 d2 drift
    n = t.size; N = np.zeros(n); Fe = np.zeros(n)
    b1 = 0.; b2 = 0.; fp = 0.; hy = 0.; dm = 0.; tch = False; dp = 0.
    for i in range(n):
        dt = t[i]-t[i-1] if i else 0.
        x = d[i]
        if x > 0:
            tch = True
            if x > dm: dm = x
            fe = th[0]*h[i]*x**th[1]*(1 + th[16]*t[i]/60)
            e1 = np.exp(-.5*dt/th[5]); e2 = np.exp(-.5*dt/th[7])
            b1 = b1*e1*e1 + th[4]*(fe-fp)*e1; b2 = b2*e2*e2 + th[6]*(fe-fp)*e2; fp = fe
            F = fe*(1 - th[10]*(1 - np.exp(-(dm-x)/th[11]))) + b1 + b2
            F = F*(1 + th[3]*dd[i]) + th[2]*dd[i]
            if x > th[15]: F += th[14]*(x-th[15])
            if th[8] != 0:
                s = x - dp
                a = np.exp(-abs(s)/th[9]); hy = hy*a + np.sign(s)*(1-a); F += th[8]*hy
            if F < 0: F = 0.
            if th[12] != 0: F -= th[12]*min(1., dm/5e-5)
            N[i] = F
        else:
            b1 *= np.exp(-dt/th[5]); b2 *= np.exp(-dt/th[7]); fp = 0.; hy = 0.
            if tch and th[12] != 0:
                if x > -th[13]: N[i] = -th[12]*(1 + x/th[13])
                else: tch = False; dm = dm if th[10] != 0 else 0.
        dp = max(x, 0.)
    return N

@njit(cache=True)
def tang_law(N, d, x, y, vx, vy, th, rnd):
    # th: mu cv dmu vs len p N0 an vr
    n = N.size; T = np.zeros((n, 2)); zx = 0.; zy = 0.
    for i in range(n):
        if d[i] > 0 and N[i] > 0:
            v = np.sqrt(vx[i]**2 + vy[i]**2)
            if rnd:
                r = np.sqrt(v*v + th[8]**2); zx = vx[i]/r; zy = vy[i]/r
            elif i:
                sx = x[i]-x[i-1]; sy = y[i]-y[i-1]; s = np.sqrt(sx*sx+sy*sy)
                if s > 0:
                    a = np.exp(-s/th[4]); zx = zx*a + sx/s*(1-a); zy = zy*a + sy/s*(1-a)
            mu = th[0]*(N[i]/th[6])**th[5] + th[2]*np.exp(-(v/th[3])**2)
            T[i, 0] = -mu*N[i]*(1+th[7])*zx - th[1]*vx[i]; T[i, 1] = -mu*N[i]*(1-th[7])*zy - th[1]*vy[i]
        else: zx = 0.; zy = 0.
    return T

# effect -> list of (parameter, start, scale, low, high)
def table(k0):
    i = np.inf
    return {
     'hooke': [('stiffness', k0, k0, 0, i)], 'hertz': [('stiffness', k0, k0, 0, i)],
     'kelvin-voigt': [('stiffness', k0, k0, 0, i), ('damping', 5, 5, 0, i)],
     'zener': [('stiffness', k0, k0, 0, i), ('ratio', .3, .1, 0, 5), ('tau', 1, 1, .02, 100)],
     'hertz-exponent': [('n', 1.2, .1, .6, 3)], 'viscous-damping': [('c', 5, 5, 0, i)], 'hunt-crossley-damping': [('lam', .3, .3, 0, i)],
     'relaxation': [('ratio', .3, .1, 0, 5), ('tau', 1, 1, .02, 100)], 'hysteresis': [('amplitude', .3, .3, 0, i), ('length', 5e-4, 3e-4, 2e-5, .02)],
     'stress-softening': [('ratio', .2, .1, 0, .95), ('length', 1e-3, 5e-4, 5e-5, .05)], 'adhesion': [('force', .2, .1, 0, i), ('length', 5e-4, 3e-4, 1e-5, .01)],
     'stiffening-layer': [('stiffness', k0*.5, k0*.5, 0, i), ('depth', 2e-3, 5e-4, 0, .02)], 'surface-offset': [('offset', 0, 1e-4, -3e-3, 3e-3)],
     'stiffness-drift': [('rate', .1, .1, -3, 3)], 'stiffness-inhomogeneity': [(f'w{j}', 0, .2, -.9, 5) for j in range(12)],
     'coulomb-friction': [('mu', .3, .1, 0, 3)], 'viscous-friction': [('c', 5, 5, 0, i)], 'stribeck-friction': [('dmu', .1, .1, -1, 3), ('vs', .01, .005, 1e-4, 1)],
     'presliding': [('length', 1e-3, 5e-4, 1e-6, .05)], 'load-dependent-friction': [('p', -.1, .1, -1, 1)], 'friction-anisotropy': [('a', .1, .1, -.9, .9)],
     'friction-rounding': [('v_r', .005, .003, 1e-5, 1)],
     'tool-mass': [('mass', .1, .05, -2, 5)], 'tool-com': [(a, 0, .01, -.3, .3) for a in 'xyz'], 'structural-compliance': [('compliance', 1e-5, 2e-5, 0, .01)],
     'tip-offset': [(a, 0, 1e-3, -.05, .05) for a in 'xyz'], 'tool-inertia': [(a, 0, 1e-3, -1, 1) for a in 'xyz'],
     'sensor-bias': [(f'b{j}', 0, [.1, .01][j > 2], -i, i) for j in range(6)], 'sensor-drift': [(f'd{j}', 0, [.3, .03][j > 2], -i, i) for j in range(6)],
     'sensor-crosstalk': [(f'm{a}{b}', 0, .02, -i, i) for a in range(6) for b in range(6) if a != b],
     'sensor-misalignment': [(a, 0, .02, -1, 1) for a in 'xyz'], 'sensor-gain': [('gain', 0, .02, -.8, 3)], 'sensor-lag': [('tau', .01, .01, 0, .5)],
     'time-offset': [('offset', 0, .01, -.2, .2)], 'saturation': [('limit', 1, .5, 0, i)], 'mains-hum': [(f'{p}{j}', 0, .05, -i, i) for j in range(6) for p in 'sc'],
     'quantization': [], 'none': [], 'rigid-body': []}

def row_contact(s): return s.row['base'][0] != 'none'

class Contact:
    def __init__(s, case_dir, row):
        s.row = row
        s.rig = tomllib.load(open(os.path.join(case_dir, 'rig.toml'), 'rb'))
        L = s.L = read_log(os.path.join(case_dir, os.path.basename(row['log'])))
        s.t = L['t'].astype(float); t = s.t
        s.robot = 'q1' in L and 'fx' in L
        if s.robot:
            U = read_urdf(os.path.join(case_dir, s.rig['robot']['model'])); n = len(U['m'])
            q = np.stack([L[f'q{i+1}'] for i in range(n)], 1)
            O, R = fk_series(q, U['p'], U['ax'])
            fl, _ = U['fixed']['flange']; se, yaw = U['fixed']['ft_sensor']; tip, _ = U['fixed']['tool_tip']
            Rz = np.array([[np.cos(yaw), -np.sin(yaw), 0], [np.sin(yaw), np.cos(yaw), 0], [0, 0, 1]])
            s.R = R @ Rz; s.ps = O + R @ (fl + se); s.tip = tip
            s.W = np.stack([L[c] for c in ('fx', 'fy', 'fz', 'tx', 'ty', 'tz')], 1)
            s.m = s.rig.get('tool', {}).get('mass', 0.); s.com = np.array(s.rig.get('tool', {}).get('com', [0, 0, 0.])); s.g = np.array(s.rig['robot'].get('gravity', [0, 0, -9.81]))
            fc = 15
            s.asen = grad(grad(smooth(s.ps, t, fc), t), t)
            Rs_ = smooth(s.R.reshape(-1, 9), t, fc).reshape(-1, 3, 3); s.Rdd = grad(grad(Rs_, t), t)
            Rd = grad(Rs_, t); Om = np.einsum('tij,tkj->tik', Rd, Rs_); w = np.stack([Om[:, 2, 1], Om[:, 0, 2], Om[:, 1, 0]], 1)
            al = grad(w, t); s.wb = np.einsum('tji,tj->ti', s.R, w); s.ab = np.einsum('tji,tj->ti', s.R, al)
            s.surf = 'surface' in s.rig
            if s.surf:
                S = s.rig['surface']; s.sp = np.array(S['point']); s.n = np.array(S['normal'], float); s.n /= np.linalg.norm(s.n)
                a = np.array(S['tangent'], float); a -= (a @ s.n)*s.n; s.t1 = a/np.linalg.norm(a); s.t2 = np.cross(s.n, s.t1)
            s.scale = np.array([1, 1, 1, 10, 10, 10.])
        else:
            s.surf = True
            s.depth = L['depth']; s.N = L['normal_force']; s.x = L.get('slip1', np.zeros(len(t))); s.T = L.get('tangential_force1')
            s.vz = L['depth_rate'] if 'depth_rate' in L else grad(smooth(s.depth, t, 40), t); s.vx = grad(smooth(s.x, t, 40), t)
        if s.surf:
            s.geo(np.zeros(3))
            ref = s.Nm
            i = s.depth > .3*s.depth.max(); s.k0 = max(np.median(ref[i]/s.depth[i]), 10.) if i.any() else 1000.
            if s.row['base'][0] == 'hertz': s.k0 = max(np.median(ref[i]/s.depth[i]**1.5), 10.)
            N = np.maximum(ref, 0); s.N0 = float(np.median(N[N > .1*N.max()]))
        else: s.k0 = 1000.
        s.U = None

    def geo(s, off):
        if not s.robot: s.Nm = s.N; return
        tip = s.tip + off
        p = s.ps + s.R @ tip - s.sp
        s.depth = -(p @ s.n); ps_ = smooth(p, s.t, 30); s.x = ps_ @ s.t1; s.y = ps_ @ s.t2
        v = grad(smooth(p, s.t, 40), s.t); s.vz = -(v @ s.n); s.vx = v @ s.t1; s.vy = v @ s.t2
        if not hasattr(s, 'Nm'):
            ft = np.einsum('tji,tj->ti', s.R, s.m*(s.g - s.asen))
            s.Nm = smooth(np.einsum('tij,tj->ti', s.R, s.W[:, :3] - ft) @ s.n, s.t, 40)

    def pred(s, eff, th):
        """th: dict effect.parameter -> value; returns prediction, measurement in common columns"""
        g = lambda k, d=0.: th.get(k, d)
        t = s.t
        if s.surf and s.row['base'][0] != 'none':
            if s.robot and 'tip-offset' in eff: s.geo(np.array([g('tip-offset.x'), g('tip-offset.y'), g('tip-offset.z')]))
            d = s.depth + g('surface-offset.offset'); d = d - g('structural-compliance.compliance')*s.Nm
            k = next(g(b+'.stiffness') for b in ('hooke', 'kelvin-voigt', 'hertz', 'zener') if b in eff)
            n = g('hertz-exponent.n', 1.5 if 'hertz' in eff else 1.)
            zr, zt = (g('zener.ratio'), g('zener.tau')) if 'zener' in eff else (0., 1.)
            P = np.array([k, n, g('kelvin-voigt.damping') + g('viscous-damping.c'), g('hunt-crossley-damping.lam'), zr, zt, g('relaxation.ratio'), g('relaxation.tau', 1.),
                          g('hysteresis.amplitude'), g('hysteresis.length', 1e-3), g('stress-softening.ratio'), g('stress-softening.length', 1e-3), g('adhesion.force'), g('adhesion.length', 1e-3),
                          g('stiffening-layer.stiffness'), g('stiffening-layer.depth', 1.), g('stiffness-drift.rate')])
            h = np.ones(len(t))
            if 'stiffness-inhomogeneity' in eff:
                lo, hi = s.x.min()-1e-6, s.x.max()+1e-6
                kn = np.r_[[lo]*3, np.linspace(lo, hi, 10), [hi]*3]
                h = 1 + BSpline(kn, np.array([g(f'stiffness-inhomogeneity.w{j}') for j in range(12)]), 3)(s.x)
            N = normal_law(t, d, s.vz, P, h, 0)
            rnd = 'friction-rounding' in eff
            Q = np.array([g('coulomb-friction.mu'), g('viscous-friction.c'), g('stribeck-friction.dmu'), g('stribeck-friction.vs', .01), g('presliding.length', 1e-4), g('load-dependent-friction.p'), s.N0,
                          g('friction-anisotropy.a'), g('friction-rounding.v_r', .01)])
            T = tang_law(np.maximum(N, 0), d, s.x, s.y if s.robot else np.zeros(len(t)), s.vx, s.vy if s.robot else np.zeros(len(t)), Q, rnd)
        else: N = np.zeros(len(t)); T = np.zeros((len(t), 2))
        if s.robot:
            fc = (N[:, None]*s.n + T[:, :1]*s.t1 + T[:, 1:]*s.t2) if s.surf else np.zeros((len(t), 3))
            m = s.m + g('tool-mass.mass'); com = s.com + np.array([g('tool-com.'+a) for a in 'xyz'])
            ac = s.asen + s.Rdd @ com
            ft = np.einsum('tji,tj->ti', s.R, m*(s.g - ac)); fcs = np.einsum('tji,tj->ti', s.R, fc)
            rt = s.tip + np.array([g('tip-offset.'+a) for a in 'xyz'])
            tq = np.cross(com, ft) + np.cross(rt, fcs)
            if 'tool-inertia' in eff:
                I = np.array([g('tool-inertia.'+a) for a in 'xyz']); tq = tq - (I*s.ab + np.cross(s.wb, I*s.wb))
            W = np.concatenate([ft + fcs, tq], 1)
        else:
            W = np.stack([N, T[:, 0]], 1) if s.T is not None else N[:, None]
        if 'sensor-misalignment' in eff:
            v = np.array([g('sensor-misalignment.'+a) for a in 'xyz'])
            W = np.concatenate([W[:, :3] - np.cross(v, W[:, :3]), W[:, 3:] - np.cross(v, W[:, 3:])], 1)
        if 'sensor-crosstalk' in eff:
            Mx = np.eye(6)
            for a in range(6):
                for b in range(6):
                    if a != b: Mx[a, b] = g(f'sensor-crosstalk.m{a}{b}')
            sc = np.array([1, 1, 1, .1, .1, .1]); W = W @ (Mx*sc[:, None]/sc[None]).T
        W = W*(1 + g('sensor-gain.gain'))
        if 'sensor-lag' in eff:
            tau = max(g('sensor-lag.tau'), 1e-5); dt = np.diff(t, prepend=t[0]); W = _lp(W, dt, tau)
        if 'time-offset' in eff:
            o = g('time-offset.offset'); W = np.stack([np.interp(t-o, t, W[:, j]) for j in range(W.shape[1])], 1)
        W = W.copy()
        for j in range(W.shape[1]):
            W[:, j] += g(f'sensor-bias.b{j}') + g(f'sensor-drift.d{j}')*t/60
        if 'mains-hum' in eff:
            for j in range(W.shape[1]): W[:, j] += g(f'mains-hum.s{j}')*np.sin(2*np.pi*50*t) + g(f'mains-hum.c{j}')*np.cos(2*np.pi*50*t)
        if 'saturation' in eff: W = np.minimum(W, th['saturation.limit'])
        return W, (s.W if s.robot else (np.stack([s.N, s.T], 1) if s.T is not None else s.N[:, None]))

    def fit(s, eff, start=None):
        start = start or {}
        tb = table(s.k0); names, x0, sc, lo, hi = [], [], [], [], []
        for e in eff:
            for (p, a, b, l, u) in tb[e]:
                if not s.robot and e in ('sensor-bias', 'sensor-drift') and int(p[1]) >= (2 if s.T is not None else 1): continue
                names.append(f'{e}.{p}'); x0.append(start.get(names[-1], a)); sc.append(b); lo.append(l); hi.append(u)
        # time grid: thin long logs for the fit when the law allows it
        x0 = np.array(x0, float); sc = np.array(sc, float); lo = np.array(lo, float); hi = np.array(hi, float); x0 = np.clip(x0, lo + 1e-9*sc, hi - 1e-9*sc)
        S = s.scale if s.robot else 1.
        st = max(1, len(s.t)//20000)
        def res(z):
            W, Y = s.pred(eff, dict(zip(names, z*sc))); return ((W - Y)*S)[::st].ravel()
        if len(names) == 0: z = np.zeros(0)
        else:
            r = least_squares(res, x0/sc, bounds=(lo/sc, hi/sc), method='trf', max_nfev=25, x_scale='jac', diff_step=1e-5)
            z = r.x
        W, Y = s.pred(eff, dict(zip(names, z*sc)))
        D = W - Y
        f = slice(0, 3) if s.robot else slice(None)
        n3 = lambda A: float(np.sqrt((A[:, f]**2).sum(1).mean()))
        ci = (s.depth > 0) if s.surf and row_contact(s) else np.ones(len(Y), bool)
        out = dict(rms=n3(D), reading=n3(Y[ci]), rms_contact=n3(D[ci]), th={k: float(v) for k, v in zip(names, z*sc)}, all=float(np.sqrt((((D)*S)**2).sum(1).mean())))
        if s.robot: out['torque'] = float(np.sqrt((D[:, 3:]**2).sum(1).mean())); out['torque_reading'] = float(np.sqrt((Y[:, 3:]**2).sum(1).mean()))
        return out

@njit(cache=True)
def _lp(W, dt, tau):
    out = W.copy()
    for i in range(1, W.shape[0]):
        a = 1 - np.exp(-dt[i]/tau)
        for j in range(W.shape[1]): out[i, j] = out[i-1, j] + a*(W[i, j] - out[i-1, j])
    return out

# ---------------------------------------------------------------- joints and drives
class Joint:
    delays = (0., .004, .008)
    def __init__(s, case_dir, row):
        s.row = row; s.rig = tomllib.load(open(os.path.join(case_dir, 'rig.toml'), 'rb'))
        L = read_log(os.path.join(case_dir, os.path.basename(row['log']))); t = s.t = L['t'].astype(float)
        n = s.n = sum(k.startswith('tau') for k in L)
        q = np.stack([L[f'q{i+1}'] for i in range(n)], 1); s.q = q; s.tau = np.stack([L[f'tau{i+1}'] for i in range(n)], 1)
        fc = 8. if 'robot' in s.rig else 20.
        qs = smooth(q, t, fc); s.v = grad(qs, t); s.a = grad(s.v, t); s.qs = qs
        if 'dq1' in L: s.vd = np.stack([L[f'dq{i+1}'] for i in range(n)], 1)
        if 'robot' in s.rig:
            U = s.U = read_urdf(os.path.join(case_dir, s.rig['robot']['model'])); s.g = np.array(s.rig['robot'].get('gravity', [0, 0, -9.81]))
            s.ID = sim.id_series(qs, s.v, s.a, U['p'], U['ax'], U['m'], U['c'], U['I'], s.g)
        else: s.U = None; s.ID = np.zeros_like(q)
        s.qb = smooth(q, t, 40.)
        s.fc = fc
        s.e = slice(20, -20) if len(t) > 300 else slice(None)

    def bristle(s, L):
        """sign of the velocity as a bristle in the measured angle"""
        out = np.zeros_like(s.q)
        for j in range(s.n): out[:, j] = _br(s.qb[:, j], L)
        return out

    def regress(s, eff, nl):
        n = s.n; cols = []
        B = s.bristle(nl['br'])
        def per(X):
            for j in range(n):
                c = np.zeros_like(s.q); c[:, j] = X[:, j]; cols.append(c)
        one = np.ones_like(s.q)
        if s.U is None and 'rigid-body' in eff: per(s.a)
        for e in eff:
            if e == 'joint-coulomb-friction': per(B)
            if e == 'joint-viscous-friction': per(s.v)
            if e in ('joint-friction-asymmetry', ): per(np.abs(B))
            if e == 'joint-torque-offset': per(one)
            if e == 'rotor-inertia': per(s.a)
            if e == 'joint-spring': per(s.qs)
            if e == 'joint-stribeck-friction': per(B*np.exp(-(s.v/nl['vs'])**2))
            if e == 'joint-load-friction': per(B*np.abs(s.ID))
            if e == 'joint-torque-gain' and s.U is not None: per(s.ID)     # tau = (1+g)(ID + ...); friction and rotors take up the rest
            if e == 'joint-torque-ripple':
                for h in (1, 2): per(np.sin(h*nl['k']*s.qs)); per(np.cos(h*nl['k']*s.qs))
            if e == 'payload':
                U = s.U
                for mc in ([1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]):
                    def idm(dm, dc):
                        m = U['m']*0; c = U['c'].copy(); m[-1] = 1.; c[-1] = dc
                        return sim.id_series(s.qs, s.v, s.a, U['p'], U['ax'], m, c, U['I']*0, s.g)
                    # mass point: m*(1), m*c linear part -> use three offsets
                    if mc[0]: z0 = idm(1, np.zeros(3)); cols.append(z0)
                    else:
                        e1 = np.array(mc[1:], float); cols.append((idm(1, e1*.1) - idm(1, -e1*.1))/.2)
        return cols

    def fit(s, eff, start=None):
        best = None; start = start or {}
        brs = [1e-6, 3e-4, 6e-4, 1.2e-3]
        vss = [start['joint-stribeck-friction.vs']] if 'joint-stribeck-friction.vs' in start else [.06, .12, .25]
        if 'joint-stribeck-friction' not in eff: vss = [1.]
        ks = [start.get('joint-torque-ripple.k', 1.)]
        best_d = None
        Y = s.tau - s.ID
        w = 1/np.maximum(s.tau.std(0), .05*s.tau.std(0).max())*0 + 1
        for br in brs:
            for vs in vss:
                for k in ks:
                  C0 = s.regress(eff, dict(br=br, vs=vs, k=k))
                  for dl in s.delays:
                    sh = lambda X: np.stack([np.interp(s.t-dl, s.t, X[:, j]) for j in range(s.n)], 1)
                    C = [c if c is s.tau else sh(c) for c in C0]; Y = s.tau - sh(s.ID)
                    if C:
                        A = np.stack([(c*w)[s.e].ravel() for c in C], 1); y = (Y*w)[s.e].ravel()
                        th = np.linalg.lstsq(A, y, rcond=None)[0]; r = y - A @ th
                    else: r = Y[s.e].ravel(); th = np.zeros(0)
                    rms = float(np.sqrt((r**2).mean()*s.n))
                    if best is None or rms < best['rms']: best = dict(delay=dl, rms=rms, reading=float(np.sqrt((s.tau**2).sum(1).mean())), th=list(map(float, th)), br=br, vs=vs)
        return best

@njit(cache=True)
def _br(q, L):
    z = 0.; out = np.zeros(q.size)
    for i in range(1, q.size):
        s = q[i]-q[i-1]; a = np.exp(-abs(s)/L); z = z*a + np.sign(s)*(1-a); out[i] = z
    return out

def load(root, row):
    d = os.path.dirname(os.path.join(root, row['log']))
    return (Joint if row['base'][0] == 'rigid-body' else Contact)(d, row)
