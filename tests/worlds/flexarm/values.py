"""True values of the hidden effects' parameters under the catalogue's names (`effect.parameter`, a joint's number behind the word); README says what each means."""
from __future__ import annotations

import numpy as np

CH = ("fx", "fy", "fz", "tx", "ty", "tz")
TCH = ("normal_force", "tangential_force1", "tangential_force2")
MATERIAL = {
    "hertz-exponent": dict(exponent="n"), "viscous-damping": dict(damping="eta"), "hunt-crossley-damping": {"lambda": "lam"}, "relaxation": dict(ratio="r1", tau="tau1"),
    "hysteresis": dict(amplitude="ha", length="hl"), "stress-softening": dict(ratio="mr", length="ml"), "adhesion": dict(force="fa", length="al"),
    "stiffening-layer": dict(stiffness="lk", depth="ld"), "stiffness-drift": dict(rate="drift"), "structural-compliance": dict(compliance="cs"),
    "coulomb-friction": dict(mu="mu"), "viscous-friction": dict(damping="cv"), "stribeck-friction": dict(delta_mu="dmu", speed="vs"), "presliding": dict(length="bl"),
    "friction-rounding": dict(speed="vr"), "load-dependent-friction": dict(exponent="p"), "friction-anisotropy": dict(ratio="ani")}


def _contact(case, e, rig, cp, sens, tool, nu):
    s = nu["strength"]
    wrench = case.kind == "wrench"
    ch = CH if wrench else TCH[:case.C]
    if e in MATERIAL:
        return {k: cp[v] for k, v in MATERIAL[e].items() if v in cp}
    if e == "surface-offset":
        v, sh = tool[e]
        return {"offset": v * sh["sign"] + s * nu["surface"]}
    if e == "tool-mass":
        return {"mass": case.mass - rig["mass"]}
    if e == "tool-com":
        return dict(zip("xyz", case.com - rig["com"]))
    if e == "tool-inertia":
        v, sh = tool[e]
        return dict(zip(("ixx", "iyy", "izz"), v * np.array(sh["ratio"])))
    if e == "tip-offset":
        v, sh = tool[e]
        return dict(zip("xyz", v * sh["dir"]))
    if e == "sensor-bias":
        return dict(zip(ch, sens["bias"]))
    if e == "sensor-drift":
        return dict(zip(ch, np.asarray(sens["drift"]) + s * np.asarray(nu["temp"])[:len(ch)]))
    if e == "sensor-crosstalk":
        X = sens["cross"]
        return {f"{ch[i]}_{ch[j]}": X[i, j] for i in range(len(ch)) for j in range(len(ch)) if i != j}
    if e == "sensor-misalignment":
        return dict(zip(("rx", "ry", "rz"), sens["mis"]))
    if e == "sensor-gain":
        return {"gain": sens["gain"]}
    if e == "sensor-lag":
        return {"tau": sens["lag"]}
    if e == "time-offset":
        return {"offset": sens["dt"] + s * nu["clock"]}
    if e == "saturation":
        return {"limit": sens["sat"]}
    if e == "quantization":
        return {"step": float(np.max(sens["step"]))}
    if e == "mains-hum":
        return {"frequency": sens["hum"]["f"], **{f"amplitude_{c}": a for c, a in zip(ch, sens["hum"]["amp"][0])}}
    return {}


def _joint(case, e, w):
    n, fr = case.arm.n, w["fr"]
    per = lambda word, x: {f"{word}{i + 1}": v for i, v in enumerate(np.broadcast_to(np.asarray(x, float), (n,)))}
    one = {"joint-coulomb-friction": ("torque", "fc"), "joint-viscous-friction": ("damping", "fv"), "joint-friction-asymmetry": ("ratio", "asym"), "joint-load-friction": ("ratio", "lf")}
    if e in one:
        return per(one[e][0], fr[one[e][1]])
    if e == "joint-torque-offset":
        return per("offset", w["sens"]["bias"])
    if e == "joint-torque-gain":
        return per("gain", w["sens"]["gain"])
    if e == "rotor-inertia":
        return per("inertia", case.arm.B * w["rotor"])
    if e == "payload":
        return {"mass": w["payload"][0], **dict(zip("xyz", w["payload"][1]))}
    if e == "joint-elasticity":
        return per("stiffness", w["K"])
    if e == "gravity-error":
        return {"x": w["tilt"][0], "y": w["tilt"][1]}
    if e == "joint-stribeck-friction":
        return {**per("torque", fr["df"]), "speed": float(np.max(fr["vs"]))}
    if e == "joint-torque-ripple":
        return {**per("amplitude", fr["ra"]), **per("k", fr["rk"]), **per("phase", fr["rp"])}
    if e == "joint-spring":
        return {**per("stiffness", fr["ks"]), **per("rest", fr["k0"])}
    return {}


def true_values(case, hidden, rig, cp, sens, tool, nu):
    out = {}
    for e in hidden:
        got = _joint(case, e, cp) if case.kind in ("joints", "drive") else _contact(case, e, rig, cp, sens, tool, nu)
        out.update({f"{e}.{k}": float(v) for k, v in got.items()})
    return out
