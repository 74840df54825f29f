"""generate.py --seed S --out DATA [--all]   (--all: every recipe once, for check.py)"""
import argparse, json, os, sys, time
os.environ.setdefault("OMP_NUM_THREADS", "1")
import numpy as np
import pyarrow as pa, pyarrow.parquet as pq
sys.path.insert(0, os.path.dirname(os.path.abspath(__file__)))
import cases, build

def table(d, path, csv):
    if csv:
        k = list(d); 
        with open(path+".csv", "w") as f:
            f.write(",".join(k)+"\n")
            for i in range(len(d["t"])): f.write(",".join(d[x][i] if x == "phase" else "%.9g" % d[x][i] for x in k)+"\n")
    else: pq.write_table(pa.table({k: (v.tolist() if k == "phase" else v) for k, v in d.items()}), path+".parquet")

def main():
    a = argparse.ArgumentParser(); a.add_argument("--seed", type=int, required=True); a.add_argument("--out", required=True); a.add_argument("--all", action="store_true"); a.add_argument("--only", default=""); a.add_argument("-v", action="store_true")
    a = a.parse_args(); os.makedirs(a.out, exist_ok=True); rows = []
    for i, (grp, fn) in enumerate(cases.allcases() if a.all else cases.plan(a.seed)):
        if a.only and fn.__name__ not in a.only.split(","): continue
        t0 = time.time(); rng = np.random.default_rng([a.seed, sum(map(ord, fn.__name__))*31+len(fn.__name__), 1]); c = fn(rng)
        name = "larch_%02d" % i if not a.all else fn.__name__; path = os.path.join(a.out, name); os.makedirs(path, exist_ok=True)
        if c["kind"] == "arm":
            s = build.sim_arm(c, rng); d, te, ns = build.log_arm(s, rng, c); build.rig_arm(s, c, path)
        elif c["kind"] == "tester":
            s = build.sim_tester(c, rng); d, te, ns = build.log_tester(s, rng, c); open(path+"/rig.toml", "w").write("# larch: material tester; no robot, columns by their own names\n")
        else:
            s = build.sim_drive(c, rng); d, te, ns = build.log_drive(s, rng, c); open(path+"/rig.toml", "w").write("# larch: drive on a bench, one axis (vertical: no gravity)\n")
        csv = c["kind"] == "tester" and rng.random() < .25
        table(d, path+"/log", csv)
        nod = {k: v for k, v in d.items() if not (k.startswith("dq") or k == "depth_rate")}
        if len(nod) < len(d): table(nod, path+"/log_nodq", csv)
        rows.append(dict(case=name, group=grp, kind=c["kind"], model=c["model"], truth=c["truth"] if grp != "outside" else [], **{"class": c.get("class", [])}, values=c["values"], noise=ns, true_error=te, note=c["note"]+("; recipe "+fn.__name__)))
        bad = [k for k, v in d.items() if k != "phase" and not np.all(np.isfinite(v))]
        if a.v or bad: print(name, fn.__name__, "%.1fs" % (time.time()-t0), len(d["t"]), "T=%.0f" % d["t"][-1], "BAD" if bad else "", flush=True)
    json.dump(rows, open(os.path.join(a.out, "truth.json"), "w"), indent=1)
main()
