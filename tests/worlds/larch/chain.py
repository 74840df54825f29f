"""Two serial arms, their URDF, and world-frame rigid-body dynamics in numba (own code; check.py tests it against Pinocchio)."""
import json, os
import numpy as np
from numba import njit
HERE = os.path.dirname(os.path.abspath(__file__))
INERTIA = os.path.join(HERE, os.pardir, "foundry", "lwr4plus_inertia.json")

def rpy(r, p, y):
    cr, sr, cp, sp, cy, sy = np.cos(r), np.sin(r), np.cos(p), np.sin(p), np.cos(y), np.sin(y)
    return np.array([[cy*cp, cy*sp*sr-sy*cr, cy*sp*cr+sy*sr], [sy*cp, sy*sp*sr+cy*cr, sy*sp*cr-cy*sr], [-sp, cp*sr, cp*cr]])

def inertia(v):  # xx yy zz xy xz yz
    return np.array([[v[0], v[3], v[4]], [v[3], v[1], v[5]], [v[4], v[5], v[2]]], float)

class Arm:
    pass

def lwr():
    a = Arm(); a.name = "lwr_larch"; a.n = 7; d = json.load(open(INERTIA))
    z = [.11, .2005, .20, .20, .20, .19, .078]
    a.xyz = np.array([[0, 0, v] for v in z]); a.rpy = np.zeros((7, 3))
    a.axis = np.array([[0, 0, 1], [0, -1, 0], [0, 0, 1], [0, 1, 0], [0, 0, 1], [0, -1, 0], [0, 0, 1]], float)
    a.mass = np.array([x["m"] for x in d]); a.com = np.array([x["com"] for x in d]); a.I = np.array([inertia(x["I"]) for x in d])
    a.jn = ["joint_%d" % (i+1) for i in range(7)]; a.base = "base_link"
    a.ft = (np.array([0, 0, .018]), np.array([0, 0, .349])); a.ftname = "ft_sensor"; a.tip_z = .098; a.tipname = "tool_tip"
    a.seed = np.array([.25, .52, -.15, -1.52, .1, 1.08, .2]); a.lim = np.array([2.9, 2.0, 2.9, 2.0, 2.9, 2.0, 2.9])
    a.rot_in = np.array([.9, .9, .5, .5, .2, .13, .13]); a.tmax = np.array([176, 176, 100, 100, 100, 38, 38.])
    a.taunoise = np.array([.07, .07, .04, .04, .04, .015, .012])
    return a

def larch6():
    h = np.pi/2
    a = Arm(); a.name = "larch6"; a.n = 6
    a.xyz = np.array([[0, 0, .24], [.06, 0, .19], [.02, -.42, 0], [0, -.16, 0], [0, 0, .22], [0, -.09, 0]])
    a.rpy = np.array([[0, 0, 0], [-h, 0, 0], [0, 0, 0], [h, 0, 0], [-h, 0, 0], [h, 0, 0]])
    a.axis = np.tile([0, 0, 1.], (6, 1))
    a.mass = np.array([8.2, 7.1, 3.9, 2.3, 1.3, .45])
    a.com = np.array([[.02, .005, .07], [.01, -.19, .03], [-.004, -.07, -.01], [.003, 0, .11], [0, -.03, .006], [0, .002, .02]])
    a.I = np.array([inertia(v) for v in [[.055, .06, .045, .001, -.006, 0], [.13, .022, .135, .004, 0, .002], [.021, .009, .022, 0, .0005, -.001],
                    [.011, .011, .0035, 0, -.0002, .0001], [.0026, .0016, .0027, 0, 0, .0001], [.0004, .0004, .0005, 0, 0, 0]]])
    a.jn = ["waist", "shoulder", "elbow", "roll", "bend", "turn"]; a.base = "pedestal"
    a.ft = (np.array([0, 0, .074]), np.array([0, 0, -.61])); a.ftname = "wrist_ft"; a.tip_z = .132; a.tipname = "probe"
    a.seed = np.array([.2, .35, 1.75, .12, 1.04, .3]); a.lim = np.array([2.9, 1.6, 2.2, 2.9, 1.9, 2.9])
    a.rot_in = np.array([.8, .9, .5, .2, .12, .08]); a.tmax = np.array([200, 200, 120, 60, 40, 25.])
    a.taunoise = np.array([.09, .09, .05, .03, .02, .012])
    return a

ARMS = {"lwr": lwr, "six": larch6}

def write_urdf(a, path, tool_tip_z=None):
    s = ['<?xml version="1.0"?>', '<robot name="%s">' % a.name, '  <link name="%s"/>' % a.base]
    f = lambda v: " ".join("%.9g" % x for x in v)
    par = a.base
    for i in range(a.n):
        I = a.I[i]
        s += ['  <link name="link_%d"><inertial><origin xyz="%s" rpy="0 0 0"/><mass value="%.9g"/><inertia ixx="%.9g" iyy="%.9g" izz="%.9g" ixy="%.9g" ixz="%.9g" iyz="%.9g"/></inertial></link>'
              % (i+1, f(a.com[i]), a.mass[i], I[0, 0], I[1, 1], I[2, 2], I[0, 1], I[0, 2], I[1, 2]),
              '  <joint name="%s" type="revolute"><parent link="%s"/><child link="link_%d"/><origin xyz="%s" rpy="%s"/><axis xyz="%s"/><limit lower="%g" upper="%g" effort="%g" velocity="3"/></joint>'
              % (a.jn[i], par, i+1, f(a.xyz[i]), f(a.rpy[i]), f(a.axis[i]), -a.lim[i], a.lim[i], a.tmax[i])]
        par = "link_%d" % (i+1)
    for nm, p, o, r in [(a.ftname, par, a.ft[0], a.ft[1]), (a.tipname, a.ftname, [0, 0, a.tip_z], [0, 0, 0])]:
        s += ['  <link name="%s"/>' % nm, '  <joint name="%s_mount" type="fixed"><parent link="%s"/><child link="%s"/><origin xyz="%s" rpy="%s"/></joint>' % (nm, p, nm, f(o), f(r))]
    s += ['</robot>', '']
    open(path, "w").write("\n".join(s))

def merge(m1, c1, I1, m2, c2, I2):
    m = m1+m2
    if m2 == 0: return m1, c1, I1
    c = (m1*c1+m2*c2)/m
    sh = lambda I, mm, d: I+mm*(d@d*np.eye(3)-np.outer(d, d))
    return m, c, sh(I1, m1, c1-c)+sh(I2, m2, c2-c)

@njit(cache=True, error_model="numpy", fastmath=True)
def fk(n, R0, p0, ax, q, R, p, z):
    for i in range(n):
        c = np.cos(q[i]); s = np.sin(q[i]); x = ax[i, 0]; y = ax[i, 1]; w = ax[i, 2]; C = 1-c
        J00 = c+x*x*C; J01 = x*y*C-w*s; J02 = x*w*C+y*s
        J10 = y*x*C+w*s; J11 = c+y*y*C; J12 = y*w*C-x*s
        J20 = w*x*C-y*s; J21 = w*y*C+x*s; J22 = c+w*w*C
        for r in range(3):
            if i == 0:
                a0 = R0[0, r, 0]; a1 = R0[0, r, 1]; a2 = R0[0, r, 2]; p[0, r] = p0[0, r]
            else:
                b0 = R[i-1, r, 0]; b1 = R[i-1, r, 1]; b2 = R[i-1, r, 2]
                a0 = b0*R0[i, 0, 0]+b1*R0[i, 1, 0]+b2*R0[i, 2, 0]
                a1 = b0*R0[i, 0, 1]+b1*R0[i, 1, 1]+b2*R0[i, 2, 1]
                a2 = b0*R0[i, 0, 2]+b1*R0[i, 1, 2]+b2*R0[i, 2, 2]
                p[i, r] = p[i-1, r]+b0*p0[i, 0]+b1*p0[i, 1]+b2*p0[i, 2]
            R[i, r, 0] = a0*J00+a1*J10+a2*J20
            R[i, r, 1] = a0*J01+a1*J11+a2*J21
            R[i, r, 2] = a0*J02+a1*J12+a2*J22
        for r in range(3):
            z[i, r] = R[i, r, 0]*x+R[i, r, 1]*y+R[i, r, 2]*w

@njit(cache=True, error_model="numpy", fastmath=True, inline="always")
def cr(a, b, o):
    o[0] = a[1]*b[2]-a[2]*b[1]; o[1] = a[2]*b[0]-a[0]*b[2]; o[2] = a[0]*b[1]-a[1]*b[0]

@njit(cache=True, error_model="numpy", fastmath=True)
def mv(R, v, o):
    for r in range(3):
        o[r] = R[r, 0]*v[0]+R[r, 1]*v[1]+R[r, 2]*v[2]

@njit(cache=True, error_model="numpy", fastmath=True)
def dyn(n, R, p, z, m, com, I, dq, g, M, h, want_M, w):
    """h = C(q,dq)dq + g(q) and M, all in world axes. w: scratch (12+,n,3)."""
    cw = w[0]; om = w[1]; al = w[2]; ac = w[3]; F = w[4]; T = w[5]
    t1 = w[6, 0]; t2 = w[6, 1]; t3 = w[6, 2]
    a0 = -g[0]; a1 = -g[1]; a2 = -g[2]
    ox = oy = oz = 0.0; lx = ly = lz = 0.0
    Iw = np.empty((3, 3)); tmp = np.empty((3, 3))
    acc = w[7, 0]; acc[0] = a0; acc[1] = a1; acc[2] = a2
    IW = np.empty((n, 3, 3))
    for i in range(n):
        # origin acceleration
        if i > 0:
            d = w[7, 1]
            for r in range(3): d[r] = p[i, r]-p[i-1, r]
            cr(al[i-1], d, t1); cr(om[i-1], d, t2); cr(om[i-1], t2, t3)
            for r in range(3): acc[r] += t1[r]+t3[r]
            cr(om[i-1], z[i], t1)
            for r in range(3):
                om[i, r] = om[i-1, r]+z[i, r]*dq[i]; al[i, r] = al[i-1, r]+t1[r]*dq[i]
        else:
            for r in range(3):
                om[i, r] = z[i, r]*dq[i]; al[i, r] = 0.0
        mv(R[i], com[i], t1)
        for r in range(3): cw[i, r] = p[i, r]+t1[r]
        d = w[7, 2]
        for r in range(3): d[r] = t1[r]
        cr(al[i], d, t1); cr(om[i], d, t2); cr(om[i], t2, t3)
        for r in range(3): F[i, r] = m[i]*(acc[r]+t1[r]+t3[r])
        for r in range(3):
            for c in range(3):
                tmp[r, c] = R[i, r, 0]*I[i, 0, c]+R[i, r, 1]*I[i, 1, c]+R[i, r, 2]*I[i, 2, c]
        for r in range(3):
            for c in range(3):
                IW[i, r, c] = tmp[r, 0]*R[i, c, 0]+tmp[r, 1]*R[i, c, 1]+tmp[r, 2]*R[i, c, 2]
        mv(IW[i], om[i], t1); cr(om[i], t1, t2); mv(IW[i], al[i], t1)
        for r in range(3): T[i, r] = t1[r]+t2[r]
    # backward: h_i = z_i . sum_{k>=i} [T_k + (c_k - p_i) x F_k]
    for i in range(n):
        s = 0.0
        for k in range(i, n):
            d = w[7, 1]
            for r in range(3): d[r] = cw[k, r]-p[i, r]
            cr(d, F[k], t1)
            for r in range(3): s += z[i, r]*(T[k, r]+t1[r])
        h[i] = s
    if want_M:
        for i in range(n):
            for j in range(n): M[i, j] = 0.0
        jv = w[8]; jw = w[9]
        for k in range(n):
            for i in range(k+1):
                d = w[7, 1]
                for r in range(3): d[r] = cw[k, r]-p[i, r]
                cr(z[i], d, jv[i]); mv(IW[k], z[i], jw[i])
            for i in range(k+1):
                for j in range(i+1):
                    M[i, j] += m[k]*(jv[i, 0]*jv[j, 0]+jv[i, 1]*jv[j, 1]+jv[i, 2]*jv[j, 2])+jw[i, 0]*z[j, 0]+jw[i, 1]*z[j, 1]+jw[i, 2]*z[j, 2]
        for i in range(n):
            for j in range(i): M[j, i] = M[i, j]

@njit(cache=True, error_model="numpy", fastmath=True)
def chol_solve(n, A, b, x, L):
    for i in range(n):
        for j in range(i+1):
            s = A[i, j]
            for k in range(j): s -= L[i, k]*L[j, k]
            if i == j: L[i, i] = np.sqrt(s)
            else: L[i, j] = s/L[j, j]
    for i in range(n):
        s = b[i]
        for k in range(i): s -= L[i, k]*x[k]
        x[i] = s/L[i, i]
    for i in range(n-1, -1, -1):
        s = x[i]
        for k in range(i+1, n): s -= L[k, i]*x[k]
        x[i] = s/L[i, i]
