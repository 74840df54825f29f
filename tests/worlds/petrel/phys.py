"""Shared physics of petrel: contact law with memory, impedance-controlled tip, kinematics, sensors."""
import numpy as np, math
from numba import njit
PN = ("k n c lam r1 tau1 r2 tau2 hA hL mr mL Fa aL K2 db z0 alpha iA ix iy iw mu cv dmu vs bl ftype vr pexp an C "
      "pl thA thP tx tL wear wL clip").split()
IX = {k: i for i, k in enumerate(PN)}
(k_, n_, c_, lam_, r1_, tau1_, r2_, tau2_, hA_, hL_, mr_, mL_, Fa_, aL_, K2_, db_, z0_, al_, iA_, ix_, iy_, iw_, mu_, cv_, dmu_, vs_, bl_, ft_,
 vr_, pe_, an_, C_, pl_, thA_, thP_, tx_, tL_, we_, wL_, cl_) = range(len(PN))
def P(**kw):
    p = np.zeros(len(PN))
    for a, b in dict(n=1., tau1=1., tau2=1., hL=1e-3, mL=1e-3, aL=1e-3, db=1., iw=1., vs=.01, bl=1e-4, vr=1e-3, thP=60., tL=.01, wL=1.).items(): p[IX[a]] = b
    for a, b in kw.items(): p[IX[a]] = b
    return p
@njit
def step(z, p, dt, t, d, dd, s1, s2, v1, v2):
    d = d + p[z0_] + p[thA_] * math.sin(2 * math.pi * t / p[thP_]) - p[C_] * z[7]
    if d > z[3]: z[3] = d
    d = d - p[pl_] * z[3]
    fe = 0.; N = 0.
    if d > 0:
        fe = p[k_] * d ** p[n_] * (1 + p[al_] * t / 60)
        if p[iA_] != 0.: fe *= 1 + p[iA_] * math.exp(-((s1 - p[ix_]) ** 2 + (s2 - p[iy_]) ** 2) / (2 * p[iw_] ** 2))
        u = z[3] - d
        if u > 0 and p[mr_] != 0.: fe *= 1 - p[mr_] * (1 - math.exp(-u / p[mL_]))
        if d > p[db_]: fe += p[K2_] * (d - p[db_])
    df = fe - z[6]; z[6] = fe
    e = math.exp(-dt / p[tau1_]); z[0] = z[0] * e + p[r1_] * df * (1 + e) / 2
    e = math.exp(-dt / p[tau2_]); z[1] = z[1] * e + p[r2_] * df * (1 + e) / 2
    if d > 0:
        N = fe + z[0] + z[1] + (p[c_] + p[lam_] * fe) * dd
        if p[hA_] != 0.:
            x = dd * dt / p[hL_]; a = math.exp(-abs(x)); sg = 1. if x > 0 else -1.
            z[2] = sg + (z[2] - sg) * a
            N += p[hA_] * z[2] * (1 - math.exp(-d / p[hL_]))
    else: z[2] = 0.
    if p[Fa_] != 0.:
        if d > 0: z[8] = 1.
        if d > 0: N = max(N, 0.) - p[Fa_]
        elif z[8] > 0 and d > -p[aL_]: N = -p[Fa_] * (1 + d / p[aL_])
        else: z[8] = 0.; N = 0.
    elif N < 0: N = 0.
    z[7] = .5 * z[7] + .5 * N
    T1 = 0.; T2 = 0.
    v = math.sqrt(v1 * v1 + v2 * v2)
    if N > 0 and d > 0:
        z[9] += v * dt
        mu = (p[mu_] + p[dmu_] * math.exp(-(v / p[vs_]) ** 2)) * (1 - p[we_] * (1 - math.exp(-z[9] / p[wL_])))
        if p[pe_] != 0.: mu *= (N / 5.) ** p[pe_]
        if p[ft_] == 0.:
            z[4] += v1 * dt / p[bl_]; z[5] += v2 * dt / p[bl_]
            a = math.sqrt(z[4] ** 2 + z[5] ** 2)
            if a > 1: z[4] /= a; z[5] /= a
            b1 = z[4]; b2 = z[5]
        elif p[ft_] == 1.:
            a = math.exp(-v * dt / p[bl_])
            if v > 1e-12: z[4] = v1 / v + (z[4] - v1 / v) * a; z[5] = v2 / v + (z[5] - v2 / v) * a
            b1 = z[4]; b2 = z[5]
        else:
            a = math.sqrt(v * v + p[vr_] ** 2); b1 = v1 / a; b2 = v2 / a
        T1 = -mu * N * b1 * (1 + p[an_]) - p[cv_] * v1 + p[tx_] * N * math.sin(2 * math.pi * s1 / p[tL_])
        T2 = -mu * N * b2 * (1 - p[an_]) - p[cv_] * v2
    else: z[4] = 0.; z[5] = 0.
    return N, T1, T2
@njit
def driven(p, t, d, dd, s1, s2, v1, v2):
    n = len(t); o = np.zeros((n, 3)); z = np.zeros(10)
    for i in range(n):
        dt = t[i] - t[i - 1] if i > 0 else t[1] - t[0]
        a, b, c = step(z, p, dt, t[i], d[i], dd[i], s1[i], s2[i], v1[i], v2[i]); o[i, 0] = a; o[i, 1] = b; o[i, 2] = c
    return o
@njit
def simulate(p, dt, ref, m, Kd, Kt, zeta, keep):
    """Heun predictor-corrector of the impedance-controlled tip; velocity feedforward."""
    n = ref.shape[0]; out = np.zeros((n // keep + 1, 9)); z = np.zeros(10)
    x = ref[0].copy(); v = np.zeros(3); K = np.array([Kd, Kt, Kt]); F = np.zeros(3); j = 0
    for i in range(n):
        N, T1, T2 = step(z, p, dt, i * dt, x[0], v[0], x[1], x[2], v[1], v[2])
        F[0] = -N; F[1] = T1; F[2] = T2
        if i % keep == 0:
            for q in range(3): out[j, q] = x[q]; out[j, 3 + q] = v[q]
            out[j, 6] = N; out[j, 7] = T1; out[j, 8] = T2; j += 1
        for q in range(3):
            D = 2 * zeta * math.sqrt(K[q] * m); i2 = min(i + 1, n - 1)
            vr = (ref[i2, q] - ref[i, q]) / dt
            a0 = (K[q] * (ref[i, q] - x[q]) + D * (vr - v[q]) + F[q]) / m
            xp = x[q] + dt * v[q]; vp = v[q] + dt * a0
            a1 = (K[q] * (ref[i2, q] - xp) + D * (vr - vp) + F[q]) / m
            x[q] += dt * (v[q] + vp) / 2; v[q] += dt * (a0 + a1) / 2
    return out[:j]
# ---------- kinematics
def rot(ax, a):
    a = np.asarray(a); c, s = np.cos(a), np.sin(a); x, y, z = ax; C = 1 - c
    return np.stack([np.stack([c+x*x*C, x*y*C-z*s, x*z*C+y*s], -1), np.stack([y*x*C+z*s, c+y*y*C, y*z*C-x*s], -1), np.stack([z*x*C-y*s, z*y*C+x*s, c+z*z*C], -1)], -2)
import json, os
HERE = os.path.dirname(os.path.abspath(__file__))
_l = json.load(open(os.path.join(HERE, os.pardir, "foundry", "lwr4plus_inertia.json")))
LWR = dict(name="lwr", org=[(0,0,.11),(0,0,.2005),(0,0,.2),(0,0,.2),(0,0,.2),(0,0,.19),(0,0,.078)], ax=[(0,0,1),(0,-1,0),(0,0,1),(0,1,0),(0,0,1),(0,-1,0),(0,0,1)],
    links=[(a["m"], a["com"], a["I"]) for a in _l], fl=(0,0,0,0,0,0), seed=np.radians([8,30,0,-85,5,65,10]), free=[0,1,3,4,5,6])
UR = dict(name="heron6", org=[(0,0,.095),(0,.13,0),(0,-.115,.44),(0,0,.385),(0,.09,0),(0,0,.096)], ax=[(0,0,1),(0,1,0),(0,1,0),(0,1,0),(0,0,1),(0,1,0)],
    links=[(3.9,(0,-.02,.0),(.011,.011,.0075,0,0,0)),(8.1,(0,0,.21),(.135,.135,.015,0,0,0)),(2.4,(0,0,.14),(.031,.031,.0042,0,0,0)),(1.25,(0,.06,.0),(.0025,.0022,.0025,0,0,0)),(1.2,(0,0,.06),(.0025,.0025,.0021,0,0,0)),(.2,(0,.05,0),(.0002,.0002,.0002,0,0,0))],
    fl=(0,.082,0,-np.pi/2,0,0), seed=np.radians([15,30,80,-20,-90,10]), free=[0,1,2,3,4,5])
FT = .014; TIP = {"lwr": .11, "heron6": .135}
def fk(rb, q):
    """sensor rotation (N,3,3), tip position (N,3), jacobian of tip (N,6,n)"""
    q = np.atleast_2d(q); N = len(q); R = np.broadcast_to(np.eye(3), (N,3,3)); x = np.zeros((N,3)); ps, zs = [], []
    for o, a, qi in zip(rb["org"], rb["ax"], q.T):
        x = x + R @ np.array(o); zs.append(R @ np.array(a, float)); ps.append(x); R = R @ rot(a, qi)
    x = x + R @ np.array(rb["fl"][:3], float); R = R @ rot((1,0,0), rb["fl"][3]); x = x + R @ np.array([0,0,FT+TIP[rb["name"]]])
    J = np.stack([np.concatenate([np.cross(zz, x-pp), zz], -1) for zz, pp in zip(zs, ps)], -1)
    return R, x, J
def ik(rb, q0, Rd, xd, it=7):
    q = np.broadcast_to(q0, (len(xd), len(q0))).copy()
    for _ in range(it):
        R, x, J = fk(rb, q); E = Rd @ np.swapaxes(R, 1, 2)
        w = .5*np.stack([E[:,2,1]-E[:,1,2], E[:,0,2]-E[:,2,0], E[:,1,0]-E[:,0,1]], -1)
        J = J[:, :, rb["free"]]
        q[:, rb["free"]] += np.linalg.solve(J + 1e-9*np.eye(6), np.concatenate([xd-x, w], -1)[..., None])[..., 0]
    return q
def urdf(rb):
    s = [f'<robot name="{rb["name"]}"><link name="base_link"/>']; par = "base_link"
    for i, (o, a, (m, c, I)) in enumerate(zip(rb["org"], rb["ax"], rb["links"]), 1):
        f = lambda v: " ".join("%.9g" % x for x in v)
        s.append(f'<link name="link_{i}"><inertial><origin xyz="{f(c)}" rpy="0 0 0"/><mass value="{m}"/><inertia ixx="{I[0]}" iyy="{I[1]}" izz="{I[2]}" ixy="{I[3]}" ixz="{I[4]}" iyz="{I[5]}"/></inertial></link>')
        s.append(f'<joint name="joint_{i}" type="revolute"><parent link="{par}"/><child link="link_{i}"/><origin xyz="{f(o)}" rpy="0 0 0"/><axis xyz="{f(a)}"/><limit lower="-6.3" upper="6.3" effort="300" velocity="4"/></joint>'); par = f"link_{i}"
    for nm, pr, o in (("flange", par, rb["fl"]), ("ft_sensor", "flange", (0,0,FT,0,0,0)), ("tool_tip", "ft_sensor", (0,0,TIP[rb["name"]],0,0,0))):
        s.append(f'<link name="{nm}"/><joint name="to_{nm}" type="fixed"><parent link="{pr}"/><child link="{nm}"/><origin xyz="{o[0]} {o[1]} {o[2]}" rpy="{o[3]} {o[4]} {o[5]}"/></joint>')
    return "\n".join(s) + "</robot>\n"
def skew3(v): return rot_small(v)
def rot_small(v):
    a = np.linalg.norm(v); return rot(np.asarray(v)/a, a) if a > 1e-12 else np.eye(3)
def wrench(R, Fc, acom, tool, g, off, tip):
    """ideal reading: tool = (m, com); off: tip offset in the tool frame"""
    m, com = tool; ft = np.einsum('nji,nj->ni', R, m*(g-acom)); fc = np.einsum('nji,nj->ni', R, Fc)
    r = np.array([0,0,tip]) + off
    return np.concatenate([ft+fc, np.cross(com, ft)+np.cross(r, fc)], 1)
def sensor(W, t, s):
    """s: dict gain, mis(3), X(6,6) off-diagonal, lag, bias(6), drift(6)/min, hum(6), humf"""
    W = W.copy()
    if "X" in s: W = W + W @ np.asarray(s["X"]).T
    if "mis" in s:
        A = rot_small(s["mis"]); W = np.concatenate([W[:, :3] @ A.T, W[:, 3:] @ A.T], 1)
    if "gain" in s: W = W*(1+s["gain"])
    if s.get("lag", 0) > 0:
        e = np.exp(-np.diff(t, prepend=t[0])/s["lag"])
        for i in range(1, len(W)): W[i] = e[i]*W[i-1] + (1-e[i])*W[i]
    if "bias" in s: W = W+s["bias"]
    if "drift" in s: W = W+np.outer(t/60, s["drift"])
    if "hum" in s: W = W + np.outer(np.sin(2*np.pi*s["humf"]*t), s["hum"][0]) + np.outer(np.cos(2*np.pi*s["humf"]*t), s["hum"][1])
    return W
