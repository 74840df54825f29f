"""The table of 48 cases: kinds, groups, effects and bases, drawn from the seed."""
import numpy as np

# kind -> how many of each group
TABLE = {"wrench": dict(single=10, none=4, pair=4, outside=2, unexcited=1, weak=1),
         "tester": dict(single=6, none=2, pair=2, outside=2, unexcited=1, weak=1),
         "joints": dict(single=5, none=1, pair=1, outside=1),
         "drive": dict(single=1, none=2, outside=1)}
# the stage's effects as far as this kind can carry them, and how many single cases it gets
SINGLE = {"wrench": [(2, ["relaxation", "stress-softening", "adhesion", "stiffening-layer", "surface-offset", "stiffness-drift", "stiffness-inhomogeneity", "viscous-damping",
                          "hunt-crossley-damping", "hertz-exponent"]),
                     (2, ["coulomb-friction", "viscous-friction", "presliding", "load-dependent-friction", "friction-anisotropy"]),
                     (3, ["tool-mass", "tool-com", "tool-inertia", "structural-compliance", "tip-offset"]),
                     (3, ["sensor-bias", "sensor-drift", "sensor-crosstalk", "sensor-misalignment", "sensor-gain", "sensor-lag", "time-offset", "saturation", "quantization", "mains-hum"])],
          "tester": [(3, ["hertz-exponent", "hysteresis", "relaxation", "stress-softening", "adhesion", "stiffening-layer", "stiffness-inhomogeneity", "stiffness-drift",
                          "hunt-crossley-damping", "viscous-damping"]),
                     (2, ["stribeck-friction", "friction-rounding", "viscous-friction", "load-dependent-friction", "presliding", "friction-anisotropy"]),
                     (1, ["sensor-lag", "sensor-drift", "quantization", "mains-hum", "saturation", "time-offset", "sensor-bias"])],
          "joints": [(5, ["joint-coulomb-friction", "joint-viscous-friction", "joint-torque-offset", "joint-friction-asymmetry", "rotor-inertia", "joint-torque-gain", "payload",
                          "joint-elasticity", "gravity-error", "joint-stribeck-friction", "joint-load-friction", "joint-spring", "joint-torque-ripple"])],
          "drive": [(1, ["joint-coulomb-friction", "joint-viscous-friction", "joint-torque-offset", "joint-friction-asymmetry", "joint-spring", "joint-torque-ripple",
                         "joint-stribeck-friction"])]}
PAIRS = {"wrench": [("relaxation", "sensor-bias"), ("coulomb-friction", "tool-mass"), ("stiffening-layer", "tool-com"), ("viscous-friction", "sensor-bias"),
                    ("surface-offset", "coulomb-friction"), ("stiffness-inhomogeneity", "sensor-misalignment"), ("relaxation", "friction-anisotropy"),
                    ("stress-softening", "sensor-gain"), ("tool-inertia", "load-dependent-friction"), ("adhesion", "mains-hum"), ("viscous-damping", "sensor-drift"),
                    ("sensor-lag", "stiffening-layer"), ("tip-offset", "relaxation")],
         "tester": [("relaxation", "stiffening-layer"), ("stress-softening", "sensor-drift"), ("viscous-friction", "relaxation"), ("adhesion", "hertz-exponent"),
                    ("hysteresis", "sensor-lag"), ("stiffness-inhomogeneity", "viscous-damping"), ("friction-anisotropy", "stress-softening")],
         "joints": [("joint-coulomb-friction", "payload"), ("joint-viscous-friction", "gravity-error"), ("rotor-inertia", "joint-torque-offset"),
                    ("joint-spring", "joint-coulomb-friction"), ("joint-torque-ripple", "joint-viscous-friction")]}
WEAK = {"wrench": ["relaxation", "viscous-friction", "tool-mass", "sensor-lag", "stiffening-layer"], "tester": ["relaxation", "hysteresis", "stiffness-drift", "adhesion"]}
OUTSIDE = {"wrench": ["breathing", "hose", "shift", "hum23", "puncture"], "tester": ["breathing", "puncture", "pulse", "shift"], "joints": ["warm-up", "pump"],
           "drive": ["pump", "warm-up"]}
# effect, motion, fixed amplitude: there, but this motion can't show it
UNEXCITED = {"wrench": [("viscous-friction", dict(slide=False, ntilt=0), None), ("stiffness-inhomogeneity", dict(slide=False, ntilt=0, places=[(0, 0)]), .3), ("saturation", {}, -.4)],
             "tester": [("stiffening-layer", dict(depths=[.22, .38, .3, .36], sweep=False), None), ("saturation", {}, -.35)]}
TANG = {"coulomb-friction", "viscous-friction", "stribeck-friction", "presliding", "friction-rounding", "load-dependent-friction", "friction-anisotropy"}


def base(kind, hidden, rng, group):
    h = set(hidden)
    if kind in ("joints", "drive"):
        out = ["rigid-body"] + [e for e in ("joint-coulomb-friction", "joint-viscous-friction", "joint-torque-offset") if e not in h]
        if "joint-friction-asymmetry" in h or rng.random() < .2 and not h & {"joint-torque-offset"}:
            out = [e for e in out if e != "joint-torque-offset"]
        if kind == "joints" and rng.random() < .25 and not h & {"rotor-inertia", "joint-elasticity", "payload"}:
            out.append("rotor-inertia")
        return out
    if h & {"viscous-damping"}:
        b = "hooke"
    elif h & {"hunt-crossley-damping"}:
        b = "hertz"
    elif h & {"structural-compliance"}:
        b = str(rng.choice(["hertz", "hunt-crossley"]))      # with a straight law it would be a softer spring
    elif h & {"hertz-exponent"}:
        b = "kelvin-voigt"
    else:
        b = str(rng.choice(["kelvin-voigt", "hunt-crossley", "hooke", "hertz"], p=[.45, .3, .12, .13]))
    out = [b]
    if "coulomb-friction" not in h and (kind == "wrench" or h & TANG or rng.random() < .35):
        out.append("coulomb-friction")
    if group in ("single", "none") and rng.random() < (.25 if group == "single" else .6):
        more = ["relaxation", "sensor-bias" if kind == "wrench" else "surface-offset"] + (["viscous-friction"] if "coulomb-friction" in out and not h & TANG else [])
        if group == "none" and "coulomb-friction" in out:
            more.append("friction-rounding")
        x = str(rng.choice(more))
        if x == "surface-offset" and h & {"adhesion", "hertz-exponent", "stiffening-layer", "sensor-bias"} or x == "sensor-bias" and h & {"tool-mass", "sensor-gain", "sensor-drift"}:
            x = "relaxation"
        if x == "relaxation" and h & {"viscous-damping", "hunt-crossley-damping", "hysteresis", "stress-softening"}:
            x = None
        if x and x not in h:
            out.append(x)
    return out


def plans(seed):
    """48 plans; each holds everything needed to build it alone. 'spare': what takes the effect's place if it won't settle."""
    rng = np.random.default_rng([seed, 77])
    out, used = [], set()

    def add(kind, group, hidden=(), **kw):
        hi = 6.0 if group == "pair" else 8.0
        tg = [float(np.exp(rng.uniform(np.log(2.6), np.log(hi)))) if group != "weak" else float(np.exp(rng.uniform(np.log(.25), np.log(.7)))) for _ in hidden]
        out.append(dict(kind=kind, group=group, hidden=list(hidden), targets=tg, **kw))

    for kind in ("drive", "joints", "tester", "wrench"):
        for n, pool in SINGLE[kind]:
            free = [e for e in rng.permutation(pool) if e not in used]
            free = [str(e) for e in free]
            take, rest = free[:n], free[n:]
            used |= set(take)
            for i, e in enumerate(take):
                sp = rest[i:i + 1]
                used |= set(sp) if kind != "wrench" else set()
                add(kind, "single", [e], spare=sp)
        c = TABLE[kind]
        for _ in range(c.get("none", 0)):
            add(kind, "none")
        if kind in PAIRS:
            for i in rng.permutation(len(PAIRS[kind]))[:c.get("pair", 0)]:
                add(kind, "pair", PAIRS[kind][i])
        for x in rng.permutation(OUTSIDE[kind])[:c.get("outside", 0)]:
            add(kind, "outside", outside=str(x), others=[str(y) for y in OUTSIDE[kind]])
        for _ in range(c.get("weak", 0)):
            add(kind, "weak", [str(rng.choice(WEAK[kind]))])
        for _ in range(c.get("unexcited", 0)):
            e, opt, A = UNEXCITED[kind][rng.integers(len(UNEXCITED[kind]))]
            add(kind, "unexcited", [e], opt=opt, amplitude=A)
    # rates and lengths at the ends of the range, two long logs
    by = lambda kind, group: [p for p in out if p["kind"] == kind and p["group"] == group]
    by("tester", "none")[0].update(opt=dict(cycles=8, pause=1.0, last=(8, 15)), rate=100.)
    by("joints", "none")[0].update(T=150., rate=100.)
    by("tester", "single")[int(rng.integers(0, 5))].update(rate=2000.)
    by("tester", "none")[1].update(rate=50.)
    by("drive", "none")[0].update(T=float(rng.uniform(6, 9)), rate=1000.)
    by("drive", "none")[1].update(rate=2000.)
    return [out[i] for i in rng.permutation(len(out))]
