"""one contact (or free wrench) case: robot with wrist sensor, or tester"""
import numpy as np
import world as w
from world import law, IX

NOISE = np.array([.015, .015, .029, .0005, .0006, .0003])
LAWS = {"hooke": 1.0, "kelvin-voigt": 1.0, "zener": 1.0, "hertz": 1.5, "hunt-crossley": 1.5}
SPARAMS = {  # contact effect -> (symbol, index name)
    "hertz-exponent": [("n", "N")], "viscous-damping": [("c", "C")], "hunt-crossley-damping": [("lambda", "LAM")], "relaxation": [("ratio", "R1"), ("tau", "T1")],
    "hysteresis": [("amplitude", "HA"), ("length", "HL")], "stress-softening": [("ratio", "MR"), ("length", "ML")], "adhesion": [("force", "AF"), ("length", "AL")],
    "stiffening-layer": [("stiffness", "LK"), ("depth", "LD")], "surface-offset": [("offset", "Z0")], "stiffness-drift": [("rate", "DR")],
    "stiffness-inhomogeneity": [("amplitude", "IA"), ("x", "IXX"), ("width", "IW")], "coulomb-friction": [("mu", "MU")], "viscous-friction": [("c", "VF")],
    "stribeck-friction": [("delta_mu", "DMU"), ("v_s", "VS")], "presliding": [("length", "FL")], "friction-rounding": [("v_r", "VR")],
    "load-dependent-friction": [("p", "LP")], "friction-anisotropy": [("a", "AN")]}
IX["IXX"] = w.IXX
FRICTION = {"coulomb-friction", "viscous-friction", "stribeck-friction", "presliding", "friction-rounding", "load-dependent-friction", "friction-anisotropy"}


def pick(rng, *a):
    return a[rng.integers(len(a))]


def lu(rng, a, b):
    return float(np.exp(rng.uniform(np.log(a), np.log(b))))


def program(rng, prog, dm, truth, slow):
    """waypoints: rows d s1 s2 rx ry rz; segment durations; labels"""
    W = [[-.01, 0, 0, 0, 0, 0]]; D = []; L = []

    def go(dur, lab, **k):
        r = list(W[-1])
        for a, v in k.items():
            r["d s1 s2 rx ry rz".split().index(a)] = v
        W.append(r); D.append(max(dur, .08)*slow); L.append(lab)
    up = -rng.uniform(.004, .012)
    W[0][0] = up
    one_dir = "onedir" in prog
    go(.4, "free")
    if "air" in prog:
        fast = "fast" in prog
        go(.8, "free", d=-.07)
        for k in range(9 if fast else 5):
            go(rng.uniform(.35, .6) if fast else rng.uniform(1., 2.), "free", rx=rng.uniform(-.55, .55), ry=rng.uniform(-.55, .55), rz=rng.uniform(-.9, .9),
               **(dict(s1=rng.uniform(-.05, .05), s2=rng.uniform(-.05, .05))))
        go(1.2, "free", rx=0, ry=0, rz=0, s1=0, s2=0)
        go(.6, "free", d=up)
    if "poke" in prog:
        n = rng.integers(6, 12)
        deps = dm*rng.uniform(.4, 1., n)
        deps[rng.integers(2, n)] = dm
        if "stress-softening" in truth:
            deps = dm*np.array([.6, .6, 1., .7, 1., .8][:6]); n = 6
        inh = "stiffness-inhomogeneity" in truth
        for k in range(n):
            if inh or rng.random() < .5:
                go(.5, "free", s1=rng.uniform(-.02, .02), s2=rng.uniform(-.015, .015))
            if "tilt" in prog:
                go(.5, "free", rx=rng.uniform(-.3, .3), ry=rng.uniform(-.3, .3))
            sp = lu(rng, .08 if "quick" in prog else .3, 1.5)
            go(sp, "poke", d=deps[k])
            if rng.random() < .7:
                go(rng.uniform(.3, 2.), "hold")
            if rng.random() < .4:
                go(sp/2, "poke", d=deps[k]*.5); go(sp/2, "poke", d=deps[k])
            go(lu(rng, .3 if "quick" in prog else .5, 1.5)*(2 if "adhesion" in truth else 1), "retract", d=up)
        go(.3, "rest", rx=0, ry=0)
    if "slide" in prog:
        for dep in rng.permutation([rng.uniform(.35, .55), rng.uniform(.9, 1.)]):
            a = rng.uniform(.012, .03)
            go(.5, "free", s1=-a, s2=0)
            go(.8, "approach", d=dep*dm)
            go(.5, "hold")
            for k in range(4):
                go(2*a/lu(rng, .008, .08), "slide", s1=a); go(rng.choice([.08, .3]), "slide")
                go(2*a/lu(rng, .008, .08), "slide", s1=-a)
            for k in range(3 if not one_dir else 0):
                go(2*a/lu(rng, .01, .06), "slide", s1=-a*.3, s2=a); go(2*a/lu(rng, .01, .06), "slide", s2=-a)
            if "presliding" in truth:
                for k in range(8):
                    go(.3, "slide", s1=W[-1][1]+rng.uniform(.5e-3, 3e-3)*(-1)**k)
            else:
                go(.25, "slide", s1=W[-1][1]+.002); go(.25, "slide", s1=W[-1][1]-.002)
            go(.6, "retract", d=up)
        go(.3, "rest", s1=0, s2=0)
    return np.array(W, float), np.array(D), L


def effect_value(e, rng, P, c, boost):
    dm, Fm = c["dm"], c["Fm"]
    b = boost
    s = pick(rng, -1, 1)
    v = {}

    def put(**k):
        for a, x in k.items():
            P[IX[a]] = x
    if e == "hertz-exponent":
        n = min(1.9, 1+rng.uniform(.25, .5)*b); put(N=n, K=Fm/dm**n)
    elif e == "viscous-damping": put(C=min(120., rng.uniform(.05, .12)*Fm/dm*b/3))
    elif e == "hunt-crossley-damping": put(LAM=min(12., rng.uniform(1., 3.)*b))
    elif e == "relaxation": put(R1=min(.8, rng.uniform(.12, .35)*b), T1=lu(rng, .25, 3.))
    elif e == "hysteresis": put(HA=min(.3, rng.uniform(.05, .12)*b)*Fm, HL=rng.uniform(.08, .25)*dm)
    elif e == "stress-softening": put(MR=min(.6, rng.uniform(.18, .35)*b), ML=rng.uniform(.15, .4)*dm)
    elif e == "adhesion": put(AF=rng.uniform(.05, .12)*Fm*b, AL=rng.uniform(.3e-3, 1.5e-3))
    elif e == "stiffening-layer": put(LK=rng.uniform(.7, 2.)*Fm/dm*b, LD=rng.uniform(.45, .65)*dm)
    elif e == "surface-offset": put(Z0=s*min(.35*dm, rng.uniform(.1, .22)*dm*b))
    elif e == "stiffness-drift": put(DR=s*min(.4, rng.uniform(.15, .25)*b)/c["T"])
    elif e == "stiffness-inhomogeneity":
        k = int(rng.integers(1, 4))
        put(IK=k, IA=s*min(.7, rng.uniform(.25, .45)*b) if k < 3 else s*min(.5, .25*b), IXX=rng.uniform(-.006, .006), IY=0., IW=rng.uniform(.003, .008) if k < 3 else .02)
        v["form"] = ["", "edge", "inclusion", "gradient"][k]
    elif e == "coulomb-friction": put(MU=rng.uniform(.25, .8))
    elif e == "viscous-friction": put(VF=rng.uniform(.15, .4)*c["mu"]*Fm/.05*b/2)
    elif e == "stribeck-friction": put(DMU=min(1., rng.uniform(.35, .7)*b)*c["mu"], VS=lu(rng, .004, .02))
    elif e == "presliding": put(FL=min(4e-3, lu(rng, .5e-3, 1.5e-3)*b))
    elif e == "friction-rounding": put(VR=min(.04, lu(rng, .006, .02)*b), FT=3)
    elif e == "load-dependent-friction": put(LP=-min(.6, rng.uniform(.2, .35)*b), LN0=round(Fm/2, 2))
    elif e == "friction-anisotropy": put(AN=s*min(.5, rng.uniform(.15, .3)*b))
    for sym, nm in SPARAMS.get(e, []):
        x = P[IX[nm]]
        v[sym] = float(x*60 if nm == "DR" else x)
    if e == "load-dependent-friction":
        v["N0"] = P[IX["LN0"]]
    return v


def build(rng, spec, boost=1., mild=1.):
    truth, model, prog, hook = spec["truth"], spec["model"], spec["prog"], spec.get("hook", "")
    tester = spec["robot"] == "tester"
    allm = set(model) | set(truth)
    c = {"dm": rng.uniform(2.5e-3, 7e-3)}
    c["Fm"] = lu(rng, 4., 22.) if not tester else lu(rng, 2., 60.)
    if "structural-compliance" in truth: c["Fm"] = rng.uniform(15, 35); c["dm"] = rng.uniform(2.5e-3, 4e-3)
    dm, Fm = c["dm"], c["Fm"]
    c["mu"] = rng.uniform(.3, .8)
    vals = {}; base_vals = {}
    base = model[0]
    free = base == "none"
    n0 = LAWS.get(base, 1.)
    P = law(K=0 if free else Fm/dm**n0, N=n0)
    if not free:
        if base == "kelvin-voigt": P[w.C] = rng.uniform(.01, .04)*Fm/dm
        if base == "hunt-crossley": P[w.LAM] = rng.uniform(.5, 2.5)
        if base == "zener": P[w.R1], P[w.T1] = rng.uniform(.15, .4), lu(rng, .3, 2.)
    if FRICTION & allm:
        P[w.MU] = c["mu"]
        if not ({"presliding", "friction-rounding"} & allm):
            P[w.FT] = pick(rng, 0, 0, 1, 2, 3); P[w.FL] = lu(rng, 8e-5, 2.5e-4); P[w.SIG] = rng.uniform(0, 3e-4); P[w.VR] = rng.uniform(2e-4, 8e-4)
            if "friction-anisotropy" in allm or "stribeck-friction" in allm: P[w.FT] = pick(rng, 0, 1)
        else:
            P[w.FT] = 0
    W, D, L = program(rng, prog, dm, truth, spec.get("slow", 1.)*rng.uniform(.8, 1.2))
    T = D.sum()
    want = spec.get("T", lu(rng, 5, 90) if T < 60 else T)
    reps = max(1, int(round(want/T)))
    if reps > 1:
        W = np.vstack([W]+[W[1:]]*(reps-1)); D = np.tile(D, reps); L = L*reps
    T = float(D.sum()); c["T"] = T
    order = sorted(model[1:]+truth, key=lambda e: e == "hertz-exponent", reverse=True)
    for e in order:
        if e in SPARAMS:
            v = effect_value(e, rng, P, c, boost if e in truth else (.6 if e != "coulomb-friction" else 1))
            (vals if e in truth else base_vals).update({f"{e}.{k}": x for k, x in v.items()})
    if spec["group"] == "not-excited":
        e = truth[0]
        if e == "stiffening-layer": P[w.LD] = 1.6*dm
        if e == "relaxation": P[w.T1] = rng.uniform(25, 40)*T; P[w.R1] = .3
        if e == "viscous-damping": P[w.C] = .02*Fm/dm
        for sym, nm in SPARAMS.get(e, []):
            vals[f"{e}.{sym}"] = float(P[IX[nm]])
    # what the hand-in model does not know, by little
    nui = {}
    m_ = pick(rng, "", "spring-foundation", "two-tau")
    if not free and m_ == "spring-foundation": P[w.EPS] = rng.uniform(-.04, .04)/dm*mild; nui["foundation"] = P[w.EPS]
    if not free and m_ == "two-tau" and (P[w.R1] > 0): P[w.R2], P[w.T2] = .08*P[w.R1]*mild, P[w.T1]*rng.uniform(3, 6)
    if hook == "set": P[w.PL] = rng.uniform(.06, .15)*dm/(Fm*T*.3)*boost
    if hook == "magnet": P[w.MAG], P[w.MAGL] = rng.uniform(.06, .15)*Fm*boost, rng.uniform(.003, .008)
    base_vals[base+".k"] = P[w.K]; base_vals[base+".n"] = P[w.N]
    for s, nm in (("c", "C"), ("lambda", "LAM"), ("ratio", "R1"), ("tau", "T1")): base_vals[base+"."+s] = P[IX[nm]]
    # ---- motion
    fs = spec.get("fs") or float(pick(rng, 50, 100, 125, 200, 250, 500, 500, 1000, 1000, 2000))
    if {"time-offset", "sensor-lag", "mains-hum", "viscous-damping", "tool-inertia"} & set(truth) or hook in ("buzz",): fs = max(fs, 250.)
    while fs*T > 40000: fs /= 2
    fs = max(fs, 50.)
    dtc, sub = (1e-3, 5) if T < 100 else (2e-3, 10)
    if fs > 1000: dtc, sub = 5e-4, 4
    t = np.arange(0, T, dtc)
    tw = np.r_[0, np.cumsum(D)]
    G = w.ramp(tw, W, t, .15) if "slide" in prog and not "air" in prog else w.minjerk(tw, W, t)
    G[:, 3:] = w.minjerk(tw, W[:, 3:], t)
    stiff = lu(rng, .6, 12)*Fm/dm
    Kn, Kt = (2e6, 2e6) if tester else (stiff, lu(rng, 500, 4000)*1.)
    Kt = max(Kt, c["mu"]*Fm/.006)
    cmd = np.ascontiguousarray(G[:, :3])
    if not tester and not free:
        pos = np.clip(cmd[:, 0], 0, None)
        cmd[:, 0] += Fm/Kn*(pos/dm)
    Mt = 25. if tester else rng.uniform(3, 10)
    X = w.closedloop(cmd, dtc, sub, 1, P, Mt, float(Kn), float(Kt), rng.uniform(.6, 1.), 0)
    if not np.isfinite(X).all() or np.abs(X[:, :3]).max() > .3:
        raise RuntimeError("unstable")
    d, s1, s2 = X[:, 0], X[:, 1], X[:, 2]
    Nf, F1, F2 = X[:, 9], X[:, 10], X[:, 11]
    # ---- sampling
    ts = np.arange(0, T-2/fs-.05, 1/fs)+.02
    if rng.random() < .5: ts = ts+rng.uniform(-.3, .3, len(ts))/fs*rng.uniform(.1, 1); nui["jitter"] = 1
    if rng.random() < .5: ts = ts[rng.random(len(ts)) > rng.uniform(.002, .04)]; nui["dropped"] = 1
    off = 0.
    if "time-offset" in truth: off = pick(rng, -1, 1)*min(.06, rng.uniform(.012, .03)*boost); vals["time-offset.offset"] = off
    elif rng.random() < .5: off = rng.uniform(-.003, .003)*mild; nui["clock"] = off
    tq = ts-off            # the wrench stamped t was taken at t - off
    if hook == "skew": tq = ts-(ts-T/2)*rng.uniform(.0008, .002)*boost*max(1, 40/T)
    it = lambda A, tt: np.stack([np.interp(tt, t, A[:, j]) for j in range(A.shape[1])], 1) if A.ndim == 2 else np.interp(tt, t, A)
    log = {"t": ts}
    ns = lu(rng, .1, 3)
    if boost > 2: ns = min(ns, 1.)
    lagt = 0.
    if "sensor-lag" in truth: lagt = min(.08, rng.uniform(.012, .03)*boost); vals["sensor-lag.tau"] = lagt
    if tester:
        Y = np.stack([Nf, F1, F2], 1) if FRICTION & allm else Nf[:, None]
        sig = np.full(Y.shape[1], ns*max(.01, 5e-4*Fm))
    else:
        r_tip = np.array([0, 0, round(rng.uniform(.07, .18), 4)])
        ch = (w.lwr if spec["robot"] == "lwr" else w.own_arm)(rng, r_tip)
        hang = spec["robot"] == "own" and rng.random() < .4
        g = np.array([0, 0, 9.81]) if hang else np.array([0, 0, -9.81])
        m = rng.uniform(.15, .6); com = np.array([rng.uniform(-.006, .006), rng.uniform(-.006, .006), rng.uniform(.3, .5)*r_tip[2]])
        if free: m = rng.uniform(.4, .9)
        I = np.array([1., 1., .4])*m*.03**2*rng.uniform(.3, .6)
        rm, rc, rI = m, com.copy(), I.copy()       # what the rig says
        if "tool-mass" in truth: x = pick(rng, -1, 1)*min(.4*m, rng.uniform(.03, .1)*boost); rm = m-x; vals["tool-mass.mass"] = x
        if "tool-com" in truth: x = rng.uniform(-1, 1, 3)*[1, 1, 1.5]; x *= min(.03, rng.uniform(.004, .009)*boost)/np.linalg.norm(x); rc = com-x; vals.update({f"tool-com.{a}": float(b) for a, b in zip("xyz", x)})
        if "tool-inertia" in truth:
            I = np.array([1., .9, .5])*m*min(.09, rng.uniform(.04, .06)*np.sqrt(boost))**2; rI = np.zeros(3)
            vals.update({"tool-inertia.ixx": I[0], "tool-inertia.iyy": I[1], "tool-inertia.izz": I[2]})
        if rng.random() < .6 and mild > 0:
            rm = rm*(1+rng.uniform(-.02, .02)*mild); nui["tool"] = 1
        lev = 0.
        gt = g.copy()
        if rng.random() < .5:
            a_ = rng.uniform(-.005, .005, 2)*mild; gt = w.rpy(a_[0], a_[1], 0)@g; nui["level"] = 1
            if rng.random() < .4: g = np.round(gt, 5)
        dtip = np.zeros(3)
        if "tip-offset" in truth: dtip = np.array([*rng.uniform(-1, 1, 2), 0]); dtip *= min(.006, rng.uniform(.0015, .003)*boost)/np.linalg.norm(dtip); vals.update({f"tip-offset.{a}": float(b) for a, b in zip("xyz", dtip)})
        Cc = np.zeros(3)
        if "structural-compliance" in truth: x = min(2.5e-4, rng.uniform(4e-5, 9e-5)*boost); Cc = np.array([x, 0., 0.]); vals["structural-compliance.C"] = x
        # place
        for k in range(40):
            if hang: nv = w.rpy(rng.uniform(-.2, .2), rng.uniform(-.2, .2), 0)@np.array([0, 0, -1.])
            elif rng.random() < .25: nv = w.rpy(rng.uniform(-.1, .1), 0, rng.uniform(-.3, .3))@np.array([-1., 0, 0])
            else: nv = w.rpy(rng.uniform(-.2, .2), rng.uniform(-.2, .2), 0)@np.array([0, 0, 1.])
            pt = np.array([rng.uniform(.38, .55), rng.uniform(-.2, .2), rng.uniform(.05, .25)])
            if hang: pt = np.array([rng.uniform(.25, .4), rng.uniform(-.15, .15), rng.uniform(.75, .95)])
            elif nv[0] < -.7: pt = np.array([rng.uniform(.55, .68), rng.uniform(-.15, .15), rng.uniform(.35, .55)])
            if spec["robot"] == "own" and not hang: pt[:2] *= .85
            t1 = np.cross([0, 1., 0], nv) if abs(nv[1]) < .8 else np.array([1., 0, 0])
            t1 /= np.linalg.norm(t1)
            nv = np.round(nv/np.linalg.norm(nv), 9); pt = np.round(pt, 4)
            t2 = np.cross(nv, t1)
            R0 = np.stack([t1, np.cross(-nv, t1), -nv], 1)
            q0 = ch.start(R0, pt-R0@r_tip, rng)
            if q0 is not None: break
        else:
            raise RuntimeError("no pose")
        ang = G[:, 3:]
        ca, sa = np.cos(ang), np.sin(ang)
        Rx = np.zeros((len(t), 3, 3)); Rx[:, 0, 0] = 1; Rx[:, 1, 1] = Rx[:, 2, 2] = ca[:, 0]; Rx[:, 1, 2] = -sa[:, 0]; Rx[:, 2, 1] = sa[:, 0]
        Ry = np.zeros_like(Rx); Ry[:, 1, 1] = 1; Ry[:, 0, 0] = Ry[:, 2, 2] = ca[:, 1]; Ry[:, 0, 2] = sa[:, 1]; Ry[:, 2, 0] = -sa[:, 1]
        Rz = np.zeros_like(Rx); Rz[:, 2, 2] = 1; Rz[:, 0, 0] = Rz[:, 1, 1] = ca[:, 2]; Rz[:, 0, 1] = -sa[:, 2]; Rz[:, 1, 0] = sa[:, 2]
        R = R0@Rx@Ry@Rz
        B = np.stack([-nv, t1, t2])                       # rows: depth, slip1, slip2 directions
        pt_true = pt + X[:, :3]@B                          # the true contact point
        a_true = X[:, 6:9]@B
        fc = Nf[:, None]*nv + F1[:, None]*t1 + F2[:, None]*t2
        Rd = np.gradient(R, dtc, axis=0)
        om = Rd@R.transpose(0, 2, 1)
        om = np.stack([om[:, 2, 1], om[:, 0, 2], om[:, 1, 0]], 1)
        al = np.gradient(om, dtc, axis=0)
        lever = np.einsum("kij,j->ki", R, com-r_tip-dtip)
        acom = a_true+np.cross(al, lever)+np.cross(om, np.cross(om, lever))
        toS = lambda v: np.einsum("kji,kj->ki", R, v)
        ft = toS(m*(gt-acom)); fs_ = toS(fc)
        os_, as_ = toS(om), toS(al)
        tau = np.cross(com, ft)+np.cross(r_tip+dtip, fs_)-(as_*I+np.cross(os_, os_*I))
        Y = np.hstack([ft+fs_, tau])
        # log kinematics
        jump = np.zeros(len(t))
        if hook == "tipslip": jump[t > T*rng.uniform(.4, .6)] = pick(rng, -1, 1)*min(.3*dm, rng.uniform(.08, .15)*dm*boost)
        shift = -np.outer(Cc[0]*Nf, nv)                    # p_log = p_true - C f
        ps = pt_true+shift-np.einsum("kij,j->ki", R, r_tip+dtip)-R[:, :, 2]*jump[:, None]
        Rl = np.ascontiguousarray(np.stack([np.stack([np.interp(ts, t, R[:, i, j]) for j in range(3)], 1) for i in range(3)], 1))
        q0, e = w._ik(q0, np.ascontiguousarray(Rl[0]), it(ps, ts)[0], ch.P, ch.A, ch.Rs, ch.ps, 200)
        Q, worst = ch.track(Rl, it(ps, ts), q0)
        if worst > 1e-5 or np.abs(np.diff(Q, axis=0)).max() > .2: raise RuntimeError("ik")
        sig = NOISE*ns
        # sensor
        if "sensor-misalignment" in truth:
            r = rng.normal(size=3); r *= min(.15, rng.uniform(.03, .06)*boost)/np.linalg.norm(r)
            Rm = w._rod(r/np.linalg.norm(r), np.linalg.norm(r)); Y = np.hstack([Y[:, :3]@Rm, Y[:, 3:]@Rm]); vals.update({f"sensor-misalignment.{a}": float(b) for a, b in zip("xyz", r)})
    nc = Y.shape[1]
    if "sensor-gain" in truth: x = pick(rng, -1, 1)*min(.2, rng.uniform(.05, .09)*boost); Y = Y*(1+x); vals["sensor-gain.gain"] = x
    if "sensor-crosstalk" in truth:
        i, j = pick(rng, (0, 2), (1, 2), (0, 1)); x = pick(rng, -1, 1)*min(.1, rng.uniform(.025, .04)*boost)
        Y = Y.copy(); Y[:, i] += x*Y[:, j]; vals[f"sensor-crosstalk.{'fx fy fz'.split()[i]}_{'fx fy fz'.split()[j]}"] = x
    if rng.random() < .5:
        mx = np.abs(Y).max(0)+1e-9; Y = Y*(1+rng.uniform(-.01, .01, nc)*mild*np.abs(Y)/mx); nui["nonlinear"] = 1
    if lagt: Y = w.lowpass(t, np.ascontiguousarray(Y), lagt)
    elif rng.random() < .4: Y = w.lowpass(t, np.ascontiguousarray(Y), lu(rng, 3e-4, 2e-3)*mild)
    Ys = it(Y, tq)
    tm = ts/60
    fsc = np.where(np.arange(nc) < 3, 1., .05)
    bias_on = "sensor-bias" in model or "sensor-bias" in truth
    if bias_on:
        b = rng.uniform(-1, 1, nc)*fsc*rng.uniform(.3, 1.5)*boost; Ys = Ys+b
        (vals if "sensor-bias" in truth else base_vals).update({f"sensor-bias.{a}": float(x) for a, x in zip("fx fy fz tx ty tz".split(), b)})
    if "sensor-drift" in truth:
        b = rng.uniform(-1, 1, nc)*fsc; b *= rng.uniform(.25, .6)*boost/max(1e-9, np.abs(b).max())/min(T/60, 1.); Ys = Ys+np.outer(tm, b); vals.update({f"sensor-drift.{a}": float(x) for a, x in zip("fx fy fz tx ty tz".split(), b)})
    elif rng.random() < .5:
        Ys = Ys+np.outer(np.sin(2*np.pi*ts/T*rng.uniform(.3, .8)), rng.uniform(-.7, .7, nc)*sig*mild); nui["temperature"] = 1
    if "mains-hum" in truth:
        f = pick(rng, 50., 60.); a = np.zeros(nc); a[:3] = rng.uniform(.3, 1, min(3, nc))[:nc]*max(5*sig[0], .1)*boost
        Ys = Ys+np.outer(np.sin(2*np.pi*f*ts+rng.uniform(0, 6)), a)+np.outer(np.sin(4*np.pi*f*ts+1), .3*a); vals["mains-hum.frequency"] = f; vals["mains-hum.amplitude"] = float(a.max())
    if hook == "buzz":
        f = rng.uniform(13, 37); Ys = Ys+np.outer(np.sin(2*np.pi*f*ts+rng.uniform(0, 6)), np.r_[rng.uniform(.3, 1, min(3, nc))*max(6*sig[0], .12), np.zeros(max(0, nc-3))])*boost
    if hook == "freeze":
        for k in range(int(6*boost)+2):
            a = rng.uniform(0, T-1); sel = (ts > a) & (ts < a+rng.uniform(.3, .8))
            if sel.any(): Ys[sel] = Ys[np.argmax(sel)]
    clip = None
    cidx = 0 if tester else 2
    noise = rng.normal(size=Ys.shape)*sig
    if "saturation" in truth:
        clip = np.abs(Ys[:, cidx]).max()*(rng.uniform(.6, .75)/boost**.3 if spec["group"] != "not-excited" else 1.5); vals["saturation.limit"] = float(clip)
        vals["saturation.channel"] = "normal_force" if tester else "fz"
    Yn = Ys+noise
    if clip is not None:
        if pick(rng, 0, 1): Yn[:, cidx] = np.clip(Yn[:, cidx], -clip, clip)
        else: Yn[:, cidx] = np.clip(Ys[:, cidx], -clip, clip)+noise[:, cidx]
        Ys[:, cidx] = np.clip(Ys[:, cidx], -clip, clip)
    step = np.where(np.arange(nc) < 3, .01, .00025)*(1 if not tester else min(1., Fm/50))
    te = Yn.copy()
    if "quantization" in truth:
        st = max(9*sig[0], rng.uniform(.15, .3))*boost; step = np.where(np.arange(nc) < 3, st, step); vals["quantization.step"] = st
    Yq = np.round(Yn/step)*step
    err = (Yq if "quantization" not in truth else te)-Ys
    true_error = float(np.sqrt((err[:, :3]**2).mean()))
    # ---- log columns
    if tester:
        dn = lu(rng, 1e-7, 3e-6)*mild
        log["depth"] = np.round((np.interp(ts, t, d)+rng.normal(size=len(ts))*dn)/1e-6)*1e-6
        if rng.random() < .4: log["depth_rate"] = np.interp(ts, t, X[:, 3])+rng.normal(size=len(ts))*2e-4*rng.random()
        if FRICTION & allm:
            log["slip1"] = np.round(np.interp(ts, t, s1)/1e-6)*1e-6; log["slip2"] = np.round(np.interp(ts, t, s2)/1e-6)*1e-6
        for j, nm in enumerate(["normal_force", "tangential_force1", "tangential_force2"][:nc]): log[nm] = Yq[:, j]
        rig = "# a material tester, no robot\n"
        if rng.random() < .5: rig += f"[sensor]\nnoise = [{sig[0]:.5g}]\n" if 0 else ""
        out_rig = {"text": rig}
        urdf = None
    else:
        res = lu(rng, 2e-6, 1e-3*max(mild**4, .003)) if mild > 0 else 2e-6
        nui["encoder"] = res
        Qq = np.round(Q/res)*res
        for j in range(ch.n): log[f"q{j+1}"] = Qq[:, j]
        if rng.random() < .6:
            dq = np.gradient(Q, ts, axis=0)
            dq = w.lowpass(ts, np.ascontiguousarray(dq), lu(rng, .002, .03))
            dq = dq+rng.normal(size=dq.shape)*lu(rng, 2e-5, 5e-4)+rng.uniform(-2e-4, 2e-4, ch.n)
            for j in range(ch.n): log[f"dq{j+1}"] = dq[:, j]
            nui["dq"] = 1
        for j, nm in enumerate("fx fy fz tx ty tz".split()): log[nm] = Yq[:, j]
        urdf = ch.urdf()
        fmt = lambda v: "["+", ".join(f"{x:.9g}" for x in v)+"]"
        rig = f'[robot]\nmodel = "robot.urdf"\nsensor_frame = "ft_sensor"\ntip_frame = "tool_tip"\ngravity = {fmt(g)}\njoints = {[f"joint_{i+1}" for i in range(ch.n)]}\n'.replace("'", '"')
        rig += f'\n[tool]\nmass = {rm:.5g}\ncom = {fmt(np.round(rc, 6))}\n'
        if np.any(rI): rig += f"inertia = {fmt(np.r_[rI, 0, 0, 0])}\n"
        if not free: rig += f"\n[surface]\npoint = {fmt(pt)}\nnormal = {fmt(nv)}\ntangent = {fmt(t1)}\n"
        if rng.random() < .6:
            rig += f"\n[sensor]\nnoise = {fmt(sig)}\n"
            if clip is None: rig += "range = [40, 40, 120, 2, 2, 2]\n" if np.abs(Ys[:, :2]).max() < 40 else ""
        out_rig = dict(text=rig, ch=ch, g=g, m=rm, com=rc, I=rI, pt=pt, B=B, free=free, res=res)
    if rng.random() < .5 and not tester:
        k = np.clip(np.searchsorted(tw, ts, side="right")-1, 0, len(L)-1)
        log["phase"] = [L[i] for i in k]
    extra = dict(kind_clip=cidx, dm=dm, LN0=float(P[w.LN0]), IK=int(P[w.IK]), IY=float(P[w.IY]), FT=int(P[w.FT]), FL=float(P[w.FL]), VR=float(P[w.VR]), SIG=float(P[w.SIG]), P=P.tolist())
    return dict(kind="contact", log=log, rig=out_rig, urdf=urdf, values=vals, base_values=base_vals, true_error=true_error, extra=extra, nui=nui, sig=sig.tolist(), fs=fs, T=T)
