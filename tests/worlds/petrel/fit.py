"""Own small least squares: what does a model (list of effects) leave in a log? Used by generate.py and check.py."""
import numpy as np
from scipy.optimize import least_squares
from scipy.signal import savgol_filter
import phys as ph
LAW = {"hooke": ["k"], "kelvin-voigt": ["k", "c"], "hertz": ["k"], "hunt-crossley": ["k", "n", "lam"], "zener": ["k", "r1", "tau1"],
 "coulomb-friction": ["mu"], "hertz-exponent": ["n"], "viscous-damping": ["c"], "hunt-crossley-damping": ["lam"], "relaxation": ["r1", "tau1"],
 "hysteresis": ["hA", "hL"], "stress-softening": ["mr", "mL"], "adhesion": ["Fa", "aL"], "stiffening-layer": ["K2", "db"], "surface-offset": ["z0"],
 "stiffness-drift": ["alpha"], "stiffness-inhomogeneity": ["iA", "ix", "iy", "iw"], "viscous-friction": ["cv"], "stribeck-friction": ["dmu", "vs"],
 "presliding": ["bl"], "friction-rounding": ["vr"], "load-dependent-friction": ["pexp"], "friction-anisotropy": ["an"], "structural-compliance": ["C"]}
OTH = {"tool-mass": ["dm"], "tool-com": ["cx", "cy", "cz"], "tip-offset": ["ox", "oy", "oz"], "sensor-bias": ["b0", "b1", "b2", "b3", "b4", "b5"],
 "sensor-drift": ["d0", "d1", "d2", "d3", "d4", "d5"], "sensor-crosstalk": ["x02", "x12", "x20", "x21"], "sensor-misalignment": ["m0", "m1", "m2"],
 "sensor-gain": ["gain"], "sensor-lag": ["lag"], "time-offset": ["toff"], "saturation": ["sat"],
 "mains-hum": ["hs0", "hs1", "hs2", "hc0", "hc1", "hc2"], "tool-inertia": ["jm"]}
NEUT = dict(c=0, lam=0, r1=0, hA=0, mr=0, Fa=0, K2=0, z0=0, alpha=0, iA=0, cv=0, dmu=0, pexp=0, an=0, C=0, mu=0)
FIXLIN = dict(hooke=1., hertz=1.5)
SC = dict(k=None, n=1., c=5., lam=1., r1=.2, tau1=None, hA=.2, hL=None, mr=.2, mL=None, Fa=.3, aL=None, K2=None, db=None, z0=3e-4, alpha=.05, iA=.2, ix=3e-3, iy=3e-3, iw=None,
  mu=.3, cv=5., dmu=.2, vs=None, bl=None, vr=None, pexp=.2, an=.1, C=3e-5, dm=.05, cx=.01, cy=.01, cz=.01, ox=2e-3, oy=2e-3, oz=2e-3, gain=.05, lag=None, toff=5e-3, sat=None, jm=.1)
def sensor_dict(v, humf):
    s = {}
    if any(a in v for a in ("b0",)): s["bias"] = np.array([v["b%d" % i] for i in range(6)])
    if "d0" in v: s["drift"] = np.array([v["d%d" % i] for i in range(6)])
    if "x02" in v:
        X = np.zeros((6, 6)); X[0, 2] = v["x02"]; X[1, 2] = v["x12"]; X[2, 0] = v["x20"]; X[2, 1] = v["x21"]; s["X"] = X
    if "m0" in v: s["mis"] = np.array([v["m0"], v["m1"], v["m2"]])
    if "gain" in v: s["gain"] = v["gain"]
    if "lag" in v: s["lag"] = abs(v["lag"])
    if "hs0" in v: s["hum"] = np.array([[v["hs0"], v["hs1"], v["hs2"], 0, 0, 0], [v["hc0"], v["hc1"], v["hc2"], 0, 0, 0]]); s["humf"] = humf
    return s
def read_motion(rb, t, q, surf, tip, nmax=5000):
    """uniform grid motion from logged joints; returns dict"""
    dt = np.median(np.diff(t)); st = max(1, int(np.ceil((t[-1]-t[0])/dt/nmax))); n = int((t[-1]-t[0])/dt)+1
    tu = t[0]+dt*np.arange(n); qu = np.stack([np.interp(tu, t, a) for a in q.T], 1)
    w = max(5, int(.04/dt)//2*2+1); qs = savgol_filter(qu, w, 2, axis=0) if n > w else qu
    R, x, J = ph.fk(rb, qs[::st]); 
    return dict(t=tu[::st], R=R, x=x, st=st, dt=dt*st, surf=surf)
def contact(m, off, z=None):
    s = m["surf"]; x = m["x"] + (m["R"] @ off if np.any(off) else 0); e = x - s["point"]
    d = -e @ s["normal"]; s1 = e @ s["t1"]; s2 = e @ s["t2"]; h = m["dt"]
    w = max(3, int(.03/h)//2*2+1); f = lambda y: savgol_filter(np.gradient(y, h), w, 1)
    return d, f(d), s1, s2, f(s1), f(s2)
def predict(v, m, meta, tq):
    off = np.array([v.get("ox", 0), v.get("oy", 0), v.get("oz", 0)]); t = m["t"]
    p = np.array(meta["p"], float)
    for a in v:
        if a in ph.IX: p[ph.IX[a]] = abs(v[a]) if a in ("tau1", "hL", "mL", "aL", "vs", "bl", "vr", "iw", "k", "C") else v[a]
    if meta["tester"]:
        d, dd, s1, v1 = m["d"], m["dd"], m["s1"], m["v1"]; F = ph.driven(p, t, d, dd, s1, 0*s1, v1, 0*v1)
        W = F[:, :1] if not meta["slide"] else F[:, :2]
        if "b0" in v: W = W + np.array([v["b0"], v["b1"]])[:W.shape[1]]
        if "d0" in v: W = W + np.outer(t/60, [v["d0"], v["d1"]])[:, :W.shape[1]]
        if "gain" in v: W = W*(1+v["gain"])
        if "lag" in v: W = ph.sensor(W, t, {"lag": abs(v["lag"])})
    else:
        if m["surf"] is not None:
            q = contact(m, off); F = ph.driven(p, t, *q); s = m["surf"]; Fc = np.outer(F[:, 0], s["normal"])+np.outer(F[:, 1], s["t1"])+np.outer(F[:, 2], s["t2"])
        else: Fc = np.zeros((len(t), 3))
        mass = meta["m"]+v.get("dm", 0); com = np.array(meta["com"])+[v.get("cx", 0), v.get("cy", 0), v.get("cz", 0)]
        c = m["x"] - m["R"] @ (np.array([0, 0, meta["tip"]])-com); h = m["dt"]; w = max(5, int(.06/h)//2*2+1)
        a = savgol_filter(c, w, 3, deriv=2, delta=h, axis=0) if w > 4 else 0*c
        W = ph.wrench(m["R"], Fc, a, (mass, com), np.array(meta["g"]), off, meta["tip"])
        W = ph.sensor(W, t, {k: x for k, x in sensor_dict(v, meta["humf"]).items() if k != "hum"})
    tt = tq+v.get("toff", 0); W = np.stack([np.interp(tt, t, a) for a in W.T], 1)
    if "hs0" in v: W = W+ph.sensor(0*W, tq, {k: x for k, x in sensor_dict(v, meta["humf"]).items() if k.startswith("hum")})
    if "sat" in v:
        i = 0 if meta["tester"] else 2; W[:, i] = np.clip(W[:, i], -abs(v["sat"]), abs(v["sat"]))
    return W
def fit(effects, m, meta, tq, Y, true, sig):
    names = []
    for e in effects: names += [a for a in LAW.get(e, OTH.get(e, [])) if a not in names]
    meta = dict(meta); p = np.array(meta["p"], float)
    eff0 = set(meta["nuis"])                               # hidden law terms out unless fitted; nuisance laws never known to the fit
    for a, b in meta["inert"].items(): p[ph.IX[a]] = b
    if "friction-rounding" in effects: p[ph.IX["ftype"]] = 2.
    meta["p"] = p; v0 = {}
    for a in names: v0[a] = true.get(a, 0.)
    sc = {a: (abs(true.get(a, 0)) or 1e-2) if SC.get(a) is None else SC[a] for a in names}
    for i in range(6):
        for k in ("b", "d"):
            if k+str(i) in v0: sc[k+str(i)] = .1 if i < 3 else .01
    for a in names:
        if a[0] in "xm" and a in ("x02", "x12", "x20", "x21", "m0", "m1", "m2"): sc[a] = .05
        if a[:2] in ("hs", "hc"): sc[a] = .1
    S = np.array([sc[a] for a in names]); x0 = np.array([v0[a] for a in names])/S
    f = lambda x: ((predict(dict(zip(names, x*S)), m, meta, tq)-Y)/sig).ravel()
    if len(names):
        r = least_squares(f, x0, method="trf", diff_step=1e-4, max_nfev=8, x_scale=1.0); x = r.x
    else: x = x0
    W = predict(dict(zip(names, x*S)), m, meta, tq)
    return np.sqrt(np.mean((W-Y)**2, 0)), dict(zip(names, x*S))
# ---------------------------------------------------------------- joint torques
def jcols(name, q, dq, ddq, rb, meta):
    sg = np.tanh(dq/meta["v0"]); n = q.shape[1]; E = lambda A: [A*np.eye(n)[j] for j in range(n)]
    if name == "joint-coulomb-friction": return E(sg)
    if name == "joint-viscous-friction": return E(dq)
    if name == "joint-friction-asymmetry": return E(abs(sg))
    if name == "joint-torque-offset": return E(np.ones_like(q))
    if name == "rotor-inertia": return E(ddq)
    if name == "joint-torque-gain": return E(rb["tau"])
    if name == "joint-stribeck-friction": return E(sg*np.exp(-(dq/meta["vs"])**2))
    if name == "joint-load-friction": return E(sg*abs(rb["tau"]))
    if name == "joint-torque-ripple": return E(np.sin(meta["kr"]*q))+E(np.cos(meta["kr"]*q))
    if name == "joint-spring": return E(q)+(E(np.ones_like(q)))
    if name == "payload": return [rb["pay"]]
    if name == "gravity-error": return [rb["gx"], rb["gy"]]
    if name == "rigid-body": return [] if rb.get("tau") is not None and not rb.get("drive") else E(ddq)
    raise KeyError(name)
def dyn(path, q, dq, ddq, drive=False):
    if drive: return dict(tau=0*q, drive=True)
    import pinocchio as pin
    m = pin.buildModelFromUrdf(path); d = m.createData(); N = len(q); o = {k: np.zeros_like(q) for k in ("tau", "pay", "gx", "gy")}
    mp = pin.Model(m); I = mp.inertias[m.njoints-1]; T = m.frames[m.getFrameId("ft_sensor")].placement
    mp.appendBodyToJoint(m.njoints-1, pin.Inertia(1., np.array([0, 0, .05]), np.zeros((3, 3))), T); dp = mp.createData()
    z = np.zeros(m.nv); mx = pin.Model(m); my = pin.Model(m); mx.gravity.linear = np.array([1., 0, 0]); my.gravity.linear = np.array([0, 1., 0]); dx = mx.createData(); dy = my.createData()
    for i in range(N):
        o["tau"][i] = pin.rnea(m, d, q[i], dq[i], ddq[i]); o["pay"][i] = pin.rnea(mp, dp, q[i], dq[i], ddq[i])-o["tau"][i]
        o["gx"][i] = pin.computeGeneralizedGravity(mx, dx, q[i]); o["gy"][i] = pin.computeGeneralizedGravity(my, dy, q[i])
    return o
def jointfit(effects, t, q, Y, path, meta, cache):
    if "rb" not in cache:
        dt = np.median(np.diff(t)); n = int((t[-1]-t[0])/dt)+1; tu = t[0]+dt*np.arange(n); w = max(7, int(.12/dt)//2*2+1)
        qu = np.stack([np.interp(tu, t, a) for a in q.T], 1)
        A = [savgol_filter(qu, w, 3, deriv=k, delta=dt, axis=0) for k in range(3)]; st = max(1, n//2500)
        lp = lambda X: X
        A = [a[w:-w:st] for a in A]; tt = tu[w:-w:st]; cache["Y"] = np.stack([np.interp(tt, t, a) for a in Y.T], 1); cache["A"] = A; cache["rb"] = dyn(path, *A, drive=meta["drive"])
    A, rb, Yu = cache["A"], cache["rb"], cache["Y"]; r = Yu-rb["tau"]; C = []
    for e in effects: C += jcols(e, *A, rb, meta)
    if C:
        M = np.stack([c.ravel() for c in C], 1); x = np.linalg.lstsq(M, r.ravel(), rcond=None)[0]; r = r-(M @ x).reshape(r.shape)
    return np.sqrt(np.mean(r**2, 0))
