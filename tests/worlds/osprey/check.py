#!/usr/bin/env python
"""python check.py DATA: reads the files only (log, rig, URDF, truth.json) and prints what base and base+truth leave"""
import json, os, sys, tomllib, collections
import xml.etree.ElementTree as ET
import numpy as np
sys.path.insert(0, os.path.dirname(os.path.abspath(__file__)))
import pyarrow.parquet as pq, pyarrow.csv as pc
import fits, joints
from world import Chain


def chain(path):
    r = ET.parse(path).getroot()
    f = lambda s: [float(x) for x in s.split()]
    js, fx = [], {}
    for j in r.findall("joint"):
        o = j.find("origin")
        if j.get("type") == "revolute": js.append((f(o.get("xyz")), f(j.find("axis").get("xyz"))))
        else: fx[j.find("child").get("link")] = (f(o.get("xyz")), f(o.get("rpy"))[2])
    return Chain(r.get("name"), js, [], fx["flange"][0], fx["ft_sensor"], fx["tool_tip"][0])


def load(D, r):
    d = os.path.join(D, r["case"])
    tab = pq.read_table(d+"/log.parquet") if os.path.exists(d+"/log.parquet") else pc.read_csv(d+"/log.csv")
    log = {c: (np.array(tab[c].to_pylist()) if c == "phase" else tab[c].to_numpy()) for c in tab.column_names}
    rig = tomllib.load(open(d+"/rig.toml", "rb"))
    k = dict(log=log, values=r["values"], base_values=r["base_values"], extra=r["extra"], sig=r["check"]["sig"], floor=r["check"].get("floor"), urdf=None, rig={"g": None})
    if "robot" in rig:
        p = d+"/"+rig["robot"]["model"]; k["urdf"] = open(p).read(); ch = chain(p)
        k["rig"] = dict(ch=ch, g=np.array(rig["robot"]["gravity"]))
        if "tool" in rig:
            t = rig["tool"]; k["rig"].update(m=t["mass"], com=np.array(t["com"]), I=np.array(t.get("inertia", [0]*6)[:3]))
        s = rig.get("surface"); k["rig"]["free"] = s is None
        if s: n, t1 = np.array(s["normal"]), np.array(s["tangent"]); k["rig"].update(pt=np.array(s["point"]), B=np.stack([-n, t1, np.cross(n, t1)]))
        else: k["rig"].update(pt=np.zeros(3), B=np.eye(3))
    k["kind"] = "joints" if "tau1" in log else "contact"
    return k


def main(D):
    T = json.load(open(D+"/truth.json")); bad = []; use = collections.Counter()
    print(f"{'case':10s} {'group':12s} {'model':58s} {'truth':42s} effect: reading base -> base+truth (ratio)")
    for r in T:
        k = load(D, r)
        assert all(np.isfinite(v).all() for c, v in k["log"].items() if c != "phase") and (np.diff(k["log"]["t"]) > 0).all(), r["case"]
        model = r["model"].split(",")
        j = (fits.judge_contact if k["kind"] == "contact" else joints.judge_joints)(k, r["group"], model, r["truth"])
        if r["group"] in ("one", "two"): use.update(r["truth"])
        s = "; ".join(f"{e}: {v[0]} {v[1]:.4g} -> {v[2]:.4g} ({v[3]:.2f})" for e, v in j["ratio"].items())
        if not j["ok"]: bad.append(r["case"])
        print(f"{r['case']:10s} {r['group']:12s} {r['model']:58s} {','.join(r['truth']):42s} {s} left {j['left']:.4g} = {100*j['share']:.1f} % of reading, {j['overnoise']:.2f} x white noise {'ok' if j['ok'] else 'BREAKS RULE'}{'' if j['clean'] or r['group']=='outside' else ' (dirty)'}")
    print("groups", dict(collections.Counter(r["group"] for r in T)), "different effects", len(use), "more than twice", [e for e, n in use.items() if n > 2], "rule broken:", bad)


if __name__ == "__main__":
    main(sys.argv[1])
