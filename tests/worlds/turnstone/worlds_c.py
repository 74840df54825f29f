"""Arms in contact (C) and arms in the air with a tool at a sensor (F)."""
import math
import numpy as np
import arms
import contact as ct
import scene
from io_ import write_case

U = None
_arms = {}


def get_arm(name):
    return arms.Arm(name)


NORMAL_NEEDS = {
 "viscous-damping": {"pokes", "speeds", "chirp"}, "hunt-crossley-damping": {"pokes", "speeds", "chirp", "depths"}, "relaxation": {"hold", "pokes", "speeds"},
 "hysteresis": {"pokes", "hold", "speeds", "depths"}, "stress-softening": {"pokes", "deeper"}, "adhesion": {"pokes", "air"}, "stiffening-layer": {"pokes", "depths"},
 "surface-offset": {"pokes", "depths", "air"}, "stiffness-drift": {"pokes", "long"}, "stiffness-inhomogeneity": {"place", "slides"}, "hertz-exponent": {"pokes", "depths"},
 "viscous-friction": {"slides", "sspeeds", "depths"}, "stribeck-friction": {"slides", "sspeeds"}, "presliding": {"slides", "micro"}, "friction-rounding": {"slides", "sspeeds"},
 "load-dependent-friction": {"slides", "depths", "force"}, "friction-anisotropy": {"slides", "dirs", "loops"}, "coulomb-friction": {"slides"},
 "structural-compliance": {"pokes", "depths"}, "tip-offset": {"tilt", "slides"}, "tool-mass": {"airtilt", "pokes"}, "tool-com": {"airtilt", "pokes"},
 "sensor-bias": {"air", "pokes"}, "sensor-drift": {"air", "pokes", "long"}, "sensor-misalignment": {"airtilt", "slides", "tilt"}, "sensor-crosstalk": {"slides", "loops", "tilt"},
 "sensor-lag": {"chirp", "pokes"}, "time-offset": {"chirp", "pokes"}, "saturation": {"pokes", "depths", "hold"}, "mains-hum": {"pokes", "hold"}}
SLIDY = {"viscous-friction", "stribeck-friction", "presliding", "friction-rounding", "load-dependent-friction", "friction-anisotropy", "coulomb-friction"}


def base_for(rng, hidden):
    H = set(hidden)
    if "viscous-damping" in H:
        return rng.choice(["hooke", "hertz"])
    if "structural-compliance" in H:
        return "hertz"
    if "hertz-exponent" in H:
        return rng.choice(["hooke", "kelvin-voigt"])
    if H & {"stiffening-layer", "stress-softening", "adhesion"}:
        return rng.choice(["hooke", "kelvin-voigt"])
    if H & {"relaxation"}:
        return rng.choice(["hooke", "kelvin-voigt", "hertz"])
    if "hunt-crossley-damping" in H:
        return rng.choice(["hooke", "hertz"])
    return rng.choice(["hooke", "kelvin-voigt", "hertz", "hunt-crossley", "kelvin-voigt", "zener"] if not H & {"relaxation", "hysteresis", "sensor-lag", "time-offset", "stiffness-drift"} else ["hooke", "kelvin-voigt", "hertz"])


def make_c(seed, folder, hidden, group, outside=None, silent=None, gain=1.0, base=None):
    rng = np.random.default_rng(seed)
    U = rng.uniform
    hid = list(hidden)
    name = rng.choice(["lwr", "ur5", "ur10", "panda", "own"], p=[.3, .2, .1, .2, .2])
    arm = get_arm(name)
    base = base or str(base_for(rng, hid + ([silent] if silent else [])))
    dm = U(.0015, .006)
    Fm = U(5, 20)                                   # force at the deepest
    wide = rng.random() < .2
    kw = dict(mu=U(.25, .7), len=10 ** (U(-4.3, -3.8) if wide else U(-4.04, -3.96)), aK=float(rng.choice([0, 0, .1, .25, 1.0 if wide else .15])))
    n = {"hertz": 1.5, "hunt-crossley": U(1.2, 1.65)}.get(base, 1.0)
    values, h, notes = {}, {}, []
    needs = {"pokes", "slides"} if rng.random() < .75 else {"pokes", "slides", "loops"}
    if rng.random() < .3:
        needs |= {"hold"}
    if "coulomb-friction" in hid:
        model = [base]
    else:
        model = [base, "coulomb-friction"]
    if group == "quiet" and rng.random() < .5:
        model += [] if base in ("zener",) else [["stiffness-drift"], ["viscous-friction"], ["relaxation"], ["surface-offset"], []][int(rng.integers(0, 5))]
    eff = hid + ([silent] if silent else []) + [m for m in model if m not in (base, "coulomb-friction")]
    for e in eff:
        needs |= NORMAL_NEEDS[e]
    if not (set(eff) & (SLIDY | {"stiffness-inhomogeneity", "tip-offset", "sensor-crosstalk", "sensor-misalignment"})) and group != "outside" and rng.random() < .5:
        needs -= {"slides"}; needs |= {"pokes"}
    T = U(14, 40)
    if "long" in needs:
        T = U(40, 75)
    if "hertz-exponent" in eff:
        n = U(1.3, 1.8)
    K = Fm / dm ** n
    dmx = dm * 1.3
    g, kk = ct.foundation(K, n, dmx, "rounded" if rng.random() < .5 else "exact")
    if base == "kelvin-voigt":
        kw["c"] = U(.02, .12) * Fm / (dm / .5)
        values["kelvin-voigt.stiffness"] = K; values["kelvin-voigt.damping"] = kw["c"]
    elif base == "hunt-crossley":
        kw["lam"] = U(.05, .25) / (dm / .5)
        values["hunt-crossley.stiffness"] = K; values["hunt-crossley.exponent"] = n
    elif base == "zener":
        kw["rho1"], kw["tau1"] = U(.2, .6), 10 ** U(-.5, .5)
        values["zener.stiffness"] = K; values["zener.branch-ratio"] = kw["rho1"]; values["zener.time-constant"] = kw["tau1"]
    else:
        values[base + ".stiffness"] = K
    if "hertz-exponent" in eff:
        values = {"hertz-exponent.exponent": n}
    values["coulomb-friction.coefficient"] = kw["mu"]
    mass = U(.12, .5); com = np.array(arm.tip_s) * U(.3, .6) + rng.normal(0, .003, 3)
    rig_mass, rig_com = mass * (1 + U(-.02, .02)), com + rng.normal(0, .0007, 3)
    d_tip = np.zeros(3)
    inh = np.zeros((0, 5))
    v0 = dm / .5
    for e in eff:
        s = gain if e in hid else .7
        if e == "viscous-damping": kw["c"] = U(.12, .3) * s * Fm / v0; values[e + ".damping"] = kw["c"]
        elif e == "hunt-crossley-damping": kw["lam"] = U(.15, .4) * s / v0; values[e + ".damping"] = kw["lam"]
        elif e == "relaxation":
            kw.update(rho1=U(.25, .5) * s, tau1=10 ** U(-.7, -.1), rho2=U(.2, .45) * s, tau2=10 ** U(.25, .8))
            notes.append(f"Prony {kw['rho1']:.2f}/{kw['tau1']:.2f}s {kw['rho2']:.2f}/{kw['tau2']:.2f}s in every spring")
        elif e == "hysteresis": kw.update(hys_r=U(.1, .25) * s, hys_a=U(0, .03) * Fm, hys_l=U(.06, .2) * dm); values[e + ".length"] = kw["hys_l"]
        elif e == "stress-softening": kw.update(mul_r=min(.8, U(.25, .5) * s), mul_l=U(.15, .35) * dm); values[e + ".ratio"] = kw["mul_r"]; values[e + ".length"] = kw["mul_l"]
        elif e == "adhesion": kw.update(adh_F=U(.15, .3) * Fm * s, adh_s=U(.3, .9), adh_l=U(.3, .9) * 1e-3, adh_r=U(.15, .4) * dm, adh_p=U(.7, 1.6)); values[e + ".force"] = kw["adh_F"]
        elif e == "stiffening-layer":
            kw.update(lay_K=U(1., 3.) * s * K * n * dm ** (n - 1), lay_d=(1.6 if e == silent else U(.4, .65)) * dm)
            if n <= 1: values[e + ".stiffness"] = kw["lay_K"]; values[e + ".depth"] = kw["lay_d"]
        elif e == "surface-offset": kw["z0"] = rng.choice([-1, 1]) * U(.12, .3) * dm * s; values[e + ".offset"] = kw["z0"]
        elif e == "stiffness-drift": kw["drift"] = rng.choice([-.35, .6]) * U(.6, 1) * s if e != silent else U(-.02, .02); values[e + ".rate"] = kw["drift"]
        elif e == "stiffness-inhomogeneity":
            c = int(rng.integers(0, 3))
            a = U(.35, .8) * s
            if c == 0: kw.update(g1=rng.choice([-1, 1]) * U(15, 28) * min(s, 1.2), g2=U(-10, 10)); values[e + ".gradient1"] = kw["g1"]; values[e + ".gradient2"] = kw["g2"]
            elif c == 1: inh = np.array([[1, U(-.006, .006), 0, U(.001, .004), a]])
            else: inh = np.array([[2, U(-.008, .008), U(-.004, .004), U(.004, .008), a]])
            notes.append("gradient edge inclusion".split()[c])
        elif e == "viscous-friction": kw["visc"] = U(.3, .7) * s * kw["mu"] * Fm * .7 / .04; values[e + ".damping"] = kw["visc"]
        elif e == "stribeck-friction": kw.update(dmu=U(.2, .45) * s, vs=U(.003, .012)); values[e + ".coefficient"] = kw["dmu"]; values[e + ".speed"] = kw["vs"]
        elif e == "presliding": kw.update(len=U(.7, 2.0) * 1e-3 * s, aK=0.0); notes.append(f"Dahl length {kw['len']*1e3:.2f} mm")
        elif e == "friction-rounding": kw["vr"] = U(.004, .015) * s; values[e + ".speed"] = kw["vr"]
        elif e == "load-dependent-friction": kw["p"] = -U(.2, .38) * min(s, 1.3); kw["mu"] *= 1.6; values["coulomb-friction.coefficient"] = kw["mu"]; values[e + ".exponent"] = kw["p"]
        elif e == "friction-anisotropy": kw["a"] = rng.choice([-1, 1]) * U(.18, .4) * min(s, 1.5); values[e + ".ratio"] = kw["a"]
        elif e == "structural-compliance": kw["C"] = U(.35, .8) * s * dm / Fm; values[e + ".compliance"] = kw["C"]
        elif e == "tip-offset":
            d_tip = rng.normal(0, 1, 3); d_tip -= arm.tip_s * (d_tip @ arm.tip_s) / (arm.tip_s @ arm.tip_s); d_tip *= U(.004, .009) * s / np.linalg.norm(d_tip)
            notes.append(f"tip offset in sensor axes {np.round(d_tip, 5).tolist()}")
        elif e == "tool-mass": rig_mass = mass; mass = mass + U(.12, .35) * s; values[e + ".mass"] = mass - rig_mass
        elif e == "tool-com":
            mass = rig_mass = U(.7, 1.2); d = rng.normal(0, 1, 3); d *= U(.015, .04) * s / np.linalg.norm(d); rig_com = com - d
            notes.append(f"com offset {np.round(d, 4).tolist()}")
        elif e == "sensor-bias": h["bias"] = np.r_[rng.normal(0, .6, 3), rng.normal(0, .02, 3)] * s; h["bias"][:3] += .3 * s * np.sign(h["bias"][:3])
        elif e == "sensor-drift": h["drift"] = np.r_[rng.choice([-1, 1], 3) * rng.uniform(.6, 2.0, 3), rng.normal(0, .03, 3)] * s
        elif e == "sensor-misalignment": d = rng.normal(0, 1, 3); h["mis"] = d / np.linalg.norm(d) * U(.1, .2) * s; notes.append(f"rotation {np.round(h['mis'], 4).tolist()}")
        elif e == "sensor-crosstalk":
            X = np.zeros((6, 6))
            ii = [(i, j) for i in range(3) for j in range(3) if i != j]
            for k_ in rng.permutation(6)[:int(rng.integers(2, 5))]: X[ii[k_]] = rng.choice([-1, 1]) * U(.08, .2) * s
            h["xtalk"] = X; notes.append("cross-talk " + str({f"{i}{j}": round(X[i, j], 3) for i, j in ii if X[i, j]}))
        elif e == "sensor-lag": h["lag"] = U(.03, .11) * s; values[e + ".time-constant"] = h["lag"]
        elif e == "time-offset": h["delay"] = rng.choice([-1, 1]) * U(.02, .07) * s; values[e + ".delay"] = h["delay"]
        elif e == "saturation": h["satshare"] = U(.45, .7) / min(s, 1.4)
        elif e == "mains-hum": h["hum"] = (float(rng.choice([50, 60])), [U(.15, .5) * s, U(0, .04)], rng.uniform(-3, 3, 2))
    if silent in ("friction-anisotropy",): needs = {"slides", "onedir", "pokes"}
    if silent == "stribeck-friction": needs = {"slides", "samespeed"}; kw["vs"] = .06
    if silent == "load-dependent-friction": needs = {"force", "constload", "onedir"}
    if silent == "stiffness-inhomogeneity": needs = {"pokes", "depths", "oneplace"}
    if silent == "stiffness-drift": T = U(8, 14); needs = {"pokes"}
    if silent == "stiffening-layer": needs = {"pokes", "depths", "slides"}
    if outside:
        for k_, v in outside(rng, dm, Fm, gain).items():
            if k_ == "needs": needs |= v
            elif k_ == "note": notes.append(v)
            else: kw[k_] = v
    kw["K"], kw["n"] = K, n
    P = ct.params(**kw)
    # surface and path
    soft = "force" in needs
    X, fm, fd, ph = scene.program(rng, dm, needs, T, Fm * .55)
    for tries in range(12):
        tilt = U(0, 1)
        nrm = np.array([0, 0, 1.0]) if tilt < .5 else (scene.rotvec(rng.normal(0, .25, 3)) @ np.array([0, 0, 1.0]))
        pl = scene.place(arm, rng, X, nrm)
        if pl is not None:
            break
        if tries > 6:
            X[:, 3:] *= .6
    if pl is None:
        raise RuntimeError("no reach")
    pt, t1, t2, Qd, B = pl
    gt = np.array([0, 0, -9.81])
    level = scene.rotvec(np.r_[rng.normal(0, .04, 2), 0]) if rng.random() < .4 else np.eye(3)
    g_true = level @ gt
    g_rig = scene.rotvec(rng.normal(0, .0015, 3)) @ g_true if rng.random() < .6 else g_true
    arm.add_tool(mass, com)
    ctl = scene.controller(arm, rng)
    Fr = scene.zero_friction(arm.n); Fr[:, 0] = rng.uniform(.3, 2.0, arm.n) * (.3 if arm.n > 5 else 1); Fr[:, 3] = .5; Fr[:, 7] = 3e-4
    tp_true = arm.tp + arm.sR @ d_tip
    r = scene.run_arm(arm, Qd, B, fm, fd, ctl, g_true, Fr, P, (g, kk), inh, (pt, nrm, t1, t2), tp_true)
    if not np.isfinite(r["q"]).all():
        raise RuntimeError("unstable")
    fcw = r["fc"][:, :1] * nrm + r["fc"][:, 1:2] * t1 + r["fc"][:, 2:3] * t2
    w, _ = scene.wrench(arm, r["q"], fcw, g_true, mass, com, np.zeros((3, 3)), arm.tip_s + d_tip)
    rate = float(rng.choice([100, 125, 200, 250, 500, 1000])) if "hum" not in h else float(rng.choice([500, 1000]))
    chain = dict(fc=U(60, 300) if "hum" not in h else 300, nl=U(0, .006) if rng.random() < .5 else 0)
    noise = np.r_[np.full(3, 10 ** U(-2.1, -1.35)) * np.array([1, 1, 1.6]), np.full(3, 10 ** U(-3.6, -2.9))]
    Tt = len(w) * scene.DT
    tw = np.arange(len(w)) * scene.DT
    if "satshare" in h:
        j = int(np.argmax(np.percentile(np.abs(w[:, :3]), 99, axis=0)))
        h["sat"] = (j, float(h["satshare"] * np.abs(w[:, j]).max())); values["saturation.limit"] = h["sat"][1]
    if "hum" in h:
        h["humdir"] = np.r_[rng.uniform(.3, 1, 3), 0, 0, 0]
    w = scene.sense(w, rng, h, noise, chain, tw)
    if rng.random() < .4 and "drift" not in h:      # slow temperature drift, small
        w = w + np.outer(tw / 60, np.r_[rng.normal(0, .02, 3), rng.normal(0, 3e-4, 3)])
    t = scene.stamps(rng, Tt - .15, rate, rng.choice([0, .05, .15]), rng.choice([0, .002, .01]))
    clock = rng.normal(0, .0007)
    ya = scene.at(t, w, shift=h.get("delay", 0.0) + clock)
    Y = scene.finish(ya, rng, h, noise)
    q = scene.at(t, r["q"])
    enc = 10 ** U(math.log10(2e-6), math.log10(3e-5 if Fm / dm < 2500 else 1e-5))
    q = np.round(q / enc) * enc
    lg = {"t": t}
    for j in range(arm.n): lg[f"q{j+1}"] = q[:, j]
    hasdq = rng.random() < .7
    if hasdq:
        dqm = scene.lowpass(r["dq"], U(15, 60))
        dqm = scene.at(t, dqm) + rng.normal(0, 10 ** U(-5, math.log10(5e-4)), (len(t), arm.n)) + rng.uniform(-2e-4, 2e-4, arm.n) * (rng.random() < .5)
        for j in range(arm.n): lg[f"dq{j+1}"] = dqm[:, j]
    if rng.random() < .35:
        ta = scene.at(t, scene.lowpass(r["tau"], U(5, 50))) + rng.normal(0, .05, (len(t), arm.n))
        for j in range(arm.n): lg[f"tau{j+1}"] = ta[:, j]
    for j, c in enumerate(("fx", "fy", "fz", "tx", "ty", "tz")): lg[c] = Y[:, j]
    if rng.random() < .5:
        lg["phase"] = ph[np.minimum((t / scene.DT).astype(int), len(ph) - 1)]
    # stated rig
    nr = scene.rotvec(rng.normal(0, .0003, 3)) @ nrm
    t1r = t1 - nr * (t1 @ nr); t1r /= np.linalg.norm(t1r)
    ptr = pt + nrm * rng.normal(0, 8e-6) + t1 * rng.normal(0, 2e-4)
    rig = {"robot": {"model": arm.rigmodel, "sensor_frame": arm.sensor, "tip_frame": arm.tip, "gravity": g_rig.tolist(), "joints": arm.joints},
           "tool": {"mass": rig_mass, "com": rig_com.tolist()},
           "surface": {"point": ptr.tolist(), "normal": nr.tolist(), "tangent": t1r.tolist()},
           "sensor": {"noise": noise.tolist()}}
    if rng.random() < .5 and "sat" not in h:
        rig["sensor"]["range"] = [40, 40, 120, 2, 2, 2] if Fm < 12 else [80, 80, 240, 4, 4, 4]
    write_case(folder, lg, rig, arm)
    notes.append(f"{name} K_joint {ctl['s']:.0f} N·m/rad, {base}, depth to {dm*1e3:.1f} mm, {Fm:.1f} N, {rate:.0f} Hz, {Tt:.0f} s, bristle {kw['len']*1e3:.3f} mm, Prandtl share {kw['aK']:.2f}, encoder {enc*1e6:.0f} µrad")
    tm = model + hid
    keep = {k_: float(v) for k_, v in values.items() if k_.split(".")[0] in tm}
    if outside: keep = {}
    return dict(kind="C", model=model, hidden=hid if not silent else [silent], true=tm, values=keep, noise=float(np.sqrt(np.mean(np.r_[noise[:3], noise[3:] / max(.08, np.linalg.norm(arm.tip_s))] ** 2))), notes=notes, arm=name,
                rms=float(np.sqrt(np.mean(Y[:, :3] ** 2))))


def make_f(seed, folder, hidden, group, outside=None, silent=None, gain=1.0):
    rng = np.random.default_rng(seed)
    U = rng.uniform
    name = str(rng.choice(["lwr", "ur5", "ur10", "panda", "own"], p=[.3, .2, .1, .2, .2]))
    arm = get_arm(name)
    n = arm.n
    T = U(15, 50)
    e = (hidden + [silent])[0] if hidden or silent else None
    static = silent is not None
    fast = e in ("tool-inertia", "sensor-lag", "time-offset") and not silent
    q0 = np.array(SEED(name)) + rng.normal(0, .2, n)
    t = np.arange(0, T, scene.DT)
    amp = np.r_[np.full(n - 3, .25), [.9, .8, 1.2]][-n:]
    Qd = np.tile(q0, (len(t), 1))
    if static:        # many poses, each held
        z = q0.copy(); i = 0; Qd[:] = q0
        while i < len(t):
            T1 = int(U(2.5, 4) / scene.DT); T2 = int(U(.8, 1.5) / scene.DT)
            s = np.arange(1, T1 + 1) / T1; wv = s ** 3 * (10 - 15 * s + 6 * s * s)
            z2 = q0 + rng.uniform(-1, 1, n) * amp
            seg = np.vstack([z + wv[:, None] * (z2 - z), np.tile(z2, (T2, 1))])[:len(t) - i]
            Qd[i:i + len(seg)] = seg; i += len(seg); z = z2
    else:
        for j in range(n):
            for k_ in range(3):
                f = U(.05, .25) if not (fast and k_) else U(.4, 1.3)
                Qd[:, j] += amp[j] / (1 + 2.5 * k_ * (1 if fast else .6)) * U(.5, 1) * np.sin(2 * np.pi * f * t + U(-3, 3))
        env = np.minimum(1, t / 2)[:, None]
        Qd = q0 + (Qd - q0) * env ** 2 * (3 - 2 * env)
    mass = U(.5, 1.8); com = arm.tip_s * U(.3, .7) + rng.normal(0, .008, 3)
    r_ = U(.03, .06)
    I = np.diag(mass * r_ ** 2 * np.array([1, 1.1, .7])) * .6
    rm, rc, rI = mass * (1 + U(-.004, .004)), com + rng.normal(0, .0003, 3), I * 1.0
    h, values, notes = {}, {}, []
    s = gain
    if e == "tool-mass": rm = mass; mass += rng.choice([-.3, 1]) * U(.15, .4) * s; values[e + ".mass"] = mass - rm
    if e == "tool-com": d = rng.normal(0, 1, 3); d *= U(.01, .025) * s / np.linalg.norm(d); rc = com - d
    if e == "tool-inertia":
        I = I * (1 + 6 * s) if not silent else I * 1.5
        rI = np.diag([1e-4] * 3) if not silent else rI
    if e == "sensor-bias": h["bias"] = np.r_[rng.normal(0, .8, 3), rng.normal(0, .05, 3)] * s
    if e == "sensor-drift": h["drift"] = np.r_[rng.choice([-1, 1], 3) * rng.uniform(.5, 2, 3), rng.normal(0, .06, 3)] * s
    if e == "sensor-misalignment": d = rng.normal(0, 1, 3); h["mis"] = d / np.linalg.norm(d) * U(.06, .18) * s
    if e == "sensor-crosstalk":
        Xm = np.zeros((6, 6))
        for i, j in [(0, 1), (2, 0), (1, 2), (4, 0)][:int(rng.integers(2, 5))]: Xm[i, j] = rng.choice([-1, 1]) * U(.08, .2) * s * (.05 if i > 2 else 1)
        h["xtalk"] = Xm
    if e == "sensor-lag": h["lag"] = U(.04, .15) * s if not silent else .004; values[e + ".time-constant"] = h["lag"]
    if e == "time-offset": h["delay"] = rng.choice([-1, 1]) * U(.03, .1) * s if not silent else .002; values[e + ".delay"] = h["delay"]
    gt = np.array([0, 0, -9.81]) if rng.random() < .6 else scene.rotvec(np.r_[rng.normal(0, .05, 2), 0]) @ np.array([0, 0, -9.81])
    if rng.random() < .2: gt = np.array([0, 9.81, 0.])       # hangs from a wall
    g_rig = scene.rotvec(rng.normal(0, .0008, 3)) @ gt
    arm.add_tool(mass, com, I)
    ctl = scene.controller(arm, rng)
    Fr = scene.zero_friction(n); Fr[:, 0] = rng.uniform(.3, 1.5, n); Fr[:, 7] = 5e-4
    r = scene.run_arm(arm, Qd, np.zeros_like(Qd), np.zeros(len(t)), np.zeros(len(t)), ctl, gt, Fr)
    fcw = np.zeros((len(t), 3)); q = r["q"]
    w, Rs = scene.wrench(arm, q, fcw, gt, mass, com, I, arm.tip_s)
    if outside:
        w = w + outside(rng, arm, q, Rs, gt, mass, gain, notes)
    noise = np.r_[np.full(3, 10 ** U(-1.9, -1.3)), np.full(3, 10 ** U(-3.4, -2.8))]
    rate = float(rng.choice([100, 125, 250, 500, 1000]))
    w = scene.sense(w, rng, h, noise, dict(fc=U(60, 300), nl=U(0, .004)), t)
    ts = scene.stamps(rng, T - .15, rate, rng.choice([0, .05, .15]), rng.choice([0, .002, .01]))
    Y = scene.finish(scene.at(ts, w, shift=h.get("delay", 0) + rng.normal(0, .0005)), rng, h, noise)
    enc = 10 ** U(math.log10(2e-6), -3.3)
    qm = np.round(scene.at(ts, q) / enc) * enc
    lg = {"t": ts}
    for j in range(n): lg[f"q{j+1}"] = qm[:, j]
    if rng.random() < .7:
        dqm = scene.at(ts, scene.lowpass(r["dq"], U(15, 60))) + rng.normal(0, 10 ** U(-5, math.log10(5e-4)), (len(ts), n)) + rng.uniform(-2e-4, 2e-4, n)
        for j in range(n): lg[f"dq{j+1}"] = dqm[:, j]
    for j, c in enumerate(("fx", "fy", "fz", "tx", "ty", "tz")): lg[c] = Y[:, j]
    if rng.random() < .4: lg["phase"] = np.full(len(ts), "free")
    rig = {"robot": {"model": arm.rigmodel, "sensor_frame": arm.sensor, "tip_frame": arm.tip, "gravity": g_rig.tolist(), "joints": arm.joints},
           "tool": {"mass": rm, "com": rc.tolist(), "inertia": [rI[0, 0], rI[1, 1], rI[2, 2], 0.0, 0.0, 0.0]}, "sensor": {"noise": noise.tolist()}}
    write_case(folder, lg, rig, arm)
    notes.append(f"{name}, tool {mass:.2f} kg, {rate:.0f} Hz, {T:.0f} s, encoder {enc*1e6:.0f} µrad")
    return dict(kind="F", model=["none"], hidden=hidden if not silent else [silent], true=["none"] + hidden, values=values if not silent else {}, arm=name, notes=notes,
                noise=float(np.sqrt(np.mean(np.r_[noise[:3], noise[3:] / max(.08, np.linalg.norm(arm.tip_s))] ** 2))), rms=float(np.sqrt(np.mean(Y[:, :3] ** 2))))


def SEED(name):
    return np.array(scene.SEEDQ[name], float)
