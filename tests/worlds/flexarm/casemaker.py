"""One case from its specification: draw, tune, judge, write. A draw that can't be made into what is wanted is drawn again."""
from __future__ import annotations

import csv
import json
import os
import pathlib

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

import effects as fx
import joint_case as jc
import tester_case as tc
import wrench_case as wc
from refit import rms
from score import Redraw, tune
from special import UNEXCITED, Outside
from values import true_values

JUDGE = {"wrench": wc.judge, "tester": tc.judge, "joints": jc.judge, "drive": jc.judge}
UNIT = {"wrench": "N", "tester": "N", "joints": "N·m", "drive": "N·m"}
RANGES = {**fx.RANGE, **jc.JRANGE, "outside": (0.05, 1.0, 30)}


def build(spec, rng):
    kind, hidden, group = spec["kind"], spec["hidden"], spec["group"]
    outside = Outside(rng, kind, spec.get("outside")) if group == "outside" else None
    un = spec.get("unexcited")
    if kind == "wrench":
        kw = dict(model=un["model"].split(","), free_only=un.get("plan", False)) if un else {}
        c = wc.WrenchCase(rng, hidden, group, long=spec.get("long", False), outside=outside, **kw)
    elif kind == "tester":
        kw = dict(model=un["model"].split(","), slide=False) if un else {}
        c = tc.TesterCase(rng, hidden, group, long=spec.get("long", False), outside=outside, **kw)
    else:
        c = jc.JointCase(rng, hidden, group, outside=outside, drive=kind == "drive")
    if un:
        for k, v in un.get("shape", {}).items():
            c.shapes[hidden[0]][k] = v * c.dmax if k == "ld" else v
    return c


def quant_ratio(case, j, a):
    """A lattice of values isn't refitted: step / sqrt 12 against what else is left."""
    ch = [0, 1, 2] if j.ser.channels == 6 else list(range(j.ser.channels))
    on = j.ser.contact
    return a / np.sqrt(12), rms(j.true.res[on][:, ch])


def evaluate(case, judge, amps, strength):
    j, load = judge(case, amps, strength, ("step",))
    worst, fit = j.fits()
    ratios, sizes = {}, {}
    for h in case.hidden:
        if h == "quantization":
            e, left = quant_ratio(case, j, amps[h])
            sizes[h] = (e, left, "N")
        else:
            m = j.size(h)
            sizes[h] = m[:3]
        ratios[h] = sizes[h][0] / max(sizes[h][1], 1e-12)
    return ratios, worst, (j, load, fit, sizes)


def evaluate_outside(case, judge, amps, strength):
    """Left: the model on the same log without the addition. Effect: what the best refit leaves more with it."""
    keep, case.outside = case.outside, None
    j0, _ = judge(case, {}, strength)
    case.outside = keep
    worst, fit = j0.fits()
    j, load = judge(case, amps, strength)
    on = j.ser.contact
    ch = [0, 1, 2] if j.ser.channels == 6 else list(range(j.ser.channels))
    rows = slice(None) if keep.kind in ("hose", "hand", "cogging", "jumps", "slosh", "machine") else on
    left = rms(j0.true.res[rows][:, ch])
    e = np.sqrt(max(rms(j.true.res[rows][:, ch]) ** 2 - left ** 2, 0))
    share = e / rms(j.ser.y[on][:, ch])
    return {"outside": e / left}, worst, (j, load, fit, {"outside": (e, left, UNIT[case.kind], share)})


def best_alternative(case, j):
    """What a single catalogue effect more takes of an outside effect (largest share of the excess sse)."""
    if case.kind in ("joints", "drive"):
        names = [a for a in jc.JointJudge.__init__.__globals__["JOINT"] if a not in j.model] if case.kind == "joints" else [a for a in jc.IN_DRIVE if a not in j.model]
        make = lambda a: j._ruler(j.model + [a], j.true if a == "joint-torque-ripple" else None)
    else:
        from refit import Ruler
        names = [a for a in j.alternatives() if a not in ("sensor-gain", "stiffness-inhomogeneity")]
        make = lambda a: Ruler(j.ser, j.model + [a], j.sigma)
    out = (0.0, "")
    for a in names:
        R = make(a)
        R.fit(R.start(j.true.v), 6, 3e-3)
        out = max(out, (1 - R.sse / j.true.sse, a))
    return out


def make(spec, seed):
    """Returns case, log, rig and truth (without its name)."""
    why = []
    for attempt in range(6 if spec["group"] in ("single", "pair") else 9):
        rng = np.random.default_rng([*seed, attempt])
        try:
            return _make(spec, rng) + (attempt,)
        except Redraw as e:
            why.append(str(e)[:260])
            if os.environ.get("FLEXARM_VERBOSE"):
                print("   redraw:", why[-1], flush=True)
            if attempt >= 4 and "long" in spec:
                spec = {k: v for k, v in spec.items() if k != "long"}
    raise RuntimeError(f"{spec}: {why}")


def _make(spec, rng):
    case = build(spec, rng)
    judge = JUDGE[case.kind]
    group, hidden = spec["group"], list(spec["hidden"])
    near, note = [], ""
    target = {h: float(np.exp(rng.uniform(np.log(2.8), np.log(7.3)))) for h in hidden}
    if group == "weak":
        target = {h: float(rng.uniform(0.35, 0.65)) for h in hidden}
        far, load, amps, strength, _ = tune(lambda a, s: evaluate(case, judge, a, s), hidden, target, RANGES_WEAK(hidden), first(hidden, 0.15), (0.2, 0.77), tol=0.3)
    elif group == "unexcited":
        un = spec["unexcited"]
        amps = {hidden[0]: un["a"]}
        strength = 1.0
        for _ in range(6):
            ratios, worst, load = evaluate(case, judge, amps, strength)
            if worst <= 1:
                break
            strength *= max(0.3, min(0.7, 0.85 / worst))
        if worst > 1 or ratios[hidden[0]] > 0.35:
            raise Redraw(f"unexcited: {ratios} {worst}")
    elif group == "outside":
        tgt = {"outside": float(np.exp(rng.uniform(np.log(4.8), np.log(11))))}
        amps, strength, ok = {"outside": 1.0}, 1.0, False
        for it in range(9):
            ratios, worst, load = evaluate_outside(case, judge, amps, strength)
            r, share = ratios["outside"], load[3]["outside"][3]
            if worst > 1:
                strength *= max(0.3, min(0.75, 0.85 / worst))
                continue
            if r >= 4.3 and share >= 0.078 and r < 30:
                ok = True
                break
            amps["outside"] *= float(np.clip(max(tgt["outside"] / max(r, 0.01), 0.095 / max(share, 1e-4)), 0.2, 6))
        if not ok:
            raise Redraw(f"outside {case.outside.kind}: {ratios}, share {share:.3f}, worst {worst:.2f}")
        took, by = best_alternative(case, load[0])
        if took > 0.4:
            raise Redraw(f"outside {case.outside.kind}: {by} takes {took:.2f}")
        note = f"{case.outside.SAYS[case.outside.kind]}; the best single catalogue effect ({by}) takes {100 * took:.0f} % of the squared error off; share of reading {share:.3f}"
    else:
        far, load, amps, strength, ratios = tune(lambda a, s: evaluate(case, judge, a, s), hidden, target, RANGES, first(hidden, 1.0))
    j, (log, rig, *_), fit, sizes = load
    cp, sens, tool, nu = load[1][2:]
    if "quantization" in hidden:
        log, rig, cp, sens, tool, nu = case.record(amps, strength)
    if group in ("single", "pair", "weak"):
        for h in hidden:
            if h != "quantization" and group != "weak":
                near += [a for a in j.near(h) if a not in near]
    truth = dict(kind=case.kind, group=group, model=",".join(case.model), hidden=hidden, true_model=",".join(case.model + hidden), near=near)
    if group == "outside":
        e, left, unit, _ = sizes["outside"]
        truth.update(effect_rms=e, left_rms=left, unit=unit)
    elif len(hidden) == 1:
        e, left, unit = sizes[hidden[0]]
        truth.update(effect_rms=e, left_rms=left, unit=unit)
    elif hidden:
        truth.update(effect_rms={h: sizes[h][0] for h in hidden}, left_rms={h: sizes[h][1] for h in hidden}, unit={h: sizes[h][2] for h in hidden})
    else:
        truth.update(effect_rms=0.0, left_rms=fit[0], unit=UNIT[case.kind])
    truth.update(fit_rms=fit[0], fit_unit=UNIT[case.kind], noise_rms=fit[2], reading_rms=fit[1], nuisances=plain({k: v for k, v in nu.items()}), parameters=parameters(case, amps, cp, sens, j),
                 values=plain(true_values(case, hidden, rig, cp, sens, tool, nu)),
                 seconds=float(log["t"][-1] - log["t"][0]), notes=note)
    return case, log, rig, truth


def RANGES_WEAK(hidden):
    return {h: (RANGES[h][0] * 0.02, RANGES[h][1], RANGES[h][2]) for h in hidden}


def first(hidden, f):
    return {h: RANGES[h][1] * f for h in hidden}


def parameters(case, amps, cp, sens, j):
    out = {"amplitudes": amps, "shapes": case.shapes, "in_model": case.xamps, "fitted_true_model": j.true.v}
    if case.kind in ("wrench", "tester"):
        out["material"] = {k: v for k, v in cp.items() if k not in ("Fmax",)}
        out["sensor"] = {k: v for k, v in sens.items() if k != "extra"}
    if case.kind == "wrench":
        out.update(robot=case.arm.name, controller=dict(kind="cartesian" if case.cart else "joint", **case.ctl), true_tool=dict(mass=case.mass, com=case.com))
    if case.kind == "tester":
        out["servo"] = case.servo
    if case.kind in ("joints", "drive"):
        out.update(robot=case.arm.name, friction={k: v for k, v in cp["fr"].items()}, stiffness=cp["K"])
    return plain(out)


def plain(x):
    if isinstance(x, dict):
        return {str(k): plain(v) for k, v in x.items()}
    if isinstance(x, (list, tuple)):
        return [plain(v) for v in x]
    if isinstance(x, np.ndarray):
        return plain(x.tolist())
    if isinstance(x, (np.floating, float)):
        return float(f"{float(x):.6g}")
    if isinstance(x, np.integer):
        return int(x)
    if isinstance(x, np.bool_):
        return bool(x)
    return x


def arr(v, d=9):
    return "[" + ", ".join(f"{float(x):.{d}g}" for x in v) + "]"


def write(folder, case, log, rig, rng):
    folder = pathlib.Path(folder)
    folder.mkdir(parents=True, exist_ok=True)
    u = rng.random()
    rows = len(log["t"])
    if u < 0.08 and rows < 30000:
        with open(folder / "log.csv", "w", newline="") as f:
            w = csv.writer(f)
            w.writerow(log)
            cols = [[x if isinstance(x, str) else f"{x:.10g}" for x in np.asarray(v).tolist()] for v in log.values()]
            w.writerows(zip(*cols))
    elif u < 0.14:
        np.savez_compressed(folder / "log.npz", **log)
    else:
        pq.write_table(pa.table({k: pa.array(v) for k, v in log.items()}), folder / "log.parquet", compression="zstd")
    text = []
    if case.kind in ("wrench", "joints"):
        a = case.arm
        model = a.rig_model
        byname = case.kind == "joints" and a.name == "ur5" and rig.get("tool") is None
        if byname:
            model = "ur5"
        elif a.urdf:
            (folder / model).write_text(a.urdf)
        text += ["[robot]", f'model = "{model}"']
        if not byname:
            text += ['sensor_frame = "ft_sensor"', 'tip_frame = "tool_tip"']
        text += [f"gravity = {arr(rig['gravity'])}", "joints = [" + ", ".join(f'"{j}"' for j in a.joints) + "]", ""]
    if case.kind == "wrench":
        text += ["[tool]", f"mass = {rig['mass']:.6g}", f"com = {arr(rig['com'], 6)}"]
        if rig["inertia"] is not None:
            I = rig["inertia"]
            text.append(f"inertia = {arr([I[0, 0], I[1, 1], I[2, 2], I[0, 1], I[0, 2], I[1, 2]], 6)}")
        text += ["", "[surface]", f"point = {arr(rig['point'])}", f"normal = {arr(rig['normal'])}", f"tangent = {arr(rig['tangent'])}", ""]
        if rng.random() < 0.5:
            text += ["[sensor]", f"noise = {arr(case.nu['sd'], 3)}", ""]
    elif case.kind == "joints" and rig.get("tool"):
        m, c = rig["tool"]
        text += ["[tool]", f"mass = {m:.6g}", f"com = {arr(c, 6)}", ""]
    elif case.kind == "tester" and rng.random() < 0.3:
        text += ["# a material tester: no robot", ""]
    (folder / "rig.toml").write_text("\n".join(text))


def dump(path, truths):
    path.write_text(json.dumps(truths, indent=1))


__all__ = ["make", "write", "dump", "UNEXCITED"]
