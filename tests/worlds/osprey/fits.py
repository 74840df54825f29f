"""own small fits: what a base and base+truth leave in a log"""
import numpy as np, time
from scipy.optimize import least_squares
from scipy.signal import butter, filtfilt
import world as w
from world import IX
from contact import SPARAMS, LAWS, FRICTION
IX.setdefault("IXX", w.IXX)
LAWP = {"hooke": [], "kelvin-voigt": ["C"], "hertz": [], "hunt-crossley": ["LAM", "N"], "zener": ["R1", "T1"], "none": []}
NORMAL = set("hertz-exponent viscous-damping hunt-crossley-damping relaxation hysteresis stress-softening adhesion stiffening-layer surface-offset stiffness-drift stiffness-inhomogeneity structural-compliance".split())
SC = dict(C=5., LAM=.5, N=.1, R1=.1, T1=.3, HA=.2, HL=3e-4, MR=.1, ML=1e-3, AF=.2, AL=3e-4, LK=300., LD=1e-3, DR=1e-3, IA=.1, IXX=2e-3, IW=2e-3, MU=.1, VF=2., DMU=.1, VS=.005, LP=.1, AN=.1, FL=3e-4, VR=3e-3, Z0=3e-4)
POS = set("N R1 T1 HL MR ML AF AL LD IW VS FL VR C LAM LK".split())


def smooth(t, Y, fc):
    fs = min(1/np.median(np.diff(t)), 500.)
    tu = np.arange(t[0], t[-1], 1/fs)
    U = np.stack([np.interp(tu, t, Y[:, j]) for j in range(Y.shape[1])], 1)
    if fc < .4*fs:
        b, a = butter(2, fc/(fs/2))
        U = filtfilt(b, a, U, axis=0)
    return tu, U, np.gradient(U, 1/fs, axis=0)


class ContactFit:
    def __init__(self, log, rig, values, extra, nmax=6000, fc=None):
        t = np.asarray(log["t"]); self.v, self.x, self.rig = values, extra, rig
        T = t[-1]-t[0]
        self.robot = "fx" in log
        st = max(1, int(np.ceil(len(t)/nmax)))
        idx = np.arange(0, len(t), st)
        self.t = t[idx]
        back = lambda tu, U: np.stack([np.interp(self.t, tu, U[:, j]) for j in range(U.shape[1])], 1)
        if self.robot:
            ch = rig["ch"]
            Q = np.stack([log[f"q{j+1}"] for j in range(ch.n)], 1)
            uq = np.unique(np.abs(np.diff(Q[:, :3].ravel()))); uq = uq[uq > 1e-9]
            res = uq[0] if len(uq) else 1e-6
            fc = fc or (30. if res < 4e-5 else (12. if res < 2.5e-4 else 6.))
            self.res = res
            tu, Qs, _ = smooth(t, Q, fc)
            R, ps = ch.fk(Qs)
            h = tu[1]-tu[0]
            p = ps+R@ch.r_tip
            V = np.gradient(p, h, axis=0); A = np.gradient(V, h, axis=0)
            om = np.gradient(R, h, axis=0)@R.transpose(0, 2, 1); om = np.stack([om[:, 2, 1], om[:, 0, 2], om[:, 1, 0]], 1)
            al = np.gradient(om, h, axis=0)
            self.R = back(tu, R.reshape(-1, 9)).reshape(-1, 3, 3); self.p = back(tu, p); self.V = back(tu, V); self.A = back(tu, A); self.om = back(tu, om); self.al = back(tu, al)
            self.Y = np.stack([np.asarray(log[c])[idx] for c in "fx fy fz tx ty tz".split()], 1)
            self.B, self.pt, self.g, self.rt = np.asarray(rig["B"]), np.asarray(rig["pt"]), np.asarray(rig["g"]), ch.r_tip
            self.X = (self.p-self.pt)@self.B.T; self.XV = self.V@self.B.T
        else:
            cols = [c for c in ("normal_force", "tangential_force1", "tangential_force2") if c in log]
            self.Y = np.stack([np.asarray(log[c])[idx] for c in cols], 1)
            X = np.zeros((len(t), 3)); X[:, 0] = log["depth"]
            if "slip1" in log: X[:, 1] = log["slip1"]; X[:, 2] = log["slip2"]
            tu, Xs, Vs = smooth(t, X, 60.)
            self.X = X[idx]; self.XV = back(tu, Vs)
        self.sig = np.maximum(np.median(np.abs(np.diff(self.Y, axis=0)), axis=0)/.95, 1e-4)
        self.sig = np.maximum(self.sig, .01*self.Y.std(0)+1e-6)

    def names(self, effects):
        E = []
        base = effects[0]
        if base != "none":
            E.append("F0")
        E += LAWP[base]
        for e in effects[1:]:
            for s, nm in SPARAMS.get(e, []):
                if nm not in E: E.append(nm)
            if FRICTION & {e} and "MU" not in E and e not in ("coulomb-friction",): pass
        if "relaxation" in effects and base == "zener": pass
        ex = {"tool-mass": ["dm"], "tool-com": ["cx", "cy", "cz"], "tool-inertia": ["ia", "ib", "ic"], "structural-compliance": ["SCN"], "tip-offset": ["ox", "oy"],
              "sensor-misalignment": ["ma", "mb", "mc"], "sensor-gain": ["gain"], "sensor-lag": ["lag"], "time-offset": ["off"], "saturation": ["sat"]}
        for e in effects[1:]:
            E += ex.get(e, [])
        return E

    def predict(self, effects, nm, th):
        q = dict(zip(nm, th))
        x = self.x; base = effects[0]
        P = w.law(K=0, N=LAWS.get(base, 1.))
        P[w.LN0], P[w.IK], P[w.IY] = x["LN0"], x["IK"] if "stiffness-inhomogeneity" in effects else 0, x["IY"]
        P[w.FT] = x["FT"] if ("presliding" in effects or "friction-rounding" in effects or x["FT"] != 3) and not ("presliding" in effects and x["FT"] == 3) else 0
        if x["FT"] == 3 and "friction-rounding" not in effects: P[w.FT] = 0
        for a, b in q.items():
            if a in IX: P[IX[a]] = b
        if "friction-rounding" in effects: P[w.FT] = 3
        if base != "none": P[w.K] = q["F0"]/x["dm"]**P[w.N]
        X = self.X; XV = self.XV; rt = getattr(self, "rt", None)
        if "ox" in q:
            o = np.array([q["ox"], q["oy"], 0]); X = X+(self.R@o)@self.B.T; rt = rt+o
        d = X[:, 0]
        if "SCN" in q: d = d-q["SCN"]*self.fn()
        F = w.openloop(self.t, np.ascontiguousarray(d), np.ascontiguousarray(XV[:, 0]), X[:, 1].copy(), X[:, 2].copy(), XV[:, 1].copy(), XV[:, 2].copy(), P) if base != "none" else np.zeros((len(self.t), 3))
        if not self.robot:
            Wr = F[:, :self.Y.shape[1]].copy()
        else:
            fc = F@(self.B*np.array([[-1.], [1.], [1.]]))
            m = self.rig["m"]+q.get("dm", 0); com = np.asarray(self.rig["com"])+[q.get("cx", 0), q.get("cy", 0), q.get("cz", 0)]
            I = np.asarray(self.rig["I"])+[q.get("ia", 0), q.get("ib", 0), q.get("ic", 0)]
            toS = lambda v: np.einsum("kji,kj->ki", self.R, v)
            lev = self.R@(com-self.rt)
            ft = toS(m*(self.g-self.A-np.cross(self.al, lev)-np.cross(self.om, np.cross(self.om, lev))))
            fs = toS(fc); os, as_ = toS(self.om), toS(self.al)
            Wr = np.hstack([ft+fs, np.cross(com, ft)+np.cross(rt, fs)-as_*I-np.cross(os, os*I)])
            if "ma" in q:
                r = np.array([q["ma"], q["mb"], q["mc"]])+1e-12; n = np.linalg.norm(r); M = w._rod(r/n, n); Wr = np.hstack([Wr[:, :3]@M, Wr[:, 3:]@M])
        if "gain" in q: Wr = Wr*(1+q["gain"])
        if "lag" in q: Wr = w.lowpass(self.t, np.ascontiguousarray(Wr), max(q["lag"], 0.))
        if "off" in q: Wr = np.stack([np.interp(self.t-q["off"], self.t, Wr[:, j]) for j in range(Wr.shape[1])], 1)
        # linear parts
        cols = []
        tm = self.t/60
        one = np.ones_like(tm)
        if "sensor-bias" in effects: cols.append(one)
        if "sensor-drift" in effects: cols += [tm-tm.mean()] + ([] if "sensor-bias" in effects else [tm*0+1e-9])
        if "mains-hum" in effects:
            f = self.v["mains-hum.frequency"]
            for k in (1, 2): cols += [np.sin(2*np.pi*f*k*self.t), np.cos(2*np.pi*f*k*self.t)]
        if cols or "sensor-crosstalk" in effects:
            C = np.stack(cols, 1) if cols else np.zeros((len(tm), 0))
            for j in range(Wr.shape[1]):
                A = C
                if "sensor-crosstalk" in effects: A = np.hstack([C, Wr[:, [k for k in range(Wr.shape[1]) if k != j]]])
                if A.shape[1]:
                    c = np.linalg.lstsq(A, self.Y[:, j]-Wr[:, j], rcond=1e-9)[0]
                    Wr = Wr.copy(); Wr[:, j] += A@c
        if "sat" in q:
            k = x["kind_clip"]; Wr = Wr.copy(); Wr[:, k] = np.clip(Wr[:, k], -q["sat"], q["sat"])
        return Wr

    def fn(self):
        if not self.robot: return self.Y[:, 0]
        f = np.einsum("kij,kj->ki", self.R, self.Y[:, :3])-self.rig["m"]*self.g
        return np.clip(-(f@self.B[0]), 0, None)

    def fit(self, effects, nfev=14):
        nm = self.names(effects)
        P = self.x["P"]
        x0 = []; sc = []
        v = self.v
        key = {"dm": "tool-mass.mass", "cx": "tool-com.x", "cy": "tool-com.y", "cz": "tool-com.z", "ia": "tool-inertia.ixx", "ib": "tool-inertia.iyy", "ic": "tool-inertia.izz", "SCN": "structural-compliance.C",
               "ox": "tip-offset.x", "oy": "tip-offset.y", "ma": "sensor-misalignment.x", "mb": "sensor-misalignment.y", "mc": "sensor-misalignment.z", "gain": "sensor-gain.gain", "lag": "sensor-lag.tau",
               "off": "time-offset.offset", "sat": "saturation.limit"}
        s2 = {"dm": .02, "cx": 2e-3, "cy": 2e-3, "cz": 2e-3, "ia": 2e-4, "ib": 2e-4, "ic": 2e-4, "SCN": 2e-5, "ox": 1e-3, "oy": 1e-3, "ma": .02, "mb": .02, "mc": .02, "gain": .02, "lag": .005, "off": .005, "sat": 1.}
        for a in nm:
            if a == "F0": x = P[w.K]*self.x["dm"]**P[w.N]; s = .2*x
            elif a in key: x = v.get(key[a], 0.); s = s2[a]
            else:
                x = P[IX[a]]; s = SC[a]
            x0.append(x); sc.append(s)
        x0, sc = np.array(x0), np.array(sc)
        lb = np.array([1e-4*s if n in POS else -np.inf for n, s in zip(nm, sc)])
        if not len(nm):
            r = self.Y-self.predict(effects, nm, [])
            return r, {}
        # coarse on a short part first is not needed: starts at the truth
        f = lambda th: ((self.Y-self.predict(effects, nm, th))/self.sig).ravel()
        o = least_squares(f, np.maximum(x0, lb+1e-3*sc*np.isfinite(lb)), x_scale=sc, bounds=(lb, np.inf), max_nfev=nfev, ftol=1e-4, xtol=1e-4, diff_step=1e-4)
        return self.Y-self.predict(effects, nm, o.x), dict(zip(nm, o.x))

    def readings(self, r):
        """rms of residual r per reading"""
        out = {}
        ch = "fx fy fz tx ty tz".split() if self.robot else ["normal_force", "tangential_force1", "tangential_force2"][:r.shape[1]]
        for j, c in enumerate(ch): out[c] = float(np.sqrt((r[:, j]**2).mean()))
        if self.robot:
            out["force"] = float(np.sqrt((r[:, :3]**2).sum(1).mean())); out["torque"] = float(np.sqrt((r[:, 3:]**2).sum(1).mean()))
            if not self.rig["free"]:
                f = np.einsum("kij,kj->ki", self.R, r[:, :3])@self.B.T
                out["normal"] = float(np.sqrt((f[:, 0]**2).mean())); out["tangential"] = float(np.sqrt((f[:, 1:]**2).sum(1).mean()))
        else:
            out["normal"] = out["normal_force"]; out["force"] = float(np.sqrt((r**2).sum(1).mean()))
            if r.shape[1] > 1: out["tangential"] = float(np.sqrt((r[:, 1:]**2).sum(1).mean()))
        return out


def acts_on(e, keys, rb, rt):
    if e in NORMAL: return "normal"
    if e in FRICTION: return "tangential"
    if e == "tool-mass": return "force"
    if e in ("tool-com", "tool-inertia", "tip-offset"): return "torque"
    ch = [k for k in keys if k in "fx fy fz tx ty tz normal_force tangential_force1 tangential_force2".split()]
    return max(ch, key=lambda k: rb[k]/max(rt[k], 1e-12))


def judge_contact(case, group, model, truth):
    full = list(model)+[e for e in truth if e not in ("quantization",)]
    best = None
    for fc in ((None, 70.) if "fx" in case["log"] and (FRICTION & set(full)) else (None,)):
        F = ContactFit(case["log"], case["rig"], {**case["base_values"], **case["values"]}, case["extra"], fc=fc)
        if fc and F.res > 4e-5: fc = 15.; F = ContactFit(case["log"], case["rig"], {**case["base_values"], **case["values"]}, case["extra"], fc=fc)
        r0 = F.fit(full)[0]; s0 = float((r0**2/F.sig**2).mean())
        if best is None or s0 < best[0]: best = (s0, F, r0)
    _, F, r0 = best
    read = F.readings(F.Y)
    sg = {"force": float(np.linalg.norm(case["sig"][:3]))}
    res = dict(ratio={}, ok=False)
    if group in ("one", "two"):
        rt = F.readings(r0)
        for e in truth:
            rb = F.readings(F.fit([x for x in full if x != e])[0])
            if e == "quantization":      # a detector, not a model: what is left without the lattice's own q/sqrt(12)
                q = case["values"]["quantization.step"]; sg1 = case["sig"][0]
                k = "fx" if "fx" in rb else "normal_force"
                rt2 = np.sqrt(max(rb[k]**2-q*q/12, sg1**2)); res["ratio"][e] = (k, rb[k], float(rt2), float(rb[k]/rt2)); continue
            k = acts_on(e, rb.keys(), rb, rt); res["ratio"][e] = (k, rb[k], rt[k], rb[k]/max(rt[k], 1e-12))
        res["ok"] = all(v[3] >= (2. if group == "one" else 1.5) for v in res["ratio"].values())
        left = rt["force"]
        if "quantization" in truth: left = float(np.sqrt(max(left**2-3*case["values"]["quantization.step"]**2/12, 0)))
    else:
        rb = F.readings(F.fit(list(model))[0]); left = rb["force"]
        if group == "outside":
            fl = case["floor"]; res["all"] = rb
            k = max((k for k in rb if k in fl), key=lambda k: rb[k]/max(fl[k], 1e-12)); res["ratio"]["outside"] = (k, rb[k], fl[k], rb[k]/fl[k]); res["ok"] = rb[k] >= 2*fl[k]
    sn = sg["force"]
    res["left"], res["share"], res["overnoise"] = left, left/read["force"], left/sn
    ok_nui = res["share"] <= (.02 if group in ("quiet", "not-excited") else .035) or res["overnoise"] <= 1.3
    res["clean"] = bool(ok_nui)
    if group in ("quiet", "not-excited"): res["ok"] = ok_nui
    return res
