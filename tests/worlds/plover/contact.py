"""Contact logs: draws a rig, a material, nuisances and hidden effects; runs the engine; makes the log."""
import zlib
import numpy as np
from scipy.signal import savgol_filter
import engine as en
from engine import bed, params, run, lowpass, Prog
from robots import Arm, ARMS, urdf, exps, rotz

DT = 5e-4
WORDS = [dict(free="free", approach="approach", poke="poke", hold="hold", slide="slide", retract="retract"), None,
         dict(free="Luft", approach="zustellen", poke="stich", hold="warten", slide="wischen", retract="weg"),
         dict(free="air", approach="down", poke="press", hold="press", slide="rub", retract="up")]


def erng(spec, name): return np.random.default_rng([spec["seed"], zlib.crc32(name.encode())])


def contact_case(spec, on):
    r = np.random.default_rng([spec["seed"], 1]); ns, bo = spec["ns"], spec["boost"]; pf, law, op = spec["platform"], spec["law"], spec["opts"]
    robot, tang = pf == "robot", "coulomb-friction" in spec["model"] or "coulomb-friction" in spec["eff"]
    rr = erng(spec, "rig"); U = lambda a, b, g=r: float(g.uniform(a, b)); LU = lambda a, b, g=r: float(np.exp(g.uniform(np.log(a), np.log(b))))
    ef = [e for e in spec["eff"]]; has = lambda e: e in ef; act = lambda e: e in on and e in ef
    er = {e: erng(spec, e) for e in ef}; V, priv = {}, {}
    # ---- material
    D = U(2.0e-3, 4.5e-3); Fm = U(8, 28); n = 1.0; vf = U(.03, .06)
    if law == "hertz": n = 1.5
    if law == "hunt-crossley": n = U(1.2, 1.7)
    if act("hertz-exponent"): n = 1.5 + (1 if er["hertz-exponent"].random() < .5 else -1) * min(.3 * bo, .45)
    k = Fm / D ** n; P = {}
    if law == "hooke": V["hooke.stiffness"] = k
    if law == "hertz" and n == 1.5: V["hertz.stiffness"] = k
    if law == "kelvin-voigt": P["TD"] = U(.08, .2) * D / vf; V["kelvin-voigt.stiffness"] = k; V["kelvin-voigt.damping"] = k * P["TD"]
    if law == "hunt-crossley": P["LAM"] = U(.15, .35) / vf; V.update({"hunt-crossley.stiffness": k, "hunt-crossley.exponent": n, "hunt-crossley.damping": k * P["LAM"]})
    if law == "zener": P["R1"], P["T1"] = U(.4, 1.2), LU(.2, 1.2); V.update({"zener.stiffness": k, "zener.branch-ratio": P["R1"], "zener.time-constant": P["T1"]})
    if law == "maxwell": P["KINF"], P["R1"], P["T1"] = 0, 1., LU(1.5, 6); V.update({"maxwell.stiffness": k, "maxwell.time-constant": P["T1"]})
    if law == "zener" or n > 1 and law != "hertz": pass
    else: P["NRM"] = U(-3, 5) * ns                                # 1/m: springs a little off straight
    mu = U(.2, .6); P["FT"] = int(r.integers(0, 3)); P["LS"] = 1e-4 * np.exp(U(-.6, .3) * ns); P["KT"] = mu * D / ((1e-4 if n == 1 else 1.5e-4) * np.exp(U(-.6, .3) * ns)); P["SIG1"] = U(0, .3) * ns
    if tang:
        if "coulomb-friction" not in ef or act("coulomb-friction"): P["MU"] = mu
        if "load-dependent-friction" not in ef: V["coulomb-friction.coefficient"] = mu
    if tang and has("presliding"): P["FT"] = 1
    Rb, kb, nb = P.get("R1", 0), Fm / D ** {"hertz": 1.5}.get(law, n), {"hertz": 1.5}.get(law, n)
    # ---- hidden effects in the contact
    g = er.get
    for e in ef:
        if not act(e): continue
        q = er[e]
        if e == "viscous-damping": P["TD"] = U(.12, .25, q) * bo * D / vf; V["viscous-damping.damping"] = k * P["TD"]
        if e == "hunt-crossley-damping": P["LAM"] = U(.15, .35, q) * bo / vf; V["hunt-crossley-damping.damping"] = P["LAM"]
        if e == "relaxation":
            P["R1"], P["T1"] = U(.25, .6, q) * bo, LU(.3, 2.5, q)
            if "slowtau" in op: P["T1"], P["R1"] = 2e4, .3
            V["relaxation.ratio"] = P["R1"]; V["relaxation.time-constant"] = P["T1"]
            if q.random() < .25 and "slowtau" not in op:
                P["R2"], P["T2"] = P["R1"] * .6, P["T1"] * 8; V.pop("relaxation.ratio"); V.pop("relaxation.time-constant")
        if e == "hysteresis":
            for j, l in enumerate((.04, .1, .25)): P[f"HY{j+1}"], P[f"HL{j+1}"] = U(.25, .6, q) * bo, l * D
        if e == "stress-softening": P["MR"], P["MM"] = min(U(.3, .5, q) * bo, .7), U(.1, .3, q) * D * D
        if e == "adhesion": P["ADH"] = U(.12, .3, q) * bo * D
        if e == "stiffening-layer":
            P["DB"], P["KL"] = U(.45, .65, q) * D, U(.6, 1.8, q) * bo
            if "deep" in op: P["DB"] = 1.6 * D
            V["stiffening-layer.stiffness"], V["stiffening-layer.depth"] = k * P["KL"], P["DB"]
        if e == "surface-offset": P["Z0"] = (1 if q.random() < .5 else -1) * U(3e-4, 8e-4, q) * bo; V["surface-offset.offset"] = P["Z0"]
        if e == "stiffness-drift": P["ALPHA"] = (1 if q.random() < .5 else -1) * U(.12, .3, q) * bo / (5 if pf == "tester" and "long" in op else 1); V["stiffness-drift.rate"] = P["ALPHA"]
        if e == "stiffness-inhomogeneity":
            kind = int(q.integers(0, 3))
            if kind == 0: P["G1"], P["G2"] = U(4, 9, q) * bo, U(-5, 5, q); V["stiffness-inhomogeneity.gradient1"], V["stiffness-inhomogeneity.gradient2"] = P["G1"], P["G2"]
            if kind == 1: P["INA"], P["INX"], P["INY"], P["INW"] = U(.4, .9, q) * bo, U(.01, .025, q), U(-.004, .01, q), U(.006, .012, q)
            if kind == 2: P["EDA"], P["EDX"], P["EDW"] = U(.3, .7, q) * bo, U(.012, .022, q), U(.002, .006, q)
        if e == "viscous-friction": P["CV"] = U(.15, .35, q) * bo * mu * Fm / .08; V["viscous-friction.damping"] = P["CV"]
        if e == "stribeck-friction": P["STD"], P["STV"] = U(.3, .6, q) * bo * mu, LU(.006, .015, q)
        if e == "presliding": P["LS"] = U(1e-3, 2.5e-3, q) * bo; V["presliding.length"] = P["LS"]
        if e == "friction-rounding": P["FT"], P["VR"] = 3, U(.015, .03, q) * bo
        if e == "load-dependent-friction": P["TAUR"] = mu * Fm / D; V["load-dependent-friction.exponent"] = -1 / 3
        if e == "friction-anisotropy": P["ANIS"] = (1 if q.random() < .6 else -1) * min(U(.15, .3, q) * bo, .45); V["friction-anisotropy.ratio"] = P["ANIS"]
        if e == "coulomb-friction": V["coulomb-friction.coefficient"] = mu
        if e == "x-runin": P["RUNA"], P["RUNL"] = U(.5, .9, q) * bo, U(.08, .25, q)
        if e == "x-ageing": P["AGEB"], P["AGET"], P["AGED"] = U(.12, .2, q) * bo, .01, U(5e-4, 1.5e-3, q)
        if e == "x-vibration": P["VIBA"], P["VIBF"] = U(.04, .08, q) * bo * D, U(1.3, 6, q)
        if e == "x-texture": P["TXA"], P["TXL"] = U(.06, .12, q) * bo * D, U(.003, .007, q)
        if e == "x-plastic": P["PLY"], P["PLR"] = U(.2, .35, q) * D, min(U(.35, .55, q) * bo, .8)
        if e == "x-foam": P["FOP"], P["FOS"], P["FOD"] = .3 * D, max(.25 / bo, .02), .75 * D
    # ---- programme
    po = np.random.default_rng([spec["seed"], 7]); Lr = U(.025, .045, po)
    K, M = (U(1.2e4, 3e4) if tang else U(4e3, 2.5e4), U(2.5, 5)) if robot else (U(6e4, 2e5), U(2, 4)); r2 = r.random(); dyn = robot or (pf == "tribo" and r2 < .6)
    Dm = 2 * U(1.0, 1.4) * np.sqrt(K * M); dep = lambda d: -(d + (kb * d ** nb * (1 + Rb * .5) / K if dyn else 0))
    air = .03 if robot else 2e-3
    p = Prog(DT if robot or "long" not in op else 5e-3, [0, 0, air, 0, 0, 0]); p.hold(.8, "free")
    fast = has("tool-inertia") or has("tool-com")
    if robot and "no_free" not in op:
        p.move(.8, "free", h=.09); A = U(.35, .6, po)
        tt = .6 if fast and "slow" not in op else U(1.2, 1.8, po)
        if "slow" in op: tt = 3.
        for a in ((A, 0, 0), (-A, .2, 0), (0, A, .4), (0, -A, -.4), (.3, .3, .8), (0, 0, -.6), (0, 0, 0)):
            p.move(tt, "free", rx=a[0], ry=a[1], rz=a[2])
            if po.random() < .6: p.hold(.4, "free")
        if fast and "slow" not in op:
            for j in range(6): p.move(.22, "free", rx=.25 * (-1) ** j, rz=.4 * (-1) ** j)
            for j in range(6): p.move(.22, "free", rx=0, ry=.25 * (-1) ** j)
            p.move(.6, "free", rx=0, ry=0, rz=0)
    p.move(1.0, "approach", h=2e-3, s1=0, s2=0)
    depths = [.4, .7, 1.0] if "one_depth" not in op else [.8, .8]
    speeds = [vf * .06, vf * .3, vf] if "one_speed" not in op else [vf * .4]
    places = [(0, 0)] if "one_place" in op else [(0, 0), (Lr * .55, .004), (Lr, -.003)] if has("stiffness-inhomogeneity") else [(0, 0), (Lr * .6, .006)]
    tilts = [(0, 0), (.2, 0), (-.15, .2), (0, -.2)] if has("tip-offset") or has("sensor-misalignment") else [(0, 0)]
    rounds = 2 if has("stiffness-drift") or has("stiffness-inhomogeneity") else 1
    if not tang or has("stiffness-drift"): rounds += 1
    if "long" in op: rounds = int(po.integers(5, 7))
    for ro in range(rounds):
        for i, (a, b) in enumerate(places):
            for tl in tilts if robot else tilts[:1]:
                p.move(.8, "approach", s1=a, s2=b, rx=tl[0], ry=tl[1])
                for d in (depths if ro % 2 == 0 else depths[::-1]):
                    v = speeds[int(po.integers(0, len(speeds)))] if len(tilts) > 1 else speeds[(i + depths.index(d) + ro) % len(speeds)]
                    p.line(v, "poke", ramp=.08, h=dep(d * D)); p.hold(U(.4, 1.2, po) * (5 if "long" in op else 1) if d < 1 or len(tilts) > 1 else U(1.5, 3, po) * (5 if "long" in op else 1))
                    p.line(v, "retract", ramp=.08, h=2e-3 if po.random() < .7 or d == depths[-1] else dep(.15 * D))
                    p.hold(.2 if "long" not in op else 4, "free")
    p.move(.6, "approach", s1=0, s2=0, rx=0, ry=0)
    if tang and pf != "tester":
        vs_ = [.004, .02, .08] if "one_speed" not in op else [.02, .02]
        for d in depths[::2] if "one_depth" not in op else depths:
            p.line(.01, "approach", ramp=.1, h=dep(d * D)); p.hold(.6)
            for v in vs_:
                L = Lr if v > .01 else min(Lr, .024)
                kk = 3 if has("presliding") or has("x-ageing") else 1
                for j in range(kk):
                    p.line(v, "slide", ramp=.05 + 2.5 * v, s1=L); p.hold(U(.1, 1.5, po) if j % 2 else .15); p.line(v, "slide", ramp=.05 + 2.5 * v, s1=0); p.hold(.15)
            if "one_dir" not in op:
                for v in vs_[1:]: p.line(v, "slide", ramp=.05 + 2.5 * v, s2=.02); p.line(v, "slide", ramp=.05 + 2.5 * v, s2=0)
            if po.random() < .6 and "one_dir" not in op and "one_speed" not in op: p.circle(.008, .03, 2, "slide"); p.hold(.4)
            if has("presliding"):
                for j in range(8): p.line(.01, "slide", s1=.004 * (j % 2), ramp=.06)
            p.line(.02, "retract", h=2e-3); p.hold(.3, "free")
    p.move(1.0, "retract", h=air); p.hold(1., "free")
    cmd, ph = p.done(); dt = p.dt; N = len(cmd)
    w, gh = bed(k, n, 1.35 * D + abs(P.get("Z0", 0)), spread=2e-5 * ns)
    X, Ac, F = run(np.ascontiguousarray(cmd[:, :3]), dt, 3 if dyn or robot else 2, dyn, M, K, Dm, w, gh, params(**P))
    Fc = F.copy()                                                  # force of the material on the tool, surface frame (s1, s2, normal)
    tg = np.arange(N) * dt
    # ---- acquisition
    q = r; T = tg[-1]; fs = float(q.choice([50, 100, 200, 250, 500] if T < 45 else [50, 100, 125, 200]))
    if robot is False and "long" not in op and T < 25 and q.random() < .3: fs = 1000.
    if has("mains-hum"): fs = 500.
    if has("time-offset") or has("sensor-lag") or fast or has("friction-rounding"): fs = max(fs, 200.)
    if "long" in op: fs = min(fs, 100.)
    if law not in ('hooke', 'hertz'): fs = max(fs, 100.)
    if fs * T > 24000: fs = float(int(24000 / T))
    t = np.arange(.1, T - .1, 1 / fs); t = t + q.normal(0, .03 / fs, len(t)) * (q.random() < .6)
    if q.random() < .4: t = t[q.random(len(t)) > .01]
    clk = U(-1e-3, 1e-3) * ns; tw = t.copy()
    if act("time-offset"): dl = U(.008, .02, er["time-offset"]) * bo; tw = t - dl; V["time-offset.delay"] = dl
    I = lambda y, x=t: np.stack([np.interp(x, tg, y[:, j]) for j in range(y.shape[1])], 1)
    tau = U(.01, .03, er["sensor-lag"]) * bo if act("sensor-lag") else None
    if tau and "slow" in op: tau = 3e-4
    if tau: V["sensor-lag.time-constant"] = tau
    nz = np.array([.015, .015, .03, 5e-4, 5e-4, 4e-4]) * U(.5, 1.6)
    rows = {"t": np.round(t, 6)}; files = {}; words = WORDS[int(q.integers(0, 4))]
    phase = ph[np.clip(np.searchsorted(tg, t), 0, N - 1)]
    nlin = U(-.01, .01) * ns / Fm; drift = U(-.015, .015, q) * ns; rig = []
    Cc = 0.0
    if act("structural-compliance"): Cc = U(.15, .3, er["structural-compliance"]) * bo * D / Fm; V["structural-compliance.compliance"] = Cc
    if robot:
        arm = spec["arm"]; mt, L = U(.15, .6, rr), U(.08, .18, rr); yaw = U(-1.5, 1.5, rr); sens = (0, 0, .03); tip = np.array([U(-.01, .01, rr), U(-.01, .01, rr), L])
        com = np.array([U(-.01, .01, rr), U(-.01, .01, rr), L * U(.3, .5, rr)]); q0 = np.array(ARMS[arm]["down"]) + rr.uniform(-.12, .12, len(ARMS[arm]["down"])); q0[0] = U(-.6, .6, rr)
        if has("tool-mass") or has("sensor-gain") or has("tool-com"): mt = U(.7, 1.3, rr)
        name = f"{arm}_tool"; files["robot.urdf"] = urdf(arm, name, sens, float(round(yaw, 4)), tuple(np.round(tip, 5))); tip = np.round(tip, 5); yaw = round(yaw, 4)
        Ar = Arm(arm, sens, yaw, tip); Ra, pa = Ar.fk(q0[None]); Ra, pa = Ra[0], pa[0]
        nrm = np.array([0, 0, 1.])
        if rr.random() < .45: nrm = exps(np.array([[U(-.6, .6, rr), U(-.6, .6, rr), 0]]))[0] @ nrm
        a = U(-np.pi, np.pi, rr); e0 = np.cross(nrm, [np.cos(a), np.sin(a), .3]); e1 = e0 / np.linalg.norm(e0); e2 = np.cross(nrm, e1)
        B = np.stack([e1, e2, nrm], 1); x0 = Ra[:, 0] - nrm * (Ra[:, 0] @ nrm); x0 /= np.linalg.norm(x0); R0 = np.stack([x0, np.cross(-nrm, x0), -nrm], 1)
        grav = np.array([0, 0, -9.81])
        if spec["arm"] != "lwr4plus" and rr.random() < .4 or rr.random() < .12: grav = np.array([-9.81, 0, 0]) if rr.random() < .6 else np.array([0, 0, 9.81])
        gt = exps(np.array([[U(-.005, .005), U(-.005, .005), U(-.005, .005)]]) * ns)[0] @ grav
        Rg = R0 @ exps(cmd[:, 3:]); om = np.gradient(cmd[:, 3:], dt, axis=0)   # small-angle body rates serve only to size the sample; exact below
        dR = np.swapaxes(Rg[:-1], 1, 2) @ Rg[1:]
        om[:-1] = np.stack([dR[:, 2, 1] - dR[:, 1, 2], dR[:, 0, 2] - dR[:, 2, 0], dR[:, 1, 0] - dR[:, 0, 1]], 1) / 2 / dt; al = np.gradient(om, dt, axis=0)
        m_t, c_t = mt * (1 + U(-.02, .02) * ns), com + q.uniform(-.01, .01, 3) * np.linalg.norm(com) * ns * .5
        It = np.diag([U(1e-4, 4e-4, rr)] * 2 + [U(5e-5, 2e-4, rr)]) * (.02 if not has("tool-inertia") else 0)
        if act("tool-inertia"): It = np.diag(er["tool-inertia"].uniform(1.5e-3, 4e-3, 3)) * bo; V.update({f"tool-inertia.inertia[{x}{x}]": float(It[i, i]) for i, x in enumerate("xyz")})
        if act("tool-mass"): dm = (U(.05, .15, er["tool-mass"]) * bo) * (1 if er["tool-mass"].random() < .6 else -1); m_t = mt + dm; V["tool-mass.mass"] = dm
        if act("tool-com"):
            dc = er["tool-com"].uniform(-.012, .012, 3) * bo; c_t = com + dc; V.update({f"tool-com.com[{x}]": float(dc[i]) for i, x in enumerate("xyz")})
        o = np.zeros(3)
        if act("tip-offset"):
            o = np.array([1, 1, .15]) * er["tip-offset"].choice([-1, 1], 3) * er["tip-offset"].uniform(1e-3, 3e-3, 3) * bo; V.update({f"tip-offset.offset[{x}]": float(o[i]) for i, x in enumerate("xyz")})
        rt = tip + o                                               # true tip in the sensor frame
        rc = c_t - rt; ab = np.einsum("nji,nj->ni", Rg, Ac @ B.T)   # tip acceleration, sensor axes
        ac = ab + np.cross(al, rc) + np.cross(om, np.cross(om, rc)); fc = np.einsum("nji,nj->ni", Rg, Fc @ B.T)
        ft = m_t * (np.einsum("nji,j->ni", Rg, gt) - ac); gyro = al @ It.T + np.cross(om, om @ It.T)
        pc = q.uniform(-2e-4, 2e-4, 3) * ns
        W = np.concatenate([ft + fc, np.cross(c_t, ft) - gyro + np.cross(rt + pc, fc)], 1)
        clean = I(W); S = W.copy(); G = np.eye(6)
        S[:, :3] *= 1 + nlin * S[:, :3]
        if act("sensor-gain"): gn = (1 if er["sensor-gain"].random() < .5 else -1) * U(.06, .15, er["sensor-gain"]) * bo; S *= 1 + gn; V["sensor-gain.gain"] = gn
        if act("sensor-misalignment"):
            rv = er["sensor-misalignment"].uniform(-.06, .06, 3) * bo; Rm = exps(rv[None])[0]; S = np.concatenate([S[:, :3] @ Rm.T, S[:, 3:] @ Rm.T], 1); priv["misalignment"] = rv.tolist()
        if act("sensor-crosstalk"):
            C = np.zeros((6, 6))
            for i, j in ((0, 2), (1, 2), (2, 0), (0, 1)): C[i, j] = er["sensor-crosstalk"].uniform(.02, .07) * er["sensor-crosstalk"].choice([-1, 1]) * bo
            for i in range(3, 6): C[i, 2] = er["sensor-crosstalk"].uniform(-.003, .003) * bo
            S = S + S @ C.T; priv["crosstalk"] = C.tolist()
        if act("sensor-drift"): dr = er["sensor-drift"].uniform(.3, .9, 6) * er["sensor-drift"].choice([-1, 1], 6) * bo * np.array([1, 1, 1, .02, .02, .02]); S = S + dr * tg[:, None] / 60; V.update({f"sensor-drift.drift[{c}]": float(dr[i]) for i, c in enumerate("fx fy fz tx ty tz".split())})
        if act("sensor-bias"): bs = er["sensor-bias"].uniform(.15, .5, 6) * er["sensor-bias"].choice([-1, 1], 6) * bo * np.array([1, 1, 1, .02, .02, .02]); S = S + bs; V.update({f"sensor-bias.offset[{c}]": float(bs[i]) for i, c in enumerate("fx fy fz tx ty tz".split())})
        if act("x-hose"):                                          # a hose: pulls toward an anchor, with friction of its sheath
            dv = (X @ B.T) - np.array([.3, .1, .25]) * (B[:, 2] @ [0, 0, 1]); l = np.linalg.norm(dv, axis=1)
            S[:, :3] -= np.einsum("nji,nj->ni", Rg, dv / l[:, None] * (25. * bo * (l - l.min()) + 1.5 * bo * np.tanh(np.gradient(l, dt) / .01))[:, None])
        if act("x-jump"):                                          # a knocked cable: bias jumps twice
            for u in (.35, .7): S = S + er["x-jump"].uniform(-1, 1, 6) * bo * np.array([.6, .6, .8, .01, .01, .01]) * (tg > u * T)[:, None]
        S = S + drift * tg[:, None] / 60 * np.array([1, 1, 1, .02, .02, .02]) + q.uniform(-.02, .02, 6) * ns * np.array([1, 1, 1, .02, .02, .02])
        if tau: S = lowpass(S, dt, tau)
        Y = I(S, tw); noise = q.normal(size=Y.shape) * nz
        if act("mains-hum"): Y += np.sin(2 * np.pi * 50 * tw + 1)[:, None] * np.array([.08, .06, .15, .002, .002, .001]) * bo
        Y += noise
        if act("saturation"):
            lim = round(float(np.abs(Y[:, 2]).max()) * (U(.5, .7, er["saturation"]) if "beyond" not in op else 2.), 1); Y[:, 2] = np.clip(Y[:, 2], -lim, lim); V["saturation.limit"] = lim
        if act("quantization"): st = U(.15, .4, er["quantization"]) * bo; Y[:, :3] = np.round(Y[:, :3] / st) * st; Y[:, 3:] = np.round(Y[:, 3:] / 5e-3) * 5e-3; V["quantization.step"] = st
        # joints at the log's times: what the encoders see
        Rq = R0 @ exps(I(cmd[:, 3:], t + clk)); pt = pa + (I(X, t + clk) - Cc * I(Fc, t + clk)) @ B.T - Rq @ o
        twin = spec.get("twin", False)                             # twins serve the judge only: no joints, same encoder scatter at the tip
        Q, err = (np.zeros((len(t), Ar.n)), 0.) if twin else Ar.ik(q0, Rq, pt); assert err < 1e-7 and np.abs(np.diff(Q, axis=0)).max() < .5, ("ik", err)
        enc = LU(2e-6, 3e-5) * (1 if not ("coarse" in op) else 2); Qm = np.round(Q / enc) * enc; rows.update({f"q{j+1}": Qm[:, j] for j in range(Ar.n)})
        if q.random() < .7:
            dq = np.gradient(Q, t, axis=0); dq = lowpass(dq, 1 / fs, U(.002, .012)) + q.uniform(-2e-4, 2e-4, Ar.n) * ns + q.normal(size=Q.shape) * U(5e-5, 5e-4); rows.update({f"dq{j+1}": dq[:, j] for j in range(Ar.n)})
        rows.update({c: Y[:, i] for i, c in enumerate("fx fy fz tx ty tz".split())})
        f3 = lambda v: "[" + ", ".join(f"{x:.6g}" for x in v) + "]"; f9 = lambda v: "[" + ", ".join(f"{x:.9f}" for x in v) + "]"
        rig += [f'[robot]\nmodel = "robot.urdf"\nsensor_frame = "ft_sensor"\ntip_frame = "tool_tip"\ngravity = {f3(grav)}\n', f"[tool]\nmass = {mt:.4f}\ncom = {f3(com)}\n",
                f"[surface]\npoint = {f9(pa)}\nnormal = {f9(nrm)}\ntangent = {f9(e1)}\n"]
        if q.random() < .6: rig.append(f"[sensor]\nnoise = {f3(nz)}\n")
        Rf, pf_ = (Rq, pt + np.random.default_rng(5).normal(size=pt.shape) * enc * .25) if twin else Ar.fk(Qm); xs = (pf_ - pa) @ B; true_err = Y[:, :3] - clean[:, :3]
        fit = dict(t=t, x=xs, Y=Y, R=Rf, B=B, tip=tip, mass=round(mt, 4), com=com, g=grav, sd=nz)
        priv.update(arm=arm, gravity=grav.tolist(), encoder=enc, mass_true=m_t, drift=drift)
    else:
        Yt = np.stack([F[:, 2], F[:, 0], F[:, 1]], 1)[:, :3 if tang else 1]; clean = I(Yt); S = Yt * (1 + nlin * Yt)
        if act("x-jump"): S = S + U(.3, .6, er["x-jump"]) * bo * ((tg > .4 * T) * 1. - 1.7 * (tg > .75 * T))[:, None]
        if act("x-gainfade"): S = S * (1 - .15 * bo * np.sin(2 * np.pi * tg / T * 1.5) ** 2)[:, None]
        S = S + drift * tg[:, None] / max(T, 60.)
        if tau: S = lowpass(S, dt, tau)
        nz = np.full(S.shape[1], U(.005, .03)); Y = I(S, tw) + q.normal(size=(len(t), S.shape[1])) * nz + U(-.01, .01) * ns
        if act("mains-hum"): Y = Y + (.12 * bo * np.sin(2 * np.pi * 50 * tw))[:, None]
        if act("saturation"): lim = round(float(Y[:, 0].max()) * (U(.5, .7, er["saturation"]) if "beyond" not in op else 2.), 1); Y[:, 0] = np.minimum(Y[:, 0], lim); V["saturation.limit"] = lim
        if act("quantization"): st = U(.15, .4, er["quantization"]) * bo; Y = np.round(Y / st) * st; V["quantization.step"] = st
        xs = I(X, t + clk) - Cc * I(Fc, t + clk); enc = LU(1e-7, 1e-6); xs = np.round(xs / enc) * enc; rows["depth"] = -xs[:, 2]
        if tang: rows["slip1"], rows["slip2"] = xs[:, 0], xs[:, 1]
        if q.random() < .5 and "long" not in op: rows["depth_rate"] = -np.gradient(I(X)[:, 2], t) + q.normal(size=len(t)) * 1e-4
        rows["normal_force"] = Y[:, 0]
        if tang: rows["tangential_force1"], rows["tangential_force2"] = Y[:, 1], Y[:, 2]
        if q.random() < .5 and not tang: rig.append(f"[sensor]\nnoise = [0.01, 0.01, {nz[0]:.4g}, 0.001, 0.001, 0.001]\n")
        else: rig.append("# no robot: a tester's log in the contact frame\n")
        true_err = Y - clean; fit = dict(t=t, x=xs, Y=Y, R=None, sd=nz)
    if words is not None: rows["phase"] = np.array([words[a] for a in phase])
    fit["contact"] = I(Fc)[:, 2] > .02; fit["forces"] = 3 if robot else Y.shape[1]
    priv.update(law=law, k=k, n=n, D=D, Fm=Fm, P={a: float(b) for a, b in P.items()}, K=K, M=M, dyn=bool(dyn), clock=clk, nlin=nlin, fs=fs, bias_scale=ns, boost=bo)
    return dict(rows=rows, rig="\n".join(rig), files=files, values={a: float(b) for a, b in V.items()}, true_error=float(np.sqrt((true_err ** 2).mean())), fit=fit, private=priv)
