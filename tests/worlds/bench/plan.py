"""Which 48 cases a seed holds."""
import numpy as np
import effects as E

JOINT = ["joint-coulomb-friction", "joint-viscous-friction", "joint-friction-asymmetry", "joint-torque-offset", "rotor-inertia", "joint-torque-gain",
         "payload", "gravity-error", "joint-stribeck-friction", "joint-load-friction", "joint-torque-ripple", "joint-spring"]
DRIVE = ["joint-coulomb-friction", "joint-viscous-friction", "joint-torque-offset", "joint-stribeck-friction", "joint-torque-ripple", "joint-spring"]
TSENSOR = ["sensor-bias", "sensor-drift", "sensor-lag", "time-offset", "saturation", "quantization", "mains-hum"]
FRICTION = ["joint-coulomb-friction", "joint-viscous-friction", "joint-torque-offset"]
CLASH = [{"tool-mass", "sensor-gain", "sensor-bias", "tool-com"}, {"sensor-lag", "time-offset"}, {"tool-com", "tip-offset", "sensor-crosstalk"},
         {"hertz-exponent", "stiffening-layer", "surface-offset", "structural-compliance", "adhesion", "tip-offset", "stress-softening", "hysteresis"},
         {"sensor-crosstalk", "sensor-misalignment", "friction-anisotropy"}, {"stribeck-friction", "viscous-friction", "friction-rounding", "presliding"},
         {"stiffness-drift", "stiffness-inhomogeneity", "sensor-drift"}, {"viscous-damping", "hunt-crossley-damping", "relaxation", "sensor-lag", "time-offset"},
         {"relaxation", "stiffness-drift"}, {"joint-torque-offset", "joint-friction-asymmetry", "joint-spring", "gravity-error"},
         {"joint-coulomb-friction", "joint-load-friction", "joint-stribeck-friction"}, {"payload", "gravity-error", "joint-torque-gain"},
         {"saturation", "stiffening-layer", "sensor-gain"}, {"sensor-bias", "sensor-drift"}]


def clash(names):
    s = set(names)
    return any(len(s & c) > 1 for c in CLASH)


def base_for(rng, hidden, extras=()):
    h = set(hidden) | set(extras)
    if "structural-compliance" in h:
        return str(rng.choice(["hunt-crossley", "hertz"]))
    if "viscous-damping" in h or "hunt-crossley-damping" in h:
        return str(rng.choice(["hooke", "hertz"]))
    if "hertz-exponent" in h:
        return str(rng.choice(["kelvin-voigt", "kelvin-voigt", "hooke"]))
    names, p = ["kelvin-voigt", "hunt-crossley", "hertz", "hooke", "zener"], np.array([.45, .3, .08, .07, .1])
    if "relaxation" in h or "stiffness-drift" in h:
        p[4] = 0
    return str(rng.choice(names, p=p / p.sum()))


def contact_model(rng, kind, hidden, rich=0.15):
    """Base, friction and now and then one or two effects that the user already knows of."""
    pool = ["relaxation", "viscous-friction", "presliding", "stribeck-friction", "friction-rounding", "hysteresis", "surface-offset", "sensor-bias",
            "adhesion", "stiffness-drift", "stiffening-layer", "sensor-drift", "load-dependent-friction", "friction-anisotropy", "tool-com", "tool-mass"]
    if kind == "wrench" and hidden and set(hidden) <= {"tool-mass", "tool-com", "tool-inertia", "sensor-bias", "sensor-drift", "sensor-gain"} and rng.random() < .15:
        return ["none"]
    extras = []
    while rng.random() < rich and len(extras) < 2:
        e = str(rng.choice(pool))
        tang = e in E.TANGENTIAL
        if e in extras or e in hidden or clash(list(hidden) + extras + [e]) or kind == "tester" and (tang and not set(hidden) & set(E.TANGENTIAL) or e in E.TOOL):
            continue
        if set(extras + list(hidden)) & {"quantization", "coulomb-friction"} and tang:
            continue
        extras.append(e)
    model = [base_for(rng, hidden, extras)]
    tang = any(h in E.TANGENTIAL for h in list(hidden) + extras)
    if "coulomb-friction" not in hidden and (tang or kind == "wrench" and rng.random() < .9):
        model.append("coulomb-friction")
    return model + extras


def joint_model(rng, kind, hidden, rich=0.15):
    m = ["rigid-body"] + [f for f in FRICTION if f not in hidden]
    if "joint-friction-asymmetry" in hidden and "joint-torque-offset" in m:
        m.remove("joint-torque-offset")
    pool = ["joint-stribeck-friction", "joint-spring", "rotor-inertia", "joint-torque-ripple"] if kind == "joints" else ["joint-stribeck-friction", "joint-spring"]
    if rng.random() < rich:
        e = str(rng.choice(pool))
        if e not in hidden and not clash(hidden + [e]):
            m.append(e)
    return m


def take(rng, pool, used):
    left = [e for e in pool if e not in used]
    e = str(rng.choice(left))
    used.add(e)
    return e


def plan(seed):
    rng = np.random.default_rng([seed, 0])
    used, out = set(), []
    add = lambda kind, group, hidden, **k: out.append(dict(kind=kind, group=group, hidden=list(hidden), **k))
    inhom = ["stiffness-inhomogeneity"]
    for pool, n in ((E.NORMAL, 2), (E.TANGENTIAL, 3), (E.TOOL, 3), (E.SENSOR, 3)):
        for _ in range(n):
            add("wrench", "single", [take(rng, pool, used)], pool=pool)
    for pool in (E.NORMAL, E.NORMAL, E.NORMAL, E.TANGENTIAL, TSENSOR):
        add("tester", "single", [take(rng, pool, used)], pool=pool)
    for _ in range(2):
        add("drive", "single", [take(rng, DRIVE, used)], pool=DRIVE)
    for _ in range(4):
        add("joints", "single", [take(rng, JOINT, used)], pool=JOINT)
    for kind, n in (("wrench", 3), ("tester", 3), ("joints", 2), ("drive", 1)):
        for i in range(n):
            add(kind, "none", [], rich=.55, flags=["long"] if i == 0 and kind in ("wrench", "tester") else [])
    out[-9]["flags"] = ["long"] if rng.random() < .5 else []                # the long arm log comes in half of the seeds here ...
    if not out[-9]["flags"]:                                                # ... else among the single testers
        next(c for c in out if c["kind"] == "tester" and c["group"] == "single" and c["hidden"][0] in E.NORMAL
             and c["hidden"][0] not in ("viscous-damping", "hunt-crossley-damping", *inhom))["flags"] = ["long"]
    NF = [e for e in E.NORMAL if e not in inhom]
    for pools in ((NF, E.TOOL), (E.TANGENTIAL[1:], [s for s in E.SENSOR if s != "quantization"]), (E.NORMAL, E.TANGENTIAL[1:]),
                  (E.TOOL[:3] + E.TOOL[4:], [s for s in E.SENSOR if s != "quantization"])):
        add("wrench", "pair", pair(rng, pools), pools=pools)
    for pools in ((NF, NF), (NF, [s for s in TSENSOR if s != "quantization"])):
        add("tester", "pair", pair(rng, pools), pools=pools)
    add("joints", "pair", pair(rng, (JOINT, JOINT)), pools=(JOINT, JOINT))
    from outside import WRENCH, TESTER
    from joints import OUTSIDE
    for kind, pool, n in (("wrench", WRENCH, 2), ("tester", TESTER, 2), ("joints", OUTSIDE["joints"], 1), ("drive", OUTSIDE["drive"], 1)):
        for x in rng.permutation(pool)[:n]:
            add(kind, "outside", [], extra=str(x), pool=pool)
    ways = [("friction-anisotropy", "one-way"), ("stribeck-friction", "fast-only"), ("load-dependent-friction", "one-depth")]
    ways = [ways[i] for i in rng.permutation(3)]
    add("wrench", "unexcited", [ways[0][0]], flags=["unexcited-motion", ways[0][1]], ways=ways)
    add("tester", "unexcited", [["stiffening-layer", "saturation"][int(rng.integers(2))]], flags=["unexcited"])
    weak = ["relaxation", "tool-com", "sensor-bias", "viscous-friction", "friction-anisotropy", "surface-offset", "sensor-misalignment", "stiffness-drift"]
    add("wrench", "weak", [str(rng.choice(weak))], pool=weak)
    k = ["joints", "tester"][int(rng.integers(2))]
    weak = ["joint-stribeck-friction", "joint-torque-ripple", "payload", "joint-spring"] if k == "joints" else ["relaxation", "hysteresis", "stress-softening", "stiffness-drift", "sensor-drift"]
    add(k, "weak", [str(rng.choice(weak))], pool=weak)
    single = [c for c in out if c["group"] == "single"]                     # what may stand in where an effect can't be brought to size
    for c in single:
        c["spare"] = []
    for e in E.NORMAL + E.TANGENTIAL + E.TOOL + E.SENSOR + JOINT:
        may = [c for c in single if e in c["pool"]]
        if e not in used and may:
            may[int(rng.integers(len(may)))]["spare"].append(e)
    order = rng.permutation(len(out))
    return [out[i] for i in order]


def pair(rng, pools):
    while True:
        a, b = str(rng.choice(pools[0])), str(rng.choice(pools[1]))
        if a != b and not clash([a, b]):
            return [a, b]
