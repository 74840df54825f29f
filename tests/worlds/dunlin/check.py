"""check.py DATA: what base and base+truth leave in each case (own least squares on the written files)."""
import os
for _v in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS"): os.environ[_v] = "1"
import sys, json, fit
D = sys.argv[1]; T = json.load(open(D+"/truth.json")); M = json.load(open(D+"/.start.json")); bad = 0
for c in T:
    m = M[c["case"]]; o = fit.check_case(os.path.join(D, c["case"]), m); u = "N" if m["type"] != "j" and m["acts"][0] != "t" else "N·m"
    rule = {"one": ">=2", "two": ">=1.5", "outside": ">=2 x twin", "quiet": "<=1 x max(1.3 noise, 2%)", "not-excited": "<=1.1"}[c["group"]]; bad += not o["ok"]
    print("%s %-11s %-11s %-38s + %-45s reading %8.3g base %s full %s %s ratio %s (%s) %s%s" % (c["case"], c["group"], c["kind"], c["model"].replace("joint-", "j-"), ",".join(c["truth"]) or c["notes"] or "-", o["reading"],
          "/".join("%.3g" % x for x in dict.fromkeys(o["base"])), "/".join("%.3g" % x for x in dict.fromkeys(o.get("full", []))) or "-", u, "/".join("%.2f" % x for x in o["ratio"]), rule, "ok" if o["ok"] else "BREAKS", "" if o.get("strict", True) else " (nuisances leave more than 2 %)"))
print("cases that break a rule:", bad)
