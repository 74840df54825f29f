#!/usr/bin/env python3
"""generate.py --seed N --out OUT : 48 logs of a world (see README.md)"""
import argparse, json, os, sys, time, csv
os.environ.setdefault('OMP_NUM_THREADS', '1'); os.environ.setdefault('OPENBLAS_NUM_THREADS', '1')
import numpy as np
from scipy.signal import lfilter
from scipy.interpolate import CubicSpline
import sim
from sim import pars, ARMS

G = np.array([0, 0, -9.81]); H = 2.5e-4
NOISE = np.array([.015, .014, .029, .0005, .0006, .0003])

# ------------------------------------------------------------------ paths
def mj(u): return u*u*u*(10-15*u+6*u*u)
class Path:
    def __init__(s, z=-.004): s.p = [np.array([0, 0, z, 0, 0.])]; s.T = []; s.ph = []
    def go(s, T, ph, s1=None, s2=None, d=None, rx=None, ry=None):
        x = s.p[-1].copy()
        for i, v in enumerate((s1, s2, d, rx, ry)):
            if v is not None: x[i] = v
        s.p.append(x); s.T.append(max(T, .02)); s.ph.append(ph); return s
    def at(s, t):
        e = np.r_[0, np.cumsum(s.T)]; k = np.clip(np.searchsorted(e, t, 'right')-1, 0, len(s.T)-1)
        u = mj(np.clip((t-e[k])/np.array(s.T)[k], 0, 1)); p = np.array(s.p)
        return p[k]+(p[k+1]-p[k])*u[:, None], np.array(s.ph)[k]
    @property
    def dur(s): return sum(s.T)
def pokes(P, rng, depths, speeds, hold, rest=.25, places=None, tilts=None):
    """mean speed = distance / time of the minimum-jerk stroke; hover 2.5 mm above"""
    P.go(.4, 'free')
    for i, d in enumerate(depths):
        v = speeds[i % len(speeds)]
        if places is not None: P.go(.7, 'free', *places[i % len(places)])
        if tilts is not None: P.go(.8, 'free', rx=tilts[i % len(tilts)][0], ry=tilts[i % len(tilts)][1])
        P.go((d+.004)/v, 'poke', d=d); P.go(hold[i % len(hold)] if hold else .02, 'hold'); P.go((d+.004)/v, 'retract', d=-.004); P.go(rest, 'rest')
    return P
def slides(P, rng, depths, speeds, L=.02, dirs=((1, 0),), rev=1):
    P.go(.5, 'free')
    for d in depths:
        P.go(.8, 'approach', d=d)
        for v in speeds:
            for c, s in dirs:
                for _ in range(rev):
                    l = min(L, max(v*1.5, .003))
                    P.go(l/v, 'slide', c*l, s*l); P.go(.15, 'hold'); P.go(l/v, 'slide', 0, 0); P.go(.15, 'hold')
        P.go(.6, 'retract', d=-.004)
    P.go(.3, 'rest'); return P

# ------------------------------------------------------------------ arms
def attach(arm, m, com):
    """tool as a point mass (sensor frame) welded to the last link"""
    M, c, I = arm['m'].copy(), arm['c'].copy(), arm['I'].copy()
    if m:
        x = arm['pf']+arm['Rf']@(arm['ps']+com); t = M[-1]+m; cn = (M[-1]*c[-1]+m*x)/t
        def pa(mm, d): return mm*(d@d*np.eye(3)-np.outer(d, d))
        i = I[-1]; T = np.array([[i[0], i[3], i[4]], [i[3], i[1], i[5]], [i[4], i[5], i[2]]])+pa(M[-1], c[-1]-cn)+pa(m, x-cn)
        M[-1] = t; c[-1] = cn; I[-1] = [T[0, 0], T[1, 1], T[2, 2], T[0, 1], T[0, 2], T[1, 2]]
    return M, c, I
def jpar(n, **kw):
    J = np.zeros((n, 15)); J[:, 3] = .05; J[:, 6] = 1e-3
    for k, v in kw.items(): J[:, dict(Fc=0, Fv=1, dF=2, vs=3, asym=4, load=5, bl=6, K=7, q0=8, rip=9, k=10, ph=11, drag=12, rnd=13, rip2=14)[k]] = v
    return J
def tilt(rng, deg): 
    a = rng.normal(size=3); a[2] = 0; a /= np.linalg.norm(a); return sim.rot(a, np.radians(deg))
def run_contact(rng, armname, CP, path, kp=8000., tool=(.24, np.array([0, 0, .049])), tip_true=None, on=True, qtab=None, T=None, stilt=0., base=.2, dec=1, J=None, side=None, h=H):
    arm = ARMS[armname]; n = len(arm['m']); td = .01
    g = tilt(rng, base)@G
    M, c, I = attach(arm, *tool)
    tipr = np.array([0, 0, arm['tip']]) if tip_true is None else tip_true
    R0, _, p0 = sim.fk_np(arm, arm['q0'][None]); nrm = tilt(rng, stilt)@np.array([0, 0, 1.])
    x = R0[0][:, 0]; t1 = x-nrm*(x@nrm); t1 /= np.linalg.norm(t1)
    if armname == 'gen6': t1 = np.array([1., 0, 0]); t1 -= nrm*(t1@nrm); t1 /= np.linalg.norm(t1)
    t2 = np.cross(nrm, t1); Rs = np.array([t1, t2, nrm])
    surf = p0[0]+np.array([0, 0, -.01])
    if qtab is None:
        T = path.dur+.2; tt = np.arange(0, T+3*td, td); w, ph = path.at(tt)
        pts = surf+w[:, :1]*t1+w[:, 1:2]*t2-w[:, 2:3]*nrm
        # tool z along -normal; keep the x axis near the posture's
        zt = -nrm; xt = R0[0][:, 0]-zt*(R0[0][:, 0]@zt); xt /= np.linalg.norm(xt); Rb = np.column_stack([xt, np.cross(zt, xt), zt])
        Rd = np.array([sim.rot(t1, a)@sim.rot(t2, b)@Rb for a, b in w[:, 3:5]])
        qtab = sim.ik(arm, pts, Rd, arm['q0'])
    B, K = arm['B'], arm['K']; Kp = kp*np.array([1, 1, 1, .8, .4, .25, .2] if n == 7 else [1, 1, 1, .3, .3, .2]); Kd = 2*.8*np.sqrt(Kp*(B+.3))
    if J is None: J = jpar(n, Fc=rng.uniform(.1, .5, n)*(1 if n == 7 else 3), Fv=.5, bl=2e-3)
    rec = sim.simulate(np.ascontiguousarray(qtab), td, T, h, dec, arm['P'], arm['A'], M, c, I, K, B, Kp, Kd, g, arm['side'] if side is None else side, J,
                       arm['Rf'], arm['pf'], arm['ps'], tipr, tool[1], surf, Rs, CP, 1 if on else 0, 0.)
    t = np.arange(len(rec))*h*dec
    d = dict(arm=arm, t=t, q=rec[:, :n], th=rec[:, n:2*n], dq=rec[:, 2*n:3*n], dth=rec[:, 3*n:4*n], tau=rec[:, 4*n:5*n], fc=rec[:, 5*n:5*n+3], vc=rec[:, 5*n+3:5*n+6],
             con=rec[:, 5*n+6:5*n+9], g=g, tool=tool, tipr=tipr, surf=surf, Rs=Rs, kp=kp)
    if path is not None: d['phase'] = path.at(t)[1]
    return d
def wrench(s, extra=None):
    """load on the tool in the sensor frame (contracts §2)"""
    R, _, _ = sim.fk_np(s['arm'], s['q']); a = np.gradient(s['vc'], s['t'][1], axis=0)
    m, com = s['tool']; ft = m*(s['g']-a)
    if extra is not None: ft = ft+extra(s, R, a)
    Rt = R.transpose(0, 2, 1); ft = (Rt@ft[:, :, None])[:, :, 0]; fc = (Rt@s['fc'][:, :, None])[:, :, 0]
    return np.hstack([ft+fc, np.cross(com, ft)+np.cross(s['tipr'], fc)])

# ------------------------------------------------------------------ readings
def lp(x, tau, dt):
    if tau <= 0: return x
    a = np.exp(-dt/tau); y, _ = lfilter([1-a], [1, -a], x, axis=0, zi=a*x[:1]) if x.ndim > 1 else lfilter([1-a], [1, -a], x, zi=a*x[:1]); return y
def grid(rng, T, fs, jit, drop):
    t = np.arange(0, T-2/fs, 1/fs); t = t+rng.normal(size=t.size)*jit/fs; t = np.maximum.accumulate(np.clip(t, 0, None))
    t = t[rng.random(t.size) >= drop]; return t[np.r_[True, np.diff(t) > .2/fs]]
def at(t, ts, x): return np.column_stack([np.interp(t, ts, x[:, i]) for i in range(x.shape[1])])
def quant(x, s): return np.round(x/s)*s if np.any(s) else x
def fmt(a, dig): return [f'%.{dig}g' % v for v in a]
def save(folder, cols, parquet):
    os.makedirs(folder, exist_ok=True)
    if parquet:
        import pyarrow as pa, pyarrow.parquet as pq
        pq.write_table(pa.table({k: pa.array(v) for k, v in cols.items()}), f'{folder}/log.parquet')
    else:
        dig = {k: ('%.5f' if k == 't' else '%.7f' if k[0] == 'q' else '%.9f' if k in ('depth', 'slip1', 'slip2') else '%.5f') for k in cols}
        arr = [v if k == 'phase' else np.char.mod(dig[k], v) for k, v in cols.items()]
        with open(f'{folder}/log.csv', 'w') as f:
            f.write(','.join(cols)+'\n'); f.write('\n'.join(','.join(r) for r in zip(*arr))+'\n')
def tl(v): return '['+', '.join(f'{float(x):.9g}' for x in v)+']'

def nuis(rng, kind):
    """nuisances drawn for one row"""
    n = dict(fs=float(rng.choice([250, 500, 1000, 1000, 2000])), dq=bool(rng.random() < .5), dq_tau=float(rng.choice([2e-3, 5e-3, 1e-2])), dq_noise=float(rng.choice([1e-4, 1e-3, 3e-3])),
             dq_bias=float(rng.normal()*2e-4), enc=float(rng.choice([2e-6, 1e-5, 3e-5])), jit=float(rng.choice([0, .02, .05, .1])), drop=float(rng.choice([0, .002, .01])),
             clock=float(rng.normal()*5e-4), noise=float(rng.uniform(.7, 1.5)), bias=float(rng.choice([0, 1])), drift=float(rng.choice([0, .02])), nonlin=0., parquet=bool(rng.random() < .4),
             phase=bool(rng.random() < .5), tool_off=float(rng.uniform(-.02, .02)), ws_tau=float(rng.choice([0, 0, 1e-3])), base_deg=float(rng.choice([0, .1, .3])), kp=float(rng.choice([2500, 4000, 6000, 9000, 14000])))
    if kind in ('joints', 'drive'): n.update(enc=float(rng.choice([1e-5, 1e-4, 3e-4])), fs=float(rng.choice([100, 250, 500])), tau_fc=float(rng.choice([20, 35, 50])), tau_rate=float(rng.choice([100, 250, 1000])), parquet=bool(rng.random() < .3))
    return n
def write_contact(folder, rng, s, N, wr, motor=False, tool_rig=None, sens=None, surface=True, clock=None, lag=0., hum=None, clip=None, dq=True):
    arm = s['arm']; n = len(arm['m']); ts = s['t']; dt = ts[1]
    Q = s['th'] if motor else s['q']; V = s['dth'] if motor else s['dq']
    t = grid(rng, ts[-1], N['fs'], N['jit'], N['drop'])
    w = wr.copy()
    if N['nonlin']: w[:, :3] += N['nonlin']*w[:, :3]*np.abs(w[:, :3])/20        # 1 % of 20 N, quadratic
    if sens is not None: w = sens(ts, w)
    w = lp(w, N['ws_tau'], dt); w = lp(w, lag, dt)
    off = N['clock'] if clock is None else clock
    w = at(t-off, ts, w)                                        # wrench stamped `off` late
    w = w+N['bias']*N['b6']+N['drift']*np.array([1, -1, 2, .01, .01, 0])[None]*t[:, None]/60/2
    if hum is not None: w = w+hum(t)
    w = w+rng.normal(size=w.shape)*NOISE*N['noise']
    if clip is not None: w = clip(w)
    w = quant(w, np.array([.01, .01, .02, 2.5e-4, 2.5e-4, 2.5e-4]))
    q = quant(at(t, ts, Q), N['enc'])
    cols = {'t': t}; cols.update({f'q{i+1}': q[:, i] for i in range(n)})
    if N['dq']:
        v = at(t, ts, lp(V, N['dq_tau'], dt)); v = v+rng.normal(size=v.shape)*N['dq_noise']*.1+N['dq_bias']*.3
        cols.update({f'dq{i+1}': v[:, i] for i in range(n)})
    cols.update({k: w[:, i] for i, k in enumerate(('fx', 'fy', 'fz', 'tx', 'ty', 'tz'))})
    if N['phase'] and 'phase' in s: cols['phase'] = s['phase'][np.clip((t/dt).astype(int), 0, len(ts)-1)]
    save(folder, cols, N['parquet'])
    sim.urdf(arm, f'{folder}/arm.urdf')
    m, com = s['tool']; mr = m*(1+N['tool_off']); cr = com
    if tool_rig is not None: mr, cr = tool_rig
    surf = s['surf']
    if surface and motor:                                       # the surface was found by touching with these encoders
        _, _, p = sim.fk_np(arm, Q); dep = -(s['q']*0)[:, 0]; pl = sim.fk_np(arm, s['q'])[2]; 
        k = np.abs((pl-surf)@s['Rs'][2]) < 3e-4; k &= s['con'][:, 0] < .3
        if k.sum(): surf = surf+s['Rs'][2]*np.mean(((p-pl)@s['Rs'][2])[k])
    toml = ['[robot]', 'model = "arm.urdf"', 'sensor_frame = "ft_sensor"', 'tip_frame = "tool_tip"', f'joints = {json.dumps([f"joint_{i+1}" for i in range(n)])}', '',
            '[tool]', f'mass = {mr:.5f}', f'com = {tl(cr)}', '']
    if surface: toml += ['[surface]', f'point = {tl(surf+s["Rs"][2]*N["touch"])}', f'normal = {tl(s["Rs"][2])}', f'tangent = {tl(s["Rs"][0])}', '']
    toml += ['[sensor]', 'range = [40, 40, 120, 2, 2, 2]', f'noise = {tl(NOISE*N["noise"])}', '']
    open(f'{folder}/rig.toml', 'w').write('\n'.join(toml))

def fourier(rng, n, q0, amp, f0, T, nh=3, td=.01):
    """sum of sines, started and stopped smoothly"""
    t = np.arange(0, T+3*td, td); Q = np.tile(q0, (len(t), 1)); r = mj(np.clip(t/1.5, 0, 1))*mj(np.clip((T-t)/1.5, 0, 1))
    for i in range(n):
        a = rng.uniform(.4, 1, nh)/np.arange(1, nh+1)**.7; a *= amp[i]/a.sum(); ph = rng.uniform(0, 2*np.pi, nh)
        Q[:, i] += r*sum(a[k]*np.sin(2*np.pi*f0*(k+1)*(1+.03*i)*t+ph[k]) for k in range(nh))
    return Q
def write_joints(folder, rng, s, N, motor, tau=None, payload=None, offset=0.):
    arm = s['arm']; n = len(arm['m']); ts = s['t']; dt = ts[1]
    Q = s['th'] if motor else s['q']; V = s['dth'] if motor else s['dq']
    t = grid(rng, ts[-1], N['fs'], N['jit'], N['drop'])
    tq = lp(s['tau'], 1/(2*np.pi*N['tau_fc']), dt)
    th = np.floor(t*N['tau_rate'])/N['tau_rate'] if N['tau_rate'] < N['fs'] else t
    sig = np.array([.06, .06, .04, .04, .04, .015, .015])[:n]*(1 if n == 7 else 3)
    tq = at(th-N['clock'], ts, tq)+offset
    if N['tau_rate'] < N['fs']:
        u, inv = np.unique(th, return_inverse=True); tq = tq+(rng.normal(size=(len(u), n))*sig)[inv]
    else: tq = tq+rng.normal(size=tq.shape)*sig
    q = quant(at(t, ts, Q), N['enc']); cols = {'t': t}; cols.update({f'q{i+1}': q[:, i] for i in range(n)})
    if N['dq']:
        v = at(t, ts, lp(V, N['dq_tau'], dt)); v = v+rng.normal(size=v.shape)*N['dq_noise']+N['dq_bias']
        cols.update({f'dq{i+1}': v[:, i] for i in range(n)})
    cols.update({f'tau{i+1}': tq[:, i] for i in range(n)}); save(folder, cols, N['parquet']); sim.urdf(arm, f'{folder}/arm.urdf')
    gm = s['g'] if 'g' in s else G
    open(f'{folder}/rig.toml', 'w').write('\n'.join(['# joint torques: ' + ('motor current x ratio, seen on the link side' if motor else 'joint torque sensors, link side') + f'; low-passed at {N["tau_fc"]:.0f} Hz (first order), sampled at {N["tau_rate"]:.0f} Hz and held',
        '# nothing is mounted on the flange', '[robot]', 'model = "arm.urdf"', 'sensor_frame = "ft_sensor"', 'tip_frame = "tool_tip"', f'gravity = {tl(N["g_rig"])}', f'joints = {json.dumps([f"joint_{i+1}" for i in range(n)])}', '']))
def run_joints(rng, armname, N, T, amp, f0, J, payload=(0, np.zeros(3)), qtab=None, nh=3):
    arm = ARMS[armname]; n = len(arm['m']); q0 = arm['q0'].copy()
    if qtab is None: qtab = fourier(rng, n, q0, amp, f0, T, nh)
    s = run_contact(rng, armname, pars(), None, kp=N['kp'], tool=payload, on=False, qtab=qtab, T=T, base=N['base_deg'], dec=4, J=J)
    N['g_rig'] = tilt(rng, .03)@s['g']                          # levelled with a spirit level good to 0.03 deg
    return s
def write_table(folder, cols, parquet, note):
    save(folder, cols, parquet); open(f'{folder}/rig.toml', 'w').write('# '+note+'\n')

# ------------------------------------------------------------------ the rows
def build(rng):
    """list of (group, kind, model, hidden, near, values, unexcited, class, note, maker(folder, rng, N))"""
    rows = []
    def add(group, kind, model, hidden, maker, values=None, near=(), unexcited=(), cls=(), note='', **N):
        rows.append(dict(group=group, kind=kind, model=list(model), hidden=list(hidden), near=list(near), values=values or {}, unexcited=list(unexcited), cls=list(cls), note=note, maker=maker, N=N))
    U = rng.uniform
    KV, HZ, MU = 'kelvin-voigt', 'hertz', 'coulomb-friction'
    def con(arm, CP, path, extra=None, motor=False, wkw=None, rkw=None):
        def f(folder, rng, N):
            s = run_contact(rng, arm, CP, path, kp=N['kp'], base=N['base_deg'], **(rkw or {})); write_contact(folder, rng, s, N, wrench(s, extra), motor=motor, **(wkw or {})); return s
        return f
    places5 = [(0, 0), (.012, 0), (-.012, 0), (0, .012), (0, -.012)]
    # ---- single: normal laws
    n = U(1.45, 1.6); add('single', 'contact', [KV], ['hertz-exponent'], con('gen6', pars(k=U(4, 6)*1.4e4, n=n, c=4), pokes(Path(), rng, [.002, .005, .0035, .006, .004, .006], [.015, .03], [.3])), {'hertz-exponent.n': n}, note='power law', enc=1e-4)
    lam = U(3, 4.5); add('single', 'contact', [HZ], ['hunt-crossley-damping'], con('lwr', pars(k=2.2e4, n=1.5, lam=lam), pokes(Path(), rng, [.003, .007, .005, .008, .008, .004], [.03, .10, .06, .14], [.2])), {'hunt-crossley-damping.lambda': lam}, kp=9000.)
    r1, t1, r2, t2 = U(.35, .5), U(.3, .6), U(.2, .3), U(4, 6)
    add('single', 'contact', [KV], ['relaxation'], con('lwr', pars(k=900, c=3, r1=r1, tau1=t1, r2=r2, tau2=t2), pokes(Path(), rng, [.004, .006, .005], [.02, .04], [5, 6], rest=1.)), {'relaxation.ratio': [r1, r2], 'relaxation.tau': [t1, t2]}, note='two Maxwell branches; ratio = branch stiffness / long-term stiffness; the elastic law is linear', fs=500.)
    A, L = U(.9, 1.3), U(3e-4, 5e-4); add('single', 'contact', [KV], ['hysteresis'], con('gen6', pars(k=1500, c=2, bw_amp=A, bw_len=L), pokes(Path(), rng, [.003, .006, .005, .006], [.006, .03, .012], [.5])), {'hysteresis.amplitude': A, 'hysteresis.length': L}, note='Bouc-Wen (n = 1, beta = gamma = 1/2)', enc=5e-5)
    r, L = U(.35, .45), U(1.5e-3, 2.5e-3); add('single', 'contact', [KV], ['stress-softening'], con('lwr', pars(k=1800, c=3, mul_r=r, mul_len=L), pokes(Path(), rng, [.003, .003, .0045, .0045, .003, .006, .006, .0045], [.015], [.3])), {'stress-softening.ratio': r, 'stress-softening.length': L}, note='Ogden-Roxburgh with tanh in depth', enc=1e-4)
    A, L = U(.9, 1.3), U(4e-4, 7e-4); add('single', 'contact', [KV], ['adhesion'], con('lwr', pars(k=1000, c=2, Fa=A, La=L), pokes(Path(), rng, [.003, .004, .003, .005], [.006, .01], [.3])), {'adhesion.force': A, 'adhesion.length': L}, note='Dugdale-like: constant in contact, linear to zero over the length')
    al = U(.3, .45); add('single', 'contact', [KV], ['stiffness-drift'], con('lwr', pars(k=1300, c=3, alpha=al), pokes(Path(), rng, [.004, .006, .003]*7, [.012, .02], [.8], rest=.5)), {'stiffness-drift.alpha': al}, fs=250.)
    A, w, x0 = U(.4, .6), U(.004, .006), U(.008, .012); add('single', 'contact', [KV, MU], ['stiffness-inhomogeneity'], con('gen6', pars(k=1500, c=3, mu=.4, inh=1, inh_amp=A, x0=x0, y0=0, w=w), slides(Path(), rng, [.003, .004], [.012, .03], L=.025, rev=2)), {'stiffness-inhomogeneity.amplitude': A, 'stiffness-inhomogeneity.x0': x0, 'stiffness-inhomogeneity.width': w}, note='Gaussian inclusion along the slide')
    # ---- single: tangential
    dm, vs = U(.25, .35), U(.008, .012); add('single', 'contact', [KV, MU], ['stribeck-friction'], con('lwr', pars(k=1500, c=3, mu=.35, dmu=dm, vs=vs, s1=.0002), slides(Path(), rng, [.004], [.003, .01, .03, .06], L=.03)), {'stribeck-friction.delta_mu': dm, 'stribeck-friction.vs': vs}, note='LuGre', kp=9000.)
    b = U(1.0e-3, 1.6e-3); add('single', 'contact', [KV, MU], ['presliding'], con('lwr', pars(k=1600, c=3, mu=.5, bl=b), slides(Path(), rng, [.004, .0055], [.003, .006], L=.006, dirs=((1, 0), (0, 1), (.3, .2)), rev=2)), {'presliding.length': b}, note='Dahl', kp=9000.)
    p = -U(.4, .5); add('single', 'contact', [KV, MU], ['load-dependent-friction'], con('gen6', pars(k=1600, c=3, mu=.45, p=p, N0=5), slides(Path(), rng, [.0015, .003, .006], [.01, .03], L=.02)), {'load-dependent-friction.p': p}, note='mu = 0.45 (N/5 N)^p')
    add('single', 'contact', [HZ], ['structural-compliance'], con('lwr', pars(k=2.2e5, n=1.5, c=0), pokes(Path(), rng, [.003, .0055, .007, .0045], [.008, .015], [.3]), motor=True), {'structural-compliance.C': 'see check (about 4e-5 m/N: series of joint springs, configuration-dependent)'}, near=['hertz-exponent'], note='motor-side encoders; elastic joints', kp=14000.)
    # ---- single: sensor
    e = U(.07, .1); X = np.eye(6); X[0, 2] = e; X[1, 2] = -.6*e
    add('single', 'contact', [KV, MU], ['sensor-crosstalk'], con('lwr', pars(k=1500, c=3, mu=.4), slides(Path(), rng, [.003, .006], [.015, .03], dirs=((1, 0), (0, 1))), wkw=dict(sens=lambda t, w: w@X.T)), {'sensor-crosstalk.fx_fz': e, 'sensor-crosstalk.fy_fz': -.6*e})
    lg = U(.02, .03); add('single', 'contact', [KV], ['sensor-lag'], con('gen6', pars(k=1400, c=4), pokes(Path(), rng, [.004, .006, .005, .006, .004, .006, .003, .005], [.06, .12, .2, .15], [.05, .3]), wkw=dict(lag=lg)), {'sensor-lag.tau': lg}, kp=14000., fs=1000.)
    c = U(.55, .65); add('single', 'contact', [KV], ['saturation'], con('lwr', pars(k=2300, c=3), pokes(Path(), rng, [.004, .006, .007, .005, .007], [.02, .04], [.5]), wkw=dict(clip=lambda w: np.column_stack([w[:, :2], np.clip(w[:, 2], -c*10, c*10), w[:, 3:]]))), {'saturation.limit': c*10, 'saturation.channel': 'fz'}, note='clip behind the noise; rig states the nominal range')
    A = U(.35, .5); ph = U(0, 6); fh = float(rng.choice([50., 60.]))
    add('single', 'contact', [KV], ['mains-hum'], con('lwr', pars(k=1200, c=3), pokes(Path(), rng, [.004, .006, .005], [.02, .03], [.6]), wkw=dict(hum=lambda t: np.outer(A*np.sin(2*np.pi*fh*t+ph)+.25*A*np.sin(6*np.pi*fh*t+1), [1, .6, 1.3, .01, .01, .005]))), {'mains-hum.amplitude': A, 'mains-hum.frequency': fh}, fs=1000.)
    D = U(1.2, 1.6); add('single', 'contact', [KV, 'sensor-bias'], ['sensor-drift'], con('lwr', pars(k=1000, c=3), pokes(Path(), rng, [.003, .005]*7, [.012, .02], [.5], rest=1.2), wkw=dict(sens=lambda t, w: w+np.outer(t/60, D*np.array([.5, -.4, 1, .01, .02, 0])))), {'sensor-drift.rate': [.5*D, -.4*D, D]}, fs=250.)
    # ---- single: joints
    g6 = ARMS['gen6']; Fc6 = np.array([14, 16, 9, 3.5, 3, 2.])*U(.8, 1.2); Fv6 = np.array([16, 18, 10, 4, 3, 2.])*U(.9, 1.3); amp6 = np.array([1.0, .5, .6, 1., .8, 1.2])
    RB, JC, JV, RI = 'rigid-body', 'joint-coulomb-friction', 'joint-viscous-friction', 'rotor-inertia'
    def jnt(arm, T, amp, f0, J, offset=0., payload=(0, np.zeros(3)), qtab=None, nh=3):
        def f(folder, rng, N):
            s = run_joints(rng, arm, N, T, amp, f0, J, payload, qtab, nh); write_joints(folder, rng, s, N, motor=(arm == 'gen6'), offset=offset); return s
        return f
    add('single', 'joints', [RB, JC, RI], ['joint-viscous-friction'], jnt('gen6', 24, amp6, .12, jpar(6, Fc=Fc6, Fv=Fv6*1.6)), {'joint-viscous-friction': list(Fv6*1.6)}, note='LuGre joint friction, motor side')
    add('single', 'joints', [RB, JC, JV], ['rotor-inertia'], jnt('gen6', 20, amp6*.8, .3, jpar(6, Fc=Fc6*.5, Fv=Fv6*.5)), {'rotor-inertia': list(g6['B'])}, enc=1e-5, fs=500., tau_rate=1000., tau_fc=50.)
    A, kk = U(.5, .7), float(rng.choice([8, 10, 12]))
    def drv(path_fn, T, J, gap=0., fs=None):
        def f(folder, rng, N):
            h = 2e-4; t = np.arange(0, T, h); qc = path_fn(t); r = sim.drive(qc, h, 5, .5, .1, 2e4, 400., 25., J, gap, 0)
            ts = r[:, 0]; tl_ = grid(rng, ts[-1], N['fs'], N['jit'], N['drop']); q = quant(np.interp(tl_, ts, r[:, 1]), N['enc']); ta = np.interp(tl_, ts, lp(r[:, 3], 1/(2*np.pi*N['tau_fc']), ts[1]))+rng.normal(size=tl_.size)*.02
            cols = {'t': tl_, 'q1': q}
            if N['dq']: cols['dq1'] = np.interp(tl_, ts, lp(r[:, 2], N['dq_tau'], ts[1]))+rng.normal(size=tl_.size)*N['dq_noise']
            cols['tau1'] = ta; write_table(folder, cols, N['parquet'], f'one rotary axis, vertical, no gravity load; tau1: motor torque low-passed at {N["tau_fc"]:.0f} Hz'); return dict(t=ts, rec=r)
        return f
    def sweep(speeds, Tseg):
        """piecewise smooth speeds, both directions"""
        def f(t):
            k = np.minimum((t/Tseg).astype(int), len(speeds)-1); v = np.array(speeds)[k]; u = t/Tseg-k
            b = mj(np.clip(u/.25, 0, 1))*mj(np.clip((1-u)/.25, 0, 1)); return np.cumsum(v*b)*(t[1]-t[0])
        return f
    JD = dict(Fc=1.2, Fv=.35, bl=3e-3)
    add('single', 'drive', [RB, JC, JV], ['joint-torque-ripple'], drv(sweep([1.5, -1.2, 3, -3, 2, -2.3], 7.), 42., jpar(1, **JD, rip=A, rip2=.2*A, k=kk, ph=U(0, 6))), {'joint-torque-ripple.amplitude': A, 'joint-torque-ripple.k': kk}, note='cogging; second harmonic 20 %', enc=1e-5, fs=250.)
    Ks, qs = U(70, 90), U(-.1, .1); Jk = jpar(6, Fc=Fc6, Fv=Fv6); Jk[1, 7] = Ks; Jk[1, 8] = .35+qs
    add('single', 'joints', [RB, JC, JV, RI], ['joint-spring'], jnt('gen6', 30, amp6, .1, Jk), {'joint-spring.joint_2.K': Ks, 'joint-spring.joint_2.q0': .35+qs}, note='balancer spring on joint 2, motor side')
    mp = U(.9, 1.3); Fl = np.array([.6, .6, .4, .4, .3, .15, .12]); ampl = np.array([.8, .5, .8, .5, .9, .6, 1.2])
    add('single', 'joints', [RB, JC, JV], ['payload'], jnt('lwr', 20, ampl, .12, jpar(7, Fc=Fl, Fv=Fl, bl=1e-3), payload=(mp, np.array([.02, -.01, .06]))), {'payload.mass': mp}, note='unreported point mass at (0.02,-0.01,0.06) in the sensor frame', near=())
    # ---- pairs
    dm = U(.3, .4); add('pair', 'contact', [KV, MU], ['relaxation', 'stribeck-friction'], con('lwr', pars(k=900, c=3, r1=.8, tau1=1.2, mu=.3, dmu=dm, vs=.01), slides(Path(), rng, [.004, .0055], [.003, .012, .05], L=.025)), {'relaxation.ratio': .7, 'relaxation.tau': .8, 'stribeck-friction.delta_mu': dm, 'stribeck-friction.vs': .01}, kp=9000.)
    dmass = U(.07, .1); b6 = np.array([.5, -.4, .6, .02, -.015, .006])*U(.8, 1.3)
    def static_wrench(dm, b6, N_poses=40):
        def f(folder, rng, N):
            arm = ARMS['lwr']; q = arm['q0']+rng.uniform(-1, 1, (N_poses, 7))*np.array([1, .4, 1, .6, 1.5, 1.3, 2]); q = np.clip(q, -2.05, 2.05); R, _, _ = sim.fk_np(arm, q); m, com = .42, np.array([.004, -.003, .055]); g = tilt(rng, N['base_deg']*.5)@G
            ft = np.einsum('nji,j->ni', R, m*g); w = np.hstack([ft, np.cross(com, ft)])+b6+rng.normal(size=(N_poses, 6))*NOISE*.6
            cols = {'t': np.arange(N_poses)*12.+rng.uniform(0, 1, N_poses)}; ql = quant(q, N['enc']); cols.update({f'q{i+1}': ql[:, i] for i in range(7)}); cols.update({k: w[:, i] for i, k in enumerate(('fx', 'fy', 'fz', 'tx', 'ty', 'tz'))}); save(folder, cols, False)
            sim.urdf(arm, f'{folder}/arm.urdf'); open(f'{folder}/rig.toml', 'w').write('\n'.join(['[robot]', 'model = "arm.urdf"', 'sensor_frame = "ft_sensor"', 'tip_frame = "tool_tip"', f'joints = {json.dumps([f"joint_{i+1}" for i in range(7)])}', '', '[tool]', f'mass = {m-dm:.5f}', f'com = {tl(com)}', '', '[sensor]', f'noise = {tl(NOISE*.6)}', ''])); return {}
        return f
    add('pair', 'static', ['none'], ['tool-mass', 'sensor-bias'], static_wrench(dmass, b6), {'tool-mass.dm': dmass, 'sensor-bias': list(b6)}, note='40 static poses, 12 s apart; the missing mass sits at the stated com')
    K2, db, to = U(2500, 3200), U(.0028, .0034), U(.025, .035)
    add('pair', 'contact', [KV], ['stiffening-layer', 'time-offset'], con('gen6', pars(k=900, c=4, K2=K2, db=db), pokes(Path(), rng, [.004, .006, .0025, .006, .005, .006], [.03, .06, .12], [.25]), wkw=dict(clock=to)), {'stiffening-layer.K': K2, 'stiffening-layer.depth': db, 'time-offset': to}, note='wrench stamps late by the offset: wrench(t) shows the load at t - offset', fs=500., kp=14000.)
    an, vf = U(.25, .35), U(25, 35); add('pair', 'contact', [KV, MU], ['friction-anisotropy', 'viscous-friction'], con('lwr', pars(k=1600, c=3, mu=.35, aniso=an, vt=vf), slides(Path(), rng, [.003, .0055], [.01, .04, .1], L=.03, dirs=((1, 0), (0, 1)))), {'friction-anisotropy.a': an, 'viscous-friction.c': vf}, kp=9000.)
    sb, fb = np.array([15, 16, 9, 4, 3, 2.2]), .10; Jsb = jpar(6, Fc=Fc6*.7, Fv=Fv6*.7, dF=sb, vs=fb)
    add('pair', 'joints', [RB, JC, JV], ['joint-stribeck-friction', 'rotor-inertia'], jnt('gen6', 24, amp6*.8, .17, Jsb), {'joint-stribeck-friction.dF': list(map(float, sb)), 'joint-stribeck-friction.vs': fb, 'rotor-inertia': list(g6['B'])}, enc=1e-5, fs=500., tau_rate=1000., tau_fc=50.)
    lf = np.array([0, .12, .12, 0, 0, 0]); of = np.array([5, -8, 5, 2.5, -2, 1.2]); Jl = jpar(6, Fc=Fc6*.6, Fv=Fv6*.6, load=lf)
    add('pair', 'joints', [RB, JC, JV, RI], ['joint-load-friction', 'joint-torque-offset'], jnt('gen6', 30, amp6*np.array([1, 1.6, 1.5, 1, 1, 1]), .1, Jl, offset=of), {'joint-load-friction.coefficient': list(lf), 'joint-torque-offset': list(map(float, of))})
    def prs(cyc, CP, fs, note, lat=None, dep=1e-6, noise=.01, rate=False):
        def f(folder, rng, N):
            h = 5e-4; e = np.r_[0, np.cumsum([c[0] for c in cyc])]; t = np.arange(0, e[-1], h); k = np.clip(np.searchsorted(e, t, 'right')-1, 0, len(cyc)-1); tg = np.r_[-.001, [c[1] for c in cyc]]
            u = (t-e[k])/np.array([c[0] for c in cyc])[k]; xc = tg[k]+(tg[k+1]-tg[k])*mj(np.clip(u, 0, 1)); yc = np.zeros_like(t) if lat is None else lat(t)
            r = sim.press(xc, yc, h, 1, CP, 2., 4e5, 1500.); ts = r[:, 0]; tt = grid(rng, ts[-1], fs, N['jit'], N['drop'])
            F = lp(r[:, 3], .002, h); F = F*(1+N['nonlin']*np.abs(F)/30); cols = {'t': tt, 'depth': quant(np.interp(tt, ts, r[:, 1]), dep)}
            if rate: cols['depth_rate'] = np.interp(tt, ts, r[:, 2])+rng.normal(size=tt.size)*2e-5
            if lat is not None: cols['slip1'] = quant(np.interp(tt, ts, r[:, 4]), dep)
            cols['normal_force'] = np.interp(tt, ts, F)+rng.normal(size=tt.size)*noise
            if lat is not None: cols['tangential_force1'] = np.interp(tt, ts, lp(r[:, 6], .002, h))+rng.normal(size=tt.size)*noise
            write_table(folder, cols, N['parquet'], note); return dict(t=ts, rec=r)
        return f
    cyc = []
    for d, T, hd in [(.004, 4, 60), (.006, 1.5, 80), (.003, 2, 40), (.007, 6, 90), (.005, 1, 60)]: cyc += [(T, d), (hd, d), (T, -.001), (30, -.001)]
    r1 = U(.5, .7); add('pair', 'press', [KV], ['relaxation', 'hertz-exponent'], prs(cyc, pars(k=4e4, n=1.5, c=10, r1=r1, tau1=12.), 50., 'material tester, spherical indenter'), {'relaxation.ratio': r1, 'relaxation.tau': 12., 'hertz-exponent.n': 1.5}, note='8 min; ratio = branch / long-term', nonlin=0.)
    # ---- nothing hidden
    add('none', 'contact', [KV, MU], [], con('lwr', pars(k=1400, c=4, mu=.45, bl=1e-4, s1=.0003), slides(Path(), rng, [.003, .005], [.012, .03], dirs=((1, 0), (0, 1)))), note='LuGre bristle 0.1 mm', nonlin=.01)
    add('none', 'contact', [KV, 'hertz-exponent'], [], con('gen6', pars(law=1, k=6e7, n=.012, c=5, tipa=.02), pokes(Path(), rng, [.003, .005, .006, .004], [.015, .03], [.4], places=places5)), note='bed of independent springs under a spherical cap (not a power law exactly: F = pi k (e a^2 - a^4/4R), a^2 = 2Re - e^2)')
    cyc2 = []
    for d, T, hd in [(.003, 3, 50), (.005, 1.5, 70), (.004, 6, 60), (.006, 2, 90), (.002, 1, 40), (.006, 8, 60)]: cyc2 += [(T, d), (hd, d), (T, -.001), (25, -.001)]
    add('none', 'press', ['zener'], [], prs(cyc2, pars(k=1500, r1=.6, tau1=8.), 20., 'material tester, flat punch'), note='10 min, standard linear solid')
    add('none', 'joints', [RB, JC, JV], [], jnt('lwr', 60, ampl, .03, jpar(7, Fc=Fl, Fv=Fl, bl=8e-4), nh=3), note='slow; 1 mrad encoders; 5-Hz torque', enc=1e-3, fs=100., tau_fc=5., tau_rate=50.)
    add('none', 'drive', [RB, JC, JV], [], drv(sweep([.5, -.5, 2, -2, 4, -4, 1, -1.5], 4.), 32., jpar(1, Fc=1.1, Fv=.4, bl=2e-3)), note='Dahl friction', enc=1e-5)
    def static_tau(off):
        def f(folder, rng, N):
            arm = ARMS['lwr']; n = 60; q = arm['q0']+rng.uniform(-1, 1, (n, 7))*np.array([1, .7, 1, .45, 1.5, 1., 2]); g = tilt(rng, .1)@G; tau = []
            for x in q:
                R = np.zeros((7, 3, 3)); p = np.zeros((7, 3)); a = np.zeros((7, 3)); M = np.zeros((7, 7)); hb = np.zeros(7); sim.dyn(x, np.zeros(7), arm['P'], arm['A'], arm['m'], arm['c'], arm['I'], g, R, p, a, M, hb); tau.append(hb)
            tau = np.array(tau)+off+rng.uniform(-1, 1, (n, 7))*np.array([.2, .2, .12, .12, .08, .05, .05])+rng.normal(size=(n, 7))*.02
            cols = {'t': np.arange(n)*10.}; ql = quant(q, 1e-4); cols.update({f'q{i+1}': ql[:, i] for i in range(7)}); cols.update({f'tau{i+1}': tau[:, i] for i in range(7)}); save(folder, cols, True); N['g_rig'] = g; sim.urdf(arm, f'{folder}/arm.urdf')
            open(f'{folder}/rig.toml', 'w').write('\n'.join(['# static poses, one row each; nothing is mounted on the flange', '[robot]', 'model = "arm.urdf"', 'sensor_frame = "ft_sensor"', 'tip_frame = "tool_tip"', f'gravity = {tl(g)}', f'joints = {json.dumps([f"joint_{i+1}" for i in range(7)])}', ''])); return {}
        return f
    add('none', 'static', [RB, 'joint-torque-offset'], [], static_tau(np.array([.5, -.8, .4, .6, -.3, .2, .1])), note='friction at rest leaves a scatter of up to 0.2 N m')
    tl6 = (.6, np.array([.005, 0, .06])); qa = np.array([.3, .15, .3, .2, .8, .6, 1.])
    def free(extra, amp, f0, T, rtool=None):
        def f(folder, rng, N):
            arm = ARMS['lwr']; s = run_contact(rng, 'lwr', pars(), None, kp=N['kp'], tool=tl6, on=False, qtab=fourier(rng, 7, arm['q0'], amp, f0, T), T=T, base=N['base_deg']); write_contact(folder, rng, s, N, wrench(s, extra), surface=False); return s
        return f
    add('none', 'free', ['none'], [], free(None, qa, .2, 15), note='free motion with the tool only', enc=2e-6, tool_off=.004, base_deg=.1, nonlin=0.)
    add('none', 'joints', [RB, JC, JV, RI], [], jnt('gen6', 25, amp6, .12, jpar(6, Fc=Fc6, Fv=Fv6, rnd=.002)), note='rounded (tanh) joint friction', tau_fc=50.)
    pt = lambda t: .006*np.sin(2*np.pi*.15*t)*mj(np.clip((t-3)/2, 0, 1))
    add('none', 'press', [KV, MU], [], prs([(2, .003), (18, .003), (1, .005), (19, .005), (2, -.001)], pars(k=2500, c=8, mu=.5, bl=1e-4, pt=.01, pt_len=3e-5), 500., 'tribometer: flat punch pressed and rubbed along the tangent', lat=pt, noise=.02), note='Prandtl-Tomlinson lattice ripple 1 % of N, 30 um, on a Coulomb bristle of 0.1 mm')
    # ---- outside
    cyc3 = []
    for d in (.003, .003, .005, .005, .004, .007, .007, .005): cyc3 += [(1.5, d), (.5, d), (1.5, -.001), (.5, -.001)]
    add('outside', 'press', [KV], [], prs(cyc3, pars(k=2500, c=8, plast=.45), 200., 'material tester, flat punch on foam'), {}, cls=['stress-softening', 'hysteresis'], note='plasticity: permanent indentation 0.45 x deepest depth (the whole curve moves)')
    add('outside', 'contact', [KV], [], con('lwr', pars(k=1000, c=3, mag=1.6, maggap=.0015), pokes(Path(-.008), rng, [.003, .005, .004], [.008, .012], [.4])), {}, cls=['adhesion'], note='magnet: attraction F0/(1+gap/1.5mm)^2 also before contact, on approach and retreat alike')
    add('outside', 'contact', [KV], [], con('gen6', pars(k=2600, c=4, snap=6, snap_d=.0035, snap_w=.00025), pokes(Path(), rng, [.003, .006, .005, .007], [.01, .02], [.4])), {}, cls=['stiffening-layer'], note='buckling cells: force drops by 6 N around 3.5 mm, reversible')
    def hose(s, R, a):
        p = sim.fk_np(s['arm'], s['q'])[2]; d = p-(p[0]+np.array([.05, .08, .5])); L = np.linalg.norm(d, axis=1); st = np.maximum(L-.46, 0); return -(d/L[:, None])*(12*st+150*st**2)[:, None]
    add('outside', 'free', ['none'], [], free(hose, qa*1.5, .15, 20), {}, cls=[], note='a hose from the ceiling pulls on the tool (12 N/m + 150 N/m^2 beyond 0.46 m of slack); its small reaction on the arm is left out', enc=2e-6, tool_off=.004)
    def slosh(s, R, a):
        dt = s['t'][1]; w, z, m = 2*np.pi*2.3, .04, .16; x = np.zeros(2); v = np.zeros(2); out = np.zeros((len(a), 3))
        for k in range(len(a)):
            acc = -a[k, :2]-w*w*x-2*z*w*v; v = v+dt*acc; x = x+dt*v; out[k, :2] = m*(w*w*x+2*z*w*v)+m*a[k, :2]    # the stated mass already carries -m a
        return out
    add('outside', 'free', ['none'], [], free(slosh, qa*.9, .35, 20), {}, cls=['tool-inertia'], note='a quarter of the tool is liquid that sloshes at 2.3 Hz horizontally; total mass and com as stated', enc=2e-6, tool_off=.004)
    add('outside', 'drive', [RB, JC, JV], [], drv(sweep([2, -2, 5, -5, 9, -9, 12, -12], 4.), 32., jpar(1, Fc=.6, Fv=.05, bl=3e-3, drag=.06)), {}, cls=['joint-viscous-friction', 'joint-stribeck-friction'], note='fan: drag 0.06 N m s^2 omega|omega|', enc=1e-5)
    # ---- not excited
    add('not-excited', 'contact', [KV, MU], [], con('lwr', pars(k=1400, c=4, mu=.4, aniso=.3, bl=1e-4), slides(Path(), rng, [.003, .005], [.012, .03], dirs=((1, 0),), rev=2)), {'friction-anisotropy.a': .3}, unexcited=['friction-anisotropy'], note='anisotropic surface, slid along the first tangent only')
    slow = []
    ts = np.arange(0, 60.03, .01); q = np.tile(g6['q0'], (len(ts), 1))
    for i in range(6): q[:, i] += amp6[i]*.9*np.interp(ts, [0, .5, 13+i, 24+i, 36, 47+i, 60-i*.3, 61], [0, 0, .5, -.5, .6, -.4, .1, .15])
    kern = np.hanning(301); kern /= kern.sum(); q = np.column_stack([np.convolve(np.pad(q[:, i], 150, 'edge'), kern, 'valid') for i in range(6)])
    add('not-excited', 'joints', [RB, JC, JV], [], jnt('gen6', 60, amp6, .1, jpar(6, Fc=Fc6, Fv=Fv6), qtab=q), {'rotor-inertia': list(g6['B'])}, unexcited=['rotor-inertia'], note='slow constant-speed strokes; the rotors are there (2.4 kg m^2) but hardly accelerate', enc=1e-5, fs=100.)
    add('not-excited', 'contact', [KV], [], con('gen6', pars(k=1300, c=4, K2=4000, db=.009), pokes(Path(), rng, [.003, .004, .005], [.015, .03], [.4])), {'stiffening-layer.K': 4000, 'stiffening-layer.depth': .009}, unexcited=['stiffening-layer'], note='hard layer at 9 mm, poked to 5 mm at most')
    tm = (.30, np.array([0, 0, .049]))
    add('not-excited', 'contact', [KV, 'sensor-bias'], [], con('lwr', pars(k=1200, c=4), pokes(Path(), rng, [.003, .005, .004, .005], [.015, .03], [.4]), wkw=dict(tool_rig=(.24, np.array([0, 0, .049]))), rkw=dict(tool=tm)), {'tool-mass.dm': .06}, unexcited=['tool-mass'], note='tool 60 g heavier than stated, one orientation, slow; a free bias takes it')
    return rows

def main():
    ap = argparse.ArgumentParser(); ap.add_argument('--seed', type=int, required=True); ap.add_argument('--out', required=True); ap.add_argument('--only', type=int, nargs='*'); a = ap.parse_args()
    rng = np.random.default_rng([20261126, a.seed]); rows = build(rng); order = rng.permutation(len(rows)); os.makedirs(a.out, exist_ok=True)
    truth = []; t00 = time.process_time()
    for pos, k in enumerate(order):
        r = rows[k]; name = f'row_{pos+1:02d}'
        rg = np.random.default_rng([a.seed, int(k), 7]); N = nuis(rg, r['kind']); N.update(b6=np.r_[rg.normal(size=3)*.015, rg.normal(size=3)*.001], touch=float(rg.normal()*1.5e-5))
        if rg.random() < .15: N['nonlin'] = .01
        N['dq'] = pos % 2 == 0                # half of the rows, whatever the draw
        if r['kind'] == 'free' : N['fs'] = 1000.
        if N['fs'] > 1000 and not N['parquet']: N['parquet'] = True
        if r['kind'] == 'contact' and 'coulomb-friction' in r['model']: N['enc'] = min(N['enc'], 1e-5)      # coarser steps ratchet a 0.1 mm bristle at rest
        N.update(r['N'])
        if a.only and k not in a.only: continue
        t0 = time.process_time(); s = r['maker'](os.path.join(a.out, name), rg, N)
        truth.append(dict(case=name, group=r['group'], kind=r['kind'], model=r['model'], true_model=r['model']+r['hidden'], hidden=r['hidden'], near=r['near'], values=r['values'], unexcited=r['unexcited'],
                          **{'class': r['cls']}, note=r['note'], row=int(k), nuisances={k2: (v.tolist() if isinstance(v, np.ndarray) else v) for k2, v in N.items()}))
        print(f"{name} #{k:2d} {r['group']:12s}{r['kind']:8s}{'+'.join(r['hidden']) or '-':45s}{time.process_time()-t0:6.1f} s", flush=True)
    json.dump(truth, open(f'{a.out}/truth.json', 'w'), indent=1)
    print(f'CPU {time.process_time()-t00:.0f} s')
if __name__ == '__main__': main()
