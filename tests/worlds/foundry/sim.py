"""Numerical core of the world: own rigid-body dynamics (world frame), flexible joints, joint LuGre friction,
contact laws with memory, linearly implicit Euler. Nothing here comes from the project."""
import json, os, numpy as np
from numba import njit

# ---------------------------------------------------------------- arms
def _lwr():
    L = json.load(open(os.path.join(os.path.dirname(os.path.abspath(__file__)), 'lwr4plus_inertia.json')))
    P = np.array([[0,0,.11],[0,0,.2005],[0,0,.2],[0,0,.2],[0,0,.2],[0,0,.19],[0,0,.078]])
    A = np.array([[0,0,1],[0,-1,0],[0,0,1],[0,1,0],[0,0,1],[0,-1,0],[0,0,1]],float)
    m = np.array([l['m'] for l in L]); c = np.array([l['com'] for l in L]); I = np.array([l['I'] for l in L])
    # I order: ixx iyy izz ixy ixz iyz
    return dict(name='lwr', P=P, A=A, m=m, c=c, I=I, Rf=np.eye(3), pf=np.zeros(3), ps=np.array([0,0,.012]), tip=.105,
                K=np.array([1e4]*5+[7.5e3]*2), B=np.array([2.25]*5+[1.3]*2), q0=np.radians([0,30,0,-90,0,60,0]),
                side=1, lim=[2.97,2.09,2.97,2.09,2.97,2.09,2.97], eff=[176,176,100,100,100,38,38], base='base_link', mb=1.6)
def _gen6():
    P = np.array([[0,0,.20],[.12,0,.18],[0,0,.50],[.16,0,.09],[.30,0,0],[.07,0,0]],float)
    A = np.array([[0,0,1],[0,1,0],[0,1,0],[1,0,0],[0,1,0],[1,0,0]],float)
    m = np.array([14.,11.,6.5,3.2,1.6,.45])
    c = np.array([[.05,0,.10],[.01,.02,.24],[.07,0,.05],[.14,0,0],[.03,0,.005],[.02,0,0]])
    I = np.array([[.12,.12,.10,0,0,0],[.27,.26,.04,0,.005,0],[.05,.07,.06,0,-.01,0],[.006,.035,.035,0,0,0],
                  [.0025,.0028,.0026,0,0,0],[.0004,.0003,.0003,0,0,0]],float)
    Rf = np.array([[0,0,1],[0,1,0],[-1,0,0]],float)       # flange z along joint-6 axis (x)
    return dict(name='gen6', P=P, A=A, m=m, c=c, I=I, Rf=Rf, pf=np.array([.03,0,0]), ps=np.array([0,0,.02]), tip=.12,
                K=np.array([4e4,4e4,2.5e4,1.2e4,1.2e4,8e3]), B=np.array([2.4,2.6,1.3,.35,.3,.2]), q0=np.array([0,.35,.25,0,np.pi/2-.6,0]),
                side=0, lim=[3.1,2.2,2.6,3.1,2.2,6.2], eff=[300,300,160,60,50,30], base='base', mb=10.)
ARMS = {'lwr': _lwr(), 'gen6': _gen6()}

def urdf(arm, path):
    n = len(arm['m']); s = ['<?xml version="1.0"?>', f'<robot name="{arm["name"]}">',
        f'<link name="{arm["base"]}"><inertial><origin xyz="0 0 0.05"/><mass value="{arm["mb"]}"/><inertia ixx="0.004" iyy="0.004" izz="0.004" ixy="0" ixz="0" iyz="0"/></inertial></link>']
    par = arm['base']
    for i in range(n):
        x = arm['I'][i]; c = arm['c'][i]
        s.append(f'<link name="link_{i+1}"><inertial><origin xyz="{c[0]} {c[1]} {c[2]}" rpy="0 0 0"/><mass value="{arm["m"][i]}"/>'
                 f'<inertia ixx="{x[0]}" iyy="{x[1]}" izz="{x[2]}" ixy="{x[3]}" ixz="{x[4]}" iyz="{x[5]}"/></inertial></link>')
        p, a = arm['P'][i], arm['A'][i]
        s.append(f'<joint name="joint_{i+1}" type="revolute"><parent link="{par}"/><child link="link_{i+1}"/><origin xyz="{p[0]} {p[1]} {p[2]}" rpy="0 0 0"/>'
                 f'<axis xyz="{a[0]} {a[1]} {a[2]}"/><limit lower="{-arm["lim"][i]}" upper="{arm["lim"][i]}" velocity="3" effort="{arm["eff"][i]}"/></joint>')
        par = f'link_{i+1}'
    rpy = '0 0 0' if arm['name'] == 'lwr' else '0 1.5707963267948966 0'
    pf = arm['pf']
    for nm, p, xyz, r in (('flange', par, pf, rpy), ('ft_sensor', 'flange', arm['ps'], '0 0 0'), ('tool_tip', 'ft_sensor', [0,0,arm['tip']], '0 0 0')):
        s.append(f'<link name="{nm}"/><joint name="{nm}_fixed" type="fixed"><parent link="{p}"/><child link="{nm}"/><origin xyz="{xyz[0]} {xyz[1]} {xyz[2]}" rpy="{r}"/></joint>')
    s.append('</robot>'); open(path, 'w').write('\n'.join(s))

@njit(cache=True)
def rot(a, q):
    c = np.cos(q); s = np.sin(q); v = 1-c
    return np.array([[c+a[0]*a[0]*v, a[0]*a[1]*v-a[2]*s, a[0]*a[2]*v+a[1]*s],
                     [a[1]*a[0]*v+a[2]*s, c+a[1]*a[1]*v, a[1]*a[2]*v-a[0]*s],
                     [a[2]*a[0]*v-a[1]*s, a[2]*a[1]*v+a[0]*s, c+a[2]*a[2]*v]])
@njit(cache=True)
def cr(a, b):
    return np.array([a[1]*b[2]-a[2]*b[1], a[2]*b[0]-a[0]*b[2], a[0]*b[1]-a[1]*b[0]])
@njit(cache=True)
def mv(M, v):
    return np.array([M[0,0]*v[0]+M[0,1]*v[1]+M[0,2]*v[2], M[1,0]*v[0]+M[1,1]*v[1]+M[1,2]*v[2], M[2,0]*v[0]+M[2,1]*v[1]+M[2,2]*v[2]])
@njit(cache=True)
def mm(A, B):
    C = np.empty((3,3))
    for i in range(3):
        for j in range(3): C[i,j] = A[i,0]*B[0,j]+A[i,1]*B[1,j]+A[i,2]*B[2,j]
    return C
@njit(cache=True)
def fk(q, P, A, R, p, a):
    """world rotations, origins and axes of all link frames"""
    Rc = np.eye(3); pc = np.zeros(3)
    for i in range(q.size):
        pc = pc + mv(Rc, P[i]); Rc = mm(Rc, rot(A[i], q[i]))
        R[i] = Rc; p[i] = pc; a[i] = mv(Rc, A[i])
@njit(cache=True)
def dyn(q, qd, P, A, m, c, I6, g, R, p, a, M, h):
    """mass matrix and bias (Newton-Euler in the world frame; composite bodies by direct sums)"""
    n = q.size
    fk(q, P, A, R, p, a)
    M[:] = 0.; h[:] = 0.
    w = np.zeros(3); al = np.zeros(3); ap = -g; pp = np.zeros(3)
    Fx = np.zeros((n,3)); Nx = np.zeros((n,3)); cw = np.zeros((n,3)); Iw = np.zeros((n,3,3))
    for i in range(n):
        r = p[i]-pp
        ap = ap + cr(al, r) + cr(w, cr(w, r)); pp = p[i]
        al = al + cr(w, a[i])*qd[i]; w = w + a[i]*qd[i]
        rc = mv(R[i], c[i]); cw[i] = p[i]+rc
        ac = ap + cr(al, rc) + cr(w, cr(w, rc))
        x = I6[i]
        I = np.array([[x[0],x[3],x[4]],[x[3],x[1],x[5]],[x[4],x[5],x[2]]])
        W = mm(mm(R[i], I), np.ascontiguousarray(R[i].T)); Iw[i] = W
        Fx[i] = m[i]*ac; Nx[i] = mv(W, al) + cr(w, mv(W, w))
    # composite inertias about the joint origins, from the tip down
    mc = 0.; s = np.zeros(3); J = np.zeros((3,3)); f = np.zeros(3); nn = np.zeros(3)   # about the world origin
    for i in range(n-1, -1, -1):
        mc += m[i]; s = s + m[i]*cw[i]; d = cw[i]
        dd = d[0]*d[0]+d[1]*d[1]+d[2]*d[2]
        for u in range(3):
            for v in range(3): J[u,v] += Iw[i][u,v] - m[i]*d[u]*d[v]
            J[u,u] += m[i]*dd
        f = f + Fx[i]; nn = nn + Nx[i] + cr(cw[i], Fx[i])
        t = nn - cr(p[i], f)
        h[i] = a[i,0]*t[0]+a[i,1]*t[1]+a[i,2]*t[2]
        # spatial momentum for unit q̇_i, at world origin: v0 = -a×p
        v0 = -cr(a[i], p[i])
        lin = mc*v0 + cr(a[i], s)
        ang = mv(J, a[i]) + cr(s, v0)
        for j in range(i+1):
            t2 = ang - cr(p[j], lin)
            M[i,j] = a[j,0]*t2[0]+a[j,1]*t2[1]+a[j,2]*t2[2]; M[j,i] = M[i,j]

# ---------------------------------------------------------------- contact
NP = 48; NS = 14
IDX = dict(law=0,k=1,n=2,c=3,lam=4,r1=5,tau1=6,r2=7,tau2=8,bw_amp=9,bw_len=10,mul_r=11,mul_len=12,Fa=13,La=14,K2=15,db=16,alpha=17,
           inh=18,inh_amp=19,x0=20,y0=21,w=22,mu=23,bl=24,s1=25,vt=26,dmu=27,vs=28,p=29,N0=30,aniso=31,ftype=32,vr=33,plast=34,
           mag=35,maggap=36,snap=37,snap_d=38,snap_w=39,pt=40,pt_len=41,tipa=42)
def pars(**kw):
    P = np.zeros(NP); P[1]=1000; P[2]=1; P[6]=P[8]=1; P[10]=P[12]=P[14]=1e-3; P[22]=.01; P[24]=1e-4; P[28]=.01; P[30]=5; P[33]=1e-3
    P[36]=P[39]=1e-3; P[41]=1e-4; P[42]=1e9
    for k, v in kw.items(): P[IDX[k]] = v
    return P
@njit(cache=True)
def contact(P, S, d, dd, x, y, vx, vy, t, h, out):
    """normal and tangential force; S carries the memory. S: 0,1 Maxwell branches, 2 last elastic force, 3 Bouc-Wen, 4 deepest,
    5 touched, 6,7 bristle, 8 permanent set"""
    dp = d - S[8]
    e = max(dp, 0.)
    if P[0] == 0.: F = P[1]*e**P[2] if e > 0 else 0.
    else:                              # bed of independent springs under a spherical cap of radius n, cut at tip radius tipa
        Rr = P[2]; a2 = min(2*Rr*e - e*e, P[42]**2)
        F = P[1]*np.pi*(e*a2 - a2*a2/(4*Rr)) if e > 0 else 0.
    if P[15] > 0 and e > P[16]: F += P[15]*(e-P[16])
    if P[37] > 0: F -= P[37]*.5*(1+np.tanh((e-P[38])/P[39])) * (1. if e > 0 else 0.)   # buckling struts give way
    if F < 0: F = 0.
    g = 1+P[17]*t/60
    if P[18] == 1.: g *= 1+P[19]*np.exp(-((x-P[20])**2+(y-P[21])**2)/(2*P[22]**2))
    if P[18] == 2.: g *= 1+P[19]*(.5+.5*np.tanh((x-P[20])/P[22]))
    F *= g
    if P[11] > 0 and e > 0:            # Mullins, Ogden-Roxburgh-like
        if e > S[4]: S[4] = e
        F *= 1-P[11]*np.tanh((S[4]-e)/P[12])
    N = F + (P[3]*dd if e > 0 else 0.) + P[4]*F*dd
    for i in range(2):                 # exact exponential update of each Maxwell branch
        if P[5+2*i] > 0:
            ta = P[6+2*i]; E = np.exp(-h/ta)
            S[i] = S[i]*E + P[5+2*i]*(F-S[2])*ta/h*(1-E)
            N += S[i]
    S[2] = F
    if P[9] > 0:
        if e > 0:
            S[3] += h*dd/P[10]*(1-abs(S[3])*(0.5*np.sign(dd*S[3])+.5))
        else: S[3] = 0.
        N += P[9]*S[3]*min(e/P[10], 1.)
    if e > 0: 
        if N < 0: N = 0.
    else: N = 0.
    if P[34] > 0:
        ns = P[34]*d
        if ns > S[8]: S[8] = ns
    if P[13] > 0:
        if d > 0: S[5] = 1.
        if S[5] > 0:
            if d < -P[14]: S[5] = 0.
            elif d < 0: N -= P[13]*(1+d/P[14])
            else: N -= P[13]
    if P[35] > 0: N -= P[35]/(1+max(-d,0.)/P[36])**2 * (1. if d < 0 else 1.)
    Nf = max(N, 0.)
    if P[13] > 0 and d > 0: Nf = max(N+P[13], 0.)
    if P[35] > 0: Nf = max(N+P[35], 0.) if d > 0 else 0.
    T1 = 0.; T2 = 0.
    v = np.sqrt(vx*vx+vy*vy)
    if P[23] > 0 and Nf > 1e-6 and d > 0:
        mu = P[23]*(Nf/P[30])**P[29] if P[29] != 0 else P[23]
        mu += P[27]*np.exp(-(v/P[28])**2)
        m1 = mu*(1+P[31]); m2 = mu*(1-P[31])
        if P[32] == 1.:
            q = np.sqrt(v*v+P[33]**2); T1 = -m1*Nf*vx/q; T2 = -m2*Nf*vy/q
        else:
            zx = S[6]; zy = S[7]; b = P[24]
            # implicit bristle (LuGre with normalised bristle): z' = v - |v| z / b
            S[6] = (zx+h*vx)/(1+h*v/b); S[7] = (zy+h*vy)/(1+h*v/b)
            T1 = -m1*Nf*(S[6]/b + P[25]*(S[6]-zx)/h); T2 = -m2*Nf*(S[7]/b + P[25]*(S[7]-zy)/h)
        if P[40] > 0:
            T1 -= P[40]*Nf*np.sin(2*np.pi*x/P[41])
        T1 -= P[26]*vx; T2 -= P[26]*vy
    else:
        S[6] = 0.; S[7] = 0.
    if P[23] == 0. and d > 0: T1 -= P[26]*vx; T2 -= P[26]*vy
    out[0] = N; out[1] = T1; out[2] = T2

# joint effect rows: 0 Fc 1 Fv 2 dF(stribeck) 3 vs 4 asym 5 load coeff 6 bristle 7 spring K 8 spring q0 9 ripple amp 10 ripple k 11 ripple phase
# 12 quadratic drag 13 rounding 14 second harmonic
@njit(cache=True)
def jfric(J, i, q, v, load, z, h):
    """LuGre bristle with Stribeck level, asymmetry and load; returns torque opposing motion"""
    Fc = J[i,0]+J[i,2]*np.exp(-(v/J[i,3])**2)+J[i,5]*abs(load)
    f = J[i,1]*v + J[i,12]*v*abs(v)
    if Fc > 0:
        if J[i,13] > 0: f += Fc*np.tanh(v/J[i,13])
        else:
            b = J[i,6]; zn = (z[i]+h*v)/(1+h*abs(v)/b); z[i] = zn; f += Fc*zn/b
        if J[i,4] != 0: f += J[i,4]*np.tanh(v/1e-3)*np.sign(v)     # asymmetry: adds the same sign both ways while moving
    f += J[i,7]*(q-J[i,8]) + J[i,9]*np.sin(J[i,10]*q+J[i,11]) + J[i,14]*np.sin(2*J[i,10]*q)
    return f

@njit(cache=True)
def simulate(qd_tab, td, T, h, dec, P, A, m, c, I6, K, B, Kp, Kd, g, side, J, Rf, pf, psens, tipr, comr, surf, Rs, CP, contact_on, lag):
    n = P.shape[0]; nt = int(T/h); nr = nt//dec
    rec = np.zeros((nr, 3*n+n+n+3+3+3))
    q = qd_tab[0].copy(); qdv = np.zeros(n)
    R = np.zeros((n,3,3)); p = np.zeros((n,3)); a = np.zeros((n,3)); M = np.zeros((n,n)); hb = np.zeros(n)
    R2 = np.zeros((n,3,3)); p2 = np.zeros((n,3)); a2 = np.zeros((n,3)); M2 = np.zeros((n,n)); g2 = np.zeros(n); z0v = np.zeros(n)
    dyn(q, qdv, P, A, m, c, I6, g, R, p, a, M, hb)
    th = q + hb/K; thd = np.zeros(n); z = np.zeros(n); S = np.zeros(NS); out = np.zeros(3)
    fc = np.zeros(3); gff = hb.copy(); rhs = np.zeros(n); Ms = np.zeros((n,n)); W = np.zeros(n)
    vcp = np.zeros(3); af = np.zeros(n); ks = 0; Jt = np.zeros((n,3))
    for s in range(nt):
        t = s*h
        x = t/td; k = int(x); u = x-k
        if k >= qd_tab.shape[0]-2: k = qd_tab.shape[0]-3; u = 1.
        # C1 cubic (Catmull-Rom) of the command table
        km = k-1 if k > 0 else 0
        W2 = np.zeros(n); Wd = np.zeros(n)
        for i in range(n):
            y0 = qd_tab[km,i]; y1 = qd_tab[k,i]; y2 = qd_tab[k+1,i]; y3 = qd_tab[k+2,i]
            m1 = .5*(y2-y0); m2 = .5*(y3-y1); c3 = 2*y1-2*y2+m1+m2; c2 = -3*y1+3*y2-2*m1-m2
            W2[i] = ((c3*u+c2)*u+m1)*u+y1; Wd[i] = ((3*c3*u+2*c2)*u+m1)/td
        dyn(q, qdv, P, A, m, c, I6, g, R, p, a, M, hb)
        if s % 16 == 0:                      # gravity feed-forward refreshed at the controller's rate
            dyn(W2, z0v, P, A, m, c, I6, g, R2, p2, a2, M2, g2); gff[:] = g2
        RF = mm(R[n-1], Rf); pF = p[n-1] + mv(R[n-1], pf)
        pt = pF + mv(RF, psens+tipr); vt = np.zeros(3); pcm = pF + mv(RF, psens+comr); vc = np.zeros(3)
        for i in range(n):
            Jt[i] = cr(a[i], pt-p[i]); vt += Jt[i]*qdv[i]; vc += cr(a[i], pcm-p[i])*qdv[i]
        if contact_on:
            rl = pt - surf
            xx = Rs[0,0]*rl[0]+Rs[0,1]*rl[1]+Rs[0,2]*rl[2]; yy = Rs[1,0]*rl[0]+Rs[1,1]*rl[1]+Rs[1,2]*rl[2]; dz = -(Rs[2,0]*rl[0]+Rs[2,1]*rl[1]+Rs[2,2]*rl[2])
            vv = mv(Rs, vt)
            contact(CP, S, dz, -vv[2], xx, yy, vv[0], vv[1], t, h, out)
            fc = out[1]*Rs[0]+out[2]*Rs[1]+out[0]*Rs[2]
        else:
            S[0] = 0.
        for i in range(n):
            tj = K[i]*(th[i]-q[i])
            if side == 0: fm = jfric(J, i, th[i], thd[i], tj, z, h); fl = 0.
            else: fm = 0.; fl = jfric(J, i, q[i], qdv[i], tj, z, h)
            D = .002*K[i]; sk = h*K[i]+D
            tm = gff[i] + Kp[i]*(W2[i]+gff[i]/K[i]-th[i]) + Kd[i]*(Wd[i]-thd[i])
            aa = B[i] + h*sk + h*(Kd[i]+h*Kp[i])
            # motor momentum with q̇+ eliminated
            bm = B[i]*thd[i] + h*(gff[i]+Kp[i]*(W2[i]+gff[i]/K[i]-th[i]) + Kd[i]*Wd[i] - tj - fm)
            W[i] = bm/aa; af[i] = sk/aa
            for j in range(n): Ms[i,j] = M[i,j]
            Ms[i,i] += h*sk*(1-h*sk/aa)
            r = h*(tj - hb[i] - fl + Jt[i,0]*fc[0]+Jt[i,1]*fc[1]+Jt[i,2]*fc[2]) + h*sk*W[i]
            for j in range(n): r += M[i,j]*qdv[j]
            rhs[i] = r
            # logged torque: side 1 link-side sensor (spring), side 0 motor torque reflected
            rec_t = tj + D*(thd[i]-qdv[i]) if side == 1 else tm
            if s % dec == 0 and s//dec < nr:
                rec[s//dec, 4*n+i] = rec_t
        vn = np.linalg.solve(Ms, rhs)
        if s % dec == 0 and s//dec < nr:
            r0 = s//dec
            rec[r0,:n] = q; rec[r0,n:2*n] = th; rec[r0,2*n:3*n] = qdv; rec[r0,3*n:4*n] = thd
            rec[r0,5*n:5*n+3] = fc
            rec[r0,5*n+3:5*n+6] = vc
            rec[r0,5*n+6:5*n+9] = out
        for i in range(n):
            thd[i] = W[i] + h*af[i]*vn[i]
            qdv[i] = vn[i]; q[i] += h*qdv[i]; th[i] += h*thd[i]
    return rec

@njit(cache=True)
def press(xc, yc, h, dec, CP, mass, Kp, Kd):
    """material tester: a carriage of finite mass on a position servo pushes a platen; lateral stage kinematic"""
    nt = xc.size; out = np.zeros(3); S = np.zeros(NS)
    rec = np.zeros((nt//dec, 8)); d = xc[0]; v = 0.; N = 0.
    for s in range(nt):
        vy = (yc[s]-yc[s-1])/h if s > 0 else 0.
        vc = (xc[s]-xc[s-1])/h if s > 0 else 0.
        contact(CP, S, d, v, yc[s], 0., vy, 0., s*h, h, out)
        if s % dec == 0 and s//dec < rec.shape[0]:
            r = rec[s//dec]; r[0] = s*h; r[1] = d; r[2] = v; r[3] = out[0]; r[4] = yc[s]; r[5] = vy; r[6] = out[1]; r[7] = out[2]
        v = (mass*v + h*(Kp*(xc[s]-d) + Kd*vc - out[0]))/(mass + h*Kd + h*h*Kp)
        d += h*v
    return rec
@njit(cache=True)
def drive(qc, h, dec, Il, Bm, K, Kp, Kd, J, gap, side):
    """two masses, gear spring (with optional play `gap`), friction on the motor"""
    nt = qc.size; rec = np.zeros((nt//dec, 5)); th = qc[0]; q = th; w = 0.; v = 0.; z = np.zeros(1)
    for s in range(nt):
        vc = (qc[s]-qc[s-1])/h if s > 0 else 0.
        e = th-q
        if gap > 0: e = e-gap if e > gap else (e+gap if e < -gap else 0.)
        tj = K*e + (.002*K*(w-v) if (gap == 0 or e != 0) else 0.)
        f = jfric(J, 0, th, w, tj, z, h)
        tm = Kp*(qc[s]-th)+Kd*(vc-w)
        if s % dec == 0 and s//dec < rec.shape[0]:
            r = rec[s//dec]; r[0] = s*h; r[1] = th; r[2] = w; r[3] = tm; r[4] = q
        w = (Bm*w + h*(Kp*(qc[s]-th) + Kd*vc - tj - f))/(Bm+h*Kd+h*h*Kp)
        v += h*tj/Il
        th += h*w; q += h*v
    return rec

# ---------------------------------------------------------------- helpers in numpy
def fk_np(arm, Q):
    """sensor rotation and position, tip position for many rows (numpy, vectorised)"""
    Rc = np.broadcast_to(np.eye(3), (len(Q),3,3)).copy(); pc = np.zeros((len(Q),3))
    for i in range(Q.shape[1]):
        pc = pc + Rc@arm['P'][i]
        a = arm['A'][i]; k = np.array([[0,-a[2],a[1]],[a[2],0,-a[0]],[-a[1],a[0],0]])
        s = np.sin(Q[:,i])[:,None,None]; c = (1-np.cos(Q[:,i]))[:,None,None]
        Rc = Rc@(np.eye(3)+s*k+c*(k@k))
    R = Rc@arm['Rf']; p = pc + Rc@arm['pf'] + R@arm['ps']
    return R, p, p+R@np.array([0,0,arm['tip']])
def ik(arm, pts, Rd, q, posture=None):
    """damped Newton along a path, min-norm"""
    out = []; n = q.size
    Rr = np.zeros((n,3,3)); pr = np.zeros((n,3)); ar = np.zeros((n,3)); tl = np.array([0,0,arm['tip']])
    q = q.copy()
    for k in range(len(pts)):
        for it in range(3 if k else 60):
            fk(q, arm['P'], arm['A'], Rr, pr, ar)
            RF = Rr[-1]@arm['Rf']; pt = pr[-1]+Rr[-1]@arm['pf']+RF@(arm['ps']+tl)
            E = Rd[k]@RF.T; e = np.r_[pts[k]-pt, .5*np.array([E[2,1]-E[1,2], E[0,2]-E[2,0], E[1,0]-E[0,1]])]
            if np.abs(e).max() < 1e-9: break
            Jm = np.vstack([np.cross(ar, pt-pr).T, ar.T])
            q = q + Jm.T@np.linalg.solve(Jm@Jm.T+1e-8*np.eye(6), e)
        out.append(q.copy())
    return np.array(out)
