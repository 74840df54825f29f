"""truth.json's "values": catalogue parameters, by "effect.parameter", whose plain meaning this log realises: exactly (nothing in the world shifts them by more than
about 2 %), or, where off-form material or sensor shift them, as far as our own refit of the true model on the logged data gives them back within 10 %."""
import numpy as np
from joints import FR

CH = ("fx", "fy", "fz", "tx", "ty", "tz")
# value -> parameter of refit.py (several: a vector, judged as a whole)
FITTED = {"relaxation.ratio": "r1", "relaxation.time-constant": "tau1", "coulomb-friction.coefficient": "mu", "viscous-friction.damping": "cv", "kelvin-voigt.damping": "c",
          "viscous-damping.damping": "c", "hunt-crossley-damping.damping": "lam", "stiffness-drift.rate": "alpha", "load-dependent-friction.exponent": "p",
          "friction-anisotropy.ratio": "a", "structural-compliance.compliance": "C", "hertz-exponent.exponent": "n", "sensor-gain.gain": "g", "sensor-lag.time-constant": "lag",
          "surface-offset.offset": "z0", "stiffening-layer.stiffness": "sK", "stiffening-layer.depth": "sB", "adhesion.force": "aF", "stress-softening.ratio": "mR",
          "stress-softening.length": "mL", "hysteresis.amplitude": "hA", "hysteresis.length": "hL", "presliding.length": "L", "friction-rounding.speed": "vr",
          "stribeck-friction.coefficient": "dmu", "stribeck-friction.speed": "vs", "time-offset.offset": "toff", "tool-mass.mass": "dm"}
VECTORS = {"tip-offset.offset": ("ox", "oy", "oz"), "sensor-misalignment.rotation": ("mx", "my", "mz"), "tool-com.com": ("dcx", "dcy", "dcz")}


def of(c, r):
    """(values of the hidden effects, values of the asked model's own parameters); r: the refit (tune.sizes)."""
    if c.kind in ("joints", "drive"):
        v, more, back = torque(c), torque(c, True), c.coefficients
    else:
        v, more = contact(c), contact(c, True)
        th = r["th"]
        back = {k: th[p] for k, p in FITTED.items() if p in th}
        for k, ps in VECTORS.items():
            want = np.array([more.get(f"{k}[{i}]", np.nan) for i in "xyz"])
            got = np.array([th.get(p, np.nan) for p in ps])
            if np.linalg.norm(want - got) < .1 * np.linalg.norm(want):
                back.update({f"{k}[{i}]": x for i, x in zip("xyz", want)})
        if c.base != "none" and "F0" in th:
            back[c.base + ".stiffness"] = th["F0"] / c.D0 ** c.n0
    v.update({k: x for k, x in more.items() if k in back and abs(back[k] - x) < .1 * abs(x)})
    v = {k: x for k, x in v.items() if x}
    mine = lambda k: k.split(".")[0] in c.hidden
    return {k: x for k, x in v.items() if mine(k)}, {k: x for k, x in v.items() if not mine(k)}


def contact(c, loose=False):
    w, q, s, v = c._world(), c.nuis, c.soft, {}
    L, p, has = w["law"], w["post"], set(c.names)
    arm = c.kind == "wrench"
    b = c.base
    straight = not q["eps"] and not q["r2"]                       # the elastic law is the catalogue's own
    faithful = s * abs(q["nonlin"]) < 2e-3 and not has & {"sensor-gain", "sensor-crosstalk", "saturation"} and not c.outside     # force is read as it is
    if loose:
        straight, faithful = True, not c.outside
    plain = straight and faithful
    if plain and b in ("hooke", "kelvin-voigt") and not has & {"relaxation", "hertz-exponent", "stiffening-layer", "stress-softening", "stiffness-drift", "stiffness-inhomogeneity"}:
        k = L["F0"] / L["D0"]
        v[b + ".stiffness"] = k
        late = s * (q["lowpass"] + abs(q["clock"])) + p.get("lag", 0.) + abs(p.get("toff", 0.))
        for name, key in (("kelvin-voigt", "c"), ("viscous-damping", "c")):
            if name in has and (loose or k * late < .02 * L[key]):
                v[name + ".damping"] = L[key]
    if plain and b in ("hertz", "hunt-crossley") and not has & {"relaxation", "hertz-exponent", "stiffening-layer", "stress-softening", "stiffness-drift", "stiffness-inhomogeneity"}:
        v[b + ".stiffness"] = L["F0"] / L["D0"] ** 1.5
    if "relaxation" in has and plain:
        v.update({"relaxation.ratio": L["r1"], "relaxation.time-constant": L["tau1"]})
    if "coulomb-friction" in has and faithful and not has & {"load-dependent-friction", "friction-rounding"}:
        v["coulomb-friction.coefficient"] = L["mu"]
    if "viscous-friction" in has and faithful:
        v["viscous-friction.damping"] = L["cv"]
    if "stiffness-drift" in has and plain:
        v["stiffness-drift.rate"] = L["alpha"]
    if "load-dependent-friction" in has and faithful:
        v["load-dependent-friction.exponent"] = L["p"]
    if "friction-anisotropy" in has and faithful:
        v["friction-anisotropy.ratio"] = L["a"]
    if "structural-compliance" in has and plain:
        v["structural-compliance.compliance"] = L["C"]
    if "hertz-exponent" in has and plain:
        v["hertz-exponent.exponent"] = L["n"]
    if "sensor-gain" in has and (loose or not q["nonlin"]):
        v["sensor-gain.gain"] = p["gain"]
    if "sensor-lag" in has and (loose or s * (q["lowpass"] + abs(q["clock"])) < .02 * p["lag"]):
        v["sensor-lag.time-constant"] = p["lag"]
    if "quantization" in has:
        v["quantization.step"] = p["quant"]
    if "surface-offset" in has and straight:
        v["surface-offset.offset"] = p["surface"] - s * q["surface"]
    T = float(c.ts[-1] if arm else c.t[-1]) / 60
    if "sensor-bias" in has and faithful:
        slack = np.zeros(6)
        if arm:
            slack = np.abs(s * q["drift"]) * T / 2 + np.array([1, 1, 1, .05, .05, .05]) * 9.81 * abs(c.rig()["mass"] - c.mass) + \
                np.array([0, 0, 0, 1, 1, 1]) * 9.81 * c.mass * np.linalg.norm(s * q["com"])
        else:
            slack[:] = s * abs(q["drift"]) * T / 2
        for i, n in enumerate(CH[:6 if arm else 1]):
            if abs(p["bias"][i]) > 50 * slack[i]:
                v[f"sensor-bias.offset[{n if arm else 'normal_force'}]"] = p["bias"][i]
    if "sensor-drift" in has and faithful:
        d = p["drift"] + s * q["drift"]
        for i, n in enumerate(CH[:6 if arm else 1]):
            v[f"sensor-drift.rate[{n if arm else 'normal_force'}]"] = d[i]
    off = s * abs(q["surface"])                                   # depth is off by this much
    if "stiffening-layer" in has and plain and (loose or off < .01 * L["sB"]):
        v.update({"stiffening-layer.stiffness": L["sK"], "stiffening-layer.depth": L["sB"]})
    if "adhesion" in has and faithful:
        v["adhesion.force"] = L["aF"]
    if "hunt-crossley-damping" in has and plain:
        v["hunt-crossley-damping.damping"] = L["lam"]
    if "stress-softening" in has and plain:
        v.update({"stress-softening.ratio": L["mR"], "stress-softening.length": L["mL"]})
    if "hysteresis" in has and plain:
        v.update({"hysteresis.amplitude": L["hA"], "hysteresis.length": L["hL"]})
    if "presliding" in has and faithful and (loose or L["bristle"] == 0):
        v["presliding.length"] = L["L"]
    if "friction-rounding" in has and faithful:
        v["friction-rounding.speed"] = L["vr"]
    if "stribeck-friction" in has and faithful:
        v.update({"stribeck-friction.coefficient": L["dmu"], "stribeck-friction.speed": L["vs"]})
    if "time-offset" in has and (loose or s * q["lowpass"] < .02 * abs(p["toff"])):      # > 0: the readings are late
        v["time-offset.offset"] = p["toff"] + s * q["clock"]
    if "saturation" in has and c.clip:
        v["saturation.limit"] = c.clip[1]
    if "tip-offset" in has and (loose or not q["tip_radius"]) and not has & {"surface-offset", "structural-compliance"}:
        v.update({f"tip-offset.offset[{k}]": w["tip_off"][i] for i, k in enumerate("xyz")})
    if "tool-inertia" in has and faithful:
        v.update({f"tool-inertia.inertia[{'xyz'[i]}{'xyz'[j]}]": p["inertia"][i, j] for i in range(3) for j in range(i, 3)})
    if "sensor-misalignment" in has and (loose or not q["nonlin"]):
        v.update({f"sensor-misalignment.rotation[{k}]": p["rot"][i] for i, k in enumerate("xyz")})
    if "sensor-crosstalk" in has and not q["nonlin"]:                         # reading i takes this share of load j
        v.update({f"sensor-crosstalk.matrix[{CH[i]},{CH[j]}]": p["cross"][i, j] for i in range(6) for j in range(6) if p["cross"][i, j]})
    if arm and "tool-mass" in has and faithful and not has & {"sensor-bias", "sensor-drift"}:
        v["tool-mass.mass"] = c.mass - c.rig()["mass"]
    if arm and "tool-com" in has and faithful and "tool-mass" not in has and (loose or not q["mass"]):
        d = c.com - c.rig()["com"]
        v.update({f"tool-com.com[{k}]": d[i] for i, k in enumerate("xyz")})
    return v


def torque(c, loose=False):
    has, s, v = set(c.names), c.soft, {}
    p = dict(zip(FR, c.pm))
    names = ["joint_1"] if c.drive else c.ch.names
    faithful = (loose or s * abs(c.nuis["nonlin"]) < 2e-3) and not c.gain.any() and not c.outside

    def per(effect, par, x):
        v.update({f"{effect}.{par}[{n}]": x[i] for i, n in enumerate(names)})
    if not faithful:
        if c.gain.any() and not c.nuis["nonlin"]:
            per("joint-torque-gain", "gain", c.gain)
        return v
    if "joint-coulomb-friction" in has and not has & {"joint-load-friction", "joint-stribeck-friction"}:
        per("joint-coulomb-friction", "coulomb", p["fc"])
    if "joint-viscous-friction" in has and "joint-stribeck-friction" not in has:
        per("joint-viscous-friction", "viscous", p["fv"])
    exact = c.drive or not c.tool or not (c.nuis["mass"] or np.any(c.nuis["com"]))
    exact = loose or exact and not np.any(c.nuis["tilt"])
    if "joint-torque-offset" in has and exact:
        per("joint-torque-offset", "offset", p["fo"])
    if "joint-friction-asymmetry" in has and exact:
        per("joint-friction-asymmetry", "asymmetry", p["fa"])
    if "joint-spring" in has and exact:
        per("joint-spring", "stiffness", p["ks"])
    if "rotor-inertia" in has and not c.drive and "joint-elasticity" not in has:
        per("rotor-inertia", "inertia", p["B"])
    if "joint-stribeck-friction" in has:
        per("joint-stribeck-friction", "stribeck", p["fs"])
        per("joint-stribeck-friction", "speed", p["vs"])
    if "joint-load-friction" in has:
        per("joint-load-friction", "load", p["fl"])
    if "joint-elasticity" in has:
        per("joint-elasticity", "compliance", c.comp)
    if "gravity-error" in has and exact:
        v.update({f"gravity-error.tilt[{k}]": c.tiltv[i] for i, k in enumerate("xyz")})
    if "payload" in has and c.pay:         # beyond the stated tool
        v["payload.mass"] = c.pay[0] + (c.tool[0] - c.stated()[0] if c.tool else 0.)
    if c.drive:
        v["rigid-body.inertia[joint_1]"] = c.inertia
    return v
