"""tern: one contact case (robot with wrist sensor, or tester): motion, readings, nuisances, and the check's own fit."""
import numpy as np
from scipy.interpolate import CubicSpline
from scipy.optimize import least_squares
from scipy.ndimage import gaussian_filter1d
from core import *
NOISE = np.array([.015, .015, .029, .0005, .0006, .0003])

def prog(rng, fl, depth, Fest, Kc, tester=False):
    """flags fl: poke slide varspeed vardepth free freefast tilt cross sine hold revisit slow onespeed long shallow2deep"""
    add = (lambda d: -d) if tester else (lambda d: -(d + Fest(d) / Kc))
    h0 = .004 if tester else .008
    p = Path([0, 0, h0, 0, 0, 0]); w = fl
    def free(T, amp, f):
        ff = f * rng.uniform(.8, 1.2, 3); ph = rng.uniform(0, 6, 3)
        p.go(1.0, "free", h=.06)
        p.osc(T, "free", lambda t: dict(a=amp * np.sin(2*np.pi*ff[0]*t+ph[0]), b=amp * np.sin(2*np.pi*ff[1]*t+ph[1]), y=1.5*amp * np.sin(2*np.pi*ff[2]*t+ph[2]), s1=.03*np.sin(2*np.pi*ff[1]*.7*t), h=.02*np.sin(2*np.pi*ff[0]*.9*t)))
        p.go(1.0, "free", h=h0)
    if not tester:
        if "freefast" in w: free(rng.uniform(6, 10), .3, 1.1)
        elif "free" in w: free(rng.uniform(8, 14), .45, .22)
        else: p.go(rng.uniform(.3, 1), "free", h=h0 + .002)
    sp = (lambda: .0015 if tester else .002) if "slow" in w else ((lambda: .008) if "onespeed" in w else (lambda: 10**rng.uniform(-2.9, -1.5)))
    rep = (2 if "long" in w else 1) * (3 if "vlong" in w else 1); places = [(rng.uniform(-.02, .02), rng.uniform(-.015, .015)) for _ in range(3)]
    for _ in range(rep):
        if "poke" in w:
            n = rng.integers(4, 7) if "slide" not in w else int(rng.integers(2, 4))
            for i in range(n):
                fr = [.35, .6, 1., .8, .5, .9][i % 6] if "vardepth" in w else rng.uniform(.85, 1)
                if "shallow2deep" in w: fr = [.4, .4, .7, .7, 1, 1][i % 6]
                if "constdepth" in w: fr = 1.
                pl = places[i % 3] if not tester else (0., 0.)
                ti = dict(a=rng.uniform(-.2, .2), b=rng.uniform(-.2, .2)) if "tilt" in w else {}
                if not tester: p.go(.8, "free", s1=pl[0], s2=pl[1], h=h0, **ti)
                v = sp(); d = depth * fr; v = min(v, .03 if not tester else .05)
                p.lin(max((h0 + abs(add(d))) / v, .3), "poke", h=add(d))
                p.go(rng.uniform(2, 8) if "hold" in w else rng.uniform(.2, .8), "hold", h=p.x[2])
                if "sine" in w:
                    f = [.5, 2, 6, 1, 4, 9][i % 6]; A = .25 * d; p.osc(max(2.5, 3 / f), "poke", lambda t, f=f, A=A: dict(h=A * np.sin(2 * np.pi * f * t)))
                p.lin(max((h0 + abs(add(d))) / min(sp(), .03), .3), "retract", h=h0)
                if "wait" in w: p.go(rng.uniform(.5, 2), "free", h=h0)
        if "slide" in w:
            for j in range(3 if "vardepth" in w else 2):
                d = depth * ([.22, 1., .5][j] if "vardepth" in w else rng.uniform(.8, 1.))
                ti = dict(a=rng.uniform(-.15, .15), b=rng.uniform(-.15, .15)) if "tilt" in w else {}
                p.go(.8, "free", s1=-.02, s2=-.01, h=h0, **ti); p.go(rng.uniform(.6, 1.5), "approach", h=add(d))
                p.go(.4, "hold", h=p.x[2])
                vs = [.002, .008, .03, .06] if "varspeed" in w else ([.015] if "onespeed" in w else [.006, .02])
                for v in vs:
                    Lx = .02 if v > .004 else .004
                    p.lin(2 * Lx / v, "slide", s1=p.x[0] + 2 * Lx if p.x[0] < 0 else p.x[0] - 2 * Lx)
                    if "rest" in w: p.go(.6, "rest", h=p.x[2])
                    if "cross" in w: p.lin(.02 / max(v, .006), "slide", s2=.01 if p.x[1] < 0 else -.01)
                    p.lin(2 * Lx / v, "slide", s1=p.x[0] - 2 * Lx if p.x[0] > 0 else p.x[0] + 2 * Lx)
                if "small" in w: p.osc(6, "slide", lambda t: dict(s1=.0012 * np.sin(2 * np.pi * .7 * t) * (t / 6)))
                if "cross" in w or ("onespeed" not in w and rng.random() < .5 and "along" not in w):
                    p.osc(4, "slide", lambda t: dict(s1=.008 * np.sin(2*np.pi*.5*t), s2=.008 * np.sin(2*np.pi*.5*t + 1.2)))
                p.go(.8, "retract", h=h0)
        if "revisit" in w:
            for x in (-.03, -.015, 0, .015, .03, -.03, 0, .03, -.015, .015):
                if not tester: p.go(.7, "free", s1=x, s2=0, h=h0)
                else: p.go(.7, "free", s1=x, h=h0)
                p.lin((h0 + abs(add(depth))) / .012, "poke", h=add(depth)); p.go(.3, "hold", h=p.x[2]); p.lin((h0 + abs(add(depth))) / .012, "retract", h=h0)
    p.go(.3, "free", h=h0 + .001)
    return p

def nuis(rng, lv, kind):
    """random mix over the whole range; lv <= 1 scales the systematic ones at a retry"""
    lu = lambda a, b: 10**rng.uniform(np.log10(a), np.log10(b))
    U = rng.uniform
    return dict(nz=lu(.1, 3), enc=lu(2e-6, max(4e-6, 1e-3 * lv**2)), dq=rng.random() < .65, dqn=lu(1e-6, 5e-4), dqb=U(-2e-4, 2e-4), dqlag=lu(.001, .03),
                jit=U(0, .35) if rng.random() < .5 else 0., drop=U(0, .05) if rng.random() < .5 else 0., nl=U(-.01, .01) * lv, tdrift=U(-.01, .01) * lv, tilt=np.radians(U(0, .3)) * lv,
                tiltdir=U(0, 6.28), tool=U(-.02, .02) * lv, toolc=U(-.02, .02) * lv, clock=U(-.003, .003) * lv, lpf=lu(5, 50) / max(lv, .02)**1.5, hold=rng.random() < .6,
                fk=int(rng.integers(0, 2)), bl=lu(2e-5, 2e-4), r2=U(0, .03) * lv, tau2=lu(.02, 2), n=U(-.03, .03) * lv, st_dmu=U(0, .1) * lv, vs=lu(.0005, .003),
                Kc=lu(600, 5000) if rng.random() < .7 else lu(1e4, 6e4), ze=U(.5, 1), m=U(2.5, 6), seed=int(rng.integers(1 << 31)))

def sens_apply(w, t, dt, S):
    """w (N,6) on an even grid dt -> reading without noise"""
    w = w.copy()
    if "misalign" in S: E = np.eye(3); r = np.array(S["misalign"]); th = np.linalg.norm(r) + 1e-15; E = rotv(r / th, th).T; w[:, :3] = w[:, :3] @ E.T; w[:, 3:] = w[:, 3:] @ E.T
    if "cross" in S: w = w + w @ np.array(S["cross"]).T
    if "gain" in S: w = w * (1 + np.array(S["gain"]))
    if "nl" in S: w = w * (1 + S["nl"] * w / np.maximum(np.abs(w).max(0), 1e-9))
    if "lag" in S and S["lag"] > 0: w = lowpass(w, dt, S["lag"])
    if "bias" in S: w = w + np.array(S["bias"])
    if "drift" in S: w = w + t[:, None] * np.array(S["drift"]) / 60
    if "hum" in S: a, f, ph = S["hum"]; w = w + np.array(a) * (np.sin(2*np.pi*f*t + ph) + .2 * np.sin(6*np.pi*f*t + ph))[:, None]
    return w

def make_contact(c):
    """c: dict(kind, P (true law), fl, depth, Fest, rate, S (hidden sensor), T (hidden tool), tipoff, C, nu, base_bias, Tmax, outside)"""
    nu = c["nu"]; rng = np.random.default_rng(nu["seed"]); tester = c["kind"] == "tester"; dt = 2e-4
    pth = prog(rng, c["fl"], c["depth"], c["Fest"], nu["Kc"], tester)
    if pth.T > c.get("Tmax", 300):
        cut, T = [], 0
        for s in pth.seg:
            if T + s[0] > c.get("Tmax", 300): break
            cut.append(s); T += s[0]
        pth.seg = cut
    t, X, ph, phn = pth.sample(dt); V = np.gradient(X[:, :3], dt, axis=0)
    P = c["P"].copy()
    if nu["fk"] is not None:
        P[IX["fk"]] = nu["fk"]
        if "bl" not in c.get("keep", ()): P[IX["bl"]] = nu["bl"]
        if P[IX["rx"]] == 0 or "rx" in c.get("keep", ()): P[IX["r2"]] = nu["r2"]; P[IX["tau2"]] = nu["tau2"]
        dn = nu["n"]; P[IX["n"]] += dn; P[IX["k"]] *= (c["depth"] * .6)**(-dn)
        if P[IX["dmu"]] == 0 and P[IX["mu"]] > 0 and P[IX["vr"]] == 0: P[IX["dmu"]] = nu["st_dmu"] * P[IX["mu"]]; P[IX["vs"]] = nu["vs"]
    st = simulate(P, X[:, :3].copy(), V, dt, nu["Kc"] if not tester else 1., nu["ze"], nu["m"], tester, 1 if tester and c["rate"] > 900 else 5)
    gdt = dt if tester and c["rate"] > 900 else 5 * dt; tg = np.arange(len(st)) * gdt; n = len(tg)
    xs, vs_, F = st[:, :3], st[:, 3:6], st[:, 6:9]
    # sample times
    ns = int(tg[-1] * c["rate"]); ts = np.arange(ns) / c["rate"]
    if nu["jit"]: ts = ts + rng.uniform(-.5, .5, ns) * nu["jit"] / c["rate"]
    if nu["drop"]: ts = ts[rng.random(ns) > nu["drop"]]
    ts = np.sort(np.clip(ts, 0, tg[-1])); ts = ts[np.concatenate([[True], np.diff(ts) > 1e-5])]
    L = dict(t=ts); out = dict(c=c, L=L, phn=phn)
    L["phase"] = np.array(phn)[ph[np.clip((ts / dt).astype(int), 0, len(ph) - 1)]]
    S = dict(c.get("S", {})); S["nl"] = nu["nl"]
    if nu["tdrift"]: S["drift"] = np.array(S.get("drift", np.zeros(6))) + nu["tdrift"] * np.array([1, -.6, 1, .01, -.01, .005])
    toff = S.pop("toff", 0.) + (nu["clock"] if "toff" not in c.get("S", {}) else 0.); c["toff_true"] = toff
    sat = S.pop("sat", None); qz = S.pop("qz", None)
    if tester:
        w = np.zeros((n, 6)); w[:, 0] = F[:, 1]; w[:, 1] = F[:, 2]; w[:, 2] = F[:, 0]
        if c.get("C"): pass
    else:
        rob = c["robot"]; R0, p0 = rob.sensor(rob.q0[None]); R0, p0 = R0[0], p0[0]
        tip = rob.tip + np.array(c.get("tipoff", np.zeros(3)))
        Rs = R0 @ np.diag([1, -1, -1.]) @ rpy(*c["srpy"]); nrm = Rs[:, 2]; point = p0 + R0 @ rob.tip + R0 @ np.array([0, 0, .004])
        c["Rs"], c["point"] = Rs, point
        kdt = max(gdt, .002 if tg[-1] < 60 else .005); ks = int(round(kdt / gdt)); tk = tg[::ks]
        Xk = X[::5 * ks][:len(tk)]
        Rd = R0 @ rotv((1, 0, 0), Xk[:, 3]) @ rotv((0, 1, 0), Xk[:, 4]) @ rotv((0, 0, 1), Xk[:, 5])
        xt = xs[::ks].copy()
        if c.get("C"): xt[:, 2] -= c["C"] * F[::ks, 0]            # joints report the tip deeper than it is by C·N
        pd = point + xt @ Rs.T - Rd @ tip
        q, e = rob.ik(Rd, pd)
        if e > 1e-6: raise RuntimeError("ik %.2g" % e)
        sp = CubicSpline(tk, q); qg = sp(tg)
        # true sensor pose (without elastic error: second order small) on the grid
        R, p = rob.sensor(qg); T = c.get("T", {})
        m0, com0 = c["tool"]; m = (m0 + T.get("dm", 0)) * (1 + nu["tool"]); com = (np.array(com0) + np.array(T.get("dcom", np.zeros(3)))) * (1 + nu["toolc"])
        g = np.array(c["g"]); tl = nu["tilt"]; g = rotv((np.cos(nu["tiltdir"]), np.sin(nu["tiltdir"]), 0), tl) @ g
        pc = p + R @ com; pc = gaussian_filter1d(pc, 2.0, axis=0); ac = np.gradient(np.gradient(pc, gdt, axis=0), gdt, axis=0)
        fc = F[:, 1:2] * Rs[:, 0] + F[:, 2:3] * Rs[:, 1] + F[:, 0:1] * Rs[:, 2]
        tr = lambda v: np.einsum('nji,nj->ni', R, v)
        ft = m * tr(g - ac); fcs = tr(fc); w = np.concatenate([ft + fcs, np.cross(np.tile(com, (n, 1)), ft) + np.cross(np.tile(tip, (n, 1)), fcs)], 1)
        if "dI" in T:
            Rr = R[::ks]; wv = logm(np.swapaxes(Rr[:-1], 1, 2) @ Rr[1:]) / kdt; wv = np.vstack([wv, wv[-1:]]); wv = gaussian_filter1d(wv, 2, axis=0); al = np.gradient(wv, kdt, axis=0)
            Im = np.diag(T["dI"]); tq = -(al @ Im.T + np.cross(wv, wv @ Im.T)); w[:, 3:] += np.stack([np.interp(tg, tk, tq[:, j]) for j in range(3)], 1)
        if c.get("outside") and "wfun" in c: w = w + c["wfun"](tg, R, qg, p, w)
    w = sens_apply(w, tg, gdt, S)
    rd = np.stack([np.interp(ts + toff, tg, w[:, j]) for j in range(6)], 1)
    sc = np.array([1, 1, 1, 1, 1, 1.]); clean = rd.copy()
    nz = c.get("noise", NOISE) * nu["nz"] * rng.standard_normal((len(ts), 6))
    if sat is not None and c.get("satnoise", "front") == "front": rd = rd + nz; rd = np.clip(rd, -np.array(sat), np.array(sat)); clean = np.clip(clean, -np.array(sat), np.array(sat))
    elif sat is not None: clean = np.clip(clean, -np.array(sat), np.array(sat)); rd = clean + nz
    else: rd = rd + nz
    if qz is not None: s_ = np.maximum(np.array(qz), 1e-12); rd = np.where(np.array(qz) > 0, np.round(rd / s_) * s_, rd)
    if tester:
        dpt = np.interp(ts, tg, -xs[:, 2]); e = nu["enc"] * .02
        if c.get("C"): dpt = dpt + c["C"] * np.interp(ts, tg, F[:, 0])
        dpt = np.round(dpt / e) * e; L["depth"] = dpt
        if nu["dq"]: L["depth_rate"] = np.interp(ts - nu["dqlag"] * .2, tg, -vs_[:, 2]) + nu["dqn"] * .3 * rng.standard_normal(len(ts))
        L["normal_force"] = rd[:, 2]
        out["true_error"] = float(np.sqrt(np.mean((rd[:, 2] - clean[:, 2])**2)))
        if c["P"][IX["mu"]] > 0:
            L["slip1"] = np.round(np.interp(ts, tg, xs[:, 0]) / e) * e; L["tangential_force1"] = rd[:, 0]; L["slip2"] = np.round(np.interp(ts, tg, xs[:, 1]) / e) * e; L["tangential_force2"] = rd[:, 1]
            out["true_error"] = float(np.sqrt(np.mean((rd[:, :3] - clean[:, :3])**2)))
    else:
        qs = sp(ts); e = nu["enc"]; qe = np.round(qs / e) * e
        for i in range(rob.n): L[f"q{i+1}"] = qe[:, i]
        if nu["dq"]:
            v = lowpass(sp(tg, 1), gdt, nu["dqlag"])
            for i in range(rob.n): L[f"dq{i+1}"] = np.interp(ts, tg, v[:, i]) + nu["dqn"] * rng.standard_normal(len(ts)) + nu["dqb"] * rng.uniform(-1, 1)
        for j, nme in enumerate("fx fy fz tx ty tz".split()): L[nme] = rd[:, j]
        out["true_error"] = float(np.sqrt(np.mean((rd[:, :3] - clean[:, :3])**2)))
    return out

# ---------------------------------------------------------------- own fit
# effect -> [(group, key, start, log?)]
def spec(name, c):
    t = c["P"]; g = lambda k: float(t[IX[k]]) or 1e-3
    D = {
     "hooke": [("P", "k", 1)], "kelvin-voigt": [("P", "k", 1), ("P", "c", 1)], "hertz": [("P", "k", 1)], "hunt-crossley": [("P", "k", 1), ("P", "lam", 1)],
     "zener": [("P", "k", 1), ("P", "rx", 1), ("P", "tau", 1)], "maxwell": [("P", "k", 1), ("P", "tau", 1)],
     "hertz-exponent": [("P", "n", 1)], "viscous-damping": [("P", "c", 1)], "hunt-crossley-damping": [("P", "lam", 1)], "relaxation": [("P", "rx", 1), ("P", "tau", 1)],
     "hysteresis": [("P", "hA", 1), ("P", "hL", 1)], "stress-softening": [("P", "mr", 1), ("P", "mL", 1)], "adhesion": [("P", "Fa", 1), ("P", "La", 1)],
     "stiffening-layer": [("P", "Kl", 1), ("P", "db", 1)], "surface-offset": [("P", "z0", 0)], "stiffness-drift": [("P", "al", 0)],
     "stiffness-inhomogeneity": [("P", "ia", 0), ("P", "ix", 0), ("P", "iw", 1)], "coulomb-friction": [("P", "mu", 1)], "viscous-friction": [("P", "cv", 1)],
     "stribeck-friction": [("P", "dmu", 1), ("P", "vs", 1)], "presliding": [("P", "bl", 1)], "friction-rounding": [("P", "vr", 1)], "load-dependent-friction": [("P", "p", 0)],
     "friction-anisotropy": [("P", "an", 0)], "tool-mass": [("T", "dm", 0)], "tool-com": [("T", "dcom", 0)], "tool-inertia": [("T", "dI", 0)],
     "structural-compliance": [("C", "C", 0)], "tip-offset": [("tip", "tipoff", 0)], "sensor-bias": [("S", "bias", 0)], "sensor-drift": [("S", "drift", 0)],
     "sensor-crosstalk": [("S", "cross", 0)], "sensor-misalignment": [("S", "misalign", 0)], "sensor-gain": [("S", "gain", 0)], "sensor-lag": [("S", "lag", 1)],
     "time-offset": [("S", "toff", 0)], "saturation": [("S", "sat", -1)], "quantization": [], "mains-hum": [("S", "hum", -1)], "none": []}
    return D[name]
def fit_contact(o, comps, maxn=2500, fixed=None, nfev=25, drop=()):
    c, L = o["c"], o["L"]; tester = c["kind"] == "tester"; t = L["t"]; N = len(t); k = max(1, N // maxn)
    if "mains-hum" in comps + list(drop): k = 1; sl = slice(0, min(N, 6000))
    else: sl = slice(0, N)
    t = t[sl]; N = len(t)
    dtm = np.median(np.diff(t)); sg = max(.006 / dtm, .7)
    if "cache" not in o: o["cache"] = {}
    C = o["cache"].setdefault((k, N), {})
    if not C:
        ix = np.arange(0, N, k); C["ix"] = ix; C["t"] = t[ix] - t[0]
        sm = lambda x: gaussian_filter1d(x, sg, axis=0)
        if tester:
            d = L["depth"][sl]; s1 = L.get("slip1", np.zeros(len(L["t"])))[sl]; s2 = L.get("slip2", np.zeros(len(L["t"])))[sl]
            C["y"] = np.stack([L.get("tangential_force1", np.zeros(len(L["t"])))[sl], L.get("tangential_force2", np.zeros(len(L["t"])))[sl], L["normal_force"][sl]] + [np.zeros(N)] * 3, 1)[ix]
            x = np.stack([s1, s2, -d], 1); C["x0"] = sm(x)[ix]; C["v0"] = np.gradient(sm(sm(x)), t, axis=0)[ix]
        else:
            rob = c["robot"]; q = np.stack([L[f"q{i+1}"] for i in range(rob.n)], 1)[sl]; q = sm(q)
            R, p = rob.sensor(q); C["R"], C["p"] = R[ix], p[ix]; C["a"] = np.gradient(np.gradient(sm(p), t, axis=0), t, axis=0)[ix]
            wv = logm(np.swapaxes(R[:-1], 1, 2) @ R[1:]) / np.diff(t)[:, None]; wv = sm(np.vstack([wv, wv[-1:]])); C["w"] = wv[ix]; C["al"] = np.gradient(wv, t, axis=0)[ix]
            C["y"] = np.stack([L[m] for m in "fx fy fz tx ty tz".split()], 1)[sl][ix]
            x = (p + R @ rob.tip - c["point"]) @ c["Rs"]; C["x0"] = x[ix]; C["vp"] = np.gradient(sm(p + R @ rob.tip), t, axis=0)[ix] @ c["Rs"]
    tt = C["t"]; Pt = c["P"]; S0 = c.get("S", {}); par = []; law = any(b in comps for b in ("hooke", "kelvin-voigt", "hertz", "hunt-crossley", "zener", "maxwell"))
    base_n = 1.5 if ("hertz" in comps or "hunt-crossley" in comps) else 1.
    for e in comps:
        for g, key, lg in spec(e, c):
            if g == "P": par.append((g, key, None, float(Pt[IX[key]]), lg))
            elif lg == -1: par.append((g, key, None, 1., -2))
            else:
                src = {"S": S0, "T": c.get("T", {}), "C": c, "tip": c}[g].get(key, {"bias": np.zeros(6), "dcom": np.zeros(3), "tipoff": np.zeros(3)}.get(key, 0.)); a = np.atleast_1d(np.array(src, float))
                for idx in np.argwhere((a != 0) | (key in ("bias", "dcom"))): par.append((g, key, tuple(idx), float(a[tuple(idx)]), lg if a[tuple(idx)] > 0 else 0))
    free = [q for q in par if q[4] != -2]
    tn = set(q[1] for q in par if q[0] == "P")
    ysc = np.array([1, 1, 1, 20, 20, 20.]) if not tester else np.array([1, 1, 1, 0, 0, 0.])
    if tester and Pt[IX["mu"]] == 0: ysc = np.array([0, 0, 1, 0, 0, 0.])
    def model(th):
        P = pvec(n=base_n)
        if fixed is not None: P = fixed.copy()
        S, T, Cc, tip = {}, {}, 0., np.zeros(3)
        P[IX["N0"]] = Pt[IX["N0"]]
        if "stiffness-inhomogeneity" in comps: P[IX["it"]] = Pt[IX["it"]]
        for (g, key, idx, v0, lg), x in zip(free, th):
            v = v0 * np.exp(x) if (lg and v0 > 0) else v0 + x * (abs(v0) if v0 else {"bias": .1, "dcom": .005, "al": .001}.get(key, .01))
            if g == "P": P[IX[key]] = v
            elif g == "C": Cc = v
            elif key in ("lag", "toff", "dm"): (S if g == "S" else T)[key] = v
            else:
                dd_ = S if g == "S" else (T if g == "T" else None)
                if dd_ is None: tip[idx[0]] = v
                else:
                    shp = {"cross": (6, 6), "gain": (6,), "bias": (6,), "drift": (6,), "misalign": (3,), "dcom": (3,), "dI": (3,)}[key]
                    A = dd_.setdefault(key, np.zeros(shp)); A[idx if len(shp) > 1 or len(shp) == 1 else 0] = v
        if "maxwell" in comps: P[IX["rx"]] = 1.
        if "relaxation" not in comps and "zener" not in comps and "maxwell" not in comps and fixed is None: P[IX["rx"]] = 0
        if tester: x = C["x0"]; v = C["v0"]
        else: off = (C["R"] @ tip) @ c["Rs"]; x = C["x0"] + off; v = C["vp"]
        d = -x[:, 2]
        toff = S.pop("toff", 0.)
        if Cc:
            if tester: Nm = C["y"][:, 2]
            else: Nm = np.einsum('nij,nj->ni', C["R"], C["y"][:, :3]) @ c["Rs"][:, 2] - (c["tool"][0] * np.array(c["g"])) @ c["Rs"][:, 2]
            Nm = np.where(d > 0, Nm, 0)
            d = d - Cc * gaussian_filter1d(Nm, 1.0)
            dd = np.gradient(gaussian_filter1d(d, 1.), tt)
        else: dd = -v[:, 2]
        F = drive_law(P, tt, d, dd, x[:, 0].copy(), x[:, 1].copy(), v[:, 0].copy(), v[:, 1].copy()) if (law or fixed is not None) else np.zeros((len(tt), 3))
        if tester: w = np.zeros((len(tt), 6)); w[:, 0] = F[:, 1]; w[:, 1] = F[:, 2]; w[:, 2] = F[:, 0]
        else:
            Rs = c["Rs"]; fc = F[:, 1:2] * Rs[:, 0] + F[:, 2:3] * Rs[:, 1] + F[:, 0:1] * Rs[:, 2]; R = C["R"]; tr = lambda u: np.einsum('nji,nj->ni', R, u)
            m = c["tool"][0] + T.get("dm", 0); com = np.array(c["tool"][1]) + T.get("dcom", 0); n = len(tt); comv = np.tile(com, (n, 1))
            alc = np.cross(C["al"], comv) + np.cross(C["w"], np.cross(C["w"], comv))
            ft = m * (tr(np.array(c["g"]) - C["a"]) - alc); fcs = tr(fc)
            w = np.concatenate([ft + fcs, np.cross(comv, ft) + np.cross(np.tile(c["robot"].tip + tip, (n, 1)), fcs)], 1)
            if "dI" in T: Im = np.diag(T["dI"]); w[:, 3:] -= C["al"] @ Im.T + np.cross(C["w"], C["w"] @ Im.T)
        if "saturation" in comps: S.pop("sat", None)
        w = sens_apply(w, tt, float(np.median(np.diff(tt))), S)
        if toff: w = np.stack([np.interp(tt + toff, tt, w[:, j]) for j in range(6)], 1)
        if "saturation" in comps: w = np.clip(w, -np.array(S0["sat"]), np.array(S0["sat"]))
        if "mains-hum" in comps:
            f = S0["hum"][1]; H = np.concatenate([[np.sin(2*np.pi*f*h*tt), np.cos(2*np.pi*f*h*tt)] for h in (1, 3)]).T; r = C["y"] - w; w = w + H @ np.linalg.lstsq(H, r, rcond=None)[0]
        return w
    f = lambda th: ((model(th - 1.) - C["y"]) * ysc).ravel()
    best = None
    if fixed is not None or not free: th = np.ones(len(free)); r = f(th)
    else:
        starts = [np.ones(len(free))]
        for s in starts:
            q = least_squares(f, s, max_nfev=nfev, x_scale=1., diff_step=1e-4)
            if best is None or q.cost < best.cost: best = q
        r = best.fun; th = best.x
    r = r.reshape(-1, 6); return r, C["y"] * ysc, th
def rms(r, ch): return float(np.sqrt(np.mean(r[:, ch]**2)))
