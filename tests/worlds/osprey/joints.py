"""one joint-torque case: an arm in free motion, or a drive of one axis; and its linear fit"""
import os, tempfile
import numpy as np
import pinocchio as pin
from numba import njit
from scipy.ndimage import gaussian_filter1d
import world as w
from contact import pick, lu
from fits import smooth
JKEYS = {"joint-coulomb-friction": "fc", "joint-viscous-friction": "fv", "joint-friction-asymmetry": "a", "joint-torque-offset": "offset", "rotor-inertia": "inertia", "joint-torque-gain": "gain",
         "joint-stribeck-friction": "df", "joint-load-friction": "ratio", "joint-spring": "k"}


def pinmodel(urdf):
    return pin.buildModelFromXML(urdf)


def rnea(m, g, q, v, a):
    m.gravity.linear = np.asarray(g, float)
    d = m.createData()
    return np.stack([pin.rnea(m, d, q[i], v[i], a[i]).copy() for i in range(len(q))])


def build(rng, spec, boost=1., mild=1.):
    truth, model, hook = spec["truth"], spec["model"], spec.get("hook", "")
    allm = set(model) | set(truth)
    drive = spec["robot"] == "drive"
    static = spec.get("static", False)
    vals, bv, nui = {}, {}, {}
    T = spec.get("T", lu(rng, 12, 90)); fs = float(pick(rng, 100, 200, 250, 500, 1000))
    if static: T = 240.; fs = .2
    while fs*T > 25000: fs /= 2
    dtc = 1e-3 if T < 40 else 2e-3
    t = np.arange(0, T, dtc)
    if drive:
        n = 1; urdf = None; ch = None
        J = np.array([lu(rng, .01, .3)]); scale = np.array([lu(rng, 2, 12)])
        if "joint-elasticity" in truth: J[:] = rng.uniform(.05, .3)
    else:
        ch = (w.lwr if spec["robot"] == "lwr" else w.own_arm)(rng, np.array([0, 0, .1]))
        urdf = ch.urdf(); n = ch.n
        J = np.linspace(2., .3, n); scale = np.array([8, 9, 6, 5, 3, 2, 1.5])[:n]*rng.uniform(.3, .8)*.5
    # motion
    qd = np.zeros((len(t), n))
    fast = 1.
    for j in range(n):
        if drive and rng.random() < .45 or "joint-torque-ripple" in allm and rng.random() < .6:
            # speed plateaus, full turns
            k = int(max(6, T/2.5)); tw = np.linspace(0, T, k+1)
            span = 7. if drive else 2.4
            qd[:, j] = w.ramp(tw, np.r_[0, rng.uniform(-1, 1, k)*span*rng.choice([.1, .4, 1., 1.], k)][:, None], t, .2)[:, 0]
        else:
            f0 = rng.uniform(.05, .12); A = 1.2 if not drive else 2.2
            for k in range(1, 6):
                qd[:, j] += rng.uniform(.3, 1)*A/k**1.3*np.sin(2*np.pi*f0*k*t+rng.uniform(0, 6.28))*.55
            qd[:, j] += 0 if drive else rng.uniform(-.5, .5)
        if "joint-elasticity" in truth and drive:
            K = 0
    if static:
        k = int(T*fs); tw = np.linspace(0, T, k+1)
        qd = w.minjerk(tw, rng.uniform(-1.2, 1.2, (k+1, n)), t); u = (t % (tw[1]))/tw[1]; kk = np.clip(np.searchsorted(tw, t, side="right")-1, 0, k-1)
        P = rng.uniform(-1.2, 1.2, (k+1, n)); u = np.clip(((t-tw[kk])/tw[1])/.6, 0, 1); b = (10*u**3-15*u**4+6*u**5)[:, None]; qd = P[kk]*(1-b)+P[kk+1]*b
    if not static: qd = gaussian_filter1d(qd, .12/dtc, axis=0)
    if spec.get("still") is not None: qd[:, spec["still"]] = 0
    if "rotor-inertia" in truth or "joint-elasticity" in truth:
        qd += .06*np.sin(2*np.pi*np.cumsum(np.linspace(.5, 3.5 if drive else 2.5, len(t)))*dtc)[:, None] if not static else 0
    z = np.zeros(n)
    Fc = scale*rng.uniform(.6, 1.4, n)*(.12 if drive else .35) if {"joint-coulomb-friction", "joint-friction-asymmetry", "joint-stribeck-friction"} & allm else z.copy()
    Fv = scale*rng.uniform(.5, 1.5, n)*(.06 if drive else .15) if "joint-viscous-friction" in allm else z.copy()
    if "joint-viscous-friction" in truth: Fv *= boost
    asym = rng.uniform(.25, .45, n)*pick(rng, -1, 1)*min(boost, 1.8) if "joint-friction-asymmetry" in allm else z
    dF = Fc*rng.uniform(.6, 1.2, n)*boost if "joint-stribeck-friction" in allm else z
    vs = lu(rng, .04, .2)
    ftype = pick(rng, 0, 1, 3)
    wn, zeta = lu(rng, 15, 60), rng.uniform(.7, 1.)
    if drive: wn = min(300., max(wn, float(np.sqrt(lu(rng, 30, 200)*scale[0]/J[0]))))      # a drive's servo is stiff against its friction
    Lb, vr = lu(rng, 1e-4, 1e-3), lu(rng, 1e-3, 6e-3)
    o = w.jointsim(qd, dtc, J*1., wn, zeta, Fc*(1+asym), Fc*(1-asym), Fv, Lb, ftype, vr, dF, vs)
    q, v, a, fr = o[:, 0], o[:, 1], o[:, 2], o[:, 3]
    if "joint-friction-asymmetry" in allm: fr = fr+Fv*v*asym*np.sign(v)
    for e, arr in (("joint-coulomb-friction", Fc), ("joint-viscous-friction", Fv), ("joint-friction-asymmetry", asym), ("joint-stribeck-friction", dF)):
        if e in allm:
            (vals if e in truth else bv).update({f"{e}.{JKEYS[e]}.joint_{j+1}": float(arr[j]) for j in range(n)})
    if "joint-stribeck-friction" in allm: (vals if "joint-stribeck-friction" in truth else bv)["joint-stribeck-friction.v_s"] = vs
    # rigid body
    g = np.array([0, 0, -9.81]); gt = g.copy()
    if not drive and rng.random() < .3: g = np.array([0, 0, 9.81]); gt = g.copy()
    if "gravity-error" in truth and not drive:
        th = np.radians(min(9., rng.uniform(2., 4.)*boost)); ph = rng.uniform(0, 6.28); gt = w.rpy(th*np.cos(ph), th*np.sin(ph), 0)@g
        vals.update({f"gravity-error.g_{c}": float(x) for c, x in zip("xyz", gt-g)})
    elif not drive and rng.random() < .5:
        th = np.radians(.3)*rng.random()*mild; ph = rng.uniform(0, 6.28); gt = w.rpy(th*np.cos(ph), th*np.sin(ph), 0)@g; nui["level"] = 1
    st = 1 if T < 40 else 1
    if drive:
        tau = J*a
        bv["rigid-body.inertia"] = float(J[0])
        if "gravity-error" in truth:
            x = scale[0]*.25*boost; ph = rng.uniform(0, 6.28); tau = tau+x*np.sin(q+ph); vals["gravity-error.amplitude"] = float(x); vals["gravity-error.phase"] = ph
    else:
        m = pinmodel(urdf)
        if "payload" in truth:
            mp = min(4., rng.uniform(.3, 1.)*boost); c = np.array([rng.uniform(-.02, .02), rng.uniform(-.02, .02), rng.uniform(.05, .12)])
            Ip = np.eye(3)*mp*.03**2
            fid = m.getFrameId("ft_sensor"); F = m.frames[fid]
            m.inertias[n] = m.inertias[n]+F.placement.act(pin.Inertia(mp, c, Ip))
            vals["payload.mass"] = mp; vals.update({f"payload.com_{k}": float(x) for k, x in zip("xyz", c)})
        if rng.random() < .5:       # inertial table off by 1 %
            for j in range(1, n+1): m.inertias[j] = pin.Inertia(m.inertias[j].mass*(1+rng.uniform(-.01, .01)*mild), m.inertias[j].lever, m.inertias[j].inertia)
            nui["table"] = 1
        k = max(1, int(round(.004/dtc)))
        ti = np.arange(0, len(t), k)
        tr = rnea(m, gt, q[ti], v[ti], a[ti])
        tau = np.stack([np.interp(t, t[ti], tr[:, j]) for j in range(n)], 1)
    rig_tau = tau.copy()

    def add(e, arr, sym):
        (vals if e in truth else bv).update({f"{e}.{sym}.joint_{j+1}": float(arr[j]) for j in range(n)})
    tau = tau+fr
    amp = tau.std(0)+1e-3
    if "joint-torque-offset" in allm: x = amp*rng.uniform(.1, .3, n)*rng.choice([-1, 1], n)*boost; tau = tau+x; add("joint-torque-offset", x, "offset")
    if "rotor-inertia" in allm: x = (np.array([.9, .9, .5, .5, .2, .13, .13])[:n]*rng.uniform(.8, 2., n)*min(boost, 2.5)); tau = tau+x*a; add("rotor-inertia", x, "inertia")
    if "joint-spring" in allm:
        x = amp*rng.uniform(.25, .6, n)*boost/2; x *= 1
        if spec.get("still") is not None: x *= 0; x[spec["still"]] = 5.
        tau = tau+x*q; add("joint-spring", x, "k")
    if "joint-torque-ripple" in allm:
        k = int(pick(rng, 2, 4, 6, 8)); x = amp*rng.uniform(.12, .25, n)*boost; ph = rng.uniform(0, 6.28, n); tau = tau+x*np.sin(k*q+ph)+.3*x*np.sin(2*k*q+1.)
        vals["joint-torque-ripple.k"] = k; add("joint-torque-ripple", x, "amplitude"); add("joint-torque-ripple", ph, "phase")
    if "joint-load-friction" in allm: x = rng.uniform(.05, .12, n)*min(boost, 2.5); tau = tau+x*np.abs(rig_tau)*np.tanh(v/3e-3); add("joint-load-friction", x, "ratio")
    if "joint-torque-gain" in allm: x = rng.uniform(.04, .09, n)*rng.choice([-1, 1], n)*min(boost, 2.5); tau = tau*(1+x); add("joint-torque-gain", x, "gain")
    if hook == "drag": x = scale*.12*boost/np.mean(v**4, 0)**.5*1.; tau = tau+x*v*np.abs(v)
    if hook == "torque-crosstalk": tau = tau.copy(); tau[:, 2] += min(.3, .07*boost)*tau[:, 1]; tau[:, 4] -= min(.3, .06*boost)*tau[:, 3]
    if hook == "warm-up": tau = tau+fr*(-min(.7, .4*boost)*(1-np.exp(-t/(T/2.5))))[:, None]
    qm = q.copy()
    if "joint-elasticity" in allm:
        if drive: Kj = np.array([J[0]*(2*np.pi*rng.uniform(7, 10))**2/boost])
        else: Kj = np.array([1e4, 1e4, 1e4, 1e4, 1e4, 7.5e3, 7.5e3])[:n]*rng.uniform(.08, .2)/boost
        qm = q+tau/Kj; add("joint-elasticity", Kj, "stiffness")
    # sampling
    ts = np.arange(0, T-.06, 1/fs)+.02
    if static: ts = ts+.78/fs
    if rng.random() < .5 and not static: ts = ts+rng.uniform(-.2, .2, len(ts))/fs; nui["jitter"] = 1
    if rng.random() < .5 and not static: ts = ts[rng.random(len(ts)) > rng.uniform(.002, .03)]; nui["dropped"] = 1
    lp = lu(rng, 5., 50.)*(1 if mild >= 1 else 1/mild)
    nui["torque-lowpass"] = lp
    tl = w.lowpass(t, np.ascontiguousarray(tau), 1/(2*np.pi*lp))
    off = rng.uniform(-.003, .003)*mild if rng.random() < .5 else 0.
    th = ts+off
    if rng.random() < .5 and not static: fh = rng.uniform(60, 400)/max(mild, .2); th = np.floor(th*fh)/fh; nui["hold"] = fh
    it = lambda A, tt: np.stack([np.interp(tt, t, A[:, j]) for j in range(n)], 1)
    Y0 = it(tl, th)
    sig = np.full(n, 1.)*amp*lu(rng, .003, .03)*max(mild, .4)
    Y = Y0+rng.normal(size=Y0.shape)*sig
    if rng.random() < .5: Y = Y+np.outer(np.sin(3*ts/T), rng.uniform(-.6, .6, n)*sig); nui["temperature"] = 1
    stp = sig*.5
    Y = np.round(Y/stp)*stp
    res = lu(rng, 2e-6, 1e-3*max(mild**3, .004)); nui["encoder"] = res
    log = {"t": ts}
    Q = np.round(it(qm, ts)/res)*res
    for j in range(n): log[f"q{j+1}"] = Q[:, j]
    if rng.random() < .6 and not static:
        dq = w.lowpass(ts, np.ascontiguousarray(np.gradient(it(qm, ts), ts, axis=0)), lu(rng, .002, .03))+rng.normal(size=Q.shape)*lu(rng, 2e-5, 5e-4)+rng.uniform(-2e-4, 2e-4, n)
        for j in range(n): log[f"dq{j+1}"] = dq[:, j]
    for j in range(n): log[f"tau{j+1}"] = Y[:, j]
    rig = "# a drive: one axis, no robot\n" if drive else '[robot]\nmodel = "robot.urdf"\nsensor_frame = "ft_sensor"\ntip_frame = "tool_tip"\ngravity = [%.6g, %.6g, %.6g]\njoints = %s\n' % (*g, str([f"joint_{i+1}" for i in range(n)]).replace("'", '"'))
    return dict(kind="joints", log=log, rig=dict(text=rig, g=g, ch=ch), urdf=urdf, values=vals, base_values=bv, true_error=float(np.sqrt(((Y-Y0)**2).mean())), extra=dict(L=Lb, vr=vr, ftype=int(ftype)), nui=nui, sig=sig.tolist(), fs=fs, T=T)


@njit(cache=True)
def bristle(q, L, ft):
    o = np.zeros_like(q)
    for j in range(q.shape[1]):
        z = 0.
        for i in range(1, len(q)):
            d = q[i, j]-q[i-1, j]
            if ft == 1: z = min(1., max(-1., z+d/L))
            else:
                s = 1. if d > 0 else -1.
                z = s+(z-s)*np.exp(-abs(d)/L)
            o[i, j] = z
    return o


class JointFit:
    def __init__(self, log, rig, urdf, values, nmax=2500, fc=None, extra=None):
        extra = extra or {}
        t = np.asarray(log["t"]); n = sum(1 for k in log if k.startswith("tau"))
        Q = np.stack([log[f"q{j+1}"] for j in range(n)], 1); Y = np.stack([log[f"tau{j+1}"] for j in range(n)], 1)
        fs = 1/np.median(np.diff(t)); self.n, self.v = n, values
        idx = np.arange(0, len(t), max(1, int(np.ceil(len(t)/nmax))))
        if fs < 5: self.q, self.dq, self.ddq = Q, Q*0, Q*0; self.sg = Q*0
        else:
            du = np.unique(np.abs(np.diff(Q.ravel()))); du = du[du > 1e-9]
            fc = fc or (15. if (len(du) and du[0] < 4e-5) else 7.)
            tu, U, V = smooth(t, Q, fc); A = np.gradient(V, tu[1]-tu[0], axis=0)
            b = lambda X: np.stack([np.interp(t[idx], tu, X[:, j]) for j in range(n)], 1)
            self.q, self.dq, self.ddq = b(U), b(V), b(A)
            self.sg = b(self.state(U, V, extra))
        self.Y = Y[idx]; self.urdf, self.g = urdf, rig["g"]
        self.m = pinmodel(urdf) if urdf else None
        self.rb = rnea(self.m, self.g, self.q, self.dq, self.ddq) if urdf else None

    def state(self, U, V, x):
        if not x: return np.tanh(V/4e-3)
        return V/np.sqrt(V*V+x['vr']**2) if x['ftype'] == 3 else bristle(U, x['L'], x['ftype'])

    def fit(self, effects):
        n, q, v, a = self.n, self.q, self.dq, self.ddq
        Y = self.Y-(self.rb if self.rb is not None else 0)
        load = self.rb if self.rb is not None else None
        per = [[] for _ in range(n)]; shared = []
        sg = self.sg
        for j in range(n):
            c = per[j]
            if self.rb is None: c.append(a[:, j])
            if "joint-coulomb-friction" in effects or "joint-friction-asymmetry" in effects or "joint-stribeck-friction" in effects: c.append(sg[:, j])
            if "joint-viscous-friction" in effects: c.append(v[:, j])
            if "joint-friction-asymmetry" in effects: c += [np.abs(sg[:, j])]+([np.abs(v[:, j])] if "joint-viscous-friction" in effects else [])
            if "joint-torque-offset" in effects: c.append(np.ones(len(q)))
            if "rotor-inertia" in effects: c.append(a[:, j])
            if "joint-spring" in effects: c.append(q[:, j])
            if "joint-stribeck-friction" in effects: c.append(sg[:, j]*np.exp(-(v[:, j]/self.v["joint-stribeck-friction.v_s"])**2))
            if "joint-torque-ripple" in effects:
                k = self.v["joint-torque-ripple.k"]; c += [np.sin(k*q[:, j]), np.cos(k*q[:, j]), np.sin(2*k*q[:, j]), np.cos(2*k*q[:, j])]
            if load is not None and "joint-load-friction" in effects: c.append(np.abs(load[:, j])*sg[:, j])
            if "joint-torque-gain" in effects:
                c.append(load[:, j]); c.append(self.Y[:, j]*0)
            if "gravity-error" in effects and self.rb is None: c += [np.sin(q[:, j]), np.cos(q[:, j])]
        if "joint-elasticity" in effects:
            K = np.array([self.v[f"joint-elasticity.stiffness.joint_{j+1}"] for j in range(n)])
            tu, U, _ = smooth(self._t, self.Y, 12.)
            D = U/K; h = tu[1]-tu[0]; D1 = np.gradient(D, h, axis=0); D2 = np.gradient(D1, h, axis=0)
            b = lambda X: np.stack([np.interp(self._t, tu, X[:, j]) for j in range(n)], 1)
            D, D1, D2 = b(D), b(D1), b(D2)
            if self.rb is None: per[0][0] = a[:, 0]-D2[:, 0]
            else: Y = self.Y-rnea(self.m, self.g, q-D, v-D1, a-D2)
        if "gravity-error" in effects and self.rb is not None:
            for k in range(3):
                g2 = np.array(self.g, float); g2[k] += 1.; shared.append(rnea(self.m, g2, q, v, a)-self.rb)
        if "payload" in effects:
            fid = self.m.getFrameId("ft_sensor"); pl = self.m.frames[fid].placement
            mp = self.v["payload.mass"]; c0 = np.array([self.v[f"payload.com_{k}"] for k in "xyz"])
            m2 = pinmodel(self.urdf); m2.inertias[n] = m2.inertias[n]+pl.act(pin.Inertia(mp, c0, np.eye(3)*1e-3*mp)); shared.append(rnea(m2, self.g, q, v, a)-self.rb)
        M = len(q)
        cols = []
        wgt = 1/np.maximum(self.Y.std(0), 1e-6)
        for j in range(n):
            for c in per[j]:
                X = np.zeros((M, n)); X[:, j] = c; cols.append((X*wgt).ravel())
        for s in shared: cols.append((s*wgt).ravel())
        if cols:
            A = np.stack(cols, 1); s = np.linalg.norm(A, axis=0)+1e-12
            c = np.linalg.lstsq(A/s, (Y*wgt).ravel(), rcond=1e-10)[0]
            return Y-(A/s@c).reshape(M, n)/wgt
        return Y


def judge_joints(case, group, model, truth):
    full = list(model)+list(truth)
    t = np.asarray(case["log"]["t"]); cand = []
    for fc, ex in ((None, None), (None, 1), (4., 1), (30., 1), (60., 1), (120., 1)):
        F = JointFit(case["log"], case["rig"], case["urdf"], {**case["base_values"], **case["values"]}, fc=fc, extra=case['extra'] if ex else None); F._t = t[::max(1, int(np.ceil(len(t)/2500)))]
        cand.append((float((F.fit(full)**2/F.Y.var(0)).mean()), len(cand), F))
        if 1/np.median(np.diff(t)) < 5: break
    F = min(cand)[2]
    rms = lambda r: np.sqrt((r**2).mean(0))
    sig = np.array(case["sig"]); Yr = rms(F.Y)
    res = dict(ratio={}, ok=False)
    if group in ("one", "two"):
        rt = rms(F.fit(full))
        for e in truth:
            rb = rms(F.fit([x for x in full if x != e])); j = int(np.argmax(rb/rt)); res["ratio"][e] = (f"tau{j+1}", float(rb[j]), float(rt[j]), float(rb[j]/rt[j]))
        res["ok"] = all(x[3] >= (2. if group == "one" else 1.5) for x in res["ratio"].values()); left = rt
    else:
        left = rms(F.fit(list(model)))
        if group == "outside":
            fl = np.array(case["floor"]["all"]); j = int(np.argmax(left/fl)); res["ratio"]["outside"] = (f"tau{j+1}", float(left[j]), float(fl[j]), float(left[j]/fl[j])); res["ok"] = left[j] >= 2*fl[j]
    N = np.linalg.norm
    res["left"], res["share"], res["overnoise"] = float(N(left)), float(N(left)/N(Yr)), float(N(left)/N(sig)); res["alljoints"] = left.tolist()
    ok = res["share"] <= (.02 if group in ("quiet", "not-excited") else .035) or res["overnoise"] <= 1.3
    res["clean"] = bool(ok)
    if group in ("quiet", "not-excited"): res["ok"] = bool(ok)
    return res
