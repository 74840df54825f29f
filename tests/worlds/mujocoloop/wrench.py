"""Wrench logs: the arm under impedance control pokes and slides with its tool; one case from a wish (SI units)."""
from __future__ import annotations
import numpy as np
import laws
import logio
import motion
from laws import FREE, IX, NULL, Motion, fit, params, predict
from sim import Tool, build_arm, run_cart, solve_ik

NORMAL = ["hertz-exponent", "viscous-damping", "hunt-crossley-damping", "relaxation", "hysteresis", "stress-softening", "adhesion", "stiffening-layer",
          "surface-offset", "stiffness-drift", "stiffness-inhomogeneity"]
TANGENT = ["coulomb-friction", "viscous-friction", "stribeck-friction", "presliding", "friction-rounding", "load-dependent-friction", "friction-anisotropy"]
TOOLING = ["tool-mass", "tool-com", "tool-inertia", "structural-compliance", "tip-offset"]
SENSOR = ["sensor-bias", "sensor-drift", "sensor-crosstalk", "sensor-misalignment", "sensor-gain", "sensor-lag", "time-offset", "saturation", "quantization",
          "mains-hum"]
TORQUE = {"tool-com", "tool-inertia", "tip-offset"}
OUTSIDE = ["buckling", "breathing", "dent", "magnet", "hose", "liquid", "vibration"]
PAIRS = [("relaxation", "sensor-bias"), ("viscous-friction", "stiffening-layer"), ("stribeck-friction", "tool-mass"), ("hysteresis", "friction-anisotropy"),
         ("sensor-misalignment", "relaxation"), ("load-dependent-friction", "hunt-crossley-damping"), ("stiffness-inhomogeneity", "viscous-friction"),
         ("tool-com", "adhesion"), ("hertz-exponent", "sensor-crosstalk"), ("stress-softening", "coulomb-friction"), ("time-offset", "sensor-bias"),
         ("surface-offset", "stribeck-friction")]
UNEXCITED = ["friction-anisotropy", "stiffening-layer", "stiffness-inhomogeneity", "saturation"]
ALIKE = {"hertz-exponent": ["stiffening-layer", "structural-compliance"], "viscous-damping": ["hunt-crossley-damping", "relaxation", "hysteresis", "time-offset"],
         "hunt-crossley-damping": ["viscous-damping", "relaxation", "hysteresis"], "relaxation": ["hysteresis", "viscous-damping", "stiffness-drift"],
         "hysteresis": ["relaxation", "viscous-damping", "adhesion"], "stress-softening": ["stiffness-drift", "hysteresis"], "adhesion": ["surface-offset", "hysteresis"],
         "stiffening-layer": ["hertz-exponent"], "surface-offset": ["tip-offset", "hertz-exponent", "adhesion"],
         "stiffness-drift": ["stress-softening", "sensor-drift"], "stiffness-inhomogeneity": ["stiffness-drift"], "viscous-friction": ["stribeck-friction", "friction-rounding"],
         "stribeck-friction": ["viscous-friction", "friction-rounding"], "presliding": ["friction-rounding", "time-offset"], "friction-rounding": ["presliding", "viscous-friction"],
         "load-dependent-friction": ["sensor-gain"], "friction-anisotropy": ["sensor-crosstalk"], "coulomb-friction": ["viscous-friction"], "tool-mass": ["sensor-gain", "sensor-bias"],
         "tool-com": ["tip-offset", "sensor-misalignment"], "structural-compliance": ["hertz-exponent"], "tip-offset": ["tool-com"], "sensor-gain": ["tool-mass"],
         "sensor-bias": ["tool-mass"], "sensor-drift": ["stiffness-drift"], "sensor-crosstalk": ["sensor-misalignment"], "sensor-misalignment": ["sensor-crosstalk"],
         "sensor-lag": ["time-offset"], "time-offset": ["sensor-lag"]}


def material(rng: np.random.Generator, base: str) -> dict:
    """Parameters of a base: flat punch (n = 1) or ball (n = 1.5) on a silicone or foam."""
    if base in ("hertz", "hunt-crossley"):
        return {"k": rng.uniform(2e4, 6e4), "n": 1.5} | ({"lam": rng.uniform(0.6, 2.5)} if base == "hunt-crossley" else {})
    p = {"k": rng.uniform(900, 3500)}
    return p | ({"c": rng.uniform(4, 15)} if base == "kelvin-voigt" else {}) | ({"r1": rng.uniform(0.3, 0.7), "tau1": rng.uniform(0.2, 0.9)} if base == "zener" else {})


def hide(rng: np.random.Generator, name: str, g: float, P: dict, dmax: float) -> dict:
    """Parameters that switch an effect on with strength g (1 = ordinary)."""
    sg = rng.choice([-1.0, 1.0])
    v3 = lambda: rng.uniform(0.5, 1, 3) * rng.choice([-1, 1], 3)
    table = {
        "hertz-exponent": lambda: {"n": P["n"] + 0.28 * g, "k": P["k"] * dmax ** (-0.28 * g)}, "viscous-damping": lambda: {"c": 12 * g},
        "hunt-crossley-damping": lambda: {"lam": 1.5 * g}, "relaxation": lambda: {"r1": 0.35 * g, "tau1": rng.uniform(0.25, 1.4)},
        "hysteresis": lambda: {"hysA": 1.3 * g, "hysL": rng.uniform(2e-4, 6e-4)}, "stress-softening": lambda: {"mulR": min(0.25 * g, 0.7), "mulL": dmax / 4},
        "adhesion": lambda: {"Fa": 0.5 * g, "La": rng.uniform(0.6e-3, 1.6e-3)}, "stiffening-layer": lambda: {"db": 0.55 * dmax, "K2": 0.8 * g * P["k"] * dmax ** (P["n"] - 1)},
        "surface-offset": lambda: {"z0": 3e-4 * g * sg}, "stiffness-drift": lambda: {"drift": 0.2 * g * sg if sg > 0 else max(-0.15 * g, -0.3)},
        "stiffness-inhomogeneity": lambda: {"inhA": 0.35 * g, "inhX": rng.uniform(-2e-3, 4e-3), "inhY": rng.uniform(-2e-3, 2e-3), "inhW": rng.uniform(2e-3, 5e-3), "inhType": float(rng.integers(2))},
        "coulomb-friction": lambda: {}, "viscous-friction": lambda: {"cv": 16 * g}, "stribeck-friction": lambda: {"dmu": 0.16 * g, "vs": rng.uniform(7e-3, 14e-3)},
        "presliding": lambda: {"len": 7e-4 * g, "ftype": 1.0}, "friction-rounding": lambda: {"vr": 4e-3 * g, "ftype": 2.0}, "load-dependent-friction": lambda: {"p": max(1 - 0.25 * g, 0.4)},
        "friction-anisotropy": lambda: {"aniso": 0.12 * g * sg}, "tool-mass": lambda: {"m": P["m"] + 0.035 * g}, "tool-com": lambda: dict(zip(("cx", "cy", "cz"), np.array([P["cx"], P["cy"], P["cz"]]) + 4e-3 * g * v3())),
        "tool-inertia": lambda: {"Ixx": 2e-3 * g, "Iyy": 1.7e-3 * g, "Izz": 1.2e-3 * g}, "structural-compliance": lambda: {"C": 4e-5 * g},
        "tip-offset": lambda: {"tox": 1.5e-3 * g * sg, "toy": -1e-3 * g}, "sensor-bias": lambda: {f"b{i}": x for i, x in enumerate(g * np.r_[0.2 * v3(), 4e-3 * v3()])},
        "sensor-drift": lambda: {f"d{i}": x for i, x in enumerate(g * np.r_[0.35 * v3(), 6e-3 * v3()])}, "sensor-crosstalk": lambda: {f"x{i}": 0.05 * g * x for i, x in enumerate(np.r_[v3(), v3()])},
        "sensor-misalignment": lambda: {f"m{i}": 0.045 * g * x for i, x in enumerate(v3())}, "sensor-gain": lambda: {"gain": 0.09 * g * sg}, "sensor-lag": lambda: {"lag": 9e-3 * g},
        "time-offset": lambda: {"toff": 6e-3 * g * sg}, "buckling": lambda: {"snapF": 3.0 * g, "snapD": 0.5 * dmax, "snapW": 0.1 * dmax},
        "breathing": lambda: {"breA": 4e-4 * g, "breF": rng.uniform(0.3, 1.3)}, "dent": lambda: {"dentR": min(0.3 * g, 0.75), "dentY": 0.15 * dmax},
        "magnet": lambda: {"magA": 2.0 * g, "magL": rng.uniform(3e-3, 8e-3)}, "hose": lambda: {"cabK": 40 * g, "cabX": rng.uniform(-0.03, 0.03), "cabY": rng.uniform(-0.03, 0.03), "cabZ": -0.03},
        "liquid": lambda: {"drag": 60.0 * g}}
    return table.get(name, dict)()


def program(rng: np.random.Generator, dt: float, want: list[str], dmax: float, gain: float, group: str) -> motion.Path:
    """A motion that shows the wanted effects (or, unexcited, does not)."""
    p = motion.Path(dt)
    p.hold(0.5, "free")
    W = set(want)
    hard = 2.0 if W & {"tool-inertia", "sensor-lag", "time-offset", "liquid"} else 1.0
    if W & {*TOOLING, *SENSOR, "liquid", "hose", "vibration"} or rng.random() < 0.6:
        motion.free_part(p, rng, 3.5 if W & {*TOOLING, *SENSOR} else 2.0, hard)
        p.to([0, 0, -0.012], 1.0, "free", tilt=[0, 0, 0])
    slide_only = bool(W & set(TANGENT)) and rng.random() < 0.3
    poke_only = not W & {*TANGENT, "sensor-crosstalk", "sensor-misalignment", "stiffness-inhomogeneity", "tip-offset", "tool-com"} and rng.random() < 0.45
    unx = group == "unexcited"
    if unx and W & {"stiffness-inhomogeneity", "stiffening-layer"}:
        poke_only = True
    long = bool(W & {"stiffness-drift", "sensor-drift", "long"})
    for rep in range(5 if long else 1):
        if not slide_only or long:
            places = [(0, 0), (4e-3, 0), (-5e-3, 2e-3), (0, -5e-3)] if W & {"stiffness-inhomogeneity"} and not unx else None
            motion.pokes(p, rng, dmax, gain, 6 if poke_only and not long else 4, places, tilt=0.15 if "tip-offset" in W else 0.0, slow=bool(W & {"adhesion", "magnet"}),
                         quick=bool(W & {"viscous-damping", "hunt-crossley-damping", "sensor-lag", "time-offset"}), fresh=bool(W & {"stress-softening", "dent"}),
                         hold=(0.8, 2.2) if W & {"relaxation", "breathing"} else (0.3, 1.0))
        if not poke_only and (not long or rep % 3 == 1):
            sp = [0.007, 0.02, 0.06] if W & {"stribeck-friction", "friction-rounding", "viscous-friction"} else [0.014, 0.045]
            motion.slides(p, rng, dmax * np.array([0.45, 0.9]), gain, sp, 0.0035 if "presliding" in W else 0.0055, both=not (unx and "friction-anisotropy" in W),
                          dwell=0.1 if "presliding" in W else rng.uniform(0.1, 0.3))
        if long:
            p.to([0, 0, -0.03], 1.0, "free")
            p.swing(2.5, np.array([0.01, 0.01, 0.005]), np.array([0.3, 0.3, 0.3]), [0.6, 0.7, 0.5, 0.4, 0.4, 0.4])
            p.to([0, 0, -0.012], 1.0, "free", tilt=[0, 0, 0])
    motion.free_part(p, rng, 1.5)
    return p


def parts(name: str, res: np.ndarray, M: Motion, contact: np.ndarray, moving: np.ndarray) -> float:
    """rms of the residual (n, 6) in the channels and samples that an effect is about [N or N m]."""
    if name in TORQUE:
        return float(np.sqrt(np.mean(res[contact | moving, 3:] ** 2)))
    B = np.array([M.surf[1], M.surf[2], M.surf[3]])
    f = np.einsum("nij,nj->ni", M.R, res[:, :3]) @ B.T
    if name in NORMAL or name == "structural-compliance":
        return float(np.sqrt(np.mean(f[contact, 0] ** 2)))
    if name in TANGENT:
        return float(np.sqrt(np.mean(f[contact, 1:] ** 2)))
    return float(np.sqrt(np.mean(res[contact | moving, :3] ** 2)))


def without(model: list[str], P: np.ndarray, hidden: str, rig: np.ndarray) -> np.ndarray:
    """Truth with one effect put back to what a model without it holds."""
    Q = P.copy()
    for n in FREE.get(hidden, []):
        Q[IX[n]] = rig[IX[n]]
    if hidden in ("presliding", "friction-rounding"):
        Q[IX["ftype"]], Q[IX["len"]] = 0.0, 1e-4
    return Q


def make(rng: np.random.Generator, urdf: str, group: str, hidden: list[str], outside: str | None, g: np.ndarray, judge: bool, long: bool = False) -> dict:
    """One wrench case with strengths g of the hidden effects. Returns truth, columns and rig; judge: also looks for alike effects."""
    W = [*hidden, *([outside] if outside else [])]
    base = {"hertz-exponent": "kelvin-voigt", "viscous-damping": rng.choice(["hertz", "hooke"]), "hunt-crossley-damping": "hertz", "structural-compliance": "hertz",
            "surface-offset": "kelvin-voigt"}.get(hidden[0] if hidden else "", rng.choice(["kelvin-voigt", "hunt-crossley", "zener", "hertz"], p=[0.45, 0.3, 0.15, 0.1]))
    base = next((b for h, b in (("hunt-crossley-damping", "hertz"), ("hertz-exponent", "kelvin-voigt")) if h in hidden), str(base))
    if base == "zener" and set(W) & {"relaxation"}:
        base = "kelvin-voigt"
    mat = material(rng, base)
    peak = rng.uniform(9, 20) if base != "zener" else rng.uniform(8, 14)
    if "structural-compliance" in W:
        peak, mat["k"] = rng.uniform(18, 26), rng.uniform(6e4, 1e5)
    n0 = mat.get("n", 1.0)
    dmax = float((peak / mat["k"]) ** (1 / n0))
    model = [base]
    fric = str(rng.choice(["prandtl", "dahl", "rounded"], p=[0.4, 0.25, 0.35]))
    if long and fric == "prandtl":
        fric = "dahl"
    if set(W) & {"presliding", "friction-rounding", "coulomb-friction"} or (set(W) & set(TANGENT) and fric == "rounded"):
        fric = "prandtl"
    mat |= {"mu": rng.uniform(0.25, 0.8), "ftype": {"prandtl": 0.0, "dahl": 1.0, "rounded": 2.0}[fric], "N0": 5.0}
    mat["len"] = rng.uniform(8e-5, 1.2e-4) if fric == "prandtl" else rng.uniform(1.6e-4, 3e-4)
    mat["vr"] = rng.uniform(0.8e-3, 2.5e-3)
    if "coulomb-friction" not in hidden:
        model += ["coulomb-friction"] + {"prandtl": [], "dahl": ["presliding"], "rounded": ["friction-rounding"]}[fric]
    heavy = "tool-inertia" in W
    true_tool = Tool(mass=float(rng.uniform(0.5, 0.8) if heavy else rng.uniform(0.18, 0.4)), com=np.array([0, 0, rng.uniform(0.04, 0.06)]))
    for extra, pr, kw in (("sensor-bias", 0.3, None), ("viscous-friction", 0.12, {"cv": rng.uniform(5, 20)}), ("relaxation", 0.12, {"r1": rng.uniform(0.15, 0.4), "tau1": rng.uniform(0.3, 1.2)})):
        if rng.random() < pr and extra not in W and not (extra == "sensor-bias" and set(W) & {*TOOLING, *SENSOR}) and not (extra == "relaxation" and (base == "zener" or set(W) & {"hysteresis", "structural-compliance"})) and "coulomb-friction" not in W:
            model.append(extra)
            mat |= kw if kw else {f"b{i}": x for i, x in enumerate(np.r_[rng.uniform(-1, 1, 3), rng.uniform(-0.03, 0.03, 3)])}
    mat |= {"m": true_tool.mass, "cz": true_tool.com[2], "cx": 0.0, "cy": 0.0, "Ixx": 2e-4, "Iyy": 2e-4, "Izz": 3e-5, "n": n0}
    rig_tool = Tool(mass=true_tool.mass, com=true_tool.com.copy())
    if heavy:
        mat |= {"Ixx": 0.0, "Iyy": 0.0, "Izz": 0.0}
    rigP = params(**{k: v for k, v in mat.items() if k != "len"})
    P0 = dict(mat)
    if unx_layer := (group == "unexcited" and "stiffening-layer" in W):
        P0 |= {"db": 1.4 * dmax, "K2": mat["k"]}
    for h, s in zip(W, g):
        P0 |= {} if unx_layer else hide(rng, h, float(s), P0, dmax)
    true = [*model]
    for h in hidden:
        true.append(h)
    P = params(**P0)
    if "coulomb-friction" in hidden:
        rigP[IX["mu"]] = 0.0
    # --- nuisances of the physics
    nu: dict = {"friction": fric}
    quiet = group == "none"
    tilt = np.radians(rng.uniform(0, 0.2)) * rng.choice([0, 1])
    az = rng.uniform(0, 2 * np.pi)
    grav = 9.81 * np.array([np.sin(tilt) * np.cos(az), np.sin(tilt) * np.sin(az), -np.cos(tilt)])
    off = rng.uniform(-1, 1) * 2e-5
    mo, co = 1 + rng.uniform(-1, 1) * (0.008 if quiet else 0.02), 1 + rng.uniform(-1, 1) * (0.005 if quiet else 0.02)
    nu |= {"base_tilt_rad": float(tilt), "surface_off_m": off, "tool_mass_factor": mo, "tool_com_factor": co}
    if rng.random() < 0.3 and not set(W) & {"relaxation", "stiffness-drift", "stress-softening"}:
        P[IX["r2"]], P[IX["tau2"]] = 0.008, rng.uniform(2, 5)
        nu["second_branch_ratio"] = 0.008
    q = np.array([rng.uniform(-0.6, 0.6), -0.6, rng.uniform(-0.3, 0.3), 1.5, 0.0, -1.0, rng.uniform(-1, 1)])
    nrm = np.array([0, 0, 1.0])
    if rng.random() < 0.3:
        a, b = rng.uniform(0.05, 0.3), rng.uniform(0, 2 * np.pi)
        nrm = np.array([np.sin(a) * np.cos(b), np.sin(a) * np.sin(b), np.cos(a)])
    t1 = np.array([1.0, 0, 0]) - nrm[0] * nrm
    t1 /= np.linalg.norm(t1)
    surf = np.array([[rng.uniform(0.5, 0.6), rng.uniform(-0.15, 0.15), rng.uniform(0.08, 0.2)], nrm, t1, np.cross(nrm, t1)])
    R0 = np.column_stack([t1, -surf[3], -nrm])
    Kc, dt = float(rng.choice([2500, 5000, 9000, 15000])), 1 / 4000
    stiff = mat["k"] * n0 * dmax ** (n0 - 1)
    path = program(rng, dt, W + (["long"] if long else []), dmax, 1 + peak / dmax / Kc, group)
    xd, vd, Rd, wd, phase = path.command(surf, R0)
    sim_tool = Tool(P[IX["m"]], P[IX["cx"]:IX["cz"] + 1], P[IX["Ixx"]:IX["Izz"] + 1], rig_tool.tip + P[IX["tox"]:IX["toz"] + 1])
    m = build_arm(urdf, sim_tool, grav, dt, np.full(7, 0.12))
    q0 = solve_ik(m, q, xd[0], Rd[0])
    every = 8 if len(xd) > 240000 else 2
    o = run_cart(m, q0, xd, vd, Rd, wd, Kc, 350.0, float(rng.uniform(0.7, 1.0)), P, surf, every)
    phase = phase[::every][:len(o)]
    t = o[:, 0]
    nu |= {"control_N_per_m": Kc, "material_N_per_m": float(stiff)}
    ch = laws.chain(urdf)
    # --- what the effect does along the executed motion
    rate = float(rng.choice([200, 250, 500, 1000, 2000] if t[-1] < 25 else [200, 250, 400, 500], p=[0.15, 0.15, 0.4, 0.25, 0.05] if t[-1] < 25 else [0.2, 0.2, 0.3, 0.3]))
    if set(W) & {"mains-hum", "sensor-lag"}:
        rate = max(rate, 500.0)
    if t[-1] > 60:
        rate = float(rng.choice([50, 100, 200]))
    dec = max(1, int(round(1 / (t[1] * min(rate, 500 if set(W) & {"sensor-lag", "time-offset"} else 200)))), len(t) // 9000)
    S = slice(0, None, dec)
    M = Motion(ch, t[S], o[S, 1:8], o[S, 8:15], o[S, 15:22], surf, rig_tool.tip, grav)
    y_all = laws.sensor_chain(P, t, o[:, 22:28])
    noise = np.r_[rng.uniform(0.01, 0.05, 2), rng.uniform(0.015, 0.05), rng.uniform(3e-4, 8e-4, 3)]
    extra = np.zeros_like(y_all)
    if "mains-hum" in W:
        f0, a = rng.choice([50.0, 60.0]), 0.2 * g[0] * np.r_[rng.uniform(0.5, 1, 3), 0.02 * rng.uniform(0.5, 1, 3)]
        extra += np.outer(np.sin(2 * np.pi * f0 * t), a) + 0.3 * np.outer(np.sin(4 * np.pi * f0 * t + 1), a)
    if outside == "vibration":
        f0, a = rng.uniform(14, 24), 0.8 * g[-1]
        for i, phs in enumerate((0.0, 1.57, 0.6)):
            extra[:, i] += a * (1, 1, 0.5)[i] * np.sin(2 * np.pi * f0 * t + 0.4 * np.sin(0.7 * t) + phs)
    limit = 0.0
    if "saturation" in W:
        fz = np.abs(y_all[:, 2]).max()
        limit = 1.3 * fz if group == "unexcited" else float(max(1 - 0.3 * g[0], 0.45) * fz)
    clip = lambda y: np.column_stack([y[:, :2], np.clip(y[:, 2], -limit, limit), y[:, 3:]]) if limit else y
    step = 0.25 * g[0] if "quantization" in W else 0.0
    y = y_all[S]
    depth = M.contact(P[IX["tox"]:IX["toz"] + 1])[0][:, 0] + P[IX["z0"]]
    contact, moving = depth > 0, np.abs(o[S, 8:15]).max(1) > 5e-3
    w = np.r_[np.full(3, 1 / 0.03), np.full(3, 1 / 6e-4)]
    f = lambda Q: predict(Q, M)
    floor = y - f(P)
    y = f(P)  # effects are judged on the law itself, free of what sampling does to stick springs
    free = lambda names: list(dict.fromkeys(n for e in names for n in FREE[e]))
    plain = {"saturation": clip(y) - y, "mains-hum": extra[S], "quantization": np.full_like(y, step / np.sqrt(12)), "vibration": extra[S]}
    effects, near, notes, ratios = {}, [], [], {}
    for h in hidden:
        others = [e for e in true if e != h]
        if h in plain:
            res = plain[h]
            if h == "saturation":
                Q, res = fit(f, P, free(others), y + res, w, 6)
        else:
            Q, res = fit(f, without(model, P, h, rigP), free(others), y, w)
        effects[h] = parts(h, res, M, contact, moving)
        Qh, resh = Q if h not in plain else P, res
    for ox in [outside] if outside else []:
        Q0 = P.copy()
        for nme in hide(np.random.default_rng(0), ox, 1.0, P0, dmax):
            Q0[IX[nme]] = 0.0 if nme in ("snapF", "breA", "dentR", "magA", "cabK", "drag") else Q0[IX[nme]]
        Q, res = fit(f, Q0, free(true), y + extra[S], w)
        effects[ox] = parts(ox, res, M, contact, moving)
        Qh = Q
    # --- the log
    tl = logio.clock(rng, t, rate, nu)
    toff = float(rng.uniform(-2e-4, 2e-4))
    nu["clock_off_s"] = toff
    sat_before = rng.random() < 0.5
    ym = logio.at(tl + toff, t, y_all + extra)
    eps = float(rng.uniform(0, 0.003 if quiet else 0.01))
    span = np.abs(ym).max(0) + 1e-9
    ym = ym + eps * ym * (ym / span) ** 2
    dr = rng.uniform(-0.5, 0.5, 6) * noise * rng.choice([0, 1])
    ym = ym + np.outer((tl - tl[0]) / tl[-1], dr)
    eta = rng.normal(0, 1, ym.shape) * noise
    ym = clip(ym + eta) if sat_before else clip(ym) + eta
    if step:
        ym = np.round(ym / np.r_[np.full(3, step), np.full(3, step * 0.03)]) * np.r_[np.full(3, step), np.full(3, step * 0.03)]
    elif rng.random() < 0.5:
        qs = np.r_[0.01, 0.01, 0.02, np.full(3, 2.5e-4)]
        ym = np.round(ym / qs) * qs
    nu |= {"sensor_nonlinearity": eps, "sensor_noise": noise.tolist(), "drift_over_log": dr.tolist()}
    surf_l = surf.copy()
    surf_l[0] += off * nrm
    ql, dql = logio.joints(rng, t, o[:, 1:8], o[:, 8:15], tl, nu, coarse=False, quiet=quiet or fric == "rounded")
    # --- the inverse of the whole chain from the log alone, with the true model
    rt = Tool(true_tool.mass * mo, true_tool.com * co, np.array([2e-4, 2e-4, 3e-5]))
    v, acc = logio.differentiate(tl, ql, dql, 0.03)
    dl = max(1, len(tl) // 7000)
    SL = slice(0, None, dl)
    ML = Motion(ch, tl[SL], ql[SL], v[SL], acc[SL], surf_l, rt.tip, np.array([0, 0, -9.81]))
    Pl = P.copy()
    for nme, val, hid in (("m", rt.mass, "tool-mass"), ("cz", rt.com[2], "tool-com"), ("cx", 0, "tool-com"), ("cy", 0, "tool-com")):
        if hid not in hidden:
            Pl[IX[nme]] = val
    Pl[IX["r2"]] = 0.0
    yl = ym[SL]
    cl = ML.contact(P[IX["tox"]:IX["toz"] + 1])[0][:, 0] + P[IX["z0"]] > 0
    mv = np.abs(v[SL]).max(1) > 5e-3
    un = logio.at(tl[SL], t, extra)
    yl_fit = yl - un
    Pf, rl = fit(lambda Q: clip(predict(Q, ML)), Pl, free(true), yl_fit, w, 7)
    if step:
        rl = rl / max(1.0, np.sqrt(np.mean(rl[:, :3] ** 2)) / np.sqrt(np.mean(noise[:3] ** 2)))
    left = {h: parts(h, rl, ML, cl, mv) for h in (W or [""])}
    ratios = {h: effects[h] / left[h] for h in effects}
    reading = parts(W[-1] if W else "", yl, ML, cl, mv)
    h0 = min(ratios, key=ratios.get) if ratios else ""
    judge = judge and (group in ("weak", "unexcited") or min(ratios.values(), default=9) > 2.7)
    if judge and hidden and group != "unexcited":
        for h in hidden:
            for alt in ALIKE.get(h, []):
                if alt in true or h in plain:
                    continue
                others = [e for e in true if e != h] + [alt]
                Q0 = without(model, P, h, rigP)
                for nme in FREE[alt]:
                    if nme in laws.SCALE and Q0[IX[nme]] == 0:
                        Q0[IX[nme]] = 0.3 * laws.SCALE[nme]
                if alt in ("presliding", "friction-rounding"):
                    Q0[IX["ftype"]] = {"presliding": 1.0, "friction-rounding": 2.0}[alt]
                r = parts(h, fit(f, Q0, free(others), y, w, 8)[1], M, contact, moving)
                notes.append(f"{h} as {alt}: {r:.4g}")
                if r < min(0.6 * left[h] + 0.04 * effects[h], 0.5 * effects[h]):
                    near.append(alt)
    if judge and outside:
        c0, best = effects[outside], ("", 1.0)
        for alt in ("hertz-exponent", "stiffening-layer", "stress-softening", "hysteresis", "adhesion", "surface-offset", "viscous-friction", "viscous-damping", "relaxation", "tool-mass",
                    "sensor-bias", "stiffness-drift", "hunt-crossley-damping", "sensor-drift", "stiffness-inhomogeneity", "structural-compliance", "tip-offset", "time-offset"):
            if alt in model or (alt == "relaxation" and base == "zener") or (alt == "viscous-damping" and base == "kelvin-voigt"):
                continue
            Q0 = Qh.copy()
            for nme in FREE[alt]:
                if nme in laws.SCALE and Q0[IX[nme]] == 0:
                    Q0[IX[nme]] = 0.3 * laws.SCALE[nme]
            sub = slice(0, None, 2)
            share = 1 - (parts(outside, fit(f, Q0, free(true + [alt]), y + extra[S], w, 5)[1], M, contact, moving) / c0) ** 2
            if share > 0.25:
                near.append(alt)
            best = max(best, (alt, share), key=lambda x: x[1] if x[0] else 0)
        notes.append(f"best single half-explanation {best[0]} takes {best[1]:.2f} of the squared error")
        near += ["mains-hum"] if outside == "vibration" else []
    err = {nme: float(Pf[IX[nme]] / P[IX[nme]]) for nme in free(true) if P[IX[nme]] != 0}
    notes.append("inverse of own chain, estimate/truth: " + ", ".join(f"{a} {b:.3f}" for a, b in err.items()))
    notes.append(f"model floor {parts(h0, floor, M, contact, moving):.3g}; friction {fric} len {P[IX['len']]:.2g} m vr {P[IX['vr']]:.2g} m/s")
    cols: dict = {"t": tl} | {f"q{i + 1}": ql[:, i] for i in range(7)}
    if dql is not None:
        cols |= {f"dq{i + 1}": dql[:, i] for i in range(7)}
    cols |= {n: ym[:, i] for i, n in enumerate("fx fy fz tx ty tz".split())}
    if rng.random() < 0.6:
        cols["phase"] = phase[np.clip(np.searchsorted(t, tl), 0, len(phase) - 1)].astype(str)
    lim = [40, 40, float(round(limit, 1)) if limit and sat_before and group != "unexcited" and rng.random() < 0.5 else 120.0, 2, 2, 2]
    return {"kind": "wrench", "group": group, "model": model, "hidden": W if outside else hidden, "true": true, "near": sorted(set(near)), "effect": effects, "left": left, "ratios": ratios,
            "worst": h0, "unit": "N·m" if h0 in TORQUE else "N", "nuisances": nu, "notes": notes, "cols": cols, "reading": reading, "outside": outside,
            "rig": logio.wrench_rig(surf_l, rt, noise.tolist(), inertia=not heavy, rng_lim=lim), "truth": {k: float(v) for k, v in P0.items()}}
