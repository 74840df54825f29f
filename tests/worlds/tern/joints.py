"""tern: joint-torque logs in free motion and single-joint drives."""
import numpy as np
from scipy.ndimage import gaussian_filter1d
from core import *

def traj(rng, n, amp, mid, T, fmax, kind, dt=1e-3):
    t = np.arange(int(T / dt)) * dt; q = np.zeros((len(t), n))
    if kind == "fourier":
        for i in range(n):
            K = rng.integers(2, 5); f = np.sort(rng.uniform(min(.04, .5 * fmax), fmax, K)); a = rng.uniform(.4, 1, K) / (1 + f / .1); a *= amp[i] / a.sum(); p = rng.uniform(0, 6.28, K)
            q[:, i] = mid[i] + (a * np.sin(2 * np.pi * f * t[:, None] + p)).sum(1)
        w = np.clip(np.minimum(t - .2, T - .2 - t) / 1.0, 0, 1); w = w**3 * (10 - 15 * w + 6 * w * w); q = q[:1] + (q - q[:1]) * w[:, None]
    elif kind in ("moves", "turns"):
        for i in range(n):
            x = mid[i]; tt = 0.3; q[:, i] = x
            while tt < T - .5:
                tgt = mid[i] + amp[i] * rng.uniform(-1, 1) if kind == "moves" else x + rng.choice([-1, 1]) * rng.uniform(3, 9)
                vmax = 10**rng.uniform(np.log10(.05), np.log10(1.2 * min(fmax * 3, 1.5))) if kind == "moves" else 10**rng.uniform(-1.5, .5)
                D = max(abs(tgt - x) * 1.875 / vmax, .5); tgt = x + np.sign(tgt - x) * min(abs(tgt - x), 12 * vmax / 1.875); D = min(D, 12); u = np.clip((t - tt) / D, 0, 1); q[:, i] += (tgt - x) * u**3 * (10 - 15 * u + 6 * u * u)
                x = tgt; tt += D + rng.uniform(.1, .8)
    elif kind == "speed":      # constant-speed sweeps one speed only
        for i in range(n):
            per = 8.; ph = (t / per + .07 * i) % 1; tri = 2 * np.abs(2 * ph - 1) - 1; tri = gaussian_filter1d(tri, 60); q[:, i] = mid[i] + amp[i] * tri
    q = gaussian_filter1d(q, 25, axis=0); v = np.gradient(q, dt, axis=0); a = np.gradient(v, dt, axis=0)
    return t, q, v, a

def make_joint(c):
    nu = c["nu"]; rng = np.random.default_rng(nu["seed"]); rob = c["robot"]; n = rob.n if rob else 1; dt = 1e-3; H = c["H"]
    t, q, v, a = traj(rng, n, c["amp"], c["mid"], c["T"], c["fmax"], c["traj"])
    g = np.array([0, 0, -9.81])
    if "gtilt" in H: g = rotv((np.cos(H["gdir"]), np.sin(H["gdir"]), 0), H["gtilt"]) @ g
    g = rotv((np.cos(nu["tiltdir"]), np.sin(nu["tiltdir"]), 0), nu["tilt"]) @ g if rob else g
    if rob: ID = lambda q, v, a: rob.rnea(q, v, a, g, payload=H.get("payload"))
    else: ID = lambda q, v, a: c["J"] * a + c.get("mgl", 0) * np.sin(q)
    tau0 = ID(q, v, a)
    fr = np.zeros_like(tau0); B = c["B"]; sd = c["sd_v"] if "sd_v" in c else .01
    for i in range(n):
        z = bristle(np.diff(q[:, i], prepend=q[0, i]), nu["bl"] * 8, nu["fk"])
        Fc = B.get("Fc", np.zeros(n))[i] + H.get("Fc", np.zeros(n))[i]; Fv = B.get("Fv", np.zeros(n))[i] + H.get("Fv", np.zeros(n))[i]
        st = nu["st_dmu"] * .5 * B.get("Fc", np.zeros(n))[i] * np.exp(-(v[:, i] / nu["vs"])**2) if "dF" not in H else H["dF"][i] * np.exp(-(v[:, i] / H["vs"])**2)
        mag = Fc + st + (H["lf"][i] * np.abs(tau0[:, i]) if "lf" in H else 0)
        f = mag * z + Fv * v[:, i]
        if "warm" in H: f = Fc * z + Fv * v[:, i] * (1 + H["warm"][i] * np.exp(-t / H["warmT"]))
        if "asym" in H: f = f * (1 + H["asym"][i] * z)
        if "ripple" in H: A, k, p = H["ripple"]; f = f + A[i] * np.sin(k * q[:, i] + p[i]) + .3 * A[i] * np.sin(2 * k * q[:, i] + 2 * p[i])
        if "spring" in H: f = f + H["spring"][i] * q[:, i]
        if "drag" in H: f = f + H["drag"][i] * v[:, i] * np.abs(v[:, i])
        if "bump" in H: kq, q0 = H["bump"][i]; f = f + kq * np.maximum(q[:, i] - q0, 0)
        if "hose" in H: f = f + H["hose"][i] * np.sin(q[:, i] * 0 + 2 * np.pi * .43 * t + i)     # something that shakes at its own clock
        fr[:, i] = f
    tau = tau0 + fr + (B.get("rotor", np.zeros(n)) + H.get("rotor", np.zeros(n))) * a + H.get("off", np.zeros(n)) + B.get("off", np.zeros(n))
    ql = q + tau / H["K"] if "K" in H else q
    # encoders on the motor side when elastic
    vl = np.gradient(ql, dt, axis=0) if "K" in H else v
    rep = tau * (1 + H.get("gain", np.zeros(n)))
    rep = rep * (1 + nu["nl"] * np.abs(rep) / np.maximum(np.abs(rep).max(0), 1e-9)); rep = lowpass(rep, dt, 1 / (2 * np.pi * nu["lpf"]))
    if "sat" in H: rep = np.clip(rep, -H["sat"], H["sat"])
    ns = int(t[-1] * c["rate"]); ts = np.arange(ns) / c["rate"]
    if nu["jit"]: ts = ts + rng.uniform(-.5, .5, ns) * nu["jit"] / c["rate"]
    if nu["drop"]: ts = ts[rng.random(ns) > nu["drop"]]
    ts = np.sort(np.clip(ts, 0, t[-1])); ts = ts[np.concatenate([[True], np.diff(ts) > 1e-5])]
    tt = ts.copy()
    if nu["hold"]: hr = min(max(c["rate"] * .5, nu["lpf"] * 6), 1000.); tt = np.floor(ts * hr) / hr
    tt = tt + nu["clock"] * .5
    L = dict(t=ts); e = nu["enc"]; tn = c["tn"] * min(nu["nz"], 3)
    drift = nu["tdrift"] * 2 * c["tn"]
    for i in range(n): L[f"q{i+1}"] = np.round(np.interp(ts, t, ql[:, i]) / e) * e
    if nu["dq"]:
        vv = lowpass(vl, dt, nu["dqlag"])
        for i in range(n): L[f"dq{i+1}"] = np.interp(ts, t, vv[:, i]) + nu["dqn"] * rng.standard_normal(len(ts)) + nu["dqb"] * rng.uniform(-1, 1)
    er = []
    for i in range(n):
        cl = np.interp(tt, t, rep[:, i]); L[f"tau{i+1}"] = cl + tn[i] * rng.standard_normal(len(ts)) + drift[i] * ts / 60; er.append(L[f"tau{i+1}"] - cl)
    return dict(c=c, L=L, true_error=float(np.sqrt(np.mean(np.array(er)**2))))

def fit_joint(o, comps, maxn=3000):
    c, L = o["c"], o["L"]; rob = c["robot"]; n = rob.n if rob else 1; t = L["t"]; H = c["H"]; N = len(t)
    if "jc" not in o:
        dtm = np.median(np.diff(t)); q = np.stack([L[f"q{i+1}"] for i in range(n)], 1); s = max(.02 / dtm, .7); te = np.arange(t[0], t[-1], dtm)
        q = np.stack([np.interp(te, t, q[:, i]) for i in range(n)], 1); sm = lambda x: gaussian_filter1d(x, s, axis=0); q = sm(q); v = np.gradient(sm(q), dtm, axis=0); a = np.gradient(sm(v), dtm, axis=0)
        y = sm(np.stack([np.interp(te, t, L[f"tau{i+1}"]) for i in range(n)], 1)); ys = y
        y = np.stack([np.interp(te, t, L[f"tau{i+1}"]) for i in range(n)], 1)
        E = max(4, int(.12 / dtm)); k = max(1, len(te) // maxn); Z = [np.stack([bristle(np.diff(q[:, i], prepend=q[0, i]), Lb, 0) for i in range(n)], 1) for Lb in (2e-4, 1e-3)]
        o["jc"] = tuple(x[E:-E:k] for x in (q, v, a, y, ys, te)) + ([z[E:-E:k] for z in Z],)
    q, v, a, y, ys, te, Z = o["jc"]; g = np.array([0, 0, -9.81]); z0 = 0 * q
    R = rob.rnea(q, v, a, g) if rob else z0
    best = None
    for sg in [np.tanh(v / .01)] + Z:
        r = _fit(comps, sg, q, v, a, y, ys, te, z0, R, rob, H, g, n)
        if best is None or (r**2).sum() < (best**2).sum(): best = r
    return best, y
def _fit(comps, sg, q, v, a, y, ys, te, z0, R, rob, H, g, n):
    X = {}
    def feat(e):
        if e == "joint-coulomb-friction": return [sg]
        if e == "joint-viscous-friction": return [v]
        if e == "joint-friction-asymmetry": return [np.abs(sg), np.abs(v)]
        if e == "joint-torque-offset": return [np.ones_like(q)]
        if e == "rotor-inertia": return [a]
        if e == "joint-torque-gain": return [ys]
        if e == "payload":
            m, x = H["payload"]; return [rob.rnea(q, v, a, g, payload=(m, x)) - R]
        if e == "joint-elasticity":
            if rob: return [rob.rnea(q - ys / H["K"], v, a - np.gradient(np.gradient(ys / H["K"], te, axis=0), te, axis=0), g) - R]
            yd = np.gradient(gaussian_filter1d(ys, 2, axis=0), te, axis=0); return [np.gradient(gaussian_filter1d(yd, 2, axis=0), te, axis=0), yd]
        if e == "gravity-error": return [rob.rnea(q, z0, z0, np.array(d, float)) for d in ((1, 0, 0), (0, 1, 0))]
        if e == "joint-stribeck-friction": return [sg * np.exp(-(v / H["vs"])**2)]
        if e == "joint-load-friction": return [sg * np.abs(R if rob else ys)]
        if e == "joint-torque-ripple": k = H["ripple"][1]; return [np.sin(k * q), np.cos(k * q), np.sin(2 * k * q), np.cos(2 * k * q)]
        if e == "joint-spring": return [q]
        if e == "rigid-body": return [] if rob else [a]
        raise KeyError(e)
    for e in comps: X[e] = feat(e)
    r = np.empty_like(y)
    for i in range(n):
        A = [f[:, i] for e in comps for f in X[e]]; b = y[:, i] - R[:, i]
        if A: A = np.array(A).T; s = np.linalg.norm(A, axis=0) + 1e-12; x = np.linalg.lstsq(A / s, b, rcond=None)[0]; b = b - (A / s) @ x
        r[:, i] = b
    return r
