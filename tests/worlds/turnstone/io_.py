"""Writing a case: log.parquet, log_nodq.parquet, rig.toml and the arm's URDF."""
import os
import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq


def toml(rig):
    s = []
    def val(v):
        if isinstance(v, str): return '"' + v + '"'
        if isinstance(v, (list, tuple, np.ndarray)): return "[" + ", ".join(val(x) for x in v) + "]"
        if isinstance(v, (bool, np.bool_)): return str(bool(v)).lower()
        if isinstance(v, (int, np.integer)): return str(int(v))
        return repr(float(v))
    for k, tb in rig.items():
        s.append(f"[{k}]")
        s += [f"{a} = {val(b)}" for a, b in tb.items()]
        s.append("")
    return "\n".join(s)


def write_case(folder, log, rig, arm=None):
    os.makedirs(folder, exist_ok=True)
    for f in ("log.parquet", "log_nodq.parquet"):
        if os.path.exists(os.path.join(folder, f)):
            os.remove(os.path.join(folder, f))
    for f in os.listdir(folder):
        if f.endswith(".urdf"):
            os.remove(os.path.join(folder, f))
    tab = pa.table({k: pa.array(v) for k, v in log.items()})
    pq.write_table(tab, os.path.join(folder, "log.parquet"), compression="zstd")
    dq = [c for c in tab.column_names if c.startswith("dq") or c == "depth_rate"]
    if any(c.startswith("dq") for c in dq):
        pq.write_table(tab.drop(dq), os.path.join(folder, "log_nodq.parquet"), compression="zstd")
    with open(os.path.join(folder, "rig.toml"), "w") as f:
        f.write(toml(rig))
    if arm is not None and arm.rigmodel.endswith(".urdf"):
        with open(os.path.join(folder, arm.rigmodel), "w") as f:
            f.write(arm.urdf)
