"""python check.py DATA: what base and base+truth leave in each log as written (rms per channel), and whether the rules hold."""
import json, os, sys
import generate as g
D = sys.argv[1]; K = {k["case"]: k for k in json.load(open(os.path.join(D, "check.json")))}; bad = []
for o in json.load(open(os.path.join(D, "truth.json"))):
    d = os.path.join(D, o["case"]); k = K[o["case"]]; log = g.read_log(d); u = [f for f in os.listdir(d) if f.endswith(".urdf")]; xml = open(os.path.join(d, u[0])).read() if u else ""
    ok, x, res, rr = g.judge(log, o, k, xml); f = lambda a: " ".join("%.3g" % b for b in a); bad += [] if ok else [o["case"]]
    print(o["case"], o["group"], o["kind"], o["model"], o["truth"] or o["notes"], "OK" if ok else "BREAKS", "%.2f" % x, "| base", f(res[0]), "| +truth", f(res[1]) if len(res) > 1 else "-", "| reading", f(rr), "| true_error %.3g" % o["true_error"], flush=True)
print("breaks:", bad or "none")
