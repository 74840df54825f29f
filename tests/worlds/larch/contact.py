"""Contact truth: a bed of ring springs under a finite tip (normal), distributed elasto-plastic / LuGre bristles (tangential)."""
import numpy as np
from numba import njit
NR = 12
NAMES = ["m", "c", "lam", "r1", "tau1", "r2", "tau2", "hysA", "hysL", "mulR", "mulL", "adhF", "adhL", "layK", "layD", "layW", "drift",
         "inhA", "inhX", "inhY", "inhR", "inhW", "inhG", "mu", "kind", "L", "vr", "dmu", "vs", "cv", "pl", "N0", "ani", "texA", "texL",
         "punD", "punR", "comp", "compT", "vibA", "vibF", "s1", "wallK", "punO"]
IX = {k: i for i, k in enumerate(NAMES)}
for _k, _i in IX.items(): globals()["P_"+_k] = _i
P_m=IX["m"]; P_c=IX["c"]; P_lam=IX["lam"]; P_r1=IX["r1"]; P_t1=IX["tau1"]; P_r2=IX["r2"]; P_t2=IX["tau2"]
P_hysA=IX["hysA"]; P_hysL=IX["hysL"]; P_mulR=IX["mulR"]; P_mulL=IX["mulL"]; P_adhF=IX["adhF"]; P_adhL=IX["adhL"]
P_layK=IX["layK"]; P_layD=IX["layD"]; P_layW=IX["layW"]; P_drift=IX["drift"]
P_inhA=IX["inhA"]; P_inhX=IX["inhX"]; P_inhY=IX["inhY"]; P_inhR=IX["inhR"]; P_inhW=IX["inhW"]; P_inhG=IX["inhG"]
P_mu=IX["mu"]; P_kind=IX["kind"]; P_L=IX["L"]; P_vr=IX["vr"]; P_dmu=IX["dmu"]; P_vs=IX["vs"]; P_cv=IX["cv"]; P_pl=IX["pl"]; P_N0=IX["N0"]
P_ani=IX["ani"]; P_texA=IX["texA"]; P_texL=IX["texL"]; P_punD=IX["punD"]; P_punR=IX["punR"]; P_comp=IX["comp"]; P_compT=IX["compT"]
P_vibA=IX["vibA"]; P_vibF=IX["vibF"]; P_s1=IX["s1"]
# state: 0 Fe_prev, 1,2 branches, 3..5 hysteresis, 6 bond, 7 puncture, 8 compliance u, 9.. bristles 2x4, 20.. ring maxima
NS = 20+NR

def params(**k):
    P = np.zeros(len(NAMES)); P[IX["m"]] = 0.; P[IX["tau1"]] = 1; P[IX["tau2"]] = 1; P[IX["hysL"]] = 1; P[IX["mulL"]] = 1; P[IX["adhL"]] = 1e-3
    P[IX["layW"]] = 1e-4; P[IX["inhR"]] = 1; P[IX["inhW"]] = 1; P[IX["L"]] = 1e-4; P[IX["vr"]] = 2e-4; P[IX["vs"]] = 1; P[IX["N0"]] = 1
    P[IX["texL"]] = 1; P[IX["compT"]] = 1e-3; P[IX["punD"]] = 1e3
    for a, b in k.items(): P[IX[a]] = b
    return P

def bed(n, k, off, dref):
    """Rings: gaps G and weights W so that the sum of W (d-G)^m is near k d^n. off: how far from exact (0..1) through edge rounding/finite tip.
    n=1: a flat punch with an edge radius (m=0+1); n>1: a paraboloid, element exponent m=1 for n=2, m=n-1 in general, cut at a finite radius."""
    if n == 1:
        m = 1.0; G = np.zeros(NR); nr = 4
        G[-nr:] = off*dref*.12*(np.arange(1, nr+1)/nr)**2; W = np.full(NR, 1./NR)
    else:
        m = n-1.0; e = (np.arange(NR)+.5)/NR            # equal-area rings out to gap (1+..)dref ; F ~ int (d-g)^m dg
        top = dref*(1.25-.40*off)                        # finite tip: beyond this depth the contact no longer widens
        G = top*e; W = np.full(NR, 1.)
        G = top*e**1.0
    F = np.sum(W*np.maximum(dref-G, 0)**m)
    return G, W*(k*dref**n/F), m

@njit(cache=True, error_model="numpy", fastmath=True)
def law(P, S, G, W, dgeo, dd, x, y, vx, vy, t, dt):
    d = dgeo-S[8]
    if P[P_vibA] != 0.0:
        d += P[P_vibA]*np.sin(6.283185307*P[P_vibF]*t)
        dd = dd+P[P_vibA]*6.283185307*P[P_vibF]*np.cos(6.283185307*P[P_vibF]*t)
    kf = 1.0+P[P_drift]*t/60.0+P[P_inhG]*x
    if P[P_inhA] != 0.0:
        rr = np.sqrt((x-P[P_inhX])**2+(y-P[P_inhY])**2)
        kf += P[P_inhA]*0.5*(1.0-np.tanh((rr-P[P_inhR])/P[P_inhW]))
    Fe = 0.0; ws = 0.0; wt = 0.0
    m = P[P_m]
    n = G.shape[0]
    for j in range(n):
        dj = d-G[j]; wt += W[j]
        if dj > 0:
            f = W[j]*(dj if m == 1.0 else dj**m); ws += W[j]
            if P[P_mulR] != 0.0:
                if dj > S[20+j]: S[20+j] = dj
                else: f *= 1.0-P[P_mulR]*(1.0-np.exp(-(S[20+j]-dj)/P[P_mulL]))
            Fe += f
    Fe *= kf
    if P[P_layK] != 0.0:
        w = P[P_layW]; u = (d-P[P_layD])/w
        if u > 20: Fe += P[P_layK]*(d-P[P_layD])
        elif u > -20: Fe += P[P_layK]*w*np.log1p(np.exp(u))
    if d > P[P_punD]: S[7] = min(1.0, S[7]+dt/0.006)
    if d < 0: S[7] = max(0.0, S[7]-dt/0.2)
    Fe *= 1.0-P[P_punR]*S[7]
    area = min(1.0, 20.0*ws/wt)         # share of the bed that touches, full once a twentieth does
    N = Fe+P[P_c]*dd*area+P[P_lam]*Fe*dd
    dF = Fe-S[0]; S[0] = Fe
    if P[P_r1] != 0.0:
        S[1] += P[P_r1]*dF-S[1]*dt/P[P_t1]
        S[2] += P[P_r2]*dF-S[2]*dt/P[P_t2]
        N += S[1]+S[2]
    if P[P_hysA] != 0.0:
        if d <= 0:
            S[3] = 0.0; S[4] = 0.0; S[5] = 0.0
        else:
            z = 0.0
            for i in range(3):
                L = P[P_hysL]*(0.5+0.5*i)
                v = S[3+i]+dd*dt
                v = min(L, max(-L, v)); S[3+i] = v; z += v/L/3.0
            N += P[P_hysA]*z*area
    if P[P_adhF] != 0.0:
        if d > 0: S[6] = 1.0
        elif d < -P[P_adhL]: S[6] = 0.0
        if S[6] > 0:
            if d > 0: N = N-P[P_adhF]*min(1.0, d/2e-5)
            else: N = -P[P_adhF]*np.sqrt(max(0.0, 1.0+d/P[P_adhL]))
        else: N = 0.0
    else:
        if N < 0 or d <= 0: N = 0.0
    # compliance behind the tip
    if P[P_comp] != 0.0:
        a = dt/P[P_compT]
        S[8] += a*(P[P_comp]*N-S[8])
    Ne = max(N, 0.0)
    v = np.sqrt(vx*vx+vy*vy)
    mu = P[P_mu]
    if Ne > 0 and P[P_pl] != 0.0: mu *= (Ne/P[P_N0])**P[P_pl]
    str_ = P[P_dmu]*np.exp(-(v/P[P_vs])**2)
    mu += str_
    mu *= 1.0+P[P_texA]*np.sin(6.283185307*x/P[P_texL])
    sx = 0.0; sy = 0.0
    k = int(P[P_kind]); L = P[P_L]
    if Ne <= 0:
        for i in range(8): S[9+i] = 0.0
    elif k == 0:      # Prandtl: four elasto-plastic bristles of different length
        for i in range(4):
            Li = L*(0.4+0.4*i)
            a = S[9+2*i]+vx*dt; b = S[10+2*i]+vy*dt
            r = np.sqrt(a*a+b*b)
            if r > Li: a *= Li/r; b *= Li/r
            S[9+2*i] = a; S[10+2*i] = b
            sx += 0.25*a/Li; sy += 0.25*b/Li
    elif k == 3:      # rounded
        r = np.sqrt(v*v+P[P_vr]**2); sx = vx/r; sy = vy/r
    else:             # Dahl (1) / LuGre (2: with bristle damping) in strain form
        a = S[9]; b = S[10]
        da = vx-v*a/L; db = vy-v*b/L
        S[9] = a+da*dt; S[10] = b+db*dt
        sx = S[9]/L; sy = S[10]/L
        if k == 2:
            sx += P[P_s1]*da*np.exp(-(v/0.01)**2); sy += P[P_s1]*db*np.exp(-(v/0.01)**2)
    gate = min(1.0, Ne/0.2)
    Tx = -Ne*mu*(1+P[P_ani])*sx-P[P_cv]*vx*gate
    Ty = -Ne*mu*(1-P[P_ani])*sy-P[P_cv]*vy*gate
    return N, Tx, Ty
