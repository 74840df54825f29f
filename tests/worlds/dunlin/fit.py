"""Least squares of its own for the rules of fairness (generate.py and check.py use it on the written files)."""
import numpy as np, json, os, tempfile
from scipy.optimize import least_squares
from scipy.interpolate import CubicSpline
from scipy.signal import butter, filtfilt, lfilter
from scipy.spatial.transform import Rotation as Rot
import core
from core import IX, newP

PAR = {"hooke": ["k"], "kelvin-voigt": ["k", "c"], "hertz": ["k"], "hunt-crossley": ["k", "n", "lam"], "zener": ["k", "rr", "rtau"], "none": [], "maxwell": ["k", "rtau"],
       "hertz-exponent": ["n"], "viscous-damping": ["c"], "hunt-crossley-damping": ["lam"], "relaxation": ["rr", "rtau"], "hysteresis": ["hA", "hL"],
       "stress-softening": ["mr", "mL"], "adhesion": ["Fa", "aL"], "stiffening-layer": ["K2", "db"], "surface-offset": ["z0"], "stiffness-drift": ["alpha"],
       "stiffness-inhomogeneity": ["iamp", "is0", "iw"], "coulomb-friction": ["mu"], "viscous-friction": ["cv"], "stribeck-friction": ["dmu", "vs"], "presliding": ["Lb"],
       "friction-rounding": ["vr"], "load-dependent-friction": ["p"], "friction-anisotropy": ["an"], "structural-compliance": ["C"],
       "tool-mass": ["dm"], "tool-com": ["cx", "cy", "cz"], "tool-inertia": ["Ix", "Iy", "Iz"], "tip-offset": ["ox", "oy", "oz"],
       "sensor-bias": ["b0", "b1", "b2", "b3", "b4", "b5"], "sensor-drift": ["r0", "r1", "r2", "r3", "r4", "r5"], "sensor-crosstalk": ["xt"],
       "sensor-misalignment": ["m0", "m1", "m2"], "sensor-gain": ["g"], "sensor-lag": ["lag"], "time-offset": ["dt"], "saturation": ["sat"], "mains-hum": ["hs0", "hs1", "hs2", "hc0", "hc1", "hc2"]}
POS = set("k n rr rtau hL mL aL iw vs Lb vr db lag".split())
TORQ = {"tool-com", "tool-inertia", "tip-offset"}

def readlog(f):
    import pyarrow.parquet as pq, pyarrow.csv as pc
    p = os.path.join(f, "log.parquet")
    t = pq.read_table(p) if os.path.exists(p) else pc.read_csv(os.path.join(f, "log.csv"))
    return {c: t[c].to_numpy(zero_copy_only=False) for c in t.column_names}

def lp(x, t, fc):
    """zero-phase low-pass on a uniform grid (jitter and dropped samples stay harmless)."""
    fs = 1/np.median(np.diff(t))
    if fc > 0.4*fs: return x
    tu = np.linspace(t[0], t[-1], int((t[-1]-t[0])*fs)+1); b, a = butter(2, fc/(fs/2))
    y = filtfilt(b, a, CubicSpline(t, x)(tu), axis=0, padlen=min(60, len(tu)-2)); return CubicSpline(tu, y)(t)

def setp(names, x, P0, Q0):
    P = P0.copy(); Q = dict(Q0)
    for n, v in zip(names, x):
        if n in IX: P[IX[n]] = v
        else: Q[n] = v
    return P, Q

def solve(pred, meas, w, names, start, stride):
    x0 = np.array([start.get(n, 0.) for n in names], float)
    sc = np.maximum(np.abs(x0)*0.3, np.array([{"dm": .05, "g": .03, "lag": .004, "dt": .002, "z0": 2e-4, "C": 2e-5, "sat": 1., "c": 3.}.get(n, {"b": .1, "r": .1, "m": .02, "o": 2e-3, "c": 5e-3, "I": 1e-3}.get(n[0], 1e-3)) for n in names]))
    for i, n in enumerate(names):
        if n in POS and x0[i] <= 0: x0[i] = 1e-6
    lo = np.array([(1e-7-0)/s if n in POS else -np.inf for n, s in zip(names, sc)])
    f = lambda y: ((pred(y*sc)-meas)*w)[::stride].ravel()
    if not names: return x0, pred(x0)-meas
    r = least_squares(f, np.maximum(x0/sc, lo+1e-6), bounds=(lo, np.inf), diff_step=1e-4, max_nfev=12, x_scale=1.0)
    return r.x*sc, pred(r.x*sc)-meas

class WrenchCase:
    def __init__(self, folder, meta):
        L = readlog(folder); self.meta = meta; t = L["t"]; self.t = t; nj = len(meta["ax"])
        q = np.column_stack([L["q%d" % (i+1)] for i in range(nj)]); fs = 1/np.median(np.diff(t)); self.fs = fs
        qs = meta["quant"]; fq = 6. if qs > 3e-4 else 12. if qs > 8e-5 else 30.
        qf = lp(q, t, fq) if qs > 8e-5 else q
        A = [np.array(meta[k], float) for k in ("off", "ax", "tip", "Rs")]
        A[0] = A[0].copy(); tip = A[2]
        p, R = core.fk_all(A[0], A[1], np.array(meta["tipc"]), A[3], np.ascontiguousarray(qf)); self.p, self.R = p, R
        P0 = np.array(meta["point"]); B = np.column_stack([meta["t1"], meta["t2"], meta["n"]]); self.B = B
        xb = (p-P0)@B; self.s = xb
        fd = min(fq, 30.)
        self.v = lp(np.gradient(xb, t, axis=0), t, fd)
        com = np.array(meta["rigcom"]); self.com = com
        fa = min(fq, 15.)
        def acc(c):
            pc = p+np.einsum("nij,j->ni", R, c-tip); return lp(np.gradient(lp(np.gradient(pc, t, axis=0), t, fa), t, axis=0), t, fa)
        self.acc0 = acc(np.zeros(3)); self.acce = [acc(e)-self.acc0 for e in np.eye(3)*1.0]
        dR = np.einsum("nji,njk->nik", R[:-1], R[1:]); w = np.vstack([Rot.from_matrix(dR).as_rotvec(), np.zeros(3)])/np.gradient(t)[:, None]; w[-1] = w[-2]
        self.w = lp(w, t, fa); self.al = lp(np.gradient(self.w, t, axis=0), t, fa)
        self.meas = np.column_stack([L[c] for c in ("fx", "fy", "fz", "tx", "ty", "tz")])
        rm = np.sqrt(np.mean(self.meas**2, 0)); nz = np.array(meta["noise"])
        sc = np.r_[np.full(3, max(np.max(nz[:3]), .004*np.linalg.norm(rm[:3]))), np.full(3, max(np.max(nz[3:]), .004*np.linalg.norm(rm[3:])))]
        self.wt = np.tile(1/sc, (len(t), 1)); ed = max(2, int(.3*fs)); self.wt[:ed] = 0; self.wt[-ed:] = 0; self.ed = ed; self.stride = max(1, len(t)//2500)
    def pred(self, P, Q):
        m = self.meta; t = self.t; R = self.R; tip = np.array(m["tip"])+[Q.get(c, 0.) for c in ("ox", "oy", "oz")]
        o = tip-np.array(m["tip"]); s = self.s; v = self.v
        if np.any(o):
            d = np.einsum("nij,j->ni", R, o)@self.B; s = s+d; v = v+np.gradient(d, t, axis=0)
        if m["surface"]:
            O = core.drive_law(P, t, np.ascontiguousarray(-s[:, 2]), np.ascontiguousarray(-v[:, 2]), np.ascontiguousarray(s[:, 0]), np.ascontiguousarray(s[:, 1]), np.ascontiguousarray(v[:, 0]), np.ascontiguousarray(v[:, 1]))
            fw = np.column_stack([O[:, 1], O[:, 2], O[:, 0]])@self.B.T
        else: fw = np.zeros((len(t), 3))
        fcs = np.einsum("nji,nj->ni", R, fw)
        mass = m["rigmass"]+Q.get("dm", 0.); com = self.com+[Q.get("cx", 0.), Q.get("cy", 0.), Q.get("cz", 0.)]
        a = self.acc0+sum(com[i]*self.acce[i] for i in range(3))
        ft = mass*np.einsum("nji,nj->ni", R, np.array(m["g"])-a)
        I = np.array(m["rigI"][:3])+[Q.get("Ix", 0.), Q.get("Iy", 0.), Q.get("Iz", 0.)]
        tq = np.cross(com, ft)+np.cross(tip, fcs)
        if np.any(I): tq = tq-(I*self.al+np.cross(self.w, I*self.w))
        W = np.hstack([fcs+ft, tq])
        if "m0" in Q:
            Rm = Rot.from_rotvec([Q["m0"], Q["m1"], Q["m2"]]).as_matrix(); W = np.hstack([W[:, :3]@Rm.T, W[:, 3:]@Rm.T])
        if "xt" in Q:
            i, j = m["xtij"]; W = W.copy(); W[:, i] += Q["xt"]*W[:, j]
        if "g" in Q: W = W*(1+Q["g"])
        if "b0" in Q: W = W+[Q["b%d" % i] for i in range(6)]
        if "r0" in Q: W = W+np.outer(t/60, [Q["r%d" % i] for i in range(6)])
        if "hs0" in Q:
            w = 2*np.pi*m["start"]["hum"]*t; W = W.copy()
            for i in range(3): W[:, i] += Q["hs%d" % i]*np.sin(w)+Q["hc%d" % i]*np.cos(w)
        if Q.get("lag", 0) > 0:
            e = np.exp(-1/(self.fs*Q["lag"])); W = lfilter([1-e], [1, -e], W-W[0], axis=0)+W[0]
        if Q.get("dt", 0) != 0: W = np.column_stack([np.interp(t-Q["dt"], t, W[:, i]) for i in range(6)])
        if "sat" in Q: W = W.copy(); W[:, 2] = np.clip(W[:, 2], -Q["sat"], Q["sat"])
        return W
    def left(self, model, acts):
        st = self.meta["start"]; names = sum([PAR[e] for e in model], [])
        P0 = newP(k=0.); 
        base = [e for e in model if e in ("hertz", "hunt-crossley")]
        P0[IX["n"]] = st.get("nbase", 1.)
        Q0 = {}
        if "friction-rounding" in model: P0[IX["ftype"]] = 3.
        if "stiffness-inhomogeneity" in model: P0[IX["ikind"]] = st.get("ikind", 1.)
        pr = lambda x: self.pred(*setp(names, x, P0, Q0))
        self.r0 = self.rms(pr([st.get(n, 0.) for n in names])-self.meas, acts)
        x, r = solve(pr, self.meas, self.wt, names, st, self.stride)
        self.last = dict(zip(names, x))
        return self.rms(r, acts)
    def rms(self, r, acts):
        c = slice(3, 6) if acts == "t" else slice(0, 3); r = r[self.ed:-self.ed]
        return float(np.sqrt(np.mean(np.sum(r[:, c]**2, 1))))
    def reading(self, acts): return self.rms(self.meas, acts)

class TesterCase:
    def __init__(self, folder, meta):
        L = readlog(folder); self.meta = meta; t = L["t"]; self.t = t; d = L["depth"]; fs = 1/np.median(np.diff(t))
        sl = L.get("slip1", np.zeros_like(t))
        self.dd = L["depth_rate"] if "depth_rate" in L and not meta.get("badrate") else lp(np.gradient(d, t)[:, None], t, 20.)[:, 0]
        self.d = d; self.sl = sl; self.v = lp(np.gradient(sl, t)[:, None], t, 20.)[:, 0]
        self.has = "tangential_force1" in L
        self.meas = np.column_stack([L["normal_force"]]+([L["tangential_force1"]] if self.has else [])).astype(float)
        self.wt = 1/np.maximum(.004*np.sqrt(np.mean(self.meas**2, 0)), meta["noise"][0]); self.stride = max(1, len(t)//4000)
    def pred(self, P, Q):
        z = np.zeros_like(self.t); O = core.drive_law(P, self.t, self.d, self.dd, self.sl, z, self.v, z)
        N = O[:, 0]
        if "sat" in Q: N = np.minimum(N, Q["sat"])
        if "b0" in Q: N = N+Q["b0"]
        return np.column_stack([N]+([O[:, 1]] if self.has else []))
    def left(self, model, acts):
        st = self.meta["start"]; names = sum([PAR[e] if e != "sensor-bias" else ["b0"] for e in model], [])
        P0 = newP(k=0.); P0[IX["n"]] = st.get("nbase", 1.)
        pr = lambda x: self.pred(*setp(names, x, P0, {}))
        self.r0 = self.rms(pr([st.get(n, 0.) for n in names])-self.meas, acts)
        x, r = solve(pr, self.meas, self.wt, names, st, self.stride)
        self.last = dict(zip(names, x)); return self.rms(r, acts)
    def rms(self, r, acts):
        if acts == "n": r = r[:, :1]
        if acts == "s" and self.has: r = r[:, 1:]
        return float(np.sqrt(np.mean(np.sum(r**2, 1))))
    def reading(self, acts): return self.rms(self.meas, acts)

class JointCase:
    """linear least squares for each joint; nonlinear parameters held at their true values."""
    def __init__(self, folder, meta):
        import pinocchio as pin
        L = readlog(folder); self.meta = meta; t = L["t"]; self.t = t; nj = meta["nj"]; fs = 1/np.median(np.diff(t))
        q = np.column_stack([L["q%d" % (i+1)] for i in range(nj)]); qs = meta["quant"]; fc = 8. if qs < 1e-4 else 5.
        fc = max(fc, 6*meta.get("fmax", .3)); self.q = lp(q, t, fc)
        dq = np.gradient(self.q, t, axis=0); self.dq = lp(dq, t, fc); self.ddq = lp(np.gradient(self.dq, t, axis=0), t, fc)
        self.meas = np.column_stack([L["tau%d" % (i+1)] for i in range(nj)])
        self.st = st = max(1, len(t)//6000); ed = max(3, int(.6*fs)); s = slice(ed, -ed, st)   # the filters' ends are left out
        Q, D, DD = self.q[s], self.dq[s], self.ddq[s]; self.Q, self.D, self.DD = Q, D, DD; self.M = self.meas[s]
        if meta["robot"]:
            self.pin = pin; mod = pin.buildModelFromUrdf(os.path.join(folder, "robot.urdf")); self.mod = mod; mod.gravity.linear = np.array(meta["g"]); self.dat = mod.createData()
            self.rb = np.array([pin.rnea(mod, self.dat, a, b, c) for a, b, c in zip(Q, D, DD)])
        else: self.rb = np.zeros_like(Q)
    def rn(self, mod, Q):
        d = mod.createData(); return np.array([self.pin.rnea(mod, d, a, b, c) for a, b, c in zip(Q, self.D, self.DD)])
    def left(self, model, acts):
        m = self.meta; Q, D, DD = self.Q, self.D, self.DD; n, nj = Q.shape; R = np.zeros_like(Q)
        # bristle of small fixed length as sign
        sg = np.zeros_like(D); z = np.zeros(nj); Lb = 2e-4
        for i in range(1, n):
            dq = Q[i]-Q[i-1]; ex = np.exp(-np.abs(dq)/Lb); z = np.sign(dq)+(z-np.sign(dq))*ex; sg[i] = z
        if "payload" in model or "gravity-error" in model:
            pin = self.pin; ext = []
            if "payload" in model:
                base = self.rb
                for key in ("m", "x", "y", "z"):
                    mod = self.mod.copy(); p = m["start"]["payload"]; c = np.array(p["com"], float)
                    # mass at com plus first-moment columns by differences of two placements
                    dc = dict(m=0, x=[.05, 0, 0], y=[0, .05, 0], z=[0, 0, .05])[key]
                    mod.inertias[nj] = mod.inertias[nj]+pin.Inertia(.5, np.array(p["base"])+c+dc, np.zeros((3, 3))); ext.append(self.rn(mod, Q)-base)
            if "gravity-error" in model:
                for a in (0, 1):
                    mod = self.mod.copy(); g = np.array(m["g"], float); dg = np.zeros(3); dg[a] = .5; mod.gravity.linear = g+dg; ext.append(self.rn(mod, Q)-self.rb)
        else: ext = []
        el = None
        if "joint-elasticity" in model:
            el = self.rn(self.mod, Q-self.rb/np.array(m["start"]["K"]))-self.rb
        cols_all = []
        for j in range(nj):
            c = [];
            if not m["robot"]: c.append(DD[:, j])
            for e in model:
                if e == "joint-coulomb-friction": c.append(sg[:, j])
                elif e == "joint-viscous-friction": c.append(D[:, j])
                elif e == "joint-friction-asymmetry": c += [np.abs(sg[:, j]), np.abs(D[:, j])]
                elif e == "joint-torque-offset": c.append(np.ones(n))
                elif e == "rotor-inertia": c.append(DD[:, j])
                elif e == "joint-torque-gain": c += [self.rb[:, j]]+([DD[:, j]] if not m["robot"] else [])
                elif e == "joint-stribeck-friction": c.append(sg[:, j]*np.exp(-(D[:, j]/m["start"]["vs"])**2))
                elif e == "joint-load-friction": c.append(sg[:, j]*np.abs(self.rb[:, j]))
                elif e == "joint-torque-ripple": c += [np.sin(m["start"]["kr"]*Q[:, j]), np.cos(m["start"]["kr"]*Q[:, j])]
                elif e == "joint-spring": c += [Q[:, j], np.ones(n)]
                elif e == "joint-elasticity": c.append(el[:, j])
            cols_all.append(c)
        tgt = self.M-self.rb
        if ext:   # shared columns over the joints: alternate jointly
            wj = 1/np.maximum(np.array(m["tn"]), .01*np.sqrt(np.mean(self.M**2, 0)))
            y = []; X = []
            for j in range(nj):
                A = np.column_stack(cols_all[j]) if cols_all[j] else np.zeros((n, 0)); E = np.column_stack([e[:, j] for e in ext])
                if A.shape[1]:
                    qq, _ = np.linalg.qr(A); E = E-qq@(qq.T@E); yy = tgt[:, j]-qq@(qq.T@tgt[:, j])
                else: yy = tgt[:, j]
                X.append(E*wj[j]); y.append(yy*wj[j])
            b = np.linalg.lstsq(np.vstack(X), np.concatenate(y), rcond=None)[0]
            for j in range(nj): R[:, j] = (y[j]-X[j]@b)/wj[j]
        else:
            for j in range(nj):
                if cols_all[j]:
                    A = np.column_stack(cols_all[j]); R[:, j] = tgt[:, j]-A@np.linalg.lstsq(A, tgt[:, j], rcond=None)[0]
                else: R[:, j] = tgt[:, j]
        return self.rms(R, acts)
    def rms(self, r, acts):
        if isinstance(acts, list): r = r[:, acts]
        return float(np.sqrt(np.mean(np.sum(r**2, 1))))
    def reading(self, acts): return self.rms(self.M, acts)

ALT = {"relaxation": ["viscous-damping", "hysteresis", "stress-softening"], "tip-offset": ["sensor-misalignment", "tool-com", "sensor-bias"], "structural-compliance": ["hertz-exponent", "surface-offset", "stiffening-layer"],
       "sensor-drift": ["stiffness-drift", "sensor-bias"], "hysteresis": ["relaxation", "viscous-damping", "stress-softening"], "stress-softening": ["hysteresis", "relaxation", "surface-offset"], "hertz-exponent": ["stiffening-layer", "surface-offset"],
       "adhesion": ["surface-offset", "hysteresis"], "load-dependent-friction": ["viscous-friction", "stribeck-friction", "presliding"], "time-offset": ["sensor-lag", "viscous-damping", "relaxation"], "sensor-lag": ["time-offset", "viscous-damping"],
       "sensor-crosstalk": ["sensor-misalignment"], "sensor-misalignment": ["sensor-bias", "tip-offset"], "tool-com": ["tip-offset", "sensor-bias"], "tool-mass": ["sensor-gain", "sensor-bias"], "tool-inertia": ["tool-com", "tool-mass"],
       "coulomb-friction": ["viscous-friction"], "stribeck-friction": ["load-dependent-friction", "viscous-friction", "presliding"], "stiffness-inhomogeneity": ["stiffness-drift", "surface-offset"], "presliding": ["friction-rounding"],
       "friction-rounding": ["presliding"], "viscous-friction": ["stribeck-friction"], "hunt-crossley-damping": ["viscous-damping", "time-offset", "sensor-lag"], "viscous-damping": ["hunt-crossley-damping", "relaxation"], "stiffness-drift": ["stress-softening"],
       "stiffening-layer": ["hertz-exponent"], "surface-offset": ["hertz-exponent", "stiffening-layer"], "saturation": ["stiffening-layer", "relaxation", "hertz-exponent"],
       "gravity-error": ["joint-spring", "joint-torque-gain", "payload"], "joint-elasticity": ["gravity-error", "joint-torque-gain", "joint-spring"], "joint-load-friction": ["joint-friction-asymmetry", "joint-torque-gain"], "payload": ["joint-torque-gain", "gravity-error"],
       "joint-viscous-friction": ["joint-load-friction", "joint-friction-asymmetry"], "joint-friction-asymmetry": ["joint-torque-offset"], "joint-torque-gain": ["gravity-error", "joint-load-friction"], "rotor-inertia": ["joint-torque-gain"], "joint-torque-offset": ["joint-friction-asymmetry"]}

def near_of(folder, meta):
    """alternatives that leave within 5 % of what the truth leaves: a fair judge accepts them."""
    m = dict(meta); st = dict(meta["start"]); k, F = st.get("k", 1e3), 10.
    if "payload" not in st: st["payload"] = dict(com=[0, 0, .05], base=[0, 0, .035])
    for a, b in dict(rr=.2, rtau=.3, hA=.08*F, hL=5e-4, mr=.2, mL=5e-4, K2=k, db=2e-3, lag=.005, c=.01*k if k < 1e4 else 20., cv=5., dmu=.1, vs=.01, Lb=2e-4, vr=1e-3, C=1e-5, lam=.5, n=st.get("nbase", 1.), xt=.01).items(): st.setdefault(a, b)
    m["start"] = st; C = load(folder, m); hid = meta["truth"]; out = []
    for i, h in enumerate(hid):
        full = C.left(meta["model"]+hid, meta["acts"][i])
        for alt in ALT.get(h, []):
            if alt in hid or alt in meta["model"]: continue
            if meta["type"] == "t" and alt in ("time-offset", "sensor-lag"): continue
            if C.left(meta["model"]+[x for x in hid if x != h]+[alt], meta["acts"][i]) <= 1.05*full: out.append(alt)
    return out

def load(folder, meta): return {"w": WrenchCase, "t": TesterCase, "j": JointCase}[meta["type"]](folder, meta)

def check_case(folder, meta):
    """-> dict(ok, text, numbers)"""
    C = load(folder, meta); g = meta["group"]; base = meta["model"]; hid = meta["truth"]; acts = meta["acts"]
    o = dict(case=os.path.basename(folder), group=g, reading=C.reading(acts[0]))
    b = [C.left(base, a) if i == 0 or acts[i] != acts[0] else None for i, a in enumerate(acts)]; b = [b[0] if x is None else x for x in b]
    o["base"] = b
    if g in ("one", "two", "not-excited"):
        f = [C.left(base+hid, a) for a in dict.fromkeys(map(str, acts)) for a in [acts[list(map(str, acts)).index(a)]]]
        fm = dict(zip(dict.fromkeys(map(str, acts)), f)); f = [fm[str(a)] for a in acts]; o["full"] = f
    if g == "one": o["ratio"] = [b[0]/f[0]]; o["ok"] = o["ratio"][0] >= 2
    if g == "two":
        o["ratio"] = [C.left(base+[h for h in hid if h != hid[i]], acts[i])/f[i] for i in range(2)]; o["ok"] = min(o["ratio"]) >= 1.5
    if g == "not-excited": o["ratio"] = [b[0]/f[0]]; o["ok"] = o["ratio"][0] <= 1.1; o["strict"] = b[0] <= max(1.3*meta["true_error"], .02*o["reading"])
    if g == "quiet":
        nn = meta["true_error"]; o["ratio"] = [b[0]/max(1.3*nn, .02*o["reading"])]; o["strict"] = o["ratio"][0] <= 1
        w = getattr(C, "r0", meta.get("nuis", 0.)); o["ok"] = b[0] <= 1.3*np.hypot(nn, w) or o["strict"]
    if g == "outside":
        ref = max(meta["true_error"], meta.get("nuis", 0.)); o["ratio"] = [b[0]/ref]; o["ok"] = o["ratio"][0] >= 2
    return o
