"""Engine of the world `dunlin`: contact laws with memory, serial chains, URDF."""
import numpy as np, math, json
from numba import njit
KEYS = ("k n c lam rr rtau rr2 rtau2 hA hL mr mL Fa aL K2 db z0 alpha iamp is0 iw mu cv dmu vs Lb vr p N0 an ftype eps "
        "runA runL C plB plY boxM boxk boxc ikind dref").split()
IX = {k: i for i, k in enumerate(KEYS)}
for _k, _i in IX.items(): globals()["I_" + _k] = _i
NS = 14

def newP(**kw):
    P = np.zeros(len(KEYS)); d = dict(k=1000., n=1., rtau=1., rtau2=1., hL=1e-3, mL=1e-3, aL=1e-3, iw=1e-2, vs=1e-2, Lb=1e-4, vr=1e-3,
                                      N0=5., runL=1., boxM=1., dref=5e-3); d.update(kw)
    for k, v in d.items(): P[IX[k]] = v
    return P

@njit(cache=True)
def law(P, S, dt, t, d0, dd, s1, s2, v1, v2):
    """one step; returns N, T1, T2 (force of material on the tool)."""
    k = P[0]*(1+P[17]*t/60.)
    if P[40] == 1.: k *= 1+P[18]*0.5*(1+math.tanh((s1-P[19])/P[20]))
    elif P[40] == 2.: k *= 1+P[18]*math.exp(-((s1-P[19])**2+s2*s2)/P[20]**2)
    N = S[12]; C = P[34]
    if P[38] > 0:                                   # sample box on springs
        ab = (max(N, 0.)-P[38]*S[10]-P[39]*S[11])/P[37]
        S[11] += ab*dt; S[10] += S[11]*dt
    base = d0+P[16]-S[10]
    nit = 6 if C > 0 else 1
    Fe = 0.; dl = base
    Nq = S[13]
    for it in range(nit):
        dl = base-C*Nq
        de = dl-S[9] if P[35] > 0 else dl
        if de > 0:
            Fe = k*de**P[1]*(1+P[31]*(de/P[41]-1))
            if P[10] > 0:
                Fe *= 1-P[10]*(1-math.exp(-max(S[4]-de, 0.)/P[11]))
            if de > P[15] and P[14] != 0: Fe += P[14]*(de-P[15])
            slope = P[1]*Fe/de
        else:
            Fe = 0.; slope = 0.
        if C > 0: Nq += (Fe-Nq)/(1+slope*C)
    S[13] = Nq
    de = dl-S[9] if P[35] > 0 else dl
    ddl = dd-S[11]
    if de > 0:
        S[5] = 1.
        if de > S[4]: S[4] = de
        if P[35] > 0:
            pl = P[35]*(dl-P[36])
            if pl > S[9]: S[9] = pl
        # relaxation branches
        dF = Fe-S[2]
        for b in range(2):
            r = P[4+2*b]; tau = P[5+2*b]
            if r > 0:
                e = math.exp(-dt/tau)
                S[b] = S[b]*e+r*dF*(1-e)*tau/dt
            else: S[b] = 0.
        S[2] = Fe
        F = Fe+S[0]+S[1]
        if P[8] != 0:
            x = (ddl*dt)
            if x != 0:
                sg = 1. if x > 0 else -1.
                S[3] = sg*P[8]+(S[3]-sg*P[8])*math.exp(-abs(x)/P[9])
            F += S[3]
        F += P[2]*ddl+P[3]*Fe*ddl
        if F < 0: F = 0.
        if P[12] > 0: F -= P[12]
    else:
        S[3] = 0.; F = 0.
        if P[4] > 0 or P[6] > 0:
            S[0] *= math.exp(-dt/P[5]); S[1] *= math.exp(-dt/P[7])
            dF = -S[2]
            S[0] += P[4]*dF; S[1] += P[6]*dF; S[2] = 0.
        if P[12] > 0 and S[5] > 0:
            if de > -P[13]: F = -P[12]*(1+de/P[13])
            else: S[5] = 0.
        else: S[5] = 0.
    N = F; S[12] = N
    # friction
    T1 = 0.; T2 = 0.; Np = max(N, 0.)
    v = math.sqrt(v1*v1+v2*v2)
    if P[21] > 0 or P[22] > 0:
        if Np > 0:
            S[8] += v*dt
            mu = P[21]
            if P[27] != 0: mu *= (max(Np, .02)/P[28])**P[27]
            ft = P[30]
            mu += P[23]*math.exp(-(v/P[24])**2)
            if ft == 2.: mu *= 1+0.04*math.exp(-(v/0.004)**2)
            if ft == 4.: mu *= 1+0.07*math.exp(-(v/0.002)**2)
            if P[32] != 0: mu *= 1-P[32]*(1-math.exp(-S[8]/P[33]))
            L = P[25]
            if ft == 3.:
                w = math.sqrt(v*v+P[26]**2); b1 = v1/w; b2 = v2/w
            else:
                if ft == 1. or ft == 4.:
                    S[6] += v1*dt; S[7] += v2*dt
                    z = math.sqrt(S[6]**2+S[7]**2)
                    if z > L: S[6] *= L/z; S[7] *= L/z
                elif v > 0:
                    e = math.exp(-v*dt/L)
                    S[6] = L*v1/v+(S[6]-L*v1/v)*e; S[7] = L*v2/v+(S[7]-L*v2/v)*e
                b1 = S[6]/L; b2 = S[7]/L
            T1 = -mu*(1+P[29])*Np*b1-P[22]*v1
            T2 = -mu*(1-P[29])*Np*b2-P[22]*v2
        else:
            S[6] = 0.; S[7] = 0.
    return N, T1, T2

@njit(cache=True)
def drive_law(P, t, d, dd, s1, s2, v1, v2):
    n = len(t); S = np.zeros(14); O = np.zeros((n, 3))
    for i in range(n):
        dt = t[i]-t[i-1] if i > 0 else t[1]-t[0]
        O[i, 0], O[i, 1], O[i, 2] = law(P, S, dt, t[i], d[i], dd[i], s1[i], s2[i], v1[i], v2[i])
    return O

@njit(cache=True)
def sim_contact(P, xc, toff, fr, nsub, m, Kn, Kt, zeta):
    """impedance-controlled tip (s1,s2,height); commands at fr, nsub substeps."""
    n = len(xc); X = np.zeros((n, 3)); V = np.zeros((n, 3)); A = np.zeros((n, 3)); O = np.zeros((n, 3))
    S = np.zeros(14); x = xc[0].copy(); v = np.zeros(3); a = np.zeros(3); dt = 1./(fr*nsub)
    K = np.array([Kt, Kt, Kn])
    f = np.zeros(3); tv = np.zeros(3)
    for i in range(n):
        i1 = min(i+1, n-1)
        for j in range(nsub):
            u = j/nsub
            for c in range(3): tv[c] = (toff[i1, c]-toff[i, c])*fr
            f[2], f[0], f[1] = law(P, S, dt, (i+u)/fr, -x[2]-toff[i, 2]-tv[2]*u/fr, -v[2]-tv[2], x[0]+toff[i, 0], x[1]+toff[i, 1], v[0]+tv[0], v[1]+tv[1])
            for c in range(3):
                xcc = xc[i, c]*(1-u)+xc[i1, c]*u; vcc = (xc[i1, c]-xc[i, c])*fr
                a[c] = (K[c]*(xcc-x[c])+2*zeta*math.sqrt(K[c]*m)*(vcc-v[c])+f[c])/m
            if j == 0:
                X[i] = x; V[i] = v; A[i] = a; O[i, 0] = f[2]; O[i, 1] = f[0]; O[i, 2] = f[1]
            for c in range(3):
                v[c] += a[c]*dt; x[c] += v[c]*dt
    return X, V, A, O

@njit(cache=True)
def rotax(a, th):
    c = math.cos(th); s = math.sin(th); R = np.zeros((3, 3)); C = 1-c
    x, y, z = a[0], a[1], a[2]
    R[0, 0] = c+x*x*C; R[0, 1] = x*y*C-z*s; R[0, 2] = x*z*C+y*s
    R[1, 0] = y*x*C+z*s; R[1, 1] = c+y*y*C; R[1, 2] = y*z*C-x*s
    R[2, 0] = z*x*C-y*s; R[2, 1] = z*y*C+x*s; R[2, 2] = c+z*z*C
    return R

@njit(cache=True)
def fkjac(off, ax, tip, Rs, q):
    nj = len(q); p = np.zeros(3); R = np.eye(3); J = np.zeros((6, nj)); pj = np.zeros((nj, 3)); aj = np.zeros((nj, 3))
    for i in range(nj):
        p = p+R@off[i]; pj[i] = p; aj[i] = R@ax[i]
        R = R@rotax(ax[i], q[i])
    R = R@Rs
    pt = p+R@tip
    for i in range(nj):
        r = pt-pj[i]; a = aj[i]
        J[0, i] = a[1]*r[2]-a[2]*r[1]; J[1, i] = a[2]*r[0]-a[0]*r[2]; J[2, i] = a[0]*r[1]-a[1]*r[0]
        J[3, i] = a[0]; J[4, i] = a[1]; J[5, i] = a[2]
    return pt, R, J

@njit(cache=True)
def fk_all(off, ax, tip, Rs, Q):
    n = len(Q); p = np.zeros((n, 3)); R = np.zeros((n, 3, 3))
    for i in range(n):
        a, b, c = fkjac(off, ax, tip, Rs, Q[i]); p[i] = a; R[i] = b
    return p, R

@njit(cache=True)
def ik_all(off, ax, tip, Rs, pd, Rd, vd, wd, q0):
    n = len(pd); nj = len(q0); Q = np.zeros((n, nj)); dQ = np.zeros((n, nj)); q = q0.copy(); e = np.zeros(6); worst = 0.
    for i in range(n):
        for it in range(60):
            p, R, J = fkjac(off, ax, tip, Rs, q)
            E = Rd[i]@R.T
            e[:3] = pd[i]-p
            e[3] = 0.5*(E[2, 1]-E[1, 2]); e[4] = 0.5*(E[0, 2]-E[2, 0]); e[5] = 0.5*(E[1, 0]-E[0, 1])
            err = np.sqrt(np.sum(e*e))
            G = J@J.T
            for c in range(6): G[c, c] += 1e-7
            if err < 1e-9: break
            q = q+J.T@np.linalg.solve(G, e)
        if err > worst: worst = err
        Q[i] = q
        e[:3] = vd[i]; e[3:] = wd[i]
        dQ[i] = J.T@np.linalg.solve(G, e)
    return Q, dQ, worst

# ---------------------------------------------------------------- robots
def lwr(rng):
    I = json.load(open(__file__.rsplit("/", 1)[0]+"/lwr4plus_inertia.json"))
    off = np.array([[0, 0, z] for z in (.11, .2005, .20, .20, .20, .19, .078)])
    # link 7 frame sits at the flange as in the CENTRO family
    ax = np.array([[0, 0, 1], [0, -1, 0], [0, 0, 1], [0, 1, 0], [0, 0, 1], [0, -1, 0], [0, 0, 1.]])
    q0 = np.radians([rng.uniform(-40, 40), -rng.uniform(22, 38), rng.uniform(-12, 12), rng.uniform(65, 90), rng.uniform(-10, 10), 0, rng.uniform(-50, 50)])
    q0[5] = -(math.pi-(-q0[1])-q0[3])+rng.uniform(-.1, .1)
    return dict(name="lwr4plus", off=off, ax=ax, inert=I, q0=q0, Kj=np.array([1e4]*5+[7.5e3]*2),
                Fc=np.array([1.2, 1.1, .8, .8, .5, .35, .3]), Fv=np.array([.9, .9, .6, .6, .4, .3, .25]), rotor=np.array([.9, .9, .51, .51, .2, .13, .13]), tn=np.array([.07, .07, .04, .04, .04, .015, .015]))

def own(rng):
    l2, l3 = rng.uniform(.36, .46), rng.uniform(.32, .40)
    off = np.array([[0, 0, .16], [.05, 0, .14], [0, 0, l2], [.02, 0, l3/2], [0, 0, l3/2], [0, 0, .085]])
    ax = np.array([[0, 0, 1], [0, 1, 0], [0, 1, 0], [0, 0, 1], [0, 1, 0], [0, 0, 1.]])
    ms = np.array([6.2, 7.4, 3.9, 2.1, 1.3, .5])*rng.uniform(.85, 1.2)
    Ls = [.14, l2, l3/2, l3/2, .085, .03]; rs = [.07, .055, .05, .042, .038, .035]
    I = []
    for m, L, r in zip(ms, Ls, rs):
        ixx = m*(3*r*r+L*L)/12; I.append(dict(m=float(m), com=[float(rng.uniform(-.01, .01)), float(rng.uniform(-.02, .02)), float(L*rng.uniform(.35, .5))], I=[ixx, ixx, m*r*r/2, 0, 0, 0]))
    q2, q3 = rng.uniform(.1, .5), rng.uniform(1.0, 1.5)
    q0 = np.array([rng.uniform(-.6, .6), q2, q3, rng.uniform(-.15, .15), math.pi-q2-q3+rng.uniform(-.1, .1), rng.uniform(-.8, .8)])
    return dict(name="dunlin6", off=off, ax=ax, inert=I, q0=q0, Kj=np.array([1.2e4, 1.2e4, 8e3, 4e3, 3e3, 3e3]),
                Fc=np.array([3., 4., 2.5, 1.2, .8, .6]), Fv=np.array([3.5, 4., 2.5, .9, .6, .5]), rotor=np.array([.8, .9, .45, .15, .1, .08]), tn=np.array([.12, .12, .08, .04, .03, .03]))

def urdf(arm, ps, yaw, tip):
    def inert(m, c, I): return ('<inertial><origin xyz="%.9g %.9g %.9g" rpy="0 0 0"/><mass value="%.9g"/><inertia ixx="%.9g" iyy="%.9g" izz="%.9g" ixy="%.9g" ixz="%.9g" iyz="%.9g"/></inertial>' % (*c, m, *I))
    s = ['<?xml version="1.0"?>', '<robot name="%s">' % arm["name"], '<link name="base_link"/>']
    nj = len(arm["ax"])
    for i in range(nj):
        d = arm["inert"][i]
        s.append('<link name="link_%d">%s</link>' % (i+1, inert(d["m"], d["com"], d["I"])))
        s.append('<joint name="joint_%d" type="revolute"><parent link="%s"/><child link="link_%d"/><origin xyz="%.9g %.9g %.9g" rpy="0 0 0"/><axis xyz="%g %g %g"/><limit lower="-2.97" upper="2.97" effort="200" velocity="3"/></joint>'
                 % (i+1, "base_link" if i == 0 else "link_%d" % i, i+1, *arm["off"][i], *arm["ax"][i]))
    s.append('<link name="ft_sensor"/><joint name="j_ft" type="fixed"><parent link="link_%d"/><child link="ft_sensor"/><origin xyz="0 0 %.9g" rpy="0 0 %.9g"/></joint>' % (nj, ps, yaw))
    s.append('<link name="tool_tip"/><joint name="j_tip" type="fixed"><parent link="ft_sensor"/><child link="tool_tip"/><origin xyz="%.9g %.9g %.9g" rpy="0 0 0"/></joint>' % tuple(tip))
    s.append('</robot>'); return "\n".join(s)+"\n"
