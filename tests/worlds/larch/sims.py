"""Closed-loop simulations: arm (Cartesian impedance + normal admittance, or joint PD; current-loop lag; bristle joint friction), tester, drive."""
import numpy as np
from numba import njit
from chain import fk, dyn, chol_solve, cr, mv, merge, rpy
from contact import law, NS

@njit(cache=True, error_model="numpy", fastmath=True)
def _jf(n, J, zb, dq, tl, q, dt, out):
    """joint loads seen by the torque reading: rows of J: Fc,Fv,dFs,vs,asym,load,ks,q0,ra,rk,rp,off,bl,gain,ra2,warm,ra3"""
    for i in range(n):
        Fc = J[0, i]+J[2, i]*np.exp(-(dq[i]/J[3, i])**2)+J[5, i]*abs(tl[i])
        s = 0.0
        for k in range(2):
            L = J[12, i]*(0.5+k)
            b = zb[i, k]+dq[i]*dt
            b = min(L, max(-L, b)); zb[i, k] = b; s += 0.5*b/L
        u = (1+J[4, i]) if s > 0 else (1-J[4, i])
        out[i] = Fc*s*u+J[1, i]*dq[i]+J[6, i]*(q[i]-J[7, i])+J[8, i]*np.sin(J[9, i]*q[i]+J[10, i])+J[14, i]*np.sin(2*J[9, i]*q[i]+2*J[10, i])

@njit(cache=True, error_model="numpy", fastmath=True)
def arm_loop(n, R0, p0, ax, m, com, I, mN, comN, IN_, rotIn, rotSeen, g, q0, Rf, pf, ptip, ptipN, tm, tc, Ti, pt, nrm, ta, tb,
             P, G, W, J, mode, K, Kr, D, Dr, kn, dn, Pd, Vd, Rd, Fd, Da, Qd, dQd, Kp, Kd, lagm, cab, dt, ctl, dec, nst, payoff):
    ns = (nst+dec-1)//dec
    oq = np.zeros((ns, n)); odq = np.zeros((ns, n)); oqdd = np.zeros((ns, n)); ot = np.zeros((ns, n)); ow = np.zeros((ns, 6)); oc = np.zeros((ns, 6)); ocmd = np.zeros((ns, n))
    R = np.zeros((n, 3, 3)); p = np.zeros((n, 3)); z = np.zeros((n, 3)); M = np.zeros((n, n)); h = np.zeros(n); hN = np.zeros(n); MN = np.zeros((n, n))
    w = np.zeros((12, max(n, 3), 3)); L = np.zeros((n, n)); x = np.zeros(n); rhs = np.zeros(n)
    q = q0.copy(); dq = np.zeros(n); tcmd = np.zeros(n); tmot = np.zeros(n); fr = np.zeros(n); zb = np.zeros((n, 2)); tl = np.zeros(n)
    S = np.zeros(NS); Jv = np.zeros((n, 3)); JvN = np.zeros((n, 3))
    tw = np.zeros(3); rt = np.zeros(3); d = np.zeros(3); vt = np.zeros(3); om = np.zeros(3); er = np.zeros(3); F = np.zeros(3); Mo = np.zeros(3); Fc = np.zeros(3)
    Rs = np.zeros((3, 3)); za = 0.0; t1 = np.zeros(3); t2 = np.zeros(3); t3 = np.zeros(3); zero = np.zeros(n)
    al = np.zeros(3); ao = np.zeros(3); jdot = np.zeros(3)
    fk(n, R0, p0, ax, q, R, p, z); dyn(n, R, p, z, mN, comN, IN_, zero, g, MN, hN, False, w)
    for i in range(n): tcmd[i] = hN[i]; tmot[i] = hN[i]
    Nlast = 0.0
    for it in range(nst):
        t = it*dt
        fk(n, R0, p0, ax, q, R, p, z)
        dyn(n, R, p, z, m, com, I, dq, g, M, h, True, w)
        # tip
        mv(R[n-1], ptip, rt)
        for r in range(3): tw[r] = p[n-1, r]+rt[r]
        for r in range(3): vt[r] = 0.0; om[r] = 0.0
        for i in range(n):
            for r in range(3): d[r] = tw[r]-p[i, r]
            cr(z[i], d, Jv[i])
            for r in range(3):
                vt[r] += Jv[i, r]*dq[i]; om[r] += z[i, r]*dq[i]
        dep = 0.0; dd = 0.0; s1 = 0.0; s2 = 0.0; v1 = 0.0; v2 = 0.0
        for r in range(3):
            e = tw[r]-pt[r]
            dep -= nrm[r]*e; dd -= nrm[r]*vt[r]; s1 += ta[r]*e; s2 += tb[r]*e; v1 += ta[r]*vt[r]; v2 += tb[r]*vt[r]
        N, T1, T2 = law(P, S, G, W, dep, dd, s1, s2, v1, v2, t, dt)
        for r in range(3): Fc[r] = N*nrm[r]+T1*ta[r]+T2*tb[r]
        if cab[0] > 0:
            dist = 0.0
            for r in range(3): dist += (tw[r]-cab[1+r])**2
            dist = np.sqrt(dist)
            if dist > cab[4]:
                for r in range(3): Fc[r] -= cab[0]*(dist-cab[4])*(tw[r]-cab[1+r])/dist
        if it % ctl == 0:
            kc = min(it//ctl, max(Pd.shape[0], Qd.shape[0])-1)
            dyn(n, R, p, z, mN, comN, IN_, zero, g, MN, hN, False, w)
            if mode == 0:
                if Fd[kc] > 0: za += (Nlast-Fd[kc])*ctl*dt/Da
                else: za *= 1.0-ctl*dt/0.05
                for r in range(3):
                    F[r] = K*(Pd[kc, r]+za*nrm[r]-tw[r])+D*(Vd[kc, r]-vt[r])
                    er[r] = 0.0
                for c in range(3):
                    for r in range(3): t1[r] = R[n-1, r, c]; t2[r] = Rd[kc, r, c]
                    cr(t1, t2, t3)
                    for r in range(3): er[r] += 0.5*t3[r]
                for r in range(3): Mo[r] = Kr*er[r]-Dr*om[r]
                for i in range(n):
                    s = hN[i]-dn*dq[i]+kn*(q0[i]-q[i])
                    for r in range(3): s += Jv[i, r]*F[r]+z[i, r]*Mo[r]
                    tcmd[i] = s
            else:
                for i in range(n):
                    tcmd[i] = hN[i]+Kp[i]*(Qd[kc, i]-q[i])+Kd[i]*(dQd[kc, i]-dq[i])
        a = dt/lagm
        for i in range(n): tmot[i] += a*(tcmd[i]-tmot[i])
        for i in range(n): tl[i] = tmot[i]
        _jf(n, J, zb, dq, tl, q, dt, fr)
        for i in range(n):
            s = tmot[i]-h[i]-fr[i]
            for r in range(3): s += Jv[i, r]*Fc[r]
            rhs[i] = s; M[i, i] += rotIn[i]+rotSeen[i]
        chol_solve(n, M, rhs, x, L)
        Nlast += 0.1*(N-Nlast)
        if it % dec == 0:
            k = it//dec
            # tool wrench in the sensor frame
            for r in range(3): al[r] = 0.0; ao[r] = 0.0
            for r in range(3): om[r] = 0.0
            mv(R[n-1], pf, t1)
            # angular and linear acceleration of the sensor origin, forward
            a0x = w[10, 0]; 
            for r in range(3): a0x[r] = 0.0
            for i in range(n):
                if i > 0:
                    for r in range(3): d[r] = p[i, r]-p[i-1, r]
                    cr(al, d, t2)
                    for r in range(3): ao[r] += t2[r]
                    cr(om, d, t2); cr(om, t2, t3)
                    for r in range(3): ao[r] += t3[r]
                cr(om, z[i], t2)
                for r in range(3):
                    al[r] += z[i, r]*x[i]+t2[r]*dq[i]; om[r] += z[i, r]*dq[i]
            # com of tool: sensor origin + Rs tc
            for r in range(3):
                for c in range(3):
                    Rs[r, c] = R[n-1, r, 0]*Rf[0, c]+R[n-1, r, 1]*Rf[1, c]+R[n-1, r, 2]*Rf[2, c]
            mv(Rs, tc, rt)
            for r in range(3): d[r] = t1[r]+rt[r]
            cr(al, d, t2)
            for r in range(3): ao[r] += t2[r]
            cr(om, d, t2); cr(om, t2, t3)
            for r in range(3): ao[r] += t3[r]
            for r in range(3): t2[r] = tm*(g[r]-ao[r])
            fs = w[10, 1]; ft = w[10, 2]; fc = w[11, 0]; ms = w[11, 1]; wl = w[11, 2]
            for r in range(3):
                fs[r] = Rs[0, r]*t2[0]+Rs[1, r]*t2[1]+Rs[2, r]*t2[2]
                fc[r] = Rs[0, r]*Fc[0]+Rs[1, r]*Fc[1]+Rs[2, r]*Fc[2]
                t3[r] = Rs[0, r]*al[0]+Rs[1, r]*al[1]+Rs[2, r]*al[2]
                wl[r] = Rs[0, r]*om[0]+Rs[1, r]*om[1]+Rs[2, r]*om[2]
            cr(tc, fs, ft)
            # r_tip in sensor frame
            for r in range(3): d[r] = tw[r]-p[n-1, r]-t1[r]
            for r in range(3): rt[r] = Rs[0, r]*d[0]+Rs[1, r]*d[1]+Rs[2, r]*d[2]
            cr(rt, fc, ms)
            mv(Ti, wl, t1); cr(wl, t1, t2); mv(Ti, t3, t1)
            for r in range(3):
                ow[k, r] = fs[r]+fc[r]; ow[k, 3+r] = ft[r]+ms[r]-t1[r]-t2[r]
            for i in range(n):
                oq[k, i] = q[i]; odq[k, i] = dq[i]; oqdd[k, i] = x[i]; ot[k, i] = tmot[i]-rotIn[i]*x[i]
            oc[k, 0] = dep; oc[k, 1] = s1; oc[k, 2] = s2; oc[k, 3] = N; oc[k, 4] = T1; oc[k, 5] = T2
        for i in range(n):
            dq[i] += dt*x[i]; q[i] += dt*dq[i]
    return oq, odq, oqdd, ot, ow, oc

@njit(cache=True, error_model="numpy", fastmath=True)
def tester_loop(P, G, W, hd, sd, mass, wn, wns, comp, z0, dt, dec):
    n = hd.shape[0]; ns = (n+dec-1)//dec
    o = np.zeros((ns, 9)); S = np.zeros(NS)
    x = hd[0]; v = 0.0; a = sd[0, 0]; b = sd[0, 1]; va = 0.0; vb = 0.0; I0 = 0.0; Ia = 0.0; Ib = 0.0
    u0 = 0.0
    for it in range(n):
        t = it*dt
        N, T1, T2 = law(P, S, G, W, x+z0, v, a, b, va, vb, t, dt)
        e = hd[it]-x; I0 += e*dt
        k = mass*wn*wn
        u = k*e+1.4*mass*wn*(-v+(hd[min(it+1, n-1)]-hd[it])/dt)+k*wn*0.15*I0
        u0 += dt/0.001*(u-u0)
        acc = (u0-N)/mass
        ks = mass*wns*wns
        ea = sd[it, 0]-a; eb = sd[it, 1]-b; Ia += ea*dt; Ib += eb*dt
        j = min(it+1, n-1)
        aa = (ks*ea+1.4*mass*wns*((sd[j, 0]-sd[it, 0])/dt-va)+ks*wns*.15*Ia+T1)/mass
        ab = (ks*eb+1.4*mass*wns*((sd[j, 1]-sd[it, 1])/dt-vb)+ks*wns*.15*Ib+T2)/mass
        if it % dec == 0:
            q = it//dec
            o[q, 0] = x; o[q, 1] = v; o[q, 2] = a; o[q, 3] = b; o[q, 4] = va; o[q, 5] = vb; o[q, 6] = N; o[q, 7] = T1; o[q, 8] = T2
        v += dt*acc; x += dt*v; va += dt*aa; a += dt*va; vb += dt*ab; b += dt*vb
    return o

@njit(cache=True, error_model="numpy", fastmath=True)
def drive_loop(J, qd, Jm, Jl, ke, ce, gap, kp, kd, ki, warm, dt, dec):
    """One axis. ke=0: a single rotor (Jm+Jl). ke>0: link behind a spring ke (dead zone gap). Output q, dq, qdd, torque reading."""
    n = qd.shape[0]; ns = (n+dec-1)//dec
    o = np.zeros((ns, 4)); zb = np.zeros((1, 2)); q = np.array([qd[0]]); dq = np.zeros(1); fr = np.zeros(1); tl = np.zeros(1)
    ql = qd[0]; vl = 0.0; I0 = 0.0; u0 = 0.0; heat = 0.0; Jw = J.copy()
    for it in range(n):
        j = min(it+1, n-1)
        e = qd[it]-q[0]; I0 += e*dt
        u = kp*e+kd*((qd[j]-qd[it])/dt-dq[0])+ki*I0
        u0 += dt/0.0015*(u-u0)
        if warm[0] != 0.0:
            heat += dt*(1.0/warm[1])*(min(1.5, abs(dq[0])*warm[2])-heat)
            for r in (0, 1): Jw[r, 0] = J[r, 0]*(1.0-warm[0]*heat)
        _jf(1, Jw, zb, dq if ke == 0 or gap > 0 else dq, tl, q, dt, fr)
        if ke == 0:
            a = (u0-fr[0])/(Jm+Jl); rd = u0
        else:
            s = q[0]-ql
            if gap > 0:
                s = s-gap if s > gap else (s+gap if s < -gap else 0.0)
            ts = ke*s+ce*(dq[0]-vl) if (s != 0 or gap == 0) else 0.0
            if gap > 0:
                a = (u0-fr[0]-ts)/Jm; rd = u0
                al = ts/Jl
            else:
                a = (u0-ts)/Jm; rd = ts       # reading between gear and link; friction on the link side
                al = (ts-fr[0])/Jl
            vl += dt*al; ql += dt*vl
        tl[0] = rd
        if it % dec == 0:
            k = it//dec
            o[k, 0] = q[0]; o[k, 1] = dq[0]; o[k, 2] = a; o[k, 3] = rd
        dq[0] += dt*a; q[0] += dt*dq[0]
    return o

# ---------- paths
def minjerk(a, b, T, dt):
    n = max(1, int(round(T/dt))); s = np.arange(1, n+1)/n
    k = 10*s**3-15*s**4+6*s**5
    return np.asarray(a)+np.multiply.outer(k, np.asarray(b, float)-np.asarray(a, float))

def trap(a, b, speed, dt, ta=.12):
    """straight move of constant speed with short cosine ends; returns samples"""
    a = np.asarray(a, float); b = np.asarray(b, float); D = np.linalg.norm(b-a); T = max(D/speed, 2*ta)
    v = D/(T-ta) if T > 2*ta else D/ta
    n = max(2, int(round(T/dt))); t = np.arange(1, n+1)*dt
    pos = np.where(t < ta, .5*v/ta*t*t, np.where(t < T-ta, v*(t-ta/2), D-.5*v/ta*(T-t)**2)); pos = np.clip(pos/D, 0, 1) if D > 0 else np.zeros(n)
    return a+np.multiply.outer(pos, b-a)

class Path:
    """points of k coordinates with phase labels at step dt"""
    def __init__(s, p0, dt, ph="free"):
        s.dt = dt; s.x = [np.asarray([p0], float)]; s.ph = [(0, ph)]; s.n = 1; s.f = [np.array([-1.])]
    def _add(s, y, ph, f=-1.):
        s.x.append(y); s.ph.append((s.n, ph)); s.n += len(y); s.f.append(np.full(len(y), f))
    def to(s, p, T, ph, f=-1.): s._add(minjerk(s.x[-1][-1], p, T, s.dt), ph, f); return s
    def line(s, p, v, ph, f=-1.): s._add(trap(s.x[-1][-1], p, v, s.dt), ph, f); return s
    def hold(s, T, ph, f=-1.): s._add(np.repeat(s.x[-1][-1:], max(1, int(T/s.dt)), 0), ph, f); return s
    def fn(s, y, ph, f=-1.): s._add(y, ph, f); return s
    def done(s):
        s.X = np.concatenate(s.x); s.F = np.concatenate(s.f); return s
    def phase(s, t):
        e = np.array([a*s.dt for a, _ in s.ph]); nm = np.array([b for _, b in s.ph])
        return nm[np.clip(np.searchsorted(e, t, side="right")-1, 0, len(nm)-1)]
