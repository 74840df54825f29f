"""python check.py DATA: what base and base+truth leave, per case, on the log as written."""
import sys, json, os, numpy as np
import generate as g
for o in json.load(open(os.path.join(sys.argv[1], "truth.json"))):
    res, rr = g.leaves(os.path.join(sys.argv[1], o["case"]), o); ok, x = g.judge(o, res, rr); f = lambda a: " ".join("%.3g" % v for v in a)
    print(o["case"], o["group"], o["kind"], o["model"], o["truth"] or o["notes"], "OK" if ok else "BREAKS", "%.2f" % x, "| base", f(res[0]), "|", f(res[1]) if len(res) > 1 else "", "| reading", f(rr), "| true_error %.3g" % o["true_error"])
