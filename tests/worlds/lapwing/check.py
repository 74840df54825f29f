"""check.py DATA: tests the written files against the contract and truth.json against the catalogue's names."""
import json, os, re, sys
import numpy as np
from refit import read
import robots

HERE = os.path.dirname(os.path.abspath(__file__))
NAMES = set(re.findall(r"`([a-z-]+)`", open(os.path.join(HERE, "..", "effects.md")).read()))
BASES = {"hooke", "kelvin-voigt", "hertz", "hunt-crossley", "maxwell", "zener", "rigid-body", "none"}
PAR = {}
for line in open(os.path.join(HERE, "..", "parameters.md")):
    if line.startswith("- ") and ": " in line:
        e, p = line[2:].split(": ", 1)
        PAR[e] = {re.sub(r"\[j\d\]|\[j\d(,\d)\]", r"[j#\1]", x.rsplit(" [", 1)[0].strip()) for x in re.split(r", (?=[a-z0-9-]+(?:\[[^\]]*\])? \[)", p.strip())}
PHASES = {"free", "approach", "hold", "poke", "slide", "retract", "rest"}
COL = re.compile(r"^(t|phase|f[xyz]|t[xyz]|depth|depth_rate|normal_force|slip[12]|tangential_force[12]|(q|dq|tau|q_cmd)\d+)$")

def case(folder, row):
    bad = []
    say = lambda ok, msg: ok or bad.append(msg)
    logs = [f for f in os.listdir(folder) if f.startswith("log.")]
    say(len(logs) == 1, f"one log expected, found {logs}")
    log, rig = read(folder)
    say(all(COL.match(c) for c in log), f"columns {list(log)}")
    t = log["t"]
    say(np.all(np.diff(t) > 0), "time not increasing")
    fs, T = 1 / np.median(np.diff(t)), t[-1] - t[0]
    say(15 <= fs <= 2100 and 4 < T < 230, f"rate {fs:.0f} Hz, {T:.0f} s")
    say(all(len(v) == len(t) for v in log.values()), "lengths differ")
    say(all(np.all(np.isfinite(v)) for c, v in log.items() if c != "phase"), "not finite")
    nq = sum(bool(re.match(r"^q\d+$", c)) for c in log)
    if "phase" in log:
        say(set(log["phase"]) <= PHASES, f"phases {set(log['phase'])}")
    if "robot" in rig:
        ro = rig["robot"]
        say(set(ro) <= {"model", "sensor_frame", "tip_frame", "gravity", "joints"}, f"robot fields {set(ro)}")
        f = ro.get("sensor_frame") or {"ur5": "tool0", "panda": "panda_hand", "lwr4plus": "flange"}.get(ro["model"], "flange")
        arm = robots.load(ro["model"], f, ro.get("tip_frame", f), ro.get("gravity", [0, 0, -9.81]), ro.get("joints"), folder)
        say(arm.n == nq, f"{nq} joints logged, the arm has {arm.n}")
        say(abs(np.linalg.norm(ro["gravity"]) - 9.81) < 0.01, "gravity")
        say(np.abs(np.column_stack([log[f"q{i+1}"] for i in range(nq)])).max() < 6.3, "angles beyond a turn: degrees?")
    if "fz" in log:
        say(all(c in log for c in ("fx", "fy", "fz", "tx", "ty", "tz")), "six wrench channels")
        say(set(rig["tool"]) <= {"mass", "com", "inertia"}, "tool fields")
    if "surface" in rig:
        n, a = np.array(rig["surface"]["normal"]), np.array(rig["surface"]["tangent"])
        say(abs(n @ n - 1) < 1e-6 and abs(a @ a - 1) < 1e-6 and abs(n @ a) < 1e-6, "normal, tangent")
        from refit import Wrench
        W = Wrench(folder)
        say(0.0005 < W.d.max() < 0.012, f"depth {W.d.max()}")
        say(np.median(W.fn[W.d > 0.4 * W.d.max()]) > 0.3, "no push where the tip is deep")
        air = W.d < -0.001
        left = np.abs(np.median((W.Y - W.W0)[air], axis=0))
        if not set(row["truth"]) & {"sensor-bias", "sensor-drift", "tool-mass", "sensor-crosstalk", "sensor-misalignment"} and row["group"] != "outside":
            say(left[:3].max() < 0.15 and left[3:].max() < 0.02, f"tool in the air reads {np.round(left, 3)} beyond its weight")
    if "depth" in log:
        say(np.abs(log["depth"]).max() < 0.02 and "normal_force" in log, "tester columns or units")
    if "robot" not in rig and "q1" in log:
        say(nq == 1 and "tau1" in log, "drive columns")
    for e in row["model"].split(","):
        say(e in NAMES | BASES, f"model name {e}")
    for e in row["truth"] + row["near"] + row.get("class", []):
        say(e in NAMES, f"effect name {e}")
    for k in row["values"]:
        e, p = k.split(".", 1)
        say(e in row["truth"] and re.sub(r"\[j\d+", "[j#", p) in PAR.get(e, set()), f"value {k}")
    say(row["group"] not in ("one", "two") or len(row["truth"]) == {"one": 1, "two": 2}[row["group"]], "number of hidden effects")
    return bad

def main():
    data = sys.argv[1]
    rows = json.load(open(os.path.join(data, "truth.json")))
    wrong = 0
    for r in rows:
        bad = case(os.path.join(data, r["case"]), r)
        wrong += bool(bad)
        for b in bad:
            print(r["case"], r["kind"], b)
        if "VIOLATION" in r["notes"]:
            print(r["case"], "size rule:", r["notes"].split("VIOLATION", 1)[1])
    g = [r["group"] for r in rows]
    print(f"{len(rows)} cases, {wrong} with faults;", {k: g.count(k) for k in dict.fromkeys(g)}, f"{len({e for r in rows for e in r['truth']})} different names hidden")
    sys.exit(bool(wrong))

if __name__ == "__main__":
    main()
