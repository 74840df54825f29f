"""verify.py DATA: files there, finite, times increasing; nothing of the content is printed."""
import json, os, sys, tomllib, numpy as np
from check import load
D = sys.argv[1]; r = json.load(open(D+"/truth.json")); bad = 0
for x in r:
    p = D+"/"+x["case"]; d = load(p); rig = tomllib.load(open(p+"/rig.toml", "rb")); fs = os.listdir(p)
    ok = all(np.isfinite(v).all() for k, v in d.items() if k != "phase") and np.all(np.diff(d["t"]) > 0) and np.isfinite([*x["true_error"].values(), *x["noise"].values(), *x["values"].values()]).all()
    if x["kind"] == "arm": ok = ok and rig["robot"]["model"] in fs
    if any(k.startswith("dq") or k == "depth_rate" for k in d): ok = ok and any("nodq" in f for f in fs)
    bad += not ok
print(len(r), "cases,", bad, "bad")
