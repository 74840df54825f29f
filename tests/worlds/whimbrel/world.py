from core import *
CH = ['fx', 'fy', 'fz', 'tx', 'ty', 'tz']
ATI = np.array([.015, .015, .029, .0005, .0006, .0003])
ROB = robots()
def U(r, a, b): return float(r.uniform(a, b))
def LU(r, a, b): return float(np.exp(r.uniform(np.log(a), np.log(b))))
def SG(r): return float(r.choice([-1, 1]))
def box(x, n):
    n = max(int(n), 1)
    if n == 1: return x
    p = np.vstack([np.repeat(x[:1], n, 0), x, np.repeat(x[-1:], n, 0)])
    c = np.cumsum(p, 0); y = (c[n:]-c[:-n])/n
    o = (len(y)-len(x))//2
    return y[o:o+len(x)]
def path(kn, sm):
    """kn: list of (duration, s1, s2, depth, phase); linear between, twice box-smoothed"""
    T = np.cumsum([k[0] for k in kn]); n = int(T[-1]*1000)+1; t = np.arange(n)*1e-3
    X = np.stack([np.interp(t, T, [k[1+a] for k in kn]) for a in range(3)], 1)
    ph = np.array([k[4] for k in kn])[np.minimum(np.searchsorted(T, t), len(kn)-1)]
    return t, box(box(X, sm*1000), sm*1000), ph
def rest_depth(r, cl): return -cl
def prog(r, kind, T, dmax, o):
    """o: options"""
    cl = o.get('clear', 2e-3); kn = [(0.3, 0, 0, -cl, 'free')]; tt = .3
    vs = o.get('v', (3e-3, 40e-3)); ds = o.get('d', (.35, 1.)); i = 0; x = y = 0.
    while tt < T:
        d = dmax*(U(r, *ds) if i else ds[1]*(.5 if o.get('grow') else 1)); v = LU(r, *vs) if not o.get('v1') else vs[1]
        if kind == 'poke' or (kind == 'both' and i % 2 == 0):
            if o.get('move'): x, y = U(r, -.03, .03), U(r, -.03, .03); kn.append((.5, x, y, -cl, 'free')); tt += .5
            h = LU(r, *o.get('hold', (.1, 2.)))
            m = [((d+cl)/v+.05, x, y, d, 'poke'), (h, x, y, d, 'hold')]
            for _ in range(int(r.integers(0, 4))):
                a = d*U(r, .2, .8); m += [(abs(d-a)/v+.05, x, y, a, 'poke'), (abs(d-a)/v+.05, x, y, d, 'poke')]
            m += [((d+cl)/LU(r, *vs)+.05, x, y, -cl, 'retract'), (U(r, .1, .6), x, y, -cl, 'free')]
        else:
            L = o.get('L', .04); m = [((d+cl)/.02+.05, x, y, d, 'approach'), (.2, x, y, d, 'hold')]
            for _ in range(o.get('nstroke', 6)):
                d2 = d if o.get('d1') else dmax*U(r, *ds)
                v = LU(r, *vs) if not o.get('v1') else vs[1]
                if o.get('axis1') or r.random() < o.get('p1', .6): x2, y2 = (L if x <= 0 else -L)*(1 if o.get('v1') else U(r, .5, 1)), y
                else: x2, y2 = x, (L if y <= 0 else -L)*U(r, .5, 1)*.7
                m += [(np.hypot(x2-x, y2-y)/v+.08, x2, y2, d2, 'slide'), (U(r, .05, .8), x2, y2, d2, 'hold')]; x, y = x2, y2
            m += [((d+cl)/.02+.05, x, y, -cl, 'retract'), (.3, x, y, -cl, 'free')]
        kn += m; tt += sum(k[0] for k in m); i += 1
    return path(kn, o.get('sm', LU(r, .02, .12)))

def apply(c, hv):
    """c: base description; hv: {effect: {symbol: value}} -> everything the predictor needs"""
    P = np.array(c['P'], float); W = {}; m = c.get('m', 0.); com = np.array(c.get('com', [0, 0, 0.]), float); I = np.zeros((3, 3)); pt = np.array(c.get('pt', [0, 0, 0.]), float); C = 0.
    for e, v in hv.items():
        if e in LAWP:
            for k, x in v.items(): P[PI[k]] = x
        elif e == 'tool-mass': m = m+v['dm']
        elif e == 'tool-com': com = com+np.array([v['x'], v['y'], v['z']])
        elif e == 'tool-inertia': I = np.diag([v['ixx'], v['iyy'], v['izz']])
        elif e == 'structural-compliance': C = v['C']
        elif e == 'tip-offset': pt = pt+np.array([v['x'], v['y'], v['z']])
        elif e == 'sensor-bias': W['bias'] = [v.get(k, 0.) for k in CH]
        elif e == 'sensor-drift': W['drift'] = [v.get(k, 0.) for k in CH]
        elif e == 'sensor-gain': W['gain'] = [v.get(k, 0.) for k in CH]
        elif e == 'sensor-misalignment': W['rot'] = [v['x'], v['y'], v['z']]
        elif e == 'sensor-crosstalk':
            X = np.zeros((6, 6))
            for k, x in v.items(): a, b = k.split('_'); X[CH.index(a), CH.index(b)] = x
            W['X'] = X
        elif e == 'sensor-lag': W['lag'] = v['tau']
        elif e == 'time-offset': W['dt'] = v['dt']
        elif e == 'saturation': W['sat'] = {CH.index(k): x for k, x in v.items()}
        elif e == 'mains-hum': W['hum'] = [v['a1'], v['b1'], v['a2'], v['b2']]; W['humf'] = c['humf']; W['humc'] = c['humc']
    return P, W, m, com, I, pt, C

# ---------------------------------------------------------------- nuisances
def draw_nuis(r, s):
    z = dict(enc=LU(r, 2e-6, 2e-6*(500*s)**1.0 if s > .01 else 4e-6), dq=bool(r.random() < .6), dqn=LU(r, 1e-6, 5e-4), dqb=U(r, -2e-4, 2e-4), dql=U(r, 0, .01), dqf=LU(r, 5, 60),
             jit=U(r, 0, .25)*(r.random() < .7), drop=U(r, 0, .04)*(r.random() < .6), mult=LU(r, .1, .1*30**max(s, .3)), nl=U(r, -.01, .01)*s**.5, temp=U(r, -1, 1), clk=U(r, -3e-3, 3e-3)*(r.random() < .6),
             level=np.deg2rad(U(r, 0, .3))*s**.5, lvdir=U(r, 0, 6.28), tm=1+U(r, -.02, .02)*s**.5, tc=1+U(r, -.02, .02)*s**.5, fk=int(r.choice([0, 0, 1, 2, 3])), zl=LU(r, 5e-5, 3e-4), vr=LU(r, 2e-4, 1e-3),
             eps=U(r, -.04, .06)*s, r2=U(r, 0, .03)*s, tau2=LU(r, .2, 10), lp=LU(r, 5/s**.5, 50), hold=float(r.choice([0, 0, .004, .01, .02]))*min(1, s*2), mzoh=bool(r.random() < .2))
    if z['lp'] > 50: z['lp'] = 50.
    z['clk'] *= s**.5; z['zl'] = 1e-4*(z['zl']/1e-4)**(s**.5); z['mzoh'] = z['mzoh'] and s > .3; z['fk'] = z['fk'] if s > .15 else 0
    return z
def sample_times(r, T, fs, z):
    n = int(T*fs); t = (np.arange(n)+.5)/fs + r.normal(size=n)*z['jit']/fs*.5
    t = np.sort(np.clip(t, 0, T-1e-6)); keep = r.random(n) >= z['drop']
    if z['drop'] > .02:
        a = int(r.integers(0, max(n-20, 1))); keep[a:a+int(.08*fs)] = False
    t = t[keep]; return t[np.concatenate([[True], np.diff(t) > 1e-5])]
def cub(t, X, ts):
    """cubic (Catmull-Rom) interpolation on a uniform grid"""
    dt = t[1]-t[0]; u = np.clip((ts-t[0])/dt, 1, len(t)-2.001); i = u.astype(int); w = (u-i)[:, None]
    i = np.clip(i, 1, len(t)-3)
    a, b, c, d = X[i-1], X[i], X[i+1], X[i+2]
    return b+.5*w*(c-a+w*(2*a-5*b+4*c-d+w*(3*(b-c)+d-a)))
def zoh(x, t, h):
    if h <= 0: return x
    k = np.maximum((np.floor(t/h)*h/(t[1]-t[0])+1e-6).astype(int), 0); return x[np.minimum(k, len(x)-1)]
def dqcol(r, Q, t, z, ts):
    dq = np.gradient(Q, t, axis=0); dq = lag(dq, 1/(2*np.pi*z['dqf']), 1e-3)
    d = cub(t, dq, np.maximum(ts-z['dql'], 0)); return d+r.normal(size=d.shape)*z['dqn']+z['dqb']*r.choice([-1, 1], size=d.shape[1])

# ---------------------------------------------------------------- arm with wrist sensor (contact or free)
def arm_sim(r, c, hv, z):
    rb = ROB[c['robot']]; n = len(rb['m']); yaw = U(r, -.6, .6); Rs = rod(np.array([0, 0, 1.]), yaw)
    ps = rb['flange']+np.array([0, 0, .02]); pt = np.array([0, 0, round(U(r, .08, .18), 4)]); q0 = rb['qw'].copy()
    if not c['free']: q0[-2] += U(r, -.2, .2); q0[0] = U(r, -1, 1)
    c.update(yaw=yaw, ps=ps.tolist(), pt=pt.tolist(), m=c.get('m') or round(LU(r, .12, .6), 3), com=c.get('com') or [round(U(r, -.004, .004), 4), round(U(r, -.004, .004), 4), round(pt[2]*U(r, .3, .5), 4)])
    g0 = np.array([0, 0, -9.81])
    if r.random() < .25 and 'level' not in c: g0 = rod(np.array([1., 0, 0]), U(r, -.6, .6)) @ g0
    c['grav'] = np.round(g0, 5).tolist()
    ax = np.array([np.cos(z['lvdir']), np.sin(z['lvdir']), 0]); gt = rod(ax, z['level']) @ np.array(c['grav'])
    P, W, m, com, I, ptt, C = apply(c, hv)
    m *= z['tm']; com = com*np.array([1, 1, z['tc']])
    if c['free']:
        t = np.arange(int(c['T']*1000))*1e-3; Q = np.zeros((len(t), n)); amp = c.get('amp', (.15, .6)); f = c.get('f', (.05, .4))
        for j in range(n):
            for _ in range(3):
                a, ff, p = U(r, *amp)*(.3 if j < n-3 else .8), LU(r, *f), U(r, 0, 6.28)
                a = min(a, 1.2/ff/6.28, 12/(6.28*ff)**2); Q[:, j] += a*np.sin(2*np.pi*ff*t+p)
            Q[:, j] = q0[j]+Q[:, j]
            lo = np.abs(Q[:, j]).max()
            if lo > rb['lim'][j]: Q[:, j] *= rb['lim'][j]/lo
        if c.get('poses'):   # static poses
            pass
        ph = np.array(['free']*len(t)); X = None
    else:
        R0, p0, tip = fk(rb['off'], rb['ax'], q0, Rs, ps, pt)
        nrm = -R0[:, 2]; th = U(r, -3, 3); t1 = np.cos(th)*R0[:, 0]+np.sin(th)*R0[:, 1]; t2 = np.cross(nrm, t1)
        c.update(point=tip.tolist(), normal=nrm.tolist(), tangent=t1.tolist())
        t, ref, ph = prog(r, c['kind'], c['T'], c['dmax'], c['o'])
        Kc = np.array([LU(r, 800, 2e4)]*2+[LU(r, 500, 2e4)]); M = U(r, 2, 6); D = 2*U(r, .7, 1.1)*np.sqrt(Kc*M)
        Pn = P.copy(); kind = z['fk']
        if 'friction-rounding' in hv: kind = 1
        elif 'presliding' in hv: kind = 0
        else:
            Pn[PI['zl']] = z['zl']; Pn[PI['vr']] = z['vr']
            if kind == 3 and 'stribeck-friction' not in hv and Pn[PI['dmu']] == 0: Pn[PI['dmu']] = .02*Pn[PI['mu']]; Pn[PI['vs']] = .002; kind = 0
        Pn[PI['fkind']] = kind if kind != 3 else 0
        if not c.get('exact'):
            Pn[PI['eps']] = z['eps']
            if Pn[PI['r2']] == 0 and c['normal'] in ('zener', 'maxwell') or 'relaxation' in hv: Pn[PI['r2']] = z['r2']; Pn[PI['tau2']] = z['tau2']
        dpos = np.maximum(ref[:, 2], 0); Nn = Pn[0]*dpos**Pn[1]*(1-Pn[PI['r1']]*.5)+Pn[PI['K2']]*np.maximum(dpos-Pn[PI['db']], 0)
        ref = ref.copy(); ref[:, 2] += np.minimum(Nn, 80)/Kc[2] + C*np.minimum(Nn, 80)
        X, F = sim_cart(Pn, ref, 5 if kind != 1 else 8, M, Kc, D, C)
        Xb = tip+X[:, :1]*t1+X[:, 1:2]*t2-X[:, 2:]*nrm
        Rd = np.repeat(R0[None], len(t), 0)
        tl = c.get('tilt', 0.)
        if tl:
            a1 = tl*np.sin(2*np.pi*t/U(r, 5, 9)); a2 = tl*np.sin(2*np.pi*t/U(r, 6, 11)+1)
            for i in range(len(t)): Rd[i] = R0 @ rod(np.array([1., 0, 0]), a1[i]) @ rod(np.array([0, 1., 0]), a2[i])
        if np.any(ptt != pt):      # the true tip is displaced: depth from the true tip, so steer the true tip
            Q = ik_path(rb['off'], rb['ax'], q0, Rs, ps, ptt, Xb, Rd)
        else: Q = ik_path(rb['off'], rb['ax'], q0, Rs, ps, pt, Xb, Rd)
        Fb = F[:, :1]*t1+F[:, 1:2]*t2+F[:, 2:]*nrm
    R, PS, PT = fk_all(rb['off'], rb['ax'], Q, Rs, ps, ptt)
    tt = tool_terms(R, PS, t, com, gt)
    if c['free']: Fb = np.zeros((len(t), 3))
    w = wrench(Fb, R, tt, m, com, I, ptt)
    if c.get('cable'):
        k, L, anc = c['cable']; dv = np.array(anc)-PS; Ln = np.linalg.norm(dv, axis=1)
        fc = (k*np.maximum(Ln-L, 0)/Ln)[:, None]*dv; f = np.einsum('nji,nj->ni', R, fc); w[:, :3] += f; w[:, 3:] += np.cross(np.array([.03, 0, .01]), f)
    if c.get('floor'):
        A, f0 = c['floor']; ph0 = np.cumsum(2*np.pi*(f0+.3*lag(r.normal(size=len(t))*20, 1., 1e-3)))*1e-3; env = 1+.4*np.sin(2*np.pi*t/U(r, 4, 9))
        w[:, 2] += A*env*np.sin(ph0); w[:, 0] += .5*A*env*np.sin(ph0+.7)
    sat = W.pop('sat', None)
    w = sensor(w, t, W)
    # clock nuisance, limited so that it leaves at most about the noise or 1.5 % of the reading
    sig = ATI*z['mult']; dw = np.sqrt(np.mean(np.gradient(w[:, :3], t, axis=0)**2)); lim = max(sig[:3].mean(), .012*np.sqrt(np.mean((w[:, :3]-w[0, :3])**2)))/dw
    clk = 0. if ('time-offset' in hv or 'sensor-lag' in hv) else float(np.clip(z['clk'], -lim, lim)); z['clk_used'] = clk
    w = delay(w, t, clk)
    clean = w.copy()
    if sat:
        for k, v in sat.items(): clean[:, k] = np.clip(clean[:, k], -v, v)
    fs = c['fs']; ts = sample_times(r, t[-1], fs, z)
    ws = cub(t, zoh(w, t, z['hold']*.3) if z['mzoh'] and fs < 400 and 'sensor-lag' not in hv and 'time-offset' not in hv else w, ts)
    rngs = np.array([40, 40, 120, 2, 2, 2.]); pk = np.abs(w).max(0)+1e-9
    ws = ws+z['nl']*pk*((ws/pk)**3-.6*(ws/pk))         # nonlinearity, fraction of the used range
    warm = z['temp']*np.maximum(sig*1.0, .006*np.sqrt(np.mean((w-w.mean(0))**2, 0)))*np.array([1, -.6, .8, .5, .5, .3]); ws = ws+warm*(1-np.exp(-ts/(.5*t[-1])))[:, None]
    ws = ws+r.normal(size=ws.shape)*sig
    if sat:
        for k, v in sat.items(): ws[:, k] = np.clip(ws[:, k], -v, v)+(r.normal(size=len(ws))*sig[k]*c.get('satn', 0))
    if 'quantization' in hv: st = hv['quantization']['step']; ws[:, :3] = np.round(ws[:, :3]/st)*st
    else: st = np.array([.01, .01, .02, .00025, .00025, .00025])*min(1., 3*z['mult']); ws = np.round(ws/st)*st
    Qs = cub(t, Q, ts); log = {'t': ts}
    for j in range(n): log[f'q{j+1}'] = np.round(Qs[:, j]/z['enc'])*z['enc']
    if z['dq']:
        dq = dqcol(r, Q, t, z, ts)
        for j in range(n): log[f'dq{j+1}'] = dq[:, j]
    for k in range(6): log[CH[k]] = ws[:, k]
    if r.random() < .6: log['phase'] = ph[np.minimum((ts*1000).astype(int), len(ph)-1)]
    c['enc'] = z['enc']; c['sigma'] = sig.tolist(); c['nd_noise'] = sig[:3].tolist()
    err = np.sqrt(np.mean((ws[:, :3]-cub(t, clean, ts)[:, :3])**2)); c['Kc'] = None if c['free'] else Kc.tolist()
    return log, err

def prep_arm(log, c, maxrows=12000):
    rb = ROB[c['robot']]; n = len(rb['m']); t = log['t']; Q = np.stack([log[f'q{j+1}'] for j in range(n)], 1); Wm = np.stack([log[k] for k in CH], 1)
    fs = 1/np.median(np.diff(t)); tu = np.arange(t[0], t[-1], 1/fs)
    Q = np.stack([np.interp(tu, t, Q[:, j]) for j in range(n)], 1); Wm = np.stack([np.interp(tu, t, Wm[:, j]) for j in range(6)], 1)
    fc = 60. if c.get('enc', 1) < 3e-5 else 25.; Q = smooth(Q, fs, fc)
    dec = 1
    if not c.get('fullrate'): dec = max(1, int(np.ceil(len(tu)/maxrows)))
    if dec > 1:
        k = len(tu)//dec*dec; mean = lambda a: a[:k].reshape(k//dec, dec, *a.shape[1:]).mean(1)
        Q, Wm, tu = mean(Q), mean(Wm), mean(tu)
    Rs = rod(np.array([0, 0, 1.]), c['yaw']); ps = np.array(c['ps']); R, PS, _ = fk_all(rb['off'], rb['ax'], Q, Rs, ps, np.array(c['pt']))
    fa = smooth(Q, 1/(tu[1]-tu[0]), 35. if c.get('enc', 1) < 1.5e-5 else 15. if c.get('enc', 1) < 1e-4 else 8.); Ra, PSa, _ = fk_all(rb['off'], rb['ax'], fa, Rs, ps, np.array(c['pt']))
    return dict(t=tu, R=R, PS=PS, Ra=Ra, PSa=PSa, W=Wm, grav=np.array(c['grav']))

def params(c, effs, hv):
    """list of (where, symbol, start)"""
    L = []
    for b in c['model']:
        if b in BASE:
            for s in BASE[b]: L.append(('base', s, c['P'][PI[s]] if not (s == 'n' and c['P'][PI[s]] == 1) else 1.))
        elif b in LAWP and b not in BASE:
            for s in LAWP[b]: L.append(('base', s, c['P'][PI[s]]))
    seen = {s for _, s, _ in L}
    for e in effs:
        if e in ('saturation', 'quantization'): continue
        for s, v in hv[e].items():
            if not (e in LAWP and s in seen): L.append((e, s, v))
    return L

def predict_arm(F, c, L, th, effs, hv):
    cc = dict(c); cc['P'] = np.array(c['P'], float); h = {e: dict(hv[e]) for e in effs}
    for (w, s, _), v in zip(L, th):
        if w == 'base': cc['P'][PI[s]] = v
        else: h[w][s] = v
        if w == 'base':
            for e in effs:
                if e in LAWP and s in h[e]: h[e][s] = v
    P, W, m, com, I, pt, C = apply(cc, h)
    for s in ('zl', 'vr'):
        if not any(s in h.get(e, {}) for e in effs): P[PI[s]] = {'zl': 1e-4, 'vr': 1e-3}[s]
    P[PI['fkind']] = 1. if 'friction-rounding' in effs else 0.
    if c['free']: Fb = np.zeros((len(F['t']), 3))
    else:
        nrm, t1 = np.array(c['normal']), np.array(c['tangent']); t2 = np.cross(nrm, t1); X = F['PS']+F['R'] @ pt-np.array(c['point'])
        d = -X @ nrm; s1 = X @ t1; s2 = X @ t2
        if C:
            fm = np.einsum('nij,nj->ni', F['R'], F['W'][:, :3]) @ nrm - m*(F['grav'] @ nrm)
            d = d-C*np.maximum(fm, 0)
        g = lambda a: np.gradient(a, F['t'])
        f = run_law(P, d, g(d), s1, s2, g(s1), g(s2), F['t']); Fb = f[:, :1]*t1+f[:, 1:2]*t2+f[:, 2:]*nrm
    key = tuple(np.round(com, 12))
    if F.get('key') != key: F['tt'] = tool_terms(F['Ra'], F['PSa'], F['t'], com, F['grav']); F['key'] = key
    return sensor(wrench(Fb, F['R'], F['tt'], m, com, I, pt), F['t'], W)

def readings(F, c, res):
    o = {CH[k]: res[:, k] for k in range(6)}; o['f'] = res[:, :3].ravel(); o['q'] = res[:, 3:].ravel()
    if not c['free']:
        b = np.einsum('nij,nj->ni', F['R'], res[:, :3]); nrm, t1 = np.array(c['normal']), np.array(c['tangent']); o['n'] = b @ nrm; o['t'] = np.stack([b @ t1, b @ np.cross(nrm, t1)], 1).ravel()
    else: o['n'] = o['t'] = o['f']
    return {k: float(np.sqrt(np.mean(v**2))) for k, v in o.items()}

def fit_arm(F, c, effs, hv, use_t):
    L = params(c, effs, hv); W = F['W']; sg = np.maximum(np.array(c['sigma']), .01*np.sqrt(np.mean((W-W.mean(0))**2, 0)))
    nc = 6 if use_t else 3
    fun = lambda th: ((predict_arm(F, c, L, th, effs, hv)-W)/sg)[:, :nc].ravel()
    th, _ = lsq(fun, [x[2] for x in L], 15)
    return readings(F, c, predict_arm(F, c, L, th, effs, hv)-W)
def arm_scale(F, c):
    W = F['W']-F['W'].mean(0); b = readings(F, c, W); return b

# ---------------------------------------------------------------- tester and tribometer
def tester_sim(r, c, hv, z):
    P, W, *_ = apply(c, hv); t, ref, ph = prog(r, c['kind'], c['T'], c['dmax'], c['o'])
    Pn = P.copy()
    if not c.get('exact'): Pn[PI['eps']] = z['eps']
    if 'presliding' not in hv and 'friction-rounding' not in hv: Pn[PI['zl']] = z['zl']; Pn[PI['vr']] = z['vr']; Pn[PI['fkind']] = z['fk'] % 3
    if 'friction-rounding' in hv: Pn[PI['fkind']] = 1
    if 'relaxation' in hv or c['normal'] == 'zener': Pn[PI['r2']] = z['r2']; Pn[PI['tau2']] = z['tau2']
    up = 4; n = (len(t)-1)*up+1; tf = np.arange(n)*(1e-3/up); X = np.stack([np.interp(tf, t, ref[:, a]) for a in range(3)], 1); X = box(box(X, 8), 8); V = np.gradient(X, tf, axis=0)
    F = run_law(Pn, X[:, 2], V[:, 2], X[:, 0], X[:, 1], V[:, 0], V[:, 1], tf)[::up]; X = X[::up]; V = V[::up]
    sig = c['s0']*z['mult']; dw = np.sqrt(np.mean(np.gradient(F, t, axis=0)**2)); lim = max(sig, .012*np.sqrt(np.mean(F**2)))/dw; clk = float(np.clip(z['clk'], -lim, lim)); z['clk_used'] = clk
    w = sensor(np.hstack([F[:, [2]], F[:, :2], np.zeros((len(t), 3))]), t, W)
    w = delay(w, t, clk)[:, :3]; ts = sample_times(r, t[-1], c['fs'], z); cl = cub(t, w, ts); ws = cl.copy(); pk = np.abs(w).max()
    ws = ws+z['nl']*pk*((ws/pk)**3-.6*ws/pk)+z['temp']*max(sig, .006*pk*.4)*(1-np.exp(-ts/(.5*t[-1])))[:, None]*np.array([1, .3, .3])
    st = hv['quantization']['step'] if 'quantization' in hv else sig*.5
    ws = np.round((ws+r.normal(size=ws.shape)*sig)/st)*st
    xs = cub(t, X, ts); dres = z['enc']*1e-2 if c['s0'] else 0     # scale of the displacement transducer: 0.02..10 um
    log = {'t': ts, 'depth': np.round((xs[:, 2]+r.normal(size=len(ts))*dres*.5)/dres)*dres}
    if z['dq']: log['depth_rate'] = cub(t, lag(V[:, [2]], 1/(2*np.pi*z['dqf']), 1e-3), ts)[:, 0]+r.normal(size=len(ts))*z['dqn']*.1
    log['normal_force'] = ws[:, 0]
    if c['tribo']:
        for i in (0, 1): log[f'slip{i+1}'] = np.round(xs[:, i]/dres)*dres
        for i in (0, 1): log[f'tangential_force{i+1}'] = ws[:, 1+i]
    if r.random() < .5: log['phase'] = ph[np.minimum((ts*1000).astype(int), len(ph)-1)]
    c['sigma'] = [sig]*6; k = 3 if c['tribo'] else 1
    return log, float(np.sqrt(np.mean((ws-cl)[:, :k]**2)))
def prep_tester(log, c, maxrows=12000):
    t = log['t']; fs = 1/np.median(np.diff(t)); tu = np.arange(t[0], t[-1], 1/fs); g = lambda k: np.interp(tu, t, log[k]) if k in log else np.zeros(len(tu))
    X = np.stack([g('slip1'), g('slip2'), g('depth')], 1); Wm = np.stack([g('normal_force'), g('tangential_force1'), g('tangential_force2')], 1)
    X = smooth(X, fs, min(25., .3*fs)); dec = 1 if c.get('fullrate') else max(1, int(np.ceil(len(tu)/maxrows)))
    if dec > 1:
        k = len(tu)//dec*dec; mean = lambda a: a[:k].reshape(k//dec, dec, *a.shape[1:]).mean(1); X, Wm, tu = mean(X), mean(Wm), mean(tu)
    return dict(t=tu, X=X, W=Wm)
def fit_tester(F, c, effs, hv, use_t=False):
    L = params(c, effs, hv); t = F['t']; X = F['X']; V = np.gradient(X, t, axis=0); k = 3 if c['tribo'] else 1
    def pred(th):
        cc = dict(c); cc['P'] = np.array(c['P'], float); h = {e: dict(hv[e]) for e in effs}
        for (w, s, _), v in zip(L, th):
            if w == 'base':
                cc['P'][PI[s]] = v
                for e in effs:
                    if e in LAWP and s in h[e]: h[e][s] = v
            else: h[w][s] = v
        P, W, *_ = apply(cc, h); P[PI['fkind']] = 1. if 'friction-rounding' in effs else 0.
        if 'presliding' not in effs: P[PI['zl']] = 1e-4
        f = run_law(P, X[:, 2], V[:, 2], X[:, 0], X[:, 1], V[:, 0], V[:, 1], t)[:, [2, 0, 1]]
        return sensor(np.hstack([f, np.zeros((len(t), 3))]), t, W)[:, :3]
    sg = np.maximum(np.array(c['sigma'][:3]), .01*np.sqrt(np.mean(F['W']**2, 0)))
    th, _ = lsq(lambda th: ((pred(th)-F['W'])/sg)[:, :k].ravel(), [x[2] for x in L], 15); e = pred(th)-F['W']; rm = lambda a: float(np.sqrt(np.mean(a**2)))
    return {'n': rm(e[:, 0]), 'fx': rm(e[:, 0]), 't': rm(e[:, 1:]), 'f': rm(e[:, :k])}
def tester_scale(F, c):
    W = F['W']; rm = lambda a: float(np.sqrt(np.mean(a**2))); return {'n': rm(W[:, 0]), 'fx': rm(W[:, 0]), 't': rm(W[:, 1:]), 'f': rm(W[:, :3 if c['tribo'] else 1])}

# ---------------------------------------------------------------- joint torques and the drive
def joint_cols(e, v, j, q, dq, ddq, z, trb):
    """regressor column(s) for effect e at joint j with nonlinear parameters of v"""
    if e == 'joint-coulomb-friction': return [z]
    if e == 'joint-viscous-friction': return [dq]
    if e == 'joint-torque-offset': return [np.ones_like(q)]
    if e == 'rotor-inertia': return [ddq]
    if e == 'joint-torque-gain': return [trb]
    if e == 'joint-friction-asymmetry': return [np.abs(z), np.abs(dq)]
    if e == 'joint-stribeck-friction': return [z*np.exp(-(dq/v['vs'])**2)]
    if e == 'joint-load-friction': return [z*np.abs(trb)]
    if e == 'joint-torque-ripple': return [np.sin(v['k']*q), np.cos(v['k']*q)]
    if e == 'joint-spring': return [q]
    return []
def joint_extra(c, hv, j, q, dq, ddq, z, trb):
    o = np.zeros_like(q)
    for e, v in hv.items():
        if 'joints' in v and j not in v['joints']: continue
        i = v['joints'].index(j) if 'joints' in v else 0
        g = lambda s: (v[s][i] if isinstance(v[s], list) else v[s])
        if e == 'joint-coulomb-friction': o += g('Fc')*z
        elif e == 'joint-viscous-friction': o += g('Fv')*dq
        elif e == 'joint-torque-offset': o += g('tau0')
        elif e == 'rotor-inertia': o += g('I')*ddq
        elif e == 'joint-friction-asymmetry': o += g('a')*(c['Fc'][j]*np.abs(z)+c['Fv'][j]*np.abs(dq))
        elif e == 'joint-stribeck-friction': o += g('dF')*z*np.exp(-(dq/v['vs'])**2)
        elif e == 'joint-load-friction': o += g('b')*z*np.abs(trb)
        elif e == 'joint-torque-ripple': o += g('A')*np.sin(v['k']*q+g('phi'))
        elif e == 'joint-spring': o += g('ks')*(q-g('q0'))
    return o
def jdyn(c, q, dq, ddq, grav, hv):
    if c['robot'] == 'drive': return c['J']*ddq
    rb = ROB[c['robot']]; m, com, I = rb['m'].copy(), rb['com'].copy(), rb['I'].copy()
    if 'payload' in hv:
        v = hv['payload']; pc = rb['flange']+np.array([v['x'], v['y'], v['z']]); M = m[-1]+v['m']; cn = (m[-1]*com[-1]+v['m']*pc)/M
        def S(d): return (d@d)*np.eye(3)-np.outer(d, d)
        I[-1] = I[-1]+m[-1]*S(com[-1]-cn)+v['m']*S(pc-cn); m[-1] = M; com[-1] = cn
    return rnea_all(rb['off'], rb['ax'], m, com, I, q, dq, ddq, grav)
def joint_sim(r, c, hv, z):
    rb = ROB.get(c['robot']); n = 1 if rb is None else len(rb['m']); t = np.arange(int(c['T']*1000))*1e-3; ref = np.zeros((len(t), n))
    a0, f0 = c.get('amp', (.1, .6)), c.get('f', (.04, .3))
    for j in range(n):
        for _ in range(4):
            f = LU(r, *f0); a = min(U(r, *a0), c.get('vmax', 1.2)/(6.28*f)); ref[:, j] += a*np.sin(2*np.pi*f*t+U(r, 0, 6.28))
        if rb is not None:
            q00 = rb['qw'][j]*.6; lo = np.abs(ref[:, j]).max(); av = rb['lim'][j]-abs(q00)
            if lo > av: ref[:, j] *= av/lo
            ref[:, j] += q00
        elif c.get('turns'): ref[:, j] += c['turns']*2*np.pi*np.sin(2*np.pi*t/c['T']*c.get('cyc', 1))
    Fc = np.array(c['Fc']); Fv = np.array(c['Fv']); l = z['zl']*(8 if n > 1 else 20); c['jl'] = l
    J = np.full(n, 1.5) if n > 1 else np.array([c['J']]); Kp = LU(r, 400, 8000)*J; Kd = 2*U(r, .6, 1.)*np.sqrt(Kp*J)
    Q, V, A = sim_joint(ref, J, Kp, Kd, Fc*.5, Fv*.5, l, 4)
    A = box(A, 3)
    c['grav'] = [0, 0, -9.81]
    if r.random() < .25 and n > 1: c['grav'] = np.round(rod(np.array([1., 0, 0]), U(r, -.8, .8)) @ np.array([0, 0, -9.81]), 5).tolist()
    g = rod(np.array([np.cos(z['lvdir']), np.sin(z['lvdir']), 0]), z['level']) @ np.array(c['grav'])
    if 'gravity-error' in hv: v = hv['gravity-error']; g = rod(np.array([1., 0, 0]), v['rx']) @ rod(np.array([0, 1., 0]), v['ry']) @ np.array(c['grav'])
    T = jdyn(c, Q, V, A, g, hv)
    zz = dahl(Q, l) if z['fk'] in (0, 3) else (dahl(Q, l*.3) if z['fk'] == 2 else V/np.sqrt(V**2+(2e-3)**2))
    tau = T.copy(); wu = 1.
    if c.get('warm'): B, tw = c['warm']; wu = 1+B*np.exp(-t/tw)
    for j in range(n):
        if 'joint-coulomb-friction' in c['model']: tau[:, j] += wu*Fc[j]*zz[:, j]
        if 'joint-viscous-friction' in c['model']: tau[:, j] += wu*Fv[j]*V[:, j]
        tau[:, j] += joint_extra(c, hv, j, Q[:, j], V[:, j], A[:, j], zz[:, j], T[:, j])
    if c.get('xt'):
        i, j, a = c['xt']; tt0 = tau.copy(); tau[:, i] += a*tt0[:, j]; tau[:, j] += .6*a*tt0[:, i]
    if 'joint-torque-gain' in hv:
        v = hv['joint-torque-gain']
        for i, j in enumerate(v['joints']): tau[:, j] *= 1+v['g'][i]
    cl = tau.copy()
    tau = lag(tau, 1/(2*np.pi*z['lp']), 1e-3); tau = zoh(tau, t, z['hold'])
    ts = sample_times(r, t[-1], c['fs'], z); k = np.minimum((ts*1000).astype(int), len(t)-1); ws = tau[k] if z['hold'] else cub(t, tau, ts)
    if n > 1 or z['nl']:
        pk = np.abs(tau).max(0)+1e-9; ws = ws+z['nl']*.5*pk*((ws/pk)**3-.6*ws/pk)
    sig = np.array(c['s0'])*z['mult']; ws = ws+z['temp']*np.maximum(sig, .004*np.std(tau, 0))*(1-np.exp(-ts/(.5*t[-1])))[:, None]
    st = hv['quantization']['step'] if 'quantization' in hv else sig*.3
    ws = np.round((ws+r.normal(size=ws.shape)*sig)/st)*st
    Qs = cub(t, Q, ts); log = {'t': ts}
    for j in range(n): log[f'q{j+1}'] = np.round(Qs[:, j]/z['enc'])*z['enc']
    if z['dq']:
        d = dqcol(r, Q, t, z, ts)
        for j in range(n): log[f'dq{j+1}'] = d[:, j]
    for j in range(n): log[f'tau{j+1}'] = ws[:, j]
    c['sigma'] = sig.tolist()
    return log, float(np.sqrt(np.mean((ws-cub(t, cl, ts))**2)))
def prep_joint(log, c, maxrows=12000):
    n = sum(k.startswith('tau') for k in log); t = log['t']; fs = 1/np.median(np.diff(t)); tu = np.arange(t[0], t[-1], 1/fs)
    Q = np.stack([np.interp(tu, t, log[f'q{j+1}']) for j in range(n)], 1); W = np.stack([np.interp(tu, t, log[f'tau{j+1}']) for j in range(n)], 1)
    Q = smooth(Q, fs, 10.); Q2 = smooth(Q, fs, 5.)
    dec = max(1, int(np.ceil(len(tu)/maxrows)))
    if dec > 1:
        k = len(tu)//dec*dec; mean = lambda a: a[:k].reshape(k//dec, dec, *a.shape[1:]).mean(1); Q, Q2, W, tu = mean(Q), mean(Q2), mean(W), mean(tu)
    V = np.gradient(Q, tu, axis=0); A = np.gradient(np.gradient(Q2, tu, axis=0), tu, axis=0)
    return dict(t=tu, Q=Q, V=V, A=A, W=W, z=dahl(Q, c['jl']))
def fit_joint(F, c, effs, hv, use_t=False):
    n = F['Q'].shape[1]; Q, V, A, W = F['Q'], F['V'], F['A'], F['W']; g = np.array(c.get('grav', [0, 0, -9.81]), float)
    rb = {}
    if c['robot'] != 'drive': T0 = jdyn(c, Q, V, A, g, {})
    else: T0 = np.zeros_like(Q)
    extra = []
    if 'payload' in effs:
        v = hv['payload']; e0 = {'m': 1e-9, 'x': v['x'], 'y': v['y'], 'z': v['z']}
        extra.append(jdyn(c, Q, V, A, g, {'payload': v})-T0)
    if 'gravity-error' in effs:
        v = hv['gravity-error']; Z = np.zeros_like(Q)
        extra += [jdyn(c, Q, Z, Z, d, {}) for d in np.eye(3)]   # free gravity vector: linear
    res = np.zeros_like(W); glob = None
    cols = []
    for j in range(n):
        C = []
        if c['robot'] == 'drive': C.append(A[:, j])
        for e in list(c['model'])+[x for x in effs if x not in ('payload', 'gravity-error')]:
            if e == 'rigid-body': continue
            v = hv.get(e, {})
            if e in effs and 'joints' in v and j not in v['joints']: continue
            C += joint_cols(e, v, j, Q[:, j], V[:, j], A[:, j], F['z'][:, j], T0[:, j] if c['robot'] != 'drive' else c['J']*A[:, j])
        cols.append(C)
    sg = np.maximum(np.array(c['sigma']), .01*np.std(W, 0)); N = len(Q); Y = W-T0
    if extra:   # eliminate per-joint columns, then solve the shared ones
        def proj(x, C):
            if not C: return x
            B = np.stack(C, 1); return x-B @ np.linalg.lstsq(B, x, rcond=None)[0]
        E = np.stack([np.concatenate([proj(x[:, j], cols[j])/sg[j] for j in range(n)]) for x in extra], 1); y = np.concatenate([proj(Y[:, j], cols[j])/sg[j] for j in range(n)])
        b = np.linalg.lstsq(E, y, rcond=None)[0]; res = (y-E @ b).reshape(n, N).T*sg
    else:
        for j in range(n):
            res[:, j] = Y[:, j] if not cols[j] else Y[:, j]-np.stack(cols[j], 1) @ np.linalg.lstsq(np.stack(cols[j], 1), Y[:, j], rcond=None)[0]
    o = {f'j{j}': float(np.sqrt(np.mean(res[:, j]**2))) for j in range(n)}; o['all'] = float(np.sqrt(np.mean(res**2))); return o
def joint_scale(F, c):
    o = {f'j{j}': float(np.sqrt(np.mean(F['W'][:, j]**2))) for j in range(F['W'].shape[1])}; o['all'] = float(np.sqrt(np.mean(F['W']**2))); return o

ENG = {'arm': (arm_sim, prep_arm, fit_arm, arm_scale), 'tester': (tester_sim, prep_tester, fit_tester, tester_scale), 'joint': (joint_sim, prep_joint, fit_joint, joint_scale)}
def judge(log, c, truth, hv, read):
    """ratios: base vs base+truth, and for two: truth without one vs full; plus what is left relative to noise and reading"""
    _, prep, fit, scale = ENG[c['engine']]; F = prep(log, c); ut = any(read[e] in ('q', 'tx', 'ty', 'tz') for e in read) if read else c.get('ut', False)
    full = fit(F, c, truth, hv, ut); sc = scale(F, c); o = {'full': full, 'scale': sc}
    base = fit(F, c, [], hv, ut) if truth else full; o['base'] = base
    o['ratio'] = {e: base[read[e]]/full[read[e]] for e in truth}
    if len(truth) == 2:
        for e in truth:
            d = fit(F, c, [x for x in truth if x != e], hv, ut); o['ratio'][e] = d[read[e]]/full[read[e]]
    return o
