"""osprey: arms, contact law with memory, closed-loop contact simulation, joint simulation. No code of any project is used."""
import json, math, os
import numpy as np
from numba import njit

HERE = os.path.dirname(os.path.abspath(__file__))
GIVEN = os.path.join(HERE, "..", "foundry", "lwr4plus_inertia.json")


# ------------------------------------------------------------------ chains
def rpy(r, p, y):
    cr, sr, cp, sp, cy, sy = math.cos(r), math.sin(r), math.cos(p), math.sin(p), math.cos(y), math.sin(y)
    return np.array([[cy*cp, cy*sp*sr-sy*cr, cy*sp*cr+sy*sr], [sy*cp, sy*sp*sr+cy*cr, sy*sp*cr-cy*sr], [-sp, cp*sr, cp*cr]])


class Chain:
    """joints: list of (xyz, axis); links: list of (m, com, I6 [xx yy zz xy xz yz]); sensor frame by (xyz, yaw) from the last link; tip by r_tip."""
    def __init__(self, name, joints, links, flange, sensor, r_tip, base_m=2.0):
        self.name, self.joints, self.links, self.flange, self.sensor = name, joints, links, flange, sensor
        self.r_tip = np.asarray(r_tip, float)
        self.n = len(joints)
        self.P = np.array([j[0] for j in joints], float)
        self.A = np.array([j[1] for j in joints], float)
        self.Rs = rpy(0, 0, sensor[1])
        self.ps = np.asarray(flange, float) + np.asarray(sensor[0], float)

    def urdf(self):
        s = ['<?xml version="1.0"?>', f'<robot name="{self.name}">', '  <link name="base_link"/>']
        for i, (m, c, I) in enumerate(self.links):
            s.append(f'  <link name="link_{i+1}"><inertial><origin xyz="{c[0]:.6g} {c[1]:.6g} {c[2]:.6g}" rpy="0 0 0"/><mass value="{m:.6g}"/>'
                     f'<inertia ixx="{I[0]:.8g}" iyy="{I[1]:.8g}" izz="{I[2]:.8g}" ixy="{I[3]:.8g}" ixz="{I[4]:.8g}" iyz="{I[5]:.8g}"/></inertial></link>')
        for i, (x, a) in enumerate(self.joints):
            par = "base_link" if i == 0 else f"link_{i}"
            s.append(f'  <joint name="joint_{i+1}" type="revolute"><parent link="{par}"/><child link="link_{i+1}"/><origin xyz="{x[0]:.9g} {x[1]:.9g} {x[2]:.9g}" rpy="0 0 0"/>'
                     f'<axis xyz="{a[0]:g} {a[1]:g} {a[2]:g}"/><limit lower="-6.2" upper="6.2" effort="200" velocity="6"/></joint>')
        f, (sx, yaw), r = self.flange, self.sensor, self.r_tip
        for nm, par, x, y in (("flange", f"link_{self.n}", f, 0), ("ft_sensor", "flange", sx, yaw), ("tool_tip", "ft_sensor", r, 0)):
            s.append(f'  <link name="{nm}"/>')
            s.append(f'  <joint name="{nm}_fixed" type="fixed"><parent link="{par}"/><child link="{nm}"/><origin xyz="{x[0]:.9g} {x[1]:.9g} {x[2]:.9g}" rpy="0 0 {y:.9g}"/></joint>')
        return "\n".join(s + ["</robot>"]) + "\n"

    def fk(self, Q):
        """sensor rotation (M,3,3) and sensor origin (M,3)"""
        return _fk_many(np.ascontiguousarray(Q), self.P, self.A, self.Rs, self.ps)

    def start(self, R, p, rng):
        for k in range(300):
            q0 = rng.uniform(-1.6, 1.6, self.n)
            q0[0] = rng.uniform(-2.5, 2.5)
            q, e = _ik(q0, R, p, self.P, self.A, self.Rs, self.ps, 60)
            if e < 1e-9 and np.abs(q).max() < 2.8:
                J = _jac(q, self.P, self.A, self.Rs, self.ps)[0]
                if np.linalg.svd(J)[1][5] > 0.07:
                    return q
        return None

    def track(self, R, p, q0):
        return _ik_many(q0, R, p, self.P, self.A, self.Rs, self.ps)


@njit(cache=True, fastmath=True)
def _rod(a, th):
    c, s = math.cos(th), math.sin(th)
    v = 1-c
    R = np.empty((3, 3))
    x, y, z = a[0], a[1], a[2]
    R[0, 0] = c+x*x*v; R[0, 1] = x*y*v-z*s; R[0, 2] = x*z*v+y*s
    R[1, 0] = y*x*v+z*s; R[1, 1] = c+y*y*v; R[1, 2] = y*z*v-x*s
    R[2, 0] = z*x*v-y*s; R[2, 1] = z*y*v+x*s; R[2, 2] = c+z*z*v
    return R


@njit(cache=True)
def _jac(q, P, A, Rs, ps):
    n = len(q)
    R = np.eye(3); p = np.zeros(3)
    ax = np.empty((n, 3)); o = np.empty((n, 3))
    for i in range(n):
        p = p + R @ P[i]
        ax[i] = R @ A[i]
        o[i] = p
        R = R @ _rod(A[i], q[i])
    p = p + R @ ps
    R = R @ Rs
    J = np.empty((6, n))
    for i in range(n):
        d = p - o[i]
        a = ax[i]
        J[0, i] = a[1]*d[2]-a[2]*d[1]; J[1, i] = a[2]*d[0]-a[0]*d[2]; J[2, i] = a[0]*d[1]-a[1]*d[0]
        J[3:, i] = a
    return J, R, p


@njit(cache=True)
def _ik(q0, Rd, pd, P, A, Rs, ps, it):
    q = q0.copy(); err = 1.0
    for k in range(it):
        J, R, p = _jac(q, P, A, Rs, ps)
        e = np.empty(6)
        e[:3] = pd - p
        E = Rd @ R.T
        e[3] = .5*(E[2, 1]-E[1, 2]); e[4] = .5*(E[0, 2]-E[2, 0]); e[5] = .5*(E[1, 0]-E[0, 1])
        tr = E[0, 0]+E[1, 1]+E[2, 2]
        if tr < 0.:
            e[3:] *= 2.
        err = np.sqrt((e*e).sum()) + (1. if tr < 0 else 0.)
        if err < 1e-11:
            break
        lam = 1e-3*min(err*err, 1.)+1e-12
        dq = J.T @ np.linalg.solve(J @ J.T + lam*np.eye(6), e)
        m = np.abs(dq).max()
        if m > .3:
            dq *= .3/m
        q += dq
    return q, err


@njit(cache=True)
def _ik_many(q0, R, p, P, A, Rs, ps):
    M = len(p)
    Q = np.empty((M, len(q0))); q = q0.copy(); worst = 0.
    for i in range(M):
        q, e = _ik(q, R[i], p[i], P, A, Rs, ps, 30)
        Q[i] = q
        if e > worst:
            worst = e
    return Q, worst


@njit(cache=True)
def _fk_many(Q, P, A, Rs, ps):
    M, n = Q.shape
    RR = np.empty((M, 3, 3)); pp = np.empty((M, 3))
    for k in range(M):
        R = np.eye(3); p = np.zeros(3)
        for i in range(n):
            p = p + R @ P[i]
            R = R @ _rod(A[i], Q[k, i])
        pp[k] = p + R @ ps
        RR[k] = R @ Rs
    return RR, pp


def lwr(rng, r_tip):
    z, y, my = [0, 0, 1], [0, 1, 0], [0, -1, 0]
    off = [.11, .2005, .20, .20, .20, .19, 0.0]
    # joint frames: joint_7 at the wrist centre is folded into the 0.078 flange: link 7 frame at the flange face less 0.078 -> as the table wants
    off = [.11, .2005, .20, .20, .20, .19, .078]
    ax = [z, my, z, y, z, my, z]
    L = json.load(open(GIVEN))
    return Chain("lwr4plus_osprey", [([0, 0, o], a) for o, a in zip(off, ax)], [(l["m"], l["com"], l["I"]) for l in L], [0, 0, 0],
                 ([0, 0, round(rng.uniform(.02, .05), 4)], round(rng.choice([0, .3491, .7854]), 4)), r_tip)


def own_arm(rng, r_tip):
    z, y = [0, 0, 1], [0, 1, 0]
    l = [rng.uniform(.16, .3), rng.uniform(.08, .14), rng.uniform(.32, .45), rng.uniform(.12, .2), rng.uniform(.15, .22), rng.uniform(.07, .11)]
    oy = rng.uniform(-.05, .05, 6).round(4)
    joints = [([0, 0, round(l[0], 4)], z), ([0, oy[1], round(l[1], 4)], y), ([0, oy[2], round(l[2], 4)], y),
              ([0, oy[3], round(l[3], 4)], z), ([0, 0, round(l[4], 4)], y), ([0, oy[5]/2, round(l[5], 4)], z)]
    ms = np.array([5.5, 6.5, 4., 2.4, 1.6, .5])*rng.uniform(.8, 1.3)
    links = []
    for i, m in enumerate(ms):
        h = [l[1], l[2], l[3], l[4], l[5], .05][i]
        c = [rng.uniform(-.01, .01), rng.uniform(-.02, .02), h*rng.uniform(.35, .55)]
        r = .055
        I = [m*(3*r*r+h*h)/12, m*(3*r*r+h*h)/12, m*r*r/2, 0, 0, 0]
        links.append((round(float(m), 4), [round(float(v), 5) for v in c], [round(float(v), 7) for v in I]))
    return Chain("grebe6", joints, links, [0, 0, .04], ([0, 0, round(rng.uniform(.01, .04), 4)], 0.0), r_tip)


# ------------------------------------------------------------------ contact law
NAMES = "K N C LAM R1 T1 R2 T2 HA HL MR ML AF AL LK LD DR IK IA IX IY IW MU FT FL VF DMU VS LP LN0 AN VR Z0 SIG EPS PL MAG MAGL".split()
IX = {n: i for i, n in enumerate(NAMES)}
(K, N, C, LAM, R1, T1, R2, T2, HA, HL, MR, ML, AF, AL, LK, LD, DR, IK, IA, IXX, IY, IW, MU, FT, FL, VF, DMU, VS, LP, LN0, AN, VR, Z0, SIG, EPS, PL, MAG, MAGL) = range(len(NAMES))


def law(**kw):
    P = np.zeros(len(NAMES))
    P[N] = 1; P[T1] = P[T2] = 1; P[HL] = P[ML] = P[AL] = 1e-3; P[LD] = 1; P[IW] = .01; P[FL] = 1e-4; P[VS] = .01; P[LN0] = 1; P[VR] = 1e-3; P[MAGL] = 1
    for k, v in kw.items():
        P[IX[k]] = v
    return P


@njit(cache=True)
def step(S, P, dt, t, d0, dd, s1, s2, v1, v2):
    d = d0 + P[Z0] - S[9]          # S[9]: plastic set (outside the catalogue)
    mult = 1. + P[DR]*t
    ik = int(P[IK])
    if ik == 1:                    # edge along s1
        mult *= 1. + P[IA]*.5*(1.+math.tanh((s1-P[IXX])/P[IW]))
    elif ik == 2:                  # inclusion
        mult *= 1. + P[IA]*math.exp(-.5*((s1-P[IXX])**2+(s2-P[IY])**2)/P[IW]**2)
    elif ik == 3:                  # gradient
        mult *= 1. + P[IA]*(s1-P[IXX])/P[IW]
    fe = 0.
    if d > 0.:
        fe = P[K]*d**P[N]*(1.+P[EPS]*d)
        if d > P[LD]:
            fe += P[LK]*(d-P[LD])
        fe *= mult
        if d > S[3]:
            S[3] = d
        if P[MR] != 0.:
            fe *= 1. - P[MR]*(1.-math.exp(-(S[3]-d)/P[ML]))
        if P[PL] > 0.:
            S[9] += P[PL]*fe*dt
    dfe = fe - S[7]
    S[7] = fe
    tot = fe
    if P[R1] != 0.:
        e = math.exp(-.5*dt/P[T1])
        S[0] = (S[0]*e + P[R1]*dfe)*e
        tot += S[0]
    if P[R2] != 0.:
        e = math.exp(-.5*dt/P[T2])
        S[1] = (S[1]*e + P[R2]*dfe)*e
        tot += S[1]
    if d > 0.:
        tot += P[C]*dd + P[LAM]*fe*dd
        if P[HA] != 0.:
            sg = 1. if dd > 0 else -1.
            S[2] = sg + (S[2]-sg)*math.exp(-abs(dd)*dt/P[HL])
            tot += P[HA]*S[2]
    else:
        S[2] = 0.
    low = 0.
    if P[AF] != 0.:
        if d > 0.:
            S[4] = max(S[4], min(1., d/P[AL]))
            tot -= P[AF]*S[4]
            low = -P[AF]*S[4]
        elif d > -P[AL] and S[4] > 0.:
            tot = -P[AF]*S[4]*(1.+d/P[AL])
            low = tot
        else:
            S[4] = 0.
            tot = 0.
    elif d <= 0.:
        tot = 0.
    if tot < low:
        tot = low
    Nn = tot
    if P[MAG] != 0. and d <= 0.:
        Nn -= P[MAG]/(1.-d/P[MAGL])**2
    elif P[MAG] != 0.:
        Nn -= P[MAG]
    F1 = 0.; F2 = 0.
    Np = max(tot, 0.)
    if Np > 0.:
        v = math.sqrt(v1*v1+v2*v2)
        mu = P[MU]
        if P[DMU] != 0.:
            mu += P[DMU]*math.exp(-(v/P[VS])**2)
        if P[LP] != 0.:
            mu *= (Np/P[LN0])**P[LP]
        ft = int(P[FT]); L = P[FL]
        g1 = 0.; g2 = 0.
        if ft == 3:
            r = math.sqrt(v*v+P[VR]**2)
            g1 = v1/r; g2 = v2/r
        else:
            if ft == 1:
                S[5] += v1*dt/L; S[6] += v2*dt/L
                m = math.sqrt(S[5]**2+S[6]**2)
                if m > 1.:
                    S[5] /= m; S[6] /= m
            else:
                a = 1.+v*dt/L
                S[5] = (S[5]+v1*dt/L)/a; S[6] = (S[6]+v2*dt/L)/a
            g1 = S[5]; g2 = S[6]
            if ft == 2:
                g1 += P[SIG]*(v1-v*S[5])/L; g2 += P[SIG]*(v2-v*S[6])/L
        F1 = -mu*(1.+P[AN])*Np*g1 - P[VF]*v1
        F2 = -mu*(1.-P[AN])*Np*g2 - P[VF]*v2
    else:
        S[5] = 0.; S[6] = 0.
    return Nn, F1, F2


@njit(cache=True)
def openloop(t, d, dd, s1, s2, v1, v2, P):
    M = len(t)
    out = np.zeros((M, 3))
    S = np.zeros(10)
    for i in range(M):
        dt = t[i]-t[i-1] if i > 0 else 0.
        sub = 1
        if dt > 2e-3 and i > 0:
            sub = min(int(dt/2e-3)+1, 20)
        for j in range(sub):
            w = (j+1.)/sub
            if i > 0 and sub > 1:
                u = 1.-w
                a, b, c = step(S, P, dt/sub, t[i-1]*u+t[i]*w, d[i-1]*u+d[i]*w, dd[i-1]*u+dd[i]*w, s1[i-1]*u+s1[i]*w, s2[i-1]*u+s2[i]*w,
                               v1[i-1]*u+v1[i]*w, v2[i-1]*u+v2[i]*w)
            else:
                a, b, c = step(S, P, dt, t[i], d[i], dd[i], s1[i], s2[i], v1[i], v2[i])
        out[i, 0] = a; out[i, 1] = b; out[i, 2] = c
    return out


@njit(cache=True)
def closedloop(cmd, dtc, sub, every, P, Mt, Kn, Kt, zn, rigid):
    """cmd (M,3) desired depth, slip1, slip2 at step dtc, each integrated in `sub` steps; returns every `every`-th row: pos3 vel3 acc3 N T1 T2"""
    M = len(cmd)
    rows = M//every
    out = np.zeros((rows, 12))
    x = cmd[0].copy(); v = np.zeros(3)
    S = np.zeros(10)
    dt = dtc/sub
    Dn = 2*zn*math.sqrt(Kn*Mt); Dt = 2*zn*math.sqrt(Kt*Mt)
    f0 = 0.; f1 = 0.; f2 = 0.; a0 = 0.; a1 = 0.; a2 = 0.
    for i in range(M):
        j = min(i+1, M-1)
        vc0 = (cmd[j, 0]-cmd[i, 0])/dtc; vc1 = (cmd[j, 1]-cmd[i, 1])/dtc; vc2 = (cmd[j, 2]-cmd[i, 2])/dtc
        for k in range(sub):
            u = k/sub
            f0, f1, f2 = step(S, P, dt, (i+u)*dtc, x[0], v[0], x[1], x[2], v[1], v[2])
            a0 = (Kn*(cmd[i, 0]+vc0*u*dtc-x[0]) + Dn*(vc0-v[0]) - f0)/Mt
            a1 = (Kt*(cmd[i, 1]+vc1*u*dtc-x[1]) + Dt*(vc1-v[1]) + f1)/Mt
            a2 = (Kt*(cmd[i, 2]+vc2*u*dtc-x[2]) + Dt*(vc2-v[2]) + f2)/Mt
            if k == 0 and i % every == 0 and i//every < rows:
                r = i//every
                out[r, 0:3] = x; out[r, 3:6] = v
                out[r, 6] = a0; out[r, 7] = a1; out[r, 8] = a2
                out[r, 9] = f0; out[r, 10] = f1; out[r, 11] = f2
            v[0] += a0*dt; v[1] += a1*dt; v[2] += a2*dt
            x[0] += v[0]*dt; x[1] += v[1]*dt; x[2] += v[2]*dt
    return out


@njit(cache=True)
def lowpass(t, y, tau):
    """exact first-order low-pass of piecewise linear columns at any sampling"""
    o = y.copy()
    if tau <= 0.:
        return o
    for i in range(1, len(t)):
        h = t[i]-t[i-1]
        e = math.exp(-h/tau)
        for j in range(y.shape[1]):
            s = (y[i, j]-y[i-1, j])/h
            o[i, j] = y[i, j]-s*tau + (o[i-1, j]-(y[i-1, j]-s*tau))*e
    return o


@njit(cache=True)
def jointsim(qd, dtc, J, wn, zeta, Fc, Fp, Fv, L, ft, vr, dF, vs):
    """decoupled joints: J q'' = servo - friction; friction with bristles. Fc for v>0, Fp for v<0. Returns q, dq, ddq, friction"""
    M, n = qd.shape
    o = np.zeros((M, 4, n))
    for j in range(n):
        x = qd[0, j]; v = 0.; z = 0.
        for i in range(M):
            k = min(i+1, M-1)
            vd = (qd[k, j]-qd[i, j])/dtc
            sub = 4
            h = dtc/sub
            f = 0.; a = 0.
            for s in range(sub):
                mag = (Fc[j] if z > 0 else Fp[j]) + dF[j]*math.exp(-(v/vs)**2)
                if ft == 3:
                    g = v/math.sqrt(v*v+vr*vr)
                    mag = (Fc[j] if v > 0 else Fp[j]) + dF[j]*math.exp(-(v/vs)**2)
                elif ft == 1:
                    z = min(1., max(-1., z+v*h/L)); g = z
                else:
                    z = (z+v*h/L)/(1.+abs(v)*h/L); g = z
                f = mag*g + Fv[j]*v
                a = wn*wn*(qd[i, j]+vd*s*h-x) + 2*zeta*wn*(vd-v) - f/J[j]
                if s == 0:
                    o[i, 0, j] = x; o[i, 1, j] = v; o[i, 2, j] = a; o[i, 3, j] = f
                v += a*h; x += v*h
    return o


def minjerk(tw, W, t):
    """waypoints at tw, rows W; rest at each"""
    k = np.clip(np.searchsorted(tw, t, side="right")-1, 0, len(tw)-2)
    u = np.clip((t-tw[k])/(tw[k+1]-tw[k]), 0, 1)
    b = (10*u**3-15*u**4+6*u**5)[:, None]
    return W[k]*(1-b)+W[k+1]*b


def ramp(tw, W, t, acc=.2):
    """waypoints joined at constant speed with blended ends (fraction acc): constant-speed slides"""
    k = np.clip(np.searchsorted(tw, t, side="right")-1, 0, len(tw)-2)
    u = np.clip((t-tw[k])/(tw[k+1]-tw[k]), 0, 1)
    a = acc
    vm = 1/(1-a)
    b = np.where(u < a, vm*u*u/(2*a), np.where(u > 1-a, 1-vm*(1-u)**2/(2*a), vm*(u-a/2)))[:, None]
    return W[k]*(1-b)+W[k+1]*b
