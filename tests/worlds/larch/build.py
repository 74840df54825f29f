"""From a recipe (dict) to simulated series and then to logged readings with nuisances."""
import os
import numpy as np
from scipy.signal import butter, lfilter, lfilter_zi
from chain import ARMS, write_urdf, merge, rpy, fk
from contact import params, bed, IX
from sims import arm_loop, tester_loop, drive_loop, Path
WCH = ["fx", "fy", "fz", "tx", "ty", "tz"]

def rotvec(v):
    v = np.asarray(v, float); a = np.linalg.norm(v)
    if a < 1e-14: return np.eye(3)
    k = v/a; X = np.array([[0, -k[2], k[1]], [k[2], 0, -k[0]], [-k[1], k[0], 0]])
    return np.eye(3)+np.sin(a)*X+(1-np.cos(a))*X@X

def fkine(A, q):
    R = np.zeros((A.n, 3, 3)); p = np.zeros((A.n, 3)); z = np.zeros((A.n, 3))
    R0 = np.array([rpy(*v) for v in A.rpy]); fk(A.n, R0, A.xyz, A.axis, np.asarray(q, float), R, p, z)
    Rs = R[-1]@rpy(*A.ft[1]); ps = p[-1]+R[-1]@A.ft[0]
    return Rs, ps, ps+Rs@np.array([0, 0, A.tip_z])

def jointpars(n, **k):
    J = np.zeros((17, n)); J[3] = 1.; J[9] = 1.; J[12] = 2e-3
    nm = dict(Fc=0, Fv=1, dFs=2, vs=3, asym=4, load=5, ks=6, q0=7, ra=8, rk=9, rp=10, bl=12, ra2=14)
    for a, b in k.items(): J[nm[a]] = b
    return J

def sim_arm(c, rng):
    A = ARMS[c["robot"]](); n = A.n
    q0 = A.seed+rng.uniform(-.12, .12, n)*c.get("spread", 1)
    Rs, ps, tip = fkine(A, q0)
    g = np.array(c.get("gravity", [0, 0, -9.81]), float); gtrue = rotvec(rng.normal(0, c.get("level", 4e-4), 3))@g
    tN = c["tool"]; dm = c.get("dm", 0.)+tN["mass"]*c.get("tool_off", 0.)
    tm = tN["mass"]+dm; tc = np.array(tN["com"], float)+np.array(c.get("dcom", [0, 0, 0.]), float)
    rad = .022; Ti = np.diag([tm*(rad**2/4+.02**2/1.2)]*2+[tm*rad**2/2]); TiN = np.diag([tN["mass"]*(rad**2/4+.02**2/1.2)]*2+[tN["mass"]*rad**2/2])
    Rf = rpy(*A.ft[1]); pf = A.ft[0].astype(float)
    tofs = np.array(c.get("tipoff", [0, 0, 0.]), float)
    ptip = pf+Rf@(np.array([0, 0, A.tip_z])+tofs)
    # surface, rig's view
    nrm = -Rs[:, 2]; nrm = rotvec(c.get("tilt", np.zeros(3)))@nrm
    ta = np.array([1, .2, .1]) if abs(nrm[0]) < .8 else np.array([0, 1., 0]); ta = ta-nrm*(ta@nrm); ta /= np.linalg.norm(ta); tb = np.cross(nrm, ta)
    pt_rig = tip-nrm*.008; pt = pt_rig+nrm*(c.get("z0", 0.)+rng.normal(0, 1.5e-5))
    if not c.get("contact", True): pt = pt-nrm*5.
    m = A.mass.copy(); com = A.com.copy(); I = A.I.copy()
    mN, cN, IN_ = m.copy(), com.copy(), I.copy()
    if "linkcom" in c:
        j, d, s = c["linkcom"]; com[j] = com[j]+np.array(d); m[j] *= s
    m[-1], com[-1], I[-1] = merge(m[-1], com[-1], I[-1], tm, pf+Rf@tc, Rf@Ti@Rf.T) if tm > 0 else (m[-1], com[-1], I[-1])
    mN[-1], cN[-1], IN_[-1] = merge(mN[-1], cN[-1], IN_[-1], tN["mass"], pf+Rf@np.array(tN["com"]), Rf@TiN@Rf.T) if tN["mass"] > 0 else (mN[-1], cN[-1], IN_[-1])
    mat = dict(n=1.5, k=1.2e4, dref=4e-3, off=.2); mat.update(c.get("mat", {}))
    G, W, mm = bed(mat["n"], mat["k"], mat["off"], mat["dref"])
    P = params(m=mm, **c.get("law", {}))
    if not c.get("contact", True): P[IX["mu"]] = 0
    J = c.get("joint"); J = jointpars(n, **(J if J is not None else dict(Fc=.12*A.rot_in, Fv=.25*A.rot_in)))
    ctlT = 1e-3; dt = c.get("dt", 1e-4); ctl = int(round(ctlT/dt))
    mode = 0 if c["path"] != "joint" else 1
    Kp = c.get("kp", 1.)*np.array([2500, 2800, 1500, 1500, 600, 400, 250.])[:n]; Kd = 2*.7*np.sqrt(Kp*(A.rot_in+.05+np.array([1.2, 1.2, .5, .4, .05, .03, .004])[:n]))
    if mode == 0:
        K = c.get("K", 3500.); Kr = c.get("Kr", 160.)
        pa = c["path"](ctlT, mat, K).done(); X = pa.X
        rel = X[:, :3]; Pd = pt_rig+np.outer(rel[:, 0], ta)+np.outer(rel[:, 1], tb)+np.outer(rel[:, 2], nrm)
        Vd = np.gradient(Pd, ctlT, axis=0)
        Rl = Rs@Rf.T
        if X.shape[1] > 3: Rd = np.array([rotvec(ta*a+tb*b)@Rl for a, b in X[:, 3:5]])
        else: Rd = np.repeat(Rl[None], len(X), 0)
        # start where the path starts
        Qd = dQd = np.zeros((1, n)); N = len(X); Fd = pa.F
        # path begins at h=8mm at the seed tip
        phase = pa.phase
    else:
        K = Kr = 1.; Qd = c["qpath"](q0, ctlT, rng, A); dQd = np.gradient(Qd, ctlT, axis=0); N = len(Qd)
        q0 = Qd[0].copy(); Pd = Vd = np.zeros((1, 3)); Rd = np.zeros((1, 3, 3)); Fd = np.zeros(1)
        phase = lambda t: np.full(len(t), "free")
    dec = c.get("dec", max(1, int(round(5e-4/dt)))); nst = N*ctl
    cab = np.zeros(5)
    if "cable" in c: cab[0] = c["cable"][0]; cab[1:4] = tip+np.array(c["cable"][1]); cab[4] = c["cable"][2]
    rotSeen = c.get("rotSeen", 0.)*A.rot_in; rotIn = A.rot_in.copy()
    R0 = np.array([rpy(*v) for v in A.rpy])
    o = arm_loop(n, R0, A.xyz.astype(float), A.axis, m, com, I, mN, cN, IN_, rotIn, rotSeen, gtrue, q0, Rf, pf, ptip, ptip-Rf@tofs, tm, tc, Ti, pt, nrm, ta, tb,
                 P, G, W, J, mode, K, Kr, 2*.8*np.sqrt(K*6.), 2*.7*np.sqrt(Kr*.08)+1., 4. if n == 7 else 0., .6, Pd, Vd, Rd, Fd, c.get("Da", 900.), Qd, dQd, Kp, Kd, c.get("lagm", .0015), cab, dt, ctl, dec, nst, 0.)
    q, dq, qdd, tau, w, con = o
    t = np.arange(len(q))*dt*dec
    skip = t > c.get("skip", .0)
    jt = c.get("tauread", {})
    tau = tau*(1+np.array(jt.get("gain", np.zeros(n))))+np.array(jt.get("offset", np.zeros(n)))
    s = dict(t=t, q=q, dq=dq, tau=tau, w=w, con=con, phase=phase, A=A, surf=(pt_rig, nrm, ta), tool=tN, g=g, toolI=TiN)
    return s

def smooth(x, dt, fc, order=2):
    if fc is None or fc*2*dt >= .95: return x
    b, a = butter(order, fc*2*dt); zi = lfilter_zi(b, a)
    return lfilter(b, a, x, axis=0, zi=np.outer(zi, x[0]) if x.ndim > 1 else zi*x[0])[0]

def lowpass1(x, dt, tau):
    a = 1-np.exp(-dt/tau); b, aa = [a], [1, -(1-a)]
    return lfilter(b, aa, x, axis=0, zi=(1-a)*x[:1] if x.ndim > 1 else np.array([(1-a)*x[0]]))[0]

def interp(tq, t, x):
    if x.ndim == 1: return np.interp(tq, t, x)
    return np.stack([np.interp(tq, t, x[:, i]) for i in range(x.shape[1])], 1)

def times(T, fs, rng, c, t0=.02):
    n = int((T-.06)*fs); t = t0+np.arange(n)/fs
    j = c.get("jitter", 0.)
    if j: t = t+np.clip(rng.normal(0, j/fs, n), -.35/fs, .35/fs)
    if c.get("drop", 0.): t = t[rng.random(n) >= c["drop"]]
    return t

def read_wrench(s, tk, rng, c):
    """sensor chain; returns noisy and noise-free reading"""
    e = c.get("sens", {}); dt = s["t"][1]-s["t"][0]; w = s["w"].copy()
    G = np.ones(6)
    for k, v in e.get("gain", {}).items(): G[WCH.index(k)] += v
    w = w*G
    if "rot" in e: R = rotvec(e["rot"]); w = np.hstack([w[:, :3]@R.T, w[:, 3:]@R.T])
    if "cross" in e:
        C = np.zeros((6, 6))
        for (a, b), v in e["cross"].items(): C[WCH.index(a), WCH.index(b)] = v
        w = w+w@C.T
    rg = np.array(c.get("range", [40, 40, 120, 2, 2, 2.])); nl = c.get("nonlin", 0.)
    w = w+nl*rg*(w/rg)**2*np.array([1, -1, .8, .6, -.7, .5])
    if "tau" in e: w = lowpass1(w, dt, e["tau"])
    w = smooth(w, dt, c.get("wfilt"))
    off = e.get("toff", 0.)+c.get("clock", 0.)
    r = interp(tk-off, s["t"], w)
    b = np.zeros(6)+c.get("wbias", 0.)*np.array([1, -.6, .8, .02, .015, -.02])+np.array(e.get("bias", np.zeros(6)))
    b = b+0.
    r = r+b+np.outer(tk/60., np.array(e.get("drift", np.zeros(6)))+c.get("wdrift", 0.)*np.array([1, .7, -1, .02, -.02, .01]))
    if "hum" in e:
        h = e["hum"]
        for k, a in h["amp"].items(): r[:, WCH.index(k)] += a*(np.sin(2*np.pi*h["f"]*tk+.4)+.25*np.sin(4*np.pi*h["f"]*tk+1.1))
    sg = np.array(c["wnoise"]); nz = r+rng.normal(0, 1, r.shape)*sg
    if "sat" in e:
        for k, v in e["sat"].items():
            i = WCH.index(k); nz[:, i] = np.clip(nz[:, i], -v, v); r[:, i] = np.clip(r[:, i], -v, v)
    st = c.get("wstep")
    st = np.zeros(6) if st is None else np.array(st, float)
    for k, v in e.get("quant", {}).items(): st[WCH.index(k)] = v
    m = st > 0; nz[:, m] = np.round(nz[:, m]/st[m])*st[m]
    return nz, r

def enc(x, res, rng):
    return np.round(x/res)*res if res else x

def log_arm(s, rng, c):
    A = s["A"]; n = A.n; tk = times(s["t"][-1], c["fs"], rng, c); tk = tk[tk > c.get("skip", 0.)]
    dt = s["t"][1]-s["t"][0]; d = {"t": tk}
    q = interp(tk, s["t"], s["q"]); er = c.get("enc", 5e-6)
    phq = rng.uniform(0, 1, n)
    for i in range(n): d["q%d" % (i+1)] = np.round(q[:, i]/er+phq[i])*er-phq[i]*er
    dq = smooth(s["dq"], dt, c.get("dqfilt")); dq = interp(tk-c.get("dqlag", 0.), s["t"], dq)
    if c.get("hasdq", True):
        for i in range(n): d["dq%d" % (i+1)] = dq[:, i]+rng.normal(0, c.get("dqnoise", 1e-4), len(tk))+rng.uniform(-1, 1)*c.get("dqbias", 0.)
    te = {}; ns = {}
    if c.get("hastau", False):
        tl = smooth(s["tau"], dt, c.get("taufilt", 30.), 1)
        fr = c.get("taurate", c["fs"]); ts = np.arange(s["t"][0], s["t"][-1], 1/fr)
        r0 = interp(ts, s["t"], tl); r1 = r0+rng.normal(0, 1, r0.shape)*A.taunoise*c.get("taunz", 1.)
        a, b = interp(tk, ts, r1), interp(tk, ts, r0)
        for i in range(n):
            d["tau%d" % (i+1)] = a[:, i]; te["tau%d" % (i+1)] = float(np.sqrt(np.mean((a[:, i]-b[:, i])**2))); ns["tau%d" % (i+1)] = float(A.taunoise[i]*c.get("taunz", 1.))
    if c.get("haswrench", True):
        a, b = read_wrench(s, tk, rng, c)
        for i, k in enumerate(WCH):
            d[k] = a[:, i]; te[k] = float(np.sqrt(np.mean((a[:, i]-b[:, i])**2))); ns[k] = float(c["wnoise"][i])
    d["phase"] = s["phase"](tk)
    return d, te, ns

def toml(v):
    if isinstance(v, str): return '"%s"' % v
    if isinstance(v, (list, tuple, np.ndarray)): return "["+", ".join(toml(x) for x in v)+"]"
    return repr(float(v))

def rig_arm(s, c, path):
    A = s["A"]; write_urdf(A, os.path.join(path, A.name+".urdf"))
    L = ["# larch rig", "[robot]", 'model = "%s.urdf"' % A.name, 'sensor_frame = "%s"' % A.ftname, 'tip_frame = "%s"' % A.tipname,
         "gravity = "+toml(np.round(s["g"], 6)), "joints = "+toml(A.jn), ""]
    if s["tool"]["mass"] > 0:
        L += ["[tool]", "mass = "+toml(s["tool"]["mass"]), "com = "+toml(s["tool"]["com"])]
        if c.get("stateI", True): I = s["toolI"]; L += ["inertia = "+toml([I[0, 0], I[1, 1], I[2, 2], 0, 0, 0])]
        L += [""]
    if c.get("contact", True):
        p, nn, ta = s["surf"]
        L += ["[surface]", "point = "+toml(p), "normal = "+toml(nn), "tangent = "+toml(ta), ""]
    if c.get("haswrench", True): L += ["[sensor]", "range = "+toml(c.get("range", [40, 40, 120, 2, 2, 2.])), "noise = "+toml(c["wnoise"]), ""]
    open(os.path.join(path, "rig.toml"), "w").write("\n".join(L))

def sim_tester(c, rng):
    mat = dict(n=1.5, k=1.2e4, dref=4e-3, off=.2); mat.update(c.get("mat", {}))
    G, W, mm = bed(mat["n"], mat["k"], mat["off"], mat["dref"]); lw = dict(comp=1.5e-6); lw.update(c.get("law", {}))
    P = params(m=mm, **lw); dt = 2e-4
    pa = c["path"](dt, mat, 1e9).done(); X = pa.X
    hd = -X[:, 2]; sd = np.ascontiguousarray(X[:, :2])
    dec = c.get("dec", 5)
    o = tester_loop(P, G, W, hd, sd, c.get("mass", 3.), c.get("wn", 180.), c.get("wns", 150.), 0., c.get("z0", 0.), dt, dec)
    return dict(t=np.arange(len(o))*dt*dec, o=o, phase=pa.phase)

def log_tester(s, rng, c):
    tk = times(s["t"][-1], c["fs"], rng, c); o = interp(tk, s["t"], s["o"]); dt = s["t"][1]-s["t"][0]; er = c.get("enc", 2e-6)
    d = {"t": tk, "depth": np.round(o[:, 0]/er)*er}; te, ns = {}, {}
    if c.get("hasdq", True):
        v = smooth(s["o"][:, 1], dt, c.get("dqfilt")); d["depth_rate"] = interp(tk, s["t"], v)+rng.normal(0, c.get("dqnoise", 1e-4), len(tk))+c.get("dqbias", 0.)
    sl = c.get("slides", False)
    if sl: d["slip1"] = np.round(o[:, 2]/er)*er; d["slip2"] = np.round(o[:, 3]/er)*er
    e = c.get("sens", {}); F = s["o"][:, 6:9].copy(); rg = c.get("frange", 50.)
    F = F+c.get("nonlin", 0.)*F*np.abs(F)/rg
    if "tau" in e: F = lowpass1(F, dt, e["tau"])
    F = smooth(F, dt, c.get("wfilt"))
    r = interp(tk-e.get("toff", 0.)-c.get("clock", 0.), s["t"], F)
    r = r+c.get("wbias", 0.)+np.outer(tk/60., e.get("drift", np.zeros(3)))+np.array(e.get("bias", [0, 0, 0.]))
    if "hum" in e: r[:, 0] += e["hum"]["a"]*(np.sin(2*np.pi*e["hum"]["f"]*tk)+.3*np.sin(4*np.pi*e["hum"]["f"]*tk+1))
    sg = c.get("fnoise", .01); nz = r+rng.normal(0, sg, r.shape)
    if "sat" in e: nz = np.minimum(nz, e["sat"]); r = np.minimum(r, e["sat"])
    if "quant" in e: nz = np.round(nz/e["quant"])*e["quant"]
    for i, k in enumerate(["normal_force", "tangential_force1", "tangential_force2"]):
        if i and not sl: continue
        d[k] = nz[:, i]; te[k] = float(np.sqrt(np.mean((nz[:, i]-r[:, i])**2))); ns[k] = sg
    d["phase"] = s["phase"](tk)
    return d, te, ns

def sim_drive(c, rng):
    dt = c.get("dt", 2e-4); qd = c["qpath"](dt, rng); J = jointpars(1, **c["joint"])
    dec = c.get("dec", 5)
    o = drive_loop(J, qd, c.get("Jm", .35), c.get("Jl", .5), c.get("ke", 0.), c.get("ce", 0.), c.get("gap", 0.), c.get("kp", 2500.), c.get("kd", 70.), c.get("ki", 4000.), np.array(c.get("warm", [0, 1., 1.]), float), dt, dec)
    return dict(t=np.arange(len(o))*dt*dec, o=o)

def log_drive(s, rng, c):
    tk = times(s["t"][-1], c["fs"], rng, c); dt = s["t"][1]-s["t"][0]; er = c.get("enc", 1e-5)
    d = {"t": tk, "q1": np.round(interp(tk, s["t"], s["o"][:, 0])/er)*er}
    if c.get("hasdq", True):
        v = smooth(s["o"][:, 1], dt, c.get("dqfilt")); d["dq1"] = interp(tk-c.get("dqlag", 0.), s["t"], v)+rng.normal(0, c.get("dqnoise", 1e-4), len(tk))+c.get("dqbias", 0.)
    tl = smooth(s["o"][:, 3], dt, c.get("taufilt", 40.), 1); fr = c.get("taurate", c["fs"]); ts = np.arange(0, s["t"][-1], 1/fr)
    r0 = np.interp(ts, s["t"], tl); sg = c.get("taunoise", .02); r1 = r0+rng.normal(0, sg, len(r0))
    off = c.get("tauoff", 0.)
    a, b = np.interp(tk, ts, r1), np.interp(tk, ts, r0)
    d["tau1"] = a+off
    return d, {"tau1": float(np.sqrt(np.mean((a-b)**2)))}, {"tau1": sg}
