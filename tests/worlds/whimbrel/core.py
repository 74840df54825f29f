"""whimbrel: physics, chains, check fits. Own equations; nothing of the judged tool is used."""
import json, math, numpy as np
from numba import njit
from scipy.signal import butter, filtfilt, lfilter
from scipy.optimize import least_squares
# ---------------------------------------------------------------- law of contact
PN = ['k','n','c','lam','r1','tau1','r2','tau2','hA','hl','mr','ml','Fa','la','K2','db','z0','alpha','iA','is0','iw','ikind',
      'mu','cv','dmu','vs','zl','fkind','vr','p','N0','an','eps','dref','snA','snd','snw','txA','txl']
PI = {n: i for i, n in enumerate(PN)}
def neutral():
    P = np.zeros(len(PN))
    for n, v in dict(n=1., tau1=1., tau2=1., hl=1e-3, ml=1e-3, la=1e-4, db=1., iw=1e-3, vs=.01, zl=1e-4, vr=1e-3, N0=5., dref=5e-3, snw=1e-3, txl=1e-3).items():
        P[PI[n]] = v
    return P

@njit(cache=True)
def law(P, S, d, dd, ds1, ds2, v1, v2, s1, t, dt):
    # S: 0 dmax 1 h1 2 h2 3 hyst z 4 touched 5 z1 6 z2 7 prev depth
    x = d + P[16]
    N = 0.0; T1 = 0.0; T2 = 0.0
    Fe = 0.0
    k = P[0] * (1 + P[17] * t / 60.0)
    if P[18] != 0.0:
        u = (s1 - P[19]) / P[20]
        if P[21] < 0.5:
            k *= 1 + P[18] * 0.5 * (1 + math.tanh(u))
        else:
            k *= 1 + P[18] * math.exp(-u * u)
    if x > 0:
        Fe = k * x ** P[1] * (1 + P[32] * x / P[33])
        if x > P[15]:
            Fe += P[14] * (x - P[15])
        if P[34] != 0.0:
            w = (x - P[35]) / P[36]
            Fe -= P[34] * math.exp(-w * w)
    if P[10] != 0.0:
        if x > S[0]: S[0] = x
        if x > 0: Fe *= 1 - P[10] * (1 - math.exp(-(S[0] - x) / P[11]))
    F = Fe
    if P[4] != 0.0:
        S[1] += (Fe - S[1]) * (1 - math.exp(-dt / P[5])); F -= P[4] * S[1]
    if P[6] != 0.0:
        S[2] += (Fe - S[2]) * (1 - math.exp(-dt / P[7])); F -= P[6] * S[2]
    if P[8] != 0.0:
        if x > 0:
            dx = x - S[7]; sg = 1.0 if dx > 0 else -1.0
            S[3] = sg + (S[3] - sg) * math.exp(-abs(dx) / P[9]); F += P[8] * S[3]
        else:
            S[3] = 0.0
    S[7] = max(x, 0.0)
    if x > 0:
        F += P[2] * dd + P[3] * Fe * dd
        N = max(F, 0.0)
    if P[12] != 0.0:
        if x > 0:
            S[4] = 1.0; N -= P[12]
        elif S[4] > 0.5:
            if x > -P[13]: N -= P[12] * (1 + x / P[13])
            else: S[4] = 0.0
    L = max(N, 0.0)
    if L > 0 and P[22] > 0:
        mu = P[22]
        if P[29] != 0.0: mu *= (max(L, 0.05) / P[30]) ** P[29]
        v = math.sqrt(v1 * v1 + v2 * v2)
        if P[24] != 0.0: mu += P[24] * math.exp(-(v / P[25]) ** 2)
        if P[37] != 0.0: mu *= 1 + P[37] * math.sin(6.283185307 * s1 / P[38])
        l = P[26]
        if P[27] == 1.0:
            q = math.sqrt(v * v + P[28] * P[28]); a1 = v1 / q; a2 = v2 / q
        else:
            m = math.sqrt(ds1 * ds1 + ds2 * ds2)
            if m > 0:
                if P[27] == 2.0:
                    S[5] += ds1 / l; S[6] += ds2 / l
                    r = math.sqrt(S[5] ** 2 + S[6] ** 2)
                    if r > 1: S[5] /= r; S[6] /= r
                else:
                    e = math.exp(-m / l)
                    S[5] = ds1 / m + (S[5] - ds1 / m) * e; S[6] = ds2 / m + (S[6] - ds2 / m) * e
            a1 = S[5]; a2 = S[6]
        T1 = -mu * (1 + P[31]) * L * a1 - P[23] * v1
        T2 = -mu * (1 - P[31]) * L * a2 - P[23] * v2
    elif L <= 0:
        S[5] = 0.0; S[6] = 0.0
    return N, T1, T2

@njit(cache=True)
def run_law(P, d, dd, s1, s2, v1, v2, t):
    n = len(d); out = np.zeros((n, 3)); S = np.zeros(8)
    for i in range(n):
        j = max(i - 1, 0)
        a, b, c = law(P, S, d[i], dd[i], s1[i] - s1[j], s2[i] - s2[j], v1[i], v2[i], s1[i], t[i], t[i] - t[j] + 1e-12)
        out[i, 0] = b; out[i, 1] = c; out[i, 2] = a
    return out

@njit(cache=True)
def sim_cart(P, ref, sub, M, Kc, D, C):
    """ref (n,3): s1,s2,depth on a 1 ms grid; the tip is a mass on the controller's spring. Returns motion and force (T1,T2,N) at 1 ms.
    C: compliance between encoders and tip, along the normal."""
    n = len(ref); X = np.zeros((n, 3)); F = np.zeros((n, 3)); S = np.zeros(8)
    x = ref[0].copy(); v = np.zeros(3); h = 1e-3 / sub; f = np.zeros(3); dprev = x[2]
    g = np.zeros(3)
    dt_ = x[2]
    for i in range(n):
        nx = min(i + 1, n - 1)
        X[i] = x; F[i] = f
        for j in range(sub):
            w = j / sub
            for a in range(3):
                r = ref[i, a] * (1 - w) + ref[nx, a] * w
                rv = (ref[nx, a] - ref[i, a]) * 1e3
                sg = -1.0 if a == 2 else 1.0
                kk = Kc[a]
                g[a] = (kk * (r - x[a]) + D[a] * (rv - v[a]) + sg * f[a]) / M
            o1 = x[0]; o2 = x[1]
            for a in range(3):
                v[a] += h * g[a]; x[a] += h * v[a]
            if C > 0:
                dn = dt_ + 0.2 * (x[2] - C * f[2] - dt_)
            else:
                dn = x[2]
            vd = (dn - dt_) / h; dt_ = dn
            N, T1, T2 = law(P, S, dn, vd, x[0] - o1, x[1] - o2, v[0], v[1], x[0], i * 1e-3 + j * h, h)
            f[0] = T1; f[1] = T2; f[2] = N
    return X, F
# ---------------------------------------------------------------- serial chains
@njit(cache=True)
def rod(a, q):
    c = math.cos(q); s = math.sin(q); R = np.empty((3, 3))
    x, y, z = a[0], a[1], a[2]; C = 1 - c
    R[0,0]=c+x*x*C; R[0,1]=x*y*C-z*s; R[0,2]=x*z*C+y*s
    R[1,0]=y*x*C+z*s; R[1,1]=c+y*y*C; R[1,2]=y*z*C-x*s
    R[2,0]=z*x*C-y*s; R[2,1]=z*y*C+x*s; R[2,2]=c+z*z*C
    return R

@njit(cache=True)
def cr(a, b):
    return np.array([a[1]*b[2]-a[2]*b[1], a[2]*b[0]-a[0]*b[2], a[0]*b[1]-a[1]*b[0]])

@njit(cache=True)
def mv(R, a):
    return np.array([R[0,0]*a[0]+R[0,1]*a[1]+R[0,2]*a[2], R[1,0]*a[0]+R[1,1]*a[1]+R[1,2]*a[2], R[2,0]*a[0]+R[2,1]*a[1]+R[2,2]*a[2]])

@njit(cache=True)
def fk(off, ax, q, Rs, ps, pt):
    """returns sensor rotation, sensor origin, tip; Rs/ps: sensor in last link, pt: tip in the sensor frame"""
    R = np.eye(3); p = np.zeros(3)
    for i in range(len(q)):
        p = p + mv(R, off[i]); R = R @ rod(ax[i], q[i])
    p = p + mv(R, ps); R = R @ Rs
    return R, p, p + mv(R, pt)

@njit(cache=True)
def fk_all(off, ax, Q, Rs, ps, pt):
    n = len(Q); RR = np.empty((n, 3, 3)); PS = np.empty((n, 3)); PT = np.empty((n, 3))
    for i in range(n):
        RR[i], PS[i], PT[i] = fk(off, ax, Q[i], Rs, ps, pt)
    return RR, PS, PT

@njit(cache=True)
def ik_path(off, ax, q0, Rs, ps, pt, P, Rd):
    n = len(P); m = len(q0); Q = np.empty((n, m)); q = q0.copy()
    for i in range(n):
        its = 30 if i == 0 else 3
        for it in range(its):
            R = np.eye(3); p = np.zeros(3); Z = np.empty((m, 3)); O = np.empty((m, 3))
            for j in range(m):
                p = p + mv(R, off[j]); O[j] = p; Z[j] = mv(R, ax[j]); R = R @ rod(ax[j], q[j])
            p = p + mv(R, ps); R = R @ Rs; tip = p + mv(R, pt)
            E = Rd[i] @ R.T
            e = np.empty(6); e[:3] = P[i] - tip
            e[3] = .5*(E[2,1]-E[1,2]); e[4] = .5*(E[0,2]-E[2,0]); e[5] = .5*(E[1,0]-E[0,1])
            if np.abs(e).max() < 1e-11: break
            J = np.empty((6, m))
            for j in range(m):
                J[:3, j] = cr(Z[j], tip - O[j]); J[3:, j] = Z[j]
            A = J @ J.T
            for j in range(6): A[j, j] += 1e-12
            q = q + J.T @ np.linalg.solve(A, e)
        Q[i] = q
    return Q

@njit(cache=True)
def rnea_all(off, ax, ms, com, I, Q, V, A, g):
    n = len(Q); m = Q.shape[1]; out = np.empty((n, m))
    f = np.empty((m, 3)); nn = np.empty((m, 3)); Rm = np.empty((m, 3, 3))
    for k in range(n):
        w = np.zeros(3); al = np.zeros(3); a = -g
        for i in range(m):
            Rt = rod(ax[i], Q[k, i]); Rm[i] = Rt; RT = Rt.T
            a = mv(RT, a + cr(al, off[i]) + cr(w, cr(w, off[i])))
            w0 = mv(RT, w); al = mv(RT, al) + ax[i] * A[k, i] + cr(w0, ax[i] * V[k, i]); w = w0 + ax[i] * V[k, i]
            ac = a + cr(al, com[i]) + cr(w, cr(w, com[i]))
            f[i] = ms[i] * ac
            nn[i] = mv(I[i], al) + cr(w, mv(I[i], w)) + cr(com[i], f[i])
        F = np.zeros(3); Nn = np.zeros(3)
        for i in range(m - 1, -1, -1):
            F = f[i] + F; Nn = nn[i] + Nn
            out[k, i] = Nn[0]*ax[i,0] + Nn[1]*ax[i,1] + Nn[2]*ax[i,2]
            F = mv(Rm[i], F); Nn = mv(Rm[i], Nn) + cr(off[i], F)
    return out

@njit(cache=True)
def dahl(q, l):
    z = np.zeros(q.shape)
    for j in range(q.shape[1]):
        s = 0.0
        for i in range(1, len(q)):
            d = q[i, j] - q[i-1, j]
            if d != 0.0:
                g = 1.0 if d > 0 else -1.0
                s = g + (s - g) * math.exp(-abs(d) / l)
            z[i, j] = s
    return z

@njit(cache=True)
def sim_joint(ref, J, Kp, Kd, Fc, Fv, l, sub):
    n, m = ref.shape; Q = np.zeros((n, m)); A = np.zeros((n, m)); V = np.zeros((n, m)); h = 1e-3 / sub
    for j in range(m):
        q = ref[0, j]; v = (ref[1, j] - ref[0, j]) * 1e3; s = 0.0; a = 0.0
        for i in range(n):
            Q[i, j] = q; V[i, j] = v; A[i, j] = a
            nx = min(i + 1, n - 1)
            for k in range(sub):
                w = k / sub; r = ref[i, j]*(1-w)+ref[nx, j]*w; rv = (ref[nx, j]-ref[i, j])*1e3
                a = (Kp[j]*(r-q) + Kd[j]*(rv-v) - Fc[j]*s - Fv[j]*v) / J[j]
                v += h*a; d = h*v; q += d
                g = 1.0 if d > 0 else -1.0
                s = g + (s-g)*math.exp(-abs(d)/l)
    return Q, V, A

def robots():
    I6 = lambda v: np.array([[v[0], v[3], v[4]], [v[3], v[1], v[5]], [v[4], v[5], v[2]]])
    D = json.load(open(__file__.rsplit('/', 1)[0]+'/lwr4plus_inertia.json' if '/' in __file__ else 'lwr4plus_inertia.json'))
    z = lambda v: np.array([0, 0, v])
    lwr = dict(name='lwr4plus_w', off=np.array([z(v) for v in (.11, .2005, .2, .2, .2, .19, .078)]),
               ax=np.array([[0, 0, 1.], [0, -1, 0], [0, 0, 1], [0, 1, 0], [0, 0, 1], [0, -1, 0], [0, 0, 1]]),
               m=np.array([d['m'] for d in D]), com=np.array([d['com'] for d in D]), I=np.array([I6(d['I']) for d in D]),
               qw=np.array([0.1, -.5, .1, 1.6, -.1, -1.04, .3]), lim=np.array([2.9, 2., 2.9, 2., 2.9, 2., 2.9]), flange=z(0.),
               Fc=np.array([1.0, 1.1, .6, .6, .35, .25, .2]), Fv=np.array([.9, .9, .6, .6, .3, .2, .15]), Jr=np.array([.9, .9, .51, .51, .2, .13, .13]), tau=np.array([176, 176, 100, 100, 100, 38, 38.]))
    ms = np.array([8., 7., 4., 2.6, 1.7, .45])
    com = np.array([[0.02, 0, .12], [0, .03, .2], [.02, 0, .05], [0, .01, .14], [0, -.01, .03], [0, 0, .02]])
    box = [(.16, .16, .3), (.13, .13, .5), (.13, .13, .18), (.1, .1, .3), (.09, .1, .12), (.07, .07, .05)]
    I = np.array([np.diag([m/12*(b*b+c*c), m/12*(a*a+c*c), m/12*(a*a+b*b)]) for m, (a, b, c) in zip(ms, box)])
    cur = dict(name='curlew6', off=np.array([[0, 0, .15], [.05, 0, .25], [0, 0, .44], [.03, 0, .12], [0, 0, .30], [0, 0, .09]]),
               ax=np.array([[0, 0, 1.], [0, 1, 0], [0, 1, 0], [0, 0, 1], [0, 1, 0], [0, 0, 1]]), m=ms, com=com, I=I,
               qw=np.array([.15, .45, 1.35, .05, np.pi-1.8, -.4]), lim=np.array([2.9, 1.8, 2.2, 2.9, 2., 2.9]), flange=z(.03),
               Fc=np.array([6., 7., 4.5, 2., 1.6, 1.]), Fv=np.array([9., 10., 5., 1.8, 1.2, .7]), Jr=np.array([2.2, 2.4, 1.1, .3, .25, .1]), tau=np.array([200, 200, 120, 40, 40, 25.]))
    return {'lwr': lwr, 'cur': cur}

def urdf(r, ps, yaw, pt, path):
    s = [f'<?xml version="1.0"?>\n<robot name="{r["name"]}">', '<link name="base_link"/>']
    n = len(r['m']); f = lambda v: ' '.join(f'{x:.9g}' for x in v); par = 'base_link'
    for i in range(n):
        I = r['I'][i]
        s.append(f'<link name="link_{i+1}"><inertial><origin xyz="{f(r["com"][i])}" rpy="0 0 0"/><mass value="{r["m"][i]:.9g}"/><inertia ixx="{I[0,0]:.9g}" ixy="{I[0,1]:.9g}" ixz="{I[0,2]:.9g}" iyy="{I[1,1]:.9g}" iyz="{I[1,2]:.9g}" izz="{I[2,2]:.9g}"/></inertial></link>')
        s.append(f'<joint name="joint_{i+1}" type="revolute"><origin xyz="{f(r["off"][i])}" rpy="0 0 0"/><parent link="{par}"/><child link="link_{i+1}"/><axis xyz="{f(r["ax"][i])}"/><limit lower="{-r["lim"][i]:.4g}" upper="{r["lim"][i]:.4g}" effort="{r["tau"][i]:.4g}" velocity="3"/></joint>')
        par = f'link_{i+1}'
    for c, p, xyz, y in (('flange', par, r['flange'], 0), ('ft_sensor', 'flange', ps - r['flange'], yaw), ('tool_tip', 'ft_sensor', pt, 0)):
        s.append(f'<link name="{c}"/><joint name="{c}_fix" type="fixed"><origin xyz="{f(xyz)}" rpy="0 0 {y:.12g}"/><parent link="{p}"/><child link="{c}"/></joint>')
    open(path, 'w').write('\n'.join(s) + '\n</robot>\n')

# ---------------------------------------------------------------- wrench model (true and for the check)
def skew(v): return np.array([[0, -v[2], v[1]], [v[2], 0, -v[0]], [-v[1], v[0], 0]])
def tool_terms(R, Ps, t, com, grav):
    """gravito-inertial load of a unit mass in the sensor frame (n,3), angular acceleration in the sensor frame"""
    pc = Ps + R @ com
    a = np.gradient(np.gradient(pc, t, axis=0), t, axis=0)
    u = np.einsum('nji,nj->ni', R, grav - a)
    dR = np.gradient(R, t, axis=0)
    W = np.einsum('nji,njk->nik', R, dR)
    w = np.stack([W[:, 2, 1]-W[:, 1, 2], W[:, 0, 2]-W[:, 2, 0], W[:, 1, 0]-W[:, 0, 1]], 1)/2
    return u, w, np.gradient(w, t, axis=0)
def wrench(Fc, R, tt, m, com, I, pt):
    u, w, al = tt
    fs = np.einsum('nji,nj->ni', R, Fc); ft = m*u
    tq = np.cross(com, ft) + np.cross(pt, fs)
    if np.any(I): tq = tq - al @ I.T - np.cross(w, w @ I.T)
    return np.hstack([fs+ft, tq])
def lag(x, tau, dt):
    if tau <= 0: return x
    a = np.exp(-dt/tau); return lfilter([1-a], [1, -a], x, axis=0, zi=(a*x[0])[None])[0]
def delay(x, t, dt):
    if dt == 0: return x
    return np.stack([np.interp(t-dt, t, x[:, i]) for i in range(x.shape[1])], 1)
def sensor(w, t, W):
    """W: dict of sensor effects; a linear chain, in this order"""
    dt = (t[-1]-t[0])/(len(t)-1)
    w = w.copy()
    if 'gain' in W: w = w*(1+np.asarray(W['gain']))
    if 'X' in W: w = w + w @ np.asarray(W['X']).T
    if 'rot' in W:
        v = np.asarray(W['rot'], float); th = np.linalg.norm(v)+1e-15
        Rm = rod(v/th, th); w = np.hstack([w[:, :3] @ Rm, w[:, 3:] @ Rm])   # readings = Rm^T w
    if 'lag' in W: w = lag(w, W['lag'], dt)
    if 'dt' in W: w = delay(w, t, W['dt'])
    if 'bias' in W: w = w + np.asarray(W['bias'])
    if 'drift' in W: w = w + np.asarray(W['drift'])*(t[:, None]-t[0])/60
    if 'hum' in W:
        for k, (a, b) in enumerate(np.reshape(W['hum'], (-1, 2))):
            ph = 2*np.pi*W['humf']*(k+1)*t; w = w + np.asarray(W['humc'])*(a*np.sin(ph)+b*np.cos(ph))[:, None]
    if 'sat' in W:
        for c, v in W['sat'].items(): w[:, int(c)] = np.clip(w[:, int(c)], -v, v)
    return w
def smooth(x, fs, fc):
    if fc >= .4*fs: return x
    b, a = butter(2, fc/(fs/2)); return filtfilt(b, a, x, axis=0, padlen=min(len(x)-2, int(3*fs/fc)))

BASE = {'hooke': ['k'], 'kelvin-voigt': ['k', 'c'], 'hertz': ['k'], 'hunt-crossley': ['k', 'n', 'lam'], 'zener': ['k', 'r1', 'tau1'], 'maxwell': ['k', 'tau1'],
        'coulomb-friction': ['mu'], 'none': []}
LAWP = {'hertz-exponent': ['n'], 'viscous-damping': ['c'], 'hunt-crossley-damping': ['lam'], 'relaxation': ['r1', 'tau1'], 'hysteresis': ['hA', 'hl'],
        'stress-softening': ['mr', 'ml'], 'adhesion': ['Fa', 'la'], 'stiffening-layer': ['K2', 'db'], 'surface-offset': ['z0'], 'stiffness-drift': ['alpha'],
        'stiffness-inhomogeneity': ['iA', 'is0', 'iw'], 'coulomb-friction': ['mu'], 'viscous-friction': ['cv'], 'stribeck-friction': ['dmu', 'vs'], 'presliding': ['zl'],
        'friction-rounding': ['vr'], 'load-dependent-friction': ['p'], 'friction-anisotropy': ['an']}
NORMAL = ['hertz-exponent', 'viscous-damping', 'hunt-crossley-damping', 'relaxation', 'hysteresis', 'stress-softening', 'adhesion', 'stiffening-layer', 'surface-offset', 'stiffness-drift', 'stiffness-inhomogeneity', 'structural-compliance']
TANG = ['coulomb-friction', 'viscous-friction', 'stribeck-friction', 'presliding', 'friction-rounding', 'load-dependent-friction', 'friction-anisotropy']

def lsq(fun, x0, cap=60):
    x0 = np.asarray(x0, float)
    if len(x0) == 0: return x0, fun(x0)
    sc = np.where(x0 == 0, 1.0, np.abs(x0))
    with np.errstate(all='ignore'):
        s = least_squares(lambda u: np.nan_to_num(fun(u*sc), nan=1e3, posinf=1e3, neginf=-1e3), x0/sc, method='trf', diff_step=1e-4, max_nfev=cap, x_scale=np.maximum(np.abs(x0/sc), .1))
    return s.x*sc, s.fun
