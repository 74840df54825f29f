"""tern world: 48 cases of hidden effects. python generate.py --seed S --out DATA"""
import argparse, json, os, sys, time
import numpy as np
sys.path.insert(0, os.path.dirname(os.path.abspath(__file__)))
for v in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"): os.environ.setdefault(v, "1")
from core import *; from world import *; from joints import *
import pyarrow as pa, pyarrow.parquet as pq

U = lambda r, a, b: float(r.uniform(a, b))
LU = lambda r, a, b: float(10**r.uniform(np.log10(a), np.log10(b)))
SG = lambda r: float(r.choice([-1, 1]))
# ---------------------------------------------------------------- hidden effects of wrench / tester logs: fn(r, c, s) sets the truth, returns {symbol: value}
def P_(c_, /, **k):
    for a, b in k.items(): c_["P"][IX[a]] = b
    return k
def S_(c, key, val): c.setdefault("S", {})[key] = np.array(val, float) if not np.isscalar(val) else float(val); return {key: np.asarray(val).tolist()}
def one_hot(n, d):
    x = np.zeros(n)
    for i, v in d.items(): x[i] = v
    return x
def F0(c): return c["Fest"](c["depth"]) if "Fest" in c else c["F0"]
HID = {
 "hertz-exponent": lambda r, c, s: (lambda n: P_(c, n=n, k=c["P"][IX["k"]] * c["depth"]**(c["P"][IX["n"]] - n)))(float(np.clip(c["P"][IX["n"]] + U(r, .3, .7), 1, 2.2))),
 "viscous-damping": lambda r, c, s: P_(c, c=U(r, .012, .05) * s * F0(c) / c["depth"]),
 "hunt-crossley-damping": lambda r, c, s: P_(c, lam=U(r, 3, 10) * s),
 "relaxation": lambda r, c, s: P_(c, rx=min(U(r, .15, .45) * s, .7), tau=LU(r, .2, 3)),
 "hysteresis": lambda r, c, s: P_(c, hA=U(r, .06, .18) * s * F0(c), hL=U(r, .08, .25) * c["depth"]),
 "stress-softening": lambda r, c, s: P_(c, mr=min(U(r, .2, .4) * s, .6), mL=U(r, .2, .6) * c["depth"]),
 "adhesion": lambda r, c, s: P_(c, Fa=U(r, .1, .25) * s * F0(c), La=LU(r, 2e-4, 1e-3)),
 "stiffening-layer": lambda r, c, s: P_(c, Kl=U(r, 1.5, 4) * s * F0(c) / c["depth"], db=U(r, .45, .7) * c["depth"]),
 "surface-offset": lambda r, c, s: P_(c, z0=SG(r) * U(r, .12, .3) * c["depth"]),
 "stiffness-drift": lambda r, c, s: P_(c, al=SG(r) * U(r, .1, .25) * s / c.get("Tm", 60.)),
 "stiffness-inhomogeneity": lambda r, c, s: (lambda it: P_(c, it=it, ia=min(U(r, .25, .7) * s, .9), ix=U(r, -.01, .01), iw=.045 if it == 3 else U(r, .006, .012)))(int(r.integers(1, 4))),
 "coulomb-friction": lambda r, c, s: P_(c, mu=U(r, .3, .9)),
 "viscous-friction": lambda r, c, s: P_(c, cv=U(r, 2.5, 8) * s * F0(c) / 2),
 "stribeck-friction": lambda r, c, s: P_(c, dmu=U(r, .35, .7) * s * c["P"][IX["mu"]], vs=LU(r, .006, .02)),
 "presliding": lambda r, c, s: P_(c, bl=LU(r, 1e-3, 2.5e-3) * s),
 "friction-rounding": lambda r, c, s: P_(c, vr=LU(r, .008, .03) * s),
 "load-dependent-friction": lambda r, c, s: P_(c, p=-min(U(r, .33, .5) * s, .55), N0=F0(c)),
 "friction-anisotropy": lambda r, c, s: P_(c, an=SG(r) * min(U(r, .12, .35) * s, .5)),
 "tool-mass": lambda r, c, s: c.setdefault("T", {}).update(dm=SG(r) * U(r, .06, .2) * s * (1 if c["tool"][0] > .5 else .6) + .0) or {"dm": c["T"]["dm"]},
 "tool-com": lambda r, c, s: c.setdefault("T", {}).update(dcom=r.choice([-1, 1], 3) * r.uniform(.006, .02, 3) * s) or {"dcom": c["T"]["dcom"].tolist()},
 "tool-inertia": lambda r, c, s: c.setdefault("T", {}).update(dI=np.array([1, 1.1, .6]) * U(r, 1.5e-3, 5e-3) * s) or {"dI": c["T"]["dI"].tolist()},
 "structural-compliance": lambda r, c, s: c.update(C=U(r, .25, .6) * s * c["depth"] / F0(c)) or {"C": c["C"]},
 "tip-offset": lambda r, c, s: c.update(tipoff=np.array([SG(r) * U(r, .003, .008) * s, SG(r) * U(r, .002, .008) * s, 0])) or {"offset": c["tipoff"].tolist()},
 "sensor-bias": lambda r, c, s: S_(c, "bias", r.choice([-1, 1], 6) * r.uniform(.2, .9, 6) * s * np.array([1, 1, 1.5, .03, .03, .03])),
 "sensor-drift": lambda r, c, s: S_(c, "drift", r.choice([-1, 1], 6) * r.uniform(.15, .5, 6) * s * np.array([1, 1, 1.5, .01, .01, .01]) * 60 / c.get("Tm", 60.) * 1.5),
 "sensor-crosstalk": lambda r, c, s: S_(c, "cross", (lambda A: (A.__setitem__((0, 2), SG(r) * U(r, .03, .07) * s), A.__setitem__((1, 2), SG(r) * U(r, .02, .06) * s), A)[-1])(np.zeros((6, 6)))),
 "sensor-misalignment": lambda r, c, s: S_(c, "misalign", r.choice([-1, 1], 3) * np.array([U(r, .03, .08), U(r, .03, .08), U(r, .04, .12)]) * s),
 "sensor-gain": lambda r, c, s: S_(c, "gain", one_hot(6, {0: SG(r) * U(r, .06, .15) * s, 1: SG(r) * U(r, .05, .12) * s, 2: SG(r) * U(r, .08, .15) * s})),
 "sensor-lag": lambda r, c, s: S_(c, "lag", U(r, .02, .06) * s),
 "time-offset": lambda r, c, s: {"dt": S_(c, "toff", SG(r) * U(r, .02, .05) * s)["toff"]},
 "saturation": lambda r, c, s: (S_(c, "sat", [40, 40, U(r, .55, .75) * F0(c), 2, 2, 2]), c.update(satnoise=str(r.choice(["front", "behind"]))), {"limit_fz": float(c["S"]["sat"][2])})[-1],
 "quantization": lambda r, c, s: S_(c, "qz", np.array([1, 1, 1, .02, .02, .02]) * U(r, .15, .4) * s * max(F0(c) / 8, .25)),
 "mains-hum": lambda r, c, s: (c.setdefault("S", {}).update(hum=(r.uniform(.4, 1, 6) * np.array([1, 1, 1.5, .01, .01, .01]) * U(r, .08, .25) * s * max(F0(c) / 8, .3), float(r.choice([50., 60.])), U(r, 0, 6))) or {"amplitude": c["S"]["hum"][0].tolist(), "f": c["S"]["hum"][1]}),
}
SYM = dict(rx="ratio", hA="amplitude", hL="length", mr="ratio", mL="length", Fa="F_a", La="length", Kl="K", db="delta_b", al="alpha", bl="length", cv="c", dmu="dmu", vs="v_s", vr="v_r", an="a", it="profile", ia="relative", ix="at", iw="width", lag="tau", bias="bias", drift="per_min", cross="matrix", misalign="rotation", gain="g", qz="step", K="K", lam="lambda", c="c", dm="dm", dcom="dcom", dI="inertia")
# what readings an effect acts on; near
CH = {"tool-com": [3, 4, 5], "tool-inertia": [3, 4, 5], "tip-offset": [3, 4, 5], "viscous-friction": [0, 1], "stribeck-friction": [0, 1], "presliding": [0, 1], "friction-rounding": [0, 1],
      "load-dependent-friction": [0, 1], "friction-anisotropy": [0, 1], "coulomb-friction": [0, 1], "sensor-crosstalk": [0, 1], "sensor-misalignment": [0, 1]}
NEAR = {"tool-inertia": ["sensor-lag"], "sensor-lag": ["time-offset"], "time-offset": ["sensor-lag"], "sensor-crosstalk": ["sensor-misalignment"], "sensor-misalignment": ["sensor-crosstalk"],
        "joint-friction-asymmetry": ["joint-torque-offset"], "hertz-exponent": [], "friction-rounding": ["viscous-friction", "presliding"], "viscous-friction": ["friction-rounding"],
        "tip-offset": ["sensor-crosstalk"], "sensor-gain": [], "saturation": []}
FL = {"hertz-exponent": "poke vardepth", "viscous-damping": "poke sine vardepth", "hunt-crossley-damping": "poke sine vardepth", "relaxation": "poke hold vardepth", "hysteresis": "poke sine vardepth",
      "stress-softening": "poke shallow2deep long", "adhesion": "poke vardepth wait", "stiffening-layer": "poke vardepth", "surface-offset": "poke vardepth", "stiffness-drift": "poke vardepth long constdepth",
      "stiffness-inhomogeneity": "revisit slide vardepth", "coulomb-friction": "slide poke", "viscous-friction": "slide varspeed vardepth cross", "stribeck-friction": "slide varspeed cross", "presliding": "slide small cross rest",
      "friction-rounding": "slide varspeed rest", "load-dependent-friction": "slide vardepth", "friction-anisotropy": "slide cross vardepth", "tool-mass": "free poke", "tool-com": "free poke", "tool-inertia": "freefast poke",
      "structural-compliance": "poke vardepth", "tip-offset": "poke slide tilt vardepth", "sensor-bias": "free poke vardepth", "sensor-drift": "free poke long wait hold", "sensor-crosstalk": "free poke slide vardepth",
      "sensor-misalignment": "free poke slide vardepth cross", "sensor-gain": "free poke slide vardepth", "sensor-lag": "poke sine freefast", "time-offset": "poke sine free", "saturation": "poke vardepth hold", "quantization": "poke slide", "mains-hum": "poke slide hold"}

def base_contact(r, kind, base, fl, lv):
    """the world as the user's model has it"""
    c = dict(kind=kind, fl=set(fl.split())); hz = ("hertz" in base or "hunt-crossley" in base)
    E = LU(r, 3e4, 8e5); a = U(r, .005, .012); c["depth"] = U(r, .003, .008)
    if hz: k = 4 / 3 * E / .75 * np.sqrt(a); n = 1.5
    else: k = 2 * E / .75 * a; n = 1.
    F = k * c["depth"]**n
    lim = 28. if kind != "tester" else 90.
    if F > lim: k *= lim / F
    if F < 2.5: k *= 2.5 / F
    P = pvec(k=k, n=n); c["Fest"] = lambda d, k=k, n=n: k * max(d, 0)**n
    c["P"] = P; Fd = c["Fest"](c["depth"])
    if "kelvin-voigt" in base: P_(c, c=U(r, .004, .02) * Fd / c["depth"])
    if "hunt-crossley" in base: P_(c, lam=U(r, 1, 5))
    if "zener" in base: P_(c, rx=U(r, .2, .5), tau=LU(r, .15, 1.5)); c.setdefault("keep", []).append("rx"); c["fl"].add("hold")
    if "coulomb-friction" in base: P_(c, mu=U(r, .25, .8))
    if "presliding" in base: P_(c, bl=LU(r, 3e-4, 1e-3)); c.setdefault("keep", []).append("bl")
    if "relaxation" in base: P_(c, rx=U(r, .15, .35), tau=LU(r, .2, 2))
    if "viscous-friction" in base: P_(c, cv=U(r, 2, 6) * Fd / 4)
    if "surface-offset" in base: P_(c, z0=SG(r) * U(r, 2e-4, 8e-4))
    if "sensor-bias" in base: c["S"] = {"bias": r.uniform(-.5, .5, 6) * np.array([1, 1, 1, .02, .02, .02])}
    if kind != "tester":
        rob = (lwr if kind == "lwr" else arm6)(r); rob.set_ft(U(r, .02, .05), U(r, -3, 3), [0, 0, U(r, .08, .16)]); c["robot"] = rob
        c["tool"] = (U(r, .15, .9), [U(r, -.004, .004), U(r, -.004, .004), U(r, .03, .06)]); c["srpy"] = (U(r, -.12, .12), U(r, -.12, .12), U(r, -3, 3))
        th = U(r, 0, .3) if r.random() < .3 else 0.; c["g"] = (rotv((np.cos(1.), np.sin(1.), 0), th) @ np.array([0, 0, -9.81]))
    c["rate"] = float(r.choice([100, 125, 200, 250, 500, 500, 1000, 1000, 2000] if kind != "tester" else [50, 100, 200, 500, 1000]))
    c["Tmax"] = (240 if c["rate"] <= 125 else 100) if c["rate"] <= 500 else (60 if c["rate"] == 1000 else 30)
    if c["rate"] <= 125 and r.random() < .5: c["fl"].add("vlong")
    if "mains-hum" in c["fl"]: pass
    c["nu"] = nuis(r, lv, kind)
    if kind == "tester": c["noise"] = np.array([.02, .02, .03, 0, 0, 0]) * U(r, .3, 1)
    return c

def vals(effs, got):
    out = {}
    for e, d in got.items():
        for k, v in d.items(): out[f"{e}.{SYM.get(k, k) if not e.startswith('joint') else k}"] = v if not isinstance(v, np.generic) else v.item()
    return out

# ---------------------------------------------------------------- hidden effects of joint logs
def jh(e, r, c, s):
    rob = c["robot"]; n = rob.n if rob else 1; H = c["H"]; Fc = c["Fc0"]; some = np.ones(n) if r.random() < .5 or n == 1 else (r.random(n) < .6).astype(float)
    if some.sum() == 0: some[:] = 1
    sg = r.choice([-1, 1], n)
    if e == "joint-coulomb-friction": H["Fc"] = Fc * r.uniform(.7, 1.3, n) * s; return {"Fc": H["Fc"].tolist()}
    if e == "joint-viscous-friction": H["Fv"] = c["Fv0"] * r.uniform(.8, 1.5, n) * s; return {"Fv": H["Fv"].tolist()}
    if e == "joint-friction-asymmetry": H["asym"] = sg * np.minimum(r.uniform(.2, .4, n) * s, .6); return {"a": H["asym"].tolist()}
    if e == "joint-torque-offset": H["off"] = sg * Fc * r.uniform(.4, 1, n) * s; return {"offset": H["off"].tolist()}
    if e == "rotor-inertia": H["rotor"] = c["rotor0"] * r.uniform(.8, 1.6, n) * s; return {"I": H["rotor"].tolist()}
    if e == "joint-torque-gain": H["gain"] = sg * r.uniform(.06, .15, n) * s; return {"g": H["gain"].tolist()}
    if e == "payload": H["payload"] = (U(r, .5, 2.) * s * (1 if c["kind"] == "lwrj" else c["msc"]), np.array([U(r, -.03, .03), U(r, -.03, .03), U(r, .03, .12)])); return {"mass": H["payload"][0], "com": H["payload"][1].tolist()}
    if e == "joint-elasticity":
        H["K"] = c["K0"] * U(r, .12, .3) / s; return {"K": np.asarray(H["K"]).tolist()}
    if e == "gravity-error": H["gtilt"] = np.radians(U(r, 2, 4)) * s; H["gdir"] = U(r, 0, 6.28); return {"tilt": H["gtilt"], "about_xy": H["gdir"]}
    if e == "joint-stribeck-friction": H["dF"] = Fc * r.uniform(.5, 1., n) * s; H["vs"] = LU(r, .04, .15); return {"dF": H["dF"].tolist(), "v_s": H["vs"]}
    if e == "joint-load-friction": H["lf"] = np.full(n, U(r, .05, .12) * s); return {"f": H["lf"].tolist()}
    if e == "joint-torque-ripple":
        k = int(r.choice([4, 6, 8, 12, 16])) if n > 1 else int(r.choice([6, 7, 12, 24])); H["ripple"] = (Fc * r.uniform(.3, .8, n) * s * .8, k, r.uniform(0, 6.28, n)); return {"amplitude": H["ripple"][0].tolist(), "k": k}
    if e == "joint-spring": H["spring"] = Fc * r.uniform(.8, 2, n) * s * some; return {"k": H["spring"].tolist()}
    raise KeyError(e)
def base_joint(r, kind, base, lv):
    c = dict(kind=kind, H={}, B={})
    if kind == "drive":
        c["robot"] = None; sc = LU(r, .3, 30); c["J"] = .02 * sc * U(r, .5, 2); c["Fc0"] = np.array([.15]) * sc; c["Fv0"] = np.array([.08]) * sc; c["rotor0"] = np.array([.01 * sc]); c["tn"] = np.array([.004]) * sc * U(r, .5, 2)
        c["amp"], c["mid"] = np.array([3.]), np.array([0.]); c["traj"] = str(r.choice(["turns", "fourier", "turns"])); c["fmax"] = 1.; c["K0"] = np.array([25.]) * sc
        if c["traj"] == "fourier": c["amp"] = np.array([2.5]) ; c["fmax"] = .8
    else:
        rob = (lwr if kind == "lwrj" else arm6)(r); rob.set_ft(.03, 0, [0, 0, .1]); c["robot"] = rob; f = U(r, .6, 1.3); c["Fc0"], c["Fv0"], c["rotor0"], c["tn"] = rob.Fc * f, rob.Fv * f, rob.rotor * f, rob.tau_noise * U(r, .5, 1)
        c["amp"], c["mid"] = rob.amp * U(r, .7, 1.2), rob.mid; c["K0"] = rob.KJ; c["msc"] = sum(rob.m) / 22; c["traj"] = str(r.choice(["fourier", "moves", "fourier"])); c["fmax"] = U(r, .25, .6)
    b = c["B"]
    if "joint-coulomb-friction" in base: b["Fc"] = c["Fc0"]
    if "joint-viscous-friction" in base: b["Fv"] = c["Fv0"]
    if "rotor-inertia" in base: b["rotor"] = c["rotor0"]
    if "joint-torque-offset" in base: b["off"] = r.uniform(-.5, .5, len(c["Fc0"])) * c["Fc0"]
    c["rate"] = float(r.choice([50, 100, 125, 200, 250, 500, 1000, 2000])); c["T"] = min(LU(r, 12, 300), 40000 / c["rate"]); c["nu"] = nuis(r, lv, kind); return c

# ---------------------------------------------------------------- recipes: (group, kind, base, effects, extra flags)
CV = ["kelvin-voigt,coulomb-friction", "hooke,coulomb-friction,sensor-bias", "kelvin-voigt,coulomb-friction,sensor-bias"]
ONE = [("lwr", "hooke", ["hertz-exponent"]), ("tester", "hertz", ["viscous-damping"]), ("arm6", "hertz", ["hunt-crossley-damping"]), ("lwr", "kelvin-voigt,coulomb-friction", ["relaxation"]),
  ("tester", "hooke", ["hysteresis"]), ("tester", "hooke,viscous-damping", ["stress-softening"]), ("lwr", "hertz,coulomb-friction", ["adhesion"]), ("tester", "kelvin-voigt", ["stiffening-layer"]),
  ("arm6", "kelvin-voigt,coulomb-friction", ["surface-offset"]), ("tester", "zener", ["stiffness-drift"]), ("lwr", "hooke,coulomb-friction", ["stiffness-inhomogeneity"]), ("arm6", "hunt-crossley,sensor-bias", ["coulomb-friction"]),
  ("lwr", "hooke,coulomb-friction", ["viscous-friction"]), ("arm6", "kelvin-voigt,coulomb-friction", ["stribeck-friction"]), ("tester", "hooke,coulomb-friction", ["presliding"]), ("tester", "hooke,coulomb-friction", ["friction-rounding"]),
  ("lwr", "hooke,coulomb-friction", ["load-dependent-friction"]), ("arm6", "kelvin-voigt,coulomb-friction", ["friction-anisotropy"]), ("arm6", "hooke,coulomb-friction", ["tool-mass"]), ("lwr", "kelvin-voigt", ["tool-com"]),
  ("arm6", "hertz", ["tool-inertia"]), ("lwr", "hertz,coulomb-friction", ["structural-compliance"]), ("lwr", "kelvin-voigt,coulomb-friction", ["tip-offset"]), ("arm6", "kelvin-voigt,coulomb-friction", ["sensor-bias"]),
  ("lwr", "zener,sensor-bias", ["sensor-drift"]), ("arm6", "hooke,coulomb-friction", ["sensor-crosstalk"]), ("lwr", "hooke,coulomb-friction", ["sensor-misalignment"]), ("arm6", "kelvin-voigt,coulomb-friction", ["sensor-gain"]),
  ("lwr", "hooke", ["sensor-lag"]), ("arm6", "hertz", ["time-offset"]), ("tester", "hooke", ["saturation"]), ("lwr", "kelvin-voigt,coulomb-friction", ["quantization"]), ("arm6", "zener,coulomb-friction", ["mains-hum"]), ("tester", "zener", ["mains-hum"])]
JB = "rigid-body,joint-coulomb-friction,joint-viscous-friction"
JONE = [("lwrj", "rigid-body,joint-viscous-friction", ["joint-coulomb-friction"]), ("arm6j", "rigid-body,joint-coulomb-friction,rotor-inertia", ["joint-viscous-friction"]), ("arm6j", JB, ["joint-friction-asymmetry"]),
  ("lwrj", JB, ["joint-torque-offset"]), ("arm6j", JB, ["rotor-inertia"]), ("lwrj", JB + ",joint-torque-offset", ["joint-torque-gain"]), ("lwrj", JB, ["payload"]), ("arm6j", JB + ",rotor-inertia", ["joint-elasticity"]),
  ("arm6j", JB + ",joint-torque-offset", ["gravity-error"]), ("drive", JB, ["joint-stribeck-friction"]), ("lwrj", JB, ["joint-load-friction"]), ("drive", JB, ["joint-torque-ripple"]), ("drive", JB + ",joint-torque-offset", ["joint-spring"]),
  ("arm6j", JB + ",rotor-inertia", ["joint-stribeck-friction"]), ("lwrj", JB, ["joint-torque-ripple"])]
TWO = [("lwr", "hooke,coulomb-friction", ["relaxation", "stribeck-friction"]), ("arm6", "kelvin-voigt", ["coulomb-friction", "sensor-bias"]), ("tester", "hooke", ["stiffening-layer", "hysteresis"]), ("lwr", "kelvin-voigt,coulomb-friction", ["tool-mass", "stiffness-inhomogeneity"]),
  ("arm6", "hertz,coulomb-friction", ["friction-anisotropy", "tool-com"]), ("tester", "hertz", ["hunt-crossley-damping", "stiffness-drift"]), ("lwr", "hooke,coulomb-friction", ["surface-offset", "sensor-crosstalk"]), ("arm6", "hooke,coulomb-friction", ["load-dependent-friction", "sensor-drift"])]
JTWO = [("lwrj", JB, ["payload", "joint-torque-offset"]), ("arm6j", "rigid-body,joint-viscous-friction", ["joint-coulomb-friction", "gravity-error"]), ("drive", "rigid-body,joint-coulomb-friction", ["joint-viscous-friction", "joint-torque-ripple"]), ("arm6j", JB, ["rotor-inertia", "joint-spring"])]
QUIET = [("lwr", "kelvin-voigt,coulomb-friction", "poke slide vardepth"), ("lwr", "hunt-crossley,coulomb-friction,sensor-bias", "poke slide sine free"), ("arm6", "zener,coulomb-friction,presliding", "poke slide small hold"), ("arm6", "hertz,coulomb-friction,surface-offset", "poke vardepth tilt"),
  ("tester", "zener", "poke hold vardepth"), ("tester", "hertz,viscous-damping", "poke sine vardepth"), ("lwrj", JB + ",rotor-inertia", ""), ("arm6j", JB + ",joint-torque-offset", ""), ("drive", JB, ""), ("tester", "hooke,coulomb-friction", "poke slide cross"), ("arm6", "kelvin-voigt,coulomb-friction,sensor-bias", "slide cross free")]
NOTEX = [("tester", "hooke", ["viscous-damping"], "poke slow vardepth constdepth"), ("lwr", "kelvin-voigt,coulomb-friction", ["friction-anisotropy"], "slide along onespeed"), ("tester", "hertz", ["stiffening-layer"], "poke vardepth"), ("arm6", "hooke,coulomb-friction,sensor-bias", ["tool-com"], "poke"),
  ("lwr", "hooke,coulomb-friction", ["load-dependent-friction"], "slide onespeed constdepth"), ("lwrj", JB + ",joint-torque-offset", ["rotor-inertia"], ""), ("arm6", "kelvin-voigt,coulomb-friction", ["stribeck-friction"], "slide onespeed along")]
OUT = [("tester", "hooke,viscous-damping", "plastic-dent", ["hysteresis", "stress-softening", "surface-offset"], "poke shallow2deep long"), ("lwr", "kelvin-voigt,coulomb-friction", "snap-through-shell", ["hertz-exponent", "stiffening-layer"], "poke vardepth"),
  ("tester", "hooke", "pore-fluid-squeeze", ["viscous-damping", "hunt-crossley-damping", "relaxation"], "poke sine vardepth"), ("arm6", "hooke,coulomb-friction", "ribbed-surface", ["stiffness-inhomogeneity"], "slide vardepth"),
  ("arm6", "kelvin-voigt,coulomb-friction", "cable-pull", ["tool-mass", "sensor-bias", "tool-com"], "free slide poke"), ("lwr", "kelvin-voigt,coulomb-friction", "pump-shake-17Hz", ["mains-hum"], "poke slide hold"),
  ("drive", JB, "air-drag-v2", ["joint-viscous-friction", "joint-stribeck-friction"], ""), ("arm6j", JB, "warm-up-of-friction", ["joint-viscous-friction"], ""), ("lwrj", JB, "bumper-touched", ["joint-spring", "gravity-error"], ""), ("arm6j", JB, "shaking-neighbour-0.43Hz", ["joint-torque-ripple"], "")]

def outside(c, kind, r, s):
    d, F = c.get("depth"), (c["Fest"](c["depth"]) if "Fest" in c else 0)
    if kind == "plastic-dent": P_(c, o_type=1, o1=.35 * F, o2=U(r, .6, 1.2) * F / d); return {"yield_N": .35 * F, "hardening_N_per_m": float(c["P"][IX["o2"]])}
    if kind == "snap-through-shell": P_(c, o_type=2, o1=min(U(r, .3, .5) * s, .7), o2=.5 * d, o3=.06 * d); return {"share": float(c["P"][IX["o1"]]), "depth": .5 * d}
    if kind == "pore-fluid-squeeze": P_(c, o_type=3, o1=U(r, .8, 1.5) * s * F / 4); return {"N_per_sqrt(m/s)_at_5mm": float(c["P"][IX["o1"]])}
    if kind == "ribbed-surface": P_(c, o_type=4, o1=U(r, .12, .22) * s, o2=U(r, .003, .006)); return {"share": float(c["P"][IX["o1"]]), "period": float(c["P"][IX["o2"]])}
    if kind == "cable-pull":
        k = U(r, 4, 9) * s; L0 = U(r, .5, .7); anc = None
        def wf(t, R, q, p, w):
            a = p[0] + np.array([.1, .2, .5]); u = a - p - R @ np.array([.03, 0, .05]); l = np.linalg.norm(u, axis=1, keepdims=True); f = k * np.maximum(l - .75 * l[0], 0) * u / l; fs = np.einsum('nji,nj->ni', R, f)
            return np.concatenate([fs, np.cross(np.tile([.03, 0, .05], (len(t), 1)), fs)], 1)
        c["wfun"] = wf; return {"spring_N_per_m": k}
    if kind == "pump-shake-17Hz":
        A = U(r, .15, .35) * s * max(F / 6, .4)
        def wf(t, R, q, p, w):
            e = np.repeat((np.sin(2 * np.pi * t / 7.3) > -.2).astype(float)[:, None], 6, 1); h = np.sin(2 * np.pi * (17.3 * t + .8 * np.sin(2 * np.pi * .11 * t)))
            return e * h[:, None] * A * np.array([1, .6, 1.2, .04, .05, .01])
        c["wfun"] = wf; return {"A": A}
    H = c["H"]; n = len(c["Fc0"])
    if kind == "air-drag-v2": H["drag"] = c["Fv0"] * U(r, 1., 2.) * s; return {"drag": H["drag"].tolist()}
    if kind == "warm-up-of-friction": H["warm"] = np.full(n, U(r, .8, 1.4) * s); H["warmT"] = U(r, .2, .4) * c["T"]; return {"share": H["warm"].tolist(), "tau": H["warmT"]}
    if kind == "bumper-touched": H["bump"] = [(f * U(r, 15, 30) * s, m + .4 * a) for f, m, a in zip(c["Fc0"], c["mid"], c["amp"])]; return {"k": [b[0] for b in H["bump"]]}
    if kind == "shaking-neighbour-0.43Hz": H["hose"] = c["Fc0"] * r.uniform(.5, .9, n) * s; return {"A": H["hose"].tolist()}
def strip(c):
    """copy without what is outside"""
    c = dict(c); c.pop("wfun", None)
    if "P" in c: c["P"] = c["P"].copy(); c["P"][IX["o_type"]] = 0
    if "H" in c: c["H"] = {k: v for k, v in c["H"].items() if k not in ("drag", "warm", "warmT", "bump", "hose")}
    return c

isj = lambda kind: kind in ("lwrj", "arm6j", "drive")
def left(o, comps, ch=None, **kw):
    if isj(o["c"]["kind"]): return fit_joint(o, comps)[0]
    return fit_contact(o, comps, **kw)[0]
def chans(e, c):
    if isj(c["kind"]): return list(range(c["robot"].n if c["robot"] else 1))
    if c["kind"] == "tester": return [0, 1] if e in CH and c["P"][IX["mu"]] > 0 else [2]
    return CH.get(e, [0, 1, 2])
def judge(o, group, base, truth, mg=1.):
    """-> (ok, ratio text list)"""
    c = o["c"]; b = base.split(",")
    if group == "one":
        ch = chans(truth[0], c); r0 = rms(left(o, b), ch)
        if truth[0] == "quantization": st = c["S"]["qz"][2] / np.sqrt(12); r1 = np.sqrt(max(r0**2 - st**2, 1e-12)); ns = c["nu"]["nz"] * NOISE[2]; return ns < .6 * c["S"]["qz"][2] and r0 < 1.6 * st * 2, dict(base=r0, truth=float(r1), lattice=float(st))
        r1 = rms(left(o, b + truth, nfev=40), ch); return bool(r0 >= 2 * mg * r1), dict(base=r0, truth=r1)
    if group == "two":
        rs = []; ok = True; full = left(o, b + truth, nfev=40)
        for e in truth:
            ch = chans(e, c); rr = rms(left(o, b + [x for x in truth if x != e]), ch); r1 = rms(full, ch); ok &= bool(rr >= 1.5 * mg * r1); rs.append((rr, r1))
        return ok, {f"without {e}": a[0] for e, a in zip(truth, rs)} | {"truth": [a[1] for a in rs]}
    ch = list(range(c["robot"].n if c["robot"] else 1)) if isj(c["kind"]) else ([0, 1, 2] if c["kind"] != "tester" or c["P"][IX["mu"]] > 0 else [2])
    if isj(c["kind"]): R, y = fit_joint(o, b); yy = y
    else: R, yy, _ = fit_contact(o, b)
    r0 = rms(R, ch); yr = rms(yy, ch)
    if group == "quiet":
        if isj(c["kind"]): fl = o["true_error"]
        else:
            fl = max(o["true_error"], rms(fit_true(o), ch))
        # each readings group by itself within 2 % (or within the noise)
        return bool((r0 <= 1.3 * fl and r0 <= .12 * yr) or r0 <= .02 * yr), dict(base=r0, floor=fl, rms=yr)
    if group == "not-excited":
        r1 = rms(left(o, b + truth), ch); fl = o["true_error"] if isj(c["kind"]) else max(o["true_error"], rms(fit_true(o), ch)); return bool(r0 <= max(1.3 * fl, .02 * yr) and r0 <= .08 * yr and r0 <= 1.05 * r1), dict(base=r0, truth=r1, floor=fl, rms=yr)
    if group == "outside":
        cc = strip(c); tw = (make_joint if isj(c["kind"]) else make_contact)(cc); r1 = rms(left(tw, b), ch); return bool(r0 >= 2 * mg * r1), dict(base=r0, without=r1, rms=yr)
ALT = {"hertz-exponent": ["stiffening-layer"], "stiffening-layer": ["hertz-exponent"], "surface-offset": ["hertz-exponent", "structural-compliance"], "structural-compliance": ["hertz-exponent", "surface-offset"], "viscous-damping": ["hunt-crossley-damping", "relaxation"],
       "hunt-crossley-damping": ["viscous-damping", "relaxation"], "relaxation": ["viscous-damping", "hysteresis"], "hysteresis": ["relaxation"], "stribeck-friction": ["viscous-friction"], "friction-rounding": ["viscous-friction", "presliding"], "viscous-friction": ["friction-rounding"],
       "presliding": ["friction-rounding"], "sensor-lag": ["time-offset"], "time-offset": ["sensor-lag"], "stiffness-drift": ["stress-softening"], "load-dependent-friction": ["viscous-friction"], "tool-inertia": []}
def near_by_test(o, base, truth):
    """alternatives that leave no more than 1.1 x what the truth leaves"""
    c = o["c"]; out = []; b = base.split(",")
    if isj(c["kind"]) or len(truth) != 1: return out
    e = truth[0]; ch = chans(e, c); r1 = rms(left(o, b + truth), ch); d = c["depth"]; F = F0(c)
    st = {"hertz-exponent": dict(n=c["P"][IX["n"]] * 1.05), "stiffening-layer": dict(Kl=.5 * F / d, db=.4 * d), "structural-compliance": {}, "surface-offset": dict(z0=.05 * d), "viscous-damping": dict(c=.01 * F / d), "hunt-crossley-damping": dict(lam=3.), "relaxation": dict(rx=.15, tau=.5),
          "hysteresis": dict(hA=.05 * F, hL=.15 * d), "viscous-friction": dict(cv=1.), "friction-rounding": dict(vr=.003), "presliding": dict(bl=5e-4), "stress-softening": dict(mr=.1, mL=.3 * d)}
    for a in ALT.get(e, []):
        if a in b: continue
        c2 = dict(c); P = c["P"].copy(); P[IX["cv"]] = P[IX["cv"]] if e != "viscous-friction" else 0
        for k, v in st.get(a, {}).items(): P[IX[k]] = v
        if e == "relaxation": P[IX["rx"]] = 0
        c2["P"] = P; c2["C"] = c.get("C") or .15 * d / F; S = dict(c.get("S", {})); S["lag"] = S.get("lag", .02); S["toff"] = S.get("toff", .02); c2["S"] = S
        try:
            r2 = rms(fit_contact(dict(o, c=c2), b + [a], nfev=40)[0], ch)
            if r2 <= 1.1 * r1: out.append(a)
        except Exception: pass
    return out
def fit_true(o):
    c = o["c"]; P = c["P"].copy(); nu = c["nu"]; comps = [x for x in ("sensor-bias",) if "bias" in c.get("S", {})]
    P[IX["fk"]] = nu["fk"]
    if "bl" not in c.get("keep", ()): P[IX["bl"]] = nu["bl"]
    P[IX["r2"]] = nu["r2"]; P[IX["tau2"]] = nu["tau2"]; P[IX["n"]] += nu["n"]; P[IX["k"]] *= (c["depth"] * .6)**(-nu["n"])
    if P[IX["mu"]] > 0 and P[IX["dmu"]] == 0: P[IX["dmu"]] = nu["st_dmu"] * P[IX["mu"]]; P[IX["vs"]] = nu["vs"]
    return fit_contact(o, comps, fixed=P)[0]

def try_case(seed, group, rec, att):
    r = np.random.default_rng(seed); kind, base = rec[0], rec[1]; lv = max(1 - .25 * att, .12) if att < 5 else .1 ; s = 1 + .3 * att; got = {}; notes = ""
    truth = rec[2] if group in ("one", "two", "not-excited") else []
    if isj(kind):
        c = base_joint(r, kind, base, lv)
        if "joint-torque-ripple" in truth and kind != "drive": c["traj"] = "fourier"; c["amp"] = c["amp"] * 1.3
        if "joint-elasticity" in truth or "rotor-inertia" in truth: c["fmax"] = max(c["fmax"], .6)
        if "joint-stribeck-friction" in truth: c["traj"] = "turns" if kind == "drive" else "moves"; c["T"] = max(c["T"], 25)
        if group == "not-excited": c["traj"] = "fourier"; c["fmax"] = .025; c["T"] = max(c["T"], 40)
        if group in ("quiet",): pass
        if "joint-elasticity" in truth:
            for k in ("Fc0", "Fv0"): c[k] = c[k] * .4
            c["B"].update({k: c["B"][k] * .4 for k in ("Fc", "Fv") if k in c["B"]})
        for e in truth: got[e] = jh(e, r, c, s)
        if group == "not-excited": pass
        if group == "outside": got = {"outside": outside(c, rec[2], r, s)}
        if att >= 2 and group in ("quiet", "not-excited"): c["nu"]["clock"] *= .5
        o = make_joint(c)
    else:
        fl = rec[3] if group == "not-excited" else (rec[2] if group == "quiet" else (rec[4] if group == "outside" else " ".join(FL[e] for e in truth)))
        if kind == "tester": fl = " ".join(x for x in fl.split() if x not in ("free", "freefast", "tilt"))
        if kind == "tester" and "slide" not in fl and "poke" not in fl and "revisit" not in fl: fl += " poke"
        c = base_contact(r, kind, base, fl, lv); c["Tm"] = min(c["Tmax"], 60) if "vlong" not in c["fl"] else 180.
        if "mains-hum" in truth: c["rate"] = float(r.choice([500, 1000])); c["Tmax"] = 40
        if c["rate"] < 100 and ("sine" in c["fl"]): c["rate"] = 200.
        if {"sensor-lag", "time-offset", "tool-inertia", "adhesion"} & set(truth): c["rate"] = max(c["rate"], 200.)
        if "presliding" in truth: c.setdefault("keep", []).append("bl")
        for e in truth: got[e] = HID[e](r, c, s)
        if "hertz-exponent" in truth: c["nu"]["n"] = 0.
        if group == "not-excited":
            e = truth[0]
            if e == "viscous-damping": c["nu"]["Kc"] = 3000; got[e] = P_(c, c=.002 * F0(c) / c["depth"])
            if e == "stiffening-layer": got[e] = P_(c, db=1.6 * c["depth"], Kl=2 * F0(c) / c["depth"])
            if e == "load-dependent-friction" or e == "stribeck-friction": c["fl"].discard("vardepth"); c["nu"]["n"] = 0
        if "stiffness-drift" in truth: c["nu"]["tdrift"] = 0.
        if group == "outside": got = {"outside": outside(c, rec[2], r, s)}; c["outside"] = True
        o = make_contact(c)
    ok, txt = judge(o, group, base, truth, 1.05)
    near = sorted({x for e in truth for x in NEAR.get(e, [])} - set(base.split(",")))
    if ok and group == "one": near = sorted(set(near) | set(near_by_test(o, base, truth)))
    row = dict(case="", group=group, kind=("outside:" + rec[2] if group == "outside" else kind.replace("lwrj", "lwr-torque").replace("arm6j", "arm-torque").replace("arm6", "arm-wrench").replace("lwr", "lwr-wrench") if not kind.endswith("j") else kind.replace("lwrj", "lwr-torque").replace("arm6j", "arm-torque")),
               model=base, truth=truth, near=near, values=vals(truth, got), true_error=o["true_error"], notes=notes)
    if group == "outside": row["class"] = rec[3]; row["kind"] = rec[2]
    row["check"] = {k: (np.round(v, 5).tolist() if not isinstance(v, list) else [round(float(x), 5) for x in v]) for k, v in txt.items()}; row["check"]["ok"] = bool(ok); row["rows"] = len(o["L"]["t"]); row["retries"] = att
    return ok, o, row, txt

def toml(v): return json.dumps(v)
def write(d, o, row, r, name):
    c = o["c"]; os.makedirs(d, exist_ok=True); L = dict(o["L"]); rig = []
    tj = isj(c["kind"])
    if c.get("robot"):
        open(os.path.join(d, "robot.urdf"), "w").write(c["robot"].urdf()); sf = "ft_sensor" if not tj else "flange"; tf = "tool_tip"
        rig += ['[robot]', 'model = "robot.urdf"', f'sensor_frame = "{sf}"', f'tip_frame = "{tf}"']
        if not tj: rig += [f"gravity = {toml([round(float(x), 6) for x in c['g']])}"]
        rig += [f"joints = {toml([f'joint_{i+1}' for i in range(c['robot'].n)])}", ""]
        if not tj:
            rig += ["[tool]", f"mass = {c['tool'][0]:.6g}", f"com = {toml([round(float(x), 6) for x in c['tool'][1]])}", "", "[surface]", f"point = {toml([float('%.9g' % x) for x in c['point']])}",
                    f"normal = {toml([float('%.12g' % x) for x in c['Rs'][:, 2]])}", f"tangent = {toml([float('%.12g' % x) for x in c['Rs'][:, 0]])}", ""]
            if r.random() < .6: rig += ["[sensor]", "range = [40, 40, 120, 2, 2, 2]", f"noise = {toml([float('%.4g' % x) for x in NOISE * c['nu']['nz']])}", ""]
    if not rig: rig = ["# no robot: a " + ("drive" if c["kind"] == "drive" else "material tester")]
    open(os.path.join(d, "rig.toml"), "w").write("\n".join(rig) + "\n")
    if r.random() < .3: L.pop("phase", None)
    if r.random() < .2 and len(L["t"]) < 20000:
        import pyarrow.csv as pc
        T = {k: (np.array([float("%.9g" % x) for x in v]) if v.dtype.kind == "f" else v.astype(object)) for k, v in L.items()}; pc.write_csv(pa.table({k: pa.array(list(v)) if v.dtype.kind == "O" else pa.array(v) for k, v in T.items()}), os.path.join(d, "log.csv"))
    else: pq.write_table(pa.table({k: (pa.array([str(x) for x in v]) if v.dtype.kind in "UO" else pa.array(v)) for k, v in L.items()}), os.path.join(d, "log.parquet"))

def plan(r):
    def pick(pools, n, used):
        sel = []; pool = [x for p in pools for x in p]; r.shuffle(pool)
        return pool
    idx = lambda p: [p[i] for i in r.permutation(len(p))]
    return dict(one=(idx(ONE), idx(JONE)), two=(idx(TWO), idx(JTWO)), quiet=idx(QUIET), outside=idx(OUT), ne=idx(NOTEX))
def main():
    ap = argparse.ArgumentParser(); ap.add_argument("--seed", type=int, required=True); ap.add_argument("--out", required=True); ap.add_argument("--verbose", action="store_true"); A = ap.parse_args()
    t00 = time.time(); r = np.random.default_rng([A.seed, 7717]); pl = plan(r); used = {}; rows = []; objs = []
    def fill(group, pool, n, maxatt=6, again=False):
        k = 0; pool = list(pool); full = list(pool)
        while pool and k < n:
            rec = min(pool, key=lambda x: max([used.get(e, 0) for e in x[2]] or [0]) if group in ("one", "two") else 0); pool = [x for x in pool if x is not rec]
            eff = rec[2] if group in ("one", "two") else []
            if any(used.get(e, 0) >= 2 for e in eff): continue
            sd = int(r.integers(1 << 31)); done = False
            for att in range(maxatt):
                t0 = time.time()
                try: ok, o, row, txt = try_case([sd, att], group, rec, att)
                except Exception as e:
                    if A.verbose: import traceback; print("!!", group, rec, repr(e)); traceback.print_exc(limit=-3)
                    continue
                if A.verbose: print(group, rec[:3], "att", att, "ok" if ok else "--", {a: np.round(b, 4).tolist() for a, b in txt.items()}, "T%.0f r%.0f %.1fs" % (o["L"]["t"][-1], o["c"]["rate"], time.time() - t0), flush=True)
                if ok: done = True; break
            if done:
                k += 1; objs.append(o); o.pop("cache", None); o.pop("jc", None); rows.append(row)
                for e in eff: used[e] = used.get(e, 0) + 1
        if k < n and not again: k += fill(group, full, n - k, maxatt, True)
        if k < n and not again: print("only", k, "of", n, group, file=sys.stderr)
        return k
    fill("two", pl["two"][0], 4); fill("two", pl["two"][1], 3); fill("one", pl["one"][1], 7); fill("one", pl["one"][0], 15)
    fill("quiet", pl["quiet"], 9, 8); fill("outside", pl["outside"], 6); fill("not-excited", pl["ne"], 4)
    for grp, n in (("one", 22), ("two", 7)):
        m = sum(x["group"] == grp for x in rows)
        if m < n: fill(grp, [x for p in pl[grp] for x in p if not any(x[1] == y["model"] and x[2] == y["truth"] for y in rows)], n - m, 3)
    os.makedirs(A.out, exist_ok=True); order = r.permutation(len(rows)); truth = []
    for i, j in enumerate(order):
        nm = f"tern_{i:02d}"; rows[j]["case"] = nm; write(os.path.join(A.out, nm), objs[j], rows[j], r, nm); truth.append(rows[j])
    import pickle; os.makedirs(os.path.join(A.out, "_check"), exist_ok=True)
    for i, j in enumerate(order):
        c = {k: v for k, v in objs[j]["c"].items() if k not in ("wfun", "Fest")}; c["F0"] = float(objs[j]["c"]["Fest"](c["depth"])) if "depth" in c else 0.
        pickle.dump(dict(c=c, true_error=objs[j]["true_error"]), open(os.path.join(A.out, "_check", f"tern_{i:02d}.pkl"), "wb"))
    json.dump(truth, open(os.path.join(A.out, "truth.json"), "w"), indent=1, default=lambda x: x.tolist() if hasattr(x, "tolist") else str(x))
    print(len(truth), "cases in %.0f s" % (time.time() - t00))
if __name__ == "__main__": main()
