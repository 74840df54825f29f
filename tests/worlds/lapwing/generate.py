"""lapwing: writes DATA/lapwing_NN (log, rig.toml, URDF) and DATA/truth.json. See README.md."""
import os
for k in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS"):
    os.environ.setdefault(k, "1")
import argparse, json, shutil, time
import numpy as np
import cases, refit

STAGE = {"build_arm": "contact", "build_free": "free wrench", "build_joint": "joint torques", "build_drive": "drive", "build_tester": "tester"}

def toml(rig):
    o = []
    for tab, d in rig.items():
        o.append(f"[{tab}]")
        for k, v in d.items():
            o.append(f"{k} = " + (json.dumps(v) if isinstance(v, (str, list)) else repr(float(v))))
        o.append("")
    return "\n".join(o) or "# a log of its own columns: no robot, no surface\n"

def write(folder, res):
    shutil.rmtree(folder, ignore_errors=True)
    os.makedirs(folder)
    open(os.path.join(folder, "rig.toml"), "w").write(toml(res["rig"]))
    if res["urdf"]:
        open(os.path.join(folder, "arm.urdf"), "w").write(res["urdf"])
    log = res["log"]
    if res["csv"]:
        import csv
        with open(os.path.join(folder, "log.csv"), "w", newline="") as f:
            w = csv.writer(f)
            w.writerow(log)
            for row in zip(*[(v if k == "phase" else np.char.mod("%.9g", v)) for k, v in log.items()]):
                w.writerow(row)
    else:
        import pyarrow as pa, pyarrow.parquet as pq
        pq.write_table(pa.table({k: pa.array(v.tolist(), pa.string()) if k == "phase" else pa.array(v) for k, v in log.items()}), os.path.join(folder, "log.parquet"))

def describe(group, truth, sp, a):
    """truth.json's figures and the notes on the size rule."""
    n = [sp["notes"]] if sp.get("notes") else []
    rd = a["read"]
    n.append(f"readings {rd:.3g}, left by the model {a['before']:.3g}, by the true model {a['true']:.3g}")
    bad = []
    if group in ("one", "two"):
        for e, (f, tq, w) in a["single"].items():
            rf, rt = f / a["true"], tq / max(a["true_t"], 1e-12)
            ok = (rf >= 2 and f >= 0.04 * rd) or (rt >= 2 and tq >= 0.04 * a.get("read_t", rd * refit.LW))
            n.append(f"without {e}: {f:.3g} ({rf:.1f}x, {100 * f / rd:.1f} % of the readings)" + (f", torques {tq:.3g} ({rt:.1f}x)" if tq else ""))
            if not ok:
                bad.append(f"size rule missed by {e}")
    if group == "quiet" and a["true"] > 0.02 * rd:
        bad.append(f"left is {100 * a['true'] / rd:.1f} % of the readings")
    if group == "not-excited" and a["true"] > 0.02 * rd:
        bad.append(f"left is {100 * a['true'] / rd:.1f} % of the readings")
    if group == "outside":
        n.append(f"with bias, drift, offset {a['with_bias']:.3g}; and with {'+'.join(a['best_two'])} {a['left']:.3g} ({100 * a['left'] / rd:.1f} %)")
        if a["left"] < 0.05 * rd:
            bad.append("imitated: less than 5 % is left")
    return "; ".join(n + ["VIOLATION: " + b for b in bad]), bad

def main():
    ap = argparse.ArgumentParser()
    ap.add_argument("--seed", type=int, required=True)
    ap.add_argument("--out", required=True)
    ap.add_argument("--only", default="")
    ap.add_argument("--quick", action="store_true", help="leave out the search for imitators")
    a = ap.parse_args()
    only = set(filter(None, a.only.split(",")))
    os.makedirs(a.out, exist_ok=True)
    tf = os.path.join(a.out, "truth.json")
    old = {x["case"]: x for x in json.load(open(tf))} if only and os.path.exists(tf) else {}
    truth, t00 = [], time.time()
    for case, group, k, model, tr, make, rng in cases.table(a.seed):
        if only and case not in only:
            if case in old:
                truth.append(old[case])
            continue
        t0 = time.time()
        folder = os.path.join(a.out, case)
        for attempt in range(6):                         # nuisances are drawn anew while the size rule is missed
            r = rng(attempt)
            sp = make(r)
            res = sp["build"](r, sp)
            write(folder, res)
            au = refit.audit(folder, group, model, tr, True)
            notes, bad = describe(group, tr, sp, au)
            if not bad:
                break
        t1 = time.time()
        if tr and group in ("one", "two") and not a.quick:
            au["near"] = refit.audit(folder, group, model, tr)["near"]
        stage = STAGE[sp["build"].__name__]
        row = {"case": case, "group": group, "kind": f"{stage}, {sp.get('robot', 'one axis' if stage == 'drive' else 'bench')}, {res['T']:.0f} s", "model": ",".join(model), "truth": tr,
               "near": sorted(set(au["near"])), "values": {k: float(v) for k, v in sp.get("values", {}).items()}, "true_error": au["true"], "notes": notes}
        if group == "outside":
            row["class"] = sp.get("cls", [])
        truth.append(row)
        print(f"{case} {group:11s} {'+'.join(tr):45s} {attempt} {t1-t0:5.1f}s {time.time()-t1:5.1f}s near={row['near']} {notes}", flush=True)
    json.dump(truth, open(tf, "w"), indent=1)
    print(f"{len(truth)} cases, {time.time()-t00:.0f} s")

if __name__ == "__main__":
    main()
