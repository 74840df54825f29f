"""python check.py DATA: reads the written logs again and prints what base and base+truth leave in the readings the effect acts on."""
import sys, os, json, pickle
import numpy as np
sys.path.insert(0, os.path.dirname(os.path.abspath(__file__)))
import generate as G
import pyarrow.parquet as pq, pyarrow.csv as pc
def load(d):
    p = os.path.join(d, "log.parquet"); T = pq.read_table(p) if os.path.exists(p) else pc.read_csv(os.path.join(d, "log.csv"))
    return {k: np.array(T[k].to_pylist()) for k in T.column_names if k != "phase"}
def main(data):
    bad = 0; seen = {}
    for x in json.load(open(os.path.join(data, "truth.json"))):
        o = pickle.load(open(os.path.join(data, "_check", x["case"] + ".pkl"), "rb")); o["L"] = load(os.path.join(data, x["case"])); c = o["c"]
        if x["group"] == "outside":   # the twin without it cannot be read from the log: as generated
            R = G.left(o, x["model"].split(",")); ch = list(range(c["robot"].n if c["robot"] else 1)) if G.isj(c["kind"]) else ([0, 1, 2] if c["kind"] != "tester" or c["P"][G.IX["mu"]] > 0 else [2])
            t = dict(base=G.rms(R, ch), without=x["check"]["without"], rms=x["check"]["rms"]); ok = t["base"] >= 2 * t["without"]
        else: ok, t = G.judge(o, x["group"], x["model"], x["truth"])
        bad += not ok
        for e in x["truth"]: seen[e] = seen.get(e, 0) + (x["group"] in ("one", "two"))
        print(f'{x["case"]} {x["group"]:11s} {x["kind"]:12s} {"ok " if ok else "BAD"} {x["model"]:55.55s} + {",".join(x["truth"]) or "-":34s} {({k: np.round(v, 4).tolist() for k, v in t.items()})} true_error {x["true_error"]:.4g} near {x["near"]}')
    print("cases that break a rule:", bad, "| effects used:", len([e for e in seen if seen[e]]), "| most often:", max(seen.values()))
if __name__ == "__main__": main(sys.argv[1])
