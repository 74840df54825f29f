"""Contact law with memory and the tip under control (velocity Verlet). One law serves the simulation and the check's fits."""
import math
import numpy as np
from numba import njit
NAMES = "k n c lam r1 t1 r2 t2 hA hL mr mL Fa aL K2 db z0 al iA ix iy iw mu cv dmu vs bl ft vr pe an C eps sqz wav wvL".split()
IX = {a: i for i, a in enumerate(NAMES)}
(k_, n_, c_, lam_, r1_, t1_, r2_, t2_, hA_, hL_, mr_, mL_, Fa_, aL_, K2_, db_, z0_, al_, iA_, ix_, iy_, iw_, mu_, cv_, dmu_, vs_, bl_, ft_, vr_, pe_, an_, C_, eps_, sqz_, wav_, wvL_) = range(len(NAMES))
DEF = dict(n=1., t1=1., t2=1., hL=1e-3, mL=1e-3, aL=1e-3, db=1., iw=1., vs=.01, bl=1e-4, vr=1e-3, wvL=.01)
def pack(**kw):
    p = np.zeros(len(NAMES))
    for a, b in {**DEF, **kw}.items(): p[IX[a]] = b
    return p
@njit(cache=False)
def elastic(p, d, t, s1, s2, dm):
    if d <= 0: return 0.
    f = p[k_]*d**p[n_]*(1+p[al_]*t/60)*(1+p[eps_]*d/.004)
    if p[iA_] != 0.: f *= 1+p[iA_]*math.exp(-((s1-p[ix_])**2+(s2-p[iy_])**2)/(2*p[iw_]**2))
    if p[mr_] != 0. and dm > d: f *= 1-p[mr_]*(1-math.exp(-(dm-d)/p[mL_]))
    if d > p[db_]: f += p[K2_]*(d-p[db_])
    return f
@njit
def law(z, p, dt, t, d, dd, s1, s2, v1, v2):
    """z: 0,1 Maxwell branches; 2 loop; 3 deepest; 4,5 bristle; 6 last elastic; 7 last other; 8 touched"""
    d += p[z0_]
    if p[wav_] != 0.: d += p[wav_]*math.sin(2*math.pi*s1/p[wvL_])
    de = d
    if p[C_] > 0. and d > 0:
        for _ in range(8): de = .5*de+.5*(d-p[C_]*(elastic(p, de, t, s1, s2, z[3])+z[7]))
        d = de
    if d > z[3]: z[3] = d
    fe = elastic(p, d, t, s1, s2, z[3]); df = fe-z[6]; z[6] = fe
    a = math.exp(-dt/p[t1_]); g = p[t1_]/dt*(1-a); z[0] = z[0]*a+p[r1_]*df*g
    a = math.exp(-dt/p[t2_]); g = p[t2_]/dt*(1-a); z[1] = z[1]*a+p[r2_]*df*g
    N = 0.
    if d > 0:
        N = fe+z[0]+z[1]+(p[c_]+p[lam_]*fe)*dd
        if p[hA_] != 0.:                                  # Bouc-Wen, exponent 2
            u = dd*dt/p[hL_]; m = int(abs(u)/.2)+1
            for _ in range(m): z[2] += (1-(z[2]*abs(z[2]) if u > 0 else -z[2]*abs(z[2])))*u/m
            N += p[hA_]*z[2]*min(1., d/p[hL_])
        if p[sqz_] != 0.: N += p[sqz_]*dd*math.exp(-d/4e-4)
    else:
        z[2] = 0.
        if p[sqz_] != 0. and d > -1.5e-3 : N = p[sqz_]*dd*math.exp(d/4e-4)
    z[7] = .5*z[7]+.5*(N-fe)
    if p[Fa_] != 0.:
        if d > 0: z[8] = 1.; N = max(N, 0.)-p[Fa_]
        elif z[8] > 0 and d > -p[aL_]: N = -p[Fa_]*(1+d/p[aL_])
        else: z[8] = 0.; N = 0.
    elif N < 0 and p[sqz_] == 0.: N = 0.
    T1 = 0.; T2 = 0.
    if d > 0 and N > 0:
        v = math.sqrt(v1*v1+v2*v2); mu = p[mu_]+p[dmu_]*math.exp(-(v/p[vs_])**2)
        if p[pe_] != 0.: mu *= (N/5.)**p[pe_]
        if p[ft_] == 2.:
            w = math.sqrt(v*v+p[vr_]**2); b1 = v1/w; b2 = v2/w
        elif p[ft_] == 3.:                                # tanh rounding
            w = math.tanh(v/p[vr_])/max(v, 1e-12); b1 = v1*w; b2 = v2*w
        elif p[ft_] == 1.:                                # Dahl, exact step
            a = math.exp(-v*dt/p[bl_])
            if v > 1e-12: z[4] = v1/v+(z[4]-v1/v)*a; z[5] = v2/v+(z[5]-v2/v)*a
            b1 = z[4]; b2 = z[5]
        else:                                             # Prandtl: elastic, then slips
            z[4] += v1*dt/p[bl_]; z[5] += v2*dt/p[bl_]; a = math.sqrt(z[4]**2+z[5]**2)
            if a > 1: z[4] /= a; z[5] /= a
            b1 = z[4]; b2 = z[5]
        T1 = -mu*N*b1*(1+p[an_])-p[cv_]*v1; T2 = -mu*N*b2*(1-p[an_])-p[cv_]*v2
    else: z[4] = 0.; z[5] = 0.
    return N, T1, T2
@njit
def drive(p, t, M):
    """forces along a given motion M (n,6): d, dd, s1, s2, v1, v2"""
    n = len(t); o = np.zeros((n, 3)); z = np.zeros(9)
    for i in range(n):
        h = t[i]-t[i-1] if i > 0 else t[1]-t[0]
        o[i, 0], o[i, 1], o[i, 2] = law(z, p, h, t[i], M[i, 0], M[i, 1], M[i, 2], M[i, 3], M[i, 4], M[i, 5])
    return o
@njit
def tip(p, h, ref, off, m, K, zeta, Ki, mode, keep):
    """velocity Verlet of the tip (d, s1, s2) at rate 1/h; mode 0 impedance, 1 with integral, 2 force control in depth"""
    n = len(ref); o = np.zeros((n//keep+1, 12)); z = np.zeros(9); x = ref[0].copy(); v = np.zeros(3); a = np.zeros(3); I = np.zeros(3); j = 0
    for i in range(1, n):
        for q in range(3): v[q] += .5*h*a[q]; x[q] += h*v[q]
        vo = (off[i]-off[i-1])/h
        N, T1, T2 = law(z, p, h, i*h, x[0]+off[i, 0], v[0]+vo[0], x[1]+off[i, 1], x[2]+off[i, 2], v[1]+vo[1], v[2]+vo[2])
        for q in range(3):
            D = 2*zeta*math.sqrt(K[q]*m); e = ref[i, q]-x[q]; vr = (ref[i, q]-ref[i-1, q])/h; u = K[q]*e
            if mode == 1:
                I[q] += Ki*e*h*K[q]; u += I[q]
            if mode == 2 and q == 0 and ref[i, 0] > 0: u = p[k_]*ref[i, 0]**p[n_]+.15*K[q]*e
            F = -N if q == 0 else (T1 if q == 1 else T2)
            a[q] = (u+D*(vr-v[q])+F)/m; a[q] = min(max(a[q], -60.), 60.); v[q] += .5*h*a[q]
        if i % keep == 0:
            for q in range(3): o[j, q] = x[q]; o[j, 3+q] = v[q]; o[j, 9+q] = a[q]
            o[j, 6] = N; o[j, 7] = T1; o[j, 8] = T2; j += 1
    return o[:j]
@njit
def lowpass(y, t, tau):
    o = y.copy()
    for i in range(1, len(y)):
        a = math.exp(-(t[i]-t[i-1])/tau); o[i] = a*o[i-1]+(1-a)*y[i]
    return o
@njit
def jfriction(dq, h, kind, L):
    """sign of motion with memory; kind 0 Prandtl, 1 Dahl, 2 tanh; L in rad (0,1) or rad/s (2)"""
    o = np.zeros(dq.shape)
    for j in range(dq.shape[1]):
        z = 0.
        for i in range(dq.shape[0]):
            u = dq[i, j]*h/L
            if kind == 0: z = min(1., max(-1., z+u))
            elif kind == 1:
                s = 1. if u > 0 else -1.; z = s+(z-s)*math.exp(-abs(u))
            else: z = math.tanh(dq[i, j]/L)
            o[i, j] = z
    return o
