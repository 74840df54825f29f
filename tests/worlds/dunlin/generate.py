"""World `dunlin`: 48 robot-contact, tester, drive and joint-torque logs with one, two, no, foreign or unexcited hidden effects."""
import os
for _v in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS"): os.environ[_v] = "1"
import sys, json, argparse, shutil, time
import numpy as np
from scipy.signal import lfilter, butter
from scipy.spatial.transform import Rotation as Rot
from scipy.interpolate import CubicSpline
import core, fit
from core import IX, newP
import pyarrow as pa, pyarrow.parquet as pq, pyarrow.csv as pacsv

def lu(r, a, b, u0=0.): return float(a*(b/a)**r.uniform(u0, 1))
def sgn(r): return float(r.choice([-1., 1.]))

# ------------------------------------------------------------------ nuisances
def nuis(r, att):
    soft = [1, 1, 1, .6, .6, .3, .3, .12, .05, .03][min(att, 9)]
    ks = lambda: soft if att >= 8 or r.uniform() < .75 else 1.
    sq, sl, sf = ks(), ks(), ks()
    return dict(soft=ks(), quant=float(np.exp(r.uniform(np.log(2e-6), np.log(max(2.2e-6, 1e-3*sq**2))))), dqn=r.uniform(0, 5e-4), dqb=r.uniform(-2e-4, 2e-4), dqlag=r.uniform(0, .01), dqdelay=r.uniform(0, .004),
                nodq=r.uniform() < .35, noise=lu(r, .1, 3.)*(1 if att < 7 else .3), jit=r.uniform(0, .2), drop=r.uniform(0, .04), nonlin=r.uniform(-.01, .01), temp=r.uniform(0, 1.), tilt=np.radians(.3)*r.uniform(-1, 1, 2)*min(1, ks()*2),
                tool=r.uniform(-.02, .02), clock=r.uniform(-.003, .003)*ks(), eps=r.uniform(-.03, .03), fr2=r.uniform(0, .03), ft=float(r.integers(0, 5) if sf > .3 else r.integers(0, 2) if sf > .1 else 0),
                lpf=lu(r, 5, 50) if sl > .5 else lu(r, 20, 50) if sl > .2 else lu(r, 35, 50), hold=r.uniform(1.3, 6), hmin=40. if sl > .5 else 100. if sl > .2 else 200., Lb=lu(r, 6e-5, 1.5e-4))

def times(r, fs, T, nz):
    t = np.arange(int(T*fs))/fs
    t = t+np.clip(r.normal(0, nz["jit"]/3, len(t)), -.3, .3)/fs; t[0] = 0
    keep = r.uniform(size=len(t)) > nz["drop"]; keep[:2] = True
    return t[keep]

def write_log(out, cols, csv):
    tb = pa.table(cols)
    if csv: pacsv.write_csv(tb, os.path.join(out, "log.csv"))
    else: pq.write_table(tb, os.path.join(out, "log.parquet"))

def vec(v): return "["+", ".join("%.8g" % x for x in v)+"]"

# ------------------------------------------------------------------ motion programs
class Prog:
    def __init__(s, home): s.x = [np.array(home, float)]; s.T = []; s.ph = []
    def to(s, T, ph, **kw):
        y = s.x[-1].copy()
        for k, v in kw.items(): y["s1 s2 d rx ry rz".split().index(k)] = v
        s.x.append(y); s.T.append(T); s.ph.append(ph); return s
    def wait(s, T, ph): return s.to(T, ph)
    def sample(s, fr, shape="mj"):
        X = []; ph = []
        carry = 0.
        for a, b, T, p in zip(s.x[:-1], s.x[1:], s.T, s.ph):
            n = max(2, int(T*fr)); u = np.arange(n)/n; w = u**3*(10-15*u+6*u*u)
            if p == "slide" and T > .1:      # constant speed with smooth ramps
                a_ = min(.3, max(.04, .06/T)); vv = np.clip(np.minimum(u, 1-u)/a_, 0, 1); vv = vv*vv*(3-2*vv); w = np.cumsum(vv); w = (w-.5*vv)/w[-1]
            X.append(a+np.outer(w, b-a)); ph += [p]*n
        X = np.vstack(X); return X, np.array(ph)

def program(r, kind, T, cmd, home_h=.015, tiltp=0., free=True, fast=False, hold=None, speeds=None, depths=None, span=.03, dirs=(1, 1), dwell=.03):
    """cmd: depth -> commanded depth of the impedance controller"""
    p = Prog([0, 0, -home_h, 0, 0, 0]); tt = lambda: sum(p.T)
    first = True; i = 0
    if free:
        p.to(.6, "free", d=-.05)
        for a in (.35, -.3, 0): p.to(r.uniform(.5, .9), "free", rx=a*r.uniform(.7, 1.2), ry=-a*r.uniform(.6, 1.2), rz=a*r.uniform(0, 1.5))
        p.to(.7, "approach", d=-home_h*.4, rx=0, ry=0, rz=0)
    while tt() < T-1.5 or i < 2:
        if kind in ("poke", "both"):
            D = depths[i % len(depths)]; rx, ry = (r.uniform(-tiltp, tiltp, 2) if tiltp else (0, 0))
            p.to(.5, "approach", rx=rx, ry=ry, s1=r.uniform(-span, span)/2 if kind == "poke" else -span/2*dirs[0], s2=r.uniform(-span, span)/2*dirs[1])
            if i == 0: p.wait(.3, "free")
            td = lu(r, .12, 1.2) if not fast else lu(r, .07, .4)
            p.to(td, "poke", d=cmd(D))
            h = r.uniform(.2, 1.2) if hold is None else r.uniform(*hold)
            p.wait(h, "hold")
            if r.uniform() < .6:
                f = lu(r, .06, .4)
                for k in range(r.integers(2, 5)):
                    p.to(f, "poke", d=cmd(D)*r.uniform(.4, .7)); p.to(f, "poke", d=cmd(D))
            p.to(lu(r, .12, 1.), "retract", d=-home_h*.4)
            p.wait(r.uniform(.1, .4), "rest")
        if kind in ("slide", "both"):
            D = depths[(i+1) % len(depths)]
            p.to(.5, "approach", s1=-span/2*dirs[0], s2=0, rx=0, ry=0)
            p.to(.5, "poke", d=cmd(D))
            for k in range(4):
                sp = speeds[(i*4+k) % len(speeds)]; sg = -1 if k % 2 else 1
                if dirs[1] and (dirs[0] == 0 or k >= 2):
                    p.to(span/sp, "slide", s2=(span/2 if k % 2 == 0 else -span/2))
                else: p.to(span/sp, "slide", s1=sg*span/2)
                if dwell: p.wait(dwell, "slide")
                if r.uniform() < .35: D = depths[int(r.integers(len(depths)))]; p.to(.3, "slide", d=cmd(D))
            p.to(.4, "retract", d=-home_h*.4); p.wait(.2, "rest")
        i += 1
        if i > 400: break
    p.to(.5, "free", d=-home_h)
    return p

# ------------------------------------------------------------------ robot with wrist sensor
def draw(r, name, att, P, Q, V, cx):
    """sets a hidden effect at a realistic size; V gets the true values (catalogue symbols)."""
    u0 = min(.15*att, .85); L = lambda a, b: lu(r, a, b, u0)
    k, F, D, T = cx["k"], cx["F"], cx["D"], cx["T"]
    def p(key, val, sym): P[IX[key]] = val; V[name+"."+sym] = val; cx["start"][key] = val
    def q(key, val, sym=None):
        Q[key] = val; cx["start"][key] = val
        if sym: V[name+"."+sym] = val
    if name == "relaxation": p("rr", L(.15, .8), "ratio"); p("rtau", L(.12, 1.5), "tau")
    elif name == "hertz-exponent":
        n = 1+L(.25, .8); kk = F/D**n; P[IX["k"]] = kk; cx["start"]["k"] = kk; p("n", n, "n")
    elif name == "viscous-damping": p("c", k*L(.02, .12), "c")
    elif name == "hunt-crossley-damping": p("lam", L(1.5, 8.), "lambda")
    elif name == "hysteresis": p("hA", F*L(.07, .22), "amplitude"); p("hL", L(2e-4, 8e-4), "length")
    elif name == "stress-softening": p("mr", L(.15, .45), "ratio"); p("mL", L(3e-4, 1.5e-3), "length")
    elif name == "adhesion": p("Fa", F*L(.06, .25), "F_a"); p("aL", L(5e-4, 3e-3), "length")
    elif name == "stiffening-layer": p("K2", k*L(1., 4.), "K"); p("db", D*r.uniform(.4, .65), "delta_b")
    elif name == "surface-offset": p("z0", sgn(r)*L(3e-4, 1.5e-3), "z_0")
    elif name == "stiffness-drift": p("alpha", sgn(r)*L(.15, .45)/(T/60), "alpha_per_min")
    elif name == "stiffness-inhomogeneity":
        kd = float(r.integers(1, 3)); P[IX["ikind"]] = kd; cx["start"]["ikind"] = kd; p("iamp", L(.3, .9), "amplitude"); p("is0", r.uniform(-.006, .006), "s1"); p("iw", r.uniform(.004, .009), "width")
    elif name == "stribeck-friction": p("dmu", L(.12, .45), "delta_mu"); p("vs", r.uniform(.006, .018), "v_s")
    elif name == "presliding": P[IX["ftype"]] = 0.; p("Lb", L(6e-4, 2.5e-3), "length")
    elif name == "friction-rounding": P[IX["ftype"]] = 3.; p("vr", L(2e-3, 1e-2), "v_r")
    elif name == "viscous-friction": p("cv", L(8, 50), "c")
    elif name == "load-dependent-friction": p("p", -L(.15, .4), "p"); V[name+".N_0"] = float(P[IX["N0"]])
    elif name == "friction-anisotropy": p("an", sgn(r)*L(.1, .35), "a")
    elif name == "structural-compliance": p("C", L(5e-5, 2.5e-4), "C")
    elif name == "tool-mass": q("dm", L(.06, .4), "delta_m")
    elif name == "tool-com":
        c = r.normal(size=3)*[1, 1, .6]; c *= L(.008, .05)/np.linalg.norm(c)
        for i, s in enumerate("xyz"): q("c"+s, float(c[i]), "delta_com_"+s)
    elif name == "tool-inertia":
        I = np.array([1, r.uniform(.7, 1), r.uniform(.1, .4)])*L(1.5e-3, 1.2e-2)
        for i, s in enumerate("xyz"): q("I"+s, float(I[i]), "I"+s*2)
    elif name == "tip-offset":
        o = r.normal(size=3)*[1, 1, .2]; o *= L(.0025, .01)/np.linalg.norm(o)
        for i, s in enumerate("xyz"): q("o"+s, float(o[i]), s)
    elif name == "sensor-bias":
        b = np.r_[r.normal(size=3)*L(.4, 2.), r.normal(size=3)*L(.01, .05)]
        for i in range(6): q("b%d" % i, float(b[i]), "fx fy fz tx ty tz".split()[i])
    elif name == "sensor-drift":
        b = np.r_[r.normal(size=3), r.normal(size=3)*.03]*L(.8, 4.)/(T/60)
        for i in range(6): q("r%d" % i, float(b[i]), "fx fy fz tx ty tz".split()[i]+"_per_min")
    elif name == "sensor-crosstalk": q("xt", sgn(r)*L(.05, .15), "c_f%s_f%s" % tuple("xyz"[a_] for a_ in cx["xtij"]))
    elif name == "sensor-misalignment":
        m = r.normal(size=3); m *= L(.05, .2)/np.linalg.norm(m)
        for i in range(3): q("m%d" % i, float(m[i]), "xyz"[i])
    elif name == "sensor-gain": q("g", sgn(r)*L(.05, .15), "g")
    elif name == "sensor-lag": q("lag", L(.01, .06), "tau")
    elif name == "time-offset": q("dt", sgn(r)*L(.006, .03), "offset")
    elif name == "mains-hum":
        f0 = float(r.choice([50., 60.])); cx["hum"] = f0; start = cx["start"]; start["hum"] = f0; V["mains-hum.frequency"] = f0
        for i in range(3): a, p_ = L(.3, 1.2)*cx["F"]*.1, r.uniform(0, 6.28); q("hs%d" % i, a*np.cos(p_)); q("hc%d" % i, a*np.sin(p_)); V["mains-hum.amplitude_f"+"xyz"[i]] = a
    elif name == "saturation": cx["satfrac"] = r.uniform(.5, .8)
    else: raise ValueError(name)

def robot_contact(sp, r, att, out, twin=False):
    nz = nuis(r, att); arm = getattr(core, sp["arm"])(r); model, hid = sp["model"], sp["truth"]; kind = sp["prog"]; nj = len(arm["ax"])
    surf = kind != "free"
    ps, yaw = .035, float(r.uniform(-1, 1)); tip = np.array([0, 0, r.uniform(.08, .14)]) if not sp.get("bent") else np.array([.02, -.01, .11]); tip = np.round(tip, 5)
    yaw = round(yaw, 6); Rs = Rot.from_rotvec([0, 0, yaw]).as_matrix()
    # chain: fold the sensor's place into the tip (tip vector from the last joint, expressed in the sensor axes)
    tipc = tip+np.array([0, 0, ps])
    p0, R0, _ = core.fkjac(arm["off"], arm["ax"], tipc, Rs, arm["q0"])
    n = -R0[:, 2]; t1 = R0[:, 0]-n*(n@R0[:, 0]); n = np.round(n, 7); n /= np.linalg.norm(n); t1 = t1-n*(n@t1); t1 /= np.linalg.norm(t1); t2 = np.cross(n, t1); B = np.column_stack([t1, t2, n]); p0 = np.round(p0, 5)
    g = np.array([0, 0, -9.81])
    if r.uniform() < .3: g = Rot.from_rotvec(np.r_[r.uniform(-.5, .5, 2), 0]).apply(g); g = np.round(g, 5)
    gt = Rot.from_rotvec(np.r_[nz["tilt"], 0]).apply(g)
    T = sp.get("T") or lu(r, *sp.get("Tr", (10, 60))); T = max(T, sp.get("Tmin", 0))
    fs = lu(r, max(50, sp.get("fmin", 50)), min(2000, 15000/T) if 15000/T > 60 else 60); fr = 2000 if fs > 700 else 1000
    # material
    base = model[0]; D = r.uniform(.003, .006); F = lu(r, 6, 28)
    nb = 1.5 if base in ("hertz", "hunt-crossley") else 1.
    P = newP(k=F/D**nb, n=nb); k = F/D*nb
    start = {"k": P[0], "n": nb, "nbase": nb, "rtau": .3}
    cx = dict(k=k, F=F, D=D, T=T, start=start, xtij=[(0, 2), (1, 2), (2, 0)][int(r.integers(3))]); Q, V = {}, {}
    def vis(nm, key, val): P[IX[key]] = val; start[key] = val
    if base == "kelvin-voigt": vis("", "c", k*lu(r, .004, .02))
    if base == "hunt-crossley": vis("", "lam", lu(r, .5, 3))
    if base == "zener": vis("", "rr", r.uniform(.2, .6)); vis("", "rtau", lu(r, .2, 2))
    P[IX["ftype"]] = nz["ft"]; P[IX["Lb"]] = nz["Lb"]; P[IX["vr"]] = lu(r, 1e-4, 6e-4); P[IX["eps"]] = nz["eps"]*nz["soft"]; P[IX["dref"]] = D
    fric = surf
    if fric: vis("", "mu", r.uniform(.25, .8) if "coulomb-friction" in model else .05*r.uniform() if "coulomb-friction" not in hid else r.uniform(.2, .6))
    if "coulomb-friction" not in model and "coulomb-friction" not in hid: P[IX["mu"]] = 0.; 
    # tool
    rm = r.uniform(.15, .5)*sp.get("heavy", 1); rc = np.array([r.uniform(-.008, .008), r.uniform(-.008, .008), r.uniform(.3, .6)*tip[2]]); rI = rm*np.array([.0012, .0012, .0003])*r.uniform(.5, 2)
    if "tool-inertia" in hid: rI = np.zeros(3)
    rm = round(rm, 4); rc = np.round(rc, 5); rI = np.round(rI, 8)
    # visible extra effects of the model at mild size, then the hidden ones
    W = {}
    for e in model[1:]:
        if e in ("coulomb-friction",): continue
        draw(r, e, 0, P, Q, W, cx)
    st0 = r.bit_generator.state
    if sp["group"] != "outside":
        for e in hid:
            if e == "coulomb-friction": V["coulomb-friction.mu"] = float(P[IX["mu"]]); continue
            if sp["group"] == "not-excited" and e == "stiffening-layer":
                P[IX["K2"]] = V[e+".K"] = 2*k; P[IX["db"]] = V[e+".delta_b"] = D*r.uniform(1.6, 2.2); start["K2"] = 0.; start["db"] = D*2; continue
            if sp["group"] == "not-excited" and e == "saturation": V[e+".limit"] = 120.; Q["sat"] = 120.; start["sat"] = 120.; continue
            draw(r, e, att, P, Q, V, cx)
            if e == "structural-compliance": P[IX["C"]] = V["structural-compliance.C"] = min(P[IX["C"]], .8/k*1.0) ; start["C"] = P[IX["C"]]
    if "relaxation" in model or base == "zener": P[IX["rr2"]] = nz["fr2"]*nz["soft"]; P[IX["rtau2"]] = P[IX["rtau"]]*r.uniform(3, 8)
    if sp["group"] == "outside" and not twin:
        x = sp["out"]
        if x == "run-in": P[IX["runA"]] = r.uniform(.4, .65); P[IX["runL"]] = r.uniform(.3, .9); V["run-in.drop"] = float(P[IX["runA"]])
        if x == "box":
            fb = r.uniform(4, 8); P[IX["boxM"]] = Mb = r.uniform(1., 2.); P[IX["boxk"]] = kb = Mb*(2*np.pi*fb)**2*1.0; P[IX["boxc"]] = 2*.04*np.sqrt(kb*Mb); V["box.mass"] = Mb; V["box.stiffness"] = kb
        if x == "hose": pass
    # controller and program
    Kn = float(r.choice([800., 1500., 3000., 5000., 3e4])); Kt = float(r.choice([1500., 3000., 5000., 3e4])); m = r.uniform(2, 6); zeta = r.uniform(.5, 1.)
    while kind in ("slide", "both") and P[IX["mu"]]*F/Kt > .002: Kt *= 1.5
    if sp.get("stiff"): Kn = max(Kn, 5000.)
    Fd = lambda d: P[0]*max(d, 0)**P[1]*(1+.5*P[4])+P[IX["K2"]]*max(0, d-P[IX["db"]])+P[IX["hA"]]
    cmd = lambda d: min(d, 1.5*D)+Fd(min(d, 1.5*D))/Kn
    Ds = [D*x for x in (1., .55, .8, .35, .9)] if not sp.get("depths") else [D*x for x in sp["depths"]]
    speeds = sp.get("speeds") or list(np.exp(r.uniform(np.log(.004), np.log(.06), 7)))
    pk = dict(sp.get("pk", {}))
    if kind == "free":
        pg = Prog([0, 0, -.06, 0, 0, 0]); sc = sp.get("amp", .5); tq = sp.get("tq", (.5, 1.2))
        while sum(pg.T) < T: pg.to(r.uniform(*tq), "free", rx=r.uniform(-sc, sc), ry=r.uniform(-sc, sc), rz=r.uniform(-1, 1)*sc, s1=r.uniform(-.05, .05), s2=r.uniform(-.05, .05), d=-.06+r.uniform(-.04, .04))
    else: pg = program(r, kind, T, cmd, depths=Ds, speeds=speeds, **pk)
    X, ph = pg.sample(fr); Tt = len(X)/fr
    if nz["dqlag"] and kind != "free" and sp.get("fastsin"): pass
    rv = X[:, 3:]; Rw = Rot.from_matrix(R0)*Rot.from_rotvec(rv); Rm = Rw.as_matrix()
    off = np.array([Q.get("ox", 0.), Q.get("oy", 0.), Q.get("oz", 0.)]); toff = np.ascontiguousarray((Rm@off)@B) if off.any() else np.zeros((len(X), 3))
    xc = np.column_stack([X[:, 0], X[:, 1], -X[:, 2]])
    Ps = P.copy(); 
    if not surf: Ps[0] = 0.
    xs, vs, As, O = core.sim_contact(Ps, np.ascontiguousarray(xc), toff, float(fr), 10 if fr == 1000 else 5, m, Kn, Kt, zeta)
    tip_w = p0+xs@B.T; v_w = vs@B.T; a_w = As@B.T
    dR = (Rw[:-1].inv()*Rw[1:]).as_rotvec()*fr; wb = np.vstack([dR, dR[-1:]]); wb[1:] = .5*(wb[1:]+wb[:-1]); alb = np.gradient(wb, 1/fr, axis=0); ww = np.einsum("nij,nj->ni", Rm, wb)
    # sensor
    mt = (rm+Q.get("dm", 0.))*(1+nz["tool"]*nz["soft"]); com = rc+[Q.get("c"+s, 0.) for s in "xyz"]; com = com*(1+.01*nz["soft"]*r.uniform(-1, 1, 3)); I = rI+[Q.get("I"+s, 0.) for s in "xyz"]
    rr = com-tip; ab = np.einsum("nji,nj->ni", Rm, a_w)+np.cross(alb, rr)+np.cross(wb, np.cross(wb, rr))
    ft = mt*(np.einsum("nji,j->ni", Rm, gt)-ab)
    fc = np.einsum("nji,nj->ni", Rm, np.column_stack([O[:, 1], O[:, 2], O[:, 0]])@B.T)
    Wt = np.hstack([fc+ft, np.cross(com, ft)+np.cross(tip+off, fc)-(I*alb+np.cross(wb, I*wb))])
    tr = np.arange(len(X))/fr
    if sp.get("out") == "hose" and not twin:      # hose of compressed air, spring from a point of the base to the tool (behind the sensor)
        kh = r.uniform(40, 90); an = p0+B@np.array([r.uniform(-.25, .25), r.uniform(-.25, .25), .3]); at = np.array([.02, 0, .04]); pw = tip_w+np.einsum("nij,j->ni", Rm, at-tip)
        dv = an-pw; ln = np.linalg.norm(dv, axis=1); fh = (kh*np.maximum(ln-.22, 0)/ln)[:, None]*dv; fh = np.einsum("nji,nj->ni", Rm, fh); Wt = Wt+np.hstack([fh, np.cross(at, fh)]); V["hose.stiffness"] = kh; V["hose.rest_length"] = .22
    if "m0" in Q:
        M = Rot.from_rotvec([Q["m0"], Q["m1"], Q["m2"]]).as_matrix(); Wt = np.hstack([Wt[:, :3]@M.T, Wt[:, 3:]@M.T])
    if "xt" in Q: i, j = cx["xtij"]; Wt[:, i] += Q["xt"]*Wt[:, j]
    Wt = Wt*(1+Q.get("g", 0.))
    rngs = np.array([40, 40, 120, 2, 2, 2.]); Wn = Wt+nz["nonlin"]*nz["soft"]*Wt*np.abs(Wt)/np.maximum(np.abs(Wt).max(0), 1e-6)
    n0 = np.array([.015, .014, .029, .0005, .0006, .0003]); sd = n0*nz["noise"]
    Wn = Wn+np.outer(np.sin(2*np.pi*tr/(Tt*1.7)+r.uniform(0, 6)), sd*nz["temp"]*r.normal(size=6))
    if "b0" in Q: Wn = Wn+[Q["b%d" % i] for i in range(6)]
    if "r0" in Q: Wn = Wn+np.outer(tr/60, [Q["r%d" % i] for i in range(6)])
    if "hs0" in Q:
        for i in range(3): Wn[:, i] += Q["hs%d" % i]*np.sin(2*np.pi*cx["hum"]*tr)+Q["hc%d" % i]*np.cos(2*np.pi*cx["hum"]*tr)+.1*Q["hs%d" % i]*np.sin(6*np.pi*cx["hum"]*tr)
    if Q.get("lag"): e = np.exp(-1/(fr*Q["lag"])); Wn = lfilter([1-e], [1, -e], Wn-Wn[0], axis=0)+Wn[0]
    rate = np.sqrt(np.mean(np.sum(np.gradient(Wn[:, :3], 1/fr, axis=0)**2, 1))); rd = np.sqrt(np.mean(np.sum(Wn[:, :3]**2, 1)))
    clk = float(np.clip(nz["clock"], -.008*rd/rate, .008*rd/rate)) if "time-offset" not in hid else 0.
    t = times(r, fs, Tt-.02, nz); sh = clk+Q.get("dt", 0.)
    W = np.column_stack([np.interp(t-sh, tr, Wn[:, i]) for i in range(6)])
    if "saturation" in hid and sp["group"] != "not-excited":
        lim = float(np.abs(W[:, 2]).max()*cx["satfrac"]); Q["sat"] = lim; V["saturation.limit"] = lim; start["sat"] = lim
    assert (np.abs(W).max(0) < .95*rngs).all(), "beyond the sensor's range"
    Wl = W+r.normal(size=W.shape)*sd
    if "sat" in Q: Wl[:, 2] = np.clip(Wl[:, 2], -Q["sat"], Q["sat"]); W[:, 2] = np.clip(W[:, 2], -Q["sat"], Q["sat"])
    step = np.array([.01, .01, .02, .00025, .00025, .00025])*min(1., max(.2, nz["noise"])); Wl = np.round(Wl/step)*step
    # joints
    ip = lambda A: np.column_stack([np.interp(t, tr, A[:, i]) for i in range(A.shape[1])])
    pd_ = ip(tip_w); Rd = (Rot.from_matrix(R0)*Rot.from_rotvec(ip(rv))).as_matrix()
    q, dq, worst = core.ik_all(arm["off"], arm["ax"], tipc, Rs, np.ascontiguousarray(pd_), np.ascontiguousarray(Rd), ip(v_w), ip(ww), arm["q0"].copy())
    assert worst < 1e-6, worst
    ql = np.round(q/nz["quant"])*nz["quant"]; cols = {"t": t}
    for i in range(nj): cols["q%d" % (i+1)] = ql[:, i]
    if not nz["nodq"]:
        a = np.exp(-1/(fs*max(nz["dqlag"], 1e-4))); dl = lfilter([1-a], [1, -a], dq, axis=0)
        dl = np.column_stack([np.interp(t-nz["dqdelay"], t, dl[:, i]) for i in range(nj)])+nz["dqb"]*r.choice([-1, 1], nj)+r.normal(size=dl.shape)*nz["dqn"]
        for i in range(nj): cols["dq%d" % (i+1)] = dl[:, i]
    for i, c in enumerate(("fx", "fy", "fz", "tx", "ty", "tz")): cols[c] = Wl[:, i]
    if r.uniform() < .6: cols["phase"] = ph[np.clip((t*fr).astype(int), 0, len(ph)-1)].tolist()
    write_log(out, cols, len(t) < 4000 and r.uniform() < .4)
    open(out+"/robot.urdf", "w").write(core.urdf(arm, ps, yaw, tip))
    s = ['[robot]', 'model = "robot.urdf"', 'sensor_frame = "ft_sensor"', 'tip_frame = "tool_tip"', 'gravity = '+vec(g), '', '[tool]', 'mass = %.6g' % rm, 'com = '+vec(rc)]
    if rI.any(): s.append("inertia = "+vec(np.r_[rI, 0, 0, 0]))
    if surf: s += ['', '[surface]', 'point = '+vec(p0), 'normal = '+vec(n), 'tangent = '+vec(t1)]
    s += ['', '[sensor]', 'range = [40, 40, 120, 2, 2, 2]'] + (['noise = '+vec(sd)] if r.uniform() < .6 else [])
    open(out+"/rig.toml", "w").write("\n".join(s)+"\n")
    te = float(np.sqrt(np.mean(np.sum((Wl-W)[:, :3]**2, 1)))) if sp.get("acts", ["f"])[0] != "t" else float(np.sqrt(np.mean(np.sum((Wl-W)[:, 3:]**2, 1))))
    meta = dict(type="w", off=arm["off"].tolist(), ax=arm["ax"].tolist(), tip=tip.tolist(), Rs=Rs.tolist(), point=p0.tolist(), n=n.tolist(), t1=t1.tolist(), t2=t2.tolist(), g=g.tolist(), rigmass=rm, rigcom=rc.tolist(), rigI=rI.tolist(),
                quant=nz["quant"], noise=sd.tolist(), surface=bool(surf), xtij=cx["xtij"], start={a: float(b) for a, b in start.items()}, ps=ps)
    # the sensor's place along the last link belongs to the chain
    meta["off"] = meta["off"]; meta["tipc"] = tipc.tolist()
    return meta, V, te

# ------------------------------------------------------------------ tester without a robot
def tester(sp, r, att, out, twin=False):
    nz = nuis(r, att); model, hid = sp["model"], sp["truth"]; base = model[0]; T = lu(r, *sp.get("Tr", (15, 120))); fs = lu(r, max(50, 1500/T), min(1500, 24000/T)); fr = 2000 if T < 60 else 1000
    D = r.uniform(.002, .006); F = lu(r, 5, 40); nb = 1.5 if base in ("hertz", "hunt-crossley") else 1.
    P = newP(k=F/D**nb, n=nb); k = F/D*nb; start = {"k": P[0], "n": nb, "nbase": nb, "rtau": .3}; cx = dict(k=k, F=F, D=D, T=T, start=start, xtij=(0, 2)); Q, V = {}, {}
    def vis(key, val): P[IX[key]] = val; start[key] = val
    if base == "kelvin-voigt": vis("c", k*lu(r, .004, .03))
    if base == "hunt-crossley": vis("lam", lu(r, .5, 3))
    if base in ("zener",): vis("rr", r.uniform(.2, .7)); vis("rtau", lu(r, .2, 2))
    P[IX["ftype"]] = nz["ft"] if nz["ft"] != 3 else 0.; P[IX["Lb"]] = nz["Lb"]; P[IX["eps"]] = nz["eps"]*nz["soft"]; P[IX["dref"]] = D
    slide = "coulomb-friction" in model
    if slide: vis("mu", r.uniform(.25, .8))
    for e in model[1:]:
        if e != "coulomb-friction": draw(r, e, 0, P, Q, {}, cx)
    if sp["group"] == "not-excited" and hid == ["load-dependent-friction"]:
        P[IX["p"]] = -r.uniform(.15, .3); V["load-dependent-friction.p"] = float(P[IX["p"]]); V["load-dependent-friction.N_0"] = 5.; start["p"] = 0.
    else:
        for e in hid: draw(r, e, att, P, Q, V, cx)
    if "relaxation" in model or "relaxation" in hid or base == "zener": P[IX["rr2"]] = nz["fr2"]*nz["soft"]; P[IX["rtau2"]] = P[IX["rtau"]]*r.uniform(3, 8)
    if sp.get("out") == "plastic" and not twin: P[IX["plB"]] = r.uniform(.2, .4); P[IX["plY"]] = D*.1; V["plastic.ratio"] = float(P[IX["plB"]])
    pg = Prog([0, 0, -.002, 0, 0, 0]); i = 0
    dep = [D*x for x in ((.4, .7, .5, 1., .8, .6, .9) if not sp.get("const") else (.8,))]
    while sum(pg.T) < T-2 or i < 3:
        d = dep[i % len(dep)]
        if slide:
            if i == 0 or not sp.get("const"): pg.to(.6, "poke", d=d)
            for s in (.02, -.02, .02, -.02): pg.to(.04/lu(r, .004, .05), "slide", s1=s)
            if not sp.get("const"): pg.to(.6, "retract", d=-.002)
        else:
            td = lu(r, .15, 4.); pg.to(td, "poke", d=d); pg.wait(r.uniform(.1, 1.5), "hold")
            if r.uniform() < .5:
                f = lu(r, .08, 1.)
                for kx in range(3): pg.to(f, "poke", d=d*.45); pg.to(f, "poke", d=d)
            pg.to(lu(r, .2, 4.), "retract", d=-.003); pg.wait(.2, "rest")
        i += 1
    X, ph = pg.sample(fr); tr = np.arange(len(X))/fr
    # crosshead wobble
    d = X[:, 2]+2e-6*np.sin(2*np.pi*r.uniform(3, 9)*tr); s1 = X[:, 0]; z = np.zeros(len(d)); dd = np.gradient(d, 1/fr); v = np.gradient(s1, 1/fr)
    O = core.drive_law(P, tr, d, dd, s1, z, v, z); N = O[:, 0].copy(); T1 = O[:, 1].copy(); N *= 1+nz["nonlin"]*nz["soft"]*np.abs(N)/max(N.max(), 1e-6)
    rate = np.sqrt(np.mean(np.gradient(N, 1/fr)**2)); clk = float(np.clip(nz["clock"], -.008*np.sqrt(np.mean(N**2))/rate, .008*np.sqrt(np.mean(N**2))/rate))
    t = times(r, fs, tr[-1]-.02, nz); sd = .029*nz["noise"]; Nt = np.interp(t-clk, tr, N); Tt = np.interp(t-clk, tr, T1)
    if "sat" in Q or "saturation" in hid: lim = float(Nt.max()*cx.get("satfrac", .8)); V["saturation.limit"] = lim; start["sat"] = lim; Nt = np.minimum(Nt, lim)
    if "b0" in Q: Nt = Nt+Q["b0"]
    res = lu(r, 1e-7, 1e-5 if att < 3 else 1e-6); Nl = np.round((Nt+r.normal(size=len(t))*sd)/.005)*.005; Tl = np.round((Tt+r.normal(size=len(t))*sd*.5)/.005)*.005
    cols = {"t": t, "depth": np.round(np.interp(t, tr, d)/res)*res, "normal_force": Nl}
    if r.uniform() < .4: cols["depth_rate"] = np.interp(t-.002, tr, dd)+r.normal(size=len(t))*5e-5
    if slide: cols["slip1"] = np.round(np.interp(t, tr, s1)/res)*res; cols["tangential_force1"] = Tl
    if r.uniform() < .3: cols["phase"] = ph[np.clip((t*fr).astype(int), 0, len(ph)-1)].tolist()
    write_log(out, cols, len(t) < 6000 and r.uniform() < .6)
    open(out+"/rig.toml", "w").write("# material tester: columns t, depth, normal_force%s\n" % (", slip1, tangential_force1" if slide else "")+("[sensor]\nnoise = "+vec([sd*.5, sd*.5, sd, .0005, .0005, .0003])+"\n" if r.uniform() < .5 else ""))
    e = [(Nl-Nt)]+([Tl-Tt] if slide else []); te = float(np.sqrt(np.mean(sum(x*x for x in e))))
    if sp["acts"][0] == "s": te = float(np.sqrt(np.mean(e[1]**2)))
    return dict(type="t", noise=[sd], badrate="depth_rate" in cols, start={a: float(b) for a, b in start.items()}), V, te

# ------------------------------------------------------------------ joint torques
def joints(sp, r, att, out, twin=False):
    import pinocchio as pin
    nz = nuis(r, att); drive = sp["arm"] == "drive"; model, hid = sp["model"], sp["truth"]; T = lu(r, *sp.get("Tr", (15, 120))); u0 = min(.15*att, .85); L = lambda a, b: lu(r, a, b, u0)
    fs = lu(r, max(50, 2000/T), min(1000, 20000/T)); fr = 1000 if T < 40 else 500
    start = {}; V = {}
    if drive: nj = 1; J = lu(r, .005, .3); q0 = np.zeros(1); Fc = np.array([J*lu(r, 1.5, 6)]); Fv = np.array([J*lu(r, .3, 1.5)]); tn = Fc*.02; rot = np.zeros(1); amp = np.array([r.uniform(4, 20)])
    else:
        arm = getattr(core, sp["arm"])(r); nj = len(arm["ax"]); q0 = arm["q0"]; Fc = arm["Fc"]*r.uniform(.7, 1.3, nj); Fv = arm["Fv"]*r.uniform(.7, 1.3, nj); tn = arm["tn"]; rot = arm["rotor"]*r.uniform(.7, 1.3, nj); amp = r.uniform(.35, .8, nj)
    tn = tn*lu(r, .5, 2)
    # excitation: Fourier series, each joint several harmonics
    f0 = sp.get("f0", r.uniform(.04, .08) if not drive else r.uniform(.03, .05)); nh = 3 if drive else 5; fmax = f0*nh; tr = np.arange(int(T*fr))/fr; q = np.tile(q0, (len(tr), 1)); slow = sp.get("slow", 1.)
    for j in range(nj):
        a = r.normal(size=nh)/np.arange(1, nh+1)**.7; ph = r.uniform(0, 6.28, nh); a *= amp[j]/np.sum(np.abs(a))*1.6
        for h in range(nh): q[:, j] += a[h]*np.sin(2*np.pi*f0*slow*(h+1)*tr+ph[h])
    if sp.get("turns"):
        j = sp["turns"]-1; q[:, j] = q0[j]+(2.6-abs(q0[j]))*np.sin(2*np.pi*f0*slow*1.3*tr)+.15*np.sin(2*np.pi*f0*4.1*tr)
        if drive: q[:, 0] = 7*np.sin(2*np.pi*f0*1.3*tr)+2*np.sin(2*np.pi*f0*4.1*tr+1)
    dq = np.gradient(q, 1/fr, axis=0); ddq = np.gradient(dq, 1/fr, axis=0)
    g = np.array([0, 0, -9.81]); 
    if r.uniform() < .3: g = np.round(Rot.from_rotvec(np.r_[r.uniform(-.4, .4, 2), 0]).apply(g), 5)
    gt = Rot.from_rotvec(np.r_[nz["tilt"], 0]).apply(g); acts = sp.get("acts_j"); jj = acts if acts else list(range(nj))
    if not drive:
        open(out+"/robot.urdf", "w").write(core.urdf(arm, .035, 0., [0, 0, .1])); mod = pin.buildModelFromUrdf(out+"/robot.urdf")
        if "gravity-error" in hid:
            ax = r.normal(size=2); ax *= np.radians(L(2, 7))/np.linalg.norm(ax); gt = Rot.from_rotvec(np.r_[ax, 0]).apply(gt); V["gravity-error.gx"], V["gravity-error.gy"] = map(float, (gt-g)[:2])
        mod.gravity.linear = gt
        for i in range(1, nj+1): mod.inertias[i] = pin.Inertia(mod.inertias[i].mass*(1+nz["tool"]*.3*nz["soft"]), mod.inertias[i].lever, mod.inertias[i].inertia)
        if "payload" in hid or "payload" in model:
            mp = L(.5, 2.5); cp = np.round([r.uniform(-.03, .03), r.uniform(-.03, .03), r.uniform(.03, .1)], 4); mod.inertias[nj] = mod.inertias[nj]+pin.Inertia(mp, np.array([0, 0, .035])+cp, np.eye(3)*mp*1e-3)
            start["payload"] = dict(com=cp.tolist(), base=[0, 0, .035]); V["payload.mass"] = mp
            for i, s in enumerate("xyz"): V["payload.com_"+s] = float(cp[i])
        dat = mod.createData(); dec = 4 if fr == 1000 else 2
        def rn(Q, D, A):
            s = np.r_[np.arange(0, len(Q), dec), len(Q)-1] if (len(Q)-1) % dec else np.arange(0, len(Q), dec)
            y = np.array([pin.rnea(mod, dat, a, b, c) for a, b, c in zip(Q[s], D[s], A[s])]); return CubicSpline(tr[s], y)(tr)
        qm = q
        rb = rn(q, dq, ddq)
        if "joint-elasticity" in hid:   # logged (motor-side) angle = link angle + tau/K
            K = arm["Kj"]/L(1.5, 6); start["K"] = K.tolist(); qm = q+rb/K
            for j in range(nj): V["joint-elasticity.K_%d" % (j+1)] = float(K[j])
    else: rb = J*ddq; qm = q; start["J"] = J
    has = lambda e: e in model or e in hid
    tau = rb.copy(); dqm = np.gradient(qm, 1/fr, axis=0)
    fc = np.zeros(nj); sg = np.zeros_like(q); Lb = lu(r, 3e-5, 4e-4) if not drive else lu(r, 5e-5, 4e-4); kind = nz["ft"]; z = np.zeros(nj)
    if kind == 3: vr = lu(r, .002, .015)*(1 if not drive else 8); sg = dqm/np.sqrt(dqm**2+vr**2)
    else:
        sg = presl(qm, Lb, int(kind in (1, 4)))
    if kind in (2, 4): sg = sg*(1+.05*nz["soft"]*np.exp(-(dqm/(.01 if not drive else .1))**2))
    fr_c = Fc*sg if has("joint-coulomb-friction") else 0*sg; fr_v = Fv*dqm if has("joint-viscous-friction") else 0*sg
    if "joint-coulomb-friction" in hid: V.update({"joint-coulomb-friction.tau_c_%d" % (j+1): float(Fc[j]) for j in range(nj)})
    if "joint-viscous-friction" in hid: V.update({"joint-viscous-friction.b_%d" % (j+1): float(Fv[j]) for j in range(nj)})
    tau = tau+fr_c+fr_v
    if has("rotor-inertia") and not drive:
        tau = tau+rot*ddq
        if "rotor-inertia" in hid: V.update({"rotor-inertia.J_%d" % (j+1): float(rot[j]) for j in range(nj)})
    if "joint-friction-asymmetry" in hid:
        for j in jj: a = sgn(r)*L(.15, .4); tau[:, j] += a*np.abs(fr_c[:, j]+fr_v[:, j]); V["joint-friction-asymmetry.a_%d" % (j+1)] = a
    if has("joint-torque-offset"):
        for j in (jj if "joint-torque-offset" in hid else range(nj)): a = sgn(r)*L(1., 4.)*float(Fc[j]); tau[:, j] += a; V["joint-torque-offset.offset_%d" % (j+1)] = a
    if "joint-stribeck-friction" in hid:
        vs = (r.uniform(.04, .12) if not drive else r.uniform(.6, 2.)); start["vs"] = vs
        for j in jj: a = L(.35, 1.)*float(Fc[j]); tau[:, j] += a*sg[:, j]*np.exp(-(dqm[:, j]/vs)**2); V["joint-stribeck-friction.dtau_%d" % (j+1)] = a; V["joint-stribeck-friction.v_s"] = vs
    if "joint-load-friction" in hid:
        for j in jj: a = L(.04, .12); tau[:, j] += a*sg[:, j]*np.abs(rb[:, j]); V["joint-load-friction.mu_%d" % (j+1)] = a
    if "joint-torque-ripple" in hid:
        kr = float(r.integers(4, 17)); start["kr"] = kr; V["joint-torque-ripple.k"] = kr
        for j in jj: a = L(.3, .8)*float(Fc[j]); p_ = r.uniform(0, 6.28); tau[:, j] += a*np.sin(kr*qm[:, j]+p_)+.1*a*np.sin(2*kr*qm[:, j]); V["joint-torque-ripple.amplitude_%d" % (j+1)] = a; V["joint-torque-ripple.phase_%d" % (j+1)] = p_
    if "joint-spring" in hid:
        for j in jj: a = L(.6, 3.)*float(Fc[j])/amp[j]; tau[:, j] += a*qm[:, j]; V["joint-spring.k_%d" % (j+1)] = a
    if sp.get("out") == "drag" and not twin: a = L(2.5, 6)*Fc[0]/np.abs(dqm).max()**2*2; tau[:, 0] += a*dqm[:, 0]*np.abs(dqm[:, 0]); V["drag.c"] = float(a)
    clean = tau.copy()
    if sp.get("out") == "cross" and not twin:
        a, b = sp["ij"]; c = r.uniform(.12, .25); tau[:, a] += c*tau[:, b]; V["coupling.c_%d%d" % (a+1, b+1)] = c
    if "joint-torque-gain" in hid:
        for j in jj: a = sgn(r)*L(.05, .15); tau[:, j] *= 1+a; V["joint-torque-gain.g_%d" % (j+1)] = a
    if sp["group"] != "quiet": clean = tau.copy()
    tau = tau+tn*nz["temp"]*np.sin(2*np.pi*tr/T/1.5)[:, None]
    b_, a_ = butter(2, min(nz["lpf"], fr*.4)/(fr/2)); fl = lfilter(b_, a_, tau-tau[0], axis=0)+tau[0]
    t = times(r, fs, T-.05, nz); hr = max(fs/nz["hold"], nz["hmin"]); th = np.floor(t*hr)/hr
    tt = np.column_stack([np.interp(th, tr, fl[:, j]) for j in range(nj)]); res = tn*.3
    tl = np.round((tt+r.normal(size=tt.shape)*tn)/res)*res
    cl = np.column_stack([np.interp(t, tr, clean[:, j]) for j in range(nj)])
    quant = nz["quant"]; ql = np.round(np.column_stack([np.interp(t, tr, qm[:, j]) for j in range(nj)])/quant)*quant; cols = {"t": t}
    for j in range(nj): cols["q%d" % (j+1)] = ql[:, j]
    if not nz["nodq"]:
        dl = np.column_stack([np.interp(t-nz["dqlag"]-nz["dqdelay"], tr, dqm[:, j]) for j in range(nj)])+nz["dqb"]+r.normal(size=tl.shape)*nz["dqn"]
        for j in range(nj): cols["dq%d" % (j+1)] = dl[:, j]
    for j in range(nj): cols["tau%d" % (j+1)] = tl[:, j]
    write_log(out, cols, len(t) < 5000 and r.uniform() < .4)
    if drive: open(out+"/rig.toml", "w").write("# one drive on a bench: t, q1, tau1; no robot\n")
    else: open(out+"/rig.toml", "w").write('[robot]\nmodel = "robot.urdf"\nsensor_frame = "ft_sensor"\ntip_frame = "tool_tip"\ngravity = %s\n' % vec(g))
    sl = jj if sp["group"] in ("one",) and acts else list(range(nj))
    te = float(np.sqrt(np.mean(np.sum((tl-tt)[:, sl]**2, 1)))); nu = float(np.sqrt(np.mean(np.sum((tl-cl)[:, sl]**2, 1))))
    sp["acts"] = [sl if acts else "all"]*2
    if sp["group"] == "two" and acts: sp["acts"] = [acts]*2
    if sp["group"] == "outside" and sp.get("ij"): sp["acts"] = [[sp["ij"][0]]]
    return dict(type="j", nj=nj, robot=not drive, g=g.tolist(), quant=quant, tn=tn.tolist(), fmax=fmax*slow if not sp.get("turns") else fmax, start=start, nuis=nu), V, te

from numba import njit
@njit(cache=True)
def presl(q, L, prandtl):
    n, m = q.shape; o = np.zeros((n, m)); z = np.zeros(m)
    for i in range(1, n):
        for j in range(m):
            d = q[i, j]-q[i-1, j]
            if prandtl: z[j] = min(1., max(-1., z[j]+d/L))
            elif d != 0.:
                s = 1. if d > 0 else -1.
                z[j] = s+(z[j]-s)*np.exp(-abs(d)/L)
            o[i, j] = z[j]
    return o

# ------------------------------------------------------------------ the 48 cases
RF = ["rigid-body", "joint-coulomb-friction", "joint-viscous-friction"]
KC = ["kelvin-voigt", "coulomb-friction"]
def specs(r):
    c = lambda *o: o[int(r.integers(len(o)))]
    S = []
    def A(fn, group, kind, model, truth=(), **k): S.append(dict(fn=fn, group=group, kind=kind, model=list(model), truth=list(truth), acts=k.pop("acts", ["f", "f"]), **k))
    C, Te, Jo = robot_contact, tester, joints
    # --- one
    A(C, "one", "arm-poke", KC, ["relaxation"], arm="lwr", prog="poke", Tr=(12, 150), pk=dict(hold=(.8, 3.)))
    hm = c(0, 1)
    A(C, "one", "arm-slide", KC[:1] if hm else KC, ["coulomb-friction"] if hm else ["stribeck-friction"], arm="lwr", prog="slide", Tr=(15, 60), near=[], pk=dict(span=.04), speeds=[.004, .05, .012, .025, .007, .08, .018])
    A(C, "one", "arm-both", KC, ["stiffness-inhomogeneity"], arm="lwr", prog="both", Tr=(20, 80))
    A(C, "one", "arm-poke", ["hertz", "coulomb-friction"], ["structural-compliance"], arm="lwr", prog="poke", Tr=(10, 40), stiff=1)
    A(C, "one", "arm-poke", KC, ["tip-offset"], arm="lwr", prog="poke", Tr=(12, 50), pk=dict(tiltp=.25), acts=["t"])
    A(C, "one", "arm-slide", KC, [c("presliding", "friction-rounding")], arm="own", prog="slide", Tr=(10, 40), speeds=[.01, .02, .04], pk=dict(span=.008, dwell=.05))
    A(C, "one", "arm-poke", ["hunt-crossley", "coulomb-friction"], ["time-offset"], arm="own", prog="poke", Tr=(5, 25), fmin=120, pk=dict(fast=True))
    A(C, "one", "arm-both", KC, [c("sensor-crosstalk", "sensor-crosstalk")], arm="own", prog="both", Tr=(15, 60), pk=dict(tiltp=.15))
    A(C, "one", "arm-both", KC, ["tool-com"], arm="lwr", prog="both", Tr=(15, 60), acts=["t"])
    A(C, "one", "arm-free", ["none"], ["tool-inertia"], arm="lwr", prog="free", Tr=(10, 40), fmin=120, acts=["t"], heavy=2., amp=.4, tq=(.4, .7))
    A(C, "one", "arm-free", ["none"], ["tool-mass"], arm="own", prog="free", Tr=(15, 60), amp=.5)
    A(C, "one", "arm-poke", ["hertz", "coulomb-friction"], ["saturation"], arm="lwr", prog="poke", Tr=(8, 40))
    if c(0, 1): A(C, "one", "arm-both", KC, ["sensor-drift"], arm="own", prog="both", Tr=(60, 200))
    else: A(C, "one", "arm-both", KC, ["mains-hum"], arm="own", prog="both", Tr=(12, 40), fmin=260)
    A(Te, "one", "tester", KC[:1], ["hysteresis"], acts=["n"])
    if c(0, 1): A(Te, "one", "tester", ["hertz"], ["stress-softening"], acts=["n"], Tr=(20, 120))
    else: A(Te, "one", "tester", ["hooke"], ["hertz-exponent"], acts=["n"], Tr=(20, 120), near=["stiffening-layer"])
    A(Te, "one", "tester", ["hertz"], ["adhesion"], acts=["n"])
    A(Te, "one", "tester", ["kelvin-voigt", "coulomb-friction"], ["load-dependent-friction"], acts=["s"], Tr=(30, 150))
    A(Jo, "one", "arm-torque", RF, ["joint-torque-ripple"], arm="lwr", acts_j=[0], turns=1, Tr=(30, 150))
    A(Jo, "one", "arm-torque", RF+["joint-torque-offset"], [c("gravity-error", "joint-elasticity")], arm="lwr", acts_j=[1, 3], near=[])
    A(Jo, "one", "arm-torque", RF+["rotor-inertia"], ["joint-load-friction"], arm="own", acts_j=[1, 2])
    if c(0, 1): A(Jo, "one", "arm-torque", RF, ["payload"], arm="own", acts_j=[1, 2, 4])
    else: A(Jo, "one", "arm-torque", RF[:2]+["joint-torque-offset"], ["joint-viscous-friction"], arm="own", acts_j=[0, 1, 2])
    A(Jo, "one", "drive", RF, [c("joint-stribeck-friction", "joint-spring", "joint-torque-ripple")], arm="drive", acts_j=[0], Tr=(40, 150))
    # --- two
    A(C, "two", "arm-poke", ["hertz", "coulomb-friction"], ["hunt-crossley-damping", "sensor-bias"], arm="lwr", prog="poke", Tr=(8, 40), pk=dict(fast=True), near=["viscous-damping"])
    A(C, "two", "arm-slide", KC, ["friction-anisotropy", "viscous-friction"], arm="lwr", prog="slide", Tr=(15, 60), pk=dict(span=.05), speeds=[.01, .08, .03, .12, .05])
    A(C, "two", "arm-poke", KC, ["stiffening-layer", "sensor-lag"], arm="own", prog="poke", Tr=(8, 40), fmin=100, pk=dict(fast=True))
    A(Te, "two", "tester", ["hooke"], ["viscous-damping", "stiffness-drift"], acts=["n", "n"], Tr=(60, 200))
    A(Jo, "two", "arm-torque", RF, ["joint-friction-asymmetry", "joint-torque-gain"], arm="own", acts_j=[1], near=["joint-torque-offset"])
    A(Jo, "two", "arm-torque", RF, ["rotor-inertia", "joint-torque-offset"], arm="own", acts_j=[3, 4], f0=.14)
    A(C, "two", "arm-both", KC, ["surface-offset", "sensor-misalignment"], arm="own", prog="both", Tr=(15, 60), stiff=1)
    # --- outside
    A(C, "outside", "arm-slide", KC, arm="lwr", prog="slide", Tr=(25, 80), out="run-in", cls=["stiffness-drift", "stribeck-friction"], note="friction runs in with the distance slid", pk=dict(span=.04))
    A(C, "outside", "arm-poke", KC, arm="lwr", prog="poke", Tr=(10, 40), out="box", cls=["structural-compliance", "relaxation", "viscous-damping"], note="sample box (mass) on springs", pk=dict(fast=True))
    A(C, "outside", "arm-both", KC, arm="own", prog="both", Tr=(15, 60), out="hose", cls=["sensor-bias", "tool-mass", "tool-com"], note="hose pulls at the tool towards a point of the base")
    A(Jo, "outside", "arm-torque", RF, arm="own", out="cross", ij=(4, 1), cls=["gravity-error", "payload", "joint-spring", "joint-torque-offset"], note="torque of joint 2 leaks into the sensor of joint 5")
    A(Te, "outside", "tester", ["hertz"], out="plastic", cls=["stress-softening", "hysteresis", "surface-offset"], note="plastic set: the surface sinks with the deepest poke", acts=["n"])
    A(Jo, "outside", "drive", RF, arm="drive", out="drag", acts_j=[0], cls=["joint-viscous-friction"], note="fan: drag ~ speed squared", f0=.07)
    # --- not excited
    A(C, "not-excited", "arm-poke", KC, ["stiffening-layer"], arm="lwr", prog="poke", Tr=(8, 40), depths=(.9, .5, .7))
    A(C, "not-excited", "arm-poke", ["hertz", "coulomb-friction"], ["saturation"], arm="own", prog="poke", Tr=(8, 40))
    A(Jo, "not-excited", "arm-torque", RF+["joint-torque-offset"], ["rotor-inertia"], arm="lwr", slow=.05, f0=.06, Tr=(60, 200))
    A(Te, "not-excited", "tester", ["hooke", "coulomb-friction"], ["load-dependent-friction"], const=1, acts=["s"], Tr=(20, 60))
    # --- quiet
    A(C, "quiet", "arm-poke", ["hunt-crossley", "coulomb-friction"], arm="lwr", prog="poke", Tr=(8, 60))
    A(C, "quiet", "arm-slide", KC, arm="lwr", prog="slide", Tr=(10, 60))
    A(C, "quiet", "arm-both", ["kelvin-voigt", "coulomb-friction", c("relaxation", "hysteresis")], arm="lwr", prog="both", Tr=(60, 300))
    A(C, "quiet", "arm-both", KC+["sensor-bias"], arm="own", prog="both", Tr=(10, 60))
    A(C, "quiet", "arm-poke", ["zener", "coulomb-friction"], arm="own", prog="poke", Tr=(10, 60))
    A(Te, "quiet", "tester", ["zener"], acts=["n"], Tr=(15, 300))
    A(Te, "quiet", "tester", ["hunt-crossley", "coulomb-friction"], acts=["n"])
    A(Jo, "quiet", "arm-torque", RF+["joint-torque-offset"], arm="lwr", Tr=(20, 200))
    A(Jo, "quiet", c("drive", "arm-torque"), RF, arm="drive", acts_j=[0], Tr=(10, 120))
    S[-1]["kind"] = "drive"
    return S

def one_case(sp, seed, k, name, data, verbose):
    out = os.path.join(data, name); best = None
    if sp["arm"] if "arm" in sp else None: pass
    for att in range(10):
        shutil.rmtree(out, ignore_errors=True); os.makedirs(out)
        s = dict(sp); s["model"] = list(sp["model"]); s["truth"] = list(sp["truth"]); key = [seed, k, att]
        try:
            meta, V, te = s["fn"](s, np.random.default_rng(key), att, out)
            meta.update(group=s["group"], model=s["model"], truth=s["truth"], acts=s["acts"], true_error=te)
            if meta["type"] == "w": meta["tip"] = meta["tip"]
            if s["group"] == "outside":
                tw = os.path.join(data, ".twin"); shutil.rmtree(tw, ignore_errors=True); os.makedirs(tw)
                s2 = dict(s); m2, _, _ = s["fn"](s2, np.random.default_rng(key), att, tw, True); m2.update(group="outside", model=s["model"], truth=[], acts=s["acts"], true_error=te)
                meta["nuis"] = fit.load(tw, m2).left(s["model"], s["acts"][0]); shutil.rmtree(tw)
            o = fit.check_case(out, meta)
        except (AssertionError, np.linalg.LinAlgError, ValueError, FloatingPointError) as e:
            if verbose: print(name, att, "redo:", repr(e)[:160])
            if verbose > 1: raise
            continue
        good = o["ok"] and (o.get("strict", True) or att >= 9)
        if verbose: print(name, att, s["kind"], s["group"], s["truth"] or s.get("out"), "reading %.3g" % o["reading"], "base", np.round(o["base"], 4), "full", np.round(o.get("full", []), 4), "ratio", np.round(o["ratio"], 2), "te %.3g" % te, "ok" if good else "-", flush=True)
        if good: break
    near = list(s.get("near", []))
    if s["group"] in ("one", "two"): near = sorted(set(near) | set(fit.near_of(out, meta)))
    V = {a: float(b) for a, b in V.items() if s["group"] == "outside" or a.split(".")[0] in s["truth"]}
    T = dict(case=name, group=s["group"], kind=s["kind"], model=",".join(s["model"]), truth=s["truth"], near=near, values=V, true_error=te, notes=s.get("note", ""))
    if s["group"] == "outside": T["class"] = s["cls"]
    return T, meta, o

if __name__ == "__main__":
    ap = argparse.ArgumentParser(); ap.add_argument("--seed", type=int, required=True); ap.add_argument("--out", required=True); ap.add_argument("-v", action="count", default=0); ap.add_argument("--only"); a = ap.parse_args()
    os.makedirs(a.out, exist_ok=True); r = np.random.default_rng([a.seed, 4646]); S = specs(r); order = r.permutation(len(S)); truth = []; metas = {}; t0 = time.time()
    for pos in range(len(S)):
        k = int(order[pos])
        if a.only and str(k) not in a.only.split(","): continue
        T, m, o = one_case(S[k], a.seed, k, "dunlin_%02d" % pos, a.out, a.v); truth.append(T); metas[T["case"]] = m
        if not o["ok"]: print("rule not met:", T["case"], T["group"], T["truth"], o["ratio"])
        if a.v: print("   spec %d, %.1f s" % (k, time.time()-t0), flush=True)
    json.dump(truth, open(a.out+"/truth.json", "w"), indent=1); json.dump(metas, open(a.out+"/.start.json", "w"))
