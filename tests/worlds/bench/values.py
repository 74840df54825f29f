"""The field "values" of a truth entry: true numbers of those catalogue parameters whose plain meaning is clear and which the log
realises: what nuisances or wrong statements in the rig shift (by estimate 2 %, by refit 5 %) is left out. `own`: the hidden effects."""
import numpy as np

TOL = .02
AXES = ("fx", "fy", "fz", "tx", "ty", "tz")
NEAR = .05
IJ = ("xx", "yy", "zz", "xy", "xz", "yz")
# effect, parameter, key of laws.py and of the refit
PLAIN = [("hertz-exponent", "exponent", "n"), ("viscous-damping", "damping", "c"), ("hunt-crossley-damping", "damping", "lam"), ("hysteresis", "amplitude", "hyA"),
         ("hysteresis", "length", "hyL"), ("stress-softening", "ratio", "soR"), ("stress-softening", "length", "soL"), ("adhesion", "force", "adF"),
         ("adhesion", "length", "adL"), ("stiffening-layer", "stiffness", "laK"), ("stiffening-layer", "depth", "laD"), ("stiffness-drift", "rate", "alpha"),
         ("coulomb-friction", "coefficient", "mu"), ("viscous-friction", "damping", "cv"), ("stribeck-friction", "coefficient", "dmu"),
         ("stribeck-friction", "velocity", "vs"), ("presliding", "length", "ell"), ("friction-rounding", "velocity", "vr"),
         ("load-dependent-friction", "exponent", "pN"), ("friction-anisotropy", "anisotropy", "aniso"), ("structural-compliance", "compliance", "comp")]
MORE = [("kelvin-voigt", "damping", "c"), ("hunt-crossley", "damping", "lam"), ("zener", "time-constant", "tau0"), ("relaxation", "ratio", "r0"),
        ("relaxation", "time-constant", "tau0"), ("surface-offset", "offset", "z0"), ("tool-mass", "mass", "dm"), ("sensor-gain", "gain", "g"),
        ("sensor-lag", "time-constant", "lag"), ("time-offset", "offset", "toff")]
JOINT = [("joint-coulomb-friction", "fc", "coulomb"), ("joint-viscous-friction", "fv", "viscous"), ("joint-friction-asymmetry", "asymmetry", "asymmetry"),
         ("joint-torque-offset", "offset", "offset"), ("rotor-inertia", "inertia", "inertia"), ("joint-torque-gain", "gain", "gain"),
         ("joint-stribeck-friction", "df", "coulomb"), ("joint-load-friction", "factor", "factor"), ("joint-torque-ripple", "amplitude", "amplitude"),
         ("joint-spring", "stiffness", "stiffness")]
# in the true model, these leave the stiffness of the base without a plain number
NO_STIFFNESS = {"relaxation", "stress-softening", "hysteresis", "hertz-exponent", "stiffness-inhomogeneity", "none", "zener"}


def delay(nu):
    """Largest unstated delay between motion and force."""
    held = 1 / (nu["rate"] * nu["wrench_rate"]) if nu["wrench_rate"] and nu["hold"] else 0.0
    return abs(nu["clock"]) + held + (1 / (2 * np.pi * nu["lp_hz"]) if nu["lp_hz"] else 0.0)


def contact(case, w):
    L, S, nu = w["law"], w["sensor"], case.nu
    true = set(case.all)
    arm = case.kind == "wrench"
    v = {}
    mass_err = case.tool["mass"] - w["stated"]["mass"] if arm and "tool-mass" not in true else 0.0
    if arm and "tool-mass" in true:
        v["tool-mass.mass"] = case.tool["mass"] - w["stated"]["mass"]
    weight = abs(mass_err) * 9.81
    drift = 0.0 if nu["drift"] is None or "sensor-drift" in true else np.abs(nu["drift"][:3]).max() * case.T / 60
    r4 = L.get("r4", 0.0)
    gain_ok = "sensor-gain" not in true or weight < TOL * abs(S["gain"]) * case.tool["mass"] * 9.81 if arm else True
    turned = np.linalg.norm(S["misalign"]) > .1
    # ---- normal
    shift = L.get("toe", 0.0) / 2 + (abs(w["z0"]) if "surface-offset" not in true else 0.0)
    normal = L.get("toe", 0.0) / 2 < .005 * case.dmax and shift < .01 * case.dmax and r4 < .004 and gain_ok and not turned and \
        weight + drift < .01 * case.force and L.get("laW", 0.0) < .02 * case.dmax and not L.get("adB", 0.0) > .05
    base = case.base
    if normal and not true & NO_STIFFNESS:
        v[f"{base}.stiffness"] = L["k"]
    d = delay(nu)
    if normal and not true & {"relaxation", "hysteresis", "stress-softening", "zener", "stiffness-inhomogeneity"}:
        if L.get("c", 0) > 0 and d * L["k"] * L["n"] * case.dmax ** (L["n"] - 1) < TOL * L["c"]:
            v["kelvin-voigt.damping" if base == "kelvin-voigt" else "viscous-damping.damping"] = L["c"]
        if L.get("lam", 0) > 0 and d * L["n"] < TOL * L["lam"] * case.dmax:
            v["hunt-crossley.damping" if base == "hunt-crossley" else "hunt-crossley-damping.damping"] = L["lam"]
    if "zener" in true and r4 < TOL * L["r0"]:
        v["zener.time-constant"] = L["tau0"]
    if "relaxation" in true and case.shapes["relaxation"]["spread"] == 1.0:
        r = sum(L[f"r{i}"] for i in range(3))
        if r4 < TOL * r:
            v.update({"relaxation.ratio": r, "relaxation.time-constant": L["tau0"]})
    if "hertz-exponent" in true and normal:
        v["hertz-exponent.exponent"] = L["n"]
    if "adhesion" in true and normal and L["adB"] == 0.0 and shift * L["k"] * case.dmax ** (L["n"] - 1) + weight + drift < TOL * L["adF"]:
        v.update({"adhesion.force": L["adF"], "adhesion.length": L["adL"]})
    if "stiffening-layer" in true and normal and not true & NO_STIFFNESS:
        v.update({"stiffening-layer.stiffness": L["laK"], "stiffening-layer.depth": L["laD"]})
    if "surface-offset" in true and L.get("toe", 0.0) / 2 < TOL * abs(w["z0"]):
        v["surface-offset.offset"] = w["z0"]
    if "stiffness-drift" in true and normal and drift < TOL * abs(L["alpha"]) * case.T / 60 * case.force:
        v["stiffness-drift.rate"] = L["alpha"]
    if "structural-compliance" in true and normal and (r4 == 0 and shift < .2 * L["comp"] * case.force * TOL):
        v["structural-compliance.compliance"] = L["comp"]
    # ---- tangential
    if "coulomb-friction" in true and not true & {"load-dependent-friction", "adhesion"}:
        v["coulomb-friction.coefficient"] = L["mu"]
    if "viscous-friction" in true and .01 * L["mu"] * case.force < .03 * L["cv"] * .04:      # friction at rest of another form shifts it
        v["viscous-friction.damping"] = L["cv"]
    if "stribeck-friction" in true and L["vlag"] < 1e-3:
        v.update({"stribeck-friction.coefficient": L["dmu"], "stribeck-friction.velocity": L["vs"]})
    if "friction-rounding" in true:
        v["friction-rounding.velocity"] = L["vr"]
    if "load-dependent-friction" in true and not true & {"adhesion"}:
        v["load-dependent-friction.exponent"] = L["pN"]
    if "friction-anisotropy" in true:
        v["friction-anisotropy.anisotropy"] = L["aniso"]
    # ---- tool
    if arm:
        dc = case.tool["com"] - w["stated"]["com"]
        if "tool-com" in true and abs(mass_err) / case.tool["mass"] * np.linalg.norm(case.tool["com"]) < TOL * np.linalg.norm(dc):
            v.update({f"tool-com.com[{a}]": x for a, x in zip("xyz", dc)})
        if "tool-inertia" in case.hidden and not any(nu["tool_err"]):
            v.update({f"tool-inertia.inertia[{a}]": x for a, x in zip(("xx", "yy", "zz"), w["tool"]["inertia"])})
        if "tip-offset" in true and shift == 0 and np.allclose(case.chain.Rt, np.eye(3), atol=1e-9):
            v.update({f"tip-offset.offset[{a}]": x for a, x in zip("xyz", w["tip"] - case.chain.rtip)})
    # ---- sensor
    names = AXES if arm else ("normal_force",)
    if "sensor-bias" in true and not true & {"hysteresis", "stress-softening", "stiffness-inhomogeneity"}:
        err = weight + drift / 2 + np.linalg.norm(nu["level_base"]) * case.tool["mass"] * 9.81 if arm else drift / 2
        if err < TOL * np.linalg.norm(S["bias"][:3]) and (arm or shift * L["k"] * case.dmax ** (L["n"] - 1) < TOL * abs(S["bias"][0])):
            v.update({f"sensor-bias.offset[{a}]": S["bias"][i] for i, a in enumerate(names[:3]) if abs(S["bias"][i]) > .15 * np.linalg.norm(S["bias"][:3])})
    if "sensor-drift" in true:
        rate = S["drift"] + (0.0 if nu["drift"] is None else np.array(nu["drift"]))
        if weight < 5 * TOL * np.linalg.norm(rate[:3]) * case.T / 60:
            v.update({f"sensor-drift.rate[{a}]": rate[i] for i, a in enumerate(names[:3]) if abs(rate[i]) > .15 * np.linalg.norm(rate[:3])})
    if "sensor-gain" in true and gain_ok:
        v["sensor-gain.gain"] = S["gain"]
    if "sensor-lag" in true and normal and d < TOL * S["lag"]:
        v["sensor-lag.time-constant"] = S["lag"]
    if "saturation" in true:
        c = int(np.argmin(S["sat"]))
        v[f"saturation.limit[{names[c]}]"] = S["sat"][c]
    if "quantization" in true:
        v["quantization.step"] = S["quant"][0]
    if "mains-hum" in true:
        v["mains-hum.frequency"] = S["hum_f"]
        v.update({f"mains-hum.amplitude[{a}]": S["hum"][i] for i, a in enumerate(names[:3])})
    return v


def joint(case, w, names):
    nu, par, true = case.nu, w["par"], set(case.all)
    held = nu["tau_rate"] and nu["hold"]
    slow = nu["tau_lp"] and (not nu["zero_phase"] or nu["tau_lp"] < 40) or held
    dull = nu["tau_lp"] and nu["tau_lp"] < 20 or held
    v = {}
    gained = set(np.flatnonzero(case.gain)) if "joint-torque-gain" in true else set()
    level = "tilt" not in nu or not (any(nu["tilt"]) or any(nu["tool_err"]) and case.tool is not None)      # poses' torques are as stated

    if gained:                                                     # what isn't weight or inertia scales with the gain: no plain number
        return {f"joint-torque-gain.gain[{names[j]}]": case.gain[j] for j in sorted(gained)} if level else {}

    def put(e, key, name, skip=()):
        for j, n in enumerate(names):
            x = par[e][key][j]
            if j not in skip and x != 0.0:
                v[f"{e}.{name}[{n}]"] = x
    loaded = set(np.flatnonzero(par["joint-load-friction"]["factor"])) if "joint-load-friction" in true else set()
    if "joint-coulomb-friction" in true and not dull and "joint-stribeck-friction" not in true:
        put("joint-coulomb-friction", "fc", "coulomb", loaded)
    if "joint-viscous-friction" in true and not slow:
        put("joint-viscous-friction", "fv", "viscous")
    if "joint-torque-offset" in true and level and not true & {"joint-spring", "gravity-error", "payload"}:
        put("joint-torque-offset", "offset", "offset", loaded)
    if "joint-spring" in true and level:
        put("joint-spring", "stiffness", "stiffness")
    if "rotor-inertia" in true and not slow and not nu["tau_lp"]:
        put("rotor-inertia", "inertia", "inertia")
    if "payload" in true and level:
        v["payload.mass"] = par["payload"]["mass"]
    if case.kind == "drive" and not slow:
        v["rigid-body.inertia[joint_1]"] = case.J
    return v


def own(case, w):
    """Numbers of the hidden effects as this world defines them (README), whatever the nuisances; kept only where a refit agrees."""
    L, S, h, v = w["law"], w["sensor"], set(case.hidden), {}
    for e, name, key in PLAIN:
        if e in h:
            v[f"{e}.{name}"] = L[key]
    if "relaxation" in h:
        v.update({"relaxation.ratio": sum(L[f"r{i}"] for i in range(3)), "relaxation.time-constant": L["tau0"]})
    if "surface-offset" in h:
        v["surface-offset.offset"] = w["z0"]
    if case.kind == "wrench":
        vec = {"tool-com.com": ("xyz", case.tool["com"] - w["stated"]["com"]), "sensor-misalignment.rotation": ("xyz", S["misalign"]),
               "tool-inertia.inertia": (IJ, w["tool"]["inertia"]), "tip-offset.offset": ("xyz", case.chain.Rt.T @ (w["tip"] - case.chain.rtip))}
        for k, (names, x) in vec.items():
            if k.split(".")[0] in h:
                v.update({f"{k}[{a}]": float(y) for a, y in zip(names, x)})
        if "tool-mass" in h:
            v["tool-mass.mass"] = case.tool["mass"] - w["stated"]["mass"]
        if "sensor-crosstalk" in h:
            v.update({f"sensor-crosstalk.matrix[{AXES[i]},{AXES[j]}]": S["cross"][i, j] for i in range(3) for j in range(3) if S["cross"][i, j]})
    axes = AXES[:3] if case.kind == "wrench" else ("normal_force",)
    extra = 0.0 if case.nu["drift"] is None else np.array(case.nu["drift"])
    for e, name, x in (("sensor-bias", "offset", S["bias"]), ("sensor-drift", "rate", S["drift"] + extra)):
        if e in h:
            v.update({f"{e}.{name}[{a}]": x[i] for i, a in enumerate(axes)})
    for e, name, key in (("sensor-gain", "gain", "gain"), ("sensor-lag", "time-constant", "lag"), ("time-offset", "offset", "toff")):
        if e in h:
            v[f"{e}.{name}"] = S[key]
    return v


def refit(case, w, D, th):
    """The same names from the refit of the true model in its plain form."""
    f = {f"{e}.{name}": th[k] for e, name, k in PLAIN + MORE if k in th}
    if "k" in th:
        f[f"{case.base}.stiffness"] = th["k"]
    turn = case.chain.Rt.T if case.kind == "wrench" else None
    for key, e, names in (("c", "tool-com.com", "xyz"), ("m", "sensor-misalignment.rotation", "xyz"), ("i", "tool-inertia.inertia", IJ), ("p", "tip-offset.offset", "xyz")):
        if key + names[0] in th:
            x = np.array([th[key + a] for a in names])
            f.update({f"{e}[{a}]": y for a, y in zip(names, turn @ x if key == "p" else x)})
    axes = AXES if case.kind == "wrench" else ("normal_force",)
    for key, e in (("b*", "sensor-bias.offset"), ("d*", "sensor-drift.rate")):
        if key in th:
            f.update({f"{e}[{a}]": th[key][i] / D.wt[i] for i, a in enumerate(axes)})
    if "x*" in th:
        M = np.zeros((6, 6))
        M[~np.eye(6, dtype=bool)] = th["x*"] * D.cap["xs"]
        f.update({f"sensor-crosstalk.matrix[{AXES[i]},{AXES[j]}]": M[i, j] for i in range(3) for j in range(3) if i != j})
    if "lim" in th:
        f.update({f"saturation.limit[{axes[c]}]": th["lim"] for c in D.cap.get("sat_ch", [0])})
    return f


def own_joint(case, w, names):
    par, h, v = w["par"], set(case.hidden), {}
    for e, key, name in JOINT:
        if e in h:
            x = np.array(par[e][key])
            if e == "joint-friction-asymmetry":                    # N·m: half of what friction takes more forwards than back
                x = x * np.array(par["joint-coulomb-friction"]["fc"])
            v.update({f"{e}.{name}[{n}]": y for n, y in zip(names, x) if y != 0.0})
    if "joint-stribeck-friction" in h:
        v["joint-stribeck-friction.velocity"] = par["joint-stribeck-friction"]["vs"]
    if "joint-torque-ripple" in h:
        v["joint-torque-ripple.frequency"] = par["joint-torque-ripple"]["k"]
    if "payload" in h:
        v["payload.mass"] = par["payload"]["mass"]
    if "gravity-error" in h:
        v.update({f"gravity-error.gravity[{a}]": x for a, x in zip("xyz", np.array(par["gravity-error"]["gravity"]) - [0, 0, -9.81])})
    return v


def refit_joint(case, w, D, names):
    f, col = {}, {}
    for e, i, j, x in D.coefficients(case.all, case.truth(w)):
        col[e, i, j] = x
    for (e, i, j), x in col.items():
        name = {k: n for k, _, n in JOINT}.get(e)
        if e == "joint-torque-ripple":
            x = np.hypot(x, col[e, 2, j])
        if e == "joint-torque-gain":                               # the column is the reading itself
            x = x / (1 - x)
        if i == 0 and name:
            f[f"{e}.{name}[{names[j]}]"] = x
        elif e == "payload" and i == 0:
            f["payload.mass"] = x
        elif e == "gravity-error":
            f[f"gravity-error.gravity[{'xyz'[i]}]"] = x
        elif e == "rigid-body":
            f["rigid-body.inertia[joint_1]"] = x
    return f


def agree(v, f):
    """Keep what the refit finds too: within NEAR of the number, of the length of a vector; what no refit gives stays."""
    size = {}
    for k, x in v.items():
        g = k.split("[")[0] if not k.startswith("joint-") else k
        size.setdefault(g, []).append(x)
    out, bad = {}, set()
    for k, x in v.items():
        g = k.split("[")[0] if not k.startswith("joint-") else k
        s = np.linalg.norm(size[g])
        if k not in f or abs(f[k] - x) <= NEAR * s:
            out[k] = x
        else:
            bad.add(k.split(".")[0])
    for e, name in (("joint-stribeck-friction", "velocity"), ("joint-torque-ripple", "frequency")):    # not refitted: stay with the amounts
        if e in bad and not any(k.startswith(e) and "[" in k for k in out):
            out.pop(f"{e}.{name}", None)
    return out


def values(case, w, D, r, group, extra):
    if extra or group == "outside":
        return {}
    if case.kind in ("wrench", "tester"):
        v = agree({**contact(case, w), **own(case, w)}, refit(case, w, D, r["th"]))
    else:
        from robots import ROBOTS
        names = ROBOTS[case.robot]["joints"] if case.kind == "joints" else ["joint_1"]
        v = joint(case, w, names)
        gained = "joint-torque-gain" in case.all
        v.update({k: x for k, x in own_joint(case, w, names).items() if not gained or k.startswith("joint-torque-gain")})
        v = agree(v, refit_joint(case, w, D, names))
    if group == "unexcited":                                       # such a number can't be read from this log
        v = {k: x for k, x in v.items() if k.split(".")[0] not in case.hidden}
    return {k: float(x) for k, x in v.items()}
