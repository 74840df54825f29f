"""Own small least squares: what does a list of effects leave in a log as written? (used by generate.py and check.py)"""
import numpy as np
from scipy.optimize import least_squares
from scipy.signal import savgol_filter
import law as L
from arms import fk, rotv
CH = ["fx", "fy", "fz", "tx", "ty", "tz"]
EFF = {"hooke": ["k"], "kelvin-voigt": ["k", "c"], "hertz": ["k"], "hunt-crossley": ["k", "n", "lam"], "zener": ["k", "r1", "t1"], "none": [],
 "viscous-damping": ["c"], "hunt-crossley-damping": ["lam"], "relaxation": ["r1", "t1"], "hysteresis": ["hA", "hL"], "stress-softening": ["mr", "mL"], "adhesion": ["Fa", "aL"],
 "stiffening-layer": ["K2", "db"], "surface-offset": ["z0"], "stiffness-drift": ["al"], "stiffness-inhomogeneity": ["iA", "ix", "iy", "iw"], "coulomb-friction": ["mu"],
 "viscous-friction": ["cv"], "stribeck-friction": ["dmu", "vs"], "presliding": ["bl"], "friction-rounding": ["vr"], "load-dependent-friction": ["pe"], "friction-anisotropy": ["an"],
 "structural-compliance": ["C"], "tool-mass": ["dm"], "tool-com": ["cx", "cy", "cz"], "tip-offset": ["ox", "oy", "oz"], "sensor-bias": ["b%d" % i for i in range(6)],
 "sensor-drift": ["d%d" % i for i in range(6)], "sensor-crosstalk": ["x02", "x12", "x20", "x21"], "sensor-misalignment": ["m0", "m1", "m2"], "sensor-gain": ["gain"],
 "sensor-lag": ["lag"], "time-offset": ["toff"], "saturation": ["sat"]}
NEUT = dict(c=0, lam=0, r1=0, hA=0, mr=0, Fa=0, K2=0, z0=0, al=0, iA=0, mu=0, cv=0, dmu=0, pe=0, an=0, C=0)
SCALE = dict(c=5, n=.3, mu=.3, z0=3e-4, ix=3e-3, iy=3e-3, cx=.01, cy=.01, cz=.01, ox=2e-3, oy=2e-3, oz=2e-3, gain=.05, toff=.01, dm=.05, C=3e-5, x02=.03, x12=.03, x20=.03, x21=.03, m0=.05, m1=.05, m2=.05, al=.05, lam=1., cv=10.)
POS = set("t1 hL mL aL iw vs bl vr lag sat C k".split())

def sense(W, t, v):
    W = np.array(W)
    if "x02" in v: f = W.copy(); W[:, 0] += v["x02"]*f[:, 2]; W[:, 1] += v["x12"]*f[:, 2]; W[:, 2] += v["x20"]*f[:, 0]+v["x21"]*f[:, 1]
    if "m0" in v: A = rotv([v["m0"], v["m1"], v["m2"]]); W = np.concatenate([W[:, :3] @ A.T, W[:, 3:] @ A.T], 1)
    if "gain" in v: W = W*(1+v["gain"])
    if v.get("lag", 0): W = np.stack([L.lowpass(np.ascontiguousarray(a), t, abs(v["lag"])+1e-9) for a in W.T], 1)
    k = W.shape[1]
    if "b0" in v: W = W+[v["b%d" % i] for i in range(k)]
    if "d0" in v: W = W+np.outer(t/60, [v["d%d" % i] for i in range(k)])
    return W
def wrench(R, Fw, acom, m, com, g, rtip):
    Rt = np.swapaxes(R, 1, 2); ft = (Rt @ (m*(np.asarray(g)-acom))[..., None])[..., 0]; fc = (Rt @ Fw[..., None])[..., 0]
    return np.concatenate([ft+fc, np.cross(com, ft)+np.cross(rtip, fc)], 1)
def odd(x, lo=5): return max(lo, int(x)//2*2+1)
def read(log, meta, rb=None, nmax=6000):
    t = log["t"]; h = float(np.median(np.diff(t))); n = int((t[-1]-t[0])/h); tu = t[0]+h*np.arange(n); st = max(1, n//nmax)
    if meta["kind"] == "tester":
        cols = [log["depth"]]+([log["slip1"]] if "slip1" in log else []); w = odd(.015/h)
        A = [np.interp(tu, t, a) for a in cols]; S = [savgol_filter(a, w, 2) for a in A]; D = [savgol_filter(a, w, 2, deriv=1, delta=h) for a in A]; z = 0*tu
        M = np.stack([S[0], D[0], S[1] if len(S) > 1 else z, z, D[1] if len(S) > 1 else z, z], 1)[::st]
        return dict(t=np.ascontiguousarray(tu[::st]), M=np.ascontiguousarray(M), h=h*st)
    q = np.stack([log["q%d" % (i+1)] for i in range(rb["n"])], 1); qu = np.stack([np.interp(tu, t, a) for a in q.T], 1); step = np.abs(np.diff(q[:, 0])); step = step[step > 1e-9]; enc = float(step.min()) if len(step) else 1e-3; ts = min(.05, .035*(enc/2e-4)**.5); w = odd(ts/h, 3)   # smooth as much as the encoder asks for
    qs = savgol_filter(qu, w, 2, axis=0)[::st]; R, x = fk(rb, qs)
    return dict(t=np.ascontiguousarray(tu[::st]), R=R, x=x, h=h*st, ts=ts)
def deriv(y, h, k, T): return savgol_filter(y, odd(T/h, 5 if k == 2 else 3), 3 if k == 2 else 2, deriv=k, delta=h, axis=0)
def frame(mo, meta, off):
    s = meta["surf"]; x = mo["x"]+(mo["R"] @ np.asarray(off) if np.any(off) else 0); e = x-np.array(s["point"]); B = np.array([s["n"], s["t1"], s["t2"]]); y = e @ B.T*[-1, 1, 1]
    v = deriv(y, mo["h"], 1, mo["ts"]); return np.ascontiguousarray(np.stack([y[:, 0], v[:, 0], y[:, 1], y[:, 2], v[:, 1], v[:, 2]], 1))
def predict(v, mo, meta, tq, pbase):
    p = pbase.copy(); off = np.array([v.get("ox", 0), v.get("oy", 0), v.get("oz", 0)]); t = mo["t"]
    for a, b in v.items():
        if a in L.IX: p[L.IX[a]] = abs(b) if a in POS else b
    if meta["kind"] == "tester":
        F = L.drive(p, t, mo["M"]); W = sense(F[:, :meta["nch"]], t, v)
    else:
        if meta["surf"]:
            key = off.tobytes()
            if mo.get("key") != key: mo["key"] = key; mo["fr"] = frame(mo, meta, off)
            F = L.drive(p, t, mo["fr"]); s = meta["surf"]; Fw = F @ np.array([s["n"], s["t1"], s["t2"]])
        else: Fw = np.zeros((len(t), 3))
        com = np.array(meta["com"])+[v.get("cx", 0), v.get("cy", 0), v.get("cz", 0)]
        a = deriv(mo["x"]+mo["R"] @ (com-[0, 0, meta["tip"]]), mo["h"], 2, .08)
        W = sense(wrench(mo["R"], Fw, a, meta["m"]+v.get("dm", 0), com, meta["g"], off+[0, 0, meta["tip"]]), t, v)
    W = np.stack([np.interp(tq-v.get("toff", 0), t, a) for a in W.T], 1)
    if "sat" in v: W[:, 0] = np.minimum(W[:, 0], abs(v["sat"]))
    return W
def base_p(effects, meta, full=False):
    p = np.array(meta["p"], float)
    if not full:
        for a, b in NEUT.items(): p[L.IX[a]] = b
        for a in ("eps", "sqz", "wav", "r2"): p[L.IX[a]] = 0
        p[L.IX["ft"]] = 2. if "friction-rounding" in effects else 0. if "presliding" not in effects else 1.; p[L.IX["bl"]] = 1e-4; p[L.IX["db"]] = 1.
        p[L.IX["n"]] = 1.5 if "hertz" in effects else 1.
    return p
def leave(effects, log, meta, true, sig, rb, cache, start=None):
    if "mo" not in cache: cache["mo"] = read(log, meta, rb)
    mo = cache["mo"]; st = max(1, len(log["t"])//5000); tq = log["t"][::st]
    Y = np.stack([log[c] for c in meta["ch"]], 1)[::st]; sig = np.asarray(sig)
    names = list(dict.fromkeys(a for e in effects for a in EFF[e])); p = base_p(effects, meta)
    S = np.array([SCALE.get(a) or (.2 if a[0] in "bd" and a[1:].isdigit() and int(a[1]) < 3 else .01 if a[0] in "bd" and a[1:].isdigit() else abs(true.get(a, 0)) or .1) for a in names])
    x0 = np.array([true.get(a, L.DEF.get(a, 0.)) for a in names])/S if names else np.zeros(0)
    f = lambda x: ((predict(dict(zip(names, x*S)), mo, meta, tq, p)-Y)/sig).ravel()
    x = least_squares(f, x0, diff_step=1e-4, max_nfev=10, ftol=1e-4).x if names else x0
    return np.sqrt(np.mean((f(x).reshape(Y.shape)*sig)**2, 0)), dict(zip(names, (x*S).tolist()))
def exact(log, meta, hid, sig, rb, cache):
    """what the full physics (off-catalogue nuisances too) leaves when driven by the logged motion"""
    if "mo" not in cache: cache["mo"] = read(log, meta, rb)
    st = max(1, len(log["t"])//5000); tq = log["t"][::st]; Y = np.stack([log[c] for c in meta["ch"]], 1)[::st]
    W = predict({a: b for a, b in hid.items() if a not in L.IX}, cache["mo"], meta, tq, base_p([], meta, True)); return np.sqrt(np.mean((W-Y)**2, 0))
# ---------------- joints
def dyn(xml, q, dq, ddq, g0=(0, 0, -9.81)):
    import pinocchio as pin
    m = pin.buildModelFromXML(xml); m.gravity.linear = np.array(g0, float); d = m.createData(); mp = pin.Model(m); mp.appendBodyToJoint(m.njoints-1, pin.Inertia(1., np.array([0, 0, .06]), np.zeros((3, 3))), m.frames[m.getFrameId("ft_sensor")].placement); dp = mp.createData()
    mx, my, mz = pin.Model(m), pin.Model(m), pin.Model(m); mz.gravity.linear = np.array([0, 0, 1.]); dz = mz.createData(); mx.gravity.linear = np.array([1., 0, 0]); my.gravity.linear = np.array([0, 1., 0]); dx, dy = mx.createData(), my.createData(); o = {k: np.zeros_like(q) for k in ("tau", "pay", "gx", "gy", "gz")}
    for i in range(len(q)):
        o["tau"][i] = pin.rnea(m, d, q[i], dq[i], ddq[i]); o["pay"][i] = pin.rnea(mp, dp, q[i], dq[i], ddq[i])-o["tau"][i]
        o["gx"][i] = pin.computeGeneralizedGravity(mx, dx, q[i]); o["gz"][i] = pin.computeGeneralizedGravity(mz, dz, q[i]); o["gy"][i] = pin.computeGeneralizedGravity(my, dy, q[i])
    return o
def jcols(e, q, dq, ddq, D, meta, sg):
    n = q.shape[1]; E = lambda A: [A*np.eye(n)[j] for j in range(n)]
    return {"rigid-body": lambda: E(ddq) if meta["drive"] else [], "joint-coulomb-friction": lambda: E(sg), "joint-viscous-friction": lambda: E(dq), "joint-friction-asymmetry": lambda: E(abs(sg)), "joint-torque-offset": lambda: E(1+0*q),
            "rotor-inertia": lambda: E(ddq), "joint-torque-gain": lambda: E(D["tau"]), "joint-stribeck-friction": lambda: E(sg*np.exp(-(dq/meta["vs"])**2)), "joint-load-friction": lambda: E(sg*abs(D["tau"])),
            "joint-torque-ripple": lambda: E(np.sin(meta["kr"]*q))+E(np.cos(meta["kr"]*q)), "joint-spring": lambda: E(q), "payload": lambda: [D["pay"]], "gravity-error": lambda: [-D["gx"], -D["gy"]]}[e]()
def jleave(effects, log, meta, xml, cache):
    n = meta["n"]; t = log["t"]
    if "A" not in cache:
        q = np.stack([log["q%d" % (i+1)] for i in range(n)], 1); Y = np.stack([log["tau%d" % (i+1)] for i in range(n)], 1)
        h = float(np.median(np.diff(t))); N = int((t[-1]-t[0])/h); tu = t[0]+h*np.arange(N); w = odd((.05 if meta['drive'] else .12)/h, 7); qu = np.stack([np.interp(tu, t, a) for a in q.T], 1); st = max(1, N//2500)
        A = [savgol_filter(qu, w, 3, deriv=k, delta=h, axis=0) for k in range(3)]; br = L.jfriction(np.ascontiguousarray(A[1]), h, 0, 2e-3)[w:-w:st]; A = [a[w:-w:st] for a in A]; tt = tu[w:-w:st]
        cache.update(h=h*st, A=A, br=br, Y=np.stack([np.interp(tt, t, a) for a in Y.T], 1), D=dict(tau=0*A[0]) if meta["drive"] else dyn(xml, *A, meta["g"]))
    A, D = cache["A"], cache["D"]; sc = np.sqrt(np.mean(cache["Y"]**2, 0))*.02+.05; best = None
    if "sg" not in cache: cache["sg"] = [np.tanh(A[1]/.02), np.tanh(A[1]/.004), cache["br"]]   # at rest: none, or as the last motion left it
    for sg in cache["sg"]:
        r = cache["Y"]-D["tau"]; C = [c for e in effects for c in jcols(e, *A, D, meta, sg)]
        if C:
            M = np.stack([(c/sc).ravel() for c in C], 1); x = np.linalg.lstsq(M, (r/sc).ravel(), rcond=None)[0]; r = r-(M @ x).reshape(r.shape)*sc
        e = np.sqrt(np.mean(r**2, 0))
        if best is None or np.mean((e/sc)**2) < np.mean((best/sc)**2): best = e
    return best, {}
