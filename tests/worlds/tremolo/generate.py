"""python generate.py --seed S --out DIR [--only I]: 48 experiments with known truth."""
import os
for v in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "NUMBA_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(v, "1")
import argparse, json, sys, time, warnings
import numpy as np
import cases, refit, tune, values
from tester import Tester
from wrench import Wrench
from jointcase import Torque

warnings.filterwarnings("ignore", category=RuntimeWarning)


def make(plan, seed):
    return {"wrench": Wrench, "tester": Tester, "joints": Torque, "drive": Torque}[plan["kind"]](seed, plan)


def neighbours(case, D, r):
    """Effects that do as well as the hidden one in this log."""
    out = []
    for x in r["each"]:
        if x["effect"] == "quantization":
            continue
        limit = 1.5 * x["left_rms"]
        if hasattr(case, "sizes"):
            got, _ = case.near(D, x["names"], limit)
        else:
            got, _ = refit.near(D, x["names"], case.hidden, x["theta"], x["w"], x["effect"], limit)
        out += got
    return sorted(set(out))


def tries(plan):
    """(hidden, outside) one after the other: the plan's own, then its stand-in, then its own again."""
    own, spare = plan["hidden"], plan.get("spare") or plan["hidden"]
    for k in range(16):
        if plan["group"] == "outside":
            o = plan["others"]
            yield own, plan["outside"] if k < 5 else o[(o.index(plan["outside"]) + k - 4) % len(o)]
        else:
            yield (own if k < 5 or k >= 11 else spare), None


def settle(plan, key, say):
    last = None
    for k, (hidden, outside) in enumerate(tries(plan)):
        rng = np.random.default_rng(key + [k])
        p = dict(plan, hidden=list(hidden), outside=outside)
        if plan["group"] in ("single", "pair"):      # what wouldn't settle at a large ratio is tried at a smaller one
            p["targets"] = [max(2.75, x * .8 ** k) for x in plan["targets"]]
        p["model"] = cases.base(plan["kind"], hidden, rng, plan["group"])
        if outside in ("warm-up",) and not {"joint-coulomb-friction", "joint-viscous-friction"} & set(p["model"]):
            continue
        hist = []
        try:
            c = make(p, int(rng.integers(1 << 31)))
            if plan.get("amplitude") is not None:
                c.amps[0].update(A=plan["amplitude"], lo=plan["amplitude"])
            D, r = tune.settle_outside(c, hist.append) if plan["group"] == "outside" else tune.settle(c, tries=8, say=hist.append)
            return c, D, r, k
        except (tune.Failed, RuntimeError, np.linalg.LinAlgError) as e:
            last = e
            say(f"    try {k} {hidden} {outside}: {e}")
            for h in hist if say is loud else []:
                say(h)
    raise SystemExit(f"case can't be made: {plan} ({last})")


def loud(s):
    print(s, file=sys.stderr, flush=True)


def one(i, plan, seed, out, say):
    c, D, r, k = settle(plan, [seed, 1000 + i], say)
    folder = os.path.join(out, f"case_{i:03d}")
    os.makedirs(folder, exist_ok=True)
    near = neighbours(c, D, r) if c.group in ("single", "pair", "weak") else []
    name, seconds = c.write(folder, np.random.default_rng([seed, 2000 + i]))
    unit = "N" if plan["kind"] in ("wrench", "tester") else "N m"
    t = dict(case=f"case_{i:03d}", kind=plan["kind"], group=c.group, model=c.model, hidden=c.hidden, true_model=",".join(c.model + c.hidden), near=near)
    t["model"] = ",".join(c.model)
    worst = min(r["each"], key=lambda x: x["ratio"]) if r["each"] else None
    t.update(effect_rms=worst["effect_rms"] if worst else r.get("effect", 0.), left_rms=worst["left_rms"] if worst else r.get("left", r["fit"][0]),
             fit_rms=r["fit"][0], reading_rms=r["reading"][0], unit=unit, effect_unit="N m" if worst and worst["group"] == "torque" else unit)
    t["each"] = [{k2: x[k2] for k2 in ("effect", "group", "effect_rms", "left_rms", "ratio")} for x in r["each"]]
    if plan["kind"] == "wrench":
        t.update(fit_rms_torque=r["fit"][1], reading_rms_torque=r["reading"][1])
    hid, own = values.of(c, r)
    t.update(noise_rms=c.noise_rms()[0], nuisances=c.nuisances(), parameters=c.parameters(), values=hid, base_values=own, seconds=seconds,
             notes=note(c, plan, r, k), log=name)
    return t


def note(c, plan, r, k):
    s = []
    if c.outside:
        s.append({"breathing": "the surface itself moves with a rhythm of its own", "puncture": "the skin breaks once and stays broken", "hose": "a hose pulls at the wrist",
                  "shift": "the reading's zero jumps twice", "hum23": "a fan on the flange, its speed hunting", "pulse": "the material's whole force swells and sinks with a rhythm",
                  "warm-up": "friction falls as the log goes on", "pump": "a load with a rhythm of its own"}[c.outside])
        s.append(f"residual of the model {r['effect'] / max(r['left'], 1e-12):.1f} times what it leaves without it; best single effect of the catalogue: {r['best']}")
    if c.group == "unexcited":
        s.append("there, but this motion doesn't show it")
    if k:
        s.append(f"draw {k + 1}")
    return "; ".join(s)


def plain(o):
    if isinstance(o, dict):
        return {str(k): plain(v) for k, v in o.items()}
    if isinstance(o, (list, tuple, np.ndarray)):
        return [plain(v) for v in o]
    if isinstance(o, (bool, np.bool_)):
        return bool(o)
    if isinstance(o, (int, np.integer)):
        return int(o)
    if isinstance(o, (float, np.floating)):
        return float(f"{o:.8g}")
    return o


def main():
    a = argparse.ArgumentParser(description=__doc__)
    a.add_argument("--seed", type=int, required=True)
    a.add_argument("--out", required=True)
    a.add_argument("--only", type=int)
    a.add_argument("--loud", action="store_true")
    a = a.parse_args()
    say = loud if a.loud else (lambda s: None)
    os.makedirs(a.out, exist_ok=True)
    path = os.path.join(a.out, "truth.json")
    truth = {}
    if a.only is not None and os.path.exists(path):
        truth = {t["case"]: t for t in json.load(open(path))}
    t0 = time.time()
    for i, plan in enumerate(cases.plans(a.seed)):
        if a.only is not None and i != a.only:
            continue
        b = time.process_time()
        t = plain(one(i, plan, a.seed, a.out, say))
        truth[t["case"]] = t
        print(f"{t['case']} {t['kind']:7s} {time.process_time() - b:5.1f} s  {time.time() - t0:5.0f} s"
              + (f"  {t['group']} {t['model']} + {t['hidden'] or t['notes']} ratio {t['effect_rms'] / max(t['left_rms'], 1e-12):.2f} fit {t['fit_rms']:.4g}/{t['reading_rms']:.4g} near {t['near']}" if a.loud else ""), flush=True)
        with open(path + ".part", "w") as f:
            json.dump([truth[k] for k in sorted(truth)], f, indent=1)
        os.replace(path + ".part", path)


if __name__ == "__main__":
    main()
