"""generate.py --seed S --out DIR [--only I]: 48 cases of arms, testers, free arms and drives with known truth. See README.md."""
import os

for _k in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ[_k] = "1"

import argparse  # noqa: E402
import pathlib  # noqa: E402
import sys  # noqa: E402
import time  # noqa: E402
import warnings  # noqa: E402
import zlib  # noqa: E402

import numpy as np  # noqa: E402

warnings.filterwarnings("ignore", category=RuntimeWarning)

from casemaker import UNEXCITED, dump, make, write  # noqa: E402
from joint_case import IN_DRIVE  # noqa: E402
from laws import JOINT, NORMAL, SENSOR, TANGENTIAL, TOOL  # noqa: E402

T_SENSOR = ["sensor-bias", "sensor-drift", "sensor-lag", "time-offset", "saturation", "quantization", "mains-hum"]
PAIRS = {
    "wrench": ["relaxation tool-mass", "stribeck-friction sensor-bias", "stiffening-layer viscous-friction", "sensor-lag friction-anisotropy", "hysteresis tool-com",
               "surface-offset sensor-bias", "stiffness-inhomogeneity sensor-drift", "hertz-exponent load-dependent-friction", "presliding sensor-misalignment",
               "relaxation friction-rounding", "stress-softening tool-mass", "viscous-damping tool-com", "tip-offset sensor-gain"],
    "tester": ["relaxation sensor-drift", "hysteresis sensor-bias", "stress-softening sensor-lag", "adhesion sensor-drift", "stiffening-layer mains-hum",
               "hertz-exponent relaxation", "stiffness-drift sensor-bias", "viscous-friction relaxation", "presliding stiffening-layer"],
    "joints": ["joint-stribeck-friction gravity-error", "payload joint-torque-ripple", "rotor-inertia joint-friction-asymmetry", "joint-spring joint-viscous-friction",
               "joint-torque-offset joint-torque-ripple", "joint-coulomb-friction gravity-error"],
    "drive": ["joint-torque-ripple joint-stribeck-friction", "joint-spring joint-torque-ripple", "joint-viscous-friction joint-torque-ripple"],
}


def plan(seed):
    """Specifications of the 48 cases, in mixed order."""
    rng = np.random.default_rng([seed, 4711])
    used = set()

    def pick(pool, n):
        got = [str(x) for x in rng.permutation([p for p in pool if p not in used])[:n]]
        used.update(got)
        return got
    S = []
    add = lambda kind, group, hidden, **kw: S.append(dict(kind=kind, group=group, hidden=list(hidden), **kw))
    for e in pick(NORMAL, 2) + pick(TANGENTIAL, 2) + pick(TOOL, 3) + pick(SENSOR, 3):
        add("wrench", "single", [e])
    for e in pick(NORMAL, 3) + pick(TANGENTIAL, 1) + pick(T_SENSOR, 1):
        add("tester", "single", [e])
    for e in pick(IN_DRIVE, 2):
        add("drive", "single", [e])
    for e in pick(JOINT, 5):
        add("joints", "single", [e])
    for kind, n in (("wrench", 4), ("tester", 2), ("joints", 2), ("drive", 1)):
        for i in range(n):
            add(kind, "none", [], **(dict(long=True) if kind in ("wrench", "tester") and i == 0 else {}))
    for kind, n in (("wrench", 3), ("tester", 2), ("joints", 1), ("drive", 1)):
        for p in rng.permutation(PAIRS[kind])[:n]:
            add(kind, "pair", str(p).split())
    for kind, names in (("wrench", rng.permutation(["hose", "hand", "bench", "cogging"])[:3]), ("tester", [None]), ("joints", [None]), ("drive", [None])):
        for o in names:
            add(kind, "outside", [], outside=None if o is None else str(o))
    for kind in ("wrench", "tester"):
        e = str(rng.choice(list(UNEXCITED[kind])))
        add(kind, "unexcited", [e], unexcited=UNEXCITED[kind][e])
    add("wrench", "weak", [str(rng.choice(["relaxation", "viscous-friction", "tool-mass", "friction-anisotropy", "sensor-gain", "time-offset"]))])
    add("tester", "weak", [str(rng.choice(["relaxation", "hysteresis", "stiffness-drift", "adhesion", "surface-offset"]))])
    return [S[i] for i in rng.permutation(len(S))]


def attempt(spec, specs, seed, i):
    """A case that can't be made after many draws gets another hidden effect that no case of its group has (the same for every --only)."""
    rng = np.random.default_rng([seed, i, 77])
    kind, group = spec["kind"], spec["group"]
    taken = {tuple(s["hidden"]) for s in specs if s["group"] == group}
    pool = {"wrench": NORMAL + TANGENTIAL + TOOL + SENSOR, "tester": NORMAL + TANGENTIAL + T_SENSOR, "joints": JOINT, "drive": IN_DRIVE}[kind]
    if group == "pair":
        pool = PAIRS[kind]
    others = [h for h in ([*str(x).split()] for x in rng.permutation(pool)) if tuple(h) not in taken] if group in ("single", "pair") else []
    for k in range(5):
        try:
            return make(dict(spec), (seed, i, k) if k else (seed, i))
        except RuntimeError:
            # a reserve of its own for every case, so that no effect comes twice
            own = [h for h in others if zlib.crc32("+".join(h).encode()) % 3 == i % 3] or others
            if own:
                spec["hidden"] = own[k % len(own)]
    raise RuntimeError(f"no case {i}: {spec}")


def main():
    ap = argparse.ArgumentParser(description=__doc__)
    ap.add_argument("--seed", type=int, required=True)
    ap.add_argument("--out", required=True)
    ap.add_argument("--only", type=int)
    a = ap.parse_args()
    out = pathlib.Path(a.out)
    out.mkdir(parents=True, exist_ok=True)
    specs = plan(a.seed)
    truths = []
    t0 = time.time()
    for i, spec in enumerate(specs):
        if a.only is not None and i != a.only:
            continue
        name = f"case_{i:03d}"
        c0 = time.process_time()
        case, log, rig, truth, tries = attempt(spec, specs, a.seed, i)
        write(out / name, case, log, rig, np.random.default_rng([a.seed, i, 99]))
        truths.append({"case": name, **truth})
        if os.environ.get("FLEXARM_VERBOSE"):
            e, left = truth["effect_rms"], truth["left_rms"]
            r = {k: round(e[k] / left[k], 2) for k in e} if isinstance(e, dict) else round(e / left, 2)
            print(f"{name} {truth['kind']:6s} {truth['group']:9s} {'+'.join(truth['hidden']) or spec.get('outside') or '-':44s} ratio {r} fit {truth['fit_rms']:.3g} "
                  f"noise {truth['noise_rms']:.3g} reading {truth['reading_rms']:.3g} near {truth['near']} T {truth['seconds']:.0f} strength {truth['nuisances']['strength']:.2f} "
                  f"tries {tries} cpu {time.process_time() - c0:.1f} model {truth['model']}", flush=True)
    dump(out / ("truth.json" if a.only is None else f"truth_{a.only:03d}.json"), truths)
    print(f"{len(truths)} cases in {time.time() - t0:.0f} s", file=sys.stderr)


if __name__ == "__main__":
    main()
