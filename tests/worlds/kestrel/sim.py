"""Own simulation: serial arms by recursive Newton-Euler, semi-implicit Euler; contact by a bed of elements
(dimensionality reduction) with Maxwell branches; tangential elasto-plastic / Dahl bristles in parallel (generalised Maxwell slip)."""
import json, os
import numpy as np
from numba import njit

# ---------------------------------------------------------------- arms
def arm_lwr():
    I = json.load(open(os.path.join(os.path.dirname(os.path.abspath(__file__)), os.pardir, 'foundry', 'lwr4plus_inertia.json')))
    p = np.array([[0, 0, z] for z in (.11, .2005, .2, .2, .2, .19, .078)], float)
    ax = np.array([[0, 0, 1], [0, -1, 0], [0, 0, 1], [0, 1, 0], [0, 0, 1], [0, -1, 0], [0, 0, 1]], float)
    m = np.array([l['m'] for l in I]); c = np.array([l['com'] for l in I], float)
    In = []
    for l in I:
        xx, yy, zz, xy, xz, yz = l['I']
        In.append([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    return dict(name='lwr4', p=p, ax=ax, m=m, c=c, I=np.array(In), rotor=np.array([.9, .9, .51, .51, .2, .13, .13]),
                q0=np.array([0.15, .55, .1, -1.25, -.12, 1.34, .2]), flange=np.zeros(3),
                vis=np.array([6., 6, 4, 4, 2, 1, 1]), fc=np.array([5., 5, 3.5, 3.5, 2.5, 1.5, 1.5]))

def rod(m, L, r):
    a = m * (3 * r * r + L * L) / 12; b = m * r * r / 2
    return np.diag([a, a, b])

def arm_kestrel():
    p = np.array([[0, 0, .16], [0, 0, .17], [0, 0, .42], [0, 0, .15], [0, 0, .24], [0, 0, .07]], float)
    ax = np.array([[0, 0, 1], [0, 1, 0], [0, 1, 0], [0, 0, 1], [0, 1, 0], [0, 0, 1]], float)
    m = np.array([5.2, 7.4, 4.1, 2.3, 1.5, .55])
    c = np.array([[0, .01, .08], [0, -.02, .2], [0.005, .01, .07], [0, 0, .11], [0, .006, .03], [0, 0, .012]])
    I = np.array([rod(5.2, .2, .07), rod(7.4, .45, .06), rod(4.1, .2, .055), rod(2.3, .24, .045), rod(1.5, .1, .04), rod(.55, .03, .035)])
    return dict(name='kestrel6', p=p, ax=ax, m=m, c=c, I=I, rotor=np.array([1.4, 1.6, .8, .25, .2, .12]),
                q0=np.array([-.3, .35, 1.45, .1, 1.3, -.2]), flange=np.array([0, 0, .035]),
                vis=np.array([7., 8, 5, 2, 1.5, 1.]), fc=np.array([7., 8, 5, 2.2, 1.8, 1.2]))

def write_urdf(arm, sens, yaw, tip, path):
    """sens: xyz of ft_sensor from the flange, yaw its turn, tip: xyz of tool_tip in the sensor frame."""
    s = [f'<?xml version="1.0"?>\n<robot name="{arm["name"]}">', ' <link name="base_link"/>']
    par = 'base_link'
    n = len(arm['m'])
    for i in range(n):
        I = arm['I'][i]
        s.append(f' <link name="link_{i+1}"><inertial><origin xyz="{arm["c"][i][0]} {arm["c"][i][1]} {arm["c"][i][2]}" rpy="0 0 0"/><mass value="{arm["m"][i]}"/>'
                 f'<inertia ixx="{I[0,0]}" ixy="{I[0,1]}" ixz="{I[0,2]}" iyy="{I[1,1]}" iyz="{I[1,2]}" izz="{I[2,2]}"/></inertial></link>')
        p, a = arm['p'][i], arm['ax'][i]
        s.append(f' <joint name="joint_{i+1}" type="revolute"><parent link="{par}"/><child link="link_{i+1}"/><origin xyz="{p[0]} {p[1]} {p[2]}" rpy="0 0 0"/>'
                 f'<axis xyz="{a[0]:g} {a[1]:g} {a[2]:g}"/><limit lower="-6.2" upper="6.2" effort="300" velocity="4"/></joint>')
        par = f'link_{i+1}'
    for name, p, y in (('flange', arm['flange'], 0.), ('ft_sensor', sens, yaw), ('tool_tip', tip, 0.)):
        s.append(f' <link name="{name}"/>')
        s.append(f' <joint name="{name}_joint" type="fixed"><parent link="{par}"/><child link="{name}"/><origin xyz="{p[0]} {p[1]} {p[2]}" rpy="0 0 {y}"/></joint>')
        par = name
    s.append('</robot>\n')
    open(path, 'w').write('\n'.join(s))

# ---------------------------------------------------------------- rigid body
@njit(cache=True)
def rodr(a, q):
    s, c = np.sin(q), np.cos(q); v = 1 - c
    R = np.empty((3, 3)); x, y, z = a[0], a[1], a[2]
    R[0, 0] = c + x*x*v; R[0, 1] = x*y*v - z*s; R[0, 2] = x*z*v + y*s
    R[1, 0] = y*x*v + z*s; R[1, 1] = c + y*y*v; R[1, 2] = y*z*v - x*s
    R[2, 0] = z*x*v - y*s; R[2, 1] = z*y*v + x*s; R[2, 2] = c + z*z*v
    return R

@njit(cache=True)
def mm(A, B):
    C = np.empty((3, 3))
    for i in range(3):
        for j in range(3):
            C[i, j] = A[i, 0]*B[0, j] + A[i, 1]*B[1, j] + A[i, 2]*B[2, j]
    return C

@njit(cache=True)
def mv(A, b):
    r = np.empty(3)
    for i in range(3): r[i] = A[i, 0]*b[0] + A[i, 1]*b[1] + A[i, 2]*b[2]
    return r

@njit(cache=True)
def mtv(A, b):
    r = np.empty(3)
    for i in range(3): r[i] = A[0, i]*b[0] + A[1, i]*b[1] + A[2, i]*b[2]
    return r

@njit(cache=True)
def cr(a, b):
    r = np.empty(3)
    r[0] = a[1]*b[2] - a[2]*b[1]; r[1] = a[2]*b[0] - a[0]*b[2]; r[2] = a[0]*b[1] - a[1]*b[0]
    return r

@njit(cache=True)
def fk(q, p, ax):
    n = q.size
    O = np.empty((n, 3)); Z = np.empty((n, 3)); R = np.empty((n, 3, 3))
    Rc = np.eye(3); o = np.zeros(3)
    for i in range(n):
        o = o + mv(Rc, p[i]); Z[i] = mv(Rc, ax[i]); Rc = mm(Rc, rodr(ax[i], q[i]))
        O[i] = o; R[i] = Rc
    return O, Z, R

@njit(cache=True)
def rne(dq, ddq, O, Z, C, Iw, m, g):
    n = dq.size
    W = np.zeros((n, 3)); F = np.zeros((n, 3)); N = np.zeros((n, 3)); tau = np.zeros(n)
    w = np.zeros(3); al = np.zeros(3); a = -g.copy(); op = np.zeros(3)
    for i in range(n):
        r = O[i] - op
        a = a + cr(al, r) + cr(w, cr(w, r))
        al = al + Z[i]*ddq[i] + cr(w, Z[i])*dq[i]
        w = w + Z[i]*dq[i]
        rc = C[i] - O[i]
        ac = a + cr(al, rc) + cr(w, cr(w, rc))
        F[i] = m[i]*ac
        N[i] = mv(Iw[i], al) + cr(w, mv(Iw[i], w))
        op = O[i].copy()
    f = np.zeros(3); nn = np.zeros(3)
    for k in range(n):
        i = n - 1 - k
        if i < n - 1: nn = nn + cr(O[i+1] - O[i], f)
        f = f + F[i]
        nn = nn + N[i] + cr(C[i] - O[i], F[i])
        tau[i] = Z[i] @ nn
    return tau

@njit(cache=True)
def bodies(q, p, ax, c, I):
    O, Z, R = fk(q, p, ax)
    n = q.size
    C = np.empty((n, 3)); Iw = np.empty((n, 3, 3))
    for i in range(n):
        C[i] = O[i] + mv(R[i], c[i]); Iw[i] = mm(mm(R[i], I[i]), R[i].T.copy())
    return O, Z, R, C, Iw

@njit(cache=True)
def massmat(O, Z, C, Iw, m):
    n = m.size
    M = np.zeros((n, n))
    # composite from the tip: rigid subtree moved by one joint
    for i in range(n):
        for k in range(n - 1, i - 1, -1):
            ai = cr(Z[i], C[k] - O[i]); Li = mv(Iw[k], Z[i])
            for j in range(i, k + 1):
                aj = cr(Z[j], C[k] - O[j])
                M[i, j] += m[k]*(ai[0]*aj[0] + ai[1]*aj[1] + ai[2]*aj[2]) + Li[0]*Z[j, 0] + Li[1]*Z[j, 1] + Li[2]*Z[j, 2]
    for i in range(n):
        for j in range(i): M[i, j] = M[j, i]
    return M

@njit(cache=True)
def id_series(q, dq, ddq, p, ax, m, c, I, g):
    T, n = q.shape
    out = np.empty((T, n))
    for k in range(T):
        O, Z, R, C, Iw = bodies(q[k], p, ax, c, I)
        out[k] = rne(dq[k], ddq[k], O, Z, C, Iw, m, g)
    return out

# ---------------------------------------------------------------- contact: P is a parameter row
NAMES = ['off', 'mamp', 'mfreq', 'C', 'cv', 'lam', 'r1', 't1', 'r2', 't2', 'mull', 'mulllen', 'hA', 'hL', 'Fa', 'La', 'K2', 'd2',
         'drift', 'iamp', 'ix', 'iy', 'iw', 'itype', 'mu', 'mvis', 'dmu', 'vs', 'p', 'N0', 'an', 'len', 'ep', 'vround', 'muamp', 'muL', 'sig1', 'spread']
IX = {k: i for i, k in enumerate(NAMES)}
(OFF, MAMP, MFREQ, CC, CV, LAM, R1, T1, R2, T2, MULL, MULLL, HA, HL, FA, LA, K2, D2, DRIFT, IAMP, IXX, IYY, IW, ITYPE, MU, MVIS, DMU, VS,
 PP, N0, AN, LEN, EP, VROUND, MUAMP, MUL, SIG1, SPREAD) = range(len(NAMES))

def params(**kw):
    P = np.zeros(len(NAMES)); P[T1] = 1; P[T2] = 1; P[HL] = 1e-3; P[LA] = 1e-3; P[MULLL] = 1e-3; P[IW] = .01; P[VS] = .01; P[N0] = 1; P[LEN] = 1e-4; P[MUL] = 1; P[D2] = 1
    P[MFREQ] = 1; P[SPREAD] = .1
    for k, v in kw.items(): P[IX[k]] = v
    return P

def bed_sphere(K, R, n=90, dmax=.012):
    """MDR of a ball: F = K d^1.5; 1-D profile x^2/R, element E*dx."""
    xm = np.sqrt(R*dmax); x = (np.arange(n) + .5)/n*xm
    Es = K/(4/3*np.sqrt(R))
    return x*x/R, np.full(n, 2*Es*xm/n)

def bed_flat(k, n=40, edge=2e-5):
    g = np.linspace(0, 1, n)**4*edge
    return g, np.full(n, k/n)

def bed_power(k, nexp, n=90, dmax=.012):
    """elements whose touching depths are spread so that F = k d^n, n > 1"""
    e = np.linspace(0, 1, n + 1)**2*dmax; mid = (e[1:] + e[:-1])/2
    # sum ke (d-g)+ = k d^n  ->  density k n (n-1) g^(n-2)
    ke = k*nexp*(e[1:]**(nexp-1) - e[:-1]**(nexp-1))
    return mid, ke

@njit(cache=True)
def contact(d, dd, x, y, vx, vy, t, dt, P, S, g, ke, B):
    # S: 0 touched, 1 dmax, 2-3 hysteresis, 4 N before, 5.. 8 bristles (4x2)
    w = 2*np.pi*P[MFREQ]
    d = d + P[OFF] + P[MAMP]*(np.sin(w*t) + .35*np.sin(2*w*t + .7)); dd = dd + P[MAMP]*w*(np.cos(w*t) + .7*np.cos(2*w*t + .7))
    de = d - P[CC]*S[4]
    F = 0.
    if de > 0: S[0] = 1.
    if de > S[1]: S[1] = de
    h = 1 + P[DRIFT]*t/60
    if P[ITYPE] == 1: h *= 1 + P[IAMP]*np.exp(-((x-P[IXX])**2 + (y-P[IYY])**2)/P[IW]**2)
    if P[ITYPE] == 2: h *= 1 + P[IAMP]*np.tanh((x-P[IXX])/P[IW])
    soft = 1 - P[MULL]*(1 - np.exp(-max(0., S[1]-de)/P[MULLL]))
    e1 = np.exp(-dt/P[T1]); e2 = np.exp(-dt/P[T2])
    for i in range(g.size):
        u = de - g[i]
        if u > 0:
            k = ke[i]*h
            f = k*u*soft + B[i, 0] + B[i, 1]
            if P[R1] > 0: B[i, 0] = (B[i, 0] + P[R1]*k*(u - B[i, 2]))*e1
            if P[R2] > 0: B[i, 1] = (B[i, 1] + P[R2]*k*(u - B[i, 2]))*e2
            B[i, 2] = u
            f = f*(1 + P[LAM]*dd) + P[CV]*k*dd
            if f > 0: F += f
        else:
            B[i, 0] *= e1; B[i, 1] *= e2; B[i, 2] = 0.
    if de > P[D2]: F += P[K2]*(de - P[D2])
    if P[HA] > 0:
        if de > 0:
            for j in range(2):
                L = P[HL]*(.75 if j == 0 else 1.25)
                dc_ = 1 - np.exp(-abs(dd)*dt/L); S[2+j] += np.sign(dd)*L*dc_ - dc_*S[2+j]
                F += P[HA]*.5*S[2+j]/L
            if F < 0: F = 0.
        else: S[2] = 0.; S[3] = 0.
    if P[FA] > 0 and S[0] > 0:
        if de >= 0: F -= P[FA]*(1 if S[1] > 5e-5 else S[1]/5e-5)
        elif de > -P[LA]: F -= P[FA]*(1 + de/P[LA])
        else: S[0] = 0.; S[1] = 0. if P[MULL] == 0 else S[1]
    S[4] = F
    N = F if F > 0 else 0.
    Tx = 0.; Ty = 0.
    if N > 0 and P[MU] > 0:
        v = np.sqrt(vx*vx + vy*vy)
        mu = P[MU]*(N/P[N0])**P[PP] + P[DMU]*np.exp(-(v/P[VS])**2)
        mu *= 1 + P[MUAMP]*np.sin(2*np.pi*x/P[MUL])
        zx = 0.; zy = 0.
        if P[VROUND] > 0:
            r = np.sqrt(v*v + P[VROUND]**2); zx = vx/r; zy = vy/r
        else:
            for j in range(4):
                L = P[LEN]*(1 + P[SPREAD]*(j-1.5))
                a = S[5+2*j]/L; b = S[6+2*j]/L
                z = np.sqrt(a*a + b*b)
                al = 1.
                if P[EP] > 0:
                    if z < P[EP] or a*vx + b*vy < 0: al = 0.
                    elif z < 1: al = .5*np.sin(np.pi*(z - (1+P[EP])/2)/(1-P[EP])) + .5
                r_ = v*dt/L*al
                dec = 1 - np.exp(-r_); gn = dec/r_ if r_ > 1e-9 else 1.
                S[5+2*j] += vx*dt*gn - dec*S[5+2*j]; S[6+2*j] += vy*dt*gn - dec*S[6+2*j]
                zx += .25*S[5+2*j]/L; zy += .25*S[6+2*j]/L
        Tx = -mu*N*(1+P[AN])*zx - P[SIG1]*N*vx; Ty = -mu*N*(1-P[AN])*zy - P[SIG1]*N*vy
    else:
        for j in range(8): S[5+j] = 0.
    if de > 0: Tx -= P[MVIS]*vx; Ty -= P[MVIS]*vy
    return F, Tx, Ty

@njit(cache=True)
def press(t, d, dd, x, v, P, g, ke):
    n = t.size
    out = np.zeros((n, 2)); S = np.zeros(13); B = np.zeros((g.size, 3))
    for i in range(1, n):
        F, Tx, Ty = contact(d[i], dd[i], x[i], 0., v[i], 0., t[i], t[i]-t[i-1], P, S, g, ke, B)
        out[i, 0] = F; out[i, 1] = Tx
    return out

@njit(cache=True)
def rotlog(R):
    v = np.empty(3)
    v[0] = R[2, 1]-R[1, 2]; v[1] = R[0, 2]-R[2, 0]; v[2] = R[1, 0]-R[0, 1]
    s = .5*np.sqrt(v @ v); c = .5*(R[0, 0]+R[1, 1]+R[2, 2]-1)
    an = np.arctan2(s, c)
    if s < 1e-12: return .5*v
    return v*(an/(2*s))

@njit(cache=True)
def ik_path(q0, pos, Rd, p, ax, Rs, ptool):
    """damped least squares along a path; Rs: turn from last link to the sensor/tip frame; ptool: tip in last link"""
    T = pos.shape[0]; n = q0.size
    out = np.empty((T, n)); q = q0.copy()
    for k in range(T):
        for it in range(12 if k == 0 else 4):
            O, Z, R = fk(q, p, ax)
            pt = O[n-1] + mv(R[n-1], ptool); Rt = mm(R[n-1], Rs)
            e = np.empty(6); e[:3] = pos[k]-pt; e[3:] = rotlog(mm(Rd[k], Rt.T.copy()))
            J = np.empty((6, n))
            for j in range(n):
                J[:3, j] = cr(Z[j], pt-O[j]); J[3:, j] = Z[j]
            A = J @ J.T + 1e-7*np.eye(6)
            dqv = J.T @ np.linalg.solve(A, e)
            q = q + dqv
            if np.abs(dqv).max() < 1e-11: break
        out[k] = q
    return out

@njit(cache=True)
def run(qr, dqr, dt, p, ax, m, c, I, rotor, vis, grav, mode, Kq, Dq, Kc, ptool, ptrue, Rs, sp, sn, st, P, g, ke):
    """closed loop. mode 0 joint impedance, 1 Cartesian impedance about the reference. m, c, I hold the tool in the last link."""
    T, n = qr.shape
    Q = np.empty((T, n)); V = np.empty((T, n)); FC = np.zeros((T, 3)); TAU = np.zeros((T, n)); DEP = np.zeros((T, 3))
    q = qr[0].copy(); dq = np.zeros(n)
    S = np.zeros(13); B = np.zeros((g.size, 3))
    s2 = cr(sn, st)
    for k in range(T):
        O, Z, R, C, Iw = bodies(q, p, ax, c, I)
        pt = O[n-1] + mv(R[n-1], ptrue)
        J = np.empty((6, n))
        for j in range(n):
            J[:3, j] = cr(Z[j], pt-O[j]); J[3:, j] = Z[j]
        v = J[:3] @ dq
        r = pt - sp
        d = -(r @ sn); dd = -(v @ sn)
        x = r @ st; y = r @ s2
        F, Tx, Ty = contact(d, dd, x, y, v @ st, v @ s2, k*dt, dt, P, S, g, ke, B)
        fc = F*sn + Tx*st + Ty*s2
        FC[k] = fc; Q[k] = q; V[k] = dq; DEP[k, 0] = d; DEP[k, 1] = x; DEP[k, 2] = y
        h = rne(dq, np.zeros(n), O, Z, C, Iw, m, grav)
        G = rne(np.zeros(n), np.zeros(n), O, Z, C, Iw, m, grav)
        tau = G - Dq*(dq - dqr[k])
        if mode == 0: tau += Kq*(qr[k] - q)
        else:
            Or, Zr, Rr = fk(qr[k], p, ax)
            e = np.empty(6)
            e[:3] = Kc[0]*(Or[n-1] + mv(Rr[n-1], ptrue) - pt)
            e[3:] = Kc[1]*rotlog(mm(Rr[n-1], R[n-1].T.copy()))
            vr = J @ (dqr[k] - dq)
            e[:3] += Kc[2]*vr[:3]; e[3:] += Kc[3]*vr[3:]
            tau += J.T @ e + Kc[4]*(qr[k] - q)
        TAU[k] = tau
        M = massmat(O, Z, C, Iw, m)
        for j in range(n): M[j, j] += rotor[j]
        rhs = tau - h - vis*0.05*dq + J[:3].T @ fc
        dq = dq + dt*np.linalg.solve(M, rhs)
        q = q + dt*dq
    return Q, V, FC, TAU, DEP

@njit(cache=True)
def run_joint(qr, dqr, ddqr, dt, p, ax, m, c, I, rotor, grav, mm_, cm, Im, Kq, Dq, fc, fv, fs, vs, fl, foff, fasy, br):
    """position-controlled drives with gears. mm_: the controller's own model. Friction: one LuGre-like bristle per joint (length br), Coulomb+load+Stribeck+viscous.
    Returns q, dq, ddq, drive torque on the link side of an ideal gear."""
    T, n = qr.shape
    Q = np.empty((T, n)); V = np.empty((T, n)); A = np.empty((T, n)); TAU = np.empty((T, n))
    q = qr[0].copy(); dq = dqr[0].copy(); z = np.zeros(n); f = np.zeros(n); tl = np.zeros(n)
    for k in range(T):
        O, Z, R, C, Iw = bodies(q, p, ax, c, I)
        h = rne(dq, np.zeros(n), O, Z, C, Iw, m, grav)
        M = massmat(O, Z, C, Iw, m)
        for j in range(n): M[j, j] += rotor[j]
        tau = np.empty(n)
        for j in range(n):
            lev = fc[j] + fs[j]*np.exp(-(dq[j]/vs[j])**2) + fl[j]*abs(tl[j])
            dc_ = 1 - np.exp(-abs(dq[j])*dt/br[j]); z[j] += dc_*(np.sign(dq[j])*br[j] - z[j])
            f[j] = lev*z[j]/br[j] + fv[j]*dq[j] + foff[j] + fasy[j]*abs(z[j])/br[j]
        ff = M @ ddqr[k] + h
        for j in range(n):
            tau[j] = ff[j] + f[j]*.93 + Kq[j]*(qr[k, j]-q[j]) + Dq[j]*(dqr[k, j]-dq[j])
        a = np.linalg.solve(M, tau - h - f)
        for j in range(n): tl[j] = tau[j] - f[j] - rotor[j]*a[j]
        Q[k] = q; V[k] = dq; A[k] = a; TAU[k] = tau
        dq = dq + dt*a
        q = q + dt*dq
    return Q, V, A, TAU

@njit(cache=True)
def run_drive(qr, dqr, ddqr, dt, J, fc, fv, fs, vs, br, ripA, ripk, ripp, ks, asy, warm_a, warm_t, Kp, Kd, ext):
    T = qr.size
    Q = np.empty(T); V = np.empty(T); TAU = np.empty(T)
    q = qr[0]; dq = dqr[0]; z = 0.
    for k in range(T):
        dc_ = 1 - np.exp(-abs(dq)*dt/br); z += dc_*(np.sign(dq)*br - z)
        s = z/br
        lev = fc + fs*np.exp(-(dq/vs)**2)
        f = lev*s + asy*abs(s) + fv*(1 + warm_a*np.exp(-k*dt/warm_t))*dq
        f += ripA*(np.sin(ripk*q + ripp) + .3*np.sin(2*ripk*q + 1.)) + ks*q + ext[k]
        tau = J*ddqr[k] + .93*f + Kp*(qr[k]-q) + Kd*(dqr[k]-dq)
        a = (tau - f)/J
        Q[k] = q; V[k] = dq; TAU[k] = tau
        dq += dt*a; q += dt*dq
    return Q, V, TAU
