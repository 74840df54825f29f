"""Joint-torque logs: arms in free motion and single drives."""
import zlib
import numpy as np
import pinocchio as pin
from scipy.signal import lti, lsim
from engine import joint_friction, lowpass
from robots import ARMS, urdf
from fit import bristle, smooth_rate

DT = 2e-3


def motion(g, n, T, opts, turns):
    N = int(T / DT); t = np.arange(N) * DT; k = max(int(T / 6), 5)
    lev = {"slow": [.12, .16], "fastonly": [1., 1.1]}.get(next((o for o in ("slow", "fastonly") if o in opts), ""), [.08, .3, .7, 1.2, 0.])
    sp = [lev[i % len(lev)] for i in range(k)]; g.shuffle(sp)
    s = np.repeat(sp, int(np.ceil(N / k)))[:N]; ker = np.hanning(int(.6 / DT)); s = np.convolve(np.pad(s, len(ker), mode="edge"), ker / ker.sum(), "same")[len(ker):-len(ker)]
    ph = np.cumsum(s) * DT; q = np.zeros((N, n))
    for j in range(n):
        for a, f in ((.55, g.uniform(.12, .2)), (.3, g.uniform(.25, .4)), (.12, g.uniform(.5, .8))):
            q[:, j] += g.uniform(.6, 1.) * a * (np.sin(2 * np.pi * f * ph + g.uniform(0, 6.3)))
        if turns: q[:, j] = q[:, j] * 4 + 0
        _, y, _ = lsim(lti([900.], [1, 48., 900.]), q[:, j] - q[0, j], t); q[:, j] = y + q[0, j]
    return t, q


def rnea(m, q, v, a, g):
    d = m.createData(); m.gravity.linear = g
    return np.stack([pin.rnea(m, d, q[i], v[i], a[i]) for i in range(len(q))])


def joint_case(spec, on):
    r = np.random.default_rng([spec["seed"], 1]); ns, bo, op, ef = spec["ns"], spec["boost"], spec["opts"], spec["eff"]
    er = {e: np.random.default_rng([spec["seed"], zlib.crc32(e.encode())]) for e in ef}; act = lambda e: e in on and e in ef; has = lambda e: e in ef
    drive = spec["platform"] == "drive"; n = 1 if drive else len(ARMS[spec["arm"]]["joints"]); V, files, rig = {}, {}, []
    T = float(r.uniform(25, 60) if not drive else r.uniform(20, 120)); t, q = motion(np.random.default_rng([spec["seed"], 5]), n, T, op, drive and r.random() < .6)
    if not drive: q = q * .9 + np.array(ARMS[spec["arm"]]["down"]) * .8
    v = np.gradient(q, DT, axis=0); a = np.gradient(v, DT, axis=0)
    if drive:
        Jd = float(np.exp(r.uniform(np.log(.05), np.log(2.)))); load = Jd * a; ts = np.array([max(float(np.std(load)), .5)]); grav = gt = None; known = load
    else:
        m = pin.buildModelFromXML(urdf(spec["arm"], spec["arm"])); grav = np.array([0, 0, -9.81]) if r.random() < .7 else np.array([-9.81, 0, 0.])
        th = r.uniform(-.004, .004, 3) * ns
        if act("gravity-error"): th = er["gravity-error"].uniform(.025, .05, 3) * er["gravity-error"].choice([-1, 1], 3) * bo
        gt = pin.exp3(th) @ grav; mt = m.copy()
        if act("payload"):
            pm = float(er["payload"].uniform(.4, 1.5) * bo); V["payload.mass"] = pm
            mt.appendBodyToJoint(m.njoints - 1, pin.Inertia(pm, np.array([.02, -.01, .06]), np.eye(3) * 1e-3 * pm), pin.SE3.Identity())
        load = rnea(mt, q, v, a, gt); ts = np.maximum(np.sqrt((load ** 2).mean(0)), .15)
    vm = np.maximum(np.sqrt((v ** 2).mean(0)), .05)
    Fc = r.uniform(.12, .3, n) * ts; Fv = r.uniform(.1, .25, n) * ts / vm
    if has("joint-stribeck-friction"): Fv *= .5
    G = lambda e, lo, hi: er[e].uniform(lo, hi, n) * bo if e in er else np.zeros(n)
    hasf = "joint-coulomb-friction" in spec["model"] or act("joint-coulomb-friction"); hasv = "joint-viscous-friction" in spec["model"] or act("joint-viscous-friction")
    Fc, Fv = Fc * hasf, Fv * hasv; st = G("joint-stribeck-friction", .2, .4) * ts * act("joint-stribeck-friction"); vs = r.uniform(.03, .08) * (1 if not drive else 2)
    ld = G("joint-load-friction", .1, .25) * act("joint-load-friction"); dry = G("joint-friction-asymmetry", .15, .3) * ts * act("joint-friction-asymmetry"); asym = dry / vm * .6
    for nm, key, x in (("joint-coulomb-friction", "coulomb", Fc), ("joint-viscous-friction", "viscous", Fv), ("joint-load-friction", "load", ld), ("joint-friction-asymmetry", "dry", dry), ("joint-friction-asymmetry", "asymmetry", asym)):
        if nm in spec["model"] or act(nm): V.update({f"{nm}.{key}_{j+1}": float(x[j]) for j in range(n)})
    tau = load + np.stack([joint_friction(np.ascontiguousarray(q[:, j]), DT, Fc[j], float(2e-3 * np.exp(r.uniform(-1.2, .6) * ns)), st[j], vs, ld[j], dry[j], asym[j], Fv[j], np.ascontiguousarray(load[:, j])) for j in range(n)], 1)
    if act("rotor-inertia"): Ia = G("rotor-inertia", .25, .5) * ts / np.maximum(np.std(a, axis=0), .3) * (.004 if "slow" in op else 1); tau = tau + Ia * a; V.update({f"rotor-inertia.inertia_{j+1}": float(Ia[j]) for j in range(n)})
    if act("joint-torque-ripple"):
        e = er["joint-torque-ripple"]; k = int(e.integers(6, 25)); A = G("joint-torque-ripple", .1, .2) * ts; pp = e.uniform(0, 6.3, n)
        tau = tau + A * (np.sin(k * q + pp) + .25 * np.sin(2 * k * q + 2 * pp)); V["joint-torque-ripple.order"] = k
    if act("joint-spring"):
        ks = G("joint-spring", .25, .5) * ts / np.std(q, axis=0); qs = er["joint-spring"].uniform(-.5, .5, n) + q.mean(0); tau = tau + ks * (q - qs); V.update({f"joint-spring.rate_{j+1}": float(ks[j]) for j in range(n)})
    ql = q.copy()
    if act("joint-elasticity"): Cj = G("joint-elasticity", .012, .03) / ts; Cj[0] *= .3; ql = q + Cj * tau; V.update({f"joint-elasticity.sag_{j+1}": float(Cj[j]) for j in range(n)})
    if act("x-drag"): tau = tau + G("x-drag", .4, .7) * ts * v * np.abs(v) * np.abs(v) / vm ** 3 * .5
    if act("x-push"):
        for i in range(max(int(T / 5), 4)):
            c, w = er["x-push"].uniform(0, T), er["x-push"].uniform(.1, .5); tau = tau + np.exp(-((t - c) / w) ** 2)[:, None] * er["x-push"].uniform(-1, 1, n) * ts * 1.2 * bo
    if act("x-backlash"):                                          # load behind a gap: motor encoder logged, sub-stepped
        gap = .03 * bo; Jl, Js = .7 * Jd, .3 * Jd; w2 = 60.; x, xv = q[0, 0], 0.; o = np.zeros(len(q))
        for i in range(1, len(q)):
            for s in range(4):
                qq = q[i - 1, 0] + (q[i, 0] - q[i - 1, 0]) * (s + 1) / 4; d = qq - x; e = d - np.clip(d, -gap, gap); f = Jl * w2 ** 2 * e + (Jl * w2 * .3 * (v[i, 0] - xv) if e != 0 else 0)
                xv += (f - Fv[0] * .5 * xv) / Jl * DT / 4; x += xv * DT / 4
            o[i] = f
        tau = tau - Jl * a + lowpass(o[:, None], DT, .01)
    clean_dense = tau.copy(); S = tau.copy()
    if act("joint-torque-gain"): gn = G("joint-torque-gain", .12, .25) * er["joint-torque-gain"].choice([-1, 1], n); S = S * (1 + gn)
    if act("joint-torque-offset"): of = G("joint-torque-offset", .12, .3) * ts * er["joint-torque-offset"].choice([-1, 1], n); S = S + of; V.update({f"joint-torque-offset.offset_{j+1}": float(of[j]) for j in range(n)})
    S = S * (1 + r.uniform(-.01, .01) * ns * S / (3 * ts)) + r.uniform(-.003, .003, n) * ns * ts
    fc = float(r.choice([5, 10, 20, 50])) / max(ns, .1) ** .5
    S = lowpass(S, DT, 1 / (2 * np.pi * fc))
    fs = float(r.choice([100, 200, 250, 500, 1000] if not drive else [100, 500, 1000, 2000])); fs = min(fs, int((40000 if drive else 12000) / T) / 1.)
    tl = np.arange(.1, T - .1, 1 / fs); tl = tl + r.normal(0, .03 / fs, len(tl)) * (r.random() < .5)
    if r.random() < .4: tl = tl[r.random(len(tl)) > .01]
    clk = float(r.uniform(-1e-3, 1e-3)) * ns; I = lambda y, x: np.stack([np.interp(x, t, y[:, j]) for j in range(n)], 1)
    hold = int(r.choice([1, 1, 2, 4])) if fs >= 200 else 1; ti = tl[(np.arange(len(tl)) // hold) * hold]
    nz = r.uniform(.002, .006) * ts * (4 if drive else 1) + .003; Y = I(S, ti) + r.normal(size=(-(-len(tl) // hold), n))[np.arange(len(tl)) // hold] * nz
    enc = float(np.exp(r.uniform(np.log(2e-6), np.log(1e-3 * ns ** .7 if drive or "coarse" in op else 2e-4)))) ; Q = np.round(I(ql, tl + clk) / enc) * enc
    rows = {"t": np.round(tl, 6)}; rows.update({f"q{j+1}": Q[:, j] for j in range(n)})
    if r.random() < .6:
        dq = lowpass(I(np.gradient(ql, DT, axis=0), tl), 1 / fs, float(r.uniform(.002, .01))) + r.uniform(-2e-4, 2e-4, n) + r.normal(size=Q.shape) * float(r.uniform(5e-5, 5e-4)); rows.update({f"dq{j+1}": dq[:, j] for j in range(n)})
    rows.update({f"tau{j+1}": Y[:, j] for j in range(n)})
    if drive: rig.append("# a single axis: no robot, its inertia is unknown\n")
    else:
        files["robot.urdf"] = urdf(spec["arm"], spec["arm"])
        rig.append(f'[robot]\nmodel = "robot.urdf"\nsensor_frame = "ft_sensor"\ntip_frame = "tool_tip"\ngravity = [{grav[0]:.6g}, {grav[1]:.6g}, {grav[2]:.6g}]\n')
        if r.random() < .3: rows["phase"] = np.full(len(tl), "free")
    te = Y - I(clean_dense, tl)
    priv = dict(arm=spec.get("arm"), Fc=Fc.tolist(), Fv=Fv.tolist(), vs=float(vs), cutoff=fc, hold=hold, encoder=enc, clock=clk, fs=fs, ts=ts.tolist(), bias_scale=ns, boost=bo)
    if act("gravity-error"): priv["gravity_true"] = gt.tolist()
    if act("joint-torque-gain"): priv["gain"] = gn.tolist()
    if drive: priv["inertia"] = Jd
    return dict(rows=rows, rig="\n".join(rig), files=files, values=V, true_error=float(np.sqrt((te ** 2).mean())), private=priv,
                fit=dict(t=tl, q=Q, Y=Y, sd=nz, arm=None if drive else spec["arm"], grav=grav, forces=n, contact=np.ones(len(tl), bool)))


def base_fit_joint(model, F):
    t, q, Y = F["t"], F["q"], F["Y"]; n = q.shape[1]; q0 = smooth_rate(t, q, .1, 0); v = smooth_rate(t, q, .1, 1); a = smooth_rate(t, q, .14, 2)
    if F["arm"]: Y = Y - rnea(pin.buildModelFromXML(urdf(F["arm"], "x")), q0, v, a, F["grav"])
    out = np.empty_like(Y); one = np.ones(len(q), bool)
    for j in range(n):
        c = [] if F["arm"] else [a[:, j]]
        if "joint-coulomb-friction" in model: c.append(-bristle(np.stack([np.diff(q0[:, j], prepend=q0[0, j]), np.zeros(len(q))], 1), one, 2e-3)[:, 0])
        if "joint-viscous-friction" in model: c.append(v[:, j])
        out[:, j] = Y[:, j] - (np.stack(c, 1) @ np.linalg.lstsq(np.stack(c, 1), Y[:, j], rcond=None)[0] if c else 0)
    return out
