"""check.py DATA: columns, stamps, finiteness, rigs against contracts.md, truth.json against the brief's counts."""
import collections
import json
import os
import sys
import tomllib
import numpy as np
import pyarrow.parquet as pq

bad = []
def need(ok, *m):
    if not ok: bad.append(" ".join(map(str, m)))

d = sys.argv[1]
rows = json.load(open(os.path.join(d, "truth.json")))
WANT = {"one": dict(C=12, T=2, F=3, J=3, D=2), "quiet": dict(C=4, F=1, J=1, D=1, T=2), "two": dict(C=4, T=1, J=1, D=1), "outside": dict(C=3, F=1, J=1, D=1)}
cnt = collections.Counter((r["group"], r["kind"]) for r in rows)
for g, w in WANT.items():
    for k, n in w.items(): need(cnt[g, k] == n, "count", g, k, cnt[g, k], n)
ne = collections.Counter(r["kind"] for r in rows if r["group"] == "not-excited")
need(ne["C"] + ne["T"] == 3 and ne["D"] + ne["F"] == 1, "not-excited", dict(ne)); need(len(rows) == 48, len(rows), "rows")
KEYS = "case group kind model hidden true_model near class values error_true error_before noise readings_rms violations notes".split()
size = 0
for r in rows:
    c = r["case"]; f = os.path.join(d, c)
    need(list(r) == KEYS or set(r) == set(KEYS), c, "keys")
    need(all(np.isfinite(v) for v in r["values"].values()) and np.isfinite(r["error_true"]), c, "values")
    size += sum(os.path.getsize(os.path.join(f, x)) for x in os.listdir(f))
    rig = tomllib.load(open(os.path.join(f, "rig.toml"), "rb"))
    tab = pq.read_table(os.path.join(f, "log.parquet")); L = {n: tab[n].to_numpy(zero_copy_only=False) for n in tab.column_names}
    t = L["t"]; need(np.all(np.diff(t) > 0), c, "stamps not rising"); need(7.5 <= t[-1] - t[0] <= 200, c, "length", round(t[-1] - t[0], 1))
    rate = 1 / np.median(np.diff(t)); need(45 <= rate <= 2100, c, "rate", rate)
    for n, v in L.items():
        need(n == "phase" or np.isfinite(v.astype(float)).all(), c, n, "not finite")
    nq = len([n for n in L if n[0] == "q" and n[1:].isdigit()])
    wr = ["fx", "fy", "fz", "tx", "ty", "tz"]
    if r["kind"] in "CFJ":
        rb = rig["robot"]; need(len(rb["joints"]) == nq, c, "joints", nq); need(abs(np.linalg.norm(rb["gravity"]) - 9.81) < .02, c, "gravity")
        if rb["model"].endswith(".urdf"): need(os.path.exists(os.path.join(f, rb["model"])), c, "no urdf")
    if r["kind"] in "CF":
        need(all(x in L for x in wr), c, "wrench"); tl = rig["tool"]; need(tl["mass"] > 0 and np.linalg.norm(tl["com"]) < .4, c, "tool")
        i = tl.get("inertia")
        if i:
            e = np.linalg.eigvalsh([[i[0], i[3], i[4]], [i[3], i[1], i[5]], [i[4], i[5], i[2]]]); need(e[0] > 0 and e[0] + e[1] >= e[2] - 1e-12, c, "inertia", e)
    if r["kind"] == "C":
        s = rig["surface"]; need(abs(np.linalg.norm(s["normal"]) - 1) < 1e-6 and abs(np.dot(s["normal"], s["tangent"])) < 1e-6, c, "surface")
    if r["kind"] in "JD": need("tau1" in L and "q1" in L, c, "tau"); need("surface" not in rig, c, "surface?")
    if r["kind"] == "T": need("depth" in L and "normal_force" in L and "robot" not in rig, c, "tester")
    has = any(n.startswith("dq") for n in L)
    need(has == os.path.exists(os.path.join(f, "log_nodq.parquet")), c, "nodq")
    if has: need(not any(n.startswith("dq") for n in pq.read_schema(os.path.join(f, "log_nodq.parquet")).names), c, "nodq holds dq")
need(size < 300e6, "size", size)
print(f"{len(rows)} cases, {size/1e6:.0f} MB, with violations {sum(bool(r['violations']) for r in rows)}:", "; ".join(f"{r['case']} {r['violations']}" for r in rows if r["violations"]))
print("\n".join(bad) if bad else "all right"); sys.exit(bool(bad))
