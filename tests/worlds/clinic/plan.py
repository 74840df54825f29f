"""The 48 cases of a seed: kinds, groups, which effects hide where, in which model."""
import numpy as np

GROUPS = {"single": dict(wrench=10, tester=5, joints=4, drive=3), "none": dict(wrench=4, tester=2, joints=2, drive=1),
          "pair": dict(wrench=4, tester=2, joints=1, drive=0), "outside": dict(wrench=3, tester=1, joints=1, drive=1),
          "unexcited": dict(wrench=1, tester=1, joints=0, drive=0), "weak": dict(wrench=1, tester=1, joints=0, drive=0)}
NORMAL = ["hertz-exponent", "viscous-damping", "hunt-crossley-damping", "relaxation", "hysteresis", "stress-softening", "adhesion", "stiffening-layer",
          "surface-offset", "stiffness-drift", "stiffness-inhomogeneity", "structural-compliance"]
TANGENT = ["coulomb-friction", "viscous-friction", "stribeck-friction", "presliding", "friction-rounding", "load-dependent-friction", "friction-anisotropy"]
TOOL = ["tool-mass", "tool-com", "tool-inertia", "tip-offset"]
SENSOR = ["sensor-bias", "sensor-drift", "sensor-crosstalk", "sensor-misalignment", "sensor-gain", "sensor-lag", "time-offset", "saturation",
          "quantization", "mains-hum"]
TESTER_SENSOR = ["sensor-bias", "sensor-drift", "sensor-lag", "time-offset", "saturation", "quantization", "mains-hum"]
JOINT = ["joint-coulomb-friction", "joint-viscous-friction", "joint-torque-offset", "rotor-inertia", "joint-torque-gain", "payload", "gravity-error",
         "joint-stribeck-friction", "joint-load-friction", "joint-torque-ripple", "joint-spring"]
DRIVE = ["joint-coulomb-friction", "joint-viscous-friction", "joint-torque-offset", "joint-stribeck-friction", "joint-torque-ripple", "joint-spring",
         "joint-friction-asymmetry"]
PAIR = {"wrench": (["relaxation", "viscous-damping", "stiffening-layer", "stress-softening", "hysteresis", "stiffness-drift"],
                   ["viscous-friction", "stribeck-friction", "friction-anisotropy", "load-dependent-friction", "coulomb-friction"],
                   ["tool-mass", "sensor-bias", "sensor-drift", "sensor-misalignment", "sensor-lag", "time-offset", "mains-hum"]),
        "tester": (["relaxation", "stress-softening", "stiffening-layer", "hysteresis"], ["viscous-damping", "stiffness-drift", "adhesion"],
                   ["sensor-bias", "sensor-drift", "viscous-friction", "friction-anisotropy"])}
FRICTIONAL = set(TANGENT) - {"coulomb-friction"}
ROBOTS = ["lwr4plus", "lwr4plus", "panda", "ur10"]
J0 = ["rigid-body", "joint-coulomb-friction", "joint-viscous-friction", "joint-torque-offset"]


def base_for(rng, hidden):
    pick = lambda *a: str(rng.choice(a))
    h = set(hidden)
    if "structural-compliance" in h:
        return pick("hertz", "hunt-crossley")
    if "viscous-damping" in h:
        return "hooke"
    if "hunt-crossley-damping" in h:
        return pick("hertz", "hooke")
    if "hertz-exponent" in h:
        return pick("hooke", "kelvin-voigt", "hertz")
    if "relaxation" in h:
        return pick("kelvin-voigt", "kelvin-voigt", "hunt-crossley", "hooke", "hertz")
    if h & {"hysteresis", "sensor-lag", "time-offset"}:
        return pick("kelvin-voigt", "hunt-crossley", "hooke")
    if "stiffening-layer" in h:
        return pick("kelvin-voigt", "hooke")
    return pick("kelvin-voigt", "kelvin-voigt", "hunt-crossley", "hunt-crossley", "hooke", "hertz", "zener")


def contact_model(rng, kind, hidden, extras=0.3):
    base = base_for(rng, hidden)
    model = [base]
    if kind == "wrench" and "coulomb-friction" not in hidden or set(hidden) & FRICTIONAL:
        model.append("coulomb-friction")
    if rng.random() < extras:
        more = ["surface-offset", "sensor-bias"] + (["viscous-friction"] if len(model) > 1 and "friction-rounding" not in hidden else [])
        e = str(rng.choice(more))
        clash = {"sensor-bias": {"tool-mass", "sensor-gain", "tool-com", "sensor-drift", "adhesion"}, "surface-offset": {"adhesion", "tip-offset", "structural-compliance",
                 "hertz-exponent", "stiffening-layer"}, "viscous-friction": {"stribeck-friction"}}[e]
        if e not in hidden and not clash & set(hidden):
            model.append(e)
    return model


def details(rng, kind, group, hidden, long=False, what=None):
    """one case's plan; drawn anew at each attempt."""
    p = dict(kind=kind, group=group, hidden=list(hidden), long=long, robot=str(rng.choice(ROBOTS)), notes="")
    pick = lambda *a: a[int(rng.integers(len(a)))]
    if kind in ("joints", "drive"):
        drop = set(hidden)
        if "joint-friction-asymmetry" in hidden:
            drop |= {"joint-torque-offset"}
        m = [n for n in J0 if n not in drop]
        if kind == "drive" and "joint-spring" not in hidden and "joint-torque-offset" in m and rng.random() < 0.6:
            m.remove("joint-torque-offset")
        if group == "none" and kind == "joints":
            m += [str(rng.choice(["rotor-inertia", "joint-load-friction", "payload"]))] if rng.random() < 0.7 else []
        p["model"] = m
        if group == "outside":
            p["outside"] = what
        return p
    if group == "none":
        extra = pick([], ["sensor-bias"], ["surface-offset"], ["viscous-friction"], ["relaxation"], ["friction-rounding"], ["hysteresis"], ["sensor-drift"])
        base = pick("kelvin-voigt", "hunt-crossley", "hertz", "zener", "hooke")
        if extra == ["relaxation"] and base == "zener":
            base = "kelvin-voigt"
        if kind == "tester" and rng.random() < 0.6:
            extra = [e for e in extra if e not in ("viscous-friction", "friction-rounding")]
            p["model"] = [base] + extra
        else:
            p["model"] = [base, "coulomb-friction"] + extra
    elif group == "unexcited":
        if kind == "wrench":
            h, model, want, without = pick(
                (["structural-compliance"], ["hooke", "coulomb-friction"], {"onereturn"}, {"tilt"}),
                (["sensor-gain"], ["kelvin-voigt", "coulomb-friction", "sensor-bias"], {"fixed"}, {"tilt"}),
                (["tool-com"], ["hunt-crossley", "coulomb-friction", "sensor-bias"], {"fixed"}, {"tilt"}))
        else:
            h, model, want, without = pick((["structural-compliance"], ["hooke"], set(), set()),
                                           (["friction-anisotropy"], ["kelvin-voigt", "coulomb-friction"], {"oneway"}, {"diagonal", "micro"}),
                                           (["stiffening-layer"], ["kelvin-voigt"], set(), set()))
        p.update(hidden=h, model=model, want=want, without=without, notes="the motion does not excite the hidden effect")
    elif group == "outside":
        p["outside"] = what
        p["model"] = contact_model(rng, kind, [], 0.2)
        if kind == "tester" and rng.random() < 0.3 and "coulomb-friction" not in p["model"]:
            p["model"].insert(1, "coulomb-friction")
    else:
        p["model"] = contact_model(rng, kind, hidden, 0.3 if group == "single" else 0.1)
    return p


def draw(seed):
    """list of (kind, group, hidden, long, what)."""
    rng = np.random.default_rng([seed, 77])
    take = lambda pool, n, used: [str(x) for x in rng.permutation([p for p in pool if p not in used])[:n]]
    cases, used = [], set()

    def singles(kind, pool, n):
        for h in take(pool, n, used):
            used.add(h)
            cases.append([kind, "single", [h], False, None])

    singles("drive", DRIVE, 3)
    singles("joints", JOINT, 4)
    tester_normal = [x for x in NORMAL if x != "stiffness-inhomogeneity"]
    singles("tester", tester_normal, 3)
    singles("tester", TANGENT, 1)
    singles("tester", TESTER_SENSOR, 1)
    singles("wrench", NORMAL, 3)
    singles("wrench", TANGENT, 2)
    singles("wrench", TOOL, int(rng.integers(1, 3)))
    singles("wrench", SENSOR, 22 - len(cases))
    from hidden import OUTSIDE
    from joint_case import OUTSIDE as JO
    for kind in ("wrench", "tester", "joints", "drive"):
        for _ in range(GROUPS["none"][kind]):
            cases.append([kind, "none", [], False, None])
        for _ in range(GROUPS["pair"][kind]):
            if kind == "joints":
                h = [str(x) for x in rng.choice(["joint-viscous-friction", "joint-torque-offset", "gravity-error", "payload", "joint-torque-ripple", "rotor-inertia",
                                                 "joint-coulomb-friction"], 2, replace=False)]
            else:
                a, b = rng.choice(3, 2, replace=False)
                h = [str(rng.choice(PAIR[kind][i])) for i in (a, b)]
            cases.append([kind, "pair", h, False, None])
        pool = {**OUTSIDE, **JO}[kind]
        for w in rng.permutation(pool)[:GROUPS["outside"][kind]]:
            cases.append([kind, "outside", [], False, str(w)])
        for _ in range(GROUPS["unexcited"][kind]):
            cases.append([kind, "unexcited", [], False, None])
        for _ in range(GROUPS["weak"][kind]):
            pool = NORMAL[1:6] + ["stiffness-drift"] + (["viscous-friction", "friction-anisotropy", "sensor-bias", "sensor-drift", "tool-mass"] if kind == "wrench" else
                                                        ["sensor-drift", "sensor-bias"])
            cases.append([kind, "weak", [str(rng.choice(pool))], False, None])
    # two long logs
    w = [c for c in cases if c[0] == "wrench" and c[1] in ("none", "single")]
    k = [c for c in cases if c[0] in ("tester", "joints") and c[1] in ("none", "single")]
    fast = {"sensor-lag", "time-offset", "mains-hum", "tool-inertia", "viscous-damping", "hunt-crossley-damping", "presliding", "friction-rounding", "adhesion"}
    for group in (w, k):
        slow = [c for c in group if not set(c[2]) & fast]
        slow[int(rng.integers(len(slow)))][3] = True
    order = rng.permutation(len(cases))
    return [cases[i] for i in order]
