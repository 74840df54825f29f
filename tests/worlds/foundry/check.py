#!/usr/bin/env python3
"""check.py DATA [--alt] [--only row_03 ...] : independent look at the logs. Own contact frame from the logged joints (FK from sim.fk_np,
checked against pinocchio by t1.py), own catalogue-form laws and least squares. For every row: units and ranges, contact
really made, residual rms with the start model / with the true model / wrench noise; `effect` = sqrt(start^2 - true^2) / true must be >= 2.
--alt tries every other effect in place of the hidden one (single rows) or on top (none rows) and lists the rivals."""
import argparse, csv, json, os, sys, tomllib
os.environ.setdefault('OMP_NUM_THREADS', '1'); os.environ.setdefault('OPENBLAS_NUM_THREADS', '1')
import numpy as np
from numba import njit
from scipy.optimize import least_squares
from scipy.signal import savgol_filter, lfilter
import sim

def load(d):
    rig = tomllib.load(open(f'{d}/rig.toml', 'rb'))
    if os.path.exists(f'{d}/log.parquet'):
        import pyarrow.parquet as pq; T = pq.read_table(f'{d}/log.parquet'); c = {k: np.array(T[k].to_pylist()) for k in T.column_names}
    else:
        r = list(csv.reader(open(f'{d}/log.csv'))); c = {}
        for j, k in enumerate(r[0]):
            v = [x[j] for x in r[1:]]; c[k] = np.array(v) if k == 'phase' else np.array(v, float)
    return rig, c
def odd(x): return int(x)//2*2+1

# --------------------------------------------------------------- catalogue-form laws (own code)
@njit(cache=True)
def memory(Fe, d, dd, h, r, tau, bwA, bwL, mr, ml, Fa, La, c, clamp):
    n = d.size; N = np.empty(n); s = np.zeros(r.size); z = 0.; dm = 0.; on = False; Fp = 0.
    for i in range(n):
        F = Fe[i]
        if mr != 0:
            if d[i] > dm: dm = d[i]
            F *= 1-mr*np.tanh(max(dm-max(d[i], 0.), 0.)/ml)
        y = F
        for j in range(r.size):
            E = np.exp(-h/tau[j]); s[j] = s[j]*E+r[j]*(F-Fp)*tau[j]/h*(1-E); y += s[j]
        Fp = F
        if bwA != 0:
            if d[i] > 0:
                z += h*dd[i]/bwL*(1-abs(z)*(1. if dd[i]*z > 0 else 0.)); z = min(max(z, -1.), 1.)
                y += bwA*z*min(d[i]/bwL, 1.)
            else: z = 0.
        if d[i] <= 0: y = 0.
        if clamp and y+c*dd[i] < 0: y = -c*dd[i] if d[i] > 0 else 0.
        if Fa != 0:
            if d[i] > 0: on = True; y -= Fa
            elif d[i] < -La: on = False
            elif on: y -= Fa*(1+d[i]/La)
        N[i] = y
    return N
@njit(cache=True)
def bristle(x, y, b, on):
    n = x.size; z = np.zeros((n, 2)); a = 0.; c = 0.
    for i in range(1, n):
        dx = x[i]-x[i-1]; dy = y[i]-y[i-1]; v = np.sqrt(dx*dx+dy*dy)
        a = (a+dx/b)/(1+v/b); c = (c+dy/b)/(1+v/b)
        if not on[i]: a = 0.; c = 0.
        z[i, 0] = a; z[i, 1] = c
    return z
# parameter starts: effect -> list of (name, start, scale)
E = {'hooke': [('k', 1000, 1000)], 'kelvin-voigt': [('k', 1000, 1000), ('c', 3, 5)], 'hertz': [('k', 2e4, 2e4)], 'zener': [('k', 1000, 1000), ('r0', .5, .3), ('tau0', 5, 5)], 'none': [],
     'hertz-exponent': [('n', 1.2, .3)], 'viscous-damping': [('c', 3, 5)], 'hunt-crossley-damping': [('lam', 1, 1)], 'relaxation': [('r1', .3, .2), ('tau1', .5, .5), ('r2', .1, .2), ('tau2', 5, 5)],
     'hysteresis': [('bwA', .3, .3), ('bwL', 5e-4, 5e-4)], 'stress-softening': [('mr', .2, .2), ('ml', 2e-3, 1e-3)], 'adhesion': [('Fa', .3, .5), ('La', 5e-4, 5e-4)], 'stiffening-layer': [('K2', 800, 800), ('db', .003, .002)],
     'surface-offset': [('z0', 0, 2e-4)], 'stiffness-drift': [('al', 0, .2)], 'stiffness-inhomogeneity': [(f'g{i}', 0, .2) for i in range(14)], 'coulomb-friction': [('mu', .4, .2)], 'viscous-friction': [('vt', 0, 10)],
     'stribeck-friction': [('dmu', .1, .2), ('vs', .01, .01)], 'presliding': [('bl', 4e-4, 3e-4)], 'load-dependent-friction': [('p', 0, .3)], 'friction-anisotropy': [('an', 0, .2)], 'friction-rounding': [('vr', 2e-3, 2e-3)],
     'structural-compliance': [('C', 1e-5, 3e-5)], 'tip-offset': [('o0', 0, 1e-3), ('o1', 0, 1e-3), ('o2', 0, 1e-3)], 'tool-mass': [('dm', 0, .05)], 'tool-com': [('c0', 0, .01), ('c1', 0, .01), ('c2', 0, .01)],
     'sensor-bias': [(f'b{i}', 0, .3 if i < 3 else .03) for i in range(6)], 'sensor-drift': [(f'd{i}', 0, .5 if i < 3 else .05) for i in range(6)], 'sensor-crosstalk': [(f'x{i}', 0, .05) for i in range(6)], 'sensor-misalignment': [(f'm{i}', 0, .05) for i in range(3)],
     'sensor-gain': [('gn', 0, .1)], 'sensor-lag': [('lag', .01, .01)], 'time-offset': [('to', .001, .01)], 'saturation': [('sat', 6, 3)], 'mains-hum': [(f'h{i}', .1, .3) for i in range(24)], 'tool-inertia': [('ti', 0, .1)]}
BND = dict(C=(0, 1e-2), tau0=(1e-2, 1e3), tau1=(1e-2, 1e3), tau2=(1e-2, 1e3), r0=(-.5, 20), r1=(-.5, 20), r2=(-.5, 20), bwL=(2e-5, 5e-3), ml=(2e-4, 2e-2), La=(1e-5, 5e-3), db=(0, .02), vs=(1e-4, .2), bl=(2e-5, 5e-3), vr=(1e-5, .1), lag=(0, .2), n=(.7, 3), to=(-.1, .1), sat=(.5, 200), mr=(-.5, .95), k=(1, 1e7), mu=(0, 3), p=(-2, 2))
class Contact:
    def __init__(s, rig, c, free=False):
        t = c['t']; fs = min(500., 1/np.median(np.diff(t))); s.press = 'depth' in c
        if s.press: fs = min(fs, 500.)
        s.t = np.arange(t[0], t[-1], 1/fs); s.h = h = 1/fs; I = lambda k: np.interp(s.t, t, c[k])
        if len(t) > 1.5*len(s.t):                     # average down
            e = np.clip(np.round((t-t[0])*fs).astype(int), 0, len(s.t)-1); cnt = np.bincount(e, minlength=len(s.t))
            def I(k):
                v = np.bincount(e, c[k], minlength=len(s.t)); ok = cnt > 0; return np.interp(s.t, s.t[ok], v[ok]/cnt[ok])
        if s.press:
            s.d = I('depth'); s.x = I('slip1') if 'slip1' in c else 0*s.t; s.y = 0*s.t; s.Y = np.column_stack([I('normal_force')]+([I('tangential_force1')] if 'slip1' in c else [])); s.w = np.ones(s.Y.shape[1])
            s.dd = savgol_filter(s.d, max(5, odd(.03*fs)), 2, deriv=1, delta=h)
        else:
            n = sum(k[0] == 'q' and k[1:].isdigit() for k in c); Q = np.column_stack([I(f'q{i+1}') for i in range(n)]); arm = sim.ARMS['lwr' if n == 7 else 'gen6']
            win = max(5, odd(.024*fs)); Q = savgol_filter(Q, win, 2, axis=0)
            s.R, s.ps, s.p = sim.fk_np(arm, Q); s.tip = np.array([0, 0, arm['tip']]); s.m = rig['tool']['mass']; s.com = np.array(rig['tool']['com'])
            pc = s.ps+s.R@s.com; s.a = savgol_filter(pc, max(7, odd(.06*fs)), 3, deriv=2, delta=h, axis=0); s.Y = np.column_stack([I(k) for k in ('fx', 'fy', 'fz', 'tx', 'ty', 'tz')]); s.w = np.array([1, 1, 1, 10, 10, 10.])
            if 'surface' in rig: s.P = np.array(rig['surface']['point']); s.n = np.array(rig['surface']['normal']); s.t1 = np.array(rig['surface']['tangent']); s.t2 = np.cross(s.n, s.t1)
            s.surface = 'surface' in rig
            if s.surface: s.geo(s.p)
        s.g = np.array([0, 0, -9.81])
        if s.press or s.surface: s.in_c = s.d > 0; s.lo, s.hi = s.x[s.in_c].min(), s.x[s.in_c].max()
        else: s.in_c = np.ones(len(s.t), bool)
    def geo(s, p):
        r = p-s.P; s.d = -(r@s.n); s.x = r@s.t1; s.y = r@s.t2; s.dd = savgol_filter(s.d, 11, 2, deriv=1, delta=s.h)
    def predict(s, q):
        g = q.get; d, dd, x, y, h, t = (s.d, s.dd, s.x, s.y, s.h, s.t) if (s.press or s.surface) else (None,)*4+(s.h, s.t)
        tip = None if s.press else s.tip+np.array([g('o0', 0), g('o1', 0), g('o2', 0)]); N = T1 = T2 = None
        if s.press or s.surface:
            if 'o0' in q:
                r = s.p+s.R@(tip-s.tip)-s.P; d = -(r@s.n); x = r@s.t1; y = r@s.t2; dd = np.gradient(d, h)
            d = d+g('z0', 0)
            if 'C' in q and q['C'] > 0:                     # e + C k e^n = d, by Newton; only the elastic force bends the arm
                n_ = g('n', 1.5 if 'hz' in q else 1.); d0 = np.maximum(d, 0); e = d0.copy()
                for _ in range(12): e = np.clip(e-(e+q['C']*q['k']*e**n_-d0)/(1+q['C']*q['k']*n_*np.maximum(e, 1e-9)**(n_-1)), 0, d0)
                d = np.where(d > 0, e, d); dd = savgol_filter(d, 11, 2, deriv=1, delta=h)
            e = np.maximum(d, 0); n = g('n', 1.5 if 'hz' in q else 1.)
            F = g('k', 0)*e**n
            if 'K2' in q: F = F+q['K2']*np.maximum(e-q['db'], 0)
            if 'al' in q: F = F*(1+q['al']*t/60)
            if 'g0' in q: F = F*(1+np.interp(x, np.linspace(s.lo, s.hi, 14), [q[f'g{i}'] for i in range(14)]))
            r = []; ta = []
            for i in '012':
                if 'r'+i in q: r.append(q['r'+i]); ta.append(q['tau'+i])
            N = memory(F, d, dd, h, np.array(r), np.array(ta), g('bwA', 0.), g('bwL', 1e-3), g('mr', 0.), g('ml', 1e-3), g('Fa', 0.), g('La', 1e-3), g('c', 0.), True)
            N = N+np.where(d > 0, g('c', 0)*dd+g('lam', 0)*F*dd, 0)
            Nf = np.maximum(N+g('Fa', 0)*(d > 0), 0)*(d > 0)
            vx, vy = np.gradient(x, h), np.gradient(y, h)
            if s.h < .01: k = 9; vx, vy = savgol_filter(vx, k, 2), savgol_filter(vy, k, 2)
            v = np.hypot(vx, vy); mu = g('mu', 0)*(np.maximum(Nf, 1e-3)/5)**g('p', 0)+(g('dmu', 0)*np.exp(-(v/q['vs'])**2) if 'dmu' in q else 0)
            if 'vr' in q: z = np.column_stack([vx, vy])/np.sqrt(v*v+q['vr']**2)[:, None]
            else: z = bristle(x, y, g('bl', 1e-4), d > 0)
            T1 = -mu*(1+g('an', 0))*Nf*z[:, 0]-g('vt', 0)*vx*(d > 0); T2 = -mu*(1-g('an', 0))*Nf*z[:, 1]-g('vt', 0)*vy*(d > 0)
        if s.press: Y = np.column_stack([N, T1])[:, :s.Y.shape[1]]
        else:
            m = s.m+g('dm', 0); com = s.com+np.array([g('c0', 0), g('c1', 0), g('c2', 0)]); Rt = s.R.transpose(0, 2, 1)
            ft = (Rt@(m*(s.g-(1+g('ti', 0))*s.a))[:, :, None])[:, :, 0]; fc = 0*ft if N is None else (Rt@(N[:, None]*s.n+T1[:, None]*s.t1+T2[:, None]*s.t2)[:, :, None])[:, :, 0]
            Y = np.hstack([ft+fc, np.cross(com, ft)+np.cross(tip, fc)])
            if 'm0' in q: w = -np.array([q['m0'], q['m1'], q['m2']]); Y = Y+np.hstack([np.cross(w, Y[:, :3]), np.cross(w, Y[:, 3:])])
            if 'x0' in q:
                X = np.eye(3); X[0, 1], X[0, 2], X[1, 0], X[1, 2], X[2, 0], X[2, 1] = [q[f'x{i}'] for i in range(6)]; Y = np.hstack([Y[:, :3]@X.T, Y[:, 3:]])
        Y = Y*(1+g('gn', 0))
        if 'lag' in q and q['lag'] > 1e-5: a = np.exp(-h/q['lag']); Y = lfilter([1-a], [1, -a], Y, axis=0, zi=a*Y[:1])[0]
        if 'to' in q: Y = np.column_stack([np.interp(t-q['to'], t, Y[:, i]) for i in range(Y.shape[1])])
        for i in range(Y.shape[1]): Y[:, i] += g(f'b{i}', 0)+g(f'd{i}', 0)*t/60
        if 'h0' in q:
            for f, o in ((50, 0), (60, 6), (150, 12), (180, 18)):
                for i in range(min(3, Y.shape[1])): Y[:, i] += q[f'h{o+2*i}']*np.sin(2*np.pi*f*t)+q[f'h{o+2*i+1}']*np.cos(2*np.pi*f*t)
        if 'sat' in q: i = 0 if s.press else 2; Y[:, i] = np.clip(Y[:, i], -q['sat'], q['sat'])
        return Y
    def fit(s, model, starts=None, tries=2):
        names = {}
        for e in model:
            for nm, x0, sc in E[e]: names.setdefault(nm, (x0, sc))
        if 'hertz-exponent' in model or 'hertz' in model: names['k'] = (1.5e4 if 'hertz' in model else 8000, 1e4)
        keys = list(names); fixed = {'hz': 1} if 'hertz' in model else {}
        if starts: 
            for k_, v in starts.items():
                if k_ in names: names[k_] = (v, names[k_][1])
        if 'k' in names and not starts:                # scale of the base from the largest load
            pk = np.abs(s.Y[:, :3]).max(); e = s.d.max(); names['k'] = (pk/e**(1.5 if 'hertz' in model else 1.2 if 'hertz-exponent' in model else 1), names['k'][1])
        if not keys: r = (s.Y-s.predict({}))*s.w; return {}, r
        best = None; dec = max(1, len(s.t)//6000); rng = np.random.default_rng(1)
        for tr in range(tries):
            x0 = np.array([names[k][0] for k in keys]); sc = np.array([max(abs(names[k][0])*.3 if k == 'k' else 0, names[k][1]) for k in keys])
            if tr: x0 = x0+rng.normal(size=x0.size)*sc*.5
            lo = np.array([BND.get(k, (-np.inf, np.inf))[0] for k in keys]); hi = np.array([BND.get(k, (-np.inf, np.inf))[1] for k in keys]); x0 = np.clip(x0, lo+1e-9, hi-1e-9)
            f = lambda x: ((s.Y-s.predict({**fixed, **dict(zip(keys, x))}))*s.w)[::dec].ravel()
            try: o = least_squares(f, x0, bounds=(lo, hi), x_scale=sc, max_nfev=40, diff_step=1e-5)
            except ValueError: continue
            if best is None or o.cost < best.cost: best = o
        q = {**fixed, **dict(zip(keys, best.x))}; return q, (s.Y-s.predict(q))*s.w
def rms(r): return float(np.sqrt(np.mean(np.sum(r**2, 1))))
class Joints:
    """per-joint linear least squares, torque and motion passed through the same smoother"""
    b = 1.5e-3
    def __init__(s, rig, c, enc):
        t = c['t']; n = sum(k[0] == 'q' and k[1:].isdigit() for k in c); s.n = n; s.static = np.median(np.diff(t)) > 1; drive = 'robot' not in rig
        if s.static: s.q = np.column_stack([c[f'q{i+1}'] for i in range(n)]); s.v = s.q*0; s.a = s.q*0; s.Y = np.column_stack([c[f'tau{i+1}'] for i in range(n)])
        else:
            fs = 1/np.median(np.diff(t)); fs = min(fs, 250.); T = np.arange(t[0], t[-1], 1/fs); W = max(7, odd((.12 if enc < 5e-5 else .2 if enc < 5e-4 else .5)*fs))
            S = lambda x, d: savgol_filter(x, W, 3, deriv=d, delta=1/fs, axis=0)
            Q = np.column_stack([np.interp(T, t, c[f'q{i+1}']) for i in range(n)]); s.q, s.v, s.a = S(Q, 0), S(Q, 1), S(Q, 2); s.Y = S(np.column_stack([np.interp(T, t, c[f'tau{i+1}']) for i in range(n)]), 0); s.t = T; s.fs = fs; s.Qr = Q; s.S = S; s.vl = savgol_filter(Q, max(5, odd(.05*fs)), 2, deriv=1, delta=1/fs, axis=0); s.fc = 0
        s.rb = np.zeros_like(s.Y); s.pl = None; s.drive = drive
        if not drive:
            arm = sim.ARMS['lwr' if n == 7 else 'gen6']; g = np.array(rig['robot'].get('gravity', [0, 0, -9.81])); s.rb = s.inv(arm, g, 0, np.zeros(3))
            s.pl = [s.inv(arm, g, 1., o)-s.rb for o in (np.zeros(3), np.array([.1, 0, 0]), np.array([0, .1, 0]), np.array([0, 0, .1]))]
    def inv(s, arm, g, m, com):
        import generate as G
        M_, c, I = G.attach(arm, m, com); n = s.n; R = np.zeros((n, 3, 3)); p = np.zeros((n, 3)); a = np.zeros((n, 3)); M = np.zeros((n, n)); h = np.zeros(n); out = np.empty_like(s.q)
        for k in range(len(s.q)): sim.dyn(s.q[k], s.v[k], arm['P'], arm['A'], M_, c, I, g, R, p, a, M, h); out[k] = M@s.a[k]+h
        return out
    def fit(s, model, tries=None, starts=None):
        if not getattr(s, 'tuned', 0) and not s.static:        # shape of the friction at reversal: bristle or rounded, whichever leaves less
            s.tuned = 1; o = []
            for b in (5e-4, 1e-3, 2e-3, 3e-3, -.002, -.005):
                for fc in (0, 20, 50): s.b = b; s.fc = fc; o.append((rms(s.fit(s.best_model)[1]), b, fc))
            s.b, s.fc = min(o)[1:]; s.lagless = min(x[0] for x in o if x[2] == 0)
        best = None; n = s.n; Yr = s.Y-s.rb; y0 = np.zeros_like(Yr)
        for vs in ([.01, .02, .04, .06, .1, .2] if 'joint-stribeck-friction' in model else [1]):
            res = np.zeros_like(Yr); co = []
            if 'payload' in model:
                A = np.vstack([np.column_stack([s.cols(i, model, vs, n, j) for j in range(n)]) if False else s.block(i, model, vs) for i in range(n)])
                x = np.linalg.lstsq(A, Yr.T.ravel(), rcond=None)[0]; res = (Yr.T.ravel()-A@x).reshape(n, -1).T; co = x[-4:]
            else:
                for i in range(n):
                    A = s.feat(i, model, vs)
                    if A.shape[1] == 0: res[:, i] = Yr[:, i]; co.append([]); continue
                    x = np.linalg.lstsq(A, Yr[:, i], rcond=None)[0]; res[:, i] = Yr[:, i]-A@x; co.append(x.round(3).tolist())
            if best is None or rms(res) < rms(best[1]): best = (dict(vs=vs, co=co), res)
        if 'joint-torque-ripple' in model and best[0].get('k') is None:
            for k in range(1, 25):
                A = np.column_stack([s.feat(0, [m for m in model if 'ripple' not in m], 1), np.sin(k*s.q[:, 0]), np.cos(k*s.q[:, 0]), np.sin(2*k*s.q[:, 0]), np.cos(2*k*s.q[:, 0])]); x = np.linalg.lstsq(A, Yr[:, 0], rcond=None)[0]; r = (Yr[:, 0]-A@x)[:, None]
                if rms(r) < rms(best[1]): best = (dict(k=k, co=x), r)
        return best
    def sgn(s, i):
        if s.static: return np.zeros(len(s.q))
        if s.b < 0: x = np.tanh(s.vl[:, i]/-s.b)
        else: x = bristle(s.Qr[:, i].copy(), 0*s.q[:, i], s.b, np.ones(len(s.q), bool))[:, 0]
        if s.fc: a = np.exp(-2*np.pi*s.fc/s.fs); x = lfilter([1-a], [1, -a], x)
        return s.S(x, 0)
    def feat(s, i, model, vs):
        A = []; v = s.v[:, i]; sg = s.sgn(i); load = np.abs(s.rb[:, i])
        for e in model:
            if e == 'joint-coulomb-friction': A.append(sg)
            if e == 'joint-viscous-friction': A.append(v)
            if e == 'rotor-inertia' or (e == 'rigid-body' and s.drive): A.append(s.a[:, i])
            if e == 'joint-torque-offset': A.append(0*v+1)
            if e == 'joint-load-friction': A.append(load*sg)
            if e == 'joint-stribeck-friction': A.append(sg*np.exp(-(v/vs)**2))
            if e == 'joint-spring': A += [s.q[:, i], 0*v+1]
            if e == 'joint-friction-asymmetry': A.append(np.abs(sg))
            if e == 'joint-torque-gain': A.append(s.rb[:, i])
            if e == 'quadratic': A.append(v*np.abs(v))
        return np.column_stack(A) if A else np.zeros((len(v), 0))
    def block(s, i, model, vs):
        F = [s.feat(j, model, vs) for j in range(s.n)]; A = np.zeros((len(s.q), sum(f.shape[1] for f in F)+4)); o = sum(f.shape[1] for f in F[:i]); A[:, o:o+F[i].shape[1]] = F[i]
        A[:, -4] = s.pl[0][:, i]
        for k in range(3): A[:, -3+k] = s.pl[k+1][:, i]-s.pl[0][:, i]
        return A
ALT_C = ['hertz-exponent', 'viscous-damping', 'hunt-crossley-damping', 'relaxation', 'hysteresis', 'stress-softening', 'adhesion', 'stiffening-layer', 'surface-offset', 'stiffness-drift', 'stiffness-inhomogeneity', 'structural-compliance', 'tip-offset',
         'tool-mass', 'tool-com', 'sensor-bias', 'sensor-drift', 'sensor-crosstalk', 'sensor-misalignment', 'sensor-gain', 'sensor-lag', 'time-offset', 'saturation', 'mains-hum']
ALT_T = ['viscous-friction', 'stribeck-friction', 'presliding', 'load-dependent-friction', 'friction-anisotropy', 'friction-rounding']
ALT_P = ['hertz-exponent', 'hunt-crossley-damping', 'relaxation', 'hysteresis', 'stress-softening', 'adhesion', 'stiffening-layer', 'surface-offset', 'stiffness-drift', 'structural-compliance', 'time-offset', 'saturation']
ALT_J = ['joint-viscous-friction', 'rotor-inertia', 'joint-torque-offset', 'joint-load-friction', 'joint-stribeck-friction', 'joint-spring', 'joint-friction-asymmetry', 'joint-torque-gain', 'payload']
def main():
    ap = argparse.ArgumentParser(); ap.add_argument('data'); ap.add_argument('--alt', action='store_true'); ap.add_argument('--only', nargs='*'); a = ap.parse_args()
    truth = json.load(open(f'{a.data}/truth.json')); bad = []
    print('row     group       kind    hidden                                   T[s]    fs   n     reading  start    true   tol2%  effect | notes')
    for r in truth:
        if a.only and r['case'] not in a.only: continue
        rig, c = load(f"{a.data}/{r['case']}"); t = c['t']; note = []; N = r['nuisances']; kind = r['kind']
        for k, v in c.items():
            if k != 'phase' and not np.isfinite(v).all(): note.append(f'NOT FINITE {k}')
        if not (np.diff(t) > 0).all(): note.append('TIME NOT INCREASING')
        for k in c:
            if k[0] == 'q' and k[1:].isdigit() and 'robot' in rig:
                lim = sim.ARMS['lwr' if 'q7' in c else 'gen6']['lim'][int(k[1:])-1]
                if np.abs(c[k]).max() > lim: note.append(f'{k} beyond limit')
        if kind in ('joints', 'drive') or (kind == 'static' and 'tau1' in c): S = Joints(rig, c, N['enc']); Y = S.Y; msk = slice(None); alts = ALT_J if kind != 'drive' else ['joint-torque-ripple', 'joint-stribeck-friction', 'joint-torque-offset', 'joint-spring', 'joint-friction-asymmetry', 'quadratic']
        else:
            S = Contact(rig, c) if kind != 'static' else None
            if kind == 'static': # static wrench
                n = 7; Q = np.column_stack([c[f'q{i+1}'] for i in range(n)]); S = object.__new__(Contact); S.press = S.surface = False; S.t = t; S.h = 1.; S.R, S.ps, S.p = sim.fk_np(sim.ARMS['lwr'], Q); S.m = rig['tool']['mass']; S.com = np.array(rig['tool']['com']); S.a = np.zeros((len(t), 3)); S.tip = np.zeros(3)
                S.Y = np.column_stack([c[k] for k in ('fx', 'fy', 'fz', 'tx', 'ty', 'tz')]); S.w = np.array([1, 1, 1, 10, 10, 10.]); S.g = np.array([0, 0, -9.81]); S.in_c = np.ones(len(t), bool)
            Y = S.Y*S.w; msk = S.in_c; alts = ALT_P if kind == 'press' else ALT_C+(ALT_T if 'coulomb-friction' in r['model'] else [])
            if kind == 'free': alts = ['tool-mass', 'tool-com', 'tool-inertia', 'sensor-bias', 'sensor-drift', 'sensor-lag', 'time-offset', 'sensor-misalignment']
            if kind in ('contact', 'press'): note.append(f'contact {msk.mean()*100:.0f} % depth max {S.d.max()*1e3:.2f} mm F max {np.abs(S.Y[:, :3]).max():.1f} N')
            if kind == 'contact' and (msk.mean() < .1 or msk.mean() > .98): note.append('CONTACT SHARE')
        S.best_model = r['true_model']
        sub = (lambda x: x[:, :3] if (x.shape[1] == 6) else x)
        read = rms(sub(Y)[msk]); q0, r0 = S.fit(r['model']); q1, r1 = S.fit(r['true_model'], tries=4) if r['hidden'] else (q0, r0)
        s0, s1 = rms(sub(r0)[msk]), rms(sub(r1)[msk]); eff = np.sqrt(max(s0**2-s1**2, 0))/s1
        if hasattr(S, 'lagless'): note.append(f'friction at reversal: b={S.b} lp={S.fc} (no low-pass in the fit: {S.lagless:.3f})')
        if r['hidden'] and eff < 2: note.append('WEAK')
        if r['hidden'] and s0 < .03*read: note.append('BELOW 3 % OF READINGS')
        if r['group'] != 'outside' and s1 > .02*read: note.append(f'LEFT {s1/read*100:.1f} %')
        if r['group'] == 'outside' and s1 < .03*read: note.append('OUTSIDE EFFECT SMALL')
        pv = {k: (round(float(v), 5) if np.isscalar(v) else v) for k, v in q1.items() if k not in ('hz', 'co')}
        print(f"{r['case']}{'#'+str(r['row']):>4s} {r['group']:11s}{kind:8s}{'+'.join(r['hidden']) or '-':40s}{t[-1]:6.0f}{1/np.median(np.diff(t)):7.0f}{len(t):7d} {read:8.3f}{s0:8.3f}{s1:8.3f}{.02*read:8.3f}{eff:7.1f} | {'; '.join(note)} {pv}", flush=True)
        if r['group'] == 'pair':
            for e in r['hidden']:
                se = rms(sub(S.fit(r['model']+[e], tries=3)[1])[msk]); print(f'        only {e}: {se:.3f} = {se/s1:.1f} x', 'WEAK PARTNER' if se < 1.6*s1 else '')
        if a.alt and r['group'] in ('single', 'none', 'outside', 'not-excited'):
            L = []
            for e in alts:
                if e in r['true_model']: continue
                try: L.append((rms(sub(S.fit(r['model']+[e], tries=1)[1])[msk]), e))
                except Exception as ex: L.append((9e9, e+' '+str(ex)[:30]))
            L.sort(); print('        rivals:', ', '.join(f'{e} {v:.3f}' for v, e in L[:5]), flush=True)
if __name__ == '__main__': main()
