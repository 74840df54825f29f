"""check.py DATA: reference estimator in plain numpy on the catalogue's laws. Per case: rms left by the base model (e0) and by base+truth (e1),
the effect's share sqrt(e0^2-e1^2)/e1 (want >= 2), fitted against true values. Own code paths; only the kinematics of chain.py is shared (itself checked by check_dyn.py)."""
import json, os, sys, tomllib
import numpy as np, pyarrow.parquet as pq
from numba import njit
from scipy.optimize import least_squares
from scipy.signal import savgol_filter
sys.path.insert(0, os.path.dirname(os.path.abspath(__file__)))
from chain import ARMS, fk, dyn, rpy
from build import rotvec, WCH

def load(p):
    if os.path.exists(p+"/log.csv"):
        L = open(p+"/log.csv").read().split("\n"); k = L[0].split(","); r = [x.split(",") for x in L[1:] if x]
        return {a: np.array([x[i] for x in r]) if a == "phase" else np.array([float(x[i]) for x in r]) for i, a in enumerate(k)}
    t = pq.read_table(p+"/log.parquet"); return {k: np.array(t[k]) for k in t.column_names}

def grid(d):
    t = d["t"]; dt = np.median(np.diff(t)); tg = np.arange(t[0], t[-1], dt)
    o = {k: np.interp(tg, t, v) for k, v in d.items() if k not in ("t", "phase")}; o["t"] = tg
    return o, dt

def sg(x, dt, der, win=.036):
    w = max(5, int(win/dt)//2*2+1); return savgol_filter(x, w, 3 if der < 2 else 3, deriv=der, delta=dt, axis=0)

@njit(cache=True)
def dahl(vx, vy, L, dt, con):
    n = len(vx); z = np.zeros((n, 2)); a = 0.; b = 0.
    for i in range(n):
        if con[i] <= 0: a = 0.; b = 0.
        else:
            for k in range(4):
                h = dt/4; v = np.sqrt(vx[i]**2+vy[i]**2)
                if v*h/L > .5:
                    e = np.exp(-v*h/L); a = a*e+L*vx[i]/v*(1-e); b = b*e+L*vy[i]/v*(1-e)
                else: a, b = a+h*(vx[i]-v*a/L), b+h*(vy[i]-v*b/L)
        z[i, 0] = a/L; z[i, 1] = b/L
    return z
@njit(cache=True)
def plast(vx, vy, L, dt, con):
    n = len(vx); z = np.zeros((n, 2)); a = 0.; b = 0.
    for i in range(n):
        if con[i] <= 0: a = 0.; b = 0.
        else:
            a += vx[i]*dt; b += vy[i]*dt; r = np.sqrt(a*a+b*b)
            if r > L: a *= L/r; b *= L/r
        z[i, 0] = a/L; z[i, 1] = b/L
    return z
@njit(cache=True)
def maxw(F, tau, dt):
    s = np.zeros(len(F)); e = np.exp(-dt/tau)
    for i in range(1, len(F)): s[i] = s[i-1]*e+(F[i]-F[i-1])*tau/dt*(1-e)
    return s
@njit(cache=True)
def dahl1(v, L, dt, con):
    z = np.zeros(len(v)); a = 0.
    for i in range(len(v)):
        a = 0. if con[i] <= 0 else min(L, max(-L, a+v[i]*dt)); z[i] = a/L
    return z
@njit(cache=True)
def adhes(d, F, L):
    o = np.zeros(len(d)); b = False
    for i in range(len(d)):
        if d[i] > 0: b = True
        elif d[i] < -L: b = False
        if b: o[i] = -F*min(1., 1+min(0., d[i])/L)
    return o

def contact(p, c, truth):
    """c: dict t, dt, depth, rate, s(2), v(2), Nm (measured normal force)"""
    t, dt = c["t"], c["dt"]; d = c["depth"]+p.get("z0", 0.)
    if "C" in p: d = d-p["C"]*c["Nm"]
    dp = np.maximum(d, 0); con = (d > 0).astype(float); r = c["rate"]
    Fe = p["k"]*1e3*(dp*1e3)**p["n"]*1e-3
    if "mulR" in p:
        mx = np.maximum.accumulate(dp); Fe = Fe*(1-p["mulR"]*(1-np.exp(-(mx-dp)/p["mulL"])))
    if "alpha" in p: Fe = Fe*(1+p["alpha"]*t/60)
    if "inh" in p: Fe = Fe*(1+p["inh"]*.5*(1-np.tanh((np.hypot(c["s"][:, 0]-.027, c["s"][:, 1]-.006)-.009)/.003)))
    if "layK" in p: Fe = Fe+p["layK"]*np.maximum(d-p["layD"], 0)
    N = Fe*(1+p.get("lam", 0.)*r)+p.get("c", 0.)*r*con
    if "ratio" in p: N = N+p["ratio"]*maxw(Fe, abs(p["tau"])+1e-3, dt)
    if "hysA" in p: N = N+p["hysA"]*dahl1(r, 4.5e-4, dt, con)
    N = np.maximum(N, 0)*con
    Npos = N
    if "adhF" in p: N = N+adhes(d, p["adhF"], 8e-4)
    T = np.zeros((len(t), 2))
    if "mu" in p:
        v = np.linalg.norm(c["v"], axis=1); z = c["v"]/np.sqrt(v**2+p["vr"]**2)[:, None] if "vr" in p else (plast if os.environ.get("PLAST") else dahl)(c["v"][:, 0], c["v"][:, 1], p.get("L", 1e-4), dt, con)
        mu = p["mu"]*(np.maximum(Npos, 1e-6)/4.)**p.get("p", 0.)+p.get("dmu", 0.)*np.exp(-(v/p.get("vs", 1.))**2)
        T = -(mu*Npos)[:, None]*z*np.array([1+p.get("ani", 0.), 1-p.get("ani", 0.)])-p.get("cv", 0.)*c["v"]*con[:, None]
    return N, T

BASE = {"hertz": {"k": (12.*.03, None), "n": (1.5, 0)}, "hunt-crossley": {"k": (.36, None), "n": (1.5, None), "lam": (.5, None)}, "kelvin-voigt": {"k": (1.4, None), "n": (1., 0), "c": (5., None)},
        "zener": {"k": (1.4, None), "n": (1., 0), "ratio": (.4, None), "tau": (.8, None)}, "none": {}, "coulomb-friction": {"mu": (.35, None)}}
EFF = {"hertz-exponent": {"n": 1.6}, "viscous-damping": {"c": 10.}, "hunt-crossley-damping": {"lam": 2.}, "relaxation": {"ratio": .3, "tau": 1.}, "hysteresis": {"hysA": .3}, "stress-softening": {"mulR": .2, "mulL": 4e-4},
       "adhesion": {"adhF": .3}, "stiffening-layer": {"layK": 2000., "layD": .003}, "surface-offset": {"z0": 1e-4}, "stiffness-drift": {"alpha": .01}, "stiffness-inhomogeneity": {"inh": .2}, "stribeck-friction": {"dmu": .1, "vs": .01},
       "presliding": {"L": 6e-4}, "load-dependent-friction": {"p": .05}, "viscous-friction": {"cv": 5.}, "friction-anisotropy": {"ani": .05}, "structural-compliance": {"C": 2e-5},
       "tool-mass": {"dm": .01}, "tool-com": {"dcx": 0., "dcy": 0., "dcz": 0.}, "tip-offset": {"tox": 0., "toy": 0.}, "sensor-bias": {"b%d" % i: 0. for i in range(6)}, "sensor-drift": {"d%d" % i: 0. for i in range(6)},
       "sensor-crosstalk": {"xz": 0., "yz": 0.}, "sensor-misalignment": {"m0": 0., "m1": 0., "m2": 0.}, "sensor-gain": {"gz": 0.}, "friction-rounding": {"vr": .005}, "sensor-lag": {"slag": .01}, "time-offset": {"toff": .001}, "saturation": {"sat": 4.7}, "quantization": {}, "mains-hum": {}}
SC = {"mulL": 1e-4, "layD": 1e-3, "layK": 1e3, "z0": 1e-3, "L": 1e-3, "vs": .01, "C": 1e-5, "tox": 1e-3, "toy": 1e-3, "dcx": 1e-3, "dcy": 1e-3, "dcz": 1e-3, "vr": .01, "slag": .01, "toff": .01, "cv": 10., "c": 10., "lam": 1.}

def fit(pred, meas, w, free, fixed):
    ks = list(free); x0 = np.array([free[k] for k in ks]); sc = np.array([SC.get(k, max(abs(free[k]), .1)) for k in ks])
    f = lambda y: ((pred({**fixed, **dict(zip(ks, y*sc))})-meas)*w).ravel()
    if not ks: r = f(x0); return {}, np.sqrt(np.mean(r**2)), r
    s = least_squares(f, x0/sc, max_nfev=60, diff_step=1e-4); return dict(zip(ks, s.x*sc)), np.sqrt(np.mean(s.fun**2)), s.fun

def arm_series(d, dt, rig):
    A = ARMS["lwr" if rig["robot"]["model"].startswith("lwr") else "six"](); n = A.n; T = len(d["t"]); q = np.stack([d["q%d" % (i+1)] for i in range(n)], 1)
    # smoothing of coarse encoders only for derivatives
    R0 = np.array([rpy(*v) for v in A.rpy]); R = np.zeros((n, 3, 3)); p = np.zeros((n, 3)); z = np.zeros((n, 3)); Rf = rpy(*A.ft[1])
    qs = sg(q, dt, 0, .05) if np.median(np.abs(np.diff(q, axis=0))[np.abs(np.diff(q, axis=0)) > 0]) > 2e-4 else q
    RS = np.zeros((T, 3, 3)); PS = np.zeros((T, 3)); W = np.zeros((T, 3)); dq = sg(q, dt, 1)
    for k in range(T):
        fk(n, R0, A.xyz.astype(float), A.axis, qs[k], R, p, z); RS[k] = R[-1]@Rf; PS[k] = p[-1]+R[-1]@A.ft[0]; W[k] = z.T@dq[k]
    tip = PS+RS[:, :, 2]*A.tip_z
    return A, q, dq, RS, PS, W, tip

def do_wrench(d, dt, rig, row):
    A, q, dq, R, PS, W, tip = arm_series(d, dt, rig); g = np.array(rig["robot"]["gravity"]); t = d["t"]
    meas = np.stack([d[k] for k in WCH], 1); w = np.array([1, 1, 1, 10, 10, 10.])
    wa = .25 if np.max(np.std(np.diff(q, 3, axis=0), axis=0)) > 8e-5 else .06
    ac = sg(PS, dt, 2, wa); al = sg(W, dt, 1, wa); tl = rig["tool"]; I = np.array(tl.get("inertia", [0]*6))[:3]
    S = lambda x: np.einsum("tji,tj->ti", R, x)
    Wl, All, G, AC = S(W), S(al), S(np.tile(g, (len(t), 1))), S(ac)
    sf = rig.get("surface")
    if sf:
        pt, nn, ta = map(np.array, (sf["point"], sf["normal"], sf["tangent"])); tb = np.cross(nn, ta); e = tip-pt
        c = dict(t=t, dt=dt, depth=-e@nn, s=np.stack([e@ta, e@tb], 1)); c["rate"] = sg(c["depth"], dt, 1, .03); c["v"] = sg(c["s"], dt, 1, .03)
        c["Nm"] = np.einsum("tij,tj->ti", R, meas[:, :3]-tl["mass"]*(G-AC))@nn
    rt = np.array([0, 0, A.tip_z])
    def pred(p):
        m = tl["mass"]+p.get("dm", 0.); com = np.array(tl["com"])+np.array([p.get("dcx", 0.), p.get("dcy", 0.), p.get("dcz", 0.)])
        a = AC+np.cross(All, com)+np.cross(Wl, np.cross(Wl, com)); ft = m*(G-a); tt = np.cross(com, ft)-All*I-np.cross(Wl, Wl*I)
        if sf:
            N, T = contact(p, c, row); fc = S(N[:, None]*nn+T[:, :1]*ta+T[:, 1:]*tb); ft = ft+fc; tt = tt+np.cross(rt+np.array([p.get("tox", 0.), p.get("toy", 0.), 0.]), fc)
        y = np.hstack([ft, tt])
        if "gz" in p: y = y*np.array([1, 1, 1+p["gz"], 1, 1, 1])
        if "m0" in p: M = rotvec([p["m0"], p["m1"], p["m2"]]); y = np.hstack([y[:, :3]@M.T, y[:, 3:]@M.T])
        if "xz" in p: y = y+np.outer(y[:, 2], [p["xz"], p["yz"], 0, 0, 0, 0])
        if "slag" in p:
            al_ = 1-np.exp(-dt/max(p["slag"], 1e-4)); z = y.copy()
            for i in range(1, len(z)): z[i] = z[i-1]+al_*(y[i]-z[i-1])
            y = z
        if "toff" in p: y = np.stack([np.interp(t-p["toff"], t, y[:, i]) for i in range(6)], 1)
        if "b0" in p: y = y+np.array([p["b%d" % i] for i in range(6)])
        if "d0" in p: y = y+np.outer(t/60, [p["d%d" % i] for i in range(6)])
        if "sat" in p: y = np.clip(y, -p["sat"]*np.array([1e9, 1e9, 1, 1e9, 1e9, 1e9]), 1e9)
        return y
    return pred, meas, w

def do_tester(d, dt, row):
    t = d["t"]; z = np.zeros(len(t)); sl = "slip1" in d
    c = dict(t=t, dt=dt, depth=d["depth"], s=np.stack([d["slip1"], d["slip2"]], 1) if sl else np.zeros((len(t), 2)), Nm=d["normal_force"]); c["rate"] = sg(c["depth"], dt, 1, .03); c["v"] = sg(c["s"], dt, 1, .012)
    meas = np.stack([d[k] for k in ["normal_force", "tangential_force1", "tangential_force2"] if k in d], 1)
    def pred(p):
        N, T = contact(p, c, row); y = np.column_stack([N, T]) if sl else N[:, None]
        if "sat" in p: y = np.minimum(y, p["sat"])
        return y
    return pred, meas, np.ones(meas.shape[1])

def lin(cols, y):
    X = np.stack(cols, 1); b = np.linalg.lstsq(X, y, rcond=None)[0]; return b, y-X@b
def jcols(name, q, v, a, tau, mod, r):
    cs = np.clip(v/.01, -1, 1); z = dahl1(v, .002, r["dt"], np.ones(len(v)))
    if name == "joint-coulomb-friction": return [z]
    if name == "joint-viscous-friction": return [v]
    if name == "joint-friction-asymmetry": return [np.abs(z)]
    if name == "joint-torque-offset": return [np.ones(len(v))]
    if name == "rotor-inertia": return [a]
    if name == "joint-torque-gain": return [mod]
    if name == "joint-load-friction": return [z*np.abs(tau)]
    if name == "gravity-error": return []
    if name == "joint-spring": return [q, np.ones(len(q))]
    if name == "joint-stribeck-friction": return [z*np.exp(-(v/r["values"].get("joint-stribeck-friction.v_s[1]", .1))**2)]
    if name == "joint-torque-ripple":
        k = r["values"]["joint-torque-ripple.k[1]"]; return [f(m*k*q) for m in (1, 2) for f in (np.sin, np.cos)]
    return []

def do_joint(d, dt, rig, row):
    row["dt"] = dt
    if row["kind"] == "drive":
        q = d["q1"]; v = sg(q, dt, 1, .05); a = sg(q, dt, 2, .06); Q = [(q, v, a, d["tau1"], None)]
    else:
        A, q, dq, *_ = arm_series(d, dt, rig); n = A.n; ddq = sg(q, dt, 2, .06); g = np.array(rig["robot"]["gravity"]); R0 = np.array([rpy(*x) for x in A.rpy])
        def rnea(m, com, I):
            R = np.zeros((n, 3, 3)); p = np.zeros((n, 3)); z = np.zeros((n, 3)); M = np.zeros((n, n)); h = np.zeros(n); o = np.zeros((len(q), n)); w = np.zeros((12, max(n, 3), 3))
            for k in range(len(q)):
                fk(n, R0, A.xyz.astype(float), A.axis, q[k], R, p, z); dyn(n, R, p, z, m, com, I, dq[k], g, M, h, True, w); o[k] = h+M@ddq[k]
            return o
        mod = rnea(A.mass, A.com.astype(float), A.I); pay = None
        if "payload" in row["truth"]:
            m2 = A.mass*0; m2[-1] = 1.; c2 = A.com*0.; c2[-1] = A.ft[0]+np.array([0, 0, .06]); pay = rnea(m2, c2, A.I*0)
        Q = [(q[:, i], dq[:, i], ddq[:, i], d["tau%d" % (i+1)], mod[:, i]) for i in range(n)]
    base = [b for b in row["model"].split(",") if b != "rigid-body"]; e = [[], []]; est = {}
    if row["kind"] == "arm" and "payload" in row["truth"]: B = [0, 0]
    for i, (q_, v, a, tau, mod_) in enumerate(Q):
        for s, names in ((0, base), (1, base+row["truth"])):
            cols = []; tag = []
            for nm in names:
                cc = jcols(nm, q_, v, a, tau, mod_, row); cols += cc; tag += [nm]*len(cc)
                if nm == "payload": cols.append(pay[:, i]); tag.append(nm)
            y = tau.copy()
            if mod_ is None:
                cols.append(a); tag.append("inertia")
                if s and "joint-elasticity" in names: cols.append(-sg(tau, dt, 2, .06)); tag.append("J/K")
            else: y = tau-mod_
            b, r = lin(cols, y) if cols else ([], y)
            m = slice(int(.1/dt), -int(.1/dt)); e[s].append(np.sqrt(np.mean(r[m]**2)))
            if s:
                for k, x in zip(tag, b): est.setdefault(k, []).append(round(float(x), 3))
    return e, est

if __name__ == "__main__":
    D = sys.argv[1]; rows = json.load(open(D+"/truth.json")); only = sys.argv[2:]
    for r in rows:
        if only and r["case"] not in only: continue
        p = os.path.join(D, r["case"]); d, dt = grid(load(p)); rig = tomllib.load(open(p+"/rig.toml", "rb")); base = r["model"].split(",")
        v = {k: (round(x, 6) if isinstance(x, float) else x) for k, x in r["values"].items()}
        if base[0] == "rigid-body":
            e, est = do_joint(d, dt, rig, r); e = [np.array(x) for x in e]
            sh = np.sqrt(np.maximum(e[0]**2-e[1]**2, 0))/e[1]; te = np.array([x for k, x in r["true_error"].items() if k.startswith("tau")])
            print("%-14s %-12s %-46s share %s | left/true_err %s | max tau %.1f" % (r["case"], r["group"], ",".join(r["truth"]), np.round(sh, 1), np.round(e[1]/te, 1), max(np.abs(d[k]).max() for k in d if k.startswith("tau"))))
            print("      left", np.round(e[1], 3), "est", est, "true", v); continue
        pred, meas, w = do_wrench(d, dt, rig, r) if r["kind"] == "arm" else do_tester(d, dt, r)
        free, fix = {}, {}
        for b in base:
            for k, (x, fx) in BASE[b].items(): (free if fx is None else fix).__setitem__(k, x)
        if r["kind"] != "arm": pass
        p0, e0, r0 = fit(pred, meas, w, free, fix)
        f1 = {**free, **p0}; x1 = dict(fix)
        for tr in r["truth"]:
            for k, x in EFF.get(tr, {}).items():
                f1[k] = x; x1.pop(k, None)
        p1, e1, r1 = fit(pred, meas, w, f1, x1); 
        if "mains-hum" in r["truth"]:
            f = r["values"]["mains-hum.frequency"]; X = np.stack([g(2*np.pi*m*f*d["t"]) for m in (1, 2) for g in (np.sin, np.cos)], 1); Y = r1.reshape(len(d["t"]), -1); Y = Y-X@np.linalg.lstsq(X, Y, rcond=None)[0]; e1 = np.sqrt(np.mean(Y**2))
        if "quantization" in r["truth"]: e1 = np.sqrt(max(e1**2-r["values"]["quantization.step"]**2/12, r["noise"]["normal_force"]**2))
        te = np.sqrt(np.mean([(x*(10 if k[0] == "t" and k[1] in "xyz" else 1))**2 for k, x in r["true_error"].items() if not k.startswith("tau")])); rd = np.sqrt(np.mean((meas*w)**2))
        print("%-14s %-12s %-46s e0 %.4f e1 %.4f share %.1f | true_err %.4f rms reading %.2f" % (r["case"], r["group"], ",".join(r["truth"]), e0, e1, np.sqrt(max(e0**2-e1**2, 0))/e1, te, rd))
        print("     ", r["note"][:90], "fit", {k: float("%.4g" % x) for k, x in p1.items()}, "true", v)
